"""`glapp identify`: K, Ti and Td out of a recording."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from ..controller import Controller
from ..errors import InputError
from ..escape import one_line
from ..estimate import identify_with_unit
from ..identify import R2_USABLE, Identification
from ..loop import Loop
from ..reading.settings import write_settings
from ..recording import Recording
from .inputs import Valve, open_files, recording_of
from .options import Options, with_options
from .screen import key_values, out, say_error

__all__ = ["identify"]


@with_options
def identify(
    files: Annotated[list[Path], typer.Argument(metavar="FILES", help="Recordings, loops.toml files, or both.")],
    options: Options,
) -> None:
    """Find K, Ti and Td of the controller from OP's moves, with their intervals, ready for a loops.toml."""
    loops: list[Loop] = []
    faults: list[InputError | str] = []
    shown = False
    recordings = [
        recording
        for entry in open_files(files, options)
        for recording in (entry.recordings if isinstance(entry, Valve) else [entry])
    ]
    for entry in recordings:
        try:
            recording = recording_of(entry)
            found, known = identify_with_unit(recording)
        except InputError as error:
            faults.append(error)
            continue
        if found.k is not None or found.ti is not None:  # else there is only a reason to print
            if shown:
                out.print()
            out.print(one_line(f"{recording.name}  ({recording.source})"), style="bold", soft_wrap=True)
            out.print(key_values(_rows(recording, found, known.op_label)))
            shown = True
        if found.usable:
            loops.append(_settings(recording, found))
        else:
            go_on = "or, knowing that, glapp analyze --trust" if found.k and found.ti else "see docs/identify.md"
            faults.append(f"{recording.source}, loop {recording.name}: not usable: {found.reason}; {go_on}")
    if loops:
        out.print("\nFor a loops.toml:\n")
        out.print(write_settings(loops), end="", soft_wrap=True)
    for fault in faults:
        say_error(fault)
    if faults:
        raise typer.Exit(1)


def _settings(recording: Recording, found: Identification) -> Loop:
    """The loop with the identified settings, as a loops.toml has it."""
    assert found.k is not None and found.ti is not None
    controller: dict[str, Any] = {"k": _rounded(abs(found.k)), "gain_unit": "OP/PV", "ti": _rounded(found.ti)}
    if found.td:
        controller["td"] = _rounded(found.td)
    if found.k < 0:
        controller["action"] = "direct"
    if found.setpoint_weight is not None:
        controller["setpoint_weight"] = round(found.setpoint_weight, 2)
    return Loop(name=recording.name, file=Path(recording.source), controller=Controller(**controller))


def _rows(recording: Recording, found: Identification, op: str) -> list[tuple[str, str]]:
    """Rows of the table of K, Ti and Td with their intervals."""
    from ..report.words import number, quantity

    def between(low: float | None, high: float | None, unit: str) -> str:
        return f"95 %: {number(low)} to {quantity(high, unit) if high != float('inf') else 'no upper end'}"

    pv = recording.loop.pv_unit or recording.units.get("PV") or "PV unit"
    gain = f"{op}/{pv}"
    rows = []
    if found.k is not None:
        acting = "direct" if found.k < 0 else "reverse"
        rows.append(("K", f"{quantity(found.k, gain)}  ({between(found.k_low, found.k_high, gain)}; {acting} acting)"))
    if found.ti is not None:
        rows.append(("Ti", f"{quantity(found.ti, 's')}  ({between(found.ti_low, found.ti_high, 's')})"))
    if found.td is not None:
        rows.append(("Td", f"{quantity(found.td, 's')}  ({between(found.td_low, found.td_high, 's')})"))
    if found.r2 is not None:
        rows.append(
            (
                "R²",
                f"{found.r2:.3f}  (share of OP's moves explained, over the samples below; {R2_USABLE} is needed)",
            )
        )
    weight = "SP moved too little to tell" if found.setpoint_weight is None else number(found.setpoint_weight)
    return [
        *rows,
        ("Setpoint weight", weight),
        ("Samples", f"{found.samples} steps between samples could be used"),
        ("Fit", found.note),
    ]


def _rounded(value: float) -> float:
    """Four digits: more than any recording determines."""
    return float(f"{value:.4g}")
