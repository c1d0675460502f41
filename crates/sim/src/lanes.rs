//! Many loops of one structure side by side, in the lanes of the processor.
//!
//! One step of [`LANES`] loops is one pass over arrays of that length, which the compiler turns into vector instructions of
//! whatever width the processor has. Every lane does the operations of the blocks in the blocks' order and nothing is fused,
//! so that a loop has the same bits here, alone, and on every instruction set.

use crate::engine::{Bounds, samples};
use crate::machine::{rest, source, stream};
use crate::plant::{Sampled, delay};
use crate::random::times;
use crate::run::Watcher;
use crate::scenario::{Block, CHUNK, Columns, Seen};
use crate::signal::Source;
use crate::{Piece, Scenario, SimError, engine};
use glapp_core::{Backlash, Detector, NoiseState, PidState, Saturation};
use glapp_lanes::{Instructions, NullaryFnOnce};

/// Loops in a group.
pub(crate) const LANES: usize = 16;
/// Fewer loops are faster one by one.
const WORTHWHILE: usize = 4;
/// Steps between turning columns into rows and back.
const ROWS: usize = 64;

type Lane = [f64; LANES];

/// Indices of scenarios that are best run together, by [`run_together`] or [`watch_together`].
pub fn groups(scenarios: &[&Scenario]) -> Vec<Vec<usize>> {
    let mut alike = std::collections::BTreeMap::<_, Vec<usize>>::new();
    let mut groups = Vec::new();
    for (i, scenario) in scenarios.iter().enumerate() {
        match structure(scenario) {
            Some(structure) => alike.entry(structure).or_default().push(i),
            None => groups.push(vec![i]),
        }
    }
    for group in alike.values().flat_map(|all| all.chunks(LANES)) {
        match group.len() {
            WORTHWHILE.. => groups.push(group.to_vec()),
            _ => groups.extend(group.iter().map(|i| vec![*i])),
        }
    }
    groups
}

/// (order, whole steps of dead time, samples, derivative action): what loops in lanes must have in common.
type Structure = (usize, usize, usize, bool);

/// None for a loop with elements that lanes do not have.
fn structure(s: &Scenario) -> Option<Structure> {
    let common = s.friction.is_none()
        && s.valve.is_none()
        && s.rate.is_none()
        && s.pv_resolution == 0.0
        && s.op_resolution == 0.0
        && s.manual.is_empty()
        && s.bad.is_empty()
        && s.compensation.is_none()
        && s.outer.is_none()
        && matches!(s.noise[..], [] | [Piece::Uniform { .. }]);
    let n = samples(s.h, s.t_end).ok()?;
    common.then(|| (s.plant.order(), delay(s.plant.dead_time(), s.h).0, n, s.controller.td > 0.0))
}

/// Runs scenarios, in lanes where all are of one structure as [`groups`] puts them; each into its own columns, as
/// [`Scenario::run_into`] does.
pub fn run_together(
    scenarios: &[&Scenario],
    blocks: &mut [Block<'_>],
    instructions: Instructions,
) -> Vec<Result<usize, SimError>> {
    let Some(structure) = shared(scenarios) else {
        return scenarios.iter().zip(blocks).map(|(s, block)| s.run_into(block)).collect();
    };
    let record = |(s, block): (&&Scenario, &mut Block<'_>)| Ok(engine::Recorder::new(s)?.record(block));
    match Group::new(scenarios, structure, instructions) {
        Err(error) => vec![Err(error); scenarios.len()],
        Ok(mut group) => {
            for first in (0..structure.2).step_by(CHUNK) {
                let rows = first..(first + CHUNK).min(structure.2);
                let mut parts: Vec<Block<'_>> = blocks.iter_mut().map(|block| block.part(rows.clone())).collect();
                group.advance(&mut parts, first);
            }
            let recorded = scenarios.iter().zip(blocks).map(record);
            recorded.zip(group.faults).map(|(recorded, fault)| fault.map_or(recorded, Err)).collect()
        }
    }
}

/// Runs scenarios, in lanes where all are of one structure, and keeps the detector's results of each, as
/// [`Scenario::watch`] does.
pub fn watch_together(
    scenarios: &[(&Scenario, &Detector<f64>)],
    instructions: Instructions,
) -> Vec<Result<Seen, SimError>> {
    let alone: Vec<&Scenario> = scenarios.iter().map(|(s, _)| *s).collect();
    let Some(structure) = shared(&alone) else {
        return scenarios.iter().map(|(s, detector)| s.watch(detector)).collect();
    };
    let watchers: Result<Vec<Watcher<'_>>, SimError> = scenarios.iter().map(|(s, d)| Watcher::new(s, d)).collect();
    let (mut group, mut watchers) = match (Group::new(&alone, structure, instructions), watchers) {
        (Ok(group), Ok(watchers)) => (group, watchers),
        (Err(error), _) | (_, Err(error)) => return vec![Err(error); scenarios.len()],
    };
    let n = structure.2;
    let mut columns: Vec<Columns> = alone.iter().map(|s| Columns::of_length(CHUNK.min(n), s)).collect();
    for first in (0..n).step_by(CHUNK) {
        let mut blocks: Vec<Block<'_>> = columns.iter_mut().map(Columns::block).collect();
        let mut parts: Vec<Block<'_>> = blocks.iter_mut().map(|block| block.part(0..CHUNK.min(n - first))).collect();
        group.advance(&mut parts, first);
        for ((watcher, block), fault) in watchers.iter_mut().zip(&mut parts).zip(&group.faults) {
            if fault.is_none() {
                watcher.see(block);
            }
        }
    }
    watchers.iter().zip(group.faults).map(|(watcher, fault)| fault.map_or(Ok(watcher.seen()), Err)).collect()
}

/// The structure that all scenarios share, where they do.
fn shared(scenarios: &[&Scenario]) -> Option<Structure> {
    let first = structure(scenarios.first()?)?;
    let alike = scenarios.len() <= LANES && scenarios.iter().all(|s| structure(s) == Some(first));
    (scenarios.len() >= WORTHWHILE && alike).then_some(first)
}

/// Loops of one structure under way.
struct Group {
    signals: Vec<(Source, Source)>,
    bounds: Vec<Bounds>,
    limits: Vec<Saturation<f64>>,
    h: Vec<f64>,
    machine: Box<dyn Machine>,
    instructions: Instructions,
    /// Why a loop is no longer to be believed.
    faults: Vec<Option<SimError>>,
}

impl Group {
    fn new(scenarios: &[&Scenario], structure: Structure, instructions: Instructions) -> Result<Self, SimError> {
        let n = structure.2;
        let signals = |s: &&Scenario| {
            let sp = source(s, "setpoint", &s.setpoint, stream::SETPOINT, n)?;
            Ok((sp, source(s, "load", &s.load, stream::LOAD, n)?))
        };
        let signals: Vec<(Source, Source)> = scenarios.iter().map(signals).collect::<Result<_, SimError>>()?;
        let machine = match structure.3 {
            true => engine::by_order!(structure.0, machine_with_derivative(scenarios, &signals, structure)),
            false => engine::by_order!(structure.0, machine_without(scenarios, &signals, structure)),
        }?;
        let limits = |s: &&Scenario| Ok(s.controller.blocks()?.2);
        Ok(Self {
            bounds: scenarios.iter().map(|s| Bounds::new(s)).collect(),
            limits: scenarios.iter().map(limits).collect::<Result<_, SimError>>()?,
            h: scenarios.iter().map(|s| s.h).collect(),
            faults: vec![None; scenarios.len()],
            machine,
            signals,
            instructions,
        })
    }

    /// Takes the next samples, `first` and those that follow, into all rows of the blocks, one a loop.
    fn advance(&mut self, blocks: &mut [Block<'_>], first: usize) {
        let end = first + blocks[0].t.len();
        let mut constant = Some([[0.0; LANES]; 2]);
        for (lane, ((block, (sp, load)), h)) in blocks.iter_mut().zip(&mut self.signals).zip(&self.h).enumerate() {
            constant = match (constant, sp.constant(first, end), load.constant(first, end)) {
                (Some([mut all_sp, mut all_load]), Some(one_sp), Some(one_load)) => {
                    block.sp.fill(one_sp);
                    block.load.fill(one_load);
                    (all_sp[lane], all_load[lane]) = (one_sp, one_load);
                    Some([all_sp, all_load])
                }
                _ => {
                    sp.fill(first, block.sp);
                    load.fill(first, block.load);
                    None
                }
            };
            // 32-bit integers become floats in lanes, on every instruction set; there are at most 10⁸ samples.
            (first as i32..).zip(block.t.iter_mut()).for_each(|(k, t)| *t = f64::from(k) * h);
        }
        self.machine.advance(blocks, constant, self.instructions);
        for (i, block) in blocks.iter_mut().enumerate() {
            let limits = self.limits[i];
            if limits == Saturation::none() {
                block.flags.fill(0);
            } else {
                for (flag, u) in block.flags.iter_mut().zip(block.op.iter()) {
                    *flag = limits.reached(*u) as u8;
                }
            }
            if self.faults[i].is_none() {
                self.faults[i] = self.bounds[i].check(block.t, block.op, block.pv).err();
            }
        }
    }
}

trait Machine {
    /// `constant`: setpoints and loads, where none moves in the whole of the blocks.
    fn advance(&mut self, blocks: &mut [Block<'_>], constant: Option<[Lane; 2]>, instructions: Instructions);
}

/// The blocks' parameters, as they enter their equations.
struct Parameters<const N: usize> {
    /// Φ by columns, Γ₀, Γ₁.
    phi: [[Lane; N]; N],
    gamma0: [Lane; N],
    gamma1: [Lane; N],
    amplitude: Lane,
    /// h/(Tf + h)
    share: Lane,
    k: Lane,
    b: Lane,
    /// K·h/Ti
    integration: Lane,
    /// K·Td/h
    derivation: Lane,
    /// h/(Ti + h)
    tracking: Lane,
    low: Lane,
    high: Lane,
    half_gap: Lane,
}

struct State<const N: usize> {
    /// States of the plants; x\[0\] is the process value without noise at the coming sample.
    x: [Lane; N],
    w_old: Lane,
    integer: [u64; LANES],
    y1: Lane,
    y2: Lane,
    /// The last filtered value, where there is derivative action.
    y_old: Lane,
    integral: Lane,
    position: Lane,
}

struct Side<const N: usize, const DERIVATIVE: bool> {
    parameters: Parameters<N>,
    state: State<N>,
    /// The inputs of the last m steps, the oldest at `at`.
    ring: Vec<Lane>,
    at: usize,
    rows: Box<Rows>,
}

/// Signals by rows, a row a sample.
struct Rows {
    sp: [Lane; ROWS],
    load: [Lane; ROWS],
    pv: [Lane; ROWS],
    op: [Lane; ROWS],
    position: [Lane; ROWS],
}

fn machine_with_derivative<const N: usize>(
    scenarios: &[&Scenario],
    signals: &[(Source, Source)],
    structure: Structure,
) -> Result<Box<dyn Machine>, SimError> {
    Ok(Box::new(Side::<N, true>::new(scenarios, signals, structure)?))
}

fn machine_without<const N: usize>(
    scenarios: &[&Scenario],
    signals: &[(Source, Source)],
    structure: Structure,
) -> Result<Box<dyn Machine>, SimError> {
    Ok(Box::new(Side::<N, false>::new(scenarios, signals, structure)?))
}

impl<const N: usize, const DERIVATIVE: bool> Side<N, DERIVATIVE> {
    fn new(scenarios: &[&Scenario], signals: &[(Source, Source)], structure: Structure) -> Result<Self, SimError> {
        let (nothing, none) = ([0.0; LANES], [[0.0; LANES]; N]);
        let mut p = Parameters {
            phi: [none; N],
            gamma0: none,
            gamma1: none,
            amplitude: nothing,
            share: nothing,
            k: nothing,
            b: nothing,
            integration: nothing,
            derivation: nothing,
            tracking: nothing,
            low: nothing,
            high: nothing,
            half_gap: nothing,
        };
        let mut s = State {
            x: none,
            w_old: nothing,
            integer: [1; LANES],
            y1: nothing,
            y2: nothing,
            y_old: nothing,
            integral: nothing,
            position: nothing,
        };
        let (delay, n) = (structure.1, structure.2);
        let mut ring = vec![nothing; delay.min(n)];
        // Batches mostly have one plant; to sample it takes as long as thousands of steps.
        let mut sampled: Option<(&Scenario, Sampled<N>)> = None;
        for lane in 0..LANES {
            // Lanes to spare repeat the last loop.
            let i = lane.min(scenarios.len() - 1);
            let scenario = scenarios[i];
            let (h, c) = (scenario.h, &scenario.controller);
            let plant = match sampled {
                Some((last, plant)) if last.plant == scenario.plant && last.h == h => plant,
                _ => Sampled::<N>::new(&scenario.plant, h)?,
            };
            let (_, pid, limits) = c.blocks()?;
            Backlash::new(scenario.d)?;
            let (mut sp, mut load) = ([0.0], [0.0]);
            signals[i].0.clone().fill(0, &mut sp);
            signals[i].1.clone().fill(0, &mut load);
            let rest = rest(&scenario.plant, limits, sp[0], load[0])?;
            let mut pid_state = PidState::default();
            pid.track(&mut pid_state, rest.y, rest.y, rest.op, h);
            let (phi, gamma0, gamma1) = plant.matrices();
            for i in 0..N {
                (0..N).for_each(|j| p.phi[j][i][lane] = phi[j][i]);
                p.gamma0[i][lane] = gamma0[i];
                p.gamma1[i][lane] = gamma1[i];
                s.x[i][lane] = plant.at_rest(rest.y, rest.v, 0).x()[i];
            }
            if let [Piece::Uniform { amplitude }] = scenario.noise[..] {
                p.amplitude[lane] = amplitude;
            }
            p.share[lane] = h / (c.tf + h);
            p.k[lane] = c.k;
            p.b[lane] = c.b;
            p.integration[lane] = c.k * h / c.ti;
            p.derivation[lane] = c.k * c.td / h;
            p.tracking[lane] = h / (c.ti + h);
            p.low[lane] = limits.low;
            p.high[lane] = limits.high;
            p.half_gap[lane] = scenario.d / 2.0;
            s.w_old[lane] = rest.v;
            ring.iter_mut().for_each(|row| row[lane] = rest.v);
            s.integer[lane] = NoiseState::seeded(scenario.seed).integer as u64;
            // The filter begins at the first value.
            let first = rest.y + p.amplitude[lane] * centred(times(s.integer[lane], MULTIPLIER));
            (s.y1[lane], s.y2[lane]) = (first, first);
            s.y_old[lane] = pid_state.y;
            s.integral[lane] = pid_state.integral;
            s.position[lane] = rest.op;
            sampled = Some((scenario, plant));
        }
        let empty = [nothing; ROWS];
        let rows = Box::new(Rows { sp: empty, load: empty, pv: empty, op: empty, position: empty });
        Ok(Self { parameters: p, state: s, ring, at: 0, rows })
    }
}

impl<const N: usize, const DERIVATIVE: bool> Machine for Side<N, DERIVATIVE> {
    fn advance(&mut self, blocks: &mut [Block<'_>], constant: Option<[Lane; 2]>, instructions: Instructions) {
        if let Some([sp, load]) = constant {
            self.rows.sp.fill(sp);
            self.rows.load.fill(load);
        }
        let n = blocks[0].t.len();
        for first in (0..n).step_by(ROWS) {
            let length = ROWS.min(n - first);
            if constant.is_none() {
                for (lane, block) in blocks.iter().enumerate() {
                    to_rows(&mut self.rows.sp, lane, &block.sp[first..first + length]);
                    to_rows(&mut self.rows.load, lane, &block.load[first..first + length]);
                }
            }
            let Self { parameters, state, ring, at, rows } = self;
            instructions.run(Steps::<N, DERIVATIVE> { parameters, state, ring, at, rows, length });
            for (lane, block) in blocks.iter_mut().enumerate() {
                from_rows(&self.rows.pv, lane, &mut block.pv[first..first + length]);
                from_rows(&self.rows.op, lane, &mut block.op[first..first + length]);
                from_rows(&self.rows.position, lane, &mut block.position[first..first + length]);
            }
        }
    }
}

fn to_rows(rows: &mut [Lane; ROWS], lane: usize, column: &[f64]) {
    rows.iter_mut().zip(column).for_each(|(row, x)| row[lane] = *x);
}

fn from_rows(rows: &[Lane; ROWS], lane: usize, column: &mut [f64]) {
    rows.iter().zip(column).for_each(|(row, x)| *x = row[lane]);
}

/// Some steps of all lanes.
struct Steps<'a, const N: usize, const DERIVATIVE: bool> {
    parameters: &'a Parameters<N>,
    state: &'a mut State<N>,
    ring: &'a mut [Lane],
    at: &'a mut usize,
    rows: &'a mut Rows,
    length: usize,
}

impl<const N: usize, const DERIVATIVE: bool> NullaryFnOnce for Steps<'_, N, DERIVATIVE> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { parameters, state, ring, at, rows, length } = self;
        let mut delayed = [0.0; LANES];
        for row in 0..length {
            if let Some(oldest) = ring.get(*at) {
                delayed = *oldest;
            }
            let mut v = [0.0; LANES];
            step::<N, DERIVATIVE>(parameters, state, rows, row, &mut v);
            if let Some(slot) = ring.get_mut(*at) {
                *slot = v;
                v = delayed;
                *at = if *at + 1 == ring.len() { 0 } else { *at + 1 };
            }
            move_plants(parameters, state, &v);
        }
    }
}

/// Computes the inputs of the processes from the process values, in the order of the blocks.
#[inline(always)]
fn step<const N: usize, const DERIVATIVE: bool>(
    p: &Parameters<N>,
    s: &mut State<N>,
    rows: &mut Rows,
    row: usize,
    v: &mut Lane,
) {
    let (sp, load) = (&rows.sp[row], &rows.load[row]);
    let (pv, op, position) = (&mut rows.pv[row], &mut rows.op[row], &mut rows.position[row]);
    for l in 0..LANES {
        s.integer[l] = times_in_lanes(s.integer[l]);
        let y = s.x[0][l] + p.amplitude[l] * centred(s.integer[l]);
        s.y1[l] += (y - s.y1[l]) * p.share[l];
        s.y2[l] += (s.y1[l] - s.y2[l]) * p.share[l];
        let yf = s.y2[l];
        let mut u = p.k[l] * (p.b[l] * sp[l] - yf);
        if DERIVATIVE {
            u -= p.derivation[l] * (yf - s.y_old[l]);
            s.y_old[l] = yf;
        }
        let i = s.integral[l] + p.integration[l] * (sp[l] - yf);
        u += i;
        let kept = least(greatest(u, p.low[l]), p.high[l]);
        s.integral[l] = i + (kept - u) * p.tracking[l];
        let x = least(greatest(s.position[l], kept - p.half_gap[l]), kept + p.half_gap[l]);
        s.position[l] = x;
        pv[l] = y;
        op[l] = kept;
        position[l] = x;
        v[l] = x + load[l];
    }
}

#[inline(always)]
#[allow(clippy::needless_range_loop)] // the same lane, or entry, of several arrays
fn move_plants<const N: usize>(p: &Parameters<N>, s: &mut State<N>, w: &Lane) {
    for l in 0..LANES {
        let mut next = [0.0; N];
        for j in 0..N {
            for i in 0..N {
                next[i] += p.phi[j][i][l] * s.x[j][l];
            }
        }
        for i in 0..N {
            next[i] += p.gamma1[i][l] * s.w_old[l];
            next[i] += p.gamma0[i][l] * w[l];
            s.x[i][l] = next[i];
        }
        s.w_old[l] = w[l];
    }
}

/// The greater as the blocks compare.
#[inline(always)]
fn greatest(a: f64, b: f64) -> f64 {
    if b > a { b } else { a }
}

#[inline(always)]
fn least(a: f64, b: f64) -> f64 {
    if b < a { b } else { a }
}

const MULTIPLIER: u64 = 48_271;
const MODULUS: u64 = 2_147_483_647;

/// The next integer of the generator, without a comparison of 64-bit integers, which SSE2 lacks.
#[inline(always)]
fn times_in_lanes(s: u64) -> u64 {
    let p = (s & 0xFFFF_FFFF) * MULTIPLIER;
    let less = ((p & MODULUS) + (p >> 31)).wrapping_sub(MODULUS);
    less.wrapping_add(MODULUS & 0_u64.wrapping_sub(less >> 63))
}

/// The number between −1 and 1 that belongs to an integer; made into a float by its bits, which every width can.
#[inline(always)]
fn centred(integer: u64) -> f64 {
    const TWO_52: f64 = 4_503_599_627_370_496.0;
    let x = f64::from_bits(integer | TWO_52.to_bits()) - TWO_52;
    (x / MODULUS as f64 - 0.5) * 2.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random;
    use crate::{Controller, Plant};
    use glapp_core::{MedianMean, SafetyNet, SecondOrderFilter, Width};

    #[test]
    fn numbers_are_those_of_the_generator() {
        let mut s = 1;
        for _ in 0..100_000 {
            assert_eq!(times_in_lanes(s), times(s, MULTIPLIER));
            s = times(s, MULTIPLIER);
            assert_eq!(centred(s), random::centred(s));
        }
        assert_eq!(times_in_lanes(MODULUS - 1), times(MODULUS - 1, MULTIPLIER));
    }

    /// Loops of one structure that have nothing else in common.
    fn alike(name: &str, count: usize, td: f64) -> Vec<Scenario> {
        let one = |i: usize| {
            let x = i as f64;
            let limits = (i % 3 == 1).then_some((-0.4, 0.9));
            let controller =
                Controller { k: 0.2 + 0.01 * x, ti: 3.0 + 0.2 * x, td, b: 0.1 * (x % 4.0), tf: 0.03 * x, limits };
            let load = match i % 3 {
                0 => Piece::Steps(vec![(0.0, 0.1), (20.0 + x, 0.3)]),
                1 => Piece::Walk { rate: 0.01 },
                _ => Piece::Sine { amplitude: 0.1, period: 20.0, t: 3.0 },
            };
            Scenario {
                d: 0.01 * x,
                noise: if i.is_multiple_of(4) { vec![] } else { vec![Piece::Uniform { amplitude: 0.005 }] },
                setpoint: vec![Piece::Steps(vec![(1.0, 0.5)])],
                load: vec![load],
                lost: if i.is_multiple_of(5) { 0.1 } else { 0.0 },
                seed: i as u64,
                ..Scenario::new(Plant::named(name).unwrap(), controller, 0.05, 77.0)
            }
        };
        (0..count).map(one).collect()
    }

    #[test]
    fn same_bits_as_alone_on_every_instruction_set() {
        for (name, count, td) in
            [("P2", 16, 0.0), ("P2", 5, 0.4), ("P1", 16, 0.0), ("P3", 4, 0.1), ("P4", 7, 0.0), ("P7", 9, 0.5)]
        {
            let scenarios = alike(name, count, td);
            let refs: Vec<&Scenario> = scenarios.iter().collect();
            assert_eq!(groups(&refs).len(), 1, "{name}");
            let expected: Vec<Columns> = scenarios.iter().map(|s| s.run().unwrap()).collect();
            for instructions in Instructions::available() {
                let n = scenarios[0].samples().unwrap();
                let mut columns = vec![Columns::of_length(n, &scenarios[0]); count];
                let mut blocks: Vec<Block<'_>> = columns.iter_mut().map(Columns::block).collect();
                let kept = run_together(&refs, &mut blocks, instructions);
                for ((columns, kept), expected) in columns.iter_mut().zip(kept).zip(&expected) {
                    columns.shorten(kept.unwrap());
                    assert!(columns == expected, "{name} {}", instructions.name());
                }
            }
        }
    }

    #[test]
    fn watched_together_as_alone() {
        let scenarios = alike("P3", 13, 0.0);
        let detector = Detector::new(
            SecondOrderFilter::new(0.1).unwrap(),
            Width::new(0.3, 3.0, Some(0.0), 0.0, Some(1.0)).unwrap(),
            SafetyNet::new(None).unwrap(),
            MedianMean::new(9).unwrap(),
            0.15,
            None,
        )
        .unwrap();
        let pairs: Vec<_> = scenarios.iter().map(|s| (s, &detector)).collect();
        for instructions in Instructions::available() {
            let together = watch_together(&pairs, instructions);
            assert!(together.iter().zip(&pairs).all(|(seen, (s, detector))| *seen == s.watch(detector)));
        }
    }

    #[test]
    fn a_loop_that_runs_away_leaves_the_others_alone() {
        let mut scenarios = alike("P2", 16, 0.0);
        scenarios[6].controller.k = 60.0;
        let refs: Vec<&Scenario> = scenarios.iter().collect();
        let mut columns = vec![Columns::of_length(1541, &scenarios[0]); 16];
        let mut blocks: Vec<Block<'_>> = columns.iter_mut().map(Columns::block).collect();
        let results = run_together(&refs, &mut blocks, Instructions::Baseline);
        assert_eq!(results[6], scenarios[6].run().map(|_| 0));
        assert!(matches!(results[6], Err(SimError::Unstable { .. })));
        assert!((0..16).all(|i| i == 6 || results[i].is_ok()));
        assert_eq!(columns[7], scenarios[7].run().unwrap());
    }

    #[test]
    fn what_lanes_cannot_do_is_done_alone() {
        let mut scenarios = alike("P2", 20, 0.0);
        scenarios[3].op_resolution = 0.1;
        scenarios[5].t_end = 50.0;
        let refs: Vec<&Scenario> = scenarios.iter().collect();
        let groups = groups(&refs);
        let sizes: Vec<usize> = groups.iter().map(Vec::len).collect();
        assert_eq!(sizes.iter().sum::<usize>(), 20);
        assert!(sizes.contains(&16) && sizes.iter().filter(|n| **n == 1).count() == 4);
    }
}
