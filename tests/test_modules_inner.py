"""Inputs and outputs of a module's detector: Kp by default, a filter of its own, corrected width, inner variables."""

import math
from typing import Any

import numpy as np
import pytest
from bench import modules as bench

from glapp import _glapp
from glapp.errors import InputError
from glapp.modules import Backlash, BacklashDetection, Graph, Input, Noise, Output, Pid, PidAdvanced, ProcessSim

LOAD = 5.0 * (np.arange(10_000) // 2000 % 2)


def loop_with(gap: float = 2.0, **settings: Any) -> Graph:
    """Lags of 3 s and 1 s behind a gap, in the noise of 6.5."""
    given = {"k": 2.0, "ti": 2.0, "tf": 0.2, "low": 0, "high": 100, "start": 50.0} | settings
    modules = {
        "sp": Input(50.0),
        "load": Input(),
        "pid": PidAdvanced(**given),
        "gap": Backlash(gap),
        "process": ProcessSim(1.0, 3.0, 1.0, start=50.0),
        "noise": Noise(0.1),
    }
    return Graph(0.1, modules, ["sp -> pid.sp", "load -> process.load", "pid -> gap -> process -> noise -> pid.pv"])


SPANS = {"pv_span": 100.0, "op_span": 100.0}


def test_a_kp_by_default_has_the_sign_of_k_and_is_marked() -> None:
    for settings, used, defaulted in (
        ({}, None, 0.0),
        ({"pv_span": 100.0}, None, 0.0),
        ({"op_span": 100.0}, None, 0.0),
        (SPANS, 1.5, 1.0),
        ({"pv_span": 50.0, "op_span": 100.0}, 0.75, 1.0),
        (SPANS | {"k": -2.0}, -1.5, 1.0),
        (SPANS | {"kp": 1.2}, 1.2, 0.0),
        (SPANS | {"integrating": True}, None, 0.0),
    ):
        loop = loop_with(**settings)
        assert math.isnan(loop["pid.kp_used"]) if used is None else loop["pid.kp_used"] == used, settings
        assert loop["pid.kp_defaulted"] == defaulted, settings
        assert loop["pid.kp"] == settings.get("kp"), "what was given, and no more"


def test_kp_by_default_is_that_of_analyze() -> None:
    assert loop_with(**SPANS)["pid.kp_used"] == _glapp.KP_DEFAULT == _glapp.process_gain(None, (100.0, 100.0), False)


def test_wrong_settings_are_named() -> None:
    for settings, match in (
        ({"ti": -1.0}, r"watch: ti = -1: must be greater than 0 s"),
        ({"td": -1.0}, r"watch: td = -1: must be 0 s or greater"),
        ({"tf": -0.1}, r"watch: tf = -0.1: must be 0 s or greater"),
        ({"pv_span": 0.0}, r"watch: pv_span = 0: must be greater than 0"),
        ({"op_span": -5.0}, r"watch: op_span = -5: must be greater than 0"),
        ({"integrating": 2.0}, r"watch: integrating = 2: must be 0 \(no\) or 1 \(yes\)"),
    ):
        given: dict[str, Any] = {"k": 1.0, "ti": 2.0} | settings
        modules = {
            "pv": Input(),
            "sp": Input(),
            "pid": Pid(1.0, 2.0),
            "watch": BacklashDetection(**given),
            "op": Output(),
        }
        wires = ["pv -> pid.pv", "sp -> pid.sp", "pv -> watch.pv", "sp -> watch.sp", "watch -> pid.ff", "pid -> op"]
        with pytest.raises(InputError, match=match):
            Graph(0.1, modules, wires)
    with pytest.raises(InputError, match=r"pid: ti = -1: must be greater than 0 s"):
        loop_with(ti=-1.0)
    with pytest.raises(InputError, match=r"pid: detector_tf = -1: must be 0 s or greater"):
        loop_with(detector_tf=-1.0)


def test_defaults_are_read_as_what_is_in_force() -> None:
    loop = loop_with(comp_size=2.0)
    in_force = {
        "max_h": 1.0,
        "detector_tf": 0.2,
        "comp_limit": 2.0,
        "comp_band": 0.4,
        "comp_rate": 10.0,
        "comp_watch": 600.0,
    }
    assert {name: loop[f"pid.{name}"] for name in in_force} == in_force
    assert loop["process.h"] == 0.1 and loop["pid.kp"] is None and loop["pid.start_pv"] is None
    assert loop_with(tf=0.0)["pid.detector_tf"] == 0.2 and loop_with(tf=0.0, td=0.5)["pid.detector_tf"] == 0.1
    assert loop_with()["pid.comp_band"] is None, "there is no compensation"


def test_a_filter_of_the_detectors_own_hears_pv_before_the_controllers_filter() -> None:
    """The controller's own filter of Ti/10, again on raw PV, is the detector beside, on raw PV, with that filter."""
    loop = loop_with(kp=1.0, detector_tf=0.5)
    modules = {
        "pv": Input(),
        "sp": Input(50.0),
        "pid": Pid(2.0, 2.0, tf=0.2, low=0, high=100, start=50.0),
        "watch": BacklashDetection(2.0, 2.0, kp=1.0, tf=0.5, op_low=0, op_high=100, max_h=1.0),
        "op": Output(),
    }
    wires = ["pv -> pid.pv", "sp -> pid.sp", "pv -> watch.pv", "sp -> watch.sp", "watch -> pid.ff", "pid -> op"]
    beside = Graph(0.1, modules, wires)
    seen = loop.run(1000, load=LOAD, record=["noise", "pid"])
    op = beside.run(1000, pv=seen["noise"], record=["op.value"])["op.value"]
    assert np.array_equal(op, seen["pid"])
    assert loop["pid.detections"] == beside["watch.detections"] > 10
    for name in ("d_hat", "noise_floor", "corrected_d", "corrected_doubt", "last_mask", "delta_y"):
        assert loop[f"pid.{name}"] == beside[f"watch.{name}"], name
    assert loop.window("pid") == beside.window("watch")


def test_the_corrected_width_is_the_whole_gap_while_half_of_it_is_compensated() -> None:
    loop = loop_with(kp=1.0, comp_size=1.0, comp_band=0.1, comp_withdraw=False)
    loop["pid.compensate"] = 1
    loop.run(2000, load=np.concatenate([LOAD, LOAD]))
    assert loop["pid.d_hat"] < 1.3, "what is left"
    assert loop["pid.corrected_d"] == pytest.approx(2.0, rel=0.05)


@pytest.mark.parametrize(
    "settings", [{"kp": 1.0}, SPANS, {}, {"kp": 1.0, "detector_tf": 4.0}], ids=["kp", "spans", "none", "2Ti"]
)
def test_no_corrected_width_without_a_gap(settings: dict[str, float]) -> None:
    loop = loop_with(gap=0.0, **settings)
    seen = loop.run(1000, load=LOAD, record=["pid.corrected_d", "pid.corrected_doubt"])
    assert np.isnan(seen["pid.corrected_d"]).all() and (seen["pid.corrected_doubt"] > 0).all()


def test_why_there_is_no_corrected_width_is_read_by_number() -> None:
    doubts = dict(enumerate(_glapp.doubts(), 1))
    loop = loop_with(kp=1.0)
    assert doubts[loop["pid.corrected_doubt"]] == "no_op"
    loop.scan()
    assert doubts[loop["pid.corrected_doubt"]] == "no_estimate"
    integrating = loop_with(integrating=True)
    assert doubts[integrating["pid.corrected_doubt"]] == "integrating"


def test_inner_variables_follow_the_half_period_under_way() -> None:
    loop = Graph(
        1.0,
        {"pv": Input(), "sp": Input(), "pid": PidAdvanced(k=0.5, ti=2.0, kp=2.0, detector_tf=0.0), "op": Output()},
        ["pv -> pid.pv", "sp -> pid.sp", "pid -> op"],
    )
    for pv in (-1.0, -3.0, -2.0):
        loop.scan(pv=pv, sp=0.0)
    now = {name: loop[f"pid.{name}"] for name in ("e", "delta_t", "delta_y", "e_max", "delta_u", "kp_part")}
    assert now == {"e": 2.0, "delta_t": 2.0, "delta_y": 2.5, "e_max": 3.0, "delta_u": 1.25, "kp_part": 1.25}
    assert loop["pid.mask"] == 1 | 16 | 64, "after a gap, too short, nothing to compare with"
    assert math.isnan(loop["pid.last_delta_t"]) and loop.window("pid") == []
    loop.scan(pv=4.0, sp=1.0)
    assert loop["pid.last_delta_t"] == 2.0 and loop["pid.last_delta_sp"] == 1.0 and loop["pid.last_mask"] == 1 | 16 | 64
    assert loop["pid.e"] == -3.0 and math.isnan(loop["pid.delta_y_prev"]), "none to compare with after a break"
    loop.scan(pv=0.0, sp=1.0)
    assert loop["pid.e"] == 1.0 and loop["pid.delta_y_prev"] == 3.0 and loop["pid.last_mask"] == 16 | 64
    assert loop["pid.u_fb"] == loop["pid"]


def test_the_bench_measures_the_modules() -> None:
    """One loop of the table in bench/results/modules.md: corrected where d̂ is a third too low."""
    case = bench.Case("P2", "PID", 0.05, 1)
    c = bench.RULES["PID"]("P2")
    shown = bench.show(case, c, kp=1.0, detector_tf=c.ti / 5)
    assert shown.d_hat < 0.04 and shown.corrected == pytest.approx(0.05, rel=0.02)
    none = bench.show(bench.Case("P2", "PID", 0.0, 1), c, kp=1.0, detector_tf=c.ti / 5)
    assert math.isnan(none.d_hat) and math.isnan(none.corrected)
