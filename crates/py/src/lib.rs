//! The Python face of glapp: one file per exposed module, no logic of its own.

mod analysis;
mod auto_tuner;
mod backlash;
mod blocks;
mod columns;
mod compensation;
mod data_statistics;
mod detector;
mod fit;
mod history;
mod identify;
mod lake;
mod modules;
mod noise;
mod phase_lead;
mod pid;
mod plain;
mod position;
mod quality;
mod rate_limit;
mod saturation;
mod sim;
mod step_test;
mod stiction;
mod tuning;
mod windows;
mod words;
mod wrong_sign;

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// An error of the core as Python's ValueError; `glapp` adds the loop or the file.
fn refused(error: impl std::fmt::Display) -> PyErr {
    PyValueError::new_err(error.to_string())
}

#[pymodule]
mod _glapp {
    #[pymodule_export]
    use crate::analysis::{PyAnalysis, harm_of, summary};
    #[pymodule_export]
    const ANSWER_VERSION: u32 = glapp_analysis::AnalysisResult::VERSION;
    #[pymodule_export]
    const NOMINAL_LIMIT: f64 = glapp_analysis::NOMINAL_LIMIT;
    #[pymodule_export]
    use crate::auto_tuner::{AutoTuner, stops, tuned_by};
    #[pymodule_export]
    use crate::backlash::Backlash;
    #[pymodule_export]
    use crate::blocks::{
        Correction, Derivative, HalfPeriodBlock, MedianMean, SafetyNet, SecondOrderFilter, Swing, Width, ZeroCrossing,
        doubts,
    };
    #[pymodule_export]
    use crate::compensation::{Compensation, OverCompensation, compensation_bounds, compensation_states};
    #[pymodule_export]
    use crate::detector::{PyDetector, PyHalfPeriod, filter_time, process_gain, reasons};
    #[pymodule_export]
    const DETECTIONS: u32 = glapp_core::DETECTIONS;
    #[pymodule_export]
    const DATA_GAP_STEPS: f64 = glapp_core::DATA_GAP_STEPS;
    #[pymodule_export]
    const KP_DEFAULT: f64 = glapp_core::KP_DEFAULT;
    #[pymodule_export]
    use crate::fit::{
        before_after, fit, fit_judgement, fit_thresholds, fit_valve, fit_weighed, width_fall, width_trend,
    };
    #[pymodule_export]
    use crate::history::History;
    #[pymodule_export]
    const LONG_HISTORY: usize = glapp_fit::LONG_HISTORY;
    #[pymodule_export]
    const INSPECTED_ROWS: usize = glapp_analysis::INSPECTED_ROWS;
    #[pymodule_export]
    const MOST_EPOCHS: usize = glapp_fit::MOST_EPOCHS;
    #[pymodule_export]
    use crate::identify::identified;
    #[pymodule_export]
    const R2_USABLE: f64 = glapp_analysis::identify::R2_USABLE;
    #[pymodule_export]
    const WIDEST: f64 = glapp_analysis::identify::WIDEST;
    #[pymodule_export]
    const MIN_STEPS: usize = glapp_analysis::identify::MIN_STEPS;
    #[pymodule_export]
    use crate::lake::{run_lake, run_side_by_side};
    #[pymodule_export]
    use crate::modules::{Graph, ideal_of_parallel, ideal_of_series};
    #[pymodule_export]
    use crate::noise::{Noise, NoiseLevel};
    #[pymodule_export]
    use crate::phase_lead::PhaseLead;
    #[pymodule_export]
    use crate::pid::Pid;
    #[pymodule_export]
    use crate::quality::{assumed_time, inspect, newest_first, noise_sigma, op_unit, own_times, setting_unused};
    #[pymodule_export]
    use crate::rate_limit::RateLimit;
    #[pymodule_export]
    use crate::saturation::Saturation;
    #[pymodule_export]
    use crate::sim::{PyChecked, batch, groups, instruction_sets, random_walk, run_together, valve_positions, watch};
    #[pymodule_export]
    use crate::step_test::ManualRows;
    #[pymodule_export]
    use crate::stiction::Stiction;
    #[pymodule_export]
    use crate::tuning::{
        amigo_frequency, amigo_integrating, amigo_step, lambda_integrating, lambda_tuning, point_placement, simc,
        simc_integrating, ziegler_nichols_frequency, ziegler_nichols_step,
    };
    #[pymodule_export]
    use crate::windows::Windows;
    #[pymodule_export]
    use crate::words::{catalogue, clock, count, duration, number, overview, quantity, sentence, texts_of, to_text};
    #[pymodule_export]
    use crate::wrong_sign::WrongSign;
}
