//! `GlappDemo`: the bits of the same loop put together from the core, and the gap is found. Ten scans for each of the sequences that the
//! other tests run, 200 or `GLAPP_SEQUENCES`, and 8000 more: `GLAPP_SEQUENCES=10000` makes them more than 10^5.

use crate::common::control::{Core, Row, TWINS, core};
use crate::common::detector::{Pins, Reference};
use crate::common::{Block, Number, same};

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
    let mut detector = Reference::<R>::default();
    let usual = Pins { h, k: 2.0, ti: 2.0, td: Some(0.0), kp: Some(1.0), tf: Some(0.2), ..Pins::default() };
    let mut measured = 50.0;
    let (mut width, mut first) = (0.0, None);
    for scan in 0..scans {
        noise.call(&[("X", measured)]);
        let pv = noise.get("Y");
        pid.call(&[("Pv", pv)]);
        let op = pid.get("Output");
        gap.call(&[("X", op)]);
        process.call(&[("X", gap.get("Y"))]);
        measured = process.get("YNext");
        let flag = |name: &str, bit: u16| if pid.get(name) != 0.0 { bit } else { 0 };
        use glapp_core::status::{AT_HIGH, AT_LOW, NOT_AUTO};
        let flags = flag("NotAuto", NOT_AUTO) | flag("AtLow", AT_LOW) | flag("AtHigh", AT_HIGH);
        let (found, _) = detector.scan(&Pins { sp: pid.get("Ysp"), pv, op: Some(op), flags, ..usual.clone() });
        if found[9] != 0.0 {
            width = found[3];
            first = first.or(Some(scan));
        }
        demo.call();
        let (expected, got) =
            ([width, found[9], op, gap.get("Y"), pv], demo.all(&["Width", "Found", "Op", "Valve", "Pv"]));
        assert!(same(&expected, &got), "scan {scan}: {got:?} instead of {expected:?}");
    }
    assert!(demo.on("Found") && (width - 2.0).abs() < 0.3, "{width}");
    println!("{:?}: {scans} scans, width {width}, found first after {first:?}", R::BUILD);
}

in_both!(lreal, real: runs);
