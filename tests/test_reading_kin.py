"""Signals of one loop whose names have several prefixes are read together, or are named as left out."""

import pytest

from glapp.errors import InputError
from glapp.loop import Loop
from glapp.reading import open_recordings
from glapp.reading.columns import SignalColumns
from glapp.reading.kin import shared
from glapp.service.tags import loops_of


def text(names: list[str]) -> str:
    rows = [f"{k}," + ",".join(str(50 + (k * (i + 3)) % 7) for i in range(len(names))) for k in range(30)]
    return "\n".join([",".join(["t", *names]), *rows])


def columns(tmp_path, *names, **settings):
    path = tmp_path / "x.csv"
    path.write_text(text(list(names)), encoding="utf-8")
    opened = open_recordings(path, **settings)
    return {one.name: {k: v for k, v in one.columns.items() if k != "time"} for one in opened}, opened


WHOLE = {
    "Experion": ("FIC101", "FIC101/PIDA.SP FIC101/DACA.PV FIC101/PIDA.OP FIC101/PIDA.MODE"),
    "DeltaV, the module's mode": (
        "FIC101/PID1",
        "FIC101/PID1/SP.CV FIC101/PID1/PV.CV FIC101/PID1/OUT.CV FIC101/MODE.CV",
    ),
    "DeltaV, an input block": ("FIC101", "FIC101/PID1/SP.CV FIC101/AI1/PV.CV FIC101/PID1/OUT.CV FIC101/PID1/MODE.CV"),
    "Foxboro": ("A:FIC101", "A:FIC101:PIDA.SPT A:FIC101:AIN.MEAS A:FIC101:PIDA.OUT A:FIC101:PIDA.MODE"),
    "instruments": ("FIC101", "FIC101.SP FT101.PV FV101.OP FIC101.MODE"),
    "instruments with dashes": ("10-FIC-101", "10-FIC-101_SP 10-FT-101_PV 10-FCV-101_OUT 10-FIC-101_MODE"),
    "SP and mode alone": ("FIC101", "FC101.SP FIC101.PV FIC101.OP FC101.MODE"),
    "Yokogawa": ("FIC101", "FIC101.SV FIC101.PV FIC101.MV FIC101.MODE"),
}
KINDS = ("SP", "PV", "OP", "MODE")


@pytest.mark.parametrize("name", WHOLE)
def test_a_loop_of_several_prefixes_is_whole(tmp_path, name):
    """Regression: SP or MODE under another prefix than PV and OP was lost without a word."""
    loop, names = WHOLE[name]
    got, [recording] = columns(tmp_path, *names.split())
    assert got == {loop: dict(zip(KINDS, names.split(), strict=True))}
    assert recording.left_out == []


@pytest.mark.parametrize("name", WHOLE)
def test_several_such_loops_are_not_mixed(tmp_path, name):
    loop, names = WHOLE[name]
    second, others = (text.replace("101", "102") for text in (loop, names))
    got, _ = columns(tmp_path, *others.split(), *names.split())
    assert got == {one: dict(zip(KINDS, of.split(), strict=True)) for one, of in ((second, others), (loop, names))}


@pytest.mark.parametrize(
    "signals",
    [
        {"Unit1/FIC101": {"sp"}, "Unit1/FIC102": {"pv", "op"}},  # of one unit, not of one loop
        {"FIC101": {"sp"}, "TIC101": {"pv", "op"}},  # another measured variable
        {"FIC101A": {"sp"}, "FIC101B": {"pv", "op"}},
        {"FIC101/PID1": {"sp", "pv", "op"}, "FIC101/PID2": {"sp", "pv"}, "FIC101": {"mode", "op"}},  # a cascade
        {"FIC101": {"sp", "pv"}, "FIC101/AI1": {"pv", "op", "mode"}, "FT101": {"op"}},  # a transmitter's output
        {"FIC101": {"pv", "op"}, "FV101": {"sp", "mode"}, "FIC101/AO1": {"sp", "mode"}},  # the positioner's
        {"FIC101": {"sp", "pv", "op"}, "FI101": {"pv"}, "FV101": {"op"}},  # nothing is lacking
        {"FIC101": {"sp", "pv"}, "FV101": {"op"}, "FY101": {"op"}},  # two have it
        {"FT101": {"pv"}, "FI101": {"pv"}},
        {"PIDA": {"sp"}, "DACA": {"pv"}},
    ],
)
def test_what_only_looks_alike_stays_apart(signals):
    assert shared(signals) == {}


def test_the_position_of_the_valve_is_of_its_loop(tmp_path):
    got, _ = columns(tmp_path, "FIC101.SP", "FIC101.PV", "FIC101.OP", "FV101.POS")
    assert got["FIC101"]["position"] == "FV101.POS"


def test_two_that_could_be_one_signal_are_asked_for(tmp_path):
    with pytest.raises(InputError, match=r"the columns 'FT101.PV' and 'FI101.PV' could both be PV"):
        columns(tmp_path, "FIC101.SP", "FIC101.OP", "FT101.PV", "FI101.PV")


def test_a_signal_of_no_loop_is_named_with_what_to_write(tmp_path):
    _, [recording] = columns(tmp_path, "FIC101.SP", "FIC101.PV", "FIC101.OP", "XC9.MODE")
    assert recording.left_out == [
        "MODE is not read, and may be in the column XC9.MODE: if so, write --mode 'XC9.MODE', or in loops.toml "
        'columns = { mode = "XC9.MODE" }'
    ]


def test_of_several_loops_those_are_told_that_may_have_it(tmp_path):
    first, second = (["SP", "PV", "OP"] for _ in range(2))
    names = [f"FIC101.{one}" for one in first] + [f"FIC102.{one}" for one in second]
    _, opened = columns(tmp_path, *names, "SEQ102.MODE")
    assert [recording.left_out for recording in opened] == [
        [],
        [
            "MODE is not read, and may be in the column SEQ102.MODE: if so, write in loops.toml "
            'columns = { mode = "SEQ102.MODE" }'
        ],
    ]
    _, opened = columns(tmp_path, *names, "MODE")
    assert [["in the column MODE" in text for text in recording.left_out] for recording in opened] == [[True], [True]]


def test_what_is_taken_for_no_loop_is_named_with_what_to_write(tmp_path):
    """Regression: a controller without PV, or without SP where others have it, was lost without a word."""
    names = [f"FIC101.{one}" for one in ("SP", "PV", "OP")] + ["FIC102.SP", "FIC102.PV", "FIC102.OP"]
    lost = ["FIC104.SP", "FIC104.OP", "FIC103.PV", "FIC103.OP", "TI7.PV", "FT9.PV", "FT9.OP"]
    _, opened = columns(tmp_path, *names, *lost)
    assert [recording.left_out for recording in opened] == [
        [
            "PV and OP of FIC103, FT9 are not read, because other loops have SP: name what is a loop in loops.toml",
            "SP and OP of FIC104 cannot be judged without PV: export PV too, or name it in loops.toml: columns.pv",
        ],
        [],
    ]
    _, opened = columns(tmp_path, *names, *lost, loops=[Loop(name="FIC101"), Loop(name="FIC102")])
    assert [recording.left_out for recording in opened] == [[], []]
    named = [Loop(name="fic103"), Loop(name="FIC104", columns={"pv": "TI7.PV"})]
    got, _ = columns(tmp_path, *names, *lost, loops=named)
    assert got["fic103"] == {"PV": "FIC103.PV", "OP": "FIC103.OP"}
    assert got["FIC104"] == {"SP": "FIC104.SP", "PV": "TI7.PV", "OP": "FIC104.OP"}
    _, [recording] = columns(tmp_path, *names[:3], *lost[:2])
    assert ["of FIC104 cannot be judged without PV" in text for text in recording.left_out] == [True]


def test_who_says_that_there_is_none_or_names_one_is_told_nothing(tmp_path):
    names = ("FIC101.SP", "FIC101.PV", "FIC101.OP", "XC9.MODE")
    for mode in ("", "XC9.MODE"):
        _, [recording] = columns(tmp_path, *names, defaults={"columns": {"mode": mode}})
        assert recording.left_out == []
    loops = [Loop(name="FIC101"), Loop(name="B", columns={"pv": "FIC101.PV", "op": "FIC101.OP", "mode": "XC9.MODE"})]
    _, [one, _] = columns(tmp_path, *names, loops=loops)
    assert one.left_out == []


def test_names_that_show_no_loop_are_all_put_into_the_hint(tmp_path):
    with pytest.raises(InputError) as error:
        columns(tmp_path, "A.SP", "B.PV", "C.OP", "D.MODE")
    assert "the names of the columns show no loop: A.SP, B.PV, C.OP, D.MODE (time is t)" in str(error.value)
    assert "name them: --pv 'B.PV' --op 'C.OP' --sp 'A.SP' --mode 'D.MODE', or in loops.toml" in str(error.value)
    with pytest.raises(InputError, match=r"no column for PV among those left.*--pv NAME --op 'C.OP' --sp 'A.SP', or"):
        columns(tmp_path, "A.SP", "flow", "C.OP")


def test_a_row_per_tag_and_time_is_read_the_same_way(tmp_path):
    path = tmp_path / "x.csv"
    tags = WHOLE["Experion"][1].split()
    lines = [f"{k},{tag},{50 + k % (i + 3)}" for k in range(30) for i, tag in enumerate(tags[:3])]
    path.write_text("\n".join(["t,tag,value", *lines]), encoding="utf-8")
    [recording] = open_recordings(path)
    assert recording.name == "FIC101" and {"SP", "PV", "OP"} <= recording.columns.keys()


def test_of_many_loops_each_is_found_by_its_number():
    names = [f"{kind}{i}.{role}" for i in range(500) for kind, role in (("FIC", "SP"), ("FT", "PV"), ("XX", "MODE"))]
    signals = SignalColumns(names)
    assert len(signals.groups) == 500 and signals.groups[7] == "FIC7"
    assert signals.of_no_loop("mode", "FIC7") == ["XX7.MODE"]


def test_variables_of_a_server_are_taken_for_one_loop_in_the_same_way():
    found = [("FIC1.PIDA.SP", "a"), ("FIC1.DACA.PV", "b"), ("FIC1.PIDA.OP", "c"), ("FIC1.MODE", "d")]
    assert loops_of(found) == ({"FIC1": {"sp": "a", "pv": "b", "op": "c", "mode": "d"}}, 0)
    assert loops_of([("FT1.PV", "a"), ("FI1.PV", "b"), ("FIC1.SP", "c")]) == ({}, 3), "which is PV is not sure"
