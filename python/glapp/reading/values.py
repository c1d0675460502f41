"""Cells to numbers and flags: words for missing values, modes, qualities, limit flags."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from ..recording import BAD, NOT_AUTO

__all__ = [
    "CellFault",
    "Quality",
    "limit_flag",
    "mode_flag",
    "null_spellings",
    "numbers",
    "text_of",
    "words",
    "words_for_bad",
]

_BAD_WORDS = """
bad|bad input|bad value|bad data|bad quality|bad_quality|i/o timeout|io timeout|timeout|no data|nodata|no value
no sample|no result|#n/a|n/a|na|#value!|#ref!|#div/0!|#num!|nan|-nan|1.#qnan|-1.#ind|null|<null>|none|nil
comm fail|comm failure
not connected|disconnected|pt created|point created|shutdown|intf shut|scan off|scan timeout|out of serv|out of service
under range|over range|underrange|overrange|invalid|failed|fail|error|err|calc failed|unreliable|configure|offline
arc off-line|-|--|---|?|??|???|*
"""
_BAD_SET = frozenset({"", *(w for line in _BAD_WORDS.split("\n") for w in line.split("|"))})

_NUMBER = r"^[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?$|^[+-]?(inf|infinity)$"
_WHOLE = re.compile(r"\d+\.0*")


class CellFault(Exception):  # noqa: N818 (it never leaves the package: InputError does)
    """A cell that cannot be used: its index in the batch at hand, its text, and what is wrong with it."""

    def __init__(self, index: int, what: str, hint: str | None = None, value: object = None) -> None:
        super().__init__(what)
        self.index, self.what, self.hint, self.value = index, what, hint, value


def words_for_bad(extra: Iterable[str | float]) -> frozenset[str]:
    """All words that stand for a missing value, in lower case."""
    return _BAD_SET | {w.strip().lower() for w in extra if isinstance(w, str)}


def null_spellings(words: Iterable[str]) -> list[str]:
    """The spellings of `words` that a CSV parser compares bytewise; any other one takes the slower, exact road."""
    cases = {s for w in words for s in (w, w.upper(), w.capitalize(), w.title(), w.replace("nan", "NaN"))}
    return sorted(cases | {" " + s for s in cases})


def is_text(kind: pa.DataType) -> bool:
    """Whether values of this Arrow type are text."""
    return bool(pa.types.is_string(kind) or pa.types.is_large_string(kind) or pa.types.is_string_view(kind))


def plain(column: pa.Array) -> pa.Array:
    """The column without a dictionary or runs, and text always as `string`."""
    if pa.types.is_run_end_encoded(column.type):
        column = pc.run_end_decode(column)
    if pa.types.is_dictionary(column.type):
        column = column.dictionary_decode()
    return column.cast(pa.string()) if is_text(column.type) and not pa.types.is_string(column.type) else column


def words(column: pa.Array) -> pa.Array:
    """A column of words, or of numbers that stand for them, without a dictionary.

    Raises
    ------
    CellFault
        Where it holds neither.
    """
    column = plain(column)
    kind = column.type
    if pa.types.is_null(kind):
        return column.cast(pa.string())
    if pa.types.is_float16(kind):  # which Arrow cannot compare
        return column.cast(pa.float32())
    numeric = pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_decimal(kind)
    if not (is_text(kind) or numeric or pa.types.is_boolean(kind)):
        raise CellFault(0, f"holds {kind}, not words or numbers", value=str(kind))
    return column


def numbers(column: pa.Array, bad_words: frozenset[str], comma: bool = False) -> NDArray[np.float64]:
    """Numbers of a column, NaN where missing or not finite.

    Parameters
    ----------
    column : pyarrow.Array
        Numbers, booleans or text.
    bad_words : frozenset of str
        Words that mean "missing", lower case.
    comma : bool
        Whether text may have a decimal comma.

    Raises
    ------
    CellFault
        At the first text that is neither a number nor a word for missing.
    """
    column = plain(column)
    if is_text(column.type):
        column = _parse(column, bad_words, comma)
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


def _parse(column: pa.Array, bad_words: frozenset[str], comma: bool) -> pa.Array:
    column = pc.utf8_trim_whitespace(column)
    missing = pc.is_in(pc.utf8_lower(column), value_set=pa.array(bad_words, pa.string()))
    column = pc.if_else(missing, pa.scalar(None, pa.string()), column)
    written = column
    if comma:
        column = pc.replace_substring(column, ",", ".")
    good = pc.match_substring_regex(column, _NUMBER, ignore_case=True)
    if pc.min(good).as_py() is False:
        at = pc.index(good, False).as_py()
        value = written[at].as_py()
        hint = "write bad values as empty, NaN or Bad, or name them in bad_values"
        raise CellFault(at, f"'{value}' is not a number", hint, value)
    return pc.cast(pc.utf8_ltrim(column, "+"), pa.float64())


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

    Raises
    ------
    CellFault
        At the first cell that `bit_of` refuses with a ValueError, or where the column holds neither words nor numbers.
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


_AUTO = frozenset("auto|aut|a|automatic|cas|cascade|csc|c|rcas|rca|bcas|1|true|remote cascade".split("|"))  # noqa: SIM905
_NOT_AUTO = frozenset(
    "man|m|manual|iman|lo|oos|o/s|track|trk|tracking|rout|prd|0|false|out of service|local override".split("|")  # noqa: SIM905
)


def mode_flag(auto_values: Iterable[str | float] | None, bad_words: frozenset[str]) -> Callable[[str], int]:
    """How to read the mode column; an empty cell or a word for "missing" is not known to be automatic."""
    named = None if auto_values is None else {text_of(v) for v in auto_values}

    def decide(word: str) -> int:
        if named is not None:
            return 0 if word in named else NOT_AUTO
        if word in _AUTO:
            return 0
        if word in _NOT_AUTO or word in bad_words:
            return NOT_AUTO
        raise ValueError("is not a mode known here", 'write the words that mean automatic: auto_values = ["AUTO", ...]')

    return decide


_GOOD_WORDS = frozenset({"g", "ok", "valid", "true", "good"})
_POOR_WORDS = frozenset({"b", "u", "false", "questionable", "doubtful", "suspect", "stale", "substituted"})


class Quality:
    """How to read a quality column: only *good* is good.

    Words: Good... against Bad..., Uncertain..., Questionable and the words for missing. Numbers: OPC DA (the two bits
    of 192 set is good) or OPC UA status codes (the two highest of 32 bits clear is good). 0 is bad in the one and good
    in the other, so the numbers at the start of the column decide: any of 192..255 there means OPC DA.

    Parameters
    ----------
    first : iterable of str
        Normalised words from the start of the column.
    bad_words : frozenset of str
        Words for missing.
    """

    def __init__(self, first: Iterable[str], bad_words: frozenset[str]) -> None:
        seen = {int(w) for w in first if w.isdecimal()}
        self._da = any(q < 65536 and q & 0xC0 == 0xC0 for q in seen)
        self._bad_words = bad_words

    def __call__(self, word: str) -> int:
        """Flag for one word; ValueError for one that is not known."""
        if word.isdecimal():
            code = int(word)
            if self._da and code < 65536:
                return 0 if code & 0xC0 == 0xC0 else BAD
            if not self._da and (code == 0 or code >= 1 << 16):
                return 0 if code >> 30 == 0 else BAD
            raise ValueError(
                "is neither an OPC UA nor, as the first rows go, an OPC DA quality",
                'write Good and Bad, or leave the column out: columns = { quality = "" }',
            )
        if word in _GOOD_WORDS or word.startswith("good"):
            return 0
        if word in _POOR_WORDS or word.startswith(("bad", "uncertain")) or word in self._bad_words:
            return BAD
        raise ValueError(
            "is not a quality known here", 'write Good and Bad, or leave the column out: columns = { quality = "" }'
        )


def limit_flag(bit: int) -> Callable[[str], int]:
    """How to read a limit flag column: 1/0, true/false, on/off, yes/no; missing is "not at the limit"."""

    def decide(word: str) -> int:
        if word in {"1", "true", "on", "yes", "active", "limited"}:
            return bit
        if word in {"0", "false", "off", "no", "normal", "inactive", ""}:
            return 0
        raise ValueError("is not a limit flag", "write 1 or 0")

    return decide
