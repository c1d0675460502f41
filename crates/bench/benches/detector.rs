//! The blocks and the detector without Python: `cargo bench -p glapp-bench`.
#![allow(missing_docs)]

use criterion::{BatchSize, Criterion, Throughput, criterion_group, criterion_main};
use glapp_core::{
    Columns, Detector, DetectorState, MedianMean, MedianMeanState, Noise, NoiseState, SafetyNet, Sample,
    SecondOrderFilter, SecondOrderFilterState, Width,
};
use std::hint::black_box;

const N: usize = 1_000_000;

fn detector() -> Detector<f64> {
    Detector::new(
        SecondOrderFilter::new(3.0).unwrap(),
        Width::new(0.5, 30.0, Some(0.0), 1.0, Some(1.0)).unwrap(),
        SafetyNet::new(Some(100.0)).unwrap(),
        MedianMean::new(9).unwrap(),
        5.0,
        None,
    )
    .unwrap()
}

/// Uniform noise in −1..1.
fn noise() -> Vec<f64> {
    let (noise, mut state) = (Noise::new(1.0).unwrap(), NoiseState::default());
    (0..N).map(|_| noise.update(&mut state, 0.0)).collect()
}

fn whole(c: &mut Criterion) {
    println!("state of the detector: {} bytes", size_of::<DetectorState<f64>>());
    let t: Vec<f64> = (0..N).map(|k| k as f64).collect();
    let sp = vec![0.0; N];
    let noise = noise();
    let cycle: Vec<f64> =
        noise.iter().enumerate().map(|(k, x)| if k / 300 % 2 == 0 { 1.0 } else { -1.0 } + 0.3 * x).collect();
    let detector = detector();
    let mut group = c.benchmark_group("detector");
    group.throughput(Throughput::Elements(N as u64)).sample_size(20);
    for (name, pv) in [("limit cycle", &cycle), ("noise only", &noise)] {
        for (kind, op) in [("", None), (", with OP", Some(noise.as_slice()))] {
            group.bench_function(format!("run, {name}{kind}"), |b| {
                b.iter(|| {
                    let mut state = DetectorState::default();
                    let columns = Columns { t: &t, sp: &sp, pv, op, flags: None };
                    detector.run(&mut state, columns, |_, record| _ = black_box(record), |_, _| ());
                    state
                });
            });
        }
    }
    group.bench_function("update, limit cycle", |b| {
        b.iter(|| {
            let mut state = DetectorState::default();
            for &pv in &cycle {
                black_box(detector.update(&mut state, &Sample { h: 1.0, sp: 0.0, pv, op: None, flags: 0 }));
            }
            state
        });
    });
    group.finish();
}

fn blocks(c: &mut Criterion) {
    let noise = noise();
    let mut group = c.benchmark_group("blocks");
    group.throughput(Throughput::Elements(N as u64)).sample_size(20);
    let filter = SecondOrderFilter::new(3.0).unwrap();
    group.bench_function("filter", |b| {
        b.iter_batched_ref(
            SecondOrderFilterState::default,
            |state| noise.iter().map(|&x| filter.update(state, x, 1.0)).fold(0.0, f64::max),
            BatchSize::SmallInput,
        );
    });
    let median_mean = MedianMean::new(9).unwrap();
    group.bench_function("median/mean of 9", |b| {
        b.iter_batched_ref(
            MedianMeanState::default,
            |state| noise.iter().map(|&x| median_mean.update(state, x).value).fold(0.0, f64::max),
            BatchSize::SmallInput,
        );
    });
    group.finish();
}

criterion_group!(benches, whole, blocks);
criterion_main!(benches);
