//! The golden cases of `vectors/`, which were computed without this crate: every output must agree to the last bit.

use glapp_core::auto_tuner::Rule;
use glapp_core::modules::{
    self, BacklashDetection, BacklashDetectionSettings, BacklashDetectionState, ForeignDetection,
    ForeignDetectionSettings, ForeignDetectionState, Gains, Mode, PidAdvanced, PidAdvancedSettings, PidAdvancedState,
    PidSettings, ProcessSim, ProcessSimState, Read, SCHEDULE_ROWS,
};
use glapp_core::{
    AutoTuner, AutoTunerSettings, AutoTunerState, Backlash, BacklashState, Backward, Compensation, CompensationSample,
    CompensationSettings, CompensationState, Conditions, Correction, CorrectionState, Derivative, Detector,
    DetectorSettings, DetectorState, HalfPeriod, HalfPeriodResult, HalfPeriodState, MedianMean, MedianMeanState, Noise,
    NoiseLevel, NoiseState, OverCompensation, OverCompensationState, OverWarning, PhaseLead, PhaseLeadState, Pid,
    PidState, Push, RateLimit, RateLimitState, Real, Reason, SafetyNet, Sample, Saturation, SecondOrderFilter,
    SecondOrderFilterState, Source, Standing, Stiction, StictionSample, StictionSettings, StictionState, Sum, Swing,
    SwingState, Way, Width, WidthParts, WrongSign, WrongSignState, ZeroCrossing,
};
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

    /// Compares the output of `update`, called with each sample and the time before it, to the last bit.
    fn check(&self, mut update: impl FnMut(&[f64], f64) -> f64) {
        self.check_all(|x, h| Some(vec![update(x, h)]));
    }

    /// Compares several outputs, or none at some samples, to the last bit.
    fn check_all(&self, update: impl FnMut(&[f64], f64) -> Option<Vec<f64>>) {
        self.compare(update, |expected, output| match expected.as_f64() {
            Some(number) => number.to_bits() == output.to_bits(),
            None => output.is_nan(),
        });
    }

    /// Compares with a share of the number, or of 1 where that is smaller.
    fn check_within(&self, tolerance: f64, update: impl FnMut(&[f64], f64) -> Option<Vec<f64>>) {
        self.compare(update, |expected, output| match expected.as_f64() {
            Some(number) => (number - output).abs() <= tolerance * number.abs().max(1.0),
            None => output.is_nan(),
        });
    }

    fn compare(&self, mut update: impl FnMut(&[f64], f64) -> Option<Vec<f64>>, same: impl Fn(&Value, f64) -> bool) {
        let expected = self.case["output"].as_array().expect("an array");
        let samples = self.samples();
        assert_eq!(samples.len(), expected.len(), "{}", self.name);
        for (i, ((h, x), expected)) in samples.iter().zip(expected).enumerate() {
            let output = update(x, *h);
            let single = std::slice::from_ref(expected);
            let agree = match (expected.as_array(), &output) {
                (Some(row), Some(output)) => {
                    row.len() == output.len() && row.iter().zip(output).all(|(e, o)| same(e, *o))
                }
                (None, Some(output)) => output.len() == 1 && same(&single[0], output[0]),
                (row, None) => row.is_none() && expected.is_null(),
            };
            assert!(agree, "{}, sample {i}: {output:?} instead of {expected}", self.name);
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
fn auto_tuner() {
    for case in cases("auto_tuner") {
        let tuner = AutoTuner::new(AutoTunerSettings {
            amplitude: case.given("amplitude"),
            relay_hysteresis: case.param("relay_hysteresis"),
            d: case.param("d").unwrap_or(0.0),
            wait: case.given("wait"),
            longest: case.given("longest"),
            max_h: case.given("max_h"),
            pv: (case.given("pv_low"), case.given("pv_high")),
            op: (case.given("op_low"), case.given("op_high")),
        })
        .unwrap();
        let mut s = AutoTunerState::default();
        case.check_all(|x, h| {
            if !x[2].is_nan() {
                tuner.start(&mut s, x[2]);
            }
            let op = tuner.update(&mut s, x[0], h, x[1] as u16);
            let found =
                s.found.map_or([f64::NAN; 4], |f| [f.ku, f.tu, f.kp.unwrap_or(f64::NAN), f.kappa.unwrap_or(f64::NAN)]);
            Some(
                [&[op, f64::from(s.phase as u8), f64::from(s.stop as u8), s.relay_hysteresis, s.bias], &found[..]]
                    .concat(),
            )
        });
    }
}

#[test]
fn auto_tuner_module() {
    for case in cases("auto_tuner_module") {
        let settings = |amplitude| AutoTunerSettings {
            amplitude,
            relay_hysteresis: case.param("relay_hysteresis"),
            d: case.or("d", 0.0),
            wait: case.given("wait"),
            longest: case.given("longest"),
            max_h: case.given("max_h"),
            pv: (case.given("pv_low"), case.given("pv_high")),
            op: (case.given("op_low"), case.given("op_high")),
        };
        let mut module = modules::AutoTuner::new(settings(case.given("amplitude"))).unwrap();
        let (mut s, mut wish) = (modules::AutoTunerState::default(), 0.0);
        case.check_all(|x, h| {
            let &[x, pv, run, flags, tracking, amplitude] = x else { panic!("six inputs") };
            let refused = modules::AutoTuner::new(settings(amplitude)).map(|new| module = new);
            let refused = refused.err().map_or(0, |error| error.number().unwrap());
            if run != wish {
                (wish, s.run) = (run, run == 1.0);
            }
            let y = module.forward(&mut s, x.into(), pv.into(), h).value;
            let told = module.backward(&mut s, Backward { flags: flags as u16, tracking, ..Backward::default() });
            let e = &s.experiment;
            let stands = [y, told.flags.into(), told.tracking, f64::from(e.phase as u8), f64::from(e.stop as u8)];
            let unknown = f64::NAN;
            let found =
                e.found.map_or([unknown; 4], |f| [f.ku, f.tu, f.kp.unwrap_or(unknown), f.kappa.unwrap_or(unknown)]);
            Some([&stands[..], &[refused.into()], &found].concat())
        });
    }
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
fn process_sim() {
    for case in cases("process_sim") {
        let or_zero = |name| case.param(name).unwrap_or(0.0);
        let (gain, t1, h) = (case.given("gain"), case.given("t1"), case.given("h"));
        let process = ProcessSim::<f64, 64>::new(gain, t1, or_zero("t2"), or_zero("dead_time"), h).unwrap();
        let mut state = ProcessSimState::at_rest(or_zero("start") / gain);
        case.check(|x, _| {
            let y = process.output(&state).value;
            process.forward(&mut state, x[0].into(), x[1].into());
            y
        });
    }
}

#[test]
fn pid_module() {
    for case in cases("pid_module") {
        let module = modules::Pid::new(case.controller()).unwrap();
        let mut state = modules::PidState::at(case.given("start"));
        case.check_all(|x, h| {
            let &[pv, sp, ff, given, own_sp, manual, low, high, flags, tracking] = x else { panic!("ten inputs") };
            state.mode = mode(given, state.mode);
            state.sp = if own_sp.is_nan() { state.sp } else { own_sp };
            state.manual = if manual.is_nan() { state.manual } else { manual };
            let u = module.forward(&mut state, pv.into(), sp.into(), ff.into(), h).value;
            module.backward(&mut state, Backward { low, high, flags: flags as u16, tracking });
            Some(vec![u, state.ysp, state.yf, state.error.into(), state.flags.into()])
        });
    }
}

impl Case {
    fn or(&self, name: &str, other: f64) -> f64 {
        self.param(name).unwrap_or(other)
    }

    fn controller(&self) -> PidSettings<f64> {
        let ideal = PidSettings::ideal(self.given("k"), self.given("ti"), self.or("td", 0.0));
        PidSettings {
            b: self.or("b", ideal.b),
            c: self.or("c", ideal.c),
            tf: self.or("tf", ideal.tf),
            low: self.or("low", ideal.low),
            high: self.or("high", ideal.high),
            rate: self.or("rate", ideal.rate),
            ..ideal
        }
    }

    fn compensation(&self) -> Option<CompensationSettings<f64>> {
        let size = self.param("comp_size")?;
        let way = if self.or("comp_way", 3.0) == 1.0 { Way::Error } else { Way::Inverse };
        Some(CompensationSettings {
            band: self.given("comp_band"),
            rate: self.given("comp_rate"),
            // The controller's gain is used, and its limits.
            ..CompensationSettings::new(way, 1.0, self.given("ti"), size, 1.0)
        })
    }
}

fn of_detection(state: &BacklashDetectionState<f64>) -> [f64; 8] {
    let shown = state.detector.shown().map_or([f64::NAN, 0.0], |one| [one.value, one.count.into()]);
    let floor = state.detector.noise_floor().unwrap_or(f64::NAN);
    let whole = state.shown().map_or(f64::NAN, |whole| whole.value);
    let over = u8::from(state.over.equal) + 2 * u8::from(state.over.relay);
    let standing = state.compensation.standing as u8;
    [state.compensation.u_ff, shown[0], shown[1], floor, whole, standing.into(), over.into(), state.error().into()]
}

fn mode(given: f64, now: Mode) -> Mode {
    if given.is_nan() { now } else { [Mode::Manual, Mode::Auto, Mode::External][given as usize] }
}

#[test]
fn backlash_detection() {
    for case in cases("backlash_detection") {
        let settings = case.controller();
        let pid = modules::Pid::new(settings).unwrap();
        let detector = DetectorSettings {
            tf: case.given("detector_tf"),
            kp: case.param("kp"),
            n: case.given("n") as u32,
            op_limits: case.param("low").zip(case.param("high")),
            max_h: settings.max_h,
            ..DetectorSettings::new(case.or("detector_k", settings.k), settings.ti, settings.td, 0.0)
        };
        let compensation = case.compensation();
        let watch = BacklashDetection::new(BacklashDetectionSettings { detector, compensation }).unwrap();
        let (mut p, mut w) = (modules::PidState::at(case.given("start")), BacklashDetectionState::default());
        case.check_all(|x, h| {
            let &[pv, sp, given, manual, told, enable] = x else { panic!("six inputs") };
            p.mode = mode(given, p.mode);
            p.manual = if manual.is_nan() { p.manual } else { manual };
            w.compensate = enable != 0.0;
            let u_ff = watch.forward(&mut w, sp.into(), pv.into(), h);
            let u = pid.forward(&mut p, pv.into(), sp.into(), u_ff, h).value;
            let (_, ff) = pid.backward(&mut p, Backward { flags: told as u16, ..Backward::default() });
            watch.backward(&mut w, Some(ff));
            Some([&[u][..], &of_detection(&w)].concat())
        });
    }
}

#[test]
fn foreign_detection() {
    for case in cases("foreign_detection") {
        let (k, ti) = (case.given("k"), case.given("ti"));
        let detector = DetectorSettings {
            tf: case.given("detector_tf"),
            kp: case.param("kp"),
            n: case.given("n") as u32,
            op_limits: case.param("low").zip(case.param("high")),
            max_h: ti / 2.0,
            ..DetectorSettings::new(k, ti, 0.0, 0.0)
        };
        let estimate = CompensationSettings::by_estimate(Way::Inverse, k, ti, 1.0);
        let compensation = if case.or("comp_source", 1.0) == 3.0 { Some(estimate) } else { case.compensation() };
        let settings = ForeignDetectionSettings {
            delay: case.given("delay") as u32,
            tolerance: case.param("tolerance"),
            longest: case.param("longest"),
            ..ForeignDetectionSettings::new(BacklashDetectionSettings { detector, compensation })
        };
        let block = ForeignDetection::new(settings).unwrap();
        let mut state = ForeignDetectionState::default();
        case.check_all(|x, h| {
            let &[pv, sp, op, told, back, enable] = x else { panic!("six inputs") };
            state.detection.compensate = enable != 0.0;
            let u_ff = (case.given("read_back") == 1.0).then(|| back.into());
            let read = Read { op: Some(op.into()), flags: told as u16, u_ff };
            let u_ff = block.update(&mut state, sp.into(), pv.into(), &read, h).value;
            assert_eq!(u_ff, state.detection.compensation.u_ff);
            Some([&of_detection(&state.detection)[..], &[state.detection.compensation.delta]].concat())
        });
    }
}

#[test]
fn pid_advanced() {
    for case in cases("pid_advanced") {
        let mut schedule = [Gains::default(); SCHEDULE_ROWS];
        let mut rows = 0;
        while let Some(at) = case.param(&format!("at{}", rows + 1)) {
            let of = |name: &str| case.given(&format!("{name}{}", rows + 1));
            schedule[rows] = Gains { at, k: of("k"), ti: of("ti"), td: of("td") };
            rows += 1;
        }
        let usual = PidAdvancedSettings::new(case.controller());
        let settings = PidAdvancedSettings {
            kp: case.param("kp"),
            pv_span: case.param("pv_span"),
            op_span: case.param("op_span"),
            detector_tf: case.param("detector_tf"),
            n: case.given("n") as u32,
            sp_rate: case.or("sp_rate", usual.sp_rate),
            schedule,
            rows,
            compensation: case.compensation(),
            ..usual
        };
        let pid = PidAdvanced::new(settings).unwrap();
        let mut s = PidAdvancedState::at(case.given("start"));
        case.check_all(|x, h| {
            let &[pv, sp, by, given, manual, told, enable] = x else { panic!("seven inputs") };
            s.pid.mode = mode(given, s.pid.mode);
            s.pid.manual = if manual.is_nan() { s.pid.manual } else { manual };
            s.detection.compensate = enable != 0.0;
            let u = pid.forward(&mut s, pv.into(), sp.into(), 0.0.into(), by.into(), h).value;
            pid.backward(&mut s, Backward { flags: told as u16, ..Backward::default() });
            Some([&[u, s.pid.ysp][..], &of_detection(&s.detection)].concat())
        });
    }
}

#[test]
fn pid_settings() {
    for case in cases("pid_settings") {
        let usual = PidAdvancedSettings {
            kp: case.param("kp"),
            n: case.given("n") as u32,
            ..PidAdvancedSettings::new(case.controller())
        };
        let with = |sp_rate, rate| {
            let mut settings = usual;
            (settings.sp_rate, settings.pid.rate) = (sp_rate, rate);
            PidAdvanced::new(settings)
        };
        let mut pid = with(1.0, 1.0).unwrap();
        let mut s = PidAdvancedState::at(case.given("start"));
        s.pid.mode = Mode::External;
        case.check_all(|x, h| {
            let &[pv, sp, sp_rate, rate] = x else { panic!("four inputs") };
            let refused = with(sp_rate, rate).map(|new| pid = new);
            let refused = refused.err().map_or(0, |error| error.number().unwrap());
            let u = pid.forward(&mut s, pv.into(), sp.into(), 0.0.into(), 0.0.into(), h).value;
            pid.backward(&mut s, Backward::default());
            let shown = of_detection(&s.detection);
            Some(vec![u, s.pid.ysp, refused.into(), shown[1], shown[2]])
        });
    }
}

#[test]
fn pid_tuner() {
    for case in cases("pid_tuner") {
        let settings = case.controller();
        let tuner = AutoTunerSettings {
            amplitude: case.given("amplitude"),
            relay_hysteresis: None,
            d: 0.0,
            wait: case.given("wait"),
            longest: case.given("longest"),
            pv: (case.given("pv_low"), case.given("pv_high")),
            // The controller's own are used.
            max_h: f64::NAN,
            op: (f64::NAN, f64::NAN),
        };
        let usual = PidAdvancedSettings::new(settings);
        let with_tuner = PidAdvancedSettings { tuner: Some(tuner), rule: Rule::AmigoPi, ..usual };
        let mut pid = PidAdvanced::new(with_tuner).unwrap();
        let mut s = PidAdvancedState::at(case.given("start"));
        case.check_all(|x, h| {
            let &[pv, sp, given, told, tune, take] = x else { panic!("six inputs") };
            s.pid.mode = mode(given, s.pid.mode);
            s.tuner.run = if tune.is_nan() { s.tuner.run } else { tune == 1.0 };
            if take == 1.0 {
                pid = pid.take_over(&mut s).unwrap();
            }
            let u = pid.forward(&mut s, pv.into(), sp.into(), 0.0.into(), 0.0.into(), h).value;
            pid.backward(&mut s, Backward { flags: told as u16, ..Backward::default() });
            let e = &s.tuner.experiment;
            let unknown = f64::NAN;
            let found =
                e.found.map_or([unknown; 4], |f| [f.ku, f.tu, f.kp.unwrap_or(unknown), f.kappa.unwrap_or(unknown)]);
            let PidSettings { k, ti, td, .. } = pid.settings().pid;
            let stands = [u, s.pid.ysp, f64::from(e.phase as u8), f64::from(e.stop as u8)];
            Some([&stands[..], &found, &[k, ti, td]].concat())
        });
    }
}

#[test]
fn pid() {
    for case in cases("pid") {
        let limits = match (case.param("low"), case.param("high")) {
            (Some(low), Some(high)) => Saturation::new(low, high).unwrap(),
            _ => Saturation::none(),
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

#[test]
fn stiction() {
    for case in cases("stiction") {
        let push = Push::ALL[case.given("push") as usize - 1];
        let usual = StictionSettings::new(push, case.given("k"), case.given("ti"), case.given("size"));
        let or = |name, usual: f64| case.param(name).unwrap_or(usual);
        let limits = match (case.param("low"), case.param("high")) {
            (Some(low), Some(high)) => Saturation::new(low, high).unwrap(),
            _ => Saturation::none(),
        };
        let block = Stiction::new(StictionSettings {
            limit: or("limit", usual.limit),
            hold: or("hold", usual.hold),
            period: or("period", usual.period),
            band: or("band", usual.band),
            far: or("far", usual.far),
            rate: or("rate", usual.rate),
            release: or("release", usual.release),
            travel: or("travel", usual.travel),
            watch: or("watch", usual.watch),
            withdraw: or("withdraw", 1.0) != 0.0,
            limits,
            ..usual
        })
        .unwrap();
        let mut state = StictionState::default();
        case.check_all(|x, h| {
            let sample = StictionSample { e: x[0], u: x[1], h, enable: x[2] != 0.0, flags: x[3] as u16 };
            let u_ff = block.update(&mut state, &sample);
            Some(vec![u_ff, f64::from(state.standing as u8), f64::from(state.direction)])
        });
    }
}

#[test]
fn saturation() {
    for case in cases("saturation") {
        let block = Saturation::new(case.given("low"), case.given("high")).unwrap();
        case.check(|x, _| block.update(x[0]));
    }
}

#[test]
fn rate_limit() {
    for case in cases("rate_limit") {
        let block = RateLimit::new(case.given("rate")).unwrap();
        let mut state = RateLimitState::default();
        case.check(|x, h| block.update(&mut state, x[0], h));
    }
}

#[test]
fn phase_lead() {
    for case in cases("phase_lead") {
        let block = PhaseLead::new(case.given("lead"), case.given("lag")).unwrap();
        let mut state = PhaseLeadState::default();
        case.check(|x, h| block.update(&mut state, x[0], h));
    }
}

#[test]
fn filter() {
    for case in cases("filter") {
        let block = SecondOrderFilter::new(case.given("tf")).unwrap();
        let mut state = SecondOrderFilterState::default();
        case.check(|x, h| block.update(&mut state, x[0], h));
    }
}

#[test]
fn noise_level() {
    for case in cases("noise_level") {
        let mut state = NoiseLevel::default();
        case.check(|x, _| {
            if x[0].is_nan() {
                state.interrupt();
            } else {
                state.update(x[0]);
            }
            state.sigma().unwrap_or(f64::NAN)
        });
    }
}

#[test]
fn zero_crossing() {
    for case in cases("zero_crossing") {
        let mut state = ZeroCrossing::default();
        case.check_all(|x, _| {
            let crossed = state.update(x[0]);
            Some(vec![f64::from(u8::from(crossed)), f64::from(state.sign)])
        });
    }
}

fn compensate<R: Real>(case: &Case) -> impl FnMut(&[f64], f64) -> Option<Vec<f64>> {
    let number = |name| R::of(case.given(name));
    let block = Compensation::new(CompensationSettings {
        way: Way::ALL[case.given("way") as usize - 1],
        k: number("k"),
        ti: R::of(case.or("ti", 1e6)),
        source: Source::ALL[case.or("source", 1.0) as usize - 1],
        size: number("size"),
        share: number("share"),
        limit: R::of(case.or("limit", case.given("size"))),
        band: number("band"),
        tf: number("tf"),
        rate: number("rate"),
        ramp_time: R::of(case.or("ramp_time", 0.0)),
        release: number("release"),
        watch: number("watch"),
        travel: number("travel"),
        reversals: number("reversals"),
        withdraw: case.given("withdraw") != 0.0,
        estimate: case.or("estimate", 1.0) != 0.0,
        struck: false,
        limits: match (case.param("low"), case.param("high")) {
            (Some(low), Some(high)) => Saturation::new(R::of(low), R::of(high)).unwrap(),
            _ => Saturation::none(),
        },
    })
    .unwrap();
    let mut state = CompensationState::default();
    move |x, h| {
        let sample = CompensationSample {
            e: R::of(x[0]),
            u: R::of(x[1]),
            h: R::of(h),
            d_hat: given(x[2]).map(R::of),
            offered: given(x[6]).map(R::of),
            hindered: given(x[7]).map(|number| Standing::ALL[number as usize]),
            over: x[3] != 0.0,
            enable: x[4] != 0.0,
            flags: x[5] as u16,
        };
        let u_ff = block.update(&mut state, &sample);
        let numbers = [u_ff, state.half.value(), state.delta].map(R::as_f64);
        Some(vec![numbers[0], numbers[1], f64::from(state.standing as u8), numbers[2]])
    }
}

#[test]
fn compensation() {
    for case in cases("compensation") {
        case.check_all(compensate::<f64>(&case));
    }
}

#[test]
fn wrong_sign() {
    for case in cases("wrong_sign") {
        let limits = Saturation::new(case.given("low"), case.given("high")).unwrap();
        let block = WrongSign::new(case.given("k"), case.given("ti"), limits).unwrap();
        let mut state = WrongSignState::default();
        case.check(|x, h| f64::from(u8::from(block.update(&mut state, x[0], x[1], x[2], h, x[3] as u16))));
    }
}

#[test]
fn over_compensation() {
    for case in cases("over_compensation") {
        let block = OverCompensation::new(case.given("k"), case.given("ti")).unwrap();
        let mut state = OverCompensationState::default();
        case.check_all(|x, h| {
            let half = HalfPeriod {
                delta_t: x[0],
                delta_y: x[1],
                delta_sp: x[2],
                flags: x[3] as u16,
                ..HalfPeriod::default()
            };
            let OverWarning { equal, relay } = block.update(&mut state, &half, h, x[4]);
            Some(vec![f64::from(u8::from(equal)), f64::from(u8::from(relay))])
        });
    }
}

#[test]
fn derivative() {
    for case in cases("derivative") {
        let mut state = Derivative::default();
        case.check(|x, h| state.update(x[0], h));
    }
}

#[test]
fn half_period() {
    for case in cases("half_period") {
        let mut state: Option<HalfPeriodState<f64>> = None;
        case.check_all(|x, h| {
            let (e, sp, slope, op, flags) = (x[0], x[1], x[2], x[3], x[4] as u16);
            let ended = state.filter(|_| x[5] != 0.0).map(|state| state.close(1, sp, slope, op));
            if ended.is_some() || state.is_none() {
                state = Some(HalfPeriodState::start(sp, slope, op, 0));
            }
            let state = state.as_mut().unwrap();
            state.add(e, h, flags);
            state.widen(sp);
            ended.map(|half| {
                vec![
                    f64::from(half.flags),
                    f64::from(half.n),
                    half.delta_t,
                    half.delta_y,
                    half.e_max,
                    half.delta_sp,
                    half.sp_change,
                    half.slope_change,
                    half.op_change,
                ]
            })
        });
    }
}

fn width_of(case: &Case) -> Width<f64> {
    let b = case.param("b").unwrap_or(1.0);
    Width::new(case.given("k"), case.given("ti"), case.param("td"), b, case.param("kp")).unwrap()
}

fn parts_as_row<R: Real>(parts: &WidthParts<R>) -> [f64; 7] {
    [parts.delta_u, parts.delta_u_d, parts.delta_u_sp, parts.op_travel, parts.free, parts.kp_part, parts.d]
        .map(Real::as_f64)
}

#[test]
fn width() {
    for case in cases("width") {
        let block = width_of(&case);
        case.check_all(|x, _| {
            let op_known = !x[5].is_nan();
            let half = HalfPeriod {
                sign: x[0] as i8,
                delta_t: x[1],
                delta_y: x[2],
                sp_change: x[3],
                slope_change: x[4],
                op_change: if op_known { x[5] } else { 0.0 },
                ..HalfPeriod::default()
            };
            Some(parts_as_row(&block.of(&half, op_known)).to_vec())
        });
    }
}

fn net_of<R: Real>(case: &Case) -> SafetyNet<R> {
    let on = |name| case.param(name) != Some(0.0);
    let mut net = SafetyNet::new(case.param("op_span").map(R::of)).unwrap();
    for name in Conditions::NAMES {
        *net.conditions.switch(name).unwrap() = on(name);
    }
    net
}

fn given(x: f64) -> Option<f64> {
    Some(x).filter(|x| !x.is_nan())
}

#[test]
fn safety_net() {
    for case in cases("safety_net") {
        let (net, width) = (net_of(&case), width_of(&case));
        case.check_all(|x, _| {
            let half = HalfPeriod {
                flags: x[0] as u16,
                delta_t: x[1],
                delta_y: x[2],
                e_max: x[3],
                delta_sp: x[4],
                ..HalfPeriod::default()
            };
            let parts = WidthParts { free: x[5], ..WidthParts::default() };
            let mask = net.check(&half, &parts, &width, given(x[6]), given(x[7]));
            Some(vec![f64::from(mask), f64::from(Reason::first(mask) as u8)])
        });
    }
}

#[test]
fn swing() {
    for case in cases("swing") {
        let block = Swing::new(case.given("k"), case.given("ti"), case.param("td"), case.given("b")).unwrap();
        let mut state = SwingState::default();
        case.check_all(|x, h| {
            let ended = (x[3] != 0.0).then(|| block.end(&mut state, x[3] as i8, x[4] as u16));
            block.add(&mut state, h, x[0], x[1], given(x[2]));
            ended.map(|parts| vec![parts.travel.unwrap_or(f64::NAN), parts.plateau])
        });
    }
}

#[test]
fn correction() {
    for case in cases("correction") {
        let integrating = case.or("integrating", 0.0) != 0.0;
        let [k, ti, b] = ["k", "ti", "b"].map(|name| case.given(name));
        let block = Correction::new(k, ti, b, case.param("kp"), integrating).unwrap();
        let mut state = CorrectionState::default();
        case.check_all(|x, h| {
            block.conclude(&mut state);
            if x[3] != 0.0 {
                let (sign, flags, mask) = (x[3] as i8, x[4] as u16, x[5] as u16);
                let half = HalfPeriod { sign, flags, delta_y: x[6], ..HalfPeriod::default() };
                block.end(&mut state, &HalfPeriodResult { half, mask, ..HalfPeriodResult::default() });
            }
            block.add(&mut state, h, x[0], x[1], x[2]);
            Some(match block.width(&state, true) {
                Ok(found) => vec![found.d, found.low, found.high, found.kp, 0.0],
                Err(doubt) => [&[f64::NAN; 4][..], &[f64::from(doubt as u8)]].concat(),
            })
        });
    }
}

#[test]
fn median_mean() {
    for case in cases("median_mean") {
        let block = MedianMean::new(case.given("n") as u32).unwrap();
        let mut state = MedianMeanState::default();
        case.check_all(|x, _| {
            let shown = block.update(&mut state, x[0]);
            Some(vec![shown.value, shown.low, shown.high, f64::from(shown.kept), f64::from(shown.count)])
        });
    }
}

fn detector_of<R: Real>(case: &Case) -> Detector<R> {
    let number = |name| R::of(case.given(name));
    let maybe = |name| case.param(name).map(R::of);
    Detector::new(
        SecondOrderFilter::new(number("tf")).unwrap(),
        Width::new(number("k"), number("ti"), maybe("td"), number("b"), maybe("kp")).unwrap(),
        net_of(case),
        MedianMean::new(case.given("n") as u32).unwrap(),
        number("max_h"),
        maybe("op_low").zip(maybe("op_high")),
    )
    .unwrap()
}

fn record_as_row<R: Real>(record: &HalfPeriodResult<R>) -> Vec<f64> {
    let half = &record.half;
    let or_nan = |x: Option<R>| x.map_or(f64::NAN, Real::as_f64);
    let mut row = vec![f64::from(half.sign), f64::from(half.n)];
    row.extend([half.delta_t, half.delta_y, half.e_max, half.delta_sp].map(Real::as_f64));
    row.extend(parts_as_row(&record.parts));
    row.extend([or_nan(record.previous_delta_y), or_nan(record.d_hat_before)]);
    row.extend([f64::from(record.mask), f64::from(record.reason() as u8)]);
    row.push(or_nan(record.shown().map(|shown| shown.value)));
    row.push(record.estimate.map_or(0.0, |estimate| f64::from(estimate.count)));
    row.push(or_nan(record.estimate.map(|estimate| estimate.value)));
    row.push(or_nan(record.noise_floor));
    row
}

fn detect<R: Real>(case: &Case) -> impl FnMut(&[f64], f64) -> Option<Vec<f64>> {
    let block = detector_of::<R>(case);
    let op_known = case.given("op_known") != 0.0;
    let mut state = DetectorState::default();
    move |x, h| {
        let (sp, pv, op) = (R::of(x[0]), R::of(x[1]), R::of(x[2]));
        let sample = Sample { h: R::of(h), sp, pv, op: op_known.then_some(op), flags: x[3] as u16 };
        block.update(&mut state, &sample).map(|record| record_as_row(&record))
    }
}

#[test]
fn detector() {
    for case in cases("detector") {
        case.check_all(detect::<f64>(&case));
    }
}

/// A PLC's REAL has seven digits: the same half-periods with the same verdicts, numbers to 1e-5 of their size or of 1.
#[test]
fn detector_in_single_precision() {
    for case in cases("detector") {
        case.check_within(1e-5, detect::<f32>(&case));
    }
}

/// Exact rational numbers on the other side: a few units in the last place are left.
#[test]
fn tuning() {
    use glapp_core::tuning::*;
    for case in cases("tuning") {
        let kind = if case.given("pid") == 1.0 { Kind::Pid } else { Kind::Pi };
        let table = if case.param("original") == Some(1.0) { Table::Original } else { Table::Textbook };
        let rule = case.given("rule") as u8;
        case.check_within(1e-12, |x, _| {
            let &[gain, t, t2, l, ku, tu, kappa, wish] = x else { panic!("eight inputs") };
            let gains = match rule {
                0 => ziegler_nichols_step(gain, l, kind, table),
                1 => ziegler_nichols_frequency(ku, tu, kind, table),
                2 => lambda(gain, t, l, wish, kind),
                3 => lambda_integrating(gain, l, wish),
                4 => amigo_step(gain, t, l, kind),
                5 => amigo_integrating(gain, l, kind),
                6 => amigo_frequency(ku, tu, kappa, kind),
                7 => simc(gain, t, t2, l, wish),
                8 => simc_integrating(gain, t2, l, wish),
                9 => point_placement(ku, tu),
                _ => panic!("rule {rule}"),
            };
            let gains = gains.unwrap();
            Some(vec![gains.k, gains.ti, gains.td])
        });
    }
}
