"""The layout of the public stiction data base, in a file of that layout that is made here."""

import numpy as np
import pytest

import glapp
from glapp import InputError
from glapp.reading.isdb import QUOTED, open_isdb

io = pytest.importorskip("scipy.io")


def a_loop(brief, n=400, *, op=True, step=2.0, kind=0, sp=None):
    sim = glapp.simulate.closed_loop("P3", (0.48, 0.3117), d=0.05, noise=0.001, t_end=(n - 1) * 0.5, h=0.5, seed=1)
    return {
        "Comments": np.array(["first line", "second line"], dtype=object),
        "BriefComments": brief,
        "Type": kind,
        "Ts": step,
        "t": np.arange(n),
        "PV": sim.pv[:n],
        "OP": sim.op[:n] if op else np.zeros(3),
        "SP": np.zeros(n) if sp is None else sp,
    }


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "isdb10.mat"
    chemicals = {
        "loop10": a_loop("Pressure control; with stiction (somebody)"),
        "loop12": a_loop("Level control; no stiction", op=False, kind=1),
        "loop23": a_loop("Flow control with stiction (likely)", step=np.nan),
        "loop40": a_loop("", sp=5.0),
    }
    io.savemat(path, {"cdata": {"chemicals": chemicals, "testdata": {"loop1": a_loop("made")}}})
    return path


def test_each_loop_has_its_signals_its_times_and_what_is_said_of_it(file):
    loops = open_isdb(file)
    assert [one.name for one in loops] == [f"chemicals.loop{n}" for n in (10, 12, 23, 40)]
    assert [one.says for one in loops] == ["stiction", "no stiction", "likely stiction", None]
    assert [one.quoted for one in loops] == ["stiction", "stiction", "stiction", None]
    assert loops[3].comment == "first line second line"
    first = loops[0].recording.beginning(10)
    assert list(first.t) == [2.0 * k for k in range(10)]
    assert list(loops[2].recording.beginning(3).t) == [0.0, 1.0, 2.0], "without Ts its own times"
    assert loops[1].recording.loop.process.type == "integrating"
    assert loops[1].recording.beginning(3).op is None, "an OP of another length is none"
    assert list(loops[3].recording.beginning(2).sp) == [5.0, 5.0]
    assert len(open_isdb(file, synthetic=True)) == 5


def test_of_the_twenty_quoted_loops_thirteen_stick():
    assert len(QUOTED) == 20
    assert sum(verdict == "stiction" for verdict in QUOTED.values()) == 13
    assert all(verdict == "stiction" or verdict.startswith("no stiction: ") for verdict in QUOTED.values())


def test_a_loop_is_analysed_like_any_other(file):
    result = glapp.analyze(open_isdb(file)[0].recording, fit=False)
    assert result.name == "chemicals.loop10"
    assert result.source == "isdb10.mat: chemicals.loop10"


def test_another_file_is_refused_with_what_it_lacks(tmp_path):
    io.savemat(tmp_path / "other.mat", {"x": np.arange(3)})
    with pytest.raises(InputError, match="holds no struct cdata"):
        open_isdb(tmp_path / "other.mat")
    (tmp_path / "text.mat").write_text("no MAT file")
    with pytest.raises(InputError, match="cannot be read"):
        open_isdb(tmp_path / "text.mat")
    empty = {"loop1": a_loop("x") | {"PV": np.full(5, np.nan)}}
    io.savemat(tmp_path / "empty.mat", {"cdata": {"chemicals": empty}})
    with pytest.raises(InputError, match=r"chemicals\.loop1.*has no PV|has no PV"):
        open_isdb(tmp_path / "empty.mat")
