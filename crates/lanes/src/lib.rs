//! Which instruction sets this processor has, and work done with one of them.
//!
//! [`Instructions::run`]: work over arrays of fixed length, which the compiler turns into vector instructions as wide as the chosen set
//! has them. [`Instructions::side_by_side`]: work on eight numbers in whole registers, where the compiler would not find them. Nothing
//! is fused and no order changes, so that the bits are the same with every one.

#[cfg(target_arch = "x86_64")]
mod eight;

use glapp_core::Lanes;

/// An instruction set that the processor has; the bits do not depend on it.
#[derive(Clone, Copy, Debug)]
pub enum Instructions {
    /// Instructions of every processor of its kind: SSE2, NEON.
    Baseline,
    /// x86-64-v3: AVX2.
    #[cfg(target_arch = "x86_64")]
    V3(pulp::x86::V3),
    /// x86-64-v4: AVX-512.
    #[cfg(target_arch = "x86_64")]
    V4(pulp::x86::V4),
}

impl Instructions {
    /// The instruction sets of this processor, the widest last.
    pub fn available() -> Vec<Self> {
        #[allow(unused_mut)]
        let mut all = vec![Self::Baseline];
        #[cfg(target_arch = "x86_64")]
        {
            all.extend(pulp::x86::V3::try_new().map(Self::V3));
            all.extend(pulp::x86::V4::try_new().map(Self::V4));
        }
        all
    }

    /// The widest of this processor.
    pub fn widest() -> Self {
        Self::available().pop().unwrap_or(Self::Baseline)
    }

    /// Name of the instruction set.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Baseline => "baseline",
            #[cfg(target_arch = "x86_64")]
            Self::V3(_) => "AVX2",
            #[cfg(target_arch = "x86_64")]
            Self::V4(_) => "AVX-512",
        }
    }

    /// Does work on eight numbers side by side with it; false where it has no registers worth it, and nothing is done.
    #[must_use]
    pub fn side_by_side(self, work: impl Sided) -> bool {
        match self {
            Self::Baseline => drop(work),
            #[cfg(target_arch = "x86_64")]
            Self::V3(v3) => v3.vectorize(eight::With { work, like: eight::Eight::<_, 2>::new(v3) }),
            #[cfg(target_arch = "x86_64")]
            Self::V4(v4) => v4.vectorize(eight::With { work, like: eight::Eight::<_, 1>::new(v4) }),
        }
        !matches!(self, Self::Baseline)
    }

    /// Does work with it; what is to profit must be inlined into the work.
    pub fn run(self, work: impl pulp::NullaryFnOnce<Output = ()>) {
        match self {
            Self::Baseline => work.call(),
            #[cfg(target_arch = "x86_64")]
            Self::V3(v3) => v3.vectorize(work),
            #[cfg(target_arch = "x86_64")]
            Self::V4(v4) => v4.vectorize(work),
        }
    }
}

/// Work on numbers side by side, written for any registers.
pub trait Sided {
    /// Does it with numbers like these.
    fn with(self, like: impl Lanes);
}

pub use pulp::NullaryFnOnce;
