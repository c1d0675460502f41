// A recording's file to columns, by the rules of python/glapp/reading, whose words and patterns come in `data`.
// tests/test_page_reading.py holds it to that reader, form by form. Times without a zone stay local.
"use strict";

const Reading = (data) => {
  const { folded, understand, settle, groups, choose, isLong } = Names(data);
  const cells_of = Cells(data, folded);
  const { NOT_AUTO, BAD, isData, isDate, isTimeOfDay, looksLikeStamp, texts, isEmpty, taken, digitsOf, numbers, flags, rule, word, clock } = cells_of;
  const NUMBERS = ["sp", "pv", "op", "position"];
  const WORDS = ["mode", "op_low_flag", "op_high_flag"];
  const SAMPLE = 1 << 16; // characters that tell how a text is written
  const HEAD = 1000; // rows that tell what columns hold
  const { labels } = data.columns;
  const tidy = (cell) => cell.split(/\s+/).filter(Boolean).join(" ");
  const bare = (cell) => cell.replace(/^[ [\]()]+|[ [\]()]+$/g, "");

  // --- where a table begins and ends: heads.py

  const UNITS = new Set(data.heads.units);
  const FOOTER = new Set(data.heads.footer);
  const { lines: LINES, short: SHORT, ahead: AHEAD } = data.heads;
  const filledOf = (cells) => cells.filter((cell) => cell.trim());
  const wordsAlone = (cells, width) => cells.length === width && filledOf(cells).length > 0 && !filledOf(cells).some(isData);
  const understood = (cells) => cells.map(understand).filter((meaning) => meaning.role !== null || meaning.weak !== null).length;

  /** Whether a line tells one thing of the export: words first, few cells. */
  const isLabel = (cells) => {
    const filled = filledOf(cells);
    return !filled.length || (filled.length <= 3 && !isData(filled[0]));
  };

  /** Whether a line says of its columns only which is the time and which the value. */
  const saysValue = (cells) => {
    const roles = filledOf(cells).map((cell) => understand(cell).role);
    return roles.filter((role) => role === "value").length > 1 && roles.every((role) => ["time", "value", "quality"].includes(role));
  };

  /** Names of two lines: a tag stands above the first of its columns. */
  function under(above, below) {
    let tag = "";
    return above.slice(0, below.length).map((top, i) => {
      tag = top || tag;
      const last = tidy(below[i]);
      return understand(last).role === "value" ? tag : `${tag} ${last}`.trim();
    });
  }

  const areUnits = (cells) => {
    const filled = filledOf(cells).map((cell) => folded(bare(cell)));
    return filled.filter((cell) => UNITS.has(cell)).length * 2 >= filled.length;
  };

  /** Names and units of a table whose first line of `width` cells is the row `start`, and how many rows stand above its own. */
  function headOf(rows, start, width) {
    let lines = [];
    for (let i = start; i < Math.min(rows.length, start + LINES); i += 1) {
      const { cells } = rows[i];
      const follow = () => rows.slice(i + 1, i + 1 + AHEAD).some((row) => wordsAlone(row.cells, width) && understood(row.cells) > 1);
      if (wordsAlone(cells, width)) lines.push(i);
      else if (!(isLabel(cells) && follow())) break;
    }
    if (!lines.length) lines = [start]; // the first line is all there is, and may hold years or numbers of columns
    const last = lines.at(-1);
    const together = new Set(lines);
    lines = lines.filter((i) => Array.from({ length: last - i }, (_, k) => i + k).every((k) => together.has(k)));
    const named = lines.reduce((best, i) => {
      const [a, b] = [best, i].map((k) => [understood(rows[k].cells), filledOf(rows[k].cells).length]);
      return b[0] > a[0] || (b[0] === a[0] && b[1] > a[1]) ? i : best;
    });
    let names = rows[named].cells.map(tidy);
    let units = names.map((name) => understand(name).unit);
    const below = lines.filter((i) => i > named);
    if (below.length && saysValue(rows[below[0]].cells)) names = under(names, rows[below.shift()].cells);
    else if (lines.includes(named - 1) && saysValue(rows[named].cells)) names = under(rows[named - 1].cells.map(tidy), rows[named].cells);
    const of_units = below.filter((i) => areUnits(rows[i].cells));
    const told = of_units.length ? of_units : below.filter((i) => rows[i].cells.every((cell) => cell.trim().length <= SHORT));
    if (told.length) units = rows[told.at(-1)].cells.map((cell) => bare(cell) || null);
    return { names, units, line: rows[named].line, rows: last + 1 };
  }

  /** Whether the rows begin with a number or a time: what does not is then no row. */
  function beginsWithData(rows, width) {
    const first = rows.slice(0, LINES).filter(({ cells }) => cells.length === width).map(({ cells }) => isData(cells[0]));
    return first.filter(Boolean).length * 2 > first.length;
  }

  function isFooter(cells, width, timed) {
    const filled = cells.flatMap((cell, i) => (cell.trim() ? [i] : []));
    if (!filled.length) return true;
    const first = cells[filled[0]];
    if (isData(first)) return false;
    if (FOOTER.has(folded(first.replace(/^[ :=]+|[ :=]+$/g, "")))) return true;
    return timed && filled[0] === 0 && (cells.length !== width || (width > 1 && filled.length === 1));
  }

  /** Number of rows before the remarks and totals below the last. */
  function bodyEnd(rows, width, timed) {
    let end = rows.length;
    while (end && isFooter(rows[end - 1].cells, width, timed)) end -= 1;
    return end;
  }

  const NO_HEADER = "write the columns' names in the first row, for instance t,SP,PV,OP,MODE";

  function checked({ names, line }) {
    if (names.some((name) => name && isData(name)) && !names.some((name) => understand(name).role)) {
      throw new InputError("has no header: the first row holds data", { row: line, hint: NO_HEADER });
    }
  }

  // --- text: csv.py

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

  const READ_ONLY = "is not a table of text, an Excel workbook, Parquet or Arrow";

  /** A text table. */
  function ofText(bytes) {
    const raw = bytes.subarray(0, SAMPLE);
    if (!raw.some((byte) => ![0, 9, 10, 13, 32].includes(byte))) throw new InputError("is empty");
    const text = new TextDecoder(encoding(raw)).decode(bytes).replace(/\r\n?/g, "\n");
    let sample = text.slice(0, SAMPLE);
    if (sample.length < text.length && sample.includes("\n")) sample = sample.slice(0, sample.lastIndexOf("\n"));
    const delimiter = separator(sample);
    let rows = cells(text, delimiter);
    const seen = cells(sample, delimiter);
    let [width] = commonest(seen.map((row) => row.cells.length));
    const timed = beginsWithData(seen, width);
    rows = rows.slice(0, Math.max(bodyEnd(rows, width, timed), 1));
    let start = rows.findIndex((row) => row.cells.length === width);
    if (rows.slice(0, start).some((row) => row.cells.length > width)) {
      start = 0; // not a title above the table, but a header with more names than cells: told as a ragged row
      width = rows[0].cells.length;
    }
    const head = headOf(rows, start, width);
    checked(head);
    const body = rows.slice(head.rows);
    if (!body.length) throw new InputError("has a header but no rows");
    const ragged = body.find((row) => row.cells.length !== width);
    if (ragged) {
      const n = ragged.cells.length;
      const hint = ragged === body.at(-1) && n < width ? "the file ends in the middle of a row, is it still being written?" : undefined;
      throw new InputError(`has ${n} cell${n === 1 ? "" : "s"} where the header has ${width}`, { row: ragged.line, hint });
    }
    const known = [...body.slice(0, seen.length), ...body.slice(-50)].flatMap((row) => row.cells.map((cell) => cell.trim()));
    const columns = head.names.map((_, i) => ({ kind: "text", cells: body.map((row) => row.cells[i]) }));
    return { names: head.names, units: head.units, columns, digits: digitsOf(known), line: (row) => body[row].line };
  }

  // --- workbooks: excel.py

  const ofDay = (ms) => new Date(ms).toISOString().slice(11, 23).replace(/\.000$/, "");

  /** A cell as a text file has it. */
  function asText(cell) {
    if (typeof cell === "string") return cell.trim();
    if (typeof cell !== "object") return String(cell);
    if ("span" in cell) return String(cell.span);
    if ("time" in cell) return ofDay(cell.time);
    const iso = new Date(cell.moment ?? cell.date).toISOString();
    return "date" in cell ? iso.slice(0, 10) : iso.slice(0, 23).replace("T", " ").replace(/\.000$/, "");
  }

  /** Cells as a column of one type; any other is text. */
  function typed(held) {
    const filled = held.filter((cell) => cell !== "");
    const all = (kind) => filled.every((cell) => typeof cell === "object" && kind in cell);
    const of = (kind, value) => ({ kind, cells: Float64Array.from(held, (cell) => (cell === "" ? NaN : value(cell))) });
    if (filled.every((cell) => typeof cell === "number")) return of("numbers", Number);
    if (all("span")) return of("numbers", (cell) => cell.span);
    const dated = (cell) => typeof cell === "object" && ("date" in cell || "moment" in cell);
    if (filled.every(dated) && filled.some((cell) => "moment" in cell)) return of("moments", (cell) => cell.moment ?? cell.date);
    return { kind: "text", cells: held.map(asText) };
  }

  function ofSheet({ name, first, rows }) {
    const width = rows[0].length;
    const seen = rows.slice(0, HEAD).map((row, i) => ({ line: first + i + 1, cells: row.map(asText) }));
    if (width < 2) throw new InputError("has only one column");
    const widest = Math.max(0, seen.findIndex(({ cells: row }) => row.filter(Boolean).length > 1));
    const head = headOf(seen, widest, width);
    checked(head);
    const ends = rows.slice(head.rows).map((row) => ({ cells: row.map(asText) }));
    while (ends.length && !ends.at(-1).cells.some(Boolean)) ends.pop();
    const body = rows.slice(head.rows, head.rows + bodyEnd(ends, width, beginsWithData(ends, width)));
    if (!body.length) throw new InputError("has a header but no rows");
    const kept = head.names.flatMap((of, i) => (of || body.some((row) => row[i] !== "") ? [i] : []));
    const columns = kept.map((i) => typed(body.map((row) => row[i])));
    const words_ = columns.flatMap(({ kind, cells: of }) => (kind === "text" ? of : [])).filter(Boolean);
    return {
      sheet: name, names: kept.map((i) => head.names[i]), units: kept.map((i) => head.units[i]), columns,
      digits: digitsOf(words_), line: (row) => first + head.rows + 1 + row,
    };
  }

  /** The sheets of a workbook that hold a table. */
  function ofWorkbook(bytes) {
    let held;
    try {
      held = Sheets.open(bytes);
    } catch (fault) {
      throw new InputError(`is not a readable Excel workbook: ${fault.message}`);
    }
    const made = [];
    let wrong = null;
    for (const sheet of held) {
      try {
        made.push(ofSheet(sheet));
      } catch (fault) {
        if (!(fault instanceof InputError)) throw fault;
        wrong ??= fault;
      }
    }
    if (!made.length) throw wrong ?? new InputError("has no sheet with a table");
    const having = made.filter(({ names }) => names.some((name) => ["pv", "op", "value"].includes(understand(name).role)));
    return having.length ? having : made;
  }

  // --- Parquet and Arrow: parquet.py

  const begins = (bytes, mark) => mark.every((byte, i) => bytes[i] === byte);
  const ascii = (text) => [...text].map((letter) => letter.charCodeAt(0));
  const PACKED = [["gunzip", [0x1f, 0x8b]], ["unbzip2", ascii("BZh")], ["unzstd", [0x28, 0xb5, 0x2f, 0xfd]]];

  function ofTable({ names, columns }) {
    const seen = columns.flatMap((column) => (column.kind === "text" ? column.cells.slice(0, HEAD).map((cell) => cell.trim()) : []));
    return { names, units: names.map(() => null), columns, digits: digitsOf(seen), line: (row) => row + 1 };
  }

  /** The tables of a file. */
  async function sources(bytes) {
    const [how] = PACKED.find(([, mark]) => begins(bytes, mark)) ?? [];
    if (how) {
      let unpacked;
      try {
        unpacked = Uint8Array.from(Formats[how](bytes));
      } catch (fault) {
        throw new InputError(`cannot be unpacked: ${fault.message}`);
      }
      return sources(unpacked);
    }
    if (begins(bytes, ascii("PK\x03\x04"))) return ofWorkbook(bytes);
    if (begins(bytes, [0xd0, 0xcf, 0x11, 0xe0])) throw new InputError("is an old or a locked Office file", { hint: "save it as .xlsx or CSV, unlocked" });
    for (const [kind, mark] of [["parquet", ascii("PAR1")], ["arrow", ascii("ARROW1")], ["arrow", [0xff, 0xff, 0xff, 0xff]]]) {
      if (!begins(bytes, mark)) continue;
      try {
        return [ofTable(await Formats[kind](bytes))];
      } catch (fault) {
        if (fault instanceof InputError) throw fault;
        throw new InputError(`is not a readable ${kind === "arrow" ? "Arrow" : "Parquet"} file: ${fault.message}`);
      }
    }
    return [ofText(bytes)];
  }

  // --- forms that are brought to a column per signal, or to tags with times of their own: shape.py

  const { pv_empty: PV_EMPTY, held_empty: HELD_EMPTY, own: OWN, rows: ROWS, groups: GROUPS, widest: WIDEST } = data.shape;
  const MIDNIGHT = new RegExp(data.shape.midnight);
  const DAY_ZERO = new RegExp(data.shape.day_zero);
  const roleOf = (name) => understand(name).role;

  /** The first cells of a column that are not empty, as text. */
  const firstOf = (column) => texts({ ...column, cells: column.cells.slice(0, HEAD) }).map((cell) => cell.trim()).filter(Boolean);

  /** Of two columns of time, which has the dates and which the times of day; null where they do not. */
  function dateAndTime({ columns }, pair) {
    for (const [date, time] of [pair, [...pair].reverse()]) {
      const days = firstOf(columns[date]).map((text) => text.replace(MIDNIGHT, ""));
      const moments = firstOf(columns[time]).map((text) => text.replace(DAY_ZERO, ""));
      if (days.length && moments.length && days.every(isDate) && moments.every(isTimeOfDay)) return [date, time];
    }
    return null;
  }

  /** The table with date and time of day as one column, in the place of the first of them. */
  function joinedTimes(source, [date, time]) {
    const [at, gone] = [Math.min(date, time), Math.max(date, time)];
    const [days, moments] = [date, time].map((i) => texts(source.columns[i]));
    const stamps = days.map((day, i) => `${day.trim().replace(MIDNIGHT, "")} ${moments[i].trim().replace(DAY_ZERO, "")}`.trim());
    const without = (list, one) => list.map((value, i) => (i === at ? one : value)).filter((_, i) => i !== gone);
    return {
      ...source,
      names: without(source.names, `${source.names[date]} ${source.names[time]}`),
      units: without(source.units, null),
      columns: without(source.columns, { kind: "text", cells: stamps }),
      time: at,
    };
  }

  /** Columns that hold times: by their name, or, where it is empty or no name says so, by their cells. */
  function stamped({ names, columns }, times) {
    let asked = names.flatMap((name, i) => (times.includes(i) || !times.length || roleOf(name) === null ? [i] : []));
    if (names.length > WIDEST) asked = asked.filter((i) => times.includes(i) || i === 0 || !names[i]);
    return asked.filter((i) => times.includes(i) || columns[i].kind === "moments" || (columns[i].kind === "text" && firstOf(columns[i]).slice(0, 1).some(looksLikeStamp)));
  }

  /** Whether some loop's signals are written each on rows of its own. */
  function onOwnRows({ names, columns }, time) {
    const meanings = settle(names.map(understand));
    return groups(meanings).slice(0, GROUPS).some((group) => {
      const at = OWN.flatMap((role) => {
        const fits = meanings.flatMap((meaning, i) => (i !== time && meaning.role === role && meaning.loop === group ? [i] : []));
        return fits.length === 1 ? [[role, fits[0]]] : [];
      });
      if (at.length < 2 || !at.some(([role]) => role === "pv")) return false;
      const rows = Array.from({ length: Math.min(HEAD, columns[time].cells.length) }, (_, row) => row);
      const filled = rows.filter((row) => at.some(([, i]) => !isEmpty(columns[i], row)));
      if (filled.length < ROWS) return false;
      return at.some(([role, i]) => {
        const share = filled.filter((row) => isEmpty(columns[i], row)).length / filled.length;
        return share > (role === "pv" ? PV_EMPTY : HELD_EMPTY) && share < 1;
      });
    });
  }

  /** The table as one that has a column per signal, or, with `tags`, samples of each tag at times of its own. */
  function shaped(table) {
    let source = { ...table, time: null };
    const whole = isLong(source.names);
    let times = source.names.flatMap((name, i) => (roleOf(name) === "time" ? [i] : []));
    if (times.length === 2) {
      const pair = dateAndTime(source, times);
      if (pair) {
        source = joinedTimes(source, pair);
        times = [source.time];
      }
    }
    if (times.length !== 1) {
      const having = stamped(source, times);
      const leads = having[0] === 0 && having.every((i) => i + 1 < source.names.length && !having.includes(i + 1));
      if (having.length > 1 && leads) {
        const of = (i) => having.filter((at) => at < i).at(-1);
        const pairs = source.names.flatMap((_, i) => (having.includes(i) ? [] : [[of(i), i]]));
        return alone(source, pairs, false);
      }
      if (!times.length && having.length === 1) {
        [source.time] = times = having;
        source.names = source.names.map((name, i) => (i === source.time ? name || "time" : name));
      }
    }
    if (whole) return long(source, times);
    if (times.length === 1 && onOwnRows(source, times[0])) {
      return alone(source, source.names.flatMap((_, i) => (i === times[0] ? [] : [[times[0], i]])), true);
    }
    return source;
  }

  /** A table whose signals have times, or rows, of their own: `pairs` are the columns of times and of values of each tag. */
  function alone(source, pairs, shared) {
    const { names, units, columns } = source;
    const nameOf = ([time, value]) => {
      if (names[value] && roleOf(names[value]) !== "value") return names[value];
      const above = names[time].split(/\s+/).filter((one) => one && roleOf(one) !== "time");
      return above.join(" ") || names[value] || `column ${value + 1}`;
    };
    const meanings = pairs.map((pair) => understand(nameOf(pair)));
    const qualities = new Map(pairs.flatMap(([, value], i) => (meanings[i].role === "quality" ? [[meanings[i].loop, value]] : [])));
    const tags = new Map();
    pairs.forEach((pair, i) => {
      if (meanings[i].role === "quality") return;
      const [time, value] = pair;
      const quality = meanings[i].role === "pv" ? qualities.get(meanings[i].loop) : undefined;
      const rows = Array.from(columns[value].cells, (_, row) => row).filter((row) => !isEmpty(columns[value], row));
      tags.set(nameOf(pair), { time, value, quality, rows, unit: units[value] });
    });
    const [first] = tags.values();
    const time = first.time;
    return { ...source, tags, time, times: shared ? names[time] : "time", head: taken(columns[time], first.rows.slice(0, HEAD)) };
  }

  /** A table with a row per tag and time. */
  function long(source, times) {
    const only = (role, fits) => {
      if (fits.length > 1) throw new InputError(`the columns ${fits.map((i) => `'${source.names[i]}'`).join(" and ")} could both be ${role}`);
      return fits[0];
    };
    const at = Object.fromEntries(["tag", "value", "quality"].map((role) => [role, only(role, source.names.flatMap((name, i) => (roleOf(name) === role ? [i] : [])))]));
    const time = only("time", times);
    if (time === undefined) throw new InputError(`no time column among: ${source.names.join(", ")}`);
    const rows = new Map();
    texts(source.columns[at.tag]).forEach((tag, row) => {
      if (!rows.has(tag)) rows.set(tag, []);
      rows.get(tag).push(row);
    });
    const tags = new Map([...rows].map(([tag, of]) => [tag, { time, value: at.value, quality: at.quality, rows: of, unit: null }]));
    const { kind, cells: of } = source.columns[time];
    return { ...source, tags, time, times: source.names[time], head: { ...source.columns[time], kind, cells: of.slice(0, HEAD) } };
  }

  // --- loops

  /** Names, loops and guesses of a file: what is asked before it is read. `stem`: the file's name without its ending. */
  async function open(bytes, stem) {
    const tables = (await sources(bytes)).map(shaped);
    const faults = [];
    const loops = tables.flatMap((source) => {
      const names = source.tags ? [...source.tags.keys()] : source.names;
      const meanings = settle(names.map(understand));
      if (!source.tags && source.time !== null) meanings.forEach((meaning, i) => { if ((meaning.role === "time") !== (i === source.time)) meaning.role = i === source.time ? "time" : null; });
      const of = groups(meanings);
      const plain = tables.length > 1 ? source.sheet : stem;
      return (of.length ? of : [""]).map((group) => ({ source, names, meanings, group, groups: of, name: group || (of.includes(plain) ? `${plain} (no prefix)` : plain) }));
    });
    if (!loops.length) throw faults[0] ?? new InputError("holds no loop");
    return { loops };
  }

  // --- a recording

  /** Rows without PV, or without an SP that is recorded, are bad. */
  function finished(out, bits) {
    let flagged = bits;
    if (flagged?.some((bit) => bit & BAD)) out.pv = out.pv.map((value, i) => (flagged[i] & BAD ? NaN : value));
    const missing = (i) => Number.isNaN(out.pv[i]) || (out.sp !== undefined && Number.isNaN(out.sp[i]));
    if (out.pv.some((_, i) => missing(i))) {
      flagged = (flagged ?? new Uint8Array(out.t.length)).map((bit, i) => bit | (missing(i) ? BAD : 0));
    }
    if (flagged?.some(Boolean)) out.flags = flagged;
    return out;
  }

  /**
   * One loop's columns: t [s], sp, pv, op, position (NaN where missing), flags; `chosen` tells role to name.
   * `options`: loop (its place among the file's), columns (role to place among the loop's names, -1: none), sample_time [s].
   */
  function recording(file, options = {}) {
    const loop = file.loops[options.loop ?? 0];
    const { names, meanings, group, groups: of, source } = loop;
    const only = source.tags ? ["time", "quality"] : [];
    const chosen = choose(names, meanings, of, group, options.columns ?? {}, only);
    const read = source.tags ? ofTags(source, names, chosen) : wide(source, names, chosen, options.sample_time);
    const unit = (role) => (chosen[role] === undefined ? null : read.unit(chosen[role]));
    const called = Object.fromEntries(Object.entries(chosen).map(([role, at]) => [role, names[at]]));
    if (source.tags && source.times !== "time") called.time = source.times;
    const units = Object.fromEntries(Object.keys(chosen).map((role) => [role, unit(role)]).filter(([, one]) => one));
    return { columns: read.columns, told: read.told, t0: read.t0, chosen: called, units, loop: loop.name };
  }

  function alive(out, name) {
    if (!out.pv.some(Number.isFinite)) {
      throw new InputError(`holds no number in ${out.pv.length} rows`, { column: name, hint: "is it the right column?" });
    }
    return out;
  }

  /** A loop of a table with a column per signal. */
  function wide(source, names, chosen, sample_time) {
    const { units, digits, line } = source;
    const used = Object.values(chosen).map((at) => source.columns[at]);
    const rows = Array.from(used[0].cells, (_, row) => row).filter((row) => used.some((column) => !isEmpty(column, row)));
    if (rows.length < 2) throw new InputError(rows.length ? "has only one row" : "has no rows", { hint: "a recording needs many rows" });
    const column = (at) => taken(source.columns[at], rows);
    const out = {};
    let role = "time";
    let bits = null;
    let time = { t0: null, told: [] };
    try {
      if (chosen.time !== undefined) {
        const at = chosen.time;
        time = clock(column(at), names[at], units[at] ?? understand(names[at]).unit);
        out.t = time.read(column(at));
      } else if (sample_time > 0) {
        out.t = Float64Array.from(rows, (_, i) => i * sample_time);
      } else {
        throw new InputError(`no time column among: ${names.join(", ")}`, { hint: "choose it below, or give the sample time" });
      }
      for (role of Object.keys(chosen)) {
        const at = chosen[role];
        if (NUMBERS.includes(role)) out[role] = numbers(column(at), digits);
        else if (role !== "time") {
          const found = flags(column(at), rule(role, column(at), names[at]));
          bits = bits === null ? found : bits.map((bit, i) => bit | found[i]);
        }
      }
    } catch (fault) {
      if (!(fault instanceof CellFault)) throw fault;
      throw new InputError(fault.message, { row: line(rows[fault.index]), column: names[chosen[role]], hint: fault.hint });
    }
    alive(out, names[chosen.pv]);
    return { columns: finished(out, bits), t0: time.t0, told: time.told, unit: (at) => units[at] };
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
    return { t, value, bad: Uint8Array.from(value, Number.isNaN) };
  }

  /** A loop whose tags have times of their own: PV's are the rows, and the others keep their last value. */
  function ofTags(source, names, chosen) {
    const { columns, digits, line } = source;
    const wrong = (fault, rows, column) => (fault instanceof CellFault ? new InputError(fault.message, { row: line(rows[fault.index] ?? 0), column, hint: fault.hint }) : fault);
    let time;
    try {
      time = clock(source.head, source.names[source.time], source.units[source.time] ?? understand(source.names[source.time]).unit);
    } catch (fault) {
      throw wrong(fault, [0], source.names[source.time]);
    }
    const tags = {};
    for (const [role, at] of Object.entries(chosen)) {
      const { rows, ...of } = source.tags.get(names[at]);
      let column = source.times;
      try {
        const t = time.read(taken(columns[of.time], rows));
        column = names[of.quality] ?? "quality";
        const held = of.quality === undefined ? null : columns[of.quality];
        const first = held && { ...held, cells: held.cells.slice(0, HEAD) };
        const bad = held ? flags(taken(held, rows), rule("quality", first, source.names[of.quality])).map((bit) => (bit ? 1 : 0)) : new Uint8Array(rows.length);
        column = names[at];
        const cells = taken(columns[of.value], rows);
        tags[role] = { t, value: WORDS.includes(role) ? Float64Array.from(flags(cells, rule(role, cells, column))) : numbers(cells, digits), bad };
      } catch (fault) {
        throw wrong(fault, rows, column);
      }
    }
    let { pv } = tags;
    alive({ pv: pv.value.map((value, i) => (pv.bad[i] ? NaN : value)) }, names[chosen.pv]);
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
    const told = own ? [{ code: "own_times", severity: "info", evidence: { held, pv_rows: count, rows: pv.t.length }, numbers: {} }] : [];
    const out = { t: pv.t, pv: pv.value };
    let bits = Uint8Array.from(pv.bad, (bad) => (bad ? BAD : 0));
    for (const [role, tag] of Object.entries(tags)) {
      if (role === "pv") continue;
      const at = lastAt(tag.t, pv.t);
      const none = (i) => at[i] < 0 || tag.bad[at[i]];
      if (WORDS.includes(role)) { // an unknown mode is not automatic, an unknown limit flag is clear
        bits = bits.map((bit, i) => bit | (none(i) ? (role === "mode" ? NOT_AUTO : 0) : tag.value[at[i]]));
      } else out[role] = Float64Array.from(at, (k, i) => (none(i) ? NaN : tag.value[k]));
    }
    return { columns: finished(out, bits), t0: time.t0, told: [...time.told, ...told], unit: (at) => source.tags.get(names[at]).unit ?? understand(names[at]).unit };
  }

  /** The first cells of each of a loop's columns, as text. */
  function firstRows({ names, source }, count) {
    const rows = Array.from({ length: count }, (_, row) => row);
    const columnOf = (name, i) => {
      const tag = source.tags?.get(name);
      const column = source.columns[tag ? tag.value : i];
      return texts(taken(column, (tag ? tag.rows : rows).slice(0, count).filter((row) => row < column.cells.length)));
    };
    const columns = names.map(columnOf);
    return rows.map((row) => columns.map((cells) => cells[row] ?? ""));
  }

  return { understand, open, recording, firstRows };
};
