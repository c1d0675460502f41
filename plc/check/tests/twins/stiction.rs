//! Pushes for a valve that sticks: every vector, and random sequences with settings and inputs good and bad, the same bits as the core in
//! LREAL and REAL.

use crate::common::compensate::{flags, named, number};
use crate::common::cover::{Cost, Cover, sequences};
use crate::common::names::given;
use crate::common::{Block, Case, Draw, Number, cases, same};
use glapp_core::status::{AT_HIGH, AT_LOW, BAD, NOT_AUTO, Status};
use glapp_core::{Push, Saturation, Standing, Stiction, StictionSample, StictionSettings, StictionState, Sum};
use glapp_plc_check::Build;
use serde_json::Value;

/// Pins of a scan.
#[derive(Clone, Debug)]
struct Pins {
    enable: bool,
    reset: bool,
    restart: bool,
    compensate: bool,
    h: f64,
    e: f64,
    u: f64,
    flags: Status,
    limits: Option<(f64, f64)>,
    k: f64,
    ti: f64,
    push: i16,
    size: f64,
    withdraw: bool,
    far: f64,
    /// Each with its pin: those that may be left as they begin.
    options: [(&'static str, Option<f64>); 8],
}

const OPTIONS: [&str; 8] = ["MaxSize", "Hold", "PushPeriod", "Band", "Rate", "Release", "Travel", "Watch"];

fn on(x: bool) -> f64 {
    f64::from(u8::from(x))
}

/// Whether a value is known, `MaxSize` included.
fn known(x: Option<f64>, pin: &str) -> Option<f64> {
    let open = if pin == "MaxSize" { Some(-1.0) } else { None };
    match pin {
        "Hold" | "PushPeriod" => x.filter(|x| *x != 0.0),
        _ if open.is_some() => x.filter(|x| Some(*x) != open),
        _ => given(x, pin),
    }
}

impl Pins {
    fn set(&self, block: &Block) {
        block.set_all(&[("Enable", on(self.enable)), ("Reset", on(self.reset)), ("Restart", on(self.restart))]);
        block.set_all(&[("Compensate", on(self.compensate)), ("H", self.h), ("E", self.e), ("U", self.u)]);
        flags(block, self.flags.into());
        let (low, high) = self.limits.unwrap_or((0.0, 0.0));
        block.set_all(&[("OpLow", low), ("OpHigh", high), ("K", self.k), ("Ti", self.ti)]);
        block.set_all(&[("Push", self.push.into()), ("Size", self.size), ("Far", self.far)]);
        block.set("Withdraw", on(self.withdraw));
        for (pin, value) in self.options {
            block.option(pin, value);
        }
    }

    fn core<R: Number>(&self) -> Result<Stiction<R>, f64> {
        let r = |x: f64| R::of(x);
        let limits = match self.limits.filter(|limits| *limits != (0.0, 0.0)) {
            Some((low, high)) => Saturation::new(r(low), r(high)).map_err(|error| number(&error))?,
            None => Saturation::none(),
        };
        if !(1..=3).contains(&self.push) {
            return Err(named("push"));
        }
        let usual = StictionSettings::new(Push::ALL[self.push as usize - 1], r(self.k), r(self.ti), r(self.size));
        let [limit, hold, period, band, rate, release, travel, watch] =
            self.options.map(|(pin, value)| known(value, pin).map(r));
        Stiction::new(StictionSettings {
            limit: limit.unwrap_or(usual.limit),
            hold: hold.unwrap_or(usual.hold),
            period: period.unwrap_or(usual.period),
            band: band.unwrap_or(usual.band),
            far: r(self.far),
            rate: rate.unwrap_or(usual.rate),
            release: release.unwrap_or(usual.release),
            travel: travel.unwrap_or(usual.travel),
            watch: watch.unwrap_or(usual.watch),
            withdraw: self.withdraw,
            limits,
            ..usual
        })
        .map_err(|error| number(&error))
    }
}

/// Reference of the block.
#[derive(Default)]
struct Reference<R: Number> {
    state: StictionState<R>,
    good: Option<Stiction<R>>,
    seen_h: bool,
    armed: bool,
    held: bool,
}

impl<R: Number> Reference<R> {
    fn restart(&mut self) {
        let saved = serde_json::to_value(self.state).unwrap()["withdrawn"].clone();
        let mut fresh = serde_json::to_value(StictionState::<R>::default()).unwrap();
        fresh["withdrawn"] = saved;
        let held = !fresh["withdrawn"].is_null();
        *self = Self { state: serde_json::from_value(fresh).unwrap(), held, ..Self::default() };
    }

    fn scan(&mut self, pins: &Pins) -> Vec<f64> {
        if pins.reset {
            *self = Self::default();
        } else if pins.restart {
            self.restart();
        }
        self.seen_h |= pins.h != 0.0;
        self.armed |= !pins.compensate;
        let mut error = 0.0;
        match pins.core() {
            Ok(block) => {
                self.good = Some(block);
                if !self.seen_h {
                    error = named("h");
                }
            }
            Err(number) => error = number,
        }
        if let Some(block) = &self.good {
            let r = |x: f64| R::of(x);
            let enable = pins.compensate && (self.armed || self.held);
            self.held &= enable;
            let flags = pins.flags | if pins.enable { 0 } else { BAD };
            block.update(&mut self.state, &StictionSample { e: r(pins.e), u: r(pins.u), h: r(pins.h), enable, flags });
        }
        let s = &self.state;
        let mut shown = vec![on(pins.enable && error == 0.0), on(error != 0.0), error];
        shown.extend([s.u_ff.value().as_f64(), f64::from(s.standing as u8), s.direction.into()]);
        shown.push(s.travel.value().as_f64());
        shown
    }
}

fn shown(block: &Block) -> Vec<f64> {
    block.all(&["Valid", "Error", "ErrorID", "UFf", "Standing", "Direction", "TravelSpent"])
}

fn of_case(case: &Case) -> Pins {
    let of = |name| case.param(name);
    Pins {
        enable: true,
        reset: false,
        restart: false,
        compensate: false,
        h: 1.0,
        e: 0.0,
        u: 0.0,
        flags: 0,
        limits: of("low").zip(of("high")),
        k: case.given("k"),
        ti: case.given("ti"),
        push: case.given("push") as i16,
        size: case.given("size"),
        withdraw: true,
        far: of("far").unwrap_or(0.0),
        options: [
            ("MaxSize", of("limit")),
            ("Hold", of("hold")),
            ("PushPeriod", of("period")),
            ("Band", of("band")),
            ("Rate", of("rate")),
            ("Release", of("release")),
            ("Travel", of("travel")),
            ("Watch", of("watch")),
        ],
    }
}

fn vectors<R: Number>() {
    let with_vectors = R::BUILD == Build::Lreal;
    for case in cases("stiction") {
        let (block, mut reference) = (Block::new::<R>("GlappStiction"), Reference::<R>::default());
        let mut pins = of_case(&case);
        // Seen off in a scan that counts for nothing.
        let before = Pins { h: 0.0, ..pins.clone() };
        before.set(&block);
        block.call();
        reference.scan(&before);
        for (i, (h, x)) in case.input.iter().enumerate() {
            (pins.h, pins.e, pins.u, pins.compensate, pins.flags) = (*h, x[0], x[1], x[2] != 0.0, x[3] as u16);
            pins.set(&block);
            block.call();
            let (expected, shown) = (reference.scan(&pins), shown(&block));
            assert!(same(&expected, &shown), "{}, scan {i}: {shown:?} instead of {expected:?}", case.name);
            let got = &shown[3..6];
            if with_vectors {
                let row = case.output.as_ref().unwrap()[i].as_array().unwrap();
                let expected: Vec<f64> = row.iter().map(|x| x.as_f64().unwrap_or(f64::NAN)).collect();
                assert!(same(&expected, got), "{}, scan {i}: {got:?} instead of {expected:?}", case.name);
            }
        }
    }
}

in_both!(vectors_lreal, vectors_real: vectors);

/// A loop that swings, with everything that can go wrong with it.
fn drawn(d: &mut Draw) -> Pins {
    let ti = d.between(0.5, 4.0);
    let ti = d.of(&[ti, ti, ti, 1e3]);
    Pins {
        enable: true,
        reset: false,
        restart: false,
        compensate: false,
        h: 0.25,
        e: 0.0,
        u: 0.0,
        flags: 0,
        limits: d.of(&[None, None, Some((-4.0, 4.0))]),
        k: d.of(&[0.5, -0.5]),
        ti,
        push: d.of(&[1, 2, 3]),
        size: d.of(&[1.0, 0.5, 2.0, 0.0]),
        withdraw: d.chance(0.8),
        far: d.of(&[0.0, 0.5]),
        options: OPTIONS.map(|pin| {
            let some: f64 = match pin {
                "MaxSize" => 3.0,
                "Hold" => d.of(&[0.25, 0.5]),
                "PushPeriod" => d.of(&[1.0, 2.0, 9.0]),
                "Band" => d.of(&[0.0, 0.1]),
                "Rate" => d.of(&[1.0, 20.0]),
                "Release" => d.of(&[0.5, 3.0]),
                "Watch" => d.of(&[37.5, 75.0]),
                _ => d.of(&[30.0, 900.0]),
            };
            // Two moves need a period with a hold of Ti.
            let some = if pin == "PushPeriod" { some.max(8.0 * ti.min(0.5)) } else { some };
            (pin, d.chance(0.5).then_some(some))
        }),
    }
}

fn spoil(p: &mut Pins, d: &mut Draw) {
    let none = d.of(&[f64::NAN, f64::INFINITY, f64::NEG_INFINITY]);
    let options = &mut p.options;
    match d.of(&[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13]) {
        0 => p.k = d.of(&[0.0, none]),
        1 => p.ti = d.of(&[0.0, -1.0, 2e9, none]),
        2 => p.push = d.of(&[0, 4, -1]),
        3 => p.size = d.of(&[-0.1, none, 1e31]),
        4 => p.far = d.of(&[-0.1, none]),
        5 => options[0].1 = Some(d.of(&[0.1, -0.5, none, 1e31])),
        6 => options[1].1 = Some(d.of(&[-1.0, none, 11.0 * p.ti])),
        7 => options[2].1 = Some(d.of(&[0.01, none, 1.1e3 * p.ti])),
        8 => options[3].1 = Some(d.of(&[-0.1, none, 1e31])),
        9 => options[4].1 = Some(d.of(&[-1.0, none])),
        10 => options[5].1 = Some(d.of(&[-1.0, none, 301.0, 11.0 * p.ti])),
        11 => options[6].1 = Some(d.of(&[-1.0, none])),
        12 => options[7].1 = Some(d.of(&[-1.0, none, 1.1e5 * p.ti])),
        _ => {
            p.limits = d.of(&[Some((1.0, 1.0)), Some((f64::NAN, 1.0)), Some((0.0, f64::INFINITY)), Some((-1e-3, 1e-3))])
        }
    }
}

fn random<R: Number>() {
    let (mut cover, mut cost, mut standings) = (Cover::new::<R>(), Cost::default(), [0_u32; 15]);
    for seed in 0..sequences() {
        let mut draw = Draw::new(700_000 + seed);
        let d = &mut draw;
        let usual = drawn(d);
        let (block, mut reference) = (Block::new::<R>("GlappStiction"), Reference::<R>::default());
        let (length, wrong, larger) = (d.of(&[3, 10, 20]), d.of(&[0.0, 0.0, 0.01, 0.04]), d.of(&[1.0, 1.0, 1.2, 3.0]));
        let (noise, asked) = (d.of(&[0.0, 0.02, 0.3]), d.of(&[2, 100, 600]));
        let (mut pins, mut level) = (usual.clone(), 0.0);
        for i in 0..900 {
            let side = if (i / length) % 2 == 0 { 1.0 } else { -1.0 };
            if wrong > 0.0 && d.chance(0.05) {
                pins = Pins { compensate: pins.compensate, ..usual.clone() };
                if d.chance(0.4) {
                    spoil(&mut pins, d);
                }
            }
            (pins.reset, pins.restart, pins.flags, pins.h, pins.enable) = (false, false, 0, 0.25, true);
            pins.compensate |= i == asked;
            let size = if pins.compensate { larger } else { 1.0 };
            level += 0.3 * side;
            pins.e = side * size + noise * d.between(-1.0, 1.0);
            pins.u = level + noise * d.between(-1.0, 1.0);
            if d.chance(wrong) {
                pins.flags = d.of(&[NOT_AUTO, BAD, AT_LOW, AT_HIGH, NOT_AUTO | BAD]);
            }
            if d.chance(wrong) {
                let bad = d.of(&[f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e32, -1e32, 1e36]);
                if d.chance(0.5) { pins.e = bad } else { pins.u = bad }
            }
            if d.chance(0.2 * wrong) {
                (pins.e, pins.u) = (0.9 * R::MOST.as_f64(), 0.9 * R::MOST.as_f64());
            }
            if d.chance(wrong) || (i < 2 && wrong > 0.0) {
                pins.h = d.of(&[0.0, -0.25, 5.0, f64::NAN, 1e9, 1e12]);
            }
            if d.chance(0.2 * wrong) {
                pins.compensate = !pins.compensate;
            }
            if d.chance(0.2 * wrong) {
                (pins.enable, pins.restart, pins.reset) = (d.chance(0.5), d.chance(0.5), d.chance(0.2));
            }
            if d.chance(0.1 * wrong) {
                block.0.borrow_mut().power_cut();
                reference.restart();
            }
            let expected = reference.scan(&pins);
            let got = cost.of(&block, || {
                pins.set(&block);
                block.call();
                shown(&block)
            });
            assert!(same(&expected, &got), "{seed}, scan {i}:\n{got:?} instead of\n{expected:?}\nfor {pins:?}");
            standings[got[4] as usize] += 1;
        }
        cover.collect(&block);
    }
    println!("standings {standings:?}");
    for standing in [Standing::Active, Standing::Waiting, Standing::Worse, Standing::TooMuchTravel, Standing::AtLimit] {
        assert!(standings[standing as usize] > 0, "{standing:?}");
    }
    cost.tell::<R>("GlappStiction");
    at_the_bounds::<R>();
    another_version::<R>(&mut cover);
    cover.holds(&["GlappStiction"]);
}

/// Settings at their bounds and beyond; limits that do not lie about 0.
fn at_the_bounds<R: Number>() {
    let mut usual = drawn(&mut Draw::new(1));
    usual.options = OPTIONS.map(|pin| (pin, None));
    usual = Pins { limits: Some((10.0, 14.0)), ti: 100.0, push: 1, size: 1.0, far: 0.0, e: 0.1, ..usual };
    let (mut refused, mut taken) = (0, 0);
    for (pin, value) in [
        ("Size", 4.0),
        ("Size", 4.5),
        ("MaxSize", 4.0),
        ("MaxSize", 4.5),
        ("Hold", 1000.0),
        ("Hold", 1001.0),
        ("PushPeriod", 1e5),
        ("PushPeriod", 1.1e5),
        ("PushPeriod", 20.0),
        ("PushPeriod", 19.0),
        ("Band", 4.0),
        ("Band", 4.5),
        ("Release", 300.0),
        ("Release", 301.0),
        ("Watch", 1e7),
        ("Watch", 1.1e7),
        ("Ti", 1e9),
        ("Ti", 1.1e9),
    ] {
        let mut pins = usual.clone();
        match pin {
            "Size" => pins.size = value,
            "Ti" => pins.ti = value,
            _ => pins.options = pins.options.map(|(one, x)| (one, if one == pin { Some(value) } else { x })),
        }
        if pin == "Hold" {
            pins.options[2].1 = Some(2002.0);
        }
        let (block, mut reference) = (Block::new::<R>("GlappStiction"), Reference::<R>::default());
        for i in 0..40 {
            pins = Pins { compensate: i > 3, h: 10.0, u: 12.0 + 0.05 * f64::from(i % 20), ..pins };
            pins.set(&block);
            block.call();
            let (expected, got) = (reference.scan(&pins), shown(&block));
            assert!(same(&expected, &got), "{pin} {value}, scan {i}:\n{got:?} instead of\n{expected:?}");
        }
        if block.on("Error") { refused += 1 } else { taken += 1 }
    }
    assert!(refused >= 8 && taken >= 8, "{refused} {taken}");
}

/// A program with another version of the retained variables is loaded: they are dropped, and that is told. Numbers so large that what is
/// worked out of them is none stop nothing.
fn another_version<R: Number>(cover: &mut Cover) {
    let block = Block::new::<R>("GlappStiction");
    let pins = Pins { size: 1.0, limits: None, ..drawn(&mut Draw::new(1)) };
    for (version, dropped) in [(1.0, 0.0), (2.0, 1.0)] {
        pins.set(&block);
        block.call();
        block.0.borrow_mut().power_cut();
        block.0.borrow_mut().spoil("StateVersion", version).unwrap();
        pins.set(&block);
        block.call();
        assert_eq!(block.get("Dropped"), dropped);
    }
    block.set("Reset", 1.0);
    block.call();
    assert!(!block.on("Dropped"));
    cover.collect(&block);
    for release in [1e-36, 1e-20] {
        let block = Block::new::<R>("GlappStiction");
        block.unheld();
        let mut pins = Pins { push: 2, size: 1e11, ti: 1e9, limits: None, ..drawn(&mut Draw::new(4)) };
        pins.options = OPTIONS.map(|pin| (pin, (pin == "Rate").then_some(9e36)));
        pins.options[5].1 = Some(release);
        for i in 0..60 {
            (pins.u, pins.h) = (if (i / 6) % 2 == 0 { 9e11 } else { -9e11 }, 1e8);
            pins.compensate = (3..50).contains(&i);
            pins.set(&block);
            block.call();
        }
        cover.collect(&block);
    }
}

in_both!(random_lreal, random_real: random);

/// The vectors have every standing that there is for it.
#[test]
fn the_vectors_have_every_standing() {
    let mut seen = [false; 15];
    for case in cases("stiction") {
        for row in case.output.as_ref().unwrap() {
            let standing = row.as_array().and_then(|row| row[1].as_u64().or(row[1].as_f64().map(|x| x as u64)));
            seen[standing.unwrap_or(1) as usize] = true;
            assert!(matches!(row, Value::Array(_)));
        }
    }
    let all: Vec<usize> = (0..15).filter(|standing| seen[*standing]).collect();
    assert_eq!(all, [0, 1, 2, 3, 6, 8, 10, 11]);
}
