"""Options of the command line that describe a loop, and their keys in `Loop`."""

from __future__ import annotations

import dataclasses
import functools
import inspect
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, get_args, get_type_hints

import typer

from ..checked import check_limits, check_positive
from ..controller import Controller
from ..errors import InputError
from ..loop import Loop, Process
from .screen import CommandError

__all__ = ["Options", "check_option", "with_options"]

_COLUMNS = ("time", "sp", "pv", "op", "mode", "quality")
_CONTROLLER = ("form", "k", "pb", "gain_unit", "ti", "ti_unit", "td", "td_unit", "action", "setpoint_weight")
_PROCESS = ("kp", "kp_unit")
_LOOP = ("pv_span", "op_span", "tf", "n", "repaired", "sample_time", "time_format", "time_zone", "auto_values")


def _choices(annotation: Any) -> str:
    """The words of a Literal as usage shows them."""
    words = [word for part in (annotation, *get_args(annotation)) for word in get_args(part) if isinstance(word, str)]
    return "|".join(words)


def _column(signal: str) -> Any:
    """Option for the column of a signal."""
    return typer.Option(
        metavar="COLUMN", help=f"Column of {signal}.", rich_help_panel="Columns or tags, where the guess is wrong"
    )


def _setting(text: str, metavar: str = "NUMBER") -> Any:
    """Option for a setting of the controller."""
    panel = "Settings of the loop (for one recording; for several write a loops.toml)"
    return typer.Option(metavar=metavar, help=text, rich_help_panel=panel)


def _word(model: type[Controller] | type[Process] | type[Loop], key: str, text: str) -> Any:
    """Option for a setting that is one of several words."""
    return _setting(text, _choices(model.model_fields[key].annotation))


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """The options of every command that reads recordings; a key that is None was not given."""

    loop: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Only this loop of the files; may be repeated.")
    ] = None
    time: Annotated[str | None, _column("the time")] = None
    sp: Annotated[str | None, _column("SP")] = None
    pv: Annotated[str | None, _column("PV")] = None
    op: Annotated[str | None, _column("OP")] = None
    mode: Annotated[str | None, _column("the controller's mode")] = None
    quality: Annotated[str | None, _column("the quality; '' for none")] = None
    k: Annotated[float | None, _setting("Gain K of the controller, > 0; its sign is --action.")] = None
    pb: Annotated[float | None, _setting("Proportional band in %, instead of K.")] = None
    gain_unit: Annotated[str | None, _word(Controller, "gain_unit", "Unit of K, where the spans differ in width.")] = (
        None
    )
    ti: Annotated[float | None, _setting("Integral time.")] = None
    ti_unit: Annotated[str | None, _word(Controller, "ti_unit", "Unit of --ti; s where not given.")] = None
    td: Annotated[float | None, _setting("Derivative time.")] = None
    td_unit: Annotated[str | None, _word(Controller, "td_unit", "Unit of --td; s where not given.")] = None
    form: Annotated[
        str | None, _setting("Form of the controller; the parallel form needs a loops.toml.", "ideal|series")
    ] = None
    action: Annotated[str | None, _word(Controller, "action", "Direct: OP rises with PV.")] = None
    setpoint_weight: Annotated[float | None, _setting("Setpoint weight b, 0 to 1.")] = None
    kp: Annotated[float | None, _setting("Static gain Kp of the process, where known.")] = None
    kp_unit: Annotated[str | None, _word(Process, "kp_unit", "Unit of --kp, where the spans differ in width.")] = None
    pv_span: Annotated[tuple[float, float] | None, _setting("Range of the PV instrument.", "LOW HIGH")] = None
    op_span: Annotated[tuple[float, float] | None, _setting("Range of OP.", "LOW HIGH")] = None
    tf: Annotated[float | None, _setting("Time constant of the detector's filter in s; chosen where not given.")] = None
    n: Annotated[int | None, _setting("Detections behind an estimate, odd; 9 where not given.")] = None
    repaired: Annotated[
        str | None, _setting("When the valve was repaired; the answer is that of what was recorded after it.", "TIME")
    ] = None
    sample_time: Annotated[float | None, _setting("Seconds between rows, where there is no time column.")] = None
    time_format: Annotated[
        str | None, _word(Loop, "time_format", "How times are written, where they leave it open.")
    ] = None
    time_zone: Annotated[
        str | None, _setting("Zone of times that are written without one, such as Europe/Stockholm.", "ZONE")
    ] = None
    auto_values: Annotated[
        list[str] | None,
        _setting("Word or number of MODE that means automatic, where glapp does not know it; may be repeated.", "WORD"),
    ] = None

    def columns(self) -> dict[str, Any]:
        """Names of columns that were given, as keys of `Columns`."""
        return self._given(_COLUMNS)

    def settings(self) -> dict[str, Any]:
        """The given options as keys of `Loop`.

        Raises CommandError where a value is out of its bounds or another is missing beside it.
        """
        parts = {"columns": _COLUMNS, "controller": _CONTROLLER, "process": _PROCESS}
        given: dict[str, Any] = {part: values for part, names in parts.items() if (values := self._given(names))}
        given |= self._given(_LOOP)
        if self.form == "parallel":
            raise CommandError("--form: the parallel form has settings of its own; write them into a loops.toml")
        try:
            loop = Loop(name="loop", **given)
            loop.ideal()
            loop.kp()
        except InputError as error:
            name = (error.parameter or "").split(".")[-1].replace("_", "-")
            hint = f"; {error.hint}" if error.hint else ""
            raise CommandError(f"--{name}: {error.what}{hint}") from None
        return given

    def _given(self, names: tuple[str, ...]) -> dict[str, Any]:
        """Options of these names that were given."""
        return {name: value for name in names if (value := getattr(self, name)) is not None}


def check_option(option: str, given: tuple[float, float] | float | None) -> None:
    """Refuse the limits of an option, LOW HIGH, where the first is not below the second, and a NUMBER that is not > 0.

    Raises CommandError where it is not.
    """
    try:
        if isinstance(given, tuple):
            check_limits(given)
        elif given is not None:
            check_positive(given)
    except InputError as error:
        raise CommandError(f"{option}: {error.what}") from None


def with_options(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command that takes `options` the fields of `Options` as options of its own."""
    hints = get_type_hints(Options, include_extras=True)
    shared = [
        inspect.Parameter(
            field.name, inspect.Parameter.KEYWORD_ONLY, default=field.default, annotation=hints[field.name]
        )
        for field in dataclasses.fields(Options)
    ]
    signature = inspect.signature(command, eval_str=True)
    own = [parameter for parameter in signature.parameters.values() if parameter.name != "options"]

    @functools.wraps(command)
    def run(**values: Any) -> None:
        options = Options(**{parameter.name: values.pop(parameter.name) for parameter in shared})
        command(**values, options=options)

    keyword_only = [parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY) for parameter in own]
    run.__signature__ = signature.replace(parameters=[*keyword_only, *shared])  # type: ignore[attr-defined]
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in [*own, *shared]}
    return run
