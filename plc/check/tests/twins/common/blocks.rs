//! Every block once as the core has it and once as the library has it, with the inputs and outputs of its vectors.
#![allow(dead_code, missing_docs)]

use super::{Block, Case, Number, Scan};
use glapp_core::status::{AT_HIGH, AT_LOW, BAD, DATA_GAP, NOT_AUTO};
use glapp_core::{
    Conditions, HalfPeriod, HalfPeriodResult, HalfPeriodState, MedianMean, MedianMeanState, NoiseLevel, Reason,
    SafetyNet, SecondOrderFilter, SecondOrderFilterState, Width, WidthParts, ZeroCrossing,
};

pub const BLOCKS: [&str; 7] =
    ["filter", "zero_crossing", "noise_level", "half_period", "width", "safety_net", "median_mean"];

pub const FLAGS: [(&str, u16); 5] =
    [("NotAuto", NOT_AUTO), ("Bad", BAD), ("AtLow", AT_LOW), ("AtHigh", AT_HIGH), ("Gap", DATA_GAP)];

const PARTS: [&str; 7] = ["DeltaU", "DeltaUD", "DeltaUSp", "OpTravel", "Free", "KpPart", "D"];

pub fn maybe(x: f64) -> Option<f64> {
    Some(x).filter(|x| !x.is_nan())
}

/// The name of a pin: `op_span` is `OpSpan`.
pub fn pascal(name: &str) -> String {
    name.split('_').map(|part| part[..1].to_uppercase() + &part[1..]).collect()
}

fn parts_of<R: Number>(parts: &WidthParts<R>) -> Vec<f64> {
    [parts.delta_u, parts.delta_u_d, parts.delta_u_sp, parts.op_travel, parts.free, parts.kp_part, parts.d]
        .map(R::as_f64)
        .to_vec()
}

fn width_of<R: Number>(case: &Case) -> Width<R> {
    let of = |name| case.param(name).map(R::of);
    let b = of("b").unwrap_or(R::ONE);
    Width::new(R::of(case.given("k")), R::of(case.given("ti")), of("td"), b, of("kp")).unwrap()
}

fn set_flags(block: &Block, within: &str, mask: f64) {
    for (name, flag) in FLAGS {
        block.set(&format!("{within}{name}"), f64::from(u8::from(mask as u16 & flag != 0)));
    }
}

fn flags(block: &Block, within: &str) -> f64 {
    FLAGS.iter().map(|(name, flag)| block.get(&format!("{within}{name}")) * f64::from(*flag)).sum()
}

pub fn core<R: Number>(block: &str, case: &Case) -> Scan {
    let r = R::of;
    match block {
        "filter" => {
            let filter = SecondOrderFilter::new(r(case.given("tf"))).unwrap();
            let mut state = SecondOrderFilterState::default();
            Box::new(move |x, h| Some(vec![filter.update(&mut state, r(x[0]), r(h)).as_f64()]))
        }
        "zero_crossing" => {
            let mut state = ZeroCrossing::default();
            Box::new(move |x, _| Some(vec![state.update(r(x[0])).into(), state.sign.into()]))
        }
        "noise_level" => {
            let mut state = NoiseLevel::<R>::default();
            Box::new(move |x, _| {
                if x[0].is_nan() {
                    state.interrupt();
                } else {
                    state.update(r(x[0]));
                }
                Some(vec![state.sigma().map_or(f64::NAN, R::as_f64)])
            })
        }
        "half_period" => {
            let mut state: Option<HalfPeriodState<R>> = None;
            Box::new(move |x, h| {
                let (sp, slope, op) = (r(x[1]), r(x[2]), r(x[3]));
                let ended = state.filter(|_| x[5] != 0.0).map(|state| state.close(1, sp, slope, op));
                if ended.is_some() || state.is_none() {
                    state = Some(HalfPeriodState::start(sp, slope, op, 0));
                }
                let state = state.as_mut().unwrap();
                state.add(r(x[0]), r(h), x[4] as u16);
                state.widen(sp);
                ended.map(|half| half_of(&half))
            })
        }
        "width" => {
            let width = width_of::<R>(case);
            Box::new(move |x, _| {
                let op_known = !x[5].is_nan();
                let half = HalfPeriod {
                    sign: x[0] as i8,
                    delta_t: r(x[1]),
                    delta_y: r(x[2]),
                    sp_change: r(x[3]),
                    slope_change: r(x[4]),
                    op_change: if op_known { r(x[5]) } else { R::ZERO },
                    ..HalfPeriod::default()
                };
                let parts = parts_of(&width.of(&half, op_known));
                // A value that is too large counts as none, as in the detector.
                Some(if parts.iter().all(|part| part.abs() <= 1e36) { parts } else { vec![0.0; parts.len()] })
            })
        }
        "safety_net" => {
            let (width, mut net) = (width_of::<R>(case), SafetyNet::new(case.param("op_span").map(r)).unwrap());
            for name in Conditions::NAMES {
                *net.conditions.switch(name).unwrap() = case.param(name) != Some(0.0);
            }
            Box::new(move |x, _| {
                let half = HalfPeriod {
                    flags: x[0] as u16,
                    delta_t: r(x[1]),
                    delta_y: r(x[2]),
                    e_max: r(x[3]),
                    delta_sp: r(x[4]),
                    ..HalfPeriod::default()
                };
                let parts = WidthParts { free: r(x[5]), ..WidthParts::default() };
                let mask = net.check(&half, &parts, &width, maybe(x[6]).map(r), maybe(x[7]).map(r));
                Some(vec![mask.into(), f64::from(Reason::first(mask) as u8)])
            })
        }
        "median_mean" => {
            let filter = MedianMean::new(case.given("n") as u32).unwrap();
            let mut state = MedianMeanState::default();
            Box::new(move |x, _| {
                let shown = filter.update(&mut state, r(x[0]));
                let [value, low, high] = [shown.value, shown.low, shown.high].map(R::as_f64);
                Some(vec![value, low, high, shown.kept.into(), shown.count.into()])
            })
        }
        other => panic!("{other}"),
    }
}

fn half_of<R: Number>(half: &HalfPeriod<R>) -> Vec<f64> {
    let mut row = vec![half.flags.into(), half.n.into()];
    row.extend(
        [half.delta_t, half.delta_y, half.e_max, half.delta_sp, half.sp_change, half.slope_change, half.op_change]
            .map(R::as_f64),
    );
    row
}

const HALF: [&str; 7] = ["DeltaT", "DeltaY", "EMax", "DeltaSp", "SpChange", "SlopeChange", "OpChange"];

fn half_row(block: &Block, within: &str) -> Vec<f64> {
    let mut row = vec![flags(block, within), block.get(&format!("{within}Samples"))];
    row.extend(HALF.iter().map(|pin| block.get(&format!("{within}{pin}"))));
    row
}

/// The library's block, and the instance that it is.
pub fn library<R: Number>(block: &str, case: &Case) -> (Scan, Block) {
    let name = if block == "filter" { "GlappSecondOrderFilter".into() } else { format!("Glapp{}", pascal(block)) };
    let one = Block::new::<R>(&name);
    let b = one.clone();
    let scan: Scan = match block {
        "filter" => {
            b.set("Tf", case.given("tf"));
            Box::new(move |x, h| {
                b.set_all(&[("X", x[0]), ("H", h)]);
                b.call();
                Some(b.all(&["Y"]))
            })
        }
        "zero_crossing" => Box::new(move |x, _| {
            b.set("E", x[0]);
            b.call();
            Some(b.all(&["Crossed", "Sign"]))
        }),
        "noise_level" => Box::new(move |x, _| {
            let missing = f64::from(u8::from(x[0].is_nan()));
            b.set_all(&[("X", x[0]), ("Take", 1.0 - missing), ("Interrupt", missing)]);
            b.call();
            Some(vec![b.given("HasSigma", "Sigma")])
        }),
        "half_period" => {
            let mut begun = false;
            b.set_all(&[("Sign", 1.0), ("Take", 1.0)]);
            Box::new(move |x, h| {
                let close = begun && x[5] != 0.0;
                b.set_all(&[("Close", f64::from(close)), ("Open", f64::from(close || !begun)), ("H", h)]);
                b.set_all(&[("E", x[0]), ("Sp", x[1]), ("Slope", x[2]), ("OpFiltered", x[3])]);
                set_flags(&b, "", x[4]);
                b.call();
                begun = true;
                close.then(|| half_row(&b, "Half."))
            })
        }
        "width" => {
            b.set_all(&[("K", case.given("k")), ("Ti", case.given("ti")), ("B", case.param("b").unwrap_or(1.0))]);
            b.option("Td", case.param("td"));
            b.option("Kp", case.param("kp"));
            Box::new(move |x, _| {
                b.set_all(&[("Half.Sign", x[0]), ("Half.DeltaT", x[1]), ("Half.DeltaY", x[2])]);
                b.set_all(&[("Half.SpChange", x[3]), ("Half.SlopeChange", x[4])]);
                b.set_all(&[("Half.OpChange", maybe(x[5]).unwrap_or(0.0)), ("OpKnown", f64::from(!x[5].is_nan()))]);
                b.call();
                Some(PARTS.iter().map(|pin| b.get(&format!("Parts.{pin}"))).collect())
            })
        }
        "safety_net" => {
            b.set_all(&[("K", case.given("k")), ("Ti", case.given("ti"))]);
            b.option("OpSpan", case.param("op_span"));
            for name in Conditions::NAMES {
                b.set(&pascal(name), f64::from(case.param(name) != Some(0.0)));
            }
            Box::new(move |x, _| {
                set_flags(&b, "Half.", x[0]);
                b.set_all(&[("Half.DeltaT", x[1]), ("Half.DeltaY", x[2]), ("Half.EMax", x[3]), ("Half.DeltaSp", x[4])]);
                b.set("Free", x[5]);
                b.option("Previous", maybe(x[6]));
                b.option("DHat", maybe(x[7]));
                b.call();
                Some(b.all(&["Mask", "Reason"]))
            })
        }
        "median_mean" => {
            b.set("N", case.given("n"));
            Box::new(move |x, _| {
                b.set("Detection", x[0]);
                b.call();
                Some(["Value", "Low", "High", "Kept", "Count"].map(|pin| b.get(&format!("Estimate.{pin}"))).to_vec())
            })
        }
        other => panic!("{other}"),
    };
    (scan, one)
}

/// A record as the core has it: what the vectors have, and the rest of it.
pub fn record_of<R: Number>(record: &HalfPeriodResult<R>) -> Vec<f64> {
    let or_nan = |x: Option<R>| x.map_or(f64::NAN, R::as_f64);
    let mut row = vec![f64::from(record.half.sign)];
    row.extend(half_of(&record.half));
    row.extend(parts_of(&record.parts));
    row.extend([or_nan(record.previous_delta_y), or_nan(record.d_hat_before)]);
    row.extend([f64::from(record.mask), f64::from(record.reason() as u8)]);
    row.extend([or_nan(record.noise_floor), or_nan(record.sigma), or_nan(record.estimate.map(|e| e.value))]);
    row.push(f64::from(u8::from(record.kp_defaulted)));
    row
}

/// The row of the library's block.
pub fn record_row(block: &Block) -> Vec<f64> {
    let mut row = vec![block.get("Record.Half.Sign")];
    row.extend(half_row(block, "Record.Half."));
    row.extend(PARTS.iter().map(|pin| block.get(&format!("Record.Parts.{pin}"))));
    for pin in ["PreviousDeltaY", "DHatBefore"] {
        row.push(block.given(&format!("Record.Has{pin}"), &format!("Record.{pin}")));
    }
    row.extend(block.all(&["Record.Mask", "Record.Reason"]));
    for pin in ["NoiseFloor", "Sigma"] {
        row.push(block.given(&format!("Record.Has{pin}"), &format!("Record.{pin}")));
    }
    row.push(block.given("Record.HasEstimate", "Record.Estimate.Value"));
    row.push(block.get("Record.KpDefaulted"));
    row
}
