"""The demonstration: six loops whose valves are known, their earlier recordings, and the answers of a fit to them.

==========  ===========================================================  ======================
loop        what it is                                                   true width of the gap
==========  ===========================================================  ======================
FIC101      a worn valve whose loop cycles by it                         2.4 %
PIC102      a sound valve; another loop makes this one swing             none
TIC103      a valve that wears                                           0.8 %, +0.15 % a day
LIC104      a worn valve under a tightly tuned, noisy level              2.0 %
FIC105      a sound valve                                                none
TIC106      a worn valve in a loop that hardly moves                     1.5 %
==========  ===========================================================  ======================

Their signals are simulated when the demonstration begins, with the same numbers each time. Their fits take half a
minute, so the answers were made once from the same signals, by ``python -m glapp.service.demonstration``, and stand in
`demonstration.json`. `tests/test_service_demonstration.py` holds them to what the code answers.

Needs the extra `glapp[opcua]`.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..estimate import Estimator
from ..loop import Loop
from ..modules import Plant, ProcessSim
from ..writing import write_file
from .fits import answered, event_text
from .options import NIGHT
from .plant import Kind, SimLoop
from .recordings import SignalStore
from .resampler import Resampler
from .signal import Event
from .store import COLUMNS, Half, Store

__all__ = ["SCAN", "answers", "begin", "loops", "made"]

SCAN = 1.0
"""Scan time of the demonstration [s]."""

FILE = Path(__file__).with_name("demonstration.json")

DAYS = 6
"""Days before today with recordings, the older ones only of the valve that wears."""

EACH = 7200
"""Each of these recordings is so long [s]."""

LATELY = 1800
"""Length of the recording up to now [s]; no answer rests on it."""

_EPOCH = datetime(2000, 1, 10, tzinfo=UTC)
"""The day after the last recorded one in the answers as they are stored."""

_DATE = re.compile(r"2000-01-\d\d")
_OPENS = 8  # the hour of the day at which a recording begins, UTC


def _kinds() -> list[tuple[Kind, int]]:
    """The simulated loops, each with the number of days that it was recorded."""

    def lags(gain: float, t1: float, t2: float, dead: float) -> ProcessSim:
        return ProcessSim(gain=gain, t1=t1, t2=t2, dead_time=dead, start=50.0)

    level = Plant(([0.04], [1.0, 0.0]), start=50.0)
    flow, press, temp = lags(0.8, 10.0, 5.0, 3.0), lags(0.8, 20.0, 4.0, 2.0), lags(1.0, 40.0, 10.0, 5.0)
    return [
        (Kind("FIC", 1.25, 8.0, flow, 2.4, 0.0, 0.05, 2.0, 60.0, area="Boiler house", valve="globe, DN80"), 1),
        (
            Kind("PIC", 2.0, 20.0, press, 0.0, 0.0, 0.05, 1.0, 400.0, 0.0, (3.0, 120.0), "Steam", "segment, DN150"),
            1,
        ),
        (Kind("TIC", 0.6, 30.0, temp, 0.8, 0.15, 0.02, 4.0, 15.0, 0.5, None, "Drying", "globe, DN50"), DAYS),
        (Kind("LIC", 8.0, 10.0, level, 2.0, 0.0, 0.1, 3.0, 8.0, area="Tank farm", valve="ball, DN100"), 1),
        (
            Kind("FIC", 0.6, 6.0, lags(1.0, 4.0, 1.0, 1.0), 0.0, 0.0, 0.1, 8.0, area="Bleaching", valve="globe, DN65"),
            1,
        ),
        (Kind("TIC", 0.6, 30.0, temp, 1.5, 0.0, 0.05, 0.1, 30.0, 0.1, None, "Drying", "globe, DN50"), 1),
    ]


def loops() -> list[SimLoop]:
    """The loops of the demonstration, as they are now: the valve that wears has done so for `DAYS` days.

    Examples
    --------
    >>> [loop.name for loop in loops()]
    ['FIC101', 'PIC102', 'TIC103', 'LIC104', 'FIC105', 'TIC106']
    """
    made = [SimLoop(i, kind, SCAN, seed=1) for i, (kind, _) in enumerate(_kinds())]
    for loop in made:
        loop.age = float(DAYS)
    return made


def _recorded(simulated: Sequence[SimLoop], today: datetime, now: float) -> dict[str, NDArray[np.float64]]:
    """Recordings of each loop until now, a row of `Sample` each; the loops go on from there."""
    found = {}
    for loop, (_, days) in zip(simulated, _kinds(), strict=True):
        rows = []
        for day in range(DAYS - days, DAYS):
            loop.age = float(day)
            start = (today - timedelta(days=DAYS - day)).timestamp() + 3600.0 * _OPENS
            rows.append(_rows(loop, start, EACH))
        loop.age = float(DAYS)
        rows.append(_rows(loop, np.floor(now) - LATELY, LATELY))
        found[loop.name] = np.concatenate(rows)
    return found


def _rows(loop: SimLoop, start: float, scans: int) -> NDArray[np.float64]:
    """Simulated samples of a loop."""
    sp, pv, op, _ = loop.record(scans)  # the valve's position is not among the tags
    none = np.zeros(scans)
    return np.column_stack([start + SCAN * np.arange(scans), sp, pv, op, none, np.full(scans, np.nan), none])


def begin(store: Store, simulated: Sequence[SimLoop], known: Sequence[Loop], now: float) -> None:
    """Store the data of a service that had watched these loops: signals, half-periods, answers, states.

    - `store`: of a folder in which nothing is yet.
    - `simulated`: the loops; they go on from where this ends.
    - `known`: the same as `loops.toml` has them.
    - `now`: until when [s since 1970 UTC].

    Raises StoreFull, OSError where it cannot be written.
    """
    today = _midnight(now)
    recorded = _recorded(simulated, today, now)
    position = int(1000.0 * now)
    ids = store.know(known)
    SignalStore(store.folder).save(
        {name: (np.full(len(rows), position, np.int64), rows) for name, rows in recorded.items()}, position
    )
    halves: list[Half] = []
    states = {}
    for loop in known:
        rows, id = recorded[loop.name], ids[loop.name]
        detector = Estimator(loop, SCAN)
        t, sp, pv, op = (np.ascontiguousarray(rows[:, i]) for i in range(4))
        detector.update_many(t, sp, pv, op, rows[:, 4].astype(np.uint8))
        table = detector.half_periods
        columns = [getattr(table, name).tolist() for name in COLUMNS]
        ended = [(id, number, *row, 0) for number, row in enumerate(zip(*columns, strict=True), 1)]
        halves += ended
        state = {"rows": Resampler(SCAN).save(), "number": len(ended), "detector": detector.save()}
        states[id] = json.dumps(state)
    events = [Event(now, None, "demonstration", "a simulated plant: what is older than this was simulated in advance")]
    for name, answer in answers(today).items():
        store.add_answer(name, answer)
        events.append(Event(answer["time"], name, "answer", event_text(answer)))
    store.add([], halves, sorted(events, key=lambda event: event.time))
    store.save(position, states)


def answers(today: datetime) -> dict[str, dict[str, Any]]:
    """Answers of the fits of the night before a day, by loop, as rows of `answers`.

    - `today`: midnight, UTC.
    """

    def shifted(found: re.Match[str]) -> str:
        day = datetime.fromisoformat(found[0]).replace(tzinfo=UTC)
        return f"{today + (day - _EPOCH):%Y-%m-%d}"

    later = (today - _EPOCH).total_seconds()
    stored = json.loads(_DATE.sub(shifted, FILE.read_text(encoding="utf-8")))
    for answer in stored.values():
        answer["document"] = json.dumps(answer["document"])
        for name in ("time", "t_begin", "t_end"):
            answer[name] += later
    found: dict[str, dict[str, Any]] = stored
    return found


def made(loop: str | None = None) -> dict[str, dict[str, Any]]:
    """Answers that the code gives now, of all loops or one, in the form in which they are stored."""
    from ..reading.settings import parse_settings
    from .plant import SimPlant

    now = (_EPOCH + timedelta(hours=12)).timestamp()
    found = {}
    with TemporaryDirectory() as folder:
        simulated = loops()
        known = parse_settings(SimPlant(simulated, scan=SCAN).settings(), "the demonstration", Path())
        recorded = _recorded(simulated, _EPOCH, now)
        SignalStore(Path(folder)).save({name: (np.ones(len(x), np.int64), x) for name, x in recorded.items()}, 1)
        first, last = (_EPOCH - timedelta(days=DAYS)).timestamp(), _EPOCH.timestamp()
        for i, one in enumerate(known):
            if loop in (None, one.name):
                row = answered(Path(folder), one.model_dump_json(exclude_unset=True), first, last)
                row["document"] = json.loads(row["document"])
                found[one.name] = {"time": last + 60.0 * i, "asked_by": NIGHT, **row}
    return found


def _midnight(now: float) -> datetime:
    return datetime.fromtimestamp(now, UTC).replace(hour=0, minute=0, second=0, microsecond=0)


if __name__ == "__main__":
    write_file(FILE, json.dumps(made(), indent=1, sort_keys=True) + "\n")
