//! Tuning rules in closed form: a few numbers that describe a process in, the numbers of a PI or PID controller out.
//!
//! All give the ideal form (4.1), K·(1 + 1/(s·Ti) + s·Td). The process is described by one of
//!
//! | numbers | process | from |
//! |---|---|---|
//! | Kp, T, L | Kp·e^(−L·s)/(1 + s·T), FOTD | a step response (thesis 4.1) |
//! | Kv, L | Kv·e^(−L·s)/s, integrating | the slope of a step response |
//! | Ku, Tu, κ = 1/(Kp·Ku) | where P(iω) meets the negative real axis | a loop brought to oscillate |
//!
//! Gains may be negative, and K then is too. A rule asked of a process that it has no answer for gives the error that
//! names the bound. Sources: ZN = Ziegler and Nichols, *Optimum settings for automatic controllers*, Trans. ASME 64
//! (1942); APC = Åström and Hägglund, *Advanced PID Control* (2006), chapter 7; SIMC = Skogestad, *Simple analytic rules
//! for model reduction and PID controller tuning*, J. Process Control 13 (2003); Lambda = Dahlin (1968), as internal
//! model control gives it.

use crate::error::require;
use crate::{ParameterError, Real};

/// The controller that a rule gives, in ideal form.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Gains<R> {
    /// Gain K [output per process value], of the sign of the process gain.
    pub k: R,
    /// Integral time \[s\], > 0.
    pub ti: R,
    /// Derivative time \[s\], 0 for PI.
    pub td: R,
}

/// Whether a rule is to give a PI or a PID controller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Controller without derivative part.
    Pi,
    /// Controller with derivative part.
    Pid,
}

/// The two tables in use under the names of Ziegler and Nichols. They differ for PI only.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Table {
    /// The table of control textbooks (Åström and Hägglund): PI 0.9/a, 3L; 0.4Ku, 0.8Tu.
    Textbook,
    /// The table of Ziegler and Nichols, 1942: PI 0.9/a, L/0.3; 0.45Ku, Tu/1.2.
    Original,
}

/// Ziegler and Nichols' step response method: PI 0.9/a, 3L (or L/0.3); PID 1.2/a, 2L, L/2.
///
/// `a` ≠ 0 is where the steepest tangent of the response to a unit step meets the vertical axis, below it, counted
/// positive downwards: Kp·L/T for FOTD, Kv·L for an integrating process. `l` > 0 \[s\] is where it meets the time axis.
///
/// ```
/// use glapp_core::tuning::{Kind, Table, ziegler_nichols_step};
/// let pid = ziegler_nichols_step(0.5, 2.0, Kind::Pid, Table::Textbook)?;
/// assert_eq!((pid.k, pid.ti, pid.td), (2.4, 4.0, 1.0));
/// # Ok::<(), glapp_core::ParameterError>(())
/// ```
pub fn ziegler_nichols_step<R: Real>(a: R, l: R, kind: Kind, table: Table) -> Result<Gains<R>, ParameterError> {
    require("a", a, a != R::ZERO, "other than 0")?;
    let l = delay(l)?;
    match (kind, table) {
        (Kind::Pi, Table::Textbook) => gains(R::of(0.9) / a, R::of(3.0) * l, R::ZERO),
        (Kind::Pi, Table::Original) => gains(R::of(0.9) / a, l / R::of(0.3), R::ZERO),
        (Kind::Pid, _) => gains(R::of(1.2) / a, R::of(2.0) * l, R::of(0.5) * l),
    }
}

/// Ziegler and Nichols' frequency response method: PI 0.4Ku, 0.8Tu (or 0.45Ku, Tu/1.2); PID 0.6Ku, Tu/2, Tu/8.
///
/// `ku` ≠ 0 is the proportional gain at which the loop oscillates steadily, `tu` > 0 \[s\] the period.
pub fn ziegler_nichols_frequency<R: Real>(ku: R, tu: R, kind: Kind, table: Table) -> Result<Gains<R>, ParameterError> {
    let (ku, tu) = ultimate(ku, tu)?;
    match (kind, table) {
        (Kind::Pi, Table::Textbook) => gains(R::of(0.4) * ku, R::of(0.8) * tu, R::ZERO),
        (Kind::Pi, Table::Original) => gains(R::of(0.45) * ku, tu / R::of(1.2), R::ZERO),
        (Kind::Pid, _) => gains(R::of(0.6) * ku, R::of(0.5) * tu, R::of(0.125) * tu),
    }
}

/// Lambda tuning: the closed loop answers a setpoint step like a first-order lag λ after the dead time.
///
/// PI K = T/(Kp·(λ + L)), Ti = T; PID K = (T + L/2)/(Kp·(λ + L/2)), Ti = T + L/2, Td = T·L/(2T + L). `kp` ≠ 0, `t` > 0,
/// `l` ≥ 0, `lambda` > 0 \[s\].
pub fn lambda<R: Real>(kp: R, t: R, l: R, lambda: R, kind: Kind) -> Result<Gains<R>, ParameterError> {
    let (kp, t, l) = fotd(kp, t, l)?;
    require("t", t, t > R::ZERO, "greater than 0 s: the rule makes the lag its integral time")?;
    let lambda = speed("lambda", lambda)?;
    let half = R::of(0.5) * l;
    match kind {
        Kind::Pi => gains(t / (kp * (lambda + l)), t, R::ZERO),
        Kind::Pid => gains((t + half) / (kp * (lambda + half)), t + half, t * l / (R::of(2.0) * t + l)),
    }
}

/// Lambda tuning of an integrating process: Ti = 2λ + L, K = Ti/(Kv·(λ + L)²), PI.
///
/// A load is brought to a stop within about λ. `kv` ≠ 0, `l` ≥ 0, `lambda` > 0 \[s\].
pub fn lambda_integrating<R: Real>(kv: R, l: R, lambda: R) -> Result<Gains<R>, ParameterError> {
    let (kv, _, l) = fotd(kv, R::ZERO, l)?;
    let lambda = speed("lambda", lambda)?;
    let ti = R::of(2.0) * lambda + l;
    gains(ti / (kv * (lambda + l) * (lambda + l)), ti, R::ZERO)
}

/// AMIGO from a step response (APC 7): what MIGO with M = 1.4 gives for a large batch of processes, as a formula.
///
/// PI K = (0.15 + (0.35 − LT/(L + T)²)·T/L)/Kp, Ti = 0.35L + 13LT²/(T² + 12LT + 7L²);
/// PID K = (0.2 + 0.45T/L)/Kp, Ti = L(0.4L + 0.8T)/(L + 0.1T), Td = 0.5LT/(0.3L + T). `kp` ≠ 0, `t` ≥ 0, `l` > 0 \[s\].
///
/// ```
/// use glapp_core::tuning::{Kind, amigo_step};
/// let pi = amigo_step(1.0_f64, 2.9, 1.42, Kind::Pi)?; // 1/(s + 1)⁴
/// assert!((pi.k - 0.414).abs() < 2e-3 && (pi.ti - 2.66).abs() < 1e-2);
/// # Ok::<(), glapp_core::ParameterError>(())
/// ```
pub fn amigo_step<R: Real>(kp: R, t: R, l: R, kind: Kind) -> Result<Gains<R>, ParameterError> {
    let (kp, t, _) = fotd(kp, t, l)?;
    let l = delay(l)?;
    match kind {
        Kind::Pi => {
            let sum = l + t;
            let k = (R::of(0.15) + (R::of(0.35) - l * t / (sum * sum)) * t / l) / kp;
            let ti = R::of(0.35) * l + R::of(13.0) * l * t * t / (t * t + R::of(12.0) * l * t + R::of(7.0) * l * l);
            gains(k, ti, R::ZERO)
        }
        Kind::Pid => gains(
            (R::of(0.2) + R::of(0.45) * t / l) / kp,
            l * (R::of(0.4) * l + R::of(0.8) * t) / (l + R::of(0.1) * t),
            R::of(0.5) * l * t / (R::of(0.3) * l + t),
        ),
    }
}

/// AMIGO of an integrating process: PI 0.35/(Kv·L), 13.4L; PID 0.45/(Kv·L), 8L, 0.5L. `kv` ≠ 0, `l` > 0 \[s\].
pub fn amigo_integrating<R: Real>(kv: R, l: R, kind: Kind) -> Result<Gains<R>, ParameterError> {
    let (kv, _, _) = fotd(kv, R::ZERO, l)?;
    let l = delay(l)?;
    match kind {
        Kind::Pi => gains(R::of(0.35) / (kv * l), R::of(13.4) * l, R::ZERO),
        Kind::Pid => gains(R::of(0.45) / (kv * l), R::of(8.0) * l, R::of(0.5) * l),
    }
}

/// AMIGO from the ultimate point (APC 7): PI K = 0.16Ku, Ti = Tu/(1 + 4.5κ);
/// PID K = (0.3 − 0.1κ⁴)Ku, Ti = 0.6Tu/(1 + 2κ), Td = 0.15(1 − κ)Tu/(1 − 0.95κ).
///
/// `ku` ≠ 0, `tu` > 0 \[s\], 0 ≤ `kappa` < 1: the gain of the process at −180° over its static gain, 0 with an integrator.
pub fn amigo_frequency<R: Real>(ku: R, tu: R, kappa: R, kind: Kind) -> Result<Gains<R>, ParameterError> {
    let (ku, tu) = ultimate(ku, tu)?;
    require("kappa", kappa, kappa >= R::ZERO && kappa < R::ONE, "0 or greater and less than 1")?;
    match kind {
        Kind::Pi => gains(R::of(0.16) * ku, tu / (R::ONE + R::of(4.5) * kappa), R::ZERO),
        Kind::Pid => {
            let square = kappa * kappa;
            gains(
                (R::of(0.3) - R::of(0.1) * square * square) * ku,
                R::of(0.6) * tu / (R::ONE + R::of(2.0) * kappa),
                R::of(0.15) * (R::ONE - kappa) * tu / (R::ONE - R::of(0.95) * kappa),
            )
        }
    }
}

/// PID that moves the ultimate point, −1/Ku, to −0.5·e^(i45°), with Ti = 6.25Td: K = 0.354Ku, Ti = 1.134Tu, Td = 0.181Tu.
///
/// In the manner of Åström and Hägglund, *Automatic tuning of simple regulators with specifications on phase and amplitude
/// margins*, Automatica 20 (1984): a controller K·(1 + i·tan φ) at ω = 2π/Tu turns the point by φ, so that for a distance r
/// from the origin K = r·cos φ·Ku and Td·ω = (tan φ + √(tan²φ + 4/α))/2, where Ti = α·Td. α = 6.25 is that of the
/// autotuner in thesis 7.5; r = 0.5 and φ = 45° it does not give. Ms of the test batch is 1.4–1.7 with it, 2.2 for P4.
/// Known limit: a process that is nearly all dead time becomes unstable (P8, where κ = 0.98), for nothing in it takes off
/// what the derivative adds.
///
/// ```
/// use glapp_core::tuning::point_placement;
/// let pid = point_placement(4.0_f64, 10.0)?;
/// let tangent = std::f64::consts::TAU / 10.0 * pid.td - 10.0 / (std::f64::consts::TAU * pid.ti);
/// assert!((tangent - 1.0).abs() < 1e-14 && pid.ti == 6.25 * pid.td);
/// # Ok::<(), glapp_core::ParameterError>(())
/// ```
pub fn point_placement<R: Real>(ku: R, tu: R) -> Result<Gains<R>, ParameterError> {
    let (ku, tu) = ultimate(ku, tu)?;
    let td = R::of(0.181_486_358_907_843_76) * tu;
    gains(R::of(0.353_553_390_593_273_8) * ku, R::of(6.25) * td, td)
}

/// SIMC of Kp·e^(−L·s)/((1 + s·T)(1 + s·T₂)): K' = T/(Kp·(τc + L)), Ti' = min(T, 4(τc + L)), Td' = T₂ in series form.
///
/// The ideal form of these is given: K = K'(1 + Td'/Ti'), Ti = Ti' + Td', Td = Ti'·Td'/(Ti' + Td'). T₂ = 0 gives PI.
/// `kp` ≠ 0, `t` ≥ `t2` ≥ 0, `t` > 0, `l` ≥ 0, `tau_c` > 0 \[s\], the time constant wished for; τc = L is Skogestad's advice.
pub fn simc<R: Real>(kp: R, t: R, t2: R, l: R, tau_c: R) -> Result<Gains<R>, ParameterError> {
    let (kp, t, l) = fotd(kp, t, l)?;
    require("t", t, t > R::ZERO, "greater than 0 s: a process without lag needs a purely integrating controller")?;
    require("t2", t2, t2 >= R::ZERO && t2 <= t, "0 s or greater and not greater than t")?;
    let reach = speed("tau_c", tau_c)? + l;
    series(t / (kp * reach), t.lesser(R::of(4.0) * reach), t2)
}

/// SIMC of an integrating process Kv·e^(−L·s)/(s·(1 + s·T₂)): K' = 1/(Kv·(τc + L)), Ti' = 4(τc + L), Td' = T₂.
///
/// In ideal form as in [`simc`]. `kv` ≠ 0, `t2` ≥ 0, `l` ≥ 0, `tau_c` > 0 \[s\].
pub fn simc_integrating<R: Real>(kv: R, t2: R, l: R, tau_c: R) -> Result<Gains<R>, ParameterError> {
    let (kv, _, l) = fotd(kv, R::ZERO, l)?;
    require("t2", t2, t2 >= R::ZERO, "0 s or greater")?;
    let reach = speed("tau_c", tau_c)? + l;
    series(R::ONE / (kv * reach), R::of(4.0) * reach, t2)
}

/// Gains of a controller in series form, converted to ideal form.
fn series<R: Real>(k: R, ti: R, td: R) -> Result<Gains<R>, ParameterError> {
    gains(k * (R::ONE + td / ti), ti + td, ti * td / (ti + td))
}

/// Checks gain, time constant and dead time of a first-order model.
fn fotd<R: Real>(gain: R, t: R, l: R) -> Result<(R, R, R), ParameterError> {
    require("gain", gain, gain != R::ZERO, "other than 0")?;
    require("t", t, t >= R::ZERO, "0 s or greater")?;
    require("l", l, l >= R::ZERO, "0 s or greater")?;
    Ok((gain, t, l))
}

/// Checks a dead time.
fn delay<R: Real>(l: R) -> Result<R, ParameterError> {
    require("l", l, l > R::ZERO, "greater than 0 s: without dead time the rule has no limit to the gain")
}

/// Checks ultimate gain and period.
fn ultimate<R: Real>(ku: R, tu: R) -> Result<(R, R), ParameterError> {
    require("ku", ku, ku != R::ZERO, "other than 0")?;
    require("tu", tu, tu > R::ZERO, "greater than 0 s")?;
    Ok((ku, tu))
}

/// Checks a closed loop's time constant.
fn speed<R: Real>(name: &'static str, time: R) -> Result<R, ParameterError> {
    require(name, time, time > R::ZERO, "greater than 0 s")
}

/// Gains that a [`Pid`](crate::Pid) accepts; numbers so far apart that a rule overflowed or vanished end in an error
/// here.
fn gains<R: Real>(k: R, ti: R, td: R) -> Result<Gains<R>, ParameterError> {
    let bound = "within reach of the numbers: those of the process lie too far apart";
    Ok(Gains {
        k: require("k", k, k != R::ZERO, bound)?,
        ti: require("ti", ti, ti > R::ZERO, bound)?,
        td: require("td", td, td >= R::ZERO, bound)?,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn name<R: Real>(result: Result<Gains<R>, ParameterError>) -> &'static str {
        result.expect_err("refused").name
    }

    #[test]
    fn bounds_are_named() {
        let (pi, pid, book) = (Kind::Pi, Kind::Pid, Table::Textbook);
        assert_eq!(name(ziegler_nichols_step(0.0, 1.0, pi, book)), "a");
        assert_eq!(name(ziegler_nichols_step(1.0, 0.0, pi, book)), "l");
        assert_eq!(name(ziegler_nichols_frequency(f64::NAN, 1.0, pi, book)), "ku");
        assert_eq!(name(ziegler_nichols_frequency(1.0, 0.0, pi, book)), "tu");
        assert_eq!(name(lambda(1.0, 0.0, 1.0, 1.0, pid)), "t");
        assert_eq!(name(lambda(1.0, 1.0, -1.0, 1.0, pid)), "l");
        assert_eq!(name(lambda(1.0, 1.0, 1.0, 0.0, pid)), "lambda");
        assert_eq!(name(lambda_integrating(0.0, 1.0, 1.0)), "gain");
        assert_eq!(name(amigo_step(1.0, 1.0, 0.0, pi)), "l");
        assert_eq!(name(amigo_step(0.0, 1.0, 1.0, pi)), "gain");
        assert_eq!(name(amigo_integrating(1.0, 0.0, pid)), "l");
        assert_eq!(name(amigo_frequency(1.0, 1.0, 1.0, pid)), "kappa");
        assert_eq!(name(amigo_frequency(1.0, 1.0, -0.1, pi)), "kappa");
        assert_eq!(name(point_placement(0.0, 1.0)), "ku");
        assert_eq!(name(simc(1.0, 0.0, 0.0, 1.0, 1.0)), "t");
        assert_eq!(name(simc(1.0, 1.0, 2.0, 1.0, 1.0)), "t2");
        assert_eq!(name(simc_integrating(1.0, 0.0, 0.0, 0.0)), "tau_c");
        assert_eq!(name(amigo_step(1e-300, 1e300, 1e-300, pi)), "k");
    }

    #[test]
    fn gain_and_time_scale() {
        let at = |gain: f64, time: f64| {
            [
                ziegler_nichols_step(0.5 * gain, 1.5 * time, Kind::Pid, Table::Textbook),
                ziegler_nichols_frequency(3.0 / gain, 5.0 * time, Kind::Pi, Table::Original),
                point_placement(3.0 / gain, 5.0 * time),
                lambda(2.0 * gain, 3.0 * time, 1.5 * time, 3.0 * time, Kind::Pid),
                lambda_integrating(2.0 * gain / time, 1.5 * time, 3.0 * time),
                amigo_step(2.0 * gain, 3.0 * time, 1.5 * time, Kind::Pi),
                amigo_step(2.0 * gain, 3.0 * time, 1.5 * time, Kind::Pid),
                amigo_integrating(2.0 * gain / time, 1.5 * time, Kind::Pid),
                amigo_frequency(3.0 / gain, 5.0 * time, 0.3, Kind::Pid),
                simc(2.0 * gain, 3.0 * time, time, 1.5 * time, 1.5 * time),
                simc_integrating(2.0 * gain / time, time, 1.5 * time, 1.5 * time),
            ]
            .map(Result::unwrap)
        };
        // Powers of two round nothing.
        for (one, other) in at(1.0, 1.0).iter().zip(at(-4.0, 8.0)) {
            assert_eq!((other.k, other.ti, other.td), (one.k / -4.0, one.ti * 8.0, one.td * 8.0));
        }
    }

    #[test]
    fn an_integrator_is_a_very_slow_lag() {
        let close = |a: Gains<f64>, b: Gains<f64>, tolerance: f64| {
            let near = |a: f64, b: f64| (a - b).abs() <= tolerance * b.abs();
            assert!(near(a.k, b.k) && near(a.ti, b.ti) && near(a.td, b.td), "{a:?} {b:?}");
        };
        let (slow, l) = (1e7, 2.0);
        for kind in [Kind::Pi, Kind::Pid] {
            // The rounded coefficients of the integrating rule: 13.4 for 13.35.
            close(amigo_integrating(1.0, l, kind).unwrap(), amigo_step(slow, slow, l, kind).unwrap(), 4e-3);
        }
        close(simc_integrating(1.0, 1.0, l, 3.0).unwrap(), simc(slow, slow, 1.0, l, 3.0).unwrap(), 1e-12);
    }
}
