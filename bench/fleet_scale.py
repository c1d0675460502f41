"""The fleet as it grows: `python -m bench.fleet_scale giant|ladder|month|spark`.

`giant` has one loop with many rows in one group of rows, and tells the memory of the largest process. `ladder` judges
the demonstration's mill with 1×, 2× and 4× as many loops. `month` follows the crossings of `--loops` loops at 1 s
over `--days` days: files are made, taken in and removed; then the whole analysis judges two days of `--judged` loops
of the demonstration, kept at 1 s. `spark` judges a lake on a cluster of two workers on this machine and, in a second
run, kills the process of one of them as it works; the tables must be those of a run without Spark. Times are of the
processor, of all processes together, where it is not said otherwise: others use the machine.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from glapp import _glapp, fleet
from glapp.fleet import demo
from glapp.fleet.windows import FITS

from .fleet import OUT
from .fleet_speed import COLUMNS, CORES, DAY, decode, detectors, estimators, ours, pool, write_day
from .task import peak

ALIKE = 6
"""Days of a month that have the same files."""

_RUN = """
import json, resource, sys, time
from glapp import fleet
if __name__ == "__main__":
    begun, parts = time.monotonic(), {}
    def stage(name, total, done):
        parts[name] = round(time.monotonic() - begun, 1)
    made = fleet.analyze(sys.argv[1], sys.argv[2], fits=int(sys.argv[3]), stage=stage)
    known = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    cpu = sum(one.ru_utime + one.ru_stime for one in known)
    usage = dict(folder=made["folder"], cpu=cpu, memory=max(one.ru_maxrss for one in known) / 1024, parts=parts)
    print(json.dumps(usage | {"seconds": made["seconds"]}))
"""

_SPARK = """
import os, sys
from pyspark.sql import SparkSession
from glapp import fleet
from glapp.fleet import spark as engine
engine.GROUP = int(sys.argv[3])
spark = (SparkSession.builder.master("local-cluster[2,1,1024]").config("spark.ui.enabled", False)
    .config("spark.driver.bindAddress", "127.0.0.1").config("spark.driver.host", "127.0.0.1")
    .config("spark.sql.shuffle.partitions", 4).config("spark.executorEnv.PYTHONPATH", os.environ["PYTHONPATH"])
    .getOrCreate())
spark.range(2).repartition(2).count()  # the workers are there
print("begun", flush=True)
made = fleet.analyze(sys.argv[1], sys.argv[2], fits=1, engine="spark")
print(made["folder"], made["seconds"], flush=True)
spark.stop()
"""


def main() -> None:
    """Measure the cases of the command line."""
    asked = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    asked.add_argument("what", choices=("giant", "ladder", "month", "spark"))
    asked.add_argument("--rows", type=int, default=10_000_000)
    asked.add_argument("--loops", type=int, default=10)
    asked.add_argument("--days", type=int, default=1)
    asked.add_argument("--kills", type=int, default=1)
    asked.add_argument("--judged", type=int, default=20)
    given = asked.parse_args()
    OUT.mkdir(parents=True, exist_ok=True)
    if given.what == "giant":
        giant(given.rows)
    elif given.what == "ladder":
        ladder(given.loops, given.days)
    elif given.what == "month":
        month(given.loops, given.days)
        judged(given.judged, 2)
    else:
        on_spark(given.loops, given.days, given.kills)


def run(lake: Path, out: Path, fits: int = 1, anew: bool = True) -> dict[str, Any]:
    """A run in a separate process, from its beginning where it is to be made `anew`: its cost."""
    if anew:
        shutil.rmtree(out, ignore_errors=True)
    script = OUT / "scale.py"
    script.write_text(_RUN)
    made = subprocess.run(
        [sys.executable, str(script), str(lake), str(out), str(fits)], check=True, capture_output=True, text=True
    )
    return dict(json.loads(made.stdout.splitlines()[-1]))


def giant(rows: int) -> None:
    """One loop with so many rows at 0.25 s, in one group of rows."""
    lake = OUT / f"giant-{rows}"
    if not (path := lake / "loop=FIC1" / "all.parquet").exists():
        path.parent.mkdir(parents=True)
        k = np.arange(rows)
        wave = np.where(k // 1660 % 2 == 0, 1.0, -1.0)
        noise = np.random.default_rng(1).uniform(-0.05, 0.05, rows)
        time_of = pa.array(1_772_409_600_000_000 + 250_000 * k).cast(pa.timestamp("us", tz="UTC"))
        columns = {"SP": np.full(rows, 50.0), "PV": 50 + wave + noise, "OP": np.round(40 - wave * (k % 1660) / 600, 2)}
        pq.write_table(pa.table({"time": time_of, **columns}), path, row_group_size=rows, compression="zstd")
        (lake / "loops.toml").write_text(
            "[loops.FIC1]\npv_span = [0, 100]\nop_span = [0, 100]\ncontroller = { k = 1.0, ti = 60.0 }\n"
        )
        del k, wave, noise, time_of, columns
    found = run(lake, OUT / "giant")
    crossings = fleet.read(OUT / "giant", "crossings").to_pylist()
    print(
        f"{rows / 1e6:.0f} M rows in one group of {path.stat().st_size / 1e6:.0f} MB: {found['cpu']:.0f} s of the "
        f"processor ({rows / found['cpu'] / 1e6:.2f} M rows/s), the largest process {found['memory']:.0f} MB; "
        f"{len(crossings)} pieces, {crossings[-1]['detections']} detections, {crossings[-1]['crossings']}; "
        f"{found['parts']}"
    )


def ladder(loops: int, days: int) -> None:
    """1×, 2× and 4× as many loops."""
    for n in (loops, 2 * loops, 4 * loops):
        lake = OUT / f"ladder-{n}-{days}"
        if not (lake / "_truth" / "problems.parquet").exists():
            shutil.rmtree(lake, ignore_errors=True)
            fleet.make_demo(lake, loops=n, days=days)
        found = run(lake, OUT / "ladder")
        print(
            f"{n} loops, {days} days: {found['cpu']:.1f} s of the processor, {found['cpu'] / n:.2f} s a loop; "
            f"{found['seconds']:.0f} s by the clock, {found['parts']}; the largest process {found['memory']:.0f} MB",
            flush=True,
        )


def month(loops: int, days: int) -> None:
    """Crossings day by day, the detectors carried on.

    The loops of a day have the same limit cycle, each at another place of it. Files take longer to make than to take
    in, so those of a day stand for as many days as `ALIKE` says.
    """
    folder, every = OUT / "month", estimators(loops)
    clock = crossed = made = decoded = in_memory = size = 0.0
    paths: list[Path] = []
    for day in range(days):
        if day % ALIKE == 0:
            shutil.rmtree(folder, ignore_errors=True)
            begun = time.process_time()
            paths = write_day(folder, loops, day)
            made += time.process_time() - begun
        if not day:
            decoded, in_memory = pool(decode, paths, CORES)[1], loops / len(paths[:16]) * _side_by_side(paths[:16])
        size += sum(path.stat().st_size for path in paths)
        by_clock, used, _ = ours(paths, every, CORES, days_later=day % ALIKE)
        clock, crossed = clock + by_clock, crossed + used
    shutil.rmtree(folder)
    rows = loops * days * DAY
    print(
        f"{loops} loops, {days} days: {rows / 1e6:.0f} M rows, {size / 1e9:.1f} GB, made in {made:.0f} s; crossings "
        f"{crossed:.0f} s of the processor ({rows / crossed / 1e6:.1f} M rows/s), {clock:.0f} s by the clock; "
        f"PyArrow decodes a day in {decoded:.2f} s, crossings in memory take {in_memory:.2f} s of "
        f"{crossed / days:.2f} s a day; this process {peak():.0f} MiB",
        flush=True,
    )


def _side_by_side(paths: list[Path]) -> float:
    """Processor time of the crossings of files that are in memory [s]."""
    read = (pq.read_table(path, columns=COLUMNS) for path in paths)
    arrays = [[table[name].cast(pa.float64()).to_numpy() for name in COLUMNS[1:]] for table in read]
    signals = [(np.arange(float(len(sp))), sp, pv, None) for sp, pv in arrays]
    begun = time.process_time()
    _glapp.run_side_by_side(detectors(len(paths)), signals)
    return time.process_time() - begun


def judged(loops: int, days: int) -> None:
    """The whole analysis: what looks and crossings take a loop and day, and the fits a loop."""
    lake, out = OUT / f"second-{loops}-{days}", OUT / "second"
    if not (lake / "_truth" / "problems.parquet").exists():
        shutil.rmtree(lake, ignore_errors=True)
        demo.STEP = 1
        fleet.make_demo(lake, loops=loops, days=days)
    one = run(lake, out)
    few = fleet.manifest(out)["tables"]["windows"]["rows"]
    every = run(lake, out, FITS, anew=False)  # the days are there
    known = fleet.read(out, "days")
    windows = fleet.manifest(out)["tables"]["windows"]["rows"]
    a_window = every["cpu"] / windows
    print(
        f"{len(known)} days of {loops} loops, {sum(known['rows'].to_pylist()) / 1e6:.1f} M rows: "
        f"{one['cpu'] - few * a_window:.0f} s of the processor without the fits; {windows} windows "
        f"{every['cpu']:.0f} s, {a_window:.2f} s each with all that a second run asks; "
        f"the largest process {max(one['memory'], every['memory']):.0f} MB",
        flush=True,
    )


def on_spark(loops: int, days: int, kills: int) -> None:
    """One lake analysed without Spark, on two workers, and on two workers of which one is killed."""
    lake = OUT / f"spark-{loops}-{days}"
    if not (lake / "_truth" / "problems.parquet").exists():
        shutil.rmtree(lake, ignore_errors=True)
        fleet.make_demo(lake, loops=loops, days=days)
    wanted = run(lake, OUT / "spark-none")
    print(f"without Spark: {wanted['cpu']:.1f} s of the processor, {wanted['seconds']:.0f} s by the clock", flush=True)
    for killed in range(kills + 1):
        measured, cpu, gone = _on_two_workers(lake, killed)
        same = "the same tables" if measured[0] == wanted["folder"] else "OTHER TABLES"
        more = (cpu - wanted["cpu"]) / loops
        print(
            f"two workers, {gone} killed: {same}; {cpu:.1f} s of the processor, {more:.2f} s more a loop; "
            f"{float(measured[1]):.0f} s by the clock",
            flush=True,
        )


def _on_two_workers(lake: Path, kill: int) -> tuple[list[str], float, int]:
    """A run on a local cluster; `kill`: from the how manieth second on a worker is killed, 0 for none."""
    out = OUT / "spark-two"
    shutil.rmtree(out, ignore_errors=True)
    script = OUT / "spark.py"
    script.write_text(_SPARK)
    env = {**os.environ, "PYSPARK_PYTHON": sys.executable}
    work = subprocess.Popen(
        [sys.executable, str(script), str(lake), str(out), "20000"], stdout=subprocess.PIPE, text=True, env=env
    )
    gone: list[int] = []

    def strike() -> None:
        while work.poll() is None and not gone:
            time.sleep(3.0 * kill)
            for pid in _executors(work.pid)[:1]:
                os.kill(pid, signal.SIGKILL)
                gone.append(pid)

    assert work.stdout is not None
    last, cpu = "", 0.0
    for line in work.stdout:
        if line.startswith("begun"):
            cpu = -_processor(work.pid)
            if kill:
                threading.Thread(target=strike, daemon=True).start()
        elif line.startswith("tables-"):
            last, cpu = line, cpu + _processor(work.pid)
    if work.wait():
        raise SystemExit("the run on Spark failed")
    return last.split(), cpu, len(gone)


def _executors(root: int) -> list[int]:
    """Spark's workers below a process."""
    return [pid for pid in _below(root) if b"CoarseGrainedExecutorBackend" in _of(pid, "cmdline")]


def _processor(root: int) -> float:
    """Processor time of a process and of all below it, with those that they have waited for [s]."""
    ticks = (_of(pid, "stat").rpartition(b")")[2].split()[11:15] for pid in _below(root))
    return sum(int(t) for four in ticks for t in four) / os.sysconf("SC_CLK_TCK")


def _below(root: int) -> list[int]:
    pids = [int(path.name) for path in Path("/proc").glob("[0-9]*")]
    parents = {pid: int(fields.split()[1]) for pid in pids if (fields := _of(pid, "stat").rpartition(b")")[2])}

    def below(pid: int) -> bool:
        while pid in parents and pid != root:
            pid = parents[pid]
        return pid == root

    return sorted(pid for pid in parents if below(pid))


def _of(pid: int, name: str) -> bytes:
    """Usage of a process; nothing where it is gone."""
    try:
        return Path(f"/proc/{pid}/{name}").read_bytes()
    except OSError:
        return b""


if __name__ == "__main__":
    main()
