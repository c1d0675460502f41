// A recording: dropped, read and analysed in the worker, and shown.
"use strict";

const read_json = (id) => JSON.parse(document.getElementById(id).textContent);
const data = read_json("data");
const $ = (id) => document.getElementById(id);

/** An element: attributes, and its content, text or other elements; null is left out. */
function h(name, attributes = {}, ...children) {
  const node = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (key.startsWith("on")) node.addEventListener(key.slice(2), value);
    else if (value === true) node.setAttribute(key, "");
    else if (value !== null && value !== false) node.setAttribute(key, value);
  }
  node.append(...children.flat().filter((child) => child !== null && child !== undefined && child !== ""));
  return node;
}

const module_ready = (async () => {
  const packed = new Blob([Uint8Array.from(atob($("wasm").textContent), (c) => c.charCodeAt(0))]);
  const unpacked = packed.stream().pipeThrough(new DecompressionStream("gzip"));
  return WebAssembly.compile(await new Response(unpacked).arrayBuffer());
})();
const words_ready = module_ready.then(learn_words);
const worker_address = URL.createObjectURL(
  new Blob([...document.querySelectorAll("[id^=script-]")].map((script) => script.textContent + "\n"), { type: "text/javascript" }),
);

// --- the worker

let worker = null;
let file = null; // { name, bytes }: read anew where the worker was ended
let ticking = null;
let turn = 0; // of the analysis that was asked for last

async function begin() {
  worker?.terminate();
  dismiss();
  const started = new Worker(worker_address);
  worker = started;
  started.onmessage = ({ data: reply }) => started === worker && hears[reply.kind](reply);
  started.onerror = (event) => started === worker && broke("analysis", event.message || "its worker died");
  await words_ready;
  started.postMessage({ kind: "begin", module: await module_ready, data: data.reading });
}

const hears = {
  ready() {},
  progress({ stage, share, since = share === null ? performance.now() : null }) {
    clearInterval(ticking);
    $("stage").textContent = `${stage} …`;
    $("took").textContent = "";
    if (share === null) $("share").removeAttribute("value"); // nobody knows how long it takes
    else $("share").value = share;
    if (since !== null) {
      ticking = setInterval(() => { $("took").textContent = duration(Math.round((performance.now() - since) / 1000)); }, 1000);
    }
    $("working").hidden = false;
  },
  opened(reply) {
    if (!file.opened) {
      file.opened = reply;
      file.loop = 0;
      offer();
    }
    if (file.quiet) {
      file.quiet = false;
      rest();
      $("settings").open = true;
    } else analyse();
  },
  first(reply) {
    show(reply, CROSSINGS);
  },
  so_far(reply) {
    if (fitting) show(reply, `From zero crossings, and from ${reply.windows} of the ${reply.of} windows of the fit`);
  },
  windows(reply) {
    fit_windows(reply);
  },
  answered(reply) {
    rest();
    show(reply, null);
  },
  wrong({ text }) {
    rest();
    refuse(file.name, text);
    if (file.opened) $("settings").open = true;
  },
};

function refuse(name, text) {
  $("wrong").textContent = `${name}: ${text}`;
  $("wrong").hidden = false;
}

function broke(what, why) {
  dismiss();
  hears.wrong({ text: `the ${what} broke off (${why}): close other pages and analyse again; if it breaks off once more, please report it with the recording` });
}

function rest() {
  clearInterval(ticking);
  $("working").hidden = true;
  $("result").querySelector(".going-on")?.replaceChildren(`${shown.from}. The fit of OP and PV was ended.`);
}

// --- the windows of the fit

let fitting = null;

function dismiss() {
  fitting?.end();
  fitting = null;
}

/** Fits each window by itself; the worker joins the results. */
async function fit_windows({ windows, turn: of }) {
  const module = await module_ready;
  if (of !== turn) return;
  const began = performance.now();
  const tell = (done) => {
    if (windows.length > 1) hears.progress({ stage: `Fitting the gap, ${done} of ${windows.length} windows done`, share: done / windows.length, since: began });
  };
  tell(0);
  fitting = new Windows(module, windows, worker, {
    done(done) {
      tell(done);
      if (done < windows.length) return;
      dismiss();
      hears.progress({ stage: "Joining what the windows say", share: null });
    },
    broke: (why) => broke("fit", why),
  });
}

const stem = () => file.name.replace(/\.[^.]+$/, "").replace(/\.(csv|txt|tsv)$/i, "");

async function take(name, bytes) {
  $("wrong").hidden = true;
  $("result").replaceChildren();
  $("settings").hidden = $("several").hidden = true;
  file = { name, bytes };
  await begin();
  worker.postMessage({ kind: "open", bytes, stem: stem() });
}

function analyse() {
  $("wrong").hidden = true;
  $("result").replaceChildren();
  noted.set(file.opened.loops[file.loop].name, fields.map((field) => [field.value, field.checked]));
  try {
    const columns = Object.fromEntries(Object.entries(file.columns).filter(([, at]) => at !== null));
    const options = { columns, loop: file.loop, sample_time: typed("sample_time"), time_format: file.time_format };
    dismiss();
    turn += 1;
    worker.postMessage({ kind: "analyse", options, task: task(), turn });
  } catch (wrong) {
    hears.wrong({ text: wrong.message });
  }
}

$("cancel").addEventListener("click", async () => {
  rest();
  file.quiet = true; // only read again: nothing is analysed unasked
  await begin();
  worker.postMessage({ kind: "open", bytes: file.bytes, stem: stem() });
});

// --- what is known of the loop

const fields = [...$("again").querySelectorAll("input")];
const noted = new Map(); // name of a loop to what was typed of it: K of one is not that of the next

const typed = (id) => {
  const text = $(id).value.trim().replace(",", ".");
  if (text === "") return null;
  const value = Number(text);
  if (!Number.isFinite(value)) throw new Error(`${$(id).labels[0].textContent}: '${text}' is not a number`);
  return value;
};

function span(of) {
  const [low, high] = [typed(`${of}_low`), typed(`${of}_high`)];
  if (low === null && high === null) return null;
  if (low === null || high === null || low >= high) throw new Error(`span of ${of.toUpperCase()}: needs a lower and a higher end`);
  return [low, high];
}

/** Task for the core, in the form of glapp.estimate. */
function task() {
  const [k, ti, td, b] = ["k", "ti", "td", "b"].map(typed);
  if ((k === null) !== (ti === null)) throw new Error("K and TI: give both, or neither");
  if (k === null && td !== null) throw new Error("TD: give K and TI with it, or leave it empty");
  return {
    controller: k === null ? null : { k, ti, td: td ?? 0, b: b ?? 1 },
    setpoint_weight: b,
    kp: typed("kp"),
    integrating: $("integrating").checked,
    pv_span: span("pv"),
    op_span: span("op"),
    op_unit: $("op_unit").value.trim() || null,
    acceptable: typed("acceptable"),
  };
}

/** Columns and settings, to be corrected. */
function offer() {
  const { loops } = file.opened;
  file.columns = {};
  file.time_format = null;
  const { name: called, names } = loops[file.loop];
  fields.forEach((field, i) => { [field.value, field.checked] = noted.get(called)?.[i] ?? ["", false]; });
  const choice = (role) => h("label", {}, data.reading.columns.labels[role],
    h("select", { onchange: (event) => { file.columns[role] = event.target.value === "" ? null : Number(event.target.value); } },
      h("option", { value: "" }, "automatic"), h("option", { value: "-1" }, "none"),
      ...names.map((name, i) => h("option", { value: i }, name || "(no name)"))));
  const order = h("label", {}, "Dates such as 3/4/2025",
    h("select", { id: "time_format", onchange: (event) => { file.time_format = event.target.value || null; } },
      h("option", { value: "" }, "automatic"), ...["day first", "month first"].map((one) => h("option", {}, one))));
  const another = (event) => {
    file.loop = Number(event.target.value);
    offer();
    analyse();
  };
  const several = h("label", {}, `Loop, one of ${loops.length} in the file `,
    h("select", { id: "loop", onchange: another }, ...loops.map(({ name }, i) => h("option", { value: i, selected: i === file.loop }, name))));
  $("several").replaceChildren(several);
  $("several").hidden = loops.length < 2;
  const roles = ["time", "sp", "pv", "op", "mode", "quality", "position"].filter((role) => !loops[file.loop].tags || !["time", "quality"].includes(role));
  $("columns").replaceChildren(...roles.map(choice), order);
  $("first-rows").replaceChildren(firstRows(loops[file.loop]));
  $("settings").hidden = false;
}

/** Names and first rows of the file, so that a person sees the content of a column. */
const firstRows = ({ names, rows }) => h("table", { "aria-labelledby": "first-rows-name" },
  h("thead", {}, h("tr", {}, names.map((name) => h("th", { scope: "col" }, name || "(no name)")))),
  h("tbody", {}, rows.map((row) => h("tr", {}, row.map((cell) => h("td", {}, cell))))));

$("again").addEventListener("submit", (event) => {
  event.preventDefault();
  analyse();
});

// --- the answer

const facts = (rows) => h("dl", { class: "facts" }, rows.map(([label, text]) => h("div", {}, h("dt", {}, label), h("dd", {}, text))));

const table = (caption, heads, rows) => h("table", { class: "cards" }, h("caption", {}, caption),
  h("thead", {}, h("tr", {}, heads.map((head) => h("th", { scope: "col" }, head)))),
  h("tbody", {}, rows.map((row) => h("tr", {}, row.map((cell, i) => (i ? h("td", { "data-label": heads[i] }, cell) : h("th", { scope: "row" }, cell)))))));

const limits = (low, high) => (low === null || high === null ? DASH : `${number(low)} to ${number(high)}`);

const EXPLAINED = { refuse: "refused", warning: "warning", info: "note" };

/** The answer that is shown. */
let shown = null;

const CROSSINGS = "From zero crossings alone";

/** Shows an answer; `from`: what it is from, where the fit still goes on. */
function show(reply, from) {
  const provisional = from !== null;
  shown = { ...reply, from };
  const { answer: doc, read, unit, texts: { parts } } = reply;
  const { answer } = doc;
  const [op_unit, pv_unit] = [ofOp(unit), read.units.pv ?? "PV unit"];
  const name = read.loop;
  const { t } = read.columns;
  const span = t.at(-1) - t[0];
  const place = (id, label) => h("div", { class: "plot", id, role: "img", "aria-label": `${name}: ${label}` });
  const fitted = answer.evidence !== null;
  const section = h("section", { class: provisional ? "loop provisional" : "loop", "aria-live": "polite" },
    provisional ? h("p", { class: "screen going-on" }, `${from}. The fit of OP and PV goes on, and settles the width.`) : null,
    h("div", { class: "head" }, h("h2", {}, name), h("span", { class: "width" }, parts.headline),
      h("span", { class: `badge ${answer.valve}` }, verdict(answer))),
    h("div", { class: "verdict" }, h("p", { class: "lead" }, parts.so),
      h("p", { class: "action" }, h("b", {}, "What to do"), parts.do),
      provisional || !["likely", "cannot_tell"].includes(answer.confidence) ? null : h("p", { class: "note screen" },
        "Plan a test with the Python package: ", h("code", {}, `glapp plan-test ${file.name}`)),
      h("details", { class: "why" }, h("summary", {}, "Why"), parts.why.map((text) => h("p", {}, text)))),
    h("div", { class: "pictures" }, h("div", {}, place("op-picture", "OP over time"), place("pv-picture", "PV and SP over time")),
      h("div", { id: "gap-place" })),
    h("p", { class: "note screen" }, "Drag to zoom, double-click for all of it."),
    facts([["File", file.name],
      ["Recording", `${moment(read.t0, t[0])} to ${moment(read.t0, t.at(-1))}, ${duration(span)}, ${count(t.length, "row")}`],
      ["Columns", Object.entries(read.chosen).map(([role, column]) => `${data.reading.columns.labels[role]}: ${column}`).join(", ")],
      ["Not used", unused(read) || "nothing"],
      ["Analysed in", `${number(reply.took / 1000, 2)} s`]]),
    h("details", { class: "engineer", open: true }, h("summary", {}, h("h3", {}, "The evidence, for the engineer")),
      fitted ? fit(reply, op_unit, pv_unit, place) : null,
      crossings(reply, op_unit),
      quality(reply),
      settings(reply, op_unit, pv_unit)),
    provisional ? null : h("p", { class: "screen" }, h("button", { type: "button", id: "save", onclick: save }, "Save the report"), " ",
      h("button", { type: "button", onclick: () => print() }, "Print")));
  $("result").replaceChildren(section);
  draw(reply, op_unit, pv_unit);
}

const unused = (read) => {
  const used = new Set(Object.values(read.chosen));
  return file.opened.loops[file.loop].names.filter((name) => !used.has(name)).join(", ");
};

function fit(reply, unit, pv_unit, place) {
  const { fit: found } = reply.answer;
  const rows = [["Width", quantity(found.d, unit)], ["95 % interval", limits(found.low, found.high)]];
  if (found.lr_no_gap !== null) {
    rows.push(["Likelihood ratio", `${number(found.lr_no_gap)}, ${number(found.lr_needed)} needed`]);
  }
  if (reply.pv) rows.push(["OP crossed it", `${reply.pv.traversals[0]} times up, ${reply.pv.traversals[1]} down`]);
  const process = found.process === null ? [] : [
    [found.process.integrating ? "Velocity gain" : "Process gain Kp", found.process.kp, `${pv_unit} per ${unit}${found.process.integrating ? " and s" : ""}`],
    ["Dead time", found.process.dead_time, "s"],
    ["Lags together", found.process.lag, "s"],
  ].map(([label, [value, low, high], of]) => [label, quantity(value, of), limits(low, high)]);
  return h("section", {}, h("h3", {}, "The gap from OP and PV"), h("p", {}, sentence(reply.texts.fit)), facts(rows),
    reply.pv ? place("likelihood", "likelihood over the width") : null,
    reply.pv ? h("p", { class: "note" }, "A line is a family of models, the thick one the best. The lower it is, the better that width explains PV. The shaded band is the 95 % interval.") : null,
    process.length ? table("The process between valve and PV, from the same fit.", ["Process", "Value", "95 % interval"], process) : null);
}

function crossings({ answer: doc, texts }, unit) {
  const reasons = Object.entries(doc.reasons).filter(([, n]) => n).sort((a, b) => b[1] - a[1]);
  const counts = [["accepted", doc.detections], ...reasons].filter(([, n]) => n);
  const total = doc.half_periods;
  const rows = [["A PLC would show", texts.parts.plc],
    ["Half-periods", String(total)], ["Detections", String(doc.detections)]];
  if (doc.repeatability && doc.detections > 1) rows.push(["Repeatability", `${number(doc.repeatability[0])} to ${quantity(doc.repeatability[1], unit)}`]);
  if (doc.corrected?.d) rows.push(["Bias taken out", quantity(doc.corrected.d, unit)]);
  if (doc.noise_floor !== null) rows.push(["Noise limit", quantity(doc.noise_floor, unit)]);
  return h("section", {}, h("h3", {}, "What a PLC would show, from zero crossings"), facts(rows),
    total ? table("The first reason that applied to each half-period.", ["Verdict", "Count", "Share", "Meaning"],
      counts.map(([name, n]) => [swatch(name), String(n), `${number((100 * n) / total, 2)} %`, words.reasons[name].meaning]))
      : h("p", {}, "There are no half-periods: PV did not cross SP and come back."));
}

const swatch = (name) => h("span", {}, h("i", { class: `swatch r-${name}` }), words.reasons[name].label);

function quality(reply) {
  const { answer: doc, read, texts } = reply;
  const reader = reader_of(reply);
  // Findings of reading come before others of the same severity, as in the package.
  const weight = ({ code, severity }) => (code === "kp_assumed" ? 3 : Object.keys(EXPLAINED).indexOf(severity));
  const read_of = read.found.map((one) => ({ ...one, text: finding(one, reader) }));
  const all = [...read_of, ...doc.quality.map((one, i) => ({ ...one, text: texts.quality[i] }))].sort((a, b) => weight(a) - weight(b));
  const found = all.map((one) => [
    h("span", { class: `severity ${one.severity}` }, EXPLAINED[one.severity]),
    h("div", {}, sentence(one.text),
      h("span", { class: "evidence" }, Object.entries(one.evidence).map(([key, value]) => `${key.replaceAll("_", " ")} ${typeof value === "number" ? number(value, 4) : value}`).join(", "))),
  ]);
  return h("section", {}, h("h3", {}, "Data quality"),
    found.length ? table("Findings on the recording, with evidence.", ["Weight", "Finding"], found) : h("p", {}, "Nothing to remark."));
}

function settings({ answer: doc }, unit, pv_unit) {
  const s = doc.controller;
  if (s.k === null) return null;
  const gain = `${unit} per ${pv_unit}`;
  const rows = [["Gain K", quantity(s.k, gain), "k"], ["Integral time TI", quantity(s.ti, "s"), "ti"], ["Derivative time TD", quantity(s.td, "s"), "td"],
    ["Setpoint weight b", number(s.setpoint_weight), "b"], ["Filter of the detector TF", quantity(s.tf, "s"), "tf"],
    ["Process gain Kp", s.kp_process === null ? "not used" : quantity(s.kp_process, `${pv_unit} per ${unit}`), "kp"]];
  return h("section", {}, h("h3", {}, "Settings"),
    table("As used: ideal form, seconds, units of the signals.", ["Setting", "As used", "Where from"], rows.map(([label, value, of]) => [label, value, s.origins[of] ?? ""])));
}

// --- pictures

const TURNS = 8; // turns of the valve that a picture shows: as in python/glapp/report/fit_figure.py

/** The stretch in which the valve turns so often and OP travels least; all where it turns less often. */
function stretch(valve, op) {
  const turns = [];
  let last = 0;
  for (let i = 1; i < valve.length; i += 1) {
    const way = Math.sign(valve[i] - valve[i - 1]);
    if (way && last && way !== last) turns.push(i - 1);
    if (way) last = way;
  }
  if (turns.length <= TURNS) return [0, valve.length - 1];
  const travel = turns.slice(0, -TURNS).map((from, i) => {
    const part = op.slice(from, turns[i + TURNS]);
    return Math.max(...part) - Math.min(...part);
  });
  const first = travel.indexOf(Math.min(...travel));
  return [turns[first], turns[first + TURNS]];
}

function interpolated(at, t, x) {
  let k = 0;
  return at.map((time) => {
    while (k < t.length - 2 && t[k + 1] <= time) k += 1;
    const share = (time - t[k]) / (t[k + 1] - t[k]);
    return x[k] + (Number.isFinite(share) ? share * (x[k + 1] - x[k]) : 0);
  });
}

function draw(reply, op_unit, pv_unit) {
  const { columns, t0 } = reply.read;
  const { fit: found, answer } = reply.answer;
  const zoomed = [];
  const bands = reply.half_periods
    ? reply.half_periods.t_start.slice(0, 20_000).map((from, i) => [from + (t0 ?? 0) / 1000, reply.half_periods.t_end[i] + (t0 ?? 0) / 1000, `r-${data.names[reply.half_periods.reason[i]]}`])
    : null;
  if (columns.op) {
    const lines = [{ label: "OP", stroke: "output" }];
    const drawn = [columns.op];
    if (reply.pv) {
      lines.push({ label: "valve (model)", stroke: "position", width: 2 });
      drawn.push(interpolated(Array.from(columns.t), reply.pv.t, reply.pv.valve));
    }
    zoomed.push(chart($("op-picture"), thinned(columns.t, drawn), lines, { y: `OP [${op_unit}]`, t0, height: 230, sync: "recording" }));
  }
  const lines = [{ label: "PV", stroke: "signal" }];
  const drawn = [columns.pv];
  if (columns.sp) {
    lines.push({ label: "SP", stroke: "ink", dash: [6, 3] });
    drawn.push(columns.sp);
  }
  zoomed.push(chart($("pv-picture"), thinned(columns.t, drawn), lines, { y: `PV [${pv_unit}]`, t0, height: 230, sync: "recording", bands }));
  if (!reply.pv || !columns.op) return;
  const { pv } = reply;
  const op = interpolated(pv.t, Array.from(columns.t), Array.from(columns.op));
  const [from, to] = ["backlash", "stiction", "both", "at_least"].includes(found.verdict) ? stretch(pv.valve, op) : [0, pv.t.length - 1];
  const [begin, end] = [pv.t[from], pv.t[to]].map((t) => t + (t0 ?? 0) / 1000);
  for (const plot of zoomed) plot.setScale("x", { min: begin, max: end });
  $("gap-place").append(...parallelogram(reply, op.slice(from, to + 1), [from, to + 1], op_unit, pv_unit));
  if ($("likelihood")) likelihood(pv, found, answer, op_unit);
}

function parallelogram({ pv, answer: { fit: found, answer } }, op, [from, to], op_unit, pv_unit) {
  const valve = pv.valve.slice(from, to);
  const gain = pv.integrating ? 1 : pv.kp;
  const seen = pv.integrating ? valve : pv.pv.slice(from, to);
  const quantile = (values, q) => values.sort((a, b) => a - b)[Math.round(q * (values.length - 1))];
  const middle = quantile(seen.map((y, i) => y - gain * valve[i]), 0.5);
  const ends = [0.05, 0.95].map((q) => (quantile([...seen], q) - middle) / gain).sort((a, b) => a - b);
  const shape = (width, kind) => {
    const half = width / 2;
    const corners = [[ends[0], half], [ends[1], half], [ends[1], -half], [ends[0], -half], [ends[0], half]];
    return { kind, points: corners.map(([v, side]) => [v + side, middle + gain * v]) };
  };
  const shapes = [];
  if (answer.width !== null) shapes.push(shape(answer.width, "fitted"));
  for (const bound of [answer.low, answer.high]) {
    if (bound !== null && bound !== answer.width && answer.evidence !== "none") shapes.push(shape(bound, "limit"));
  }
  const every = Math.ceil(op.length / 4000);
  const few = (values) => values.filter((_, i) => i % every === 0);
  return [gapPicture(few(op), few(seen), shapes, { x: `OP [${op_unit}]`, y: `${pv.integrating ? "valve (model)" : "PV"} [${pv.integrating ? op_unit : pv_unit}]`, label: "PV against OP, with the fitted gap" }),
    h("p", { class: "note" }, answer.width === null ? "PV against OP. A gap shows as a parallelogram: at each turn PV stays while OP crosses it."
      : "PV against OP. The parallelogram is a slow cycle through the fitted gap; the dotted ones are its 95 % limits.")];
}

function likelihood(pv, found, answer, op_unit) {
  const widths = [...new Set(pv.candidates.flatMap((family) => family.d))].sort((a, b) => a - b);
  const lines = pv.candidates.map((_, i) => ({ label: `family ${i + 1}`, stroke: i ? "muted" : "signal", width: i ? 1 : 2.4 }));
  const drawn = pv.candidates.map((family) => widths.map((d) => {
    const at = family.d.indexOf(d);
    return at < 0 ? undefined : family.rise[at] + family.delta_deviance;
  }));
  const sorted = [...pv.candidates[0].rise].sort((a, b) => a - b);
  const top = Math.max(sorted[Math.floor(0.6 * (sorted.length - 1))], found.lr_needed ?? 0, 12);
  const bands = found.low === null || answer.evidence === null ? null : [[found.low, found.high ?? pv.range, "estimate"]];
  chart($("likelihood"), [widths, ...drawn], lines, { y: "rise of −2·ln L", x: `width of the gap [${op_unit}]`, height: 280, bands, legend: false, limits: [-0.05 * top, 1.3 * top] });
}

// --- the report, a file of its own

/** Save the page without scripts: canvases as images. */
function save() {
  const copy = $("result").cloneNode(true);
  const drawn = $("result").querySelectorAll("canvas");
  copy.querySelectorAll("canvas").forEach((canvas, i) => {
    const image = h("img", { src: drawn[i].toDataURL("image/png"), style: "width:100%" });
    (canvas.closest(".plot") ?? canvas).replaceChildren(image);
  });
  copy.querySelectorAll(".screen").forEach((node) => node.remove());
  const policy = "default-src 'none'; style-src 'unsafe-inline'; img-src data:";
  const style = [...document.querySelectorAll("style")].map((node) => node.textContent).join("\n");
  const text = `<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><meta http-equiv="Content-Security-Policy" content="${policy}">`
    + `<meta name="viewport" content="width=device-width, initial-scale=1"><title></title><style>${style}</style></head><body><main>${copy.innerHTML}</main></body></html>`;
  const address = URL.createObjectURL(new Blob([text], { type: "text/html" }));
  h("a", { href: address, download: `${file.name.replace(/\.[^.]+$/, "")}.report.html` }).click();
  setTimeout(() => URL.revokeObjectURL(address), 60_000);
}

// --- dropping

async function given([one, ...more]) {
  if (!one) return;
  go("recording");
  if (more.length) {
    refuse(`${more.length + 1} files`, "one recording is read at a time: drop one of them");
    return;
  }
  try {
    await take(one.name, new Uint8Array(await one.arrayBuffer()));
  } catch (fault) { // a folder, or a file that is no longer there
    refuse(one.name, `cannot be read (${fault.message}): drop a file, from a place that this computer can read`);
  }
}
addEventListener("dragover", (event) => event.preventDefault());
addEventListener("drop", (event) => {
  event.preventDefault();
  given(event.dataTransfer.files);
});
$("file").addEventListener("click", (event) => { event.target.value = ""; }); // the same file again is a choice too
$("file").addEventListener("change", (event) => given(event.target.files));
$("example").addEventListener("click", () => take("FIC201.csv", new TextEncoder().encode($("example-data").textContent)));

// --- the two halves of the page

function go(name) {
  for (const half of ["recording", "laboratory"]) {
    $(half).hidden = half !== name;
    $(`go-${half}`).setAttribute("aria-selected", String(half === name));
  }
  dispatchEvent(new CustomEvent("gone", { detail: name }));
  redraw();
}
for (const half of ["recording", "laboratory"]) $(`go-${half}`).addEventListener("click", () => go(half));
