"use strict";
// Controls, drawing and words. The experiment itself is in the engine above.

const byId = (id) => document.getElementById(id);
const make = (tag, attributes = {}, ...children) => {
  const one = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) if (value !== undefined) one.setAttribute(name, value);
  one.append(...children);
  return one;
};
// Colours are those of the style sheet, light or dark.
const STROKES = {
  controller_1: ["--blue", []],
  controller_2: ["--red", [7, 3]],
  controller_3: ["--gold", [2, 2]],
  controller_1_payload: ["--ink", [9, 2, 2, 2]],
};
const SPARES = [["--blue", [3, 3]], ["--red", [10, 3]], ["--soft", [12, 4]], ["--green", []], ["--ink", [1, 3]]];
const REFERENCE = ["--grey", []];
const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name);
const OBSERVED = { ok: "stable", ringing: "oscillating", diverged: "diverged", unresolved: "not computed" };

const UNITS = { "1": "", "s-1": "s⁻¹", "kg m2": "kg m²", "N m-1": "N/m", deg: "°" };

// Δ alone is understood in the unit that is chosen for it.
const inDegrees = ({ key }) => key === "control.gains.Delta" && state.get("control.readings.Delta_unit") === "deg";
const unitOf = (one) => (inDegrees(one) ? UNITS.deg : UNITS[one.unit] ?? one.unit);

// Base64 of gzipped JSON.
async function unpacked(text) {
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"))).json();
}

let PRESETS = [];
let preset, state, baseline = null, results = null;

// ---- State: values by the controls' names, in the address too ---------------------------------------------------

function take(which, values = {}) {
  preset = which;
  state = new Map([...preset.controls, ...preset.choices].map((one) => [one.id, one.value]));
  for (const [id, value] of Object.entries(values)) state.set(id, value);
  baseline = results = null;
  document.documentElement.dataset.exact = "";
  showPreset();
}

const all = () => [...preset.controls, ...preset.choices];
const isMoved = (one) => state.get(one.id) !== one.value;
const moved = () => all().filter(isMoved);

// A step of its own goes back by the browser's button to what was there before.
function writeAddress(step = false) {
  const parts = moved().map((one) => `${one.id}=${encodeURIComponent(state.get(one.id))}`);
  const address = `#${[preset.name, ...parts].join("&")}`;
  if (address === location.hash) return;
  if (step) history.pushState(null, "", address);
  else history.replaceState(null, "", address);
}

function readAddress() {
  const [name, ...parts] = location.hash.replace(/^#/, "").split("&");
  const problems = [], values = {};
  const found = PRESETS.find((one) => one.name === name), chosen = found || PRESETS[0];
  if (!found && name) problems.push(`The address names the preset “${readable(name)}”, which this page does not have.`);
  for (const part of parts) {
    const [id, raw = ""] = part.split("="), text = readable(raw);
    const control = chosen.controls.find((one) => one.id === id), choice = chosen.choices.find((one) => one.id === id);
    const wrong = control ? unfit(control, text, chosen.L) : choice && !choice.values.includes(text) ? "is not a choice" : "";
    if (!control && !choice) problems.push(`The address sets “${readable(id)}”, which this page does not have.`);
    else if (wrong) problems.push(`The address sets ${(control || choice).label} to “${text}”, which ${wrong}.`);
    else values[id] = control ? Number(text) : text;
  }
  take(chosen, values);
  byId("problem").textContent = problems.length ? `${problems.join(" ")} The rest is shown.` : "";
}

function readable(text) {
  try {
    return decodeURIComponent(text).slice(0, 80);
  } catch {
    return text.slice(0, 80);
  }
}

// Why a control cannot have a value, in words; empty if it can.
function unfit(control, text, L) {
  const value = Number(text), { least, most, open_least, open_most } = control;
  if (String(text).trim() === "" || !Number.isFinite(value)) return "is not a number";
  if (value < least || (open_least && value === least)) return `must be ${open_least ? "above" : "at least"} ${least}`;
  if (value > most || (open_most && value === most)) return `must be ${open_most ? "below" : "at most"} ${most}`;
  if (control.unit === "s" && Math.abs(value / L - Math.round(value / L)) > 1e-6) return `must be a multiple of the sampling period, ${L} s`;
  return "";
}

// ---- Controls ---------------------------------------------------------------------------------------------------

function showPreset() {
  for (const input of byId("presets").querySelectorAll("input")) input.checked = input.value === preset.name;
  byId("about").replaceChildren(preset.about, ...preset.notes.map((note) => ` ${note}`));
  const open = new Set([...document.querySelectorAll("#controls details[open]")].map((one) => one.dataset.group));
  const first = !document.querySelector("#controls details");
  byId("controls").replaceChildren(
    ...preset.groups.map((group, k) => {
      const box = make("details", { "data-group": group }, make("summary", {}, group));
      if (open.has(group) || (first && k < 2) || moved().some((one) => one.group === group)) box.open = true;
      for (const choice of preset.choices) if (choice.group === group) box.append(choiceField(choice));
      const fields = preset.controls.filter((one) => one.group === group);
      for (const label of new Set(fields.map((one) => one.label))) {
        box.append(numberField(fields.filter((one) => one.label === label)));
      }
      return box;
    }),
  );
  byId("tries").replaceChildren(make("span", {}, "Try: "), ...trials().filter(changesSomething).map(tryButton), allBack());
  buildFigures();
  compute(true);
}

function numberField(fields) {
  const { label, origin, source, help } = fields[0], from = make("span", { class: "from", title: source });
  from.show = () => {
    const words = unitOf(fields[0]);
    from.textContent = `${words}${words && ", "}${origin}`;
  };
  from.show();
  const box = make("fieldset", {}, make("legend", {}, label, " ", from));
  if (help) box.append(make("p", { class: "help" }, help));
  for (const control of fields) box.append(numberRow(control));
  return box;
}

function numberRow(control) {
  const id = `c-${control.id}`, name = `${control.label}${control.part ? `, ${control.part}` : ""}`;
  const number = make("input", { type: "number", id, min: control.least === 0 ? 0 : undefined, max: control.most });
  const stops = stopsOf(control, preset.L);
  const range = make("input", { type: "range", min: 0, max: stops.length - 1, step: 1, "aria-label": `${name}, slider` });
  const reset = make("button", { type: "button", class: "reset", "aria-label": `Reset ${name} to ${control.value}` }, "↺");
  const row = make("div", { class: "row", "data-id": control.id }, make("label", { for: id }, control.part || "value"), range, number, reset);
  const show = () => {
    const value = state.get(control.id), unit = unitOf(control);
    number.value = shorter(value);
    // What an arrow key adds: as much as the slider, or a tenth of the first digit.
    number.step = control.step || `1e${Math.floor(Math.log10(value)) - 1}`;
    number.setAttribute("aria-label", name + (unit && `, ${unit}`));
    range.value = nearest(stops, value);
    range.setAttribute("aria-valuetext", `${shorter(value)} ${unit}`);
    row.classList.toggle("moved", isMoved(control));
  };
  const set = (value, exact) => {
    state.set(control.id, value);
    byId("problem").textContent = "";
    show();
    changed(exact);
  };
  range.addEventListener("input", () => set(stops[range.value], false));
  range.addEventListener("change", () => changed(true));
  number.addEventListener("change", () => {
    const wrong = unfit(control, number.value, preset.L);
    byId("problem").textContent = wrong ? `${name}: ${number.value || "nothing"} ${wrong}. It stays ${shorter(state.get(control.id))}.` : "";
    if (wrong) show();
    else set(Number(number.value), true);
  });
  reset.addEventListener("click", () => {
    set(control.value, true);
    number.focus();
  });
  row.show = show;
  show();
  return row;
}

function choiceField(choice) {
  const select = make("select", { "aria-label": choice.label });
  for (const [k, value] of choice.values.entries()) select.append(make("option", { value }, choice.words[k]));
  const reset = make("button", { type: "button", class: "reset", "aria-label": `Reset ${choice.label}` }, "↺");
  const row = make("div", { class: "row choice", "data-id": choice.id }, select, reset);
  const set = (value) => {
    state.set(choice.id, value);
    showRows();
    changed(true);
  };
  row.show = () => {
    select.value = state.get(choice.id);
    row.classList.toggle("moved", isMoved(choice));
  };
  select.addEventListener("change", () => set(select.value));
  reset.addEventListener("click", () => {
    set(choice.value);
    select.focus();
  });
  row.show();
  const legend = make("legend", {}, choice.label, " ", make("span", { class: "from" }, choice.origin));
  const box = make("fieldset", {}, legend, row);
  if (choice.help) box.append(make("p", { class: "help" }, choice.help));
  return box;
}

// Changes of one thing that show what it does.
function trials() {
  const alpha = (value) => Object.fromEntries(preset.joints.map((joint) => [`control.gains.alpha.${joint}`, value]));
  const last = compared().at(-1) ?? preset.runs.at(-1);
  const below = Object.fromEntries(preset.joints.map((joint) => [`runs.${last.name}.start_offset.${joint}`, -1]));
  return [
    { label: "α = 0", set: alpha(0) },
    { label: "α = 0.5", set: alpha(0.5) },
    { label: "Acceleration not fed forward", set: { "control.readings.reference_acceleration": "absent" } },
    { label: `${last.label} starts 1° below`, set: below },
    { label: "Leave out the first 2 s", set: { errors_from: 2 } },
  ];
}

function changesSomething({ set }) {
  return all().some((one) => one.id in set && set[one.id] !== one.value);
}

// A trial is a switch, and only one is on: it takes back what the others changed.
function tryButton({ label, set }) {
  const button = make("button", { type: "button" }, label), isOn = () => Object.entries(set).every(([id, value]) => state.get(id) === value);
  button.show = () => button.setAttribute("aria-pressed", isOn());
  const tried = new Set(trials().flatMap((one) => Object.keys(one.set)));
  button.addEventListener("click", () => putIn(all().filter(({ id }) => tried.has(id)), isOn() ? {} : set));
  button.show();
  return button;
}

function allBack() {
  const button = make("button", { type: "button", id: "reset-all" }, "Reset all");
  button.addEventListener("click", () => putIn(all(), {}));
  return button;
}

// Give controls these values, or else those of the preset.
function putIn(controls, values) {
  for (const one of controls) state.set(one.id, values[one.id] ?? one.value);
  showRows();
  writeAddress(true);
  changed(true);
}

function showRows() {
  byId("problem").textContent = "";
  for (const one of document.querySelectorAll("#controls .row, #controls .from")) one.show?.();
}

const shorter = (value) => Number(value.toPrecision(6));

// The values on which a slider can stand, so that each arrow key moves it: by its step, or by a tenth of the first digit.
function stopsOf({ slider: [least, most], step, unit }, L) {
  const stops = [];
  for (let k = 0, value = least; value <= most * (1 + 1e-9); k++) {
    stops.push(shorter(unit === "s" ? Math.round(value / L) * L : value));
    value = step ? (Math.round(least / step) + k + 1) * step : value + 10 ** (Math.floor(Math.log10(value * (1 + 1e-9))) - 1);
  }
  return [...new Set(stops)];
}

function nearest(stops, value) {
  return stops.reduce((best, stop, k) => (Math.abs(stop - value) < Math.abs(stops[best] - value) ? k : best), 0);
}

// ---- Computing: one run a worker, the latest state wins -----------------------------------------------------------

const pool = {
  workers: [],
  waiting: [],
  start() {
    const code = `${byId("engine").textContent}\nonmessage = (asked) => postMessage(attempt(asked.data));`;
    try {
      const address = URL.createObjectURL(new Blob([code], { type: "text/javascript" }));
      const count = Math.min(4, navigator.hardwareConcurrency || 2);
      for (let k = 0; k < count; k++) this.workers.push(this.hire(new Worker(address)));
    } catch {
      this.workers = [];
    }
  },
  hire(worker) {
    worker.onmessage = (answer) => {
      const { settle } = worker.task;
      worker.task = null;
      settle(answer.data);
      this.next();
    };
    // A browser that allows no worker here computes in the page itself.
    worker.onerror = () => {
      const left = [...this.workers.map((one) => one.task), ...this.waiting].filter(Boolean);
      this.workers = [];
      this.waiting = [];
      for (const { job, settle } of left) setTimeout(() => settle(attempt(job)));
    };
    return worker;
  },
  ask(job) {
    return new Promise((resolve, reject) => {
      const settle = ({ found, failed }) => (failed ? reject(new Error(failed)) : resolve(found));
      if (this.workers.length) this.waiting.push({ job, settle });
      else setTimeout(() => settle(attempt(job)));
      this.next();
    });
  },
  next() {
    for (const worker of this.workers) {
      if (!worker.task && this.waiting.length) {
        worker.task = this.waiting.shift();
        worker.postMessage(worker.task.job);
      }
    }
  },
};

function jobOf(which, exact, values = state) {
  const pp = [], rr = [...which.rr];
  for (const control of preset.controls) {
    if (control.run === undefined) pp[control.place] = values.get(control.id);
    else if (control.run === which.name) rr[control.place] = values.get(control.id);
  }
  for (const choice of preset.choices) pp[choice.place] = choice.values.indexOf(values.get(choice.id));
  const { model, n, L, limit, ringing, share } = preset;
  const lag = values.get("control.readings.reference_acceleration") === "late" ? values.get("control.reference_lag") / 1000 : 0;
  const steps = exact ? which.steps : which.coarse;
  return { model, law: which.law, turns: preset.turns, pp, rr, lag, from: values.get("errors_from"), n, L, steps, limit, ringing, share, exact };
}

// All that a run depends on: what its plant, its law and its motion read of the inputs, and the rest of the job.
function keyOf(job) {
  const { plant, laws, motion } = MODELS[job.model];
  const read = new Set([plant, laws[job.law], motion].flatMap(({ reads }) => reads));
  return JSON.stringify({ ...job, pp: [...read].map((place) => job.pp[place]) });
}

const known = new Map(); // results by run, with the job they are of
let busy = false, wanted = null, since = 0;

function changed(exact) {
  byId("copied").textContent = "";
  for (const one of byId("tries").querySelectorAll("button")) one.show?.();
  // Browsers refuse an address that changes a hundred times while a slider is dragged.
  if (exact) writeAddress();
  compute(exact);
}

async function compute(exact) {
  if (!since) since = performance.now();
  if (busy) {
    wanted = exact;
    return;
  }
  busy = true;
  byId("results").setAttribute("aria-busy", "true");
  try {
    await computed(exact);
  } catch (error) {
    byId("state").textContent = `These values cannot be computed (${error.message}).${results ? " What is shown is from before." : ""}`;
    byId("state").className = "bad";
  }
  busy = false;
  byId("results").setAttribute("aria-busy", "false");
  if (wanted !== null) {
    const next = wanted;
    wanted = null;
    compute(next);
  }
}

async function computed(exact) {
  const started = since, asked = preset;
  since = 0;
  const found = await Promise.all(
    preset.runs.map(async (which) => {
      const job = jobOf(which, exact), key = keyOf(job), held = known.get(which.name);
      if (held && held.key === key) return held.found;
      const result = await pool.ask(job);
      known.set(which.name, { key, found: result });
      return result;
    }),
  );
  if (asked === preset) {
    results = new Map(preset.runs.map((which, k) => [which.name, found[k]]));
    if (exact && !moved().length) baseline = results;
    show();
    // What a chart is given it draws in the next turn.
    await null;
    document.documentElement.dataset.milliseconds = (performance.now() - started).toFixed(1);
    document.documentElement.dataset.exact = String(exact && wanted === null);
    const steps = [...new Set(found.map((one) => one.steps))].join(" and ");
    byId("how").textContent =
      `${preset.runs.length} runs of ${found[0].duration.toFixed(1)} s, ${steps} Runge-Kutta steps a sample, in ` +
      `${Math.round(performance.now() - started)} ms. Same equations as the command line, and its errors within 0.001°.`;
  }
  if (asked === preset && !baseline && wanted === null) {
    const own = new Map(all().map((one) => [one.id, one.value]));
    const held = await Promise.all(preset.runs.map((which) => pool.ask(jobOf(which, true, own))));
    if (asked === preset) {
      baseline = new Map(preset.runs.map((which, k) => [which.name, held[k]]));
      byId("change").textContent = changeWords();
      showTables();
    }
  }
}

// ---- Words and tables -------------------------------------------------------------------------------------------

const compared = () => preset.runs.filter((which) => which.compared);
const degrees = (value) => (value * 180) / Math.PI;
const follows = ({ status }) => status === "ok" || status === "ringing";
const allLeftOut = () => state.get("errors_from") > results.get(preset.runs[0].name).duration;
const shown = (value, digits = 3) => (Number.isFinite(value) ? degrees(value).toFixed(digits) : "–");

function show() {
  byId("order").textContent = orderWords();
  byId("change").textContent = changeWords();
  const words = statusWords();
  byId("state").textContent = words.text;
  byId("state").className = words.bad ? "bad" : "";
  showTables();
  drawFigures();
  if (!byId("yaml").hidden) byId("yaml").value = yamlText();
}

function orderWords() {
  const asked = compared(), runs = asked.filter(({ name }) => follows(results.get(name)));
  if (asked.length < 2) return "";
  if (runs.length < 2) return "Fewer than two controllers finish, so there is no order.";
  if (allLeftOut()) return "The whole run is left out of the errors, so there is no order.";
  const orders = preset.joints.map((_, i) => orderOn(runs, i));
  const head = `Smallest mean error first${runs.length < asked.length ? ", of those that finish" : ""}`;
  const ours = orders.every((order) => order === orders[0])
    ? `${head}: Controller ${orders[0]}${preset.joints.length > 1 ? ", on every joint" : ""}.`
    : `${head}: ${orders.map((order, i) => `on joint ${preset.joints[i]} Controller ${order}`).join("; ")}.`;
  return preset.printed ? `${ours} The paper has 1, then 2, then 3.` : ours;
}

// Runs by mean error on a joint; those that differ by less than 0.05 % are equal.
function orderOn(runs, i) {
  const size = ({ name }) => results.get(name).mae[i], order = [...runs].sort((a, b) => size(a) - size(b));
  return order.reduce((text, which, k) => {
    if (k === 0) return which.short;
    return `${text}${size(which) > 1.0005 * size(order[k - 1]) ? ", then" : " ="} ${which.short}`;
  }, "");
}

// The change that matters most, against the preset.
function changeWords() {
  const changes = moved();
  if (!changes.length || !baseline) return "";
  const sizes = [];
  for (const { name, label, compared } of preset.runs) {
    preset.joints.forEach((joint, i) => {
      const before = baseline.get(name).mae[i], after = results.get(name).mae[i], size = Math.abs(Math.log(after / before));
      if (size > 0) sizes.push({ label, joint, before, after, size, weight: compared ? size : 0.1 * size });
    });
  }
  const labels = [...new Set(changes.map(({ label }) => label))], what = labels.slice(0, 2).map(movedWords);
  if (labels.length > 2) what.push(`${labels.length - 2} more changed`);
  const most = sizes.sort((a, b) => b.weight - a.weight)[0];
  if (preset.runs.some(({ name }) => results.get(name).status === "unresolved")) return `${what.join("; ")}.`;
  const failing = preset.runs.filter(({ name }) => follows(baseline.get(name)) && !follows(results.get(name)));
  if (failing.length) return `${what.join("; ")}. With that, ${failing[0].label} no longer follows its reference.`;
  if (allLeftOut()) return `${what.join("; ")}.`;
  if (!most || most.size < 5e-4) return `${what.join("; ")}. No mean error changes by more than 0.05 %.`;
  const ratio = most.after / most.before, percent = Math.abs(100 * (ratio - 1));
  const size = `${ratio > 1 ? "+" : "−"}${percent.toFixed(percent < 10 ? 1 : 0)} %`, effect = ratio < 3 ? size : `${ratio.toFixed(ratio < 10 ? 1 : 0)} times`;
  return `${what.join("; ")}. Largest effect: ${most.label} on joint ${most.joint}, mean error ${shown(most.before)}° → ${shown(most.after)}° (${effect}).`;
}

// A control's values now and in the preset, of all joints.
function movedWords(label) {
  const fields = all().filter((one) => one.label === label), name = label.split(",")[0];
  const joints = fields[0].part && fields.length > 1 ? ` on ${fields.map(({ part }) => part).join(" / ")}` : "";
  return `${name}${joints} is ${fields.map((one) => told(one)).join(" / ")} instead of ${fields.map((one) => told(one, one.value)).join(" / ")}`;
}

function told(one, value = state.get(one.id)) {
  if (one.words) return `“${one.words[one.values.indexOf(value)]}”`;
  const unit = unitOf(one);
  return `${String(shorter(value)).replace("-", "−")}${unit === "°" ? "°" : unit && ` ${unit}`}`;
}

function statusWords() {
  const words = [];
  for (const { name, label } of preset.runs) {
    const { status, end, steps } = results.get(name);
    if (status === "diverged") words.push(`${label} diverges: its error passes ${shorter(degrees(preset.limit))}° at ${end.toFixed(3)} s.`);
    if (status === "ringing") words.push(`${label} oscillates: most of its error's power is above ${preset.ringing} Hz.`);
    if (status === "unresolved") words.push(`${label} is not shown: ${steps} steps a sample are too few for this arm. Make tendons softer or winches heavier.`);
  }
  if (allLeftOut()) words.push("Nothing is left of the runs for the errors.");
  preset.joints.forEach((joint, i) => {
    const furthest = (end) => preset.joints.slice(0, i + 1).reduce((sum, _, k) => sum + end(reached(k)), preset.posture[i]);
    const [least, most] = [furthest((ends) => ends[0]), furthest((ends) => ends[1])];
    if (least <= 0 || most >= 180) words.push(`Link ${joint} would leave the half-plane in which the arm works: it goes from ${least.toFixed(0)}° to ${most.toFixed(0)}° from hanging.`);
  });
  if (words.length) return { text: words.join(" "), bad: true };
  return { text: preset.runs.length > 1 ? `All ${preset.runs.length} runs are stable.` : "The run is stable.", bad: false };
}

// Least and largest displacement of a joint's reference, degrees.
function reached(i) {
  const { q_d } = results.get(preset.runs[0].name).curves;
  return [degrees(Math.min(...q_d[i])), degrees(Math.max(...q_d[i]))];
}

function showTables() {
  byId("tables").replaceChildren(
    ...tables().map(({ caption, rows }, k) => {
      const head = make("tr", {}, make("th", { scope: "col" }, ""));
      for (const metric of ["MAE", "RMSE"]) for (const joint of preset.joints) head.append(make("th", { scope: "col" }, `${metric}, joint\u00a0${joint}`));
      const body = make("tbody");
      for (const { run, label } of rows) body.append(tableRow(run, label));
      const from = state.get("errors_from"), without = from > 0 ? `, without the first ${shorter(from)} s,` : "";
      const sizes = k === 0 ? ": mean absolute (MAE) and root mean square (RMSE)" : "";
      const paper = make("span", {}, `${without} in degrees${sizes}${preset.printed ? ", beside it the paper’s" : ""}`);
      return make("table", {}, make("caption", {}, caption, paper), make("thead", {}, head), body);
    }),
  );
}

function tables() {
  const all = [{ caption: "Table 2, mean errors of the runs", rows: compared().map(({ name, label }) => ({ run: name, label })) }];
  const { no_load, with_load } = preset.loads ?? {};
  const rows = [{ run: no_load, label: "no load" }, { run: with_load, label: "with payload" }];
  return preset.loads ? [...all, { caption: "Table 3, Controller 1", rows }] : all;
}

function tableRow(run, label) {
  const found = results.get(run), row = make("tr", { "data-run": run, "data-status": found.status });
  const status = found.status === "ok" ? "" : make("span", { class: "bad" }, ` ${OBSERVED[found.status]}`);
  row.append(make("th", { scope: "row" }, label.replace(/ (?=\d)/, "\u00a0"), status));
  const { printed } = preset.runs.find((which) => which.name === run);
  for (const metric of ["mae", "rmse"]) {
    preset.joints.forEach((_, i) => {
      const ours = found[metric][i];
      const cell = make("td", { "data-value": degrees(ours) }, make("b", {}, shown(ours)));
      if (printed) cell.append(make("span", { class: "paper" }, printed[metric][i].toFixed(3)));
      const before = baseline && moved().length ? baseline.get(run)[metric][i] : NaN;
      if (shown(before) !== "–" && shown(before) !== shown(ours)) cell.append(make("span", { class: "was" }, `was ${shown(before)}`));
      row.append(cell);
    });
  }
  return row;
}

// ---- Figures ----------------------------------------------------------------------------------------------------

const QUANTITIES = {
  q: ["Joint {} and its reference", "deg", degrees],
  e: ["Error of joint {}", "deg", degrees],
  s: ["Sliding variable s, joint {}", "rad/s", (x) => x],
  H_hat: ["Estimate Ĥ, joint {}", "N m", (x) => x],
  tau: ["Torque τ, joint {}", "N m", (x) => x],
};
let plots = [];

function figures() {
  const runs = compared().map(({ name }) => name), all = [
    ["Fig. 14: tracking", runs, ["e", "q"]],
    ["Fig. 15: sliding variable, estimate and torque", runs, ["s", "H_hat", "tau"]],
  ];
  return preset.loads ? [...all, ["Fig. 16: Controller 1 with and without payload", Object.values(preset.loads), ["e", "q"]]] : all;
}

function buildFigures() {
  for (const { chart } of plots) chart?.destroy();
  plots = [];
  byId("figures").replaceChildren(
    make("p", { class: "soft zoom" }, "Drag across a picture to enlarge a stretch of time. Double-click to go back."),
    ...figures().flatMap(([title, runs, quantities]) => {
      const note = make("li", { class: "soft" });
      const rows = quantities.map((name) => make("div", { class: "plots" }, ...preset.joints.map((joint, i) => buildPlot(name, i, joint, runs, note))));
      const legend = legendOf(runs, quantities.includes("q"));
      legend.append(note);
      return [make("h2", {}, title), legend, ...rows];
    }),
  );
  byId("figures").style.visibility = results ? "" : "hidden";
}

const strokeOf = (run) => STROKES[run] || SPARES[preset.runs.findIndex(({ name }) => name === run) % SPARES.length];

function legendOf(runs, reference) {
  const list = make("ul", { class: "legend" });
  const add = (label, [name, dash]) => {
    const box = make("span");
    box.innerHTML = `<svg width="34" height="8" aria-hidden="true"><path d="M0 4h34" style="stroke:var(${name})" stroke-width="2.2" stroke-dasharray="${dash.join(" ")}"/></svg>`;
    list.append(make("li", {}, box, label));
  };
  if (reference) add("reference", REFERENCE);
  for (const run of runs) add(preset.runs.find((which) => which.name === run).label, strokeOf(run));
  return list;
}

function buildPlot(name, i, joint, runs, note) {
  const box = make("div", { class: "plot", role: "img" });
  plots.push({ box, name, i, joint, runs, note, chart: null, drawn: null, seen: false });
  watcher.observe(box);
  return box;
}

// Plots out of sight wait until they are scrolled to.
const watcher = new IntersectionObserver((entries) => {
  for (const { target, isIntersecting } of entries) {
    const plot = plots.find(({ box }) => box === target);
    if (plot) {
      plot.seen = isIntersecting;
      if (isIntersecting) draw(plot);
    }
  }
}, { rootMargin: "200px" });

function drawFigures() {
  byId("figures").style.visibility = "";
  for (const plot of plots) if (plot.seen) draw(plot);
}

function draw(plot) {
  if (!results || plot.drawn === results) return;
  plot.drawn = results;
  const { name, i, runs, box, joint } = plot, [title, unit, scaled] = QUANTITIES[name], isMean = MEANS.includes(name);
  const found = runs.map((run) => results.get(run)), times = ({ curves }) => (isMean ? curves.middles : curves.ends);
  const longest = found.reduce((a, b) => (times(b).length > times(a).length ? b : a)), time = times(longest), lines = [];
  if (name === "q") lines.push(["reference", REFERENCE, longest.curves.q_d[i]]);
  runs.forEach((run, k) => {
    const values = found[k].status === "unresolved" ? [] : found[k].curves[name][i];
    lines.push([preset.runs.find((which) => which.name === run).label, strokeOf(run), values]);
  });
  const data = [time, ...lines.map(([, , values]) => time.map((_, k) => (k < values.length && Number.isFinite(values[k]) ? scaled(values[k]) : null)))];
  const heading = `${title.replace("{}", joint)}, ${unit}`, mean = `each point is a mean over ${Math.round(1000 * longest.stretch)} ms`;
  if (isMean) plot.note.textContent = mean;
  box.setAttribute("aria-label", `${heading}${isMean ? `, ${mean}` : ""}. ${lines.map(([label], k) => spanWords(label, data[k + 1])).join(" ")}`);
  const stretch = enlarged();
  if (plot.chart) plot.chart.setData(data);
  else plot.chart = chartOf(box, heading, lines, data);
  if (stretch && stretch.max <= time.at(-1)) plot.chart.setScale("x", stretch);
}

// The stretch of time that a reader enlarged; null if all is shown.
function enlarged() {
  for (const { chart } of plots) {
    const { min = null, max } = chart?.scales.x ?? {};
    if (min === null) continue;
    if (min > 0 || max < chart.data[0].at(-1)) return { min, max };
  }
  return null;
}

function spanWords(label, values) {
  const held = values.filter((value) => value !== null);
  if (!held.length) return `${label}: nothing.`;
  return `${label}: from ${Math.min(...held).toPrecision(3)} to ${Math.max(...held).toPrecision(3)}.`;
}

function chartOf(box, title, lines, data) {
  const series = lines.map(([label, [name, dash]]) => ({ label, stroke: () => colour(name), dash, width: label === "reference" ? 3 : 1.4, points: { show: false } }));
  const axis = { stroke: () => colour("--soft"), font: "11px system-ui, sans-serif", grid: { stroke: () => colour("--grid"), width: 1 }, ticks: { show: false } };
  const options = {
    title,
    width: box.clientWidth,
    height: 150,
    legend: { show: false },
    cursor: { sync: { key: "time" }, points: { show: false } },
    scales: { x: { time: false, range: (chart, least, most) => [least <= chart.data[0][0] ? 0 : least, most] } },
    series: [{}, ...series],
    axes: [{ ...axis, size: 22, values: (_, ticks) => ticks.map((tick) => `${tick} s`) }, { ...axis, size: 46 }],
  };
  return new uPlot(options, data, box);
}

addEventListener("beforeprint", () => plots.forEach(draw));
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => plots.forEach(({ chart }) => chart?.redraw()));

new ResizeObserver(() => {
  for (const { chart, box } of plots) if (chart && box.clientWidth !== chart.width) chart.setSize({ width: box.clientWidth, height: 150 });
}).observe(byId("figures"));

// ---- Taking it along --------------------------------------------------------------------------------------------

// The preset's configuration with what was moved, for the command line.
function yamlText() {
  const tree = structuredClone(preset.tree);
  for (const one of moved()) put(tree, one, state.get(one.id), preset.n);
  return `# ${preset.title}, from the page of tendonrepro live\n${yamlOf(tree, "")}`;
}

// Set a value in a configuration, in the page's unit.
function put(tree, one, value, n) {
  const keys = (one.key || one.id).split("."), last = keys.pop(), node = keys.reduce((held, key) => held[key], tree);
  if (one.values) {
    node[last] = value;
    return;
  }
  // A run without a start offset starts on its reference.
  const held = (node[last] ??= { value: Array(n).fill(0), unit: one.unit }), inUnit = (number) => (held.unit === one.unit ? number : number * one.factor);
  if (one.entry === null) held.value = value;
  else held.value = held.value.map((number, k) => (k === one.entry ? value : inUnit(number)));
  held.unit = one.unit;
  held.source = "assumed: set by hand in the page of tendonrepro live";
}

function yamlOf(tree, indent) {
  let text = "";
  for (const [key, value] of Object.entries(tree)) {
    if (value === null) continue;
    if (typeof value === "object" && !Array.isArray(value)) text += `${indent}${key}:\n${yamlOf(value, `${indent}  `)}`;
    else text += `${indent}${key}: ${JSON.stringify(value)}\n`;
  }
  return text;
}

async function copy(text, what) {
  try {
    await navigator.clipboard.writeText(text);
    byId("copied").textContent = `${what} copied.`;
  } catch {
    byId("copied").textContent = `The browser does not allow copying here: select the text below.`;
    byId("yaml").hidden = false;
    byId("yaml").value = text;
    byId("yaml").select();
  }
}

byId("copy-link").addEventListener("click", () => copy(location.href, "Link"));
byId("copy-yaml").addEventListener("click", () => {
  byId("yaml").hidden = false;
  byId("yaml").value = yamlText();
  copy(byId("yaml").value, "Configuration");
});
byId("controls").addEventListener("submit", (event) => event.preventDefault());
// Beside the results controls are open for good; above them a reader opens them.
const beside = matchMedia("(min-width: 961px)"), arrange = () => (byId("panel").open = beside.matches);
beside.addEventListener("change", arrange);
arrange();
byId("order").textContent = "The runs are computed now.";
pool.start();
unpacked(PAGE).then((presets) => {
  PRESETS = presets;
  for (const one of PRESETS) {
    const radio = make("input", { type: "radio", name: "preset", value: one.name });
    radio.addEventListener("change", () => {
      byId("problem").textContent = "";
      take(one);
      writeAddress(true);
    });
    byId("presets").append(make("label", {}, radio, ` ${one.title}`));
  }
  addEventListener("hashchange", readAddress);
  readAddress();
}, () => {
  byId("problem").textContent = "This browser is too old for the page: it cannot unpack its numbers.";
});
