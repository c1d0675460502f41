//! `GlappSelfTest` is as the command writes it, passes, and fails for a mutant of each block.

use crate::common::{Number, folder, self_test};
use glapp_plc_check::{Build, Mutants, sources};

fn whole<R: Number>() {
    let files = sources(&folder(), R::BUILD).unwrap();
    let text = &files.iter().find(|(name, _)| name == "SelfTest.st").unwrap().1;
    assert_eq!(*text, self_test::written::<R>(), "cargo run -p glapp-plc-check --example self_test");
    assert_eq!(self_test::run(R::library()), Some([1.0, 1.0, 1.0, 0.0, 0.0]));
}

in_both!(lreal, real: whole);

/// Every block with statements is one of those driven, or inside one of them.
#[test]
fn no_block_is_left_out() {
    let files = sources(&folder(), Build::Lreal).unwrap();
    let mut reached = self_test::driven();
    let mut at = 0;
    while at < reached.len() {
        let text = &files.iter().find(|(name, _)| format!("Glapp{name}") == format!("{}.st", reached[at])).unwrap().1;
        for (name, _) in &files {
            let name = format!("Glapp{}", name.trim_end_matches(".st"));
            if text.contains(&name) && !reached.contains(&name) {
                reached.push(name);
            }
        }
        at += 1;
    }
    for (name, text) in files.iter().filter(|(_, text)| text.contains("END_FUNCTION")) {
        let name = format!("Glapp{}", name.trim_end_matches(".st"));
        assert!(text.contains(&name));
        let program = ["GlappSelfTest", "GlappSelfCheck", "GlappDemo", "GlappLoop"].contains(&&*name);
        assert!(reached.contains(&name) || program, "{name} is not driven");
    }
}

#[test]
fn a_mutant_of_each_block_is_noticed() {
    let files = sources(&folder(), Build::Lreal).unwrap();
    let all = Mutants::new(&files).unwrap();
    for (file, text) in &files {
        if file.starts_with("Self") || !text.contains("FUNCTION_BLOCK") {
            continue;
        }
        let mut mutants = all.of(file).unwrap().step_by(3);
        let notices = |shown: Option<[f64; 5]>| shown.is_none_or(|shown| shown[1] == 0.0 && shown[3] > 0.0);
        assert!(mutants.any(|(_, library)| notices(self_test::run(&library))), "{file}");
    }
}
