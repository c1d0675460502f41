#![doc = include_str!("../README.md")]

mod first;
mod flow;
mod layout;
mod library;
mod lint;
mod mutate;
mod page;
mod run;
mod second;
mod trace;
mod tree;
mod trial;

pub use layout::{Variable, Within};
pub use library::{Build, Library, Value, Way, sources, trees};
pub use mutate::{Mutant, Mutants};
pub use page::{Pin, members, pins};
pub use run::Instance;
pub use trace::Trace;
pub use tree::{Fault, Unit};
pub use trial::{Fate, Trial};
