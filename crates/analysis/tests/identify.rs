//! The controller's law, from records of controllers that are known.

use glapp_analysis::Inspected;
use glapp_analysis::identify::{Identification, R2_USABLE, Reason, WIDEST, identified};
use proptest::prelude::*;

/// A controller that runs once a sample.
struct Controller {
    k: f64,
    ti: f64,
    td: f64,
    b: f64,
    /// Two equal lags before it [s]; PV is recorded before them.
    tf: f64,
}

/// t, SP, PV and OP.
type Record = [Vec<f64>; 4];

/// What the controller makes of a PV that a load, two sines and a setpoint step move, every `h` seconds.
fn recorded(by: &Controller, h: f64, n: usize) -> Record {
    let t: Vec<f64> = (0..n).map(|i| i as f64 * h).collect();
    let sp: Vec<f64> = (0..n).map(|i| if i > n / 2 { 51.0 } else { 50.0 }).collect();
    let mut random = 1u32;
    let mut load = 0.0;
    let pv: Vec<f64> = t
        .iter()
        .map(|t| {
            random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            load = 0.95 * load + f64::from(random >> 8) / f64::from(1 << 24) - 0.5;
            50.0 + (t / by.ti).sin() + 0.3 * (3.4 * t / by.ti).sin() + 0.2 * load
        })
        .collect();
    let (mut first, mut yf, mut area) = (pv[0], pv[0], 0.0);
    let op = sp
        .iter()
        .zip(&pv)
        .map(|(sp, pv)| {
            let last = yf;
            first += (pv - first) * h / (by.tf + h);
            yf += (first - yf) * h / (by.tf + h);
            area += (sp - yf) * h;
            55.0 + by.k * (by.b * sp - yf + area / by.ti - by.td * (yf - last) / h)
        })
        .collect();
    [t, sp, pv, op]
}

fn found([t, sp, pv, op]: &Record) -> Identification {
    identified(&Inspected { t, sp: Some(sp), pv, op: Some(op), flags: None }, None, None)
}

#[track_caller]
fn near(x: f64, y: f64, tolerance: f64) {
    assert!((x - y).abs() <= tolerance * y.abs().max(1e-3), "{x} is not {y}");
}

#[test]
fn a_pi_law_is_found_exactly() {
    for (k, ti, h, b) in [(2.0, 30.0, 1.0, 1.0), (-0.4, 20.0, 1.0, 0.0), (0.8, 60.0, 2.0, 0.3)] {
        let by = Controller { k, ti, td: 0.0, b, tf: 0.0 };
        let found = found(&recorded(&by, h, 900));
        let (values, settings) = (found.values.unwrap(), found.settings.unwrap());
        near(values.k, k, 1e-6);
        near(values.ti, ti, 1e-6);
        near(settings.setpoint_weight.unwrap(), b, 1e-6);
        assert_eq!((found.reason, settings.td), (None, 0.0));
        assert!(values.r2 > 1.0 - 1e-9);
        assert!(settings.k_interval.low < k && k < settings.k_interval.high);
        assert!(settings.ti_interval.low < ti && ti < settings.ti_interval.high);
        assert!(settings.note.filter.scans && !settings.note.derivative);
    }
}

#[test]
fn a_pid_law_is_found_with_the_filter_that_nobody_recorded() {
    let by = Controller { k: 1.5, ti: 30.0, td: 7.0, b: 0.0, tf: 1.4 };
    let found = found(&recorded(&by, 0.5, 1500));
    let (values, settings) = (found.values.unwrap(), found.settings.unwrap());
    near(values.k, by.k, 1e-4);
    near(values.ti, by.ti, 1e-4);
    near(settings.td, by.td, 1e-4);
    near(settings.note.filter.tf, by.tf, 1e-3);
    assert_eq!((found.reason, settings.note.derivative, settings.note.filter.order), (None, true, 2));
    assert!(settings.td_interval.low < by.td && by.td < settings.td_interval.high);
}

#[test]
fn what_is_missing_is_said() {
    let by = Controller { k: 2.0, ti: 30.0, td: 0.0, b: 1.0, tf: 0.0 };
    let record = recorded(&by, 1.0, 400);
    let [t, sp, pv, op] = &record;
    let whole = Inspected { t, sp: Some(sp), pv, op: Some(op), flags: None };
    let reason = |samples: Inspected| identified(&samples, None, None).reason;
    assert_eq!(reason(Inspected { op: None, ..whole }), Some(Reason::NoOp));
    assert_eq!(reason(Inspected { sp: None, ..whole }), Some(Reason::NoSp));
    assert_eq!(reason(Inspected { flags: Some(&[1; 400]), ..whole }), Some(Reason::FewSteps));
    assert_eq!(reason(Inspected { t: &t[..50], ..whole }), Some(Reason::FewSteps), "49 steps");
    assert_ne!(reason(Inspected { t: &t[..51], ..whole }), Some(Reason::FewSteps), "50 steps");
    assert_eq!(reason(Inspected { op: Some(&[1.0; 400]), ..whole }), Some(Reason::OpStill));
    assert_eq!(reason(Inspected { pv: &[49.0; 400], ..whole }), Some(Reason::PvStill));
    let highest = op.iter().fold(f64::MIN, |a, b| a.max(*b));
    let within = identified(&whole, None, Some((f64::MIN, highest)));
    assert_eq!(within.samples, 397, "the step to and from the highest OP, and the last of 400 rows");
}

#[test]
fn a_law_of_opposite_signs_is_no_controllers() {
    let by = Controller { k: 2.0, ti: -30.0, td: 0.0, b: 1.0, tf: 0.0 };
    let found = found(&recorded(&by, 1.0, 900));
    assert_eq!((found.reason, found.settings), (Some(Reason::OppositeSigns), None));
    near(found.values.unwrap().ti, -30.0, 1e-6);
}

#[test]
fn op_recorded_late_is_seen() {
    let by = Controller { k: 1.0, ti: 20.0, td: 0.0, b: 1.0, tf: 0.0 };
    for (lag, shift) in [(1, 1), (-1, 899)] {
        let mut record = recorded(&by, 1.0, 900);
        record[3].rotate_right(shift);
        let found = found(&record);
        assert_eq!(found.settings.unwrap().note.lag, lag);
        near(found.values.unwrap().k, 1.0, 1e-2);
    }
}

fn number() -> impl Strategy<Value = f64> {
    let odd = [0.0, 1.0, f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300, -1e300, 5e-324];
    prop_oneof![4 => -1e3..1e3, 1 => prop::sample::select(odd.to_vec())]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn any_numbers_give_an_answer_without_nan(
        rows in prop::collection::vec((number(), number(), number(), number(), 0u8..20), 0..200),
        even in any::<bool>(),
        b in prop::option::of(number()),
        limits in prop::option::of((number(), number())),
    ) {
        let column = |of: fn(&(f64, f64, f64, f64, u8)) -> f64| rows.iter().map(of).collect::<Vec<f64>>();
        let t = if even { (0..rows.len()).map(|k| k as f64).collect() } else { column(|row| row.0) };
        let (sp, pv, op) = (column(|row| row.1), column(|row| row.2), column(|row| row.3));
        let flags: Vec<u8> = rows.iter().map(|row| u8::from(row.4 == 0)).collect();
        let samples = Inspected { t: &t, sp: Some(&sp), pv: &pv, op: Some(&op), flags: Some(&flags) };
        let found = identified(&samples, b, limits);
        let values = found.values.map(|values| [values.k, values.ti, values.r2]);
        prop_assert!(values.is_none_or(|values| values.iter().all(|x| !x.is_nan())), "{found:?}");
        if let Some(settings) = found.settings {
            let [k, ti, td] = [settings.k_interval, settings.ti_interval, settings.td_interval];
            prop_assert!([k, ti, td].iter().all(|one| one.low <= one.high), "{found:?}");
            if found.reason.is_none() {
                let values = found.values.unwrap();
                prop_assert!(values.r2 >= R2_USABLE);
                prop_assert!(ti.high / ti.low <= WIDEST && k.low * k.high > 0.0);
            }
        }
        prop_assert_eq!(found.settings.is_some() && found.values.is_none(), false);
    }

    #[test]
    fn a_record_with_holes_gives_an_answer(
        holes in prop::collection::vec((0usize..400, 0usize..4, number()), 0..40),
    ) {
        let by = Controller { k: 2.0, ti: 30.0, td: 0.0, b: 1.0, tf: 0.0 };
        let mut record = recorded(&by, 1.0, 400);
        for (row, column, x) in holes {
            record[column][row] = x;
        }
        let found = found(&record);
        prop_assert!(found.values.is_none_or(|values| !values.k.is_nan() && !values.r2.is_nan()), "{:?}", found);
    }
}
