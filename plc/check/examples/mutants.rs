//! Whether the tests beside the core notice each mutant: `cargo run --release -p glapp-plc-check --example mutants [FILE.st ...]`;
//! a number as an argument: so many of all files, drawn, 20 of each file at least; another number: the seed.
//!
//! Each operator, literal and name (to another of its type) is changed one at a time. The tests beside the core run once, on the library as
//! it stands, and leave a trace of every block: what its pins held, and what they showed, which was the core's to the bit. A mutant is noticed
//! where a trace of a block that has the changed file in it shows another bit, or does not run to its end. `GLAPP_TRACES` names a folder in
//! which traces stay, and are taken where there are some. `GLAPP_FATES` names a file to which what became of each mutant is added as it is
//! known; what stands there already is not tried again. `mutants.tsv` lists every mutant that is left, with its reason: `equal: ...` where
//! nothing can tell it from the source.
//!
//! The share of all mutants that a draw tells is weighted by file, and stands there with the ends of its 95 % interval.

use glapp_plc_check::{Build, Fate, Library, Mutant, Mutants, Trace, Trial, sources};
use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};

/// Tests that do not hold the library to the core, by their modules.
const OTHERS: [&str; 7] = ["docs", "subset", "lint_samples", "self_test", "demo", "example_loop", "must_show"];
/// Programs, which have tests of their own, and the tests' block.
const PROGRAMS: [&str; 4] = ["SelfTest.st", "Demo.st", "Loop.st", "TryFunctions.st"];
/// Number of mutants that go over the traces together; their fates are written after each such group.
const AT_ONCE: usize = 1000;

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
    executables.map(PathBuf::from).collect()
}

fn trace(path: &Path) -> Trace {
    Trace::of(&mut std::fs::File::open(path).expect("a file")).expect("a trace")
}

/// Traces of the tests with the unchanged library, in a folder: the shortest trace of each block, then the next of
/// each, and so on; those of which nothing is held to the core come last.
fn traces(folder: &Path) -> Vec<(Build, PathBuf)> {
    std::fs::create_dir_all(folder).expect("a folder");
    let there = std::fs::read_dir(folder).expect("a folder").next().is_some();
    let tests = if there { vec![] } else { tests() };
    assert!(there || !tests.is_empty(), "no tests");
    for test in tests {
        let mut run = Command::new(&test);
        run.env("GLAPP_TRACES", folder).current_dir(env!("CARGO_MANIFEST_DIR"));
        for name in OTHERS {
            run.args(["--skip", &format!("{name}::")]);
        }
        let status = run.stdout(Stdio::null()).status().expect("a test");
        assert!(status.success(), "{}: the library as it stands does not pass", test.display());
    }
    let files = std::fs::read_dir(folder).expect("a folder").map(|file| file.expect("a file").path());
    let told = |path: PathBuf| {
        let one = trace(&path);
        let length = path.metadata().expect("a file").len();
        (one.unit().to_owned(), one.build() == Build::Real, !one.shows(), length, path)
    };
    let mut all: Vec<_> = files.map(told).collect();
    eprintln!("{} traces, {} bytes", all.len(), all.iter().map(|(.., length, _)| length).sum::<u64>());
    all.sort();
    let mut counts = BTreeMap::new();
    let mut ranked = vec![];
    for (unit, real, blind, _, path) in all {
        let count = counts.entry((unit, real, blind)).or_insert(0);
        *count += 1;
        ranked.push(((blind, *count), if real { Build::Real } else { Build::Lreal }, path));
    }
    ranked.sort_by_key(|(rank, ..)| *rank);
    ranked.into_iter().map(|(_, build, path)| (build, path)).collect()
}

/// A mutant as `mutants.tsv` has it: file, the line as it was, as it is; of lines that are the same, which.
fn told(mutant: &Mutant) -> String {
    let which = if mutant.which > 1 { format!(" {}", mutant.which) } else { String::new() };
    format!("{}{which}\t{}\t{}", mutant.file, mutant.line.0, mutant.line.1)
}

/// Fates of mutants so far, in a file.
struct Fates {
    known: BTreeMap<String, Fate>,
    file: Option<std::fs::File>,
}

impl Fates {
    fn of(path: Option<PathBuf>) -> Self {
        let Some(path) = path else { return Self { known: BTreeMap::new(), file: None } };
        let text = std::fs::read_to_string(&path).unwrap_or_default();
        let all = [Fate::Noticed, Fate::Same, Fate::Unread, Fate::Unreached, Fate::Alike, Fate::Absorbed, Fate::Hidden];
        let read = |line: &str| {
            let (key, fate) = line.rsplit_once('\t')?;
            Some((key.to_owned(), *all.iter().find(|one| format!("{one:?}") == fate)?))
        };
        let known = text.lines().filter_map(read).collect();
        Self { known, file: Some(std::fs::File::options().append(true).create(true).open(path).expect("a file")) }
    }

    fn key(build: Build, mutant: &Mutant) -> String {
        format!("{build:?}\t{}", told(mutant))
    }

    fn is_known(&self, build: Build, mutant: &Mutant) -> bool {
        self.known.contains_key(&Self::key(build, mutant))
    }

    fn add(&mut self, build: Build, mutant: &Mutant, fate: Fate) {
        let key = Self::key(build, mutant);
        if let Some(file) = &mut self.file {
            writeln!(file, "{key}\t{fate:?}").expect("room for what was tried");
        }
        self.known.insert(key, fate);
    }
}

/// Counts of a file.
#[derive(Clone, Copy, Default)]
struct Count {
    /// Number of places that can change, and of the changes tried.
    places: usize,
    tried: usize,
    noticed: usize,
    equal: usize,
}

/// Share of the mutants not proved equal that are noticed, in %, with the ends of its 95 % interval: a ratio of two
/// sums over files, each drawn for itself (Cochran, *Sampling Techniques*, 6.11).
fn share(counts: &BTreeMap<String, Count>) -> (f64, f64, f64) {
    let sum = |of: &dyn Fn(&Count) -> usize| -> f64 {
        counts.values().map(|count| count.places as f64 * of(count) as f64 / count.tried as f64).sum()
    };
    let (noticed, all) = (sum(&|count| count.noticed), sum(&|count| count.tried - count.equal));
    let share = noticed / all;
    let mut variance = 0.0;
    for count in counts.values().filter(|count| count.tried > 1 && count.tried < count.places) {
        let (places, tried) = (count.places as f64, count.tried as f64);
        let missed = tried - count.equal as f64 - count.noticed as f64;
        // A mutant adds 1 - share where it is noticed, -share where it is left, 0 where it is equal.
        let sum = count.noticed as f64 * (1.0 - share) - missed * share;
        let squares = count.noticed as f64 * (1.0 - share).powi(2) + missed * share.powi(2);
        let spread = (squares - sum * sum / tried) / (tried - 1.0);
        variance += places * places * (1.0 - tried / places) * spread / tried;
    }
    let reach = 1.96 * variance.sqrt() / all;
    (100.0 * share, 100.0 * (share - reach), 100.0 * (share + reach).min(1.0))
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
    let mut known = Fates::of(std::env::var_os("GLAPP_FATES").map(PathBuf::from));

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
    // LREAL comes first; then REAL for the mutants that are left, and for the files of `real/`.
    let mut counts = BTreeMap::<String, Count>::new();
    let mut left = Vec::<(Mutant, Option<Fate>)>::new();
    for (build, files) in [(Build::Lreal, &long), (Build::Real, &short)] {
        let library = read(files);
        let named = files.iter().map(|(name, text)| (&**name, &**text));
        let base = Library::of(named, build).expect("the library");
        let mut trials: Vec<(Trial, Vec<Mutant>)> = vec![];
        let mut before = BTreeMap::new();
        let mut ready = vec![];
        let mut tries = |known: &Fates, mutant: Mutant, changed: &Library| {
            if known.is_known(build, &mutant) {
                ready.push(mutant);
                return;
            }
            if trials.last().is_none_or(|(_, mutants)| mutants.len() == AT_ONCE) {
                trials.push((Trial::new(base.clone()), vec![]));
            }
            let (trial, mutants) = trials.last_mut().expect("pushed");
            trial.add(&unit(&mutant).1, changed);
            mutants.push(mutant);
        };
        for (mutant, fate) in std::mem::take(&mut left) {
            // A file with a twin in `real/` is none of this build.
            if twin(&mutant.file) {
                left.push((mutant, fate));
                continue;
            }
            // A mutant that REAL refuses is noticed.
            let (file, _) = unit(&mutant);
            match reals.with(&file, &real(&mutant.text)) {
                Ok(changed) => {
                    before.insert(told(&mutant), fate);
                    tries(&known, mutant, &changed);
                }
                Err(_) => known.add(build, &mutant, Fate::Noticed),
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
            let place = if build == Build::Real { format!("real/{file}") } else { file.clone() };
            let mut count = Count::default();
            for (mutant, changed) in mutants {
                let mutant = Mutant { file: place.clone(), ..mutant };
                count.tried += 1;
                if build == Build::Lreal {
                    tries(&known, mutant, &changed);
                } else {
                    match reals.with(file, &real(&mutant.text)) {
                        Ok(changed) => tries(&known, mutant, &changed),
                        Err(_) => known.add(build, &mutant, Fate::Noticed),
                    }
                }
            }
            count.places = if count.tried < of_file { count.tried } else { places(file) };
            if count.tried > 0 {
                counts.insert(place, count);
            }
        }
        eprintln!("{build:?}: {} to try", trials.iter().map(|(_, mutants)| mutants.len()).sum::<usize>());
        for (trial, mutants) in trials {
            let of_build = traces.iter().filter(|(of, _)| *of == build).map(|(_, path)| trace(path));
            for (mutant, fate) in mutants.into_iter().zip(trial.fates(of_build)) {
                known.add(build, &mutant, fate);
                ready.push(mutant);
            }
            eprintln!("{build:?}: {} known", ready.len());
        }
        for mutant in ready {
            let fate = known.known[&Fates::key(build, &mutant)];
            if fate != Fate::Noticed {
                let before = before.get(&told(&mutant)).copied().flatten();
                left.push((mutant, before.max(Some(fate))));
            }
        }
        eprintln!("{build:?}: {} left", left.len());
    }
    if kept.is_none() {
        let _ = std::fs::remove_dir_all(&folder);
    }
    let mut unlisted = 0;
    counts.values_mut().for_each(|count| count.noticed = count.tried);
    for (mutant, fate) in &left {
        let count = counts.get_mut(&mutant.file).expect("counted");
        count.noticed -= 1;
        let (told, fate) = (told(mutant), fate.expect("tried"));
        match reasons.get(&*told) {
            Some(reason) => count.equal += usize::from(reason.starts_with("equal: ")),
            None if matches!(fate, Fate::Same | Fate::Unread) => count.equal += 1,
            None => {
                unlisted += 1;
                println!("{told}\t{fate:?}");
            }
        }
    }
    for (file, Count { places, tried, noticed, equal }) in &counts {
        eprintln!("{file}: {tried} of {places} tried, {noticed} noticed, {equal} proved equal");
    }
    let sum = |of: fn(&Count) -> usize| counts.values().map(of).sum::<usize>();
    let (share, low, high) = share(&counts);
    eprintln!(
        "{} of {} mutants tried, {} noticed, {} proved equal, {unlisted} not listed: {share:.2} % ({low:.2} to {high:.2}) noticed",
        sum(|count| count.tried),
        sum(|count| count.places),
        sum(|count| count.noticed),
        sum(|count| count.equal),
    );
    if unlisted == 0 && share >= 97.0 { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}
