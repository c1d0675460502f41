//! Blocks of the library beside those of the core, and what both are fed with.
#![allow(dead_code, missing_docs)] // each test file uses its part

pub mod advanced;
pub mod blocks;
pub mod compensate;
pub mod control;
pub mod cover;
pub mod detection;
pub mod detector;
pub mod names;
pub mod self_test;

use glapp_core::{DetectorState, Real};
use glapp_plc_check::{Build, Fault, Instance, Library, Trace, sources};
use names::{Names, Place, known};
use serde_json::Value;
use std::cell::RefCell;
use std::collections::HashMap;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Folder of the library: `GLAPP_PLC` names a changed one, of which the first difference ends the run.
pub fn folder() -> PathBuf {
    let Some(changed) = std::env::var_os("GLAPP_PLC") else { return home() };
    static ONCE: std::sync::Once = std::sync::Once::new();
    ONCE.call_once(|| {
        std::panic::set_hook(Box::new(|info| {
            // Written without a macro: a macro's text is held back by the test, and lost here.
            let _ = writeln!(std::io::stderr(), "{info}");
            std::process::exit(101);
        }));
    });
    changed.into()
}

pub fn home() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// A block that has all functions on its pins.
pub fn tries() -> (String, String) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/tries/TryFunctions.st");
    ("TryFunctions.st".into(), std::fs::read_to_string(path).expect("a file"))
}

/// `f64` and `LREAL`, or `f32` and `REAL`.
pub trait Number: Real + serde::Serialize + serde::de::DeserializeOwned {
    const BUILD: Build;
    /// A step in which anything that moves has no finite derivative.
    const SHORTEST: f64;
    fn library() -> &'static Library;
    /// The detector after a power cut: its detections, the rest as after a gap.
    fn restarted(state: &DetectorState<Self>) -> DetectorState<Self>;
}

macro_rules! number {
    ($float:ty, $build:expr, $shortest:expr) => {
        impl Number for $float {
            const BUILD: Build = $build;
            const SHORTEST: f64 = $shortest;

            fn library() -> &'static Library {
                static LIBRARY: OnceLock<Library> = OnceLock::new();
                LIBRARY.get_or_init(|| {
                    let folder = folder();
                    let mut files = sources(&folder, $build).unwrap_or_else(|e| panic!("{e}"));
                    let changed = folder != home();
                    if !changed {
                        files.push(tries());
                    }
                    let files = files.iter().map(|(name, text)| (&**name, &**text));
                    let library = if changed { Library::of_unruled(files, $build) } else { Library::of(files, $build) };
                    library.unwrap_or_else(|e| panic!("{e}"))
                })
            }

            fn restarted(state: &DetectorState<Self>) -> DetectorState<Self> {
                let mut saved = serde_json::to_value(state).unwrap();
                let fresh = serde_json::to_value(DetectorState::<Self>::default()).unwrap();
                saved["signal"] = fresh["signal"].clone();
                saved["memory"]["previous_delta_y"] = Value::Null;
                serde_json::from_value(saved).unwrap()
            }
        }
    };
}

number!(f64, Build::Lreal, 5e-324);
number!(f32, Build::Real, 1e-45);

/// An instance, and where `GLAPP_TRACES` names a folder, a trace there of what a test does with it.
pub struct Traced {
    instance: Instance<'static>,
    names: Names,
    /// Optional pins: their initial value, whether they are given, and the given value.
    options: HashMap<String, (f64, bool, f64)>,
    trace: Option<Trace>,
    held: bool,
}

impl Traced {
    pub fn new<R: Number>(name: &str) -> Result<Self, Fault> {
        let instance = Instance::new(R::library(), name)?;
        let trace = std::env::var_os("GLAPP_TRACES").map(|_| Trace::new(name, R::BUILD));
        let names = Names::new(R::library(), name);
        Ok(Self { instance, names, options: HashMap::new(), trace, held: true })
    }

    pub fn set(&mut self, pin: &str, value: f64) -> Result<(), Fault> {
        match self.names.place(pin) {
            Place::Pin(path) => {
                let put = match self.options.get_mut(&path) {
                    Some((open, given, last)) => {
                        *last = value;
                        if *given { value } else { *open }
                    }
                    None => value,
                };
                self.put(&path, put)
            }
            Place::Given(paths) => {
                for path in paths {
                    let name = path.rsplit('.').next().unwrap_or_default();
                    let begins = self.instance.get(&path)?;
                    let open = if name == "Td" { -1.0 } else { begins };
                    let option = self.options.entry(path.clone()).or_insert((open, true, begins));
                    option.1 = value != 0.0;
                    let put = if option.1 { option.2 } else { option.0 };
                    self.put(&path, put)?;
                }
                Ok(())
            }
            Place::Known(..) => self.instance.set(pin, value),
        }
    }

    fn put(&mut self, path: &str, value: f64) -> Result<(), Fault> {
        if let Some(trace) = &mut self.trace {
            trace.set(path, value);
        }
        self.instance.set(path, value)
    }

    pub fn spoil(&mut self, name: &str, value: f64) -> Result<(), Fault> {
        if let Some(trace) = &mut self.trace {
            trace.spoil(name, value);
        }
        self.instance.spoil(name, value)
    }

    pub fn call(&mut self) -> Result<(), Fault> {
        if let Some(trace) = &mut self.trace {
            trace.scan();
        }
        self.instance.call()
    }

    pub fn power_cut(&mut self) {
        if let Some(trace) = &mut self.trace {
            trace.power_cut();
        }
        self.instance.power_cut();
    }

    pub fn get(&mut self, pin: &str) -> Result<f64, Fault> {
        match self.names.place(pin) {
            Place::Pin(path) => {
                let value = self.instance.get(&path)?;
                if let (Some(trace), true) = (&mut self.trace, self.held) {
                    trace.read(&path, value);
                }
                Ok(value)
            }
            Place::Given(paths) => Ok(f64::from(self.options.get(&paths[0]).is_none_or(|option| option.1))),
            Place::Known(of, test, than) => Ok(f64::from(known(test, self.get(of)?, than))),
        }
    }

    /// Any variable; a trace has it.
    pub fn look(&mut self, name: &str) -> Result<f64, Fault> {
        let Ok(value) = self.instance.peek(name) else { return self.get(name) };
        if let (Some(trace), true) = (&mut self.trace, self.held) {
            trace.read(name, value);
        }
        Ok(value)
    }

    pub fn peek(&self, name: &str) -> Result<f64, Fault> {
        self.instance.peek(name)
    }

    pub fn name(&self) -> &str {
        self.instance.name()
    }

    pub fn operations(&self) -> u64 {
        self.instance.operations()
    }

    pub fn taken(&self) -> &[bool] {
        self.instance.taken()
    }
}

impl Drop for Traced {
    fn drop(&mut self) {
        static NUMBER: AtomicUsize = AtomicUsize::new(0);
        let (Some(trace), Some(folder)) = (&self.trace, std::env::var_os("GLAPP_TRACES")) else { return };
        let number = NUMBER.fetch_add(1, Ordering::Relaxed);
        let path = Path::new(&folder).join(format!("{}-{number}", std::process::id()));
        let mut file = BufWriter::new(std::fs::File::create(path).expect("a file"));
        trace.write(&mut file).expect("room for a trace");
    }
}

/// An instance that panics with the reason where the run stops.
#[derive(Clone)]
pub struct Block(pub Rc<RefCell<Traced>>);

impl Block {
    pub fn new<R: Number>(name: &str) -> Self {
        Self(Rc::new(RefCell::new(Traced::new::<R>(name).unwrap_or_else(|e| panic!("{e}")))))
    }

    /// From here on only the end of the run is checked: a trace has none of these outputs.
    pub fn unheld(&self) {
        self.0.borrow_mut().held = false;
    }

    pub fn set(&self, pin: &str, value: f64) {
        self.0.borrow_mut().set(pin, value).unwrap_or_else(|e| panic!("{e}"));
    }

    pub fn set_all(&self, pins: &[(&str, f64)]) {
        for (pin, value) in pins {
            self.set(pin, *value);
        }
    }

    /// Sets `HasX`, and X where it is there.
    pub fn option(&self, pin: &str, value: Option<f64>) {
        self.set(&format!("Has{pin}"), f64::from(value.is_some()));
        if let Some(value) = value {
            self.set(pin, value);
        }
    }

    pub fn call(&self) {
        self.0.borrow_mut().call().unwrap_or_else(|e| panic!("{e}"));
    }

    pub fn get(&self, pin: &str) -> f64 {
        self.0.borrow_mut().get(pin).unwrap_or_else(|e| panic!("{e}"))
    }

    /// Any variable.
    pub fn peek(&self, name: &str) -> f64 {
        self.0.borrow().peek(name).unwrap_or_else(|e| panic!("{e}"))
    }

    /// Any variables, which a trace has too.
    pub fn look(&self, names: &[&str]) -> Vec<f64> {
        let mut one = self.0.borrow_mut();
        names.iter().map(|name| one.look(name).unwrap_or_else(|e| panic!("{e}"))).collect()
    }

    /// Holds what it remembers to what the core does: by pairs of a place in that state and a variable here. What the core has nothing for is
    /// left out.
    pub fn remembers(&self, state: &impl serde::Serialize, pairs: &[(&str, &str)]) {
        let (places, names): (Vec<&str>, Vec<&str>) = pairs.iter().copied().unzip();
        let both = names.iter().zip(remembered(state, &places)).zip(self.look(&names));
        let off = both.filter(|((_, expected), got)| !expected.is_nan() && !same(&[*expected], &[*got]));
        let off: Vec<String> = off.map(|((name, a), b)| format!("{name}: {b:?} instead of {a:?}")).collect();
        assert!(off.is_empty(), "{off:?}");
    }

    pub fn all(&self, pins: &[&str]) -> Vec<f64> {
        pins.iter().map(|pin| self.get(pin)).collect()
    }

    pub fn on(&self, pin: &str) -> bool {
        self.get(pin) != 0.0
    }

    /// The number, or NaN where `has` is FALSE.
    pub fn given(&self, has: &str, pin: &str) -> f64 {
        if self.on(has) { self.get(pin) } else { f64::NAN }
    }
}

/// A row of inputs and the time before it in, a row of outputs out.
pub type Scan = Box<dyn FnMut(&[f64], f64) -> Option<Vec<f64>>>;

/// Parameters of a case, and its inputs with the time before each.
pub struct Case {
    pub name: String,
    pub params: Value,
    pub input: Vec<(f64, Vec<f64>)>,
    /// Output, where the vectors have it.
    pub output: Option<Vec<Value>>,
}

impl Case {
    pub fn param(&self, name: &str) -> Option<f64> {
        self.params.get(name).and_then(Value::as_f64)
    }

    pub fn given(&self, name: &str) -> f64 {
        self.param(name).unwrap_or_else(|| panic!("{}: no {name}", self.name))
    }
}

/// The cases of a file in `vectors/`; null is not a number.
pub fn cases(block: &str) -> Vec<Case> {
    let text = std::fs::read_to_string(home().join(format!("../vectors/{block}.json"))).expect("a file");
    let file: Value = serde_json::from_str(&text).expect("JSON");
    let number = |value: &Value| value.as_f64().unwrap_or(f64::NAN);
    let row = |value: &Value| value.as_array().map_or(vec![number(value)], |row| row.iter().map(number).collect());
    let of = |case: &Value| {
        let input = case["input"].as_array().expect("an array");
        let h = |i: usize| case["h"].as_array().map_or(number(&case["h"]), |steps| number(&steps[i]));
        Case {
            name: format!("{block} {}", case["id"]),
            params: case["params"].clone(),
            input: input.iter().enumerate().map(|(i, value)| (h(i), row(value))).collect(),
            output: case["output"].as_array().cloned(),
        }
    };
    file["cases"].as_array().expect("cases").iter().map(of).collect()
}

/// Values of the core's state at these places, by its JSON; NaN for none. Of a sum that carries its rest, the sum.
pub fn remembered(state: &impl serde::Serialize, places: &[&str]) -> Vec<f64> {
    let state = serde_json::to_value(state).expect("a state");
    let number = |value: &Value| {
        let value = value.get("value").unwrap_or(value);
        value.as_f64().or(value.as_bool().map(|x| f64::from(u8::from(x)))).unwrap_or(f64::NAN)
    };
    places.iter().map(|place| number(state.pointer(place).unwrap_or_else(|| panic!("no {place} in {state}")))).collect()
}

/// Whether two rows are the same to the bit; what is not a number stands for nothing.
pub fn same(a: &[f64], b: &[f64]) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a.to_bits() == b.to_bits() || (a.is_nan() && b.is_nan()))
}

/// Runs both beside each other.
pub fn compare(case: &Case, mut core: Scan, mut block: Scan, with_vectors: bool) {
    for (i, (h, x)) in case.input.iter().enumerate() {
        let (expected, got) = (core(x, *h), block(x, *h));
        let agree = match (&expected, &got) {
            (Some(expected), Some(got)) => same(expected, got),
            (expected, got) => expected.is_none() && got.is_none(),
        };
        assert!(agree, "{}, scan {i}: {got:?} instead of {expected:?} for {x:?}, {h}", case.name);
        if let (true, Some(output), Some(got)) = (with_vectors, &case.output, &got) {
            let number = |value: &Value| value.as_f64().unwrap_or(f64::NAN);
            let row = output[i].as_array().map_or(vec![number(&output[i])], |row| row.iter().map(number).collect());
            // The state of a block comes after the columns of the vectors.
            let got = &got[..row.len().min(got.len())];
            assert!(same(&row, got), "{}, scan {i}: {got:?} instead of {row:?}", case.name);
        }
    }
}

/// Numbers that are drawn, the same at every run (xorshift). With every fourth seed they are eighths: sums of times and of signals then
/// meet bounds exactly.
pub struct Draw(u64, bool);

impl Draw {
    pub fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1, seed.is_multiple_of(4))
    }

    fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    /// 0 to 1.
    pub fn unit(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }

    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        let drawn = low + (high - low) * self.unit();
        if self.1 { ((8.0 * drawn).round() / 8.0).clamp(low, high) } else { drawn }
    }

    pub fn chance(&mut self, share: f64) -> bool {
        self.unit() < share
    }

    pub fn of<T: Copy>(&mut self, all: &[T]) -> T {
        all[(self.next() >> 20) as usize % all.len()]
    }
}
