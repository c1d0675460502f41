"""Many loops in one wide file: values as if alone, few passes, bounded memory, and a fault stops its own loop only."""

from collections import Counter

import numpy as np
import pyarrow as pa
import pyarrow.csv as pacsv
import pyarrow.ipc as ipc
import pyarrow.parquet as pq
import pytest
from test_reading_csv import joined

import glapp.reading.columns as columns
import glapp.reading.csv as csv_module
import glapp.reading.passes as passes
from glapp.errors import InputError
from glapp.loop import Loop
from glapp.reading import open_each, open_recordings
from glapp.reading.apart import ApartSource
from glapp.reading.csv import CsvSource

ROWS = 700
_CODED = pa.dictionary(pa.int32(), pa.string())


def table(loops, rows=ROWS):
    rng = np.random.default_rng(loops)
    made = {"Timestamp": np.datetime64("2026-03-01T00:00:00", "s") + np.arange(rows)}
    for i in range(loops):
        made[f"FIC{i}.SP"] = np.full(rows, 50.0 + i)
        made[f"FIC{i}.PV"] = np.round(50 + i + rng.normal(size=rows), 4)
        made[f"FIC{i}.OP"] = np.round(40 + rng.normal(size=rows), 4)
        made[f"FIC{i}.MODE"] = np.where(rng.random(rows) < 0.9, "AUTO", "MAN")
    return pa.table(made)


def write(table, path):
    match path.suffix:
        case ".csv":
            pacsv.write_csv(table, path, pacsv.WriteOptions(quoting_style="none"))
        case ".parquet":
            pq.write_table(table, path, row_group_size=300)
        case ".arrow":
            with ipc.new_file(path, table.schema) as file:
                file.write_table(table, max_chunksize=300)
    return path


@pytest.fixture
def reads(monkeypatch):
    """Number of reads of each column of a file: a list of column indices per pass."""
    made = []
    for source in (CsvSource, ApartSource):
        whole = source.stream

        def stream(self, types, bad_words, whole=whole):
            made.append(list(types))
            return whole(self, types, bad_words)

        monkeypatch.setattr(source, "stream", stream)
    return made


def same(one, other):
    for name in ("t", "sp", "pv", "op", "flags"):
        np.testing.assert_array_equal(one[name], other[name])


def alone(path, i):
    """Loop i when nothing else is read."""
    [recording] = open_recordings(path, [Loop(name=f"FIC{i}")])
    return joined(recording.batches())


@pytest.mark.verify
@pytest.mark.parametrize("ending", [".csv", ".parquet", ".arrow"])
@pytest.mark.parametrize("block", [1 << 22, 20_000])
def test_all_loops_are_read_in_one_pass_with_the_values_they_have_alone(tmp_path, reads, monkeypatch, ending, block):
    monkeypatch.setattr("glapp.reading.csv._BLOCK", block)  # blocks of 80 rows, whose dictionaries of modes differ
    path = write(table(30), tmp_path / f"plant{ending}")
    recordings = open_recordings(path)
    reads.clear()
    assert [recording.name for recording in recordings] == [f"FIC{i}" for i in range(30)]
    got = [joined(recording.batches()) for recording in recordings]
    again = [joined(recording.batches()) for recording in recordings]
    assert len(reads) == 1  # of old every loop read the file again, twice
    for i, (first, second) in enumerate(zip(got, again, strict=True)):
        same(first, second)
        assert recordings[i].fraction_read() == 1.0
    for i in (0, 17, 29):
        same(got[i], alone(path, i))


@pytest.mark.slow
def test_names_are_understood_once_however_many_loops_there_are(monkeypatch, tmp_path):
    asked = Counter()
    understand = columns.understand
    monkeypatch.setattr(columns, "understand", lambda name: asked.update([name]) or understand(name))
    counts = {}
    for loops in (10, 40):
        asked.clear()
        understand.cache_clear()  # other tests have read such names
        open_recordings(write(table(loops, 5), tmp_path / f"{loops}.parquet"))
        counts[loops] = asked.total() / loops
    # A file has some of its own. It was 18 times the number of columns, for each loop.
    assert counts[40] <= 1.1 * counts[10]


@pytest.mark.verify
@pytest.mark.parametrize("ending", [".csv", ".parquet", ".arrow"])
def test_what_is_held_is_bounded_and_more_passes_are_made(tmp_path, reads, monkeypatch, ending):
    path = write(table(20), tmp_path / f"plant{ending}")
    whole = [alone(path, i) for i in range(20)]
    monkeypatch.setattr(passes, "HELD", 8 * ROWS * 5 * 8)  # eight loops
    recordings = open_recordings(path)
    reads.clear()
    for recording, want in zip(recordings, whole, strict=True):
        same(joined(recording.batches()), want)
        same(joined(recording.batches()), want)
        held = sum(r._share.held.size for r in recordings if r._share.held is not None)
        assert held <= passes.HELD * 1.25 + 1000  # the column of times is shared, but counted for each
    assert 3 <= len(reads) <= 7


@pytest.mark.slow
def test_a_loop_too_large_to_hold_is_streamed(tmp_path, monkeypatch):
    for ending in (".csv", ".parquet"):
        path = write(table(3), tmp_path / f"plant{ending}")
        want = [alone(path, i) for i in range(3)]
        monkeypatch.setattr(passes, "HELD", 1000)
        recordings = open_recordings(path)
        for recording, values in zip(recordings, want, strict=True):
            same(joined(recording.batches()), values)
            assert recording._share.held is None
        monkeypatch.undo()


def test_loops_that_nobody_holds_any_more_are_not_read(tmp_path, reads):
    path = write(table(12), tmp_path / "plant.csv")
    wanted = open_recordings(path)[3:5]
    reads.clear()
    list(wanted[0].batches())
    assert len(reads[0]) == 9  # the times, and four columns of each


def test_released_rows_are_read_again(tmp_path, reads):
    path = write(table(2), tmp_path / "plant.csv")
    first, _ = open_recordings(path)
    want = joined(first.batches())
    first.release()
    assert first._share.held is None
    same(joined(first.batches()), want)


def test_a_wrong_cell_stops_its_own_loop_only(tmp_path, reads):
    path = write(table(6), tmp_path / "plant.csv")
    lines = path.read_text().splitlines()
    for at, column, text in ((400, 6, "abc"), (650, 10, "xyz")):  # PV of FIC1 and of FIC2
        cells = lines[at].split(",")
        cells[column] = text
        lines[at] = ",".join(cells)
    path.write_text("\n".join(lines) + "\n")
    recordings = open_recordings(path)
    reads.clear()
    for i, recording in enumerate(recordings):
        if i in (1, 2):
            row, text = ((401, "abc"), (651, "xyz"))[i - 1]
            for _ in range(2):
                with pytest.raises(InputError, match=rf"row {row}, column FIC{i}.PV: '{text}' is not a number"):
                    list(recording.batches())
        else:
            assert sum(len(batch) for batch in recording.batches()) == ROWS
    assert len(reads) == 1


def test_a_ragged_row_is_told_of_every_loop_and_looked_for_once(tmp_path, reads, monkeypatch):
    path = write(table(6), tmp_path / "plant.csv")
    path.write_text(path.read_text() + "1,2,3\n1,2,3\n")
    slow = []
    records = CsvSource._records
    monkeypatch.setattr(CsvSource, "_records", lambda self: slow.append(1) or records(self))
    for recording in open_recordings(path):
        with pytest.raises(InputError, match=f"row {ROWS + 2}: has 3 cells where the header has 25"):
            list(recording.batches())
    assert (len(reads), len(slow)) == (1, 1)


@pytest.mark.slow
def test_a_damaged_column_of_parquet_stops_its_own_loop_only(tmp_path):
    path = write(table(9), tmp_path / "plant.parquet")
    column = pq.ParquetFile(path).metadata.row_group(0).column(4 * 5 + 2)
    assert column.path_in_schema == "FIC5.PV"
    data = bytearray(path.read_bytes())
    start = column.dictionary_page_offset or column.data_page_offset
    data[start : start + 40] = b"\xff" * 40
    path.write_bytes(data)
    good = 0
    for i, recording in enumerate(open_recordings(path)):
        try:
            good += sum(len(batch) for batch in recording.batches()) == ROWS
        except InputError as error:
            assert i == 5, error
    assert good == 8


def test_loops_with_words_of_their_own_for_bad_values_keep_them(tmp_path):
    path = tmp_path / "plant.csv"
    path.write_text("t,A.SP,A.PV,B.SP,B.PV\n" + "".join(f"{k},1,{'Oops' if k == 5 else k},1,{k}\n" for k in range(20)))
    a, b = open_recordings(path, [Loop(name="A", bad_values=["oops"]), Loop(name="B")])
    assert np.isnan(joined(a.batches())["pv"][5])
    assert joined(b.batches())["pv"][5] == 5


@pytest.mark.slow
@pytest.mark.parametrize("long", [70_000, 300_000])
def test_a_header_beyond_the_first_sample_is_read(tmp_path, long):
    """Regression: the file "has a header but no rows", since only the first 64 KiB were looked at."""
    prefix = "PLANT_A/UNIT_300/AREA_12/CONTROLLERS/MODULE_7/"
    loops = long // 200
    made = table(loops, 40).rename_columns(tag_names(loops, prefix))
    path = write(made, tmp_path / "plant.csv")
    assert len(path.read_text().splitlines()[0]) > 65536
    recordings = open_recordings(path)
    assert len(recordings) == loops
    assert recordings[-1].name == f"{prefix}FIC{loops - 1}"
    np.testing.assert_array_equal(joined(recordings[-1].batches())["pv"], made[f"{prefix}FIC{loops - 1}.PV"])


def tag_names(loops, prefix):
    return ["Timestamp", *(f"{prefix}FIC{i}.{role}" for i in range(loops) for role in ("SP", "PV", "OP", "MODE"))]


def test_a_file_without_line_ends_is_not_read_whole_to_find_one(tmp_path, monkeypatch):
    monkeypatch.setattr("glapp.reading.csv._LARGEST_SAMPLE", 1 << 20)
    path = tmp_path / "one.csv"
    path.write_bytes(b"1,2,3," * 400_000)
    with pytest.raises(InputError, match="has a first line of more than 1 MiB"):
        open_recordings(path)


def test_the_loop_without_a_prefix_keeps_its_columns_beside_one_named_like_the_file(tmp_path):
    path = tmp_path / "FIC1.csv"
    path.write_text("t,SP,PV,FIC1.SP,FIC1.PV\n0,1,2,3,4\n1,1,2,3,4\n")
    names = {entry.name: dict(entry.columns) for entry in open_each(path)}
    assert names["FIC1"]["PV"] == "FIC1.PV"
    assert names["FIC1 (no prefix)"]["PV"] == "PV"


def test_small_blocks_that_arrow_cannot_join_are_read_one_by_one(tmp_path):
    whole = table(2)
    mode = pa.array([None if k % 50 == 3 else "MAN" if k % 7 == 0 else "AUTO" for k in range(ROWS)])
    with ipc.new_stream(path := tmp_path / "two.arrow", whole.schema.set(4, pa.field("FIC0.MODE", _CODED))) as file:
        for start in range(0, ROWS, 100):  # each with a dictionary of its own, in which a null stands
            batch = whole.slice(start, 100).combine_chunks().to_batches()[0]
            coded = mode.slice(start, 100).dictionary_encode(null_encoding="encode")
            file.write_batch(batch.set_column(4, "FIC0.MODE", coded))
    write(whole.set_column(4, "FIC0.MODE", mode), tmp_path / "plain.parquet")
    for one, other in zip(open_recordings(path), open_recordings(tmp_path / "plain.parquet"), strict=True):
        same(joined(one.batches()), joined(other.batches()))


def test_a_loop_that_is_let_go_while_room_is_made(tmp_path, monkeypatch):
    """Another thread that was done with its loop did so, and this one was refused for a fault in glapp."""
    recordings = open_recordings(write(table(3), tmp_path / "plant.csv"))
    joined(recordings[0].batches())
    of_all = recordings[0]._share._passes
    held = passes._Held.size.fget

    def let_go(self):
        for recording in recordings:
            recording.release()
        return held(self)

    monkeypatch.setattr(passes._Held, "size", property(let_go))
    assert all(recording._share.held is not None for recording in recordings)
    assert of_all._make_room() > 0


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_a_slow_loop_beside_a_fast_one_has_its_own_rows(tmp_path, ending, monkeypatch):
    """Regression: the rows of the fast loop counted as rows without a value, and the slow one was refused."""
    monkeypatch.setattr(csv_module, "_BLOCK", 100)  # some blocks hold no row of the slow loop
    rows = 60
    made = {"t": np.arange(rows), "F1.SP": np.full(rows, 5.0), "F1.PV": np.arange(rows) % 7.0}
    slow = [k % 20 == 5 for k in range(rows)]
    for name, value in (("T9.SP", 8.0), ("T9.PV", 9.0), ("T9.OP", 4.0)):
        made[name] = [value if here else None for here in slow]
    path = tmp_path / f"x.{ending}"
    write(pa.table(made), path)
    fast, loop = open_recordings(path)
    got, all_ = joined(loop.batches()), joined(fast.batches())
    assert got["t"].tolist() == [5, 25, 45] and got["pv"].tolist() == [9, 9, 9] and not got["flags"].any()
    assert all_["t"].tolist() == list(range(rows))


def test_a_word_for_a_bad_value_is_a_row_of_its_loop(tmp_path):
    path = tmp_path / "x.csv"
    cells = ["5,6,7" if k % 4 == 0 else "Bad,Bad,Bad" if k == 9 else ",," for k in range(40)]
    path.write_text("\n".join(["t,SP,PV,OP", *(f"{k},{cell}" for k, cell in enumerate(cells))]))
    [loop] = open_recordings(path)
    got = joined(loop.batches())
    assert got["t"].tolist() == sorted([*range(0, 40, 4), 9])
    assert np.flatnonzero(np.isnan(got["pv"])).tolist() == [3]


def test_a_pause_in_a_recording_is_no_other_loop(tmp_path):
    """Of rows that are empty now and then each is a row without a value, as before."""
    path = tmp_path / "x.csv"
    path.write_text("\n".join(["t,SP,PV,OP", *(f"{k},5,{k % 7},7" if k % 3 else f"{k},,," for k in range(40))]))
    [loop] = open_recordings(path)
    assert len(joined(loop.batches())["t"]) == 40
