//! The code that a microcontroller carries for one controller with detector and compensation, for `bench/size.py` to weigh.
#![no_std]

use glapp_core::modules::{PidAdvanced, PidAdvancedSettings, PidAdvancedState};
use glapp_core::{Backward, Forward, ParameterError};

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
