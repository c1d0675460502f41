// Numbers and sentences. The words come in `data.words`, from python/glapp: here they are only filled in.
"use strict";

const DASH = "–";

/** `toFixed` and `toExponential` with half to even, as Python rounds. */
function rounded(value, how, places) {
  const [near, mark] = [value[how](places), how === "toFixed" ? "" : "e"];
  const split = (text) => (mark ? text.split(mark) : [text, ""]);
  const [exact, power] = split(value[how](Math.min(places + 40, 100)));
  const cut = exact.length - (Math.min(places + 40, 100) - places);
  if (!/^50*$/.test(exact.slice(cut))) return near;
  const below = exact.slice(0, cut).replace(/\.$/, "");
  return Number(below.at(-1)) % 2 === 0 ? below + (mark && `${mark}${power}`) : near;
}

/** A number with so many significant digits, without an exponent where a person would use none. */
function number(value, digits = 3) {
  if (value === null || value === undefined || !Number.isFinite(value)) return DASH;
  if (value === 0) return "0";
  const exponent = Math.floor(Math.log10(Math.abs(value)));
  let text;
  if (exponent < -4 || exponent >= 6) {
    const [mantissa, power] = rounded(value, "toExponential", digits - 1).split("e");
    text = `${mantissa}e${power[0]}${power.slice(1).padStart(2, "0")}`;
  } else text = Number.isInteger(value) ? String(value) : rounded(value, "toFixed", Math.max(digits - 1 - exponent, 0));
  return text.replace(/^-/, "−");
}

/** The same with its unit, a no-break space between. */
function quantity(value, unit, digits = 3) {
  const text = number(value, digits);
  return text === DASH || !unit ? text : `${text}\u00a0${unit}`;
}

/** A time span in the two largest units that fit. */
function duration(seconds) {
  if (seconds < 120) return quantity(seconds, "s");
  let minutes = Math.round(seconds / 60);
  if (minutes < 60) return `${minutes} min`;
  let hours = Math.floor(minutes / 60);
  minutes %= 60;
  if (hours < 48) return minutes ? `${hours} h ${minutes} min` : `${hours} h`;
  const days = Math.floor((hours + Math.round(minutes / 60)) / 24);
  hours = (hours + Math.round(minutes / 60)) % 24;
  return hours ? `${days} d ${hours} h` : `${days} d`;
}

/** A moment of the recording: local date and time where the first row has one, else seconds. */
function moment(t0, seconds) {
  return t0 === null ? `${number(seconds, 6)} s` : new Date(t0 + 1000 * seconds).toISOString().slice(0, 19).replace("T", " ");
}

const count = (n, noun) => `${n} ${noun}${n === 1 ? "" : "s"}`;

/** `%` alone would leave open of what. */
const ofOp = (unit) => (unit === "%" ? "%OP" : unit);

/** A reason as a sentence: a full stop, and a capital letter unless it starts with a file, a tag or a symbol. */
function sentence(text) {
  if (!text) return "";
  const capital = /^\p{L}+(?=\s|$)/u.test(text) ? text[0].toUpperCase() + text.slice(1) : text;
  return /[.!?]$/.test(capital) ? capital : `${capital}.`;
}

/** Fills a sentence of Python's: `{name}` and `{name:.3g}`; formats as `formatted` and, of a finding, `OWN` know them. */
function filled(sentence, values) {
  return sentence.replace(/\{(\w+)(?::([^}]*))?\}/g, (_, name, format) => {
    const value = values[name];
    if (!format) return String(value);
    return (OWN[format] ?? ((x) => formatted(x, format)))(value);
  });
}

const FIRST_ROW = 2; // below a header, as a person counts rows

const OWN = {
  seconds: (s) => (s < 1000 ? `${formatted(s, ".3g")} s` : `${formatted(s, ".0f")} s`),
  share: (s) => (s >= 0.095 || s === 0 ? formatted(s, ".0%") : `${formatted(100 * s, ".2g")}%`),
  size: (x) => formatted(Math.abs(x), ".3g"),
  row: (row) => `row ${row + FIRST_ROW}`,
  rows: (rows) => rows.split(" ").filter(Boolean).map((row) => `row ${Number(row) + FIRST_ROW}`).join(", "),
  and: (text) => text.replaceAll(",", " and"),
};

/** A number by one of Python's formats g, f, e, d and %. */
function formatted(value, format) {
  const [, digits, kind] = /^(?:\.(\d+))?([gfed%])$/.exec(format);
  const places = digits === undefined ? 6 : Number(digits);
  if (kind === "d") return String(value);
  if (kind === "f") return rounded(value, "toFixed", places);
  if (kind === "%") return `${rounded(100 * value, "toFixed", places)}%`;
  const power = (text) => text.replace(/e([+-])(\d)$/, "e$10$2");
  if (kind === "e") return power(rounded(value, "toExponential", places));
  if (value === 0) return "0";
  const significant = Math.max(places, 1);
  const exponent = Number(rounded(value, "toExponential", significant - 1).split("e")[1]);
  const bare = (text) => (text.includes(".") ? text.replace(/\.?0+$/, "") : text);
  if (exponent < -4 || exponent >= significant) {
    const [mantissa, rest] = rounded(value, "toExponential", significant - 1).split("e");
    return power(`${bare(mantissa)}e${rest}`);
  }
  return bare(rounded(value, "toFixed", significant - 1 - exponent));
}

/** Which variant of a finding's sentence its numbers ask for, as `_VARIANTS` of glapp.quality. */
const VARIANT = {
  time_assumed: (n) => n.severity,
  own_times: (n) => (n.rows === n.pv_rows ? "" : "joined"),
  time_reversed: (n) => n.looks_like,
  time_repeated: (n) => n.severity,
  not_a_number: (n) => (n.rows === n.of ? "all" : ""),
  winding_up: (n) => (n.error > 0 ? "below" : ""),
  sampling: (n) => (n.ratio > 1 ? "slow" : ""),
  compressed_pv: (n) => n.looks_like,
  spikes: (n) => (n.count === 1 ? "one" : ""),
  settings: (n) => n.parameter,
};

/** A finding of the core in one sentence. */
function finding(one, { pv_unit, op_unit, t0 }) {
  const numbers = { ...one.evidence, ...one.numbers, severity: one.severity, pv_unit, op_unit };
  if (one.code === "time_reversed") {
    for (const name of ["from", "to"]) numbers[name] = t0 === null ? `${formatted(one.evidence[name], ".10g")} s` : moment(t0, one.evidence[name]);
  }
  if (one.code === "time_assumed") numbers.steps = numbers.step ? `steps by ${formatted(numbers.step, ".6g")}` : "does not step";
  if (["spikes", "shifts"].includes(one.code)) numbers.more = numbers.count > numbers.rows.split(" ").length ? " and more" : "";
  const { findings } = data.words;
  return filled(findings[`${one.code} ${VARIANT[one.code]?.(numbers)}`] ?? findings[one.code], numbers);
}

/** What the fit says in one sentence, as `_reason` of glapp.fit. */
function fitted(verdict, fit, pv, unit) {
  const { reasons_of_fit: known, may_be, times, unfit } = data.words;
  if (fit.why.code === "op_rests") return "OP stands still all the time: only an OP that moves shows a gap";
  if (fit.why.code === "unfit") {
    const [word, of] = fit.why.of;
    return filled(unfit[word] ?? unfit.few, { number: of, name: "PV" });
  }
  const often = (n) => times[n] ?? `${n} times`;
  const numbers = { ...pv, ...fit, unit, up: often(pv.traversals[0]), down: often(pv.traversals[1]) };
  const names = verdict === "cannot_tell" ? [pv.reason, "may_be"] : [`${verdict} ${pv.reason}`, verdict];
  numbers.most = filled(may_be[fit.high === null ? "any" : "up to"], numbers);
  numbers.against = filled(may_be[fit.low <= 0 || pv.reason === "families_disagree" ? "as well" : "less likely"], numbers);
  return filled(known[names.find((name) => name in known)], numbers);
}

/** Why the crossings say no more, as `_why` of glapp.estimate; null where nothing is against their estimate. */
function why_crossings(doc, units) {
  const { why } = doc;
  if (why === null) return null;
  const { why: known, reasons, identification } = data.words;
  if (why.code === "finding") return finding(doc.quality[why.of], units);
  if (why.code === "nothing_accepted") {
    const rejected = Object.entries(doc.reasons).sort((a, b) => b[1] - a[1]);
    const total = rejected.reduce((sum, [, n]) => sum + n, 0);
    if (!total) return "PV never crossed SP: there is no half-period to read a gap from";
    const causes = rejected.slice(0, 2).filter(([, n]) => n).map(([name, n]) => `${n} as ${reasons[name].label}`);
    return `none of ${total} half-periods was accepted: ${causes.join(" and ")}`;
  }
  if (why.code === "gain_too_low" && doc.controller.origins.kp === "assumed") return known["gain_too_low assumed"];
  const found = doc.identification?.reason;
  const numbers = { unit: units.unit, detections: doc.detections, n: doc.controller.n, ...why.of };
  if (found) numbers.reason = filled(identification[found.code], of_identification(doc.identification));
  return filled(known[why.code], numbers);
}

/** The numbers that a reason of the identification may tell. */
function of_identification({ values, settings, samples, reason }) {
  const out = { ...values, samples };
  for (const [name, interval] of Object.entries({ ...settings, ...reason.of })) {
    if (interval && typeof interval === "object" && "low" in interval) {
      const of = name.replace(/_interval$/, "");
      Object.assign(out, { [`${of}_low`]: interval.low, [`${of}_high`]: interval.high });
    } else out[name] = interval;
  }
  return out;
}
