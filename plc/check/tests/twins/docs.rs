//! `plc/blocks.md` explains every block, every pin has a description, and the examples run.

use glapp_plc_check::{Build, Instance, Library, members, pins, sources};
use std::path::{Path, PathBuf};

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn page() -> String {
    std::fs::read_to_string(folder().join("blocks.md")).unwrap()
}

/// The part of the page under the heading of a block.
fn section<'p>(page: &'p str, name: &str) -> &'p str {
    let (_, rest) = page.split_once(&format!("\n## {name}\n")).unwrap_or_else(|| panic!("no section {name}"));
    rest.split("\n## ").next().unwrap()
}

#[test]
fn every_block_is_explained_and_every_pin() {
    let page = page();
    for (file, text) in sources(&folder(), Build::Lreal).unwrap() {
        let name = format!("Glapp{}", file.trim_end_matches(".st"));
        assert!(page.contains(&name), "{name} is not explained");
        let bare: Vec<_> = pins(&text).lines().skip(2).filter(|row| row.ends_with("|  |")).map(str::to_owned).collect();
        assert!(bare.is_empty(), "{name}: pins without a description: {bare:?}");
        if text.contains("FUNCTION_BLOCK") {
            assert!(section(&page, &name).contains("{pins}"), "{name}: no place for its pins");
        }
        // What others read or set: those of blocks within blocks are listed by name.
        if text.contains("STRUCT") && page.contains(&format!("\n### {name}\n")) {
            let (_, rest) = page.split_once(&format!("\n### {name}\n")).unwrap();
            let part = rest.split("\n##").next().unwrap();
            assert!(
                part.contains(&members(&text)),
                "{name}: its members are not those of the source:\n{}",
                members(&text)
            );
            let bare = members(&text).lines().skip(2).any(|row| row.ends_with("|  |"));
            assert!(!bare, "{name}: members without a description");
        }
    }
}

/// Every structure that a pin has is told member by member, but for what a block shows of its inside.
#[test]
fn every_structure_of_a_pin_has_its_members_there() {
    let page = page();
    let inside =
        ["Used", "GlappRecord", "GlappEstimate", "GlappHalfPeriodData", "GlappWidthParts", "GlappCorrectedWidth"];
    let mut told = 0;
    for (_, text) in sources(&folder(), Build::Lreal).unwrap() {
        let pins = pins(&text);
        for ty in pins.lines().skip(2).filter_map(|row| row.split(" | ").nth(2)).filter(|ty| ty.starts_with("Glapp")) {
            if !inside.iter().any(|known| ty.ends_with(known)) {
                assert!(page.contains(&format!("\n### {ty}\n")), "{ty} is not told");
                told += 1;
            }
        }
    }
    assert!(told > 20, "{told}");
}

fn literal(text: &str) -> Option<f64> {
    match text {
        "TRUE" => Some(1.0),
        "FALSE" => Some(0.0),
        number => number.parse().ok(),
    }
}

/// Lines `Block(Pin := literal, ...);  (* Pin = literal, ... *)`, and before them `Pin.Part := literal;`.
#[test]
fn examples_give_what_they_say() {
    let page = page();
    let mut shown = 0;
    for build in [Build::Lreal, Build::Real] {
        let library = Library::read(&folder(), build).unwrap();
        for (file, text) in sources(&folder(), build).unwrap() {
            let name = format!("Glapp{}", file.trim_end_matches(".st"));
            if !text.contains("FUNCTION_BLOCK") || name == "GlappDetector" {
                continue;
            }
            let (_, rest) = section(&page, &name).split_once("```st\n").unwrap_or_else(|| panic!("{name}: no example"));
            let mut one = Instance::new(&library, &name).unwrap();
            for line in rest.split("```").next().unwrap().lines() {
                let (code, result) = line.split_once("(*").unwrap_or((line, ""));
                let code = code.trim().trim_end_matches(';');
                let (call, args) = match code.split_once('(') {
                    Some((_, args)) => (true, args.trim_end_matches(')')),
                    None => (false, code),
                };
                for arg in args.split(", ") {
                    let (pin, value) = arg.split_once(" := ").unwrap_or_else(|| panic!("{name}: {line}"));
                    match literal(value) {
                        Some(value) => one.set(pin, value).unwrap_or_else(|fault| panic!("{line}: {fault}")),
                        None => assert_eq!(pin, value, "{line}"),
                    }
                }
                if call {
                    one.call().unwrap_or_else(|fault| panic!("{line}: {fault}"));
                }
                for claim in result.trim_end_matches("*)").split(", ").filter(|claim| !claim.trim().is_empty()) {
                    let (pin, value) = claim.trim().split_once(" = ").unwrap_or_else(|| panic!("{line}"));
                    let (got, told) = (one.get(pin).unwrap(), literal(value).unwrap());
                    assert!((got - told).abs() <= 1e-6 * told.abs(), "{name}, {line}: {pin} is {got}");
                    shown += 1;
                }
            }
        }
    }
    assert!(shown > 20);
}

/// A limit cycle of 1 about the setpoint with half-periods of 100 s: 0.5/10·1·100 − 1/2 = 4.5.
#[test]
fn the_example_of_the_detector_runs() {
    let page = page();
    let (_, rest) = section(&page, "GlappDetector").split_once("```st\n").unwrap();
    let example = rest.split("```").next().unwrap();
    for build in [Build::Lreal, Build::Real] {
        let mut files = sources(&folder(), build).unwrap();
        files.push(("Example.st".into(), example.into()));
        let library = Library::of(files.iter().map(|(name, text)| (&**name, &**text)), build).unwrap();
        let mut one = Instance::new(&library, "GlappExample").unwrap();
        for scan in 0..800 {
            one.set("Pv", if (scan / 100) % 2 == 0 { -1.0 } else { 1.0 }).unwrap();
            one.call().unwrap();
        }
        assert_eq!(one.get("Width").unwrap(), 4.5);
        assert_eq!(one.get("Found").unwrap(), 1.0);
    }
}

/// A loop with a gap of 2 and a load, in noise.
#[test]
fn the_example_of_the_controller_finds_its_gap() {
    let page = page();
    let example = section(&page, "GlappPidAdvanced").split("```st\n").find(|part| part.starts_with("PROGRAM")).unwrap();
    let example = example.split("```").next().unwrap();
    for build in [Build::Lreal, Build::Real] {
        let mut files = sources(&folder(), build).unwrap();
        files.push(("Example.st".into(), example.into()));
        let library = Library::of(files.iter().map(|(name, text)| (&**name, &**text)), build).unwrap();
        let mut one = Instance::new(&library, "GlappExample").unwrap();
        for _ in 0..6000 {
            one.call().unwrap();
        }
        let width = one.get("Width").unwrap();
        assert!(one.get("Found").unwrap() == 1.0 && (width - 2.0).abs() < 0.3, "{build:?}: {width}");
    }
}
