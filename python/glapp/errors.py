"""The one exception that wrong input ends in."""

from __future__ import annotations

from pathlib import Path

__all__ = ["FAULT", "InputError", "unforeseen"]


class InputError(ValueError):
    """Something a person gave us cannot be used; one line says what, where and what to do.

    The line reads *place: what; hint*, and every part is also an attribute.

    Parameters
    ----------
    what : str
        The fault, with the value and the bound it broke.
    file : str, optional
        File as the user wrote it.
    loop, parameter : str, optional
        Loop and key of a setting.
    row : int, optional
        Row as an editor or a spreadsheet numbers it (the header of a CSV file is row 1).
    column, tag : str, optional
        Column of a table, tag of a long table.
    value, bound : object, optional
        The refused value, and the bound in words ("> 0 s").
    hint : str, optional
        What to do about it.
    asks : {"columns", "day order", "time unit"}, optional
        What a person could say for the file to be read: which columns are the signals; which number of a date is the
        day; what numbers in the column of times count.

    Examples
    --------
    >>> print(InputError("'abc' is not a number", file="plant.csv", row=18, column="PV", hint="write NaN"))
    plant.csv, row 18, column PV: 'abc' is not a number; write NaN
    >>> print(InputError("is -3, must be > 0 s", parameter="ti", value=-3, bound="> 0 s"))
    ti: is -3, must be > 0 s
    """

    def __init__(
        self,
        what: str,
        *,
        file: str | None = None,
        loop: str | None = None,
        parameter: str | None = None,
        row: int | None = None,
        column: str | None = None,
        tag: str | None = None,
        value: object = None,
        bound: str | None = None,
        hint: str | None = None,
        asks: str | None = None,
    ) -> None:
        self.what = _one_line(what)
        self.file = file
        self.loop = loop
        self.parameter = parameter
        self.row = row
        self.column = column
        self.tag = tag
        self.value = value
        self.bound = bound
        self.hint = hint
        self.asks = asks
        super().__init__(self.what)

    def __str__(self) -> str:
        place = [
            self.file,
            self.loop and f"loop {self.loop}",
            self.row is not None and f"row {self.row}",
            self.column is not None and f"column {self.column}",
            self.tag is not None and f"tag {self.tag}",
            self.parameter,
        ]
        where = ", ".join(str(p) for p in place if p)
        line = f"{where}: {self.what}" if where else self.what
        return _one_line(f"{line}; {self.hint}" if self.hint else line)


FAULT = "a fault in glapp, please report it"


def unforeseen(error: Exception, file: str | None, loop: str | None = None) -> InputError:
    """Any other exception over one loop, as its refusal, with its place in the code; the other loops go on.

    Examples
    --------
    >>> print(unforeseen(KeyError("x"), "plant.csv", "FIC101"))
    plant.csv, loop FIC101: KeyError: 'x'; a fault in glapp, please report it
    """
    if isinstance(error, MemoryError):
        return InputError("needs more memory than there is", file=file, loop=loop)
    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    place = "" if trace is None else f" (in {Path(trace.tb_frame.f_code.co_filename).name}, line {trace.tb_lineno})"
    found = InputError(f"{type(error).__name__}: {error}{place}", file=file, loop=loop, hint=FAULT)
    found.__cause__ = error
    return found


def _one_line(text: str) -> str:
    """One line, whatever the value holds (line breaks, control characters, a page of text)."""
    clean = "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in " ".join(text.split()))
    return clean if len(clean) <= 600 else clean[:597] + "..."
