"""Thinning: no peak is lost, memory stays bounded, batches do not show."""

import numpy as np
import pytest

from glapp.trace import MOST_BUCKETS, Thinner


def thinned(x: np.ndarray, cuts: list[int]) -> Thinner:
    thinner = Thinner()
    for a, b in zip([0, *cuts], [*cuts, len(x)], strict=True):
        thinner.add(np.arange(a, b, dtype=float), {"x": x[a:b]})
    return thinner


def test_few_rows_stay_as_they_are() -> None:
    x = np.array([3.0, np.nan, -1.0])
    low, high = thinned(x, [1]).band("x")
    assert low == pytest.approx(x, nan_ok=True)
    assert high == pytest.approx(x, nan_ok=True)


@pytest.mark.parametrize("n", [MOST_BUCKETS, MOST_BUCKETS + 1, 3 * MOST_BUCKETS + 7, 100_003])
def test_no_peak_is_lost_and_buckets_cover_their_rows(n: int) -> None:
    x = np.random.default_rng(n).normal(size=n)
    x[n // 3], x[n // 2] = 1e6, -1e6
    thinner = thinned(x, [n // 7, n // 2])
    low, high = thinner.band("x")
    starts = [*thinner.times().astype(int), n]
    assert MOST_BUCKETS / 2 <= len(low) <= MOST_BUCKETS + 1
    assert len(starts) == len(low) + 1
    assert (low.min(), high.max()) == (x.min(), x.max())
    assert starts[0] == 0
    for i in range(0, len(low), 97):
        rows = x[starts[i] : starts[i + 1]]
        assert (low[i], high[i]) == (rows.min(), rows.max())


def test_batches_do_not_show() -> None:
    x = np.random.default_rng(1).normal(size=50_000)
    whole = thinned(x, []).band("x")
    for cuts in ([1], [9_999, 10_000, 40_000], list(range(0, 50_000, 777))[1:]):
        pieces = thinned(x, cuts).band("x")
        assert np.array_equal(pieces.low, whole.low) and np.array_equal(pieces.high, whole.high)


def test_missing_values_hide_nothing_but_themselves() -> None:
    x = np.sin(np.arange(40_000) / 100.0)
    x[::3] = np.nan
    x[12_000:20_000] = np.nan
    low, high = thinned(x, [5_000]).band("x")
    assert np.nanmax(high) == np.nanmax(x) and np.nanmin(low) == np.nanmin(x)
    assert np.isnan(low).any()
    assert np.array_equal(np.isnan(low), np.isnan(high))
