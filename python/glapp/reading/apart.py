"""A process apart in which libraries read files from outside, with a limit of memory and of time.

A workbook, a Parquet and an Arrow file say themselves how large and where their parts are, and the libraries that read
them believe it: a damaged or a malicious one can make them end the process, ask for all the memory there is, or go on
for ever. So they read in a child process: what it does to itself costs that file its answer, and no other. Each process
serves one file at a time and is used again for the next, since a new one costs half a second of a core and one that is
there a thousandth of it; the rows come over as Arrow's own stream. `docs/adr/0027-files-are-read-in-a-process-apart.md`
says what else there was.

The limits are those of `glapp.reading.bounds`. `MEMORY` is kept on Linux, by the address space of the process. Where a
system has no such limit (Windows, macOS) the time limit and the process of its own stay. `PATIENCE` is time of the
processor, and four times as much of the clock; on Windows, which does not end a process for that, it is of the clock.
This is a guard against faults, and no sandbox: the child may do what its user may.
"""

from __future__ import annotations

import atexit
import json
import os
import pickle
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import lru_cache
from pathlib import Path
from threading import Timer
from typing import IO, Any, ParamSpec, TypeVar

import pyarrow as pa
import pyarrow.ipc as ipc

from ..errors import InputError, unforeseen
from . import bounds
from .source import Head, Source, ahead

__all__ = ["ApartSource", "Worker", "call", "opened", "serve"]

P = ParamSpec("P")
R = TypeVar("R")

_START = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]); from glapp.reading.apart import serve; "
    "serve(int(sys.argv[2]))"
)
# The memory asked of the system is then near the memory used: no arena of a GiB, no heap for each thread.
_FRUGAL = {"ARROW_DEFAULT_MEMORY_POOL": "system", "MALLOC_ARENA_MAX": "2", "OPENBLAS_NUM_THREADS": "1"}
_HINT = "export it again, in smaller parts, or save it as CSV"

# Time of the processor where the system counts it, so that a busy computer refuses nothing; and then of the clock as
# well.
_PROF: int | None = getattr(signal, "SIGPROF", None)
_CLOCK = 1.0 if _PROF is None else 4.0

_inside = False
_workers: set[Worker] = set()
"""All there are; those that read nothing now are `_idle`."""
_idle: list[Worker] = []


class Worker:
    """A process that reads. As a context manager it ends with the block.

    - `memory`: bytes that it may take beyond those it begins with.
    """

    def __init__(self, memory: int | None = None) -> None:
        paths = json.dumps(sys.path)
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-c", _START, paths, str(bounds.MEMORY if memory is None else memory)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            pipesize=1 << 20,  # rows come in megabytes
            env=os.environ | _FRUGAL,
            creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
        )
        assert self._process.stdin is not None and self._process.stdout is not None
        self._in: IO[bytes] = self._process.stdin
        self._out: IO[bytes] = self._process.stdout
        self._late = False
        self.sound = True
        self._begun = False
        _workers.add(self)

    def __enter__(self) -> Worker:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def call(self, label: str, function: Callable[P, R], *args: P.args, **named: P.kwargs) -> R:
        """Result of a function of a module, in the process.

        Raises InputError as the function; of the file `label`, where it ends the process or takes longer than it may.
        """
        made: R = self.ask(label, "call", function, args, named)
        return made

    def ask(self, label: str, *request: Any) -> Any:
        """The answer to one request."""
        self.sound = False
        timer = Timer(bounds.PATIENCE * _CLOCK, self._end)
        timer.daemon = True
        try:
            if not self._begun:  # its time does not depend on the file
                self._begun = pickle.load(self._out)
            timer.start()
            pickle.dump((bounds.PATIENCE, *request), self._in)
            self._in.flush()
            good, answer, size = pickle.load(self._out)
            if size:
                data = pa.allocate_buffer(size)
                if self._out.readinto(memoryview(data)) != size:  # type: ignore[attr-defined]
                    raise EOFError
                answer = answer, data
        except (EOFError, OSError, pickle.UnpicklingError):
            raise self._fault(label) from None
        finally:
            timer.cancel()
        self.sound = True
        if not good:
            answer.file = answer.file or label
            raise answer
        return answer

    def close(self) -> None:
        """End the process."""
        self.sound = False
        _workers.discard(self)
        with suppress(OSError):
            self._process.kill()
        self._process.wait()
        for pipe in (self._in, self._out):
            with suppress(OSError):
                pipe.close()

    def _end(self) -> None:
        """Kill the child, since it took too long."""
        self._late = True
        self._process.kill()

    def _fault(self, label: str) -> InputError:
        """The error for a child that has ended."""
        code = self._process.wait()
        if self._late or (_PROF is not None and code == -_PROF):
            what = f"took longer than the {bounds.PATIENCE:g} s that a piece of a file may take to be read"
        else:
            end = f"signal {-code}" if code < 0 else f"exit code {code}"
            what = (
                f"ended the process that read it ({end}): it is damaged, or asks for more memory than the "
                f"{bounds.MEMORY >> 20} MiB that are allowed"
            )
        return InputError(what, file=label, hint=_HINT)


@contextmanager
def _leased() -> Iterator[Worker]:
    """A process for one thing to do; it stays for the next where it is sound."""
    try:
        worker = _idle.pop()
    except IndexError:
        worker = Worker()
    try:
        yield worker
    finally:
        if worker.sound and len(_idle) < (os.cpu_count() or 1):
            _idle.append(worker)
        else:
            worker.close()


@atexit.register
def _close() -> None:
    """End all processes, those of open passes too: no thread starts later that could time an answer."""
    for worker in list(_workers):
        worker.close()


def _forget() -> None:
    """Leave the processes to the parent, whose they are."""
    _workers.clear()
    _idle.clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget)


def call(label: str, function: Callable[P, R], *args: P.args, **named: P.kwargs) -> R:
    """Result of a function of a module, in a separate process: see `Worker.call`."""
    if _inside:
        return function(*args, **named)
    with _leased() as worker:
        return worker.call(label, function, *args, **named)


def opened(kind: Callable[[str, str], Source], path: str, label: str) -> Source:
    """The source of a file, read in a process apart.

    - `kind`: a source made of path and label.
    - `path`, `label`: the file, and as the user wrote it.
    """
    return kind(path, label) if _inside else ApartSource(kind, path, label)


class ApartSource(Source):
    """A file that another source reads in a process apart; see `opened`."""

    typed = True

    def __init__(self, kind: Callable[[str, str], Source], path: str, label: str) -> None:
        self.label = label
        self._file = (kind, str(Path(path).absolute()), label)  # the process may stand in another folder
        self.names, self.units, self.rows, self.one_fault = call(label, _shape, *self._file)
        self._head = Head(lambda i: _unpacked(call(label, _first, *self._file, i))[0])

    def head(self, columns: Sequence[int]) -> list[pa.Array]:
        """First rows of the columns."""
        return self._head(columns)

    def stream(
        self, types: Mapping[int, pa.DataType], bad_words: frozenset[str]
    ) -> Iterator[tuple[list[pa.Array], float]]:
        """Pass over the columns; the process is a few pieces ahead."""
        with _leased() as worker:
            worker.ask(self.label, "stream", *self._file, dict(types), bad_words)
            more = True
            try:
                while (answer := worker.ask(self.label, "next")) is not None:
                    fraction, data = answer
                    yield _unpacked(data), fraction
                more = False
            finally:
                if more and worker.sound:
                    worker.ask(self.label, "close")

    def row_number(self, record: int) -> int:
        """The row of a record, as the file's own source counts: all that are read apart count from 1."""
        return record + 1


@lru_cache(maxsize=1)
def _source(kind: Callable[[str, str], Source], path: str, label: str) -> Source:
    return kind(path, label)


def _shape(
    kind: Callable[[str, str], Source], path: str, label: str
) -> tuple[list[str], list[str | None], int | None, bool]:
    """Names, units, number of rows and `one_fault` of a source."""
    _source.cache_clear()  # the file may be another than last time
    source = _source(kind, path, label)
    return source.names, source.units, source.rows, source.one_fault


def _first(kind: Callable[[str, str], Source], path: str, label: str, column: int) -> pa.Buffer:
    """First values of a column, packed."""
    return _packed(next(_slices(_source(kind, path, label).head([column])))).to_pybytes()


def _pieces(
    kind: Callable[[str, str], Source],
    path: str,
    label: str,
    types: Mapping[int, pa.DataType],
    bad_words: frozenset[str],
) -> Iterator[tuple[float, pa.Buffer]]:
    """A pass, as far as a file of this size may be long."""
    packed, size = Path(path).stat().st_size, 0
    for arrays, fraction in _source(kind, path, label).stream(types, bad_words):
        size += sum(array.nbytes for array in arrays)
        bounds.check_unpacked(size, packed, label, "split it into smaller files")
        for part in _slices(arrays):
            yield fraction, _packed(part)


def _slices(arrays: Sequence[pa.Array]) -> Iterator[Sequence[pa.Array]]:
    """The rows in stretches of at most `bounds.PIECE` bytes, a row at least: long text is then held twice."""
    rows, size = len(arrays[0]) if arrays else 0, sum(array.nbytes for array in arrays)
    step = max(rows * bounds.PIECE // max(size, bounds.PIECE), 1)
    for start in range(0, max(rows, 1), step):
        yield [array.slice(start, step) for array in arrays] if step < rows else arrays


def _packed(arrays: Sequence[pa.Array]) -> pa.Buffer:
    """Columns as bytes of an Arrow stream."""
    batch = pa.RecordBatch.from_arrays(list(arrays), names=[str(i) for i in range(len(arrays))])
    sink = pa.BufferOutputStream()
    with ipc.new_stream(sink, batch.schema) as stream:
        stream.write_batch(batch)
    return sink.getvalue()


def _unpacked(data: pa.Buffer | bytes) -> list[pa.Array]:
    """Columns from bytes of an Arrow stream."""
    columns: list[pa.Array] = ipc.open_stream(pa.py_buffer(data)).read_next_batch().columns
    return columns


def serve(memory: int) -> None:
    """Answer requests until there are no more: the child's main loop.

    - `memory`: bytes that it may take beyond those it has now.
    """
    global _inside
    _inside = True
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # it ends with the program that began it
    with os.fdopen(os.dup(0), "rb") as requests, os.fdopen(os.dup(1), "wb") as answers:
        nowhere = os.open(os.devnull, os.O_RDWR)
        for stream in (0, 1):  # what a library reads or prints is no part of this
            os.dup2(nowhere, stream)
        _limit(memory)
        pickle.dump(True, answers)
        answers.flush()
        running: Iterator[tuple[float, pa.Buffer]] | None = None
        while True:
            try:
                patience, request, *given = pickle.load(requests)
            except EOFError:
                return
            _count(patience)
            data = None
            try:
                answer: Any = None
                if request == "call":
                    function, args, named = given
                    answer = function(*args, **named)
                elif request == "stream":
                    running = ahead(_pieces(*given))
                elif request == "next" and running is not None:
                    answer, data = next(running, (None, None))
                    running = None if data is None else running
                else:
                    running = None
                head = pickle.dumps((True, answer, 0 if data is None else data.size))
            except Exception as error:
                running = None
                head = pickle.dumps((False, _error_of(error), 0))
            _count(0.0)
            answers.write(head)
            if data is not None:
                answers.write(data)
            answers.flush()


def _error_of(error: Exception) -> InputError:
    """An exception of the child as an InputError."""
    if isinstance(error, MemoryError):
        return InputError(f"asks for more memory than the {bounds.MEMORY >> 20} MiB that are allowed", hint=_HINT)
    return error if isinstance(error, InputError) else unforeseen(error, None)


def _count(seconds: float) -> None:
    """End the process when it has used so many seconds of processors; 0: do not."""
    if sys.platform != "win32":
        signal.setitimer(signal.ITIMER_PROF, seconds)


def _limit(memory: int) -> None:
    """Keep to so many bytes more than now, where the system can hold a process to that."""
    statm = Path("/proc/self/statm")
    if sys.platform == "win32" or not statm.exists():
        return
    import resource

    now = int(statm.read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (now + memory, now + memory))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
