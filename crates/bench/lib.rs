//! Nothing but the benches of this crate.
