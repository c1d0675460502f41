"""A damaged file is refused in one line, harms no loop but its own, and never ends the run."""

import bz2
import importlib
import io
import os
import warnings
from datetime import date

import numpy as np
import pyarrow as pa
import pyarrow.ipc as ipc
import pyarrow.parquet as pq
import pytest
from fuzz import read_tables as fuzzer

from glapp.errors import InputError
from glapp.reading import open_each, open_recordings, recording_from
from glapp.reading.csv import CsvSource
from glapp.reading.values import numbers

FILES = int(os.environ.get("GLAPP_FILES", "300"))
"""Damaged files of each kind in `make verify`; 3000 of each take most of an hour, and are what `make fuzz` tries."""

SEED = date.today().toordinal()
"""New every day, and the same all day: what failed fails again."""


def held(found, reader, count, beyond=1 / 2):
    """Checks that a run of the fuzzer found nothing, read so many files beyond their header, and kept to time and
    memory.
    """
    assert sum(n for how, n in found.items() if how in fuzzer.GOOD) == count
    assert set(found) <= fuzzer.GOOD | {fuzzer.BEGUN}, found
    assert found[fuzzer.BEGUN] > beyond * count, found
    assert sum(reader.memory) < fuzzer.MEMORY


@pytest.mark.verify
@pytest.mark.parametrize("kind", fuzzer.KINDS)
def test_damaged_files_end_no_process(kind, tmp_path):
    """One damaged byte of an Arrow file was a segmentation fault: of 400 files 37 ended so, 36 in a traceback."""
    found, reader = fuzzer.fuzz(kind, 60, seed=3, folder=tmp_path)
    held(found, reader, 60)
    assert found["answered"] + found["partly"] >= 3, "most of the faults should not refuse everything"
    assert found["refused when opened"] + found["refused when read"] >= 5, "the faults do no harm: what is tried here?"


@pytest.mark.verify
@pytest.mark.parametrize("kind", fuzzer.KINDS)
def test_hundreds_of_damaged_files_end_no_process(kind, tmp_path):
    found, reader = fuzzer.fuzz(kind, FILES, seed=SEED, folder=tmp_path)
    held(found, reader, FILES, beyond=1 / 3)  # about half of them: by chance a little less


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["excel", "parquet"])
def test_damaged_files_cost_no_other_its_answer(kind, tmp_path):
    found = fuzzer.by_command(kind, 12, seed=4, folder=tmp_path)
    assert found["answer of their own"] == 12 and found["sound files beside them with theirs"] == len(fuzzer.KINDS)
    assert not found["failed"]


@pytest.mark.verify
@pytest.mark.parametrize("kind", fuzzer.KINDS)
def test_hundreds_of_damaged_files_cost_no_other_its_answer(kind, tmp_path):
    found = fuzzer.by_command(kind, FILES // 3, seed=SEED, folder=tmp_path)
    assert found["answer of their own"] == FILES // 3 and not found["failed"]


@pytest.mark.slow
def test_sound_originals_are_answered(tmp_path):
    for kind in fuzzer.KINDS:
        for sound in fuzzer.originals(kind):
            path = tmp_path / f"sound{sound.ending}"
            path.write_bytes(sound.data)
            assert fuzzer.read_one(path) == "answered"


def arrow(table, path):
    with ipc.new_file(path, table.schema) as file:
        file.write_table(table)
    return bytearray(path.read_bytes())


def two_loops():
    t = np.arange(40)
    pv = 50 + np.sin(t / 3.0)
    mode = ["AUTO"] * len(t)
    columns = {"t": t.astype(float)}
    for name in ("F1", "F2"):
        columns |= {f"{name}.SP": np.full(len(t), 50.0), f"{name}.PV": pv, f"{name}.OP": pv, f"{name}.MODE": mode}
    return pa.table(columns)


@pytest.mark.slow
def test_text_that_points_outside_the_file(tmp_path):
    """Regression: the text was read there, and the process died of signal 11. Read in a process apart, so that this one
    could tell.
    """
    path = tmp_path / "F1.arrow"
    data = arrow(two_loops(), path)
    offsets = (np.arange(41) * 4).astype("<i4").tobytes()
    at = data.index(offsets) + 4 * 20
    data[at : at + 4] = (0x7FFFFFF0).to_bytes(4, "little")
    path.write_bytes(data)
    reader = fuzzer.Reader()
    try:
        assert reader.read(path) in fuzzer.GOOD
    finally:
        reader.close()
    first, second = open_each(path)
    with pytest.raises(InputError, match=r"F1\.arrow: is damaged: .*offset"):
        list(first.batches())
    assert sum(map(len, second.batches())) == 40


def test_text_that_is_no_utf8_harms_its_own_loop_only(tmp_path):
    """Regression: the text ended all loops of the run."""
    table = two_loops()
    words = pa.Array.from_buffers(pa.string(), 40, pa.array([b"\xff\xfe"] * 40).buffers())
    table = table.set_column(table.column_names.index("F1.MODE"), "F1.MODE", words)
    path = tmp_path / "plant.parquet"
    pq.write_table(table, path)
    first, second = open_each(path)
    with pytest.raises(InputError, match=r"plant\.parquet, row 1: is damaged: .*UTF8"):
        list(first.batches())
    assert sum(map(len, second.batches())) == 40


def test_names_that_are_no_utf8(tmp_path):
    path = tmp_path / "plant.parquet"
    pq.write_table(two_loops().rename_columns(["t", *(f"åå{k}" for k in range(8))]), path, store_schema=False)
    path.write_bytes(path.read_bytes().replace("åå1".encode(), b"\xc3\xc3\xc3\xa51"))
    with pytest.raises(InputError, match=r"is not a readable Parquet file: .*utf-8"):
        open_recordings(path)


def test_a_file_that_shrinks_while_it_is_read(tmp_path):
    """Regression: the file was mapped into memory, and its missing end was a bus error."""
    path = tmp_path / "F1.arrow"
    table = two_loops()
    big = pa.concat_tables([table] * 2000)
    with ipc.new_file(path, big.schema) as file:
        file.write_table(big, max_chunksize=1000)
    batches = open_recordings(path)[0].batches()
    next(batches)
    with path.open("r+b") as file:
        file.truncate(100_000)
    with pytest.raises(InputError, match="is damaged"):
        list(batches)


def test_one_bad_cell_of_a_long_table_harms_its_own_loop_only(tmp_path):
    path = tmp_path / "long.csv"
    lines = [f"{k},{tag},{k}" for k in range(20) for tag in ("F1.SP", "F1.PV", "F2.SP", "F2.PV")]
    lines[9] = "2,F1.PV,xyz"
    path.write_text("time,tag,value\n" + "\n".join(lines) + "\n")
    first, second = open_each(path)
    for _ in range(2):
        with pytest.raises(InputError, match=r"row 11, column value, tag F1\.PV: 'xyz' is not a number"):
            list(first.batches())
    assert sum(map(len, second.batches())) == 20


ODD = {
    "list": pa.array([[1]] * 4),
    "bytes": pa.array([b"\xff"] * 4),
    "runs": pa.RunEndEncodedArray.from_arrays(pa.array([4], pa.int32()), pa.array([1.0])),
    "nothing": pa.nulls(4),
    "half": pa.array(np.ones(4, np.float16)),
    "never": pa.array([2**62] * 4, pa.timestamp("s")),
    "no zone": pa.array([2**62] * 4, pa.timestamp("s", "Middle/Earth")),
}


@pytest.mark.parametrize("odd", ODD)
@pytest.mark.parametrize("role", ["t", "PV", "MODE", "quality", "time", "tag", "value", "Quality"])
def test_columns_of_any_type_are_read_or_refused(odd, role):
    """A list as a mode, a run-end-encoded time, a date beyond all calendars: tracebacks all."""
    wide = {"t": np.arange(4.0), "SP": np.ones(4), "PV": np.arange(4.0)}
    long = {"time": np.arange(4.0), "tag": ["SP", "PV"] * 2, "value": np.arange(4.0)}
    columns = wide if role in ("t", "PV", "MODE", "quality") else long
    try:
        rows = sum(map(len, recording_from(columns | {role: ODD[odd]}).batches()))
    except InputError as error:
        assert "\n" not in str(error)
    else:
        assert rows in (2, 4)


def test_numbers_that_begin_at_an_odd_byte():
    """The core's loops take whole numbers of eight bytes, at places that are multiples of it."""
    raw = b"\0" + np.arange(5.0).tobytes()
    column = pa.Array.from_buffers(pa.float64(), 5, [None, pa.py_buffer(memoryview(raw)[1:])])
    assert not column.to_numpy().flags.aligned
    x = numbers(column, frozenset())
    assert x.flags.aligned and x.tolist() == [0, 1, 2, 3, 4]


def test_the_fuzzer_can_fail(monkeypatch, tmp_path):
    """Errors other than InputError are counted, and so are those that the net below it caught."""
    path = tmp_path / "x.parquet"
    out = io.BytesIO()
    pq.write_table(two_loops(), out)
    path.write_bytes(out.getvalue())

    def broken(*_, **__):
        raise KeyError("x")

    monkeypatch.setattr(importlib.import_module("glapp.estimate"), "analyze", broken)
    with pytest.raises(KeyError):
        fuzzer.read_one(path)
    monkeypatch.undo()
    monkeypatch.setattr("glapp.reading.WideRecording", broken)
    with pytest.raises(InputError, match="a fault in glapp"):
        fuzzer.read_one(path)


def test_numbers_near_the_largest_there_is_warn_of_nothing():
    """Regression: their sum overflows, and the terminal showed a warning of arithmetic."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        recording = recording_from({"t": np.arange(3.0), "SP": np.ones(3), "PV": [1.7e308, 1.7e308, 1.0]})
        [batch] = recording.batches()
    assert batch.pv.tolist() == [1.7e308, 1.7e308, 1.0] and batch.flags is None


def test_a_fault_is_reported_with_its_row_though_the_file_breaks_off_behind_it(tmp_path):
    """The row was looked for in what cannot be unpacked: of 3000 packed files four ended in a traceback."""
    text = "time,SP,PV,OP\n" + "".join(f"{k},50,{50 + 7919 * k % 97},40\n" for k in range(50_000))
    path = tmp_path / "plant.csv.bz2"
    path.write_bytes(bz2.compress(text.encode(), 1))
    source = CsvSource(str(path), "plant.csv.bz2")
    data = bytearray(path.read_bytes())
    data[-2000] ^= 0x55  # in the last of its blocks
    path.write_bytes(data)
    assert source.row_number(8) == 10
