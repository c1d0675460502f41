"""A loop's answer as one row, for CSV and Arrow: the columns follow from the models of `glapp.document`."""

from __future__ import annotations

import types
import typing
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from pydantic import BaseModel

from .document import Columns, Controller, Finding, LoopAnswer
from .errors import InputError
from .result import REASONS, Result

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["columns", "rows", "to_arrow"]

Kind = Literal["string", "float64", "int64", "bool"]
KINDS: dict[Any, Kind] = {str: "string", float: "float64", int: "int64", bool: "bool"}


class Column(NamedTuple):
    """A column: its name, the kind of its values, and how to read it from a loop's answer in plain types."""

    name: str
    kind: Kind
    get: Callable[[dict[str, Any]], Any]


def columns() -> list[Column]:
    """The columns of a loop's row, in the order in which the models declare their fields.

    A part of the answer has its name before those of its fields, but the controller. A list of findings gives their
    codes, the windows give their number; notes are left out.

    Examples
    --------
    >>> [column.name for column in columns()][:3]
    ['loop', 'file', 'answer_verdict']
    """
    return list(_of_model(LoopAnswer, "", lambda answer: answer))


def _of_model(model: type[BaseModel], prefix: str, get: Callable[[dict[str, Any]], Any]) -> Iterator[Column]:
    """Columns of a row, by the fields of a model."""
    for name, field in model.model_fields.items():
        given = next((x for x in field.metadata if isinstance(x, Columns)), None)
        yield from _of_field(f"{prefix}{name}", field.annotation, given, _at(get, name))


def _at(get: Callable[[dict[str, Any]], Any], key: Any) -> Callable[[dict[str, Any]], Any]:
    """Function for a part of the answer; None where the whole is None."""

    def value(answer: dict[str, Any]) -> Any:
        whole = get(answer)
        return None if whole is None else whole[key]

    return value


def _of_field(name: str, kind: Any, given: Columns | None, get: Callable[[dict[str, Any]], Any]) -> Iterator[Column]:
    """Columns of a row, by one field."""
    if typing.get_origin(kind) in (typing.Union, types.UnionType):
        (kind,) = {member for member in typing.get_args(kind) if member is not type(None)}
    if typing.get_origin(kind) is typing.Annotated:
        kind, *more = typing.get_args(kind)
        given = given or next((x for x in more if isinstance(x, Columns)), None)
    if given is not None:
        yield from (Column(f"{name}{end}", "float64", _at(get, i)) for i, end in enumerate(given.ends))
    elif typing.get_origin(kind) is Literal:
        yield Column(name, "string", get)
    elif kind in KINDS:
        yield Column(name, KINDS[kind], get)
    elif isinstance(kind, type) and issubclass(kind, BaseModel):
        yield from _of_model(kind, "" if kind is Controller else f"{name}_", get)
    elif name == "reasons":
        yield from (Column(f"rejected_{reason}", "int64", _count(get, reason)) for reason in REASONS[1:])
    elif kind == list[Finding]:
        yield Column(name, "string", lambda answer: " ".join(f"{f['code']}:{f['severity']}" for f in get(answer)))
    elif typing.get_origin(kind) is list:
        yield Column(name, "int64", lambda answer: None if (found := get(answer)) is None else len(found))


def _count(get: Callable[[dict[str, Any]], Any], reason: str) -> Callable[[dict[str, Any]], int]:
    """Column that counts one reason of rejection."""
    return lambda answer: int(get(answer).get(reason, 0))


def rows(results: Sequence[Result]) -> Iterator[list[Any]]:
    """The values of a row for each loop, in their order."""
    made = columns()
    for result in results:
        answer = result.to_dict()
        yield [column.get(answer) for column in made]


def to_arrow(results: Result | Sequence[Result]) -> pa.Table:
    """The answers as a table with a row a loop, for a data lake or a table of pandas or Polars.

    Parameters
    ----------
    results : Result or sequence of Result
        From `glapp.analyze`, in any order.

    Returns
    -------
    pyarrow.Table
        The columns of `glapp analyze --csv`, null where there is no value.

    Raises
    ------
    InputError
        For anything but a sequence of results.

    Examples
    --------
    >>> import glapp
    >>> sim = glapp.simulate.closed_loop("P3", (0.48, 0.3117), d=0.05, noise=0.001, t_end=400, load=[(100, 0.5)])
    >>> loop = glapp.Loop(name="P3", controller={"k": 0.48, "ti": 0.3117}, process={"kp": 1})
    >>> table = glapp.to_arrow([glapp.estimate(glapp.recording_from(sim.to_arrow(), loop))])
    >>> table.select(["loop", "answer_verdict", "detections"]).to_pylist()
    [{'loop': 'P3', 'answer_verdict': 'estimate', 'detections': 11}]
    """
    import pyarrow as pa

    results = [results] if isinstance(results, Result) else list(results)
    if not all(isinstance(result, Result) for result in results):
        raise InputError("must be a list of results of glapp.analyze", parameter="results", value=results)
    made = columns()
    kinds = {"string": pa.string(), "float64": pa.float64(), "int64": pa.int64(), "bool": pa.bool_()}
    cells = list(rows(results))
    arrays = [pa.array([row[i] for row in cells], kinds[column.kind]) for i, column in enumerate(made)]
    return pa.table(arrays, names=[column.name for column in made])
