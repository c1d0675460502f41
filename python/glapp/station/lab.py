"""The laboratory: simulated modules, in real time or faster, every variable live. It knows nothing of the service."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from html import escape
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import modules
from ..errors import InputError
from ..modules import Graph, Module

__all__ = ["FASTEST", "KINDS", "THESIS", "Lab", "Part", "Project", "diagram"]

FASTEST = 1000.0
"""Fastest speed of a simulation [simulated seconds a second]."""

KEPT = 40_000
"""Scans kept to be drawn."""

AT_ONCE = 20_000
"""Scans made at once at most, so that the pages are served meanwhile."""

KINDS: dict[str, type[Module]] = {
    name: getattr(modules, name)
    for name in (
        "Input",
        "Output",
        "Noise",
        "Sum",
        "Resolution",
        "Delay",
        "Backlash",
        "Friction",
        "Saturation",
        "RateLimit",
        "Filter2P",
        "PhaseLead",
        "ProcessSim",
        "Pid",
        "PidAdvanced",
        "AutoTuner",
        "BacklashDetection",
        "Stiction",
    )
}
"""Modules that a form can make: their parameters are numbers."""


@dataclass(frozen=True, slots=True)
class Part:
    """A module as it is written in the form.

    - `name`: its name in the loop.
    - `kind`: which module, one of `KINDS`.
    - `settings`: its parameters, as in "k=2, ti=2".
    """

    name: str
    kind: str
    settings: str = ""

    def module(self) -> Module:
        """The module.

        Raises InputError for a kind or a parameter that is none, or a value that is no number.

        Examples
        --------
        >>> Part("gap", "Backlash", "d=2.0").module()
        Backlash(d=2.0, start=None)
        >>> Part("gap", "Backlash", "width=2").module()
        Traceback (most recent call last):
        glapp.errors.InputError: width of gap: Backlash has no such parameter; it has d, start
        """
        if self.kind not in KINDS:
            raise InputError(f"there is no {self.kind!r}", parameter=self.name, hint=f"there are {', '.join(KINDS)}")
        kind = KINDS[self.kind]
        known = [one.name for one in fields(kind)]
        given: dict[str, Any] = {}
        for one in filter(None, (text.strip() for text in self.settings.replace("\n", ",").split(","))):
            key, equals, value = (text.strip() for text in one.partition("="))
            if key not in known:
                hint = f"it has {', '.join(known)}"
                raise InputError(f"{self.kind} has no such parameter", parameter=f"{key} of {self.name}", hint=hint)
            try:
                number = float(value)
            except ValueError:
                number = math.nan
            if not equals or not math.isfinite(number):
                raise InputError(f"is {value!r}, must be a number", parameter=f"{key} of {self.name}", value=value)
            given[key] = int(number) if number.is_integer() and key in ("n", "seed", "integer", "scans") else number
        try:
            return kind(**given)
        except TypeError as error:
            raise InputError(f"{self.kind}: {error}", parameter=self.name) from None


@dataclass(frozen=True, slots=True)
class Project:
    """A loop as it is written in the form.

    - `h`: scan time, > 0 [s].
    - `parts`: its modules.
    - `wires`: as `glapp.modules.Graph` takes them.
    - `shown`: what is drawn first.
    - `called`: what signals are called where they are drawn, by the module's name; the others by that.
    """

    h: float
    parts: tuple[Part, ...]
    wires: tuple[str, ...]
    shown: tuple[str, ...]
    called: Mapping[str, str] = field(default_factory=dict)


THESIS = Project(
    0.1,
    (
        Part("sp", "Input", "value=50"),
        Part("load", "Input", "value=5"),
        Part("pid", "Pid", "k=2, ti=2, low=0, high=100, start=50"),
        Part("watch", "BacklashDetection", "k=2, ti=2, kp=1, op_low=0, op_high=100, comp_size=1, comp_watch=1000"),
        Part("gap", "Backlash", "d=2.0"),
        Part("process", "ProcessSim", "gain=1, t1=3, t2=1, start=50"),
        Part("noise", "Noise", "amplitude=0.1"),
        Part("filter", "Filter2P", "tf=0.2"),
    ),
    (
        "pid -> gap -> process -> noise -> filter -> pid.pv",
        "sp -> pid.sp",
        "load -> process.load",
        "sp -> watch.sp",
        "noise -> watch.pv",
        "watch -> pid.ff",
    ),
    ("sp", "noise", "pid", "gap"),
    {"sp": "SP", "noise": "PV", "pid": "OP", "gap": "valve"},
)
"""The loop of figure 6.5, with its gap of 2.0 % (process, tuning and noise are not in the thesis)."""


class Lab:
    """A project that runs.

    Raises InputError for a project that is no loop; it names the module.

    Examples
    --------
    >>> lab = Lab(THESIS)
    >>> lab.speed = 1000.0
    >>> lab.advance(1.0)
    >>> f"{lab.t:.0f} s, {lab['watch.d_hat']:.1f} %"
    '1000 s, 1.9 %'
    """

    def __init__(self, project: Project) -> None:
        names = [part.name for part in project.parts]
        for name in names:
            if names.count(name) > 1:
                raise InputError("is there twice", parameter=name)
        self.project = project
        self._graph = Graph(project.h, {part.name: part.module() for part in project.parts}, project.wires)
        self.paths = tuple(self._graph)
        self.editable = frozenset(path for path in self.paths if self._takes(path))
        self.signals = tuple(path.removesuffix(".out") for path in self.paths if path.endswith(".out"))
        self.shown = tuple(path for path in project.shown if path in self.signals or path in self.paths)
        self.speed, self.running = 1.0, True
        self.late = 0.0
        self._due = 0.0
        self._begun = self.t
        self._times: NDArray[np.float64] = np.empty(0)
        self._columns: dict[str, NDArray[np.float64]] = {}

    def _takes(self, path: str) -> bool:
        """Whether a variable may be set: asked before the first scan, of the value that it has."""
        try:
            self._graph[path] = self._graph[path]
        except (InputError, TypeError):
            return False
        return True

    @property
    def t(self) -> float:
        """The simulated time [s]."""
        return self._graph.t

    def __getitem__(self, path: str) -> float | None:
        value: float | None = self._graph[path]
        return value if value is None or math.isfinite(value) else None

    def __setitem__(self, path: str, value: float | None) -> None:
        """Set a variable while it runs.

        Raises InputError with the bound that it breaks; all is as it was.
        """
        if path not in self.editable:
            raise InputError("is only shown", parameter=path)
        self._graph[path] = value

    def advance(self, elapsed: float) -> None:
        """Make the scans that are due after so much time on the wall.

        Where they are more than can be made at once, what is too much is given up, and `late` tells how much that was.

        - `elapsed`: ≥ 0 [s].
        """
        if not self.running:
            return
        h = self.project.h
        self._due += elapsed * self.speed
        n = math.floor(self._due / h + 1e-9)
        self.late = max(0.0, (n - AT_ONCE) * h)
        self._due -= n * h
        n = min(n, AT_ONCE)
        if n == 0:
            return
        found = self._graph.run(n * h, record=list(self.shown))
        times = found.pop("t")
        if tuple(found) != tuple(self._columns):
            self._times, self._columns = np.empty(0), {name: np.empty(0) for name in found}
        self._times = np.concatenate([self._times, times])[-KEPT:]
        for name, column in found.items():
            self._columns[name] = np.concatenate([self._columns[name], column])[-KEPT:]

    def label(self, signal: str) -> str:
        """Label of a signal in a drawing.

        >>> Lab(THESIS).label("noise"), Lab(THESIS).label("filter")
        ('PV', 'filter')
        """
        return self.project.called.get(signal, signal)

    @property
    def detector(self) -> str | None:
        """Name of the module that estimates the gap and can compensate; None where there is none."""
        names = (part.name for part in self.project.parts if part.kind in ("BacklashDetection", "PidAdvanced"))
        return next(names, None)

    @property
    def gap(self) -> float | None:
        """True width of the gap; None where the loop has none."""
        names = (part.name for part in self.project.parts if part.kind == "Backlash")
        name = next(names, None)
        return None if name is None else self[f"{name}.d"]

    def curves(self, seconds: float, most: int = 1200) -> dict[str, list[list[float]]]:
        """Points of the last simulated seconds: for each signal (time, value), `most` at most."""
        if not len(self._times):
            return {name: [] for name in self.shown}
        first = int(np.searchsorted(self._times, self._times[-1] - seconds))
        every = max(1, -(-(len(self._times) - first) // most))
        at = np.arange(first, len(self._times), every)
        return {
            name: np.column_stack([self._times[at], column[at]])[np.isfinite(column[at])].tolist()
            for name, column in self._columns.items()
        }


def _edges(wires: Sequence[str]) -> list[tuple[str, str, str]]:
    """Connections: module, module and input of each.

    >>> _edges(["pid -> gap -> pid.pv"])
    [('pid', 'gap', ''), ('gap', 'pid', 'pv')]
    """
    found = []
    for wire in wires:
        ends = [end.strip() for end in wire.split("->")]
        for a, b in pairwise(ends):
            target, _, place = b.partition(".")
            found.append((a.partition(".")[0], target, place))
    return found


def _columns(names: Sequence[str], edges: Sequence[tuple[str, str, str]]) -> Mapping[str, int]:
    """Column of each block: after all that drive it, but for what closes a circle."""
    column = dict.fromkeys(names, 0)
    ahead = {name: [b for a, b, _ in edges if a == name and b in column] for name in names}
    driven = {b for _, b, _ in edges}
    back: set[tuple[str, str]] = set()
    state: dict[str, int] = {}

    def visit(name: str) -> None:
        state[name] = 1
        for b in ahead[name]:
            if state.get(b) == 1:
                back.add((name, b))
            elif b not in state:
                visit(b)
        state[name] = 2

    for name in sorted(names, key=lambda one: one in driven):
        if name not in state:
            visit(name)
    for _ in names:
        for a, b, _ in edges:
            if a in column and b in column and (a, b) not in back:
                column[b] = max(column[b], column[a] + 1)
    for name in names:  # what nothing drives stands beside what it drives
        if name not in driven and ahead[name]:
            column[name] = max(0, min(column[b] for b in ahead[name]) - 1)
    return column


def diagram(project: Project) -> str:
    """The project as blocks and arrows, as SVG.

    >>> diagram(THESIS).count("<rect")
    8
    """
    names = [part.name for part in project.parts]
    edges = [(a, b, place) for a, b, place in _edges(project.wires) if a in names and b in names]
    columns = _columns(names, edges)
    rows: dict[int, int] = {}
    at = {}
    driven = {b for _, b, _ in edges}
    for name in sorted(names, key=lambda one: one not in driven):  # what nothing drives stands below
        row = rows.get(columns[name], 0)
        rows[columns[name]] = row + 1
        at[name] = (12 + 166 * columns[name], 14 + 92 * row)
    width = 12 + 166 * (max(columns.values(), default=0) + 1)
    lowest = 14 + 92 * max(rows.values(), default=0)
    entries = {name: [edge for edge in edges if edge[1] == name] for name in names}
    lines, labels, depth = [], [], 0
    for edge in edges:
        a, b, place = edge
        (x0, y0), (x1, y1) = at[a], at[b]
        x0, y0 = x0 + 116, y0 + 29
        y1 += 58 * (entries[b].index(edge) + 1) // (len(entries[b]) + 1)
        if place:  # over all lines
            labels.append(f'<text x="{x1 - 9}" y="{y1 - 4}" text-anchor="end" class="s">{escape(place)}</text>')
        if columns[b] == columns[a] + 1:
            middle = (x0 + x1) / 2
            path = f"M{x0},{y0} C{middle},{y0} {middle},{y1} {x1},{y1}"
        else:
            depth += 1  # back, or past others: in a lane of its own below all blocks
            low = lowest + 12 * depth
            path = f"M{x0},{y0} h{6 + 6 * depth} V{low} H{x1 - 22 - 6 * depth} V{y1} H{x1}"
        lines.append(f'<path d="{path}" fill="none" marker-end="url(#end)"/>')
    boxes = [
        f'<rect x="{at[part.name][0]}" y="{at[part.name][1]}" width="116" height="58" rx="5"/>'
        f'<text x="{at[part.name][0] + 58}" y="{at[part.name][1] + 26}" text-anchor="middle">{escape(part.name)}</text>'
        f'<text x="{at[part.name][0] + 58}" y="{at[part.name][1] + 44}" text-anchor="middle" class="s">'
        f"{escape(part.kind)}</text>"
        for part in project.parts
    ]
    height = lowest + 12 * depth + 14
    return (
        f'<svg class="blocks" viewBox="0 0 {width} {height}" role="img" aria-label="The loop as blocks">'
        '<defs><marker id="end" viewBox="0 0 8 8" refX="8" refY="4" markerWidth="7" markerHeight="7" orient="auto">'
        f'<path d="M0,0 L8,4 L0,8 z" class="tip"/></marker></defs>{"".join(lines + labels + boxes)}</svg>'
    )
