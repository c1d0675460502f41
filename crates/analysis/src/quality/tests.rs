use proptest::prelude::*;

use super::*;
use crate::{Counter, MARKED_PV, MARKED_SP};

const N: usize = 2000;

/// A loop's signals: `swing` of e(t) about a setpoint of 50, and a PI controller's OP with K = 1 and Ti = 20 s.
fn signals(swing: impl Fn(f64) -> f64) -> [Vec<f64>; 4] {
    let noise = |k: usize| ((k * k * 7919) % 1009) as f64 / 1009.0 - 0.5;
    let t: Vec<f64> = (0..N).map(|k| k as f64).collect();
    let pv: Vec<f64> = (0..N).map(|k| 50.0 - swing(t[k]) + 0.02 * noise(k)).collect();
    let mut area = 0.0;
    let op = pv.iter().map(|pv| {
        area += 50.0 - pv;
        50.0 + (50.0 - pv) + area / 20.0
    });
    [t.clone(), vec![50.0; N], pv.clone(), op.collect()]
}

/// Slow and fast swings, on no one frequency.
fn ordinary(t: f64) -> f64 {
    (t / 61.0).sin() + (t / 23.0).sin() + (t / 37.0).cos()
}

fn look([t, sp, pv, op]: &[Vec<f64>; 4], flags: Option<&[u8]>, known: &Known) -> Vec<Finding> {
    let rows = Inspected { t, sp: Some(sp), pv, op: Some(op), flags };
    let mut counter = Counter::new(3.0, None).unwrap();
    counter.run(&rows);
    inspect(&rows, &counter.statistics, known)
}

fn faults(signals: &[Vec<f64>; 4]) -> Vec<Fault> {
    look(signals, None, &known()).iter().map(|finding| finding.fault).collect()
}

fn known() -> Known {
    Known { k: Some(1.0), ti: Some(20.0), td: Some(0.0), op_span: Some((0.0, 100.0)), ..Known::default() }
}

fn number(finding: &Finding, name: &str) -> f64 {
    match finding.evidence.iter().chain(&finding.numbers).find(|(of, _)| *of == name) {
        Some((_, Value::Number(x))) => *x,
        Some((_, Value::Count(n))) => *n as f64,
        other => panic!("{name}: {other:?}"),
    }
}

#[test]
fn names_are_of_their_own_and_severities_in_order() {
    for (k, fault) in Fault::ALL.iter().enumerate() {
        assert!(Fault::ALL[k + 1..].iter().all(|other| other.name() != fault.name()));
        assert!(fault.severities().is_sorted());
    }
}

#[test]
fn a_healthy_recording_has_no_finding() {
    assert_eq!(faults(&signals(ordinary)), []);
}

#[test]
fn a_sinusoid_that_is_too_fast_for_backlash() {
    let recorded = signals(|t| (t / 10.0).sin());
    let found = look(&recorded, None, &known());
    assert_eq!(found[0].fault, Fault::Sinusoidal);
    assert!((number(&found[0], "period_s") - 62.8).abs() < 1.0);
    assert_eq!(look(&recorded, None, &Known { ti: Some(6.0), ..known() }), []);
    assert_eq!(look(&recorded, None, &Known::default()), []);
    // The least that Ti can be is enough.
    let ti = Interval { value: Some(30.0), low: Some(20.0), high: Some(90.0) };
    let law = Law { r2: Some(0.99), ti, ..Law::default() };
    assert_eq!(look(&recorded, None, &Known { law: Some(law), ..Known::default() })[0].fault, Fault::Sinusoidal);
}

#[test]
fn an_assumed_gain_that_matters_is_told() {
    assert!(assumed_gain(30.0, 0.45, 0.22).is_some());
    assert_eq!(assumed_gain(30.0, 0.45, 0.04), None);
    assert_eq!(assumed_gain(30.0, f64::NAN, 0.04), None);
}

#[test]
fn a_value_that_is_missing_and_one_that_was_marked_are_counted_apart() {
    let [t, sp, mut pv, op] = signals(ordinary);
    let mut marks = vec![0; N];
    for k in 0..30 {
        pv[100 + k] = f64::NAN;
        marks[100 + k] = if k < 20 { MARKED_PV } else { MARKED_SP };
    }
    let rows = Inspected { t: &t, sp: Some(&sp), pv: &pv, op: Some(&op), flags: None };
    let mut counter = Counter::new(3.0, None).unwrap();
    counter.run_marked(&rows, Some(&marks));
    let of = counter.statistics.pv;
    assert_eq!((of.bad, of.bad_first, of.marked.count, of.marked.first), (10, Some(120), 20, Some(100)));
    let found = inspect(&rows, &counter.statistics, &known());
    let told: Vec<_> = found.iter().map(|finding| (finding.fault, number(finding, "rows"))).collect();
    assert_eq!(told, [(Fault::NotANumber, 10.0), (Fault::BadQuality, 20.0)]);
    // A row that is flagged as bad and has all its numbers is one of bad quality.
    let flags = vec![2; N];
    let [t, sp, pv, op] = signals(ordinary);
    let mut counter = Counter::new(3.0, None).unwrap();
    counter.run(&Inspected { t: &t, sp: Some(&sp), pv: &pv, op: Some(&op), flags: Some(&flags) });
    assert_eq!((counter.statistics.pv.bad, counter.statistics.pv.marked.count), (0, N as u64));
}

/// Any value a column may hold: mostly numbers that repeat, values that others use, and non-numbers.
fn anything() -> impl Strategy<Value = f64> {
    prop_oneof![
        100 => -3.0..3.0,
        100 => (-3..3).prop_map(f64::from),
        1 => any::<f64>(),
        1 => prop_oneof![Just(f64::NAN), Just(f64::INFINITY), Just(-f64::INFINITY), Just(f64::MAX), Just(1e-320)],
    ]
}

fn column() -> impl Strategy<Value = Vec<f64>> {
    prop::collection::vec(anything(), 100..200)
}

proptest! {
    #[test]
    fn any_data_is_inspected(
        (t, sp, pv, op) in (prop::option::of(column()), prop::option::of(column()), column(), prop::option::of(column())),
        flags in prop::option::of(prop::collection::vec((0..64_u8).prop_map(|flag| flag.saturating_sub(48)), 100..200)),
        n in prop_oneof![1 => 0..12_usize, 4 => Just(200)],
        (k, ti, low) in (prop::option::of(anything()), prop::option::of(anything()), prop::option::of(anything())),
    ) {
        let mut t = t.unwrap_or_else(|| (0..300).map(f64::from).collect());
        t.truncate(n);
        let rows = Inspected { t: &t, sp: sp.as_deref(), pv: &pv, op: op.as_deref(), flags: flags.as_deref() };
        let mut counter = Counter::new(3.0, Some((-2.0, 2.0))).unwrap();
        counter.run(&rows);
        let seen = Interval { value: k, low, high: ti };
        let law = Law { usable: true, r2: Some(0.95), k: seen, ti: seen, td: seen };
        for finding in inspect(&rows, &counter.statistics, &Known { k, ti, td: ti, law: Some(law), ..Known::default() }) {
            prop_assert!(finding.fault.severities().contains(&finding.severity), "{:?}", finding);
        }
    }

    #[test]
    fn a_recording_is_counted_alike_whole_and_in_parts(
        rows in prop::collection::vec((anything(), anything(), anything(), anything(), 0..16_u8), 0..60),
        at in 0..60_usize,
    ) {
        let at = at.min(rows.len());
        let mut parts = Counter::new(3.0, Some((-2.0, 2.0))).unwrap();
        let mut whole = parts;
        for (counter, stretches) in [(&mut whole, vec![&rows[..]]), (&mut parts, vec![&rows[..at], &rows[at..]])] {
            for stretch in stretches {
                let column = |of: fn(&(f64, f64, f64, f64, u8)) -> f64| stretch.iter().map(of).collect::<Vec<_>>();
                let (t, sp, pv, op) = (column(|r| r.0), column(|r| r.1), column(|r| r.2), column(|r| r.3));
                let flags: Vec<u8> = stretch.iter().map(|row| row.4).collect();
                let (sp, op, flags) = (Some(&sp[..]), Some(&op[..]), Some(&flags[..]));
                counter.run(&Inspected { t: &t, sp, pv: &pv, op, flags });
            }
        }
        prop_assert_eq!(format!("{:?}", whole.statistics), format!("{:?}", parts.statistics));
    }
}

#[test]
fn a_signal_beyond_its_span_is_told_and_refused_where_all_of_it_is() {
    let [t, sp, pv, op] = signals(ordinary);
    let recorded = [t, sp, pv.clone(), op.clone()];
    let spans = |pv_span, op_span| {
        let known = Known { pv_span, op_span, ..known() };
        look(&recorded, None, &known).into_iter().filter(|finding| finding.fault == Fault::Span).collect::<Vec<_>>()
    };
    let (low, high) = pv.iter().fold((f64::MAX, f64::MIN), |(low, high), pv| (low.min(*pv), high.max(*pv)));
    // A tenth of the span beyond is how far a transmitter reads.
    let width = (high - low) / 1.09;
    assert_eq!(spans(Some((low, low + width)), Some((0.0, 100.0))), []);
    let width = (high - low) / 1.11;
    let [found] = &spans(Some((low, low + width)), Some((0.0, 100.0)))[..] else { panic!() };
    assert_eq!((found.severity, number(found, "high")), (Severity::Warning, high));
    let [found] = &spans(None, Some((0.0, 1.0)))[..] else { panic!() };
    assert_eq!((found.severity, number(found, "span_high")), (Severity::Refuse, 1.0));
}

#[test]
fn an_op_that_no_percentage_would_be_is_told() {
    let [t, sp, pv, op] = signals(ordinary);
    let like = |op: Vec<f64>, op_span| {
        let recorded = [t.clone(), sp.clone(), pv.clone(), op];
        let found = look(&recorded, None, &Known { op_span, ..known() });
        found.into_iter().find(|finding| finding.fault == Fault::Span).map(|finding| finding.evidence[5].1.clone())
    };
    let scaled = |from: f64, to: f64| op.iter().map(|op| from + op / 100.0 * (to - from)).collect::<Vec<_>>();
    let percent = Some((0.0, 100.0));
    assert_eq!(like(scaled(0.0, 1.0), None), Some("fraction".into()));
    assert_eq!(like(scaled(0.0, 1.0), percent), Some("fraction".into()));
    assert_eq!(like(scaled(0.0, 1.0), Some((0.0, 1.0))), None);
    assert_eq!(like(scaled(4.0, 20.0), None), Some("current".into()));
    assert_eq!(like(scaled(4.0, 20.0), percent), None);
    assert_eq!(like(op.clone(), None), None);
}

#[test]
fn a_process_gain_of_the_other_sign_is_told() {
    let recorded = signals(ordinary);
    let findings = |kp| look(&recorded, None, &Known { kp: Some(kp), ..known() });
    assert_eq!(findings(1.3), []);
    let [found] = &findings(-1.3)[..] else { panic!() };
    assert_eq!((found.fault, number(found, "kp"), number(found, "k_seen")), (Fault::Sign, -1.3, 1.0));
}
