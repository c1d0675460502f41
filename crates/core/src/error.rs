//! What a block says when its parameters are out of bounds.

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

/// Gives `value` back, or the error that names it, unless `holds`.
pub(crate) fn require<R: crate::Real>(
    name: &'static str,
    value: R,
    holds: bool,
    bound: &'static str,
) -> Result<R, ParameterError> {
    if holds && value.is_number() { Ok(value) } else { Err(ParameterError { name, value: value.as_f64(), bound }) }
}
