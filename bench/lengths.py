"""Whether more of one loop gives a better answer: `python -m bench.lengths`.

One record, asked about again and again: its first 3000 rows, its first 9000, and so on. With more rows the interval has
to hold the truth as often, it must not grow wider, a right verdict must not be lost, and no limit is negative. Every
answer goes to out/lengths.jsonl as soon as it is there; `--against FILE` holds them against older ones.
"""

from __future__ import annotations

import os

os.environ.setdefault("RAYON_NUM_THREADS", "1")  # many processes, each with its own core

import argparse
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from random import Random
from typing import NamedTuple

import numpy as np
import pyarrow as pa
from scipy import stats

import glapp
from glapp import tuning
from glapp.controller import Controller
from glapp.errors import InputError
from glapp.scenario import Coloured, Gaussian, Piece, Samples, Scenario, Sine, Steps
from glapp.simulate import Simulation, closed_loop, run

from .asking import answers_of
from .loads.answer import LoadsAnswer, against, read
from .loads.records import ROWS, Floats, Record, record
from .page import write
from .truth.design import INSIDE, base_plant, filter_time, log_uniform, scaled, time_scale, tuned_for
from .truth.score import markdown

OUT = Path(__file__).parents[1] / "out" / "lengths.jsonl"

LENGTHS = (3000, 9000, 28_800, 86_400, 100_000, 300_000, 600_000, 1_000_000)
"""Rows."""

TIMES = {"an hour": 3600.0, "a day": 86_400.0, "a week": 604_800.0}
"""[s]"""

LOADS = ("levels", "steps", "ramps", "day", "walk", "setpoint")
"""What moves the loop. "levels": three levels of the load in turn, half an hour each, always the same loop; steps of
the load about every half an hour; ramps of two hours; day and night, with a small walk; a slow walk that is drawn back;
steps of the setpoint about every half an hour, with a small walk of the load."""

RULES = ("Lambda T", "Lambda 3T", "AMIGO step", "SIMC", "MIGO 1.4")
"""Rules of `bench.truth`, without those that leave little margin."""

HALF_HOUR, TWO_HOURS, DAY = 1800.0, 7200.0, 86_400.0


def made(name: str, samples: int) -> Record:
    """The record of that name, "load/PI/gap/3", or of a row of `bench.loads`, "walk/gap/3"; of so many samples.

    A longer one begins with the shorter one.
    """
    if name.count("/") == 2:
        return record(name, samples)
    load, kind, gap, number = name.split("/")
    if gap not in ("none", "gap") or kind not in ("PI", "PID") or load not in LOADS:
        raise ValueError(f"{name}: write one of {LOADS}, PI or PID, 'none' or 'gap', and a number")
    if load == "levels":
        return _levels(name, samples)
    random, of_load = (Random(f"{load}/{kind}/{number}{part}") for part in ("", "/load"))
    tuned = None
    while tuned is None:
        process = random.choice(list(INSIDE))
        tuned = _robust(process, random.choice(RULES), kind)
    base = base_plant(process)
    # The historian's clock is even; the process is so fast or slow that Ti is 2 to 100 of its samples.
    h = random.choice((1.0, 10.0))
    slower = h / log_uniform(random, 0.01, 0.5) / tuned.controller.ti
    gain = random.choice((0.5, 1.0, 1.6))
    k, ti, td = tuned.controller.k / gain, tuned.controller.ti * slower, tuned.controller.td * slower
    integrating = base.gain is None
    kp = gain * (base.velocity_gain or 0.0) * ti / slower if integrating else gain
    d = log_uniform(random, 0.5, 3.0)
    size = d * log_uniform(random, 1.0, 5.0)
    # Nobody leaves a gain at which noise alone moves OP by more than this.
    sigma = min(kp * d * log_uniform(random, 0.02, 0.3), 0.3 / abs(k))
    lag = slower * time_scale(base).lag
    every = math.ceil(h / min(ti / 20, lag / 10, filter_time(ti, td) / 2))
    t = np.arange((samples - 1) * every + 1) * (h / every)
    moving, setpoint = _moving(load, of_load, d, size, t, gain)
    at_rest = [Steps(steps=((0.0, -50.0),))] if integrating else []  # so that OP rests at 50 %
    scenario = Scenario(
        plant=scaled(base, gain, slower),
        controller=Controller(k=abs(k), ti=ti, td=td, setpoint_weight=random.choice((0.0, 1.0)), gain_unit="OP/PV"),
        pv_span=(0, 100),
        op_span=(0, 100),
        limits=(0.0, 100.0),
        d=d if gap == "gap" else 0.0,
        noise=(Gaussian(sigma=sigma),),
        setpoint=(setpoint,),
        load=(*at_rest, *moving),
        h=h / every,
        t_end=t[-1],
        seed=random.randrange(2**32),
        filter_in_loop=True,
    )
    loop = glapp.Loop(
        name=name,
        pv_span=(0, 100),
        op_span=(0, 100),
        controller=scenario.controller,
        process=glapp.loop.Process(type="integrating" if integrating else "self-regulating"),
    )
    loops = {"d": scenario.d, "size": size, "gain": kp, "lag": lag, "sigma": sigma}
    return _kept(run(scenario), every, loop, **loops)


def _moving(load: str, random: Random, d: float, size: float, t: Floats, gain: float) -> tuple[list[Piece], Piece]:
    """Pieces of the load at the process input [% of OP], and the setpoint [PV unit]; one of the two moves most.

    - `d`, `size`: width of the gap, and size of the moves [% of OP].
    - `t`: times of the simulation [s]; `gain`: PV units per per cent of OP.
    """
    setpoint: Piece = Steps(steps=((0.0, 50.0 * gain),))
    if load == "steps":
        return [Samples(values=_stairs(random, size, t))], setpoint
    if load == "ramps":
        return [Samples(values=_ramps(random, size, t))], setpoint
    if load == "walk":
        return [_walk(size / math.sqrt(TWO_HOURS))], setpoint
    small = _walk(0.2 * d / math.sqrt(HALF_HOUR))
    if load == "day":
        return [small, Sine(amplitude=size, period=DAY)], setpoint
    return [small], Samples(values=50.0 * gain + gain * _stairs(random, size, t))


@lru_cache
def _robust(process: str, rule: str, kind: str) -> tuning.Tuning | None:
    """The tuning where it leaves a margin with the filter too, Ms ≤ 2.5; else None."""
    tuned = tuned_for(process, rule, kind)
    if tuned is None:
        return None
    k, ti, td, _ = tuned.controller
    try:
        ms = tuning.assess(base_plant(process), (k, ti, td), tf=filter_time(ti, td)).ms
    except InputError:
        return None
    return tuned if ms <= 2.5 else None


def _levels(name: str, samples: int) -> Record:
    """Always the same loop, with a seed that follows from the number."""
    _, _, gap, number = name.split("/")
    d = 1.5 if gap == "gap" else 0.0
    simulation = closed_loop(
        ([1.5], [30, 13, 1], 2.0),
        (0.6, 12.0, 0, 0),
        d=d,
        noise=0.1,
        h=1.0,
        seed=1 + int(number),
        t_end=samples - 1.0,
        setpoint=[(0, 50.0)],
        load=[(HALF_HOUR * k, 5.0 * (k % 3)) for k in range(200)],
        filter_in_loop=True,
    )
    loop = glapp.Loop(name=name, pv_span=(0, 100), op_span=(0, 100))
    return _kept(simulation, 1, loop, d=d, size=10.0, gain=1.5, lag=13.0, sigma=0.1 / math.sqrt(3))


def _kept(simulation: Simulation, every: int, loop: glapp.Loop, **loops: float) -> Record:
    """Every so many samples of a simulation."""
    kept = slice(0, None, every)
    names = {"t": simulation.t, "SP": simulation.sp, "PV": simulation.pv, "OP": simulation.op}
    table = pa.table({name: values[kept].copy() for name, values in names.items()})
    return Record(table, loop, simulation.op[kept].copy(), simulation.position[kept].copy(), **loops)


def _walk(rate: float) -> Coloured:
    """A walk by `rate`·√t in t seconds that is drawn back before it is 10 % away."""
    return Coloured(sigma=10.0, tau=2 * (10.0 / rate) ** 2)


def _values(random: Random, size: float, until: float, apart: Callable[[], float]) -> tuple[Floats, Floats]:
    """Times from 0 to `until` or later, and random values at them; 0 at first."""
    times, values = [0.0], [0.0]
    while times[-1] <= until:
        times.append(times[-1] + apart())
        values.append(random.uniform(-size, size))
    return np.array(times), np.array(values)


def _stairs(random: Random, size: float, t: Floats) -> Floats:
    times, values = _values(random, size, float(t[-1]), lambda: HALF_HOUR * random.uniform(0.5, 1.5))
    stairs: Floats = values[np.searchsorted(times, t, side="right") - 1]
    return stairs


def _ramps(random: Random, size: float, t: Floats) -> Floats:
    times, values = _values(random, size, float(t[-1]), lambda: TWO_HOURS)
    return np.interp(t, times, values)


def asked(name: str, lengths: Sequence[int]) -> list[LoadsAnswer]:
    """Answers for the beginnings of one record, the shortest first."""
    whole = made(name, max(lengths))
    return [LoadsAnswer.to(whole, samples) for samples in sorted(lengths)]


def lost(answers: Iterable[LoadsAnswer]) -> Iterator[tuple[LoadsAnswer, LoadsAnswer]]:
    """Answers of one record that were right with fewer rows and are no more: the one before, and the one now.

    They are in ascending length.
    """
    return ((before, now) for before, now in pairwise(answers) if before.outcome == "right" != now.outcome)


class Length(NamedTuple):
    """A line of the table, and the answers that belong to it."""

    title: str
    answers: list[LoadsAnswer]


def by_rows(answers: Sequence[LoadsAnswer]) -> list[Length]:
    """A line for each number of rows."""
    lengths = sorted({answer.truth.samples for answer in answers})
    return [Length(f"{n}", [a for a in answers if a.truth.samples == n]) for n in lengths]


def by_time(answers: Sequence[LoadsAnswer]) -> list[Length]:
    """A line for each length of time, and time between samples."""
    return [
        Length(f"{title} at {h:g} s", [a for a in answers if (a.truth.h, a.truth.samples) == (h, round(seconds / h))])
        for h in sorted({answer.truth.h for answer in answers})
        for title, seconds in TIMES.items()
    ]


def table(answers: Sequence[LoadsAnswer], lengths: Callable[[Sequence[LoadsAnswer]], list[Length]]) -> str:
    """A line a length; what is lost, and how the width grew, is against the next shorter one of the same record."""
    head = ["length", "gap", "width", "bound", "silent", "claims hold", "error", "interval/d", "against shorter"]
    head += ["cause right", "lost", "no gap", "claimed", "sound", "sound is true", "lost", "limits below 0", "seconds"]
    shorter: dict[tuple[str, int], LoadsAnswer] = {}
    for name in dict.fromkeys(a.truth.name for a in answers):
        by_length = sorted((a for a in answers if a.truth.name == name), key=lambda a: a.truth.samples)
        shorter |= {now.key: before for before, now in pairwise(by_length)}

    def line(title: str, selected: list[LoadsAnswer]) -> list[str]:
        gap, none = ([a for a in selected if (a.truth.d > 0) == there] for there in (True, False))
        sided = [a for a in gap if a.sided]
        claims, sound = [a for a in gap if a.claims], [a for a in selected if a.verdict == "sound"]
        grown = [_width(a) / _width(b) for a in sided if (b := shorter.get(a.key)) is not None and b.sided]
        lost_here = [a for a in selected if any(lost((b, a) if (b := shorter.get(a.key)) is not None else ()))]
        return [
            title,
            *(f"{len(gap)}", f"{len(sided)}", f"{sum(a.verdict == 'at_least' for a in gap)}"),
            f"{sum(a.outcome == 'silent' for a in gap)}",
            f"{sum(a.holds for a in claims)} of {len(claims)}",
            _median([(a.d or 0.0) / a.truth.d - 1 for a in sided], "{:+.1%}"),
            _median([_width(a) / a.truth.d for a in sided], "{:.2g}"),
            _median(grown, "{:.2g}"),
            f"{sum(a.verdict == 'backlash' for a in sided)} of {len(sided)}",
            f"{sum(a.truth.d > 0 for a in lost_here)}",
            *(f"{len(none)}", f"{sum(a.claims for a in none)}", f"{sum(a.verdict == 'sound' for a in none)}"),
            f"{sum(a.holds for a in sound)} of {len(sound)}",
            f"{sum(a.truth.d == 0 for a in lost_here)}",
            f"{sum(a.lowest < 0 for a in selected)}",
            _median([a.seconds for a in selected], "{:.1f}"),
        ]

    return markdown(head, [line(*length) for length in lengths(answers) if length.answers])


def longer(answers: Sequence[LoadsAnswer], lengths: Callable[[Sequence[LoadsAnswer]], list[Length]]) -> str:
    """Each length against the next shorter one, over the records that have both: whether it is worse beyond chance.

    Worse is wrong against right or silent, and silent against right. By chance as many get worse as better: p is the
    binomial probability that so many or more of those that change get worse.
    """
    rank = {"wrong": 0, "silent": 1, "right": 2}
    head = ["from", "to", "records", "right", "then", "wrong", "then", "better", "worse", "p"]
    body = []
    for short, long in pairwise(lengths(answers)):
        then = {a.truth.name: a.outcome for a in short.answers}
        both = [(then[a.truth.name], a.outcome) for a in long.answers if a.truth.name in then]
        if not both:
            continue
        changes = [rank[now] - rank[was] for was, now in both]
        better, worse = sum(x > 0 for x in changes), sum(x < 0 for x in changes)
        p = stats.binomtest(worse, better + worse, alternative="greater").pvalue if better + worse else 1.0
        counts = [[pair[i] for pair in both].count(outcome) for outcome in ("right", "wrong") for i in (0, 1)]
        body.append([short.title, long.title, *map(str, [len(both), *counts, better, worse]), f"{p:.2g}"])
    return markdown(head, body)


def _width(answer: LoadsAnswer) -> float:
    """Width of the interval."""
    return (np.inf if answer.high is None else answer.high) - (answer.low or 0.0)


def _median(values: Sequence[float], form: str) -> str:
    return form.format(float(np.median(values))) if values else ""


def _ask(task: tuple[str, Sequence[int], bool]) -> list[LoadsAnswer]:
    name, lengths, times = task
    if times:
        h = made(name, 2).truth(2).h
        lengths = [round(seconds / h) for seconds in TIMES.values()]
    return asked(name, lengths)


def main() -> None:
    """Run, and print the tables."""
    parser = argparse.ArgumentParser(prog="python -m bench.lengths", description=__doc__.split("\n\n")[0])
    parser.add_argument("--each", type=int, default=5, help="so many records of each load, PI and PID, gap and none")
    parser.add_argument("--first", type=int, default=0, help="number of the first")
    text = f"of {', '.join(LOADS)}; or rows of bench.loads: {', '.join(ROWS)}, in which case PI or PID does not matter"
    parser.add_argument("--loads", type=lambda text: text.split(","), default=LOADS, help=text)
    parser.add_argument("--rows-of-loads", action="store_true", help="the loads are rows of bench.loads")
    size = parser.add_mutually_exclusive_group()
    size.add_argument("--lengths", type=lambda text: [int(n) for n in text.split(",")], default=LENGTHS, help="rows")
    size.add_argument("--times", action="store_true", help="an hour, a day and a week at 1 s and at 10 s")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument("--out", type=Path, default=OUT, help="where the answers go")
    parser.add_argument("--against", type=Path, help="older answers")
    parser.add_argument("--docs", action="store_true", help="write the tables into bench/results/truth.md")
    given = parser.parse_args()
    kinds = ("",) if given.rows_of_loads else ("PI/", "PID/")
    names = [
        f"{load}/{kind}{gap}/{number}"
        for number in range(given.first, given.first + given.each)
        for load in given.loads
        for kind in kinds
        for gap in ("gap", "none")
        if (load, kind) != ("levels", "PID/")
    ]
    before = [] if given.against is None else read(given.against)
    given.out.parent.mkdir(exist_ok=True)
    answers: list[LoadsAnswer] = []
    tasks = [(name, given.lengths, given.times) for name in names]
    with given.out.open("w", encoding="utf-8") as file:
        for of_record in answers_of(_ask, tasks, given.jobs):
            answers += of_record
            for answer in of_record:
                print(answer.to_json(), file=file, flush=True)
    lengths = by_time if given.times else by_rows
    parts = [f"{len(names)} records.\n\n{table(answers, lengths)}", longer(answers, lengths)]
    for load in given.loads:
        parts.append(f"*{load}*\n\n{table([a for a in answers if a.truth.row == load], lengths)}")
    print("\n\n".join(parts))
    print("\nRight with fewer rows, and lost:")
    for name in names:
        for was, now in lost(a for a in answers if a.truth.name == name):
            print(f"{name}: {was.truth.samples} rows {was}, {now.truth.samples} rows {now}: {now.reason}")
    if given.against is not None:
        print(f"\n{against(before, answers)}")
    if given.docs:
        write("truth.md", "\n\n".join(parts), "times" if given.times else "lengths")


if __name__ == "__main__":
    main()
