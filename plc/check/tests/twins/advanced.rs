//! The controller with the detection inside: every vector, and random sequences with settings and inputs good and bad, the same bits as
//! the core in LREAL and REAL.
//!
//! `GLAPP_SEQUENCES=10000 cargo test -p glapp-plc-check --test twins advanced:: -- --nocapture` runs ten thousand of them and tells what a
//! scan costs.

use crate::common::advanced::{PID_ADVANCED, ROWS, Reference, row, scan, set_compensation};
use crate::common::compensate;
use crate::common::control::{INSIDE, POWER_CUT, Row};
use crate::common::cover::{Cost, Cover, sequences};
use crate::common::detection::agree;
use crate::common::{Block, Case, Draw, Number, cases, same};
use glapp_plc_check::Build;
use serde_json::Value;

fn flag(mask: f64, flag: u16) -> f64 {
    f64::from(mask as u16 & flag != 0)
}

/// The pins that the parameters of a case set.
fn of_case(case: &Case) -> Row {
    let or = |name: &str, usual: f64| case.param(name).unwrap_or(usual);
    let law = [("K", case.given("k")), ("Ti", case.given("ti")), ("Td", or("td", 0.0)), ("B", or("b", 1.0))];
    let mut pins =
        row(&[&law[..], &[("C", or("c", 0.0)), ("Tf", or("tf", 0.0)), ("Start", case.given("start"))]].concat());
    for (pin, name) in [
        ("Low", "low"),
        ("High", "high"),
        ("Rate", "rate"),
        ("Kp", "kp"),
        ("PvSpan", "pv_span"),
        ("OpSpan", "op_span"),
        ("DetectorTf", "detector_tf"),
        ("SpRate", "sp_rate"),
    ] {
        pins.option(pin, case.param(name));
    }
    pins.set("N", or("n", 9.0));
    let mut rows = 0;
    while let Some(at) = case.param(&format!("at{}", rows + 1)) {
        let of = |name: &str| case.given(&format!("{name}{}", rows + 1));
        let values = [at, of("k"), of("ti"), of("td")];
        pins.set_all(&ROWS[rows].into_iter().zip(values).collect::<Vec<_>>());
        rows += 1;
    }
    pins.set("Rows", rows as f64);
    if let Some(size) = case.param("comp_size") {
        let set = [("HasCompensation", 1.0), ("Size", size), ("Way", or("comp_way", 3.0))];
        pins.set_all(&set);
        pins.option("Band", case.param("comp_band"));
        pins.option("FfRate", case.param("comp_rate"));
    }
    if let Some(amplitude) = case.param("amplitude") {
        let times = [("WaitTime", case.given("wait")), ("Longest", case.given("longest"))];
        let bounds = [("PvLow", case.given("pv_low")), ("PvHigh", case.given("pv_high"))];
        pins.set_all(&[("HasTuner", 1.0), ("Amplitude", amplitude), ("Rule", 2.0)]);
        pins.set_all(&[times, bounds].concat());
    }
    pins
}

/// Mode and manual output where they are given, and what is told backward.
fn backward(pins: &mut Row, mode: f64, manual: f64, flags: f64) {
    pins.set("Mode", if mode.is_nan() { -1.0 } else { mode });
    pins.option("ManualOutput", Some(manual).filter(|manual| !manual.is_nan()));
    let bits = [("BackNotAuto", 1), ("BackAtLow", 4), ("BackAtHigh", 8)];
    pins.set_all(&bits.map(|(pin, bit)| (pin, flag(flags, bit))));
}

/// Fields that the vectors have of a detection.
fn of_detection(block: &Block) -> Vec<f64> {
    let mut row = vec![block.get("UFf"), block.given("HasShown", "Estimate.Value")];
    row.push(if block.on("HasShown") { block.get("Estimate.Count") } else { 0.0 });
    row.push(block.given("HasNoiseFloor", "NoiseFloor"));
    row.push(block.given("HasWholeShown", "Whole.Value"));
    row.extend([block.get("Standing"), block.get("Equal") + 2.0 * block.get("Relay"), 256.0 * block.get("WrongSign")]);
    row
}

fn vectors<R: Number>() {
    let with_vectors = R::BUILD == Build::Lreal;
    for name in ["pid_advanced", "pid_settings", "pid_tuner"] {
        for case in cases(name) {
            let mut pins = of_case(&case);
            let (block, mut reference) = (Block::new::<R>("GlappPidAdvanced"), Reference::<R>::default());
            for (i, (h, x)) in case.input.iter().enumerate() {
                pins.set_all(&[("H", *h), ("Pv", x[0]), ("Sp", x[1])]);
                if name == "pid_settings" {
                    backward(&mut pins, if i == 0 { 2.0 } else { f64::NAN }, f64::NAN, 0.0);
                    pins.option("SpRate", Some(x[2]));
                    // 0 on the pin is no limit: of the numbers that are wrong it holds another.
                    pins.option("Rate", Some(if x[3] == 0.0 { -1.0 } else { x[3] }));
                } else if name == "pid_tuner" {
                    let &[_, _, mode, flags, tune, take] = &x[..] else { panic!("six inputs") };
                    backward(&mut pins, mode, f64::NAN, flags);
                    if !tune.is_nan() {
                        pins.set("Execute", tune);
                    }
                    pins.set("Cut", take);
                    if take == 1.0 {
                        assert!(block.on("HasOffer"));
                        for (pin, offered) in [("K", "OfferK"), ("Ti", "OfferTi"), ("Td", "OfferTd")] {
                            pins.set(pin, block.get(offered));
                        }
                    }
                } else {
                    let &[_, _, by, mode, manual, flags, enable] = &x[..] else { panic!("seven inputs") };
                    backward(&mut pins, mode, manual, flags);
                    pins.set_all(&[("ScheduleBy", by), ("Compensate", enable)]);
                }
                let (expected, got) = (reference.scan(&pins), scan(&block, &pins));
                assert!(agree(&expected, &got), "{}, scan {i}:\n{got:?} instead of\n{expected:?}", case.name);
                if with_vectors {
                    let number = |value: &Value| value.as_f64().unwrap_or(f64::NAN);
                    let of_vector = case.output.as_ref().unwrap()[i].as_array().unwrap();
                    let expected: Vec<f64> = of_vector.iter().map(number).collect();
                    let mut shown = block.all(&["Output", "Ysp"]);
                    if name == "pid_settings" {
                        shown.push(block.get("ErrorID"));
                        shown.extend(&of_detection(&block)[1..3]);
                    } else if name == "pid_tuner" {
                        shown.extend(block.all(&["Phase", "StopReason"]));
                        shown.extend(["Ku", "Tu"].map(|pin| block.given("HasFound", pin)));
                        shown.extend([block.given("HasFoundKp", "FoundKp"), block.given("HasKappa", "Kappa")]);
                        shown.extend(["K", "Ti", "Td"].map(|pin| pins.get(pin)));
                    } else {
                        shown.extend(of_detection(&block));
                    }
                    assert!(same(&expected, &shown), "{}, scan {i}: {shown:?} instead of {expected:?}", case.name);
                }
            }
        }
    }
}

in_both!(vectors_lreal, vectors_real: vectors);

const NONE: [f64; 3] = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY];
const WHOLE: [&str; 5] = ["N", "Rows", "Way", "Source", "Rule"];

/// Settings: all that may be spoilt.
const SETTINGS: [&str; 41] = [
    "K", "Ti", "Td", "B", "C", "Tf", "Low", "High", "Rate", "MaxH", "Kp", "PvSpan", "OpSpan", "DetectorTf", "N",
    "SpRate", "Rows", "At1", "K1", "Ti1", "Td1", "At2", "K2", "Ti2", "Td2", "Way", "Source", "Size", "Share",
    "MaxWidth", "Band", "OpTf", "FfRate", "Release", "Amplitude", "RelayHysteresis", "D", "WaitTime", "PvLow",
    "PvHigh", "Rule",
];

/// Settings that may be there or not.
const OPTIONS: [&str; 10] =
    ["Low", "High", "Rate", "MaxH", "Kp", "PvSpan", "OpSpan", "DetectorTf", "SpRate", "RelayHysteresis"];
const SWITCHES: [&str; 5] = ["HasCompensation", "HasTuner", "Integrating", "Contradicted", "Withdraw"];

/// Three lags behind the valve.
struct Process {
    x: [f64; 3],
    gain: f64,
    noise: f64,
}

impl Process {
    fn step(&mut self, op: f64, h: f64, d: &mut Draw) -> f64 {
        let h = if h > 0.0 && h < 2.0 { h } else { 0.2 };
        for _ in 0..10 {
            for i in 0..3 {
                let before = if i == 0 { self.gain * (op - 5.0) } else { self.x[i - 1] };
                self.x[i] += 0.1 * h * (before - self.x[i]);
            }
        }
        self.x[2] + self.noise * d.between(-1.0, 1.0)
    }
}

/// A loop for the block to be in: one that swings about its setpoint, or one that an experiment is made in, and that swings when it is
/// over; everything can go wrong with it.
struct Loop {
    usual: Row,
    row: Row,
    process: Option<Process>,
    scans: usize,
    wrong: f64,
    side: f64,
    size: f64,
    noise: f64,
    length: usize,
    left: usize,
    asked: usize,
    level: f64,
}

impl Loop {
    fn new(d: &mut Draw) -> Self {
        let tuned = d.chance(0.35);
        let ti = d.between(0.3, 0.8);
        let (k, ti) = if tuned { (d.of(&[0.2, 0.2, -0.2]), 4.0) } else { (d.of(&[0.5, 1.0, -0.7, 6.0, 0.1]), ti) };
        let gain = if k < 0.0 { -1.0 } else { 1.0 };
        let mut usual = row(&[("K", k), ("Ti", ti), ("HasOwnSp", 1.0), ("Start", 5.0), ("H", 0.25)]);
        let own = [("Td", d.of(&[0.0, 0.0, 0.2])), ("B", d.of(&[1.0, 0.0, 0.3])), ("C", d.of(&[0.0, 0.0, 0.7]))];
        usual.set_all(&own);
        usual.set_all(&[("Tf", d.of(&[0.0, 0.1, 0.1, 0.45])), ("N", d.of(&[1.0, 1.0, 3.0, 5.0]))]);
        usual.option("Kp", d.of(&[None, None, Some(2.0), Some(-2.0), Some(0.14)]));
        usual.option("PvSpan", d.of(&[None, Some(1.0), Some(30.0)]));
        usual.option("OpSpan", d.of(&[None, Some(10.0), Some(100.0)]));
        usual.option("DetectorTf", d.of(&[None, None, Some(0.0), Some(0.1), Some(0.5)]));
        usual.option("SpRate", d.of(&[None, None, Some(0.05), Some(1.0), Some(1e36)]));
        usual.option("Rate", d.of(&[None, None, Some(0.5), Some(50.0), Some(1e36)]));
        let open = if ti > 0.55 { None } else { Some(0.4) };
        usual.option("MaxH", d.of(&[open, Some(1.0), Some(1e30)]));
        usual.set("Integrating", f64::from(d.chance(0.1)));
        let limits = d.of(&[None, Some((-2.0, 2.5)), Some((0.0, 10.0)), Some((-50.0, 50.0))]);
        usual.option("Low", limits.map(|limits| limits.0));
        usual.option("High", limits.map(|limits| limits.1));
        // A schedule, of all rows that there may be or of a few.
        let rows = d.of(&[0, 0, 0, 1, 2, 2, 3, 8]);
        usual.set("Rows", if tuned && d.chance(0.8) { 0.0 } else { rows as f64 });
        for (i, names) in ROWS.into_iter().enumerate() {
            let near = [d.between(0.5, 2.0), d.between(0.8, 1.5), d.of(&[0.0, 0.0, 0.1, 0.2])];
            let values = [0.4 * i as f64 - 0.5, k * near[0], ti * near[1], near[2]];
            usual.set_all(&names.into_iter().zip(values).collect::<Vec<_>>());
        }
        let mut settings = compensate::drawn(d);
        settings.band = d.of(&[None, Some(0.0), Some(0.05)]);
        settings.most = None;
        set_compensation(&mut usual, &settings);
        usual.set("HasCompensation", f64::from(d.chance(0.8)));
        // An autotuner needs limits; its experiment comes to its end in a loop of its own.
        let most = d.between(2.0, 4.0);
        let amplitude = d.of(&[3.0, 3.0, most]) * gain;
        let times = [("WaitTime", 2.0), ("Longest", d.of(&[250.0, 250.0, 20.0]))];
        usual.set_all(&[("Amplitude", amplitude), ("PvLow", -9.0), ("PvHigh", d.of(&[9.0, 9.0, 9.0, 0.5]))]);
        usual.set_all(&times);
        usual.set_all(&[("D", d.of(&[0.0, 0.0, 0.5])), ("Rule", d.of(&[1.0, 2.0, 3.0, 0.0]))]);
        usual.option("RelayHysteresis", d.of(&[None, None, Some(0.05)]));
        usual.set("HasTuner", f64::from(tuned || (limits.is_some() && d.chance(0.3))));
        let mut wrong = d.of(&[0.0, 0.0, 0.01, 0.05]);
        if tuned {
            usual.set_all(&[("H", 0.2), ("HasLow", 1.0), ("Low", 1.0), ("HasHigh", 1.0), ("High", 9.0)]);
            usual.option("Rate", d.of(&[None, None, None, Some(50.0), Some(2.0)]));
            wrong = d.of(&[0.0, 0.0, 0.002, 0.01, 0.05]);
        }
        let noise = d.of(&[0.0, 0.02]);
        let slowest = if usual.on("Rows") { 1.5 * ti } else { ti };
        let length = (5.0 * slowest.min(1.5) / 0.25) as usize + d.of(&[0, 2, 4, 6]);
        Self {
            row: usual.clone(),
            usual,
            process: tuned.then_some(Process { x: [0.0; 3], gain, noise }),
            scans: 0,
            wrong,
            side: 1.0,
            size: d.of(&[1.0, 1.0, 0.4]),
            noise: d.of(&[0.0, 0.01, 0.03, 0.3]),
            length,
            left: length,
            asked: d.of(&[5, 60, 150]),
            level: 0.0,
        }
    }

    fn or_none(&self, d: &mut Draw, x: f64) -> f64 {
        if d.chance(self.wrong) { d.of(&NONE) } else { x }
    }

    /// One setting changed, spoilt, or given or not.
    fn change(&mut self, d: &mut Draw) {
        let pin = d.of(&SETTINGS);
        match d.of(&[0, 1, 2, 3, 3]) {
            0 => {
                let pin = d.of(&OPTIONS);
                let has = self.usual.on(&format!("Has{pin}"));
                self.row.option(pin, if has { None } else { Some(d.of(&[0.4, 2.0])) });
            }
            1 => {
                let pin = d.of(&SWITCHES);
                self.row.set(pin, f64::from(!self.usual.on(pin)));
            }
            2 if !WHOLE.contains(&pin) => {
                let usual = self.usual.get(pin);
                self.row.set(pin, usual * d.between(0.5, 1.5));
            }
            _ => {
                let whole = d.of(&[0.0, -1.0, 1.0, 2.0, 3.0, 4.0, 9.0, 33.0]);
                let number = d.of(&[f64::NAN, f64::INFINITY, f64::NEG_INFINITY, -2.0, 0.0, 2.0, 50.0]);
                self.row.set(pin, if WHOLE.contains(&pin) { whole } else { number });
                if OPTIONS.contains(&pin) || ["MaxWidth", "Band", "FfRate", "Release"].contains(&pin) {
                    self.row.set(&format!("Has{pin}"), 1.0);
                }
            }
        }
    }

    /// Pins of the next scan, given the outputs of the last.
    fn next(&mut self, block: &Block, d: &mut Draw) -> Row {
        self.scans += 1;
        let rare = if self.process.is_some() { 0.1 * self.wrong } else { self.wrong };
        if self.wrong > 0.0 && d.chance(0.03 + self.wrong) {
            for pin in SETTINGS {
                let value = self.usual.get(pin);
                self.row.set(pin, value);
            }
            for pin in SWITCHES {
                let value = self.usual.get(pin);
                self.row.set(pin, value);
            }
            for pin in OPTIONS.into_iter().chain(["MaxWidth", "Band", "FfRate", "Release"]) {
                let has = format!("Has{pin}");
                let value = self.usual.get(&has);
                self.row.set(&has, value);
            }
            if d.chance(0.6) {
                self.change(d);
            }
        }
        for pin in [POWER_CUT, "Reset", "Restart"] {
            self.row.set(pin, f64::from(d.chance(0.1 * rare)));
        }
        for pin in ["PvBad", "SpBad", "FfBad", "ScheduleByBad", "BackAtLow", "BackAtHigh", "BackNotAuto"] {
            self.row.set(pin, f64::from(d.chance(rare)));
        }
        self.row.set("Cut", f64::from(d.chance(0.2 * self.wrong)));
        let odd = d.of(&[0.0, -0.1, 5.0, f64::NAN, f64::INFINITY, 0.05, 1e-3]);
        let h = if d.chance(rare) { odd } else { self.usual.get("H") };
        self.row.set("H", if self.scans < 3 && self.wrong > 0.01 { 0.0 } else { h });
        let tracking = d.between(0.0, 6.0);
        let tracking = self.or_none(d, tracking);
        self.row.set("BackTracking", tracking);
        if d.chance(2.0 * rare) {
            let limits = d.of(&[(-0.2, 4.0), (5.0, -5.0), (f64::NAN, 2.0), (-5.0, -3.0), (1.0, f64::NAN)]);
            let given = [("HasBackLimits", f64::from(d.chance(0.7))), ("BackLow", limits.0), ("BackHigh", limits.1)];
            self.row.set_all(&given);
        }
        let disabled = if self.row.on("Enable") { d.chance(0.2 * self.wrong) } else { d.chance(0.7) };
        self.row.set("Enable", f64::from(!disabled));
        if self.scans == self.asked || d.chance(0.2 * self.wrong) {
            let asked = self.row.on("Compensate");
            self.row.set("Compensate", f64::from(!asked));
        }
        self.level = (self.level + d.between(-0.3, 0.3)).clamp(-1.0, 3.5);
        let by = self.level;
        let by = self.or_none(d, by);
        self.row.set("ScheduleBy", by);
        for (pin, share) in [("Sp", 0.02), ("Ff", 0.05)] {
            if self.wrong > 0.0 && d.chance(share) {
                let value = d.between(-0.5, 0.5);
                let value = self.or_none(d, value);
                self.row.set(pin, value);
            }
        }
        if d.chance(0.5 * rare) {
            let mode = d.of(&[0.0, 1.0, 2.0, 1.0, -1.0, 3.0]);
            self.row.set("Mode", mode);
            for (pin, about) in [("OwnSp", 0.0), ("ManualOutput", 4.0)] {
                let value = about + d.between(-0.5, 0.5);
                let value = self.or_none(d, value);
                self.row.option(pin, d.chance(0.5).then_some(value));
            }
        }
        let run = self.row.on("Execute");
        let (ended, going) = (!block.on("Busy") && d.chance(0.05), d.chance(0.1 * self.wrong));
        let often = if self.process.is_some() { 0.1 } else { 0.01 };
        let run = if run { !ended && !going } else { d.chance(often) && block.get("Phase") != 4.0 };
        self.row.set("Execute", f64::from(run));
        if block.on("HasOffer") && d.chance(0.02) {
            // Taken over.
            for (pin, offered) in [("K", "OfferK"), ("Ti", "OfferTi"), ("Td", "OfferTd")] {
                self.row.set(pin, block.get(offered));
                self.usual.set(pin, block.get(offered));
            }
            self.row.set("Cut", 1.0);
        }
        let in_time = self.row.get("H");
        let measured = match &mut self.process {
            Some(process) if block.get("Phase") != 4.0 => {
                let op = Some(block.get("Output")).filter(|op| op.is_finite()).unwrap_or(5.0);
                process.step(op, in_time, d)
            }
            _ => self.swing(block, d),
        };
        // One that is a number and no measurement stays in the controller's filter for long.
        let far = if d.chance(0.1) { -2e30 } else { f64::NAN };
        let measured = if d.chance(rare) { d.of(&[f64::NAN, f64::INFINITY, far]) } else { measured };
        self.row.set("Pv", measured);
        self.row.clone()
    }

    fn swing(&mut self, block: &Block, d: &mut Draw) -> f64 {
        self.left -= 1;
        if self.left == 0 {
            (self.side, self.left) = (-self.side, self.length);
            if d.chance(0.05) {
                self.size = d.between(0.2, 3.0);
            }
        }
        let ysp = block.get("Ysp");
        let about = if ysp.abs() < 2.0 { ysp } else { 0.0 };
        about - self.side * self.size + self.noise * d.between(-1.0, 1.0)
    }
}

/// Numbers at the ends of what is one: nothing stops. The library calls too large what is beyond 1E37.
fn extreme(row: &mut Row, d: &mut Draw) {
    let pins = [
        "Pv", "Sp", "Ff", "OwnSp", "ManualOutput", "K", "Ti", "Td", "Tf", "Rate", "MaxH", "H", "Start", "SpRate",
        "DetectorTf", "Kp", "PvSpan", "OpSpan", "ScheduleBy", "At1", "K1", "Ti1", "Td1", "At2", "K2", "Ti2", "Td2",
        "Size", "FfRate", "Release", "Watch", "Amplitude", "Low", "High", "BackTracking", "BackLow", "BackHigh",
    ];
    for pin in pins {
        if d.chance(0.1) {
            row.set(pin, d.of(&[1e36, -1e36, 1e-36, 1e20, -1e20, 1e-20]));
        }
    }
}

fn random<R: Number>() {
    let mut cover = Cover::new::<R>();
    let mut cost = Cost::default();
    let mut standings = [0_u32; 15];
    let (mut refused, mut done, mut found, mut offered, mut accepted, mut off) = (0_u64, 0_u64, 0_u64, 0_u64, 0.0, 0);
    for seed in 0..sequences() {
        let mut draw = Draw::new(200_000 + seed);
        let mut signals = Loop::new(&mut draw);
        let (block, mut reference) = (Block::new::<R>("GlappPidAdvanced"), Reference::<R>::default());
        let scans = if signals.process.is_some() { 450 } else { 220 };
        for i in 0..scans {
            let row = signals.next(&block, &mut draw);
            let expected = reference.scan(&row);
            let got = cost.of(&block, || scan(&block, &row));
            assert!(agree(&expected, &got), "{}", difference(&expected.row, &got.row, &row, seed, i));
            assert!(!block.on("Dropped"));
            if i % 16 == 15 && !block.on("Error") {
                reference.in_force(&block);
            }
            standings[block.get("Standing") as usize] += 1;
            refused += u64::from(block.on("Error"));
            done += u64::from(block.get("Phase") == 4.0);
            found += u64::from(block.get("Phase") == 4.0 && block.on("HasFoundKp"));
            offered += u64::from(block.on("HasOffer"));
            off += u64::from(!row.on("Enable"));
        }
        accepted += block.get("Accepted");
        cover.collect(&block);
    }
    println!(
        "standings {standings:?}, {refused} scans refused, {off} not enabled, {done} after an experiment, {found} with its Kp, \
         {offered} with an offer, {accepted} half-periods accepted"
    );
    assert!(refused > sequences() && found > sequences() && offered > sequences() && accepted > sequences() as f64);
    cost.tell::<R>("GlappPidAdvanced");
    for seed in 0..sequences() {
        let mut draw = Draw::new(300_000 + seed);
        let mut signals = Loop::new(&mut draw);
        let block = Block::new::<R>("GlappPidAdvanced");
        block.unheld();
        for _ in 0..60 {
            let mut row = signals.next(&block, &mut draw);
            extreme(&mut row, &mut draw);
            scan(&block, &row);
        }
        cover.collect(&block);
    }
    power::<R>(&mut cover);
    refused_one_by_one::<R>(&mut cover);
    far_apart::<R>(&mut cover);
    large::<R>(&mut cover);
    coarse::<R>(&mut cover);
    relay_and_gain::<R>(&mut cover);
    own_filter::<R>(&mut cover);
    by_a_kp_that_was_found::<R>(&mut cover);
    warns::<R>(&mut cover);
    cover.holds(&["GlappPidAdvanced", "GlappGainSchedule"]);
    // The rest of both is taken where they are alone.
    cover.parts(
        "GlappPid",
        &INSIDE.map(|line| if line == "IF Inner.Checked THEN" { "IF Inner.Forth THEN" } else { line }),
    );
    for pou in ["GlappPid", "GlappAutoTuner"] {
        cover.takes(pou, &["IF Inner.Checked THEN"]);
    }
}

/// Each setting spoilt in each way, in a set that is good: its number is told, and what was in force stays.
fn refused_one_by_one<R: Number>(cover: &mut Cover) {
    let mut usual = row(&[("K", 0.5), ("Ti", 1.0), ("H", 0.25), ("Start", 5.0), ("Rows", 8.0)]);
    for (i, names) in ROWS.into_iter().enumerate() {
        usual.set_all(&names.into_iter().zip([i as f64, 0.5, 1.0, 0.1]).collect::<Vec<_>>());
    }
    set_compensation(&mut usual, &compensate::Settings { size: 1.0, ..compensate::Settings::default() });
    usual.set_all(&[("HasTuner", 1.0), ("Amplitude", 3.0), ("WaitTime", 1.0), ("Longest", 9.0), ("PvHigh", 1.0)]);
    for (pin, value) in [("Low", 0.0), ("High", 10.0), ("Kp", 2.0), ("PvSpan", 9.0), ("OpSpan", 9.0)] {
        usual.option(pin, Some(value));
    }
    for pin in
        ["Rate", "MaxH", "DetectorTf", "SpRate", "RelayHysteresis", "FfRate", "Release", "RampTime", "Watch", "Band"]
    {
        usual.option(pin, Some(1.0));
    }
    for (pin, value) in [("MaxWidth", 2.0), ("Travel", 9.0), ("Reversals", 9.0)] {
        usual.option(pin, Some(value));
    }
    let rows = ROWS.into_iter().flatten();
    let rest = ["RampTime", "Travel", "Reversals", "Watch", "Longest"];
    let mut backward = std::collections::BTreeSet::new();
    for pin in SETTINGS.into_iter().chain(rows).chain(rest) {
        // Bounds themselves among them, some by what the others are.
        let bounds = [-2.0, -1.0, 0.0, 1.0, 1.125, 1.875, 2.0, 4.0, 9.0, 10.0, 1e33, -1e33, 1e37, -1e37];
        let whole = [-1.0, 0.0, 1.0, 2.0, 3.0, 4.0, 8.0, 9.0, 31.0, 32.0, 33.0];
        let values = if WHOLE.contains(&pin) { whole.to_vec() } else { [&NONE[..], &bounds].concat() };
        for value in &values {
            let (block, mut reference) = (Block::new::<R>("GlappPidAdvanced"), Reference::<R>::default());
            let mut pins = usual.clone();
            for spoilt in [false, true, true, false] {
                pins.set(pin, if spoilt { *value } else { usual.get(pin) });
                let (expected, got) = (reference.scan(&pins), scan(&block, &pins));
                assert!(agree(&expected, &got), "{pin} {value}: {}", difference(&expected.row, &got.row, &pins, 0, 0));
                backward.insert(block.get("ErrorID") as i16);
            }
            cover.collect(&block);
        }
    }
    // All there are but H, those of other blocks, and limits that the controller's own stand for.
    let others = [9, 10, 12, 33, 34, 38, 39, 40, 41, 42, 43];
    let all: Vec<i16> = (1..=78).filter(|number| !others.contains(number)).collect();
    assert_eq!(backward.into_iter().filter(|number| *number != 0).collect::<Vec<_>>(), all);
}

/// Rows whose difference loses the smaller Ti: nothing is divided by 0.
fn far_apart<R: Number>(cover: &mut Cover) {
    let (block, mut reference) = (Block::new::<R>("GlappPidAdvanced"), Reference::<R>::default());
    let mut pins = row(&[("K", 0.5), ("Ti", 1.0), ("H", 0.25), ("Start", 5.0), ("HasOwnSp", 1.0), ("Rows", 2.0)]);
    pins.set_all(&[("At1", -1e3), ("K1", 0.5), ("Ti1", 1e20), ("K2", 0.5), ("Ti2", 1e-3)]);
    for (i, by) in [-2e3, -5.0, -1e-20, -1e-20, 0.0, -1e-20, -1e-20].into_iter().enumerate() {
        pins.set_all(&[("ScheduleBy", by), ("Pv", 0.1 * i as f64)]);
        let (expected, got) = (reference.scan(&pins), scan(&block, &pins));
        assert!(agree(&expected, &got), "{by}: {}", difference(&expected.row, &got.row, &pins, 0, i));
    }
    cover.collect(&block);
}

/// One scan of reference and block.
fn beside<R: Number>(reference: &mut Reference<R>, block: &Block, pins: &Row, seed: u64, i: usize) {
    let (expected, got) = (reference.scan(pins), scan(block, pins));
    assert!(agree(&expected, &got), "{}", difference(&expected.row, &got.row, pins, seed, i));
}

/// Each signal by itself so large that it is a number, and beyond what can be measured; limits that far out.
fn large<R: Number>(cover: &mut Cover) {
    let mut usual = row(&[("K", 0.5), ("Ti", 1.0), ("H", 0.25), ("Start", 5.0), ("HasOwnSp", 1.0), ("Mode", 2.0)]);
    usual.set_all(&[("Rows", 2.0), ("K1", 0.5), ("Ti1", 1.0), ("At2", 4.0), ("K2", 1.0), ("Ti2", 2.0)]);
    let pins =
        ["Pv", "Sp", "Ff", "ScheduleBy", "OwnSp", "ManualOutput", "BackTracking", "BackLow", "BackHigh", "Start"];
    for pin in pins {
        for value in [1e33, -1e33] {
            let (block, mut reference) = (Block::new::<R>("GlappPidAdvanced"), Reference::<R>::default());
            for i in 0..10 {
                let mut pins = usual.clone();
                pins.set("Pv", 0.1 * i as f64);
                if i == 0 || i == 4 || i == 5 {
                    let mode = [("Mode", if pin == "OwnSp" { 1.0 } else { 2.0 }), ("Mode", 0.0)];
                    let backward =
                        [("HasBackLimits", 1.0), ("BackLow", -9.0), ("BackHigh", 9.0), ("HasManualOutput", 1.0)];
                    pins.set_all(&[
                        mode[usize::from(pin == "ManualOutput")],
                        ("BackNotAuto", f64::from(pin == "BackTracking")),
                    ]);
                    pins.set_all(&backward);
                    pins.set(pin, value);
                }
                beside(&mut reference, &block, &pins, 0, i);
            }
            cover.collect(&block);
        }
    }
    for (tuner, (low, high)) in [(0.0, (1e33, 2e33)), (0.0, (-2e33, -1e33)), (1.0, (1e33, 2e33)), (1.0, (-2e33, -1e33))]
    {
        let (block, mut reference) = (Block::new::<R>("GlappPidAdvanced"), Reference::<R>::default());
        for i in 0..4 {
            let mut pins = usual.clone();
            pins.set_all(&[("HasLow", 1.0), ("Low", low), ("HasHigh", 1.0), ("High", high), ("HasTuner", tuner)]);
            pins.set_all(&[("Amplitude", 3.0), ("WaitTime", 1.0), ("Longest", 9.0), ("PvHigh", 1.0)]);
            beside(&mut reference, &block, &pins, 0, i);
        }
        cover.collect(&block);
    }
}

/// Signals and times of a few values, so that bounds are met exactly; a block that begins anew in the middle of everything.
fn coarse<R: Number>(cover: &mut Cover) {
    for seed in 0..24 {
        let mut draw = Draw::new(400_000 + seed);
        let mut signals = Loop::new(&mut draw);
        signals.wrong = 0.02;
        let (block, mut reference) = (Block::new::<R>("GlappPidAdvanced"), Reference::<R>::default());
        let mut still = 0;
        for i in 0..120 {
            let mut pins = signals.next(&block, &mut draw);
            let d = &mut draw;
            let anew = d.chance(0.03);
            still = if anew && d.chance(0.5) { 3 } else { i32::max(still - 1, 0) };
            let reset = anew && d.chance(0.5);
            pins.set_all(&[("Reset", f64::from(reset)), ("Restart", f64::from(anew && !reset))]);
            if d.chance(0.3) {
                pins.set("Pv", d.of(&[-1.0, -0.5, 0.0, 0.5, 1.0]));
            }
            let longest = if pins.on("HasMaxH") { pins.get("MaxH") } else { 0.5 * pins.get("Ti") };
            let h = if d.chance(0.05) { d.of(&[longest, 1e9, 1.5e9]) } else { pins.get("H") };
            pins.set("H", if still > 0 { 0.0 } else { h });
            for pin in ["BackAtLow", "BackAtHigh", "BackNotAuto"] {
                let backward = d.chance(0.02);
                pins.set(pin, f64::from(backward || pins.on(pin)));
            }
            beside(&mut reference, &block, &pins, seed, i);
            if i % 4 == 3 && !block.on("Error") {
                let state = reference.state.as_ref().expect("it has run");
                block.remembers(&state.detection.compensation, &[("/pressed", "FrozenWidth")]);
            }
        }
        cover.collect(&block);
    }
}

/// A filter of the detector's own beside a compensation by the sign of the error; it begins anew, and times are at their bound.
fn own_filter<R: Number>(cover: &mut Cover) {
    for seed in 0..8 {
        let mut draw = Draw::new(410_000 + 4 * seed);
        let d = &mut draw;
        let mut pins = row(&[("K", 0.5), ("Ti", 1.0), ("H", 0.25), ("HasOwnSp", 1.0), ("Start", 5.0), ("N", 1.0)]);
        pins.set_all(&[("HasCompensation", 1.0), ("Size", 1.0), ("Way", 1.0), ("HasKp", 1.0), ("Kp", 2.0)]);
        pins.option("DetectorTf", Some(d.of(&[0.5, 0.25])));
        pins.option("MaxH", d.of(&[None, Some(0.75)]));
        let (block, mut reference) = (Block::new::<R>("GlappPidAdvanced"), Reference::<R>::default());
        for i in 0..100 {
            let side = if (i / 12) % 2 == 0 { 1.0 } else { -1.0 };
            let longest = if pins.on("HasMaxH") { 0.75 } else { 0.5 };
            pins.set_all(&[("Pv", side * d.of(&[1.0, 1.0, -0.5])), ("Compensate", f64::from(i > 2))]);
            pins.set_all(&[("H", d.of(&[0.25, 0.25, 0.25, longest])), ("Enable", f64::from(!d.chance(0.03)))]);
            pins.set_all(&[("Reset", f64::from(i == 40)), ("Restart", f64::from(i % 30 == 25))]);
            // Refused: what is in force stays.
            pins.set_all(&[("Rows", if d.chance(0.05) { 9.0 } else { 0.0 }), ("PvBad", f64::from(d.chance(0.03)))]);
            beside(&mut reference, &block, &pins, seed, i);
        }
        cover.collect(&block);
    }
}

/// Evenly and with hardly any travel of its own: it is warned of, until it begins anew.
fn warns<R: Number>(cover: &mut Cover) {
    let (block, mut reference) = (Block::new::<R>("GlappPidAdvanced"), Reference::<R>::default());
    let mut pins = row(&[("K", 0.5), ("Ti", 1.0), ("H", 0.25), ("HasOwnSp", 1.0), ("Start", 5.0), ("N", 1.0)]);
    pins.set_all(&[("HasCompensation", 1.0), ("Size", 4.0), ("ReduceByEstimate", 0.0), ("HasKp", 1.0), ("Kp", 2.0)]);
    pins.option("Band", Some(0.0));
    pins.set("Withdraw", 0.0);
    let mut warned = false;
    for i in 0..320 {
        pins.set("Pv", if (i / 24) % 2 == 0 { 0.1 } else { -0.1 });
        pins.set_all(&[("Compensate", f64::from(i > 2)), ("Reset", f64::from(i == 300))]);
        beside(&mut reference, &block, &pins, 0, i);
        warned = if i < 300 { block.on("Relay") } else { warned };
    }
    assert!(warned && !block.on("Relay"));
    cover.collect(&block);
}

/// An output that may just move as fast as the relay, and one that may not; an experiment on a process that integrates, whose Kp is none.
fn relay_and_gain<R: Number>(cover: &mut Cover) {
    let (mut stopped, mut without) = (0, 0);
    let others = [(11.0, false, 1.5), (9.0, false, 1.5)];
    let usual = [(22.0, false), (20.0, false), (18.0, false), (90.0, true)].map(|(rate, slow)| (rate, slow, 3.0));
    for (rate, integrates, amplitude) in usual.into_iter().chain(others) {
        let mut pins =
            row(&[("K", 0.2), ("Ti", 4.0), ("H", 0.2), ("HasOwnSp", 1.0), ("Start", 5.0), ("HasTuner", 1.0)]);
        pins.set_all(&[
            ("HasLow", 1.0),
            ("Low", 0.0),
            ("HasHigh", 1.0),
            ("High", 10.0),
            ("HasRate", 1.0),
            ("Rate", rate),
        ]);
        pins.set_all(&[("Amplitude", amplitude), ("WaitTime", 2.0), ("Longest", 900.0)]);
        pins.set_all(&[("PvLow", -90.0), ("PvHigh", 90.0), ("Rule", 1.0)]);
        let (block, mut reference) = (Block::new::<R>("GlappPidAdvanced"), Reference::<R>::default());
        let mut process = Process { x: [0.0; 3], gain: 1.0, noise: 0.0 };
        let mut draw = Draw::new(1);
        for i in 0..if integrates { 2000 } else { 40 } {
            let before = process.x[2];
            let pv = process.step(block.get("Output"), 0.2, &mut draw);
            if integrates {
                // The last lag integrates.
                process.x[2] = before + 0.2 * process.x[1];
            }
            pins.set_all(&[("Pv", pv), ("Execute", f64::from(i > 2))]);
            beside(&mut reference, &block, &pins, rate as u64, i);
            if block.get("Phase") >= 4.0 {
                break;
            }
        }
        stopped += usize::from(block.get("StopReason") == 4.0);
        without += usize::from(block.get("Phase") == 4.0 && !block.on("HasFoundKp"));
        cover.collect(&block);
    }
    assert_eq!((stopped, without), (2, 1));
}

/// An experiment finds a Kp, and then the loop swings: by that Kp it is detected, but no corrected width goes by it. One that is given takes
/// its place; what begins anew has none.
fn by_a_kp_that_was_found<R: Number>(cover: &mut Cover) {
    let mut pins = row(&[("K", 0.2), ("Ti", 0.5), ("H", 0.2), ("HasOwnSp", 1.0), ("Start", 5.0), ("HasTuner", 1.0)]);
    pins.set_all(&[("HasLow", 1.0), ("HasHigh", 1.0), ("High", 10.0), ("Amplitude", 3.0), ("WaitTime", 2.0)]);
    pins.set_all(&[("Longest", 900.0), ("PvLow", -90.0), ("PvHigh", 90.0), ("N", 1.0), ("HasCompensation", 1.0)]);
    let (block, mut reference) = (Block::new::<R>("GlappPidAdvanced"), Reference::<R>::default());
    let mut process = Process { x: [0.0; 3], gain: 1.0, noise: 0.0 };
    let mut draw = Draw::new(1);
    let (mut swings, mut doubts) = (0, std::collections::BTreeSet::new());
    for i in 0..2500 {
        let found = block.get("Phase") >= 4.0 || swings > 0;
        let pv = if found {
            let half = swings / 16;
            swings += 1;
            pins.set_all(&[
                ("HasKp", f64::from((14..22).contains(&half))),
                ("Kp", 1.2),
                ("Restart", f64::from(swings == 500)),
            ]);
            pins.option("DetectorTf", (half > 24).then_some(0.1));
            (0.5 + 0.1 * f64::from(half % 3)) * if half % 2 == 0 { 1.0 } else { -1.0 }
        } else {
            process.step(block.get("Output"), 0.2, &mut draw)
        };
        pins.set_all(&[("Pv", pv), ("Execute", f64::from(i > 2 && !found))]);
        beside(&mut reference, &block, &pins, 0, i);
        if swings > 160 {
            doubts.insert(block.get("Doubt") as i16);
        }
        if swings > 700 {
            break;
        }
    }
    assert!(swings > 700 && doubts.len() > 1, "{swings} {doubts:?}");
    cover.collect(&block);
}

/// Differences by pin.
fn difference(expected: &[f64], got: &[f64], row: &Row, seed: u64, i: usize) -> String {
    let pins = PID_ADVANCED.shown;
    let name =
        |at: usize| pins.get(at).map_or_else(|| format!("{} of the detection", at - pins.len()), |pin| (*pin).into());
    let off = expected.iter().zip(got).enumerate().filter(|(_, (a, b))| !same(&[**a], &[**b]));
    let off: Vec<String> = off.map(|(at, (a, b))| format!("{} {b:?} instead of {a:?}", name(at))).collect();
    let held: Vec<_> = row.pins.iter().zip(&row.values).filter(|(_, value)| **value != 0.0).collect();
    format!("sequence {seed}, scan {i}: {off:?}\n(else its record)\nfor {held:?}")
}

/// The power goes in the middle of a half-period while u_FF is not 0: output and detections stay, u_FF is 0, and it goes on without a
/// bump once Compensate has been seen off. A program with another version of what is retained drops it, and tells that.
fn power<R: Number>(cover: &mut Cover) {
    let block = Block::new::<R>("GlappPidAdvanced");
    let mut pins = row(&[("K", 0.5), ("Ti", 1.0), ("H", 0.25), ("HasOwnSp", 1.0), ("Start", 5.0), ("N", 3.0)]);
    pins.set_all(&[("HasKp", 1.0), ("Kp", 2.0), ("HasCompensation", 1.0), ("Size", 1.0), ("ReduceByEstimate", 0.0)]);
    let mut reference = Reference::<R>::default();
    let mut run = |pins: &mut Row, from: usize, to: usize| {
        for i in from..to {
            pins.set("Pv", if (i / 24) % 2 == 0 { 1.0 } else { -1.0 });
            let (expected, got) = (reference.scan(pins), scan(&block, pins));
            assert!(agree(&expected, &got), "{}", difference(&expected.row, &got.row, pins, 0, i));
            pins.set(POWER_CUT, 0.0);
        }
    };
    run(&mut pins, 0, 120);
    pins.set("Compensate", 1.0);
    run(&mut pins, 120, 300);
    assert!(block.get("UFf").abs() > 0.1 && block.on("HasWhole"));
    let (output, whole) = (block.get("Output"), block.get("Whole.Value"));
    pins.set(POWER_CUT, 1.0);
    run(&mut pins, 300, 301);
    assert_eq!((block.get("UFf"), block.get("Whole.Value")), (0.0, whole));
    assert!((block.get("Output") - output).abs() < 0.5, "{} to {}", output, block.get("Output"));
    run(&mut pins, 301, 400);
    assert_eq!(block.get("UFf"), 0.0);
    pins.set("Compensate", 0.0);
    run(&mut pins, 400, 401);
    pins.set("Compensate", 1.0);
    run(&mut pins, 401, 500);
    assert!(block.get("UFf").abs() > 0.1);
    for part in ["Law", "Detection"] {
        block.set("Reset", 0.0);
        block.0.borrow_mut().power_cut();
        block.0.borrow_mut().spoil(&format!("{part}.StateVersion"), 9.0).unwrap();
        block.call();
        assert!(block.on("Dropped"));
        block.set("Reset", 1.0);
        block.call();
        assert!(!block.on("Dropped"));
    }
    cover.collect(&block);
}

in_both!(random_lreal, random_real: random);
