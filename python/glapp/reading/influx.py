"""Exports of InfluxDB: annotated CSV and line protocol, as tables with a row per tag and time.

A tag is the measurement, the values of its tag columns and the field, joined by points: ``pid.FIC101.pv``.

Annotated CSV may hold several tables, each with its own line of names: they are read one after the other. Both forms
are read whole, so a file may have at most `bounds.WHOLE` bytes.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator, Sequence

import pyarrow as pa

from ..errors import InputError
from .heads import no_rows
from .meaning import understand
from .source import Source
from .tables import TableSource

__all__ = ["annotated", "is_annotated", "is_line_protocol", "line_protocol"]

_OWN = {"", "result", "table", "_start", "_stop", "_time", "_value", "_field", "_measurement"}
_ANNOTATIONS = ("#group", "#datatype", "#default")
_KEY = r"(?:[^\s,=\\]|\\.)+"
_ENTRY = rf"{_KEY}=(?:\"(?:[^\"\\]|\\.)*\"|[^\s,]+)"
_POINT = re.compile(
    rf"(?P<series>(?:[^\s,\\]|\\.)+(?:,{_KEY}={_KEY})*) (?P<fields>{_ENTRY}(?:,{_ENTRY})*) (?P<time>-?\d{{10,19}})\s*"
)
_FIELD = re.compile(rf"({_KEY})=(\"(?:[^\"\\]|\\.)*\"|[^\s,]+)(?:,|$)")


def is_annotated(beginning: str) -> bool:
    r"""Whether a text begins as annotated CSV does, or with the names that a query without annotations has.

    Examples
    --------
    >>> is_annotated("#group,false,false\n"), is_annotated(",result,table,_time,_value\n"), is_annotated("t,SP,PV\n")
    (True, True, False)
    """
    first = next((line for line in beginning.splitlines() if line.strip()), "")
    return first.startswith(_ANNOTATIONS) or {"_time", "table"} <= set(first.split(","))


def is_line_protocol(beginning: str) -> bool:
    r"""Whether the first line that is no comment is a point.

    Examples
    --------
    >>> is_line_protocol("pid,loop=F1 pv=1.5,op=40 1763100000000000000\n"), is_line_protocol("t SP PV\n0 1 2\n")
    (True, False)
    """
    first = next((line for line in beginning.splitlines() if line.strip() and not line.startswith("#")), "")
    return _POINT.fullmatch(first) is not None


class _Rows:
    """Rows of a table with a row per tag and time."""

    def __init__(self) -> None:
        self.times: list[str] = []
        self.tags: list[str] = []
        self.values: list[str] = []
        self.lines: list[int] = []

    def add(self, line: int, time: str, tag: str, value: str) -> None:
        """Add a sample of a tag."""
        self.times.append(time)
        self.tags.append(tag)
        self.values.append(value)
        self.lines.append(line)

    def source(self, label: str) -> Source:
        """The samples so far as a source."""
        if not self.times:
            raise no_rows(label)
        columns = {"time": self.times, "tag": self.tags, "value": self.values}
        table = pa.table({name: pa.array(column, pa.string()) for name, column in columns.items()})
        source = TableSource(table, label, self.lines)
        source.learn_digits(self.values[:5000])
        return source


def annotated(text: str, label: str) -> Source:
    """The tables of annotated CSV.

    Raises InputError where a row does not go with the names above it, or there is none.
    """
    rows = _Rows()
    names: list[str] | None = None
    notes: dict[str, list[str]] = {}
    for line, cells in _records(text, label):
        if not cells:
            names, notes = None, {}
        elif cells[0] in _ANNOTATIONS:
            names = None
            notes[cells[0]] = cells
        elif cells[0].startswith("#datatype "):  # the extended form has no column for annotations
            names, notes = None, {"#datatype": [cells[0].removeprefix("#datatype "), *cells[1:]]}
        elif names is None:
            names = cells
            roles = _roles(names, notes)
        else:
            if len(cells) != len(names):
                what = f"has {len(cells)} cell{'s' * (len(cells) != 1)} where the header has {len(names)}"
                raise InputError(what, file=label, row=line, value=len(cells), bound=str(len(names)))
            series = [cells[i] for i in roles["series"]]
            if "time" not in roles:
                raise InputError(f"no time column among: {', '.join(names[:20])}", file=label, row=line)
            [at] = roles["time"]
            if roles["value"]:
                [value], field = roles["value"], [cells[i] for i in roles["field"]]
                rows.add(line, cells[at], ".".join([*series, *field]), cells[value])
            else:
                for i in roles["fields"]:
                    rows.add(line, cells[at], ".".join([*series, names[i]]), cells[i])
    return rows.source(label)


def _records(text: str, label: str) -> Iterator[tuple[int, list[str]]]:
    """Records of a CSV with the number of their first line."""
    lines = text.splitlines(keepends=True)
    reader = csv.reader(lines)
    before = 0
    try:
        for cells in reader:
            yield before + 1, cells
            before = reader.line_num
    except csv.Error as error:
        raise InputError(f"is not a table of text: {error}", file=label, row=before + 1) from None


def _roles(names: Sequence[str], notes: dict[str, list[str]]) -> dict[str, list[int]]:
    """Columns of each kind: time, series (measurement and tags), field and value, or fields."""
    kinds = notes.get("#datatype", [])
    of = {i: kinds[i] if i < len(kinds) else "" for i in range(len(names))}
    times = [i for i, name in enumerate(names) if name == "_time"] or [
        i for i in of if of[i].startswith("dateTime") and names[i] not in _OWN
    ]
    roles: dict[str, list[int]] = {
        "value": [i for i, name in enumerate(names) if name == "_value"][:1],
        "field": [i for i, name in enumerate(names) if name == "_field"],
        "series": [i for i, name in enumerate(names) if name == "_measurement" or of[i] == "measurement"],
        "fields": [],
    }
    if times:
        roles["time"] = times[:1]
    group = notes.get("#group", [])
    for i, name in enumerate(names):
        if name in _OWN or i in times or i in roles["series"]:
            continue
        grouped = i < len(group) and group[i] == "true"
        if of[i] == "tag" or grouped or roles["value"] or (not group and not kinds and understand(name).role is None):
            roles["series"].append(i)
        else:
            roles["fields"].append(i)
    return roles


def line_protocol(text: str, label: str) -> Source:
    """The points of line protocol.

    Raises InputError: at the first line that is no point.
    """
    rows = _Rows()
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip() or line.startswith("#"):
            continue
        point = _POINT.fullmatch(line)
        if point is None:
            what = "is not a point such as 'pid,loop=FIC101 pv=1.5,op=40 1763100000000000000'"
            raise InputError(what, file=label, row=number)
        measurement, *tags = re.split(r"(?<!\\),", point["series"])
        series = [_plain(measurement), *(_plain(tag.partition("=")[2]) for tag in tags)]
        for name, value in _FIELD.findall(point["fields"]):
            rows.add(number, point["time"], ".".join([*series, _plain(name)]), _value(value))
    return rows.source(label)


def _plain(text: str) -> str:
    return re.sub(r"\\(.)", r"\1", text)


def _value(text: str) -> str:
    """A field's value: a string without its quotes, a whole number without its i or u."""
    if text.startswith('"'):
        return _plain(text[1:-1])
    return text[:-1] if re.fullmatch(r"-?\d+[iu]", text) else text
