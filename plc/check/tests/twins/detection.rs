//! Detection with compensation and the corrected width: every vector and random sequences beside the core, the same bits in LREAL and
//! REAL.

use crate::common::compensate::{Settings, core, library};
use crate::common::cover::{Cost, Cover, sequences};
use crate::common::detection::{Foreign, Loop, Pins, Reference, agree, scan};
use crate::common::{Block, Case, Draw, Number, cases, compare, compensate, detector, same};
use glapp_core::modules::{self, Backward, Mode, PidSettings};
use glapp_core::status::AT_HIGH;
use glapp_core::{
    CompensationSettings, Conditions, Correction, CorrectionState, HalfPeriod, HalfPeriodResult, Pair, Way, corrected,
};
use glapp_plc_check::Build;
use serde_json::json;

const POUS: [&str; 6] = [
    "GlappSwing",
    "GlappCorrected",
    "GlappCorrection",
    "GlappBacklashDetection",
    "GlappBacklashDetectionCheck",
    "GlappForeignDetection",
];

/// Whether OP is read in the case: without it the library makes no corrected width.
fn read(case: &Case) -> bool {
    case.input.iter().all(|(_, x)| !x[2].is_nan())
}

fn every_case<R: Number>() {
    let with_vectors = R::BUILD == Build::Lreal;
    for block in ["swing", "correction"] {
        let cases: Vec<Case> = cases(block).into_iter().filter(|case| block != "swing" || read(case)).collect();
        assert!(cases.len() >= 5, "{block}: {}", cases.len());
        for case in cases {
            compare(&case, core::<R>(block, &case), library::<R>(block, &case).0, with_vectors);
        }
    }
}

fn compensation(case: &Case) -> Option<Settings> {
    let (k, ti) = (case.given("k"), case.given("ti"));
    if case.param("comp_source") == Some(3.0) {
        return Some(Settings { k, ti, source: 3, ..Settings::default() });
    }
    let size = case.param("comp_size")?;
    let way = if case.param("comp_way") == Some(1.0) { Way::Error } else { Way::Inverse };
    let usual = CompensationSettings::new(way, k, ti, size, 1.0);
    Some(Settings {
        k,
        ti,
        size,
        way: usual.way as i16,
        band: case.param("comp_band"),
        rate: case.param("comp_rate"),
        ..Settings::default()
    })
}

fn pins(case: &Case, max_h: f64, td: f64) -> Pins {
    Pins {
        detector: detector::Pins {
            k: case.param("detector_k").unwrap_or(case.given("k")),
            ti: case.given("ti"),
            td: Some(td),
            tf: Some(case.given("detector_tf")),
            kp: case.param("kp"),
            n: case.given("n") as i16,
            op_limits: case.param("low").zip(case.param("high")),
            max_h: Some(max_h),
            ..detector::Pins::default()
        },
        compensate: false,
        compensation: compensation(case),
        cut: false,
        foreign: None,
    }
}

/// Fields that the vectors have of a detection.
fn row(block: &Block) -> Vec<f64> {
    let mut row = vec![block.get("UFf"), block.given("HasShown", "Estimate.Value")];
    row.push(if block.on("HasShown") { block.get("Estimate.Count") } else { 0.0 });
    row.push(block.given("HasNoiseFloor", "NoiseFloor"));
    row.push(block.given("HasWholeShown", "Whole.Value"));
    row.extend([block.get("Standing"), block.get("Equal") + 2.0 * block.get("Relay"), 256.0 * block.get("WrongSign")]);
    row
}

fn expected(case: &Case, i: usize, from: usize) -> Vec<f64> {
    let row = case.output.as_ref().unwrap()[i].as_array().unwrap();
    row[from..].iter().map(|x| x.as_f64().unwrap_or(f64::NAN)).collect()
}

/// Beside a controller of ours, which is the core's here: it takes the u_FF that the block made in the scan before.
fn own<R: Number>() {
    let with_vectors = R::BUILD == Build::Lreal;
    for case in cases("backlash_detection") {
        let r = |x: f64| R::of(x);
        let or = |name: &str, usual: R| case.param(name).map_or(usual, r);
        let td = case.param("td").unwrap_or(0.0);
        let usual = PidSettings::ideal(r(case.given("k")), r(case.given("ti")), r(td));
        let settings = PidSettings {
            b: or("b", usual.b),
            c: or("c", usual.c),
            tf: or("tf", usual.tf),
            low: or("low", usual.low),
            high: or("high", usual.high),
            rate: or("rate", usual.rate),
            ..usual
        };
        let pid = modules::Pid::new(settings).unwrap();
        let mut state = modules::PidState::at(r(case.given("start")));
        let mut pins = pins(&case, settings.max_h.as_f64(), td);
        let (block, mut reference) = (Block::new::<R>("GlappBacklashDetection"), Reference::<R>::default());
        for (i, (h, x)) in case.input.iter().enumerate() {
            let &[pv, sp, mode, manual, flags, enable] = &x[..] else { panic!("six inputs") };
            if !mode.is_nan() {
                state.mode = [Mode::Manual, Mode::Auto, Mode::External][mode as usize];
            }
            if !manual.is_nan() {
                state.manual = r(manual);
            }
            let u_ff = r(block.get("UFf"));
            let u = pid.forward(&mut state, r(pv).into(), r(sp).into(), u_ff.into(), r(*h)).value;
            let (_, ff) = pid.backward(&mut state, Backward { flags: flags as u16, ..Backward::default() });
            pins.compensate = enable != 0.0;
            pins.detector =
                detector::Pins { h: *h, sp, pv, op: Some(ff.tracking.as_f64()), flags: ff.flags & 13, ..pins.detector };
            let (expected_now, got) = (reference.scan(&pins), scan(&block, &pins));
            assert!(agree(&expected_now, &got), "{}, scan {i}:\n{got:?} instead of\n{expected_now:?}", case.name);
            if with_vectors {
                let (wanted, shown) = (expected(&case, i, 0), [&[u.as_f64()][..], &row(&block)].concat());
                assert!(same(&wanted, &shown), "{}, scan {i}: {shown:?} instead of {wanted:?}", case.name);
            }
        }
    }
}

fn beside_another<R: Number>() {
    let with_vectors = R::BUILD == Build::Lreal;
    for case in cases("foreign_detection") {
        let mut pins = pins(&case, case.given("ti") / 2.0, 0.0);
        let mut foreign = Foreign {
            delay: case.given("delay") as i16,
            tolerance: case.param("tolerance"),
            longest: case.param("longest"),
            back: None,
        };
        let (block, mut reference) = (Block::new::<R>("GlappForeignDetection"), Reference::<R>::default());
        for (i, (h, x)) in case.input.iter().enumerate() {
            let &[pv, sp, op, flags, back, enable] = &x[..] else { panic!("six inputs") };
            foreign.back = (case.given("read_back") == 1.0).then_some(back);
            pins.foreign = Some(foreign.clone());
            pins.compensate = enable != 0.0;
            pins.detector = detector::Pins { h: *h, sp, pv, op: Some(op), flags: flags as u16, ..pins.detector };
            let (expected_now, got) = (reference.scan(&pins), scan(&block, &pins));
            assert!(agree(&expected_now, &got), "{}, scan {i}:\n{got:?} instead of\n{expected_now:?}", case.name);
            if with_vectors {
                let (wanted, shown) = (expected(&case, i, 0), [&row(&block)[..], &[block.get("Delta")]].concat());
                assert!(same(&wanted, &shown), "{}, scan {i}: {shown:?} instead of {wanted:?}", case.name);
            }
        }
    }
}

in_both!(vectors_lreal, vectors_real: every_case, own, beside_another);

/// A limit cycle with another amplitude in every half-period, of which the pairs lie on a line, nearly or not at all. OP and PV by so
/// much larger.
fn drawn(block: &str, d: &mut Draw, (of_op, of_pv): (f64, f64)) -> Case {
    let k: f64 = d.of(&[1.2, -1.2]);
    let mut params = json!({ "k": k, "ti": 5.0, "b": 1.0 });
    if d.chance(0.4) {
        params["kp"] = d.of(&[-1.6, 1.6, 1.6, 0.2, 1e-37]).into();
    }
    if d.chance(0.05) {
        params["integrating"] = 1.into();
    }
    let (scatter, spread, width) =
        (d.of(&[0.0, 0.02, 0.1, 0.25, 0.5]), d.of(&[0.0, 0.2, 0.6, 0.8]), d.of(&[2.0, 2.0, 0.5, 0.05]));
    let (noise, slope, wrong) = (d.of(&[0.0, 0.0, 0.02, 0.3]), d.of(&[0.6, 0.6, 0.6, -0.4]), d.of(&[0.0, 0.0, 0.02]));
    let length = d.of(&[5, 9]);
    let sizes: Vec<f64> = (0..20).map(|_| 1.0 + spread * d.between(-1.0, 1.0)).collect();
    let (mut side, mut turn) = (1.0, 0.0);
    let input = (0..length * 18).map(|i| {
        let half = i / length;
        let ends = i > 0 && i % length == 0;
        let ended = if ends { side } else { 0.0 };
        if ends {
            side = -side;
        }
        if i % length == 0 {
            let travel = width + slope * (sizes[half] + sizes[half + 1]) + scatter * d.between(-1.0, 1.0);
            turn += side * k.signum() * travel;
        }
        let op = of_op * (turn + noise * d.between(-1.0, 1.0));
        let flags = if d.chance(wrong) { d.of(&[1.0, 2.0, 16.0]) } else { 0.0 };
        let mask = if d.chance(wrong) { d.of(&[1.0, 2.0, 4.0, 8.0, 16.0, 64.0, 128.0]) } else { 0.0 };
        let h = if d.chance(wrong) { d.of(&[0.0, -1.0, 3.0]) } else { 0.5 };
        let before = of_pv * if half > 0 { sizes[half - 1] } else { 1.0 };
        let y = if d.chance(wrong) { 0.3 * before } else { before };
        let (missing, shown) = (f64::from(u8::from(d.chance(wrong))), f64::from(u8::from(!d.chance(wrong))));
        (h, vec![0.0, -side * of_pv * sizes[half], op, ended, flags, mask, y, missing, shown])
    });
    let input = input.collect();
    Case { name: block.to_owned(), params, input, output: None }
}

/// Numbers so small and so large that what is worked out of them is none: no run stops. In REAL what overflows is what overflows in
/// the core; LREAL in the core goes on to 1E308.
fn extremes<R: Number>(cover: &mut Cover) {
    for seed in 0..sequences() {
        let mut draw = Draw::new(90_000 + seed);
        let scales = (draw.of(&[1.0, 1e9, 3e9, 1e10, 1e-30]), draw.of(&[1.0, 1e9, 3e9, 1e-12, 1e-20, 1e-30]));
        let case = drawn("correction", &mut draw, scales);
        let (mut scan, block) = library::<R>("correction", &case);
        block.unheld();
        for (h, x) in &case.input {
            scan(x, *h);
        }
        cover.collect(&block);
    }
    let block = Block::new::<R>("GlappSwing");
    block.set_all(&[("K", 1.0), ("H", 1e9), ("Yf", -1e12), ("Take", 1.0)]);
    (0..1100).for_each(|_| block.call());
    block.set_all(&[("Ends", 1.0), ("Sign", 1.0), ("H", 1.0), ("Yf", 2.0)]);
    block.call();
    assert_eq!((block.get("Plateau"), block.on("HasTravel")), (0.0, false));
    // The next one is measured again.
    for (ends, sign) in [(0.0, 1.0), (0.0, 1.0), (1.0, -1.0)] {
        block.set_all(&[("Ends", ends), ("Sign", sign)]);
        block.call();
    }
    assert!((block.get("Plateau") - 2.0).abs() < 1e-6, "{}", block.get("Plateau"));
    cover.collect(&block);
}

/// Endless settings and signals of a detection, alone and beside another maker's controller.
fn endless<R: Number>(cover: &mut Cover) {
    let ends = [1.0, 1.0, 1e30, 1e-30, 9e36];
    for seed in 0..sequences() {
        let mut draw = Draw::new(95_000 + seed);
        let d = &mut draw;
        let size = d.of(&[1.0, 1e11, 1e-25]);
        let detector = detector::Pins {
            k: d.of(&[0.5, 1e30, -1e-30]),
            ti: d.of(&ends),
            kp: d.of(&[None, Some(1e36), Some(1e-30)]),
            n: 1,
            max_h: Some(1e9),
            h: d.of(&[0.25, 1e8]),
            op_limits: d.of(&[None, Some((-9e36, 9e36)), Some((-2.0, 2.0))]),
            conditions: Conditions { too_short: false, decaying: false, growing: false, ..Conditions::default() },
            ..detector::Pins::default()
        };
        let compensation = Settings {
            source: d.of(&[1, 3]),
            size: d.of(&[0.0, 1.0, 1e11]),
            most: Some(1e36),
            band: Some(0.0),
            rate: d.of(&[None, Some(1e36)]),
            release: Some(d.of(&ends)),
            watch: Some(d.of(&ends)),
            ..Settings::default()
        };
        let longest = Some(1e36);
        let foreign =
            (seed % 2 == 0).then(|| Foreign { delay: d.of(&[1, 32]), tolerance: Some(9e36), longest, back: Some(0.0) });
        let mut pins = Pins { detector, compensate: false, compensation: Some(compensation), cut: false, foreign };
        let block = Block::new::<R>(pins.name());
        block.unheld();
        for i in 0..120 {
            let side = if (i / 6) % 2 == 0 { 1.0 } else { -1.0 };
            pins.compensate = i > 20;
            pins.detector.pv = size * (side + d.between(-0.1, 0.1));
            pins.detector.op = Some(d.of(&[side, side, size * side, 9e11, -1e36]));
            if let Some(foreign) = &mut pins.foreign {
                foreign.tolerance = d.of(&[Some(0.0), Some(9e36)]);
                foreign.back = d.of(&[Some(0.0), Some(9e11), Some(-9e11), Some(1e36), None]);
            }
            scan(&block, &pins);
        }
        cover.collect(&block);
    }
}

/// Each number by itself so large that it is one, and beyond what can be measured.
fn large<R: Number>(cover: &mut Cover) {
    type Put = Box<dyn Fn(&mut Pins, f64)>;
    let of_detector = detector::NUMBERS
        .into_iter()
        .map(|put| -> Put { Box::new(move |p: &mut Pins, x: f64| put(&mut p.detector, x)) });
    let own: [fn(&mut Pins, f64); 3] = [
        |p, x| p.foreign.iter_mut().for_each(|foreign| foreign.tolerance = Some(x)),
        |p, x| p.foreign.iter_mut().for_each(|foreign| foreign.longest = Some(x)),
        |p, x| p.foreign.iter_mut().for_each(|foreign| foreign.back = Some(x)),
    ];
    let of_settings = compensate::NUMBERS.into_iter().map(|put| -> Put {
        Box::new(move |p: &mut Pins, x: f64| p.compensation.iter_mut().for_each(|settings| put(settings, x)))
    });
    let own = own.into_iter().map(|put| -> Put { Box::new(put) });
    for (number, put) in of_detector.chain(of_settings).chain(own).enumerate() {
        for (foreign, value) in [(false, 1e33), (true, 1e33), (true, -1e33), (false, 0.0), (true, 0.0)] {
            let foreign = foreign.then_some(Foreign { delay: 1, tolerance: None, longest: None, back: Some(0.0) });
            let settings = Settings { size: 1.0, ..Settings::default() };
            let usual = Pins {
                detector: detector::Pins { kp: Some(2.0), n: 1, max_h: Some(1.0), ..detector::Pins::default() },
                compensate: false,
                compensation: Some(settings),
                cut: false,
                foreign,
            };
            let (block, mut reference) = (Block::new::<R>(usual.name()), Reference::<R>::default());
            for i in 0..14 {
                let side = if (i / 6) % 2 == 0 { 1.0 } else { -1.0 };
                let mut pins = Pins { compensate: i > 2, ..usual.clone() };
                (pins.detector.pv, pins.detector.op) = (side, Some(side));
                if (6..9).contains(&i) {
                    put(&mut pins, value);
                }
                let (expected, got) = (reference.scan(&pins), scan(&block, &pins));
                assert!(
                    agree(&expected, &got),
                    "number {number}, {value}, scan {i}:\n{got:?} instead of\n{expected:?}\nfor {pins:?}"
                );
            }
            cover.collect(&block);
        }
    }
}

/// A compensation that is refused for each of its numbers, and then taken out of the settings.
fn taken_out<R: Number>(cover: &mut Cover) {
    for (number, put) in compensate::NUMBERS.into_iter().enumerate() {
        for (foreign, value) in [(false, -1e33), (true, -1e33), (true, f64::NAN)] {
            let foreign = foreign.then_some(Foreign { delay: 1, tolerance: None, longest: None, back: Some(0.0) });
            let detector = detector::Pins { kp: Some(2.0), n: 1, max_h: Some(1.0), ..detector::Pins::default() };
            let mut pins = Pins { detector, compensate: false, compensation: None, cut: false, foreign };
            let (block, mut reference) = (Block::new::<R>(pins.name()), Reference::<R>::default());
            for i in 0..20 {
                let side = if (i / 6) % 2 == 0 { 1.0 } else { -1.0 };
                let mut settings = Settings { size: 1.0, withdraw: false, lessen: false, ..Settings::default() };
                if i > 6 {
                    put(&mut settings, value);
                }
                pins.compensate = i > 2;
                (pins.detector.pv, pins.detector.op) = (side, Some(side));
                pins.compensation = (i < 10).then_some(settings);
                let (expected, got) = (reference.scan(&pins), scan(&block, &pins));
                assert!(
                    agree(&expected, &got),
                    "number {number}, {value}, scan {i}:\n{got:?} instead of\n{expected:?}\nfor {pins:?}"
                );
                if !block.on("Error") {
                    reference.remembers(&block, &pins);
                }
            }
            cover.collect(&block);
        }
    }
}

/// Signals and times of a few values, so that bounds are met exactly; a detection that begins anew in the middle of everything.
fn coarse<R: Number>(cover: &mut Cover) {
    for seed in 0..80 {
        let mut draw = Draw::new(80_000 + seed);
        let d = &mut draw;
        let settings = Settings {
            way: d.of(&[1, 2, 3]),
            source: d.of(&[1, 3]),
            size: 2.0,
            band: d.of(&[Some(0.0), None]),
            ..Settings::default()
        };
        // The second half with other filters, gains by default, conditions left out, and no compensation at the end.
        let more = seed >= 40;
        let foreign = (seed % 2 == 0).then(|| Foreign {
            delay: d.of(&[1, 2, 3]),
            tolerance: d.of(&[None, Some(0.25)]),
            longest: d.of(&[None, Some(0.75)]),
            back: Some(0.0),
        });
        let detector = detector::Pins {
            ti: 0.25,
            tf: Some(d.of(&[0.0, 0.25])),
            n: d.of(&[1, 3]),
            kp: d.of(&[None, Some(2.0)]),
            max_h: d.of(&[None, Some(1.0)]),
            op_limits: d.of(&[None, Some((-1.0, 1.0)), Some((-2.0, 2.0))]),
            ..detector::Pins::default()
        };
        let mut usual = Pins { detector, compensate: false, compensation: Some(settings), cut: false, foreign };
        if more {
            let p = &mut usual.detector;
            (p.pv_span, p.op_span, p.tf) = (Some(3.0), Some(2.0), d.of(&[Some(0.125), Some(0.0), Some(0.25)]));
            for name in Conditions::NAMES {
                *p.conditions.switch(name).unwrap() = d.chance(0.6);
            }
        }
        let (block, mut reference) = (Block::new::<R>(usual.name()), Reference::<R>::default());
        let length = if more { d.of(&[2, 3, 4, 5]) } else { d.of(&[4, 6, 7]) };
        let (mut still, mut handed) = (0, vec![0.0; 4]);
        for i in 0..120 {
            let side = if (i / length) % 2 == 0 { 1.0 } else { -1.0 };
            let anew = d.chance(if more { 0.01 } else { 0.02 });
            still = if anew && d.chance(0.5) { 3 } else { i32::max(still - 1, 0) };
            let reset = anew && d.chance(0.5);
            let mut pins = Pins { compensate: i % 60 > 20, ..usual.clone() };
            let p = &mut pins.detector;
            (p.reset, p.restart) = (reset, anew && !reset);
            p.pv = side * d.of(&[1.0, 1.0, 1.0, 0.5, 0.0]);
            p.op = Some(side * d.of(&[1.0, 1.0, 0.5, 2.0]));
            p.flags = d.of(&[0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 2, 4, 8]);
            let h = d.of(&[0.25, 0.25, 0.25, 0.25, 0.25, 0.25, 0.25, 0.25, 0.25, 0.25, 0.0, 0.75, 1e9, 1.5e9]);
            p.h = if still > 0 { 0.0 } else { h };
            if more {
                p.pv = side * d.of(&[1.0, 1.0, 1.5]);
                p.op = Some(side * d.of(&[1.0, 1.0, 0.0]));
                p.h = if p.h == 0.75 { 1.0 } else { p.h };
                if i >= 100 {
                    pins.compensation = None;
                }
            }
            if let Some(foreign) = &mut pins.foreign {
                // The value handed over, mostly; for a while something else.
                let there = handed[handed.len() - foreign.delay as usize];
                foreign.back = Some(if i % 17 < 10 { there } else { there + d.of(&[0.0, 0.15, 0.25, 0.5, f64::NAN]) });
            }
            let (expected, got) = (reference.scan(&pins), scan(&block, &pins));
            assert!(agree(&expected, &got), "coarse {seed}, scan {i}:\n{got:?} instead of\n{expected:?}\nfor {pins:?}");
            if i % 4 == 3 && !block.on("Error") {
                block.remembers(&reference.state.detection.compensation, &[("/pressed", "FrozenWidth")]);
            }
            if more && i % 2 == 1 && !block.on("Error") {
                reference.remembers(&block, &pins);
            }
            handed.push(block.get("UFf"));
        }
        cover.collect(&block);
    }
    // The usual time between scans is the longest that there is, or longer.
    for (foreign, h) in [(false, 1e9), (false, 1.5e9), (false, 3e8), (true, 1e9), (true, 1.5e9), (true, 3e8)] {
        let foreign = foreign.then_some(Foreign { delay: 1, tolerance: None, longest: None, back: None });
        let detector = detector::Pins { op: Some(0.0), ..detector::Pins::default() };
        let mut pins = Pins { detector, compensate: false, compensation: None, cut: false, foreign };
        let (block, mut reference) = (Block::new::<R>(pins.name()), Reference::<R>::default());
        for i in 0..6 {
            pins.detector.h = if i < 3 { h } else { 0.25 };
            let (expected, got) = (reference.scan(&pins), scan(&block, &pins));
            assert!(agree(&expected, &got), "{h}, scan {i}:\n{got:?} instead of\n{expected:?}");
        }
    }
}

/// Results, warnings and filters from before are gone after Reset, or Restart, as far as that goes; a new warning needs
/// new half-periods.
fn begins_anew<R: Number>(cover: &mut Cover) {
    let mut warned = [false; 2];
    for (foreign, reset, at) in [(false, true, 230), (false, false, 230), (true, true, 233), (true, false, 233)] {
        // Enabled after enough half-periods to compare with, or at once; PV that calls for less travel than is compensated.
        for (enabled, size) in [(100, 0.1), (4, 0.4), (4, 0.02)] {
            let settings = Settings { size: 2.0, band: Some(0.0), ..Settings::default() };
            let foreign = foreign.then_some(Foreign { delay: 1, tolerance: None, longest: None, back: None });
            let usual = detector::Pins { ti: 0.25, n: 1, max_h: Some(1.0), ..detector::Pins::default() };
            let compensation = Some(settings);
            let mut pins = Pins { detector: usual, compensate: false, compensation, cut: false, foreign };
            let (block, mut reference) = (Block::new::<R>(pins.name()), Reference::<R>::default());
            for i in 0..300 {
                let side = if (i / 6) % 2 == 0 { 1.0 } else { -1.0 };
                let p = &mut pins.detector;
                // Smoothed by a long filter until it begins anew.
                (p.tf, p.reset, p.restart) =
                    (Some(if i < at { 0.2 } else { 0.1 }), i == at && reset, i == at && !reset);
                p.pv = side * if i < enabled { 1.0 } else { size };
                p.op = Some(side * if i < enabled { 1.0 } else { 0.02 } + block.get("UFf"));
                pins.compensate = i > enabled;
                let (expected, got) = (reference.scan(&pins), scan(&block, &pins));
                assert!(agree(&expected, &got), "{at}, scan {i}:\n{got:?} instead of\n{expected:?}\nfor {pins:?}");
                warned[usize::from(i >= at)] |= block.on("Relay");
            }
            cover.collect(&block);
        }
    }
    for at in 228..236 {
        // Begins anew without Enable, while a pair is still to be worked off or not; a relay that withdraws nothing.
        let settings = Settings { size: 2.0, band: Some(0.0), withdraw: false, ..Settings::default() };
        let usual = detector::Pins { ti: 0.25, n: 1, max_h: Some(1.0), kp: Some(2.0), ..detector::Pins::default() };
        let mut pins =
            Pins { detector: usual, compensate: false, compensation: Some(settings), cut: false, foreign: None };
        let (block, mut reference) = (Block::new::<R>(pins.name()), Reference::<R>::default());
        for i in 0..250 {
            let side = if (i / 6) % 2 == 0 { 1.0 } else { -1.0 };
            let p = &mut pins.detector;
            (p.restart, p.enable) = (i == at, !(at..at + 4).contains(&i));
            p.pv = side * if i < 4 { 1.0 } else { 0.4 + 0.1 * f64::from(i / 12 % 3) };
            p.op = Some(side * 0.3 + block.get("UFf"));
            pins.compensate = i > 4;
            let (expected, got) = (reference.scan(&pins), scan(&block, &pins));
            assert!(agree(&expected, &got), "{at}, scan {i}:\n{got:?} instead of\n{expected:?}\nfor {pins:?}");
        }
        cover.collect(&block);
    }
    assert!(warned[0], "nothing is warned of");
}

/// PV goes away while OP stands at a limit that it has come to from near and from far; then what comes without OP, or is not enabled.
fn wrong_signs<R: Number>(cover: &mut Cover) {
    let mut found = [0; 2];
    for (number, way) in [0.3, 0.5, 0.7, 0.9, 1.1, 3.0].into_iter().enumerate() {
        for (k, side, foreign) in [(0.5, 1.0, false), (-0.5, 1.0, false), (0.5, -1.0, true), (-0.5, -1.0, true)] {
            let foreign = foreign.then_some(Foreign { delay: 1, tolerance: None, longest: None, back: None });
            let limits = Some((-2.0, 2.0));
            let detector =
                detector::Pins { k, ti: 0.25, max_h: Some(1.0), op_limits: limits, ..detector::Pins::default() };
            let mut pins = Pins { detector, compensate: false, compensation: None, cut: false, foreign };
            let (block, mut reference) = (Block::new::<R>(pins.name()), Reference::<R>::default());
            let limit = side * 2.0 * f64::signum(k);
            for i in 0..44 {
                let p = &mut pins.detector;
                // On its way, at the limit, then without OP, not enabled, and with another error.
                let there = i >= 6;
                let away = if there { 1.0 + 0.1 * f64::from(i - 6) } else { 0.3 };
                p.pv = -side * if (26..30).contains(&i) { -0.5 } else { away };
                let begins = limit - way * limit.signum();
                p.op = Some(if there { limit } else { begins + 0.1 * way * limit.signum() * f64::from(i) / 5.0 });
                p.flags = if !there {
                    0
                } else if limit > 0.0 {
                    8
                } else {
                    4
                };
                if (24..34).contains(&i) {
                    (p.op, p.flags) = (None, 0);
                }
                p.enable = !(32..36).contains(&i);
                let (expected, got) = (reference.scan(&pins), scan(&block, &pins));
                assert!(agree(&expected, &got), "{number}, scan {i}:\n{got:?} instead of\n{expected:?}\nfor {pins:?}");
                if i == 23 {
                    found[usize::from(block.on("WrongSign"))] += 1;
                }
            }
            cover.collect(&block);
        }
    }
    assert!(found[0] >= 4 && found[1] >= 4, "{found:?}");
    // Results are gone after a new start.
    for (foreign, reset) in [(false, false), (false, true), (true, false), (true, true)] {
        let foreign = foreign.then_some(Foreign { delay: 1, tolerance: None, longest: None, back: None });
        let limits = Some((-2.0, 2.0));
        let detector = detector::Pins { ti: 0.25, max_h: Some(1.0), op_limits: limits, ..detector::Pins::default() };
        let mut pins = Pins { detector, compensate: false, compensation: None, cut: false, foreign };
        let (block, mut reference) = (Block::new::<R>(pins.name()), Reference::<R>::default());
        for i in 0..40 {
            let p = &mut pins.detector;
            (p.pv, p.op) = (if i < 6 { -0.3 } else { -1.0 - 0.1 * f64::from(i % 20) }, Some(f64::from(i.min(8)) / 4.0));
            p.flags = if i < 8 { 0 } else { AT_HIGH };
            (p.restart, p.reset) = (i == 20 && !reset, i == 20 && reset);
            let (expected, got) = (reference.scan(&pins), scan(&block, &pins));
            assert!(agree(&expected, &got), "scan {i}:\n{got:?} instead of\n{expected:?}\nfor {pins:?}");
            assert!(i != 19 || block.on("WrongSign"));
        }
        cover.collect(&block);
    }
}

/// The value read back is off while nothing is compensated, is not read for a while, and is enabled meanwhile; by each
/// way its longest delay.
fn read_back<R: Number>(cover: &mut Cover) {
    let mut standings = std::collections::BTreeSet::new();
    let usual = [(1, 1), (2, 1), (3, 2), (3, 3)].map(|(way, source)| (way, source, 10.0));
    for (way, source, ti) in usual.into_iter().chain([(1, 1, 1.6), (3, 1, 1.6), (3, 1, 2.5)]) {
        let settings = Settings { way, source, size: 1.0, band: Some(0.0), ..Settings::default() };
        let foreign = Foreign { delay: 2, tolerance: None, longest: None, back: None };
        let detector = detector::Pins { ti, max_h: Some(1.0), ..detector::Pins::default() };
        let mut pins =
            Pins { detector, compensate: false, compensation: Some(settings), cut: false, foreign: Some(foreign) };
        let (block, mut reference) = (Block::new::<R>(pins.name()), Reference::<R>::default());
        let mut handed = vec![0.0; 2];
        for i in 0..60 {
            let side = if (i / 5) % 2 == 0 { 1.0 } else { -1.0 };
            (pins.detector.pv, pins.detector.op) = (side, Some(side));
            pins.compensate = i > 13;
            let there = handed[handed.len() - 2];
            let off = if (5..12).contains(&i) { 0.5 } else { 0.0 };
            pins.foreign.as_mut().unwrap().back = (!(12..17).contains(&i)).then_some(there + off);
            let (expected, got) = (reference.scan(&pins), scan(&block, &pins));
            assert!(agree(&expected, &got), "{way}, {ti}, scan {i}:\n{got:?} instead of\n{expected:?}\nfor {pins:?}");
            standings.insert(block.get("Standing") as i16);
            handed.push(block.get("UFf"));
        }
        cover.collect(&block);
    }
    assert!([0, 1, 12].iter().all(|standing| standings.contains(standing)), "{standings:?}");
}

/// The estimate is the source, and what is read back is off by more and by less than a tenth of it.
fn estimate_read_back<R: Number>(cover: &mut Cover) {
    let mut standings = std::collections::BTreeSet::new();
    for seed in 0..4 {
        let settings = Settings { source: 3, band: Some(0.0), lessen: false, ..Settings::default() };
        let foreign = Foreign { delay: 1, tolerance: None, longest: None, back: None };
        let detector = detector::Pins {
            ti: 0.25,
            max_h: Some(1.0),
            n: 1,
            kp: Some(4.0),
            tf: Some(0.0),
            ..detector::Pins::default()
        };
        let mut pins =
            Pins { detector, compensate: false, compensation: Some(settings), cut: false, foreign: Some(foreign) };
        let (block, mut reference) = (Block::new::<R>(pins.name()), Reference::<R>::default());
        let mut handed = 0.0;
        for i in 0..260 {
            let side = if (i / 8) % 2 == 0 { 1.0 } else { -1.0 };
            // The detection is about 2; a scan is lost in between, and it begins anew once.
            let off = [0.0, 0.1, 0.15, 0.3, 0.0][(i / 20) as usize % 5] * f64::from(u8::from(i > 80));
            let there = handed + off * [1.0, -1.0, 1.5, 0.5][seed];
            (pins.detector.pv, pins.detector.op) = (side, Some(side + there));
            pins.detector.restart = i == 200;
            pins.compensate = i > 40 && i != 201;
            pins.foreign.as_mut().unwrap().back = (i % 20 != 0).then_some(there);
            let (expected, got) = (reference.scan(&pins), scan(&block, &pins));
            assert!(agree(&expected, &got), "{seed}, scan {i}:\n{got:?} instead of\n{expected:?}\nfor {pins:?}");
            block.remembers(&reference.state.detection.compensation, &[("/pressed", "FrozenWidth")]);
            standings.insert(block.get("Standing") as i16);
            handed = block.get("UFf");
        }
        cover.collect(&block);
    }
    assert!([0, 13].iter().all(|standing| standings.contains(standing)), "{standings:?}");
}

/// Kp is a default, and noise so large that its limit lies among the detections.
fn near_the_noise<R: Number>(cover: &mut Cover) {
    let mut shown = [0; 2];
    for seed in 0..12 {
        let mut draw = Draw::new(97_000 + seed);
        let d = &mut draw;
        let settings = Settings { source: 3, band: Some(0.0), ..Settings::default() };
        let usual = detector::Pins { ti: 0.25, max_h: Some(1.0), n: 3, tf: Some(0.0), ..detector::Pins::default() };
        let usual = detector::Pins { pv_span: Some(3.0), op_span: d.of(&[Some(0.5), Some(2.0)]), ..usual };
        let foreign = (seed % 3 == 2).then_some(Foreign { delay: 1, tolerance: None, longest: None, back: None });
        let mut pins = Pins { detector: usual, compensate: false, compensation: Some(settings), cut: false, foreign };
        let (block, mut reference) = (Block::new::<R>(pins.name()), Reference::<R>::default());
        let (noise, width) = (d.of(&[0.05, 0.1, 0.2, 0.3]), d.of(&[0.02, 0.05, 0.1]));
        for i in 0..260 {
            let side = if (i / 8) % 2 == 0 { 1.0 } else { -1.0 };
            let size = 0.4 + 0.1 * f64::from(i / 16 % 3);
            pins.detector.pv = side * size + noise * d.between(-1.0, 1.0);
            pins.detector.op = Some(side * (width + 0.2 * size) + block.get("UFf"));
            pins.compensate = i > 160;
            let (expected, got) = (reference.scan(&pins), scan(&block, &pins));
            assert!(agree(&expected, &got), "{seed}, scan {i}:\n{got:?} instead of\n{expected:?}\nfor {pins:?}");
            shown[usize::from(block.on("HasWholeShown"))] += usize::from(block.on("HasWhole"));
        }
        cover.collect(&block);
    }
    assert!(shown.iter().all(|count| *count > 50), "{shown:?}");
}

/// Pairs by themselves: a tenth one is left out. Half-periods that failed two conditions, and signals too large to be measured.
fn pairs<R: Number>(cover: &mut Cover) {
    let pairs = Block::new::<R>("GlappCorrected");
    let mut shown = vec![];
    for count in [9, 10] {
        pairs.set_all(&[("Clear", 1.0), ("Take", 0.0), ("Conclude", 0.0)]);
        pairs.call();
        assert!(shown.is_empty() || pairs.on("HasWidth"));
        pairs.set_all(&[("Clear", 0.0), ("Take", 1.0)]);
        for i in 0..count {
            // On a line but for the tenth.
            let travel = if i < 9 { 20.0 + f64::from(i) } else { 60.0 };
            pairs.set_all(&[("Travel", travel), ("Way", 1.0 + f64::from(i))]);
            pairs.call();
        }
        pairs.set_all(&[("Take", 0.0), ("Conclude", 1.0), ("HasKp", 0.0)]);
        pairs.call();
        let now =
            pairs.all(&["HasWidth", "Doubt", "Width.D", "Width.Low", "Width.High", "Width.KpLow", "Width.KpHigh"]);
        assert!(shown.is_empty() || same(&shown, &now), "{now:?} instead of {shown:?}");
        assert!((now[2] - 19.0).abs() < 1e-5 && now[0] == 1.0, "{now:?}");
        shown = now;
    }
    // One far away that carries the line: without it the others have the wrong slope, and they are scattered.
    let scattered = Block::new::<R>("GlappCorrected");
    scattered.set("Take", 1.0);
    for i in 0..9 {
        let near = [-0.1, 0.0, 0.1][i % 3];
        let (travel, way) = if i == 8 { (60.0, 31.0) } else { (20.0 + near, 1.0 - near) };
        scattered.set_all(&[("Travel", travel), ("Way", way)]);
        scattered.call();
    }
    scattered.set_all(&[("Take", 0.0), ("Conclude", 1.0)]);
    scattered.call();
    assert_eq!(scattered.all(&["HasWidth", "Doubt"]), [0.0, 4.0]);
    // A known Kp has no range.
    pairs.set_all(&[("HasKp", 1.0), ("Kp", -2.0)]);
    pairs.call();
    let range = ["HasWidth", "Width.HasKpRange", "Width.Kp", "Width.KpLow", "Width.KpHigh"];
    assert_eq!(pairs.all(&range), [1.0, 0.0, 2.0, 0.0, 0.0]);
    cover.collect(&pairs);
    // Pairs whose line is another without one of them.
    for seed in 0..300 {
        let mut draw = Draw::new(87_000 + seed);
        let mut case = drawn("correction", &mut draw, (1.0, 1.0));
        case.params.as_object_mut().unwrap().remove("kp");
        let (scan, block) = library::<R>("correction", &case);
        compare(&case, core::<R>("correction", &case), scan, false);
        cover.collect(&block);
    }
    for seed in 0..40 {
        let mut draw = Draw::new(85_000 + seed);
        let name = ["correction", "swing"][seed as usize % 2];
        let mut case = drawn(name, &mut draw, (1.0, 1.0));
        let d = &mut draw;
        for (h, x) in &mut case.input {
            if x[3] != 0.0 && d.chance(0.05) {
                x[5] = d.of(&[384.0, 256.0, 144.0, 272.0]);
            }
            if d.chance(0.01) {
                *h = 1e9;
            }
            if d.chance(0.005) {
                (x[0], x[1]) = d.of(&[(1e33, 1e33), (1e33, 0.0), (0.0, 1e33)]);
            }
        }
        // Once more after Clear, of which what came before is nothing.
        let (mut scan, block) = library::<R>(name, &case);
        for (h, x) in case.input.iter().take(60) {
            scan(x, *h);
        }
        let conclude = if name == "correction" { &["Conclude"][..] } else { &[] };
        block.set_all(&[("Clear", 1.0), ("Take", 0.0), ("Ends", 0.0)]);
        conclude.iter().for_each(|pin| block.set(pin, 0.0));
        block.call();
        block.set_all(&[("Clear", 0.0), ("Take", 1.0)]);
        conclude.iter().for_each(|pin| block.set(pin, 1.0));
        compare(&case, core::<R>(name, &case), scan, false);
        cover.collect(&block);
    }
    // A Kp that is known for a while, and then again the same.
    let mut widths = std::collections::BTreeSet::new();
    for seed in 0..24 {
        let mut case = drawn("correction", &mut Draw::new(88_000 + seed), (1.0, 1.0));
        case.params["kp"] = 1.6.into();
        case.params["integrating"] = 0.into();
        let (mut scan, block) = library::<R>("correction", &case);
        let [k, ti, b] = ["k", "ti", "b"].map(|name| R::of(case.given(name)));
        let mut state = CorrectionState::default();
        for (i, (h, x)) in case.input.iter().enumerate() {
            let kp = (i % 5 != 3).then_some(if i < 60 { 1.6 } else { 0.8 });
            block.option("Kp", kp);
            let core = Correction::new(k, ti, b, kp.map(R::of), false).unwrap();
            let got = scan(x, *h).unwrap();
            core.conclude(&mut state);
            if x[3] != 0.0 {
                let (sign, flags) = (x[3] as i8, x[4] as u16);
                let half = HalfPeriod { sign, flags, delta_y: R::of(x[6]), ..HalfPeriod::default() };
                core.end(&mut state, &HalfPeriodResult { half, mask: x[5] as u16, ..HalfPeriodResult::default() });
            }
            if x[7] != 0.0 {
                core.interrupt(&mut state);
            } else {
                core.add(&mut state, R::of(*h), R::of(x[0]), R::of(x[1]), R::of(x[2]));
            }
            let expected = match core.width(&state, x[8] != 0.0) {
                Ok(found) => [found.d.as_f64(), 0.0],
                Err(doubt) => [f64::NAN, f64::from(doubt as u8)],
            };
            assert!(same(&expected, &[got[0], got[4]]), "{seed}, scan {i}: {got:?} instead of {expected:?}");
            widths.insert(expected[0].to_bits());
        }
        cover.collect(&block);
    }
    assert!(widths.len() > 4, "{widths:?}");
    // A time that no detector lets through is passed over, as one that is not above 0 is.
    let shown = [0.0, 1.5e9].map(|beyond| {
        let block = Block::new::<R>("GlappSwing");
        for (h, size) in [(1.0, 1.0), (beyond, 3.0), (1.0, 2.0)] {
            block.set_all(&[("K", 1.0), ("Take", 1.0), ("H", h), ("Yf", -size), ("Op", size)]);
            block.call();
        }
        block.set_all(&[("Ends", 1.0), ("Sign", 1.0)]);
        block.call();
        block.get("Plateau")
    });
    assert!(shown[0] == shown[1] && shown[0] > 0.0, "{shown:?}");
}

/// Pairs of few values, so that lines, bounds and medians are met exactly, and of numbers so large and so small that what is worked out of
/// them is none; each set with a Kp and without.
fn lines<R: Number>(cover: &mut Cover) {
    let block = Block::new::<R>("GlappCorrected");
    // One way that is too large for Kp makes all of them none; what stood there before Clear is nothing.
    for place in 0..10 {
        block.set_all(&[("Clear", 1.0), ("Conclude", 0.0), ("Take", 1.0), ("Travel", 8.0)]);
        for i in 0..9 {
            block.set("Way", if i == place || place == 9 { 3e37 } else { 1.0 });
            block.call();
            block.set("Clear", 0.0);
        }
        block.set_all(&[("Take", 0.0), ("Conclude", 1.0), ("HasKp", 1.0), ("Kp", -0.5)]);
        block.call();
        assert_eq!(block.get("Doubt"), 5.0);
    }
    // A line so flat that its gain is no number here; in LREAL, where that is one, the core goes on.
    if R::BUILD == Build::Lreal {
        block.set_all(&[("Clear", 1.0), ("Conclude", 0.0), ("Take", 1.0), ("HasKp", 0.0)]);
        for i in [1.0, 2.0, 3.0, 4.0] {
            block.set_all(&[("Travel", 1e-44 + 1e-45 * i), ("Way", 1e18 * i)]);
            block.call();
            block.set("Clear", 0.0);
        }
        block.set_all(&[("Take", 0.0), ("Conclude", 1.0)]);
        block.call();
        assert_eq!(block.get("Doubt"), 5.0);
    }
    let mut doubts = [0; 6];
    for seed in 0..400 {
        let mut draw = Draw::new(60_000 + seed);
        let d = &mut draw;
        let scale =
            if R::BUILD == Build::Real { d.of(&[1.0, 1.0, 1.0, 1e8, 1e10, 1e-12]) } else { d.of(&[1.0, 1.0, 1e-12]) };
        let (width, slope, off) =
            (d.of(&[2.0, 4.0, 1.0, 0.0, -1.0]), d.of(&[0.5, 1.0, 2.0, 0.0]), d.of(&[0.0, 0.125, 0.5]));
        let ways = d.of(&[[1.0, 1.5, 2.0, 3.0], [2.0, 2.0, 3.0, 3.0], [1.0, 1.0, 1.0, 1.0], [0.0, 0.5, 1.0, -1.0]]);
        // No way above 0 fits.
        let least = if ways[0] > 0.0 { 1e-38 } else { 0.5 };
        let mut pairs: Vec<Pair<R>> = (0..d.of(&[2, 3, 4, 4, 5, 6, 8, 9]))
            .map(|_| {
                let way = d.of(&ways);
                let travel = width + slope * way + off * d.of(&[0.0, 0.0, 1.0, -1.0]);
                Pair { travel: R::of(scale * travel), way: R::of(scale * way) }
            })
            .collect();
        block.set_all(&[("Clear", 1.0), ("Conclude", 0.0), ("Take", 1.0)]);
        for pair in &pairs {
            block.set_all(&[("Travel", pair.travel.as_f64()), ("Way", pair.way.as_f64())]);
            block.call();
            block.set("Clear", 0.0);
        }
        block.set_all(&[("Take", 0.0), ("Conclude", 1.0)]);
        for kp in [d.of(&[None, Some(1.0), Some(-2.0), Some(least)]), d.of(&[Some(2.0), None])] {
            block.option("Kp", kp);
            block.call();
            let row = ["D", "Low", "High", "Kp"].map(|pin| block.given("HasWidth", &format!("Width.{pin}")));
            let range = block.on("HasWidth") && block.on("Width.HasKpRange");
            let ends = ["Width.KpLow", "Width.KpHigh"].map(|pin| if range { block.get(pin) } else { f64::NAN });
            let got = [&row[..], &ends, &[block.get("Doubt")]].concat();
            let expected = match corrected(&mut pairs, kp.map(R::of)) {
                Ok(found) => {
                    let (low, high) = found.kp_range.unzip();
                    let or_nan = |x: Option<R>| x.map_or(f64::NAN, R::as_f64);
                    let numbers = [found.d, found.low, found.high, found.kp].map(R::as_f64);
                    [&numbers[..], &[or_nan(low), or_nan(high), 0.0]].concat()
                }
                Err(doubt) => [&[f64::NAN; 6][..], &[f64::from(doubt as u8)]].concat(),
            };
            doubts[got[6] as usize] += 1;
            assert!(same(&expected, &got), "{seed}: {got:?} instead of {expected:?} for {pairs:?}, {kp:?}");
        }
    }
    assert!(doubts.iter().all(|count| *count > 5), "{doubts:?}");
    cover.collect(&block);
}

/// PV as measured, and PV by which u_FF goes, given apart: where they are PV itself, the same comes out of it.
fn inside<R: Number>(cover: &mut Cover) {
    let [one, other] = [0, 1].map(|_| Block::new::<R>("GlappBacklashDetection"));
    let (settings, mut active) = (Settings { size: 0.4, ..Settings::default() }, false);
    for i in 0..600 {
        let side = if (i / 12) % 2 == 0 { 1.0 } else { -1.0 };
        let (pv, op) = (-side + 0.01 * f64::from(i % 5), side * f64::from(i % 12) * 0.2);
        let usual = detector::Pins { ti: 0.4, td: Some(0.0), tf: Some(0.0), n: 3, ..detector::Pins::default() };
        let detector = detector::Pins { pv, op: Some(op), ..usual };
        let pins =
            Pins { detector, compensate: i > 300, compensation: Some(settings.clone()), cut: false, foreign: None };
        other.set_all(&[("HasRaw", 1.0), ("Raw", pv), ("HasBeside", 1.0), ("Beside", pv)]);
        let (expected, got) = (scan(&one, &pins), scan(&other, &pins));
        assert!(agree(&expected, &got), "scan {i}: {got:?} instead of {expected:?}");
        active |= one.get("UFf") != 0.0;
    }
    assert!(one.on("HasWhole") && active);
    // A PV that is none is bad for it, whatever Pv is.
    assert_ne!(other.get("Standing"), 3.0);
    other.set("Beside", f64::NAN);
    other.call();
    assert_eq!(other.get("Standing"), 3.0);
    cover.collect(&other);
}

fn random<R: Number>() {
    let mut cover = Cover::new::<R>();
    for name in ["swing", "correction"] {
        let cost = Cost::default();
        let mut doubts = [0_u32; 10];
        for seed in 0..sequences() {
            let case = drawn(name, &mut Draw::new(seed + 1), (1.0, 1.0));
            let (scan, block) = library::<R>(name, &case);
            compare(&case, core::<R>(name, &case), cost.counting(scan, &block), false);
            cover.collect(&block);
            if name == "correction" {
                doubts[block.get("Doubt") as usize] += 1;
            }
        }
        println!("{name}: doubts at the end {doubts:?}");
        cost.tell::<R>(&format!("Glapp{}", crate::common::blocks::pascal(name)));
    }
    for foreign in [false, true] {
        let mut cost = Cost::default();
        let (mut standings, mut refused, mut accepted, mut corrected) = ([0_u32; 15], 0, 0.0, 0);
        let name = if foreign { "GlappForeignDetection" } else { "GlappBacklashDetection" };
        for seed in 0..sequences() {
            let mut draw = Draw::new(30_000 + seed + u64::from(foreign) * 500_000);
            let mut signals = Loop::new(&mut draw, foreign);
            let (block, mut reference) = (Block::new::<R>(name), Reference::<R>::default());
            for i in 0..250 {
                if draw.chance(0.001) {
                    block.0.borrow_mut().power_cut();
                    reference.power_cut();
                }
                let pins = signals.next::<R>(&mut draw, block.get("UFf"));
                let expected = reference.scan(pins);
                let got = cost.of(&block, || scan(&block, pins));
                assert!(
                    agree(&expected, &got),
                    "{name}, sequence {seed}, scan {i}:\n{got:?} instead of\n{expected:?}\nfor {pins:?}"
                );
                assert!(!block.on("Dropped"));
                if i % 8 == 7 && !block.on("Error") {
                    reference.remembers(&block, pins);
                }
                standings[block.get("Standing") as usize] += 1;
                refused += u64::from(block.on("Error"));
                corrected += u64::from(block.on("HasCorrected"));
            }
            accepted += block.get("Accepted");
            cover.collect(&block);
        }
        assert!(standings[4] > 0, "nothing is withdrawn for a relay: {standings:?}");
        println!(
            "standings {standings:?}, {refused} scans refused, {accepted} accepted, {corrected} with a corrected width"
        );
        cost.tell::<R>(name);
    }
    extremes::<R>(&mut cover);
    endless::<R>(&mut cover);
    large::<R>(&mut cover);
    taken_out::<R>(&mut cover);
    stretches::<R>(&mut cover);
    coarse::<R>(&mut cover);
    begins_anew::<R>(&mut cover);
    wrong_signs::<R>(&mut cover);
    read_back::<R>(&mut cover);
    estimate_read_back::<R>(&mut cover);
    near_the_noise::<R>(&mut cover);
    pairs::<R>(&mut cover);
    lines::<R>(&mut cover);
    inside::<R>(&mut cover);
    another_version::<R>(&mut cover);
    cover.holds(&POUS);
    cover.takes("GlappDetector", &["IF Inner.Checked", "IF NOT GlappIsOpen(Inner.Raw)"]);
}

/// A signal that breaks in some scans in a row, up to twelve: from the tenth on that is an error, until it is whole.
fn stretches<R: Number>(cover: &mut Cover) {
    for foreign in [false, true] {
        let name = if foreign { "GlappForeignDetection" } else { "GlappBacklashDetection" };
        let mut shown = [0; 84];
        for seed in 0..60 {
            let mut draw = Draw::new(90_000 + seed);
            let mut signals = Loop::new(&mut draw, foreign);
            let (block, mut reference) = (Block::new::<R>(name), Reference::<R>::default());
            let (mut left, mut way) = (0, 0);
            for i in 0..150 {
                let mut pins = signals.next::<R>(&mut draw, block.get("UFf")).clone();
                let d = &mut draw;
                if left == 0 && d.chance(0.1) {
                    (left, way) = (d.of(&[1, 9, 10, 12]), d.of(&[0, 1, 2, 3, 4, 5, 6, 7, 8]));
                }
                if left > 0 {
                    left -= 1;
                    match d.of(&[0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 2]) {
                        1 => pins.detector.h = 0.0,
                        2 => pins.detector.enable = false,
                        _ if way == 8 => pins.cut = !foreign,
                        _ => detector::breaks_off(&mut pins.detector, way),
                    }
                }
                let (expected, got) = (reference.scan(&pins), scan(&block, &pins));
                assert!(
                    agree(&expected, &got),
                    "{name}, stretches {seed}, scan {i}:\n{got:?} instead of\n{expected:?}\nfor {pins:?}"
                );
                shown[block.get("ErrorID") as usize] += 1;
            }
            cover.collect(&block);
        }
        assert!(shown[12] > 20 && shown[83] > 20, "{shown:?}");
    }
}

/// A program with another version of the retained variables is loaded: they are dropped, and that is told.
fn another_version<R: Number>(cover: &mut Cover) {
    let block = Block::new::<R>("GlappBacklashDetection");
    let mut draw = Draw::new(3);
    let mut signals = Loop::new(&mut draw, false);
    let pins = signals.next::<R>(&mut draw, 0.0).clone();
    scan(&block, &pins);
    for (version, dropped) in [(2, false), (1, true)] {
        block.0.borrow_mut().power_cut();
        block.0.borrow_mut().spoil("StateVersion", f64::from(version)).unwrap();
        block.0.borrow_mut().spoil("WholeKnown", 1.0).unwrap();
        block.0.borrow_mut().spoil("WholeFound.Count", 1.0).unwrap();
        scan(&block, &pins);
        assert_eq!((block.on("Dropped"), block.on("HasWhole")), (dropped, !dropped));
    }
    let mut reset = pins.clone();
    reset.detector.reset = true;
    scan(&block, &reset);
    assert!(!block.on("Dropped"));
    cover.collect(&block);
    // Errors of a block that it has inside.
    let foreign = Foreign { delay: 1, tolerance: None, longest: None, back: None };
    let beside = Pins { foreign: Some(foreign), ..pins.clone() };
    for (pins, version) in [
        (&pins, "Detector.StateVersion"),
        (&pins, "Compensation.StateVersion"),
        (&beside, "Detection.StateVersion"),
        (&beside, "Detection.Detector.StateVersion"),
    ] {
        let block = Block::new::<R>(pins.name());
        scan(&block, pins);
        block.0.borrow_mut().power_cut();
        block.0.borrow_mut().spoil(version, 7.0).unwrap();
        scan(&block, pins);
        assert!(block.on("Dropped"), "{version}");
    }
}

in_both!(random_lreal, random_real: random);
