//! Names for the numbers that blocks show: the core's.

use crate::common::{Block, Number, home};
use glapp_core::auto_tuner::{Phase, Rule, Stop};
use glapp_core::modules::{Mode, Unfit};
use glapp_core::{Doubt, Push, Reason, Source, Standing, Way};
use std::fmt::Debug;

fn listed(name: &str) -> Vec<(String, u16)> {
    let text = std::fs::read_to_string(home().join(format!("{name}.st"))).unwrap();
    let rows = text.lines().filter_map(|line| line.trim().split_once(" : INT := "));
    rows.map(|(name, rest)| (name.to_owned(), rest.split(';').next().unwrap().parse().unwrap())).collect()
}

/// Compares all values in order; the first one may stand for no value.
fn held<T: Debug + Copy>(file: &str, all: &[T], number: impl Fn(T) -> u16) {
    let known: Vec<(String, u16)> = all.iter().map(|one| (format!("{one:?}"), number(*one))).collect();
    // Plainer, or taken by the library of a maker.
    let here = |name: String| match (file, &*name) {
        (_, "Manual") => "ByHand".into(),
        ("Ways", _) => format!("By{name}"),
        ("Pushes", "Knocker") => "ByPulses".into(),
        ("Pushes", _) => format!("By{name}"),
        _ => name,
    };
    let known = known.into_iter().filter(|(name, _)| name != "None").map(|(name, number)| (here(name), number));
    let known: Vec<(String, u16)> = known.collect();
    assert_eq!(listed(file), known, "{file}");
    shown::<f64>(file, &known);
    shown::<f32>(file, &known);
}

/// A variable of the structure begins with these numbers.
fn shown<R: Number>(file: &str, known: &[(String, u16)]) {
    let block = Block::new::<R>("GlappTryFunctions");
    for (name, number) in known {
        assert_eq!(block.get(&format!("{file}Shown.{name}")), f64::from(*number), "{file}.{name}");
    }
}

#[test]
fn names_have_the_numbers_of_the_core() {
    held("StandingCodes", &Standing::ALL, |one| one as u16);
    held("DoubtCodes", &Doubt::ALL, |one| one as u16);
    held("UnsuitedCodes", &Unfit::ALL, |one| one as u16);
    held("StopCodes", &Stop::ALL, |one| one as u16);
    held("PhaseCodes", &Phase::ALL, |one| one as u16);
    held("ReasonCodes", &Reason::ALL, |one| one as u16);
    held("MaskCodes", &Reason::ALL[1..], |one| one.bit());
    held("Modes", &Mode::ALL, |one| one as u16);
    held("Ways", &Way::ALL, |one| one as u16);
    held("Sources", &Source::ALL, |one| one as u16);
    held("Rules", &Rule::ALL, |one| one as u16);
    held("Pushes", &Push::ALL, |one| one as u16);
}
