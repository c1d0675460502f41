"""Files of strangers: what asks for too much is refused in one line, and costs no other file its answer."""

import bz2
import gzip
import io
import json
import os
import signal
import subprocess
import sys
import time
import zipfile
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.ipc as ipc
import pyarrow.parquet as pq
import pytest

from glapp.errors import InputError
from glapp.loop import Loop
from glapp.reading import apart, bounds, csv, excel, open_each, open_recordings
from glapp.reading.files import FORMS
from glapp.reading.parquet import ParquetSource
from glapp.station import step_test

NAMES = ("t", "SP", "PV", "OP")
KEEPS_MEMORY = pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="there is no limit of memory")


def sheet_rows():
    """Text of a sheet's rows: names, and 30 samples."""
    yield "".join(
        f'<c r="{c}1" t="inlineStr"><is><t>{name}</t></is></c>' for c, name in zip("ABCD", NAMES, strict=True)
    )
    for k in range(30):
        values = (k, 50, 50 + k % 7, 40 + k % 5)
        yield "".join(f'<c r="{c}{k + 2}"><v>{v}</v></c>' for c, v in zip("ABCD", values, strict=True))


def workbook(path, more="", dimension="A1:D31", strings=None):
    """A workbook of one sheet: the rows of a recording, and lines below them."""
    space = 'xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main"'
    office = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
    package = "http://schemas.openxmlformats.org/package/2006/relationships"
    rows = "".join(f'<row r="{i + 1}">{cells}</row>' for i, cells in enumerate(sheet_rows()))
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as parts:
        for name, text in {
            "_rels/.rels": f'<Relationships xmlns="{package}"><Relationship Id="rId1" Type="{office}/officeDocument" '
            'Target="xl/workbook.xml"/></Relationships>',
            "xl/workbook.xml": f'<workbook {space} xmlns:r="{office}"><sheets><sheet name="S" sheetId="1" r:id="rId1"/>'
            "</sheets></workbook>",
            "xl/_rels/workbook.xml.rels": f'<Relationships xmlns="{package}"><Relationship Id="rId1" '
            f'Type="{office}/worksheet" Target="worksheets/sheet1.xml"/></Relationships>',
            "xl/worksheets/sheet1.xml": f'<worksheet {space}><dimension ref="{dimension}"/><sheetData>{rows}{more}'
            "</sheetData></worksheet>",
        }.items():
            parts.writestr(name, text)
        if strings is not None:
            parts.writestr("xl/sharedStrings.xml", f"<sst {space}>{strings}</sst>")
    return path


def far(cell, value="<v>1</v>", kind=""):
    row = cell.lstrip("ABCDEFGHIJKLMNOPQRSTUVWXYZ")
    return f'<row r="{row}"><c r="{cell}"{kind}>{value}</c></row>'


@pytest.mark.slow
def test_a_workbook_of_one_far_cell_is_refused_before_memory_is_asked_for(tmp_path):
    """5.7 kB asked for 549 GB, and the process was aborted with the answers of all other files."""
    for cell, cells in (("XFD1048576", 2**34), ("XFD5000", 5000 * 2**14), ("AAAA1440", 1440 * 18_279)):
        path = workbook(tmp_path / "plant.xlsx", far(cell))
        line = rf"plant\.xlsx: has cells as far as {cell}, {cells} cells .*at most 8388608 are read; delete what stands"
        with pytest.raises(InputError, match=line):
            open_recordings(path)


def test_the_declared_dimension_is_not_believed(tmp_path):
    [recording] = open_recordings(workbook(tmp_path / "plant.xlsx", dimension="A1:XFD1048576"))
    assert sum(map(len, recording.batches())) == 30


@pytest.mark.slow
def test_cells_that_only_have_a_look_ask_for_nothing(tmp_path):
    """Excel writes them to the last row where a whole column has a colour."""
    path = workbook(tmp_path / "plant.xlsx", '<row r="1048576" s="3"><c r="XFD1048576" s="3"/></row>')
    [recording] = open_recordings(path)
    assert sum(map(len, recording.batches())) == 30


@pytest.mark.parametrize("at", ["in a cell", "among the shared strings"])
def test_one_long_cell_is_refused(tmp_path, at):
    """900 MB of one letter in 880 kB asked for 5.4 GB."""
    text = "x" * (5 << 20)
    if at == "in a cell":
        path = workbook(tmp_path / "plant.xlsx", far("A40", f"<is><t>{text}</t></is>", ' t="inlineStr"'))
    else:
        path = workbook(tmp_path / "plant.xlsx", strings=f"<si><t>{text}</t></si>")
    with pytest.raises(InputError, match=r"has a cell of more than 1024 KiB; Excel's own have .*; save the sheet as"):
        open_recordings(path)


def test_a_workbook_that_unpacks_to_too_much_is_refused(tmp_path, monkeypatch):
    """The sizes in its directory are not trusted either."""
    monkeypatch.setattr(bounds, "UNPACKED", 1 << 20)
    monkeypatch.setattr(bounds, "RATIO", 1)
    path = workbook(tmp_path / "plant.xlsx", "".join(far(f"A{40 + k}") for k in range(60_000)))
    with pytest.raises(InputError, match=r"unpacks to more than 1 MiB, as far as it is read; save the sheet as CSV"):
        excel._sheets(str(path), str(path))


def test_a_workbook_of_too_many_parts_is_refused(tmp_path):
    path = workbook(tmp_path / "plant.xlsx")
    with zipfile.ZipFile(path, "a") as parts:
        for k in range(bounds.PARTS):
            parts.writestr(f"x/{k}", b"")
    with pytest.raises(InputError, match=r"holds 10004 files, a workbook of at most 10000 is read"):
        open_recordings(path)


@pytest.mark.slow
@KEEPS_MEMORY
def test_what_no_check_foresees_ends_the_process_apart_and_no_other(tmp_path):
    """One shared string of 32 kB in 60 000 cells: 2 GB of memory, of a file that breaks no other bound."""
    cells = "".join(far(f"A{40 + k}", "<v>0</v>", ' t="s"') for k in range(60_000))
    path = workbook(tmp_path / "plant.xlsx", cells, strings=f"<si><t>{'x' * 32_000}</t></si>")
    with pytest.raises(InputError, match=r"asks for more memory than the 1024 MiB that are allowed"):
        open_recordings(path)
    [recording] = open_recordings(workbook(path))
    assert sum(map(len, recording.batches())) == 30


@pytest.mark.parametrize("columns", [10**5, 10**6])
@pytest.mark.slow
def test_a_table_that_is_too_wide_is_refused_at_its_first_line(tmp_path, columns):
    """Regression: the tables took 15 s and more than a minute."""
    path = tmp_path / "plant.csv"
    path.write_text("\n".join([",".join(f"c{k}" for k in range(columns)), *4 * ["1," * (columns - 1) + "1"]]))
    with pytest.raises(
        InputError, match=rf"has {columns} columns, at most 16384 are read; split it into files of fewer"
    ):
        open_recordings(path)


@pytest.mark.slow
@pytest.mark.parametrize("ending", [".parquet", ".arrow"])
def test_a_file_of_columns_that_is_too_wide_is_refused(tmp_path, ending):
    path = tmp_path / f"plant{ending}"
    table = pa.table({f"c{k}": pa.array([1.0]) for k in range(bounds.COLUMNS + 1)})
    if ending == ".parquet":
        pq.write_table(table, path)
    else:
        with ipc.new_file(path, table.schema) as file:
            file.write_table(table)
    with pytest.raises(InputError, match="has 16385 columns, at most 16384 are read"):
        open_recordings(path)


@pytest.mark.slow
def test_the_widest_table_there_may_be_is_read(tmp_path):
    """Arrow took 190 kB a column for the words for bad values, in each thread: it asked for 9 GB and was aborted."""
    loops = bounds.COLUMNS // 4
    path = tmp_path / "plant.csv"
    names = [f"F{k}.{role}" for k in range(loops) for role in ("SP", "PV", "OP")]
    row = "50,50.1,40," * loops
    path.write_text("\n".join(["t," + ",".join(names), *(f"{k},{row[:-1]}" for k in range(20))]) + "\n")
    opened = open_each(path)
    assert len(opened) == loops
    assert sum(map(len, opened[-1].batches())) == 20


@pytest.mark.slow
@pytest.mark.parametrize(("ending", "pack"), [(".gz", gzip.compress), (".bz2", bz2.compress), (".zst", None)])
@pytest.mark.parametrize("filling", [b" ", b"12,50,51,40\n"])
def test_a_packed_file_that_unpacks_to_too_much_is_refused(tmp_path, monkeypatch, ending, pack, filling):
    """3 MB of 3 GB of spaces took more than a minute without a word."""
    monkeypatch.setattr(bounds, "UNPACKED", 20 << 20)
    monkeypatch.setattr(bounds, "RATIO", 1)
    path = tmp_path / f"plant.csv{ending}"
    text = b"t,SP,PV,OP\n" + b"".join(b"%d,50,%d,40\n" % (k, 50 + k % 7) for k in range(9000))
    text += (filling * (24 << 20 if filling == b" " else 2 << 20))[: 24 << 20]
    path.write_bytes(pack(text) if pack else pa.Codec("zstd").compress(text).to_pybytes())
    with pytest.raises(InputError) as refused:
        [recording] = open_recordings(path)
        sum(map(len, recording.batches()))
    line = "has a row of more than 16 MiB" if filling == b" " else "unpacks to more than 20 MiB, as far as it is read"
    assert line in str(refused.value)


def test_a_file_that_begins_with_spaces_without_end_is_not_called_empty(tmp_path):
    """3 GB of spaces in 3 MB. Regression: the text after the first of them was never looked at."""
    path = tmp_path / "plant.csv.gz"
    path.write_bytes(gzip.compress(b" " * (18 << 20) + b"\nt,SP,PV,OP\n0,50,50,40\n", 1))
    with pytest.raises(InputError, match="begins with 16384 KiB of nothing but spaces and empty lines; delete them"):
        open_recordings(path)


def test_a_row_without_an_end_is_refused(tmp_path):
    path = tmp_path / "plant.csv"
    rows = b"".join(b"%d,50,%d,40\n" % (k, 50 + k % 7) for k in range(9000))
    path.write_bytes(b"t,SP,PV,OP\n" + rows + b"1" * (18 << 20))
    [recording] = open_recordings(path)
    with pytest.raises(InputError, match="has a row of more than 16 MiB, which ends not before byte"):
        sum(map(len, recording.batches()))


def test_only_the_row_after_a_ragged_one_is_looked_at(tmp_path, monkeypatch):
    """All of the file was, to say whether it ends there: minutes for what unpacks to gigabytes."""
    path = tmp_path / "plant.csv"
    path.write_text("t,SP,PV,OP\n" + "".join(f"{k},50,50,40\n" for k in range(9000)) + "7,50\n" + "1,2,3,4\n" * 9000)
    seen = []
    lines = csv.CsvSource._lines

    def counted(self):
        for line in lines(self):
            seen.append(line)
            yield line

    monkeypatch.setattr(csv.CsvSource, "_lines", counted)
    [recording] = open_recordings(path)
    with pytest.raises(InputError, match=r"row 9002: has 2 cells where the header has 4; correct or delete the row$"):
        sum(map(len, recording.batches()))
    assert len(seen) == 9003


@pytest.mark.slow
def test_rows_without_end_in_a_small_parquet_file(tmp_path, monkeypatch):
    """Runs of one value take no room in it: the rows it holds are no measure of the file."""
    monkeypatch.setattr(bounds, "UNPACKED", 1 << 20)
    monkeypatch.setattr(bounds, "RATIO", 1)
    path = tmp_path / "plant.parquet"
    n = 300_000
    table = pa.table({"t": np.arange(n), "SP": np.full(n, 50.0), "PV": np.full(n, 50.0), "OP": np.full(n, 40.0)})
    pq.write_table(table, path, compression="zstd", column_encoding={"t": "DELTA_BINARY_PACKED"}, use_dictionary=["PV"])
    types = {0: pa.int64(), 2: pa.float64()}
    with pytest.raises(InputError, match="unpacks to more than 1 MiB, as far as it is read; split it"):
        for _ in apart._pieces(ParquetSource, str(path), str(path), types, frozenset()):
            pass


@pytest.mark.slow
def test_long_text_is_handed_over_in_pieces(tmp_path, monkeypatch):
    """A damaged file gave a gigabyte of text in one batch, which two processes then held at once: 1.7 GB."""
    monkeypatch.setattr(bounds, "PIECE", 1 << 20)
    path = tmp_path / "plant.parquet"
    n = 6000
    text = [f"{k % 9}" * 1000 for k in range(n)]
    pq.write_table(pa.table({"t": np.arange(n), "PV": np.arange(n) * 0.1, "note": text}), path)
    types = {0: pa.int64(), 1: pa.float64(), 2: pa.string()}
    pieces = list(apart._pieces(ParquetSource, str(path), str(path), types, frozenset()))
    assert len(pieces) > 5 and max(piece.size for _, piece in pieces) < 1.1 * bounds.PIECE
    columns = [apart._unpacked(piece) for _, piece in pieces]
    assert sum(len(t) for t, _, _ in columns) == n
    assert [one for _, _, note in columns for one in note.to_pylist()] == text


def crash():
    """Ends the child by a signal."""
    os.kill(os.getpid(), signal.SIGKILL)


def fill():
    return len(bytearray(bounds.MEMORY + (1 << 27)))


def sleep(seconds):
    time.sleep(seconds)
    return "awake"


def spin():
    while True:
        pass


def whole():
    return {"answer": np.arange(3)}


@pytest.mark.slow
def test_a_process_that_ends_costs_one_answer():
    with pytest.raises(InputError, match=r"^x\.csv: ended the process that read it \((signal 9|exit code)"):
        apart.call("x.csv", crash)
    assert apart.call("x.csv", whole)["answer"].tolist() == [0, 1, 2]


BROKEN_OFF = """
import gc, itertools, sys
import pyarrow as pa
from glapp.reading import apart
from glapp.reading.parquet import ParquetSource
from glapp.reading.source import ahead

gc.set_threshold(10**9)  # what nothing refers to any more is freed at the end of Python
if sys.argv[2] == "apart":
    rows = apart.opened(ParquetSource, sys.argv[1], "x.parquet").stream({0: pa.int64()}, frozenset())
else:
    rows = ahead(itertools.count())
next(rows)
cycle = [rows]
cycle.append(cycle)
del rows, cycle
print("ended")
"""


@pytest.mark.parametrize("pass_", ["apart", "ahead"])
def test_a_pass_that_is_broken_off_does_not_keep_python_from_ending(tmp_path, pass_):
    """After an error a pass may stay until Python ends, where no thread starts and none that runs goes on."""
    path = tmp_path / "x.parquet"
    pq.write_table(pa.table({"t": np.arange(9)}), path)
    ended = subprocess.run(
        [sys.executable, "-c", BROKEN_OFF, str(path), pass_], capture_output=True, text=True, timeout=120
    )
    assert (ended.stdout, ended.stderr, ended.returncode) == ("ended\n", "", 0)


@KEEPS_MEMORY
@pytest.mark.slow
def test_memory_has_an_end():
    with pytest.raises(InputError, match=r"^x\.csv: asks for more memory than the 1024 MiB that are allowed"):
        apart.call("x.csv", fill)


@pytest.mark.slow
def test_time_has_an_end(monkeypatch):
    apart.call("x.csv", sleep, 0.0)
    monkeypatch.setattr(bounds, "PATIENCE", 0.5)
    for slow in (lambda: apart.call("x.csv", sleep, 60.0), lambda: apart.call("x.csv", spin)):
        with pytest.raises(InputError, match=r"^x\.csv: took longer than the 0\.5 s that a piece of a file may take"):
            slow()


@pytest.mark.slow
def test_a_pass_that_is_left_harms_none_that_follows(tmp_path):
    path = tmp_path / "plant.parquet"
    n = 400_000
    pq.write_table(pa.table({"t": np.arange(n), "SP": np.ones(n), "PV": np.arange(n) % 7.0}), path)
    for _ in range(3):
        [recording] = open_recordings(path)
        stream = recording.batches()
        next(stream)
        stream.close()
        assert sum(map(len, recording.batches())) == n


@pytest.mark.slow
@KEEPS_MEMORY
def test_one_bad_file_costs_its_own_answer_only(tmp_path, monkeypatch, run):
    monkeypatch.chdir(tmp_path)
    workbook(Path("far.xlsx"), far("XFD1048576"))
    cells = "".join(far(f"A{40 + k}", "<v>0</v>", ' t="s"') for k in range(60_000))
    workbook(Path("many.xlsx"), cells, strings=f"<si><t>{'x' * 32_000}</t></si>")
    Path("wide.csv").write_text("a," * 20_000 + "b\n" + "1," * 20_000 + "1\n")
    Path("spaces.csv.gz").write_bytes(gzip.compress(b"t,SP,PV\n" + b"1,2,3\n" * 20_000 + b" " * (20 << 20)))
    sound = "".join(f"{k},50,{50 + k % 7},{40 + k % 5}\n" for k in range(300))
    Path("first.csv").write_text("t,SP,PV,OP\n" + sound)
    workbook(Path("sound.xlsx"))
    pq.write_table(pa.table({"t": np.arange(300), "SP": np.ones(300), "PV": np.arange(300) % 7.0}), "last.parquet")
    files = ("first.csv", "far.xlsx", "wide.csv", "many.xlsx", "sound.xlsx", "spaces.csv.gz", "last.parquet")
    Path("loops.toml").write_text(
        "[defaults.controller]\nk = 0.8\nti = 25\n"
        + "".join(f'[loops."{file}"]\nfile = "{file}"\nop_span = [0, 100]\n' for file in files)
    )
    code, out, err = run("analyze", "--no-fit", "--json", "loops.toml")
    assert code == 1
    answered = {loop["file"] for loop in json.loads(out)["loops"] if loop["answer"]["valve"] != "refused"}
    assert answered == {"first.csv", "sound.xlsx", "last.parquet"}
    errors = [line for line in err.splitlines() if line.startswith("error:")]
    assert len(errors) == 4 and "Traceback" not in err
    for file in ("far.xlsx", "wide.csv", "many.xlsx", "spaces.csv.gz"):
        assert any(line.startswith(f"error: {file}") for line in errors)


@pytest.mark.slow
@KEEPS_MEMORY
def test_a_file_in_the_window_is_read_in_a_process_of_its_own(tmp_path):
    """A viewer who opened it as a step test ended the whole station."""
    loop = Loop(name="F1")
    path = workbook(tmp_path / "test.xlsx", far("XFD1048576"))
    with pytest.raises(InputError, match=r"^test\.xlsx: has cells as far as XFD1048576"):
        step_test.read_apart(path, loop, {}, manual=True)
    found = step_test.read_apart(workbook(path), loop, {}, manual=True)
    assert found.source.endswith("test.xlsx") and found.reason is not None


@pytest.mark.slow
def test_the_forms_that_the_window_names_are_those_that_are_read(tmp_path):
    table = {"t": np.arange(30.0), "SP": np.full(30, 50.0), "PV": 50 + np.arange(30) % 7.0, "OP": np.arange(30) % 5.0}
    written = {"Excel": workbook(tmp_path / "a.xlsx")}
    out = io.StringIO("t,SP,PV,OP\n")
    np.savetxt(out, np.column_stack(list(table.values())), delimiter=",", header="t,SP,PV,OP", comments="")
    written["CSV"] = tmp_path / "a.csv"
    written["CSV"].write_text(out.getvalue())
    written["Parquet"] = tmp_path / "a.parquet"
    pq.write_table(pa.table(table), written["Parquet"])
    written["Arrow"] = tmp_path / "a.arrow"
    with ipc.new_file(written["Arrow"], pa.table(table).schema) as file:
        file.write_table(pa.table(table))
    # OpenDocument has a test of its own (test_reading_exports.py).
    columns = {name: column.tolist() for name, column in table.items()}
    rows = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
    written["JSON"] = tmp_path / "a.json"
    written["JSON"].write_text(json.dumps(rows))
    cells = [list(columns), *([f"{value:g}" for value in row.values()] for row in rows)]
    written["HTML"] = tmp_path / "a.html"
    lines = "".join("<tr>" + "".join(f"<td>{cell}</td>" for cell in row) + "</tr>" for row in cells)
    written["HTML"].write_text(f"<table>{lines}</table>")
    assert {*written, "OpenDocument"} == set(FORMS)
    for form, path in written.items():
        assert path.suffix in FORMS[form]
        assert step_test.read_apart(path, Loop(name="F1"), {}, manual=True).reason is not None
