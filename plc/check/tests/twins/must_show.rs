//! Promises of the library beyond equal bits: REAL is as good as LREAL where sums are long, and a power cut loses
//! nothing but the half-period that it falls into and the compensation, which a person enables anew.

use crate::common::detector::{Pins, Reference, scan};
use crate::common::{Block, Draw, Number, compensate, detection, same};
use glapp_plc_check::Within;

/// Allowed error of REAL, as a share of LREAL.
const SHARE: f64 = 1e-4;

fn near(real: f64, lreal: f64, what: &str) {
    assert!((real - lreal).abs() <= SHARE * lreal.abs(), "{what}: {real} in REAL, {lreal} in LREAL");
}

/// A step of 0.1 on 50, far slower than the scans: each scan adds 1e-5 of what is left. The change counts, not the level.
#[test]
fn a_filter_ten_thousand_times_slower_than_its_scans() {
    fn risen<R: Number>() -> Vec<f64> {
        let filter = Block::new::<R>("GlappSecondOrderFilter");
        filter.set_all(&[("Tf", 1e3), ("H", 0.1), ("X", 50.0)]);
        filter.call();
        // The step itself is rounded to 4e-6 at 50 in REAL; both builds get the rounded one.
        filter.set("X", f64::from(50.1_f32));
        let mut shown = vec![];
        for i in 1..=50_000 {
            filter.call();
            if i % 5_000 == 0 {
                shown.push((filter.get("Y") - 50.0) + filter.get("Rest"));
            }
        }
        shown
    }
    let (real, lreal) = (risen::<f32>(), risen::<f64>());
    assert!(lreal[0] > 0.008 && lreal[9] > 0.095 && lreal[9] < 0.1);
    for (i, (real, lreal)) in real.iter().zip(&lreal).enumerate() {
        near(*real, *lreal, &format!("after {} scans", 5_000 * (i + 1)));
    }
}

/// A PI's integral at Ti = 1000 s, scans of 0.01 s and a control error of 0.05 on 50: each scan adds 5e-7, an eighth of what REAL can tell
/// apart at 50. The change counts, not the level.
#[test]
fn an_integral_that_each_scan_moves_by_less_than_a_digit() {
    fn moved<R: Number>() -> Vec<f64> {
        let pid = Block::new::<R>("GlappPid");
        // The error itself is rounded to 4e-6 at 50 in REAL; both builds get the rounded one.
        let (sp, pv) = (50.0, f64::from(49.95_f32));
        pid.set_all(&[("Enable", 1.0), ("Start", 50.0), ("H", 0.01), ("K", 1.0), ("Ti", 1e3), ("HasOwnSp", 1.0)]);
        pid.set_all(&[("OwnSp", sp), ("Pv", pv)]);
        pid.call();
        let integral = || pid.peek("Law.IPart.Value") + pid.peek("Law.IPart.Rest");
        let begins = integral();
        assert!((begins - 50.0).abs() < 0.06, "{begins}");
        let mut shown = vec![];
        for i in 1..=100_000 {
            pid.call();
            if i % 10_000 == 0 {
                shown.push(integral() - begins);
            }
        }
        assert!((pid.get("Output") - (50.0 + shown[9])).abs() < 1e-5);
        shown
    }
    let (real, lreal) = (moved::<f32>(), moved::<f64>());
    assert!((lreal[9] - 0.05).abs() < 1e-5, "{lreal:?}");
    for (real, lreal) in real.iter().zip(&lreal) {
        near(*real, *lreal, "the integral");
    }
}

/// DeltaT, DeltaY, the width and the estimate of three half-periods of a million samples each.
#[test]
fn half_periods_of_a_million_samples() {
    fn found<R: Number>() -> Vec<f64> {
        let (half, width, window) =
            (Block::new::<R>("GlappHalfPeriod"), Block::new::<R>("GlappWidth"), Block::new::<R>("GlappMedianMean"));
        width.set_all(&[("K", 0.5), ("Ti", 20.0), ("HasKp", 1.0), ("Kp", 2.0)]);
        window.set("N", 3.0);
        half.set_all(&[("Take", 1.0), ("Sp", 50.0), ("H", 0.01), ("Sign", 1.0)]);
        let mut shown = vec![];
        for turn in 0..4_u32 {
            let closes = f64::from(u8::from(turn > 0));
            half.set_all(&[("Close", closes), ("Open", 1.0), ("E", 0.1)]);
            half.call();
            half.set_all(&[("Close", 0.0), ("Open", 0.0)]);
            if turn > 0 {
                for part in ["DeltaT", "DeltaY", "EMax", "Sign"] {
                    width.set(&format!("Half.{part}"), half.get(&format!("Half.{part}")));
                }
                width.call();
                window.set("Detection", width.get("Parts.D"));
                window.call();
                shown.extend(half.all(&["Half.DeltaT", "Half.DeltaY"]));
                shown.extend([width.get("Parts.D"), window.get("Estimate.Value")]);
            }
            if turn < 3 {
                for i in 1..1_000_000_u32 {
                    if i % 1_000 == 0 {
                        half.set("E", 0.1 + f64::from((i / 1_000 + turn) % 7) * 0.03);
                    }
                    half.call();
                }
            }
        }
        shown
    }
    let (real, lreal) = (found::<f32>(), found::<f64>());
    assert!((lreal[0] - 1e4).abs() < 1e-3 && lreal[11] > 40.0);
    for (real, lreal) in real.iter().zip(&lreal) {
        near(*real, *lreal, "of DeltaT, DeltaY, D, estimate");
    }
}

/// The power goes in the middle of a half-period: the detections stay, the half-period that it falls into is none, and from there on all
/// is as in the core, to the bit.
fn cut<R: Number>() {
    let (block, mut reference) = (Block::new::<R>("GlappDetector"), Reference::<R>::default());
    let mut draw = Draw::new(11);
    let usual = Pins { kp: Some(2.0), td: Some(0.0), n: 3, ..Pins::default() };
    let (mut kept, mut after) = (f64::NAN, vec![]);
    for i in 0..700 {
        if i == 415 {
            kept = block.get("Accepted");
            assert!(block.on("HasShown") && kept > 5.0);
            block.0.borrow_mut().power_cut();
            reference.power_cut();
        }
        let side = if (i / 30) % 2 == 0 { 1.0 } else { -1.0 };
        let pins = Pins { pv: -side + draw.between(-0.05, 0.05), ..usual.clone() };
        let (expected, got) = (reference.scan(&pins), scan(&block, &pins));
        assert!(same(&expected.0, &got.0), "scan {i}: {got:?} instead of {expected:?}");
        assert_eq!(expected.1.is_some(), got.1.is_some(), "scan {i}");
        if i >= 415 && got.1.is_some() {
            after.push((block.on("Record.Half.Gap"), block.get("Accepted")));
        }
        if i == 415 {
            assert!(block.on("HasShown") && block.on("HasEstimate") && !block.on("Dropped"));
            assert_eq!(block.get("Accepted"), kept);
            assert!(!block.on("Ended"));
        }
    }
    // The first that ends began with a gap; the second has no half-period before it; from the third on they count again.
    assert!(after[0].0 && after[0].1 == kept, "{after:?}");
    assert!(after.len() > 5 && after.last().unwrap().1 > kept + 3.0, "{after:?}");
}

in_both!(power_cut_in_a_half_period_lreal, power_cut_in_a_half_period_real: cut);

/// The power goes in the middle of a half-period and while u_FF is not 0. Detections and estimates stay; u_FF is 0 at once, or where the
/// other maker's controller still holds one, goes to 0 by its ramp; and `Compensate`, which is still on, counts only once it has been seen
/// off. Before and after, all is as in the core that is begun again with what is retained, to the bit.
fn cut_while_compensating<R: Number>(foreign: Option<detection::Foreign>) {
    const LENGTH: usize = 12;
    let (on, cut, off, on_again, end) = (300, 607, 700, 710, 900);
    let settings = compensate::Settings {
        size: 0.4,
        withdraw: false,
        lessen: false,
        rate: Some(0.2),
        release: Some(3.0),
        ..compensate::Settings::default()
    };
    let usual = Pins { ti: 0.4, td: Some(0.0), tf: Some(0.0), n: 3, kp: Some(2.0), ..Pins::default() };
    let h = usual.h;
    let mut pins =
        detection::Pins { detector: usual, compensate: false, compensation: Some(settings), cut: false, foreign };
    let (block, mut reference) = (Block::new::<R>(pins.name()), detection::Reference::<R>::default());
    let (reads_back, theirs) = (pins.foreign.as_ref().is_some_and(|f| f.back.is_some()), pins.foreign.is_some());
    let kept = ["Accepted", "Estimate.Value", "Estimate.Count", "Whole.Value", "Whole.Count", "NoiseFloor"];
    let (mut before, mut held, mut shown) = (vec![], 0.0, vec![]);
    for i in 0..end {
        if i == cut {
            assert!(i % LENGTH == 7 && held != 0.0 && block.on("HasWholeShown") && block.on("HasNoiseFloor"));
            before = block.all(&kept);
            block.0.borrow_mut().power_cut();
            reference.power_cut();
            // Ours begins again with nothing; what is written to another maker's controller stays there.
            held = if theirs { held } else { 0.0 };
        }
        let side = if (i / LENGTH).is_multiple_of(2) { 1.0 } else { -1.0 };
        let (pv, op) = (-side + 0.01 * (i % 5) as f64, side * (i % LENGTH) as f64 * 0.2);
        pins.detector.pv = pv;
        pins.detector.op = Some(op + held);
        pins.compensate = (on..off).contains(&i) || i >= on_again;
        if let Some(foreign) = &mut pins.foreign {
            foreign.back = reads_back.then_some(held);
        }
        let (expected, got) = (reference.scan(&pins), detection::scan(&block, &pins));
        assert!(detection::agree(&expected, &got), "scan {i}:\n{got:?} instead of\n{expected:?}");
        let u_ff = block.get("UFf");
        if i == cut {
            assert_eq!(block.all(&kept), before);
            assert!(block.on("HasShown") && block.on("HasWholeShown") && !block.on("Dropped") && !got.ended);
        }
        if i != cut {
            // The change stays within its rate, 0.2/s, in all cases.
            assert!((u_ff - held).abs() <= 0.2 * h + 1e-6, "scan {i}: from {held} to {u_ff}");
        }
        held = u_ff;
        shown.push((u_ff.abs(), block.get("Standing")));
    }
    let whole = 0.5 * (0.4 - 0.4 / 5.0);
    assert!(shown[on + 60..cut].iter().any(|(u_ff, standing)| (u_ff - whole).abs() < 1e-6 && *standing == 0.0));
    // The u_FF at the power cut; it is removed within 3 s where it is still there.
    let after = &shown[cut..off];
    if reads_back {
        let there = shown[cut - 1].0;
        assert!(after[0].0 < there && after[0].0 > 0.8 * there, "{} of {there}", after[0].0);
        assert!(after[..12].windows(2).all(|two| two[1].0 < two[0].0));
    } else {
        assert_eq!(after[0].0, 0.0);
    }
    // No compensation starts while Compensate has been on since before the cut.
    assert!(after[13..].iter().all(|(u_ff, standing)| *u_ff == 0.0 && *standing == 1.0), "{after:?}");
    assert!(shown[on_again + 60..].iter().any(|(u_ff, standing)| (u_ff - whole).abs() < 1e-6 && *standing == 0.0));
    assert!(block.get("Accepted") > before[0] + 5.0);
}

fn cut_beside_each<R: Number>() {
    cut_while_compensating::<R>(None);
    for back in [None, Some(0.0)] {
        let foreign = detection::Foreign { delay: 1, tolerance: None, longest: None, back };
        cut_while_compensating::<R>(Some(foreign));
    }
}

in_both!(power_cut_while_compensating_lreal, power_cut_while_compensating_real: cut_beside_each);

/// Power goes while a controller saves its retained variables: some are of that scan, others of one long before. No such mixture leads to
/// what a controller traps on, at which the evaluator stops; and a width comes out again.
fn torn<R: Number>() {
    for foreign in [false, true] {
        let name = if foreign { "GlappForeignDetection" } else { "GlappBacklashDetection" };
        let retained: Vec<String> = R::library()
            .variables(name)
            .iter()
            // The places of an array are of one kind, and none of them is an index.
            .filter(|one| one.retained && one.parts.iter().all(|(_, within)| *within != Within::Array))
            .filter(|one| !one.path().ends_with("StateVersion"))
            .map(|one| one.path())
            .collect();
        assert!(retained.len() > 40, "{name}: {}", retained.len());
        let mut shown = 0;
        for seed in 0..30 {
            let mut draw = Draw::new(50_000 + seed);
            let mut signals = detection::Loop::new(&mut draw, foreign);
            let block = Block::new::<R>(name);
            let mut runs = |draw: &mut Draw, scans: u64| {
                for _ in 0..scans {
                    let u_ff = block.get("UFf");
                    detection::scan(&block, signals.next::<R>(draw, u_ff));
                }
            };
            let first = draw.of(&[1, 40, 100, 200]);
            runs(&mut draw, first);
            let before: Vec<f64> = retained.iter().map(|one| block.peek(one)).collect();
            runs(&mut draw, 200);
            block.0.borrow_mut().power_cut();
            for (variable, value) in retained.iter().zip(&before) {
                if draw.chance(0.5) {
                    block.0.borrow_mut().spoil(variable, *value).unwrap();
                }
            }
            runs(&mut draw, 300);
            shown += u32::from(block.on("HasEstimate"));
        }
        assert!(shown > 10, "{name}: {shown}");
    }
}

#[test]
fn power_cut_while_it_saves_lreal() {
    torn::<f64>();
}

#[test]
fn power_cut_while_it_saves_real() {
    torn::<f32>();
}
