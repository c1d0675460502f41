//! Names of pins in tests, and their paths: `Kp` is `Settings.Detector.Kp` of a detection. The core's options are
//! `HasX` beside X in a test; on the pins an X that is not given holds what the pin begins with.
#![allow(dead_code, missing_docs)]

use glapp_plc_check::{Instance, Library, Within};
use std::collections::HashMap;

/// Names that stand in several structures, or that are others here.
const ALIASES: [(&str, &str, &str); 23] = [
    ("GlappPid", "Low", "Settings.Low"),
    ("GlappPid", "High", "Settings.High"),
    ("GlappPidAdvanced", "K", "Settings.Controller.K"),
    ("GlappPidAdvanced", "Ti", "Settings.Controller.Ti"),
    ("GlappPidAdvanced", "Td", "Settings.Controller.Td"),
    ("GlappPidAdvanced", "Low", "Settings.Controller.Low"),
    ("GlappPidAdvanced", "High", "Settings.Controller.High"),
    ("GlappPidAdvanced", "Rate", "Settings.Controller.Rate"),
    ("GlappPidAdvanced", "FfRate", "Settings.Compensation.Rate"),
    ("GlappPidAdvanced", "Kp", "Settings.Kp"),
    ("GlappPidAdvanced", "FoundKp", "Experimented.Kp"),
    ("GlappAutoTuner", "Kp", "Experimented.Kp"),
    ("", "HasCompensation", "Settings.Compensates"),
    ("", "HasTuner", "Settings.Tunes"),
    ("", "HasShown", "WidthFound"),
    ("", "HasWholeShown", "Detected.WholeFound"),
    ("GlappForeignDetection", "Longest", "Settings.LongestDelay"),
    ("GlappAutoTuner", "AtLow", "Told.AtLow"),
    ("GlappAutoTuner", "AtHigh", "Told.AtHigh"),
    ("GlappAutoTuner", "NotAuto", "Told.NotAuto"),
    ("GlappAutoTuner", "Tracking", "Told.Tracking"),
    ("GlappCompensation", "Low", "OpLow"),
    ("GlappCompensation", "High", "OpHigh"),
];

/// Names by which an output says that it is known.
pub const KNOWN: [(&str, &str, &str, f64); 20] = [
    ("HasEstimate", "Estimate.Count", ">", 0.0),
    ("HasWhole", "Whole.Count", ">", 0.0),
    ("HasNoiseFloor", "NoiseFloor", ">=", 0.0),
    ("HasUFb", "UFb", "<", 9e37),
    ("HasCorrected", "Doubt", "=", 0.0),
    ("HasFound", "Ku", "<>", 0.0),
    ("HasFoundKp", "FoundKp", "<>", 0.0),
    ("HasKp", "Kp", "<>", 0.0),
    ("HasKappa", "Kappa", ">=", 0.0),
    ("HasOffer", "OfferK", "<>", 0.0),
    ("HasWidth", "Doubt", "=", 0.0),
    ("HasSigma", "Sigma", ">=", 0.0),
    ("HasTravel", "Travel", ">=", 0.0),
    ("Width.HasKpRange", "Width.KpLow", "<>", 0.0),
    ("Corrected.HasKpRange", "Corrected.KpLow", "<>", 0.0),
    ("Record.HasPreviousDeltaY", "Record.PreviousDeltaY", ">=", 0.0),
    ("Record.HasDHatBefore", "Record.DHatBefore", "<", 9e37),
    ("Record.HasEstimate", "Record.Estimate.Count", ">", 0.0),
    ("Record.HasNoiseFloor", "Record.NoiseFloor", ">=", 0.0),
    ("Record.HasSigma", "Record.Sigma", ">=", 0.0),
];

/// Options whose value is given by two pins.
const PAIRS: [(&str, [&str; 2]); 3] =
    [("HasOpLimits", ["OpLow", "OpHigh"]), ("HasBackLimits", ["BackLow", "BackHigh"]), ("HasLimits", ["Low", "High"])];

/// Value of a pin whose X is not given: its initial one, but for a derivative time, which begins with that of a PI.
pub fn open(pin: &str) -> Option<f64> {
    Some(match pin {
        "Td" | "Tf" | "DetectorTf" | "RelayHysteresis" | "MaxWidth" | "Band" | "RampTime" | "Tolerance" | "Longest"
        | "Previous" => -1.0,
        "Kp" | "PvSpan" | "OpSpan" | "MaxH" | "SpRate" | "Rate" | "FfRate" | "Release" | "Travel" | "Reversals"
        | "Watch" | "OpLow" | "OpHigh" => 0.0,
        "Low" | "BackLow" => -1e38,
        "High" | "BackHigh" | "OwnSp" | "ManualOutput" | "Op" | "Output" | "UFfBack" | "DHat" | "Offered" | "Start"
        | "U" | "Raw" | "Beside" => 1e38,
        _ => return None,
    })
}

/// Value that is given at a pin; the value of an open pin is not.
pub fn given(x: Option<f64>, pin: &str) -> Option<f64> {
    x.filter(|x| Some(*x) != open(pin))
}

/// Place of a value.
#[derive(Clone, Debug)]
pub enum Place {
    Pin(String),
    /// Whether these are given.
    Given(Vec<String>),
    /// Whether an output is known.
    Known(&'static str, &'static str, f64),
}

/// The places of a block's pins.
#[derive(Clone, Debug, Default)]
pub struct Names {
    block: String,
    /// Each with what it begins with.
    paths: Vec<String>,
    begin: Vec<f64>,
    inputs: Vec<bool>,
    types: Vec<&'static str>,
    found: HashMap<String, Place>,
}

impl Names {
    pub fn new(library: &Library, block: &str) -> Self {
        let pin = |parts: &[(String, Within)]| {
            parts[0].1 == Within::Block && parts[1..].iter().all(|(_, within)| *within == Within::Structure)
        };
        let mut instance = Instance::new(library, block).ok();
        let mut names = Self { block: block.into(), ..Self::default() };
        for variable in library.variables(block).into_iter().filter(|one| pin(&one.parts)) {
            let path = variable.path();
            if let Some(one) = &mut instance
                && let Ok(begins) = one.get(&path)
            {
                names.inputs.push(one.set(&path, begins).is_ok());
                names.paths.push(path);
                names.begin.push(begins);
                names.types.push(variable.ty);
            }
        }
        names
    }

    /// BOOL, INT, DINT, REAL or LREAL of a pin.
    pub fn ty(&mut self, name: &str) -> &'static str {
        let Place::Pin(path) = self.place(name) else { return "BOOL" };
        self.paths.iter().position(|one| *one == path).map_or("", |at| self.types[at])
    }

    /// Initial value of a pin.
    pub fn begins(&self, path: &str) -> f64 {
        self.paths.iter().position(|one| one == path).map_or(f64::NAN, |at| self.begin[at])
    }

    pub fn place(&mut self, name: &str) -> Place {
        if let Some(place) = self.found.get(name) {
            return place.clone();
        }
        let place = self.find(name);
        self.found.insert(name.into(), place.clone());
        place
    }

    /// Path of a name that is a pin.
    fn path(&self, name: &str) -> Option<String> {
        if self.paths.iter().any(|path| path == name) {
            return Some(name.into());
        }
        let alias =
            ALIASES.iter().find(|(block, alias, _)| *alias == name && (block.is_empty() || *block == self.block));
        if let Some((_, _, path)) = alias {
            let end = format!(".{path}");
            return self.paths.iter().find(|one| one == path || one.ends_with(&end)).cloned();
        }
        // `SpAtLow` is told to what hands the setpoint over.
        for (begin, pin) in [("Sp", "SpBack"), ("Ff", "FfBack"), ("Back", "Back")] {
            let path = name.strip_prefix(begin).map(|end| format!("{pin}.{end}"));
            if let Some(path) = path.filter(|path| self.paths.contains(path)) {
                return Some(path);
            }
        }
        // `At2` is the level of row 2.
        let row = name.char_indices().last().filter(|(at, last)| last.is_ascii_digit() && *at > 0);
        if let Some((at, last)) = row
            && let Some(path) = self.paths.iter().find(|path| {
                let member = if &name[..at] == "At" { "Level" } else { &name[..at] };
                path.ends_with(&format!("Row{last}.{member}"))
            })
        {
            return Some(path.clone());
        }
        let end = format!(".{name}");
        // Checked settings are shown by their whole path.
        let used = |path: &String| ["Inner.Used.", "Used."].iter().any(|used| path.starts_with(used));
        let all = self.paths.iter().filter(|path| path.ends_with(&end) && (name.starts_with("Used.") || !used(path)));
        let mut all: Vec<&String> = all.collect();
        all.sort_by_key(|path| path.split('.').count());
        all.first().map(|path| (*path).clone())
    }

    fn find(&self, name: &str) -> Place {
        if let Some(path) = self.path(name) {
            return Place::Pin(path);
        }
        if let Some((_, [a, b])) = PAIRS.iter().find(|(pair, _)| *pair == name)
            && let (Some(a), Some(b)) = (self.path(a), self.path(b))
        {
            return Place::Given(vec![a, b]);
        }
        // `Used.HasX` is whether `Used.X` is given.
        let (within, last) = name.rsplit_once('.').map_or(("", name), |(within, last)| (within, last));
        let of =
            last.strip_prefix("Has").map(|of| if within.is_empty() { of.into() } else { format!("{within}.{of}") });
        if let Some(path) = of.and_then(|of| self.path(&of)).filter(|path| self.is_input(path)) {
            return Place::Given(vec![path]);
        }
        match KNOWN.iter().find(|(has, ..)| *has == name) {
            Some((_, pin, test, value)) => Place::Known(pin, test, *value),
            None => Place::Pin(name.into()),
        }
    }

    fn is_input(&self, path: &str) -> bool {
        self.paths.iter().position(|one| one == path).is_some_and(|at| self.inputs[at])
    }
}

/// Whether a number says that what it belongs to is known.
pub fn known(test: &str, value: f64, than: f64) -> bool {
    match test {
        ">" => value > than,
        ">=" => value >= than,
        "<" => value < than,
        "=" => value == than,
        _ => value != than,
    }
}
