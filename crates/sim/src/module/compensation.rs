//! Parts shared by the two kinds with a detector: the compensation, and the detector's outputs.

use super::{Is, Module, Parameter, Unknown, switch};
use glapp_core::modules::{self, BacklashDetection, BacklashDetectionState};
use glapp_core::{CompensationSettings, ParameterError, Source, Way};

/// Parameters of [`CompensationSettings`]; without source and size there is no compensation.
pub(super) const PARAMETERS: &[Parameter] = &[
    ("comp_size", Is(0.0)),
    ("comp_fitted", Unknown),
    ("comp_source", Unknown),
    ("comp_way", Is(3.0)),
    ("comp_share", Is(1.0)),
    ("comp_limit", Unknown),
    ("comp_band", Unknown),
    ("comp_tf", Is(0.0)),
    ("comp_rate", Unknown),
    ("comp_release", Unknown),
    ("comp_watch", Unknown),
    ("comp_travel", Unknown),
    ("comp_reversals", Unknown),
    ("comp_withdraw", Is(1.0)),
    ("comp_estimate", Is(1.0)),
];

pub(super) const VARIABLES: &[&str] = &[
    "d", "reason", "d_hat", "noise_floor", "count", "detections", "whole", "u_ff", "standing", "over", "source",
    "unfit", "size", "delta", "left",
];

/// The inner variables, as the core has them.
pub(super) const INNER: &[&str] = &{
    let mut names = [""; modules::VARIABLES.len()];
    let mut i = 0;
    while i < names.len() {
        names[i] = modules::VARIABLES[i].name;
        i += 1;
    }
    names
};

pub(super) fn settings(m: &Module) -> Result<Option<CompensationSettings<f64>>, ParameterError> {
    settings_by(m, m.value("k"), m.value("ti"))
}

/// Settings with the defaults of a controller with gain `k` and integral time `ti` \[s\].
pub(super) fn settings_by(m: &Module, k: f64, ti: f64) -> Result<Option<CompensationSettings<f64>>, ParameterError> {
    let (typed, fitted) = (m.value("comp_size"), m.known("comp_fitted"));
    let sources = Source::ALL.map(|source| (f64::from(source as u8), source));
    let named = || m.one_of("comp_source", &sources, "1 (typed), 2 (fitted) or 3 (estimate)");
    let named = m.known("comp_source").map(|_| named()).transpose()?;
    let source = named.unwrap_or(if fitted.is_some() { Source::Fitted } else { Source::Typed });
    let size = match (source, fitted) {
        (Source::Typed, _) if typed == 0.0 => return Ok(None),
        (Source::Typed, _) => typed,
        (Source::Estimate, _) => 0.0,
        (Source::Fitted, Some(fitted)) => fitted,
        (Source::Fitted, None) => {
            let bound = "given where comp_source is 2 (fitted): the lower limit of the fit";
            return Err(ParameterError { name: "comp_fitted", value: f64::NAN, bound });
        }
    };
    let ways = Way::ALL.map(|way| (f64::from(way as u8), way));
    let way = m.one_of("comp_way", &ways, "1 (error), 2 (derivative) or 3 (inverse)")?;
    let share = m.value("comp_share");
    let usual = match source {
        Source::Estimate => CompensationSettings::by_estimate(way, k, ti, share),
        _ => CompensationSettings::new(way, k, ti, size, share),
    };
    let or = |name, usual: f64| m.known(name).unwrap_or(usual);
    Ok(Some(CompensationSettings {
        source,
        // A fit that found no gap.
        contradicted: fitted == Some(0.0),
        limit: or("comp_limit", usual.limit),
        band: or("comp_band", usual.band),
        tf: m.value("comp_tf"),
        rate: or("comp_rate", usual.rate),
        release: or("comp_release", usual.release),
        watch: or("comp_watch", usual.watch),
        travel: or("comp_travel", usual.travel),
        reversals: or("comp_reversals", usual.reversals),
        withdraw: m.yes("comp_withdraw")?,
        estimate: m.yes("comp_estimate")?,
        ..usual
    }))
}

/// Refuses to take a compensation out of the settings while it is in force: it would be gone with a bump.
pub(super) fn not_taken_away(to: &Module, state: &BacklashDetectionState<f64>) -> Result<(), ParameterError> {
    let value = to.value("comp_size");
    if settings(to)?.is_none() && state.compensation.u_ff != 0.0 {
        let bound = "greater than 0 while it compensates: set compensate to 0 first";
        return Err(ParameterError { name: "comp_size", value, bound });
    }
    Ok(())
}

/// An output, an inner variable, or a setting with a default, as in force.
pub(super) fn read(block: &BacklashDetection<f64>, state: &BacklashDetectionState<f64>, name: &str) -> Option<f64> {
    let in_force = || block.settings().compensation.and_then(|settings| in_force(&settings, name));
    named(block, state, name).or_else(|| block.read(state, name)).or_else(in_force)
}

/// Value of a setting of the compensation in force.
fn in_force(settings: &CompensationSettings<f64>, name: &str) -> Option<f64> {
    match name {
        "comp_limit" => Some(settings.limit),
        "comp_band" => Some(settings.band),
        "comp_rate" => Some(settings.rate),
        "comp_release" => Some(settings.release),
        "comp_watch" => Some(settings.watch),
        "comp_travel" => Some(settings.travel),
        "comp_reversals" => Some(settings.reversals),
        _ => None,
    }
}

fn named(block: &BacklashDetection<f64>, state: &BacklashDetectionState<f64>, name: &str) -> Option<f64> {
    let shown = || state.detector.shown();
    match name {
        "d" => Some(state.last.map_or(f64::NAN, |last| last.parts.d)),
        "reason" => Some(state.last.map_or(f64::NAN, |last| f64::from(last.reason() as u8))),
        "d_hat" => Some(shown().map_or(f64::NAN, |shown| shown.value)),
        "noise_floor" => Some(state.detector.noise_floor().unwrap_or(f64::NAN)),
        "count" => Some(shown().map_or(0.0, |shown| shown.count.into())),
        "detections" => Some(state.detector.accepted().into()),
        "whole" => Some(state.shown().map_or(f64::NAN, |whole| whole.value)),
        "u_ff" => Some(state.compensation.u_ff),
        "standing" => Some(f64::from(state.compensation.standing as u8)),
        "over" => Some(f64::from(u8::from(state.over.equal) + 2 * u8::from(state.over.relay))),
        "source" => Some(block.source().map_or(0.0, |source| f64::from(source as u8))),
        "unfit" => Some(block.may_compensate_by_estimate(state).err().map_or(0.0, |unfit| f64::from(unfit as u8))),
        "size" => Some(state.compensation.size),
        "delta" => Some(state.compensation.delta),
        "left" => Some(state.compensation.left()),
        "compensate" => Some(f64::from(u8::from(state.compensate))),
        _ => None,
    }
}

/// Enables (1) or disables (0) the compensation.
pub(super) fn compensate(state: &mut BacklashDetectionState<f64>, value: f64) -> Result<(), ParameterError> {
    state.compensate = switch("compensate", value, "0 (off) or 1 (on)")?;
    Ok(())
}
