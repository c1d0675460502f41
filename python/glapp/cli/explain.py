"""`glapp explain`: one half-period, its numbers, and the tests it passed or failed."""

from __future__ import annotations

from collections import Counter
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.text import Text

from ..errors import InputError
from ..escape import one_line
from ..reading.cells import CellFault
from ..reading.times import moment
from ..result import REASONS, Result
from .inputs import Refused, open_one
from .options import Options, with_options
from .screen import Column, CommandError, key_values, out, show_table, styled
from .work import analyze_all

__all__ = ["explain"]


@with_options
def explain(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Recording, or a loops.toml with --loop.")],
    options: Options,
    at: Annotated[
        str | None,
        typer.Option(
            metavar="TIME", help="A moment in the half-period: date and time as in the recording, or seconds."
        ),
    ] = None,
    trust: Annotated[
        bool, typer.Option("--trust", metavar="", help="Use K and Ti of an identification that is not usable, too.")
    ] = False,
) -> None:
    """Show one half-period: its numbers, every test, and which of them rejected it. Without --at: list them all."""
    [result] = analyze_all([open_one(file, options)], trust, fit=False)
    if isinstance(result, Refused):
        raise result.error
    if result.half_periods.count == 0:
        raise InputError(
            f"has no half-periods: {result.reason}", file=result.source, loop=result.name, hint="see glapp analyze"
        )
    if at is None:
        _list(result)
    else:
        _show(result, _nearest(result, _seconds(at, result.t0, result.loop.time_format), at))


def _seconds(at: str, t0: datetime | None, time_format: str | None = None) -> float:
    """The moment [s since t0]; a time without a zone is in that of the recording."""
    try:
        return float(at)
    except ValueError:
        pass
    example = "seconds" if t0 is None else f"'{t0:%Y-%m-%d %H:%M:%S}' or seconds"
    try:
        when = moment(at, time_format if time_format in ("day first", "month first") else None)
    except CellFault as fault:
        raise CommandError(f"--at: {fault.what}; write {example}") from None
    if when is None:
        raise CommandError(f"--at: cannot read '{at}' as a time; write {example}")
    if t0 is None:
        raise CommandError(f"--at: '{at}' is a date, but the recording has plain seconds; write seconds")
    if t0.tzinfo is None:
        if when.tzinfo is not None:
            raise CommandError(f"--at: '{at}' has a zone, but the recording's times have none; leave it out")
        return (when - t0).total_seconds()
    when = when if when.tzinfo is not None else when.replace(tzinfo=t0.tzinfo)
    return (when.astimezone(UTC) - t0.astimezone(UTC)).total_seconds()


def _nearest(result: Result, t: float, at: str) -> int:
    """The half-period at t, or the one nearest to it."""
    from ..report.words import clock

    h = result.half_periods
    first, last = float(h.t_start.min()), float(h.t_end.max())
    end = last if result.trace is None else max(last, float(result.trace.t[-1]))
    if not first <= t <= end:
        span = f"{clock(result.t0, first)} to {clock(result.t0, end)}"
        raise InputError(f"'{at}' is outside the recording, which goes from {span}", file=result.source)
    if t > last:
        what = f"at '{at}' runs a half-period that had not ended when the recording stopped"
        raise InputError(what, file=result.source, hint=f"the last one that did ended at {clock(result.t0, last)}")
    outside = np.maximum(h.t_start - t, t - h.t_end)
    nearest = h.count - 1 - int(np.argmin(outside[::-1]))  # where one ends and the next begins, the one that begins
    if outside[nearest] > 0:
        out.print(f"The half-period at '{at}' is shorter than 5·Ti and was counted, not kept. The nearest that was:\n")
    return nearest


def _list(result: Result) -> None:
    """Print the list of half-periods."""
    from ..report.words import REASONS as WORDS
    from ..report.words import clock, count, crossing, number

    h = result.half_periods
    pv, op = result.loop.pv_unit or "PV unit", result.unit
    each = range(h.count)
    counts = Counter(WORDS[REASONS[reason]].label for reason in h.reason)
    verdicts = ", ".join(f"{n} {label}".replace(" ", "\u00a0") for label, n in counts.most_common())
    width = crossing(result) or "no estimate"
    out.print(f"{one_line(result.name)}: {count(h.count, 'half-period')}, {verdicts}; {width}.", style="bold")
    out.print("Details: --at TIME\n")
    show_table(
        [
            Column("From", [clock(result.t0, h.t_start[i]) for i in each]),
            *(
                Column(header, [number(values[i]) for i in each], True)
                for header, values in (
                    ("Δt [s]", h.delta_t),
                    (f"Δy [{pv}]", h.delta_y),
                    (f"d [{op}]", h.d),
                    (f"d̂ after [{op}]", h.d_hat),
                )
            ),
            Column("Verdict", [_reason(WORDS[REASONS[h.reason[i]]].label, h.reason[i] == 0) for i in each]),
        ]
    )
    if (left := result.total_half_periods - h.count) > 0:
        out.print(f"\nand {left} more that are shorter than 5·Ti")


def _reason(label: str, accepted: bool) -> Text:
    """A verdict's label, bold where the half-period was accepted."""
    return styled(label, style="bold" if accepted else "")


def _show(result: Result, i: int) -> None:
    """Print one half-period with the numbers of its verdict."""
    from ..report import words

    h, s = result.half_periods, result.settings
    pv, op = result.loop.pv_unit or "PV unit", words.op_unit(result.unit)
    reason = words.REASONS[REASONS[h.reason[i]]]
    begin, end = words.clock(result.t0, h.t_start[i]), words.clock(result.t0, h.t_end[i])
    out.print(
        f"{one_line(result.name)}, half-period {i + 1} of {h.count}, {begin} to {end}", style="bold", soft_wrap=True
    )
    verdict = "accepted" if h.reason[i] == 0 else f"rejected: {reason.label}"
    out.print(f"{verdict} ({reason.meaning})\n", style="green" if h.reason[i] == 0 else "red")
    side = {1: "PV below SP", -1: "PV above SP", 0: "PV neither above nor below SP"}[int(h.sign[i])]
    kp_part = f" = {words.number(h.free[i])} − {words.number(h.kp_part[i])} (Δy/Kp)" if s.kp is not None else ""
    rows = [
        ("Δt", f"{words.quantity(h.delta_t[i], 's')} ({h.samples[i]} samples, {side})"),
        ("Δy", f"{words.quantity(h.delta_y[i], pv)} (mean distance of PV from SP)"),
        ("e_max", f"{words.quantity(h.e_max[i], pv)} (largest distance)"),
        ("Δysp", f"{words.quantity(h.delta_sp[i], pv)} (range of SP)"),
        ("Δu", f"{words.quantity(h.delta_u[i], op)} (K/Ti·∫|e|dt, what the integral moved OP)"),
        ("OP's travel", words.quantity(h.op_travel[i], op) if np.isfinite(h.op_travel[i]) else "not recorded"),
        ("OP turn to turn", f"{words.quantity(h.swing[i], op)} (since its turn in the half-period before)"),
        ("Plateau", f"{words.quantity(h.plateau[i], pv)} (where PV came to rest off SP)"),
        ("d", f"{words.quantity(h.d[i], op)}{kp_part}"),
        ("d̂ after it", f"{words.quantity(h.d_hat[i], op)} ({words.count(int(h.detections[i]), 'detection')})"),
    ]
    settings = [
        ("K", s.k, f"{op}/{pv}"),
        ("Ti", s.ti, "s"),
        ("Td", s.td, "s"),
        ("Tf", s.tf, "s"),
        ("Kp", s.kp, f"{pv}/{op}"),
    ]
    rows += [(name, f"{words.quantity(value, unit)} ({s.notes[name.lower()]})") for name, value, unit in settings]
    out.print(key_values(rows))
    out.print()
    failed = words.failures(int(h.mask[i]))
    for name in REASONS[1:5]:  # those without a comparison of numbers
        if name in failed:
            out.print(styled(f"✗ {words.REASONS[name].label}: {words.REASONS[name].meaning}", style="red"))
    for line, passed in words.comparisons(result, i):
        mark, style = {True: ("✓", "green"), False: ("✗", "red"), None: ("·", "dim")}[passed]
        out.print(styled(f"{mark} {line}", style=style))
    if reason.remedy:
        out.print(f"\n{reason.remedy}")
