"use strict";
// Shows the status that the daemon sends once a second. All text goes in as text, never as markup.

const SAMPLES = 120;
const byId = (id) => document.getElementById(id);
let codes = new Map();
let history = {};
let newest = null;
let announced = "";
let lastEvents = "";

/** A new element with text and class. */
function element(name, text, className) {
  const made = document.createElement(name);
  if (text !== undefined && text !== null) made.textContent = text;
  if (className) made.className = className;
  return made;
}

const number = (value, digits) =>
  value === null || value === undefined ? "–" : value.toFixed(digits).replace("-", "\u2212");
const micro = (unit) => (unit === "um" ? "µm" : "″");
const micron = (text) => text.replace(/(\d) um\b/g, "$1 µm");
const latency = (us) => (us === null || us === undefined ? "–" : us >= 1000 ? number(us / 1000, 2) + " ms" : number(us, us < 100 ? 1 : 0) + " µs");

function duration(seconds) {
  const s = Math.max(0, Math.floor(seconds));
  if (s < 60) return s + " s";
  if (s < 3600) return Math.floor(s / 60) + " min " + (s % 60) + " s";
  const h = Math.floor(s / 3600);
  return h < 48 ? h + " h " + Math.floor((s % 3600) / 60) + " min" : Math.floor(h / 24) + " days";
}

/** Words and colour of the banner. */
function banner(status) {
  const words = {
    active: ["COMPENSATING", "active"], "fading-to-static": ["COMPENSATING", "active"], "ramping-in": ["RAMPING IN", "active"],
    "ramping-out": ["RAMPING OUT", "held"], holding: ["HOLDING", "held"], faulted: ["FAULT", "bad"],
    disconnected: ["DISCONNECTED", "bad"], armed: ["WAITING FOR THE MACHINE", "idle"], off: ["OFF", "idle"],
  };
  let [word, colour] = words[status.state] || [status.state.toUpperCase(), "idle"];
  if (status.shadow) word += " (SHADOW)";
  if (status.health.verdict === "faulted") [word, colour] = ["FAULT", "bad"];
  return [word, colour];
}

function showBanner(status) {
  const [word, colour] = banner(status);
  const health = status.health;
  byId("banner").className = colour;
  byId("state").textContent = word;
  byId("machine").textContent = status.machine;
  const gain = status.gain !== 1 ? ", gain " + number(100 * status.gain, 0) + " %" : "";
  const fault = status.faults[0];
  byId("since").textContent = "for " + duration(fault ? fault.age_s : status.state_since_s) + gain;
  const code = health.code && !health.cause.startsWith(health.code) ? health.code + " " : "";
  byId("cause").textContent = micron(health.cause ? code + health.cause : "");
  const off = status.state === "off" && health.verdict === "ok" ? "Compensation is off; `volcomp enable` switches it on." : "";
  byId("remedy").textContent = health.remedy ? "What to do: " + health.remedy : off;
  document.title = word + " · " + status.machine;
  const said = word + (health.cause ? ", " + code + health.cause : "");
  if (said !== announced) byId("announce").textContent = announced = said;
}

function showBenefit(status) {
  const benefit = status.benefit;
  byId("without").textContent = benefit ? number(benefit.without_um, 1) + " µm" : "–";
  byId("with").textContent = benefit ? number(benefit.with_um, 1) + " µm" : "–";
  byId("benefit-hour").textContent = benefit
    ? "Last hour: " + number(benefit.without_rms_um, 1) + " and " + number(benefit.with_rms_um, 1) + " µm RMS, largest "
      + number(benefit.without_max_um, 1) + " and " + number(benefit.with_max_um, 1) + " µm."
    : "No position of the machine at present.";
}

/** Offsets of an axis: unit, sent, applied. */
function offsets(status, axis) {
  const rotary = axis in status.correction_arcsec || axis in status.applied_arcsec
    || (status.limits[axis] && status.limits[axis].unit === "arcsec");
  return rotary
    ? ["arcsec", status.correction_arcsec[axis] ?? null, status.applied_arcsec[axis] ?? null]
    : ["um", status.correction_um[axis] ?? null, status.applied_um[axis] ?? null];
}

function axisRow(axis) {
  const id = "axis-" + axis;
  let row = byId(id);
  if (!row) {
    row = element("div", null, "axis");
    row.id = id;
    const figures = element("div");
    const meter = element("meter");
    meter.setAttribute("aria-label", "Axis " + axis.toUpperCase() + ", offset as a share of its limit");
    figures.append(element("span", "–", "value"), element("small", ""), meter);
    const canvas = element("canvas");
    canvas.setAttribute("role", "img");
    row.append(element("b", axis.toUpperCase()), figures, canvas);
    byId("axis-list").append(row);
  }
  return row;
}

function showAxes(status) {
  for (const axis of Object.keys(status.limits)) {
    const row = axisRow(axis);
    const limits = status.limits[axis];
    const [unit, sent, applied] = offsets(status, axis);
    row.querySelector(".value").textContent = number(sent, 1) + " " + micro(unit);
    Object.assign(row.querySelector("meter"), {
      min: 0, max: limits.limit, low: limits.warning, high: limits.limit, optimum: 0, value: Math.abs(sent ?? 0),
    });
    const small = row.querySelector("small");
    small.replaceChildren("applied " + number(applied, 1) + ", limit " + number(limits.limit, 0));
    const marks = [[status.limited, "LIMITED"], [status.warning, "WARNING"], [status.out_of_range, "OUT OF RANGE"]];
    for (const [axes, word] of marks) {
      if (axes.includes(axis)) small.append(" ", element("span", word, "alarm"));
    }
    draw(row.querySelector("canvas"), axis, limits, unit);
  }
}

/** Two minutes of an axis: sent, applied, warning and limit. */
function draw(canvas, axis, limits, unit) {
  const trace = history[axis] || { sent: [], applied: [] };
  const scale = window.devicePixelRatio || 1;
  const width = Math.round(canvas.clientWidth * scale);
  const height = Math.round(canvas.clientHeight * scale);
  if (!width || !height) return;
  if (canvas.width !== width) canvas.width = width;
  if (canvas.height !== height) canvas.height = height;
  const colours = getComputedStyle(document.documentElement);
  const colour = (name) => colours.getPropertyValue(name).trim();
  const known = [...trace.sent, ...trace.applied].filter((v) => v !== null);
  const largest = Math.max(1, ...known.map(Math.abs));
  // the limits are drawn where the offset comes near them
  const top = Math.min(limits.limit, largest * 1.6) * 1.08;
  const context = canvas.getContext("2d");
  context.clearRect(0, 0, width, height);
  context.font = 11 * scale + "px system-ui, sans-serif";
  const label = number(top / 1.08, top < 10 ? 1 : 0) + " " + micro(unit);
  const left = context.measureText("\u2212" + label).width + 6 * scale;
  const y = (v) => height / 2 - (v / top) * (height / 2 - scale);
  const x = (k) => left + (k / (SAMPLES - 1)) * (width - left - scale);
  const line = (v, name, dash) => {
    context.beginPath();
    context.setLineDash(dash);
    context.strokeStyle = colour(name);
    context.lineWidth = scale;
    context.moveTo(left, y(v));
    context.lineTo(width, y(v));
    context.stroke();
  };
  line(0, "--line", []);
  for (const sign of [1, -1]) {
    line(sign * limits.warning, "--warn", [4 * scale, 4 * scale]);
    line(sign * limits.limit, "--bad", []);
  }
  context.fillStyle = colour("--dim");
  context.textBaseline = "top";
  context.fillText("+" + label, 0, scale);
  context.textBaseline = "bottom";
  context.fillText("\u2212" + label, 0, height - scale);
  const curve = (values, name, dash, thick) => {
    context.beginPath();
    context.setLineDash(dash);
    context.strokeStyle = colour(name);
    context.lineWidth = thick * scale;
    let drawing = false;
    values.forEach((value, k) => {
      if (value === null) { drawing = false; return; }
      const at = [x(k + SAMPLES - values.length), y(value)];
      if (drawing) context.lineTo(...at); else context.moveTo(...at);
      drawing = true;
    });
    context.stroke();
  };
  curve(trace.sent, "--sent", [], 2.5);
  curve(trace.applied, "--applied", [5 * scale, 5 * scale], 1.5);
  const last = trace.sent[trace.sent.length - 1];
  canvas.setAttribute("aria-label", "Axis " + axis.toUpperCase() + ", offset over two minutes, now " + number(last, 1) + " "
    + micro(unit) + ", limit " + number(limits.limit, 0));
}

function remember(status) {
  for (const axis of Object.keys(status.limits)) {
    const trace = (history[axis] ||= { sent: [], applied: [] });
    const [, sent, applied] = offsets(status, axis);
    for (const [values, value] of [[trace.sent, sent], [trace.applied, applied]]) {
      values.push(value);
      if (values.length > SAMPLES) values.shift();
    }
  }
}

function showLink(status) {
  const link = status.link;
  const recent = status.recent;
  byId("link-line").textContent = link.up
    ? link.address + (link.tls ? " (TLS)" : "") + ", " + (link.control || "control") + ", up for " + duration(link.since_s)
    : link.address + ", down for " + duration(link.since_s) + (link.error ? ": " + link.error : "");
  const share = (late, all) => (all ? number((100 * late) / all, 2) + " %" : "–");
  const bad = (is) => (is ? "alarm" : "");
  const rows = [
    ["late cycles", share(recent.late_cycles, recent.cycles), share(status.late_cycles, status.cycles), bad(recent.late_share > 0.02)],
    ["skipped", recent.skipped_cycles, status.skipped_cycles, ""],
    ["drop-outs", recent.drop_outs, link.links - (link.up ? 1 : 0), bad(recent.drop_outs > 0)],
    ["age p50", latency(recent.age_us_p50), latency(status.age_us_p50), ""],
    ["age p99", latency(recent.age_us_p99), latency(status.age_us_p99), ""],
    ["round trip p99", latency(recent.roundtrip_us_p99), latency(status.roundtrip_us_p99), ""],
    ["computation p99", latency(recent.compute_us_p99), latency(status.compute_us_p99), ""],
  ];
  byId("link-rows").replaceChildren(...rows.map(([name, now, all, mark]) => {
    const row = element("tr");
    const head = element("th", name);
    head.scope = "row";
    row.append(head, element("td", now, mark), element("td", all));
    return row;
  }));
}

function pairs(list, rows) {
  const made = [];
  for (const [name, value] of rows) {
    if (value === null || value === undefined || value === "") continue;
    made.push(element("dt", name), element("dd", value));
  }
  list.replaceChildren(...made);
}

function showModel(status) {
  const choice = status.model_choice;
  const errors = status.model_errors;
  pairs(byId("model"), [
    ["file", status.model.split("/").pop()],
    ["hash", status.model_hash.slice(0, 16)],
    ["covers", errors.covered + " of " + errors.possible + " error motions"],
    ["in use since", choice.since.replace("T", " ").replace(/\.\d+Z$/, " UTC")],
    ["chosen by", choice.who],
    ["reason", choice.why],
    ["valid until", choice.expiry || "not stated"],
    ["previous", choice.previous && choice.previous.split("/").pop()],
    ["against it", micron(status.hindrances.join("; "))],
    ["notes", choice.notes.join("; ")],
  ]);
}

function showSensors(status) {
  const box = byId("sensors");
  if (!status.sensors.length) {
    box.replaceChildren(element("p", "No sensors are configured; the model is static.", "note"));
    return;
  }
  const table = element("table", null, "left");
  const head = element("tr");
  for (const name of ["sensor", "state", "innovation", "test ratio", "heard"]) {
    const cell = element("th", name);
    cell.scope = "col";
    head.append(cell);
  }
  const thead = element("thead");
  thead.append(head);
  const body = element("tbody");
  for (const sensor of status.sensors) {
    const row = element("tr");
    const name = element("th", sensor.name);
    name.scope = "row";
    const probation = sensor.acquaintance_left ? ", " + sensor.acquaintance_left + " readings of probation left" : "";
    const state = sensor.state + (sensor.code ? " (" + sensor.code + ")" : "") + probation;
    const ratio = sensor.ratio;
    row.append(name, element("td", state, sensor.code ? "alarm" : ""), element("td", number(sensor.innovation, 2)),
      element("td", number(ratio, 2)), element("td", sensor.age_s === null ? "never" : duration(sensor.age_s) + " ago"));
    body.append(row);
  }
  table.append(thead, body);
  const scroll = element("div", null, "scroll");
  scroll.append(table);
  const maps = status.maps.map((map) => element("p", "Map " + map.name + ": " + map.state, "note"));
  box.replaceChildren(scroll, ...maps);
}

function showEvents(status) {
  const key = JSON.stringify(status.events.map((e) => [e.time, e.code, e.count]));
  if (key === lastEvents && byId("events").children.length) return;
  const open = new Set([...document.querySelectorAll("#events details[open]")].map((d) => d.dataset.key));
  const focused = document.activeElement && document.activeElement.closest("#events details");
  const focus = focused ? focused.dataset.key : null;
  lastEvents = key;
  if (!status.events.length) {
    byId("events").replaceChildren(element("p", "Nothing has happened since the start of the daemon.", "note"));
    return;
  }
  byId("events").replaceChildren(...status.events.map((event) => {
    const known = codes.get(event.code) || {};
    const details = element("details");
    details.dataset.key = event.time + event.code;
    details.open = open.has(details.dataset.key);
    const summary = element("summary");
    const time = element("time", event.time.slice(11, 19) + " UTC");
    time.dateTime = event.time;
    summary.append(time, " ", element("span", event.code + " " + event.severity, "code " + event.severity), " ",
      known.text || event.name);
    if (event.numbers) summary.append(" (" + micron(event.numbers) + ")");
    if (event.count > 1) summary.append(" ", element("span", "× " + event.count, "count"));
    const list = element("dl", null, "pairs");
    pairs(list, [["name", event.name], ["cause", known.cause], ["reaction", known.reaction], ["remedy", known.remedy]]);
    details.append(summary, list);
    return details;
  }));
  const again = [...document.querySelectorAll("#events details")].find((d) => d.dataset.key === focus);
  if (again) again.querySelector("summary").focus();
}

function show(status) {
  newest = status;
  showBanner(status);
  showBenefit(status);
  showAxes(status);
  showLink(status);
  showModel(status);
  showSensors(status);
  showEvents(status);
  const rt = status.realtime;
  byId("footer").textContent = "volcompd " + status.version + ", up for " + duration(status.uptime_s) + "; SCHED_FIFO " + rt.fifo
    + ", memory lock " + rt.memory_lock + ". A quality function, not a safety function.";
}

function offline(text) {
  const box = byId("offline");
  box.hidden = !text;
  if (text && box.textContent !== text) box.textContent = text;
  if (text) {
    byId("banner").className = "bad";
    byId("state").textContent = "NO DATA";
    byId("since").textContent = "";
    byId("cause").textContent = "The daemon does not answer.";
    byId("remedy").textContent = "What to do: systemctl status volcompd; without the daemon the control takes its offset out by itself";
    document.title = "NO DATA";
  }
}

let heard = 0;
let missing = false;

function listen() {
  const source = new EventSource("/api/v1/events");
  source.addEventListener("status", async (event) => {
    heard = Date.now();
    if (missing) await load();
    missing = false;
    offline("");
    const status = JSON.parse(event.data);
    remember(status);
    show(status);
  });
  source.addEventListener("error", () => {
    missing = true;
    // a browser gives up after some errors, for example while the port is closed
    if (source.readyState === EventSource.CLOSED) {
      setTimeout(listen, 2000);
    }
  });
}

async function load() {
  try {
    const [list, traces] = await Promise.all(["/api/v1/codes", "/api/v1/history"].map(async (path) => (await fetch(path)).json()));
    codes = new Map(list.map((entry) => [entry.code, entry]));
    history = traces.axes;
  } catch {
    // the events go on without explanations and history
  }
}

setInterval(() => {
  if (heard && Date.now() - heard > 4000) {
    missing = true;
    offline("No data from volcompd for " + duration((Date.now() - heard) / 1000) + "; what is shown below is old.");
  }
}, 1000);
addEventListener("resize", () => newest && showAxes(newest));
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => newest && showAxes(newest));
heard = Date.now();
load().then(listen);
