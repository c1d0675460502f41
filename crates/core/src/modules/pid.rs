//! The controller as a module: modes, limits that move, bad values.

use crate::error::require;
use crate::modules::{Backward, Forward};
use crate::status::{AT_HIGH, AT_LOW, BAD, BAD_FF, BAD_LIMITS, BAD_SP, DATA_GAP, NOT_AUTO, Status};
use crate::{ParameterError, Real, Saturation, SecondOrderFilter, SecondOrderFilterState, Sum};

named! {
    /// Source of the output of a [`Pid`].
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
    #[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
    #[repr(u8)]
    pub enum Mode {
        /// A person.
        Manual = 0 => "manual",
        /// The controller, with its own setpoint.
        #[default]
        Auto = 1 => "auto",
        /// The controller, with the setpoint that is handed to it.
        External = 2 => "external",
    }
}

/// Settings of a [`Pid`], in ideal form.
///
/// ```
/// use glapp_core::modules::{Pid, PidSettings};
///
/// let settings = PidSettings { low: 0.0, high: 100.0, ..PidSettings::series(2.0, 8.0, 2.0)? };
/// assert_eq!((settings.k, settings.ti, settings.td), (2.5, 10.0, 1.6));
/// let pid = Pid::new(settings)?;
/// # Ok::<(), glapp_core::ParameterError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct PidSettings<R> {
    /// Gain K ≠ 0, negative for a direct-acting controller [output per process value].
    pub k: R,
    /// Integral time > 0 \[s\].
    pub ti: R,
    /// Derivative time ≥ 0 \[s\].
    pub td: R,
    /// Weight of the setpoint in the proportional part, 0 to 1.
    pub b: R,
    /// Weight of the setpoint in the derivative part, 0 to 1.
    pub c: R,
    /// Time constant of the measurement filter ≥ 0 \[s\].
    pub tf: R,
    /// Lower limit of the output.
    pub low: R,
    /// Upper limit of the output.
    pub high: R,
    /// The fastest that the output moves, up and down, > 0 [output per second].
    pub rate: R,
    /// A longer time between scans, > 0, is a gap \[s\].
    pub max_h: R,
}

impl<R: Real> PidSettings<R> {
    /// K·(1 + 1/(s·Ti) + s·Td); b = 1, c = 0, no filter, no limits, a gap above Ti/2.
    pub fn ideal(k: R, ti: R, td: R) -> Self {
        let (low, high, rate) = (-R::LARGEST, R::LARGEST, R::LARGEST);
        Self { k, ti, td, b: R::ONE, c: R::ZERO, tf: R::ZERO, low, high, rate, max_h: ti / R::of(2.0) }
    }

    /// K'·(1 + 1/(s·Ti'))·(1 + s·Td'): K = K'·(1 + Td'/Ti'), Ti = Ti' + Td', Td = Ti'·Td'/(Ti' + Td').
    pub fn series(k: R, ti: R, td: R) -> Result<Self, ParameterError> {
        let ti = require("ti", ti, ti > R::ZERO, "greater than 0 s")?;
        let td = require("td", td, td >= R::ZERO, "0 s or greater")?;
        Ok(Self::ideal(k * (R::ONE + td / ti), ti + td, ti * td / (ti + td)))
    }

    /// kp + ki/s + kd·s: K = kp, Ti = kp/ki, Td = kd/kp. All three have the same sign.
    pub fn parallel(kp: R, ki: R, kd: R) -> Result<Self, ParameterError> {
        let kp = require("kp", kp, kp != R::ZERO, "a number other than 0")?;
        let ti = kp / require("ki", ki, ki != R::ZERO, "other than 0, with the sign of kp")?;
        require("ki", ki, ti > R::ZERO, "other than 0, with the sign of kp")?;
        let td = kd / kp;
        require("kd", kd, td >= R::ZERO, "0, or of the sign of kp")?;
        Ok(Self::ideal(kp, ti, td))
    }
}

/// PI or PID controller with all that a loop asks of it (thesis (4.1), 6.1, 6.5, 7.1).
///
/// ```text
/// u = K·(b·ysp − yf + (1/Ti)·∫(ysp − yf) dt + Td·d(c·ysp − yf)/dt) + u_FF
/// ```
///
/// The law is that of the bare [`Pid`](crate::Pid) block; the module gives it limits that move. What is known to be in
/// effect beyond the feedback, u_FF and the setpoint's derivative, is taken off the limits and added again. All of the
/// following are such limits, so that anti-windup by tracking (time constant Ti) serves them all:
///
/// - its own, and those told backward, whichever are narrower;
/// - `AT_HIGH` or `AT_LOW` told backward: the output goes no further that way;
/// - the rate: within ± rate·h of the last output, as far as the limits allow. While it holds the output back it is told as
///   `AT_HIGH` or `AT_LOW`, in automatic, like any other limit.
///
/// | in this order | the output |
/// |---|---|
/// | told backward that the output is not followed | tracks the value in effect |
/// | manual | `manual`, within limits and rate |
/// | PV bad (`BAD`), or the scan's h not within 0 … `max_h` (`DATA_GAP`) | holds |
/// | setpoint or feed-forward bad (`BAD_SP`, `BAD_FF`) | goes on with the last good one |
/// | limits that cross (`BAD_LIMITS`) | goes on with the module's own |
///
/// **Without a bump.** At each change of mode or error the integral is set so that the output goes on from where it was,
/// plus one scan's integration: whatever jumped meanwhile, in PV, setpoint or feed-forward, does not show. Where gains
/// change, the integral is set with the samples of the scan before, so that only what the new gains make of new samples
/// is added. Before the first good sample the output is where the state was put, 0 kept within the limits.
///
/// In manual the setpoint in effect follows PV; in `External` mode the own setpoint follows the one handed over.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pid<R> {
    settings: PidSettings<R>,
    law: crate::Pid<R>,
    filter: SecondOrderFilter<R>,
}

/// State of a [`Pid`]: `mode`, `sp` and `manual` are the operator's to set.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct PidState<R: Real> {
    /// Source of the output.
    pub mode: Mode,
    /// The own setpoint, used in [`Mode::Auto`] [PV unit].
    pub sp: R,
    /// The output in [`Mode::Manual`]; follows the output in all other modes, and while it tracks.
    pub manual: R,
    /// The setpoint in effect [PV unit].
    pub ysp: R::Sum,
    /// The filtered process value [PV unit].
    pub yf: R,
    /// The output.
    pub output: R,
    /// Error flags: `BAD`, `DATA_GAP`, `BAD_SP`, `BAD_FF`, `BAD_LIMITS`; 0 = nothing.
    pub error: Status,
    /// `AT_LOW`, `AT_HIGH`: the output or something after it is at a limit, be it of its rate; `NOT_AUTO`: somebody else sets
    /// the output.
    pub flags: Status,
    /// The feed-forward in effect.
    pub(super) ff: R,
    law: crate::PidState<R>,
    filter: SecondOrderFilterState<R>,
    back: Backward<R>,
    /// K, Ti, Td and b of the last scan.
    gains: [R; 4],
    /// Flags of the last scan: the source of the output, and errors.
    status: Status,
}

/// No scan has been.
const NEW: Status = 255;
/// Errors of the measurement: nothing can be computed.
const BLIND: Status = BAD | DATA_GAP;

impl<R: Real> Default for PidState<R> {
    fn default() -> Self {
        Self::at(R::ZERO)
    }
}

impl<R: Real> PidState<R> {
    /// A controller in auto, with the output at a known value, from which it goes on.
    pub fn at(output: R) -> Self {
        Self {
            mode: Mode::Auto,
            sp: R::ZERO,
            manual: output,
            ysp: R::ZERO.into(),
            yf: R::ZERO,
            output,
            error: 0,
            flags: 0,
            ff: R::ZERO,
            law: crate::PidState::default(),
            filter: SecondOrderFilterState::default(),
            back: Backward::default(),
            gains: [R::ZERO; 4],
            status: NEW,
        }
    }

    /// Scans were missed: the filter of PV starts anew at the next one that is good. Whoever knows of it hands that scan an h below 0.
    pub fn missed(&mut self) {
        self.filter.started = false;
    }

    /// The output without the feed-forward.
    pub fn feedback(&self) -> R {
        self.output - self.ff
    }
}

impl<R: Real> Pid<R> {
    /// Checks the settings.
    pub fn new(settings: PidSettings<R>) -> Result<Self, ParameterError> {
        let PidSettings { k, ti, td, b, c, tf, low, high, rate, max_h } = settings;
        let law = crate::Pid::new(k, ti, td, b, Saturation::new(low, high)?)?;
        require("c", c, c >= R::ZERO && c <= R::ONE, "between 0 and 1")?;
        require("rate", rate, rate > R::ZERO, "greater than 0 per second")?;
        require("max_h", max_h, max_h > R::ZERO, "greater than 0 s")?;
        Ok(Self { law, filter: SecondOrderFilter::new(tf)?, settings })
    }

    /// Settings it was made with.
    pub fn settings(&self) -> &PidSettings<R> {
        &self.settings
    }

    /// State for a loop at rest: process value and setpoint at `y`, the output at `output`. The first scan goes on from
    /// there as from a scan before, and answers what differs from it; after [`PidState::at`] it takes what it finds as
    /// the beginning.
    pub fn at_rest(&self, mode: Mode, y: R, output: R) -> PidState<R> {
        let PidSettings { k, ti, td, b, max_h, .. } = self.settings;
        let free = self.law.with(k, ti, td, Saturation::none());
        let mut s = PidState { mode, sp: y, ysp: y.into(), yf: y, ..PidState::at(output) };
        free.follow(&mut s.law, y, y.into(), output, max_h);
        (s.status, s.gains) = ((mode as Status) << 2, [k, ti, td, b]);
        s
    }

    /// Takes process value, external setpoint, feed-forward and the time since the last scan `h` \[s\]; gives the output.
    #[inline(always)]
    pub fn forward(&self, s: &mut PidState<R>, pv: Forward<R>, sp: Forward<R>, ff: Forward<R>, h: R) -> Forward<R> {
        let PidSettings { k, ti, td, .. } = self.settings;
        self.scan(s, [k, ti, td], R::LARGEST, pv, sp, ff, h)
    }

    /// The scan with the gains K, Ti and Td, and a setpoint that moves by at most `sp_rate` a second.
    #[inline(always)]
    #[allow(clippy::too_many_arguments)]
    pub(super) fn scan(
        &self,
        s: &mut PidState<R>,
        gains: [R; 3],
        sp_rate: R,
        pv: Forward<R>,
        sp: Forward<R>,
        ff: Forward<R>,
        h: R,
    ) -> Forward<R> {
        let mut error = 0;
        let (ysp_before, ff_before) = (s.ysp.value(), s.ff);
        if ff.is_good() {
            s.ff = ff.value;
        } else {
            error |= BAD_FF;
        }
        if s.mode != Mode::External {
            error |= if s.sp.is_number() { 0 } else { BAD_SP };
        } else if sp.is_good() {
            s.sp = sp.value;
        } else {
            error |= BAD_SP;
        }
        error |= if h > R::ZERO && h <= self.settings.max_h { 0 } else { DATA_GAP };
        if pv.is_good() {
            // After a gap the filter starts at what is there now.
            s.filter.started &= h <= self.settings.max_h;
            s.yf = self.filter.update(&mut s.filter, pv.value, h);
        } else {
            error |= BAD;
            s.filter.started = false;
        }
        let limits = self.limits(s, &mut error);

        let tracked = s.back.flags & NOT_AUTO != 0 && s.back.tracking.is_number();
        let by_hand = tracked || s.mode == Mode::Manual;
        let status = Status::from(tracked) | ((s.mode as Status) << 2) | (error & (BLIND | BAD_SP | BAD_FF));
        let changed = status != s.status;
        if by_hand {
            s.ysp = if error & BAD == 0 { s.yf.into() } else { s.ysp };
        } else if error & (BLIND | BAD_SP) == 0 {
            let step = reach(sp_rate, h);
            s.ysp = if s.status == NEW { s.yf.into() } else { s.ysp };
            s.ysp.approach(s.sp, step);
        }

        let ysp = s.ysp.value();
        let [k, ti, td] = gains;
        let gains = [k, ti, td, self.settings.b];
        let law = |limits| self.law.with(k, ti, td, limits);
        let mut held_back = 0;
        let u = if tracked {
            s.back.tracking
        } else if by_hand {
            let wanted = if s.manual.is_number() { s.manual } else { s.output };
            self.band(s, limits, 0, h).update(wanted)
        } else if error & BLIND != 0 {
            limits.update(s.output)
        } else {
            let mut weighted = R::ZERO;
            let free = law(Saturation::none());
            if changed {
                // No difference to a sample from before the change.
                s.law.started = false;
                free.follow(&mut s.law, ysp, s.filter.y2, s.output - s.ff, h);
            } else {
                if gains != s.gains {
                    let before = s.law;
                    free.follow(&mut s.law, ysp_before, before.y, s.output - ff_before, h);
                    // The part of the integral that is not yet in the output is no bump.
                    s.law.integral = before.integral.moved_to(s.law.integral.value());
                }
                if self.settings.c > R::ZERO && td > R::ZERO {
                    let kick = k * td / h * (self.settings.c * (ysp - ysp_before));
                    // One beyond the numbers would take the integral with it.
                    weighted = if kick.is_number() { kick } else { R::ZERO };
                }
            }
            let beyond = s.ff + weighted;
            let band = self.band(s, limits, s.back.flags, h);
            let shifted = Saturation { low: band.low - beyond, high: band.high - beyond };
            let v = law(shifted).control(&mut s.law, ysp, s.filter.y2, h);
            // Where only a limit further on holds the output, that limit is reported in the backward pass.
            held_back = shifted.reached(v) & !s.back.flags;
            // Shifting and shifting back may cost a bit.
            band.update(v + beyond)
        };
        if s.mode != Mode::Manual || tracked {
            s.manual = u;
        }
        s.output = u;
        s.error = error;
        s.flags = limits.reached(u) | held_back | if by_hand || error & BLIND != 0 { NOT_AUTO } else { 0 };
        s.status = status;
        s.gains = gains;
        Forward::new(u, 0)
    }

    /// Takes the backward signals of the modules after the output; gives those to setpoint and feed-forward. They are
    /// told [`NOT_AUTO`] unless the controller follows the setpoint handed to it, and that setpoint has reached a limit
    /// while it is on its ramp.
    #[inline(always)]
    pub fn backward(&self, s: &mut PidState<R>, back: Backward<R>) -> (Backward<R>, Backward<R>) {
        s.back = back;
        s.flags |= back.flags & (AT_LOW | AT_HIGH | NOT_AUTO);
        let following = if s.mode == Mode::External { s.flags } else { s.flags | NOT_AUTO };
        let ff = Backward { flags: following, tracking: s.output, ..Backward::default() };
        let ramp = if following & NOT_AUTO == 0 {
            Saturation { low: s.ysp.value(), high: s.ysp.value() }.beyond(s.sp)
        } else {
            0
        };
        let flags = self.seen_from_setpoint(following) | ramp;
        let sp = Backward { flags, tracking: s.ysp.value(), ..Backward::default() };
        (sp, ff)
    }

    /// Flags as the setpoint sees them: where K is negative and the output is at its lower limit, a setpoint can do
    /// nothing more upward.
    #[inline(always)]
    fn seen_from_setpoint(&self, flags: Status) -> Status {
        if self.settings.k > R::ZERO {
            return flags;
        }
        let swap = |from, to| if flags & from != 0 { to } else { 0 };
        flags & !(AT_LOW | AT_HIGH) | swap(AT_LOW, AT_HIGH) | swap(AT_HIGH, AT_LOW)
    }

    /// The narrower of the own limits and the backward ones.
    #[inline(always)]
    fn limits(&self, s: &PidState<R>, error: &mut Status) -> Saturation<R> {
        let PidSettings { low, high, .. } = self.settings;
        let (narrow_low, narrow_high) = (low.greater(s.back.low), high.lesser(s.back.high));
        if s.back.low < s.back.high && narrow_low < narrow_high {
            Saturation { low: narrow_low, high: narrow_high }
        } else {
            *error |= BAD_LIMITS;
            Saturation { low, high }
        }
    }

    /// Range of the output within this scan: no further towards a limit that was reported, no faster than the rate.
    #[inline(always)]
    fn band(&self, s: &PidState<R>, limits: Saturation<R>, reported: Status, h: R) -> Saturation<R> {
        let step = if h > R::ZERO { reach(self.settings.rate, h) } else { R::ZERO };
        let up = if reported & AT_HIGH != 0 { R::ZERO } else { step };
        let down = if reported & AT_LOW != 0 { R::ZERO } else { step };
        Saturation { low: limits.update(s.output - down), high: limits.update(s.output + up) }
    }
}

/// Distance that a rate covers in `h` \[s\]; the largest number means no limit, however short the time.
#[inline(always)]
fn reach<R: Real>(rate: R, h: R) -> R {
    if rate < R::LARGEST { rate * h } else { rate }
}
