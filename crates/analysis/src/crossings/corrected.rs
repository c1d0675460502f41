//! The width with the bias of (2.4) taken out, or why there is none.

use super::Crossings;
use glapp_core::{Corrected, Doubt, Half, LONGEST_WINDOW, NOISE_SPAN, Pair, corrected, pairs};
use serde::Serialize;

/// Longest filter of PV, in Td (or Ti without a derivative part), behind which OP's turns can be worked out by (4.1).
const SMOOTH: f64 = 0.2;

/// Source of OP's travel between two turns.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub enum Travel {
    /// OP as recorded.
    #[serde(rename = "op")]
    Op,
    /// OP as (4.1) makes it of SP and PV.
    #[serde(rename = "(4.1)")]
    Law,
}

/// Facts that the half-periods do not hold.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Beside {
    /// Process gain [PV unit/OP unit], where it is known; none for an assumed one.
    pub kp: Option<f64>,
    /// Source of OP's travel.
    pub travel: Travel,
    /// Standard deviation of OP's fast noise [OP unit], where it can be measured.
    pub op_noise: Option<f64>,
    /// Whether the process integrates.
    pub integrating: bool,
}

/// Why there is no corrected width.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(tag = "code", content = "of", rename_all = "snake_case")]
pub enum NotCorrected {
    /// The half-periods do not tell.
    Doubt(Doubt),
    /// The width found [OP unit] is less than what noise moves OP by.
    Noise {
        /// Width [OP unit].
        d: f64,
        /// [OP unit].
        noise: f64,
    },
    /// OP is not recorded, and PV filtered with `tf` \[s\] is too smooth to work out its turns.
    Smooth {
        /// \[s\].
        tf: f64,
    },
    /// An integrating process does not come to rest off SP.
    Integrating,
    /// No estimate to correct.
    NoEstimate,
}

impl Crossings {
    /// The width by [`corrected`] from the swings that were kept, and the number of pairs of half-periods.
    pub fn corrected(&self, beside: &Beside) -> (usize, Result<Corrected<f64>, NotCorrected>) {
        let halves: Vec<Half<f64>> = self
            .rows()
            .iter()
            .map(|row| Half {
                span: row.span,
                sign: row.record.half.sign,
                mask: row.record.mask,
                delta_y: row.record.half.delta_y,
                swing: row.swing.unwrap_or_default(),
            })
            .collect();
        let all: Vec<Pair<f64>> = pairs(&halves).collect();
        let mut pairs = all[all.len().saturating_sub(LONGEST_WINDOW)..].to_vec();
        let found = corrected(&mut pairs, beside.kp).map_err(NotCorrected::Doubt);
        (pairs.len(), self.credible(found, beside))
    }

    /// The corrected width, or the reason why it cannot be right.
    fn credible(
        &self,
        found: Result<Corrected<f64>, NotCorrected>,
        beside: &Beside,
    ) -> Result<Corrected<f64>, NotCorrected> {
        let settings = self.settings();
        let derivative = settings.td.filter(|td| *td > 0.0);
        if beside.integrating {
            return Err(NotCorrected::Integrating);
        }
        match beside.travel {
            Travel::Law if settings.tf > 1.001 * SMOOTH * derivative.unwrap_or(settings.ti) => {
                Err(NotCorrected::Smooth { tf: settings.tf })
            }
            Travel::Op => {
                let noise = beside.op_noise.map_or(0.0, |sigma| NOISE_SPAN * sigma);
                found.and_then(|found| match found.d < noise {
                    true => Err(NotCorrected::Noise { d: found.d, noise }),
                    false => Ok(found),
                })
            }
            Travel::Law => found,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glapp_core::DetectorSettings;

    #[test]
    fn behind_a_filter_of_a_fifth_of_ti_or_td_turns_of_op_cannot_be_worked_out() {
        let beside = Beside { kp: None, travel: Travel::Law, op_noise: None, integrating: false };
        let smooth = |tf: f64, td: f64| {
            let crossings =
                Crossings::new(DetectorSettings { tf, ..DetectorSettings::new(0.5, 30.0, td, 1.0) }).unwrap();
            crossings.corrected(&beside).1 == Err(NotCorrected::Smooth { tf })
        };
        assert!(!smooth(6.0, 0.0) && smooth(6.1, 0.0), "a fifth of Ti");
        assert!(!smooth(2.0, 10.0) && smooth(2.1, 10.0), "a fifth of Td");
    }
}
