//! The blocks from outside. One program, since what the files share takes longer to compile than to run.

mod auto_tuner;
mod detection;
mod modules;
mod pairs;
mod pid_tuner;
mod properties;
mod settings;
mod single_precision;
