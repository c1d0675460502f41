"""One question to many records, by several processes, with a progress bar at a terminal."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from typing import TypeVar

from rich.progress import track

Asked, Answer = TypeVar("Asked"), TypeVar("Answer")


def answers_of(ask: Callable[[Asked], Answer], questions: Sequence[Asked], jobs: int | None) -> Iterator[Answer]:
    """Answers in the order of the questions; None for `jobs` is a process per core."""
    with ProcessPoolExecutor(jobs) as pool:
        yield from track(pool.map(ask, questions), "asking", len(questions), disable=not sys.stderr.isatty())
