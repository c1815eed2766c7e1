// Shows the status that the daemon sends once a second.

import { byId, duration } from "/common.js";
import { learnAbout, showCommands } from "/commands.js";
import {
  explain, showBanner, showBenefit, showEvents, showFooter, showLink, showModel, showSensors, showShadow, showVerification,
} from "/sections.js";
import { recall, remember, showAxes } from "/traces.js";
import { showVolume } from "/volume.js";

/** Statuses between two looks at the last verification. */
const VERIFICATION_EVERY = 15;
let newest = null;
let verification = null;
let seen = 0;
let heard = Date.now();
let missing = false;

const json = async (path) => (await fetch(path)).json();

function show(status) {
  // another version of the daemon brings its own page
  if (newest && newest.version !== status.version) location.reload();
  newest = status;
  showBanner(status);
  showBenefit(status);
  showVerification(verification, status);
  showCommands(status);
  showShadow(status);
  showAxes(status);
  showVolume(status);
  showLink(status);
  showModel(status);
  showSensors(status);
  showEvents(status);
  showFooter(status);
}

function offline(text) {
  const box = byId("offline");
  box.hidden = !text;
  if (text && box.textContent !== text) box.textContent = text;
  if (text) {
    byId("banner").className = "bad";
    byId("state").textContent = "NO DATA";
    byId("since").textContent = "";
    byId("warnings").replaceChildren();
    byId("cause").textContent = "The daemon does not answer.";
    byId("reaction").textContent = "What happens: without the daemon the control takes its offset out by itself";
    byId("remedy").textContent = "What to do: systemctl status volcompd";
    document.title = "NO DATA";
  }
}

async function lookAtVerification() {
  try {
    verification = await json("/api/v1/verification");
  } catch {
    // the one known stays
  }
}

function listen() {
  const source = new EventSource("/api/v1/events");
  source.addEventListener("status", async (event) => {
    heard = Date.now();
    if (missing) await load();
    missing = false;
    offline("");
    if (seen++ % VERIFICATION_EVERY === 0) lookAtVerification();
    const status = JSON.parse(event.data);
    remember(status);
    show(status);
  });
  source.addEventListener("error", () => {
    missing = true;
    // a browser gives up after some errors, for example while the port is closed
    if (source.readyState === EventSource.CLOSED) setTimeout(listen, 2000);
  });
}

async function load() {
  seen = 0;
  try {
    const [list, traces, about] = await Promise.all(["/api/v1/codes", "/api/v1/history", "/api/v1/about"].map(json));
    explain(list);
    recall(traces.axes);
    learnAbout(about);
  } catch {
    // the events go on without explanations and history
  }
}

setInterval(() => {
  if (Date.now() - heard > 4000) {
    missing = true;
    offline("No data from volcompd for " + duration((Date.now() - heard) / 1000) + "; what is shown below is old.");
  }
}, 1000);
addEventListener("resize", () => newest && showAxes(newest));
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => newest && showAxes(newest));
load().then(listen);
