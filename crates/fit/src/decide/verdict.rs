//! The verdict, from the evidence of one record or of several.

use crate::data::signal::Unit;
use crate::decide::judgement::{Cause, Confidence, Judgement, WidthKind};
use crate::decide::thresholds::*;
use crate::decide::weigh::{USUAL_PRIOR, probability};
use crate::decide::witness::cycle::Cycle;
use crate::decide::witness::plateau::Plateau;
use serde::{Deserialize, Serialize};

/// Verdict of the record on the valve.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Verdict {
    /// A gap.
    Backlash,
    /// A valve that sticks and jumps, no gap beside it.
    Stiction,
    /// Backlash and stiction.
    Both,
    /// No gap wider than the upper limit.
    Sound,
    /// A gap, wider than the lower limit; OP never went through the whole of it often enough.
    AtLeast,
    /// The record cannot tell.
    CannotTell,
}

impl Verdict {
    /// Whether it says that there is a gap, or a valve that sticks.
    pub fn claims(self) -> bool {
        !matches!(self, Self::Sound | Self::CannotTell)
    }
}

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
    /// Likelihood ratio of no gap.
    pub(crate) lr_no_gap: f64,
    pub(crate) lr_needed: f64,
    pub(crate) lr_no_answer: f64,
    pub(crate) low: f64,
    pub(crate) high: Option<f64>,
    pub(crate) range: f64,
    /// Whether the valve of the best model hardly moves.
    pub(crate) immobile: bool,
    /// Whether OP went through the lower limit often enough for a width.
    pub(crate) traversed: bool,
    /// Whether OP went through the width one way only.
    pub(crate) one_way: bool,
    /// Whether the samples are too far apart for the process, and for how fast OP goes through the gap or for a jump in it.
    pub(crate) coarse: bool,
    /// Whether the process settles within a sample, so that a load that ramps leaves PV as a gap does.
    pub(crate) at_once: bool,
    /// Width below which PV's noise hides the effect of a gap.
    pub(crate) noisy_below: f64,
    /// Whether PV strays from the model where d matters, as where the valve turns.
    pub(crate) misfit_at_turns: bool,
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
    /// Response of PV within the gap and behind it.
    pub(crate) plateau: Plateau,
    /// Standard deviation of Kp·OP as a fraction of that of PV: far above 1 where the load of the model undoes the
    /// valve's effect. 0 behind an integrator.
    pub(crate) cancels: f64,
    /// Standard error of the lags, part of them.
    pub(crate) lag_error: f64,
    /// Records whose own width is that of all, and records.
    pub(crate) agree: [usize; 2],
    /// Ratio of the records' differences to their intervals, 1 where the intervals allow them.
    pub(crate) dispersion: f64,
    /// Windows of one recording in which a gap shows, of those in `agree`; None where that does not matter.
    pub(crate) shows: Option<usize>,
}

impl Evidence {
    /// Judgement on the valve, and a code of the reason why it says no more.
    pub fn judged(&self) -> (Judgement, &'static str) {
        judge(self)
    }

    /// Whether noise may hide a gap of the most likely width.
    fn noisy(&self) -> bool {
        self.d < self.noisy_below
    }

    /// Whether only a bound is given, whatever the likelihood ratio is.
    fn bound(&self) -> bool {
        self.high.is_none() || !self.traversed || self.noisy()
    }

    /// Likelihood ratio of no gap that a found gap must exceed: more for an even swing. Some loads that swing, triangles above
    /// all, look like a gap whose cycle is the loop's own.
    pub(crate) fn needed(&self) -> f64 {
        self.lr_needed.max(if self.even_swing { LR_IF_EVEN_SWING } else { 0.0 })
    }

    /// Whether the loop of fitted process, gap and controller swings by itself as it was recorded.
    pub fn cycles(&self) -> bool {
        self.cycle.as_ref().is_some_and(Cycle::is_own)
    }

    /// Whether OP swings, or the load repeats itself, as the loop of process, gap and controller does by itself, and the gap explains clearly
    /// more than any load: of some loads that swing the fitted loop makes the same period and swing.
    fn own_swing(&self) -> bool {
        let clear = self.lr_no_gap > self.lr_needed.max(LR_IF_CLEAR) && self.low_is_near();
        self.cycles() && self.swings() && self.crossed_twice() && clear && self.veto().is_none()
    }

    /// Whether the lower limit is no small part of the width.
    fn low_is_near(&self) -> bool {
        self.low > NEAR_LOW * self.d
    }

    /// Whether OP went through the width both ways as often as a gap that is plain needs.
    fn crossed_twice(&self) -> bool {
        self.passes.iter().all(|n| *n >= CYCLES_IF_CLEAR)
    }

    /// Whether a load that swings would look like this gap.
    fn swings(&self) -> bool {
        self.even_swing || self.periodic_load
    }

    /// Whether the weighed evidence may make a gap likely that the rules do not find: the ratio exceeds what any gap needs, the valve moves in
    /// the model, OP goes through the width both ways, and PV is not stored as lines that bend as much. Where a load that swings would look
    /// like the gap, its width is known, and an even swing asks for more.
    fn may_be_likely(&self) -> bool {
        let shows = !self.immobile && !self.one_way && self.d >= self.lined_below;
        let sided = !self.swings() || self.width_kind() != WidthKind::Unsure;
        let asked = if self.even_swing { LR_IF_EVEN_SWING } else { LR_MIN };
        self.lr_no_gap > asked && self.low > 0.0 && shows && sided
    }

    /// Whether nothing stands between the record and the width: OP goes through it twice each way, samples and noise show it, no load that
    /// swings looks like it, and its lower limit is near.
    fn is_plain(&self) -> bool {
        let clear = self.width_kind() != WidthKind::Unsure && !self.noisy() && !self.swings();
        self.crossed_twice() && clear && self.low_is_near()
    }

    /// Whether a window shows a gap by itself: it is told there, or nothing looks like it, and its ratio is no small part of what is needed, of
    /// which what the model lacks brings a little in every window.
    pub(crate) fn shows_alone(&self) -> bool {
        let shows = judge(self).0.tells() || self.crossed_twice() && self.veto().is_none() && !self.swings();
        shows && (self.cycles() || self.lr_no_gap > LR_MIN.max(WINDOW_SHOWS * self.needed()))
    }

    /// Kind of the width of a gap.
    fn width_kind(&self) -> WidthKind {
        let coarse = (self.coarse || self.at_once) && !self.all_agree();
        match () {
            _ if coarse || self.low < LEAST_LOW * self.d || self.dispersion > DISAGREE => WidthKind::Unsure,
            _ if self.bound() => WidthKind::Bound,
            _ => WidthKind::Interval,
        }
    }

    /// The probability of a gap by which the rungs are decided: where as many valves have one as usual. 0 where the record cannot be read.
    fn usual_probability(&self) -> f64 {
        self.weighed().map_or(0.0, |(factor, _)| probability(factor, USUAL_PRIOR))
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
            _ if self.unsampled_below >= SOUND_BELOW * self.range => silent("may_be_a_gap"),
            Some(hidden) => silent(hidden.name()),
            _ if self.passes_high.iter().any(|n| *n < CYCLES_IF_CLEAR) => silent("may_be_a_gap"),
            _ if self.cancels > CANCELS_IF_SOUND || self.lag_error > self.lag_may_err() => silent("may_be_a_gap"),
            None => Some((Confidence::NoneSeen, "no_gap")),
        }
    }

    /// Allowed relative error of the lags for a verdict of no gap. One swing tells of one frequency, and few turns tell
    /// little: the lags hang together with the gap there.
    fn lag_may_err(&self) -> f64 {
        let few = self.passes_high.iter().any(|n| *n < CYCLES);
        if self.oscillates || few { LAG_KNOWN_IF_FEW } else { 1.0 }
    }

    /// Reason why no gap is found although the likelihood ratio speaks for one: something else looks like it.
    fn veto(&self) -> Option<&'static str> {
        let vetoes = [
            (self.immobile, "still"),
            ((self.coarse || self.at_once) && !self.all_agree(), "coarse"),
            (self.d < self.lined_below, "lined"),
            (self.one_way, "once"),
            (self.cancels > CANCELS, "cancelled"),
            (self.low < LEAST_LOW * self.d, "families_disagree"),
        ];
        vetoes.into_iter().find(|(holds, _)| *holds).map(|(_, why)| why)
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

    /// Cause of a gap, by the slip jump.
    fn cause(&self) -> Cause {
        match (self.slips, self.slips_wholly) {
            (false, _) => Cause::DeadBand,
            (true, true) => Cause::Stiction,
            (true, false) => Cause::Both,
        }
    }
}

/// Judgement on the valve, and a code of the reason why it says no more.
///
/// The [`rules`] say which gap may be found, and which valve shows none. All evidence, weighed, must then make a gap more probable than
/// [`PROBABLE`]: what the rules find is *found*, what they call likely or leave open is *likely*. Where the record is plain it is enough for
/// *likely* that the evidence speaks for a gap at all.
pub(crate) fn judge(e: &Evidence) -> (Judgement, &'static str) {
    let (by_rules, why) = rules(e);
    let p = e.usual_probability();
    let least = if e.is_plain() { USUAL_PRIOR } else { PROBABLE };
    let gap = |confidence| {
        let (cause, width_kind) = (Some(e.cause()), Some(e.width_kind()));
        Judgement { confidence, cause, width_kind, oscillates: e.oscillates }
    };
    let silent = Judgement::without(Confidence::CannotTell, e.oscillates);
    match by_rules {
        Confidence::NoneSeen => (Judgement::without(by_rules, e.oscillates), why),
        Confidence::Found | Confidence::Likely if p >= PROBABLE => (gap(by_rules), why),
        Confidence::Found | Confidence::Likely if p >= USUAL_PRIOR && e.own_swing() => (gap(Confidence::Likely), why),
        Confidence::Found | Confidence::Likely => (silent, "outweighed"),
        Confidence::CannotTell if p >= least && e.may_be_likely() => (gap(Confidence::Likely), why),
        Confidence::CannotTell => (silent, why),
    }
}

/// Judgement by the rules before the evidence is weighed, and a code of the reason why it says no more: a gap is
/// *likely* here only where the loop swings with it by itself.
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
    if e.lr_no_answer < ANSWERS {
        return (Confidence::CannotTell, "no_answer");
    }
    if e.lr_no_gap <= e.needed() {
        let none = if e.low <= 0.0 && !e.dissent { e.none(SOUND_BELOW * e.range) } else { None };
        let why = match () {
            _ if e.periodic_load => "repeats",
            _ if e.even_swing => "swings",
            _ => "may_be_a_gap",
        };
        let rung = if e.own_swing() { Confidence::Likely } else { Confidence::CannotTell };
        return none.unwrap_or((rung, why));
    }
    if let Some(none) = e.none(TRIFLE * e.range) {
        return none;
    }
    if let Some(why) = e.veto() {
        return (Confidence::CannotTell, why);
    }
    let why = match () {
        _ if e.high.is_none() || !e.traversed => "not_traversed",
        _ if e.noisy() => "noisy",
        _ if e.slips && e.slips_wholly => "jumps",
        _ if e.slips => "jumps_in_a_gap",
        _ if e.misfit_at_turns => "gap_and_more",
        _ => "gap",
    };
    (Confidence::Found, why)
}

/// Whether OP went often enough through the lower limit and the most likely width for a width with two limits.
pub(crate) fn often(lr_no_gap: f64, low: [usize; 2], d: [usize; 2]) -> bool {
    let least = if lr_no_gap > LR_IF_CLEAR { CYCLES_IF_CLEAR } else { CYCLES };
    // At the most likely width the count may be one too many.
    low.iter().all(|n| *n >= least) && d.iter().all(|n| *n > least)
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

#[cfg(test)]
mod tests {
    use super::*;

    /// A plain gap of 1 in a range of 10.
    fn plain() -> Evidence {
        Evidence {
            autocorrelation: 0.0,
            d: 1.0,
            lr_no_gap: 200.0,
            lr_needed: 15.0,
            lr_no_answer: 1e3,
            low: 0.9,
            high: Some(1.1),
            range: 10.0,
            immobile: false,
            traversed: true,
            one_way: false,
            coarse: false,
            at_once: false,
            noisy_below: 0.0,
            misfit_at_turns: false,
            slips: false,
            slips_wholly: false,
            periodic_load: false,
            even_swing: false,
            lined_below: 0.0,
            unsampled_below: 0.0,
            dissent: false,
            hidden: None,
            passes: [10; 2],
            passes_high: [10; 2],
            oscillates: false,
            cycle: None,
            plateau: Plateau::default(),
            cancels: 2.0,
            lag_error: 0.1,
            agree: [1; 2],
            dispersion: 1.0,
            shows: None,
        }
    }

    fn verdict(e: &Evidence) -> Verdict {
        judge(e).0.verdict(e.low)
    }

    #[test]
    fn a_gap_far_below_what_op_moves_is_none() {
        assert_eq!(verdict(&plain()), Verdict::Backlash);
        let narrow = Evidence { range: 111.0, ..plain() };
        assert_eq!(verdict(&narrow), Verdict::Sound);
        assert_eq!(narrow.limits(&judge(&narrow).0, Some(1.1)), (0.0, Some(1.1)));
        assert_eq!(verdict(&Evidence { high: None, ..narrow }), Verdict::AtLeast);
    }

    #[test]
    fn no_valve_is_sound_below_what_op_may_shake_it_through() {
        let sound = Evidence { d: 0.0, lr_no_gap: 0.0, low: 0.0, unsampled_below: 1.5, ..plain() };
        assert_eq!(verdict(&sound), Verdict::Sound);
        assert_eq!(sound.limits(&judge(&sound).0, Some(1.1)), (0.0, Some(1.5)));
        let unsampled = Evidence { unsampled_below: 2.5, ..sound };
        assert_eq!((verdict(&unsampled), judge(&unsampled).1), (Verdict::CannotTell, "may_be_a_gap"));
    }

    fn said(e: &Evidence) -> (Confidence, Option<WidthKind>) {
        let told = judge(e).0;
        (told.confidence, told.width_kind)
    }

    #[test]
    fn less_than_what_is_found_is_likely() {
        let of = |lr_no_gap| Evidence { lr_no_gap, lr_needed: 60.0, ..plain() };
        assert_eq!(said(&of(61.0)), (Confidence::Found, Some(WidthKind::Interval)));
        assert_eq!(said(&of(59.0)), (Confidence::Likely, Some(WidthKind::Interval)));
        assert_eq!(verdict(&of(59.0)), Verdict::CannotTell);
        assert_eq!(said(&of(LR_MIN)), (Confidence::CannotTell, None));
        // A record that looks like a gap for another reason is not likely either.
        assert_eq!(said(&Evidence { immobile: true, ..of(59.0) }), (Confidence::CannotTell, None));
        assert_eq!(said(&Evidence { low: 0.1, ..of(61.0) }), (Confidence::Likely, Some(WidthKind::Unsure)));
    }

    #[test]
    fn in_a_plain_record_any_evidence_for_a_gap_makes_it_likely() {
        // OP went through it twice each way, and a load of which nothing is known may do that.
        let twice = Evidence { passes: [2; 2], lr_no_gap: 30.0, lr_needed: LR_IF_SELDOM, ..plain() };
        let weak = Evidence { noisy_below: 0.3, range: 4.0, ..twice };
        let p = weak.usual_probability();
        assert!(USUAL_PRIOR < p && p < PROBABLE, "{p}");
        assert_eq!(said(&weak), (Confidence::Likely, Some(WidthKind::Interval)));
        for hidden in [
            Evidence { even_swing: true, ..weak.clone() },
            Evidence { coarse: true, ..weak.clone() },
            Evidence { noisy_below: 1.1, ..weak.clone() },
            Evidence { low: 0.5 * NEAR_LOW, ..weak.clone() },
            Evidence { passes: [2, 1], ..weak.clone() },
        ] {
            assert!(!hidden.is_plain());
            assert_eq!(said(&hidden), (Confidence::CannotTell, None));
        }
    }

    #[test]
    fn the_limits_of_what_is_told_are_moved_out() {
        let likely = Evidence { lr_no_gap: 59.0, lr_needed: 60.0, ..plain() };
        let of_four = Evidence { agree: [4, 4], ..plain() };
        for told in [likely, of_four, plain()] {
            let (low, high) = told.limits(&judge(&told).0, Some(1.1));
            assert!((low - 0.9 / LOW_OFF).abs() < 1e-12 && (high.unwrap() - 1.1 * HIGH_OFF).abs() < 1e-12);
        }
        let silent = Evidence { lr_no_gap: LR_MIN, low: 0.0, ..plain() };
        assert_eq!(silent.limits(&judge(&silent).0, Some(1.1)), (0.0, Some(1.1)));
    }

    #[test]
    fn what_speaks_against_a_gap_outweighs_a_ratio() {
        // The gap would take nearly all of OP's range, OP went through it twice, and PV follows OP within it.
        let against = Plateau { ways: [2; 2], within: 1.0, rows: 20.0, ..Plateau::default() };
        let wide = Evidence { d: 9.9, low: 9.8, high: Some(10.0), lr_no_gap: 16.0, ..plain() };
        let doubtful = Evidence { plateau: against, noisy_below: 9.0, passes: [5; 2], cancels: 20.0, ..wide };
        assert_eq!(rules(&doubtful).0, Confidence::Found);
        assert!(doubtful.usual_probability() < PROBABLE, "{}", doubtful.usual_probability());
        assert_eq!((said(&doubtful), judge(&doubtful).1), ((Confidence::CannotTell, None), "outweighed"));
    }

    #[test]
    fn a_swing_is_a_gaps_where_it_is_the_loops_own() {
        let swings = Evidence { even_swing: true, oscillates: true, periodic_load: true, lr_no_gap: 10.0, ..plain() };
        assert_eq!((verdict(&swings), judge(&swings).1), (Verdict::CannotTell, "repeats"));
        let plain_swings = Evidence { even_swing: true, oscillates: true, ..plain() };
        let of = |lr_no_gap| said(&Evidence { lr_no_gap, ..plain_swings.clone() }).0;
        assert_eq!((of(LR_IF_EVEN_SWING), of(501.0)), (Confidence::CannotTell, Confidence::Found));
        assert_eq!(swings.needed(), LR_IF_EVEN_SWING);
        let own = Evidence { cycle: Some(Cycle { period: 1.05, swing: 0.98, law: 0.99 }), ..swings };
        let beside = |lr_no_gap| judge(&Evidence { lr_no_gap, ..own.clone() }).0;
        let clear = beside(LR_IF_CLEAR + 1.0);
        assert_eq!((clear.confidence, clear.oscillates), (Confidence::Likely, true));
        assert_eq!(judge(&Evidence { lr_no_gap: 200.0, low: 0.4, ..own.clone() }).0.confidence, Confidence::CannotTell);
        // A saw may make the fitted loop swing as it was recorded, but no gap is clearly likelier.
        assert_eq!(beside(LR_IF_CLEAR).confidence, Confidence::CannotTell);
        // For a load that repeats itself no width is shared by all families.
        let unsure = Evidence { periodic_load: true, lr_no_gap: 600.0, low: 0.1, ..plain() };
        assert_eq!(judge(&unsure).0.confidence, Confidence::CannotTell);
        assert_eq!(said(&Evidence { periodic_load: false, ..unsure }), (Confidence::Likely, Some(WidthKind::Unsure)));
    }

    #[test]
    fn rows_far_apart_leave_the_width_unsure() {
        let coarse = Evidence { coarse: true, ..plain() };
        assert_eq!((said(&coarse), judge(&coarse).1), ((Confidence::Likely, Some(WidthKind::Unsure)), "coarse"));
        // A PV that stands within the gap and windows that agree make it more probable.
        let stands = Plateau { ways: [8; 2], within: -0.5, rows: 20.0, ..Plateau::default() };
        assert!(Evidence { plateau: stands, ..coarse.clone() }.usual_probability() > coarse.usual_probability());
        assert!(Evidence { agree: [4, 4], ..coarse.clone() }.usual_probability() > coarse.usual_probability());
        assert_eq!(said(&Evidence { agree: [4, 4], ..coarse }), (Confidence::Found, Some(WidthKind::Interval)));
    }

    #[test]
    fn windows_that_differ_leave_the_width_unsure() {
        let differ = Evidence { dispersion: 2.0 * DISAGREE, agree: [1, 4], shows: Some(4), lr_no_gap: 10.0, ..plain() };
        assert_eq!((judge(&differ).0.confidence, judge(&differ).1), (Confidence::CannotTell, "windows_disagree"));
        let plain_ratio = Evidence { lr_no_gap: 200.0, ..differ };
        let kept = Evidence { agree: [3, 4], ..plain_ratio.clone() };
        assert_eq!((said(&kept), judge(&kept).1), ((Confidence::Likely, Some(WidthKind::Unsure)), "windows_disagree"));
        assert_eq!(judge(&Evidence { shows: None, ..plain_ratio }).1, "recordings_disagree");
        let quiet = Evidence { agree: [3, 4], shows: Some(1), ..plain() };
        assert_eq!((judge(&quiet).0.confidence, judge(&quiet).1), (Confidence::Likely, "windows_silent"));
        assert_eq!(judge(&Evidence { shows: Some(2), ..quiet }).0.confidence, Confidence::Found);
        let of = |part: f64| Evidence { lr_no_gap: part * 100.0, lr_needed: 100.0, ..plain() };
        assert_eq!([of(0.4), of(0.6)].map(|e| said(&e).0), [Confidence::Likely; 2]);
        assert_eq!([of(0.4), of(0.6)].map(|e| e.shows_alone()), [false, true]);
    }

    #[test]
    fn none_seen_is_earned() {
        let none = Evidence { d: 0.0, lr_no_gap: 0.0, low: 0.0, ..plain() };
        let said = |e: Evidence| judge(&e).0.confidence;
        assert_eq!(said(none.clone()), Confidence::NoneSeen);
        assert_eq!(said(Evidence { passes_high: [10, 1], ..none.clone() }), Confidence::CannotTell);
        assert_eq!(said(Evidence { passes_high: [10, 4], ..none.clone() }), Confidence::NoneSeen);
        assert_eq!(said(Evidence { passes_high: [10, 4], lag_error: 0.3, ..none.clone() }), Confidence::CannotTell);
        assert_eq!(said(Evidence { cancels: CANCELS_IF_SOUND, ..none.clone() }), Confidence::NoneSeen);
        assert_eq!(said(Evidence { cancels: CANCELS_IF_SOUND + 1.0, ..none.clone() }), Confidence::CannotTell);
        assert_eq!(said(Evidence { lag_error: 1.5, ..none.clone() }), Confidence::CannotTell);
        assert_eq!(said(Evidence { lag_error: 0.3, ..none.clone() }), Confidence::NoneSeen);
        assert_eq!(said(Evidence { lag_error: 0.3, oscillates: true, ..none }), Confidence::CannotTell);
    }

    #[test]
    fn a_load_that_undoes_the_valve_may_be_the_gap() {
        let undone = Evidence { cancels: CANCELS + 1.0, ..plain() };
        assert_eq!(rules(&undone), (Confidence::CannotTell, "cancelled"));
        assert_ne!(judge(&undone).0.confidence, Confidence::Found);
    }

    #[test]
    fn each_passage_asks_for_more_and_so_do_few() {
        assert_eq!(plain().needed(), 15.0);
        assert_eq!(lr_asked([10, 10]), LR_MIN);
        assert_eq!(lr_asked([100, 100]), 200.0 * LR_EACH_PASS);
        assert_eq!(lr_asked([100, CYCLES - 1]), LR_IF_SELDOM);
    }
}
