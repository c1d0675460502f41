//! A control loop with a worn valve, from setpoint to process value.

use crate::error::require;
use crate::plant::{Sampled, SampledState};
use crate::signal::sample_at;
use crate::{Plant, Signal, SimError};
use glapp_core::{
    Backlash, BacklashState, Noise, NoiseState, Pid, PidState, Saturation, SecondOrderFilter, SecondOrderFilterState,
};
use std::ops::Range;

/// Flag of a sample in manual.
pub const NOT_AUTO: u8 = 1;
/// Flag of a sample with the output at its lower limit.
pub const AT_LOW: u8 = 4;
/// Flag of a sample with the output at its upper limit.
pub const AT_HIGH: u8 = 8;

/// A closed loop, sampled at one rate:
///
/// ```text
///                                   load
///                                    │ +
///  sp ──→ PID ──→ limits ──→ gap ──→ ○ ──→ plant ──┬──→
///          ↑         │op      │position            │
///          │                                       ○ ←── noise
///          └──────────────── filter ←──────────────┴ pv
/// ```
///
/// It begins at rest at the first setpoint and load, in auto, the output in the middle of the gap.
#[derive(Clone, Debug)]
pub struct ClosedLoop {
    /// The process.
    pub plant: Plant,
    /// Gain K ≠ 0, negative where more output lowers the process value [output per process value].
    pub k: f64,
    /// Integral time > 0 [s].
    pub ti: f64,
    /// Derivative time ≥ 0 [s].
    pub td: f64,
    /// Setpoint weight, 0 to 1.
    pub b: f64,
    /// Time constant of the second-order filter before the controller [s]; 0 for none.
    pub tf: f64,
    /// Saturation of the output; `None` for none.
    pub limits: Option<(f64, f64)>,
    /// Total width of the gap ≥ 0 [unit of the output].
    pub d: f64,
    /// Amplitude of the uniform noise on the process value ≥ 0 [unit of the process value].
    pub noise: f64,
    /// Time between samples > 0 [s].
    pub h: f64,
    /// Time of the last sample [s].
    pub t_end: f64,
    /// Setpoint [unit of the process value].
    pub setpoint: Signal,
    /// Load at the process input [unit of the output].
    pub load: Signal,
    /// Stretches in manual, in ascending order, without overlap.
    pub manual: Vec<Manual>,
    /// Seed of the noise.
    pub seed: u64,
}

/// A stretch in manual: the samples at `from` ≤ t < `to`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Manual {
    /// Begin [s].
    pub from: f64,
    /// End [s].
    pub to: f64,
    /// The output that the operator sets; `None` leaves it where it stands.
    pub op: Option<f64>,
}

/// The signals of a simulated loop, one value a sample.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Columns {
    /// Time [s], exactly k·h.
    pub t: Vec<f64>,
    /// Setpoint.
    pub sp: Vec<f64>,
    /// Process value with noise, before the filter.
    pub pv: Vec<f64>,
    /// Controller output within its limits.
    pub op: Vec<f64>,
    /// Valve position: what the gap leaves of the output.
    pub position: Vec<f64>,
    /// Load.
    pub load: Vec<f64>,
    /// [`NOT_AUTO`], [`AT_LOW`], [`AT_HIGH`].
    pub flags: Vec<u8>,
}

/// More samples than this are a slip of the pen, not a simulation.
const MOST_SAMPLES: f64 = 1e8;
/// How far beyond what is asked of it a loop may go before it is called unstable.
const RUNAWAY: f64 = 1e6;

impl ClosedLoop {
    /// Runs the loop from t = 0 to `t_end`.
    ///
    /// The same loop gives the same bits, always.
    pub fn run(&self) -> Result<Columns, SimError> {
        match self.plant.order() {
            1 => self.run_order::<1>(),
            2 => self.run_order::<2>(),
            3 => self.run_order::<3>(),
            4 => self.run_order::<4>(),
            5 => self.run_order::<5>(),
            6 => self.run_order::<6>(),
            7 => self.run_order::<7>(),
            8 => self.run_order::<8>(),
            9 => self.run_order::<9>(),
            _ => self.run_order::<{ crate::plant::MAX_ORDER }>(),
        }
    }

    fn run_order<const N: usize>(&self) -> Result<Columns, SimError> {
        let plant = Sampled::<N>::new(&self.plant, self.h)?;
        let limits = self.limits.map_or(Ok(Saturation::none()), |(low, high)| Saturation::new(low, high))?;
        let pid = Pid::new(self.k, self.ti, self.td, self.b, limits)?;
        let filter = SecondOrderFilter::new(self.tf)?;
        require("noise", self.noise, self.noise >= 0.0, "0 or greater")?;
        let blocks = Blocks { plant, noise: Noise::new(self.noise)?, filter, pid, gap: Backlash::new(self.d)?, limits };

        let within = self.t_end >= 0.0 && self.t_end / self.h < MOST_SAMPLES;
        require("t_end", self.t_end, within, "0 s or greater, and not above 10⁸ steps")?;
        let n = (self.t_end / self.h + 1e-9).floor() as usize + 1;
        let stretches = self.stretches(n)?;
        let sp = self.setpoint.column("setpoint", self.h, n)?;
        let load = self.load.column("load", self.h, n)?;

        let v = self.plant.gain().map_or(0.0, |kp| sp[0] / kp);
        let op = v - load[0];
        if op < limits.low || op > limits.high {
            return Err(SimError::NoRest { op, why: "outside the limits" });
        }
        let mut state = State {
            y: sp[0],
            plant: blocks.plant.at_rest(sp[0], v, n),
            noise: NoiseState::seeded(self.seed),
            filter: SecondOrderFilterState::default(),
            pid: PidState::default(),
            gap: BacklashState::at(op),
        };
        blocks.pid.track(&mut state.pid, sp[0], sp[0], op, self.h);

        let mut columns = Columns {
            t: vec![0.0; n],
            sp,
            pv: vec![0.0; n],
            op: vec![0.0; n],
            position: vec![0.0; n],
            load,
            flags: vec![0; n],
        };
        for (samples, mode) in stretches {
            match mode {
                Mode::Auto => blocks.advance::<false>(&mut state, &mut columns, samples, self.h, None),
                Mode::Manual(op) => blocks.advance::<true>(&mut state, &mut columns, samples, self.h, op),
            }
        }
        self.refuse_runaway(&columns)?;
        Ok(columns)
    }

    /// The run cut into stretches of one mode: samples, and in manual what the operator sets.
    fn stretches(&self, n: usize) -> Result<Vec<(Range<usize>, Mode)>, SimError> {
        let mut stretches = Vec::new();
        let mut done = 0;
        let mut last = f64::NEG_INFINITY;
        for &Manual { from, to, op } in &self.manual {
            let number = from.is_finite() && to.is_finite() && op.is_none_or(f64::is_finite);
            if !number || from < last || to <= from {
                let what = format!("stretch from {from} s to {to} s; write ascending times that do not overlap");
                return Err(SimError::Signal { name: "manual", what });
            }
            last = to;
            let (begin, end) = (sample_at(from, self.h, n), sample_at(to, self.h, n));
            stretches.push((done..begin, Mode::Auto));
            stretches.push((begin..end, Mode::Manual(op)));
            done = end;
        }
        stretches.push((done..n, Mode::Auto));
        Ok(stretches)
    }

    fn refuse_runaway(&self, columns: &Columns) -> Result<(), SimError> {
        let largest = |x: &[f64]| x.iter().fold(0.0, |a: f64, x| a.max(x.abs()));
        let asked = largest(&columns.sp) + self.noise;
        let reach = self.plant.reach(self.t_end.max(self.h));
        let effort = largest(&columns.load) + self.d + columns.op[0].abs() + asked * (self.k.abs() + 1.0 / reach);
        let (op_bound, pv_bound) = (RUNAWAY * effort, RUNAWAY * (asked + effort * reach));
        for k in 0..columns.t.len() {
            // Written so that a NaN counts as beyond.
            let beyond = |x: f64, bound: f64| !matches!(x.abs().partial_cmp(&bound), Some(o) if o.is_le());
            for (signal, x, bound) in [("OP", columns.op[k], op_bound), ("PV", columns.pv[k], pv_bound)] {
                if beyond(x, bound) {
                    return Err(SimError::Unstable { signal, bound, t: columns.t[k] });
                }
            }
        }
        Ok(())
    }
}

/// Who sets the output; in manual, to what, unless it stays.
enum Mode {
    Auto,
    Manual(Option<f64>),
}

struct Blocks<const N: usize> {
    plant: Sampled<N>,
    noise: Noise<f64>,
    filter: SecondOrderFilter<f64>,
    pid: Pid<f64>,
    gap: Backlash<f64>,
    limits: Saturation<f64>,
}

#[derive(Clone)]
struct State<const N: usize> {
    /// Process value without noise at the coming sample.
    y: f64,
    plant: SampledState<N>,
    noise: NoiseState,
    filter: SecondOrderFilterState<f64>,
    pid: PidState<f64>,
    gap: BacklashState<f64>,
}

impl<const N: usize> Blocks<N> {
    /// Takes `samples` steps, in manual with the output at `manual` or where it stands.
    fn advance<const MANUAL: bool>(
        &self,
        state: &mut State<N>,
        columns: &mut Columns,
        samples: Range<usize>,
        h: f64,
        manual: Option<f64>,
    ) {
        // A copy that nothing else can point to stays in registers.
        let mut s = state.clone();
        let first = samples.start;
        let (t, sp) = (&mut columns.t[samples.clone()], &columns.sp[samples.clone()]);
        let (pv, op) = (&mut columns.pv[samples.clone()], &mut columns.op[samples.clone()]);
        let (position, load) = (&mut columns.position[samples.clone()], &columns.load[samples.clone()]);
        let flags = &mut columns.flags[samples];
        let n = t.len();
        assert!([sp.len(), pv.len(), op.len(), position.len(), load.len(), flags.len()] == [n; 6]);
        for k in 0..n {
            let y = self.noise.update(&mut s.noise, s.y);
            let yf = self.filter.update(&mut s.filter, y, h);
            let u = if MANUAL {
                let held = manual.unwrap_or(s.pid.output);
                self.pid.track(&mut s.pid, sp[k], yf, held, h)
            } else {
                self.pid.update(&mut s.pid, sp[k], yf, h)
            };
            let x = self.gap.update(&mut s.gap, u);
            s.y = self.plant.update(&mut s.plant, x + load[k]);
            t[k] = (first + k) as f64 * h;
            pv[k] = y;
            op[k] = u;
            position[k] = x;
            let mode = if MANUAL { NOT_AUTO } else { 0 };
            flags[k] =
                mode | if u <= self.limits.low { AT_LOW } else { 0 } | if u >= self.limits.high { AT_HIGH } else { 0 };
        }
        *state = s;
    }
}
