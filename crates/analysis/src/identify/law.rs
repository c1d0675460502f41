//! The laws that may stand behind OP.

use std::rc::Rc;

use nalgebra::DVector;

use super::filter::Filter;
use super::linear::Matrix;
use super::parts::Moves;

/// A law without its values: the filter, and whether there is a D part.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Form {
    pub filter: Filter,
    pub derivative: bool,
}

/// A PI law of PV as recorded, once a sample.
pub(super) const PLAIN: Form = Form { filter: Filter { scans: true, order: 0, tf: 0.0, tfd: 0.0 }, derivative: false };

impl Form {
    /// Whether two differ in nothing but the filter's time.
    pub fn is_like(&self, other: &Self) -> bool {
        let kind = |form: &Self| (form.filter.scans, form.filter.order, form.filter.tfd > 0.0, form.derivative);
        kind(self) == kind(other)
    }

    /// This form with a filter so many times as slow.
    pub fn slower(&self, factor: f64) -> Self {
        let filter = Filter { tf: self.filter.tf * factor, tfd: self.filter.tfd * factor, ..self.filter };
        Self { filter, ..*self }
    }
}

/// PI, then PID, behind every filter with times from h/4 to h·2^`octaves`.
pub(super) fn forms(h: f64, octaves: i32) -> Vec<Form> {
    let times: Vec<f64> = (-2..=octaves.max(2)).map(|octave| h * 2f64.powi(octave)).collect();
    let mut forms = Vec::new();
    for derivative in [false, true] {
        for scans in [true, false] {
            let plain = Filter::none(scans);
            forms.push(Form { filter: plain, derivative });
            for order in [1, 2] {
                forms.extend(times.iter().map(|&tf| Form { filter: Filter { order, tf, ..plain }, derivative }));
            }
            if derivative {
                forms.extend(times.iter().map(|&tfd| Form { filter: Filter { tfd, ..plain }, derivative }));
            }
        }
    }
    forms
}

/// One law with its values, and how well it does.
pub(super) struct Law {
    pub form: Form,
    /// K, K/Ti, K Td where it has a D part, b K where SP moves.
    pub beta: DVector<f64>,
    pub moves: Rc<Moves>,
    pub residual: Vec<f64>,
    /// Weighted squares of the residual by block.
    pub loss: Vec<f64>,
    /// Sum of the costs.
    pub cost: f64,
    /// Weighted, of OP's moves and of the columns of the regression.
    pub moments: Matrix,
    /// The filter's time was sought, not given.
    pub fitted: bool,
}

impl Law {
    pub fn k(&self) -> f64 {
        self.beta[0]
    }

    pub fn ti(&self) -> f64 {
        self.beta[0] / self.beta[1]
    }

    pub fn td(&self) -> f64 {
        if self.form.derivative { self.beta[2] / self.beta[0] } else { 0.0 }
    }

    /// Whether somebody may have built such a controller.
    pub fn sane(&self) -> bool {
        let (filter, ti, td) = (&self.form.filter, self.ti(), self.td());
        let delay = f64::from(filter.order) * filter.tf;
        if self.form.derivative {
            ti > 0.0 && delay.max(2.0 * filter.tfd) <= td && td <= ti
        } else {
            ti > 0.0 && delay <= ti
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_form_once_pi_before_pid() {
        let forms = forms(0.5, 0);
        // 5 times: no filter, one lag, two lags for PI; the same and a lag before the D part for PID; two clocks.
        assert_eq!(forms.len(), 2 * (11 + 16));
        assert!(forms.iter().enumerate().all(|(k, form)| !forms[..k].contains(form)));
        assert!(forms.windows(2).all(|pair| pair[0].derivative <= pair[1].derivative));
        assert_eq!(forms[0], PLAIN);
        assert!(forms[1].is_like(&forms[2]) && !forms[0].is_like(&forms[1]));
        assert_eq!(forms[1].slower(2.0), forms[2]);
    }
}
