//! Scans of the controller with detector and compensation, with the autotuner inside too, and of the autotuner alone, one call each, for `bench/scan.py` to
//! count their instructions.

use glapp_core::modules::{
    AutoTuner, AutoTunerState, Mode, PidAdvanced, PidAdvancedSettings, PidAdvancedState, PidSettings, ProcessSim,
    ProcessSimState,
};
use glapp_core::{Backlash, BacklashState, Backward, Forward, Noise, NoiseState};
use std::hint::black_box;

#[path = "../../../bench/settings.rs"]
mod settings;

/// A scan of the controller.
#[inline(never)]
fn pid_advanced(pid: &PidAdvanced<f64>, state: &mut PidAdvancedState<f64>, pv: f64) -> f64 {
    let zero = Forward::from(0.0);
    let u = pid.forward(state, pv.into(), 50.0.into(), zero, zero, 0.1);
    pid.backward(state, black_box(Backward::default()));
    u.value
}

/// A scan of the autotuner.
#[inline(never)]
fn auto_tuner(tuner: &AutoTuner<f64>, state: &mut AutoTunerState<f64>, pv: f64) -> f64 {
    let op = tuner.forward(state, 50.0.into(), pv.into(), 0.1);
    tuner.backward(state, black_box(Backward::default()));
    op.value
}

/// A scan of the controller with the autotuner inside; the same code twice would be one function.
#[inline(never)]
fn pid_tuner(pid: &PidAdvanced<f64>, state: &mut PidAdvancedState<f64>, pv: f64) -> f64 {
    let zero = Forward::from(0.0);
    let u = pid.forward(state, black_box(pv).into(), 50.0.into(), zero, zero, 0.1);
    pid.backward(state, black_box(Backward::default()));
    u.value
}

/// The loop in which the controller's own experiment runs, from before its beginning until long after its end.
fn experiment_inside(noise: &Noise<f64>) {
    let settings = settings::controller();
    let pid = PidSettings { rate: 1e9, ..settings.pid };
    let tuner = Some(settings::experiment());
    let pid = PidAdvanced::new(PidAdvancedSettings { pid, tuner, ..settings }).expect("settings within their bounds");
    let process = ProcessSim::<f64, 16>::new(1.0, 3.0, 1.0, 1.0, 0.1).expect("a process");
    let (mut lags, mut integer) = (ProcessSimState::at_rest(50.0), NoiseState::default());
    let mut state = pid.at_rest(Mode::External, 50.0, 50.0);
    for scan in 0..3000 {
        state.tuner.run |= scan == 100;
        let pv = noise.update(&mut integer, process.output(&lags).value);
        let op = pid_tuner(&pid, &mut state, pv);
        process.forward(&mut lags, op.into(), 0.0.into());
    }
    println!("{:?}", pid.offered(&state).expect("an experiment that is done"));
}

/// A loop with a gap under steps of its load, until there are many detections and a corrected width.
fn detections(noise: &Noise<f64>) {
    let pid = PidAdvanced::new(settings::controller()).expect("settings within their bounds");
    let mut state = PidAdvancedState::at(50.0);
    (state.pid.mode, state.detection.compensate) = (Mode::External, true);
    let gap = Backlash::new(2.0).expect("a width");
    let (mut position, mut integer, mut lags) = (BacklashState::default(), NoiseState::default(), [52.0, 52.0]);
    for scan in 0..12_000 {
        let u = pid_advanced(&pid, &mut state, noise.update(&mut integer, lags[1]));
        let x = gap.update(&mut position, u) + if scan / 2000 % 2 == 0 { 0.0 } else { 5.0 };
        lags[0] += (x - lags[0]) * 0.1 / 3.1;
        lags[1] += (lags[0] - lags[1]) * 0.1 / 1.1;
    }
    let shown = state.detection.whole.expect("detections");
    println!("a state in f32: {} bytes", size_of::<PidAdvancedState<f32>>());
    println!("{} detections, {:.2} %", state.detection.detector.accepted(), shown.value);
    println!("corrected: {:?}", pid.detection().corrected(&state.detection));
}

/// A relay experiment, from before its beginning to after its end.
fn experiment(noise: &Noise<f64>) {
    let tuner = AutoTuner::new(settings::experiment()).expect("settings within their bounds");
    let process = ProcessSim::<f64, 16>::new(1.0, 3.0, 1.0, 1.0, 0.1).expect("a process");
    let (mut lags, mut integer) = (ProcessSimState::at_rest(50.0), NoiseState::default());
    let mut state = AutoTunerState::default();
    let mut after = 0;
    for scan in 0.. {
        state.run |= scan == 10;
        let pv = noise.update(&mut integer, process.output(&lags).value);
        let op = auto_tuner(&tuner, &mut state, pv);
        process.forward(&mut lags, op.into(), 0.0.into());
        after += i32::from(state.experiment.found.is_some() && !state.run);
        if after == 10 || scan == 20_000 {
            break;
        }
    }
    println!("{:?}", state.experiment.found.expect("an experiment that is done"));
}

fn main() {
    let noise = Noise::new(0.1).expect("an amplitude");
    detections(&noise);
    experiment(&noise);
    experiment_inside(&noise);
}
