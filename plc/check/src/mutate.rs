//! Mutants: a source file with one operator, literal or name changed.

use crate::library::{Library, read_unit};
use crate::tree::{Fault, Unit};
use std::collections::HashMap;

/// A file with one change.
#[derive(Clone, Debug)]
pub struct Mutant {
    /// Name of the file; with `real/` before it where it stands there.
    pub file: String,
    /// The line as it was and as it is, without the spaces before it.
    pub line: (String, String),
    /// Number of the line among equal lines of the file, from 1.
    pub which: usize,
    /// The whole file as it is.
    pub text: String,
}

/// Names of the same type that a name may be replaced by.
struct Names {
    /// Variables of the unit: name, type.
    own: Vec<(String, String)>,
    /// Fields of structures, pins of blocks: the unit, then name, type.
    of: HashMap<String, Vec<(String, String)>>,
    /// Functions by what they take and give.
    functions: Vec<(String, String)>,
}

/// A library whose files are changed one at a time.
#[derive(Clone, Debug)]
pub struct Mutants {
    sources: Vec<(String, String)>,
    units: Vec<Unit>,
}

impl Mutants {
    /// Names in the unchanged library in LREAL; a file of `real/` replaces its twin.
    ///
    /// # Errors
    /// Where a file is refused as it stands.
    pub fn new(sources: &[(String, String)]) -> Result<Self, Fault> {
        let units = sources.iter().map(|(name, text)| read_unit(name, text)).collect::<Result<_, _>>()?;
        Ok(Self { sources: sources.to_vec(), units })
    }

    /// The library with another text in the place of a file's.
    ///
    /// # Errors
    /// Where there is no such file, or it is refused.
    pub fn with(&self, file: &str, text: &str) -> Result<Library, Fault> {
        let Some(place) = self.sources.iter().position(|(name, _)| name == file) else {
            return Err(Fault::new(file, 0, "no such file"));
        };
        let mut units = self.units.clone();
        units[place] = read_unit(file, text)?;
        Library::built(&units)
    }

    /// Mutants of a file, those that both parsers read and whose names and types fit, in the order of the text; and the library with each.
    ///
    /// # Errors
    /// Where there is no such file.
    pub fn of(&self, file: &str) -> Result<impl Iterator<Item = (Mutant, Library)> + use<>, Fault> {
        let mut text = Text::of(self, file)?;
        Ok((0..text.tokens.len()).filter_map(move |at| text.changed(at)))
    }

    /// Mutants drawn by a seed, so many of them; all where there are fewer.
    ///
    /// # Errors
    /// As [`of`](Self::of).
    pub fn drawn(
        &self,
        file: &str,
        seed: u64,
        count: usize,
    ) -> Result<impl Iterator<Item = (Mutant, Library)> + use<>, Fault> {
        let mut text = Text::of(self, file)?;
        let mut places = text.places();
        // Fisher and Yates, with the numbers of Marsaglia's xorshift.
        let mut number = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
        for last in (1..places.len()).rev() {
            number ^= number << 13;
            number ^= number >> 7;
            number ^= number << 17;
            places.swap(last, (number >> 11) as usize % (last + 1));
        }
        Ok(places.into_iter().filter_map(move |at| text.changed(at)).take(count))
    }

    /// Number of operators, literals and names of a file that can change; a few of them have no change that fits.
    ///
    /// # Errors
    /// As [`of`](Self::of).
    pub fn places(&self, file: &str) -> Result<usize, Fault> {
        Ok(Text::of(self, file)?.places().len())
    }
}

/// A file, and what of it can be changed.
struct Text {
    file: String,
    text: String,
    plain: String,
    tokens: Vec<(usize, usize)>,
    body: usize,
    names: Names,
    units: Vec<Unit>,
    place: usize,
}

impl Text {
    fn of(all: &Mutants, file: &str) -> Result<Self, Fault> {
        let Some(place) = all.sources.iter().position(|(name, _)| name == file) else {
            return Err(Fault::new(file, 0, "no such file"));
        };
        let text = all.sources[place].1.clone();
        let names = Names::of(&all.sources, &text);
        let plain = blanked(&text);
        let (tokens, body) = (tokens(&plain), body(&plain));
        Ok(Self { file: file.to_owned(), text, plain, tokens, body, names, units: all.units.clone(), place })
    }

    fn changes(&self, at: usize) -> Vec<String> {
        changes(&self.plain, &self.tokens, at, self.tokens[at].0 >= self.body, &self.names)
    }

    fn places(&self) -> Vec<usize> {
        (0..self.tokens.len()).filter(|at| !self.changes(*at).is_empty()).collect()
    }

    /// Mutant with the first change of a token that fits.
    fn changed(&mut self, at: usize) -> Option<(Mutant, Library)> {
        let (from, to) = self.tokens[at];
        for instead in self.changes(at) {
            let changed = format!("{}{instead}{}", &self.text[..from], &self.text[to..]);
            let Ok(unit) = read_unit(&self.file, &changed) else { continue };
            let before = std::mem::replace(&mut self.units[self.place], unit);
            let library = Library::built(&self.units);
            self.units[self.place] = before;
            if let Ok(library) = library {
                let number = self.text[..from].matches('\n').count();
                let shown = |text: &str| text.lines().nth(number).unwrap_or("").trim().to_owned();
                let line = (shown(&self.text), shown(&changed));
                let which = self.text.lines().take(number + 1).filter(|one| one.trim() == line.0).count();
                return Some((Mutant { file: self.file.clone(), line, which, text: changed }, library));
            }
        }
        None
    }
}

/// The text with blanks in place of its comments.
fn blanked(text: &str) -> String {
    let (mut out, mut rest) = (String::with_capacity(text.len()), text);
    while let Some((before, after)) = rest.split_once("(*") {
        let (within, after) = after.split_once("*)").unwrap_or((after, ""));
        out.push_str(before);
        out.extend(format!("(*{within}*)").chars().map(|c| if c == '\n' { c } else { ' ' }));
        rest = after;
    }
    out + rest
}

/// Begin and end of words, numbers and signs.
fn tokens(plain: &str) -> Vec<(usize, usize)> {
    let bytes = plain.as_bytes();
    let word = |b: u8| b.is_ascii_alphanumeric() || b == b'_';
    let (mut all, mut at) = (vec![], 0);
    while at < bytes.len() {
        let from = at;
        at += 1;
        if bytes[from].is_ascii_whitespace() {
            continue;
        }
        if bytes[from].is_ascii_digit() {
            while at < bytes.len()
                && (word(bytes[at])
                    || (bytes[at] == b'.' && bytes.get(at + 1).is_some_and(u8::is_ascii_digit))
                    || (b"+-".contains(&bytes[at]) && bytes[at - 1] == b'E'))
            {
                at += 1;
            }
        } else if word(bytes[from]) {
            while at < bytes.len() && word(bytes[at]) {
                at += 1;
            }
        } else if bytes
            .get(from..from + 2)
            .is_some_and(|two| [b":=", b"<=", b">=", b"<>", b".."].contains(&&[two[0], two[1]]))
        {
            at += 1;
        }
        all.push((from, at));
    }
    all
}

/// Offset of the first statement; the end of the text where there are none.
fn body(plain: &str) -> usize {
    if plain.contains("END_STRUCT") {
        return plain.len();
    }
    plain.rfind("END_VAR").map_or(0, |at| at + "END_VAR".len())
}

/// Replacements of a token; the first that fits is taken.
fn changes(plain: &str, tokens: &[(usize, usize)], at: usize, within: bool, names: &Names) -> Vec<String> {
    let word = |at: usize| tokens.get(at).map_or("", |(from, to)| &plain[*from..*to]);
    let before = |back: usize| if at >= back { word(at - back) } else { "" };
    let (this, last) = (word(at), before(1));
    let one = |text: &str| vec![text.to_owned()];
    if this == "TRUE" || this == "FALSE" {
        return one(if this == "TRUE" { "FALSE" } else { "TRUE" });
    }
    if this.starts_with(|c: char| c.is_ascii_digit()) {
        let begins = last == ":=" || (last == "-" && before(2) == ":=");
        if !within && !begins {
            return vec![];
        }
        return match (this.parse::<i64>(), this.parse::<f64>()) {
            (Ok(whole), _) => vec![(whole + 1).to_string(), (whole - 1).to_string()],
            (_, Ok(0.0)) => one("1.0"),
            (_, Ok(number)) => {
                let twice = format!("{:?}", 2.0 * number).replace('e', "E");
                vec![if twice.contains('E') && !twice.contains('.') { twice.replace('E', ".0E") } else { twice }]
            }
            _ => vec![],
        };
    }
    if !within {
        return vec![];
    }
    let unary = ["(", ",", ":=", "=", "<>", "<", "<=", ">", ">=", "THEN"].contains(&last);
    match this {
        "+" => return one("-"),
        "-" if unary => return one(""),
        "-" => return one("+"),
        "*" => return one("/"),
        "/" | "MOD" => return one("*"),
        "=" => return one("<>"),
        "<>" => return one("="),
        "<" => return one("<="),
        "<=" => return one("<"),
        ">" => return one(">="),
        ">=" => return one(">"),
        "AND" => return one("OR"),
        "OR" | "XOR" => return one("AND"),
        "NOT" => return one(""),
        _ => {}
    }
    if last == "." {
        // A field, or an output: what is before the dot has a type, whose others of this type may stand here.
        let mut path = vec![this];
        let mut back = at;
        while back >= 2 && word(back - 1) == "." {
            path.push(word(back - 2));
            back -= 2;
        }
        path.reverse();
        let mut ty = names.own.iter().find(|(name, _)| name == path[0]).map(|(_, ty)| ty.clone());
        for part in &path[1..path.len() - 1] {
            ty = ty.and_then(|ty| names.field(&ty, part));
        }
        return ty.and_then(|ty| names.of.get(&ty)).map_or(vec![], |fields| others(fields, this));
    }
    if word(at + 1) == ":=" && (last == "(" || last == ",") {
        // A pin of the block that is called.
        let (mut back, mut depth) = (at, 0);
        while back > 0 && depth < 1 {
            back -= 1;
            depth += match word(back) {
                "(" => 1,
                ")" => -1,
                _ => 0,
            };
        }
        let called = if back > 0 { word(back - 1) } else { "" };
        let ty = names.own.iter().find(|(name, _)| name == called).map(|(_, ty)| ty);
        return ty.and_then(|ty| names.of.get(ty)).map_or(vec![], |pins| others(pins, this));
    }
    if names.functions.iter().any(|(name, _)| name == this) && word(at + 1) == "(" {
        return others(&names.functions, this);
    }
    others(&names.own, this)
}

/// Others of the type of a name, those behind it first.
fn others(all: &[(String, String)], name: &str) -> Vec<String> {
    let Some(place) = all.iter().position(|(known, _)| known == name) else { return vec![] };
    let ty = &all[place].1;
    let behind = all[place + 1..].iter().chain(&all[..place]);
    behind.filter(|(_, other)| other == ty).map(|(name, _)| name.clone()).collect()
}

impl Names {
    fn of(sources: &[(String, String)], text: &str) -> Self {
        let mut of = HashMap::new();
        let mut functions = vec![];
        for (file, text) in sources {
            let plain = blanked(text);
            let name = format!("Glapp{}", file.trim_end_matches(".st"));
            let all = declared(&plain);
            if let Some((_, returns)) = plain.split_once(&format!("FUNCTION {name} : ")) {
                let inputs: Vec<&str> = all.iter().map(|(_, ty)| ty.as_str()).collect();
                functions
                    .push((name.clone(), format!("{inputs:?} {}", returns.split_whitespace().next().unwrap_or(""))));
            }
            of.insert(name, all);
        }
        let plain = blanked(text);
        let mut own = declared(&plain);
        if let Some((_, rest)) = plain.split_once("FUNCTION ")
            && let Some((name, returns)) = rest.split_once(" : ")
        {
            own.push((name.to_owned(), returns.split_whitespace().next().unwrap_or("").to_owned()));
        }
        Self { own, of, functions }
    }

    fn field(&self, unit: &str, field: &str) -> Option<String> {
        self.of.get(unit)?.iter().find(|(name, _)| name == field).map(|(_, ty)| ty.clone())
    }
}

/// Names and types that a unit declares.
fn declared(plain: &str) -> Vec<(String, String)> {
    let end = if plain.contains("END_STRUCT") { plain.len() } else { body(plain) };
    let declaration = |line: &str| {
        let (name, ty) = line.strip_suffix(';')?.split_once(" : ")?;
        Some((name.trim().to_owned(), ty.split(" := ").next()?.trim().to_owned()))
    };
    plain[..end].lines().filter_map(|line| declaration(line.trim())).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_operator_literal_and_name_once() {
        let text = "(* a < b *)
FUNCTION_BLOCK GlappTry
VAR_INPUT
    A : LREAL := 1.5;   (* 2.0 *)
    B : LREAL;
    P : BOOL;
END_VAR
VAR_OUTPUT
    Y : LREAL;
END_VAR
    IF P AND (A < 3.0) THEN
        Y := -A;
    END_IF;
END_FUNCTION_BLOCK
";
        let all = Mutants::new(&[("Try.st".into(), text.into())]).unwrap();
        let shown: Vec<String> = all.of("Try.st").unwrap().map(|(mutant, _)| mutant.line.1).collect();
        let expected = [
            "A : LREAL := 3.0;   (* 2.0 *)",
            "IF P OR (A < 3.0) THEN",
            "IF P AND (B < 3.0) THEN",
            "IF P AND (A <= 3.0) THEN",
            "IF P AND (A < 6.0) THEN",
            "Y := A;",
            "Y := -B;",
        ];
        assert_eq!(shown, expected);
    }
}
