//! The autotuner inside `PidAdvanced`: the same experiment as beside a controller, its offer, and its take-over.

use glapp_core::auto_tuner::{Phase, Rule, Stop};
use glapp_core::modules::{
    AutoTuner, AutoTunerState, Gains, Mode, Pid, PidAdvanced, PidAdvancedSettings, PidAdvancedState, PidSettings,
    PidState, ProcessSim, ProcessSimState, SCHEDULE_ROWS,
};
use glapp_core::status::{AT_HIGH, BAD, NOT_AUTO, Status};
use glapp_core::{AutoTunerSettings, Backlash, BacklashState, Backward, Forward, Noise, NoiseState, Reason};

const H: f64 = 0.1;

fn controller() -> PidSettings<f64> {
    PidSettings { low: 0.0, high: 100.0, ..PidSettings::ideal(0.8, 6.0, 0.0) }
}

fn experiment() -> AutoTunerSettings<f64> {
    AutoTunerSettings {
        amplitude: 6.0,
        relay_hysteresis: None,
        d: 0.0,
        wait: 10.0,
        longest: 600.0,
        max_h: 3.0,
        pv: (0.0, 100.0),
        op: (0.0, 100.0),
    }
}

fn advanced() -> PidAdvancedSettings<f64> {
    PidAdvancedSettings { tuner: Some(experiment()), rule: Rule::AmigoPi, ..PidAdvancedSettings::new(controller()) }
}

/// A controller with a process of gain 0.8 behind it, at rest at PV = 40 under OP = 50, in a little noise.
struct Rig {
    pid: PidAdvanced<f64>,
    s: PidAdvancedState<f64>,
    process: ProcessSim<f64, 16>,
    lags: ProcessSimState<f64, 16>,
    noise: (Noise<f64>, NoiseState),
    gap: (Backlash<f64>, BacklashState<f64>),
    load: f64,
    back: Backward<f64>,
    /// Flags of PV.
    quality: Status,
}

impl Rig {
    fn new(settings: PidAdvancedSettings<f64>, d: f64) -> Self {
        let pid = PidAdvanced::new(settings).unwrap();
        let s = pid.at_rest(Mode::Auto, 40.0, 50.0);
        Self {
            pid,
            s,
            process: ProcessSim::new(0.8, 3.0, 1.0, 1.0, H).unwrap(),
            lags: ProcessSimState::at_rest(50.0),
            noise: (Noise::new(0.02).unwrap(), NoiseState::default()),
            gap: (Backlash::new(d).unwrap(), BacklashState::at(50.0)),
            load: 0.0,
            back: Backward::default(),
            quality: 0,
        }
    }

    /// PV of the coming scan.
    fn pv(&mut self) -> Forward<f64> {
        let pv = self.process.output(&self.lags).value;
        Forward::new(self.noise.0.update(&mut self.noise.1, pv), self.quality)
    }

    fn follow(&mut self, u: f64) {
        let x = self.gap.0.update(&mut self.gap.1, u);
        self.process.forward(&mut self.lags, x.into(), self.load.into());
    }

    fn scan(&mut self) -> f64 {
        let (pv, zero) = (self.pv(), Forward::from(0.0));
        let u = self.pid.forward(&mut self.s, pv, zero, zero, zero, H).value;
        self.pid.backward(&mut self.s, self.back);
        self.follow(u);
        u
    }

    /// Scans until the experiment is over; gives the greatest distance of the output from where it was.
    fn tune(&mut self) -> f64 {
        self.s.tuner.run = true;
        let mut most = 0.0_f64;
        for _ in 0..6000 {
            let u = self.scan();
            most = most.max((u - self.s.tuner.experiment.start).abs());
            if !self.s.tuner.run {
                break;
            }
        }
        most
    }
}

#[test]
fn the_experiment_inside_is_the_one_beside_a_controller() {
    let mut inside = Rig::new(advanced(), 0.0);
    let mut other = Rig::new(advanced(), 0.0);
    let (pid, tuner) = (Pid::new(controller()).unwrap(), AutoTuner::new(experiment()).unwrap());
    let (mut p, mut t): (PidState<f64>, _) = (pid.at_rest(Mode::Auto, 40.0, 50.0), AutoTunerState::default());
    for k in 0..4000 {
        inside.s.tuner.run |= k == 50;
        t.run |= k == 50;
        let u = inside.scan();
        let pv = other.pv();
        let wish = pid.forward(&mut p, pv, 0.0.into(), 0.0.into(), H);
        let v = tuner.forward(&mut t, wish, pv, H);
        let back = tuner.backward(&mut t, Backward::default());
        pid.backward(&mut p, back);
        other.follow(v.value);
        assert_eq!(u.to_bits(), v.value.to_bits(), "scan {k}");
    }
    assert_eq!(t.experiment, inside.s.tuner.experiment);
    assert_eq!(t.experiment.phase, Phase::Done);
}

#[test]
fn a_controller_is_offered_and_taken_over_without_a_bump() {
    let mut rig = Rig::new(advanced(), 1.5);
    for _ in 0..300 {
        rig.scan();
    }
    assert_eq!(rig.pid.offered(&rig.s).unwrap_err().name, "phase");
    assert!(rig.tune() <= 6.0);
    let found = rig.s.tuner.experiment.found.unwrap();
    let offered = rig.pid.offered(&rig.s).unwrap();
    assert_eq!(offered, found.by(Rule::AmigoPi).unwrap());
    // Taken over in the middle of a half-period: PV is off SP.
    rig.load = 3.0;
    for _ in 0..60 {
        rig.scan();
    }
    let (before, count) = (rig.s.pid.output, rig.s.detection.detector.accepted());
    let ended = rig.s.detection.last.map(|last| last.half);
    rig.pid = rig.pid.take_over(&mut rig.s).unwrap();
    assert_eq!(rig.pid.settings().pid, PidSettings { k: offered.k, ti: offered.ti, td: 0.0, ..controller() });
    let pv = rig.s.pid.yf;
    let u = rig.scan();
    let own = offered.k * H / offered.ti * (rig.s.pid.ysp - rig.s.pid.yf) + offered.k * (pv - rig.s.pid.yf);
    assert!((u - before - own).abs() < 1e-9, "{u} after {before}, of which its own {own}");
    // The half-period under way, and the one that begins, end as a gap; what comes then is judged.
    let last = rig.s.detection.last.unwrap();
    assert!(Some(last.half) != ended && last.reason() == Reason::Gap, "{:?}", last.reason());
    assert_eq!(rig.s.detection.detector.accepted(), count);
    let mut reasons = [0; 9];
    for k in 0..20_000 {
        rig.load = if k / 1500 % 2 == 0 { 3.0 } else { 0.0 };
        let before = rig.s.detection.last;
        rig.scan();
        if rig.s.detection.last != before {
            reasons[rig.s.detection.last.unwrap().reason() as usize] += 1;
        }
    }
    assert_eq!(reasons[Reason::Gap as usize], 1, "{reasons:?}");
    assert!(reasons.iter().sum::<i32>() > 100, "{reasons:?}");
    // Settings with the new K and Ti.
    let last = rig.s.detection.last.unwrap();
    let slope = last.parts.delta_u / (last.half.delta_y * last.half.delta_t);
    assert!((slope / (offered.k / offered.ti) - 1.0).abs() < 1e-12);
    // A second experiment offers nothing until it is done.
    rig.s.tuner.run = true;
    rig.scan();
    assert_eq!(rig.pid.offered(&rig.s).unwrap_err().name, "phase");
}

#[test]
fn the_kp_that_was_found_is_the_detectors_unless_one_is_given() {
    for given in [None, Some(0.5)] {
        let tuner = Some(AutoTunerSettings { d: 1.5, ..experiment() });
        let mut rig = Rig::new(PidAdvancedSettings { kp: given, tuner, ..advanced() }, 1.5);
        let part = |rig: &mut Rig| {
            for k in 0..3000 {
                rig.load = if k / 1000 % 2 == 0 { 3.0 } else { 0.0 };
                rig.scan();
            }
            let last = rig.s.detection.last.unwrap();
            last.half.delta_y / last.parts.kp_part
        };
        assert!(if let Some(kp) = given {
            (part(&mut rig) / kp - 1.0).abs() < 1e-12
        } else {
            part(&mut rig).is_infinite()
        });
        rig.load = 0.0;
        for _ in 0..1500 {
            rig.scan();
        }
        rig.tune();
        let found = rig.s.tuner.experiment.found.unwrap().kp.unwrap();
        assert!(rig.s.kp == Some(found) && (found - 0.8).abs() < 0.08, "{found}");
        assert!((part(&mut rig) / given.unwrap_or(found) - 1.0).abs() < 1e-12);
        // The setting outlives an experiment that is broken off, and detections that are forgotten.
        rig.s.tuner.run = true;
        rig.scan();
        rig.s.tuner.run = false;
        rig.scan();
        rig.s.detection.reset();
        assert_eq!((rig.s.tuner.experiment.stop, rig.s.kp), (Stop::NotAuto, Some(found)));
        assert!((part(&mut rig) / given.unwrap_or(found) - 1.0).abs() < 1e-12);
    }
}

#[test]
fn the_kp_that_was_found_takes_the_place_of_a_default() {
    let spans = PidAdvancedSettings { pv_span: Some(100.0), op_span: Some(100.0), ..advanced() };
    for (integrating, used) in [(false, Some(1.5)), (true, None)] {
        let mut rig = Rig::new(PidAdvancedSettings { integrating, ..spans }, 0.0);
        let kp = |rig: &Rig, name| rig.pid.detection().read(&rig.s.detection, name).unwrap();
        rig.scan();
        assert_eq!(kp(&rig, "kp_used").to_bits(), used.unwrap_or(f64::NAN).to_bits());
        assert_eq!(kp(&rig, "kp_defaulted"), f64::from(u8::from(!integrating)));
        rig.tune();
        rig.scan();
        let found = rig.s.kp.unwrap();
        assert!((found - 0.8).abs() < 0.05);
        // A process that is said to integrate has none, whatever was found.
        let expected = if integrating { f64::NAN } else { found };
        assert_eq!(kp(&rig, "kp_used").to_bits(), expected.to_bits());
        for k in 0..2000 {
            rig.load = if k / 500 % 2 == 0 { 3.0 } else { 0.0 };
            rig.scan();
        }
        assert_eq!(kp(&rig, "kp_defaulted"), 0.0);
        assert!(!rig.s.detection.last.unwrap().kp_defaulted);
    }
}

#[test]
fn under_a_schedule_nothing_is_taken_over() {
    let mut schedule = [Gains::default(); SCHEDULE_ROWS];
    schedule[0] = Gains { at: 0.0, k: 0.8, ti: 6.0, td: 0.0 };
    let mut rig = Rig::new(PidAdvancedSettings { schedule, rows: 1, ..advanced() }, 0.0);
    rig.tune();
    assert_eq!(rig.s.tuner.experiment.phase, Phase::Done);
    assert!(rig.s.kp.is_some());
    let before = rig.s;
    let error = rig.pid.take_over(&mut rig.s).unwrap_err();
    assert_eq!((error.name, error.value), ("rows", 1.0));
    assert_eq!(rig.s, before);
}

#[test]
fn a_rule_without_an_answer_says_so() {
    let mut rig = Rig::new(PidAdvancedSettings { rule: Rule::PointPlacement, ..advanced() }, 0.0);
    // Nearly all dead time.
    rig.process = ProcessSim::new(0.8, 0.1, 0.0, 1.4, H).unwrap();
    rig.tune();
    assert_eq!((rig.s.tuner.experiment.phase, rig.pid.offered(&rig.s).unwrap_err().name), (Phase::Done, "kappa"));
}

#[test]
fn whatever_ends_it_the_output_is_where_it_was_and_the_controller_goes_on_from_there() {
    type Change = fn(&mut Rig);
    let ends: [(Change, Stop); 5] = [
        (|rig| rig.s.tuner.run = false, Stop::NotAuto),
        (|rig| rig.s.pid.mode = Mode::Manual, Stop::NotAuto),
        (|rig| rig.quality = BAD, Stop::BadQuality),
        (|rig| rig.back.flags = AT_HIGH, Stop::OpLimit),
        (|rig| rig.back.flags = NOT_AUTO, Stop::NotAuto),
    ];
    for (change, stop) in ends {
        let mut rig = Rig::new(advanced(), 0.0);
        rig.scan();
        rig.s.tuner.run = true;
        for _ in 0..200 {
            rig.scan();
        }
        assert_eq!(rig.s.tuner.experiment.phase, Phase::Balanced);
        assert!((rig.s.tuner.experiment.output - 50.0).abs() > 3.0);
        change(&mut rig);
        rig.back.tracking = rig.s.tuner.experiment.start;
        // The backward signal is known in the scan after.
        if rig.back.flags != 0 {
            rig.scan();
        }
        let (back, start) = (rig.scan(), rig.s.tuner.experiment.start);
        assert_eq!((rig.s.tuner.experiment.phase, rig.s.tuner.experiment.stop), (Phase::Aborted, stop));
        assert_eq!(back, start);
        assert!((start - 50.0).abs() < 0.2);
        (rig.back, rig.quality) = (Backward::default(), 0);
        // The output tracks for a scan more, and goes on.
        for _ in 0..3 {
            let u = rig.scan();
            // PV is off SP by what the experiment left.
            assert!((u - start).abs() < 1.0, "{stop:?}: {u} after {start}");
        }
    }
}

#[test]
fn it_does_not_begin_in_manual_or_faster_than_the_rate() {
    let mut rig = Rig::new(advanced(), 0.0);
    rig.s.pid.mode = Mode::Manual;
    assert_eq!((rig.tune(), rig.s.tuner.experiment.stop), (0.0, Stop::NotAuto));

    // The relay swings by 8 in a scan of 0.1 s.
    for (rate, stop) in [(79.0, Stop::OpLimit), (81.0, Stop::None)] {
        let mut rig = Rig::new(PidAdvancedSettings { pid: PidSettings { rate, ..controller() }, ..advanced() }, 0.0);
        let most = rig.tune();
        assert_eq!(rig.s.tuner.experiment.stop, stop, "{rate}");
        assert_eq!(most > 0.1, stop == Stop::None, "{most}");
    }
}

#[test]
fn it_needs_limits() {
    for (low, high, name) in [(-f64::MAX, 100.0, "low"), (0.0, f64::MAX, "high")] {
        let pid = PidSettings { low, high, ..controller() };
        assert_eq!(PidAdvanced::new(PidAdvancedSettings { pid, ..advanced() }).unwrap_err().name, name);
    }
    let tuner = Some(AutoTunerSettings { wait: 0.0, ..experiment() });
    assert_eq!(PidAdvanced::new(PidAdvancedSettings { tuner, ..advanced() }).unwrap_err().name, "wait");
}
