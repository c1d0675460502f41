//! Progress of a fit, reported to the caller that waits for it.

use std::cell::Cell;
use std::sync::Mutex;

/// Takes the share of the fit that is done, 0 to 1, from any thread.
pub type Tell<'t> = &'t (dyn Fn(f64) + Sync);

/// The part of a fit that its windows are: they run side by side, and each counts as much as the others.
pub(crate) struct Windows<'t> {
    tell: Tell<'t>,
    each: f64,
    done: Mutex<f64>,
}

/// Share of the fit that its windows take by themselves; the rest joins them.
const OF_WINDOWS: f64 = 0.95;

impl<'t> Windows<'t> {
    pub(crate) fn new(count: usize, tell: Tell<'t>) -> Self {
        Self { tell, each: OF_WINDOWS / count.max(1) as f64, done: Mutex::new(0.0) }
    }

    /// Takes the share of one window that is done.
    pub(crate) fn one(&self) -> impl Fn(f64) {
        let reached = Cell::new(0.0);
        move |share| self.add(share - reached.replace(share))
    }

    /// Adds a share of one window.
    pub(crate) fn add(&self, share: f64) {
        let done = {
            let mut done = self.done.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
            *done += share * self.each;
            *done
        };
        (self.tell)(done);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_that_end_add_up() {
        let shares = Mutex::new(Vec::new());
        let tell = |share| shares.lock().unwrap().push(share);
        let windows = Windows::new(2, &tell);
        let (first, second) = (windows.one(), windows.one());
        first(0.5);
        first(1.0);
        second(1.0);
        assert_eq!(*shares.lock().unwrap(), [0.2375, 0.475, 0.95]);
    }
}
