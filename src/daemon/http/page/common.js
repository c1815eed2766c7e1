// Elements and the form of numbers. All text goes in as text, never as markup.

export const byId = (id) => document.getElementById(id);

/** A new element with text and class. */
export function element(name, text, className) {
  const made = document.createElement(name);
  if (text !== undefined && text !== null) made.textContent = text;
  if (className) made.className = className;
  return made;
}

/** A new element of a drawing with attributes and text. */
export function drawn(name, attributes, text) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  if (text !== undefined) made.textContent = text;
  return made;
}

export const number = (value, digits) =>
  value === null || value === undefined ? "–" : value.toFixed(digits).replace("-", "\u2212").replace(/^\u2212(0\.?0*)$/, "$1");
export const micro = (unit) => (unit === "um" ? "µm" : "″");
export const micron = (text) => text.replace(/(\d) um\b/g, "$1 µm");
export const latency = (us) => (us === null || us === undefined ? "–" : us >= 1000 ? number(us / 1000, 2) + " ms" : number(us, us < 100 ? 1 : 0) + " µs");

export function duration(seconds) {
  const s = Math.max(0, Math.floor(seconds));
  if (s < 60) return s + " s";
  if (s < 3600) return Math.floor(s / 60) + " min " + (s % 60) + " s";
  const h = Math.floor(s / 3600);
  return h < 48 ? h + " h " + Math.floor((s % 3600) / 60) + " min" : Math.floor(h / 24) + " days";
}

/** Fills a list of names and values; empty values are left out. */
export function pairs(list, rows) {
  const made = [];
  for (const [name, value] of rows) {
    if (value === null || value === undefined || value === "") continue;
    made.push(element("dt", name), element("dd", value));
  }
  list.replaceChildren(...made);
}
