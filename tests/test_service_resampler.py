"""Signals at their own times become samples: in order, once, and whatever comes late, twice or out of the future."""

import json
import math
import random

import pytest

from glapp.service.resampler import ALIVE, CODES, LOST, Resampler, Sample
from glapp.service.signal import Signal

SP, PV, OP, MODE, LOW, HIGH = (CODES[Signal(name)] for name in ("sp", "pv", "op", "mode", "low", "high"))

Given = tuple[int, float, float]


def stream(seconds: int = 60) -> list[Given]:
    found: list[Given] = [(SP, 0.0, 50.0), (MODE, 0.0, 1.0)]
    for k in range(seconds):
        found += [(OP, k + 0.01, 40.0 + k % 7), (PV, float(k), 49.0 + k % 5)]
        if k % 13 == 12:
            found.append((SP, k + 0.5, 50.0 + k))
    return sorted(found, key=lambda value: value[1])


def run(given: list[Given], *, batch: int = 1, rows: Resampler | None = None, late: float = 0.0) -> list[Sample]:
    rows = rows or Resampler(1.0, wait=3.0)
    out: list[Sample] = []
    for at in range(0, len(given), batch):
        for signal, time, value in given[at : at + batch]:
            rows.take(signal, time, value, True, time + late)
        out += rows.release()
    return out


def kinds(rows: Resampler) -> list[str]:
    return [kind for kind, _ in rows.events]


def test_a_value_of_pv_is_a_sample_with_what_the_others_last_were() -> None:
    out = run(stream(20))
    assert [sample.t for sample in out] == [float(k) for k in range(17)]
    assert [sample.sp for sample in out] == [50.0] * 13 + [62.0] * 4
    assert math.isnan(out[0].op) and out[1].op == 40.0 and out[5].op == 44.0
    assert {sample.flags for sample in out} == {0}


@pytest.mark.parametrize("batch", [1, 3, 10, 1000])
@pytest.mark.parametrize("seed", range(4))
def test_the_same_samples_however_they_come(batch: int, seed: int) -> None:
    """Values come in batches of any size, out of order within the wait, and some of them twice."""
    straight = run(stream(), batch=1)
    chance = random.Random(seed)
    moved = sorted(stream(), key=lambda value: value[1] + chance.uniform(0.0, 2.9))
    twice = [value for one in moved for value in [one] * chance.choice([1, 1, 2])]
    rows = Resampler(1.0, wait=3.0)
    out = run(twice, batch=batch, rows=rows)
    assert out == pytest.approx(straight[: len(out)], nan_ok=True) and len(out) > 50
    assert [tuple(map(repr, a)) for a in out] == [tuple(map(repr, b)) for b in straight[: len(out)]]
    assert rows.dropped == len(twice) - len(moved) and not rows.events


@pytest.mark.parametrize(
    "told_first", [[], [(ALIVE, 19.0, 0.0)], [(SP, 22.0, 51.0)], [(ALIVE, 19.0, 0.0), (SP, 22.0, 51.0)]]
)
def test_what_a_loss_is_followed_by_fills_no_break(told_first: list[Given]) -> None:
    """A later value does not show that all was well until the last one, or that SP was moved in the break: PV was held
    to have stood still.
    """
    rows = Resampler(1.0, wait=2.0, lost=15.0)
    out = run([(SP, 0.0, 50.0), *((PV, float(k), 49.0 + k % 5) for k in range(20))], rows=rows)
    out += run([(LOST, 27.5, 0.0), *told_first, *((PV, float(k), 49.0) for k in range(28, 40))], rows=rows)
    assert [sample.t for sample in out] == [*map(float, range(20)), *map(float, range(28, 38))]


def test_after_a_loss_a_still_pv_is_known_from_its_own_first_value_on() -> None:
    rows = Resampler(1.0, wait=2.0, lost=15.0)
    out = run([(SP, 0.0, 50.0), *((PV, float(k), 49.0) for k in range(10))], rows=rows)
    out += run([(LOST, 27.5, 0.0), (PV, 20.0, 49.5), (SP, 24.0, 51.0), (ALIVE, 30.0, 0.0)], rows=rows)
    assert [sample.t for sample in out] == [*map(float, range(10)), *map(float, range(20, 28))]


def test_saved_and_loaded_at_any_moment() -> None:
    straight = run(stream(), batch=1)
    rows, out = Resampler(1.0, wait=3.0), []
    for value in stream():
        out += run([value], rows=rows)
        rows = Resampler.load(json.loads(json.dumps(rows.save())), 1.0, wait=3.0)
    assert [tuple(map(repr, a)) for a in out] == [tuple(map(repr, b)) for b in straight]


def test_what_is_too_late_is_dropped_and_told() -> None:
    rows = Resampler(1.0, wait=3.0)
    run([(SP, 0.0, 50.0), *((PV, float(k), 1.0) for k in range(20))], rows=rows)
    rows.take(PV, 10.4, 99.0, True, 20.0)
    assert kinds(rows) == ["late"] and "5.6 s late: dropped" in rows.events[0][1]
    assert all(sample.pv == 1.0 for sample in run([(PV, 20.0 + k, 1.0) for k in range(5)], rows=rows))


def test_a_setpoint_that_comes_late_is_in_effect_from_then_on() -> None:
    """A setpoint is sent once, when it changes: dropped, it would be wrong until it changes again."""
    rows = Resampler(1.0, wait=3.0)
    run([(SP, 0.0, 50.0), *((PV, float(k), 1.0) for k in range(20))], rows=rows)
    rows.take(SP, 10.0, 60.0, True, 20.0)
    rows.take(SP, 9.0, 55.0, True, 20.0)
    assert kinds(rows) == ["late", "late"] and "dropped" in rows.events[1][1]
    rows.take(SP, 11.0, 60.0, True, 20.0)  # as u_FF comes at each start: with the time of its last change
    assert len(kinds(rows)) == 2, "nothing changes by it"
    assert {sample.sp for sample in run([(PV, 20.0 + k, 1.0) for k in range(5)], rows=rows)} == {60.0}


def test_two_values_of_one_time() -> None:
    rows = Resampler(1.0, wait=0.0)
    for value in (1.0, 2.0, 1.0):
        rows.take(PV, 5.0, value, True, 5.0)
    assert kinds(rows) == ["duplicate"] and rows.dropped == 2
    assert [sample.pv for sample in rows.release()] == [1.0]
    rows.take(PV, 5.0, 1.0, True, 5.0)
    rows.take(PV, 5.0, 3.0, True, 5.0)
    assert kinds(rows) == ["duplicate"] * 2 and rows.release() == []


@pytest.mark.parametrize("ahead", [61.0, 1e9, math.inf, math.nan])
def test_a_time_in_the_future_is_a_bad_value_of_now(ahead: float) -> None:
    rows = Resampler(1.0, wait=0.0)
    out = run([(SP, 0.0, 50.0), (PV, 0.0, 49.0), (PV, 1.0, 49.0)], rows=rows, batch=2)
    rows.take(PV, 2.0 + ahead, 49.0, True, 2.0)
    out += rows.release()
    out += run([(PV, 3.0, 49.0)], rows=rows)
    assert [(sample.t, sample.flags) for sample in out] == [(0.0, 0), (1.0, 0), (2.0, 2), (3.0, 0)]
    assert kinds(rows) == ["future"]


def test_a_clock_that_is_a_little_fast_is_believed() -> None:
    rows = Resampler(1.0, wait=0.0)
    assert len(run([(PV, float(k), 1.0) for k in range(5)], rows=rows, late=-59.0)) == 5 and not rows.events


def test_a_clock_set_back_is_a_gap_and_no_value_is_lost() -> None:
    rows = Resampler(1.0, wait=2.0)
    before = run([(SP, 3600.0, 50.0), *((PV, 3600.0 + k, 1.0) for k in range(10))], rows=rows)
    after = []
    for k in range(20):
        rows.take(PV, 10.0 + k, 2.0, True, 3610.0 + k)
        after += rows.release()
    assert kinds(rows).count("clock_back") == 1 and "3597 s" in dict(rows.events)["clock_back"]
    assert [sample.t for sample in before] == [3600.0 + k for k in range(8)]
    assert [sample.t for sample in after] == [10.0 + k for k in range(18)]
    assert {sample.sp for sample in after} == {50.0} and rows.dropped == 0


def test_a_heap_of_late_values_is_no_clock_set_back() -> None:
    rows = Resampler(1.0, wait=2.0)
    run([(PV, 3600.0 + k, 1.0) for k in range(10)], rows=rows)
    for k in range(50):
        rows.take(PV, 3000.0 + k, 2.0, True, 3610.0 + k * 0.001)
    assert set(kinds(rows)) == {"late"} and rows.dropped == 50
    assert [sample.t for sample in run([(PV, 3610.0, 1.0)], rows=rows)] == [3608.0]


def test_a_still_pv_is_sampled_as_long_as_the_connection_lives_and_a_lost_one_is_not() -> None:
    rows = Resampler(1.0, wait=1.0)
    out = run([(SP, 0.0, 50.0), (PV, 0.0, 49.0)], rows=rows)
    for k in range(1, 11):
        rows.take(ALIVE, k + 0.3, 0.0, True, k + 0.3)
        out += rows.release()
    assert [(sample.t, sample.pv) for sample in out] == [(float(k), 49.0) for k in range(9)]
    # No value comes for an hour, then the same one once more, with the time at which it last changed.
    rows.take(PV, 0.0, 49.0, True, 3610.0)
    for k in range(5):
        rows.take(ALIVE, 3610.0 + k, 0.0, True, 3610.0 + k)
    assert [sample.t for sample in rows.release()] == [3610.0, 3611.0, 3612.0], "none between: a gap"


def test_between_a_loss_and_the_next_value_there_is_no_sample() -> None:
    rows = Resampler(1.0, wait=0.0)
    out = run([(PV, float(k), 49.0) for k in range(5)], rows=rows)
    rows.take(LOST, 4.5, 0.0, True, 4.5)
    out += run([(PV, 12.0, 49.0), (PV, 15.0, 49.0)], rows=rows)
    assert [sample.t for sample in out] == [0.0, 1.0, 2.0, 3.0, 4.0, 12.0, 13.0, 14.0, 15.0]


def test_signs_of_life_change_no_sample_where_values_come() -> None:
    straight = run(stream())
    rows, out = Resampler(1.0, wait=3.0), []
    for value in stream():
        out += run([value], rows=rows)
        rows.take(ALIVE, value[1] + 0.2, 0.0, True, value[1] + 0.2)
    assert [tuple(map(repr, a)) for a in out] == [tuple(map(repr, b)) for b in straight[: len(out)]]


def test_bad_values_and_flags() -> None:
    rows = Resampler(1.0, wait=0.0)
    rows.take(SP, 0.0, 50.0, True, 0.0)
    given = [(LOW, 1.0), (HIGH, 1.0), (MODE, 0.0), (MODE, math.nan), (LOW, 0.0), (HIGH, 0.0), (MODE, 1.0)]
    flags = []
    for k, (signal, value) in enumerate(given):
        rows.take(signal, float(k), value, True, float(k))
        rows.take(PV, float(k), 49.0, True, float(k))
        flags += [sample.flags for sample in rows.release()]
    assert flags == [4, 12, 13, 14, 10, 2, 0]
    rows.take(PV, 7.0, math.nan, False, 7.0)
    rows.take(PV, 8.0, math.inf, True, 8.0)
    assert [(sample.flags, math.isnan(sample.pv)) for sample in rows.release()] == [(2, True), (2, True)]
