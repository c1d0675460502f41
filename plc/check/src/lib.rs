#![doc = include_str!("../README.md")]

mod first;
mod library;
mod lint;
mod run;
mod second;
mod tree;

pub use library::{Build, Library, Value, Way, sources};
pub use lint::{lint, without_comments};
pub use run::Instance;
pub use tree::Fault;
