//! Why a simulation cannot be run, or cannot be believed.

use crate::GraphError;
use glapp_core::ParameterError;

/// Error of a simulation.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SimError {
    /// A parameter out of its bounds.
    #[error(transparent)]
    Parameter(#[from] ParameterError),
    /// A name that is not in the test batch.
    #[error("plant '{0}' is not in the test batch: write P1 to P8, or (num, den, dead_time)")]
    UnknownPlant(String),
    /// A transfer function that is none.
    #[error("plant: {0}")]
    Plant(&'static str),
    /// The output would act on the sample that it is computed from.
    #[error(
        "plant with num of degree {num} over den of degree {den}: num must be of lower degree, since the controller \
         cannot act on the sample that it is computing from"
    )]
    Improper {
        /// Degree of the numerator.
        num: usize,
        /// Degree of the denominator.
        den: usize,
    },
    /// Samples too far apart to show what the plant does.
    #[error(
        "h = {h} s is too coarse for the fastest pole: at most {bound:.3} s, or its motion is lost between samples"
    )]
    Coarse {
        /// The step that was asked for \[s\].
        h: f64,
        /// π over the magnitude of the fastest pole \[s\].
        bound: f64,
    },
    /// A setpoint or load given in the wrong shape.
    #[error("{name}: {what}")]
    Signal {
        /// Name of the signal.
        name: &'static str,
        /// Error in words.
        what: String,
    },
    /// A loop that cannot be at rest where it is asked to begin.
    #[error("the loop begins at rest, and the first setpoint with the first load needs OP = {op}: {why}")]
    NoRest {
        /// The output needed.
        op: f64,
        /// Why it cannot be.
        why: &'static str,
    },
    /// Modules that make no loop.
    #[error(transparent)]
    Modules(Box<GraphError>),
    /// An element that the modules do not have, in a loop with compensation.
    #[error("{0}: cannot be simulated together with compensation")]
    NotOnModules(&'static str),
    /// A closed loop that runs away.
    #[error(
        "unstable closed loop: {signal} went beyond ±{bound:.3e}, a million times what setpoint, load and noise ask for, \
         at t = {t:.3} s"
    )]
    Unstable {
        /// The signal that ran away first.
        signal: &'static str,
        /// The magnitude that it passed.
        bound: f64,
        /// Time \[s\].
        t: f64,
    },
}

impl From<GraphError> for SimError {
    /// The error of a loop that a scenario has built: its parameters are the scenario's own, whatever module they are in.
    fn from(error: GraphError) -> Self {
        match error {
            GraphError::Parameter { error, .. } => error,
            other => Self::Modules(Box::new(other)),
        }
    }
}

/// Gives `value` back, or the error that names it, unless it is a number and `holds`.
pub(crate) fn require(name: &'static str, value: f64, holds: bool, bound: &'static str) -> Result<f64, ParameterError> {
    if holds && value.is_finite() { Ok(value) } else { Err(ParameterError { name, value, bound }) }
}
