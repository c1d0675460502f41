//! Every vector of the blocks that are there, in LREAL to the bit of the vectors, in REAL to the bit of the core in `f32`.

use crate::common::blocks::{BLOCKS, core, library};
use crate::common::detector::{Pins, Reference, scan};
use crate::common::{Block, Case, Number, cases, compare, same};
use glapp_core::Conditions;
use glapp_plc_check::Build;

fn every_case<R: Number>() {
    let with_vectors = R::BUILD == Build::Lreal;
    for block in BLOCKS {
        for case in cases(block) {
            compare(&case, core::<R>(block, &case), library::<R>(block, &case).0, with_vectors);
        }
    }
}

in_both!(lreal, real: every_case);

fn pins(case: &Case) -> Pins {
    let mut conditions = Conditions::default();
    for name in Conditions::NAMES {
        *conditions.switch(name).unwrap() = case.param(name) != Some(0.0);
    }
    Pins {
        k: case.given("k"),
        ti: case.given("ti"),
        td: case.param("td"),
        b: case.given("b"),
        kp: case.param("kp"),
        tf: Some(case.given("tf")),
        n: case.given("n") as i16,
        max_h: Some(case.given("max_h")),
        op_limits: case.param("op_low").zip(case.param("op_high")),
        op_span: case.param("op_span"),
        conditions,
        ..Pins::default()
    }
}

/// Records of the vectors' detector have no OpSpan that is made of the limits; a span given is above every width here. What is shown is
/// within `tolerance` of the vectors, as a share of the number or of 1 where that is smaller; 0: to the bit.
fn detector<R: Number>() {
    let tolerance = if R::BUILD == Build::Lreal { 0.0 } else { 1e-5 };
    for case in cases("detector") {
        let mut pins = pins(&case);
        if pins.op_limits.is_some() && pins.op_span.is_none() {
            pins.op_span = Some(1e9);
        }
        let (block, mut reference) = (Block::new::<R>("GlappDetector"), Reference::<R>::default());
        for (i, (h, x)) in case.input.iter().enumerate() {
            let op = (case.given("op_known") != 0.0).then_some(x[2]);
            pins = Pins { h: *h, sp: x[0], pv: x[1], op, flags: x[3] as u16, ..pins };
            let (expected, got) = (reference.scan(&pins), scan(&block, &pins));
            let agree = same(&expected.0, &got.0) && expected.1.is_some() == got.1.is_some();
            assert!(agree, "{}, scan {i}: {got:?} instead of {expected:?}", case.name);
            if let (Some(a), Some(b)) = (&expected.1, &got.1) {
                assert!(same(a, b), "{}, scan {i}: {b:?} instead of {a:?}", case.name);
            }
            let row = case.output.as_ref().unwrap()[i].as_array();
            assert_eq!(row.is_some(), got.1.is_some(), "{}, scan {i}", case.name);
            if let Some(row) = row {
                let number = |i: usize| row[i].as_f64().unwrap_or(f64::NAN);
                let of = |has: &str, pin: &str| block.given(has, pin);
                let half = ["Sign", "Samples", "DeltaT", "DeltaY", "EMax", "DeltaSp"];
                let parts = ["DeltaU", "DeltaUD", "DeltaUSp", "OpTravel", "Free", "KpPart", "D"];
                let mut shown: Vec<f64> = half.iter().map(|pin| block.get(&format!("Record.Half.{pin}"))).collect();
                shown.extend(parts.iter().map(|pin| block.get(&format!("Record.Parts.{pin}"))));
                shown.push(of("Record.HasPreviousDeltaY", "Record.PreviousDeltaY"));
                shown.push(of("Record.HasDHatBefore", "Record.DHatBefore"));
                shown.extend(block.all(&["Record.Mask", "Record.Reason"]));
                shown.push(of("HasShown", "Estimate.Value"));
                shown.push(if block.on("HasEstimate") { block.get("Estimate.Count") } else { 0.0 });
                shown.push(of("HasEstimate", "Estimate.Value"));
                shown.push(of("HasNoiseFloor", "NoiseFloor"));
                let expected: Vec<f64> = (0..row.len()).map(number).collect();
                let near =
                    |(a, b): (&f64, &f64)| (a - b).abs() <= tolerance * a.abs().max(1.0) || (a.is_nan() && b.is_nan());
                let agree = same(&expected, &shown) || (tolerance > 0.0 && expected.iter().zip(&shown).all(near));
                assert!(agree, "{}, scan {i}: {shown:?} instead of {expected:?}", case.name);
            }
        }
    }
}

// REAL has seven digits.
in_both!(detector_lreal, detector_real: detector);
