//! The code that a microcontroller carries, for `bench/size.py` to weigh: one controller with detector and compensation, or with
//! `--cfg experiment` one autotuner.
#![no_std]

#[cfg(not(experiment))]
pub use controller::*;
#[cfg(experiment)]
pub use experiment::*;

#[cfg(not(experiment))]
mod controller {
    use glapp_core::modules::{PidAdvanced, PidAdvancedSettings, PidAdvancedState};
    use glapp_core::{Backward, Forward, ParameterError};

    /// Bytes of a state.
    #[used]
    pub static STATE: [u8; size_of::<PidAdvancedState<f32>>()] = [0; size_of::<PidAdvancedState<f32>>()];

    /// Settings checked once.
    #[inline(never)]
    pub fn make(settings: &PidAdvancedSettings<f32>) -> Result<PidAdvanced<f32>, ParameterError> {
        PidAdvanced::new(*settings)
    }

    /// One scan.
    #[inline(never)]
    pub fn scan(
        pid: &PidAdvanced<f32>,
        state: &mut PidAdvancedState<f32>,
        inputs: &[Forward<f32>; 4],
        back: Backward<f32>,
    ) -> f32 {
        let [pv, sp, ff, by] = *inputs;
        let u = pid.forward(state, pv, sp, ff, by, 0.1);
        pid.backward(state, back);
        u.value
    }
}

#[cfg(experiment)]
mod experiment {
    use glapp_core::modules::{AutoTuner, AutoTunerState};
    use glapp_core::{AutoTunerSettings, Backward, Forward, ParameterError};

    /// Bytes of a state.
    #[used]
    pub static STATE: [u8; size_of::<AutoTunerState<f32>>()] = [0; size_of::<AutoTunerState<f32>>()];

    /// Settings checked once.
    #[inline(never)]
    pub fn make(settings: &AutoTunerSettings<f32>) -> Result<AutoTuner<f32>, ParameterError> {
        AutoTuner::new(*settings)
    }

    /// One scan.
    #[inline(never)]
    pub fn scan(
        tuner: &AutoTuner<f32>,
        state: &mut AutoTunerState<f32>,
        inputs: &[Forward<f32>; 2],
        back: Backward<f32>,
    ) -> f32 {
        let [u, pv] = *inputs;
        let op = tuner.forward(state, u, pv, 0.1);
        tuner.backward(state, back);
        op.value
    }
}
