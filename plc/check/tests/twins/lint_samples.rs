//! A sample for each rule of the linter, and no rule without one.

use glapp_plc_check::{Build, Library};

const BODIES: [(&str, &str); 23] = [
    ("(* \u{c5} *) Y := A;", "not ASCII"),
    ("(* a (* b *) *) Y := A;", "a comment within a comment"),
    ("// no\nY := A;", "a comment is (* ... *)"),
    ("{pragma} Y := A;", "a pragma"),
    ("Other(X => A);", "=> is not known everywhere"),
    ("N := INT#3;", "a typed literal"),
    ("Y := 'text';", "a string"),
    ("Out := P & Q;", "& ^ % are not in the subset"),
    ("Y := A; (* no end", "a comment without end"),
    ("if P THEN Y := A; END_IF;", "in capitals"),
    ("FOR L := 1 TO 1 DO Y := A; END_FOR;", "FOR has two passes or more"),
    ("FOR L := 9 TO 1 BY -9 DO Y := A; END_FOR;", "FOR has two passes or more"),
    ("FOR L := I TO 3 DO Y := A; END_FOR;", "FOR has literal bounds"),
    ("Other(A);", "pins of a block are named"),
    ("M := 3000000000;", "is beyond DINT"),
    ("Y := 1.0E39;", "is beyond 1E38, or below 1E-37"),
    ("Y := 1.0E-40;", "is beyond 1E38, or below 1E-37"),
    ("Y := Row[ABS(I)];", "an index is a variable, a literal or a sum"),
    ("Out := NOT (P AND Q);", "NOT before a compound"),
    ("Y := A - B - A;", "without parentheses"),
    ("Out := A > B AND P;", "without parentheses"),
    ("Out := P AND ((A / B) > 1.0);", "both sides are evaluated"),
    ("Out := P OR (Row[I] > 1.0);", "both sides are evaluated"),
];

const DECLARATIONS: [(&str, &str); 11] = [
    ("LIMIT : LREAL;", "is a keyword or a standard function somewhere"),
    ("REFERENCE : LREAL;", "is a keyword or a standard function somewhere"),
    ("Hysteresis : LREAL;", "is a name of"),
    ("Window : LREAL;", "of OSCAT already"),
    ("X_ : LREAL;", "underscores"),
    ("Z : LREAL; z : LREAL;", "differs from another name in nothing but case"),
    ("X : LREAL := A;", "begins with something other than a literal"),
    ("X : ARRAY[3..1] OF LREAL;", "an array without elements"),
    ("X : TIME;", "is not in the subset"),
    ("X : REAL;", "is not in the subset"),
    ("X : ARRAY[0..1] OF GlappSum;", "is not in the subset"),
];

fn refused(declaration: &str, body: &str) -> String {
    let text = format!(
        "FUNCTION_BLOCK GlappTry VAR_INPUT A : LREAL; B : LREAL; I : INT; P : BOOL; Q : BOOL; END_VAR
        VAR_OUTPUT Y : LREAL; N : INT; M : DINT; Out : BOOL; END_VAR
        VAR L : INT; Row : ARRAY[1..3] OF LREAL; {declaration} END_VAR
        {body}
        END_FUNCTION_BLOCK"
    );
    match Library::of([("Try.st", &*text)].into_iter(), Build::Lreal) {
        Ok(_) => panic!("taken: {declaration} {body}"),
        Err(fault) => fault.what,
    }
}

#[test]
fn each_sample_is_caught() {
    for (body, what) in BODIES {
        let told = refused("", body);
        assert!(told.contains(what), "{body}: {told}");
    }
    for (declaration, what) in DECLARATIONS {
        let told = refused(declaration, "Y := A;");
        assert!(told.contains(what), "{declaration}: {told}");
    }
    let text =
        "FUNCTION_BLOCK Try VAR_INPUT A : LREAL; END_VAR VAR_OUTPUT Y : LREAL; END_VAR Y := A; END_FUNCTION_BLOCK";
    let told = Library::of([("Try.st", text)].into_iter(), Build::Lreal).unwrap_err().what;
    assert!(told.contains("names of units begin with Glapp"), "{told}");
}

/// Texts of faults in the linter's source, from their last gap on.
#[test]
fn no_rule_is_without_a_sample() {
    let source = include_str!("../../src/lint.rs");
    let mut rules = 0;
    for (at, _) in source.match_indices("fault(") {
        let rest = source[at + "fault(".len()..].trim_start().trim_start_matches("format!(").trim_start();
        let Some(text) = rest.strip_prefix('"').and_then(|rest| rest.split('"').next()) else { continue };
        // Samples that one of the parsers refuses before the linter sees them.
        let unreached = ["a minus before", "an array with a beginning", "an exponent has a point"]
            .iter()
            .any(|part| text.contains(part));
        let fixed = text.rsplit('}').next().unwrap();
        let sampled =
            BODIES.iter().chain(&DECLARATIONS).any(|(_, what)| fixed.contains(what) || what.contains(fixed.trim()));
        assert!(sampled || unreached || text.contains("names of units"), "no sample: {text}");
        rules += 1;
    }
    assert!(rules >= 22, "{rules}");
}
