//! From samples to an answer: findings on a recording, its controller's law, and the verdict on its valve.
//!
//! Nothing here reads a file or asks a clock: arrays come in, numbers and names go out, and [`words`] puts them into sentences
//! for whatever shows an answer.
//!
//! An [`Analysis`] is made of what is known of a loop and the beginning of its recording, is handed all rows, and ends in an
//! [`AnalysisResult`]. It asks, in this order:
//! [`identify`] reads the controller's law out of OP's moves. [`DataStatistics`] counts what all rows hold, and [`quality`] judges a
//! recording by it and by its first rows. [`crossings`] has the widths from zero crossings over a whole recording, and what
//! they allow to be said. [`step_test`] reads dead band and gain off steps of OP in manual. What a single signal is like, its steps, its noise, where it stands still, stands beside them.

mod analysis;
mod answer;
pub mod crossings;
mod data_statistics;
mod fitted;
mod harm;
pub mod identify;
mod inspected;
mod origin;
mod performance;
pub mod quality;
mod repair;
mod seldom;
mod signals;
pub mod step_test;
mod summary;
mod trend;
pub mod words;

pub use analysis::{Analysis, Controller, Done, INSPECTED_ROWS, Task};
pub use answer::{AnalysisResult, CorrectedAnswer, Settings};
pub use crossings::{Crossings, Ladder};
pub use data_statistics::{Counter, DataStatistics, MARKED_OP, MARKED_PV, MARKED_SP, Occurrences, Values};
pub use fitted::{
    FitAnswer, FitVerdict, FitWhy, Fitted, FittedValve, Position, Process, Signal, Window, fitted, fitted_valve,
};
pub use glapp_fit::{Cause, Judgement, Width, WidthKind};
pub use harm::{Cells as HarmCells, Harm, harm};
pub use inspected::Inspected;
pub use origin::{KP_DEFAULT, Origin, fitted_gain_serves, process_gain};
pub use performance::{Between, Performance, performance};
pub use repair::{BeforeAfter, Changed, Difference, Fall, OneWidth, before_after, fall_of};
pub use seldom::rows_to_ask_for;
pub use signals::{FROZEN_STEPS, SORTED_ROWS, frozen_steps, in_runs, median, noise_sigma, quantile, resolution};
pub use step_test::{Manual, ManualRows, StepTest, StepTestSettings};
pub use summary::{
    Acceptable, Confidence, Contradiction, Evidence, Facts, FitFacts, Health, Limit, LimitOrigin, Moves, NOMINAL_LIMIT,
    Next, NextStep, One, Part, StepTestWidth, Struck, Summary, Urgency, Valve,
};
pub use trend::{Change, WidthTrend, trend};
