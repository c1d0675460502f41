//! Communication that takes its time.

use super::{Context, Inputs, Is, Kind, Module, Required, Work};
use crate::SimError;
use crate::error::require;
use glapp_core::Forward;
use std::collections::VecDeque;

pub(super) static KIND: Kind = Kind {
    is_delay: true,
    parameters: &[&[("scans", Required), ("start", Is(0.0))]],
    beginnings: &["scans", "start"],
    ..Kind::plain("Delay", |m, _| {
        let scans = f64::from(m.whole("scans")?);
        require("scans", scans, (1.0..=10_000.0).contains(&scans), "a whole number of scans from 1 to 10000")?;
        Ok(Box::new(Delay { under_way: VecDeque::from(vec![Forward::new(m.value("start"), 0); scans as usize]) }))
    })
};

struct Delay {
    under_way: VecDeque<Forward<f64>>,
}

impl Work for Delay {
    fn output(&self) -> Forward<f64> {
        self.under_way[0]
    }

    fn forward(&mut self, &[x, ..]: &Inputs, _h: f64) -> Forward<f64> {
        let now = self.output();
        self.under_way.rotate_left(1);
        if let Some(last) = self.under_way.back_mut() {
            *last = x;
        }
        now
    }

    fn change(&mut self, _to: &Module, _context: Context) -> Result<(), SimError> {
        Ok(())
    }
}
