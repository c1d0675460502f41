//! The evaluator by cases computed by hand, and a sample for each rule of the subset.

use glapp_plc_check::{Build, Fault, Instance, Library, sources};
use std::path::Path;

/// A block with inputs A, B (LREAL), I, J (INT), D (DINT), P, Q (BOOL), outputs Y, N, M, R of those types, and these statements.
fn block(body: &str) -> String {
    format!(
        "FUNCTION_BLOCK GlappTry VAR_INPUT A : LREAL; B : LREAL; I : INT; J : INT; D : DINT; P : BOOL; Q : BOOL; END_VAR
        VAR_OUTPUT Y : LREAL; N : INT; M : DINT; Out : BOOL; END_VAR
        VAR L : INT; Row : ARRAY[1..3] OF LREAL; END_VAR
        {body}
        END_FUNCTION_BLOCK"
    )
}

fn library(body: &str, build: Build) -> Result<Library, Fault> {
    let text = block(body);
    Library::of([("Try.st", &*text)].into_iter(), build)
}

fn run(body: &str, build: Build, pins: &[(&str, f64)], output: &str) -> Result<f64, Fault> {
    let library = library(body, build)?;
    let mut one = Instance::new(&library, "GlappTry")?;
    for (pin, value) in pins {
        one.set(pin, *value)?;
    }
    one.call()?;
    one.get(output)
}

const REALS: [(&str, f64); 2] = [("A", 7.5), ("B", -2.0)];
const INTEGERS: [(&str, f64); 3] = [("I", 7.0), ("J", -2.0), ("D", 40000.0)];

#[test]
fn every_operator() {
    let real = |body, value: f64| {
        for build in [Build::Lreal, Build::Real] {
            assert_eq!(run(body, build, &REALS, "Y"), Ok(value), "{body}");
        }
    };
    real("Y := A + B;", 5.5);
    real("Y := A - B;", 9.5);
    real("Y := A * B;", -15.0);
    real("Y := A / B;", -3.75);
    real("Y := -A;", -7.5);
    real("Y := ABS(B);", 2.0);
    real("Y := (A + B) * 2.0;", 11.0);
    real("Y := 1.0E3;", 1000.0);
    let integer =
        |body, output, value: f64| assert_eq!(run(body, Build::Lreal, &INTEGERS, output), Ok(value), "{body}");
    integer("N := I + J;", "N", 5.0);
    integer("N := I - J;", "N", 9.0);
    integer("N := I * J;", "N", -14.0);
    integer("N := I / J;", "N", -3.0);
    integer("N := I MOD J;", "N", 1.0);
    integer("N := -I;", "N", -7.0);
    integer("N := ABS(J);", "N", 2.0);
    integer("M := D + INT_TO_DINT(I);", "M", 40007.0);
    integer("M := -3;", "M", -3.0);
    integer("Y := INT_TO_LREAL(J) / 4.0;", "Y", -0.5);
    for (symbol, values) in
        [("=", [0.0, 1.0, 0.0]), ("<>", [1.0, 0.0, 1.0]), ("<", [1.0, 0.0, 0.0]), ("<=", [1.0, 1.0, 0.0])]
    {
        for (a, value) in [1.0, 2.0, 3.0].into_iter().zip(values) {
            let of = |body: String, pins: &[(&str, f64)]| run(&body, Build::Lreal, pins, "Out");
            assert_eq!(of(format!("Out := A {symbol} B;"), &[("A", a), ("B", 2.0)]), Ok(value), "{a} {symbol}");
            assert_eq!(of(format!("Out := I {symbol} J;"), &[("I", a), ("J", 2.0)]), Ok(value), "{a} {symbol}");
        }
    }
    for (a, greater, least) in [(1.0, 0.0, 0.0), (2.0, 0.0, 1.0), (3.0, 1.0, 1.0)] {
        assert_eq!(run("Out := A > B;", Build::Lreal, &[("A", a), ("B", 2.0)], "Out"), Ok(greater));
        assert_eq!(run("Out := A >= B;", Build::Lreal, &[("A", a), ("B", 2.0)], "Out"), Ok(least));
    }
    for (p, q, and, or, xor) in
        [(0.0, 0.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 1.0, 1.0), (1.0, 0.0, 0.0, 1.0, 1.0), (1.0, 1.0, 1.0, 1.0, 0.0)]
    {
        let of = |body| run(body, Build::Lreal, &[("P", p), ("Q", q)], "Out").unwrap();
        assert_eq!((of("Out := P AND Q;"), of("Out := P OR Q;"), of("Out := P XOR Q;")), (and, or, xor));
        assert_eq!((of("Out := NOT P;"), of("Out := P = Q;"), of("Out := P <> Q;")), (1.0 - p, 1.0 - xor, xor));
    }
}

#[test]
fn every_statement() {
    let of = |body, i: f64| run(body, Build::Lreal, &[("I", i)], "N").unwrap();
    let branches = "IF I < 0 THEN N := 1; ELSIF I = 0 THEN N := 2; ELSE N := 3; END_IF;";
    assert_eq!([-5.0, 0.0, 5.0].map(|i| of(branches, i)), [1.0, 2.0, 3.0]);
    assert_eq!(of("FOR L := 1 TO 4 DO N := N + L; END_FOR;", 0.0), 10.0);
    assert_eq!(of("FOR L := 9 TO 1 BY -4 DO N := (N * 10) + L; END_FOR;", 0.0), 951.0);
    assert_eq!(of("N := I; WHILE N > 10 DO N := N / 2; END_WHILE;", 100.0), 6.0);
    let row = "FOR L := 1 TO 3 DO Row[L] := INT_TO_LREAL(L) * 1.5; END_FOR; Y := Row[I + 1];";
    assert_eq!(run(row, Build::Lreal, &[("I", 1.0)], "Y"), Ok(3.0));
}

#[test]
fn real_is_rounded_to_32_bits_after_each_operation() {
    let body = "Y := (A + B) - A;";
    let pins = [("A", 16_777_216.0), ("B", 1.0)];
    assert_eq!(run(body, Build::Lreal, &pins, "Y"), Ok(1.0));
    assert_eq!(run(body, Build::Real, &pins, "Y"), Ok(0.0));
    // A fused multiply and add would give 2^-46 here.
    let body = "Y := (A * A) - B;";
    let a = 1.0 + 2.0_f64.powi(-23);
    assert_eq!(run(body, Build::Real, &[("A", a), ("B", 1.0 + 2.0_f64.powi(-22))], "Y"), Ok(0.0));
}

#[test]
fn what_a_controller_may_not_do_stops_the_run() {
    let stopped = |body, pins: &[(&str, f64)], what: &str| {
        for build in [Build::Lreal, Build::Real] {
            let fault = run(body, build, pins, "Y").expect_err(body);
            assert!(fault.what.contains(what), "{body}: {fault}");
        }
    };
    stopped("Y := A / B;", &[("A", 1.0)], "division by zero");
    stopped("N := I / J;", &[("I", 1.0)], "division by zero");
    stopped("N := I MOD J;", &[("I", 1.0)], "division by zero");
    assert!(run("Y := A * A;", Build::Real, &[("A", 1e30)], "Y").unwrap_err().what.contains("no number"));
    assert!(run("Y := A * A;", Build::Lreal, &[("A", 1e200)], "Y").unwrap_err().what.contains("no number"));
    stopped("Y := A + 1.0;", &[("A", f64::NAN)], "no number");
    stopped("Y := ABS(A);", &[("A", f64::INFINITY)], "no number");
    stopped("N := I + J;", &[("I", 32000.0), ("J", 1000.0)], "out of range");
    stopped("N := -I;", &[("I", -32768.0)], "out of range");
    stopped("M := D * D;", &[("D", 100_000.0)], "out of range");
    stopped("Y := Row[I];", &[("I", 4.0)], "index 4 outside 1..3");
    stopped("Row[I] := 1.0;", &[("I", 0.0)], "index 0 outside 1..3");
    stopped("N := 1; WHILE N > 0 DO N := 1; END_WHILE;", &[], "without end");
    stopped("FOR L := 1 TO 3 DO L := 2; END_FOR;", &[], "was written");
    // Both sides of AND are evaluated; the linter would catch it before.
    assert_eq!(run("Y := A;", Build::Lreal, &[("A", f64::NAN)], "Out"), Ok(0.0), "a copy is no operation");
    assert_eq!(run("Out := A > 0.0;", Build::Lreal, &[("A", f64::NAN)], "Out"), Ok(0.0), "nor is a comparison");
}

#[test]
fn types_and_names_that_do_not_fit_are_refused() {
    for (body, what) in [
        ("Y := I;", "Int where Lreal"),
        ("Y := 1;", "where Lreal"),
        ("N := 1.0;", "where Int"),
        ("N := D;", "Dint where Int"),
        ("M := I;", "Int where Dint"),
        ("Out := A > I;", "Int where Lreal"),
        ("Out := A;", "Lreal where Bool"),
        ("N := 40000;", "where Int"),
        ("Y := Z;", "no variable Z"),
        ("Y := a;", "no variable a"),
        ("A := 1.0;", "an input"),
        ("Y := SIN(A);", "no function SIN"),
        ("Y := ABS(I);", "Int where Lreal"),
        ("Y := A MOD B;", "not whole"),
        ("Out := P < Q;", "between Bool"),
        ("Y := Row[D];", "Dint where Int"),
        ("IF I THEN Y := A; END_IF;", "Int where Bool"),
        ("Other(X := A);", "no variable Other"),
    ] {
        let fault = library(body, Build::Lreal).expect_err(body);
        assert!(fault.what.contains(what), "{body}: {fault}");
    }
}

#[test]
fn a_sample_of_each_rule_is_caught() {
    for (body, what) in [
        ("// no\nY := A;", "a comment is"),
        ("/* no */ Y := A;", "a comment is"),
        ("(* a (* b *) *) Y := A;", "within a comment"),
        ("(* Å *) Y := A;", "not ASCII"),
        ("{pragma} Y := A;", "pragma"),
        ("Other(X => A);", "=>"),
        ("N := INT#3;", "typed literal"),
        ("Y := A; EXIT;", ""),
        ("REPEAT Y := A; UNTIL TRUE END_REPEAT;", ""),
        ("RETURN;", ""),
        ("CASE I OF 1: Y := A; END_CASE;", ""),
        ("Out := P & Q;", "& ^ %"),
        ("Y := 1.0E39;", "beyond 1E38"),
        ("Y := 1.0E-40;", "below 1E-37"),
        ("M := 3000000000;", "beyond DINT"),
        ("FOR L := 1 TO 1 DO Y := A; END_FOR;", "two passes"),
        ("FOR L := I TO 3 DO Y := A; END_FOR;", "literal bounds"),
        ("Out := NOT (P AND Q);", "NOT before a compound"),
        ("Out := A > B AND P;", "without parentheses"),
        ("Y := A - B - A;", "without parentheses"),
        ("Y := A * B + A;", "without parentheses"),
        ("Out := P AND ((A / B) > 1.0);", "both sides"),
        ("Out := P OR (Row[I] > 1.0);", "both sides"),
        ("if P THEN Y := A; END_IF;", "capitals"),
    ] {
        let fault = library(body, Build::Lreal).expect_err(body);
        assert!(fault.what.contains(what), "{body}: {fault}");
    }
    for (declaration, what) in [
        ("VAR Limit : LREAL; END_VAR", "keyword"),
        ("VAR dt : LREAL; END_VAR", "keyword"),
        ("VAR X : LREAL; x : LREAL; END_VAR", "nothing but case"),
        ("VAR X, Z : LREAL; END_VAR", ""),
        ("VAR X : REAL; END_VAR", "REAL"),
        ("VAR X : WORD; END_VAR", "WORD"),
        ("VAR X : ARRAY[0..N] OF LREAL; END_VAR", "literals"),
        ("VAR X : ARRAY[0..1] OF LREAL := [1.0, 2.0]; END_VAR", ""),
        ("VAR_TEMP X : LREAL; END_VAR", ""),
        ("VAR_IN_OUT X : LREAL; END_VAR", "subset"),
        ("VAR X_ : LREAL; END_VAR", "underscores"),
        ("VAR X : TIME; END_VAR", "TIME"),
    ] {
        let text = format!("FUNCTION_BLOCK GlappTry {declaration} ; END_FUNCTION_BLOCK");
        let fault = Library::of([("Try.st", &*text)].into_iter(), Build::Lreal).expect_err(declaration);
        assert!(fault.what.contains(what), "{declaration}: {fault}");
    }
    let text = "FUNCTION_BLOCK Other VAR X : LREAL; END_VAR X := 1.0; END_FUNCTION_BLOCK";
    assert!(Library::of([("Other.st", text)].into_iter(), Build::Lreal).unwrap_err().what.contains("Glapp"));
    let text = "FUNCTION_BLOCK GlappOther VAR X : LREAL; END_VAR X := 1.0; END_FUNCTION_BLOCK trailing";
    assert!(Library::of([("Other.st", text)].into_iter(), Build::Lreal).is_err(), "the rest of a file is read too");
}

#[test]
fn the_library_keeps_to_the_subset() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    for build in [Build::Lreal, Build::Real] {
        let library = Library::read(&folder, build).unwrap_or_else(|fault| panic!("{fault}"));
        assert!(library.ways.len() > 100);
        for (name, text) in sources(&folder, build).unwrap() {
            assert!(text.lines().all(|line| line.len() <= 120), "{name}: a line is longer than 120 characters");
        }
    }
}
