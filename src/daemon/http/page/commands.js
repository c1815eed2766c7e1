// Commands: enable, disable, gain, shadow, clear fault, load and rollback, each with a reason for the audit log.
//
// The token stays in sessionStorage, which ends with the tab; it goes to the daemon in a header only.

import { byId, element, micron, number } from "/common.js";
import { picture } from "/difference.js";

const TOKEN = "volcomp-token";
const NAME = "volcomp-name";
let allowed = false;
let status = null;
let order = null;
let opener = null;

/** What each command asks, and the words of its dialog. */
const COMMANDS = {
  enable: { title: "Enable compensation", text: "The correction is ramped in as soon as the machine is ready.", go: "Enable" },
  disable: { title: "Disable compensation", text: "The offset is ramped out, and compensation stays off.", go: "Disable" },
  "clear-fault": { title: "Clear the fault", text: "Only once its cause is gone. Compensation stays off until it is enabled.", go: "Clear fault" },
  shadow: { title: "Shadow mode", text: "Works out what compensation would do and scores it; nothing is applied.", go: "Start shadow mode" },
  gain: { title: "Gain", text: "The offset goes to this share of the correction over the ramp.", go: "Set gain" },
  load: { title: "Load a model", text: "The model is compared with the one in use first; nothing changes until you load it.", go: "Load" },
  rollback: { title: "Roll back to the model before", text: "A second time undoes it.", go: "Roll back" },
};

const token = () => sessionStorage.getItem(TOKEN);

/** Sends a request; the answer of the daemon, or an error in words. */
async function send(ask, key = token()) {
  let response;
  try {
    response = await fetch("/api/v1/command", {
      method: "POST",
      headers: { Authorization: "Bearer " + key, "Content-Type": "application/json" },
      body: JSON.stringify(ask),
    });
  } catch {
    return { ok: false, error: "the daemon does not answer" };
  }
  if (response.status === 401) lock();
  try {
    return await response.json();
  } catch {
    return { ok: false, error: "no answer of a volcompd (" + response.status + ")" };
  }
}

/** Whether the daemon takes commands. */
export function learnAbout(about) {
  allowed = about.commands;
  showLock();
}

function showLock() {
  byId("read-only").hidden = allowed;
  byId("unlock").hidden = !allowed || token() !== null;
  byId("buttons").hidden = !allowed || token() === null;
}

function lock() {
  sessionStorage.removeItem(TOKEN);
  showLock();
}

/** Offers what makes sense in this state. */
export function showCommands(newest) {
  status = newest;
  const faulted = newest.faults.length > 0;
  const of = {
    enable: !newest.enabled && !faulted,
    disable: newest.enabled || newest.shadow !== null,
    "clear-fault": faulted,
    shadow: !newest.enabled && newest.shadow === null,
    gain: true,
    load: true,
    rollback: newest.model_choice.previous !== null,
  };
  for (const button of document.querySelectorAll("[data-command]")) {
    // a button that has the focus keeps it: a screen reader would lose its place
    button.setAttribute("aria-disabled", String(!of[button.dataset.command]));
  }
}

function refuse(text) {
  byId("problem").textContent = micron(text);
}

/** What the form would send; null while something is missing. */
function ask() {
  const { command } = order;
  const made = { command, reason: byId("reason").value.trim() };
  const name = byId("name").value.trim();
  if (!made.reason) return [null, "A reason is needed, for the audit log.", "reason"];
  if (name) made.name = name;
  if (command === "shadow") Object.assign(made, { command: "enable", shadow: true });
  if (command === "gain") {
    const percent = byId("gain").valueAsNumber;
    if (!(percent >= 0 && percent <= 100)) return [null, "The gain is a number from 0 to 100 %.", "gain"];
    made.gain = percent / 100;
  }
  if (command === "load" || command === "rollback") {
    if (!order.comparison) return [null, command === "load" ? "Choose a model file first." : "There is nothing to go back to.", "file"];
    if (command === "load") made.model = order.model;
    made.old_hash = order.comparison.change.old_hash;
    if (command === "rollback") made.new_hash = order.comparison.change.new_hash;
    if (order.comparison.confirmation) {
      if (!name) return [null, "This change needs the name of the person who confirms it.", "name"];
      if (command === "load") made.confirm = name;
    }
  }
  return [made, "", ""];
}

/** Has the daemon compare a model with the one in use, and shows the picture. */
async function compare(model) {
  const box = byId("difference");
  const of = order;
  of.comparison = null;
  box.replaceChildren(element("p", "Comparing over the working volume …"));
  refuse("");
  byId("confirm-text").textContent = "";
  const answer = await send(model ? { command: "compare", model } : { command: "compare" });
  // closed, or another file was chosen since
  if (order !== of || of.model !== model) return;
  box.replaceChildren();
  if (!answer.ok) {
    refuse(answer.error);
    return;
  }
  of.comparison = answer.comparison;
  box.replaceChildren(...picture(answer.comparison));
  const { confirmation, refusal } = answer.comparison;
  byId("confirm-text").textContent = micron([
    confirmation ? "A large change: " + confirmation + ". Your name and the reason confirm it." : "",
    refusal ? "Would be refused now: " + refusal : "",
  ].filter((text) => text).join(" "));
}

function open(command, button) {
  const words = COMMANDS[command];
  order = { command, model: null, comparison: null };
  opener = button;
  byId("dialog-title").textContent = words.title;
  byId("dialog-text").textContent = words.text;
  byId("go").textContent = words.go;
  byId("file-row").hidden = command !== "load";
  byId("gain-row").hidden = command !== "gain";
  byId("difference").hidden = command !== "load" && command !== "rollback";
  byId("difference").replaceChildren();
  byId("confirm-text").textContent = "";
  byId("file").value = "";
  byId("reason").value = "";
  byId("name").value = sessionStorage.getItem(NAME) || "";
  byId("gain").value = number(100 * status.gain, 0);
  refuse("");
  byId("dialog").showModal();
  byId(command === "load" ? "file" : command === "gain" ? "gain" : "reason").focus();
  if (command === "rollback") compare(null);
}

function close() {
  order = null;
  byId("dialog").close();
}

async function submit(event) {
  event.preventDefault();
  const [made, problem, field] = ask();
  if (!made) {
    refuse(problem);
    byId(field).focus();
    return;
  }
  sessionStorage.setItem(NAME, byId("name").value.trim());
  const { title } = COMMANDS[order.command];
  byId("go").disabled = true;
  const answer = await send(made);
  byId("go").disabled = false;
  if (!answer.ok) {
    refuse(answer.error);
    return;
  }
  const notes = (answer.notes || []).map((note) => " Note: " + note + ".").join("");
  byId("done").textContent = micron(title + ": done, state " + answer.state + "." + notes);
  close();
}

async function unlock(event) {
  event.preventDefault();
  const field = byId("token");
  const key = field.value.trim();
  field.value = "";
  // a header takes no other characters
  const answer = /^[\x21-\x7e]+$/.test(key) ? await send({ command: "status" }, key) : { ok: false, error: "this is not the token" };
  if (answer.ok) {
    sessionStorage.setItem(TOKEN, key);
    byId("done").textContent = "Unlocked.";
    showLock();
    document.querySelector("[data-command]").focus();
  } else {
    byId("done").textContent = "Not unlocked: " + answer.error + ".";
    field.focus();
  }
}

byId("unlock").addEventListener("submit", unlock);
byId("order").addEventListener("submit", submit);
byId("cancel").addEventListener("click", close);
byId("dialog").addEventListener("close", () => {
  // the event of a dialog that has been opened again since
  if (byId("dialog").open) return;
  order = null;
  if (opener && !byId("buttons").hidden) opener.focus();
});
byId("lock").addEventListener("click", () => {
  lock();
  byId("done").textContent = "Locked.";
  byId("token").focus();
});
byId("buttons").addEventListener("click", (event) => {
  const button = event.target.closest("[data-command]");
  if (button && status && button.getAttribute("aria-disabled") !== "true") open(button.dataset.command, button);
});
byId("file").addEventListener("change", async () => {
  const file = byId("file").files[0];
  if (!file || !order) return;
  if (file.size > 4 * 1024 * 1024) {
    refuse("The file has " + file.size + " bytes; the largest model has 4 MiB.");
    return;
  }
  const of = order;
  of.model = { origin: file.name, text: await file.text() };
  if (order === of) compare(of.model);
});
