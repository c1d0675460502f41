//! Information that a controller's law needs, and an answer for any numbers; tests/test_identify.py has known
//! controllers.

use glapp_analysis::Inspected;
use glapp_analysis::identify::{R2_USABLE, Reason, WIDEST, identified};
use proptest::prelude::*;

/// t, SP, PV and OP: what a PI controller with K = 2 and Ti = 30 s makes of a PV that a load, two sines and a setpoint step move, every
/// second.
fn recorded(n: usize) -> [Vec<f64>; 4] {
    let t: Vec<f64> = (0..n).map(|i| i as f64).collect();
    let sp: Vec<f64> = (0..n).map(|i| if i > n / 2 { 51.0 } else { 50.0 }).collect();
    let mut random = 1u32;
    let mut load = 0.0;
    let pv: Vec<f64> = t
        .iter()
        .map(|t| {
            random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            load = 0.95 * load + f64::from(random >> 8) / f64::from(1 << 24) - 0.5;
            50.0 + (t / 30.0).sin() + 0.3 * (3.4 * t / 30.0).sin() + 0.2 * load
        })
        .collect();
    let mut area = 0.0;
    let op = sp.iter().zip(&pv).map(|(sp, pv)| {
        area += sp - pv;
        55.0 + 2.0 * (sp - pv + area / 30.0)
    });
    let op = op.collect();
    [t, sp, pv, op]
}

#[test]
fn what_is_missing_is_said() {
    let [t, sp, pv, op] = &recorded(400);
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
}
