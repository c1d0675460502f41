"""Exports in every form that is known, each read to the values, times and units that were written."""

import io
import sys
import zipfile
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from bench import makers
from exports import FORMS, PV, guide, open_document, typed, workbook

from glapp import analyze, estimate, simulate
from glapp.errors import InputError
from glapp.loop import Loop
from glapp.reading import files, open_recordings, recording_from
from glapp.reading.files import ENDINGS
from glapp.recording import NOT_AUTO, joined
from glapp.result import REASONS

RESULTS = Path(__file__).parents[1] / "bench" / "results"


@pytest.mark.parametrize("name", FORMS)
def test_every_form_is_read_right(tmp_path, name):
    _, make = FORMS[name]
    want = make()
    path = tmp_path / f"{name}{want.ending}"
    path.write_bytes(want.content)
    loops = [Loop(name="FIC101", **want.settings)] if want.settings else None
    [recording] = open_recordings(path, loops)
    got = joined(list(recording.batches()))
    assert recording.name == (want.loop or name)
    assert (recording.t0 and recording.t0.replace(tzinfo=None)) == want.t0
    np.testing.assert_allclose(got.t, want.t, atol=1e-6)
    for signal in ("sp", "pv", "op"):
        values, expected = getattr(got, signal), getattr(want, signal)
        assert (values is None) == (expected is None)
        if expected is not None:
            np.testing.assert_allclose(values, expected, rtol=1e-12)
    flags = np.zeros(len(got), np.uint8) if got.flags is None else got.flags
    assert np.flatnonzero(flags & NOT_AUTO).tolist() == list(want.manual)
    assert recording.units == want.units
    assert [finding.code for finding in recording.found] == ([] if want.finding is None else [want.finding])


def test_a_workbook_of_libreoffice_is_read_right(tmp_path):
    path = tmp_path / "valve.ods"
    path.write_bytes(open_document("Trend", [["Time", "SP", "PV", "OP"], *typed()[1:]]))
    [recording] = open_recordings(path)
    got, want = joined(list(recording.batches())), FORMS["excel"][1]()
    assert recording.name == "valve" and recording.t0 == want.t0
    np.testing.assert_allclose(got.t, want.t, atol=1e-6)
    for signal in ("sp", "pv", "op"):
        np.testing.assert_array_equal(getattr(got, signal), getattr(want, signal))


@pytest.mark.parametrize(
    "head", [",F1,F1,F1,F2,F2,F2\nt,SP,PV,OP,SP,PV,OP", "Unit 3\nt,F1,,,F2,,\n,SP,PV,OP,SP,PV,OP\ns,bar,bar,%,m,m,%"]
)
def test_tags_above_signals_that_repeat_are_loops(tmp_path, head):
    """Two columns were called SP, and the file was refused."""
    path = tmp_path / "plant.csv"
    path.write_text("\n".join([head, *(f"{k},1,{k % 3},3,4,{k % 5},6" for k in range(30))]))
    found = {one.name: joined(list(one.batches())) for one in open_recordings(path)}
    assert {name: (rows.sp[0], rows.pv.max(), rows.op[0]) for name, rows in found.items()} == {
        "F1": (1, 2, 3),
        "F2": (4, 4, 6),
    }


def test_columns_of_one_name_in_a_sheet_and_with_times_of_their_own(tmp_path):
    """Of the latter the last was taken, and no word said of it."""
    rows = [["t", "SP", "PV", "PV", "OP"], *([k, 1, k % 3, 2, 4] for k in range(30))]
    path = as_workbook(tmp_path, ("Trend", [["", *row] for row in rows]))
    with pytest.raises(InputError, match=r"'PV \(column 4\)' and 'PV \(column 5\)' could both be PV"):
        open_recordings(path)
    path = tmp_path / "plant.csv"
    head = "Time,F1.PV,Time,F1.OP,Time,F1.PV"
    path.write_text("\n".join([head, *(f"{k},{k % 3},{k},{k % 4},{k},{k % 5}" for k in range(30))]))
    with pytest.raises(InputError, match=r"'F1.PV \(column 2\)' and 'F1.PV \(column 6\)' could both be PV"):
        open_recordings(path)


def test_a_name_that_stays_double_under_its_tags_is_refused(tmp_path):
    path = tmp_path / "plant.csv"
    path.write_text("\n".join([",F1,F1,F1,F1", "t,SP,PV,OP,PV", *(f"{k},1,{k % 3},3,4" for k in range(30))]))
    with pytest.raises(InputError, match=r"'F1 PV \(column 3\)' and 'F1 PV \(column 5\)' could both be PV"):
        open_recordings(path)


@pytest.mark.parametrize(
    ("above", "name", "pv"),
    [
        (",FIC101,,,", "FIC101", "FIC101 PV"),
        (",FIC101,FIC101,FIC101,", "FIC101", "FIC101 PV"),
        (",m3/h,m3/h,m3/h,", "plant", "PV"),
        (",Average,Average,Average,", "plant", "PV"),
        ("Trend 3,,,,", "plant", "PV"),
        (",,,,FIC101", "plant", "PV"),
    ],
)
def test_one_tag_above_the_signals_is_their_loop(tmp_path, above, name, pv):
    """It was lost, and the loop called after its file."""
    path = tmp_path / "plant.csv"
    path.write_text("\n".join([above, "t,SP,PV,OP,TI7", *(f"{k},1,{k % 3},3,4" for k in range(30))]))
    [found] = open_recordings(path)
    assert (found.name, found.columns["PV"], found.columns["time"]) == (name, pv, "t")
    [named] = open_recordings(path, [Loop(name="x", columns={"sp": "TI7"})])
    assert named.columns["SP"] == "TI7"


def test_every_form_that_is_named_to_people_is_read_here_and_every_ending_is_of_one():
    exports = [*(make() for _, make in FORMS.values()), *(form.make() for form in makers.FORMS.values())]
    endings = {Path(f"plant{one.ending}").suffix for one in exports}
    assert endings <= set(ENDINGS)
    assert [name for name, of in files.FORMS.items() if not endings & set(of)] == [
        "OpenDocument"
    ]  # its tests are below


def as_workbook(tmp_path, *sheets):
    path = tmp_path / "plant.xlsx"
    path.write_bytes(workbook(*sheets))
    return path


def test_a_workbook_without_its_package_says_what_to_install(tmp_path, monkeypatch):
    path = as_workbook(tmp_path, ("Trend", typed()))
    monkeypatch.setitem(sys.modules, "python_calamine", None)
    with pytest.raises(InputError, match=r"is not installed; pip install 'glapp\[excel\]', or save the sheet as CSV"):
        open_recordings(path)


def test_each_sheet_with_a_table_is_a_loop(tmp_path):
    plain = [["Time", "SP", "PV", "OP"], *typed()[1:]]
    others = ("Notes", [["a", "b"], ["c", "d"]]), ("Spans", [["name of it", "Wert"], ["high", 100.0]])
    path = as_workbook(tmp_path, ("North", plain), *others, ("South", plain))
    assert [recording.name for recording in open_recordings(path)] == ["North", "South"]
    [south] = open_recordings(path, [Loop(name="South")])
    np.testing.assert_array_equal(joined(list(south.batches())).pv, PV)


def test_a_fault_in_a_workbook_has_excels_row(tmp_path):
    rows = typed()
    rows[5][2] = "abc"
    path = as_workbook(tmp_path, ("Trend", [["Trend export"], [], *rows]))
    with pytest.raises(InputError, match=r"plant.xlsx, row 8, column FIC101.PV: 'abc' is not a number"):
        list(open_recordings(path)[0].batches())


@pytest.mark.parametrize(
    ("content", "line"),
    [
        (b"PK\x03\x04" + bytes(100), "is not a readable workbook"),
        (b"\xd0\xcf\x11\xe0" + bytes(100), "is an old or a locked Office file; save it as .xlsx or CSV, unlocked"),
        (workbook(("Trend", [])), "has no sheet with a table"),
        (workbook(("Trend", [["t", "SP", "PV"]])), "has a header but no rows"),
        (workbook(("Trend", [[1.0, 2.0, 3.0], [2.0, 3.0, 4.0]])), "has no header"),
    ],
    # The bytes hold the time at which they were made, which is another for each worker.
    ids=["no workbook", "old or locked", "empty", "no rows", "no header"],
)
def test_workbooks_that_cannot_be_used(tmp_path, content, line):
    path = tmp_path / "plant.xlsx"
    path.write_bytes(content)
    with pytest.raises(InputError) as caught:
        open_recordings(path)
    assert str(caught.value).startswith(str(path)) and line in str(caught.value)


@pytest.mark.slow
def test_damaged_workbooks_are_read_or_refused(tmp_path):
    """The zip is whole, and what is in it is not: a character changed, a piece cut out, the rest cut off."""
    rng = np.random.default_rng(5)
    with zipfile.ZipFile(io.BytesIO(workbook(("Trend", typed())))) as whole:
        parts = {name: whole.read(name) for name in whole.namelist()}
    path = tmp_path / "plant.xlsx"
    ends = Counter()
    for i in range(80):
        name = [*(["xl/worksheets/sheet1.xml"] * 4), *parts][i % (4 + len(parts))]
        text = bytearray(parts[name])
        at = int(rng.integers(len(text)))
        match i % 3:
            case 0:
                text[at] = int(rng.integers(256))
            case 1:
                del text[at : at + int(rng.integers(1, 30))]
            case 2:
                del text[at:]
        with zipfile.ZipFile(path, "w") as damaged:
            for other, content in parts.items():
                damaged.writestr(other, bytes(text) if other == name else content)
        try:
            for recording in open_recordings(path):
                joined(list(recording.batches()))
            ends["read"] += 1
        except InputError as error:
            assert str(error).startswith(str(path)) and "\n" not in str(error)
            ends["refused"] += 1
    assert ends["read"] > 5 and ends["refused"] > 5, ends


def test_a_fault_in_a_column_with_times_of_its_own_has_its_row(tmp_path):
    path = tmp_path / "plant.csv"
    lines = FORMS["times_for_each"][1]().content.decode().splitlines()
    cells = lines[7].split(",")
    cells[3] = "abc"
    lines[7] = ",".join(cells)
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(InputError, match=r"plant.csv, row 8, column FIC101.PV: 'abc' is not a number"):
        list(open_recordings(path)[0].batches())


def test_bad_cells_cost_their_own_half_periods_and_no_other():
    """2 % of the cells in ten stretches: the half-periods beside them are what they were."""
    made = simulate.closed_loop(
        "P3", (0.48, 0.3117, 0, 0), d=0.05, noise=0.002, t_end=400, load=[(100, 0.5)], filter_in_loop=True
    )
    settings = {"controller": {"k": 0.48, "ti": 0.3117, "setpoint_weight": 0}, "tf": 0.03, "process": {"kp": 1}}
    table = {"t": made.t, "SP": made.sp, "PV": [f"{x:.6f}" for x in made.pv], "OP": made.op}
    whole = estimate(recording_from(table, Loop(name="x", **settings))).half_periods
    words = ["Bad", "No Data", "I/O Timeout", "Ungültig"]
    hit = np.zeros(len(made.t), bool)
    for k in range(10):
        hit[700 * k + 300 : 700 * k + 316] = True
    assert 0.019 < hit.mean() < 0.021
    table["PV"] = [words[i % 4] if bad else text for i, (text, bad) in enumerate(zip(table["PV"], hit, strict=True))]
    found = estimate(recording_from(table, Loop(name="x", **settings))).half_periods
    times = made.t[hit]
    near = [((times >= a - 1) & (times <= b + 1)).any() for a, b in zip(whole.t_start, whole.t_end, strict=True)]
    untouched = {float(t) for t, n in zip(whole.t_end, near, strict=True) if not n}
    assert len(untouched) > 50
    assert untouched <= {float(t) for t in found.t_end}
    bad = [a for a, b, r in zip(found.t_start, found.t_end, found.reason, strict=True) if REASONS[r] == "bad_quality"]
    assert 0 < len(bad) <= 20  # a stretch ends one half-period, and the next begins in it


def test_without_sp_a_finding_says_that_the_gap_is_fitted():
    made = simulate.closed_loop("P3", (0.48, 0.3117), d=0.05, t_end=60, load=[(30, 0.5)])
    result = analyze(recording_from({"t": made.t, "PV": made.pv, "OP": made.op}), fit=False)
    [findings] = [finding for finding in result.quality if finding.code == "no_sp"]
    assert findings.severity == "info" and "the gap is fitted from OP and PV" in findings.text


@pytest.mark.slow
def test_the_guide_lists_every_form():
    assert guide() in (RESULTS / "file_forms.md").read_text(encoding="utf-8"), "run: python tests/exports.py"
    assert len(FORMS) >= 60
