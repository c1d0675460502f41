"""All measurements side by side; the table goes to the terminal and into bench/results/benchmarks.md.

Every figure is the best of several repetitions, and every ratio is taken within one run: other work on the machine
moves the rates, the ratios much less.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import numba
import numpy as np
from rich.console import Console
from rich.table import Table

import glapp
from glapp import _glapp

from . import page, signals
from .peers import arrays_pass, loop_pass

HERE = Path(__file__).parent
REFINERY = HERE.parents[1] / "shared" / "data" / "refinery"
N = 9
SETTINGS = (signals.K, signals.TI, signals.KP, signals.TF, N, 5.0, 100.0)
PUBLIC = ("stictionanalyser==0.0.10", "xmci==0.0.35", "numpy<2", "matplotlib<3.10")
"""The public programs, and the last versions of their dependencies that they still run with."""


@dataclass(frozen=True, slots=True)
class Row:
    """One line of the table; `holds` is None where there is no target."""

    work: str
    figure: str
    target: str = ""
    holds: bool | None = None


def best(run: Callable[[], object], repetitions: int = 9) -> float:
    """Shortest time [s]."""
    times = []
    for _ in range(repetitions):
        begun = time.perf_counter()
        run()
        times.append(time.perf_counter() - begun)
    return min(times)


def ratio(work: str, value: float, target: float, detail: str) -> Row:
    """A line with a ratio that must reach `target`."""
    return Row(work, f"{value:.2f} × ({detail})", f"≥ {target:g} ×", value >= target)


def detector() -> _glapp.Detector:
    """Ours, as the peers have it: PI, op span, no limits."""
    settings = {"k": signals.K, "ti": signals.TI, "kp": signals.KP, "tf": signals.TF, "n": N, "op_span": 100.0}
    return _glapp.Detector({**settings, "h": 1.0, "max_h": 5.0})


def one_loop(n: int) -> Iterator[Row]:
    """The detector alone against its peers."""
    compiled = numba.njit(error_model="numpy")(loop_pass.detect)
    plain_filter = loop_pass.median_mean
    for name, s in (("limit cycle", signals.cycle(n)), ("noise only", signals.noise(n))):
        for op in (None, s.op):
            ours = detector()
            ours.run(s.t, s.sp, s.pv, op, None)
            out = np.empty((len(ours.table()["d"]) + 1, loop_pass.COLUMNS))

            def in_numba(
                op: signals.Floats | None = op, out: signals.Floats = out, s: signals.BenchSignals = s
            ) -> object:
                reasons = np.zeros(10, np.int64)
                work = (np.zeros(N), np.zeros(N), np.zeros(N))
                return reasons, compiled(s.t, s.sp, s.pv, op, None, SETTINGS, work, reasons, out)

            loop_pass.median_mean = numba.njit(error_model="numpy")(plain_filter)
            reasons, (rows, estimate, _) = in_numba()  # type: ignore[misc]
            same(ours, reasons, estimate, exactly=True)
            if not np.array_equal(out[:rows, 14], ours.table()["d"]):
                raise AssertionError("numba gives other half-periods")
            times = [
                (best(lambda s=s, op=op: detector().run(s.t, s.sp, s.pv, op, None), 3), best(in_numba, 3))
                for _ in range(5)
            ]
            mine, theirs = (min(x) for x in zip(*times, strict=True))
            label = f"{name}{', with OP' if op is not None else ''}"
            detail = f"{n / mine / 1e6:.0f} against {n / theirs / 1e6:.0f} M samples/s"
            yield ratio(f"{label}: glapp / numba", theirs / mine, 1.0, detail)
        mine = best(lambda s=s: detector().run(s.t, s.sp, s.pv, None, None))
        ours = detector()
        ours.run(s.t, s.sp, s.pv, None, None)
        count, accepted, estimate = arrays_pass.detect(s.t, s.sp, s.pv, SETTINGS)
        same(ours, [accepted, count - accepted], estimate, exactly=False)
        theirs = best(lambda s=s: arrays_pass.detect(s.t, s.sp, s.pv, SETTINGS), 3)
        yield ratio(f"{name}: glapp / NumPy+SciPy", theirs / mine, 25, f"{n / theirs / 1e6:.1f} M samples/s")
        m = min(n, 300_000)
        lists = [x[:m].tolist() for x in (s.t, s.sp, s.pv)]
        loop_pass.median_mean = plain_filter
        table = [[0.0] * loop_pass.COLUMNS for _ in range(m // 5)]

        def in_python(lists: list[list[float]] = lists, table: list[list[float]] = table) -> object:
            reasons = [0] * 10
            return reasons, loop_pass.detect(
                *lists, None, None, SETTINGS, ([0.0] * N, [0.0] * N, [0.0] * N), reasons, table
            )

        ours = detector()
        ours.run(s.t[:m], s.sp[:m], s.pv[:m], None, None)
        reasons, (_, estimate, _) = in_python()  # type: ignore[misc]
        same(ours, reasons, estimate, exactly=True)
        theirs = best(in_python, 3) * n / m
        yield ratio(f"{name}: glapp / pure Python", theirs / mine, 40, f"{n / theirs / 1e6:.2f} M samples/s")


def same(ours: _glapp.Detector, reasons: object, estimate: float, *, exactly: bool) -> None:
    """Stop unless a peer found the same half-periods and the same estimate."""
    theirs = [int(x) for x in reasons]  # type: ignore[attr-defined]
    mine = ours.reasons if len(theirs) == 10 else [ours.reasons[0], sum(ours.reasons[1:])]
    value = float("nan") if ours.estimate is None else ours.estimate[0]
    if mine != theirs or not np.isclose(value, estimate, rtol=0.0 if exactly else 1e-9, equal_nan=True):
        raise AssertionError(f"a peer differs: {mine}, {value} against {theirs}, {estimate}")


def streaming() -> Iterator[Row]:
    """One sample a call from Python, and the size of the state."""
    s = signals.cycle(500_000)
    samples = list(zip(s.t.tolist(), s.sp.tolist(), s.pv.tolist(), strict=True))

    def run() -> None:
        update = glapp.Estimator(signals.loop(tf=signals.TF), 1.0).update
        for t, sp, pv in samples:
            update(t, sp, pv)

    rate = len(samples) / best(run, 5) / 1e6
    yield Row("one sample a call from Python", f"{rate:.1f} M samples/s", "≥ 2 M/s", rate >= 2)


def in_process(task: str, path: Path) -> tuple[float, float, str, int]:
    """Best time [s] and highest peak of memory [MiB] of a task in processes of its own."""
    runs = []
    for _ in range(3):
        command = [sys.executable, "-m", "bench.task", task, str(path)]
        runs.append(json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout))
    return min(r[0] for r in runs), max(r[1] for r in runs), runs[0][2], runs[0][3]


def parquet(folder: Path, rows: int) -> Iterator[Row]:
    """A long Parquet file of one loop."""
    path = folder / "FIC1.parquet"
    signals.write_parquet(path, rows)
    alone, peak, _, size = in_process("pyarrow_parquet", path)
    yield Row(
        f"Parquet, {rows / 1e6:.0f} M rows, {size / 1e9:.2f} GB: PyArrow decodes",
        f"{rows / alone / 1e6:.1f} M rows/s, {peak:.0f} MiB",
    )
    for task, target in (("estimate", 0.6), ("analyze", 0.3)):
        seconds, peak, answer, _ = in_process(task, path)
        row = ratio(
            f"  glapp.{task} / PyArrow", alone / seconds, target, f"{rows / seconds / 1e6:.1f} M rows/s, {answer}"
        )
        yield row
        yield Row(f"  glapp.{task}, peak memory", f"{peak:.0f} MiB", "< 1024 MiB", peak < 1024)
    path.unlink()


def text(folder: Path, size: int) -> Iterator[Row]:
    """A large CSV file."""
    path = folder / "FIC1.csv"
    rows = signals.write_csv(path, size)
    times = {task: in_process(task, path) for task in ("pandas_csv", "polars_csv", "pyarrow_csv", "analyze")}
    for name, (seconds, peak, answer, bytes_) in times.items():
        if name != "analyze":
            yield Row(
                f"CSV, {bytes_ / 1e9:.2f} GB, {rows / 1e6:.1f} M rows: {name.removesuffix('_csv')} reads",
                f"{bytes_ / seconds / 1e6:.0f} MB/s, {peak:.0f} MiB",
            )
        else:
            gain = times["pandas_csv"][0] / seconds
            yield ratio(
                "  glapp.analyze / pandas", gain, 1, f"{bytes_ / seconds / 1e6:.0f} MB/s, {peak:.0f} MiB, {answer}"
            )
    path.unlink()


def _analyze(path: str) -> str:
    return glapp.analyze(glapp.open_recordings(path, [signals.loop()])[0], fit=False).verdict


def fleet(folder: Path, count: int) -> Iterator[Row]:
    """Many recordings, one process a core."""
    signals.write_recordings(folder, count)
    paths = sorted(str(p) for p in folder.glob("FIC*.parquet"))
    with ProcessPoolExecutor() as pool:
        list(pool.map(_analyze, paths[:8]))  # the processes are up and have imported
        begun = time.perf_counter()
        verdicts = list(pool.map(_analyze, paths, chunksize=8))
        seconds = time.perf_counter() - begun
    yield Row(
        f"{count} recordings of a day (8640 rows), glapp.analyze on {os.cpu_count()} cores",
        f"{count / seconds:.0f} loops/s, {verdicts.count('estimate')} with an estimate",
    )


def public(folder: Path) -> Iterator[Row]:
    """The public programs on the same recordings, in an environment of their own."""
    recordings: list[tuple[Path, str]] = []
    for name, d in (("worn valve", 2.0), ("sound valve", 0.0)):
        simulated = glapp.simulate.closed_loop(
            "P3", (0.48, 0.3117, 0, 0), d=d, noise=0.02, h=0.05, t_end=400, load=[(100, 20.0)], filter_in_loop=True
        )
        path = folder / f"{name}.csv"
        simulated.write_csv(path)
        recordings.append((path, f"simulated, d = {d:g}"))
    recordings += [(REFINERY / f"{name}.csv", name) for name in ("FIC46005_0902", "LIC31102B_1127")]
    recordings = [r for r in recordings if r[0].exists()]
    controller = {"k": 0.48, "ti": 0.3117, "setpoint_weight": 0}
    for path, what in recordings:
        given = (
            {"controller": controller, "process": {"kp": 1.0}, "op_span": (-100, 100)} if "simulated" in what else {}
        )
        begun = time.perf_counter()
        loop = glapp.Loop.model_validate({"name": "loop", **given})
        result = glapp.analyze(glapp.open_recordings(path, [loop])[0], fit=False)
        seconds = time.perf_counter() - begun
        width = "" if result.d_hat is None else f", d̂ = {result.d_hat:.3g} {result.unit}"
        yield Row(f"{what}: glapp", f"{1e3 * seconds:.0f} ms: {result.verdict}{width}")
    python = folder / "venv" / "bin" / "python"
    subprocess.run([sys.executable, "-m", "venv", python.parents[1]], check=True)
    subprocess.run([python, "-m", "pip", "install", "--quiet", *PUBLIC], check=True)
    command = [python, HERE / "peers" / "public_programs.py", *(path for path, _ in recordings)]
    names = {path.stem: what for path, what in recordings}
    answers = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    for program, stem, seconds, answer in answers:
        yield Row(f"{names[stem]}: {program}", f"{1e3 * seconds:.0f} ms: {answer}")


def machine() -> str:
    """Processor and versions."""
    packages = ("numpy", "scipy", "numba", "pyarrow", "pandas", "polars")
    versions = ", ".join(f"{name} {version(name)}" for name in packages)
    return f"{page.processor()}; Python {platform.python_version()}, {versions}"


def write(sections: list[tuple[str, list[Row]]]) -> None:
    """Put the tables between the two marks in bench/results/benchmarks.md."""
    lines = [f"Measured on {machine()}.", ""]
    for title, rows in sections:
        lines += [f"### {title}", "", "| work | measured | target | |", "|---|---|---|---|"]
        mark = {None: "", True: "met", False: "missed"}
        lines += [f"| {r.work.strip()} | {r.figure} | {r.target} | {mark[r.holds]} |" for r in rows]
        lines.append("")
    page.write("benchmarks.md", "\n".join(lines))


def main() -> None:
    """Run the measurements of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rows", type=int, default=10_000_000, help="rows of the Parquet file")
    parser.add_argument("--csv-mb", type=int, default=200, help="size of the CSV file [MB]")
    parser.add_argument("--full", action="store_true", help="100 million rows, 1 GB of CSV")
    parser.add_argument("--public", action="store_true", help="the public programs too (installs them elsewhere)")
    args = parser.parse_args()
    rows, size = (100_000_000, 1_000_000_000) if args.full else (args.rows, args.csv_mb * 1_000_000)
    console = Console()
    sections: list[tuple[str, list[Row]]] = []
    folder = Path(tempfile.mkdtemp(prefix="glapp-bench-"))
    try:
        parts: list[tuple[str, Callable[[], Iterator[Row]]]] = [
            ("One loop, 10 M samples, float64", lambda: one_loop(10_000_000)),
            ("Streaming", streaming),
            ("Files", lambda: (row for part in (parquet(folder, rows), text(folder, size)) for row in part)),
            ("Many loops", lambda: fleet(folder, 1000)),
        ]
        if args.public:
            parts.append(("Public programs that claim the same job", lambda: public(folder)))
        for title, part in parts:
            table = Table("work", "measured", "target", "", title=title, title_justify="left")
            found = []
            for row in part():
                found.append(row)
                mark = {None: "", True: "[green]met", False: "[red]missed"}[row.holds]
                table.add_row(row.work, row.figure, row.target, mark)
            sections.append((title, found))
            console.print(table)
    finally:
        shutil.rmtree(folder)
    write(sections)


if __name__ == "__main__":
    main()
