//! What C may hand over by mistake: it is refused or ignored, and never becomes a number at the valve.
#![allow(unsafe_code)]

use glapp_embedded::double::{
    CompensationGiven, DetectorGiven, PidGiven, glapp_compensation_begin_f64, glapp_compensation_defaults_f64,
    glapp_compensation_update_f64, glapp_detector_begin_f64, glapp_detector_defaults_f64, glapp_detector_estimate_f64,
    glapp_detector_update_f64, glapp_pid_begin_f64, glapp_pid_defaults_f64, glapp_pid_update_f64,
};
use glapp_embedded::{BAD_POINTER, COMPENSATION, DETECTOR, NOT_BEGUN, OK, PID};
use std::ptr::null_mut;

const NAN: f64 = f64::NAN;

fn detector() -> DetectorGiven {
    let mut given = DetectorGiven::default();
    // SAFETY: it is settings.
    assert_eq!(unsafe { glapp_detector_defaults_f64(0.5, 10.0, 0.0, 1.0, &mut given) }, OK);
    given
}

#[test]
fn pointers_and_memory_that_hold_nothing_are_refused() {
    let mut memory = [0_u64; DETECTOR.1 / 8];
    let at = memory.as_mut_ptr();
    // SAFETY: pointers are null, or lead to the memory.
    unsafe {
        assert_eq!(glapp_detector_defaults_f64(0.5, 10.0, 0.0, 1.0, null_mut()), BAD_POINTER);
        assert_eq!(glapp_detector_begin_f64(at, null_mut()), BAD_POINTER);
        assert_eq!(glapp_detector_begin_f64(null_mut(), &mut detector()), BAD_POINTER);
        assert_eq!(glapp_detector_update_f64(at, 1.0, 0.0, 0.0, NAN, 0), NOT_BEGUN);
        assert_eq!(glapp_detector_estimate_f64(at, null_mut()), NOT_BEGUN);
        assert_eq!(glapp_detector_begin_f64(at, &mut detector()), OK);
        assert_eq!(glapp_detector_estimate_f64(at, null_mut()), BAD_POINTER);
    }
}

#[test]
fn a_setting_out_of_bounds_is_named_by_its_number() {
    type Change = fn(&mut DetectorGiven);
    let wrong: [(Change, i32); 7] = [
        (|g| g.k = 0.0, 1),
        (|g| g.k = NAN, 1),
        (|g| g.ti = 0.0, 2),
        (|g| g.n = 4, 7),
        (|g| g.max_h = f64::INFINITY, 8),
        // One limit alone was dropped, and half-periods at it counted.
        (|g| g.op_high = 100.0, 9),
        (|g| g.op_low = 0.0, 10),
    ];
    let mut memory = [0_u64; DETECTOR.1 / 8];
    for (change, number) in wrong {
        let mut given = detector();
        change(&mut given);
        // SAFETY: memory and settings are those of a detector.
        assert_eq!(unsafe { glapp_detector_begin_f64(memory.as_mut_ptr(), &mut given) }, number);
    }
    let (mut given, mut memory) = (CompensationGiven::default(), [0_u64; COMPENSATION.1 / 8]);
    // SAFETY: memory and settings are those of a compensation.
    unsafe {
        assert_eq!(glapp_compensation_defaults_f64(1.0, 10.0, 2.0, &mut given), OK);
        given.op_high = 100.0;
        assert_eq!(glapp_compensation_begin_f64(memory.as_mut_ptr(), &mut given), 24);
    }
}

#[test]
fn no_wrong_sample_becomes_a_number_at_the_valve() {
    let (mut given, mut memory) = (PidGiven::default(), [0_u64; PID.1 / 8]);
    let mut output = NAN;
    // SAFETY: memory, settings and output are those of a PID, here and below.
    assert_eq!(unsafe { glapp_pid_defaults_f64(1.0, 10.0, 0.0, &mut given) }, OK);
    (given.low, given.high) = (0.0, 100.0);
    // SAFETY: as above.
    assert_eq!(unsafe { glapp_pid_begin_f64(memory.as_mut_ptr(), &mut given, 40.0) }, OK);
    for (h, sp, pv, ff, manual, mode) in [
        (1.0, 50.0, 50.0, 0.0, NAN, 1),
        (1.0, 50.0, NAN, 0.0, NAN, 1),
        (NAN, 50.0, 50.0, 0.0, NAN, 1),
        (-1.0, 50.0, 50.0, 0.0, NAN, 1),
        (1e9, 50.0, 50.0, 0.0, NAN, 1),
        (1.0, NAN, 50.0, 0.0, NAN, 1),
        (1.0, 50.0, 50.0, NAN, NAN, 99),
    ] {
        // SAFETY: as above.
        let code = unsafe { glapp_pid_update_f64(memory.as_mut_ptr(), h, sp, pv, ff, manual, mode, &mut output) };
        assert_eq!((code, output), (OK, 40.0), "{h} {sp} {pv} {ff} {mode}");
    }
}

#[test]
fn compensation_that_is_on_from_the_start_waits_until_it_was_off() {
    let (mut given, mut memory) = (CompensationGiven::default(), [0_u64; COMPENSATION.1 / 8]);
    // SAFETY: memory and settings are those of a compensation.
    unsafe {
        assert_eq!(glapp_compensation_defaults_f64(1.0, 10.0, 2.0, &mut given), OK);
        given.way = 1;
        assert_eq!(glapp_compensation_begin_f64(memory.as_mut_ptr(), &mut given), OK);
    }
    let mut u_ff = NAN;
    let mut swing = |enable| {
        let mut greatest = 0.0_f64;
        for scan in 0..40 {
            let e = if scan / 10 % 2 == 0 { 1.0 } else { -1.0 };
            let at = memory.as_mut_ptr();
            // SAFETY: memory and number are those of a compensation.
            let code = unsafe { glapp_compensation_update_f64(at, 1.0, e, 50.0, NAN, enable, 0, &mut u_ff) };
            assert!(code >= 0);
            greatest = greatest.max(u_ff.abs());
        }
        greatest
    };
    assert_eq!([swing(1), swing(0), swing(1)], [0.0, 0.0, 1.0]);
}
