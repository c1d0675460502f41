//! Runs the library, strictly: what one controller may do and another may not stops the run.

use crate::flow::{is_total, unread};
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
    /// Branches that were taken.
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
            let Some(slot) = self.library.units[unit].slot(part) else { break };
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
        self.run(None, None)
    }

    /// Runs with a change of the library; the changes of a probe are tried wherever their units are called.
    pub(crate) fn run(&mut self, change: Option<&Change>, probe: Option<&mut Probe<'_>>) -> Result<(), Fault> {
        Run::new(self.library, &mut self.memory, change, probe, self.unit, 0)
            .enter(self.unit, 0)
            .map_err(|fault| *fault)
    }

    /// A copy of the block with another memory.
    pub(crate) fn with(&self, values: Vec<Value>) -> Self {
        let taken = vec![false; self.library.ways.len()];
        let memory = Memory { values, functions: self.memory.functions, operations: 0, taken };
        Self { library: self.library, unit: self.unit, memory }
    }

    /// All variables.
    pub(crate) fn values(&self) -> &[Value] {
        &self.memory.values
    }

    /// Puts in what begins with another value in a changed library: all of it, or what a power cut takes.
    pub(crate) fn begin(&mut self, change: &Change, all: bool) {
        for (at, value) in change.begins(self.unit) {
            if all || !self.library.units[self.unit].retained[*at] {
                self.memory.values[*at] = *value;
            }
        }
    }

    /// Whether both show the same from now on, given the same; `strictly`: nothing is left out because the block writes it before it reads it.
    pub(crate) fn stands_as(&self, other: &Self, strictly: bool) -> bool {
        let kept = &self.library.kept[self.unit];
        let pairs = self.memory.values.iter().zip(&other.memory.values).zip(kept);
        pairs.into_iter().all(|((a, b), kept)| !(strictly || *kept) || a.bits() == b.bits())
    }

    /// The block's name.
    pub fn name(&self) -> &str {
        &self.library.units[self.unit].name
    }

    /// Operators, conversions, assignments and calls so far.
    pub fn operations(&self) -> u64 {
        self.memory.operations
    }

    /// Branches of the library that were taken so far.
    pub fn taken(&self) -> &[bool] {
        &self.memory.taken
    }
}

/// Changes, each tried where its unit is called on what this is given there.
///
/// A change is tried at its step alone first: the unit runs with it only where its step does something else.
pub(crate) struct Probe<'p> {
    changes: &'p [Change],
    /// Changes, by unit and step, that have had the same effect so far.
    live: Vec<Vec<Vec<usize>>>,
    /// Changes of functions whose initial value differs.
    always: Vec<Vec<usize>>,
    /// Number of both.
    count: Vec<usize>,
    /// Changes that have left another memory, or stopped.
    pub differ: Vec<usize>,
    /// Whether the step of each change was reached, with another value.
    pub reached: Vec<bool>,
    pub other: Vec<bool>,
    /// The call in which its step was another at last.
    seen: Vec<u64>,
    calls: u64,
    marked: Vec<usize>,
    memory: Memory,
}

impl<'p> Probe<'p> {
    pub(crate) fn new(library: &Library, changes: &'p [Change]) -> Self {
        let taken = vec![false; library.ways.len()];
        Self {
            changes,
            live: vec![vec![]; library.units.len()],
            always: vec![vec![]; library.units.len()],
            count: vec![0; library.units.len()],
            differ: vec![],
            reached: vec![false; changes.len()],
            other: vec![false; changes.len()],
            seen: vec![0; changes.len()],
            calls: 0,
            marked: vec![],
            memory: Memory { values: vec![], functions: 0, operations: 0, taken },
        }
    }

    /// Tries a change from here on.
    pub(crate) fn add(&mut self, library: &Library, one: usize) {
        let change = &self.changes[one];
        let function = matches!(library.units[change.unit].kind, Kind::Function { .. });
        if let Some(step) = &change.step {
            let live = &mut self.live[change.unit];
            if live.len() <= step.number {
                live.resize(step.number + 1, vec![]);
            }
            live[step.number].push(one);
        } else if function && change.begins(change.unit).next().is_some() {
            self.always[change.unit].push(one);
        } else {
            return;
        }
        self.count[change.unit] += 1;
    }

    /// No longer.
    fn remove(&mut self, one: usize) {
        let change = &self.changes[one];
        let live = match &change.step {
            Some(step) => &mut self.live[change.unit][step.number],
            None => &mut self.always[change.unit],
        };
        let before = live.len();
        live.retain(|other| *other != one);
        self.count[change.unit] -= before - live.len();
    }

    fn mark(&mut self, one: usize, call: u64) {
        if self.seen[one] != call {
            (self.seen[one], self.other[one]) = (call, true);
            self.marked.push(one);
        }
    }

    /// Runs the unit with a change on what it was given, where its step was another.
    fn compare(&mut self, library: &Library, unit: usize, one: usize, before: &[Value], after: &[Value]) {
        let changes = self.changes;
        let (change, memory) = (&changes[one], &mut self.memory);
        memory.values.clear();
        memory.values.extend_from_slice(before);
        memory.values.resize(before.len() + library.function_memory, Value::Bool(false));
        memory.functions = before.len();
        let function = matches!(library.units[unit].kind, Kind::Function { .. });
        if function {
            let inputs = |at: usize| {
                let slots = &library.units[unit].slots;
                slots.iter().any(|slot| slot.at == at && slot.class == Class::Input)
            };
            change.begins(unit).filter(|(at, _)| !inputs(*at)).for_each(|(at, value)| memory.values[*at] = *value);
        }
        let ran = Run::new(library, memory, Some(change), None, unit, 0).body();
        let kept = |at: usize| if function { at == 0 } else { change.strict || library.kept[unit][at] };
        let pairs = self.memory.values.iter().zip(after).take(before.len()).enumerate();
        let same = ran.is_ok() && pairs.into_iter().all(|(at, (a, b))| !kept(at) || a.bits() == b.bits());
        if !same {
            self.remove(one);
            self.differ.push(one);
        }
    }
}

/// Change between two libraries.
#[derive(Clone, Debug)]
pub(crate) struct Change {
    unit: usize,
    step: Option<Step>,
    /// Changed expression of the step: its number and its code, where it is one.
    part: Option<(usize, Code)>,
    /// Changed initial values, by unit.
    begins: Vec<(usize, Vec<(usize, Value)>)>,
    /// The change may read a value that the unchanged unit writes before it reads it.
    pub strict: bool,
}

impl Change {
    /// Change between a library and one with another body or initial memory of a unit.
    pub(crate) fn between(library: &Library, changed: &Library, unit: usize) -> Self {
        let differing = |number: usize| -> Vec<(usize, Value)> {
            let (as_it_is, other) = (&library.units[number].image, &changed.units[number].image);
            let pairs = as_it_is.iter().zip(other).enumerate();
            pairs.filter(|(_, (a, b))| a.bits() != b.bits()).map(|(at, (_, b))| (at, *b)).collect()
        };
        let begins = (0..library.units.len()).map(|number| (number, differing(number)));
        let found = other_step(&library.units[unit].body, &changed.units[unit].body);
        let (step, part) = found.map_or((None, None), |(step, part)| (Some(step.clone()), part));
        let reads = |of: &Library| of.units[unit].flow.read.clone();
        let strict = reads(changed).iter().zip(reads(library)).any(|(a, b)| *a && !b);
        Self { unit, step, part, begins: begins.filter(|(_, all)| !all.is_empty()).collect(), strict }
    }

    /// Whether it is the same program.
    pub(crate) fn is_none(&self) -> bool {
        self.step.is_none() && self.begins.is_empty()
    }

    /// Whether no statement reads the changed values.
    pub(crate) fn is_unread(&self, library: &Library) -> bool {
        let Some(changed) = &self.step else {
            let places: Vec<usize> = self.begins(self.unit).map(|(at, _)| *at).collect();
            return unread(&library.units, self.unit, None, &places);
        };
        if !self.begins.is_empty() {
            return false;
        }
        let Some(step) = find(&library.units[self.unit].body, changed.number) else { return false };
        let places = match (&step.kind, &changed.kind) {
            (StepKind::Set(Place::Fixed(to), _), StepKind::Set(Place::Fixed(at), code)) if is_total(code) => {
                vec![*to, *at]
            }
            (
                StepKind::Call { at: one, inputs: a, copies: c, .. },
                StepKind::Call { at: other, inputs: b, copies: d, .. },
            ) if one == other && c == d && b.iter().all(|input| a.contains(input) || is_total(&input.1)) => {
                let apart = |from: &[(usize, Code)], to: &[(usize, Code)]| -> Vec<usize> {
                    from.iter().filter(|input| !to.contains(input)).map(|(at, _)| *at).collect()
                };
                [apart(a, b), apart(b, a)].concat()
            }
            _ => return false,
        };
        unread(&library.units, self.unit, Some(changed.number), &places)
    }

    /// Changed initial values of a unit.
    pub(crate) fn begins(&self, unit: usize) -> impl Iterator<Item = &(usize, Value)> {
        self.begins.iter().filter(move |(number, _)| *number == unit).flat_map(|(_, all)| all)
    }
}

/// The step of a number.
fn find(all: &[Step], number: usize) -> Option<&Step> {
    all.iter().find_map(|step| match &step.kind {
        _ if step.number == number => Some(step),
        StepKind::If { branches, otherwise, .. } => {
            branches.iter().find_map(|(_, body)| find(body, number)).or_else(|| find(otherwise, number))
        }
        StepKind::For { body, .. } | StepKind::While { body, .. } => find(body, number),
        _ => None,
    })
}

/// The first step that is another, and which of its expressions, where it is one.
fn other_step<'s>(all: &[Step], changed: &'s [Step]) -> Option<(&'s Step, Option<(usize, Code)>)> {
    use StepKind::{Call, For, If, Set, While};
    let first = |codes: &mut dyn Iterator<Item = (&Code, &Code)>| {
        codes.enumerate().find(|(_, (a, b))| a != b).map(|(part, (_, b))| (part, b.clone()))
    };
    for (a, b) in all.iter().zip(changed) {
        if a == b {
            continue;
        }
        let (part, within) = match (&a.kind, &b.kind) {
            (If { branches: a, otherwise: c, .. }, If { branches: b, otherwise: d, .. }) => {
                let part = first(&mut a.iter().zip(b).map(|((a, _), (b, _))| (a, b)));
                let bodies = a.iter().zip(b).find_map(|((_, a), (_, b))| other_step(a, b));
                (part, bodies.or_else(|| other_step(c, d)))
            }
            (While { condition: a, body: c, .. }, While { condition: b, body: d, .. }) => {
                (first(&mut std::iter::once((a, b))), other_step(c, d))
            }
            (For { body: c, .. }, For { body: d, .. }) => (None, other_step(c, d)),
            (Set(to, a), Set(at, b)) if to == at => (first(&mut std::iter::once((a, b))), None),
            (Call { inputs: a, .. }, Call { inputs: b, .. }) if a.iter().zip(b).all(|((a, _), (b, _))| a == b) => {
                (first(&mut a.iter().zip(b).map(|((_, a), (_, b))| (a, b))), None)
            }
            _ => (None, None),
        };
        return if part.is_none() && within.is_some() { within } else { Some((b, part)) };
    }
    None
}

/// A fault at some length: what a run gives back is short.
type Stop = Box<Fault>;

struct Run<'r, 'p> {
    library: &'r Library,
    memory: &'r mut Memory,
    change: Option<&'r Change>,
    probe: Option<&'r mut Probe<'p>>,
    unit: &'r Compiled,
    number: usize,
    frame: usize,
    line: usize,
    /// Number of this call among all, and whether changes of this unit are tried in it.
    call: u64,
    tried: bool,
}

impl<'r, 'p> Run<'r, 'p> {
    fn new(
        library: &'r Library,
        memory: &'r mut Memory,
        change: Option<&'r Change>,
        probe: Option<&'r mut Probe<'p>>,
        number: usize,
        frame: usize,
    ) -> Self {
        Self {
            library,
            memory,
            change,
            probe,
            unit: &library.units[number],
            number,
            frame,
            line: 0,
            call: 0,
            tried: false,
        }
    }

    fn body(&mut self) -> Result<(), Stop> {
        let unit = self.unit;
        self.steps(&unit.body)
    }

    /// Runs a unit of the library where its memory begins.
    fn enter(&mut self, number: usize, frame: usize) -> Result<(), Stop> {
        let length = self.library.units[number].image.len();
        let tried = self.probe.as_ref().is_some_and(|probe| probe.count[number] > 0);
        let before = tried.then(|| self.memory.values[frame..frame + length].to_vec());
        let (mut call, mut from) = (0, 0);
        if let (true, Some(probe)) = (tried, self.probe.as_deref_mut()) {
            probe.calls += 1;
            (call, from) = (probe.calls, probe.marked.len());
            for one in probe.always[number].clone() {
                probe.reached[one] = true;
                probe.mark(one, call);
            }
        }
        let probe = self.probe.as_deref_mut();
        Run { call, tried, ..Run::new(self.library, self.memory, self.change, probe, number, frame) }.body()?;
        if let (Some(before), Some(probe)) = (before, self.probe.as_deref_mut()) {
            for one in probe.marked.split_off(from) {
                probe.compare(self.library, number, one, &before, &self.memory.values[frame..]);
            }
        }
        Ok(())
    }

    /// An expression of a step has a value: what have the changes of it?
    fn tries(&mut self, number: usize, part: usize, value: Value) {
        let Some(probe) = self.probe.as_deref_mut().filter(|_| self.tried) else { return };
        let Some(live) = probe.live[self.number].get(number).filter(|live| !live.is_empty()) else { return };
        let changes = probe.changes;
        let mut others = vec![];
        for one in live {
            let Some((_, code)) = changes[*one].part.as_ref().filter(|(place, _)| *place == part) else { continue };
            probe.reached[*one] = true;
            if probe.seen[*one] == self.call {
                continue;
            }
            let mut run = Run::new(self.library, self.memory, None, None, self.number, self.frame);
            if !run.value(code).is_ok_and(|other| other.bits() == value.bits()) {
                others.push(*one);
            }
        }
        let call = self.call;
        others.into_iter().for_each(|one| probe.mark(one, call));
    }

    /// A step is reached of which not an expression is another, but where it reads or writes.
    fn tries_whole(&mut self, number: usize) {
        let Some(probe) = self.probe.as_deref_mut().filter(|_| self.tried) else { return };
        let Some(live) = probe.live[self.number].get(number) else { return };
        let whole: Vec<usize> = live.iter().copied().filter(|one| probe.changes[*one].part.is_none()).collect();
        for one in whole {
            probe.reached[one] = true;
            probe.mark(one, self.call);
        }
    }

    fn stop<T>(&self, what: impl Into<String>) -> Result<T, Stop> {
        Err(Box::new(Fault::new(&self.unit.name, self.line, what)))
    }

    fn steps(&mut self, steps: &'r [Step]) -> Result<(), Stop> {
        for step in steps {
            let changed =
                self.change.filter(|change| change.unit == self.number).and_then(|change| change.step.as_ref());
            let step = changed.filter(|changed| changed.number == step.number).unwrap_or(step);
            self.line = step.line;
            self.tries_whole(step.number);
            self.step(step.number, &step.kind)?;
        }
        Ok(())
    }

    fn condition(&mut self, code: &Code) -> Result<bool, Stop> {
        match self.value(code)? {
            Value::Bool(x) => Ok(x),
            other => self.stop(format!("{other:?} as a condition")),
        }
    }

    /// A condition of a step, which changes are tried on.
    fn decision(&mut self, number: usize, part: usize, code: &Code) -> Result<bool, Stop> {
        let holds = self.condition(code)?;
        self.tries(number, part, Value::Bool(holds));
        Ok(holds)
    }

    fn step(&mut self, number: usize, step: &'r StepKind) -> Result<(), Stop> {
        match step {
            StepKind::Set(place, code) => {
                let value = self.value(code)?;
                self.tries(number, 0, value);
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
                for (branch, (condition, body)) in branches.iter().enumerate() {
                    if self.decision(number, branch, condition)? {
                        self.memory.taken[first_way + branch] = true;
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
                    if !self.decision(number, 0, condition)? {
                        return Ok(());
                    }
                    self.memory.taken[*way] = true;
                    self.steps(body)?;
                }
                return self.stop("a WHILE without end");
            }
            StepKind::Call { at, unit, inputs, copies } => {
                for (part, (to, code)) in inputs.iter().enumerate() {
                    let value = self.value(code)?;
                    self.tries(number, part, value);
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
            // Both sides of AND and OR are evaluated, as in many controllers.
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
                if let Some(change) = self.change {
                    change.begins(*number).for_each(|(at, value)| self.memory.values[frame + at] = *value);
                }
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

    /// Fails also where an operand already was no number: a controller may trap there.
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

pub(crate) fn whole(value: Value) -> i64 {
    match value {
        Value::Int(x) => x.into(),
        Value::Dint(x) => x.into(),
        _ => 0,
    }
}
