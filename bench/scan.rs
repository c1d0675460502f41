//! Scans of the controller with detector and compensation, one call each, for `bench/scan.py` to count their
//! instructions.

use glapp_core::modules::{Mode, PidAdvanced, PidAdvancedSettings, PidAdvancedState, PidSettings};
use glapp_core::{
    Backlash, BacklashState, Backward, CompensationSettings, Forward, Noise, NoiseState, Saturation, Way,
};
use std::hint::black_box;

/// The function that is counted.
#[inline(never)]
fn one_scan(pid: &PidAdvanced<f64>, state: &mut PidAdvancedState<f64>, pv: f64) -> f64 {
    let zero = Forward::from(0.0);
    let u = pid.forward(state, pv.into(), 50.0.into(), zero, zero, 0.1);
    pid.backward(state, black_box(Backward::default()));
    u.value
}

fn main() {
    let settings = PidSettings { tf: 0.2, low: 0.0, high: 100.0, ..PidSettings::ideal(2.0, 2.0, 0.0) };
    let compensation = CompensationSettings {
        way: Way::Inverse,
        k: 2.0,
        size: 1.0,
        share: 1.0,
        limit: 1.0,
        band: 0.1,
        tf: 0.2,
        rate: 5.0,
        release: 2.0,
        watch: 1000.0,
        travel: 1e9,
        reversals: 1e9,
        withdraw: true,
        limits: Saturation::none(),
    };
    let advanced =
        PidAdvancedSettings { kp: Some(1.0), compensation: Some(compensation), ..PidAdvancedSettings::new(settings) };
    let pid = PidAdvanced::new(advanced).expect("settings within their bounds");
    let mut state = PidAdvancedState::at(50.0);
    (state.pid.mode, state.detection.compensate) = (Mode::External, true);
    let (gap, noise) = (Backlash::new(2.0).expect("a width"), Noise::new(0.1).expect("an amplitude"));
    let (mut position, mut integer, mut lags) = (BacklashState::default(), NoiseState::default(), [52.0, 52.0]);
    for _ in 0..3000 {
        let u = one_scan(&pid, &mut state, noise.update(&mut integer, lags[1]));
        let x = gap.update(&mut position, u) + 5.0;
        lags[0] += (x - lags[0]) * 0.1 / 3.1;
        lags[1] += (lags[0] - lags[1]) * 0.1 / 1.1;
    }
    let shown = state.detection.whole.expect("detections");
    println!("a state in f32: {} bytes", size_of::<PidAdvancedState<f32>>());
    println!("{} detections, {:.2} %", state.detection.detector.accepted(), shown.value);
}
