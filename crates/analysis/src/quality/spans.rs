//! Signals against their spans.

use super::Finding;
use super::finding::{Fault, Severity};
use super::look::Look;

/// Share of the span by which a signal may leave it: a transmitter may read 106 % before it is broken (NAMUR NE 43).
const OUTSIDE: f64 = 0.1;

/// Scales of OP that are taken for per cent by mistake.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Scale {
    /// 0 to 1.
    Fraction,
    /// 4 to 20 mA.
    Current,
}

impl Scale {
    /// The scale that OP's values fit: none of them beyond its ends. A valve works in the lowest hundredth of its
    /// travel hardly ever; between 4 and 20 % of it some do.
    fn of(op: &[f64]) -> Option<Self> {
        let numbers = op.iter().filter(|u| u.is_finite());
        let (low, high) =
            numbers.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), u| (low.min(*u), high.max(*u)));
        Self::between(low, high)
    }

    fn between(low: f64, high: f64) -> Option<Self> {
        if low >= high {
            return None; // one value, or none, shows no scale
        }
        [Self::Fraction, Self::Current].into_iter().find(|scale| scale.span().0 <= low && high <= scale.span().1)
    }

    fn span(self) -> (f64, f64) {
        match self {
            Self::Fraction => (0.0, 1.0),
            Self::Current => (4.0, 20.0),
        }
    }
}

/// Unit of OP where it is a percentage.
pub const PERCENT: &str = "%";

/// Name of OP's unit where nobody knows it.
const UNKNOWN: &str = "OP unit";

/// Unit of OP: as it is stated, else per cent where its span is 0 to 100, or where it has no span and no value of `op` says
/// otherwise.
///
/// A value outside 0 to 100 says so, and so does a recording that stays within a fraction of 1 or within a current of
/// 4 to 20 mA. Between 4 and 20 OP may as well be a percentage, of a valve that is hardly open: a width in per cent of span
/// would be 6 times too small for a current, so a person must state which it is. A spreadsheet shows a fraction of 1 as a
/// percentage, so that the sign % alone does not make 0.57 one.
///
/// ```
/// use glapp_analysis::quality::op_unit;
/// assert_eq!(op_unit(None, None, Some(&[35.0, 48.0])), "%");
/// assert_eq!(op_unit(None, None, Some(&[12.0, f64::NAN, 13.5])), "OP unit");
/// assert_eq!(op_unit(None, None, Some(&[12.0, 21.0])), "%");
/// assert_eq!(op_unit(Some("%"), None, Some(&[12.0, 13.5])), "%");
/// assert_eq!(op_unit(Some("%"), None, Some(&[0.55, 0.57])), "OP unit");
/// assert_eq!(op_unit(None, Some((4.0, 20.0)), Some(&[12.0, 13.5])), "OP unit");
/// ```
pub fn op_unit<'a>(stated: Option<&'a str>, span: Option<(f64, f64)>, op: Option<&[f64]>) -> &'a str {
    let op = op.unwrap_or_default();
    let percent = || !op.iter().any(|u| *u < 0.0 || *u > 100.0) && Scale::of(op).is_none();
    match (stated, span) {
        (Some(PERCENT), None) if Scale::of(op) == Some(Scale::Fraction) => UNKNOWN,
        (Some(unit), _) => unit,
        (None, Some((0.0, 100.0))) => PERCENT,
        (None, None) if percent() => PERCENT,
        (None, _) => UNKNOWN,
    }
}

/// Findings on signals beyond their spans.
pub(super) fn spans(look: &Look<'_>, found: &mut Vec<Finding>) {
    let (c, known) = (look.statistics, look.known);
    let mut tell = |severity, signal: &'static str, range: (f64, f64), span: (f64, f64), is: &'static str| {
        let finding =
            Finding::new(Fault::Span, severity).with("signal", signal).with("low", range.0).with("high", range.1);
        found.push(finding.with("span_low", span.0).with("span_high", span.1).with("looks_like", is));
    };
    for (signal, values, span) in [("PV", c.pv, known.pv_span), ("OP", c.op, known.op_span)] {
        let Some((low, high)) = span else { continue };
        let room = OUTSIDE * (high - low);
        if values.low <= values.high && (values.low < low - room || values.high > high + room) {
            let all = values.low > high + room || values.high < low - room;
            let severity = if all { Severity::Refuse } else { Severity::Warning };
            tell(severity, signal, (values.low, values.high), (low, high), "outside");
        }
    }
    // A given span of OP is contradicted only by a fraction: many valves use between 4 and 20 % of their travel.
    let percent = known.op_span == Some((0.0, 100.0));
    match Scale::between(c.op.low, c.op.high) {
        Some(scale @ Scale::Fraction) if percent || known.op_span.is_none() => {
            tell(Severity::Warning, "OP", (c.op.low, c.op.high), scale.span(), "fraction");
        }
        Some(scale @ Scale::Current) if known.op_span.is_none() => {
            tell(Severity::Warning, "OP", (c.op.low, c.op.high), scale.span(), "current");
        }
        _ => (),
    }
}
