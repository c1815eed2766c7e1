// The picture of what another model changes: each error that differs, in use (grey) and new.

import { drawn, element, micro, number } from "/common.js";

const WIDTH = 300;
const HEIGHT = 130;
const LEFT = 46;
const BELOW = 20;

/** The part of a path that is not of this daemon. */
const short = (path) => path.split("/").pop();

function curves(error) {
  const all = [error.old, error.new, error.old_reverse, error.new_reverse].filter((c) => c).flat().concat(0);
  const [low, high] = [Math.min(...all), Math.max(...all)];
  const room = Math.max(high - low, 1e-9) * 0.08;
  const positions = error.positions;
  const [from, to] = [positions[0], positions[positions.length - 1]];
  const x = (q) => LEFT + ((q - from) / (to - from || 1)) * (WIDTH - LEFT - 6);
  const y = (v) => HEIGHT - BELOW - ((v - low + room) / (high - low + 2 * room)) * (HEIGHT - BELOW - 8);
  const svg = drawn("svg", {
    viewBox: "0 0 " + WIDTH + " " + HEIGHT, role: "img",
    "aria-label": error.symbol + ": largest difference " + number(error.largest, 2) + " " + micro(error.unit),
  });
  const line = (values, name) => {
    const d = values.map((v, k) => (k ? "L" : "M") + x(positions[k]).toFixed(1) + " " + y(v).toFixed(1)).join("");
    svg.append(drawn("path", { d, class: name }));
  };
  const text = (left, top, anchor, words) => svg.append(drawn("text", { x: left, y: top, "text-anchor": anchor }, words));
  svg.append(drawn("path", { d: "M" + LEFT + " " + y(0).toFixed(1) + "H" + (WIDTH - 6), class: "zero" }));
  line(error.old, "old");
  if (error.old_reverse) line(error.old_reverse, "old reverse");
  line(error.new, "new");
  if (error.new_reverse) line(error.new_reverse, "new reverse");
  text(LEFT - 4, y(high) + 4, "end", number(high, 1));
  text(LEFT - 4, y(low) + 4, "end", number(low, 1));
  text(LEFT, HEIGHT - 5, "start", number(from, 0));
  text(WIDTH - 6, HEIGHT - 5, "end", number(to, 0) + " " + (error.position_unit === "mm" ? "mm" : "°"));
  return svg;
}

/** The elements of the picture. */
export function picture(comparison) {
  const { change, changes, errors } = comparison;
  const largest = change.largest_um === null ? "cannot be said: the models have different axes"
    : number(change.largest_um, 1) + " µm, " + number(change.largest_arcsec, 1) + "″";
  const parts = [
    element("p", short(comparison.origin) + ", " + change.new_hash.slice(0, 12) + ". Largest change in the working volume: " + largest + "."),
  ];
  if (changes.length) parts.push(element("p", "Changed beside the errors: " + changes.join("; ") + ".", "alarm"));
  if (!errors.length) parts.push(element("p", changes.length ? "No error differs." : "The same model."));
  const constants = errors.filter((e) => !e.positions.length);
  if (constants.length) {
    parts.push(element("p", constants.map((e) => e.symbol + " " + number(e.old[0], 2) + " → " + number(e.new[0], 2) + " "
      + micro(e.unit)).join("; ")));
  }
  const figures = element("div", null, "figures");
  for (const error of errors.filter((e) => e.positions.length)) {
    const figure = element("figure");
    figure.append(element("figcaption", error.symbol + " / " + micro(error.unit) + ", differs by up to " + number(Math.abs(error.largest), 2)), curves(error));
    figures.append(figure);
  }
  if (figures.children.length) {
    const legend = element("p", null, "legend note");
    for (const [name, words] of [["old", "in use"], ["sent", "new"]]) {
      const item = element("span");
      item.append(element("i", null, "key " + name), " " + words);
      legend.append(item);
    }
    legend.append(element("span", "dashed: travel towards minus, where it differs"));
    parts.push(figures, legend);
  }
  return parts;
}
