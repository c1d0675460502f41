//! The detector disturbed once, or twice shortly after each other, in every phase of a half-period: the bits of the core before and after.

use crate::common::detector::{Pins, Reference, scan};
use crate::common::{Block, Draw, Number, same};
use glapp_core::status::{AT_HIGH, BAD, NOT_AUTO};

#[derive(Clone, Copy, Debug, PartialEq)]
enum What {
    Nothing,
    Reset,
    Restart,
    PowerCut,
    Disabled,
    Repeated,
    Late,
    BadPv,
    BadFlag,
    NoNumber,
    Manual,
    NoOp,
    Unset,
    Longer,
    DefaultKp,
}

const ALL: [What; 15] = [
    What::Nothing,
    What::Reset,
    What::Restart,
    What::PowerCut,
    What::Disabled,
    What::Repeated,
    What::Late,
    What::BadPv,
    What::BadFlag,
    What::NoNumber,
    What::Manual,
    What::NoOp,
    What::Unset,
    What::Longer,
    What::DefaultKp,
];

/// Samples of a half-period: longer than 5 Ti.
const LENGTH: usize = 7;

fn disturbed<R: Number>() {
    let mut accepted = 0.0;
    for (number, first) in ALL.into_iter().enumerate() {
        for phase in 0..2 * LENGTH {
            for (place, second) in
                [(0, What::Nothing), (1, first), (2, What::Repeated), (3, What::Reset), (5, What::BadPv)]
            {
                let mut draw = Draw::new((1 + number * 1000 + phase * 10 + place) as u64);
                let (block, mut reference) = (Block::new::<R>("GlappDetector"), Reference::<R>::default());
                let op = draw.chance(0.5).then_some(0.0);
                let td = draw.of(&[None, Some(0.0), Some(0.1)]);
                let usual = Pins { h: 0.25, ti: 0.3, kp: Some(2.0), tf: Some(0.1), n: 3, op, td, ..Pins::default() };
                let at = 8 * LENGTH + phase;
                for i in 0..at + 6 * LENGTH {
                    let side = if (i / LENGTH).is_multiple_of(2) { 1.0 } else { -1.0 };
                    let noise = draw.between(-0.1, 0.1);
                    // Smaller swings later: some of them (5.1) alone rejects.
                    let size = if i > at && phase % 2 == 0 { 0.3 } else { 1.0 };
                    let op = op.map(|_| 3.0 * side + noise);
                    let mut pins = Pins { pv: noise - side * size, op, ..usual.clone() };
                    let what = match i.checked_sub(at) {
                        Some(0) => first,
                        Some(after) if after == place => second,
                        _ => What::Nothing,
                    };
                    match what {
                        What::Nothing => {}
                        What::Reset => pins.reset = true,
                        What::Restart => pins.restart = true,
                        What::PowerCut => {
                            block.0.borrow_mut().power_cut();
                            reference.power_cut();
                        }
                        What::Disabled => pins.enable = false,
                        What::Repeated => (pins.h, pins.flags) = (0.0, NOT_AUTO | AT_HIGH),
                        What::Late => pins.h = 9.0,
                        What::BadPv => pins.pv = f64::NAN,
                        What::BadFlag => pins.flags = BAD,
                        What::NoNumber => pins.op = op.map(|_| f64::INFINITY),
                        What::Manual => pins.flags = NOT_AUTO,
                        What::NoOp => pins.op = if op.is_some() { None } else { Some(1.0) },
                        What::Unset => pins.ti = -1.0,
                        What::Longer => pins.n = 5,
                        What::DefaultKp => (pins.kp, pins.pv_span, pins.op_span) = (None, Some(10.0), Some(20.0)),
                    }
                    let (expected, got) = (reference.scan(&pins), scan(&block, &pins));
                    let agree = same(&expected.0, &got.0)
                        && match (&expected.1, &got.1) {
                            (Some(a), Some(b)) => same(a, b),
                            (a, b) => a.is_none() && b.is_none(),
                        };
                    assert!(
                        agree,
                        "{first:?}, {second:?} {place} later, phase {phase}, scan {i}: {got:?} instead of {expected:?}"
                    );
                }
                accepted += block.get("Accepted");
            }
        }
    }
    assert!(accepted > 5000.0, "{accepted}");
}

in_both!(lreal, real: disturbed);
