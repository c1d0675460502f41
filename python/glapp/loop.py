"""Everything known about one loop: where its signals are, their ranges and units, controller, valve."""

from __future__ import annotations

import re
from collections.abc import Iterator
from datetime import date, datetime
from pathlib import Path
from typing import Annotated, Any, Literal
from zoneinfo import ZoneInfo, available_timezones

from pydantic import AfterValidator, Field, field_validator, model_validator

from . import _glapp
from .checked import Checked, check_limits
from .controller import Controller, Ideal, Span
from .errors import InputError
from .notebook import table

__all__ = ["Cascade", "Columns", "Loop", "Positioner", "Process", "Tags", "TimeFormat", "op_unit"]

TimeFormat = Literal[
    "day first",
    "month first",
    "milliseconds",
    "seconds",
    "minutes",
    "hours",
    "days",
    "epoch s",
    "epoch ms",
    "epoch us",
    "epoch ns",
    "excel",
    "matlab",
    "julian",
]
"""Layout of a time column where the data does not show it: the order of a date, or the unit of its numbers."""


class Columns(Checked):
    """Column of each signal in a wide table, or its tag in a long one; the others are guessed.

    `time`, `tag`, `value` and `quality` always name columns; in a long table (one row per tag and time) the others name
    tags. `op_low_flag` and `op_high_flag` are the control system's own limit flags, `position` a measured valve
    position. An empty string says that there is none, where the guess would find a wrong one.
    """

    time: str | None = None
    sp: str | None = None
    pv: str | None = None
    op: str | None = None
    mode: str | None = None
    quality: str | None = None
    op_low_flag: str | None = None
    op_high_flag: str | None = None
    position: str | None = None
    tag: str | None = None
    value: str | None = None


_NODE = re.compile(r"(nsu=[^;]+;|ns=\d+;)?([sgb]=.+|i=\d+)", re.DOTALL)


def _node(text: str) -> str:
    """A node of OPC UA, checked."""
    if not _NODE.fullmatch(text):
        bound = "a node such as 'nsu=urn:plant;s=FIC101.PV' or 'ns=2;s=FIC101.PV'"
        raise InputError(f"is {text!r}, must be {bound}", value=text, bound=bound)
    return text


Node = Annotated[str, AfterValidator(_node)]
"""Name of a node of an OPC UA server. With `nsu=` it has the URI of its namespace, which no restart changes."""


class Tags(Checked):
    """Nodes of an OPC UA server that are the loop's signals; missing signals stay out.

    - `sp`, `pv`, `op`, `mode`, `low`, `high`, `position`: `low` and `high` are limit flags, `position` what the valve
      says of itself.
    - `u_ff`: the feed-forward that the controller adds to OP, the one node of the loop that may be written.
    - `u_ff_limit`: greatest |u_FF| that is ever written, > 0 [OP unit]; required with `u_ff`.
    - `u_ff_rate`: its greatest rate, > 0 [OP unit per second]; required with `u_ff`.
    """

    sp: Node | None = None
    pv: Node | None = None
    op: Node | None = None
    mode: Node | None = None
    low: Node | None = None
    high: Node | None = None
    position: Node | None = None
    u_ff: Node | None = None
    u_ff_limit: Annotated[float, Field(gt=0)] | None = None
    u_ff_rate: Annotated[float, Field(gt=0)] | None = None

    @property
    def nodes(self) -> dict[str, str]:
        """Name of each signal that has a node, and the node."""
        return {name: node for name in _SIGNALS if (node := getattr(self, name)) is not None}

    @model_validator(mode="after")
    def _whole(self) -> Tags:
        """Check that each node has one use, and that u_ff has its limits."""
        for name in ("u_ff_limit", "u_ff_rate"):
            if self.u_ff is not None and getattr(self, name) is None:
                raise InputError("is required with u_ff: nothing is written without it", parameter=name)
        nodes = self.nodes
        for name, node in nodes.items():
            if node in [other for key, other in nodes.items() if key != name]:
                raise InputError(f"{node} is named twice", parameter=name, value=node)
        return self


_SIGNALS = ("sp", "pv", "op", "mode", "low", "high", "position", "u_ff")


class Process(Checked):
    """Facts known of the process.

    - `type`: flow, pressure and temperature mostly regulate themselves; level mostly integrates.
    - `kp`: static gain Kp of a self-regulating process (not of the controller), not 0.
    - `kp_unit`: unit of `kp`.
    """

    type: Literal["self-regulating", "integrating"] = "self-regulating"
    kp: float | None = None
    kp_unit: Literal["%/%", "PV/OP"] | None = None

    @model_validator(mode="after")
    def _gain(self) -> Process:
        """Check the process gain."""
        if self.kp == 0.0:
            raise InputError("is 0, must not be 0", parameter="kp", value=0.0, bound="≠ 0")
        if self.kp is not None and self.type == "integrating":
            raise InputError("an integrating process has no static gain", parameter="kp", value=self.kp)
        return self


class Cascade(Checked):
    """Place in a cascade: the primary's OP is the secondary's SP. `partner` is the other loop's name."""

    role: Literal["primary", "secondary"]
    partner: str | None = None


class Positioner(Checked):
    """Valve positioner and the dead band it adds on purpose [% of travel], 0..100."""

    type: str | None = None
    dead_band: Annotated[float, Field(ge=0, le=100)] | None = None


class Loop(Checked):
    """One control loop.

    Parameters
    ----------
    name : str
        Name that appears in tables and reports.
    file : path, optional
        Recording of this loop.
    files : list of path
        In its place, several recordings of it: they get one answer.
    columns : Columns
        Columns or tags of the signals; those left out are guessed from common names.
    pv_span, op_span : (float, float), optional
        Range of PV and of OP [their units], low < high. Never taken from the range of the data.
    pv_unit, op_unit : str, optional
        Units for display. `op_unit` is "%" where `op_span` is absent or (0, 100). Where neither is given, a recording
        ends that assumption: with a value outside 0..100, or where OP stays within 0..1 (a fraction) or 4..20 (mA).
    opcua : Tags
        Its nodes where it is watched by OPC UA.
    controller : Controller, optional
        As the control system shows it; identified from the data where absent.
    process, cascade, positioner
        What is known about the process, the cascade and the valve's positioner.
    split_range : bool
        OP works on several valves.
    shared_valve_with : str, optional
        Name of another loop that works on the same valve (override, selector).
    valve, area : str, optional
        Type of the valve and part of the plant, for reports.
    acceptable_dead_band : float, optional
        Dead band that is tolerated [% of OP span], > 0, ≤ 100.
    dead_band_prior : float, optional
        Share of the plant's valves that are known to have a dead band [%], > 0, < 100; 25 where not given. It changes
        how probable a dead band is said to be, and the order of loops, never what is found.
    repaired : datetime, optional
        When the valve was last repaired, by the recording's own clocks where it has no zone. The answer is that of what
        was recorded after it.
    sample_time : float, optional
        Time between rows [s], > 0, ≤ 10⁷; needed only where the recording has no time column.
    time_zone : str, optional
        IANA name ("Europe/Stockholm") of times written without a zone.
    time_format : str, optional
        Needed only where the data leaves it open: "day first", "month first"; numbers that count "milliseconds",
        "seconds", "minutes", "hours" or "days" from any moment, "epoch s|ms|us|ns" since 1970, or days as "excel",
        "matlab" (datenum) or "julian" (Julian date) count them.
    auto_values : list of str or number, optional
        Words of the mode column that mean automatic; every other word then means not automatic.
    bad_values : list of str or number
        Further words or numbers that stand for a missing value, such as -9999.
    tf : float, optional
        Time constant of the detector's filter [s], > 0.
    n : int
        Detections behind one estimate, odd, 1 to 31.

    Raises
    ------
    InputError
        With the parameter, its value and its bound.

    Examples
    --------
    >>> loop = Loop(name="FIC101", pv_span=(0, 50), op_span=(0, 100), controller={"pb": 200, "ti": 30})
    >>> loop.ideal()
    Ideal(k=1.0, ti=30.0, td=0.0, b=1.0)
    >>> Loop(name="FIC101", pv_span=(50, 0))
    Traceback (most recent call last):
    glapp.errors.InputError: pv_span: goes from 50 to 0, must be low < high
    """

    def __repr_args__(self) -> Iterator[tuple[str | None, Any]]:
        """The given values, without those that have their default."""
        return ((key, getattr(self, key)) for key in type(self).model_fields if key in self.model_fields_set)

    def op_range(self) -> tuple[float, float] | None:
        """Span of OP [OP unit]; 0 to 100 where OP is in % and no other span is given; None where it is not known."""
        return (0.0, 100.0) if self.op_span is None and self.op_label == "%" else self.op_span

    def _repr_html_(self) -> str:
        """Table of the known values for a notebook."""
        return table(self.name, [(str(key), repr(value)) for key, value in self.__repr_args__() if key != "name"])

    name: Annotated[str, Field(min_length=1)]
    file: Path | None = None
    files: tuple[Path, ...] = ()
    columns: Columns = Columns()
    opcua: Tags = Tags()
    pv_span: Span | None = None
    op_span: Span | None = None
    pv_unit: str | None = None
    op_unit: str | None = None
    controller: Controller | None = None
    process: Process = Process()
    cascade: Cascade | None = None
    positioner: Positioner | None = None
    split_range: bool = False
    shared_valve_with: str | None = None
    valve: str | None = None
    area: str | None = None
    acceptable_dead_band: Annotated[float, Field(gt=0, le=100)] | None = None
    dead_band_prior: Annotated[float, Field(gt=0, lt=100)] | None = None
    repaired: datetime | None = None
    sample_time: Annotated[float, Field(gt=0, le=1e7)] | None = None
    time_zone: str | None = None
    time_format: TimeFormat | None = None
    auto_values: tuple[str | float, ...] | None = None
    bad_values: tuple[str | float, ...] = ()
    tf: Annotated[float, Field(gt=0)] | None = None
    n: Annotated[int, Field(ge=1, le=31)] = 9  # as long as the window of the core is

    @model_validator(mode="after")
    def _one_or_several(self) -> Loop:
        """Check that files are given in one way, each once."""
        if self.file is not None and self.files:
            raise InputError("are given in addition to file; write all of them into files", parameter="files")
        if twice := next((str(file) for i, file in enumerate(self.files) if file in self.files[:i]), None):
            raise InputError(f"names {twice} twice", parameter="files", value=twice)
        return self

    @field_validator("pv_span", "op_span")
    @classmethod
    def _low_below_high(cls, span: Span | None) -> Span | None:
        """A span, checked for low < high."""
        if span is not None:
            check_limits(span)
        return span

    @field_validator("time_zone")
    @classmethod
    def _known_zone(cls, zone: str | None) -> str | None:
        """A time zone, checked to be known."""
        if zone is not None:
            try:
                ZoneInfo(zone)
            except (ValueError, OSError, KeyError):
                what = f"is {zone!r}, must be an IANA time zone such as 'Europe/Stockholm' or 'UTC'"
                hint = None if available_timezones() else "this Python has no time zones at all: pip install tzdata"
                raise InputError(what, value=zone, bound="an IANA time zone", hint=hint) from None
        return zone

    @field_validator("repaired", mode="before")
    @classmethod
    def _moment(cls, moment: Any) -> Any:
        """A date and time, as one or as text: a number would count as seconds since 1970."""
        if moment is None or isinstance(moment, date):
            return moment
        try:
            return datetime.fromisoformat(moment.strip())
        except (ValueError, AttributeError):
            bound = "a date and time such as '2026-03-01T12:00:00'"
            raise InputError(f"is {moment!r}, must be {bound}", value=moment, bound=bound) from None

    @field_validator("n")
    @classmethod
    def _odd(cls, n: int) -> int:
        """N, checked to be odd."""
        if n % 2 == 0:  # with an even n no detection need lie near the median
            raise InputError(f"is {n}, must be odd", value=n, bound="odd")
        return n

    @property
    def op_label(self) -> str:
        """Unit of OP for display; "OP unit" where a span other than 0..100 is given without a unit."""
        return _glapp.op_unit(self.op_unit, self.op_span, None)

    def ideal(self) -> Ideal | None:
        """The controller in ideal form and signal units, None where no controller is given.

        Raises
        ------
        InputError
            Where the unit of the gain is open, or spans are needed and not given.
        """
        if self.controller is None:
            return None
        try:
            return self.controller.ideal(self.pv_span, self.op_span)
        except InputError as error:
            error.loop = self.name
            raise

    def prior(self) -> float | None:
        """Share of the plant's valves that have a dead band, 0 to 1; None where it is not given.

        Examples
        --------
        >>> Loop(name="F", dead_band_prior=40).prior()
        0.4
        """
        return None if self.dead_band_prior is None else self.dead_band_prior / 100

    def kp(self) -> float | None:
        """Static process gain Kp [PV unit / OP unit], None where it is not given.

        Raises
        ------
        InputError
            Where its unit is open, or spans are needed and not given.

        Examples
        --------
        >>> Loop(name="F", pv_span=(0, 50), op_span=(0, 100), process={"kp": 1.5, "kp_unit": "%/%"}).kp()
        0.75
        """
        kp, unit = self.process.kp, self.process.kp_unit
        if kp is None or unit == "PV/OP":
            return kp
        if self.pv_span is None or self.op_span is None:
            if unit is None:
                return kp
            missing = "pv_span" if self.pv_span is None else "op_span"
            raise InputError("is required to convert Kp in %/%", loop=self.name, parameter=missing, bound="required")
        ratio = (self.pv_span[1] - self.pv_span[0]) / (self.op_span[1] - self.op_span[0])
        if unit is None and ratio != 1.0:
            raise InputError(
                "is required, since the spans of PV and OP differ in width",
                loop=self.name,
                parameter="process.kp_unit",
                bound="'%/%' or 'PV/OP'",
            )
        return kp * ratio


def op_unit(unit: str) -> str:
    """The unit of OP as a sentence needs it: `%` alone does not say of what."""
    return "%OP" if unit == "%" else unit
