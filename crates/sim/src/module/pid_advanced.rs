//! The controller with the detector inside.

use super::{
    BackwardSignals, Context, Inputs, Is, Kind, Module, Parameter, Unknown, Work, auto_tuner, compensation, open, pid,
    switch,
};
use crate::SimError;
use glapp_core::auto_tuner::Rule;
use glapp_core::modules::{self, Gains, PidAdvancedSettings, PidAdvancedState, SCHEDULE_ROWS};
use glapp_core::{AutoTunerSettings, Backward, DETECTIONS, Forward, ParameterError, tuning};

pub(super) static KIND: Kind = Kind {
    inputs: &["pv", "sp", "ff", "by"],
    optional: &["sp", "ff", "by"],
    is_controller: true,
    parameters: &[
        pid::PARAMETERS,
        &[
            ("kp", Unknown),
            ("pv_span", Unknown),
            ("op_span", Unknown),
            ("integrating", Is(0.0)),
            ("detector_tf", Unknown),
            ("n", Is(DETECTIONS as f64)),
            ("sp_rate", Is(f64::MAX)),
        ],
        compensation::PARAMETERS,
        TUNER,
    ],
    beginnings: pid::BEGINNINGS,
    commands: &["mode", "sp", "manual", "compensate", "tune"],
    variables: &[
        pid::VARIABLES,
        compensation::VARIABLES,
        compensation::INNER,
        &["tune_phase", "tune_stop", "tune_ku", "tune_tu", "tune_kp", "tune_kappa", "tune_k", "tune_ti", "tune_td"],
    ],
    ..Kind::plain("PidAdvanced", |m, context| {
        let block = block(m)?;
        let (start, mode) = (m.value("start"), pid::mode(context));
        let at_rest = |y| block.at_rest(mode, y, start);
        let mut state = m.known("start_pv").map_or(PidAdvancedState::at(start), at_rest);
        state.pid.mode = mode;
        Ok(Box::new(PidAdvanced { block, state, h: context.h }))
    })
};

/// Parameters of the autotuner; an amplitude of 0: there is none.
const TUNER: &[Parameter] = &[
    ("tune_amplitude", Is(0.0)),
    ("tune_wait", Unknown),
    ("tune_longest", Unknown),
    ("tune_pv_low", Unknown),
    ("tune_pv_high", Unknown),
    ("tune_relay_hysteresis", Unknown),
    ("tune_d", Is(0.0)),
    ("tune_rule", Is(Rule::PointPlacement as u8 as f64)),
];

fn tuner(m: &Module) -> Option<AutoTunerSettings<f64>> {
    let amplitude = m.value("tune_amplitude");
    (amplitude != 0.0).then(|| AutoTunerSettings {
        amplitude,
        relay_hysteresis: m.known("tune_relay_hysteresis"),
        d: m.value("tune_d"),
        wait: m.value("tune_wait"),
        longest: m.value("tune_longest"),
        // The controller's own, from here on.
        max_h: f64::NAN,
        pv: (m.value("tune_pv_low"), m.value("tune_pv_high")),
        op: (f64::NAN, f64::NAN),
    })
}

/// An error with the name that the autotuner's parameter has here.
fn named(error: ParameterError) -> ParameterError {
    const OURS: [(&str, &str); 7] = [
        ("amplitude", "tune_amplitude"),
        ("relay_hysteresis", "tune_relay_hysteresis"),
        ("d", "tune_d"),
        ("wait", "tune_wait"),
        ("longest", "tune_longest"),
        ("pv_low", "tune_pv_low"),
        ("pv_high", "tune_pv_high"),
    ];
    let ours = OURS.iter().find(|(theirs, _)| *theirs == error.name);
    ParameterError { name: ours.map_or(error.name, |(_, ours)| ours), ..error }
}

struct PidAdvanced {
    block: modules::PidAdvanced<f64>,
    state: PidAdvancedState<f64>,
    /// Scan time \[s\].
    h: f64,
}

fn block(m: &Module) -> Result<modules::PidAdvanced<f64>, ParameterError> {
    // No other part of it has a parameter of one of those names.
    modules::PidAdvanced::new(settings(m)?).map_err(named)
}

fn settings(m: &Module) -> Result<PidAdvancedSettings<f64>, ParameterError> {
    let rules = Rule::ALL.map(|rule| (f64::from(rule as u8), rule));
    let mut schedule = [Gains::default(); SCHEDULE_ROWS];
    schedule.iter_mut().zip(&m.schedule).for_each(|(to, row)| *to = *row);
    let settings = PidAdvancedSettings {
        pid: pid::settings(m),
        kp: m.known("kp"),
        pv_span: m.known("pv_span"),
        op_span: m.known("op_span"),
        integrating: m.yes("integrating")?,
        detector_tf: m.known("detector_tf"),
        n: m.whole("n")?,
        sp_rate: m.value("sp_rate"),
        schedule,
        rows: m.schedule.len(),
        compensation: None,
        tuner: tuner(m),
        rule: m.one_of("tune_rule", &rules, "1 (point placement), 2 (AMIGO PI) or 3 (AMIGO PID)")?,
    };
    let [k, ti, _] = settings.slowest();
    Ok(PidAdvancedSettings { compensation: compensation::settings_by(m, k, ti)?, ..settings })
}

impl Work for PidAdvanced {
    fn forward(&mut self, &[pv, sp, ff, by, ..]: &Inputs, h: f64) -> Forward<f64> {
        self.block.forward(&mut self.state, pv, sp, ff, by, h)
    }

    fn backward(&mut self, back: Option<Backward<f64>>) -> BackwardSignals {
        let (sp, ff) = self.block.backward(&mut self.state, back.unwrap_or_default());
        [open(), sp, ff, open(), open()]
    }

    fn change(&mut self, to: &Module, _context: Context) -> Result<(), SimError> {
        compensation::not_taken_away(to, &self.state.detection)?;
        let wanted = block(to)?;
        let running = self.state.tuner.experiment.phase.is_running();
        if running && wanted.settings().tuner.is_none() {
            let bound = "other than 0 while an experiment runs: set tune to 0 first";
            return Err(ParameterError { name: "tune_amplitude", value: 0.0, bound }.into());
        }
        self.block = wanted;
        Ok(())
    }

    fn get(&self, name: &str) -> Option<f64> {
        match name {
            "error" => Some(self.state.error().into()),
            "tune" => auto_tuner::named(&self.state.tuner, "run"),
            "tune_phase" => auto_tuner::named(&self.state.tuner, "phase"),
            "tune_stop" => auto_tuner::named(&self.state.tuner, "stop"),
            "tune_ku" => auto_tuner::named(&self.state.tuner, "ku"),
            "tune_tu" => auto_tuner::named(&self.state.tuner, "tu"),
            "tune_kp" => Some(self.state.kp.unwrap_or(f64::NAN)),
            "tune_kappa" => auto_tuner::named(&self.state.tuner, "kappa"),
            "tune_k" => Some(self.block.offered(&self.state).map_or(f64::NAN, |gains| gains.k)),
            "tune_ti" => Some(self.block.offered(&self.state).map_or(f64::NAN, |gains| gains.ti)),
            "tune_td" => Some(self.block.offered(&self.state).map_or(f64::NAN, |gains| gains.td)),
            "max_h" => Some(self.block.settings().pid.max_h),
            "detector_tf" => {
                let PidAdvancedSettings { pid, detector_tf, .. } = self.block.settings();
                let usual = if pid.tf > 0.0 { pid.tf } else { self.block.detection().settings().detector.tf };
                Some(detector_tf.unwrap_or(usual))
            }
            _ => {
                let detection = || compensation::read(self.block.detection(), &self.state.detection, name);
                pid::named(&self.state.pid, name).or_else(detection)
            }
        }
    }

    fn command(&mut self, name: &str, value: f64) -> Result<(), ParameterError> {
        match name {
            "compensate" => compensation::compensate(&mut self.state.detection, value),
            "tune" => {
                let run = switch("tune", value, "0 (end the experiment) or 1 (begin one)")?;
                if run && self.block.settings().tuner.is_none() {
                    let bound = "0: without tune_amplitude there is no autotuner here";
                    return Err(ParameterError { name: "tune", value, bound });
                }
                self.state.tuner.run = run;
                Ok(())
            }
            _ => pid::commanded(&mut self.state.pid, name, value),
        }
    }

    fn offered(&self) -> Option<Result<[(&'static str, f64); 3], ParameterError>> {
        let checked = |gains: tuning::Gains<f64>| {
            let bound = "more than two scan times: with a shorter one every scan would be a gap to the controller";
            let fits = gains.ti > 2.0 * self.h;
            let named = [("k", gains.k), ("ti", gains.ti), ("td", gains.td)];
            if fits { Ok(named) } else { Err(ParameterError { name: "tune_ti", value: gains.ti, bound }) }
        };
        Some(self.block.offered(&self.state).and_then(checked))
    }

    fn taken_over(&mut self) {
        self.state.detection.cut();
    }

    fn window(&self) -> Option<Vec<f64>> {
        Some(self.state.detection.detector.window().collect())
    }

    fn reset_detection(&mut self) -> bool {
        self.state.detection.reset();
        true
    }
}
