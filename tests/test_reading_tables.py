"""Tables of every kind give the same batches, and so do Parquet, Arrow and CSV files of them."""

from datetime import datetime

import numpy as np
import pandas as pd
import polars as pl
import pyarrow as pa
import pyarrow.csv as pacsv
import pyarrow.feather as feather
import pyarrow.ipc as ipc
import pyarrow.parquet as pq
import pytest
from test_reading_csv import joined

from glapp.errors import InputError
from glapp.loop import Loop
from glapp.reading import open_recordings, recording_from
from glapp.recording import BAD, NOT_AUTO

N = 70_000  # more than one batch


@pytest.fixture(scope="module")
def table():
    rng = np.random.default_rng(7)
    pv = np.round(rng.normal(50, 1, N), 6)
    pv[5] = np.nan
    mode = np.where(np.arange(N) % 1000 < 990, "AUTO", "MAN")
    t = np.datetime64("2024-01-01T00:00:00", "ms") + np.arange(N) * np.timedelta64(1500, "ms")
    return pa.table(
        {"note": [""] * N, "t": t, "SP": pa.array(np.full(N, 50), pa.int32()), "PV": pv, "OP": pv / 2, "MODE": mode}
    )


def same(a, b):
    for name in ("t", "sp", "pv", "op", "flags"):
        np.testing.assert_array_equal(a[name], b[name])


def check(recording, table):
    got = joined(recording.batches())
    np.testing.assert_array_equal(got["t"], np.arange(N) * 1.5)
    np.testing.assert_array_equal(got["pv"], table["PV"].to_numpy())
    np.testing.assert_array_equal(got["op"], table["OP"].to_numpy())
    assert (got["flags"][:7] == [0, 0, 0, 0, 0, BAD, 0]).all()
    assert (got["flags"][990:1001] == [NOT_AUTO] * 10 + [0]).all()
    assert recording.t0 == datetime(2024, 1, 1)
    for batch in recording.batches():
        for name in ("t", "sp", "pv", "op"):
            array = getattr(batch, name)
            assert array.dtype == np.float64 and array.flags.c_contiguous
    same(got, joined(recording.batches(rows=7777)))
    assert max(len(b) for b in recording.batches(rows=7777)) == 7777


def as_pandas_index(table):
    frame = table.to_pandas().set_index("t")
    frame.index.name = None
    return frame


@pytest.mark.parametrize(
    "kind",
    [
        lambda t: t,
        lambda t: t.to_pandas(),
        as_pandas_index,
        pl.from_arrow,
        lambda t: {n: t[n].to_numpy() for n in t.column_names},
        lambda t: {n: t[n] for n in t.column_names},
        lambda t: t.set_column(5, "MODE", t["MODE"].dictionary_encode()),
        lambda t: t.set_column(3, "PV", t["PV"].cast(pa.string())),
        lambda t: t.set_column(2, "SP", t["SP"].cast(pa.decimal128(12, 2))),
    ],
    ids=["arrow", "pandas", "pandas index", "polars", "numpy", "dict of arrow", "dictionary", "text", "decimal"],
)
def test_tables_in_memory(table, kind):
    check(recording_from(kind(table)), table)


def test_structured_array_and_fraction():
    data = np.array([(0.0, 1.0, 2.0), (1.0, 1.0, 3.0)], [("t", "f8"), ("SP", "f8"), ("PV", "f4")])
    recording = recording_from(data)
    assert (recording.rows, recording.source, recording.fraction_read()) == (2, "memory", None)
    assert joined(recording.batches())["pv"].tolist() == [2, 3]
    assert recording.fraction_read() == 1.0


@pytest.mark.parametrize("kind", ["parquet", "one row group", "ipc", "stream", "feather", "csv"])
@pytest.mark.slow
def test_files_give_the_batches_of_the_table(table, kind, tmp_path):
    path = tmp_path / "F1.data"
    match kind:
        case "parquet":
            pq.write_table(table, path, row_group_size=10_000)
        case "one row group":
            pq.write_table(table, path, compression="zstd")
        case "ipc" | "stream":
            with (ipc.new_file if kind == "ipc" else ipc.new_stream)(path, table.schema) as file:
                file.write_table(table)
        case "feather":
            feather.write_feather(table, str(path), compression="zstd")
        case "csv":
            pacsv.write_csv(table, path)
    [recording] = open_recordings(path)
    assert recording.name == "F1"
    check(recording, table)
    assert recording.fraction_read() == 1.0
    assert recording.rows == (N if "parquet" in kind or "group" in kind else None)


@pytest.mark.parametrize(
    ("data", "line"),
    [
        ({"t": [0, 1], "SP": [1, 2]}, "memory: no column for PV: all are taken (time is t, SP is SP)"),
        ({"t": [0], "SP": [1], "PV": [1]}, "memory: has only one row"),
        ({"t": [], "SP": [], "PV": []}, "memory: has no rows"),
        ({"t": [0, 1], "SP": [1, 2], "PV": [1]}, "memory: cannot be read as a table"),
        ({"t": [0, 1], "SP": [1, 2], "PV": ["x", "1"]}, "memory, row 1, column PV: 'x' is not a number"),
        ({"t": [0, 1], "SP": [1, 2], "PV": [[1], [2]]}, "memory, row 1, column PV: holds list<"),
        ({"t": [0, None], "SP": [1, 2], "PV": [1, 2]}, "memory, row 2, column t: the time is empty"),
        ({"t": [0, np.nan], "SP": [1, 2], "PV": [1, 2]}, "memory, row 2, column t: 'nan' is not a time"),
        ({"t": [0, 1], "SP": [1, 2], "PV": [np.nan, np.inf]}, "memory, column PV: has no value in any of 2 rows"),
        ({"A.SP": [1, 1], "A.PV": [1, 1], "B.SP": [1, 1], "B.PV": [1, 1], "t": [0, 1]}, "memory: holds 2 loops: A, B"),
        ([1, 2, 3], "memory: a list is not a table with named columns"),
        (np.zeros((3, 3)), "memory: a ndarray is not a table"),
    ],
)
def test_wrong_tables_are_one_line(data, line):
    with pytest.raises(InputError) as caught:
        list(recording_from(data).batches())
    assert str(caught.value).startswith(line)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("unit", ["s", "ms", "us", "ns"])
def test_durations_are_times_since_the_beginning(unit):
    """A TimedeltaIndex of pandas was refused: "holds duration[us], not times"."""
    t = (np.arange(3) * 1500).astype("timedelta64[ms]") + np.timedelta64(45000, "D")  # no day number of Excel
    table = pa.table(
        {"Timestamp": pa.array(t).cast(pa.duration(unit), safe=False), "SP": [1.0, 2, 3], "PV": [1.0, 2, 3]}
    )
    recording = recording_from(table)
    got = joined(recording.batches())
    whole = [0, 1.5, 3] if unit != "s" else [0, 1, 3]
    assert recording.t0 is None and recording.found == []
    np.testing.assert_allclose(got["t"] - 45000 * 86400.0, whole, atol=1e-5)
    frame = pd.DataFrame({"SP": [1.0, 2, 3], "PV": [1.0, 2, 3]}, index=pd.to_timedelta([0, 1, 2], unit="s"))
    assert joined(recording_from(frame).batches())["t"].tolist() == [0, 1, 2]
    with pytest.raises(InputError, match=r"^memory, row 2, column t: the time is empty"):
        list(recording_from({"t": pa.array([0, None], pa.duration("s")), "PV": [1, 2], "OP": [1, 2]}).batches())


def test_a_masked_value_of_a_table_is_none():
    """The number under the mask was read as a value."""
    pv = np.ma.masked_array([1.0, -9999.0, 2.0], mask=[False, True, False])
    structured = np.ma.masked_array(
        np.array([(0, 1.0, 1), (1, -9999.0, 1), (2, 2.0, 1)], [("t", float), ("PV", float), ("SP", float)]),
        mask=[(0, 0, 0), (0, 1, 0), (0, 0, 0)],
    )
    for data in ({"t": [0, 1, 2], "SP": [1, 1, 1], "PV": pv}, structured):
        assert joined(recording_from(data).batches())["flags"].tolist() == [0, BAD, 0]


def test_a_data_frame_with_words_among_numbers():
    """As a sheet with Bad in it becomes one; it was refused in words of Arrow, and the same CSV was read."""
    data = {"t": [0, 1, 2, 3], "SP": [1.0, 1, 1, 1], "PV": [1.5, "Bad", 2.5, None], "OP": [1, 2, 3, 4]}
    got = joined(recording_from(pd.DataFrame(data)).batches())
    assert got["flags"].tolist() == [0, BAD, 0, BAD] and got["pv"][[0, 2]].tolist() == [1.5, 2.5]
    with pytest.raises(InputError, match=r"^memory, row 2, column PV: 'x' is not a number"):
        list(recording_from(pd.DataFrame(data | {"PV": [1.5, "x", 2.5, 3]})).batches())


def test_who_has_a_table_in_memory_is_told_what_to_write_in_python():
    """Options of the command line and keys of loops.toml were named to who works in a notebook."""
    loop = r'name (it|them): loop = glapp.Loop\(name="loop", columns={"'
    with pytest.raises(InputError, match=loop + r'time": "NAME"}\); or say how far rows are apart: sample_time='):
        recording_from({"PV": [1, 2], "OP": [1, 2]})
    with pytest.raises(InputError, match=loop + r'pv": "NAME", "op": "NAME"}\)'):
        recording_from({"t": [0, 1], "a": [1, 2], "b": [1, 2]})
    with pytest.raises(InputError, match=r'name the right one: loop = glapp.Loop\(name="loop", columns={"op": "OP"}'):
        recording_from({"t": [0, 1], "PV": [1, 2], "OP": [1, 2], "MV": [1, 2]})


def test_a_loop_is_chosen_by_its_name():
    data = {"A.SP": [1, 1], "A.PV": [1, 1], "B.SP": [2, 2], "B.PV": [2, 2], "t": [0, 1]}
    assert joined(recording_from(data, Loop(name="b")).batches())["sp"].tolist() == [2, 2]
    with pytest.raises(InputError, match="loop C: no column for PV and OP among"):
        recording_from(data, Loop(name="C"))


def test_damaged_files_are_refused(tmp_path, table):
    path = tmp_path / "F1.parquet"
    pq.write_table(table, path)
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    with pytest.raises(InputError, match="is not a readable Parquet file"):
        open_recordings(path)
    path.write_bytes(b"PAR1" + bytes(100))
    with pytest.raises(InputError, match="is not a readable Parquet file"):
        open_recordings(path)
    path.write_bytes(b"ARROW1" + bytes(100))
    with pytest.raises(InputError, match="is not a readable Arrow file"):
        open_recordings(path)
    damaged = bytearray(data)
    damaged[200 : len(data) // 2] = bytes(len(data) // 2 - 200)
    path.write_bytes(damaged)
    with pytest.raises(InputError, match=r"is damaged|PV"):
        list(open_recordings(path)[0].batches())
