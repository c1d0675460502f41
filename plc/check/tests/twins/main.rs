//! The Structured Text of `plc/` beside the core. One program, since what the files share takes longer to compile than to run.

/// Two tests: what is run in `f64` beside LREAL, and in `f32` beside REAL.
macro_rules! in_both {
    ($lreal:ident, $real:ident: $($run:ident),+) => {
        #[test]
        fn $lreal() {
            $($run::<f64>();)+
        }

        #[test]
        fn $real() {
            $($run::<f32>();)+
        }
    };
}

mod advanced;
mod bounds;
mod codes;
mod common;
mod compensate;
mod control;
mod demo;
mod detection;
mod disturbed;
mod docs;
mod example_loop;
mod happens;
mod lint_samples;
mod must_show;
mod open_pins;
mod random;
mod self_check;
mod self_test;
mod stiction;
mod subset;
mod vectors;
