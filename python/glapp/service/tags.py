"""Loops from the names of a server's variables, as a loops.toml."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from ..loop import Loop, Tags
from ..reading.kin import shared
from ..reading.meaning import understand
from ..reading.settings import block, write_settings
from .connection import Connection

__all__ = ["as_settings", "loops_of"]

_ROLES = ("sp", "pv", "op", "mode", "position")


def loops_of(found: Iterable[tuple[str, str]]) -> tuple[dict[str, dict[str, str]], int]:
    """Tags of loops among variables, by the words that control systems use.

    - `found`: path of names and node of each variable.

    Returns: Name of each loop that has SP and PV, and its signals' nodes. How many variables belong to none.

    Examples
    --------
    >>> found = [("Area.FIC101.PV", "ns=2;s=a"), ("Area.FIC101.SP", "ns=2;s=b"), ("Area.TI7", "ns=2;s=c")]
    >>> loops_of(found)
    ({'Area.FIC101': {'pv': 'ns=2;s=a', 'sp': 'ns=2;s=b'}}, 1)
    >>> loops_of([("FIC101.DACA.PV", "ns=2;s=a"), ("FIC101.PIDA.SP", "ns=2;s=b")])
    ({'FIC101': {'pv': 'ns=2;s=a', 'sp': 'ns=2;s=b'}}, 0)
    """
    named: dict[str, dict[str, str]] = {}
    count = 0
    for path, node in found:
        count += 1
        meaning = understand(path)
        if meaning.role in _ROLES and meaning.loop:
            named.setdefault(meaning.loop, {}).setdefault(meaning.role, node)
    others = shared(named)
    loops: dict[str, dict[str, str]] = {}
    unsure = set()  # two variables could be one signal
    for prefix, nodes in named.items():
        for role, node in nodes.items():
            loop = others.get((prefix, role), prefix)
            if loops.setdefault(loop, {}).setdefault(role, node) != node:
                unsure.add(loop)
    whole = {name: nodes for name, nodes in loops.items() if {"pv", "sp"} <= nodes.keys() and name not in unsure}
    return whole, count - sum(len(nodes) for nodes in whole.values())


def as_settings(connection: Connection, loops: Mapping[str, Mapping[str, Any]]) -> str:
    """Text of a loops.toml with these loops, reached by this connection.

    Examples
    --------
    >>> print(as_settings(Connection(url="opc.tcp://plant:4840"), {"FIC101": {"pv": "ns=2;s=a", "sp": "ns=2;s=b"}}))
    [opcua]
    url = "opc.tcp://plant:4840"
    <BLANKLINE>
    [loops.FIC101]
    <BLANKLINE>
    [loops.FIC101.opcua]
    sp = "ns=2;s=b"
    pv = "ns=2;s=a"
    <BLANKLINE>
    """
    made = [Loop(name=name, opcua=Tags(**nodes)) for name, nodes in loops.items()]
    return f"{block('opcua', connection)}\n{write_settings(made)}"
