//! The controller with the detector inside.

use super::{Inputs, Is, Kind, Module, Place, Told, Unknown, Work, compensation, open, pid};
use crate::SimError;
use glapp_core::modules::{self, Gains, PidAdvancedSettings, PidAdvancedState, SCHEDULE_ROWS};
use glapp_core::{Backward, DETECTIONS, Forward, ParameterError};

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
    ],
    beginnings: pid::BEGINNINGS,
    commands: &["mode", "sp", "manual", "compensate"],
    variables: &[pid::VARIABLES, compensation::VARIABLES, compensation::INNER],
    ..Kind::plain("PidAdvanced", |m, place| {
        let block = modules::PidAdvanced::new(settings(m)?)?;
        let (start, mode) = (m.value("start"), pid::mode(place));
        let at_rest = |y| block.at_rest(mode, y, start);
        let mut state = m.known("start_pv").map_or(PidAdvancedState::at(start), at_rest);
        state.pid.mode = mode;
        Ok(Box::new(PidAdvanced { block, state }))
    })
};

struct PidAdvanced {
    block: modules::PidAdvanced<f64>,
    state: PidAdvancedState<f64>,
}

fn settings(m: &Module) -> Result<PidAdvancedSettings<f64>, ParameterError> {
    let mut schedule = [Gains::default(); SCHEDULE_ROWS];
    schedule.iter_mut().zip(&m.schedule).for_each(|(to, row)| *to = *row);
    Ok(PidAdvancedSettings {
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
        compensation: compensation::settings(m)?,
    })
}

impl Work for PidAdvanced {
    fn forward(&mut self, &[pv, sp, ff, by]: &Inputs, h: f64) -> Forward<f64> {
        self.block.forward(&mut self.state, pv, sp, ff, by, h)
    }

    fn backward(&mut self, back: Option<Backward<f64>>) -> Told {
        let (sp, ff) = self.block.backward(&mut self.state, back.unwrap_or_default());
        [open(), sp, ff, open()]
    }

    fn change(&mut self, to: &Module, _place: Place) -> Result<(), SimError> {
        compensation::not_taken_away(to, &self.state.detection)?;
        self.block = modules::PidAdvanced::new(settings(to)?)?;
        Ok(())
    }

    fn get(&self, name: &str) -> Option<f64> {
        match name {
            "error" => Some(self.state.error().into()),
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
            _ => pid::commanded(&mut self.state.pid, name, value),
        }
    }

    fn window(&self) -> Option<Vec<f64>> {
        Some(self.state.detection.detector.window().collect())
    }

    fn reset_detection(&mut self) -> bool {
        self.state.detection.reset();
        true
    }
}
