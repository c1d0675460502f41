"""Effect of a compensation: the plan before it, and the result after it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..report.words import number, quantity
from ..service.compensation import TEXT_OF_STATE
from .parameters import NO_LIMIT

__all__ = ["Calm", "Plan", "calm", "plan", "why_off"]


def why_off(made: Mapping[str, Any]) -> str:
    """Why it is off, in words, of the status of a compensation.

    >>> why_off({"withdrawn": "worse", "why_off": "it was withdrawn, worse"})
    'It is off. Withdrawn: the loop is worse than before.'
    >>> why_off({"withdrawn": None, "why_off": "eve disabled it"})
    'It is off: eve disabled it.'
    """
    if made["withdrawn"] is None:
        return f"It is off: {made['why_off'] or 'nobody enabled it'}."
    return f"It is off. {TEXT_OF_STATE[made['withdrawn']]}"


_FROM = {1: "which a person typed", 2: "the lower limit of the fit that was taken over", 3: "the on-line estimate"}
_WAY = {1: "error", 2: "derivative", 3: "inverse"}


@dataclass(frozen=True, slots=True)
class Plan:
    """Plan of a compensation.

    - `size`, `delta`: the width it goes by, and how far u_FF goes from side to side [OP unit]; None where nothing is
      known of it.
    - `lines`: the same, and how it ends, in sentences.
    - `why_not`: why it cannot be enabled; empty where nothing stands against it here.
    """

    size: float | None
    delta: float | None
    lines: tuple[str, ...]
    why_not: str


def plan(parameters: Mapping[str, Any], unit: str) -> Plan:
    """Effect of enabling a loop's compensation, with its present parameters.

    The width and the share are the core's rule: share·size, for the inverse less the band, which is a fifth of the size
    where nobody says (`docs/compensation.md`). What is really done, the service shows afterwards.

    - `parameters`: as the API gives them.
    - `unit`: of OP.

    Examples
    --------
    >>> empty = dict.fromkeys(("comp_fitted", "comp_source", "comp_band", "comp_travel", "comp_reversals"))
    >>> given = {"comp_size": 2.0, "comp_share": 0.8, "comp_way": 3.0, "comp_limit": 5.0, "comp_rate": 0.5}
    >>> round(plan({**empty, **given, "comp_release": 20.0, "comp_withdraw": 1.0}, "%").delta, 9)
    1.2
    """
    if "comp_size" not in parameters:
        return Plan(None, None, (), "This loop has no node for u_FF, or its controller is not known.")
    fitted, typed = parameters["comp_fitted"], parameters["comp_size"]
    source = int(parameters["comp_source"] or (2 if fitted is not None else 1 if typed else 0))
    if source == 0:
        return Plan(None, None, (), "No width is given: take over a fit, or type one.")
    size = {1: typed, 2: fitted, 3: None}[source]
    share, way = parameters["comp_share"], int(parameters["comp_way"])
    lines = []
    delta = None
    if source == 3:
        lines.append(f"It goes by {_FROM[3]}, as it is when it is enabled, and takes {100 * share:g} % of it.")
    elif not size:
        return Plan(size, None, (), "The width is 0: there is nothing to compensate.")
    else:
        band = parameters["comp_band"] if parameters["comp_band"] is not None else 0.2 * size
        delta = max(share * size - (band if way == 3 else 0.0), 0.0)
        lines.append(
            f"The width is {quantity(size, unit)}, {_FROM[source]}. {100 * share:g} % of it is compensated"
            + (f", less a band of {quantity(band, unit)}." if way == 3 else ".")
        )
        lines.append(
            f"Whenever OP has turned round, u_FF goes to the other side: {quantity(delta, unit)} in all, between "
            f"{quantity(-delta / 2, unit)} and {quantity(delta / 2, unit)}. "
            f"About {quantity(size - delta, unit)} of the gap stays uncompensated."
        )
        if delta == 0.0:
            return Plan(size, delta, tuple(lines), "Nothing is left of the width after the band.")
    rate = parameters["comp_rate"]
    lines.append(
        f"The way is {_WAY.get(way, way)} (comp_way). u_FF moves by at most {quantity(rate, f'{unit}/s')}; "
        f"no width beyond {quantity(parameters['comp_limit'], unit)} is compensated."
    )
    release = parameters["comp_release"] if parameters["comp_release"] is not None else parameters["ti"]
    ends = "manual sets u_FF to 0 at once; a bad value, a limit or a lost connection takes it back to 0"
    watchdog = "if the service stops, the plant's watchdog does it"
    lines.append(f"It ends by itself: {ends} in {quantity(release, 's')}; {watchdog}.")
    if parameters["comp_withdraw"]:
        lines.append("It is withdrawn where the loop swings from too much of it, or is worse than before.")
    else:
        lines.append("Attention: where the loop gets worse that is told, and it is not withdrawn (comp_withdraw is 0).")
    budgets = [
        f"{quantity(parameters[name], text)}"
        for name, text in (("comp_travel", f"{unit} of travel in an hour"), ("comp_reversals", "reversals in an hour"))
        if parameters[name] is not None and parameters[name] < NO_LIMIT
    ]
    if budgets:
        lines.append(f"Budget: {' and '.join(budgets)}.")
    return Plan(size, delta, tuple(lines), "")


@dataclass(frozen=True, slots=True)
class Calm:
    """Median distance of PV from SP, before and since.

    The median and not the standard deviation: a load that steps takes PV away for some Ti, compensated or not, and
    most of the scatter of an hour may be of that one step. The cycle that a gap keeps up is there all the time.

    - `before`, `since`: median of |SP − PV| [PV unit].
    - `seconds`: how long u_FF has moved [s].
    """

    before: float
    since: float
    seconds: float

    @property
    def factor(self) -> float:
        """Ratio by which PV is calmer; below 1: it is not."""
        return self.before / self.since if self.since > 0 else float("inf")

    @property
    def word(self) -> str:
        """Ratio in words; a tenth is not mentioned.

        >>> Calm(1.0, 0.5, 60.0).word, Calm(1.0, 0.95, 60.0).word, Calm(1.0, 2.0, 60.0).word
        ('calmer by a factor of 2', 'as calm as before', 'less calm by a factor of 2')
        """
        if self.factor > 1.1:
            return f"calmer by a factor of {number(self.factor, 2)}"
        return (
            "as calm as before" if self.factor > 1.0 / 1.1 else f"less calm by a factor of {number(1 / self.factor, 2)}"
        )


def calm(
    times: Sequence[float], sp: Sequence[Any], pv: Sequence[Any], u_ff: Sequence[Any], enabled: float, least: float
) -> Calm | None:
    """Median distance of PV from SP before u_FF began to move, and since.

    - `times`: [s]
    - `sp`, `pv`: [PV unit]; NaN where they are bad.
    - `u_ff`: [OP unit]
    - `enabled`: when the compensation was enabled [s]: it begins with the first u_FF after that which is not 0.
    - `least`: so long it must have been watched on either side [s].

    Returns: None where it is too early.

    Examples
    --------
    >>> found = calm(range(5), [0.0] * 5, [2.0, -2.0, 0.0, 1.0, -1.0], [0.0, 0.0, 0.0, 0.5, 0.5], 2, 1.0)
    >>> found.before, found.since, found.factor
    (2.0, 1.0, 2.0)
    """
    t, e = np.asarray(times, float), np.asarray(sp, float) - np.asarray(pv, float)
    moved = np.flatnonzero((t >= enabled) & (np.nan_to_num(np.asarray(u_ff, float)) != 0.0))
    if not len(moved):
        return None
    begin = t[moved[0]]
    t, e = t[np.isfinite(e)], e[np.isfinite(e)]
    earlier = t < begin
    if not earlier.any() or earlier.all() or begin - t[0] < least or t[-1] - begin < least:
        return None
    before, since = (float(np.median(np.abs(some))) for some in (e[earlier], e[~earlier]))
    return Calm(before, since, float(t[-1] - begin))
