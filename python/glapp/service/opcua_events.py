"""Events of an OPC UA connection: the same one at most once a minute, with its count."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Protocol

from .signal import Event, Signal, Tell

__all__ = ["REPEATED", "EventFilter"]

REPEATED = 60.0
"""Interval of reports on an event that repeats, with its count [s]."""

_RUSH = 20
"""Tags with the same fault that are reported singly in that time; more are reported together."""


@dataclass(slots=True)
class _EventCount:
    """Number of an event's occurrences since its last report."""

    loop: str | None
    signal: Signal | None = None
    text: str = ""
    many: str = ""
    at: float = -math.inf
    count: int = 0


@dataclass(slots=True)
class _Rush:
    """Number of occurrences in very many tags at once."""

    since: float
    reported: int = 0
    more: int = 0
    text: str = ""


class Tag(Protocol):
    """Subject of an event."""

    loop: str
    signal: Signal

    @property
    def name(self) -> str:
        """Name of the tag, with that of its loop."""


class EventFilter:
    """Events on their way to their taker; repeated ones are counted.

    - `tell`: takes the events; None as long as nobody does.
    """

    def __init__(self) -> None:
        self.tell: Tell | None = None
        self._told: dict[tuple[str, str | None], _EventCount] = {}
        self._rushes: dict[str, _Rush] = {}

    def event(self, kind: str, loop: str | None, text: str, signal: Signal | None = None) -> None:
        """Report an event."""
        if self.tell is not None:
            self.tell(Event(time.time(), loop, kind, text, signal))

    def often(self, kind: str, text: str, *, tag: Tag | None = None, many: str = "", count: int = 1) -> None:
        """Report at once, and then at most once in `REPEATED` seconds, with how often it happened meanwhile.

        - `kind`, `text`: of the event; each kind is counted for itself, and each tag.
        - `tag`: what it is about.
        - `many`: what is counted, such as values in all.
        - `count`: how many it were.
        """
        key = (kind, None if tag is None else tag.name)
        about = _EventCount(None) if tag is None else _EventCount(tag.loop, tag.signal)
        entry = self._told.setdefault(key, about)
        entry.text, entry.many = text, many
        entry.count += count
        if time.monotonic() - entry.at >= REPEATED:
            self._say(kind, entry)

    def once(self, kind: str, loop: str, text: str, signal: Signal | None = None) -> None:
        """Report an event, together with others of its kind where very many tags have it at once."""
        self._say(kind, _EventCount(loop, signal, text))

    def _say(self, kind: str, entry: _EventCount) -> None:
        """Report an event; beyond `_RUSH` of one kind in a minute only count it."""
        now = time.monotonic()
        more = f" ({entry.count} {entry.many})" if entry.count > 1 and entry.many else ""
        text = entry.text + more
        entry.at, entry.count = now, 0
        rush = self._rushes.setdefault(kind, _Rush(now))
        if now - rush.since >= REPEATED:
            rush.since, rush.reported = now, 0
        if rush.reported < _RUSH:
            rush.reported += 1
            self.event(kind, entry.loop, text, entry.signal)
        else:
            rush.more += 1
            rush.text = text

    def flush(self, *, due: bool = False) -> None:
        """Report events that were only counted: all of them, or those that are due."""
        now = time.monotonic()
        for (kind, _), entry in self._told.items():
            if entry.count and (not due or now - entry.at >= REPEATED):
                self._say(kind, entry)
        for kind, rush in self._rushes.items():
            if rush.more:
                self.event(kind, None, f"{rush.more} more tags, such as {rush.text}")
                rush.more = 0
