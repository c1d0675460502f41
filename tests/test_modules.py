"""Control modules: the controller against independent ones, and the thesis' results on loops made of modules."""

import itertools
import math
from collections.abc import Callable
from typing import Any

import control
import numpy as np
import numpy.typing as npt
import pytest
from bench import wrong_sign
from scipy.integrate import solve_ivp

from glapp.errors import InputError
from glapp.modules import (
    Backlash,
    BacklashDetection,
    Filter2P,
    Flag,
    Friction,
    FrictionModel,
    Graph,
    Input,
    Mode,
    Noise,
    Output,
    Pid,
    PidAdvanced,
    Plant,
    ProcessSim,
    RateLimit,
    Resolution,
    Saturation,
    Source,
    Sum,
    TuneRule,
    Unfit,
    Way,
)
from glapp.simulate import Friction as Stem
from glapp.simulate import Scenario, run

Column = npt.NDArray[np.float64]
H = 0.05


def alone(pid: Pid) -> Graph:
    """The controller with everything that goes in from outside."""
    modules = {"pv": Input(), "sp": Input(), "ff": Input(), "pid": pid, "op": Output()}
    return Graph(H, modules, ["pv -> pid.pv", "sp -> pid.sp", "ff -> pid.ff", "pid -> op"])


# --- The law, against python-control ---------------------------------------------------------------------------------


def discrete(pid: Pid) -> tuple[control.TransferFunction, control.TransferFunction]:
    """Transfer functions from setpoint and from process value to output: backward differences, as the documentation
    states them.
    """
    z = control.TransferFunction([1, 0], [1], H)
    one = control.TransferFunction([1], [1], H)
    a = H / (pid.tf + H)
    section = a * z / (z - (1 - a))
    integral, derivative = H / pid.ti * z / (z - 1), pid.td / H * (z - 1) / z
    from_sp = pid.k * (pid.b * one + integral + pid.c * derivative)
    from_pv = -pid.k * (one + integral + derivative) * section * section
    return from_sp, from_pv


FORMS: dict[str, Callable[..., Pid]] = {
    "ideal": lambda **others: Pid(k=1.3, ti=4.0, td=0.7, **others),
    "ideal PI": lambda **others: Pid(k=1.3, ti=4.0, **others),
    "series": lambda **others: Pid.series(k=1.3, ti=4.0, td=0.7, **others),
    "parallel": lambda **others: Pid.parallel(kp=1.3, ki=0.4, kd=0.9, **others),
    "direct": lambda **others: Pid(k=-1.3, ti=4.0, td=0.7, **others),
}
WEIGHTS: dict[str, dict[str, float]] = {
    "b = 1": {},
    "b = 0": {"b": 0.0},
    "b, c": {"b": 0.4, "c": 0.6},
    "filter": {"tf": 0.3},
    "filter, c": {"tf": 0.3, "c": 1.0},
}


@pytest.mark.parametrize("weights", WEIGHTS)
@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("mode", [Mode.AUTO, Mode.EXTERNAL])
def test_the_law_is_that_of_python_control(form: str, weights: str, mode: Mode) -> None:
    pid = FORMS[form](**WEIGHTS[weights])
    n = 400
    random = np.random.default_rng(1)
    sp, pv = np.cumsum(random.normal(size=(2, n)) * 0.1, axis=1)
    ff = random.normal(size=n)
    # The models begin at zero; the first scan seats the integral, so that it is given a zero.
    sp[0] = pv[0] = ff[0] = 0.0
    t = np.arange(n) * H
    expected = sum(
        control.forced_response(model, t, x).outputs for model, x in zip(discrete(pid), (sp, pv), strict=True)
    )

    loop = alone(pid)
    loop["pid.mode"] = mode
    got = []
    for y, r, u in zip(pv, sp, ff, strict=True):
        if mode == Mode.AUTO:
            loop["pid.sp"] = r
        loop.scan(pv=y, sp=r, ff=u)
        got.append(loop["pid"])
    assert np.max(np.abs(np.array(got) - (expected + ff))) < 1e-9


def test_forms_are_the_same_transfer_function() -> None:
    s = 0.7j
    for pid, written in (
        (Pid.series(k=1.3, ti=4.0, td=0.7), 1.3 * (1 + 1 / (4.0 * s)) * (1 + 0.7 * s)),
        (Pid.parallel(kp=1.3, ki=0.4, kd=0.9), 1.3 + 0.4 / s + 0.9 * s),
    ):
        assert abs(pid.k * (1 + 1 / (pid.ti * s) + pid.td * s) - written) < 1e-12


@pytest.mark.parametrize("form", FORMS)
def test_step_responses_are_the_closed_form(form: str) -> None:
    """A step of the error: K·(b + (n + 1)·h/Ti), and c·Td/h more in its first sample."""
    pid = FORMS[form](b=0.4, c=0.6)
    loop = alone(pid)
    loop.run(10 * H)
    got = loop.run(200 * H, record=["pid"], sp=np.ones(200))["pid"]
    expected = pid.k * (pid.b + np.arange(1, 201) * H / pid.ti)
    expected[0] += pid.k * pid.c * pid.td / H
    assert np.max(np.abs(got - expected)) < 1e-9


def test_closed_loop_step_is_the_closed_form() -> None:
    """A lag whose pole the controller's zero cancels: what remains is one pole, y = 1 − (1 − g)ⁿ."""
    lag, k = 3.0, 0.4
    p = math.exp(-H / lag)
    pid = Pid(k=k, ti=H / (1 / p - 1))
    loop = Graph(
        H, {"sp": Input(), "pid": pid, "lag": Plant(([1.0], [lag, 1.0]))}, ["sp -> pid.sp", "pid -> lag -> pid.pv"]
    )
    loop.run(10 * H)
    got = loop.run(300 * H, record=["lag"], sp=np.ones(300))["lag"]
    assert np.max(np.abs(got - (1 - (1 - k * (1 - p) / p) ** np.arange(300)))) < 1e-9


# --- Bumps and windup -------------------------------------------------------------------------------------------------


WINDUP_LIMIT = 0.1


@pytest.mark.slow
def test_anti_windup_beside_the_integrator_of_the_literature() -> None:
    """1/s under PI with a limited output, the example on which windup and tracking are usually shown.

    Beside the same loop integrated in continuous time, with the tracking time constant Ti, and without tracking.
    """
    k, ti, h, t_end = 1.0, 1.0, 0.005, 40.0

    def continuous(tracking: float) -> Column:
        def slope(_t: float, x: Column) -> list[float]:
            y, integral = x
            v = k * (1 - y) + integral
            u = min(max(v, -WINDUP_LIMIT), WINDUP_LIMIT)
            return [u, k / ti * (1 - y) + tracking * (u - v)]

        t = np.arange(0, t_end, h)
        solved = solve_ivp(slope, (0, t_end), [0.0, 0.0], t_eval=t, max_step=h, rtol=1e-8)
        y: Column = solved.y[0]
        return y

    loop = Graph(
        h,
        {
            "sp": Input(),
            "pid": Pid(k=k, ti=ti),
            "valve": Saturation(-WINDUP_LIMIT, WINDUP_LIMIT),
            "integrator": Plant(([1.0], [1.0, 0.0])),
        },
        ["sp -> pid.sp", "pid -> valve -> integrator -> pid.pv"],
    )
    loop.run(h)
    n = round(t_end / h)
    # The limits are the valve's, and the controller knows them from what it is told backward.
    y = loop.run(t_end, record=["integrator"], sp=np.ones(n))["integrator"]
    assert np.max(np.abs(y - continuous(tracking=1 / ti))) < 5e-3
    assert y.max() < 1.06
    assert continuous(tracking=0.0).max() > 1.5


def test_a_limit_beyond_a_slave_stops_the_masters_integral() -> None:
    modules = {
        "sp": Input(50.0),
        "master": Pid(k=1.0, ti=20.0, low=0, high=100, start=50.0),
        "slave": Pid(k=2.0, ti=2.0, low=0, high=100, start=50.0),
        "valve": Saturation(0.0, 60.0),
        "flow": ProcessSim(1.0, 1.0, start=50.0),
        "tank": ProcessSim(1.0, 20.0, start=50.0),
    }
    wires = ["sp -> master.sp", "master -> slave.sp", "slave -> valve -> flow -> tank -> master.pv", "flow -> slave.pv"]
    loop = Graph(0.2, modules, wires)
    loop.run(20)
    asked = loop.run(400, record=["master", "flow", "sp.flags"], sp=np.full(2000, 90.0))
    # More than the valve can give: the master stands still a little above what the slave reaches.
    assert asked["master"].max() < 95.0 and np.ptp(asked["master"][-500:]) == 0.0
    assert Flag.AT_HIGH in Flag(int(asked["sp.flags"][-1]))
    back = loop.run(100, record=["flow"], sp=np.full(500, 30.0))["flow"]
    # Both leave the limit at once.
    assert int(np.argmax(back < 59.0)) * 0.2 < 5.0
    assert loop["sp.flags"] == 0.0


# --- The wrong sign ---------------------------------------------------------------------------------------------------


def wrong_loop(gain: float, way: Way) -> Graph:
    """A loop that compensates a gap of 2 %; K is 2 whatever the sign of the process."""
    modules = {
        "sp": Input(),
        "load": Input(),
        "pid": PidAdvanced(k=2.0, ti=2.0, tf=0.2, low=-50, high=50, rate=1e6, kp=1.0, comp_size=1.0, comp_way=way),
        "gap": Backlash(2.0),
        "process": ProcessSim(gain, 3.0, 1.0),
        "noise": Noise(0.1),
    }
    return Graph(0.1, modules, ["sp -> pid.sp", "load -> process.load", "pid -> gap -> process -> noise -> pid.pv"])


@pytest.mark.parametrize("way", list(Way))
def test_a_process_of_the_wrong_sign_is_reported_and_recovers_without_a_bump(way: Way) -> None:
    """Somebody turns the valve's action round while it compensates; then somebody turns K round."""
    loop = wrong_loop(1.0, way)
    loop["pid.compensate"] = 1
    healthy = loop.run(600, load=LOAD[:6000], record=["pid.error", "pid.u_ff"])
    assert not healthy["pid.error"].any() and healthy["pid.u_ff"].any()
    loop["process.gain"] = -1.0
    seen = loop.run(200, record=["pid", "pid.error", "pid.u_ff", "pid.standing", "pid.flags"])
    found = int(np.argmax(seen["pid.error"] == Flag.WRONG_SIGN))
    assert 0 < found < 1000 and (seen["pid.error"][found:] == Flag.WRONG_SIGN).all(), "within 50 Ti, and it stays"
    assert abs(seen["pid"][-1]) == 50.0 and not seen["pid.u_ff"][found + 25 :].any()
    assert (seen["pid.standing"][found + 1 :] == 8.0).all()  # as at a limit
    loop.reset_detection("pid")
    loop.scan()
    assert loop["pid.error"] == Flag.WRONG_SIGN, "that is not what a detector forgets"
    before, most = loop["pid"], 2.0 * 0.1 / 2.0 * abs(loop["pid.yf"])
    loop["pid.k"] = -2.0
    back = loop.run(300, record=["pid", "pid.error", "process"])
    assert 0.0 < abs(back["pid"][0] - before) <= most + 0.5, "no more than its integration"
    assert back["pid.error"][-1] == 0.0 and abs(back["process"][-1]) < 3.0


@pytest.mark.slow
def test_the_wrong_sign_of_random_loops() -> None:
    """A few of those that bench/results/modules.md counts."""
    found = [one for one in map(wrong_sign.loop, range(12)) if one is not None]
    assert len(found) > 10
    assert all(one.right is None for one in found)
    assert all(one.wrong is not None and one.wrong < 200 for one in found)
    assert sum(one.wrong_k is not None for one in found) > 8


def test_manual_follows_while_somebody_else_has_the_output() -> None:
    """Put into manual while it tracked, the controller went back with a bump once OP was its own again."""
    loop = alone(Pid(k=1.0, ti=2.0))
    for n in range(20):
        loop["op.flags"], loop["op.tracking"] = Flag.NOT_AUTO, 0.1 * n
        if n == 10:
            loop["pid.mode"] = Mode.MANUAL
        loop.scan()
    loop["op.flags"] = 0
    loop.scan()
    loop.scan()
    assert loop["pid"] == 0.1 * 19


# --- The thesis -------------------------------------------------------------------------------------------------------


def saturating_load(t: Column) -> Column:
    """Ask 2.5 % more than the valve can give, and relieve it for 6 s after 16 to 46 s."""

    def ramp(begin: float, by: float) -> Column:
        return by * np.clip((t - begin) / 2, 0.0, 1.0)

    load, begin, pauses = ramp(20.0, -2.5), 50.0, itertools.cycle((16, 30, 20, 46, 24, 36))
    while begin < t[-1]:
        load += ramp(begin, 5.0) + ramp(begin + 6, -5.0)
        begin += 6 + next(pauses)
    return load


def saturated(flags: bool, span: bool, pid_limits: tuple[float, float], valve: tuple[float, float]) -> Column:
    """Widths that the detector accepts on P3 at its upper limit; the gap is 5 %."""
    h = 0.01
    load = saturating_load(np.arange(60_000) * h)
    k, ti = 0.48, 0.3117
    limits = {"op_low": 0.0, "op_high": 100.0} if span else {}
    modules = {
        "sp": Input(97.5),
        "load": Input(),
        "pid": Pid(k=k, ti=ti, b=0, tf=ti / 10, low=pid_limits[0], high=pid_limits[1], start=97.5),
        "valve": Saturation(*valve),
        "gap": Backlash(5.0),
        "plant": Plant("P3", start=97.5),
        "noise": Noise(0.2),
        "watch": BacklashDetection(k=k, ti=ti, b=0, kp=1.0, **limits),
    }
    wires = [
        "sp -> pid.sp",
        "sp -> watch.sp",
        "pid -> valve -> gap -> plant -> noise -> pid.pv",
        "noise -> watch.pv",
        "load -> plant.load",
        *(["watch -> pid.ff"] if flags else []),
    ]
    seen = Graph(h, modules, wires).run(load.size * h, record=["watch.d", "watch.detections", "pid"], load=load)
    assert np.mean(seen["pid"] >= 100.0) > 0.5
    accepted: Column = seen["watch.d"][1:][np.diff(seen["watch.detections"]) > 0]
    return accepted


@pytest.mark.parametrize("at_its_limit", ["controller", "valve"])
def test_figure_7_2_saturation_is_rejected_through_the_flags(at_its_limit: str) -> None:
    """Whether the controller is at its limit, or, further on, only the valve at its end."""
    wide, narrow = (-1e6, 1e6), (0.0, 100.0)
    pid_limits, valve = (narrow, wide) if at_its_limit == "controller" else (wide, narrow)
    blind = saturated(False, False, pid_limits, valve)
    spanned = saturated(False, True, pid_limits, valve)
    assert blind.size > spanned.size > 0 and spanned.min() > 10 * 5.0
    assert saturated(True, False, pid_limits, valve).size == 0


def system_of_6_5(seed: int, tf: float, inside: bool, **compensation: float) -> Graph:
    """Noise, ProcessSim, Pid, Filter2P, BacklashDetection and a gap of 2.0 %."""
    settings = {"k": 2.0, "ti": 2.0}
    pid = {"low": 0.0, "high": 100.0, "start": 50.0}
    modules: dict[str, Any] = {
        "sp": Input(50.0),
        "load": Input(),
        "pid": PidAdvanced(**settings, **pid, tf=tf, kp=1.0, **compensation) if inside else Pid(**settings, **pid),
        "gap": Backlash(2.0),
        "process": ProcessSim(1.0, 3.0, 1.0, start=50.0),
        "noise": Noise(0.1, seed=seed),
    }
    wires = ["sp -> pid.sp", "load -> process.load"]
    if inside:
        return Graph(0.1, modules, [*wires, "pid -> gap -> process -> noise -> pid.pv"])
    modules |= {"filter": Filter2P(tf), "watch": BacklashDetection(**settings, kp=1.0, tf=0.0, **compensation)}
    return Graph(
        0.1,
        modules,
        [
            *wires,
            "sp -> watch.sp",
            "pid -> gap -> process -> noise -> filter -> pid.pv",
            "filter -> watch.pv",
            "watch -> pid.ff",
        ],
    )


def test_system_of_6_5_shows_its_gap() -> None:
    load = 5.0 * (np.arange(30_000) // 2000 % 2)
    for tf, low, high in ((0.2, 1.92, 1.99), (0.1, 1.84, 1.89)):
        shown = []
        for seed in range(5):
            loop = system_of_6_5(seed, tf, inside=False)
            loop.run(3000, load=load)
            shown.append(loop["watch.d_hat"])
        assert low < np.median(shown) < high, shown  # the thesis: 1.8


def test_the_detector_inside_sees_what_the_detector_beside_sees() -> None:
    load = 5.0 * (np.arange(10_000) // 2000 % 2)
    beside, inside = system_of_6_5(1, 0.2, inside=False), system_of_6_5(1, 0.2, inside=True)
    beside.run(1000, load=load)
    inside.run(1000, load=load)
    assert inside["pid.detections"] > 10
    assert (inside["pid.detections"], inside["pid.out"]) == (beside["watch.detections"], beside["pid.out"])
    assert inside["pid.d_hat"] == beside["watch.d_hat"]
    inside.reset_detection("pid")
    assert inside["pid.detections"] == 0.0 and math.isnan(inside["pid.d_hat"])


LOAD = 5.0 * (np.arange(25_000) // 2000 % 2)


@pytest.mark.parametrize("inside", [True, False])
def test_after_compensation_the_detector_shows_what_is_left(inside: bool) -> None:
    loop = system_of_6_5(1, 0.2, inside, comp_size=1.0, comp_band=0.1, comp_withdraw=False)
    name = "pid" if inside else "watch"
    before = loop.run(500, load=LOAD[:5000], record=["process"])["process"]
    assert loop[f"{name}.standing"] == 1.0 and loop[f"{name}.u_ff"] == 0.0  # nobody has switched it on
    loop[f"{name}.compensate"] = 1
    after = loop.run(2000, load=LOAD[5000:], record=["process", f"{name}.u_ff"])
    assert loop[f"{name}.standing"] == 0.0
    # Half of the size less the band, to either side, and no more.
    assert np.max(np.abs(after[f"{name}.u_ff"])) == pytest.approx(0.45)
    assert np.std(after["process"]) < 0.9 * np.std(before)
    assert 0.95 < loop[f"{name}.d_hat"] < 1.2  # 2.0, of which 0.9 is compensated
    assert 1.85 < loop[f"{name}.whole"] < 2.1


def test_a_bad_setpoint_and_a_scan_without_time_leave_u_ff_in_force_as_the_table_of_safety_says() -> None:
    """The page had it that a bad SP takes u_FF away in every module."""
    pid = PidAdvanced(k=2.0, ti=2.0, tf=0.2, low=0, high=100, start=50.0, comp_size=1.0, comp_way=Way.ERROR)
    valve = {"valve": Output()}
    inside = Graph(
        0.1, {"sp": Input(), "pv": Input(), "pid": pid, **valve}, ["sp -> pid.sp", "pv -> pid.pv", "pid -> valve"]
    )
    given = BacklashDetection(k=2.0, ti=2.0, op_low=0, op_high=100, comp_size=1.0, comp_way=Way.ERROR)
    signals = {name: Input() for name in ("sp", "pv", "flags", "op")}
    wires = [*(f"{name} -> pid.{name}" for name in signals), "pid -> valve"]
    next_to_it = Graph(0.1, {**signals, "pid": given, **valve}, wires)
    good = {"sp": 50.0, "pv": 49.0}
    for loop, more in ((inside, {}), (next_to_it, {"op": 50.0})):
        loop["pid.compensate"] = 1
        for pv in [49.0] * 20 + [51.0] * 20 + [49.0] * 20:
            loop.scan(sp=50.0, pv=pv, **more)
        assert (loop["pid.standing"], loop["pid.u_ff"]) == (0.0, 0.5)
        loop.scan(h=0.0, **good, **more)
        assert (loop["pid.standing"], loop["pid.u_ff"]) == ((2.0, 0.0) if loop is inside else (0.0, 0.5))
        for pv in [51.0] * 20 + [49.0] * 20:
            loop.scan(sp=50.0, pv=pv, **more)
        loop.scan(sp=math.nan, pv=49.0, **more)
        assert loop["pid.standing"] == (0.0 if loop is inside else 3.0)
        assert loop["pid.error"] == (Flag.BAD_SP if loop is inside else 0.0)


@pytest.mark.parametrize(("mode", "some"), [(Mode.EXTERNAL, True), (Mode.AUTO, False)])
def test_a_detection_next_to_a_pid_counts_where_the_pid_follows_its_setpoint(mode: Mode, some: bool) -> None:
    """By an SP of its own, which the detection does not see, every half-period is not in automatic."""
    loop = system_of_6_5(1, 0.2, inside=False)
    loop["pid.mode"] = mode
    loop.run(500, load=LOAD[:5000])
    assert (loop["watch.detections"] > 0) == some
    assert loop["watch.standing"] == 1.0


@pytest.mark.parametrize(("size", "in_force"), [(4.0, (1.6, 2.1)), (1.0, (1.0, 1.0))])
def test_the_online_estimate_lowers_a_size_that_is_too_large_and_never_raises_one(
    size: float, in_force: tuple[float, float]
) -> None:
    """A gap of 2.0 % with a typed width of twice as much, or half: the size in force comes down to the gap."""
    loop = system_of_6_5(1, 0.2, True, comp_size=size, comp_band=0.0, comp_withdraw=False)
    loop.run(1000, load=LOAD[:10_000])
    assert loop["pid.detections"] > 10 and 1.8 < loop["pid.d_hat"] < 2.1
    loop["pid.compensate"] = 1
    after = loop.run(1000, load=LOAD[10_000:20_000], record=["process", "pid.u_ff"])
    widest = 2 * np.max(np.abs(after["pid.u_ff"][-5000:]))
    assert in_force[0] - 1e-9 <= widest <= in_force[1] + 1e-9


def test_a_compensation_that_loses_its_estimate_is_taken_away_without_a_bump() -> None:
    loop = system_of_6_5(1, 0.2, True, comp_size=1.0, comp_rate=1.0)
    loop["pid.compensate"] = 1
    loop.run(1000, load=LOAD[:10_000])
    assert loop["pid.whole"] > 1.0 and loop["pid.u_ff"] != 0.0
    with pytest.raises(InputError, match=r"comp_size = 0: must be greater than 0 while it compensates"):
        loop["pid.comp_size"] = 0.0
    loop.reset_detection("pid")
    gone = loop.run(3, record=["pid", "pid.u_ff", "pid.standing"])
    assert gone["pid.standing"][0] == 7.0 and gone["pid.u_ff"][-1] == 0.0  # estimate lost
    assert np.max(np.abs(np.diff(gone["pid.u_ff"]))) <= 0.1 + 1e-12
    assert np.max(np.abs(np.diff(gone["pid"]))) < 0.5
    loop.run(500, load=LOAD[:5000])
    assert loop["pid.standing"] == 0.0  # detections are back


@pytest.mark.parametrize("inside", [True, False])
def test_the_online_estimate_is_a_source_only_when_it_may_be(inside: bool) -> None:
    """A gap of 2.0 %: pressed too early there is no estimate, pressed late it is the estimate of that moment."""
    loop = system_of_6_5(1, 0.2, inside, comp_source=Source.ESTIMATE, comp_share=0.8, comp_withdraw=False)
    name = "pid" if inside else "watch"
    shown = [f"{name}.{variable}" for variable in ("unfit", "size", "delta", "u_ff", "standing")]
    loop[f"{name}.compensate"] = 1
    early = loop.run(1000, load=LOAD[:10_000], record=shown)
    assert list(dict.fromkeys(early[f"{name}.unfit"])) == [Unfit.NO_DETECTION, Unfit.PROVISIONAL, 0]
    assert set(early[f"{name}.standing"]) == {14.0} and not early[f"{name}.u_ff"].any()
    loop[f"{name}.compensate"] = 0
    loop.run(1)
    whole = loop[f"{name}.whole"]
    loop[f"{name}.compensate"] = 1
    late = loop.run(1000, load=LOAD[10_000:20_000], record=shown)
    size, delta = late[f"{name}.size"], late[f"{name}.delta"]
    assert loop[f"{name}.source"] == Source.ESTIMATE and loop[f"{name}.standing"] == 0.0
    assert 1.8 < whole < 2.1 and size[0] == whole and np.all(np.diff(size) <= 0)
    # A share of 0.8, less a band of a fifth of the size as it was.
    assert delta == pytest.approx(0.8 * size - 0.2 * whole)
    assert loop[f"{name}.left"] == pytest.approx(size[-1] - delta[-1])
    assert np.max(np.abs(late[f"{name}.u_ff"])) == pytest.approx(delta[0] / 2)


def test_an_estimate_below_the_noise_limit_or_a_fit_contradicts_is_no_source() -> None:
    for more, kp, unfit in (({}, 0.02, Unfit.NOISE), ({"comp_fitted": 0.0}, 1.0, Unfit.CONTRADICTED)):
        loop = system_of_6_5(1, 0.2, True, comp_source=Source.ESTIMATE, **more)
        loop["pid.kp"] = kp
        loop.run(1000, load=LOAD[:10_000])
        assert loop["pid.detections"] > 10 and loop["pid.unfit"] == unfit
        loop["pid.compensate"] = 1
        loop.run(1)
        assert loop["pid.standing"] == 14.0


# --- Beside a controller that is not ours ----------------------------------------------------------------------------

READ = ("sp", "pv", "flags", "op", "u_ff")


def their_system() -> Graph:
    """The loop of 6.5 in another maker's system, which takes a feed-forward."""
    modules = {
        "sp": Input(50.0),
        "ff": Input(),
        "load": Input(5.0),
        "pid": Pid(k=2.0, ti=2.0, tf=0.2, low=0, high=100, start=50.0),
        "gap": Backlash(2.0),
        "process": ProcessSim(gain=1.0, t1=3.0, t2=1.0, start=50.0),
        "noise": Noise(0.1),
    }
    wires = ["sp -> pid.sp", "ff -> pid.ff", "pid -> gap -> process -> noise -> pid.pv", "load -> process.load"]
    return Graph(0.1, modules, wires)


def beside_it(**more: Any) -> Graph:
    """The detector as a program of its own."""
    given: dict[str, Any] = {"comp_fitted": 1.8, "op_low": 0, "op_high": 100, "tf": 0.2, "comp_withdraw": False} | more
    modules = {**{name: Input() for name in READ}, "watch": BacklashDetection(2.0, 2.0, **given), "ff": Output()}
    return Graph(0.1, modules, [*(f"{name} -> watch.{name}" for name in READ), "watch -> ff"])


def together(theirs: Graph, watch: Graph, scans: int, late: int, flags: float = 0.0) -> tuple[Column, Column]:
    """PV and the u_FF handed over, which their system has `late` scans after it was made."""
    under_way = [theirs["ff"]] * (late - 1)
    pv, handed = np.empty(scans), np.empty(scans)
    for i in range(scans):
        load = 5.0 * (i // 2000 % 2)
        theirs.scan(load=load)
        now = {"pv": theirs["noise"], "op": theirs["pid"], "u_ff": theirs["ff"], "flags": flags}
        watch.scan(sp=50.0, **now)
        pv[i], handed[i] = theirs["process"], watch["ff"]
        under_way.append(watch["ff"])
        theirs["ff.value"] = under_way.pop(0)
    return pv, handed


@pytest.mark.slow
def test_beside_a_controller_that_is_not_ours() -> None:
    theirs, watch = their_system(), beside_it(ff_delay=3)
    without, _ = together(theirs, watch, 8000, late=3)
    assert watch["watch.detections"] > 10 and watch["watch.d_hat"] == pytest.approx(2.0, abs=0.2)
    watch["watch.compensate"] = 1
    with_it, handed = together(theirs, watch, 8000, late=3)
    assert watch["watch.standing"] == 0.0 and watch["watch.source"] == Source.FITTED
    assert np.std(with_it) < 0.8 * np.std(without)
    assert np.max(np.abs(handed)) == pytest.approx((1.8 - 1.8 / 5) / 2)
    # This program ends, and is started anew: their system still holds what it was handed last.
    held = theirs["ff"]
    assert abs(held) > 0.5
    _, after = together(theirs, beside_it(ff_delay=3), 30, late=3)
    assert np.max(np.abs(np.diff([held, *after]))) <= abs(held) * 0.1 / 2.0 + 1e-9 and after[-1] == 0.0


def cascade(outer: Pid, inner: Pid) -> Graph:
    """P2 as two halves, a gap of 5 % in the inner loop."""
    half = ([1.0], [1.0, 2.0, 1.0])
    modules = {
        "sp": Input(),
        "load": Input(),
        "outer": outer,
        "inner": inner,
        "gap": Backlash(5.0),
        "first": Plant(half),
        "second": Plant(half),
        "noise": Noise(0.5, seed=3),
        "outer_noise": Noise(0.5, seed=4),
    }
    wires = [
        "sp -> outer.sp",
        "outer -> inner.sp",
        "inner -> gap -> first -> second -> outer_noise -> outer.pv",
        "first -> noise -> inner.pv",
        "load -> first.load",
    ]
    return Graph(0.01, modules, wires)


def test_figure_8_5_the_detector_works_in_the_inner_loop() -> None:
    loop = cascade(
        Pid(k=0.1, ti=4.0, b=0, tf=1.0, max_h=1.0), PidAdvanced(k=3.0, ti=1.6, b=0, tf=0.16, low=-300, high=300, kp=1.0)
    )
    t = np.arange(100_000) * 0.01
    loop.run(1000, sp=np.where(t < 1, 0.0, 100.0), load=np.where(t < 100, 0.0, 30.0))
    assert loop["inner.detections"] >= 5
    assert 3.5 < loop["inner.d_hat"] < 5.5


# --- The face --------------------------------------------------------------------------------------------------------


def test_names_values_and_columns_that_are_wrong_are_refused() -> None:
    loop = alone(Pid(k=1.0, ti=2.0))
    for path, value, match in (
        ("pid.ti", 0.0, r"pid: ti = 0: must be greater than 0 s"),
        ("pid.mode", 3.0, r"mode = 3: must be 0 \(manual\), 1 \(auto\) or 2 \(external\)"),
        ("op.flags", 16.0, r"flags = 16: must be a sum of"),
        ("pid.gain", 1.0, r"pid: there is no 'gain' here"),
        ("tank.k", 1.0, r"no 'tank' here: pv, sp, ff, pid, op"),
    ):
        with pytest.raises(InputError, match=match):
            loop[path] = value
    with pytest.raises(InputError, match=r"pid\.Ki|'Ki'"):
        loop["pid.Ki"]
    with pytest.raises(InputError, match=r"sp: 3 values for 2 scans"):
        loop.run(2 * H, sp=np.zeros(3))
    with pytest.raises(InputError, match=r"t: is -1, must be 0 to 5e\+06 s, which is 10⁸ scans"):
        loop.run(-1.0)
    with pytest.raises(InputError, match=r"ki = 0: must be other than 0"):
        Pid.parallel(kp=1.0, ki=0.0)
    with pytest.raises(InputError, match=r"pid: at of row 2 = 1: must be a number greater than in the row before"):
        alone(PidAdvanced(k=1.0, ti=2.0, schedule=[(1, 1, 1, 0), (1, 2, 1, 0)]))
    with pytest.raises(InputError, match=r"pid: there is no 'schedule' here: out, out_flags, k, "):
        loop.set_schedule("pid", [])


def test_a_worn_valve_and_a_noisy_transmitter() -> None:
    """Every kind that a scenario is built of, and the same loop as the scenario's."""
    modules = {
        "sp": Input(1.0),
        "n": Input(),
        "pid": Pid(k=0.775, ti=2.05, b=0.0, tf=0.205, start=1.0, start_pv=1.0),
        "op": Resolution(0.01),
        "speed": RateLimit(0.5, reports=False, start=1.0),
        "gap": Backlash(0.05, start=1.0),
        "stem": Friction(0.03, 0.01, FrictionModel.HE, start=1.0),
        "plant": Plant("P2", start=1.0),
        "pv": Sum(),
        "steps": Resolution(0.005),
    }
    wires = [
        "sp -> pid.sp",
        "n -> pv.plus",
        "pid -> op -> speed -> gap -> stem -> plant -> pv.in",
        "pv -> steps -> pid.pv",
    ]
    noise = np.random.default_rng(3).normal(0.0, 0.01, 2001)
    seen = Graph(H, modules, wires).run(2001 * H, record=["steps", "op", "stem"], n=noise)
    worn = Scenario(
        plant="P2",
        controller=(0.775, 2.05, 0, 0),
        d=0.05,
        friction=Stem(model="he", s=0.03, j=0.01),
        rate=0.5,
        noise=noise,
        pv_resolution=0.005,
        op_resolution=0.01,
        setpoint=[(0, 1.0)],
        t_end=100.0,
        filter_in_loop=True,
    )
    expected = run(worn)
    for name, column in (("steps", expected.pv), ("op", expected.op), ("stem", expected.position)):
        assert np.array_equal(seen[name], column), name


def test_values_that_are_no_longer_known_are_none() -> None:
    loop = scheduled()
    loop["pid.kp"] = 2.0
    loop["pid.kp"] = None
    assert loop["pid.kp"] is None
    with pytest.raises(InputError, match=r"pid: kp = NaN: must be"):
        loop["pid.kp"] = math.nan
    with pytest.raises(InputError, match=r"PidAdvanced: k must be given"):
        loop["pid.k"] = None


ROWS = [(20.0, 1.0, 6.0, 0.0), (40.0, 2.0, 5.0, 0.2), (80.0, 3.0, 4.0, 0.1)]


def scheduled(k: float = 1.0) -> Graph:
    modules = {name: Input() for name in ("pv", "sp", "by")}
    pid = PidAdvanced(k=k, ti=5.0, low=0, high=100, start=50.0, schedule=[(at, k * g, *r) for at, g, *r in ROWS])
    wires = ["pv -> pid.pv", "sp -> pid.sp", "by -> pid.by", "pid -> op"]
    return Graph(H, {**modules, "pid": pid, "op": Output()}, wires)


@pytest.mark.parametrize("k", [1.0, -1.0])
@pytest.mark.parametrize("mode", list(Mode))
def test_a_schedule_is_edited_while_it_runs_without_a_bump(mode: Mode, k: float) -> None:
    """PV rests off the setpoint: only integration may move the output, whatever becomes of the gains."""
    loop = scheduled(k)
    loop["pid.mode"], loop["pid.sp"] = mode, 51.0
    for _ in range(10):
        loop.scan(pv=50.0, sp=51.0, by=30.0)
    for rows in (ROWS[1:], [(at, 5 * g, ti / 4, 2 * td) for at, g, ti, td in ROWS], [], ROWS):
        given = [(at, k * g, ti, td) for at, g, ti, td in rows]
        before = loop["pid"]
        loop.set_schedule("pid", given)
        assert loop.schedule("pid") == given
        loop.scan()
        most = max((g / ti for _, g, ti, _ in rows), default=1 / 5) * H * 1.0
        assert abs(loop["pid"] - before) <= most + 1e-9
        assert (loop["pid"] == before) == (mode == Mode.MANUAL)
    # The schedule is in force: a step of PV is answered with the gain between the rows, here 1.5.
    before = loop["pid"]
    loop.scan(pv=49.0)
    answer = 0.0 if mode == Mode.MANUAL else k * 1.5 * (1 + 0.1 / H + 2 * H / 5.5)
    assert loop["pid"] - before == pytest.approx(answer)


NUMBER = r"must be a number greater than in the row before"
BAD_ROWS: dict[str, tuple[list[tuple[float, float, float, float]], str]] = {
    "not in order": ([ROWS[1], ROWS[0]], rf"pid: at of row 2 = 20: {NUMBER}"),
    "a gain of the other sign": ([*ROWS[:2], (90.0, -1.0, 5.0, 0.0)], r"pid: k of row 3 = -1: must be of the sign"),
    "too many": ([(float(at), 1.0, 5.0, 0.0) for at in range(9)], r"pid: rows = 9: must be at most 8"),
}


@pytest.mark.parametrize("name", BAD_ROWS)
def test_a_bad_edit_of_a_schedule_is_refused_and_leaves_the_running_one(name: str) -> None:
    rows, match = BAD_ROWS[name]
    edited, untouched = scheduled(), scheduled()
    for loop in (edited, untouched):
        loop.run(20 * H, pv=np.linspace(50, 48, 20), sp=np.full(20, 51.0), by=np.linspace(10, 90, 20))
    with pytest.raises(InputError, match=match):
        edited.set_schedule("pid", rows)
    assert edited.schedule("pid") == untouched.schedule("pid") == ROWS
    for loop in (edited, untouched):
        loop.run(20 * H, pv=np.linspace(48, 55, 20), by=np.linspace(90, 10, 20))
    assert [edited[name] for name in ("pid", "pid.flags")] == [untouched[name] for name in ("pid", "pid.flags")]


def test_the_sign_of_k_and_that_of_the_schedule_hold_together() -> None:
    loop = scheduled()
    with pytest.raises(InputError, match=r"pid: k of row 1 = 1: must be of the sign of the controller's own k"):
        loop["pid.k"] = -1.0
    assert loop["pid.k"] == 1.0


def test_every_name_can_be_read() -> None:
    loop = system_of_6_5(0, 0.2, inside=True)
    loop.run(1.0)
    names = list(loop)
    assert {"pid.k", "pid.mode", "pid.d_hat", "gap.d", "sp.flags", "process.out"} <= set(names)
    unknown = {name for name in names if loop[name] is None}
    assert all(isinstance(loop[name], float) for name in set(names) - unknown)
    assert {"pid.pv_span", "pid.start_pv", "gap.start"} <= unknown and not unknown & {
        "pid.kp",
        "pid.max_h",
        "process.h",
    }


def test_sample_by_sample_beside_a_plant_whose_sensor_fails() -> None:
    """A plant outside the graph; its sensor fails for 2 s in the middle of half-periods, and once the scan is late."""
    loop = Graph(
        0.1,
        {
            "pv": Input(),
            "sp": Input(50.0),
            "pid": PidAdvanced(k=2.0, ti=2.0, tf=0.2, kp=1.0, start=50.0),
            "valve": Output(),
        },
        ["pv -> pid.pv", "sp -> pid.sp", "pid -> valve"],
    )
    lags, position = [50.0, 50.0], 50.0
    random = np.random.default_rng(5)
    reasons = set()
    for n in range(12_000):
        fails, late = n % 1500 in range(700, 720), n == 5000
        before = loop["valve"]
        loop.scan(pv=math.nan if fails else lags[1] + random.uniform(-0.1, 0.1), h=30.0 if late else 0.1)
        u = loop["valve"]
        if fails or late:
            assert u == before
            assert Flag(int(loop["pid.error"])) == (Flag.BAD if fails else Flag.DATA_GAP)
        elif n > 0:
            assert loop["pid.error"] == 0.0
            assert abs(u - before) < 2.0
        position = min(max(position, u - 1.0), u + 1.0)
        load = 5.0 * (n // 2000 % 2)
        lags[0] += (position + load - lags[0]) * 0.1 / 3.1
        lags[1] += (lags[0] - lags[1]) * 0.1 / 1.1
        reasons.add(loop["pid.reason"])
    assert {0.0, 1.0, 2.0} <= reasons  # accepted, gap, bad_quality
    assert 1.85 < loop["pid.d_hat"] < 2.05


@pytest.mark.parametrize("inside", [True, False], ids=["PidAdvanced", "BacklashDetection"])
@pytest.mark.slow
def test_no_width_is_shown_below_the_noise_limit(inside: bool) -> None:
    """Regression: nine detections of a tenth of a per cent were shown without a gap; the noise is that of PV before the
    filter.
    """
    shown = {}
    for d in (0.0, 0.05):
        named: dict[str, Any] = {
            "sp": Input(1.0),
            "load": Input(0.3),
            "gap": Backlash(d),
            "process": Plant("P3"),
            "noise": Noise(0.002),
        }
        wires = ["sp -> pid.sp", "load -> process.load", "pid -> gap -> process -> noise -> pid.pv"]
        pi = {"k": 0.48, "ti": 0.3117, "b": 0.0}
        if inside:
            named["pid"] = PidAdvanced(**pi, tf=0.155, kp=1.0)
        else:
            named["pid"] = Pid(**pi)
            named["watch"] = BacklashDetection(**pi, tf=0.155, kp=1.0)
            wires += ["sp -> watch.sp", "noise -> watch.pv", "watch -> pid.ff"]
        loop, module = Graph(H, named, wires), "pid" if inside else "watch"
        loop["pid.mode"] = Mode.EXTERNAL
        loop.run(20_000)
        shown[d] = {name: loop[f"{module}.{name}"] for name in ("d_hat", "count", "whole", "noise_floor", "detections")}
    assert shown[0.0]["detections"] >= 9, "or there is nothing to withhold"
    assert math.isnan(shown[0.0]["d_hat"]) and shown[0.0]["count"] == 0 and math.isnan(shown[0.0]["whole"])
    assert shown[0.05]["d_hat"] == pytest.approx(0.05, rel=0.15) and shown[0.05]["count"] == 9
    for floor in (shown[0.0]["noise_floor"], shown[0.05]["noise_floor"]):
        # A gap makes this PV move within a few samples, which counts as noise.
        assert floor == pytest.approx(3 * 0.002 / math.sqrt(3), rel=0.25)


# --- The autotuner inside --------------------------------------------------------------------------------------------

TUNED: dict[str, Any] = {
    "low": 0.0,
    "high": 100.0,
    "start": 62.5,
    "start_pv": 50.0,
    "tune_amplitude": 5.0,
    "tune_wait": 10.0,
    "tune_longest": 400.0,
    "tune_pv_low": 40.0,
    "tune_pv_high": 60.0,
}


def tank(d: float = 0.0, **pid: Any) -> Graph:
    """A process of gain 0.8 with lags and a dead time, in noise."""
    modules = {
        "sp": Input(50.0),
        "load": Input(),
        "by": Input(),
        "pid": PidAdvanced(**{"k": 0.5, "ti": 8.0} | TUNED | pid),
        "gap": Backlash(d, start=62.5),
        "process": ProcessSim(gain=0.8, t1=3.0, t2=1.0, dead_time=1.0, start=50.0),
        "noise": Noise(0.02),
    }
    wires = ["sp -> pid.sp", "by -> pid.by", "load -> process.load", "pid -> gap -> process -> noise -> pid.pv"]
    return Graph(0.1, modules, wires)


@pytest.mark.parametrize("rule", TuneRule)
def test_what_the_autotuner_inside_offers_is_taken_over(rule: TuneRule) -> None:
    loop = tank(tune_rule=rule)
    loop["pid.tune"] = 1
    loop.run(200.0)
    assert (loop["pid.tune"], loop["pid.tune_phase"], loop["pid.tune_stop"]) == (0, 4, 0)
    assert loop["pid.tune_kp"] == pytest.approx(0.8, rel=0.05)
    ku, tu, kappa = (loop[f"pid.tune_{name}"] for name in ("ku", "tu", "kappa"))
    assert kappa == pytest.approx(1 / (loop["pid.tune_kp"] * ku))
    expected = {
        TuneRule.POINT_PLACEMENT: (0.3535533905932738 * ku, 6.25 * 0.18148635890784376 * tu, 0.18148635890784376 * tu),
        TuneRule.AMIGO_PI: (0.16 * ku, tu / (1 + 4.5 * kappa), 0.0),
        TuneRule.AMIGO_PID: (
            (0.3 - 0.1 * kappa**4) * ku,
            0.6 * tu / (1 + 2 * kappa),
            0.15 * (1 - kappa) * tu / (1 - 0.95 * kappa),
        ),
    }[rule]
    offered = [loop[f"pid.tune_{name}"] for name in ("k", "ti", "td")]
    assert offered == pytest.approx(expected)
    before = loop["pid"]
    loop.take_over("pid")
    assert [loop[f"pid.{name}"] for name in ("k", "ti", "td")] == offered
    loop.scan()
    # Effect of the new gains on one sample more, in noise.
    assert abs(loop["pid"] - before) < offered[0] * 0.05 * (1 + offered[2] / 0.1)
    # Other parameters set later leave it in force.
    loop["pid.b"] = 0.5
    assert [loop[f"pid.{name}"] for name in ("k", "ti", "td")] == offered
    loop.run(100.0)
    assert loop["noise"] == pytest.approx(50.0, abs=0.3)


def test_the_half_period_in_which_it_is_taken_over_ends_as_a_gap() -> None:
    loop = tank(d=1.0, tune_d=1.0, tune_rule=TuneRule.AMIGO_PI)
    loop["pid.tune"] = 1
    loop.run(300.0)
    assert loop["pid.tune_phase"] == 4
    for load, take in ((2.0, False), (0.0, True)):
        loop.run(20.0, load=np.full(200, load), record=[])
        loop.run(2.0, load=np.full(20, 1.0 - load))
        if take:
            loop.take_over("pid")
        reasons = loop.run(0.2, load=np.full(2, 1.0 - load), record=["pid.reason"])["pid.reason"]
        assert (reasons[-1] == 1) == take  # gap


@pytest.mark.parametrize(
    ("given", "begin", "message"),
    [
        ({}, False, "pid: phase = 0: must be 4, done"),
        ({"tune_longest": 40.0}, True, "pid: phase = 5: must be 4, done"),
        ({"schedule": [(0.0, 0.5, 8.0, 0.0)]}, True, "pid: rows = 1: must be 0: under a gain schedule"),
    ],
)
def test_settings_that_are_not_offered_are_not_taken_over(given: dict[str, Any], begin: bool, message: str) -> None:
    loop = tank(**given)
    loop["pid.tune"] = int(begin)
    loop.run(200.0)
    before = {name: loop[name] for name in loop}
    with pytest.raises(InputError, match=message):
        loop.take_over("pid")
    assert {name: loop[name] for name in loop} == pytest.approx(before, nan_ok=True)
    assert math.isnan(loop["pid.tune_k"])
    # The detector has the Kp also under a schedule.
    assert math.isnan(loop["pid.tune_kp"]) == ("schedule" not in given)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"tune_wait": None}, "pid: tune_wait = NaN: must be greater than 0 s"),
        ({"tune_longest": 5.0}, "pid: tune_longest = 5: must be greater than wait"),
        ({"tune_rule": 4}, "pid: tune_rule = 4: must be 1 .point placement., 2"),
        ({"high": 1.7e308}, "pid: high = .*: must be a limit of the output: the autotuner needs both"),
    ],
)
def test_settings_of_the_autotuner_inside_are_named(given: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        tank(**given)


def test_an_experiment_cannot_lose_its_autotuner() -> None:
    loop = tank()
    loop["pid.tune"] = 1
    loop.run(30.0)
    with pytest.raises(InputError, match="tune_amplitude = 0: must be other than 0 while an experiment runs"):
        loop["pid.tune_amplitude"] = 0.0
    loop["pid.tune"] = 0
    loop.scan()
    assert (loop["pid.tune_phase"], loop["pid.tune_stop"], loop["pid"]) == (5, 3, pytest.approx(62.5, abs=0.1))
    loop["pid.tune_amplitude"] = 0.0
    with pytest.raises(InputError, match="tune = 1: must be 0: without tune_amplitude there is no autotuner"):
        loop["pid.tune"] = 1
    with pytest.raises(InputError, match="there is no 'autotuner' here"):
        loop.take_over("process")


def test_an_integral_time_that_the_scan_cannot_follow_is_not_taken_over() -> None:
    modules = {
        "sp": Input(50.0),
        "pid": PidAdvanced(**{"k": 0.2, "ti": 4.0, "tune_rule": TuneRule.AMIGO_PI} | TUNED | {"start": 50.0}),
        "process": ProcessSim(gain=1.0, t1=0.05, dead_time=1.0, start=50.0),
    }
    loop = Graph(0.25, modules, ["sp -> pid.sp", "pid -> process -> pid.pv"])
    loop["pid.tune"] = 1
    loop.run(200.0)
    assert loop["pid.tune_phase"] == 4 and loop["pid.tune_ti"] < 0.5
    with pytest.raises(InputError, match=r"pid: tune_ti = 0.*: must be more than two scan times"):
        loop.take_over("pid")
    assert loop["pid.ti"] == 4.0
