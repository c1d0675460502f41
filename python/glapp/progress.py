"""Progress of a task, reported to the caller that shows it."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[float | None], None]
"""Function that receives the share that is done, 0 to 1; None where it cannot be known."""


def shares(progress: Progress | None, *parts: float) -> list[Progress | None]:
    """One progress for several tasks, none of which knows how long the others take."""
    if progress is None:
        return [None] * len(parts)

    def part(begin: float, share: float) -> Progress:
        return lambda done: progress(None if done is None else begin + share * done)

    return [part(sum(parts[:i]), share) for i, share in enumerate(parts)]
