//! `plc/blocks.md` explains every block and structure, every pin has a description, and the examples run.

use glapp_plc_check::{Build, Instance, Library, Pin, members, pins, sources};
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

/// Names in the library, texts, and pins or members of the source files.
fn units() -> Vec<(String, String, Vec<Pin>)> {
    let files = sources(&folder(), Build::Lreal).unwrap();
    let with_pins = |(file, text): (String, String)| {
        let all = if text.contains("STRUCT") { members(&text) } else { pins(&text).concat() };
        (format!("Glapp{}", file.trim_end_matches(".st")), text, all)
    };
    files.into_iter().map(with_pins).collect()
}

/// The tables are filled in from the sources; there is a place for each of them.
#[test]
fn every_block_structure_and_function_is_explained() {
    let page = page();
    for (name, text, pins) in units() {
        assert!(page.contains(&name), "{name} is not explained");
        if text.contains("FUNCTION_BLOCK") {
            assert!(section(&page, &name).contains("{pins}"), "{name}: no place for its pins");
        } else if text.contains("STRUCT") {
            assert!(page.contains(&format!("\n### {name}\n\n{{members}}\n")), "{name}: no place for its members");
        } else if text.contains("\nFUNCTION ") {
            let call: Vec<&str> = pins.iter().map(|pin| &*pin.name).collect();
            assert!(page.contains(&format!("`{name}({})`", call.join(", "))), "{name}: its call is not explained");
        }
    }
}

/// Every pin and member has a description, none says whether another one is given, and a number that stands for something says where its
/// names are.
#[test]
fn every_pin_and_member_says_what_it_is() {
    let (units, mut named) = (units(), 0);
    let all: Vec<&str> = units.iter().map(|(name, ..)| &**name).collect();
    for (name, _, pins) in units.iter().filter(|(name, ..)| name != "GlappSelfTest") {
        for Pin { name: pin, ty, comment } in pins {
            assert!(!comment.is_empty(), "{name}.{pin} has no description");
            let has = pin.strip_prefix("Has").is_some_and(|of| of.starts_with(char::is_uppercase));
            assert!(!has, "{name}.{pin}: what is not given holds a number that it cannot have");
            let number = ["Standing", "Hindered", "Doubt", "Unsuited", "Reason", "Mask", "Phase", "StopReason", "Mode"];
            let number = number.iter().chain(&["Way", "Source", "Push", "Rule"]).any(|one| one == pin);
            if ty == "INT" && number {
                let (_, place) = comment.split_once("see ").unwrap_or_else(|| panic!("{name}.{pin}: {comment}"));
                let place = place.split(|c: char| !c.is_alphanumeric()).next().unwrap();
                assert!(all.contains(&place), "{name}.{pin}: there is no {place}");
                named += 1;
            }
        }
    }
    assert!(named > 20, "{named}");
}

/// The table of pins before and after in `plc/measured.md`.
#[test]
fn pins_are_as_many_as_is_written() {
    let text = std::fs::read_to_string(folder().join("measured.md")).unwrap();
    let (_, table) = text.split_once("| block | pins before: in, out | now: in, out |\n").unwrap();
    let units = units();
    for row in table.lines().skip(1).take_while(|row| row.starts_with('|')) {
        let cells: Vec<&str> = row.split('|').map(str::trim).collect();
        let (.., source, _) = units.iter().find(|(name, ..)| cells[1] == format!("`{name}`")).unwrap();
        let [inputs, outputs] = pins(source).map(|pins| pins.len());
        assert_eq!(cells[3], format!("{inputs}, {outputs}"), "{}", cells[1]);
    }
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
                    let (got, stated) = (one.get(pin).unwrap(), literal(value).unwrap());
                    assert!((got - stated).abs() <= 1e-6 * stated.abs(), "{name}, {line}: {pin} is {got}");
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

/// The first lines that a reader of `docs/plc.md` types, on a limit cycle of 1 with half-periods of 100 s and OP at rest: K/Ti·Δy·Δt with
/// the filtered Δy of 0.97.
#[test]
fn the_first_lines_of_the_page_show_a_width() {
    let page = std::fs::read_to_string(folder().join("../docs/plc.md")).unwrap();
    let (_, rest) = page.split_once("```st\n").unwrap();
    let lines = rest.split("```").next().unwrap();
    let program = format!(
        "FUNCTION_BLOCK GlappExample\nVAR_INPUT\n    Sp : LREAL;\n    Pv : LREAL;\n    Op : LREAL;\nEND_VAR\nVAR_OUTPUT\n    \
         Width : LREAL;\nEND_VAR\nVAR\n    Detector : GlappDetector;\n    Settings : GlappDetectorSettings;\nEND_VAR\n{}\n    \
         IF Detector.WidthFound THEN\n        Width := Detector.Estimate.Value;\n    END_IF;\nEND_FUNCTION_BLOCK\n",
        lines.trim_end()
    );
    for build in [Build::Lreal, Build::Real] {
        let mut files = sources(&folder(), build).unwrap();
        files.push(("Example.st".into(), program.clone()));
        let library = Library::of(files.iter().map(|(name, text)| (&**name, &**text)), build).unwrap();
        let mut one = Instance::new(&library, "GlappExample").unwrap();
        for scan in 0..8000 {
            one.set("Pv", if (scan / 1000) % 2 == 0 { -1.0 } else { 1.0 }).unwrap();
            one.call().unwrap();
        }
        let width = one.get("Width").unwrap();
        assert!((width - 4.87).abs() < 0.05, "{build:?}: {width}");
    }
}

/// The program of the page keeps to the subset, with no name that a compiler or a maker's library has: `Integral`, a block of matiec, once
/// kept it from OpenPLC and Beremiz.
#[test]
fn the_program_of_the_page_keeps_to_the_subset() {
    let page = std::fs::read_to_string(folder().join("../docs/plc.md")).unwrap();
    let (_, rest) = page.split_once("```st\nPROGRAM MyLoop\n").unwrap();
    let program = format!("PROGRAM GlappMyLoop\n{}", rest.split("```").next().unwrap());
    for build in [Build::Lreal, Build::Real] {
        let mut files = sources(&folder(), build).unwrap();
        files.push(("MyLoop.st".into(), program.clone()));
        Library::of(files.iter().map(|(name, text)| (&**name, &**text)), build).unwrap();
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
