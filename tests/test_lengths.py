"""More rows of one loop give no worse answer; how often, and on how many loops, measures `python -m bench.lengths`."""

from functools import lru_cache

import numpy as np
import pytest
from bench.lengths import asked, lost
from bench.loads.answer import LoadsAnswer

pytestmark = pytest.mark.verify

LENGTHS = {
    "levels/PI/gap/0": (9000, 28_800, 100_000),
    "levels/PI/none/0": (9000, 28_800, 100_000),
}
"""Rows of each record: fewer than the fit takes as they are, about as many, and many more."""

every_record = pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.xdist_group(name)) for name in LENGTHS]
)


@lru_cache
def answers(name: str) -> list[LoadsAnswer]:
    return asked(name, LENGTHS[name])


@every_record
def test_widths_and_bounds_hold_the_true_width(name: str) -> None:
    assert [(a.truth.samples, str(a)) for a in answers(name) if not a.holds] == []


@every_record
def test_no_limit_is_negative(name: str) -> None:
    assert [(a.truth.samples, a.lowest) for a in answers(name) if a.lowest < 0] == []


@every_record
def test_a_right_verdict_is_not_lost(name: str) -> None:
    changes = [
        (was.truth.samples, str(was), now.truth.samples, str(now), now.reason) for was, now in lost(answers(name))
    ]
    assert changes == []


@every_record
def test_a_mere_gap_does_not_jump(name: str) -> None:
    assert [(a.truth.samples, str(a)) for a in answers(name) if a.verdict in ("stiction", "both")] == []


@pytest.mark.xdist_group("levels/PI/gap/0")
def test_a_gap_is_found_with_an_interval_that_does_not_grow_with_more_rows() -> None:
    of = answers("levels/PI/gap/0")
    assert all(a.sided for a in of)
    few, _, many = ((a.high or np.inf) - (a.low or 0.0) for a in of)
    # Each limit is found to within a thousandth of OP's range.
    assert many <= 1.1 * few + 0.002 * of[0].truth.op_range


@pytest.mark.parametrize(
    ("name", "rows", "message"),
    [
        # 0.4 units for each passage of OP, 27 in all: a gap of 1.96 % was claimed.
        ("steps/PID/none/0", 20_160, "cannot_tell"),
        # OP moves by 0.25 % from sample to sample; the valve was called sound below 0.49 % with a gap of 0.73 %.
        ("steps/PID/gap/2", 28_800, "sound"),
        # Six windows, none of which shows a gap alone, made one of 0.023 % together.
        ("setpoint/PI/none/0", 86_400, "sound"),
    ],
)
def test_what_a_model_lacks_adds_up_to_no_gap(name: str, rows: int, message: str) -> None:
    (answer,) = asked(name, [rows])
    assert (answer.verdict, answer.holds) == (message, True), answer.reason
