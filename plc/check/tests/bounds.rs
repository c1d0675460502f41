//! What sequences do not get to: the functions that tell what may be computed, at their bounds and to both sides; and pins left open.

mod common;

use common::blocks::pascal;
use common::folder;
use glapp_core::Conditions;
use glapp_plc_check::{Build, Instance, Library, sources};

const TRY: &str = "FUNCTION_BLOCK GlappTry
VAR_INPUT
    A : LREAL;
    B : LREAL;
END_VAR
VAR_OUTPUT
    Number : BOOL;
    Small : BOOL;
    Product : BOOL;
    Quotient : BOOL;
END_VAR
    Number := GlappIsNumber(A);
    Small := GlappMeasurable(A);
    Product := GlappProductFits(A, B);
    Quotient := GlappQuotientFits(A, B);
END_FUNCTION_BLOCK
";

#[test]
fn at_the_bounds() {
    for build in [Build::Lreal, Build::Real] {
        let mut files = sources(&folder(), build).unwrap();
        files.push(("Try.st".into(), TRY.into()));
        let files = files.iter().map(|(name, text)| (&**name, &**text));
        let library = Library::of_unruled(files, build).unwrap();
        let mut one = Instance::new(&library, "GlappTry").unwrap();
        let mut of = |a: f64, b: f64, pin: &str| {
            one.set("A", a).unwrap();
            one.set("B", b).unwrap();
            one.call().unwrap();
            one.get(pin).unwrap() == 1.0
        };
        let most = if build == Build::Real { 1e12 } else { 1e30 };
        for sign in [1.0, -1.0] {
            for (pin, most) in [("Number", 1e37), ("Small", most)] {
                assert!(of(sign * most, 1.0, pin), "{build:?} {pin}");
                assert!(!of(sign * 1.000_001 * most, 1.0, pin), "{build:?} {pin}");
            }
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
            assert_eq!(of(a, b, "Product"), fits, "{build:?} {a} * {b}");
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
            assert_eq!(of(a, b, "Quotient"), fits, "{build:?} {a} / {b}");
        }
    }
}

/// A pin that is left open means the core's default.
#[test]
fn open_pins() {
    for build in [Build::Lreal, Build::Real] {
        let files = sources(&folder(), build).unwrap();
        let library = Library::of_unruled(files.iter().map(|(name, text)| (&**name, &**text)), build).unwrap();
        let of = |block: &str, pin: &str| Instance::new(&library, block).unwrap().get(pin).unwrap();
        let mut conditions = Conditions::default();
        for block in ["GlappDetector", "GlappDetectorSettings", "GlappSafetyNet"] {
            for name in Conditions::NAMES {
                let default = *conditions.switch(name).unwrap();
                assert_eq!(of(block, &pascal(name)), f64::from(u8::from(default)), "{block} {name}");
            }
        }
        for block in ["GlappDetector", "GlappDetectorSettings", "GlappWidth"] {
            assert_eq!(of(block, "B"), 1.0, "{block}");
        }
        for block in ["GlappDetector", "GlappDetectorSettings", "GlappMedianMean"] {
            assert_eq!(of(block, "N"), 9.0, "{block}");
        }
        assert_eq!(of("GlappHalfPeriod", "SlopeFits"), 1.0);
    }
}
