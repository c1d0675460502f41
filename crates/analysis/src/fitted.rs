//! Verdict of the fit on the valve: by PV, by the valve's own position, and by both together.

use crate::crossings::Exclusion;
use crate::origin::fitted_gain_serves;
use crate::trend::{DAY, WidthTrend, of_found};
use glapp_core::named;
use glapp_fit::{
    AtValve, Batch, Confidence, FitProblem, JointAnswer, Judgement, PositionAnswer, Recorded, Samples, SegmentAnswer,
    Tell, Together, Trend, Unfit, ValveAnswer, Weighed,
};
use serde::{Deserialize, Serialize};

named! {
    /// Kind of lost motion.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
    #[serde(rename_all = "snake_case")]
    pub enum FitVerdict {
        /// A gap.
        Backlash => "backlash",
        /// A valve that sticks and jumps, no gap beside it.
        Stiction => "stiction",
        /// Backlash and stiction.
        Both => "both",
        /// The loop swings in a clean sinusoid, not for its valve; a gap beside it does not show.
        Oscillation => "oscillation",
        /// No gap wider than the upper limit.
        Sound => "sound",
        /// A gap, wider than the lower limit.
        AtLeast => "at_least",
        /// OP and PV do not tell.
        CannotTell => "cannot_tell",
    }
}

impl FitVerdict {
    /// Whether there is a lost motion.
    pub const fn found(self) -> bool {
        matches!(self, Self::Backlash | Self::Stiction | Self::Both | Self::AtLeast)
    }
}

impl From<glapp_fit::Verdict> for FitVerdict {
    fn from(verdict: glapp_fit::Verdict) -> Self {
        match verdict {
            glapp_fit::Verdict::Backlash => Self::Backlash,
            glapp_fit::Verdict::Stiction => Self::Stiction,
            glapp_fit::Verdict::Both => Self::Both,
            glapp_fit::Verdict::Sound => Self::Sound,
            glapp_fit::Verdict::AtLeast => Self::AtLeast,
            glapp_fit::Verdict::CannotTell => Self::CannotTell,
        }
    }
}

/// Why the fit says so.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(tag = "code", content = "of", rename_all = "snake_case")]
pub enum FitWhy {
    /// The width of this OP is not that of one valve.
    #[serde(rename = "place")]
    Exclusion(Exclusion),
    /// Index of the finding that is the reason.
    Finding(usize),
    /// OP stands still all the time.
    OpRests,
    /// No fit was possible: a code, and its number.
    Unfit(&'static str, f64),
    /// The word of the likelihood's evidence.
    Evidence(&'static str),
}

/// Signal that was fitted to OP.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub enum Signal {
    /// The process value.
    PV,
    /// The valve's own position.
    #[serde(rename = "position")]
    Position,
}

/// Effect of a recorded position of the valve on the answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Position {
    /// The position decides nothing: the answer is PV's.
    Silent,
    /// The position settles the answer.
    Settles,
    /// The position gives only a bound: the width is PV's.
    Bounds,
    /// No width lies in the intervals of both.
    Contradicts,
}

/// A value with its lower and upper 95 % limit.
pub type Limits = (f64, f64, f64);

/// The process between valve and PV as the best model has it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Process {
    /// Static gain [PV unit/OP unit]; of an integrating process its velocity gain [PV unit/(OP unit·s)].
    pub kp: Limits,
    /// Dead time \[s\].
    pub dead_time: Limits,
    /// Lags together \[s\].
    pub lag: Limits,
    /// Whether it integrates.
    pub integrating: bool,
}

/// One window's answer.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Window {
    /// Time of the first sample \[s\].
    pub t_start: f64,
    /// Time of the last sample \[s\].
    pub t_end: f64,
    /// Verdict of this window alone.
    pub verdict: FitVerdict,
    /// Width [OP unit].
    pub d: f64,
    /// Lower 95 % limit [OP unit].
    pub low: f64,
    /// Upper 95 % limit [OP unit]; none where there is none.
    pub high: Option<f64>,
}

impl Window {
    fn of<A>(record: &SegmentAnswer<A>, verdict: glapp_fit::Verdict, [d, low]: [f64; 2], high: Option<f64>) -> Self {
        Self { t_start: record.start, t_end: record.end, verdict: verdict.into(), d, low, high }
    }
}

/// Width of the gap with its interval.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FitAnswer {
    /// Kind of lost motion.
    pub verdict: FitVerdict,
    /// Why.
    pub why: FitWhy,
    /// Most likely total width [OP unit]; none where nothing could be fitted.
    pub d: Option<f64>,
    /// Lower limit of its 95 % interval [OP unit].
    pub low: Option<f64>,
    /// Upper limit [OP unit]; none where the recording gives none.
    pub high: Option<f64>,
    /// The lower limit of a bound [OP unit].
    pub at_least: Option<f64>,
    /// Slip jump [OP unit]; 0 for mere backlash.
    pub jump: f64,
    /// Likelihood ratio of no gap against the best width.
    pub lr_no_gap: Option<f64>,
    /// Likelihood ratio that a gap needs.
    pub lr_needed: Option<f64>,
    /// The process; none where nothing could be fitted.
    pub process: Option<Process>,
    /// Signal that was fitted to OP.
    pub signal: Signal,
    /// Effect of a recorded position of the valve; none where it was not recorded.
    pub position: Option<Position>,
    /// Change of the width and its standard error [OP unit/day].
    pub trend: Option<(f64, f64)>,
    /// Judgement of the ladder; none where no fit was possible.
    pub judgement: Option<Judgement>,
    /// The evidence for a dead band weighed; none where there is none to weigh, where the valve's position settles the answer, and where
    /// recordings exclude each other.
    pub weighed: Option<Weighed>,
    /// The trend with its sentence, as the one answer has it.
    pub change: Option<WidthTrend>,
    /// The windows that were fitted.
    pub windows: Vec<Window>,
}

impl FitAnswer {
    /// The answer where nothing was fitted.
    fn none(why: FitWhy, signal: Signal) -> Self {
        Self {
            verdict: FitVerdict::CannotTell,
            why,
            d: None,
            low: None,
            high: None,
            at_least: None,
            jump: 0.0,
            lr_no_gap: None,
            lr_needed: None,
            process: None,
            signal,
            position: None,
            trend: None,
            judgement: None,
            weighed: None,
            change: None,
            windows: Vec::new(),
        }
    }

    /// Verdict by PV; `sinusoid` is the place of the finding that the loop swings in a clean one.
    fn of_pv(found: &Result<JointAnswer, Unfit>, sinusoid: Option<usize>) -> Self {
        match found {
            Ok(joint) => Self::of_records(&joint.whole, &joint.records, joint.shown, sinusoid),
            Err(unfit) => Self::none(FitWhy::unfit(*unfit), Signal::PV),
        }
    }

    /// Verdict by PV in several recordings of one valve; windows and process are those of the recording that shows it
    /// best.
    fn of_valve(found: &Result<ValveAnswer, Unfit>) -> Self {
        match found {
            Ok(valve) => match &valve.recordings[valve.shown].own {
                Ok(own) => Self::of_records(&valve.whole, &own.records, own.shown, None),
                Err(unfit) => Self::none(FitWhy::unfit(*unfit), Signal::PV),
            },
            Err(unfit) => Self::none(FitWhy::unfit(*unfit), Signal::PV),
        }
    }

    /// The fit of several records, with their windows.
    fn of_records(
        joint: &Together,
        records: &[SegmentAnswer<glapp_fit::SegmentFit>],
        shown: usize,
        sinusoid: Option<usize>,
    ) -> Self {
        let best = &records[shown].answer;
        let limits = |value, (low, high)| (value, low, high);
        let window = |r: &SegmentAnswer<glapp_fit::SegmentFit>| {
            Window::of(r, r.answer.verdict, [r.answer.d, r.answer.low], r.answer.high)
        };
        Self {
            d: Some(joint.d),
            low: Some(joint.low),
            high: joint.high,
            jump: best.jump,
            lr_no_gap: Some(joint.lr_no_gap),
            lr_needed: Some(joint.lr_needed),
            process: Some(Process {
                kp: limits(best.kp, best.kp_limits),
                dead_time: limits(best.dead_time, best.dead_time_limits),
                lag: limits(best.lag, best.lag_limits),
                integrating: best.integrating,
            }),
            trend: joint.trend.map(a_day),
            judgement: Some(joint.judgement),
            weighed: Weighed::of(&joint.evidence, best).filter(|_| sinusoid.is_none() && !excluded(joint)),
            change: joint.trend.map(|found| of_found(Some(found), found.widths)),
            windows: records.iter().map(window).collect(),
            ..Self::none(sinusoid.map_or(FitWhy::Evidence(joint.reason), FitWhy::Finding), Signal::PV)
        }
        .with_verdict(sinusoid.map_or(joint.verdict.into(), |_| FitVerdict::Oscillation))
    }

    /// Verdict by the valve's position.
    fn of_position(found: &Result<PositionAnswer, Unfit>) -> Self {
        let joint = match found {
            Ok(joint) => joint,
            Err(unfit) => return Self::none(FitWhy::unfit(*unfit), Signal::Position),
        };
        let best = &joint.records[joint.shown].answer;
        let window =
            |r: &SegmentAnswer<AtValve>| Window::of(r, r.answer.verdict, [r.answer.d, r.answer.low], r.answer.high);
        Self {
            d: Some(joint.d),
            low: Some(joint.low),
            high: joint.high,
            jump: best.jump,
            lr_no_gap: Some(best.lr_no_gap),
            lr_needed: Some(best.lr_needed),
            trend: joint.trend.map(a_day),
            judgement: Some(Judgement::at_valve(joint.verdict)),
            change: joint.trend.map(|found| of_found(Some(found), found.widths)),
            windows: joint.records.iter().map(window).collect(),
            ..Self::none(FitWhy::Evidence(best.reason), Signal::Position)
        }
        .with_verdict(joint.verdict.into())
    }

    /// Verdict by position and PV: the position settles it, and where PV contradicts it the verdict is neither of the
    /// two.
    fn together(at_valve: Self, through_pv: Self) -> Self {
        use Position::{Bounds, Contradicts, Settles, Silent};
        if !(at_valve.verdict.found() || at_valve.verdict == FitVerdict::Sound) {
            return Self { position: Some(Silent), ..through_pv };
        }
        let settled = Self { position: Some(Settles), process: through_pv.process, ..at_valve };
        let (Some(here), Some(there)) = (settled.interval(), through_pv.interval()) else { return settled };
        let beyond = |one: Interval, other: Interval| one.1.is_some_and(|high| high < other.0);
        if beyond(here, there) || beyond(there, here) {
            let both = settled.verdict.found() && through_pv.verdict.found();
            // One sees a gap that the other excludes: lost motion beyond the sensor, a loose sensor, or a wrong model.
            let verdict = if both { settled.verdict } else { FitVerdict::CannotTell };
            return Self {
                position: Some(Contradicts),
                low: Some(here.0.min(there.0)),
                high: here.1.zip(there.1).map(|(one, other)| one.max(other)),
                judgement: if both { settled.judgement } else { None },
                weighed: None,
                ..settled
            }
            .with_verdict(verdict);
        }
        if settled.verdict == FitVerdict::AtLeast && through_pv.verdict.found() && there.1.is_some() {
            return Self { position: Some(Bounds), ..through_pv };
        }
        settled
    }

    fn with_verdict(self, verdict: FitVerdict) -> Self {
        let at_least = self.low.filter(|_| verdict == FitVerdict::AtLeast);
        Self { verdict, at_least, ..self }
    }

    /// The widths that are not excluded [OP unit], upper limit none where there is none; none where nothing is.
    pub fn interval(&self) -> Option<Interval> {
        match self.verdict {
            FitVerdict::Sound => self.low.map(|_| (0.0, self.high)),
            FitVerdict::AtLeast => self.low.map(|low| (low, None)),
            verdict if verdict.found() => self.low.map(|low| (low, self.high)),
            _ => None,
        }
    }

    /// Kp where a lost motion was found and with it the gain of a process that does not integrate, to a third.
    pub fn gain(&self) -> Option<f64> {
        let process = self.process.filter(|process| self.verdict.found() && !process.integrating)?;
        let (kp, low, high) = process.kp;
        fitted_gain_serves(kp, low, high).then_some(kp)
    }
}

impl FitAnswer {
    /// The word for why.
    pub fn word(&self) -> &'static str {
        match self.why {
            FitWhy::Exclusion(_) => "place",
            FitWhy::Finding(_) => "finding",
            FitWhy::OpRests => "op_rests",
            FitWhy::Unfit(word, _) | FitWhy::Evidence(word) => word,
        }
    }
}

/// Lower and upper limit; none where there is no upper one.
pub type Interval = (f64, Option<f64>);

impl FitWhy {
    fn unfit(why: Unfit) -> Self {
        Self::Unfit(why.name(), why.number())
    }
}

/// Whether recordings of one valve exclude each other's widths: what one of them says is not what all say.
fn excluded(joint: &Together) -> bool {
    joint.judgement.confidence == Confidence::CannotTell && joint.reason == "recordings_disagree"
}

/// Slope and standard error of a trend, per day.
fn a_day(trend: Trend) -> (f64, f64) {
    (DAY * trend.slope, DAY * trend.error)
}

/// The answer, and its parts.
#[derive(Clone, Debug)]
pub struct Fitted {
    /// The answer.
    pub answer: FitAnswer,
    /// Fit of PV; none where it was not asked.
    pub pv: Option<Result<JointAnswer, Unfit>>,
    /// Fit of the valve's position; none where it was not recorded.
    pub position: Option<Result<PositionAnswer, Unfit>>,
}

impl Fitted {
    /// The answer where the fit was not asked, and why.
    pub fn not(why: FitWhy) -> Self {
        Self { answer: FitAnswer::none(why, Signal::PV), pv: None, position: None }
    }
}

/// The problem of a stretch, or of the windows of a longer recording; none where there are none.
pub(crate) fn problem(batches: &[Batch<'_>], sign: f64) -> Option<Result<FitProblem<'static>, Unfit>> {
    let samples: Vec<Samples> = batches.iter().map(|batch| batch.samples).collect();
    (!samples.is_empty()).then(|| FitProblem::of(&samples, sign))
}

/// Fits a stretch, or the windows of a longer recording. `sign` is that of the process gain, 0 where it is not known;
/// `sinusoid` the place of the finding that the loop swings in a clean one, where there is such a finding; `tell` takes the
/// share that is done.
pub fn fitted(batches: &[Batch<'_>], sign: f64, sinusoid: Option<usize>, tell: Tell) -> Fitted {
    match problem(batches, sign) {
        None => Fitted::not(FitWhy::OpRests),
        Some(problem) => fitted_with(batches, sinusoid, problem.and_then(|problem| glapp_fit::fit(&problem, tell))),
    }
}

/// The answer of position and PV together, with what was fitted to PV.
pub(crate) fn fitted_with(batches: &[Batch<'_>], sinusoid: Option<usize>, pv: Result<JointAnswer, Unfit>) -> Fitted {
    let through_pv = FitAnswer::of_pv(&pv, sinusoid);
    let Some(position) = at_valve(batches) else {
        return Fitted { answer: through_pv, pv: Some(pv), position: None };
    };
    let answer = FitAnswer::together(FitAnswer::of_position(&position), through_pv);
    Fitted { answer, pv: Some(pv), position: Some(position) }
}

/// The answer of several recordings of one valve, and its parts.
#[derive(Clone, Debug)]
pub struct FittedValve {
    /// The answer.
    pub answer: FitAnswer,
    /// Fit of PV.
    pub pv: Result<ValveAnswer, Unfit>,
    /// Fit of the valve's position; none where it was not recorded.
    pub position: Option<Result<PositionAnswer, Unfit>>,
}

/// Fits recordings of one valve, in the order of time: of each when its time is 0 [s] (NaN where not known) and its stretch, or its
/// windows. `sign` is that of the process gain, 0 where it is not known; `tell` takes the share that is done.
pub fn fitted_valve(recordings: &[(f64, Vec<Batch<'_>>)], sign: f64, tell: Tell) -> FittedValve {
    let recorded: Vec<Recorded> = recordings
        .iter()
        .map(|(since, batches)| Recorded { since: *since, samples: batches.iter().map(|b| b.samples).collect() })
        .collect();
    let pv = glapp_fit::fit_valve(&recorded, sign, tell);
    let through_pv = FitAnswer::of_valve(&pv);
    let on_one_clock = |since: f64, t: &[f64]| t.iter().map(|t| t + if since.is_nan() { 0.0 } else { since }).collect();
    let all: Vec<(Vec<f64>, &Batch)> = recordings
        .iter()
        .flat_map(|(since, batches)| batches.iter().map(|batch| (on_one_clock(*since, batch.samples.t), batch)))
        .collect();
    let batches: Vec<Batch> =
        all.iter().map(|(t, batch)| Batch { samples: Samples { t, ..batch.samples }, ..**batch }).collect();
    let Some(position) = at_valve(&batches) else {
        return FittedValve { answer: through_pv, pv, position: None };
    };
    let answer = FitAnswer::together(FitAnswer::of_position(&position), through_pv);
    FittedValve { answer, pv, position: Some(position) }
}

/// Fit of the valve's position; none where it was not recorded.
fn at_valve(batches: &[Batch<'_>]) -> Option<Result<PositionAnswer, Unfit>> {
    let recorded = |batch: &Batch| batch.position.is_some_and(|position| position.iter().any(|x| x.is_finite()));
    if !batches.iter().any(recorded) {
        return None;
    }
    let none: Vec<Vec<f64>> =
        batches.iter().map(|b| vec![f64::NAN; if b.position.is_none() { b.samples.t.len() } else { 0 }]).collect();
    // Findings on PV do not concern the position.
    let at_valve = |(batch, none)| {
        let &Batch { samples, position } = batch;
        let none: &Vec<f64> = none;
        Samples { pv: position.unwrap_or(none), flags: None, ..samples }
    };
    let samples: Vec<Samples> = batches.iter().zip(&none).map(at_valve).collect();
    Some(glapp_fit::fit_position(&samples))
}

#[cfg(test)]
mod tests {
    use super::*;
    use FitVerdict::{AtLeast, Backlash, CannotTell, Sound};

    fn answer_of(verdict: FitVerdict, signal: Signal, d: f64, low: f64, high: Option<f64>) -> FitAnswer {
        let none = FitAnswer::none(FitWhy::Evidence("gap"), signal);
        FitAnswer { d: Some(d), low: Some(low), high, ..none }.with_verdict(verdict)
    }

    fn valve(verdict: FitVerdict, d: f64, low: f64, high: Option<f64>) -> FitAnswer {
        answer_of(verdict, Signal::Position, d, low, high)
    }

    fn pv(verdict: FitVerdict, d: f64, low: f64, high: Option<f64>) -> FitAnswer {
        answer_of(verdict, Signal::PV, d, low, high)
    }

    #[test]
    fn a_contradiction_is_seen() {
        let clear = || valve(Backlash, 1.0, 0.9, Some(1.1));
        for (at_valve, through_pv, verdict, low, high) in [
            // No width is in both: the interval holds both.
            (clear(), pv(Backlash, 2.0, 1.8, Some(2.2)), Backlash, 0.9, Some(2.2)),
            (clear(), pv(AtLeast, 3.0, 2.5, None), Backlash, 0.9, None),
            // A gap in one of them alone.
            (valve(Sound, 0.0, 0.0, Some(0.2)), pv(Backlash, 2.0, 1.8, Some(2.2)), CannotTell, 0.0, Some(2.2)),
            (clear(), pv(Sound, 0.0, 0.0, Some(0.3)), CannotTell, 0.0, Some(1.1)),
        ] {
            let answer = FitAnswer::together(at_valve, through_pv);
            assert_eq!((answer.verdict, answer.low, answer.high), (verdict, Some(low), high));
            assert_eq!(answer.position, Some(Position::Contradicts));
        }
    }

    #[test]
    fn where_they_agree_the_position_settles_it() {
        let broad = || pv(Backlash, 1.3, 0.8, Some(2.0));
        let answer = FitAnswer::together(valve(Backlash, 1.0, 0.9, Some(1.1)), broad());
        assert_eq!((answer.d, answer.low, answer.high), (Some(1.0), Some(0.9), Some(1.1)));
        assert_eq!((answer.position, answer.signal), (Some(Position::Settles), Signal::Position));
        // A mere bound does not hide a width, and what the position cannot tell, PV answers.
        let bound = FitAnswer::together(valve(AtLeast, 1.0, 0.7, None), broad());
        assert_eq!((bound.d, bound.position, bound.signal), (Some(1.3), Some(Position::Bounds), Signal::PV));
        let silent = FitAnswer::together(FitAnswer::none(FitWhy::OpRests, Signal::Position), broad());
        assert_eq!((silent.d, silent.position, silent.at_least), (Some(1.3), Some(Position::Silent), None));
    }

    #[test]
    fn a_gain_serves_with_a_gap_and_without_an_integrator() {
        let process = |kp, integrating| {
            let limits = (1.0, 0.9, 1.1);
            Some(Process { kp, dead_time: limits, lag: limits, integrating })
        };
        let found = |verdict, process| FitAnswer { process, ..pv(verdict, 1.0, 0.9, Some(1.1)) }.gain();
        assert_eq!(found(Backlash, process((-2.0, -2.2, -1.8), false)), Some(-2.0));
        assert_eq!(found(Backlash, process((-2.0, -2.2, -1.8), true)), None);
        assert_eq!(found(Sound, process((-2.0, -2.2, -1.8), false)), None);
        assert_eq!(found(Backlash, process((2.0, 1.0, 3.0), false)), None);
    }
}
