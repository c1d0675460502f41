"""A first loops.toml, written from a recording, to be completed by hand."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..escape import one_line
from ..recording import MARKED, Recording, without_value
from .settings import _key, _value, block

__all__ = ["refuse_without_numbers", "settings_of"]

_HEAD = """\
# What glapp knows about the loops in {file}. Remove the '#' in front of what you know and correct the value;
# everything left out is found from the data where that is possible, and the report says how.
"""

_LOOP = """
[loops.{key}]
file = {file}
{seen}{columns}
# The ranges of the instruments, from the control system: never the range of the data.
{pv_span}
{pv_unit_line}
{op_span}

{controller}
{process}"""

_CONTROLLER = """\
# [loops.{key}.controller]  # as the control system shows it
# form = "ideal"  # or "series"; "parallel" has kp, ki, kd in place of k, ti, td
# k = 0.0  # FILL IN; or pb = ... for a proportional band in %
# gain_unit = "%/%"  # or "OP/PV": OP units per PV unit
# ti = 0.0  # FILL IN
# ti_unit = "s"  # or "min", "repeats/min", "repeats/s"
# td = 0.0
# td_unit = "s"  # or "min"
# action = "reverse"  # or "direct": OP rises with PV
"""

_PROCESS = """\
# [loops.{key}.process]
# type = "self-regulating"  # or "integrating"
# kp = 1.0                  # static gain of the process; without it, and with both spans, 1.5 %/% is assumed
# kp_unit = "%/%"           # or "PV/OP"
"""

_GIVEN = ("sample_time", "time_format", "time_zone", "auto_values", "repaired", "tf", "n")
"""Keys that are written where they were given."""


def refuse_without_numbers(recording: Recording) -> None:
    """Read a recording until SP, PV and OP, those that are recorded, each have a number.

    Raises InputError where one has none in any row, or a row before that cannot be read.
    """
    silent, rows, marked = ["SP", "PV", "OP"], 0, dict.fromkeys(MARKED, 0)
    for batch in recording.batches():  # where PV has none, it raises at its end
        rows += len(batch)
        if batch.marks is not None:
            marked = {name: n + int(np.count_nonzero(batch.marks & MARKED[name])) for name, n in marked.items()}
        signals = {"SP": batch.sp, "PV": batch.pv, "OP": batch.op}
        silent = [name for name in silent if (values := signals[name]) is not None and not np.isfinite(values).any()]
        if not silent:
            return
    place = {"file": recording.source, "column": recording.columns.get(silent[0])}
    raise without_value(rows, marked[silent[0].lower()], **place)


def settings_of(recordings: Sequence[Recording], directory: str | Path = ".") -> str:
    """Text of a loops.toml of recordings that are open, from one file or several; it can be parsed as it is.

    Columns, units and the time between rows come from the files. Spans, controller and process are as they were given,
    and else comments to fill in.

    - `directory`: place of the loops.toml; the text names the recordings relative to it, unless their paths are
      absolute.
    """
    files = list(dict.fromkeys(Path(recording.source) for recording in recordings))
    head = _HEAD.format(file=", ".join(one_line(file.name) for file in files))
    return head + "".join(_loop(_relative(Path(recording.source), directory), recording) for recording in recordings)


def _relative(file: Path, directory: str | Path) -> Path:
    return file if file.is_absolute() else Path(os.path.relpath(file, directory))


def _loop(file: Path, recording: Recording) -> str:
    """Text of a loop's table in a settings file."""
    columns = {role: name for role, name in recording.columns.items() if role in _COLUMN_KEYS}
    left_out = {key: "" for key in _COLUMN_KEYS.values() if getattr(recording.loop.columns, key) == ""}
    named = {_COLUMN_KEYS[role]: name for role, name in columns.items()} | left_out
    listed = ", ".join(f"{key} = {_value(name)}" for key, name in named.items())
    step, loop, key = _step(recording), recording.loop, _key(recording.name)
    seen = [] if step is None else [f"# One row every {step:g} s at the beginning of the recording."]
    seen += [f"{key} = {_value(getattr(loop, key))}" for key in _GIVEN if key in loop.model_fields_set]
    if recording.t0 is not None and recording.zone is None:
        seen.append('# time_zone = "Europe/Stockholm"  # zone of the times in the file')
    pv_unit = recording.units.get("PV")
    pv_span = f"# pv_span = [0, 0]  # FILL IN, in {one_line(pv_unit or 'PV unit')}"
    op_span = "# op_span = [0, 100]  # FILL IN if OP is not in %"
    controller, process = _CONTROLLER.format(key=key), _PROCESS.format(key=key)
    if loop.pv_span is not None:
        pv_span = f"pv_span = {_value(loop.pv_span)}"
    if loop.op_span is not None:
        op_span = f"op_span = {_value(loop.op_span)}"
    if loop.controller is not None:
        controller = block(f"loops.{key}.controller", loop.controller, "controller.")
    if loop.process.kp is not None:
        process = block(f"loops.{key}.process", loop.process)
    return _LOOP.format(
        key=key,
        file=_value(file),
        seen="".join(line + "\n" for line in seen),
        columns=f"columns = {{ {listed} }}\n",
        pv_span=pv_span,
        pv_unit_line=f"pv_unit = {_value(pv_unit)}" if pv_unit else '# pv_unit = "m3/h"',
        op_span=op_span,
        controller=controller,
        process=process,
    )


_COLUMN_KEYS: dict[str, str] = {
    "time": "time",
    "SP": "sp",
    "PV": "pv",
    "OP": "op",
    "MODE": "mode",
    "quality": "quality",
    "position": "position",
}


def _step(recording: Recording) -> float | None:
    """Usual time between rows [s]; None where it is not known."""
    times: Sequence[float] = next((b.t.tolist() for b in recording.batches(1000)), [])
    steps = np.diff(times)
    steps = steps[steps > 0]
    return float(np.median(steps)) if len(steps) else None
