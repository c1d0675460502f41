"""Stamps against Python's own calendar, and the faults of a time column."""

from datetime import UTC, datetime, timedelta
from pathlib import Path
from zoneinfo import ZoneInfo

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from glapp.errors import InputError
from glapp.reading import open_recordings
from glapp.reading.cells import CellFault
from glapp.reading.times import Clock
from glapp.recording import joined

moments = st.lists(st.datetimes(datetime(1970, 1, 1), datetime(2200, 1, 1)), min_size=1, max_size=20)


@given(
    moments,
    st.sampled_from(["%Y-%m-%d %H:%M:%S.%f", "%Y/%m/%d %H:%M:%S,%f", "%d.%m.%Y %H:%M:%S.%f", "%b %d, %Y %H:%M:%S.%f"]),
)
@pytest.mark.slow
def test_layouts_agree_with_the_calendar(times, form):
    column = pa.array([t.strftime(form) for t in times])
    clock = Clock(column, None, None, None)
    got = clock.reader()(column)
    want = np.array([(t - times[0]) // timedelta(microseconds=1) for t in times]) / 1e6
    np.testing.assert_allclose(got, want, rtol=1e-15, atol=0)
    assert clock.t0 == times[0]


@given(moments, st.sampled_from(["s", "ms", "us", "ns"]), st.sampled_from([None, "UTC", "Europe/Stockholm"]))
@pytest.mark.slow
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


DAYS = {"excel": 25569.0, "matlab": 719529.0, "julian": 2440587.5}  # 1970-01-01
DATE = datetime(2026, 3, 1, 12, 30)


def day_numbers(calendar, step):
    start = (DATE - datetime(1970, 1, 1)).total_seconds()
    return DAYS[calendar] + (start + step * np.arange(20)) / 86400


def clock_of(values, **more):
    column = pa.array(values)
    clock = Clock(column, None, more.pop("time_format", None), more.pop("time_zone", None), **more)
    return clock, clock.reader()(column)


@pytest.mark.parametrize("calendar", list(DAYS))
@pytest.mark.parametrize("step", [0.1, 1, 5, 60, 300, 600, 900, 3600])
@pytest.mark.parametrize("text", [False, True])
def test_day_numbers_are_dates(calendar, step, text):
    """All but fast spreadsheets were read as seconds, in silence: a minute of samples took 0.0007 s."""
    values = day_numbers(calendar, step)
    clock, t = clock_of([f"{x:.10f}".replace(".", "," if step == 1 else ".") for x in values] if text else values)
    assert (clock.t0, clock.zone) == (DATE, None)
    np.testing.assert_allclose(t, step * np.arange(20), atol=1e-3)
    [found] = clock.found
    assert (found.code, found.severity, found.evidence["read_as"]) == ("time_assumed", "info", calendar)
    assert "column 'time' begins at " in found.text and "2026-03-01 12:30:00" in found.text
    assert "time_format = 'seconds'" in found.text


def test_a_spreadsheet_of_few_digits_keeps_its_minutes():
    clock, t = clock_of([f"{x:.5f}" for x in day_numbers("excel", 60)])
    assert abs(clock.t0 - DATE) < timedelta(seconds=1)
    np.testing.assert_allclose(np.diff(t), 60, atol=1)


def test_day_numbers_are_local_times_where_a_zone_is_given():
    clock, t = clock_of(day_numbers("excel", 60), time_zone="Europe/Stockholm")
    assert clock.t0.isoformat() == "2026-03-01T12:30:00+01:00"
    assert t[-1] == 19 * 60


@pytest.mark.parametrize(
    ("start", "step", "name"),
    [(45000.0, 1.0, "t"), (45000.0, 0.1, "t"), (730000.0, 10.0, "time"), (2.45e6, 60.0, "t"), (0.0, 0.001, "t")],
)
def test_seconds_in_the_range_of_day_numbers_stay_seconds(start, step, name):
    clock, t = clock_of(start + step * np.arange(50), name=name)
    np.testing.assert_array_equal(t, start + step * np.arange(50))
    assert (clock.found, clock.t0) == ([], None)


@pytest.mark.parametrize(("step", "name"), [(0.04, "t"), (0.01, "time"), (1.0, "Date"), (0.0, "t")])
def test_a_number_that_may_be_a_day_is_read_as_seconds_with_a_finding(step, name):
    clock, t = clock_of(45000.5 + step * np.arange(20), name=name)
    assert t[0] == 45000.5
    [found] = clock.found
    assert (found.severity, found.evidence["read_as"], found.evidence["first"]) == ("warning", "seconds", "45000.5")
    assert f"column '{name}' begins at 45000.5" in found.text
    assert "2023-03-15 12:00:00, write time_format = 'excel'" in found.text


def test_a_name_or_a_unit_settles_it():
    assert clock_of(45000 + 0.04 * np.arange(9), name="Timestamp")[0].t0 == datetime(2023, 3, 15)
    assert clock_of(45000 + np.arange(9.0), unit="days")[0].t0 == datetime(2023, 3, 15)
    clock, t = clock_of(45000 + 0.001 * np.arange(9), unit="s")
    assert (clock.t0, clock.found, t[0]) == (None, [], 45000)


@pytest.mark.parametrize(
    ("form", "unit", "seconds"),
    [
        ("milliseconds", "ms", 1e-3),
        ("seconds", "s", 1),
        ("minutes", "min", 60),
        ("hours", "h", 3600),
        ("days", "d", 86400),
    ],
)
def test_numbers_in_other_units(form, unit, seconds):
    """A column headed 't [min]' was read as seconds."""
    want = seconds * np.arange(9.0)
    np.testing.assert_array_equal(clock_of(np.arange(9.0), time_format=form)[1], want)
    clock, t = clock_of(np.arange(9.0), unit=unit)
    np.testing.assert_array_equal(t, want)
    assert clock.t0 is None


@pytest.mark.parametrize("form", list(DAYS))
def test_a_calendar_that_is_named_is_taken_whatever_the_step(form):
    clock, t = clock_of(day_numbers(form, 86400.0), time_format=form)
    assert clock.t0 == DATE
    np.testing.assert_allclose(t, 86400.0 * np.arange(20))
    with pytest.raises(CellFault, match="outside the range"):
        clock_of([1e9, 1e9 + 1], time_format=form)
    assert clock_of(day_numbers(form, 60), time_format="seconds")[0].t0 is None


@pytest.mark.parametrize(
    "values", [[20260301123000, 20260301123001], [6.387e17, 6.387e17 + 1e7], [1.34e17, 1.34e17 + 1e7]]
)
def test_numbers_too_large_for_seconds_are_refused(values):
    with pytest.raises(CellFault, match="too large for seconds") as caught:
        clock_of(np.array(values, float))
    assert "time_format" in caught.value.hint


STOCKHOLM = ZoneInfo("Europe/Stockholm")
AUTUMN = [
    (datetime(2024, 10, 26, 22, tzinfo=UTC) + timedelta(minutes=k)).astimezone(STOCKHOLM).strftime("%Y-%m-%d %H:%M")
    for k in range(600)
]
"""A night in which an hour is there twice."""
FORMS_FROM_LAST = {
    "stamps": [f"2024-01-31 10:{k // 60:02d}:{k % 60:02d}" for k in range(600)],
    "day and month": [f"13/02/2024 10:{k // 60:02d}:{k % 60:02d}" for k in range(600)],
    "numbers": [str(k) for k in range(600)],
    "epoch": [str(1_700_000_000_000 + 500 * k) for k in range(600)],
    "autumn": AUTUMN,
}


@pytest.mark.parametrize("form", FORMS_FROM_LAST)
def test_a_table_whose_newest_row_comes_first_is_read_from_its_last(tmp_path: Path, form: str) -> None:
    """Many historians export so; such a file was refused."""
    body = [f"{stamp},50,{k % 7},{40 + k % 5}" for k, stamp in enumerate(FORMS_FROM_LAST[form])]
    settings = {"time_zone": "Europe/Stockholm"} if form == "autumn" else {}
    up, down = tmp_path / "up.csv", tmp_path / "down.csv"
    up.write_text("\n".join(["t,SP,PV,OP", *body]))
    down.write_text("\n".join(["t,SP,PV,OP", *reversed(body), ",,,"]))
    [ours], [theirs] = (open_recordings(path, defaults=settings) for path in (down, up))
    one, other = (joined(list(recording.batches(rows=100))) for recording in (ours, theirs))
    for column in ("t", "sp", "pv", "op"):
        np.testing.assert_array_equal(getattr(one, column), getattr(other, column))
    assert ours.t0 == theirs.t0 and [finding.code for finding in ours.found] == ["newest_first"]
    body[100] = body[100].rsplit(",", 1)[0] + ",abc"
    down.write_text("\n".join(["t,SP,PV,OP", *reversed(body)]))
    [wrong] = open_recordings(down, defaults=settings)
    with pytest.raises(InputError, match="row 501, column OP: 'abc' is not a number"):
        list(wrong.batches())


def test_a_table_of_which_some_rows_rise_is_left_as_it_is(tmp_path: Path) -> None:
    order = [*range(50, 0, -1), *range(60, 50, -1)]
    (tmp_path / "mixed.csv").write_text("\n".join(["t,SP,PV,OP", *(f"{k},50,{k % 7},40" for k in order)]))
    [recording] = open_recordings(tmp_path / "mixed.csv")
    assert joined(list(recording.batches())).t.tolist() == order and not recording.found


@pytest.mark.parametrize("order", ["row by row", "tag by tag"])
def test_tags_whose_newest_rows_come_first_are_read_from_the_last(tmp_path: Path, order: str) -> None:
    body = [f"{k},F1.{tag},{(k + i) % 7}" for k in range(90) for i, tag in enumerate(("SP", "PV", "OP"))]
    up, down = tmp_path / "up.csv", tmp_path / "down.csv"
    up.write_text("\n".join(["time,tag,value", *body]))
    turned = body[::-1] if order == "row by row" else sorted(body[::-1], key=lambda row: row.split(",")[1])
    down.write_text("\n".join(["time,tag,value", *turned]))
    [ours], [theirs] = (open_recordings(path) for path in (down, up))
    one, other = (joined(list(recording.batches())) for recording in (ours, theirs))
    for column in ("t", "sp", "pv", "op"):
        np.testing.assert_array_equal(getattr(one, column), getattr(other, column))
    assert [finding.code for finding in ours.found] == ["newest_first"]


def test_an_hour_that_autumn_repeats_is_repeated_for_each_tag(tmp_path: Path) -> None:
    """Tag by tag, the second run of one tag went on in the next tag, whose first run was read an hour late."""
    signals = [(signal, stamp, k) for signal in ("SP", "PV", "OP") for k, stamp in enumerate(AUTUMN[150:210])]
    read = []
    for key in (None, lambda row: row[2]):
        body = [f"{stamp},F1.{signal},{k % 7}" for signal, stamp, k in (sorted(signals, key=key) if key else signals)]
        path = tmp_path / "long.csv"
        path.write_text("\n".join(["time,tag,value", *body]))
        [recording] = open_recordings(path, defaults={"time_zone": "Europe/Stockholm"})
        read.append(joined(list(recording.batches())))
    tag_by_tag, row_by_row = read
    assert (np.diff(tag_by_tag.t) > 0).all()
    for column in ("t", "sp", "pv", "op"):
        np.testing.assert_array_equal(getattr(tag_by_tag, column), getattr(row_by_row, column))
