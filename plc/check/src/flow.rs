//! Data flow of a unit: reads of the previous call's memory, and of values that its steps have written.

use crate::library::{Code, Compiled, Kind, Place, Step, StepKind, Value};
use crate::run::whole;
use crate::tree::{Class, Op};
use std::borrow::Cow;
use std::collections::HashMap;

/// Data flow by place in the memory of a unit.
#[derive(Clone, Debug, Default)]
pub(crate) struct Flow {
    /// Places that are read before they are written on some way through the unit.
    pub read: Vec<bool>,
    /// Places that are written on every way through the unit.
    pub written: Vec<bool>,
}

/// The flow of a unit whose memory begins at a place of the one that calls it, with some inputs, by their places there.
type Called<'c, 'f> = &'c dyn Fn(usize, usize, &[(usize, Code)]) -> Cow<'f, Flow>;

impl Flow {
    /// Data flow of a unit with so many places; `called` tells that of another.
    pub(crate) fn of(body: &[Step], places: usize, called: Called<'_, '_>) -> Self {
        Self::walked(body, places, called, HashMap::new(), None).0
    }

    /// Data flow of a unit of which some BOOL inputs are known: branches that these close are none.
    fn given(units: &[Compiled], unit: usize, known: HashMap<usize, bool>) -> Self {
        let of = &units[unit];
        Self::walked(&of.body, of.image.len(), &|unit, at, inputs| inside(units, unit, at, inputs), known, None).0
    }

    fn walked(
        body: &[Step],
        places: usize,
        called: Called<'_, '_>,
        known: HashMap<usize, bool>,
        other: Option<(usize, Vec<usize>)>,
    ) -> (Self, Vec<bool>, bool) {
        let mut walk = Walk { read: vec![false; places], called, known, other, seen: false };
        let mut now = Now { written: vec![false; places], other: vec![false; places] };
        walk.steps(body, &mut now);
        (Self { read: walk.read, written: now.written }, now.other, walk.seen)
    }
}

/// Data flow by the BOOL inputs that a call gives as literals.
fn inside<'f>(units: &[Compiled], unit: usize, at: usize, inputs: &[(usize, Code)]) -> Cow<'f, Flow> {
    let literal = |(to, code): &(usize, Code)| match code {
        Code::Const(Value::Bool(x)) => Some((to - at, *x)),
        _ => None,
    };
    Cow::Owned(Flow::given(units, unit, inputs.iter().filter_map(literal).collect()))
}

/// Whether nothing reads what a step leaves in these places, which are another after it, or, of a call, before it; nor what the memory begins
/// with there, where there is no step.
pub(crate) fn unread(units: &[Compiled], unit: usize, step: Option<usize>, places: &[usize]) -> bool {
    let of = &units[unit];
    let other = step.map(|step| (step, places.to_vec()));
    let called = |unit: usize, at: usize, inputs: &[(usize, Code)]| inside(units, unit, at, inputs);
    let (flow, left, seen) = Flow::walked(&of.body, of.image.len(), &called, HashMap::new(), other);
    let function = matches!(of.kind, Kind::Function { .. });
    let own = |at: usize| {
        let slot = of.slots.iter().rev().find(|slot| slot.at <= at).expect("a place has a slot");
        if function { at > 0 } else { slot.class == Class::Local }
    };
    let carried = |at: usize| !own(at) || (flow.read[at] && !function);
    match step {
        Some(_) => !seen && (0..left.len()).all(|at| !left[at] || !carried(at)),
        None => places.iter().all(|at| own(*at) && !flow.read[*at]),
    }
}

/// Whether its value can be worked out whatever the variables hold.
pub(crate) fn is_total(code: &Code) -> bool {
    match code {
        Code::Const(_) | Code::Load(Place::Fixed(_)) => true,
        Code::Not(of) => is_total(of),
        Code::Binary(op, left, right) => {
            !matches!(op, Op::Add | Op::Sub | Op::Mul | Op::Div | Op::Mod) && is_total(left) && is_total(right)
        }
        _ => false,
    }
}

/// State at a point of the text, by place.
#[derive(Clone)]
struct Now {
    written: Vec<bool>,
    /// Whether each place may differ from the unchanged library.
    other: Vec<bool>,
}

impl Now {
    fn write(&mut self, at: usize, other: bool) {
        (self.written[at], self.other[at]) = (true, other);
    }

    fn join(&mut self, way: Self) {
        self.written.iter_mut().zip(way.written).for_each(|(all, one)| *all &= one);
        self.other.iter_mut().zip(way.other).for_each(|(all, one)| *all |= one);
    }
}

struct Walk<'w, 'f> {
    read: Vec<bool>,
    called: Called<'w, 'f>,
    /// Inputs, which a unit does not write.
    known: HashMap<usize, bool>,
    /// A step, and what is another by it.
    other: Option<(usize, Vec<usize>)>,
    /// A differing value was read.
    seen: bool,
}

impl Walk<'_, '_> {
    fn reads(&mut self, at: usize, now: &Now) {
        self.read[at] |= !now.written[at];
        self.seen |= now.other[at];
    }

    fn code(&mut self, code: &Code, now: &Now) {
        match code {
            Code::Const(_) => {}
            Code::Load(Place::Fixed(at)) => self.reads(*at, now),
            Code::Load(Place::Indexed { at, low, high, index }) => {
                self.code(index, now);
                (*at..=at + (high - low) as usize).for_each(|at| self.reads(at, now));
            }
            Code::Neg(of) | Code::Not(of) | Code::Abs(of) | Code::Convert(_, of) => self.code(of, now),
            Code::Binary(_, left, right) => {
                self.code(left, now);
                self.code(right, now);
            }
            Code::Call(_, inputs) => inputs.iter().for_each(|(_, code)| self.code(code, now)),
        }
    }

    /// Value of a condition, where it is known.
    fn holds(&self, code: &Code) -> Option<bool> {
        match code {
            Code::Const(Value::Bool(x)) => Some(*x),
            Code::Load(Place::Fixed(at)) => self.known.get(at).copied(),
            Code::Not(of) => self.holds(of).map(|x| !x),
            Code::Binary(op @ (Op::And | Op::Or), left, right) => {
                let ends = *op == Op::Or;
                match (self.holds(left), self.holds(right)) {
                    (Some(x), _) | (_, Some(x)) if x == ends => Some(ends),
                    (Some(_), Some(_)) => Some(!ends),
                    _ => None,
                }
            }
            _ => None,
        }
    }

    fn steps(&mut self, steps: &[Step], now: &mut Now) {
        for step in steps {
            let others =
                self.other.as_ref().filter(|(number, _)| *number == step.number).map(|(_, places)| places.clone());
            match &step.kind {
                StepKind::Set(place, code) => {
                    self.code(code, now);
                    match place {
                        Place::Fixed(at) => now.write(*at, false),
                        // The index of the written element is not known here.
                        Place::Indexed { index, .. } => self.code(index, now),
                    }
                }
                StepKind::Copy { to, from, length } => self.copy(*to, *from, *length, now),
                StepKind::If { branches, otherwise, .. } => self.branches(branches, otherwise, now),
                StepKind::For { var, from, to, by, body } => {
                    now.write(*var, false);
                    let (from, to, by) = (whole(*from), whole(*to), whole(*by));
                    if (by > 0 && from <= to) || (by < 0 && from >= to) {
                        self.steps(body, now);
                    }
                    self.again(body, now);
                }
                StepKind::While { condition, body, .. } => {
                    self.code(condition, now);
                    self.again(body, now);
                    self.code(condition, now);
                }
                StepKind::Call { at, unit, inputs, copies } => {
                    for (to, code) in inputs {
                        self.code(code, now);
                        now.write(*to, false);
                    }
                    for (to, from, length) in copies {
                        self.copy(*to, *from, *length, now);
                    }
                    others.iter().flatten().for_each(|at| now.other[*at] = true);
                    let flow = (self.called)(*unit, *at, inputs);
                    for (inner, _) in flow.read.iter().enumerate().filter(|(_, read)| **read) {
                        self.reads(at + inner, now);
                    }
                    for (inner, _) in flow.written.iter().enumerate().filter(|(_, all)| **all) {
                        now.write(at + inner, false);
                    }
                    continue;
                }
            }
            others.iter().flatten().for_each(|at| now.other[*at] = true);
        }
    }

    fn copy(&mut self, to: usize, from: usize, length: usize, now: &mut Now) {
        (from..from + length).for_each(|at| self.reads(at, now));
        (to..to + length).for_each(|at| now.write(at, false));
    }

    fn branches(&mut self, branches: &[(Code, Vec<Step>)], otherwise: &[Step], now: &mut Now) {
        let mut ways = vec![];
        let mut open = true;
        for (condition, body) in branches {
            self.code(condition, now);
            let holds = self.holds(condition);
            if holds != Some(false) {
                let mut way = now.clone();
                self.steps(body, &mut way);
                ways.push(way);
            }
            if holds == Some(true) {
                open = false;
                break;
            }
        }
        if open {
            self.steps(otherwise, now);
        } else {
            *now = ways.pop().expect("the way that is taken");
        }
        ways.into_iter().for_each(|way| now.join(way));
    }

    /// Any number of times, none among them.
    fn again(&mut self, body: &[Step], now: &mut Now) {
        for _ in 0..2 {
            let mut way = now.clone();
            self.steps(body, &mut way);
            now.join(way);
        }
    }
}
