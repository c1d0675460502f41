//! From trees to a runnable program: names resolved, types checked, every variable at its place in one memory.

use crate::flow::Flow;
use crate::tree::{Argument, Class, Expr, Fault, Op, Pou, Stmt, StmtKind, Type, Unit, Var};
use crate::{first, lint, second};
use std::borrow::Cow;
use std::collections::HashMap;
use std::path::Path;

/// Build of the library: `LREAL`, or `REAL` made from it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Build {
    /// The sources as they are.
    Lreal,
    /// The sources with `REAL` in place of `LREAL`, and the files of `real/` in place of theirs.
    Real,
}

/// A value of an elementary type.
#[derive(Clone, Copy, Debug, PartialEq)]
#[allow(missing_docs)]
pub enum Value {
    Bool(bool),
    Int(i16),
    Dint(i32),
    Real(f32),
    Lreal(f64),
}

impl Value {
    /// Bits in the memory: two values of the same type are equal where these are.
    pub(crate) fn bits(self) -> u64 {
        match self {
            Self::Bool(x) => x.into(),
            Self::Int(x) => x as u64,
            Self::Dint(x) => x as u64,
            Self::Real(x) => x.to_bits().into(),
            Self::Lreal(x) => x.to_bits(),
        }
    }
}

/// A type.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum Ty {
    Bool,
    Int,
    Dint,
    Real,
    Lreal,
    /// Structure or function block, by its number.
    Unit(usize),
    /// Bounds, and the zero of the elements.
    Array(i64, i64, Elementary),
}

/// An elementary type, of an array's elements.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum Elementary {
    Bool,
    Int,
    Dint,
    Real,
    Lreal,
}

impl Elementary {
    pub(crate) fn ty(self) -> Ty {
        match self {
            Self::Bool => Ty::Bool,
            Self::Int => Ty::Int,
            Self::Dint => Ty::Dint,
            Self::Real => Ty::Real,
            Self::Lreal => Ty::Lreal,
        }
    }

    fn zero(self) -> Value {
        match self {
            Self::Bool => Value::Bool(false),
            Self::Int => Value::Int(0),
            Self::Dint => Value::Dint(0),
            Self::Real => Value::Real(0.0),
            Self::Lreal => Value::Lreal(0.0),
        }
    }

    fn of(name: &str) -> Option<Self> {
        Some(match name {
            "BOOL" => Self::Bool,
            "INT" => Self::Int,
            "DINT" => Self::Dint,
            "REAL" => Self::Real,
            "LREAL" => Self::Lreal,
            _ => return None,
        })
    }
}

/// A variable and its place within its unit.
#[derive(Clone, Debug)]
pub(crate) struct Slot {
    pub name: String,
    pub ty: Ty,
    pub at: usize,
    pub class: Class,
    pub constant: bool,
}

/// A structure, a function block or a function.
#[derive(Clone, Debug)]
pub(crate) struct Compiled {
    pub name: String,
    pub slots: Vec<Slot>,
    /// Places by name in `slots`: tests name some hundred of them in a scan.
    names: HashMap<String, usize>,
    /// Initial memory, and which parts survive a power cut.
    pub image: Vec<Value>,
    pub retained: Vec<bool>,
    pub kind: Kind,
    pub body: Vec<Step>,
    /// Dependence on the memory of the scan before.
    pub flow: Flow,
}

impl Compiled {
    pub fn slot(&self, name: &str) -> Option<&Slot> {
        self.names.get(name).map(|number| &self.slots[*number])
    }

    /// All but variables of its own that it writes before it reads them.
    fn kept(&self) -> Vec<bool> {
        let mut kept = vec![true; self.image.len()];
        for (number, slot) in self.slots.iter().enumerate().filter(|(_, slot)| slot.class == Class::Local) {
            let end = self.slots.get(number + 1).map_or(self.image.len(), |next| next.at);
            (slot.at..end).for_each(|at| kept[at] = self.flow.read.get(at).copied().unwrap_or(true));
        }
        kept
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    Struct,
    Block,
    /// Function: its frame in the memory of functions, and the type of its result, whose place is the first.
    Function {
        frame: usize,
        returns: Ty,
    },
}

/// A place relative to the instance.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Place {
    Fixed(usize),
    Indexed { at: usize, low: i64, high: i64, index: Box<Code> },
}

/// A typed expression.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Code {
    Const(Value),
    Load(Place),
    Neg(Box<Code>),
    Not(Box<Code>),
    Abs(Box<Code>),
    Binary(Op, Box<Code>, Box<Code>),
    Convert(Ty, Box<Code>),
    Call(usize, Vec<(usize, Code)>),
}

#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Step {
    pub line: usize,
    /// Number of the statement in the unit's text, from 0.
    pub number: usize,
    pub kind: StepKind,
}

#[derive(Clone, Debug, PartialEq)]
pub(crate) enum StepKind {
    Set(Place, Code),
    Copy {
        to: usize,
        from: usize,
        length: usize,
    },
    /// Conditions with their statements; each way, and the last one for none of them, has a number of its own.
    If {
        branches: Vec<(Code, Vec<Step>)>,
        otherwise: Vec<Step>,
        first_way: usize,
    },
    For {
        var: usize,
        from: Value,
        to: Value,
        by: Value,
        body: Vec<Step>,
    },
    While {
        condition: Code,
        body: Vec<Step>,
        way: usize,
    },
    Call {
        at: usize,
        unit: usize,
        inputs: Vec<(usize, Code)>,
        copies: Vec<(usize, usize, usize)>,
    },
}

/// A way through the library that a run takes or does not.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Way {
    /// POU.
    pub pou: String,
    /// Line of the IF or WHILE.
    pub line: usize,
    /// Number of the branch, from 0; the last stands for none of the conditions.
    pub branch: usize,
}

/// The library, ready to run.
#[derive(Clone, Debug)]
pub struct Library {
    pub(crate) units: Vec<Compiled>,
    by_name: HashMap<String, usize>,
    pub(crate) function_memory: usize,
    /// Memory, by unit, that the next call, or the caller, may read.
    pub(crate) kept: Vec<Vec<bool>>,
    /// All ways through it.
    pub ways: Vec<Way>,
}

impl Library {
    /// Reads every `.st` of a folder by both parsers, holds it to the subset and makes it ready.
    ///
    /// # Errors
    /// The first fault: a file that cannot be read, that one of the parsers refuses or that both read differently, that leaves the
    /// subset, or whose names or types do not fit.
    pub fn read(folder: &Path, build: Build) -> Result<Self, Fault> {
        let sources = sources(folder, build)?;
        Self::of(sources.iter().map(|(name, text)| (name.as_str(), text.as_str())), build)
    }

    /// Library from names of files and their texts.
    ///
    /// # Errors
    /// As [`read`](Self::read).
    pub fn of<'s>(sources: impl Iterator<Item = (&'s str, &'s str)>, build: Build) -> Result<Self, Fault> {
        Self::made(sources, build, true)
    }

    /// Library without the rules of the subset, from names of files and their texts: for a library that was changed on
    /// purpose, as a mutant is.
    ///
    /// # Errors
    /// As [`read`](Self::read).
    pub fn of_unruled<'s>(sources: impl Iterator<Item = (&'s str, &'s str)>, build: Build) -> Result<Self, Fault> {
        Self::made(sources, build, false)
    }

    /// The library with a program of one's own, given by its file and its text in LREAL, and the name of that program. It may have any
    /// name, and need not keep the rules of the subset that the evaluator can do without.
    ///
    /// # Errors
    /// As [`read`](Self::read).
    pub fn with_own(folder: &Path, build: Build, own: (&str, &str)) -> Result<(Self, String), Fault> {
        let sources = sources(folder, build)?;
        let mut units = Self::units(sources.iter().map(|(name, text)| (&**name, &**text)), build, true)?;
        let (file, text) = own;
        let unit = read_unit(file, &in_build(text, build))?;
        let name = unit.name().to_owned();
        units.push(unit);
        Ok((Self::built(&units)?, name))
    }

    fn made<'s>(sources: impl Iterator<Item = (&'s str, &'s str)>, build: Build, ruled: bool) -> Result<Self, Fault> {
        Self::built(&Self::units(sources, build, ruled)?)
    }

    fn units<'s>(
        sources: impl Iterator<Item = (&'s str, &'s str)>,
        build: Build,
        ruled: bool,
    ) -> Result<Vec<Unit>, Fault> {
        let mut units = vec![];
        for (file, text) in sources {
            let unit = read_unit(file, text)?;
            // The subset is that of the sources, before REAL is put in place of LREAL.
            if ruled && let Some(fault) = lint::lint(file, text, &unit).into_iter().next() {
                return Err(fault);
            }
            let expected = format!("Glapp{}", file.trim_end_matches(".st"));
            if unit.name() != expected {
                return Err(Fault::new(file, 1, format!("{} stands in the file of {expected}", unit.name())));
            }
            units.push(match build {
                Build::Lreal => unit,
                Build::Real => read_unit(file, &in_build(text, build))?,
            });
        }
        Ok(units)
    }

    pub(crate) fn built(units: &[Unit]) -> Result<Self, Fault> {
        Builder::new(units)?.build()
    }

    pub(crate) fn unit(&self, name: &str) -> Option<usize> {
        self.by_name.get(name).copied()
    }

    /// Bytes of memory of a unit's variables: BOOL 1, INT 2, DINT and REAL 4, LREAL 8.
    pub fn bytes(&self, name: &str) -> Option<usize> {
        let size = |value: &Value| match value {
            Value::Bool(_) => 1,
            Value::Int(_) => 2,
            Value::Dint(_) | Value::Real(_) => 4,
            Value::Lreal(_) => 8,
        };
        self.unit(name).map(|unit| self.units[unit].image.iter().map(size).sum())
    }
}

/// A text in LREAL, in the types of the build.
fn in_build(text: &str, build: Build) -> Cow<'_, str> {
    match build {
        Build::Lreal => text.into(),
        Build::Real => text.replace("LREAL", "REAL").into(),
    }
}

pub(crate) fn read_unit(file: &str, text: &str) -> Result<Unit, Fault> {
    lint::without_comments(file, text)?;
    let unit = first::parse(file, text)?;
    // The first parser stops where the unit ends; the second one reads to the end of the file.
    let other = second::parse(file, text)?;
    if unit != other {
        return Err(Fault::new(file, 0, format!("the parsers differ: {unit:?} and {other:?}")));
    }
    Ok(unit)
}

/// Trees of the files of a folder, by the names of the files.
///
/// # Errors
/// Where a file cannot be read, or one of the parsers refuses it.
pub fn trees(folder: &Path, build: Build) -> Result<Vec<(String, Unit)>, Fault> {
    let tree = |(name, text): (String, String)| read_unit(&name, &in_build(&text, build)).map(|unit| (name, unit));
    sources(folder, build)?.into_iter().map(tree).collect()
}

/// Names and texts of the library's files, in order, as they stand in LREAL.
///
/// # Errors
/// Where a file cannot be read, or a file in `real/` has no twin.
pub fn sources(folder: &Path, build: Build) -> Result<Vec<(String, String)>, Fault> {
    let mut all = files(folder)?;
    let real = folder.join("real");
    for (name, text) in if real.is_dir() { files(&real)? } else { vec![] } {
        let Some(twin) = all.iter_mut().find(|(twin, _)| *twin == name) else {
            return Err(Fault::new(&name, 0, "a file in real/ without a twin"));
        };
        if build == Build::Real {
            twin.1 = text;
        }
    }
    Ok(all)
}

fn files(folder: &Path) -> Result<Vec<(String, String)>, Fault> {
    let refused = |e: std::io::Error| Fault::new(&folder.display().to_string(), 0, e.to_string());
    let mut all = vec![];
    for entry in std::fs::read_dir(folder).map_err(refused)? {
        let path = entry.map_err(refused)?.path();
        if path.extension().is_some_and(|ending| ending == "st") {
            let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            all.push((name, std::fs::read_to_string(&path).map_err(refused)?));
        }
    }
    all.sort();
    Ok(all)
}

struct Builder<'u> {
    sources: &'u [Unit],
    by_name: HashMap<String, usize>,
    done: Vec<Option<Compiled>>,
    under_way: Vec<bool>,
    function_memory: usize,
    ways: Vec<Way>,
}

impl<'u> Builder<'u> {
    fn new(sources: &'u [Unit]) -> Result<Self, Fault> {
        let mut by_name = HashMap::new();
        for (number, unit) in sources.iter().enumerate() {
            if by_name.insert(unit.name().to_owned(), number).is_some() {
                return Err(Fault::new(unit.name(), 0, "declared twice"));
            }
        }
        let none = sources.iter().map(|_| None).collect();
        Ok(Self {
            sources,
            by_name,
            done: none,
            under_way: vec![false; sources.len()],
            function_memory: 0,
            ways: vec![],
        })
    }

    fn build(mut self) -> Result<Library, Fault> {
        for number in 0..self.sources.len() {
            self.compile(number)?;
        }
        let units: Vec<Compiled> = self.done.into_iter().flatten().collect();
        let kept = units.iter().map(Compiled::kept).collect();
        Ok(Library { units, by_name: self.by_name, function_memory: self.function_memory, kept, ways: self.ways })
    }

    /// Compiles a unit after the units it is made of; none contains or calls itself.
    fn compile(&mut self, number: usize) -> Result<(), Fault> {
        if self.done[number].is_some() {
            return Ok(());
        }
        let unit = &self.sources[number];
        if self.under_way[number] {
            return Err(Fault::new(unit.name(), 0, "contains or calls itself"));
        }
        self.under_way[number] = true;
        let name = unit.name().to_owned();
        let mut compiled = Compiled {
            name,
            slots: vec![],
            names: HashMap::new(),
            image: vec![],
            retained: vec![],
            kind: Kind::Struct,
            body: vec![],
            flow: Flow::default(),
        };
        match unit {
            Unit::Struct { fields, .. } => {
                for field in fields {
                    self.declare(&mut compiled, field, Class::Output, false, false)?;
                }
            }
            Unit::Pou(pou) => self.pou(&mut compiled, pou)?,
        }
        self.done[number] = Some(compiled);
        Ok(())
    }

    fn declare(
        &mut self,
        into: &mut Compiled,
        var: &Var,
        class: Class,
        constant: bool,
        retain: bool,
    ) -> Result<(), Fault> {
        let fault = |what: String| Fault::new(&into.name, 0, format!("{}: {what}", var.name));
        let at = into.image.len();
        let ty = match &var.ty {
            Type::Named(name) => match (Elementary::of(name), self.by_name.get(name)) {
                (Some(elementary), _) => {
                    into.image.push(elementary.zero());
                    into.retained.push(retain);
                    elementary.ty()
                }
                (None, Some(&unit)) => {
                    self.compile(unit)?;
                    let of = self.done[unit].as_ref().expect("compiled above");
                    if matches!(of.kind, Kind::Function { .. }) {
                        return Err(fault(format!("{name} is a function")));
                    }
                    into.image.extend(&of.image);
                    into.retained.extend(of.retained.iter().map(|inner| *inner || retain));
                    Ty::Unit(unit)
                }
                (None, None) => return Err(fault(format!("no type {name}"))),
            },
            Type::Array { low, high, element } => {
                let Some(element) = Elementary::of(element) else {
                    return Err(fault(format!("elements of type {element}")));
                };
                let length = usize::try_from(high - low + 1).unwrap_or(0);
                into.image.extend(std::iter::repeat_n(element.zero(), length));
                into.retained.extend(std::iter::repeat_n(retain, length));
                Ty::Array(*low, *high, element)
            }
        };
        if let Some(initial) = &var.initial {
            let Some(value) = literal(initial, ty) else {
                return Err(fault(format!("begins with {initial:?}")));
            };
            into.image[at] = value;
        }
        into.names.entry(var.name.clone()).or_insert(into.slots.len());
        into.slots.push(Slot { name: var.name.clone(), ty, at, class, constant });
        Ok(())
    }

    fn pou(&mut self, compiled: &mut Compiled, pou: &Pou) -> Result<(), Fault> {
        compiled.kind = Kind::Block;
        if let Some(ty) = &pou.returns {
            let result = Var { name: pou.name.clone(), ty: ty.clone(), initial: None };
            self.declare(compiled, &result, Class::Local, false, false)?;
        }
        for block in &pou.blocks {
            for var in &block.vars {
                self.declare(compiled, var, block.class, block.constant, block.retain)?;
            }
        }
        if pou.returns.is_some() {
            compiled.kind = Kind::Function { frame: self.function_memory, returns: compiled.slots[0].ty };
            self.function_memory += compiled.image.len();
        }
        compiled.body = Scope { builder: self, unit: compiled, line: 0, steps: 0 }.body(&pou.body)?;
        compiled.flow = Flow::of(&compiled.body, compiled.image.len(), &|unit, _, _| {
            Cow::Borrowed(&self.done[unit].as_ref().expect("compiled before what calls it").flow)
        });
        Ok(())
    }
}

/// A literal as a value of a type, where it is one.
fn literal(expr: &Expr, ty: Ty) -> Option<Value> {
    Some(match (expr, ty) {
        (Expr::Bool(x), Ty::Bool) => Value::Bool(*x),
        (Expr::Int(x), Ty::Int) => Value::Int(i16::try_from(*x).ok()?),
        (Expr::Int(x), Ty::Dint) => Value::Dint(i32::try_from(*x).ok()?),
        (Expr::Real(x), Ty::Real) => Value::Real(*x as f32),
        (Expr::Real(x), Ty::Lreal) => Value::Lreal(*x),
        _ => return None,
    })
}

/// Names of a POU while its statements are read.
struct Scope<'a, 'u> {
    builder: &'a mut Builder<'u>,
    unit: &'a Compiled,
    line: usize,
    steps: usize,
}

impl Scope<'_, '_> {
    fn fault<T>(&self, what: impl Into<String>) -> Result<T, Fault> {
        Err(Fault::new(&self.unit.name, self.line, what))
    }

    fn slot(&self, name: &str) -> Result<Slot, Fault> {
        match self.unit.slot(name) {
            Some(slot) => Ok(slot.clone()),
            None => self.fault(format!("no variable {name}")),
        }
    }

    fn compiled(&mut self, number: usize) -> Result<&Compiled, Fault> {
        self.builder.compile(number)?;
        Ok(self.builder.done[number].as_ref().expect("compiled above"))
    }

    /// A place, its type, and whether it may be written.
    fn place(&mut self, expr: &Expr) -> Result<(Place, Ty, bool), Fault> {
        match expr {
            Expr::Name(name) => {
                let slot = self.slot(name)?;
                Ok((Place::Fixed(slot.at), slot.ty, !slot.constant && slot.class != Class::Input))
            }
            Expr::Member(of, field) => {
                let (Place::Fixed(at), Ty::Unit(unit), writable) = self.place(of)? else {
                    return self.fault(format!(".{field} of something that has no parts"));
                };
                let inner = self.compiled(unit)?;
                let (block, name) = (inner.kind == Kind::Block, inner.name.clone());
                let Some(slot) = inner.slot(field).cloned() else {
                    return self.fault(format!("{name} has no {field}"));
                };
                if block && slot.class != Class::Output {
                    return self.fault(format!("{name}.{field} is not an output"));
                }
                Ok((Place::Fixed(at + slot.at), slot.ty, writable && !block))
            }
            Expr::Index(of, index) => {
                let (Place::Fixed(at), Ty::Array(low, high, element), writable) = self.place(of)? else {
                    return self.fault("an index on something that is no array");
                };
                let index = Box::new(self.typed(index, Ty::Int)?);
                Ok((Place::Indexed { at, low, high, index }, element.ty(), writable))
            }
            _ => self.fault("not a variable"),
        }
    }

    /// The type of an expression; none of a literal number, which takes that of its neighbour.
    fn type_of(&mut self, expr: &Expr) -> Result<Option<Ty>, Fault> {
        Ok(match expr {
            Expr::Int(_) | Expr::Real(_) => None,
            Expr::Bool(_) | Expr::Not(_) => Some(Ty::Bool),
            Expr::Name(_) | Expr::Member(..) | Expr::Index(..) => Some(self.place(expr)?.1),
            Expr::Neg(of) | Expr::Paren(of) => self.type_of(of)?,
            Expr::Binary(op, left, right) => match op {
                Op::Add | Op::Sub | Op::Mul | Op::Div | Op::Mod => match self.type_of(left)? {
                    Some(ty) => Some(ty),
                    None => self.type_of(right)?,
                },
                _ => Some(Ty::Bool),
            },
            Expr::Call(name, args) => match (name.as_str(), &args[..]) {
                ("ABS", [(None, of)]) => self.type_of(of)?,
                _ => match (conversion(name), self.builder.by_name.get(name).copied()) {
                    (Some((_, to)), _) => Some(to),
                    (None, Some(number)) => match self.compiled(number)?.kind {
                        Kind::Function { returns, .. } => Some(returns),
                        _ => return self.fault(format!("{name} is no function")),
                    },
                    (None, None) => return self.fault(format!("no function {name}")),
                },
            },
        })
    }

    fn typed(&mut self, expr: &Expr, ty: Ty) -> Result<Code, Fault> {
        if let Some(value) = literal(expr, ty) {
            return Ok(Code::Const(value));
        }
        let numeric = matches!(ty, Ty::Int | Ty::Dint | Ty::Real | Ty::Lreal);
        Ok(match expr {
            Expr::Int(_) | Expr::Real(_) | Expr::Bool(_) => {
                return self.fault(format!("{expr:?} where {ty:?} is meant"));
            }
            Expr::Name(_) | Expr::Member(..) | Expr::Index(..) => {
                let (place, of, _) = self.place(expr)?;
                if of != ty {
                    return self.fault(format!("{of:?} where {ty:?} is meant"));
                }
                Code::Load(place)
            }
            Expr::Paren(of) => self.typed(of, ty)?,
            Expr::Neg(of) if numeric => Code::Neg(Box::new(self.typed(of, ty)?)),
            Expr::Not(of) if ty == Ty::Bool => Code::Not(Box::new(self.typed(of, Ty::Bool)?)),
            Expr::Binary(op, left, right) => {
                let operands = match op {
                    Op::And | Op::Or | Op::Xor => Ty::Bool,
                    Op::Add | Op::Sub | Op::Mul | Op::Div => ty,
                    Op::Mod if matches!(ty, Ty::Int | Ty::Dint) => ty,
                    Op::Mod => return self.fault("MOD of what is not whole"),
                    _ => match (self.type_of(left)?, self.type_of(right)?) {
                        (Some(ty), _) | (None, Some(ty)) => ty,
                        (None, None) => return self.fault("two literals compared"),
                    },
                };
                let arithmetic = matches!(op, Op::Add | Op::Sub | Op::Mul | Op::Div | Op::Mod);
                let ordered = matches!(op, Op::Lt | Op::Le | Op::Gt | Op::Ge);
                if arithmetic != numeric && (arithmetic || ty != Ty::Bool) {
                    return self.fault(format!("{} gives no {ty:?}", op.symbol()));
                }
                if matches!(operands, Ty::Unit(_) | Ty::Array(..)) || (ordered && operands == Ty::Bool) {
                    return self.fault(format!("{} between {operands:?}", op.symbol()));
                }
                Code::Binary(*op, Box::new(self.typed(left, operands)?), Box::new(self.typed(right, operands)?))
            }
            Expr::Call(name, args) => self.call(name, args, ty)?,
            Expr::Neg(_) | Expr::Not(_) => return self.fault(format!("{expr:?} where {ty:?} is meant")),
        })
    }

    fn call(&mut self, name: &str, args: &[Argument], ty: Ty) -> Result<Code, Fault> {
        match (name, args) {
            ("ABS", [(None, of)]) if ty != Ty::Bool => return Ok(Code::Abs(Box::new(self.typed(of, ty)?))),
            (_, [(None, of)]) => {
                if let Some((from, to)) = conversion(name) {
                    if to != ty {
                        return self.fault(format!("{name} where {ty:?} is meant"));
                    }
                    return Ok(Code::Convert(to, Box::new(self.typed(of, from)?)));
                }
            }
            _ => {}
        }
        let Some(&number) = self.builder.by_name.get(name) else {
            return self.fault(format!("no function {name}"));
        };
        let function = self.compiled(number)?;
        let Kind::Function { returns, .. } = function.kind else {
            return self.fault(format!("{name} is no function"));
        };
        let inputs: Vec<Slot> = function.slots.iter().filter(|s| s.class == Class::Input).cloned().collect();
        if returns != ty || inputs.len() != args.len() {
            return self.fault(format!("{name} gives {returns:?} of {} inputs", inputs.len()));
        }
        let mut given = vec![];
        for (slot, (pin, value)) in inputs.iter().zip(args) {
            if pin.as_ref().is_some_and(|pin| *pin != slot.name) {
                return self.fault(format!("{name}: {} comes here", slot.name));
            }
            given.push((slot.at, self.typed(value, slot.ty)?));
        }
        Ok(Code::Call(number, given))
    }

    fn ways(&mut self, count: usize) -> usize {
        let first = self.builder.ways.len();
        let (pou, line) = (&self.unit.name, self.line);
        self.builder.ways.extend((0..count).map(|branch| Way { pou: pou.clone(), line, branch }));
        first
    }

    fn body(&mut self, body: &[Stmt]) -> Result<Vec<Step>, Fault> {
        body.iter()
            .map(|stmt| {
                self.line = stmt.line;
                let number = self.steps;
                self.steps += 1;
                Ok(Step { line: stmt.line, number, kind: self.step(&stmt.kind)? })
            })
            .collect()
    }

    fn step(&mut self, stmt: &StmtKind) -> Result<StepKind, Fault> {
        Ok(match stmt {
            StmtKind::Assign(target, value) => {
                let (to, ty, writable) = self.place(target)?;
                if !writable {
                    return self.fault("an input, a constant or another block's output is written");
                }
                match (&to, ty) {
                    (Place::Fixed(to), Ty::Unit(unit)) => {
                        let (from, length) = self.copied(value, unit)?;
                        StepKind::Copy { to: *to, from, length }
                    }
                    (_, Ty::Array(..)) => return self.fault("an array as a whole"),
                    _ => StepKind::Set(to, self.typed(value, ty)?),
                }
            }
            StmtKind::If(branches, otherwise) => {
                let first_way = self.ways(branches.len() + 1);
                let mut ways = vec![];
                for (condition, body) in branches {
                    ways.push((self.typed(condition, Ty::Bool)?, self.body(body)?));
                }
                StepKind::If { branches: ways, otherwise: self.body(otherwise)?, first_way }
            }
            StmtKind::For { var, from, to, by, body } => {
                let slot = self.slot(var)?;
                if slot.class != Class::Local || slot.constant {
                    return self.fault(format!("{var} counts and is no variable of its own"));
                }
                let bound = |expr: &Expr| match literal(expr, slot.ty) {
                    Some(value @ (Value::Int(_) | Value::Dint(_))) => Ok(value),
                    _ => self.fault("a bound of FOR"),
                };
                let (from, to, by) = (bound(from)?, bound(to)?, bound(by.as_ref().unwrap_or(&Expr::Int(1)))?);
                StepKind::For { var: slot.at, from, to, by, body: self.body(body)? }
            }
            StmtKind::While(condition, body) => {
                let way = self.ways(1);
                StepKind::While { condition: self.typed(condition, Ty::Bool)?, body: self.body(body)?, way }
            }
            StmtKind::Call(name, args) => {
                let slot = self.slot(name)?;
                let Ty::Unit(unit) = slot.ty else { return self.fault(format!("{name} cannot be called")) };
                let block = self.compiled(unit)?;
                let (kind, of, slots) = (block.kind, block.name.clone(), block.slots.clone());
                if kind != Kind::Block {
                    return self.fault(format!("{name} cannot be called"));
                }
                let (mut inputs, mut copies): (Vec<(usize, Code)>, Vec<_>) = (vec![], vec![]);
                let mut given: Vec<&str> = vec![];
                for (pin, value) in args {
                    let pin = pin.as_deref().unwrap_or("");
                    let found = slots.iter().find(|slot| slot.name == pin && slot.class == Class::Input);
                    let Some(input) = found else { return self.fault(format!("{of} has no input {pin}")) };
                    if given.contains(&pin) {
                        return self.fault(format!("{pin} is given twice"));
                    }
                    given.push(pin);
                    if let Ty::Unit(part) = input.ty {
                        let (from, length) = self.copied(value, part)?;
                        copies.push((slot.at + input.at, from, length));
                    } else {
                        inputs.push((slot.at + input.at, self.typed(value, input.ty)?));
                    }
                }
                StepKind::Call { at: slot.at, unit, inputs, copies }
            }
        })
    }

    /// A structure that is copied: where from, and how long it is.
    fn copied(&mut self, value: &Expr, unit: usize) -> Result<(usize, usize), Fault> {
        let (place, ty, _) = self.place(value)?;
        let of = self.compiled(unit)?;
        let (length, plain) = (of.image.len(), of.kind == Kind::Struct);
        match place {
            Place::Fixed(from) if plain && ty == Ty::Unit(unit) => Ok((from, length)),
            _ => self.fault("a copy of something that is not this structure"),
        }
    }
}

/// The standard conversions of the subset: nothing is lost, but that DINT is rounded once to REAL.
fn conversion(name: &str) -> Option<(Ty, Ty)> {
    Some(match name {
        "INT_TO_DINT" => (Ty::Int, Ty::Dint),
        "INT_TO_REAL" => (Ty::Int, Ty::Real),
        "INT_TO_LREAL" => (Ty::Int, Ty::Lreal),
        "DINT_TO_REAL" => (Ty::Dint, Ty::Real),
        "DINT_TO_LREAL" => (Ty::Dint, Ty::Lreal),
        _ => return None,
    })
}
