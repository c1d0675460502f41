//! Loops of modules: the same bits as the simulator, checked when made, open while they run.

use glapp_core::modules::Gains;
use glapp_core::status::{AT_HIGH, AT_LOW, NOT_AUTO};
use glapp_sim::{Controller, Graph, GraphError, Module, Piece, Plant, Scenario};

fn module(kind: &str, parameters: &[(&str, f64)]) -> Module {
    Module::new(kind, parameters).unwrap()
}

/// The loop of the simulator: limits, gap, plant, filter.
fn like(scenario: &Scenario) -> Graph {
    let c = &scenario.controller;
    let (low, high) = c.limits.unwrap();
    let parameters = [("k", c.k), ("ti", c.ti), ("td", c.td), ("b", c.b), ("low", low), ("high", high), ("max_h", 1e6)];
    let modules = vec![
        ("sp", module("Input", &[])),
        ("load", module("Input", &[])),
        ("noise", module("Noise", &[("amplitude", 0.0)])),
        ("filter", module("Filter2P", &[("tf", c.tf)])),
        ("pid", module("Pid", &parameters)),
        ("gap", module("Backlash", &[("d", scenario.d)])),
        ("plant", Module::plant(scenario.plant.clone(), &[]).unwrap()),
    ];
    let wires = ["sp -> pid.sp", "load -> plant.load", "pid -> gap -> plant -> noise -> filter -> pid.pv"];
    Graph::new(scenario.h, modules, &wires).unwrap()
}

#[test]
fn a_graph_gives_the_bits_of_the_simulator() {
    for (name, k, ti, td) in
        [("P2", 0.775, 2.05, 0.0), ("P2", 1.12, 2.4, 0.619), ("P1", 0.781, 4.04, 0.0), ("P4", 0.39, 2.22, 0.0)]
    {
        let controller = Controller { k, ti, td, b: 0.0, tf: ti / 10.0, limits: Some((-0.8, 1.05)) };
        let scenario = Scenario {
            d: 0.1,
            setpoint: vec![Piece::Steps(vec![(1.0, 1.0), (60.0, 0.4)])],
            load: vec![Piece::Steps(vec![(30.0, 0.3)])],
            ..Scenario::new(Plant::named(name).unwrap(), controller, 0.05, 100.0)
        };
        let expected = scenario.run().unwrap();
        let mut graph = like(&scenario);
        let inputs = [("sp", expected.sp.as_slice()), ("load", expected.load.as_slice())];
        let got = graph.record(expected.t.len(), &inputs, &["plant", "pid", "gap"]).unwrap();
        assert_eq!((&got[0], &got[1], &got[2]), (&expected.pv, &expected.op, &expected.position), "{name}");
        assert!(expected.op.contains(&1.05) || name != "P2", "a limit is met");
    }
}

fn pid() -> Module {
    module("Pid", &[("k", 1.0), ("ti", 5.0), ("low", 0.0), ("high", 100.0)])
}

fn advanced() -> Module {
    module("PidAdvanced", &[("k", 1.0), ("ti", 5.0), ("low", 0.0), ("high", 100.0)])
}

fn process() -> Module {
    module("ProcessSim", &[("gain", 1.0), ("t1", 3.0)])
}

fn refusal(modules: Vec<(&str, Module)>, wires: &[&str]) -> String {
    Graph::new(0.1, modules, wires).err().expect("refused").to_string()
}

#[test]
fn open_ends_are_named() {
    let loose = refusal(vec![("pid", pid()), ("process", process())], &["pid -> process"]);
    assert_eq!(loose, "pid.pv is open: connect it");
    let loose = refusal(vec![("pv", module("Input", &[])), ("pid", pid())], &["pv -> pid.pv"]);
    assert_eq!(loose, "pid, its output, is open: connect it");
}

#[test]
fn a_circle_without_a_delay_is_named() {
    let modules = || {
        vec![("pid", pid()), ("gap", module("Backlash", &[("d", 1.0)])), ("filter", module("Filter2P", &[("tf", 1.0)]))]
    };
    let found = refusal(modules(), &["pid -> gap -> filter -> pid.pv"]);
    assert!(found.contains("pid -> gap -> filter -> pid"), "{found}");
    let mut with = modules();
    with.push(("process", process()));
    Graph::new(0.1, with, &["pid -> gap -> process -> filter -> pid.pv"]).unwrap();
}

#[test]
fn mixed_scan_times_are_named() {
    let slow = module("ProcessSim", &[("gain", 1.0), ("t1", 3.0), ("h", 0.5)]);
    let found = refusal(vec![("pid", pid()), ("tank", slow)], &["pid -> tank -> pid.pv"]);
    assert!(found.contains("tank is made for a scan time of 0.5 s, the graph runs at 0.1 s"), "{found}");
}

#[test]
fn one_valve_in_two_loops_is_named() {
    let modules = vec![("one", advanced()), ("two", advanced()), ("tank", process())];
    let found = refusal(modules, &["one -> tank -> one.pv", "two -> tank", "tank -> two.pv"]);
    assert!(found.contains("tank.in is driven by one and by two"), "{found}");
}

#[test]
fn wires_that_cannot_be_laid_are_named() {
    let modules = || vec![("pid", pid()), ("process", process())];
    for (wire, what) in [
        ("pid", "write it as"),
        ("pid -> valve", "no module 'valve'"),
        ("process -> pid", "name one as pid.NAME: pv, sp, ff"),
        ("process -> pid.op", "no such input"),
    ] {
        let found = refusal(modules(), &[wire]);
        assert!(found.contains(what) && found.contains(wire), "{found}");
    }
    let twice = refusal(vec![("pid", pid()), ("pid", pid())], &[]);
    assert!(twice.contains("given once"), "{twice}");
}

#[test]
fn parameters_and_names_are_refused_by_name() {
    let wrong = refusal(
        vec![("pid", module("Pid", &[("k", 1.0), ("ti", -5.0)])), ("process", process())],
        &["pid -> process -> pid.pv"],
    );
    assert!(wrong.starts_with("pid: ti = -5: must be greater than 0 s"), "{wrong}");
    let unknown = Module::new("Pid", &[("k", 1.0), ("Ti", 5.0)]).unwrap_err().to_string();
    assert!(unknown.contains("'Ti'") && unknown.contains("k, ti, td"), "{unknown}");
    let missing = Module::new("Backlash", &[]).unwrap_err().to_string();
    assert_eq!(missing, "Backlash: d must be given");
    assert!(Module::new("Tank", &[]).unwrap_err().to_string().contains("ProcessSim"));
    let odd = module("PidAdvanced", &[("k", 1.0), ("ti", 5.0), ("n", 4.0)]);
    let odd = refusal(vec![("pid", odd), ("process", process())], &["pid -> process -> pid.pv"]);
    assert!(odd.starts_with("pid: n = 4"), "{odd}");
}

fn cascade(outer: Module, inner: Module) -> (Vec<(&'static str, Module)>, Vec<&'static str>) {
    (
        vec![("outer", outer), ("inner", inner), ("valve", process()), ("tank", process())],
        vec!["outer -> inner.sp", "inner -> valve -> tank -> outer.pv", "valve -> inner.pv"],
    )
}

#[test]
fn a_detector_in_the_outer_loop_is_refused_with_the_reason() {
    let (modules, wires) = cascade(pid(), advanced());
    Graph::new(0.1, modules, &wires).unwrap();
    let (modules, wires) = cascade(advanced(), pid());
    let found = refusal(modules, &wires);
    assert!(found.contains("outer stands in the outer loop of a cascade: inner distorts"), "{found}");
    // Beside the outer controller it is refused just so, with whatever lies between.
    let (mut modules, _) = cascade(pid(), pid());
    modules.push(("watch", module("BacklashDetection", &[("k", 1.0), ("ti", 5.0)])));
    modules.push(("sp", module("Input", &[])));
    modules.push(("ramp", module("Filter2P", &[("tf", 1.0)])));
    let wires = [
        "outer -> ramp -> inner.sp",
        "inner -> valve -> tank -> outer.pv",
        "valve -> inner.pv",
        "sp -> outer.sp",
        "sp -> watch.sp",
        "tank -> watch.pv",
        "watch -> outer.ff",
    ];
    let found = refusal(modules, &wires);
    assert!(found.contains("watch stands in the outer loop of a cascade: inner distorts"), "{found}");
}

#[test]
fn a_split_range_is_refused_with_the_reason() {
    let modules = |controller| {
        vec![
            ("pid", controller),
            ("heating", module("Saturation", &[("low", 50.0), ("high", 100.0)])),
            ("cooling", module("Saturation", &[("low", 0.0), ("high", 50.0)])),
            ("steam", module("Output", &[])),
            ("water", module("Output", &[])),
            ("pv", module("Input", &[])),
        ]
    };
    let wires = ["pv -> pid.pv", "pid -> heating -> steam", "pid -> cooling -> water"];
    let found = refusal(modules(advanced()), &wires);
    assert!(found.contains("pid watches an output that goes to steam and water"), "{found}");
    Graph::new(0.1, modules(pid()), &wires).unwrap();
}

#[test]
fn a_detector_beside_no_controller_is_refused() {
    let modules = vec![
        ("sp", module("Input", &[])),
        ("other", module("Input", &[])),
        ("pid", pid()),
        ("process", process()),
        ("watch", module("BacklashDetection", &[("k", 1.0), ("ti", 5.0)])),
    ];
    let wires =
        ["sp -> pid.sp", "pid -> process -> pid.pv", "other -> watch.sp", "process -> watch.pv", "watch -> pid.ff"];
    assert!(refusal(modules, &wires).contains("watch watches no controller"));
}

#[test]
fn everything_can_be_read_and_set_while_it_runs() {
    let modules = vec![("sp", module("Input", &[("value", 50.0)])), ("pid", advanced()), ("process", process())];
    let mut graph = Graph::new(0.1, modules, &["sp -> pid.sp", "pid -> process -> pid.pv"]).unwrap();
    graph.run(300).unwrap();
    for name in graph.names() {
        graph.get(&name).unwrap();
    }
    let before = graph.get("pid.out").unwrap();
    graph.set("pid.k", 3.0).unwrap();
    assert_eq!(graph.get("pid.k").unwrap(), 3.0);
    graph.run(1).unwrap();
    assert!((graph.get("pid").unwrap() - before).abs() < 0.1, "without a bump");
    // A refused value changes nothing, and the error says why.
    for (path, value, what) in [
        ("pid.ti", 0.0, "pid: ti = 0: must be greater than 0 s"),
        ("pid.high", -1.0, "low = 0"),
        ("pid.mode", 7.0, "mode = 7"),
        ("pid.sp", f64::NAN, "sp = NaN"),
        ("pid.out", 1.0, "there is no 'out'"),
        ("pid.start", 1.0, "there is no 'start'"),
        ("valve.d", 1.0, "there is no 'valve' here: sp, pid, process"),
    ] {
        let found = graph.set(path, value).unwrap_err().to_string();
        assert!(found.contains(what), "{found}");
    }
    assert_eq!(graph.get("pid.ti").unwrap(), 5.0);
    graph.set("process.gain", 2.0).unwrap();
    graph.run(2000).unwrap();
    assert!((graph.get("pid.out").unwrap() - 25.0).abs() < 1e-6);
    assert!(matches!(graph.reset_detection("process"), Err(GraphError::NoName { .. })));
    graph.reset_detection("pid").unwrap();
}

#[test]
fn columns_of_the_wrong_length_or_for_no_input_are_refused() {
    let modules = vec![("sp", module("Input", &[])), ("pid", pid()), ("process", process())];
    let mut graph = Graph::new(0.1, modules, &["sp -> pid.sp", "pid -> process -> pid.pv"]).unwrap();
    let found = graph.record(3, &[("sp", &[1.0, 2.0])], &[]).unwrap_err().to_string();
    assert_eq!(found, "sp: 2 values for 3 scans");
    let found = graph.record(1, &[("pid", &[1.0])], &[]).unwrap_err().to_string();
    assert_eq!(found, "pid is a Pid: values are handed to an Input");
}

#[test]
fn what_a_plant_tells_reaches_every_module_before_it() {
    let modules = vec![
        ("sp", module("Input", &[("value", 40.0)])),
        ("pv", module("Input", &[("value", 40.0)])),
        ("outer", module("Pid", &[("k", 1.0), ("ti", 5.0), ("low", 0.0), ("high", 100.0), ("start", 20.0)])),
        ("flow", module("Input", &[("value", 20.0)])),
        ("inner", module("Pid", &[("k", -1.0), ("ti", 5.0), ("low", 0.0), ("high", 100.0), ("start", 30.0)])),
        ("noise", module("Noise", &[("amplitude", 0.0)])),
        ("valve", module("Output", &[])),
    ];
    let wires =
        ["sp -> outer.sp", "pv -> outer.pv", "outer -> inner.sp", "flow -> inner.pv", "inner -> noise -> valve"];
    let mut graph = Graph::new(0.1, modules, &wires).unwrap();
    graph.run(5).unwrap();
    assert_eq!(graph.get("sp.flags").unwrap(), 0.0);
    graph.set("valve.flags", f64::from(AT_LOW)).unwrap();
    graph.run(1).unwrap();
    // Read in the backward pass of the same scan; direct-acting, so that the master sees its upper side.
    assert_eq!(graph.get("sp.flags").unwrap(), f64::from(AT_HIGH));
    graph.set("valve.flags", f64::from(NOT_AUTO)).unwrap();
    graph.set("valve.tracking", 77.0).unwrap();
    graph.run(2).unwrap();
    assert_eq!(graph.get("inner.out").unwrap(), 77.0);
    assert_eq!(graph.get("sp.flags").unwrap(), f64::from(NOT_AUTO));
    assert_eq!(graph.get("outer.out").unwrap(), 20.0, "the master tracks the slave's process value");
}

/// `x` → module → `y`, scan by scan.
fn through(kind: &str, parameters: &[(&str, f64)], x: &[f64]) -> Vec<f64> {
    let modules = vec![("x", module("Input", &[])), ("it", module(kind, parameters)), ("y", module("Output", &[]))];
    Graph::new(1.0, modules, &["x -> it.in", "it -> y"])
        .unwrap()
        .record(x.len(), &[("x", x)], &["it"])
        .unwrap()
        .remove(0)
}

#[test]
fn what_a_valve_and_a_converter_do() {
    assert_eq!(through("Resolution", &[("step", 0.5)], &[0.2, 0.25, -0.25, 0.9]), [0.0, 0.5, 0.0, 1.0]);
    assert_eq!(through("Backlash", &[("d", 2.0)], &[5.0, 7.0]), [5.0, 6.0]);
    assert_eq!(through("Backlash", &[("d", 2.0), ("start", 4.5)], &[5.0, 7.0]), [4.5, 6.0]);
    assert_eq!(through("RateLimit", &[("rate", 1.0), ("start", 0.0)], &[5.0, 5.0]), [1.0, 2.0]);
    let friction = [("s", 3.0), ("j", 1.0)];
    let (moves, stem) = ([0.0, 1.0, 2.0, 2.5, 3.0, 2.0, 0.0], [0.0, 0.0, 0.0, 1.5, 2.0, 2.0, 2.0]);
    assert_eq!(through("Friction", &friction, &moves), stem);
    assert_eq!(through("Friction", &[&friction[..], &[("start", 0.0)]].concat(), &moves[1..]), stem[1..]);
    // He's stem sticks again at once.
    assert_eq!(through("Friction", &[&friction[..], &[("model", 2.0)]].concat(), &moves)[3..5], [1.5, 1.5]);
    // A bad value leaves the stem where it is.
    assert_eq!(through("Friction", &friction, &[0.0, 2.5, f64::NAN, 2.6])[1..], [1.5, 1.5, 1.6]);
    let wrong = Graph::new(
        1.0,
        vec![
            ("x", module("Input", &[])),
            ("stem", module("Friction", &[("s", 1.0), ("j", 0.0), ("model", 4.0)])),
            ("y", module("Output", &[])),
        ],
        &["x -> stem -> y"],
    );
    assert_eq!(wrong.err().unwrap().to_string(), "stem: model = 4: must be 1 (Kano), 2 (He) or 3 (Karnopp)");
}

#[test]
fn the_parts_of_a_sum_are_told_what_is_left_to_them() {
    let modules = vec![
        ("a", module("Input", &[("value", 30.0)])),
        ("b", module("Input", &[("value", 5.0)])),
        ("sum", module("Sum", &[])),
        ("valve", module("Saturation", &[("low", 0.0), ("high", 35.0)])),
        ("out", module("Output", &[])),
    ];
    let mut graph = Graph::new(0.1, modules, &["a -> sum.in", "b -> sum.plus", "sum -> valve -> out"]).unwrap();
    graph.run(1).unwrap();
    assert_eq!(graph.get("out.value").unwrap(), 35.0);
    let reports =
        |graph: &Graph, name: &str| [".low", ".high", ".flags"].map(|it| graph.get(&format!("{name}{it}")).unwrap());
    assert_eq!(reports(&graph, "a"), [-5.0, 30.0, f64::from(AT_HIGH)]);
    assert_eq!(reports(&graph, "b"), [-30.0, 5.0, f64::from(AT_HIGH)]);
    graph.set("b.value", f64::NAN).unwrap();
    graph.run(1).unwrap();
    assert!(graph.get("out.value").unwrap().is_nan());
    assert_eq!(reports(&graph, "a")[..2], [0.0, 35.0], "what is no number takes nothing away");
}

#[test]
fn an_actuator_that_tells_nobody_lets_the_integral_run() {
    let found = [1.0, 0.0].map(|reports| {
        let modules = vec![
            ("sp", module("Input", &[("value", 50.0)])),
            ("pid", pid()),
            ("actuator", module("RateLimit", &[("rate", 0.1), ("reports", reports), ("start", 0.0)])),
            ("process", process()),
        ];
        let mut graph = Graph::new(0.1, modules, &["sp -> pid.sp", "pid -> actuator -> process -> pid.pv"]).unwrap();
        graph.run(20).unwrap();
        graph.get("pid.flags").unwrap()
    });
    assert_eq!(found, [f64::from(AT_HIGH), 0.0]);
}

#[test]
fn what_is_not_known_is_none() {
    let modules = vec![("pid", advanced()), ("process", process())];
    let mut graph = Graph::new(0.1, modules, &["pid -> process -> pid.pv"]).unwrap();
    assert!(graph.get("pid.kp").unwrap().is_nan());
    graph.set("pid.kp", 2.0).unwrap();
    let error = graph.set("pid.kp", f64::NAN).unwrap_err().to_string();
    assert!(error.starts_with("pid: kp = NaN: must be"), "{error}");
    assert_eq!(graph.get("pid.kp").unwrap(), 2.0);
    graph.set("pid.kp", None).unwrap();
    assert!(graph.get("pid.kp").unwrap().is_nan());
    assert_eq!(graph.known("pid.kp").unwrap(), None);
    assert!(graph.known("pid.d_hat").unwrap().unwrap().is_nan(), "a variable without a value is no number");
    assert_eq!((graph.known("pid.max_h").unwrap(), graph.known("process.h").unwrap()), (Some(2.5), Some(0.1)));
    assert_eq!(graph.window("pid").unwrap(), []);
    assert!(graph.window("process").unwrap_err().to_string().starts_with("process: there is no 'window' here"));
    // A parameter with a default goes back to it.
    graph.set("pid.b", 0.5).unwrap();
    graph.set("pid.b", None).unwrap();
    assert_eq!(graph.get("pid.b").unwrap(), 1.0);
    assert_eq!(graph.set("pid.k", None).unwrap_err().to_string(), "PidAdvanced: k must be given");
}

fn beside(inputs: &[&'static str]) -> Result<Graph, GraphError> {
    let watch = module("BacklashDetection", &[("k", 1.0), ("ti", 5.0), ("comp_size", 1.0)]);
    let mut modules = vec![("watch", watch), ("ff", module("Output", &[]))];
    modules.extend(inputs.iter().map(|name| (*name, module("Input", &[]))));
    let wires: Vec<String> = inputs.iter().map(|name| format!("{name} -> watch.{name}")).collect();
    let mut wires: Vec<&str> = wires.iter().map(String::as_str).collect();
    wires.push("watch -> ff");
    Graph::new(0.5, modules, &wires)
}

#[test]
fn beside_a_controller_that_is_no_module_whether_it_is_in_automatic_must_be_told() {
    for inputs in [&["sp", "pv", "flags"][..], &["sp", "pv", "op", "flags"], &["sp", "pv", "op", "flags", "u_ff"]] {
        beside(inputs).unwrap();
    }
    let refusal = |inputs: &[&'static str]| beside(inputs).err().unwrap().to_string();
    assert!(refusal(&["sp", "pv", "op"]).starts_with("watch.op is connected, and watch.flags is not"));
    assert!(refusal(&["sp", "pv", "flags_", "u_ff"]).contains("no such input"));
    assert!(refusal(&["sp", "pv", "u_ff"]).starts_with("watch.u_ff is connected, and watch.flags is not"));
    assert!(refusal(&["sp", "pv"]).ends_with("connect watch.flags, its mode and limits"));
}

#[test]
fn flags_that_are_none_are_a_bad_value() {
    let mut graph = beside(&["sp", "pv", "op", "flags"]).unwrap();
    graph.set("watch.compensate", 1.0).unwrap();
    for (flags, standing) in
        [(0.0, 10.0), (1.0, 2.0), (2.0, 3.0), (8.0, 8.0), (0.5, 3.0), (16.0, 3.0), (-1.0, 3.0), (f64::NAN, 3.0)]
    {
        graph.record(1, &[("op", &[50.0]), ("flags", &[flags])], &[]).unwrap();
        assert_eq!(graph.get("watch.standing").unwrap(), standing, "{flags}");
    }
}

#[test]
fn without_op_nothing_is_compensated() {
    let mut graph = beside(&["sp", "pv", "flags"]).unwrap();
    graph.set("watch.compensate", 1.0).unwrap();
    graph.run(3).unwrap();
    assert_eq!(graph.get("watch.standing").unwrap(), 1.0);
}

#[test]
fn a_delay_is_whole_scans_and_may_close_a_circle() {
    let wires = ["x -> sum.in", "sum -> late -> sum.plus", "late -> y"];
    let new = |scans: f64| {
        let modules = vec![
            ("x", module("Input", &[("value", 1.0)])),
            ("sum", module("Sum", &[])),
            ("late", module("Delay", &[("scans", scans), ("start", 0.5)])),
            ("y", module("Output", &[])),
        ];
        Graph::new(0.5, modules, &wires)
    };
    let y = new(2.0).unwrap().record(6, &[], &["y"]).unwrap();
    assert_eq!(y[0], [0.5, 0.5, 1.5, 1.5, 2.5, 2.5]);
    for scans in [0.0, 1.5, -1.0, 1e5, f64::NAN] {
        let error = new(scans).err().unwrap().to_string();
        assert!(error.starts_with("late: scans = ") && error.contains("a whole number"), "{error}");
    }
}

/// The defaults of a compensation go by the longest Ti of the table, as in `GlappPidAdvanced`.
#[test]
fn under_a_schedule_a_compensation_goes_by_the_longest_ti() {
    let with = |rows: &[(f64, f64)]| {
        let rows: Vec<Gains<f64>> = rows.iter().map(|&(at, ti)| Gains { at, k: 1.0, ti, td: 0.0 }).collect();
        let parameters = [("k", 1.0), ("ti", 5.0), ("comp_size", 2.0)];
        let pid = Module::scheduled(&parameters, &rows).unwrap();
        let modules = vec![("pv", module("Input", &[])), ("pid", pid), ("valve", module("Output", &[]))];
        let graph = Graph::new(0.5, modules, &["pv -> pid.pv", "pid -> valve"]).unwrap();
        ["rate", "release", "watch"].map(|name| graph.get(&format!("pid.comp_{name}")).unwrap())
    };
    assert_eq!(with(&[]), [4.0, 5.0, 1500.0]);
    assert_eq!(with(&[(0.0, 8.0), (1.0, 20.0), (2.0, 2.0)]), [1.0, 20.0, 6000.0]);
    assert_eq!(with(&[(0.0, 2.0)]), [10.0, 2.0, 600.0]);
}

#[test]
fn a_width_is_that_of_its_source() {
    let with = |more: &[(&str, f64)]| {
        let parameters = [&[("k", 1.0), ("ti", 5.0)], more].concat();
        let modules = vec![
            ("pv", module("Input", &[])),
            ("pid", module("PidAdvanced", &parameters)),
            ("valve", module("Output", &[])),
        ];
        let mut graph = Graph::new(0.5, modules, &["pv -> pid.pv", "pid -> valve"])?;
        graph.set("pid.compensate", 1.0)?;
        graph.run(2)?;
        Ok::<_, GraphError>(
            ["source", "size", "delta", "left", "standing"].map(|name| graph.get(&format!("pid.{name}")).unwrap()),
        )
    };
    let share = ("comp_share", 0.5);
    assert_eq!(with(&[share]).unwrap(), [0.0, 0.0, 0.0, 0.0, 1.0]);
    assert_eq!(with(&[share, ("comp_size", 2.0)]).unwrap(), [1.0, 2.0, 0.6, 1.4, 10.0]);
    assert_eq!(with(&[share, ("comp_size", 2.0), ("comp_fitted", 1.0)]).unwrap(), [2.0, 1.0, 0.3, 0.7, 10.0]);
    assert_eq!(with(&[share, ("comp_size", 2.0), ("comp_fitted", 0.0)]).unwrap(), [2.0, 0.0, 0.0, 0.0, 9.0]);
    let typed = [share, ("comp_size", 2.0), ("comp_fitted", 1.0), ("comp_source", 1.0)];
    assert_eq!(with(&typed).unwrap(), [1.0, 2.0, 0.6, 1.4, 10.0]);
    assert_eq!(with(&[share, ("comp_size", 2.0), ("comp_source", 3.0)]).unwrap(), [3.0, 0.0, 0.0, 0.0, 14.0]);
    let refusal = |more: &[(&str, f64)]| with(more).err().unwrap().to_string();
    assert!(
        refusal(&[("comp_source", 2.0)]).starts_with("pid: comp_fitted = NaN: must be given where comp_source is 2")
    );
    assert!(refusal(&[("comp_source", 4.0)]).starts_with("pid: comp_source = 4: must be 1 (typed)"));
    assert!(refusal(&[("comp_fitted", -1.0)]).starts_with("pid: size = -1: must be 0 or greater"));
}
