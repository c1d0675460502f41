//! Properties of the detector on any signal.

use glapp_core::status::{AT_HIGH, AT_LOW, BAD, DATA_GAP, NOT_AUTO};
use glapp_core::{
    Columns, Detector, DetectorState, HalfPeriodResult, LANES, Lanes, MedianMean, Real, Reason, SafetyNet, Sample,
    SecondOrderFilter, Span, Width,
};
use glapp_lanes::{Instructions, Sided};
use proptest::prelude::*;

/// A recording.
#[derive(Clone, Debug, Default, PartialEq)]
struct Rows {
    t: Vec<f64>,
    sp: Vec<f64>,
    pv: Vec<f64>,
    op: Vec<f64>,
    flags: Vec<u8>,
}

impl Rows {
    fn columns(&self, from: usize, to: usize) -> Columns<'_, f64> {
        Columns {
            t: &self.t[from..to],
            sp: &self.sp[from..to],
            pv: &self.pv[from..to],
            op: Some(&self.op[from..to]),
            flags: Some(&self.flags[from..to]),
        }
    }

    fn len(&self) -> usize {
        self.t.len()
    }

    fn map(&self, t: f64, signals: f64, op: f64) -> Self {
        let scaled = |column: &[f64], by: f64| column.iter().map(|x| x * by).collect();
        Self {
            t: scaled(&self.t, t),
            sp: scaled(&self.sp, signals),
            pv: scaled(&self.pv, signals),
            op: scaled(&self.op, op),
            flags: self.flags.clone(),
        }
    }
}

#[derive(Clone, Copy, Debug)]
struct Settings {
    k: f64,
    ti: f64,
    td: Option<f64>,
    b: f64,
    kp: Option<f64>,
    tf: f64,
    n: u32,
    max_h: f64,
    op_span: Option<f64>,
    op_limits: Option<(f64, f64)>,
}

impl Settings {
    fn detector<R: Real>(&self) -> Detector<R> {
        let of = |x: f64| R::of(x);
        Detector::new(
            SecondOrderFilter::new(of(self.tf)).unwrap(),
            Width::new(of(self.k), of(self.ti), self.td.map(of), of(self.b), self.kp.map(of)).unwrap(),
            SafetyNet::new(self.op_span.map(of)).unwrap(),
            MedianMean::new(self.n).unwrap(),
            of(self.max_h),
            self.op_limits.map(|(low, high)| (of(low), of(high))),
        )
        .unwrap()
    }
}

fn settings() -> impl Strategy<Value = Settings> {
    let td = prop_oneof![Just(None), Just(Some(0.0)), Just(Some(0.5))];
    let limits = prop_oneof![Just(None), Just(Some((-2.0, 2.0)))];
    (td, 0.0..=1.0, any::<bool>(), prop_oneof![Just(0.0), 0.01..2.0], 0u32..3, limits, any::<bool>()).prop_map(
        |(td, b, kp, tf, n, op_limits, span)| Settings {
            k: 0.5,
            ti: 1.0,
            td,
            b,
            kp: kp.then_some(2.0),
            tf,
            n: 2 * n + 1,
            max_h: 3.0,
            op_span: span.then_some(4.0),
            op_limits,
        },
    )
}

/// Limit cycles in noise: nearly square PV, triangular OP, setpoint steps, an irregular clock in 1/64 s.
fn cycles() -> impl Strategy<Value = Rows> {
    let half = (1usize..40, 0.05f64..1.0, -0.05f64..0.05, 1u32..40, prop::bool::weighted(0.1), 0u8..60);
    (prop::collection::vec(half, 1..25), any::<u32>()).prop_map(|(halves, seed)| {
        let mut rows = Rows::default();
        let (mut t, mut sp, mut op, mut side) = (0.0, 1.0, 0.0, 1.0);
        let mut noise = seed;
        for (length, size, drift, ticks, moves, flag) in halves {
            if moves {
                sp += drift * 4.0;
            }
            for i in 0..length {
                noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                t += f64::from(1 + (ticks * (i as u32 + 1)) % 64) / 64.0;
                op += side * drift;
                rows.t.push(t);
                rows.sp.push(sp);
                rows.pv.push(sp - side * size + f64::from(noise >> 8) / 1e8);
                rows.op.push(op);
                let mark = if i == length / 2 { [0, NOT_AUTO, AT_LOW, AT_HIGH][usize::from(flag.min(3))] } else { 0 };
                rows.flags.push(if flag < 4 { mark as u8 } else { 0 });
            }
            side = -side;
        }
        rows
    })
}

/// Anything that a recording may hold.
fn rubbish() -> impl Strategy<Value = f64> {
    let special = [
        f64::NAN,
        f64::INFINITY,
        f64::NEG_INFINITY,
        f64::MAX,
        -f64::MAX,
        1e300,
        f64::MIN_POSITIVE,
        5e-324,
        0.0,
        -0.0,
        -1.0,
    ];
    prop_oneof![3 => prop::sample::select(special.to_vec()), 1 => any::<f64>(), 1 => -1e3..1e3]
}

/// A recording with rubbish in some places.
fn spoiled() -> impl Strategy<Value = Rows> {
    let faults = prop::collection::vec((any::<prop::sample::Index>(), 0u8..5, rubbish(), any::<u8>()), 0..12);
    (cycles(), faults).prop_map(|(mut rows, faults)| {
        for (place, column, value, flags) in faults {
            let i = place.index(rows.len());
            match column {
                0 => rows.t[i] = value,
                1 => rows.sp[i] = value,
                2 => rows.pv[i] = value,
                3 => rows.op[i] = value,
                _ => rows.flags[i] = flags & (NOT_AUTO | BAD | AT_LOW | AT_HIGH) as u8,
            }
        }
        rows
    })
}

/// Spoiled rows with a gap in time, and a PV that is held for a while.
fn interrupted() -> impl Strategy<Value = Rows> {
    let gap = prop::option::of(any::<prop::sample::Index>());
    let held = prop::option::of((any::<prop::sample::Index>(), 1..40_usize));
    (spoiled(), gap, held).prop_map(|(mut rows, gap, held)| {
        if let Some(place) = gap {
            let i = place.index(rows.len());
            rows.t[i..].iter_mut().for_each(|t| *t += 10.0);
        }
        if let Some((place, n)) = held {
            let i = place.index(rows.len());
            let pv = rows.pv[i];
            rows.pv[i..].iter_mut().take(n).for_each(|x| *x = pv);
        }
        rows
    })
}

type Found = (Span, HalfPeriodResult<f64>);

fn run(settings: &Settings, state: &mut DetectorState<f64>, columns: Columns<'_, f64>) -> Vec<Found> {
    let mut found = Vec::new();
    settings.detector().run(state, columns, |span, record| found.push((span, *record)), |_, _| ());
    found
}

/// PV about SP for as long as it takes to know its noise for good.
fn calm() -> Rows {
    let n = 1100;
    let pv = |k: u32| 1.0 + f64::from(k.wrapping_mul(2_654_435_761) >> 8) / 1e8 - 0.08;
    Rows {
        t: (0..n).map(|k| f64::from(k) - f64::from(n)).collect(),
        sp: vec![1.0; n as usize],
        pv: (0..n).map(pv).collect(),
        op: vec![0.0; n as usize],
        flags: vec![0; n as usize],
    }
}

/// Loops to run side by side.
struct Side<'a, 'b> {
    detectors: &'a [Detector<f64>; LANES],
    states: &'a mut [DetectorState<f64>; LANES],
    columns: [Columns<'b, f64>; LANES],
    found: &'a mut [Vec<Found>],
}

impl Sided for Side<'_, '_> {
    fn with(self, like: impl Lanes) {
        let Self { detectors, states, columns, found } = self;
        Detector::run_together(like, detectors, states, &columns, |l, span, record| found[l].push((span, *record)));
    }
}

fn whole(settings: &Settings, rows: &Rows) -> (Vec<Found>, DetectorState<f64>) {
    let mut state = DetectorState::default();
    let found = run(settings, &mut state, rows.columns(0, rows.len()));
    (found, state)
}

/// Text that tells apart all bits, and lets NaN equal itself.
fn bits(value: &impl std::fmt::Debug) -> String {
    format!("{value:?}")
}

fn numbers(record: &HalfPeriodResult<f64>) -> Vec<f64> {
    let (half, parts) = (&record.half, &record.parts);
    let mut all = vec![
        half.delta_t, half.delta_y, half.e_max, half.delta_sp, half.sp_change, half.slope_change, half.op_change,
        parts.delta_u, parts.delta_u_d, parts.delta_u_sp, parts.op_travel, parts.free, parts.kp_part, parts.d,
    ];
    all.extend(record.previous_delta_y);
    all.extend(record.d_hat_before);
    if let Some(shown) = record.estimate {
        all.extend([shown.value, shown.low, shown.high]);
    }
    all
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, ..ProptestConfig::default() })]

    #[test]
    fn sign_does_not_matter(settings in settings(), rows in cycles()) {
        let settings = Settings { op_limits: None, ..settings };
        let (found, _) = whole(&settings, &rows);
        let (turned, _) = whole(&settings, &rows.map(1.0, -1.0, -1.0));
        prop_assert_eq!(found.len(), turned.len());
        for ((_, a), (_, b)) in found.iter().zip(&turned) {
            prop_assert_eq!(a.half.sign, -b.half.sign);
            prop_assert_eq!((a.parts, a.mask, a.estimate), (b.parts, b.mask, b.estimate));
        }
    }

    #[test]
    fn direct_action_with_op_turned_is_the_same(settings in settings(), rows in cycles()) {
        let settings = Settings { op_limits: None, ..settings };
        let (found, _) = whole(&settings, &rows);
        let direct = Settings { k: -settings.k, ..settings };
        let (turned, _) = whole(&direct, &rows.map(1.0, 1.0, -1.0));
        prop_assert_eq!(found.len(), turned.len());
        for ((_, a), (_, b)) in found.iter().zip(&turned) {
            prop_assert_eq!((a.parts, a.mask, a.estimate), (b.parts, b.mask, b.estimate));
        }
    }

    #[test]
    fn units_do_not_matter(settings in settings(), rows in cycles(), t in -6i32..6, y in -6i32..6, u in -6i32..6) {
        let (t, y, u) = (2.0f64.powi(t), 2.0f64.powi(y), 2.0f64.powi(u));
        let (found, _) = whole(&settings, &rows);
        let scaled = Settings {
            k: settings.k * u / y,
            ti: settings.ti * t,
            td: settings.td.map(|td| td * t),
            b: settings.b,
            kp: settings.kp.map(|kp| kp * y / u),
            tf: settings.tf * t,
            n: settings.n,
            max_h: settings.max_h * t,
            op_span: settings.op_span.map(|span| span * u),
            op_limits: settings.op_limits.map(|(low, high)| (low * u, high * u)),
        };
        let (other, _) = whole(&scaled, &rows.map(t, y, u));
        prop_assert_eq!(found.len(), other.len());
        for ((_, a), (_, b)) in found.iter().zip(&other) {
            prop_assert_eq!(a.half.delta_t * t, b.half.delta_t);
            prop_assert_eq!(a.half.delta_y * y, b.half.delta_y);
            prop_assert_eq!(a.parts.d * u, b.parts.d);
            prop_assert_eq!(a.parts.op_travel * u, b.parts.op_travel);
            prop_assert_eq!((a.mask, a.estimate.map(|e| e.value * u)), (b.mask, b.estimate.map(|e| e.value)));
        }
    }

    #[test]
    fn in_pieces_as_in_one(settings in settings(), rows in spoiled(), mut cuts in prop::collection::vec(any::<prop::sample::Index>(), 0..9)) {
        let (found, end) = whole(&settings, &rows);
        let mut places: Vec<usize> = cuts.drain(..).map(|cut| cut.index(rows.len() + 1)).collect();
        places.extend([0, rows.len()]);
        places.sort_unstable();
        let mut state = DetectorState::default();
        let mut pieces = Vec::new();
        for pair in places.windows(2) {
            pieces.extend(run(&settings, &mut state, rows.columns(pair[0], pair[1])));
        }
        prop_assert_eq!(bits(&pieces), bits(&found));
        prop_assert_eq!(bits(&state), bits(&end));
    }

    #[test]
    fn side_by_side_as_alone(
        loops in prop::collection::vec((settings(), interrupted(), any::<bool>()), LANES),
        with_op in 0..4_usize,
        warm in 0..9_usize,
        cut in any::<prop::sample::Index>(),
    ) {
        let columns = |l: usize, from: usize, to: usize| {
            let (_, rows, flags) = &loops[l];
            let all = rows.columns(from.min(rows.len()), to.min(rows.len()));
            // All have OP, all but one, or none.
            Columns { op: all.op.filter(|_| with_op > 1 || (with_op == 1 && l > 0)), flags: all.flags.filter(|_| *flags), ..all }
        };
        let detectors = std::array::from_fn(|l| loops[l].0.detector());
        // Most know their noise already, as a loop does that goes on in its lane.
        let before = calm();
        let begun: [_; LANES] = std::array::from_fn(|l| {
            let mut state = DetectorState::default();
            if l < warm {
                let op = columns(l, 0, 0).op.map(|_| &before.op[..]);
                run(&loops[l].0, &mut state, Columns { op, ..before.columns(0, before.len()) });
            }
            state
        });
        let alone: Vec<_> = (0..LANES).map(|l| {
            let mut state = begun[l];
            let found = run(&loops[l].0, &mut state, columns(l, 0, usize::MAX));
            (bits(&found), bits(&state))
        }).collect();
        // Cut somewhere in the first of them.
        let cut = cut.index(loops[0].1.len() + 1);
        'sets: for instructions in Instructions::available() {
            let (mut states, mut found) = (begun, vec![Vec::new(); LANES]);
            for (from, to) in [(0, cut), (cut, usize::MAX)] {
                let columns = std::array::from_fn(|l| columns(l, from, to));
                let side = Side { detectors: &detectors, states: &mut states, columns, found: &mut found };
                if !instructions.side_by_side(side) {
                    continue 'sets; // no lanes with these
                }
            }
            for l in 0..LANES {
                prop_assert_eq!((bits(&found[l]), bits(&states[l])), alone[l].clone(), "{} with {}", l, instructions.name());
            }
        }
    }

    #[test]
    fn one_sample_a_call_as_in_one(settings in settings(), rows in spoiled()) {
        let (found, end) = whole(&settings, &rows);
        let detector = settings.detector();
        let mut state = DetectorState::default();
        let mut singles = Vec::new();
        let mut before = rows.t[0];
        for i in 0..rows.len() {
            // A time that is not a number stands for the one before it.
            let h = rows.t[i] - before;
            let sample = Sample { h, sp: rows.sp[i], pv: rows.pv[i], op: Some(rows.op[i]), flags: rows.flags[i].into() };
            singles.extend(detector.update(&mut state, &sample));
            before = if rows.t[i].is_finite() { rows.t[i] } else { before };
        }
        let records: Vec<_> = found.iter().map(|(_, record)| record).collect();
        prop_assert_eq!(bits(&singles.iter().collect::<Vec<_>>()), bits(&records));
        prop_assert_eq!(state.estimate(), end.estimate());
    }

    #[cfg(feature = "serde")]
    #[test]
    fn an_interruption_changes_nothing(settings in settings(), rows in spoiled(), cut in any::<prop::sample::Index>()) {
        let (found, end) = whole(&settings, &rows);
        let cut = cut.index(rows.len() + 1);
        let mut state = DetectorState::default();
        let mut parts = run(&settings, &mut state, rows.columns(0, cut));
        let saved = serde_json::to_string(&state).unwrap();
        let mut restored = serde_json::from_str(&saved).unwrap();
        parts.extend(run(&settings, &mut restored, rows.columns(cut, rows.len())));
        prop_assert_eq!(bits(&parts), bits(&found));
        prop_assert_eq!(bits(&restored), bits(&end));
    }

    #[test]
    fn rubbish_never_becomes_a_number(settings in settings(), rows in spoiled()) {
        let (found, end) = whole(&settings, &rows);
        for (_, record) in &found {
            for number in numbers(record) {
                prop_assert!(number.is_finite(), "{:?}", record);
            }
            prop_assert_eq!(record.reason(), Reason::first(record.mask));
            prop_assert_eq!(record.mask == 0, record.reason() == Reason::Accepted);
            let bit_of = |flag, reason: Reason| (record.half.flags & flag != 0) == (record.mask & reason.bit() != 0);
            prop_assert!(bit_of(DATA_GAP, Reason::Gap) && bit_of(BAD, Reason::BadQuality) && bit_of(NOT_AUTO, Reason::NotAuto));
        }
        if let Some(shown) = end.estimate() {
            prop_assert!(shown.value.is_finite() && shown.kept <= shown.count);
        }
    }

    #[test]
    fn every_sample_belongs_to_one_record(settings in settings(), rows in spoiled()) {
        let (found, mut state) = whole(&settings, &rows);
        let mut before = rows.t[0];
        let mut repeated = 0;
        for &t in &rows.t[1..] {
            repeated += usize::from(t - before == 0.0);
            before = if t.is_finite() { t } else { before };
        }
        // A step back ends the half-period that is open.
        let sample = Sample { h: -1.0, sp: 0.0, pv: 0.0, op: Some(0.0), flags: 0 };
        let open = settings.detector().update(&mut state, &sample).expect("an open half-period").half.n as usize;
        let ended: usize = found.iter().map(|(_, record)| record.half.n as usize).sum();
        prop_assert_eq!(ended + open + repeated, rows.len());
    }

    #[test]
    fn rubbish_leaves_no_trace(settings in settings(), before in spoiled(), rows in cycles()) {
        let mut state = DetectorState::default();
        run(&settings, &mut state, before.columns(0, before.len()));
        // Another recording after a gap: as from a detector freshly made, but for what the window remembers.
        let found = run(&settings, &mut state, rows.map(1.0, 1.0, 1.0).columns_at(1e6).columns(0, rows.len()));
        let (fresh, _) = whole(&settings, &rows.columns_at(1e6));
        let tail = &found[found.len() - fresh.len()..];
        prop_assert!(found.len() - fresh.len() <= 1);
        for ((span, record), (fresh_span, fresh)) in tail.iter().zip(&fresh) {
            prop_assert_eq!(span, fresh_span);
            prop_assert_eq!((record.half, record.parts), (fresh.half, fresh.parts));
            prop_assert_eq!(record.previous_delta_y, fresh.previous_delta_y);
        }
    }

    #[test]
    fn what_rests_is_silent(settings in settings(), sp in -1e3f64..1e3, pv in -1e3f64..1e3, op in -1e3f64..1e3) {
        for pv in [pv, sp] {
            let rows = Rows {
                t: (0..300).map(f64::from).collect(),
                sp: vec![sp; 300],
                pv: vec![pv; 300],
                op: vec![op; 300],
                flags: vec![0; 300],
            };
            let (found, state) = whole(&settings, &rows);
            prop_assert!(found.is_empty() && state.estimate().is_none());
        }
    }

    /// REAL against LREAL: as long as no decision falls otherwise, numbers agree to 1e-3 of their size or of 1. A decision on
    /// the edge may: at most one half-period in five differs.
    #[test]
    fn single_precision_follows_double(settings in settings(), rows in cycles()) {
        let narrow = settings.detector::<f32>();
        let wide = settings.detector::<f64>();
        let (mut narrow_state, mut wide_state) = (DetectorState::default(), DetectorState::default());
        let (mut both, mut agree) = (0, 0);
        let mut before = rows.t[0];
        for i in 0..rows.len() {
            let h = rows.t[i] - before;
            before = rows.t[i];
            let (sp, pv, op, flags) = (rows.sp[i], rows.pv[i], Some(rows.op[i]), rows.flags[i]);
            let a = wide.update(&mut wide_state, &Sample { h, sp, pv, op, flags: flags.into() });
            let (sp, pv, op) = (sp as f32, pv as f32, op.map(|op| op as f32));
            let b = narrow.update(&mut narrow_state, &Sample { h: h as f32, sp, pv, op, flags: flags.into() });
            both += u32::from(a.is_some() || b.is_some());
            if let (Some(a), Some(b)) = (a, b) {
                let close = (a.parts.d - f64::from(b.parts.d)).abs() <= 1e-3 * a.parts.d.abs().max(1.0);
                agree += u32::from(close && a.half.n == b.half.n);
            }
        }
        prop_assert!(5 * (both - agree) <= both + 4, "{} of {} agree", agree, both);
    }
}

impl Rows {
    fn columns_at(&self, t: f64) -> Self {
        Self { t: self.t.iter().map(|x| x + t).collect(), ..self.clone() }
    }
}

#[test]
fn a_state_is_small() {
    assert!(size_of::<DetectorState<f64>>() <= 1024, "{}", size_of::<DetectorState<f64>>());
    assert!(size_of::<DetectorState<f32>>() <= 512, "{}", size_of::<DetectorState<f32>>());
}

#[test]
fn a_clock_that_begins_wrong_is_forgotten() {
    for wrong in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, f64::MAX, -f64::MAX] {
        let settings = Settings {
            k: 0.5,
            ti: 1.0,
            td: Some(0.0),
            b: 1.0,
            kp: None,
            tf: 0.0,
            n: 3,
            max_h: 3.0,
            op_span: None,
            op_limits: None,
        };
        let n = 200;
        let mut rows = Rows {
            t: (0..n).map(f64::from).collect(),
            sp: vec![0.0; n as usize],
            pv: (0..n).map(|k| if k / 20 % 2 == 0 { 1.0 } else { -1.0 }).collect(),
            op: vec![0.0; n as usize],
            flags: vec![0; n as usize],
        };
        rows.t[0] = wrong;
        let (found, state) = whole(&settings, &rows);
        assert_eq!(state.accepted(), 7, "{wrong}: {found:?}");
        let spans = found.iter().filter(|(_, record)| record.mask == 0);
        assert!(spans.clone().all(|(span, _)| span.end - span.start == 20.0));
    }
}

#[test]
fn what_overflows_is_bad_and_passes() {
    let settings = Settings {
        k: 0.5,
        ti: 1.0,
        td: Some(0.0),
        b: 1.0,
        kp: None,
        tf: 1.0,
        n: 3,
        max_h: 3.0,
        op_span: None,
        op_limits: None,
    };
    let n = 400;
    let ordinary = |k: usize| if (k / 40).is_multiple_of(2) { 1.0 } else { -1.0 };
    let mut rows = Rows {
        t: (0..n).map(|k| k as f64).collect(),
        sp: vec![0.0; n],
        pv: (0..n).map(ordinary).collect(),
        op: vec![0.0; n],
        flags: vec![0; n],
    };
    (rows.pv[60], rows.pv[61], rows.op[62], rows.op[63]) = (1.7e308, -1.7e308, 1.7e308, -1.7e308);
    let (found, state) = whole(&settings, &rows);
    assert!(found.iter().all(|(_, record)| numbers(record).iter().all(|x| x.is_finite())));
    assert!(found.iter().any(|(_, record)| record.mask & Reason::BadQuality.bit() != 0));
    assert_eq!(state.estimate().unwrap().count, 3);
}

/// Square waves with one number out of all proportion: in the gain, in the step that leads to a crossing, in the setpoint.
#[test]
fn numbers_that_overflow_on_the_way_are_bad_too() {
    let ordinary = Settings {
        k: 0.5,
        ti: 1.0,
        td: Some(0.5),
        b: 1.0,
        kp: None,
        tf: 0.0,
        n: 3,
        max_h: 3.0,
        op_span: None,
        op_limits: None,
    };
    let n = 400;
    let mut rows = Rows {
        t: (0..n).map(|k| k as f64).collect(),
        sp: vec![0.0; n],
        pv: (0..n).map(|k| if (k / 40).is_multiple_of(2) { 1.0 } else { -1.0 }).collect(),
        op: vec![0.0; n],
        flags: vec![0; n],
    };
    let bad = |settings: &Settings, rows: &Rows| {
        let (found, _) = whole(settings, rows);
        assert!(found.iter().all(|(_, record)| numbers(record).iter().all(|x| x.is_finite())), "{found:?}");
        found.iter().filter(|(_, record)| record.mask & Reason::BadQuality.bit() != 0).count()
    };
    assert_eq!(bad(&ordinary, &rows), 0);
    assert_eq!(bad(&Settings { k: 1.7e308, ..ordinary }, &rows), 9);
    let mut steep = rows.clone();
    steep.t[..80].iter_mut().for_each(|t| *t -= 79.0);
    steep.t[80..].iter_mut().for_each(|t| *t -= 80.0);
    steep.t[80] = 1e-310;
    assert_eq!(bad(&ordinary, &steep), 2); // the half-periods on either side of that crossing
    for k in 90..110 {
        let side = if k < 100 { 1.7e308 } else { -1.7e308 };
        (rows.sp[k], rows.pv[k]) = (side, side);
    }
    assert!(bad(&ordinary, &rows) > 0);
}
