//! The controller with the detector inside.

use super::auto_tuner::{AutoTuner, AutoTunerState};
use super::backlash_detection::{BacklashDetection, BacklashDetectionSettings, BacklashDetectionState};
use super::pid::{Mode, Pid, PidSettings, PidState};
use crate::auto_tuner::{Phase, Rule};
use crate::error::require;
use crate::modules::{Backward, Forward};
use crate::status::{AT_HIGH, AT_LOW, NOT_AUTO, Status};
use crate::{
    AutoTunerSettings, CompensationSettings, DETECTIONS, DetectorSettings, ParameterError, Real, SecondOrderFilter,
    SecondOrderFilterState, Sum, tuning,
};

/// The most rows of a gain schedule.
pub const SCHEDULE_ROWS: usize = 8;

/// Names of each row's parameters in errors.
const NAMES: [[&str; 4]; SCHEDULE_ROWS] = {
    macro_rules! names {
        ($($row:literal)*) => {
            [$([concat!("at of row ", $row), concat!("k of row ", $row), concat!("ti of row ", $row), concat!("td of row ", $row)]),*]
        };
    }
    names!(1 2 3 4 5 6 7 8)
};

/// A row of a gain schedule: the controller's gains where the scheduling variable is `at`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Gains<R> {
    /// Value of the scheduling variable [its unit].
    pub at: R,
    /// Gain K, of the sign of all other rows.
    pub k: R,
    /// Integral time > 0 \[s\].
    pub ti: R,
    /// Derivative time ≥ 0 \[s\].
    pub td: R,
}

/// Settings of a [`PidAdvanced`]. What detector and controller both need stands here once.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct PidAdvancedSettings<R> {
    /// The controller.
    pub pid: PidSettings<R>,
    /// Static process gain ≠ 0, where known: from a fit, an autotuner, a step test [process value per output].
    pub kp: Option<R>,
    /// Span of the process value > 0, where known \[PV unit\]: with `op_span` it gives a Kp that is not known its default
    /// ([`DetectorSettings::gain`]).
    pub pv_span: Option<R>,
    /// Span of the output > 0, where known \[output\]; none: that of the limits, but for the default of Kp.
    pub op_span: Option<R>,
    /// Whether the process is known to integrate: it has no Kp.
    #[cfg_attr(feature = "serde", serde(default))]
    pub integrating: bool,
    /// Time constant of a filter of the detector's own ≥ 0 \[s\], for PV as measured. None: the detector sees what the controller sees.
    pub detector_tf: Option<R>,
    /// Length of the filter of detections, odd, 1 to 31.
    pub n: u32,
    /// The fastest that the setpoint in effect moves, > 0 [PV unit per second].
    pub sp_rate: R,
    /// Rows with ascending `at`; the first `rows` count. With none the controller's own gains are used.
    pub schedule: [Gains<R>; SCHEDULE_ROWS],
    /// Number of rows, at most [`SCHEDULE_ROWS`].
    pub rows: usize,
    /// Compensation, where there is one. Its `k` and `limits` are the controller's, and it takes at most half of the rate. Its defaults
    /// ([`CompensationSettings::new`]) go by the K and Ti of [`slowest`](Self::slowest).
    pub compensation: Option<CompensationSettings<R>>,
    /// The autotuner, where there is one. Its `op` and `max_h` are the controller's, which must have limits.
    pub tuner: Option<AutoTunerSettings<R>>,
    /// Rule of the controller that it offers.
    #[cfg_attr(feature = "serde", serde(default))]
    pub rule: Rule,
}

impl<R: Real> PidAdvancedSettings<R> {
    /// Default settings: Kp and spans not known, no filter of the detector's own, N = 9, no ramp, no schedule, no compensation, no autotuner.
    pub fn new(pid: PidSettings<R>) -> Self {
        Self {
            pid,
            kp: None,
            pv_span: None,
            op_span: None,
            integrating: false,
            detector_tf: None,
            n: DETECTIONS,
            sp_rate: R::LARGEST,
            schedule: [Gains::default(); SCHEDULE_ROWS],
            rows: 0,
            compensation: None,
            tuner: None,
            rule: Rule::default(),
        }
    }

    /// K, Ti and Td by which the detector goes, and a compensation has its defaults: the controller's own, under a schedule the K that is
    /// farthest from 0, the longest Ti and the longest Td of the rows.
    pub fn slowest(&self) -> [R; 3] {
        let PidSettings { k, ti, td, .. } = self.pid;
        let rows = &self.schedule[..self.rows.min(SCHEDULE_ROWS)];
        let slower = |[k, ti, td]: [R; 3], row: &Gains<R>| {
            [if row.k.magnitude() > k.magnitude() { row.k } else { k }, ti.greater(row.ti), td.greater(row.td)]
        };
        rows.first().map_or([k, ti, td], |first| rows[1..].iter().fold([first.k, first.ti, first.td], slower))
    }
}

/// A [`Pid`] with [`BacklashDetection`] inside, that is, with compensation too; a setpoint ramp and a gain schedule (thesis 6.4, 6.6, 7.1).
///
/// The detector takes the controller's own settings, and sees what the controller sees: the setpoint in effect, the
/// filtered process value, limits and mode. Where the controller does not filter, the detector does, with Td/5, or Ti/10 without derivative action (2.1).
/// With a `detector_tf` it filters PV as measured with that, while u_FF and the watch for the wrong sign see PV as they would without it.
///
/// The schedule is linear between its rows and constant outside them; a bad scheduling variable leaves the last gains.
/// With a schedule, K/Ti is not constant within a half-period: the width is then taken from the output's own travel,
/// and the conditions of the safety net use the longest Ti and the largest |K| of the table.
///
/// The [`AutoTuner`] inside (6.6, 7.2.2) stands between controller and output, as it would outside: set `tuner.run` in the state,
/// and a relay experiment begins with the next scan. It ends like any other, and also in manual ([`Stop::NotAuto`]) and where the
/// controller's own `rate` is too low for the relay, whose swing is 4/3 of the amplitude ([`Stop::OpLimit`]).
/// Once it is done, [`offered`](Self::offered) gives the controller that the rule makes of it, and [`take_over`](Self::take_over) puts it in
/// force without a bump. The Kp that it found, where it found one, goes to the detector at once, unless `kp` is given.
///
/// [`Stop::NotAuto`]: crate::auto_tuner::Stop::NotAuto
/// [`Stop::OpLimit`]: crate::auto_tuner::Stop::OpLimit
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PidAdvanced<R> {
    settings: PidAdvancedSettings<R>,
    pid: Pid<R>,
    detection: BacklashDetection<R>,
    tuner: Option<AutoTuner<R>>,
    /// Filter for u_FF and the watch, where neither the controller nor the detector filters PV for them.
    beside: Option<SecondOrderFilter<R>>,
}

/// State of a [`PidAdvanced`].
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct PidAdvancedState<R: Real> {
    /// The controller.
    pub pid: PidState<R>,
    /// The detection; a new one resets it.
    pub detection: BacklashDetectionState<R>,
    /// The autotuner; `run` is the operator's to set.
    #[cfg_attr(feature = "serde", serde(default))]
    pub tuner: AutoTunerState<R>,
    /// Kp that the last experiment found which found one; the detector's, where none is given.
    #[cfg_attr(feature = "serde", serde(default))]
    pub kp: Option<R>,
    /// The scheduling variable in effect.
    by: R,
    #[cfg_attr(feature = "serde", serde(default))]
    beside: SecondOrderFilterState<R>,
}

impl<R: Real> PidAdvancedState<R> {
    /// A controller in auto, with the output at a known value, from which it goes on.
    pub fn at(output: R) -> Self {
        Self {
            pid: PidState::at(output),
            detection: BacklashDetectionState::default(),
            tuner: AutoTunerState::default(),
            kp: None,
            by: R::ZERO,
            beside: SecondOrderFilterState::default(),
        }
    }

    /// Error flags of the controller, and [`WRONG_SIGN`](crate::status::WRONG_SIGN) of the detector.
    pub fn error(&self) -> Status {
        self.pid.error | self.detection.error()
    }
}

impl<R: Real> Default for PidAdvancedState<R> {
    fn default() -> Self {
        Self::at(R::ZERO)
    }
}

impl<R: Real> PidAdvanced<R> {
    /// Checks the settings.
    pub fn new(settings: PidAdvancedSettings<R>) -> Result<Self, ParameterError> {
        let PidAdvancedSettings { pid, kp, pv_span, op_span, integrating, detector_tf, .. } = settings;
        let PidAdvancedSettings { n, sp_rate, schedule, rows, compensation, tuner, .. } = settings;
        if let Some(tf) = detector_tf {
            require("detector_tf", tf, tf >= R::ZERO, "0 s or greater")?;
        }
        require("sp_rate", sp_rate, sp_rate > R::ZERO, "greater than 0 per second")?;
        require("rows", R::of(rows as f64), rows <= SCHEDULE_ROWS, "at most 8")?;
        for (i, (row, [at, k, ti, td])) in schedule[..rows].iter().zip(NAMES).enumerate() {
            let ascending = i == 0 || row.at > schedule[i - 1].at;
            require(at, row.at, ascending, "a number greater than in the row before")?;
            // Compared by signs and not by the product, which underflows for very small numbers.
            let alike = if pid.k > R::ZERO { row.k > R::ZERO } else { pid.k < R::ZERO && row.k < R::ZERO };
            require(k, row.k, alike, "of the sign of the controller's own k, and not 0")?;
            require(ti, row.ti, row.ti > R::ZERO, "greater than 0 s")?;
            require(td, row.td, row.td >= R::ZERO, "0 s or greater")?;
        }
        let filtered = pid.tf > R::ZERO;
        let [k, ti, td] = settings.slowest();
        let usual_tf = DetectorSettings::filter_time(ti, td);
        let limited = pid.low > -R::LARGEST && pid.high < R::LARGEST;
        let detection = BacklashDetectionSettings {
            detector: DetectorSettings {
                td: (rows == 0).then_some(pid.td),
                b: pid.b,
                kp,
                pv_span,
                op_span,
                integrating,
                tf: detector_tf.unwrap_or(if filtered { R::ZERO } else { usual_tf }),
                n,
                op_limits: limited.then_some((pid.low, pid.high)),
                max_h: pid.max_h.lesser(R::of(1e9)),
                ..DetectorSettings::new(k, ti, td, pid.max_h)
            },
            compensation: compensation.map(|given| {
                // A value that is no number stays, to be refused.
                let half = pid.rate / R::of(2.0);
                let rate = if given.rate.is_number() { given.rate.lesser(half) } else { given.rate };
                CompensationSettings { rate, ..given }
            }),
        };
        if tuner.is_some() {
            let bound = "a limit of the output: the autotuner needs both";
            require("low", pid.low, pid.low >= -R::MOST, bound)?;
            require("high", pid.high, pid.high <= R::MOST, bound)?;
        }
        let tuner = tuner.map(|given| {
            let max_h = pid.max_h.lesser(R::of(1e9));
            AutoTuner::new(AutoTunerSettings { op: (pid.low, pid.high), max_h, ..given })
        });
        let tf = pid.tf;
        let pid = Pid::new(pid)?;
        let beside = if detector_tf.is_some() && !filtered { Some(SecondOrderFilter::new(usual_tf)?) } else { None };
        Ok(Self {
            settings,
            pid,
            detection: BacklashDetection::new(detection)?.behind(tf),
            beside,
            tuner: tuner.transpose()?,
        })
    }

    /// Settings it was made with.
    pub fn settings(&self) -> &PidAdvancedSettings<R> {
        &self.settings
    }

    /// The detection inside.
    pub fn detection(&self) -> &BacklashDetection<R> {
        &self.detection
    }

    /// The state in which the loop rests, see [`Pid::at_rest`].
    pub fn at_rest(&self, mode: Mode, y: R, output: R) -> PidAdvancedState<R> {
        PidAdvancedState { pid: self.pid.at_rest(mode, y, output), ..PidAdvancedState::at(output) }
    }

    /// Computes the output, see [`Pid::forward`]; `by` is the scheduling variable, anything where there is no schedule.
    #[inline(always)]
    pub fn forward(
        &self,
        s: &mut PidAdvancedState<R>,
        pv: Forward<R>,
        sp: Forward<R>,
        ff: Forward<R>,
        by: Forward<R>,
        h: R,
    ) -> Forward<R> {
        if by.is_good() {
            s.by = by.value;
        }
        let ff = Forward::new(ff.value + s.detection.compensation.u_ff.value(), ff.flags);
        let u = self.pid.scan(&mut s.pid, self.gains(s.by), self.settings.sp_rate, pv, sp, ff, h);
        let mut seen = if self.settings.pid.tf > R::ZERO { s.pid.yf } else { pv.value };
        let mut beside = None;
        if self.settings.detector_tf.is_some() {
            s.beside.started &= h <= self.settings.pid.max_h;
            beside = Some(self.beside.map_or(seen, |filter| filter.forward(&mut s.beside, pv, h).value));
            seen = pv.value;
        }
        let (sp, seen) = (s.pid.ysp.value().into(), Forward::new(seen, pv.flags));
        self.detection.forward_filtered(&mut s.detection, sp, seen, pv.value, beside, h);
        match &self.tuner {
            Some(tuner) => self.tuned(tuner, s, u, pv, h),
            None => u,
        }
    }

    /// The output, where the autotuner may have it.
    #[inline(always)]
    fn tuned(
        &self,
        tuner: &AutoTuner<R>,
        s: &mut PidAdvancedState<R>,
        u: Forward<R>,
        pv: Forward<R>,
        h: R,
    ) -> Forward<R> {
        let was_running = s.tuner.experiment.phase.is_running();
        if was_running || s.tuner.run {
            let swing =
                R::of(4.0) * (self.settings.tuner.map_or(R::ZERO, |given| given.amplitude).magnitude() / R::of(3.0));
            let by_hand = if s.pid.mode == Mode::Manual { NOT_AUTO } else { 0 };
            let slow = if self.settings.pid.rate * h < swing { AT_LOW | AT_HIGH } else { 0 };
            tuner.tell(&mut s.tuner, by_hand | slow);
        }
        let out = tuner.forward(&mut s.tuner, u, pv, h);
        let experiment = &s.tuner.experiment;
        if was_running && experiment.phase == Phase::Done {
            s.kp = experiment.found.and_then(|found| found.kp).or(s.kp);
        }
        out
    }

    /// Takes what became of the output, see [`Pid::backward`]; the detector learns from the sample of this scan. The output it sees
    /// is the controller's own, without what came from outside.
    #[inline(always)]
    pub fn backward(&self, s: &mut PidAdvancedState<R>, back: Backward<R>) -> (Backward<R>, Backward<R>) {
        let back = match &self.tuner {
            Some(tuner) => tuner.backward(&mut s.tuner, back),
            None => back,
        };
        let PidAdvancedSettings { kp, integrating, .. } = self.settings;
        s.detection.detector.set_kp(if kp.is_none() && !integrating { s.kp } else { None });
        let backward = self.pid.backward(&mut s.pid, back);
        let flags = s.pid.flags & (AT_LOW | AT_HIGH | NOT_AUTO);
        let tracking = s.pid.feedback() + s.detection.compensation.u_ff.value();
        let seen = Backward { flags, tracking, ..Backward::default() };
        self.detection.backward(&mut s.detection, Some(seen));
        backward
    }

    /// A scan in which nothing is read: the output holds, and u_FF goes to 0 by its ramp. All else waits, and goes on as after a gap:
    /// whoever pauses hands the next scan an h below 0. An experiment is to be ended before.
    pub fn pause(&self, s: &mut PidAdvancedState<R>, h: R) {
        s.pid.missed();
        s.beside.started = false;
        self.detection.pause(&mut s.detection, 0, h);
    }

    /// The controller that the rule makes of what the last experiment found.
    ///
    /// # Errors
    /// Where no experiment has come to its end, where the rule has no answer for what it found, and under a gain schedule, whose
    /// rows an experiment at one point says nothing of.
    pub fn offered(&self, s: &PidAdvancedState<R>) -> Result<tuning::Gains<R>, ParameterError> {
        let rows = R::of(self.settings.rows as f64);
        require(
            "rows",
            rows,
            self.settings.rows == 0,
            "0: under a gain schedule its rows are the gains, set them there",
        )?;
        let experiment = &s.tuner.experiment;
        let phase = R::of(f64::from(experiment.phase as u8));
        let done = experiment.found.filter(|_| experiment.phase == Phase::Done);
        let bound = "4, done: nothing is offered before an experiment has come to its end";
        let found = done.ok_or(ParameterError { name: "phase", value: phase.as_f64(), bound })?;
        found.by(self.settings.rule)
    }

    /// The controller with the gains that are [offered](Self::offered). It goes on from this state without a bump, and the
    /// half-period under way ends as a *gap*.
    ///
    /// # Errors
    /// As [`offered`](Self::offered); the state then stays as it is.
    pub fn take_over(&self, s: &mut PidAdvancedState<R>) -> Result<Self, ParameterError> {
        let tuning::Gains { k, ti, td } = self.offered(s)?;
        let pid = PidSettings { k, ti, td, ..self.settings.pid };
        let taken = Self::new(PidAdvancedSettings { pid, ..self.settings })?;
        s.detection.cut();
        Ok(taken)
    }

    /// K, Ti and Td at the scheduling variable `by`.
    #[inline(always)]
    fn gains(&self, by: R) -> [R; 3] {
        let PidSettings { k, ti, td, .. } = self.settings.pid;
        if self.settings.rows == 0 { [k, ti, td] } else { self.scheduled(by) }
    }

    /// K, Ti and Td of the schedule at `by`, between its rows.
    fn scheduled(&self, by: R) -> [R; 3] {
        let rows = &self.settings.schedule[..self.settings.rows];
        let above = rows.iter().take_while(|row| row.at <= by).count();
        let (low, high) = (rows[above.saturating_sub(1)], rows[above.min(rows.len() - 1)]);
        let way = high.at - low.at;
        let share = if way > R::ZERO { (by - low.at) / way } else { R::ZERO };
        let between = |from: R, to: R| from + (to - from) * share;
        let ti = between(low.ti, high.ti);
        // For rows so far apart that their difference has lost the smaller one, that row: no division by 0.
        [between(low.k, high.k), if ti > R::ZERO { ti } else { high.ti }, between(low.td, high.td)]
    }
}
