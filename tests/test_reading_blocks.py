"""A text file is read in blocks: the same recording to the bit, or the same error, whatever their size."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from glapp.errors import InputError
from glapp.loop import Loop
from glapp.reading import csv as csv_module
from glapp.reading import open_recordings

HEAD = "t,SP,PV,OP,MODE\n"


def recorded(path, loops):
    """All that a file holds, as bytes that can be compared; or the text of its error."""
    try:
        found = []
        for recording in open_recordings(path, loops):
            batches = list(recording.batches())
            for name in ("t", "sp", "pv", "op", "position", "flags"):
                parts = [getattr(b, name) for b in batches]
                if name == "flags":
                    parts = [
                        np.zeros(len(b), np.uint8) if p is None else p for b, p in zip(batches, parts, strict=True)
                    ]
                found.append(None if parts[0] is None else np.concatenate(parts).tobytes())
            found.append((recording.t0, recording.zone, recording.units))
        return found
    except InputError as error:
        return str(error)


class Blocks:
    """Reads a file in one block, and in blocks of some lines."""

    def __init__(self, monkeypatch, path):
        self._monkeypatch, self._path = monkeypatch, path

    def compare(self, data: bytes, loops=None, block=100, sample=1 << 16, faults=1):
        """The answer for both; fails where they differ. Of many faults, which is named first may differ."""
        self._path.write_bytes(data)
        with self._monkeypatch.context() as patch:
            patch.setattr(csv_module, "_SAMPLE", sample)
            whole = recorded(self._path, loops)
            patch.setattr(csv_module, "_BLOCK", block)
            parts = recorded(self._path, loops)
        if faults == 1 or not isinstance(whole, str):
            assert parts == whole, data
        else:
            assert isinstance(parts, str), data
        return whole


@pytest.fixture
def blocks(monkeypatch, tmp_path):
    return Blocks(monkeypatch, tmp_path / "x.csv")


def text(rows: list[str], head: str = HEAD, end: str = "\n") -> bytes:
    return (head + end.join(rows) + end).encode()


_NUMBERS = """
1. .5 -.5 - . -. -0 0 +1 --1 1e5 1E5 1e+5 1e-5 1e 1e+ 1.e5 .e5 1_000 0x1 inf -inf Infinity nan NaN -nan 1.#QNAN
00012 -00 1.2.3 1,5 1d5 1f 1e5.5 ١ -9999 -9999.0 Bad bad BAD #N/A
1e400 -1e400 1e-400 4.9e-324 2.4e-324 2.2250738585072011e-308 1e99999999999 0e99999999999 8.41e21
1234567890123456789012345 0.1234567890123456789012345 9007199254740993 9007199254740993.0000000000000000000001
1.7976931348623157e308 1.7976931348623159e308
"""
_CLOCKS = """
00:00:00 23:59:59 24:00:00 23:59:60 23:60:00 00:00 0:00:00 00:00:00. 00:00:00,5 00:00:00Z 00:00:00z 00:00:00+01:00
00:00:00-0500 00:00:00+00 00:00:00.5Z 00:00:00.1234567890 00:00:00.5+01:00 12:00:00PM 12:34:56.1 12:34:56.12
12:34:56.123 12:34:56.1234 12:34:56.12345 12:34:56.123456 12:34:56.1234567 12:34:56.12345678 12:34:56.123456789
12:34:56.000000001 12:34:56.999999999
"""
_DAYS = """
2024-01-01 2024-02-29 2023-02-29 1900-02-29 2000-02-29 2100-02-29 2024-00-01 2024-13-01 2024-01-00 2024-01-32
2024-04-31 1677-09-21 1677-09-20 1699-12-31 1700-01-01 2200-12-31 2201-01-01 2250-12-31 2251-01-01 2262-04-11
2262-04-12 0001-01-01 9999-12-31 0000-00-00 1969-12-31 1970-01-01 24-01-01 2024-1-1 2024/01/01 01.01.2024
0000000000 ---------- ２０２４-01-01
"""
NUMBERS = [
    *_NUMBERS.split(),
    "",
    " ",
    " 1",
    "1 ",
    "\t1",
    '"1"',
    '""',
    '"',
    "1\0",
    "\0",
    "1\x0b",
    "\xa01",
    "1\r",
    "\ufeff1",
]
NUMBERS += ["6" * 400, "0." + "0" * 330 + "1"]
CLOCKS = [*_CLOCKS.split(), "00:00:00 Z"]
DAYS = [*_DAYS.split(), "\0" * 10, " 2024-01-01"]
STAMPS = [f"{day}{t}00:00:00" for day in DAYS for t in " T"]
STAMPS += [f"2024-01-01{t}{clock}" for clock in CLOCKS for t in (" ", "T", "t", "  ")]
STAMPS += ["", "5", "2024-01-01", "1704067200"]
WORDS = [
    "AUTO",
    "MAN",
    "auto",
    " AUTO",
    "AUTO ",
    "",
    " ",
    "1",
    "1.0",
    "TURBO",
    '"AUTO"',
    '"AU""TO"',
    'A"UTO',
    "Bad",
    "\0",
    "é",
    "AUTO\r",
]


# --- what was wrong


def test_a_line_that_ends_with_cr_alone_is_a_line(blocks):
    """A reader that counts the lines before the data by LF alone takes the first row for a part of the header."""
    for data in (b"t,SP,PV\r0,1,2\n1,1,2\n2,1,2\n", b"Export\rt,SP,PV\n0,1,2\n1,1,2\n2,1,2\n"):
        assert len(blocks.compare(data)[0]) == 3 * 8


def test_a_bad_word_that_looks_like_a_number_is_missing(blocks):
    """A word that a person calls bad counts, whatever number it looks like."""
    t, _, pv, *_ = blocks.compare(b"t,SP,PV\n0,1,2\n1,1,-9999\n", [Loop(name="x", bad_values=["-9999"])])
    assert np.frombuffer(t).tolist() == [0, 1]
    assert np.isnan(np.frombuffer(pv)).tolist() == [False, True]


def test_rows_of_nothing_but_separators_are_left_out_beside_plain_seconds(blocks):
    """A spreadsheet's empty rows are no faults, beside plain seconds too."""
    assert np.frombuffer(blocks.compare(b"t,SP,PV,MODE\n0,1,2,AUTO\n1,1,2,AUTO\n,,,\n,,,\n")[0]).tolist() == [0, 1]
    assert blocks.compare(b"t,SP,PV\n0,1,2\n1,1,2\n,1,2\n").endswith("row 4, column t: the time is empty")


@pytest.mark.slow
def test_a_hole_of_nul_bytes_is_no_date(blocks):
    """A reader that begins a block with a date of ten NULs in mind dates it 1970."""
    rows = [f"2024-01-01 00:00:{i:02d},1,2" for i in range(60)]
    data = text([*rows, "\0" * 10 + " 00:00:00,1,2", *rows], "t,SP,PV\n")
    for block in range(200, 230):  # in one of them the odd row is the first of its block
        assert "is not a time" in blocks.compare(data, block=block, sample=100)


@pytest.mark.verify
@pytest.mark.parametrize("first", [0, 1704067200, 1704067200000, 1704067200000000, 1704067200000000000])
def test_times_do_not_depend_on_rows_of_other_tags(blocks, first):
    """`1e`, which no loop reads, makes text of the times in its block; they mean what they mean in any other."""
    for number in [*NUMBERS, "+.5", "-.5e3", "0x1F", "nan(1)", "9223372036854775808", f"{first}.", f"+{first}"]:
        rows = [f"{first + i},F1.{'SP' if i % 2 else 'PV'},{i}" for i in range(12)]
        rows[3], rows[7] = "1e,other,1", f"{number},F1.SP,7"
        blocks.compare(text(rows, "Timestamp,Tag,Value\n"))


@pytest.mark.slow
def test_a_mark_that_begins_a_row_is_no_part_of_a_number(blocks):
    """A concatenated file has a byte order mark in its middle: an error, also where a block begins there."""
    rows = [f"{i},1,2" for i in range(10, 40)]
    data = text([*rows, "\ufeff40,1,2", *rows], "t,SP,PV\n")
    for block in range(100, 130):  # in one of them the odd row is the first of its block
        assert "row 32, column t" in blocks.compare(data, block=block)


# --- hand cases


@pytest.mark.slow
@pytest.mark.parametrize("column", ["t", "SP", "PV", "OP", "unread"])
def test_numbers_are_read_alike_in_any_block(blocks, column):
    row = {"t": "1", "SP": "50", "PV": "40", "OP": "30", "unread": "7"}
    head, good = ",".join(row) + "\n", ",".join(row.values())
    for number, end in zip(NUMBERS, itertools.cycle(["\n", "\r\n"]), strict=False):
        cells = ",".join((row | {column: number}).values())
        blocks.compare(text([good, good, cells, good], head, end), sample=60)
        blocks.compare(text([good, good, cells], head, end).rstrip(b"\r\n"))


@pytest.mark.verify
@pytest.mark.parametrize("first", ["2024-01-01 00:00:00", "2024-01-01T00:00:00Z", "2024-01-01", "1704067200"])
def test_times_are_read_alike_in_any_block(blocks, first):
    for stamp in STAMPS:
        rows = [f"{first},1,2", f"{first},1,2", f"{stamp},1,2", f"{first},1,2"]
        blocks.compare(text(rows, "t,SP,PV\n"), sample=8 + 2 * len(rows[0]) + 3)
        blocks.compare(text([rows[2], rows[0]], "t,SP,PV\n"), [Loop(name="x", time_zone="Europe/Stockholm")])


@pytest.mark.slow
@pytest.mark.parametrize("role", ["MODE", "Quality", "LO", "unread"])
def test_words_are_read_alike_in_any_block(blocks, role):
    loop = Loop(name="x", columns={"op_low_flag": "LO"} if role == "LO" else {})
    good = {"Quality": "Good", "LO": "0"}.get(role, "AUTO")
    for word in WORDS:
        data = text([f"1,1,2,{good}", f"2,1,2,{word}", f"3,1,2,{good}"], f"t,SP,PV,{role}\n")
        blocks.compare(data, [loop], sample=40)
        blocks.compare(data.replace(b"\n", b"\r\n"), [loop])


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "cp1252"])
def test_encodings_are_read_alike_in_any_block(blocks, encoding):
    for extra in ("å", "\ufeff", "\0", "€"):
        rows = [f"{i},1,2,AUTO,{'' if i < 5 else extra}".encode(encoding, "ignore") for i in range(9)]
        head = "t,SP,PV,MODE,NOTE".encode(encoding)
        blocks.compare("\n".encode(encoding).join([head, *rows]), sample=60)


@pytest.mark.verify
@given(st.data())
@settings(max_examples=100, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_long_tables_are_read_alike_in_any_block(blocks, data):
    stamp = data.draw(st.sampled_from(["{}", "2024-01-01 00:00:{:02d}", "2024-01-01T00:00:{:02d}Z"]))
    rows = []
    for i in range(data.draw(st.integers(3, 20))):
        tag = data.draw(st.sampled_from(["F1.SP", "F1.PV", "F1.PV", "F1.MODE", "other", ""]))
        odd = data.draw(st.sampled_from([False] * 9 + [True]))
        time = data.draw(st.sampled_from(["", *NUMBERS, *STAMPS])) if odd else stamp.format(i)
        value = data.draw(st.sampled_from([*NUMBERS, *WORDS])) if odd else "AUTO" if tag == "F1.MODE" else str(i)
        rows.append(f"{time},{tag},{value},{data.draw(st.sampled_from(['Good', 'Bad', '']))}" if tag else ",,,")
    blocks.compare(text(rows, "Timestamp,Tag,Value,Quality\n"), block=data.draw(st.sampled_from([100, 300])), faults=9)


def test_title_ends_otherwise_than_the_rows(blocks):
    rows = [f"{i},1,2.5,{i % 7},AUTO" for i in range(30)]
    whole = blocks.compare(b"Export\n" + text(rows, HEAD.replace("\n", "\r"), "\r"), block=60)
    assert len(whole) == 7


@pytest.mark.verify
@given(st.data())
@settings(max_examples=300, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_any_mixture_in_a_wide_table(blocks, data):
    end = st.sampled_from(["\n"] * 8 + ["\r\n", "\r", "\n\n", "\r\r\n", "\n\r"])
    ordinary = st.sampled_from(["1", "2.5", "-3", ""])
    number = ordinary | ordinary | ordinary | st.sampled_from(NUMBERS)
    word = st.sampled_from(["AUTO", "MAN"]) | st.sampled_from(["AUTO", "MAN"]) | st.sampled_from(WORDS)
    kind = data.draw(st.sampled_from(["stamp", "utc", "epoch", "seconds", "none"]))
    stamps = {
        "stamp": st.integers(0, 59).map("2024-01-01 00:00:{:02d}".format),
        "utc": st.integers(0, 59).map("2024-01-01T00:00:{:02d}Z".format),
        "epoch": st.integers(1704067200, 1704067300).map(str),
        "seconds": st.integers(0, 60).map(str),
        "none": number,
    }[kind]
    odd = st.sampled_from(STAMPS) if kind in ("stamp", "utc") else st.sampled_from([*NUMBERS, *STAMPS[:5]])
    names = ["x" if kind == "none" else "t", "SP", "PV", "OP", "MODE", "extra", "PV"]
    width = data.draw(st.integers(3, 7).filter(lambda n: n != 6) | st.integers(4, 5))
    rows = []
    for _ in range(data.draw(st.integers(2, 12))):
        what = data.draw(st.sampled_from(["row"] * 20 + ["odd time", "odd", "empty", "ragged", "blank", "spaces"]))
        row = [
            data.draw(stamps),
            *(data.draw(ordinary) for _ in range(3)),
            data.draw(st.sampled_from(["AUTO", "MAN"])),
            "",
            "9",
        ]
        if what == "odd time":
            row[0] = data.draw(odd)
        if what == "odd":
            row[1:5] = [data.draw(number), data.draw(number), data.draw(number), data.draw(word)]
        row = [""] * width if what == "empty" else row[:width]
        if what == "ragged":
            row = row[:-1] if data.draw(st.booleans()) else [*row, "1"]
        rows.append({"blank": "", "spaces": "  "}.get(what) if what in ("blank", "spaces") else ",".join(row))
    title = data.draw(st.sampled_from(["", "", "", "Export\n", "Export\r", "Export\r\n\r\n", '"Ex\nport"\n', "\ufeff"]))
    lines = title + ",".join(names[:width]) + data.draw(end)
    lines += "".join(row + data.draw(end) for row in rows)
    lines = lines.rstrip("\r\n") if data.draw(st.booleans()) else lines
    if data.draw(st.booleans()):
        lines = lines.replace(",", data.draw(st.sampled_from(";\t|")))
    bad = data.draw(
        st.lists(
            st.sampled_from(
                ["-9999", -9999.0, "2.5", "-3", "Oops", "1", " 1 ", "1.", "1e5", "AUTO", "2024-01-01 00:00:01"]
            ),
            max_size=2,
        )
    )
    loop = Loop(
        name="x",
        bad_values=bad,
        sample_time=1.0 if kind == "none" else None,
        auto_values=data.draw(st.sampled_from([None, ["AUTO"], [1]])),
        time_zone=data.draw(st.sampled_from([None, "Europe/Stockholm"])) if kind != "seconds" else None,
    )
    blocks.compare(
        lines.encode(),
        [loop],
        data.draw(st.sampled_from([60, 200])),
        data.draw(st.sampled_from([1 << 16, 90])),
        faults=9,
    )
