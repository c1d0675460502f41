//! One loop, sample by sample. What compensates runs on the [modules that ship](crate::looped); all others on the blocks
//! themselves, which takes a fifth of the time and gives the same bits (`looped` has the test).

use crate::error::require;
use crate::looped::Looped;
use crate::machine::{Machine, Mode, Rest, bad, resolution, rest, source, stream};
use crate::module::rounded;
use crate::plant::{Sampled, SampledState};
use crate::random::Integers;
use crate::scenario::{Block, Controller, Manual, Scenario, magnitude};
use crate::signal::{Source, sample_at};
use crate::valve::Moving;
use crate::{Outer, Plant, SimError};
use glapp_core::status::{BAD, NOT_AUTO};
use glapp_core::{
    Backlash, BacklashState, Friction, FrictionState, Pid, PidState, RateLimit, RateLimitState, Saturation,
    SecondOrderFilter, SecondOrderFilterState,
};
use std::ops::Range;

/// Most samples of a simulation; more are a mistake in the scenario.
const MOST_SAMPLES: f64 = 1e8;
/// Ratio of a loop's value to its inputs from which it is called unstable.
const RUNAWAY: f64 = 1e6;

/// A scenario under way.
pub(crate) struct Run {
    /// Samples in all.
    pub(crate) n: usize,
    sp: Source,
    load: Source,
    noise: Source,
    stretches: Vec<(Range<usize>, Mode)>,
    machine: Box<dyn Machine>,
    bounds: Bounds,
}

/// Number of samples of a scenario.
pub(crate) fn samples(h: f64, t_end: f64) -> Result<usize, SimError> {
    require("h", h, h > 0.0, "greater than 0 s")?;
    let within = t_end >= 0.0 && t_end / h < MOST_SAMPLES;
    require("t_end", t_end, within, "0 s or greater, and not above 10⁸ steps")?;
    Ok((t_end / h + 1e-9).floor() as usize + 1)
}

type ControllerBlocks = (SecondOrderFilter<f64>, Pid<f64>, Saturation<f64>);

impl Controller {
    pub(crate) fn blocks(&self) -> Result<ControllerBlocks, SimError> {
        let limits = self.limits.map_or(Ok(Saturation::none()), |(low, high)| Saturation::new(low, high))?;
        Ok((SecondOrderFilter::new(self.tf)?, Pid::new(self.k, self.ti, self.td, self.b, limits)?, limits))
    }
}

impl Run {
    /// `on_modules`: on those, though nothing compensates.
    pub(crate) fn new(s: &Scenario, on_modules: bool) -> Result<Self, SimError> {
        let n = samples(s.h, s.t_end)?;
        let sp = source(s, "setpoint", &s.setpoint, stream::SETPOINT, n)?;
        let load = source(s, "load", &s.load, stream::LOAD, n)?;
        let (mut first_sp, mut first_load) = ([0.0], [0.0]);
        sp.clone().fill(0, &mut first_sp);
        load.clone().fill(0, &mut first_load);
        Ok(Self {
            n,
            noise: source(s, "noise", &s.noise, stream::NOISE, n)?,
            stretches: stretches(&s.manual, s.h, n)?,
            machine: match on_modules || s.compensation.is_some() {
                true if s.valve.is_some() => return Err(SimError::NotOnModules("valve")),
                true => Box::new(Looped::new(s, n, first_sp[0], first_load[0])?),
                false => machine(s, n, first_sp[0], first_load[0])?,
            },
            bounds: Bounds::new(s),
            sp,
            load,
        })
    }

    /// Takes the next samples, `first` and those that follow, into all rows of the block.
    pub(crate) fn advance(&mut self, block: &mut Block<'_>, first: usize) -> Result<(), SimError> {
        self.sp.fill(first, block.sp);
        self.load.fill(first, block.load);
        // The noise waits in the place of the process value that it is added to.
        self.noise.fill(first, block.pv);
        let end = first + block.t.len();
        for (samples, mode) in &self.stretches {
            let (from, to) = (samples.start.max(first), samples.end.min(end));
            if from < to {
                self.machine.advance(&mut block.part(from - first..to - first), from, *mode);
            }
        }
        self.bounds.check(block.t, block.op, block.pv)
    }
}

/// The run cut into stretches of one mode.
fn stretches(manual: &[Manual], h: f64, n: usize) -> Result<Vec<(Range<usize>, Mode)>, SimError> {
    let mut stretches = Vec::new();
    let mut done = 0;
    let mut last = f64::NEG_INFINITY;
    for &Manual { from, to, op } in manual {
        let number = from.is_finite() && to.is_finite() && op.is_none_or(f64::is_finite);
        if !number || from < last || to <= from {
            let what = format!("stretch from {from} s to {to} s; write ascending times that do not overlap");
            return Err(SimError::Signal { name: "manual", what });
        }
        last = to;
        let (begin, end) = (sample_at(from, h, n), sample_at(to, h, n));
        stretches.push((done..begin, Mode::Auto));
        stretches.push((begin..end, Mode::Manual(op)));
        done = end;
    }
    stretches.push((done..n, Mode::Auto));
    Ok(stretches)
}

/// Beyond these a loop has run away.
pub(crate) struct Bounds {
    op: f64,
    pv: f64,
}

impl Bounds {
    pub(crate) fn new(s: &Scenario) -> Self {
        let t = s.t_end.max(s.h);
        let mut asked = magnitude(&s.setpoint, t);
        if let Some(outer) = &s.outer {
            let asked_outside = asked + magnitude(&outer.noise, t);
            asked = outer.d
                + magnitude(&outer.load, t)
                + asked_outside * (outer.controller.k.abs() + 1.0 / outer.plant.reach(t));
        }
        asked += magnitude(&s.noise, t);
        let reach = s.plant.reach(t);
        let by_hand = s.manual.iter().filter_map(|stretch| stretch.op).fold(0.0, |a: f64, op| a.max(op.abs()));
        let width =
            s.d + s.friction.map_or(0.0, |friction| friction.parameters().1) + s.valve.map_or(0.0, |v| v.width());
        let fed = s.compensation.map_or(0.0, |compensated| compensated.settings.size);
        let effort = magnitude(&s.load, t) + width + fed + by_hand + asked * (s.controller.k.abs() + 1.0 / reach);
        Self { op: RUNAWAY * effort, pv: RUNAWAY * (asked + effort * reach) }
    }

    pub(crate) fn check(&self, t: &[f64], op: &[f64], pv: &[f64]) -> Result<(), SimError> {
        // Written so that what is no number counts as beyond.
        let within = |x: f64, bound: f64| x.abs() <= bound;
        // Counted, not asked one by one: a count is made in lanes.
        let all = |x: &[f64], bound: f64| x.iter().map(|x| u64::from(within(*x, bound))).sum::<u64>();
        if all(op, self.op) + all(pv, self.pv) == 2 * op.len() as u64 {
            return Ok(());
        }
        let beyond = |k: &usize| !within(op[*k], self.op) || !within(pv[*k], self.pv);
        let k = (0..op.len()).find(beyond).unwrap_or(0);
        let (signal, bound) = if within(op[k], self.op) { ("PV", self.pv) } else { ("OP", self.op) };
        Err(SimError::Unstable { signal, bound, t: t[k] })
    }
}

/// A process of any order.
pub(crate) trait Process: Send + Sync {
    /// Takes the input held from this sample to the next, gives the output at the next.
    fn update(&mut self, v: f64) -> f64;
}

/// Calls a function generic in the order of a plant.
macro_rules! by_order {
    ($order:expr, $function:ident($($argument:expr),*)) => {
        match $order {
            1 => $function::<1>($($argument),*),
            2 => $function::<2>($($argument),*),
            3 => $function::<3>($($argument),*),
            4 => $function::<4>($($argument),*),
            5 => $function::<5>($($argument),*),
            6 => $function::<6>($($argument),*),
            7 => $function::<7>($($argument),*),
            8 => $function::<8>($($argument),*),
            9 => $function::<9>($($argument),*),
            _ => $function::<{ $crate::plant::MAX_ORDER }>($($argument),*),
        }
    };
}
pub(crate) use by_order;

fn machine(s: &Scenario, n: usize, sp: f64, load: f64) -> Result<Box<dyn Machine>, SimError> {
    by_order!(s.plant.order(), machine_of_order(s, n, sp, load))
}

fn machine_of_order<const N: usize>(s: &Scenario, n: usize, sp: f64, load: f64) -> Result<Box<dyn Machine>, SimError> {
    let plant = Sampled::<N>::new(&s.plant, s.h)?;
    let (filter, pid, limits) = s.controller.blocks()?;
    let gap = Backlash::new(s.d)?;
    let outside = s.outer.as_ref().map(|outer| Outside::new(outer, s, n, sp)).transpose()?;
    let rest = rest(&s.plant, limits, outside.as_ref().map_or(sp, |outer| outer.pid_state.output), load)?;
    let mut state = State {
        y: rest.y,
        plant: plant.at_rest(rest.y, rest.v, n),
        filter: SecondOrderFilterState::default(),
        pid: PidState::default(),
        gap: BacklashState::at(rest.op),
    };
    pid.track(&mut state.pid, rest.y, rest.y, rest.op, s.h);
    let extras = Extras {
        pv_resolution: resolution("pv_resolution", s.pv_resolution)?,
        op_resolution: resolution("op_resolution", s.op_resolution)?,
        rate: s.rate.map(RateLimit::new).transpose()?.map(|rate| (rate, RateLimitState::at(rest.op))),
        friction: s.friction.map(|friction| (friction, FrictionState::at(rest.op))),
        valve: s.valve.map(|valve| valve.at_rest(rest.op, s.h)).transpose()?,
        bad: bad(s, n)?,
        last_y: rest.y,
        outside,
    };
    let blocks = Blocks { plant, filter, pid, gap, limits, h: s.h };
    Ok(Box::new(Single { blocks, state, extras: extras.any().then_some(extras) }))
}

struct Single<const N: usize> {
    blocks: Blocks<N>,
    state: State<N>,
    extras: Option<Extras>,
}

struct Blocks<const N: usize> {
    plant: Sampled<N>,
    filter: SecondOrderFilter<f64>,
    pid: Pid<f64>,
    gap: Backlash<f64>,
    limits: Saturation<f64>,
    h: f64,
}

#[derive(Clone)]
struct State<const N: usize> {
    /// Process value without noise at the coming sample.
    y: f64,
    plant: SampledState<N>,
    filter: SecondOrderFilterState<f64>,
    pid: PidState<f64>,
    gap: BacklashState<f64>,
}

/// Parts that most loops do not have.
struct Extras {
    pv_resolution: f64,
    op_resolution: f64,
    rate: Option<(RateLimit<f64>, RateLimitState<f64>)>,
    friction: Option<(Friction<f64>, FrictionState<f64>)>,
    valve: Option<Moving>,
    bad: Vec<Range<usize>>,
    /// The process value as it last was recorded.
    last_y: f64,
    outside: Option<Outside>,
}

/// The outer loop of a cascade.
struct Outside {
    noise: Source,
    load: Source,
    load_now: Vec<f64>,
    filter: SecondOrderFilter<f64>,
    filter_state: SecondOrderFilterState<f64>,
    pid: Pid<f64>,
    pid_state: PidState<f64>,
    gap: Backlash<f64>,
    gap_state: BacklashState<f64>,
    plant: Box<dyn Process>,
    y: f64,
}

impl<const N: usize> Machine for Single<N> {
    fn advance(&mut self, block: &mut Block<'_>, first: usize, mode: Mode) {
        let mut nothing = Extras::none();
        let (blocks, state) = (&self.blocks, &mut self.state);
        match (mode, &mut self.extras) {
            (Mode::Auto, None) => blocks.advance::<false, true>(state, &mut nothing, block, first, None),
            (Mode::Auto, Some(extras)) => blocks.advance::<false, false>(state, extras, block, first, None),
            (Mode::Manual(op), None) => blocks.advance::<true, true>(state, &mut nothing, block, first, op),
            (Mode::Manual(op), Some(extras)) => blocks.advance::<true, false>(state, extras, block, first, op),
        }
    }
}

impl<const N: usize> Blocks<N> {
    /// Takes the samples of the block, in manual with the output at `manual` or where it stands.
    fn advance<const MANUAL: bool, const PLAIN: bool>(
        &self,
        state: &mut State<N>,
        extras: &mut Extras,
        block: &mut Block<'_>,
        first: usize,
        manual: Option<f64>,
    ) {
        // A copy that nothing else can point to stays in registers.
        let mut s = state.clone();
        let h = self.h;
        if let (false, Some(outside)) = (PLAIN, &mut extras.outside) {
            // The setpoint given is the outer one; the inner one is written in its place.
            block.outer_sp.copy_from_slice(block.sp);
            outside.noise.fill(first, block.outer_pv);
            outside.load_now.resize(block.t.len(), 0.0);
            outside.load.fill(first, &mut outside.load_now);
        }
        let Block { t, sp, pv, op, position, load, flags, outer_sp, outer_pv, .. } = block;
        let n = t.len();
        assert!([sp.len(), pv.len(), op.len(), position.len(), load.len(), flags.len()] == [n; 6]);
        for k in 0..n {
            let mut y = s.y + pv[k];
            let mut mode = if MANUAL { NOT_AUTO } else { 0 };
            if !PLAIN {
                if extras.bad.iter().any(|rows| rows.contains(&(first + k))) {
                    mode |= BAD;
                    y = extras.last_y;
                }
                y = rounded(y, extras.pv_resolution);
                extras.last_y = y;
                if let Some(outside) = &mut extras.outside {
                    sp[k] = outside.before::<MANUAL>(outer_sp[k], &mut outer_pv[k], h);
                }
            }
            let yf = if PLAIN || mode & BAD == 0 { self.filter.update(&mut s.filter, y, h) } else { f64::NAN };
            let u = if MANUAL {
                let stood = s.pid.output;
                self.pid.track(&mut s.pid, sp[k], yf, manual.unwrap_or(stood), h)
            } else {
                self.pid.update(&mut s.pid, sp[k], yf, h)
            };
            let mut sent = u;
            let mut x = u;
            if !PLAIN {
                sent = rounded(u, extras.op_resolution);
                x = sent;
                if let Some((rate, state)) = &mut extras.rate {
                    x = rate.update(state, x, h);
                }
            }
            x = self.gap.update(&mut s.gap, x);
            if !PLAIN {
                if let Some((friction, state)) = &mut extras.friction {
                    x = friction.update(state, x);
                }
                if let Some(outside) = &mut extras.outside {
                    outside.after(k, s.y);
                }
            }
            let mut flow = x;
            if !PLAIN && let Some(valve) = &mut extras.valve {
                // Present position; the flow until the next sample follows from it.
                let stands = valve.position();
                flow = valve.update(x);
                x = stands;
            }
            s.y = self.plant.update(&mut s.plant, flow + load[k]);
            t[k] = (first + k) as f64 * h;
            pv[k] = y;
            op[k] = sent;
            position[k] = x;
            flags[k] = (mode | self.limits.reached(u)) as u8;
        }
        *state = s;
    }
}

impl Extras {
    fn none() -> Self {
        Self {
            pv_resolution: 0.0,
            op_resolution: 0.0,
            rate: None,
            friction: None,
            valve: None,
            bad: Vec::new(),
            last_y: 0.0,
            outside: None,
        }
    }

    fn any(&self) -> bool {
        self.pv_resolution > 0.0
            || self.op_resolution > 0.0
            || self.rate.is_some()
            || self.friction.is_some()
            || self.valve.is_some()
            || !self.bad.is_empty()
            || self.outside.is_some()
    }
}

impl Outside {
    fn new(outer: &Outer, s: &Scenario, n: usize, sp: f64) -> Result<Self, SimError> {
        let noise = source(s, "outer noise", &outer.noise, stream::OUTER_NOISE, n)?;
        let load = source(s, "outer load", &outer.load, stream::OUTER_LOAD, n)?;
        let (filter, pid, limits) = outer.controller.blocks()?;
        let mut first_load = [0.0];
        load.clone().fill(0, &mut first_load);
        let rest = rest(&outer.plant, limits, sp, first_load[0])?;
        let mut pid_state = PidState::default();
        pid.track(&mut pid_state, sp, sp, rest.op, s.h);
        Ok(Self {
            noise,
            load,
            load_now: Vec::new(),
            filter,
            filter_state: SecondOrderFilterState::default(),
            pid,
            pid_state,
            gap: Backlash::new(outer.d)?,
            gap_state: BacklashState::at(rest.op),
            plant: by_order!(outer.plant.order(), process(&outer.plant, s.h, &rest, n))?,
            y: rest.y,
        })
    }

    /// Step of the outer controller: takes its setpoint and, in `pv`, the noise, to which the process value is added;
    /// gives the inner setpoint.
    fn before<const MANUAL: bool>(&mut self, sp: f64, pv: &mut f64, h: f64) -> f64 {
        *pv += self.y;
        let yf = self.filter.update(&mut self.filter_state, *pv, h);
        match MANUAL {
            true => {
                let held = self.pid_state.output;
                self.pid.track(&mut self.pid_state, sp, yf, held, h)
            }
            false => self.pid.update(&mut self.pid_state, sp, yf, h),
        }
    }

    /// Takes the inner process value, which drives the outer process from here to the next sample.
    fn after(&mut self, k: usize, inner: f64) {
        let x = self.gap.update(&mut self.gap_state, inner);
        self.y = self.plant.update(x + self.load_now[k]);
    }
}

struct Alone<const N: usize> {
    plant: Sampled<N>,
    state: SampledState<N>,
}

impl<const N: usize> Process for Alone<N> {
    fn update(&mut self, v: f64) -> f64 {
        self.plant.update(&mut self.state, v)
    }
}

fn process<const N: usize>(plant: &Plant, h: f64, rest: &Rest, n: usize) -> Result<Box<dyn Process>, SimError> {
    let plant = Sampled::<N>::new(plant, h)?;
    let state = plant.at_rest(rest.y, rest.v, n);
    Ok(Box::new(Alone { plant, state }))
}

/// A plant at rest at the process value `y`; with the process value, and the input that holds it there.
pub(crate) fn process_at_rest(plant: &Plant, h: f64, y: f64) -> Result<(f64, f64, Box<dyn Process>), SimError> {
    let rest = rest(plant, Saturation::none(), y, 0.0)?;
    let process = by_order!(plant.order(), process(plant, h, &rest, usize::MAX))?;
    Ok((rest.y, rest.v, process))
}

/// Faults of a historian: times that are wrong, samples that are lost.
pub(crate) struct Recorder {
    jitter: f64,
    lost: f64,
    jitters: Integers,
    losses: Integers,
}

impl Recorder {
    pub(crate) fn new(s: &Scenario) -> Result<Self, SimError> {
        let integers = |stream: u64| Integers::seeded(s.seed.wrapping_add(stream << 40));
        Ok(Self {
            jitter: require("jitter", s.jitter, (0.0..=s.h / 2.0).contains(&s.jitter), "0 s or greater, at most h/2")?,
            lost: require("lost", s.lost, (0.0..1.0).contains(&s.lost), "0 or greater, below 1")?,
            jitters: integers(stream::JITTER),
            losses: integers(stream::LOST),
        })
    }

    /// Moves the samples that are recorded to the front of the block; gives how many there are.
    pub(crate) fn record(&mut self, block: &mut Block<'_>) -> usize {
        if self.jitter > 0.0 {
            self.jitters.add_uniform(self.jitter, block.t);
        }
        if self.lost == 0.0 {
            return block.t.len();
        }
        let kept: Vec<usize> =
            (0..block.t.len()).filter(|_| (self.losses.uniform() + 1.0) / 2.0 >= self.lost).collect();
        /// Moves the kept entries of a column to its front.
        fn gather<T: Copy>(column: &mut [T], kept: &[usize]) {
            if !column.is_empty() {
                kept.iter().enumerate().for_each(|(to, from)| column[to] = column[*from]);
            }
        }
        let Block { t, sp, pv, op, position, load, flags, outer_sp, outer_pv, u_ff, standing, over, error } = block;
        for column in [t, sp, pv, op, position, load, outer_sp, outer_pv, u_ff, standing, over, error] {
            gather(column, &kept);
        }
        gather(flags, &kept);
        kept.len()
    }
}
