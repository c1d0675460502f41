"""Prefixes of one loop: the blocks that a control system builds it of, and the tags of its instruments.

`FIC101/PIDA.SP` and `FIC101/DACA.PV` are signals of two blocks of FIC101. `FT101.PV`, `FIC101.SP` and `FV101.OP` have
the measured variable F and the number 101 in common, as ISA-5.1 names the instruments of one loop. A block or an
instrument has only the signals of its kind: the SP of an output block is no setpoint of the loop.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from typing import NamedTuple

from .names import BLOCKS, folded

__all__ = ["shared", "tag_of"]

_BLOCK = re.compile(r"(.*[^./_\-:\s|\\#,!])[./_\-:\s|\\#,!]+([^./_\-:\s|\\#,!]*?)\d*")
"""A tag, and the name of a block without its number."""
_INSTRUMENT = re.compile(r"((?:.*[^a-z])?)([a-z][dfq]?)([ceirtvyz]+)[-_ ]?(\d[\da-z]*)", re.IGNORECASE)
"""What stands before a tag of ISA-5.1, its measured variable, what it does, and its number."""

_ALL = frozenset({"sp", "pv", "op", "mode", "position", "quality"})
_OF = {
    "controller": _ALL,
    "input": frozenset({"pv", "quality"}),
    "output": frozenset({"op", "position"}),
}
"""Roles that a kind of block or instrument has in its loop."""


class _Kin(NamedTuple):
    """A prefix: what it has in common with others of its loop, its name without a block, and the roles it has."""

    key: str
    tag: str
    roles: frozenset[str]


def _kin(prefix: str) -> _Kin:
    """Take a prefix apart."""
    tag, kind = prefix, None
    if (block := _BLOCK.fullmatch(prefix)) and (kind := BLOCKS.get(folded(block[2]))):
        tag = block[1]
    if (found := _INSTRUMENT.fullmatch(tag)) is None:
        return _Kin(folded(tag), tag, _OF[kind or "controller"])
    before, variable, does, number = found.groups()
    if kind is None:
        letters = set(does.lower())
        kind = "output" if letters & set("vyz") else "controller" if "c" in letters else "input"
    return _Kin(folded(before + variable + number), tag, _OF[kind])


def tag_of(prefix: str) -> str:
    """The prefix without the block at its end.

    Examples
    --------
    >>> tag_of("Area1/FIC101/PID1"), tag_of("FIC101")
    ('Area1/FIC101', 'FIC101')
    """
    return _kin(prefix).tag


def shared(signals: Mapping[str, Collection[str]]) -> dict[tuple[str, str], str]:
    """The loop of each signal whose prefix is not its loop's.

    Where one prefix has SP and PV, or PV and OP, it is the loop, and takes what it lacks where one other has it. Where
    none has, all of them are one loop, called after its controller. Two whole loops share nothing.

    - `signals`: prefix to the roles of its names.

    Returns: prefix and role to the loop.

    Examples
    --------
    >>> shared({"FIC101/DACA": {"pv"}, "FIC101/PIDA": {"sp", "op"}})
    {('FIC101/DACA', 'pv'): 'FIC101', ('FIC101/PIDA', 'op'): 'FIC101', ('FIC101/PIDA', 'sp'): 'FIC101'}
    >>> shared({"FIC101/PID1": {"sp", "pv", "op"}, "FIC101": {"mode"}, "TI7": {"pv"}})
    {('FIC101', 'mode'): 'FIC101/PID1'}
    """
    families: dict[str, dict[str, _Kin]] = {}
    for prefix in signals:
        if prefix:
            kin = _kin(prefix)
            families.setdefault(kin.key, {})[prefix] = kin
    found: dict[tuple[str, str], str] = {}
    for family in families.values():
        if len(family) > 1:
            found |= _of_family(family, {prefix: _ALL.intersection(signals[prefix]) for prefix in family})
    return found


def _of_family(family: Mapping[str, _Kin], has: Mapping[str, Collection[str]]) -> dict[tuple[str, str], str]:
    """The loop of each signal in one family of prefixes."""
    fits = {prefix: sorted(kin.roles.intersection(has[prefix])) for prefix, kin in family.items()}
    whole = [prefix for prefix in family if {"sp", "pv"} <= set(has[prefix])]
    whole = whole or [prefix for prefix in family if {"pv", "op"} <= set(fits[prefix])]
    if len(whole) > 1:
        return {}
    if whole:
        [loop] = whole
        others = [(prefix, role) for prefix in family if prefix != loop for role in fits[prefix]]
        roles = [role for _, role in others]
        return {
            (prefix, role): loop
            for prefix, role in others
            if role != "quality" and role not in has[loop] and roles.count(role) == 1
        }
    having = {role for roles in fits.values() for role in roles}
    if "pv" not in having or not having & {"sp", "op"}:
        return {}
    first = next(prefix for role in ("sp", "op") for prefix in family if role in fits[prefix])
    return {(prefix, role): family[first].tag for prefix in family for role in fits[prefix]}
