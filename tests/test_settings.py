"""loops.toml: reading, writing, first version from a recording, and every fault in one line."""

import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from glapp.errors import InputError
from glapp.loop import Loop
from glapp.reading import open_recordings
from glapp.reading.init import settings_of
from glapp.reading.settings import parse_settings, read_settings, write_settings

ROOT = Path(__file__).parents[1]


def parse(text):
    return parse_settings(text, "loops.toml", Path("plant"))


def test_defaults_complete_a_loop_key_by_key():
    [a, b] = parse("""
        [defaults]
        op_span = [0, 100]
        [loops.A]
        file = "a.csv"
        controller = { form = "series", k = 1, ti = 2, ti_unit = "min" }
        [loops.B]
        op_span = [4, 20]
    """)
    assert (a.name, a.file, a.op_span, a.ideal().ti) == ("A", Path("plant/a.csv"), (0, 100), 120)
    assert (b.file, b.op_span, b.controller) == (None, (4, 20), None)


@pytest.mark.parametrize(
    ("defaults", "own", "written"),
    [
        # The defaults alone were refused: "give either the gain k or the proportional band pb".
        ('form = "series"\nti_unit = "min"', "k = 2\nti = 0.5", "series: K 2, Ti 0.5 min, Td 0 s, reverse acting"),
        ("k = 1\nti = 30", "ti = 40", "ideal: K 1, Ti 40 s, Td 0 s, reverse acting"),
        ("k = 1\nti = 30", 'ti_unit = "min"', "ideal: K 1, Ti 30 min, Td 0 s, reverse acting"),
        # These two were "give either": the default says in another way what the loop says.
        ('k = 1\nti = 30\ngain_unit = "OP/PV"', "pb = 50", "ideal: PB 50 %, Ti 30 s, Td 0 s, reverse acting"),
        ("pb = 50\nti = 30", "k = 3", "ideal: K 3, Ti 30 s, Td 0 s, reverse acting"),
        ("k = 1\nti = 30\ntd = 2", 'form = "parallel"\nkp = 2\nki = 0.1', "parallel: kp 2, ki 0.1 per s, kd 0 s, "),
        ('form = "parallel"\nkp = 2\nki = 1', 'form = "ideal"\nk = 1\nti = 9', "ideal: K 1, Ti 9 s, Td 0 s, reverse"),
    ],
)
def test_a_default_controller_is_completed_by_the_loop_whose_keys_win(defaults, own, written):
    [loop] = parse(f"[defaults.controller]\n{defaults}\n[loops.A.controller]\n{own}\n")
    assert loop.controller.as_written().startswith(written)


def test_a_default_controller_that_is_not_whole_is_for_loops_that_have_one():
    a, b = parse("""
        [defaults.controller]
        ti_unit = "min"
        action = "direct"
        [loops.A]
        [loops.B.controller]
        k = 2
        ti = 1
    """)
    assert a.controller is None  # identified from the data
    assert b.controller.as_written() == "ideal: K 2, Ti 1 min, Td 0 s, direct acting"
    [c] = parse("[defaults.controller]\nk = 2\nti = 1\n[loops.C]")
    assert c.ideal().k == 2


def test_a_default_gain_is_no_gain_of_an_integrating_process():
    [loop] = parse("[defaults.process]\nkp = 2\n[loops.A.process]\ntype = 'integrating'")
    assert (loop.process.type, loop.process.kp) == ("integrating", None)


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("", "loops.toml: has no loops"),
        ("[loops", "loops.toml: is not valid TOML"),
        ("[loop.A]", "loops.toml, loop: no such table; did you mean [loops]?"),
        ("loops = 3", "loops.toml, loops: is 3, must be a table"),
        ("[loops]\nA = 3", "loops.toml, loops.A: is 3, must be a table"),
        ("[loops.A]\npvspan = [0, 1]", "loops.toml, loop A, pvspan: no such key; did you mean pv_span?"),
        ("[loops.A]\ncontroller = { k = 0, ti = 1 }", "loops.toml, loop A, controller.k: is 0, must be > 0"),
        (
            "[loops.A]\ncontroller = { k = 1, ti = 1, ti_unt = 's' }",
            "loops.toml, loop A, controller.ti_unt: no such key; did",
        ),
        ("[loops.A]\npv_span = [5, 1]", "loops.toml, loop A, pv_span: goes from 5 to 1, must be low < high"),
        ("[loops.A]\nname = 'B'", "loops.toml, loop A, name: is given by the table"),
        ("[defaults]\nfile = 'x'\n[loops.A]", "loops.toml, defaults.file: belongs to a loop"),
        ("[loops.A]\nrepaired = 'soon'", "loops.toml, loop A, repaired: is 'soon', must be a date and time such as"),
        # Regression: a number was taken for seconds since 1970.
        ("[loops.A]\nrepaired = 20260301", "loops.toml, loop A, repaired: is 20260301, must be a date and time such"),
        ("[defaults]\nn = 4\n[loops.A]", "loops.toml, defaults.n: is 4, must be odd"),
        (
            "[defaults.controller]\nti_unti = 's'\n[loops.A]",
            "loops.toml, defaults.controller.ti_unti: no such key; did",
        ),
        ("[defaults.controller]\ntd = -1\n[loops.A]", "loops.toml, defaults.controller.td: is -1, must be ≥ 0"),
        (
            "[defaults.controller]\nti = 3\n[loops.A.controller]\ntd = 1",
            "loops.toml, loop A, controller.k: give either",
        ),
    ],
)
def test_each_fault_is_one_line(text, line):
    with pytest.raises(InputError) as caught:
        parse(text)
    assert str(caught.value).startswith(line)
    assert "\n" not in str(caught.value)


def test_missing_directory_and_binary(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_settings(tmp_path / "no.toml")
    with pytest.raises(InputError, match="is a directory"):
        read_settings(tmp_path)
    (tmp_path / "b.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="is not UTF-8 text"):
        read_settings(tmp_path / "b.toml")


@given(st.text(max_size=200))
def test_any_text_gives_loops_or_an_input_error(text):
    try:
        parse(text)
    except InputError as error:
        assert "\n" not in str(error)


names = st.text(min_size=1, max_size=12).filter(str.strip)
floats = st.floats(-1e6, 1e6)
spans = st.tuples(floats, st.floats(1e-3, 1e6)).map(lambda s: (s[0], s[0] + s[1])).filter(lambda s: s[0] < s[1])
loops = st.builds(
    lambda **k: Loop(**{key: value for key, value in k.items() if value is not None}),
    name=names,
    pv_span=st.none() | spans,
    op_unit=st.none() | st.text(max_size=8),
    area=st.none() | st.text(max_size=8),
    n=st.integers(0, 15).map(lambda i: 2 * i + 1),
    split_range=st.booleans(),
    bad_values=st.lists(st.text(max_size=5) | floats, max_size=3).map(tuple),
    controller=st.none() | st.just({"k": 0.5, "ti": 3.0, "action": "direct", "gain_unit": "OP/PV"}),
    columns=st.none() | st.builds(lambda n: {"pv": n, "quality": ""}, names),
)


@given(st.lists(loops, min_size=1, max_size=3, unique_by=lambda loop: loop.name))
@pytest.mark.slow
def test_written_settings_read_back_equal(some):
    assert parse(write_settings(some)) == some


def test_the_reference_page_parses_and_names_every_key():
    page = (ROOT / "docs" / "loops.toml.md").read_text(encoding="utf-8")
    examples = re.findall(r"```toml\n(.*?)```", page, re.DOTALL)
    assert examples
    for example in examples:
        parse(example)
    [complete, *_] = (parse(e) for e in examples)
    for model in (Loop, *(type(getattr(complete[0], f)) for f in ("columns", "controller", "process", "positioner"))):
        for key in model.model_fields:
            assert key == "name" or f"`{key}`" in page, f"{key} is not documented"
    assert parse(write_settings(complete)) == [
        loop.model_copy(update={"file": "plant" / loop.file if loop.file else None}) for loop in complete
    ]


def recording(path, header="t,SP,PV [degC],OP"):
    path.write_text(header + "\n" + "".join(f"2024-01-01 00:00:{i:02d},50,{i},40\n" for i in range(0, 50, 5)))
    return path


def test_first_settings_parse_as_they_stand(tmp_path):
    text = settings_of(open_recordings(recording(tmp_path / "FIC 7.csv")))
    [loop] = parse_settings(text, "loops.toml", tmp_path)
    assert loop.name == "FIC 7"
    assert loop.columns.pv == "PV [degC]"
    assert loop.pv_unit == "degC"
    assert loop.pv_span is None and loop.op_span is None and loop.controller is None  # never from the data
    assert "One row every 5 s" in text


def test_first_settings_name_every_loop_of_a_wide_file(tmp_path):
    path = tmp_path / "plant.csv"
    recording(path, "t,A.SP,A.PV,B.SP").write_text(
        "t,A.SP,A.PV,B.SP,B.PV\n" + "".join(f"{i},50,{i},1,2\n" for i in range(9))
    )
    assert [loop.name for loop in parse_settings(settings_of(open_recordings(path)), "x", tmp_path)] == ["A", "B"]


def test_filling_in_the_first_settings_works(tmp_path):
    text = settings_of(open_recordings(recording(tmp_path / "F.csv")))
    text = text.replace("# pv_span = [0, 0]", "pv_span = [0, 200]").replace("# op_span", "op_span")
    text = re.sub(r"^# (\[loops.F.controller\]|form|gain_unit|ti_unit|td|action)", r"\1", text, flags=re.MULTILINE)
    text = text.replace("# k = 0.0", "k = 0.8").replace("# ti = 0.0", "ti = 30")
    [loop] = parse_settings(text, "loops.toml", tmp_path)
    assert loop.ideal().k == pytest.approx(0.4)
