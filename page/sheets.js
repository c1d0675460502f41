// The sheets of a workbook (.xlsx) with typed cells, as python-calamine gives them to python/glapp/reading/excel.py.
"use strict";

const Sheets = (() => {
  const DAY = 86_400_000;
  const BUILTIN = new Set([14, 15, 16, 17, 18, 19, 20, 21, 22, 45, 47]); // ECMA-376 18.8.30: dates and times of day
  const ELAPSED = 46; // [h]:mm:ss
  const PER_CENT = new Set([9, 10]);
  const EPOCH = { 1900: -25_569, 1904: -24_107 }; // day 0 of each calendar, in days since 1970

  const part = (name) => `(?:[\\w.-]+:)?${name}`;
  const made = new Map();

  /** Elements of one name; none that holds others of its name is asked for. */
  function element(name) {
    if (!made.has(name)) made.set(name, new RegExp(`<${part(name)}(?=[\\s/>])([^>]*?)(?:/>|>([\\s\\S]*?)</${part(name)}>)`, "g"));
    return made.get(name);
  }

  const ENTITIES = { amp: "&", lt: "<", gt: ">", quot: '"', apos: "'" };
  const plain = (text) => (!text.includes("&") ? text : text.replace(/&(?:#(\d+)|#x([\da-f]+)|(\w+));/gi, (all, tens, hex, name) =>
    (tens ? String.fromCodePoint(Number(tens)) : hex ? String.fromCodePoint(parseInt(hex, 16)) : ENTITIES[name] ?? all)));

  const TAG = /<(?:\?[^>]*\?|!--[\s\S]*?--|\/([^\s<>/]+)\s*|([^\s<>/!?]+)(?:\s+[\w:.-]+\s*=\s*(?:"[^"<]*"|'[^'<]*'))*\s*(\/?))>/y;

  /** The text where it is XML whose elements are closed: damaged XML must not be read in part. */
  function whole(text) {
    const open = [];
    for (let at = text.indexOf("<"); at >= 0; at = text.indexOf("<", at)) {
      TAG.lastIndex = at;
      const [tag, ended, begun, empty] = TAG.exec(text) ?? [];
      if (tag === undefined || (ended !== undefined && open.pop() !== ended)) throw new Error(`damaged at '${text.slice(at, at + 20)}'`);
      if (begun !== undefined && !empty) open.push(begun);
      at += tag.length;
    }
    if (open.length) throw new Error(`'${open.at(-1)}' is not ended`);
    return text;
  }

  function attributes(text) {
    const out = {};
    for (const [, space, name, a, b] of text.matchAll(/([\w.-]+:)?([\w.-]+)\s*=\s*(?:"([^"]*)"|'([^']*)')/g)) {
      out[(space === "r:" ? space : "") + name] = plain(a ?? b);
    }
    return out;
  }

  const all = (text, name) => [...text.matchAll(element(name))].map(([, given, inner]) => ({ ...attributes(given), inner: inner ?? "" }));
  const texts = (inner) => all(inner.replace(element("rPh"), ""), "t").map((t) => plain(t.inner)).join("");

  /** Whether a format written by hand shows a date or a time ("moment"), a time span ("span") or per cent ("per_cent"). */
  function shown(code) {
    const bare = code.replace(/"[^"]*"|[\\_*]./g, "").split(";")[0];
    if (bare.includes("%")) return "per_cent";
    if (/\[(?:h+|m+|s+)\]/i.test(bare)) return "span";
    return /[dmhys]|a\/p|am\/pm/i.test(bare.replace(/\[[^\]]*\]/g, "")) ? "moment" : null;
  }

  function styles(text) {
    const own = new Map(all(text, "numFmt").map((format) => [Number(format.numFmtId), shown(format.formatCode ?? "")]));
    const [cells] = all(text, "cellXfs");
    return all(cells?.inner ?? "", "xf").map(({ numFmtId }) => {
      const id = Number(numFmtId ?? 0);
      if (own.has(id)) return own.get(id);
      if (id === ELAPSED) return "span";
      if (PER_CENT.has(id)) return "per_cent";
      return BUILTIN.has(id) || (id >= 27 && id <= 36) || (id >= 50 && id <= 58) ? "moment" : null;
    });
  }

  const place = (reference) => {
    const [, letters, row] = /^([A-Z]{1,3})(\d+)$/.exec(reference) ?? [];
    if (!letters) throw new Error(`cell '${reference}'`);
    return [[...letters].reduce((sum, letter) => sum * 26 + letter.charCodeAt(0) - 64, 0) - 1, Number(row) - 1];
  };

  /** A number as its style shows it. */
  function styled(value, style, epoch) {
    if (style === "span") return { span: value * 86_400 };
    if (style === "per_cent") return { per_cent: Number((value * 100).toPrecision(15)) }; // as many digits as Excel keeps
    if (style === null || style === undefined) return value;
    const ms = Math.round(value * DAY);
    if (!(Math.abs(ms) < 1e14)) throw new Error(`${value} is no date`);
    if (value < 1) return { time: ms };
    return Number.isInteger(value) ? { date: ms + EPOCH[epoch] * DAY } : { moment: ms + EPOCH[epoch] * DAY };
  }

  function value({ t = "n", s, inner }, shared, style, epoch) {
    if (t === "inlineStr") return texts(inner);
    const [v] = all(inner, "v");
    if (!v || (v.inner === "" && t !== "str")) return "";
    const text = plain(v.inner);
    if (t === "e") return "";
    if (t === "str" || t === "d") return text;
    if (t === "b") return text === "1";
    const number = Number(text);
    if (Number.isNaN(number)) throw new Error(`'${text}' is no number`);
    if (t !== "s") return styled(number, style[Number(s ?? 0)], epoch);
    if (!(number in shared)) throw new Error(`text ${text} is missing`);
    return shared[number];
  }

  /** Rows of cells, "" where empty, without the empty rows and columns before the first that is not; `first`: rows above. */
  function table(text, shared, style, epoch) {
    const from = text.search(new RegExp(`<${part("sheetData")}[\\s/>]`));
    if (from < 0) throw new Error("a sheet has no data");
    const rows = new Map();
    let [left, right, row] = [Infinity, -1, -1];
    for (const { r, inner } of all(text.slice(from), "row")) {
      row = r === undefined ? row + 1 : Number(r) - 1;
      let at = -1;
      for (const cell of all(inner, "c")) {
        at = cell.r === undefined ? at + 1 : place(cell.r)[0];
        const held = value(cell, shared, style, epoch);
        if (held === "") continue;
        if (!rows.has(row)) rows.set(row, new Map());
        rows.get(row).set(at, held);
        left = Math.min(left, at);
        right = Math.max(right, at);
      }
    }
    if (!rows.size) return null;
    const places = [...rows.keys()].sort((a, b) => a - b);
    const [first, last] = [places[0], places.at(-1)];
    const filled = Array.from({ length: last - first + 1 }, (_, i) => {
      const held = rows.get(first + i);
      return Array.from({ length: right - left + 1 }, (__, k) => held?.get(left + k) ?? "");
    });
    return { first, rows: filled };
  }

  /** The sheets that hold something: name, rows above the first, cells. `check`: refuses by the names of all files. */
  function open(bytes, check) {
    const names = [];
    const parts = Formats.unzip(bytes, (name) => names.push(name) && /^xl\/(workbook|sharedStrings|styles|worksheets\/|_rels\/).*(xml|rels)$/i.test(name));
    check(names);
    const decoder = new TextDecoder("utf-8", { fatal: true });
    const text = (name) => (parts[name] ? whole(decoder.decode(parts[name])) : "");
    const book = text("xl/workbook.xml");
    if (!book) throw new Error("it has no workbook");
    const relations = new Map(all(text("xl/_rels/workbook.xml.rels"), "Relationship").map(({ Id, Target, Type }) => [Id, { Target, Type }]));
    const shared = all(text("xl/sharedStrings.xml"), "si").map(({ inner }) => texts(inner));
    const style = styles(text("xl/styles.xml"));
    const [settings] = all(book, "workbookPr");
    const epoch = ["1", "true"].includes(settings?.date1904) ? 1904 : 1900;
    return all(book, "sheet").flatMap(({ name, "r:id": id }) => {
      const { Target, Type } = relations.get(id) ?? {};
      if (!Target) throw new Error(`sheet '${name}' is missing`);
      if (!/\/worksheet$/.test(Type)) return [];
      const path = Target.startsWith("/") ? Target.slice(1) : `xl/${Target}`;
      const found = table(text(path), shared, style, epoch);
      return found === null ? [] : [{ name, ...found }];
    });
  }

  return { open };
})();
