"""Fuzzer of the Arrow and Parquet readers: a damaged file gives batches or one InputError line, and never ends a run.

Whole files are damaged, a byte here or a length there, and go through the same functions as `glapp analyze --no-fit`.
The libraries that read them are C++, so all of it happens in a process of its own, and what ends that process by a
signal, takes longer than `PATIENCE` or raises anything but an InputError is a failure. Run as::

    python fuzz/read_tables.py --files 2000                   # of each kind: Arrow file, Arrow stream, Parquet
    python fuzz/read_tables.py --files 100 --command-line     # the same, each a `glapp analyze` of its own
    python fuzz/read_tables.py --kind parquet --seed 7 --keep failed/
"""

from __future__ import annotations

import argparse
import io
import json
import queue
import shutil
import subprocess
import sys
import tempfile
import threading
import traceback
import warnings
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.ipc as ipc
import pyarrow.parquet as pq

KINDS = ("arrow", "stream", "parquet")
PATIENCE = 60.0
"""Seconds that one file may take."""

SETTINGS = {"controller": {"k": 0.8, "ti": 25.0, "gain_unit": "OP/PV"}}
OPTIONS = ("--k", "0.8", "--ti", "25", "--gain-unit", "OP/PV")
ROWS = 240
_TIMES = np.datetime64("2024-01-01T00:00:00", "ms") + np.arange(ROWS) * np.timedelta64(1000, "ms")


def _wide() -> pa.Table:
    """Two loops beside each other, with every kind of column that a recording has."""
    t = np.arange(ROWS)
    pv = 50 + np.sin(t / 7) + 0.3 * np.sin(t / 3)
    op = 50 + 5 * np.sign(np.sin(t / 9)) + t % 5
    mode = np.where(t % 100 < 95, "AUTO", "MAN")
    return pa.table(
        {
            "time": _TIMES,
            "F1.SP": pa.array(np.full(ROWS, 50), pa.int32()),
            "F1.PV": pa.array([None if k % 40 == 7 else float(x) for k, x in enumerate(pv)]),
            "F1.OP": pa.array(op, pa.float32()),
            "F1.MODE": mode,
            "F2.SP": pa.array(np.full(ROWS, 50.0)).cast(pa.decimal128(12, 2)),
            "F2.PV": [f"{x:.3f}" for x in pv],
            "F2.OP": op,
            "F2.MODE": pa.array(mode).dictionary_encode(),
            "note": pa.array([["a"], [], None, ["b", "cc"]] * (ROWS // 4)),
        }
    )


def _long() -> pa.Table:
    """A row per tag and time."""
    wide = _wide()
    tags = ["F1.SP", "F1.PV", "F1.OP", "F2.SP", "F2.PV", "F2.OP"]
    values = [wide[tag].cast(pa.float64()).to_numpy(zero_copy_only=False) for tag in tags]
    return pa.table(
        {
            "Timestamp": np.repeat(_TIMES, len(tags)),
            "TagName": pa.array(tags * ROWS).dictionary_encode(),
            "Value": np.stack(values, axis=1).ravel(),
            "Quality": ["Good", "Good", "Bad", "Good", "Good", "Good"] * ROWS,
        }
    )


def originals(kind: str) -> list[bytes]:
    """Sound files of one kind, in the ways in which they may be written."""
    written = []
    for table in (_wide(), _long()):
        if kind == "parquet":
            ways: list[dict[str, object]] = [
                {"compression": "none", "use_dictionary": False},
                {"compression": "snappy", "row_group_size": 100},
                {"compression": "zstd", "data_page_version": "2.0", "write_page_checksum": True},
                {"compression": "none", "use_dictionary": True, "data_page_size": 256, "write_page_index": True},
            ]
            for way in ways:
                out = io.BytesIO()
                pq.write_table(table, out, **way)
                written.append(out.getvalue())
            continue
        for compression, size in ((None, None), (None, 100), ("lz4", None), ("zstd", 100)):
            sink = pa.BufferOutputStream()
            new = ipc.new_file if kind == "arrow" else ipc.new_stream
            with new(sink, table.schema, options=ipc.IpcWriteOptions(compression=compression)) as file:
                file.write_table(table, max_chunksize=size)
            written.append(sink.getvalue().to_pybytes())
    return written


_LENGTHS = (
    0,
    1,
    2,
    7,
    127,
    128,
    255,
    256,
    32767,
    65535,
    65536,
    2**31 - 1,
    2**31,
    2**32 - 1,
    2**40,
    2**63 - 1,
    2**64 - 1,
)


def damaged(rng: np.random.Generator, data: bytes) -> bytes:
    """The file with one to four faults; half of them are a single byte that is not what it was."""
    out = bytearray(data)
    for _ in range(1 if rng.random() < 0.5 else int(rng.integers(1, 5))):
        if len(out) < 16:
            break
        at = int(rng.integers(4, len(out) - 4))
        if rng.random() < 0.3:  # near the end, where both formats say what is where
            at = max(4, len(out) - 4 - int(rng.integers(0, 2000)))
        match int(rng.integers(0, 10)):
            case 0 | 1 | 2:
                out[at] ^= 1 << int(rng.integers(0, 8))
            case 3 | 4:
                out[at] = int(rng.integers(0, 256))
            case 5 | 6:
                size = int(rng.choice([1, 2, 4, 8]))
                length = int(rng.choice(np.array(_LENGTHS, np.uint64))) % (1 << 8 * size)
                out[at : at + size] = length.to_bytes(size, "little")
            case 7:
                out[at : at + int(rng.integers(1, 64))] = b""
            case 8:
                size = int(rng.integers(1, 64))
                there = int(rng.integers(0, len(out) - size)) if len(out) > size else 0
                out[at : at + size] = out[there : there + size]
            case 9:
                out[at:] = b"" if rng.random() < 0.5 else bytes(len(out) - at)
    return bytes(out)


def files(kind: str, count: int, seed: int) -> Iterator[bytes]:
    """Damaged files; the same for the same seed."""
    rng = np.random.default_rng((seed, KINDS.index(kind)))
    sound = originals(kind)
    for i in range(count):
        yield damaged(rng, sound[i % len(sound)])


def read_one(path: Path) -> str:
    """Open, read and analyse one file as `glapp analyze --no-fit` does; what came of it, or an exception."""
    from glapp.errors import FAULT, InputError
    from glapp.estimate import analyze
    from glapp.reading import open_each

    def sound(error: InputError) -> None:
        assert "\n" not in str(error), "more than one line"
        if error.hint == FAULT:  # the net below the net
            raise error

    try:
        opened = open_each(path, defaults=SETTINGS)
    except InputError as error:
        sound(error)
        return "refused"
    refused = 0
    for entry in opened:
        try:
            if isinstance(entry, InputError):
                raise entry
            for batch in entry.batches():
                assert np.isfinite(batch.t).all(), "a time that is not finite"
            refused += analyze(entry, fit=False).verdict == "refused"
        except InputError as error:
            sound(error)
            refused += 1
    return "answered" if refused == 0 else "refused" if refused == len(opened) else "partly"


def _child() -> None:
    """Read the files that are named on standard input; a line of JSON for each."""
    warnings.simplefilter("error")  # arithmetic on what no check should have let through
    for line in sys.stdin:
        try:
            told = read_one(Path(line.rstrip("\n")))
        except Exception:
            told = "raised " + traceback.format_exc()
        print(json.dumps(told), flush=True)


class Reader:
    """The process in which files are read, and a new one where it came to its end."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[str] | None = None

    def read(self, path: Path) -> str:
        """What came of one file."""
        if self._process is None:
            self._process = subprocess.Popen(
                [sys.executable, __file__, "--child"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
            )
            self._lines: queue.Queue[str] = queue.Queue()
            threading.Thread(target=self._listen, args=(self._process, self._lines), daemon=True).start()
        assert self._process.stdin is not None
        self._process.stdin.write(f"{path}\n")
        self._process.stdin.flush()
        try:
            line = self._lines.get(timeout=PATIENCE)
        except queue.Empty:
            self.close()
            return f"took longer than {PATIENCE:g} s"
        if line:
            return str(json.loads(line))
        code = self._process.wait()
        self._process = None
        return f"ended by signal {-code}" if code < 0 else f"ended with code {code}"

    @staticmethod
    def _listen(process: subprocess.Popen[str], lines: queue.Queue[str]) -> None:
        assert process.stdout is not None
        for line in process.stdout:
            lines.put(line)
        lines.put("")

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process = None


def command_line(path: Path) -> str:
    """The same by a `glapp analyze` of its own."""
    command = [sys.executable, "-c", "from glapp.cli import main; main()", "analyze", "--no-fit", *OPTIONS, str(path)]
    try:
        run = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE)
    except subprocess.TimeoutExpired:
        return f"took longer than {PATIENCE:g} s"
    if run.returncode < 0:
        return f"ended by signal {-run.returncode}"
    if "Traceback" in run.stderr or run.returncode not in (0, 1):
        return f"raised (exit code {run.returncode}) {run.stderr}"
    return "answered" if run.returncode == 0 else "refused or partly"


def fuzz(
    kind: str, count: int, seed: int, folder: Path, keep: Path | None = None, by_command: bool = False
) -> Counter[str]:
    """Try `count` files; how many ended how. Those that failed are kept in `keep`."""
    found = Counter[str]()
    reader = Reader()
    try:
        for i, data in enumerate(files(kind, count, seed)):
            path = folder / f"damaged.{kind}"
            path.write_bytes(data)
            told = command_line(path) if by_command else reader.read(path)
            how = told.partition(" ")[0] if told.startswith("raised") else told
            found[how] += 1
            if how not in GOOD:
                name = f"{kind}-{seed}-{i}"
                last = told.strip().splitlines()[-1]
                print(f"{name}: {last}", file=sys.stderr)
                if keep is not None:
                    keep.mkdir(parents=True, exist_ok=True)
                    shutil.copy(path, keep / f"{name}.{kind}")
                    (keep / f"{name}.txt").write_text(told, encoding="utf-8")
    finally:
        reader.close()
    return found


GOOD = frozenset({"answered", "partly", "refused", "refused or partly"})


def main(arguments: Sequence[str] | None = None) -> int:
    """Run from the command line; 1 where any file failed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kind", choices=KINDS, help="one kind only")
    parser.add_argument("--files", type=int, default=2000, help="how many of each kind")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--keep", type=Path, help="folder for files that failed, with what they raised")
    parser.add_argument("--command-line", action="store_true", help="a process for each file")
    parser.add_argument("--child", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args(arguments)
    if given.child:
        _child()
        return 0
    failed = 0
    for kind in [given.kind] if given.kind else KINDS:
        with tempfile.TemporaryDirectory() as folder:
            found = fuzz(kind, given.files, given.seed, Path(folder), given.keep, given.command_line)
        print(f"{kind}: {found.total()} files; " + ", ".join(f"{how} {n}" for how, n in found.most_common()))
        failed += sum(n for how, n in found.items() if how not in GOOD)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
