//! Whether the tests beside the core notice each mutant: `cargo run --release -p glapp-plc-check --example mutants [FILE.st ...]`;
//! `mutants.tsv` as an argument: those alone that a list has; a number: every so manieth of each file.
//!
//! Each operator, literal and name (to another of its type) is changed one at a time. The tests beside the core run once, on the library as
//! it stands, and leave a trace of every block: what its pins held, and what they showed, which was the core's to the bit. A mutant is noticed
//! where a trace of a block that has the changed file in it shows another bit, or does not run to its end. `mutants.tsv` lists every mutant that
//! is left, with its reason: `equal: ...` where nothing can tell it from the source.

use glapp_plc_check::{Build, Library, Mutant, Mutants, Trace, Trial, sources};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};

/// Tests that do not run the library beside the core.
const OTHERS: [&str; 6] = ["docs", "subset", "lint_samples", "self_test", "demo", "must_show"];
/// Programs: they have tests of their own.
const PROGRAMS: [&str; 3] = ["SelfTest.st", "SelfCheck.st", "Demo.st"];

fn tests() -> Vec<PathBuf> {
    let built = Command::new(env!("CARGO"))
        .args(["test", "--release", "-p", "glapp-plc-check", "--no-run", "--message-format=json"])
        .stderr(Stdio::inherit())
        .output()
        .expect("cargo");
    let text = String::from_utf8_lossy(&built.stdout);
    let executables = text
        .lines()
        .filter(|line| line.contains("\"kind\":[\"test\"]"))
        .filter_map(|line| line.split_once("\"executable\":\"")?.1.split('"').next());
    let name = |path: &Path| {
        let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        stem.rsplit_once('-').map_or(stem.clone(), |(name, _)| name.to_owned())
    };
    executables.map(PathBuf::from).filter(|path| !OTHERS.contains(&&*name(path))).collect()
}

/// What the tests do with the library as it stands.
fn traces() -> Vec<Trace> {
    let folder = std::env::temp_dir().join(format!("glapp-traces-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder");
    let tests = tests();
    assert!(!tests.is_empty(), "no tests");
    for test in tests {
        let mut run = Command::new(&test);
        run.env("GLAPP_TRACES", &folder).current_dir(env!("CARGO_MANIFEST_DIR"));
        let status = run.stdout(Stdio::null()).status().expect("a test");
        assert!(status.success(), "{}: the library as it stands does not pass", test.display());
    }
    let files = std::fs::read_dir(&folder).expect("a folder").map(|file| file.expect("a file").path());
    let read = |path: PathBuf| Trace::of(&mut std::fs::File::open(path).expect("a file")).expect("a trace");
    let mut all: Vec<Trace> = files.map(read).collect();
    let _ = std::fs::remove_dir_all(&folder);
    // The shortest of each block, then the next of each, and so on.
    all.sort_by_key(|trace| (trace.unit().to_owned(), trace.events()));
    let mut counts = BTreeMap::new();
    let mut ranked: Vec<(usize, Trace)> = vec![];
    for trace in all {
        let count = counts.entry((trace.unit().to_owned(), trace.build() == Build::Real)).or_insert(0);
        ranked.push((*count, trace));
        *count += 1;
    }
    ranked.sort_by_key(|(rank, _)| *rank);
    ranked.into_iter().map(|(_, trace)| trace).collect()
}

/// A mutant as `mutants.tsv` has it: file, the line as it was, as it is.
fn told(mutant: &Mutant) -> String {
    format!("{}\t{}\t{}", mutant.file, mutant.line.0, mutant.line.1)
}

fn main() -> ExitCode {
    let (again, wanted): (Vec<String>, Vec<String>) = std::env::args().skip(1).partition(|name| name.ends_with(".tsv"));
    let (every, wanted): (Vec<String>, Vec<String>) =
        wanted.into_iter().partition(|name| name.parse::<usize>().is_ok());
    let every = every.first().map_or(1, |number| number.parse().expect("a number"));
    let again: Vec<String> = again.iter().map(|list| std::fs::read_to_string(list).expect("a list")).collect();
    let home = Path::new(env!("CARGO_MANIFEST_DIR"));
    let ours = home.join("..");
    let listed = std::fs::read_to_string(home.join("mutants.tsv")).unwrap_or_default();
    let reasons: BTreeMap<_, _> = listed.lines().filter_map(|line| line.rsplit_once('\t')).collect();
    let traces = traces();
    eprintln!("{} traces, {} events", traces.len(), traces.iter().map(Trace::events).sum::<usize>());

    let sources = |build| sources(&ours, build).expect("the library");
    let (long, short) = (sources(Build::Lreal), sources(Build::Real));
    let read = |files: &[(String, String)]| Mutants::new(files).expect("the library");
    let real = |text: &str| text.replace("LREAL", "REAL");
    let typed: Vec<_> = short.iter().map(|(file, text)| (file.clone(), real(text))).collect();
    let reals = read(&typed);
    let unit = |mutant: &Mutant| {
        let file = mutant.file.trim_start_matches("real/");
        (file.to_owned(), format!("Glapp{}", file.trim_end_matches(".st")))
    };
    let of = |build| traces.iter().filter(|trace| trace.build() == build).collect::<Vec<_>>();
    // In LREAL first; what is left of it in REAL, and what stands in `real/`.
    let (mut counts, mut left) = (BTreeMap::new(), vec![]);
    for (build, files) in [(Build::Lreal, &long), (Build::Real, &short)] {
        let library = read(files);
        let mut trial = Trial::new(Library::read(&ours, build).expect("the library"));
        let mut tried = if build == Build::Real { std::mem::take(&mut left) } else { vec![] };
        for (file, _) in files {
            let named = wanted.is_empty() || wanted.contains(file);
            let twin = ours.join("real").join(file).exists();
            if !named || (build == Build::Real && !twin) || PROGRAMS.contains(&&**file) {
                continue;
            }
            for (mutant, changed) in library.of(file).expect("a file").step_by(every) {
                let place = if build == Build::Real { format!("real/{file}") } else { file.clone() };
                let mutant = Mutant { file: place, ..mutant };
                if !again.is_empty() && !again.iter().any(|list| list.contains(&told(&mutant))) {
                    continue;
                }
                counts.entry(mutant.file.clone()).or_insert([0, 0])[0] += 1;
                if build == Build::Lreal {
                    trial.add(&unit(&mutant).1, changed);
                }
                tried.push(mutant);
            }
        }
        if build == Build::Real {
            // A file with a twin in `real/` is none of this build; what REAL refuses is noticed.
            let apart =
                |mutant: &Mutant| !mutant.file.starts_with("real/") && ours.join("real").join(&mutant.file).exists();
            tried.retain(|mutant| {
                if apart(mutant) {
                    left.push(mutant.clone());
                    return false;
                }
                let (file, unit) = unit(mutant);
                reals.with(&file, &real(&mutant.text)).is_ok_and(|changed| {
                    trial.add(&unit, changed);
                    true
                })
            });
        }
        eprintln!("{build:?}: {} to try", tried.len());
        let noticed = trial.noticed(&of(build));
        left.extend(tried.into_iter().zip(noticed).filter(|(_, noticed)| !noticed).map(|(mutant, _)| mutant));
        eprintln!("{build:?}: {} left", left.len());
    }
    let (mut equal, mut unlisted) = (0, 0);
    for mutant in &left {
        counts.get_mut(&mutant.file).expect("counted")[1] += 1;
        let told = told(mutant);
        match reasons.get(&*told) {
            Some(reason) => equal += usize::from(reason.starts_with("equal: ")),
            None => {
                unlisted += 1;
                println!("{told}");
            }
        }
    }
    for (file, [all, left]) in &counts {
        eprintln!("{file}: {all} mutants, {left} left");
    }
    let (all, left) = (counts.values().map(|[all, _]| all).sum::<usize>(), left.len());
    let share = 100.0 * (all - left) as f64 / (all - equal) as f64;
    eprintln!(
        "{all} mutants, {} noticed, {equal} proved equal, {unlisted} not listed: {share:.1} % noticed",
        all - left
    );
    if unlisted == 0 && share >= 97.0 { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}
