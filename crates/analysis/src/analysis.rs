//! A recording from its first sample to its answer, without files, clock or sentences.

use crate::answer::{AnalysisResult, CorrectedAnswer, Settings};
use crate::crossings::{Beside, Exclusion, Known, NotCorrected, Travel, Verdict, judge};
use crate::fitted::{FitWhy, Fitted, fitted, fitted_with, problem};
use crate::harm::{Cells as HarmCells, Harm, harm};
use crate::identify::{Identification, identified};
use crate::quality::{self, Fault, Finding, Law, PERCENT, Severity, assumed_gain, inspect, op_unit};
use crate::step_test::{Manual, ManualRows, StepTest, StepTestSettings};
use crate::summary::{Facts, Summary};
use crate::words;
use crate::{Counter, Crossings, Inspected, Ladder, Origin, median, noise_sigma, process_gain, rows_to_ask_for};
use glapp_core::status::NOT_AUTO;
use glapp_core::{Columns, DATA_GAP_STEPS, DETECTIONS, DetectorSettings, ParameterError, Reason};
use glapp_fit::{
    Batch, FitProblem, JointAnswer, LONG_HISTORY, Prediction, Rows, Samples, SegmentAnswer, Tell, Unfit, Windows,
};
use rayon::prelude::*;
use serde::Deserialize;
use std::cmp::Reverse;

/// Rows that identification and the closer look at quality take from the beginning of a recording.
pub const INSPECTED_ROWS: usize = LONG_HISTORY;
/// Rows from which given settings are checked.
const CHECKED_ROWS: usize = 20_000;

/// A controller in ideal form.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Controller {
    /// Gain K, negative for direct action [OP unit/PV unit].
    pub k: f64,
    /// Integral time \[s\].
    pub ti: f64,
    /// Derivative time \[s\].
    pub td: f64,
    /// Setpoint weight.
    pub b: f64,
}

/// A loop with its settings, and the questions to ask of it.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Task {
    /// The controller; none: it is read out of OP's moves.
    pub controller: Option<Controller>,
    /// Setpoint weight, where a person stated it.
    pub setpoint_weight: Option<f64>,
    /// Process gain Kp, where it is known [PV unit/OP unit].
    pub kp: Option<f64>,
    /// Whether the process integrates.
    pub integrating: bool,
    /// Span of PV, where it is known [PV unit].
    pub pv_span: Option<(f64, f64)>,
    /// Span of OP, where it is known [OP unit].
    pub op_span: Option<(f64, f64)>,
    /// Whether OP is a percentage, and its span 0 to 100 where none is given; none: unless the recording contradicts it.
    pub op_percent: Option<bool>,
    /// Position of the detector in the plant, where it rules out an estimate.
    pub exclusion: Option<Exclusion>,
    /// Widest acceptable dead band, where it is stated [% of OP's span].
    pub acceptable: Option<f64>,
    /// Share of the plant's valves that have a dead band, where it is stated.
    pub prior: Option<f64>,
    /// Dead band that the positioner is set to [% of travel], where it is known.
    pub positioner_dead_band: Option<f64>,
    /// Filter time of the detector; none: a ladder is tried \[s\].
    pub tf: Option<f64>,
    /// Detections behind an estimate.
    pub n: u32,
    /// Judge the recording, and find missing settings; else the crossings alone, with the given settings.
    pub judge: bool,
    /// Go on with an identification that is not good enough.
    pub trust: bool,
    /// Fit the gap to OP and PV as well.
    pub fit: bool,
}

impl Default for Task {
    /// A task with nothing known and every question asked.
    fn default() -> Self {
        Self {
            controller: None,
            setpoint_weight: None,
            kp: None,
            integrating: false,
            pv_span: None,
            op_span: None,
            op_percent: None,
            exclusion: None,
            acceptable: None,
            prior: None,
            positioner_dead_band: None,
            tf: None,
            n: DETECTIONS,
            judge: true,
            trust: false,
            fit: true,
        }
    }
}

impl Task {
    /// Refuses what no loop has. The controller, the filter and OP's span are checked where they are used.
    fn check(&self) -> Result<(), ParameterError> {
        let spans = |span: Option<(f64, f64)>| {
            span.filter(|(low, high)| !(high - low).is_normal() || low > high).map(|(low, _)| low)
        };
        let outside = |value: Option<f64>, holds: fn(f64) -> bool| value.filter(|x| !(x.is_finite() && holds(*x)));
        let wrong = [
            ("kp", outside(self.kp, |x| x != 0.0), "a number other than 0"),
            ("setpoint_weight", outside(self.setpoint_weight, |x| (0.0..=1.0).contains(&x)), "0 to 1"),
            ("pv_span", spans(self.pv_span), "a lower end below the upper end"),
            ("acceptable", outside(self.acceptable, |x| x > 0.0 && x <= 100.0), "above 0 %, at most 100 %"),
            ("prior", outside(self.prior, |x| x > 0.0 && x < 1.0), "above 0 and below 1"),
            (
                "positioner_dead_band",
                outside(self.positioner_dead_band, |x| (0.0..=100.0).contains(&x)),
                "0 to 100 % of travel",
            ),
        ];
        let first = wrong.into_iter().find_map(|(name, value, bound)| value.map(|value| (name, value, bound)));
        first.map_or(Ok(()), |(name, value, bound)| Err(ParameterError { name, value, bound }))
    }

    /// Lower and upper end of OP's span, where they are known.
    fn op_limits(&self) -> Option<(f64, f64)> {
        self.op_span.or((self.op_percent != Some(false)).then_some((0.0, 100.0)))
    }

    /// Sign of the process gain: as given, else the controller's (a loop that controls has both alike); 0: not known.
    fn sign(&self, controller: Option<&Controller>) -> f64 {
        let gain = self.kp.or(controller.map(|controller| controller.k)).unwrap_or(0.0);
        if gain == 0.0 { 0.0 } else { gain.signum() }
    }
}

/// The analysis of a recording: made from its beginning, handed all of its rows, and then asked for its answer.
///
/// ```
/// use glapp_analysis::{Analysis, Controller, Inspected, Task};
/// let t: Vec<f64> = (0..2000).map(f64::from).collect();
/// let pv: Vec<f64> = (0..2000).map(|k| if k / 100 % 2 == 0 { -1.0 } else { 1.0 }).collect();
/// let controller = Controller { k: 0.5, ti: 10.0, td: 0.0, b: 1.0 };
/// let task = Task { controller: Some(controller), kp: Some(2.0), tf: Some(0.001), ..Task::default() };
/// let rows = Inspected { t: &t, sp: Some(&[0.0; 2000]), pv: &pv, op: None, flags: None };
/// let mut analysis = Analysis::new(task, &rows, None)?;
/// analysis.take(&rows, None);
/// let done = analysis.finish(&|_| ());
/// assert!((done.answer.d_hat.unwrap() - 4.5).abs() < 0.001);
/// # Ok::<(), glapp_core::ParameterError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Analysis {
    task: Task,
    /// The first rows of the recording.
    beginning: Rows,
    /// Usual time between samples \[s\].
    h: f64,
    identification: Option<Identification>,
    controller: Option<Controller>,
    origins: Origins,
    ladder: Option<Ladder>,
    /// Filter times in it.
    tried: usize,
    counter: Counter,
    windows: Option<Windows>,
    /// Whether any rows had an OP.
    op: bool,
}

/// Sources of the controller's settings.
#[derive(Clone, Copy, Debug)]
struct Origins {
    law: Origin,
    b: Origin,
}

/// Result of an analysis.
#[derive(Debug)]
pub struct Done {
    /// The answer.
    pub answer: AnalysisResult,
    /// The detector whose filter time was taken, with its place in the ladder; none where there was none.
    pub crossings: Option<(usize, Crossings)>,
    /// The fit; none where it was not asked or OP is missing.
    pub fitted: Option<Fitted>,
    /// Whether OP is recorded.
    pub op: bool,
}

impl Analysis {
    /// An analysis that begins with the first rows, [`INSPECTED_ROWS`] or all there are; they are only looked at, and come again to
    /// [`take`](Self::take).
    ///
    /// # Errors
    ///
    /// Where a setting is out of its bounds.
    pub fn new(mut task: Task, beginning: &Inspected<'_>, position: Option<&[f64]>) -> Result<Self, ParameterError> {
        task.check()?;
        let rows = beginning.even();
        task.op_percent = task.op_percent.or(Some(op_unit(None, task.op_span, rows.op) == PERCENT));
        let mut steps: Vec<f64> = rows.t.windows(2).map(|pair| pair[1] - pair[0]).collect();
        steps.retain(|step| step.is_finite() && *step > 0.0);
        let h = if steps.is_empty() { 1.0 } else { median(&mut steps) };
        let found = (task.judge && rows.op.is_some()).then(|| {
            // Settings that are given need only be held against the recording, for which its beginning is enough.
            let looked = if task.controller.is_some() { rows.first(CHECKED_ROWS) } else { rows };
            identified(&looked, task.setpoint_weight, task.op_limits())
        });
        let read = found.as_ref().filter(|_| task.controller.is_none()).and_then(|found| law(found, task.trust));
        let (controller, origins) = match read {
            Some((controller, origins)) => (Some(controller), origins),
            None => (task.controller, Origins { law: Origin::Given, b: Origin::Given }),
        };
        let ladder = match controller.filter(|_| rows.sp.is_some()) {
            Some(Controller { k, ti, td, b }) => {
                let usual = DetectorSettings::new(k, ti, td, h);
                let (kp, tf) = (gain(&task).0, task.tf.unwrap_or(usual.tf));
                let settings = DetectorSettings { b, kp, tf, n: task.n, op_limits: task.op_limits(), ..usual };
                Some(Ladder::new(settings, task.tf.is_some())?)
            }
            None => None,
        };
        let sign = task.sign(controller.as_ref());
        let long = task.judge && task.fit && rows.op.is_some() && rows.t.len() >= LONG_HISTORY;
        Ok(Self {
            counter: Counter::new(DATA_GAP_STEPS * h, task.op_limits())?,
            windows: long.then(|| Windows::of_history(&samples(&rows), sign)),
            beginning: kept(&rows, position),
            task,
            h,
            identification: found,
            controller,
            origins,
            tried: ladder.as_ref().map_or(0, |ladder| ladder.rungs().len()),
            ladder,
            op: false,
        })
    }

    /// Takes the next rows; gives PV as each detector of the ladder filters it, NaN where it does not.
    pub fn take(&mut self, rows: &Inspected<'_>, position: Option<&[f64]>) -> Vec<Vec<f64>> {
        self.take_marked(rows, position, None)
    }

    /// Takes the next rows as [`take`](Self::take) does, with the sum of each row's marks: signals that are no numbers there because
    /// their quality was said to be bad ([`MARKED_PV`](crate::MARKED_PV)).
    pub fn take_marked(
        &mut self,
        rows: &Inspected<'_>,
        position: Option<&[f64]>,
        marks: Option<&[u8]>,
    ) -> Vec<Vec<f64>> {
        let rows = rows.even();
        if self.task.judge {
            self.counter.run_marked(&rows, marks);
        }
        if let Some(windows) = &mut self.windows {
            windows.add(&Batch { samples: samples(&rows), position });
        }
        self.op |= rows.op.is_some();
        let Inspected { t, sp, pv, op, flags } = rows;
        let (Some(ladder), Some(sp)) = (&mut self.ladder, sp) else { return Vec::new() };
        let columns = Columns { t, sp, pv, op, flags };
        ladder.rungs_mut().par_iter_mut().map(|rung| rung.take_closely(columns)).collect()
    }

    /// The problem to fit, for a caller that fits it elsewhere and passes the result to
    /// [`finish_with`](Self::finish_with); none where there is none.
    pub fn problem(&mut self) -> Option<FitProblem<'static>> {
        let quality = self.fits().then(|| self.inspected())?;
        let sign = self.sign(&quality);
        let (batches, _) = self.asked(&quality).ok()?;
        problem(&batches, sign)?.ok()
    }

    /// The answer. `progress` is told the share of what is left, mostly the fit, that is done.
    pub fn finish(self, progress: Tell) -> Done {
        self.ended(None, progress)
    }

    /// The answer, given the fit of its [`problem`](Self::problem) from elsewhere.
    pub fn finish_with(self, pv: Result<JointAnswer, Unfit>) -> Done {
        self.ended(Some(pv), &|_| ())
    }

    /// The result of the analysis, given the fit of PV.
    fn ended(mut self, pv: Option<Result<JointAnswer, Unfit>>, progress: Tell) -> Done {
        let op_limits = self.task.op_limits();
        let mut quality = if self.task.judge { self.inspected() } else { Vec::new() };
        progress(0.0);
        let fitted = self.fits().then(|| self.fitted(&quality, pv, progress));
        let harm = fitted.as_ref().and_then(|fitted| self.harm(fitted));
        let task = &self.task;
        progress(1.0);
        let (mut kp, mut kp_origin) = gain(task);
        let known = task.integrating || kp_origin == Origin::Given;
        if let Some(found) = fitted.as_ref().filter(|_| !known).and_then(|fitted| fitted.answer.gain()) {
            (kp, kp_origin) = (Some(found), Origin::Fitted);
        }
        let ladder = self.ladder.take().map(|ladder| match kp_origin {
            Origin::Fitted => ladder.with_gain(kp).unwrap_or(ladder),
            _ => ladder,
        });
        let crossings = ladder.map(Ladder::chosen);
        let detector = crossings.as_ref().map(|(_, crossings)| crossings);
        if kp_origin == Origin::Assumed
            && let (Some(kp), Some(detector)) = (kp, detector)
        {
            quality.extend(doubt(kp, detector));
        }
        let crossing = Known {
            exclusion: task.exclusion,
            sp: self.beginning.sp.is_some(),
            op: self.identification.is_some(),
            findings: &quality,
        };
        let (verdict, why) = judge(&crossing, detector);
        let estimate = detector
            .and_then(|detector| detector.state().estimate())
            .filter(|_| matches!(verdict, Verdict::Estimate | Verdict::Provisional));
        let d_hat = estimate.map(|estimate| estimate.value);
        let accepted = detector.map_or(0, Crossings::accepted);
        let corrected = detector.filter(|_| accepted > 0).map(|detector| {
            let known = kp.filter(|_| kp_origin != Origin::Assumed);
            self.corrected(detector, known, d_hat)
        });
        let counts = detector.map_or(&[] as &[u64], Crossings::reasons);
        let step_test = self.step_test(op_limits);
        let rejected = Reason::ALL.iter().zip(counts).skip(1).filter(|(_, count)| **count > 0);
        let reasons: Vec<(&'static str, u64)> = rejected.map(|(reason, count)| (reason.name(), *count)).collect();
        let percent_of = |width: f64| op_limits.map(|(low, high)| 100.0 * width / (high - low));
        let mut answer = AnalysisResult {
            version: AnalysisResult::VERSION,
            answer: Summary::of(&Facts::default()),
            crossings: verdict,
            why,
            d_hat,
            d_hat_percent_span: d_hat.and_then(percent_of),
            repeatability: estimate.map(|estimate| (estimate.low, estimate.high)),
            noise_floor: detector.and_then(|detector| detector.state().noise_floor()),
            corrected,
            detections: accepted,
            half_periods: counts.iter().sum(),
            reasons,
            quality,
            controller: self.settings(detector, kp, kp_origin),
            identification: self.identification,
            fit: fitted.as_ref().map(|fitted| fitted.answer.clone()),
            step_test,
            messages: Vec::new(),
        };
        let unanswered = fitted.as_ref().filter(|fitted| fitted.answer.word() == "no_answer");
        let ti = self.controller.map(|controller| controller.ti);
        let enough = unanswered.and_then(|_| rows_to_ask_for(&inspected(&self.beginning), ti));
        let fit_message =
            fitted.as_ref().and_then(|fitted| words::of_fitted(&answer, fitted)).map(|message| match enough {
                Some(enough) => message.with("enough", enough),
                None => message,
            });
        let corrected = answer.corrected.as_ref().and_then(words::of_correction);
        answer.messages = [fit_message, words::of_crossings(&answer), corrected].into_iter().flatten().collect();
        let span = op_limits.map(|(low, high)| high - low);
        answer.answer = Summary::of(&answer.facts(span, [self.task.acceptable, self.task.prior], harm));
        Done { answer, crossings, fitted, op: self.op }
    }

    /// Findings on the recording, gravest first.
    fn inspected(&self) -> Vec<Finding> {
        let known = quality::Known {
            k: self.controller.map(|controller| controller.k),
            ti: self.controller.map(|controller| controller.ti),
            td: self.controller.map(|controller| controller.td),
            law: self.identification.as_ref().map(Law::of),
            kp: self.task.kp,
            pv_span: self.task.pv_span,
            op_span: self.task.op_limits(),
        };
        let mut found = inspect(&inspected(&self.beginning), &self.counter.statistics, &known);
        found.sort_by_key(|finding| Reverse(finding.severity));
        found
    }

    /// Whether the gap is fitted to OP and PV.
    fn fits(&self) -> bool {
        self.task.judge && self.task.fit && self.beginning.op.is_some()
    }

    /// Sign of the process gain, 0 where it is not known: the fit finds it. So it does where settings and recording contradict each other.
    fn sign(&self, quality: &[Finding]) -> f64 {
        let contradicted = quality.iter().any(|found| found.fault == Fault::Sign);
        if contradicted { 0.0 } else { self.task.sign(self.controller.as_ref()) }
    }

    /// The fit, with the known facts: the sign of the process, and the reason that makes any answer wrong. `pv`: where
    /// it was fitted elsewhere.
    fn fitted(&mut self, quality: &[Finding], pv: Option<Result<JointAnswer, Unfit>>, tell: Tell) -> Fitted {
        let sign = self.sign(quality);
        match (self.asked(quality), pv) {
            (Err(why), _) => Fitted::not(why),
            (Ok((batches, sinusoid)), Some(pv)) => fitted_with(&batches, sinusoid, pv),
            (Ok((batches, sinusoid)), None) => fitted(&batches, sign, sinusoid, tell),
        }
    }

    /// Stretch or windows that are fitted, and the place of the finding that the loop swings in a clean sinusoid; why nothing is.
    fn asked(&mut self, quality: &[Finding]) -> Result<(Vec<Batch<'_>>, Option<usize>), FitWhy> {
        let find = |wanted: &dyn Fn(&Finding) -> bool| quality.iter().position(wanted);
        if let Some(exclusion) = self.task.exclusion {
            return Err(FitWhy::Exclusion(exclusion));
        }
        if let Some(i) = find(&|found| found.severity == Severity::Refuse && found.fault != Fault::NotAuto) {
            return Err(FitWhy::Finding(i));
        }
        let batches = match &mut self.windows {
            None => vec![self.beginning.batch()],
            Some(windows) => windows.best().map(Rows::batch).collect(),
        };
        Ok((batches, find(&|found| found.fault == Fault::Sinusoidal)))
    }

    /// The step test in the first rows, where the controller was in manual in some of them; none where it gives no width.
    fn step_test(&self, op_limits: Option<(f64, f64)>) -> Option<StepTest> {
        let flags = self.beginning.flags.as_deref().filter(|_| self.task.judge)?;
        if !flags.iter().any(|flags| u16::from(*flags) & NOT_AUTO != 0) {
            return None;
        }
        let settings = StepTestSettings {
            integrating: self.task.integrating,
            op_span: op_limits.map(|(low, high)| high - low),
            positioner_dead_band: self.task.positioner_dead_band,
            width: None,
        };
        let mut rows = ManualRows::new(Manual::Flagged);
        rows.take(&inspected(&self.beginning), self.beginning.position.as_deref());
        Some(rows.read(&settings)).filter(|test| test.d.is_some())
    }

    /// Effect of the gap on the loop, in the record that shows it best, by its fit to PV.
    fn harm(&mut self, fitted: &Fitted) -> Option<Harm> {
        let joint = fitted.pv.as_ref()?.as_ref().ok()?;
        let process = fitted.answer.process.filter(|_| fitted.answer.verdict.found())?;
        let SegmentAnswer { start, starts, h, answer, .. } = &joint.records[joint.shown];
        let law = self.controller.map(|controller| (controller.k, controller.ti));
        let rows = match &mut self.windows {
            None => &self.beginning,
            Some(windows) => windows.best().find(|rows| rows.t.last().is_some_and(|last| start <= last))?,
        };
        let column = |of: fn(&Prediction) -> f64| answer.predictions.iter().map(of).collect::<Vec<_>>();
        let t: Vec<f64> = answer.predictions.iter().map(|cell| starts[cell.part] + h * cell.step as f64).collect();
        let (pv, position) = (column(|cell| cell.pv), column(|cell| cell.position));
        let cells = HarmCells { t: &t, pv: &pv, position: &position };
        Some(harm(&cells, &inspected(rows), law, &process))
    }

    /// The corrected width by the half-periods of a detector.
    fn corrected(&self, detector: &Crossings, kp: Option<f64>, d_hat: Option<f64>) -> CorrectedAnswer {
        let op = self.beginning.op.as_deref().filter(|_| self.op);
        let travel = if self.op { Travel::Op } else { Travel::Law };
        let beside = Beside { kp, travel, op_noise: op.and_then(noise_sigma), integrating: self.task.integrating };
        let (pairs, found) = detector.corrected(&beside);
        let found = if d_hat.is_some() { found } else { Err(NotCorrected::NoEstimate) };
        CorrectedAnswer::of(found, kp, pairs, travel)
    }

    fn settings(&self, detector: Option<&Crossings>, kp: Option<f64>, kp_origin: Origin) -> Settings {
        let Origins { law, b } = self.origins;
        let mut origins = vec![("k", law), ("ti", law), ("td", law), ("b", b), ("kp", kp_origin)];
        if detector.is_some() {
            origins.push(("tf", if self.task.tf.is_some() { Origin::Given } else { Origin::Chosen }));
            origins.push(("delta_u", Origin::Chosen));
        }
        let controller = self.controller;
        Settings {
            k: controller.map(|c| c.k),
            ti: controller.map(|c| c.ti),
            td: controller.map(|c| c.td),
            setpoint_weight: controller.map(|c| c.b),
            kp_process: kp,
            tf: detector.map(|detector| detector.settings().tf),
            tried: self.tried,
            n: self.task.n,
            max_h: DATA_GAP_STEPS * self.h,
            delta_u: detector.map(|detector| detector.detector().width().source(self.op)),
            origins,
        }
    }
}

/// K, Ti, Td and b as the recording shows them, if they may be used.
fn law(found: &Identification, trust: bool) -> Option<(Controller, Origins)> {
    let values = found.values.filter(|values| values.k != 0.0 && values.ti != 0.0)?;
    if found.reason.is_some() && !trust {
        return None;
    }
    let (td, b) = found.settings.map_or((0.0, None), |settings| (settings.td, settings.setpoint_weight));
    let origins =
        Origins { law: Origin::Identified, b: if b.is_some() { Origin::Identified } else { Origin::Assumed } };
    Some((Controller { k: values.k, ti: values.ti, td, b: b.unwrap_or(1.0) }, origins))
}

/// Kp as far as it is known before the fit.
fn gain(task: &Task) -> (Option<f64>, Origin) {
    let wide = |(low, high): (f64, f64)| high - low;
    process_gain(task.kp, task.pv_span.map(wide).zip(task.op_span.map(wide)), task.integrating)
}

/// Effect of an assumed Kp on the detections.
fn doubt(kp: f64, crossings: &Crossings) -> Option<Finding> {
    let accepted = || crossings.rows().iter().filter(|row| row.record.mask == 0).map(|row| row.record.parts);
    let mut free: Vec<f64> = accepted().map(|parts| parts.free).collect();
    let mut kp_part: Vec<f64> = accepted().map(|parts| parts.kp_part).collect();
    if free.is_empty() {
        return None;
    }
    assumed_gain(kp, median(&mut free), median(&mut kp_part))
}

/// A copy of the rows, for the fit.
fn kept(rows: &Inspected<'_>, position: Option<&[f64]>) -> Rows {
    let owned = |column: Option<&[f64]>| column.map(<[f64]>::to_vec);
    let Inspected { t, sp, pv, op, flags } = *rows;
    let flags = flags.map(<[u8]>::to_vec);
    Rows { t: t.to_vec(), sp: owned(sp), pv: pv.to_vec(), op: owned(op), flags, position: owned(position) }
}

fn inspected(rows: &Rows) -> Inspected<'_> {
    let Rows { t, sp, pv, op, flags, .. } = rows;
    Inspected { t, sp: sp.as_deref(), pv, op: op.as_deref(), flags: flags.as_deref() }
}

fn samples<'a>(rows: &Inspected<'a>) -> Samples<'a> {
    Samples { t: rows.t, sp: rows.sp, pv: rows.pv, op: rows.op, flags: rows.flags }
}
