//! The filter of detections.

use crate::error::require;
use crate::{ParameterError, Real};

/// The longest window of [`MedianMean`].
pub const LONGEST_WINDOW: usize = 31;

/// Median/mean filter of detections (thesis 7.3).
///
/// 1. the median of the last N detections; 2. those outside 80–120 % of it are dropped; 3. the mean of the rest.
///
/// N is odd: with an even N no detection need lie near the median. While there are fewer than N the same filter runs
/// over those there are, and the estimate is provisional by its count; where their number is even and none lies within
/// the band, the estimate is the median itself.
///
/// Known bias: none on symmetric scatter; skew that survives the band remains.
///
/// ```
/// use glapp_core::{MedianMean, MedianMeanState};
/// let filter = MedianMean::new(3)?;
/// let mut state = MedianMeanState::default();
/// filter.update(&mut state, 5.0);
/// filter.update(&mut state, 40.0);
/// let estimate = filter.update(&mut state, 5.5);
/// assert_eq!((estimate.value, estimate.kept, estimate.count), (5.25, 2, 3)); // 40 is dropped
/// # Ok::<(), glapp_core::ParameterError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MedianMean {
    n: u8,
}

/// The last detections.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct MedianMeanState<R> {
    window: [R; LONGEST_WINDOW],
    next: u8,
    count: u8,
}

/// Output of the filter.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Estimate<R> {
    /// The mean of the detections kept [unit of d].
    pub value: R,
    /// The smallest detection kept. With `high`: repeatability, not an interval of confidence.
    pub low: R,
    /// The largest detection kept.
    pub high: R,
    /// Number of detections in the mean.
    pub kept: u8,
    /// Number of detections in the window; fewer than N: the estimate is provisional.
    pub count: u8,
}

impl<R: Real> MedianMeanState<R> {
    /// The detections in the window, the oldest first.
    pub fn detections(&self) -> impl Iterator<Item = R> {
        let Self { window, next, count } = *self;
        let (next, count) = (usize::from(next), usize::from(count).min(LONGEST_WINDOW));
        (0..count).map(move |i| window[(next + i) % count])
    }
}

impl MedianMean {
    /// A filter of the last `n` detections, odd, 1 to [`LONGEST_WINDOW`].
    pub fn new(n: u32) -> Result<Self, ParameterError> {
        let holds = n % 2 == 1 && n as usize <= LONGEST_WINDOW;
        require("n", f64::from(n), holds, "an odd number from 1 to 31")?;
        Ok(Self { n: n as u8 })
    }

    /// The length of the window.
    pub fn n(&self) -> u8 {
        self.n
    }

    /// Takes one detection; gives the estimate and how many detections stand behind it.
    pub fn update<R: Real>(&self, state: &mut MedianMeanState<R>, detection: R) -> Estimate<R> {
        // While the window is not full the next place lies behind the last; where N has grown on the way, or a state comes from
        // elsewhere, `next` may point into the window, or beyond it.
        let place = if state.count < self.n {
            state.count
        } else if state.next < self.n {
            state.next
        } else {
            0
        };
        state.window[usize::from(place)] = detection;
        state.next = place + 1;
        state.count = state.count.saturating_add(1).min(self.n);
        estimate(&state.window[..usize::from(state.count)])
    }
}

/// Mean of the detections within 80–120 % of their median.
fn estimate<R: Real>(detections: &[R]) -> Estimate<R> {
    let mut sorted = [R::ZERO; LONGEST_WINDOW];
    for (i, &x) in detections.iter().enumerate() {
        let mut at = i;
        while at > 0 && sorted[at - 1] > x {
            sorted[at] = sorted[at - 1];
            at -= 1;
        }
        sorted[at] = x;
    }
    let sorted = &sorted[..detections.len()];
    let two = R::ONE + R::ONE;
    let half = sorted.len() / 2;
    let median = if sorted.len() % 2 == 1 { sorted[half] } else { (sorted[half - 1] + sorted[half]) / two };
    let band = R::of(0.2) * median.magnitude();
    let mut result = Estimate { value: R::ZERO, low: median, high: median, kept: 0, count: sorted.len() as u8 };
    for &x in sorted {
        if (x - median).magnitude() <= band {
            if result.kept == 0 {
                result.low = x;
            }
            result.high = x;
            result.value += x;
            result.kept += 1;
        }
    }
    result.value = if result.kept == 0 { median } else { result.value / R::of(f64::from(result.kept)) };
    result
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Regression: when N had grown, the window took a place that never held a detection for one of 0.
    #[test]
    fn a_window_that_grows_holds_detections_only() {
        let (short, long) = (MedianMean::new(3).unwrap(), MedianMean::new(5).unwrap());
        let mut state = MedianMeanState::default();
        for d in [2.0, 2.1, 1.9, 2.0] {
            short.update(&mut state, d);
        }
        let estimate = long.update(&mut state, 2.0);
        assert_eq!((estimate.kept, estimate.count, estimate.low), (4, 4, 1.9));
        assert_eq!(short.update(&mut state, 2.0).count, 3);
    }
}
