//! A scenario: a control loop with a worn valve, what acts on it, and how it is recorded.

use crate::{Piece, Plant, Signal, Valve};
use glapp_core::{CompensationSettings, Estimate, Friction};
use std::ops::Range;

/// A closed loop, sampled at one rate:
///
/// ```text
///   compensation  op                             position      load
///       │ +       │                                 │           │ +
///  sp ──→ PID ──┴→ rate ──→ gap ──→ friction ──→ valve ─┴─→ ○ ──→ plant ──┬──→
///          ↑   within its limits                                          ○ ←── noise
///          └──────────────── filter ←─────────────────────────────────────┴ pv
/// ```
///
/// It begins at rest at the first setpoint and load, in auto, the output in the middle of the gap.
///
/// With compensation it is a [`Graph`](crate::Graph) of the modules that ship; without, a faster loop of the same blocks.
#[derive(Clone, Debug)]
pub struct Scenario {
    /// The process.
    pub plant: Plant,
    /// The controller.
    pub controller: Controller,
    /// Total width of the gap ≥ 0 [unit of the output].
    pub d: f64,
    /// Stick-slip friction after the gap.
    pub friction: Option<Friction<f64>>,
    /// A valve as a mechanism, after gap and friction. It cannot be compensated: the modules that ship have none.
    pub valve: Option<Valve>,
    /// Greatest speed of the actuator > 0 [unit of the output per second].
    pub rate: Option<f64>,
    /// Measurement noise [unit of the process value].
    pub noise: Signal,
    /// Steps that the process value is rounded to ≥ 0, 0 for none [unit of the process value].
    pub pv_resolution: f64,
    /// Steps that the output is rounded to ≥ 0, 0 for none [unit of the output].
    pub op_resolution: f64,
    /// Setpoint [unit of the process value]; where there is an outer loop, its setpoint.
    pub setpoint: Signal,
    /// Load at the process input [unit of the output].
    pub load: Signal,
    /// Stretches in manual, in ascending order, without overlap.
    pub manual: Vec<Manual>,
    /// Stretches, from ≤ t < to \[s\], in which no process value arrives: the controller repeats its output.
    pub bad: Vec<(f64, f64)>,
    /// Compensation of the gap, with a warning of over-compensation beside it.
    pub compensation: Option<Compensated>,
    /// The outer loop of a cascade, whose output is this one's setpoint.
    pub outer: Option<Outer>,
    /// The recorded time of a sample is wrong by a uniform number between ± this, at most h/2 \[s\].
    pub jitter: f64,
    /// Share of the samples that never reach the recording, 0 ≤ lost < 1.
    pub lost: f64,
    /// Time between samples > 0 \[s\].
    pub h: f64,
    /// Time of the last sample \[s\].
    pub t_end: f64,
    /// Seed of everything random.
    pub seed: u64,
}

/// PI or PID controller (4.1) with the filter before it.
#[derive(Clone, Debug, PartialEq)]
pub struct Controller {
    /// Gain K ≠ 0, negative where more output lowers the process value [output per process value].
    pub k: f64,
    /// Integral time > 0 \[s\].
    pub ti: f64,
    /// Derivative time ≥ 0 \[s\].
    pub td: f64,
    /// Setpoint weight, 0 to 1.
    pub b: f64,
    /// Time constant of the second-order filter before the controller \[s\]; 0 for none.
    pub tf: f64,
    /// Limits of the output; `None` for none.
    pub limits: Option<(f64, f64)>,
}

/// Compensation that a person enables at some time, by the module [`BacklashDetection`](glapp_core::modules::BacklashDetection)
/// beside the controller. The module is told Ti, Td, b, the limits and the static gain as they are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Compensated {
    /// Settings of the compensation; `k` is the gain that the module is told, in all that it does. The limits are the
    /// controller's.
    pub settings: CompensationSettings<f64>,
    /// Time constant of the detector's filter ≥ 0 \[s\].
    pub tf: f64,
    /// Time of enabling \[s\].
    pub begin: f64,
    /// Number of scans until the controller has the value handed over, where it is not a controller of the graph: the
    /// module reads its output, and whether it is in automatic. `None`: it is, and a scan is what it takes.
    pub delay: Option<u32>,
    /// The longest delay with which it may be enabled, as a share of Ti; by the way where not given.
    pub longest: Option<f64>,
}

/// The outer loop of a cascade (thesis 8.3):
///
/// ```text
///  setpoint ──→ PID ──→ [ inner loop ] ──→ gap ──→ ○ ──→ plant ──┬──→
///                ↑         op = inner sp           ↑ load        ○ ←── noise
///                └──────────────── filter ←──────────────────────┴ pv
/// ```
///
/// While the inner loop is in manual, the outer output stays where it stood.
#[derive(Clone, Debug)]
pub struct Outer {
    /// The process that the inner loop's process value drives.
    pub plant: Plant,
    /// The controller.
    pub controller: Controller,
    /// Total width of a gap before the outer process ≥ 0 [unit of the inner process value].
    pub d: f64,
    /// Measurement noise [unit of the outer process value].
    pub noise: Signal,
    /// Load at the outer process' input [unit of the inner process value].
    pub load: Signal,
}

/// A stretch in manual: the samples at `from` ≤ t < `to`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Manual {
    /// Begin \[s\].
    pub from: f64,
    /// End \[s\].
    pub to: f64,
    /// The output that the operator sets; `None` leaves it where it stands.
    pub op: Option<f64>,
}

/// The signals of a simulated loop, one value a recorded sample.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Columns {
    /// Time \[s\], k·h where there is no jitter.
    pub t: Vec<f64>,
    /// Setpoint; in a cascade that of the inner loop, which is the outer output.
    pub sp: Vec<f64>,
    /// Process value with noise, before the filter.
    pub pv: Vec<f64>,
    /// Controller output within its limits, as it is sent to the valve.
    pub op: Vec<f64>,
    /// Valve position: what rate limit, gap and friction leave of the output.
    pub position: Vec<f64>,
    /// Load.
    pub load: Vec<f64>,
    /// [`NOT_AUTO`], [`BAD`], [`AT_LOW`], [`AT_HIGH`].
    pub flags: Vec<u8>,
    /// Setpoint of the outer loop; empty where there is none.
    pub outer_sp: Vec<f64>,
    /// Process value of the outer loop; empty where there is none.
    pub outer_pv: Vec<f64>,
    /// Feed-forward that the compensation handed to the controller; empty without one, as the next three.
    pub u_ff: Vec<f64>,
    /// State of the compensation after the sample, as a number.
    pub standing: Vec<f64>,
    /// Warnings of over-compensation: 1 that of code block 7.1, 2 the relay, 3 both.
    pub over: Vec<f64>,
    /// Error of the module: [`WRONG_SIGN`](glapp_core::status::WRONG_SIGN) or 0.
    pub error: Vec<f64>,
}

/// [`Columns`] in memory that belongs to someone else, or a part of them.
#[derive(Debug)]
#[allow(missing_docs)]
pub struct Block<'a> {
    pub t: &'a mut [f64],
    pub sp: &'a mut [f64],
    pub pv: &'a mut [f64],
    pub op: &'a mut [f64],
    pub position: &'a mut [f64],
    pub load: &'a mut [f64],
    pub flags: &'a mut [u8],
    pub outer_sp: &'a mut [f64],
    pub outer_pv: &'a mut [f64],
    pub u_ff: &'a mut [f64],
    pub standing: &'a mut [f64],
    pub over: &'a mut [f64],
    pub error: &'a mut [f64],
}

/// Results of a detector in a simulated loop whose signals were not kept.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Seen {
    /// The estimate at the end.
    pub estimate: Option<Estimate<f64>>,
    /// Accepted half-periods.
    pub detections: u32,
    /// All half-periods.
    pub half_periods: u32,
}

/// Samples at a time: few enough for the columns to stay in the nearest memory.
pub(crate) const CHUNK: usize = 512;

impl Scenario {
    /// A sound loop in which nothing happens, up to `t_end` in steps of `h` \[s\].
    ///
    /// ```
    /// use glapp_sim::{Controller, Piece, Plant, Scenario};
    ///
    /// let controller = Controller { k: 0.775, ti: 2.05, td: 0.0, b: 0.0, tf: 0.2, limits: None };
    /// let scenario = Scenario {
    ///     d: 0.05,
    ///     setpoint: vec![Piece::Steps(vec![(1.0, 1.0)])],
    ///     ..Scenario::new(Plant::named("P2")?, controller, 0.05, 100.0)
    /// };
    /// let signals = scenario.run()?;
    /// assert_eq!(signals.t.len(), 2001);
    /// assert!((signals.pv[2000] - 1.0).abs() < 0.02);
    /// # Ok::<(), glapp_sim::SimError>(())
    /// ```
    pub fn new(plant: Plant, controller: Controller, h: f64, t_end: f64) -> Self {
        Self {
            plant,
            controller,
            d: 0.0,
            friction: None,
            valve: None,
            rate: None,
            noise: vec![],
            pv_resolution: 0.0,
            op_resolution: 0.0,
            setpoint: vec![],
            load: vec![],
            manual: vec![],
            bad: vec![],
            compensation: None,
            outer: None,
            jitter: 0.0,
            lost: 0.0,
            h,
            t_end,
            seed: 0,
        }
    }
}

impl Columns {
    pub(crate) fn of_length(n: usize, scenario: &Scenario) -> Self {
        let column = || vec![0.0; n];
        let only = |there: bool| if there { column() } else { Vec::new() };
        let (outer, compensated) = (scenario.outer.is_some(), scenario.compensation.is_some());
        Self {
            t: column(),
            sp: column(),
            pv: column(),
            op: column(),
            position: column(),
            load: column(),
            flags: vec![0; n],
            outer_sp: only(outer),
            outer_pv: only(outer),
            u_ff: only(compensated),
            standing: only(compensated),
            over: only(compensated),
            error: only(compensated),
        }
    }

    pub(crate) fn block(&mut self) -> Block<'_> {
        let Self { t, sp, pv, op, position, load, flags, outer_sp, outer_pv, u_ff, standing, over, error } = self;
        Block { t, sp, pv, op, position, load, flags, outer_sp, outer_pv, u_ff, standing, over, error }
    }

    pub(crate) fn shorten(&mut self, n: usize) {
        let Self { t, sp, pv, op, position, load, outer_sp, outer_pv, u_ff, standing, over, error, .. } = self;
        [t, sp, pv, op, position, load, outer_sp, outer_pv, u_ff, standing, over, error]
            .into_iter()
            .for_each(|column| column.truncate(n));
        self.flags.truncate(n);
    }
}

impl Block<'_> {
    /// The rows of a range.
    pub(crate) fn part(&mut self, rows: Range<usize>) -> Block<'_> {
        let outer = if self.outer_sp.is_empty() { 0..0 } else { rows.clone() };
        let compensated = if self.u_ff.is_empty() { 0..0 } else { rows.clone() };
        Block {
            t: &mut self.t[rows.clone()],
            sp: &mut self.sp[rows.clone()],
            pv: &mut self.pv[rows.clone()],
            op: &mut self.op[rows.clone()],
            position: &mut self.position[rows.clone()],
            load: &mut self.load[rows.clone()],
            flags: &mut self.flags[rows],
            outer_sp: &mut self.outer_sp[outer.clone()],
            outer_pv: &mut self.outer_pv[outer],
            u_ff: &mut self.u_ff[compensated.clone()],
            standing: &mut self.standing[compensated.clone()],
            over: &mut self.over[compensated.clone()],
            error: &mut self.error[compensated],
        }
    }
}

/// The largest magnitude that a signal is meant to have in `t` seconds.
pub(crate) fn magnitude(signal: &[Piece], t: f64) -> f64 {
    let largest = |x: &mut dyn Iterator<Item = f64>| x.fold(0.0, |a: f64, x| a.max(x.abs()));
    let of = |piece: &Piece| match piece {
        Piece::Steps(steps) => largest(&mut steps.iter().map(|step| step.1)),
        Piece::Ramp { by, .. } => by.abs(),
        Piece::Sine { amplitude, .. } | Piece::Uniform { amplitude } => amplitude.abs(),
        Piece::Walk { rate } => 6.0 * rate * t.sqrt(),
        Piece::Gaussian { sigma } | Piece::Coloured { sigma, .. } => 6.0 * sigma,
        Piece::Samples(samples) => largest(&mut samples.iter().copied()),
    };
    signal.iter().map(of).sum()
}
