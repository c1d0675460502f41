//! Whether the tests beside the core notice each mutant: `cargo run --release -p glapp-plc-check --example mutants [FILE.st ...]`;
//! a number as an argument: so many of all files, drawn, 20 of each file at least; another number: the seed.
//!
//! Each operator, literal and name (to another of its type) is changed one at a time. The tests beside the core run once, on the library as
//! it stands, and leave a trace of every block: what its pins held, and what they showed, which was the core's to the bit. A mutant is noticed
//! where a trace of a block that has the changed file in it shows another bit, or does not run to its end. `GLAPP_TRACES` names a folder in
//! which traces stay, and are taken where there are some. `mutants.tsv` lists every mutant that
//! is left, with its reason: `equal: ...` where nothing can tell it from the source.

use glapp_plc_check::{Build, Fate, Library, Mutant, Mutants, Trace, Trial, sources};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};

/// Tests that do not run the library beside the core.
const OTHERS: [&str; 6] = ["docs", "subset", "lint_samples", "self_test", "demo", "must_show"];
/// Programs, which have tests of their own, and the tests' block.
const PROGRAMS: [&str; 3] = ["SelfTest.st", "Demo.st", "TryFunctions.st"];

fn tests() -> Vec<PathBuf> {
    let built = Command::new(env!("CARGO"))
        .args(["test", "-p", "glapp-plc-check", "--no-run", "--message-format=json"])
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

fn trace(path: &Path) -> Trace {
    Trace::of(&mut std::fs::File::open(path).expect("a file")).expect("a trace")
}

/// What the tests do with the library as it stands, in a folder: the shortest trace of each block, then the next of each, and so on.
fn traces(folder: &Path) -> Vec<(Build, PathBuf)> {
    std::fs::create_dir_all(folder).expect("a folder");
    let there = std::fs::read_dir(folder).expect("a folder").next().is_some();
    let tests = if there { vec![] } else { tests() };
    assert!(there || !tests.is_empty(), "no tests");
    for test in tests {
        let mut run = Command::new(&test);
        run.env("GLAPP_TRACES", folder).current_dir(env!("CARGO_MANIFEST_DIR"));
        let status = run.stdout(Stdio::null()).status().expect("a test");
        assert!(status.success(), "{}: the library as it stands does not pass", test.display());
    }
    let files = std::fs::read_dir(folder).expect("a folder").map(|file| file.expect("a file").path());
    let told = |path: PathBuf| {
        let mut file = std::io::BufReader::new(std::fs::File::open(&path).expect("a file"));
        let mut head = String::new();
        std::io::BufRead::read_line(&mut file, &mut head).expect("a trace");
        let mut words = head.split_whitespace().map(str::to_owned);
        let (unit, build) = (words.next().expect("a block"), words.next().expect("a build"));
        let length = file.get_ref().metadata().expect("a file").len();
        (unit, build == "REAL", length, path)
    };
    let mut all: Vec<_> = files.map(told).collect();
    eprintln!("{} traces, {} bytes", all.len(), all.iter().map(|(.., length, _)| length).sum::<u64>());
    all.sort();
    let mut counts = BTreeMap::new();
    let mut ranked = vec![];
    for (unit, real, _, path) in all {
        let count = counts.entry((unit, real)).or_insert(0);
        *count += 1;
        ranked.push((*count, if real { Build::Real } else { Build::Lreal }, path));
    }
    ranked.sort_by_key(|(rank, ..)| *rank);
    ranked.into_iter().map(|(_, build, path)| (build, path)).collect()
}

/// A mutant as `mutants.tsv` has it: file, the line as it was, as it is; of lines that are the same, which.
fn told(mutant: &Mutant) -> String {
    let which = if mutant.which > 1 { format!(" {}", mutant.which) } else { String::new() };
    format!("{}{which}\t{}\t{}", mutant.file, mutant.line.0, mutant.line.1)
}

fn main() -> ExitCode {
    let (numbers, wanted): (Vec<String>, Vec<String>) =
        std::env::args().skip(1).partition(|name| name.parse::<u64>().is_ok());
    let numbers: Vec<u64> = numbers.iter().map(|number| number.parse().expect("a number")).collect();
    let (drawn, seed) = (numbers.first().copied(), numbers.get(1).copied().unwrap_or(1));
    let home = Path::new(env!("CARGO_MANIFEST_DIR"));
    let ours = home.join("..");
    let listed = std::fs::read_to_string(home.join("mutants.tsv")).unwrap_or_default();
    let reasons: BTreeMap<_, _> = listed.lines().filter_map(|line| line.rsplit_once('\t')).collect();
    let kept = std::env::var_os("GLAPP_TRACES").map(PathBuf::from);
    let folder =
        kept.clone().unwrap_or_else(|| std::env::temp_dir().join(format!("glapp-traces-{}", std::process::id())));
    let traces = traces(&folder);

    // The functions stand on the pins of a block of the tests.
    let text = std::fs::read_to_string(home.join("tests/tries/TryFunctions.st")).expect("a file");
    let tries = ("TryFunctions.st".to_owned(), text);
    let sources = |build| {
        let mut files = sources(&ours, build).expect("the library");
        files.push(tries.clone());
        files
    };
    let (long, short) = (sources(Build::Lreal), sources(Build::Real));
    let read = |files: &[(String, String)]| Mutants::new(files).expect("the library");
    let real = |text: &str| text.replace("LREAL", "REAL");
    let typed: Vec<_> = short.iter().map(|(file, text)| (file.clone(), real(text))).collect();
    let reals = read(&typed);
    let unit = |mutant: &Mutant| {
        let file = mutant.file.trim_start_matches("real/");
        (file.to_owned(), format!("Glapp{}", file.trim_end_matches(".st")))
    };
    let twin = |file: &str| ours.join("real").join(file).exists();
    // In LREAL first; what is left of it in REAL, and what stands in `real/`.
    let (mut counts, mut left) = (BTreeMap::new(), Vec::<(Mutant, Option<Fate>)>::new());
    for (build, files) in [(Build::Lreal, &long), (Build::Real, &short)] {
        let library = read(files);
        let named = files.iter().map(|(name, text)| (&**name, &**text));
        let mut trial = Trial::new(Library::of(named, build).expect("the library"));
        let mut tried: Vec<(Mutant, Option<Fate>)> = vec![];
        for (mutant, fate) in std::mem::take(&mut left) {
            // A file with a twin in `real/` is none of this build.
            if twin(&mutant.file) {
                left.push((mutant, fate));
                continue;
            }
            // What REAL refuses is noticed.
            let (file, unit) = unit(&mutant);
            if let Ok(changed) = reals.with(&file, &real(&mutant.text)) {
                trial.add(&unit, &changed);
                tried.push((mutant, fate));
            }
        }
        let named = |file: &String| {
            let here = build == Build::Lreal || twin(file);
            (wanted.is_empty() || wanted.contains(file)) && here && !PROGRAMS.contains(&&**file)
        };
        let files: Vec<&String> = files.iter().map(|(file, _)| file).filter(|file| named(file)).collect();
        let places = |file: &str| library.places(file).expect("a file");
        let blocks = long.iter().map(|(file, _)| &**file).filter(|file| !PROGRAMS.contains(file));
        let all = if drawn.is_some() { blocks.map(places).sum::<usize>() } else { 0 };
        for file in files {
            let of_file = drawn.map_or(usize::MAX, |drawn| (drawn as usize * places(file)).div_ceil(all).max(20));
            let mutants: Box<dyn Iterator<Item = _>> = match drawn {
                Some(_) => Box::new(library.drawn(file, seed, of_file).expect("a file")),
                None => Box::new(library.of(file).expect("a file")),
            };
            for (mutant, changed) in mutants {
                let place = if build == Build::Real { format!("real/{file}") } else { file.clone() };
                let mutant = Mutant { file: place, ..mutant };
                counts.entry(mutant.file.clone()).or_insert([0, 0])[0] += 1;
                if build == Build::Lreal {
                    trial.add(&unit(&mutant).1, &changed);
                } else {
                    let (file, unit) = unit(&mutant);
                    let Ok(changed) = reals.with(&file, &real(&mutant.text)) else { continue };
                    trial.add(&unit, &changed);
                }
                tried.push((mutant, None));
            }
        }
        eprintln!("{build:?}: {} to try", tried.len());
        let of_build: Vec<&PathBuf> = traces.iter().filter(|(of, _)| *of == build).map(|(_, path)| path).collect();
        let of_build = of_build.iter().enumerate().map(|(number, path)| {
            if number % 200 == 199 {
                eprintln!("{} of {} traces", number + 1, of_build.len());
            }
            trace(path)
        });
        let fates = trial.fates(of_build).into_iter();
        let both = |((mutant, before), now): ((Mutant, Option<Fate>), Fate)| {
            (now != Fate::Noticed).then_some((mutant, before.max(Some(now))))
        };
        left.extend(tried.into_iter().zip(fates).filter_map(both));
        left.iter().for_each(|(mutant, fate)| eprintln!("left in {build:?}\t{}\t{fate:?}", told(mutant)));
        eprintln!("{build:?}: {} left", left.len());
    }
    if kept.is_none() {
        let _ = std::fs::remove_dir_all(&folder);
    }
    let (mut equal, mut unlisted) = (0, 0);
    for (mutant, fate) in &left {
        counts.get_mut(&mutant.file).expect("counted")[1] += 1;
        let (told, fate) = (told(mutant), fate.expect("tried"));
        match reasons.get(&*told) {
            Some(reason) => equal += usize::from(reason.starts_with("equal: ")),
            None if matches!(fate, Fate::Same | Fate::Unread) => equal += 1,
            None => {
                unlisted += 1;
                println!("{told}\t{fate:?}");
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
