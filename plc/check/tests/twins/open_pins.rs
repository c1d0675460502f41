//! An open pin means the core's default: what the pins begin with that do not begin with 0 or FALSE.

use crate::common::blocks::pascal;
use crate::common::{Block, Number};
use glapp_core::modules::PidSettings;
use glapp_core::{CompensationSettings, CompensationState, Conditions, Way};

const HOLDERS: [(&str, &str); 5] = [
    ("GlappSafetyNet", "c"),
    ("GlappDetectorCheck", "cd"),
    ("GlappDetector", "cd"),
    ("GlappBacklashDetectionCheck", "cdm"),
    ("GlappBacklashDetection", "cdms"),
];
const OTHERS: [(&str, &str); 9] = [
    ("GlappPidAdvanced", "bnmsp"),
    ("GlappForeignDetection", "cdmsf"),
    ("GlappCompensationCheck", "m"),
    ("GlappCompensation", "ms"),
    ("GlappWidth", "b"),
    ("GlappPidCheck", "b"),
    ("GlappPidLaw", "b"),
    ("GlappPid", "bp"),
    ("GlappMedianMean", "n"),
];

/// Values that mean not given, or not known.
const NOTHING: [(&str, &[&str], f64); 18] = [
    ("GlappDetector", &["Settings.Tf", "Inner.Used.Td", "NoiseFloor"], -1.0),
    ("GlappDetector", &["Record.PreviousDeltaY", "Record.NoiseFloor", "Record.Sigma"], -1.0),
    ("GlappDetector", &["Op", "Inner.Raw", "Record.DHatBefore"], 1e38),
    ("GlappBacklashDetection", &["Settings.Compensation.MaxWidth", "Settings.Compensation.Band"], -1.0),
    (
        "GlappBacklashDetection",
        &["Settings.Compensation.RampTime", "Inner.Used.Tolerance", "Detected.NoiseFloor"],
        -1.0,
    ),
    ("GlappBacklashDetection", &["Output", "Inner.Raw", "Inner.Beside", "Inner.UFfThere", "Detected.UFb"], 1e38),
    ("GlappForeignDetection", &["Settings.Tolerance", "Settings.LongestDelay"], -1.0),
    ("GlappForeignDetection", &["Op", "UFfBack"], 1e38),
    ("GlappCompensation", &["DHat", "Offered"], 1e38),
    ("GlappStiction", &["Settings.MaxSize", "Settings.Band"], -1.0),
    ("GlappPid", &["Settings.Low", "Back.Low"], -1e38),
    ("GlappPid", &["Settings.High", "Back.High", "OwnSp", "ManualOutput"], 1e38),
    ("GlappPidAdvanced", &["Settings.DetectorTf"], -1.0),
    ("GlappAutoTuner", &["Settings.RelayHysteresis", "Inner.Used.RelayHysteresis", "Experimented.Kappa"], -1.0),
    ("GlappPidLaw", &["Low"], -1e38),
    ("GlappPidLaw", &["High", "U"], 1e38),
    ("GlappSafetyNet", &["DHat"], 1e38),
    ("GlappBacklash", &["Start"], 1e38),
];
const UNKNOWN: [(&str, &str, f64); 9] = [
    ("GlappWidth", "Td", -1.0),
    ("GlappSafetyNet", "Previous", -1.0),
    ("GlappNoiseLevel", "Sigma", -1.0),
    ("GlappSwing", "Travel", -1.0),
    ("GlappExperiment", "Kappa", -1.0),
    ("GlappCorrected", "Doubt", 1.0),
    ("GlappCorrection", "Doubt", 9.0),
    ("GlappStiction", "Settings.Push", 1.0),
    ("GlappStiction", "Settings.Withdraw", 1.0),
];

/// Pins and members that begin with a number that they cannot have.
fn nothing<R: Number>() {
    let many = NOTHING.iter().flat_map(|(name, pins, x)| pins.iter().map(move |pin| (*name, *pin, *x)));
    for (name, pin, x) in many.chain(UNKNOWN) {
        assert_eq!(Block::new::<R>(name).get(pin), R::of(x).as_f64(), "{name}.{pin}");
    }
}

fn open<R: Number>() {
    let on = |x: bool| f64::from(u8::from(x));
    let usual = CompensationSettings::new(Way::Inverse, 1.0, 1.0, 0.0, 1.0);
    for (name, groups) in HOLDERS.into_iter().chain(OTHERS) {
        let block = Block::new::<R>(name);
        let mut expected: Vec<(String, f64)> = vec![];
        let has = |group: char| groups.contains(group);
        if has('c') {
            let mut conditions = Conditions::default();
            expected.extend(Conditions::NAMES.map(|one| (pascal(one), on(*conditions.switch(one).unwrap()))));
        }
        if has('d') || has('b') {
            expected.push(("B".into(), PidSettings::ideal(1.0, 1.0, 0.0).b));
        }
        if has('d') || has('n') {
            expected.push(("N".into(), 9.0));
        }
        if has('m') {
            expected.push(("Way".into(), f64::from(usual.way as u8)));
            expected.push(("Source".into(), f64::from(usual.source as u8)));
            expected.push(("Share".into(), 1.0));
            expected.extend([("Withdraw".into(), on(usual.withdraw)), ("ReduceByEstimate".into(), on(usual.estimate))]);
        }
        if has('s') {
            expected.push(("Standing".into(), f64::from(CompensationState::<f64>::default().standing as u8)));
        }
        if has('f') {
            expected.push(("DelayScans".into(), 1.0));
        }
        if has('p') {
            expected.push(("Mode".into(), 1.0));
        }
        for (pin, value) in expected {
            assert_eq!(block.get(&pin), value, "{name}.{pin}");
        }
    }
    // With nothing known there is no detection to compensate by, and there are no pairs for a corrected width (numbers
    // of the catalogue).
    for name in ["GlappBacklashDetection", "GlappForeignDetection", "GlappPidAdvanced"] {
        assert_eq!(Block::new::<R>(name).all(&["Unsuited", "Doubt"]), [1.0, 9.0], "{name}");
    }
    assert_eq!(Block::new::<R>("GlappBacklashDetectionCheck").get("DelayScans"), 1.0);
    for name in ["GlappAutoTuner", "GlappPidAdvanced"] {
        assert_eq!(Block::new::<R>(name).get("Rule"), 1.0, "{name}");
    }
    assert_eq!(Block::new::<R>("GlappNoise").get("Seed"), 1.0);
    let ones = [("GlappCompensation", "UKnown"), ("GlappHalfPeriod", "SlopeFits"), ("GlappOverCompensation", "Take")];
    for (name, pin) in ones {
        assert!(Block::new::<R>(name).on(pin), "{name}.{pin}");
    }
}

/// Settings that were checked before are in force without a word about those on the pins.
fn checked_before<R: Number>() {
    for name in ["GlappDetector", "GlappCompensation", "GlappBacklashDetection", "GlappPid", "GlappAutoTuner"] {
        let block = Block::new::<R>(name);
        for _ in 0..2 {
            block.set("Checked", 0.0);
            block.call();
            assert!(block.on("Error") && block.get("ErrorID") > 0.0, "{name}");
            block.set("Checked", 1.0);
            block.call();
            assert_eq!(block.all(&["Error", "ErrorID"]), [0.0; 2], "{name}");
        }
    }
}

in_both!(lreal, real: checked_before, open, nothing);
