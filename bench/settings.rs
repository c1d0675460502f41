//! The controller and the experiment whose scans are counted, and watched for allocations.

use glapp_core::modules::{PidAdvancedSettings, PidSettings};
use glapp_core::{AutoTunerSettings, CompensationSettings, Way};

/// A controller with detector and compensation, for a process of gain 1 with lags of 3 s and 1 s.
pub fn controller() -> PidAdvancedSettings<f64> {
    let compensation = CompensationSettings {
        band: 0.1,
        tf: 0.2,
        rate: 5.0,
        watch: 1000.0,
        travel: 1e9,
        reversals: 1e9,
        ..CompensationSettings::new(Way::Inverse, 2.0, 2.0, 1.0, 1.0)
    };
    let pid = PidSettings { tf: 0.2, low: 0.0, high: 100.0, ..PidSettings::ideal(2.0, 2.0, 0.0) };
    PidAdvancedSettings { kp: Some(1.0), compensation: Some(compensation), ..PidAdvancedSettings::new(pid) }
}

/// A relay experiment on that process with a second of dead time.
pub fn experiment() -> AutoTunerSettings<f64> {
    AutoTunerSettings {
        amplitude: 6.0,
        relay_hysteresis: None,
        d: 0.0,
        wait: 20.0,
        longest: 900.0,
        max_h: 0.5,
        pv: (0.0, 100.0),
        op: (0.0, 100.0),
    }
}
