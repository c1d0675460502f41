//! Error of a block with parameters out of bounds.

/// A parameter that a block cannot work with: its name, its value and the bound it breaks.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("{name} = {value}: must be {bound}")]
pub struct ParameterError {
    /// The parameter's name, as the block's constructor has it.
    pub name: &'static str,
    /// The value that was given.
    pub value: f64,
    /// The bound in words, such as "greater than 0 s".
    pub bound: &'static str,
}

/// The parameters' names in the order of their numbers, which begin at 1. A name that goes keeps its place: controllers show the
/// number (`ErrorID`). `h` and `pv` are none: they stand for a scan time, and for a signal, that stays bad.
pub const PARAMETERS: [&str; 83] = [
    "k", "ti", "td", "b", "kp", "tf", "n", "max_h", "op_low", "op_high", "op_span", "h", "pv_span", "size", "share",
    "limit", "band", "rate", "release", "travel", "reversals", "watch", "c", "low", "high", "amplitude",
    "relay_hysteresis", "d", "wait", "longest", "pv_low", "pv_high", "lead", "lag", "detector_tf", "sp_rate",
    "ramp_time", "delay", "tolerance", "gain", "t1", "t2", "dead_time", "way", "source", "rows", "at of row 1",
    "k of row 1", "ti of row 1", "td of row 1", "at of row 2", "k of row 2", "ti of row 2", "td of row 2",
    "at of row 3", "k of row 3", "ti of row 3", "td of row 3", "at of row 4", "k of row 4", "ti of row 4",
    "td of row 4", "at of row 5", "k of row 5", "ti of row 5", "td of row 5", "at of row 6", "k of row 6",
    "ti of row 6", "td of row 6", "at of row 7", "k of row 7", "ti of row 7", "td of row 7", "at of row 8",
    "k of row 8", "ti of row 8", "td of row 8", "push", "hold", "period", "far", "pv",
];

impl ParameterError {
    /// The parameter's number in [`PARAMETERS`]; none where it has none.
    ///
    /// ```
    /// let error = glapp_core::MedianMean::new(4).unwrap_err();
    /// assert_eq!((error.name, error.number()), ("n", Some(7)));
    /// ```
    pub fn number(&self) -> Option<u16> {
        (1..).zip(PARAMETERS).find(|(_, name)| *name == self.name).map(|(number, _)| number)
    }
}

/// Gives `value` back, or the error that names it, unless `holds`.
pub(crate) fn require<R: crate::Real>(
    name: &'static str,
    value: R,
    holds: bool,
    bound: &'static str,
) -> Result<R, ParameterError> {
    if holds && value.is_number() { Ok(value) } else { Err(ParameterError { name, value: value.as_f64(), bound }) }
}
