//! Names, numbers, units, bounds and defaults of all interfaces of glapp, as JSON:
//! `cargo run -p glapp-analysis --example catalogue > vectors/catalogue.json`.
//!
//! Bounds are what the blocks themselves say when they refuse a value, defaults what the settings' own constructors give for
//! the controller in `defaults_for`.

use glapp_analysis::crossings::Verdict;
use glapp_analysis::quality::Fault;
use glapp_analysis::{FitVerdict, Origin};
use glapp_core::auto_tuner::{Phase, Rule, Stop};
use glapp_core::modules::{
    BacklashDetectionSettings, ForeignDetection, ForeignDetectionSettings, Mode, Pid, PidAdvanced, PidAdvancedSettings,
    PidSettings, Unfit, VARIABLES,
};
use glapp_core::status::FLAGS;
use glapp_core::{
    AutoTuner, AutoTunerSettings, Compensation, CompensationSettings, Conditions, Detector, DetectorSettings, Doubt,
    KP_DEFAULT, PARAMETERS, ParameterError, PhaseLead, Reason, Source, Standing, Way,
};
use serde_json::{Map, Value, json};

const K: f64 = 2.0;
const TI: f64 = 20.0;
const TD: f64 = 4.0;
const H: f64 = 1.0;
const SIZE: f64 = 3.0;
const SHARE: f64 = 0.5;

fn main() {
    println!("{}", text());
}

/// The catalogue.
pub fn text() -> String {
    let catalogue = json!({
        "flags": numbered(FLAGS.iter().map(|(flag, name)| (*name, u64::from(*flag)))),
        "reasons": numbered(Reason::ALL.iter().map(|r| (r.name(), *r as u64))),
        "reason_bits": numbered(Reason::ALL.iter().map(|r| (r.name(), r.bit().into()))),
        "conditions": Conditions::NAMES,
        "standings": numbered(Standing::ALL.iter().map(|s| (s.name(), *s as u64))),
        "sources": numbered(Source::ALL.iter().map(|s| (s.name(), *s as u64))),
        "unfit": numbered(Unfit::ALL.iter().map(|u| (u.name(), *u as u64))),
        "ways": numbered(Way::ALL.iter().map(|w| (w.name(), *w as u64))),
        "longest_delays": Way::ALL.iter().map(|way| (way.name(), way.longest_delay())).collect::<std::collections::BTreeMap<_, _>>(),
        "modes": numbered(Mode::ALL.iter().map(|m| (m.name(), *m as u64))),
        "phases": numbered(Phase::ALL.iter().map(|p| (p.name(), *p as u64))),
        "doubts": numbered(Doubt::ALL.iter().map(|d| (d.name(), *d as u64))),
        "stops": numbered(Stop::ALL.iter().map(|s| (s.name(), *s as u64))),
        "rules": numbered(Rule::ALL.iter().map(|r| (r.name(), *r as u64))),
        "parameters": numbered(PARAMETERS.iter().zip(1..).map(|(name, number)| (*name, number))),
        "verdicts": Verdict::ALL.map(Verdict::name),
        "fit_verdicts": FitVerdict::ALL.map(FitVerdict::name),
        "origins": Origin::ALL.map(Origin::name),
        "findings": Fault::ALL.iter().map(|fault| finding(*fault)).collect::<Vec<_>>(),
        "variables": VARIABLES.map(|v| json!({ "name": v.name, "unit": v.unit, "meaning": v.meaning })),
        "kp_default": KP_DEFAULT,
        "defaults_for": { "k": K, "ti": TI, "td": TD, "h": H, "size": SIZE, "share": SHARE },
        "settings": {
            "detector": detector(),
            "compensation": compensation(),
            "foreign_detection": foreign_detection(),
            "pid": pid(),
            "pid_advanced": pid_advanced(),
            "auto_tuner": auto_tuner(),
            "phase_lead": phase_lead(),
        },
    });
    serde_json::to_string_pretty(&catalogue).expect("plain values")
}

fn numbered<'n>(all: impl Iterator<Item = (&'n str, u64)>) -> Value {
    Value::Object(all.map(|(name, number)| (name.to_owned(), number.into())).collect::<Map<_, _>>())
}

fn finding(fault: Fault) -> Value {
    let severities: Vec<&str> = fault.severities().iter().map(|severity| severity.name()).collect();
    json!({ "code": fault.name(), "severities": severities })
}

/// A setting: its bound is the block's error for a value that is no number.
fn setting<S>(
    [name, unit]: [&str; 2],
    default: Value,
    mut usual: S,
    spoil: fn(&mut S),
    check: fn(&S) -> Result<(), ParameterError>,
) -> Value {
    check(&usual).expect("the defaults are within their bounds");
    spoil(&mut usual);
    let error = check(&usual).expect_err(name);
    assert_eq!(error.name, name, "another setting is refused");
    json!({ "name": name, "unit": unit, "bound": error.bound, "default": default })
}

/// A default as JSON; null for the largest numbers, which mean "no limit".
fn number(x: f64) -> Value {
    if x.abs() >= 1e37 { Value::Null } else { x.into() }
}

macro_rules! settings {
    ($usual:ident, $check:expr, $($name:ident [$unit:literal] = $default:expr, $spoil:expr;)*) => {
        Value::Array(vec![$(setting([stringify!($name), $unit], $default, $usual, $spoil, $check)),*])
    };
}

fn detector() -> Value {
    let s = DetectorSettings::new(K, TI, TD, H);
    settings! { s, |s| Detector::of(s).map(|_| ()),
        k ["OP unit/PV unit"] = Value::Null, |s| s.k = f64::NAN;
        ti ["s"] = Value::Null, |s| s.ti = f64::NAN;
        td ["s"] = Value::Null, |s| s.td = Some(f64::NAN);
        b ["1"] = number(s.b), |s| s.b = f64::NAN;
        kp ["PV unit/OP unit"] = Value::Null, |s| s.kp = Some(f64::NAN);
        pv_span ["PV unit"] = Value::Null, |s| s.pv_span = Some(f64::NAN);
        tf ["s"] = number(s.tf), |s| s.tf = f64::NAN;
        n ["1"] = s.n.into(), |s| s.n = 0;
        max_h ["s"] = number(s.max_h), |s| s.max_h = f64::NAN;
        op_low ["OP unit"] = Value::Null, |s| s.op_limits = Some((2.0, 1.0));
        op_high ["OP unit"] = Value::Null, |s| s.op_limits = Some((1.0, f64::INFINITY));
        op_span ["OP unit"] = Value::Null, |s| s.op_span = Some(f64::NAN);
    }
}

fn compensation() -> Value {
    let s = CompensationSettings::new(Way::Inverse, K, TI, SIZE, SHARE);
    settings! { s, |s| Compensation::new(*s).map(|_| ()),
        k ["OP unit/PV unit"] = Value::Null, |s| s.k = f64::NAN;
        ti ["s"] = Value::Null, |s| s.ti = f64::NAN;
        size ["OP unit"] = Value::Null, |s| s.size = f64::NAN;
        share ["1"] = Value::Null, |s| s.share = f64::NAN;
        limit ["OP unit"] = number(s.limit), |s| s.limit = f64::NAN;
        band ["OP unit"] = number(s.band), |s| s.band = f64::NAN;
        tf ["s"] = number(s.tf), |s| s.tf = f64::NAN;
        rate ["OP unit/s"] = number(s.rate), |s| s.rate = f64::NAN;
        ramp_time ["s"] = number(s.ramp_time), |s| s.ramp_time = f64::NAN;
        release ["s"] = number(s.release), |s| s.release = f64::NAN;
        travel ["OP unit/h"] = number(s.travel), |s| s.travel = f64::NAN;
        reversals ["1/h"] = number(s.reversals), |s| s.reversals = f64::NAN;
        watch ["s"] = number(s.watch), |s| s.watch = f64::NAN;
    }
}

fn foreign_detection() -> Value {
    let detection = BacklashDetectionSettings { detector: DetectorSettings::new(K, TI, TD, H), compensation: None };
    let s = ForeignDetectionSettings::new(detection);
    settings! { s, |s| ForeignDetection::new(*s).map(|_| ()),
        delay ["scans"] = s.delay.into(), |s| s.delay = 0;
        tolerance ["OP unit"] = Value::Null, |s| s.tolerance = Some(f64::NAN);
        longest ["Ti"] = Value::Null, |s| s.longest = Some(f64::NAN);
    }
}

fn pid() -> Value {
    let s = PidSettings::ideal(K, TI, TD);
    settings! { s, |s| Pid::new(*s).map(|_| ()),
        k ["output/PV unit"] = Value::Null, |s| s.k = f64::NAN;
        ti ["s"] = Value::Null, |s| s.ti = f64::NAN;
        td ["s"] = Value::Null, |s| s.td = f64::NAN;
        b ["1"] = number(s.b), |s| s.b = f64::NAN;
        c ["1"] = number(s.c), |s| s.c = f64::NAN;
        tf ["s"] = number(s.tf), |s| s.tf = f64::NAN;
        low ["output"] = number(s.low), |s| s.low = f64::NAN;
        high ["output"] = number(s.high), |s| s.high = f64::NAN;
        rate ["output/s"] = number(s.rate), |s| s.rate = f64::NAN;
        max_h ["s"] = number(s.max_h), |s| s.max_h = f64::NAN;
    }
}

fn phase_lead() -> Value {
    #[derive(Clone, Copy)]
    struct Times {
        lead: f64,
        lag: f64,
    }
    let s = Times { lead: 2.0, lag: 1.0 };
    settings! { s, |s| PhaseLead::new(s.lead, s.lag).map(|_| ()),
        lead ["s"] = Value::Null, |s| s.lead = f64::NAN;
        lag ["s"] = Value::Null, |s| s.lag = f64::NAN;
    }
}

/// Beside those of the controller and of the detector.
fn pid_advanced() -> Value {
    let s = PidAdvancedSettings::new(PidSettings::ideal(K, TI, TD));
    settings! { s, |s| PidAdvanced::new(*s).map(|_| ()),
        detector_tf ["s"] = Value::Null, |s| s.detector_tf = Some(f64::NAN);
        sp_rate ["PV unit/s"] = number(s.sp_rate), |s| s.sp_rate = f64::NAN;
    }
}

fn auto_tuner() -> Value {
    let limits = (0.0, 100.0);
    let s = AutoTunerSettings {
        amplitude: 5.0,
        relay_hysteresis: None,
        d: 0.0,
        wait: 60.0,
        longest: 3600.0,
        max_h: 3.0,
        pv: limits,
        op: limits,
    };
    settings! { s, |s| AutoTuner::new(*s).map(|_| ()),
        amplitude ["OP unit"] = Value::Null, |s| s.amplitude = f64::NAN;
        relay_hysteresis ["PV unit"] = Value::Null, |s| s.relay_hysteresis = Some(f64::NAN);
        d ["OP unit"] = Value::Null, |s| s.d = f64::NAN;
        wait ["s"] = Value::Null, |s| s.wait = f64::NAN;
        longest ["s"] = Value::Null, |s| s.longest = f64::NAN;
        max_h ["s"] = Value::Null, |s| s.max_h = f64::NAN;
        pv_low ["PV unit"] = Value::Null, |s| s.pv.0 = f64::NAN;
        pv_high ["PV unit"] = Value::Null, |s| s.pv.1 = f64::NAN;
        op_low ["OP unit"] = Value::Null, |s| s.op.0 = f64::NAN;
        op_high ["OP unit"] = Value::Null, |s| s.op.1 = f64::NAN;
    }
}
