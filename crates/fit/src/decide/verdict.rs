//! The verdict, from the evidence of one record or of several.

use crate::decide::thresholds::*;

/// What the record says about the valve.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
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

/// What the verdict rests on.
#[derive(Clone, Debug)]
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
    /// Whether PV's noise hides what the gap makes.
    pub(crate) noisy: bool,
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
    /// Whether a family that predicts nearly as well as the best sees a gap.
    pub(crate) dissent: bool,
    /// Why a PV that answers each turn of OP is no evidence of a sound valve, where it is none.
    pub(crate) hidden: Option<&'static str>,
}

impl Evidence {
    /// What the likelihood ratio of no gap must exceed: more for a bound.
    pub(crate) fn needed(&self) -> f64 {
        let bound = self.high.is_none() || !self.traversed || self.noisy;
        if bound { self.lr_needed.max(lr_asked_if_seldom(self.changes_known)) } else { self.lr_needed }
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
        return match e.high {
            Some(high) if e.low <= 0.0 && high < SOUND_BELOW * e.range && !e.dissent => match e.hidden {
                _ if high < e.drawn => (Verdict::CannotTell, "lined"),
                Some(why) => (Verdict::CannotTell, why),
                None => (Verdict::Sound, "no_gap"),
            },
            _ => (Verdict::CannotTell, "may_be_a_gap"),
        };
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
    if e.noisy {
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
pub(crate) fn hidden(settles: f64, lag: f64, steps: f64, [up, down]: [usize; 2], marks: usize) -> Option<&'static str> {
    if settles < SAMPLES_IN_LAG_IF_SOUND {
        Some("hidden_by_samples")
    } else if lag > steps {
        Some("hidden_by_lag")
    } else if marks >= up + down {
        Some("hidden_by_changes")
    } else {
        None
    }
}

/// What OP's way through a width asks of the likelihood ratio of no gap; `known`: where a load was found that steps or bends.
pub(crate) fn lr_asked([up, down]: [usize; 2], known: bool) -> f64 {
    if up.min(down) >= CYCLES { GAP } else { lr_asked_if_seldom(known) }
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
