//! The controller and the experiment whose scans are counted, and watched for allocations.

use glapp_core::modules::{PidAdvancedSettings, PidSettings};
use glapp_core::{AutoTunerSettings, CompensationSettings, Saturation, Way};

/// A controller with detector and compensation, for a process of gain 1 with lags of 3 s and 1 s.
pub fn controller() -> PidAdvancedSettings<f64> {
    let compensation = CompensationSettings {
        way: Way::Inverse,
        k: 2.0,
        size: 1.0,
        share: 1.0,
        limit: 1.0,
        band: 0.1,
        tf: 0.2,
        rate: 5.0,
        release: 2.0,
        watch: 1000.0,
        travel: 1e9,
        reversals: 1e9,
        withdraw: true,
        estimate: true,
        limits: Saturation::none(),
    };
    let pid = PidSettings { tf: 0.2, low: 0.0, high: 100.0, ..PidSettings::ideal(2.0, 2.0, 0.0) };
    PidAdvancedSettings { kp: Some(1.0), compensation: Some(compensation), ..PidAdvancedSettings::new(pid) }
}

/// A relay experiment on that process with a second of dead time.
pub fn experiment() -> AutoTunerSettings<f64> {
    AutoTunerSettings {
        amplitude: 6.0,
        hysteresis: None,
        d: 0.0,
        wait: 20.0,
        longest: 900.0,
        max_h: 0.5,
        pv: (0.0, 100.0),
        op: (0.0, 100.0),
    }
}
