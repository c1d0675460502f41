//! Whether the tests beside the core notice each mutant: `cargo run --release -p glapp-plc-check --example mutants [FILE.st ...]`;
//! `mutants.tsv` as an argument: those alone that a list has; a number: every so manieth of each file.
//!
//! Each operator, literal and name (to another of its type) is changed one at a time. The tests run on the changed library, all but those of the
//! documentation and of this tool; the first difference ends them. `mutants.tsv` lists every mutant that is left, with its reason: `equal: ...` where
//! nothing can tell it from the source.

use glapp_plc_check::{Build, Mutant, Mutants, sources};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Tests that do not run the library beside the core.
const OTHERS: [&str; 6] = ["docs", "subset", "lint_samples", "self_test", "demo", "must_show"];

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
    let mut all: Vec<_> = executables.map(PathBuf::from).filter(|path| !OTHERS.contains(&&*name(path))).collect();
    // Vectors are told fastest.
    all.sort_by_key(|path| (name(path) != "vectors", name(path) == "random", name(path)));
    assert!(!all.is_empty(), "no tests");
    all
}

/// The library in a folder of its own.
fn copied(ours: &Path, to: &Path) {
    for folder in ["", "real"] {
        std::fs::create_dir_all(to.join(folder)).expect("a folder");
        for entry in std::fs::read_dir(ours.join(folder)).expect("the library") {
            let path = entry.expect("a file").path();
            if path.extension().is_some_and(|ending| ending == "st") {
                std::fs::copy(&path, to.join(folder).join(path.file_name().unwrap_or_default())).expect("a copy");
            }
        }
    }
}

/// A mutant as `mutants.tsv` has it: file, the line as it was, as it is.
fn told(mutant: &Mutant) -> String {
    format!("{}\t{}\t{}", mutant.file, mutant.line.0, mutant.line.1)
}

fn noticed(tests: &[PathBuf], folder: &Path) -> bool {
    tests.iter().any(|test| {
        let mut run = Command::new(test);
        run.env("GLAPP_PLC", folder).env("RUST_TEST_THREADS", "1").current_dir(env!("CARGO_MANIFEST_DIR"));
        !run.stdout(Stdio::null()).stderr(Stdio::null()).status().expect("a test").success()
    })
}

fn main() -> ExitCode {
    let (again, wanted): (Vec<String>, Vec<String>) = std::env::args().skip(1).partition(|name| name.ends_with(".tsv"));
    let (every, wanted): (Vec<String>, Vec<String>) =
        wanted.into_iter().partition(|name| name.parse::<usize>().is_ok());
    let every = every.first().map_or(1, |number| number.parse().expect("a number"));
    let again: Vec<String> = again.iter().map(|list| std::fs::read_to_string(list).expect("a list")).collect();
    let home = Path::new(env!("CARGO_MANIFEST_DIR"));
    let ours = home.join("..");
    let tests = tests();
    let mut all: Vec<Mutant> = vec![];
    for build in [Build::Lreal, Build::Real] {
        let files = sources(&ours, build).expect("the library");
        let library = Mutants::new(&files).expect("the library");
        for (file, _) in &files {
            let named = wanted.is_empty() || wanted.contains(file);
            let twin = ours.join("real").join(file).exists();
            if named
                && (build == Build::Lreal || twin)
                && !["SelfTest.st", "SelfCheck.st", "Demo.st"].contains(&&**file)
            {
                let place = if build == Build::Real { format!("real/{file}") } else { file.clone() };
                let mutants = library.of(file).expect("a file");
                all.extend(mutants.step_by(every).map(|(mutant, _)| Mutant { file: place.clone(), ..mutant }));
            }
        }
    }
    if !again.is_empty() {
        let listed = |mutant: &Mutant| again.iter().any(|list| list.contains(&told(mutant)));
        all.retain(listed);
    }
    let scratch = std::env::temp_dir().join(format!("glapp-mutants-{}", std::process::id()));
    copied(&ours, &scratch.join("0"));
    assert!(!noticed(&tests, &scratch.join("0")), "the library as it stands does not pass");
    let (next, left) = (AtomicUsize::new(0), Mutex::new(vec![]));
    let workers = std::thread::available_parallelism().map_or(1, usize::from);
    std::thread::scope(|scope| {
        for worker in 0..workers {
            let (all, tests, next, left) = (&all, &tests, &next, &left);
            let folder = scratch.join(worker.to_string());
            copied(&ours, &folder);
            let ours = &ours;
            scope.spawn(move || {
                loop {
                    let number = next.fetch_add(1, Ordering::Relaxed);
                    let Some(mutant) = all.get(number) else { return };
                    let path = folder.join(&mutant.file);
                    std::fs::write(&path, &mutant.text).expect("a file");
                    if !noticed(tests, &folder) {
                        left.lock().expect("no panic").push(number);
                        println!("{}", told(mutant));
                    }
                    std::fs::copy(ours.join(&mutant.file), &path).expect("a copy");
                    if number % 20 == 19 {
                        eprintln!("{} of {}, {} left", number + 1, all.len(), left.lock().expect("no panic").len());
                    }
                }
            });
        }
    });
    let _ = std::fs::remove_dir_all(&scratch);
    let listed = std::fs::read_to_string(home.join("mutants.tsv")).unwrap_or_default();
    let reasons: BTreeMap<_, _> = listed.lines().filter_map(|line| line.rsplit_once('\t')).collect();
    let (mut equal, mut unlisted) = (0, 0);
    let left = left.into_inner().expect("no panic");
    for number in &left {
        match reasons.get(&*told(&all[*number])) {
            Some(reason) => equal += usize::from(reason.starts_with("equal: ")),
            None => unlisted += 1,
        }
    }
    let noticed = all.len() - left.len();
    let share = 100.0 * noticed as f64 / (all.len() - equal) as f64;
    eprintln!(
        "{} mutants, {noticed} noticed, {equal} proved equal, {unlisted} not listed: {share:.1} % noticed",
        all.len()
    );
    if unlisted == 0 && share >= 97.0 { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}
