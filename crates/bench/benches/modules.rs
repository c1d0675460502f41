//! One scan of the controller with the detector inside, and of the autotuner: `cargo bench -p glapp-bench --bench modules`.
#![allow(missing_docs)]

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use glapp_core::modules::{Mode, Pid, PidAdvanced, PidAdvancedSettings, PidAdvancedState, PidState};
use glapp_core::{AutoTuner, AutoTunerSettings, AutoTunerState, Backward, Forward, Noise, NoiseState};
use std::hint::black_box;

#[path = "../../../bench/settings.rs"]
mod settings;

const N: usize = 100_000;
const H: f64 = 0.1;

/// A limit cycle with half-periods of so many scans, in noise.
fn cycle(half: usize) -> Vec<f64> {
    let noise = Noise::new(0.3).unwrap();
    let mut state = NoiseState::default();
    (0..N).map(|k| noise.update(&mut state, if (k / half).is_multiple_of(2) { 49.0 } else { 51.0 })).collect()
}

fn scans(c: &mut Criterion) {
    let settings = settings::controller();
    let pv = cycle(300);
    let (zero, sp) = (Forward::from(0.0), Forward::from(50.0));
    let mut group = c.benchmark_group("modules");
    group.throughput(Throughput::Elements(N as u64)).sample_size(20);
    let pid = Pid::new(settings.pid).unwrap();
    group.bench_function("a scan of Pid", |b| {
        b.iter(|| {
            let mut state = PidState::at(50.0);
            state.mode = Mode::External;
            for &pv in &pv {
                black_box(pid.forward(&mut state, pv.into(), sp, zero, H));
                black_box(pid.backward(&mut state, black_box(Backward::default())));
            }
            state
        });
    });
    for (name, compensation) in [("detector", None), ("detector and compensation", settings.compensation)] {
        let advanced = PidAdvancedSettings { compensation, ..settings };
        let advanced = PidAdvanced::new(advanced).unwrap();
        group.bench_function(format!("a scan of PidAdvanced with {name}"), |b| {
            b.iter(|| {
                let mut state = PidAdvancedState::at(50.0);
                (state.pid.mode, state.detection.compensate) = (Mode::External, true);
                for &pv in &pv {
                    black_box(advanced.forward(&mut state, pv.into(), sp, zero, zero, H));
                    black_box(advanced.backward(&mut state, black_box(Backward::default())));
                }
                assert!(state.detection.detector.accepted() > 100);
                assert_eq!(state.detection.compensation.u_ff != 0.0, compensation.is_some());
                state
            });
        });
    }
    // A cycle so long that no experiment is over within a run.
    let swing = cycle(N / 2);
    let tuner = AutoTunerSettings { relay_hysteresis: Some(0.5), longest: 1e9, ..settings::experiment() };
    let tuner = AutoTuner::new(tuner).unwrap();
    group.bench_function("autotuner, relay running", |b| {
        b.iter(|| {
            let mut state = AutoTunerState::default();
            tuner.start(&mut state, 50.0);
            let last = swing.iter().map(|&x| tuner.update(&mut state, x, H, 0)).fold(0.0, f64::max);
            assert!(state.phase.is_running() && state.t > 0.9 * N as f64 * H);
            last
        });
    });
    group.finish();
}

criterion_group!(benches, scans);
criterion_main!(benches);
