//! What the library has to show beside equal bits: REAL is as good as LREAL where sums are long, and a power cut loses nothing but the
//! half-period that it falls into.

mod common;

use common::detector::{Pins, Reference, scan};
use common::{Block, Draw, Number, same};

/// What REAL may be off, as a share of LREAL.
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
        // In REAL the step itself is rounded to 4e-6 at 50; both builds are given that one.
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

#[test]
fn power_cut_in_a_half_period_lreal() {
    cut::<f64>();
}

#[test]
fn power_cut_in_a_half_period_real() {
    cut::<f32>();
}
