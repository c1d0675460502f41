//! `GlappLoop`, the example beside a PID: what it shows and raises as a loop begins to swing, is repaired, and is set up wrongly.

use crate::common::{Block, Number};

/// Scans of a limit cycle of 1 about the setpoint with half-periods of 100 s: filtered, Δy is 0.97, and the width (0.5/10·100 − 1/1.5)·Δy, 4.20.
fn swings(one: &Block, scans: u32) {
    for scan in 0..scans {
        one.set("Pv", if (scan / 100) % 2 == 0 { -1.0 } else { 1.0 });
        one.call();
    }
}

fn runs<R: Number>() {
    let one = Block::new::<R>("GlappLoop");
    // Nobody has given K and Ti: it says so, and does not go by numbers of its own.
    for (given, error) in [(("H", 1.0), 1.0), (("K", 0.5), 2.0)] {
        one.set_all(&[given]);
        one.call();
        assert_eq!(one.all(&["AlarmSettings", "ErrorID", "Message"]), [1.0, error, 6.0]);
    }
    one.set_all(&[("Ti", 10.0), ("PvSpan", 100.0), ("Op", 50.0), ("Acceptable", 2.0)]);
    one.call();
    assert_eq!(one.all(&["WidthFound", "Width", "AlarmWide", "Message"]), [0.0, 0.0, 0.0, 1.0]);
    // OP is known and does not move here: the detector believes the controller's own numbers, since Td is 0. Fewer than nine detections are
    // shown and raise nothing: without a gap, under a load that wanders by 0.2 %/√s, a single one was beyond 1 % in 59 of 120 loops.
    swings(&one, 800);
    assert!((one.get("Width") - 4.2).abs() < 0.01 && (1.0..9.0).contains(&one.get("Accepted")));
    assert_eq!(one.all(&["WidthFound", "AlarmWide", "Message"]), [1.0, 0.0, 3.0]);
    swings(&one, 1500);
    let width = one.get("Width");
    assert!((width - 4.2).abs() < 0.01, "{width}");
    assert!(one.get("WidthLow") <= width && width <= one.get("WidthHigh"));
    assert!(one.get("Accepted") >= 9.0);
    assert_eq!(one.all(&["WidthFound", "AlarmWide", "AlarmSettings", "Message"]), [1.0, 1.0, 0.0, 5.0]);
    // Acceptable now; the alarm goes where the width is below 90 % of it.
    for (acceptable, alarm, message) in [(4.5, 1.0, 5.0), (5.0, 0.0, 3.0)] {
        one.set("Acceptable", acceptable);
        one.call();
        assert_eq!(one.all(&["AlarmWide", "Message"]), [alarm, message]);
    }
    one.set("Automatic", 0.0);
    one.call();
    assert_eq!(one.get("Message"), 4.0);
    one.set("Automatic", 1.0);
    // The button stays pressed: detections are forgotten once.
    one.set_all(&[("Repaired", 1.0)]);
    one.call();
    assert_eq!(one.all(&["WidthFound", "Accepted", "Message"]), [0.0, 0.0, 1.0]);
    swings(&one, 1500);
    assert_eq!(one.get("WidthFound"), 1.0);
    // The task is given a period five times as long: the wait is not three times the old one, beyond which every scan is a gap.
    let accepted = one.get("Accepted");
    one.set_all(&[("H", 5.0), ("Ti", 50.0)]);
    swings(&one, 1500);
    assert!(one.get("Accepted") > accepted + 9.0);
    // PV stays no number, and nobody has wired Bad: after ten scans it says so, without an alarm of its own.
    one.set("Pv", f64::NAN);
    for scan in 1..=12 {
        one.call();
        let shown = one.all(&["ErrorID", "AlarmSettings", "Message"]);
        assert_eq!(shown, if scan < 10 { [0.0, 0.0, 3.0] } else { [83.0, 0.0, 4.0] }, "{scan}");
    }
    // A scan time that cannot be is an alarm at once: MaxH goes with it.
    one.set_all(&[("Pv", 0.0), ("H", -1.0)]);
    one.call();
    assert_eq!(one.all(&["ErrorID", "AlarmSettings", "Message"]), [8.0, 1.0, 6.0]);
    one.set("H", 1.0);
    one.set("Ti", 0.0);
    one.call();
    assert_eq!(one.all(&["AlarmSettings", "ErrorID", "Message"]), [1.0, 2.0, 6.0]);
    // An OP that is not connected is not known: it does not stand at its lower limit, where no half-period would count.
    let open = Block::new::<R>("GlappLoop");
    open.set_all(&[("H", 1.0), ("K", 0.5), ("Ti", 10.0), ("PvSpan", 100.0)]);
    swings(&open, 1500);
    let width = open.get("Width");
    assert!((width - 4.2).abs() < 0.01, "{width}");
    // The gain of the process, where it is known, takes the place of 1.5 %/%: (0.5/10·100 − 1/1)·0.97.
    open.set("Kp", 1.0);
    swings(&open, 1500);
    let width = open.get("Width");
    assert!((width - 3.88).abs() < 0.01, "{width}");
}

in_both!(lreal, real: runs);
