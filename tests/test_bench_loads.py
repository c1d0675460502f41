"""The records of `bench.loads` and `bench.lengths` are what their names say, and answers are judged as they should."""

from dataclasses import replace

import numpy as np
import pytest
from bench import lengths
from bench.loads.answer import LoadsAnswer, against
from bench.loads.records import ROWS, Truth, record, swinging_door
from bench.truth.records import compressed

GAP = Truth(name="walk/gap/0", samples=1500, h=1.0, d=2.0, up=9, down=9, op_range=9.0, size=5.0, identifiable=True)
NONE = replace(GAP, name="walk/none/0", d=0.0, identifiable=False)


def answer_to(
    truth: Truth, verdict: str, low: float | None = None, high: float | None = None, sinusoidal: bool = False
) -> LoadsAnswer:
    return LoadsAnswer(truth, verdict, "", low, low, high, 50.0, min(low or 0.0, high or 0.0), sinusoidal, 1.0)


class TestRecords:
    @pytest.mark.parametrize("row", ROWS)
    def test_one_loop_with_and_without_a_gap(self, row: str) -> None:
        gap, none = record(f"{row}/gap/3"), record(f"{row}/none/3")
        assert record(f"{row}/gap/3").table.equals(gap.table)
        assert gap.truth(1500).d > 0 and none.truth(1500).d == 0
        assert (gap.size, gap.gain, gap.lag, gap.sigma) == (none.size, none.gain, none.lag, none.sigma)
        assert gap.loop.controller == none.loop.controller
        # Without a gap the valve is where OP is.
        assert np.array_equal(none.op, none.position) and not np.array_equal(gap.op, gap.position)
        assert ("POSITION" in gap.table.column_names) == (row == "position")
        assert not record(f"{row}/gap/4").table.equals(gap.table)

    @pytest.mark.slow
    @pytest.mark.parametrize("row", [*ROWS, *(f"{load}/PID" for load in lengths.LOADS)])
    def test_a_longer_one_begins_with_the_shorter_one(self, row: str) -> None:
        long, short = lengths.made(f"{row}/gap/1", 4000), lengths.made(f"{row}/gap/1", 1500)
        if row == "swinging door":  # the last line of the short one ends with it
            assert np.array_equal(long.op[:1500], short.op)
        else:
            assert long.table.slice(0, 1500).equals(short.table)
        assert long.truth(1500) == short.truth(1500)
        assert long.recording(1500).beginning(9999).pv.size == 1500

    @pytest.mark.parametrize("name", ["walk/some/1", "walk/PI/some/1", "walk/PD/gap/1", "wind/PI/gap/1"])
    def test_a_wrong_name_is_refused(self, name: str) -> None:
        with pytest.raises(ValueError, match=name):
            lengths.made(name, 100)

    @pytest.mark.slow
    def test_loops_have_the_sample_times_of_the_docs_and_a_valve_that_reverses(self) -> None:
        """The times between samples that the page on the bench names, and a valve that OP takes back and forth."""
        for load in lengths.LOADS[1:]:
            for kind in ("PI", "PID"):
                made = lengths.made(f"{load}/{kind}/gap/0", 3000)
                h, controller = made.truth(3000).h, made.loop.controller
                assert controller is not None
                assert h in (1.0, 10.0) and 0.01 <= h / controller.ti <= 0.5
                assert (controller.td > 0) == (kind == "PID")

    def test_the_swinging_door_stays_near(self) -> None:
        x = np.cumsum(np.random.default_rng(1).normal(size=2000))
        lines = swinging_door(x, 2.0)
        assert np.abs(lines - x).max() <= 2 * 2.0
        corners = np.count_nonzero(np.abs(np.diff(lines, 2)) > 1e-9)
        assert 20 < corners < 400
        straight = np.linspace(0.0, 5.0, 100)
        assert swinging_door(straight, 0.1) == pytest.approx(straight)

    def test_a_position_by_exception_is_within_half_a_per_cent(self) -> None:
        made = [record(f"position/none/{number}") for number in range(8)]
        off = [np.abs(r.table["POSITION"].to_numpy() - r.position) for r in made]
        held = [r for r, x in zip(made, off, strict=True) if x.max() <= 0.5]
        assert 3 <= len(held) < 8
        for r in held:
            assert np.array_equal(r.table["POSITION"].to_numpy(), compressed(r.position, 0.5))


class TestAnswers:
    @pytest.mark.parametrize(
        ("answer", "outcome"),
        [
            (answer_to(GAP, "backlash", 1.5, 2.5), "right"),
            (answer_to(GAP, "both", 2.1, 2.5), "wrong"),
            (answer_to(GAP, "stiction", 1.0, 1.9), "wrong"),
            (answer_to(GAP, "at_least", 1.9), "right"),
            (answer_to(GAP, "at_least", 2.1), "wrong"),
            (answer_to(GAP, "sound", 0.0, 1.9), "wrong"),
            (answer_to(GAP, "sound", 0.0, 2.1), "silent"),
            (answer_to(GAP, "oscillation", 0.0, 1.9), "silent"),
            (answer_to(GAP, "cannot_tell", 5.0, 9.0), "silent"),
            (answer_to(NONE, "backlash", 0.0, 9.0), "wrong"),
            (answer_to(NONE, "at_least", 0.0), "wrong"),
            (answer_to(NONE, "oscillation", 0.0, 9.0), "silent"),
            (answer_to(NONE, "sound", 0.0, 0.1), "right"),
        ],
        ids=lambda x: x if isinstance(x, str) else f"{x.truth.name} {x}",
    )
    def test_an_answer_is_right_wrong_or_silent(self, answer: LoadsAnswer, outcome: str) -> None:
        assert answer.outcome == outcome

    def test_a_bound_beside_a_clean_sinusoid_contradicts_itself(self) -> None:
        assert answer_to(NONE, "at_least", 1.0, sinusoidal=True).contradicts
        assert not answer_to(NONE, "oscillation", 1.0, sinusoidal=True).contradicts

    def test_an_answer_that_is_not_right_with_more_rows_is_lost(self) -> None:
        right, silent = answer_to(GAP, "backlash", 1.5, 2.5), answer_to(GAP, "cannot_tell")
        wrong = answer_to(GAP, "backlash", 3.0, 4.0)
        assert list(lengths.lost([silent, right, right, silent, wrong, right])) == [(right, silent)]
        assert list(lengths.lost([right, wrong])) == [(right, wrong)]

    def test_answers_of_two_runs_are_compared_by_record(self) -> None:
        table = against(
            [answer_to(GAP, "backlash", 1.5, 2.5), answer_to(NONE, "at_least", 1.0)], [answer_to(GAP, "cannot_tell")]
        )
        assert "walk, gap: right 1 -> 0, wrong 0 -> 0; lost 1, gained 0 of 1" in table
        assert "right -> silent: backlash 1.5 (1.5 to 2.5) -> cannot_tell" in table
        assert "no gap" not in table

    def test_the_tables_count_right_wrong_and_silent_answers(self) -> None:
        short = replace(GAP, samples=1000)
        of = [
            answer_to(short, "backlash", 1.5, 2.5),
            answer_to(GAP, "cannot_tell", -1.0),
            answer_to(NONE, "at_least", 1.0),
        ]
        head, _, *body = lengths.table(of, lengths.by_rows).splitlines()
        lines = [dict(zip(head.split(" | "), line.split(" | "), strict=True)) for line in body]
        assert [line["| length"] for line in lines] == ["| 1000", "| 1500"]
        assert [line["claims hold"] for line in lines] == ["1 of 1", "0 of 0"]
        assert [line["claimed"] for line in lines] == ["0", "1"]
        assert [line["limits below 0"] for line in lines] == ["0", "1"]
        assert [line["silent"] for line in lines] == ["0", "1"]

    def test_worse_beyond_chance(self) -> None:
        names = [replace(GAP, name=f"walk/gap/{number}") for number in range(6)]
        short = [answer_to(replace(truth, samples=1000), "backlash", 1.5, 2.5) for truth in names]
        long = [answer_to(truth, "backlash", 3.0, 4.0) for truth in names[:5]] + [answer_to(names[5], "at_least", 1.0)]
        last = lengths.longer(short + long, lengths.by_rows).splitlines()[-1]
        assert last == "| 1000 | 1500 | 6 | 6 | 1 | 0 | 5 | 0 | 5 | 0.031 |"
