//! Long sums in a PLC's REAL: `f32` beside `f64` on the same samples, which both can hold exactly.
//!
//! While the sums of `f32` were plain, what a sample adds was less than half of the last digit, and lost. What came of it then is
//! noted in each test.

use glapp_core::modules::{
    self, Gains, PidAdvanced, PidAdvancedSettings, PidAdvancedState, PidSettings, SCHEDULE_ROWS,
};
use glapp_core::{
    AutoTuner, AutoTunerSettings, AutoTunerState, Backward, Carried, Detector, DetectorState, Forward, MedianMean, Pid,
    PidState, RateLimit, RateLimitState, Real, SafetyNet, Sample, Saturation, SecondOrderFilter,
    SecondOrderFilterState, Sum, Width,
};
use proptest::prelude::*;

/// A hundredth of a second, the same in both.
const H: f32 = 0.01;

#[track_caller]
fn assert_close(single: f64, double: f64, share: f64) {
    assert!((single - double).abs() <= share * double.abs(), "{single} instead of {double}");
}

fn hold_an_error<R: Real>(ti: f64, error: f32, samples: u32) -> f64 {
    let pi = Pid::<R>::new(R::ONE, R::of(ti), R::ZERO, R::ONE, Saturation::none()).unwrap();
    let mut state = PidState::default();
    let (h, sp) = (R::of(H.into()), R::of(error.into()));
    pi.track(&mut state, R::ZERO, R::ZERO, R::of(50.0), h);
    (0..samples).map(|_| pi.update(&mut state, sp, R::ZERO, h)).last().unwrap().as_f64()
}

#[test]
fn an_integral_does_not_stand_still() {
    // A tenth for 1000 s = Ti: a tenth more, twice. It stood still at 50.1.
    let double = hold_an_error::<f64>(1000.0, 0.1, 100_000);
    assert!((double - 50.2).abs() < 1e-6);
    assert_close(hold_an_error::<f32>(1000.0, 0.1, 100_000), double, 1e-7);
}

#[test]
fn an_hour_of_a_small_error() {
    let double = hold_an_error::<f64>(300.0, 0.05, 360_000);
    assert!((double - 50.65).abs() < 1e-6);
    assert_close(hold_an_error::<f32>(300.0, 0.05, 360_000), double, 1e-7); // 50.05 once
}

fn step<R: Real>(tf: f64, from: f64, to: f64, samples: u32) -> f64 {
    let filter = SecondOrderFilter::new(R::of(tf)).unwrap();
    let mut state = SecondOrderFilterState::default();
    let h = R::of(H.into());
    filter.update(&mut state, R::of(from), h);
    (0..samples).map(|_| filter.update(&mut state, R::of(to), h)).last().unwrap().as_f64()
}

#[test]
fn a_filter_of_a_large_number_comes_to_rest_where_its_input_is() {
    let double = step::<f64>(10.0, 101_325.0, 101_425.0, 20_000);
    assert!((double - 101_425.0).abs() < 1e-3);
    assert_close(step::<f32>(10.0, 101_325.0, 101_425.0, 20_000), double, 1e-7); // 8 Pa below once
}

#[test]
fn a_slow_filter_does_not_stop_short() {
    // Tf = 10⁴h, from 1000 to 1001: after 2Tf it has gone 59 % of the way; it went 39 %, and no further.
    for samples in [20_000, 200_000] {
        let double = step::<f64>(100.0, 1000.0, 1001.0, samples);
        assert_close(step::<f32>(100.0, 1000.0, 1001.0, samples), double, 1e-7);
    }
}

/// The last width of square waves of PV around `centre`.
fn width_of_squares<R: Real>(centre: f64, height: f64, half: u32, tf: f64, ti: f64) -> f64 {
    let detector = Detector::new(
        SecondOrderFilter::new(R::of(tf)).unwrap(),
        Width::new(R::ONE, R::of(ti), Some(R::ZERO), R::ONE, Some(R::of(2.0))).unwrap(),
        SafetyNet::new(None).unwrap(),
        MedianMean::new(1).unwrap(),
        R::ONE,
        None,
    )
    .unwrap();
    let (mut state, mut last) = (DetectorState::default(), None);
    for k in 0..4 * half + 2 + (3.0 * tf / f64::from(H)) as u32 {
        let pv = if (k / half).is_multiple_of(2) { centre - height } else { centre + height };
        let sample = Sample { h: R::of(H.into()), sp: R::of(centre), pv: R::of(pv), op: None, flags: 0 };
        last = detector.update(&mut state, &sample).or(last);
    }
    let last = last.expect("half-periods");
    assert_eq!(last.mask, 0, "{last:?}");
    last.parts.d.as_f64()
}

#[test]
fn a_detector_of_a_large_number_reads_the_same_width() {
    let widths = |centre| {
        (
            width_of_squares::<f32>(centre, 8.0, 12_000, 10.0, 10.0),
            width_of_squares::<f64>(centre, 8.0, 12_000, 10.0, 10.0),
        )
    };
    let (single, double) = widths(101_325.0);
    assert_close(single, double, 1e-5); // 2 instead of 76 once
    assert_close(double, widths(0.0).1, 1e-9);
}

#[test]
fn a_million_samples_in_a_half_period() {
    let single = width_of_squares::<f32>(50.0, 1.0, 1_000_000, 0.0, 1000.0);
    let double = width_of_squares::<f64>(50.0, 1.0, 1_000_000, 0.0, 1000.0);
    assert_close(single, double, 1e-6); // 1.4 % less once
}

fn ramp<R: Real>(rate: f64, from: f64, samples: u32) -> f64 {
    let limit = RateLimit::new(R::of(rate)).unwrap();
    let mut state = RateLimitState::at(R::of(from));
    let (far, h) = (R::of(1e9), R::of(H.into()));
    (0..samples).map(|_| limit.update(&mut state, far, h)).last().unwrap().as_f64()
}

#[test]
fn a_slow_ramp_goes_on() {
    // 0.1 Pa a second from the pressure of the air: it stood still.
    let double = ramp::<f64>(0.1, 101_325.0, 100_000);
    assert!((double - 101_425.0).abs() < 1e-3);
    assert_close(ramp::<f32>(0.1, 101_325.0, 100_000), double, 1e-7);
}

/// SP on its ramp, and the output of the controller, whose gains change in every scan where there is a schedule.
fn ramped_setpoint<R: Real>(scheduled: bool) -> [f64; 2] {
    let of = |x: f64| R::of(x);
    let mut schedule = [Gains::default(); SCHEDULE_ROWS];
    schedule[0] = Gains { at: of(0.0), k: of(1.0), ti: of(300.0), td: of(0.0) };
    schedule[1] = Gains { at: of(1.0), k: of(1.25), ti: of(300.0), td: of(0.0) };
    let settings = PidAdvancedSettings {
        sp_rate: of(1e-4),
        schedule,
        rows: if scheduled { 2 } else { 0 },
        ..PidAdvancedSettings::new(PidSettings { tf: of(0.0), ..PidSettings::ideal(of(1.0), of(300.0), of(0.0)) })
    };
    let pid = PidAdvanced::new(settings).unwrap();
    let mut state = PidAdvancedState::at(of(50.0));
    let zero = Forward::from(R::ZERO);
    state.pid.sp = of(60.0);
    let mut u = R::ZERO;
    for k in 0..360_000 {
        let by = Forward::from(of(if k % 2 == 0 { 0.25 } else { 0.75 }));
        u = pid.forward(&mut state, of(40.0).into(), zero, zero, by, of(H.into())).value;
        pid.backward(&mut state, Backward::default());
    }
    [state.pid.ysp.value().as_f64(), u.as_f64()]
}

#[test]
fn a_setpoint_on_a_slow_ramp_moves_and_so_does_the_output() {
    for scheduled in [false, true] {
        let ([sp, u], [double_sp, double_u]) = (ramped_setpoint::<f32>(scheduled), ramped_setpoint::<f64>(scheduled));
        assert!((double_sp - 40.36).abs() < 1e-6, "{double_sp}");
        assert_close(sp, double_sp, 1e-7);
        // Every change of gains sets the integral anew from the output, which is rounded: by chance, not one way.
        assert_close(u, double_u, if scheduled { 1e-5 } else { 2e-7 });
    }
}

/// A derivative takes differences of the filtered PV, which moves by less than the last digit of a large number: were it rounded
/// before, each of those digits would be a kick of 0.08.
fn derivative_kicks<R: Real>(centre: f64) -> f64 {
    let of = |x: f64| R::of(x);
    let settings = PidSettings { tf: of(2.0), ..PidSettings::ideal(of(0.01), of(100.0), of(10.0)) };
    let pid = modules::Pid::new(settings).unwrap();
    let mut state = modules::PidState::at(of(50.0));
    state.sp = of(centre);
    let zero = Forward::from(R::ZERO);
    let (mut before, mut most) = (50.0, 0.0_f64);
    for k in 0..20_000 {
        let pv = of(centre + f64::from(k / 1000));
        let u = pid.forward(&mut state, pv.into(), zero, zero, of(H.into())).value.as_f64();
        pid.backward(&mut state, Backward::default());
        // Far from the steps of PV the output moves by little.
        if k % 1000 > 900 {
            most = most.max((u - before).abs());
        }
        before = u;
    }
    most
}

#[test]
fn a_derivative_of_a_large_number_does_not_kick() {
    let (single, double) = (derivative_kicks::<f32>(101_325.0), derivative_kicks::<f64>(101_325.0));
    assert!(single < 1.1 * double + 1e-4, "{single} instead of {double}");
}

/// A relay experiment on three lags, sampled some ten thousand times a cycle.
fn experiment<R: Real>() -> [f64; 3] {
    let of = |x: f64| R::of(x);
    let tuner = AutoTuner::new(AutoTunerSettings {
        amplitude: of(6.0),
        relay_hysteresis: Some(of(0.05)),
        d: of(0.0),
        wait: of(1.0),
        longest: of(1e6),
        max_h: of(1.0),
        pv: (of(-1e3), of(1e3)),
        op: (of(-1e3), of(1e3)),
    })
    .unwrap();
    let mut state = AutoTunerState::default();
    tuner.start(&mut state, R::ZERO);
    // A plant computed in f64 for both, so that nothing but the tuner's own sums differs.
    let (mut x, mut op) = ([0.0_f64; 3], 0.0);
    while state.phase.is_running() {
        let a = f64::from(H) / 100.0;
        x = [x[0] + (op - x[0]) * a, x[1] + (x[0] - x[1]) * a, x[2] + (x[1] - x[2]) * a];
        op = tuner.update(&mut state, of(x[2]), of(H.into()), 0).as_f64();
    }
    let found = state.found.expect("an experiment that is done");
    [found.ku, found.tu, found.kp.unwrap_or(R::ZERO)].map(Real::as_f64)
}

#[test]
fn an_experiment_of_many_samples() {
    let (single, double) = (experiment::<f32>(), experiment::<f64>());
    for (one, other) in single.into_iter().zip(double) {
        assert_close(one, other, 2e-5);
    }
}

proptest! {
    /// Against the sum in f64 of the same numbers, whatever their signs and sizes.
    #[test]
    fn a_sum_carries_what_it_rounds_off(start in -1e6..1e6_f32, x in prop::collection::vec(-1.0..1.0_f32, 1..2000)) {
        let mut sum = Carried::from(start);
        let (mut exact, mut path) = (f64::from(start), 0.0);
        for &x in &x {
            sum.add(x);
            exact += f64::from(x);
            path += f64::from(x).abs();
        }
        // The sum is as good as its last digit, what was added as good as the last digits of its parts and its own.
        let lost = 1.2e-7 * path;
        prop_assert!((f64::from(sum.value()) - exact).abs() <= 6e-8 * exact.abs() + lost);
        prop_assert!((f64::from(sum.to(start)) - (f64::from(start) - exact)).abs() <= lost);
    }

    /// Goes there and no further, up and down alike.
    #[test]
    fn approach_is_symmetric_and_arrives(from in -10.0..10.0_f32, to in -10.0..10.0_f32, step in 0.001..3.0_f32) {
        let (mut sum, mut mirrored) = (Carried::from(from), Carried::from(-from));
        for _ in 0..(20.0 / step) as u32 + 2 {
            let before = sum.value();
            sum.approach(to, step);
            mirrored.approach(-to, step);
            prop_assert!(sum.value() == -mirrored.value());
            prop_assert!((sum.value() - before).abs() <= step * (1.0 + 1e-6) + 1e-6);
        }
        prop_assert_eq!(sum.value(), to);
    }
}
