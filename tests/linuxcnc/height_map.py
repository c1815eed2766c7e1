#!/usr/bin/python3
"""A height-map component for LinuxCNC's external offsets, as its users know it: polled at 20 Hz, looked up at whole
millimetres, written in counts of a micrometre, clamped silently outside the map. Unlike those it corrects all three axes.

The map: one line `x y cx cy cz` per point of a grid, mm and um, x in the outer loop.
"""
import sys
import time

import hal


class Map:
    def __init__(self, path):
        rows = [[float(word) for word in line.split()] for line in open(path, encoding="utf-8")]
        self.x = sorted({row[0] for row in rows})
        self.y = sorted({row[1] for row in rows})
        self.values = [row[2:] for row in rows]

    def at(self, x, y):
        i, u = place(self.x, x)
        j, v = place(self.y, y)
        n = len(self.y)
        corners = [self.values[(i + a) * n + j + b] for a in (0, 1) for b in (0, 1)]
        shares = [(1 - u) * (1 - v), (1 - u) * v, u * (1 - v), u * v]
        return [sum(s * c[k] for s, c in zip(shares, corners)) for k in range(3)]


def place(grid, position):
    position = min(max(position, grid[0]), grid[-1])
    k = min(int((position - grid[0]) / (grid[1] - grid[0])), len(grid) - 2)
    return k, (position - grid[k]) / (grid[k + 1] - grid[k])


def main():
    table = Map(sys.argv[1])
    component = hal.component("heightmap")
    for axis in "xyz":
        component.newpin(f"pos-{axis}", hal.HAL_FLOAT, hal.HAL_IN)
        component.newpin(f"count-{axis}", hal.HAL_S32, hal.HAL_OUT)
    component.ready()
    while True:
        correction = table.at(round(component["pos-x"]), round(component["pos-y"]))
        for axis, value in zip("xyz", correction):
            component[f"count-{axis}"] = round(value)
        time.sleep(0.05)


main()
