"""Conversions of the controller's form and units, against the forms' transfer functions and by hand."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from glapp.controller import Controller
from glapp.errors import InputError

gains = st.floats(1e-3, 1e3)
times = st.floats(1e-2, 1e4)


def transfer(form, k, ti, td, w):
    s = 1j * w
    if form == "series":
        return k * (1 + 1 / (ti * s)) * (1 + td * s)
    return k * (1 + 1 / (ti * s) + td * s)


@given(gains, times, st.floats(0, 1e4), st.floats(1e-3, 1e2))
@pytest.mark.slow
def test_series_has_the_same_frequency_response_as_its_ideal_form(k, ti, td, w):
    ideal = Controller(form="series", k=k, ti=ti, td=td).ideal()
    want, got = transfer("series", k, ti, td, w), transfer("ideal", ideal.k, ideal.ti, ideal.td, w)
    assert abs(want - got) <= 1e-9 * abs(want)


@given(gains, times, st.floats(0, 0.25))
def test_series_and_back(k, ti, ratio):
    """A series form exists where Ti ≥ 4Td: its times are the roots of x² − Ti·x + Ti·Td."""
    td = ti * ratio * 0.99
    root = math.sqrt(1 - 4 * td / ti)
    ti_series, k_series = ti * (1 + root) / 2, k * (1 + root) / 2
    ideal = Controller(form="series", k=k_series, ti=ti_series, td=ti - ti_series).ideal()
    assert ideal.k == pytest.approx(k)
    assert ideal.ti == pytest.approx(ti)
    assert ideal.td == pytest.approx(td, rel=1e-6, abs=1e-9 * ti)


@given(gains, gains, st.floats(0, 1e3), st.sampled_from([("s", 1.0), ("min", 60.0)]))
@pytest.mark.slow
def test_parallel_has_the_same_frequency_response(kp, ki, kd, unit):
    name, seconds = unit
    ideal = Controller(form="parallel", kp=kp, ki=ki, kd=kd, ti_unit=name, td_unit=name).ideal()
    s = 1j * 0.7
    want = kp + ki / seconds / s + kd * seconds * s
    assert abs(want - transfer("ideal", ideal.k, ideal.ti, ideal.td, 0.7)) <= 1e-9 * abs(want)


@given(times)
def test_repeats_are_the_inverse_of_time(ti):
    assert Controller(k=1, ti=1 / ti, ti_unit="repeats/min").ideal().ti == pytest.approx(60 * ti)
    assert Controller(k=1, ti=1 / ti, ti_unit="repeats/s").ideal().ti == pytest.approx(ti)
    assert Controller(k=1, ti=ti, ti_unit="min").ideal().ti == pytest.approx(60 * ti)


@given(gains, st.floats(-1e3, 1e3), st.floats(1e-2, 1e4))
def test_percent_gain_moves_op_by_the_same_share_of_its_span(k, low, width):
    pv_span, op_span = (low, low + width), (4.0, 20.0)
    ideal = Controller(k=k, gain_unit="%/%", ti=1).ideal(pv_span, op_span)
    pv_percent = 3.0  # a step of 3 % of the PV span
    op = ideal.k * pv_percent / 100 * (pv_span[1] - pv_span[0])
    assert op / 16.0 * 100 == pytest.approx(k * pv_percent)


def test_proportional_band_and_action():
    spans = {"pv_span": (0, 200), "op_span": (0, 100)}
    assert Controller(pb=50, ti=10).ideal(**spans).k == pytest.approx(1.0)
    assert Controller(pb=50, ti=10, action="direct").ideal(**spans).k == pytest.approx(-1.0)
    assert Controller(pb=50, ti=10, setpoint_weight=0).ideal(**spans).b == 0.0


def test_gain_unit_may_be_left_out_only_where_it_does_not_matter():
    c = Controller(k=2, ti=1)
    assert c.ideal().k == 2
    assert c.ideal((0, 100), (0, 100)).k == 2
    with pytest.raises(InputError, match="gain_unit: is required, since the spans of PV and OP differ"):
        c.ideal((0, 50), (0, 100))
    with pytest.raises(InputError, match="pv_span: is required to convert"):
        Controller(pb=100, ti=1).ideal()
    with pytest.raises(InputError, match="op_span: is required to convert"):
        Controller(k=1, gain_unit="%/%", ti=1).ideal(pv_span=(0, 10))


@pytest.mark.parametrize(
    ("settings", "line"),
    [
        ({"k": 1, "ti": 0}, "ti: is 0, must be > 0"),
        ({"k": 1, "ti": -3}, "ti: is -3, must be > 0"),
        ({"k": 0, "ti": 1}, "k: is 0, must be > 0"),
        ({"pb": 0, "ti": 1}, "pb: is 0, must be > 0"),
        ({"k": float("nan"), "ti": 1}, "k: is nan, must be"),
        ({"k": 1, "ti": float("inf")}, "ti: is inf, must be a finite number"),
        ({"k": 1, "ti": 1, "td": -1}, "td: is -1, must be ≥ 0"),
        ({"k": 1, "ti": 1, "setpoint_weight": 1.5}, "setpoint_weight: is 1.5, must be ≤ 1"),
        ({"k": 1}, "ti: is required"),
        ({"ti": 1}, "k: give either the gain k or the proportional band pb"),
        ({"k": 1, "pb": 1, "ti": 1}, "k: give either"),
        ({"k": 1, "ti": 1, "kp": 1}, "kp: does not belong to form = 'ideal'"),
        ({"form": "parallel", "kp": 1, "ki": 1, "ti": 2}, "ti: does not belong to form = 'parallel'"),
        ({"form": "parallel", "kp": 1}, "ki: is required in the parallel form"),
        ({"form": "parallel", "kp": 1, "ki": 1, "ti_unit": "repeats/min"}, "ti_unit: is 'repeats/min', must be 's' or"),
        (
            {"k": 1, "ti": 1, "form": "classical"},
            "form: is 'classical', must be one of 'ideal', 'series' or 'parallel'",
        ),
        ({"pb": 100, "ti": 1, "gain_unit": "OP/PV"}, "gain_unit: a proportional band is always in %/%"),
        ({"k": 1, "ti": 1, "integral": 1}, "integral: no such key"),
        ({"k": 1, "ti": 1, "acton": "direct"}, "acton: no such key; did you mean action?"),
    ],
)
def test_each_bound_is_one_line_with_name_value_and_bound(settings, line):
    with pytest.raises(InputError) as caught:
        Controller(**settings)
    assert str(caught.value).startswith(line)
    assert "\n" not in str(caught.value)


def test_a_conversion_that_overflows_is_refused():
    with pytest.raises(InputError, match="must be finite"):
        Controller(k=1e300, gain_unit="%/%", ti=1).ideal((0, 1e-20), (0, 1e20))
