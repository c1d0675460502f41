//! The controller with the detection inside, as the core has it: settings checked at every scan, Enable, Reset, Restart, a power cut.
#![allow(dead_code, missing_docs)]

use super::blocks::{record_of, record_row};
use super::compensate::{Settings, is_withdrawn};
use super::control::{
    self, POWER_CUT, Row, Twin, checked, found_row, nobody, number, offered, on, pid_settings, pid_shown, rule_of,
    set_by_hand,
};
use super::detection::{Shown, restarted, shown_by, shown_of};
use super::{Block, Number};
use glapp_core::modules::{AutoTunerState, Gains, PidAdvanced, PidAdvancedSettings, PidAdvancedState, SCHEDULE_ROWS};
use glapp_core::{AutoTunerSettings, Backward, Saturation, Sum};

/// Twin of the whole block: its pins, and its outputs of the controller and the autotuner; the outputs of the detection
/// come after these.
pub const PID_ADVANCED: Twin = Twin {
    name: "pid_advanced",
    pou: "GlappPidAdvanced",
    pins: &[
        POWER_CUT, "Enable", "Reset", "Restart", "Compensate", "Execute", "Cut", "Start", "H", "Pv", "PvBad", "Sp",
        "SpBad", "Ff", "FfBad", "Mode", "HasOwnSp", "OwnSp", "HasManualOutput", "ManualOutput", "BackAtLow",
        "BackAtHigh", "BackNotAuto", "BackTracking", "HasBackLimits", "BackLow", "BackHigh", "K", "Ti", "Td", "B", "C",
        "Tf", "HasLow", "Low", "HasHigh", "High", "HasRate", "Rate", "HasMaxH", "MaxH", "HasKp", "Kp", "HasPvSpan",
        "PvSpan", "HasOpSpan", "OpSpan", "Integrating", "HasDetectorTf", "DetectorTf", "N", "HasSpRate", "SpRate",
        "ScheduleBy", "ScheduleByBad", "Rows", "At1", "K1", "Ti1", "Td1", "At2", "K2", "Ti2", "Td2", "At3", "K3",
        "Ti3", "Td3", "At4", "K4", "Ti4", "Td4", "At5", "K5", "Ti5", "Td5", "At6", "K6", "Ti6", "Td6", "At7", "K7",
        "Ti7", "Td7", "At8", "K8", "Ti8", "Td8", "HasCompensation", "Way", "Source", "Size", "Share", "HasMaxWidth",
        "MaxWidth", "HasBand", "Band", "OpTf", "HasFfRate", "FfRate", "HasRampTime", "RampTime", "HasRelease",
        "Release", "HasTravel", "Travel", "HasReversals", "Reversals", "HasWatch", "Watch", "Withdraw",
        "ReduceByEstimate", "Contradicted", "HasTuner", "Amplitude", "HasRelayHysteresis", "RelayHysteresis", "D",
        "WaitTime", "Longest", "PvLow", "PvHigh", "Rule",
    ],
    shown: &[
        "Valid", "Error", "ErrorID", "Output", "Ysp", "Yf", "Bad", "Gap", "BadSp", "BadFf", "BadLimits", "AtLow",
        "AtHigh", "NotAuto", "SpAtLow", "SpAtHigh", "SpNotAuto", "SpTracking", "FfAtLow", "FfAtHigh", "FfNotAuto",
        "FfTracking", "Busy", "Phase", "StopReason", "UsedHysteresis", "Bias", "HasFound?Ku", "HasFound?Tu",
        "HasFoundKp?FoundKp", "HasKappa?Kappa", "HasOffer?OfferK", "HasOffer?OfferTi", "HasOffer?OfferTd",
    ],
};

/// A row with the defaults of its pins, and these.
pub fn row(given: &[(&str, f64)]) -> Row {
    let usual =
        ["Enable", "Mode", "B", "Share", "Source", "Withdraw", "ReduceByEstimate", "Rule"].map(|pin| (pin, 1.0));
    let mut row = Row::new(&PID_ADVANCED, &usual);
    row.set_all(&[("N", 9.0), ("Way", 3.0)]);
    row.set_all(given);
    row
}

pub const ROWS: [[&str; 4]; SCHEDULE_ROWS] = [
    ["At1", "K1", "Ti1", "Td1"],
    ["At2", "K2", "Ti2", "Td2"],
    ["At3", "K3", "Ti3", "Td3"],
    ["At4", "K4", "Ti4", "Td4"],
    ["At5", "K5", "Ti5", "Td5"],
    ["At6", "K6", "Ti6", "Td6"],
    ["At7", "K7", "Ti7", "Td7"],
    ["At8", "K8", "Ti8", "Td8"],
];

/// Pins of a compensation, from those of `compensate`.
pub fn set_compensation(row: &mut Row, settings: &Settings) {
    row.set_all(&[("HasCompensation", 1.0), ("Way", settings.way.into()), ("Source", settings.source.into())]);
    row.set_all(&[("Size", settings.size), ("Share", settings.share), ("OpTf", settings.tf)]);
    row.set_all(&[
        ("Withdraw", on(settings.withdraw)),
        ("ReduceByEstimate", on(settings.lessen)),
        ("Contradicted", on(settings.contradicted)),
    ]);
    for (pin, value) in [
        ("MaxWidth", settings.most),
        ("Band", settings.band),
        ("FfRate", settings.rate),
        ("RampTime", settings.ramp_time),
        ("Release", settings.release),
        ("Travel", settings.travel),
        ("Reversals", settings.reversals),
        ("Watch", settings.watch),
    ] {
        row.option(pin, value);
    }
}

/// The compensation beside a controller with K and Ti, by which it has its defaults.
fn compensation(row: &Row, k: f64, ti: f64) -> Settings {
    let option = |pin: &str| row.given(pin);
    Settings {
        k,
        ti,
        way: row.get("Way") as i16,
        source: row.get("Source") as i16,
        size: row.get("Size"),
        share: row.get("Share"),
        most: option("MaxWidth"),
        band: option("Band"),
        tf: row.get("OpTf"),
        rate: option("FfRate"),
        ramp_time: option("RampTime"),
        release: option("Release"),
        travel: option("Travel"),
        reversals: option("Reversals"),
        watch: option("Watch"),
        withdraw: row.on("Withdraw"),
        lessen: row.on("ReduceByEstimate"),
        contradicted: row.on("Contradicted"),
    }
}

fn block<R: Number>(row: &Row) -> Result<PidAdvanced<R>, f64> {
    let of = |pin: &str| row.r::<R>(pin);
    let mut settings = PidAdvancedSettings {
        kp: row.maybe("Kp"),
        pv_span: row.maybe("PvSpan"),
        op_span: row.maybe("OpSpan"),
        integrating: row.on("Integrating"),
        detector_tf: row.maybe("DetectorTf"),
        n: row.get("N").max(0.0) as u32,
        sp_rate: row.maybe("SpRate").unwrap_or(R::LARGEST),
        rows: if row.get("Rows") < 0.0 { usize::MAX } else { row.get("Rows") as usize },
        rule: rule_of(row).unwrap_or_default(),
        ..PidAdvancedSettings::new(pid_settings(row))
    };
    for (to, [at, k, ti, td]) in settings.schedule.iter_mut().zip(ROWS) {
        *to = Gains { at: of(at), k: of(k), ti: of(ti), td: of(td) };
    }
    // Gains that a compensation takes its defaults from.
    let [k, ti, _] = settings.slowest().map(R::as_f64);
    if row.on("HasTuner") {
        settings.tuner = Some(AutoTunerSettings {
            amplitude: of("Amplitude"),
            relay_hysteresis: row.maybe("RelayHysteresis"),
            d: of("D"),
            wait: of("WaitTime"),
            longest: of("Longest"),
            max_h: R::ONE,
            pv: (of("PvLow"), of("PvHigh")),
            op: (R::ZERO, R::ONE),
        });
    }
    if row.on("HasCompensation") {
        match compensation(row, k, ti).core(Saturation::none()) {
            Ok(given) => settings.compensation = Some(given),
            // An error of its way or source comes after the checks before it, and before the autotuner.
            Err(wrong) => {
                let (wait, longest) = (R::ONE, R::of(2.0));
                let pv = (R::ZERO, R::ONE);
                let good = |given| AutoTunerSettings {
                    amplitude: R::ONE,
                    relay_hysteresis: None,
                    d: R::ZERO,
                    wait,
                    longest,
                    pv,
                    ..given
                };
                settings.tuner = settings.tuner.map(good);
                return Err(PidAdvanced::new(settings).err().map_or(wrong, |error| number(&error)));
            }
        }
    }
    PidAdvanced::new(settings).map_err(|error| number(&error))
}

/// Reference of the block.
pub struct Reference<R: Number> {
    pub state: Option<PidAdvancedState<R>>,
    good: Option<PidAdvanced<R>>,
    missed: bool,
    seen_h: bool,
    armed: bool,
    held: bool,
    run_before: bool,
    tuned: bool,
    output: R,
    /// Backward signals of setpoint and feed-forward.
    backward: [Backward<R>; 2],
    pv_filtered: f64,
    u_fb: f64,
}

impl<R: Number> Default for Reference<R> {
    fn default() -> Self {
        Self {
            state: None,
            good: None,
            missed: false,
            seen_h: false,
            armed: false,
            held: false,
            run_before: true,
            tuned: false,
            output: R::ZERO,
            backward: [Backward::default(); 2],
            pv_filtered: 0.0,
            u_fb: f64::NAN,
        }
    }
}

impl<R: Number> Reference<R> {
    fn begin(&mut self, output: R) -> PidAdvancedState<R> {
        *self = Self {
            backward: nobody(output),
            output,
            pv_filtered: self.pv_filtered,
            u_fb: self.u_fb,
            ..Self::default()
        };
        PidAdvancedState::at(output)
    }

    /// Holds the settings of a compensation in force to the core's, and what its block shows of it beside what it is asked.
    pub fn in_force(&self, block: &Block) {
        if let Some(state) = &self.state {
            block.remembers(&state.detection.compensation, &[("/pressed", "FrozenWidth")]);
        }
        if let Some(given) = self.good.as_ref().and_then(|one| one.detection().settings().compensation) {
            super::detection::in_force(block, "DetectionInUse.Compensation", &given);
        }
    }

    /// After power-up, and after Restart: the output, and what the detection keeps.
    fn again(&mut self, before: &PidAdvancedState<R>) -> PidAdvancedState<R> {
        let mut state = self.begin(before.pid.output);
        state.detection = restarted(&before.detection);
        state.detection.detector.set_kp(None);
        self.held = is_withdrawn(&state.detection.compensation);
        state
    }

    pub fn scan(&mut self, row: &Row) -> Shown {
        let of = |pin| row.r::<R>(pin);
        if row.on(POWER_CUT) {
            (self.pv_filtered, self.u_fb) = (0.0, f64::NAN);
        }
        let start = if of("Start").is_number() { of("Start") } else { R::ZERO };
        let mut state = match self.state {
            Some(state) if !row.on("Reset") => {
                if row.on("Restart") || row.on(POWER_CUT) {
                    self.again(&state)
                } else {
                    state
                }
            }
            _ => self.begin(start),
        };
        self.seen_h |= of("H") != R::ZERO;
        self.armed |= !row.on("Compensate");
        let mut error = match block(row) {
            Ok(block) => checked(&mut self.good, Ok(block)),
            Err(wrong) => wrong,
        };
        if error == 0.0 && !self.seen_h {
            error = 12.0;
        }
        state.detection.compensate = row.on("Compensate") && (self.armed || self.held);
        self.held &= state.detection.compensate;
        let last = state.detection.last;
        // An experiment comes to an end before it all stops.
        let runs = row.on("Enable") || state.tuner.experiment.phase.is_running();
        if let Some(block) = &self.good {
            let tunes = block.settings().tuner.is_some();
            if tunes != self.tuned {
                (state.tuner, self.run_before) = (AutoTunerState::default(), true);
            }
            self.tuned = tunes;
            state.tuner.run = tunes && row.on("Enable") && row.on("Execute") && (state.tuner.run || !self.run_before);
            if runs {
                let mut h = of("H");
                if core::mem::take(&mut self.missed) {
                    h = -R::ONE;
                }
                set_by_hand(row, &mut state.pid);
                if row.on("Cut") {
                    state.detection.cut();
                }
                let [pv, sp, ff, by] = ["Pv", "Sp", "Ff", "ScheduleBy"].map(|pin| row.forward(pin));
                self.output = block.forward(&mut state, pv, sp, ff, by, h).value;
                let op = state.pid.feedback() + state.detection.compensation.u_ff.value();
                let (sp, ff) = block.backward(&mut state, row.backward());
                self.backward = [sp, ff];
                self.pv_filtered = state.detection.detector.filtered_pv().as_f64();
                let u_fb = state.detection.u_fb.filter(|_| op.is_measurable());
                self.u_fb = u_fb.map_or(f64::NAN, R::as_f64);
            } else {
                block.pause(&mut state, of("H"));
            }
        }
        self.missed |= !runs || self.good.is_none();
        self.run_before = row.on("Execute");
        self.state = Some(state);
        let mut shown = pid_shown(row, error, self.output, &state.pid, &self.backward);
        let e = &state.tuner.experiment;
        shown.extend([on(e.phase.is_running()), f64::from(e.phase as u8), f64::from(e.stop as u8)]);
        shown.extend([e.relay_hysteresis, e.bias].map(R::as_f64));
        shown.extend(found_row(e.found));
        let scheduled = self.good.as_ref().is_some_and(|block| block.settings().rows > 0);
        shown.extend(if scheduled { [f64::NAN; 3] } else { offered(row, e) });
        let state = &state.detection;
        if let Some(block) = &self.good {
            shown.extend(shown_of(block.detection(), state, self.pv_filtered, self.u_fb));
        }
        let ended = state.last.is_some() && state.last != last;
        Shown { row: shown, last: state.last.map(|last| record_of(&last)), ended }
    }
}

/// One scan of the library's block.
pub fn scan(block: &Block, row: &Row) -> Shown {
    let mut shown = control::scan(&PID_ADVANCED, block, row);
    shown.extend(shown_by(block));
    Shown { row: shown, last: Some(record_row(block)), ended: block.on("Ended") }
}
