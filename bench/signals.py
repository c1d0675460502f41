"""Signals and files that the bench runs on."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet
from numpy.typing import NDArray

import glapp

Floats = NDArray[np.float64]

K, TI, KP, TF = 0.5, 30.0, 1.0, 3.0
HALF_PERIOD = 300


@dataclass(frozen=True, slots=True)
class BenchSignals:
    """One loop, a sample a second."""

    t: Floats
    sp: Floats
    pv: Floats
    op: Floats


def cycle(n: int, start: int = 0) -> BenchSignals:
    """The limit cycle of a worn valve: PV square around SP, OP a triangle, with noise."""
    k = np.arange(start, start + n)
    rng = np.random.default_rng(start)
    phase = k % (2 * HALF_PERIOD)
    up = phase < HALF_PERIOD
    pv = np.where(up, 1.0, -1.0) + 0.3 * (2.0 * rng.random(n) - 1.0)
    travel = K / TI * np.where(up, phase, 2 * HALF_PERIOD - phase)
    return BenchSignals(k.astype(np.float64), np.zeros(n), pv, 50.0 - travel + 0.01 * rng.random(n))


def noise(n: int) -> BenchSignals:
    """Noise around SP without a signal: a crossing every ten samples or so."""
    rng = np.random.default_rng(1)
    pv = 2.0 * rng.random(n) - 1.0
    return BenchSignals(np.arange(n, dtype=np.float64), np.zeros(n), pv, 50.0 - K * pv)


def loop(**more: object) -> glapp.Loop:
    """The loop that the signals come from."""
    return glapp.Loop.model_validate(
        {"name": "FIC1", "controller": {"k": K, "ti": TI}, "process": {"kp": KP}, "op_span": (0, 100), **more}
    )


_START = np.datetime64(datetime(2024, 1, 1), "ms")
_PIECE = 1 << 20


def _times(s: BenchSignals) -> pa.Array:
    return pa.array(_START + (s.t * 1000).astype(np.int64), pa.timestamp("ms"))


def write_parquet(path: Path, rows: int) -> None:
    """Columns t, SP, PV, OP in zstd, as PyArrow writes them by itself, in row groups of 1 Mi rows."""
    schema = pa.schema([("t", pa.timestamp("ms")), ("SP", pa.float64()), ("PV", pa.float64()), ("OP", pa.float64())])
    with pyarrow.parquet.ParquetWriter(path, schema, compression="zstd") as writer:
        for start in range(0, rows, _PIECE):
            s = cycle(min(_PIECE, rows - start), start)
            writer.write_table(pa.table([_times(s), s.sp, s.pv, s.op], schema=schema))


def write_csv(path: Path, size: int) -> int:
    """Columns t (ISO), SP, PV, OP, MODE until the file has `size` bytes; gives the number of rows."""
    rows = 0
    schema = pa.schema(
        [
            ("t", pa.timestamp("ms")),
            ("SP", pa.float64()),
            ("PV", pa.float64()),
            ("OP", pa.float64()),
            ("MODE", "string"),
        ]
    )
    options = pyarrow.csv.WriteOptions(quoting_style="none")
    with path.open("wb") as file, pyarrow.csv.CSVWriter(file, schema, write_options=options) as writer:
        while file.tell() < size:
            s = cycle(_PIECE // 4, rows)
            mode = pa.repeat(pa.scalar("AUTO"), len(s.t))
            writer.write_table(pa.table([_times(s), s.sp, s.pv.round(4), s.op.round(4), mode], schema=schema))
            rows += len(s.t)
    return rows


def write_recordings(folder: Path, count: int) -> None:
    """A day at 10 s each, of loops that differ in their noise."""
    n = 8640
    for i in range(count):
        s = cycle(n, i * n)
        pyarrow.parquet.write_table(
            pa.table({"t": _times(s), "SP": s.sp, "PV": s.pv, "OP": s.op}), folder / f"FIC{i:04}.parquet"
        )
