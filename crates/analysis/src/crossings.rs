//! Widths from zero crossings over a whole recording: the detector with its table, the filter times that are tried, the width
//! with its known bias taken out, and all that but the bias over a history that comes in pieces.

mod corrected;
mod history;
mod ladder;
mod table;
mod verdict;

pub use corrected::{Beside, NotCorrected, Travel};
pub use history::{Heard, History};
pub use ladder::{LADDER, Ladder};
pub use table::{Crossings, Row, SHORT_KEPT, SavedError};
pub use verdict::{Exclusion, Known, Verdict, Why, judge};
