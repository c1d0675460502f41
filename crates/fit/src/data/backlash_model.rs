//! The lost motion that is tried.

use glapp_core::Model;
use serde::{Deserialize, Serialize};

/// The lost motion that is tried: total width [OP unit], the share of it that is slip jump, what the valve does after a jump,
/// and where in its gap it stands at the start of each stretch, 0 the lower end to 1.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct BacklashModel {
    pub(crate) d: f64,
    pub(crate) share: f64,
    pub(crate) model: Model,
    pub(crate) start: Vec<f64>,
}

impl BacklashModel {
    /// A gap in whose middle the valve stands.
    pub(crate) fn gap(d: f64, stretches: usize) -> Self {
        Self { d, share: 0.0, model: Model::Kano, start: vec![0.5; stretches] }
    }

    /// Slip jump J [OP unit].
    pub(crate) fn jump(&self) -> f64 {
        self.share * self.d
    }
}
