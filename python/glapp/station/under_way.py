"""The half-period under way: the block that ships, on the samples that are drawn.

The service tells of half-periods when they are over. What is seen before that, a detector of the page's own makes of
the same samples with the same settings. Its condition (5.1) goes by the detections in what is drawn alone.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from ..loop import Loop
from ..recording import BAD, NOT_AUTO
from ..report.words import NAMES, REASONS, failures
from ..service.compensation import detection_beside

__all__ = ["UnderWay"]


class UnderWay:
    """A detector on the samples of one loop.

    - `loop`: with a controller.
    - `period`: usual time between samples, > 0 [s].

    - `bad`: whether SP or PV of the last sample was bad: no half-period is under way then.

    Examples
    --------
    >>> settings = {"controller": {"k": 0.5, "ti": 5}, "process": {"kp": 2}, "op_span": (0, 100), "tf": 0.001}
    >>> loop = Loop(name="FIC101", **settings)
    >>> one = UnderWay(loop, 1.0)
    >>> for k in range(100):
    ...     one.take(float(k), 50.0, 51.0 if k // 40 % 2 else 49.0, 50.0, auto=True)
    >>> round(one.numbers["delta_y"], 2), one.failing
    (1.0, ['too short'])
    """

    def __init__(self, loop: Loop, period: float) -> None:
        self._graph = detection_beside(loop, period)
        self._last: float | None = None
        self.bad = False

    def take(self, t: float, sp: float | None, pv: float | None, op: float | None, *, auto: bool) -> None:
        """A sample; one that is not newer than the last is left out.

        - `t`: [s]
        - `sp`, `pv`, `op`: None for a bad value.
        - `auto`: whether the controller is in automatic.
        """
        if self._last is not None and t <= self._last:
            return
        h = self._graph.h if self._last is None else t - self._last
        self._last, self.bad = t, sp is None or pv is None
        values = {"sp": sp, "pv": pv, "op": op}
        flags = (0 if auto else NOT_AUTO) | (BAD if self.bad else 0)
        numbers = {name: math.nan if x is None else x for name, x in values.items()}
        self._graph.scan(h=h, flags=float(flags), u_ff=0.0, **numbers)

    def take_all(self, values: Mapping[str, Sequence[Any]]) -> None:
        """Samples as the API gives them."""
        rows = zip(*(values[name] for name in ("time", "SP", "PV", "OP", "MODE", "QUALITY")), strict=True)
        for t, sp, pv, op, mode, quality in rows:
            self.take(t, sp, None if quality == "bad" else pv, op, auto=mode == "AUTO")

    @property
    def numbers(self) -> dict[str, float]:
        """Δt [s], Δy, e_max and Δysp [PV unit] so far."""
        return {name: float(self._graph[f"watch.{name}"]) for name in ("delta_t", "delta_y", "e_max", "delta_sp")}

    @property
    def failing(self) -> list[str]:
        """Labels of all conditions that it would fail if it ended now."""
        return [REASONS[name].label for name in failures(int(self._graph["watch.mask"])) if name in NAMES]
