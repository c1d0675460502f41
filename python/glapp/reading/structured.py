"""JSON as historians, data bases and scripts write it, as one table.

What is understood: a list of objects, an object a line, an array or an object a column, {"columns", "data"}, the
answers of InfluxDB 1, and streams with their own samples, as the Web API of PI and the Read API of Canary answer. A
file is read whole, so it may have at most `bounds.WHOLE` bytes.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from typing import Any

import pyarrow as pa

from ..errors import InputError
from . import bounds
from .meaning import understand
from .names import folded
from .source import Source
from .tables import TableSource

__all__ = ["parsed", "table_of"]

_HINT = 'write a list of objects such as [{"time": ..., "SP": ..., "PV": ..., "OP": ...}, ...]'
_SEE = "see to what it says, and export again"
_MESSAGES = ("message", "error", "errors", "detail")
"""Keys of what a server answers in place of data, in lower case."""
_SHOWN = 200
"""Characters of it that are shown."""
_LISTS = ("value", "data", "rows", "records", "items", "results", "values", "samples", "points")
"""Keys whose list is the table, in lower case."""
_SAMPLE = {"t": "time", "v": "value", "q": "quality"}
"""Keys of a sample of Canary."""


def parsed(text: str, label: str) -> Any | None:
    """The data of a JSON text, or of one with an object a line; None where it is neither.

    Raises InputError where it begins as JSON and is damaged.
    """
    text = text.lstrip("\ufeff")
    try:
        return json.loads(text)
    except RecursionError:
        raise InputError("is JSON nested too deeply", file=label, hint=_HINT) from None
    except ValueError as fault:
        error = fault
    lines = [(i, line) for i, line in enumerate(text.splitlines(), start=1) if line.strip()]
    found = []
    for i, line in lines:
        try:
            found.append(json.loads(line))
        except (ValueError, RecursionError):
            if found:
                raise InputError("is not an object of JSON", file=label, row=i) from None
            break
    if found or re.match(r"\s*(\{\s*\"|\[\s*[\[{])", text) is None:
        return found or None
    what = f"is not readable as JSON: {getattr(error, 'msg', error)}"
    raise InputError(what, file=label, row=getattr(error, "lineno", None))


def table_of(data: Any, label: str) -> Source:
    """The table in the data.

    Raises InputError where there is none.
    """
    names, rows = _table(data, label)
    if not rows:
        raise InputError("has no rows", file=label, hint=_HINT)
    bounds.check_columns(len(names), label)
    columns = [_column([row[i] for row in rows]) for i in range(len(names))]
    source = TableSource(pa.table(columns, names=list(names)), label)
    texts = (column.slice(0, 1000) for column in columns if pa.types.is_string(column.type))
    source.learn_digits(text for column in texts for text in column.to_pylist())
    return source


def _table(data: Any, label: str) -> tuple[list[str], list[list[Any]]]:
    """Names and rows of a table in JSON."""
    if isinstance(data, list):
        return _of_list(data, label)
    if isinstance(data, dict):
        keys = {str(key).lower(): value for key, value in data.items()}
        if isinstance(keys.get("columns"), list) and isinstance(keys.get("data"), list):
            return _split(keys)
        if isinstance(results := keys.get("results"), list) and any(
            isinstance(r, dict) and "series" in r for r in results
        ):
            return _series([series for r in results if isinstance(r, dict) for series in r.get("series", [])], label)
        if (streams := _streams(data)) is not None:
            return streams
        for key in _LISTS:
            if isinstance(inner := keys.get(key), list) and inner and isinstance(inner[0], dict | list):
                return _of_list(inner, label)
        columns = {str(key): value for key, value in data.items() if isinstance(value, list)}
        lengths = {len(column) for column in columns.values()}
        if len(columns) > 1 and len(lengths) == 1:
            return list(columns), [list(row) for row in zip(*columns.values(), strict=True)]
        objects = {str(key): value for key, value in data.items() if isinstance(value, dict)}
        if len(objects) > 1 and len(objects) == len(data):
            return _by_index(objects)
        for key in ("data", "result", "response", "body"):
            if isinstance(inner := keys.get(key), dict):
                return _table(inner, label)
        if (message := _message(data)) is not None:
            raise InputError(f"is a message and no recording: '{message}'", file=label, hint=_SEE)
    raise InputError("holds no table that glapp can read", file=label, hint=_HINT)


def _message(data: Any) -> str | None:
    """What a server answered in place of data."""
    if isinstance(data, list):
        return _message(data[0]) if data else None
    if isinstance(data, dict):
        keys = {str(key).lower(): value for key, value in data.items()}
        return next((message for key in _MESSAGES if (message := _message(keys.get(key))) is not None), None)
    return data[:_SHOWN] if isinstance(data, str) else None


def _of_list(data: Sequence[Any], label: str) -> tuple[list[str], list[list[Any]]]:
    """Names and rows of a list in JSON."""
    if data and all(isinstance(row, dict) for row in data):
        if (streams := _streams({"items": data})) is not None:
            return streams
        names: dict[str, None] = {}
        for row in data:
            names.update(dict.fromkeys(map(str, row)))
        return list(names), [[row.get(name) for name in names] for row in data]
    if data and all(isinstance(row, list) for row in data) and len({len(row) for row in data}) == 1:
        head = data[0]
        if all(isinstance(name, str) for name in head):
            return [str(name) for name in head], [list(row) for row in data[1:]]
    raise InputError("holds no table that glapp can read", file=label, hint=_HINT)


def _split(keys: Mapping[str, Any]) -> tuple[list[str], list[list[Any]]]:
    """Names and rows of a table in JSON with columns and data apart."""
    names, rows, index = [str(name) for name in keys["columns"]], keys["data"], keys.get("index")
    if not all(isinstance(row, list) and len(row) == len(names) for row in rows):
        return names, []
    if isinstance(index, list) and len(index) == len(rows):
        return ["", *names], [[at, *row] for at, row in zip(index, rows, strict=True)]
    return names, [list(row) for row in rows]


def _series(series: Sequence[Any], label: str) -> tuple[list[str], list[list[Any]]]:
    """Series of InfluxDB 1: each with its name, its tags and its columns."""
    names: list[str] | None = None
    rows: list[list[Any]] = []
    for item in series:
        if not isinstance(item, dict) or not isinstance(item.get("columns"), list):
            continue
        columns = [str(name) for name in item["columns"]]
        if names is None:
            names = columns
        if columns != names:
            what = f"holds series of different columns: {', '.join(names)} and {', '.join(columns)}"
            raise InputError(what, file=label, hint="export each measurement by itself")
        tag = ".".join(str(part) for part in (item.get("name"), *dict(item.get("tags") or {}).values()) if part)
        rows += [[tag, *row] for row in item.get("values", []) if isinstance(row, list) and len(row) == len(names)]
    return ["name", *(names or [])], rows


def _streams(data: Mapping[str, Any]) -> tuple[list[str], list[list[Any]]] | None:
    """Streams with their own samples: by name in a list (PI), or by name as the key (Canary)."""
    named: list[tuple[str, Any]] = []
    keys = {str(key).lower(): value for key, value in data.items()}
    if isinstance(items := keys.get("items"), list):
        for item in items:
            if isinstance(item, dict) and isinstance(item.get("Name"), str) and isinstance(item.get("Items"), list):
                named.append((item["Name"], item["Items"]))
    elif isinstance(inner := keys.get("data"), dict):
        named = [(str(tag), samples) for tag, samples in inner.items() if isinstance(samples, list)]
        if not all(samples and isinstance(samples[0], dict | list) for _, samples in named):
            return None
    if not named:
        return None
    rows = [[tag, *_sample(sample)] for tag, samples in named for sample in samples]
    return ["tag", "time", "value", "quality"], rows


def _sample(sample: Any) -> list[Any]:
    """Time, value and quality of one sample."""
    if isinstance(sample, list):
        return [*sample[:3], *[None] * (3 - len(sample[:3]))] if len(sample) != 2 else [*sample, "good"]
    if not isinstance(sample, dict):
        return [None, None, None]
    found: dict[str, Any] = {"quality": "good"}
    for key, cell in sample.items():
        if role := _SAMPLE.get(str(key).lower()) or understand(str(key)).role:
            found.setdefault(role, cell) if role != "quality" else found.update(quality=cell)
    flags = {folded(str(key)): cell for key, cell in sample.items() if isinstance(cell, bool)}
    if flags.get("good") is False or flags.get("questionable") or flags.get("isgood") is False:
        found["quality"] = "bad"
    return [found.get("time"), found.get("value"), found["quality"]]


def _by_index(objects: Mapping[str, Mapping[str, Any]]) -> tuple[list[str], list[list[Any]]]:
    """Columns by name, rows by index; or rows by index, columns by name."""
    inner = list(next(iter(objects.values())))
    if any(understand(str(name)).role for name in inner) and not any(understand(name).role for name in objects):
        return ["", *map(str, inner)], [[at, *(row.get(name) for name in inner)] for at, row in objects.items()]
    index = dict.fromkeys(key for column in objects.values() for key in column)
    return ["", *objects], [[at, *(column.get(at) for column in objects.values())] for at in index]


def _column(cells: Sequence[Any]) -> pa.Array:
    """Cells of one column: numbers where all are, else text."""
    cells = [_cell(cell) for cell in cells]
    kinds = {type(cell) for cell in cells if cell is not None}
    try:
        if kinds == {int}:
            return pa.array(cells, pa.int64())
        if kinds and kinds <= {int, float}:
            return pa.array([None if cell is None else float(cell) for cell in cells], pa.float64())
    except (pa.ArrowException, OverflowError):
        pass
    return pa.array([None if cell is None else _text(cell) for cell in cells], pa.string())


def _cell(cell: Any) -> Any:
    """A value of PI that is a digital state is an object with its name."""
    return cell.get("Name") if isinstance(cell, dict) else cell


def _text(cell: Any) -> str:
    if isinstance(cell, bool):
        return "true" if cell else "false"
    return cell.encode(errors="replace").decode() if isinstance(cell, str) else json.dumps(cell)
