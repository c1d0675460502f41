"""Fuzzer of the readers of files: a damaged file gives batches or one InputError line, and never ends a run.

Whole files are damaged, a byte here or a length there, and go through the same functions as `glapp analyze --no-fit`.
Four of five are damaged behind their header only, so that reading begins. All of it happens in a process of its own.
What ends that process by a signal, takes longer than `PATIENCE` or raises anything but an InputError is a failure. So
is more memory than `MEMORY`. Run as::

    python fuzz/read_tables.py --files 3000                   # of each kind
    python fuzz/read_tables.py --files 500 --command-line     # by `glapp analyze`, 50 at once between sound ones
    python fuzz/read_tables.py --kind parquet --seed 7 --keep failed/

The kinds: CSV, packed CSV (gzip, bzip2, Zstandard, LZ4), Excel, Arrow file, Arrow stream and Parquet.
"""

from __future__ import annotations

import argparse
import bz2
import gzip
import io
import json
import queue
import re
import shutil
import subprocess
import sys
import tempfile
import threading
import time
import traceback
import warnings
import zipfile
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv as pacsv
import pyarrow.ipc as ipc
import pyarrow.parquet as pq

KINDS = ("csv", "packed", "excel", "arrow", "stream", "parquet")
PATIENCE = 30.0
"""Seconds that one file may take."""
MEMORY = 1500
"""MB that the process that reads, and the one apart that its libraries read in, may take together."""
BEHIND = 0.8
"""Share of the files that are damaged behind their header only."""
AT_ONCE = 50
"""Damaged files of one `glapp analyze`."""
LIMITS = ("ended the process that read it", "took longer than", "asks for more memory")

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


@dataclass(frozen=True)
class Sound:
    """A sound file.

    Attributes
    ----------
    text : bytes
        What is in it, and of what is not packed the file itself.
    begin, end : int
        Where in `text` its rows are: behind the header, before the footer.
    ending : str
        Of its name.
    pack : callable
        From the text to the file.
    """

    text: bytes
    begin: int
    end: int
    ending: str
    pack: Callable[[bytes], bytes] = field(default=bytes)

    @property
    def data(self) -> bytes:
        """The file."""
        return self.pack(self.text)


def originals(kind: str) -> list[Sound]:
    """Sound files of one kind, in the ways in which they may be written."""
    return [sound for table in (_wide(), _long()) for sound in _WRITTEN[kind](table)]


def _parquet(table: pa.Table) -> Iterator[Sound]:
    ways: list[dict[str, Any]] = [
        {"compression": "none", "use_dictionary": False},
        {"compression": "snappy", "row_group_size": 100},
        {"compression": "zstd", "data_page_version": "2.0", "write_page_checksum": True},
        {"compression": "none", "use_dictionary": True, "data_page_size": 256, "write_page_index": True},
    ]
    for way in ways:
        out = io.BytesIO()
        pq.write_table(table, out, **way)
        data = out.getvalue()
        yield Sound(data, 4, len(data) - 8 - int.from_bytes(data[-8:-4], "little"), ".parquet")


def _ipc(table: pa.Table, new: Any) -> Iterator[Sound]:
    for compression, size in ((None, None), (None, 100), ("lz4", None), ("zstd", 100)):
        sink = pa.BufferOutputStream()
        with new(sink, table.schema, options=ipc.IpcWriteOptions(compression=compression)) as file:
            file.write_table(table, max_chunksize=size)
        data = sink.getvalue().to_pybytes()
        at, end = (
            (8, len(data) - 10 - int.from_bytes(data[-10:-6], "little")) if new is ipc.new_file else (0, len(data))
        )
        begin = at + 8 + int.from_bytes(data[at + 4 : at + 8], "little")  # behind the schema
        yield Sound(data, begin, end, ".arrow")


def _text(table: pa.Table) -> bytes:
    names = [name for name in table.column_names if name != "note"]
    out = io.BytesIO()
    pacsv.write_csv(table.select(names), out, pacsv.WriteOptions(quoting_style="needed"))
    return out.getvalue()


def _csv(table: pa.Table) -> Iterator[Sound]:
    for text in (_text(table), _text(table).replace(b",", b";").replace(b".", b",")):
        yield Sound(text, text.index(b"\n") + 1, len(text), ".csv")


def _packed(table: pa.Table) -> Iterator[Sound]:
    """Whether the packed file is larger than the part that is looked at first: else nothing would be read beyond it."""
    head, _, rows = _text(table).partition(b"\n")
    day = b"2024-01-01"
    text = head + b"\n" + b"".join(rows.replace(day, b"2024-01-%02d" % (k + 1)) for k in range(12))
    assert len(text) > 1.5 * (1 << 16) and day in rows
    ways: list[tuple[str, Callable[[bytes], bytes]]] = [
        (".csv.gz", gzip.compress),
        (".csv.bz2", bz2.compress),
        (".csv.zst", lambda text: pa.Codec("zstd").compress(text, asbytes=True)),
        (".csv.lz4", lambda text: _lz4(text)),
    ]
    for ending, pack in ways:
        yield Sound(text, 1 << 16, len(text), ending, pack)


def _lz4(text: bytes) -> bytes:
    sink = pa.BufferOutputStream()
    with pa.CompressedOutputStream(sink, "lz4") as out:
        out.write(text)
    return sink.getvalue().to_pybytes()


def _excel(table: pa.Table) -> Iterator[Sound]:
    """Workbooks by Excel's two ways: with shared strings, and with everything in its cells."""
    from openpyxl import Workbook

    for write_only in (False, True):
        book = Workbook(write_only=write_only)
        sheet = book.create_sheet("Trend") if write_only else book.active
        names = [name for name in table.column_names if name != "note"]
        sheet.append(names)
        for row in table.select(names).to_pylist():
            sheet.append([value if isinstance(value, str | None) else _cell(value) for value in row.values()])
        out = io.BytesIO()
        book.save(out)
        name, packed = "xl/worksheets/sheet1.xml", out.getvalue()
        with zipfile.ZipFile(io.BytesIO(packed)) as parts:
            text = parts.read(name)
            others = {part: parts.read(part) for part in parts.namelist() if part != name}

        def pack(text: bytes, others: dict[str, bytes] = others, name: str = name) -> bytes:
            again = io.BytesIO()
            with zipfile.ZipFile(again, "w", zipfile.ZIP_DEFLATED) as parts:
                for part, content in (others | {name: text}).items():
                    parts.writestr(part, content)
            return again.getvalue()

        yield Sound(text, text.index(b"</row>"), len(text), ".xlsx", pack)


def _cell(value: Any) -> Any:
    return value if hasattr(value, "isoformat") else float(value)


_WRITTEN: dict[str, Callable[[pa.Table], Iterator[Sound]]] = {
    "csv": _csv,
    "packed": _packed,
    "excel": _excel,
    "arrow": lambda table: _ipc(table, ipc.new_file),
    "stream": lambda table: _ipc(table, ipc.new_stream),
    "parquet": _parquet,
}


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


def damaged(rng: np.random.Generator, data: bytes, begin: int = 4, end: int | None = None) -> bytes:
    """The bytes with one to four faults between two places; half of the faults are a single changed byte."""
    whole, data = data, data[begin : len(data) - 4 if end is None else end]
    out = bytearray(data)
    for _ in range(1 if rng.random() < 0.5 else int(rng.integers(1, 5))):
        if len(out) < 16:
            break
        at = int(rng.integers(0, len(out)))
        if end is None and rng.random() < 0.3:  # near the end, where most formats say what is where
            at = max(0, len(out) - 1 - int(rng.integers(0, 2000)))
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
    return whole[:begin] + bytes(out) + whole[begin + len(data) :]


_RUN = re.compile(rb"[0-9]+|[A-Za-z]+")
_IN_CELLS = re.compile(rb'(?<=>)[^<>]+(?=</[vt]>)|(?<= r=")[A-Z]+[0-9]+')
_CELLS = (b"A1", b"XFD7", b"A1048576", b"XFD1048576", b"H5000", b"A0", b"B9999999", b"AAAA1", b"IV65536", b"C")
_WORDS = (
    b"",
    b"0",
    b"-1",
    b"1e308",
    b"-1e-320",
    b"NaN",
    b"inf",
    b"16384",
    b"1048576",
    b"2147483648",
    b"9" * 40,
    b"XFD",
)
_WORDS += (
    b"ZZZ",
    b"\xff",
    "å".encode(),
    b"2024-02-30",
    b"true",
    b"'",
    b'"',
    b",",
    b";",
    b"\n",
    b"\r",
    b"<",
    b"&lt;",
    b"x" * 9999,
)


def reworded(rng: np.random.Generator, text: bytes, begin: int, end: int) -> bytes:
    """The text with one to four of its numbers or words replaced, left out or written twice."""
    rows = text[begin:end]
    for _ in range(int(rng.integers(1, 5))):
        sheet = rows.endswith(b"</worksheet>") and rng.random() < 0.9
        run = (_IN_CELLS if sheet else _RUN).search(rows, int(rng.integers(0, len(rows) + 1)))
        if run is not None:
            words = _CELLS if rows[: run.start()].endswith(b' r="') else _WORDS
            word = run[0] * 2 if rng.random() < 0.1 else words[int(rng.integers(0, len(words)))]
            rows = rows[: run.start()] + word + rows[run.end() :]
    return text[:begin] + rows + text[end:]


def files(kind: str, count: int, seed: int) -> Iterator[tuple[bytes, str, bool]]:
    """Damaged files, the endings of their names, and whether the header is whole; the same for the same seed."""
    rng = np.random.default_rng((seed, KINDS.index(kind)))
    sound = originals(kind)
    for i in range(count):
        one = sound[i % len(sound)]
        behind = rng.random() < BEHIND
        if not behind:
            data = damaged(rng, one.data)
        elif kind == "packed" and rng.random() < 0.3:
            data = damaged(rng, one.data, len(one.data) // 2, len(one.data))
        else:
            way = reworded if kind in ("csv", "packed", "excel") and rng.random() < 0.8 else damaged
            data = one.pack(way(rng, one.text, one.begin, one.end))
        yield data, one.ending, behind


def read_one(path: Path) -> str:
    """Open, read and analyse one file as `glapp analyze --no-fit` does; gives the outcome, or an exception."""
    from glapp.errors import FAULT, InputError
    from glapp.estimate import analyze
    from glapp.reading import open_each

    limited = False

    def sound(error: InputError) -> None:
        nonlocal limited
        assert "\n" not in str(error), "more than one line"
        if error.hint == FAULT:  # the net below the net
            raise error
        limited = limited or any(what in str(error) for what in LIMITS)

    try:
        opened = open_each(path, defaults=SETTINGS)
    except InputError as error:
        sound(error)
        return "refused by a limit" if limited else "refused when opened"
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
    if limited:
        return "refused by a limit"
    return "answered" if refused == 0 else "refused when read" if refused == len(opened) else "partly"


def _child() -> None:
    """Read the files that are named on standard input; a line of JSON for each, and one of the memory at the end."""
    import glapp.estimate
    import glapp.reading  # noqa: F401

    warnings.simplefilter("error")  # arithmetic on what no check should have let through
    print(flush=True)  # how long it takes to begin says nothing of the files
    for line in sys.stdin:
        begun = time.monotonic()
        try:
            outcome = read_one(Path(line.rstrip("\n")))
        except Exception:
            outcome = "raised " + traceback.format_exc()
        print(json.dumps((outcome, time.monotonic() - begun)), flush=True)
    print(json.dumps(_memory()), flush=True)


def _memory() -> tuple[int, int]:
    """The most that this process took, and the largest of those apart [MB]; zeros where no system tells."""
    try:
        import resource
    except ImportError:
        return 0, 0
    from glapp.reading import apart

    apart.close()  # it is told of what has ended
    mb = 10**6 if sys.platform == "darwin" else 1000
    ours, apart_ = (resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    status = Path("/proc/self/status")  # on Linux, where the first counts what the process that started this one took
    if status.exists():
        ours = int(status.read_text().partition("VmHWM:")[2].split()[0])
    return ours // mb, apart_ // mb


class Reader:
    """The process in which files are read, and a new one where it came to its end."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[str] | None = None
        self.slowest = 0.0
        self.memory = 0, 0

    def read(self, path: Path) -> str:
        """Read one file; give the outcome in a word."""
        if self._process is None:
            self._process = subprocess.Popen(
                [sys.executable, __file__, "--child"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
            )
            self._lines: queue.Queue[str] = queue.Queue()
            assert self._process.stdout is not None
            self._process.stdout.readline()
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
            outcome, seconds = json.loads(line)
            self.slowest = max(self.slowest, seconds)
            return str(outcome)
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

    def end(self) -> None:
        """Let the process come to its end, and take its memory."""
        if self._process is not None:
            assert self._process.stdin is not None
            self._process.stdin.close()
            line = self._lines.get(timeout=PATIENCE)
            self.memory = tuple(json.loads(line)) if line else self.memory
            self._process.wait()
            self._process = None


def _answers(files: Sequence[Path]) -> tuple[int, str, dict[str, Any]]:
    """Exit code, standard error and the answers by file of one `glapp analyze`; PATIENCE for each file."""
    command = [sys.executable, "-c", "from glapp.cli import main; main()", "analyze", "--no-fit", "--json"]
    run = subprocess.run([*command, *map(str, files)], capture_output=True, text=True, timeout=PATIENCE * len(files))
    by_file: dict[str, Any] = {}
    if run.returncode in (0, 1) and run.stdout:
        for answer in json.loads(run.stdout)["loops"]:
            by_file.setdefault(answer["file"], []).append({k: v for k, v in answer.items() if k != "name"})
    return run.returncode, run.stderr, by_file


def by_command(kind: str, count: int, seed: int, folder: Path, keep: Path | None = None) -> Counter[str]:
    """Try `count` files by `glapp analyze`, `AT_ONCE` of them among sound ones of each kind; how many ended how."""
    found = Counter[str]()
    sound = []
    for other in KINDS:
        one = originals(other)[0]
        sound.append(folder / f"sound-{other}{one.ending}")
        sound[-1].write_bytes(one.data)
    _, _, alone = _answers(sound)
    assert len(alone) == len(sound)
    group: list[Path] = []

    def run() -> None:
        half = len(group) // 2
        code, printed, answers = _answers([*sound[:2], *group[:half], *sound[2:4], *group[half:], *sound[4:]])
        lost = [path for path in sound if answers.get(str(path)) != alone[str(path)]]
        missing = [path for path in group if str(path) not in answers]
        fault = code not in (0, 1) or "Traceback" in printed or "a fault in glapp" in printed
        if fault or lost or missing:
            found["failed"] += len(group)
            print(f"{kind}: exit code {code}, lost {lost}, missing {missing}: {printed[-2000:]}", file=sys.stderr)
            if keep is not None:
                keep.mkdir(parents=True, exist_ok=True)
                for path in group:
                    shutil.copy(path, keep)
        else:
            found["answer of their own"] += len(group)
            found["sound files beside them with theirs"] += len(sound)
        for path in group:
            path.unlink()
        group.clear()

    for i, (data, ending, _) in enumerate(files(kind, count, seed)):
        group.append(folder / f"{kind}-{seed}-{i}{ending}")
        group[-1].write_bytes(data)
        if len(group) == AT_ONCE:
            run()
    if group:
        run()
    return found


def fuzz(kind: str, count: int, seed: int, folder: Path, keep: Path | None = None) -> tuple[Counter[str], Reader]:
    """Try `count` files; how many ended how, and who read them. Those that failed are kept in `keep`."""
    found = Counter[str]()
    reader = Reader()
    try:
        for i, (data, ending, behind) in enumerate(files(kind, count, seed)):
            path = folder / f"damaged-{kind}{ending}"
            path.write_bytes(data)
            outcome = reader.read(path)
            how = outcome.partition(" ")[0] if outcome.startswith("raised") else outcome
            found[how] += 1
            # A workbook is read whole when it is opened.
            if behind and how in GOOD and (kind == "excel" or how != "refused when opened"):
                found[BEGUN] += 1
            if how not in GOOD:
                name = f"{kind}-{seed}-{i}"
                last = outcome.strip().splitlines()[-1]
                print(f"{name}: {last}", file=sys.stderr)
                if keep is not None:
                    keep.mkdir(parents=True, exist_ok=True)
                    shutil.copy(path, keep / f"{name}{ending}")
                    (keep / f"{name}.txt").write_text(outcome, encoding="utf-8")
        reader.end()
    finally:
        reader.close()
    return found, reader


BEGUN = "damaged behind the header and read"
GOOD = frozenset({"answered", "partly", "refused when opened", "refused when read", "refused by a limit"})


def main(arguments: Sequence[str] | None = None) -> int:
    """Run from the command line; 1 where any file failed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kind", choices=KINDS, help="one kind only")
    parser.add_argument("--files", type=int, default=3000, help="how many of each kind")
    parser.add_argument("--seed", type=int, default=time.time_ns() % 10**6, help="else one that nobody used")
    parser.add_argument("--keep", type=Path, help="folder for files that failed, with what they raised")
    parser.add_argument("--command-line", action="store_true", help="by `glapp analyze`, among sound files")
    parser.add_argument("--child", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args(arguments)
    if given.child:
        _child()
        return 0
    failed = 0
    for kind in [given.kind] if given.kind else KINDS:
        begun = time.monotonic()
        with tempfile.TemporaryDirectory() as folder:
            if given.command_line:
                found = by_command(kind, given.files, given.seed, Path(folder), given.keep)
                failed += found["failed"]
                more = ""
            else:
                found, reader = fuzz(kind, given.files, given.seed, Path(folder), given.keep)
                failed += sum(n for how, n in found.items() if how not in GOOD | {BEGUN})
                failed += sum(reader.memory) > MEMORY
                ours, apart = reader.memory
                more = f"; slowest {reader.slowest:.2f} s, most memory {ours} MB and {apart} MB apart"
        ends = ", ".join(f"{how} {n}" for how, n in found.most_common())
        seconds = time.monotonic() - begun
        print(f"{kind}, seed {given.seed}: {given.files} files; {ends}{more}; {seconds:.0f} s", flush=True)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
