//! Rows and their times.

use super::Finding;
use super::finding::{Fault, Severity};
use super::look::Look;

/// Fewer rows hold no cycle of any loop.
const FEWEST_ROWS: u64 = 10;
/// Share of steps back beyond which the rows as a whole are in the wrong order; a few newer ones do not hide it.
const NEWEST_FIRST: f64 = 0.9;
/// An hour, by which clocks are set back \[s\], and how near a step back must come to it: a minute, or one sample.
const CLOCK_CHANGE: (f64, f64) = (3600.0, 60.0);
/// Share of repeated times beyond which the times as a whole have lost their seconds; two tags in one column repeat half of them.
const SECONDS_LOST: f64 = 0.5;
/// A step above this share of Ti misses much of a half-period's area; one above Ti itself misses the error.
const COARSE: f64 = 1.0 / 5.0;

/// Finding on too few rows.
pub(super) fn rows(look: &Look<'_>, found: &mut Vec<Finding>) {
    let rows = look.statistics.rows;
    if rows < FEWEST_ROWS {
        found.push(Finding::new(Fault::TooFewRows, Severity::Refuse).with("rows", rows));
    }
}

/// Findings on times that repeat, go back or leave gaps.
pub(super) fn times(look: &Look<'_>, found: &mut Vec<Finding>) {
    let c = look.statistics;
    if c.t_bad > 0 {
        let severity = if c.t_bad + 1 >= c.rows { Severity::Refuse } else { Severity::Warning };
        let finding = Finding::new(Fault::TimeMissing, severity).with("rows", c.t_bad);
        found.push(finding.with("share", look.share(c.t_bad)).telling("of", c.rows));
    }
    if c.reversed.count > 0 {
        let (from, to) = c.reversed_times;
        let back = from - to;
        let (hour, minute) = CLOCK_CHANGE;
        let looks_like = if c.reversed.count as f64 > NEWEST_FIRST * (c.rows as f64 - 1.0) {
            "newest_first"
        } else if (back - hour).abs() <= minute.max(if look.h.is_finite() { look.h } else { 0.0 }) {
            "clock_set_back"
        } else {
            "unsorted"
        };
        found.push(
            Finding::new(Fault::TimeReversed, Severity::Refuse)
                .with("count", c.reversed.count)
                .with("first_row", c.reversed.first)
                .with("from", from)
                .with("to", to)
                .with("back_s", back)
                .telling("of", c.rows)
                .telling("looks_like", looks_like),
        );
    }
    if c.repeated.count > 0 {
        let looks_like = match look.share(c.repeated.count) {
            _ if c.repeated.count + 1 >= c.rows => "stopped",
            share if share > SECONDS_LOST => "seconds_lost",
            _ => "doubles",
        };
        let severity = if looks_like == "doubles" { Severity::Warning } else { Severity::Refuse };
        found.push(
            Finding::new(Fault::TimeRepeated, severity)
                .with("count", c.repeated.count)
                .with("share", look.share(c.repeated.count))
                .with("first_row", c.repeated.first)
                .telling("of", c.rows)
                .telling("looks_like", looks_like),
        );
    }
    if c.gaps.count > 0 {
        found.push(
            Finding::new(Fault::Gaps, Severity::Warning)
                .with("count", c.gaps.count)
                .with("longest_s", c.gap_longest)
                .with("total_s", c.gap_total)
                .with("first_row", c.gaps.first)
                .telling("threshold_s", c.gap),
        );
    }
}

/// Findings on the sample time compared with the loop.
pub(super) fn sampling(look: &Look<'_>, found: &mut Vec<Finding>) {
    let Some(ti) = look.known.ti.filter(|ti| *ti > 0.0 && look.h > ti * COARSE) else { return };
    found.push(
        Finding::new(Fault::Sampling, Severity::Warning)
            .with("h_s", look.h)
            .with("ti_s", ti)
            .with("ratio", look.h / ti)
            .telling("enough_s", ti * COARSE),
    );
}

/// Says how signals that were recorded each at times of its own were brought to common rows.
///
/// `held` names those that keep their last value until the next; `rows` is how many rows came of `pv_rows` values of PV:
/// where there are more, PV lies between its values on a straight line.
pub fn own_times(held: &str, pv_rows: u64, rows: u64) -> Finding {
    Finding::new(Fault::OwnTimes, Severity::Info)
        .with("held", held.to_owned())
        .with("pv_rows", pv_rows)
        .with("rows", rows)
}

/// Finding on a table whose newest row comes first by this column of times, so that its rows are taken from the last to the first.
pub fn newest_first(column: &str) -> Finding {
    Finding::new(Fault::NewestFirst, Severity::Info).with("column", column.to_owned())
}

/// Finding on a given setting that is not used: `sample_time` beside this column of times, or `auto_values` without a column of
/// the mode. `value` is the given one.
pub fn setting_unused(setting: &str, value: &str, column: Option<&str>) -> Finding {
    let finding = Finding::new(Fault::SettingUnused, Severity::Warning);
    let finding = finding.with("setting", setting.to_owned()).with("value", value.to_owned());
    finding.telling("column", column.unwrap_or_default().to_owned())
}

/// Finding on the assumed unit of a time column, where it was not plain.
///
/// `column` and `first` are its name and its first value as it is written, `step` the ordinary step between its numbers,
/// none where they do not step; `calendar` is the format that reads them as days, and `sure` whether they were read so,
/// else as seconds.
pub fn assumed_time(column: &str, first: &str, step: Option<f64>, calendar: &str, sure: bool) -> Finding {
    let finding = Finding::new(Fault::TimeAssumed, if sure { Severity::Info } else { Severity::Warning })
        .with("column", column.to_owned())
        .with("first", first.to_owned())
        .with("step", step.unwrap_or(0.0))
        .with("read_as", if sure { calendar } else { "seconds" }.to_owned());
    finding.telling("calendar", calendar.to_owned())
}
