//! Closing the gap, pushing a valve that sticks, and what takes the compensation away again (thesis chapter 3, 6.5, 7.1).

mod compensation;
pub(crate) mod harm;
mod over_compensation;
mod stiction;
mod wrong_sign;

pub use compensation::{
    Bound, Compensation, CompensationSample, CompensationSettings, CompensationState, Source, Standing, Way,
};
pub use over_compensation::{OverCompensation, OverCompensationState, OverWarning};
pub use stiction::{Push, Stiction, StictionSample, StictionSettings, StictionState};
pub use wrong_sign::{WrongSign, WrongSignState};
