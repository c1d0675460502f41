//! Compensation of the gap, and the warning of over-compensation.

use crate::refused;
use glapp_core::{
    CompensationSample, CompensationSettings, CompensationState, HalfPeriod, OverCompensationState, Saturation, Source,
    Standing, Status, Way,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// Settings of a scenario, in a dict; None means the default.
pub fn settings(given: &Bound<'_, PyAny>) -> PyResult<CompensationSettings<f64>> {
    let must = |name| given.get_item(name)?.extract::<f64>();
    let or = |name, usual: f64| Ok::<_, PyErr>(given.get_item(name)?.extract::<Option<f64>>()?.unwrap_or(usual));
    let way = named(&given.get_item("way")?.extract::<String>()?)?;
    let usual = CompensationSettings::new(way, must("k")?, must("ti")?, must("size")?, must("share")?);
    Ok(CompensationSettings {
        limit: or("limit", usual.limit)?,
        band: or("band", usual.band)?,
        tf: or("tf", usual.tf)?,
        rate: or("rate", usual.rate)?,
        release: or("release", usual.release)?,
        watch: or("watch", usual.watch)?,
        travel: or("travel", usual.travel)?,
        reversals: or("reversals", usual.reversals)?,
        withdraw: given.get_item("withdraw")?.extract()?,
        estimate: given.get_item("estimate")?.extract()?,
        ..usual
    })
}

fn named(way: &str) -> PyResult<Way> {
    let unknown = || PyValueError::new_err(format!("way = {way}: must be error, derivative or inverse"));
    Way::ALL.into_iter().find(|one| one.name() == way).ok_or_else(unknown)
}

fn source_named(source: &str) -> PyResult<Source> {
    let unknown = || PyValueError::new_err(format!("source = {source}: must be typed, fitted or estimate"));
    Source::ALL.into_iter().find(|one| one.name() == source).ok_or_else(unknown)
}

fn hindrance_named(standing: &str) -> PyResult<Standing> {
    let unknown = || PyValueError::new_err(format!("hindered = {standing}: must be too_late or not_followed"));
    let all = [Standing::TooLate, Standing::NotFollowed];
    all.into_iter().find(|one| one.name() == standing).ok_or_else(unknown)
}

/// A range of values; without limits all numbers.
fn within(limits: Option<(f64, f64)>) -> PyResult<Saturation<f64>> {
    limits.map_or(Ok(Saturation::none()), |(low, high)| Saturation::new(low, high)).map_err(refused)
}

/// Feed-forward that carries the valve through its gap whenever it is reversed (thesis 2.2).
///
/// Parameters
/// ----------
/// way : {"error", "derivative", "inverse"}
///     How the direction is found: sign(e)·sign(K); sign(du_f/dt); or by reversals of u_f that exceed a noise band.
/// k : float
///     Gain K ≠ 0 of the controller, negative for direct action; its sign counts for "error".
/// size : float
///     Width that a person typed, or the lower limit of the fit where its verdict is backlash; ≥ 0 [unit of OP].
/// share : float
///     Share of it to compensate, 0..1.
/// limit : float
///     Greatest width that may be compensated, whatever the size came from [unit of OP], ≥ share·size.
/// band : float
///     How far u_f must go back before that is a reversal, for "inverse" [unit of OP], ≥ 0.
/// tf : float
///     Time constant of the second-order filter of u [s], ≥ 0.
/// rate : float
///     Greatest rate of u_FF [unit of OP per s], > 0.
/// release : float
///     Time in which it is taken away [s], > 0, ≤ 10 Ti and ≤ 300.
/// watch : float
///     Time over which the loop is compared with what it was before [s], > 0.
/// travel, reversals : float
///     Budgets of u_FF in any hour [unit of OP; 1], > 0 and ≥ 2.
/// withdraw : bool
///     Whether a warning of over-compensation, and a loop that is worse than before, withdraw it.
/// estimate : bool
///     Whether the on-line estimate may make the size smaller.
/// limits : (low, high), optional
///     Limits of OP.
/// source : {"typed", "fitted", "estimate"}
///     Where the width comes from. With "estimate" it is the one that is offered in the sample in which it is enabled, and `size`
///     is not used; `band` is the least band, which otherwise is a fifth of it.
/// ramp_time : float
///     With "estimate", the shortest time from side to side [s], ≥ 0.
/// ti : float, optional
///     Integral time Ti > 0 of the controller [s], by which the bounds of the times go; `release` where not given.
///
/// Examples
/// --------
/// >>> settings = dict(k=1.0, size=2.0, share=1.0, limit=5.0, band=0.5, tf=0.0, rate=1.0, release=1.0, watch=1e4)
/// >>> inverse = Compensation("inverse", **settings, travel=1e3, reversals=500, withdraw=True)
/// >>> [inverse.update(0.0, u, 1.0, enable=True) for u in (50.0, 50.6, 50.2, 50.0, 50.5, 50.6)]
/// [0.0, 0.0, 0.0, -0.75, -0.75, 0.25]
/// >>> inverse.standing
/// 'active'
#[pyclass(module = "glapp.blocks")]
pub struct Compensation {
    block: glapp_core::Compensation<f64>,
    state: CompensationState<f64>,
}

#[pymethods]
impl Compensation {
    #[new]
    #[pyo3(signature = (
        way, *, k, size, share, limit, band, tf, rate, release, watch, travel, reversals, withdraw, estimate=true,
        limits=None, source="typed", ramp_time=0.0, ti=None,
    ))]
    #[allow(clippy::too_many_arguments)]
    fn new(
        way: String,
        k: f64,
        size: f64,
        share: f64,
        limit: f64,
        band: f64,
        tf: f64,
        rate: f64,
        release: f64,
        watch: f64,
        travel: f64,
        reversals: f64,
        withdraw: bool,
        estimate: bool,
        limits: Option<(f64, f64)>,
        source: &str,
        ramp_time: f64,
        ti: Option<f64>,
    ) -> PyResult<Self> {
        let settings = CompensationSettings {
            limits: within(limits)?,
            limit,
            band,
            tf,
            rate,
            release,
            watch,
            travel,
            reversals,
            withdraw,
            estimate,
            source: source_named(source)?,
            ramp_time,
            ..CompensationSettings::new(named(&way)?, k, ti.unwrap_or(release), size, share)
        };
        let block = glapp_core::Compensation::new(settings).map_err(refused)?;
        Ok(Self { block, state: CompensationState::default() })
    }

    /// Take the filtered error, OP without u_FF and the time since the last sample [s]; give u_FF.
    ///
    /// enable: a person wants it on; d_hat: on-line estimate of the whole gap; over: over-compensation is warned of; flags: 1
    /// not in automatic, 2 bad, 4 at the lower limit, 8 at the upper one; offered: the estimate where it may be a source; hindered:
    /// "too_late" or "not_followed", what only the outside can see.
    #[pyo3(signature = (e, u, h, *, enable, d_hat=None, over=false, flags=0, offered=None, hindered=None))]
    #[allow(clippy::too_many_arguments)]
    fn update(
        &mut self,
        e: f64,
        u: f64,
        h: f64,
        enable: bool,
        d_hat: Option<f64>,
        over: bool,
        flags: Status,
        offered: Option<f64>,
        hindered: Option<&str>,
    ) -> PyResult<f64> {
        let hindered = hindered.map(hindrance_named).transpose()?;
        let sample = CompensationSample { e, u, h, d_hat, offered, over, enable, hindered, flags };
        Ok(self.block.update(&mut self.state, &sample))
    }

    /// State: active, or the reason why it is not.
    #[getter]
    fn standing(&self) -> &'static str {
        self.state.standing.name()
    }

    /// Width in force now.
    #[getter]
    fn size(&self) -> f64 {
        2.0 * self.state.half
    }

    /// δ: share of the width less the noise band.
    #[getter]
    fn delta(&self) -> f64 {
        self.state.delta
    }

    /// Part of the width that stays uncompensated while it is in force.
    #[getter]
    fn left(&self) -> f64 {
        self.state.left()
    }

    /// Travel and reversals that count against the budgets.
    #[getter]
    fn spent(&self) -> (f64, f64) {
        (self.state.travel, self.state.reversals)
    }
}

/// Names of how a compensation stands, in the order of their numbers.
#[pyfunction]
pub fn compensation_states() -> Vec<&'static str> {
    Standing::ALL.iter().map(|standing| standing.name()).collect()
}

/// Name, unit, least, greatest, and whether the least itself is out.
type NamedBound = (&'static str, &'static str, f64, f64, bool);

/// The [`NamedBound`] of each number that a compensation is set by: with a
/// controller's Ti [s], and the other settings as they are.
#[pyfunction]
#[pyo3(signature = (ti, *, size, share, limit, limits=None))]
pub fn compensation_bounds(
    ti: f64,
    size: f64,
    share: f64,
    limit: f64,
    limits: Option<(f64, f64)>,
) -> PyResult<Vec<NamedBound>> {
    let usual = CompensationSettings::new(Way::Inverse, 1.0, ti, size, share);
    let settings = CompensationSettings { limit, limits: within(limits)?, ..usual };
    Ok(settings.bounds().iter().map(|b| (b.name, b.unit, b.low, b.high, b.above)).collect())
}

/// Two warnings of a compensation wider than the gap (thesis 7.4): as in code block 7.1, and one that tells a relay from a gap.
///
/// Parameters
/// ----------
/// k, ti : float
///     Gain ≠ 0 and integral time > 0 [s] of the controller.
///
/// Examples
/// --------
/// >>> warning = OverCompensation(0.5, 10.0)
/// >>> for _ in range(8):
/// ...     found = warning.update(6.0, 0.4, 0.1, size=2.0)
/// >>> found
/// (True, True)
#[pyclass(module = "glapp.blocks")]
pub struct OverCompensation {
    block: glapp_core::OverCompensation<f64>,
    state: OverCompensationState<f64>,
}

#[pymethods]
impl OverCompensation {
    #[new]
    fn new(k: f64, ti: f64) -> PyResult<Self> {
        let block = glapp_core::OverCompensation::new(k, ti).map_err(refused)?;
        Ok(Self { block, state: OverCompensationState::default() })
    }

    /// Take a completed half-period: Δt [s], Δy, the sample time [s] and the width in force, 0 while nothing is compensated; give
    /// (equal, relay).
    #[pyo3(signature = (delta_t, delta_y, h, size, delta_sp=0.0, flags=0))]
    fn update(&mut self, delta_t: f64, delta_y: f64, h: f64, size: f64, delta_sp: f64, flags: Status) -> (bool, bool) {
        let half = HalfPeriod { flags, delta_t, delta_y, delta_sp, ..HalfPeriod::default() };
        let warning = self.block.update(&mut self.state, &half, h, size);
        (warning.equal, warning.relay)
    }
}
