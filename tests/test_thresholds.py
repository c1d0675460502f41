"""Numbers that decide, each from just within to just beyond."""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from argon2 import PasswordHasher

from glapp.fleet.history import _settings_differ
from glapp.fleet.lake import SIGNALS
from glapp.fleet.windows import _outside, choose, look
from glapp.loop import Loop
from glapp.service.compensation import Compensator
from glapp.service.resampler import CODES, Resampler
from glapp.service.signal import Signal, Value
from glapp.service.store import Store
from glapp.service.users import Tries, Users

GIVEN = {"k": 1.0, "ti": 60.0, "h": 1.0, "op": True}


@pytest.mark.parametrize(("name", "within", "beyond"), [("k", 1.24, 1.26), ("ti", 74.0, 76.0), ("h", 1.9, 2.1)])
def test_settings_of_a_day_are_others_beyond_their_factor(name: str, within: float, beyond: float) -> None:
    assert not _settings_differ(GIVEN, GIVEN | {name: within}) and _settings_differ(GIVEN, GIVEN | {name: beyond})
    least = GIVEN[name]
    assert not _settings_differ(GIVEN, GIVEN | {name: least**2 / within}) and _settings_differ(
        GIVEN, GIVEN | {name: least**2 / beyond}
    )


def test_pv_is_outside_of_its_span_a_tenth_of_it_beyond() -> None:
    loop = Loop(name="FIC1", pv_span=(20, 70))
    assert _outside(loop, np.array([15.1, 74.9])) == 0.0
    assert _outside(loop, np.array([14.9, 75.1, 50.0, 50.0])) == 0.5


def rows_of(pv: np.ndarray, op: np.ndarray, h: float) -> pa.Table:
    """Rows of one day as a lake has them, one a `h` seconds."""
    n = len(pv)
    t = (np.arange(n) * h * 1e6).astype(np.int64)
    parts = [("pv", pv), ("op", op), ("sp", np.full(n, 50.0))]
    return pa.table(
        {
            "signal": np.repeat([SIGNALS.index(name) for name, _ in parts], n),
            "t": np.tile(t, 3),
            "value": np.concatenate([x for _, x in parts]),
            "bad": np.zeros(3 * n, bool),
        }
    )


@pytest.mark.parametrize(("share", "found"), [(0.49, False), (0.51, True)])
def test_a_day_with_half_of_pv_outside_of_its_span_is_in_another_unit(share: float, found: bool) -> None:
    random = np.random.default_rng(1)
    pv, op = 50 + random.normal(0, 1, 600), 40 + random.normal(0, 1, 600)
    pv[: int(share * 600)] += 500.0
    days = look(rows_of(pv, op, 10.0), Loop(name="FIC1", pv_span=(0, 100)), 0)
    assert (days["unfit_code"].to_pylist() == ["outside_span"]) == found


@pytest.mark.slow
def test_a_day_keeps_its_four_best_windows_of_three_thousand_rows() -> None:
    random = np.random.default_rng(1)
    op = 50 + 0.2 * np.cumsum(random.normal(size=20_000))
    pv = 50 + 0.5 * np.convolve(op - 50, np.exp(-np.arange(60) / 10) / 10)[:20_000] + 0.1 * random.normal(size=20_000)
    days = look(rows_of(pv, op, 4.0), Loop(name="FIC1"), 0)
    first, last = (days[name][0].as_py() for name in ("window_first", "window_last"))
    assert len(first) == 4
    rows = [(last - first).total_seconds() / 4.0 + 1 for first, last in zip(first, last, strict=True)]
    assert max(rows) == pytest.approx(3000, abs=1)


def test_eight_windows_of_a_history_are_fitted() -> None:
    times = list(range(0, 300, 10))
    days = pa.table({"window_first": [times], "window_last": [[t + 9 for t in times]], "window_score": [[1.0] * 30]})
    assert len(choose(days)) == 8


PV = CODES[Signal.PV]


def late(count: int) -> Resampler:
    """Rows up to 3609 s, and after them so many of a clock that goes an hour behind."""
    rows = Resampler(1.0, wait=2.0)
    for k in range(10):
        rows.take(PV, 3600.0 + k, 1.0, True, 3600.0 + k)
    rows.release()
    for k in range(count):
        rows.take(PV, 10.0 + k, 2.0, True, 3610.0 + k)
    return rows


def test_five_values_in_a_row_are_a_clock_set_back() -> None:
    assert "clock_back" not in [kind for kind, _ in late(4).events]
    assert "clock_back" in [kind for kind, _ in late(5).events]


def test_a_thousand_late_values_are_kept_at_most() -> None:
    rows = Resampler(1.0, wait=2.0)
    for k in range(10):
        rows.take(PV, 3600.0 + k, 1.0, True, 3600.0 + k)
    rows.release()
    for k in range(1200):  # a heap that came all at once is no clock set back
        rows.take(PV, 10.0 + k, 2.0, True, 3610.0)
    assert len(rows._late) == 1000


def compensator() -> Compensator:
    loop = Loop(name="FIC1", op_span=(0, 100), pv_span=(0, 100), controller={"k": 1.0, "ti": 10.0})
    return Compensator(loop, 1.0, {}, 3.0, 0.5)


def value(signal: Signal, time: float, x: float) -> Value:
    return Value("FIC1", signal, time, x, True)


def test_a_u_ff_that_stands_five_seconds_too_long_is_told() -> None:
    one = compensator()
    one.take(value(Signal.U_FF, 0.0, 0.5), 0.0)
    one._to_zero = 0.0
    longest = one.away_within + 3.0
    assert one.stuck_u_ff(longest + 4.9) is None and one.stuck_u_ff(longest + 5.1) == 0.5


def test_the_latest_twenty_values_tell_how_old_they_come() -> None:
    one = compensator()
    for k in range(30):
        one.take(value(Signal.PV, float(k), 50.0), k + 2.5)
    for k in range(30, 41):
        one.take(value(Signal.PV, float(k), 50.0), k + 0.5)
    assert one.age == 0.5, "of eleven of the latest twenty"


def test_four_fifths_of_a_width_are_compensated_where_nobody_says() -> None:
    assert compensator().setting("comp_share") == 0.8


def test_twenty_addresses_of_a_name_are_known() -> None:
    tries = Tries()
    for k in range(21):
        tries.succeeded(tries.attempt("eve", f"10.0.0.{k}", 1000.0 * k))
    assert tries.known["eve"] == [f"10.0.0.{k}" for k in range(1, 21)]


def test_a_login_lasts_for_twelve_hours(tmp_path: Path) -> None:
    store = Store(tmp_path, 0.0)
    users = Users(store, PasswordHasher(time_cost=1, memory_cost=8, parallelism=1))
    users.put("eve", "engineer", "engineer-password", 0.0)
    token, _ = users.log_in(users.attempt("eve", "10.0.0.1", 0.0), "engineer-password", 0.0)
    hours = 3600.0
    assert users.of(token, 11.9 * hours) is not None and users.of(token, 12.1 * hours) is None
    store.close()
