//! Detection with compensation, beside a controller of ours and beside another maker's, as the core has it: settings checked at every
//! scan, Enable, Reset, Restart.
#![allow(dead_code, missing_docs)]

use super::blocks::{FLAGS, record_of, record_row};
use super::compensate::{self, Settings, is_withdrawn, named, number};
use super::names::given;
use super::{Block, Draw, Number, detector, same};
use glapp_core::modules::{
    BacklashDetection, BacklashDetectionSettings, BacklashDetectionState, Backward, ForeignDetection,
    ForeignDetectionSettings, ForeignDetectionState, Forward, Read,
};
use glapp_core::status::{AT_HIGH, AT_LOW, BAD, NOT_AUTO};
use glapp_core::{CompensationSettings, Detector, Estimate, Saturation, Sum};

/// Pins of a scan; `detector.op` is the output with u_FF.
#[derive(Clone, Debug)]
pub struct Pins {
    pub detector: detector::Pins,
    pub compensate: bool,
    pub compensation: Option<Settings>,
    pub cut: bool,
    /// Pins of another maker's controller, where it is one.
    pub foreign: Option<Foreign>,
}

#[derive(Clone, Debug)]
pub struct Foreign {
    pub delay: i16,
    pub tolerance: Option<f64>,
    pub longest: Option<f64>,
    pub back: Option<f64>,
}

fn on(x: bool) -> f64 {
    f64::from(u8::from(x))
}

impl Pins {
    pub fn name(&self) -> &'static str {
        if self.foreign.is_some() { "GlappForeignDetection" } else { "GlappBacklashDetection" }
    }

    pub fn set(&self, block: &Block) {
        let d = &self.detector;
        // The detector's pins, of which OP has another name beside a controller of ours.
        d.set_but_op(block);
        block.option(if self.foreign.is_some() { "Op" } else { "Output" }, d.op);
        for (name, flag) in &FLAGS[..4] {
            block.set(name, on(d.flags & flag != 0));
        }
        block.set_all(&[("Compensate", on(self.compensate)), ("HasCompensation", on(self.compensation.is_some()))]);
        if let Some(settings) = &self.compensation {
            settings.set(block);
        }
        match &self.foreign {
            Some(foreign) => {
                block.set("DelayScans", foreign.delay.into());
                block.option("Tolerance", foreign.tolerance);
                block.option("Longest", foreign.longest);
                block.option("UFfBack", foreign.back);
            }
            None => block.set("Cut", on(self.cut)),
        }
    }
}

enum Good<R: Number> {
    None,
    Own(BacklashDetection<R>),
    Foreign(ForeignDetection<R>),
}

pub struct Reference<R: Number> {
    /// Reference with the state of the detection inside.
    pub state: ForeignDetectionState<R>,
    good: Good<R>,
    steps: u8,
    usual_h: R,
    seen_h: bool,
    armed: bool,
    held: bool,
    missed: bool,
    breaks: detector::Breaks,
    pv_filtered: f64,
    u_fb: f64,
}

impl<R: Number> Default for Reference<R> {
    fn default() -> Self {
        Self {
            state: ForeignDetectionState::default(),
            good: Good::None,
            steps: 0,
            usual_h: R::ZERO,
            seen_h: false,
            armed: false,
            held: false,
            missed: true,
            breaks: detector::Breaks::default(),
            pv_filtered: 0.0,
            u_fb: f64::NAN,
        }
    }
}

/// After power-up: detections, estimates and why it was withdrawn.
pub fn restarted<R: Number>(state: &BacklashDetectionState<R>) -> BacklashDetectionState<R> {
    let saved = serde_json::to_value(state).unwrap();
    let mut fresh = serde_json::to_value(BacklashDetectionState::<R>::default()).unwrap();
    fresh["detector"] = serde_json::to_value(R::restarted(&state.detector)).unwrap();
    fresh["compensation"]["withdrawn"] = saved["compensation"]["withdrawn"].clone();
    for name in ["whole", "window", "unfit"] {
        fresh[name] = saved[name].clone();
    }
    for name in ["pairs", "next", "count", "due", "kp", "width"] {
        fresh["correction"][name] = saved["correction"][name].clone();
    }
    serde_json::from_value(fresh).unwrap()
}

impl<R: Number> Reference<R> {
    pub fn power_cut(&mut self) {
        self.restart();
        (self.pv_filtered, self.u_fb, self.breaks.reason) = (0.0, f64::NAN, 0.0);
    }

    fn restart(&mut self) {
        let detection = restarted(&self.state.detection);
        let held = is_withdrawn(&detection.compensation);
        let mut state = ForeignDetectionState::default();
        state.detection = detection;
        *self = Self {
            state,
            held,
            pv_filtered: self.pv_filtered,
            u_fb: self.u_fb,
            breaks: self.breaks.anew(),
            ..Self::default()
        };
    }

    fn checked(&self, pins: &Pins) -> Result<Good<R>, f64> {
        let (d, r) = (&pins.detector, |x: f64| R::of(x));
        if let Some(foreign) = &pins.foreign
            && !(1..=32).contains(&foreign.delay)
        {
            return Err(named("delay"));
        }
        let detector = d.settings(self.usual_h);
        Detector::of(&detector).map_err(|error| number(&error))?;
        if d.max_h().is_none() && self.usual_h <= R::ZERO {
            return Err(named("h"));
        }
        let compensation = match &pins.compensation {
            Some(given) => Some(Settings { k: d.k, ti: d.ti, ..given.clone() }.core(Saturation::none())?),
            None => None,
        };
        let settings = BacklashDetectionSettings { detector, compensation };
        Ok(match &pins.foreign {
            Some(foreign) => Good::Foreign(
                ForeignDetection::new(ForeignDetectionSettings {
                    delay: foreign.delay as u32,
                    tolerance: given(foreign.tolerance, "Tolerance").map(r),
                    longest: given(foreign.longest, "Longest").map(r),
                    ..ForeignDetectionSettings::new(settings)
                })
                .map_err(|error| number(&error))?,
            ),
            None => Good::Own(BacklashDetection::new(settings).map_err(|error| number(&error))?),
        })
    }

    /// One scan: what is shown, and the record that ended.
    pub fn scan(&mut self, pins: &Pins) -> Shown {
        let d = &pins.detector;
        if d.reset {
            *self =
                Self { pv_filtered: self.pv_filtered, u_fb: self.u_fb, breaks: self.breaks.anew(), ..Self::default() };
        } else if d.restart {
            self.restart();
        }
        let h = R::of(d.h);
        if h > R::ZERO && h <= R::of(1e9) && self.steps < 2 {
            self.usual_h = h;
            self.steps += 1;
        }
        self.seen_h |= h != R::ZERO;
        self.armed |= !pins.compensate;
        let mut error = 0.0;
        match self.checked(pins) {
            Ok(good) => {
                self.good = good;
                if !self.seen_h {
                    error = named("h");
                }
            }
            Err(number) => error = number,
        }
        let backward = d.flags & (AT_LOW | AT_HIGH | NOT_AUTO);
        let state = &mut self.state;
        state.detection.compensate = pins.compensate && (self.armed || self.held);
        if !(state.detection.compensate && (d.op.is_some() || !d.enable)) {
            self.held = false;
        }
        let (sp, pv, op) = (R::of(d.sp), R::of(d.pv), d.op.map(R::of));
        let last = state.detection.last;
        let detection = match &self.good {
            Good::None => None,
            Good::Own(block) => {
                let state = &mut state.detection;
                if d.enable {
                    if pins.cut {
                        state.cut();
                    }
                    block.forward(state, Forward::new(sp, d.flags & BAD), Forward::from(pv), h);
                    let back = op.map(|tracking| Backward { flags: backward, tracking, ..Backward::default() });
                    block.backward(state, back);
                } else {
                    block.pause(state, backward, h);
                }
                Some(block)
            }
            Good::Foreign(block) => {
                if d.enable {
                    let back = pins.foreign.as_ref().and_then(|foreign| foreign.back);
                    let u_ff = back.map(|back| Forward::from(R::of(back)));
                    let read = Read { op: op.map(Forward::from), flags: d.flags, u_ff };
                    block.update(state, Forward::from(sp), Forward::from(pv), &read, h);
                } else {
                    block.pause(state, backward, h);
                }
                Some(block.detection())
            }
        };
        let detection = detection.map(|block| (block, &self.state.detection));
        let Some((block, state)) = detection else {
            return Shown { row: vec![0.0, 1.0, error], last: None, ended: false };
        };
        if d.enable {
            let cut = pins.cut && pins.foreign.is_none();
            let h = if cut || self.missed { -R::ONE } else { h };
            self.breaks.scan(h, block.settings().detector.max_h, state.detector.observed().is_some());
            if error == 0.0 {
                error = self.breaks.error();
            }
        } else {
            self.breaks.row = 0;
        }
        self.missed = !d.enable;
        let mut shown = vec![on(d.enable && error == 0.0), on(error != 0.0), error];
        if d.enable {
            self.pv_filtered = state.detector.filtered_pv().as_f64();
            self.u_fb = state.u_fb.filter(|_| op.is_some_and(R::is_measurable)).map_or(f64::NAN, R::as_f64);
        }
        shown.extend(shown_of(block, state, self.pv_filtered, self.u_fb));
        shown.push(self.breaks.reason);
        let ended = state.last.is_some() && state.last != last;
        Shown { row: shown, last: state.last.map(|last| record_of(&last)), ended }
    }
}

/// State of a detection, in the core and here.
const REMEMBERED: [(&str, &str); 18] = [
    ("/unfit", "Unfit"),
    ("/smooth", "Smooth"),
    ("/against", "Against"),
    ("/due", "Due"),
    ("/warning/count", "Over.Count"),
    ("/warning/compensating", "Over.Compensating"),
    ("/sign/sign", "Sign.Sign"),
    ("/sign/op", "Sign.LastOp"),
    ("/sign/begin", "Sign.Start"),
    ("/sign/early", "Sign.Early"),
    ("/sign/farthest", "Sign.Farthest"),
    ("/correction/known", "Correction.Known"),
    ("/correction/count", "Correction.Count"),
    ("/correction/due", "Correction.Due"),
    ("/correction/noise/median", "Correction.Noise.Median"),
    ("/correction/noise/gain", "Correction.Noise.Gain"),
    ("/correction/noise/count", "Correction.Noise.Count"),
    ("/detector/memory/rejected", "Detector.Rejected"),
];

/// The settings of a compensation in force, once as the core has them and once as they stand in a structure of the library's.
pub fn in_force<R: Number>(block: &Block, within: &str, settings: &CompensationSettings<R>) {
    let s = settings;
    let numbers = [
        ("Way", R::of(f64::from(s.way as u8))),
        ("K", s.k),
        ("Source", R::of(f64::from(s.source as u8))),
        ("Size", s.size),
        ("Share", s.share),
        ("MaxWidth", s.limit),
        ("Band", s.band),
        ("Tf", s.tf),
        ("Rate", s.rate),
        ("RampTime", s.ramp_time),
        ("Release", s.release),
        ("Travel", s.travel),
        ("Reversals", s.reversals),
        ("Watch", s.watch),
    ];
    for (name, value) in numbers {
        // Without a limit is 1E37 here.
        let expected = value.lesser(R::of(1e37)).as_f64();
        let got = block.look(&[&format!("{within}.{name}")]);
        assert!(same(&[expected], &got), "{within}.{name}: {got:?} instead of {expected}");
    }
    for (name, value) in [("Withdraw", s.withdraw), ("ReduceByEstimate", s.estimate), ("Contradicted", s.contradicted)]
    {
        assert_eq!(block.look(&[&format!("{within}.{name}")]), [on(value)], "{within}.{name}");
    }
}

impl<R: Number> Reference<R> {
    /// Holds settings in force and what is remembered to the core's; `shown` of the scan before.
    pub fn remembers(&self, block: &Block, pins: &Pins) {
        let (detection, settings, within) = match &self.good {
            Good::None => return,
            Good::Own(one) => ("", one.settings(), "InUse"),
            Good::Foreign(one) => ("Detection.", one.detection().settings(), "Check.Used"),
        };
        if !pins.detector.enable {
            return;
        }
        let names = REMEMBERED.map(|(place, name)| (place, format!("{detection}{name}")));
        let pairs: Vec<(&str, &str)> = names.iter().map(|(place, name)| (*place, name.as_str())).collect();
        block.remembers(&self.state.detection, &pairs);
        // Beside another maker's controller there is always one, which takes away what is there.
        if let (Some(given), true) = (&settings.compensation, pins.compensation.is_some()) {
            in_force(block, &format!("{within}.Compensation"), given);
        }
    }
}

/// Outputs of a running detection.
pub fn shown_of<R: Number>(
    block: &BacklashDetection<R>,
    state: &BacklashDetectionState<R>,
    pv_filtered: f64,
    u_fb: f64,
) -> Vec<f64> {
    let mut shown = vec![];
    let or_nan = |x: Option<R>| x.map_or(f64::NAN, R::as_f64);
    let of = |estimate: Option<Estimate<R>>| match estimate {
        Some(e) => vec![e.value.as_f64(), e.low.as_f64(), e.high.as_f64(), e.kept.into(), e.count.into()],
        None => vec![f64::NAN; 5],
    };
    let c = &state.compensation;
    shown.extend([c.standing as u8 as f64, c.direction.into(), c.u_ff.value().as_f64(), c.half.value().as_f64()]);
    shown.extend([c.size.as_f64(), c.delta.as_f64()]);
    shown.extend([on(state.over.equal), on(state.over.relay), on(state.error() != 0)]);
    shown.extend(of(state.whole));
    shown.push(on(state.shown().is_some()));
    shown.push(block.may_compensate_by_estimate(state).err().map_or(0.0, |unfit| f64::from(unfit as u8)));
    shown.extend(of(state.detector.estimate()));
    shown.push(on(state.detector.shown().is_some()));
    shown.extend([or_nan(state.detector.noise_floor()), state.detector.accepted().into(), pv_filtered, u_fb]);
    match block.corrected(state) {
        Ok(found) => {
            shown.extend([found.d, found.low, found.high, found.kp].map(R::as_f64));
            let range = found.kp_range;
            shown.extend([or_nan(range.map(|range| range.0)), or_nan(range.map(|range| range.1)), 0.0]);
        }
        Err(doubt) => shown.extend([&[f64::NAN; 6][..], &[f64::from(doubt as u8)]].concat()),
    }
    shown
}

/// Outputs of a scan.
#[derive(Debug)]
pub struct Shown {
    pub row: Vec<f64>,
    /// The last record, where one has ended since the power came.
    pub last: Option<Vec<f64>>,
    /// Whether the half-period is a new one.
    pub ended: bool,
}

/// Outputs of the library's block.
pub fn shown_by(block: &Block) -> Vec<f64> {
    let mut row = block.all(&["Standing", "Direction", "UFf", "HalfWidth", "GapWidth", "Delta"]);
    row.extend(block.all(&["Equal", "Relay", "WrongSign"]));
    let parts = ["Value", "Low", "High", "Kept", "Count"];
    row.extend(parts.map(|part| block.given("HasWhole", &format!("Whole.{part}"))));
    row.extend(block.all(&["HasWholeShown", "Unsuited"]));
    row.extend(parts.map(|part| block.given("HasEstimate", &format!("Estimate.{part}"))));
    row.push(block.get("HasShown"));
    row.push(block.given("HasNoiseFloor", "NoiseFloor"));
    row.extend(block.all(&["Accepted", "PvFiltered"]));
    row.push(block.given("HasUFb", "UFb"));
    row.extend(["D", "Low", "High", "Kp"].map(|part| block.given("HasCorrected", &format!("Corrected.{part}"))));
    let range = block.on("HasCorrected") && block.on("Corrected.HasKpRange");
    row.extend(["KpLow", "KpHigh"].map(|part| if range { block.get(&format!("Corrected.{part}")) } else { f64::NAN }));
    row.push(block.get("Doubt"));
    row
}

/// One scan of the library's block.
pub fn scan(block: &Block, pins: &Pins) -> Shown {
    pins.set(block);
    block.call();
    let mut row = block.all(&["Valid", "Error", "ErrorID"]);
    row.extend(shown_by(block));
    row.push(block.get("BreakReason"));
    Shown { row, last: Some(record_row(block)), ended: block.on("Ended") }
}

/// Whether both are the same to the bit.
pub fn agree(expected: &Shown, got: &Shown) -> bool {
    let shared = expected.row.len();
    let last = expected.last.as_ref().is_none_or(|last| got.last.as_ref().is_some_and(|got| same(last, got)));
    same(&expected.row, &got.row[..shared]) && last && (got.ended || !expected.ended)
}

/// A loop that swings about its setpoint with a compensation beside it, and everything that can go wrong with both.
pub struct Loop {
    signals: detector::Loop,
    compensation: Option<Settings>,
    foreign: Option<Foreign>,
    wrong: f64,
    pins: Pins,
    handed: Vec<f64>,
    count: usize,
    asked: usize,
    relay: bool,
    /// A width far beyond the gap: once it is in force, the loop swings evenly, and OP's own travel is small beside it.
    driven: bool,
}

impl Loop {
    pub fn new(draw: &mut Draw, foreign: bool) -> Self {
        let mut signals = detector::Loop::new(draw);
        if draw.chance(0.1) {
            signals.filtered(0.45);
        }
        let mut settings = compensate::drawn(draw);
        settings.band = draw.of(&[None, Some(0.0), Some(0.05)]);
        settings.share = draw.of(&[1.0, 1.0, 0.5]);
        settings.most = None;
        let compensation = draw.chance(0.9).then_some(settings);
        let foreign = foreign.then(|| Foreign {
            delay: draw.of(&[1, 1, 2, 3, 32]),
            tolerance: draw.of(&[None, Some(0.01), Some(0.3)]),
            longest: draw.of(&[None, Some(9.0), Some(9.0), Some(0.1)]),
            back: draw.chance(0.6).then_some(draw.of(&[0.0, 0.0, 0.8])),
        });
        let wrong = draw.of(&[0.0, 0.0, 0.005, 0.02]);
        let (driven, way) = (draw.chance(0.05), draw.of(&[1, 3]));
        let far = Settings { way, size: 2.0, band: Some(0.0), ..Settings::default() };
        let (compensation, wrong) = if driven { (Some(far), 0.0) } else { (compensation, wrong) };
        let pins = Pins {
            detector: signals.pins.clone(),
            compensate: false,
            compensation: compensation.clone(),
            cut: false,
            foreign: foreign.clone(),
        };
        let asked = draw.of(&[5, 60, 150]);
        Self {
            signals,
            compensation,
            foreign,
            wrong,
            pins,
            handed: vec![0.0; 33],
            count: 0,
            asked,
            relay: draw.chance(0.1),
            driven,
        }
    }

    /// The next scan; `u_ff` is what was handed over in the scan before.
    pub fn next<R: Number>(&mut self, draw: &mut Draw, u_ff: f64) -> &Pins {
        self.count += 1;
        self.handed.push(u_ff);
        let delay = self.foreign.as_ref().map_or(1, |foreign| foreign.delay.clamp(1, 32) as usize);
        let there = self.handed[self.handed.len() - delay];
        let p = &mut self.pins;
        p.detector = self.signals.next::<R>(draw).clone();
        let d = &mut p.detector;
        if d.op.is_none() && self.count.is_multiple_of(7) && self.wrong > 0.01 {
            d.op = Some(1.0);
        }
        d.op = d.op.map(|op| if op.abs() < 100.0 { op + there } else { op });
        if self.relay && p.compensate {
            d.op = d.op.map(|_| there);
        }
        if self.driven && p.compensate {
            let side = if (self.count / 5).is_multiple_of(2) { 1.0 } else { -1.0 };
            (d.h, d.sp, d.pv, d.op, d.flags) = (0.25, 0.0, -0.05 * side, Some(there + 0.02 * side), 0);
        }
        if self.foreign.is_none() && d.op.is_none() {
            d.flags &= BAD;
        }
        p.cut = draw.chance(0.2 * self.wrong);
        if self.count == self.asked || draw.chance(0.2 * self.wrong) {
            p.compensate = !p.compensate;
        }
        if draw.chance(0.3 * self.wrong) {
            d.enable = false;
        }
        p.compensation = self.compensation.clone();
        p.foreign = self.foreign.clone();
        if draw.chance(0.3 * self.wrong) {
            p.compensation = None;
        }
        if let (Some(settings), true) = (&mut p.compensation, draw.chance(self.wrong)) {
            match draw.of(&[0, 1, 2]) {
                0 => compensate::spoil(settings, draw),
                1 => settings.contradicted = true,
                _ => *settings = compensate::drawn(draw),
            }
        }
        if let Some(foreign) = &mut p.foreign {
            foreign.back = foreign.back.map(|first| if self.count < 4 { first } else { there });
            if draw.chance(self.wrong) {
                let none = draw.of(&[f64::NAN, f64::INFINITY]);
                match draw.of(&[0, 1, 2, 3, 4, 5]) {
                    0 => foreign.delay = draw.of(&[0, 33, -1, 4]),
                    1 => foreign.tolerance = Some(draw.of(&[-0.1, none])),
                    2 => foreign.longest = Some(draw.of(&[-0.1, none, 1e36])),
                    3 => foreign.back = Some(none),
                    4 => foreign.back = None,
                    _ => foreign.back = Some(draw.between(-1.0, 1.0)),
                }
            }
            if foreign.longest == Some(1e36) {
                p.detector.ti = 100.0;
            }
            if self.wrong > 0.01 && (self.count / 40) % 7 == 3 {
                foreign.back = foreign.back.map(|_| 0.4);
            }
        }
        p
    }
}
