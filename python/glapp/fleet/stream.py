"""Crossings of many loops straight from their files, as fast as these can be decoded."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path

import pyarrow as pa

from .. import _glapp
from ..errors import InputError
from ..estimate import Estimator
from ..result import REASONS

__all__ = ["CROSSINGS", "crossings"]

CROSSINGS = pa.schema(
    [
        ("loop", pa.string()),
        ("rows", pa.int64()),
        ("half_periods", pa.int64()),
        *((reason, pa.int64()) for reason in REASONS),
        ("d_hat", pa.float64()),
        ("low", pa.float64()),
        ("high", pa.float64()),
        ("noise_floor", pa.float64()),
        ("file", pa.string()),
        ("row", pa.int64()),
        ("problem", pa.string()),
    ]
)
"""A row a loop: rows read now; half-periods since the detector began, all and by their first reason; the estimate with
the smallest and the largest of the last N detections, and the noise limit [OP unit]; what was wrong with its files."""


def crossings(
    files: Mapping[str, Sequence[str | Path]],
    columns: Mapping[str, str],
    loops: Mapping[str, Estimator],
    *,
    since: datetime | None = None,
    threads: int | None = None,
) -> pa.Table:
    """Run the detectors of many loops over their Parquet files; they are then behind the last row, and can go on.

    Rows go from the files into the lanes of the processor, eight loops at once on each thread. Of a column a page and
    some thousand rows are in memory, however long the files are, and of half-periods no more than their counts and the
    estimate. The bits are those of `Estimator.update_many` over all rows, whatever the number of threads.

    Parameters
    ----------
    files : mapping
        Loop to its files. One after the other their rows are in the order of time, each moment once.
    columns : mapping
        `time` (timestamps, or seconds), `SP`, `PV` and, where it is recorded, `OP` to the name of its column; `{loop}`
        in a name is replaced by that of the loop. Values are numbers; one that is missing is a bad value.
    loops : mapping
        Loop to its detector: at the beginning, or where files that were read before ended.
    since : datetime, optional
        From when on the seconds of timestamps are counted, in UTC where it has no zone; else from the first row of each
        loop.
        Detectors that are to go on need the same at each call.
    threads : int, optional
        As many as there are cores where it is not given.

    Returns
    -------
    pyarrow.Table
        One row of `CROSSINGS` per loop, in the order of `loops`. Where files cannot be read, `problem` says why and the
        detector is as it was.

    Raises
    ------
    InputError
        Where a loop has no files, or a column that is needed is not named.

    Notes
    -----
    It knows no quality and no mode, and reads no file in another order than it has: `glapp fleet analyze` does.

    Examples
    --------
    >>> import glapp, numpy as np, pyarrow.parquet as pq, tempfile
    >>> from glapp import fleet
    >>> t = np.arange(800)
    >>> pv = np.where(t // 100 % 2 == 0, -1.0, 1.0)
    >>> path = Path(tempfile.mkdtemp()) / "FIC1.parquet"
    >>> pq.write_table(pa.table({"t": t.astype("datetime64[s]"), "SP": 0.0 * pv, "PV": pv}), path)
    >>> loop = glapp.Loop(name="FIC1", controller={"k": 0.5, "ti": 10}, process={"kp": 2}, n=3, tf=0.001)
    >>> names = {"time": "t", "SP": "SP", "PV": "PV"}
    >>> found = fleet.crossings({"FIC1": [path]}, names, {"FIC1": glapp.Estimator(loop, h=1.0)})
    >>> found.select(["loop", "rows", "accepted"]).to_pylist()
    [{'loop': 'FIC1', 'rows': 800, 'accepted': 5}]
    >>> round(found["d_hat"][0].as_py(), 2)  # %OP
    4.5
    """
    if missing := [name for name in ("time", "SP", "PV") if name not in columns]:
        raise InputError("is not named", parameter=f"columns[{missing[0]!r}]", hint="name the column that holds it")
    places = []
    for name in loops:
        if name not in files:
            raise InputError("has no files", loop=name, parameter="files", hint="name them, or leave the loop out")
        time, sp, pv = (columns[of].replace("{loop}", name) for of in ("time", "SP", "PV"))
        op = columns["OP"].replace("{loop}", name) if "OP" in columns else None
        places.append((list(files[name]), (time, sp, pv, op)))
    # Eight loops run side by side; they stay together longest where their files are of about the same size.
    order = sorted(range(len(places)), key=lambda i: sum(map(_size, places[i][0])))
    names, detectors = list(loops), [one._detector for one in loops.values()]
    threads = threads or os.cpu_count() or 1
    begin = None if since is None else round((since if since.tzinfo else since.replace(tzinfo=UTC)).timestamp() * 1e6)
    read = _glapp.run_lake([detectors[i] for i in order], [places[i] for i in order], threads, begin)
    read_of = dict(zip(order, read, strict=True))
    return pa.Table.from_pylist(
        [_row(names[i], detectors[i], *read_of[i]) for i in range(len(names))], schema=CROSSINGS
    )


def _size(file: str | Path) -> int:
    path = Path(file)
    return path.stat().st_size if path.exists() else 0


def _row(
    loop: str, detector: _glapp.Detector, rows: int, fault: tuple[Path, int | None, str] | None
) -> dict[str, object]:
    """A row of `CROSSINGS`."""
    value, low, high, *_ = detector.estimate or (None, None, None)
    file, row, problem = fault or (None, None, None)
    return {
        "loop": loop,
        "rows": rows,
        "half_periods": sum(detector.reasons),
        **dict(zip(REASONS, detector.reasons, strict=True)),
        "d_hat": value,
        "low": low,
        "high": high,
        "noise_floor": detector.noise_floor,
        "file": None if file is None else str(file),
        "row": row,
        "problem": problem,
    }
