"""Values from a plant and to it, events, and the interface of every source."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Protocol, TypeVar

__all__ = ["Event", "Plant", "Signal", "Source", "Take", "Tell", "Value", "WriteRefused", "answered_within"]

T = TypeVar("T")


class Signal(StrEnum):
    """Meaning of a loop's tag.

    Examples
    --------
    >>> Signal("pv") is Signal.PV
    True
    """

    SP = "sp"  # setpoint [PV unit]
    PV = "pv"  # measured value [PV unit]
    OP = "op"  # controller output [OP unit]
    MODE = "mode"  # 1 where the controller is in automatic, 0 where it is not
    LOW = "low"  # 1 where something in the loop is at its lower limit
    HIGH = "high"  # 1 where something in the loop is at its upper limit
    POSITION = "position"  # what the valve says of itself [its own unit]
    U_FF = "u_ff"  # feed-forward that the controller adds to OP [OP unit]


@dataclass(frozen=True, slots=True)
class Value:
    """One value of one signal of one loop, at its source's time.

    - `loop`: name of the loop.
    - `signal`: which of its signals.
    - `time`: source time stamp [s since 1970-01-01 UTC].
    - `value`: in the plant's own unit; NaN where it is not good.
    - `good`: whether it may be believed.
    - `note`: why it may not, such as the name of an OPC UA status; "" where it may.

    Examples
    --------
    >>> Value("FIC101", Signal.PV, 1.7e9, 49.5, True).value
    49.5
    """

    loop: str
    signal: Signal
    time: float
    value: float
    good: bool
    note: str = ""


@dataclass(frozen=True, slots=True)
class Event:
    """Something that is reported to a person, and kept.

    - `time`: when it was noticed, by the clock of this computer [s since 1970-01-01 UTC].
    - `loop`: name of the loop; None where it concerns the whole connection.
    - `kind`: one word to sort by: connected, lost, overflow, backfilled, late, future, duplicate, type_changed,
      clock_back, …
    - `text`: the sentence that a person reads.
    - `signal`: the tag that it is about; None where it is about all of the loop.
    """

    time: float
    loop: str | None
    kind: str
    text: str
    signal: Signal | None = None


Take = Callable[[Sequence[Value]], None]
Tell = Callable[[Event], None]


class WriteRefused(Exception):  # noqa: N818 - a refusal is an answer, not a fault of the program
    """A value was not written to the plant, and why.

    - `reason`: one word to sort by: not_enabled, not_named, not_a_number, too_large, too_fast, not_connected,
      other_writer, by_server.
    - `nearest`: with `too_fast`, the nearest value that may be written now [OP unit].
    """

    def __init__(self, reason: str, text: str, nearest: float | None = None) -> None:
        super().__init__(text)
        self.reason, self.nearest = reason, nearest


class Source(Protocol):
    """Source of values, with the few places that can be written."""

    async def run(self, take: Take, tell: Tell) -> None:
        """Hand over values and events, in the order in which they came, until cancelled."""

    async def write(self, loop: str, u_ff: float) -> None:
        """Write the feed-forward of a loop [OP unit].

        Raises WriteRefused where it was not written, by name.
        """

    async def read_back(self, loop: str) -> Value:
        """The feed-forward in the plant now."""

    def alive(self, loop: str) -> float | None:
        """Time of the last sign of the loop: a value, or a report that none has changed [s since 1970 UTC]."""

    async def heartbeat(self) -> None:
        """Show the plant's watchdog that this program is alive."""


class Plant(Source, Protocol):
    """A source that writes u_FF of a loop only while that is enabled; else it may only go to 0."""

    def enable(self, loop: str) -> None:
        """Let u_FF of a loop be written.

        Raises WriteRefused where there is no node or no connection.
        """

    def disable(self, loop: str) -> None:
        """Let u_FF of a loop only go to 0 from now on."""


async def answered_within(seconds: float, answer: Coroutine[Any, Any, T]) -> T:
    """The plant's answer to a call of a `Source`, if it comes in time.

    The call runs in a task of its own: a client that loses its connection cancels every task that waits for it, and
    ours must go on.

    Raises WriteRefused with the reason `no_answer` or `not_connected`, too.
    """
    task = asyncio.ensure_future(answer)
    task.add_done_callback(lambda done: done.cancelled() or done.exception())
    try:
        await asyncio.wait({task}, timeout=seconds)
        if not task.done():
            raise WriteRefused("no_answer", f"the plant has not answered in {seconds:g} s")
        if task.cancelled():
            raise WriteRefused("not_connected", "the connection was lost meanwhile")
        return task.result()
    finally:
        task.cancel()
