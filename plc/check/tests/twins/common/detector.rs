//! The detector of a controller as the core has it: settings checked at every scan, Enable, Reset, Restart.
#![allow(dead_code, missing_docs)]

use super::blocks::{FLAGS, pascal, record_of, record_row};
use super::names::given;
use super::{Block, Draw, Number};
use glapp_core::status::{BAD, Status};
use glapp_core::{Conditions, Detector, DetectorSettings, DetectorState, PARAMETERS, ParameterError, Reason, Sample};

/// Pins of a scan.
#[derive(Clone, Debug)]
pub struct Pins {
    pub enable: bool,
    pub reset: bool,
    pub restart: bool,
    pub h: f64,
    pub sp: f64,
    pub pv: f64,
    pub op: Option<f64>,
    pub flags: Status,
    pub k: f64,
    pub ti: f64,
    pub td: Option<f64>,
    pub b: f64,
    pub kp: Option<f64>,
    pub pv_span: Option<f64>,
    pub integrating: bool,
    pub tf: Option<f64>,
    pub n: i16,
    pub max_h: Option<f64>,
    pub op_limits: Option<(f64, f64)>,
    pub op_span: Option<f64>,
    pub conditions: Conditions,
}

impl Default for Pins {
    fn default() -> Self {
        Self {
            enable: true,
            reset: false,
            restart: false,
            h: 0.25,
            sp: 0.0,
            pv: 0.0,
            op: None,
            flags: 0,
            k: 0.5,
            ti: 1.0,
            td: None,
            b: 1.0,
            kp: None,
            pv_span: None,
            integrating: false,
            tf: None,
            n: 9,
            max_h: None,
            op_limits: None,
            op_span: None,
            conditions: Conditions::default(),
        }
    }
}

/// Each number that a pin may hold.
pub const NUMBERS: [fn(&mut Pins, f64); 16] = [
    |p, x| p.k = x,
    |p, x| p.ti = x,
    |p, x| p.td = Some(x),
    |p, x| p.b = x,
    |p, x| p.kp = Some(x),
    |p, x| (p.kp, p.pv_span, p.op_span) = (None, Some(x), Some(1.0)),
    |p, x| (p.kp, p.pv_span, p.op_span) = (None, Some(1.0), Some(x)),
    |p, x| p.tf = Some(x),
    |p, x| p.max_h = Some(x),
    |p, x| p.op_limits = Some((x, 5.0)),
    |p, x| p.op_limits = Some((-5.0, x)),
    |p, x| p.op_span = Some(x),
    |p, x| p.sp = x,
    |p, x| p.pv = x,
    |p, x| p.op = Some(x),
    |p, x| p.h = x,
];

impl Pins {
    pub fn set(&self, block: &Block) {
        let on = |x: bool| f64::from(u8::from(x));
        block.option("Op", self.op);
        for (name, flag) in &FLAGS[..4] {
            block.set(name, on(self.flags & flag != 0));
        }
        self.set_but_op(block);
    }

    /// All but OP and the flags.
    pub fn set_but_op(&self, block: &Block) {
        let on = |x: bool| f64::from(u8::from(x));
        block.set_all(&[("Enable", on(self.enable)), ("Reset", on(self.reset)), ("Restart", on(self.restart))]);
        block.set_all(&[("H", self.h), ("Sp", self.sp), ("Pv", self.pv), ("N", self.n.into())]);
        block.set_all(&[("K", self.k), ("Ti", self.ti), ("B", self.b)]);
        let options = [
            ("Td", self.td),
            ("Kp", self.kp),
            ("Tf", self.tf),
            ("MaxH", self.max_h),
            ("OpSpan", self.op_span),
            ("PvSpan", self.pv_span),
        ];
        for (pin, value) in options {
            block.option(pin, value);
        }
        block.set("Integrating", on(self.integrating));
        block.set("HasOpLimits", on(self.op_limits.is_some()));
        if let Some((low, high)) = self.op_limits {
            block.set_all(&[("OpLow", low), ("OpHigh", high)]);
        }
        let mut conditions = self.conditions;
        for name in Conditions::NAMES {
            block.set(&pascal(name), on(*conditions.switch(name).unwrap()));
        }
    }
}

impl Pins {
    /// The longest time between scans, where it is given.
    pub fn max_h(&self) -> Option<f64> {
        given(self.max_h, "MaxH")
    }

    /// Settings of the core, with its defaults; where the usual time between scans is asked and not known, a gap is
    /// above 1 s.
    pub fn settings<R: Number>(&self, usual_h: R) -> DetectorSettings<R> {
        let r = |x: f64| R::of(x);
        let three = R::of(3.0);
        let [td, kp, pv_span, tf, max_h, op_span] = [
            given(self.td, "Td"),
            given(self.kp, "Kp"),
            given(self.pv_span, "PvSpan"),
            given(self.tf, "Tf"),
            self.max_h(),
            given(self.op_span, "OpSpan"),
        ];
        let unknown = max_h.is_none() && usual_h <= R::ZERO;
        DetectorSettings {
            k: r(self.k),
            ti: r(self.ti),
            td: td.map(r),
            b: r(self.b),
            kp: kp.map(r),
            pv_span: pv_span.map(r),
            integrating: self.integrating,
            tf: tf.map_or_else(|| DetectorSettings::filter_time(r(self.ti), r(td.unwrap_or(0.0))), r),
            n: u32::try_from(self.n).unwrap_or(0),
            max_h: if unknown { R::ONE } else { max_h.map_or(three * usual_h, r) },
            op_limits: self.op_limits.filter(|limits| *limits != (0.0, 0.0)).map(|(low, high)| (r(low), r(high))),
            op_span: op_span.map(r),
            conditions: self.conditions,
        }
    }
}

/// Scans in which the signal broke, by the scan's time and by whether the core then waits for a sample that it can use.
#[derive(Clone, Copy, Default)]
pub struct Breaks {
    begun: bool,
    pub row: u32,
    pub reason: f64,
}

impl Breaks {
    pub fn scan<R: Number>(&mut self, h: R, max_h: R, observed: bool) {
        if h == R::ZERO && self.begun {
            return;
        }
        let in_time = h > R::ZERO && h <= max_h;
        self.reason = if !in_time || !self.begun {
            Reason::Gap
        } else if !observed {
            Reason::BadQuality
        } else {
            Reason::Accepted
        } as u8 as f64;
        self.row = if self.reason == 0.0 { 0 } else { self.row + 1 };
        self.begun = true;
    }

    /// A new start, which keeps what is shown.
    pub fn anew(self) -> Self {
        Self { reason: self.reason, ..Self::default() }
    }

    /// What is shown after ten in a row.
    pub fn error(&self) -> f64 {
        match self.reason {
            _ if self.row < 10 => 0.0,
            1.0 => number("h"),
            _ => number("pv"),
        }
    }
}

/// Spoils the signal, or the time, of a scan; one way for each number below 8.
pub fn breaks_off(p: &mut Pins, way: usize) {
    match way {
        0 => p.h = -1.0,
        1 => p.h = 100.0,
        2 => p.h = f64::NAN,
        3 => p.pv = f64::NAN,
        4 => p.sp = f64::INFINITY,
        5 => p.pv = 1e36,
        6 => p.op = p.op.map(|_| f64::NAN),
        _ => p.flags |= BAD,
    }
}

/// Reference of the block.
pub struct Reference<R: Number> {
    state: DetectorState<R>,
    good: Option<(Detector<R>, R)>,
    missed: bool,
    pub breaks: Breaks,
    steps: u8,
    usual_h: R,
    seen_h: bool,
    pv_filtered: f64,
}

impl<R: Number> Default for Reference<R> {
    fn default() -> Self {
        let state = DetectorState::default();
        let breaks = Breaks::default();
        Self { state, good: None, missed: false, breaks, steps: 0, usual_h: R::ZERO, seen_h: false, pv_filtered: 0.0 }
    }
}

fn number(name: &str) -> f64 {
    let place = PARAMETERS.iter().position(|known| *known == name).unwrap();
    (place + 1) as f64
}

impl<R: Number> Reference<R> {
    /// Power goes and comes back; what is shown begins at 0.
    pub fn power_cut(&mut self) {
        self.restart();
        (self.pv_filtered, self.breaks.reason) = (0.0, 0.0);
    }

    fn restart(&mut self) {
        let (state, breaks) = (R::restarted(&self.state), self.breaks.anew());
        *self = Self { state, pv_filtered: self.pv_filtered, breaks, ..Self::default() };
    }

    /// The detector, and the longest time between scans.
    fn checked(&self, pins: &Pins) -> Result<(Detector<R>, R), f64> {
        let settings = pins.settings(self.usual_h);
        let unknown = pins.max_h().is_none() && self.usual_h <= R::ZERO;
        match Detector::of(&settings) {
            Ok(_) if unknown => Err(number("h")),
            Ok(detector) => Ok((detector, settings.max_h)),
            Err(error @ ParameterError { .. }) => Err(error.number().unwrap().into()),
        }
    }

    /// One scan: valid, error, its number; the record that ended; estimate and what is shown.
    pub fn scan(&mut self, pins: &Pins) -> (Vec<f64>, Option<Vec<f64>>) {
        if pins.reset {
            *self = Self { pv_filtered: self.pv_filtered, breaks: self.breaks.anew(), ..Self::default() };
        } else if pins.restart {
            self.restart();
        }
        let h = R::of(pins.h);
        if h > R::ZERO && h <= R::of(1e9) && self.steps < 2 {
            self.usual_h = h;
            self.steps += 1;
        }
        self.seen_h |= h != R::ZERO;
        let mut error = 0.0;
        match self.checked(pins) {
            Ok(good) => {
                self.good = Some(good);
                if !self.seen_h {
                    error = number("h");
                }
            }
            Err(number) => error = number,
        }
        let mut ended = None;
        match self.good {
            Some((detector, max_h)) if pins.enable => {
                let h = if self.missed { -R::ONE } else { h };
                self.missed = false;
                let (sp, pv, op) = (R::of(pins.sp), R::of(pins.pv), pins.op.map(R::of));
                let sample = Sample { h, sp, pv, op, flags: pins.flags };
                ended = detector.update(&mut self.state, &sample).map(|record| record_of(&record));
                self.pv_filtered = self.state.filtered_pv().as_f64();
                self.breaks.scan(h, max_h, self.state.observed().is_some());
                if error == 0.0 {
                    error = self.breaks.error();
                }
            }
            _ => (self.missed, self.breaks.row) = (true, 0),
        }
        let on = |x: bool| f64::from(u8::from(x));
        let estimate = self.state.estimate();
        let or_nan = |x: Option<R>| x.map_or(f64::NAN, R::as_f64);
        let shown = vec![
            on(pins.enable && error == 0.0),
            on(error != 0.0),
            error,
            or_nan(estimate.map(|e| e.value)),
            or_nan(estimate.map(|e| e.low)),
            or_nan(estimate.map(|e| e.high)),
            estimate.map_or(f64::NAN, |e| e.kept.into()),
            estimate.map_or(f64::NAN, |e| e.count.into()),
            or_nan(self.state.noise_floor()),
            on(self.state.shown().is_some()),
            self.state.accepted().into(),
            self.pv_filtered,
            self.breaks.reason,
        ];
        (shown, ended)
    }
}

/// One scan of the library's block.
pub fn scan(block: &Block, pins: &Pins) -> (Vec<f64>, Option<Vec<f64>>) {
    pins.set(block);
    block.call();
    let mut shown = block.all(&["Valid", "Error", "ErrorID"]);
    for part in ["Value", "Low", "High", "Kept", "Count"] {
        shown.push(block.given("HasEstimate", &format!("Estimate.{part}")));
    }
    shown.push(block.given("HasNoiseFloor", "NoiseFloor"));
    shown.extend(block.all(&["HasShown", "Accepted", "PvFiltered", "BreakReason"]));
    (shown, block.on("Ended").then(|| record_row(block)))
}

/// A loop that swings about its setpoint, with everything that can go wrong with it.
pub struct Loop {
    pub pins: Pins,
    size: f64,
    length: usize,
    left: usize,
    side: f64,
    noise: f64,
    shrinks: usize,
    between: usize,
    wrong: f64,
    usual: Pins,
    count: usize,
}

impl Loop {
    pub fn new(draw: &mut Draw) -> Self {
        let ti = draw.between(0.3, 0.8);
        let k = draw.of(&[0.5, 1.0, -0.7, 6.0, 0.1]);
        let op = draw.chance(0.5).then_some(0.0);
        let pins = Pins {
            h: 0.25,
            op,
            k,
            ti,
            td: draw.of(&[None, Some(0.0), Some(0.2)]),
            b: draw.of(&[1.0, 0.0, 0.3]),
            kp: draw.of(&[None, Some(2.0), Some(-2.0), Some(0.14), Some(20.0)]),
            tf: draw.of(&[None, Some(0.0), Some(0.1)]),
            n: draw.of(&[1, 1, 3, 5]),
            max_h: draw.of(&[None, Some(1.0)]),
            op_limits: draw.chance(0.2).then_some((-2.0, 2.5)),
            op_span: draw.chance(0.4).then_some(draw.of(&[1.0, 10.0, 100.0])),
            pv_span: draw.chance(0.3).then_some(draw.of(&[1.0, 30.0])),
            integrating: draw.chance(0.1),
            conditions: conditions(draw),
            ..Pins::default()
        };
        let length = (5.0 * ti / 0.25) as usize + draw.of(&[0, 2, 4, 6]);
        let noise = draw.of(&[0.0, 0.01, 0.03, 0.3]);
        let wrong = draw.of(&[0.0, 0.0, 0.01, 0.05]);
        Self {
            usual: pins.clone(),
            pins,
            size: 1.0,
            length,
            left: length,
            side: 1.0,
            noise,
            shrinks: draw.of(&[100, 150, 1_000_000]),
            between: draw.of(&[0, 0, 2, 3]),
            wrong,
            count: 0,
        }
    }

    /// Sets a filter of that length.
    pub fn filtered(&mut self, tf: f64) {
        (self.pins.tf, self.usual.tf) = (Some(tf), Some(tf));
    }

    /// The next scan.
    pub fn next<R: Number>(&mut self, draw: &mut Draw) -> &Pins {
        self.count += 1;
        let small = self.count > self.shrinks;
        let size = if small { 0.35 * self.size } else { self.size };
        self.left -= 1;
        let mut turned = false;
        if self.left == 0 {
            self.side = -self.side;
            turned = true;
            let short = small && self.between > 0 && !draw.chance(1.0 / (1.0 + self.between as f64));
            self.left = if short { self.length - 4 } else { self.length };
            if draw.chance(0.05) {
                self.size = draw.between(0.2, 3.0);
            }
        }
        let p = &mut self.pins;
        (p.reset, p.restart, p.flags) = (false, false, 0);
        (p.h, p.op) = (0.25, self.usual.op.map(|_| self.side * draw.between(1.0, 2.0)));
        // PV stays in range where SP is out of it: beyond 1E37 the library no longer looks at their difference.
        let about = if p.sp.abs() < 1.0 { p.sp } else { 0.0 };
        p.pv = about - self.side * size + self.noise * draw.between(-1.0, 1.0);
        if self.wrong > 0.0 && draw.chance(0.02) {
            p.sp = draw.between(-0.5, 0.5);
        }
        if draw.chance(0.1) && self.wrong > 0.02 {
            p.h = draw.of(&[0.25, 0.3, 0.5, 0.1]);
        }
        if draw.chance(self.wrong) {
            p.flags = draw.of(&[1, 2, 4, 8, 3, 12, 15]);
        }
        if draw.chance(self.wrong) {
            let bad = draw.of(&[f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e32, -1e32, 1e36]);
            match draw.of(&[0, 1, 2]) {
                0 if p.sp.abs() < 1.0 => p.pv = bad,
                0 | 1 => p.sp = bad,
                _ => p.op = p.op.map(|_| bad),
            }
        }
        if draw.chance(self.wrong) {
            p.h = draw.of(&[0.0, 0.0, -0.25, 5.0, f64::NAN, 1e12, f64::INFINITY]);
        }
        if self.count < 3 && self.wrong > 0.0 {
            p.h = 0.0;
        }
        if turned && draw.chance(self.wrong) {
            p.h = R::SHORTEST;
        }
        if self.wrong > 0.0 && draw.chance(0.1) {
            // Settings come back; sometimes one is changed, or spoilt.
            let kept = (p.h, p.sp, p.pv, p.op, p.flags);
            let sp = if kept.1.abs() < 1.0 { kept.1 } else { 0.0 };
            *p = Pins { sp, ..self.usual.clone() };
            (p.h, p.pv, p.op, p.flags) = (kept.0, kept.2, kept.3, kept.4);
            if draw.chance(0.4) {
                change(p, draw);
            } else if draw.chance(0.5) {
                spoil(p, draw);
            }
            p.enable = !draw.chance(0.05);
            p.reset = draw.chance(0.02);
            p.restart = draw.chance(0.03);
        } else if (p.sp.is_nan() || p.sp.abs() >= 1.0) && draw.chance(0.5) {
            p.sp = 0.0;
        }
        p
    }
}

fn conditions(draw: &mut Draw) -> Conditions {
    let mut conditions = Conditions::default();
    if draw.chance(0.3) {
        let name = draw.of(&Conditions::NAMES);
        *conditions.switch(name).unwrap() = false;
    }
    if draw.chance(0.2) {
        (conditions.decaying, conditions.growing) = (false, false);
    }
    conditions
}

fn change(p: &mut Pins, draw: &mut Draw) {
    match draw.of(&[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10]) {
        0 => p.k = draw.of(&[0.5, -0.5, 2.0]),
        1 => p.n = draw.of(&[1, 3, 7, 31]),
        2 => p.td = draw.of(&[None, Some(0.0), Some(0.1)]),
        3 => p.kp = draw.of(&[None, Some(1.0)]),
        4 => p.op = if p.op.is_some() { None } else { Some(draw.between(-1.0, 1.0)) },
        5 => p.conditions = conditions(draw),
        6 => p.op_limits = Some((-1.0, 1.0)),
        7 => p.ti = draw.between(0.3, 0.6),
        8 => p.integrating = true,
        9 => (p.kp, p.pv_span, p.op_span) = (None, Some(2.0), Some(3.0)),
        _ => p.max_h = Some(draw.between(0.2, 2.0)),
    }
}

fn spoil(p: &mut Pins, draw: &mut Draw) {
    let none = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY];
    let number = draw.of(&none);
    match draw.of(&[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12]) {
        0 => p.k = draw.of(&[0.0, number]),
        1 => p.ti = draw.of(&[0.0, -1.0, number]),
        2 => p.td = Some(draw.of(&[-1.0, number])),
        3 => p.b = draw.of(&[-0.1, 1.1, number]),
        4 => p.kp = Some(draw.of(&[0.0, number])),
        5 => p.tf = Some(draw.of(&[-1.0, number])),
        6 => p.n = draw.of(&[0, 4, 33, -3, 32]),
        7 => p.max_h = Some(draw.of(&[0.0, -1.0, 2e9, number])),
        8 => p.op_limits = Some(draw.of(&[(1.0, 1.0), (2.0, 1.0), (f64::NAN, 1.0)])),
        9 => p.op_limits = Some(draw.of(&[(0.0, f64::INFINITY), (0.0, f64::NAN)])),
        12 => p.pv_span = Some(draw.of(&[0.0, -1.0, number])),
        10 => p.op_span = Some(draw.of(&[0.0, -1.0, number])),
        _ => (p.td, p.tf, p.ti) = (Some(number), None, -1.0),
    }
}
