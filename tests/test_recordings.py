"""Several recordings of one valve: one answer, from evidence that adds up and from none that does not."""

from __future__ import annotations

import json
import re
from datetime import datetime, timedelta
from itertools import permutations
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from bench.loads.records import record

import glapp
from glapp.errors import InputError
from glapp.several_recordings import analyze_recordings

REFINERY = Path(__file__).parents[1].parent / "shared/data/refinery"
FIRST_DAY = datetime(2026, 3, 1)
SAMPLES = 750


def day(name: str, number: int, samples: int = SAMPLES, **settings: Any) -> glapp.Recording:
    """A day of a loop of `bench.loads`, with its date."""
    made = record(f"{name}/{number}", samples)
    return dated(made.table, made.loop, number, **settings)


def dated(table: pa.Table, loop: glapp.Loop, number: int, **settings: Any) -> glapp.Recording:
    start = np.datetime64(FIRST_DAY + timedelta(days=number))
    times = start + (1000 * table["t"].to_numpy()).astype("timedelta64[ms]")
    columns = {"time": times, **{name: table[name] for name in ("SP", "PV", "OP")}}
    return glapp.recording_from(columns, glapp.Loop(**loop.model_dump(exclude_unset=True) | settings))


def small(number: int, **settings: Any) -> glapp.Recording:
    """A recording too short for any statement."""
    return day("steps/none/0", number, 120, **settings)


@pytest.fixture(scope="module")
def three() -> glapp.Fit:
    return glapp.fit([day("steps/gap/0", number) for number in range(3)])


@pytest.mark.slow
class TestOneWidth:
    def test_what_none_tells_alone_three_tell_together(self) -> None:
        truth = record("random ramps/gap/0/0", SAMPLES).d
        three = glapp.fit([day("random ramps/gap/0", number) for number in range(3)])
        assert {one.fit.verdict for one in three.recordings} == {"cannot_tell"}
        assert three.verdict == "backlash", three.reason
        assert three.low is not None and three.high is not None and three.low < truth < three.high
        assert three.reason.startswith("by 3 recordings together: dead band of")

    def test_what_all_say_is_the_sum_of_what_each_adds_and_sharper(self, three: glapp.Fit) -> None:
        assert three.lr_no_gap == pytest.approx(sum(one.adds for one in three.recordings))
        alone = [one.fit for one in three.recordings]
        assert three.low is not None and three.high is not None
        assert three.high - three.low < min((f.high or np.inf) - (f.low or 0.0) for f in alone)

    def test_a_recording_says_alone_what_it_always_says(self, three: glapp.Fit) -> None:
        alone = glapp.fit(day("steps/gap/0", 1))
        assert repr(three.recordings[1].fit) == repr(alone) and three.recordings[1].fit.reason == alone.reason
        of_one = glapp.fit([day("steps/gap/0", 1)])
        assert (of_one.reason, of_one.recordings) == (alone.reason, [])

    def test_the_harm_is_the_mean_of_what_each_shows(self) -> None:
        days = [day("steps/gap/0", number) for number in (0, 2)]
        alone = [glapp.analyze(one).answer.harm for one in days]
        both = analyze_recordings(days).answer.harm
        assert both is not None
        for share in ("pv_share", "op_share"):
            assert getattr(both, share) == pytest.approx(np.mean([getattr(one, share) for one in alone]))

    @pytest.mark.verify
    def test_the_order_given_does_not_matter(self, three: glapp.Fit) -> None:
        days = [day("steps/gap/0", number) for number in range(3)]
        for order in list(permutations(days))[1::2]:
            again = glapp.fit(order)
            assert again.to_dict() == three.to_dict()

    @pytest.mark.verify
    def test_the_unit_of_op_does_not_matter(self, three: glapp.Fit) -> None:
        def scaled(number: int) -> glapp.Recording:
            made = record(f"steps/gap/0/{number}", SAMPLES)
            op = pa.array(made.table["OP"].to_numpy() * 8.0)
            table = made.table.set_column(made.table.column_names.index("OP"), "OP", op)
            controller = {"k": 1.0, "ti": 10.0, "gain_unit": "OP/PV"}
            return dated(table, glapp.Loop(name="F"), number, op_span=(0, 800), controller=controller)

        again = glapp.fit([scaled(number) for number in range(3)])
        assert again.verdict == three.verdict
        for here, there in ((again.d, three.d), (again.low, three.low), (again.high, three.high)):
            assert here is not None and there is not None and here / 8.0 == pytest.approx(there, rel=1e-6)

    def test_without_a_gap_none_is_shown(self) -> None:
        answer = glapp.fit([day("steps/none/0", number) for number in range(3)])
        assert not answer.found, answer.reason
        assert {one.fit.found for one in answer.recordings} == {False}

    def test_a_load_that_swings_evenly_does_not_add_up(self) -> None:
        answer = glapp.fit([day("triangle fast/none/0", number) for number in range(3)])
        assert not answer.found, answer.reason
        assert all(one.left_out is not None and one.adds == 0 for one in answer.recordings)
        assert "Not counted, since OP swings almost evenly" in answer.reason

    def test_two_valves_are_no_valve(self) -> None:
        """A gap of 0.8 and one of three times as much, each plain by itself."""
        wide, narrow = record("steps/gap/0/4", 1500), record("steps/none/0/2", 1500)
        answer = glapp.fit([dated(wide.table, wide.loop, 1), dated(narrow.table, wide.loop, 2)])
        assert [one.fit.verdict for one in answer.recordings] == ["backlash", "sound"]
        assert answer.verdict == "cannot_tell" and "the recordings disagree" in answer.reason


@pytest.mark.slow
class TestReplays:
    @pytest.mark.verify
    def test_a_replay_counts_once(self) -> None:
        first = record("steps/gap/0/2", SAMPLES)
        once = glapp.fit(dated(first.table, first.loop, 0))
        answer = glapp.fit([dated(first.table, first.loop, number) for number in range(4)])
        assert [one.repeated for one in answer.recordings] == [0.0, 1.0, 1.0, 1.0]
        assert (answer.verdict, answer.d, answer.low, answer.high) == (once.verdict, once.d, once.low, once.high)
        assert "100\N{NO-BREAK SPACE}% of memory (2) is in an earlier recording too" in answer.reason

    @pytest.mark.verify
    def test_repeated_rows_are_reported_and_count_once(self) -> None:
        first, second = (record(f"steps/gap/0/{number}", SAMPLES) for number in (0, 1))
        half = pa.concat_tables([first.table.slice(0, 375), second.table.slice(375)])
        answer = glapp.fit([dated(first.table, first.loop, 0), dated(half, first.loop, 1)])
        assert answer.recordings[1].repeated == pytest.approx(0.5, abs=0.01)
        assert answer.recordings[1].fit.best["cells"] == pytest.approx(375, abs=10)


class TestRefused:
    @pytest.mark.parametrize(
        ("settings", "named"),
        [
            ({"op_span": (0, 50)}, "op_span: is (0.0, 50.0), and (0.0, 100.0) in memory"),
            ({"pv_span": (0, 10)}, "pv_span: is (0.0, 10.0), and (0.0, 100.0) in memory"),
            ({"pv_unit": "bar"}, "pv_unit: is bar, and not given in memory"),
            ({"op_unit": "mA"}, "op_unit: is mA, and not given in memory"),
            (
                {"controller": {"k": 2.0, "ti": 7.0, "gain_unit": "OP/PV"}},
                "controller: is k 2.0, gain_unit OP/PV, ti 7.0, and k 0.457",
            ),
            ({"positioner": {"dead_band": 0.5}}, "positioner: is dead_band 0.5, and not given in memory"),
        ],
    )
    def test_what_cannot_be_of_one_valve(self, settings: dict[str, Any], named: str) -> None:
        with pytest.raises(InputError) as refused:
            glapp.fit([small(0), small(1), small(2, **settings)])
        assert named in str(refused.value)
        assert refused.value.parameter == next(iter(settings))

    def test_arguments_that_are_no_recordings_are_refused(self) -> None:
        with pytest.raises(InputError, match="recording: holds no recording"):
            glapp.fit([])
        with pytest.raises(InputError, match=r"FIC101\.csv: no such file"):
            glapp.fit(["FIC101.csv", "FIC101_2.csv"])  # type: ignore[list-item]
        with pytest.raises(InputError, match="a recording has its signals"):
            glapp.fit([small(0), small(1)], t=np.arange(3.0))

    @pytest.mark.slow
    def test_recordings_that_cannot_be_fitted_are_told_and_do_not_count(self) -> None:
        answer = glapp.fit([small(0), small(1, columns={"op": ""})])
        refused = answer.recordings[1]
        assert refused.left_out is not None and refused.left_out.startswith("there is no OP")
        none = glapp.fit([small(0, columns={"op": ""}), small(1, columns={"op": ""})])
        assert none.verdict == "cannot_tell" and "there is no OP" in none.reason and none.d is None


@pytest.mark.slow
@pytest.mark.skipif(not REFINERY.exists(), reason="the recordings of ../shared/data are not here")
class TestRealLoops:
    def joined(self, loop: str) -> glapp.Fit:
        return glapp.fit([glapp.open_recordings(path)[0] for path in sorted(REFINERY.glob(f"{loop}_*.csv"))])

    def test_three_exports_of_one_valve_give_one_answer(self) -> None:
        answer = self.joined("FIC20102")
        assert [one.t0 for one in answer.recordings] == sorted(one.t0 for one in answer.recordings if one.t0)
        assert len(answer.recordings) == 3 and answer.d == pytest.approx(2.2, rel=0.1)
        assert not answer.found, "each has one or two moves of OP"

    def test_an_oscillation_joined_stays_without_a_gap(self) -> None:
        assert not self.joined("LIC31102B").found

    def test_a_recording_that_tells_little_takes_nothing_from_one_that_tells(self) -> None:
        answer = self.joined("FIC46005")
        assert answer.verdict == "backlash" and answer.d == pytest.approx(0.598, rel=0.02)
        assert "alone, of 2 recordings" in answer.reason


class TestCommandLine:
    """`--as-loop NAME` and `files` of a loops.toml: a row a valve."""

    @pytest.fixture(autouse=True)
    def here(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.chdir(tmp_path)
        for number, name in enumerate(["mon.csv", "tue.csv", "wed.csv"]):
            made = record(f"steps/gap/0/{number}", SAMPLES)
            start = np.datetime64(FIRST_DAY + timedelta(days=number))
            times = start + (1000 * made.table["t"].to_numpy()).astype("timedelta64[ms]")
            rows = zip(times.astype(str), *(made.table[s].to_pylist() for s in ("SP", "PV", "OP")), strict=True)
            lines = ["Time,SP,PV,OP", *(f"{t},{sp},{pv},{op}" for t, sp, pv, op in rows)]
            Path(name).write_text("\n".join(lines) + "\n")

    @pytest.mark.slow
    def test_one_row_and_one_answer(self, run: Any, three: glapp.Fit) -> None:
        words = ("analyze", "wed.csv", "mon.csv", "tue.csv", "--as-loop", "FIC1", "--json", "--report", "r.html")
        code, *out = run(*words)
        assert code == 0
        [loop] = json.loads(out[0])["loops"]
        assert (loop["loop"], loop["file"]) == ("FIC1", "mon.csv, tue.csv, wed.csv")
        fit = loop["fit"]
        assert (fit["verdict"], len(fit["recordings"])) == ("backlash", 3)
        assert [r["file"] for r in fit["recordings"]] == ["mon.csv", "tue.csv", "wed.csv"]
        assert [r["t0"][:10] for r in fit["recordings"]] == ["2026-03-01", "2026-03-02", "2026-03-03"]
        assert fit["d"] == pytest.approx(three.d, rel=0.01)
        page = Path("r.html").read_text()
        assert "By 3 recordings together" in page
        assert re.search(r"Drawn is \w+\.csv, which of 3 recordings shows best", page)

    @pytest.mark.slow
    def test_files_of_a_loop_in_a_loops_toml(self, run: Any) -> None:
        Path("loops.toml").write_text('[loops.FIC1]\nfiles = ["mon.csv", "tue.csv", "wed.csv"]\n')
        code, *out = run("analyze", "loops.toml", "--why")
        assert code == 0
        assert "FIC1 (3 recordings)" in out[0] and "3 of 3 recordings count" in " ".join(out[0].split())

    def test_a_file_that_is_not_there_stops_no_other(self, run: Any) -> None:
        Path("loops.toml").write_text('[loops.FIC1]\nfiles = ["mon.csv", "tue.csv", "none.csv"]\n')
        code, *out = run("analyze", "loops.toml", "--no-fit", "--json")
        assert code == 1 and "none.csv" in out[1]
        loops = json.loads(out[0])["loops"]
        assert [(loop["file"], loop["crossings"] == "refused") for loop in loops] == [
            ("mon.csv, tue.csv", False),
            ("none.csv", True),
        ]

    def test_another_unit_is_refused_by_name(self, run: Any) -> None:
        text = Path("tue.csv").read_text()
        Path("tue.csv").write_text(text.replace("PV,OP", "PV [bar],OP", 1))
        code, *out = run("analyze", "mon.csv", "tue.csv", "--as-loop", "FIC1", "--no-fit")
        assert code == 1
        assert "tue.csv, pv_unit: is bar, and not given in mon.csv" in " ".join(out[1].split())

    @pytest.mark.parametrize(
        ("toml", "message"),
        [
            ('file = "mon.csv"\nfiles = ["tue.csv"]', "files: are given in addition to file"),
            ('files = ["tue.csv", "tue.csv"]', "files: names tue.csv twice"),
        ],
    )
    def test_files_that_contradict_themselves(self, run: Any, toml: str, message: str) -> None:
        Path("loops.toml").write_text(f"[loops.FIC1]\n{toml}\n")
        code, *out = run("analyze", "loops.toml")
        assert code == 1 and message in " ".join(out[1].split())

    def test_a_loops_toml_says_so_itself(self, run: Any) -> None:
        Path("loops.toml").write_text('[loops.FIC1]\nfiles = ["mon.csv", "tue.csv"]\n')
        code, *out = run("analyze", "loops.toml", "--as-loop", "FIC1")
        assert code == 2 and "--as-loop takes recordings" in " ".join(out[1].split())
        # Each recording gets its own answer.
        code, *out = run("identify", "loops.toml")
        assert code == 0 and "(mon.csv)" in out[0] and "(tue.csv)" in out[0]
