"""Scenarios: every element against another road to the same numbers, TOML, batches, recordings."""

from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import control
import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
from filtered import filtered, filtered_scenario
from numpy.typing import NDArray
from scipy import signal

import glapp
from glapp.blocks import Backlash, Pid, RateLimit, SecondOrderFilter
from glapp.controller import Controller
from glapp.errors import InputError
from glapp.plant import PLANTS, Plant
from glapp.simulate import (
    Coloured,
    Compensation,
    File,
    Friction,
    Gaussian,
    Manual,
    Outer,
    Ramp,
    Scenario,
    Simulation,
    Sine,
    Stem,
    Steps,
    Uniform,
    Valve,
    Walk,
    closed_loop,
    random_walk,
    read_scenario,
    run,
    run_many,
)
from glapp.tuning import amigo_step, assess

P2_PI = (0.775, 2.05)
P3_PI = (0.48, 0.3117)
HALF_P2 = ([1.0], [1.0, 2.0, 1.0], 0.0)

EVERYTHING: dict[str, Any] = {
    "name": 'all "at once", å',
    "plant": HALF_P2,
    "controller": Controller(pb=150, ti=0.5, ti_unit="repeats/s", td=0.01, td_unit="min"),
    "pv_span": (0, 50),
    "op_span": (0, 100),
    "tf": 0.2,
    "filter_in_loop": False,
    "limits": (-40, 60),
    "d": 0.3,
    "friction": Friction(model="kano", s=0.2, j=0.1),
    "rate": 20,
    "noise": [Uniform(amplitude=0.001), Gaussian(sigma=0.002), Coloured(sigma=0.003, tau=2.0)],
    "pv_resolution": 0.01,
    "op_resolution": 0.1,
    "setpoint": [Steps(steps=((1, 1.0), (50, 2.0))), Sine(amplitude=0.1, period=30.0, t=5)],
    "load": [Ramp(t=20, by=0.5, over=10), Walk(rate=0.01)],
    "manual": [(30, 35), (60, 65, 1.5)],
    "outer": Outer(
        plant=HALF_P2, controller=(0.2, 6.0, 0, 0), tf=0.6, limits=(-9, 9), d=0.01, noise=0.002, load=[(70, 0.1)]
    ),
    "jitter": 0.01,
    "lost": 0.1,
    "h": 0.05,
    "t_end": 100.0,
    "seed": 12345678901234567890,
}


def columns(s: Simulation) -> list[NDArray[Any]]:
    named = [s.t, s.sp, s.pv, s.op, s.position, s.load, s.flags]
    return named if s.outer_sp is None or s.outer_pv is None else [*named, s.outer_sp, s.outer_pv]


def same(a: Simulation, b: Simulation) -> bool:
    return all(np.array_equal(x, y) for x, y in zip(columns(a), columns(b), strict=True))


@pytest.mark.parametrize("name", ["P2", "P3", "P6"])
def test_open_loop_against_lsim(name: str) -> None:
    """The loop in manual is the plant alone, its input held between samples as lsim holds it."""
    h, n = 0.05, 1000
    s = run(
        filtered_scenario(
            plant=name,
            controller=(*P2_PI, 0, 0),
            load=[
                Sine(amplitude=0.5, period=7.0),
                Ramp(t=3, by=1.0, over=20),
                Walk(rate=0.1),
                Coloured(sigma=0.2, tau=1),
            ],
            manual=[(0, 999, 0.7)],
            h=h,
            t_end=(n - 1) * h,
            seed=3,
        )
    )
    _, y, _ = signal.lsim(signal.lti(PLANTS[name].num, PLANTS[name].den), s.op + s.load, s.t, interp=False)
    # The load begins at rest; the plant feels what its first sample adds to it from there on.
    assert np.abs(y - s.pv - (y[0] - s.pv[0])).max() < 1e-9


@pytest.mark.parametrize(
    ("name", "controller"),
    [
        ("P1", (0.363, 7.06)),
        ("P2", (0.5, 2.0)),
        ("P3", (0.48, 0.3117)),
        ("P4", (0.248, 2.71)),
        ("P5", (0.606, 2.09)),
        ("P6", (0.396, 2.02)),
        ("P7", (0.269, 3.84)),
        ("P8", (0.17, 0.404)),
    ],
)
def test_linear_closed_loop_against_python_control(name: str, controller: tuple[float, float]) -> None:
    """Plant, dead time, filter and PI as discrete state spaces, closed by python-control, over 30 s."""
    (k, ti), h, tf, n = controller, 0.05, 0.1, 600
    num, den, dead_time = PLANTS[name]
    a, late = h / (tf + h), round(dead_time / h)
    # Computed in state space: polynomials of the closed loop's order would have lost too many digits.
    plant = control.sample_system(control.ss(control.tf(num, den)), h, method="zoh")
    if late:
        shift = control.ss(np.eye(late, k=-1), np.eye(late, 1), np.eye(1, late, k=late - 1), 0, h)
        plant = plant * shift
    lag = control.ss(control.tf([a, 0], [1, a - 1], h))
    integral = control.ss(control.tf([k * h / ti, 0], [1, -1], h))
    disturbed = control.feedback(plant, (k + integral) * lag * lag)
    closed = disturbed * integral
    s = closed_loop(
        name, (k, ti, 0, 0), d=0, noise=0, h=h, t_end=(n - 1) * h, tf=tf, setpoint=[(1, 1.0)], load=[(10, -0.5)]
    )
    y = control.forced_response(closed, s.t, s.sp).outputs + control.forced_response(disturbed, s.t, s.load).outputs
    assert np.abs(y - s.pv).max() < 1e-9


def kano(u: NDArray[np.float64], s: float, j: float) -> list[float]:
    """The flowchart of Kano et al. 2004: us, the output at which the stem stopped; d, the direction of friction."""
    us, d, stopped = u[0] + (s - j) / 2, 1.0, True
    y = [u[0]]
    for old, new in pairwise(u):
        if not stopped and (new - old) * d <= 0:
            us, stopped = old, True
        if stopped:
            if -d * (new - us) > s:
                d, stopped = -d, False
            elif d * (new - us) > j:
                stopped = False
        y.append(y[-1] if stopped else new - d / 2 * (s - j))
    return y


def he(u: NDArray[np.float64], s: float, j: float) -> list[float]:
    """He et al. 2007: ur, the force that has not moved the stem yet; fs, fd, static and kinetic friction."""
    fs, fd = (s + j) / 2, (s - j) / 2
    ur, y = 0.0, [u[0]]
    for old, new in pairwise(u):
        force = ur + (new - old)
        moves = abs(force) > fs
        y.append(y[-1] + force - np.sign(force) * fd if moves else y[-1])
        ur = np.sign(force) * fd if moves else force
    return y


@pytest.mark.parametrize(("model", "published"), [("kano", kano), ("he", he)])
def test_friction_is_the_published_model(model: str, published: Any) -> None:
    s = run(
        filtered_scenario(
            plant="P1",
            controller=(0.363, 7.06, 0, 0),
            friction={"model": model, "s": 0.3, "j": 0.1},
            noise=0.001,
            load=[(5, 0.2), (300, -0.2)],
            t_end=600,
        )
    )
    from_rest = published(np.concatenate([[0.0], s.op]), 0.3, 0.1)
    assert np.abs(s.position - from_rest[1:]).max() < 1e-9


def test_friction_makes_a_flow_loop_cycle_where_backlash_does_not() -> None:
    """A slip jump keeps a self-regulating process cycling under PI; a gap of the same width comes to rest."""
    common: dict[str, Any] = {"plant": "P2", "controller": (*P2_PI, 0, 0), "setpoint": [(1, 1.0)], "t_end": 4000}
    sticks = run(filtered_scenario(**common, friction=Friction(model="kano", s=0.1, j=0.05)))
    plays = run(filtered_scenario(**common, d=0.1))
    late = sticks.t > 3000
    assert np.ptp(sticks.pv[late]) > 0.02
    assert np.ptp(plays.pv[late]) < 0.001


def test_rate_gap_and_resolution_against_the_blocks() -> None:
    s = run(
        filtered_scenario(
            plant="P2",
            controller=(*P2_PI, 0, 0),
            d=0.04,
            rate=0.1,
            op_resolution=0.05,
            pv_resolution=0.02,
            noise=0.01,
            setpoint=[(1, 1.0)],
            t_end=100,
        )
    )
    assert np.abs(s.op / 0.05 - np.round(s.op / 0.05)).max() < 1e-9
    assert np.abs(s.pv / 0.02 - np.round(s.pv / 0.02)).max() < 1e-9
    rate, gap = RateLimit(0.1), Backlash(0.04, s.op[0])
    assert [gap.update(rate.update(u, 0.05)) for u in s.op] == list(s.position)
    assert np.abs(np.diff(s.position)).max() <= 0.1 * 0.05 + 1e-12


def test_a_valve_is_its_own_positions_and_takes_gap_and_friction_with_it() -> None:
    valve = Valve(lag=0.3, positioner=2.0, d=0.1, stem=Stem(model="karnopp", fs=0.3, fc=0.2, w=20.0))
    s = Scenario(plant="P2", controller=P2_PI, valve=valve, load=[(1, 0.5)], t_end=100)
    simulation = run(s)
    # The plug is recorded where it stands at the sample, before the output of that sample has moved it.
    np.testing.assert_array_equal(simulation.position[1:], valve.positions(simulation.op, s.h)[:-1])
    assert np.abs(simulation.op - simulation.position).max() > 0.1
    assert Scenario.from_toml(s.to_toml()) == s
    straight = run(s.model_copy(update={"valve": Valve()}))
    np.testing.assert_array_equal(straight.pv, run(s.model_copy(update={"valve": None})).pv)
    with pytest.raises(InputError, match="valve: cannot be simulated together with compensation"):
        run(s.model_copy(update={"compensation": Compensation(way="error", size=0.1)}))
    with pytest.raises(InputError, match=r"valve\.lag = 0: must be"):
        Valve(positioner=1.0).positions([50.0], 1.0)


def test_filter_out_of_the_loop_is_a_controller_without_one() -> None:
    common: dict[str, Any] = {
        "plant": "P2",
        "controller": (*P2_PI, 0, 0),
        "noise": 0.01,
        "setpoint": [(1, 1.0)],
        "t_end": 50,
    }
    assert same(run(Scenario(**common, tf=0.4, filter_in_loop=False)), run(Scenario(**common, tf=0)))


def test_cascade_against_the_blocks_and_lsim() -> None:
    """Thesis 8.3: P2 as two processes; each outer signal is recomputed from the one before it."""
    controller, h = (0.6, 3.5), 0.05
    s = run(
        filtered_scenario(
            plant=HALF_P2,
            controller=(2.0, 1.5, 0.0, 1.0),
            d=0.05,
            outer=Outer(plant=HALF_P2, controller=(*controller, 0, 0), tf=0.1, load=[(60, 0.2)]),
            setpoint=[(1, 1.0)],
            load=[(100, -0.5)],
            h=h,
            t_end=200,
        )
    )
    assert s.outer_sp is not None and s.outer_pv is not None
    pid, filter_ = Pid(*controller), SecondOrderFilter(0.1)
    pid.track(0.0, 0.0, 0.0, h)
    again = [pid.update(sp, filter_.update(pv, h), h) for sp, pv in zip(s.outer_sp, s.outer_pv, strict=True)]
    assert again == list(s.sp)
    outer_load = np.where(s.t >= 60, 0.2, 0.0)
    _, y, _ = signal.lsim(signal.lti(*HALF_P2[:2]), s.pv + outer_load, s.t, interp=False)
    assert np.abs(y - s.outer_pv).max() < 1e-9
    assert np.abs(s.outer_pv[(s.t > 55) & (s.t < 60)] - 1).max() < 0.05


def test_gap_in_the_inner_process_is_found_and_one_in_the_outer_is_not() -> None:
    """Thesis 8.3.1 and 8.3.2: the inner loop's signals tell of a gap that its own output drives."""
    inner: dict[str, Any] = {
        "plant": ([9.0], [1.0, 3.0, 11.0, 9.0], 0.0),
        "controller": (*P3_PI, 0, 0),
        "noise": 0.001,
        "setpoint": [(1, 1.0)],
        "load": [(100, 0.3)],
        "t_end": 3000,
    }
    slow: dict[str, Any] = {"plant": ([1.0], [400.0, 40.0, 1.0], 0.0), "controller": (0.5, 60.0, 0, 0), "tf": 6.0}
    table = run_many(
        [
            filtered_scenario(**inner, d=0.05, outer=Outer(**slow)),
            filtered_scenario(**inner, outer=Outer(**slow, d=0.05)),
        ],
        keep="estimate",
        progress=False,
    )
    found, none = table["d_hat"].to_pylist()
    assert found == pytest.approx(0.05, rel=0.25)
    assert none is None or none < 0.01


def test_everything_at_once_is_deterministic_and_differs_by_seed() -> None:
    s = run(Scenario(**EVERYTHING))
    assert same(s, run(Scenario(**EVERYTHING)))
    other = run(Scenario(**EVERYTHING | {"seed": 1}))
    assert not np.array_equal(s.pv[:100], other.pv[:100])


def test_toml_there_and_back() -> None:
    scenario = Scenario(**EVERYTHING)
    text = scenario.to_toml()
    assert Scenario.from_toml(text) == scenario
    assert Scenario.from_toml(text).to_toml() == text
    assert same(run(Scenario.from_toml(text)), run(scenario))
    array = filtered_scenario(plant="P2", controller=(*P2_PI, 0, 0), load=np.zeros(20001))
    with pytest.raises(InputError, match="an array has no form in TOML; write it to a file"):
        array.to_toml()


def test_the_scenario_of_the_docs_runs() -> None:
    page = (Path(__file__).parents[1] / "docs" / "simulator.md").read_text(encoding="utf-8")
    text = page.split("```toml\n")[1].split("```")[0]
    s = run(Scenario.from_toml(text))
    assert len(s.t) > 1000 and s.outer_sp is None


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_signal_from_a_file_beside_the_scenario(tmp_path: Path, suffix: str) -> None:
    walk = random_walk(201, h=0.05, rate=0.1, seed=1)
    write = pyarrow.csv.write_csv if suffix == ".csv" else pyarrow.parquet.write_table
    write(pa.table({"LOAD": walk}), tmp_path / f"load{suffix}")
    lines = ['plant = "P2"', "controller = { k = 0.5, ti = 3 }", "t_end = 10"]
    lines.append(f'load = [{{ kind = "file", path = "load{suffix}", column = "LOAD" }}]')
    (tmp_path / "loop.toml").write_text("\n".join(lines), encoding="utf-8")
    assert np.array_equal(run(read_scenario(tmp_path / "loop.toml")).load, walk)
    with pytest.raises(InputError, match=r"missing\.csv, column LOAD"):
        run(
            filtered_scenario(
                plant="P2", controller=(*P2_PI, 0, 0), load=File(path=tmp_path / "missing.csv", column="LOAD")
            )
        )
    with pytest.raises(InputError, match=r"none\.toml: cannot be read: No such file or directory$"):
        read_scenario(tmp_path / "none.toml")
    (tmp_path / "wrong.toml").write_text('plant = "P2"\ncontroler = { k = 1, ti = 1 }')
    with pytest.raises(InputError, match=r"wrong\.toml, .*"):
        read_scenario(tmp_path / "wrong.toml")


def test_jitter_and_losses_are_of_the_recording_alone() -> None:
    common: dict[str, Any] = {
        "plant": "P3",
        "controller": (*P3_PI, 0, 0),
        "d": 0.05,
        "noise": 0.005,
        "setpoint": [(1, 1.0)],
    }
    whole = run(filtered_scenario(**common))
    shaken = run(filtered_scenario(**common, jitter=0.02))
    off = shaken.t - whole.t
    assert np.array_equal(shaken.pv, whole.pv)
    assert np.abs(off).max() <= 0.02 and off.std() == pytest.approx(0.02 / 3**0.5, rel=0.02)
    assert np.all(np.diff(shaken.t) > 0)
    thin = run(filtered_scenario(**common, lost=0.3))
    kept = np.isin(whole.t, thin.t)
    assert len(thin.t) == pytest.approx(0.7 * len(whole.t), rel=0.02)
    assert all(np.array_equal(x, y[kept]) for x, y in zip(columns(thin), columns(whole), strict=True))


def variety() -> list[Scenario]:
    """Scenarios of every kind, some alike but for their numbers."""
    many = [Scenario(**EVERYTHING), Scenario(**EVERYTHING | {"outer": None, "lost": 0.0})]
    for i in range(45):
        many.append(
            filtered_scenario(
                name=f"{i}",
                plant=("P2", "P3", "P4", "P1")[i % 4],
                controller=(0.2 + 0.004 * i, 2.5 + 0.1 * i, 0.3 * (i % 3 == 0), 0.5 * (i % 2)),
                d=0.002 * i,
                noise=(0.0, 0.001, 0.005)[i % 3],
                limits=(-1.5, 1.2) if i % 5 == 0 else None,
                setpoint=[(0, 0.1 * (i % 2)), (1 + i, 1.0)],
                load=[[(100, 0.3)], Walk(rate=0.01), Sine(amplitude=0.1, period=50.0)][i % 3],
                jitter=0.01 * (i % 7 == 0),
                lost=0.05 * (i % 11 == 0),
                t_end=400 if i % 9 else 250,
                seed=i,
            )
        )
    return many


def test_many_at_once_give_the_bits_of_each_alone() -> None:
    many = variety()
    assert all(same(a, run(s)) for a, s in zip(run_many(many, progress=False), many, strict=True))


def test_the_estimate_kept_is_that_of_the_detector_over_the_signals() -> None:
    many = variety()[2:]
    table = run_many(many, keep="estimate", progress=False)
    for i, scenario in enumerate(many):
        s = run(scenario)
        detector = glapp._glapp.Detector(scenario.detector(scenario.filter_time()))
        detector.run(s.t, s.sp, s.pv, s.op, s.flags)
        estimate = detector.estimate
        row = table.slice(i, 1).to_pylist()[0]
        assert row["half_periods"] == len(detector.table()["t_start"])
        assert row["d_hat"] == (None if estimate is None else estimate[0])
        assert (row["name"], row["seed"], row["d"], row["error"]) == (f"{i}", i, scenario.d, None)
    assert sum(d is not None for d in table["d_hat"].to_pylist()) > 10


def test_an_unstable_loop_among_many() -> None:
    good = filtered_scenario(
        plant="P3", controller=(*P3_PI, 0, 0), d=0.05, noise=0.002, setpoint=[(1, 1.0)], load=[(100, 0.3)]
    )
    wild = good.model_copy(update={"controller": Controller(k=5, ti=0.3, setpoint_weight=0)})
    many = [*[good.model_copy(update={"seed": seed}) for seed in range(20)], wild]
    errors = run_many(many, keep="estimate", progress=False)["error"].to_pylist()
    assert errors[:-1] == [None] * 20 and errors[-1].startswith("unstable closed loop: OP went beyond")
    with pytest.raises(InputError, match="scenario 20: unstable closed loop"):
        run_many(many, progress=False)
    coarse = good.model_copy(update={"h": 5.0})
    with pytest.raises(InputError, match="scenario 1: h = 5 s is too coarse"):
        run_many([good, coarse], keep="estimate", progress=False)
    assert run_many([], keep="estimate", progress=False).num_rows == 0


def test_plants_of_other_packages() -> None:
    by_name = filtered("P4", (*P2_PI, 0, 0), t_end=50, setpoint=[(1, 1.0)])
    thing = SimpleNamespace(num=np.array([1.0]), den=np.array([2.0, 1.0]), dead_time=4.0)
    assert same(filtered(thing, (*P2_PI, 0, 0), t_end=50, setpoint=[(1, 1.0)]), by_name)
    without_delay = filtered(control.tf([1.0], [2.0, 1.0]), (*P2_PI, 0, 0), t_end=50, setpoint=[(1, 1.0)])
    assert same(without_delay, filtered(Plant([1], [2, 1]), (*P2_PI, 0, 0), t_end=50, setpoint=[(1, 1.0)]))


@pytest.mark.parametrize(
    ("toml", "plant"),
    [
        ('"P6"', Plant.of("P6")),
        ("{ num = [2.0], den = [3.0, 1.0] }", Plant([2], [3, 1])),
        ("{ num = [2.0], den = [3.0, 1.0], dead_time = 0.5 }", Plant([2], [3, 1], 0.5)),
    ],
)
def test_a_plant_reads_in_toml_as_it_was_written(toml: str, plant: Plant) -> None:
    scenario = Scenario(plant=plant, controller=P2_PI)
    assert scenario.to_toml().splitlines()[0] == f"plant = {toml}"
    assert Scenario.from_toml(scenario.to_toml()).plant == plant


def test_plants_in_series() -> None:
    """A list of plants is the plant that their product is, in Python and in TOML."""
    toml = 'plant = ["P4", { num = [1.0], den = [0.5, 1.0], dead_time = 1 }]\ncontroller = { k = 0.2, ti = 3 }'
    both = Scenario.from_toml(toml)
    assert both.plant == Plant([1], [2, 1], 4) * Plant([1], [0.5, 1], 1) == Plant([1], [1, 2.5, 1], 5)
    assert Scenario.from_toml(both.to_toml()) == both


def test_short_forms() -> None:
    long = filtered_scenario(
        plant=Plant([1], [1, 1]),
        controller=Controller(k=0.5, ti=3, action="direct", setpoint_weight=0),
        noise=(Uniform(amplitude=0.1),),
        manual=(Manual(begin=1, end=2), Manual(begin=3, end=4, op=5)),
    )
    short = filtered_scenario(plant=([1], [1, 1], 0), controller=(-0.5, 3, 0, 0), noise=0.1, manual=[(1, 2), (3, 4, 5)])
    assert long == short
    loads = [filtered_scenario(plant="P2", controller=(*P2_PI, 0, 0), load=np.full(3, x)) for x in (0.0, 0.0, 1.0)]
    assert loads[0] == loads[1] and loads[0] != loads[2]


@pytest.mark.parametrize(
    ("wrong", "line"),
    [
        ({"friction": {"model": "kano", "s": 1, "j": 2}}, "j = 2: must be 0 or greater, at most s"),
        ({"friction": {"model": "dahl", "s": 1, "j": 0}}, "friction.model: is 'dahl', must be one of 'kano' or 'he'"),
        ({"rate": 0}, "rate: is 0, must be > 0"),
        ({"jitter": 0.03}, "jitter = 0.03: must be 0 s or greater, at most h/2"),
        ({"lost": 1}, "lost: is 1, must be < 1"),
        ({"load": [{"kind": "sine", "amplitude": 1, "period": 0}]}, "load.0.sine.period: is 0, must be > 0"),
        ({"load": [{"kind": "saw"}]}, "load.0"),
        ({"controller": Controller(k=1, ti=1, gain_unit="%/%")}, "pv_span: is required to convert a gain in %/%"),
        ({"plant": "P9"}, "plant: is 'P9'; write P1, P2"),
        ({"plant": {"num": [1], "den": [1, 1], "dead_time": -1}}, "plant.dead_time: is -1, must be 0 s or greater"),
        (
            {"plant": {"num": [1], "den": [1, 1], "delay": 1}},
            "plant.delay: no such key; known keys: num, den, dead_time",
        ),
        ({"plant": {"num": [1]}}, "plant.den: is required"),
        ({"plant": ["P2", "P9"]}, "plant: is 'P9'"),
        ({"plant": []}, "plant: is []; write P1"),
        ({"plant": ([1, 0, 0], [1, 1])}, "plant.num: is of degree 2, must be of the degree of den (1) or lower"),
        ({"outer": {"plant": "P9", "controller": (1, 1)}}, "outer.plant: is 'P9'; write P1, P2"),
        ({"outer": {"plant": "P2", "controller": (1, 1), "limits": (5, 6)}}, "needs OP = 0: outside the limits"),
        ({"delay": 3}, "delay: no such key"),
    ],
)
def test_wrong_scenarios_are_refused_in_one_line(wrong: dict[str, Any], line: str) -> None:
    with pytest.raises(InputError) as refusal:
        run(filtered_scenario(**{"plant": "P2", "controller": P2_PI} | wrong))
    assert line in str(refusal.value) and "\n" not in str(refusal.value)


def test_a_short_controller_is_a_plain_pi_controller() -> None:
    """b = 1 and no filter in the loop: OP's first move is K times the step of the setpoint."""
    s = closed_loop("P2", (0.4, 2.4), d=0, noise=0, t_end=5, setpoint=[(1, 1.0)])
    assert np.diff(s.op).max() == pytest.approx(0.4 * (1 + 0.05 / 2.4), rel=1e-9)
    others = {"d": 0, "noise": 0.01, "t_end": 50, "setpoint": [(1, 1.0)]}
    plain = closed_loop("P2", (0.4, 2.4), **others)
    assert same(plain, closed_loop("P2", (0.4, 2.4, 0, 1), tf=0, **others))
    assert same(closed_loop("P2", (0.4, 2.4), tf=0.3, **others), closed_loop("P2", (0.4, 2.4, 0, 1), tf=0.3, **others))
    assert not same(plain, filtered("P2", (0.4, 2.4), **others))


def test_a_tuning_is_a_controller() -> None:
    others = {"d": 0.05, "t_end": 50, "setpoint": [(1, 1.0)]}
    tuning = amigo_step("P2", "PI")
    assert same(closed_loop("P2", tuning, **others), closed_loop("P2", tuning.controller, tf=0, **others))
    filtered = assess("P2", tuning, tf=0.2)
    assert same(closed_loop("P2", filtered, **others), closed_loop("P2", tuning.controller, tf=0.2, **others))
    assert same(closed_loop("P2", filtered, tf=0, **others), closed_loop("P2", tuning, **others))


def test_a_simulation_is_drawn_and_is_a_data_frame() -> None:
    s = closed_loop("P2", (0.4, 2.4), d=0.05, t_end=20, setpoint=[(1, 1.0)], load=[(10, 0.3)])
    figure = glapp.plot(s)
    assert [trace.name for trace in figure.data] == ["SP", "PV", "OP", "position", "load"]
    axes = [axis.title.text for axis in figure.select_yaxes()]
    assert axes == ["SP, PV [PV unit]", "OP, position [OP unit]", "load [OP unit]"]
    frame = s.to_pandas()
    assert list(frame.columns) == s.to_arrow().column_names
    np.testing.assert_array_equal(frame["PV"].to_numpy(), s.pv)


def test_a_simulation_is_analysed_as_it_is() -> None:
    """It was refused as no table with named columns."""
    s = closed_loop("P3", (0.48, 0.3117), d=0.05, h=0.05, t_end=60, setpoint=[(0, 1.0)], load=[(10, 0.3), (30, 0.0)])
    loop = glapp.Loop(name="F", controller={"k": 0.48, "ti": 0.3117})
    one, other = (glapp.analyze(given, loop=loop, fit=False, position="") for given in (s, s.to_arrow()))
    widths = one.half_periods.to_dict()["d"]
    assert len(widths) > 3
    np.testing.assert_array_equal(widths, other.half_periods.to_dict()["d"])
