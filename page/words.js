// Numbers and sentences: those of crates/analysis, which stands here as WebAssembly. Nothing is worded on this side.
"use strict";

const DASH = "–";

/** Renderer of messages, and the labels that stand alone; there once `words_ready` of page.js is done. */
let tongue = null;
const words = {};

async function learn_words(module) {
  tongue = await Engine.of(module);
  const all = Object.entries(worded("catalogue"));
  const of = (subject) => Object.fromEntries(all.filter(([code]) => code.startsWith(`${subject}.`)).map(([code, text]) => [code.slice(subject.length + 1), text]));
  const [labels, meanings] = ["half_period", "half_period_meaning"].map(of);
  words.reasons = Object.fromEntries(Object.keys(labels).map((name) => [name, { label: labels[name], meaning: meanings[name] }]));
  words.verdicts = of("verdict");
  const { likely, likely_sound } = of("answer");
  words.likely = { likely, likely_sound };
}

/** The one verdict, as every list shows it. */
const verdict = (answer) => words.likely[answer.confidence] ?? words.verdicts[answer.verdict];

const worded = (what, ...given) => tongue.ask("words", given.length ? { [what]: given.length > 1 ? given : given[0] } : what);

/** Text of a number with `digits` significant digits, in plain notation unless it is very large or small. */
const number = (value, digits = 3) => worded("number", value ?? null, digits);

/** A quantity with its unit, a no-break space between. */
const quantity = (value, unit, digits = 3) => worded("quantity", value ?? null, unit, digits);

/** A time span in the two largest units that fit. */
const duration = (seconds) => worded("duration", seconds);

/** A moment of the recording: local date and time where the first row has one [ms since 1970], else seconds. */
const moment = (t0, seconds) => worded("clock", t0 === null ? null : Math.round(1000 * t0), seconds);

const count = (n, noun) => worded("count", n, noun);

/** A reason as a sentence: a full stop, and a capital letter unless it starts with a file, a tag or a symbol. */
const sentence = (text) => (text ? worded("sentence", text) : "");

/** `%` alone would leave open of what. */
const ofOp = (unit) => (unit === "%" ? "%OP" : unit);

/** A finding of the reader, in one sentence. */
const finding = ({ code, severity, evidence, numbers }, reader) =>
  worded("text", { code: `quality.${code}`, numbers: { ...evidence, ...numbers, severity }, reader });
