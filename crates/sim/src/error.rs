//! Why a simulation cannot be run, or cannot be believed.

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
    /// Samples too far apart to show the plant's dynamics.
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

/// Error in a graph of modules.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum GraphError {
    /// A parameter out of its bounds.
    #[error("{module}: {error}")]
    Parameter {
        /// The module.
        module: String,
        /// Error of the simulation.
        error: SimError,
    },
    /// No such kind of modules.
    #[error("there is no kind of modules '{kind}': {known}")]
    NoKind {
        /// The kind that was asked for.
        kind: String,
        /// All there are.
        known: String,
    },
    /// A parameter that a module cannot do without.
    #[error("{module}: {parameter} must be given")]
    Missing {
        /// The module's kind.
        module: &'static str,
        /// The parameter.
        parameter: &'static str,
    },
    /// No parameter, variable or module of that name, or not one that can be set.
    #[error("{module}: there is no '{name}' here: {known}")]
    NoName {
        /// The module.
        module: String,
        /// The name that was asked for.
        name: String,
        /// Known names.
        known: String,
    },
    /// A wire that cannot be laid.
    #[error("wire '{wire}': {what}")]
    Wire {
        /// The wire as it was written.
        wire: String,
        /// Error in words.
        what: String,
    },
    /// A module that takes no values from outside.
    #[error("{module} is a {kind}: values are handed to an Input")]
    NoInput {
        /// The module.
        module: String,
        /// Kind of the module.
        kind: &'static str,
    },
    /// A column of inputs of the wrong length.
    #[error("{module}: {values} values for {scans} scans")]
    Column {
        /// The module.
        module: String,
        /// Number of values.
        values: usize,
        /// Number of scans.
        scans: usize,
    },
    /// An input or output that leads nowhere.
    #[error("{end} is open: connect it")]
    OpenEnd {
        /// module.port.
        end: String,
    },
    /// Two signals into one input.
    #[error(
        "{input} is driven by {first} and by {second}: one input takes one signal. One valve in two loops has no width \
         that either of them could read"
    )]
    TwoSources {
        /// module.port.
        input: String,
        /// The module connected first.
        first: String,
        /// The module connected then.
        second: String,
    },
    /// Outputs that wait for one another.
    #[error("circle without a delay: {0}. A loop is closed through a ProcessSim or a Plant")]
    Circle(String),
    /// A module made for another scan time.
    #[error(
        "{module} is made for a scan time of {own} s, the graph runs at {h} s: all modules of a graph scan together"
    )]
    SampleTimes {
        /// The module.
        module: String,
        /// Scan time of the module \[s\].
        own: f64,
        /// The graph's \[s\].
        h: f64,
    },
    /// A detector in the outer loop of a cascade.
    #[error(
        "{detector} stands in the outer loop of a cascade: {inner} distorts its output before it reaches a gap, and no \
         width can be read there (thesis 8.3). Put the detector into the inner loop, a plain Pid here"
    )]
    OuterLoop {
        /// The module with the detector.
        detector: String,
        /// The controller further in.
        inner: String,
    },
    /// A detector at a controller with several valves.
    #[error(
        "{detector} watches an output that goes to {ends}: with a split range no one can tell which valve's gap is seen. \
         Put a plain Pid here"
    )]
    SplitRange {
        /// The module with the detector.
        detector: String,
        /// The valves.
        ends: String,
    },
    /// A phase lead in the loop of something that makes jumps.
    #[error(
        "{lead} and {jumping} are in the same loop: a phase lead multiplies the jumps of {what} by lead/lag (thesis 2.2). Take one \
         of them out"
    )]
    LeadWithJumps {
        /// The phase lead.
        lead: String,
        /// The module whose output jumps.
        jumping: String,
        /// Cause of the jump.
        what: &'static str,
    },
    /// A detector beside no controller.
    #[error(
        "{detector} watches no controller: connect it to the ff of the Pid beside it, or give both the same setpoint and \
         process value; beside a controller that is no module here, connect {detector}.flags, its mode and limits"
    )]
    NotWatching {
        /// The module with the detector.
        detector: String,
    },
    /// A controller of which the output is read, and not whether it is in automatic.
    #[error(
        "{detector}.{input} is connected, and {detector}.flags is not: nothing may be done beside a controller of which nobody \
         tells whether it is in automatic"
    )]
    ModeUnknown {
        /// The module with the detector.
        detector: String,
        /// Source that is connected.
        input: &'static str,
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
