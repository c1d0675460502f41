//! Evidence of one record or of several, and what the rules of the ladder say of it.

use crate::data::signal::Unit;
use crate::decide::judgement::{Confidence, Judgement, WidthKind};
use crate::decide::thresholds::*;
use crate::decide::witness::cycle::Cycle;
use crate::decide::witness::plateau::Plateau;
use serde::{Deserialize, Serialize};

/// Reason why a gap may be hidden.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Hidden {
    /// The process settles in too few samples.
    Samples,
    /// The process lags by more than the record is long.
    Lag,
    /// The load changes as often as OP goes through the gap.
    Changes,
}

impl Hidden {
    /// The word for it.
    fn name(self) -> &'static str {
        match self {
            Self::Samples => "hidden_by_samples",
            Self::Lag => "hidden_by_lag",
            Self::Changes => "hidden_by_changes",
        }
    }
}

/// Evidence of the judgement. It says enough to judge again without a fit.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Evidence {
    pub(crate) autocorrelation: f64,
    pub(crate) d: f64,
    /// Cells of the record; of several, of the clearest.
    #[serde(default)]
    pub(crate) cells: usize,
    /// Likelihood ratio of no gap.
    pub(crate) lr_no_gap: f64,
    pub(crate) lr_needed: f64,
    pub(crate) lr_no_answer: f64,
    pub(crate) low: f64,
    pub(crate) high: Option<f64>,
    pub(crate) range: f64,
    /// Whether the valve of the best model hardly moves.
    pub(crate) immobile: bool,
    /// Whether OP went through the width one way only.
    pub(crate) one_way: bool,
    /// Whether the samples are too far apart for the process, and for how fast OP goes through the gap or for a jump in it.
    pub(crate) coarse: bool,
    /// Whether the process settles within a sample, so that a load that ramps leaves PV as a gap does.
    pub(crate) at_once: bool,
    /// Width below which PV's noise hides the effect of a gap.
    pub(crate) noisy_below: f64,
    /// How far the model is to be believed where d matters, as where the valve turns: 1 where PV strays from it no further than elsewhere.
    /// See [`information_ratio`](crate::search::profile::information_ratio).
    #[serde(default = "full")]
    pub(crate) information_ratio: f64,
    /// Whether a slip jump shows, and whether it may be all of the width.
    pub(crate) slips: bool,
    pub(crate) slips_wholly: bool,
    /// Whether a load that repeats itself leaves the gap less than others do.
    pub(crate) periodic_load: bool,
    /// Whether OP swings to and fro in almost even time, though no gap makes this process do that.
    pub(crate) even_swing: bool,
    /// Width that makes too little of PV for how coarsely the lines bend that PV is recorded as.
    pub(crate) lined_below: f64,
    /// Width through which OP may shake the valve between two samples.
    pub(crate) unsampled_below: f64,
    /// Whether a family that predicts nearly as well as the best sees a gap.
    pub(crate) dissent: bool,
    /// Why a PV that answers each turn of OP is no evidence of a sound valve, where it is none.
    pub(crate) hidden: Option<Hidden>,
    /// Times that OP goes through the most likely width, up and down.
    pub(crate) passes: [usize; 2],
    /// Passes through the upper limit of a valve in which no gap is seen.
    pub(crate) passes_high: [usize; 2],
    /// Whether OP swings to and fro in almost even time.
    pub(crate) oscillates: bool,
    /// Swing of the fitted loop without a load; None where there is nothing to compare with.
    pub(crate) cycle: Option<Cycle>,
    /// Response of PV to OP within the gap.
    pub(crate) plateau: Plateau,
    /// Standard deviation of Kp·OP as a fraction of that of PV: far above 1 where the load of the model undoes the
    /// valve's effect. 0 behind an integrator.
    pub(crate) cancels: f64,
    /// Upper limit of the lags by the likelihood of all believed models, a ratio to the lags of the best.
    pub(crate) lag_up_to: f64,
    /// Records whose own width is that of all, and records.
    pub(crate) agree: [usize; 2],
    /// Ratio of the records' differences to their intervals, 1 where the intervals allow them.
    pub(crate) dispersion: f64,
    /// Windows of one recording in which a gap shows, of those in `agree`; None where that does not matter.
    pub(crate) shows: Option<usize>,
}

/// Information ratio where none was stored.
fn full() -> f64 {
    1.0
}

impl Evidence {
    /// Whether noise may hide a gap of the most likely width.
    pub(super) fn noisy(&self) -> bool {
        self.d < self.noisy_below
    }

    /// Likelihood ratio of no gap that any gap must exceed: more for an even swing. Some loads that swing, triangles above
    /// all, look like a gap whose cycle is the loop's own.
    pub(super) fn asked(&self) -> f64 {
        self.lr_needed.max(if self.even_swing { LR_IF_EVEN_SWING } else { 0.0 })
    }

    /// The ratio that a found gap must exceed: more unless its lower limit is near. A load that bends looks like a gap of another width
    /// each time, a gap has one width.
    pub(crate) fn needed(&self) -> f64 {
        self.asked().max(self.least_ratio())
    }

    /// The least ratio with which a gap is told, by how sharp its width is.
    pub(super) fn least_ratio(&self) -> f64 {
        if self.low_is_near() { LR_MIN } else { LR_MIN.max(LR_EACH_CELL * self.cells as f64) }
    }

    /// Whether the rows are too far apart for the process.
    pub fn is_coarse(&self) -> bool {
        self.coarse || self.at_once
    }

    /// Whether the loop of fitted process, gap and controller swings by itself as it was recorded.
    pub fn cycles(&self) -> bool {
        self.cycle.as_ref().is_some_and(Cycle::is_own)
    }

    /// Whether OP swings, or the load repeats itself, as the loop of process, gap and controller does by itself, and the gap explains clearly
    /// more than any load: of some loads that swing the fitted loop makes the same period and swing.
    pub(super) fn own_swing(&self) -> bool {
        let clear = self.lr_no_gap > self.lr_needed.max(LR_IF_CLEAR) && self.low_is_near();
        self.cycles() && self.swings() && self.crossed_twice() && clear && self.veto().is_none()
    }

    /// Whether PV moves against OP while OP crosses the gap, where the ratio alone does not tell the gap from a load that swings. The load
    /// moves PV and the controller moves OP, to which the valve does not answer; a valve that answers takes PV along with OP.
    pub(super) fn opposed(&self) -> bool {
        let open = (LR_IF_SELDOM..=self.needed()).contains(&self.lr_no_gap);
        self.is_led_by_a_swing() && open && self.low_is_near() && self.veto().is_none()
    }

    /// Whether a load that swings moves PV against OP within the most likely width: what looks like an answer of the valve may be the
    /// load's next swing, however narrow that width is.
    pub(super) fn is_led_by_a_swing(&self) -> bool {
        let against = self.plateau.ways.iter().all(|n| *n >= CYCLES) && self.plateau.within < OPPOSED;
        against && self.swings()
    }

    /// Whether the lower limit is no small part of the width.
    pub(super) fn low_is_near(&self) -> bool {
        self.low > NEAR_LOW * self.d
    }

    /// Whether OP went through the width both ways as often as a gap that is plain needs.
    pub(super) fn crossed_twice(&self) -> bool {
        self.passes.iter().all(|n| *n >= CYCLES_IF_CLEAR)
    }

    /// Whether a load that swings would look like this gap.
    pub(super) fn swings(&self) -> bool {
        self.even_swing || self.periodic_load
    }

    /// Kind of the width of a gap.
    pub(super) fn width_kind(&self) -> WidthKind {
        let differ = self.low < LEAST_LOW * self.d || self.dispersion > DISAGREE;
        match () {
            // What a load adds to the swing, or undoes of the valve's effect, is taken for width.
            _ if self.coarse_alone() || differ || self.opposed() || self.cancels > CANCELS => WidthKind::Unsure,
            _ if self.high.is_none() => WidthKind::Bound,
            _ => WidthKind::Interval,
        }
    }

    /// Both limits for display; `high`: the upper one with what the samples may hide.
    pub(crate) fn limits(&self, judgement: &Judgement, high: Option<f64>) -> (f64, Option<f64>) {
        match (judgement.confidence, judgement.width_kind) {
            (Confidence::Found, Some(WidthKind::Bound)) => (self.low / LOW_OFF, None),
            (Confidence::NoneSeen, _) => (0.0, high.map(|high| high.max(self.unsampled_below))),
            (Confidence::Found | Confidence::Likely, _) => (self.low / LOW_OFF, high.map(|high| high * HIGH_OFF)),
            _ => (self.low, high.map(|high| high.max(self.unsampled_below))),
        }
    }

    /// Converts where OP's unit was `op`.
    pub(crate) fn in_units(&mut self, op: Unit) {
        let widths = [
            &mut self.d,
            &mut self.low,
            &mut self.range,
            &mut self.noisy_below,
            &mut self.lined_below,
            &mut self.unsampled_below,
        ];
        widths.into_iter().for_each(|width| *width *= op.size);
        self.high = self.high.map(|high| high * op.size);
    }

    /// Judgement on a valve whose gap is narrower than `below`.
    ///
    /// A record earns it: OP turns through the limit, the model's load does not undo what its valve does, and the lags are known.
    fn none(&self, below: f64) -> Option<(Confidence, &'static str)> {
        let high = self.high.filter(|high| *high < below)?;
        let silent = |why| Some((Confidence::CannotTell, why));
        match self.hidden {
            _ if high < self.lined_below => silent("lined"),
            _ if self.is_led_by_a_swing() => silent("repeats"),
            _ if self.unsampled_below >= SOUND_BELOW * self.range => silent("may_be_a_gap"),
            Some(hidden) => silent(hidden.name()),
            _ if self.passes_high.iter().any(|n| *n < CYCLES_IF_CLEAR) => silent("may_be_a_gap"),
            _ if self.cancels > CANCELS => silent("cancelled"),
            _ if !self.lags_known() || self.information_ratio < INFORMATION_RATIO_IF_SOUND => silent("may_be_a_gap"),
            None => Some((Confidence::NoneSeen, "no_gap")),
        }
    }

    /// Whether the lags are known well enough for a verdict of no gap. One swing tells of one frequency, and few turns tell
    /// little: the lags hang together with the gap there.
    fn lags_known(&self) -> bool {
        let few = self.passes_high.iter().any(|n| *n < CYCLES);
        self.lag_up_to <= if self.oscillates || few { LAG_UP_TO_IF_FEW } else { LAG_UP_TO }
    }

    /// Reason why no gap is found although the likelihood ratio speaks for one: something else looks like it.
    pub(super) fn veto(&self) -> Option<&'static str> {
        let vetoes = [
            (self.immobile, "still"),
            (self.coarse_alone(), "coarse"),
            (self.d < self.lined_below, "lined"),
            (self.one_way, "once"),
            (self.cancels > CANCELS, "cancelled"),
            (self.low < LEAST_LOW * self.d, "families_disagree"),
        ];
        vetoes.into_iter().find(|(holds, _)| *holds).map(|(_, why)| why)
    }

    /// Whether the rows are too far apart, and no windows or recordings agree in spite of that.
    fn coarse_alone(&self) -> bool {
        self.is_coarse() && !self.all_agree()
    }

    /// Whether every window or recording has by itself the width that all share: how far apart its rows are does not matter then. A load
    /// that ramps leaves PV as a gap does, and gives another width each time.
    fn all_agree(&self) -> bool {
        let [agree, all] = self.agree;
        agree >= FEWEST_RECORDINGS && agree == all
    }

    /// Whether enough records have by themselves the width that all share: what each of them could not say, all say together.
    pub(crate) fn agrees(&self) -> bool {
        let [agree, all] = self.agree;
        agree >= FEWEST_RECORDINGS && agree as f64 >= AGREE * all as f64
    }
}

/// Judgement by the rules before the evidence is weighed, and a code of the reason why it says no more: a gap is
/// *likely* here only where the loop swings with it by itself, or PV moves against OP within it.
pub(super) fn rules(e: &Evidence) -> (Confidence, &'static str) {
    let (together, why) = rules_together(e);
    let tells = matches!(together, Confidence::Found | Confidence::Likely);
    // Records that agree make likely what each alone cannot say.
    let likely = if tells && e.agrees() { Confidence::Likely } else { Confidence::CannotTell };
    let windows = e.shows.is_some();
    let too_few = e.shows.is_some_and(|shows| (shows as f64) < WINDOWS_THAT_SHOW * e.agree[1] as f64);
    if e.dispersion > DISAGREE {
        (likely, if windows { "windows_disagree" } else { "recordings_disagree" })
    } else if tells && too_few {
        (likely, "windows_silent")
    } else {
        (together, why)
    }
}

/// Judgement by the rules as if all were one record.
fn rules_together(e: &Evidence) -> (Confidence, &'static str) {
    if e.autocorrelation.abs() > MAX_AUTOCORRELATION {
        return (Confidence::CannotTell, "misfit");
    }
    if e.lr_no_answer < LR_MIN {
        return (Confidence::CannotTell, "no_answer");
    }
    if e.lr_no_gap <= e.needed() {
        let vague = e.lr_no_gap > e.asked();
        let seen = e.dissent || e.lr_no_gap > LR_SEEN;
        let none = if e.low <= 0.0 && !seen && !vague { e.none(SOUND_BELOW * e.range) } else { None };
        let why = match () {
            _ if vague => e.veto().unwrap_or("may_be_a_gap"),
            _ if e.opposed() => "opposed",
            _ if e.periodic_load || e.is_led_by_a_swing() => "repeats",
            _ if e.cancels > CANCELS => "cancelled",
            _ if e.even_swing => "swings",
            _ => "may_be_a_gap",
        };
        let rung = if e.own_swing() || e.opposed() { Confidence::Likely } else { Confidence::CannotTell };
        return none.unwrap_or((rung, why));
    }
    if let Some(none) = e.none(TRIFLE * e.range) {
        return none;
    }
    if let Some(why) = e.veto() {
        return (Confidence::CannotTell, why);
    }
    let why = match () {
        _ if e.high.is_none() => "no_upper_limit",
        _ if e.slips && e.slips_wholly => "jumps",
        _ if e.slips => "jumps_in_a_gap",
        _ if e.information_ratio < MISFIT_AT_TURNS => "gap_and_more",
        _ => "gap",
    };
    (Confidence::Found, why)
}

/// Reason why a gap may be hidden, for a process that settles in so many steps and lags by so many, in a record of
/// `steps` in which OP went through a width so often and so many steps or bends of the load are marked.
pub(crate) fn hidden(settles: f64, lag: f64, steps: f64, [up, down]: [usize; 2], marks: usize) -> Option<Hidden> {
    if settles < SAMPLES_IN_LAG_IF_SOUND {
        Some(Hidden::Samples)
    } else if lag > steps {
        Some(Hidden::Lag)
    } else if marks >= up + down {
        Some(Hidden::Changes)
    } else {
        None
    }
}

/// Likelihood ratio of no gap that OP's traversals of a width demand.
pub(crate) fn lr_asked([up, down]: [usize; 2]) -> f64 {
    if up.min(down) >= CYCLES { lr_asked_of_passes([up, down]).max(LR_MIN) } else { LR_IF_SELDOM }
}

/// Likelihood ratio demanded where each pass adds a little.
pub(crate) fn lr_asked_of_passes([up, down]: [usize; 2]) -> f64 {
    LR_EACH_PASS * (up + down) as f64
}

/// Likelihood ratio demanded by marked steps and bends of the load where there are as many of them as traversals of OP,
/// else 0: they lie where they suit the best width, and make the others look worse than they are.
pub(crate) fn lr_asked_of_changes([up, down]: [usize; 2], marks: usize) -> f64 {
    if marks < up + down { 0.0 } else { LR_EACH_CHANGE * marks as f64 }
}
