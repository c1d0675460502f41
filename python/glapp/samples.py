"""Samples in memory where a recording is asked for."""

from __future__ import annotations

import os
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta, tzinfo
from pathlib import Path
from typing import Any
from zoneinfo import ZoneInfo

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .arrays import column
from .errors import InputError
from .loop import Loop
from .recording import BAD, MEMORY, Batch, Recording, finished, without_value

__all__ = ["Samples", "check_loop", "recording_of"]

_LABELS = {"t": "time", "sp": "SP", "pv": "PV", "op": "OP", "position": "POSITION", "flags": "MODE"}


class Samples(Recording):
    """A recording whose signals are arrays in memory.

    - `loop`: settings.
    - `signals`: `t`, `pv` and, where there are, `sp`, `op`, `position` and `flags`, as `Batch` has them; `t` in
      seconds, or as datetime64, timedelta64, datetime or timedelta.

    Raises InputError where they are not of one length, hold fewer than two samples, or no PV.
    """

    def __init__(self, loop: Loop, signals: dict[str, ArrayLike]) -> None:
        self.name, self.loop, self.source = loop.name, loop, MEMORY
        self.columns = {_LABELS[name]: name for name in signals}
        self.units: dict[str, str] = {}
        t, self.t0 = _seconds(times := _times(signals["t"]))
        self.zone: str | None = None
        if self.t0 is not None and (zone := _zone(signals["t"], times)) is not None:
            self.zone, self.t0 = str(zone), self.t0.replace(tzinfo=UTC).astimezone(zone)
        values = {name: _floats(name, x) for name, x in signals.items() if name not in ("t", "flags")}
        flags = _flags(signals["flags"]) if "flags" in signals else None
        sizes = {name: x.size for name, x in values.items()} | ({} if flags is None else {"flags": flags.size})
        for name, size in sizes.items():
            if size != t.size:
                raise InputError(f"has {size} samples, and t has {t.size}", parameter=name, value=size)
        if t.size < 2:
            raise InputError("has fewer than two samples", parameter="t", value=t.size, bound=">= 2")
        if not np.isfinite(values["pv"]).any():
            bad = 0 if flags is None else int(np.count_nonzero(flags & BAD))
            raise without_value(t.size, bad, parameter="pv")
        steps = np.diff(t)
        if (back := int(np.count_nonzero(steps < 0))) > t.size // 2:
            what = f"runs backwards in {back} of {t.size - 1} steps: the newest sample comes first"
            raise InputError(what, parameter="t", bound="oldest first", hint="reverse all arrays: x[::-1]")
        self.rows: int | None = t.size
        self._whole = finished(t, values, flags)
        self._fraction: float | None = None

    def batches(self, rows: int = 65536) -> Iterator[Batch]:
        """See `Recording.batches`."""
        for start in range(0, len(self._whole), rows):
            self._fraction = start / len(self._whole)
            yield self._whole[start : start + rows]
        self._fraction = 1.0

    def fraction_read(self) -> float | None:
        """Share that the latest pass has read."""
        return self._fraction


def recording_of(recording: Any, loop: Loop | None, **signals: ArrayLike | None) -> Recording:
    """The recording, one in a file or a table, or one of the signals that were given in its place.

    With a file or a table a signal may be the name of its column.

    Raises InputError where both are given or neither, or the signals cannot be used.
    """
    given: dict[str, Any] = {name: x for name, x in signals.items() if x is not None}
    if loop is not None:
        check_loop(loop)
    if recording is not None:
        if not isinstance(recording, Recording):
            return _opened(recording, loop, given)
        if given or loop is not None:
            also = ", ".join([*given, *([] if loop is None else ["loop"])])
            raise InputError("a recording has its signals and its loop", parameter=also, hint="give one or the other")
        return recording
    if missing := [name for name in ("t", "pv") if name not in given]:
        raise InputError(
            "is missing", parameter=" and ".join(missing), hint="give a recording, or t=..., pv=..., op=..."
        )
    return Samples(Loop(name="loop") if loop is None else loop, given)


def check_loop(loop: Any) -> None:
    """Refuse settings of a loop that are none.

    Raises InputError where they are not.
    """
    if not isinstance(loop, Loop):
        what = f"is a {type(loop).__name__}, must be a glapp.Loop"
        raise InputError(what, parameter="loop", value=loop, bound="glapp.Loop", hint='glapp.Loop(name="FIC101", ...)')


def _opened(data: Any, loop: Loop | None, given: dict[str, Any]) -> Recording:
    """The one loop in a file or a table, with columns named by the person where a guess would be wrong."""
    from .reading import open_recordings, recording_from
    from .reading.files import name_of

    if wrong := [name for name, column in given.items() if not isinstance(column, str)]:
        hint = "give names of columns with a file or a table, or arrays alone"
        raise InputError("goes with no file or table", parameter=", ".join(wrong), hint=hint)
    named = {"time" if name == "t" else name: column for name, column in given.items()}
    path = Path(data) if isinstance(data, str | os.PathLike) else None
    if named or path is None:
        loop = loop or Loop(name="loop" if path is None else name_of(path))
        loop = loop.model_copy(update={"columns": loop.columns.model_copy(update=named)})
    if path is None:
        return recording_from(data, loop)
    found = open_recordings(path, None if loop is None else [loop])
    if len(found) > 1:
        names = ", ".join(recording.name for recording in found)
        what = f"holds {len(found)} loops: {names}"
        raise InputError(what, file=str(path), hint="give a list, glapp.analyze([path]), for an answer of each")
    return found[0]


def _times(t: Any) -> NDArray[Any]:
    """Times as an array, of which none is known where one is masked."""
    if not isinstance(t, np.ma.MaskedArray):
        return np.asarray(t)
    values: Any = np.array(np.ma.getdata(t), np.float64 if t.dtype.kind in "iu" else t.dtype)
    values[np.ma.getmaskarray(t)] = None  # NaN or NaT in numbers and dates
    return np.asarray(values)


def _seconds(t: NDArray[Any]) -> tuple[NDArray[np.float64], datetime | None]:
    """Seconds, and the time of the first sample where it is a date."""
    if t.dtype == object and any(isinstance(x, datetime) for x in t.flat):
        t = _dates(t)
    elif t.dtype == object and any(isinstance(x, timedelta) for x in t.flat):
        t = _durations(t)
    if t.dtype.kind == "m":
        return np.ascontiguousarray(t / np.timedelta64(1, "ns") / 1e9, dtype=np.float64), None
    if t.dtype.kind != "M":
        return _floats("t", t), None
    known = t[~np.isnat(t)]
    if not known.size:
        raise InputError("holds no time", parameter="t")
    seconds = (t - known[0]) / np.timedelta64(1, "ns") / 1e9
    first: Any = known[0].astype("datetime64[us]").item()
    if not isinstance(first, datetime):
        raise InputError(f"begins at {known[0]}, beyond the years 1 to 9999", parameter="t", value=str(known[0]))
    return np.ascontiguousarray(seconds, dtype=np.float64), first


def _dates(t: NDArray[Any]) -> NDArray[np.datetime64]:
    """Times that Python or pandas holds one by one; those with a zone in UTC, as Polars and Arrow hand theirs out."""
    missing = [x is None or x != x for x in t.flat]
    try:
        zones = {x.tzinfo is None for x, none in zip(t.flat, missing, strict=True) if not none}
        utc = [
            None if none else x if x.tzinfo is None else x.astimezone(UTC).replace(tzinfo=None)
            for x, none in zip(t.flat, missing, strict=True)
        ]
        dates = np.array(utc, dtype="datetime64[us]").reshape(t.shape)
    except (AttributeError, TypeError, ValueError) as error:
        raise InputError(f"is not times: {error}", parameter="t", hint=_TIMES) from None
    if len(zones) > 1:
        raise InputError("holds times with a zone and times without", parameter="t", hint="give all a zone, or none")
    return dates


def _zone(given: Any, times: NDArray[Any]) -> tzinfo | None:
    """Zone of dates, of Polars and Arrow that of the column; UTC where it is an offset, None where there is none."""
    kinds = (getattr(given, "dtype", None), "time_zone"), (getattr(given, "type", None), "tz")
    of_column = next((zone for kind, name in kinds if (zone := getattr(kind, name, None)) is not None), None)
    of_each = (
        (x.tzinfo for x in times.flat if isinstance(x, datetime) and x == x) if times.dtype == object else iter(())
    )
    zone = of_column or next(of_each, None)
    if zone is None:
        return None
    try:
        return ZoneInfo(str(zone))
    except (ValueError, LookupError, OSError):  # ZoneInfo raises each of them for a name that is no zone's
        return UTC


def _durations(t: NDArray[Any]) -> NDArray[np.timedelta64]:
    """Times since a beginning that Python or pandas holds one by one."""
    if wrong := [x for x in t.flat if not (x is None or x != x or isinstance(x, timedelta))]:
        raise InputError(f"is not times: {wrong[0]!r} among durations", parameter="t", hint=_TIMES)
    return np.array([None if x is None or x != x else x for x in t.flat], "timedelta64[us]").reshape(t.shape)


_TIMES = "give seconds, datetime64, timedelta64, datetime or timedelta"


def _floats(name: str, x: ArrayLike) -> NDArray[np.float64]:
    if np.iscomplexobj(x):
        raise InputError("holds complex numbers, must be real", parameter=name)
    try:
        values: NDArray[np.float64] = column(x)
    except (TypeError, ValueError) as error:
        hint = _TIMES if name == "t" else None
        raise InputError(f"is not numbers: {error}", parameter=name, hint=hint) from None
    if values.ndim != 1 or np.ndim(x) != 1:
        raise InputError(f"has {np.ndim(x)} dimensions, must have one", parameter=name)
    finite = np.isfinite(values)  # an infinite value is none, as in a file
    return values if finite.all() else np.where(finite, values, np.nan)


def _flags(x: ArrayLike) -> NDArray[np.uint8]:
    values = _floats("flags", x)
    if wrong := values[~np.isin(values, np.arange(16))].tolist():
        bound = "a sum of 1 (not in automatic), 2 (bad), 4 (OP at its low limit), 8 (at its high limit)"
        raise InputError(f"is {wrong[0]:g}, must be {bound}", parameter="flags", value=wrong[0], bound=bound)
    return values.astype(np.uint8)
