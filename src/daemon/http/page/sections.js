// What the status says, section by section.

import { byId, duration, element, latency, micro, micron, number, pairs } from "/common.js";

let codes = new Map();
let announced = "";
let lastEvents = "";

/** The entries of `volcomp explain`. */
export function explain(list) {
  codes = new Map(list.map((entry) => [entry.code, entry]));
  lastEvents = "";
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
  if (status.health.verdict === "warning" && colour !== "bad") colour = "held";
  if (status.health.verdict === "held" && colour === "idle") colour = "held";
  return [word, colour];
}

/** The time of day some seconds ago, with the date where it was not today. */
function clock(secondsAgo) {
  const then = new Date(Date.now() - 1000 * secondsAgo);
  const time = then.toLocaleTimeString("en-GB", { hour: "2-digit", minute: "2-digit" });
  return then.toDateString() === new Date().toDateString() ? time : then.toLocaleDateString("en-CA") + " " + time;
}

export function showBanner(status) {
  const [word, colour] = banner(status);
  const health = status.health;
  byId("banner").className = colour;
  byId("state").textContent = word;
  byId("machine").textContent = status.machine;
  const gain = status.gain !== 1 ? ", gain " + number(100 * status.gain, 0) + " %" : "";
  const fault = status.faults[0];
  const seconds = fault ? fault.age_s : status.state_since_s;
  byId("since").textContent = "since " + clock(seconds) + ", for " + duration(seconds) + gain;
  const code = health.code && !health.cause.startsWith(health.code) ? health.code + " " : "";
  const past = status.recent.warnings.find((warning) => warning.code === health.code && !warning.present);
  const cause = past ? health.cause.replace(/ \(over\)$/, " (" + duration(past.age_s) + " ago, over)") : health.cause;
  byId("cause").textContent = micron(cause ? code + cause : "");
  // also beside a warning: who sees the page for the first time looks for this
  const off = status.state === "off" ? "Compensation is off; Enable, or `volcomp enable`, switches it on. " : "";
  byId("remedy").textContent = off + (health.remedy ? "What to do: " + micron(health.remedy) : "");
  // what the offset does meanwhile, in the words of `volcomp explain`
  const known = health.verdict === "warning" ? undefined : codes.get(health.code);
  byId("reaction").textContent = known ? "What happens: " + micron(known.reaction) : "";
  // the cause above is one of them
  const others = status.recent.warnings.filter((warning) => warning.code !== health.code);
  byId("warnings").replaceChildren(...others.map((warning) => element("li", warning.code + " " + micron(warning.text)
    + (warning.count > 1 ? " × " + warning.count : "") + (warning.present ? "" : " (" + duration(warning.age_s) + " ago, over)"))));
  document.title = word + " · " + status.machine;
  const said = word + (health.code ? ", " + health.code : health.cause ? ", " + health.cause : "");
  if (said !== announced) byId("announce").textContent = announced = said;
}

export function showBenefit(status) {
  const benefit = status.benefit;
  byId("without").textContent = benefit ? number(benefit.without_um, 1) + " µm" : "–";
  byId("with").textContent = benefit ? number(benefit.with_um, 1) + " µm" : "–";
  byId("benefit-hour").textContent = benefit
    ? "Last hour: " + number(benefit.without_rms_um, 1) + " and " + number(benefit.with_rms_um, 1) + " µm RMS, largest "
      + number(benefit.without_max_um, 1) + " and " + number(benefit.with_max_um, 1) + " µm."
    : "No position of the machine at present.";
}

/** The last measurement without and with compensation; without one, what the model itself was measured with. */
export function showVerification(found, status) {
  const v = found && found.verification;
  const choice = status.model_choice;
  if (v) {
    const unit = micro(v.unit);
    const band = v.reduction_u95 === null ? "" : " ± " + number(100 * v.reduction_u95, 1);
    const share = v.reduction === null ? "" : ", " + number(Math.abs(100 * v.reduction), 1) + band + (v.reduction < 0 ? " % more" : " % less");
    byId("verification").textContent = v.date + ", " + v.instrument + ": " + v.title + ", RMS " + number(v.rms[0], 1) + " → "
      + number(v.rms[1], 1) + " " + unit + share;
    byId("verification-note").textContent = v.model_hash === null ? "Which model compensated the machine then is not stated."
      : v.model_hash === status.model_hash ? "Verified with the model in use."
        : "Verified with another model (" + v.model_hash.slice(0, 12) + "): verify again.";
    return;
  }
  byId("verification").textContent = found && found.problem ? "Cannot be read: " + found.problem : "None is stated.";
  const measured = [choice.date, choice.instruments.join(", ")].filter((word) => word).join(", ");
  byId("verification-note").textContent = (measured ? "The model was measured: " + measured + ". " : "")
    + "volcomp verify --record writes a verification for this page.";
}

/** What shadow mode has found, per axis. */
export function showShadow(status) {
  const box = byId("shadow");
  const shadow = status.shadow;
  box.hidden = !shadow;
  if (!shadow) return;
  const axes = Object.entries(shadow.axes).map(([axis, a]) => axis.toUpperCase() + " " + number(a.before_rms, 1) + " → "
    + number(a.after_rms, 1) + " " + micro(a.unit) + " RMS");
  box.textContent = "Shadow mode, nothing is applied: would be " + shadow.state + "; " + axes.join(", ") + "; "
    + shadow.faults + " faults, " + shadow.interruptions + " holds.";
}

export function showLink(status) {
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

export function showModel(status) {
  const choice = status.model_choice;
  const errors = status.model_errors;
  const window = choice.temperature_degc;
  const told = status.temperature_degc;
  pairs(byId("model"), [
    ["file", status.model.split("/").pop()],
    ["hash", status.model_hash.slice(0, 16)],
    ["covers", errors.covered + " of " + errors.possible + " error motions" + (errors.symbols.length ? ": " + errors.symbols.join(" ") : "")],
    ["measured", [choice.date, choice.instruments.join(", ")].filter((word) => word).join(", ") || "not stated"],
    ["in use since", choice.since.replace("T", " ").replace(/\.\d+Z$/, " UTC")],
    ["chosen by", choice.who],
    ["reason", choice.why],
    ["valid until", choice.expiry || "not stated"],
    ["temperatures", (window ? window.map((t) => number(t, 1)).join(" to ") + " °C" : "any")
      + (told === null ? "" : ", told " + number(told, 1) + " °C")],
    ["gain", number(100 * status.gain, 0) + " %"],
    ["previous", choice.previous && choice.previous.split("/").pop()],
    ["against it", micron(status.hindrances.join("; "))],
    ["notes", micron(choice.notes.join("; "))],
  ]);
}

export function showSensors(status) {
  const box = byId("sensors");
  const beside = [
    ...status.maps.map((map) => "Map " + map.name + ": " + map.state + (map.limited ? ", limited" : "") + ", weight " + number(map.weight, 2)),
    ...status.growths.map((g) => "Thermal displacement " + g.name + ": " + g.state + (g.code ? " (" + g.code + ")" : "") + ", "
      + number(g.value, 1) + " " + g.unit.replace("um", "µm")),
    ...status.sensor_notes.map(micron),
  ].map((words) => element("p", words, "note"));
  if (!status.sensors.length) {
    box.replaceChildren(element("p", "No sensors are configured; the model is static.", "note"), ...beside);
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
    const state = element("td", sensor.state + (sensor.code ? " (" + sensor.code + ")" : ""), sensor.code ? "alarm" : "");
    if (sensor.acquaintance_left) state.append(element("small", "probation: " + sensor.acquaintance_left + " readings left"));
    if (sensor.rests_s) state.append(element("small", "rests for " + duration(sensor.rests_s)));
    const ratio = sensor.ratio;
    row.append(name, state, element("td", number(sensor.innovation, 2)),
      element("td", number(ratio, 2)), element("td", sensor.age_s === null ? "never" : duration(sensor.age_s) + " ago"));
    body.append(row);
  }
  table.append(thead, body);
  const scroll = element("div", null, "scroll");
  scroll.append(table);
  box.replaceChildren(scroll, ...beside);
}

export function showEvents(status) {
  const lasting = new Set([...status.faults, ...status.recent.warnings.filter((w) => w.present)].map((w) => w.code));
  const over = (event) => event.severity !== "notice" && !lasting.has(event.code);
  const key = JSON.stringify(status.events.map((e) => [e.time, e.last_time, e.code, e.count, over(e)]));
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
    const last = event.last_time || event.time;
    const clock = (text) => text.slice(11, 19);
    const span = clock(last) === clock(event.time) ? clock(last) : clock(event.time) + " to " + clock(last);
    const time = element("time", span + " UTC");
    time.dateTime = event.time;
    summary.append(time, " ", element("span", event.code + " " + event.severity, "code " + event.severity), " ",
      known.text || event.name);
    if (event.numbers) summary.append(" (" + micron(event.numbers) + ")");
    if (over(event)) summary.append(" ", element("span", "over", "count"));
    if (event.count > 1) summary.append(" ", element("span", "× " + event.count, "count"));
    const list = element("dl", null, "pairs");
    pairs(list, [["name", event.name], ["cause", known.cause], ["reaction", known.reaction], ["remedy", known.remedy]]);
    details.append(summary, list);
    return details;
  }));
  const again = [...document.querySelectorAll("#events details")].find((d) => d.dataset.key === focus);
  if (again) again.querySelector("summary").focus();
}

export function showFooter(status) {
  const rt = status.realtime;
  byId("footer").textContent = "volcompd " + status.version + ", up for " + duration(status.uptime_s) + "; SCHED_FIFO " + rt.fifo
    + ", memory lock " + rt.memory_lock + ". A quality function, not a safety function.";
}
