//! Runs the library, strictly: what one controller may do and another may not stops the run.

use crate::library::{Code, Compiled, Kind, Library, Place, Step, StepKind, Ty, Value};
use crate::tree::{Class, Fault, Op};

/// A WHILE that goes round more often than this has no end.
const ROUNDS: usize = 1000;

/// An instance of a function block with its memory.
#[derive(Clone, Debug)]
pub struct Instance<'l> {
    library: &'l Library,
    unit: usize,
    memory: Memory,
}

#[derive(Clone, Debug)]
struct Memory {
    /// The instance, then the frames of functions.
    values: Vec<Value>,
    functions: usize,
    /// Operators, conversions, assignments and calls so far.
    operations: u64,
    /// Which ways were taken.
    taken: Vec<bool>,
}

impl<'l> Instance<'l> {
    /// A block as it stands after its first download.
    ///
    /// # Errors
    /// Where the library has no such block.
    pub fn new(library: &'l Library, name: &str) -> Result<Self, Fault> {
        match library.unit(name) {
            Some(unit) if library.units[unit].kind == Kind::Block => {
                let mut values = library.units[unit].image.clone();
                let functions = values.len();
                values.resize(functions + library.function_memory, Value::Bool(false));
                let taken = vec![false; library.ways.len()];
                Ok(Self { library, unit, memory: Memory { values, functions, operations: 0, taken } })
            }
            _ => Err(Fault::new(name, 0, "no such block")),
        }
    }

    /// The power goes and comes back: retained variables stay, all others begin anew.
    pub fn power_cut(&mut self) {
        let unit = &self.library.units[self.unit];
        for (at, (value, retained)) in unit.image.iter().zip(&unit.retained).enumerate() {
            if !retained {
                self.memory.values[at] = *value;
            }
        }
    }

    /// Sets any variable, as a download or a fault of the memory may.
    ///
    /// # Errors
    /// As [`set`](Self::set).
    pub fn spoil(&mut self, name: &str, value: f64) -> Result<(), Fault> {
        let (at, ty, _) = self.find(name)?;
        self.put(name, at, ty, value)
    }

    /// Sets an input.
    ///
    /// # Errors
    /// Where there is no such input, or the number is none of its type.
    pub fn set(&mut self, pin: &str, value: f64) -> Result<(), Fault> {
        let (at, ty, class) = self.find(pin)?;
        if class != Class::Input {
            return Err(Fault::new(pin, 0, "not an input"));
        }
        self.put(pin, at, ty, value)
    }

    pub(crate) fn put(&mut self, pin: &str, at: usize, ty: Ty, value: f64) -> Result<(), Fault> {
        let whole = |low: f64, high: f64| value >= low && value <= high && value % 1.0 == 0.0;
        self.memory.values[at] = match ty {
            Ty::Bool if value == 0.0 || value == 1.0 => Value::Bool(value == 1.0),
            Ty::Int if whole(i16::MIN.into(), i16::MAX.into()) => Value::Int(value as i16),
            Ty::Dint if whole(i32::MIN.into(), i32::MAX.into()) => Value::Dint(value as i32),
            Ty::Real => Value::Real(value as f32),
            Ty::Lreal => Value::Lreal(value),
            _ => return Err(Fault::new(pin, 0, format!("{value} for {ty:?}"))),
        };
        Ok(())
    }

    /// Reads an input or an output, parts with a dot between; BOOL as 0 or 1.
    ///
    /// # Errors
    /// Where there is no such pin.
    pub fn get(&self, pin: &str) -> Result<f64, Fault> {
        let (at, _, class) = self.find(pin)?;
        if class == Class::Local {
            return Err(Fault::new(pin, 0, "not a pin"));
        }
        Ok(self.shown(at))
    }

    /// Reads any variable, as an engineer does who looks into an instance.
    ///
    /// # Errors
    /// Where there is no such variable.
    pub fn peek(&self, name: &str) -> Result<f64, Fault> {
        self.find(name).map(|(at, _, _)| self.shown(at))
    }

    pub(crate) fn shown(&self, at: usize) -> f64 {
        match self.memory.values[at] {
            Value::Bool(x) => x.into(),
            Value::Int(x) => x.into(),
            Value::Dint(x) => x.into(),
            Value::Real(x) => x.into(),
            Value::Lreal(x) => x,
        }
    }

    pub(crate) fn find(&self, path: &str) -> Result<(usize, Ty, Class), Fault> {
        let (mut unit, mut at) = (self.unit, 0);
        let mut outer = None;
        let mut parts = path.split('.').peekable();
        while let Some(part) = parts.next() {
            let Some(slot) = self.library.units[unit].slots.iter().find(|slot| slot.name == part) else { break };
            at += slot.at;
            let class = *outer.get_or_insert(slot.class);
            match (parts.peek(), slot.ty) {
                (None, Ty::Unit(_) | Ty::Array(..)) => break,
                (None, ty) => return Ok((at, ty, class)),
                (Some(_), Ty::Unit(inner)) => unit = inner,
                (Some(_), _) => break,
            }
        }
        Err(Fault::new(&self.library.units[self.unit].name, 0, format!("no pin {path}")))
    }

    /// One scan.
    ///
    /// # Errors
    /// Where the run stops: a division by zero, a result that is no number, an index or an integer out of range, a WHILE without end.
    pub fn call(&mut self) -> Result<(), Fault> {
        self.tried(None)
    }

    /// The same, and the changed units of a probe are tried wherever theirs is called.
    pub(crate) fn tried(&mut self, probe: Option<&mut Probe<'_>>) -> Result<(), Fault> {
        let unit = &self.library.units[self.unit];
        Run { library: self.library, memory: &mut self.memory, probe, unit, frame: 0, line: 0 }
            .enter(self.unit, 0)
            .map_err(|fault| *fault)
    }

    /// The block's name.
    pub fn name(&self) -> &str {
        &self.library.units[self.unit].name
    }

    /// Operators, conversions, assignments and calls so far.
    pub fn operations(&self) -> u64 {
        self.memory.operations
    }

    /// Which of the library's ways were taken so far.
    pub fn taken(&self) -> &[bool] {
        &self.memory.taken
    }
}

/// Changed units, tried on what the library's own are given, wherever these are called.
pub(crate) struct Probe<'p> {
    changed: &'p [Compiled],
    /// For each unit the numbers of the changed ones that have done the same so far.
    pub live: Vec<Vec<usize>>,
    /// Those that have left another memory behind, or stopped.
    pub differ: Vec<usize>,
    memory: Memory,
}

impl<'p> Probe<'p> {
    pub(crate) fn new(library: &Library, changed: &'p [Compiled]) -> Self {
        let taken = vec![false; library.ways.len()];
        let memory = Memory { values: vec![], functions: 0, operations: 0, taken };
        Self { changed, live: vec![vec![]; library.units.len()], differ: vec![], memory }
    }

    fn compare(&mut self, library: &Library, number: usize, before: &[Value], after: &[Value]) {
        let function = matches!(library.units[number].kind, Kind::Function { .. });
        let shown = if function { 1 } else { before.len() };
        let Self { changed, live, differ, memory } = self;
        live[number].retain(|one| {
            memory.values.clear();
            memory.values.extend_from_slice(before);
            memory.values.resize(before.len() + library.function_memory, Value::Bool(false));
            memory.functions = before.len();
            let run = Run { library, memory, probe: None, unit: &changed[*one], frame: 0, line: 0 }.body();
            let same = run.is_ok() && memory.values[..shown].iter().zip(after).all(|(a, b)| a.bits() == b.bits());
            if !same {
                differ.push(*one);
            }
            same
        });
    }
}

/// A fault at some length: what a run gives back is short.
type Stop = Box<Fault>;

struct Run<'r, 'p> {
    library: &'r Library,
    memory: &'r mut Memory,
    probe: Option<&'r mut Probe<'p>>,
    unit: &'r Compiled,
    frame: usize,
    line: usize,
}

impl<'r> Run<'r, '_> {
    fn body(&mut self) -> Result<(), Stop> {
        let unit = self.unit;
        self.steps(&unit.body)
    }

    /// Runs a unit of the library where its memory begins.
    fn enter(&mut self, number: usize, frame: usize) -> Result<(), Stop> {
        let (library, unit) = (self.library, &self.library.units[number]);
        let tried = self.probe.as_ref().is_some_and(|probe| !probe.live[number].is_empty());
        let before = tried.then(|| self.memory.values[frame..frame + unit.image.len()].to_vec());
        let probe = self.probe.as_deref_mut();
        Run { library, memory: self.memory, probe, unit, frame, line: 0 }.body()?;
        if let (Some(before), Some(probe)) = (before, self.probe.as_deref_mut()) {
            probe.compare(library, number, &before, &self.memory.values[frame..]);
        }
        Ok(())
    }

    fn stop<T>(&self, what: impl Into<String>) -> Result<T, Stop> {
        Err(Box::new(Fault::new(&self.unit.name, self.line, what)))
    }

    fn steps(&mut self, steps: &'r [Step]) -> Result<(), Stop> {
        for step in steps {
            self.line = step.line;
            self.step(&step.kind)?;
        }
        Ok(())
    }

    fn condition(&mut self, code: &Code) -> Result<bool, Stop> {
        match self.value(code)? {
            Value::Bool(x) => Ok(x),
            other => self.stop(format!("{other:?} as a condition")),
        }
    }

    fn step(&mut self, step: &'r StepKind) -> Result<(), Stop> {
        match step {
            StepKind::Set(place, code) => {
                let value = self.value(code)?;
                let at = self.at(place)?;
                self.memory.operations += 1;
                self.memory.values[at] = value;
            }
            StepKind::Copy { to, from, length } => {
                let (to, from) = (self.frame + to, self.frame + from);
                self.memory.operations += *length as u64;
                self.memory.values.copy_within(from..from + length, to);
            }
            StepKind::If { branches, otherwise, first_way } => {
                for (number, (condition, body)) in branches.iter().enumerate() {
                    if self.condition(condition)? {
                        self.memory.taken[first_way + number] = true;
                        return self.steps(body);
                    }
                }
                self.memory.taken[first_way + branches.len()] = true;
                self.steps(otherwise)?;
            }
            StepKind::For { var, from, to, by, body } => {
                let at = self.frame + var;
                self.memory.values[at] = *from;
                loop {
                    let (now, last, step) = (whole(self.memory.values[at]), whole(*to), whole(*by));
                    self.memory.operations += 1;
                    if (step > 0 && now > last) || (step < 0 && now < last) {
                        return Ok(());
                    }
                    self.steps(body)?;
                    if whole(self.memory.values[at]) != now {
                        return self.stop("the variable of a FOR was written");
                    }
                    self.memory.values[at] = self.arithmetic(Op::Add, self.memory.values[at], *by)?;
                }
            }
            StepKind::While { condition, body, way } => {
                for _ in 0..ROUNDS {
                    if !self.condition(condition)? {
                        return Ok(());
                    }
                    self.memory.taken[*way] = true;
                    self.steps(body)?;
                }
                return self.stop("a WHILE without end");
            }
            StepKind::Call { at, unit, inputs, copies } => {
                for (to, code) in inputs {
                    let value = self.value(code)?;
                    self.memory.operations += 1;
                    self.memory.values[self.frame + to] = value;
                }
                for (to, from, length) in copies {
                    let (to, from) = (self.frame + to, self.frame + from);
                    self.memory.operations += *length as u64;
                    self.memory.values.copy_within(from..from + length, to);
                }
                self.memory.operations += 1;
                self.enter(*unit, self.frame + at)?;
            }
        }
        Ok(())
    }

    fn at(&mut self, place: &Place) -> Result<usize, Stop> {
        match place {
            Place::Fixed(at) => Ok(self.frame + at),
            Place::Indexed { at, low, high, index } => {
                let index = whole(self.value(index)?);
                if index < *low || index > *high {
                    return self.stop(format!("index {index} outside {low}..{high}"));
                }
                Ok(self.frame + at + (index - low) as usize)
            }
        }
    }

    fn value(&mut self, code: &Code) -> Result<Value, Stop> {
        match code {
            Code::Const(value) => Ok(*value),
            Code::Load(place) => {
                let at = self.at(place)?;
                Ok(self.memory.values[at])
            }
            Code::Neg(of) => {
                let value = self.value(of)?;
                self.memory.operations += 1;
                match value {
                    Value::Real(x) => self.number(Value::Real(-x)),
                    Value::Lreal(x) => self.number(Value::Lreal(-x)),
                    Value::Int(x) => self.whole(x.checked_neg().map(Value::Int)),
                    Value::Dint(x) => self.whole(x.checked_neg().map(Value::Dint)),
                    Value::Bool(_) => self.stop("minus BOOL"),
                }
            }
            Code::Not(of) => {
                let value = self.condition(of)?;
                self.memory.operations += 1;
                Ok(Value::Bool(!value))
            }
            Code::Abs(of) => {
                let value = self.value(of)?;
                self.memory.operations += 1;
                match value {
                    Value::Real(x) => self.number(Value::Real(x.abs())),
                    Value::Lreal(x) => self.number(Value::Lreal(x.abs())),
                    Value::Int(x) => self.whole(x.checked_abs().map(Value::Int)),
                    Value::Dint(x) => self.whole(x.checked_abs().map(Value::Dint)),
                    Value::Bool(_) => self.stop("ABS of BOOL"),
                }
            }
            Code::Convert(to, of) => {
                let value = self.value(of)?;
                self.memory.operations += 1;
                match (value, to) {
                    (Value::Int(x), Ty::Dint) => Ok(Value::Dint(x.into())),
                    (Value::Int(x), Ty::Real) => Ok(Value::Real(x.into())),
                    (Value::Int(x), Ty::Lreal) => Ok(Value::Lreal(x.into())),
                    (Value::Dint(x), Ty::Real) => Ok(Value::Real(x as f32)),
                    (Value::Dint(x), Ty::Lreal) => Ok(Value::Lreal(x.into())),
                    (value, to) => self.stop(format!("{value:?} to {to:?}")),
                }
            }
            // Both sides of AND and OR too: so do many controllers.
            Code::Binary(op, left, right) => {
                let (left, right) = (self.value(left)?, self.value(right)?);
                self.memory.operations += 1;
                self.binary(*op, left, right)
            }
            Code::Call(number, inputs) => {
                let library = self.library;
                let unit = &library.units[*number];
                let Kind::Function { frame, .. } = unit.kind else { return self.stop("a call of no function") };
                let frame = self.memory.functions + frame;
                let mut given = [Value::Bool(false); 8];
                for ((_, code), given) in inputs.iter().zip(&mut given) {
                    *given = self.value(code)?;
                }
                self.memory.values[frame..frame + unit.image.len()].copy_from_slice(&unit.image);
                for ((at, _), given) in inputs.iter().zip(given) {
                    self.memory.values[frame + at] = given;
                }
                self.memory.operations += 1 + inputs.len() as u64;
                self.enter(*number, frame)?;
                Ok(self.memory.values[frame])
            }
        }
    }

    fn binary(&self, op: Op, left: Value, right: Value) -> Result<Value, Stop> {
        use std::cmp::Ordering;
        let ordering = match (left, right) {
            (Value::Bool(a), Value::Bool(b)) => {
                return Ok(Value::Bool(match op {
                    Op::And => a && b,
                    Op::Or => a || b,
                    Op::Xor | Op::Ne => a != b,
                    Op::Eq => a == b,
                    _ => return self.stop(format!("{} between BOOL", op.symbol())),
                }));
            }
            (Value::Int(a), Value::Int(b)) => Some(a.cmp(&b)),
            (Value::Dint(a), Value::Dint(b)) => Some(a.cmp(&b)),
            (Value::Real(a), Value::Real(b)) => a.partial_cmp(&b),
            (Value::Lreal(a), Value::Lreal(b)) => a.partial_cmp(&b),
            _ => return self.stop(format!("{left:?} {} {right:?}: mixed types", op.symbol())),
        };
        Ok(Value::Bool(match op {
            Op::Eq => ordering == Some(Ordering::Equal),
            Op::Ne => ordering != Some(Ordering::Equal),
            Op::Lt => ordering == Some(Ordering::Less),
            Op::Le => matches!(ordering, Some(Ordering::Less | Ordering::Equal)),
            Op::Gt => ordering == Some(Ordering::Greater),
            Op::Ge => matches!(ordering, Some(Ordering::Greater | Ordering::Equal)),
            _ => return self.arithmetic(op, left, right),
        }))
    }

    /// Each operation is rounded once; nothing is fused.
    fn arithmetic(&self, op: Op, left: Value, right: Value) -> Result<Value, Stop> {
        macro_rules! float {
            ($a:expr, $b:expr) => {
                match op {
                    Op::Add => $a + $b,
                    Op::Sub => $a - $b,
                    Op::Mul => $a * $b,
                    Op::Div if $b == 0.0 => return self.stop("a division by zero"),
                    Op::Div => $a / $b,
                    _ => return self.stop(format!("{} between numbers with a point", op.symbol())),
                }
            };
        }
        macro_rules! integer {
            ($a:expr, $b:expr) => {
                match op {
                    Op::Add => $a.checked_add($b),
                    Op::Sub => $a.checked_sub($b),
                    Op::Mul => $a.checked_mul($b),
                    Op::Div | Op::Mod if $b == 0 => return self.stop("a division by zero"),
                    Op::Div => $a.checked_div($b),
                    Op::Mod => $a.checked_rem($b),
                    _ => return self.stop(format!("{} between integers", op.symbol())),
                }
            };
        }
        match (left, right) {
            (Value::Real(a), Value::Real(b)) => self.number(Value::Real(float!(a, b))),
            (Value::Lreal(a), Value::Lreal(b)) => self.number(Value::Lreal(float!(a, b))),
            (Value::Int(a), Value::Int(b)) => self.whole(integer!(a, b).map(Value::Int)),
            (Value::Dint(a), Value::Dint(b)) => self.whole(integer!(a, b).map(Value::Dint)),
            _ => self.stop(format!("{left:?} {} {right:?}: mixed types", op.symbol())),
        }
    }

    /// Also where an operand already was none: a controller may trap there.
    fn number(&self, value: Value) -> Result<Value, Stop> {
        let finite = match value {
            Value::Real(x) => x.is_finite(),
            Value::Lreal(x) => x.is_finite(),
            _ => true,
        };
        if finite { Ok(value) } else { self.stop("a result that is no number") }
    }

    fn whole(&self, value: Option<Value>) -> Result<Value, Stop> {
        match value {
            Some(value) => Ok(value),
            None => self.stop("an integer out of range"),
        }
    }
}

fn whole(value: Value) -> i64 {
    match value {
        Value::Int(x) => x.into(),
        Value::Dint(x) => x.into(),
        _ => 0,
    }
}
