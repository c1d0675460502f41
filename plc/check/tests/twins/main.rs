//! The Structured Text of `plc/` beside the core. One program, since what the files share takes longer to compile than to run.

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
mod lint_samples;
mod must_show;
mod open_pins;
mod random;
mod self_check;
mod self_test;
mod stiction;
mod subset;
mod vectors;
