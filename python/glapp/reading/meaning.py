"""Meaning of the name of a column or tag: signal, loop and unit.

Names are split at the usual separators and compared, whatever case and accents, with the words that control systems
use (`glapp.reading.names`)::

    FIC101.PV    FIC101/PID1/PV.CV    101_PV    PV_FIC101    FIC101PV    Set Point [m3/h]    FIC101 Sollwert

MV is the *manipulated* variable, so OP. Some words are another signal in another plant: CV is the output beside a
PV, and the controlled variable beside an MV; Y is the output beside X, and PV beside U. They are taken for the first of
their signals that no other column of the loop is. After another word (PV.CV) CV only says "current value".
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

from .names import CURRENT, LIMITS, SIGNALS, WEAK, WHOLE, folded

__all__ = ["SURE", "is_long", "numbered", "time_of", "understand", "unnumbered", "with_own_qualities"]

_JOINED = re.compile(r"(.*\d)(sp|sv|pv|op|mv|out|co|mode)", re.IGNORECASE)  # FIC101PV
_TOKEN = re.compile(r"[^./_\-:\s|\\#,!]+")
_UNIT = re.compile(r"\s*[\[(]([^\[\]()]*)[\])]\s*$")
_NUMBERED = re.compile(r" \(column \d+\)$")  # see `numbered`
_SEPARATORS = "./_-:|\\#,! \t"
_FIELD = re.compile(r"\.[AF]_CV$", re.IGNORECASE)  # FIX.FIC101_PV.F_CV of iFIX and Proficy
_HOST = re.compile(r"\.\w+@\w+")  # FIC101_PV.UNIT1@NET1 of Ovation
_MOST_WORDS = 4  # "position de la vanne"
SURE = {"quality": "opcquality", "value": "value"}
"""Role to the name of the column that is taken where several have the role.

Value is meant beside value_double, and OPCQuality beside the historian's own Quality and QualityDetail.
"""
_INSIDE = 6  # letters of a word that is a signal's in the middle of a name too


@dataclass(frozen=True, slots=True)
class Meaning:
    """Meaning of a column's name: role, loop ("" where the name has no more to it), unit, and a word of `WEAK`."""

    role: str | None
    loop: str = ""
    unit: str | None = None
    weak: str | None = None


@lru_cache(maxsize=1 << 16)
def understand(name: str) -> Meaning:
    """Read a column's name.

    Examples
    --------
    >>> understand("FIC101/PID1/PV.CV")
    Meaning(role='pv', loop='FIC101/PID1', unit=None, weak=None)
    >>> understand("FIC101 Börvärde [m3/h]")
    Meaning(role='sp', loop='FIC101', unit='m3/h', weak=None)
    >>> understand("FIC101.CV")
    Meaning(role=None, loop='FIC101', unit=None, weak='cv')
    >>> understand("FIC101SP.UNIT1@NET1").loop
    'FIC101.UNIT1@NET1'
    >>> understand("PV_HI_LIM").role is None
    True
    """
    if host := _HOST.search(name):
        of = understand(name.replace(host[0], "", 1))
        return replace(of, loop=of.loop + host[0]) if of.loop else of
    text, unit = _FIELD.sub("", _NUMBERED.sub("", name.strip())), None
    if found := _UNIT.search(text):
        text, unit = text[: found.start()], found.group(1).strip() or None
    tokens = list(_TOKEN.finditer(text))
    words = [folded(t.group()) for t in tokens]
    if not words:
        return Meaning(None)
    whole = "".join(words)
    weak = whole if whole in WEAK else None
    if (role := WHOLE.get(whole) or SIGNALS.get(whole)) or weak:
        return Meaning(role, "", unit, weak)
    head, comma, _ = text.partition(",")
    if comma and (of := understand(head)).role is not None:  # FIC101:PV,Log-1s
        return Meaning(of.role, of.loop, unit)
    last = words[-1]
    while len(words) > 1 and words[-1] in CURRENT and not _two_words(words):
        tokens.pop(), words.pop()
    if LIMITS.intersection(words):
        return Meaning(None)
    for count in range(min(_MOST_WORDS, len(words)), 0, -1):  # "set point" before "point"
        if role := SIGNALS.get("".join(words[-count:])):
            rest = text[: tokens[-count].start()].rstrip(_SEPARATORS)
        elif role := SIGNALS.get("".join(words[:count])):
            rest = text[tokens[count - 1].end() :].strip(_SEPARATORS)
        else:
            continue
        of = understand(rest) if rest else Meaning(None)
        if role == "quality" and of.role is not None:  # FIC101.PV.STATUS is PV's, FIC101.SP.STATUS of no use
            return Meaning("quality", of.loop) if of.role == "pv" else Meaning(None)
        return Meaning(role, of.loop if of.role == role else rest, unit)  # FIC101.SP Sollwert
    if joined := _JOINED.fullmatch(text[: tokens[-1].end()]):
        return Meaning(SIGNALS[joined.group(2).lower()], joined.group(1), unit)
    if last in WEAK:
        rest = text[: text.rindex(list(_TOKEN.finditer(text))[-1].group())].rstrip(_SEPARATORS)
        return Meaning(None, rest, unit, last)
    inside = [i for i, word in enumerate(words) if _inside(word)]
    if len(inside) == 1:  # FIC101 PV reflux
        [i] = inside
        before, after = text[: tokens[i].start()].rstrip(_SEPARATORS), text[tokens[i].end() :].strip(_SEPARATORS)
        return Meaning(SIGNALS[words[i]], f"{before} {after}", unit)
    return Meaning(None)


def numbered(names: Sequence[str], numbers: Sequence[int]) -> list[str]:
    """Names in which those that repeat have the numbers of their columns, so that a person can distinguish them.

    Examples
    --------
    >>> numbered(["t", "F1.PV", "F1.SP", "F1.PV"], [1, 2, 3, 4])
    ['t', 'F1.PV (column 2)', 'F1.SP', 'F1.PV (column 4)']
    """
    count = Counter(names)
    pairs = zip(names, numbers, strict=True)
    return [f"{name} (column {number})" if name and count[name] > 1 else name for name, number in pairs]


def unnumbered(name: str) -> str:
    """The name as the file has it, without the number that `numbered` gave it."""
    return _NUMBERED.sub("", name)


def with_own_qualities(names: Sequence[str]) -> list[str]:
    """Names in which each of several columns called Quality is called after the signal on its left.

    Examples
    --------
    >>> with_own_qualities(["Time", "F1.SP", "Quality", "F1.PV [m3/h]", "Quality"])
    ['Time', 'F1.SP', 'F1.SP Quality', 'F1.PV [m3/h]', 'F1.PV Quality']
    >>> with_own_qualities(["Quality", "Time", "F1.SP", "F1.PV", "Quality"])
    ['Quality', 'Time', 'F1.SP', 'F1.PV', 'Quality']
    """
    meant = [understand(name) for name in names]
    at = [i for i, meaning in enumerate(meant) if (meaning.role, meaning.loop) == ("quality", "")]
    signals = [meant[i - 1].role if i else None for i in at]
    if len(at) < 2 or "pv" not in signals or not {"sp", "pv", "op", "mode", "position"}.issuperset(signals):
        return list(names)
    found = list(names)
    for i in at:
        found[i] = f"{_UNIT.sub('', names[i - 1]).strip()} {names[i].strip()}"
    return found


def time_of(name: str) -> str | None:
    """The tag of which a column's name says that it holds the times; None where it does not say so.

    Examples
    --------
    >>> time_of("FIC101_PV_TIMESTAMP"), time_of("FIC101.PV Time"), time_of("Time"), time_of("FIC101.PV")
    ('FIC101_PV', 'FIC101.PV', None, None)
    """
    tokens = list(_TOKEN.finditer(name))
    if len(tokens) < 2 or WHOLE.get(folded(tokens[-1].group())) != "time":
        return None
    tag = name[: tokens[-1].start()].strip(_SEPARATORS)
    return tag if understand(tag).role in ("sp", "pv", "op", "mode", "position") else None


def _two_words(words: Sequence[str]) -> bool:
    """Whether the last words are a signal together: a Process Value is more than a Process."""
    if words[-2] in SIGNALS:
        return False
    return any("".join(words[-count:]) in SIGNALS for count in range(2, _MOST_WORDS + 1))


def _inside(word: str) -> bool:
    """Whether a word is a signal's wherever in a name it stands."""
    return SIGNALS.get(word) in ("sp", "pv", "op") and (len(word) >= _INSIDE or word in ("sp", "sv", "pv", "op", "mv"))


def is_long(names: Sequence[str]) -> bool:
    """Whether this is a long table: a row per tag and time.

    Examples
    --------
    >>> is_long(["Timestamp", "TagName", "Value", "Quality"])
    True
    """
    roles = [understand(name).role for name in names]
    return {"tag", "value"} <= set(roles) and "pv" not in roles
