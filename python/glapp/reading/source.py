"""Common base of a CSV, Parquet or Arrow file and a table in memory: columns, in record batches."""

from __future__ import annotations

import atexit
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from copy import copy
from functools import cached_property
from queue import Empty, Full, Queue
from threading import Event, Thread
from types import MappingProxyType
from typing import TypeVar

import pyarrow as pa

from ..errors import InputError
from .cells import plain
from .meaning import numbered, understand, with_own_qualities
from .names import MISSING
from .values import Digits, digits_of, unit_of

__all__ = ["Head", "Source", "ahead"]

T = TypeVar("T")


class Source(ABC):
    """Columns that can be streamed again and again.

    - `label`: file as the user wrote it, or `glapp.recording.MEMORY`.
    - `names`, `units`: column names in order (they may repeat), and units found below them.
    - `rows`: number of rows where known.
    - `digits`: how text in it writes numbers.
    - `time`: name of the column of times, where its name does not say so.
    - `tags`: all tags there are, where the source is no table of a row per tag and time but is read as one.
    - `tag_units`: their units where known.
    - `one_fault`: whether a fault of the file stops all its loops, whichever columns are read.
    - `typed`: whether numbers come as numbers, so that none has its unit behind it.
    - `nameless`: text of the error where the file has no line of names, and the settings assign no column.
    """

    label: str
    names: list[str]
    units: list[str | None]
    rows: int | None
    digits: Digits = Digits()
    time: str | None = None
    tags: list[str] | None = None
    tag_units: Mapping[str, str] = MappingProxyType({})
    one_fault: bool = False
    typed: bool = False
    nameless: InputError | None = None

    def number(self, column: int) -> int:
        """Number of the column at this index, as the file counts its columns."""
        return column + 1

    def tell_apart(self) -> None:
        """Give the columns names of their own: see `with_own_qualities` and `numbered`."""
        self.call(numbered(with_own_qualities(self.names), [self.number(i) for i in range(len(self.names))]))

    @cached_property
    def places(self) -> dict[str, list[int]]:
        """Name to the indices of the columns of this name."""
        places: dict[str, list[int]] = {}
        for i, name in enumerate(self.names):
            places.setdefault(name, []).append(i)
        return places

    def call(self, names: list[str]) -> None:
        """Give the columns these names."""
        self.names = names
        self.__dict__.pop("places", None)

    def call_by_numbers(self, row: int) -> None:
        """Name the columns of a table without names: a person may still say which is which."""
        self.names = [f"column {i + 1}" for i in range(len(self.names))]
        self.units = [None] * len(self.names)
        self.nameless = InputError(
            "has no header: the first row holds data",
            file=self.label,
            row=row,
            hint="write the columns' names in the first row, for instance t,SP,PV,OP,MODE; or name the columns by "
            "their numbers: --time 'column 1' --pv 'column 2' ..., or in loops.toml "
            'columns = { time = "column 1", pv = "column 2" }',
            asks="columns",
        )

    def unit(self, column: int) -> str | None:
        """Unit that stands below a column's name, or in it."""
        return self.units[column] or understand(self.names[column]).unit

    def unit_in_cells(self, column: int) -> str | None:
        """Unit behind most numbers of a column, as in 48.20 m³/h; None where most of the first cells have none."""
        if self.typed:
            return None
        head = plain(self.head([column])[0])
        if not pa.types.is_string(head.type):
            return None
        cells = [cell for cell in head.to_pylist() if cell and cell.strip().lower() not in MISSING]
        units = Counter(None if (found := unit_of(cell)) is None else found[1] for cell in cells)
        return max(units, key=units.__getitem__, default=None)

    def learn_digits(self, cells: Iterable[str | None]) -> None:
        """Take the notation of numbers from cells of text.

        Raises InputError where some have a decimal comma and others a decimal point.
        """
        try:
            self.digits = digits_of([_number(cell) for cell in cells if cell], self.label)
        except InputError as error:
            raise self._placed(error) from None

    def _placed(self, error: InputError) -> InputError:
        """The error of a number, with the row and column in which it first is, where that is among the first rows."""
        for i, name in enumerate(self.names):
            for k, cell in enumerate(plain(self.head([i])[0]).to_pylist()):
                if isinstance(cell, str) and _number(cell) == error.value:
                    error.row, error.column = self.row_number(k), name
                    return error
        return error

    @abstractmethod
    def head(self, columns: Sequence[int]) -> list[pa.Array]:
        """First rows of the columns at these indices, at least two rows where there are two."""

    def tail(self, column: int) -> pa.Array | None:
        """Last rows of a column where they are cheap to have."""
        return None

    @abstractmethod
    def stream(
        self, types: Mapping[int, pa.DataType], bad_words: frozenset[str]
    ) -> Iterator[tuple[list[pa.Array], float]]:
        """Pass over the columns at the indices `types`, in that order, with the fraction read so far.

        Columns come in the types of `types` or of the file, or as text.
        """

    @abstractmethod
    def row_number(self, record: int) -> int:
        """Row number of a record as a person sees it in the file."""


def _number(cell: str) -> str:
    """A number without the unit behind it; any other text as it is."""
    found = unit_of(cell)
    return cell.strip() if found is None else found[0]


class Head:
    """First rows of columns, each read by itself and once, even where that fails.

    A damaged column harms no loop without it, and the many loops that share one do not all try it again.
    """

    def __init__(self, first: Callable[[int], pa.Array]) -> None:
        self._first = first
        self._read: dict[int, pa.Array | InputError] = {}

    def __call__(self, columns: Sequence[int]) -> list[pa.Array]:
        """Arrays of the columns at these indices."""
        return [self._one(i) for i in columns]

    def _one(self, i: int) -> pa.Array:
        """First rows of a column, kept; its error is raised each time."""
        if i not in self._read:
            try:
                self._read[i] = self._first(i)
            except InputError as error:
                self._read[i] = error
        if isinstance(found := self._read[i], InputError):
            raise copy(found)
        return found


_threads: dict[Thread, Event] = {}
"""Threads that read ahead, each with what stops it."""


@atexit.register
def _stop() -> None:
    """End the passes that are still open: a thread that is inside a library as Python ends aborts the process."""
    while _threads:
        thread, stop = _threads.popitem()
        stop.set()
        thread.join()


def ahead(items: Iterator[T], depth: int = 3) -> Iterator[T]:
    """Items made in a background thread, at most `depth` ahead, so that reading and work overlap."""
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
    _threads[thread] = stop
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
        if _threads.pop(thread, None) is not None:
            stop.set()
            try:
                while True:
                    shelf.get_nowait()
            except Empty:
                pass
            thread.join()
