//! Functions at their bounds and to both sides, which random sequences do not reach.

use crate::common::{Block, Number};
use glapp_plc_check::Build;

fn at_the_bounds<R: Number>() {
    let one = Block::new::<R>("GlappTryFunctions");
    let given = |a: f64, b: f64, c: Option<f64>, pin: &str| {
        one.set_all(&[("A", a), ("B", b)]);
        one.option("C", c);
        one.call();
        one.get(pin)
    };
    let of = |a: f64, b: f64, pin: &str| given(a, b, None, pin) == 1.0;
    let real = R::BUILD == Build::Real;
    let most = if real { 1e12 } else { 1e30 };
    for sign in [1.0, -1.0] {
        for (pin, most) in [("Number", 1e37), ("Measured", most)] {
            assert!(of(sign * most, 1.0, pin), "{pin}");
            assert!(!of(sign * 1.000_001 * most, 1.0, pin), "{pin}");
        }
    }
    for (a, open) in [(1e38, true), (9.1e37, true), (9e37, false), (1.01e38, false), (-1e38, false)] {
        assert_eq!(of(a, 1.0, "Open"), open, "{a}");
    }
    for (a, b, fits) in [
        (1e37, 1.0, true),
        (1e37, 0.5, true),
        (1e37, 1.1, false),
        (5e36, 2.0, true),
        (5.001e36, 2.0, false),
        (2.0, 5e36, true),
        (2.0, 5.001e36, false),
        (0.0, 1e37, true),
    ] {
        assert_eq!(of(a, b, "Product"), fits, "{a} * {b}");
    }
    for (a, b, fits) in [
        (1e37, 1.0, true),
        (1e37, 2.0, true),
        (1e37, 0.999, false),
        (5e36, 0.5, true),
        (5.001e36, 0.5, false),
        (4.9e36, 0.5, true),
        (0.0, 1e-37, true),
    ] {
        assert_eq!(of(a, b, "Quotient"), fits, "{a} / {b}");
    }
    // The noise limit with a gain of nearly 0 is told as the largest number there is, without computing it.
    let without_end = if real { f64::from(1e37_f32) } else { 1e37 };
    for (sigma, k, kp, floor) in [
        (2.0, 1.0, Some(-4.0), 1.5),
        (2.0, 1.0, Some(0.5), 12.0),
        (2.0, -3.0, None, 36.0),
        (1.0, 1.5_f64 * 2.0_f64.powi(66), None, 9.0 * 2.0_f64.powi(66)),
        (1e10, 1.0, Some(1e-30), without_end),
        (1e10, 1e30, None, without_end),
    ] {
        assert_eq!(given(sigma, k, kp, "Feigned"), floor, "{sigma} {k} {kp:?}");
    }
    for (more, z, variance, beyond) in [
        (3.0, 1.0, 9.0, false),
        (3.25, 1.0, 9.0, true),
        (6.0, 2.0, 9.0, false),
        (6.25, 2.0, 9.0, true),
        (-3.25, 1.0, 9.0, false),
        (1.0, 0.5, 9.0, false),
        (2.0, 0.5, 9.0, true),
        (1e-200, 0.0, 9.0, false),
        (0.0, 1.0, 0.0, false),
        (0.5, 0.0, 9.0, true),
        (0.0, 0.0, 9.0, false),
        (-0.5, 0.0, 9.0, false),
        (-1.0, -1.0, 4.0, true),
        (-2.0, -1.0, 4.0, false),
        (-2.5, -1.0, 4.0, false),
        (0.0, -1.0, 4.0, true),
        (2.5, -1.0, 4.0, true),
        (0.0, -1.0, 0.0, false),
    ] {
        assert_eq!(given(more, z, Some(variance), "More") == 1.0, beyond, "{more} {z} {variance}");
    }
    for (cos, sin, duration, power) in [
        (3.0, 4.0, 5.0, 1.0),
        (-6.0, 8.0, 5.0, 4.0),
        (8.0, -6.0, 5.0, 4.0),
        (1.0, 1.0, 0.0, 0.0),
        (1.000_001e18, 0.0, 1e9, 0.0),
        (0.0, 1.000_001e18, 1e9, 0.0),
        (0.0, -1.000_001e18, 1e9, 0.0),
    ] {
        assert_eq!(given(cos, sin, Some(duration), "Power"), power, "{cos} {sin} {duration}");
    }
    // At the bound itself.
    for (cos, sin) in [(1e18, 0.0), (0.0, 1e18), (-1e18, 0.0)] {
        assert!(given(cos, sin, Some(1e9), "Power") > 0.99e18, "{cos} {sin}");
    }
    for (x, root) in [(-1.0, 0.0), (0.0, 0.0), (0.25, 0.5), (1.0, 1.0), (2.25, 1.5), (4.0, 2.0), (1e36, 1e18)] {
        let off = given(x, 0.0, None, "Root") - root;
        assert!(off.abs() <= 1e-6 * root, "{x}: {off}");
    }
    let mut x = 1e-30_f64;
    while x < 1e36 {
        let off = given(x, 0.0, None, "Root") / x.sqrt() - 1.0;
        assert!(off.abs() < if real { 1e-6 } else { 1e-15 }, "{x}: {off}");
        x *= 7.3;
    }
    assert_eq!(given(8.0, 0.0, None, "Sliver"), if real { f64::from(8.0 * 1e-5_f32) } else { 8.0 * 1e-9 });
}

in_both!(lreal, real: at_the_bounds);
