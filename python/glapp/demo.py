"""Recordings to try glapp on, as a plant's historian would export them, from loops whose dead band is known.

| recording | what it is | true dead band |
|---|---|---|
| FIC201 | a worn valve, a clear cycle | 2.4 % |
| PIC305 | a worn valve behind measurement noise | 3.0 % |
| LIC110 | a sound valve; the load swings, the loop with it | none |
| FIC402 | a worn valve, stepped in manual: the step test | 1.5 % |
| TIC118 | a worn valve, and nobody wrote down the settings | 1.6 % |
"""

from __future__ import annotations

import errno
import math
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

from .controller import Ideal
from .plant import Plant
from .reading.settings import parse_settings
from .recording import NOT_AUTO
from .simulate import Simulation, closed_loop, random_walk
from .writing import write_file

__all__ = ["write_recordings"]

LOOPS = """\
# The loops of this folder, each as its own control system shows it.
# Check a file with `glapp analyze loops.toml`; write a first one for your own recording with `glapp init FILE`.

[defaults]
op_span = [0, 100]
acceptable_dead_band = 1.0
time_zone = "Europe/Stockholm"

[loops.FIC201]
file = "FIC201.csv"
pv_span = [0, 80]
pv_unit = "m3/h"
area = "Boiler house"
valve = "globe, DN80"
process = { kp = 1.0, kp_unit = "%/%" }
controller = { pb = 80, ti = 5, ti_unit = "repeats/min", pv_filter = 1.0 }

[loops.PIC305]
file = "PIC305.csv"
pv_span = [0, 16]
pv_unit = "bar"
area = "Steam"
valve = "segment, DN150"
positioner = { type = "electro-pneumatic", dead_band = 0.2 }
controller = { form = "parallel", kp = 0.48, ki = 3.84, ti_unit = "min", gain_unit = "%/%", pv_filter = 0.75 }

[loops.LIC110]
file = "LIC110.csv"
pv_span = [0, 100]
pv_unit = "%"
area = "Tank farm"
process = { type = "integrating" }
controller = { k = 1.5, ti = 7, ti_unit = "min", action = "direct" }

[loops.FIC402]
file = "FIC402.csv"
pv_span = [0, 250]
pv_unit = "l/min"
area = "Bleaching"
controller = { form = "series", k = 0.6, gain_unit = "%/%", ti = 10, td = 1 }

[loops.TIC118]  # no controller settings: K and Ti are identified from the recording
file = "TIC118.csv"
pv_span = [0, 180]
pv_unit = "°C"
area = "Drying"
"""

_BEGIN = datetime(2026, 3, 2, 6, 0, tzinfo=UTC)


@dataclass(frozen=True)
class _Export:
    """Format of one historian: header, time stamp, decimal mark and separator."""

    header: str
    stamp: Callable[[datetime], str]
    decimal: str = "."
    separator: str = ","
    mode: bool = True


def write_recordings(folder: str | Path, *, force: bool = False) -> list[Path]:
    """Write the recordings and their `loops.toml` into a folder, which is made where it is missing.

    Every signal comes from the simulator, with one sample a second; the same files every time.

    - `folder`: the folder.
    - `force`: whether files of these names that hold something else are overwritten.

    Raises FileExistsError where there is such a file, by its name, before anything is written.

    Returns the CSV files, then `loops.toml`.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     [path.name for path in write_recordings(folder)]
    ['FIC201.csv', 'PIC305.csv', 'LIC110.csv', 'FIC402.csv', 'TIC118.csv', 'loops.toml']
    """
    folder = Path(folder)
    if folder.exists() and not folder.is_dir():
        raise NotADirectoryError(errno.ENOTDIR, "is a file, not a folder", str(folder))
    texts = {f"{name}.csv": _text(made(_controllers()[name]), _EXPORTS[name]) for name, made in _SIMULATIONS.items()}
    texts["loops.toml"] = LOOPS
    files = {folder / name: text.encode() for name, text in texts.items()}
    for path, data in files.items():
        if not force and path.exists() and path.read_bytes() != data:
            raise FileExistsError(errno.EEXIST, "exists already and holds something else", str(path))
    folder.mkdir(parents=True, exist_ok=True)
    for path, data in files.items():
        write_file(path, data)
    return list(files)


def _controllers() -> dict[str, Ideal]:
    """Controllers exactly as `LOOPS` has them, and the one that it keeps to itself."""
    loops = parse_settings(LOOPS, "loops.toml", Path())
    return {loop.name: loop.ideal() or Ideal(k=0.65, ti=18.0, td=0.0, b=1.0) for loop in loops}


def _lags(gain: float, *times: float) -> Plant:
    """Plant of a static gain and some time constants [s], without dead time."""
    return math.prod((Plant([1], [time, 1]) for time in times), start=Plant([gain], [1]))


def _worn(controller: Ideal) -> Simulation:
    return closed_loop(
        _lags(0.8, 6.0, 6.0, 6.0),
        controller,
        d=2.4,
        noise=0.08,
        h=1.0,
        t_end=3 * 3600,
        setpoint=[(0, 46.0), (4000, 48.5)],
        load=[(1500, 2.0), (2700, -1.0), (5600, 1.5), (7000, -2.5), (9000, 0.5)],
        limits=(0.0, 100.0),
        tf=1.0,
        seed=2,
    )


def _worn_in_noise(controller: Ideal) -> Simulation:
    n = 4 * 3600
    # P3 of the test batch (thesis 4.1), 24 times slower: a lag and two poles that swing.
    plant = ([0.16 * 9], [24.0**3, 3 * 24.0**2, 11 * 24.0, 9.0], 0.0)
    return closed_loop(
        plant,
        controller,
        d=3.0,
        noise=0.05,
        h=1.0,
        t_end=n,
        setpoint=[(0.0, 9.2)],
        load=random_walk(n + 1, h=1.0, rate=0.004, seed=5),
        limits=(0.0, 100.0),
        tf=0.75,
        seed=5,
    )


def _sound(controller: Ideal) -> Simulation:
    n = 4 * 3600
    inflow = 52.0 + 6.0 * np.sin(2 * np.pi * np.arange(n + 1) / 700.0)
    return closed_loop(
        ([-0.002], [4.0, 1.0, 0.0], 2.0),
        controller,
        d=0.0,
        noise=0.03,
        h=1.0,
        t_end=n,
        setpoint=[(0.0, 55.0)],
        load=-inflow,
        limits=(0.0, 100.0),
        seed=1,
        filter_in_loop=True,
    )


def _in_manual(controller: Ideal) -> Simulation:
    # Two steps one way, one back, and so on; the last one lies within the gap.
    moves: list[tuple[float, float] | tuple[float, float, float]] = [(0, 900)]
    moves += [(900.0 * i, 900.0 * (i + 1), op) for i, op in enumerate((42.0, 45.0, 41.0, 38.0, 42.0, 45.0, 44.0), 1)]
    return closed_loop(
        _lags(2.5, 4.0, 3.0, 1.0),
        controller,
        d=1.5,
        noise=0.6,
        h=1.0,
        t_end=7200,
        setpoint=[(0.0, 96.0)],
        load=random_walk(7201, h=1.0, rate=0.003, seed=4),
        limits=(0.0, 100.0),
        manual=moves,
        seed=4,
        filter_in_loop=True,
    )


def _without_settings(controller: Ideal) -> Simulation:
    n = 4 * 3600
    return closed_loop(
        _lags(1.8, 9.0, 9.0, 9.0),
        controller,
        d=1.6,
        noise=0.03,
        h=1.0,
        t_end=n,
        setpoint=[(0.0, 95.0)],
        load=random_walk(n + 1, h=1.0, rate=0.002, seed=2),
        limits=(0.0, 100.0),
        tf=0.0,
        seed=2,
    )


_SIMULATIONS: dict[str, Callable[[Ideal], Simulation]] = {
    "FIC201": _worn,
    "PIC305": _worn_in_noise,
    "LIC110": _sound,
    "FIC402": _in_manual,
    "TIC118": _without_settings,
}

_EXPORTS = {
    "FIC201": _Export("Timestamp,FIC201.SP,FIC201.PV,FIC201.OP,FIC201.MODE", lambda t: t.strftime("%Y-%m-%d %H:%M:%S")),
    "PIC305": _Export(
        "Zeit;PIC305/SP;PIC305/PV;PIC305/OUT;PIC305/MODE", lambda t: t.strftime("%d.%m.%Y %H:%M:%S"), ",", ";"
    ),
    "LIC110": _Export("time,LIC110.SP,LIC110.PV,LIC110.OP,LIC110.MODE", lambda t: t.strftime("%Y-%m-%dT%H:%M:%SZ")),
    "FIC402": _Export("DateTime,FIC402.SP,FIC402.PV,FIC402.MV,FIC402.MODE", lambda t: t.strftime("%Y/%m/%d %H:%M:%S")),
    "TIC118": _Export("t,SP,PV,OP", lambda t: f"{(t - _BEGIN).total_seconds():.0f}", mode=False),
}


def _text(s: Simulation, export: _Export) -> str:
    """A simulation as the text of an export."""
    lines = [export.header]
    for k in range(len(s.t)):
        cells = [export.stamp(_BEGIN + timedelta(seconds=k))]
        cells += [f"{x:.3f}".replace(".", export.decimal) for x in (s.sp[k], s.pv[k], s.op[k])]
        if export.mode:
            cells.append("MAN" if s.flags[k] & NOT_AUTO else "AUTO")
        lines.append(export.separator.join(cells))
    return "\n".join(lines) + "\n"
