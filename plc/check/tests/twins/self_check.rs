//! `GlappSelfCheck` beside the same in Rust, on numbers that are right, a little off, far off and none.

use crate::common::{Block, Draw, Number};

fn checks<R: Number>() {
    let mut failed = [0, 0];
    for seed in 0..40 {
        let mut draw = Draw::new(seed);
        let block = Block::new::<R>("GlappSelfCheck");
        let (mut inexact, mut first, mut off) = (false, 0, R::ZERO);
        let bad = draw.of(&[0.0, 0.02, 0.1]);
        for i in 0..60 {
            let number = 1 + i / 12;
            let expected = draw.between(-4.0, 4.0);
            let tolerance = draw.of(&[0.125, 0.25]);
            // At the tolerance itself, where the eighths are; and to both sides of it.
            let share = draw.of(&[0.0, 0.0, 0.5, 1.0, -1.0]);
            let mut value = expected + share * tolerance * (1.0 + f64::abs(expected));
            if draw.chance(bad) {
                value = draw.of(&[f64::NAN, f64::INFINITY, 1e37, -1e37, 1.1e37, expected + 1.0, expected + 9.0]);
            }
            let [a, b, most] = [value, expected, tolerance].map(R::of);
            if a != b {
                inexact = true;
                let far = if a.magnitude() <= R::of(1e37) {
                    (a - b).magnitude() / (R::ONE + b.magnitude())
                } else {
                    R::of(1e37)
                };
                let good = a.magnitude() <= R::of(1e37) && far <= most;
                if !good && first == 0 {
                    (first, off) = (number, far);
                } else if (first == 0 || first == number) && far > off {
                    off = far;
                }
            }
            block.set_all(&[("Number", number.into()), ("Value", value), ("Expected", expected)]);
            block.set("Tolerance", tolerance);
            block.call();
            let shown = block.all(&["Inexact", "Failed", "Off"]);
            assert_eq!(shown, [f64::from(u8::from(inexact)), first.into(), off.as_f64()], "{seed}, {i}: {value}");
        }
        failed[usize::from(first > 0)] += 1;
    }
    assert!(failed.iter().all(|count| *count > 3), "{failed:?}");
}

in_both!(lreal, real: checks);
