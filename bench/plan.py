"""Promised power beside simulated power of `glapp.plan_test`: `python -m bench.plan --half B --loops 40`.

The test by hand is made as the guided test is: looked at while it goes on, and ended as soon as it has decided.

Each loop has a twin without its gap: the same process of two lags, PI controller, noise and kind of load. A recording
of one of the two is analysed, and a test by hand is planned for a gap as wide as that of the first, within limits that
a person gives. Then the test is made 20 times in either twin, on other days. How often the twin with the gap shows it,
and the other shows that it has none, is the simulated power. `--kind setpoint` does the same with setpoint steps, 10
times: each test is fitted.

`--kind more_hours` takes a short recording of the loop with its gap. Where that leaves it open and more hours are
advised, as many are recorded on other days, and fitted with the short one.

All distributions stand in `drawn`. Half A (even numbers) is for choosing the numbers in `glapp.plan`; half B judges.
"""

from __future__ import annotations

import os

os.environ.setdefault("RAYON_NUM_THREADS", "1")

import argparse
import json
import math
from dataclasses import dataclass, replace
from pathlib import Path
from random import Random
from time import monotonic
from typing import Any

import numpy as np

import glapp
import glapp.plan as planning
from glapp.controller import Controller
from glapp.plan import fit_decides, plan_test
from glapp.plant import Plant
from glapp.scenario import Gaussian, Manual, Scenario, Steps, Walk
from glapp.several_recordings import analyze_recordings
from glapp.simulate import Simulation, run_many

DAYS = {"by_hand": 20, "setpoint": 10, "more_hours": 5}
"""Tests in each twin."""

SHORT = (0.05, 0.4)
"""Part of a loop's recording that is kept where more hours are asked for."""

LONGEST = 10.0
"""More hours are recorded up to so many times the short recording."""

MINUTES = 120.0

LOOKS = 10
"""Looks at a test in each of its holds."""

THREE_MOVES = 3
"""Two moves one way and one back: the test as it is made today."""


@dataclass(frozen=True)
class Drawn:
    """A loop: process, controller, gap [% of OP], what acts on it, and the limits of its person."""

    number: int
    kp: float
    lag: float
    dead_time: float
    h: float
    controller: tuple[float, float]
    d: float
    noise: float
    walk: float
    setpoint: tuple[tuple[float, float], ...]
    t_end: float
    op_room: float
    pv_room: float

    def scenario(self, fault: str, seed: int, t_end: float, manual: tuple[Manual, ...] = ()) -> Scenario:
        """One day of it; PV and OP are 50 at rest."""
        den = [self.lag * 0.2 * self.lag, 1.2 * self.lag, 1.0]
        return Scenario(
            plant=Plant([self.kp], den, self.dead_time),
            controller=Controller(k=self.controller[0], ti=self.controller[1]),
            d=self.d if fault == "gap" else 0.0,
            noise=(Gaussian(sigma=self.noise),),
            load=(Walk(rate=self.walk),),
            setpoint=(Steps(steps=((0.0, 0.0), *(step for step in self.setpoint if step[0] < t_end))),),
            manual=manual,
            h=self.h,
            t_end=t_end,
            seed=seed,
        )


def drawn(number: int) -> Drawn:
    """The loop of that number."""
    random = Random(f"plan/{number}")

    def log(low: float, high: float) -> float:
        return math.exp(random.uniform(math.log(low), math.log(high)))

    kp, lag, d = log(0.3, 3.0), log(3.0, 60.0), log(0.3, 3.0)
    dead_time = lag * random.uniform(0.1, 0.6)
    h = min(2.0, max(0.25, round(lag / 8 * 4) / 4))
    t_end = h * round(lag * random.uniform(80.0, 300.0) / h)
    controller = (lag / (kp * (random.uniform(1.0, 3.0) * lag + dead_time)), 1.2 * lag)
    times = sorted(random.uniform(0.05, 0.95) * t_end for _ in range(random.randint(2, 8)))
    setpoint = tuple({h * round(t / h): kp * d * random.uniform(-2.5, 2.5) for t in times}.items())
    return Drawn(
        number=number,
        kp=kp,
        lag=lag,
        dead_time=dead_time,
        h=h,
        controller=controller,
        d=d,
        noise=kp * d * log(0.02, 0.4),
        walk=d * log(0.01, 0.3) / math.sqrt(20 * lag),
        setpoint=setpoint,
        t_end=t_end,
        op_room=d * log(3.0, 12.0),
        pv_room=kp * d * log(4.0, 20.0),
    )


def recorded(loop: Drawn, made: Simulation) -> glapp.Recording:
    """A historian's data of a simulated day."""
    table = made.to_arrow().drop_columns(["POSITION", "LOAD"])
    return glapp.recording_from(table, glapp.Loop(name=f"L{loop.number}", op_unit="%", op_span=(-50, 50)))


def ask_hours(number: int) -> dict[str, Any]:
    """Ask a short recording with a gap how many more hours would show it, and record them."""
    loop = drawn(number)
    short = loop.h * round(loop.t_end * Random(f"plan/hours/{number}").uniform(*SHORT) / loop.h)
    [made] = run_many([loop.scenario("gap", number, short)], progress=False)
    recording = recorded(loop, made)
    result = glapp.analyze(recording)
    row: dict[str, Any] = {"number": number, "from": "gap", "confidence": result.answer.confidence}
    if result.answer.confidence not in ("likely", "cannot_tell"):
        return row | {"refused": "the answer is not open"}
    try:
        test = plan_test(recording, result, width=loop.d, kinds=("more_hours",))["more_hours"]
    except glapp.InputError as error:
        return row | {"refused": str(error)}
    if test.power is None or test.minutes is None:
        return row | {"refused": test.reason}
    if 60 * test.minutes > LONGEST * short:
        return row | {"refused": f"{test.minutes:.0f} min are too long to be recorded here"}
    more = loop.h * math.ceil(60 * test.minutes / loop.h)
    steps = sum(t < short for t, _ in loop.setpoint)
    seeds = range(1000 * number + 1, 1000 * number + 1 + DAYS["more_hours"])
    days = run_many(
        [_goes_on(loop, seed, steps, short, more).scenario("gap", seed, more) for seed in seeds], progress=False
    )
    found = [analyze_recordings([recording, recorded(loop, day)]).answer for day in days]
    return row | {
        "minutes": test.minutes,
        "promised": [test.power],
        "simulated": [float(np.mean([one.confidence == "found" for one in found]))],
        "wrong": sum(one.confidence in ("sound", "none_seen") and (one.high or 0.0) < loop.d for one in found),
    }


def _goes_on(loop: Drawn, seed: int, steps: int, period: float, t_end: float) -> Drawn:
    """The loop with other steps of SP, so many in each period as the short recording has."""
    random = Random(f"plan/hours/{loop.number}/{seed}")
    times = sorted((k + random.random()) * period for k in range(math.ceil(t_end / period)) for _ in range(steps))
    levels = {loop.h * round(t / loop.h): loop.kp * loop.d * random.uniform(-2.5, 2.5) for t in times}
    return replace(loop, setpoint=tuple(levels.items()))


def ask(number: int, kind: planning.Kind) -> dict[str, Any]:
    """Plan one test, and make it."""
    loop = drawn(number)
    fault = ("gap", "none")[number // 2 % 2]
    [made] = run_many([loop.scenario(fault, number, loop.t_end)], progress=False)
    recording = recorded(loop, made)
    result = glapp.analyze(recording)
    row: dict[str, Any] = {"number": number, "from": fault, "confidence": result.answer.confidence}
    op, pv = (float(np.median(x[-planning.LATE :])) for x in (made.op, made.pv))
    began = monotonic()
    try:
        plan = plan_test(
            recording,
            result,
            op_within=(op - loop.op_room, op + loop.op_room),
            pv_within=(pv - loop.pv_room, pv + loop.pv_room),
            minutes=MINUTES,
            width=loop.d,
            kinds=(kind,),
        )
    except glapp.InputError as error:
        return row | {"refused": str(error)}
    test = plan[kind]
    row["seconds"] = monotonic() - began
    if test.power is None or test.hold is None or test.pv is None:
        return row | {"refused": test.reason}
    moves = np.array(test.moves) - test.moves[0]
    begin = loop.h * round(30 * loop.lag / loop.h)
    t_end = begin + test.hold * len(moves)
    first, share, wrong, passed, decided = round(begin / loop.h), dict[str, float](), 0, 0, list[float]()
    for fault in ("gap", "none"):
        seeds = range(1000 * number + 1, 1000 * number + 1 + DAYS[kind])
        if kind == "by_hand":
            # The loop runs in automatic until the person begins; then OP goes on from where it stands.
            before = run_many([loop.scenario(fault, seed, begin) for seed in seeds], progress=False)
            days = [
                loop.scenario(fault, seed, t_end, _by_hand(begin, test.hold, float(day.op[-1]) + moves, loop.h))
                for seed, day in zip(seeds, before, strict=True)
            ]
        else:
            steps = tuple((begin + i * test.hold, float(move)) for i, move in enumerate(moves))
            days = [replace(loop, setpoint=steps).scenario(fault, seed, t_end) for seed in seeds]
        found: list[str | None] = []
        took = []
        for one in run_many(days, progress=False):
            rows = slice(first, None)
            stands = float(np.median(one.pv[first - planning.LATE : first]))
            beyond = np.flatnonzero(np.abs(one.pv[rows] - stands) > loop.pv_room)
            passed += bool(len(beyond))
            signals: dict[str, Any] = {"t": one.t[rows], "pv": one.pv[rows], "op": one.op[rows]}
            if kind == "by_hand":
                word, ended = _guided(signals, test.hold, loop)
                found.append(word)
                took.append(ended - test.hold)  # from the first move on
            else:
                answer = glapp.fit(**signals, sp=one.sp[rows], loop=recording.loop)
                found.append(fit_decides(answer, loop.d))
        gaps, none = (sum(decision == word for decision in found) for word in ("gap", "no_gap"))
        share[fault] = (gaps if fault == "gap" else none) / DAYS[kind]
        wrong += none if fault == "gap" else gaps
        decided += [seconds / 60 for word, seconds in zip(found, took, strict=False) if word is not None]
    return row | {
        "kind": kind,
        "minutes": test.minutes,
        "three_moves": len(moves) == THREE_MOVES + 1,
        "promised": [test.with_gap, test.without],
        "simulated": [share["gap"], share["none"]],
        "wrong": wrong,
        "passed": passed,
        "decided_after": decided,
        "moves": len(moves) - 1,
    }


def _guided(signals: dict[str, Any], hold: float, loop: Drawn) -> tuple[str | None, float]:
    """Decision of a test that is looked at `LOOKS` times in each hold, and its time [s since its first row]."""
    t = signals["t"] - signals["t"][0]
    for at in np.arange(3 * hold, t[-1], hold / LOOKS):  # no reversal comes before
        rows = slice(0, int(np.searchsorted(t, at)))
        read = glapp.step_test(**{name: x[rows] for name, x in signals.items()}, manual=True, width=loop.d)
        if read.asked is not None and read.asked.early is not None:
            return read.asked.early, float(at)
    read = glapp.step_test(**signals, manual=True, width=loop.d)
    return None if read.asked is None else read.asked.found, float(t[-1])


def _by_hand(begin: float, hold: float, levels: Any, h: float) -> tuple[Manual, ...]:
    ends = [begin + (i + 1) * hold + h * (i == len(levels) - 1) for i in range(len(levels))]
    return tuple(
        Manual(begin=begin + i * hold, end=end, op=float(op))
        for i, (end, op) in enumerate(zip(ends, levels, strict=True))
    )


def table(lines: list[dict[str, Any]]) -> str:
    """Table of the counts."""
    made = [one for one in lines if "promised" in one]
    text = [f"{len(lines)} loops, {len(made)} planned, {len(lines) - len(made)} refused"]
    if not made:
        return text[0]
    promised, simulated = (np.array([one[key] for one in made]) for key in ("promised", "simulated"))
    both = zip(("with the gap", "without"), promised.T, simulated.T, strict=False)
    for name, p, s in both:
        half = 1.96 * float(np.std(s - p, ddof=1)) / math.sqrt(len(made))
        text.append(
            f"{name}: promised {p.mean():.1%}, simulated {s.mean():.1%}; simulated - promised {(s - p).mean():+.1%} "
            f"({(s - p).mean() - half:+.1%} to {(s - p).mean() + half:+.1%})"
        )
    if "passed" not in made[0]:  # more hours: nothing is moved
        longer = [one["minutes"] for one in made]
        text.append(f"median of the hours planned {np.median(longer) / 60:.1f}; wrong: {sum(x['wrong'] for x in made)}")
        return "\n".join(text)
    near = np.abs(promised.min(axis=1) - simulated.min(axis=1))
    sure = promised.min(axis=1) >= planning.POWER
    tests = 2 * DAYS[made[0].get("kind", "by_hand")] * len(made)
    decided = [one for one in made if one["decided_after"]]
    if decided:
        after = [x for one in decided for x in one["decided_after"]]
        three = [THREE_MOVES * one["minutes"] / one["moves"] for one in decided]
        ratio = [np.median(one["decided_after"]) / time for one, time in zip(decided, three, strict=True)]
        text.append(
            f"median time to a decision {np.median(after):.1f} min; of three moves, each held to its end, "
            f"{np.median(three):.1f} min; median of their ratio in a loop {np.median(ratio):.2f}"
        )
    text += [
        f"power within 10 points in {np.sum(near <= 0.1)} of {len(made)} loops, within 20 in {np.sum(near <= 0.2)}",
        f"promised 90 % or more: {sure.sum()} loops, promised {promised[sure].mean():.1%}, simulated "
        f"{simulated[sure].mean():.1%}",
        f"wrong: {sum(one['wrong'] for one in made)} of {tests} tests",
        f"limits of PV passed: {sum(one['passed'] for one in made)} of {tests} tests, in "
        f"{sum(one['passed'] > 0 for one in made)} loops",
        f"median time planned {np.median([one['minutes'] for one in made]):.0f} min; three moves in "
        f"{sum(one['three_moves'] for one in made)}; median time to plan "
        f"{np.median([one['seconds'] for one in made]):.1f} s",
    ]
    return "\n".join(text)


def main() -> None:
    """Run all tests, and print the counts."""
    parser = argparse.ArgumentParser(prog="python -m bench.plan", description=__doc__.split("\n\n")[0])
    parser.add_argument("--half", choices=("A", "B"), default="B")
    parser.add_argument("--loops", type=int, default=40)
    parser.add_argument("--kind", choices=("by_hand", "setpoint", "more_hours"), default="by_hand")
    parser.add_argument("--first", type=int, default=0, help="from this number on")
    parser.add_argument("--out", type=Path, help="a line of JSON for each loop")
    parser.add_argument("--count", type=Path, nargs="+", help="ask nothing, and count the lines of such files together")
    given = parser.parse_args()
    if given.count:
        print(table([json.loads(line) for file in given.count for line in file.read_text("utf-8").splitlines()]))
        return
    lines = []
    begin = given.first + (given.first % 2 != (given.half == "B"))
    for number in range(begin, begin + 2 * given.loops, 2):
        lines.append(ask_hours(number) if given.kind == "more_hours" else ask(number, given.kind))
        if given.out is not None:
            with given.out.open("a", encoding="utf-8") as file:
                print(json.dumps(lines[-1]), file=file)
    print(table(lines))


if __name__ == "__main__":
    main()
