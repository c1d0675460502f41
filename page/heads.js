// Beginning and end of a table: python/glapp/reading/heads.py.
"use strict";

const Heads = (data, { folded, understand }, { isData, looksLikeStamp }) => {
  const { lines: LINES, short: SHORT, ahead: AHEAD, types: TYPES } = data.heads;
  const UNITS = new Set(data.heads.units);
  const FOOTER = new Set(data.heads.footer);
  const FACTS = new Set(data.heads.facts);
  const RULE = new Set(data.heads.rule);
  const tidy = (cell) => cell.split(/\s+/).filter(Boolean).join(" ");
  const bare = (cell) => cell.replace(/^[ [\]()]+|[ [\]()]+$/g, "");
  const filledOf = (cells) => cells.filter((cell) => cell.trim());
  const wordsAlone = (cells, width) => cells.length === width && filledOf(cells).length > 0 && !filledOf(cells).some(isData);
  const understood = (cells) => cells.map(understand).filter((meaning) => meaning.role !== null || meaning.weak !== null).length;

  const namesFollow = (rows, at, width) => rows.slice(at + 1, at + 1 + AHEAD).some(({ cells }) => wordsAlone(cells, width) && understood(cells) > 1);

  /** Whether a line above the names tells of the export or of its columns: words first. */
  const isLabel = (rows, at, width) => !isData(filledOf(rows[at].cells)[0] ?? "") && namesFollow(rows, at, width);

  /** Whether a line between the names and the rows is no sample: empty, a rule, an annotation, or a number of each column. */
  function isRemark(cells, width) {
    const filled = filledOf(cells);
    if (filled.every((cell) => [...cell].every((letter) => RULE.has(letter)))) return !filled.length || !isData(filled[0]);
    return (cells[0].startsWith("#") && cells.length !== width) || FACTS.has(folded(cells[0].replace(/^[ :]+|[ :]+$/g, "")));
  }

  /** Whether a line names its columns only as time and value. */
  const saysValue = (cells) => {
    const roles = filledOf(cells).map((cell) => understand(cell).role);
    return roles.filter((role) => role === "value").length > 1 && roles.every((role) => ["time", "value", "quality"].includes(role));
  };

  /** Names of two lines: a tag stands above the first of its columns, and an empty column parts two tags. */
  function under(above, below) {
    let tag = "";
    return above.slice(0, below.length).map((top, i) => {
      tag = top || tag;
      const word = tidy(below[i]);
      if (!word && !top) return "";
      return understand(word).role === "value" ? tag : `${tag} ${word}`.trim();
    });
  }

  /** Whether a name is a signal's, of no loop. */
  const isSignal = (name) => {
    const { role, loop, weak } = understand(name);
    return !loop && (weak !== null || ![null, "time", "value", "tag"].includes(role));
  };

  /** The tag that stands above signals without one, and above nothing before them; null where there is none. */
  function oneTag(above, names) {
    const first = above.findIndex((cell) => cell.trim());
    const tag = tidy(above[first]);
    if (above.some((cell) => cell.trim() && tidy(cell) !== tag) || !names.some(isSignal) || names.slice(0, first).some(isSignal)) return null;
    return first === 0 || UNITS.has(folded(bare(tag))) || !/[0-9]/.test(tag) || understand(tag).role ? null : tag;
  }

  /** Whether two columns have the same name. */
  const repeat = (names) => new Set(names.filter(Boolean)).size < names.filter(Boolean).length;

  const areUnits = (cells) => {
    const filled = filledOf(cells).map((cell) => folded(bare(cell)));
    return filled.filter((cell) => UNITS.has(cell)).length * 2 >= filled.length;
  };
  const areShort = (cells) => cells.every((cell) => cell.trim().length <= SHORT);

  /** The lines of words alone that stand right above the rows, and where these begin. */
  function linesOf(rows, start, width) {
    let lines = [];
    let end = start;
    for (let i = start; i < Math.min(rows.length, start + LINES); i += 1) {
      const { cells } = rows[i];
      const typed = i > 0 && rows[i - 1].cells[0].trim().toLowerCase() === TYPES;
      if (wordsAlone(cells, width) && !typed) lines.push(i);
      else if (!(typed || (lines.length && isRemark(cells, width)) || isLabel(rows, i, width))) break;
      if (lines.length) end = i + 1;
    }
    if (!lines.length) return { lines: [start], end: start + 1 }; // it may hold years or numbers of columns
    const [all, last] = [new Set(lines), lines.at(-1)];
    const together = (from) => rows.slice(from, last + 1).every(({ cells }, k) => all.has(from + k) || isRemark(cells, width));
    lines = lines.filter(together);
    return { lines, end };
  }

  /** Names and units of the columns, from the line that has most of them and those beside it. */
  function called(rows, lines) {
    const named = lines.reduce((best, i) => {
      const [a, b] = [best, i].map((k) => [understood(rows[k].cells), filledOf(rows[k].cells).length]);
      return b[0] > a[0] || (b[0] === a[0] && b[1] > a[1]) ? i : best;
    });
    let names = rows[named].cells.map(tidy);
    let units = names.map((name) => understand(name).unit);
    const below = lines.filter((i) => i > named);
    if (below.length && saysValue(rows[below[0]].cells)) names = under(names, rows[below.shift()].cells);
    else if (lines.includes(named - 1)) {
      const whole = under(rows[named - 1].cells.map(tidy), rows[named].cells);
      const tag = oneTag(rows[named - 1].cells, names);
      if (saysValue(rows[named].cells) || (repeat(names) && !repeat(whole))) names = whole;
      else if (tag) names = names.map((name) => (isSignal(name) ? `${tag} ${name}` : name));
    }
    const of_units = below.filter((i) => areUnits(rows[i].cells));
    const unit_rows = of_units.length ? of_units : below.filter((i) => areShort(rows[i].cells));
    if (unit_rows.length) units = rows[unit_rows.at(-1)].cells.map((cell) => bare(cell) || null);
    return { named, names, units };
  }

  /** Names and units of a table whose first line of `width` cells is the row `start`, and how many rows stand above its own. */
  function headOf(rows, start, width) {
    const { lines, end } = linesOf(rows, start, width);
    const { named, names, units } = called(rows, lines);
    const set = (at, name, unit) => { [names[at], units[at]] = [name, unit]; };
    const head = rows.slice(start, end);
    for (const row of head) {
      if (row === rows[named] || row.cells.length !== width) continue;
      row.cells.forEach((cell, at) => { if (!names[at] && understand(cell).role === "time") set(at, cell.trim(), null); });
    }
    if (head.some(({ cells }) => folded(cells[0] ?? "") === "sampletime[ms]")) {
      const line = names[0]; // TwinCAT's Scope calls its columns of times as it calls the line
      names.forEach((name, at) => { if (at % 2 === 0 && name === line) set(at, "time", "ms"); });
    }
    return { names, units, line: rows[named].line, rows: end };
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

  /** Whether what should be names is the first row: numbers, and no signal or a date among them. */
  function holdsData(names) {
    if (!names.some((name) => name && isData(name))) return false;
    return names.some(looksLikeStamp) || !names.some((name) => understand(name).role);
  }

  /**
   * The names of a head, or, where it is the first row, numbers of columns and `nameless`: what is to be said where nobody
   * says which column is which.
   */
  function namesOf({ names, units, line }) {
    if (!holdsData(names)) return { names, units, nameless: null };
    const hint = "write the columns' names in the first row, for instance t,SP,PV,OP,MODE; or choose the columns below";
    const nameless = new InputError("has no header: the first row holds data", { row: line, hint });
    return { names: names.map((_, i) => `column ${i + 1}`), units: names.map(() => null), nameless };
  }

  return { headOf, namesOf, holdsData, beginsWithData, bodyEnd };
};
