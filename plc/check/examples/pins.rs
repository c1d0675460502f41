//! Prints the tables of pins and members that `docs/plc.md` has: `cargo run -p glapp-plc-check --example pins`.

use glapp_plc_check::{Build, members, pins, sources};
use std::path::Path;

fn main() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    for (name, text) in sources(&folder, Build::Lreal).expect("the library") {
        if text.contains("VAR_INPUT") {
            println!("{name}\n\n{}\n", pins(&text));
        } else if text.contains("STRUCT") {
            println!("{name}\n\n{}\n", members(&text));
        }
    }
}
