"""Is there a regular oscillation, and how long is its period? Asked first by methods that are about one.

Source: Thornhill, Huang and Zhang, *Detection of multiple oscillations in control loops*, J. Process Control 13 (2003):
zero crossings of the autocorrelation, which noise disturbs far less than those of the signal. With ΔT the times between
them, period 2·mean(ΔT) and regularity r = mean(ΔT)/(3·std(ΔT)); regular where r > 1.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

CROSSINGS = 11
"""Number of zero crossings of the autocorrelation that are used, that is ten half-periods, as in the paper."""

FEWEST = 5
"""Fewer of them tell nothing of regularity."""


class Oscillation(NamedTuple):
    """Period [samples] and regularity r."""

    period: float
    regularity: float


def regular(signal: Floats) -> bool:
    """Whether the signal oscillates, and regularly."""
    found = oscillation(signal)
    return found is not None and found.regularity > 1


def oscillation(signal: Floats) -> Oscillation | None:
    """The oscillation of a signal, regular or not; None where its autocorrelation crosses zero too seldom."""
    crossings = np.array(zero_crossings(correlation(signal, signal)[len(signal) - 1 :])[:CROSSINGS])
    if crossings.size < FEWEST:
        return None
    between = np.diff(crossings)
    scatter = float(between.std(ddof=1))
    middle = float(between.mean())
    return Oscillation(2 * middle, middle / (3 * scatter) if scatter > 0 else np.inf)


def correlation(x: Floats, y: Floats) -> Floats:
    """Correlation of x(t) with y(t + lag) for the lags −(n − 1)..n − 1, with 1/n for every lag (biased, and calm)."""
    n = len(x)
    x, y = x - x.mean(), y - y.mean()
    size = 1 << (2 * n - 1).bit_length()
    product = np.fft.irfft(np.conj(np.fft.rfft(x, size)) * np.fft.rfft(y, size), size)
    scale = n * x.std() * y.std()
    both = np.concatenate([product[-(n - 1) :], product[:n]])
    return both / scale if scale > 0 else np.zeros_like(both)


def zero_crossings(signal: Floats) -> list[float]:
    """Places of a signal's sign changes, on the straight line between two samples [samples]."""
    sign = np.signbit(signal)
    i = np.flatnonzero(sign[1:] != sign[:-1])
    return [float(x) for x in i + signal[i] / (signal[i] - signal[i + 1])]


def band_pass(signal: Floats, period: float, low: float = 0.5, high: float = 1.5) -> Floats:
    """Part of a signal between `low` and `high` times the frequency of a period [samples]."""
    spectrum = np.fft.rfft(signal - signal.mean())
    frequency = np.fft.rfftfreq(len(signal))
    spectrum[(frequency < low / period) | (frequency > high / period)] = 0
    return np.fft.irfft(spectrum, len(signal))
