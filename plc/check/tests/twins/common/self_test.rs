//! The program that drives every block on a controller, and the numbers it compares with, from the core.
#![allow(dead_code, missing_docs)]

use super::advanced::PID_ADVANCED;
use super::blocks::{core, maybe};
use super::compensate;
use super::control::{self, AUTO_TUNER, POWER_CUT, Row, TWINS, Twin};
use super::detection;
use super::detector::{Pins, Reference};
use super::names::{KNOWN, Names, Place, known};
use super::{Case, Number, Scan, folder, home};
use glapp_core::{Push, Stiction, StictionSample, StictionSettings, StictionState};
use glapp_plc_check::{Build, Instance, Library, sources};
use std::cell::RefCell;
use std::fmt::Write;
use std::sync::OnceLock;

/// Reads a pin.
type Look<'a> = &'a dyn Fn(&str) -> f64;

/// Drive of one block: its name in the vectors and in the library, its parameters in the core, the statements before
/// its call, the pins of the call, the row of these pins in the core, and the outputs that are added up.
struct Drive {
    block: &'static str,
    name: &'static str,
    params: &'static str,
    before: &'static str,
    call: &'static str,
    h: &'static str,
    row: fn(Look<'_>) -> Vec<f64>,
    /// Outputs in the order of the core's row: `Y`, `#Int`, `!Bool`, `Has?Option`; empty: not compared.
    outputs: &'static [&'static str],
    /// The pin without which the core has no row.
    when: &'static str,
}

/// Drive of a block whose pins and outputs stand in the table of `control`: its name there, statements before its call,
/// and its pins.
struct Called {
    twin: &'static str,
    before: &'static str,
    call: &'static str,
}

const SCANS: usize = 400;

/// A, B, C and D are drawn anew in each scan, 0 to 1. A block that others here are made of is driven by them.
const DRIVES: [Drive; 11] = [
    Drive {
        block: "filter",
        name: "SecondOrderFilter",
        params: r#"{"tf": 0.7}"#,
        before: "",
        call: "Tf := 0.7, X := 4.0 * A, H := 0.25",
        h: "H",
        row: |pin| vec![pin("X")],
        outputs: &["Y"],
        when: "",
    },
    Drive {
        block: "zero_crossing",
        name: "ZeroCrossing",
        params: "{}",
        before: "",
        call: "E := B - 0.5",
        h: "",
        row: |pin| vec![pin("E")],
        outputs: &["!Crossed", "#Sign"],
        when: "",
    },
    Drive {
        block: "noise_level",
        name: "NoiseLevel",
        params: "{}",
        before: "",
        call: "X := (2.0 * C) + A, Take := TRUE",
        h: "",
        row: |pin| vec![pin("X")],
        outputs: &["HasSigma?Sigma"],
        when: "",
    },
    Drive {
        block: "half_period",
        name: "HalfPeriod",
        params: "{}",
        before: "Turn := (Scan MOD 7) = 0;",
        call: "Close := Turn, Open := Turn OR (Scan = 1), Take := TRUE, Sign := 1, E := A - 0.5, H := 0.25, Sp := B, \
               Slope := C, OpFiltered := D",
        h: "H",
        row: |pin| vec![pin("E"), pin("Sp"), pin("Slope"), pin("OpFiltered"), 0.0, pin("Close")],
        outputs: &[
            "", "", "Half.DeltaT", "Half.DeltaY", "Half.EMax", "Half.DeltaSp", "Half.SpChange", "Half.SlopeChange",
            "Half.OpChange",
        ],
        when: "Turn",
    },
    Drive {
        block: "width",
        name: "Width",
        params: r#"{"k": -0.5, "ti": 3.0, "td": 0.4, "b": 0.3, "kp": 2.0}"#,
        before: "Data.Sign := 1;
        IF A < 0.5 THEN
            Data.Sign := -1;
        END_IF;
        Data.DeltaT := 20.0 * B;
        Data.DeltaY := C;
        Data.SpChange := D - 0.5;
        Data.SlopeChange := A - D;
        Data.OpChange := 3.0 * B;",
        call: "K := -0.5, Ti := 3.0, Td := 0.4, B := 0.3, Kp := 2.0, Half := Data, \
               OpKnown := C < 0.5",
        h: "",
        row: |pin| {
            let op = if pin("OpKnown") == 0.0 { f64::NAN } else { pin("Half.OpChange") };
            let parts = ["Sign", "DeltaT", "DeltaY", "SpChange", "SlopeChange"];
            parts.iter().map(|part| pin(&format!("Half.{part}"))).chain([op]).collect()
        },
        outputs: &[
            "Parts.DeltaU", "Parts.DeltaUD", "Parts.DeltaUSp", "Parts.OpTravel", "Parts.Free", "Parts.KpPart",
            "Parts.D",
        ],
        when: "",
    },
    Drive {
        block: "safety_net",
        name: "SafetyNet",
        params: r#"{"k": 0.5, "ti": 2.0, "op_span": 4.0}"#,
        before: "Data.EMax := 2.6 * A;
        Data.DeltaSp := 1.2 * D;
        Previous := -1.0;
        IF A < 0.9 THEN
            Previous := B;
        END_IF;
        DHat := 1.0E38;
        IF B < 0.7 THEN
            DHat := 9.0 * A;
        END_IF;",
        call: "Half := Data, Free := 5.0 * D, K := 0.5, Ti := 2.0, Previous := Previous, DHat := DHat, OpSpan := 4.0",
        h: "",
        row: |pin| {
            let given = |name: &str| if pin(&format!("Has{name}")) == 0.0 { f64::NAN } else { pin(name) };
            let parts = ["DeltaT", "DeltaY", "EMax", "DeltaSp"].map(|part| pin(&format!("Half.{part}")));
            let rest = [pin("Free"), given("Previous"), given("DHat")];
            [0.0].into_iter().chain(parts).chain(rest).collect()
        },
        outputs: &["#Mask", "#Reason"],
        when: "",
    },
    Drive {
        block: "median_mean",
        name: "MedianMean",
        params: r#"{"n": 5}"#,
        before: "",
        call: "N := 5, Detection := 3.0 + A",
        h: "",
        row: |pin| vec![pin("Detection")],
        outputs: &["Estimate.Value", "Estimate.Low", "Estimate.High", "#Estimate.Kept", "#Estimate.Count"],
        when: "",
    },
    // A limit cycle with noise; a bad value in one scan, a gain of 0 in others.
    Drive {
        block: "detector",
        name: "Detector",
        params: "{}",
        before: "IF (Scan MOD 30) = 0 THEN
            Side := -Side;
        END_IF;
        Gain := 0.5;
        IF (Scan > 330) AND (Scan < 340) THEN
            Gain := 0.0;
        END_IF;",
        call: "Enable := TRUE, H := 0.25, Sp := 50.0, Pv := (50.0 - Side) + (0.2 * A), \
               Op := 40.0 + (Side * B), Bad := Scan = 200, K := Gain, Ti := 1.0, Kp := 2.0, \
               OpSpan := 100.0, N := 3",
        h: "H",
        row: |pin| vec![pin("Sp"), pin("Pv"), pin("Op"), pin("Bad"), pin("K")],
        outputs: &[
            "!Valid",
            "!Error",
            "#ErrorID",
            "HasEstimate?Estimate.Value",
            "HasEstimate?Estimate.Low",
            "HasEstimate?Estimate.High",
            "",
            "",
            "HasNoiseFloor?NoiseFloor",
            "!HasShown",
            "",
            "PvFiltered",
        ],
        when: "",
    },
    // The loop with a compensation, which is switched on during the run.
    Drive {
        block: "backlash_detection",
        name: "BacklashDetection",
        params: "{}",
        before: "Travel := Side * ((0.2 * INT_TO_LREAL(Scan MOD 30)) - 3.0);",
        call: "Enable := TRUE, Compensate := Scan > 240, H := 0.25, Sp := 50.0, Pv := (50.0 - Side) + (0.2 * A), \
               Output := ((40.0 + BacklashDetectionBlock.UFf) + Travel) + (0.1 * B), Bad := Scan = 200, K := Gain, Ti := 1.0, \
               Kp := 2.0, OpSpan := 100.0, N := 3, Compensates := TRUE, Size := 2.0, \
               Band := 0.5",
        h: "H",
        row: |pin| vec![pin("Sp"), pin("Pv"), pin("Output"), pin("Bad"), pin("K"), pin("Compensate")],
        outputs: &SHOWN,
        when: "",
    },
    Drive {
        block: "foreign_detection",
        name: "ForeignDetection",
        params: "{}",
        before: "Back := ForeignDetectionBlock.UFf;",
        call: "Enable := TRUE, Compensate := Scan > 240, H := 0.25, Sp := 50.0, Pv := (50.0 - Side) + (0.2 * D), \
               Op := ((40.0 + Back) + Travel) + (0.1 * C), Bad := Scan = 200, K := Gain, Ti := 1.0, Kp := 2.0, \
               OpSpan := 100.0, N := 3, Compensates := TRUE, Size := 2.0, Band := 0.5, \
               DelayScans := 1, UFfBack := Back",
        h: "H",
        row: |pin| vec![pin("Sp"), pin("Pv"), pin("Op"), pin("Bad"), pin("K"), pin("Compensate"), pin("UFfBack")],
        outputs: &SHOWN,
        when: "",
    },
    // Each way of pushing in turn.
    Drive {
        block: "stiction",
        name: "Stiction",
        params: "{}",
        before: "",
        call: "Enable := TRUE, Compensate := Scan > 20, H := 0.25, E := A - 0.5, U := 40.0 + (5.0 * B), K := 1.0, Ti := 1.0, \
               Push := 1 + (Scan / 150), Size := 2.0",
        h: "H",
        row: |pin| vec![pin("E"), pin("U"), pin("Compensate"), pin("Push")],
        outputs: &["UFf", "#Standing", "#Direction"],
        when: "",
    },
];

const CALLED: [Called; 9] = [
    Called { twin: "noise", before: "", call: "Seed := 7, Amplitude := 0.3, X := A" },
    Called { twin: "backlash", before: "", call: "D := 0.4, X := A" },
    Called {
        twin: "saturation",
        before: "",
        call: "Low := 0.2, High := 0.9, X := A, BackAtLow := B < 0.1, BackAtHigh := C < 0.1, \
               BackLow := 0.3, BackHigh := 0.7",
    },
    Called { twin: "rate_limit", before: "", call: "Rate := 1.5, X := B, H := 0.25, BackAtHigh := A < 0.1" },
    Called { twin: "phase_lead", before: "", call: "Lead := 2.0, Lag := 0.5, X := C, H := 0.25" },
    Called {
        twin: "process_sim",
        before: "",
        call: "Start := 0.5, Gain := 1.5, T1 := 2.0, T2 := 0.7, DeadTime := 0.75, H := 0.25, X := A, Load := 0.2 * B",
    },
    // Modes, a bad value and a saturated valve on the way.
    Called {
        twin: "pid_module",
        before: "Turn := (Scan > 100) AND (Scan < 120);",
        call: "Enable := TRUE, Start := 50.0, H := 0.25, Pv := 49.0 + (2.0 * A), PvBad := Scan = 200, \
               OwnSp := 50.0 + B, Ff := C, BackAtHigh := D < 0.2, BackNotAuto := Turn, BackTracking := 40.0, K := 2.0, Ti := 5.0, \
               Td := 0.5, B := 0.8, Tf := 0.4, Low := 0.0, High := 100.0, \
               Rate := 8.0",
    },
    // A relay experiment with a process of its own.
    Called {
        twin: "auto_tuner_module",
        before: "Plant(Gain := 1.0, T1 := 2.0, T2 := 1.0, DeadTime := 0.5, H := 0.25, X := AutoTunerBlock.Y, Start := 0.0);",
        call: "Enable := TRUE, Execute := Scan > 20, H := 0.25, X := 0.0, Pv := Plant.Y + (0.02 * A), Amplitude := 5.0, \
               RelayHysteresis := 0.2, WaitTime := 5.0, Longest := 500.0, MaxH := 1.0, PvLow := -50.0, \
               PvHigh := 50.0, OpLow := -50.0, OpHigh := 50.0, Rule := 1 + (Scan MOD 3)",
    },
    // The loop of the detector with everything inside: a schedule, a ramp, a compensation switched on, and an experiment begun on the way.
    Called {
        twin: "pid_advanced",
        before: "",
        call: "Enable := TRUE, Compensate := (Scan > 200) AND (Scan < 350), Execute := Scan > 370, Start := 50.0, H := 0.25, \
               Pv := (50.0 - Side) + (0.2 * B), PvBad := Scan = 180, Ff := 0.1 * C, OwnSp := 50.0 + (Gain * A), \
               BackAtHigh := D < 0.02, K := Gain, Ti := 1.0, Tf := 0.1, Low := 0.0, High := 100.0, \
               Kp := 2.0, DetectorTf := 0.2, N := 3, SpRate := 0.1, \
               ScheduleBy := A, Rows := 2, At1 := 0.2, K1 := 0.5, Ti1 := 1.0, At2 := 0.8, K2 := 0.6, Ti2 := 0.9, Td2 := 0.1, \
               Compensates := TRUE, Size := 2.0, Band := 0.5, Tunes := TRUE, Amplitude := 5.0, \
               WaitTime := 1.0, Longest := 500.0, PvLow := 0.0, PvHigh := 100.0",
    },
];

fn twin(name: &str) -> &'static Twin {
    let known = TWINS.iter().find(|twin| twin.name == name);
    let others = [&AUTO_TUNER, &PID_ADVANCED];
    known.or_else(|| others.into_iter().find(|twin| twin.name == name)).unwrap_or_else(|| panic!("no twin {name}"))
}

/// A block that is driven, whichever table it stands in.
struct Driven {
    name: String,
    before: &'static str,
    call: &'static str,
    outputs: Vec<String>,
    when: &'static str,
}

fn all() -> Vec<Driven> {
    let first = DRIVES.iter().map(|drive| Driven {
        name: drive.name.into(),
        before: drive.before,
        call: drive.call,
        outputs: drive.outputs.iter().map(|output| (*output).into()).collect(),
        when: drive.when,
    });
    let rest = CALLED.iter().map(|called| {
        let twin = twin(called.twin);
        let name = twin.pou.trim_start_matches("Glapp").to_owned();
        let mut names = names(&name);
        let mut outputs: Vec<String> = twin.shown.iter().map(|output| marked(&mut names, output)).collect();
        if called.twin == PID_ADVANCED.name {
            outputs.extend(SHOWN[3..].iter().map(|output| (*output).into()));
        }
        Driven { name, before: called.before, call: called.call, outputs, when: "" }
    });
    first.chain(rest).collect()
}

/// An output with the mark of its type; nothing where it is DINT, which no standard conversion of the subset takes.
fn marked(names: &mut Names, output: &str) -> String {
    match names.ty(output.split('?').next_back().unwrap()) {
        "DINT" => String::new(),
        "BOOL" => format!("!{output}"),
        "INT" => format!("#{output}"),
        _ => output.to_owned(),
    }
}

/// Outputs of both detections with a compensation, in the order of their row in the core.
const SHOWN: [&str; 35] = [
    "!Valid",
    "!Error",
    "#ErrorID",
    "#Standing",
    "#Direction",
    "UFf",
    "HalfWidth",
    "GapWidth",
    "Delta",
    "!Equal",
    "!Relay",
    "!WrongSign",
    "HasWhole?Whole.Value",
    "HasWhole?Whole.Low",
    "HasWhole?Whole.High",
    "#HasWhole?Whole.Kept",
    "#HasWhole?Whole.Count",
    "!HasWholeShown",
    "#Unsuited",
    "HasEstimate?Estimate.Value",
    "HasEstimate?Estimate.Low",
    "HasEstimate?Estimate.High",
    "#HasEstimate?Estimate.Kept",
    "#HasEstimate?Estimate.Count",
    "!HasShown",
    "HasNoiseFloor?NoiseFloor",
    "",
    "PvFiltered",
    "HasUFb?UFb",
    "HasCorrected?Corrected.D",
    "HasCorrected?Corrected.Low",
    "HasCorrected?Corrected.High",
    "HasCorrected?Corrected.Kp",
    "",
    "",
];

/// The files that it drives itself.
pub fn driven() -> Vec<String> {
    all().iter().map(|one| format!("Glapp{}", one.name)).collect()
}

fn reference<R: Number>(drive: &Drive) -> Scan {
    if drive.block == "detector" {
        let mut reference = Reference::<R>::default();
        return Box::new(move |x, h| {
            let [sp, pv, op, bad, k] = x else { panic!("{x:?}") };
            let pins = Pins { h, sp: *sp, pv: *pv, op: Some(*op), k: *k, td: Some(0.0), ..Pins::default() };
            let flags = if *bad != 0.0 { glapp_core::status::BAD } else { 0 };
            Some(reference.scan(&Pins { flags, kp: Some(2.0), op_span: Some(100.0), n: 3, ..pins }).0)
        });
    }
    if drive.block == "stiction" {
        let mut state = StictionState::<R>::default();
        return Box::new(move |x, h| {
            let [e, u, enable, push] = x else { panic!("{x:?}") };
            let push = Push::ALL[*push as usize - 1];
            let block = Stiction::new(StictionSettings::new(push, R::ONE, R::ONE, R::of(2.0))).unwrap();
            let sample = StictionSample { e: R::of(*e), u: R::of(*u), h: R::of(h), enable: *enable != 0.0, flags: 0 };
            let u_ff = block.update(&mut state, &sample);
            Some(vec![u_ff.as_f64(), f64::from(state.standing as u8), state.direction.into()])
        });
    }
    if drive.outputs.len() == SHOWN.len() {
        let mut reference = detection::Reference::<R>::default();
        return Box::new(move |x, h| {
            let [sp, pv, op, bad, k, compensate, back @ ..] = x else { panic!("{x:?}") };
            let flags = if *bad != 0.0 { glapp_core::status::BAD } else { 0 };
            let pins = Pins { h, sp: *sp, pv: *pv, op: Some(*op), flags, k: *k, td: Some(0.0), ..Pins::default() };
            let detector = Pins { kp: Some(2.0), op_span: Some(100.0), n: 3, ..pins };
            let settings =
                compensate::Settings { k: *k, size: 2.0, band: Some(0.5), ..compensate::Settings::default() };
            let foreign =
                |back: &f64| detection::Foreign { delay: 1, tolerance: None, longest: None, back: Some(*back) };
            let shown = reference.scan(&detection::Pins {
                detector,
                compensate: *compensate != 0.0,
                compensation: Some(settings),
                cut: false,
                foreign: back.first().map(foreign),
            });
            Some(shown.row)
        });
    }
    let params = serde_json::from_str(drive.params).unwrap();
    core::<R>(drive.block, &Case { name: drive.block.into(), params, input: vec![], output: None })
}

/// Takes a look at the pins of a block, and gives what the core makes of them.
type NextRow = Box<dyn FnMut(Look<'_>) -> Option<Vec<f64>>>;

fn references<R: Number>() -> Vec<NextRow> {
    let first = DRIVES.iter().map(|drive| {
        let mut core = reference::<R>(drive);
        let reference: NextRow = Box::new(move |pin| {
            let h = if drive.h.is_empty() { 0.0 } else { pin(drive.h) };
            core(&(drive.row)(pin), h)
        });
        reference
    });
    let rest = CALLED.iter().map(|called| {
        let twin = twin(called.twin);
        let mut core = control::core::<R>(twin);
        let reference: NextRow = Box::new(move |pin| {
            let mut row = Row::new(twin, &[]);
            for name in twin.pins.iter().filter(|name| **name != POWER_CUT) {
                row.set(name, pin(name));
            }
            Some(core(&row))
        });
        reference
    });
    first.chain(rest).collect()
}

/// Name of a block's instance in the program: `Pid` itself is taken somewhere.
fn instance(name: &str) -> String {
    format!("{name}Block")
}

/// Names of a block's pins.
fn names(block: &str) -> Names {
    static LIBRARY: OnceLock<Library> = OnceLock::new();
    let library = LIBRARY.get_or_init(|| {
        let mut files = sources(&folder(), Build::Lreal).unwrap_or_else(|fault| panic!("{fault}"));
        files.retain(|(name, _)| name != "SelfTest.st");
        let files = files.iter().map(|(name, text)| (&**name, &**text));
        Library::of_unruled(files, Build::Lreal).unwrap_or_else(|fault| panic!("{fault}"))
    });
    Names::new(library, &format!("Glapp{block}"))
}

/// A call with the members of its structures set before it: variables, statements, the call.
fn wired(block: &str, call: &str) -> (String, String, String) {
    let mut names = names(block);
    let text = std::fs::read_to_string(home().join(format!("{block}.st"))).expect("a file");
    let (mut vars, mut before, mut pins) = (String::new(), String::new(), vec![]);
    for pin in call.split(", ") {
        let (name, value) = pin.split_once(" := ").unwrap_or_else(|| panic!("{block}: {pin}"));
        let path = match names.place(name.trim()) {
            Place::Pin(path) => path,
            _ => panic!("{block} has no pin {name}"),
        };
        let Some((top, member)) = path.split_once('.') else {
            pins.push(format!("{path} := {value}"));
            continue;
        };
        let variable = format!("{block}{top}");
        let given = format!("{top} := {variable}");
        if !pins.contains(&given) {
            pins.push(given);
            let (_, rest) = text.split_once(&format!("    {top} : ")).unwrap_or_else(|| panic!("{block}: no {top}"));
            let ty = rest.split([';', ' ']).next().unwrap_or_default();
            writeln!(vars, "    {variable} : {ty};").unwrap();
        }
        writeln!(before, "        {variable}.{member} := {value};").unwrap();
    }
    (vars, before, pins.join(", "))
}

/// A condition by which an output is known.
fn condition(names: &mut Names, has: &str) -> String {
    match names.place(has) {
        Place::Pin(path) => path,
        _ => {
            let (_, pin, test, than) = KNOWN.iter().find(|(known, ..)| *known == has).expect("an output");
            let Place::Pin(path) = names.place(pin) else { panic!("no {pin}") };
            let whole = path.ends_with("Count") || path.ends_with("Doubt");
            let than = if whole { format!("{than:.0}") } else { literal(Build::Lreal, *than) };
            format!("{path} {test} {than}")
        }
    }
}

/// Adds up an output: the total's name and the statements.
fn added(names: &mut Names, instance: &str, output: &str, total: &str) -> String {
    let within = |condition: &str, statement: String| {
        format!("IF {instance}.{condition} THEN\n            {statement}\n        END_IF;")
    };
    let path = |names: &mut Names, name: &str| match names.place(name) {
        Place::Pin(path) => path,
        _ => panic!("no {name}"),
    };
    let sum = |value: String| format!("{total} := {total} + {value};");
    if let Some(name) = output.strip_prefix('!') {
        return within(&path(names, name), sum("1.0".into()));
    }
    let (whole, name) = output.strip_prefix('#').map_or((false, output), |name| (true, name));
    let (has, name) = name.split_once('?').map_or((None, name), |(has, name)| (Some(has), name));
    let name = path(names, name);
    let value = if whole { format!("INT_TO_LREAL({instance}.{name})") } else { format!("{instance}.{name}") };
    match has {
        Some(has) => within(&condition(names, has), sum(value)),
        None => sum(value),
    }
}

/// The program with these numbers to compare with.
fn program(build: Build, references: &[Vec<f64>]) -> String {
    let tolerance = if build == Build::Real { "1.0E-3" } else { "1.0E-9" };
    let (mut vars, mut run, mut checks) = (String::new(), String::new(), String::new());
    let all = all();
    for (number, (drive, references)) in all.iter().zip(references).enumerate() {
        let (number, name) = (number + 1, &drive.name);
        let instance = instance(name);
        writeln!(vars, "    {instance} : Glapp{name};").unwrap();
        if !drive.before.is_empty() {
            writeln!(run, "        {}", drive.before).unwrap();
        }
        let (structures, set, call) = wired(name, drive.call);
        vars += &structures;
        run += &set;
        writeln!(run, "        {}", folded(&format!("{instance}({call});"))).unwrap();
        let mut names = names(name);
        let mut sums = String::new();
        let compared = drive.outputs.iter().filter(|output| !output.is_empty());
        for (place, (output, reference)) in compared.zip(references).enumerate() {
            let total = format!("{name}{}", place + 1);
            writeln!(vars, "    {total} : LREAL;").unwrap();
            writeln!(sums, "        {}", added(&mut names, &instance, output, &total)).unwrap();
            writeln!(
                checks,
                "        Check(Number := {number}, Value := {total}, Expected := {}, Tolerance := Tolerance);",
                literal(build, *reference)
            )
            .unwrap();
        }
        if drive.when.is_empty() {
            run += &sums;
        } else {
            let inner: String = sums.lines().map(|line| format!("    {line}\n")).collect();
            writeln!(run, "        IF {} THEN\n{inner}        END_IF;", drive.when).unwrap();
        }
    }
    let names = all.iter().enumerate().map(|(i, drive)| format!("{} {}", i + 1, drive.name));
    let mut draws = String::new();
    for letter in ["A", "B", "C", "D"] {
        let next = "Seed := (171 * (Seed MOD 177)) - (2 * (Seed / 177));";
        let wrap = "IF Seed < 0 THEN\n            Seed := Seed + 30269;\n        END_IF;";
        writeln!(draws, "        {next}\n        {wrap}\n        {letter} := INT_TO_LREAL(Seed) / 30269.0;").unwrap();
    }
    let list = names.collect::<Vec<_>>().join(", ");
    format!(
        "(* Drives every block for {SCANS} scans by numbers that are drawn the same everywhere, adds up what comes out, and
   compares the sums with those of the reference, within a tolerance and to the bit. The blocks by their numbers:
   {}.
   Written by `cargo run -p glapp-plc-check --example self_test`; not by hand. *)
PROGRAM GlappSelfTest
VAR_OUTPUT
    Done : BOOL;        (* all scans have run *)
    Passed : BOOL;      (* every sum lies within Tolerance of the reference *)
    Exact : BOOL;       (* every sum has the bits of the reference *)
    Block : INT;        (* the first block that failed, by its number above; 0: none *)
    Off : LREAL;        (* the largest difference: of that block, or of all where none failed *)
END_VAR
VAR CONSTANT
    Tolerance : LREAL := {tolerance};   (* as a share of 1 + the reference *)
    Scans : INT := {SCANS};
END_VAR
VAR
    Scan : INT;
    Seed : INT := 1;
    A : LREAL;
    B : LREAL;
    C : LREAL;
    D : LREAL;
    Turn : BOOL;
    Side : LREAL := 1.0;
    Gain : LREAL;
    Data : GlappHalfPeriodData;
    Previous : LREAL;
    DHat : LREAL;
    Plant : GlappProcessSim;
    Back : LREAL;
    Travel : LREAL;
    Check : GlappSelfCheck;
{vars}END_VAR
    IF Scan < Scans THEN
        Scan := Scan + 1;
        (* Four numbers from 0 to 1 (Lehmer's generator modulo 30269, without overflow in 16 bits). *)
{draws}{run}    ELSIF NOT Done THEN
{checks}        Done := TRUE;
        Block := Check.Failed;
        Passed := Block = 0;
        Exact := NOT Check.Inexact;
        Off := Check.Off;
    END_IF;
END_PROGRAM
",
        folded(&list).replace("\n            ", "\n   ")
    )
}

/// A line that is too long, broken at a comma.
fn folded(line: &str) -> String {
    let (mut out, mut length) = (String::new(), 0);
    for part in line.split_inclusive(", ") {
        if length + part.len() > 95 {
            out.truncate(out.trim_end().len());
            out += "\n            ";
            length = 0;
        }
        length += part.len();
        out += part;
    }
    out
}

/// The shortest literal that is this number.
fn literal(build: Build, x: f64) -> String {
    let text = if build == Build::Real { format!("{:?}", x as f32) } else { format!("{x:?}") };
    match text.split_once('e') {
        Some((mantissa, exponent)) if mantissa.contains('.') => format!("{mantissa}E{exponent}"),
        Some((mantissa, exponent)) => format!("{mantissa}.0E{exponent}"),
        None => text,
    }
}

/// The library's files with this program.
fn with(build: Build, program: &str) -> Vec<(String, String)> {
    let mut files = sources(&folder(), build).unwrap_or_else(|fault| panic!("{fault}"));
    files.retain(|(name, _)| name != "SelfTest.st");
    files.push(("SelfTest.st".into(), program.into()));
    files
}

/// The program as the command writes it: driven once in the evaluator, whose pins the core is given.
pub fn written<R: Number>() -> String {
    let all = all();
    let none: Vec<Vec<f64>> = all.iter().map(|drive| vec![0.0; drive.outputs.len()]).collect();
    let files = with(R::BUILD, &program(R::BUILD, &none));
    let files = files.iter().map(|(name, text)| (&**name, &**text));
    let library = Library::of(files, R::BUILD).unwrap_or_else(|fault| panic!("{fault}"));
    let mut one = Instance::new(&library, "GlappSelfTest").unwrap();
    let places: Vec<RefCell<Names>> = all.iter().map(|drive| RefCell::new(names(&drive.name))).collect();
    let mut cores = references::<R>();
    let mut totals: Vec<Vec<R>> = none.iter().map(|row| vec![R::ZERO; row.len()]).collect();
    for _ in 0..SCANS {
        one.call().unwrap_or_else(|fault| panic!("{fault}"));
        for (((drive, names), core), totals) in all.iter().zip(&places).zip(&mut cores).zip(&mut totals) {
            let peek = |name: &str| {
                one.peek(&format!("{}.{name}", instance(&drive.name))).unwrap_or_else(|fault| panic!("{fault}"))
            };
            let pin = |name: &str| {
                let place = names.borrow_mut().place(name);
                match place {
                    Place::Pin(path) => peek(&path),
                    // A pin is given where its value is not the initial one.
                    Place::Given(paths) => f64::from(paths.iter().any(|path| {
                        let begins = if path.ends_with(".Td") { -1.0 } else { names.borrow().begins(path) };
                        R::of(peek(path)) != R::of(begins)
                    })),
                    Place::Known(of, test, than) => {
                        let Place::Pin(path) = names.borrow_mut().place(of) else { panic!("no {of}") };
                        f64::from(known(test, peek(&path), than))
                    }
                }
            };
            let Some(row) = core(&pin) else { continue };
            for (total, value) in totals.iter_mut().zip(row) {
                if let Some(value) = maybe(value) {
                    *total += R::of(value);
                }
            }
        }
    }
    let compared = |drive: &Driven, totals: &[R]| {
        let all = drive.outputs.iter().zip(totals).filter(|(output, _)| !output.is_empty());
        all.map(|(_, total)| total.as_f64()).collect()
    };
    let references: Vec<Vec<f64>> = all.iter().zip(&totals).map(|(drive, totals)| compared(drive, totals)).collect();
    program(R::BUILD, &references)
}

/// Done, Passed, Exact, Block and Off in the end; none where the run stopped.
pub fn run(library: &Library) -> Option<[f64; 5]> {
    let mut one = Instance::new(library, "GlappSelfTest").ok()?;
    for _ in 0..=SCANS {
        one.call().ok()?;
    }
    Some(["Done", "Passed", "Exact", "Block", "Off"].map(|pin| one.get(pin).unwrap()))
}
