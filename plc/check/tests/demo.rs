//! `GlappDemo`: the bits of the same loop put together from the core; the gap is found, and compensated from scan 4000 on. Ten scans for each
//! of the sequences that the other tests run, 200 or `GLAPP_SEQUENCES`, and 8000 more: `GLAPP_SEQUENCES=10000` makes them more than 10^5.

mod common;

use common::control::{Core, Row, TWINS, core};
use common::detection::{Pins, Reference};
use common::{Block, Number, compensate, detector, same};

/// A block of the core that is driven by its pins; what it shows by name.
struct Part {
    row: Row,
    core: Core,
    shown: &'static [&'static str],
    out: Vec<f64>,
}

impl Part {
    fn new<R: Number>(name: &str, pins: &[(&str, f64)]) -> Self {
        let twin = TWINS.iter().find(|twin| twin.name == name).unwrap();
        Self { row: Row::new(twin, pins), core: core::<R>(twin), shown: twin.shown, out: vec![] }
    }

    fn call(&mut self, pins: &[(&str, f64)]) {
        self.row.set_all(pins);
        self.out = (self.core)(&self.row);
    }

    fn get(&self, name: &str) -> f64 {
        self.out[self.shown.iter().position(|shown| *shown == name).unwrap()]
    }
}

fn runs<R: Number>() {
    let sequences: usize = std::env::var("GLAPP_SEQUENCES").map_or(200, |count| count.parse().unwrap());
    let scans = 8_000 + 10 * sequences;
    let h = R::of(0.1).as_f64();
    let demo = Block::new::<R>("GlappDemo");
    let mut noise = Part::new::<R>("noise", &[("Seed", 1.0), ("Amplitude", 0.1)]);
    let mut gap = Part::new::<R>("backlash", &[("D", 2.0)]);
    let rest = [("Start", 50.0), ("Gain", 1.0), ("T1", 3.0), ("T2", 1.0), ("H", h), ("Load", 5.0)];
    let mut process = Part::new::<R>("process_sim", &rest);
    let law = [("K", 2.0), ("Ti", 2.0), ("B", 1.0), ("Tf", 0.2), ("HasLow", 1.0), ("HasHigh", 1.0), ("High", 100.0)];
    let mut pid = Part::new::<R>("pid_module", &law);
    let run = [("Enable", 1.0), ("Start", 50.0), ("H", h), ("Mode", 1.0), ("HasOwnSp", 1.0), ("OwnSp", 50.0)];
    pid.row.set_all(&run);
    let mut reference = Reference::<R>::default();
    let law = detector::Pins { h, k: 2.0, ti: 2.0, td: Some(0.0), kp: Some(1.0), tf: Some(0.2), ..Default::default() };
    let mut pins = Pins {
        detector: detector::Pins { op_limits: Some((0.0, 100.0)), ..law },
        compensate: false,
        compensation: Some(compensate::Settings { source: 3, ..Default::default() }),
        cut: false,
        foreign: None,
    };
    let (mut measured, mut u_ff) = (50.0, 0.0);
    let (mut width, mut first) = (0.0, None);
    // The swing of PV without noise before and after, over 2000 scans each.
    let mut swings = [[f64::INFINITY, f64::NEG_INFINITY]; 2];
    for scan in 0..scans {
        noise.call(&[("X", measured)]);
        let pv = noise.get("Y");
        pid.call(&[("Pv", pv), ("Ff", u_ff)]);
        let op = pid.get("Output");
        gap.call(&[("X", op)]);
        process.call(&[("X", gap.get("Y"))]);
        measured = process.get("YNext");
        let flag = |name: &str, bit: u16| if pid.get(name) != 0.0 { bit } else { 0 };
        use glapp_core::status::{AT_HIGH, AT_LOW, NOT_AUTO};
        let flags = flag("NotAuto", NOT_AUTO) | flag("AtLow", AT_LOW) | flag("AtHigh", AT_HIGH);
        pins.compensate = scan >= 4000;
        pins.detector = detector::Pins { sp: pid.get("Ysp"), pv, op: Some(op), flags, ..pins.detector };
        let row = reference.scan(&pins).row;
        // In the order of the row: u_FF, the estimate of the whole gap, and whether that is shown.
        let (found, value) = (row[17], row[12]);
        u_ff = row[5];
        if found != 0.0 {
            width = value;
            first = first.or(Some(scan));
        }
        if scan == 4000 {
            demo.0.borrow_mut().spoil("Compensate", 1.0).unwrap();
        }
        demo.call();
        let expected = [width, found, op, gap.get("Y"), pv, u_ff];
        let got = demo.all(&["Width", "Found", "Op", "Valve", "Pv", "UFf"]);
        assert!(same(&expected, &got), "scan {scan}: {got:?} instead of {expected:?}");
        if scan >= 2000 && scan % 4000 >= 2000 {
            let [low, high] = &mut swings[usize::from(scan >= 4000)];
            (*low, *high) = (low.min(measured), high.max(measured));
        }
    }
    let [before, after] = swings.map(|[low, high]| high - low);
    println!("{:?}: {scans} scans, width {width}, found first after {first:?}, PV swings {before}, then {after}", R::BUILD);
    assert!(demo.on("Found") && (width - 2.0).abs() < 0.3 && u_ff != 0.0, "{width}");
    assert!(after < 0.5 * before, "{before} {after}");
}

#[test]
fn lreal() {
    runs::<f64>();
}

#[test]
fn real() {
    runs::<f32>();
}
