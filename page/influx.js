// Exports of InfluxDB, annotated CSV and line protocol, with a row per tag and time: python/glapp/reading/influx.py.
"use strict";

const Influx = (data, { understand }, { noRows, records, raggedly, ofColumns }) => {
  const OWN = new Set(data.influx.own);
  const { annotations: ANNOTATIONS } = data.influx;
  const POINT = new RegExp(`^(?:${data.influx.point})$`);
  const FIELD = new RegExp(data.influx.field, "g");
  const EXTENDED = "#datatype "; // the extended form has no column for annotations

  const firstLine = (text, wanted) => text.split("\n").find((line) => line.trim() && wanted(line)) ?? "";

  /** Whether a text begins as annotated CSV does, or with the names that a query without annotations has. */
  function isAnnotated(beginning) {
    const first = firstLine(beginning, () => true);
    const names = first.split(",");
    return ANNOTATIONS.some((mark) => first.startsWith(mark)) || ["_time", "table"].every((name) => names.includes(name));
  }

  /** Whether the first line that is no comment is a point. */
  const isLineProtocol = (beginning) => POINT.test(firstLine(beginning, (line) => !line.startsWith("#")));

  /** A table of { line, time, tag, value }. */
  function tableOf(rows) {
    if (!rows.length) throw noRows();
    const names = ["time", "tag", "value"];
    const columns = names.map((name) => ({ kind: "text", cells: rows.map((row) => row[name]) }));
    return ofColumns(names, columns, rows.map(({ line }) => line));
  }

  // --- annotated CSV

  /** Columns of each kind: time, series (measurement and tags), field and value, or fields. */
  function rolesOf(names, notes) {
    const [kinds, group] = [notes["#datatype"] ?? [], notes["#group"] ?? []];
    const having = (wanted) => names.flatMap((name, i) => (wanted(name, kinds[i] ?? "", i) ? [i] : []));
    let times = having((name) => name === "_time");
    if (!times.length) times = having((name, kind) => kind.startsWith("dateTime") && !OWN.has(name));
    const roles = {
      time: times[0],
      value: having((name) => name === "_value")[0],
      field: having((name) => name === "_field"),
      series: having((name, kind) => name === "_measurement" || kind === "measurement"),
      fields: [],
    };
    const rest = having((name, kind, i) => !OWN.has(name) && !times.includes(i) && !roles.series.includes(i));
    for (const i of rest) {
      const plain = !group.length && !kinds.length && understand(names[i]).role === null;
      const tag = kinds[i] === "tag" || group[i] === "true" || roles.value !== undefined || plain;
      roles[tag ? "series" : "fields"].push(i);
    }
    return roles;
  }

  /** The samples of one row. */
  function samples({ line, cells }, names, roles) {
    if (cells.length !== names.length) throw new InputError(raggedly(cells.length, names.length), { row: line });
    if (roles.time === undefined) throw new InputError(`no time column among: ${names.slice(0, 20).join(", ")}`, { row: line });
    const series = roles.series.map((i) => cells[i]);
    const time = cells[roles.time];
    if (roles.value !== undefined) {
      return [{ line, time, tag: [...series, ...roles.field.map((i) => cells[i])].join("."), value: cells[roles.value] }];
    }
    return roles.fields.map((i) => ({ line, time, tag: [...series, names[i]].join("."), value: cells[i] }));
  }

  /** The tables of annotated CSV, read one after the other. */
  function annotated(text) {
    const rows = [];
    let names = null;
    let roles = null;
    let notes = {};
    for (const record of records(text, ",")) {
      const { cells } = record;
      if (!cells.length) [names, notes] = [null, {}];
      else if (ANNOTATIONS.includes(cells[0])) [names, notes[cells[0]]] = [null, cells];
      else if (cells[0].startsWith(EXTENDED)) [names, notes] = [null, { "#datatype": [cells[0].slice(EXTENDED.length), ...cells.slice(1)] }];
      else if (names === null) [names, roles] = [cells, rolesOf(cells, notes)];
      else for (const row of samples(record, names, roles)) rows.push(row);
    }
    return tableOf(rows);
  }

  // --- line protocol

  const plain = (text) => text.replace(/\\(.)/g, "$1");

  /** A field's value: a string without its quotes, a whole number without its i or u. */
  const value = (text) => (text.startsWith('"') ? plain(text.slice(1, -1)) : text.replace(/^(-?\d+)[iu]$/, "$1"));

  /** Reads the points of a file in InfluxDB line protocol. */
  function lineProtocol(text) {
    const rows = [];
    for (const [i, line] of text.split("\n").entries()) {
      if (!line.trim() || line.startsWith("#")) continue;
      const point = POINT.exec(line)?.groups;
      if (!point) throw new InputError("is not a point such as 'pid,loop=FIC101 pv=1.5,op=40 1763100000000000000'", { row: i + 1 });
      const [measurement, ...tags] = point.series.split(/(?<!\\),/);
      const series = [measurement, ...tags.map((tag) => tag.slice(tag.indexOf("=") + 1))].map(plain);
      for (const [, name, cell] of point.fields.matchAll(FIELD)) rows.push({ line: i + 1, time: point.time, tag: [...series, plain(name)].join("."), value: value(cell) });
    }
    return tableOf(rows);
  }

  return { isAnnotated, isLineProtocol, annotated, lineProtocol };
};
