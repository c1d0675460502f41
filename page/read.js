// Text tables to columns, by the rules of python/glapp/reading, whose words and patterns come in `data`. tests/test_page.py
// holds it to that reader on the same files. Wide tables, one column a signal; times without a zone stay local.
"use strict";

/** What is wrong with a file or a cell: what, where, and what to do next. */
class InputError extends Error {
  constructor(what, { row, column, hint } = {}) {
    const place = [row === undefined ? "" : `row ${row}`, column ? `column '${column}'` : ""].filter(Boolean).join(", ");
    super((place ? `${place}: ` : "") + what + (hint ? `: ${hint}` : ""));
  }
}

/** A cell that cannot be used; `index` is its place among the rows of the table. */
class CellFault extends Error {
  constructor(index, what, hint) {
    super(what);
    Object.assign(this, { index, hint });
  }
}

const Reading = (data) => {
  const MOST_WORDS = 4; // "position de la vanne"
  const INSIDE = 6; // letters of a word that is a signal's in the middle of a name too
  const NOT_AUTO = 1;
  const BAD = 2;
  const NUMBERS = ["sp", "pv", "op", "position"];
  const NUMBER = /^(?:[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|[+-]?(?:inf|infinity))$/i;
  const PLAIN = /^[+-]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][+-]?\d+)?$/;
  const DECIMAL_COMMA = /^[+-]?\d*,\d+(?:[eE][+-]?\d+)?$/;
  const whole = (pattern, flags = "") => new RegExp(`^(?:${pattern})$`, flags);
  const UNIT = new RegExp(data.columns.unit);
  const TOKEN = new RegExp(data.columns.token, "g");
  const JOINED = whole(data.columns.joined, "i");
  const LAYOUT = whole(data.times.layout, "i");
  const CURRENT = new Set(data.columns.current);
  const LIMITS = new Set(data.columns.limits);
  const bad = new Set(data.values.bad);

  // --- columns

  /** The text without case, accents and spaces. */
  const folded = (text) =>
    text.toLowerCase().replaceAll("ß", "ss").normalize("NFKD").replace(/[\p{M}\s]/gu, "");

  const signal = (word) => (Object.hasOwn(data.columns.words, word) ? data.columns.words[word] : undefined);

  /** Whether the last words are a signal together: a Process Value is more than a Process. */
  const twoWords = (words) =>
    !signal(words.at(-2)) && [2, 3, MOST_WORDS].some((count) => signal(words.slice(-count).join("")));

  /** Whether a word is a signal's wherever in a name it stands. */
  const inside = (word) =>
    ["sp", "pv", "op"].includes(signal(word)) && (word.length >= INSIDE || ["sp", "sv", "pv", "op", "mv"].includes(word));

  /** What a column's name says: role, loop ("" where the name has no more to it), unit, and a word that is not sure. */
  function understand(name) {
    const none = { role: null, loop: "", unit: null, weak: null };
    let text = name.trim();
    let unit = null;
    const found = UNIT.exec(text);
    if (found) {
      text = text.slice(0, found.index);
      unit = found[1].trim() || null;
    }
    const tokens = [...text.matchAll(TOKEN)];
    const words = tokens.map((token) => folded(token[0]));
    if (!words.length) return none;
    const joined = words.join("");
    const weak = Object.hasOwn(data.columns.weak, joined) ? joined : null;
    const known = Object.hasOwn(data.columns.whole, joined) ? data.columns.whole[joined] : signal(joined);
    if (known || weak) return { role: known ?? null, loop: "", unit, weak };
    if (text.includes(",")) {
      const of = understand(text.slice(0, text.indexOf(",")));
      if (of.role !== null) return { ...none, role: of.role, loop: of.loop, unit };
    }
    const last = words.at(-1);
    const end = tokens.at(-1);
    while (words.length > 1 && CURRENT.has(words.at(-1)) && !twoWords(words)) {
      tokens.pop();
      words.pop();
    }
    if (words.some((word) => LIMITS.has(word))) return none;
    for (let count = Math.min(MOST_WORDS, words.length); count > 0; count -= 1) {
      let role = signal(words.slice(-count).join(""));
      let rest;
      if (role) rest = strip(text.slice(0, tokens.at(-count).index), false);
      else if ((role = signal(words.slice(0, count).join("")))) {
        rest = strip(text.slice(tokens[count - 1].index + tokens[count - 1][0].length), true);
      } else continue;
      const of = rest ? understand(rest) : none;
      if (role === "quality" && of.role !== null) {
        return of.role === "pv" ? { ...none, role: "quality", loop: of.loop } : none;
      }
      return { ...none, role, loop: of.role === role ? of.loop : rest, unit };
    }
    const to = tokens.at(-1);
    const one = JOINED.exec(text.slice(0, to.index + to[0].length));
    if (one) return { ...none, role: signal(one[2].toLowerCase()), loop: one[1], unit };
    if (Object.hasOwn(data.columns.weak, last)) return { ...none, loop: strip(text.slice(0, end.index), false), unit, weak: last };
    const places = words.flatMap((word, i) => (inside(word) ? [i] : []));
    if (places.length === 1) {
      const [i] = places;
      const before = strip(text.slice(0, tokens[i].index), false);
      const after = strip(text.slice(tokens[i].index + tokens[i][0].length), true);
      return { ...none, role: signal(words[i]), loop: `${before} ${after}`, unit };
    }
    return none;
  }

  /** The words that are not sure get the first of their roles that no other column of their loop has. */
  function settle(meanings) {
    const roles = new Map();
    const open = new Map();
    for (const { role, loop, weak } of meanings) {
      if (!roles.has(loop)) roles.set(loop, new Set());
      if (["sp", "pv", "op", "position"].includes(role)) roles.get(loop).add(role);
      if (weak) open.set(loop, (open.get(loop) ?? new Set()).add(weak));
    }
    for (const [loop, words] of open) {
      const have = roles.get(loop);
      if (!have.size && words.size < 3) continue;
      while (words.size) {
        const left = [...words].map((word) => [word, data.columns.weak[word].filter((role) => !have.has(role))]);
        const first = left.find(([, of]) => of.length);
        if (!first) break;
        const sure = left.filter(([, of]) => of.length === 1);
        for (const [word, of] of sure.length ? sure : [first]) {
          for (const one of meanings) if (one.loop === loop && one.weak === word && one.role === null) one.role = of[0];
          words.delete(word);
          have.add(of[0]);
        }
      }
    }
    return meanings;
  }

  function strip(text, both) {
    const separators = data.columns.separators;
    let [from, to] = [0, text.length];
    while (to > 0 && separators.includes(text[to - 1])) to -= 1;
    while (both && from < to && separators.includes(text[from])) from += 1;
    return text.slice(from, to);
  }

  /** Loops that have SP and PV, in the order in which they appear; where none has, those with PV and OP. */
  function groups(meanings) {
    const roles = new Map();
    for (const { role, loop } of meanings) {
      if (["sp", "pv", "op"].includes(role)) roles.set(loop, (roles.get(loop) ?? new Set()).add(role));
    }
    for (const kind of [["sp", "pv"], ["pv", "op"]]) {
      const having = [...roles].filter(([, have]) => kind.every((role) => have.has(role))).map(([loop]) => loop);
      if (having.length) return having;
    }
    return [];
  }

  /** Column for every role of one loop; what a person chose in `columns` wins, -1 says that there is none. */
  function choose(names, meanings, loops, loop, columns) {
    const chosen = {};
    for (const role of Object.keys(data.columns.labels)) {
      if (["tag", "value"].includes(role)) continue;
      if (columns[role] !== undefined) {
        if (columns[role] >= 0) chosen[role] = columns[role];
        continue;
      }
      const fits = (prefix) => meanings.flatMap((m, i) => (m.role === role && m.loop === prefix ? [i] : []));
      let found = role === "time" ? meanings.flatMap((m, i) => (m.role === "time" ? [i] : [])) : fits(loop);
      if (!found.length && role !== "time" && loops.length <= 1) found = fits("");
      if (found.length > 1) {
        const both = found.map((i) => `'${names[i]}'`).join(" and ");
        throw new InputError(`the columns ${both} could both be ${data.columns.labels[role]}`, { hint: "choose one below" });
      }
      if (found.length) chosen[role] = found[0];
    }
    if (chosen.pv === undefined || (chosen.sp === undefined && chosen.op === undefined)) {
      const missing = ["sp", "pv"].filter((role) => chosen[role] === undefined).map((role) => data.columns.labels[role]);
      throw new InputError(`no column for ${missing.join(" and ")} among: ${names.join(", ")}`, { hint: "choose it below" });
    }
    return chosen;
  }

  // --- text

  function encoding(raw) {
    const marks = [["utf-8", [0xef, 0xbb, 0xbf]], ["utf-16le", [0xff, 0xfe]], ["utf-16be", [0xfe, 0xff]]];
    for (const [name, mark] of marks) if (mark.every((byte, i) => raw[i] === byte)) return name;
    if (raw.includes(0)) {
      const zeros = (odd) => raw.filter((byte, i) => i % 2 === odd && byte === 0).length / Math.max(1, raw.length / 2);
      if (zeros(1) > 0.9) return "utf-16le";
      if (zeros(0) > 0.9) return "utf-16be";
      throw new InputError("is not a table of text");
    }
    const control = raw.filter((byte) => byte < 32 && ![9, 10, 12, 13].includes(byte)).length;
    if (control > 0.01 * raw.length) throw new InputError("is not a table of text");
    try {
      new TextDecoder("utf-8", { fatal: true }).decode(raw, { stream: true });
      return "utf-8";
    } catch {
      return "windows-1252";
    }
  }

  /** Rows of cells, each with the line on which it begins. */
  function cells(text, delimiter) {
    const rows = [];
    let line = 1;
    for (const row of Papa.parse(text, { delimiter, quoteChar: '"' }).data) {
      if (row.length > 1 || row[0] !== "") rows.push({ line, cells: row });
      line += 1 + row.reduce((sum, cell) => sum + (cell.includes("\n") ? cell.split("\n").length - 1 : 0), 0);
    }
    return rows;
  }

  /** The commonest of some numbers, the first of those that are as common. */
  function commonest(numbers) {
    const counts = new Map();
    for (const n of numbers) counts.set(n, (counts.get(n) ?? 0) + 1);
    return [...counts].reduce((best, one) => (one[1] > best[1] ? one : best), [0, 0]);
  }

  /** The separator that splits most rows into the same number of cells. */
  function separator(text) {
    let best = null;
    for (const delimiter of ["\t", ";", "|", ","]) {
      const rows = cells(text, delimiter);
      const [width, count] = commonest(rows.map((row) => row.cells.length));
      const score = count / Math.max(rows.length, 1);
      if (width > 1 && (best === null || score > best.score)) best = { score, delimiter };
    }
    if (best === null) {
      throw new InputError("has only one column", { hint: "separate the columns by comma, semicolon, tab or '|'" });
    }
    return best.delimiter;
  }

  const isData = (cell) => PLAIN.test(cell.trim()) || plan(cell.trim().replace(/\d/g, "0")) !== null;

  /** A table: names and units of its columns, and its rows. */
  function table(bytes) {
    const raw = bytes.subarray(0, 1 << 16);
    if (!raw.some((byte) => ![0, 9, 10, 13, 32].includes(byte))) throw new InputError("is empty");
    const text = new TextDecoder(encoding(raw)).decode(bytes).replace(/\r\n?/g, "\n");
    let sample = text.slice(0, 1 << 16);
    if (sample.length < text.length && sample.includes("\n")) sample = sample.slice(0, sample.lastIndexOf("\n"));
    const delimiter = separator(sample);
    const rows = cells(text, delimiter);
    const head = cells(sample, delimiter);
    const [width] = commonest(head.map((row) => row.cells.length));
    let start = head.findIndex((row) => row.cells.length === width);
    if (head.slice(0, start).some((row) => row.cells.length > width)) start = 0;
    const names = rows[start].cells.map((cell) => cell.split(/\s+/).filter(Boolean).join(" "));
    const meanings = settle(names.map(understand));
    if (rows[start].cells.some(isData) && !meanings.some((meaning) => meaning.role)) {
      const hint = "write the columns' names in the first row, for instance t,SP,PV,OP,MODE";
      throw new InputError("has no header: the first row holds data", { row: rows[start].line, hint });
    }
    let units = meanings.map((meaning) => meaning.unit);
    let body = rows.slice(start + 1);
    const isUnits = ({ cells: row }) => row.length === width && row.some((cell) => cell.trim()) && !row.some(isData);
    while (body.length && isUnits(body[0])) {
      units = body[0].cells.map((cell) => cell.replace(/^[ [\]()]+|[ [\]()]+$/g, "") || null);
      body = body.slice(1);
    }
    if (!body.length) throw new InputError("has a header but no rows");
    const ragged = body.find((row) => row.cells.length !== names.length);
    if (ragged) {
      const n = ragged.cells.length;
      const hint = ragged === body.at(-1) && n < names.length ? "the file ends in the middle of a row, is it still being written?" : undefined;
      throw new InputError(`has ${n} cell${n === 1 ? "" : "s"} where the header has ${names.length}`, { row: ragged.line, hint });
    }
    const seen = head.slice(start + 1).concat(rows.slice(-50)).flatMap((row) => row.cells.map((cell) => cell.trim()));
    const comma = seen.find((cell) => DECIMAL_COMMA.test(cell));
    const point = seen.some((cell) => cell.includes(".") && PLAIN.test(cell));
    if (comma !== undefined && point) {
      const hint = "write all numbers alike, without separators between thousands";
      throw new InputError(`'${comma}' and others have a decimal comma, others a decimal point`, { hint });
    }
    return { names, meanings, units, body, comma: !point };
  }

  // --- cells

  /** Numbers of a column, NaN where missing or not finite. */
  function numbers(column, comma) {
    return Float64Array.from(column, (cell, i) => {
      const text = cell.trim();
      if (bad.has(text.toLowerCase())) return NaN;
      const written = comma ? text.replaceAll(",", ".") : text;
      if (!NUMBER.test(written)) {
        throw new CellFault(i, `'${text}' is not a number`, "write bad values as empty, NaN or Bad");
      }
      const value = Number(written);
      return Number.isFinite(value) ? value : NaN;
    });
  }

  const word = (cell) => {
    const text = cell.trim().toLowerCase();
    return /^\d+\.0*$/.test(text) ? text.split(".")[0] : text;
  };

  /** One bit a cell, decided once a word. */
  function flags(column, decide) {
    const known = new Map();
    return Uint8Array.from(column, (cell, i) => {
      if (!known.has(cell)) known.set(cell, decide(word(cell), cell, i));
      return known.get(cell);
    });
  }

  function mode(text, cell, i) {
    if (data.values.auto.includes(text)) return 0;
    if (data.values.not_auto.includes(text) || bad.has(text)) return NOT_AUTO;
    throw new CellFault(i, `'${cell}' is not a mode known here`, "write AUTO and MAN, or choose no column for MODE");
  }

  /** OPC DA has its two bits of 192 set where good, OPC UA its two highest of 32 clear; the first rows decide. */
  function quality(first) {
    const da = first.some((text) => /^\d+$/.test(text) && Number(text) < 65536 && (Number(text) & 0xc0) === 0xc0);
    return (text, cell, i) => {
      if (/^\d+$/.test(text)) {
        const code = Number(text);
        if (da && code < 65536) return (code & 0xc0) === 0xc0 ? 0 : BAD;
        if (!da && (code === 0 || code >= 1 << 16)) return code < 2 ** 30 ? 0 : BAD;
      } else if (data.values.good.includes(text) || text.startsWith("good")) return 0;
      else if (data.values.poor.includes(text) || /^(bad|uncertain)/.test(text) || bad.has(text)) return BAD;
      throw new CellFault(i, `'${cell}' is not a quality known here`, "write Good and Bad, or choose no column for quality");
    };
  }

  const limit = (bit) => (text, cell, i) => {
    if (["1", "true", "on", "yes", "active", "limited"].includes(text)) return bit;
    if (["0", "false", "off", "no", "normal", "inactive", ""].includes(text)) return 0;
    throw new CellFault(i, `'${cell}' is not a limit flag`, "write 1 or 0");
  };

  // --- times

  const plans = new Map();

  /** Where in a stamp of one layout, its digits written 0, its parts are. */
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
    throw new CellFault(0, `'${texts[0]}' can be read day first or month first`, "write the times as 2024-01-31 13:45:00");
  }

  /** Stamps to whole seconds since 1970 and nanoseconds. */
  function stamps(texts) {
    const first = plan(texts[0].replace(/\d/g, "0"));
    if (first === null) {
      throw new CellFault(0, `'${texts[0]}' is not a time that is known here`, "write for instance 2024-01-31 13:45:00");
    }
    const zoned = first.of.zone !== undefined;
    const order = first.spans.a ? dayFirst(texts) : null;
    const seconds = new Float64Array(texts.length);
    const nanos = new Float64Array(texts.length);
    texts.forEach((text, i) => {
      const found = plan(text.replace(/\d/g, "0"));
      if (text === "") throw new CellFault(i, "the time is empty");
      if (found === null) throw new CellFault(i, `'${text}' is not a time that is known here`);
      const { of, spans: at, month } = found;
      if ((of.zone !== undefined) !== zoned) throw new CellFault(i, `'${text}' mixes times with and without a zone`);
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
      if (wrong) throw new CellFault(i, `'${text}' is not a date and time that exists`);
      let s = Date.UTC(year, m - 1, d, hour, part("M"), part("S")) / 1000;
      if (of.sign) s -= (of.sign === "-" ? -1 : 1) * (part("zh") * 3600 + part("zm") * 60);
      seconds[i] = s;
      nanos[i] = at.F ? part("F") * 10 ** (9 - (at.F[1] - at.F[0])) : 0;
    });
    return { seconds, nanos };
  }

  const COUNT = "format the column as date and time";

  /** What the numbers of a time column count, from their range, their steps, the column's name and its unit. */
  function form(x, name, unit) {
    const known = x.filter(Number.isFinite);
    const [low, high] = [known.reduce((a, b) => Math.min(a, b)), known.reduce((a, b) => Math.max(a, b))];
    for (const [exponent, epoch] of [[0, "s"], [3, "ms"], [6, "us"], [9, "ns"]]) {
      if (0.67e9 * 10 ** exponent <= low && high <= 4.2e9 * 10 ** exponent) return `epoch ${epoch}`;
    }
    const steps = known.slice(1).map((value, i) => Math.abs(value - known[i])).filter((step) => step > 0).sort((a, b) => a - b);
    const n = steps.length;
    const step = n ? (steps[(n - 1) >> 1] + steps[n >> 1]) / 2 : null;
    const counted = data.times.units[(unit ?? "").replace(/^[ .]+|[ .]+$/g, "").toLowerCase()] ?? null;
    for (const [calendar, zero] of Object.entries(data.times.calendars)) {
      if (zero + data.times.years[0] <= low && high <= zero + data.times.years[1]) {
        if (counted !== null && counted !== "days") return counted;
        const dated = data.times.dated.includes(name.trim().toLowerCase());
        const usual = step !== null && data.times.usual.some((s) => Math.abs((step * 86400) / s - 1) < 0.001);
        const sure = counted === "days" || (step !== null && (step < 0.004 || (step < 0.05 && (dated || usual))));
        return sure ? calendar : "seconds";
      }
    }
    if (counted !== null) return counted;
    if ((step !== null && step < 0.004 && low > 25569 && high < 80000) || high > 1e11) {
      throw new CellFault(0, `${x[0]} looks like a day number or a date, but of which calendar?`, COUNT);
    }
    return "seconds";
  }

  /** Seconds [s] of the rows, and the moment of the first in ms since 1970, null where it is not known. */
  function clock(column, name, unit) {
    const texts = column.map((cell) => cell.trim());
    if (!PLAIN.test(texts[0])) {
      const { seconds, nanos } = stamps(texts);
      const t = seconds.map((s, i) => ((s - seconds[0]) * 1e9 + (nanos[i] - nanos[0])) / 1e9);
      return { t, t0: seconds[0] * 1000 + nanos[0] / 1e6 };
    }
    const x = Float64Array.from(texts, (text, i) => {
      const value = Number(text.replaceAll(",", ".") || NaN);
      if (!Number.isFinite(value)) {
        throw new CellFault(i, text === "" ? "the time is empty" : `'${text}' is not a time like those before`);
      }
      return value;
    });
    const counted = form(x.slice(0, 4096), name, unit);
    if (counted in data.times.calendars) {
      const ms = x.map((value) => Math.round((value - data.times.calendars[counted]) * 86_400_000));
      return { t: ms.map((value) => (value - ms[0]) / 1000), t0: ms[0] };
    }
    if (counted.startsWith("epoch")) {
      const per = { s: 1, ms: 1e3, us: 1e6, ns: 1e9 }[counted.slice(6)];
      const scale = per <= 1000 ? 1e6 / per : 1;
      const ticks = x.map((value) => Math.round(value * scale));
      const per_second = per <= 1000 ? 1e6 : per;
      return { t: ticks.map((value) => (value - ticks[0]) / per_second), t0: (ticks[0] / per_second) * 1000 };
    }
    const seconds = data.times.elapsed[counted];
    return { t: seconds === 1 ? x : x.map((value) => value * seconds), t0: null };
  }

  // --- a recording

  /** Names, groups and guesses of a file: what is asked before it is read. */
  function open(bytes) {
    const read = table(bytes);
    return { ...read, loops: groups(read.meanings) };
  }

  /**
   * One loop's columns: t [s], sp, pv, op, position (NaN where missing), flags; `chosen` tells role to column.
   * `options`: loop (its prefix), columns (role to place of the column, -1: none), sample_time [s].
   */
  function recording(read, options = {}) {
    const { names, meanings, units, comma, loops } = read;
    const loop = options.loop ?? loops[0] ?? "";
    const chosen = choose(names, meanings, loops, loop, options.columns ?? {});
    const used = Object.values(chosen);
    const body = read.body.filter((row) => used.some((at) => row.cells[at].trim() !== ""));
    const column = (at) => body.map((row) => row.cells[at]);
    let role = "time";
    const out = { pv: null };
    let bits = null;
    let t0 = null;
    try {
      if (chosen.time !== undefined) {
        const at = chosen.time;
        ({ t: out.t, t0 } = clock(column(at), names[at], units[at] ?? meanings[at].unit));
      } else if (options.sample_time > 0) {
        out.t = Float64Array.from(body, (_, i) => i * options.sample_time);
      } else {
        throw new InputError(`no time column among: ${names.join(", ")}`, { hint: "choose it below, or give the sample time" });
      }
      for (role of Object.keys(chosen)) {
        const at = chosen[role];
        if (NUMBERS.includes(role)) out[role] = numbers(column(at), comma);
        else if (role !== "time") {
          const cellsOf = column(at);
          const rules = { mode, op_low_flag: limit(4), op_high_flag: limit(8) };
          const found = flags(cellsOf, rules[role] ?? quality(cellsOf.slice(0, 1000).map(word)));
          bits = bits === null ? found : bits.map((bit, i) => bit | found[i]);
        }
      }
    } catch (fault) {
      if (!(fault instanceof CellFault)) throw fault;
      throw new InputError(fault.message, { row: body[fault.index].line, column: names[chosen[role]], hint: fault.hint });
    }
    if (!out.pv.some(Number.isFinite)) {
      throw new InputError(`holds no number in ${body.length} rows`, { column: names[chosen.pv], hint: "is it the right column?" });
    }
    if (bits?.some((bit) => bit & BAD)) out.pv = out.pv.map((value, i) => (bits[i] & BAD ? NaN : value));
    const missing = (i) => Number.isNaN(out.pv[i]) || (out.sp !== undefined && Number.isNaN(out.sp[i]));
    if (out.pv.some((_, i) => missing(i))) {
      bits = (bits ?? new Uint8Array(out.t.length)).map((bit, i) => bit | (missing(i) ? BAD : 0));
    }
    if (bits?.some(Boolean)) out.flags = bits;
    const unitOf = (role) => (chosen[role] === undefined ? null : units[chosen[role]] || null);
    return { columns: out, chosen, loop, t0, units: { pv: unitOf("pv"), op: unitOf("op") } };
  }

  return { understand, open, recording };
};
