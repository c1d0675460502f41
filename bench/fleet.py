"""The fleet against truth: `python -m bench.fleet`.

Makes the demonstration lake and judges it with 1, 7 and 30 days of history, the last ones each time: how many of the
valves called too wide are so, how many of the bad ones are found, how many sound ones stand among the first twenty, and
whether every planted problem is found. `--kills N` kills a run N times with SIGKILL at random moments, lets it go on,
and compares its tables, bit for bit, with those of a run that nobody stopped. `--docs` writes bench/results/fleet.md.
"""

from __future__ import annotations

import argparse
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import time
from datetime import timedelta
from itertools import pairwise
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
from rich.console import Console

from glapp import fleet
from glapp.fleet.demo import BEGIN, STEP

from .page import write

OUT = Path(__file__).parents[1] / "out" / "fleet"
FIRST = 20
BAD = 1.0
"""A valve is bad from this dead band on [%]; it is sound where it has none at all."""


_RUN = """
import sys
from glapp import fleet
if __name__ == "__main__":
    fleet.analyze(sys.argv[1], sys.argv[2], fits=1)
"""


def main() -> None:
    """Measure the cases of the command line."""
    asked = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    asked.add_argument("--loops", type=int, default=200)
    asked.add_argument("--days", type=int, nargs="+", default=[1, 7, 30])
    asked.add_argument("--seed", type=int, default=1)
    asked.add_argument("--kills", type=int, default=0)
    asked.add_argument("--docs", action="store_true")
    given = asked.parse_args()
    longest = max(given.days)
    lake = OUT / f"lake-{given.loops}-{longest}-{given.seed}"
    if not (lake / "_truth" / "problems.parquet").exists():
        shutil.rmtree(lake, ignore_errors=True)
        begun = time.monotonic()
        fleet.make_demo(lake, loops=given.loops, days=longest, seed=given.seed)
        print(f"made in {time.monotonic() - begun:.0f} s")
    if given.kills:
        kills(lake, given.kills)
        return
    rows = [judged(lake, days, longest) for days in given.days]
    size = sum(path.stat().st_size for path in lake.rglob("*.parquet"))
    text = _page(rows, given.loops, longest, size)
    Console().print(text, markup=False)
    if given.docs:
        write("fleet.md", text)


def last_days(lake: Path, days: int, longest: int) -> Path:
    """The lake with its last days only, by links."""
    if days == longest:
        return lake
    other = lake.with_name(f"{lake.name}-last-{days}")
    shutil.rmtree(other, ignore_errors=True)
    names = {(BEGIN + timedelta(days=day)).isoformat() for day in range(longest - days, longest)}
    for path in lake.rglob("*"):
        if path.is_file() and "_truth" not in path.parts and any(n in str(path) for n in (*names, "loops.csv")):
            link = other / path.relative_to(lake)
            link.parent.mkdir(parents=True, exist_ok=True)
            os.link(path, link)
    return other


def judged(lake: Path, days: int, longest: int) -> dict[str, Any]:
    """Judge the last days, and hold the answers against the truth."""
    of = last_days(lake, days, longest)
    out = OUT / f"results-{of.name}"
    fresh = not out.exists()  # of a run that went on no time is told
    parts: dict[str, float] = {}
    begun = time.monotonic()

    def stage(name: str, total: int, done: int) -> None:
        parts[name] = time.monotonic() - begun

    made = fleet.analyze(of, out, stage=stage)
    truth = {row["loop"]: row for row in pq.read_table(lake / "_truth" / "loops.parquet").to_pylist()}
    loops = [row for row in fleet.read(out).to_pylist() if row["loop"] in truth]  # others are planted problems
    scored = [row["loop"] for row in loops if row["score"] is not None]
    called = [row for row in loops if row["acceptable"] == "beyond" and row["evidence"] is not None]
    bad = [name for name, row in truth.items() if row["dead_band"] >= BAD]
    shown = [name for name in bad if truth[name]["record"] == "good"]
    hold = [row for row in loops if row["score"] is not None and row["verdict"] in ("backlash", "stiction", "both")]
    inside = [
        row for row in hold if row["high"] is None or row["low"] <= truth[row["loop"]]["dead_band"] <= row["high"]
    ]
    first = scored[:FIRST]
    named = {row["loop"] for row in called}
    ends = [0.0, *(parts.get(name, 0.0) for name in ("files", "days", "crossings", "windows", "loops"))]
    days_rows = fleet.read(out, "days")
    return {
        "days": days,
        "loops": len(truth),
        "bad": len(bad),
        "bad_shown": len(shown),
        "gaps": len(scored),
        "called": len(called),
        "called_bad": sum(truth[name]["dead_band"] >= BAD for name in named),
        "told_sound": sum(truth[name]["dead_band"] == 0 for name in named),
        "found": sum(name in named for name in bad),
        "found_shown": sum(name in named for name in shown),
        "first": len(first),
        "first_bad": sum(truth[name]["dead_band"] >= BAD for name in first),
        "first_sound": sum(truth[name]["dead_band"] == 0 for name in first),
        "sound_scored": [name for name in scored if truth[name]["dead_band"] == 0],
        "no_gap": sum(row["valve"] == "no_gap" for row in loops),
        "no_gap_bad": [row["loop"] for row in loops if row["valve"] == "no_gap" and row["loop"] in bad],
        "likely": sum(row["confidence"] == "likely" for row in loops),
        "likely_bad": sum(row["loop"] in bad for row in loops if row["confidence"] == "likely"),
        "likely_sound": sum(row["confidence"] == "likely_sound" for row in loops),
        "likely_sound_bad": sum(row["loop"] in bad for row in loops if row["confidence"] == "likely_sound"),
        "unknown": sum(row["hindrance"] is not None for row in loops),
        "widths": len(hold),
        "inside": len(inside),
        "wear": sum(row["changes"] and truth[row["loop"]]["kind"] == "wear" for row in loops),
        "wear_all": sum(row["kind"] == "wear" and row["record"] == "good" for row in truth.values()),
        "wear_false": sum(row["changes"] and truth[row["loop"]]["kind"] != "wear" for row in loops),
        "fresh": fresh,
        "seconds": made["seconds"],
        "parts": [b - a for a, b in pairwise(ends)],
        "rows": sum(days_rows["rows"].to_pylist()),
        "windows": made["tables"]["windows"]["rows"],
        "memory": resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024,
        "problems": planted(lake, out) if days == longest else None,
    }


def planted(lake: Path, out: Path) -> tuple[int, int, list[dict[str, Any]]]:
    """Number of the planted problems that are in the results, of how many, and the missing ones."""
    found = fleet.read(out, "problems").to_pylist()
    truth = pq.read_table(lake / "_truth" / "problems.parquet").to_pylist()

    def there(one: dict[str, Any]) -> bool:
        return any(
            row["code"] == one["code"] and all(one[k] in ("", row[k]) for k in ("file", "loop", "day")) for row in found
        )

    missing = [one for one in truth if not there(one)]
    return len(truth) - len(missing), len(truth), missing


def _page(rows: list[dict[str, Any]], loops: int, longest: int, size: int) -> str:
    def line(name: str, of: Any) -> str:
        return f"| {name} | " + " | ".join(str(of(row)) for row in rows) + " |"

    last = rows[-1]
    lines = [
        f"`python -m bench.fleet --loops {loops}`: {loops} loops, {longest} days at {STEP} s, {size / 1e6:.0f} MB, "
        f"{last['bad']} valves with a dead band of {BAD:.0f} % or more, {last['bad_shown']} of them in recordings "
        "that can show it.",
        "",
        "| days of history | " + " | ".join(str(row["days"]) for row in rows) + " |",
        "|---|" + "---|" * len(rows),
        line("called wider than acceptable", lambda r: r["called"]),
        line("of them bad in truth (precision)", lambda r: _share(r["called_bad"], r["called"])),
        line("of them sound in truth", lambda r: r["told_sound"]),
        line("bad valves found (recall), all", lambda r: _share(r["found"], r["bad"])),
        line("the same, where the recording can show it", lambda r: _share(r["found_shown"], r["bad_shown"])),
        line(f"bad among the first {FIRST}", lambda r: f"{r['first_bad']} of {r['first']}"),
        line(f"**sound among the first {FIRST}**", lambda r: f"**{r['first_sound']}**"),
        line("sound anywhere in the list", lambda r: len(r["sound_scored"])),
        line("intervals that hold the truth", lambda r: _share(r["inside"], r["widths"])),
        line("no gap shown; bad ones among them", lambda r: f"{r['no_gap']}; {len(r['no_gap_bad'])}"),
        line("likely a gap; bad ones among them", lambda r: f"{r['likely']}; {r['likely_bad']}"),
        line("likely sound; bad ones among them", lambda r: f"{r['likely_sound']}; {r['likely_sound_bad']}"),
        line("cannot be judged", lambda r: r["unknown"]),
        line("wear seen (of those that can show it)", lambda r: _share(r["wear"], r["wear_all"])),
        line("wear seen where there is none", lambda r: r["wear_false"]),
        line("samples of PV", lambda r: f"{r['rows'] / 1e6:.1f} M"),
        line("windows fitted", lambda r: r["windows"]),
        line("time: all", lambda r: f"{r['seconds']:.0f} s" if r["fresh"] else "–"),
        line(
            "files, days, crossings, windows, loops",
            lambda r: ", ".join(f"{part:.0f} s" for part in r["parts"]) if r["fresh"] else "–",
        ),
    ]
    if last["problems"] is not None:
        found, all_of_them, missing = last["problems"]
        lines += ["", f"Planted problems found: {found} of {all_of_them}" + (f"; not: {missing}." if missing else ".")]
    for row in rows:
        if row["sound_scored"] or row["no_gap_bad"]:
            lines.append(
                f"{row['days']} days: sound in the list {', '.join(row['sound_scored']) or 'none'}; bad and called "
                f"without a gap {', '.join(row['no_gap_bad']) or 'none'}."
            )
    return "\n".join([*lines, "", f"The largest process took {last['memory']:.0f} MB."])


def _share(some: int, total: int) -> str:
    return f"{some} of {total}" + (f" ({100 * some / total:.0f} %)" if total else "")


def kills(lake: Path, times: int) -> None:
    """Kill a run again and again, and compare its result with that of a run without a kill.

    Of four kills three wait until a piece or two are there, so that they fall within the work and not before it.
    """
    whole, broken = OUT / "whole", OUT / "broken"
    for folder in (whole, broken):
        shutil.rmtree(folder, ignore_errors=True)
    wanted = fleet.analyze(lake, whole, fits=1)
    dice, killed, ended = random.Random(1), 0, 0
    script = OUT / "run.py"  # a file: processes that are spawned read it once more
    script.write_text(_RUN)
    while killed < times:
        run = subprocess.Popen([sys.executable, str(script), str(lake), str(broken)])
        until = _pieces(broken) + dice.choice((0, 1, 1, 2))
        while _pieces(broken) < until and run.poll() is None:
            time.sleep(0.01)
        time.sleep(dice.uniform(0.0, 1.0))
        run.send_signal(signal.SIGKILL)
        if run.wait() == -signal.SIGKILL:
            killed += 1
        if (broken / "manifest.json").exists():
            ended += 1
            if fleet.manifest(broken)["folder"] != wanted["folder"]:
                raise SystemExit(f"other tables after kill {killed}")
            shutil.rmtree(broken)  # the kills that are left begin anew
    same = fleet.analyze(lake, broken, fits=1)["folder"] == wanted["folder"]
    print(f"{killed} kills, {ended + 1} runs brought to their end: the tables are {'the same' if same else 'OTHER'}")


def _pieces(out: Path) -> int:
    return sum(path.suffix == ".parquet" for path in (out / "work").rglob("*"))


if __name__ == "__main__":
    main()
