//! Signals, controller and autotuner: every vector, and random sequences with settings and inputs good and bad, the same bits as the
//! core in LREAL and REAL.
//!
//! `GLAPP_SEQUENCES=10000 cargo test -p glapp-plc-check --test twins control:: -- --nocapture` runs ten thousand of each and tells what a
//! scan costs.

use crate::common::control::{AUTO_TUNER, Core, Experiments, INSIDE, POUS, POWER_CUT, Row, TWINS, Twin, core, scan};
use crate::common::cover::{Cost, Cover, sequences};
use crate::common::{Block, Case, Draw, Number, cases, folder, same};
use glapp_core::NoiseState;
use glapp_plc_check::{Build, Instance};
use serde_json::Value;

fn flag(mask: f64, flag: u16) -> f64 {
    f64::from(mask as u16 & flag != 0)
}

/// A block of the library beside the core's.
struct Beside<'t> {
    twin: &'t Twin,
    core: Core,
    block: Block,
}

impl<'t> Beside<'t> {
    fn new<R: Number>(twin: &'t Twin) -> Self {
        Self { twin, core: core::<R>(twin), block: Block::new::<R>(twin.pou) }
    }

    /// A scan of both, which show the same; gives that.
    fn scan(&mut self, row: &Row, place: impl std::fmt::Display) -> Vec<f64> {
        let (expected, shown) = ((self.core)(row), scan(self.twin, &self.block, row));
        assert!(same(&expected, &shown), "{} {place}: {shown:?} instead of {expected:?} for {row:?}", self.twin.name);
        shown
    }
}

/// A row of a vector by the pins.
fn of_vector(twin: &Twin, case: &Case, x: &[f64], h: f64) -> Row {
    let given = |name| case.given(name);
    let or_zero = |name| case.param(name).unwrap_or(0.0);
    let mut row = match twin.name {
        "noise" => Row::new(twin, &[("Seed", given("integer")), ("Amplitude", given("amplitude")), ("X", x[0])]),
        "backlash" => {
            let mut row = Row::new(twin, &[("D", given("d")), ("X", x[0])]);
            row.option("Start", case.param("output"));
            row
        }
        "saturation" => Row::new(twin, &[("Low", given("low")), ("High", given("high")), ("X", x[0])]),
        "rate_limit" => Row::new(twin, &[("Rate", given("rate")), ("X", x[0])]),
        "phase_lead" => Row::new(twin, &[("Lead", given("lead")), ("Lag", given("lag")), ("X", x[0])]),
        "process_sim" => {
            let times = [("T1", given("t1")), ("T2", or_zero("t2")), ("DeadTime", or_zero("dead_time"))];
            let rest = [("Gain", given("gain")), ("Start", or_zero("start")), ("X", x[0]), ("Load", x[1])];
            let mut row = Row::new(twin, &[&times[..], &rest].concat());
            row.set("H", given("h"));
            return row;
        }
        "pid" => {
            let law = [("K", given("k")), ("Ti", given("ti")), ("Td", given("td")), ("B", given("b"))];
            let mut row = Row::new(twin, &[&law[..], &[("Ysp", x[0]), ("Yf", x[1])]].concat());
            row.option("U", Some(x[2]).filter(|u| !u.is_nan()));
            if let (Some(low), Some(high)) = (case.param("low"), case.param("high")) {
                row.set_all(&[("HasLimits", 1.0), ("Low", low), ("High", high)]);
            }
            row
        }
        "pid_module" => {
            let law =
                [("K", given("k")), ("Ti", given("ti")), ("Td", or_zero("td")), ("B", case.param("b").unwrap_or(1.0))];
            let rest = [("Enable", 1.0), ("C", or_zero("c")), ("Tf", or_zero("tf")), ("Start", given("start"))];
            let mut row = Row::new(twin, &[&law[..], &rest].concat());
            for (pin, name) in [("Low", "low"), ("High", "high"), ("Rate", "rate")] {
                row.option(pin, case.param(name));
            }
            let inputs = [("Pv", x[0]), ("Sp", x[1]), ("Ff", x[2]), ("Mode", if x[3].is_nan() { -1.0 } else { x[3] })];
            row.set_all(&inputs);
            for (pin, value) in [("OwnSp", x[4]), ("ManualOutput", x[5])] {
                row.option(pin, Some(value).filter(|value| !value.is_nan()));
            }
            let back = [("HasBackLimits", 1.0), ("BackLow", x[6]), ("BackHigh", x[7]), ("BackTracking", x[9])];
            row.set_all(&back);
            let flags = [("BackNotAuto", 1), ("BackAtLow", 4), ("BackAtHigh", 8)];
            row.set_all(&flags.map(|(pin, bit)| (pin, flag(x[8], bit))));
            row
        }
        "auto_tuner" => {
            let starts = !x[2].is_nan();
            let mut row = Row::new(twin, &[("Take", 1.0), ("Pv", x[0]), ("Starts", f64::from(starts))]);
            row.set("OpBefore", if starts { x[2] } else { 0.0 });
            let flags = [("NotAuto", 1), ("Bad", 2), ("AtLow", 4), ("AtHigh", 8), ("Gap", 16)];
            row.set_all(&flags.map(|(pin, bit)| (pin, flag(x[1], bit))));
            tuner_settings(&mut row, case, "Used.");
            row
        }
        "auto_tuner_module" => {
            let inputs = [("Enable", 1.0), ("Execute", x[2]), ("X", x[0]), ("Pv", x[1]), ("BackTracking", x[4])];
            let mut row = Row::new(twin, &inputs);
            let flags = [("BackNotAuto", 1), ("BackAtLow", 4), ("BackAtHigh", 8)];
            row.set_all(&flags.map(|(pin, bit)| (pin, flag(x[3], bit))));
            tuner_settings(&mut row, case, "");
            row.set("Amplitude", x[5]);
            row
        }
        other => panic!("{other}"),
    };
    if twin.pins.contains(&"H") {
        row.set("H", h);
    }
    row
}

fn tuner_settings(row: &mut Row, case: &Case, within: &str) {
    let names = [
        ("Amplitude", "amplitude"),
        ("D", "d"),
        ("WaitTime", "wait"),
        ("Longest", "longest"),
        ("MaxH", "max_h"),
        ("PvLow", "pv_low"),
        ("PvHigh", "pv_high"),
        ("OpLow", "op_low"),
        ("OpHigh", "op_high"),
        ("RelayHysteresis", "relay_hysteresis"),
    ];
    for (pin, name) in names {
        row.set(&format!("{within}{pin}"), case.param(name).unwrap_or(0.0));
    }
    row.set(&format!("{within}HasRelayHysteresis"), f64::from(case.param("relay_hysteresis").is_some()));
}

/// Outputs as columns of the vectors.
fn as_vector(twin: &Twin, shown: &[f64]) -> Vec<f64> {
    let at = |pin: &str| shown[twin.shown.iter().position(|one| one.ends_with(pin)).unwrap()];
    match twin.name {
        "pid_module" => {
            let sum = |flags: &[(&str, f64)]| {
                let place = |pin: &str| twin.shown.iter().position(|one| *one == pin).unwrap();
                flags.iter().map(|(pin, bit)| shown[place(pin)] * bit).sum::<f64>()
            };
            let error = sum(&[("Bad", 2.0), ("Gap", 16.0), ("BadSp", 32.0), ("BadFf", 64.0), ("BadLimits", 128.0)]);
            vec![at("Output"), at("Ysp"), at("Yf"), error, sum(&[("NotAuto", 1.0), ("AtLow", 4.0), ("AtHigh", 8.0)])]
        }
        "auto_tuner" => shown[..9].to_vec(),
        "auto_tuner_module" => {
            let place = |pin: &str| twin.shown.iter().position(|one| one.split('?').next_back() == Some(pin)).unwrap();
            let of = |pin: &str| shown[place(pin)];
            let flags = of("NotAuto") + 4.0 * of("AtLow") + 8.0 * of("AtHigh");
            let found = ["Phase", "StopReason", "ErrorID", "Ku", "Tu", "Kp", "Kappa"].map(of);
            [&[of("Y"), flags, of("Tracking")][..], &found].concat()
        }
        _ => vec![shown[0]],
    }
}

fn vectors<R: Number>() {
    let with_vectors = R::BUILD == Build::Lreal;
    for twin in TWINS.iter().chain([&AUTO_TUNER]) {
        for case in cases(twin.name) {
            let mut both = Beside::new::<R>(twin);
            for (i, (h, x)) in case.input.iter().enumerate() {
                let row = of_vector(twin, &case, x, *h);
                let got = both.scan(&row, format_args!("{}, scan {i}", case.name));
                if with_vectors {
                    let number = |value: &Value| value.as_f64().unwrap_or(f64::NAN);
                    let output = &case.output.as_ref().unwrap()[i];
                    let expected =
                        output.as_array().map_or(vec![number(output)], |row| row.iter().map(number).collect());
                    let shown = as_vector(twin, &got);
                    assert!(same(&expected, &shown), "{}, scan {i}: {shown:?} instead of {expected:?}", case.name);
                }
            }
        }
    }
}

in_both!(vectors_lreal, vectors_real: vectors);

const NONE: [f64; 3] = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY];

/// A loop for a block to be in: what its pins hold next, from what it showed last.
struct Signals {
    usual: Row,
    row: Row,
    level: f64,
    scale: f64,
    grid: f64,
    wrong: f64,
    settings: &'static [&'static str],
    process: Process,
    scans: usize,
}

/// Lags of 1 s in a row, the last one an integrator or not.
struct Process {
    x: [f64; 3],
    order: usize,
    integrating: bool,
    gain: f64,
    noise: f64,
    load: f64,
    rest: f64,
    /// Time constants are shorter by this, and what comes out is late by so many scans.
    fast: f64,
    late: Vec<f64>,
    delay: usize,
    /// A load takes off what the bias of the second phase brings.
    cancels: bool,
}

impl Process {
    fn step(&mut self, op: f64, h: f64, draw: &mut Draw) -> f64 {
        let h = if h > 0.0 && h < 2.0 { h } else { 0.2 };
        for _ in 0..10 {
            for i in 0..self.order {
                let before = if i == 0 { self.gain * (op - self.rest + self.load) } else { self.x[i - 1] };
                let falls = if self.integrating && i + 1 == self.order { 0.0 } else { self.x[i] };
                self.x[i] += 0.1 * h * self.fast * (before - falls);
            }
        }
        self.late.push(self.x[self.order - 1]);
        self.late[self.late.len().saturating_sub(1 + self.delay)] + self.noise * draw.between(-1.0, 1.0)
    }
}

impl Signals {
    fn new(twin: &Twin, d: &mut Draw) -> Self {
        let k = d.of(&[0.5, -0.7, 2.0, 1e-3]);
        let law =
            [("K", k), ("Ti", d.between(0.3, 3.0)), ("Td", d.of(&[0.0, 0.0, 0.3])), ("B", d.of(&[1.0, 0.0, 0.4]))];
        let given: Vec<(&str, f64)> = match twin.name {
            "noise" => {
                vec![("Seed", d.of(&[1.0, 0.0, -5.0, 2_147_483_647.0, 12345.0])), ("Amplitude", d.of(&[0.0, 0.1, 3.0]))]
            }
            "backlash" => {
                vec![("D", d.of(&[0.0, 0.1, 1.0])), ("HasStart", d.of(&[0.0, 1.0])), ("Start", d.of(&[0.3, f64::NAN]))]
            }
            "saturation" => vec![("Low", d.between(-1.0, 0.0)), ("High", d.between(0.1, 1.0))],
            "rate_limit" => vec![("Rate", d.of(&[0.1, 1.0, 1e-6, 1e36]))],
            "phase_lead" => {
                let lag = d.of(&[0.1, 1.0, 1e3]);
                vec![("Lag", lag), ("Lead", lag * d.of(&[1.0, 2.0, 10.0]))]
            }
            "process_sim" => vec![
                ("Gain", d.of(&[1.0, -2.0, 1e20])),
                ("T1", d.of(&[0.0, 1.0, 30.0])),
                ("T2", d.of(&[0.0, 0.3])),
                ("DeadTime", d.of(&[0.0, 0.1, 0.7, 0.25, 6.2])),
                ("H", 0.1),
                ("Start", d.of(&[0.0, 3.0, f64::NAN])),
            ],
            "pid" => [&law[..], &[("HasLimits", d.of(&[0.0, 1.0])), ("Low", -0.4), ("High", 0.6)]].concat(),
            "pid_module" => {
                let usual = [
                    ("Enable", 1.0),
                    ("C", d.of(&[0.0, 0.0, 0.7])),
                    ("Tf", d.of(&[0.0, 0.2])),
                    ("Start", d.of(&[0.0, 0.3, f64::NAN])),
                    ("Mode", d.of(&[1.0, 2.0])),
                    ("HasLow", d.of(&[0.0, 1.0])),
                    ("HasHigh", d.of(&[0.0, 1.0])),
                    ("Low", -0.8),
                    ("High", 0.9),
                    ("HasRate", d.of(&[0.0, 1.0])),
                    ("Rate", d.of(&[0.5, 3.0, 1e36])),
                    ("HasMaxH", d.of(&[0.0, 1.0])),
                    ("MaxH", d.of(&[0.3, 1.0, 1e30])),
                ];
                [&law[..], &usual].concat()
            }
            "auto_tuner_module" => vec![
                ("Enable", 1.0),
                ("Amplitude", d.of(&[3.0, 3.0, 3.0, -3.0])),
                ("HasRelayHysteresis", d.of(&[0.0, 0.0, 1.0])),
                ("RelayHysteresis", d.of(&[0.05, 0.6])),
                ("D", d.of(&[0.0, 0.5])),
                ("WaitTime", 2.0),
                ("Longest", d.of(&[120.0, 120.0, 20.0, 250.0])),
                ("MaxH", 1.0),
                ("PvLow", -9.0),
                ("PvHigh", d.of(&[9.0, 9.0, 9.0, 0.5])),
                ("OpLow", 0.0),
                ("OpHigh", d.of(&[10.0, 10.0, 8.0])),
                ("Rule", d.of(&[1.0, 2.0, 3.0, 0.0])),
            ],
            "auto_tuner" => return Self::of(Row::new(twin, &[]), &[], d),
            other => panic!("{other}"),
        };
        let settings: &[&str] = match twin.name {
            "noise" => &["Amplitude"],
            "backlash" => &["D"],
            "saturation" => &["Low", "High"],
            "rate_limit" => &["Rate"],
            "phase_lead" => &["Lead", "Lag"],
            "process_sim" => &["Gain", "T1", "T2", "DeadTime", "H"],
            "pid_module" => &["K", "Ti", "Td", "B", "C", "Tf", "Low", "High", "Rate", "MaxH"],
            "auto_tuner_module" => &[
                "Amplitude", "RelayHysteresis", "D", "WaitTime", "Longest", "MaxH", "PvLow", "PvHigh", "OpLow",
                "OpHigh", "Rule",
            ],
            _ => &[],
        };
        let mut signals = Self::of(Row::new(twin, &given), settings, d);
        if twin.name == "auto_tuner_module" && d.chance(0.6) {
            // One that comes to its end.
            let gain = d.of(&[1.0, 1.0, -1.0]);
            let noise = d.of(&[0.0, 0.02]);
            let integrating = d.chance(0.3);
            let (order, load) = (3, d.of(&[0.0, 0.0, 1.5, -1.5]));
            signals.process = Process { order, gain, noise, load, integrating, ..signals.process };
            if d.chance(0.3) {
                // Nearly all dead time.
                let (order, fast, delay, integrating) = (1, 5.0, 8, false);
                signals.process = Process { order, fast, delay, integrating, load: 0.0, ..signals.process };
            } else if d.chance(0.2) {
                signals.process = Process { cancels: true, load: 0.0, integrating: false, ..signals.process };
            }
            signals.wrong = d.of(&[0.0, 0.0, 0.01]);
            let usual = [("HasRelayHysteresis", 0.0), ("Longest", 250.0), ("PvHigh", 9.0)];
            signals.usual.set_all(&usual);
            // A start as near to the limits as is allowed.
            let any = d.between(2.0, 4.0);
            let most = d.of(&[3.0, any]);
            signals.usual.set_all(&[("Amplitude", most * gain), ("OpLow", 5.0 - most), ("OpHigh", 5.0 + most)]);
            signals.row = signals.usual.clone();
        }
        signals
    }

    fn of(row: Row, settings: &'static [&'static str], d: &mut Draw) -> Self {
        let process = Process {
            x: [0.0; 3],
            order: d.of(&[3, 3, 3, 2, 1]),
            integrating: d.chance(0.15),
            gain: d.of(&[1.0, 1.0, 1.0, -1.0, 0.0, 0.3]),
            noise: d.of(&[0.0, 0.0, 0.02, 0.3]),
            load: d.of(&[0.0, 0.0, 0.6, -1.5, 2.5]),
            rest: 5.0,
            fast: 1.0,
            late: vec![],
            delay: 0,
            cancels: false,
        };
        Self {
            usual: row.clone(),
            row,
            level: 0.0,
            scale: d.of(&[1.0, 1.0, 1e-6, 1e6]),
            grid: d.of(&[0.0, 0.0, 0.1, 0.5]),
            wrong: d.of(&[0.0, 0.01, 0.05]),
            settings,
            process,
            scans: 0,
        }
    }

    fn or_none(&self, d: &mut Draw, x: f64) -> f64 {
        if d.chance(self.wrong) { d.of(&NONE) } else { x }
    }

    fn walk(&mut self, d: &mut Draw) -> f64 {
        self.level = (self.level + d.between(-0.3, 0.3)).clamp(-1.5, 1.5);
        if self.grid > 0.0 {
            self.level = (self.level / self.grid).round() * self.grid;
        }
        let x = self.level * self.scale;
        self.or_none(d, x)
    }

    /// Pins of the next scan.
    fn next(&mut self, last: &[f64], d: &mut Draw) -> Row {
        self.scans += 1;
        let pins = self.row.pins;
        let has = |pin: &str| pins.contains(&pin);
        if !self.settings.is_empty() && d.chance(2.0 * self.wrong) {
            // Settings come back; sometimes one is changed, or spoilt.
            for pin in self.settings {
                let value = self.usual.get(pin);
                self.row.set(pin, value);
            }
            if d.chance(0.7) {
                let pin = d.of(self.settings);
                let usual = self.usual.get(pin);
                let large = if has("Execute") { 1e31 } else { 1e20 };
                let wrong = d.of(&[f64::NAN, f64::INFINITY, f64::NEG_INFINITY, -2.0, 0.0, 2.0, large]);
                let value = if d.chance(0.4) { usual * d.between(0.5, 1.5) } else { wrong };
                self.row.set(pin, if pin == "Rule" { d.of(&[1.0, 2.0, 3.0, 7.0]) } else { value });
            }
        }
        for pin in [POWER_CUT, "Reset", "Restart", "Clear"] {
            if has(pin) {
                let value = f64::from(d.chance(0.1 * self.wrong));
                self.row.set(pin, value);
            }
        }
        for pin in ["XBad", "LoadBad", "PvBad", "SpBad", "FfBad", "BackAtLow", "BackAtHigh", "BackNotAuto"] {
            if has(pin) {
                let value = f64::from(d.chance(self.wrong));
                self.row.set(pin, value);
            }
        }
        if has("H") && !self.settings.contains(&"H") {
            let h = if has("Execute") { 0.2 } else { 0.1 };
            let odd = d.of(&[0.0, -0.1, 5.0, f64::NAN, f64::INFINITY, 0.05, 1e-6]);
            let h = if d.chance(self.wrong) { odd } else { h };
            let h = if self.scans < 3 && self.wrong > 0.0 { 0.0 } else { h };
            self.row.set("H", h);
        }
        if has("BackTracking") {
            let value = d.between(-0.5, 0.5);
            let value = self.or_none(d, value);
            self.row.set("BackTracking", value);
        }
        if has("HasBackLimits") && d.chance(2.0 * self.wrong) {
            let limits =
                d.of(&[(-0.2, 0.4), (0.5, -0.5), (f64::NAN, 0.2), (-5.0, -2.0), (0.1, f64::NAN), (-1e30, 1e30)]);
            self.row.set("HasBackLimits", f64::from(d.chance(0.7)));
            self.row.set("BackLow", limits.0);
            self.row.set("BackHigh", limits.1);
        }
        if has("Enable") {
            let on = f64::from(!d.chance(0.2 * self.wrong));
            self.row.set("Enable", on);
        }
        if has("Execute") {
            // An experiment on a process, begun again and again.
            let y = last.get(3).copied().filter(|y| y.is_finite()).unwrap_or(5.0);
            let h = self.row.get("H");
            if self.process.cancels && last.len() > 13 {
                self.process.load = if last[10] == 3.0 { -last[13] } else { 0.0 };
            }
            let pv = self.process.step(y, h, d);
            let pv = self.or_none(d, pv);
            self.row.set("Pv", pv);
            let x = if self.scans % 450 < 225 { 5.0 } else { 4.5 };
            let x = self.or_none(d, x);
            self.row.set("X", x);
            let run = self.row.on("Execute");
            let toggles = if run { d.chance(0.1 * self.wrong) } else { d.chance(0.2) };
            let ended = last.get(9) == Some(&0.0) && d.chance(0.1);
            self.row.set("Execute", f64::from((run != toggles) && !ended));
            for pin in ["BackAtLow", "BackAtHigh", "BackNotAuto", "PvBad"] {
                let value = f64::from(d.chance(0.05 * self.wrong));
                self.row.set(pin, value);
            }
            return self.row.clone();
        }
        for pin in ["X", "Load", "Pv", "Ysp", "Yf"] {
            if has(pin) {
                let value = self.walk(d);
                self.row.set(pin, value);
            }
        }
        if has("HasU") {
            let u = d.between(-1.0, 1.0);
            let u = self.or_none(d, u);
            self.row.option("U", if d.chance(0.1) { Some(u) } else { None });
        }
        if has("Mode") {
            for (pin, share) in [("Sp", 0.05), ("Ff", 0.1)] {
                if d.chance(share) {
                    let value = d.between(-1.0, 1.0) * self.scale;
                    let value = self.or_none(d, value);
                    self.row.set(pin, value);
                }
            }
            if d.chance(0.3 * self.wrong + 0.01) {
                let mode = d.of(&[0.0, 1.0, 2.0, -1.0, 3.0]);
                self.row.set("Mode", mode);
                for pin in ["OwnSp", "ManualOutput"] {
                    let value = d.between(-2.0, 2.0);
                    let value = self.or_none(d, value);
                    self.row.option(pin, if d.chance(0.5) { Some(value) } else { None });
                }
            }
        }
        self.row.clone()
    }
}

/// Inputs at which a controller overflows: numbers at the ends of the range. Nothing stops; the library calls too large
/// what is beyond 1E37.
fn extreme(row: &mut Row, d: &mut Draw) {
    let pins = [
        "X", "Load", "Pv", "Sp", "Ff", "OwnSp", "ManualOutput", "K", "Ti", "Td", "Rate", "MaxH", "H", "Gain", "Lead",
        "Lag", "Start",
    ];
    for pin in pins {
        if row.pins.contains(&pin) && d.chance(0.2) {
            let value = d.of(&[1e36, -1e36, 1e-36, 1e20, -1e20, 1e-20]);
            // The law by itself is not asked for times below 0: its settings are checked by who calls it.
            let law = row.pins.contains(&"HasU") && ["Ti", "Td"].contains(&pin);
            row.set(pin, if law { f64::abs(value) } else { value });
        }
    }
}

fn random<R: Number>() {
    let mut cover = Cover::new::<R>();
    let mut done = 0;
    for twin in TWINS.iter().filter(|twin| twin.name != "auto_tuner").chain([&AUTO_TUNER]) {
        let mut cost = Cost::default();
        let scans = if twin.name == "auto_tuner_module" { 450 } else { 120 };
        let mut refused = 0;
        for seed in 0..sequences() {
            let mut draw = Draw::new(seed + 1);
            let mut signals = Signals::new(twin, &mut draw);
            let mut both = Beside::new::<R>(twin);
            let (block, mut shown) = (both.block.clone(), vec![]);
            for i in 0..scans {
                let row = signals.next(&shown, &mut draw);
                shown = cost.of(&block, || both.scan(&row, format_args!("{seed}, scan {i}")));
                refused += u64::from(twin.shown.contains(&"Error") && block.on("Error"));
                if twin.pins.contains(&"Execute") && !block.on("HasOffer") {
                    assert_eq!(block.all(&["OfferK", "OfferTi", "OfferTd"]), [0.0; 3]);
                }
                done += u64::from(twin.pins.contains(&"Execute") && block.get("Phase") == 4.0);
            }
            cover.collect(&block);
        }
        cost.tell::<R>(twin.pou);
        println!("{refused} scans with a setting out of bounds");
        assert!(twin.name == "pid" || refused > sequences(), "{}: {refused}", twin.name);
    }
    println!("{done} scans after an experiment that came to its end");
    assert!(done > sequences());
    for twin in TWINS.iter().filter(|twin| twin.name != "auto_tuner").chain([&AUTO_TUNER]) {
        for seed in 0..sequences() {
            let mut draw = Draw::new(7000 + seed);
            let mut signals = Signals::new(twin, &mut draw);
            let (block, mut shown) = (Block::new::<R>(twin.pou), vec![]);
            block.unheld();
            for _ in 0..60 {
                let mut row = signals.next(&shown, &mut draw);
                extreme(&mut row, &mut draw);
                shown = scan(twin, &block, &row);
            }
            cover.collect(&block);
        }
    }
    large::<R>();
    coarse::<R>();
    endless_dead_time::<R>();
    told_before_it_is_good::<R>();
    begins_beyond_numbers::<R>();
    two_at_the_ends::<R>(&mut cover);
    beyond_numbers::<R>();
    experiments::<R>(&mut cover);
    waves::<R>(&mut cover);
    no_offer::<R>(&mut cover);
    rules::<R>(&mut cover);
    another_version::<R>(&mut cover);
    // Branches that only the block around it takes are taken there.
    let inside = |line: &str| INSIDE.iter().any(|begin| line.starts_with(begin));
    cover.holds_but(&POUS, |way, line| inside(line) || (line.contains("2147483647") && way.branch == 1));
}

/// Each number by itself so large that it is one, and beyond what can be measured: from the first scan on, and later.
fn large<R: Number>() {
    for twin in TWINS.iter().filter(|twin| twin.name != "auto_tuner").chain([&AUTO_TUNER]) {
        let is_number = |pin: &str| Instance::new(R::library(), twin.pou).unwrap().set(pin, 0.5).is_ok();
        // The law by itself is asked for no settings that its caller refuses.
        let law = |pin: &str| twin.name == "pid" && ["Ti", "Td"].contains(&pin);
        let is_number = |pin: &str| is_number(pin) && !(twin.name == "pid" && ["B", "Low", "High"].contains(&pin));
        for pin in twin.pins.iter().filter(|pin| is_number(pin)) {
            for (from, value) in [(0, 1e33), (3, 1e33), (3, -1e33)] {
                if law(pin) && value < 0.0 {
                    continue;
                }
                let mut draw = Draw::new(9);
                let mut signals = Signals { wrong: 0.0, scale: 1.0, ..Signals::new(twin, &mut draw) };
                let (mut both, mut shown) = (Beside::new::<R>(twin), vec![]);
                for i in 0..8 {
                    let mut row = signals.next(&shown, &mut draw);
                    if row.pins.contains(&"Mode") {
                        row.set("Mode", 2.0);
                    }
                    if (from..from + 2).contains(&i) {
                        let has = format!("Has{pin}");
                        if twin.pins.contains(&&*has) {
                            row.set(&has, 1.0);
                        }
                        row.set(pin, value);
                    }
                    shown = both.scan(&row, format_args!("{pin} {value}, scan {i}"));
                }
            }
        }
    }
}

/// More scans of dead time than there are numbers.
fn endless_dead_time<R: Number>() {
    let twin = TWINS.iter().find(|twin| twin.name == "process_sim").expect("it is there");
    let mut both = Beside::new::<R>(twin);
    for (h, dead_time) in [(0.1, 0.3), (1e-6, 1e33), (0.1, 0.3)] {
        let row = Row::new(twin, &[("Gain", 1.0), ("T1", 1.0), ("H", h), ("DeadTime", dead_time), ("X", 1.0)]);
        both.scan(&row, h);
    }
}

/// Signals and times of a few values, so that bounds are met exactly; blocks that begin anew in the middle of everything.
fn coarse<R: Number>() {
    for twin in TWINS.iter().filter(|twin| twin.name != "auto_tuner").chain([&AUTO_TUNER]) {
        for seed in 0..40 {
            let mut draw = Draw::new(8000 + seed);
            let mut signals = Signals { wrong: 0.02, scale: 1.0, grid: 0.5, ..Signals::new(twin, &mut draw) };
            let (mut both, mut shown, mut still) = (Beside::new::<R>(twin), vec![], 0);
            for i in 0..100 {
                let mut row = signals.next(&shown, &mut draw);
                let d = &mut draw;
                let anew = d.chance(0.05);
                still = if anew && d.chance(0.5) { 3 } else { i32::max(still - 1, 0) };
                for pin in ["X", "Load", "Pv", "Sp", "Ff", "Ysp", "Yf", "BackTracking"] {
                    if row.pins.contains(&pin) && !row.pins.contains(&"Execute") {
                        row.set(pin, d.of(&[-1.0, -0.5, 0.0, 0.5, 1.0]));
                    }
                }
                for (pin, share) in [("XBad", 0.2), ("BackAtLow", 0.1), ("BackAtHigh", 0.1), ("BackNotAuto", 0.1)] {
                    if row.pins.contains(&pin) && !row.pins.contains(&"Execute") {
                        row.set(pin, f64::from(d.chance(share)));
                    }
                }
                for pin in ["Clear", "Reset", "Restart"] {
                    if row.pins.contains(&pin) {
                        row.set(pin, f64::from(anew && d.chance(0.7)));
                    }
                }
                if row.pins.contains(&"H") && !signals.settings.contains(&"H") {
                    let longest = if row.pins.contains(&"MaxH") { row.get("MaxH") } else { 1e9 };
                    let h = d.of(&[0.1, 0.1, 0.1, 0.1, longest]);
                    row.set("H", if still > 0 { 0.0 } else { h });
                }
                shown = both.scan(&row, format_args!("{seed}, scan {i}"));
            }
        }
    }
}

/// Settings and signals that are good but for two, at the ends of what is a number: nothing stops.
fn two_at_the_ends<R: Number>(cover: &mut Cover) {
    for twin in TWINS.iter().filter(|twin| twin.name != "auto_tuner") {
        let within = |pin: &&&str| {
            let law = twin.name == "pid" && ["B", "Low", "High"].contains(*pin);
            !law && Instance::new(R::library(), twin.pou).unwrap().set(pin, 0.5).is_ok()
        };
        let numbers: Vec<&str> = twin.pins.iter().filter(within).copied().collect();
        for seed in 0..if numbers.len() > 8 { 250 } else { 60 } {
            let mut draw = Draw::new(9000 + seed);
            let mut signals = Signals { wrong: 0.0, scale: 1.0, ..Signals::new(twin, &mut draw) };
            if twin.pins.contains(&"C") {
                signals.row.set_all(&[("C", 0.7), ("Td", 0.3), ("HasRate", 1.0), ("HasMaxH", 1.0), ("MaxH", 1.0)]);
            }
            let (one, other) = (draw.of(&numbers), draw.of(&numbers));
            let ends = [1e36, 1e36, 9e36, 1e33, 1e20, 1e-36, 1e-20];
            let (a, b) = (draw.of(&ends), draw.of(&ends));
            let block = Block::new::<R>(twin.pou);
            block.unheld();
            let mut shown = vec![];
            for i in 0..6 {
                let mut row = signals.next(&shown, &mut draw);
                if i > 1 {
                    row.set_all(&[(one, a), (other, b)]);
                }
                shown = scan(twin, &block, &row);
            }
            cover.collect(&block);
        }
    }
}

/// Results beyond 1E37 are no numbers here: the law holds its output, and a setpoint adds no derivative. The widest gap
/// that an experiment may know of.
fn beyond_numbers<R: Number>() {
    let law = Block::new::<R>("GlappPidLaw");
    law.set_all(&[("K", 1.0), ("Ti", 1.0), ("B", 1.0), ("H", 1.0)]);
    for (ysp, output) in [(1.0, 2.0), (6e36, 2.0), (3e36, 6e36)] {
        law.set("Ysp", ysp);
        law.call();
        assert!((law.get("Output") / output - 1.0).abs() < 1e-6, "{ysp}: {}", law.get("Output"));
    }
    let shown = [0.0, 1.0].map(|c| {
        let pid = Block::new::<R>("GlappPid");
        let law = [("Enable", 1.0), ("K", 1e-30), ("Ti", 1.0), ("Td", 1e36), ("H", 0.1), ("C", c), ("Mode", 2.0)];
        pid.set_all(&law);
        for sp in [0.0, 0.0, 1e32, 1e32] {
            pid.set("Sp", sp);
            pid.call();
        }
        pid.get("Output")
    });
    assert!(shown[0] == shown[1] && shown[0] != 0.0, "{shown:?}");
    let twin = TWINS.iter().find(|twin| twin.name == "saturation").expect("it is there");
    let mut limits = Beside::new::<R>(twin);
    for (low, high) in [(-1.0, 1.0), (0.5, 0.5), (0.5, 0.75)] {
        let row = Row::new(twin, &[("Low", low), ("High", high), ("X", 2.0)]);
        limits.scan(&row, low);
    }
    let most = R::MOST.as_f64();
    let mut both = Beside::new::<R>(&AUTO_TUNER);
    let usual = [("Enable", 1.0), ("Amplitude", most), ("WaitTime", 2.0), ("Longest", 99.0), ("MaxH", 1.0), ("H", 0.2)];
    let limits = [("PvLow", -9.0), ("PvHigh", 9.0), ("OpLow", -most), ("OpHigh", most), ("Rule", 1.0)];
    let mut row = Row::new(&AUTO_TUNER, &[&usual[..], &limits].concat());
    for d in [1.0, 1.2 * most, 1.4 * most] {
        row.set("D", d);
        both.scan(&row, d);
    }
}

/// A gain that makes no number of the error, in the scans in which a controller begins anew or is set by hand: it goes on from there as the
/// core does. In LREAL that is a number in the core.
fn begins_beyond_numbers<R: Number>() {
    let twin = TWINS.iter().find(|twin| twin.name == "pid_module").expect("it is there");
    let usual =
        [("Enable", 1.0), ("K", 1.0), ("Ti", 1.0), ("Td", 0.5), ("B", 1.0), ("H", 0.1), ("Mode", 2.0), ("Sp", 1.0)];
    for (number, by) in ["Reset", "Restart", "BackNotAuto"].into_iter().enumerate() {
        let (mut reference, block) = (core::<R>(twin), Block::new::<R>(twin.pou));
        if R::BUILD == Build::Lreal {
            block.unheld();
        }
        for i in 0..40 {
            let mut row = Row::new(twin, &usual);
            row.set_all(&[("Pv", 0.1 * f64::from(i % 7)), (by, f64::from(i == 20)), ("BackTracking", 3.0)]);
            if (20..24).contains(&i) {
                row.set_all(&[("K", 1e30), ("Pv", -1e10)]);
            }
            let (expected, shown) = (reference(&row), scan(twin, &block, &row));
            let agree = R::BUILD == Build::Lreal || same(&expected, &shown);
            assert!(agree, "{number}, scan {i}: {shown:?} instead of {expected:?} for {row:?}");
        }
    }
}

/// Settings received before any were good, or before a new start, do not begin an experiment.
fn told_before_it_is_good<R: Number>() {
    for pin in ["BackNotAuto", "BackAtLow", "BackAtHigh"] {
        let mut both = Beside::new::<R>(&AUTO_TUNER);
        let usual = [("Enable", 1.0), ("Amplitude", 3.0), ("WaitTime", 2.0), ("Longest", 99.0), ("MaxH", 1.0)];
        let limits = [("PvLow", -9.0), ("PvHigh", 9.0), ("OpHigh", 10.0), ("X", 5.0), ("H", 0.2), ("Rule", 1.0)];
        let usual = Row::new(&AUTO_TUNER, &[&usual[..], &limits].concat());
        // Whether the settings are good, it was told, it begins anew, an experiment is asked for.
        let scans = [
            (false, true, false, false),
            (true, false, false, true),
            (true, false, false, true),
            (true, true, false, false),
            (false, true, true, false),
            (true, false, false, true),
            (true, false, false, true),
        ];
        for (i, (good, is_set, reset, run)) in scans.into_iter().enumerate() {
            let mut row = usual.clone();
            row.set_all(&[(pin, f64::from(is_set)), ("Reset", f64::from(reset)), ("Execute", f64::from(run))]);
            if !good {
                row.set("MaxH", -1.0);
            }
            both.scan(&row, format_args!("{pin}, scan {i}"));
            assert_eq!(both.block.on("Busy"), run);
        }
    }
}

/// Experiments on waves that no process makes, with numbers at the ends of what is one; and those of the vectors.
fn experiments<R: Number>(cover: &mut Cover) {
    let twin = &TWINS[8];
    for case in cases(twin.name) {
        let block = Block::new::<R>(twin.pou);
        block.unheld();
        for (h, x) in &case.input {
            scan(twin, &block, &of_vector(twin, &case, x, *h));
        }
        cover.collect(&block);
    }
    // PV balanced and biased, its mean when biased, amplitude, time between scans at first and then; whether the core has the same.
    let ends = [
        (1.0, 1.0, 0.0, 3.0, 0.2, 0.2, true),
        (1.0, 1.0, 0.3, 3.0, 0.2, 0.2, true),
        (1.0, 1e-6, 0.0, 3.0, 0.2, 0.2, true),
        (1.0, 1.0, 0.3, 3.0, 1e-40, 0.2, true),
        (9e11, 9e11, 0.0, 3.0, 1e7, 1e7, false),
        (1.0, 1.0, 0.0, 1e11, 1e8, 1e8, false),
        (1e9, 1e10, 1e9, 3.0, 1e7, 1e7, false),
        (1e-30, 1e-30, 0.0, 1e11, 0.2, 0.2, false),
    ];
    for (number, (size, later, mean, amplitude, first, h, compared)) in ends.into_iter().enumerate() {
        let (mut reference, block) = (core::<R>(twin), Block::new::<R>(twin.pou));
        if !compared {
            block.unheld();
        }
        let within = |pin: &str| format!("Used.{pin}");
        let mut row = Row::new(twin, &[("Take", 1.0), ("Starts", 1.0)]);
        let limits = [("PvLow", -1e12), ("PvHigh", 1e12), ("OpLow", -1e12), ("OpHigh", 1e12)];
        let settings = [
            ("Amplitude", amplitude),
            ("WaitTime", first),
            ("Longest", 1e11),
            ("MaxH", 1e9),
            ("HasRelayHysteresis", 1.0),
        ];
        for (pin, value) in [&limits[..], &settings].concat() {
            row.set(&within(pin), value);
        }
        let mut last = 0.0;
        for i in 0..400 {
            let wave = (std::f64::consts::TAU * (f64::from(i) + 0.3) / 12.0).sin();
            let biased = block.get("Phase") == 3.0;
            row.set("Pv", if biased { later * wave + mean * last } else { size * wave });
            row.set("H", if i < 30 { first } else { h });
            let expected = reference(&row);
            let shown = scan(twin, &block, &row);
            assert!(
                !compared || same(&expected, &shown),
                "{number}, {i}: {shown:?} instead of {expected:?} for {row:?}"
            );
            // The mean goes with the bias.
            last = f64::signum(block.get("Bias"));
            row.set("Starts", 0.0);
        }
        cover.collect(&block);
    }
}

/// Experiments on waves that are drawn: skewed, drifting, of other periods and heights in the next cycle or phase, a few samples a cycle or
/// many, and whatever ends one. What both remember is the same too.
fn waves<R: Number>(cover: &mut Cover) {
    let (mut phases, mut stops) = ([0; 6], [0; 11]);
    for seed in 0..60 {
        let mut draw = Draw::new(600_000 + seed);
        let d = &mut draw;
        let mut one = Experiments::<R>::new();
        let amplitude = d.of(&[3.0, -3.0, 1.5, 3e-3]);
        let most = f64::abs(amplitude);
        let mut row =
            Row::new(&TWINS[8], &[("Take", 1.0), ("Starts", 1.0), ("OpBefore", d.of(&[5.0, 5.0, 0.5, f64::NAN]))]);
        let (wait, longest) = (d.of(&[1.0, 2.0]), d.of(&[400.0, 400.0, 400.0, 40.0]));
        for (pin, value) in [
            ("Amplitude", amplitude),
            ("HasRelayHysteresis", d.of(&[0.0, 1.0])),
            ("RelayHysteresis", d.of(&[0.0, 0.1, 0.5])),
            ("D", most * d.of(&[0.0, 0.25, 1.0])),
            ("WaitTime", wait),
            ("Longest", longest),
            ("MaxH", 0.5),
            ("PvLow", -9.0),
            ("PvHigh", d.of(&[9.0, 9.0, 1.0])),
            ("OpLow", 5.0 - most * d.of(&[1.0, 1.0, 3.0])),
            ("OpHigh", 5.0 + most * d.of(&[1.0, 2.0])),
        ] {
            row.set(&format!("Used.{pin}"), value);
        }
        let period = d.of(&[0.8, 1.6, 3.0, 8.0]);
        let (skew, drift, scatter) =
            (d.of(&[0.0, 0.0, 0.2, 0.45]), d.of(&[0.0, 0.0, 1e-3]), d.of(&[0.0, 0.0, 0.02, 0.15]));
        let (lead, static_gain) = (d.of(&[0.2, 0.25, 0.3, 0.4]), d.of(&[0.0, 0.1, 0.1, 0.4, -0.1]));
        let (noise, wrong, h) = (d.of(&[0.0, 0.0, 0.02]), d.of(&[0.0, 0.0, 0.002]), d.of(&[0.1, 0.1, 0.2]));
        let (mut turn, mut size, mut long, mut level, mut biased) = (0.0, 1.0, period, 0.0, 0.0);
        for i in 0..350 {
            let phase = one.block.get("Phase");
            // The response is a wave behind the relay: it turns on its own, and its mean goes with the bias.
            turn += h / long;
            if turn >= 1.0 {
                turn -= 1.0;
                (size, long) = (1.0 + scatter * d.between(-1.0, 1.0), period * (1.0 + scatter * d.between(-1.0, 1.0)));
            }
            let part =
                if turn < 0.5 + skew { 0.5 * turn / (0.5 + skew) } else { 1.0 - 0.5 * (1.0 - turn) / (0.5 - skew) };
            level += drift;
            biased += 0.2 * (static_gain * f64::signum(amplitude) * one.block.get("Bias") / most - biased);
            let wave = if phase < 2.0 { 0.0 } else { size * f64::sin(std::f64::consts::TAU * (part - lead)) };
            row.set("Pv", wave + level + biased + noise * d.between(-1.0, 1.0));
            row.set("H", if d.chance(wrong) { d.of(&[0.0, 0.5, 0.6, -0.1, f64::NAN]) } else { h });
            for pin in ["Bad", "Gap", "NotAuto", "AtLow", "AtHigh"] {
                row.set(pin, f64::from(d.chance(0.3 * wrong)));
            }
            if d.chance(0.3 * wrong) {
                row.set("Pv", d.of(&[f64::NAN, 20.0, -20.0, 9.0, -9.0]));
            }
            let (expected, shown) = one.scan(&row);
            assert!(same(&expected, &shown), "{seed}, scan {i}: {shown:?} instead of {expected:?} for {row:?}");
            if i % 8 == 7 {
                one.remembers();
            }
            let ended = !(1.0..=3.0).contains(&one.block.get("Phase"));
            row.set("Starts", f64::from(ended && d.chance(0.1)));
            if ended && i % 50 == 0 {
                row.set("OpBefore", d.of(&[5.0, f64::NAN, 5.0 + most]));
            }
        }
        phases[one.block.get("Phase") as usize] += 1;
        stops[one.block.get("StopReason") as usize] += 1;
        cover.collect(&one.block);
    }
    println!("phases {phases:?}, stops {stops:?}");
}

/// A rule without an answer offers nothing: for a process that is nearly all dead time, or whose static gain did not
/// show.
fn no_offer<R: Number>(cover: &mut Cover) {
    for (rule, delay) in [(1.0, 8), (1.0, 0), (2.0, 0), (3.0, 0)] {
        let mut both = Beside::new::<R>(&AUTO_TUNER);
        let block = both.block.clone();
        let (order, fast) = if delay > 0 { (1, 5.0) } else { (3, 1.0) };
        let (x, late, load) = ([0.0; 3], vec![], 0.0);
        let (integrating, cancels, gain, noise, rest) = (false, false, 1.0, 0.0, 5.0);
        let mut process = Process { x, order, integrating, gain, noise, load, rest, fast, late, delay, cancels };
        let mut draw = Draw::new(1);
        let usual = [("Enable", 1.0), ("Amplitude", 3.0), ("WaitTime", 2.0), ("Longest", 250.0), ("MaxH", 1.0)];
        let limits = [("PvLow", -9.0), ("PvHigh", 9.0), ("OpHigh", 10.0), ("X", 5.0), ("H", 0.2), ("Rule", rule)];
        let mut row = Row::new(&AUTO_TUNER, &[&usual[..], &limits].concat());
        for i in 0..1000 {
            let pv = process.step(if i == 0 { 5.0 } else { block.get("Y") }, 0.2, &mut draw);
            row.set_all(&[("Pv", pv), ("Execute", f64::from(i > 2))]);
            both.scan(&row, format_args!("{rule}, {delay}, scan {i}"));
            // A load removes the effect of the bias.
            process.load = if delay == 0 && block.get("Phase") == 3.0 { -block.get("Bias") } else { 0.0 };
            if block.get("Phase") >= 4.0 {
                break;
            }
        }
        // Without a static gain the point is still one to place a controller by.
        let (offers, known) = (rule == 1.0 && delay == 0, delay > 0);
        assert_eq!(
            (block.get("Phase"), block.on("HasOffer"), block.on("HasKappa")),
            (4.0, offers, known),
            "{rule}, {delay}"
        );
        assert!(offers || block.all(&["OfferK", "OfferTi", "OfferTd"]) == [0.0; 3]);
        cover.collect(&block);
    }
}

/// Offers of an autotuner.
fn rules<R: Number>(cover: &mut Cover) {
    use glapp_core::tuning::{Gains, Kind, amigo_frequency, point_placement};
    let (placement, amigo) = (Block::new::<R>("GlappPointPlacement"), Block::new::<R>("GlappAmigoFrequency"));
    let mut draw = Draw::new(11);
    let shown = |block: &Block| block.all(&["Fits", "K", "Ti", "Td"]);
    let numbers =
        |gains: Option<Gains<R>>| gains.map_or(vec![0.0; 4], |g| vec![1.0, g.k.as_f64(), g.ti.as_f64(), g.td.as_f64()]);
    let check = |ku: f64, tu: f64, kappa: f64, pid: bool| {
        placement.set_all(&[("Ku", ku), ("Tu", tu)]);
        placement.call();
        let expected = numbers(point_placement(R::of(ku), R::of(tu)).ok());
        assert!(same(&expected, &shown(&placement)), "{:?} instead of {expected:?}", shown(&placement));
        amigo.set_all(&[("Ku", ku), ("Tu", tu), ("Kappa", kappa), ("WithDerivative", f64::from(pid))]);
        amigo.call();
        let kind = if pid { Kind::Pid } else { Kind::Pi };
        let expected = numbers(amigo_frequency(R::of(ku), R::of(tu), R::of(kappa), kind).ok());
        assert!(same(&expected, &shown(&amigo)), "{:?} instead of {expected:?} for {ku}, {tu}, {kappa}", shown(&amigo));
    };
    for _ in 0..2000 {
        let wrong = draw.of(&[0.0, -1.0, f64::NAN, f64::INFINITY]);
        let (ku, tu, kappa) = (draw.between(-5.0, 5.0), draw.between(0.1, 50.0), draw.between(0.0, 1.1));
        let pid = draw.chance(0.5);
        match draw.of(&[0, 1, 2, 3, 4, 5]) {
            0 => check(wrong, tu, kappa, pid),
            1 => check(ku, wrong, kappa, pid),
            2 => check(ku, tu, wrong, pid),
            _ => check(ku, tu, kappa, pid),
        }
    }
    for (ku, tu) in [(1e33, 1.0), (-1e33, 1.0), (1.0, 1e33)] {
        check(ku, tu, 0.5, true);
    }
    for pid in [true, false] {
        check(2.0, 3.0, -0.1, pid);
    }
    // Ti beyond 1E37, which is no number here, with a Td that still is one.
    placement.set_all(&[("Ku", 1.0), ("Tu", 1e37)]);
    placement.call();
    assert_eq!(shown(&placement), [0.0; 4]);
    // The cases of the vectors with those two rules.
    for case in cases("tuning").iter().filter(|case| [6.0, 9.0].contains(&case.given("rule"))) {
        for (_, x) in &case.input {
            check(x[4], x[5], if x[6].is_nan() { 0.0 } else { x[6] }, case.given("pid") == 1.0);
        }
    }
    for block in [&placement, &amigo] {
        cover.collect(block);
    }
}

/// A program with another version of the retained output is loaded: it is dropped, and that is told.
fn another_version<R: Number>(cover: &mut Cover) {
    let block = Block::new::<R>("GlappPid");
    block.set_all(&[("Enable", 1.0), ("H", 0.1), ("K", 1.0), ("Ti", 1.0), ("Start", 7.0)]);
    block.call();
    block.set("Mode", 0.0);
    block.option("ManualOutput", Some(9.0));
    block.call();
    assert!(!block.on("Dropped") && block.get("Output") == 9.0);
    block.0.borrow_mut().power_cut();
    block.set("Start", 3.0);
    block.call();
    assert!(!block.on("Dropped") && block.get("Output") == 9.0);
    block.0.borrow_mut().power_cut();
    block.0.borrow_mut().spoil("StateVersion", 2.0).unwrap();
    block.set("Start", 3.0);
    block.call();
    assert!(block.on("Dropped") && block.get("Output") == 3.0);
    block.set("Reset", 1.0);
    block.call();
    assert!(!block.on("Dropped"));
    cover.collect(&block);
}

in_both!(lreal, real: random);

/// Park, Miller and Stockmeyer's check of the generator.
#[test]
fn the_ten_thousandth_integer_is_the_published_one() {
    for build in [Build::Lreal, Build::Real] {
        let library = glapp_plc_check::Library::read(&folder(), build).unwrap();
        let mut noise = Instance::new(&library, "GlappNoise").unwrap();
        for _ in 0..10_000 {
            noise.call().unwrap();
        }
        assert_eq!(noise.get("Drawn").unwrap(), 399_268_537.0);
    }
}

/// `plc/blocks.md` lists integers that the core makes of the seeds 0 to 9.
#[test]
fn the_seeds_of_the_page_are_those_of_the_core() {
    let page = std::fs::read_to_string(folder().join("blocks.md")).unwrap();
    let seeds: Vec<String> = (0..10).map(|seed| NoiseState::seeded(seed).integer.to_string()).collect();
    assert!(page.contains(&seeds.join(", ")), "{}", seeds.join(", "));
}
