"""Stamps against Python's own calendar, and the faults of a time column."""

from datetime import datetime, timedelta

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from glapp.reading.times import Clock
from glapp.reading.values import CellFault

moments = st.lists(st.datetimes(datetime(1970, 1, 1), datetime(2200, 1, 1)), min_size=1, max_size=20)


@given(
    moments,
    st.sampled_from(["%Y-%m-%d %H:%M:%S.%f", "%Y/%m/%d %H:%M:%S,%f", "%d.%m.%Y %H:%M:%S.%f", "%b %d, %Y %H:%M:%S.%f"]),
)
def test_layouts_agree_with_the_calendar(times, form):
    column = pa.array([t.strftime(form) for t in times])
    clock = Clock(column, None, None, None)
    got = clock.reader()(column)
    want = np.array([(t - times[0]) // timedelta(microseconds=1) for t in times]) / 1e6
    np.testing.assert_allclose(got, want, rtol=1e-15, atol=0)
    assert clock.t0 == times[0]


@given(moments, st.sampled_from(["s", "ms", "us", "ns"]), st.sampled_from([None, "UTC", "Europe/Stockholm"]))
def test_arrow_times_of_every_unit(times, unit, zone):
    ticks = np.array(times, "datetime64[us]").astype(f"datetime64[{unit}]").astype(np.int64)
    column = pa.array(ticks).view(pa.timestamp(unit, zone))
    clock = Clock(column, None, None, None)
    per_second = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}[unit]
    np.testing.assert_array_equal(clock.reader()(column), (ticks - ticks[0]) / per_second)
    assert clock.zone == zone
    assert (clock.t0.tzinfo is None) == (zone is None)


def test_months_and_halves_of_the_day():
    column = pa.array([f"1/31/2024 {h}:00:00 {half}" for half in ("AM", "PM") for h in (12, *range(1, 12))])
    assert (Clock(column, None, None, None).reader()(column) / 3600).tolist() == list(range(24))


@pytest.mark.parametrize(
    "text",
    """2023-02-29 00:00|2024-13-01 00:00|2024-01-00 00:00|2024-01-01 24:00|2024-01-01 00:60|31.06.2024 00:00|13:00 PM
    1/31/2024 13:00 PM|0001-01-01 00:00|2024-01-01 00:00+99:00||tomorrow|2024-01|1e999""".replace("\n    ", "|").split(
        "|"
    ),
)
def test_stamps_that_do_not_exist_are_refused(text):
    with pytest.raises(CellFault):
        column = pa.array([text, "2024-01-31 00:00"])
        Clock(column, None, None, None).reader()(column)


# Arrow reads no sign and no exponent in whole numbers; its error must not come through.
@example("+0", "epoch ns")
@example("1e5", "epoch ns")
@example("1709287200.5", "epoch ns")
@given(st.text(max_size=40), st.sampled_from([None, "day first", "seconds", "epoch ns"]))
def test_any_text_is_a_time_or_a_fault(text, form):
    column = pa.array([text])
    try:
        t = Clock(column, None, form, None).reader()(column)
    except CellFault:
        return
    assert np.isfinite(t).all()


@example([1.7e308], "epoch ms")
@example([-1e12], "epoch s")
@given(st.lists(st.floats(), min_size=1, max_size=5), st.sampled_from([None, "epoch s", "epoch ms", "epoch us"]))
def test_any_numbers_are_times_or_a_fault(values, form):
    column = pa.array(values, pa.float64())
    try:
        t = Clock(column, None, form, None).reader()(column)
    except CellFault:
        return
    assert np.isfinite(t).all()


def test_an_epoch_in_nanoseconds_keeps_every_one():
    column = pa.array([1709287200000000001, 1709287200000000002])
    assert Clock(column, None, None, None).reader()(column).tolist() == [0.0, 1e-9]


def test_an_epoch_in_nanoseconds_beyond_64_bits_is_refused():
    read = Clock(pa.array(["+1709287200000000001"]), None, None, None).reader()
    assert read(pa.array(["+1709287200000000002"])).tolist() == [1e-9]
    with pytest.raises(CellFault, match="'9999999999999999999' is not a time like those before"):
        read(pa.array(["9999999999999999999"]))


def test_time_format_must_fit():
    with pytest.raises(CellFault, match="cannot be read as 'epoch s'"):
        Clock(pa.array(["2024-01-01"]), None, "epoch s", None)
    with pytest.raises(CellFault, match="cannot be read 'day first'"):
        Clock(pa.array([1.0]), None, "day first", None)
