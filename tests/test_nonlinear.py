"""Describing functions, criteria and predicted limit cycles, against numbers found on other roads."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from glapp import InputError, simulate
from glapp.blocks import Backlash
from glapp.nonlinear import (
    backlash_cycles,
    backlash_margin,
    circle_criterion,
    describing_function,
    n_backlash,
    n_relay,
    negative_inverse,
    nyquist_figure,
    over_compensation,
    phase_lead,
    relay_cycles,
    small_gain,
)
from glapp.plant import PLANTS, Plant
from glapp.tuning import assess, migo, open_loop, ultimate


class TestDescribingFunctions:
    @given(ratio=st.floats(0.51, 1e3), d=st.floats(1e-6, 1e6))
    @pytest.mark.slow
    def test_backlash_by_integration(self, ratio: float, d: float) -> None:
        analytic = n_backlash(ratio * d, d)
        numeric = describing_function(lambda: Backlash(d).update, ratio * d, samples=2048)
        assert abs(analytic - numeric) < 1e-4

    def test_relay_by_integration(self) -> None:
        a = np.array([0.1, 1.0, 7.0])
        numeric = describing_function(lambda: lambda x: 0.3 * ((x > 0) - (x < 0)), a, samples=100_000)
        np.testing.assert_allclose(n_relay(a, 0.3), numeric, rtol=1e-4, atol=1e-4)

    def test_arrays_of_any_shape_and_fresh_elements(self) -> None:
        a = np.array([[0.6, 1.0], [3.0, 50.0]])
        assert n_backlash(a, 1.0).shape == n_relay(a, 1.0).shape == (2, 2)
        forwards = describing_function(lambda: Backlash(1.0).update, a.ravel())
        backwards = describing_function(lambda: Backlash(1.0).update, a.ravel()[::-1])
        np.testing.assert_array_equal(forwards, backwards[::-1])

    @given(ratio=st.floats(0.51, 100), d=st.floats(1e-3, 1e3), c=st.floats(1e-2, 1e2))
    def test_only_the_ratio_counts(self, ratio: float, d: float, c: float) -> None:
        """N(A, d/c) = N(cA, d) (thesis 1.2)."""
        assert n_backlash(ratio * d, d / c * c) == pytest.approx(n_backlash(ratio * d * c, d * c), rel=1e-9)

    def test_the_describing_function_at_the_ends_of_its_range(self) -> None:
        assert n_backlash(5.0, 0.0) == 1
        assert abs(n_backlash(0.5 + 1e-9, 1.0)) < 1e-4
        curve = negative_inverse(n_backlash(np.geomspace(0.51, 1e6, 500), 1.0))
        assert np.all(curve.real < -0.99) and np.all(curve.imag <= 0)
        assert np.all(np.diff(np.abs(curve)) < 1e-12)

    @pytest.mark.parametrize(
        ("call", "parameter"),
        [
            (lambda: n_backlash(0.5, 1.0), "a"),
            (lambda: n_backlash([1.0, math.nan], 1.0), "a"),
            (lambda: n_backlash(1.0, -1.0), "d"),
            (lambda: n_relay(0.0, 1.0), "a"),
            (lambda: n_relay(1.0, math.inf), "level"),
            (lambda: negative_inverse([1, 0]), "n"),
            (lambda: describing_function(lambda: Backlash(1.0).update, 1.0, samples=4), "samples"),
            (lambda: describing_function(lambda: Backlash(1.0).update, [1.0, 0.0]), "a"),
            (lambda: backlash_cycles(PLANTS["P2"], 0.0), "d"),
            (lambda: relay_cycles(PLANTS["P2"], -1.0), "level"),
            (lambda: small_gain(Plant([1], [1, -1])), "loop"),
            (lambda: circle_criterion("P9"), "loop"),
            # Positive feedback: the criterion was said to hold, by a margin of 409.
            (lambda: circle_criterion(open_loop(-12 * PLANTS["P2"], (0.05, 90))), "loop"),
            (lambda: backlash_margin(open_loop(-12 * PLANTS["P2"], (0.05, 90))), "loop"),
            (lambda: phase_lead(open_loop(-12 * PLANTS["P2"], (0.05, 90)), 1.3), "loop"),
            (lambda: backlash_cycles(-1 * PLANTS["P1"], 1.0), "loop"),
            (lambda: phase_lead(PLANTS["P2"], 1.0), "margin"),
            (lambda: over_compensation("P2", -1.0, 0.1), "compensation"),
            (lambda: nyquist_figure(PLANTS["P2"], window=0), "window"),
        ],
    )
    def test_amplitudes_and_widths_out_of_bounds_are_refused(self, call: Any, parameter: str) -> None:
        with pytest.raises(InputError) as error:
            call()
        assert error.value.parameter == parameter


class TestCriteria:
    def test_small_gain(self) -> None:
        sharp = Plant([0.01], [1, 0.02, 1])
        criterion = small_gain(sharp)
        peak = 0.01 / (2 * 0.01 * math.sqrt(1 - 0.01**2))
        assert (criterion.margin, criterion.w) == pytest.approx((1 / peak, math.sqrt(1 - 2 * 0.01**2)), rel=1e-5)
        assert criterion.holds and not small_gain(2.1 * sharp).holds
        assert not small_gain(migo("P2").loop).holds

    @pytest.mark.parametrize("name", ["P2", "P4", "P5", "P7", "P8"])
    def test_margin_is_where_the_criterion_ends(self, name: str) -> None:
        loop = migo(name).loop
        margin = circle_criterion(loop).margin
        assert margin > 1
        assert circle_criterion(0.999 * margin * loop).holds
        assert not circle_criterion(1.001 * margin * loop).holds

    def test_integrators(self) -> None:
        assert circle_criterion(migo("P1").loop).margin == 0
        assert not small_gain(PLANTS["P1"]).holds

    @pytest.mark.parametrize("name", ["P2", "P3", "P4", "P5", "P6", "P7", "P8"])
    @pytest.mark.parametrize("kind", ["PI", "PID"])
    @pytest.mark.slow
    def test_the_three_margins_are_ordered(self, name: str, kind: Any) -> None:
        t = migo(name, kind)
        margin, _ = backlash_margin(t.loop)
        assert circle_criterion(t.loop).margin <= margin * 1.0001 <= t.gain_margin * 1.0002

    def test_backlash_margin_is_where_cycles_begin(self) -> None:
        for loop in (migo("P2").loop, 0.8 * PLANTS["P1"], migo("P5", "PID").loop):
            margin, w = backlash_margin(loop)
            assert backlash_cycles(0.995 * margin * loop, 1.0) == []
            first, second = backlash_cycles(1.005 * margin * loop, 1.0)
            assert first.w < w < second.w and first.stable != second.stable


class TestLimitCycles:
    def test_solves_the_harmonic_balance(self) -> None:
        for name, kind, d in (("P1", "PI", 0.05), ("P1", "PID", 3.0)):
            loop = migo(name, kind).loop
            [cycle] = backlash_cycles(loop, d)
            assert loop.response(cycle.w) * n_backlash(cycle.amplitude, d) == pytest.approx(-1, abs=1e-8)

    def test_frequency_does_not_depend_on_the_width(self) -> None:
        loop = migo("P1").loop
        one, other = backlash_cycles(loop, 1.0), backlash_cycles(loop, 0.01)
        assert [c.w for c in one] == [c.w for c in other]
        assert [c.amplitude for c in one] == pytest.approx([100 * c.amplitude for c in other])

    @pytest.mark.parametrize(
        ("kind", "bounds", "tf", "period_error", "amplitude_error"),
        [
            ("PI", {"ms": 2.0}, 0.0, 0.02, 0.05),
            ("PI", {"ms": 1.4}, 0.7, 0.03, 0.03),
            ("PI", {"ms": 1.4}, 0.0, 0.11, 0.09),
            ("PID", {"ms": 2.0}, 0.0, 0.02, 0.06),
            ("PID", {"m": 1.4}, 0.134, 0.04, 0.03),
        ],
    )
    def test_prediction_against_simulation(
        self, kind: Any, bounds: dict[str, float], tf: float, period_error: float, amplitude_error: float
    ) -> None:
        """P1 with a gap of 1: the less the loop filters, the worse the first harmonic represents the signal."""
        t = migo("P1", kind, **bounds)
        [cycle] = backlash_cycles(open_loop("P1", t.controller, tf), 1.0)
        period, amplitude = simulated(t.controller, 1.0, tf, cycle.period)
        assert cycle.stable
        assert cycle.period == pytest.approx(period, rel=period_error)
        assert cycle.amplitude == pytest.approx(amplitude, rel=amplitude_error)

    def test_simulated_period_does_not_depend_on_the_width_either(self) -> None:
        c = migo("P1", ms=2.0).controller
        (one, a), (other, b) = simulated(c, 1.0, 0.0, 14.0), simulated(c, 0.1, 0.0, 14.0)
        assert one == pytest.approx(other, rel=1e-3) and a == pytest.approx(10 * b, rel=1e-2)

    def test_none_predicted_none_simulated(self) -> None:
        c = migo("P2").controller
        assert backlash_cycles(open_loop("P2", c), 1.0) == []
        s = simulate.closed_loop("P2", c, d=1.0, noise=0, h=0.02, t_end=2000, setpoint=[(1, 5.0)], tf=0)
        assert np.ptp(s.position[s.t > 1500]) < 0.02

    def test_a_stable_process_cycles_where_ti_is_well_below_its_lag(self) -> None:
        """It was said that this takes two integrators."""
        lag, d = Plant([1.0], [10.0, 1.0], 0.5), 2.0
        for ti, cycles in ((4.0, True), (10.0, False)):
            controller = (8.0, ti)
            assert any(c.stable for c in backlash_cycles(open_loop(lag, controller), d)) == cycles
            s = simulate.closed_loop(lag, controller, d=d, noise=0.0, h=0.02, t_end=600, setpoint=[(1, 5.0)])
            assert (np.ptp(s.op[s.t > 400]) / 2 > d / 2) == cycles

    @pytest.mark.parametrize("controller", [(0.02, 60), (0.1, 200), (0.36, 7), (0.36, 700), (2.0, 7), (0.36, 7, 1.5)])
    def test_an_integrating_process_cycles_at_every_tuning(self, controller: tuple[float, ...]) -> None:
        """As docs/why.md says: retuning ends the cycle of a process that settles by itself, and not this one."""
        assert any(cycle.stable for cycle in backlash_cycles(open_loop("P1", controller), 1.0))

    @pytest.mark.slow
    def test_relay_finds_the_ultimate_point(self) -> None:
        for name in PLANTS:
            ku, tu = ultimate(name)
            cycle = max(relay_cycles(PLANTS[name], 2.0), key=lambda c: c.amplitude)
            assert (cycle.period, cycle.amplitude) == pytest.approx((tu, 8 / math.pi / ku), rel=1e-6)
            assert cycle.stable

    @pytest.mark.parametrize("name", list(PLANTS))
    def test_of_the_cycles_of_a_relay_the_slowest_alone_is_stable(self, name: str) -> None:
        """With dead time there are some hundred, and every one was called stable."""
        cycles = relay_cycles(PLANTS[name], 1.0)
        assert [cycle.stable for cycle in cycles] == [True] + [False] * (len(cycles) - 1)

    @pytest.mark.parametrize("plant", [PLANTS["P1"], PLANTS["P4"], PLANTS["P8"], Plant([12], [2400, 100, 1], 10)])
    def test_each_cycle_of_a_relay_lies_on_the_negative_axis(self, plant: Plant) -> None:
        """At high frequencies crossings of the positive axis were taken, too, with a negative amplitude."""
        cycles = relay_cycles(plant, 1.0)
        assert len(cycles) >= 12
        value = plant.response([cycle.w for cycle in cycles])
        assert np.all(value.real < 0) and np.all(np.abs(value.imag) < 1e-9 * np.abs(value))
        assert [cycle.amplitude for cycle in cycles] == pytest.approx((4 / math.pi * np.abs(value)).tolist())
        # None is left out: from one to the next the dead time and the lags turn L once.
        turns = np.diff([cycle.w for cycle in cycles]) * plant.dead_time / (2 * math.pi)
        assert np.all((turns > 0.7) & (turns < 1.0))

    def test_a_relay_leaves_a_fast_cycle_for_the_slow_one(self) -> None:
        """P4 = e^(−4s)/(2s + 1), begun in the predicted cycle of 3.1 s; the exact period is 10.5 s."""
        slow, fast, *_ = relay_cycles(PLANTS["P4"], 1.0)
        h, t_end = 0.01, 400.0
        scans = round(4.0 / h)
        u = [1.0 if (i * h) % fast.period < fast.period / 2 else -1.0 for i in range(scans)]
        y = np.zeros(round(t_end / h))
        for k in range(1, y.size):
            y[k] = y[k - 1] + h / 2.0 * (u[k - 1] - y[k - 1])
            u.append(-1.0 if y[k] > 0 else 1.0)
        late = y[y.size // 2 :]
        period = np.diff(np.flatnonzero((late[:-1] < 0) & (late[1:] >= 0))).mean() * h
        assert period == pytest.approx(slow.period, rel=0.06) and period > 3 * fast.period
        assert late.max() == pytest.approx(slow.amplitude, rel=0.05)

    def test_a_loop_that_less_gain_makes_unstable_has_a_border_and_a_cycle(self) -> None:
        """(1 + s)²/(s²(1 + 3s)(1 + 0.01s)²) comes in below −180°, rises above it and falls below it again."""
        lags = np.polymul([1, 0, 0], np.polymul([3, 1], np.polymul([0.01, 1], [0.01, 1])))
        border, cycle = relay_cycles(Plant([1.0, 2.0, 1.0], lags), 1.0)
        assert (border.stable, cycle.stable) == (False, True) and cycle.amplitude < border.amplitude

    def test_over_compensation(self) -> None:
        assert over_compensation("P2", 0.05, 0.05) == []
        [small], [large] = over_compensation("P2", 0.06, 0.05), over_compensation("P2", 0.09, 0.05)
        assert large.amplitude == pytest.approx(4 * small.amplitude) and large.w == small.w
        [slow] = over_compensation("P2", 0.06, 0.05, tf=0.5)
        assert slow.w < small.w
        assert over_compensation(Plant([1], [1, 2, 1]), 1.0, 0.5) == []

    @pytest.mark.parametrize("name", ["P1", "P2", "P4"])
    def test_over_compensation_of_a_direct_acting_loop(self, name: str) -> None:
        """u_FF goes by sign(e)·sign(K); cycles of positive feedback came out."""
        assert over_compensation(-1 * PLANTS[name], 0.07, 0.05) == over_compensation(name, 0.07, 0.05)


def simulated(controller: Any, d: float, tf: float, period: float) -> tuple[float, float]:
    """Period, and amplitude of OP, of the limit cycle that P1 settles in."""
    t_end = 60 * period
    s = simulate.closed_loop("P1", controller, d=d, noise=0.0, h=0.01, t_end=t_end, setpoint=[(1, d)], tf=tf)
    late = s.t > t_end / 2
    op, t = s.op[late], s.t[late]
    middle = op - (op.max() + op.min()) / 2
    up = np.flatnonzero((middle[:-1] < 0) & (middle[1:] >= 0))
    crossings = t[up] - middle[up] / (middle[up + 1] - middle[up]) * 0.01
    return float(np.mean(np.diff(crossings))), float(np.ptp(op) / 2)


class TestPhaseLead:
    @pytest.mark.slow
    @pytest.mark.parametrize("margin", [1.2, 1.5, 1.9])
    def test_removes_the_intersection_with_its_margin(self, margin: float) -> None:
        loop = 1.6 * PLANTS["P1"] * Plant([1], [0.5, 1])
        assert backlash_cycles(loop, 1.0) != []
        lead = phase_lead(loop, margin)
        assert backlash_cycles(lead.loop, 1.0) == []
        assert margin <= lead.margin < 1.02 * margin and lead.lead > lead.lag
        assert lead.loop.response(1e-6) == pytest.approx(loop.response(1e-6), rel=1e-4)

    @pytest.mark.slow
    def test_more_margin_costs_more_lead(self) -> None:
        loop = 1.6 * PLANTS["P1"] * Plant([1], [0.5, 1])
        ratios = [lead.lead / lead.lag for lead in (phase_lead(loop, m) for m in (1.2, 1.5, 1.8))]
        assert ratios == sorted(ratios) and ratios[0] > 1

    def test_nothing_to_do(self) -> None:
        lead = phase_lead(migo("P2").loop, 2.0)
        assert lead.lead == lead.lag and lead.loop == migo("P2").loop

    def test_two_integrators_and_too_much(self) -> None:
        with pytest.raises(InputError, match="two integrators"):
            phase_lead(migo("P1").loop, 1.5)
        with pytest.raises(InputError, match="more than a lead/lag of 20"):
            phase_lead(PLANTS["P8"] * Plant([3], [1, 0]), 30)


@pytest.mark.slow
def test_figure_has_the_curves_of_the_thesis() -> None:
    t = assess("P1", (0.4, 7.0))
    figure = nyquist_figure({"P1": t.loop}, relay=True, criteria=True)
    names = [trace.name for trace in figure.data]
    assert names == ["P1", "−1/N(A) of a gap", "limit cycle", "−1/N(A) of a relay", "−1"]
    met = figure.data[2]
    [cycle] = backlash_cycles(t.loop, 1.0)
    assert complex(met.x[0], met.y[0]) == pytest.approx(complex(t.loop.response(cycle.w)))
    assert len(figure.layout.shapes) == 2
    assert [trace.name for trace in nyquist_figure(t.loop, backlash=False).data] == ["L(iω)", "−1"]
    assert [trace.name for trace in nyquist_figure([t.loop], backlash=False).data] == ["L(iω)", "−1"]
    assert [trace.name for trace in nyquist_figure([t, t.loop], backlash=False).data] == ["L1(iω)", "L2(iω)", "−1"]
