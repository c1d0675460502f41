//! The detector as a module beside a controller that is not ours.

use super::backlash_detection::{BacklashDetection, BacklashDetectionSettings, BacklashDetectionState};
use crate::error::require;
use crate::modules::Forward;
use crate::status::{AT_HIGH, AT_LOW, BAD, NOT_AUTO, Status};
use crate::{CompensationSettings, ParameterError, Real, Saturation, Standing, Sum, Way};

/// The most scans that u_FF may be late.
pub const FOREIGN_SCANS: usize = 32;

/// The longest delay of u_FF with which it may be enabled, as a share of Ti; one scan always may.
pub const LONGEST_DELAY: f64 = 0.2;

/// Settings of a [`ForeignDetection`] (thesis 6.4, figure 6.3).
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct ForeignDetectionSettings<R> {
    /// Detection and compensation, as beside a controller of ours.
    pub detection: BacklashDetectionSettings<R>,
    /// How many scans after the one in which u_FF is made OP holds it, 1 to [`FOREIGN_SCANS`].
    pub delay: u32,
    /// How far the u_FF that is read back may be from the one handed over, 0 or greater [OP unit]; a tenth of the width that the
    /// source gives where not given.
    pub tolerance: Option<R>,
    /// The longest delay with which it may be enabled, as a share of Ti, > 0.
    pub longest: R,
}

impl<R: Real> ForeignDetectionSettings<R> {
    /// u_FF is a scan late; what is read back may be off by a tenth of the width; [`LONGEST_DELAY`].
    pub fn new(detection: BacklashDetectionSettings<R>) -> Self {
        Self { detection, delay: 1, tolerance: None, longest: R::of(LONGEST_DELAY) }
    }
}

/// What is read of a controller that is not ours, all at the same time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Read<R> {
    /// Its output, where it is read; without it nothing is compensated [OP unit].
    pub op: Option<Forward<R>>,
    /// [`NOT_AUTO`]: it is not in automatic; [`AT_LOW`], [`AT_HIGH`]: something in the loop is at a limit; [`BAD`]: what is read is
    /// not to be believed; 0 = all well.
    pub flags: Status,
    /// The value at its feed-forward, where that can be read back [OP unit].
    pub u_ff: Option<Forward<R>>,
}

/// Detection, estimation and compensation of backlash beside a controller that is not ours (thesis 6.4, figure 6.3): a
/// [`BacklashDetection`] to which nothing is told backward.
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
/// | any input is bad, or no number | ramp to 0 ([`Standing::BadQuality`]) |
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
    /// What is read back has been compared before.
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
        // Whatever their controller holds at the start is taken away, compensation or not.
        let none = CompensationSettings::new(Way::Inverse, detection.detector.k, ti, R::ZERO, R::ZERO);
        let compensation = Some(detection.compensation.unwrap_or(none));
        Ok(Self {
            limits: detection.detector.op_limits.map_or(Saturation::none(), |(low, high)| Saturation { low, high }),
            detection: BacklashDetection::new(BacklashDetectionSettings { compensation, ..detection })?,
            delay: delay as u16,
            tolerance: tolerance
                .map(|given| require("tolerance", given, given >= R::ZERO, "0 or greater"))
                .transpose()?,
            longest: require("longest", longest, longest > R::ZERO, "greater than 0")? * ti,
            max_h: detection.detector.max_h,
        })
    }

    /// The detection inside.
    pub fn detection(&self) -> &BacklashDetection<R> {
        &self.detection
    }

    /// Takes setpoint, process value, what is read of their controller and the time since the last scan `h` \[s\]; gives u_FF.
    #[inline(always)]
    pub fn update(
        &self,
        state: &mut ForeignDetectionState<R>,
        sp: Forward<R>,
        pv: Forward<R>,
        read: &Read<R>,
        h: R,
    ) -> Forward<R> {
        let lost = |x: &Option<Forward<R>>| x.is_some_and(|x| !x.is_good());
        let mut flags = read.flags & (AT_LOW | AT_HIGH | NOT_AUTO | BAD);
        if lost(&read.op) || lost(&read.u_ff) {
            flags |= BAD;
        }
        // One that is lost is no number, which keeps it enabled.
        let op = read.op.map(|op| op.value);
        if let Some(op) = op {
            flags |= self.limits.reached(op);
        }
        let back = read.u_ff.filter(Forward::is_good).map(|u_ff| u_ff.value);
        let hindered = self.hindered(state, back, flags, h);
        let asked = state.handed[self.ago(state)];
        self.detection.forward(&mut state.detection, sp, pv, h);
        state.detection.u_ff = back.unwrap_or(asked);
        self.detection.learn(&mut state.detection, flags, op, hindered);
        let u_ff = state.detection.compensation.u_ff.value();
        state.handed[usize::from(state.at) % FOREIGN_SCANS] = u_ff;
        state.at = ((usize::from(state.at) + 1) % FOREIGN_SCANS) as u8;
        Forward::new(u_ff, 0)
    }

    /// Where the u_FF stands that was made `delay` scans ago.
    #[inline(always)]
    fn ago(&self, state: &ForeignDetectionState<R>) -> usize {
        (usize::from(state.at) + FOREIGN_SCANS - usize::from(self.delay)) % FOREIGN_SCANS
    }

    /// Compares what is read back with what was handed over.
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

    #[inline(always)]
    fn late(&self, h: R) -> Option<Standing> {
        let late = self.delay > 1 && h * R::of(f64::from(self.delay)) > self.longest;
        late.then_some(Standing::TooLate)
    }
}
