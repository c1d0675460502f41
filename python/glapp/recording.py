"""What reading hands to everything else: a recording of one loop as a stream of batches."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from datetime import datetime
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from . import _glapp
from .errors import InputError
from .loop import Loop
from .notebook import table
from .quality import Finding

__all__ = [
    "AT_HIGH",
    "AT_LOW",
    "BAD",
    "MARKED",
    "MEMORY",
    "NOT_AUTO",
    "Batch",
    "Recording",
    "finished",
    "joined",
    "with_op_unit",
    "without_value",
]

T = TypeVar("T", bound=np.generic)

NOT_AUTO, BAD, AT_LOW, AT_HIGH = 1, 2, 4, 8
"""Bits of `Batch.flags`: not in automatic; SP or PV missing or of bad quality; OP at its low, at its high limit."""

MEMORY = "memory"
"""`Recording.source` of what is in no file."""

MARKED = {"sp": 1, "pv": 2, "op": 4}
"""Bits of `Batch.marks`."""


@dataclass(frozen=True, slots=True)
class Batch:
    """One stretch of a recording; all arrays C-contiguous and of the same length n.

    Attributes
    ----------
    t : float64[n]
        Seconds since the first row of the recording, or the numbers as given where the time column is plain seconds.
        They may repeat or run backwards: reading neither sorts nor drops.
    sp : float64[n] or None
        Setpoint [PV unit], NaN where missing or bad; None where the recording has none.
    pv : float64[n]
        Process value [PV unit], NaN where missing or bad.
    op : float64[n] or None
        Controller output [OP unit], NaN where missing; None where the recording has none.
    flags : uint8[n] or None
        Sum of `NOT_AUTO`, `BAD`, `AT_LOW`, `AT_HIGH`; None where all are zero.
    position : float64[n] or None
        Measured valve position where recorded.
    marks : uint8[n] or None
        Sum of `MARKED` of the signals that are NaN because their quality is bad, not because they are missing; a row
        that is bad as a whole counts for PV. None where there is none.
    """

    t: NDArray[np.float64]
    sp: NDArray[np.float64] | None
    pv: NDArray[np.float64]
    op: NDArray[np.float64] | None = None
    flags: NDArray[np.uint8] | None = None
    position: NDArray[np.float64] | None = None
    marks: NDArray[np.uint8] | None = None

    def __len__(self) -> int:
        return len(self.t)

    def __getitem__(self, part: slice | NDArray[np.bool_]) -> Batch:
        """A stretch of this stretch, without copying; or the rows at which an array is true."""

        def cut(a: NDArray[T] | None) -> NDArray[T] | None:
            return None if a is None else a[part]

        sp, op, position = cut(self.sp), cut(self.op), cut(self.position)
        return Batch(self.t[part], sp, self.pv[part], op, cut(self.flags), position, cut(self.marks))


def finished(
    t: NDArray[np.float64],
    values: dict[str, NDArray[np.float64]],
    flags: NDArray[np.uint8] | None,
    marks: NDArray[np.uint8] | None = None,
) -> Batch:
    """A batch of the signals there are: rows without PV, or without an SP that is recorded, are bad.

    - `flags`: with `BAD` where the quality of PV, or of the row, is bad.
    - `marks`: of SP and OP.
    """
    sp, pv = values.get("sp"), values["pv"]
    if flags is not None and (bad := flags & BAD != 0).any():
        pv = np.where(bad, np.nan, pv)
        of_pv = bad * np.uint8(MARKED["pv"])
        marks = of_pv if marks is None else marks | of_pv
    with np.errstate(all="ignore"):  # a sum that overflows is looked at more closely
        missing_somewhere = np.isnan(pv.sum()) or (sp is not None and np.isnan(sp.sum()))
    if missing_somewhere:
        missing = np.isnan(pv) if sp is None else np.isnan(sp) | np.isnan(pv)
        flags = np.zeros(len(t), np.uint8) if flags is None else flags
        flags = flags | (missing * np.uint8(BAD))
    if flags is not None and not flags.any():
        flags = None
    if marks is not None and not marks.any():
        marks = None
    return Batch(t, sp, pv, values.get("op"), flags, values.get("position"), marks)


def without_value(rows: int, marked: int = 0, **place: Any) -> InputError:
    """The error of a signal that has no value in any row.

    - `rows`, `marked`: rows, and those of them whose quality is bad.
    - `place`: file, column or tag, or parameter of it.

    Examples
    --------
    >>> print(without_value(600, file="plant.csv", column="PV"))
    plant.csv, column PV: has no value in any of 600 rows; is it the right column?
    >>> without_value(600, 590, column="PV").what
    'has no value of good quality in any of 600 rows, and one of bad quality in 590'
    """
    if not marked:
        kind = next((kind for kind in ("column", "tag") if place.get(kind)), None)
        return InputError(f"has no value in any of {rows} rows", hint=kind and f"is it the right {kind}?", **place)
    what = f"has no value of good quality in any of {rows} rows, and one of bad quality in {marked}"
    return InputError(what, hint="repair the signal, or check which quality codes mean good", **place)


def joined(parts: Sequence[Batch]) -> Batch:
    """Several stretches as one; what only some of them have is NaN, or no flag, in the others."""

    def column(name: str) -> Any:
        columns = [getattr(part, name) for part in parts]
        if all(column is None for column in columns):
            return None
        nothing = np.uint8(0) if name in ("flags", "marks") else np.nan
        return np.concatenate(
            [np.full(len(part), nothing) if x is None else x for part, x in zip(parts, columns, strict=True)]
        )

    return Batch(*(column(field.name) for field in fields(Batch)))


class Recording(ABC):
    """A recording of one loop that can be read again and again, a batch at a time.

    Attributes
    ----------
    name : str
        Name of the loop.
    loop : Loop
        The loop's settings, as given or as found from the columns.
    source : str
        File name as the user wrote it, or `MEMORY`.
    t0 : datetime or None
        Time of the first row, aware where a zone is known; None for plain seconds.
    zone : str or None
        Zone of the times: the one the user named, or "UTC" where the data carries offsets.
    columns : dict
        Role ("time", "SP", "PV", "OP", "MODE" ...) to the column or tag taken.
    units : dict
        Role to the unit found in the header or in a row of units below it.
    rows : int or None
        Number of rows where it is known before reading.
    found : sequence of Finding
        What was noticed when it was opened.
    left_out : sequence of str
        Signals that are not read, and may be in columns of no loop, each with what to write.
    """

    name: str
    loop: Loop
    source: str
    t0: datetime | None
    zone: str | None
    columns: dict[str, str]
    units: dict[str, str]
    rows: int | None
    found: Sequence[Finding] = ()
    left_out: Sequence[str] = ()

    def __repr__(self) -> str:
        rows = "" if self.rows is None else f", {self.rows} rows"
        taken = ", ".join(f"{role} {column!r}" for role, column in self.columns.items())
        return f"<Recording {self.name}: {self.source}{rows}; {taken}>"

    def _repr_html_(self) -> str:
        """File, beginning and columns, for a notebook."""
        first = [] if self.t0 is None else [("begins", f"{self.t0:%Y-%m-%d %H:%M:%S}")]
        rows = [] if self.rows is None else [("rows", str(self.rows))]
        units = {role: f" [{unit}]" for role, unit in self.units.items()}
        taken = [(role, f"{column}{units.get(role, '')}") for role, column in self.columns.items()]
        return table(self.name, [("file", self.source), *first, *rows, *taken])

    @abstractmethod
    def batches(self, rows: int = 65536) -> Iterator[Batch]:
        """The recording from its first row on, in stretches of at most `rows` rows; each call starts again.

        Raises
        ------
        InputError
            At the first cell that cannot be used, with its row and column; at the end, if PV never was a number.
        """

    def beginning(self, rows: int) -> Batch:
        """The first `rows` rows in one stretch; what only some of their batches have is NaN, or no flag, in the others.

        Raises
        ------
        InputError
            As `batches`.
        """
        parts: list[Batch] = []
        for batch in self.batches():
            parts.append(batch[slice(0, rows)])
            rows -= len(parts[-1])
            if rows <= 0:
                break
        return joined(parts)

    @abstractmethod
    def fraction_read(self) -> float | None:
        """Share of the file or table that the latest pass has read, 0..1; None before the first pass."""

    def release(self) -> None:
        """Free the rows that are held in memory; they are read again where they are needed again."""
        return None


def with_op_unit(loop: Loop, *batches: Batch) -> Loop:
    """The loop with the unit of OP that its values allow: they may show that OP is no percentage."""
    ops = [batch.op for batch in batches if batch.op is not None]
    op = np.concatenate(ops) if len(ops) > 1 else ops[0] if ops else None
    unit = _glapp.op_unit(loop.op_unit, loop.op_span, op)
    return loop if unit == loop.op_label else loop.model_copy(update={"op_unit": unit})
