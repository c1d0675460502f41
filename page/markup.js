// Tables of web pages, which many systems save as .xls, and XML Spreadsheet of Excel 2003: python/glapp/reading/markup.py.
// A worker has no DOMParser: this reads the tags of tables and passes over all else, as tolerant as a browser.
"use strict";

const Markup = (data, { checkColumns, ofSheet }) => {
  const CELLS = data.bounds.cells;
  const MARKS = ["<table", "<workbook", ":workbook", "<html", "<!doctype"];
  const START = /<([a-z][^\s/>]*)((?:[^>"']|"[^"]*"|'[^']*')*)>/iy;
  const LOOSE = /<([a-z][^\s/>]*)([^>]*)>/iy; // a quote in it is never closed
  const ATTRIBUTE = /([^\s"'>/=]+)(?:\s*=\s*(?:"([^"]*)"|'([^']*)'|([^\s"'>]+)))?/g;
  const REFERENCE = /&(#[0-9]+;?|#x[0-9a-f]+;?|[^\t\n\f <&#;]{1,32};?)/gi;

  const [LOGIN, TITLE] = [data.markup.login, data.markup.title].map((one) => new RegExp(one, "i"));

  const isMarkup = (text) => text.startsWith("<") && MARKS.some((mark) => text.toLowerCase().includes(mark));

  // --- characters

  /** The character of a number, as browsers have it: of 128 to 159 those of Windows. */
  function numbered(n) {
    if (n >= 0x80 && n < 0xa0) return data.markup.windows[n - 0x80];
    return n === 0 || n > 0x10ffff || (n >= 0xd800 && n < 0xe000) ? "\ufffd" : String.fromCodePoint(n);
  }

  function named(name) {
    const { entities } = data.markup;
    for (let to = name.length; to > 1; to -= 1) {
      const head = name.slice(0, to);
      if (Object.hasOwn(entities, head)) return entities[head] + name.slice(to);
    }
    return `&${name}`;
  }

  const plain = (text) => (!text.includes("&") ? text : text.replace(REFERENCE, (_, name) => {
    if (!name.startsWith("#")) return named(name);
    return numbered(/^#x/i.test(name) ? parseInt(name.slice(2), 16) : parseInt(name.slice(1), 10));
  }));

  const local = (name) => name.slice(name.lastIndexOf(":") + 1).toLowerCase();

  function attributes(text) {
    const out = {};
    for (const [, name, a, b, c] of text.matchAll(ATTRIBUTE)) out[local(name)] = plain(a ?? b ?? c ?? "");
    return out;
  }

  // --- tags

  /** End of a comment, a declaration, or an instruction that begins here and is no tag. */
  function passed(text, at) {
    const end = text.startsWith("<!--", at) ? "-->" : text.startsWith("<![CDATA[", at) ? "]]>" : ">";
    const found = text.indexOf(end, at + 2);
    return found < 0 ? text.length : found + end.length;
  }

  /** The tag that begins here, and where it ends; null where none does. */
  function tagAt(text, at) {
    for (const pattern of [START, LOOSE]) {
      pattern.lastIndex = at;
      const found = pattern.exec(text);
      if (found) return { name: local(found[1]), given: found[2], end: pattern.lastIndex };
    }
    return null;
  }

  /** Passes the tags and texts of a page to `handler`, one after the other; a part cut off at its end is left out. */
  function scan(text, handler) {
    let at = 0;
    while (at < text.length) {
      const next = text.indexOf("<", at);
      if (next < 0) return handler.text(text.slice(at));
      if (next > at) handler.text(text.slice(at, next));
      at = tagOrText(text, next, handler);
    }
    return undefined;
  }

  /** Tells what begins with "<" here; where it ends. */
  function tagOrText(text, at, handler) {
    const letter = text[at + 1] ?? "";
    if (letter === "/" || letter === "!" || letter === "?") {
      const end = passed(text, at);
      if (letter === "/" && /[a-z]/i.test(text[at + 2] ?? "")) handler.end(local(/^[^\s/>]*/.exec(text.slice(at + 2, end))[0]));
      return end;
    }
    if (!/[a-z]/i.test(letter)) {
      handler.text("<");
      return at + 1;
    }
    const tag = tagAt(text, at);
    if (tag === null) return text.length;
    handler.start(tag.name, attributes(tag.given));
    if (tag.given.endsWith("/")) handler.end(tag.name);
    else if (tag.name === "script" || tag.name === "style") return codeEnd(text, tag);
    return tag.end;
  }

  /** Position at which a script or style element ends; its content is no text. */
  function codeEnd(text, { name, end }) {
    const close = new RegExp(`</${name}`, "gi");
    close.lastIndex = end;
    return close.exec(text)?.index ?? text.length;
  }

  // --- tables

  function checkCells(count) {
    if (count > CELLS) throw new InputError(`has a table of ${count} cells; at most ${CELLS} are read`);
  }

  function number(text, otherwise) {
    const found = /^\d{1,7}$/.test(text ?? "") ? Number(text) : otherwise;
    checkCells(found);
    return found;
  }

  /** Rows or cells that an XML Spreadsheet leaves out before this one. */
  const skipped = (given, have) => Math.max(number(given.index, have + 1) - have - 1, 0);

  /** Rows of cells of every table, those of a table within a cell apart. */
  class Tables {
    tables = [];
    open = []; // { rows, below: column to the rows below that a cell spans }
    cell = null; // text, across, down

    start(tag, given) {
      const table = this.open.at(-1);
      if (tag === "table") {
        this.ended();
        this.open.push({ rows: [], below: new Map() });
        this.tables.push(this.open.at(-1).rows);
      } else if (["tr", "row"].includes(tag) && table) {
        this.ended();
        for (let left = skipped(given, table.rows.length); left >= 0; left -= 1) table.rows.push([]);
        checkCells(table.rows.length);
        this.spanned();
      } else if (["td", "th", "cell"].includes(tag) && table?.rows.length) {
        this.ended();
        const row = table.rows.at(-1);
        for (let left = skipped(given, row.length); left > 0; left -= 1) row.push("");
        this.cell = { text: "", across: number(given.colspan, 1) + number(given.mergeacross, 0), down: number(given.rowspan, 1) };
      } else if (["br", "p"].includes(tag) && this.cell) this.cell.text += " ";
    }

    end(tag) {
      if (["td", "th", "cell", "tr", "row"].includes(tag)) this.ended();
      else if (tag === "table" && this.open.length) {
        this.ended();
        this.open.pop();
      }
    }

    text(text) {
      if (this.cell) this.cell.text += plain(text);
    }

    /** The cell at hand, into its row. */
    ended() {
      const { cell } = this;
      const table = this.open.at(-1);
      this.cell = null;
      if (!cell || !table?.rows.length) return;
      const row = table.rows.at(-1);
      checkColumns(row.length + cell.across);
      for (let i = 0; i < cell.across; i += 1) {
        if (cell.down > 1) table.below.set(row.length, cell.down - 1);
        row.push(i ? "" : cell.text.split(/\s+/).filter(Boolean).join(" "));
      }
      this.spanned();
    }

    /** Adds empty cells where a cell of a row above spans this row. */
    spanned() {
      const table = this.open.at(-1);
      if (!table?.rows.length) return;
      const { below } = table;
      const row = table.rows.at(-1);
      for (let left = below.get(row.length); left > 0; left = below.get(row.length)) {
        below.set(row.length, left - 1);
        row.push("");
      }
      checkColumns(row.length);
    }
  }

  /** The largest table of a page. */
  function tableOf(text) {
    const found = new Tables();
    scan(text, found);
    const rows = found.tables.reduce((best, one) => (one.length > best.length ? one : best), []);
    if (!rows.some((row) => row.some((cell) => /[0-9]/.test(cell)))) {
      const title = TITLE.exec(text);
      const called = title ? `, '${plain(title[1]).trim().split(/\s+/).join(" ")}',` : "";
      if (LOGIN.test(text)) throw new InputError(`is a web page${called} that asks for a login`, { hint: "log in to the historian, and export again" });
      throw new InputError(`is a web page${called} without a table of numbers`, { hint: "open it in a browser to see what it says; save the table as CSV or .xlsx" });
    }
    const width = rows.reduce((most, row) => Math.max(most, row.length), 0);
    checkColumns(width);
    if (width * rows.length > CELLS) {
      throw new InputError(`has a table of ${rows.length} rows and ${width} columns; at most ${CELLS} cells are read`);
    }
    return ofSheet({ name: "table", first: 0, rows: rows.map((row) => [...row, ...Array(width - row.length).fill("")]) });
  }

  return { isMarkup, tableOf };
};
