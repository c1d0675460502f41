"""Python as people type it: files and tables in place of a recording, and the output in a notebook."""

import numpy as np
import pytest

import glapp
from glapp.plant import PLANTS
from glapp.result import Answer
from glapp.tuning import migo

N = 400
T = np.arange(N, dtype=float)
TABLE = {"t": T, "SP": np.full(N, 50.0), "PV": 50 + np.sin(T / 7), "OP": 40 + np.cos(T / 7)}


def write(path, names=("t", "SP", "PV", "OP")):
    rows = zip(*TABLE.values(), strict=True)
    path.write_text("\n".join([",".join(names), *(",".join(f"{x:.5f}" for x in row) for row in rows)]) + "\n")
    return path


def test_a_path_a_list_of_them_and_a_table(tmp_path):
    one, two = write(tmp_path / "F1.csv"), write(tmp_path / "F2.csv")
    assert glapp.analyze(str(one), fit=False).name == "F1"
    assert [result.name for result in glapp.analyze([one, str(two)], fit=False)] == ["F1", "F2"]
    assert glapp.analyze(TABLE, fit=False).loop.name == "loop"


def test_columns_are_named_beside_a_file_and_a_table(tmp_path):
    path = write(tmp_path / "F1.csv", ("when", "a", "b", "c"))
    with pytest.raises(glapp.InputError, match="no column for"):
        glapp.analyze(path, fit=False)
    result = glapp.analyze(path, t="when", sp="a", pv="b", op="c", fit=False)
    assert result.columns == {"time": "when", "SP": "a", "PV": "b", "OP": "c"}
    table = dict(zip(["when", "a", "b", "c"], TABLE.values(), strict=True))
    assert glapp.analyze(table, t="when", sp="a", pv="b", op="c", fit=False).columns == result.columns
    with pytest.raises(glapp.InputError, match="pv: goes with no file or table"):
        glapp.analyze(path, pv=TABLE["PV"])


def test_a_file_of_several_loops_asks_for_a_list(tmp_path):
    path = write(tmp_path / "x.csv", ("t", "F1.SP", "F1.PV", "F1.OP"))
    wide = path.read_text().splitlines()
    path.write_text("\n".join([wide[0] + ",F2.SP,F2.PV,F2.OP", *(f"{row},{row.split(',', 1)[1]}" for row in wide[1:])]))
    with pytest.raises(glapp.InputError, match=r"x.csv: holds 2 loops: F1, F2; give a list, glapp.analyze\(\[path\]\)"):
        glapp.analyze(path)


@pytest.fixture(scope="module")
def shown():
    recording = glapp.recording_from(TABLE)
    sim = glapp.simulate.closed_loop("P3", (0.48, 0.3117), t_end=20)
    loop = glapp.Loop(name="F<1>", pv_span=(0, 50))
    return {
        "recording": recording,
        "sim": sim,
        "loop": loop,
        "tuning": migo("P3"),
        "result": glapp.analyze(TABLE, fit=False),
    }


@pytest.mark.parametrize("name", ["recording", "sim", "loop", "tuning", "result"])
def test_a_notebook_shows_a_table_and_a_line(shown, name):
    thing = shown[name]
    assert len(repr(thing)) < 200 and "\n" not in repr(thing)
    assert thing._repr_html_().startswith("<b>") and "<table>" in thing._repr_html_()


def test_names_from_outside_are_escaped(shown):
    assert repr(shown["loop"]) == "Loop(name='F<1>', pv_span=(0.0, 50.0))"
    assert "F&lt;1&gt;" in shown["loop"]._repr_html_()


@pytest.mark.parametrize("name", PLANTS)
def test_step_and_bode_of_every_plant(name):
    plant = PLANTS[name]
    t, y = plant.step()
    assert np.isfinite(y).all() and y[-1] == pytest.approx(plant.gain, rel=0.05) if plant.gain else np.isfinite(y).all()
    w, magnitude, phase = plant.bode()
    np.testing.assert_allclose(magnitude * np.exp(1j * np.radians(phase)), plant.response(w), atol=1e-9)
    assert len(t) == 400


def test_migo_takes_ms_as_books_write_it():
    assert migo("P3", Ms=1.6).controller == migo("P3", ms=1.6).controller
    with pytest.raises(glapp.InputError, match="ms: is given twice"):
        migo("P3", ms=1.4, Ms=1.6)


@pytest.mark.parametrize(
    ("kind", "width", "low", "high", "expected"),
    [
        ("interval", 2.0, 1.5, 2.5, (2.0, None)),
        ("bound", 2.0, 2.0, None, (None, (2.0, None))),
        ("bound", None, 0.0, 0.7, (None, (None, 0.7))),
    ],
)
def test_a_bound_is_no_width(shown, kind, width, low, high, expected):
    from dataclasses import replace

    answer: Answer = replace(shown["result"].answer, width_kind=kind, width=width, low=low, high=high)
    result = replace(shown["result"], answer=answer)
    assert (result.width, result.bound) == expected
