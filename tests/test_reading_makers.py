"""Exports as their makers document them (`bench.makers`), and what must never be read wrongly."""

import json
from collections import Counter
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from bench.makers import FORMS, guide
from bench.makers.score import of

from glapp.errors import InputError
from glapp.loop import Loop
from glapp.reading import open_recordings
from glapp.reading.csv import PACKED
from glapp.recording import joined


@pytest.mark.parametrize("name", FORMS)
def test_a_makers_export_is_read_right_or_after_one_answer(tmp_path, name):
    outcome = of(FORMS[name], tmp_path)
    assert outcome.end == ("asked" if FORMS[name].make().answer else "read"), outcome.said


def test_most_are_read_unaided():
    asked = Counter(bool(form.make().answer) for form in FORMS.values())
    assert len(FORMS) == 60 and asked[False] >= 55


def test_the_guide_lists_every_form():
    text = (Path(__file__).parents[1] / "bench" / "results" / "file_forms.md").read_text(encoding="utf-8")
    assert guide() in text, "run: python -m bench.makers --docs"


def read(tmp_path, name, text, **settings):
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    opened = open_recordings(path, defaults=settings)
    return {recording.name: joined(list(recording.batches())) for recording in opened}


ROWS = [(k, 50 + k % 3, 40 + k % 4) for k in range(20)]


def test_rows_of_several_loops_are_not_mixed(tmp_path):
    """Regression: a column that names the loop of each row was ignored, and all rows were one loop."""
    lines = [f"{name},{k},50,{pv + shift},{op}" for k, pv, op in ROWS for name, shift in (("F1", 0), ("F2", 100))]
    got = read(tmp_path, "x.csv", "\n".join(["name,time,sp,pv,op", *lines]))
    assert list(got) == ["F1", "F2"]
    np.testing.assert_array_equal(got["F1"].pv, [pv for _, pv, _ in ROWS])
    np.testing.assert_array_equal(got["F2"].pv, [pv + 100 for _, pv, _ in ROWS])


def test_units_behind_numbers_must_be_one_unit(tmp_path):
    """The error was that of the first row, whichever row has another unit."""
    lines = [f"{k},50 l/s,{pv}{' m3/h' if k == 17 else ' l/s'},{op}%" for k, pv, op in ROWS]
    with pytest.raises(InputError, match=r"row 19, column PV: '52 m3/h' is in m3/h, and others of its column are not"):
        read(tmp_path, "x.csv", "\n".join(["t,SP,PV,OP", *lines]))
    lines = [f"{k},50,{pv}{' m3/h' * (k == 17)},{op}%" for k, pv, op in ROWS]
    with pytest.raises(InputError, match=r"row 19, column PV: '52 m3/h' is in m3/h"):
        read(tmp_path, "x.csv", "\n".join(["t,SP,PV,OP", *lines]))


def test_a_number_of_the_row_is_no_time(tmp_path):
    lines = [f"{k + 1},50,{pv},{op}" for k, pv, op in ROWS]
    with pytest.raises(InputError, match="no time column among: Nr, SP, PV, OP"):
        read(tmp_path, "x.csv", "\n".join(["Nr,SP,PV,OP", *lines]))
    with pytest.raises(InputError, match="no time column"):
        read(tmp_path, "x.csv", "\n".join([",SP,PV,OP", *lines]))


def test_a_row_that_is_cut_in_line_protocol_has_its_line(tmp_path):
    lines = [f"pid,loop=F1 pv={pv},op={op},sp=50 {1763100000 + k}000000000" for k, pv, op in ROWS]
    lines[7] = lines[7][:20]
    with pytest.raises(InputError, match=r"x.txt, row 8: is not a point"):
        read(tmp_path, "x.txt", "\n".join(lines))


def test_line_protocol_with_spaces_and_quotes(tmp_path):
    lines = [f'my\\ pid,loop=F\\ 1 pv={pv},sp=50i,op={op},mode="AUTO" {1763100000 + k}000000000' for k, pv, op in ROWS]
    got = read(tmp_path, "x.txt", "\n".join(lines))
    assert list(got) == ["my pid.F 1"]
    np.testing.assert_array_equal(got["my pid.F 1"].sp, 50)


def test_a_table_within_a_web_page_spans_rows_and_columns(tmp_path):
    head = "<tr><td rowspan=2>Time</td><td colspan=3>F1</td></tr><tr><td>F1.SP</td><td>F1.PV</td><td>F1.OP</td></tr>"
    body = "".join(f"<tr><td>{k}</td><td>50</td><td>{pv}</td><td>{op}</td></tr>" for k, pv, op in ROWS)
    got = read(tmp_path, "x.html", f"<html><table><tr><td>Menu</td></tr></table><table>{head}{body}</table></html>")
    np.testing.assert_array_equal(got["F1"].pv, [pv for _, pv, _ in ROWS])
    np.testing.assert_array_equal(got["F1"].t, [k for k, _, _ in ROWS])


@pytest.mark.parametrize(
    ("name", "text", "line"),
    [
        ("x.json", '{"a": 1}', "holds no table that glapp can read"),
        ("x.json", "[{", "is not readable as JSON"),
        ("x.json", "[" * 100_000, "is JSON nested too deeply|is not"),
        ("x.json", '[{"t": 1, "PV": 2}', "is not readable as JSON"),
        ("x.html", "<html><body>none</body></html>", "is a web page without a table"),
        ("x.csv", "#group,false\n#datatype,string\n", "has a header but no rows"),
        (
            "x.csv",
            ",result,table,_time,_value,_field,_measurement\n,,0,2025-11-14T06:00:00Z,1,pv\n",
            "row 2: has 6 cells",
        ),
        ("x.html", "<table><tr><td colspan=999999>a</td></tr></table>", "has 999999 columns"),
    ],
)
def test_damaged_cells_are_reported(tmp_path, name, text, line):
    with pytest.raises(InputError, match=line):
        read(tmp_path, name, text)


def test_channels_of_twincat_keep_rates_of_their_own(tmp_path):
    """Regression: the times of the first channel were taken for those of all."""
    lines = ["Name\tF1.PV\tName\tF1.OP", "SampleTime[ms]\t100\tSampleTime[ms]\t200"]
    lines += [f"{100 * k}\t{pv}\t{200 * k if k < 10 else ''}\t{k if k < 10 else ''}" for k, pv, _ in ROWS]
    got = read(tmp_path, "x.csv", "\n".join(lines))["F1"]
    np.testing.assert_allclose(got.t, [0.1 * k for k, *_ in ROWS])
    np.testing.assert_array_equal(got.op, [k // 2 for k, *_ in ROWS])


def test_lines_of_json_have_their_line(tmp_path):
    lines = [json.dumps({"time": k, "sp": 50, "pv": pv, "op": op}) for k, pv, op in ROWS]
    lines[4] = lines[4][:-3]
    with pytest.raises(InputError, match="row 5: is not an object of JSON"):
        read(tmp_path, "x.jsonl", "\n".join(lines))


@pytest.mark.parametrize("packing", ["gzip", "bz2", "zstd"])
def test_what_is_read_whole_may_be_packed(tmp_path, packing):
    """Regression: a packed file was taken for a table of text, since only CSV was unpacked."""
    rows = [{"time": k, "sp": 50, "pv": pv, "op": op} for k, pv, op in ROWS]
    cells = "".join(f"<tr><td>{k}</td><td>50</td><td>{pv}</td><td>{op}</td></tr>" for k, pv, op in ROWS)
    head = "<tr><td>time</td><td>SP</td><td>PV</td><td>OP</td></tr>"
    points = [f"pid sp=50,pv={pv},op={op} {1763100000 + k}000000000" for k, pv, op in ROWS]
    ending = next(end for end, how in PACKED.items() if how == packing)
    for name, text in (
        ("F1.json", json.dumps(rows)),
        ("F1.jsonl", "\n".join(map(json.dumps, rows))),
        ("F1.html", f"<html><table>{head}{cells}</table></html>"),
        ("F1.txt", "\n".join(points)),
    ):
        path = tmp_path / (name + ending)
        with pa.CompressedOutputStream(str(path), packing) as file:
            file.write(text.encode())
        [recording] = open_recordings(path)
        plain = read(tmp_path, name, text)
        got = joined(list(recording.batches()))
        np.testing.assert_array_equal(got.pv, [pv for _, pv, _ in ROWS])
        assert recording.name in plain and got.t.tolist() == plain[recording.name].t.tolist()
    path.write_bytes(path.read_bytes()[:-9])
    with pytest.raises(InputError, match=r"F1\.txt\..*: (cannot be read|is )"):
        open_recordings(path)


def test_a_form_without_names_asks_for_columns(tmp_path):
    text = "\n".join(f"{k},50,{pv},{op}" for k, pv, op in ROWS)
    with pytest.raises(InputError, match=r"has no header.*--time 'column 1' --pv 'column 2'.*in loops.toml"):
        read(tmp_path, "x.csv", text)
    path = tmp_path / "x.csv"
    columns = {"time": "column 1", "sp": "column 2", "pv": "column 3", "op": "column 4"}
    [recording] = open_recordings(path, [Loop(name="F", columns=columns)])
    assert len(joined(list(recording.batches()))) == len(ROWS)


STATES = """Bad|Bad Input|Bad Output|Bad Total|Not Connect|Comm Fail|Scan Off|Scan Timeout|Intf Shut|Over Range
Under Range|Equip Fail|No Sample|No Data|No Result|Set to Bad|Out of Serv|Arc Off-line|Calc Failed|Calc Timeout
Calc Overflow|Access Denied|Wrong Type|Invalid Data|Invalid Float
Coercion Failed|Filter Out|Inp OutRange|DCS failed|Unit Down
I/O Timeout|Pt Created|Shutdown|Configure|No Lab Data|<No Data>|(null)|n.a.|No Good Data|--.--"""


@pytest.mark.parametrize("state", [state for line in STATES.splitlines() for state in line.split("|")])
def test_a_state_of_a_historian_is_a_missing_value(tmp_path, state):
    """Regression: a file with "Not Connect" or "Equip Fail" in one row was refused."""
    lines = [f"{k},50,{state if k == 7 else pv},{op}" for k, pv, op in ROWS]
    pv = read(tmp_path, "x.csv", "\n".join(["t,SP,PV,OP", *lines]))["x"].pv
    assert np.flatnonzero(np.isnan(pv)).tolist() == [7]
