//! Compensation and what it calls: every vector and random sequences beside the core, the same bits in LREAL and REAL.

use crate::common::compensate::{BLOCKS, Pins, REMEMBERED, Reference, Settings, Swings, core, library, scan};
use crate::common::cover::{Cost, Cover, sequences};
use crate::common::{Block, Case, Draw, Number, cases, compare, same};
use glapp_core::status::{AT_HIGH, AT_LOW};
use glapp_core::{Saturation, WrongSign, WrongSignState};
use glapp_plc_check::Build;
use serde_json::json;

fn every_case<R: Number>() {
    for block in BLOCKS {
        for case in cases(block) {
            compare(&case, core::<R>(block, &case), library::<R>(block, &case).0, false);
        }
    }
}

/// The vectors' own outputs, where they are all of the block's.
#[test]
fn the_vectors_say_the_same() {
    for block in ["over_compensation", "wrong_sign"] {
        for case in cases(block) {
            compare(&case, core::<f64>(block, &case), library::<f64>(block, &case).0, true);
        }
    }
    for case in cases("compensation") {
        let (mut scan, block) = library::<f64>("compensation", &case);
        for (i, ((h, x), row)) in case.input.iter().zip(case.output.as_ref().unwrap()).enumerate() {
            scan(x, *h);
            let expected: Vec<f64> = row.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect();
            let got = block.all(&["UFf", "HalfWidth", "Standing", "Delta"]);
            assert!(same(&expected, &got), "{}, scan {i}: {got:?} instead of {expected:?}", case.name);
        }
    }
}

in_both!(lreal, real: every_case, random);

/// A case of a block, drawn.
fn drawn(block: &str, d: &mut Draw) -> Case {
    let flag = |d: &mut Draw, share: f64| if d.chance(share) { d.of(&[1.0, 2.0, 4.0, 8.0, 16.0, 31.0]) } else { 0.0 };
    let (params, input): (_, Vec<(f64, Vec<f64>)>) = match block {
        "over_compensation" => {
            let (duration, scatter) = (d.between(5.0, 30.0), d.of(&[0.0, 0.0, 0.05, 0.6]));
            let faster = d.of(&[1.0, 0.8, 0.7, 0.5]);
            let duration = duration * d.of(&[1.0, 1.0, 1.0, 0.03]);
            let height = d.of(&[0.02, 0.3, 0.3, 1.0, 1.0, 1e9]);
            let (mut size, usual) = (0.0, scatter);
            let mut scatter = usual;
            let input = (0..120).map(|i| {
                if i % 30 == 10 {
                    size = d.of(&[0.0, 0.5, 2.0, 6.0]);
                    scatter = d.of(&[usual, usual, 0.0]);
                }
                let around = 1.0 + scatter * d.between(-1.0, 1.0);
                let long = duration * around * if size > 0.0 { faster } else { 1.0 };
                let y = height * (1.0 + 0.5 * scatter * d.between(-1.0, 1.0));
                let sp = if d.chance(0.02) { y } else { 0.0 };
                let h = if d.chance(0.02) { d.of(&[f64::NAN, f64::INFINITY, 0.0, -0.1, 40.0]) } else { 0.1 };
                let broken = flag(d, 0.01);
                (h, vec![long, if d.chance(0.01) { 0.0 } else { y }, sp, broken, size])
            });
            let input = input.collect();
            (json!({ "k": d.of(&[0.5, -0.5, 1e30]), "ti": d.of(&[8.0, 1.0, 1e-20]) }), input)
        }
        "wrong_sign" => {
            let k: f64 = d.of(&[2.0, -2.0]);
            let (towards, wrong, speed) = (d.of(&[1.0, -1.0]), d.of(&[0.0, 0.02]), d.of(&[2.0, 5.0, 60.0]));
            let (mut op, mut pv, turns) = (50.0_f64, 50.0 - 0.2 * towards, d.between(20.0, 150.0));
            let grows = d.of(&[0.5, 0.05, 0.0]);
            let input = (0..120).map(|i| {
                let early = f64::from(i) < turns;
                op = (op + if early { k.signum() * towards * speed } else { -k.signum() * towards * 4.0 })
                    .clamp(0.0, 100.0);
                pv += if early { -towards * grows } else { towards * 2.0 };
                if d.chance(0.01) {
                    pv = 50.0;
                }
                let limit = f64::from(u8::from(op <= 0.0)) * 4.0 + f64::from(u8::from(op >= 100.0)) * 8.0;
                let (mut sp, mut yf, mut out, mut h) = (50.0, pv, op, d.of(&[1.0, 1.0, 0.5]));
                if d.chance(wrong) {
                    let bad = d.of(&[f64::NAN, f64::INFINITY, 1e32, -1e36]);
                    match d.of(&[0, 1, 2]) {
                        0 => sp = bad,
                        1 => yf = bad,
                        _ => out = bad,
                    }
                }
                if d.chance(wrong) {
                    h = d.of(&[0.0, -1.0, f64::NAN, 1e12, f64::INFINITY, 1e8]);
                }
                (h, vec![sp, yf, out, if d.chance(wrong) { flag(d, 1.0) } else { limit }])
            });
            let input = input.collect();
            (json!({ "k": k, "ti": d.of(&[0.5, 1.0, 2.4]), "low": 0.0, "high": 100.0 }), input)
        }
        other => panic!("{other}"),
    };
    Case { name: block.to_owned(), params, input, output: None }
}

fn random<R: Number>() {
    let mut cover = Cover::new::<R>();
    for name in ["over_compensation", "wrong_sign"] {
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
    for seed in 0..40 {
        // A signal that creeps at its limit, times at their bound.
        let mut draw = Draw::new(5000 + seed);
        let mut case = drawn("wrong_sign", &mut draw);
        let creeps = draw.of(&[0.0, 1e-4, 3e-4]);
        for (i, (h, x)) in case.input.iter_mut().enumerate() {
            if x[2] >= 100.0 || x[2] <= 0.0 {
                x[2] += (x[2] - 50.0).signum() * creeps * i as f64;
            }
            *h = if draw.chance(0.02) { draw.of(&[1e9, 1.5e9]) } else { *h };
        }
        let (scan, block) = library::<R>("wrong_sign", &case);
        compare(&case, core::<R>("wrong_sign", &case), scan, false);
        cover.collect(&block);
    }
    for op in [0.5_f64, -0.5] {
        // At its limit from the first sample on, near to where a block that was cleared has it.
        let block = Block::new::<R>("GlappWrongSign");
        let limits = Saturation::new(R::of(-0.5), R::of(0.5)).unwrap();
        let core = WrongSign::new(R::of(op.signum()), R::of(1.0), limits).unwrap();
        let mut state = WrongSignState::default();
        block.set_all(&[("K", op.signum()), ("Ti", 1.0), ("Low", -0.5), ("High", 0.5), ("H", 1.0), ("Clear", 1.0)]);
        for i in 0..12 {
            let (yf, flag) = (-1.0 - 0.3 * f64::from(i), if op > 0.0 { AT_HIGH } else { AT_LOW });
            core.update(&mut state, R::ZERO, R::of(yf), R::of(op), R::ONE, flag);
            block.set_all(&[("Yf", yf), ("Op", op), ("AtHigh", f64::from(op > 0.0)), ("AtLow", f64::from(op < 0.0))]);
            block.call();
            block.set("Clear", 0.0);
            let remembered = [("/sign", "Sign"), ("/begin", "Start"), ("/early", "Early"), ("/farthest", "Farthest")];
            block.remembers(&state, &remembered);
            block.remembers(&state, &[("/time", "Time0.Value")]);
            assert_eq!(state.found, block.on("Found"));
        }
    }
    let mut cost = Cost::default();
    let (mut standings, mut refused) = ([0_u32; 15], 0);
    for seed in 0..sequences() {
        let mut draw = Draw::new(2000 + seed);
        let mut swings = Swings::new(&mut draw);
        let (block, mut reference) = (Block::new::<R>("GlappCompensation"), Reference::<R>::default());
        for i in 0..400 {
            if draw.chance(0.001) {
                block.0.borrow_mut().power_cut();
                reference.restart();
            }
            let pins = swings.next::<R>(&mut draw);
            let expected = reference.scan(pins);
            let got = cost.of(&block, || scan(&block, pins));
            assert!(
                same(&expected, &got),
                "sequence {seed}, scan {i}:\n{got:?} instead of\n{expected:?}\nfor {pins:?}"
            );
            assert!(!block.on("Dropped"));
            if i % 8 == 7 {
                block.remembers(&reference.state, &REMEMBERED);
            }
            standings[block.get("Standing") as usize] += 1;
            refused += u64::from(block.on("Error"));
        }
        cover.collect(&block);
    }
    println!("standings {standings:?}, {refused} scans with a setting out of bounds");
    cost.tell::<R>("GlappCompensation");
    assert!(standings.iter().all(|count| *count > 0) && refused > sequences());
    relays::<R>(&mut cover);
    lagging::<R>(&mut cover);
    extremes::<R>(&mut cover);
    large::<R>(&mut cover);
    coarse::<R>(&mut cover);
    another_version::<R>(&mut cover);
    for clear in [1.0, 0.0] {
        for name in ["GlappOverCompensation", "GlappWrongSign"] {
            let block = Block::new::<R>(name);
            block.set_all(&[("Clear", clear), ("K", 1.0), ("Ti", 1.0)]);
            block.call();
            block.set(if name == "GlappWrongSign" { "Gap" } else { "Take" }, 0.0);
            block.call();
            cover.collect(&block);
        }
    }
    inside::<R>(&mut cover);
    at_the_bounds::<R>();
    still::<R>();
    cover.holds(&[
        "GlappOverCompensation", "GlappWrongSign", "GlappCompensation", "GlappCompensationCheck", "GlappHarm",
        "GlappMean", "GlappBeyond",
    ]);
}

/// Half-periods of two heights and two lengths, of which so many need hardly any travel; before it was enabled there were some, or none.
fn relays<R: Number>(cover: &mut Cover) {
    let mut warned = [0; 9];
    for (few, before, h) in (0..9).flat_map(|few| [(few, 0, 0.0), (few, 9, 0.5), (few, 9, 0.0), (few, 4, 0.0)]) {
        let input = (0..before + 12).map(|i| {
            let (small, short) = (i % 8 < few, i % 3 == 0);
            let size = if i < before { 0.0 } else { if before > 8 { 7.5 } else { 37.5 } };
            let shorter = if i < before { 2.0 } else { 1.0 };
            let half = [if short { 10.0 } else { 15.0 } * shorter, if small { 1.0 } else { 2.0 }, 0.0, 0.0, size];
            (h, half.to_vec())
        });
        let params = json!({ "k": 0.5, "ti": 1.0 });
        let case = Case { name: String::new(), params, input: input.collect(), output: None };
        let (mut scan, block) = library::<R>("over_compensation", &case);
        let mut beside = |from: usize| {
            let mut core = core::<R>("over_compensation", &case);
            for (h, x) in &case.input[from..] {
                let (expected, got) = (core(x, *h).unwrap(), scan(x, *h).unwrap());
                assert!(
                    same(&expected, &got),
                    "{few} after {before}, {from}: {got:?} instead of {expected:?} for {x:?}"
                );
            }
        };
        beside(0);
        warned[few] += usize::from(block.on("Relay"));
        // After Clear the block is as new, whatever it received before.
        block.set_all(&[("Clear", 1.0), ("Take", 0.0)]);
        block.call();
        assert_eq!(block.all(&["Equal", "Relay"]), [0.0; 2]);
        block.set_all(&[("Clear", 0.0), ("Take", 1.0)]);
        beside(before);
        cover.collect(&block);
    }
    assert!(warned[0] == 0 && warned[8] > 0, "{warned:?}");
}

/// Enable taken away while u_FF still lags behind a width that was made smaller, and while no time is short enough for the way to 0.
fn lagging<R: Number>(cover: &mut Cover) {
    for (ti, sizes, rate, release) in [(2.0, [4.0, 0.4], 0.1, 0.5), (1e-30, [1e12, 1e12], 1e36, 1e-30)] {
        let settings = crate::common::compensate::Settings {
            way: 1,
            source: 1,
            ti,
            rate: Some(rate),
            release: Some(release),
            ..Default::default()
        };
        let mut pins = Pins::new(settings);
        let (block, mut reference) = (Block::new::<R>("GlappCompensation"), Reference::<R>::default());
        for i in 0..90 {
            pins.settings.size = sizes[usize::from(i >= 60)];
            (pins.e, pins.u, pins.h) = (if i < 5 { -1.0 } else { 1.0 }, 0.0, 0.5); // it waits for a reversal
            pins.compensate = (1..66).contains(&i);
            let (expected, got) = (reference.scan(&pins), scan(&block, &pins));
            assert!(same(&expected, &got), "scan {i}: {got:?} instead of {expected:?} for {pins:?}");
        }
        cover.collect(&block);
    }
}

/// Settings at the ends of what is a number: no run stops. In REAL what overflows is what overflows in the core; LREAL in the core
/// goes on to 1E308.
fn extremes<R: Number>(cover: &mut Cover) {
    let small = [1.0, 1e-30, 1e-38];
    for seed in 0..sequences() {
        let mut draw = Draw::new(7000 + seed);
        let mut swings = Swings::new(&mut draw);
        let mut pins = swings.next::<R>(&mut draw).clone();
        let s = &mut pins.settings;
        (s.ti, s.share, s.most) = (draw.of(&[1.0, 1e-38, 1e9, 1e-20]), 1.0, Some(1e37));
        (s.size, s.source, s.way) = (draw.of(&[1.0, 1.0, 1e30]), draw.of(&[1, 3]), draw.of(&[1, 3]));
        let short = |share: f64| Some((share * s.ti).max(1e-38));
        (s.release, s.ramp_time) = (short(draw.of(&small)), short(draw.of(&small)));
        s.rate = draw.of(&[None, Some(0.01), Some(1.0), Some(1e36)]);
        (s.travel, s.reversals) = (draw.of(&[None, Some(1e36), Some(20.0)]), None);
        s.watch = draw.of(&[None, Some(10.0 * s.ti), Some(1e4 * s.ti)]);
        if s.ti > 30.0 {
            s.release = Some(draw.of(&small));
        }
        let (block, mut reference) = (Block::new::<R>("GlappCompensation"), Reference::<R>::default());
        if R::BUILD == Build::Lreal {
            block.unheld();
        }
        for i in 0..120 {
            let side = if (i / 6) % 2 == 0 { 1.0 } else { -1.0 };
            (pins.e, pins.u, pins.compensate) = (side, 3.0 * side, i > 20);
            (pins.d_hat, pins.offered) = (Some(draw.of(&[1.5, 1.5, 0.3])), Some(1.5));
            pins.h = draw.of(&[0.25, 0.25, 1e8, 1e9, 1e-30]);
            pins.flags = if draw.chance(0.05) { 2 } else { 0 };
            let (expected, got) = (reference.scan(&pins), scan(&block, &pins));
            let agree = R::BUILD == Build::Lreal || same(&expected, &got);
            assert!(agree, "sequence {seed}, scan {i}:\n{got:?} instead of\n{expected:?}\nfor {pins:?}");
        }
        cover.collect(&block);
    }
}

/// Each number by itself so large that it is one, and beyond what can be measured.
fn large<R: Number>(cover: &mut Cover) {
    type Put = Box<dyn Fn(&mut Pins, f64)>;
    let of_settings = crate::common::compensate::NUMBERS
        .into_iter()
        .map(|put| -> Put { Box::new(move |p: &mut Pins, x: f64| put(&mut p.settings, x)) });
    let own: [fn(&mut Pins, f64); 7] = [
        |p, x| p.h = x,
        |p, x| p.e = x,
        |p, x| p.u = x,
        |p, x| p.d_hat = Some(x),
        |p, x| p.offered = Some(x),
        |p, x| p.limits = Some((x, 3.0)),
        |p, x| p.limits = Some((-3.0, x)),
    ];
    let own = own.into_iter().map(|put| -> Put { Box::new(put) });
    for (number, put) in of_settings.chain(own).enumerate() {
        for value in [1e33, -1e33, 0.0, 3.0, -3.0] {
            let settings = crate::common::compensate::Settings { source: 3, size: 1.0, ..Default::default() };
            let usual = Pins::new(settings);
            let (block, mut reference) = (Block::new::<R>("GlappCompensation"), Reference::<R>::default());
            for i in 0..30 {
                let side = if (i / 6) % 2 == 0 { 1.0 } else { -1.0 };
                let mut pins = Pins { e: side, u: 3.0 * side, compensate: i > 2, ..usual.clone() };
                (pins.d_hat, pins.offered) = (Some(1.5), Some(1.5));
                if (10..14).contains(&i) {
                    put(&mut pins, value);
                }
                let (expected, got) = (reference.scan(&pins), scan(&block, &pins));
                assert!(
                    same(&expected, &got),
                    "number {number}, {value}, scan {i}:\n{got:?} instead of\n{expected:?}\nfor {pins:?}"
                );
            }
            cover.collect(&block);
        }
    }
}

/// Signals, times and settings of a few values, so that bounds are met exactly; a compensation that begins anew in the middle of everything.
fn coarse<R: Number>(cover: &mut Cover) {
    for seed in 0..60 {
        let mut draw = Draw::new(9000 + seed);
        let d = &mut draw;
        let settings = crate::common::compensate::Settings {
            way: d.of(&[1, 2, 3]),
            source: d.of(&[1, 3]),
            size: 1.0,
            band: d.of(&[Some(0.0), Some(0.5)]),
            rate: d.of(&[Some(8.0), None]),
            ramp_time: d.of(&[Some(0.0), Some(0.5), None]),
            release: Some(d.of(&[1.0, 2.0])),
            travel: d.of(&[None, Some(2.0), Some(6.0)]),
            reversals: d.of(&[None, Some(2.0), Some(4.0)]),
            watch: d.of(&[None, Some(37.5)]),
            ..Default::default()
        };
        // Some controllers so slow that 300 s is the longest release, and what is used where none is given.
        let settings = match seed % 12 {
            5 => crate::common::compensate::Settings { ti: 400.0, ..settings },
            11 => crate::common::compensate::Settings { ti: 400.0, release: None, ..settings },
            _ => settings,
        };
        let mut usual = Pins::new(settings);
        usual.limits = d.of(&[None, Some((-1.5, 1.5))]);
        let (block, mut reference) = (Block::new::<R>("GlappCompensation"), Reference::<R>::default());
        let mut still = 0;
        for i in 0..150 {
            let side = if (i / 5) % 2 == 0 { 1.0 } else { -1.0 };
            let anew = d.chance(0.02);
            still = if anew && d.chance(0.5) { 3 } else { i32::max(still - 1, 0) };
            let reset = anew && d.chance(0.5);
            let mut pins = Pins { reset, restart: anew && !reset, compensate: i % 50 > 3, ..usual.clone() };
            pins.e = side * d.of(&[1.0, 0.5, 0.0]);
            pins.u = side * d.of(&[1.0, 1.0, 0.5]);
            pins.d_hat = d.of(&[Some(1.0), Some(0.5), Some(1.0), None]);
            pins.offered = Some(1.0);
            pins.flags = d.of(&[0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 2, 4, 8]);
            let h = d.of(&[0.25, 0.25, 0.25, 0.25, 0.25, 0.25, 0.25, 0.25, 0.25, 0.25, 0.25, 0.0, 1e9, 1.5e9]);
            pins.h = if still > 0 { 0.0 } else { h };
            let (expected, got) = (reference.scan(&pins), scan(&block, &pins));
            assert!(same(&expected, &got), "coarse {seed}, scan {i}:\n{got:?} instead of\n{expected:?}\nfor {pins:?}");
            if i % 8 == 7 {
                block.remembers(&reference.state, &REMEMBERED);
            }
        }
        cover.collect(&block);
    }
}

/// Settings at their bounds and beyond.
fn at_the_bounds<R: Number>() {
    let usual = || Settings { size: 1.0, ..Settings::default() };
    for settings in [
        Settings { ti: 1e9, ..usual() },
        Settings { ti: 1.5e9, ..usual() },
        Settings { watch: Some(1e5), ..usual() },
        Settings { watch: Some(1.1e5), ..usual() },
        Settings { rate: Some(1e37), ..usual() },
        Settings { rate: Some(1.5e37), ..usual() },
        Settings { travel: Some(1e37), ..usual() },
        Settings { travel: Some(1.5e37), ..usual() },
        Settings { reversals: Some(1e37), ..usual() },
        Settings { reversals: Some(1.5e37), ..usual() },
        Settings { reversals: Some(2.0), ..usual() },
        Settings { share: 1.1, ..usual() },
    ] {
        let (block, mut reference) = (Block::new::<R>("GlappCompensation"), Reference::<R>::default());
        for i in 0..4 {
            let pins = Pins { h: 0.5, e: 0.1, u: f64::from(i % 2), ..Pins::new(settings.clone()) };
            let (expected, got) = (reference.scan(&pins), scan(&block, &pins));
            assert!(same(&expected, &got), "{settings:?}, scan {i}:\n{got:?} instead of\n{expected:?}");
        }
    }
}

/// A loop at rest before it is compensated, without any error, whose controller turns in every scan after: that is worse.
fn still<R: Number>() {
    let settings = Settings { size: 1.0, watch: Some(150.0), rate: Some(9.0), ..Settings::default() };
    let (block, mut reference) = (Block::new::<R>("GlappCompensation"), Reference::<R>::default());
    let mut withdrawn = 0;
    for i in 0..60 {
        let u = if i < 16 { 0.0 } else { f64::from(i % 2) };
        let pins = Pins { h: 1.0, u, compensate: i >= 16, ..Pins::new(settings.clone()) };
        let (expected, got) = (reference.scan(&pins), scan(&block, &pins));
        assert!(same(&expected, &got), "scan {i}:\n{got:?} instead of\n{expected:?}");
        withdrawn += usize::from(block.get("Standing") == 11.0);
    }
    assert!(withdrawn > 0);
}

/// Cases that only a block around it can set: settings already checked, going on from a u_FF that is there, none at
/// all.
fn inside<R: Number>(cover: &mut Cover) {
    for there in [0.8, -0.8] {
        let block = Block::new::<R>("GlappCompensation");
        block.set_all(&[
            ("Checked", 1.0),
            ("Used.Way", 3.0),
            ("Used.Source", 1.0),
            ("Used.Release", 2.0),
            ("Used.Longest", 20.0),
            ("Used.Rate", 9.0),
        ]);
        block.set_all(&[("Used.High", 100.0), ("Enable", 1.0), ("H", 0.5), ("GoesOn", 1.0), ("UFfThere", there)]);
        let scan = || {
            block.call();
            block.get("UFf")
        };
        let begins = scan();
        block.set("GoesOn", 0.0);
        let shown: Vec<f64> = (0..4).map(|_| scan()).collect();
        assert!((begins - 0.75 * there).abs() < 1e-6 && (shown[0] - 0.5 * there).abs() < 1e-6, "{begins} {shown:?}");
        assert!(shown[3].abs() < 1e-6);
        // Again, from somewhere else, in the middle of it.
        for there in [there, 0.5 * there] {
            block.set_all(&[("GoesOn", 1.0), ("UFfThere", there)]);
            block.call();
            assert!((block.get("UFf") - 0.75 * there).abs() < 1e-6, "{}", block.get("UFf"));
            block.set("GoesOn", 0.0);
            block.call();
        }
        // After power-up it waits for a reversal, also where it was in force and may come in at once.
        block.set_all(&[("Used.Size", 1.0), ("Used.Share", 1.0), ("Used.MaxWidth", 9.0), ("Used.Travel", 1e37)]);
        block.set_all(&[("Used.Reversals", 1e37), ("Used.Low", -100.0), ("SeenOff", 1.0), ("Compensate", 1.0)]);
        for (u, restart, standing) in [(0.0, 0.0, 10.0), (2.0, 0.0, 10.0), (-2.0, 0.0, 0.0), (-2.0, 1.0, 10.0)] {
            block.set_all(&[("U", u), ("Restart", restart)]);
            block.call();
            assert_eq!(block.get("Standing"), standing, "{u}, {restart}");
        }
        block.set_all(&[("Restart", 0.0), ("Compensate", 0.0)]);
        block.set("GoesOn", 1.0);
        block.call();
        block.set_all(&[("GoesOn", 0.0), ("Absent", 1.0)]);
        block.call();
        assert_eq!((block.get("UFf"), block.get("HalfWidth"), block.get("Standing")), (0.0, 0.0, 1.0));
        cover.collect(&block);
    }
}

/// A program with another version of the retained variables is loaded: they are dropped, and that is told.
fn another_version<R: Number>(cover: &mut Cover) {
    let block = Block::new::<R>("GlappCompensation");
    let pins = Pins::new(crate::common::compensate::Settings::default());
    scan(&block, &pins);
    for (version, dropped) in [(1, false), (2, true)] {
        block.0.borrow_mut().power_cut();
        block.0.borrow_mut().spoil("StateVersion", f64::from(version)).unwrap();
        block.0.borrow_mut().spoil("Withdrawn", 11.0).unwrap();
        scan(&block, &Pins { compensate: true, ..pins.clone() });
        // Why it was withdrawn is told, or gone.
        assert_eq!((block.on("Dropped"), block.get("Standing")), (dropped, if dropped { 1.0 } else { 11.0 }));
    }
    scan(&block, &Pins { reset: true, ..pins });
    assert!(!block.on("Dropped"));
    cover.collect(&block);
}

/// Power comes back with the button still on: nothing comes in before it has been seen off; a withdrawal is told meanwhile.
#[test]
fn compensate_counts_once_it_has_been_seen_off() {
    let block = Block::new::<f64>("GlappCompensation");
    let settings = crate::common::compensate::Settings { size: 1.0, ..Default::default() };
    let mut pins = Pins { compensate: true, ..Pins::new(settings) };
    let swing = |pins: &mut Pins, i: usize| {
        let side = if (i / 8).is_multiple_of(2) { 1.0 } else { -1.0 };
        (pins.e, pins.u) = (side, pins.u + 0.2 * side);
    };
    let run = |pins: &mut Pins| {
        for i in 0..40 {
            swing(pins, i);
            scan(&block, pins);
        }
        (block.get("Standing"), block.get("UFf"))
    };
    assert_eq!(run(&mut pins), (1.0, 0.0), "open, or on from the beginning: off");
    pins.compensate = false;
    run(&mut pins);
    pins.compensate = true;
    let (standing, u_ff) = run(&mut pins);
    assert!(standing == 0.0 && u_ff.abs() == 0.4);
    block.0.borrow_mut().power_cut();
    assert_eq!(run(&mut pins), (1.0, 0.0));
    pins.compensate = false;
    run(&mut pins);
    pins.compensate = true;
    run(&mut pins);
    scan(&block, &Pins { over: true, ..pins.clone() });
    block.0.borrow_mut().power_cut();
    assert_eq!(run(&mut pins), (4.0, 0.0), "why it was withdrawn outlives the power");
    pins.compensate = false;
    assert_eq!(run(&mut pins).0, 1.0);
}

/// Enable taken away, and a setting out of bounds: u_FF goes to 0 by its ramp, or as if nothing were.
#[test]
fn without_enable_it_is_ramped_out() {
    let block = Block::new::<f64>("GlappCompensation");
    let settings = crate::common::compensate::Settings { size: 1.0, ti: 2.0, ..Default::default() };
    let mut pins = Pins::new(settings);
    let mut shown = vec![];
    for i in 0..60 {
        let side = if (i / 8) % 2 == 0 { 1.0 } else { -1.0 };
        (pins.e, pins.u, pins.compensate, pins.enable) = (side, pins.u + 0.2 * side, i > 0, i < 40);
        pins.settings.share = if (20..30).contains(&i) { 2.0 } else { 1.0 };
        scan(&block, &pins);
        assert_eq!(block.get("ErrorID"), if (20..30).contains(&i) { 15.0 } else { 0.0 });
        shown.push(block.get("UFf").abs());
    }
    assert_eq!((shown[25], shown[39]), (0.4, 0.4), "the last good settings stay in force");
    assert!(shown[40] > 0.3 && shown[43] > 0.15 && shown[48] < 1e-12, "{shown:?}");
}
