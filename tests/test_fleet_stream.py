"""Crossings straight from Parquet files: the detector's bits, and the errors of files that cannot be read."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import glapp
from glapp import _glapp, fleet
from glapp.errors import InputError
from glapp.fleet.stream import CROSSINGS

NAMES = {"time": "t", "SP": "SP", "PV": "PV", "OP": "OP"}
START = np.datetime64("2026-03-01", "us")


def signals(seed: int, n: int) -> dict[str, np.ndarray]:
    """A limit cycle in noise, with gaps in time and values that are missing."""
    rng = np.random.default_rng(seed)
    t = np.cumsum(np.where(rng.random(n) < 0.001, 40.0, 1.0 + rng.integers(0, 2, n)))
    side = np.where(np.arange(n) // (60 + seed) % 2 == 0, 1.0, -1.0)
    pv = 20.0 + side * (1.0 + 0.1 * seed) + 0.3 * rng.standard_normal(n)
    pv[rng.random(n) < 0.002] = np.nan
    sp = np.where(np.arange(n) < n // 2, 20.0, 20.5)
    return {"t": t, "SP": sp, "PV": pv, "OP": 50.0 - 0.5 * side + 0.01 * rng.standard_normal(n)}


def table(s: dict[str, np.ndarray], kind: str = "us") -> pa.Table:
    """The signals with timestamps, null for missing values."""
    t = pa.array(START + (s["t"] * 1e6).astype("timedelta64[us]")).cast(pa.timestamp(kind))
    return pa.table({"t": t, **{name: pa.array(s[name], from_pandas=True) for name in ("SP", "PV", "OP")}})


def estimator(name: str, seed: int) -> glapp.Estimator:
    loop = glapp.Loop(name=name, controller={"k": 0.5, "ti": 8}, process={"kp": 2}, n=5, tf=0.3 * seed + 0.1)  # type: ignore[arg-type]
    return glapp.Estimator(loop, 1.0)


def alone(name: str, seed: int, s: dict[str, np.ndarray], op: bool = True) -> glapp.Estimator:
    one = estimator(name, seed)
    one.update_many(s["t"] - s["t"][0], s["SP"], s["PV"], s["OP"] if op else None)
    return one


WAYS: list[tuple[str, dict[str, Any]]] = [
    ("us", {"compression": "zstd", "row_group_size": 700}),
    ("ms", {"compression": "snappy", "data_page_size": 2000}),
    ("ns", {"compression": "none", "use_dictionary": False}),
    ("us", {"compression": "zstd", "use_dictionary": False, "use_byte_stream_split": ["SP", "PV", "OP"]}),
    ("us", {"compression": "zstd", "data_page_version": "2.0"}),
]


@pytest.mark.parametrize("threads", [1, 3])
def test_the_bits_are_those_of_all_rows(tmp_path: Path, threads: int) -> None:
    whole = {f"FIC{seed}": signals(seed, 5000 + 613 * seed) for seed in range(11)}
    files: dict[str, list[str | Path]] = {}
    for seed, (name, s) in enumerate(whole.items()):
        kind, ways = WAYS[seed % len(WAYS)]
        files[name] = []
        cut = 1000 * (seed % 4)
        for i, part in enumerate([slice(0, cut), slice(cut, None)]):
            files[name].append(tmp_path / f"{name}-{i}.parquet")
            pq.write_table(table({c: x[part] for c, x in s.items()}, kind), files[name][-1], **ways)
    loops = {name: estimator(name, seed) for seed, name in enumerate(whole)}
    found = fleet.crossings(files, NAMES, loops, threads=threads)
    assert found.schema == CROSSINGS
    assert found.column("problem").null_count == len(found)
    for seed, (row, (name, s)) in enumerate(zip(found.to_pylist(), whole.items(), strict=True)):
        expected = alone(name, seed, s)
        assert loops[name].save() == expected.save()
        assert not len(loops[name]._detector.table()["t_start"])  # so that memory does not grow with the files
        assert (row["loop"], row["rows"], row["accepted"]) == (name, len(s["t"]), expected.reasons["accepted"])
    assert pa.compute.sum(found.column("accepted")).as_py() > 100


def test_a_detector_goes_on_with_the_files_of_the_next_day(tmp_path: Path) -> None:
    s = signals(2, 6000)
    first, second = tmp_path / "1.parquet", tmp_path / "2.parquet"
    names = {name: column for name, column in NAMES.items() if name != "OP"}
    for whole, since in ((pa.table(s), None), (table(s), START.item())):
        pq.write_table(whole.slice(0, 2500), first)
        pq.write_table(whole.slice(2500), second)
        ours = {"FIC2": estimator("FIC2", 2)}
        for file in (first, second):
            fleet.crossings({"FIC2": [file]}, names, ours, since=since)
        one = estimator("FIC2", 2)
        one.update_many(s["t"], s["SP"], s["PV"])
        assert ours["FIC2"].save() == one.save()


def test_many_loops_in_one_file_of_other_numbers(tmp_path: Path) -> None:
    s = signals(1, 3000)
    pv = np.round(np.nan_to_num(s["PV"], nan=20.0))
    columns = {"t": np.arange(3000), "A.SP": np.full(3000, 20, np.int32), "A.PV": pv.astype(np.float32)}
    pq.write_table(
        pa.table({**columns, "B.SP": s["SP"].astype(np.float32), "B.PV": pv.astype(np.int64)}), tmp_path / "x.parquet"
    )
    names = {"time": "t", "SP": "{loop}.SP", "PV": "{loop}.PV"}
    loops = {name: estimator(name, 1) for name in "AB"}
    fleet.crossings({name: [tmp_path / "x.parquet"] for name in "AB"}, names, loops)
    for name, sp in (("A", np.full(3000, 20.0)), ("B", s["SP"])):
        one = estimator(name, 1)
        one.update_many(np.arange(3000.0), sp, pv)
        assert loops[name].save() == one.save()


def test_what_cannot_be_read_is_told_and_costs_the_others_nothing(tmp_path: Path) -> None:
    s = signals(3, 4000)
    good = tmp_path / "good.parquet"
    pq.write_table(table(s), good, row_group_size=1500, compression="zstd")
    swapped = {c: np.r_[x[:2000], x[1990:1991], x[2000:]] for c, x in s.items()}
    pq.write_table(table(swapped), tmp_path / "again.parquet")
    lost = table(s).set_column(0, "t", pa.array([None if k == 1234 else k for k in range(4000)], pa.timestamp("ms")))
    pq.write_table(lost, tmp_path / "lost.parquet")
    pq.write_table(table(s).set_column(2, "PV", pa.array(["12"] * 4000)), tmp_path / "words.parquet")
    pq.write_table(table(s).drop(["SP"]), tmp_path / "bare.parquet")
    whole = good.read_bytes()
    (tmp_path / "cut.parquet").write_bytes(whole[: len(whole) // 2])
    page = pq.ParquetFile(good).metadata.row_group(1).column(2).data_page_offset
    (tmp_path / "damaged.parquet").write_bytes(whole[:page] + bytes([255] * 64) + whole[page + 64 :])
    wrong = ["again", "lost", "words", "bare", "cut", "damaged", "missing"]
    files = {name: [tmp_path / f"{name}.parquet"] for name in wrong} | {"good": [good]}
    loops = {name: estimator(name, 3) for name in files}
    before = loops["cut"].save()
    found = {row["loop"]: row for row in fleet.crossings(files, NAMES, loops).to_pylist()}
    assert found["good"]["problem"] is None and found["good"]["rows"] == 4000
    assert loops["good"].save() == alone("good", 3, s).save()
    for name in wrong:
        assert found[name]["file"] == str(files[name][0]), name
        assert loops[name].save() == before
        assert (found[name]["rows"], found[name]["half_periods"]) == (0, 0)
    assert (found["again"]["row"], found["lost"]["row"]) == (2001, 1235)
    assert "sort the rows by time" in found["again"]["problem"]
    assert "column PV holds BYTE_ARRAY, where numbers are needed" in found["words"]["problem"]
    assert "has no column SP" in found["bare"]["problem"]
    assert "not a readable Parquet file" in found["cut"]["problem"]
    assert "cannot be opened" in found["missing"]["problem"]


def test_what_is_not_told_is_refused() -> None:
    with pytest.raises(InputError, match=r"columns\['PV'\]"):
        fleet.crossings({}, {"time": "t", "SP": "SP"}, {})
    with pytest.raises(InputError, match=r"FIC1.*has no files"):
        fleet.crossings({}, NAMES, {"FIC1": estimator("FIC1", 1)})


def test_side_by_side_as_alone_on_every_instruction_set() -> None:
    all_signals = [signals(seed, 9000 + 100 * seed) for seed in range(9)]  # into the lanes again after noise
    for instructions in _glapp.instruction_sets():
        together = [estimator("x", seed) for seed in range(9)]
        columns = [(s["t"] - s["t"][0], s["SP"], s["PV"], s["OP"]) for s in all_signals]
        _glapp.run_side_by_side([one._detector for one in together], columns, instructions)
        for seed, s in enumerate(all_signals):
            assert together[seed].save() == alone("x", seed, s).save()
            table = alone("x", seed, s)._detector.table()
            for name, column in together[seed]._detector.table().items():
                np.testing.assert_array_equal(column, table[name])
