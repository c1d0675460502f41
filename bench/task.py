"""One task of the bench in a process of its own: JSON with its seconds and its peak of resident memory [MiB]."""

from __future__ import annotations

import importlib
import json
import resource
import sys
import time
from pathlib import Path

PARQUET_BATCH = 65536

IMPORTS = {
    "pyarrow_parquet": ("pyarrow.parquet",),
    "pyarrow_csv": ("pyarrow.csv",),
    "pandas_csv": ("pandas",),
    "polars_csv": ("polars",),
}
"""Imports of a task before the clock starts; glapp's tasks import glapp."""


def pyarrow_parquet(path: str) -> str:
    """Decode the columns in batches, and look at none of them."""
    import pyarrow.parquet as pq

    rows = 0
    with pq.ParquetFile(path, pre_buffer=False, buffer_size=1 << 20) as file:
        for batch in file.iter_batches(PARQUET_BATCH, columns=["t", "SP", "PV", "OP"]):
            rows += batch.num_rows
    return f"{rows} rows"


def pandas_csv(path: str) -> str:
    """Read with the C engine, times as text."""
    import pandas as pd

    return f"{len(pd.read_csv(path, engine='c'))} rows"


def polars_csv(path: str) -> str:
    """Read, times as text."""
    import polars as pl

    return f"{len(pl.read_csv(path))} rows"


def pyarrow_csv(path: str) -> str:
    """Read, times parsed."""
    import pyarrow.csv

    return f"{len(pyarrow.csv.read_csv(path))} rows"


def _glapp(path: str, judge: bool) -> str:
    import glapp

    from . import signals

    recording = glapp.open_recordings(path, [signals.loop(tf=signals.TF)])[0]
    result = glapp.analyze(recording, fit=False) if judge else glapp.estimate(recording)
    return f"{result.verdict}, {result.detections} detections"


def estimate(path: str) -> str:
    """`glapp.estimate`, all settings given."""
    return _glapp(path, judge=False)


def analyze(path: str) -> str:
    """`glapp.analyze`, all settings given."""
    return _glapp(path, judge=True)


def peak() -> float:
    """Highest resident memory of this process [MiB]; getrusage would count that of the parent before exec too."""
    status = Path("/proc/self/status")
    if status.exists():
        return int(status.read_text().split("VmHWM:")[1].split()[0]) / 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1 << 20)  # bytes on macOS


def main() -> None:
    """Run the task named on the command line once."""
    name, path = sys.argv[1:]
    for module in IMPORTS.get(name, ("glapp", "bench.signals")):
        importlib.import_module(module)
    task = {f.__name__: f for f in (pyarrow_parquet, pandas_csv, polars_csv, pyarrow_csv, estimate, analyze)}[name]
    begun = time.perf_counter()
    answer = task(path)
    seconds = time.perf_counter() - begun
    print(json.dumps([seconds, peak(), answer, Path(path).stat().st_size]))


if __name__ == "__main__":
    main()
