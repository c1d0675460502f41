// Cells to numbers, flags and times: python/glapp/reading/values.py and times.py.
"use strict";

/** Error in a file or a cell: what, where, and what to do next. */
class InputError extends Error {
  constructor(what, { row, column, tag, hint } = {}) {
    const place = [row === undefined ? "" : `row ${row}`, column ? `column '${column}'` : "", tag ? `tag '${tag}'` : ""].filter(Boolean).join(", ");
    super((place ? `${place}: ` : "") + what + (hint ? `: ${hint}` : ""));
  }
}

/** A cell that cannot be used; `index` is its place among the cells at hand. */
class CellFault extends Error {
  constructor(index, what, hint) {
    super(what);
    Object.assign(this, { index, hint });
  }
}

/**
 * A column is { kind, cells }: "text" and its strings; "numbers", NaN where empty; "moments" in ms since 1970, NaN where
 * empty, `dates` where they have no time of day.
 */
const Cells = (data, folded) => {
  const NOT_AUTO = 1;
  const BAD = 2;
  const whole = (pattern, flags = "") => new RegExp(`^(?:${pattern})$`, flags);
  const NUMBER = new RegExp(data.values.number, "i");
  const PLAIN = whole(data.values.plain);
  const DECIMAL_COMMA = whole(data.values.decimal_comma);
  const SPACED = new RegExp(data.values.spaced);
  const SPACES = new RegExp(`[${data.values.spaces}]`, "g");
  const [THOUSANDS, GROUPED] = ["thousands", "grouped"].map((name) => Object.fromEntries(Object.entries(data.values[name]).map(([group, pattern]) => [group, new RegExp(pattern)])));
  const ANY_NUMBER = whole(data.heads.number);
  const LAYOUT = whole(data.times.layout, "i");
  const OF_DAY = whole(data.times.of_day, "i");
  const bad = new Set(data.values.bad);
  const validity = new Set(data.values.validity);
  const confidence = new Set(data.values.confidence);
  const SYSTEM = new RegExp(data.values.system);
  const WITH_UNIT = whole(data.values.with_unit);
  const UNITS = new Set(data.heads.units);

  const blank = (text) => text.replace(/[0-9]/g, "0");
  const looksLikeStamp = (text) => plan(blank(text.trim())) !== null;
  const isTimeOfDay = (text) => OF_DAY.test(text.trim());
  const isDate = (text) => {
    const found = plan(blank(text.trim()));
    return found !== null && found.spans.H === undefined;
  };
  /** Whether a cell is a number, a date or a time. */
  const isData = (cell) => ANY_NUMBER.test(cell.trim()) || looksLikeStamp(cell) || isTimeOfDay(cell);

  // --- columns

  const isoOf = (ms, dates) => (Number.isNaN(ms) ? "" : new Date(Math.round(ms)).toISOString().replace("T", " ").replace(dates ? / .*$/ : /(\.000)?Z$/, ""));

  /** The cells as text. */
  function texts({ kind, cells, dates }) {
    if (kind === "text") return cells;
    return Array.from(cells, kind === "numbers" ? (x) => (Number.isNaN(x) ? "" : String(x)) : (ms) => isoOf(ms, dates));
  }

  const isEmpty = ({ kind, cells }, i) => (kind === "text" ? cells[i].trim() === "" : Number.isNaN(cells[i]));

  /** These rows of a column. */
  const taken = (column, rows) => ({ ...column, cells: column.kind === "text" ? rows.map((row) => column.cells[row]) : Float64Array.from(rows, (row) => column.cells[row]) });

  // --- numbers

  /** Notation of the numbers in a table's cells: the marks of decimals and of thousands; "" where none tells. `placeOf`: row and column of a cell. */
  function digitsOf(cells, placeOf) {
    const shown = [];
    for (const [decimal, group] of [[",", "."], [".", ","]]) {
      const cell = cells.find((text) => THOUSANDS[group].test(text));
      if (cell !== undefined) shown.push({ decimal, group, cell });
    }
    const rest = cells.filter((cell) => !shown.some(({ group }) => THOUSANDS[group].test(cell) || GROUPED[group].test(cell)));
    const having = (mark, plain) => [...shown.filter(({ decimal }) => decimal === mark).map(({ cell }) => cell), ...rest.filter(plain)];
    const commas = having(",", (cell) => DECIMAL_COMMA.test(cell));
    const points = having(".", (cell) => cell.includes(".") && PLAIN.test(cell));
    if (commas.length && points.length) {
      const fewer = points.length < commas.length;
      const [[odd], mark, [usual], other] = fewer ? [points, "point", commas, "comma"] : [commas, "comma", points, "point"];
      throw new InputError(`'${odd}' has a decimal ${mark}, and others, such as '${usual}', a decimal ${other}`, { ...placeOf(odd), hint: "write all numbers alike" });
    }
    if (shown.length) return { decimal: shown[0].decimal, group: shown[0].group };
    return { decimal: commas.length ? "," : points.length ? "." : "", group: "" };
  }

  /** Whether a cell is a number, however its digits are parted. */
  const isNumber = (text) => PLAIN.test(text) || SPACED.test(text) || Object.values(THOUSANDS).some((one) => one.test(text));

  /** A number and the known unit that stands behind it in one cell; null where there is none. */
  function unitOf(cell) {
    const [, number, unit] = WITH_UNIT.exec(cell.trim()) ?? [];
    return unit !== undefined && UNITS.has(folded(unit)) ? [number, unit] : null;
  }

  /** The unit that stands behind most of these numbers; null where most have none. */
  function unitBehind(cells) {
    const counts = new Map();
    for (const cell of cells) {
      const unit = unitOf(cell)?.[1] ?? null;
      if (!bad.has(cell.trim().toLowerCase())) counts.set(unit, (counts.get(unit) ?? 0) + 1);
    }
    return [...counts].reduce((most, one) => (one[1] > most[1] ? one : most), [null, 0])[0];
  }

  /** A column of text without the unit behind its numbers. */
  function withoutUnit(column, unit) {
    const end = new RegExp(` ?${unit.replace(/[.*+?^${}()|[\]\\]/g, "\\$&")}\\s*$`);
    return { ...column, cells: column.cells.map((cell) => cell.replace(end, "")) };
  }

  /** Numbers of a column, NaN where missing or not finite. */
  function numbers(column, { decimal, group }) {
    if (column.kind === "numbers") return column.cells.map((x) => (Number.isFinite(x) ? x : NaN));
    if (column.kind === "moments") throw new CellFault(0, "holds dates, not numbers");
    return Float64Array.from(column.cells, (cell, i) => {
      const text = cell.trim();
      if (decimal === "." && /^[+-]?\d+(\.\d*)?$/.test(text)) return Number(text);
      if (bad.has(text.toLowerCase()) || SYSTEM.test(text)) return NaN;
      let written = text;
      if (SPACED.test(written)) written = written.replace(SPACES, "");
      const other = decimal === "." ? "," : ".";
      if (THOUSANDS[other].test(written)) written = written.replaceAll(other, "");
      if (group && GROUPED[group].test(written)) written = written.replaceAll(group, "");
      else if (!group && decimal === "," && GROUPED["."].test(written)) {
        throw new CellFault(i, `'${text}' may be with a decimal point, or thousands: other numbers have a decimal comma`, "write all numbers alike");
      }
      if (decimal !== ".") written = written.replaceAll(",", ".");
      const unit = NUMBER.test(written) ? null : unitOf(text)?.[1];
      if (unit) throw new CellFault(i, `'${text}' is in ${unit}, and others of its column are not`, "export the column in one unit");
      if (!NUMBER.test(written)) throw new CellFault(i, `'${text}' is not a number`, "write bad values as empty, NaN or Bad");
      const value = Number(written);
      return Number.isFinite(value) ? value : NaN;
    });
  }

  // --- flags

  const word = (cell) => {
    const text = cell.trim().toLowerCase();
    return /^\d+\.0*$/.test(text) ? text.split(".")[0] : text;
  };

  /** One bit a cell, decided once a word. */
  function flags(column, decide) {
    const known = new Map();
    return Uint8Array.from(texts(column), (cell, i) => {
      if (!known.has(cell)) known.set(cell, decide(word(cell), cell, i));
      return known.get(cell);
    });
  }

  /** Whether cells are modes of a controller, and no numbers of a signal: words, or both 0 and 1 and nothing else. */
  function holdsModes(cells) {
    const known = [...new Set(cells.map(word))].filter((text) => !bad.has(text));
    return [...known].sort().join(" ") === "0 1" || (known.length > 0 && !known.some(isNumber));
  }

  function mode(text, cell, i) {
    if (data.values.auto.includes(text)) return 0;
    if (data.values.not_auto.includes(text) || bad.has(text)) return NOT_AUTO;
    throw new CellFault(i, `'${cell}' is not a mode that glapp knows`, "write AUTO and MAN, or choose no column for MODE");
  }

  /**
   * OPC DA has its two bits of 192 set where good, OPC UA its two highest of 32 clear; the first rows decide. Where the
   * name says validity, 1 is good, and where it says confidence, 100. `marked`: a letter is not good, nothing is.
   */
  function quality(first, name, marked) {
    const sure = name.split(/[\s._/:-]+/).some((part) => confidence.has(folded(part)));
    const only_good = sure ? 100 : validity.has(folded(name)) ? 1 : null;
    const da = first.some((text) => /^\d+$/.test(text) && Number(text) < 65536 && (Number(text) & 0xc0) === 0xc0);
    return (text, cell, i) => {
      if (marked && text.length < 2) return text ? BAD : 0;
      if (only_good !== null && /^-?\d+$/.test(text)) return Number(text) === only_good ? 0 : BAD;
      if (/^\d+$/.test(text)) {
        const code = Number(text);
        if (da && code < 65536) return (code & 0xc0) === 0xc0 ? 0 : BAD;
        if (!da && (code === 0 || code >= 1 << 16)) return code < 2 ** 30 ? 0 : BAD;
      } else if (data.values.good.includes(text) || text.startsWith("good")) return 0;
      else if (data.values.poor.includes(text) || /^(bad|uncertain)/.test(text) || bad.has(text)) return BAD;
      throw new CellFault(i, `'${cell}' is not a quality that glapp knows`, "write Good and Bad, or choose no column for quality");
    };
  }

  const limit = (bit) => (text, cell, i) => {
    if (["1", "true", "on", "yes", "active", "limited"].includes(text)) return bit;
    if (["0", "false", "off", "no", "normal", "inactive", ""].includes(text)) return 0;
    throw new CellFault(i, `'${cell}' is not a limit flag`, "write 1 or 0");
  };

  /** Reader of a column of flags. */
  const rule = (role, column, name, marked) => ({ mode, op_low_flag: limit(4), op_high_flag: limit(8) })[role] ?? quality(texts(column).slice(0, 1000).map(word), name, marked);

  // --- times

  const plans = new Map();

  /** Parts of a stamp of one layout, its digits written 0. */
  function plan(layout) {
    if (!plans.has(layout)) {
      const found = LAYOUT.exec(layout);
      let made = null;
      if (found) {
        const of = found.groups;
        const name = of.n3 ?? of.n4;
        const month = name ? data.times.months[name.slice(0, 3).toLowerCase()] : null;
        if (!name || month !== undefined) made = { of, spans: spans(found, layout), month };
      }
      plans.set(layout, made);
    }
    return plans.get(layout);
  }

  function spans(found, layout) {
    const again = new RegExp(LAYOUT.source, "di").exec(layout);
    const out = {};
    for (const [key, span] of Object.entries(again.indices.groups)) {
      if (span && "ymdabHMSFz".includes(key[0]) && key !== "zone") out[key.replace(/[1-5]$/, "")] = span;
    }
    return out;
  }

  /** Which of the two leading numbers is the day, from the data alone. */
  function dayFirst(texts) {
    const dates = texts.flatMap((text) => {
      const found = /^(\d{1,2})([-/.])(\d{1,2})\2(\d{4}|\d\d)/.exec(text);
      return found ? [[Number(found[1]), Number(found[3]), Number(found[4]), found[2]]] : [];
    });
    if (dates.some((date) => date[3] === ".")) return true;
    const [first, second] = [0, 1].map((at) => dates.some((date) => date[at] > 12));
    if (first !== second) return first;
    if (!first) {
      const consecutive = [true, false].filter((day) => {
        const days = dates.map(([a, b, y]) => Date.UTC(2000 + (y % 100), (day ? b : a) - 1, day ? a : b) / 86_400_000);
        const steps = new Set(days.slice(1).map((d, i) => Math.abs(d - days[i])));
        steps.delete(0);
        return steps.size === 1 && steps.has(1);
      });
      if (consecutive.length === 1) return consecutive[0];
    }
    throw new CellFault(0, `'${texts[0]}' can be read day first or month first`, ORDER);
  }

  const ORDER = "choose below which comes first";

  /** Reads stamps as those of `first` are written: whole seconds since 1970 and nanoseconds. `format`: "day first" or "month first", where a person says so. */
  function stamps(first, format) {
    const beginning = first.find((text) => text !== "");
    if (beginning === undefined) throw new CellFault(0, "the time is empty");
    const sure = plan(blank(beginning));
    if (sure === null) throw new CellFault(0, `'${beginning}' is not a time that glapp can read`, "write for instance 2024-01-31 13:45:00");
    const zoned = sure.of.zone !== undefined;
    const by_format = { "day first": true, "month first": false }[format] ?? null;
    const order = by_format ?? (sure.spans.a ? dayFirst(first) : null);
    return (text, i) => {
      const found = plan(blank(text));
      if (text === "") throw new CellFault(i, "the time is empty");
      if (found === null) throw new CellFault(i, `'${text}' is not a time that glapp can read`);
      const { of, spans: at, month } = found;
      if ((of.zone !== undefined) !== zoned) throw new CellFault(i, `'${text}' has ${zoned ? "no" : "a"} zone, unlike the first row: mixed zones`);
      if (at.a && order === null) throw new CellFault(i, `'${text}' can be read day first or month first`, ORDER);
      const part = (key) => (at[key] ? Number(text.slice(...at[key])) : 0);
      let year = part("y");
      if (at.y[1] - at.y[0] === 2) year += year < 70 ? 2000 : 1900;
      const [d, m] = at.a ? (order ? ["a", "b"] : ["b", "a"]).map(part) : [part("d"), month ?? part("m")];
      let hour = part("H");
      const half = of.half?.toLowerCase();
      let wrong = year < 1700 || year > 2250 || m < 1 || m > 12 || part("M") > 59 || part("S") > 59;
      wrong ||= half ? hour < 1 || hour > 12 : hour > 23;
      if (half) hour = (hour % 12) + (half === "p" ? 12 : 0);
      wrong ||= d < 1 || d > new Date(Date.UTC(year, m, 0)).getUTCDate();
      if (wrong) throw new CellFault(i, `'${text}' read${at.a ? (order ? " day first" : " month first") : ""} is not a date and time that exists`);
      let s = Date.UTC(year, m - 1, d, hour, part("M"), part("S")) / 1000;
      if (of.sign) s -= (of.sign === "-" ? -1 : 1) * (part("zh") * 3600 + part("zm") * 60);
      return [s, at.F ? part("F") * 10 ** (9 - (at.F[1] - at.F[0])) : 0];
    };
  }

  const COUNT = "format the column as date and time";
  const HEAD = 1000; // rows that show what numbers of a column of times count

  /** The finding on the assumed unit of a time column. */
  const assumed = (column, first, step, calendar, sure, since) => ({
    code: "time_assumed",
    severity: sure ? "info" : "warning",
    evidence: { column, first, step: step ?? 0, read_as: sure ? calendar : "seconds" },
    numbers: { calendar, days: `${data.times.names[calendar]}, ${isoOf(Math.round(since * 86_400_000)).slice(0, 19)}` },
  });

  /** Unit of a time column's numbers, from their range, their steps, the column's name and its unit; and the finding
   * to report. */
  function form(x, name, unit, text) {
    const known = x.filter(Number.isFinite);
    const [low, high] = [known.reduce((a, b) => Math.min(a, b)), known.reduce((a, b) => Math.max(a, b))];
    for (const [exponent, epoch] of [[0, "s"], [3, "ms"], [6, "us"], [9, "ns"]]) {
      if (0.67e9 * 10 ** exponent <= low && high <= 4.2e9 * 10 ** exponent) return { counted: `epoch ${epoch}`, found: [] };
    }
    const steps = known.slice(1).map((value, i) => Math.abs(value - known[i])).filter((step) => step > 0).sort((a, b) => a - b);
    const n = steps.length;
    const step = n ? (steps[(n - 1) >> 1] + steps[n >> 1]) / 2 : null;
    const counted = data.times.units[(unit ?? "").replace(/^[ .]+|[ .]+$/g, "").toLowerCase()] ?? null;
    for (const [calendar, zero] of Object.entries(data.times.calendars)) {
      if (zero + data.times.years[0] <= low && high <= zero + data.times.years[1]) {
        if (counted !== null && counted !== "days") return { counted, found: [] };
        const dated = data.times.dated.includes(name.trim().toLowerCase());
        const usual = step !== null && data.times.usual.some((s) => Math.abs((step * 86400) / s - 1) < 0.001);
        const sure = counted === "days" || (step !== null && (step < 0.004 || (step < 0.05 && (dated || usual))));
        const found = sure || step === null || step < 0.05 || dated ? [assumed(name, text, step, calendar, sure, known[0] - zero)] : [];
        return { counted: sure ? calendar : "seconds", found };
      }
    }
    if (counted !== null) return { counted, found: [] };
    if (step !== null && step < 0.004 && low > 25569 && high < 80000) throw new CellFault(0, `${text} looks like a day number, but of which calendar?`, COUNT);
    if (high > 1e11) throw new CellFault(0, `${text} is too large for seconds`, COUNT);
    return { counted: "seconds", found: [] };
  }

  /** A clock of whole nanoseconds since 1970, of which a float holds only every 256th. */
  function nanoseconds(beginning, found, trimmed) {
    const n0 = BigInt(beginning);
    const read = (other) => Float64Array.from(trimmed(other), (text, i) => {
      if (!/^\d+$/.test(text)) throw new CellFault(i, text === "" ? "the time is empty" : `'${text}' is not a time like those before`);
      return Number(BigInt(text) - n0) / 1e9;
    });
    return { t0: Number(n0 / 1000n) / 1e3, found, read };
  }

  const whenMissing = (i) => { throw new CellFault(i, "the time is empty"); };

  /**
   * A clock of a column of times, from its first rows: `t0` is the moment of the first in ms since 1970, null where it is
   * not known; `read` gives seconds [s] of any of its rows; `found` has the findings on it.
   */
  function clock(column, name, unit, format) {
    if (column.kind === "moments") {
      const t0 = column.cells.find((ms) => !Number.isNaN(ms));
      if (t0 === undefined) throw new CellFault(0, "the time is empty");
      return { t0, found: [], read: ({ cells }) => cells.map((ms, i) => (Number.isNaN(ms) ? whenMissing(i) : (ms - t0) / 1000)) };
    }
    const first = texts(column).map((cell) => cell.trim());
    const beginning = first.find((text) => text !== "");
    if (beginning === undefined) throw new CellFault(0, "the time is empty");
    const trimmed = (other) => texts(other).map((cell) => cell.trim());
    if (!PLAIN.test(beginning)) {
      const of = stamps(first, format);
      const [s0, n0] = of(beginning, 0);
      const read = (other) => Float64Array.from(trimmed(other), (text, i) => {
        const [s, n] = of(text, i);
        return ((s - s0) * 1e9 + (n - n0)) / 1e9;
      });
      return { t0: s0 * 1000 + n0 / 1e6, found: [], read };
    }
    const numbersOf = (other) => Float64Array.from(trimmed(other), (text, i) => {
      const value = Number(text.replaceAll(",", ".") || NaN);
      if (!Number.isFinite(value)) throw new CellFault(i, text === "" ? "the time is empty" : `'${text}' is not a time like those before`);
      return value;
    });
    const head = Float64Array.from(first.slice(0, HEAD).filter((text) => PLAIN.test(text)), (text) => Number(text.replaceAll(",", ".")));
    const { counted, found } = form(head, name, unit, beginning);
    const [x0] = head;
    if (counted in data.times.calendars) {
      const ms = (x) => Math.round((x - data.times.calendars[counted]) * 86_400_000);
      return { t0: ms(x0), found, read: (other) => numbersOf(other).map((x) => (ms(x) - ms(x0)) / 1000) };
    }
    if (counted.startsWith("epoch")) {
      const per = { s: 1, ms: 1e3, us: 1e6, ns: 1e9 }[counted.slice(6)];
      if (per === 1e9 && [...first, beginning].every((text) => /^\d*$/.test(text))) return nanoseconds(beginning, found, trimmed);
      const per_second = per <= 1000 ? 1e6 : per;
      const ticks = (x) => Math.round(x * (per_second / per));
      return { t0: (ticks(x0) / per_second) * 1000, found, read: (other) => numbersOf(other).map((x) => (ticks(x) - ticks(x0)) / per_second) };
    }
    const seconds = data.times.elapsed[counted];
    return { t0: null, found, read: (other) => (seconds === 1 ? numbersOf(other) : numbersOf(other).map((x) => x * seconds)) };
  }

  return { NOT_AUTO, BAD, isData, isDate, isTimeOfDay, looksLikeStamp, texts, isEmpty, taken, digitsOf, isNumber, unitOf, unitBehind, withoutUnit, numbers, flags, rule, holdsModes, clock };
};
