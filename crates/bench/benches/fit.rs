//! The fit without Python and without the bootstrap, on one core: `cargo bench -p glapp-bench --bench fit`.
#![allow(missing_docs)]

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use glapp_core::{Backlash, BacklashState, Pid, PidState, Saturation};
use glapp_fit::{FitProblem, Segment, Stretch, Verdict, fit};
use rayon::ThreadPoolBuilder;
use std::time::Duration;

/// Width of the gap, and time between two samples that are recorded [s].
const D: f64 = 0.05;
const H: f64 = 0.3;
/// Scans of the controller in one of them.
const SCANS: usize = 6;

/// PV and OP of P2 = 1/(s + 1)⁴ under PI, with a gap, a load that walks and noise: what the fit is made for but for the
/// order of the process.
fn recorded(samples: usize) -> (Vec<f64>, Vec<f64>) {
    let mut x = 1_u32;
    let mut uniform = || {
        x ^= x << 13;
        x ^= x >> 17;
        x ^= x << 5;
        f64::from(x) / f64::from(u32::MAX) * 2.0 - 1.0
    };
    let h = H / SCANS as f64;
    let pid = Pid::new(0.775, 2.05, 0.0, 0.0, Saturation::none()).unwrap();
    let gap = Backlash::new(D).unwrap();
    let (mut controller, mut valve) = (PidState::default(), BacklashState::default());
    let (mut lags, mut load) = ([0.0; 4], 0.0);
    let (mut pvs, mut ops) = (Vec::with_capacity(samples), Vec::with_capacity(samples));
    for k in 0..samples * SCANS {
        let pv = lags[3] + 0.005 * uniform();
        let op = pid.update(&mut controller, 1.0, pv, h);
        if k % SCANS == 0 {
            pvs.push(pv);
            ops.push(op);
        }
        // 0.006 per √s, uniform: variance 1/3 of the square of its amplitude.
        load += 0.006 * (3.0 * h).sqrt() * uniform();
        let mut input = gap.update(&mut valve, op) + load;
        for lag in &mut lags {
            *lag += h * (input - *lag);
            input = *lag;
        }
    }
    (pvs, ops)
}

fn whole(c: &mut Criterion) {
    let pool = ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let mut group = c.benchmark_group("fit");
    group.sample_size(10).warm_up_time(Duration::from_secs(1)).measurement_time(Duration::from_secs(20));
    for samples in [751, 30_000] {
        let (pv, op) = recorded(samples);
        let record = Segment {
            h: H,
            stretches: vec![Stretch { start: 0.0, sp: [].as_slice().into(), pv: pv.into(), op: op.into() }],
        };
        let problem = FitProblem { records: vec![record], sign: 1.0, bootstrap: 0 };
        let answer = pool.install(|| fit(&problem, &|_| ())).expect("a record of this length is fitted");
        assert_ne!(answer.whole.verdict, Verdict::Sound, "a fit that misses the gap is no measure");
        group.throughput(Throughput::Elements(samples as u64));
        group.bench_function(format!("{samples} samples"), |b| b.iter(|| pool.install(|| fit(&problem, &|_| ()))));
    }
    group.finish();
}

criterion_group!(benches, whole);
criterion_main!(benches);
