//! The golden cases of `vectors/`, which were computed without this crate: every output must agree to the last bit.

use glapp_core::{Backlash, BacklashState, Limits, Noise, NoiseState, Pid, PidState};
use serde_json::Value;
use std::path::Path;

struct Case {
    name: String,
    case: Value,
}

impl Case {
    fn param(&self, name: &str) -> Option<f64> {
        self.case["params"].get(name).map(|value| value.as_f64().expect("a number"))
    }

    fn given(&self, name: &str) -> f64 {
        self.param(name).unwrap_or_else(|| panic!("{}: no {name}", self.name))
    }

    /// Every sample with the time before it; null is not a number.
    fn samples(&self) -> Vec<(f64, Vec<f64>)> {
        let number = |value: &Value| value.as_f64().unwrap_or(f64::NAN);
        let input = self.case["input"].as_array().expect("an array");
        let h = |i: usize| match &self.case["h"] {
            Value::Array(steps) => number(&steps[i]),
            step => number(step),
        };
        let values =
            |value: &Value| value.as_array().map_or(vec![number(value)], |row| row.iter().map(number).collect());
        input.iter().enumerate().map(|(i, value)| (h(i), values(value))).collect()
    }

    /// Compares the output of `update`, called with each sample and the time before it.
    fn check(&self, mut update: impl FnMut(&[f64], f64) -> f64) {
        let expected = self.case["output"].as_array().expect("an array");
        for (i, ((h, x), expected)) in self.samples().iter().zip(expected).enumerate() {
            let output = update(x, *h);
            let same = match expected.as_f64() {
                Some(number) => number.to_bits() == output.to_bits(),
                None => output.is_nan(),
            };
            assert!(same, "{}, sample {i}: {output} instead of {expected}", self.name);
        }
    }
}

fn cases(block: &str) -> Vec<Case> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../../vectors/{block}.json"));
    let text = std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let file: Value = serde_json::from_str(&text).expect("JSON");
    let name = |case: &Value| format!("{block} {} ({})", case["id"], case["comment"]);
    file["cases"].as_array().expect("cases").iter().map(|case| Case { name: name(case), case: case.clone() }).collect()
}

#[test]
fn backlash() {
    for case in cases("backlash") {
        let block = Backlash::new(case.given("d")).unwrap();
        let mut state = case.param("output").map_or_else(BacklashState::default, BacklashState::at);
        case.check(|x, _| block.update(&mut state, x[0]));
    }
}

#[test]
fn noise() {
    for case in cases("noise") {
        let block = Noise::new(case.given("amplitude")).unwrap();
        let mut state = NoiseState { integer: case.given("integer") as i32 };
        case.check(|x, _| block.update(&mut state, x[0]));
    }
}

#[test]
fn pid() {
    for case in cases("pid") {
        let limits = match (case.param("low"), case.param("high")) {
            (Some(low), Some(high)) => Limits::new(low, high).unwrap(),
            _ => Limits::none(),
        };
        let block = Pid::new(case.given("k"), case.given("ti"), case.given("td"), case.given("b"), limits).unwrap();
        let mut state = PidState::default();
        case.check(|x, h| {
            if x[2].is_nan() {
                block.update(&mut state, x[0], x[1], h)
            } else {
                block.track(&mut state, x[0], x[1], x[2], h)
            }
        });
    }
}
