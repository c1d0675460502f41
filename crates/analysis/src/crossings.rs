//! Widths from zero crossings over a whole recording: the detector with its table, the filter times that are tried, and the
//! width with its known bias taken out.

mod corrected;
mod ladder;
mod table;
mod verdict;

pub use corrected::{Beside, NotCorrected, Travel};
pub use ladder::{LADDER, Ladder};
pub use table::{Crossings, Row, SHORT_KEPT, SavedError};
pub use verdict::{Known, Place, Verdict, Why, judge};
