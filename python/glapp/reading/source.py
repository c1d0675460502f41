"""What a CSV, Parquet or Arrow file and a table in memory have in common: columns, in record batches."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from queue import Empty, Full, Queue
from threading import Event, Thread
from typing import Protocol, TypeVar

import pyarrow as pa

__all__ = ["Head", "Source", "ahead"]

T = TypeVar("T")


class Head(Protocol):
    """First rows of every column, by the column's index."""

    def __getitem__(self, at: int, /) -> pa.Array: ...


class Source(ABC):
    """Columns that can be streamed again and again.

    Attributes
    ----------
    label : str
        File as the user wrote it, or "memory".
    names, units : list
        Column names in order (they may repeat), and units found below them.
    rows : int or None
        Number of rows where known.
    """

    label: str
    names: list[str]
    units: list[str | None]
    rows: int | None
    comma: bool = False

    @abstractmethod
    def head(self) -> Head:
        """First rows of every column, at least two rows where there are two."""

    def tail(self) -> list[pa.Array] | None:
        """Last rows of every column where they are cheap to have."""
        return None

    @abstractmethod
    def stream(
        self, types: Mapping[int, pa.DataType], bad_words: frozenset[str]
    ) -> Iterator[tuple[list[pa.Array], float]]:
        """Pass over the columns at the indices `types`, in that order, with the fraction read so far.

        Columns may come as `types` says, or as the file has them, or as text.
        """

    @abstractmethod
    def row_number(self, record: int) -> int:
        """Number that a person sees beside the record with this index."""


def ahead(items: Iterator[T], depth: int = 3) -> Iterator[T]:
    """The same items, made in a background thread at most `depth` ahead, so that reading and work overlap."""
    shelf: Queue[tuple[bool, T | BaseException | None]] = Queue(depth)
    stop = Event()

    def put(entry: tuple[bool, T | BaseException | None]) -> None:
        while not stop.is_set():
            try:
                return shelf.put(entry, timeout=0.1)
            except Full:
                continue

    def work() -> None:
        try:
            for item in items:
                put((True, item))
                if stop.is_set():
                    return
            put((False, None))
        except BaseException as error:
            put((False, error))

    thread = Thread(target=work, name="glapp reading", daemon=True)
    thread.start()
    try:
        while True:
            more, item = shelf.get()
            if not more:
                if isinstance(item, BaseException):
                    raise item
                return
            yield item  # type: ignore[misc]
    finally:
        stop.set()
        try:
            while True:
                shelf.get_nowait()
        except Empty:
            pass
        thread.join()
