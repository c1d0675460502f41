"""The CSV reader: random tables in random dialects come back equal; every fault is one line with its place."""

import gzip
import io
import zipfile
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, example, given, settings
from hypothesis import strategies as st

from glapp.errors import InputError
from glapp.loop import Loop
from glapp.reading import csv as csv_module
from glapp.reading import open_recordings
from glapp.recording import AT_HIGH, AT_LOW, BAD, NOT_AUTO

REFINERY = Path(__file__).parents[1].parent / "shared/data/refinery"

slow_files = settings(suppress_health_check=[HealthCheck.function_scoped_fixture])


def read(path, loop=None, rows=65536):
    """All of a recording of one loop as one dict of arrays."""
    [recording] = open_recordings(path, None if loop is None else [loop])
    return recording, joined(recording.batches(rows))


def joined(batches):
    batches = list(batches)
    zeros = [np.zeros(len(b), np.uint8) if b.flags is None else b.flags for b in batches]
    out = {name: np.concatenate([getattr(b, name) for b in batches]) for name in ("t", "sp", "pv")}
    out["op"] = None if batches[0].op is None else np.concatenate([b.op for b in batches])
    return out | {"flags": np.concatenate(zeros)}


def write(tmp_path, text, name="plant.csv", encoding="utf-8"):
    path = tmp_path / name
    path.write_bytes(text.encode(encoding))
    return path


def lines(rows=5, header="t,SP,PV,OP,MODE", row="2024-01-01 00:00:{i:02d},50,4{i},30.5,AUTO"):
    return [header, *(row.format(i=i) for i in range(rows))]


# --- property: any dialect

STAMPS = {
    "iso": "%Y-%m-%d %H:%M:%S.%f",
    "isoT": "%Y-%m-%dT%H:%M:%S.%f",
    "zoned": "%Y-%m-%dT%H:%M:%S.%fZ",
    "slashes": "%Y/%m/%d %H:%M:%S.%f",
    "german": "%d.%m.%Y %H:%M:%S.%f",
    "us": "%m/%d/%Y %I:%M:%S.%f %p",
    "uk": "%d/%m/%Y %H:%M:%S.%f",
    "month": "%d-%b-%y %H:%M:%S.%f",
    "offset": "%Y-%m-%d %H:%M:%S.%f +00:00",
}
FORMAT = {"us": "month first", "uk": "day first"}


@st.composite
def tables(draw):
    n = draw(st.integers(2, 30))
    value = st.floats(-1e6, 1e6).map(lambda x: round(x, draw(st.integers(0, 6)))) | st.none()
    column = st.lists(value, min_size=n, max_size=n)
    pv = draw(column.filter(lambda c: any(v is not None for v in c)))
    start = draw(st.datetimes(datetime(1990, 1, 1), datetime(2040, 1, 1))).replace(microsecond=0)
    steps = draw(st.lists(st.integers(-500, 5000), min_size=n, max_size=n))
    times = [start + timedelta(milliseconds=ms) for ms in np.cumsum(steps).tolist()]
    return (
        times,
        draw(column),
        pv,
        draw(column),
        draw(st.lists(st.sampled_from(["AUTO", "MAN"]), min_size=n, max_size=n)),
    )


@st.composite
def dialects(draw):
    delimiter = draw(st.sampled_from(",;\t|"))
    stamp = draw(st.sampled_from([*sorted(STAMPS), "epoch"]))
    return {
        "delimiter": delimiter,
        "comma": draw(st.booleans()),
        "quoted": draw(st.booleans()) or delimiter == ",",
        "stamp": stamp,
        "encoding": draw(st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "cp1252"])),
        "newline": draw(st.sampled_from(["\n", "\r\n", "\r"])),
        "bad": draw(st.sampled_from(["Bad", "I/O Timeout", "NaN", "#N/A", " no data ", "NULL"])),
        "last_newline": draw(st.booleans()),
        "units": draw(st.booleans()),
        "gzip": draw(st.booleans()),
        "block": draw(st.sampled_from([64, 1 << 22])),
    }


def in_dialect(table, d):
    quote = '"{}"'.format if d["quoted"] else str

    def number(v):
        text = d["bad"] if v is None else repr(v)
        return quote(text.replace(".", ",") if d["comma"] else text)

    def stamp(t):
        if d["stamp"] == "epoch":
            return quote(f"{t.replace(tzinfo=UTC).timestamp():.3f}".replace(".", "," if d["comma"] else "."))
        return quote(
            t.strftime(STAMPS[d["stamp"]])[:-3] if STAMPS[d["stamp"]].endswith("%f") else t.strftime(STAMPS[d["stamp"]])
        )

    out = [["Time", "SP", "PV", "OP", "MODE"]]
    if d["units"]:
        out.append(["", "°C", "°C", "%", ""])
    for t, sp, pv, op, mode in zip(*table, strict=True):
        out.append([stamp(t), number(sp), number(pv), number(op), quote(mode)])
    text = d["newline"].join(d["delimiter"].join(row) for row in out)
    return (text + d["newline"] * d["last_newline"]).encode(d["encoding"])


@pytest.mark.verify
@slow_files
@given(tables(), dialects())
def test_a_table_in_any_dialect_reads_back_equal(tmp_path, monkeypatch, table, dialect):
    # Numbers are taken for seconds since 1970 from 26 March 1991 on; before, they count from the first row.
    assume(dialect["stamp"] != "epoch" or min(table[0]) >= datetime(1991, 4, 1))
    # A table whose newest row comes first is another test's.
    assume(table[0] == sorted(table[0]) or table[0] != sorted(table[0], reverse=True))
    monkeypatch.setattr(csv_module, "_BLOCK", dialect["block"])
    data = in_dialect(table, dialect)
    path = tmp_path / ("x.csv.gz" if dialect["gzip"] else "x.csv")
    path.write_bytes(gzip.compress(data) if dialect["gzip"] else data)
    recording, got = read(path, Loop(name="x", time_format=FORMAT.get(dialect["stamp"])))
    times, sp, pv, op, mode = table
    assert recording.t0.replace(tzinfo=None) == times[0]
    np.testing.assert_array_equal(got["t"], [(t - times[0]) / timedelta(seconds=1) for t in times])
    for name, want in (("sp", sp), ("pv", pv), ("op", op)):
        np.testing.assert_array_equal(got[name], np.array([np.nan if v is None else v for v in want]))
    bad = [BAD * (a is None or b is None) for a, b in zip(sp, pv, strict=True)]
    np.testing.assert_array_equal(got["flags"], np.array(bad) + [NOT_AUTO * (m == "MAN") for m in mode])
    _, again = read(path, Loop(name="x", time_format=FORMAT.get(dialect["stamp"])), rows=7)
    for name in got:
        np.testing.assert_array_equal(got[name], again[name])


@slow_files
@given(st.binary(max_size=300) | st.text(alphabet="0129.,;\t\n\r\"' -:TZtSPVOM\x00é", max_size=300).map(str.encode))
@example(b"t,SP,PV\n0,1,2\n1,1,2\n\n\n,,\n")
@example(b'"')
@example(b"t,SP,PV\r0,1\r")
@example(b"t;SP;PV;Quality\n\n\n\xf8;\n;")
@pytest.mark.slow
def test_any_bytes_give_batches_or_an_input_error(tmp_path, data):
    path = tmp_path / "x.csv"
    path.write_bytes(data)
    try:
        for recording in open_recordings(path):
            for batch in recording.batches():
                assert len(batch.t) == len(batch.sp) == len(batch.pv)
                assert np.isfinite(batch.t).all()
    except InputError as error:
        assert "\n" not in str(error)
        assert str(error).startswith(str(path))


@pytest.mark.slow
@slow_files
@given(st.data())
def test_one_damaged_cell_is_found_in_its_row_and_column(tmp_path, monkeypatch, data):
    monkeypatch.setattr(csv_module, "_BLOCK", 256)
    text = lines(rows=40, row="2024-01-01 00:00:{i:02d},50,4{i},30.5,AUTO")
    at, column = data.draw(st.integers(4, 40)), data.draw(st.sampled_from(["SP", "PV", "OP"]))
    blank = data.draw(st.integers(1, at))
    cells = text[at].split(",")
    cells[text[0].split(",").index(column)] = "abc"
    text[at] = ",".join(cells)
    text.insert(blank, "")  # an empty line counts as an editor counts it
    with pytest.raises(InputError) as caught:
        read(write(tmp_path, "\n".join(text)))
    assert (caught.value.row, caught.value.column, caught.value.value) == (at + 2, column, "abc")


# --- each dialect by name


@pytest.mark.parametrize(
    ("first", "second", "t0"),
    [
        ("2024-03-01 10:00:00", "2024-03-01 10:00:10", "2024-03-01T10:00:00"),
        ("2024-03-01T10:00", "2024-03-01T10:00:10", "2024-03-01T10:00:00"),
        ("2024/03/01 10:00:00.5", "2024/03/01 10:00:10.5", "2024-03-01T10:00:00.500000"),
        ("1.3.2024 9:59:55", "1.3.2024 10:00:05", "2024-03-01T09:59:55"),
        ("01.03.24 10:00:00,250", "01.03.24 10:00:10,250", "2024-03-01T10:00:00.250000"),
        ("13/03/2024 10:00:00", "13/03/2024 10:00:10", "2024-03-13T10:00:00"),
        ("3/13/2024 11:59:55 PM", "3/14/2024 12:00:05 AM", "2024-03-13T23:59:55"),
        ("01-Mar-24 10:00:00", "01-Mar-24 10:00:10", "2024-03-01T10:00:00"),
        ("Mar 1, 2024 10:00:00", "Mar 1, 2024 10:00:10", "2024-03-01T10:00:00"),
        ("20240301T100000", "20240301T100010", "2024-03-01T10:00:00"),
        ("2024-03-01 10:00:00+01:00", "2024-03-01 10:00:10+01:00", "2024-03-01T09:00:00+00:00"),
        ("2024-03-01 10:00:00 -0500", "2024-03-01 10:00:10 -0500", "2024-03-01T15:00:00+00:00"),
        ("2024-03-01T10:00:00Z", "2024-03-01T11:00:10+01:00", "2024-03-01T10:00:00+00:00"),
        ("2024-03-01 10:00:00 UTC", "2024-03-01 10:00:10 UTC", "2024-03-01T10:00:00+00:00"),
        ("1709287200", "1709287210", "2024-03-01T10:00:00+00:00"),
        ("1709287200.25", "1709287210.25", "2024-03-01T10:00:00.250000+00:00"),
        ("1709287200000", "1709287210000", "2024-03-01T10:00:00+00:00"),
        ("1709287200000000", "1709287210000000", "2024-03-01T10:00:00+00:00"),
        ("1709287200000000001", "1709287210000000001", "2024-03-01T10:00:00+00:00"),
    ],
)
def test_time_stamps_of_every_form_are_read(tmp_path, first, second, t0):
    path = write(tmp_path, f"t;SP;PV\n{first};1;2\n{second};1;2\n")
    recording, got = read(path)
    assert recording.t0.isoformat() == t0
    assert got["t"].tolist() == [0.0, 10.0]


def test_plain_seconds_are_kept_as_they_are(tmp_path):
    recording, got = read(write(tmp_path, "t,SP,PV\n3,1,2\n1.5,1,2\n1.5,1,2\n4,1,2\n"))
    assert recording.t0 is None
    assert got["t"].tolist() == [3, 1.5, 1.5, 4]


def test_day_and_month_are_distinguished_by_the_end_of_the_file_or_by_following_days(tmp_path):
    rows = [f"{1 + i // 1440:02d}/03/2024 {i // 60 % 24:02d}:{i % 60:02d}:00,1,2.000000" for i in range(1440 * 14)]
    recording, got = read(write(tmp_path, "\n".join(["t,SP,PV", *rows])))
    assert recording.t0 == datetime(2024, 3, 1)
    assert np.all(np.diff(got["t"]) == 60)
    recording, _ = read(write(tmp_path, "t,SP,PV\n05/03/2024 23:59:59,1,2\n06/03/2024 00:00:00,1,2\n"))
    assert recording.t0 == datetime(2024, 3, 5, 23, 59, 59)
    recording, _ = read(write(tmp_path, "t,SP,PV\n05/03/2024 23:59:59,1,2\n05/04/2024 00:00:00,1,2\n"))
    assert recording.t0 == datetime(2024, 5, 3, 23, 59, 59)


def test_local_times_in_autumn_are_exact_and_in_spring_must_exist(tmp_path):
    loop = Loop(name="x", time_zone="Europe/Stockholm")
    stamps = ["2024-10-27 01:59:00", "2024-10-27 02:30:00", "2024-10-27 02:59:00", "2024-10-27 02:00:00"]
    stamps += ["2024-10-27 02:59:00", "2024-10-27 03:00:00"]
    path = write(tmp_path, "t,SP,PV\n" + "".join(f"{s},1,2\n" for s in stamps))
    for rows in (65536, 1):
        recording, got = read(path, loop, rows)
        assert (got["t"] / 60).tolist() == [0, 31, 60, 61, 120, 121]
    assert recording.t0.isoformat() == "2024-10-27T01:59:00+02:00"
    path = write(tmp_path, "t,SP,PV\n2024-03-31 01:59:00,1,2\n2024-03-31 02:30:00,1,2\n")
    with pytest.raises(InputError, match="row 3, column t: 2024-03-31 02:30:00 does not exist in Europe/Stockholm"):
        read(path, loop)


def test_no_time_column_needs_sample_time(tmp_path):
    path = write(tmp_path, "SP,PV\n1,2\n1,3\n1,4\n")
    with pytest.raises(InputError, match=r"no time column among: SP, PV; name it: --time NAME.* --sample-time SECONDS"):
        read(path)
    recording, got = read(path, Loop(name="x", sample_time=0.5))
    assert (recording.t0, got["t"].tolist()) == (None, [0, 0.5, 1])


def test_an_unused_setting_is_reported(tmp_path):
    """Both were passed over in silence."""
    path = write(tmp_path, "Zeit,SP,PV\n" + "".join(f"{k},1,{k % 3}\n" for k in range(9)))
    recording, got = read(path, Loop(name="x", sample_time=0.5, auto_values=["AUTO", 1]))
    assert got["t"].tolist() == list(range(9))
    time, mode = recording.found
    assert (time.code, mode.code, time.severity) == ("setting_unused", "setting_unused", "warning")
    assert time.text.startswith("sample_time = 0.5 is not used, since column 'Zeit' has the times: leave it out")
    assert (
        mode.text.startswith("auto_values = ['AUTO', 1] is not used, since no column is the mode")
        and "--mode" in mode.text
    )
    columns = {"time": ""}
    recording, got = read(path, Loop(name="x", sample_time=0.5, columns=columns))
    assert got["t"].tolist() == [k / 2 for k in range(9)] and not recording.found


@pytest.mark.parametrize(
    ("sp", "pv", "differ"),
    [
        ("bar", "kPa", True),
        ("%", "°C", True),
        ("mm", "m", True),
        ("bar", "barg", False),
        ("bara", "barg", True),
        ("m³/h", "m3/h", False),
        ("degC", "°C", False),
        ("EU", "bar", False),
        ("widgets", "bar", False),
        ("", "bar", False),
    ],
)
@pytest.mark.parametrize("kind", ["wide", "long"])
def test_sp_and_pv_are_in_one_unit(tmp_path, sp, pv, differ, kind):
    """SP in bar beside PV in kPa was accepted."""
    names = [f"F1.SP [{sp}]" if sp else "F1.SP", f"F1.PV [{pv}]"]
    if kind == "wide":
        text = ",".join(["t", *names]) + "\n" + "".join(f"{k},1,{k % 3}\n" for k in range(9))
    else:
        text = "t,tag,value\n" + "".join(f"{k},{name},{k % 3}\n" for k in range(9) for name in names)
    path = write(tmp_path, text)
    if not differ:
        assert len(read(path)[1]["t"]) == 9
        return
    with pytest.raises(InputError) as caught:
        read(path)
    error = caught.value
    assert error.what == f"SP is in {sp} and PV in {pv}, must be in one unit"
    assert (error.column or error.tag) == names[0] and f'pv_unit = "{pv}"' in error.hint
    assert len(read(path, Loop(name="F1", pv_unit=pv))[1]["t"]) == 9


def test_title_lines_units_and_empty_rows_of_spreadsheets(tmp_path):
    text = (
        "Export from the plant\n\nTime;SP;PV;OP\n;degC;degC;%\n2024-01-01 00:00:00;1;2;3\n2024-01-01 00:00:01;1;2;3\n"
    )
    text += ";;;\n;;;\n"
    recording, got = read(write(tmp_path, text))
    assert len(got["t"]) == 2
    assert recording.units == {"SP": "degC", "PV": "degC", "OP": "%"}
    assert recording.loop.pv_unit == "degC"


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_a_header_broken_into_lines_within_quotes(tmp_path, end):
    body = end.join(f"2024-01-01 00:00:{i:02d},50,4{i},30.5" for i in range(5)) + end
    head = f'"Time{end}(local)",SP,"PV{end} [%]",OP{end}'
    recording, got = read(write(tmp_path, head + body))
    assert recording.columns["PV"] == "PV [%]" and recording.units["PV"] == "%"
    assert got["pv"].tolist() == [40, 41, 42, 43, 44] and got["op"].tolist() == [30.5] * 5
    with pytest.raises(InputError, match="row 7, column SP: 'x' is not a number"):
        read(write(tmp_path, head + body.replace(":03,50", ":03,x")))


def test_modes_limits_and_named_words(tmp_path):
    head = "t,SP,PV,OP,MODE,LO,HI\n"
    path = write(tmp_path, head + "0,1,2,3,AUTO,0,1\n1,1,2,3,Man,0,0\n2,1,2,3,CAS,1,0\n3,1,2,3,,0,0\n")
    loop = Loop(name="x", columns={"op_low_flag": "LO", "op_high_flag": "HI"})
    assert read(path, loop)[1]["flags"].tolist() == [AT_HIGH, NOT_AUTO, AT_LOW, NOT_AUTO]
    path = write(tmp_path, head + "0,1,2,3,7,0,0\n1,1,-9999,3,8,0,0\n2,1,oops,3,7,0,0\n")
    loop = Loop(name="x", auto_values=[7], bad_values=[-9999, "Oops"])
    got = read(path, loop)[1]
    assert got["flags"].tolist() == [0, NOT_AUTO + BAD, BAD]
    assert np.isnan(got["pv"][1:]).all()


@pytest.mark.parametrize(
    ("words", "flags"),
    [
        (["Good", "Bad", "Uncertain", "GoodLocalOverride"], [0, BAD, BAD, 0]),
        (["192", "0", "64", "216"], [0, BAD, BAD, 0]),
        (["0", "0", "2147483648", "1073741824"], [0, 0, BAD, BAD]),
        (["good", "", "Not Connected", "OK"], [0, BAD, BAD, 0]),
    ],
)
def test_words_and_numbers_of_quality_mark_bad_rows(tmp_path, words, flags):
    path = write(tmp_path, "t,SP,PV,Quality\n" + "".join(f"{i},1,2,{w}\n" for i, w in enumerate(words)))
    _, got = read(path)
    assert got["flags"].tolist() == flags
    assert np.isnan(got["pv"]).tolist() == [f == BAD for f in flags]


def test_a_quality_beside_each_signal(tmp_path):
    rows = "".join(f"{i},1,Good,2,{'Bad' if i == 1 else 'Good'},3,Bad\n" for i in range(3))
    path = write(tmp_path, "t,F1.SP,Quality,F1.PV,Quality,F1.OP,Quality\n" + rows)
    [recording], got = open_recordings(path), read(path)[1]
    assert recording.columns["quality"] == "F1.PV Quality"
    assert got["flags"].tolist() == [0, BAD, 0]
    # One before all signals and one behind: it is open whose they are.
    path = write(tmp_path, "Quality,t,F1.SP,F1.PV,Quality\nGood,0,1,2,Good\nGood,1,1,2,Good\n")
    with pytest.raises(InputError, match=r"'Quality \(column 1\)' and 'Quality \(column 5\)' could both be quality"):
        open_recordings(path)


def test_columns_of_one_name_are_chosen_by_number(tmp_path):
    """Nothing but a change of the file helped."""
    path = write(tmp_path, "t,F1.SP,F1.PV,F1.PV,F1.OP\n0,1,2,3,4\n1,1,2,3,4\n")
    with pytest.raises(
        InputError, match=r"plant.csv: the columns 'F1.PV \(column 3\)' and 'F1.PV \(column 4\)' could both"
    ):
        open_recordings(path, [Loop(name="F1", columns={"pv": "F1.PV"})])
    [recording] = open_recordings(path, [Loop(name="F1", columns={"pv": "F1.PV (column 4)"})])
    assert next(recording.batches()).pv.tolist() == [3, 3]
    assert recording.columns["OP"] == "F1.OP"


def test_a_column_that_is_named_for_one_signal_is_guessed_for_no_other(tmp_path):
    """OP and the position were one column, and the position overrules the fit."""
    path = write(tmp_path, "Zeit,Sollwert,Istwert,Ventilstellung\n0,1,2,3\n1,1,2,3\n")
    [recording] = open_recordings(path, [Loop(name="x", columns={"op": "Ventilstellung"})])
    assert recording.columns == {"time": "Zeit", "SP": "Sollwert", "PV": "Istwert", "OP": "Ventilstellung"}
    known = Loop(name="x", controller={"k": 1, "ti": 9})
    assert open_recordings(path, [known])[0].columns["position"] == "Ventilstellung"


def test_a_column_of_confidence_is_no_second_loop(tmp_path):
    """FIC1.PV Conf was PV of a loop called "FIC1 Conf"."""
    head = "t,FIC1.SP,FIC1.SP Conf,FIC1.PV,FIC1.PV Conf,FIC1.OP,FIC1.OP Conf"
    path = write(tmp_path, head + "\n0,1,100,2,100,3,100\n1,1,100,2,0,3,100\n")
    [recording] = open_recordings(path)
    assert recording.name == "FIC1" and read(path)[1]["flags"].tolist() == [0, BAD]


def test_wide_file_with_several_loops(tmp_path):
    head = "Timestamp,FIC1.SP,FIC1.PV,FIC1.OUT,LIC2/PID1/SP.CV,LIC2/PID1/PV.CV,TI9.PV"
    path = write(tmp_path, head + "\n0,1,2,3,4,5,6\n1,1,2,3,4,5,6\n")
    recordings = open_recordings(path)
    assert [r.name for r in recordings] == ["FIC1", "LIC2/PID1"]
    assert recordings[1].columns == {"time": "Timestamp", "SP": "LIC2/PID1/SP.CV", "PV": "LIC2/PID1/PV.CV"}
    assert next(recordings[1].batches()).pv.tolist() == [5, 5]
    [named] = open_recordings(path, [Loop(name="x", columns={"sp": "FIC1.SP", "pv": "TI9.PV"})])
    assert named.columns == {"SP": "FIC1.SP", "PV": "TI9.PV"} | {"time": "Timestamp"}


# --- wrong input

GOOD = "\n".join(lines()) + "\n"
WRONG = {
    "empty": ("", ": is empty; export the recording again"),
    "blank": ("\n\n  \n", ": is empty"),
    "header only": ("t,SP,PV\n", ": has a header but no rows; take a time in which the historian has values"),
    "one row": ("t,SP,PV\n0,1,2\n", ": has only one row"),
    "one column": ("PV\n1\n2\n", ": has only one column and begins with 'PV'; separate the columns by comma"),
    "a message": ("\n Access  denied.\n", "begins with 'Access denied.'; separate the columns by comma"),
    "text in numbers": ("t,SP,PV\n0,1,2\n1,1,abc\n", ", row 3, column PV: 'abc' is not a number; write bad values as"),
    "all NaN": ("t,SP,PV\n0,1,NaN\n1,1,Bad\n", ", column PV: has no value in any of 2 rows"),
    "no pv": (
        "t,SP,OP\n0,1,2\n1,1,2\n",
        ": no column for PV: all are taken (time is t, SP is SP, OP is OP); export PV as well; where one of these",
    ),
    "unknown pv": (
        "t,SP,Flow,Valve\n0,1,2,3\n1,1,2,3\n",
        ": no column for PV among those left: Flow, Valve (time is t, SP is SP); name it: --pv NAME",
    ),
    "one signal": (
        "Time,FIC101\n0,1\n1,2\n",
        ": has only one signal, FIC101 (time is Time); it takes OP and PV of a loop to tell of its valve",
    ),
    "one signal, known": ("Time,FIC101.PV\n0,1\n1,2\n", ": has only one signal, FIC101.PV (time is Time"),
    "no header": ("0,1,2\n1,1,2\n", ", row 1: has no header: the first row holds data"),
    "ragged": (
        "t,SP,PV\n0,1,2\n1,1\n2,1,2\n",
        ", row 3: has 2 cells where the header has 3; correct or delete the row",
    ),
    "cut off": (
        "t,SP,PV\n0,1,2\n1,1,2\n2,1",
        ", row 4: has 2 cells where the header has 3; the file ends in the middle",
    ),
    "all short": ("t,SP,PV,OP\n0,1,2\n1,1,2\n", ", row 2: has 3 cells where the header has 4"),
    "too many": (
        "t,SP,PV\n0,1,2\n1,1,2,3\n2,1,2\n",
        ", row 3: has 4 cells where the header has 3; correct or delete the row; where numbers",
    ),
    "two PV": (
        "t,SP,PV,PV\n0,1,2,3\n1,1,2,3\n",
        ": the columns 'PV (column 3)' and 'PV (column 4)' could both be PV; name the right one: --pv 'PV (column 3)'",
    ),
    "a position alone": (
        "Zeit,Sollwert,Istwert,Ventilstellung\n0,1,2,3\n1,1,2,3\n",
        ": the column 'Ventilstellung' is taken for the position that the valve reports, and none is left for OP; "
        "where it is what the controller sends to the valve, name it: --op 'Ventilstellung', or in loops.toml",
    ),
    "two OP": ("t,SP,PV,OP,MV\n0,1,2,3,4\n1,1,2,3,4\n", ": the columns 'OP' and 'MV' could both be OP; name the right"),
    "ambiguous day": (
        "t,SP,PV\n01/02/2024 00:00,1,2\n01/02/2024 00:01,1,2\n",
        ", row 2, column t: '01/02/2024 00:00' can be read day first or month first; say which: --time-format",
    ),
    "mixed zones": (
        "t,SP,PV\n2024-01-01 00:00:00,1,2\n2024-01-01 00:00:01Z,1,2\n",
        ", row 3, column t: '2024-01-01 00:00:01Z' has a zone, unlike the first row: mixed zones",
    ),
    "letters for a zone": (
        "t,SP,PV\n2024-01-01 00:00 CET,1,2\n2024-01-01 00:01 CET,1,2\n",
        "; a zone's letters are not",
    ),
    "no such day": (
        "t,SP,PV\n2024-02-28 00:00,1,2\n2024-02-30 00:00,1,2\n",
        ", row 3, column t: '2024-02-30 00:00' read",
    ),
    "time missing": ("t,SP,PV\n2024-02-28 00:00,1,2\n,1,2\n", ", row 3, column t: the time is empty"),
    "time only": ("t,SP,PV\n00:00:01,1,2\n00:00:02,1,2\n", "; the date is missing"),
    "time only, of half a day": ("t,SP,PV\n06:00:01 AM,1,2\n06:00:02 AM,1,2\n", "; the date is missing"),
    "text for time": ("t,SP,PV\n0,1,2\nx,1,2\n", ", row 3, column t: 'x' is not a time"),
    "day numbers": (
        "t,SP,PV\n60000.1,1,2\n60000.1001,1,2\n",
        "60000.1 looks like a day number, but of which calendar?",
    ),
    "unknown mode": (
        "t,SP,PV,MODE\n0,1,2,AUTO\n1,1,2,TURBO\n",
        ", row 3, column MODE: 'TURBO' is not a mode that glapp knows; say which words mean automatic",
    ),
    "unknown quality": ("t,SP,PV,Quality\n0,1,2,Good\n1,1,2,Meh\n", ", row 3, column Quality: 'Meh' is not a quality"),
    "mixed decimals": (
        "t;SP;PV\n0;1,5;2\n1;1.5;2\n",
        ", row 2, column SP: '1,5' has a decimal comma, and others, such as '1.5', a decimal point; write",
    ),
    "thousands or a point": (
        "t;SP;PV\n" + "0;1;2,5\n" * 20_000 + "1;1.234;2,5\n" + "2;1;2,5\n" * 20_000,
        ", row 20002, column SP: '1.234' may be with a decimal point, or thousands: other numbers have a decimal comma",
    ),
    "cut within its last cell": (
        't,SP,PV,OP\n"0","1","2","43"\n"1","1","2","44"\n"2","1","2","4',
        ", row 4: ends within a quoted cell; the file is cut, is it still being written?",
    ),
    "two kinds of thousands": (
        "t;SP;PV\n0;1;2\n1;1.234,5;1,234.5\n",
        ", row 3, column SP: '1.234,5' has a decimal comma, and others, such as '1,234.5', a decimal point",
    ),
    "one decimal point among commas": (
        "t;SP;PV\n" + "0;1,5;2,5\n" * 9 + "1;1,5;2.5 bar\n",
        ", row 11, column PV: '2.5' has a decimal point, and others, such as '1,5', a decimal comma; write all",
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_input_is_one_line(tmp_path, case):
    text, line = WRONG[case]
    path = write(tmp_path, text)
    with pytest.raises(InputError) as caught:
        read(path)
    assert str(caught.value).startswith(str(path))
    assert line in str(caught.value)
    assert "\n" not in str(caught.value)


def test_wrong_paths_and_files(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        open_recordings(tmp_path / "none.csv")
    with pytest.raises(InputError, match="is a directory"):
        open_recordings(tmp_path)
    (tmp_path / "b.csv").write_bytes(bytes(range(256)) * 8)
    with pytest.raises(
        InputError, match="is not text, Parquet or Arrow; export the recording as CSV, Excel, Parquet or Arrow"
    ):
        open_recordings(tmp_path / "b.csv")
    (tmp_path / "x.csv.gz").write_bytes(b"\x1f\x8bt,SP,PV\n0,1,2\n")
    with pytest.raises(InputError, match="cannot be read"):
        open_recordings(tmp_path / "x.csv.gz")


def archive(*names):
    """A zip archive of files with these names."""
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as file:
        for name in names:
            file.writestr(name, GOOD)
    return packed.getvalue()


LOGIN = "<!DOCTYPE html><html><head><title>Log\n in &amp; go</title></head>{}<input type='password'></html>"
NO_TABLES = {
    "a PDF": (b"%PDF-1.4\n1 0 obj\n", "x.csv: is a PDF; it shows the recording without its numbers: export them"),
    "a PDF with a table in it": (b"%PDF-1.4\n" + GOOD.encode(), "x.csv: is a PDF;"),
    "a picture": (b"\x89PNG\r\n\x1a\n" + bytes(100), "x.csv: is a picture (PNG); it shows"),
    "a text document": (rb"{\rtf1\ansi t,SP,PV\par}", "x.csv: is a text document (RTF); save its table as CSV"),
    "a data base": (b"SQLite format 3\0" + bytes(100), "x.csv: is a data base (SQLite); export the recording"),
    "a 7z archive": (b"7z\xbc\xaf\x27\x1c" + bytes(20), "x.csv: is a 7z archive; unpack it, and take the file in it"),
    "a zip archive": (archive("a.csv", "b/", "b/c.csv"), "x.csv: is a zip archive of 2 files (a.csv, b/c.csv); unpack"),
    "a zip archive of one file": (archive("a.csv"), "x.csv: is a zip archive of 1 file (a.csv); unpack"),
    "an empty zip archive": (archive(), "x.csv: is a zip archive without a file; export the recording again"),
    "a Word document": (archive("[Content_Types].xml", "word/document.xml"), "x.csv: is a Word document; save its"),
    "packed without its ending": (gzip.compress(GOOD.encode()), "does not end in .gz; rename it to x.csv.gz"),
    "a login": (LOGIN.format("").encode(), "x.csv: is a web page, 'Log in & go', that asks for a login; log in to"),
    "a login in a table": (LOGIN.format("<table><tr><td>User<td>?</table>").encode(), "that asks for a login; log in"),
    "a page": (b"<html><h1>404</h1></html>", "x.csv: is a web page without a table of numbers; open it in a browser"),
    "a message in JSON": (
        b'{"Errors": null, "Message": "Authorization has been denied."}',
        "x.csv: is a message and no recording: 'Authorization has been denied.'; see to what it says",
    ),
    "errors in JSON": (b'{"errors": [{"message": "no tag"}]}', "x.csv: is a message and no recording: 'no tag'; see"),
}


@pytest.mark.parametrize("case", NO_TABLES)
def test_a_file_that_is_no_table_is_called_what_it_is(tmp_path, case):
    """A PDF was "only one column", and a zip archive "not a readable workbook"."""
    data, line = NO_TABLES[case]
    (tmp_path / "x.csv").write_bytes(data)
    with pytest.raises(InputError) as caught:
        open_recordings(tmp_path / "x.csv")
    assert line in str(caught.value)


def test_a_file_that_its_browser_has_unpacked_is_to_be_renamed(tmp_path):
    (tmp_path / "x.csv.gz").write_text(GOOD)
    with pytest.raises(InputError, match=r"is not packed, though its name ends in \.gz; rename it to x\.csv$"):
        open_recordings(tmp_path / "x.csv.gz")


def test_a_page_with_a_table_and_a_login_beside_it_is_read(tmp_path):
    cells = "".join(f"<tr><td>{k}<td>1<td>{k % 3}<td>2" for k in range(9))
    page = LOGIN.format(f"<table><tr><th>t<th>SP<th>PV<th>OP{cells}</table>")
    assert read(write(tmp_path, page))[1]["pv"].tolist() == [k % 3 for k in range(9)]


@pytest.mark.parametrize(
    ("name", "auto", "manual"),
    [("A/M", "A", "M"), ("Auto", "TRUE", "FALSE"), ("Betriebsart", "Automatikbetrieb", "Handbetrieb")],
)
def test_a_mode_by_other_names(tmp_path, name, auto, manual):
    """A column A/M or Auto was passed over, so that rows in manual counted; 'Handbetrieb' was an error."""
    path = write(tmp_path, "\n".join([f"t,SP,PV,{name}", *(f"{k},1,2,{manual if k < 3 else auto}" for k in range(9))]))
    recording, got = read(path)
    assert recording.columns["MODE"] == name and got["flags"].tolist() == [NOT_AUTO] * 3 + [0] * 6


def test_a_wrong_column_is_reported_with_the_nearest_one(tmp_path):
    path = write(tmp_path, GOOD)
    with pytest.raises(InputError, match=r"columns\.pv: no column 'PVX' for PV, did you mean 'PV'\? There are: t, SP"):
        read(path, Loop(name="x", columns={"pv": "PVX"}))
    with pytest.raises(InputError, match="row 2, column MODE: 'AUTO' is not a number"):
        read(path, Loop(name="x", columns={"pv": "MODE", "mode": ""}))


def test_times_that_repeat_or_run_backwards_are_passed_on(tmp_path):
    _, got = read(write(tmp_path, "t,SP,PV\n5,1,2\n4,1,2\n4,1,2\n6,1,2\n"))
    assert got["t"].tolist() == [5, 4, 4, 6]


def test_a_recording_can_be_left_early_and_read_again(tmp_path, monkeypatch):
    monkeypatch.setattr(csv_module, "_BLOCK", 64)
    [recording] = open_recordings(write(tmp_path, "\n".join(lines(rows=60))))
    assert recording.fraction_read() is None
    batches = recording.batches(rows=3)
    next(batches)
    batches.close()
    assert sum(len(b) for b in recording.batches()) == 60
    assert recording.fraction_read() == 1.0


def test_text_road_and_native_road_agree(tmp_path):
    """The text reader reads the block of such a cell and no other; values stay the same."""
    rng = np.random.default_rng(1)
    rows = [
        f"2024-01-01 00:00:{i:02d}.{i:03d},{x!r},{y!r},1e{i % 9},1"
        for i, (x, y) in enumerate(rng.normal(size=(60, 2)).tolist())
    ]
    plain = read(write(tmp_path, "\n".join(["t,SP,PV,OP,MODE", *rows])))[1]
    rows[59] = rows[59].replace(",1e", ", BAD INPUT ,")[: rows[59].rindex(",1e")] + ",  Bad InPut ,1"
    mixed = read(write(tmp_path, "\n".join(["t,SP,PV,OP,MODE", *rows])))[1]
    for name in ("t", "sp", "pv", "flags"):
        np.testing.assert_array_equal(plain[name], mixed[name])
    np.testing.assert_array_equal(plain["op"][:59], mixed["op"][:59])
    assert np.isnan(mixed["op"][59])


@pytest.mark.skipif(not REFINERY.is_dir(), reason="the refinery recordings are not beside this checkout")
@pytest.mark.slow
def test_refinery_files_are_readable():
    files = sorted(REFINERY.glob("*.csv"))
    assert len(files) == 12
    for file in files:
        recording, got = read(file)
        assert recording.name == file.stem
        assert list(recording.columns) == ["time", "SP", "PV", "OP", "MODE"]
        assert (len(got["t"]), got["t"][-1], got["flags"].any()) == (751, 7500.0, False)


def test_a_packed_file_that_is_cut_off_and_a_word_among_times_say_what_to_do(tmp_path: Path) -> None:
    """The fault alone was told."""
    rows = [f"{k},50,{k % 7},{40 + k % 5}" for k in range(300)]
    path = tmp_path / "plant.csv.gz"
    path.write_bytes(gzip.compress("\n".join(["t,SP,PV,OP", *rows]).encode())[:300])
    with pytest.raises(InputError, match="may have been cut off: copy or export it again"):
        open_recordings(path)
    rows[100] = rows[100].replace("100,", "noon,", 1)
    path = tmp_path / "plant.csv"
    path.write_text("\n".join(["t,SP,PV,OP", *rows]))
    with pytest.raises(InputError, match=r"row 102, column t: 'noon' is not a time .*; correct or delete the row"):
        list(open_recordings(path)[0].batches())


@pytest.mark.parametrize("names", ["SP_Out,PV_Out,CV_Out", "SP_OUT,PV_OUT,OP_OUT", "FIC1.SPOut,FIC1.PVOut,FIC1.Out"])
def test_a_signal_at_the_output_of_a_block_is_that_signal(tmp_path, names):
    """SP_Out was OP of a loop called SP, so that no crossings were counted."""
    path = write(tmp_path, "\n".join([f"t,{names}", *(f"{k},1,2,3" for k in range(9))]))
    assert [read(path)[0].columns[role] for role in ("SP", "PV", "OP")] == names.split(",")


@pytest.mark.parametrize(
    ("cells", "more", "role"),
    [
        (["44,5", "45"], "", "position"),
        (["Auto", "Hand"], "", "MODE"),
        (["0", "1"], "", "MODE"),  # no valve has just these
        (["Auto", "Hand"], "Ventilläge", "MODE"),
        (["44,5", "45"], "Reglerläge", "position"),
        (["44,5", "45"], "Ventilläge", None),  # it is not known what else it may be
    ],
)
@pytest.mark.parametrize("long", [False, True])
def test_lage_is_a_mode_where_it_holds_words(tmp_path, cells, more, role, long):
    """Läge was passed over: an engineer means the valve's position by numbers, and the controller's mode by words."""
    names = ["Börvärde", "Ärvärde", "Utsignal", "Läge", *filter(None, [more])]
    rows = [["50", f"{k % 3}", "4,5", cells[k % 2], "auto" if more == "Reglerläge" else "7"] for k in range(9)]
    if long:
        tags = [f"{k};F1 {name};{cell}" for k, row in enumerate(rows) for name, cell in zip(names, row, strict=False)]
        text = "\n".join(["Tid;tag;value", *tags])
    else:
        text = "\n".join(
            [";".join(["Tid", *names]), *(";".join([f"{k}", *r[: len(names)]]) for k, r in enumerate(rows))]
        )
    recording, _ = read(write(tmp_path, text))
    assert {role for role, name in recording.columns.items() if name in ("Läge", "F1 Läge")} == {role} - {None}
