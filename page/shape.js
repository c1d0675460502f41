// Forms that are brought to a column per signal, or to tags with times of their own: python/glapp/reading/shape.py.
//
// A table with `tags` has samples of each tag: its columns of times, values and quality, and its rows in the table.
// `times` is what its column of times is called, `dated` whether a person knows the column by that name.
"use strict";

const Shape = (data, { folded, understand, timeOf, settle, groups, isLong }, cells_of) => {
  const { isDate, isTimeOfDay, looksLikeStamp, isNumber, holdsModes, texts, isEmpty, taken } = cells_of;
  const { pv_empty: PV_EMPTY, held_empty: HELD_EMPTY, own: OWN, rows: ROWS, groups: GROUPS, widest: WIDEST } = data.shape;
  const { days: DAYS, day_step: DAY_STEP } = data.shape;
  const HEAD = 1000; // rows that tell what columns hold
  const UNIT_COLUMNS = new Set(data.columns.unit_columns);
  const MIDNIGHT = new RegExp(data.shape.midnight);
  const DAY_ZERO = new RegExp(data.shape.day_zero);
  const SECOND = new RegExp(data.shape.second, "i");
  const WITH_HALF = new RegExp(`^(.*?)(${data.shape.half})?$`, "i");
  const MILLISECONDS = new Set(data.shape.milliseconds);
  const roleOf = (name) => understand(name).role;
  const places = (list, wanted) => list.flatMap((one, i) => (wanted(one, i) ? [i] : []));

  /** The first cells of a column that are not empty, as text. */
  const firstOf = (column) => texts({ ...column, cells: column.cells.slice(0, HEAD) }).map((cell) => cell.trim()).filter(Boolean);
  const every = (list, wanted) => list.length > 0 && list.every(wanted);
  const datesOf = (column) => firstOf(column).map((text) => text.replace(MIDNIGHT, "")); // which a spreadsheet adds
  const momentsOf = (column) => firstOf(column).map((text) => text.replace(DAY_ZERO, ""));

  // --- times in two columns

  /** Which of two columns of time has the dates and which the times of day; null where they do not. */
  function dateAndTime({ columns }, pair) {
    const fits = ([date, time]) => every(datesOf(columns[date]), isDate) && every(momentsOf(columns[time]), isTimeOfDay);
    return [pair, [...pair].reverse()].find(fits) ?? null;
  }

  /** The column that a time goes on in: times of day beside dates, or (`fine`) milliseconds; null where there is none. */
  function beside({ names, columns }, at) {
    const first = firstOf(columns[at]);
    const after = at + 1;
    if (!first.length) return null;
    if (after < names.length && MILLISECONDS.has(folded(names[after]))) {
      if (first.every((text) => SECOND.test(text)) && every(firstOf(columns[after]), (part) => /^\d{1,3}$/.test(part))) return { with: after, fine: true };
    }
    if (!datesOf(columns[at]).every(isDate)) return null;
    const fits = (i) => i in names && [null, "time"].includes(roleOf(names[i])) && every(momentsOf(columns[i]), isTimeOfDay);
    const found = [after, at - 1].find(fits);
    return found === undefined ? null : { with: found, fine: false };
  }

  /** The table with two columns as one of times, in the place of the first of them: date and time of day, or a time and its milliseconds. */
  function joinedTimes(source, date, time, fine) {
    const [at, gone] = [Math.min(date, time), Math.max(date, time)];
    const [left, right] = [date, time].map((i) => texts(source.columns[i]).map((cell) => cell.trim()));
    const finely = (text, part) => text.replace(WITH_HALF, (_, to, half = "") => `${to}.${part.padStart(3, "0")}${half}`);
    const daily = (day, moment) => `${day.replace(MIDNIGHT, "")} ${moment.replace(DAY_ZERO, "")}`.trim();
    const stamps = left.map((text, i) => (fine ? finely : daily)(text, right[i]));
    const without = (list, one) => list.map((value, i) => (i === at ? one : value)).filter((_, i) => i !== gone);
    const both = [source.names[date], ...(fine ? [] : [source.names[time]])].join(" ").trim();
    return {
      ...source,
      names: without(source.names, both || "time"),
      units: without(source.units, null),
      columns: without(source.columns, { kind: "text", cells: stamps }),
      time: at,
    };
  }

  // --- columns of times whose name does not say so

  /** Columns that hold times: by their name, or, where it is empty or no name says so, by their cells. */
  function stamped({ names, columns }, times) {
    let asked = places(names, (name, i) => times.includes(i) || !times.length || roleOf(name) === null);
    if (names.length > WIDEST) asked = asked.filter((i) => times.includes(i) || i === 0 || !names[i]);
    return asked.filter((i) => times.includes(i) || firstOf(columns[i]).slice(0, 1).some(looksLikeStamp));
  }

  /**
   * Whether the first column, whose name says nothing of it, has numbers that can only be times. They rise, and are seconds
   * to nanoseconds since 1970, or days as a spreadsheet counts them. Numbers of rows are not.
   */
  function countsTime({ names, columns }) {
    if (!names.length || ![null, "tag"].includes(roleOf(names[0]))) return false;
    const x = firstOf(columns[0]).map(Number);
    const steps = x.slice(1).map((value, i) => value - x[i]);
    if (!every(steps, (step) => step > 0) || !x.every(Number.isFinite)) return false;
    const [first, last] = [x[0], x.at(-1)];
    if ([1, 1e3, 1e6, 1e9].some((scale) => 0.9e9 * scale < first && last < 4e9 * scale)) return true;
    const sorted = steps.sort((a, b) => a - b);
    const n = sorted.length;
    return DAYS[0] < first && last < DAYS[1] && (sorted[(n - 1) >> 1] + sorted[n >> 1]) / 2 < DAY_STEP;
  }

  // --- a time column for each tag

  /** Columns of times and of values, where every time column has its values right after it and nothing stands before the first. */
  function pairsInOrder({ names, columns }, having) {
    if (having[0] !== 0 || !having.every((i) => i + 1 < names.length && !having.includes(i + 1))) return [];
    const before = (i) => having.filter((at) => at < i).at(-1);
    const filled = (i) => names[i] || (having.includes(i - 1) && firstOf(columns[i]).length); // an empty column parts two tags
    return places(names, (_, i) => !having.includes(i) && filled(i)).map((i) => [before(i), i]);
  }

  /** Columns of times and of values that belong together by their names: FIC101_PV_TIMESTAMP, FIC101_PV_VALUE. */
  function pairsByName({ names }, having) {
    const tags = having.map((i) => [i, timeOf(names[i])]);
    if (tags.some(([, tag]) => tag === null)) return [];
    const pairs = [];
    for (const [i, name] of names.entries()) {
      const own = tags.filter(([, tag]) => name.startsWith(tag));
      if (having.includes(i) || (!own.length && !OWN.includes(roleOf(name)))) continue;
      if (!own.length) return [];
      const [time] = own.reduce((best, one) => (one[1].length > best[1].length ? one : best));
      pairs.push([time, i]);
    }
    return pairs;
  }

  /** Whether some loop's signals are written each on rows of its own. */
  function onOwnRows({ names, columns }, time) {
    const meanings = settle(names.map(understand), (i) => holdsModes(firstOf(columns[i])));
    const loops = groups(meanings);
    const meant = (role, loop) => places(meanings, (meaning, i) => i !== time && meaning.role === role && meaning.loop === loop);
    return loops.slice(0, GROUPS).some((group) => {
      const at = OWN.flatMap((role) => {
        const own = meant(role, group);
        const fits = own.length || loops.length > 1 ? own : meant(role, "");
        return fits.length === 1 && names.filter((name) => name === names[fits[0]]).length === 1 ? [[role, fits[0]]] : [];
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
    return ofTags(source, tags, first, shared ? names[first.time] : "time", { dated: shared, column: true });
  }

  const ofTags = (source, tags, { time, rows }, times, more) => ({ ...source, tags, time, times, head: taken(source.columns[time], rows.slice(0, HEAD)), ...more });

  // --- a row per tag and time

  /** The rows of each word of a column. */
  function rowsOf(column) {
    const rows = new Map();
    texts(column).forEach((word, row) => {
      if (!rows.has(word)) rows.set(word, []);
      rows.get(word).push(row);
    });
    return rows;
  }

  const all = (column) => Array.from({ length: Math.min(HEAD, column.cells.length) }, (_, row) => row);

  /** The only column of a role, or of several the one that is sure. */
  function only(names, role, fits) {
    const sure = fits.filter((i) => folded(names[i]) === data.columns.sure[role]);
    if (fits.length < 2 || sure.length === 1) return (sure.length ? sure : fits)[0];
    throw new InputError(`the columns ${fits.map((i) => `'${names[i]}'`).join(" and ")} could both be ${role}`);
  }

  /** A table with a row per tag and time. */
  function long(source) {
    const { names, columns } = source;
    const at = Object.fromEntries(["tag", "value", "quality"].map((role) => [role, only(names, role, places(names, (name) => roleOf(name) === role))]));
    const named = places(names, (name) => roleOf(name) === "time");
    const time = only(names, "time", named.length || source.time === null ? named : [source.time]);
    if (time === undefined) throw new InputError(`no time column among: ${names.slice(0, 20).join(", ")}`);
    const marked = names.some((name) => folded(name) === "marker");
    const units = places(names, (name) => UNIT_COLUMNS.has(folded(name)));
    const written = units.length === 1 ? texts(columns[units[0]]).map((cell) => cell.trim()) : null;
    const unitOf = (rows) => {
      const found = new Set(written === null ? [] : rows.map((row) => written[row]).filter(Boolean));
      return found.size === 1 ? [...found][0] : null;
    };
    const tags = new Map([...rowsOf(columns[at.tag])].map(([tag, rows]) => [tag, { time, value: at.value, quality: at.quality, rows, unit: unitOf(rows) }]));
    return ofTags(source, tags, { time, rows: all(columns[time]) }, names[time], { dated: true, marked });
  }

  /** The column that names the loop of each row, in a table with a column per signal; undefined where there is none. */
  function keyOf({ names, columns }) {
    const meanings = names.map(understand);
    const keys = places(meanings, ({ role }) => role === "tag");
    if (keys.length !== 1 || !meanings.some(({ role, loop }) => role === "pv" && !loop)) return undefined;
    return every(firstOf(columns[keys[0]]), (cell) => !isNumber(cell)) ? keys[0] : undefined;
  }

  /** A table whose rows belong to the loops that one column names: a tag is the name of the loop and of the signal's column. */
  function keyed(source, time, key) {
    const { names, columns } = source;
    const signals = places(names.map(understand), ({ role, loop, weak }) => ([...OWN, "position"].includes(role) || weak) && !loop);
    const words = { kind: "text", cells: texts(columns[key]).map((cell) => cell.trim()) };
    const tags = new Map([...rowsOf(words)].flatMap(([word, rows]) => signals.map((value) => [`${word}.${names[value]}`, { time, value, rows, unit: null }])));
    return ofTags(source, tags, { time, rows: all(columns[time]) }, "time", { dated: true });
  }

  /**
   * Names the columns of a table without names where its cells say it: a time, a tag and a value. At least one tag must be
   * understood as a signal.
   */
  function tagged(source) {
    const kinds = source.columns.map((column) => {
      const first = firstOf(column);
      if (!first.length) return "";
      if (first.every(looksLikeStamp)) return "time";
      if (first.every(isNumber)) return "value";
      return !first.some(isNumber) && first.some((text) => ["sp", "pv", "op"].includes(roleOf(text))) ? "tag" : "";
    });
    return [...kinds].sort().join(" ") === "tag time value" ? { ...source, names: kinds, nameless: null } : source;
  }

  // --- all of them

  /** The table with its column of times as `time`, or its tags where each has one of its own. */
  function timed(source) {
    const times = places(source.names, (name) => roleOf(name) === "time");
    const pair = times.length === 2 ? dateAndTime(source, times) : null;
    if (pair) return joinedTimes(source, ...pair, false);
    if (times.length === 1) return { ...source, time: times[0] };
    const having = stamped(source, times);
    const pairs = having.length > 1 ? [pairsInOrder, pairsByName].map((of) => of(source, having)).find((of) => of.length) : null;
    if (pairs) return alone(source, pairs, false);
    const found = !times.length && !having.length && countsTime(source) ? [0] : having;
    if (times.length || found.length !== 1) return source;
    const [time] = found;
    return { ...source, time, names: source.names.map((name, i) => (i === time ? name || "time" : name)) };
  }

  /** The table as one that has a column per signal, or samples of each tag. */
  function shaped(table) {
    let source = timed({ ...(table.nameless ? tagged(table) : table), time: null });
    if (source.tags) return source;
    const more = source.time === null ? null : beside(source, source.time);
    if (more) source = joinedTimes(source, source.time, more.with, more.fine);
    if (isLong(source.names)) return long(source);
    if (source.time === null) return source;
    const { time } = source;
    const key = keyOf(source);
    if (key !== undefined) return keyed(source, time, key);
    return onOwnRows(source, time) ? alone(source, places(source.names, (_, i) => i !== time).map((i) => [time, i]), true) : source;
  }

  return { shaped };
};
