//! The width with the bias of (2.4) taken out, on line.

use super::corrected::{Corrected, Doubt, Half, Pair, corrected, pairs};
use crate::{HalfPeriodResult, NoiseLevel, ParameterError, Real, Span, Swing, SwingParts, SwingState};

/// Number of the last pairs of half-periods that make the width on line.
pub const PAIRS: usize = 9;
/// Noise alone moves OP from end to end by so many times its deviation, and the valve follows.
pub const NOISE_SPAN: f64 = 6.0;

/// [`corrected`] on line: the width with the bias of (2.4) taken out, by the last [`PAIRS`] pairs of half-periods.
///
/// Beside a [`Detector`](crate::Detector), where OP is known. In every scan first [`conclude`](Self::conclude), then the detector;
/// where a half-period ended [`end`](Self::end), and then [`add`](Self::add), since the sample that ended it is the first of the
/// next. What is worked out from the pairs takes longer than a scan does otherwise: it is done in the scan after the one in which a pair
/// came, and in no other. O(1) per scan.
///
/// It has the bits of [`pairs`] and [`corrected`] over all half-periods, of which the last [`PAIRS`] pairs count.
///
/// It is refused for one more reason: a width below six times the deviation of OP's fast noise, by [`NoiseLevel`], is what noise moves the valve
/// by. A Kp that is a default counts as not known.
///
/// ```
/// use glapp_core::{Correction, CorrectionState, Doubt, HalfPeriod, HalfPeriodResult};
/// let correction = Correction::new(1.0, 10.0, 1.0, Some(2.0), false)?;
/// let mut state = CorrectionState::default();
/// for half in 0..12 {
///     let sign = if half % 2 == 0 { 1 } else { -1 };
///     for op in [-1.0, 1.0, 3.0] {
///         correction.conclude(&mut state);
///         correction.add(&mut state, 1.0, 0.0, -0.5 * f64::from(sign), f64::from(sign) * op);
///     }
///     let ended = HalfPeriod { sign, delta_t: 3.0, delta_y: 0.5, ..HalfPeriod::default() };
///     correction.end(&mut state, &HalfPeriodResult { half: ended, ..HalfPeriodResult::default() });
/// }
/// assert_eq!(correction.width(&state, true).unwrap().d, 5.5); // 6 from turn to turn, of which (0.5 + 0.5)/2 moves PV
/// assert_eq!(correction.width(&state, false), Err(Doubt::NoEstimate));
/// # Ok::<(), glapp_core::ParameterError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Correction<R> {
    swing: Swing<R>,
    kp: Option<R>,
    integrating: bool,
}

/// State of [`Correction`].
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct CorrectionState<R: Real> {
    swing: SwingState<R>,
    noise: NoiseLevel<R>,
    /// OP has been known.
    known: bool,
    /// The last two half-periods, the older first.
    before: [Past<R>; 2],
    pairs: [Pair<R>; PAIRS],
    next: u8,
    count: u8,
    /// A pair has come and is still to be worked off.
    due: bool,
    /// Kp of the width's calculation.
    kp: Option<R>,
    width: Result<Corrected<R>, Doubt>,
}

/// Facts kept of a half-period.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
struct Past<R> {
    sign: i8,
    mask: u16,
    delta_y: R,
    swing: SwingParts<R>,
}

impl<R: Real> Past<R> {
    /// The half-period in this place: one follows the other.
    fn half(self, place: u8) -> Half<R> {
        let Self { sign, mask, delta_y, swing } = self;
        let start = f64::from(place);
        Half { span: Span { start, end: start + 1.0 }, sign, mask, delta_y, swing }
    }
}

impl<R: Real> Default for CorrectionState<R> {
    fn default() -> Self {
        // No sign: no pair is made with it.
        let nothing = Past { sign: 0, mask: 0, delta_y: R::ZERO, swing: SwingParts::default() };
        Self {
            swing: SwingState::default(),
            noise: NoiseLevel::default(),
            known: false,
            before: [nothing; 2],
            pairs: [Pair::default(); PAIRS],
            next: 0,
            count: 0,
            due: false,
            kp: None,
            width: Err(Doubt::TooFew),
        }
    }
}

impl<R: Real> Correction<R> {
    /// The block for a controller: `k` [OP unit/PV unit] ≠ 0; `ti` \[s\] > 0; `b` setpoint weight, 0 to 1; `kp` process gain [PV unit/OP unit] where it is known, and
    /// no default; `integrating`: the process has no plateau, and no width is given.
    pub fn new(k: R, ti: R, b: R, kp: Option<R>, integrating: bool) -> Result<Self, ParameterError> {
        Ok(Self { swing: Swing::new(k, ti, None, b)?, kp, integrating })
    }

    /// Takes a sample of the half-period under way: the time `h` before it \[s\], setpoint, filtered PV, and OP.
    #[inline(always)]
    pub fn add(&self, s: &mut CorrectionState<R>, h: R, sp: R, yf: R, op: R) {
        s.known = true;
        self.swing.add(&mut s.swing, h, sp, yf, Some(op));
        s.noise.update(op);
    }

    /// Takes the half-period that has ended before the next sample.
    pub fn end(&self, s: &mut CorrectionState<R>, record: &HalfPeriodResult<R>) {
        let HalfPeriodResult { half, mask, .. } = *record;
        let swing = self.swing.end(&mut s.swing, half.sign, half.flags);
        let here = Past { sign: half.sign, mask, delta_y: half.delta_y, swing };
        let [first, second] = s.before;
        if let Some(pair) = pairs(&[first.half(0), second.half(1), here.half(2)]).next() {
            let place = if usize::from(s.next) < PAIRS { s.next } else { 0 };
            s.pairs[usize::from(place)] = pair;
            s.next = place + 1;
            s.count = s.count.saturating_add(1).min(PAIRS as u8);
            s.due = true;
        }
        s.before = [second, here];
    }

    /// Begins the noise of OP anew after samples that are missing or bad.
    #[inline(always)]
    pub fn interrupt(&self, s: &mut CorrectionState<R>) {
        s.noise.interrupt();
    }

    /// Works the last pair off, in the scan after the one in which it came.
    #[inline(always)]
    pub fn conclude(&self, s: &mut CorrectionState<R>) {
        if s.due || s.kp != self.kp {
            self.work_off(s);
        }
    }

    /// Computes the corrected width from the pairs that are kept.
    #[inline(never)]
    fn work_off(&self, s: &mut CorrectionState<R>) {
        let count = usize::from(s.count).min(PAIRS);
        let mut sorted = [Pair::default(); PAIRS];
        for (i, pair) in sorted[..count].iter_mut().enumerate() {
            *pair = s.pairs[(usize::from(s.next) + i) % count];
        }
        let found = corrected(&mut sorted[..count], self.kp);
        let noise = s.noise.sigma().map_or(R::ZERO, |sigma| R::of(NOISE_SPAN) * sigma);
        s.width = found.and_then(|found| if found.d < noise { Err(Doubt::Noise) } else { Ok(found) });
        (s.due, s.kp) = (false, self.kp);
    }

    /// The width, or the reason why there is none; `shown`: there is an estimate by the zero crossings that is no less
    /// than the noise limit.
    pub fn width(&self, s: &CorrectionState<R>, shown: bool) -> Result<Corrected<R>, Doubt> {
        if self.integrating {
            return Err(Doubt::Integrating);
        }
        if !s.known {
            return Err(Doubt::NoOp);
        }
        if !shown {
            return Err(Doubt::NoEstimate);
        }
        s.width
    }
}
