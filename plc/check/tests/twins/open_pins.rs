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
    // Nothing known: no detection to compensate by, no pairs for a corrected width (numbers of the catalogue).
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

#[test]
fn lreal() {
    checked_before::<f64>();
    open::<f64>();
}

#[test]
fn real() {
    checked_before::<f32>();
    open::<f32>();
}
