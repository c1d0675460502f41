//! A detection in its loop: a Kp that is a default, a filter of its own, the corrected width, and what can be read inside.

use glapp_core::modules::{Mode, PidAdvanced, PidAdvancedSettings, PidAdvancedState, PidSettings, VARIABLES};
use glapp_core::{
    Backlash, BacklashState, Backward, CompensationSettings, Detector, DetectorSettings, Doubt, Forward, Half, Noise,
    NoiseState, PAIRS, Span, Standing, Swing, SwingState, Way, corrected, pairs,
};

const H: f64 = 0.1;

/// A controller for two lags of 3 s and 1 s behind a gap of 2.
fn settings() -> PidAdvancedSettings<f64> {
    let pid = PidSettings { tf: 0.2, low: -100.0, high: 100.0, ..PidSettings::ideal(2.0, 2.0, 0.0) };
    PidAdvancedSettings { kp: Some(1.0), ..PidAdvancedSettings::new(pid) }
}

fn compensating(settings: PidAdvancedSettings<f64>) -> PidAdvancedSettings<f64> {
    let usual = CompensationSettings::new(Way::Inverse, 2.0, 2.0, 4.0, 1.0);
    let given = CompensationSettings { withdraw: false, band: 0.0, ..usual };
    PidAdvancedSettings { compensation: Some(given), ..settings }
}

struct Loop {
    pid: PidAdvanced<f64>,
    state: PidAdvancedState<f64>,
    lags: [f64; 2],
    position: BacklashState<f64>,
    noise: NoiseState,
    scans: u32,
}

impl Loop {
    fn new(settings: PidAdvancedSettings<f64>) -> Self {
        let mut state = PidAdvancedState::default();
        state.pid.mode = Mode::External;
        let pid = PidAdvanced::new(settings).unwrap();
        Self { pid, state, lags: [0.0; 2], position: BacklashState::at(0.0), noise: NoiseState::default(), scans: 0 }
    }

    /// One scan, with a load that steps every 200 s.
    fn scan(&mut self) -> f64 {
        let zero = Forward::from(0.0);
        let pv = Noise::new(0.05).unwrap().update(&mut self.noise, self.lags[1]);
        let u = self.pid.forward(&mut self.state, pv.into(), zero, zero, zero, H).value;
        self.pid.backward(&mut self.state, Backward::default());
        let load = f64::from(self.scans / 2000 % 2) * 5.0;
        let x = Backlash::new(2.0).unwrap().update(&mut self.position, u) + load;
        self.lags[0] += (x - self.lags[0]) * H / (3.0 + H);
        self.lags[1] += (self.lags[0] - self.lags[1]) * H / (1.0 + H);
        self.scans += 1;
        u
    }

    fn read(&self, name: &str) -> f64 {
        self.pid.detection().read(&self.state.detection, name).unwrap()
    }
}

#[test]
fn what_others_are_worked_out_from_is_refused_first() {
    let refused = |settings: DetectorSettings<f64>| Detector::of(&settings).unwrap_err().to_string();
    assert_eq!(refused(DetectorSettings::new(1.0, -1.0, 0.0, 1.0)), "ti = -1: must be greater than 0 s");
    assert_eq!(refused(DetectorSettings::new(1.0, 1.0, -1.0, 1.0)), "td = -1: must be 0 s or greater");
    let usual = DetectorSettings::new(1.0, 1.0, 0.0, 1.0);
    assert_eq!(refused(DetectorSettings { tf: -0.1, ..usual }), "tf = -0.1: must be 0 s or greater");
    assert_eq!(refused(DetectorSettings { pv_span: Some(0.0), ..usual }), "pv_span = 0: must be greater than 0");
    let own = PidAdvancedSettings { detector_tf: Some(-0.1), ..settings() };
    assert_eq!(PidAdvanced::new(own).unwrap_err().to_string(), "detector_tf = -0.1: must be 0 s or greater");
}

#[test]
fn a_default_of_kp_is_marked_and_its_estimate_is_not_compensated_by() {
    let spans = PidAdvancedSettings { kp: None, pv_span: Some(100.0), op_span: Some(100.0), ..settings() };
    let (mut known, mut spanned) = (Loop::new(compensating(settings())), Loop::new(compensating(spans)));
    for _ in 0..10_000 {
        for it in [&mut known, &mut spanned] {
            it.state.detection.compensate = it.scans >= 5000;
            it.scan();
        }
    }
    let read = |name| [known.read(name), spanned.read(name)];
    assert_eq!(read("kp_used"), [1.0, 1.5]);
    assert_eq!(read("kp_defaulted"), [0.0, 1.0]);
    assert_eq!(read("whole_fit"), [1.0, 0.0]);
    let last = spanned.state.detection.last.unwrap();
    assert!(last.kp_defaulted && last.parts.kp_part == last.half.delta_y / 1.5);
    // A size of 4 for a gap of 2: only an estimate that may be used brings it down.
    let size = |it: &Loop| 2.0 * it.state.detection.compensation.half;
    assert!(size(&known) < 2.5, "{}", size(&known));
    assert!((size(&spanned) - 4.0).abs() < 1e-9, "{}", size(&spanned));
    assert!(spanned.state.detection.whole.is_some());
}

#[test]
fn detections_with_a_default_are_forgotten_when_kp_becomes_known() {
    let spans = PidAdvancedSettings { kp: None, pv_span: Some(100.0), op_span: Some(100.0), ..settings() };
    let mut it = Loop::new(spans);
    for _ in 0..6000 {
        it.scan();
    }
    let before = it.state.detection.detector.estimate().unwrap();
    assert!(before.count == 9 && it.state.detection.detector.kp_defaulted());
    assert_eq!(it.state.detection.detector.window().count(), 9);
    it.pid = PidAdvanced::new(PidAdvancedSettings { kp: Some(1.0), ..spans }).unwrap();
    assert_eq!(it.read("kp_defaulted"), 1.0, "until a half-period has ended");
    let mut least = u8::MAX;
    for _ in 0..2000 {
        it.scan();
        least = least.min(it.state.detection.detector.estimate().map_or(0, |shown| shown.count));
    }
    assert_eq!((least, it.read("kp_defaulted")), (0, 0.0));
    let after = it.state.detection.detector.estimate().unwrap();
    assert!(after.value < before.value, "less by the larger Δy/Kp: {after:?}, {before:?}");
    assert_eq!(it.read("whole_fit"), 0.0, "there is no compensation");
}

#[test]
fn compensation_is_lost_where_kp_is_no_longer_known() {
    let given = compensating(PidAdvancedSettings { pv_span: Some(100.0), op_span: Some(100.0), ..settings() });
    // Half of the gap: what is left makes detections.
    let compensation = given.compensation.map(|usual| CompensationSettings { size: 1.0, limit: 1.0, ..usual });
    let given = PidAdvancedSettings { compensation, ..given };
    let mut it = Loop::new(given);
    for _ in 0..10_000 {
        it.state.detection.compensate = it.scans >= 5000;
        it.scan();
    }
    assert_eq!((it.read("whole_fit"), it.state.detection.compensation.standing), (1.0, Standing::Active));
    it.pid = PidAdvanced::new(PidAdvancedSettings { kp: None, ..given }).unwrap();
    let mut lost = false;
    for _ in 0..10_000 {
        it.scan();
        lost |= it.state.detection.compensation.standing == Standing::EstimateLost;
    }
    assert!(lost);
}

#[test]
fn a_filter_of_the_detectors_own_changes_nothing_of_what_compensation_sees() {
    for tf in [0.2, 0.0] {
        for way in [Way::Error, Way::Inverse] {
            let pid = PidSettings { tf, ..settings().pid };
            let given = CompensationSettings {
                withdraw: false,
                estimate: false,
                ..CompensationSettings::new(way, 2.0, 2.0, 1.0, 1.0)
            };
            let usual = PidAdvancedSettings { pid, compensation: Some(given), ..settings() };
            let own = PidAdvancedSettings { detector_tf: Some(4.0), ..usual };
            let (mut usual, mut own) = (Loop::new(usual), Loop::new(own));
            (usual.state.detection.compensate, own.state.detection.compensate) = (true, true);
            for scan in 0..6000 {
                assert!((usual.scan() - own.scan()).abs() < 1e-9, "tf {tf}, {way:?}, scan {scan}");
            }
            let read = |name| [usual.read(name), own.read(name)];
            assert!(usual.state.detection.compensation.u_ff != 0.0);
            assert!(read("e")[0] != read("e")[1], "the detector sees it otherwise");
            assert_eq!(read("whole_fit"), [1.0, 0.0], "2Ti is too long to compensate by");
        }
    }
}

#[test]
fn a_filter_of_the_controller_that_is_as_long_counts_too() {
    let fit = |tf| {
        let pid = PidSettings { tf, k: 1.0, ..settings().pid };
        let mut it = Loop::new(compensating(PidAdvancedSettings { pid, ..settings() }));
        for _ in 0..40_000 {
            it.scan();
        }
        assert!(it.state.detection.whole.is_some());
        it.read("whole_fit")
    };
    assert_eq!([fit(0.99), fit(1.01)], [1.0, 0.0]); // Ti/2 = 1
}

#[test]
fn the_corrected_width_is_that_of_the_last_pairs_to_the_bit() {
    for kp in [Some(1.0), None] {
        let mut it = Loop::new(PidAdvancedSettings { kp, ..settings() });
        let swing = Swing::new(2.0, 2.0, None, 1.0).unwrap();
        let (mut state, mut halves, mut compared, mut worked_off) = (SwingState::default(), Vec::new(), 0, 0);
        for _ in 0..12_000 {
            let ended = it.state.detection.last;
            let u = it.scan();
            worked_off += 1;
            if it.state.detection.last != ended {
                worked_off = 0;
                let record = it.state.detection.last.unwrap();
                let start = halves.len() as f64;
                halves.push(Half {
                    span: Span { start, end: start + 1.0 },
                    sign: record.half.sign,
                    mask: record.mask,
                    delta_y: record.half.delta_y,
                    swing: swing.end(&mut state, record.half.sign, record.half.flags),
                });
            } else if worked_off > 1 {
                let all: Vec<_> = pairs(&halves).collect();
                let found = corrected(&mut all[all.len().saturating_sub(PAIRS)..].to_vec(), kp);
                match it.pid.detection().corrected(&it.state.detection) {
                    Ok(width) => {
                        assert_eq!(Ok(width), found);
                        compared += 1;
                    }
                    Err(Doubt::NoEstimate) => {}
                    Err(doubt) => assert_eq!(Err(doubt), found),
                }
            }
            let yf = it.state.detection.detector.filtered_pv();
            swing.add(&mut state, H, it.state.pid.ysp, yf, Some(u));
        }
        assert!(kp.is_none() || compared > 1000, "{compared}");
        if kp.is_some() {
            assert!((it.read("corrected_d") - 2.0).abs() < 0.1, "{}", it.read("corrected_d"));
            assert_eq!((it.read("corrected_kp"), it.read("corrected_doubt")), (1.0, 0.0));
        }
    }
}

#[test]
fn a_default_counts_as_a_kp_that_is_not_known_to_the_corrected_width() {
    let spans = PidAdvancedSettings { kp: None, pv_span: Some(100.0), op_span: Some(100.0), ..settings() };
    let (mut spanned, mut bare) =
        (Loop::new(spans), Loop::new(PidAdvancedSettings { pv_span: None, op_span: None, ..spans }));
    let known = Loop::new(settings());
    assert_eq!(known.read("corrected_doubt"), f64::from(Doubt::NoOp as u8));
    for _ in 0..8000 {
        spanned.scan();
        bare.scan();
    }
    let doubt = |it: &Loop| it.pid.detection().corrected(&it.state.detection).map(|found| found.kp_range.is_some());
    assert_eq!(doubt(&spanned), doubt(&bare));
    assert!(doubt(&bare) != Ok(false), "never with 1.5");
    let integrating = Loop::new(PidAdvancedSettings { integrating: true, ..spans });
    assert_eq!(integrating.pid.detection().corrected(&integrating.state.detection), Err(Doubt::Integrating));
    assert!(integrating.read("kp_used").is_nan() && integrating.read("kp_defaulted") == 0.0);
}

#[test]
fn the_half_period_under_way_becomes_the_last_one() {
    let mut it = Loop::new(settings());
    let mut ended = 0;
    for _ in 0..8000 {
        let before = ["delta_t", "delta_y", "e_max", "delta_u", "kp_part"].map(|name| it.read(name));
        let last = it.state.detection.last;
        it.scan();
        if it.state.detection.last != last {
            let after = ["last_delta_t", "last_delta_y", "last_e_max", "last_delta_u", "last_kp_part"];
            assert_eq!(after.map(|name| it.read(name)), before);
            let mask = it.state.detection.last.unwrap().mask;
            assert_eq!(it.read("last_mask"), f64::from(mask));
            ended += 1;
        }
        assert!((it.read("u_fb") - it.state.pid.feedback()).abs() < 1e-12);
        assert_eq!(it.read("e"), it.state.pid.ysp - it.state.detection.detector.filtered_pv());
    }
    assert!(ended > 20);
    for (i, variable) in VARIABLES.iter().enumerate() {
        assert!(!variable.meaning.is_empty() && it.pid.detection().read(&it.state.detection, variable.name).is_some());
        assert!(VARIABLES[..i].iter().all(|other| other.name != variable.name), "twice: {}", variable.name);
    }
}
