//! Signals against their spans.

use super::Finding;
use super::finding::{Fault, Severity};
use super::look::Look;

/// Share of the span by which a signal may leave it: a transmitter may read 106 % before it is broken (NAMUR NE 43).
const OUTSIDE: f64 = 0.1;

/// Scales of OP that are taken for per cent by mistake.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scale {
    /// 0 to 1.
    Fraction,
    /// 4 to 20 mA.
    Current,
}

impl Scale {
    /// The scale that OP's values fit: none of them beyond its ends. A valve works in the lowest hundredth of its
    /// travel hardly ever; between 4 and 20 % of it some do.
    ///
    /// ```
    /// use glapp_analysis::quality::Scale;
    /// assert_eq!(Scale::of(&[0.55, 0.6]), Some(Scale::Fraction));
    /// assert_eq!(Scale::of(&[12.0, f64::NAN, 13.5]), Some(Scale::Current));
    /// assert_eq!(Scale::of(&[12.0, 21.0]), None);
    /// ```
    pub fn of(op: &[f64]) -> Option<Self> {
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
