"""Which column, or which tag, is which signal of which loop.

Names are split at the usual separators and compared, whatever the case, with the words that control systems use::

    FIC101.PV    FIC101/PID1/PV.CV    101_PV    PV_FIC101    FIC101PV    Set Point [m3/h]

MV is the *manipulated* variable, hence OP. CV alone is not guessed: it is the output in some systems, the controlled
variable in others; after another word (PV.CV) it only says "current value".
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from ..checked import nearest
from ..errors import InputError
from ..loop import Loop

__all__ = ["LABELS", "Signals", "choose", "is_long", "understand"]

LABELS = {
    "time": "time",
    "sp": "SP",
    "pv": "PV",
    "op": "OP",
    "mode": "MODE",
    "quality": "quality",
    "op_low_flag": "OP low flag",
    "op_high_flag": "OP high flag",
    "position": "position",
    "tag": "tag",
    "value": "value",
}
"""Role to the word that people see."""

_WORDS: dict[str, str] = {
    word: role
    for role, words in {
        "sp": "sp sv spt setpoint setpt setp wsp sollwert",
        "pv": "pv meas measurement processvalue processvariable processvar istwert",
        "op": "op mv out output co controlleroutput controloutput outputvalue manipulatedvariable "
        "stellgrösse stellgröße",
        "mode": "mode md modeactual actualmode controlmode controllermode automan",
        "quality": "quality qual status pvquality pvstatus qualitycode statuscode",
        "position": "position pos posn valveposition valvepos actualposition travel",
    }.items()
    for word in words.split()
}
_WHOLE: dict[str, str] = {
    word: role
    for role, words in {
        "time": "time t ts timestamp date datetime datetimeutc timeutc utctime timestamputc localtime timelocal "
        "sampletime epoch zeit zeitstempel datum datumzeit tid tidpunkt",
        "tag": "tag tagname point pointname pointid item itemid signal signalname variable name nodeid",
        "value": "value val reading wert värde",
    }.items()
    for word in words.split()
}
_CURRENT = {"cv", "value", "val", "act", "actual", "eu", "current"}  # PV.CV, SP_VALUE: says nothing more
_JOINED = re.compile(r"(.*\d)(sp|sv|pv|op|mv|out|co|mode)", re.IGNORECASE)  # FIC101PV
_TOKEN = re.compile(r"[^./_\-:\s|\\#,!]+")
_UNIT = re.compile(r"\s*[\[(]([^\[\]()]*)[\])]\s*$")
_SEPARATORS = "./_-:|\\#,! \t"
_LIMITS = {"hi", "lo", "hihi", "lolo", "hh", "ll", "high", "low", "lim", "limit", "max", "min", "alarm", "alm", "scale"}


@dataclass(frozen=True, slots=True)
class Meaning:
    """What a column's name says: role, loop ("" where the name has no more to it) and unit."""

    role: str | None
    loop: str = ""
    unit: str | None = None


def understand(name: str) -> Meaning:
    """Read a column's name.

    Examples
    --------
    >>> understand("FIC101/PID1/PV.CV")
    Meaning(role='pv', loop='FIC101/PID1', unit=None)
    >>> understand("Set Point [m3/h]")
    Meaning(role='sp', loop='', unit='m3/h')
    >>> understand("PV_HI_LIM").role is None
    True
    """
    text, unit = name.strip(), None
    if found := _UNIT.search(text):
        text, unit = text[: found.start()], found.group(1).strip() or None
    tokens = list(_TOKEN.finditer(text))
    words = [t.group().lower() for t in tokens]
    if not words:
        return Meaning(None)
    whole = "".join(words)
    if whole in _WHOLE:
        return Meaning(_WHOLE[whole], "", unit)
    if whole in _WORDS:
        return Meaning(_WORDS[whole], "", unit)
    while len(words) > 1 and words[-1] in _CURRENT:
        tokens.pop(), words.pop()
    if _LIMITS.intersection(words):
        return Meaning(None)
    for count in (2, 1):  # "set point" before "point"
        if len(words) < count:
            continue
        if role := _WORDS.get("".join(words[-count:])):
            rest = text[: tokens[-count].start()].rstrip(_SEPARATORS)
        elif role := _WORDS.get("".join(words[:count])):
            rest = text[tokens[count - 1].end() :].strip(_SEPARATORS)
        else:
            continue
        if role == "quality" and rest:  # FIC101.PV.STATUS is the quality of PV, FIC101.SP.STATUS is of no use
            of = understand(rest)
            if of.role is not None:
                return Meaning("quality", of.loop) if of.role == "pv" else Meaning(None)
        return Meaning(role, rest, unit)
    if joined := _JOINED.fullmatch(text[: tokens[-1].end()]):
        return Meaning(_WORDS[joined.group(2).lower()], joined.group(1), unit)
    return Meaning(None)


def is_long(names: Sequence[str]) -> bool:
    """Whether this is a long table: a row per tag and time.

    Examples
    --------
    >>> is_long(["Timestamp", "TagName", "Value", "Quality"])
    True
    """
    roles = [understand(name).role for name in names]
    return {"tag", "value"} <= set(roles) and "pv" not in roles


class Signals:
    """The columns of a wide table, or the tags of a long one, each name understood once for all loops.

    Parameters
    ----------
    names : iterable of str
        In the order in which they appear; they may repeat.

    Attributes
    ----------
    names : list of str
        The same.
    groups : list of str
        Loops that have SP and PV, in the order in which they appear; where none has, those with PV and OP. "" stands
        for names without a prefix.

    Examples
    --------
    >>> Signals(["t", "FIC101.SP", "FIC101.PV", "TI7.PV", "FIC102.PV", "FIC102.SP"]).groups
    ['FIC101', 'FIC102']
    """

    def __init__(self, names: Iterable[str]) -> None:
        self.names = list(names)
        self._meant: dict[tuple[str, str], list[str]] = {}
        self._times: list[str] = []
        self._folded: dict[str, list[str]] = {}
        roles: dict[str, set[str]] = {}
        for name in self.names:
            self._folded.setdefault(name.strip().lower(), []).append(name)
            meaning = understand(name)
            if meaning.role is None:
                continue
            self._meant.setdefault((meaning.role, meaning.loop), []).append(name)
            if meaning.role == "time":
                self._times.append(name)
            elif meaning.role in ("sp", "pv", "op"):
                roles.setdefault(meaning.loop, set()).add(meaning.role)
        # A transmitter has an output as well: where there are setpoints, what has none is no loop.
        kinds = ({"sp", "pv"}, {"pv", "op"})
        having = ([loop for loop, have in roles.items() if kind <= have] for kind in kinds)
        self.groups = next((groups for groups in having if groups), [])
        self._exact = set(self.groups)
        self._group = {group.lower(): group for group in reversed(self.groups)}

    def loops(self, stem: str) -> dict[str, str]:
        """Name of every loop that the names show to its prefix; the one without a prefix has the name `stem`.

        Examples
        --------
        >>> Signals(["t", "SP", "PV", "FIC1.SP", "FIC1.PV"]).loops("FIC1")
        {'FIC1 (no prefix)': '', 'FIC1': 'FIC1'}
        """
        bare = stem if stem not in self._exact else f"{stem} (no prefix)"
        return {group or bare: group for group in self.groups or [""]}

    def group_of(self, loop: Loop) -> str | None:
        """Prefix within which this loop's columns are guessed: its own name, or the only one there is."""
        if loop.name in self._exact:
            return loop.name
        if (group := self._group.get(loop.name.lower())) is not None:
            return group
        if len(self.groups) == 1:
            return self.groups[0]
        return None if self.groups else ""

    def named(self, name: str) -> list[str]:
        """Those that a person who wrote `name` means."""
        like = self._folded.get(name.strip().lower(), [])
        return [n for n in like if n == name] or like

    def meant(self, role: str, group: str) -> list[str]:
        """Those that are `role` of the loop `group`, by their names."""
        if role == "time":
            return self._times
        found = self._meant.get((role, group), [])
        if found or len(self.groups) > 1:
            return found
        return self._meant.get((role, ""), [])  # a MODE or OP beside FIC101.PV belongs to the only loop there is


def choose(signals: Signals, loop: Loop, group: str | None, label: str, *, tags: bool = False) -> dict[str, str]:
    """Column (or tag) for every role of one loop that has one: named by the user, or guessed within `group`.

    Parameters
    ----------
    signals : Signals
        Columns or tags there are.
    loop : Loop
        Its `columns` win over guesses; an empty string there means "there is none".
    group : str or None
        Prefix of this loop's columns, one of `signals.groups`; None when nothing may be guessed.
    label : str
        File as the user wrote it, for messages.
    tags : bool
        Whether `signals` are the tags of a long table.

    Raises
    ------
    InputError
        For a named column that is not there, two columns that fit one role, and where PV is missing, or SP and OP are.
    """
    kind = "tag" if tags else "column"
    wanted: Mapping[str, str | None] = loop.columns.model_dump()
    chosen: dict[str, str] = {}
    for role in LABELS:
        if role in ("tag", "value") or (tags and role in ("time", "quality")):
            continue
        named = wanted[role]
        if named is not None:
            if named:
                chosen[role] = _named(signals, named, role, loop, label, kind)
        elif guessed := _guess(signals, role, group, label, kind):
            chosen[role] = guessed
    missing = [LABELS[role] for role in ("sp", "pv") if role not in chosen]
    if "pv" not in chosen or not chosen.keys() & {"sp", "op"}:
        raise InputError(
            f"no {kind} for {' and '.join(missing)} among: {_listed(signals.names)}",
            file=label,
            loop=loop.name if group is None else None,
            column=None,
            hint=f'name it in loops.toml: columns = {{ {missing[0].lower()} = "..." }}',
        )
    return chosen


def _named(signals: Signals, named: str, role: str, loop: Loop, label: str, kind: str) -> str:
    same = signals.named(named)
    if len(same) == 1:
        return same[0]
    if same:
        raise InputError(
            f"there are {len(same)} {kind}s of this name", file=label, column=named, hint="give them different names"
        )
    names = signals.names
    near = nearest(named, {n.lower(): n for n in names})
    near = next((n for n in names if n.lower() == near), None)
    raise InputError(
        f"no {kind} '{named}' for {LABELS[role]}"
        + (f", did you mean '{near}'?" if near else ".")
        + f" There are: {_listed(names)}",
        file=label,
        loop=loop.name,
        parameter=f"columns.{role}",
        value=named,
    )


def _guess(signals: Signals, role: str, group: str | None, label: str, kind: str) -> str | None:
    if group is None and role != "time":
        return None
    fits = signals.meant(role, group or "")
    if len(fits) > 1:
        key = role
        raise InputError(
            f"the {kind}s {' and '.join(repr(f) for f in fits)} could both be {LABELS[role]}",
            file=label,
            hint=f'name the right one in loops.toml: columns = {{ {key} = "{fits[0]}" }}',
        )
    return fits[0] if fits else None


def _listed(names: Sequence[str]) -> str:
    shown = ", ".join(n if n.strip() else "(no name)" for n in names[:20])
    return f"{shown} and {len(names) - 20} more" if len(names) > 20 else shown
