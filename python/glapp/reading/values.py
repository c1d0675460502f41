"""Cells to numbers and flags: words for missing values, modes, qualities, limit flags."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from ..errors import InputError
from ..recording import BAD, NOT_AUTO
from . import names
from .cells import CellFault, is_text, plain, words

__all__ = [
    "Digits",
    "Quality",
    "digits_of",
    "flags_of",
    "holds_modes",
    "is_number",
    "limit_flag",
    "mode_flag",
    "numbers",
    "text_of",
    "unit_of",
    "words_for_bad",
]

_NUMBER = r"^[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?$|^[+-]?(inf|infinity)$"
_SYSTEM = r"^\[-\d+\]"
"""Beginning of PI's word for an error: [-11059] No Good Data For Calculation."""
_WITH_UNIT = re.compile(r"([+-]?\d[\d.,'’\u00a0\u2009\u202f]*(?:[eE][+-]?\d+)?) ?([^\s\d.,'’+-].*)")
_ONE_UNIT = "export the column in one unit"
_WHOLE = re.compile(r"\d+\.0*")
_PLAIN = re.compile(r"[+-]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][+-]?\d+)?")
_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?")
# Separators between thousands: a space of any kind and an apostrophe part nothing else.
_SPACES = " \u00a0\u2009\u202f'\u2019"
_SPACED = rf"^[+-]?[0-9]{{1,3}}([{_SPACES}][0-9]{{3}})+([.,][0-9]*)?$"


def _thousands(group: str, decimal: str) -> str:
    """Cells that only a separator of thousands explains: 9.700,00 and 1.234.567."""
    g, d = re.escape(group), re.escape(decimal)
    return rf"^[+-]?[0-9]{{1,3}}(({g}[0-9]{{3}})+{d}[0-9]*|({g}[0-9]{{3}}){{2,}})$"


_PARTED = ((".", ","), (",", "."))
"""Marks that may part thousands, and the decimal mark beside each."""


def _grouped(group: str) -> str:
    """Cells that may have one: 9.700."""
    return rf"^[+-]?[0-9]{{1,3}}({re.escape(group)}[0-9]{{3}})+$"


@dataclass(frozen=True, slots=True)
class Digits:
    """Notation of a text's numbers.

    - `decimal`: the decimal sign; "" where no cell that was read shows it.
    - `group`: what parts the thousands, where some cell shows it; a space or an apostrophe is always understood.
    """

    decimal: str = "."
    group: str = ""


def digits_of(cells: Sequence[str], label: str) -> Digits:
    """Notation of the numbers in a table's cells.

    Raises InputError where some have a decimal comma and others a decimal point.

    Examples
    --------
    >>> digits_of(["9.700,00", "812,50"], "a.csv")
    Digits(decimal=',', group='.')
    """
    shown: dict[Digits, str] = {}  # cells that only a separator of thousands explains
    for digits in (Digits(",", "."), Digits(".", ",")):
        sure = re.compile(_thousands(digits.group, digits.decimal))
        if (cell := next((cell for cell in cells if sure.match(cell)), None)) is not None:
            shown[digits] = cell
    rest = list(cells)
    for digits in shown:
        grouped = re.compile(rf"{_thousands(digits.group, digits.decimal)}|{_grouped(digits.group)}")
        rest = [cell for cell in rest if not grouped.match(cell)]
    commas = [cell for digits, cell in shown.items() if digits.decimal == ","]
    commas += [cell for cell in rest if _DECIMAL_COMMA.fullmatch(cell)]
    points = [cell for digits, cell in shown.items() if digits.decimal == "."]
    points += [cell for cell in rest if "." in cell and _PLAIN.fullmatch(cell)]
    if commas and points:
        fewer = min(("comma", commas), ("point", points), key=lambda kind: len(kind[1]))
        mark, (odd, *_) = fewer
        usual, other = (points[0], "point") if mark == "comma" else (commas[0], "comma")
        what = f"'{odd}' has a decimal {mark}, and others, such as '{usual}', a decimal {other}"
        raise InputError(what, file=label, value=odd, hint="write all numbers alike")
    return next(iter(shown), Digits("," if commas else "." if points else ""))


def unit_of(cell: str) -> tuple[str, str] | None:
    """A number and the known unit that stands behind it in one cell; None where there is none.

    Examples
    --------
    >>> unit_of("48.20 m³/h"), unit_of("55%"), unit_of("48.20"), unit_of("3 valves")
    (('48.20', 'm³/h'), ('55', '%'), None, None)
    """
    found = _WITH_UNIT.fullmatch(cell.strip())
    if found is None or names.folded(found[2]) not in names.UNITS:
        return None
    return found[1], found[2]


def words_for_bad(extra: Iterable[str | float]) -> frozenset[str]:
    """All words that stand for a missing value, in lower case."""
    return names.MISSING | {w.strip().lower() for w in extra if isinstance(w, str)}


def is_number(text: str) -> bool:
    """Whether a cell is a number, however its digits are parted.

    Examples
    --------
    >>> is_number("48,20"), is_number("9.700,00"), is_number("FIC101.PV")
    (True, True, False)
    """
    return bool(
        _PLAIN.fullmatch(text) or re.match(_SPACED, text) or any(re.match(_thousands(*p), text) for p in _PARTED)
    )


def holds_modes(cells: Iterable[str]) -> bool:
    """Whether cells are modes of a controller, and no numbers of a signal: words, or both 0 and 1 and nothing else.

    Examples
    --------
    >>> holds_modes(["Auto", "", "Hand"]), holds_modes(["0", "1.0"]), holds_modes(["0", "0"]), holds_modes(["44,5"])
    (True, True, False, False)
    """
    known = {word for cell in cells if (word := text_of(cell)) not in names.MISSING}
    return known == {"0", "1"} or bool(known and not any(map(is_number, known)))


def numbers(column: pa.Array, bad_words: frozenset[str], digits: Digits = Digits()) -> NDArray[np.float64]:
    """Numbers of a column, NaN where missing or not finite.

    - `column`: numbers, booleans or text.
    - `bad_words`: words that mean "missing", lower case.
    - `digits`: how text writes numbers.

    Raises CellFault: at the first text that is neither a number nor a word for missing.
    """
    column = plain(column)
    if is_text(column.type):
        column = _parse(column, bad_words, digits)
    elif not pa.types.is_float64(column.type):
        if pa.types.is_null(column.type):
            return np.full(len(column), np.nan)
        try:
            column = column.cast(pa.float64(), safe=False)
        except (pa.ArrowInvalid, pa.ArrowNotImplementedError):
            raise CellFault(0, f"holds {column.type}, not numbers", value=str(column.type)) from None
    x: NDArray[np.float64] = column.to_numpy(zero_copy_only=False)
    if not x.flags.aligned:  # a file or a table in memory may begin a column anywhere, the core's loops may not
        x = x.copy()
    with np.errstate(all="ignore"):  # one pass finds any NaN or infinity; a false alarm, by overflow, is harmless
        finite = column.null_count == 0 and np.isfinite(x.sum())
    if finite:
        return x
    return np.where(np.isfinite(x), x, np.nan)


def _parse(column: pa.Array, bad_words: frozenset[str], digits: Digits) -> pa.Array:
    """Numbers of a column of text."""
    column = pc.utf8_trim_whitespace(column)
    missing = pc.is_in(pc.utf8_lower(column), value_set=pa.array(bad_words, pa.string()))
    missing = pc.or_(missing, pc.fill_null(pc.match_substring_regex(column, _SYSTEM), False))
    column = pc.if_else(missing, pa.scalar(None, pa.string()), column)
    written = column
    column = _without(column, _SPACED, f"[{_SPACES}]")
    if digits.decimal == ".":
        column = _without(column, _thousands(",", "."), ",")
    else:
        column = _without(column, _thousands(".", ","), "[.]")
    if digits.group:
        column = _without(column, _grouped(digits.group), f"[{digits.group}]")
    elif digits.decimal == "," and pc.any(doubtful := pc.match_substring_regex(column, _grouped("."))).as_py():
        at = pc.index(doubtful, True).as_py()
        what = f"'{written[at].as_py()}' may be with a decimal point, or thousands: other numbers have a decimal comma"
        raise CellFault(at, what, "write all numbers alike", written[at].as_py())
    if digits.decimal != ".":
        column = pc.replace_substring(column, ",", ".")
    good = pc.match_substring_regex(column, _NUMBER, ignore_case=True)
    if pc.min(good).as_py() is False:
        at = pc.index(good, False).as_py()
        value = written[at].as_py()
        if (of := unit_of(value)) is not None:
            raise CellFault(at, f"'{value}' is in {of[1]}, and others of its column are not", _ONE_UNIT, value)
        hint = "write bad values as empty, NaN or Bad, or name them in bad_values"
        raise CellFault(at, f"'{value}' is not a number", hint, value)
    return pc.cast(pc.utf8_ltrim(column, "+"), pa.float64())


def _without(column: pa.Array, cells: str, what: str) -> pa.Array:
    """The column without `what` in those of its cells."""
    having = pc.fill_null(pc.match_substring_regex(column, cells), False)
    if not pc.any(having).as_py():
        return column
    return pc.if_else(having, pc.replace_substring_regex(column, what, ""), column)


def text_of(value: object) -> str:
    """A cell as a normalised word: trimmed, lower case, whole numbers without a decimal part.

    Examples
    --------
    >>> text_of(1.0), text_of(" AUTO "), text_of(None), text_of(True)
    ('1', 'auto', '', 'true')
    """
    if value is None:
        return ""
    if isinstance(value, float):
        return "" if np.isnan(value) else f"{value:.17g}"
    text = str(value).strip().lower()
    return text.partition(".")[0] if _WHOLE.fullmatch(text) else text


def flags_of(column: pa.Array, bit_of: Callable[[str], int]) -> NDArray[np.uint8]:
    """One bit per cell, decided once per different word.

    Raises CellFault: at the first cell that `bit_of` refuses with a ValueError, or where the column holds neither words
    nor numbers.
    """
    n = 1
    if pa.types.is_dictionary(column.type) and is_text(column.type.value_type) and column.null_count == 0:
        coded = column
    else:
        column = words(column)
        if len(column) and pc.all(pc.equal(column, column[0]), skip_nulls=False).as_py():  # as modes mostly are
            column, n = column.slice(0, 1), len(column)
        coded = column.dictionary_encode(null_encoding="encode")
    bits = np.zeros(max(len(coded.dictionary), 1), np.uint8)
    for i, value in enumerate(coded.dictionary.to_pylist()):
        try:
            bits[i] = bit_of(text_of(value))
        except ValueError as error:
            at = pc.index(coded.indices, pa.scalar(i, coded.indices.type)).as_py()
            what, hint = error.args
            raise CellFault(at, f"'{value}' {what}", hint, value) from None
    found: NDArray[np.uint8] = bits[coded.indices.to_numpy(zero_copy_only=False)]
    return found if n == 1 else np.full(n, found[0])


def mode_flag(auto_values: Iterable[str | float] | None, bad_words: frozenset[str]) -> Callable[[str], int]:
    """Reader of the mode column; an empty cell or a word for "missing" is not known to be automatic."""
    named = None if auto_values is None else {text_of(v) for v in auto_values}

    def decide(word: str) -> int:
        if named is not None:
            return 0 if word in named else NOT_AUTO
        if word in names.AUTO:
            return 0
        if word in names.NOT_AUTO or word in bad_words:
            return NOT_AUTO
        raise ValueError(
            "is not a mode that glapp knows",
            "say which words mean automatic, as --auto-values AUTO --auto-values CAS, or in loops.toml "
            'auto_values = ["AUTO", "CAS"]; or leave the column out: --mode \'\'',
        )

    return decide


_NO_QUALITY = "write Good and Bad, or leave the column out: --quality '', or in loops.toml columns = { quality = \"\" }"


class Quality:
    """Reader of a quality column: only *good* is good.

    Words: Good... against Bad..., Uncertain..., Questionable and the words for missing. Numbers: OPC DA (the two bits
    of 192 set is good) or OPC UA status codes (the two highest of 32 bits clear is good). 0 is bad in the one and good
    in the other, so the numbers at the start of the column decide: any of 192..255 there means OPC DA.

    - `first`: normalised words from the start of the column.
    - `bad_words`: words for missing.
    - `column`: its name: where that says *validity*, 1 is good and every other number is not; *confidence* (PHD), 100
      is.
    - `marked`: whether it has a letter where a value is not good, and nothing where it is (FactoryTalk View).
    """

    def __init__(
        self, first: Iterable[str], bad_words: frozenset[str], column: str = "", *, marked: bool = False
    ) -> None:
        seen = {int(w) for w in first if w.isdecimal()}
        self._one = 1 if names.folded(column) in names.VALIDITY else None
        if any(names.folded(part) in names.CONFIDENCE for part in re.split(r"[\s._/:-]+", column)):
            self._one = 100
        self._marked = marked
        self._da = any(q < 65536 and q & 0xC0 == 0xC0 for q in seen)
        self._bad_words = bad_words

    def __call__(self, word: str) -> int:
        """Flag for one word; ValueError for one that is not known."""
        if self._marked and len(word) < 2:
            return BAD if word else 0
        if self._one is not None and re.fullmatch(r"-?\d+", word):
            return 0 if int(word) == self._one else BAD
        if word.isdecimal():
            code = int(word)
            if self._da and code < 65536:
                return 0 if code & 0xC0 == 0xC0 else BAD
            if not self._da and (code == 0 or code >= 1 << 16):
                return 0 if code >> 30 == 0 else BAD
            raise ValueError(
                "is neither an OPC UA quality nor, judging by the first rows, an OPC DA quality", _NO_QUALITY
            )
        if word in names.GOOD or word.startswith("good"):
            return 0
        if word in names.POOR or word.startswith(("bad", "uncertain")) or word in self._bad_words:
            return BAD
        raise ValueError("is not a quality that glapp knows", _NO_QUALITY)


def limit_flag(bit: int) -> Callable[[str], int]:
    """Reader of a limit flag column: 1/0, true/false, on/off, yes/no; missing is "not at the limit"."""

    def decide(word: str) -> int:
        if word in {"1", "true", "on", "yes", "active", "limited"}:
            return bit
        if word in {"0", "false", "off", "no", "normal", "inactive", ""}:
            return 0
        raise ValueError("is not a limit flag", "write 1 or 0")

    return decide
