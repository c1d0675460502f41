"""The fleet: layouts of a lake, everything that can be wrong with one, runs that are stopped, and the answers."""

from __future__ import annotations

import csv
import errno
import html
import importlib
import io
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from rich.console import Console

import glapp
from glapp import _glapp, fleet
from glapp.cli import app
from glapp.errors import InputError
from glapp.fleet import lake as lake_of
from glapp.fleet import local
from glapp.fleet import plan as plan_module
from glapp.fleet import run as run_module
from glapp.fleet.history import CROSSINGS, follow
from glapp.fleet.lake import DAY, SIGNALS, files_of
from glapp.fleet.pieces import follow_paths, read_again, unit_rows
from glapp.fleet.plan import Plan, plan_of
from glapp.fleet.problems import LEFT_OUT, LOST, DataIssue
from glapp.fleet.report import _in_short, _span
from glapp.fleet.results import TABLES, publish, write_piece
from glapp.fleet.settings import read_loops
from glapp.fleet.windows import LOOPS, choose, cut, judge, look
from glapp.loop import Loop
from glapp.report import words
from glapp.simulate import closed_loop

FIRST = int(datetime(2026, 3, 2, tzinfo=UTC).timestamp()) * 1_000_000
N = 1500


def signals(days: int = 1, d: float = 2.0) -> dict[str, Any]:
    """A worn valve's loop, recorded at 5 s for two hours a day."""
    made: dict[str, list[Any]] = {"time": [], "SP": [], "PV": [], "OP": []}
    for day in range(days):
        moves = {
            "setpoint": [(0, 50.0), (700, 53.0), (1900, 48.0), (2600, 52.0), (4100, 48.0), (4900, 51.0), (6300, 47.0)]
        }
        moves["load"] = [(1300, 2.0), (3400, -1.5), (5500, 1.0)]
        plant = ([1.0], [60.0 * 30, 90.0, 1.0], 10.0)
        s = closed_loop(plant, (1.0, 60.0), d=d, noise=0.05, h=1.0, t_end=5 * N - 1, seed=day, **moves)
        k = np.arange(0, 5 * N, 5)
        made["time"].append(FIRST + day * DAY + k * 1_000_000)
        for name, x in (("SP", s.sp), ("PV", s.pv), ("OP", s.op)):
            made[name].append(np.round(x[k], 3))
    return {name: np.concatenate(parts) for name, parts in made.items()}


def wide(x: dict[str, Any], **more: Any) -> pa.Table:
    time = pa.array(x["time"]).cast(pa.timestamp("us", tz="UTC"))
    return pa.table({"time": time, "SP": x["SP"], "PV": x["PV"], "OP": x["OP"], **more})


def long(x: dict[str, Any], loop: str = "FIC1") -> pa.Table:
    n = len(x["time"])
    return pa.table(
        {
            "tag": np.repeat([f"{loop}.{name}" for name in ("PV", "OP", "SP")], n),
            "time": pa.array(np.tile(x["time"], 3)).cast(pa.timestamp("us", tz="UTC")),
            "value": np.concatenate([x["PV"], x["OP"], x["SP"]]),
            "quality": ["Good"] * 3 * n,
        }
    )


def put(lake: Path, name: str, table: pa.Table, **how: Any) -> Path:
    path = lake / name
    path.parent.mkdir(parents=True, exist_ok=True)
    pq.write_table(table, path, **how)
    return path


def damage(path: Path, group: int) -> None:
    """Spoil PV in a group of rows of a wide file that was compressed by zstd without a dictionary."""
    chunk = pq.read_metadata(path).row_group(group).column(2)
    with path.open("r+b") as file:
        file.seek(chunk.data_page_offset + chunk.total_compressed_size // 2)
        file.write(b"\x00" * 64)


def planned(lake: Path, loops: str | None = None, zone: str | None = None) -> Plan:
    settings = None
    if loops is not None:
        settings = lake / "loops.toml"
        settings.write_text(loops)
    out = lake.with_name(f"{lake.name}-out")
    return plan_of(lake, files_of(lake)[0], out, settings, zone, 8, lambda name, total, done: None, 1)


def rows(plan: Plan) -> tuple[dict[tuple[str, int], list[Any]], list[DataIssue]]:
    """All rows of all loops, sorted, and the data issues."""
    found: dict[tuple[str, int], list[Any]] = {}
    problems = list(plan.problems)
    for unit in plan.units:
        tables, wrong = unit_rows(plan, unit)
        problems += wrong
        for k, table in tables.items():
            name = plan.places.loops[k].name
            found[name, unit.day] = sorted(zip(*(table.column(c).to_pylist() for c in table.column_names), strict=True))
    return found, problems


def codes(problems: list[DataIssue]) -> set[str]:
    return {problem.code for problem in problems}


@pytest.mark.slow
def test_every_layout_gives_the_same_rows(tmp_path: Path) -> None:
    x = signals(days=2)
    whole = long(x)
    put(tmp_path / "a", "all.parquet", whole.take(np.random.default_rng(1).permutation(len(whole))), row_group_size=700)
    for tag in ("PV", "OP", "SP"):
        of = whole.filter(pa.compute.equal(whole["tag"], f"FIC1.{tag}")).drop_columns(["tag"])
        put(tmp_path / "b", f"tag=FIC1.{tag}/x.parquet", of)
    put(tmp_path / "c", "loop=FIC1/x.parquet", wide(x), row_group_size=400)
    put(tmp_path / "d", "x.parquet", wide(x).rename_columns(["time", "FIC1.SP", "FIC1.PV", "FIC1.OP"]))
    found = [rows(planned(tmp_path / name)) for name in "abcd"]
    days = (FIRST // DAY, FIRST // DAY + 1)
    assert list(found[0][0]) == [("FIC1", day) for day in days]
    assert all(len(found[0][0]["FIC1", day]) == 3 * N for day in days)
    assert all(one[0] == found[0][0] for one in found[1:])
    assert [one[1] for one in found] == [[], [], [], []]


def test_cells_mean_what_they_mean_in_any_file(tmp_path: Path) -> None:
    x = {name: values[:4] for name, values in signals().items()}
    texts = ["1.234,5", "-9999", "No Data", "0,25"]
    put(tmp_path, "loop=FIC1/x.parquet", wide(x | {"PV": pa.array(texts)}, MODE=["AUTO", "Hand", "AUTO", "7"]))
    put(tmp_path, "loop=FIC2/x.parquet", wide(x | {"PV": np.array([1234.5, -9999.0, np.nan, 0.25])}))
    settings = 'bad_values = [-9999, "No Data"]\n'
    plan = planned(tmp_path, "".join(f"[loops.FIC{i}]\n{settings}" for i in (1, 2)))
    found, problems = rows(plan)
    for loop in ("FIC1", "FIC2"):
        pv = [value for signal, _, value, _ in found[loop, FIRST // DAY] if signal == 0]
        assert np.array_equal(pv, [1234.5, np.nan, np.nan, 0.25], equal_nan=True), loop
    mode = [value for signal, _, value, _ in found["FIC1", FIRST // DAY] if signal == SIGNALS.index("mode")]
    assert mode == [1, 0, 1, 0]  # 7 is no mode known here: not automatic, and told
    assert [(p.code, p.tag, p.row, p.rows) for p in problems] == [("value", "MODE", 4, 1)]


@pytest.mark.slow
def test_a_giant_group_of_rows_is_read_in_parts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    put(tmp_path / "a", "all.parquet", long(signals(days=2)))
    put(tmp_path / "b", "loop=FIC1/all.parquet", wide(signals(days=2)))
    once = [rows(planned(tmp_path / name)) for name in "ab"]
    monkeypatch.setattr(lake_of, "BATCH", 700)
    monkeypatch.setattr(plan_module, "AT_ONCE", 1500)
    sizes: list[int] = []
    batches = lake_of._batches

    def counted(*how: Any) -> Any:
        """Batches as they are, with their sizes noted."""
        for batch in batches(*how):
            sizes.append(len(batch))
            yield batch

    monkeypatch.setattr(lake_of, "_batches", counted)
    for name, (whole, _) in zip("ab", once, strict=True):
        shutil.rmtree(tmp_path / f"{name}-out")  # what was seen at the first look
        plan = planned(tmp_path / name)
        [file] = plan.files
        assert {group.of for group in file.groups} == {0} and max(group.rows for group in file.groups) == 700
        assert len(plan.units) >= 8 and {unit.day for unit in plan.units} == {FIRST // DAY, FIRST // DAY + 1}
        of_day: dict[Any, list[Any]] = {}
        for unit in plan.units:
            for table in unit_rows(plan, unit)[0].values():
                assert len(table) <= 2 * plan_module.AT_ONCE
                of = zip(*(table.column(c).to_pylist() for c in table.column_names), strict=True)
                of_day.setdefault(("FIC1", unit.day), []).extend(of)
        assert {key: sorted(of) for key, of in of_day.items()} == whole
    assert max(sizes) == 700


@pytest.mark.slow
def test_of_a_delta_table_only_what_its_log_names_is_read(tmp_path: Path) -> None:
    deltalake = pytest.importorskip("deltalake", reason="deltalake is not installed: pip install 'glapp[delta]'")
    x = signals()
    first, second = ({name: values[part] for name, values in x.items()} for part in (slice(0, 700), slice(700, 1400)))
    table = tmp_path / "lake" / "mill"
    deltalake.write_deltalake(table, long(first))
    deltalake.write_deltalake(table, long(second), mode="append")
    deltalake.DeltaTable(table).delete(f"tag = 'FIC1.OP' and time >= {first['time'][0]}")
    put(tmp_path / "lake", "others/FIC2.parquet", wide(first))
    assert len(list(table.glob("*.parquet"))) > 2
    found, problems = rows(planned(tmp_path / "lake"))
    assert problems == [] and {name for name, _ in found} == {"FIC1", "FIC2"}
    assert sorted({signal for signal, *_ in found["FIC1", FIRST // DAY]}) == [0, 1]
    assert len(found["FIC1", FIRST // DAY]) == 2 * 1400
    (next((table / "_delta_log").glob("*0.json"))).write_text("{")
    _, problems = rows(replace(planned(tmp_path / "lake"), problems=tuple(files_of(tmp_path / "lake")[1])))
    assert [(p.code, p.file) for p in problems] == [("unreadable", "mill/_delta_log")]


def test_without_its_library_all_files_of_a_delta_table_are_read_and_that_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    put(tmp_path, "mill/a.parquet", long(signals()))
    (tmp_path / "mill" / "_delta_log").mkdir()
    monkeypatch.setitem(sys.modules, "deltalake", None)
    names, [problem] = files_of(tmp_path)
    assert names == ["mill/a.parquet"] and (problem.code, problem.file) == ("delta", "mill/_delta_log")


def test_three_vendors_of_quality_are_told_apart_and_an_unknown_word_is_bad(tmp_path: Path) -> None:
    x = {name: values[:6] for name, values in signals().items()}
    vendors = {
        "words": ["Good", "Bad", "Uncertain", "Questionable", "Good, annotated", "Good"],
        "da": np.array([192, 24, 64, 0, 216, 192], np.int32),
        "ua": np.array([0, 0x80000000, 0x40000000, 0x80AB0000, 0x00960000, 0], np.int64),
        "own": ["Good", "Wobbly", "Bad", "Wobbly", "Good", "Good"],
    }
    for name, quality in vendors.items():
        put(tmp_path, f"loop={name}/x.parquet", wide(x, quality=quality))
    found, problems = rows(planned(tmp_path))
    for name in vendors:
        bad = [wrong for signal, _, _, wrong in found[name, FIRST // DAY] if signal == 0]
        assert bad == [False, True, True, True, False, False], name
    [problem] = problems
    assert problem.code == "quality" and "wobbly" in problem.what and problem.file == "loop=own/x.parquet"


def test_the_hour_in_which_clocks_change_is_left_out_and_told(tmp_path: Path) -> None:
    local = pa.array(np.arange("2025-10-26T01:00", "2025-10-26T05:00", 600, dtype="datetime64[s]"))
    n = len(local)
    table = pa.table({"time": local, "SP": np.ones(n), "PV": np.arange(float(n)), "OP": np.ones(n)})
    put(tmp_path / "a", "FIC1.parquet", table)
    found, problems = rows(planned(tmp_path / "a", zone="Europe/Stockholm"))
    times = {t for day in found.values() for _, t, _, _ in day}
    assert len(times) == n - 6  # 02:00 to 02:50 come twice
    assert codes(problems) == {"clock_change"} and problems[0].rows == 6
    assert min(times) == int(datetime(2025, 10, 25, 23, tzinfo=UTC).timestamp()) * 1_000_000
    _, problems = rows(planned(tmp_path / "a"))
    assert codes(problems) == {"no_zone"}


def test_a_damaged_group_of_rows_costs_its_rows_and_no_others(tmp_path: Path) -> None:
    path = put(tmp_path, "FIC1.parquet", wide(signals()), row_group_size=500, use_dictionary=False, compression="zstd")
    damage(path, 1)
    found, [problem] = rows(planned(tmp_path))
    assert len(found["FIC1", FIRST // DAY]) == 3 * (N - 500)
    assert (problem.code, problem.file, problem.row, problem.rows) == ("damaged", "FIC1.parquet", 501, 500)


def test_what_cannot_be_used_is_told_with_its_place(tmp_path: Path) -> None:
    x = {name: values[:50] for name, values in signals().items()}
    put(tmp_path, "day=1/a.parquet", long(x))
    put(tmp_path, "day=1/notes.parquet", pa.table({"shift": ["A"], "note": ["-"]}))
    put(tmp_path, "day=1/counters.parquet", pa.table({"tag": ["F.PV"], "time": [1.0], "value": [2.0]}))
    (tmp_path / "day=1" / "cut.parquet").write_bytes((tmp_path / "day=1" / "a.parquet").read_bytes()[:500])
    other = long(x, "FIC2").set_column(2, "value", pa.array(["1.5"] * 149 + ["Tag not found"]))
    put(tmp_path, "day=2/text.parquet", other.append_column("uom", pa.array(["bar"] * 50 + ["%"] * 50 + ["psi"] * 50)))
    put(tmp_path, "day=2/new.parquet", long(x, "FIC3"))
    (tmp_path / "_secret").mkdir()
    (tmp_path / "_secret" / "x.parquet").write_bytes(b"not looked at")
    span = 'pv_unit = "bar"\npv_span = [0, 100]\n'
    settings = "".join(f"[loops.FIC{i}]\n{span}" for i in (1, 2, "-3")) + "[loops.FIC5]\npv_span = [1, 0]\n"
    settings += '[loops.FIC6.columns]\npv = "FIC1.PW"\n'
    found, problems = rows(planned(tmp_path, settings))
    issues = {(p.code, p.file or p.loop): p for p in problems}
    assert set(issues) == {
        ("schema", "day=1/notes.parquet"),
        ("time", "day=1/counters.parquet"),
        ("unreadable", "day=1/cut.parquet"),
        ("unit", "day=2/text.parquet"),
        ("no_settings", "FIC3"),
        ("no_tags", "FIC-3"),
        ("loop_tags", "FIC6"),
        ("settings", "loops.toml"),
    }
    assert issues["no_tags", "FIC-3"].what.endswith("none of its tags; those of FIC3 are, which no settings name")
    assert "did you mean 'FIC1." in issues["loop_tags", "FIC6"].what
    assert issues["unit", "day=2/text.parquet"].tag == "FIC2.SP" and issues["unit", "day=2/text.parquet"].rows == 50
    assert {name for name, _ in found} == {"FIC1", "FIC2"} and {s for s, *_ in found["FIC2", FIRST // DAY]} == {0, 2}


def table_of(x: dict[str, Any], order: Any = slice(None)) -> pa.Table:
    """Rows as `look` takes them."""
    n = len(x["time"])
    columns = [np.repeat([SIGNALS.index(s) for s in ("pv", "op", "sp")], n).astype(np.int8), np.tile(x["time"], 3)]
    columns += [np.concatenate([x["PV"], x["OP"], x["SP"]]), np.zeros(3 * n, np.bool_)]
    return pa.table([column[order] for column in columns], names=["signal", "t", "value", "bad"])


NOTHING = CROSSINGS.empty_table()


def test_the_order_of_rows_and_rows_that_come_twice_change_nothing() -> None:
    x, loop = signals(), Loop(name="FIC1", pv_span=(0, 100), op_span=(0, 100))
    once = look(table_of(x), loop, FIRST // DAY)
    twice = np.random.default_rng(2).permutation(np.r_[0 : 3 * N, 0:400])
    shuffled = look(table_of(x, twice), loop, FIRST // DAY)
    assert shuffled["doubled"].to_pylist() == [400]
    assert shuffled.drop_columns(["doubled"]) == once.drop_columns(["doubled"])
    assert len(once["window_first"][0]) >= 1


def test_rows_that_contradict_each_other_are_bad_and_another_unit_is_seen() -> None:
    x, loop = signals(), Loop(name="FIC1", pv_span=(0, 100), op_span=(0, 100))
    more = table_of({name: values[:300] for name, values in x.items()} | {"PV": np.full(300, 1.0)})
    mixed = look(pa.concat_tables([table_of(x), more]), loop, FIRST // DAY)
    assert mixed["contradicting"].to_pylist() == [300] and mixed["doubled"].to_pylist() == [600]
    assert mixed["usable"][0].as_py() == pytest.approx(1 - 300 / N)
    psi = look(table_of(x | {"PV": 14.5 * x["PV"]}), loop, FIRST // DAY)
    assert psi["unfit_code"].to_pylist() == ["outside_span"] and psi["window_first"].to_pylist() == [[]]
    _, windows, problems = judge(cut(table_of(x), loop, []), psi, NOTHING, loop)
    assert windows.num_rows == 0 and codes(problems) == {"outside_span"}


def test_windows_are_chosen_from_the_whole_history_and_are_never_more_than_asked() -> None:
    first = [[1000 * day + 10 * i for i in range(4)] for day in range(30)]
    days = pa.table(
        {
            "window_first": first,
            "window_last": [[t + 9 for t in of] for of in first],
            "window_score": [[float(t * 7919 % 101) for t in of] for of in first],
        }
    )
    chosen = choose(days, 6)
    assert len(chosen) == 6 and chosen == sorted(chosen)
    assert [t // 5000 for t, _ in chosen] == [0, 1, 2, 3, 4, 5]  # a window of every five days
    assert choose(days.slice(0, 1), 6) == [(0, 9), (10, 19), (20, 29), (30, 39)]
    assert choose(days.take(pa.array([5, 3, 9])), 8) == choose(days.take(pa.array([9, 5, 3])), 8)


def followed(plan: Plan) -> list[dict[str, Any]]:
    """The crossings of one loop over all units, by the functions alone."""
    state, made = None, []
    for unit in plan.units:
        for k, table in unit_rows(plan, unit)[0].items():
            loop = plan.places.loops[k]
            row = follow(table, look(table, loop, unit.day, unit.part), loop, state)
            state = row["state"][0].as_py()
            made += row.to_pylist()
    return made


GIVEN = """[loops.FIC1]
pv_span = [0, 100]
op_span = [0, 100]
[loops.FIC1.controller]
k = 1.0
ti = 60.0
"""


@pytest.mark.slow
def test_crossings_over_days_parts_and_one_pass_have_the_same_bits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    x, k = signals(days=3), np.arange(3 * N)
    wave = np.where(k // 83 % 2 == 0, 1.0, -1.0)  # half-periods of 415 s, one of them over each midnight
    noise = np.random.default_rng(1).uniform(-0.1, 0.1, 3 * N)
    x |= {"SP": np.full(3 * N, 50.0), "PV": 50.0 + wave + noise, "OP": np.round(40.0 - wave * (k % 83) / 30, 1)}
    keep = np.r_[True, np.diff(x["OP"]) != 0] | (np.arange(3 * N) % 400 == 0)  # kept when it changes, and now and then
    table = long(x)
    held = pa.compute.or_(pa.compute.not_equal(table["tag"], "FIC1.OP"), pa.array(np.tile(keep, 3)))
    put(tmp_path / "lake", "x.parquet", table.filter(held))
    days = followed(planned(tmp_path / "lake", GIVEN))
    monkeypatch.setattr(plan_module, "AT_ONCE", 900)
    monkeypatch.setattr(lake_of, "BATCH", 500)
    (tmp_path / "other").mkdir()
    shutil.copy(tmp_path / "lake" / "x.parquet", tmp_path / "other")
    parts = followed(planned(tmp_path / "other", GIVEN))
    assert len(days) == 3 and len(parts) > 9
    pinned = json.loads(days[0]["state"])["pinned"]["told"]
    once = _glapp.History(
        {n: pinned[n] for n in ("k", "ti", "td", "b", "kp", "n", "h")} | {"op_limits": (0, 100)}, False
    )
    once.take((x["time"] - x["time"][0]) * 1e-6, x["SP"], x["PV"], x["OP"], None)
    for pieces in (days, parts):
        assert json.loads(pieces[-1]["state"])["pinned"]["history"] == once.save()
    heard, last = once.heard(), days[-1]
    assert {name: last[name] for name in ("crossings", "d_hat", "detections", "tf")} == {
        name: heard[name] for name in ("crossings", "d_hat", "detections", "tf")
    }
    assert last["crossings"] == "estimate" and last["detections"] > days[0]["detections"] > 0
    assert last["since"] == datetime.fromtimestamp(FIRST / 1e6, UTC)
    again = {name: parts[-1][name] for name in CROSSINGS.names if name not in ("part",)}
    assert again == {name: last[name] for name in again}


def test_a_changed_file_touches_its_day_and_the_crossings_from_there_on(tmp_path: Path) -> None:
    x = signals(days=3)
    for day in range(3):
        part = {name: values[day * N : (day + 1) * N] for name, values in x.items()}
        for loop in ("FIC1", "FIC2"):
            put(tmp_path / "lake", f"loop={loop}/day={day}/x.parquet", wide(part))

    def pieces_of() -> tuple[list[str], list[str]]:
        plan = planned(tmp_path / "lake")
        return [unit.key for unit in plan.units], [path.name for path in follow_paths(plan, tmp_path)]

    before = pieces_of()
    path = tmp_path / "lake" / "loop=FIC2/day=1/x.parquet"
    os.utime(path, ns=(0, path.stat().st_mtime_ns + 1))
    after = pieces_of()
    same = [[a == b for a, b in zip(*both, strict=True)] for both in zip(before, after, strict=True)]
    assert same == [[True, False, True], [True, False, False]]


def test_settings_are_pinned_until_a_day_shows_others() -> None:
    x, loop = signals(days=4), Loop(name="FIC1", pv_span=(0, 100), op_span=(0, 100))
    state, rows_told = None, []
    for day in range(4):
        table = table_of({name: values[day * N : (day + 1) * N] for name, values in x.items()})
        of = look(table, loop, FIRST // DAY + day)
        settings = json.loads(of["detector"][0].as_py())
        if day == 1:
            settings |= {"k": 1.1 * settings["k"]}  # as another day reads the same law
        if day == 2:
            of = of.set_column(of.column_names.index("unfit_code"), "unfit_code", pa.array(["outside_span"]))
        if day == 3:
            settings |= {"k": 2 * settings["k"]}
        of = of.set_column(of.column_names.index("detector"), "detector", pa.array([json.dumps(settings)]))
        row = follow(table, of, loop, state)
        state = row["state"][0].as_py()
        rows_told += row.to_pylist()
    first, second, third, fourth = rows_told
    assert [row["followed"] for row in rows_told] == [True, True, False, True]
    assert first["k"] == second["k"] == third["k"] and json.loads(first["origins"])["k"] == "identified"
    assert second["half_periods"] > first["half_periods"] and third["half_periods"] == second["half_periods"]
    assert fourth["k"] > 1.5 * first["k"] and fourth["since"] == datetime.fromtimestamp((FIRST + 3 * DAY) / 1e6, UTC)
    assert fourth["half_periods"] < second["half_periods"]


@pytest.mark.verify
def test_a_worn_valve_is_found_in_its_windows_with_what_it_does_to_the_loop() -> None:
    x, loop = signals(days=3), Loop(name="FIC1", pv_span=(0, 100), op_span=(0, 100), area="Boiler")
    by_day = [{name: values[i * N : (i + 1) * N] for name, values in x.items()} for i in range(3)]
    days = pa.concat_tables([look(table_of(one), loop, FIRST // DAY + i) for i, one in enumerate(by_day)])
    parts = [
        cut(table_of(one), loop, [w for w in choose(days) if w[0] // DAY == FIRST // DAY + i])
        for i, one in enumerate(by_day)
    ]
    row, windows, problems = judge(pa.concat_tables(parts[::-1]), days, NOTHING, loop)
    [answer] = row.to_pylist()
    assert windows.num_rows == answer["windows"] == 3 and problems == []
    assert answer["verdict"] == "backlash" and answer["low"] < 2.0 < answer["high"]
    assert answer["area"] == "Boiler" and answer["acceptable"] == "beyond"
    assert 0.0 < answer["op_share"] <= 1.0 and 0.0 <= answer["pv_share"] <= 1.0
    assert answer["score"] == pytest.approx(answer["low"] / 1.0 * max(answer["op_share"], answer["pv_share"]))
    same, others, _ = judge(pa.concat_tables(parts), days.take(pa.array([2, 0, 1])), NOTHING, loop)
    assert same == row and others == windows


@pytest.mark.slow
def test_a_day_that_is_replayed_under_another_date_counts_once() -> None:
    x, loop = signals(), Loop(name="FIC1", pv_span=(0, 100), op_span=(0, 100))
    part = {name: values[:700] for name, values in x.items()}
    both = [part, part | {"time": part["time"] + DAY}]
    days = pa.concat_tables([look(table_of(one), loop, FIRST // DAY + i) for i, one in enumerate(both)])
    samples = [cut(table_of(one), loop, choose(days)) for one in both]
    _, windows, problems = judge(pa.concat_tables(samples), days, NOTHING, loop)
    assert codes(problems) == {"replayed"} and problems[0].day == "2026-03-03"
    assert [share > 0.5 for share in windows["repeated"].to_pylist()] == [False, True]


def test_a_full_disk_is_told_and_leaves_nothing_half_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    table = pa.table({"x": [1.0]})
    path = tmp_path / "days" / "x.parquet"
    write_piece(path, [table], table.schema)
    whole = path.read_bytes()

    def full(handle: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(InputError, match="No space left on device; make room"):
        write_piece(path, [pa.table({"x": [2.0]})], table.schema)
    assert path.read_bytes() == whole and list(path.parent.iterdir()) == [path]


def test_settings_from_a_table(tmp_path: Path) -> None:
    path = tmp_path / "loops.csv"
    path.write_text(
        "loop,area,pv_span.low,pv_span.high,op_span.low,op_span.high,controller.k,controller.ti,positioner.type,columns.pv\n"
        "FIC1,Boiler,0,100,0,100,1.5,30,digital,F1.X\nFIC2,,,,,,,,,\nFIC3,,0,,,,,,,\nFIC4,,,,,,1,-3,,\nFIC2,,,,,,,,,\n"
    )
    loops, problems = read_loops(path)
    [loop] = loops
    assert loop.pv_span == (0.0, 100.0) and loop.controller is not None and loop.controller.ti == 30.0
    assert loop.positioner is not None and loop.positioner.type == "digital" and loop.columns.pv == "F1.X"
    assert sorted((p.loop, p.row) for p in problems if p.row) == [("FIC3", 4), ("FIC4", 5)]
    assert [p.loop for p in problems if not p.row] == ["FIC2"]
    path.write_text("loop,repaired\nFIC1,2026-03-01 12:00\nFIC2,\n")
    loops, problems = read_loops(path)
    assert [loop.repaired for loop in loops] == [None, None], "a fleet follows days, and cuts none"
    assert [(p.loop, p.code) for p in problems] == [("FIC1", "settings")]


def test_settings_are_read_as_a_spreadsheet_saves_them(tmp_path: Path) -> None:
    """Regression: semicolons, decimal commas and a valve called 12 were refused."""
    path = tmp_path / "loops.csv"
    text = "loop;valve;pv_span.low;pv_span.high;controller.k;controller.ti;controller.ti_unit;area\r\n"
    text += "101;12;0;50,5;0,865;4,5;min;Södra\r\n;;;;;;;\r\n102;13;;;;;;x, y\r\n103;;;;-0,1;1;;\r\n"
    for encoding in ("utf-8-sig", "cp1252", "utf-16"):
        path.write_bytes(text.encode(encoding))
        loops, [problem] = read_loops(path)
        assert [(loop.name, loop.valve, loop.area) for loop in loops] == [("101", "12", "Södra"), ("102", "13", "x, y")]
        assert loops[0].pv_span == (0.0, 50.5) and loops[0].controller is not None and loops[0].controller.k == 0.865
        assert loops[0].ideal().ti == 270.0
        assert (problem.row, problem.loop, problem.what) == (5, "103", "controller.k: is '-0.1', must be > 0")


@pytest.mark.parametrize(
    ("text", "said"),
    {
        "name,area\nFIC1,Boiler\n": "row 1: has no column 'loop' for the names of the loops; its columns are name",
        "loop,area\nFIC1,Boiler, west\n": "row 2: has 3 cells, and the first row has 2; put texts",
        "loop,area,area\nFIC1,a,b\n": "row 1, column area: is there twice; leave one",
        "loop,area\n,a\n": "row 2: loop: is empty; a row has the name",
        "loop,controller,controller.k\nFIC1,x,2\n": "row 2: controller: is there, and controller.k too; leave one",
        "loop,controler.k\nFIC1,2\n": "controler: no such key; did you mean controller?",
        "": "has no column 'loop'",
    }.items(),
)
def test_settings_that_cannot_be_used_are_told_with_their_place(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "loops.csv"
    path.write_text(text)
    with pytest.raises(InputError) as error:
        read_loops(path)
    assert str(path) in str(error.value) and said in str(error.value)


def test_a_gap_that_is_acceptable_is_not_among_those_to_repair(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Regression: the command listed under *To repair first* what the report does not."""
    row = dict.fromkeys(LOOPS.names)
    row |= {"valve": "gap", "confidence": "found", "verdict": "backlash", "score": 0.4, "width_percent": 0.5}
    row |= {"low_percent": 0.4, "high_percent": 0.8}
    loops = [{**row, "loop": name, "acceptable": name} for name in ("within", "beyond", "open")]
    made = {
        "lost": dict.fromkeys(("loops", "files", "rows", "left_out", "not_understood"), 0),
        "seconds": 1.0,
        "folder": "tables",
    }
    made["tables"] = {"problems": {"rows": 0}}
    monkeypatch.setattr(fleet, "analyze", lambda *_, **__: made)
    monkeypatch.setattr(fleet, "read", lambda *_: pa.Table.from_pylist(loops, schema=LOOPS))
    with pytest.raises(SystemExit) as end:
        app(["fleet", "analyze", str(tmp_path), "--out", str(tmp_path / "out")])
    assert end.value.code == 0
    printed = capsys.readouterr().out
    assert "beyond" in printed and "open" in printed and "within" not in printed
    assert "3 with a gap (1 wider than the limit)" in " ".join(printed.split())


def test_who_stops_a_run_is_told_that_it_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def stopped(*_: Any, **__: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(fleet, "analyze", stopped)
    with pytest.raises(SystemExit) as end:
        app(["fleet", "analyze", str(tmp_path), "--out", str(tmp_path / "out")])
    assert end.value.code == 130 and "the same command goes on where it was" in capsys.readouterr().err


def test_what_is_no_lake_and_what_are_no_results(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="nowhere: is not there; name the folder"):
        fleet.analyze(tmp_path / "nowhere", tmp_path / "out")
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="file: is no folder; name the folder"):
        fleet.analyze(tmp_path / "file", tmp_path / "out")
    (tmp_path / "exports").mkdir()
    for day in (1, 2):
        (tmp_path / "exports" / f"{day}.csv").write_text("t,SP,PV\n")
    with pytest.raises(
        InputError, match=r"no .parquet file, and 2 files with the ending .csv, which is not .* analyze"
    ):
        fleet.analyze(tmp_path / "exports", tmp_path / "out")
    put(tmp_path / "lake", "notes.parquet", pa.table({"note": ["-"]}))
    with pytest.raises(InputError, match="is within the lake"):
        fleet.analyze(tmp_path / "lake", tmp_path / "lake" / "out")
    with pytest.raises(InputError, match="no Parquet file that can be read"):
        fleet.analyze(tmp_path / "lake", tmp_path / "out")
    # Regression: the command said that standard output cannot be written.
    with pytest.raises(InputError, match=r"file/work: cannot be written: .*; name a folder that this account"):
        fleet.analyze(tmp_path / "lake", tmp_path / "file")
    with pytest.raises(InputError, match="fits: is 0, must be 1 to 64"):
        fleet.analyze(tmp_path / "lake", tmp_path / "out", fits=0)
    with pytest.raises(InputError, match="time_zone"):
        fleet.analyze(tmp_path / "lake", tmp_path / "out", time_zone="Nowhere/City")
    with pytest.raises(InputError, match="holds no results"):
        fleet.read(tmp_path / "out")
    with pytest.raises(InputError, match="one of loops, windows"):
        fleet.read(tmp_path / "out", "answers")


def test_a_run_that_cannot_go_on_names_what_it_could_not_read_or_write(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Regression: whatever was wrong, a file of the lake that is gone too, the message was to make room."""
    lake, out = tmp_path / "lake", tmp_path / "out"
    gone = put(lake, "FIC1.parquet", wide(signals()))
    for code, place, said in (
        (errno.ENOENT, gone, f"{gone}: cannot be read any more: No such file or directory; run it again"),
        (errno.EACCES, out / "x", f"{out}: cannot be written: Permission denied; give this account the right"),
        (errno.ENOSPC, None, f"{out}: cannot be written: No space left on device; make room"),
    ):

        def fail(*_: Any, code: int = code, place: Path | None = place) -> None:
            raise OSError(code, os.strerror(code), None if place is None else str(place))

        monkeypatch.setattr("glapp.fleet.run.plan_of", fail)
        with pytest.raises(InputError) as error:
            fleet.analyze(lake, out)
        assert said in str(error.value)


def test_tables_are_read_from_memory_of_arrows_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Regression: a thread of Arrow let go of Python's bytes as Python ended, and `glapp fleet` ended with code 134."""
    table = pa.table({name: list(range(5)) for name in LOOPS.names})
    publish(tmp_path, {name: table for name in TABLES}, {"provenance": {}})
    before, held = pa.total_allocated_bytes(), []
    read_table = pq.read_table

    def looked(source: pa.BufferReader, **how: Any) -> pa.Table:
        held.append((source.size(), pa.total_allocated_bytes() - before))
        return read_table(source, **how)

    monkeypatch.setattr(pq, "read_table", looked)
    assert fleet.read(tmp_path).num_rows == 5
    [(size, allocated)] = held
    assert allocated >= size > 1000


def test_rows_folders_and_files_that_go_missing_are_counted(tmp_path: Path) -> None:
    x = {name: values[:60] for name, values in signals().items()}
    lake = tmp_path / "lake"
    whole = long(x)
    time = pa.array([None] * 5 + whole["time"].to_pylist()[5:], whole["time"].type)
    tags = pa.array(whole["tag"].to_pylist()[:-7] + [None] * 7)
    put(lake, "a.PARQUET", whole.set_column(1, "time", time).set_column(0, "tag", tags))
    put(tmp_path / "beside", "b.parquet", long(x, "FIC2"))
    (lake / "linked").symlink_to(tmp_path / "beside", target_is_directory=True)
    (lake / "nowhere.parquet").symlink_to(tmp_path / "gone.parquet")
    (lake / "old.csv").write_text("time,PV\n")
    names, wrong = files_of(lake)
    assert names == ["a.PARQUET"]
    issues = {(p.code, p.file) for p in wrong}
    assert issues == {("folder", "linked"), ("unreadable", "nowhere.parquet"), ("not_read", "old.csv")}
    _, problems = rows(planned(lake))
    assert {(p.code, p.rows) for p in problems} == {("no_time", 5), ("no_tag", 7)}
    if os.geteuid():  # for root no folder is closed
        (lake / "closed").mkdir(mode=0)
        assert ("folder", "closed") in {(p.code, p.file) for p in files_of(lake)[1]}


def test_one_folder_a_loop(tmp_path: Path) -> None:
    """Regression: files called by their day were one loop of all folders together, whose rows contradict each other."""
    x = {name: values[:60] for name, values in signals().items()}
    for folder in ("FIC1", "area/fic2/2026/03"):
        put(tmp_path, f"{folder}/2026-03-01.parquet", wide(x))
        put(tmp_path, f"{folder}/part-00000-3f1c-c000.snappy.parquet", wide(x))
    put(tmp_path, "FIC3_2026-03-01_18.parquet", wide(x))  # the hour is no part of its name
    table = wide(x)
    put(tmp_path, "FIC4/2026-03-01_pv.parquet", table.select(["time", "PV", "SP"]))
    put(tmp_path, "FIC4/2026-03-01_op.parquet", table.select(["time", "OP"]).rename_columns(["t", "OP"]))
    put(tmp_path, "FIC5/2026-03-01.parquet", table.select(["time", "OP", "SP"]))
    put(tmp_path, "FIC6/2026-03-01.parquet", table.select(["time", "OP"]))
    for settings in ("", "".join(f"[loops.FIC{i}]\n" for i in (1, 2, 3, 4, 5))):
        found, problems = rows(planned(tmp_path, settings or None))
        names = ["FIC1", "FIC2" if settings else "fic2", "FIC3", "FIC4"]
        assert sorted(found) == sorted((name, FIRST // DAY) for name in names)
        assert all({signal for signal, *_ in of} == {0, 1, 2} for of in found.values())
        assert {(p.code, p.loop, p.file) for p in problems} == {
            ("no_pv", "FIC5", "FIC5/2026-03-01.parquet"),
            ("schema", "", "FIC6/2026-03-01.parquet"),
        }


def test_tags_that_differ_in_case_are_one_signal(tmp_path: Path) -> None:
    """Regression: a day whose tags are written fic1.pv was a loop of its own, or of no settings."""
    x = {name: values[:60] for name, values in signals().items()}
    later = {**x, "time": x["time"] + DAY}
    table = long(later)
    lower = pa.array([tag.lower() for tag in table["tag"].to_pylist()])
    put(tmp_path, "a.parquet", long(x))
    names = ["ItemID", "SourceTimestamp", "Value", "ServerTimestamp"]
    table = table.set_column(0, "tag", lower).select(["tag", "time", "value"])
    put(tmp_path, "b.parquet", table.append_column("server", table["time"]).rename_columns(names))
    for settings in ("", "[loops.Fic1]\n"):
        found, problems = rows(planned(tmp_path, settings or None))
        name = "Fic1" if settings else "FIC1"
        assert sorted(found) == [(name, FIRST // DAY), (name, FIRST // DAY + 1)] and problems == []
        assert [len(of) for of in found.values()] == [180, 180]


def test_a_loop_without_sp_beside_others_that_have_it_is_told(tmp_path: Path) -> None:
    x = {name: values[:60] for name, values in signals().items()}
    others = [long(x, "FIC2").filter(pa.compute.not_equal(long(x, "FIC2")["tag"], "FIC2.SP")), long(x)]
    put(tmp_path / "a", "a.parquet", pa.concat_tables(others))
    names = ["FIC1.SP", "FIC1.PV", "FIC1.OP", "FIC2.PV", "FIC2.OP"]
    columns = [x["SP"], x["PV"], x["OP"], x["PV"], x["OP"]]
    put(tmp_path / "b", "b.parquet", pa.table([wide(x)["time"], *columns], ["time", *names]))
    for lake in "ab":
        found, problems = rows(planned(tmp_path / lake))
        assert {name for name, _ in found} == {"FIC1"}
        assert [(p.code, p.loop) for p in problems] == [("no_sp", "FIC2")]
        # Regression: who named it without its columns was told that none of its tags are there.
        found, problems = rows(planned(tmp_path / lake, "[loops.FIC1]\n[loops.FIC2]\n"))
        assert {name for name, _ in found} == {"FIC1", "FIC2"} and problems == []


def test_a_loop_without_pv_is_told_and_its_pv_may_have_another_name(tmp_path: Path) -> None:
    """Regression: SP and OP of a loop whose PV is not in the lake were passed over in silence."""
    x = {name: values[:60] for name, values in signals().items()}
    others = [long(x, "FIC2").filter(pa.compute.not_equal(long(x, "FIC2")["tag"], "FIC2.PV")), long(x)]
    put(tmp_path, "a.parquet", pa.concat_tables(others))
    found, problems = rows(planned(tmp_path))
    assert {name for name, _ in found} == {"FIC1"}
    assert [(p.code, p.loop, p.what) for p in problems] == [
        ("no_pv", "FIC2", "FIC2 has SP and OP and no PV: it cannot be judged")
    ]
    _, [problem] = rows(planned(tmp_path, "[loops.FIC1]\n[loops.FIC2]\n"))
    assert (problem.code, problem.loop) == ("loop_tags", "FIC2") and problem.what.startswith("no tag for PV")
    found, problems = rows(planned(tmp_path, '[loops.FIC1]\n[loops.FIC2]\ncolumns = { pv = "FIC1.PV" }\n'))
    assert {name for name, _ in found} == {"FIC1", "FIC2"} and problems == []


def test_words_beyond_number_are_counted_as_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lake_of, "_MOST_WORDS", 3)
    x = {name: values[:50] for name, values in signals().items()}
    put(tmp_path, "FIC1.parquet", wide(x).set_column(2, "PV", pa.array([f"word {i}" for i in range(50)])))
    found, problems = rows(planned(tmp_path))
    assert [p.rows for p in problems if p.code == "value"] == [1, 1, 1, 50]
    assert all(np.isnan(value) for signal, _, value, _ in found["FIC1", FIRST // DAY] if signal == 0)


def test_a_fault_over_a_loop_refuses_it_and_says_nothing_of_its_valve(monkeypatch: pytest.MonkeyPatch) -> None:
    x, loop = signals(), Loop(name="FIC1", pv_span=(0, 100), op_span=(0, 100))
    day = look(table_of(x), loop, FIRST // DAY)
    window = choose(day, 1)
    monkeypatch.setattr("glapp.fleet.windows.fit_recordings", lambda *a, **b: 1 / 0)
    row, windows, problems = judge(cut(table_of(x), loop, window), day, NOTHING, loop)
    [row_of_loop] = row.to_pylist()
    assert (row_of_loop["valve"], row_of_loop["reason_code"], row_of_loop["hindrance"], windows.num_rows) == (
        "refused",
        "fault",
        "data",
        0,
    )
    assert "ZeroDivisionError" in row_of_loop["reason"] and codes(problems) == {"fault"}
    monkeypatch.setattr("glapp.fleet.history.signals_of", lambda *a: 1 / 0)
    heard = follow(table_of(x), day, loop, None).select(CROSSINGS.names)
    _, _, problems = judge(cut(table_of(x), loop, []), day, heard, loop)
    assert ("fault", "2026-03-02") in {(p.code, p.day) for p in problems}


def test_what_could_be_read_at_the_first_look_and_not_later_ends_the_run(tmp_path: Path) -> None:
    path = put(tmp_path, "FIC1.parquet", wide(signals()), row_group_size=500, use_dictionary=False, compression="zstd")
    plan = planned(tmp_path)
    [unit] = plan.units
    _, before = unit_rows(plan, unit)
    assert before == [] and read_again(plan, unit, before)
    damage(path, 1)
    with pytest.raises(InputError, match=r"FIC1\.parquet: could be read before, and not now: row group 1 is damaged"):
        read_again(plan, unit, before)
    assert read_again(plan, unit, unit_rows(plan, unit)[1])
    assert [(p.code, p.file) for p in run_module._changed_files(plan)] == [("changed", "FIC1.parquet")]


# --- whole runs


@pytest.mark.slow
def test_a_process_that_is_killed_ends_the_run_with_a_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    put(tmp_path / "lake", "FIC1.parquet", wide({name: values[:100] for name, values in signals().items()}))

    def killed(pool: Any, *_: Any) -> None:
        process = pool.submit(os.getpid)
        os.kill(process.result(), signal.SIGKILL)
        pool.submit(os.getpid).result()

    with monkeypatch.context() as patch:
        patch.setattr(local, "_run_tasks", killed)
        with pytest.raises(InputError, match="a process ended in its work, as for want of memory; give it fewer"):
            fleet.analyze(tmp_path / "lake", tmp_path / "out", workers=1)
    assert fleet.analyze(tmp_path / "lake", tmp_path / "out", fits=1)["lost"]["files"] == 0


@pytest.mark.parametrize(
    ("gaps", "beyond", "likely", "likely_sound", "none", "unjudged", "said"),
    [
        (
            0,
            0,
            0,
            1,
            1,
            2,
            "No dead band was found in 4 valves. 1 probably has none wider than the limit. 1 shows none. ",
        ),
        (1, 1, 1, 0, 0, 0, "1 of 2 valves has a dead band, wider than the limit. 1 valve probably has one. First: g0."),
        (1, 0, 0, 0, 0, 0, "1 of 1 valve has a dead band, not surely wider than the limit."),
        (
            3,
            0,
            2,
            0,
            5,
            0,
            "have a dead band, none of them surely wider than the limit. 2 valves probably have one. 5 ",
        ),
        (
            3,
            2,
            0,
            4,
            0,
            1,
            "3 of 8 valves have a dead band, 2 of them wider than the limit. 4 probably have none wider ",
        ),
    ],
)
def test_no_sentence_counts_nothing(
    gaps: int, beyond: int, likely: int, likely_sound: int, none: int, unjudged: int, said: str
) -> None:
    """It said "Likely: 0 valves with one" and "0 of 200 valves have a dead band, 0 of them wider than the limit"."""
    row = {"valve": "unknown", "confidence": "cannot_tell", "acceptable": None, "changes": False, "hindrance": None}
    found = [
        row | {"loop": f"g{k}", "valve": "gap", "acceptable": "beyond" if k < beyond else "open"} for k in range(gaps)
    ]
    probable = {"likely": [row] * likely, "likely_sound": [row] * likely_sound}
    rest = [row | {"valve": "no_gap"}] * none + [row | {"hindrance": "load"}] * unjudged
    short = _in_short([*found, *probable["likely"], *probable["likely_sound"], *rest], found, probable)
    assert said in short and not re.search(r"\b0 ", short)


def test_a_lake_of_one_day_has_one_date() -> None:
    """It said "2025-10-01 to 2025-10-01"."""
    day = {"first": datetime(2025, 10, 1, 2), "last": datetime(2025, 10, 1, 20)}
    assert _span([day]) == "2025-10-01"
    assert _span([day, {"first": None, "last": datetime(2025, 10, 2)}]) == "2025-10-01 to 2025-10-02"


def test_every_code_of_a_problem_is_in_the_docs() -> None:
    folder = Path(run_module.__file__).parent
    source = "".join(path.read_text(encoding="utf-8") for path in folder.glob("*.py") if path.name != "demo.py")
    reported = set(re.findall(r'DataIssue\(\s*"(\w+)"', source)) | {"no_time", "no_tag", *LOST, *LEFT_OUT}
    page = (folder.parents[2] / "docs" / "fleet.md").read_text(encoding="utf-8").partition("## What can be wrong")[2]
    known = {code for line in re.findall(r"^\| (`.*?) \|", page, re.M) for code in re.findall(r"`(\w+)`", line)}
    assert len(reported) > 20 and reported <= known, reported - known


def spoil_times(path: Path) -> None:
    chunk = pq.read_metadata(path).row_group(0).column(0)
    with path.open("r+b") as file:
        file.seek(chunk.data_page_offset + chunk.total_compressed_size // 2)
        file.write(b"\x00" * 64)


@pytest.mark.slow
def test_loops_that_are_lost_with_their_files_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Regression: seven loops of twelve had rows, and the lake was reported as complete."""
    lake, out = tmp_path / "lake", tmp_path / "results"
    x = {name: values[:700] for name, values in signals().items()}
    for i in range(5):
        path = put(lake, f"FIC{i}.parquet", wide(x), use_dictionary=False, compression="zstd")
        {1: lambda p: damage(p, 0), 2: spoil_times, 3: lambda p: p.write_bytes(p.read_bytes()[:200])}.get(
            i, lambda p: None
        )(path)
    for again in (False, True):  # the second run reads nothing anew
        with pytest.raises(SystemExit) as end:
            app(["fleet", "analyze", str(lake), "--out", str(out), "--fits", "1"])
        printed = capsys.readouterr()
        assert end.value.code == 1 and "5 loops:" in printed.out, again
        assert "3 cannot be judged (3 of them refused)" in " ".join(printed.out.split())
        assert "3 loops refused. 3 files could not be read in whole or in part (1400 rows" in " ".join(
            printed.err.split()
        )
        found = {row["loop"]: row for row in fleet.read(out).to_pylist()}
        refused = {name: row["reason_code"] for name, row in found.items() if row["valve"] == "refused"}
        assert refused == {"FIC1": "no_rows", "FIC2": "no_rows", "FIC3": "unreadable"}
        assert all(f"{name}.parquet" in found[name]["reason"] and found[name]["lost"] == 1 for name in refused)
        lost = {"loops": 3, "files": 3, "rows": 1400, "left_out": 0, "not_understood": 0}
        assert fleet.manifest(out)["lost"] == lost
        page = (out / "report.html").read_text().replace("<wbr>", "")
        assert "3 loops refused." in page and all(name in page for name in refused)
    assert fleet.read(out, "inputs").select(["file", "rows", "unreadable"]).to_pylist()[2] == {
        "file": "FIC2.parquet",
        "rows": 0,
        "unreadable": 700,
    }


@pytest.mark.verify
def test_every_planted_problem_is_found_and_none_is_fatal(tmp_path: Path) -> None:
    lake, results = fleet.make_demo(tmp_path / "lake", loops=10, days=5, seed=SEED), tmp_path / "results"
    fleet.analyze(lake, results, fits=1)
    found = fleet.read(results, "problems").to_pylist()
    planted = pq.read_table(lake / "_truth" / "problems.parquet").to_pylist()
    assert {one["code"] for one in planted} >= {
        *("no_tags", "settings", "schema", "time", "no_settings", "contradicting", "quality", "outside_span"),
        *("doubled", "value", "unreadable", "unit", "damaged"),
    }
    for one in planted:
        same = [row for row in found if row["code"] == one["code"]]
        assert any(all(one[k] in ("", row[k]) for k in ("file", "loop", "day")) for row in same), (one, same)
    truth = {row["loop"]: row for row in pq.read_table(lake / "_truth" / "loops.parquet").to_pylist()}
    loops = fleet.read(results).to_pylist()
    refused = {row["loop"]: row["reason_code"] for row in loops if row["valve"] == "refused"}
    assert {row["loop"] for row in loops} == set(truth) | set(refused) and "FIC9001" in refused
    scored = [row for row in loops if row["score"] is not None]
    assert scored and all(truth[row["loop"]]["dead_band"] > 0 for row in scored)
    assert [row["score"] for row in scored] == sorted((row["score"] for row in scored), reverse=True)
    assert loops[: len(scored)] == scored


SEED = 9
"""A mill whose ten loops lie in all three layouts."""


@pytest.fixture(scope="module")
def lake(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four loops of two short days each, and one whose only group of rows is damaged."""
    lake = tmp_path_factory.mktemp("fleet") / "lake"
    for i in range(4):
        x = signals(days=2, d=0.7 * i)
        for day in range(2):
            part = {name: values[day * N : day * N + 700] for name, values in x.items()}
            put(lake, f"loop=FIC{i}/day={day}/x.parquet", wide(part))
    path = put(lake, "loop=FIC9/day=0/x.parquet", wide(signals()), use_dictionary=False, compression="zstd")
    damage(path, 0)
    put(lake, "notes.parquet", pa.table({"note": ["-"]}))
    return lake


@pytest.fixture(scope="module")
def results(lake: Path) -> Path:
    fleet.analyze(lake, lake.with_name("results"), fits=1)
    return lake.with_name("results")


@pytest.mark.verify
@pytest.mark.xdist_group("fleet")
def test_results_carry_where_they_come_from(lake: Path, results: Path) -> None:
    known = fleet.manifest(results)
    assert known["provenance"]["glapp"] == glapp.__version__ and known["provenance"]["fits"] == 1
    for name, entry in known["tables"].items():
        assert fleet.read(results, name).num_rows == entry["rows"]
        assert b"glapp" in pq.read_schema(results / known["folder"] / f"{name}.parquet").metadata
    inputs = {row["file"]: row for row in fleet.read(results, "inputs").to_pylist()}
    for name, row in inputs.items():
        state = (lake / name).stat()
        assert (row["size"], row["mtime_ns"]) == (state.st_size, state.st_mtime_ns)
    page = (results / "report.html").read_text()
    assert all(row["loop"] in page.replace("<wbr>", "") for row in fleet.read(results).to_pylist())
    [head, *lines] = csv.reader(io.StringIO((results / "loops.csv").read_text()))
    loops = fleet.read(results).to_pylist()
    assert [line[head.index("loop")] for line in lines] == [row["loop"] for row in loops] and "rank" not in head
    assert [line[head.index("next_text")] for line in lines] == [row["next_text"] for row in loops]
    assert "http" not in page.replace("http-equiv", "") and "<script" not in page
    path = results / known["folder"] / "loops.parquet"
    whole = path.read_bytes()
    try:
        path.write_bytes(whole[:-1])
        with pytest.raises(InputError, match="not the one that the manifest names"):
            fleet.read(results)
    finally:
        path.write_bytes(whole)


RUN = "import sys; from glapp import fleet; fleet.analyze(sys.argv[1], sys.argv[2], fits=1, workers=2)"


def pieces(out: Path) -> set[Path]:
    return {
        path
        for path in (out / "work").rglob("*")
        if path.is_file() and not path.name.startswith(".") and path.name != "lock"
    }


@pytest.mark.verify
@pytest.mark.xdist_group("fleet")
def test_a_run_that_is_killed_goes_on_and_ends_in_the_same_tables(lake: Path, results: Path, tmp_path: Path) -> None:
    out = tmp_path / "results"
    script = tmp_path / "run.py"
    script.write_text(f"if __name__ == '__main__':\n    {RUN}\n")
    for wanted in ("files", "days", "loops"):
        run = subprocess.Popen([sys.executable, str(script), str(lake), str(out)], start_new_session=True)
        while not any(path.parent.name == wanted for path in pieces(out)):
            assert run.poll() is None
            time.sleep(0.005)
        run.send_signal(signal.SIGKILL)
        run.wait()
        with pytest.raises(InputError, match="holds no results"):
            fleet.read(out)
    before = {path: path.stat().st_mtime_ns for path in pieces(out)}
    made = fleet.analyze(lake, out, fits=1)
    assert made["folder"] == fleet.manifest(results)["folder"]
    assert all(path.stat().st_mtime_ns == at for path, at in before.items() if path.exists())


@pytest.mark.verify
@pytest.mark.xdist_group("fleet")
def test_a_disk_that_fills_ends_a_run_cleanly_and_the_next_goes_on(lake: Path, results: Path, tmp_path: Path) -> None:
    pytest.importorskip("resource", reason="this system sets no limit to the size of files")
    out, script = tmp_path / "results", tmp_path / "run.py"
    limit = 4000  # [B]: indices of files fit, a piece of crossings does not
    full = f"import resource; resource.setrlimit(resource.RLIMIT_FSIZE, ({limit}, {limit}))"
    script.write_text(f"if __name__ == '__main__':\n    {full}\n    {RUN}\n")
    run = subprocess.run([sys.executable, str(script), str(lake), str(out)], capture_output=True, text=True)
    assert run.returncode and "InputError" in run.stderr and "make room, then run it again" in run.stderr, run.stderr
    with pytest.raises(InputError, match="holds no results"):
        fleet.read(out)
    assert pieces(out) and not list((out / "work").rglob("*.part"))
    assert fleet.analyze(lake, out, fits=1)["folder"] == fleet.manifest(results)["folder"]


@pytest.mark.verify
@pytest.mark.xdist_group("fleet")
def test_a_later_run_reads_only_what_is_new(lake: Path, results: Path, tmp_path: Path) -> None:
    part, out = tmp_path / "lake", tmp_path / "results"
    shutil.copytree(lake, part, copy_function=os.link)
    late = list(part.rglob("day=1/x.parquet"))
    for path in late:
        path.rename(path.with_suffix(".late"))
    fleet.analyze(part, out, fits=1)
    days = {path for path in pieces(out) if path.parent.name == "days"}
    assert len(days) == 1
    for path in late:
        path.with_suffix(".late").rename(path)
    made = fleet.analyze(part, out, fits=1)
    assert made["folder"] == fleet.manifest(results)["folder"]
    assert days < pieces(out) and len([p for p in pieces(out) if p.parent.name == "days"]) == 2
    assert len([p for p in pieces(out) if p.parent.name == "crossings"]) == 2
    again = {path: path.stat().st_mtime_ns for path in pieces(out)}
    assert fleet.analyze(part, out, fits=1)["folder"] == made["folder"]
    assert again == {path: path.stat().st_mtime_ns for path in pieces(out)}
    assert len(list(out.glob("tables-*"))) == 1


@pytest.mark.slow
@pytest.mark.xdist_group("fleet")
def test_on_the_command_line(lake: Path, results: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        app(["fleet", "analyze", str(lake), "--out", str(results), "--fits", "1"])
    printed = capsys.readouterr()
    assert end.value.code == 1 and "5 loops:" in printed.out and "3 problems" in printed.err
    assert (
        "report.html" in printed.out and "not in the answers: 1 loop refused. 1 file could not be read" in printed.err
    )
    # Regression: the report counted refused loops among those that cannot be judged, and the command beside them.
    page = html.unescape((results / "report.html").read_text()).replace("<wbr>", "")
    [shown] = re.findall(r"(\d+) cannot be judged \(1 of them refused\)", " ".join(printed.out.split()))
    loops = fleet.read(results).to_pylist()
    unjudged = [row for row in loops if row["hindrance"] is not None]
    assert f"{shown} cannot be judged." in page and int(shown) == len(unjudged)
    # Regression: why a loop is not judged was in a Parquet table alone, and how soon nowhere.
    assert all(words.sentence(row["reason"]) in page and row["next_text"] in page for row in unjudged)
    soon = [row for row in loops if row["score"] is not None and row["acceptable"] != "within"]
    assert soon and page.count("How soon: ") == len(soon)
    told_of = [(row["code"], row["loop"]) for row in fleet.read(results, "problems").to_pylist()]
    assert told_of == [("damaged", ""), ("no_rows", "FIC9"), ("schema", "")]


@pytest.mark.verify
@pytest.mark.xdist_group("fleet")
def test_spark_gives_the_same_tables(lake: Path, results: Path, tmp_path: Path) -> None:
    pyspark = pytest.importorskip("pyspark", reason="PySpark is not installed: pip install 'glapp[spark]'")
    if shutil.which("java") is None:
        pytest.skip("java is not installed, and Spark needs it")
    answers = [Path("work") / "loops" / path.name for path in sorted((results / "work" / "loops").iterdir())]
    fitted = answers[:2]  # by a run on one machine: Spark goes on from them
    for path in (*fitted, *(Path("work") / "of_loops" / path.name for path in fitted)):
        (tmp_path / "out" / path).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(results / path, tmp_path / "out" / path)
    script = tmp_path / "job.py"
    script.write_text(
        "import sys\nfrom glapp import fleet\nfrom glapp.fleet import spark\n"
        "spark.GROUP = 1000  # two days of a loop do not fit into one group: its state is handed on\n"
        "spark.JUDGED_AT_A_TIME = 3\n"
        "fleet.analyze(sys.argv[1], sys.argv[2], fits=1, engine='spark')\n"
    )
    settings = ("ui.enabled=false", "driver.bindAddress=127.0.0.1", "driver.host=127.0.0.1", "sql.shuffle.partitions=2")
    more = [part for setting in settings for part in ("--conf", f"spark.{setting}")]
    submit = Path(pyspark.__file__).parent / "bin" / "spark-submit"
    known = {**os.environ, "PYSPARK_PYTHON": sys.executable}
    command = [str(submit), "--master", "local[2]", *more, str(script), str(lake), str(tmp_path / "out")]
    run = subprocess.run(command, capture_output=True, text=True, env=known)
    assert run.returncode == 0, run.stderr[-2000:]
    assert fleet.manifest(tmp_path / "out")["folder"] == fleet.manifest(results)["folder"]
    made = {path.relative_to(tmp_path / "out") for path in pieces(tmp_path / "out")}
    of_days = {path for path in made if path.parent.name in ("days", "crossings")}
    assert len(of_days) == 4 and all((results / path).exists() for path in of_days)  # either engine goes on from them
    assert len(answers) == 4 and {path for path in made if path.parent.name == "loops"} == set(answers)
    for path in fitted:
        assert (tmp_path / "out" / path).stat().st_mtime_ns == (results / path).stat().st_mtime_ns


def test_the_progress_of_a_large_run_fits_a_narrow_screen(monkeypatch: pytest.MonkeyPatch) -> None:
    """At 80 characters the time that is left was broken onto a line of its own, at each step."""
    cli_fleet = importlib.import_module("glapp.cli.fleet")  # the package has the command by this name
    monkeypatch.setattr(cli_fleet, "err", Console(file=io.StringIO(), width=80, force_terminal=True))
    bar = cli_fleet._bar()
    for name in cli_fleet._PARTS.values():
        task = bar.add_task(name, total=10_000)
        monkeypatch.setattr(type(bar.tasks[0]), "time_remaining", 3 * 3600.0 + 14 * 60.0)
        bar.update(task, completed=9999)
    screen = Console(file=io.StringIO(), width=80)
    lines = screen.render_lines(bar.get_renderable())
    shown = ["".join(part.text for part in line) for line in lines]
    assert len(shown) == len(cli_fleet._PARTS) and all("part: 3 h 14 min left" in line for line in shown), shown


def test_files_of_another_schema_are_counted_in_the_headline(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Two months whose files call the value otherwise were left out, and the headline named no file.

    Files without a zone were a problem each, thousands in a lake of small files.
    """
    lake, x = tmp_path / "lake", {name: values[:400] for name, values in signals().items()}
    naive = wide(x).set_column(0, "time", wide(x)["time"].cast(pa.timestamp("us")))
    for hour in range(3):
        put(lake, f"FIC1_2026-03-01_{hour:02d}.parquet", naive.slice(hour * 100, 100))
        put(lake, f"later/{hour}.parquet", long(x).rename_columns(["tag", "time", "amount", "quality"]))
    app(["fleet", "analyze", str(lake), "--out", str(tmp_path / "out"), "--fits", "1"], standalone_mode=False)
    printed = " ".join(capsys.readouterr().err.split())
    assert "4 problems in the lake (3 schema, 1 no_zone), each with its place" in printed
    assert "not in the answers: 3 files left out: no column names a signal of a loop." in printed
    [one] = [row for row in fleet.read(tmp_path / "out", "problems").to_pylist() if row["code"] == "no_zone"]
    assert one["what"] == "its times have no zone, and are taken for UTC; so are those of 2 other files"
    assert fleet.read(tmp_path / "out")["loop"].to_pylist() == ["FIC1"]


def test_names_that_lakes_give_to_their_columns(tmp_path: Path) -> None:
    """Files whose value is called value_double or vValue were left out; beside Value, Value is meant."""
    x = {name: values[:60] for name, values in signals().items()}
    for i, names in enumerate(
        (["sensor_id", "event_time", "value_double"], ["externalId", "timestamp", "value"], ["TagName", "ts", "vValue"])
    ):
        put(tmp_path, f"{i}.parquet", long(x, f"FIC{i}").drop_columns(["quality"]).rename_columns(names))
    both = long(x, "FIC3").add_column(2, "vValue", pa.array([f"{k}" for k in range(180)]))
    put(tmp_path, "3.parquet", both.rename_columns(["tag", "time", "vValue", "Value", "Quality"]))
    found, problems = rows(planned(tmp_path))
    assert sorted(name for name, _ in found) == [f"FIC{i}" for i in range(4)] and problems == []
    assert len({tuple(sorted(map(tuple, of))) for of in found.values()}) == 1
