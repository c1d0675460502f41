//! The subset of Structured Text that compilers have in common, held to.

use std::collections::HashMap;
use std::sync::OnceLock;

use crate::tree::{Argument, Expr, Fault, Op, Pou, Stmt, StmtKind, Type, Unit, Var};

/// Types of one value.
pub const ELEMENTARY: [&str; 4] = ["BOOL", "INT", "DINT", "LREAL"];

/// Keywords, standard functions and blocks, here or there: no name may be one, in any case.
const TAKEN: &str = "
    ABS ACOS ACTION AUTHOR CEIL FAMILY FLOOR ROUND TITLE VERSION ADD ADR AND ANY ARRAY ASIN AT ATAN ATAN2 BEGIN BOOL BY BYTE CASE CHAR CONCAT CONFIGURATION CONSTANT
    CONTINUE COS CTD CTU CTUD DATE DELETE DINT DIV DO DT DWORD ELSE ELSIF EN ENO EQ EXIT EXP EXPT EXTENDS F_EDGE F_TRIG
    FALSE FINAL FIND FOR FROM FUNCTION FUNCTION_BLOCK GE GT IF IMPLEMENTS INI INSERT INT INTERFACE INTERNAL INTERVAL LD
    LE LEFT LEN LIMIT LINT LN LOG LREAL LT LTIME LWORD MAX METHOD MID MIN MOD MOVE MUL MUX NAMESPACE NE NON_RETAIN NOT
    NULL OF ON OR OVERLAP PERSISTENT POINTER PRIORITY PRIVATE PROGRAM PROPERTY PROTECTED PUBLIC R R_EDGE R_TRIG READ
    READ_ONLY READ_WRITE REAL REF REFERENCE REPEAT REPLACE RESOURCE RETAIN RETURN RIGHT ROL ROR RS S SEL SEMA SHL SHR SIN SINGLE
    SINT SIZEOF SQRT SR STEP STOP STRING STRUCT SUB SUPER T TAN TASK THEN THIS TIME TIMER TO TOD TOF TON TP TRANSITION
    TRUE TRUNC TYPE UDINT UINT ULINT UNTIL USINT USING VAR WAIT WCHAR WHILE WITH WORD WRITE WSTRING XOR";

/// Names of others: of compilers and of the libraries that are loaded beside ours, one file for each with its source in its head.
const LISTS: [(&str, &str); 7] = [
    ("matiec", include_str!("../names/matiec.txt")),
    ("STruC++", include_str!("../names/strucpp.txt")),
    ("OSCAT", include_str!("../names/oscat.txt")),
    ("CODESYS", include_str!("../names/codesys.txt")),
    ("TwinCAT", include_str!("../names/twincat.txt")),
    ("TIA Portal", include_str!("../names/tia.txt")),
    ("AC 800M", include_str!("../names/ac800m.txt")),
];

/// Owner of a name that is taken already.
fn taken_by(name: &str) -> Option<&'static str> {
    static ALL: OnceLock<HashMap<&str, &str>> = OnceLock::new();
    let all = ALL.get_or_init(|| {
        let words =
            |text: &'static str| text.lines().filter(|line| !line.starts_with('#')).flat_map(str::split_whitespace);
        LISTS.iter().flat_map(|(whose, text)| words(text).map(move |word| (word, *whose))).collect()
    });
    all.get(&*name.to_ascii_uppercase()).copied()
}

/// The text without its comments, lines kept.
pub fn without_comments(place: &str, text: &str) -> Result<String, Fault> {
    let mut out = String::with_capacity(text.len());
    let (mut rest, mut line) = (text, 1);
    let mut within = false;
    while let Some(c) = rest.chars().next() {
        let fault = |what: &str| Err(Fault::new(place, line, what));
        if !c.is_ascii() || (c.is_ascii_control() && c != '\n') {
            return fault("a character that is not ASCII, or a control character");
        }
        let begins = |mark: &str| rest.starts_with(mark);
        if within {
            if begins("(*") {
                return fault("a comment within a comment");
            }
            if begins("*)") {
                within = false;
                rest = &rest[2..];
                continue;
            }
        } else if begins("(*") {
            within = true;
            rest = &rest[2..];
            out.push(' ');
            continue;
        } else if begins("//") || begins("/*") {
            return fault("a comment is (* ... *)");
        } else if begins("{") {
            return fault("a pragma");
        } else if begins("=>") {
            return fault("=> is not known everywhere");
        } else if begins("#") {
            return fault("a typed literal");
        } else if begins("'") || begins("\"") {
            return fault("a string");
        } else if begins("&") || begins("^") || begins("%") {
            return fault("& ^ % are not in the subset");
        }
        if c == '\n' {
            line += 1;
        }
        if !within || c == '\n' {
            out.push(c);
        }
        rest = &rest[1..];
    }
    if within { Err(Fault::new(place, line, "a comment without end")) } else { Ok(out) }
}

/// The words of a text, comments left out where they can be told.
pub(crate) fn words(text: &str) -> impl Iterator<Item = String> {
    let plain = without_comments("", text).unwrap_or_default();
    let words: Vec<String> = plain
        .split(|c: char| !(c.is_ascii_alphanumeric() || c == '_' || c == '.'))
        .filter(|word| !word.is_empty())
        .map(str::to_owned)
        .collect();
    words.into_iter()
}

/// Everything that is wrong with a file of the library, by its text and its tree.
pub fn lint(place: &str, text: &str, unit: &Unit) -> Vec<Fault> {
    let mut linter = Linter { place, line: 0, faults: vec![] };
    for word in words(text) {
        let capitals = word.to_ascii_uppercase();
        let keyword = TAKEN.split_whitespace().any(|taken| taken == capitals);
        if keyword && word != capitals {
            linter.fault(format!("{word}: keywords are in capitals"));
        }
        if matches!(
            &*capitals,
            "REPEAT" | "EXIT" | "CONTINUE" | "RETURN" | "CASE" | "VAR_TEMP" | "VAR_GLOBAL" | "REAL" | "TIME"
        ) {
            linter.fault(format!("{word} is not in the subset"));
        }
        let exponent = word.contains(['E', 'e']) && word.starts_with(|c: char| c.is_ascii_digit());
        if exponent && !word.contains('.') {
            linter.fault(format!("{word}: a number with an exponent has a point"));
        }
    }
    if !unit.name().starts_with("Glapp") {
        linter.fault(format!("{}: names of units begin with Glapp", unit.name()));
    }
    match unit {
        Unit::Struct { fields, .. } => linter.names(fields.iter()),
        Unit::Pou(pou) => linter.pou(pou),
    }
    linter.faults
}

struct Linter<'a> {
    place: &'a str,
    line: usize,
    faults: Vec<Fault>,
}

impl Linter<'_> {
    fn fault(&mut self, what: impl Into<String>) {
        self.faults.push(Fault::new(self.place, self.line, what));
    }

    fn names<'v>(&mut self, vars: impl Iterator<Item = &'v Var>) {
        let mut seen: Vec<String> = vec![];
        for var in vars {
            let capitals = var.name.to_ascii_uppercase();
            if TAKEN.split_whitespace().any(|taken| taken == capitals) {
                self.fault(format!("{} is a keyword or a standard function somewhere", var.name));
            } else if let Some(whose) = taken_by(&var.name) {
                self.fault(format!("{} is a name of {whose} already", var.name));
            }
            if var.name.contains("__") || var.name.ends_with('_') || var.name.starts_with('_') {
                self.fault(format!("{}: underscores", var.name));
            }
            if seen.contains(&capitals) {
                self.fault(format!("{} differs from another name in nothing but case", var.name));
            }
            seen.push(capitals);
            self.declared(&var.ty);
            match &var.initial {
                None | Some(Expr::Bool(_)) => {}
                Some(literal @ (Expr::Int(_) | Expr::Real(_))) => self.expr(literal),
                Some(_) => self.fault(format!("{} begins with something other than a literal", var.name)),
            }
            if matches!(var.ty, Type::Array { .. }) && var.initial.is_some() {
                self.fault(format!("{}: an array with a beginning", var.name));
            }
        }
    }

    fn declared(&mut self, ty: &Type) {
        let (name, array) = match ty {
            Type::Named(name) => (name, false),
            Type::Array { low, high, element } => {
                if low > high {
                    self.fault("an array without elements");
                }
                (element, true)
            }
        };
        let elementary = ELEMENTARY.contains(&name.as_str());
        if !elementary && (array || !name.starts_with("Glapp")) {
            self.fault(format!("type {name} is not in the subset"));
        }
    }

    fn pou(&mut self, pou: &Pou) {
        self.names(pou.blocks.iter().flat_map(|block| &block.vars));
        if let Some(ty) = &pou.returns {
            self.declared(ty);
        }
        self.body(&pou.body);
    }

    fn body(&mut self, body: &[Stmt]) {
        for stmt in body {
            self.line = stmt.line;
            match &stmt.kind {
                StmtKind::Assign(target, value) => {
                    self.expr(target);
                    self.expr(value);
                }
                StmtKind::If(branches, otherwise) => {
                    for (condition, body) in branches {
                        self.expr(condition);
                        self.body(body);
                    }
                    self.body(otherwise);
                }
                StmtKind::For { from, to, by, body, .. } => {
                    match (from, to, by) {
                        (Expr::Int(from), Expr::Int(to), None) if to > from => {}
                        (Expr::Int(from), Expr::Int(to), Some(Expr::Int(by))) if *by != 0 && (to - from) / by >= 1 => {}
                        (Expr::Int(_), Expr::Int(_), None | Some(Expr::Int(_))) => {
                            self.fault("FOR has two passes or more");
                        }
                        _ => self.fault("FOR has literal bounds"),
                    }
                    self.body(body);
                }
                StmtKind::While(condition, body) => {
                    self.expr(condition);
                    self.body(body);
                }
                StmtKind::Call(_, args) => {
                    if args.iter().any(|(name, _)| name.is_none()) {
                        self.fault("pins of a block are named");
                    }
                    self.args(args);
                }
            }
        }
    }

    fn args(&mut self, args: &[Argument]) {
        for (_, value) in args {
            self.expr(value);
        }
    }

    fn expr(&mut self, expr: &Expr) {
        match expr {
            Expr::Int(x) => {
                if i32::try_from(*x).is_err() {
                    self.fault(format!("{x} is beyond DINT"));
                }
            }
            Expr::Real(x) => {
                let size = x.abs();
                if size > 1e38 || (size > 0.0 && size < 1e-37) {
                    self.fault(format!("{x:e} is beyond 1E38, or below 1E-37"));
                }
            }
            Expr::Bool(_) | Expr::Name(_) => {}
            Expr::Member(of, _) | Expr::Paren(of) => self.expr(of),
            Expr::Neg(of) => {
                if !simple(of) {
                    self.fault("a minus before something other than a variable or parentheses");
                }
                self.expr(of);
            }
            Expr::Index(of, index) => {
                if !matches!(**index, Expr::Name(_) | Expr::Int(_) | Expr::Binary(..)) {
                    self.fault("an index is a variable, a literal or a sum");
                }
                self.expr(of);
                self.expr(index);
            }
            Expr::Not(of) => {
                if !simple(of) || matches!(**of, Expr::Paren(_)) {
                    self.fault("NOT before a compound");
                }
                self.expr(of);
            }
            Expr::Binary(op, left, right) => {
                let logical = matches!(op, Op::And | Op::Or | Op::Xor);
                for side in [left, right] {
                    match **side {
                        Expr::Binary(inner, ..)
                            if inner != *op || !matches!(op, Op::Add | Op::Mul | Op::And | Op::Or) =>
                        {
                            self.fault(format!("{} beside {} without parentheses", inner.symbol(), op.symbol()));
                        }
                        _ => {}
                    }
                    if logical && may_trap(side) {
                        self.fault(format!("a division or an index beside {}: both sides are evaluated", op.symbol()));
                    }
                    self.expr(side);
                }
            }
            Expr::Call(_, args) => self.args(args),
        }
    }
}

fn simple(expr: &Expr) -> bool {
    matches!(expr, Expr::Name(_) | Expr::Member(..) | Expr::Index(..) | Expr::Paren(_) | Expr::Call(..))
}

/// Whether there is a division or an index in it.
fn may_trap(expr: &Expr) -> bool {
    match expr {
        Expr::Binary(Op::Div | Op::Mod, ..) | Expr::Index(..) => true,
        Expr::Binary(_, left, right) => may_trap(left) || may_trap(right),
        Expr::Member(of, _) | Expr::Paren(of) | Expr::Neg(of) | Expr::Not(of) => may_trap(of),
        Expr::Call(_, args) => args.iter().any(|(_, value)| may_trap(value)),
        Expr::Int(_) | Expr::Real(_) | Expr::Bool(_) | Expr::Name(_) => false,
    }
}
