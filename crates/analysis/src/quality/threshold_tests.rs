//! Each finding from just within its threshold to just beyond it.

use super::{Fault, Interval, Known, Law, Severity, assumed_gain, inspect};
use crate::{Counter, Inspected, noise_sigma};
use glapp_core::status::BAD;
use std::f64::consts::PI;

/// A recording of one row a second in which nothing is wrong: PV and OP wander, and no value comes twice.
#[derive(Clone)]
struct Rows {
    sp: Vec<f64>,
    pv: Vec<f64>,
    op: Vec<f64>,
    flags: Option<Vec<u8>>,
}

/// The k-th of numbers between 0 and 1 that look random.
fn random(k: usize) -> f64 {
    let x = (k as u64 + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    let x = (x ^ (x >> 31)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    (x >> 11) as f64 / (1u64 << 53) as f64
}

impl Rows {
    fn sound(n: usize) -> Self {
        let pv = (0..n).map(|k| 50.0 + random(k)).collect();
        let op = (0..n).map(|k| 40.0 + random(k + 100_000)).collect();
        Self { sp: vec![50.5; n], pv, op, flags: None }
    }

    /// Severity of a fault that was found; None where it is not.
    fn found(&self, fault: Fault, known: &Known) -> Option<Severity> {
        let t: Vec<f64> = (0..self.pv.len()).map(|k| k as f64).collect();
        let flags = self.flags.as_deref();
        let rows = Inspected { t: &t, sp: Some(&self.sp), pv: &self.pv, op: Some(&self.op), flags };
        let mut counter = Counter::new(3.0, None).unwrap();
        counter.run(&rows);
        inspect(&rows, &counter.statistics, known).iter().find(|one| one.fault == fault).map(|one| one.severity)
    }

    fn finds(&self, fault: Fault) -> bool {
        self.found(fault, &Known::default()).is_some()
    }
}

#[test]
fn more_than_one_value_in_a_hundred_missing_is_many() {
    let without = |missing: usize| {
        let mut rows = Rows::sound(1000);
        (0..missing).for_each(|k| rows.pv[50 * k + 7] = f64::NAN);
        rows.found(Fault::NotANumber, &Known::default())
    };
    assert_eq!((without(10), without(11)), (Some(Severity::Info), Some(Severity::Warning)));
}

#[test]
fn ten_equal_rows_and_all_but_one_in_a_hundred_are_one_signal() {
    let equal = |n: usize, other: usize| {
        let mut rows = Rows::sound(n);
        rows.op = rows.pv.clone();
        (0..other).for_each(|k| rows.op[k] += 1.0);
        rows.finds(Fault::SameSignal)
    };
    assert!(equal(10, 0) && !equal(9, 0));
    assert!(equal(1000, 9) && !equal(1000, 10));
}

#[test]
fn ten_rows_are_few_enough() {
    assert!(Rows::sound(9).finds(Fault::TooFewRows) && !Rows::sound(10).finds(Fault::TooFewRows));
}

#[test]
fn a_setpoint_that_moves_in_most_steps_has_a_master() {
    let moved = |steps: usize| {
        let mut rows = Rows::sound(101);
        (0..steps).for_each(|k| (k + 1..101).for_each(|later| rows.sp[later] += 0.01 * k as f64 + 0.01));
        rows.finds(Fault::CascadeSlave)
    };
    assert!(moved(51) && !moved(50));
}

/// Rows in which all signals repeat for `still` steps, again and again.
fn frozen(n: usize, still: usize, times: usize) -> Rows {
    let mut rows = Rows::sound(n);
    for run in 0..times {
        let from = 10 + run * (still + 30);
        for k in from + 1..=from + still {
            (rows.pv[k], rows.op[k]) = (rows.pv[from], rows.op[from]);
        }
    }
    rows
}

#[test]
fn stretches_of_five_rows_that_repeat_in_two_of_a_hundred_steps_are_frozen() {
    // A step more of each belongs to it: the one in which the values move on.
    assert!(frozen(1000, 5, 4).finds(Fault::Frozen) && !frozen(1000, 5, 3).finds(Fault::Frozen));
    assert!(!frozen(1000, 4, 20).finds(Fault::Frozen));
    let few = |n: usize| {
        let mut rows = frozen(30, 5, 1);
        for of in [&mut rows.sp, &mut rows.pv, &mut rows.op] {
            of.truncate(n);
        }
        rows.finds(Fault::Frozen)
    };
    assert!(few(22) && !few(20), "of fewer than 20 steps there are no shares");
}

#[test]
fn a_pv_that_stands_in_half_of_the_steps_while_op_moves_was_held() {
    let held = |steps: usize| {
        let mut rows = Rows::sound(1001);
        for run in 0..steps / 10 {
            let from = 15 * run;
            (from + 1..=from + 10).for_each(|k| rows.pv[k] = rows.pv[from]);
        }
        rows.finds(Fault::CompressedPv)
    };
    assert!(held(520) && !held(490));
}

#[test]
fn a_pv_on_straight_lines_of_three_steps_was_joined_by_a_historian() {
    // Four values on a line are three moves, and the second and third continue it.
    let joined = |lines: usize, moves: usize| {
        let mut rows = Rows::sound(1001);
        for run in 0..lines {
            let from = 8 * run;
            let by = 0.25 + random(run + 7);
            (1..=moves).for_each(|k| rows.pv[from + k] = rows.pv[from] + by * k as f64);
        }
        rows.finds(Fault::CompressedPv)
    };
    assert!(joined(110, 3) && !joined(95, 3), "two of three moves count: 22 and 19 in a hundred steps");
    assert!(!joined(120, 2), "two of three samples on one line happen by chance");
}

#[test]
fn more_than_one_spike_in_a_thousand_rows_counts() {
    let spiked = |n: usize| {
        let mut rows = Rows::sound(n);
        rows.pv[n / 2] += 500.0;
        rows.found(Fault::Spikes, &Known::default())
    };
    assert_eq!((spiked(900), spiked(1100)), (Some(Severity::Warning), Some(Severity::Info)));
}

#[test]
fn a_loop_winds_up_over_a_hundred_rows_and_ten_ti() {
    let wound = |n: usize, ti: f64| {
        let mut rows = Rows::sound(n);
        (0..n).for_each(|k| (rows.pv[k], rows.op[k]) = (40.0 + random(k), k as f64 + 0.1 * random(k)));
        rows.found(Fault::WindingUp, &Known { ti: Some(ti), ..Known::default() }).is_some()
    };
    assert!(wound(100, 1.0) && !wound(99, 1.0));
    assert!(wound(120, 11.5) && !wound(120, 12.5));
}

#[test]
fn an_op_that_rests_in_three_of_ten_steps_and_never_moves_a_little_has_an_output_dead_band() {
    let rests = |share: f64| {
        let mut rows = Rows::sound(2000);
        for k in 1..2000 {
            let way = if rows.op[k - 1] > 50.0 { -1.0 } else { 1.0 };
            let jump = if random(k + 5000) < share { 0.0 } else { way * (0.8 + 0.4 * random(k + 9000)) };
            rows.op[k] = rows.op[k - 1] + jump;
        }
        rows.finds(Fault::OutputDeadBand)
    };
    assert!(rests(0.36) && !rests(0.24));
}

#[test]
fn a_setting_outside_of_what_is_seen_by_half_as_much_again_is_another() {
    let seen = |value: f64| Interval { value: Some(value), low: Some(0.9 * value), high: Some(1.1 * value) };
    let law = Law { usable: true, r2: Some(0.99), k: seen(2.0), ti: seen(30.0), td: Interval::default() };
    let given = |k: f64| {
        let known = Known { k: Some(k), law: Some(law), ..Known::default() };
        Rows::sound(200).found(Fault::Settings, &known).is_some()
    };
    assert!(given(2.2 * 1.6) && !given(2.2 * 1.4));
    assert!(given(1.8 / 1.6) && !given(1.8 / 1.4));
}

#[test]
fn a_tenth_of_the_width_may_hang_on_an_assumed_gain() {
    assert!(assumed_gain(1.0, 2.0, 0.22).is_some() && assumed_gain(1.0, 2.0, 0.18).is_none());
}

#[test]
fn noise_is_told_by_twenty_differences_of_the_fourth_order() {
    let has_sigma = |n: usize| noise_sigma(&Rows::sound(n).pv).is_some();
    assert!(has_sigma(24) && !has_sigma(23));
}

#[test]
fn more_than_one_bad_row_in_a_hundred_is_many() {
    let mut rows = Rows::sound(100);
    let manual = |rows: usize| (0..100).map(|k| if k < rows { BAD as u8 } else { 0 }).collect::<Vec<u8>>();
    rows.flags = Some(manual(1));
    assert_eq!(rows.found(Fault::BadQuality, &Known::default()), Some(Severity::Info));
    rows.flags = Some(manual(2));
    assert_eq!(rows.found(Fault::BadQuality, &Known::default()), Some(Severity::Warning));
}

#[test]
fn half_periods_that_scatter_by_a_quarter_are_no_linear_oscillation() {
    // Half sines of 200 rows a period, the upper shorter by `less` and the lower longer: they scatter by `less`.
    let swings = |less: f64| {
        let upper = (1.0 - less) / 2.0;
        let wave = |k: usize| {
            let phase = ((k % 200) as f64 + 0.5) / 200.0;
            match phase < upper {
                true => (PI * phase / upper).sin() / upper,
                false => -(PI * (phase - upper) / (1.0 - upper)).sin() / (1.0 - upper),
            }
        };
        let mut rows = Rows::sound(3000);
        rows.pv = (0..3000).map(|k| 50.5 + wave(k)).collect();
        rows.found(Fault::Sinusoidal, &Known { ti: Some(30.0), ..Known::default() }).is_some()
    };
    assert!(swings(0.24) && !swings(0.26));
}

#[test]
fn a_law_that_explains_95_of_100_of_pv_by_op_has_them_exchanged() {
    // OP of a PI controller, and a share of what is not its own, as PV; PV as OP.
    let explains = |share: f64| {
        let mut rows = Rows::sound(2000);
        let (mut pv, mut area, mut other) = (0.0, 0.0, 0.0);
        for k in 0..2000 {
            pv = 0.9 * pv + random(k) - 0.5;
            area += pv;
            other += random(k + 5000) - 0.5;
            rows.op[k] = 50.5 + pv;
            rows.pv[k] = 40.0 - 2.0 * (pv + area / 30.0) + share * other;
        }
        rows.found(Fault::Exchanged, &Known { law: Some(Law::default()), ..Known::default() })
    };
    assert_eq!((explains(0.2), explains(0.8)), (Some(Severity::Refuse), None));
}
