//! Step tests on a simulated valve and process: what is read, what is refused and why, and what each deciding number does.

use glapp_analysis::step_test::{LEAST_ROWS, Note, Reason};
use glapp_analysis::{Inspected, Manual, ManualRows, StepTest, StepTestSettings};

/// A valve with a dead band, a process of one lag, and a PV with noise, a sample a second.
#[derive(Clone)]
struct Made {
    d: f64,
    kp: f64,
    lag: f64,
    noise: f64,
    /// A step of the load: when, how large.
    load: (usize, f64),
    /// OP and how many rows it is held.
    holds: Vec<(f64, usize)>,
}

impl Default for Made {
    fn default() -> Self {
        let holds = [50.0, 53.0, 56.0, 52.0].map(|op| (op, 100)).to_vec();
        Self { d: 2.0, kp: 0.8, lag: 5.0, noise: 0.1, load: (usize::MAX, 0.0), holds }
    }
}

#[derive(Clone)]
struct Signals {
    t: Vec<f64>,
    pv: Vec<f64>,
    op: Vec<f64>,
}

impl Made {
    fn held(levels: &[f64], rows: usize) -> Self {
        Self { holds: levels.iter().map(|op| (*op, rows)).collect(), ..Self::default() }
    }

    fn signals(&self) -> Signals {
        let op: Vec<f64> = self.holds.iter().flat_map(|(op, rows)| vec![*op; *rows]).collect();
        let mut state = 7u64;
        let mut noise = || {
            let uniform = |_| {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (state >> 11) as f64 / (1u64 << 53) as f64
            };
            self.noise * ((0..12).map(uniform).sum::<f64>() - 6.0)
        };
        let mut valve = op[0];
        let mut pv = 0.8 * valve;
        let step = if self.lag > 0.0 { 1.0 - (-1.0 / self.lag).exp() } else { 1.0 };
        let mut answers = |(k, op): (usize, &f64)| {
            valve = valve.clamp(op - self.d / 2.0, op + self.d / 2.0);
            let load = if k >= self.load.0 { self.load.1 } else { 0.0 };
            pv += (self.kp * valve + load - pv) * step;
            pv + noise()
        };
        let pv = op.iter().enumerate().map(&mut answers).collect();
        Signals { t: (0..op.len()).map(|k| k as f64).collect(), pv, op }
    }

    fn read(&self) -> StepTest {
        self.signals().read(&StepTestSettings::default())
    }
}

impl Signals {
    fn rows(&self) -> Inspected<'_> {
        Inspected { t: &self.t, sp: None, pv: &self.pv, op: Some(&self.op), flags: None }
    }

    fn read(&self, settings: &StepTestSettings) -> StepTest {
        let mut rows = ManualRows::new(Manual::All);
        rows.take(&self.rows(), None);
        rows.read(settings)
    }
}

fn reason(made: &Made) -> Reason {
    made.read().reason.expect("a reason")
}

fn near(a: Option<f64>, b: f64, relative: f64) -> bool {
    a.is_some_and(|a| (a - b).abs() <= relative * b.abs())
}

#[test]
fn what_is_no_test_has_its_reason_with_its_numbers() {
    assert_eq!(reason(&Made::held(&[50.0], 100)), Reason::OneValue);
    assert_eq!(reason(&Made::held(&[50.0, 53.0, 56.0, 59.0], 100)), Reason::NoReversal);
    assert_eq!(reason(&Made::held(&[50.0, 54.0, 50.0], 100)), Reason::NoGain);
    let few = Made { holds: vec![(50.0, 100), (54.0, 100), (58.0, 12), (50.0, 100)], ..Made::default() };
    assert_eq!(reason(&few), Reason::NoGainUnsettled { unsettled: 1, holds: 4 });
    let Reason::AtLeast { reversal, at_least } = reason(&Made::held(&[50.0, 53.0, 56.0, 54.5], 100)) else { panic!() };
    assert!(reversal == 1.5 && (1.2..1.5).contains(&at_least));
    let Reason::UnansweredMoves { largest } = reason(&Made::held(&[50.0, 50.4, 50.8, 50.4], 100)) else { panic!() };
    assert!((largest - 0.4).abs() < 1e-12);
    let slow = Made { lag: 60.0, ..Made::default() };
    let Reason::NotSettled { settled: 0..3, holds: 4, needed } = reason(&slow) else { panic!() };
    assert!(near(slow.read().settle, needed / 1.2, 1e-12), "a hold goes on for a fifth of the settling time");
    let level = |rows| {
        let made = Made::held(&[50.0, 53.0, 56.0, 52.0], rows);
        made.signals().read(&StepTestSettings { integrating: true, ..Default::default() })
    };
    assert_eq!(level(18).reason, Some(Reason::TooFewHolds { settled: 0, rows: 2 * LEAST_ROWS }));
    assert_eq!(level(100).settle, None);
    let signals = Made::default().signals();
    let of = |manual, rows: &Inspected| {
        let mut all = ManualRows::new(manual);
        all.take(rows, None);
        all.read(&StepTestSettings::default()).reason
    };
    let rows = signals.rows();
    assert_eq!(of(Manual::Unknown, &rows), Some(Reason::NoMode));
    assert_eq!(of(Manual::Flagged, &rows), Some(Reason::NeverManual));
    assert_eq!(of(Manual::All, &Inspected { op: None, ..rows }), Some(Reason::NoOp));
    let cut = |n: usize| Inspected { t: &rows.t[..n], pv: &rows.pv[..n], op: rows.op.map(|op| &op[..n]), ..rows };
    assert_eq!(of(Manual::All, &cut(9)), Some(Reason::NoStretch { rows: 10 }));
    assert_eq!(of(Manual::All, &cut(10)), Some(Reason::OneValue));
}

#[test]
fn only_rows_in_manual_count_and_a_stretch_ends_where_time_or_op_is_missing() {
    let signals = Made::default().signals();
    let read = |signals: &Signals, flags: &[u8]| {
        let mut rows = ManualRows::new(Manual::Flagged);
        rows.take(&Inspected { flags: Some(flags), ..signals.rows() }, None);
        rows.read(&StepTestSettings::default())
    };
    let whole = read(&signals, &[1; 400]);
    assert_eq!(whole, signals.read(&StepTestSettings::default()));
    let mut auto = [1; 400];
    auto[299] = 0;
    assert!(read(&signals, &auto).d.is_none(), "the reversal is not in one stretch");
    let mut missing = signals.clone();
    missing.op[299] = f64::NAN;
    assert!(read(&missing, &[1; 400]).d.is_none());
    let mut jumps = signals.clone();
    jumps.t[300..].iter_mut().for_each(|t| *t += 60.0);
    assert!(read(&jumps, &[1; 400]).d.is_none());
    // Batch by batch it is the same.
    let mut rows = ManualRows::new(Manual::All);
    for from in (0..400).step_by(70) {
        let part = from..(from + 70).min(400);
        let op = Some(&signals.op[part.clone()]);
        rows.take(&Inspected { t: &signals.t[part.clone()], sp: None, pv: &signals.pv[part], op, flags: None }, None);
    }
    assert_eq!(rows.read(&StepTestSettings::default()), whole);
}

#[test]
fn of_many_holds_the_first_sixty_are_read() {
    let levels: Vec<f64> = (0..62).map(|i| f64::from(50 + 4 * (i % 3) - 2 * (i % 2))).collect();
    let found = Made { noise: 0.02, ..Made::held(&levels, 50) }.read();
    assert!(found.notes.contains(&Note::FirstHolds { read: 60, left: 2 }), "{:?}", found.notes);
}

#[test]
fn three_short_holds_are_enough_for_an_interval() {
    let made = Made { lag: 0.0, noise: 0.01, ..Made::held(&[50.0, 54.0, 58.0, 53.0], 22) };
    let found = made.read();
    assert!(found.d.is_some_and(|d| (d - 2.0).abs() < 0.2), "{found:?}");
}

/// F ratio of a test in which the load steps by so much between the third and the fourth hold.
fn misfit(load: f64, noise: f64) -> Option<f64> {
    let levels = [50.0, 54.0, 58.0, 53.0, 48.0, 54.0, 58.0, 52.0];
    let found = Made { load: (300, load), noise, ..Made::held(&levels, 100) }.read();
    found.notes.iter().find_map(|note| if let Note::Disagree { f } = note { Some(*f) } else { None })
}

#[test]
fn holds_that_lie_off_the_model_widen_the_interval_from_an_f_ratio_of_four_on() {
    let least = (1..200).find_map(|k| misfit(0.005 * f64::from(k), 0.1));
    assert!(least.is_some_and(|f| (4.0..4.4).contains(&f)), "{least:?}");
    // This number comes from the code: half of what F is measured against is that PV may be off by a thousandth of its range.
    let found = misfit(0.5, 0.05);
    assert!(near(found, 77.305353, 1e-5), "{found:?}");
}
