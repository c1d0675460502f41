//! A scenario as a loop of the modules that ship.

use crate::error::require;
use crate::machine::{Machine, Mode, bad, resolution, rest, source, stream};
use crate::scenario::{Block, Compensated};
use crate::signal::{Source, sample_at};
use crate::{Controller, Graph, GraphError, Module, Outer, Plant, Scenario, SimError};
use glapp_core::modules;
use glapp_core::status::{BAD, NOT_AUTO};
use glapp_core::{Model, Saturation};
use std::ops::Range;

/// A scenario that has built its [`Graph`], under way.
pub(crate) struct Looped {
    graph: Graph,
    at: Numbers,
    h: f64,
    limits: Saturation<f64>,
    bad: Vec<Range<usize>>,
    /// The first sample at which compensation is enabled.
    begin: usize,
    /// Noise and load of the outer loop of a cascade.
    outside: Option<(Source, Source)>,
    outer_load: Vec<f64>,
    /// The process value as it last was recorded.
    last_y: f64,
}

/// Places in the graph of the modules that are fed, set or recorded.
struct Numbers {
    sp: usize,
    load: usize,
    noise: usize,
    pid: usize,
    pv: usize,
    /// Nodes of the signal sent to the valve, and of the valve.
    op: usize,
    position: usize,
    watch: Option<usize>,
    /// Node that hands u_FF to the controller, and the signals of a controller that is not ours.
    u_ff: Option<usize>,
    flags: Option<usize>,
    /// Setpoint, load, noise and process value of the outer loop.
    outer: Option<[usize; 4]>,
}

impl Looped {
    /// A loop at rest at the first setpoint `sp` and the first load; `n` samples in all.
    pub(crate) fn new(s: &Scenario, n: usize, sp: f64, load: f64) -> Result<Self, SimError> {
        let signals = |outer: &Outer| {
            let noise = source(s, "outer noise", &outer.noise, stream::OUTER_NOISE, n)?;
            Ok::<_, SimError>((noise, source(s, "outer load", &outer.load, stream::OUTER_LOAD, n)?))
        };
        let outside = s.outer.as_ref().map(signals).transpose()?;
        let mut outer_load = [0.0];
        if let Some((_, load)) = &outside {
            load.clone().fill(0, &mut outer_load);
        }
        let (graph, at, last_y) = build(s, n, sp, [load, outer_load[0]])?;
        let begin = match &s.compensation {
            Some(given) => sample_at(require("compensation.begin", given.begin, true, "a number")?, s.h, n),
            None => n,
        };
        Ok(Self {
            graph,
            at,
            h: s.h,
            limits: limits(&s.controller)?,
            bad: bad(s, n)?,
            begin,
            outside,
            outer_load: Vec::new(),
            last_y,
        })
    }
}

impl Machine for Looped {
    fn advance(&mut self, block: &mut Block<'_>, first: usize, mode: Mode) {
        let Self { graph, at, .. } = self;
        let (by_hand, to) = match mode {
            Mode::Auto => (0, modules::Mode::External),
            Mode::Manual(op) => {
                if let Some(op) = op {
                    graph.command(at.pid, "manual", op);
                }
                (NOT_AUTO, modules::Mode::Manual)
            }
        };
        graph.command(at.pid, "mode", f64::from(to as u8));
        if let Some((noise, load)) = &mut self.outside {
            // The setpoint given is the outer one; the inner one is written in its place.
            block.outer_sp.copy_from_slice(block.sp);
            noise.fill(first, block.outer_pv);
            self.outer_load.resize(block.t.len(), 0.0);
            load.fill(first, &mut self.outer_load);
        }
        for k in 0..block.t.len() {
            let is_bad = self.bad.iter().any(|rows| rows.contains(&(first + k)));
            graph.feed(at.load, block.load[k]);
            graph.feed(at.noise, if is_bad { f64::NAN } else { block.pv[k] });
            match at.outer {
                None => graph.feed(at.sp, block.sp[k]),
                Some([sp, load, noise, _]) => {
                    graph.feed(sp, block.outer_sp[k]);
                    graph.feed(load, self.outer_load[k]);
                    graph.feed(noise, block.outer_pv[k]);
                }
            }
            if let (Some(watch), true) = (at.watch, first + k == self.begin) {
                graph.command(watch, "compensate", 1.0);
            }
            if let Some(flags) = at.flags {
                graph.feed(flags, f64::from(if is_bad { NOT_AUTO } else { by_hand }));
            }
            graph.scan(self.h);
            if !is_bad {
                self.last_y = graph.out(at.pv);
            }
            block.t[k] = (first + k) as f64 * self.h;
            block.pv[k] = self.last_y;
            block.op[k] = graph.out(at.op);
            block.position[k] = graph.out(at.position);
            block.flags[k] = (by_hand | if is_bad { BAD } else { 0 } | self.limits.reached(graph.out(at.pid))) as u8;
            if let Some([.., pv]) = at.outer {
                block.sp[k] = graph.out(at.sp);
                block.outer_pv[k] = graph.out(pv);
            }
            if let (Some(watch), Some(u_ff)) = (at.watch, at.u_ff) {
                block.u_ff[k] = graph.out(u_ff);
                block.standing[k] = graph.read(watch, "standing");
                block.over[k] = graph.read(watch, "over");
                block.error[k] = graph.read(watch, "error");
            }
        }
    }
}

/// Modules, and wires between them.
#[derive(Default)]
struct Parts {
    modules: Vec<(&'static str, Module)>,
    wires: Vec<String>,
}

impl Parts {
    fn add(&mut self, name: &'static str, kind: &str, parameters: &[(&str, f64)]) -> Result<(), GraphError> {
        self.modules.push((name, Module::new(kind, parameters)?));
        Ok(())
    }

    fn wire(&mut self, stops: &[&str]) {
        self.wires.push(stops.join(" -> "));
    }
}

/// The loop of a scenario at rest at the setpoint `sp` under its loads, that of the outer loop too; with where its modules
/// are, and its process value.
fn build(s: &Scenario, n: usize, sp: f64, loads: [f64; 2]) -> Result<(Graph, Numbers, f64), SimError> {
    // A signal that enters a dead time longer than the run never leaves it.
    let seen = |plant: &Plant| plant.clone().within(s.h * n as f64);
    let mut parts = Parts::default();
    let (mut first_sp, mut sp_from) = (sp, "sp");
    for input in ["sp", "load", "noise"].iter().chain(s.outer.iter().flat_map(|_| &["outer_load", "outer_noise"])) {
        parts.add(input, "Input", &[])?;
    }
    if let Some(outer) = &s.outer {
        let rest = rest(&outer.plant, limits(&outer.controller)?, sp, loads[1])?;
        (first_sp, sp_from) = (rest.op, "outer");
        parts.add("outer", "Pid", &controller(&outer.controller, rest.y, rest.op)?)?;
        parts.add("outer_gap", "Backlash", &[("d", outer.d), ("start", rest.op)])?;
        parts.modules.push(("outer_plant", Module::plant(seen(&outer.plant), &[("start", rest.y)])?));
        parts.add("outer_pv", "Sum", &[])?;
        parts.wire(&["plant", "outer_gap", "outer_plant", "outer_pv", "outer.pv"]);
        parts.wire(&["sp", "outer.sp"]);
        parts.wire(&["outer_load", "outer_plant.load"]);
        parts.wire(&["outer_noise", "outer_pv.plus"]);
    }
    let rest = rest(&s.plant, limits(&s.controller)?, first_sp, loads[0])?;
    let start = ("start", rest.op);
    parts.add("pid", "Pid", &controller(&s.controller, rest.y, rest.op)?)?;
    parts.modules.push(("plant", Module::plant(seen(&s.plant), &[("start", rest.y)])?));
    parts.wire(&[sp_from, "pid.sp"]);
    parts.wire(&["load", "plant.load"]);

    let mut valve = vec!["pid"];
    if resolution("op_resolution", s.op_resolution)? > 0.0 {
        parts.add("op_steps", "Resolution", &[("step", s.op_resolution)])?;
        valve.push("op_steps");
    }
    let op = valve[valve.len() - 1];
    if let Some(rate) = s.rate {
        // A valve tells nobody that it is slow.
        parts.add("rate", "RateLimit", &[("rate", rate), ("reports", 0.0), start])?;
        valve.push("rate");
    }
    parts.add("gap", "Backlash", &[("d", s.d), start])?;
    valve.push("gap");
    if let Some(friction) = &s.friction {
        let (model, stick, jump) = friction.parameters();
        let model = if model == Model::Kano { 1.0 } else { 2.0 };
        parts.add("friction", "Friction", &[("s", stick), ("j", jump), ("model", model), start])?;
        valve.push("friction");
    }
    let position = valve[valve.len() - 1];
    valve.push("plant.in");
    parts.wire(&valve);

    parts.add("pv", "Sum", &[])?;
    parts.wire(&["plant", "pv.in"]);
    parts.wire(&["noise", "pv.plus"]);
    let mut pv = "pv";
    if resolution("pv_resolution", s.pv_resolution)? > 0.0 {
        parts.add("pv_steps", "Resolution", &[("step", s.pv_resolution)])?;
        parts.wire(&["pv", "pv_steps"]);
        pv = "pv_steps";
    }
    parts.wire(&[pv, "pid.pv"]);
    if let Some(given) = &s.compensation {
        parts.add("watch", "BacklashDetection", &detection(s, given))?;
        parts.wire(&[sp_from, "watch.sp"]);
        parts.wire(&[pv, "watch.pv"]);
        if let Some(delay) = given.delay {
            parts.add("flags", "Input", &[])?;
            parts.add("late", "Delay", &[("scans", delay.into())])?;
            parts.wire(&["pid", "watch.op"]);
            parts.wire(&["flags", "watch.flags"]);
            parts.wire(&["watch", "late", "pid.ff"]);
        } else {
            parts.wire(&["watch", "pid.ff"]);
        }
    }

    let wires: Vec<&str> = parts.wires.iter().map(String::as_str).collect();
    let graph = Graph::new(s.h, parts.modules, &wires)?;
    let outer = || {
        Ok::<_, GraphError>([
            graph.node("sp")?,
            graph.node("outer_load")?,
            graph.node("outer_noise")?,
            graph.node("outer_pv")?,
        ])
    };
    let at = Numbers {
        sp: graph.node(sp_from)?,
        load: graph.node("load")?,
        noise: graph.node("noise")?,
        pid: graph.node("pid")?,
        pv: graph.node(pv)?,
        op: graph.node(op)?,
        position: graph.node(position)?,
        watch: s.compensation.map(|_| graph.node("watch")).transpose()?,
        u_ff: s.compensation.map(|c| graph.node(if c.delay.is_some() { "late" } else { "watch" })).transpose()?,
        flags: s.compensation.and_then(|c| c.delay).map(|_| graph.node("flags")).transpose()?,
        outer: s.outer.as_ref().map(|_| outer()).transpose()?,
    };
    Ok((graph, at, rest.y))
}

fn limits(c: &Controller) -> Result<Saturation<f64>, SimError> {
    Ok(c.limits.map_or(Ok(Saturation::none()), |(low, high)| Saturation::new(low, high))?)
}

/// Parameters of a controller at rest with the process value `y` and the output `op`.
fn controller(c: &Controller, y: f64, op: f64) -> Result<[(&'static str, f64); 10], SimError> {
    let Saturation { low, high } = limits(c)?;
    Ok([
        ("k", c.k),
        ("ti", c.ti),
        ("td", c.td),
        ("b", c.b),
        ("tf", c.tf),
        ("low", low),
        ("high", high),
        // Every sample of a scenario comes in time.
        ("max_h", f64::MAX),
        ("start", op),
        ("start_pv", y),
    ])
}

/// Parameters of the detector beside the controller.
fn detection(s: &Scenario, given: &Compensated) -> Vec<(&'static str, f64)> {
    let (c, comp) = (&s.controller, &given.settings);
    let mut parameters = vec![
        ("k", comp.k),
        ("ti", c.ti),
        ("td", c.td),
        ("b", c.b),
        ("tf", given.tf),
        ("comp_size", comp.size),
        ("comp_way", f64::from(comp.way as u8)),
        ("comp_share", comp.share),
        ("comp_limit", comp.limit),
        ("comp_band", comp.band),
        ("comp_tf", comp.tf),
        ("comp_rate", comp.rate),
        ("comp_release", comp.release),
        ("comp_watch", comp.watch),
        ("comp_travel", comp.travel),
        ("comp_reversals", comp.reversals),
        ("comp_withdraw", u8::from(comp.withdraw).into()),
        ("comp_estimate", u8::from(comp.estimate).into()),
    ];
    parameters.extend(given.longest.map(|longest| ("ff_longest", longest)));
    parameters.extend(given.delay.map(|delay| ("ff_delay", delay.into())));
    parameters.extend(s.plant.gain().map(|gain| ("kp", gain)));
    parameters.extend(c.limits.iter().flat_map(|(low, high)| [("op_low", *low), ("op_high", *high)]));
    parameters
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::{Run, samples};
    use crate::scenario::Columns;
    use crate::{Manual, Piece};
    use glapp_core::{CompensationSettings, Friction, Way};

    /// The scenario on the modules, or on the faster loop.
    fn run(s: &Scenario, on_modules: bool) -> Columns {
        let mut columns = Columns::of_length(samples(s.h, s.t_end).unwrap(), s);
        let n = columns.t.len();
        let mut run = Run::new(s, on_modules).unwrap();
        // Computed in parts, as in a run that goes on.
        for first in (0..n).step_by(700) {
            run.advance(&mut columns.block().part(first..(first + 700).min(n)), first).unwrap();
        }
        columns
    }

    fn plain(name: &str, [k, ti, td, b, tf]: [f64; 5]) -> Scenario {
        let controller = Controller { k, ti, td, b, tf, limits: None };
        Scenario {
            d: 0.1,
            noise: vec![Piece::Uniform { amplitude: 0.005 }, Piece::Coloured { sigma: 0.004, tau: 1.0 }],
            setpoint: vec![Piece::Steps(vec![(0.0, 0.2), (1.0, 1.0), (60.0, 0.4)])],
            load: vec![Piece::Steps(vec![(0.0, 0.1), (30.0, 0.3)]), Piece::Walk { rate: 0.005 }],
            ..Scenario::new(Plant::named(name).unwrap(), controller, 0.05, 100.0)
        }
    }

    fn with(change: fn(&mut Scenario)) -> Scenario {
        let mut s = plain("P2", [1.12, 2.4, 0.619, 0.3, 0.124]);
        change(&mut s);
        s
    }

    fn cascaded(s: &mut Scenario) {
        let controller = Controller { k: 0.2, ti: 6.0, td: 0.5, b: 0.5, tf: 0.6, limits: None };
        let half = Plant::new(vec![1.0], vec![1.0, 2.0, 1.0], 0.3).unwrap();
        let noise = vec![Piece::Gaussian { sigma: 0.003 }];
        let load = vec![Piece::Steps(vec![(0.0, 0.05), (40.0, 0.1)])];
        s.outer = Some(Outer { plant: half, controller, d: 0.02, noise, load });
    }

    #[test]
    fn the_faster_loop_has_the_bits_of_the_modules() {
        let kano = |s: &mut Scenario| s.friction = Some(Friction::new(Model::Kano, 0.2, 0.1).unwrap());
        let he = |s: &mut Scenario| s.friction = Some(Friction::new(Model::He, 0.2, 0.1).unwrap());
        let cases = [
            ("PI", plain("P2", [0.775, 2.05, 0.0, 0.0, 0.205])),
            ("PI without a filter", plain("P2", [0.4, 2.05, 0.0, 1.0, 0.0])),
            ("PI, integrating", plain("P1", [0.363, 7.06, 0.0, 0.0, 0.706])),
            ("PI, dead time", plain("P4", [0.39, 2.22, 0.0, 0.0, 0.222])),
            ("PID", with(|_| ())),
            ("limits", with(|s| s.controller.limits = Some((-0.3, 0.9)))),
            ("an actuator's speed", with(|s| s.rate = Some(0.05))),
            ("friction, Kano", with(kano)),
            ("friction, He", with(he)),
            ("rounding", with(|s| (s.pv_resolution, s.op_resolution) = (0.01, 0.02))),
            (
                "a dead time longer than the run",
                with(|s| s.plant = Plant::new(vec![1.0], vec![1.0, 1.0], 1e9).unwrap()),
            ),
            ("a cascade", with(cascaded)),
            (
                "all at once",
                with(|s| {
                    cascaded(s);
                    s.controller.limits = Some((-9.0, 9.0));
                    s.rate = Some(1.0);
                    s.friction = Some(Friction::new(Model::He, 0.2, 0.1).unwrap());
                    (s.pv_resolution, s.op_resolution) = (0.01, 0.02);
                }),
            ),
        ];
        for (name, s) in cases {
            let (fast, modules) = (run(&s, false), run(&s, true));
            assert_eq!(fast, modules, "{name}");
            let moved = |x: &[f64]| x.iter().any(|v| *v != x[0]);
            assert!(moved(&fast.op) && (moved(&fast.position) || s.friction.is_some()), "{name}");
        }
    }

    /// Beside a controller that is not ours u_FF is as late as in a graph at least; then the loops are the same, whatever happens.
    #[test]
    fn a_scan_late_beside_their_controller_is_the_loop_of_the_graph() {
        let by_hand = vec![Manual { from: 60.0, to: 65.0, op: None }];
        for (way, change) in [
            (Way::Inverse, (|_| ()) as fn(&mut Scenario)),
            (Way::Error, |s| s.bad = vec![(50.0, 55.0)]),
            (Way::Inverse, |s| s.controller.limits = Some((-0.3, 0.9))),
        ] {
            let settings = CompensationSettings::new(way, 0.775, 2.05, 0.08, 1.0);
            let given = Compensated { settings, tf: 0.205, begin: 20.0, delay: None, longest: None };
            let mut s = plain("P2", [0.775, 2.05, 0.0, 0.0, 0.205]);
            (s.manual, s.compensation) = (by_hand.clone(), Some(given));
            change(&mut s);
            let ours = run(&s, true);
            s.compensation = Some(Compensated { delay: Some(1), ..given });
            let theirs = run(&s, true);
            assert_eq!(ours, theirs);
            assert!(ours.u_ff.iter().any(|u_ff| *u_ff != 0.0) && ours.standing.contains(&2.0));
            s.compensation = Some(Compensated { delay: Some(2), ..given });
            assert_ne!(run(&s, true).op, ours.op);
            s.compensation = Some(Compensated { delay: Some(32), ..given });
            let late = run(&s, true);
            assert!(late.standing.contains(&12.0) && late.u_ff.iter().all(|u_ff| *u_ff == 0.0), "too late");
        }
    }

    /// The module goes back to automatic from where the output is, plus one scan's integration; the bare controller also answers
    /// what PV did in that one sample. And where PV was lost the module's filter starts anew. From there on two runs part as two with
    /// other noise do.
    #[test]
    fn after_manual_and_after_a_lost_signal_they_part_by_one_sample() {
        let by_hand = |from, to, op| vec![Manual { from, to, op }];
        for (s, first) in [
            (Scenario { manual: by_hand(30.0, 35.0, None), ..plain("P2", [0.775, 2.05, 0.0, 0.0, 0.205]) }, 700),
            (Scenario { manual: by_hand(30.0, 35.0, Some(0.5)), ..with(|_| ()) }, 700),
            (Scenario { bad: vec![(30.0, 35.0)], ..with(|_| ()) }, 700),
        ] {
            let (fast, modules) = (run(&s, false), run(&s, true));
            let until = |c: &Columns| (c.pv[..first].to_vec(), c.op[..first].to_vec(), c.flags.clone());
            assert_eq!(until(&fast), until(&modules));
            let apart = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            let (op, pv) = (apart(&fast.op, &modules.op), apart(&fast.pv, &modules.pv));
            // K·(1 + Td/h) times what PV, filtered, does in a sample.
            let most = s.controller.k * (1.0 + s.controller.td / s.h) * 0.02;
            assert!(op > 0.0 && op < most.max(0.1) && pv < 0.15, "{op} and {pv}");
        }
    }
}
