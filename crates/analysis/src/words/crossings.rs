//! Why the zero crossings say no more, and where the detector must not be used.

use super::{Numbers, Subject};

pub(super) const SUBJECT: Subject = Subject { name: "crossings", sentences: SENTENCES, variants };

macro_rules! gain_too_low {
    ($why:literal) => {
        concat!("Δy/Kp is larger than OP's travel: ", $why, ", check kp and the span of PV")
    };
}

const SENTENCES: &[(&str, &str)] = sentences! {
    "no_sp": "SP is not recorded, and half-periods begin where PV crosses it: name its column (--sp, columns.sp)";
    "no_law": "K and Ti are not given, and without an OP column they cannot be identified: name the column (--op, \
         columns.op), or give the controller";
    "not_identified": "K and Ti are not given and could not be identified: {reason}";
    "never_crossed": "PV never crossed SP, so there is no half-period to read a gap from";
    "nothing_accepted": "none of {total} half-periods was accepted: {causes:list}";
    "cause": "{count} as {label}";
    "coarse": "the accepted half-periods have {samples:.0f} samples (median), and 10 are needed: between them the \
         error is unknown. Record faster";
    "disagree": "the detections do not agree: {kept} of the last {count} lie within 20 % of their median";
    "gain_too_low": gain_too_low!("Kp is set too low");
    "gain_too_low assumed": gain_too_low!("the assumed Kp of 1.5 %/% does not fit");
    "noise": "the detections give {d:op}, below the noise limit of {floor:op}";
    "few": "{detections} of the {n} detections that an estimate needs";
    "place primary": "primary loop of a cascade: its OP is a setpoint, not a valve signal; analyse {partner} instead";
    "place split_range": "split range: OP works on several valves, and a width of OP belongs to none of them";
    "place shared_valve": "the valve is shared with {partner}: this OP does not move it all the time";
};

fn variants(code: &str, n: &dyn Numbers) -> Vec<String> {
    vec![match code {
        "gain_too_low" => n.word("kp_origin"),
        "place" => n.word("place"),
        _ => String::new(),
    }]
}
