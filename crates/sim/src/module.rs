//! The modules that a graph is made of, as an editor sees them: kinds with ports, parameters and variables by name.
//!
//! A kind is a file of this folder: its [`Kind`], and what it does at work, [`Work`]. A new one is a file and its row in
//! [`KINDS`].

mod auto_tuner;
mod backlash;
mod backlash_detection;
mod compensation;
mod delay;
mod filter;
mod friction;
mod input;
mod noise;
mod output;
mod phase_lead;
mod pid;
mod pid_advanced;
mod plant;
mod process_sim;
mod rate_limit;
mod resolution;
mod saturation;
mod stiction;
mod sum;

pub(crate) use resolution::rounded;

use crate::{GraphError, Plant, SimError};
use glapp_core::modules::Gains;
use glapp_core::{Backward, Forward, ParameterError};

/// The most inputs of a module.
pub(crate) const MOST_INPUTS: usize = 5;

/// Inputs of a module, in the order of its kind's ports.
pub(crate) type Inputs = [Forward<f64>; MOST_INPUTS];
/// Backward signals to the modules at its inputs.
pub(crate) type BackwardSignals = [Backward<f64>; MOST_INPUTS];

/// All kinds, in the order of the documentation.
static KINDS: [&Kind; 19] = [
    &input::KIND,
    &output::KIND,
    &noise::KIND,
    &sum::KIND,
    &resolution::KIND,
    &delay::KIND,
    &backlash::KIND,
    &friction::KIND,
    &saturation::KIND,
    &rate_limit::KIND,
    &filter::KIND,
    &phase_lead::KIND,
    &process_sim::KIND,
    &plant::KIND,
    &pid::KIND,
    &pid_advanced::KIND,
    &auto_tuner::KIND,
    &backlash_detection::KIND,
    &stiction::KIND,
];

/// A kind of modules.
#[derive(Debug)]
pub(crate) struct Kind {
    pub(crate) name: &'static str,
    /// Names of the inputs; those in `optional` may stay open.
    pub(crate) inputs: &'static [&'static str],
    pub(crate) optional: &'static [&'static str],
    /// The output may stay open.
    pub(crate) may_end: bool,
    /// The module has a setpoint at `sp`, and its output goes to a valve or to the setpoint of another.
    pub(crate) is_controller: bool,
    /// The output in a scan depends on the inputs of earlier scans only.
    pub(crate) is_delay: bool,
    parameters: &'static [&'static [Parameter]],
    /// Parameters that are used only when it is made.
    beginnings: &'static [&'static str],
    /// Commands that an operator can set during the run.
    commands: &'static [&'static str],
    /// Variables that can only be read.
    variables: &'static [&'static [&'static str]],
    make: Make,
}

/// Makes a module of a kind.
type Make = fn(&Module, Context) -> Result<Box<dyn Work>, SimError>;

/// A parameter: its name and its default.
type Parameter = (&'static str, Usual);

/// Default of a parameter.
#[derive(Clone, Copy, Debug)]
enum Usual {
    /// No default: it must be given.
    Required,
    Is(f64),
    /// Not known: the module works without it or finds it out.
    Unknown,
}
use Usual::{Is, Required, Unknown};

/// Surroundings of a module.
#[derive(Clone, Copy)]
pub(crate) struct Context {
    /// Scan time \[s\].
    h: f64,
    /// Inputs that are connected.
    connected: [bool; MOST_INPUTS],
}

impl Context {
    /// Whether the input of that name is connected.
    fn has(&self, kind: &Kind, input: &str) -> bool {
        kind.inputs.iter().zip(self.connected).any(|(name, connected)| connected && *name == input)
    }
}

/// Behaviour of a module in a graph.
pub(crate) trait Work: Send + Sync {
    /// The forward pass: what its inputs hand on, and the time since the last scan \[s\].
    fn forward(&mut self, inputs: &Inputs, h: f64) -> Forward<f64>;

    /// The backward pass: takes the followers' signals, where it has any; gives those of each of its inputs. By default
    /// the first one is told the same.
    fn backward(&mut self, back: Option<Backward<f64>>) -> BackwardSignals {
        passed(back)
    }

    /// The output of this scan of a module that is a delay.
    fn output(&self) -> Forward<f64> {
        Forward::new(0.0, 0)
    }

    /// Puts new parameters in force. What it remembers stays; where they are out of bounds, all stays.
    fn change(&mut self, to: &Module, context: Context) -> Result<(), SimError>;

    /// A command or variable.
    fn get(&self, _name: &str) -> Option<f64> {
        None
    }

    /// Sets one of the kind's commands.
    fn command(&mut self, _name: &str, _value: f64) -> Result<(), ParameterError> {
        Ok(())
    }

    /// K, Ti and Td that an autotuner in it offers, by name; none where it can have none.
    fn offered(&self) -> Option<Result<[(&'static str, f64); 3], ParameterError>> {
        None
    }

    /// Called after such an offer was put in force.
    fn taken_over(&mut self) {}

    /// The detections behind its estimate, the oldest first, where it has a detector.
    fn window(&self) -> Option<Vec<f64>> {
        None
    }

    /// Makes it forget all detections; false where it has no detector.
    fn reset_detection(&mut self) -> bool {
        false
    }
}

impl Kind {
    /// One input, one output, nothing else.
    const fn plain(name: &'static str, make: Make) -> Self {
        Self {
            name,
            inputs: &["in"],
            optional: &[],
            may_end: false,
            is_controller: false,
            is_delay: false,
            parameters: &[],
            beginnings: &[],
            commands: &[],
            variables: &[],
            make,
        }
    }

    /// Whether the module is driven by a valve: flags end here, and a loop is closed.
    pub(crate) fn is_process(&self) -> bool {
        self.is_delay && self.name != delay::KIND.name
    }

    fn parameters(&self) -> impl Iterator<Item = &'static Parameter> {
        self.parameters.iter().copied().flatten()
    }

    fn parameter(&self, name: &str) -> Option<(usize, &'static Parameter)> {
        self.parameters().enumerate().find(|(_, known)| known.0 == name)
    }

    /// The value of a parameter that is given, or not.
    fn value(&self, (name, usual): Parameter, given: Option<f64>) -> Result<Option<f64>, GraphError> {
        match (given, usual) {
            (Some(value), _) | (None, Is(value)) => Ok(Some(value)),
            (None, Unknown) => Ok(None),
            (None, Required) => Err(GraphError::Missing { module: self.name, parameter: name }),
        }
    }
}

/// A module before it is in a graph: its kind and its parameters.
///
/// | kind | inputs (optional) | parameters (default) |
/// |---|---|---|
/// | `Input` | | `value` (0) |
/// | `Output` | in | |
/// | `Noise` | in | `amplitude`, `seed` (1) |
/// | `Sum` | in, plus | |
/// | `Resolution` | in | `step` |
/// | `Delay` | in | `scans`, `start` (0) |
/// | `Backlash` | in | `d`, `start` (its first input) |
/// | `Friction` | in | `s`, `j`, `model` (1), `start` (its first input) |
/// | `Saturation` | in | `low`, `high` |
/// | `RateLimit` | in | `rate`, `told` (1), `start` (its first input) |
/// | `Filter2P` | in | `tf` |
/// | `PhaseLead` | in | `lead`, `lag`, `start` (its first input) |
/// | `ProcessSim` | in (load) | `gain`, `t1`, `t2` (0), `dead_time` (0), `h` (the graph's), `start` (0) |
/// | `Plant`, by [`Module::plant`] | in (load) | `h` (the graph's), `start` (0) |
/// | `Pid` | pv (sp, ff) | `k`, `ti`, `td` (0), `b` (1), `c` (0), `tf` (0), `low`, `high`, `rate` (none), `max_h` (Ti/2), `start` (0), `start_pv` (its first PV) |
/// | `PidAdvanced` | pv (sp, ff, by) | those of `Pid`, and `kp`, `pv_span`, `op_span` (not known), `integrating` (0), `detector_tf` (it sees what the controller sees), `n` (9), `sp_rate` (none), and the autotuner's: `tune_amplitude` (0: none), `tune_wait`, `tune_longest`, `tune_pv_low`, `tune_pv_high`, `tune_relay_hysteresis` (from noise), `tune_d` (0), `tune_rule` (1) |
/// | `AutoTuner` | in, pv | `amplitude`, `wait`, `longest`, `pv_low`, `pv_high`, `op_low`, `op_high`, `relay_hysteresis` (from noise), `d` (0), `max_h` (3h) |
/// | `BacklashDetection` | sp, pv (op, flags, u_ff) | `k`, `ti`, `td` (0), `b` (1), `kp`, `pv_span`, `op_span` (not known), `integrating` (0), `tf` (Td/5, or Ti/10 without D), `n` (9), `op_low`, `op_high` (not known), `max_h` (3h), `ff_delay` (1), `ff_tolerance` (a tenth of the size), `ff_longest` (by the way) |
/// | `Stiction` | sp, pv | `push` (1 knocker, 2 reinforcement, 3 two moves), `k`, `ti`, `size`, `limit` (the size), `hold`, `period`, `band`, `far` (0), `rate`, `release`, `travel`, `watch`, `withdraw` (1), `op_low`, `op_high` (not known) |
///
/// With `flags` connected a `BacklashDetection` stands beside a controller that is no module here, and takes all from its inputs
/// ([`ForeignDetection`](glapp_core::modules::ForeignDetection)).
///
/// `PidAdvanced` and `BacklashDetection` compensate where `comp_size` (0) is given and `compensate` is set while they run.
/// `comp_way` (3) is 1 error, 2 derivative, 3 inverse; `comp_share` (1), `comp_limit` (the size), `comp_band` (a fifth of the
/// size), `comp_tf` (0), `comp_rate` (the inverse goes from side to side in Ti/10, the others jump), `comp_release` (Ti),
/// `comp_watch` (300 Ti), `comp_travel` and `comp_reversals` (no budget), `comp_withdraw` (1), `comp_estimate` (1) are those
/// of [`CompensationSettings`](glapp_core::CompensationSettings).
///
/// `tune_rule` is 1 point placement, 2 AMIGO PI, 3 AMIGO PID.
///
/// `start` is where it rests at the beginning: the process value, a valve's position, or a controller's output; `model` of
/// friction is 1 Kano, 2 He, 3 Karnopp; a `RateLimit` with `told` 0 holds back and tells nobody.
#[derive(Clone, Debug)]
pub struct Module {
    pub(crate) kind: &'static Kind,
    /// Values in the order of the kind's parameters; none: not known.
    values: Vec<Option<f64>>,
    plant: Option<Plant>,
    schedule: Vec<Gains<f64>>,
}

impl Module {
    /// A module by the name of its kind, with parameters by name.
    pub fn new(kind: &str, parameters: &[(&str, f64)]) -> Result<Self, GraphError> {
        let names = || KINDS.iter().map(|kind| kind.name).collect::<Vec<_>>().join(", ");
        let found = KINDS.iter().find(|known| known.name == kind);
        let kind = found.ok_or_else(|| GraphError::NoKind { kind: kind.into(), known: names() })?;
        for (name, _) in parameters {
            if kind.parameter(name).is_none() {
                let known = kind.parameters().map(|known| known.0).collect::<Vec<_>>().join(", ");
                return Err(GraphError::NoName { module: kind.name.into(), name: (*name).into(), known });
            }
        }
        let given = |name: &str| parameters.iter().find(|given| given.0 == name).map(|given| given.1);
        let values = kind.parameters().map(|known| kind.value(*known, given(known.0)));
        Ok(Self { kind, values: values.collect::<Result<_, _>>()?, plant: None, schedule: Vec::new() })
    }

    /// An exact plant of any order.
    pub fn plant(plant: Plant, parameters: &[(&str, f64)]) -> Result<Self, GraphError> {
        Ok(Self { plant: Some(plant), ..Self::new("Plant", parameters)? })
    }

    /// A `PidAdvanced` with a gain schedule of at most [`SCHEDULE_ROWS`](glapp_core::modules::SCHEDULE_ROWS) rows.
    pub fn scheduled(parameters: &[(&str, f64)], rows: &[Gains<f64>]) -> Result<Self, GraphError> {
        Ok(Self { schedule: rows.to_vec(), ..Self::new("PidAdvanced", parameters)? })
    }

    /// A parameter that may not be known.
    fn known(&self, name: &str) -> Option<f64> {
        self.kind.parameter(name).and_then(|(at, _)| self.values[at])
    }

    /// A parameter that is given, or has a default.
    fn value(&self, name: &str) -> f64 {
        self.known(name).unwrap_or(f64::NAN)
    }

    /// A parameter that is a whole number, 0 or greater.
    fn whole(&self, name: &'static str) -> Result<u32, ParameterError> {
        let value = self.value(name);
        let number = value as u32;
        let same = f64::from(number) == value;
        if same { Ok(number) } else { Err(ParameterError { name, value, bound: "a whole number" }) }
    }

    /// A parameter that is 0 or 1.
    fn yes(&self, name: &'static str) -> Result<bool, ParameterError> {
        switch(name, self.value(name), "0 (no) or 1 (yes)")
    }

    /// A parameter that is one of the values of an enumeration with numbers.
    fn one_of<T: Copy>(&self, name: &'static str, all: &[(f64, T)], bound: &'static str) -> Result<T, ParameterError> {
        let value = self.value(name);
        let found = all.iter().find(|one| one.0 == value);
        found.map(|one| one.1).ok_or(ParameterError { name, value, bound })
    }

    /// Cause of jumps of its output, if there is one.
    pub(crate) fn jumps(&self) -> Option<Jumps> {
        let has = |name| self.kind.parameter(name).is_some();
        if has("comp_size") && matches!(compensation::settings(self), Ok(Some(_))) {
            Some(Jumps::FeedForward)
        } else if self.kind.name == auto_tuner::KIND.name
            || (has("tune_amplitude") && self.value("tune_amplitude") != 0.0)
        {
            Some(Jumps::Relay)
        } else {
            None
        }
    }

    /// The scan time that it was made for, where it is made for one.
    pub(crate) fn own_h(&self) -> Option<f64> {
        self.known("h")
    }
}

/// Cause of jumps of a module's output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Jumps {
    /// u_FF.
    FeedForward,
    /// The relay of an autotuner.
    Relay,
}

/// A module at work in a graph.
pub(crate) struct Live {
    pub(crate) module: Module,
    context: Context,
    pub(crate) work: Box<dyn Work>,
}

/// Why a name could not be set.
pub(crate) enum Refusal {
    /// No settable name.
    NoName,
    /// A parameter that the module cannot do without, or that does not go with another module of the graph.
    Graph(GraphError),
    /// Error of its value.
    Value(SimError),
}

impl From<ParameterError> for Refusal {
    fn from(error: ParameterError) -> Self {
        Self::Value(error.into())
    }
}

impl Live {
    /// Makes the module for the scan time `h` and the inputs that are connected.
    pub(crate) fn new(module: Module, h: f64, connected: [bool; MOST_INPUTS]) -> Result<Self, SimError> {
        let context = Context { h, connected };
        Ok(Self { work: (module.kind.make)(&module, context)?, module, context })
    }

    /// A parameter or variable, if there is one of that name; none within: a parameter that is not known.
    pub(crate) fn get(&self, name: &str) -> Option<Option<f64>> {
        let parameter = || self.module.kind.parameter(name).map(|(at, _)| self.module.values[at]);
        let in_force = |known: Option<f64>| if name == "h" { known.or(Some(self.context.h)) } else { known };
        self.work.get(name).map(Some).or_else(|| parameter().map(in_force))
    }

    /// All names that [`Self::get`] knows.
    pub(crate) fn names(&self) -> impl Iterator<Item = &'static str> {
        let kind = self.module.kind;
        let set = kind.commands.iter().filter(|name| kind.parameter(name).is_none());
        let variables = kind.variables.iter().copied().flatten();
        kind.parameters().map(|known| known.0).chain(set.copied()).chain(variables.copied())
    }

    /// Sets a parameter or a command; none: the parameter has its default. What the module remembers stays; where the
    /// new value is out of bounds, or the graph does not allow the `changed` module, all stays.
    pub(crate) fn set(
        &mut self,
        name: &str,
        value: Option<f64>,
        allowed: impl Fn(&Module) -> Result<(), GraphError>,
    ) -> Result<(), Refusal> {
        let kind = self.module.kind;
        if kind.commands.contains(&name) {
            return Ok(self.work.command(name, value.unwrap_or(f64::NAN))?);
        }
        let found = kind.parameter(name).filter(|_| !kind.beginnings.contains(&name));
        let (at, known) = found.ok_or(Refusal::NoName)?;
        let mut changed = self.module.clone();
        changed.values[at] = kind.value(*known, value).map_err(Refusal::Graph)?;
        allowed(&changed).map_err(Refusal::Graph)?;
        self.change(changed)
    }

    /// The gain schedule, where the module can have one.
    pub(crate) fn schedule(&self) -> Option<&[Gains<f64>]> {
        (self.module.kind.name == pid_advanced::KIND.name).then_some(&self.module.schedule)
    }

    /// Sets the gain schedule, all rows at once.
    pub(crate) fn set_schedule(&mut self, rows: &[Gains<f64>]) -> Result<(), Refusal> {
        self.schedule().ok_or(Refusal::NoName)?;
        self.change(Module { schedule: rows.to_vec(), ..self.module.clone() })
    }

    /// Puts the offer of the module's autotuner in force.
    pub(crate) fn take_over(&mut self) -> Result<(), Refusal> {
        let offered = self.work.offered().ok_or(Refusal::NoName)??;
        let mut changed = self.module.clone();
        for (name, value) in offered {
            let (at, _) = changed.kind.parameter(name).ok_or(Refusal::NoName)?;
            changed.values[at] = Some(value);
        }
        self.change(changed)?;
        self.work.taken_over();
        Ok(())
    }

    fn change(&mut self, changed: Module) -> Result<(), Refusal> {
        self.work.change(&changed, self.context).map_err(Refusal::Value)?;
        self.module = changed;
        Ok(())
    }
}

/// Backward signal without limits.
fn open() -> Backward<f64> {
    Backward::default()
}

/// Backward signal at the first input of a module that adds nothing to the `back` of its followers.
fn passed(back: Option<Backward<f64>>) -> BackwardSignals {
    [back.unwrap_or_default(), open(), open(), open(), open()]
}

/// Names of the backward signals.
const BACKWARD: &[&str] = &["low", "high", "flags", "tracking"];

fn backward_named(back: &Backward<f64>, name: &str) -> Option<f64> {
    match name {
        "low" => Some(back.low),
        "high" => Some(back.high),
        "flags" => Some(back.flags.into()),
        "tracking" => Some(back.tracking),
        _ => None,
    }
}

/// A parameter that is 0 or 1.
fn switch(name: &'static str, value: f64, bound: &'static str) -> Result<bool, ParameterError> {
    if value == 0.0 || value == 1.0 { Ok(value == 1.0) } else { Err(ParameterError { name, value, bound }) }
}
