//! Random sequences, good and bad settings and inputs: the library's blocks beside the core's, the same bits in LREAL and REAL.
//!
//! `GLAPP_SEQUENCES=10000 cargo test -p glapp-plc-check --test twins random:: -- --nocapture` runs ten thousand of each and tells
//! what a scan costs.

use crate::common::blocks::{BLOCKS, core, library};
use crate::common::cover::{Cost, Cover, sequences};
use crate::common::detector::{Loop, NUMBERS, Pins, Reference, breaks_off, scan};
use crate::common::{Block, Case, Draw, Number, compare, same};
use glapp_core::Conditions;
use glapp_plc_check::Build;
use serde_json::json;

/// The blocks and functions that a detector is made of; others have a file of their own.
const OF_DETECTOR: [&str; 15] = [
    "GlappDetector", "GlappDetectorCheck", "GlappHalfPeriod", "GlappIsNumber", "GlappMeasurable", "GlappMedianMean",
    "GlappNoiseFloor", "GlappNoiseLevel", "GlappProductFits", "GlappQuotientFits", "GlappSafetyNet",
    "GlappSecondOrderFilter", "GlappSum", "GlappWidth", "GlappZeroCrossing",
];

/// A case of a block, drawn.
fn drawn(block: &str, draw: &mut Draw) -> Case {
    let d = draw;
    let params = match block {
        "filter" => json!({ "tf": d.of(&[0.0, 0.1, 1.0, 1e6]) }),
        "median_mean" => json!({ "n": d.of(&[1, 3, 5, 9, 31]) }),
        "width" | "safety_net" => {
            let mut params =
                json!({ "k": d.of(&[0.5, -0.5, 3.0, 1e-3]), "ti": d.between(0.1, 5.0), "b": d.of(&[0.0, 0.3, 1.0]) });
            let kp = d.of(&[1.0, -1.0]) * d.between(0.125, 2.0);
            for (name, value) in [("td", 0.0), ("td", d.between(0.0, 2.0)), ("kp", kp), ("op_span", 5.0)] {
                if d.chance(0.4) {
                    params[name] = value.into();
                }
            }
            if d.chance(0.5) {
                params[d.of(&Conditions::NAMES)] = 0.into();
            }
            params
        }
        _ => json!({}),
    };
    let (scale, walk, mut level) = (d.of(&[1.0, 1e-6, 1e6]), d.chance(0.5), 0.0);
    let grid = d.of(&[0.0, 0.0, 0.1, 0.5]);
    let input = (0..120).map(|_| {
        level = if walk { level + d.between(-0.3, 0.3) } else { d.between(-1.0, 1.0) };
        if grid > 0.0 {
            level = (level / grid).round() * grid;
        }
        let x = level * scale;
        let h = d.of(&[0.1, 0.1, 0.1, 0.25, 0.0]);
        let or_nan = |d: &mut Draw, x: f64, share: f64| if d.chance(share) { f64::NAN } else { x };
        let row = match block {
            "zero_crossing" => vec![d.of(&[x, x, 0.0, -0.0, f64::NAN])],
            "noise_level" => vec![or_nan(d, x, 0.03)],
            "half_period" => {
                let flags = if d.chance(0.1) { d.of(&[1.0, 2.0, 4.0, 8.0, 16.0, 31.0]) } else { 0.0 };
                let crossed = f64::from(u8::from(d.chance(0.2)));
                vec![x, d.between(-1.0, 1.0), d.between(-1.0, 1.0), d.between(-1.0, 1.0), flags, crossed]
            }
            "width" => {
                let op = d.between(-2.0, 2.0);
                let op = or_nan(d, op, 0.5);
                vec![
                    d.of(&[1.0, -1.0, 0.0]),
                    d.between(0.0, 50.0),
                    x.abs(),
                    d.between(-1.0, 1.0),
                    d.between(-1.0, 1.0),
                    op,
                ]
            }
            "safety_net" => {
                let flags = if d.chance(0.2) { d.of(&[1.0, 2.0, 4.0, 8.0, 16.0, 31.0]) } else { 0.0 };
                let y = x.abs();
                let previous = d.of(&[y, 1.4 * y, 1.5 * y, 0.5 * y, 0.6 * y, 2.0 * y, f64::NAN]);
                let e_max = y * d.of(&[1.0, 1.5, 2.0, 3.0]);
                let sp = y * d.of(&[0.0, 0.5, 1.0, 2.0]);
                let d_hat = d.between(0.0, 20.0);
                let d_hat = or_nan(d, d_hat, 0.3);
                vec![flags, d.between(0.0, 60.0), y, e_max, sp, d.between(0.0, 10.0), previous, d_hat]
            }
            _ => vec![x],
        };
        (h, row)
    });
    let input = input.collect();
    Case { name: block.to_owned(), params, input, output: None }
}

fn all<R: Number>() {
    let mut cover = Cover::new::<R>();
    for name in BLOCKS {
        let cost = Cost::default();
        let mut of = String::new();
        for seed in 0..sequences() {
            let case = drawn(name, &mut Draw::new(seed + 1));
            let (scan, block) = library::<R>(name, &case);
            compare(&case, core::<R>(name, &case), cost.counting(scan, &block), false);
            cover.collect(&block);
            of = block.0.borrow().name().to_owned();
        }
        cost.tell::<R>(&of);
    }
    if R::BUILD == Build::Real {
        too_large::<R>(&mut cover);
    }
    detectors::<R>(&mut cover);
    long_noise::<R>(&mut cover);
    extremes::<R>(&mut cover);
    large::<R>(&mut cover);
    coarse::<R>(&mut cover);
    stretches::<R>(&mut cover);
    told_before_it_begins_anew::<R>();
    smaller_and_smaller::<R>(&mut cover);
    at_their_bounds::<R>();
    two_wrong::<R>();
    stays_bad::<R>();
    another_version::<R>(&mut cover);
    // Branches that no sequence reaches: the ends of counters of 32 bits; a noise floor without end, which has a test
    // of its own; and those that only a block around the detector uses.
    let inside = |line: &str| line.starts_with("IF Inner.Checked") || line.contains("GlappIsOpen(Inner.Raw)");
    cover.holds_but(&OF_DETECTOR, |way, line| {
        inside(line) || (way.branch == 1 && (line.contains("2147483647") || way.pou == "GlappNoiseFloor"))
    });
}

/// Products beyond the numbers, each factor by itself. All are powers of 10^10: what overflows in the core in `f32` is beyond 1E37 here.
fn too_large<R: Number>(cover: &mut Cover) {
    for name in ["width", "safety_net"] {
        for seed in 0..sequences() {
            let mut draw = Draw::new(40_000 + seed);
            let mut case = drawn(name, &mut draw);
            let far = |d: &mut Draw, x: f64, share: f64| {
                let scaled = x * d.of(&[1e10, 1e20, 1e-10, 1e-20]);
                if d.chance(share) { scaled } else { x }
            };
            for param in ["k", "ti", "td", "kp"] {
                if let Some(value) = case.param(param).filter(|value| *value != 0.0) {
                    case.params[param] = far(&mut draw, value.signum(), 0.4).into();
                }
            }
            for (_, row) in &mut case.input {
                for (at, x) in row.iter_mut().enumerate().skip(1) {
                    // DeltaY of the safety net comes with the value it is compared with.
                    if !x.is_nan() && (name == "width" || at == 1 || at == 2 || at == 7) {
                        *x = far(&mut draw, x.signum(), 0.4);
                    }
                }
            }
            let (scan, block) = library::<R>(name, &case);
            compare(&case, core::<R>(name, &case), scan, false);
            cover.collect(&block);
        }
    }
}

/// Long enough for the gain to come to its least value and for the counters of eight bits to end; then held.
fn long_noise<R: Number>(cover: &mut Cover) {
    let mut draw = Draw::new(7);
    let noise = (0..3000).map(|_| (0.0, vec![draw.between(-1.0, 1.0)]));
    let held = (0..300).map(|_| (0.0, vec![0.5]));
    let case = Case { name: "long".into(), params: json!({}), input: noise.chain(held).collect(), output: None };
    let (scan, block) = library::<R>("noise_level", &case);
    compare(&case, core::<R>("noise_level", &case), scan, false);
    cover.collect(&block);
}

/// Settings at the ends of what is a number: no run stops. In REAL what overflows is what overflows in the core; LREAL in the core
/// goes on to 1E308.
fn extremes<R: Number>(cover: &mut Cover) {
    let ends = [1.0, 1.0, 1e30, 1e-30, -1e30];
    let mut bad = 0.0;
    for seed in 0..sequences() {
        let mut draw = Draw::new(5000 + seed);
        let mut pins = Loop::new(&mut draw).pins;
        let size = draw.of(&[1.0, 1e11, 1e-25]);
        let long = draw.of(&[0.25, 1e8]);
        pins = Pins { k: draw.of(&ends), ti: draw.of(&ends[..4]), td: draw.of(&[None, Some(0.0), Some(1e30)]), ..pins };
        pins = Pins { kp: draw.of(&[None, Some(1e36), Some(1e-30)]), n: 1, max_h: Some(1e9), h: long, ..pins };
        if draw.chance(0.2) {
            (pins.kp, pins.pv_span, pins.op_span) = (None, Some(1e30), Some(1e-30));
        }
        pins.conditions = Conditions { too_short: false, decaying: false, growing: false, ..pins.conditions };
        let (block, mut reference) = (Block::new::<R>("GlappDetector"), Reference::<R>::default());
        if R::BUILD == Build::Lreal {
            block.unheld();
        }
        for i in 0..120 {
            let side = if (i / 6) % 2 == 0 { 1.0 } else { -1.0 };
            pins.pv = size * (side + draw.between(-0.1, 0.1));
            pins.op = pins.op.map(|_| side);
            let got = scan(&block, &pins);
            if R::BUILD == Build::Real {
                let expected = reference.scan(&pins);
                let floor = expected.0[8];
                let capped = floor > 1e37;
                let agree = expected
                    .0
                    .iter()
                    .zip(&got.0)
                    .enumerate()
                    .all(|(place, (a, b))| same(&[*a], &[*b]) || (place == 8 && capped && *b >= 1e37));
                assert!(agree, "sequence {seed}, scan {i}:\n{got:?} instead of\n{expected:?}\nfor {pins:?}");
                if let (Some(a), Some(b), false) = (&expected.1, &got.1, capped) {
                    assert!(same(a, b), "sequence {seed}, scan {i}:\n{b:?} instead of\n{a:?}\nfor {pins:?}");
                }
            }
            bad += block.get("Record.Half.Bad");
        }
        cover.collect(&block);
    }
    assert!(bad > sequences() as f64);
}

/// Each number by itself so large that it is one, and beyond what can be measured.
fn large<R: Number>(cover: &mut Cover) {
    for (number, put) in NUMBERS.iter().enumerate() {
        for value in [1e33, -1e33, 0.0, 5.0, -5.0] {
            let conditions = Conditions { too_short: false, ..Conditions::default() };
            let usual = Pins { kp: Some(2.0), n: 1, max_h: Some(1.0), op: Some(0.0), conditions, ..Pins::default() };
            let (block, mut reference) = (Block::new::<R>("GlappDetector"), Reference::<R>::default());
            for i in 0..40 {
                let side = if (i / 6) % 2 == 0 { 1.0 } else { -1.0 };
                let mut pins = Pins { pv: side, op: Some(side), ..usual.clone() };
                if (20..30).contains(&i) {
                    put(&mut pins, value);
                }
                beside(&mut reference, &block, &pins, &format!("number {number}, {value}, scan {i}"));
            }
            cover.collect(&block);
        }
    }
}

/// A width at its bound and beyond it; a half-period that broke off is the same whether what was seen is forgotten with it or not.
fn at_their_bounds<R: Number>() {
    let width = Block::new::<R>("GlappWidth");
    width.set_all(&[("K", 1.0), ("Ti", 1.0), ("B", 1.0), ("OpKnown", 1.0), ("Half.Sign", 1.0), ("Half.DeltaY", 1.0)]);
    for (change, d) in [(1e36, R::of(1e36).as_f64()), (1.1e36, 0.0)] {
        width.set("Half.OpChange", change);
        width.call();
        assert_eq!(width.all(&["Parts.D", "Parts.OpTravel", "Parts.Free"]), [d; 3]);
    }
    // A default for Kp that is none is none.
    let detector = Block::new::<R>("GlappDetector");
    detector.set_all(&[("Enable", 1.0), ("H", 0.25), ("K", 1.0), ("Ti", 1.0), ("HasMaxH", 1.0), ("MaxH", 1.0)]);
    detector.set_all(&[("HasPvSpan", 1.0), ("PvSpan", 1e30), ("HasOpSpan", 1.0), ("OpSpan", 1e-30)]);
    detector.call();
    assert_eq!(detector.get("ErrorID"), 5.0);
    let shown = [0.0, 1.0].map(|clear| {
        let half = Block::new::<R>("GlappHalfPeriod");
        half.set_all(&[("Open", 1.0), ("SlopeFits", 1.0), ("Take", 1.0), ("H", 0.5), ("E", 2.0), ("Sp", 1.0)]);
        half.call();
        half.set_all(&[("Open", 0.0), ("Sp", 3.0), ("E", 4.0)]);
        half.call();
        half.set_all(&[("BreakOff", 1.0), ("Clear", clear), ("BrokenGap", 1.0), ("Take", 0.0)]);
        half.call();
        half.all(&["Half.DeltaT", "Half.DeltaY", "Half.EMax", "Half.DeltaSp", "Half.SpChange", "Half.Gap"])
    });
    assert_eq!(shown, [[1.0, 3.0, 4.0, 2.0, 0.0, 1.0]; 2]);
}

/// The first of two settings out of bounds is named, in the order of the core.
fn two_wrong<R: Number>() {
    let wrong: [fn(&mut Pins); 6] = [
        |pins| pins.td = Some(-2.0),
        |pins| pins.kp = Some(f64::NAN),
        |pins| pins.k = 0.0,
        |pins| pins.ti = -1.0,
        |pins| pins.b = 2.0,
        |pins| pins.n = 4,
    ];
    for (first, one) in wrong.iter().enumerate() {
        for other in &wrong[first + 1..] {
            let mut pins = Pins { max_h: Some(1.0), ..Pins::default() };
            one(&mut pins);
            other(&mut pins);
            let (block, mut reference) = (Block::new::<R>("GlappDetector"), Reference::<R>::default());
            beside(&mut reference, &block, &pins, "two settings");
            assert!(block.on("Error"));
        }
    }
}

/// One scan of reference and block.
fn beside<R: Number>(reference: &mut Reference<R>, block: &Block, pins: &Pins, told: &str) {
    let (expected, got) = (reference.scan(pins), scan(block, pins));
    let agree = same(&expected.0, &got.0)
        && match (&expected.1, &got.1) {
            (Some(a), Some(b)) => same(a, b),
            (a, b) => a.is_none() && b.is_none(),
        };
    assert!(agree, "{told}:\n{got:?} instead of\n{expected:?}\nfor {pins:?}");
}

/// Signals and times of a few values, so that bounds are met exactly; a detector that begins anew in the middle of everything.
fn coarse<R: Number>(cover: &mut Cover) {
    for seed in 0..60 {
        let mut draw = Draw::new(60_000 + seed);
        let d = &mut draw;
        let mut usual = Loop::new(d).pins;
        usual.n = d.of(&[1, 3]);
        usual.ti = 0.25;
        usual.op_limits = d.of(&[None, Some((-1.0, 1.0))]);
        let (length, mut still) = (d.of(&[4, 6, 7]), 0);
        let (block, mut reference) = (Block::new::<R>("GlappDetector"), Reference::<R>::default());
        for i in 0..150 {
            let side = if (i / length) % 2 == 0 { 1.0 } else { -1.0 };
            let anew = d.chance(0.03);
            still = if anew && d.chance(0.5) { 3 } else { i32::max(still - 1, 0) };
            let reset = anew && d.chance(0.3);
            let mut pins = Pins { reset, restart: anew && !reset, ..usual.clone() };
            pins.pv = side * d.of(&[1.0, 1.0, 0.5, 0.0]);
            pins.op = pins.op.map(|_| side * d.of(&[1.0, 0.5, -1.0]));
            pins.sp = d.of(&[0.0, 0.0, 0.0, 0.0, 0.5]);
            pins.flags = d.of(&[0, 0, 0, 0, 0, 0, 0, 0, 1, 2, 4, 8]);
            let h = d.of(&[0.25, 0.25, 0.25, 0.25, 0.25, 0.25, 0.25, 0.25, 0.0, 0.75, 1e9, 1.5e9]);
            pins.h = if still > 0 { 0.0 } else { h };
            beside(&mut reference, &block, &pins, &format!("coarse {seed}, scan {i}"));
        }
        cover.collect(&block);
    }
    // The usual time between scans is the longest that there is, or one longer.
    for h in [1e9, 1.5e9, 3e8] {
        let (block, mut reference) = (Block::new::<R>("GlappDetector"), Reference::<R>::default());
        for i in 0..6 {
            let pins = Pins { h: if i < 3 { h } else { 0.25 }, ..Pins::default() };
            beside(&mut reference, &block, &pins, &format!("{h}, scan {i}"));
        }
    }
}

/// A signal that breaks in some scans in a row, up to twelve: from the tenth on that is an error, until it is whole.
fn stretches<R: Number>(cover: &mut Cover) {
    let mut shown = [0; 84];
    for seed in 0..60 {
        let mut draw = Draw::new(80_000 + seed);
        let d = &mut draw;
        let mut signals = Loop::new(d);
        let (block, mut reference) = (Block::new::<R>("GlappDetector"), Reference::<R>::default());
        let (mut left, mut way) = (0, 0);
        for i in 0..150 {
            let mut pins = signals.next::<R>(d).clone();
            if left == 0 && d.chance(0.1) {
                (left, way) = (d.of(&[1, 9, 10, 12]), d.of(&[0, 1, 2, 3, 4, 5, 6, 7]));
            }
            if left > 0 {
                left -= 1;
                // Scans without time, and those in which it is off, between them.
                match d.of(&[0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 2]) {
                    1 => pins.h = 0.0,
                    2 => pins.enable = false,
                    _ => breaks_off(&mut pins, way),
                }
            }
            beside(&mut reference, &block, &pins, &format!("stretches {seed}, scan {i}"));
            shown[block.get("ErrorID") as usize] += 1;
        }
        cover.collect(&block);
    }
    assert!(shown[12] > 20 && shown[83] > 20, "{shown:?}");
}

/// What a programmer sees of a signal that stays bad, and of a scan time that stays wrong.
fn stays_bad<R: Number>() {
    for (way, reason, number) in [(0, 1.0, 12.0), (1, 1.0, 12.0), (2, 1.0, 12.0), (3, 2.0, 83.0), (7, 2.0, 83.0)] {
        let block = Block::new::<R>("GlappDetector");
        let good = Pins { max_h: Some(1.0), ..Pins::default() };
        let mut pins = good.clone();
        breaks_off(&mut pins, way);
        let shown = |pins: &Pins| {
            scan(&block, pins);
            block.all(&["Valid", "Error", "ErrorID", "BreakReason"])
        };
        // The first scan of all has none before it.
        assert_eq!([shown(&good), shown(&good)], [[1.0, 0.0, 0.0, 1.0], [1.0, 0.0, 0.0, 0.0]]);
        for _ in 0..9 {
            assert_eq!(shown(&pins), [1.0, 0.0, 0.0, reason], "{way}");
        }
        for _ in 0..20 {
            assert_eq!(shown(&pins), [0.0, 1.0, number, reason], "{way}");
        }
        // A setting that is out of bounds is named before it.
        assert_eq!(shown(&Pins { k: 0.0, ..pins.clone() }), [0.0, 1.0, 1.0, reason]);
        assert_eq!(shown(&Pins { enable: false, ..pins.clone() }), [0.0, 0.0, 0.0, reason]);
        assert_eq!(shown(&pins)[1], 0.0, "it counts anew");
        // After a stretch of bad values the first good one is used.
        assert_eq!(shown(&good), [1.0, 0.0, 0.0, 0.0], "{way}");
    }
}

/// Flags in a scan without time count for the half-period under way, not for the first one after a new start.
fn told_before_it_begins_anew<R: Number>() {
    for flags in [1, 2, 4, 8] {
        let usual = Pins { ti: 0.25, max_h: Some(1.0), ..Pins::default() };
        let (block, mut reference) = (Block::new::<R>("GlappDetector"), Reference::<R>::default());
        for i in 0..60 {
            let mut pins = Pins { pv: if i / 6 % 2 == 0 { 1.0 } else { -1.0 }, restart: i == 22, ..usual.clone() };
            if i == 21 {
                (pins.h, pins.flags) = (0.0, flags);
            }
            beside(&mut reference, &block, &pins, &format!("told {flags}, scan {i}"));
        }
    }
}

/// A gap that becomes smaller again and again, alone and with half-periods between that count neither way: what is too small at first takes
/// the place of what was there.
fn smaller_and_smaller<R: Number>(cover: &mut Cover) {
    let mut turned = 0;
    for (seed, n) in [1, 1, 3, 3, 3, 5, 5, 5].into_iter().enumerate() {
        let mut draw = Draw::new(70_000 + seed as u64);
        let d = &mut draw;
        let conditions = Conditions { decaying: false, growing: false, ..Conditions::default() };
        let usual = Pins { ti: 0.3, tf: Some(0.0), max_h: Some(1.0), conditions, ..Pins::default() };
        let usual = Pins { n, h: d.of(&[0.25, 0.125]), kp: d.of(&[None, Some(2.0)]), ..usual };
        let (noise, scatter, between) = (d.of(&[0.0, 0.005]), d.of(&[0.0, 0.5]), seed % 2 == 1);
        let length = (1.75 / usual.h) as usize;
        let (block, mut reference) = (Block::new::<R>("GlappDetector"), Reference::<R>::default());
        let span = if between { 50 } else { 12 };
        for half in 0..if between { 2 * span } else { 5 * span } {
            let size = 0.3_f64.powi(half / span) * (1.0 + scatter * d.between(-1.0, 1.0));
            let side = if half % 2 == 0 { 1.0 } else { -1.0 };
            // Longer, and not square: only its time is taken off.
            let other = between && half % 3 == 0;
            for i in 0..if other { 4 * length } else { length } {
                let peak = if other && i == 1 { 4.0 } else { 1.0 };
                let pins = Pins { pv: side * size * peak + noise * size * d.between(-1.0, 1.0), ..usual.clone() };
                beside(&mut reference, &block, &pins, &format!("smaller {seed}, half-period {half}"));
                turned += usize::from(block.peek("Turned") != 0.0);
            }
        }
        cover.collect(&block);
    }
    assert!(turned > 0);
}

/// A program with another version of the retained variables is loaded: they are dropped, and that is told.
fn another_version<R: Number>(cover: &mut Cover) {
    let block = Block::new::<R>("GlappDetector");
    let mut draw = Draw::new(3);
    let mut signals = Loop::new(&mut draw);
    let pins = signals.next::<R>(&mut draw).clone();
    scan(&block, &pins);
    assert!(!block.on("Dropped"));
    for (version, dropped) in [(1, false), (2, true)] {
        block.0.borrow_mut().power_cut();
        for (name, value) in
            [("StateVersion", version), ("Count", 7), ("Known", 1), ("Found.Count", 1), ("LevelKnown", 1), ("Level", 7)]
        {
            block.0.borrow_mut().spoil(name, value.into()).unwrap();
        }
        scan(&block, &pins);
        let (kept, level) = if dropped { (0.0, -1.0) } else { (7.0, 7.0) };
        let shown = block.all(&["Dropped", "Accepted", "HasEstimate", "NoiseFloor"]);
        assert_eq!(shown, [f64::from(dropped), kept, f64::from(!dropped), level]);
    }
    scan(&block, &Pins { reset: true, ..pins });
    assert!(!block.on("Dropped"));
    cover.collect(&block);
}

fn detectors<R: Number>(cover: &mut Cover) {
    let mut cost = Cost::default();
    let (mut accepted, mut records, mut refused) = (0.0, 0, 0);
    for seed in 0..sequences() {
        let mut draw = Draw::new(1000 + seed);
        let mut signals = Loop::new(&mut draw);
        let (block, mut reference) = (Block::new::<R>("GlappDetector"), Reference::<R>::default());
        for i in 0..400 {
            if draw.chance(0.001) {
                block.0.borrow_mut().power_cut();
                reference.power_cut();
            }
            let pins = signals.next::<R>(&mut draw);
            let (expected, got) = (reference.scan(pins), cost.of(&block, || scan(&block, pins)));
            let agree = same(&expected.0, &got.0)
                && match (&expected.1, &got.1) {
                    (Some(a), Some(b)) => same(a, b),
                    (a, b) => a.is_none() && b.is_none(),
                };
            assert!(agree, "sequence {seed}, scan {i}:\n{got:?} instead of\n{expected:?}\nfor {pins:?}");
            records += usize::from(got.1.is_some());
            refused += usize::from(block.on("Error"));
        }
        accepted += block.get("Accepted");
        cover.collect(&block);
    }
    println!("{records} half-periods, {accepted} accepted in the end, {refused} scans with a setting out of bounds");
    cost.tell::<R>("GlappDetector");
    assert!(accepted > 2.0 * sequences() as f64 && refused as u64 > sequences());
}

in_both!(lreal, real: all);
