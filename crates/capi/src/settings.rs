//! Settings by name: of a detector those of the catalogue (`vectors/catalogue.json`), of a step test those of `include/glapp.h`.

use crate::errors::CallError;
use glapp_analysis::{Manual, StepTestSettings};
use glapp_core::DetectorSettings;

/// The settings with these names and values; what is not there has its default.
///
/// `k`, `ti` and `h`, the usual time between two samples \[s\], must be there. A condition of the safety net is switched off by its
/// name with 0.
pub(crate) fn detector(given: &[(&str, f64)]) -> Result<DetectorSettings<f64>, CallError> {
    once(given)?;
    let known = |name: &str| given.iter().find(|one| one.0 == name).map(|one| one.1);
    let [k, ti, h] = ["k", "ti", "h"].map(known);
    let or_none = |value: Option<f64>| value.unwrap_or(f64::NAN);
    let mut settings = DetectorSettings::new(or_none(k), or_none(ti), known("td").unwrap_or(0.0), or_none(h));
    let mut limits = (None, None);
    for (name, value) in given {
        match *name {
            "k" | "ti" | "td" | "h" => {}
            "b" => settings.b = *value,
            "kp" => settings.kp = Some(*value),
            "pv_span" => settings.pv_span = Some(*value),
            "op_span" => settings.op_span = Some(*value),
            "integrating" => settings.integrating = yes(name, *value)?,
            "tf" => settings.tf = *value,
            "n" => settings.n = whole(name, *value)?,
            "max_h" => settings.max_h = *value,
            "op_low" => limits.0 = Some(*value),
            "op_high" => limits.1 = Some(*value),
            other => match settings.conditions.switch(other) {
                Some(asked) => *asked = yes(other, *value)?,
                None => return Err(CallError::refused(format!("{other}: there is no such setting of a detector"))),
            },
        }
    }
    // After the names: one that is written wrongly is not told as missing.
    for name in ["k", "ti", "h"] {
        known(name).ok_or_else(|| CallError::refused(format!("{name}: is missing")))?;
    }
    if let Some(h) = h.filter(|h| !(h.is_finite() && *h > 0.0)) {
        return Err(CallError::refused(format!("h = {h}: must be greater than 0 s")));
    }
    settings.op_limits = match limits {
        (Some(low), Some(high)) => Some((low, high)),
        (None, None) => None,
        (Some(_), None) => return Err(CallError::refused("op_high: is missing beside op_low")),
        (None, Some(_)) => return Err(CallError::refused("op_low: is missing beside op_high")),
    };
    Ok(settings)
}

/// The settings of a step test, and which rows were made in manual.
pub(crate) fn step_test(given: &[(&str, f64)]) -> Result<(Manual, StepTestSettings), CallError> {
    once(given)?;
    let (mut manual, mut settings) = (Manual::Flagged, StepTestSettings::default());
    for (name, value) in given {
        match *name {
            "manual" => manual = if yes(name, *value)? { Manual::All } else { Manual::Flagged },
            "integrating" => settings.integrating = yes(name, *value)?,
            "op_span" => settings.op_span = Some(above(name, *value, 0.0)?),
            "positioner_dead_band" => settings.positioner_dead_band = Some(above(name, *value, 0.0)?),
            "width" => settings.width = Some(above(name, *value, 0.0)?),
            other => return Err(CallError::refused(format!("{other}: there is no such setting of a step test"))),
        }
    }
    Ok((manual, settings))
}

/// Refuses a name that is given twice.
fn once(given: &[(&str, f64)]) -> Result<(), CallError> {
    let again = given.iter().enumerate().find(|(at, one)| given[..*at].iter().any(|before| before.0 == one.0));
    again.map_or(Ok(()), |(_, (name, _))| Err(CallError::refused(format!("{name}: is given twice"))))
}

/// A value that must be above a bound.
fn above(name: &str, value: f64, bound: f64) -> Result<f64, CallError> {
    let good = value.is_finite() && value > bound;
    if good { Ok(value) } else { Err(CallError::refused(format!("{name} = {value}: must be a number above {bound}"))) }
}

/// A switch: 0 or 1.
fn yes(name: &str, value: f64) -> Result<bool, CallError> {
    match value {
        0.0 => Ok(false),
        1.0 => Ok(true),
        _ => Err(CallError::refused(format!("{name} = {value}: must be 0 (no) or 1 (yes)"))),
    }
}

/// A count: a whole number.
fn whole(name: &str, value: f64) -> Result<u32, CallError> {
    let number = value as u32;
    let same = f64::from(number) == value;
    if same { Ok(number) } else { Err(CallError::refused(format!("{name} = {value}: must be a whole number"))) }
}
