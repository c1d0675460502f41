"""Bounds and derived values of a loop."""

import numpy as np
import pytest

from glapp.errors import InputError
from glapp.loop import Loop
from glapp.recording import Batch, with_op_unit


@pytest.mark.parametrize(
    ("settings", "line"),
    [
        ({"n": 8}, "n: is 8, must be odd"),
        ({"n": 0}, "n: is 0, must be ≥ 1"),
        ({"pv_span": (5, 5)}, "pv_span: goes from 5 to 5, must be low < high"),
        ({"op_span": (100, 0)}, "op_span: goes from 100 to 0, must be low < high"),
        ({"op_span": (0, float("nan"))}, "op_span.1: is nan, must be a finite number"),
        ({"tf": 0}, "tf: is 0, must be > 0"),
        ({"sample_time": -1}, "sample_time: is -1, must be > 0"),
        ({"acceptable_dead_band": 101}, "acceptable_dead_band: is 101, must be ≤ 100"),
        ({"time_zone": "Mars/Base"}, "time_zone: is 'Mars/Base', must be an IANA time zone"),
        ({"time_zone": "../etc"}, "time_zone: is '../etc', must be an IANA time zone"),
        ({"process": {"kp": 0}}, "process.kp: is 0, must not be 0"),
        ({"process": {"type": "integrating", "kp": 1}}, "process.kp: an integrating process has no static gain"),
        ({"cascade": {"role": "slave"}}, "cascade.role: is 'slave', must be one of 'primary' or 'secondary'"),
        ({"controller": {"k": 1, "ti": 0}}, "controller.ti: is 0, must be > 0"),
        ({"columns": {"setpoint": "A"}}, "columns.setpoint: no such key; "),
        ({"pvspan": (0, 1)}, "pvspan: no such key; did you mean pv_span?"),
        ({"positioner": {"dead_band": -1}}, "positioner.dead_band: is -1, must be ≥ 0"),
    ],
)
def test_each_bound_is_one_line(settings, line):
    with pytest.raises(InputError) as caught:
        Loop(name="F", **settings)
    assert str(caught.value).startswith(line)
    assert "\n" not in str(caught.value)


def test_a_loop_cannot_be_changed():
    loop = Loop(name="F")
    with pytest.raises(ValueError, match="frozen"):
        loop.name = "G"


def test_conversion_errors_name_the_loop():
    loop = Loop(name="FIC1", pv_span=(0, 50), op_span=(0, 100), controller={"k": 1, "ti": 1})
    with pytest.raises(InputError, match="loop FIC1, gain_unit: is required"):
        loop.ideal()


def test_process_gain_in_signal_units():
    spans = {"pv_span": (0, 50), "op_span": (0, 100)}
    assert Loop(name="F").kp() is None
    assert Loop(name="F", process={"kp": 2.0}).kp() == 2.0
    assert Loop(name="F", process={"kp": 2.0, "kp_unit": "PV/OP"}, **spans).kp() == 2.0
    assert Loop(name="F", process={"kp": 2.0, "kp_unit": "%/%"}, **spans).kp() == 1.0
    with pytest.raises(InputError, match=r"process\.kp_unit: is required"):
        Loop(name="F", process={"kp": 2.0}, **spans).kp()
    with pytest.raises(InputError, match="pv_span: is required to convert Kp"):
        Loop(name="F", process={"kp": 2.0, "kp_unit": "%/%"}).kp()


@pytest.mark.parametrize(
    ("settings", "label"),
    [
        ({}, "%"),
        ({"op_span": (0, 100)}, "%"),
        ({"op_span": (4, 20)}, "OP unit"),
        ({"op_span": (4, 20), "op_unit": "mA"}, "mA"),
    ],
)
def test_unit_of_op(settings, label):
    assert Loop(name="F", **settings).op_label == label


@pytest.mark.parametrize(
    ("op", "settings", "label"),
    [
        ([30.0, 60.0], {}, "%"),
        ([30.0, 101.0], {}, "OP unit"),
        ([-1.0, 60.0], {}, "OP unit"),
        ([0.2, 0.9], {}, "OP unit"),
        ([0.2, 0.9], {"op_unit": "%"}, "OP unit"),
        ([0.2, 0.9], {"op_span": (0, 100)}, "%"),
        ([6.0, 14.0], {}, "OP unit"),
        ([6.0, 14.0], {"op_unit": "%"}, "%"),
        ([6.0, 14.0], {"op_span": (0, 100)}, "%"),
        ([6.0, 14.0], {"op_unit": "mA"}, "mA"),
        ([6.0, np.nan, 21.0], {}, "%"),
        ([12.0, 12.0], {}, "%"),
        (None, {}, "%"),
    ],
)
def test_values_of_op_may_show_that_it_is_no_percentage(op, settings, label):
    column = None if op is None else np.array(op)
    t = np.arange(0 if op is None else len(op), dtype=float)
    assert with_op_unit(Loop(name="F", **settings), Batch(t, None, t, column)).op_label == label
    if op is not None:  # in two stretches as in one
        halves = [Batch(t[:1], None, t[:1], column[:1]), Batch(t[1:], None, t[1:], column[1:])]
        assert with_op_unit(Loop(name="F", **settings), *halves).op_label == label
