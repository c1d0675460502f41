// JSON as historians, data bases and scripts write it, as one table: python/glapp/reading/structured.py.
"use strict";

const Structured = (data, { folded, understand }, { checkColumns, ofColumns }) => {
  const { lists: LISTS, sample: SAMPLE, hint: HINT } = data.structured;
  const NO_TABLE = "holds no table that glapp can read";
  const isObject = (value) => typeof value === "object" && value !== null && !Array.isArray(value);
  const { isArray } = Array;
  const PARTS = /"(?:[^"\\]|\\.)*"|-?(?:NaN|Infinity)|-?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?/g; // strings and numbers

  /** The value of a JSON text: a value that is no number in JSON is missing, and a number with more digits than a
   * float stays text. */
  function value(text) {
    if (!/\d{16}|NaN|Infinity/.test(text)) return JSON.parse(text);
    const kept = (part) => (/^-?[NI]/.test(part) ? "null" : /^-?\d{16,}$/.test(part) ? `"${part}"` : part);
    return JSON.parse(text.replace(PARTS, kept));
  }

  /** The values of a text with an object a line; null where its first line is none. */
  function ofLines(text) {
    const found = [];
    for (const [i, line] of text.split("\n").entries()) {
      if (!line.trim()) continue;
      try {
        found.push(value(line));
      } catch {
        if (found.length) throw new InputError("is not an object of JSON", { row: i + 1 });
        return null;
      }
    }
    return found;
  }

  /** The line of which a fault of JSON tells. */
  function lineOf(fault, text) {
    const [, line] = /\(line (\d+)/.exec(fault.message) ?? [];
    if (line) return Number(line);
    const [, position] = /at position (\d+)/.exec(fault.message) ?? [];
    return text.slice(0, position === undefined ? text.length : Number(position)).trimEnd().split("\n").length;
  }

  /** The data of a JSON text, or of one with an object a line; undefined where it is neither. */
  function parsed(text) {
    try {
      return value(text);
    } catch (fault) {
      if (fault instanceof RangeError) throw new InputError("is JSON nested too deeply", { hint: HINT });
      const found = ofLines(text);
      if (found) return found;
      if (!/^\s*(\{\s*"|\[\s*[[{])/.test(text)) return undefined;
      throw new InputError(`is not readable as JSON: ${fault.message}`, { row: lineOf(fault, text) });
    }
  }

  // --- the table in the data: { names, rows }

  const lower = (object) => Object.fromEntries(Object.entries(object).map(([key, of]) => [key.toLowerCase(), of]));

  function tableIn(of) {
    if (isArray(of)) return ofList(of);
    const found = isObject(of) ? ofObject(of) : null;
    if (found) return found;
    const said = isArray(of) ? undefined : saidIn(of);
    if (said !== undefined) throw new InputError(`is a message and no recording: '${said}'`, { hint: data.structured.see });
    throw new InputError(NO_TABLE, { hint: HINT });
  }

  /** What a server answered in place of data. */
  function saidIn(of) {
    if (typeof of === "string") return of.slice(0, data.structured.shown);
    if (isArray(of)) return saidIn(of[0]);
    if (!isObject(of)) return undefined;
    const keys = lower(of);
    return data.structured.messages.map((key) => saidIn(keys[key])).find((said) => said !== undefined);
  }

  function ofObject(of) {
    const keys = lower(of);
    if (isArray(keys.columns) && isArray(keys.data)) return split(keys);
    if (isArray(keys.results) && keys.results.some((one) => isObject(one) && "series" in one)) {
      return series(keys.results.flatMap((one) => (isObject(one) ? one.series ?? [] : [])));
    }
    const inner = () => LISTS.map((key) => keys[key]).find((list) => isArray(list) && typeof list[0] === "object" && list[0] !== null);
    return streams(of) ?? (inner() ? ofList(inner()) : null) ?? ofColumnsByName(of) ?? byIndex(of) ?? wrapped(keys);
  }

  function wrapped(keys) {
    const inner = ["data", "result", "response", "body"].map((key) => keys[key]).find(isObject);
    return inner ? tableIn(inner) : null;
  }

  function ofList(list) {
    if (list.length && list.every(isObject)) {
      const found = streams({ items: list });
      if (found) return found;
      const names = [...new Set(list.flatMap(Object.keys))];
      return { names, rows: list.map((one) => names.map((name) => one[name])) };
    }
    const [names, ...rows] = list;
    const regular = list.length && list.every((one) => isArray(one) && one.length === names.length);
    if (!regular || !names.every((name) => typeof name === "string")) throw new InputError(NO_TABLE, { hint: HINT });
    return { names, rows };
  }

  /** Names, rows and their index apart. */
  function split({ columns, data: rows, index }) {
    const names = columns.map(String);
    if (!rows.every((row) => isArray(row) && row.length === names.length)) return { names, rows: [] };
    if (!isArray(index) || index.length !== rows.length) return { names, rows };
    return { names: ["", ...names], rows: rows.map((row, i) => [index[i], ...row]) };
  }

  /** Series of InfluxDB 1: each with its name, its tags and its columns. */
  function series(all) {
    let names = null;
    const rows = [];
    for (const one of all.filter((of) => isObject(of) && isArray(of.columns))) {
      const columns = one.columns.map(String);
      names ??= columns;
      if (columns.join("\n") !== names.join("\n")) {
        throw new InputError(`holds series of different columns: ${names.join(", ")} and ${columns.join(", ")}`, { hint: "export each measurement by itself" });
      }
      const tag = [one.name, ...Object.values(one.tags ?? {})].filter(Boolean).join(".");
      rows.push(...(one.values ?? []).filter((row) => isArray(row) && row.length === names.length).map((row) => [tag, ...row]));
    }
    return { names: ["name", ...(names ?? [])], rows };
  }

  /** Streams with their own samples: by name in a list (PI), or by name as the key (Canary). */
  function streams(of) {
    const { items, data: inner } = lower(of);
    let named = [];
    if (isArray(items)) {
      named = items.filter((item) => isObject(item) && typeof item.Name === "string" && isArray(item.Items)).map((item) => [item.Name, item.Items]);
    } else if (isObject(inner)) {
      named = Object.entries(inner).filter(([, samples]) => isArray(samples));
      if (!named.every(([, [first]]) => typeof first === "object" && first !== null)) return null;
    }
    if (!named.length) return null;
    return { names: ["tag", "time", "value", "quality"], rows: named.flatMap(([tag, samples]) => samples.map((one) => [tag, ...sample(one)])) };
  }

  /** Time, value and quality of one sample. */
  function sample(one) {
    if (isArray(one)) return one.length === 2 ? [...one, "good"] : [0, 1, 2].map((i) => one[i] ?? null);
    if (!isObject(one)) return [null, null, null];
    const found = {};
    let quality = "good";
    for (const [key, cell] of Object.entries(one)) {
      const short = key.toLowerCase();
      const role = (Object.hasOwn(SAMPLE, short) ? SAMPLE[short] : null) ?? understand(key).role;
      if (role === "quality") quality = cell;
      else if (role && !(role in found)) found[role] = cell;
    }
    const flags = Object.fromEntries(Object.entries(one).filter(([, cell]) => typeof cell === "boolean").map(([key, cell]) => [folded(key), cell]));
    if (flags.good === false || flags.questionable || flags.isgood === false) quality = "bad";
    return [found.time, found.value, quality];
  }

  /** An array a column. */
  function ofColumnsByName(of) {
    const columns = Object.entries(of).filter(([, column]) => isArray(column));
    if (columns.length < 2 || columns.some(([, column]) => column.length !== columns[0][1].length)) return null;
    return { names: columns.map(([name]) => name), rows: columns[0][1].map((_, row) => columns.map(([, column]) => column[row])) };
  }

  /** Columns by name, rows by index; or rows by index, columns by name. */
  function byIndex(of) {
    const objects = Object.entries(of);
    if (objects.length < 2 || !objects.every(([, one]) => isObject(one))) return null;
    const inner = Object.keys(objects[0][1]);
    const known = (names) => names.some((name) => understand(name).role);
    if (known(inner) && !known(objects.map(([name]) => name))) {
      return { names: ["", ...inner], rows: objects.map(([at, row]) => [at, ...inner.map((name) => row[name])]) };
    }
    const index = [...new Set(objects.flatMap(([, column]) => Object.keys(column)))];
    return { names: ["", ...objects.map(([name]) => name)], rows: index.map((at) => [at, ...objects.map(([, column]) => column[at])]) };
  }

  // --- columns

  /** A value of PI that is a digital state is an object with its name. */
  const cellOf = (cell) => (isObject(cell) ? cell.Name : cell) ?? null;

  const asText = (cell) => (cell === null ? "" : typeof cell === "string" ? cell : JSON.stringify(cell));

  /** Cells of one column: numbers where all are, else text. */
  function column(cells) {
    const known = cells.filter((cell) => cell !== null);
    if (known.length && known.every((cell) => typeof cell === "number")) return { kind: "numbers", cells: Float64Array.from(cells, (cell) => cell ?? NaN) };
    return { kind: "text", cells: cells.map(asText) };
  }

  /** The table in the data. */
  function tableOf(of) {
    let found;
    try {
      found = tableIn(of);
    } catch (fault) {
      throw fault instanceof RangeError ? new InputError("is JSON nested too deeply", { hint: HINT }) : fault;
    }
    const { names, rows } = found;
    if (!rows.length) throw new InputError("has no rows", { hint: HINT });
    checkColumns(names.length);
    return ofColumns(names, names.map((_, i) => column(rows.map((row) => cellOf(row[i])))));
  }

  const begins = (text) => /^(\{|\[[{[\n]|\[ \{)/.test(text);

  return { begins, parsed, tableOf };
};
