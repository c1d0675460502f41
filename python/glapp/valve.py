"""Several recordings of one valve: the shared width, their order in time, and the contribution of each."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime

from .errors import InputError
from .recording import Recording

__all__ = ["in_order", "one_valve", "since"]

_SHARED = ("pv_span", "op_span", "pv_unit", "op_unit", "controller", "process", "positioner")
"""Settings that recordings of one valve have in common."""


def one_valve(recordings: Sequence[Recording]) -> None:
    """Refuse recordings that cannot be of one valve.

    Raises InputError: naming the first file whose unit, span, controller, process or positioner is not that of the
    first one.
    """
    first = recordings[0]
    for other in recordings[1:]:
        for name in _SHARED:
            value, here = getattr(other.loop, name), getattr(first.loop, name)
            if value != here:
                raise InputError(
                    f"is {_to_text(value)}, and {_to_text(here)} in {first.source}",
                    file=other.source,
                    parameter=name,
                    value=value,
                    bound=f"as in {first.source}",
                    hint="recordings of one valve share unit, span and settings; analyse the others by themselves",
                )


def _to_text(value: object) -> str:
    """A setting as text for an error."""
    fields = value.model_dump(exclude_defaults=True) if hasattr(value, "model_dump") else None
    if fields is not None:
        return ", ".join(f"{name} {x}" for name, x in fields.items()) or "as by default"
    return "not given" if value is None else str(value)


def in_order(recordings: Sequence[Recording]) -> list[Recording]:
    """Recordings in the order of time where each has a date, else as given."""
    return sorted(recordings, key=_moment) if _dated(recordings) else list(recordings)


def since(recordings: Sequence[Recording]) -> list[float]:
    """Time 0 of each recording [s], counted from the earliest; NaN where one has no date."""
    if not _dated(recordings):
        return [float("nan")] * len(recordings)
    first = min(map(_moment, recordings))
    return [(_moment(recording) - first).total_seconds() for recording in recordings]


def _dated(recordings: Sequence[Recording]) -> bool:
    """Whether all have a date, of one kind: with a zone or without."""
    aware = {None if recording.t0 is None else recording.t0.tzinfo is not None for recording in recordings}
    return len(aware) == 1 and None not in aware


def _moment(recording: Recording) -> datetime:
    assert recording.t0 is not None
    return recording.t0 if recording.t0.tzinfo is None else recording.t0.astimezone(UTC)
