"""Tuning rules: the tables of others, a second road for every one, and their bounds."""

import math
from typing import Any

import numpy as np
import pytest
import scipy.signal
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from glapp import Controller, InputError, simulate
from glapp.plant import PLANTS, Plant
from glapp.tuning import (
    Fotd,
    Integrating,
    Tuning,
    amigo_frequency,
    amigo_step,
    assess,
    design,
    fotd,
    fotd_from_step,
    half_rule,
    integrating,
    lambda_tuning,
    migo,
    open_loop,
    simc,
    ultimate,
    ziegler_nichols_frequency,
    ziegler_nichols_step,
)

# K and Ti of MIGO PI, computed by two independent programs: combined circle 1.4, Ms 1.4, Ms 2.0.
MIGO_PI = {
    "P5": ((0.606, 2.09), (0.633, 1.95), (1.22, 1.78)),
    "P2": ((0.432, 2.43), (0.433, 2.25), (0.775, 2.05)),
    "P7": ((0.269, 3.84), (0.259, 3.55), (0.435, 3.21)),
    "P3": ((0.367, 0.46), (0.313, 0.37), (0.482, 0.31)),
    "P6": ((0.396, 2.02), (0.392, 1.86), (0.689, 1.68)),
    "P8": ((0.170, 0.404), (0.161, 0.372), (0.260, 0.332)),
    "P4": ((0.248, 2.71), (0.237, 2.49), (0.391, 2.22)),
    "P1": ((0.323, 13.3), (0.363, 7.06), (0.781, 4.04)),
}
BOUNDS: tuple[dict[str, float], ...] = ({"m": 1.4}, {"ms": 1.4}, {"ms": 2.0})


def greatest(plant: Plant, controller: tuple[float, ...], which: str) -> float:
    """Ms, Mt by brute force: nothing but a very fine grid."""
    w = np.geomspace(1e-4, 1e3, 400_000) / max(plant.dead_time, 0.3)
    k, ti, td = (*controller, 0.0)[:3]
    loop = plant.response(w) * k * (1 + 1 / (1j * w * ti) + 1j * w * td)
    return float(np.abs((1 if which == "ms" else loop) / (1 + loop)).max())


class TestModels:
    def test_fotd_of_p2(self) -> None:
        """The closed form is steepest at t = 3, where y = 1 − 13/e³ and the slope is 4.5/e³."""
        model = fotd("P2")
        assert model.l == pytest.approx(3 - (math.exp(3) - 13) / 4.5, rel=1e-8)
        assert (model.l, model.t) == pytest.approx((1.42, 2.90), rel=0.01)
        assert model.kp_process == 1

    def test_fotd_is_its_own_model(self) -> None:
        for model in (Fotd(2.0, 3.0, 1.0), Fotd(-0.4, 20.0, 0.1), Fotd(1.0, 0.1, 7.0)):
            again = fotd(model.plant)
            assert (again.kp_process, again.t, again.l) == pytest.approx((model.kp_process, model.t, model.l), rel=1e-7)

    @pytest.mark.parametrize("name", ["P2", "P3", "P4", "P5", "P6", "P7", "P8"])
    def test_fotd_from_a_response_simulated_by_scipy(self, name: str) -> None:
        plant = PLANTS[name]
        t = np.linspace(0, 40, 20_001)
        _, y = scipy.signal.step((plant.num, plant.den), T=t)
        late = np.interp(t - plant.dead_time, t, y, left=0.0)
        exact, read = fotd(plant), fotd_from_step(t, 20 - 3 * late, u_step=-3)
        assert read.kp_process == pytest.approx(1, rel=1e-3)
        assert (read.l, read.t) == pytest.approx((exact.l, exact.t), rel=0.012, abs=0.003)

    def test_fotd_from_a_noisy_response(self) -> None:
        t = np.arange(-5, 40, 0.05)
        y = (
            50
            + 2 * Plant.of("P2").step_response(np.maximum(t, 0))
            + 0.005 * np.random.default_rng(1).normal(size=t.size)
        )
        model = fotd_from_step(t, y, u_step=4)
        assert model.kp_process == pytest.approx(0.5, rel=0.01)
        assert (model.l, model.t) == pytest.approx((1.43, 2.93), rel=0.1)

    def test_steps_that_say_nothing_are_refused(self) -> None:
        t = np.linspace(0, 3, 100)
        with pytest.raises(InputError, match="not come to rest"):
            fotd_from_step(t, PLANTS["P2"].step_response(t), 1)
        with pytest.raises(InputError, match="not come to rest"):
            fotd_from_step(t, np.zeros(100), 1)
        with pytest.raises(InputError, match="u_step"):
            fotd_from_step(t, t, 0)
        with pytest.raises(InputError, match="shapes"):
            fotd_from_step(t, t[:50], 1)
        with pytest.raises(InputError, match="ascending"):
            fotd_from_step(t[::-1], t, 1)

    @pytest.mark.parametrize(
        ("plant", "message"),
        [
            ("P1", "integrator"),
            (Plant([1], [1, -1]), "unstable"),
            (Plant([1, 0], [1, 2, 1]), "static gain of 0"),
            (Plant([1, 2], [1, 1]), "jumps"),
            (Plant([30, 1], [1, 2, 1]), "more than half"),
            (Plant([-9, 1], [1, 2, 1]), "more than half"),
        ],
    )
    def test_processes_without_fotd_model(self, plant: Any, message: str) -> None:
        with pytest.raises(InputError, match=message):
            fotd(plant)

    def test_integrating_model_is_the_asymptote(self) -> None:
        plant = Plant([0.5, 2.0], [3.0, 4.0, 1.0, 0.0], 0.7)
        model = integrating(plant)
        late = np.array([200.0, 201.0])
        np.testing.assert_allclose(plant.step_response(late), model.kv * (late - model.l), rtol=1e-9)
        with pytest.raises(InputError, match="one integrator"):
            integrating("P2")
        with pytest.raises(InputError, match="lag"):
            integrating(Plant([9, 1], [1, 1, 0]))

    @pytest.mark.slow
    def test_ultimate_point(self) -> None:
        """Known by hand: n equal lags turn by 180°/n each; with the gain Ku the loop has a pole pair on the axis."""
        for n, name in ((3, "P5"), (4, "P2"), (8, "P7")):
            ku, tu = ultimate(name)
            assert tu == pytest.approx(2 * math.pi / math.tan(math.pi / n), rel=1e-9)
            assert ku == pytest.approx((1 / math.cos(math.pi / n)) ** n, rel=1e-9)
        for name in PLANTS:
            ku, tu = ultimate(name)
            assert PLANTS[name].response(2 * math.pi / tu) == pytest.approx(-1 / ku, rel=1e-6)
            turned = ultimate(-2 * PLANTS[name])
            assert turned == pytest.approx((-ku / 2, tu))
        with pytest.raises(InputError, match="no ultimate gain"):
            ultimate(Plant([1], [1, 2, 1]))

    def test_half_rule_of_skogestad(self) -> None:
        """Example E1 of his article: (1 − 0.3 s + …) left aside, 1/((s + 1)(0.2 s + 1)(0.05 s + 1))."""
        den = np.polymul(np.polymul([1, 1], [0.2, 1]), [0.05, 1])
        plant = Plant([1], den.tolist(), 0.02)
        assert half_rule(plant) == pytest.approx((1, 1.1, 0, 0.02 + 0.1 + 0.05))
        assert half_rule(plant, "PID") == pytest.approx((1, 1, 0.225, 0.045))
        assert half_rule("P6", "PI") == pytest.approx((1, 1.5, 0, 2.0))
        assert half_rule(([2], [1, 0], 0.5)) == pytest.approx((2, math.inf, 0, 0.5))  # once a mean of no lags
        assert half_rule("P1", "PID") == pytest.approx((1, math.inf, 0.8, 0.2))
        for name in ("P3", Plant([2, 1], [1, 2, 1])):
            with pytest.raises(InputError, match=r"fotd\(plant\)"):
                half_rule(name)


class TestAssess:
    @pytest.mark.parametrize("name", PLANTS)
    def test_peaks_against_brute_force(self, name: str) -> None:
        t = amigo_step(name, "PI")
        assert t.ms == pytest.approx(greatest(t.plant, t.controller[:3], "ms"), rel=1e-6)
        assert t.mt == pytest.approx(max(greatest(t.plant, t.controller[:3], "mt"), 1), rel=1e-6)

    @pytest.mark.slow
    def test_margins_move_the_loop_to_its_border(self) -> None:
        for name in ("P1", "P2", "P3", "P8"):
            t = migo(name, ms=1.6)
            k, ti, td, _ = t.controller
            at_border = open_loop(t.plant, (k * t.gain_margin, ti, td))
            w = at_border.frequencies(per_decade=4000)
            assert np.abs(1 + at_border.response(w)).min() < 2e-3
            assert assess(name, (k * t.gain_margin * 0.99, ti, td)).ms > 50
            with pytest.raises(InputError, match="unstable"):
                assess(name, (k * t.gain_margin * 1.01, ti, td))

    def test_delay_that_takes_the_phase_margin(self) -> None:
        t = migo("P2", ms=1.6)
        w = t.loop.frequencies(per_decade=4000)
        crossover = w[np.flatnonzero(np.abs(t.loop.response(w)) > 1).max()]
        delay = math.radians(t.phase_margin) / crossover
        assert assess(t.plant.delayed(0.98 * delay), t.controller).ms > 20
        with pytest.raises(InputError, match="unstable"):
            assess(t.plant.delayed(1.02 * delay), t.controller)

    @pytest.mark.parametrize(
        ("name", "ms"), [("P2", 1.4), ("P2", 2.0), ("P3", 2.0), ("P5", 2.0), ("P7", 2.0), ("P1", 2.0)]
    )
    def test_iae_against_the_simulator(self, name: str, ms: float) -> None:
        t = migo(name, ms=ms)
        h = 0.002
        s = simulate.closed_loop(name, t.controller, d=0, noise=0, h=h, t_end=150, load=[(h, 1.0)], tf=0)
        assert t.iae == pytest.approx(np.abs(s.pv).sum() * h, rel=3e-3)

    @pytest.mark.parametrize("name", ["P2", "P3", "P5", "P6", "P7"])
    @pytest.mark.slow
    def test_iae_against_residues(self, name: str) -> None:
        """The load response without dead time is a sum of exponentials, from partial fractions."""
        t = migo(name, ms=2.0)
        k, ti, _, _ = t.controller
        num = np.polymul(t.plant.num, [ti, 0])
        den = np.polyadd(np.polymul(t.plant.den, [ti, 0]), np.polymul(t.plant.num, [k * ti, k]))
        residues, poles, _ = scipy.signal.residue(num, np.polymul(den, [1, 0]))
        time = np.linspace(0, 120, 400_001)
        y = (residues[:, None] * np.exp(poles[:, None] * time)).sum(axis=0).real
        assert t.iae == pytest.approx(np.abs(y).sum() * time[1], rel=1e-4)

    def test_iae_is_one_over_ki_without_a_swing(self) -> None:
        for name in ("P2", "P4", "P5", "P7", "P8"):
            t = migo(name, ms=1.4)
            assert t.iae * t.ki == pytest.approx(1, rel=1e-4)
        assert assess("P2", (0.775, 2.05)).iae * 0.775 / 2.05 > 1.2

    def test_negative_gains_change_nothing_else(self) -> None:
        for rule in (migo, amigo_step, amigo_frequency, ziegler_nichols_frequency, ziegler_nichols_step):
            one, other = rule("P2", "PI"), rule(-4 * PLANTS["P2"], "PI")
            assert other.controller.k == pytest.approx(-one.controller.k / 4, rel=1e-9)
            assert (other.ms, other.mt, other.iae / 4) == pytest.approx((one.ms, one.mt, one.iae), rel=1e-6)
        one, other = design("P2", "PI"), design(-4 * PLANTS["P2"], "PI")
        assert other.controller.k == pytest.approx(-one.controller.k / 4, rel=1e-9)

    @pytest.mark.slow
    def test_loops_that_end_on_a_circle(self) -> None:
        """PID on a first-order lag: at high frequencies |L| stays at K·Td/T, and dead time turns it round and round."""
        t = assess(Plant([1], [1, 1], 0.1), (0.5, 1.0, 1.0))
        assert t.ms == pytest.approx(2, rel=1e-3)
        with pytest.raises(InputError, match="unstable"):
            assess(Plant([1], [1, 1], 0.1), (1.01, 1.0, 1.0))

    @pytest.mark.parametrize(
        ("controller", "name"),
        [((0, 1), "k"), ((1, 0), "ti"), ((1, 1, -1), "td"), ((math.nan, 1), "k"), ((1,), "controller")],
    )
    def test_wrong_controllers(self, controller: tuple[float, ...], name: str) -> None:
        with pytest.raises(InputError) as error:
            assess("P2", controller)
        assert error.value.parameter == name

    def test_unstable_plants_and_wrong_signs(self) -> None:
        with pytest.raises(InputError, match="right half plane"):
            assess(Plant([1], [1, -1]), (3, 1))
        with pytest.raises(InputError, match="unstable"):
            assess("P2", (-0.1, 2))
        with pytest.raises(InputError, match="jumps"):
            open_loop(Plant([1, 2], [1, 1]), (1, 1, 1))
        with pytest.raises(InputError, match="tf"):
            open_loop("P2", (1, 1), tf=-1)


class TestMigo:
    @pytest.mark.parametrize("name", MIGO_PI)
    @pytest.mark.parametrize("i", range(3))
    def test_pi_against_the_table(self, name: str, i: int) -> None:
        t = migo(name, **BOUNDS[i])
        k, ti = MIGO_PI[name][i]
        assert (t.controller.k, t.controller.ti) == pytest.approx((k, ti), rel=0.02)
        assert t.ki == pytest.approx(k / ti, rel=0.02)

    def test_pi_of_the_thesis(self) -> None:
        k, ti, *_ = migo("P3", ms=2.0).controller
        assert (k, ti) == pytest.approx((0.48, 0.3117), rel=0.01)

    @pytest.mark.parametrize("name", MIGO_PI)
    @pytest.mark.parametrize("ms", [1.4, 2.0])
    def test_pi_by_constrained_optimisation(self, name: str, ms: float) -> None:
        """Another road: SciPy's SLSQP on (K, ki) with the distance to −1 over a fixed grid as its constraints."""
        t = migo(name, ms=ms)
        k, ti, *_ = t.controller
        w = np.geomspace(0.02, 50, 3000) / ti
        p = t.plant.response(w)

        def distance(x: Any) -> Any:
            return np.abs(1 + p * (x[0] * k - 1j * x[1] * k / ti / w)) ** 2 - 1 / ms**2

        # Without bounds a rounding elsewhere (one thread of BLAS or two) sends it off to 1e30.
        found = minimize(
            lambda x: -x[1],
            [0.9, 0.8],
            method="SLSQP",
            bounds=[(0.2, 5.0)] * 2,
            constraints={"type": "ineq", "fun": distance},
            tol=1e-10,
        )
        assert found.x[1] == pytest.approx(1, rel=2e-4)
        assert found.x[0] == pytest.approx(1, rel=0.01)

    @pytest.mark.slow
    @pytest.mark.parametrize("kind", ["PI", "PID"])
    @pytest.mark.parametrize("name", PLANTS)
    def test_bounds_hold_and_are_reached(self, name: str, kind: Any) -> None:
        t = migo(name, kind, ms=1.6, mt=1.5)
        assert t.ms <= 1.6 * 1.001 and t.mt <= 1.5 * 1.001
        assert t.ms > 1.59 or t.mt > 1.49
        one = migo(name, kind, m=1.5)
        assert max(one.ms, one.mt) <= 1.5 * 1.001

    @pytest.mark.parametrize("name", ["P2", "P5", "P6", "P7"])
    def test_pid_top_is_smooth_and_derivative_helps(self, name: str) -> None:
        """A small change of K alone costs the second order only: not so on an edge."""
        t = migo(name, "PID", ms=1.4)
        assert t.ki > 1.5 * migo(name, ms=1.4).ki
        k, ti, td, _ = t.controller
        for factor in (0.995, 1.005):
            moved = assess(name, (k * factor, ti * factor, td / factor))
            assert moved.ms < 1.4 * 1.004

    @pytest.mark.slow
    @pytest.mark.parametrize("name", ["P2", "P5", "P6", "P7"])
    def test_pid_by_constrained_optimisation(self, name: str) -> None:
        """SLSQP finds no better K and ki for the same kd; for a kd a little larger the top is an edge."""
        t = migo(name, "PID", m=1.4)
        k, ti, td, _ = t.controller
        c, r = 2.12 / 1.12, 1.8 / 1.12
        w = np.geomspace(0.02, 100, 4000) / ti
        p = t.plant.response(w)

        def best(kd: float) -> Any:
            def clear(x: Any) -> Any:
                return np.abs(c + p * (x[0] * k - 1j * (x[1] * k / ti / w - kd * w))) ** 2 - r * r

            return minimize(
                lambda x: -x[1], [0.97, 0.95], method="SLSQP", constraints={"type": "ineq", "fun": clear}, tol=1e-10
            ).x

        assert best(k * td) == pytest.approx([1, 1], rel=4e-3)

    def test_filter_is_counted_in(self) -> None:
        t = migo("P2", ms=1.4, tf=0.2)
        assert t.ms == pytest.approx(1.4, rel=1e-3)
        assert t.tf == 0.2 and t.ki < migo("P2", ms=1.4).ki

    @pytest.mark.parametrize(
        ("plant", "bounds", "message"),
        [
            ("P2", {"ms": 1.0}, "ms: is 1, must be greater than 1"),
            ("P2", {"m": 0.9}, "m: is 0.9"),
            ("P2", {"m": 1.4, "ms": 1.4}, "give it, or ms and mt"),
            (Plant([1], [1, -1]), {}, "stable"),
            (Plant([1], [1, 0, 0]), {}, "stable"),
            (Plant([1], [1, 1]), {}, "allows any gain"),
            (Plant([1], [1, 0.1, 1], 0.5), {}, "purely integrating"),
            (Plant([1, 0], [1, 2, 1]), {}, "static gain of 0"),
        ],
    )
    def test_what_has_no_answer(self, plant: Any, bounds: dict[str, float], message: str) -> None:
        with pytest.raises(InputError, match=message):
            migo(plant, **bounds)

    @pytest.mark.slow
    def test_pid_without_limit_and_on_a_jump(self) -> None:
        with pytest.raises(InputError, match="allows any gain"):
            migo(Plant([1], [1, 2, 1]), "PID")
        with pytest.raises(InputError, match="jumps"):
            migo(Plant([1], [1], 1.0), "PID")

    @settings(max_examples=25)
    @given(
        lags=st.lists(st.floats(0.05, 20), min_size=1, max_size=4),
        dead_time=st.floats(0.05, 20),
        gain=st.floats(-5, 5).filter(lambda x: abs(x) > 0.1),
        ms=st.floats(1.2, 2.2),
    )
    @pytest.mark.slow
    def test_any_monotone_process(self, lags: list[float], dead_time: float, gain: float, ms: float) -> None:
        den = np.array([1.0])
        for lag in lags:
            den = np.polymul(den, [lag, 1])
        t = migo(Plant([gain], den.tolist(), dead_time), ms=ms)
        assert t.ms == pytest.approx(ms, rel=2e-3)
        assert t.controller.k * gain > 0


class TestDesign:
    @pytest.mark.verify
    @pytest.mark.parametrize("kind", ["PI", "PID"])
    @pytest.mark.parametrize("name", ["P2", "P3", "P5", "P8"])
    def test_no_neighbour_is_better(self, name: str, kind: Any) -> None:
        """Brute force around it: other Ti and Td with their own filter and the greatest robust gain."""
        t = design(name, kind, ms=1.6, mt=1.6)
        assert t.ms <= 1.6 * 1.001 and t.mt <= 1.6 * 1.001
        k, ti, td, _ = t.controller
        assert t.tf == pytest.approx(td / 5 if kind == "PID" else ti / 10)
        for factor_i, factor_d in ((0.85, 1), (1.15, 1), (1, 0.85), (1, 1.15)):
            if kind == "PI" and factor_d != 1:
                continue
            other_i, other_d = ti * factor_i, td * factor_d
            tf = other_d / 5 if kind == "PID" else other_i / 10
            best = min(
                (one.iae for one in (assess(name, (k * f, other_i, other_d), tf=tf) for f in np.linspace(0.7, 1.2, 26))
                 if one.ms <= 1.6 and one.mt <= 1.6),
                default=math.inf,
            )  # fmt: skip
            assert t.iae < 1.01 * best

    @pytest.mark.slow
    def test_a_very_slow_lag_is_an_integrator(self) -> None:
        slow, pure = design(Plant([1], [1000, 1], 0.01), "PID"), design(Plant([1e-3], [1, 0], 0.01), "PID")
        assert slow.controller[:3] == pytest.approx(pure.controller[:3], rel=0.05)

    @pytest.mark.slow
    def test_integrating_process(self) -> None:
        t = design("P1", "PID", ms=1.6, mt=1.6)
        assert t.ms <= 1.602 and t.mt <= 1.602
        with pytest.raises(InputError, match="no PI controller with its filter"):
            design("P1", "PI", ms=1.4, mt=1.4)


class TestRules:
    def test_p2(self) -> None:
        """ANCHORS: AMIGO of 1/(s + 1)⁴."""
        assert amigo_step("P2", "PI").controller[:2] == pytest.approx((0.414, 2.66), rel=0.01)
        assert amigo_step("P2", "PID").controller[:3] == pytest.approx((1.12, 2.40, 0.619), rel=0.01)

    @pytest.mark.parametrize("table", ["textbook", "original"])
    def test_ziegler_nichols_tables(self, table: Any) -> None:
        k, ti, td, _ = ziegler_nichols_frequency("P2", "PI", table=table).controller
        share, periods = (0.4, 0.8) if table == "textbook" else (0.45, 1 / 1.2)
        assert (k, ti, td) == pytest.approx((4 * share, 2 * math.pi * periods, 0))
        model = Fotd(2.0, 3.0, 1.0)
        k, ti, *_ = ziegler_nichols_step(model, "PI", table=table).controller
        assert (k, ti) == pytest.approx((0.9 * 3 / 2, 3 if table == "textbook" else 1 / 0.3))
        again = ziegler_nichols_step(model.plant, "PI", table=table).controller
        assert (again.k, again.ti) == pytest.approx((k, ti), rel=1e-6)

    def test_ziegler_nichols_takes_the_tangent_of_the_process(self) -> None:
        """Regression: the rule used Kp·L/T of the FOTD model, a third too much.

        For 1/(s + 1)³ the textbooks print a = 0.218, L = 0.806 and PID 5.50 / 1.61 / 0.403.
        """
        assert ziegler_nichols_step("P5", "PID").controller[:3] == pytest.approx((5.50, 1.61, 0.403), rel=2e-3)
        a = 26.5 / math.exp(3) - 1  # 1/(s + 1)⁴: y(3) = 1 − 13/e³, slope 4.5/e³
        assert 0.9 / ziegler_nichols_step("P2", "PI").controller.k == pytest.approx(a, rel=1e-8)
        with pytest.raises(InputError, match="unstable"):
            ziegler_nichols_step("P3", "PI")

    def test_lambda_sets_the_closed_loop(self) -> None:
        """PI cancels the lag: the loop is e^(−sL)/(s(λ + L)), whose margins are known."""
        t = lambda_tuning(Fotd(2.0, 5.0, 1.0), lam=3.0)
        assert t.phase_margin == pytest.approx(90 - math.degrees(0.25), rel=1e-6)
        assert t.gain_margin == pytest.approx(2 * math.pi, rel=1e-6)

    def test_lambda_pid_on_pade(self) -> None:
        """With (1 − sL/2)/(1 + sL/2) for the dead time the closed loop is (1 − sL/2)/(1 + λs), exactly."""
        kp, t, late, lam = 2.0, 5.0, 1.0, 3.0
        k, ti, td, _ = lambda_tuning(Fotd(kp, t, late), "PID", lam=lam).controller
        s = 1j * np.geomspace(1e-3, 1e3, 40)
        loop = kp / (1 + t * s) * (1 - s * late / 2) / (1 + s * late / 2) * k * (1 + 1 / (ti * s) + td * s)
        np.testing.assert_allclose(loop / (1 + loop), (1 - s * late / 2) / (1 + lam * s), rtol=1e-9)

    def test_lambda_on_an_integrator(self) -> None:
        """With 1 − sL for the dead time both poles of the closed loop are at −1/λ."""
        kv, late, lam = 0.3, 1.0, 4.0
        k, ti, *_ = lambda_tuning(Integrating(kv, late), lam=lam).controller
        closed = np.polyadd([ti, 0, 0], k * kv * np.polymul([-late, 1], [ti, 1]))
        np.testing.assert_allclose(closed / closed[-1], [lam**2, 2 * lam, 1], rtol=1e-9)

    @pytest.mark.slow
    @pytest.mark.parametrize(
        ("rule", "kind", "names", "k_within", "ki_within"),
        [
            (amigo_step, "PI", ("P1", "P2", "P4", "P5", "P6", "P7", "P8"), 0.15, 0.20),
            (amigo_step, "PID", ("P2", "P4", "P6", "P7", "P8"), 0.25, 0.15),
            (amigo_frequency, "PI", ("P4", "P7", "P8"), 0.15, 0.15),
            (amigo_frequency, "PID", ("P2", "P4", "P6", "P7", "P8"), 0.05, 0.15),
        ],
    )
    def test_amigo_approximates_migo(self, rule: Any, kind: Any, names: Any, k_within: float, ki_within: float) -> None:
        """The formulas were fitted to MIGO's designs; PID where τ > 0.3, PI by frequency where κ > 0.5."""
        for name in names:
            ours, theirs = rule(name, kind), migo(name, kind, m=1.4)
            assert ours.controller.k == pytest.approx(theirs.controller.k, rel=k_within), name
            assert ours.ki == pytest.approx(theirs.ki, rel=ki_within), name

    def test_simc_has_its_known_margins(self) -> None:
        """Skogestad: with τc = L and Ti = T, Ms = 1.59, gain margin 3.14, phase margin 61.4°."""
        t = simc(Fotd(1.0, 3.0, 1.0))
        assert (t.ms, t.gain_margin, t.phase_margin) == pytest.approx((1.59, 3.14, 61.4), rel=3e-3)
        t = simc(Integrating(0.3, 1.0))
        assert (t.ms, t.gain_margin, t.phase_margin) == pytest.approx((1.70, 2.96, 46.9), rel=3e-3)

    def test_simc_pid_is_its_series_form(self) -> None:
        t = simc("P2", "PID")
        w = np.geomspace(0.01, 100, 50)
        k, ti, td, _ = t.controller
        ideal = k * (1 + 1 / (1j * w * ti) + 1j * w * td)
        # Half rule: lags 1 and 1.5 of which the longer one leads, L = 1.5.
        np.testing.assert_allclose(ideal, 0.5 * (1 + 1 / (1j * w * 1.5)) * (1 + 1j * w * 1.0), rtol=1e-9)

    @pytest.mark.parametrize(
        ("call", "message"),
        [
            (lambda: amigo_step(Fotd(1, 2, 0)), "l = 0: must be greater than 0 s"),
            (lambda: ziegler_nichols_step(Fotd(1, 2, 0)), "a = 0"),
            (lambda: lambda_tuning("P2", lam=0), "lam: is 0, must be greater than 0 s"),
            (lambda: lambda_tuning("P1", "PID", lam=1), "without integrator"),
            (lambda: simc("P2", tau_c=-1), "tau_c: is -1, must be greater than 0 s"),
            (lambda: lambda_tuning("P2", lam="3"), "lam: is '3', must be greater than 0 s"),  # type: ignore[arg-type]
            (lambda: simc(Fotd(1, 2, 0)), "tau_c: is required"),
            (lambda: Fotd(0, 2, 1), "kp_process: is 0, must be other than 0"),
            (lambda: Fotd(1, -2, 1), "t: is -2, must be 0 s or greater"),
            (lambda: Integrating(math.nan, 1), "kv: is nan, must be other than 0"),
            (lambda: Integrating(1, -1), "l: is -1, must be 0 s or greater"),
            (lambda: assess("P2", Controller(k=1, ti=3)), "ideal form; write controller.ideal"),  # type: ignore[arg-type]
            (lambda: assess("P2", {"k": 1, "ti": 3}), "write .k, ti."),  # type: ignore[arg-type]
            (lambda: assess("P2", None), "write .k, ti."),  # type: ignore[arg-type]
            (lambda: assess("P2", ("K", 3)), "write .k, ti."),  # type: ignore[arg-type]
            (lambda: simc(Fotd(1, 2, 1), "PID"), "one lag"),
            (lambda: amigo_frequency(Plant([1], [1, 2, 1])), "no ultimate gain"),
            (lambda: amigo_step("P2", "P"), "kind: is 'P'"),  # type: ignore[arg-type]
            (lambda: ziegler_nichols_step("P2", table="new"), "table: is 'new'"),  # type: ignore[arg-type]
            (lambda: ziegler_nichols_frequency("P8"), "unstable"),
            (lambda: amigo_step(Plant([1], [1, -1])), "unstable"),
        ],
    )
    def test_bounds_are_named(self, call: Any, message: str) -> None:
        with pytest.raises(InputError, match=message):
            call()

    def test_every_rule_says_where_it_is_from(self) -> None:
        tunings: list[Tuning] = [
            ziegler_nichols_step("P2"),
            ziegler_nichols_frequency("P2"),
            lambda_tuning("P2", lam=3),
            amigo_step("P2"),
            amigo_frequency("P2"),
            simc("P2"),
            migo("P2"),
            design("P2", "PI"),
        ]
        for t in tunings:
            assert t.rule and t.source and t.rule in str(t)
            assert t.ms > 1 and t.iae > 0 and math.isfinite(t.phase_margin)
