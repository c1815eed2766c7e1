// Offsets of the axes: sent and applied over two minutes, against warning and limit. Drawn by uPlot.

import { byId, element, micro, number } from "/common.js";

const SAMPLES = 120;
const HEIGHT = 104;
const SECONDS = Array.from({ length: SAMPLES }, (_, k) => k - SAMPLES + 1);
const plots = new Map();
let history = {};

const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

/** Offsets of an axis: unit, sent, applied. */
function offsets(status, axis) {
  const rotary = axis in status.correction_arcsec || axis in status.applied_arcsec
    || (status.limits[axis] && status.limits[axis].unit === "arcsec");
  return rotary
    ? ["arcsec", status.correction_arcsec[axis] ?? null, status.applied_arcsec[axis] ?? null]
    : ["um", status.correction_um[axis] ?? null, status.applied_um[axis] ?? null];
}

/** Takes the history of the daemon in place of what was seen. */
export function recall(axes) {
  history = axes;
}

/** Takes one status a second. */
export function remember(status) {
  for (const axis of Object.keys(status.limits)) {
    const trace = (history[axis] ||= { sent: [], applied: [] });
    const [, sent, applied] = offsets(status, axis);
    for (const [values, value] of [[trace.sent, sent], [trace.applied, applied]]) {
      values.push(value);
      if (values.length > SAMPLES) values.shift();
    }
  }
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
    const plot = element("div", null, "plot");
    plot.setAttribute("role", "img");
    row.append(element("b", axis.toUpperCase()), figures, plot);
    byId("axis-list").append(row);
  }
  return row;
}

/** The plot of an axis in its row. */
function plotOf(axis, box) {
  let plot = plots.get(axis);
  if (plot) return plot;
  const width = box.clientWidth;
  if (!width) return null;
  plot = { top: 1, warning: 1, limit: 1 };
  const line = (u, value, stroke, dash) => {
    if (Math.abs(value) > plot.top) return;
    const context = u.ctx;
    const y = Math.round(u.valToPos(value, "y", true));
    context.save();
    context.strokeStyle = stroke;
    context.lineWidth = devicePixelRatio;
    context.setLineDash(dash.map((d) => d * devicePixelRatio));
    context.beginPath();
    context.moveTo(u.bbox.left, y);
    context.lineTo(u.bbox.left + u.bbox.width, y);
    context.stroke();
    context.restore();
  };
  const grid = { stroke: () => colour("--line"), width: 1 };
  const axisStyle = { stroke: () => colour("--dim"), font: "11px system-ui, sans-serif", grid, ticks: { show: false } };
  plot.chart = new uPlot({
    width, height: HEIGHT, legend: { show: false }, cursor: { show: false }, padding: [6, 16, 0, 0],
    scales: { x: { time: false, range: [1 - SAMPLES, 0] }, y: { range: () => [-plot.top, plot.top] } },
    axes: [
      { ...axisStyle, size: 18, gap: 2, splits: () => [-119, -60, 0], values: () => ["−2 min", "−1 min", "now"] },
      { ...axisStyle, size: 46, gap: 4, space: 22, values: (_, all) => all.map((v) => number(v, Math.abs(plot.top) < 3 ? 1 : 0)) },
    ],
    series: [
      {},
      { stroke: () => colour("--sent"), width: 2.5, points: { show: false } },
      { stroke: () => colour("--applied"), width: 1.5, dash: [5, 5], points: { show: false } },
    ],
    hooks: {
      drawAxes: [(u) => {
        for (const sign of [1, -1]) {
          line(u, sign * plot.warning, colour("--warn"), [4, 4]);
          line(u, sign * plot.limit, colour("--bad"), []);
        }
      }],
    },
  }, [SECONDS, SECONDS.map(() => null), SECONDS.map(() => null)], box);
  plots.set(axis, plot);
  return plot;
}

function draw(box, axis, limits, unit) {
  const trace = history[axis] || { sent: [], applied: [] };
  const plot = plotOf(axis, box);
  if (!plot) return;
  const known = [...trace.sent, ...trace.applied].filter((v) => v !== null);
  const largest = Math.max(1, ...known.map(Math.abs));
  // the limits are drawn where the offset comes near them
  plot.top = Math.min(limits.limit, largest * 1.6) * 1.08;
  [plot.warning, plot.limit] = [limits.warning, limits.limit];
  const padded = (values) => [...Array(SAMPLES - values.length).fill(null), ...values];
  if (plot.chart.width !== box.clientWidth) plot.chart.setSize({ width: box.clientWidth, height: HEIGHT });
  plot.chart.setData([SECONDS, padded(trace.sent), padded(trace.applied)]);
  const last = trace.sent[trace.sent.length - 1];
  box.setAttribute("aria-label", "Axis " + axis.toUpperCase() + ", offset over two minutes, now " + number(last, 1) + " "
    + micro(unit) + ", between " + number(known.length ? Math.min(...known) : null, 1) + " and "
    + number(known.length ? Math.max(...known) : null, 1) + ", limit " + number(limits.limit, 0));
}

export function showAxes(status) {
  for (const axis of Object.keys(status.limits)) {
    const row = axisRow(axis);
    const limits = status.limits[axis];
    const [unit, sent, applied] = offsets(status, axis);
    row.querySelector(".value").textContent = number(sent, 1) + " " + micro(unit);
    Object.assign(row.querySelector("meter"), {
      min: 0, max: limits.limit, low: limits.warning, high: limits.limit, optimum: 0, value: Math.abs(sent ?? 0),
    });
    const small = row.querySelector("small");
    small.replaceChildren("applied " + number(applied, 1) + ", warning " + number(limits.warning, 0) + ", limit " + number(limits.limit, 0)
      + " " + micro(unit));
    const marks = [[status.limited, "LIMITED"], [status.lagging, "BEHIND"], [status.warning, "WARNING"], [status.out_of_range, "OUT OF RANGE"]];
    for (const [axes, word] of marks) {
      if (axes.includes(axis)) small.append(" ", element("span", word, "alarm"));
    }
    draw(row.querySelector(".plot"), axis, limits, unit);
  }
}
