//! One sample at a time, as a controller or a plant connection would call it.
//!
//! `cargo run --example 02_stream`

use glapp_core::{Detector, DetectorState, MedianMean, SafetyNet, Sample, SecondOrderFilter, Width};
use glapp_sim::{Controller, Piece, Plant, Scenario};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let (k, ti, h) = (0.48, 0.3117, 0.05);
    let controller = Controller { k, ti, td: 0.0, b: 0.0, tf: ti / 10.0, limits: None };
    let signals = Scenario {
        d: 5.0,
        noise: vec![Piece::Uniform { amplitude: 0.1 }],
        setpoint: vec![Piece::Steps(vec![(0.0, 50.0)])],
        // The valve must travel for its gap to show.
        load: vec![Piece::Steps((0..20).map(|n| (150.0 * f64::from(n), 20.0 * f64::from(n % 2))).collect())],
        seed: 1,
        ..Scenario::new(Plant::named("P3")?, controller, h, 600.0)
    }
    .run()?;

    let detector = Detector::new(
        SecondOrderFilter::new(ti / 10.0)?,
        Width::new(k, ti, Some(0.0), 0.0, Some(1.0))?,
        SafetyNet::new(Some(100.0))?,
        MedianMean::new(9)?,
        3.0 * h,
        Some((0.0, 100.0)),
    )?;
    let mut state = DetectorState::default();
    for n in 0..signals.t.len() {
        let sample =
            Sample { h, sp: signals.sp[n], pv: signals.pv[n], op: Some(signals.op[n]), flags: signals.flags[n].into() };
        if let Some(half) = detector.update(&mut state, &sample)
            && half.mask == 0
            && let Some(estimate) = half.estimate
        {
            println!("{:6.1} s  detection {:.2} %  estimate {:.2} %", signals.t[n], half.parts.d, estimate.value);
        }
    }
    Ok(())
}
