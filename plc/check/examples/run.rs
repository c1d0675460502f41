//! Runs a program of one's own with the library, without a controller, and writes what its outputs show as CSV:
//! `cargo run --release -p glapp-plc-check --example run -- MINE.st 6000 Pv=50 Pv=NaN@300`. A number is how many scans;
//! `REAL` takes that build; `Pin=value` sets an input, `Pin=value@scan` from that scan on. Arrays are not shown.

use glapp_plc_check::{Build, Instance, Library, Variable, Within};
use std::fmt::Write;
use std::path::Path;
use std::process::ExitCode;

/// Rows that are written, evenly over the scans.
const ROWS: usize = 20;

/// What the command line asks for.
struct Asked {
    file: String,
    build: Build,
    scans: usize,
    /// Scan from which on an input has a value.
    inputs: Vec<(usize, String, f64)>,
}

fn asked(args: impl Iterator<Item = String>) -> Result<Asked, String> {
    let mut asked = Asked { file: String::new(), build: Build::Lreal, scans: 1000, inputs: vec![] };
    for arg in args {
        if let Some((pin, value)) = arg.split_once('=') {
            let (value, scan) = value.split_once('@').unwrap_or((value, "0"));
            let number = match value.to_ascii_uppercase().as_str() {
                "TRUE" => Ok(1.0),
                "FALSE" => Ok(0.0),
                text => text.parse(),
            };
            let number = number.map_err(|_| format!("{arg}: {value} is not a number, TRUE or FALSE"))?;
            let scan = scan.parse().map_err(|_| format!("{arg}: {scan} is not the number of a scan"))?;
            asked.inputs.push((scan, pin.to_owned(), number));
        } else if arg == "REAL" {
            asked.build = Build::Real;
        } else if let Ok(scans) = arg.parse() {
            asked.scans = scans;
        } else if asked.file.is_empty() {
            asked.file = arg;
        } else {
            return Err(format!("{arg}: {} is run already; a second file must be pasted into it", asked.file));
        }
    }
    if asked.file.is_empty() || asked.scans == 0 {
        return Err("a file with a program is needed, and one scan at least: MINE.st 6000 Pv=50".into());
    }
    Ok(asked)
}

fn run(asked: &Asked) -> Result<String, String> {
    let path = Path::new(&asked.file);
    let text = std::fs::read_to_string(path).map_err(|e| format!("{}: {e}", asked.file))?;
    let text = text.replace("\r\n", "\n").replace('\t', "    ");
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let (library, name) =
        Library::with_own(&folder, asked.build, (&asked.file, &text)).map_err(|fault| fault.to_string())?;
    let whole = |variable: &&Variable| variable.parts.iter().all(|(_, within)| *within != Within::Array);
    let shown: Vec<String> = library.outputs(&name).iter().filter(whole).map(Variable::path).collect();
    let mut one = Instance::new(&library, &name).map_err(|fault| format!("{fault}; a function cannot be run alone"))?;
    let mut out = format!("scan,{}\n", shown.join(","));
    let every = asked.scans.div_ceil(ROWS);
    for scan in 1..=asked.scans {
        for (_, pin, value) in asked.inputs.iter().filter(|(from, ..)| (*from).max(1) == scan) {
            one.set(pin, *value).map_err(|fault| fault.to_string())?;
        }
        one.call().map_err(|fault| format!("scan {scan}: {fault}"))?;
        if scan % every == 0 || scan == asked.scans {
            write!(out, "{scan}").expect("a string");
            for path in &shown {
                let value = one.get(path).map_err(|fault| fault.to_string())?;
                write!(out, ",{}", rounded(value)).expect("a string");
            }
            out.push('\n');
        }
    }
    Ok(out)
}

/// Seven digits of a number, for a person to read.
fn rounded(value: f64) -> f64 {
    // Plus 0: no "-0" where a ramp ended.
    format!("{value:.6e}").parse().unwrap_or(value) + 0.0
}

fn main() -> ExitCode {
    match asked(std::env::args().skip(1)).and_then(|asked| run(&asked)) {
        Ok(table) => {
            print!("{table}");
            ExitCode::SUCCESS
        }
        Err(what) => {
            eprintln!("{what}");
            ExitCode::FAILURE
        }
    }
}
