//! Settings saved and read again: the same to the bit, by the names that the catalogue has.
#![cfg(feature = "serde")]

use glapp_core::auto_tuner::Rule;
use glapp_core::modules::{
    BacklashDetectionSettings, ForeignDetectionSettings, Gains, PidAdvancedSettings, PidSettings, SCHEDULE_ROWS,
};
use glapp_core::{AutoTunerSettings, CompensationSettings, DetectorSettings, Way};
use serde::{Serialize, de::DeserializeOwned};
use std::fmt::Debug;

fn survives<S: Serialize + DeserializeOwned + PartialEq + Debug>(settings: S) -> serde_json::Value {
    let saved = serde_json::to_string(&settings).unwrap();
    assert_eq!(serde_json::from_str::<S>(&saved).unwrap(), settings);
    serde_json::from_str(&saved).unwrap()
}

#[test]
fn what_is_saved_is_read_again() {
    let detector = DetectorSettings { kp: Some(1.0 / 3.0), ..DetectorSettings::new(-0.7, 12.3, 1.1, 0.1) };
    let compensation = CompensationSettings::new(Way::Inverse, -0.7, 12.3, 2.2, 0.8);
    let pid = PidSettings { low: 0.0, high: 100.0, ..PidSettings::ideal(-0.7, 12.3, 1.1) };
    let mut schedule = [Gains::default(); SCHEDULE_ROWS];
    schedule[0] = Gains { at: 40.0, k: -0.9, ti: 11.0, td: 0.0 };
    let tuner = AutoTunerSettings {
        amplitude: 5.0,
        relay_hysteresis: None,
        d: 0.3,
        wait: 60.0,
        longest: 3600.0,
        max_h: 3.0,
        pv: (0.0, 50.0),
        op: (10.0, 90.0),
    };
    assert_eq!(survives(detector)["kp"], 1.0 / 3.0);
    assert_eq!(survives(compensation)["share"], 0.8);
    assert_eq!(survives(pid)["high"], 100.0);
    assert_eq!(survives(tuner)["longest"], 3600.0);
    let detection = BacklashDetectionSettings { detector, compensation: Some(compensation) };
    survives(detection);
    survives(ForeignDetectionSettings {
        delay: 7,
        tolerance: Some(0.3),
        longest: Some(0.4),
        ..ForeignDetectionSettings::new(detection)
    });
    let advanced = PidAdvancedSettings {
        pid,
        kp: None,
        pv_span: Some(50.0),
        op_span: None,
        integrating: true,
        detector_tf: Some(2.2),
        n: 9,
        sp_rate: f64::MAX,
        schedule,
        rows: 1,
        compensation: Some(compensation),
        tuner: Some(tuner),
        rule: Rule::AmigoPi,
    };
    let saved = survives(advanced);
    assert_eq!((&saved["compensation"]["size"], &saved["tuner"]["wait"]), (&2.2.into(), &60.0.into()));
}

#[test]
fn settings_saved_before_there_were_spans_are_read() {
    let detector = DetectorSettings::new(0.7, 12.3, 1.1, 0.1);
    let mut saved = serde_json::to_value(detector).unwrap();
    for name in ["pv_span", "integrating"] {
        assert!(saved.as_object_mut().unwrap().remove(name).is_some());
    }
    assert_eq!(serde_json::from_value::<DetectorSettings<f64>>(saved).unwrap(), detector);
}

#[test]
fn a_setting_that_is_missing_is_named() {
    let error = serde_json::from_str::<PidSettings<f64>>(r#"{"k": 1.0}"#).unwrap_err();
    assert!(error.to_string().contains("missing field `ti`"), "{error}");
}
