// Reads and analyses beside the page, so that the page stays awake and can end it.
"use strict";

const AT_ONCE = 65_536; // rows handed on at once, as the command line does
const SHOWN = 5; // rows that a person sees beside the choice of columns

let engine = null;
let reading = null;
let file = null;
let current = null; // the recording whose windows are being fitted: what its answer is shown with

const tell = (kind, more = {}) => postMessage({ kind, ...more });

const does = {
  async begin({ module, data }) {
    engine = await Engine.of(module);
    reading = Reading(data);
    tell("ready");
  },

  async open({ bytes, stem }) {
    tell("progress", { stage: "Reading", share: 0 });
    file = await reading.open(new Uint8Array(bytes), stem);
    const shown = (loop) => ({ name: loop.name, names: loop.names, tags: loop.source.tags !== undefined, rows: reading.firstRows(loop, SHOWN) });
    tell("opened", { loops: file.loops.map(shown) });
  },

  analyse({ options, task, turn }) {
    const began = performance.now();
    const read = reading.recording(file, options);
    const { columns } = read;
    const n = columns.t.length;
    tell("progress", { stage: "Looking at quality and controller", share: 0.1 });
    const { op_unit: typed, ...known } = task;
    let unit;
    const crossings = (fit) => {
      for (const [name, numbers] of Object.entries(columns)) engine.column(name, numbers);
      unit = engine.ask("begin", { task: { ...known, fit }, op_unit: typed || read.units.op || null });
      for (let from = 0; from < n; from += AT_ONCE) engine.ask("rows", { from, to: Math.min(n, from + AT_ONCE) });
    };
    // The fit takes long: the answer of the crossings alone is shown before it.
    if (columns.op && n <= AT_ONCE) {
      crossings(false);
      tell("first", { ...engine.ask("finish", { reader: reader_of({ read, unit }) }), read, unit, took: performance.now() - began });
    }
    crossings(true);
    tell("progress", { stage: "Fitting the gap", share: null });
    current = { read, unit, began };
    fit_windows({ turn });
  },

  /** Fits a window by itself, which needs nothing of its recording. */
  async alone({ module, window, place }) {
    engine ??= await Engine.of(module);
    tell("alone", { place, alone: engine.ask("alone", { window }) });
  },

  /** Joins the answers of the windows that are fitted. */
  join({ alone, so_far = null }) {
    if (so_far === null) answered("join", { alone });
    else {
      const joined = answer("join", { alone });
      if (joined.pv !== null) tell("so_far", { ...joined, windows: so_far, of: alone.length });
    }
  },

  /** Columns that are there already, from the laboratory. */
  fit({ columns, task }) {
    current = { read: { loop: "The loop", units: { pv: "%" }, t0: null }, unit: "%", began: performance.now() };
    for (const [name, numbers] of Object.entries(columns)) engine.column(name, numbers);
    engine.ask("begin", { task });
    engine.ask("rows", { from: 0, to: columns.t.length });
    fit_windows();
  },
};

/** The answer on the current recording. */
function answer(what, more) {
  const { read, unit, began } = current;
  return { ...engine.ask(what, { ...more, reader: reader_of(current) }), read, unit, took: performance.now() - began };
}

const answered = (what, more) => tell("answered", answer(what, more));

/** Hands out the windows that are to be fitted; answers where there are none. */
function fit_windows(more) {
  const windows = engine.ask("windows");
  if (windows.length) tell("windows", { windows, ...more });
  else answered("finish");
}

onmessage = async ({ data: { kind, ...more } }) => {
  try {
    await does[kind](more);
  } catch (wrong) {
    const foreseen = wrong instanceof InputError || !(wrong instanceof WebAssembly.RuntimeError);
    tell("wrong", { text: foreseen ? wrong.message : `the analysis broke off (${wrong.message}): please report it with the recording` });
  }
};
