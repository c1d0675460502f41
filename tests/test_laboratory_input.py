"""Wrong input to the laboratory: every parameter of every public function that takes a number refuses what is none.

The refusal is one line with the parameter, the value and the bound. A bare TypeError of Python names none of them.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from glapp import modules, nonlinear, plant, simulate, tuning
from glapp.blocks import Backlash
from glapp.errors import InputError

P2 = plant.PLANTS["P2"]
LOOP = tuning.open_loop("P2", (0.775, 2.05))
T = np.linspace(0, 30, 301)


def gap() -> modules.Graph:
    """A gap alone; a run of 10¹⁸ scans ended Python for want of memory."""
    return modules.Graph(
        0.1, {"x": modules.Input(), "gap": modules.Backlash(1.0), "y": modules.Output()}, ["x -> gap -> y"]
    )


NUMBERS: list[tuple[Callable[..., Any], dict[str, Any], str]] = [
    (nonlinear.n_backlash, {"a": 1.0, "d": 1.0}, "a d"),
    (nonlinear.n_relay, {"a": 1.0, "level": 1.0}, "a level"),
    (nonlinear.negative_inverse, {"n": 1 + 1j}, "n"),
    (nonlinear.describing_function, {"element": lambda: Backlash(1.0).update, "a": 1.0, "samples": 64}, "a samples"),
    (nonlinear.backlash_cycles, {"loop": LOOP, "d": 1.0}, "d"),
    (nonlinear.relay_cycles, {"loop": LOOP, "level": 1.0}, "level"),
    (nonlinear.over_compensation, {"plant": "P2", "compensation": 2.0, "d": 1.0, "tf": 0.1}, "compensation d tf"),
    (nonlinear.phase_lead, {"loop": LOOP, "margin": 1.3}, "margin"),
    (nonlinear.nyquist_figure, {"loops": LOOP, "window": 3.0}, "window"),
    (tuning.lambda_tuning, {"process": "P2", "lam": 1.0}, "lam"),
    (tuning.simc, {"process": "P2", "tau_c": 1.0}, "tau_c"),
    (tuning.migo, {"plant": "P2", "ms": 1.4, "mt": 1.4, "tf": 0.0}, "ms mt tf"),
    (tuning.design, {"plant": "P2", "kind": "PI", "ms": 1.4, "mt": 1.4}, "ms mt"),
    (tuning.open_loop, {"plant": "P2", "controller": (0.5, 2.0), "tf": 0.1}, "tf"),
    (tuning.assess, {"plant": "P2", "controller": (0.5, 2.0), "tf": 0.1}, "tf"),
    (tuning.Fotd, {"kp_process": 1.0, "t": 1.0, "l": 1.0}, "kp_process t l"),
    (tuning.Integrating, {"kv": 1.0, "l": 1.0}, "kv l"),
    (tuning.fotd_from_step, {"t": T, "y": P2.step_response(T), "u_step": 1.0}, "t y u_step"),
    (
        tuning.relay_experiment,
        {
            "plant": "P2",
            "amplitude": 1.0,
            "noise": 0.0,
            "d": 0.0,
            "known_d": 0.0,
            "h": 0.1,
            "wait": 5.0,
            "longest": 200.0,
        },
        "amplitude noise d known_d h wait longest",
    ),
    (tuning.relay_experiment, {"plant": "P2", "pv_limits": (-9, 9), "op_limits": (-9, 9)}, "pv_limits op_limits"),
    (tuning.relay_experiment, {"plant": "P2", "load": [(1, 0.1)]}, "load"),
    (simulate.random_walk, {"n": 10, "h": 1.0, "rate": 0.1, "seed": 1}, "n h rate seed"),
    (plant.Plant, {"num": [1.0], "den": [1.0, 1.0], "dead_time": 1.0}, "num den dead_time"),
    (P2.step, {"t": [1.0]}, "t"),
    (P2.bode, {"w": [1.0]}, "w"),
    (P2.response, {"w": [1.0]}, "w"),
    (P2.step_response, {"t": [1.0]}, "t"),
    (P2.at, {"s": 1j}, "s"),
    (P2.delayed, {"dead_time": 1.0}, "dead_time"),
    (P2.frequencies, {"per_decade": 60}, "per_decade"),
]


@pytest.mark.parametrize(
    "wrong",
    ["2 s", math.nan, math.inf, [1, "b"], 10**400],
    ids=["text", "nan", "inf", "list", "long"],
)
@pytest.mark.parametrize(
    ("function", "given", "name"),
    [
        pytest.param(function, given, name, id=f"{function.__name__}-{name}")
        for function, given, names in NUMBERS
        for name in names.split()
    ],
)
def test_what_is_no_number_is_refused_by_name(
    function: Callable[..., Any], given: dict[str, Any], name: str, wrong: Any
) -> None:
    with pytest.raises(InputError, match=rf"^(column )?{name}(, \w+)?: ") as refused:
        function(**{**given, name: wrong})
    assert "must" in str(refused.value)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: tuning.half_rule("P2", "PDI"), "kind: is 'PDI', must be 'PI' or 'PID'"),
        (lambda: tuning.amigo_step("P2", ["PI"]), "kind: is \\['PI'\\], must be 'PI' or 'PID'"),
        (lambda: tuning.ziegler_nichols_step("P2", table=["original"]), "table: is \\['original'\\], must be"),
        (lambda: tuning.relay_experiment("P2").tuned("amigos"), "rule: is 'amigos', must be 'point_placement' or"),
        (lambda: tuning.relay_experiment("P2", load=np.array([1.0, math.nan])), "load: is nan, must be"),
        (lambda: tuning.relay_experiment("P2", pv_limits=(1, -1)), "pv_limits: goes from 1 to -1"),
        (lambda: tuning.Fotd(1.0, t=0, l=0).tau, "t \\+ l: is 0, must be greater than 0 s"),
        (lambda: nonlinear.nyquist_figure([]), "loops: is empty, give one loop or more"),
        (lambda: nonlinear.describing_function(Backlash(1.0), 1.0), "element: is .*, must be a function"),
        (lambda: P2 * "2", "gain: is '2', must be a number other than 0, or a Plant"),
        (lambda: plant.Plant([1j], [1, 1]), "num: is \\[1j\\], must be finite numbers"),
        (lambda: simulate.run_many(3), "scenarios: is 3, must be a list of Scenario"),
        (lambda: simulate.run("P2"), "scenario: is 'P2', must be a Scenario"),
        (lambda: simulate.closed_loop("P2", (0, 2.0)), "controller.k: is 0, must be other than 0"),
        (lambda: modules.Graph(0.1, {"gap": modules.Backlash("wide")}, []), "Backlash: d: is 'wide', must be a number"),
        (lambda: modules.Graph(0.1, {"pid": "PID"}, []), "pid: is 'PID', must be a module"),
        (lambda: modules.Graph(0.1, [modules.Pid(k=1, ti=1)], []), "modules: is .*, must be names with their modules"),
        (
            lambda: simulate.Scenario(plant="P2", controller={"k": -0.5, "ti": 2.0}),
            "controller.k: is -0.5, must be > 0; the action has its sign: write action = 'direct'",
        ),
        (
            lambda: simulate.Scenario(plant="P2", controller=(0.5, 2.0), load=[{"kind": "wlak", "rate": 0.1}]),
            "load.0.kind: is 'wlak', must be one of 'steps', 'ramp', 'sine', 'walk'",
        ),
        (lambda: modules.Graph("0.1 s", {}, []), "^h: is '0.1 s', must be a number"),
        (lambda: modules.Graph(0.1, {}, "sp -> pid.sp"), "^wires: is 'sp -> pid.sp', must be a list of wires"),
        (lambda: gap().scan(x="wide"), "^x.value: is 'wide', must be a number"),
        (lambda: gap().scan(h="1 s"), "^h: is '1 s', must be a number"),
        (lambda: gap().__setitem__("gap.d", [1.0, 2.0]), r"^gap.d: is \[1.0, 2.0\], must be a number"),
        (lambda: gap().run(1, x="wide"), "^x: is not numbers: could not convert"),
        (lambda: gap().run(1, x=2.0), "^x: is no array, must have one value a scan"),
        (lambda: gap().run(1e18), r"^t: is 1e\+18, must be 0 to 1e\+07 s, which is 10⁸ scans"),
    ],
)
def test_other_wrong_input_is_refused_in_one_line(call: Callable[[], Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        call()


@pytest.mark.parametrize("model", [tuning.Fotd(1.0, t=2.0, l=1.0), tuning.Integrating(0.5, l=1.0)])
def test_a_model_is_a_process_everywhere(model: Any) -> None:
    """docs/tuning.md says so; half of the laboratory refused one."""
    assert tuning.ultimate(model) == tuning.ultimate(model.plant)
    assert tuning.character(model) == tuning.character(model.plant)
    assert nonlinear.over_compensation(model, 2.0, 1.0) == nonlinear.over_compensation(model.plant, 2.0, 1.0)
    assert simulate.Scenario(plant=model, controller=(0.1, 20.0)).plant == model.plant
    assert tuning.relay_experiment(model).ku == tuning.relay_experiment(model.plant).ku


def test_a_masked_value_is_a_bad_one_for_a_graph() -> None:
    values = np.ma.masked_array([1.0, 5.0, 2.0], mask=[False, True, False])
    assert np.isnan(gap().run(0.3, x=values, record=["x"])["x"]).tolist() == [False, True, False]


def test_a_loop_whose_phase_never_reaches_a_quarter_turn_keeps_clear_of_every_gap() -> None:
    """`backlash_margin` of it, and `phase_lead`, ended in an error of NumPy."""
    lag = plant.Plant([5.0], [1.0, 1.0])
    assert nonlinear.backlash_margin(lag)[0] == math.inf
    assert nonlinear.phase_lead(lag, margin=1.3).lead == nonlinear.phase_lead(lag, margin=1.3).lag
