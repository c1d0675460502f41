//! Whether a folder holds the library again, tree by tree: `cargo run -p glapp-plc-check --example same -- FOLDER LREAL`.

use glapp_plc_check::{Build, trees};
use std::path::Path;
use std::process::ExitCode;

fn main() -> ExitCode {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [folder, build] = &args[..] else { panic!("a folder, and LREAL or REAL") };
    let build = if build == "REAL" { Build::Real } else { Build::Lreal };
    let ours = trees(&Path::new(env!("CARGO_MANIFEST_DIR")).join(".."), build).expect("the library");
    let theirs = trees(Path::new(folder), build).unwrap_or_else(|fault| panic!("{fault}"));
    let names = |all: &[(String, _)]| all.iter().map(|(name, _)| name.clone()).collect::<Vec<_>>();
    assert_eq!(names(&ours), names(&theirs), "files");
    let differ: Vec<_> = ours.iter().zip(&theirs).filter(|(a, b)| a != b).map(|(a, _)| &a.0).collect();
    println!("{} files, {} of them with another tree {differ:?}", ours.len(), differ.len());
    if differ.is_empty() { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}
