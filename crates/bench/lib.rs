//! An empty library: this crate holds only benches.
