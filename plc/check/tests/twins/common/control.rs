//! Signals, controller and autotuner once as the core has them and once as the library has them, scan by scan by the pins.
#![allow(dead_code, missing_docs)]

use super::names::given;
use super::{Block, Number};
use glapp_core::auto_tuner::{Found, Phase, Rule};
use glapp_core::modules::{self, Mode, PidSettings, ProcessSim, ProcessSimState};
use glapp_core::status::{AT_HIGH, AT_LOW, BAD, BAD_FF, BAD_LIMITS, BAD_SP, DATA_GAP, NOT_AUTO, Status, WRONG_SIGN};
use glapp_core::{
    AutoTuner, AutoTunerSettings, AutoTunerState, Backlash, BacklashState, Backward, Forward, Noise, NoiseState,
    ParameterError, PhaseLead, PhaseLeadState, Pid, PidState, RateLimit, RateLimitState, Real, Saturation, tuning,
};

/// A block, its inputs and its outputs; `Has?X` is X where Has is TRUE, else NaN. An input without a pin is the test's own.
pub struct Twin {
    pub name: &'static str,
    pub pou: &'static str,
    pub pins: &'static [&'static str],
    pub shown: &'static [&'static str],
}

/// Pins of one scan.
#[derive(Clone, Debug)]
pub struct Row {
    pub pins: &'static [&'static str],
    pub values: Vec<f64>,
}

impl Row {
    pub fn new(twin: &Twin, given: &[(&str, f64)]) -> Self {
        let mut row = Self { pins: twin.pins, values: vec![0.0; twin.pins.len()] };
        row.set_all(given);
        row
    }

    pub fn set_all(&mut self, given: &[(&str, f64)]) {
        for (pin, value) in given {
            self.set(pin, *value);
        }
    }

    fn place(&self, pin: &str) -> usize {
        self.pins.iter().position(|one| *one == pin).unwrap_or_else(|| panic!("no pin {pin}"))
    }

    pub fn set(&mut self, pin: &str, value: f64) {
        let place = self.place(pin);
        self.values[place] = value;
    }

    pub fn option(&mut self, pin: &str, value: Option<f64>) {
        self.set(&format!("Has{pin}"), f64::from(value.is_some()));
        self.set(pin, value.unwrap_or(0.0));
    }

    pub fn get(&self, pin: &str) -> f64 {
        self.values[self.place(pin)]
    }

    pub fn on(&self, pin: &str) -> bool {
        self.get(pin) != 0.0
    }

    pub fn r<R: Real>(&self, pin: &str) -> R {
        R::of(self.get(pin))
    }

    /// The number where it is given, and is not what an open pin holds.
    pub fn given(&self, pin: &str) -> Option<f64> {
        given(self.on(&format!("Has{pin}")).then(|| self.get(pin)), pin)
    }

    pub fn maybe<R: Real>(&self, pin: &str) -> Option<R> {
        self.given(pin).map(R::of)
    }

    pub fn forward<R: Real>(&self, pin: &str) -> Forward<R> {
        Forward::new(self.r(pin), if self.on(&format!("{pin}Bad")) { BAD } else { 0 })
    }

    pub fn back_flags(&self) -> Status {
        let flags = [("BackAtLow", AT_LOW), ("BackAtHigh", AT_HIGH), ("BackNotAuto", NOT_AUTO)];
        flags.iter().filter(|(pin, _)| self.pins.contains(pin) && self.on(pin)).map(|(_, flag)| flag).sum()
    }

    pub fn backward<R: Real>(&self) -> Backward<R> {
        let has = |pin: &str| self.pins.contains(&pin);
        let mut back = Backward { flags: self.back_flags(), ..Backward::default() };
        if has("HasBackLimits") && self.on("HasBackLimits") {
            (back.low, back.high) = (self.r("BackLow"), self.r("BackHigh"));
        }
        if has("BackTracking") {
            back.tracking = self.r("BackTracking");
        }
        back
    }
}

pub const POWER_CUT: &str = "power cut";

/// One scan of the library's block.
pub fn scan(twin: &Twin, block: &Block, row: &Row) -> Vec<f64> {
    for (pin, value) in row.pins.iter().zip(&row.values) {
        if *pin == POWER_CUT {
            if *value != 0.0 {
                block.0.borrow_mut().power_cut();
            }
        } else {
            block.set(pin, *value);
        }
    }
    block.call();
    let show = |pin: &&str| match pin.split_once('?') {
        Some((has, pin)) => block.given(has, pin),
        None => block.get(pin),
    };
    twin.shown.iter().map(show).collect()
}

/// State of a running experiment, in the core and here: always, with a cycle to compare with, in the biased phase.
const REMEMBERED: [&[(&str, &str)]; 3] = [
    &[
        ("/t", "Elapsed.Value"),
        ("/low", "Lowest"),
        ("/high", "Highest"),
        ("/area", "Area.Value"),
        ("/resting", "Resting"),
        ("/x", "LastX"),
        ("/answered", "Answered"),
        ("/half", "HalfTime.Value"),
        ("/period", "CyclePeriod"),
        ("/cycles", "Cycles"),
        ("/alike", "Alike"),
        ("/cycle/t", "SumDuration.Value"),
        ("/cycle/up", "SumUpper.Value"),
        ("/cycle/samples", "Samples"),
        ("/cycle/u", "SumU.Value"),
        ("/cycle/y", "SumY.Value"),
        ("/cycle/u_cos", "SumUCos.Value"),
        ("/cycle/u_sin", "SumUSin.Value"),
        ("/cycle/y_cos", "SumYCos.Value"),
        ("/cycle/y_sin", "SumYSin.Value"),
    ],
    &[
        ("/first/t", "First.Duration"),
        ("/first/samples", "First.Samples"),
        ("/first/u", "First.U"),
        ("/first/y", "First.Y"),
        ("/first/y_cos", "First.YCos"),
        ("/first/y_sin", "First.YSin"),
        ("/sum/t", "Total.Duration"),
        ("/sum/u", "Total.U"),
        ("/sum/y", "Total.Y"),
        ("/sum/u_cos", "Total.UCos"),
        ("/sum/u_sin", "Total.USin"),
        ("/sum/y_cos", "Total.YCos"),
        ("/sum/y_sin", "Total.YSin"),
    ],
    &[("/mean_u", "MeanU"), ("/mean_y", "MeanY"), ("/tangent", "Tangent")],
];

/// An experiment beside the core's, and what both remember of it.
pub struct Experiments<R: Number> {
    state: AutoTunerState<R>,
    pub block: Block,
}

impl<R: Number> Experiments<R> {
    pub fn new() -> Self {
        Self { state: AutoTunerState::default(), block: Block::new::<R>("GlappExperiment") }
    }

    /// Outputs of both in a scan.
    pub fn scan(&mut self, row: &Row) -> (Vec<f64>, Vec<f64>) {
        (experiment_scan(&mut self.state, row), scan(&TWINS[8], &self.block, row))
    }

    pub fn remembers(&self) {
        let phase = self.state.phase;
        if !phase.is_running() {
            return;
        }
        self.block.remembers(&self.state, REMEMBERED[0]);
        if phase != Phase::Waiting {
            self.block.remembers(&self.state, &[("/up", "Up")]);
        }
        if self.block.look(&["Alike"]) != [0.0] {
            self.block.remembers(&self.state, REMEMBERED[1]);
        }
        if phase == Phase::Biased {
            self.block.remembers(&self.state, REMEMBERED[2]);
        }
    }
}

pub const TWINS: [Twin; 9] = [
    Twin {
        name: "noise",
        pou: "GlappNoise",
        pins: &["Clear", "Seed", "Amplitude", "X", "XBad"],
        shown: &["Y", "YBad", "Drawn", "Error", "ErrorID"],
    },
    Twin {
        name: "backlash",
        pou: "GlappBacklash",
        pins: &["Clear", "HasStart", "Start", "D", "X", "XBad"],
        shown: &["Y", "YBad", "Error", "ErrorID"],
    },
    Twin {
        name: "saturation",
        pou: "GlappSaturation",
        pins: &["Low", "High", "X", "XBad", "BackAtLow", "BackAtHigh", "HasBackLimits", "BackLow", "BackHigh"],
        shown: &["Y", "YBad", "AtLow", "AtHigh", "NarrowLow", "NarrowHigh", "Error", "ErrorID"],
    },
    Twin {
        name: "rate_limit",
        pou: "GlappRateLimit",
        pins: &["Clear", "Rate", "X", "XBad", "H", "BackAtLow", "BackAtHigh"],
        shown: &["Y", "YBad", "AtLow", "AtHigh", "Error", "ErrorID"],
    },
    Twin {
        name: "phase_lead",
        pou: "GlappPhaseLead",
        pins: &["Clear", "Lead", "Lag", "X", "XBad", "H", "BackNotAuto", "BackTracking"],
        shown: &["Y", "YBad", "Error", "ErrorID"],
    },
    Twin {
        name: "process_sim",
        pou: "GlappProcessSim",
        pins: &["Clear", "Start", "Gain", "T1", "T2", "DeadTime", "H", "X", "XBad", "Load", "LoadBad"],
        shown: &["Y", "YBad", "YNext", "Error", "ErrorID"],
    },
    Twin {
        name: "pid",
        pou: "GlappPidLaw",
        pins: &["HasU", "U", "K", "Ti", "Td", "B", "HasLimits", "Low", "High", "Ysp", "Yf", "H"],
        shown: &["Output"],
    },
    Twin {
        name: "pid_module",
        pou: "GlappPid",
        pins: &[
            POWER_CUT, "Enable", "Reset", "Restart", "Start", "H", "Pv", "PvBad", "Sp", "SpBad", "Ff", "FfBad", "Mode",
            "HasOwnSp", "OwnSp", "HasManualOutput", "ManualOutput", "BackAtLow", "BackAtHigh", "BackNotAuto",
            "BackTracking", "HasBackLimits", "BackLow", "BackHigh", "K", "Ti", "Td", "B", "C", "Tf", "HasLow", "Low",
            "HasHigh", "High", "HasRate", "Rate", "HasMaxH", "MaxH",
        ],
        shown: &[
            "Valid", "Error", "ErrorID", "Output", "Ysp", "Yf", "Bad", "Gap", "BadSp", "BadFf", "BadLimits", "AtLow",
            "AtHigh", "NotAuto", "SpAtLow", "SpAtHigh", "SpNotAuto", "SpTracking", "FfAtLow", "FfAtHigh", "FfNotAuto",
            "FfTracking",
        ],
    },
    Twin {
        name: "auto_tuner",
        pou: "GlappExperiment",
        pins: &[
            "Starts",
            "OpBefore",
            "Take",
            "Pv",
            "H",
            "Bad",
            "Gap",
            "NotAuto",
            "AtLow",
            "AtHigh",
            "Used.Amplitude",
            "Used.HasRelayHysteresis",
            "Used.RelayHysteresis",
            "Used.D",
            "Used.WaitTime",
            "Used.Longest",
            "Used.MaxH",
            "Used.PvLow",
            "Used.PvHigh",
            "Used.OpLow",
            "Used.OpHigh",
        ],
        shown: &[
            "Output", "Phase", "StopReason", "RelayHysteresis", "Bias", "HasFound?Ku", "HasFound?Tu", "HasKp?Kp",
            "HasKappa?Kappa", "Centre",
        ],
    },
];

pub const AUTO_TUNER: Twin = Twin {
    name: "auto_tuner_module",
    pou: "GlappAutoTuner",
    pins: &[
        POWER_CUT, "Enable", "Reset", "Restart", "Execute", "H", "X", "XBad", "Pv", "PvBad", "BackAtLow", "BackAtHigh",
        "BackNotAuto", "BackTracking", "Amplitude", "HasRelayHysteresis", "RelayHysteresis", "D", "WaitTime",
        "Longest", "MaxH", "PvLow", "PvHigh", "OpLow", "OpHigh", "Rule",
    ],
    shown: &[
        "Valid", "Error", "ErrorID", "Y", "YBad", "AtLow", "AtHigh", "NotAuto", "Tracking", "Busy", "Phase",
        "StopReason", "UsedHysteresis", "Bias", "HasFound?Ku", "HasFound?Tu", "HasKp?Kp", "HasKappa?Kappa",
        "HasOffer?OfferK", "HasOffer?OfferTi", "HasOffer?OfferTd",
    ],
};

pub type Core = Box<dyn FnMut(&Row) -> Vec<f64>>;

pub fn on(x: bool) -> f64 {
    u8::from(x).into()
}

pub fn number(error: &ParameterError) -> f64 {
    error.number().unwrap_or_else(|| panic!("{} has no number", error.name)).into()
}

/// Takes a set that is good; gives the number of what is wrong with one that is not.
pub fn checked<B>(good: &mut Option<B>, set: Result<B, ParameterError>) -> f64 {
    match set {
        Ok(block) => {
            *good = Some(block);
            0.0
        }
        Err(error) => number(&error),
    }
}

/// The core's block.
pub fn core<R: Number>(twin: &Twin) -> Core {
    match twin.name {
        "noise" => noise::<R>(),
        "backlash" => backlash::<R>(),
        "saturation" => saturation::<R>(),
        "rate_limit" => rate_limit::<R>(),
        "phase_lead" => phase_lead::<R>(),
        "process_sim" => process_sim::<R>(),
        "pid" => pid_law::<R>(),
        "pid_module" => {
            let mut reference = PidReference::<R>::default();
            Box::new(move |row| reference.scan(row))
        }
        "auto_tuner" => experiment::<R>(),
        "auto_tuner_module" => {
            let mut reference = TunerReference::<R>::default();
            Box::new(move |row| reference.scan(row))
        }
        "pid_advanced" => {
            let mut reference = super::advanced::Reference::<R>::default();
            Box::new(move |row| reference.scan(row).row)
        }
        other => panic!("{other}"),
    }
}

fn noise<R: Number>() -> Core {
    let (mut good, mut state, mut shown) = (None::<Noise<R>>, None, [0.0; 2]);
    Box::new(move |row| {
        let error = checked(&mut good, Noise::new(row.r("Amplitude")));
        if row.on("Clear") || state.is_none() {
            state = Some(NoiseState { integer: row.get("Seed") as i32 });
        }
        let state = state.as_mut().unwrap();
        if let Some(noise) = &good {
            let y = noise.forward(state, row.forward("X"));
            shown = [y.value.as_f64(), on(!y.is_good())];
        }
        vec![shown[0], shown[1], state.integer.into(), on(error != 0.0), error]
    })
}

fn backlash<R: Number>() -> Core {
    let (mut good, mut state, mut shown) = (None::<Backlash<R>>, BacklashState::default(), [0.0; 2]);
    Box::new(move |row| {
        if row.on("Clear") {
            state = BacklashState::default();
        }
        if let (Some(start), false) = (row.maybe::<R>("Start").filter(|start| start.is_number()), state.started) {
            state = BacklashState::at(start);
            shown[0] = start.as_f64();
        }
        let error = checked(&mut good, Backlash::new(row.r("D")));
        if let Some(gap) = &good {
            let y = gap.forward(&mut state, row.forward("X"));
            shown = [y.value.as_f64(), on(!y.is_good())];
        }
        vec![shown[0], shown[1], on(error != 0.0), error]
    })
}

fn saturation<R: Number>() -> Core {
    let (mut good, mut shown) = (None::<Saturation<R>>, [0.0; 6]);
    Box::new(move |row| {
        let error = checked(&mut good, Saturation::new(row.r("Low"), row.r("High")));
        if let Some(limits) = &good {
            let x = row.forward("X");
            let y = limits.forward(x);
            let backward = limits.backward(x.value, row.backward());
            let flags = [backward.flags & AT_LOW, backward.flags & AT_HIGH].map(|flag| on(flag != 0));
            shown =
                [y.value.as_f64(), on(!y.is_good()), flags[0], flags[1], backward.low.as_f64(), backward.high.as_f64()];
        }
        [&shown[..], &[on(error != 0.0), error]].concat()
    })
}

fn rate_limit<R: Number>() -> Core {
    let (mut good, mut state, mut shown) = (None::<RateLimit<R>>, RateLimitState::default(), [0.0; 4]);
    Box::new(move |row| {
        if row.on("Clear") {
            state = RateLimitState::default();
        }
        let error = checked(&mut good, RateLimit::new(row.r("Rate")));
        if let Some(limit) = &good {
            let x = row.forward("X");
            let y = limit.forward(&mut state, x, row.r("H"));
            let backward = limit.backward(&state, x.value, row.backward());
            let flags = [backward.flags & AT_LOW, backward.flags & AT_HIGH].map(|flag| on(flag != 0));
            shown = [y.value.as_f64(), on(!y.is_good()), flags[0], flags[1]];
        }
        [&shown[..], &[on(error != 0.0), error]].concat()
    })
}

fn phase_lead<R: Number>() -> Core {
    let (mut good, mut state, mut shown) = (None::<PhaseLead<R>>, PhaseLeadState::default(), [0.0; 2]);
    Box::new(move |row| {
        if row.on("Clear") {
            state = PhaseLeadState::default();
        }
        let error = checked(&mut good, PhaseLead::new(row.r("Lead"), row.r("Lag")));
        if let Some(lead) = &good {
            let y = lead.forward(&mut state, row.forward("X"), row.r("H"));
            lead.backward(&mut state, row.backward());
            shown = [y.value.as_f64(), on(!y.is_good())];
        }
        vec![shown[0], shown[1], on(error != 0.0), error]
    })
}

fn process_sim<R: Number>() -> Core {
    let (mut good, mut state, mut shown, mut gain) = (None::<ProcessSim<R, 64>>, None, [0.0; 3], R::ONE);
    Box::new(move |row| {
        let of = |pin| row.r::<R>(pin);
        let error = checked(&mut good, ProcessSim::new(of("Gain"), of("T1"), of("T2"), of("DeadTime"), of("H")));
        gain = if error == 0.0 { of("Gain") } else { gain };
        if good.is_some() && (row.on("Clear") || state.is_none()) {
            let start = if of("Start").is_number() { of("Start") / gain } else { R::ZERO };
            state = Some(ProcessSimState::at_rest(start));
        }
        if let (Some(process), Some(state)) = (&good, &mut state) {
            let y = process.output(state);
            process.forward(state, row.forward("X"), row.forward("Load"));
            shown = [y.value.as_f64(), on(!y.is_good()), process.output(state).value.as_f64()];
        }
        [&shown[..], &[on(error != 0.0), error]].concat()
    })
}

fn pid_law<R: Number>() -> Core {
    let mut state = PidState::default();
    Box::new(move |row| {
        let of = |pin| row.r::<R>(pin);
        let limits =
            if row.on("HasLimits") { Saturation::new(of("Low"), of("High")).unwrap() } else { Saturation::none() };
        let law = Pid::new(of("K"), of("Ti"), of("Td"), of("B"), limits).unwrap();
        let u = match row.maybe("U") {
            Some(u) => law.track(&mut state, of("Ysp"), of("Yf"), u, of("H")),
            None => law.update(&mut state, of("Ysp"), of("Yf"), of("H")),
        };
        vec![u.as_f64()]
    })
}

/// The settings of a controller by its pins; an open pin is no limit.
pub fn pid_settings<R: Number>(row: &Row) -> PidSettings<R> {
    let of = |pin: &str| row.r::<R>(pin);
    PidSettings {
        b: of("B"),
        c: of("C"),
        tf: of("Tf"),
        low: row.maybe("Low").unwrap_or(-R::LARGEST),
        high: row.maybe("High").unwrap_or(R::LARGEST),
        rate: row.maybe("Rate").unwrap_or(R::LARGEST),
        max_h: row.maybe("MaxH").unwrap_or(of("Ti") / R::of(2.0)),
        ..PidSettings::ideal(of("K"), of("Ti"), of("Td"))
    }
}

/// Mode, setpoint and manual output, where the pins give them.
pub fn set_by_hand<R: Number>(row: &Row, state: &mut modules::PidState<R>) {
    if let Some(mode) = Mode::ALL.get(row.get("Mode") as usize).filter(|_| row.get("Mode") >= 0.0) {
        state.mode = *mode;
    }
    state.sp = row.maybe("OwnSp").unwrap_or(state.sp);
    state.manual = row.maybe("ManualOutput").unwrap_or(state.manual);
}

/// Backward signals of setpoint and feed-forward before the first scan: the output is not in automatic.
pub fn nobody<R: Number>(output: R) -> [Backward<R>; 2] {
    let nobody = Backward { flags: NOT_AUTO, ..Backward::default() };
    [nobody, Backward { tracking: output, ..nobody }]
}

/// Whether the settings of the scan are good, and the first of them that is not.
pub fn judged(row: &Row, error: f64) -> Vec<f64> {
    vec![on(row.on("Enable") && error == 0.0), on(error != 0.0), error]
}

/// The outputs of a controller.
pub fn pid_shown<R: Number>(
    row: &Row,
    error: f64,
    output: R,
    state: &modules::PidState<R>,
    backward: &[Backward<R>; 2],
) -> Vec<f64> {
    let mut shown = judged(row, error);
    shown.extend([output, glapp_core::Sum::value(state.ysp), state.yf].map(R::as_f64));
    shown.extend([BAD, DATA_GAP, BAD_SP, BAD_FF, BAD_LIMITS].map(|flag| on(state.error & flag != 0)));
    let of = |flags: Status| [AT_LOW, AT_HIGH, NOT_AUTO].map(|flag| on(flags & flag != 0));
    shown.extend(of(state.flags));
    for backward in backward {
        shown.extend(of(backward.flags));
        shown.push(backward.tracking.as_f64());
    }
    shown
}

/// Reference of the controller.
struct PidReference<R: Number> {
    state: Option<modules::PidState<R>>,
    good: Option<modules::Pid<R>>,
    missed: bool,
    seen_h: bool,
    /// Backward signals of setpoint and feed-forward.
    backward: [Backward<R>; 2],
}

impl<R: Number> Default for PidReference<R> {
    fn default() -> Self {
        Self { state: None, good: None, missed: false, seen_h: false, backward: [Backward::default(); 2] }
    }
}

impl<R: Number> PidReference<R> {
    fn begin(&mut self, output: R) -> modules::PidState<R> {
        *self = Self { backward: nobody(output), ..Self::default() };
        modules::PidState::at(output)
    }

    fn scan(&mut self, row: &Row) -> Vec<f64> {
        let of = |pin| row.r::<R>(pin);
        let start = if of("Start").is_number() { of("Start") } else { R::ZERO };
        let mut state = match self.state {
            Some(_) | None if row.on("Reset") || self.state.is_none() => self.begin(start),
            Some(state) if row.on("Restart") || row.on(POWER_CUT) => self.begin(state.output),
            Some(state) => state,
            None => unreachable!(),
        };
        self.seen_h |= of("H") != R::ZERO;
        let mut error = checked(&mut self.good, modules::Pid::new(pid_settings(row)));
        if error == 0.0 && !self.seen_h {
            error = 12.0;
        }
        match &self.good {
            Some(pid) if row.on("Enable") => {
                let mut h = of("H");
                if core::mem::take(&mut self.missed) {
                    state.missed();
                    h = -R::ONE;
                }
                set_by_hand(row, &mut state);
                pid.forward(&mut state, row.forward("Pv"), row.forward("Sp"), row.forward("Ff"), h);
                let (sp, ff) = pid.backward(&mut state, row.backward());
                self.backward = [sp, ff];
            }
            _ => self.missed = true,
        }
        self.state = Some(state);
        assert_eq!(state.error & WRONG_SIGN, 0);
        pid_shown(row, error, state.output, &state, &self.backward)
    }
}

pub fn found_row<R: Real>(found: Option<Found<R>>) -> [f64; 4] {
    let unknown = f64::NAN;
    let or_nan = |x: Option<R>| x.map_or(unknown, R::as_f64);
    found.map_or([unknown; 4], |f| [f.ku.as_f64(), f.tu.as_f64(), or_nan(f.kp), or_nan(f.kappa)])
}

/// The rule that a pin names.
pub fn rule_of(row: &Row) -> Option<Rule> {
    Rule::ALL.into_iter().find(|rule| f64::from(*rule as u8) == row.get("Rule"))
}

/// Settings that an experiment offers by the rule of this scan, in force or not; an invalid rule offers nothing.
pub fn offered<R: Number>(row: &Row, e: &AutoTunerState<R>) -> [f64; 3] {
    let offer = match (e.phase, e.found, rule_of(row)) {
        (Phase::Done, Some(found), Some(rule)) => found.by(rule).ok(),
        _ => None,
    };
    offer.map_or([f64::NAN; 3], |tuning::Gains { k, ti, td }| [k, ti, td].map(R::as_f64))
}

fn tuner_settings<R: Number>(row: &Row, within: &str) -> AutoTunerSettings<R> {
    let of = |pin: &str| row.r::<R>(&format!("{within}{pin}"));
    AutoTunerSettings {
        amplitude: of("Amplitude"),
        relay_hysteresis: match within {
            "" => row.maybe("RelayHysteresis"),
            _ => row.on(&format!("{within}HasRelayHysteresis")).then(|| of("RelayHysteresis")),
        },
        d: of("D"),
        wait: of("WaitTime"),
        longest: of("Longest"),
        max_h: of("MaxH"),
        pv: (of("PvLow"), of("PvHigh")),
        op: (of("OpLow"), of("OpHigh")),
    }
}

fn experiment<R: Number>() -> Core {
    let mut s = AutoTunerState::<R>::default();
    Box::new(move |row| experiment_scan(&mut s, row))
}

fn experiment_scan<R: Number>(s: &mut AutoTunerState<R>, row: &Row) -> Vec<f64> {
    let tuner = AutoTuner::new(tuner_settings(row, "Used.")).unwrap();
    if row.on("Starts") {
        tuner.start(s, row.r("OpBefore"));
    }
    let flags = [("Bad", BAD), ("Gap", DATA_GAP), ("NotAuto", NOT_AUTO), ("AtLow", AT_LOW), ("AtHigh", AT_HIGH)];
    let flags = flags.iter().filter(|(pin, _)| row.on(pin)).map(|(_, flag)| flag).sum();
    let op = tuner.update(s, row.r("Pv"), row.r("H"), flags);
    let shown =
        [op.as_f64(), f64::from(s.phase as u8), f64::from(s.stop as u8), s.relay_hysteresis.as_f64(), s.bias.as_f64()];
    [&shown[..], &found_row(s.found), &[s.centre.as_f64()]].concat()
}

/// Reference of the autotuner.
struct TunerReference<R: Number> {
    state: modules::AutoTunerState<R>,
    good: Option<modules::AutoTuner<R>>,
    seen_h: bool,
    run_before: bool,
}

impl<R: Number> Default for TunerReference<R> {
    fn default() -> Self {
        Self { state: modules::AutoTunerState::default(), good: None, seen_h: false, run_before: true }
    }
}

impl<R: Number> TunerReference<R> {
    fn scan(&mut self, row: &Row) -> Vec<f64> {
        if row.on("Reset") || row.on("Restart") || row.on(POWER_CUT) {
            *self = Self::default();
        }
        self.seen_h |= row.r::<R>("H") != R::ZERO;
        let mut error = checked(&mut self.good, modules::AutoTuner::new(tuner_settings(row, "")));
        if error == 0.0 && !self.seen_h {
            error = 12.0;
        }
        let s = &mut self.state;
        let run = row.on("Enable") && row.on("Execute") && self.good.is_some();
        s.run = run && (s.run || !self.run_before);
        self.run_before = row.on("Execute");
        let (x, back) = (row.forward("X"), row.backward());
        let (y, backward) = match &self.good {
            Some(tuner) => (tuner.forward(s, x, row.forward("Pv"), row.r("H")), tuner.backward(s, back)),
            None => (x, back),
        };
        let e = &s.experiment;
        let mut shown = judged(row, error);
        shown.extend([y.value.as_f64(), on(!y.is_good())]);
        shown.extend([AT_LOW, AT_HIGH, NOT_AUTO].map(|flag| on(backward.flags & flag != 0)));
        shown.extend([backward.tracking.as_f64(), on(e.phase.is_running())]);
        shown.extend([f64::from(e.phase as u8), f64::from(e.stop as u8), e.relay_hysteresis.as_f64(), e.bias.as_f64()]);
        shown.extend(found_row(e.found));
        shown.extend(offered(row, e));
        shown
    }
}

/// The units that the random sequences of these blocks have to go all ways through.
pub const POUS: [&str; 18] = [
    "GlappIntegral", "GlappNoise", "GlappBacklash", "GlappSaturation", "GlappRateLimit", "GlappRamp", "GlappPhaseLead",
    "GlappProcessSim", "GlappPidLaw", "GlappPidCheck", "GlappPid", "GlappExperiment", "GlappAutoTuner",
    "GlappAutoTunerCheck", "GlappPointPlacement", "GlappAmigoFrequency", "GlappRoot", "GlappCyclePower",
];

/// Conditions in `GlappPid` and `GlappAutoTuner` that only `GlappPidAdvanced` asks both ways.
pub const INSIDE: [&str; 6] = [
    "IF Inner.Forth THEN",
    "IF Inner.Back AND",
    "IF Inner.Checked THEN",
    "IF Inner.SpRate > 0.0 THEN",
    "IF Steps THEN",
    "IF First THEN",
];
