"""Long tables: a row per tag and time."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from test_reading_csv import joined

from glapp.errors import InputError
from glapp.loop import Loop
from glapp.reading import open_recordings, recording_from
from glapp.recording import BAD, NOT_AUTO

ROWS = [
    ("F1.PV", 0, "10", "Good"),
    ("F1.SP", 1, "50", "Good"),
    ("F1.MODE", 1, "MAN", "Good"),
    ("F1.PV", 2, "11", "Good"),
    ("F1.OUT", 3, "30", "Good"),
    ("F1.MODE", 3, "AUTO", "Good"),
    ("T9.PV", 3, "oops", "Bad"),  # not of a complete loop: never looked at
    ("F1.PV", 4, "12", "Good"),
    ("F1.PV", 5, "0", "Bad"),
    ("F1.OUT", 5.5, "31", "Bad"),
    ("F1.SP", 6, "51", "Good"),
    ("F1.PV", 6, "13", "Good"),
]


def text(rows=ROWS):
    return "Timestamp;TagName;Value;Quality\n" + "".join(f"{t};{tag};{v};{q}\n" for tag, t, v, q in rows)


def test_samples_of_pv_make_the_rows_and_other_tags_are_held(tmp_path):
    path = tmp_path / "plant.csv"
    path.write_text(text())
    [recording] = open_recordings(path)
    assert recording.name == "F1"
    assert recording.columns == {
        "time": "Timestamp",
        "SP": "F1.SP",
        "PV": "F1.PV",
        "OP": "F1.OUT",
        "MODE": "F1.MODE",
    }
    for rows in (65536, 2):
        got = joined(recording.batches(rows))
        assert got["t"].tolist() == [0, 2, 4, 5, 6]
        np.testing.assert_array_equal(got["sp"], [np.nan, 50, 50, 50, 51])
        np.testing.assert_array_equal(got["pv"], [10, 11, 12, np.nan, 13])
        np.testing.assert_array_equal(got["op"], [np.nan, np.nan, 30, 30, np.nan])
        assert got["flags"].tolist() == [BAD + NOT_AUTO, NOT_AUTO, 0, BAD, 0]


def test_sorted_by_tag_gives_the_same(tmp_path):
    path, other = tmp_path / "a.csv", tmp_path / "b.csv"
    path.write_text(text())
    other.write_text(text(sorted(ROWS, key=lambda r: r[0])))
    a, b = (joined(open_recordings(p)[0].batches()) for p in (path, other))
    for name in a:
        np.testing.assert_array_equal(a[name], b[name])


def test_many_loops_at_once_equal_the_wide_table(tmp_path):
    rng = np.random.default_rng(3)
    n, tags = 5000, [f"L{i}.{s}" for i in range(3) for s in ("SP", "PV", "OP")]
    values = {tag: np.round(rng.normal(size=n), 4) for tag in tags}
    wide = pa.table({"t": np.arange(n) * 0.5, **values})
    long = pa.table(
        {
            "time": np.repeat(np.arange(n) * 0.5, len(tags)),
            "tag": tags * n,
            "value": np.column_stack(list(values.values())).ravel(),
        }
    )
    pq.write_table(long, tmp_path / "long.parquet")
    pq.write_table(wide, tmp_path / "wide.parquet")
    a, b = open_recordings(tmp_path / "long.parquet"), open_recordings(tmp_path / "wide.parquet")
    assert [r.name for r in a] == [r.name for r in b] == ["L0", "L1", "L2"]
    for one, other in zip(a, b, strict=True):
        x, y = joined(one.batches()), joined(other.batches())
        for name in x:
            np.testing.assert_array_equal(x[name], y[name])
        assert one.fraction_read() == 1.0


def test_named_tags_and_columns():
    data = {"when": [0, 1, 0, 1], "what": ["a", "a", "b", "b"], "how much": [1.0, 2, 3, 4]}
    columns = {"time": "when", "tag": "what", "value": "how much", "sp": "a", "pv": "b"}
    got = joined(recording_from(data, Loop(name="x", columns=columns)).batches())
    assert got["pv"].tolist() == [3, 4]


@pytest.mark.parametrize(
    ("rows", "line"),
    [
        (
            [("F1.SP", 0, "1", "Good"), ("F1.OP", 1, "1", "Good")],
            ": no tag for PV among those left: F1.SP, F1.OP; name them: --pv NAME --op 'F1.OP' --sp 'F1.SP'",
        ),
        ([("F1.PV", 0, "1", "Good")], ": has only one row"),
        ([*ROWS, ("F1.PV", 7, "abc", "Good")], ", row 14, column Value, tag F1.PV: 'abc' is not a number"),
        ([*ROWS, ("F1.PV", 7, "1", "Meh")], ", row 14, column Quality: 'Meh' is not a quality"),
        ([*ROWS, ("F1.PV", "x", "1", "Good")], ", row 14, column Timestamp: 'x' is not a time"),
        ([*ROWS, ("F1.MODE", 7, "TURBO", "Good")], ", row 14, column Value, tag F1.MODE: 'TURBO' is not a mode"),
        (
            [(t, i, "Bad", q) for t, i, _, q in ROWS if t[-2:] in ("PV", "SP")],
            ", tag F1.PV: has no value of good quality in any of",
        ),
    ],
)
def test_wrong_long_tables_are_one_line(tmp_path, rows, line):
    path = tmp_path / "plant.csv"
    path.write_text(text(rows))
    with pytest.raises(InputError) as caught:
        [list(recording.batches()) for recording in open_recordings(path)]
    assert str(caught.value).startswith(f"{path}{line}")
    assert "\n" not in str(caught.value)


def test_units_stand_in_a_column_of_their_own(tmp_path):
    """Regression: the column Units of PHD was ignored, and widths were told in "OP units"."""
    rows = [
        (tag, k, 50 + k % 3, unit) for k in range(20) for tag, unit in (("SP", "M3/H"), ("PV", "M3/H"), ("OP", "%"))
    ]
    lines = [f"F1.{tag},REFLUX,{unit},2025-11-14 06:00:{k:02d},{value},100" for tag, k, value, unit in rows]
    path = tmp_path / "phd.csv"
    head = "Tagname,Description,Units,Timestamp,Value,Confidence"
    path.write_text("\n".join([head, *lines]), encoding="utf-8")
    [recording] = open_recordings(path)
    assert recording.units == {"SP": "M3/H", "PV": "M3/H", "OP": "%"}
    assert (recording.loop.pv_unit, recording.loop.op_unit) == ("M3/H", "%")
    path.write_text("\n".join([head, *lines, lines[-2].replace("M3/H", "L/S")]), encoding="utf-8")
    [recording] = open_recordings(path)
    assert "PV" not in recording.units, "a tag with two units has none"


def test_names_of_ovation_have_their_unit_and_net_behind_them(tmp_path):
    """Regression: FIC101PV.UNIT1@NET1 was no signal, and two units' points of one name could be one loop."""
    lines = [
        f"{tag}.UNIT{unit}@NET1,2025-11-14 06:00:{k:02d},{value + unit}"
        for k in range(20)
        for unit in (1, 2)
        for tag, value in (
            ("FIC101SP", 50),
            ("FIC101PV", 50 + k % 3),
            ("FIC101OUT", 40 + k % 4),
            ("FIC101-MODE", 1 - unit),
        )
    ]
    path = tmp_path / "x.csv"
    path.write_text("\n".join(["Point Name,Time,Value", *lines]), encoding="utf-8")
    one, two = open_recordings(path)
    assert (one.name, two.name) == ("FIC101.UNIT1@NET1", "FIC101.UNIT2@NET1")
    assert one.columns["MODE"] == "FIC101-MODE.UNIT1@NET1"
    assert np.concatenate([batch.sp for batch in two.batches()]).tolist() == [52.0] * 20
