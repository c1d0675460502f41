//! Compensation and what it calls, once as the core has it and once as the library has it.
#![allow(dead_code, missing_docs)]

use super::blocks::{FLAGS, maybe};
use super::names::given;
use super::{Block, Case, Draw, Number, Scan, remembered};
use glapp_core::status::{AT_HIGH, AT_LOW, BAD, NOT_AUTO, Status};
use glapp_core::{
    Compensation, CompensationSample, CompensationSettings, CompensationState, Correction, CorrectionState, HalfPeriod,
    HalfPeriodResult, OverCompensation, OverCompensationState, PARAMETERS, ParameterError, Saturation, Source,
    Standing, Swing, SwingState, Way, WrongSign, WrongSignState,
};

pub const BLOCKS: [&str; 3] = ["over_compensation", "wrong_sign", "compensation"];

/// State of both warnings, in the core and here.
const OVER: ([&str; 4], [&str; 3]) =
    (["/at", "/count", "/compensating", "/before"], ["Place", "Count", "Compensating"]);
const WRONG_SIGN: ([&str; 5], [&str; 5]) =
    (["/sign", "/op", "/begin", "/early", "/farthest"], ["Sign", "LastOp", "Start", "Early", "Farthest"]);
/// Since OP stands at its limit.
const AT_LIMIT: ([&str; 5], [&str; 5]) =
    (["/time", "/e", "/pv", "/far", "/away"], ["Time0.Value", "ELimit", "PvLimit", "Far", "Away.Value"]);

/// State of a compensation.
pub const REMEMBERED: [(&str, &str); 19] = [
    ("/harm/direction", "Watched.Direction"),
    ("/side", "Side"),
    ("/in_force", "InForce"),
    ("/whole", "Whole"),
    ("/d_hat", "Least"),
    ("/pressed", "FrozenWidth"),
    ("/unfit", "Unfit"),
    ("/harm/in_force", "Watched.WasInForce"),
    ("/harm/reversals", "Watched.Reversals"),
    ("/harm/before/count", "Watched.BeforeCount"),
    ("/harm/before/e/value", "Watched.BeforeE.Value"),
    ("/harm/before/e/variance", "Watched.BeforeE.SigmaSquared"),
    ("/harm/before/reversals/value", "Watched.BeforeReversals.Value"),
    ("/harm/before/reversals/variance", "Watched.BeforeReversals.SigmaSquared"),
    ("/harm/since/count", "Watched.SinceCount"),
    ("/harm/since/e/value", "Watched.SinceE.Value"),
    ("/harm/since/e/variance", "Watched.SinceE.SigmaSquared"),
    ("/harm/since/reversals/value", "Watched.SinceReversals.Value"),
    ("/harm/since/reversals/variance", "Watched.SinceReversals.SigmaSquared"),
];

fn on(x: bool) -> f64 {
    f64::from(u8::from(x))
}

/// Settings of a case in `vectors/compensation.json`.
fn settings<R: Number>(case: &Case) -> CompensationSettings<R> {
    let number = |name| R::of(case.given(name));
    let or = |name, other| R::of(case.param(name).unwrap_or(other));
    CompensationSettings {
        way: Way::ALL[case.given("way") as usize - 1],
        k: number("k"),
        ti: or("ti", 1e6),
        source: Source::ALL[case.param("source").unwrap_or(1.0) as usize - 1],
        size: number("size"),
        share: number("share"),
        limit: or("limit", case.given("size")),
        band: number("band"),
        tf: number("tf"),
        rate: number("rate"),
        ramp_time: or("ramp_time", 0.0),
        release: number("release"),
        watch: number("watch"),
        travel: number("travel"),
        reversals: number("reversals"),
        withdraw: case.given("withdraw") != 0.0,
        estimate: case.param("estimate") != Some(0.0),
        contradicted: false,
        limits: match (case.param("low"), case.param("high")) {
            (Some(low), Some(high)) => Saturation::new(R::of(low), R::of(high)).unwrap(),
            _ => Saturation::none(),
        },
    }
}

/// The states of a compensation as rows.
pub fn row<R: Number>(state: &CompensationState<R>) -> Vec<f64> {
    use glapp_core::Sum;
    let sums = [state.u_ff, state.half, state.travel, state.reversals].map(|sum| sum.value().as_f64());
    let mut row = vec![f64::from(state.standing as u8), f64::from(state.direction)];
    row.extend(sums);
    row.extend([state.size, state.delta].map(R::as_f64));
    row
}

pub const SHOWN: [&str; 8] =
    ["Standing", "Direction", "UFf", "HalfWidth", "TravelSpent", "ReversalsSpent", "GapWidth", "Delta"];

pub fn core<R: Number>(block: &str, case: &Case) -> Scan {
    let r = R::of;
    match block {
        "over_compensation" => {
            let block = OverCompensation::new(r(case.given("k")), r(case.given("ti"))).unwrap();
            let mut state = OverCompensationState::default();
            Box::new(move |x, h| {
                let half = HalfPeriod {
                    delta_t: r(x[0]),
                    delta_y: r(x[1]),
                    delta_sp: r(x[2]),
                    flags: x[3] as u16,
                    ..HalfPeriod::default()
                };
                let warning = block.update(&mut state, &half, r(h), r(x[4]));
                Some([vec![on(warning.equal), on(warning.relay)], remembered(&state, &OVER.0)].concat())
            })
        }
        "wrong_sign" => {
            let limits = Saturation::new(r(case.given("low")), r(case.given("high"))).unwrap();
            let block = WrongSign::new(r(case.given("k")), r(case.given("ti")), limits).unwrap();
            let mut state = WrongSignState::default();
            Box::new(move |x, h| {
                let found = block.update(&mut state, r(x[0]), r(x[1]), r(x[2]), r(h), x[3] as u16);
                let at_limit = remembered(&state, &AT_LIMIT.0);
                let at_limit = if at_limit[0] == 0.0 { vec![f64::NAN; at_limit.len()] } else { at_limit };
                Some([vec![on(found)], remembered(&state, &WRONG_SIGN.0), at_limit].concat())
            })
        }
        "compensation" => {
            let block = Compensation::new(settings::<R>(case)).unwrap();
            let mut state = CompensationState::default();
            Box::new(move |x, h| {
                let sample = CompensationSample {
                    e: r(x[0]),
                    u: r(x[1]),
                    h: r(h),
                    d_hat: maybe(x[2]).map(r),
                    offered: maybe(x[6]).map(r),
                    hindered: maybe(x[7]).map(|number| Standing::ALL[number as usize]),
                    over: x[3] != 0.0,
                    enable: x[4] != 0.0,
                    flags: x[5] as u16,
                };
                block.update(&mut state, &sample);
                Some(row(&state))
            })
        }
        "swing" => {
            let [k, ti, b] = ["k", "ti", "b"].map(|name| r(case.given(name)));
            let block = Swing::new(k, ti, case.param("td").map(r), b).unwrap();
            let mut state = SwingState::default();
            Box::new(move |x, h| {
                let ended = (x[3] != 0.0).then(|| block.end(&mut state, x[3] as i8, x[4] as u16));
                block.add(&mut state, r(h), r(x[0]), r(x[1]), Some(r(x[2])));
                ended.map(|parts| vec![parts.travel.map_or(f64::NAN, R::as_f64), parts.plateau.as_f64()])
            })
        }
        "correction" => {
            let integrating = case.param("integrating").is_some_and(|x| x != 0.0);
            let [k, ti, b] = ["k", "ti", "b"].map(|name| r(case.given(name)));
            let block = Correction::new(k, ti, b, case.param("kp").map(r), integrating).unwrap();
            let mut state = CorrectionState::default();
            Box::new(move |x, h| {
                block.conclude(&mut state);
                if x[3] != 0.0 {
                    let (sign, flags, mask) = (x[3] as i8, x[4] as u16, x[5] as u16);
                    let half = HalfPeriod { sign, flags, delta_y: r(x[6]), ..HalfPeriod::default() };
                    block.end(&mut state, &HalfPeriodResult { half, mask, ..HalfPeriodResult::default() });
                }
                if x.get(7).is_some_and(|missing| *missing != 0.0) {
                    block.interrupt(&mut state);
                } else {
                    block.add(&mut state, r(h), r(x[0]), r(x[1]), r(x[2]));
                }
                let shown = x.get(8).is_none_or(|shown| *shown != 0.0);
                Some(match block.width(&state, shown) {
                    Ok(found) => {
                        let width = [found.d, found.low, found.high, found.kp].map(R::as_f64);
                        let range = found.kp_range.map_or([f64::NAN; 2], |(low, high)| [low, high].map(R::as_f64));
                        [&width[..], &[0.0], &range].concat()
                    }
                    Err(doubt) => [&[f64::NAN; 4][..], &[f64::from(doubt as u8)], &[f64::NAN; 2]].concat(),
                })
            })
        }
        other => panic!("{other}"),
    }
}

pub fn flags(block: &Block, mask: f64) {
    for (name, flag) in &FLAGS[..4] {
        block.set(name, on(mask as u16 & flag != 0));
    }
}

pub fn library<R: Number>(block: &str, case: &Case) -> (Scan, Block) {
    let one = Block::new::<R>(&format!("Glapp{}", super::blocks::pascal(block)));
    let b = one.clone();
    let scan: Scan = match block {
        "over_compensation" => {
            b.set_all(&[("K", case.given("k")), ("Ti", case.given("ti"))]);
            Box::new(move |x, h| {
                b.set_all(&[
                    ("Half.DeltaT", x[0]),
                    ("Half.DeltaY", x[1]),
                    ("Half.DeltaSp", x[2]),
                    ("Size", x[4]),
                    ("H", h),
                ]);
                for (name, flag) in FLAGS {
                    b.set(&format!("Half.{name}"), on(x[3] as u16 & flag != 0));
                }
                b.call();
                let before = b.look(&["HasBefore", "Before"]);
                let before = if before[0] == 0.0 { f64::NAN } else { before[1] };
                let mut row = [b.all(&["Equal", "Relay"]), b.look(&OVER.1)].concat();
                row.push(before);
                Some(row)
            })
        }
        "wrong_sign" => {
            for (pin, name) in [("K", "k"), ("Ti", "ti"), ("Low", "low"), ("High", "high")] {
                b.set(pin, case.given(name));
            }
            Box::new(move |x, h| {
                b.set_all(&[("Sp", x[0]), ("Yf", x[1]), ("Op", x[2]), ("H", h)]);
                for (name, flag) in FLAGS {
                    b.set(name, on(x[3] as u16 & flag != 0));
                }
                b.call();
                let at_limit = b.look(&AT_LIMIT.1);
                let at_limit = if at_limit[0] == 0.0 { vec![f64::NAN; at_limit.len()] } else { at_limit };
                Some([b.all(&["Found"]), b.look(&WRONG_SIGN.1), at_limit].concat())
            })
        }
        "compensation" => {
            let s = settings::<f64>(case);
            let pins = Pins { compensate: true, ..Pins::of(&s) };
            pins.set(&b);
            b.set("SeenOff", 1.0);
            Box::new(move |x, h| {
                b.set_all(&[("E", x[0]), ("U", x[1]), ("H", h), ("Over", x[3]), ("Compensate", x[4])]);
                b.set("Hindered", maybe(x[7]).unwrap_or(0.0));
                b.option("DHat", maybe(x[2]));
                b.option("Offered", maybe(x[6]));
                flags(&b, x[5]);
                b.call();
                Some(b.all(&SHOWN))
            })
        }
        "swing" => {
            b.set("K", case.given("k"));
            b.set("Take", 1.0);
            Box::new(move |x, h| {
                let ends = x[3] != 0.0;
                b.set_all(&[("H", h), ("Sp", x[0]), ("Yf", x[1]), ("Op", x[2]), ("Ends", on(ends)), ("Sign", x[3])]);
                b.set("Broken", on(x[4] as u16 & (1 | 2 | 16) != 0));
                b.call();
                ends.then(|| vec![b.given("HasTravel", "Travel"), b.get("Plateau")])
            })
        }
        "correction" => {
            b.set("K", case.given("k"));
            b.option("Kp", case.param("kp"));
            b.set("Integrating", case.param("integrating").unwrap_or(0.0));
            b.set("Conclude", 1.0);
            Box::new(move |x, h| {
                b.set_all(&[("H", h), ("Sp", x[0]), ("Yf", x[1]), ("Op", x[2]), ("Ends", on(x[3] != 0.0))]);
                b.set_all(&[("Half.Sign", x[3]), ("Mask", x[5]), ("Half.DeltaY", x[6])]);
                for (name, flag) in FLAGS {
                    b.set(&format!("Half.{name}"), on(x[4] as u16 & flag != 0));
                }
                b.set("Take", on(x.get(7).is_none_or(|missing| *missing == 0.0)));
                b.set("Shown", on(x.get(8).is_none_or(|shown| *shown != 0.0)));
                b.call();
                let mut row: Vec<f64> =
                    ["D", "Low", "High", "Kp"].iter().map(|pin| b.given("HasWidth", &format!("Width.{pin}"))).collect();
                row.push(b.get("Doubt"));
                let range = b.on("HasWidth") && b.on("Width.HasKpRange");
                row.extend(["Width.KpLow", "Width.KpHigh"].map(|pin| if range { b.get(pin) } else { f64::NAN }));
                Some(row)
            })
        }
        other => panic!("{other}"),
    };
    (scan, one)
}

/// Pins of a compensation in a scan.
#[derive(Clone, Debug)]
pub struct Pins {
    pub enable: bool,
    pub reset: bool,
    pub restart: bool,
    pub compensate: bool,
    pub h: f64,
    pub e: f64,
    pub u: f64,
    pub u_known: bool,
    pub flags: Status,
    pub d_hat: Option<f64>,
    pub offered: Option<f64>,
    pub over: bool,
    pub hindered: i16,
    pub limits: Option<(f64, f64)>,
    pub settings: Settings,
}

/// The pins of its settings, and of K and Ti.
#[derive(Clone, Debug)]
pub struct Settings {
    pub k: f64,
    pub ti: f64,
    pub way: i16,
    pub source: i16,
    pub size: f64,
    pub share: f64,
    pub most: Option<f64>,
    pub band: Option<f64>,
    pub tf: f64,
    pub rate: Option<f64>,
    pub ramp_time: Option<f64>,
    pub release: Option<f64>,
    pub travel: Option<f64>,
    pub reversals: Option<f64>,
    pub watch: Option<f64>,
    pub withdraw: bool,
    pub lessen: bool,
    pub contradicted: bool,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            k: 0.5,
            ti: 1.0,
            way: 3,
            source: 1,
            size: 0.0,
            share: 1.0,
            most: None,
            band: None,
            tf: 0.0,
            rate: None,
            ramp_time: None,
            release: None,
            travel: None,
            reversals: None,
            watch: None,
            withdraw: true,
            lessen: true,
            contradicted: false,
        }
    }
}

/// Each number among them.
pub const NUMBERS: [fn(&mut Settings, f64); 13] = [
    |s, x| s.k = x,
    |s, x| s.ti = x,
    |s, x| s.size = x,
    |s, x| s.share = x,
    |s, x| s.most = Some(x),
    |s, x| s.band = Some(x),
    |s, x| s.tf = x,
    |s, x| s.rate = Some(x),
    |s, x| s.ramp_time = Some(x),
    |s, x| s.release = Some(x),
    |s, x| s.travel = Some(x),
    |s, x| s.reversals = Some(x),
    |s, x| s.watch = Some(x),
];

pub fn number(error: &ParameterError) -> f64 {
    error.number().unwrap().into()
}

pub fn named(name: &str) -> f64 {
    (PARAMETERS.iter().position(|known| *known == name).unwrap() + 1) as f64
}

impl Settings {
    /// Sets the pins except K and Ti.
    pub fn set(&self, block: &Block) {
        block.set_all(&[
            ("Way", self.way.into()),
            ("Source", self.source.into()),
            ("Size", self.size),
            ("Share", self.share),
        ]);
        block.set_all(&[("OpTf", self.tf), ("Withdraw", on(self.withdraw)), ("ReduceByEstimate", on(self.lessen))]);
        block.set("Contradicted", on(self.contradicted));
        let options = [
            ("MaxWidth", self.most),
            ("Band", self.band),
            ("Rate", self.rate),
            ("RampTime", self.ramp_time),
            ("Release", self.release),
            ("Travel", self.travel),
            ("Reversals", self.reversals),
            ("Watch", self.watch),
        ];
        for (pin, value) in options {
            block.option(pin, value);
        }
    }

    /// Settings of the core, with its defaults; before K, Ti and limits are checked.
    pub fn core<R: Number>(&self, limits: Saturation<R>) -> Result<CompensationSettings<R>, f64> {
        let r = |x: f64| R::of(x);
        let enumerated =
            |number: i16, name| if (1..=3).contains(&number) { Ok(number as usize - 1) } else { Err(named(name)) };
        let (way, source) = (Way::ALL[enumerated(self.way, "way")?], Source::ALL[enumerated(self.source, "source")?]);
        let (k, ti) = (r(self.k), r(self.ti));
        let usual = match source {
            Source::Estimate => CompensationSettings::by_estimate(way, k, ti, r(self.share)),
            _ => CompensationSettings::new(way, k, ti, r(self.size), r(self.share)),
        };
        let or = |x: Option<f64>, pin: &str, usual: R| given(x, pin).map_or(usual, r);
        Ok(CompensationSettings {
            source,
            size: r(self.size),
            limit: or(self.most, "MaxWidth", usual.limit),
            band: or(self.band, "Band", usual.band),
            tf: r(self.tf),
            rate: or(self.rate, "Rate", usual.rate),
            ramp_time: or(self.ramp_time, "RampTime", usual.ramp_time),
            release: or(self.release, "Release", usual.release),
            travel: or(self.travel, "Travel", usual.travel),
            reversals: or(self.reversals, "Reversals", usual.reversals),
            watch: or(self.watch, "Watch", usual.watch),
            withdraw: self.withdraw,
            estimate: self.lessen,
            contradicted: self.contradicted,
            limits,
            ..usual
        })
    }
}

impl Pins {
    pub fn of(s: &CompensationSettings<f64>) -> Self {
        let limited = s.limits != Saturation::none();
        Self {
            limits: limited.then_some((s.limits.low, s.limits.high)),
            settings: Settings {
                k: s.k,
                ti: s.ti,
                way: s.way as i16,
                source: s.source as i16,
                size: s.size,
                share: s.share,
                most: Some(s.limit),
                band: Some(s.band),
                tf: s.tf,
                rate: Some(s.rate),
                ramp_time: Some(s.ramp_time),
                release: Some(s.release),
                travel: Some(s.travel),
                reversals: Some(s.reversals),
                watch: Some(s.watch),
                withdraw: s.withdraw,
                lessen: s.estimate,
                contradicted: s.contradicted,
            },
            ..Self::new(Settings::default())
        }
    }

    pub fn new(settings: Settings) -> Self {
        Self {
            enable: true,
            reset: false,
            restart: false,
            compensate: false,
            h: 0.25,
            e: 0.0,
            u: 0.0,
            u_known: true,
            flags: 0,
            d_hat: None,
            offered: None,
            over: false,
            hindered: 0,
            limits: None,
            settings,
        }
    }

    pub fn set(&self, block: &Block) {
        block.set_all(&[("Enable", on(self.enable)), ("Reset", on(self.reset)), ("Restart", on(self.restart))]);
        block.set_all(&[("Compensate", on(self.compensate)), ("H", self.h), ("E", self.e), ("U", self.u)]);
        block.set_all(&[("UKnown", on(self.u_known)), ("Over", on(self.over)), ("Hindered", self.hindered.into())]);
        block.set_all(&[("K", self.settings.k), ("Ti", self.settings.ti), ("HasLimits", on(self.limits.is_some()))]);
        if let Some((low, high)) = self.limits {
            block.set_all(&[("Low", low), ("High", high)]);
        }
        block.option("DHat", self.d_hat);
        block.option("Offered", self.offered);
        flags(block, self.flags.into());
        self.settings.set(block);
    }

    fn checked<R: Number>(&self) -> Result<Compensation<R>, f64> {
        let r = |x: f64| R::of(x);
        OverCompensation::new(r(self.settings.k), r(self.settings.ti)).map_err(|error| number(&error))?;
        let limits = match self.limits.filter(|limits| *limits != (0.0, 0.0)) {
            Some((low, high)) => Saturation::new(r(low), r(high)).map_err(|error| number(&error))?,
            None => Saturation::none(),
        };
        Compensation::new(self.settings.core(limits)?).map_err(|error| number(&error))
    }
}

/// After power-up: why it was withdrawn, and nothing else.
pub fn restarted<R: Number>(state: &CompensationState<R>) -> CompensationState<R> {
    let saved = serde_json::to_value(state).unwrap();
    let mut fresh = serde_json::to_value(CompensationState::<R>::default()).unwrap();
    fresh["withdrawn"] = saved["withdrawn"].clone();
    serde_json::from_value(fresh).unwrap()
}

/// Whether it has been withdrawn.
pub fn is_withdrawn<R: Number>(state: &CompensationState<R>) -> bool {
    !serde_json::to_value(state).unwrap()["withdrawn"].is_null()
}

/// Reference of the block for the field.
#[derive(Default)]
pub struct Reference<R: Number> {
    pub state: CompensationState<R>,
    good: Option<Compensation<R>>,
    seen_h: bool,
    armed: bool,
    /// Withdrawn before the power went.
    held: bool,
}

impl<R: Number> Reference<R> {
    pub fn restart(&mut self) {
        let state = restarted(&self.state);
        *self = Self { held: is_withdrawn(&state), state, good: None, seen_h: false, armed: false };
    }

    pub fn scan(&mut self, pins: &Pins) -> Vec<f64> {
        let r = |x: f64| R::of(x);
        if pins.reset {
            *self = Self { state: CompensationState::default(), good: None, seen_h: false, armed: false, held: false };
        } else if pins.restart {
            self.restart();
        }
        self.seen_h |= pins.h != 0.0;
        self.armed |= !pins.compensate;
        let mut error = 0.0;
        match pins.checked() {
            Ok(block) => {
                self.good = Some(block);
                if !self.seen_h {
                    error = named("h");
                }
            }
            Err(number) => error = number,
        }
        if let Some(block) = &self.good {
            let enable = pins.compensate && pins.u_known && (self.armed || self.held);
            self.held &= enable;
            let sample = CompensationSample {
                e: r(pins.e),
                u: r(pins.u),
                h: r(pins.h),
                d_hat: pins.d_hat.map(r),
                offered: pins.offered.map(r),
                over: pins.over,
                enable,
                hindered: (pins.hindered != 0).then(|| Standing::ALL[pins.hindered as usize]),
                flags: pins.flags | if pins.enable { 0 } else { BAD },
            };
            block.update(&mut self.state, &sample);
        }
        let mut shown = vec![on(pins.enable && error == 0.0), on(error != 0.0), error];
        shown.extend(row(&self.state));
        shown
    }
}

pub fn scan(block: &Block, pins: &Pins) -> Vec<f64> {
    pins.set(block);
    block.call();
    let mut shown = block.all(&["Valid", "Error", "ErrorID"]);
    shown.extend(block.all(&SHOWN));
    shown
}

/// Settings that are drawn: good ones.
pub fn drawn(draw: &mut Draw) -> Settings {
    let d = draw;
    let size = d.of(&[0.0, 0.4, 1.0, 1.0, 2.0]);
    Settings {
        k: d.of(&[0.5, -0.5, 2.0]),
        ti: d.between(0.3, 3.0),
        way: d.of(&[1, 2, 3, 3]),
        source: d.of(&[1, 2, 3, 3]),
        size,
        share: d.of(&[1.0, 0.7, 0.5, 0.0]),
        most: d.of(&[None, None, Some(0.6), Some(2.0), Some(9.0)]),
        band: d.of(&[None, Some(0.1), Some(0.0), Some(0.5)]),
        tf: d.of(&[0.0, 0.0, 0.2]),
        rate: d.of(&[None, Some(0.3), Some(3.0), Some(50.0)]),
        ramp_time: d.of(&[None, Some(0.0), Some(0.4)]),
        release: d.of(&[None, Some(0.5), Some(5.0)]),
        travel: d.of(&[None, None, None, Some(30.0)]),
        reversals: d.of(&[None, None, None, Some(12.0)]),
        watch: d.of(&[None, Some(37.5), Some(75.0), Some(10.0)]),
        withdraw: d.chance(0.8),
        lessen: d.chance(0.7),
        contradicted: false,
    }
}

/// Settings that are out of bounds: one of them.
pub fn spoil(s: &mut Settings, draw: &mut Draw) {
    let none = draw.of(&[f64::NAN, f64::INFINITY, f64::NEG_INFINITY]);
    match draw.of(&[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14]) {
        0 => s.k = draw.of(&[0.0, none]),
        1 => s.ti = draw.of(&[0.0, -1.0, none, 1.1e9]),
        2 => s.way = draw.of(&[0, 4, -1]),
        3 => s.source = draw.of(&[0, 4, -3]),
        4 => s.size = draw.of(&[-0.1, none, 1e31]),
        5 => s.share = draw.of(&[-0.1, 1.1, none]),
        6 => s.most = Some(draw.of(&[-0.1, 0.0, none, 2e37])),
        7 => s.band = Some(draw.of(&[-0.1, none, 1e31])),
        8 => s.rate = Some(draw.of(&[0.0, -1.0, none, 2e37])),
        9 => s.release = Some(draw.of(&[0.0, -1.0, none, 301.0, 10.1 * s.ti])),
        10 => s.ramp_time = Some(draw.of(&[-1.0, none, 10.1 * s.ti])),
        11 => s.travel = Some(draw.of(&[0.0, none, 2e37])),
        12 => s.reversals = Some(draw.of(&[1.9, none, 2e37])),
        13 => s.watch = Some(draw.of(&[0.0, none, 1.1e5 * s.ti])),
        _ => s.tf = draw.of(&[-0.1, none, 10.1 * s.ti]),
    }
}

/// A loop that swings, before and while it is compensated, with everything that can go wrong with it.
pub struct Swings {
    pub pins: Pins,
    usual: Settings,
    length: usize,
    count: usize,
    level: f64,
    noise: f64,
    wrong: f64,
    known: bool,
    worse: f64,
    /// Scans of a step of the load that are left.
    burst: usize,
}

impl Swings {
    pub fn new(draw: &mut Draw) -> Self {
        let usual = drawn(draw);
        let mut pins = Pins::new(usual.clone());
        pins.limits = draw.chance(0.3).then_some((-3.0, 3.0));
        let wrong = draw.of(&[0.0, 0.0, 0.005, 0.03]);
        Self {
            pins,
            usual,
            length: draw.of(&[3, 10, 20]),
            count: 0,
            level: 0.0,
            noise: draw.of(&[0.0, 0.02, 0.3]),
            wrong,
            known: draw.chance(0.8),
            worse: draw.of(&[1.0, 1.0, 1.2, 3.0]),
            burst: 0,
        }
    }

    pub fn next<R: Number>(&mut self, draw: &mut Draw) -> &Pins {
        self.count += 1;
        let side = if (self.count / self.length).is_multiple_of(2) { 1.0 } else { -1.0 };
        let p = &mut self.pins;
        (p.reset, p.restart, p.flags, p.hindered, p.over, p.enable, p.u_known) =
            (false, false, 0, 0, false, true, true);
        p.h = 0.25;
        if draw.chance(0.002) {
            p.compensate = !p.compensate;
        }
        p.compensate |= self.count == 150;
        let larger = if p.compensate { self.worse } else { 1.0 };
        p.e = side * larger + self.noise * draw.between(-1.0, 1.0);
        self.level += 0.3 * side;
        p.u = self.level + self.noise * draw.between(-1.0, 1.0);
        p.d_hat = self.known.then(|| draw.between(0.8, 1.5));
        p.offered = p.d_hat;
        let wrong = self.wrong;
        if draw.chance(wrong) {
            p.flags = draw.of(&[NOT_AUTO, BAD, AT_LOW, AT_HIGH, NOT_AUTO | BAD, AT_LOW | AT_HIGH]);
        }
        if draw.chance(wrong) {
            let bad = draw.of(&[f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e32, -1e32, 1e36]);
            if draw.chance(0.5) { p.e = bad } else { p.u = bad }
        }
        if draw.chance(wrong) {
            p.h = draw.of(&[0.0, 0.0, -0.25, 5.0, f64::NAN, 1e8, 1e12, f64::INFINITY]);
        }
        if draw.chance(wrong) {
            p.d_hat = draw.of(&[None, Some(f64::NAN), Some(0.05), Some(-1.0), Some(9.0)]);
        }
        if draw.chance(wrong) {
            p.offered = draw.of(&[None, Some(f64::NAN), Some(1e32), Some(0.3), Some(f64::INFINITY)]);
        }
        if draw.chance(0.3 * wrong) {
            self.burst = draw.of(&[1, 5, 30]);
        }
        if self.burst > 0 {
            self.burst -= 1;
            p.e *= 30.0;
        }
        if draw.chance(wrong) {
            p.e = 0.0;
        }
        if draw.chance(0.2 * wrong) {
            (p.e, p.u) = (0.9 * R::MOST.as_f64(), 0.9 * R::MOST.as_f64());
        }
        if draw.chance(0.3 * wrong) {
            match draw.of(&[0, 1, 2, 3, 4, 5]) {
                0 => p.over = true,
                1 => p.hindered = 12,
                2 => p.hindered = 13,
                3 => p.enable = false,
                4 => p.u_known = false,
                _ => (p.reset, p.restart) = (draw.chance(0.3), true),
            }
        }
        if self.count < 3 && wrong > 0.0 {
            p.h = 0.0;
        }
        if wrong > 0.0 && draw.chance(0.05) {
            p.settings = self.usual.clone();
            if draw.chance(0.3) {
                spoil(&mut p.settings, draw);
            } else if draw.chance(0.2) {
                p.settings = drawn(draw);
            }
            p.limits = draw.of(&[
                None,
                Some((-3.0, 3.0)),
                Some((-3.0, 3.0)),
                Some((1.0, -1.0)),
                Some((f64::NAN, 1.0)),
                Some((0.0, f64::INFINITY)),
            ]);
        }
        p
    }
}
