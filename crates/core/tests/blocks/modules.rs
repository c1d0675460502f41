//! Control modules: their promises when modes change, values are bad, limits move and time jumps.

use glapp_core::modules::{
    BacklashDetection, BacklashDetectionSettings, BacklashDetectionState, Gains, Mode, Pid, PidAdvanced,
    PidAdvancedSettings, PidAdvancedState, PidSettings, PidState, SCHEDULE_ROWS,
};
use glapp_core::status::{AT_HIGH, AT_LOW, BAD, BAD_FF, BAD_LIMITS, BAD_SP, DATA_GAP, NOT_AUTO, Status};
use glapp_core::{Backward, CompensationSettings, DetectorSettings, Forward, Reason, Saturation, Way};
use proptest::prelude::*;

const H: f64 = 0.1;

fn settings() -> PidSettings<f64> {
    PidSettings { low: 0.0, high: 100.0, ..PidSettings::ideal(2.0, 5.0, 0.5) }
}

/// One controller with what goes in and comes back at each scan.
struct Rig {
    pid: Pid<f64>,
    state: PidState<f64>,
    pv: Forward<f64>,
    sp: Forward<f64>,
    ff: Forward<f64>,
    back: Backward<f64>,
    h: f64,
}

impl Rig {
    fn new(settings: PidSettings<f64>) -> Self {
        let good = |x: f64| Forward::from(x);
        let back = Backward::default();
        let pid = Pid::new(settings).unwrap();
        Self { pid, state: PidState::at(40.0), pv: good(50.0), sp: good(50.0), ff: good(0.0), back, h: H }
    }

    fn scan(&mut self) -> f64 {
        let u = self.pid.forward(&mut self.state, self.pv, self.sp, self.ff, self.h);
        self.pid.backward(&mut self.state, self.back);
        assert!(u.is_good());
        u.value
    }

    /// The most that one scan may add where nothing but time passes.
    fn integration(&self) -> f64 {
        let s = self.pid.settings();
        (s.k * H / s.ti * (self.state.sp - self.state.yf)).abs() + 1e-9
    }
}

#[test]
fn parameters_out_of_bounds_are_named() {
    let ideal = PidSettings::ideal(1.0, 2.0, 0.0);
    for (settings, name) in [
        (PidSettings { k: 0.0, ..ideal }, "k"),
        (PidSettings { ti: f64::NAN, ..ideal }, "ti"),
        (PidSettings { td: -1.0, ..ideal }, "td"),
        (PidSettings { b: 1.1, ..ideal }, "b"),
        (PidSettings { c: -0.1, ..ideal }, "c"),
        (PidSettings { tf: -1.0, ..ideal }, "tf"),
        (PidSettings { low: 5.0, high: 5.0, ..ideal }, "low"),
        (PidSettings { rate: 0.0, ..ideal }, "rate"),
        (PidSettings { max_h: 0.0, ..ideal }, "max_h"),
    ] {
        assert_eq!(Pid::new(settings).unwrap_err().name, name);
    }
    assert_eq!(PidSettings::series(1.0, 0.0, 1.0).unwrap_err().name, "ti");
    assert_eq!(PidSettings::series(1.0, 1.0, -1.0).unwrap_err().name, "td");
    assert_eq!(PidSettings::parallel(0.0, 1.0, 1.0).unwrap_err().name, "kp");
    assert_eq!(PidSettings::parallel(1.0, -1.0, 1.0).unwrap_err().name, "ki");
    assert_eq!(PidSettings::parallel(1.0, 0.0, 1.0).unwrap_err().name, "ki");
    assert_eq!(PidSettings::parallel(-1.0, -1.0, 1.0).unwrap_err().name, "kd");
}

#[test]
fn rows_of_a_schedule_out_of_bounds_are_named() {
    let row = |at, k, ti, td| Gains { at, k, ti, td };
    let of = |rows: &[Gains<f64>]| {
        let mut schedule = [Gains::default(); SCHEDULE_ROWS];
        schedule[..rows.len()].copy_from_slice(rows);
        PidAdvanced::new(PidAdvancedSettings { schedule, rows: rows.len(), ..PidAdvancedSettings::new(settings()) })
    };
    assert_eq!(of(&[row(1.0, 1.0, 1.0, 0.0), row(1.0, 1.0, 1.0, 0.0)]).unwrap_err().name, "at of row 2");
    assert_eq!(of(&[row(1.0, -1.0, 1.0, 0.0)]).unwrap_err().name, "k of row 1");
    assert_eq!(of(&[row(1.0, 1.0, 0.0, 0.0)]).unwrap_err().name, "ti of row 1");
    assert_eq!(of(&[row(1.0, 1.0, 1.0, -1.0)]).unwrap_err().name, "td of row 1");
    let many = PidAdvancedSettings { rows: SCHEDULE_ROWS + 1, ..PidAdvancedSettings::new(settings()) };
    assert_eq!(PidAdvanced::new(many).unwrap_err().name, "rows");
}

#[test]
fn every_parameter_of_a_schedule_has_its_number() {
    let good = Gains { at: 0.0, k: 1.0, ti: 1.0, td: 0.0 };
    let mut usual = PidAdvancedSettings { rows: SCHEDULE_ROWS, ..PidAdvancedSettings::new(settings()) };
    for (i, row) in usual.schedule.iter_mut().enumerate() {
        *row = Gains { at: i as f64, ..good };
    }
    let number = |settings| PidAdvanced::new(settings).unwrap_err().number().unwrap();
    assert_eq!(number(PidAdvancedSettings { rows: 9, ..usual }), 46);
    for (i, first) in (0..SCHEDULE_ROWS).zip((47..).step_by(4)) {
        let row = usual.schedule[i];
        let wrong = [
            Gains { at: f64::NAN, ..row },
            Gains { k: -1.0, ..row },
            Gains { ti: 0.0, ..row },
            Gains { td: -1.0, ..row },
        ];
        for (wrong, expected) in wrong.into_iter().zip(first..) {
            let mut spoilt = usual;
            spoilt.schedule[i] = wrong;
            assert_eq!(number(spoilt), expected);
        }
    }
}

/// The product of the gains vanishes in 32 bits.
#[test]
fn gains_so_small_still_have_a_sign() {
    let mut schedule = [Gains::default(); SCHEDULE_ROWS];
    schedule[0] = Gains { at: 0.0, k: 1e-25_f32, ti: 1.0, td: 0.0 };
    let small = PidAdvancedSettings::new(PidSettings::ideal(1e-25, 1.0, 0.0));
    assert!(PidAdvanced::new(PidAdvancedSettings { schedule, rows: 1, ..small }).is_ok());
}

/// Faults of a scan, and changes with it.
const FAULTS: [&str; 10] = [
    "none", "pv not a number", "pv flagged", "sp bad", "ff bad", "time jumps", "time stands still", "limits cross",
    "limits are no number", "not followed",
];
const CHANGES: [(Mode, Mode); 9] = [
    (Mode::Manual, Mode::Manual),
    (Mode::Manual, Mode::Auto),
    (Mode::Manual, Mode::External),
    (Mode::Auto, Mode::Manual),
    (Mode::Auto, Mode::Auto),
    (Mode::Auto, Mode::External),
    (Mode::External, Mode::Manual),
    (Mode::External, Mode::Auto),
    (Mode::External, Mode::External),
];

/// Puts the fault on the rig; gives the error that it must raise.
fn fail(rig: &mut Rig, fault: &str) -> Status {
    match fault {
        "pv not a number" => rig.pv = f64::NAN.into(),
        "pv flagged" => rig.pv = Forward::new(90.0, BAD),
        "sp bad" => rig.sp = f64::NAN.into(),
        "ff bad" => rig.ff = Forward::new(30.0, BAD),
        "time jumps" => rig.h = 60.0,
        "time stands still" => rig.h = 0.0,
        "limits cross" => rig.back = Backward { low: 90.0, high: 10.0, ..Backward::default() },
        "limits are no number" => rig.back = Backward { low: f64::NAN, ..Backward::default() },
        "not followed" if rig.back.flags == 0 => {
            rig.back = Backward { flags: NOT_AUTO, tracking: rig.state.output, ..Backward::default() };
        }
        _ => {}
    }
    match fault {
        "pv not a number" | "pv flagged" => BAD,
        "sp bad" if rig.state.mode == Mode::External => BAD_SP,
        "ff bad" => BAD_FF,
        "time jumps" | "time stands still" => DATA_GAP,
        "limits cross" | "limits are no number" => BAD_LIMITS,
        _ => 0,
    }
}

/// Mends it; what could not be seen meanwhile has moved.
fn mend(rig: &mut Rig, fault: &str) {
    (rig.pv, rig.h, rig.back) = (48.0.into(), H, Backward::default());
    match fault {
        "pv not a number" | "pv flagged" | "time jumps" | "not followed" => rig.pv = 45.0.into(),
        "sp bad" if rig.state.mode == Mode::External => rig.sp = 60.0.into(),
        "sp bad" => rig.sp = 50.0.into(),
        "ff bad" => rig.ff = 30.0.into(),
        _ => {}
    }
}

#[test]
fn every_mode_change_in_every_fault_is_held_and_recovers_without_a_bump() {
    for fault in FAULTS {
        for (from, to) in CHANGES {
            // The mode changes before the fault, with its beginning, in its middle, with its end and after it.
            for at in [3, 5, 10, 15, 20] {
                let place = format!("{fault}, {from:?} to {to:?} at {at}");
                let mut rig = Rig::new(settings());
                (rig.state.mode, rig.state.sp) = (from, 50.0);
                // The process value rests off the setpoint: only integration may move the output.
                rig.pv = 48.0.into();
                let mut last = 0.0;
                for _ in 0..20 {
                    last = rig.scan();
                }
                for k in 0..30 {
                    rig.state.mode = if k < at { from } else { to };
                    let mut expected = 0;
                    if k == 15 {
                        mend(&mut rig, fault);
                    } else if (5..15).contains(&k) {
                        expected = fail(&mut rig, fault);
                    }
                    let u = rig.scan();
                    assert!((0.0..=100.0).contains(&u), "{place}");
                    assert!((u - last).abs() <= rig.integration(), "{place}, scan {k}: {last} to {u}");
                    // The backward signal is known one scan later.
                    if k != 5 && k != 15 {
                        assert_eq!(rig.state.error, expected, "{place}, scan {k}");
                    }
                    if expected & (BAD | DATA_GAP) != 0 {
                        assert_eq!(u, last, "{place}, scan {k}: not held");
                    }
                    if k > 15 && rig.state.mode != Mode::Manual {
                        assert_ne!(u, last, "{place}, scan {k}: not at work again");
                    }
                    last = u;
                }
            }
        }
    }
}

#[test]
fn in_a_loop_at_rest_the_first_scan_goes_on_as_from_a_scan_before() {
    let settings = PidSettings { b: 0.5, tf: 0.0, rate: f64::MAX, ..settings() };
    let pid = Pid::new(settings).unwrap();
    let scan = |s: &mut PidState<f64>, pv: f64, sp: f64| pid.forward(s, pv.into(), sp.into(), 0.0.into(), H).value;
    for mode in [Mode::Auto, Mode::External] {
        let mut rested = PidState::at(40.0);
        (rested.mode, rested.sp) = (mode, 50.0);
        assert!((scan(&mut rested, 50.0, 50.0) - 40.0).abs() < 1e-12);
        let mut begun = pid.at_rest(mode, 50.0, 40.0);
        for k in 0..20 {
            let (pv, sp) = (50.0 + 0.1 * f64::from(k % 3), 51.0);
            let (a, b) = (scan(&mut rested, pv, sp), scan(&mut begun, pv, sp));
            assert!((a - b).abs() < 1e-12 && (mode == Mode::Auto || a != 40.0), "{mode:?}, scan {k}: {a} and {b}");
        }
    }
}

/// A compensation of 1.5 on the way up, at no more than 2 a second.
fn compensating() -> PidAdvanced<f64> {
    let compensation = CompensationSettings {
        band: 0.1,
        rate: 2.0,
        watch: 1000.0,
        travel: 1e9,
        reversals: 1e9,
        ..CompensationSettings::new(Way::Inverse, 2.0, 2.0, 1.5, 1.0)
    };
    let advanced = PidAdvancedSettings { compensation: Some(compensation), ..PidAdvancedSettings::new(settings()) };
    PidAdvanced::new(advanced).unwrap()
}

#[test]
fn while_compensating_every_mode_change_in_every_fault_is_without_a_bump_too() {
    for fault in FAULTS.into_iter().chain(["detector reset", "compensation off"]) {
        for (from, to) in CHANGES {
            for at in [3, 5, 10, 15, 20] {
                let place = format!("{fault}, {from:?} to {to:?} at {at}");
                let pid = compensating();
                let mut s = PidAdvancedState::at(40.0);
                let mut rig = Rig::new(settings());
                rig.pv = 48.0.into();
                s.detection.compensate = true;
                let mut scan = |rig: &mut Rig, mode: Mode, k: usize| {
                    (s.pid.mode, s.pid.sp) = (mode, if mode == Mode::Auto { 50.0 } else { s.pid.sp });
                    if fault == "detector reset" && k == 5 {
                        s.detection.reset();
                    }
                    s.detection.compensate = !(fault == "compensation off" && (5..15).contains(&k));
                    rig.state = s.pid;
                    if (5..15).contains(&k) {
                        fail(rig, fault);
                    } else if k == 15 {
                        mend(rig, fault);
                    }
                    let ff = if fault == "ff bad" { rig.ff } else { 0.0.into() };
                    let u = pid.forward(&mut s, rig.pv, rig.sp, ff, 0.0.into(), rig.h).value;
                    pid.backward(&mut s, rig.back);
                    rig.state = s.pid;
                    (u, s.detection.compensation.u_ff)
                };
                let mut last = (0.0, 0.0);
                for k in 0..60 {
                    // Down, then up: it comes in with a reversal.
                    rig.pv = if k < 20 { 52.0 } else { 48.0 }.into();
                    last = scan(&mut rig, Mode::External, 100);
                }
                assert!(last.1 > 0.5, "{place}: it must compensate: {last:?}");
                for k in 0..40 {
                    let now = scan(&mut rig, if k < at { from } else { to }, k);
                    let most = rig.integration() + 2.0 * H;
                    assert!((now.0 - last.0).abs() <= most, "{place}, scan {k}: {last:?} to {now:?}");
                    last = now;
                }
            }
        }
    }
}

#[test]
fn before_the_first_good_sample_the_output_is_where_it_was_put() {
    let mut rig = Rig::new(PidSettings { high: 30.0, ..settings() });
    rig.pv = f64::NAN.into();
    assert_eq!(rig.scan(), 30.0); // put at 40, kept within the limits
    rig.pv = 20.0.into();
    rig.sp = 20.0.into();
    rig.state.mode = Mode::External;
    assert_eq!(rig.scan(), 30.0);
}

#[test]
fn a_bad_setpoint_or_manual_value_of_the_operator_is_not_used() {
    let mut rig = Rig::new(settings());
    (rig.state.mode, rig.state.sp) = (Mode::Auto, 50.0);
    let before = rig.scan();
    rig.state.sp = f64::NAN;
    assert_eq!((rig.scan(), rig.state.error), (before, BAD_SP));
    (rig.state.mode, rig.state.manual) = (Mode::Manual, f64::INFINITY);
    assert_eq!(rig.scan(), before);
}

#[test]
fn the_law_is_that_of_the_bare_block() {
    let limits = Saturation::new(-1.0, 1.0).unwrap();
    let bare = glapp_core::Pid::new(0.8, 5.0, 0.7, 0.5, limits).unwrap();
    let mut bare_state = glapp_core::PidState::default();
    let settings = PidSettings { b: 0.5, low: -1.0, high: 1.0, ..PidSettings::ideal(0.8, 5.0, 0.7) };
    let pid = Pid::new(settings).unwrap();
    let mut state = PidState::default();
    state.mode = Mode::External;
    bare.track(&mut bare_state, 0.5, 0.0, 0.0, H);
    for k in 0..500 {
        // Far enough to meet both limits.
        let y = 3.0 * (f64::from(k) * 0.13).sin();
        let expected = bare.update(&mut bare_state, 0.5, y, H);
        assert_eq!(pid.forward(&mut state, y.into(), 0.5.into(), 0.0.into(), H).value, expected, "sample {k}");
    }
}

#[test]
fn single_precision_follows() {
    let wide = PidAdvanced::new(PidAdvancedSettings::new(settings())).unwrap();
    let narrow = PidSettings { low: 0.0, high: 100.0, ..PidSettings::<f32>::ideal(2.0, 5.0, 0.5) };
    let narrow = PidAdvanced::new(PidAdvancedSettings::new(narrow)).unwrap();
    let (mut a, mut b) = (PidAdvancedState::<f64>::at(40.0), PidAdvancedState::<f32>::at(40.0));
    (a.pid.mode, b.pid.mode) = (Mode::External, Mode::External);
    for i in 0_u8..200 {
        let y = f32::from(i % 7) * 0.125 + 50.0; // exact in both
        let u = wide.forward(&mut a, f64::from(y).into(), 50.5.into(), 0.0.into(), 0.0.into(), 0.25).value;
        let v = narrow.forward(&mut b, y.into(), 50.5.into(), 0.0.into(), 0.0.into(), 0.25).value;
        wide.backward(&mut a, Backward::default());
        narrow.backward(&mut b, Backward::default());
        assert!((u - f64::from(v)).abs() < 2e-3, "{u} and {v}");
    }
}

#[test]
fn what_is_told_backward_stops_the_output_that_way_only() {
    for (flag, sign) in [(AT_HIGH, 1.0), (AT_LOW, -1.0)] {
        let mut rig = Rig::new(settings());
        rig.state.mode = Mode::External;
        rig.sp = (50.0 + 5.0 * sign).into();
        rig.scan();
        rig.back.flags = flag;
        let held = rig.scan();
        for _ in 0..1000 {
            assert_eq!(rig.scan(), held, "no further");
            assert_ne!(rig.state.flags & flag, 0, "and it passes on");
        }
        // Off the limit's side at once when the error turns: nothing was wound up.
        rig.sp = (50.0 - 5.0 * sign).into();
        assert!((rig.scan() - held) * sign < -10.0);
    }
}

#[test]
fn a_direct_acting_slave_tells_its_master_the_other_limit() {
    let mut rig = Rig::new(PidSettings { k: -2.0, ..settings() });
    rig.state.mode = Mode::External;
    rig.scan();
    let at_high = Backward { flags: AT_HIGH, ..Backward::default() };
    let (sp, ff) = rig.pid.backward(&mut rig.state, at_high);
    assert_eq!((sp.flags, ff.flags), (AT_LOW, AT_HIGH));
}

#[test]
fn a_master_of_a_slave_in_manual_tracks_and_takes_over_without_a_bump() {
    let of = |low, high| PidSettings { low, high, ..PidSettings::ideal(1.0, 5.0, 0.0) };
    let (master, slave) = (Rig::new(of(0.0, 100.0)), Rig::new(of(0.0, 100.0)));
    let (mut master, mut slave) = (master, slave);
    master.state.mode = Mode::External;
    slave.state.mode = Mode::Manual;
    slave.state.manual = 70.0;
    let mut before = 0.0;
    for k in 0..40 {
        master.pv = (30.0 + f64::from(k)).into();
        slave.pv = (60.0 + 0.1 * f64::from(k)).into();
        slave.sp = master.pid.forward(&mut master.state, master.pv, master.sp, 0.0.into(), H);
        let u = slave.pid.forward(&mut slave.state, slave.pv, slave.sp, 0.0.into(), H).value;
        let (back, _) = slave.pid.backward(&mut slave.state, Backward::default());
        master.pid.backward(&mut master.state, back);
        if k > 2 && k < 20 {
            assert!((slave.sp.value - slave.state.yf).abs() < 0.11, "the master follows the slave's PV");
            assert_eq!(u, 70.0);
        } else if k == 20 || k == 21 {
            assert!((u - before).abs() < 0.3, "{before} to {u}");
        }
        before = u;
        slave.state.mode = if k >= 19 { Mode::External } else { Mode::Manual };
    }
}

#[test]
fn the_rate_holds_in_auto_and_manual() {
    let mut rig = Rig::new(PidSettings { rate: 3.0, ..settings() });
    rig.state.mode = Mode::External;
    let mut last = rig.scan();
    for k in 0..200 {
        rig.sp = if k % 50 < 25 { 90.0 } else { 10.0 }.into();
        if k == 120 {
            (rig.state.mode, rig.state.manual) = (Mode::Manual, 99.0);
        }
        let u = rig.scan();
        assert!((u - last).abs() <= 3.0 * H + 1e-12);
        last = u;
    }
}

#[test]
fn a_rate_that_holds_back_is_told_like_a_limit_until_the_output_has_caught_up() {
    for sign in [1.0, -1.0] {
        let (up, down) = if sign > 0.0 { (AT_HIGH, AT_LOW) } else { (AT_LOW, AT_HIGH) };
        let mut rig = Rig::new(PidSettings { rate: 3.0, ..PidSettings::ideal(2.0 * sign, 5.0, 0.0) });
        rig.state.mode = Mode::External;
        rig.scan();
        rig.sp = 51.0.into();
        let (mut last, mut scans) = (rig.state.output, 0);
        loop {
            let u = rig.pid.forward(&mut rig.state, rig.pv, rig.sp, rig.ff, rig.h).value;
            let (sp, ff) = rig.pid.backward(&mut rig.state, rig.back);
            if ff.flags == 0 {
                assert!((u - last).abs() < 3.0 * H);
                break;
            }
            // Told forward to whoever stands before, and seen from the setpoint in its own direction.
            assert_eq!((rig.state.flags, ff.flags, sp.flags), (up, up, AT_HIGH));
            assert!((u - last - 3.0 * H * sign).abs() < 1e-12);
            (last, scans) = (u, scans + 1);
        }
        // 2·(1 + t/5) of 3t: 0.77 s.
        assert_eq!(scans, 7);
        rig.sp = 49.0.into();
        rig.scan();
        assert_eq!(rig.state.flags, down);
        (rig.state.mode, rig.state.manual) = (Mode::Manual, 90.0);
        rig.scan();
        assert_eq!(rig.state.flags, NOT_AUTO, "in manual nobody before can do anything about it");
    }
}

#[test]
fn a_half_period_in_which_the_rate_limits_is_none() {
    let found = |rate: f64| {
        let pid = PidAdvanced::new(PidAdvancedSettings::new(PidSettings { rate, ..PidSettings::ideal(2.0, 1.0, 0.0) }));
        let (pid, mut state) = (pid.unwrap(), PidAdvancedState::at(40.0));
        state.pid.mode = Mode::External;
        for k in 0..1500 {
            pid.forward(&mut state, cycle(k).into(), 50.0.into(), 0.0.into(), 0.0.into(), H);
            pid.backward(&mut state, Backward::default());
        }
        (state.detection.detector.accepted(), state.detection.last.unwrap().reason())
    };
    let free = found(1e6);
    assert!(free.0 > 10 && free.1 == Reason::Accepted, "{free:?}");
    assert_eq!(found(1.5), (0, Reason::Saturated));
}

#[test]
fn a_ramp_of_the_setpoint_is_told_to_whoever_gives_it_and_not_to_the_detector() {
    let advanced = PidAdvancedSettings { sp_rate: 2.0, ..PidAdvancedSettings::new(settings()) };
    let advanced = PidAdvanced::new(advanced).unwrap();
    let mut state = PidAdvancedState::at(50.0);
    state.pid.mode = Mode::External;
    let mut back = |sp: f64| {
        advanced.forward(&mut state, 50.0.into(), sp.into(), 0.0.into(), 0.0.into(), H);
        let (sp, ff) = advanced.backward(&mut state, Backward::default());
        (sp.flags, ff.flags)
    };
    assert_eq!([50.0, 50.3, 50.3, 49.9, 49.9].map(&mut back), [(0, 0), (AT_HIGH, 0), (0, 0), (AT_LOW, 0), (0, 0)]);
}

#[test]
fn compensation_leaves_half_of_the_rate_to_the_controller() {
    let of = |rate: f64| {
        let compensation = compensating().settings().compensation;
        let pid = PidSettings { rate, ..settings() };
        PidAdvanced::new(PidAdvancedSettings { compensation, ..PidAdvancedSettings::new(pid) }).unwrap()
    };
    for (rate, most) in [(1e6, 2.0), (3.0, 1.5)] {
        let (pid, mut s) = (of(rate), PidAdvancedState::at(40.0));
        (s.pid.mode, s.detection.compensate) = (Mode::External, true);
        let (mut last, mut fastest, mut saw) = (0.0, 0.0_f64, 0.0_f64);
        for k in 0..400 {
            let pv = 50.0 + 0.15 * (f64::from(k) / 20.0).sin();
            pid.forward(&mut s, pv.into(), 50.0.into(), 0.0.into(), 0.0.into(), H);
            pid.backward(&mut s, Backward::default());
            let u_ff = s.detection.compensation.u_ff;
            fastest = fastest.max((u_ff - last).abs() / H);
            saw = saw.max(u_ff);
            last = u_ff;
        }
        assert!((fastest - most).abs() < 1e-9, "{fastest} for a rate of {rate}");
        assert!(saw > 0.69, "all of (1.5 − 0.1)/2 in spite of the rate: {saw}");
    }
}

/// Without a rate the output moves freely, however short a scan is; in `f32` the largest number times 1e-30 s is not large.
#[test]
fn no_rate_limits_no_scan() {
    let pid = Pid::<f32>::new(PidSettings { td: 1.0, ..PidSettings::ideal(1.0, 10.0, 1.0) }).unwrap();
    let mut s = PidState::default();
    let mut u = 0.0;
    for (pv, h) in [(0.0, 0.1), (0.0, 0.1), (-1.0, 1e-30)] {
        u = pid.forward(&mut s, pv.into(), 0.0.into(), 0.0.into(), h).value;
    }
    assert!(u > 1e29, "{u}");
}

/// A derivative of the setpoint beyond the numbers does not take the output with it.
#[test]
fn a_step_of_the_setpoint_beyond_the_numbers_is_no_kick() {
    let pid = Pid::<f64>::new(PidSettings { c: 1.0, k: 1e200, ..PidSettings::ideal(1e200, 10.0, 1.0) }).unwrap();
    let mut s = PidState::default();
    for sp in [0.0, 0.0, 1e150, 0.0] {
        s.sp = sp;
        assert!(pid.forward(&mut s, 0.0.into(), 0.0.into(), 0.0.into(), 0.1).value.is_finite());
    }
}

#[test]
fn where_scans_were_missed_the_filter_begins_anew() {
    let pid = Pid::new(PidSettings { tf: 5.0, ..PidSettings::ideal(1.0, 10.0, 0.0) }).unwrap();
    let mut s = PidState::default();
    let scan = |s: &mut PidState<f64>, pv: f64, h: f64| {
        pid.forward(s, pv.into(), 0.0.into(), 0.0.into(), h);
        (s.yf, s.error)
    };
    scan(&mut s, 20.0, 0.1);
    s.missed();
    assert_eq!(scan(&mut s, 80.0, -1.0), (80.0, DATA_GAP));
}

#[test]
fn feed_forward_goes_through_and_within_the_limits() {
    let mut rig = Rig::new(settings());
    rig.state.mode = Mode::External;
    let before = rig.scan();
    rig.ff = 7.0.into();
    assert!((rig.scan() - before - 7.0).abs() < 1e-12);
    rig.ff = 900.0.into();
    assert_eq!(rig.scan(), 100.0);
    // The integral is not wound up against it: the feedback is where it was.
    rig.ff = 7.0.into();
    for _ in 0..200 {
        rig.scan();
    }
    assert!((rig.state.feedback() + 7.0 - rig.state.output).abs() < 1e-12);
    assert!(rig.state.output < 100.0);
}

#[test]
fn gains_change_without_a_bump() {
    let mut rig = Rig::new(settings());
    rig.state.mode = Mode::External;
    rig.pv = 47.0.into();
    let before = rig.scan();
    for changed in [
        PidSettings { k: 6.0, ..settings() },
        PidSettings { ti: 1.0, ..settings() },
        PidSettings { td: 4.0, ..settings() },
        PidSettings { b: 0.2, ..settings() },
    ] {
        rig.pid = Pid::new(changed).unwrap();
        let u = rig.scan();
        assert!((u - before).abs() < 12.0 * rig.integration(), "{before} to {u}");
    }
}

#[test]
fn a_schedule_is_linear_between_its_rows() {
    let mut schedule = [Gains::default(); SCHEDULE_ROWS];
    schedule[0] = Gains { at: 20.0, k: 1.0, ti: 10.0, td: 0.0 };
    schedule[1] = Gains { at: 60.0, k: 3.0, ti: 30.0, td: 0.0 };
    let advanced = PidAdvancedSettings { schedule, rows: 2, ..PidAdvancedSettings::new(settings()) };
    let advanced = PidAdvanced::new(advanced).unwrap();
    for (by, k) in [(0.0, 1.0), (20.0, 1.0), (30.0, 1.5), (60.0, 3.0), (90.0, 3.0)] {
        let mut state = PidAdvancedState::at(50.0);
        state.pid.mode = Mode::External;
        let mut scan = |pv: f64| advanced.forward(&mut state, pv.into(), 50.0.into(), 0.0.into(), by.into(), H).value;
        scan(50.0);
        let step = scan(50.0) - scan(49.0);
        assert!((step + k * (1.0 + H / (10.0 * k))).abs() < 1e-9, "by = {by}: {step}");
    }
}

/// Just below the upper row the share is 1, and 1e9 + (1e-3 − 1e9) is 0 in 32 bits.
#[test]
fn rows_far_apart_have_an_integral_time_between_them() {
    let mut schedule = [Gains::default(); SCHEDULE_ROWS];
    schedule[0] = Gains { at: -1000.0, k: 1.0_f32, ti: 1e9, td: 0.0 };
    schedule[1] = Gains { at: 0.0, k: 1.0, ti: 1e-3, td: 0.0 };
    let pid = PidSettings::ideal(1.0, 5.0, 0.0);
    let advanced =
        PidAdvanced::new(PidAdvancedSettings { schedule, rows: 2, ..PidAdvancedSettings::new(pid) }).unwrap();
    let mut s = PidAdvancedState::at(50.0);
    s.pid.sp = 1.0;
    let mut u = 0.0;
    for _ in 0..9 {
        u = advanced.forward(&mut s, 0.0.into(), 0.0.into(), 0.0.into(), (-1e-20).into(), 0.1).value;
    }
    // K·h/Ti·1 = 100 in every scan.
    assert!((u - 950.0).abs() < 1.0, "{u}");
}

#[test]
fn a_schedule_crossed_all_the_time_makes_no_bump() {
    let mut schedule = [Gains::default(); SCHEDULE_ROWS];
    schedule[0] = Gains { at: 20.0, k: 0.5, ti: 10.0, td: 1.0 };
    schedule[1] = Gains { at: 60.0, k: 3.0, ti: 4.0, td: 0.2 };
    let advanced = PidAdvancedSettings { schedule, rows: 2, ..PidAdvancedSettings::new(settings()) };
    let advanced = PidAdvanced::new(advanced).unwrap();
    let mut state = PidAdvancedState::at(50.0);
    state.pid.mode = Mode::External;
    let mut last = 50.0;
    for k in 0..200 {
        // PV rests; the scheduling variable runs from end to end, and is bad now and then.
        let by = if k % 17 == 3 { f64::NAN } else { 40.0 + 25.0 * f64::from(k).sin() };
        let u = advanced.forward(&mut state, 49.0.into(), 50.0.into(), 0.0.into(), by.into(), H).value;
        assert!((u - last).abs() <= 3.0 * H / 4.0 + 1e-9, "scan {k}: {last} to {u}");
        last = u;
    }
}

#[test]
fn the_setpoint_ramp_begins_where_the_process_is() {
    let advanced = PidAdvancedSettings { sp_rate: 2.0, ..PidAdvancedSettings::new(settings()) };
    let advanced = PidAdvanced::new(advanced).unwrap();
    let mut state = PidAdvancedState::at(50.0);
    state.pid.mode = Mode::Manual;
    let scan = |state: &mut PidAdvancedState<f64>| {
        advanced.forward(state, 40.0.into(), 60.0.into(), 0.0.into(), 0.0.into(), H).value
    };
    scan(&mut state);
    state.pid.mode = Mode::External;
    for k in 1..=120 {
        scan(&mut state);
        let expected = (40.0 + 0.2 * f64::from(k)).min(60.0);
        assert!((state.pid.ysp - expected).abs() < 1e-9, "scan {k}: {}", state.pid.ysp);
    }
}

/// A limit cycle as a gap makes it, in a loop with K = 2 and Ti = 1: half-periods of 10 s.
fn cycle(k: usize) -> f64 {
    if (k / 100).is_multiple_of(2) { 49.0 } else { 51.0 }
}

#[test]
fn a_flag_rejects_the_half_period_that_it_was_raised_in() {
    let detector = DetectorSettings { tf: 0.0, ..DetectorSettings::new(2.0, 1.0, 0.0, H) };
    let settings = BacklashDetectionSettings { detector, compensation: None };
    let detection = BacklashDetection::new(settings).unwrap();
    for (flag, reason) in [(AT_HIGH, Reason::Saturated), (AT_LOW, Reason::Saturated), (NOT_AUTO, Reason::NotAuto)] {
        // Any scan of the half-period from 500 to 599, its first and its last among them.
        for at in [500, 533, 599] {
            let mut state = BacklashDetectionState::default();
            let mut reasons = std::vec::Vec::new();
            for k in 0..1000 {
                detection.forward(&mut state, 50.0.into(), cycle(k).into(), H);
                let flags = if k == at { flag } else { 0 };
                detection.backward(&mut state, Some(Backward { flags, tracking: 30.0, ..Backward::default() }));
                if k % 100 == 0 && k > 200 {
                    reasons.push((k, state.last.unwrap().reason()));
                }
            }
            let rejected: std::vec::Vec<_> = reasons.iter().filter(|r| r.1 != Reason::Accepted).collect();
            let first = *rejected[0];
            assert_eq!(first, (600, reason), "flag {flag} at {at}");
            assert!(rejected.len() <= 2, "after a break the next has none to compare with: {rejected:?}");
        }
    }
}

#[test]
fn a_slave_at_its_limit_rejects_the_masters_half_periods() {
    // No graph allows a detector here (8.3); the flags must reach it all the same, as from a positioner in the field.
    let found = |slave_high: f64| {
        let master = PidAdvanced::new(PidAdvancedSettings::new(PidSettings::ideal(2.0, 1.0, 0.0))).unwrap();
        let slave = Pid::new(PidSettings { low: 0.0, high: slave_high, ..PidSettings::ideal(0.3, 0.5, 0.0) }).unwrap();
        let (mut m, mut s) = (PidAdvancedState::at(40.0), PidState::at(40.0));
        (m.pid.mode, s.mode) = (Mode::External, Mode::External);
        let (mut ended, mut touched, mut found) = (None, false, std::vec::Vec::new());
        for k in 0..1500 {
            let asked = master.forward(&mut m, cycle(k).into(), 50.0.into(), 0.0.into(), 0.0.into(), H);
            // The slave's own process follows its output at once.
            let measured = s.output;
            slave.forward(&mut s, measured.into(), asked, 0.0.into(), H);
            let (back, _) = slave.backward(&mut s, Backward::default());
            master.backward(&mut m, back);
            if m.detection.last != ended {
                ended = m.detection.last;
                found.push((touched, ended.unwrap().reason()));
                touched = false;
            }
            touched |= s.flags & (AT_LOW | AT_HIGH) != 0;
        }
        found
    };
    // The first begins with a gap, the second has none to compare with.
    let free = found(1000.0);
    assert!(free[2..].iter().all(|half| *half == (false, Reason::Accepted)), "{free:?}");
    let limited = found(5.0);
    assert!(limited.iter().filter(|half| half.0).count() > 10, "{limited:?}");
    assert!(limited[1..].iter().all(|(touched, reason)| *touched == (*reason == Reason::Saturated)), "{limited:?}");
}

#[test]
fn the_detector_inside_has_the_controllers_settings() {
    let settings = PidSettings { ti: 1.0, ..PidSettings::ideal(2.0, 1.0, 0.0) };
    let inside = PidAdvancedSettings { kp: Some(4.0), ..PidAdvancedSettings::new(settings) };
    let inside = PidAdvanced::new(inside).unwrap();
    let detector = DetectorSettings { kp: Some(4.0), ..DetectorSettings::new(2.0, 1.0, 0.0, H) };
    let beside = BacklashDetectionSettings { detector, compensation: None };
    let beside = BacklashDetection::new(beside).unwrap();
    let (mut a, mut b) = (PidAdvancedState::at(0.0), BacklashDetectionState::default());
    a.pid.mode = Mode::External;
    for k in 0..1500 {
        inside.forward(&mut a, cycle(k).into(), 50.0.into(), 0.0.into(), 0.0.into(), H);
        inside.backward(&mut a, Backward::default());
        beside.forward(&mut b, 50.0.into(), cycle(k).into(), H);
        let seen = Backward { tracking: a.pid.feedback(), ..Backward::default() };
        beside.backward(&mut b, Some(seen));
    }
    let (a, b) = (a.detection.detector.estimate().unwrap(), b.detector.estimate().unwrap());
    assert_eq!(a, b);
    // K/Ti·Δy·Δt − Δy/Kp, a little less for the filter.
    assert!((a.value - (2.0 * 10.0 - 0.25)).abs() < 1.0, "{}", a.value);
}

#[test]
fn a_process_of_the_wrong_sign_ends_at_the_limit_and_comes_back() {
    let mut rig = Rig::new(settings());
    rig.state = PidState::at(60.0);
    rig.state.mode = Mode::External;
    let mut y = 45.0;
    for _ in 0..2000 {
        rig.pv = y.into();
        let u = rig.scan();
        y += (90.0 - u - y) * 0.02; // the more it opens, the lower PV
    }
    assert_eq!((rig.state.output, rig.state.flags & AT_HIGH), (100.0, AT_HIGH));
    assert!(y.abs() < 11.0);
    rig.pid = Pid::new(PidSettings { k: -2.0, ..settings() }).unwrap();
    let before = rig.state.output;
    let u = rig.scan();
    assert!((u - before).abs() <= rig.integration());
    for _ in 0..3000 {
        rig.pv = y.into();
        let u = rig.scan();
        y += (90.0 - u - y) * 0.02;
    }
    assert!((y - 50.0).abs() < 0.1, "{y}");
}

proptest! {
    #[test]
    fn whatever_comes_the_output_is_a_number_within_the_limits(
        samples in prop::collection::vec(
            (any::<f64>(), any::<f64>(), any::<f64>(), any::<f64>(), 0..3_u8, 0..16_u16, any::<f64>(), any::<f64>()), 1..80
        ),
    ) {
        let advanced = PidAdvanced::new(PidAdvancedSettings::new(settings())).unwrap();
        let mut state = PidAdvancedState::at(40.0);
        for (pv, sp, ff, h, mode, flags, low, tracking) in samples {
            state.pid.mode = [Mode::Manual, Mode::Auto, Mode::External][usize::from(mode)];
            state.pid.manual = ff;
            let u = advanced.forward(&mut state, pv.into(), sp.into(), ff.into(), sp.into(), h);
            let back = Backward { low, high: ff, flags: flags & !NOT_AUTO, tracking };
            advanced.backward(&mut state, back);
            prop_assert!(u.is_good() && (0.0..=100.0).contains(&u.value), "{u:?}");
        }
        // The loop goes on.
        for _ in 0..3 {
            state.pid.mode = Mode::External;
            advanced.forward(&mut state, 50.0.into(), 60.0.into(), 0.0.into(), 0.0.into(), H);
            advanced.backward(&mut state, Backward::default());
        }
        prop_assert_eq!(state.pid.error, 0);
    }

    #[test]
    fn sign_symmetric(
        samples in prop::collection::vec((-50.0..50.0_f64, -50.0..50.0_f64, -5.0..5.0_f64, 0.01..1.0_f64), 1..60),
    ) {
        let settings = PidSettings {
            low: -20.0, high: 20.0, rate: 30.0, c: 0.5, tf: 0.3, ..PidSettings::ideal(0.8, 5.0, 1.0)
        };
        let pid = Pid::new(settings).unwrap();
        let (mut a, mut b) = (PidState::default(), PidState::default());
        (a.mode, b.mode) = (Mode::External, Mode::External);
        for (pv, sp, ff, h) in samples {
            let u = pid.forward(&mut a, pv.into(), sp.into(), ff.into(), h).value;
            prop_assert_eq!(u, -pid.forward(&mut b, (-pv).into(), (-sp).into(), (-ff).into(), h).value);
        }
    }
}

/// Scans in which nothing is read: the output holds, u_FF goes to 0, and it goes on without a bump, with a filter that begins anew.
#[test]
fn a_pause_is_a_gap() {
    let pid = PidSettings::ideal(1.0, 2.0, 0.0);
    let given = CompensationSettings { release: 1.0, ..CompensationSettings::new(Way::Error, 1.0, 2.0, 4.0, 1.0) };
    let usual = PidAdvancedSettings { compensation: Some(given), ..PidAdvancedSettings::new(pid) };
    for settings in [usual, PidAdvancedSettings { detector_tf: Some(0.5), ..usual }] {
        let advanced = PidAdvanced::new(settings).unwrap();
        let mut s = PidAdvancedState::at(50.0);
        (s.pid.sp, s.detection.compensate) = (50.0, true);
        let scan = |s: &mut PidAdvancedState<f64>, pv: f64, h| {
            let u = advanced.forward(s, pv.into(), 0.0.into(), 0.0.into(), 0.0.into(), h).value;
            advanced.backward(s, Backward::default());
            u
        };
        let mut last = 0.0;
        for i in 0..60 {
            last = scan(&mut s, if i < 40 { 49.0 } else { 51.0 }, H);
        }
        assert!(s.detection.compensation.u_ff.abs() > 1.0);
        for _ in 0..20 {
            advanced.pause(&mut s, H);
        }
        assert_eq!((s.detection.compensation.u_ff, s.pid.output), (0.0, last));
        assert_eq!((scan(&mut s, 60.0, -1.0), s.pid.yf), (last, 60.0));
        scan(&mut s, 60.0, H);
        assert_eq!(s.detection.compensation.direction, -1, "PV as it is now");
        scan(&mut s, 40.0, H);
        assert_eq!(s.detection.last.map(|last| last.reason()), Some(Reason::Gap));
    }
}
