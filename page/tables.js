// Tables of text, sheets of workbooks and columns in memory: python/glapp/reading/csv.py, excel.py and tables.py.
//
// A table is { names, units, columns, digits, line }: `line` gives the row that a person sees beside a record. `nameless`
// is what is to be said where it has no line of names, `typed` whether its numbers come as numbers.
"use strict";

const Tables = (data, { understand, isLong }, { headOf, namesOf, holdsData, beginsWithData, bodyEnd }, { digitsOf, unitOf }) => {
  const SAMPLE = 1 << 16; // characters that tell how a text is written
  const HEAD = 1000; // rows that tell what columns hold
  const notText = () => new InputError("is not text, Parquet or Arrow", { hint: "export the recording as CSV, Excel, Parquet or Arrow" });
  const noRows = () => new InputError("has a header but no rows", { hint: "take a time in which the historian has values, and export again" });

  function checkColumns(count) {
    const most = data.bounds.columns;
    if (count > most) throw new InputError(`has ${count} columns, at most ${most} are read`, { hint: "split it into files of fewer loops" });
  }

  /** A number without the unit behind it; any other text as it is. */
  const numberIn = (cell) => unitOf(cell)?.[0] ?? cell.trim();

  /** Row and column of the first cell with this number. */
  const placeIn = (names, columns, line) => (number) => {
    for (const [i, { kind, cells }] of columns.entries()) {
      const row = kind === "text" ? cells.findIndex((cell) => numberIn(cell) === number) : -1;
      if (row >= 0) return { row: line(row), column: names[i] };
    }
    return {};
  };

  // --- text

  /** Encoding of a text, from its first bytes. */
  function encoding(raw) {
    const marks = [["utf-8", [0xef, 0xbb, 0xbf]], ["utf-16le", [0xff, 0xfe]], ["utf-16be", [0xfe, 0xff]]];
    for (const [name, mark] of marks) if (mark.every((byte, i) => raw[i] === byte)) return name;
    if (raw.includes(0)) {
      const zeros = (odd) => raw.filter((byte, i) => i % 2 === odd && byte === 0).length / Math.max(1, raw.length / 2);
      if (zeros(1) > 0.9) return "utf-16le";
      if (zeros(0) > 0.9) return "utf-16be";
      throw notText();
    }
    const control = raw.filter((byte) => byte < 32 && ![9, 10, 12, 13].includes(byte)).length;
    if (control > 0.01 * raw.length) throw notText();
    try {
      new TextDecoder("utf-8", { fatal: true }).decode(raw, { stream: true });
      return "utf-8";
    } catch {
      return "windows-1252";
    }
  }

  /** The text of a file, its lines ended by "\n". */
  function decoded(bytes) {
    const raw = bytes.subarray(0, SAMPLE);
    if (!raw.some((byte) => ![0, 9, 10, 13, 32].includes(byte))) throw new InputError("is empty", { hint: "export the recording again" });
    const how = encoding(raw);
    if (how.startsWith("utf-16") && bytes.length % 2) throw new InputError("cannot be read: it ends in the middle of a character");
    return new TextDecoder(how).decode(bytes).replace(/\r\n?/g, "\n");
  }

  /** Records of cells, each with the line on which it begins, and the records with a quote that is not closed; an empty line has no cell. */
  function parsed(text, delimiter) {
    const { data: rows, errors } = Papa.parse(text, { delimiter, quoteChar: '"' });
    let line = 1;
    const found = rows.map((row) => {
      const record = { line, cells: row.length > 1 || row[0] !== "" ? row : [] };
      line += 1 + row.reduce((sum, cell) => sum + (cell.includes("\n") ? cell.split("\n").length - 1 : 0), 0);
      return record;
    });
    return { found, open: errors.filter(({ type }) => type === "Quotes").map(({ row }) => found[Math.min(row, found.length - 1)]) };
  }

  /** The records of a whole text: what follows an open quote would be lost in its cell. */
  function records(text, delimiter) {
    const { found, open } = parsed(text, delimiter);
    if (open.length) throw new InputError("has a quote that is not closed", { row: open[0].line });
    return found;
  }

  const filled = (found) => found.filter(({ cells }) => cells.length);

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
      const rows = filled(parsed(text, delimiter).found);
      const [width, count] = commonest(rows.map((row) => row.cells.length));
      const score = count / Math.max(rows.length, 1);
      if (width > 1 && (best === null || score > best.score)) best = { score, delimiter };
    }
    if (best === null) {
      const begins = text.trim().split("\n", 1)[0].trim().split(/\s+/).join(" ").slice(0, data.shown);
      throw new InputError(`has only one column and begins with '${begins}'`, { hint: "separate the columns by comma, semicolon, tab or '|'; where this is a message, export again" });
    }
    return best.delimiter;
  }

  /** Finding on the first of the rows that is not as wide as the header. */
  function checkWidths(body, width, delimiter) {
    const ragged = body.find((row) => row.cells.length !== width);
    if (!ragged) return;
    const n = ragged.cells.length;
    let hint = "correct or delete the row";
    if (n > width && delimiter === ",") hint += "; where numbers have a decimal comma, export with ';' between the columns";
    if (ragged === body.at(-1) && n < width) hint = "the file ends in the middle of a row, is it still being written?";
    throw new InputError(raggedly(n, width), { row: ragged.line, hint });
  }

  const raggedly = (n, width) => `has ${n} cell${n === 1 ? "" : "s"} where the header has ${width}`;

  /** A table of text. */
  function ofText(text) {
    let sample = text.slice(0, SAMPLE);
    if (sample.length < text.length && sample.includes("\n")) sample = sample.slice(0, sample.lastIndexOf("\n"));
    const delimiter = separator(sample);
    let rows = filled(records(text, delimiter));
    const seen = filled(parsed(sample, delimiter).found);
    let [width] = commonest(seen.map((row) => row.cells.length));
    checkColumns(width);
    const timed = beginsWithData(seen, width);
    rows = rows.slice(0, Math.max(bodyEnd(rows, width, timed), 1));
    let start = rows.findIndex((row) => row.cells.length === width);
    if (rows.slice(0, start).some((row) => row.cells.length > width)) {
      start = 0; // not a title above the table, but a header with more names than cells: told as a ragged row
      width = rows[0].cells.length;
    }
    const head = headOf(rows, start, width);
    const named = namesOf(head);
    const body = rows.slice(named.nameless ? start : head.rows);
    if (!body.length) throw noRows();
    checkWidths(body, width, delimiter);
    const known = [...body.slice(0, seen.length), ...body.slice(-50)].flatMap((row) => row.cells.map(numberIn));
    const columns = named.names.map((_, i) => ({ kind: "text", cells: body.map((row) => row.cells[i]) }));
    const line = (row) => body[row].line;
    return { ...named, columns, digits: digitsOf(known, placeIn(named.names, columns, line)), line };
  }

  // --- sheets

  const ofDay = (ms) => new Date(ms).toISOString().slice(11, 23).replace(/\.000$/, "");

  /** A cell as a text file has it. */
  function asText(cell) {
    if (typeof cell === "string") return cell.trim();
    if (typeof cell !== "object") return String(cell);
    if ("span" in cell) return String(cell.span);
    if ("per_cent" in cell) return String(cell.per_cent);
    if ("time" in cell) return ofDay(cell.time);
    const iso = new Date(cell.moment ?? cell.date).toISOString();
    return "date" in cell ? iso.slice(0, 10) : iso.slice(0, 23).replace("T", " ").replace(/\.000$/, "");
  }

  /** Cells as a column of one type; any other is text. */
  function typed(held) {
    const having = held.filter((cell) => cell !== "");
    const all = (kind) => having.every((cell) => typeof cell === "object" && kind in cell);
    const of = (kind, value) => ({ kind, cells: Float64Array.from(held, (cell) => (cell === "" ? NaN : value(cell))) });
    if (having.every((cell) => typeof cell === "number" || "per_cent" in Object(cell))) return of("numbers", (cell) => cell.per_cent ?? cell);
    if (all("span")) return of("numbers", (cell) => cell.span);
    const dated = (cell) => typeof cell === "object" && ("date" in cell || "moment" in cell);
    if (having.every(dated) && having.some((cell) => "moment" in cell)) return of("moments", (cell) => cell.moment ?? cell.date);
    return { kind: "text", cells: held.map(asText) };
  }

  /** The columns that hold something: one cell far to the right makes thousands. */
  function used(rows) {
    const at = rows[0].flatMap((_, i) => (rows.some((row) => row[i] !== "") ? [i] : []));
    return at.length < rows[0].length ? rows.map((row) => at.map((i) => row[i])) : rows;
  }

  /** A sheet with so many rows above its first. */
  function ofSheet({ name, first, rows: all }) {
    const rows = used(all);
    const width = rows[0].length;
    const lines = rows.map((row, i) => ({ line: first + i + 1, cells: row.map(asText) }));
    const seen = lines.slice(0, HEAD);
    if (!width) throw new InputError("is empty", { hint: "export the recording again" });
    if (width < 2) throw new InputError("has only one column", { hint: "export time, PV and OP of the loop, a column each" });
    let widest = Math.max(0, seen.findIndex(({ cells: row }) => row.filter(Boolean).length > 1));
    const over = widest && !holdsData(seen[widest].cells) ? seen[widest - 1].cells : [];
    if (!over[0] && over.some(Boolean)) widest -= 1; // the tag of the signals, which is no title
    const head = headOf(seen, widest, width);
    const { names, units, nameless } = namesOf(head);
    const above = nameless ? widest : head.rows;
    const ends = lines.slice(above);
    while (ends.length && !ends.at(-1).cells.some(Boolean)) ends.pop();
    const body = rows.slice(above, above + bodyEnd(ends, width, beginsWithData(seen.slice(above), width)));
    if (!body.length) throw noRows();
    const kept = names.flatMap((of, i) => (of || body.some((row) => row[i] !== "") ? [i] : []));
    const columns = kept.map((i) => typed(body.map((row) => row[i])));
    const words = columns.flatMap(({ kind, cells }) => (kind === "text" ? cells : [])).filter(Boolean);
    const line = (row) => first + above + 1 + row;
    const called = kept.map((i) => names[i]);
    const unitOfColumn = (i) => units[i] ?? (body.some((row) => "per_cent" in Object(row[i])) ? "%" : null);
    return { sheet: name, names: called, units: kept.map(unitOfColumn), nameless, columns, digits: digitsOf(words.map(numberIn), placeIn(called, columns, line)), line };
  }

  /** Refuses an archive that is no workbook, by the names of the files in it. */
  function checkArchive(names) {
    const files = names.filter((name) => !name.endsWith("/"));
    if (files.some((name) => name.startsWith("xl/") || name === "content.xml")) return;
    const [, what, hint] = data.kinds.archives.find(([start]) => files.some((name) => name.startsWith(start))) ?? [];
    const counted = `${files.length} file${files.length === 1 ? "" : "s"} (${files.slice(0, 3).join(", ")}${files.length > 3 ? " …" : ""})`;
    if (what) throw new InputError(what.replace("{files}", counted), { hint });
  }

  /** The same, and one of LibreOffice, which only the package reads. */
  function checkWorkbook(names) {
    checkArchive(names);
    if (names.includes("content.xml")) throw new InputError("is an OpenDocument workbook", { hint: "save it as .xlsx or CSV" });
  }

  /** The sheets of a workbook that hold a table. */
  function ofWorkbook(bytes) {
    let held;
    try {
      held = Sheets.open(bytes, checkWorkbook);
    } catch (fault) {
      if (fault instanceof InputError) throw fault;
      throw new InputError(`is not a readable workbook: ${fault.message}`);
    }
    const made = [];
    let wrong = null;
    for (const sheet of held) {
      try {
        made.push({ ...ofSheet(sheet), typed: true });
      } catch (fault) {
        if (!(fault instanceof InputError)) throw fault;
        wrong ??= fault;
      }
    }
    if (!made.length) throw wrong ?? new InputError("has no sheet with a table");
    const having = made.filter(({ names }) => isLong(names) || names.some((name) => ["pv", "op"].includes(understand(name).role)));
    return having.length ? having : made;
  }

  // --- columns in memory

  /** A table of columns; its rows are counted from 1, or as `lines` says. */
  function ofColumns(names, columns, lines = null) {
    const seen = columns.flatMap((column) => (column.kind === "text" ? column.cells.slice(0, HEAD).map(numberIn) : []));
    const line = (row) => (lines ? lines[row] : row + 1);
    return { names, units: names.map(() => null), nameless: null, columns, digits: digitsOf(seen.filter(Boolean), placeIn(names, columns, line)), line };
  }

  return { noRows, checkColumns, decoded, records, raggedly, ofText, ofSheet, ofWorkbook, ofColumns };
};
