//! Texts on a rejected half-period: a label, its meaning, and the remedy if it is the usual reason.

use super::{Subject, plain};

pub(super) const LABEL: Subject = Subject { name: "half_period", sentences: LABELS, variants: plain };
pub(super) const MEANING: Subject = Subject { name: "half_period_meaning", sentences: MEANINGS, variants: plain };
pub(super) const REMEDY: Subject = Subject { name: "half_period_remedy", sentences: REMEDIES, variants: plain };

const LABELS: &[(&str, &str)] = sentences! {
    "accepted": "accepted";
    "gap": "start or gap";
    "bad_quality": "bad quality";
    "not_auto": "not in auto";
    "saturated": "OP at a limit";
    "too_short": "too short";
    "not_square": "not square";
    "uneven": "uneven";
    "sp_moved": "SP moved";
    "too_small": "too small";
};

const MEANINGS: &[(&str, &str)] = sentences! {
    "accepted": "passed every test and gave one detection of the dead band";
    "gap": "its beginning was not recorded: it is the first one, or samples are missing before or in it";
    "bad_quality": "a sample is missing or marked bad";
    "not_auto": "the controller was not in automatic for all of it";
    "saturated": "the output was at a limit, so the integral does not tell how far the valve moved";
    "too_short": "the swing is too fast for this method: Δt is not longer than 5·TI";
    "not_square":
        "e_max is not below 2·Δy (5.2): the error is peaked or noisy, where a dead band gives a near-square shape";
    "uneven": "Δy differs too much from that of the half-period before it (5.4)";
    "sp_moved": "the setpoint moved by more than Δy (5.5)";
    "too_small": "Δt is below the bound (5.1): the deviation is small compared with what the estimate so far would give";
};

const REMEDIES: &[(&str, &str)] = sentences! {
    "accepted": "";
    "gap": "Record without interruptions, with compression and exception reporting switched off.";
    "bad_quality": "Look at the transmitter and at how bad values are archived.";
    "not_auto": "Record the loop while it runs in automatic. If this is a step test, glapp step-test reads it.";
    "saturated": "Record at a load where the valve is away from its limits.";
    "too_short":
        "Nothing to measure here. If it oscillates, check tuning and load. Only a step test can judge the valve.";
    "not_square": "A sine wave points to the tuning or to a load that oscillates rather than to the valve.";
    "uneven": "The load changes, or the two sides of the cycle differ. Record for longer, and while the load is calm.";
    "sp_moved": "Record at a fixed setpoint. For a cascade slave, put the master in manual while recording.";
    "too_small": "Mostly noise around the setpoint. A longer recording may hold clearer half-periods.";
};
