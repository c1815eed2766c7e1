// Runs the page's showBanner and showEvents on statuses from stdin, with as much of a document as they use.
const made = () => ({
  children: [], dataset: {}, className: "",
  append(...parts) { this.children.push(...parts); },
  replaceChildren(...parts) { this.children = parts; },
});
const text = (node) => typeof node === "string" ? node : (node.textContent ?? "") + node.children.map(text).join("");
const elements = new Map();
globalThis.document = {
  title: "", activeElement: null,
  createElement: made,
  querySelectorAll: () => [],
  getElementById: (id) => elements.get(id) ?? elements.set(id, made()).get(id),
};
const { explain, showBanner, showEvents } = await import("./sections.js");
const chunks = [];
for await (const chunk of process.stdin) chunks.push(chunk);
const { codes, statuses } = JSON.parse(Buffer.concat(chunks));
explain(codes);
console.log(JSON.stringify(statuses.map((status) => {
  showBanner(status);
  showEvents(status);
  const shown = Object.fromEntries(["state", "cause", "remedy", "announce"].map((id) => [id, text(document.getElementById(id))]));
  const [warnings, events] = ["warnings", "events"].map((id) => document.getElementById(id).children.map(text));
  return { ...shown, colour: document.getElementById("banner").className, warnings, events };
})));
