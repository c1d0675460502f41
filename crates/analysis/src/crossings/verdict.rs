//! Verdict of the zero crossings on a loop, and its reasons.

use super::Crossings;
use crate::median;
use crate::quality::{Fault, Finding, Severity};
use glapp_core::named;
use serde::{Deserialize, Serialize};

/// Accepted half-periods must have so many samples (their median). A recording at full rate and the same with every nth sample alone
/// agree within 5 % from 8 on.
pub(super) const SAMPLES: f64 = 10.0;

named! {
    /// Verdict of the zero crossings.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
    #[serde(rename_all = "snake_case")]
    pub enum Verdict {
        /// N detections or more stand behind a width.
        Estimate => "estimate",
        /// Fewer do.
        Provisional => "provisional",
        /// No width.
        #[default]
        NoEstimate => "no_estimate",
        /// Data or settings allow none.
        Refused => "refused",
    }
}

named! {
    /// Why the width of this OP is not that of one valve, so that no estimate can be right (thesis 8.3.2).
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
    #[serde(rename_all = "snake_case")]
    pub enum Exclusion {
        /// Primary loop of a cascade: its OP is a setpoint, not a valve signal.
        Primary => "primary",
        /// OP works on several valves.
        SplitRange => "split_range",
        /// Another loop moves the same valve.
        SharedValve => "shared_valve",
    }
}

/// Reason why the verdict says no more.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(tag = "code", content = "of", rename_all = "snake_case")]
pub enum Why {
    /// The detector's position in the plant rules out an estimate.
    #[serde(rename = "place")]
    Exclusion(Exclusion),
    /// SP is not recorded.
    NoSp,
    /// Index of the finding that is the reason.
    Finding(usize),
    /// K and Ti are not given, and OP is not recorded.
    NoLaw,
    /// K and Ti are not given, and OP does not tell them.
    NotIdentified,
    /// No half-period was accepted.
    NothingAccepted,
    /// The accepted half-periods have too few samples: what the error did between them is not known.
    Coarse {
        /// Median of the samples in them.
        samples: f64,
    },
    /// The detections do not agree: so many of the last lie within 20 % of their median.
    Disagree {
        /// Number of detections in it.
        kept: u8,
        /// The last ones.
        count: u8,
    },
    /// Δy/Kp is larger than OP's travel.
    GainTooLow,
    /// The detections are below the noise limit.
    Noise {
        /// Width by the detections [OP unit].
        d: f64,
        /// The noise limit [OP unit].
        floor: f64,
    },
    /// Fewer detections than the N of the settings.
    Few,
}

/// Facts on a loop that are known before its crossings are judged.
#[derive(Clone, Copy, Debug)]
pub struct Known<'a> {
    /// Why no estimate can be right, where that is known.
    pub exclusion: Option<Exclusion>,
    /// Whether SP is recorded.
    pub sp: bool,
    /// Whether OP is recorded.
    pub op: bool,
    /// Findings on the recording, gravest first.
    pub findings: &'a [Finding],
}

/// Verdict of `crossings` and its reasons; `crossings` is none where K and Ti are not known.
pub fn judge(known: &Known<'_>, crossings: Option<&Crossings>) -> (Verdict, Option<Why>) {
    use Verdict::{NoEstimate, Refused};
    let Known { exclusion, sp, op, findings } = *known;
    let find = |wanted: &dyn Fn(Fault, Severity) -> bool| {
        findings.iter().position(|found| wanted(found.fault, found.severity))
    };
    if let Some(exclusion) = exclusion {
        return (Refused, Some(Why::Exclusion(exclusion)));
    }
    if !sp {
        return (Refused, Some(Why::NoSp));
    }
    // The data is in order then; the loop just did not control.
    if let Some(i) = find(&|fault, severity| fault == Fault::NotAuto && severity == Severity::Refuse) {
        return (NoEstimate, Some(Why::Finding(i)));
    }
    if let Some(i) = find(&|_, severity| severity == Severity::Refuse) {
        return (Refused, Some(Why::Finding(i)));
    }
    if let Some(i) = find(&|fault, _| fault == Fault::Sinusoidal) {
        return (NoEstimate, Some(Why::Finding(i)));
    }
    let Some(crossings) = crossings else {
        return (Refused, Some(if op { Why::NotIdentified } else { Why::NoLaw }));
    };
    verdict_of(crossings, || {
        let accepted = crossings.rows().iter().filter(|row| row.record.mask == 0);
        median(&mut accepted.map(|row| f64::from(row.record.half.n)).collect::<Vec<_>>())
    })
}

/// Verdict of a detector's detections, where nothing else is wrong; `samples` is the median of those in its accepted
/// half-periods.
pub(super) fn verdict_of(crossings: &Crossings, samples: impl FnOnce() -> f64) -> (Verdict, Option<Why>) {
    use Verdict::{Estimate, NoEstimate, Provisional};
    let Some(estimate) = crossings.state().estimate() else {
        return (NoEstimate, Some(Why::NothingAccepted));
    };
    let samples = samples();
    if samples < SAMPLES {
        return (NoEstimate, Some(Why::Coarse { samples }));
    }
    let (d, kept, count) = (estimate.value, estimate.kept, estimate.count);
    if 3 * u32::from(kept) < count.into() {
        return (NoEstimate, Some(Why::Disagree { kept, count }));
    }
    if d <= 0.0 {
        return (NoEstimate, Some(Why::GainTooLow));
    }
    match crossings.state().noise_floor() {
        Some(floor) if d < floor => (NoEstimate, Some(Why::Noise { d, floor })),
        _ if crossings.accepted() < crossings.settings().n.into() => (Provisional, Some(Why::Few)),
        _ => (Estimate, None),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glapp_core::{Columns, DetectorSettings};

    /// A square wave of ±1 for so many half-periods of 100 s: each reads 0.5/10·100 − 1/Kp.
    fn crossings(halves: usize, kp: f64) -> Crossings {
        let settings = DetectorSettings { n: 3, tf: 0.001, kp: Some(kp), ..DetectorSettings::new(0.5, 10.0, 0.0, 1.0) };
        let mut crossings = Crossings::new(settings).unwrap();
        let t: Vec<f64> = (0..100 * (halves + 2)).map(|k| k as f64).collect();
        let pv: Vec<f64> = (0..t.len()).map(|k| if (k / 100).is_multiple_of(2) { -1.0 } else { 1.0 }).collect();
        crossings.take(Columns { t: &t, sp: &vec![0.0; t.len()], pv: &pv, op: None, flags: None });
        crossings
    }

    const HEALTHY: Known<'static> = Known { exclusion: None, sp: true, op: true, findings: &[] };

    #[test]
    fn what_is_wrong_with_the_loop_comes_before_what_its_crossings_say() {
        let good = crossings(6, 2.0);
        assert_eq!(judge(&HEALTHY, Some(&good)), (Verdict::Estimate, None));
        let wrong = [
            Finding::new(Fault::Sinusoidal, Severity::Warning),
            Finding::new(Fault::OpConstant, Severity::Refuse),
            Finding::new(Fault::NotAuto, Severity::Refuse),
        ];
        let known = |findings| Known { findings, ..HEALTHY };
        assert_eq!(judge(&known(&wrong[..1]), Some(&good)), (Verdict::NoEstimate, Some(Why::Finding(0))));
        assert_eq!(judge(&known(&wrong[..2]), Some(&good)), (Verdict::Refused, Some(Why::Finding(1))));
        assert_eq!(judge(&known(&wrong), Some(&good)), (Verdict::NoEstimate, Some(Why::Finding(2))));
        let blind = Known { sp: false, ..known(&wrong) };
        assert_eq!(judge(&blind, Some(&good)), (Verdict::Refused, Some(Why::NoSp)));
        let primary = Known { exclusion: Some(Exclusion::Primary), ..blind };
        assert_eq!(judge(&primary, Some(&good)), (Verdict::Refused, Some(Why::Exclusion(Exclusion::Primary))));
    }

    #[test]
    fn half_periods_of_few_samples_say_nothing() {
        let verdict_at = |every: usize| {
            let usual = DetectorSettings::new(0.5, 10.0, 0.0, every as f64);
            let settings = DetectorSettings { n: 3, tf: 0.001, kp: Some(2.0), ..usual };
            let mut crossings = Crossings::new(settings).unwrap();
            let rows: Vec<usize> = (0..800).step_by(every).collect();
            let t: Vec<f64> = rows.iter().map(|k| *k as f64).collect();
            let pv: Vec<f64> = rows.iter().map(|k| if (k / 100).is_multiple_of(2) { -1.0 } else { 1.0 }).collect();
            crossings.take(Columns { t: &t, sp: &vec![0.0; t.len()], pv: &pv, op: None, flags: None });
            judge(&HEALTHY, Some(&crossings))
        };
        assert_eq!(verdict_at(10), (Verdict::Estimate, None));
        assert_eq!(verdict_at(20), (Verdict::NoEstimate, Some(Why::Coarse { samples: 5.0 })));
    }

    #[test]
    fn what_the_crossings_say_is_weighed() {
        assert_eq!(judge(&HEALTHY, None), (Verdict::Refused, Some(Why::NotIdentified)));
        assert_eq!(judge(&Known { op: false, ..HEALTHY }, None), (Verdict::Refused, Some(Why::NoLaw)));
        assert_eq!(judge(&HEALTHY, Some(&crossings(0, 2.0))), (Verdict::NoEstimate, Some(Why::NothingAccepted)));
        assert_eq!(judge(&HEALTHY, Some(&crossings(2, 2.0))), (Verdict::Provisional, Some(Why::Few)));
        assert_eq!(judge(&HEALTHY, Some(&crossings(6, 0.1))), (Verdict::NoEstimate, Some(Why::GainTooLow)));
    }
}
