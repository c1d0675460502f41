//! Properties of a relay experiment: its end, whatever comes, and its result where the truth is known.

use glapp_core::auto_tuner::{Found, Phase, Stop};
use glapp_core::status::{AT_HIGH, AT_LOW, BAD, DATA_GAP, NOT_AUTO, Status};
use glapp_core::{
    AutoTuner, AutoTunerSettings, AutoTunerState, Backlash, BacklashState, Noise, NoiseState, Real, SecondOrderFilter,
    SecondOrderFilterState,
};
use proptest::prelude::*;

type State = AutoTunerState<f64>;

const USUAL: AutoTunerSettings<f64> = AutoTunerSettings {
    amplitude: 6.0,
    relay_hysteresis: None,
    d: 0.0,
    wait: 4.0,
    longest: 200.0,
    max_h: 0.5,
    pv: (-50.0, 50.0),
    op: (0.0, 100.0),
};

/// Three lags of `t` seconds, at rest at PV = 0 under OP = 50: Ku = 8/gain, Tu = 2π·t/√3.
struct Lags<R: Real> {
    gain: R,
    filter: SecondOrderFilter<R>,
    state: SecondOrderFilterState<R>,
    t: R,
    last: R,
}

impl<R: Real> Lags<R> {
    fn new(gain: f64, t: f64) -> Self {
        let mut state = SecondOrderFilterState::default();
        let filter = SecondOrderFilter::new(R::of(t)).unwrap();
        filter.update(&mut state, R::ZERO, R::ONE);
        Self { gain: R::of(gain), filter, state, t: R::of(t), last: R::ZERO }
    }

    /// PV after `h` seconds under `op`, in forty steps.
    fn update(&mut self, op: R, h: R) -> R {
        let step = h / R::of(40.0);
        for _ in 0..40 {
            let two = self.filter.update(&mut self.state, self.gain * (op - R::of(50.0)), step);
            self.last += (two - self.last) * (step / (self.t + step));
        }
        self.last
    }
}

fn tuner(settings: AutoTunerSettings<f64>) -> AutoTuner<f64> {
    AutoTuner::new(settings).unwrap()
}

/// Drives an experiment on three lags of 1 s until `at` holds, or it is over.
fn drive(tuner: &AutoTuner<f64>, state: &mut State, at: impl Fn(&State) -> bool) {
    let mut process = Lags::new(1.0, 1.0);
    tuner.start(state, 50.0);
    while state.phase.is_running() && !at(state) {
        let pv = process.update(state.output, 0.1);
        tuner.update(state, pv, 0.1, 0);
    }
}

/// Every mode that a fault can meet, with its name.
fn modes() -> Vec<(&'static str, State)> {
    let usual = tuner(USUAL);
    let reach = |at: fn(&State) -> bool| {
        let mut state = State::default();
        drive(&usual, &mut state, at);
        assert!(at(&state));
        state
    };
    let mut aborted = reach(|s| s.phase == Phase::Biased);
    usual.update(&mut aborted, 0.0, 0.1, DATA_GAP);
    vec![
        ("idle", State::default()),
        ("waiting, no sample yet", reach(|s| s.phase == Phase::Waiting)),
        ("waiting", reach(|s| s.phase == Phase::Waiting && s.t > 2.0)),
        ("first push", reach(|s| s.phase == Phase::Balanced)),
        ("balanced, OP up", reach(|s| s.phase == Phase::Balanced && s.cycles == 2 && s.output > 50.0)),
        ("balanced, OP down", reach(|s| s.phase == Phase::Balanced && s.cycles == 2 && s.output < 50.0)),
        ("biased, OP up", reach(|s| s.phase == Phase::Biased && s.output > 50.0)),
        ("biased, OP down", reach(|s| s.phase == Phase::Biased && s.output < 50.0)),
        ("done", reach(|s| s.phase == Phase::Done)),
        ("aborted", aborted),
    ]
}

/// Every fault: PV, h, flags, and the reason that it must give.
const FAULTS: [(f64, f64, Status, Stop); 15] = [
    (f64::NAN, 0.1, 0, Stop::BadQuality),
    (f64::INFINITY, 0.1, 0, Stop::BadQuality),
    (0.0, 0.1, BAD, Stop::BadQuality),
    (0.0, 0.1, DATA_GAP, Stop::SampleTime),
    (0.0, 0.0, 0, Stop::SampleTime),
    (0.0, -0.1, 0, Stop::SampleTime),
    (0.0, 0.6, 0, Stop::SampleTime),
    (0.0, f64::NAN, 0, Stop::SampleTime),
    (0.0, 0.1, NOT_AUTO, Stop::NotAuto),
    (0.0, 0.1, AT_LOW, Stop::OpLimit),
    (0.0, 0.1, AT_HIGH, Stop::OpLimit),
    (50.1, 0.1, 0, Stop::PvBounds),
    (-50.1, 0.1, 0, Stop::PvBounds),
    (f64::NAN, 0.0, NOT_AUTO | AT_LOW, Stop::BadQuality),
    (50.1, 0.1, NOT_AUTO | AT_HIGH, Stop::NotAuto),
];

#[test]
fn every_fault_in_every_mode() {
    let usual = tuner(USUAL);
    let mut whole = State::default();
    drive(&usual, &mut whole, |_| false);
    for (mode, before) in modes() {
        for (pv, h, flags, mut reason) in FAULTS {
            let at = format!("{mode}: PV {pv}, h {h}, flags {flags}");
            let mut state = before;
            let op = usual.update(&mut state, pv, h, flags);
            if before.phase.is_running() {
                if mode == "first push" && pv == -50.1 {
                    reason = Stop::WrongSign;
                }
                assert_eq!((state.phase, state.stop), (Phase::Aborted, reason), "{at}");
                assert_eq!((op, state.found), (50.0, before.found), "{at}");
            } else {
                assert_eq!(state, before, "{at}");
                assert_eq!(op, before.output, "{at}");
            }
            let ended = state;
            assert_eq!(usual.update(&mut state, 3.0, 0.1, 0), op, "{at}: goes on");
            assert_eq!(state, ended, "{at}: goes on");
            drive(&usual, &mut state, |_| false);
            assert_eq!(state, whole, "{at}: does not recover");
        }
    }
}

#[test]
fn a_start_in_every_mode() {
    let usual = tuner(USUAL);
    for (mode, before) in modes() {
        for (op, stop) in
            [(50.0, Stop::None), (5.9, Stop::OpLimit), (94.1, Stop::OpLimit), (f64::NAN, Stop::BadQuality)]
        {
            let mut state = before;
            usual.start(&mut state, op);
            let phase = if stop == Stop::None { Phase::Waiting } else { Phase::Aborted };
            let held = if op.is_nan() { before.output } else { op };
            assert_eq!((state.phase, state.stop), (phase, stop), "{mode}, OP {op}");
            assert_eq!((state.output, state.found), (held, None), "{mode}, OP {op}");
        }
    }
}

#[test]
fn settings_out_of_bounds_are_named() {
    let cases: [(AutoTunerSettings<f64>, &str); 12] = [
        (AutoTunerSettings { amplitude: 0.0, ..USUAL }, "amplitude"),
        (AutoTunerSettings { amplitude: f64::NAN, ..USUAL }, "amplitude"),
        (AutoTunerSettings { relay_hysteresis: Some(-0.1), ..USUAL }, "relay_hysteresis"),
        (AutoTunerSettings { d: -0.1, ..USUAL }, "d"),
        (AutoTunerSettings { d: 8.0, ..USUAL }, "d"),
        (AutoTunerSettings { wait: 0.0, ..USUAL }, "wait"),
        (AutoTunerSettings { longest: 4.0, ..USUAL }, "longest"),
        (AutoTunerSettings { max_h: f64::INFINITY, ..USUAL }, "max_h"),
        (AutoTunerSettings { pv: (1.0, 1.0), ..USUAL }, "pv_low"),
        (AutoTunerSettings { pv: (0.0, f64::INFINITY), ..USUAL }, "pv_high"),
        (AutoTunerSettings { op: (100.0, 0.0), ..USUAL }, "op_low"),
        (AutoTunerSettings { op: (0.0, f64::NAN), ..USUAL }, "op_high"),
    ];
    for (settings, name) in cases {
        assert_eq!(AutoTuner::new(settings).unwrap_err().name, name);
    }
}

/// Runs to its end on three lags behind a gap of `d`, under `noise`.
fn experiment<R: Real>(
    settings: AutoTunerSettings<R>,
    process: &mut Lags<R>,
    d: f64,
    h: f64,
    noise: f64,
) -> AutoTunerState<R> {
    let tuner = AutoTuner::new(settings).unwrap();
    let (noise, mut drawn) = (Noise::new(R::of(noise)).unwrap(), NoiseState::seeded(7));
    let (gap, mut valve) = (Backlash::new(R::of(d)).unwrap(), BacklashState::at(R::of(50.0)));
    let mut state = AutoTunerState::default();
    tuner.start(&mut state, R::of(50.0));
    while state.phase.is_running() {
        let position = gap.update(&mut valve, state.output);
        let pv = noise.update(&mut drawn, process.update(position, R::of(h)));
        tuner.update(&mut state, pv, R::of(h), 0);
    }
    state
}

#[test]
fn single_precision_finds_the_same() {
    let wide = experiment(USUAL, &mut Lags::<f64>::new(1.0, 1.0), 0.0, 0.05, 0.0).found.unwrap();
    let settings = AutoTunerSettings::<f32> {
        amplitude: 6.0,
        relay_hysteresis: None,
        d: 0.0,
        wait: 4.0,
        longest: 200.0,
        max_h: 0.5,
        pv: (-50.0, 50.0),
        op: (0.0, 100.0),
    };
    let narrow = experiment(settings, &mut Lags::<f32>::new(1.0, 1.0), 0.0, 0.05, 0.0).found.unwrap();
    // Without noise, in which the relay may switch a sample apart, and another experiment begins there.
    let near = |a: f64, b: f32| (f64::from(b) / a - 1.0).abs() < 0.002;
    assert!(near(wide.ku, narrow.ku) && near(wide.tu, narrow.tu), "{wide:?} {narrow:?}");
    assert!(near(wide.kp.unwrap(), narrow.kp.unwrap()), "{wide:?} {narrow:?}");
}

/// Regression: not counted in, a gap of an eighth of the relay's swing takes Ku up by more than a seventh and hides Kp.
#[test]
fn a_known_gap_is_counted_in() {
    let find = |d: f64| {
        experiment(AutoTunerSettings { d, ..USUAL }, &mut Lags::<f64>::new(1.0, 1.0), 1.0, 0.04, 0.0).found.unwrap()
    };
    let (known, unknown) = (find(1.0), find(0.0));
    assert!((known.ku / 8.0 - 1.0).abs() < 0.04 && (known.kp.unwrap() - 1.0).abs() < 0.05, "{known:?}");
    assert!(unknown.ku > 1.14 * known.ku && unknown.kp.is_none(), "{unknown:?}");
}

#[test]
fn a_rule_refuses_what_it_cannot_know() {
    use glapp_core::tuning::{Kind, Table};
    let known = Found { ku: 4.0, tu: 6.0, kp: Some(1.0), kappa: Some(0.25) };
    assert_eq!(known.ziegler_nichols(Kind::Pi, Table::Textbook).unwrap().k, 1.6);
    assert_eq!(known.amigo(Kind::Pi).unwrap().k, 0.64);
    assert_eq!(Found { kappa: None, ..known }.amigo(Kind::Pi).unwrap_err().name, "kappa");
    assert_eq!(Found { kappa: Some(0.8), ..known }.point_placement().unwrap_err().name, "kappa");
    assert!(Found { kappa: None, ..known }.point_placement().is_ok());
}

fn pv() -> impl Strategy<Value = f64> {
    prop_oneof![20 => -40.0..40.0_f64, 1 => Just(f64::NAN), 1 => -100.0..100.0_f64]
}

proptest! {
    /// With any input and any flags: within the amplitude, within the limits, over in time, and no NaN.
    #[test]
    fn always_ends_and_never_leaves_its_bounds(
        amplitude in prop_oneof![-30.0..-0.1_f64, 0.1..30.0_f64],
        relay_hysteresis in prop::option::of(0.0..2.0_f64),
        start in 0.0..100.0_f64,
        samples in prop::collection::vec((pv(), 0.01..0.4_f64, prop_oneof![60 => Just(0_u16), 1 => 0_u16..32]), 1..600),
        alternating in any::<bool>(),
    ) {
        let tuner = tuner(AutoTunerSettings { amplitude, relay_hysteresis, wait: 1.0, longest: 40.0, ..USUAL });
        let mut state = State::default();
        tuner.start(&mut state, start);
        let mut t = 0.0;
        for (i, &(pv, h, flags)) in samples.iter().enumerate() {
            // Half of the time a signal that lets the relay swing.
            let pv = if alternating && !pv.is_nan() { pv.abs() * if i / 8 % 2 == 0 { 1.0 } else { -1.0 } } else { pv };
            let op = tuner.update(&mut state, pv, h, flags);
            t += h;
            prop_assert!((0.0..=100.0).contains(&op));
            prop_assert!((op - start).abs() <= amplitude.abs() * (1.0 + 1e-12) + 1e-13);
            prop_assert!(state.phase.is_running() || op == start);
            prop_assert!(!state.phase.is_running() || t <= 40.0 + 1e-9);
        }
        if let Some(Found { ku, tu, kp, kappa }) = state.found {
            prop_assert!(ku.is_finite() && ku * amplitude > 0.0 && tu > 0.0 && tu.is_finite());
            prop_assert!(kp.is_none_or(f64::is_finite) && kappa.is_none_or(f64::is_finite));
        }
    }

    /// PV turned round with the amplitude's sign: the same OP, and gains of the other sign. Powers of two as units of PV,
    /// OP and time: the same bits, but for a root.
    #[test]
    fn sign_symmetric_and_without_units(
        samples in prop::collection::vec((0.1..5.0_f64, 0.05..0.3_f64), 40..400),
        relay_hysteresis in prop::option::of(0.0..0.1_f64),
        d in 0.0..2.0_f64,
        (pv_unit, op_unit, time_unit) in (-8..8i32, -8..8i32, -8..8i32),
    ) {
        let (pv_unit, op_unit, time_unit) = (2f64.powi(pv_unit), 2f64.powi(op_unit), 2f64.powi(time_unit));
        let base = AutoTunerSettings { relay_hysteresis, d, wait: 1.0, longest: 300.0, ..USUAL };
        let turned = AutoTunerSettings { amplitude: -6.0, ..base };
        let scaled = AutoTunerSettings {
            amplitude: 6.0 * op_unit,
            relay_hysteresis: relay_hysteresis.map(|x| x * pv_unit),
            d: d * op_unit,
            wait: time_unit,
            longest: 300.0 * time_unit,
            max_h: 0.5 * time_unit,
            pv: (-50.0 * pv_unit, 50.0 * pv_unit),
            op: (0.0, 100.0 * op_unit),
        };
        let (one, two, three) = (tuner(base), tuner(turned), tuner(scaled));
        let (mut a, mut b, mut c) = (State::default(), State::default(), State::default());
        one.start(&mut a, 50.0);
        two.start(&mut b, 50.0);
        three.start(&mut c, 50.0 * op_unit);
        for (i, &(size, h)) in samples.iter().enumerate() {
            let pv = if i / 9 % 2 == 0 { size } else { -size };
            let op = one.update(&mut a, pv, h, 0);
            prop_assert_eq!(op, two.update(&mut b, -pv, h, 0));
            prop_assert_eq!(op, three.update(&mut c, pv * pv_unit, h * time_unit, 0) / op_unit);
        }
        prop_assert_eq!((a.phase, a.stop, a.cycles), (b.phase, b.stop, b.cycles));
        prop_assert_eq!((a.phase, a.stop, a.cycles), (c.phase, c.stop, c.cycles));
        prop_assert_eq!(a.found.map(|f| (f.ku, f.tu, f.kp, f.kappa)), b.found.map(|f| (-f.ku, f.tu, f.kp.map(|x| -x), f.kappa)));
        if let (Some(f), Some(g)) = (a.found, c.found) {
            prop_assert!((g.ku * pv_unit / op_unit / f.ku - 1.0).abs() < 1e-12 && (g.tu / time_unit / f.tu - 1.0).abs() < 1e-12);
        }
    }

    /// Three equal lags of any gain and speed, with noise up to a tenth of the cycle's amplitude.
    #[test]
    fn finds_the_truth_about_three_lags(
        gain in prop_oneof![-4.0..-0.3_f64, 0.3..4.0_f64],
        t in 0.2..20.0_f64,
        amplitude in 1.0..20.0_f64,
        noise in 0.0..0.1_f64,
    ) {
        let cycle = 4.0 / std::f64::consts::PI * (amplitude * 2.0 / 3.0) / (8.0 / gain.abs());
        let settings = AutoTunerSettings {
            amplitude: amplitude * gain.signum(), wait: 3.6 * t, longest: 220.0 * t, max_h: t, ..USUAL
        };
        let state = experiment(settings, &mut Lags::<f64>::new(gain, t), 0.0, 0.036 * t, noise * cycle);
        prop_assert_eq!((state.phase, state.stop, state.output), (Phase::Done, Stop::None, 50.0));
        let found = state.found.unwrap();
        let apart = |x: f64, truth: f64| (x / truth - 1.0).abs();
        prop_assert!(apart(found.ku, 8.0 / gain) < 0.12, "Ku {} for {}", found.ku, 8.0 / gain);
        prop_assert!(apart(found.tu, 3.6276 * t) < 0.04, "Tu {} for {}", found.tu, 3.6276 * t);
        prop_assert!(found.kp.is_some_and(|kp| apart(kp, gain) < 0.1), "Kp {:?} for {gain}", found.kp);
    }
}
