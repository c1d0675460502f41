"""The process under control as a value: a transfer function with exact dead time.

The one notion of a process in glapp: what the rules tune for, what the describing functions look at, and what a
scenario simulates. No part of it approximates the dead time.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from . import _glapp
from .checked import check_number, numbers_of
from .errors import InputError
from .palette import FONT, INK, SIGNAL

if TYPE_CHECKING:
    import plotly.graph_objects as go

__all__ = ["PLANTS", "Bode", "Plant", "Step"]

_KEYS = "known keys: num, den, dead_time"

_LINE = {"color": SIGNAL, "width": 2}
_LOOK: dict[str, Any] = {"template": "plotly_white", "font": {"family": FONT, "color": INK}}

_QUIET = 0.02
"""A loop gain below this no longer matters for stability or robustness."""


class Step(NamedTuple):
    """A step response.

    Attributes
    ----------
    t : float64[n]
        Time [s].
    y : float64[n]
        Response [output per input].
    """

    t: npt.NDArray[np.float64]
    y: npt.NDArray[np.float64]

    def plot(self) -> go.Figure:
        """A zoomable figure."""
        import plotly.graph_objects as go

        figure = go.Figure(go.Scatter(x=self.t, y=self.y, line=_LINE))
        return figure.update_layout(**_LOOK, xaxis_title="time [s]", yaxis_title="PV [per step of OP]", height=300)

    def _repr_mimebundle_(self, include: Any = None, exclude: Any = None) -> Any:
        return self.plot()._repr_mimebundle_(include, exclude)


class Bode(NamedTuple):
    """A frequency response.

    Attributes
    ----------
    w : float64[n]
        Frequency [rad/s].
    magnitude : float64[n]
        |P(jω)|.
    phase : float64[n]
        Its angle [°].
    """

    w: npt.NDArray[np.float64]
    magnitude: npt.NDArray[np.float64]
    phase: npt.NDArray[np.float64]

    def plot(self) -> go.Figure:
        """A zoomable figure."""
        from plotly.subplots import make_subplots

        figure = make_subplots(rows=2, shared_xaxes=True, vertical_spacing=0.06)
        figure.add_scatter(x=self.w, y=self.magnitude, row=1, col=1, line=_LINE, showlegend=False)
        figure.add_scatter(x=self.w, y=self.phase, row=2, col=1, line=_LINE, showlegend=False)
        figure.update_xaxes(type="log").update_xaxes(title="ω [rad/s]", row=2)
        figure.update_yaxes(type="log", title="magnitude", row=1).update_yaxes(title="phase [°]", row=2)
        return figure.update_layout(**_LOOK, height=420)

    def _repr_mimebundle_(self, include: Any = None, exclude: Any = None) -> Any:
        return self.plot()._repr_mimebundle_(include, exclude)


@dataclass(frozen=True, slots=True)
class Plant:
    """Transfer function num(s)/den(s)·e^(−L·s).

    Unpacks into its three parts, multiplies into a series, and is made from anything that means a process by
    `Plant.of`.

    Parameters
    ----------
    num, den : sequence of float
        Coefficients in descending powers of s. num of at most the degree of den (proper), neither of them all zero.
        Kept without zeros in front.
    dead_time : float
        Dead time L [s], ≥ 0, exact.

    Raises
    ------
    InputError
        For coefficients that are not finite numbers, an improper transfer function, a dead time below 0.

    Examples
    --------
    >>> tank = Plant([2], [10, 1, 0], 0.5)
    >>> tank.integrators, tank.gain, tank.velocity_gain
    (1, None, 2.0)
    >>> PLANTS["P2"].gain, PLANTS["P2"].order
    (1.0, 4)
    >>> valve = Plant([1], [0.5, 1])
    >>> num, den, dead_time = valve * tank
    >>> den, dead_time
    ((5.0, 10.5, 1.0, 0.0), 0.5)
    >>> Plant([1, 0, 0], [1, 1])
    Traceback (most recent call last):
    glapp.errors.InputError: num: is of degree 2, must be of the degree of den (1) or lower
    """

    num: tuple[float, ...]
    den: tuple[float, ...]
    dead_time: float = 0.0

    def __init__(self, num: Sequence[float], den: Sequence[float], dead_time: float = 0.0) -> None:
        top, bottom = _coefficients("num", num), _coefficients("den", den)
        if len(top) > len(bottom):
            bound = f"of the degree of den ({len(bottom) - 1}) or lower"
            raise InputError(
                f"is of degree {len(top) - 1}, must be {bound}", parameter="num", value=tuple(num), bound=bound
            )
        dead_time = check_number(dead_time, "dead_time", lambda x: x >= 0, "0 s or greater")
        object.__setattr__(self, "num", top)
        object.__setattr__(self, "den", bottom)
        object.__setattr__(self, "dead_time", dead_time)

    @classmethod
    def of(cls, process: Any) -> Plant:
        """Make a plant of anything that means one.

        Parameters
        ----------
        process : Plant, str, (num, den), (num, den, dead_time), mapping, list of these, model, or transfer function
            A name of the test batch, "P1" to "P8"; coefficients; a mapping with the keys num, den and dead_time, as
            TOML has it; a list of names, mappings and plants, which is their series; a model whose `plant` is one, as
            `glapp.tuning.Fotd`; or any linear system of python-control or `scipy.signal` with one input and one output
            in continuous time: a transfer function, a state space, zeros, poles and gain (these have no dead time:
            write ``Plant.of(tf).delayed(L)``).

        Raises
        ------
        InputError
            For anything else, and for what `Plant` refuses.

        Examples
        --------
        >>> Plant.of("P4")
        Plant(num=(1.0,), den=(2.0, 1.0), dead_time=4.0)
        >>> from scipy.signal import TransferFunction
        >>> Plant.of(TransferFunction([1], [1, 2])).delayed(4)
        Plant(num=(1.0,), den=(1.0, 2.0), dead_time=4.0)
        >>> from scipy.signal import StateSpace
        >>> Plant.of(StateSpace([[-2.0]], [[1.0]], [[3.0]], [[0.0]]))
        Plant(num=(3.0,), den=(1.0, 2.0), dead_time=0.0)
        >>> Plant.of(["P4", {"num": [3], "den": [1, 0]}])
        Plant(num=(3.0,), den=(2.0, 1.0, 0.0), dead_time=4.0)
        >>> Plant.of("P9")
        Traceback (most recent call last):
        glapp.errors.InputError: plant: is 'P9'; write P1, P2, P3, P4, P5, P6, P7, P8 or (num, den, dead_time)
        """
        if isinstance(process, cls):
            return process
        if isinstance(model := getattr(process, "plant", None), cls):
            return model
        if isinstance(process, str) and process in PLANTS:
            return PLANTS[process]
        if isinstance(process, Mapping):
            return cls._of_table(process)
        if isinstance(process, list) and process and all(isinstance(part, str | Mapping | cls) for part in process):
            return math.prod((cls.of(part) for part in process), start=cls([1], [1]))
        if (rational := _rational(process)) is not None:
            if getattr(process, "dt", None) not in (None, 0):
                raise InputError(
                    "is sampled, must be continuous in time", parameter="plant", value=process, bound="continuous"
                )
            return cls(*rational, float(getattr(process, "dead_time", 0.0)))
        if not isinstance(process, str):
            try:
                num, den, *rest = process
                if len(rest) <= 1:
                    return cls(num, den, *rest)
            except InputError:
                raise
            except (TypeError, ValueError):
                pass
        hint = f"write {', '.join(PLANTS)} or (num, den, dead_time)"
        raise InputError(f"is {process!r}", parameter="plant", value=process, hint=hint)

    @classmethod
    def _of_table(cls, table: Mapping[str, Any]) -> Plant:
        """A plant from a table of a settings file."""
        unknown = sorted(set(table) - {"num", "den", "dead_time"})
        if unknown:
            raise InputError("no such key", parameter=unknown[0], value=table[unknown[0]], hint=_KEYS)
        for name in ("num", "den"):
            if name not in table:
                raise InputError("is required", parameter=name, bound="required", hint=_KEYS)
        return cls(**table)

    def __iter__(self) -> Iterator[Any]:
        """num, den, dead_time."""
        yield from (self.num, self.den, self.dead_time)

    def __mul__(self, other: Plant | float) -> Plant:
        """Series connection, or a gain."""
        if isinstance(other, Plant):
            num, den = np.polymul(self.num, other.num), np.polymul(self.den, other.den)
            return Plant(num.tolist(), den.tolist(), self.dead_time + other.dead_time)
        gain = check_number(other, "gain", lambda x: x != 0, "a number other than 0, or a Plant")
        return Plant([gain * b for b in self.num], self.den, self.dead_time)

    __rmul__ = __mul__

    def delayed(self, dead_time: float) -> Plant:
        """The process with `dead_time` ≥ 0 [s] more."""
        return self * Plant([1], [1], dead_time)

    @property
    def order(self) -> int:
        """Number of poles."""
        return len(self.den) - 1

    @property
    def integrators(self) -> int:
        """Number of poles at 0 that no zero cancels; negative for zeros there."""
        return _zeros_at_end(self.den) - _zeros_at_end(self.num)

    @property
    def gain(self) -> float | None:
        """Static gain Kp [process value per output]; None for an integrating process."""
        if self.integrators > 0:
            return None
        return self._lowest() if self.integrators == 0 else 0.0

    @property
    def velocity_gain(self) -> float | None:
        """Kv, slope of the response to a unit step [process value per output and s]; None unless one integrator."""
        return self._lowest() if self.integrators == 1 else None

    @property
    def sign(self) -> float:
        """Sign of the response to slow input, ±1: that of Kp, of an integrating process that of Kv."""
        return math.copysign(1.0, self._lowest())

    def _lowest(self) -> float:
        """Ratio of the lowest coefficients that are not 0."""
        top, bottom = (c[: len(c) - _zeros_at_end(c)] for c in (self.num, self.den))
        return top[-1] / bottom[-1]

    @property
    def poles(self) -> npt.NDArray[np.complex128]:
        """Poles [1/s], those at 0 exactly there."""
        return _roots(self.den)

    @property
    def zeros(self) -> npt.NDArray[np.complex128]:
        """Zeros [1/s]."""
        return _roots(self.num)

    @property
    def is_stable(self) -> bool:
        """Whether all poles lie in the left half plane, but for one integrator at most."""
        inside = self.poles.real[self.poles != 0]
        # Multiple poles are found to about eps^(1/n): a pole that near to the axis counts by the side of its rounding.
        return self.integrators <= 1 and bool(np.all(inside < 0))

    def at(self, s: npt.ArrayLike) -> npt.NDArray[np.complex128]:
        """P(s) at complex s [1/s], any shape."""
        s = numbers_of(s, "s", dtype=np.complex128)
        with np.errstate(divide="ignore", invalid="ignore"):
            value = np.polyval(self.num, s) / np.polyval(self.den, s)
        return np.asarray(value * np.exp(-self.dead_time * s) if self.dead_time else value, dtype=np.complex128)

    def response(self, w: npt.ArrayLike) -> npt.NDArray[np.complex128]:
        """Frequency response P(iω).

        Parameters
        ----------
        w : array_like of float
            Frequencies ω [rad/s], any shape.

        Examples
        --------
        >>> complex(np.round(PLANTS["P2"].response(1.0), 12))
        (-0.25-0j)
        """
        return self.at(1j * numbers_of(w, "w"))

    def frequencies(self, per_decade: int = 60) -> npt.NDArray[np.float64]:
        """Frequencies [rad/s], ascending, on which nothing of P(iω) is missed.

        Logarithmic from far below the slowest corner to far above the fastest; denser where a pole near the axis makes
        a resonance, and where dead time turns the curve while it is still large (against its value at the corners).

        Parameters
        ----------
        per_decade : int
            Frequencies in each decade, 1..10⁶.
        """
        check_number(per_decade, "per_decade", lambda x: 1 <= x <= 1e6, "1 to 1 000 000")
        corners = np.abs(np.concatenate([self.poles, self.zeros]))
        corners = np.append(corners[corners > 0], [1 / self.dead_time] if self.dead_time else [])
        if corners.size == 0:
            corners = np.ones(1)
        low, high = 1e-3 * corners.min(), 1e3 * corners.max()
        w = np.geomspace(low, high, int(per_decade * math.log10(high / low)) + 1)
        parts = [w]
        for p in np.concatenate([self.poles, self.zeros]):
            if abs(p.real) < 0.5 * abs(p.imag):
                around = abs(p.imag) + abs(p.real) * np.linspace(-8, 8, 65)
                parts.append(around[around > 0])
        if self.dead_time:
            alive = w[np.abs(self.response(w)) > _QUIET]
            turn = 6 / per_decade / self.dead_time
            end = min(alive.max(initial=0.0), 2_000 / self.dead_time)
            parts.append(np.arange(turn, end, turn))
        return np.unique(np.concatenate(parts))

    def step(self, t: npt.ArrayLike | None = None) -> Step:
        """Times and response to a unit step at t = 0, exact but for rounding; a notebook shows its picture.

        Parameters
        ----------
        t : array_like of float, optional
            Times [s]; by default 400 from 0 until the response has settled, or three times the slowest lag of a
            process that does not settle.

        Examples
        --------
        >>> t, y = PLANTS["P2"].step()
        >>> len(t), round(float(y[-1]), 1)
        (400, 1.0)
        """
        at = np.linspace(0.0, self._horizon(), 400) if t is None else numbers_of(t, "t")
        return Step(at, self.step_response(at))

    def bode(self, w: npt.ArrayLike | None = None) -> Bode:
        """Frequencies, magnitude and phase [°], the phase unwrapped; a notebook shows their picture.

        Parameters
        ----------
        w : array_like of float, optional
            Frequencies [rad/s], ascending, > 0; by default those of `frequencies`.

        Examples
        --------
        >>> w, magnitude, phase = Plant([1], [1, 1]).bode([1.0])
        >>> round(float(magnitude[0]), 3), round(float(phase[0]))
        (0.707, -45)
        """
        at = self.frequencies() if w is None else np.atleast_1d(numbers_of(w, "w", "greater than 0", lambda x: x > 0))
        response = self.response(at)
        return Bode(at, np.abs(response), np.degrees(np.unwrap(np.angle(response))))

    def _horizon(self) -> float:
        """Length of a step response that is worth looking at [s]."""
        poles = np.roots(self.den)
        rates = np.abs(poles.real[np.abs(poles.real) > 1e-12])
        settles = bool(len(poles)) and bool((poles.real < -1e-12).all())
        slowest = 1 / rates.min() if rates.size else 1.0
        lags = float(np.sum(1 / rates)) + 6 * slowest if settles else 3 * slowest
        return float(1.2 * self.dead_time + lags)

    def step_response(self, t: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Response to a unit step at t = 0, exact but for rounding.

        Parameters
        ----------
        t : array_like of float
            Times [s], any shape.

        Notes
        -----
        ẋ = A·x + B·u in controllable form, with the held input as one more state: y(t) = [C D]·exp([A B; 0 0]·t)·[0 1].
        Times equally far apart cost one multiplication each.

        Examples
        --------
        >>> PLANTS["P4"].step_response([3.9, 6.0]).round(4)
        array([0.    , 0.6321])
        """
        t = numbers_of(t, "t")
        a, c = self._companion()
        y = np.zeros(t.shape)
        late = t >= self.dead_time
        since = np.sort(np.unique(t[late])) - self.dead_time
        state = np.zeros(a.shape[0])
        state[-1] = 1.0
        values, before, held, phi = np.empty(since.size), 0.0, math.nan, np.eye(a.shape[0])
        for i, now in enumerate(since):
            step = now - before
            if not abs(step - held) <= 1e-12 * now:
                held, phi = step, _expm(a * step)
            state = phi @ state
            values[i], before = c @ state, now
        y[late] = values[np.searchsorted(since, t[late] - self.dead_time)]
        return y

    def _companion(self) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        """Matrices [A B; 0 0] and [C D] of the rational part in companion form, without the dead time."""
        n = self.order
        den = np.asarray(self.den) / self.den[0]
        num = np.concatenate([np.zeros(n + 1 - len(self.num)), np.asarray(self.num) / self.den[0]])
        a = np.zeros((n + 1, n + 1))
        if n:
            a[0, :n] = -den[1:]
            a[np.arange(1, n), np.arange(n - 1)] = 1.0
            a[0, n] = 1.0
        return a, np.append(num[1:] - num[0] * den[1:], num[0])


def _expm(a: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Matrix exponential by scaling, Taylor's series and squaring: small matrices, and no need of SciPy."""
    norm = float(np.abs(a).sum(axis=1).max(initial=0.0))
    squarings = max(0, math.ceil(math.log2(norm / 0.25))) if norm > 0 else 0
    a = a / 2.0**squarings
    result = term = np.eye(a.shape[0])
    for k in range(1, 14):  # 0.25¹⁴/14! < 1e-19
        term = term @ a / k
        result = result + term
    for _ in range(squarings):
        result = result @ result
    return result


def _roots(coefficients: Sequence[float]) -> npt.NDArray[np.complex128]:
    """Roots of a polynomial, those at 0 exact."""
    at_zero = _zeros_at_end(coefficients)
    rest = np.roots(coefficients[: len(coefficients) - at_zero])
    return np.concatenate([rest, np.zeros(at_zero)]).astype(np.complex128)


def _zeros_at_end(coefficients: Sequence[float]) -> int:
    return next(i for i, c in enumerate(reversed(coefficients)) if c != 0)


def _coefficients(name: str, values: Any) -> tuple[float, ...]:
    """Coefficients without zeros in front."""
    try:
        given = np.atleast_1d(values)
        numbers = [math.nan] if np.any(np.imag(given)) else [float(c) for c in np.real(given)]
    except (TypeError, ValueError, OverflowError):
        numbers = [math.nan]
    if not all(math.isfinite(c) for c in numbers):
        raise InputError(f"is {values!r}, must be finite numbers", parameter=name, value=values, bound="finite numbers")
    first = next((i for i, c in enumerate(numbers) if c != 0), None)
    if first is None:
        raise InputError(f"is {values!r}, must have a coefficient other than 0", parameter=name, value=values)
    return tuple(numbers[first:])


def _rational(process: Any) -> tuple[Any, Any] | None:
    """Numerator and denominator of a linear system in any accepted form; None for anything else."""

    def has(*names: str) -> bool:
        return all(hasattr(process, name) for name in names)

    if has("num", "den"):
        return _single(process.num), _single(process.den)
    if has("A", "B", "C", "D"):
        return _of_states(*(np.atleast_2d(np.asarray(getattr(process, name), np.float64)) for name in "ABCD"))
    if has("zeros", "poles", "gain") and not callable(process.zeros):
        num, den = np.poly(_single(process.zeros)), np.poly(_single(process.poles))
        return np.real(process.gain * num), np.real(den)
    return None


def _of_states(a: Any, b: Any, c: Any, d: Any) -> tuple[Any, Any]:
    """C·(s·1 − A)⁻¹·B + D = (det(s·1 − A + B·C) + (D − 1)·det(s·1 − A))/det(s·1 − A), for one input and one output.

    A coefficient that is nothing but what rounding left of a difference is 0: it would be a zero of the process.
    """
    if d.shape != (1, 1):
        raise InputError("must have one input and one output", parameter="plant", value=d.shape, bound="1 × 1")
    if not a.size:
        return d[0], [1.0]
    with_feedback, den = np.poly(a - b @ c), np.poly(a)
    num = with_feedback + (d[0, 0] - 1) * den
    rounding = 1e3 * np.finfo(np.float64).eps * np.maximum(np.abs(with_feedback), np.abs(den))
    return np.where(np.abs(num) > rounding, num, 0.0), den


def _single(polynomial: Any) -> Any:
    """Coefficients of a polynomial that may be wrapped in a 1 × 1 matrix, as python-control has it."""
    while len(polynomial) == 1 and np.ndim(polynomial[0]) > 0:
        polynomial = polynomial[0]
    if np.ndim(polynomial) != 1:
        raise InputError("must have one input and one output", parameter="plant", value=polynomial)
    return polynomial


PLANTS: dict[str, Plant] = {name: Plant(num, den, dead_time) for name, num, den, dead_time in _glapp.batch()}
"""The test batch P1 to P8 (thesis 4.1)."""
