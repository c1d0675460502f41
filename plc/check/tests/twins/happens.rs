//! The table *What happens when* of `docs/plc.md`: a detection with compensation beside a controller, and the controller with both inside,
//! while u_FF is in force.

use crate::common::Number;
use glapp_plc_check::Instance;

/// Both blocks, with u_FF = 1 after 40 scans of 1 s; `Release` is 4 s.
struct Both {
    detection: Instance<'static>,
    controller: Instance<'static>,
    /// Output of the controller after the scans.
    held: f64,
}

impl Both {
    fn new<R: Number>() -> Self {
        let new = |name| Instance::new(R::library(), name).unwrap();
        let mut both =
            Self { detection: new("GlappBacklashDetection"), controller: new("GlappPidAdvanced"), held: 0.0 };
        both.connect();
        both.set_both(&[("Settings.Compensation.Release", 4.0)]);
        for (name, value) in [("Start", 40.0), ("Settings.Controller.Low", 0.0), ("Settings.Controller.High", 100.0)] {
            both.controller.set(name, value).unwrap();
        }
        for scan in 0..40 {
            both.set_both(&[("Pv", if (5..20).contains(&scan) { 51.0 } else { 49.0 })]);
            both.call();
            if scan == 0 {
                let output = both.controller.get("Output").unwrap();
                assert!((output - 40.0).abs() < 0.1, "it begins at Start, not at {output}");
                assert_eq!(both.u_ff(), [0.0, 0.0], "it is off");
                both.set_both(&[("Compensate", 1.0)]);
            }
        }
        assert_eq!(both.u_ff(), [1.0, 1.0]);
        both.held = both.controller.get("Output").unwrap();
        both
    }

    /// The signals and settings that a program hands over in every scan.
    fn connect(&mut self) {
        self.set_both(&[("Enable", 1.0), ("H", 1.0), ("Settings.Compensates", 1.0)]);
        self.set_both(&[("Settings.Compensation.Way", 1.0), ("Settings.Compensation.Size", 2.0)]);
        for (name, value) in [("K", 1.0), ("Ti", 20.0)] {
            self.detection.set(&format!("Settings.Detector.{name}"), value).unwrap();
            self.controller.set(&format!("Settings.Controller.{name}"), value).unwrap();
        }
        for (name, value) in [("Sp", 50.0), ("Output", 50.0)] {
            self.detection.set(name, value).unwrap();
        }
        self.controller.set("OwnSp", 50.0).unwrap();
    }

    fn set_both(&mut self, pins: &[(&str, f64)]) {
        for (pin, value) in pins {
            self.detection.set(pin, *value).unwrap();
            self.controller.set(pin, *value).unwrap();
        }
    }

    fn call(&mut self) {
        self.detection.call().unwrap();
        self.controller.call().unwrap();
    }

    fn u_ff(&self) -> [f64; 2] {
        [&self.detection, &self.controller].map(|one| one.get("UFf").unwrap())
    }

    /// Whether a half-period ended, and with which reason, in the detection alone.
    fn ended(&self) -> Option<f64> {
        (self.detection.get("Detected.Ended").unwrap() != 0.0)
            .then(|| self.detection.get("Detected.Record.Reason").unwrap())
    }

    fn holds(&self) -> bool {
        self.controller.get("Output").unwrap() == self.held
    }
}

fn runs<R: Number>() {
    // Bad or NaN: the half-period ends, the output holds, u_FF goes within Release, or at once with the output.
    for (pin, other, value) in [("Bad", "PvBad", 1.0), ("Pv", "Pv", f64::NAN)] {
        let mut both = Both::new::<R>();
        both.detection.set(pin, value).unwrap();
        both.controller.set(other, value).unwrap();
        for left in [0.75, 0.5, 0.25, 0.0] {
            both.call();
            assert_eq!((both.u_ff(), both.holds()), ([left, 0.0], true), "{pin}");
            assert_eq!(both.ended(), (left == 0.75).then_some(2.0));
        }
    }
    // Manual: u_FF is gone at once, the setpoint follows PV.
    let mut both = Both::new::<R>();
    both.detection.set("NotAuto", 1.0).unwrap();
    both.controller.set("Mode", 0.0).unwrap();
    both.call();
    assert_eq!((both.u_ff(), both.controller.get("Ysp").unwrap()), ([0.0, 0.0], 49.0));
    both.controller.set("ManualOutput", 30.0).unwrap();
    both.call();
    assert_eq!(both.controller.get("Output").unwrap(), 30.0);
    both.controller.set("Mode", 1.0).unwrap();
    both.call();
    assert!((both.controller.get("Output").unwrap() - 30.0).abs() < 0.1, "the way back has no bump");
    // At a limit.
    let mut both = Both::new::<R>();
    both.detection.set("AtLow", 1.0).unwrap();
    both.controller.set("Settings.Controller.Low", 60.0).unwrap();
    for left in [0.75, 0.5, 0.25, 0.0] {
        both.call();
        assert_eq!((both.u_ff(), both.controller.get("Output").unwrap()), ([left, left], 60.0));
    }
    // A jump of the scan time, forward and back, or no number.
    for h in [60.0, -1.0, f64::NAN] {
        let mut both = Both::new::<R>();
        both.set_both(&[("H", h)]);
        both.call();
        assert_eq!((both.u_ff(), both.holds(), both.ended()), ([1.0, 0.0], true, Some(1.0)), "{h}");
    }
    // A longer period of the task: a gap in every scan, until Restart; no gap where MaxH goes with it.
    for (max_h, gaps) in [(0.0, true), (15.0, false)] {
        let mut both = Both::new::<R>();
        both.set_both(&[("H", 5.0)]);
        both.detection.set("Settings.Detector.MaxH", max_h).unwrap();
        for _ in 0..10 {
            both.call();
            assert_eq!(both.ended(), gaps.then_some(1.0));
        }
        both.set_both(&[("Restart", 1.0)]);
        both.call();
        both.set_both(&[("Restart", 0.0)]);
        both.call();
        both.call();
        assert_eq!(both.ended(), None);
    }
    // A repeated scan.
    let mut both = Both::new::<R>();
    both.set_both(&[("H", 0.0)]);
    both.call();
    assert_eq!((both.u_ff(), both.holds(), both.ended()), ([1.0, 0.0], true, None));
    // A setting out of bounds: all goes on by the last good ones.
    let mut both = Both::new::<R>();
    both.detection.set("Settings.Detector.K", 0.0).unwrap();
    both.controller.set("Settings.Controller.K", 0.0).unwrap();
    both.call();
    for one in [&both.detection, &both.controller] {
        assert_eq!(["Error", "ErrorID", "UFf"].map(|pin| one.get(pin).unwrap()), [1.0, 1.0, 1.0]);
    }
    assert!(!both.holds(), "it controls");
    // Switched off.
    let mut both = Both::new::<R>();
    both.set_both(&[("Enable", 0.0)]);
    for left in [0.75, 0.5, 0.25, 0.0] {
        both.call();
        assert_eq!((both.u_ff(), both.holds()), ([left, left], true));
    }
    // A power cut: off, until Compensate has been FALSE; the output goes on from where it was.
    let mut both = Both::new::<R>();
    both.detection.power_cut();
    both.controller.power_cut();
    both.connect();
    both.set_both(&[("Pv", 49.0), ("Compensate", 1.0)]);
    for scan in 0..40 {
        both.set_both(&[("Pv", if (5..20).contains(&scan) { 51.0 } else { 49.0 })]);
        both.call();
        assert_eq!(both.u_ff(), [0.0, 0.0]);
        if scan == 0 {
            assert!((both.controller.get("Output").unwrap() - both.held).abs() < 0.1);
        }
    }
    // Restart while a setting is refused: u_FF of before does not stay at another maker's feed-forward.
    let mut foreign = Instance::new(R::library(), "GlappForeignDetection").unwrap();
    let pins = [
        ("Enable", 1.0),
        ("H", 1.0),
        ("Sp", 50.0),
        ("Op", 50.0),
        ("Settings.Detector.K", 1.0),
        ("Settings.Detector.Ti", 20.0),
        ("Settings.Compensates", 1.0),
        ("Settings.Compensation.Way", 1.0),
        ("Settings.Compensation.Size", 2.0),
    ];
    for (pin, value) in pins {
        foreign.set(pin, value).unwrap();
    }
    for scan in 0..40 {
        foreign.set("Pv", if (5..20).contains(&scan) { 51.0 } else { 49.0 }).unwrap();
        foreign.set("Compensate", f64::from(u8::from(scan > 0))).unwrap();
        foreign.call().unwrap();
    }
    assert_eq!(foreign.get("UFf").unwrap(), 1.0);
    foreign.set("Settings.Detector.K", 0.0).unwrap();
    for restart in [1.0, 0.0] {
        foreign.set("Restart", restart).unwrap();
        foreign.call().unwrap();
        let told = ["UFf", "Compensating.Standing", "ErrorID"].map(|pin| foreign.get(pin).unwrap());
        assert_eq!(told, [0.0, 1.0, 1.0]);
    }
}

in_both!(lreal, real: runs);
