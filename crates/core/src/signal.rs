//! Blocks for one signal: filters, noise, limits, and the valve with its gap and its friction.

mod backlash;
mod derivative;
mod filter;
mod friction;
mod noise;
mod noise_level;
mod phase_lead;
mod rate_limit;
mod saturation;

pub use backlash::{Backlash, BacklashState};
pub use derivative::Derivative;
pub(crate) use filter::sections;
pub use filter::{SecondOrderFilter, SecondOrderFilterState};
pub use friction::{Friction, FrictionState, Model};
pub use noise::{Noise, NoiseState};
pub use noise_level::NoiseLevel;
pub(crate) use noise_level::{HELD, LEAST_GAIN, VALUES};
pub use phase_lead::{PhaseLead, PhaseLeadState};
pub use rate_limit::{RateLimit, RateLimitState};
pub use saturation::Saturation;
