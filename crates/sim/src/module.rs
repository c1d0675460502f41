//! The modules that a graph is made of, as an editor sees them: kinds with ports, parameters and variables by name.

use crate::Plant;
use crate::engine::{Process, process_at_rest};
use crate::graph::GraphError;
use glapp_core::auto_tuner::Found;
use glapp_core::modules::{
    self, AutoTuner, AutoTunerState, BacklashDetection, BacklashDetectionSettings, BacklashDetectionState, Gains, Mode,
    Pid, PidAdvanced, PidAdvancedSettings, PidAdvancedState, PidSettings, PidState, SCHEDULE_ROWS,
};
use glapp_core::status::{AT_HIGH, AT_LOW, NOT_AUTO, Status};
use glapp_core::{
    AutoTunerSettings, Backlash, BacklashState, Backward, CompensationSettings, DETECTIONS, DetectorSettings, Forward,
    Noise, NoiseState, ParameterError, RateLimit, RateLimitState, Saturation, SecondOrderFilter,
    SecondOrderFilterState, Way,
};

/// The most inputs of a module.
pub(crate) const MOST_INPUTS: usize = 4;
/// What a [`ProcessSim`](modules::ProcessSim) of a graph remembers.
const MEMORY: usize = 1024;

type ProcessSim = modules::ProcessSim<f64, MEMORY>;
type ProcessSimState = modules::ProcessSimState<f64, MEMORY>;

/// A parameter: its name, and what it is where it is not given; none: it must be given. NaN stands for *not known*.
type Parameter = (&'static str, Option<f64>);

/// A kind of modules.
#[derive(Debug)]
pub(crate) struct Kind {
    pub(crate) name: &'static str,
    /// Its inputs; those in `optional` may stay open.
    pub(crate) inputs: &'static [&'static str],
    pub(crate) optional: &'static [&'static str],
    /// Its output may stay open.
    pub(crate) may_end: bool,
    parameters: &'static [Parameter],
    /// Parameters that are used only when it is made.
    beginnings: &'static [&'static str],
    /// What an operator sets while it runs.
    commands: &'static [&'static str],
    /// What can only be read.
    variables: &'static [&'static str],
}

const PLAIN: Kind = Kind {
    name: "",
    inputs: &["in"],
    optional: &[],
    may_end: false,
    parameters: &[],
    beginnings: &[],
    commands: &[],
    variables: &[],
};

/// Parameters of a controller, and more of them.
macro_rules! controller_parameters {
    ($list:ident, $($more:expr),* $(,)?) => {
        $list![
            ("k", None),
            ("ti", None),
            ("td", Some(0.0)),
            ("b", Some(1.0)),
            ("c", Some(0.0)),
            ("tf", Some(0.0)),
            ("low", Some(-f64::MAX)),
            ("high", Some(f64::MAX)),
            ("rate", Some(f64::MAX)),
            ("max_h", UNKNOWN),
            ("start", Some(0.0)),
            $($more),*
        ]
    };
}
macro_rules! list {
    ($($parameter:expr),* $(,)?) => { &[$($parameter),*] };
}
/// Parameters of the compensation in a detector; a size of 0: there is none.
macro_rules! with_compensation {
    ($($parameter:expr),* $(,)?) => {
        &[
            $($parameter,)*
            ("comp_size", Some(0.0)),
            ("comp_way", Some(3.0)),
            ("comp_share", Some(1.0)),
            ("comp_limit", UNKNOWN),
            ("comp_band", UNKNOWN),
            ("comp_tf", UNKNOWN),
            ("comp_rate", UNKNOWN),
            ("comp_release", UNKNOWN),
            ("comp_watch", UNKNOWN),
            ("comp_travel", UNKNOWN),
            ("comp_reversals", UNKNOWN),
            ("comp_withdraw", Some(1.0)),
        ]
    };
}
const UNKNOWN: Option<f64> = Some(f64::NAN);

static KINDS: [Kind; 13] = [
    Kind {
        name: "Input",
        inputs: &[],
        parameters: &[("value", Some(0.0))],
        beginnings: &["value"],
        commands: &["value"],
        variables: TOLD,
        ..PLAIN
    },
    Kind {
        name: "Output",
        may_end: true,
        commands: &["low", "high", "flags", "tracking"],
        variables: &["value"],
        ..PLAIN
    },
    Kind { name: "Noise", parameters: &[("amplitude", None), ("seed", Some(1.0))], beginnings: &["seed"], ..PLAIN },
    Kind { name: "Backlash", parameters: &[("d", None)], ..PLAIN },
    Kind { name: "Saturation", parameters: &[("low", None), ("high", None)], ..PLAIN },
    Kind { name: "RateLimit", parameters: &[("rate", None)], ..PLAIN },
    Kind { name: "Filter2P", parameters: &[("tf", None)], ..PLAIN },
    Kind {
        name: "ProcessSim",
        inputs: &["in", "load"],
        optional: &["load"],
        parameters: &[
            ("gain", None),
            ("t1", None),
            ("t2", Some(0.0)),
            ("dead_time", Some(0.0)),
            ("h", UNKNOWN),
            ("start", Some(0.0)),
        ],
        beginnings: &["h", "start"],
        ..PLAIN
    },
    Kind {
        name: "Plant",
        inputs: &["in", "load"],
        optional: &["load"],
        parameters: &[("h", UNKNOWN), ("start", Some(0.0))],
        beginnings: &["h", "start"],
        ..PLAIN
    },
    Kind {
        name: "Pid",
        inputs: &["pv", "sp", "ff"],
        optional: &["sp", "ff"],
        parameters: controller_parameters!(list,),
        beginnings: &["start"],
        commands: &["mode", "sp", "manual"],
        variables: &["ysp", "yf", "error", "flags"],
        ..PLAIN
    },
    Kind {
        name: "PidAdvanced",
        inputs: &["pv", "sp", "ff", "by"],
        optional: &["sp", "ff", "by"],
        parameters: controller_parameters!(
            with_compensation,
            ("kp", UNKNOWN),
            ("n", Some(DETECTIONS as f64)),
            ("sp_rate", Some(f64::MAX)),
        ),
        beginnings: &["start"],
        commands: &["mode", "sp", "manual", "compensate"],
        variables: &[
            "ysp",
            "yf",
            "error",
            "flags",
            "d",
            "reason",
            "d_hat",
            "noise_floor",
            "count",
            "detections",
            "whole",
            "u_ff",
            "standing",
            "over",
        ],
        ..PLAIN
    },
    Kind {
        name: "AutoTuner",
        inputs: &["in", "pv"],
        parameters: &[
            ("amplitude", None),
            ("wait", None),
            ("longest", None),
            ("pv_low", None),
            ("pv_high", None),
            ("op_low", None),
            ("op_high", None),
            ("hysteresis", UNKNOWN),
            ("d", Some(0.0)),
            ("max_h", UNKNOWN),
        ],
        commands: &["run"],
        variables: &["phase", "stop", "ku", "tu", "kp", "kappa"],
        ..PLAIN
    },
    Kind {
        name: "BacklashDetection",
        inputs: &["sp", "pv"],
        may_end: true,
        parameters: with_compensation![
            ("k", None),
            ("ti", None),
            ("td", Some(0.0)),
            ("b", Some(1.0)),
            ("kp", UNKNOWN),
            ("tf", UNKNOWN),
            ("n", Some(DETECTIONS as f64)),
            ("op_low", UNKNOWN),
            ("op_high", UNKNOWN),
            ("max_h", UNKNOWN),
        ],
        commands: &["compensate"],
        variables: &[
            "error",
            "d",
            "reason",
            "d_hat",
            "noise_floor",
            "count",
            "detections",
            "whole",
            "u_ff",
            "standing",
            "over",
        ],
        ..PLAIN
    },
];

/// What an [`Input`](Module) is told backward.
const TOLD: &[&str] = &["low", "high", "flags", "tracking"];

impl Kind {
    pub(crate) fn is_controller(&self) -> bool {
        matches!(self.name, "Pid" | "PidAdvanced")
    }

    /// Its output in a scan was made by the inputs of the scans before.
    pub(crate) fn is_delay(&self) -> bool {
        matches!(self.name, "ProcessSim" | "Plant")
    }
}

/// A module before it is in a graph: its kind and its parameters.
///
/// | kind | inputs (optional) | parameters (default) |
/// |---|---|---|
/// | `Input` | | `value` (0) |
/// | `Output` | in | |
/// | `Noise` | in | `amplitude`, `seed` (1) |
/// | `Backlash` | in | `d` |
/// | `Saturation` | in | `low`, `high` |
/// | `RateLimit` | in | `rate` |
/// | `Filter2P` | in | `tf` |
/// | `ProcessSim` | in (load) | `gain`, `t1`, `t2` (0), `dead_time` (0), `start` (0), `h` (the graph's) |
/// | `Plant`, by [`Module::plant`] | in (load) | `start` (0), `h` (the graph's) |
/// | `AutoTuner` | in, pv | `amplitude`, `wait`, `longest`, `pv_low`, `pv_high`, `op_low`, `op_high`, `hysteresis` (from noise), `d` (0), `max_h` (3h) |
/// | `Pid` | pv (sp, ff) | `k`, `ti`, `td` (0), `b` (1), `c` (0), `tf` (0), `low`, `high`, `rate` (none), `max_h` (Ti/2), `start` (0) |
/// | `PidAdvanced` | pv (sp, ff, by) | those of `Pid`, and `kp` (not known), `n` (9), `sp_rate` (none) |
/// | `BacklashDetection` | sp, pv | `k`, `ti`, `td` (0), `b` (1), `kp` (not known), `tf` (Td/5, or Ti/10 without D), `n` (9), `op_low`, `op_high` (not known), `max_h` (3h) |
///
/// The last two compensate where `comp_size` (0) is given and `compensate` is set while they run. `comp_way` (3) is 1 error,
/// 2 derivative, 3 inverse; `comp_share` (1), `comp_limit` (the size), `comp_band` (a fifth of the size), `comp_tf` (0),
/// `comp_rate` (the inverse goes from side to side in Ti/10, the others jump), `comp_release` (Ti), `comp_watch` (300 Ti),
/// `comp_travel` and `comp_reversals` (no budget), `comp_withdraw` (1) are those of [`CompensationSettings`].
///
/// `start` is where it rests at the beginning: the process value, or a controller's output.
#[derive(Clone, Debug)]
pub struct Module {
    pub(crate) kind: &'static Kind,
    values: Vec<f64>,
    plant: Option<Plant>,
    schedule: Vec<Gains<f64>>,
}

impl Module {
    /// A module by the name of its kind, with parameters by name.
    pub fn new(kind: &str, parameters: &[(&str, f64)]) -> Result<Self, GraphError> {
        let names = || KINDS.iter().map(|kind| kind.name).collect::<Vec<_>>().join(", ");
        let found = KINDS.iter().find(|known| known.name == kind);
        let kind = found.ok_or_else(|| GraphError::NoKind { kind: kind.into(), known: names() })?;
        let given = |name: &str| parameters.iter().find(|given| given.0 == name).map(|given| given.1);
        for (name, _) in parameters {
            if !kind.parameters.iter().any(|known| known.0 == *name) {
                let known = kind.parameters.iter().map(|known| known.0).collect::<Vec<_>>().join(", ");
                return Err(GraphError::NoName { module: kind.name.into(), name: (*name).into(), known });
            }
        }
        let values = kind.parameters.iter().map(|(name, default)| {
            given(name).or(*default).ok_or(GraphError::Missing { module: kind.name, parameter: name })
        });
        Ok(Self { kind, values: values.collect::<Result<_, _>>()?, plant: None, schedule: Vec::new() })
    }

    /// An exact plant of any order.
    pub fn plant(plant: Plant, parameters: &[(&str, f64)]) -> Result<Self, GraphError> {
        Ok(Self { plant: Some(plant), ..Self::new("Plant", parameters)? })
    }

    /// A `PidAdvanced` with a gain schedule of at most [`SCHEDULE_ROWS`] rows.
    pub fn scheduled(parameters: &[(&str, f64)], rows: &[Gains<f64>]) -> Result<Self, GraphError> {
        Ok(Self { schedule: rows.to_vec(), ..Self::new("PidAdvanced", parameters)? })
    }

    fn value(&self, name: &str) -> f64 {
        let at = self.kind.parameters.iter().position(|known| known.0 == name);
        at.map_or(f64::NAN, |at| self.values[at])
    }

    fn known(&self, name: &str) -> Option<f64> {
        Some(self.value(name)).filter(|value| !value.is_nan())
    }

    /// The scan time that it was made for, where it is made for one.
    pub(crate) fn own_h(&self) -> Option<f64> {
        self.known("h")
    }

    fn pid(&self) -> PidSettings<f64> {
        let ideal = PidSettings::ideal(self.value("k"), self.value("ti"), self.value("td"));
        PidSettings {
            b: self.value("b"),
            c: self.value("c"),
            tf: self.value("tf"),
            low: self.value("low"),
            high: self.value("high"),
            rate: self.value("rate"),
            max_h: self.known("max_h").unwrap_or(ideal.max_h),
            ..ideal
        }
    }

    fn pid_advanced(&self) -> Result<PidAdvancedSettings<f64>, ParameterError> {
        let mut schedule = [Gains::default(); SCHEDULE_ROWS];
        schedule.iter_mut().zip(&self.schedule).for_each(|(to, row)| *to = *row);
        Ok(PidAdvancedSettings {
            pid: self.pid(),
            kp: self.known("kp"),
            n: whole("n", self.value("n"))?,
            sp_rate: self.value("sp_rate"),
            schedule,
            rows: self.schedule.len(),
            compensation: self.compensation()?,
        })
    }

    fn experiment(&self, h: f64) -> AutoTunerSettings<f64> {
        AutoTunerSettings {
            amplitude: self.value("amplitude"),
            hysteresis: self.known("hysteresis"),
            d: self.value("d"),
            wait: self.value("wait"),
            longest: self.value("longest"),
            max_h: self.known("max_h").unwrap_or(3.0 * h),
            pv: (self.value("pv_low"), self.value("pv_high")),
            op: (self.value("op_low"), self.value("op_high")),
        }
    }

    fn detection(&self, h: f64) -> Result<BacklashDetectionSettings<f64>, ParameterError> {
        let usual = DetectorSettings::new(self.value("k"), self.value("ti"), self.value("td"), h);
        let detector = DetectorSettings {
            b: self.value("b"),
            kp: self.known("kp"),
            tf: self.known("tf").unwrap_or(usual.tf),
            n: whole("n", self.value("n"))?,
            op_limits: self.known("op_low").zip(self.known("op_high")),
            max_h: self.known("max_h").unwrap_or(usual.max_h),
            ..usual
        };
        Ok(BacklashDetectionSettings { detector, compensation: self.compensation()? })
    }

    fn compensation(&self) -> Result<Option<CompensationSettings<f64>>, ParameterError> {
        let (size, share, ti) = (self.value("comp_size"), self.value("comp_share"), self.value("ti"));
        if size == 0.0 {
            return Ok(None);
        }
        let way = self.value("comp_way");
        let bound = "1 (error), 2 (derivative) or 3 (inverse)";
        let named = Way::ALL.into_iter().find(|one| f64::from(*one as u8) == way);
        let named = named.ok_or(ParameterError { name: "comp_way", value: way, bound })?;
        let usual = CompensationSettings::new(named, self.value("k"), ti, size, share);
        let or = |name, usual: f64| self.known(name).unwrap_or(usual);
        Ok(Some(CompensationSettings {
            limit: or("comp_limit", usual.limit),
            band: or("comp_band", usual.band),
            tf: or("comp_tf", usual.tf),
            rate: or("comp_rate", usual.rate),
            release: or("comp_release", usual.release),
            watch: or("comp_watch", usual.watch),
            travel: or("comp_travel", usual.travel),
            reversals: or("comp_reversals", usual.reversals),
            withdraw: self.value("comp_withdraw") != 0.0,
            ..usual
        }))
    }
}

fn whole(name: &'static str, value: f64) -> Result<u32, ParameterError> {
    let number = value as u32;
    if f64::from(number) == value { Ok(number) } else { Err(ParameterError { name, value, bound: "a whole number" }) }
}

/// A module at work.
pub(crate) struct Live {
    pub(crate) module: Module,
    h: f64,
    block: Block,
}

enum Block {
    Input(f64, Backward<f64>),
    Output(f64, Backward<f64>),
    Noise(Noise<f64>, NoiseState),
    Backlash(Backlash<f64>, BacklashState<f64>),
    Saturation(Saturation<f64>, f64),
    RateLimit(RateLimit<f64>, RateLimitState<f64>, f64),
    Filter2P(SecondOrderFilter<f64>, SecondOrderFilterState<f64>),
    ProcessSim(ProcessSim, Box<ProcessSimState>),
    Plant(Box<dyn Process>, f64, f64),
    Pid(Pid<f64>, Box<PidState<f64>>),
    PidAdvanced(Box<(PidAdvanced<f64>, PidAdvancedState<f64>)>),
    AutoTuner(Box<(AutoTuner<f64>, AutoTunerState<f64>)>),
    BacklashDetection(Box<(BacklashDetection<f64>, BacklashDetectionState<f64>)>),
}

/// What is handed on at an open input, and told at an open output.
fn nothing() -> Forward<f64> {
    Forward::new(0.0, 0)
}

impl Live {
    /// Makes the module for the scan time `h`; `external` where a setpoint is connected to it.
    pub(crate) fn new(module: Module, h: f64, external: bool) -> Result<Self, crate::SimError> {
        let block = make(&module, h, external)?;
        Ok(Self { module, h, block })
    }

    /// Hands a value to an `Input`; false where it is none.
    pub(crate) fn feed(&mut self, value: f64) -> bool {
        match &mut self.block {
            Block::Input(to, _) => *to = value,
            _ => return false,
        }
        true
    }

    /// The output of this scan of a module that is a delay.
    pub(crate) fn output(&self) -> Forward<f64> {
        match &self.block {
            Block::ProcessSim(process, state) => process.output(state),
            Block::Plant(_, y, _) => Forward::new(*y, 0),
            _ => nothing(),
        }
    }

    /// The forward pass: the inputs in the order of the kind's ports.
    pub(crate) fn forward(&mut self, inputs: &[Forward<f64>; MOST_INPUTS], h: f64) -> Forward<f64> {
        let [x, second, third, fourth] = *inputs;
        match &mut self.block {
            Block::Input(value, _) => Forward::new(*value, 0),
            Block::Output(value, _) => {
                *value = if x.is_good() { x.value } else { f64::NAN };
                x
            }
            Block::Noise(noise, state) => noise.forward(state, x),
            Block::Backlash(gap, state) => gap.forward(state, x),
            Block::Saturation(limits, last) => {
                *last = x.value;
                limits.forward(x)
            }
            Block::RateLimit(limit, state, last) => {
                *last = x.value;
                limit.forward(state, x, h)
            }
            Block::Filter2P(filter, state) => filter.forward(state, x, h),
            Block::ProcessSim(process, state) => {
                let now = process.output(state);
                process.forward(state, x, second);
                now
            }
            Block::Plant(plant, y, held) => {
                let now = Forward::new(*y, 0);
                if x.is_good() && second.is_good() {
                    *held = x.value + second.value;
                }
                *y = plant.update(*held);
                now
            }
            Block::Pid(pid, state) => pid.forward(state, x, second, third, h),
            Block::PidAdvanced(parts) => parts.0.forward(&mut parts.1, x, second, third, fourth, h),
            Block::AutoTuner(parts) => parts.0.forward(&mut parts.1, x, second, h),
            Block::BacklashDetection(parts) => parts.0.forward(&mut parts.1, x, second, h),
        }
    }

    /// The backward pass: what its followers tell, where it has any; gives what each of its inputs is told.
    pub(crate) fn backward(&mut self, back: Option<Backward<f64>>) -> [Backward<f64>; MOST_INPUTS] {
        let open = Backward::default();
        let told = back.unwrap_or_default();
        match &mut self.block {
            Block::Input(_, seen) => {
                *seen = told;
                [open; MOST_INPUTS]
            }
            Block::Output(_, says) => [*says, open, open, open],
            Block::Noise(..) | Block::Backlash(..) | Block::Filter2P(..) => [told, open, open, open],
            Block::Saturation(limits, last) => [limits.backward(*last, told), open, open, open],
            Block::RateLimit(limit, state, last) => [limit.backward(state, *last, told), open, open, open],
            Block::ProcessSim(..) | Block::Plant(..) => [open; MOST_INPUTS],
            Block::Pid(pid, state) => {
                let (sp, ff) = pid.backward(state, told);
                [open, sp, ff, open]
            }
            Block::PidAdvanced(parts) => {
                let (sp, ff) = parts.0.backward(&mut parts.1, told);
                [open, sp, ff, open]
            }
            Block::AutoTuner(parts) => [parts.0.backward(&mut parts.1, told), open, open, open],
            Block::BacklashDetection(parts) => {
                parts.0.backward(&mut parts.1, back);
                [open; MOST_INPUTS]
            }
        }
    }

    /// A parameter or variable.
    pub(crate) fn get(&self, name: &str) -> Option<f64> {
        self.variable(name).or_else(|| {
            let parameters = self.module.kind.parameters;
            parameters.iter().position(|known| known.0 == name).map(|at| self.module.values[at])
        })
    }

    /// All names that [`Self::get`] knows.
    pub(crate) fn names(&self) -> impl Iterator<Item = &'static str> {
        let Kind { parameters, commands, variables, .. } = self.module.kind;
        let set = commands.iter().filter(|name| !parameters.iter().any(|known| known.0 == **name));
        parameters.iter().map(|known| known.0).chain(set.copied()).chain(variables.iter().copied())
    }

    /// Sets a parameter or a command. What it remembers stays; where the new value is out of bounds, all stays.
    pub(crate) fn set(&mut self, name: &str, value: f64) -> Result<(), Refusal> {
        if self.command(name, value)? {
            return Ok(());
        }
        let Kind { parameters, beginnings, .. } = self.module.kind;
        let at = parameters.iter().position(|known| known.0 == name).filter(|_| !beginnings.contains(&name));
        let Some(at) = at else { return Err(Refusal::NoName) };
        if name == "comp_size" && value == 0.0 && self.get("u_ff").is_some_and(|u_ff| u_ff != 0.0) {
            let bound = "greater than 0 while it compensates: set compensate to 0 first";
            return Err(Refusal::Value(ParameterError { name: "comp_size", value, bound }.into()));
        }
        let mut changed = self.module.clone();
        changed.values[at] = value;
        self.change(changed)
    }

    /// The gain schedule, where the module can have one.
    pub(crate) fn schedule(&self) -> Option<&[Gains<f64>]> {
        matches!(self.block, Block::PidAdvanced(_)).then_some(&self.module.schedule)
    }

    /// Sets the gain schedule, all rows at once.
    pub(crate) fn set_schedule(&mut self, rows: &[Gains<f64>]) -> Result<(), Refusal> {
        self.schedule().ok_or(Refusal::NoName)?;
        self.change(Module { schedule: rows.to_vec(), ..self.module.clone() })
    }

    /// Puts new parameters in force, where they are within their bounds. What it remembers stays.
    fn change(&mut self, changed: Module) -> Result<(), Refusal> {
        let fresh = make(&changed, self.h, false).map_err(Refusal::Value)?;
        match (&mut self.block, fresh) {
            (Block::Noise(to, _), Block::Noise(from, _)) => *to = from,
            (Block::Backlash(to, _), Block::Backlash(from, _)) => *to = from,
            (Block::Saturation(to, _), Block::Saturation(from, _)) => *to = from,
            (Block::RateLimit(to, ..), Block::RateLimit(from, ..)) => *to = from,
            (Block::Filter2P(to, _), Block::Filter2P(from, _)) => *to = from,
            (Block::ProcessSim(to, _), Block::ProcessSim(from, _)) => *to = from,
            (Block::Pid(to, _), Block::Pid(from, _)) => *to = from,
            (Block::PidAdvanced(to), Block::PidAdvanced(from)) => to.0 = from.0,
            (Block::AutoTuner(to), Block::AutoTuner(from)) => to.0 = from.0,
            (Block::BacklashDetection(to), Block::BacklashDetection(from)) => to.0 = from.0,
            _ => {}
        }
        self.module = changed;
        Ok(())
    }

    /// Forgets all detections.
    pub(crate) fn reset_detection(&mut self) -> bool {
        match &mut self.block {
            Block::PidAdvanced(parts) => parts.1.detection.reset(),
            Block::BacklashDetection(parts) => parts.1.reset(),
            _ => return false,
        }
        true
    }

    fn variable(&self, name: &str) -> Option<f64> {
        match &self.block {
            Block::Input(value, _) | Block::Output(value, _) if name == "value" => Some(*value),
            Block::Input(_, told) | Block::Output(_, told) => backward_named(told, name),
            Block::Pid(_, state) => controller_named(state, name),
            Block::PidAdvanced(parts) if name == "error" => Some(parts.1.error().into()),
            Block::PidAdvanced(parts) => {
                controller_named(&parts.1.pid, name).or_else(|| detection_named(&parts.1.detection, name))
            }
            Block::AutoTuner(parts) => experiment_named(&parts.1, name),
            Block::BacklashDetection(parts) => detection_named(&parts.1, name),
            _ => None,
        }
    }

    /// Sets what an operator sets; false where `name` is none of that.
    fn command(&mut self, name: &str, value: f64) -> Result<bool, Refusal> {
        if !self.module.kind.commands.contains(&name) {
            return Ok(false);
        }
        let wrong = |name, bound| Err(Refusal::Value(ParameterError { name, value, bound }.into()));
        if name == "compensate" {
            let state = match &mut self.block {
                Block::PidAdvanced(parts) => &mut parts.1.detection,
                Block::BacklashDetection(parts) => &mut parts.1,
                _ => return Ok(false),
            };
            if value != 0.0 && value != 1.0 {
                return wrong("compensate", "0 (off) or 1 (on)");
            }
            state.compensate = value == 1.0;
            return Ok(true);
        }
        match (&mut self.block, name) {
            (Block::Input(to, _), _) => *to = value,
            (Block::Output(_, says), "flags") => {
                if value < 0.0 || value.fract() != 0.0 || value as Status & !(AT_LOW | AT_HIGH | NOT_AUTO) != 0 {
                    return wrong("flags", "a sum of 1 (not followed), 4 (at the lower limit), 8 (at the upper limit)");
                }
                says.flags = value as Status;
            }
            (Block::AutoTuner(parts), _) => match value {
                0.0 => parts.1.run = false,
                1.0 => parts.1.run = true,
                _ => return wrong("run", "0 (end it) or 1 (begin)"),
            },
            // Whatever a plant tells: what makes no sense is the controller's to find out.
            (Block::Output(_, says), "low") => says.low = value,
            (Block::Output(_, says), "high") => says.high = value,
            (Block::Output(_, says), _) => says.tracking = value,
            (block, name) => {
                let state = match block {
                    Block::Pid(_, state) => state,
                    Block::PidAdvanced(parts) => &mut parts.1.pid,
                    _ => return Ok(false),
                };
                match name {
                    "mode" => {
                        state.mode = match value {
                            0.0 => Mode::Manual,
                            1.0 => Mode::Auto,
                            2.0 => Mode::External,
                            _ => return wrong("mode", "0 (manual), 1 (auto) or 2 (external)"),
                        };
                    }
                    _ if !value.is_finite() => return wrong(if name == "sp" { "sp" } else { "manual" }, "a number"),
                    "sp" => state.sp = value,
                    _ => state.manual = value,
                }
            }
        }
        Ok(true)
    }
}

/// Why a name could not be set.
pub(crate) enum Refusal {
    /// There is none of that name that can be set.
    NoName,
    /// Its value.
    Value(crate::SimError),
}

fn backward_named(told: &Backward<f64>, name: &str) -> Option<f64> {
    match name {
        "low" => Some(told.low),
        "high" => Some(told.high),
        "flags" => Some(told.flags.into()),
        "tracking" => Some(told.tracking),
        _ => None,
    }
}

fn controller_named(state: &PidState<f64>, name: &str) -> Option<f64> {
    match name {
        "mode" => Some(f64::from(state.mode as u8)),
        "sp" => Some(state.sp),
        "manual" => Some(state.manual),
        "ysp" => Some(state.ysp),
        "yf" => Some(state.yf),
        "error" => Some(state.error.into()),
        "flags" => Some(state.flags.into()),
        _ => None,
    }
}

fn experiment_named(state: &AutoTunerState<f64>, name: &str) -> Option<f64> {
    let experiment = &state.experiment;
    let found =
        |number: fn(&Found<f64>) -> Option<f64>| Some(experiment.found.as_ref().and_then(number).unwrap_or(f64::NAN));
    match name {
        "run" => Some(u8::from(state.run).into()),
        "phase" => Some(f64::from(experiment.phase as u8)),
        "stop" => Some(f64::from(experiment.stop as u8)),
        "ku" => found(|found| Some(found.ku)),
        "tu" => found(|found| Some(found.tu)),
        "kp" => found(|found| found.kp),
        "kappa" => found(|found| found.kappa),
        _ => None,
    }
}

fn detection_named(state: &BacklashDetectionState<f64>, name: &str) -> Option<f64> {
    let shown = state.detector.shown();
    match name {
        "error" => Some(state.error().into()),
        "d" => Some(state.last.map_or(f64::NAN, |last| last.parts.d)),
        "reason" => Some(state.last.map_or(f64::NAN, |last| f64::from(last.reason() as u8))),
        "d_hat" => Some(shown.map_or(f64::NAN, |shown| shown.value)),
        "noise_floor" => Some(state.detector.noise_floor().unwrap_or(f64::NAN)),
        "count" => Some(shown.map_or(0.0, |shown| shown.count.into())),
        "detections" => Some(state.detector.accepted().into()),
        "whole" => Some(state.shown().map_or(f64::NAN, |whole| whole.value)),
        "u_ff" => Some(state.compensation.u_ff),
        "standing" => Some(f64::from(state.compensation.standing as u8)),
        "over" => Some(f64::from(u8::from(state.over.even) + 2 * u8::from(state.over.relay))),
        "compensate" => Some(f64::from(u8::from(state.compensate))),
        _ => None,
    }
}

fn make(m: &Module, h: f64, external: bool) -> Result<Block, crate::SimError> {
    let h = m.own_h().unwrap_or(h);
    let begin = |state: &mut PidState<f64>| {
        if external {
            state.mode = Mode::External;
        }
    };
    Ok(match m.kind.name {
        "Input" => Block::Input(m.value("value"), Backward::default()),
        "Output" => Block::Output(f64::NAN, Backward::default()),
        "Noise" => {
            let seed = whole("seed", m.value("seed"))?;
            Block::Noise(Noise::new(m.value("amplitude"))?, NoiseState::seeded(seed.into()))
        }
        "Backlash" => Block::Backlash(Backlash::new(m.value("d"))?, BacklashState::default()),
        "Saturation" => Block::Saturation(Saturation::new(m.value("low"), m.value("high"))?, f64::NAN),
        "RateLimit" => Block::RateLimit(RateLimit::new(m.value("rate"))?, RateLimitState::default(), f64::NAN),
        "Filter2P" => Block::Filter2P(SecondOrderFilter::new(m.value("tf"))?, SecondOrderFilterState::default()),
        "ProcessSim" => {
            let gain = m.value("gain");
            let process = ProcessSim::new(gain, m.value("t1"), m.value("t2"), m.value("dead_time"), h)?;
            Block::ProcessSim(process, Box::new(ProcessSimState::at_rest(m.value("start") / gain)))
        }
        "Pid" => {
            let mut state = PidState::at(m.value("start"));
            begin(&mut state);
            Block::Pid(Pid::new(m.pid())?, Box::new(state))
        }
        "PidAdvanced" => {
            let mut state = PidAdvancedState::at(m.value("start"));
            begin(&mut state.pid);
            Block::PidAdvanced(Box::new((PidAdvanced::new(m.pid_advanced()?)?, state)))
        }
        "AutoTuner" => Block::AutoTuner(Box::new((AutoTuner::new(m.experiment(h))?, AutoTunerState::default()))),
        "BacklashDetection" => {
            let detection = BacklashDetection::new(m.detection(h)?)?;
            Block::BacklashDetection(Box::new((detection, BacklashDetectionState::default())))
        }
        _ => {
            let plant = m.plant.as_ref().ok_or(crate::SimError::Plant("a Plant is made with its transfer function"))?;
            let (y, v, process) = process_at_rest(plant, h, m.value("start"))?;
            Block::Plant(process, y, v)
        }
    })
}
