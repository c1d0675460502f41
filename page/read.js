// A recording's file to columns, by the rules of python/glapp/reading, whose words and patterns come in `data`.
// tests/test_page_reading.py holds it to that reader, form by form. Times without a zone stay local.
"use strict";

const Reading = (data) => {
  const names_of = Names(data);
  const { understand, settle, groups, choose, withOwnQualities } = names_of;
  const cells_of = Cells(data, names_of.folded);
  const { NOT_AUTO, BAD, texts, isEmpty, taken, unitBehind, withoutUnit, numbers, flags, rule, holdsModes, clock } = cells_of;
  const tables_of = Tables(data, names_of, Heads(data, names_of, cells_of), cells_of);
  const { decoded, ofText, ofWorkbook, ofColumns } = tables_of;
  const Json = Structured(data, names_of, tables_of);
  const Pages = Markup(data, tables_of);
  const Points = Influx(data, names_of, tables_of);
  const { shaped } = Shape(data, names_of, cells_of);
  const NUMBERS = ["sp", "pv", "op", "position"];
  const WORDS = ["mode", "op_low_flag", "op_high_flag"];
  const MARKED = { sp: 1, pv: 2, op: 4 }; // bits of the marks
  const BEGINNING = 1 << 16; // characters that tell what a text is
  const SPARSE = data.heads.sparse; // share of rows without a number from which on they are another loop's
  const HEAD = 1000; // rows that tell what columns hold
  const { labels } = data.columns;

  // --- what a file is

  const begins = (bytes, mark) => mark.every((byte, i) => bytes[i] === byte);
  const ascii = (text) => [...text].map((letter) => letter.charCodeAt(0));
  const PACKED = [["gunzip", [0x1f, 0x8b]], ["unbzip2", ascii("BZh")], ["unzstd", [0x28, 0xb5, 0x2f, 0xfd]]];
  const BINARY = [["parquet", ascii("PAR1")], ["arrow", ascii("ARROW1")], ["arrow", [0xff, 0xff, 0xff, 0xff]]];

  function unpacked(bytes, how) {
    try {
      return Uint8Array.from(Formats[how](bytes));
    } catch (fault) {
      throw new InputError(`cannot be unpacked: ${fault.message}`);
    }
  }

  async function ofBinary(bytes, kind) {
    try {
      const { names, columns } = await Formats[kind](bytes);
      return { ...ofColumns(names, columns), typed: true };
    } catch (fault) {
      if (fault instanceof InputError) throw fault;
      throw new InputError(`is not a readable ${kind === "arrow" ? "Arrow" : "Parquet"} file: ${fault.message}`);
    }
  }

  /** Reader for a text that is read whole, by its beginning; undefined for a table of text. */
  function wholly(beginning) {
    if (Points.isAnnotated(beginning)) return Points.annotated;
    if (Points.isLineProtocol(beginning)) return Points.lineProtocol;
    if (Pages.isMarkup(beginning)) return Pages.tableOf;
    return Json.begins(beginning) ? (text) => {
      const of = Json.parsed(text);
      return of === undefined ? ofText(text) : Json.tableOf(of);
    } : undefined;
  }

  /** A table of text, JSON, a web page or an export of InfluxDB. */
  function ofWritten(bytes) {
    const text = decoded(bytes);
    const read = wholly(text.slice(0, BEGINNING).trimStart());
    const most = data.bounds.whole;
    if (read && bytes.length > most) {
      const what = `has ${bytes.length >> 20} MiB, and what is read whole at most ${most >> 20} MiB`;
      throw new InputError(what, { hint: "export less at a time, or write CSV or Parquet" });
    }
    return (read ?? ofText)(text);
  }

  /** The tables of a file. */
  async function sources(bytes) {
    const [how] = PACKED.find(([, mark]) => begins(bytes, mark)) ?? [];
    if (how) return sources(unpacked(bytes, how));
    if (begins(bytes, ascii("PK\x03\x04"))) return ofWorkbook(bytes);
    if (begins(bytes, [0xd0, 0xcf, 0x11, 0xe0])) throw new InputError("is an old or a locked Office file", { hint: "save it as .xlsx or CSV, unlocked" });
    const [, what, hint] = data.kinds.beginnings.find(([start]) => begins(bytes, ascii(start))) ?? [];
    if (what) throw new InputError(what, { hint });
    const [kind] = BINARY.find(([, mark]) => begins(bytes, mark)) ?? [];
    return [kind ? await ofBinary(bytes, kind) : ofWritten(bytes)];
  }

  // --- loops

  /** Names, loops and guesses of a file: the questions before it is read. `stem`: the file's name without its
   * ending. */
  async function open(bytes, stem) {
    const tables = (await sources(bytes)).map(shaped);
    const loops = tables.flatMap((source) => {
      const names = source.tags ? [...source.tags.keys()] : withOwnQualities(source.names);
      const meanings = settle(names.map(understand), (i) => holdsModes(firstOf({ names, source }, i, HEAD)));
      if (!source.tags && source.time !== null) meanings.forEach((meaning, i) => { if ((meaning.role === "time") !== (i === source.time)) meaning.role = i === source.time ? "time" : null; });
      const of = groups(meanings);
      const plain = tables.length > 1 ? source.sheet : stem;
      return (of.length ? of : [""]).map((group) => ({ source, names, meanings, group, groups: of, name: group || (of.includes(plain) ? `${plain} (no prefix)` : plain) }));
    });
    return { loops };
  }

  // --- a recording

  /** Rows without PV, or without an SP that is recorded, are bad. `marks`: those of SP and OP whose quality is bad. */
  function finished(out, bits, marks = null) {
    let flagged = bits;
    let marked = marks;
    if (flagged?.some((bit) => bit & BAD)) {
      out.pv = out.pv.map((value, i) => (flagged[i] & BAD ? NaN : value));
      marked = Uint8Array.from(flagged, (bit, i) => (marks?.[i] ?? 0) | (bit & BAD ? MARKED.pv : 0));
    }
    const missing = (i) => Number.isNaN(out.pv[i]) || (out.sp !== undefined && Number.isNaN(out.sp[i]));
    if (out.pv.some((_, i) => missing(i))) {
      flagged = (flagged ?? new Uint8Array(out.t.length)).map((bit, i) => bit | (missing(i) ? BAD : 0));
    }
    if (flagged?.some(Boolean)) out.flags = flagged;
    if (marked?.some(Boolean)) out.marks = marked;
    return out;
  }

  /**
   * One loop's columns: t [s], sp, pv, op, position (NaN where missing), flags; `chosen` tells role to name.
   * `options`: loop (its place among the file's), columns (role to place among the loop's names, -1: none), sample_time
   * [s], time_format ("day first" or "month first").
   */
  function recording(file, options = {}) {
    const loop = file.loops[options.loop ?? 0];
    const { names, meanings, group, groups: of, source } = loop;
    if (source.nameless && options.columns?.pv === undefined) throw source.nameless;
    const only = source.tags ? ["time", "quality"] : [];
    const kind = source.tags && !source.column ? "tag" : "column";
    const chosen = choose(names, meanings, of, group, options.columns ?? {}, only, kind);
    const read = source.tags ? ofTags(source, names, chosen, options) : wide(source, names, chosen, options);
    const unit = (role) => (chosen[role] === undefined ? null : read.unit(chosen[role]));
    const called = Object.fromEntries(Object.entries(chosen).map(([role, at]) => [role, names[at]]));
    if (source.tags && source.dated) called.time = source.times;
    const units = Object.fromEntries(Object.keys(chosen).map((role) => [role, unit(role)]).filter(([, one]) => one));
    checkOneUnit(units, { [kind]: called.sp });
    return { columns: read.columns, found: read.found, t0: read.t0, chosen: called, units, loop: loop.name };
  }

  /** Refuses an SP in another unit than PV, where the file states both. */
  function checkOneUnit({ sp, pv }, place) {
    if (!sp || !pv) return;
    const { units: known, any_unit: any, same_units: same } = data.heads;
    const [ours, theirs] = [sp, pv].map(names_of.folded);
    if ([ours, theirs].some((one) => !known.includes(one) || any.includes(one)) || (same[ours] ?? ours) === (same[theirs] ?? theirs)) return;
    throw new InputError(`SP is in ${sp} and PV in ${pv}, must be in one unit`, { ...place, hint: "export both in one unit; where the file states a wrong one, correct it there" });
  }

  const finding = (code, severity, evidence, numbers = {}) => ({ code, severity, evidence, numbers });

  const unusedTime = (sample_time, column) => (sample_time > 0 ? [finding("setting_unused", "warning", { setting: "sample_time", value: String(sample_time) }, { column })] : []);

  const newestFirst = (column) => finding("newest_first", "info", { column });

  /** Whether no time is later than the one before it, of each of these columns, and some are earlier. */
  function fall(columns) {
    const falls = (later) => (t) => t.some((value, i) => i > 0 && (later ? value > t[i - 1] : value < t[i - 1]));
    return !columns.some(falls(true)) && columns.some(falls(false));
  }

  /** Refuses a PV without a value, as without_value() does; `bits`: of its rows, those of bad quality. */
  function checkAlive(pv, bits, where) {
    const known = (i) => Number.isFinite(pv[i]) && !(bits?.[i] & BAD);
    if (pv.some((_, i) => known(i))) return;
    const [rows, marked] = [pv.length, bits?.filter((bit) => bit & BAD).length ?? 0];
    if (!marked) throw new InputError(`has no value in any of ${rows} rows`, { ...where, hint: `is it the right ${Object.keys(where)[0]}?` });
    throw new InputError(`has no value of good quality in any of ${rows} rows, and one of bad quality in ${marked}`, { ...where, hint: "repair the signal, or check which quality codes mean good" });
  }

  /** The unit that stands behind the number in every first cell of a signal. */
  const endOf = (source, column) => (source.typed || column.kind !== "text" ? null : unitBehind(column.cells.slice(0, HEAD).filter(Boolean)));

  /** Numbers of a signal, without the unit behind them. */
  const signal = (column, end, digits) => numbers(end === null ? column : withoutUnit(column, end), digits);

  /** A loop of a table with a column per signal. */
  function wide(source, names, chosen, { sample_time, time_format }) {
    const { units, digits, line } = source;
    const ends = new Map(NUMBERS.filter((one) => one in chosen).map((one) => [chosen[one], endOf(source, source.columns[chosen[one]])]));
    const used = Object.values(chosen).map((at) => source.columns[at]);
    let rows = Array.from(used[0].cells, (_, row) => row).filter((row) => used.some((column) => !isEmpty(column, row)));
    if (rows.length < 2) throw new InputError(rows.length ? "has only one row" : "has no rows", { hint: "a recording needs many rows" });
    const column = (at) => taken(source.columns[at], rows);
    const out = {};
    let role = "time";
    let bits = null;
    let time = { t0: null, found: [] };
    try {
      if (chosen.time !== undefined) {
        const at = chosen.time;
        const read = () => {
          time = clock(column(at), names[at], units[at] ?? understand(names[at]).unit, time_format);
          out.t = time.read(column(at));
        };
        read();
        const turned = fall([out.t]);
        if (turned) {
          rows.reverse();
          read();
        }
        time.found = [...(turned ? [newestFirst(names[at])] : []), ...time.found, ...unusedTime(sample_time, names[at])];
      } else if (sample_time > 0) {
        out.t = Float64Array.from(rows, (_, i) => i * sample_time);
      } else {
        throw new InputError(`no time column among: ${names.slice(0, 20).join(", ")}`, { hint: "choose it below, or give the sample time" });
      }
      const signals = NUMBERS.filter((one) => one in chosen).map((one) => source.columns[chosen[one]]);
      const without = (row) => signals.every((column) => isEmpty(column, row));
      const share = rows.slice(0, HEAD).filter(without).length / Math.min(rows.length, HEAD);
      if (chosen.time !== undefined && share > SPARSE && share < 1) { // most rows are another loop's
        out.t = out.t.filter((_, i) => !without(rows[i]));
        rows = rows.filter((row) => !without(row));
      }
      for (role of Object.keys(chosen)) {
        const at = chosen[role];
        if (NUMBERS.includes(role)) out[role] = signal(column(at), ends.get(at), digits);
        else if (role !== "time") {
          const found = flags(column(at), rule(role, column(at), names[at]));
          bits = bits === null ? found : bits.map((bit, i) => bit | found[i]);
        }
      }
    } catch (fault) {
      if (!(fault instanceof CellFault)) throw fault;
      throw new InputError(fault.message, { row: line(rows[fault.index]), column: names[chosen[role]], hint: fault.hint });
    }
    checkAlive(out.pv, bits, { column: names[chosen.pv] });
    return { columns: finished(out, bits), t0: time.t0, found: time.found, unit: (at) => units[at] || ends.get(at) || null };
  }

  // --- tags with times of their own: long.py

  const { common: COMMON, more: MORE } = data.long;

  /** The last of these times at or before each of those; -1 where there is none. Both in order, or the times alone. */
  function lastAt(times, asked) {
    return Int32Array.from(asked, (t) => {
      let [low, high] = [0, times.length];
      while (low < high) {
        const middle = (low + high) >> 1;
        if (times[middle] <= t) low = middle + 1;
        else high = middle;
      }
      return low - 1;
    });
  }

  const rising = (t, strictly) => t.every((value, i) => i === 0 || (strictly ? value > t[i - 1] : value >= t[i - 1]));

  function inOrder(tag) {
    if (rising(tag.t, false)) return tag;
    const order = Array.from(tag.t, (_, i) => i).sort((a, b) => tag.t[a] - tag.t[b] || a - b);
    return Object.fromEntries(Object.entries(tag).map(([name, values]) => [name, values.constructor.from(order, (i) => values[i])]));
  }

  /** PV at its own times and at these, on the straight line between two samples; missing beside a missing one. */
  function joined(pv, between) {
    const t = Float64Array.from(new Set([...pv.t, ...between])).sort();
    const known = (i) => (pv.bad[i] ? NaN : pv.value[i]);
    const before = lastAt(pv.t, t);
    const value = t.map((at, i) => {
      const k = before[i];
      if (pv.t[k] === at) return known(k);
      return known(k) + ((at - pv.t[k]) / (pv.t[k + 1] - pv.t[k])) * (known(k + 1) - known(k));
    });
    const bad = t.map((at, i) => Number.isNaN(value[i]) && (pv.bad[before[i]] || (pv.t[before[i]] !== at && pv.bad[before[i] + 1])));
    return { t, value, bad: Uint8Array.from(bad) };
  }

  /** The samples of the tags of a loop: times, values, and which are bad. */
  function samplesOf(source, names, chosen, time) {
    const { columns, digits } = source;
    const tags = {};
    for (const [role, at] of Object.entries(chosen)) {
      const { rows, ...of } = source.tags.get(names[at]);
      if (!rows.length && !["sp", "pv"].includes(role)) continue;
      if (!rows.length) throw new InputError("has no row", { tag: names[at] });
      let column = source.times;
      try {
        const t = time.read(taken(columns[of.time], rows));
        column = source.names[of.quality] ?? "quality";
        const held = of.quality === undefined ? null : columns[of.quality];
        const first = held && { ...held, cells: held.cells.slice(0, HEAD) };
        const bad = held ? flags(taken(held, rows), rule("quality", first, column, source.marked)).map((bit) => (bit ? 1 : 0)) : new Uint8Array(rows.length);
        column = names[at];
        const cells = taken(columns[of.value], rows);
        tags[role] = { t, value: WORDS.includes(role) ? Float64Array.from(flags(cells, rule(role, cells, column))) : numbers(cells, digits), bad };
      } catch (fault) {
        throw placed(fault, source, rows, column);
      }
    }
    return tags;
  }

  /** A cell's fault with its row and column; any other as it is. */
  const placed = (fault, { line }, rows, column) => (fault instanceof CellFault ? new InputError(fault.message, { row: line(rows[fault.index] ?? 0), column, hint: fault.hint }) : fault);

  function clockOf(source, time_format) {
    const unit = source.units[source.time] ?? understand(source.times).unit;
    if (source.head.cells.length < 2) throw new InputError(source.head.cells.length ? "has only one row" : "has no rows");
    try {
      return clock(source.head, source.times, unit, time_format);
    } catch (fault) {
      throw placed(fault, source, [0], source.times);
    }
  }

  /** A loop whose tags have times of their own: PV's are the rows, and the others keep their last value. */
  function ofTags(source, names, chosen, { sample_time, time_format }) {
    const time = clockOf(source, time_format);
    const tags = samplesOf(source, names, chosen, time);
    const turned = fall(Object.values(tags).map(({ t }) => t));
    if (turned) {
      const every = Object.values(tags).flatMap(Object.values);
      for (const values of every) values.reverse();
      const first = time.t0 === null ? 0 : Math.min(...Object.values(tags).map(({ t }) => t[0]));
      for (const { t } of Object.values(tags)) t.forEach((value, i) => { t[i] = value - first; });
      if (time.t0 !== null) time.t0 += 1000 * first;
    }
    time.found = [...(turned ? [newestFirst(source.times)] : []), ...time.found, ...unusedTime(sample_time, source.times)];
    let { pv } = tags;
    checkAlive(pv.value, Uint8Array.from(pv.bad, (bad) => (bad ? BAD : 0)), { tag: names[chosen.pv] });
    const signals = ["sp", "op"].filter((role) => role in tags);
    for (const role of Object.keys(tags)) if (role !== "pv") tags[role] = inOrder(tags[role]);
    const count = pv.t.length;
    let own = signals.some((role) => {
      const having = new Set(tags[role].t);
      return pv.t.filter((t) => having.has(t)).length / count < COMMON;
    });
    if (tags.op && rising(pv.t, true)) {
      const between = tags.op.t.filter((t) => t > pv.t[0] && t < pv.t[count - 1]);
      if (between.length > MORE * count) {
        pv = joined(pv, between);
        own = true;
      }
    }
    const held = signals.map((role) => labels[role]).join(", ");
    const found = own ? [finding("own_times", "info", { held, pv_rows: count, rows: pv.t.length })] : [];
    const out = { t: pv.t, pv: pv.value };
    let bits = Uint8Array.from(pv.bad, (bad) => (bad ? BAD : 0));
    let marks = new Uint8Array(pv.t.length);
    for (const [role, tag] of Object.entries(tags)) {
      if (role === "pv") continue;
      const at = lastAt(tag.t, pv.t);
      const none = (i) => at[i] < 0 || tag.bad[at[i]];
      if (WORDS.includes(role)) { // an unknown mode is not automatic, an unknown limit flag is clear
        bits = bits.map((bit, i) => bit | (none(i) ? (role === "mode" ? NOT_AUTO : 0) : tag.value[at[i]]));
      } else {
        out[role] = Float64Array.from(at, (k, i) => (none(i) ? NaN : tag.value[k]));
        marks = marks.map((mark, i) => mark | (at[i] >= 0 && tag.bad[at[i]] ? (MARKED[role] ?? 0) : 0));
      }
    }
    return { columns: finished(out, bits, marks), t0: time.t0, found: [...time.found, ...found], unit: (at) => source.tags.get(names[at]).unit ?? understand(names[at]).unit };
  }

  /** The first cells of one of a loop's columns, as text. */
  function firstOf({ names, source }, i, count) {
    const tag = source.tags?.get(names[i]);
    const { cells, ...column } = source.columns[tag ? tag.value : i];
    const rows = tag ? tag.rows.slice(0, count) : Array.from({ length: count }, (_, row) => row);
    return texts(taken({ ...column, cells }, rows.filter((row) => row < cells.length)));
  }

  /** The first cells of each of a loop's columns, as text. */
  function firstRows(loop, count) {
    const columns = loop.names.map((_, i) => firstOf(loop, i, count));
    return Array.from({ length: count }, (_, row) => columns.map((cells) => cells[row] ?? ""));
  }

  return { understand, open, recording, firstRows };
};
