//! Result of the fit as messages.

use super::{Message, Value};
use crate::FitVerdict;
use crate::trend::DAY;
use glapp_fit::{PositionAnswer, Recorder, SegmentAnswer, SegmentFit, Together, Trend, Unfit};

fn times(n: impl TryInto<i64>) -> Value {
    Value::Count(n.try_into().unwrap_or(i64::MAX))
}

/// Message of the fit to PV: `whole` of all records, `best` the one that shows it. `shared`: of several recordings that
/// share a width.
pub fn of_pv(whole: &Together, best: &SegmentAnswer<SegmentFit>, shared: bool) -> Message {
    let (h, best) = (best.h, &best.answer);
    Message::new(format!("fit.{}", FitVerdict::from(whole.verdict).name()))
        .with("reason", whole.reason)
        .with("shared", Value::Flag(shared))
        .with("d", whole.d)
        .with("low", whole.low)
        .with("high", whole.high)
        .with("lr_no_gap", whole.lr_no_gap)
        .with("lr_needed", whole.lr_needed)
        .with("dispersion", whole.dispersion)
        .with("up", times(whole.traversals[0]))
        .with("down", times(whole.traversals[1]))
        .with("jump", best.jump)
        .with("lr_no_jump", best.lr_no_jump)
        .with("lr_no_answer", best.lr_no_answer)
        .with("echo", best.autocorrelation)
        .with("h", h)
        .with("apart", whole.evidence.is_coarse().then_some(h))
        .with("settles", best.settles)
        .with("lag", best.lag)
        .with("load_steps", times(best.load_steps))
}

/// Message of the fit to the valve's position.
pub fn of_position(joint: &PositionAnswer) -> Message {
    let best = &joint.records[joint.shown].answer;
    let (recorder, step) = match best.recorder {
        Recorder::Plain => ("plain", 0.0),
        Recorder::Rounded(step) => ("rounded", step),
        Recorder::Kept(band) => ("kept", band),
    };
    Message::new(format!("position.{}", FitVerdict::from(joint.verdict).name()))
        .with("reason", best.reason)
        .with("d", joint.d)
        .with("low", joint.low)
        .with("high", joint.high)
        .with("jump", best.jump)
        .with("lr_no_gap", best.lr_no_gap)
        .with("lr_needed", best.lr_needed)
        .with("explained", best.explained.max(0.0))
        .with("up", times(best.traversals[0]))
        .with("down", times(best.traversals[1]))
        .with("recorder", recorder)
        .with("step", step)
}

/// Why nothing was fitted to a signal.
pub fn of_unfit(why: Unfit, signal: &'static str) -> Message {
    Message::new(format!("unfit.{}", why.name())).with("number", why.number()).with("signal", signal)
}

/// A change of the width that is plain; none where it is not.
pub fn of_trend(trend: &Trend) -> Option<Message> {
    let ((from, to), (first, last)) = (trend.d, trend.t);
    let (week, error) = (7.0 * DAY * trend.slope.abs(), 7.0 * DAY * trend.half_interval());
    let code = if trend.slope > 0.0 { "trend.grows" } else { "trend.shrinks" };
    trend.changes().then(|| {
        Message::new(code)
            .with("from", from)
            .with("to", to)
            .with("days", (last - first) / DAY)
            .with("week", week)
            .with("week_low", week - error)
            .with("week_high", week + error)
    })
}
