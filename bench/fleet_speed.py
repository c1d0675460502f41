"""Speed of a fleet's crossings: `python -m bench.fleet_speed`.

- *In memory*: many loops of a day at one sample a second, one loop after the other, and side by side with every
  instruction set of this processor; beside them how fast memory is read.
- *From Parquet* (zstd, a file a loop): `glapp.fleet.crossings` beside PyArrow, which decodes the same columns and looks
  at none of them, Polars + NumPy, DuckDB + Python, and Spark with a pandas UDF in plain NumPy.

Rates are by processor time, which other work on the machine moves least; where it is by the clock, it is told. `--docs`
writes the tables into bench/results/fleet.md.
"""

from __future__ import annotations

import argparse
import ctypes
import os
import platform
import resource
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from datetime import datetime, timedelta
from functools import partial
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from rich.console import Console

import glapp
from glapp import _glapp, fleet

from . import signals
from .page import write
from .peers import arrays_pass, loop_pass
from .run import SETTINGS, N, machine
from .task import peak

DAY = 86_400
NAMES = {"time": "t", "SP": "SP", "PV": "PV"}
COLUMNS = list(NAMES.values())
CORES = os.cpu_count() or 1

Columns = tuple[signals.Floats, signals.Floats, signals.Floats, None]


def best(run: Callable[[], object], repetitions: int) -> float:
    """Shortest processor time [s]."""
    times = []
    for _ in range(repetitions):
        begun = time.process_time()
        run()
        times.append(time.process_time() - begun)
    return min(times)


def keep_memory() -> None:
    """Keep freed memory in this process, so that pages for a gigabyte of half-periods are not cleared anew."""
    with suppress(AttributeError, OSError):  # not with every C library
        libc = ctypes.CDLL(None)
        for threshold, size in ((-1, (1 << 31) - 1), (-3, 1 << 25)):  # M_TRIM_THRESHOLD, M_MMAP_THRESHOLD
            libc.mallopt(threshold, size)


def detectors(count: int) -> list[_glapp.Detector]:
    """The given number of detectors, at their beginning."""
    settings = {"k": signals.K, "ti": signals.TI, "kp": signals.KP, "tf": signals.TF, "n": N, "op_span": 100.0}
    return [_glapp.Detector({**settings, "h": 1.0, "max_h": 5.0}) for _ in range(count)]


def in_memory(loops: int) -> Iterator[tuple[str, ...]]:
    """One loop after the other, and side by side."""
    keep_memory()
    big = np.ones(1 << 27)
    memory = big.nbytes / best(partial(np.add.reduce, big), 5) / 1e9
    del big
    yield "memory is read", f"{memory:.1f} GB/s: {memory * 1e3 / 24:.0f} M samples/s of time, SP and PV", ""
    for name, make in (("limit cycles", signals.cycle), ("noise only", signals.noise)):
        few = [make(DAY)] * 16 if make is signals.noise else [signals.cycle(DAY, i * DAY) for i in range(16)]
        every = [(s.t.copy(), s.sp.copy(), s.pv.copy(), None) for s in (few[i % 16] for i in range(loops))]

        def alone(ours: list[_glapp.Detector], every: list[Columns] = every) -> None:
            for one, columns in zip(ours, every, strict=True):
                one.run(*columns, None)

        one_by_one, answers = measured(loops, alone)
        yield f"{name}, one loop after the other", f"{loops * DAY / one_by_one / 1e6:.0f} M samples/s", "1"
        for instructions in _glapp.instruction_sets():
            together = partial(_glapp.run_side_by_side, signals=every, instructions=instructions)
            seconds, theirs = measured(loops, together)
            if theirs != answers:
                raise AssertionError(f"other bits with {instructions}")
            rate = f"{loops * DAY / seconds / 1e6:.0f} M samples/s"
            yield f"{name}, eight side by side, {instructions}", rate, f"{one_by_one / seconds:.2f}"


def measured(loops: int, run: Callable[[list[_glapp.Detector]], object]) -> tuple[float, list[str]]:
    """Shortest of three times [s], and the states in the end."""
    seconds = float("inf")
    for _ in range(3):
        ours = detectors(loops)
        begun = time.process_time()
        run(ours)
        seconds = min(seconds, time.process_time() - begun)
    return seconds, [one.save() for one in ours]


def write_day(folder: Path, loops: int, day: int) -> list[Path]:
    """A file a loop: time [ms], SP and PV of one day, in zstd as PyArrow writes it by itself."""
    folder.mkdir(parents=True, exist_ok=True)
    schema = pa.schema([("t", pa.timestamp("ms")), ("SP", pa.float64()), ("PV", pa.float64())])

    def one(i: int) -> Path:
        s = signals.cycle(DAY, day * DAY)
        pv = np.roll(s.pv, 37 * i)
        t = pa.array(np.datetime64("2024-01-01", "ms") + ((s.t) * 1000).astype(np.int64))
        path = folder / f"FIC{i:04}.parquet"
        pq.write_table(pa.table([t, s.sp, pv], schema=schema), path, compression="zstd")
        return path

    with ThreadPoolExecutor(CORES) as pool:
        return list(pool.map(one, range(loops)))


def estimators(loops: int) -> dict[str, glapp.Estimator]:
    """The given number of estimators, each by the name of its loop, at their beginning."""
    loop = signals.loop(tf=signals.TF)
    return {f"FIC{i:04}": glapp.Estimator(loop, 1.0) for i in range(loops)}


def decode(path: Path) -> int:
    """PyArrow decodes the columns in batches, and looks at none of them."""
    rows = 0
    with pq.ParquetFile(path, pre_buffer=False) as file:
        for batch in file.iter_batches(65536, columns=COLUMNS, use_threads=False):
            rows += batch.num_rows
    return rows


def polars_numpy(path: Path) -> tuple[int, int, float]:
    """Polars reads, NumPy and SciPy make the crossings."""
    import polars as pl

    frame = pl.read_parquet(path, columns=COLUMNS)
    t = frame["t"].to_physical().to_numpy() / 1e3
    return arrays_pass.detect(t - t[0], frame["SP"].to_numpy(), frame["PV"].to_numpy(), SETTINGS)


def duckdb_python(path: Path) -> object:
    """DuckDB reads, the detector's pass in plain Python makes the crossings."""
    import duckdb

    found = (
        duckdb.connect(config={"threads": 1})
        .execute(f"SELECT epoch(t) AS t, SP, PV FROM '{path}' ORDER BY t")
        .fetchnumpy()
    )
    t, sp, pv = (np.asarray(found[name], float) for name in ("t", "SP", "PV"))
    out = [[0.0] * loop_pass.COLUMNS for _ in range(len(t) // 5)]
    work = ([0.0] * N, [0.0] * N, [0.0] * N)
    return loop_pass.detect((t - t[0]).tolist(), sp.tolist(), pv.tolist(), None, None, SETTINGS, work, [0] * 10, out)


def pool(run: Callable[[Path], object], paths: Sequence[Path], threads: int) -> tuple[float, float]:
    """Seconds for all files on so many threads, by the clock and of the processor."""
    with ThreadPoolExecutor(threads) as workers:
        begun, used = time.perf_counter(), time.process_time()
        list(workers.map(run, paths))
        return time.perf_counter() - begun, time.process_time() - used


def ours(
    paths: Sequence[Path], loops: dict[str, glapp.Estimator], threads: int, days_later: int = 0
) -> tuple[float, float, pa.Table]:
    """Seconds of `glapp.fleet.crossings`, clock and processor, and its table; files may count as a later day's."""
    files: dict[str, list[str | Path]] = {path.stem: [path] for path in paths}
    begun, used = time.perf_counter(), time.process_time()
    found = fleet.crossings(files, NAMES, loops, since=datetime(2024, 1, 1) - timedelta(days_later), threads=threads)
    took = time.perf_counter() - begun, time.process_time() - used
    if found.column("problem").null_count != len(found):
        raise AssertionError(found.column("problem").drop_null()[0])
    return *took, found


def from_parquet(folder: Path, loops: int) -> Iterator[tuple[str, ...]]:
    """A day of many loops from files that the system has in memory."""
    paths = write_day(folder, loops, 0)
    rows, size = loops * DAY, sum(path.stat().st_size for path in paths)
    yield f"{loops} files, {rows / 1e6:.1f} M rows, {size / 1e9:.2f} GB", "", ""
    decoded = 0.0
    for threads in sorted({1, CORES}):
        threads_text = f"{threads} thread{'s' * (threads > 1)}"
        clock, decoded = (min(times) for times in zip(*(pool(decode, paths, threads) for _ in range(3)), strict=True))
        yield f"PyArrow decodes, {threads_text}", f"{_rates(rows, decoded, clock)}", "1"
        runs = [ours(paths, estimators(loops), threads) for _ in range(3)]
        mine = min(run[0] for run in runs), min(run[1] for run in runs)
        yield f"`glapp.fleet.crossings`, {threads_text}", _rates(rows, mine[1], mine[0]), f"{decoded / mine[1]:.2f}"
    found = runs[0][2]
    clock, seconds = pool(polars_numpy, paths, CORES)
    theirs = [polars_numpy(path)[1] for path in paths[:8]]
    if theirs != found.column("accepted").to_pylist()[:8]:
        raise AssertionError(f"Polars + NumPy find {theirs}")
    yield "Polars + NumPy", _rates(rows, seconds, clock), f"{decoded / seconds:.2f}"
    few = paths[:2]
    clock, seconds = pool(duckdb_python, few, 1)
    part = len(few) / loops
    yield f"DuckDB + Python, {len(few)} files", _rates(part * rows, seconds, clock), f"{part * decoded / seconds:.4f}"
    if shutil.which("java"):
        clock = spark(folder)
        yield f"Spark, pandas UDF in NumPy, {CORES} cores, the session up", f"{rows / clock / 1e6:.1f} by the clock", ""


def _rates(rows: float, seconds: float, clock: float) -> str:
    return f"{rows / seconds / 1e6:.3g} M rows/s; {rows / clock / 1e6:.3g} by the clock"


def spark(folder: Path) -> float:
    """Seconds that Spark takes for all files."""
    import pandas as pd
    from pyspark.sql import SparkSession
    from pyspark.sql.functions import input_file_name

    os.environ["PYSPARK_PYTHON"] = sys.executable  # the workers import what we do
    session = (
        SparkSession.builder.master(f"local[{CORES}]")
        .config("spark.ui.enabled", "false")
        .config("spark.driver.bindAddress", "127.0.0.1")
        .config("spark.driver.host", "127.0.0.1")
        .config("spark.driver.memory", "3g")
        .config("spark.sql.execution.arrow.pyspark.enabled", "true")
        .config("spark.sql.shuffle.partitions", str(4 * CORES))
        .config("spark.log.level", "ERROR")
        .getOrCreate()
    )

    def of_loop(frame: pd.DataFrame) -> pd.DataFrame:
        frame = frame.sort_values("t")
        t = frame["t"].to_numpy("datetime64[ms]").astype(float) / 1e3
        count, accepted, estimate = arrays_pass.detect(
            t - t[0], frame["SP"].to_numpy(), frame["PV"].to_numpy(), SETTINGS
        )
        return pd.DataFrame({"file": frame["file"][:1], "count": [count], "accepted": [accepted], "d_hat": [estimate]})

    try:
        session.range(10).count()
        begun = time.perf_counter()
        rows = session.read.parquet(str(folder)).withColumn("file", input_file_name())
        found = rows.groupBy("file").applyInPandas(of_loop, "file string, count long, accepted long, d_hat double")
        found.collect()
        return time.perf_counter() - begun
    finally:
        session.stop()


def main() -> None:
    """Measure the cases of the command line."""
    asked = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    asked.add_argument("--loops", type=int, default=1000, help="in memory")
    asked.add_argument("--files", type=int, default=200, help="loops of a day, from Parquet")
    asked.add_argument("--docs", action="store_true", help="write bench/results/fleet.md")
    given = asked.parse_args()
    folder = Path(tempfile.mkdtemp(prefix="glapp-fleet-"))
    lines = [f"{machine()}, DuckDB {version('duckdb')}, PySpark {version('pyspark')}, {platform.system()}.", ""]
    try:
        for title, third, part in (
            (f"In memory: {given.loops} loops × {DAY} samples, float64, one core", "ratio", in_memory(given.loops)),
            ("From Parquet", "to PyArrow", from_parquet(folder / "day", given.files)),
        ):
            lines += [f"| {title} | | {third} |", "|---|---|---|"]
            for row in part:
                Console().print(*row, sep=" | ", markup=False)
                lines.append(f"| {' | '.join(row)} |")
            lines += [f"| highest memory of this process so far | {peak():.0f} MiB | |", ""]
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    used = resource.getrusage(resource.RUSAGE_SELF)
    Console().print(f"processor time {used.ru_utime + used.ru_stime:.0f} s", markup=False)
    if given.docs:
        write("fleet.md", "\n".join(lines), mark="speed")


if __name__ == "__main__":
    main()
