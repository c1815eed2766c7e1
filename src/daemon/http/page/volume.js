// The working volume as a wire grid, distorted by what the model says, with the tool's present position.

import { byId, drawn, number } from "/common.js";

const WIDTH = 640;
const HEIGHT = 380;
const MARGIN = 36;
const COS = Math.cos(Math.PI / 6);
const SIN = Math.sin(Math.PI / 6);
let volume = null;
let asked = null;
let view = null;

/** X to the lower right, Y to the upper right, Z upwards. */
const flat = ([x, y, z]) => [(x + y) * COS, z + (y - x) * SIN];
const moved = (place, deviation_um) => place.map((v, k) => v + (deviation_um[k] * volume.magnification) / 1000);

function at(place) {
  const [u, v] = flat(place);
  return [view.left + view.scale * (u - view.low[0]), view.bottom - view.scale * (v - view.low[1])];
}

function path(points) {
  return points.map((p, k) => (k ? "L" : "M") + at(p).map((v) => v.toFixed(1)).join(" ")).join("");
}

/** Fits the view around nominal and distorted wires. */
function fit() {
  const all = volume.wires.flatMap((w) => w.points.flatMap((p) => [p.slice(0, 3), moved(p.slice(0, 3), p.slice(3))])).map(flat);
  const low = [0, 1].map((k) => Math.min(...all.map((p) => p[k])));
  const high = [0, 1].map((k) => Math.max(...all.map((p) => p[k])));
  const size = low.map((v, k) => Math.max(high[k] - v, 1e-9));
  const scale = Math.min((WIDTH - 2 * MARGIN) / size[0], (HEIGHT - 2 * MARGIN) / size[1]);
  view = { low, scale, left: (WIDTH - scale * size[0]) / 2, bottom: (HEIGHT + scale * size[1]) / 2 };
}

function paint() {
  const picture = byId("volume");
  picture.setAttribute("viewBox", "0 0 " + WIDTH + " " + HEIGHT);
  if (!volume.wires) {
    picture.replaceChildren();
    return;
  }
  fit();
  const nominal = (w) => w.points.map((p) => p.slice(0, 3));
  const distorted = (w) => w.points.map((p) => moved(p.slice(0, 3), p.slice(3)));
  const parts = [];
  for (const w of volume.wires.filter((w) => w.front)) parts.push(drawn("path", { d: path(nominal(w)), class: "nominal" }));
  for (const w of volume.wires.filter((w) => !w.front)) parts.push(drawn("path", { d: path(distorted(w)), class: "behind" }));
  for (const w of volume.wires.filter((w) => w.front)) parts.push(drawn("path", { d: path(distorted(w)), class: "front" }));
  // letters at the ends of three edges
  const start = [0, 0, 0];
  for (const { axis, range } of volume.axes) start["xyz".indexOf(axis)] = range[0];
  for (const { axis, range } of volume.axes) {
    const k = "xyz".indexOf(axis);
    const from = [...start];
    const x = volume.axes.find((a) => a.axis === "x");
    if (k === 1 && x) from[0] = x.range[1];
    const to = [...from];
    to[k] = range[1] + 30 / view.scale;
    const [left, top] = at(to);
    parts.push(drawn("text", { x: left.toFixed(1), y: (top + 5).toFixed(1), class: "letter" }, axis.toUpperCase()));
  }
  parts.push(drawn("g", { id: "tool" }));
  picture.replaceChildren(...parts);
}

/** Marks where the tool stands: without compensation on the distorted grid, with it near the nominal place. */
function mark(status) {
  const tool = byId("tool");
  const benefit = status.benefit;
  if (!tool) return "";
  const linear = Object.keys(status.position_mm);
  if (!linear.length) {
    tool.replaceChildren();
    return " The tool's position is not known.";
  }
  const place = ["x", "y", "z"].map((axis) => status.position_mm[axis] ?? 0);
  const said = linear.map((axis) => axis.toUpperCase() + " " + number(status.position_mm[axis], 1)).join(", ");
  const outside = volume.axes.filter(({ axis, range }) => status.position_mm[axis] < range[0] || status.position_mm[axis] > range[1]);
  const floor = [...place];
  const z = volume.axes.find((a) => a.axis === "z");
  if (z) floor[2] = z.range[0];
  const parts = [drawn("path", { d: path([place, floor]), class: "drop" })];
  if (benefit) {
    const [without, with_] = [benefit.without_xyz_um, benefit.with_xyz_um].map((e) => moved(place, e));
    const circle = (p, r, name) => {
      const [cx, cy] = at(p);
      return drawn("circle", { cx: cx.toFixed(1), cy: cy.toFixed(1), r, class: name });
    };
    parts.push(drawn("path", { d: path([place, without]), class: "error" }), circle(without, 6, "without"), circle(with_, 8, "with"));
  }
  tool.replaceChildren(...parts);
  return " Tool at " + said + " mm" + (outside.length ? ", outside of the model's volume" : "") + ".";
}

async function load(hash) {
  asked = hash;
  try {
    const found = await (await fetch("/api/v1/volume")).json();
    // a switch of the model a moment ago: the next status asks again
    if (found.model_hash !== hash) asked = null;
    volume = found;
    paint();
  } catch {
    asked = null;
  }
}

export function showVolume(status) {
  if (asked !== status.model_hash) load(status.model_hash);
  if (!volume || volume.model_hash !== status.model_hash) return;
  const tool = volume.wires ? mark(status) : "";
  byId("volume-note").textContent = volume.wires
    ? "Deviations magnified " + volume.magnification + " times; largest on the grid " + number(volume.largest_um, 1)
      + " µm, as the model predicts it" + (volume.rotary ? ", rotary axes at home." : ".") + tool
    : "The model states no travel and has no curve of X, Y or Z: there is no volume to draw.";
}
