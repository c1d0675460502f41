// Assignment of columns and tags to the signals of loops: python/glapp/reading/meaning.py, kin.py and columns.py.
"use strict";

const Names = (data) => {
  const MOST_WORDS = 4; // "position de la vanne"
  const INSIDE = 6; // letters of a word that is a signal's in the middle of a name too
  const UNIT = new RegExp(data.columns.unit);
  const TOKEN = new RegExp(data.columns.token, "g");
  const FIELD = new RegExp(data.columns.field, "i");
  const HOST = new RegExp(data.columns.host);
  const JOINED = new RegExp(`^(?:${data.columns.joined})$`, "i");
  const CURRENT = new Set(data.columns.current);
  const LIMITS = new Set(data.columns.limits);
  const BLOCK = new RegExp(`^(?:${data.columns.block})$`);
  const INSTRUMENT = new RegExp(`^(?:${data.columns.instrument})$`, "i");

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

  /** Meaning of a column's name: role, loop ("" where the name has no more to it), unit, and a word that is not
   * sure. */
  function understand(name) {
    const none = { role: null, loop: "", unit: null, weak: null };
    const [host] = HOST.exec(name) ?? [];
    if (host) {
      const of = understand(name.replace(host, ""));
      return of.loop ? { ...of, loop: of.loop + host } : of;
    }
    let text = name.trim().replace(FIELD, "");
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

  /** The tag of which a column's name says that it holds the times; null where it does not say so. */
  function timeOf(name) {
    const tokens = [...name.matchAll(TOKEN)];
    if (tokens.length < 2 || data.columns.whole[folded(tokens.at(-1)[0])] !== "time") return null;
    const tag = strip(name.slice(0, tokens.at(-1).index), true);
    return ["sp", "pv", "op", "mode", "position"].includes(understand(tag).role) ? tag : null;
  }

  /** A prefix taken apart: what it has in common with others of its loop, its name without a block, and the roles it has. */
  function kinOf(prefix) {
    const block = BLOCK.exec(prefix);
    const word = block && folded(block[2]);
    let kind = block && Object.hasOwn(data.columns.blocks, word) ? data.columns.blocks[word] : null;
    const tag = kind ? block[1] : prefix;
    const found = INSTRUMENT.exec(tag);
    if (!found) return { key: folded(tag), tag, roles: data.columns.kinds[kind ?? "controller"] };
    const [, before, variable, does, number] = found;
    kind ??= /[vyz]/i.test(does) ? "output" : /c/i.test(does) ? "controller" : "input";
    return { key: folded(before + variable + number), tag, roles: data.columns.kinds[kind] };
  }

  /** The loop of each signal whose prefix is not its loop's: prefix and role to the loop. */
  function shared(signals) {
    const families = new Map();
    for (const [prefix, has] of signals) {
      if (!prefix) continue;
      const { key, tag, roles } = kinOf(prefix);
      families.set(key, [...(families.get(key) ?? []), { prefix, tag, has, fits: roles.filter((role) => has.has(role)) }]);
    }
    return new Map([...families.values()].flatMap((family) => (family.length > 1 ? ofFamily(family) : [])).map(([prefix, role, loop]) => [`${role} ${prefix}`, loop]));
  }

  /** The loop of each signal in one family of prefixes. */
  function ofFamily(family) {
    let whole = family.filter(({ has }) => has.has("sp") && has.has("pv"));
    if (!whole.length) whole = family.filter(({ fits }) => fits.includes("pv") && fits.includes("op"));
    if (whole.length > 1) return [];
    if (whole.length) {
      const [loop] = whole;
      const others = family.flatMap((one) => (one === loop ? [] : one.fits.map((role) => [one.prefix, role])));
      return others
        .filter(([, role]) => role !== "quality" && !loop.has.has(role) && others.filter(([, other]) => other === role).length === 1)
        .map(([prefix, role]) => [prefix, role, loop.prefix]);
    }
    const first = ["sp", "op"].map((role) => family.find(({ fits }) => fits.includes(role))).find(Boolean);
    if (!first || !family.some(({ fits }) => fits.includes("pv"))) return [];
    return family.flatMap(({ prefix, fits }) => fits.map((role) => [prefix, role, first.tag]));
  }

  /**
   * The words that are not sure get the first of their roles that no other column of their loop has, and signals of
   * other prefixes get their loop. `modes`: whether the column at a place holds modes, and no numbers.
   */
  function settle(meanings, modes) {
    const roles = new Map();
    const open = new Map();
    const rolesOf = (word, at) => {
      const may_be = data.columns.weak[word];
      if (!may_be.includes("mode")) return may_be;
      return may_be.filter((role) => (role === "mode") === at.some(modes));
    };
    for (const [i, { role, loop, weak }] of meanings.entries()) {
      if (!roles.has(loop)) roles.set(loop, new Set());
      if (role) roles.get(loop).add(role);
      if (weak) {
        if (!open.has(loop)) open.set(loop, new Map());
        open.get(loop).set(weak, [...(open.get(loop).get(weak) ?? []), i]);
      }
    }
    for (const [loop, words] of open) {
      const have = roles.get(loop);
      if (!["sp", "pv", "op", "position"].some((role) => have.has(role)) && words.size < 3) continue;
      const may_be = new Map([...words].map(([word, at]) => [word, rolesOf(word, at)]));
      while (words.size) {
        const left = [...words.keys()].map((word) => [word, may_be.get(word).filter((role) => !have.has(role))]);
        const first = left.find(([, of]) => of.length);
        if (!first) break;
        const sure = left.filter(([, of]) => of.length === 1);
        for (const [word, of] of sure.length ? sure : [first]) {
          for (const i of words.get(word)) meanings[i].role = of[0];
          words.delete(word);
          have.add(of[0]);
        }
      }
    }
    const signals = new Map();
    for (const { role, loop } of meanings) if (role) signals.set(loop, (signals.get(loop) ?? new Set()).add(role));
    const others = shared(signals);
    for (const one of meanings) one.loop = others.get(`${one.role} ${one.loop}`) ?? one.loop;
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

  /** Column for every role of one loop; what a person chose in `columns` wins, -1 says that there is none; none of the roles `without` has one; `kind` is what a person calls them. */
  function choose(names, meanings, loops, loop, columns, without, kind) {
    const chosen = {};
    const taken = new Set(Object.values(columns));
    for (const role of Object.keys(data.columns.labels)) {
      if (["tag", "value", ...without].includes(role)) continue;
      if (columns[role] !== undefined) {
        if (columns[role] >= 0) chosen[role] = columns[role];
        continue;
      }
      const fits = (prefix) => meanings.flatMap((m, i) => (m.role === role && m.loop === prefix && !taken.has(i) ? [i] : []));
      let found = role === "time" ? meanings.flatMap((m, i) => (m.role === "time" ? [i] : [])) : fits(loop);
      if (!found.length && role !== "time" && loops.length <= 1) found = fits("");
      if (found.length > 1) {
        const name = (i) => (names.filter((other) => other === names[i]).length > 1 ? `${names[i]} (${kind} ${i + 1})` : names[i]);
        const both = found.map((i) => `'${name(i)}'`).join(" and ");
        throw new InputError(`the ${kind}s ${both} could ${found.length === 2 ? "both" : "all"} be ${data.columns.labels[role]}`, { hint: "choose one below" });
      }
      if (found.length) chosen[role] = found[0];
    }
    if (chosen.pv === undefined || (chosen.sp === undefined && chosen.op === undefined)) {
      throw missing(names, meanings, loops, chosen, kind);
    }
    return chosen;
  }

  /** Message where PV is missing, or SP and OP are. */
  function missing(names, meanings, loops, chosen, kind) {
    const taken = Object.entries(chosen).map(([role, at]) => `${data.columns.labels[role]} is ${names[at]}`).join(", ");
    const also = taken ? ` (${taken})` : "";
    const left = names.filter((_, i) => !Object.values(chosen).includes(i));
    let roles = chosen.sp !== undefined || chosen.op !== undefined ? ["pv"] : ["pv", "op"].filter((role) => chosen[role] === undefined);
    if (left.length >= roles.length) {
      // FIC101.SP and FIC101.OP alone make no loop, and yet it is plain that PV is missing.
      const meant = new Set(meanings.flatMap(({ role }, i) => (Object.values(chosen).includes(i) ? [] : [role])));
      const open = loops.length ? roles : roles.filter((role) => !meant.has(role));
      if (!open.length) {
        return new InputError(`the names of the ${kind}s show no loop: ${listed(left)}${also}`, { hint: "choose the signals below" });
      }
      roles = open;
      const what = `no ${kind} for ${roles.map((role) => data.columns.labels[role]).join(" and ")} among those left: ${listed(left)}${also}`;
      return new InputError(what, { hint: `choose ${roles.length === 1 ? "it" : "them"} below` });
    }
    if (roles.length === 1 && roles[0] === "pv") {
      return new InputError(`no ${kind} for PV: all are taken${also}`, { hint: "export PV as well; where one of these is PV, choose it below" });
    }
    const signal = chosen.pv === undefined ? left[0] : names[chosen.pv];
    return new InputError(`${signal === undefined ? "has no signal" : `has only one signal, ${signal}`}${also}`, {
      hint: "it takes OP and PV of a loop to tell of its valve, and SP tells more: export them into one file",
    });
  }

  function listed(names) {
    const shown = names.slice(0, 20).map((name) => (name.trim() ? name : "(no name)")).join(", ");
    return names.length > 20 ? `${shown} and ${names.length - 20} more` : shown;
  }

  /** Whether this is a table with a row per tag and time. */
  const isLong = (names) => {
    const roles = names.map((name) => understand(name).role);
    return roles.includes("tag") && roles.includes("value") && !roles.includes("pv");
  };

  /** Names in which each of several columns called Quality is called after the signal on its left. */
  function withOwnQualities(names) {
    const meant = names.map(understand);
    const at = meant.flatMap((meaning, i) => (meaning.role === "quality" && meaning.loop === "" ? [i] : []));
    const signals = at.map((i) => (i ? meant[i - 1].role : null));
    if (at.length < 2 || !signals.includes("pv") || !signals.every((role) => ["sp", "pv", "op", "mode", "position"].includes(role))) return names;
    return names.map((name, i) => (at.includes(i) ? `${names[i - 1].replace(UNIT, "").trim()} ${name.trim()}` : name));
  }

  return { folded, understand, timeOf, settle, groups, choose, isLong, withOwnQualities };
};
