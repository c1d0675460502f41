//! One scan of the controller with the detector inside: `cargo bench -p glapp-core --bench modules`.
#![allow(missing_docs)]

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use glapp_core::modules::{Mode, Pid, PidAdvanced, PidAdvancedSettings, PidAdvancedState, PidSettings, PidState};
use glapp_core::{Backward, CompensationSettings, Forward, Noise, NoiseState, Saturation, Way};
use std::hint::black_box;

const N: usize = 100_000;

/// A limit cycle of half-periods that are detected, in noise.
fn cycle() -> Vec<f64> {
    let noise = Noise::new(0.3).unwrap();
    let mut state = NoiseState::default();
    (0..N).map(|k| noise.update(&mut state, if (k / 300).is_multiple_of(2) { 49.0 } else { 51.0 })).collect()
}

fn scans(c: &mut Criterion) {
    let settings = PidSettings { tf: 3.0, low: 0.0, high: 100.0, ..PidSettings::ideal(0.5, 30.0, 0.0) };
    let pv = cycle();
    let (zero, sp) = (Forward::from(0.0), Forward::from(50.0));
    let mut group = c.benchmark_group("modules");
    group.throughput(Throughput::Elements(N as u64)).sample_size(20);
    let pid = Pid::new(settings).unwrap();
    group.bench_function("a scan of Pid", |b| {
        b.iter(|| {
            let mut state = PidState::at(50.0);
            state.mode = Mode::External;
            for &pv in &pv {
                black_box(pid.forward(&mut state, pv.into(), sp, zero, 1.0));
                black_box(pid.backward(&mut state, black_box(Backward::default())));
            }
            state
        });
    });
    let compensation = CompensationSettings {
        way: Way::Inverse,
        k: 0.5,
        size: 2.0,
        share: 1.0,
        limit: 2.0,
        band: 0.2,
        tf: 3.0,
        rate: 0.5,
        release: 30.0,
        watch: 1000.0,
        travel: 1e9,
        reversals: 1e9,
        withdraw: true,
        limits: Saturation::none(),
    };
    for (name, compensation) in [("detector", None), ("detector and compensation", Some(compensation))] {
        let advanced = PidAdvancedSettings { compensation, ..PidAdvancedSettings::new(settings) };
        let advanced = PidAdvanced::new(advanced).unwrap();
        group.bench_function(format!("a scan of PidAdvanced with {name}"), |b| {
            b.iter(|| {
                let mut state = PidAdvancedState::at(50.0);
                (state.pid.mode, state.detection.compensate) = (Mode::External, true);
                for &pv in &pv {
                    black_box(advanced.forward(&mut state, pv.into(), sp, zero, zero, 1.0));
                    black_box(advanced.backward(&mut state, black_box(Backward::default())));
                }
                assert!(state.detection.detector.accepted() > 100);
                assert_eq!(state.detection.compensation.u_ff != 0.0, compensation.is_some());
                state
            });
        });
    }
    group.finish();
}

criterion_group!(benches, scans);
criterion_main!(benches);
