"""loops.toml: settings of many loops, in one file that people write by hand."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterable, Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from ..checked import nearest
from ..errors import InputError
from ..escape import in_quotes
from ..loop import Loop
from .each import all_or_none
from .files import check_file

__all__ = ["block", "read_each", "read_settings", "read_table", "write_settings"]

_TABLES = ("defaults", "loops", "opcua")
_COMMENTS = {
    "pv_span": "range of the PV instrument [PV unit]",
    "op_span": "range of OP [OP unit]",
    "acceptable_dead_band": "% of OP span",
    "dead_band_prior": "% of valves",
    "sample_time": "s",
    "tf": "s",
    "controller.k": "gain",
    "controller.pb": "proportional band [%]",
    "controller.error_gap": "PV unit",
    "controller.output_dead_band": "OP unit",
    "controller.pv_filter": "s",
    "opcua.u_ff_limit": "OP unit",
    "opcua.u_ff_rate": "OP unit per second",
    "positioner.dead_band": "% of travel",
}


def read_settings(path: str | Path) -> list[Loop]:
    """Loops of a loops.toml: tables [loops.NAME], each completed by [defaults].

    A table inside a loop ([loops.NAME.controller]) is completed key by key by the same table of the defaults: the
    loop's own keys win, and a default that says the same in another way (`k` for `pb`) is left out. File names are
    relative to the directory of the loops.toml.

    - `path`: the file.

    Returns: In the order of the file.

    Raises InputError with file, loop, key, value and bound of the first fault; for an unknown key with the nearest
    known one.
    """
    return all_or_none(read_each(path))


def read_each(path: str | Path) -> list[Loop | InputError]:
    """Read a loops.toml, with the error in the place of a loop whose own settings are wrong: the others can go on.

    Raises InputError for a fault of the whole file or of its defaults.
    """
    return _loops_or_errors(_text_of(path), str(path), Path(path).parent)


def read_table(path: str | Path, name: str) -> dict[str, Any] | None:
    """A table of a loops.toml that is not about loops, unchanged; None where it has none.

    Raises InputError for a file that cannot be read, is no TOML or has something else of that name.
    """
    data = _toml(_text_of(path), str(path))
    return _table(data[name], str(path), name) if name in data else None


def _text_of(path: str | Path) -> str:
    label, path = str(path), Path(path)
    check_file(path, label)
    try:
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise InputError("is not UTF-8 text", file=label) from None
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror or error}", file=label) from None


def _toml(text: str, label: str) -> dict[str, Any]:
    try:
        return tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise InputError(f"is not valid TOML: {error}", file=label) from None


def parse_settings(text: str, label: str, directory: Path) -> list[Loop]:
    """Read settings from the text of a loops.toml.

    Examples
    --------
    >>> text = '''
    ... [defaults]
    ... op_span = [0, 100]
    ... [loops.FIC101]
    ... file = "fic101.csv"
    ... '''
    >>> [loop] = parse_settings(text, "loops.toml", Path("."))
    >>> loop.name, loop.op_span
    ('FIC101', (0.0, 100.0))
    """
    return all_or_none(_loops_or_errors(text, label, directory))


def _loops_or_errors(text: str, label: str, directory: Path) -> list[Loop | InputError]:
    """Loops of a settings file, or the errors in their place."""
    data = _toml(text, label)
    for key in data:
        if key not in _TABLES:
            near = nearest(key, _TABLES)
            known = "the file has the tables [defaults], [loops.NAME] and [opcua]"
            hint = f"did you mean [{near}]?" if near else known
            raise InputError("no such table", file=label, parameter=key, hint=hint)
    defaults = _table(data.get("defaults", {}), label, "defaults")
    tables = _table(data.get("loops", {}), label, "loops")
    if not tables:
        raise InputError("has no loops", file=label, hint="write a table [loops.NAME] for each")
    for key in ("name", "file", "files"):
        if key in defaults:
            raise InputError("belongs to a loop, not to the defaults", file=label, parameter=f"defaults.{key}")
    if defaults:  # so that a fault in the defaults is not blamed on the first loop
        _loop({**defaults, **_completed(defaults), "name": "defaults"}, label, None)
    loops: list[Loop | InputError] = []
    for name, table in tables.items():
        try:
            own = _table(table, label, f"loops.{name}")
            if "name" in own:
                raise InputError("is given by the table [loops.NAME]", file=label, loop=name, parameter="name")
            loop = _loop({**_merged(defaults, own), "name": name}, label, name)
        except InputError as error:
            loops.append(error)
            continue
        here = {"file": None if loop.file is None else directory / loop.file}
        loops.append(loop.model_copy(update={**here, "files": tuple(directory / file for file in loop.files)}))
    return loops


def _table(value: object, label: str, key: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise InputError(f"is {value!r}, must be a table", file=label, parameter=key, value=value, bound="a table")
    return value


def _loop(data: dict[str, Any], label: str, name: str | None) -> Loop:
    """A loop from a table, with its place in an error."""
    try:
        return Loop(**data)
    except InputError as error:
        error.file, error.loop = label, name
        if name is None:
            error.parameter = f"defaults.{error.parameter}"
        raise


def _merged(defaults: Mapping[str, Any], own: Mapping[str, Any]) -> dict[str, Any]:
    """The loop's table, completed key by key by the defaults; the loop's own keys win."""
    out = dict(defaults)
    controller = defaults.get("controller")
    if "controller" not in own and isinstance(controller, dict) and not _complete(controller):
        del out["controller"]  # it completes those of the loops that have one; the others' are found from the data
    for key, value in own.items():
        old = out.get(key)
        if isinstance(old, dict) and isinstance(value, dict):
            rivals = _rivals(key, old, value)
            out[key] = {**{k: v for k, v in old.items() if k not in rivals}, **value}
        else:
            out[key] = value
    return out


def _rivals(table: str, defaults: Mapping[str, Any], own: Mapping[str, Any]) -> set[str]:
    """Keys of the defaults that contradict a setting of the loop."""
    if table == "process":
        return {"kp", "kp_unit"} if own.get("type") == "integrating" else set()
    if table != "controller":
        return set()
    parallel = own.get("form", defaults.get("form")) == "parallel"
    rivals = {"k", "pb", "ti", "td"} if parallel else {"kp", "ki", "kd"}
    return rivals | ({"pb"} if "k" in own else set()) | ({"k", "gain_unit"} if "pb" in own else set())


def _complete(controller: Mapping[str, Any]) -> bool:
    """Whether it has all that a controller needs."""
    if controller.get("form") == "parallel":
        return "kp" in controller and "ki" in controller
    return ("k" in controller or "pb" in controller) and "ti" in controller


def _completed(defaults: Mapping[str, Any]) -> dict[str, Any]:
    """The default controller, with placeholders for what each loop adds, so that it can be validated by itself."""
    controller = defaults.get("controller")
    if not isinstance(controller, dict):
        return {}
    needed = {"kp": 1.0, "ki": 1.0} if controller.get("form") == "parallel" else {"ti": 1.0}
    if controller.get("form") != "parallel" and "pb" not in controller:
        needed["k"] = 1.0
    return {"controller": {**needed, **controller}}


def write_settings(loops: Iterable[Loop]) -> str:
    """Text of a loops.toml: for each loop all keys that differ from their defaults.

    Examples
    --------
    >>> print(write_settings([Loop(name="FIC101", op_span=(0, 100), controller={"k": 0.5, "ti": 30})]), end="")
    [loops.FIC101]
    op_span = [0.0, 100.0]  # range of OP [OP unit]
    <BLANKLINE>
    [loops.FIC101.controller]
    k = 0.5  # gain
    ti = 30.0
    """
    blocks = []
    for loop in loops:
        blocks.append(block(f"loops.{_key(loop.name)}", loop))
        for name in type(loop).model_fields:
            inner = getattr(loop, name)
            if isinstance(inner, BaseModel) and inner.model_fields_set:
                blocks.append(block(f"loops.{_key(loop.name)}.{name}", inner, f"{name}."))
    return "\n".join(blocks)


def block(header: str, model: BaseModel, prefix: str = "") -> str:
    """One table of a loops.toml: all that was given, with the units of the keys that `prefix` leads to."""
    lines = [f"[{header}]"]
    for name, field in type(model).model_fields.items():
        value = getattr(model, name)
        if name == "name" or value is None or isinstance(value, BaseModel) or name not in model.model_fields_set:
            continue
        if value == field.default and name != "n":
            continue
        comment = _COMMENTS.get(prefix + name)
        lines.append(f"{name} = {_value(value)}" + (f"  # {comment}" if comment else ""))
    return "\n".join(lines) + "\n"


def _key(name: str) -> str:
    """A key as TOML."""
    bare = name.isascii() and name.replace("_", "").replace("-", "").isalnum()
    return name if bare else _value(name)


def _value(value: object) -> str:
    """A value as TOML."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, tuple):
        return "[" + ", ".join(_value(v) for v in value) + "]"
    if isinstance(value, int | float):
        return repr(value)
    if isinstance(value, datetime):
        return value.isoformat()
    text = value.as_posix() if isinstance(value, Path) else str(value)
    return in_quotes(json.dumps(text, ensure_ascii=False))  # JSON's escapes are TOML's, but for DEL
