//! Any samples with any settings: no panic, nothing but finite numbers out, every sample in one record, and the same bits
//! one sample a call, in one piece, and through a saved state.
//!
//! `RUSTC_BOOTSTRAP=1 cargo fuzz run detector -- -max_total_time=180`
#![no_main]

mod bytes;

use bytes::Bytes;
use glapp_core::{
    Columns, Detector, DetectorState, HalfPeriodResult, MedianMean, ParameterError, SafetyNet, Sample,
    SecondOrderFilter, Width,
};
use libfuzzer_sys::fuzz_target;

impl Bytes<'_> {
    /// Small steps mostly, and now and then all that a double can be.
    fn number(&mut self) -> Option<f64> {
        let kind = self.byte()?;
        Some(match kind {
            0..=199 => f64::from(i16::from(kind) - 100) / 16.0,
            200..=239 => f64::from(self.byte()?) * 2.0f64.powi(i32::from(kind) - 220),
            _ => self.double()?,
        })
    }

    fn maybe(&mut self) -> Option<Option<f64>> {
        Some(if self.byte()? & 1 == 0 { None } else { Some(self.number()?) })
    }
}

fn detector(bytes: &mut Bytes) -> Option<Result<Detector<f64>, ParameterError>> {
    let (k, ti, b, tf, max_h) = (bytes.number()?, bytes.number()?, bytes.number()?, bytes.number()?, bytes.number()?);
    let (td, kp, span, low) = (bytes.maybe()?, bytes.maybe()?, bytes.maybe()?, bytes.maybe()?);
    let n = u32::from(bytes.byte()? % 34);
    let make = || {
        Detector::new(
            SecondOrderFilter::new(tf)?,
            Width::new(k, ti, td, b, kp)?,
            SafetyNet::new(span)?,
            MedianMean::new(n)?,
            max_h,
            low.map(|low| (low, low + 1.0)),
        )
    };
    Some(make())
}

fn check(record: &HalfPeriodResult<f64>) {
    let (half, parts) = (&record.half, &record.parts);
    let shown = record.estimate.unwrap_or_default();
    let numbers = [
        half.delta_t,
        half.delta_y,
        half.e_max,
        half.delta_sp,
        half.sp_change,
        half.slope_change,
        half.op_change,
        parts.delta_u,
        parts.delta_u_d,
        parts.delta_u_sp,
        parts.op_travel,
        parts.free,
        parts.kp_part,
        parts.d,
        record.previous_delta_y.unwrap_or(0.0),
        record.d_hat_before.unwrap_or(0.0),
        shown.value,
        shown.low,
        shown.high,
    ];
    assert!(numbers.iter().all(|x| x.is_finite()), "{record:?}");
    assert!(half.delta_t >= 0.0 && half.delta_y >= 0.0 && half.n > 0);
}

fuzz_target!(|data: &[u8]| {
    let mut bytes = Bytes(data);
    let Some(Ok(detector)) = detector(&mut bytes) else { return };
    let op_known = bytes.byte().is_some_and(|byte| byte & 1 == 1);
    let (mut t, mut sp, mut pv, mut op, mut flags) = (vec![], vec![], vec![], vec![], vec![]);
    let mut clock = 0.0;
    while let (Some(step), Some(setpoint), Some(value), Some(output), Some(flag)) =
        (bytes.number(), bytes.number(), bytes.number(), bytes.number(), bytes.byte())
    {
        clock = if step.is_finite() && (clock + step).is_finite() { clock + step } else { step };
        t.push(clock);
        sp.push(setpoint);
        pv.push(value);
        op.push(output);
        flags.push(if flag < 240 { 0 } else { flag & 15 });
    }

    let mut state = DetectorState::default();
    let columns = Columns { t: &t, sp: &sp, pv: &pv, op: op_known.then_some(&op[..]), flags: Some(&flags) };
    let mut whole = Vec::new();
    detector.run(&mut state, columns, |_, record| whole.push(*record), |_, yf| assert!(yf.is_none_or(f64::is_finite)));
    whole.iter().for_each(check);

    let mut single_state = DetectorState::default();
    let mut singles = Vec::new();
    let (mut before, mut repeated) = (f64::NAN, 0);
    for i in 0..t.len() {
        if i % 16 == 15 {
            let saved = serde_json::to_string(&single_state).expect("a state is numbers");
            single_state = serde_json::from_str(&saved).expect("and comes back");
        }
        let sample =
            Sample { h: t[i] - before, sp: sp[i], pv: pv[i], op: op_known.then_some(op[i]), flags: flags[i].into() };
        repeated += usize::from(sample.h == 0.0);
        singles.extend(detector.update(&mut single_state, &sample));
        before = if t[i].is_finite() { t[i] } else { before };
    }
    assert_eq!(format!("{whole:?}"), format!("{singles:?}"));

    let end = Sample { h: -1.0, sp: 0.0, pv: 0.0, op: op_known.then_some(0.0), flags: 0 };
    whole.extend(detector.update(&mut state, &end));
    assert_eq!(whole.iter().map(|record| record.half.n as usize).sum::<usize>() + repeated, t.len());
});
