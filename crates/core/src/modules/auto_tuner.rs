//! The autotuner as a module between a controller and its valve.

use crate::modules::{Backward, Forward};
use crate::status::{AT_HIGH, AT_LOW, BAD, NOT_AUTO, Status};
use crate::{AutoTunerSettings, ParameterError, Real};

/// Relay experiment in a loop: a [block](crate::AutoTuner) with connections.
///
/// It stands between the controller and what follows, and takes PV on a branch of the connection that enters the controller.
/// While no experiment runs it hands everything on, both ways. While one runs the output is the relay's: the controller is
/// told [`NOT_AUTO`] with the value in effect, and goes on from there without a bump.
///
/// What comes back from the modules after it ends the experiment: a limit that is reached with `OpLimit`, somebody else at the
/// output with `NotAuto`. So does a bad PV with `BadQuality`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AutoTuner<R> {
    block: crate::AutoTuner<R>,
}

/// State of an [`AutoTuner`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct AutoTunerState<R: Real> {
    /// The experiment, and its result.
    pub experiment: crate::AutoTunerState<R>,
    /// Whether one is to run: the operator's to set. True begins one with the next scan, false ends it there with `NotAuto`.
    pub run: bool,
    /// The relay had the output in this scan.
    active: bool,
    /// Flags received backward in the last scan.
    flags: Status,
}

impl<R: Real> AutoTuner<R> {
    /// Checks the settings.
    pub fn new(settings: AutoTunerSettings<R>) -> Result<Self, ParameterError> {
        Ok(Self { block: crate::AutoTuner::new(settings)? })
    }

    /// Takes the controller's output, PV and the time since the last scan `h` \[s\]; gives the output to the valve.
    #[inline(always)]
    pub fn forward(&self, s: &mut AutoTunerState<R>, x: Forward<R>, pv: Forward<R>, h: R) -> Forward<R> {
        let running = s.experiment.phase.is_running();
        s.active = running || s.run;
        if !s.active {
            return x;
        }
        if !running {
            self.block.start(&mut s.experiment, x.value);
        }
        let backward_flags = s.flags & (AT_LOW | AT_HIGH | NOT_AUTO) | if s.run { 0 } else { NOT_AUTO };
        let quality = if pv.is_good() && (running || x.is_good()) { 0 } else { BAD };
        let op = self.block.update(&mut s.experiment, pv.value, h, backward_flags | quality);
        s.run = s.experiment.phase.is_running();
        // A bad output of the controller is no place to begin, and is handed on as it is.
        if running || x.is_good() { Forward::new(op, 0) } else { x }
    }

    /// Adds to the flags of the last scan those that the controller around it knows itself.
    #[inline(always)]
    pub(super) fn tell(&self, s: &mut AutoTunerState<R>, flags: Status) {
        s.flags |= flags;
    }

    /// Takes the backward signals of the modules after it, gives those to the controller.
    #[inline(always)]
    pub fn backward(&self, s: &mut AutoTunerState<R>, back: Backward<R>) -> Backward<R> {
        s.flags = back.flags;
        if s.active && back.flags & NOT_AUTO == 0 {
            Backward { flags: back.flags | NOT_AUTO, tracking: s.experiment.output, ..back }
        } else {
            back
        }
    }
}
