//! Every pair of (mode change, fault), in a closed loop with a gap that is compensated, and with an experiment under way.

use glapp_core::auto_tuner::Stop;
use glapp_core::modules::{
    AutoTuner, AutoTunerState, BacklashDetection, BacklashDetectionSettings, BacklashDetectionState, Mode, Pid,
    PidAdvanced, PidAdvancedSettings, PidAdvancedState, PidSettings, PidState,
};
use glapp_core::status::{BAD, BAD_LIMITS, BAD_SP, DATA_GAP, NOT_AUTO, WRONG_SIGN};
use glapp_core::{Backlash, BacklashState, Backward, CompensationSettings, DetectorSettings, Forward, Standing, Way};
use std::vec::Vec;

#[path = "../../../../bench/settings.rs"]
mod settings;

const H: f64 = 0.1;
const MODES: [Mode; 3] = [Mode::Manual, Mode::Auto, Mode::External];

/// Fault, for how many scans, and the error that it must raise in automatic.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Fault {
    None,
    PvNoNumber,
    SpNoNumber,
    LimitsCross,
    TimeJumps,
    EstimateLost,
    DetectorReset,
    WrongSign,
}
use Fault::*;

const FAULTS: [Fault; 8] =
    [None, PvNoNumber, SpNoNumber, LimitsCross, TimeJumps, EstimateLost, DetectorReset, WrongSign];

impl Fault {
    fn scans(self) -> usize {
        if self == WrongSign { 1500 } else { 10 }
    }

    fn error(self, mode: Mode) -> u16 {
        match self {
            PvNoNumber => BAD,
            SpNoNumber if mode == Mode::External => BAD_SP,
            LimitsCross => BAD_LIMITS,
            TimeJumps => DATA_GAP,
            _ => 0,
        }
    }
}

/// The controller: with the detector inside, or beside it.
#[derive(Clone)]
#[allow(clippy::large_enum_variant)] // there is one of them
enum Controller {
    Inside(PidAdvanced<f64>, PidAdvancedState<f64>),
    Beside(Pid<f64>, PidState<f64>, BacklashDetection<f64>, BacklashDetectionState<f64>),
}
use Controller::*;

/// Two lags behind a gap of 2, under load steps; an autotuner between controller and valve.
#[derive(Clone)]
struct Loop {
    controller: Controller,
    tuner: AutoTuner<f64>,
    experiment: AutoTunerState<f64>,
    gap: BacklashState<f64>,
    lags: [f64; 2],
    gain: f64,
    scans: usize,
}

impl Loop {
    fn new(inside: bool, way: Way) -> Self {
        let usual = settings::controller();
        // Only the fault may take it away.
        let compensation = usual.compensation.map(|c| CompensationSettings { way, withdraw: false, ..c });
        let pid = PidSettings { tf: 0.2, ..usual.pid };
        let controller = if inside {
            let pid = PidAdvanced::new(PidAdvancedSettings { pid, compensation, ..usual }).unwrap();
            Inside(pid, PidAdvancedState::at(50.0))
        } else {
            let detector = DetectorSettings {
                kp: usual.kp,
                op_limits: Some((0.0, 100.0)),
                tf: 0.2,
                max_h: pid.max_h,
                ..DetectorSettings::new(pid.k, pid.ti, pid.td, H)
            };
            let detection = BacklashDetectionSettings { detector, compensation };
            let detection = BacklashDetection::new(detection).unwrap();
            Beside(Pid::new(pid).unwrap(), PidState::at(50.0), detection, BacklashDetectionState::default())
        };
        Self {
            controller,
            tuner: AutoTuner::new(settings::experiment()).unwrap(),
            experiment: AutoTunerState::default(),
            gap: BacklashState::at(50.0),
            lags: [50.0; 2],
            gain: 1.0,
            scans: 0,
        }
    }

    /// In automatic until there are detections and it compensates.
    fn compensating(inside: bool, way: Way) -> Self {
        let mut rig = Self::new(inside, way);
        rig.set(Mode::External);
        rig.detection().compensate = true;
        for _ in 0..10_000 {
            rig.scan(None);
        }
        for _ in 0..500 {
            if rig.detection().compensation.u_ff != 0.0 {
                break;
            }
            rig.scan(None);
        }
        let d = rig.detection();
        assert!(d.whole.is_some() && d.compensation.u_ff != 0.0, "it must compensate: {:?}", d.compensation.standing);
        rig
    }

    fn pid(&mut self) -> &mut PidState<f64> {
        match &mut self.controller {
            Inside(_, s) => &mut s.pid,
            Beside(_, s, ..) => s,
        }
    }

    fn detection(&mut self) -> &mut BacklashDetectionState<f64> {
        match &mut self.controller {
            Inside(_, s) => &mut s.detection,
            Beside(.., s) => s,
        }
    }

    fn error(&mut self) -> u16 {
        self.pid().error | self.detection().error()
    }

    fn set(&mut self, mode: Mode) {
        (self.pid().mode, self.pid().sp) = (mode, 50.0);
    }

    /// One scan; gives the controller's output and what the valve gets.
    fn scan(&mut self, fault: Fault) -> (f64, f64) {
        let pv = Forward::from(if fault == PvNoNumber { f64::NAN } else { self.lags[1] });
        let sp = Forward::from(if fault == SpNoNumber { f64::NAN } else { 50.0 });
        let h = if fault == TimeJumps { 60.0 } else { H };
        let back = match fault {
            LimitsCross => Backward { low: 90.0, high: 10.0, ..Backward::default() },
            _ => Backward::default(),
        };
        self.gain = if fault == WrongSign { -1.0 } else { 1.0 };
        let nothing = Forward::from(0.0);
        let u = match &mut self.controller {
            Inside(pid, s) => pid.forward(s, pv, sp, nothing, nothing, h),
            Beside(pid, s, watch, w) => {
                let u_ff = watch.forward(w, sp, pv, h);
                pid.forward(s, pv, sp, u_ff, h)
            }
        };
        let op = self.tuner.forward(&mut self.experiment, u, pv, h);
        let hears = self.tuner.backward(&mut self.experiment, back);
        match &mut self.controller {
            Inside(pid, s) => _ = pid.backward(s, hears),
            Beside(pid, s, watch, w) => {
                let (_, ff) = pid.backward(s, hears);
                watch.backward(w, Some(ff));
            }
        }
        let load = if (self.scans / 2000).is_multiple_of(2) { 5.0 } else { 0.0 };
        self.scans += 1;
        let x = Backlash::new(2.0).unwrap().update(&mut self.gap, op.value) + load - 50.0;
        self.lags[0] += (50.0 + self.gain * x - self.lags[0]) * H / 3.1;
        self.lags[1] += (self.lags[0] - self.lags[1]) * H / 1.1;
        (u.value, op.value)
    }
}

/// The changes of mode, and when they come: before the fault, with its beginning, within it, with its end, after it.
fn changes(fault: Fault) -> impl Iterator<Item = (Mode, Mode, usize)> {
    let last = 5 + fault.scans();
    let times = move || [3, 5, 10, last, last + 5].into_iter();
    MODES.into_iter().flat_map(move |from| MODES.into_iter().flat_map(move |to| times().map(move |at| (from, to, at))))
}

#[test]
fn every_mode_change_in_every_fault_while_compensating() {
    for (inside, way) in [true, false].into_iter().flat_map(|inside| Way::ALL.map(|way| (inside, way))) {
        let ready = Loop::compensating(inside, way);
        // K·|Δyf| of the P part, and u_FF's own rate.
        let most = |rig: &mut Loop, yf: f64| {
            let pid = rig.pid();
            2.0 * (pid.yf - yf).abs() + 2.0 * H / 2.0 * (pid.ysp - pid.yf).abs() + 5.0 * H + 1e-9
        };
        for fault in FAULTS {
            for (from, to, at) in changes(fault) {
                let place = format!("inside {inside}, {way:?}, {fault:?}, {from:?} to {to:?} at {at}");
                let mut rig = ready.clone();
                let window = 5..5 + fault.scans();
                let (mut last, mut found, mut lost, mut since) = (rig.pid().output, false, false, 0);
                for k in 0..window.end + 2500 {
                    let mode = if k < at { from } else { to };
                    if k == 0 || k == at {
                        rig.set(mode);
                    }
                    let now = if window.contains(&k) { fault } else { None };
                    if now == DetectorReset || now == EstimateLost && k == window.start {
                        rig.detection().reset();
                    }
                    let yf = rig.pid().yf;
                    let (u, _) = rig.scan(now);
                    let place = format!("{place}, scan {k}");
                    assert!((0.0..=100.0).contains(&u), "{place}: {u}");
                    assert!((u - last).abs() <= most(&mut rig, yf), "{place}: {last} to {u}");
                    let blind = now == PvNoNumber || now == TimeJumps;
                    assert!(!blind || u == last, "{place}: not held");
                    // The backward signal is known one scan later.
                    if k != window.start && k != window.end {
                        assert_eq!(rig.error() & !WRONG_SIGN, now.error(mode), "{place}");
                    }
                    let wrong = rig.detection().error() == WRONG_SIGN;
                    assert!(!wrong || fault == WrongSign, "{place}: no wrong sign");
                    found |= wrong;
                    since = if wrong { since + 1 } else { 0 };
                    let compensation = rig.detection().compensation;
                    assert!(since < 25 || compensation.u_ff == 0.0, "{place}: it goes on with the wrong sign");
                    lost |= compensation.standing == Standing::EstimateLost;
                    if mode == Mode::Manual {
                        assert_eq!((compensation.u_ff, compensation.standing), (0.0, Standing::NotAuto), "{place}");
                    }
                    last = u;
                }
                if fault == WrongSign && at <= 5 && (to == Mode::External || to == Mode::Auto && inside) {
                    assert!(found, "{place}: never noticed");
                }
                let watched = from == Mode::External || from == Mode::Auto && inside;
                if matches!(fault, EstimateLost | DetectorReset) && watched && at > 6 {
                    assert!(lost, "{place}: its loss was not noticed");
                }
                assert_eq!(rig.error(), 0, "{place}: it recovers");
                let standing = rig.detection().compensation.standing;
                // A detector beside a controller knows no setpoint but the one that is connected to both.
                if to == Mode::Manual || to == Mode::Auto && !inside {
                    assert_eq!(standing, Standing::NotAuto, "{place}");
                } else {
                    let back = matches!(standing, Standing::Active | Standing::Waiting);
                    assert!(back || lost && standing == Standing::EstimateLost, "{place}: {standing:?}");
                    assert!((rig.lags[1] - 50.0).abs() < 4.0, "{place}: {}", rig.lags[1]);
                }
            }
        }
    }
}

#[test]
fn every_mode_change_in_every_fault_with_an_experiment_under_way() {
    let ready = Loop::compensating(true, Way::Inverse);
    let stops = |fault| match fault {
        PvNoNumber => Stop::BadQuality,
        TimeJumps => Stop::SampleTime,
        _ => Stop::None,
    };
    // Faults in the waiting phase, and with the relay running.
    for (begun, fault) in [20, 300].into_iter().flat_map(|begun| FAULTS.map(|fault| (begun, fault))) {
        for (from, to, at) in changes(fault) {
            let place = format!("{fault:?} after {begun} scans, {from:?} to {to:?} at {at}");
            let mut rig = ready.clone();
            rig.set(from);
            rig.scan(None);
            rig.experiment.run = true;
            let start = rig.pid().output;
            for _ in 0..begun {
                rig.scan(None);
            }
            let window = 5..if fault == WrongSign { 9500 } else { 15 };
            let (mut ended, mut last) = (Vec::new(), start);
            for k in 0..window.end + 300 {
                if k == at {
                    rig.set(to);
                }
                let now = if window.contains(&k) { fault } else { None };
                if matches!(now, DetectorReset | EstimateLost) {
                    rig.detection().reset();
                }
                let (running, yf) = (rig.experiment.experiment.phase.is_running(), rig.pid().yf);
                let (_, op) = rig.scan(now);
                assert!((0.0..=100.0).contains(&op) && (op - start).abs() <= 6.0 || !running, "{place}, {k}: {op}");
                let runs = rig.experiment.experiment.phase.is_running();
                if running && runs {
                    assert_eq!(rig.pid().flags & NOT_AUTO, NOT_AUTO, "{place}, {k}: the controller tracks");
                    assert_eq!(rig.detection().compensation.u_ff, 0.0, "{place}, {k}: nothing is fed forward");
                }
                if running && !runs {
                    ended.push((k, rig.experiment.experiment.stop));
                    assert_eq!(op, rig.experiment.experiment.output, "{place}, {k}: back where it began");
                } else if !running && ended.last().is_some_and(|end| end.0 + 3 > k) {
                    let pid = rig.pid();
                    let most = 2.0 * H / 2.0 * (pid.ysp - pid.yf).abs() + 2.0 * (pid.yf - yf).abs() + 1e-9;
                    assert!((op - last).abs() <= most, "{place}, {k}: {last} to {op}");
                }
                last = op;
            }
            if stops(fault) == Stop::None && fault != WrongSign {
                assert_eq!(ended, [], "{place}: not the experiment's business");
            } else if fault != WrongSign {
                assert_eq!(ended, [(window.start, stops(fault))], "{place}");
            } else {
                // A relay that drives the wrong way: PV leaves its bounds, or nothing regular comes of it.
                assert!(ended.len() == 1 && ended[0].1 != Stop::None, "{place}: {ended:?}");
            }
        }
    }
}
