//! The verdict, from the evidence of one record or of several.

use crate::decide::thresholds::*;
use serde::{Deserialize, Serialize};

/// What the record says about the valve.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Verdict {
    /// A gap.
    Backlash,
    /// A valve that sticks and jumps, no gap beside it.
    Stiction,
    /// Both.
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

/// What may hide a gap.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(crate) enum Hidden {
    /// The process settles in too few samples.
    Samples,
    /// It lags by more than the record is long.
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

/// What the verdict rests on.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Evidence {
    pub(crate) echo: f64,
    pub(crate) d: f64,
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
    /// Whether a load was found that steps or bends.
    pub(crate) changes_known: bool,
    /// Whether OP went through the width one way only.
    pub(crate) one_way: bool,
    /// Whether the samples are too far apart for the process, and for how fast OP goes through the gap or for a jump in it.
    pub(crate) coarse: bool,
    /// Whether the process settles within a sample, so that a load that ramps leaves PV as a gap does.
    pub(crate) at_once: bool,
    /// Width below which PV's noise hides what a gap makes.
    pub(crate) noisy_below: f64,
    /// Whether PV strays from the model where d matters, as where the valve turns.
    pub(crate) strays: bool,
    /// Whether a slip jump shows, and whether it may be all of the width.
    pub(crate) slips: bool,
    pub(crate) slips_wholly: bool,
    /// Whether a load that repeats itself leaves the gap less than others do.
    pub(crate) periodic_load: bool,
    /// Whether OP swings to and fro in almost even time, though no gap makes this process do that.
    pub(crate) even_swing: bool,
    /// Width that makes too little of PV for how coarsely the lines bend that PV is recorded as.
    pub(crate) drawn: f64,
    /// Width through which OP may shake the valve between two samples.
    pub(crate) shaken: f64,
    /// Whether a family that predicts nearly as well as the best sees a gap.
    pub(crate) dissent: bool,
    /// Why a PV that answers each turn of OP is no evidence of a sound valve, where it is none.
    pub(crate) hidden: Option<Hidden>,
}

impl Evidence {
    fn noisy(&self) -> bool {
        self.d < self.noisy_below
    }

    /// What the likelihood ratio of no gap must exceed: more for a bound.
    pub(crate) fn needed(&self) -> f64 {
        let bound = self.high.is_none() || !self.traversed || self.noisy();
        if bound { self.lr_needed.max(lr_asked_if_seldom(self.changes_known)) } else { self.lr_needed }
    }

    /// Both limits as they are told; `high`: the upper one with what the samples may hide.
    pub(crate) fn limits(&self, verdict: Verdict, high: Option<f64>) -> (f64, Option<f64>) {
        match verdict {
            Verdict::AtLeast => (self.low, None),
            Verdict::Sound => (0.0, high.map(|high| high.max(self.shaken))),
            _ => (self.low, high),
        }
    }

    /// What is said of a valve whose gap is narrower than `below`.
    fn sound(&self, below: f64) -> Option<(Verdict, &'static str)> {
        let high = self.high.filter(|high| *high < below)?;
        Some(match self.hidden {
            _ if high < self.drawn => (Verdict::CannotTell, "lined"),
            _ if self.shaken >= SOUND_BELOW * self.range => (Verdict::CannotTell, "may_be_a_gap"),
            Some(hidden) => (Verdict::CannotTell, hidden.name()),
            None => (Verdict::Sound, "no_gap"),
        })
    }
}

pub(crate) fn judge(e: &Evidence) -> (Verdict, &'static str) {
    if e.echo.abs() > ECHO {
        return (Verdict::CannotTell, "misfit");
    }
    if e.lr_no_answer < ANSWERS {
        return (Verdict::CannotTell, "no_answer");
    }
    if e.lr_no_gap <= e.needed() {
        if e.periodic_load {
            return (Verdict::CannotTell, "repeats");
        }
        let may_be = (Verdict::CannotTell, "may_be_a_gap");
        return if e.low <= 0.0 && !e.dissent { e.sound(SOUND_BELOW * e.range).unwrap_or(may_be) } else { may_be };
    }
    if let Some(sound) = e.sound(TRIFLE * e.range) {
        return sound;
    }
    if e.low < LEAST_LOW * e.d {
        return (Verdict::CannotTell, "families_disagree");
    }
    if e.immobile {
        return (Verdict::CannotTell, "still");
    }
    if e.coarse || e.at_once {
        return (Verdict::CannotTell, "coarse");
    }
    if e.even_swing {
        return (Verdict::CannotTell, "swings");
    }
    if e.d < e.drawn {
        return (Verdict::CannotTell, "lined");
    }
    if e.one_way {
        return (Verdict::CannotTell, "once");
    }
    if e.high.is_none() || !e.traversed {
        return (Verdict::AtLeast, "not_traversed");
    }
    if e.noisy() {
        return (Verdict::AtLeast, "noisy");
    }
    if e.slips {
        return match e.slips_wholly {
            true => (Verdict::Stiction, "jumps"),
            false => (Verdict::Both, "jumps_in_a_gap"),
        };
    }
    (Verdict::Backlash, if e.strays { "gap_and_more" } else { "gap" })
}

/// Whether OP went often enough through the lower limit and the most likely width for a width with two limits.
pub(crate) fn often(lr_no_gap: f64, low: [usize; 2], d: [usize; 2]) -> bool {
    let least = if lr_no_gap > GAP_IF_CLEAR { CYCLES_IF_CLEAR } else { CYCLES };
    // At the most likely width the count may be one too many.
    low.iter().all(|n| *n >= least) && d.iter().all(|n| *n > least)
}

/// What may hide a gap from a process that settles in so many steps and lags by so many, in a record of `steps` in which OP went through
/// the most likely width so often and so many steps or bends of the load are marked.
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

/// What OP's way through a width asks of the likelihood ratio of no gap; `known`: where a load was found that steps or bends.
pub(crate) fn lr_asked([up, down]: [usize; 2], known: bool) -> f64 {
    if up.min(down) >= CYCLES { lr_asked_of_passes([up, down]).max(GAP) } else { lr_asked_if_seldom(known) }
}

/// What they ask of it all together.
pub(crate) fn lr_asked_of_passes([up, down]: [usize; 2]) -> f64 {
    GAP_EACH_PASS * (up + down) as f64
}

/// The same where OP went through it too seldom.
fn lr_asked_if_seldom(known: bool) -> f64 {
    if known { GAP_IF_SELDOM } else { GAP_IF_SELDOM_AND_LOAD_UNKNOWN }
}

/// What steps and bends of the load ask of it that were marked where there are as many of them as OP went through the width, else
/// 0: they lie where they suit the best width, and make the others look worse than they are.
pub(crate) fn lr_asked_of_changes([up, down]: [usize; 2], marks: usize) -> f64 {
    if marks < up + down { 0.0 } else { GAP_EACH_CHANGE * marks as f64 }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A plain gap of 1 in a range of 10.
    fn plain() -> Evidence {
        Evidence {
            echo: 0.0,
            d: 1.0,
            lr_no_gap: 200.0,
            lr_needed: 15.0,
            lr_no_answer: 1e3,
            low: 0.9,
            high: Some(1.1),
            range: 10.0,
            immobile: false,
            traversed: true,
            changes_known: false,
            one_way: false,
            coarse: false,
            at_once: false,
            noisy_below: 0.0,
            strays: false,
            slips: false,
            slips_wholly: false,
            periodic_load: false,
            even_swing: false,
            drawn: 0.0,
            shaken: 0.0,
            dissent: false,
            hidden: None,
        }
    }

    #[test]
    fn a_gap_far_below_what_op_moves_is_none() {
        assert_eq!(judge(&plain()).0, Verdict::Backlash);
        let narrow = Evidence { range: 111.0, ..plain() };
        assert_eq!(judge(&narrow).0, Verdict::Sound);
        assert_eq!(narrow.limits(Verdict::Sound, Some(1.1)), (0.0, Some(1.1)));
        assert_eq!(judge(&Evidence { high: None, ..narrow }).0, Verdict::AtLeast);
    }

    #[test]
    fn no_valve_is_sound_below_what_op_may_shake_it_through() {
        let sound = Evidence { d: 0.0, lr_no_gap: 0.0, low: 0.0, shaken: 1.5, ..plain() };
        assert_eq!(judge(&sound).0, Verdict::Sound);
        assert_eq!(sound.limits(Verdict::Sound, Some(1.1)), (0.0, Some(1.5)));
        assert_eq!(judge(&Evidence { shaken: 2.5, ..sound }), (Verdict::CannotTell, "may_be_a_gap"));
    }

    #[test]
    fn a_bound_asks_for_more_and_so_does_each_passage() {
        assert_eq!(plain().needed(), 15.0);
        assert_eq!(Evidence { noisy_below: 1.1, ..plain() }.needed(), GAP_IF_SELDOM_AND_LOAD_UNKNOWN);
        assert_eq!(lr_asked([10, 10], false), GAP);
        assert_eq!(lr_asked([100, 100], false), 200.0 * GAP_EACH_PASS);
        assert_eq!(lr_asked([100, CYCLES - 1], true), GAP_IF_SELDOM);
    }
}
