"""An MTConnect agent's side of an adapter: reads SHDR lines by the device file, strictly, and prints what /current would hold.

Usage: mtconnect_agent.py DEVICE.xml HOST:PORT SECONDS
"""

import datetime
import json
import socket
import sys
import time
import xml.etree.ElementTree as ET

LEVELS = {"NORMAL", "WARNING", "FAULT", "UNAVAILABLE"}


def items(path):
    """The data items of a device file by name."""
    found = {}
    for element in ET.parse(path).getroot().iter():
        if element.tag.rsplit("}", 1)[-1] == "DataItem":
            if element.attrib["name"] in found or element.attrib["id"] in {i["id"] for i in found.values()}:
                raise ValueError(f"{element.attrib['name']} twice in the device file")
            found[element.attrib["name"]] = element.attrib
    return found


def observe(line, known, current):
    """Takes one line; a line that an agent would drop or misread is an error."""
    stamp, *fields = line.split("|")
    moment = datetime.datetime.fromisoformat(stamp.replace("Z", "+00:00"))
    age = abs((datetime.datetime.now(datetime.timezone.utc) - moment).total_seconds())
    if age > 60:
        raise ValueError(f"{age} s old: {line}")
    while fields:
        key = fields.pop(0)
        item = known.get(key)
        if item is None:
            raise ValueError(f"no data item {key}: {line}")
        if item["category"] == "CONDITION":
            # level, native code, native severity, qualifier, text: the rest of the line
            if len(fields) != 5 or fields[0] not in LEVELS:
                raise ValueError(f"no condition: {line}")
            value, fields = fields, []
        else:
            value = fields.pop(0)
            if item["category"] == "SAMPLE" and value != "UNAVAILABLE":
                value = float(value)
            if item["type"] == "AVAILABILITY" and value not in ("AVAILABLE", "UNAVAILABLE"):
                raise ValueError(f"no availability: {line}")
        current[item["id"]] = {"name": key, "value": value, "units": item.get("units")}


def main():
    known = items(sys.argv[1])
    host, port = sys.argv[2].rsplit(":", 1)
    end = time.monotonic() + float(sys.argv[3])
    # nothing is known until the adapter says it
    current = {item["id"]: {"name": name, "value": "UNAVAILABLE"} for name, item in known.items()}
    heartbeat, lines, rest = None, 0, b""
    with socket.create_connection((host, int(port)), timeout=5) as stream:
        stream.sendall(b"* PING\n")
        stream.settimeout(0.2)
        while time.monotonic() < end:
            try:
                data = stream.recv(65536)
            except TimeoutError:
                continue
            if not data:
                raise ConnectionError("the adapter has closed the connection")
            *whole, rest = (rest + data).split(b"\n")
            for line in (part.decode("utf-8").strip() for part in whole):
                if line.startswith("* PONG "):
                    heartbeat = int(line.split(" ")[2])
                elif line and not line.startswith("*"):
                    observe(line, known, current)
                    lines += 1
    print(json.dumps({"heartbeat_ms": heartbeat, "lines": lines, "current": {i["name"]: i["value"] for i in current.values()}}))


main()
