//! The detector as a module beside a controller that is not ours.

use super::backlash_detection::{BacklashDetection, BacklashDetectionSettings, BacklashDetectionState};
use crate::error::require;
use crate::modules::Forward;
use crate::status::{AT_HIGH, AT_LOW, BAD, NOT_AUTO, Status};
use crate::{CompensationSettings, ParameterError, Real, Saturation, Standing, Sum, Way};

/// The most scans that u_FF may be late.
pub const FOREIGN_SCANS: usize = 32;

/// Settings of a [`ForeignDetection`] (thesis 6.4, figure 6.3).
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct ForeignDetectionSettings<R> {
    /// Detection and compensation, as beside a controller of ours.
    pub detection: BacklashDetectionSettings<R>,
    /// Number of scans from the one that makes u_FF to the one whose OP holds it, 1 to [`FOREIGN_SCANS`].
    pub delay: u32,
    /// Allowed difference between the u_FF read back and the one handed over, 0 or greater [OP unit]; a tenth of the
    /// width that the source gives where not given.
    pub tolerance: Option<R>,
    /// The longest delay with which it may be enabled, as a share of Ti, 0 or greater; [`Way::longest_delay`] where not given. One
    /// scan always may.
    pub longest: Option<R>,
}

impl<R: Real> ForeignDetectionSettings<R> {
    /// Default settings: u_FF is a scan late; the read-back may be off by a tenth of the width; the longest delay is
    /// that of the way.
    pub fn new(detection: BacklashDetectionSettings<R>) -> Self {
        Self { detection, delay: 1, tolerance: None, longest: None }
    }
}

/// Values read from another maker's controller, all of the same time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Read<R> {
    /// Output of the controller, where it is read; without it nothing is compensated [OP unit].
    pub op: Option<Forward<R>>,
    /// [`NOT_AUTO`]: it is not in automatic; [`AT_LOW`], [`AT_HIGH`]: something in the loop is at a limit; [`BAD`]: what is read is
    /// not to be believed; 0 = all well.
    pub flags: Status,
    /// The value at its feed-forward, where that can be read back [OP unit].
    pub u_ff: Option<Forward<R>>,
}

/// Detection, estimation and compensation of backlash beside a controller that is not ours (thesis 6.4, figure 6.3): a
/// [`BacklashDetection`] without backward signals.
///
/// ```text
///           ┌────────────── SP, PV, mode and flags, OP, u_FF read back ──────────────┐
///           ↓                                                                        │
///   ForeignDetection ── u_FF ──→ communication, `delay` scans ──→ feed-forward of their controller ──→ valve
/// ```
///
/// u_FB = OP − u_FF in effect. That is the u_FF read back, or the one made `delay` scans ago.
///
/// | what happens | u_FF |
/// |---|---|
/// | any input is bad, no number or beyond 10³⁰ (`f32`: 10¹²) | ramp to 0 ([`Standing::BadQuality`]) |
/// | told, or seen at OP where its limits are known, that something is at a limit | ramp to 0 ([`Standing::AtLimit`]) |
/// | their controller is not in automatic | 0 at once ([`Standing::NotAuto`]) |
/// | at the start, after a gap in time, and when what is read back is good again: it is off by more than `tolerance` | goes on from what is read back, and ramps to 0 |
/// | in automatic, it is off so for more than `delay` scans | ramp to 0 ([`Standing::NotFollowed`]), until it is enabled anew |
/// | `delay`·h is more than `longest`·Ti, and more than a scan | ramp to 0 ([`Standing::TooLate`]) |
///
/// It learns as it is handed its inputs: the u_FF of a scan is made of the samples of that scan, and one scan is the least
/// that OP can be late.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ForeignDetection<R> {
    detection: BacklashDetection<R>,
    limits: Saturation<R>,
    delay: u16,
    tolerance: Option<R>,
    /// The longest delay \[s\].
    longest: R,
    max_h: R,
}

/// State of a [`ForeignDetection`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct ForeignDetectionState<R: Real> {
    /// The detection; `reset` of it forgets the detections.
    pub detection: BacklashDetectionState<R>,
    /// The last u_FF that were handed over.
    handed: [R; FOREIGN_SCANS],
    at: u8,
    /// The read-back value has been compared before.
    known: bool,
    /// Scans in a row in which it was off.
    off: u16,
}

impl<R: Real> ForeignDetection<R> {
    /// Checks the settings.
    pub fn new(settings: ForeignDetectionSettings<R>) -> Result<Self, ParameterError> {
        let ForeignDetectionSettings { detection, delay, tolerance, longest } = settings;
        let known = delay >= 1 && delay as usize <= FOREIGN_SCANS;
        require("delay", R::of(f64::from(delay)), known, "a whole number of scans from 1 to 32")?;
        let ti = detection.detector.ti;
        // Any value that their controller holds at the start is removed, with compensation or without.
        let none = CompensationSettings::new(Way::Inverse, detection.detector.k, ti, R::ZERO, R::ZERO);
        let compensation = detection.compensation.unwrap_or(none);
        let longest = longest.unwrap_or(R::of(compensation.way.longest_delay()));
        Ok(Self {
            limits: detection.detector.op_limits.map_or(Saturation::none(), |(low, high)| Saturation { low, high }),
            detection: BacklashDetection::new(BacklashDetectionSettings {
                compensation: Some(compensation),
                ..detection
            })?,
            delay: delay as u16,
            tolerance: tolerance
                .map(|given| require("tolerance", given, given >= R::ZERO, "0 or greater"))
                .transpose()?,
            longest: require("longest", longest, longest >= R::ZERO, "0 or greater")? * ti,
            max_h: detection.detector.max_h,
        })
    }

    /// The `BacklashDetection` inside, to read its variables.
    pub fn detection(&self) -> &BacklashDetection<R> {
        &self.detection
    }

    /// Takes setpoint, process value, the signals of their controller and the time since the last scan `h` \[s\]; gives
    /// u_FF.
    #[inline(always)]
    pub fn update(
        &self,
        state: &mut ForeignDetectionState<R>,
        sp: Forward<R>,
        pv: Forward<R>,
        read: &Read<R>,
        h: R,
    ) -> Forward<R> {
        let lost = |x: &Option<Forward<R>>| x.is_some_and(|x| !(x.is_good() && x.value.is_measurable()));
        let mut flags = read.flags & (AT_LOW | AT_HIGH | NOT_AUTO | BAD);
        if lost(&read.op) || lost(&read.u_ff) {
            flags |= BAD;
        }
        // One that is lost is no number, which keeps it enabled.
        let op = read.op.map(|op| op.value);
        if let Some(op) = op.filter(|op| op.is_number()) {
            flags |= self.limits.reached(op);
        }
        let back = read.u_ff.filter(|_| !lost(&read.u_ff)).map(|u_ff| u_ff.value);
        let hindered = self.hindered(state, back, flags, h);
        let asked = state.handed[self.ago(state)];
        self.detection.forward(&mut state.detection, sp, pv, h);
        state.detection.u_ff = back.unwrap_or(asked);
        self.detection.learn(&mut state.detection, flags, op, hindered);
        self.hand_over(state)
    }

    /// A scan in which nothing is read, as [`BacklashDetection::pause`]; gives u_FF.
    pub fn pause(&self, state: &mut ForeignDetectionState<R>, flags: Status, h: R) -> Forward<R> {
        (state.known, state.off) = (false, 0);
        self.detection.pause(&mut state.detection, flags, h);
        self.hand_over(state)
    }

    /// The u_FF for this scan, kept for the comparison with the one read back.
    #[inline(always)]
    fn hand_over(&self, state: &mut ForeignDetectionState<R>) -> Forward<R> {
        let u_ff = state.detection.compensation.u_ff.value();
        state.handed[usize::from(state.at) % FOREIGN_SCANS] = u_ff;
        state.at = ((usize::from(state.at) + 1) % FOREIGN_SCANS) as u8;
        Forward::new(u_ff, 0)
    }

    /// Index of the u_FF that was made `delay` scans ago.
    #[inline(always)]
    fn ago(&self, state: &ForeignDetectionState<R>) -> usize {
        (usize::from(state.at) + FOREIGN_SCANS - usize::from(self.delay)) % FOREIGN_SCANS
    }

    /// Compares the value read back with the one handed over.
    #[inline(always)]
    fn hindered(&self, state: &mut ForeignDetectionState<R>, back: Option<R>, flags: Status, h: R) -> Option<Standing> {
        // After a gap in time, or a value that was lost, nobody knows what was written meanwhile.
        state.known &= h <= self.max_h;
        let Some(back) = back else {
            (state.known, state.off) = (false, 0);
            return self.late(h);
        };
        let tolerance = self.tolerance.unwrap_or_else(|| self.detection.width(&state.detection) / R::of(10.0));
        let off = (back - state.handed[self.ago(state)]).magnitude() > tolerance;
        if off && !state.known {
            state.detection.compensation.begin_at(back);
            (state.handed, state.off) = ([back; FOREIGN_SCANS], 0);
        } else {
            state.off = if off && flags & (NOT_AUTO | BAD) == 0 { state.off.saturating_add(1) } else { 0 };
        }
        state.known = true;
        if state.off > self.delay { Some(Standing::NotFollowed) } else { self.late(h) }
    }

    /// The obstacle where u_FF arrives too late for scans of `h`.
    #[inline(always)]
    fn late(&self, h: R) -> Option<Standing> {
        let late = self.delay > 1 && h * R::of(f64::from(self.delay)) > self.longest;
        late.then_some(Standing::TooLate)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{DetectorSettings, Source};
    use proptest::prelude::*;
    use std::vec;
    use std::vec::Vec;

    const H: f64 = 0.25;

    fn settings() -> ForeignDetectionSettings<f64> {
        let detector = DetectorSettings { op_limits: Some((0.0, 100.0)), ..DetectorSettings::new(0.5, 2.0, 0.0, H) };
        let compensation =
            CompensationSettings { band: 0.2, ..CompensationSettings::new(Way::Inverse, 0.5, 2.0, 1.4, 1.0) };
        let detection = BacklashDetectionSettings { detector, compensation: Some(compensation) };
        ForeignDetectionSettings { delay: 2, longest: Some(1.0), ..ForeignDetectionSettings::new(detection) }
    }

    /// Model of another maker's controller: OP swings, and holds the u_FF handed over `delay` scans ago.
    struct Theirs {
        block: ForeignDetection<f64>,
        state: ForeignDetectionState<f64>,
        handed: Vec<f64>,
        scan: usize,
    }

    impl Theirs {
        fn new(settings: ForeignDetectionSettings<f64>) -> Self {
            let block = ForeignDetection::new(settings).unwrap();
            Self { block, state: ForeignDetectionState::default(), handed: vec![0.0; 2], scan: 0 }
        }

        /// A scan in which `lose` may spoil the signals.
        fn scan(&mut self, lose: impl Fn(&mut Read<f64>)) -> f64 {
            let swing = (self.scan % 40) as f64 * 0.1;
            let held = self.handed[self.handed.len() - 2];
            let op = 50.0 + if swing < 2.0 { swing } else { 4.0 - swing } + held;
            let mut read = Read { op: Some(op.into()), flags: 0, u_ff: Some(held.into()) };
            lose(&mut read);
            let pv = if swing < 2.0 { 49.0 } else { 51.0 };
            let u_ff = self.block.update(&mut self.state, 50.0.into(), pv.into(), &read, H).value;
            self.handed.push(u_ff);
            self.scan += 1;
            u_ff
        }

        fn standing(&self) -> Standing {
            self.state.detection.compensation.standing
        }

        /// A compensation in force, at δ/2.
        fn active() -> Self {
            let mut theirs = Self::new(settings());
            theirs.state.detection.compensate = true;
            assert!((0..80).any(|_| theirs.scan(|_| ()) > 0.59));
            assert_eq!(theirs.standing(), Standing::Active);
            theirs
        }
    }

    #[test]
    fn settings_out_of_bounds_are_named() {
        type Change = fn(&mut ForeignDetectionSettings<f64>);
        let cases: [(&str, Change); 6] = [
            ("delay", |s| s.delay = 0),
            ("delay", |s| s.delay = 33),
            ("tolerance", |s| s.tolerance = Some(-0.1)),
            ("longest", |s| s.longest = Some(-0.1)),
            ("longest", |s| s.longest = Some(f64::NAN)),
            ("tf", |s| s.detection.detector.tf = -1.0),
        ];
        for (name, change) in cases {
            let mut changed = settings();
            change(&mut changed);
            assert_eq!(ForeignDetection::new(changed).unwrap_err().name, name);
        }
    }

    #[test]
    fn every_loss_takes_it_back_to_zero_by_a_ramp() {
        type Lose = fn(&mut Read<f64>);
        let losses: [(Standing, Lose); 7] = [
            (Standing::BadQuality, |read| read.flags = BAD),
            (Standing::BadQuality, |read| read.op = Some(f64::NAN.into())),
            (Standing::BadQuality, |read| read.op = Some(Forward::new(50.0, BAD))),
            (Standing::BadQuality, |read| read.u_ff = Some(f64::NAN.into())),
            (Standing::AtLimit, |read| read.flags = AT_HIGH),
            (Standing::AtLimit, |read| read.op = Some(100.0.into())),
            (Standing::NotEnabled, |read| read.op = None),
        ];
        for (standing, lose) in losses {
            let mut theirs = Theirs::active();
            let shown: Vec<f64> = (0..8).map(|_| theirs.scan(lose)).collect();
            assert_eq!(theirs.standing(), standing);
            assert!(shown[0] > 0.5 && shown[3] > 0.2 && shown[7].abs() < 1e-12, "{standing:?}: {shown:?}");
        }
    }

    #[test]
    fn manual_takes_it_away_at_once() {
        let mut theirs = Theirs::active();
        assert_eq!(theirs.scan(|read| read.flags = NOT_AUTO), 0.0);
        assert_eq!(theirs.standing(), Standing::NotAuto);
        // The value read back still is the one handed over before.
        assert_eq!(theirs.scan(|read| read.flags = NOT_AUTO), 0.0);
        theirs.scan(|_| ());
        assert_eq!(theirs.standing(), Standing::Waiting);
    }

    #[test]
    fn it_begins_at_what_is_read_back() {
        for compensation in [settings().detection.compensation, None] {
            let mut theirs = Theirs::new(ForeignDetectionSettings {
                detection: BacklashDetectionSettings { compensation, ..settings().detection },
                ..settings()
            });
            theirs.handed = vec![-0.8; 2];
            let shown: Vec<f64> = (0..8).map(|_| theirs.scan(|_| ())).collect();
            assert!(shown[0] < -0.65 && shown[3] < -0.2 && shown[7].abs() < 1e-12, "{shown:?}");
            assert_eq!(theirs.standing(), Standing::NotEnabled);
        }
    }

    #[test]
    fn what_is_not_followed_is_taken_away_until_it_is_enabled_anew() {
        let mut theirs = Theirs::active();
        let other = |read: &mut Read<f64>| read.u_ff = Some(0.1.into());
        let shown: Vec<f64> = (0..12).map(|_| theirs.scan(other)).collect();
        assert!(shown[1] > 0.59, "for no longer than the delay");
        assert!(shown[3] > 0.3 && shown[11].abs() < 1e-12, "{shown:?}");
        assert_eq!(theirs.standing(), Standing::NotFollowed);
        (0..50).for_each(|_| _ = theirs.scan(|_| ()));
        assert_eq!(theirs.standing(), Standing::NotFollowed);
        theirs.state.detection.compensate = false;
        theirs.scan(|_| ());
        theirs.state.detection.compensate = true;
        (0..50).for_each(|_| _ = theirs.scan(|_| ()));
        assert_eq!(theirs.standing(), Standing::Active);
    }

    #[test]
    fn a_scan_in_which_nothing_is_read_is_a_loss_and_a_gap_afterwards() {
        let mut theirs = Theirs::active();
        let shown: Vec<f64> = (0..8).map(|_| theirs.block.pause(&mut theirs.state, 0, H).value).collect();
        assert_eq!(theirs.standing(), Standing::BadQuality);
        assert!(shown[0] > 0.5 && shown[3] > 0.2 && shown[7].abs() < 1e-12, "{shown:?}");
        let handed = shown[6];
        theirs.handed.extend([handed, handed]);
        theirs.scan(|_| ());
        assert_eq!(theirs.standing(), Standing::Waiting, "nobody has to enable it anew");
        let last = theirs.state.detection.last.unwrap();
        assert!(last.half.flags & crate::status::DATA_GAP != 0 && last.mask & 1 != 0, "{last:?}");

        let mut theirs = Theirs::active();
        assert_eq!(theirs.block.pause(&mut theirs.state, NOT_AUTO, H).value, 0.0);
    }

    #[test]
    fn an_op_that_is_no_number_is_at_no_limit() {
        let mut theirs = Theirs::active();
        theirs.scan(|read| read.op = Some(f64::INFINITY.into()));
        assert_eq!(theirs.state.detection.last.unwrap().half.flags & (AT_LOW | AT_HIGH), 0);
    }

    #[test]
    fn limits_that_cross_are_named_as_the_detectors() {
        let mut crossed = settings();
        crossed.detection.detector.op_limits = Some((2.0, 1.0));
        assert_eq!(ForeignDetection::new(crossed).unwrap_err().name, "op_low");
    }

    #[test]
    fn too_late_is_told_by_the_time_that_has_passed() {
        let mut theirs = Theirs::new(ForeignDetectionSettings { longest: Some(0.25), ..settings() });
        theirs.state.detection.compensate = true;
        theirs.scan(|_| ());
        assert_eq!(theirs.standing(), Standing::Waiting, "two scans are 0.5 s, Ti is 2 s");
        let read = Read { op: Some(50.0.into()), ..Read::default() };
        theirs.block.update(&mut theirs.state, 50.0.into(), 50.0.into(), &read, 0.26);
        assert_eq!(theirs.standing(), Standing::TooLate);
        // A scan is what it takes everywhere.
        let mut soon = Theirs::new(ForeignDetectionSettings { longest: Some(0.0), delay: 1, ..settings() });
        soon.state.detection.compensate = true;
        soon.scan(|_| ());
        assert_eq!(soon.standing(), Standing::Waiting);
    }

    #[test]
    fn the_estimate_is_a_source_only_when_it_may_be() {
        let estimate = CompensationSettings::by_estimate(Way::Inverse, 0.5, 0.5, 1.0);
        for contradicted in [false, true] {
            let compensation = Some(CompensationSettings { contradicted, ..estimate });
            let detector =
                DetectorSettings { n: 3, op_limits: None, max_h: 1.0, ..DetectorSettings::new(0.5, 0.5, 0.0, H) };
            let mut theirs = Theirs::new(ForeignDetectionSettings {
                detection: BacklashDetectionSettings { detector, compensation },
                ..settings()
            });
            let may = |theirs: &Theirs| theirs.block.detection().may_compensate_by_estimate(&theirs.state.detection);
            let unfit = |theirs: &Theirs| may(theirs).unwrap_err();
            assert_eq!(theirs.block.detection().source(), Some(Source::Estimate));
            assert_eq!(unfit(&theirs), crate::modules::Unfit::NoDetection);
            assert!((0..200).any(|_| {
                theirs.scan(|_| ());
                theirs.state.detection.whole.is_some()
            }));
            let first =
                if contradicted { crate::modules::Unfit::Contradicted } else { crate::modules::Unfit::Provisional };
            assert_eq!(unfit(&theirs), first);
            theirs.state.detection.compensate = true;
            (0..100).for_each(|_| _ = theirs.scan(|_| ()));
            assert_eq!(theirs.standing(), Standing::NoEstimate);
            assert_eq!(may(&theirs).is_ok(), !contradicted);
            theirs.state.detection.compensate = false;
            theirs.scan(|_| ());
            theirs.state.detection.compensate = true;
            (0..60).for_each(|_| _ = theirs.scan(|_| ()));
            assert_eq!(theirs.standing(), if contradicted { Standing::NoEstimate } else { Standing::Active });
        }
    }

    #[test]
    fn single_precision_follows() {
        // Sizes that are exact in both: a reversal comes at the same sample. Two scans of delay are short against Ti.
        fn block<R: Real>() -> ForeignDetection<R> {
            let of = R::of;
            let detection = BacklashDetectionSettings {
                detector: DetectorSettings::new(of(0.5), of(4.0), R::ZERO, of(H)),
                compensation: Some(CompensationSettings {
                    band: of(0.1875),
                    ..CompensationSettings::new(Way::Inverse, of(0.5), of(4.0), of(1.4375), R::ONE)
                }),
            };
            let usual = ForeignDetectionSettings::new(detection);
            ForeignDetection::new(ForeignDetectionSettings { delay: 2, ..usual }).unwrap()
        }
        let (block, narrow) = (block::<f64>(), block::<f32>());
        let mut state = ForeignDetectionState::default();
        state.detection.compensate = true;
        let mut wide = ForeignDetectionState::default();
        wide.detection.compensate = true;
        let mut most = 0.0_f64;
        for i in 0..400_u16 {
            let lost = i % 97 == 0;
            let op = 50.0 + f32::from(i % 40).min(f32::from(40 - i % 40)) * 0.125; // exact in both
            let op = if lost { f32::NAN } else { op };
            let pv = if i % 40 < 20 { 49.0 } else { 51.0_f32 };
            let x = Read { op: Some(f64::from(op).into()), ..Read::default() };
            let y = Read { op: Some(op.into()), ..Read::default() };
            let a = block.update(&mut wide, 50.0.into(), f64::from(pv).into(), &x, 0.25).value;
            let b = narrow.update(&mut state, 50.0.into(), pv.into(), &y, 0.25).value;
            assert!((a - f64::from(b)).abs() < 1e-5, "{i}: {a} and {b}");
            most = most.max(a.abs());
            assert_eq!(wide.detection.compensation.standing, state.detection.compensation.standing, "{i}");
        }
        assert!(most > 0.5, "{most}");
    }

    fn any_read() -> impl Strategy<Value = (Read<f64>, f64)> {
        let number = || prop_oneof![12 => 40.0..60.0_f64, 1 => Just(f64::NAN)];
        let back = || prop_oneof![12 => -1.0..1.0_f64, 1 => Just(f64::NAN)];
        (prop::option::weighted(0.95, number()), 0..16_u16, prop::option::weighted(0.9, back()), 0.0..1.0_f64).prop_map(
            |(op, flags, u_ff, h)| {
                // Most scans are well.
                let flags = if h < 0.8 { 0 } else { flags };
                (Read { op: op.map(Into::into), flags, u_ff: u_ff.map(Into::into) }, h)
            },
        )
    }

    proptest! {
        #[test]
        fn u_ff_is_bounded_and_goes_back_to_zero(reads in prop::collection::vec(any_read(), 1..200), delay in 1..=32_u32) {
            let block = ForeignDetection::new(ForeignDetectionSettings { delay, ..settings() }).unwrap();
            let mut state = ForeignDetectionState::default();
            state.detection.compensate = true;
            for (i, (read, h)) in reads.iter().enumerate() {
                let e = if i / 7 % 2 == 0 { 1.0 } else { -1.0 };
                let u_ff = block.update(&mut state, 50.0.into(), (50.0 - e).into(), read, *h).value;
                // Every value read back here is within ± 1.
                prop_assert!(u_ff.abs() <= 1.0, "{u_ff}");
                if read.flags & NOT_AUTO != 0 && state.detection.compensation.standing != Standing::NotEnabled {
                    prop_assert_eq!(u_ff, 0.0);
                }
            }
            let lost = Read { op: Some(f64::NAN.into()), flags: 0, u_ff: None };
            for _ in 0..40 {
                block.update(&mut state, 50.0.into(), 50.0.into(), &lost, 0.1);
            }
            prop_assert!(state.detection.compensation.u_ff.abs() < 1e-9);
        }
    }
}
