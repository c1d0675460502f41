//! Texts of the findings on a recording: `quality.` and the name of a finding.

use super::{Numbers, Subject};

pub(super) const SUBJECT: Subject = Subject { name: "quality", sentences: SENTENCES, variants };

macro_rules! begins {
    () => {
        "column '{column}' begins at {first} and {step:steps}: read as "
    };
}
macro_rules! reversed {
    () => {
        "time runs backwards in {count} of {of} rows, first at {first_row:row}, from {from:time} to {to:time}: "
    };
}
macro_rules! repeated {
    () => {
        "{count} of {of} rows repeat the time before them, first {first_row:row}: "
    };
}
macro_rules! own_times {
    () => {
        "each signal has times of its own"
    };
}
macro_rules! alone {
    ($more:literal) => {
        concat!(
            "alone, off those before and after ({rows:rows}",
            $more,
            "): the fit leaves them out, but the controller answers them, so look at the transmitter"
        )
    };
}
macro_rules! shifts {
    ($more:literal) => {
        concat!(
            "PV goes to another level from one row to the next ({rows:rows}",
            $more,
            "), as no process does: a transmitter was recalibrated or the recorder's scale changed; the fit starts again \
             there, the zero crossings do not"
        )
    };
}
macro_rules! winds {
    ($side:literal) => {
        concat!(
            "PV stays {error:size} {pv_unit} ",
            $side,
            " SP for {lasted_s:duration} while OP winds from {op_from:.3g} to {op_to:.3g} {op_unit}, so PV does not answer OP and \
             nothing can be estimated: take a time in which the loop controls"
        )
    };
}
macro_rules! gain {
    ($field:literal) => {
        concat!("{", $field, ":.3g} {op_unit} per {pv_unit}")
    };
}

const SENTENCES: &[(&str, &str)] = sentences! {
    "time_assumed info": begins!(), "{days}; if it counts seconds, write time_format = 'seconds'";
    "time_assumed": begins!(), "seconds; if these are {days}, write time_format = '{calendar}'";
    "own_times joined": own_times!(), ", and OP many more than PV: {held} keep the last value until the next, and \
         {pv_rows} values of PV are joined by straight lines over {rows} rows; record PV as often as OP";
    "own_times": own_times!(), ": the rows are those of PV, and {held} keep the last value until the next";
    "newest_first": "the newest row comes first in column '{column}', so the rows were taken from the last to the first: \
         the numbers of rows below count from the oldest";
    "setting_unused sample_time": "sample_time = {value} is not used, since column '{column}' has the times: leave it \
         out, or, where that column holds no times, say that there is none (--time '', or columns.time = '' in \
         loops.toml)";
    "setting_unused": "{setting} = {value} is not used, since no column is the mode, and rows in manual are taken for \
         rows in automatic: name the column (--mode, or columns.mode in loops.toml)";
    "too_few_rows": "the recording has {rows} rows, too few to tell anything: record for hours";
    "time_missing": "{rows} of {of} rows have no time and are not used: check the time column";
    "time_reversed newest_first": reversed!(), "the newest row comes first, but not throughout; sort the rows by time, the oldest first, or export in UTC if an \
         hour is there twice";
    "time_reversed clock_set_back": reversed!(),
        "the clock seems to have been set back an hour: export in UTC, or name the time zone (--time-zone, time_zone)";
    "time_reversed unsorted": reversed!(), "sort the rows by time, or export in UTC if this is the end of summer time";
    "time_repeated stopped": repeated!(), "every time is the same; check the time column";
    "time_repeated seconds_lost": repeated!(), "the times have lost their seconds, as where a spreadsheet saved them; \
         export them with seconds, or say how far rows are apart (--time '' --sample-time SECONDS, or sample_time in \
         loops.toml with columns.time = '')";
    "time_repeated": repeated!(), "remove the doubles if they are many";
    "gaps": "{count:count gap} longer than {threshold_s:seconds}, {total_s:seconds} in all, the longest \
         {longest_s:seconds}, the first before {first_row:row}; no half-period is taken across one: ask for raw \
         values if they are many";
    "gaps one": "1 gap of {longest_s:seconds}, before {first_row:row}; no half-period is taken across it";
    "not_a_number all": "{signal} has no value in any of {of} rows: check the column or tag";
    "not_a_number": "{signal} has no value in {rows} of {of} rows ({share:share}), first {first_row:row}: each \
         ends a half-period; ask the historian for good values";
    "bad_quality": "the quality of {signal} is not good in {rows} of {of} rows ({share:share}), first \
         {first_row:row}, and these rows are not used: repair the signal, or check which quality codes mean good";
    "span outside": "{signal} goes from {low:.4g} to {high:.4g}, beyond its span of {span_low:.4g} to \
         {span_high:.4g}: check the span and the column, and name numbers that stand for a missing value in \
         bad_values";
    "span fraction": "OP stays between {low:.4g} and {high:.4g}, as a fraction of 1 does and hardly any percentage, so \
         its unit is left open: write op_span = [0, 1] (--op-span 0 1) for a fraction, op_span = [0, 100] \
         (--op-span 0 100) for per cent";
    "span current": "OP stays between {low:.4g} and {high:.4g}, as a current of 4 to 20 mA does, and as a percentage \
         does where the valve is hardly open, so its unit is left open: write op_span = [4, 20] (--op-span 4 20) for \
         mA, op_span = [0, 100] (--op-span 0 100) for per cent";
    "not_auto all": "no row is in auto: zero crossings need auto, the fit of OP and PV also reads rows in manual; if \
         the loop was in auto, check which mode values mean auto";
    "not_auto": "the loop is not in auto in {share:share} of the rows: zero crossings leave them out, the fit of OP and \
         PV reads them too; if the loop was in auto, check which mode values mean auto";
    "at_limit": "OP is at its low limit in {at_low:share} and at its high limit in {at_high:share} of the rows: zero \
         crossings leave them out, the fit of OP and PV reads them too; take a time in which the valve has room to move";
    "no_sp": "SP is not recorded: the gap is fitted from OP and PV, and a step test can be read; zero crossings, \
         the controller's K and Ti and the width that a PLC would show need SP";
    "no_op": "OP is not recorded, so K and Ti must be given, and saturation is seen only through limit flags: add OP";
    "op_constant": "OP stays at {op:.4g} {op_unit} over the whole recording: take a time in which the controller \
         works, or check the OP column";
    "pv_constant": "PV stays at {pv:.4g} {pv_unit} over the whole recording: check the PV column and the transmitter";
    "same_signal": "{signals:and} are the same signal: check which columns or tags were taken";
    "winding_up below": winds!("below");
    "winding_up": winds!("above");
    "cascade_slave": "SP moves at {share:share} of the samples, as in a cascade slave: the method works in a slave, \
         but half-periods in which SP moves more than PV are rejected (5.5); few may be left";
    "sampling slow": "a sample every {h_s:seconds} is slower than Ti {ti_s:seconds}, so the error between the \
         samples is unknown: record at least every {enough_s:seconds}";
    "sampling": "a sample every {h_s:seconds} is coarse against Ti {ti_s:seconds}, so widths are rough: record at \
         least every {enough_s:seconds}";
    "frozen": "in {share:share} of the recording SP, PV and OP all repeat their last value although PV is off SP, \
         so the historian stood still, not the loop: export raw values, or another time";
    "compressed_pv held": "PV repeats its last value in {held:share} of the recording while OP moves on, as a \
         historian's compression leaves it: export uncompressed values";
    "compressed_pv": "{straight:share} of PV's samples lie on exact straight lines, as interpolation between a \
         historian's compressed values leaves them: export raw values";
    "spikes one": "1 sample of PV stands ", alone!("");
    "spikes more": "{count} samples of PV stand ", alone!(" and more");
    "spikes": "{count} samples of PV stand ", alone!("");
    "shifts more": shifts!(" and more");
    "shifts": shifts!("");
    "quantised_pv": "PV comes in steps of {step:.3g} {pv_unit}, {levels} within its range, so small errors and \
         crossings are lost: record with more digits";
    "quantised_op": "OP comes in steps of {step:.3g} {op_unit}, {levels} within its range, so no width below a few \
         steps can be told: record with more digits";
    "sign kp": "the settings say Kp {kp:.3g} {pv_unit} per {op_unit}, and K is ", gain!("k_seen"),
        ": a loop controls only where both have one sign, so the fit finds that of the process by itself; check kp \
         (negative where PV falls as OP rises) and the action";
    "sign": "the settings say K ", gain!("k_given"), " but OP moves as with K ", gain!("k_seen"),
        ", so the fit finds the sign of the process by itself: check the action, direct (K < 0) or reverse (K > 0), or \
         the columns";
    "settings K": "the settings say {parameter} ", gain!("given"), " but OP moves as with ", gain!("seen"),
        " ({low:.3g} to ", gain!("high"), "): check the controller's form and units";
    "settings": "the settings say {parameter} {given:.3g} s but OP moves as with {seen:.3g} s ({low:.3g} to \
         {high:.3g} s): check the controller's form and units";
    "exchanged": "OP and PV seem to be exchanged: PV moves with OP as the output of a PI or PID controller with Ti \
         {ti_s:seconds} does ({r2_exchanged:share} explained), OP with PV as that of none: check which columns were \
         taken (--pv and --op, columns.pv and columns.op)";
    "error_gap": "OP rests while PV is within {gap:.3g} {pv_unit} of SP and moves beyond, so the controller has an \
         error gap, whose cycle looks like backlash: write error_gap in the settings, or record with it set to 0";
    "output_dead_band": "OP rests in {rests:share} of the steps and otherwise jumps by at least {jump:.3g} \
         {op_unit}, so the controller has an output dead band, which adds to the valve's: write output_dead_band in \
         the settings";
    "sinusoidal": "the error is a sine wave of period {period_s:seconds}, as the tuning or a disturbance makes one and \
         no dead band does; a dead band, if there is one, does not show: check the tuning, or look for a disturbance from elsewhere \
         ({spectral_share:share} of its power at one frequency, peak to mean {peak_to_mean:.2f} against 1.57; \
         half-periods of {half_s:seconds}, shorter than 5 Ti, {limit_s:seconds})";
    "kp_assumed": "Kp is not given and taken as 1.5 %/%, that is {kp:size} {pv_unit} per {op_unit}: it takes \
         {kp_part:.3g} {op_unit} off a width of {free:.3g} {op_unit}; give kp";
};

fn variants(code: &str, n: &dyn Numbers) -> Vec<String> {
    let named = n.number("rows").is_none().then(|| n.word("rows").split_whitespace().count() as f64);
    let counts = |wanted: bool, word: &str| if wanted { word.to_string() } else { String::new() };
    let one = match code {
        "time_assumed" => n.word("severity"),
        "gaps" => counts(n.number("count") == Some(1.0), "one"),
        "not_auto" => counts(n.number("share") == Some(1.0), "all"),
        "own_times" => counts(n.number("rows") != n.number("pv_rows"), "joined"),
        "time_reversed" | "time_repeated" | "compressed_pv" | "span" => n.word("looks_like"),
        "not_a_number" => counts(n.number("rows") == n.number("of"), "all"),
        "winding_up" => counts(n.number("error").is_some_and(|error| error > 0.0), "below"),
        "sampling" => counts(n.number("ratio").is_some_and(|ratio| ratio > 1.0), "slow"),
        "spikes" if n.number("count") == Some(1.0) => "one".into(),
        "spikes" | "shifts" => counts(n.number("count") > named, "more"),
        "sign" => counts(n.number("kp").is_some(), "kp"),
        "settings" => n.word("parameter"),
        "setting_unused" => n.word("setting"),
        _ => String::new(),
    };
    vec![one]
}
