"""Loops from the names of a server's variables, as a loops.toml."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from ..controller import Span
from ..loop import Loop, Tags
from ..reading.kin import shared
from ..reading.meaning import understand
from ..reading.settings import block, write_settings
from .connection import Connection

__all__ = ["as_settings", "loops_of", "ranges_of"]

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


def ranges_of(
    loops: Mapping[str, Mapping[str, str]], spans: Mapping[str, Span], units: Mapping[str, str]
) -> dict[str, dict[str, Any]]:
    """Spans and units of loops as keys of `Loop`: those of PV and OP as the server has them, else of SP as of PV.

    - `spans`, `units`: node to what the server says of it.

    Examples
    --------
    >>> ranges_of({"FIC101": {"pv": "s=a", "op": "s=b"}}, {"s=a": (0.0, 50.0)}, {"s=a": "m3/h", "s=b": "%"})
    {'FIC101': {'pv_span': (0.0, 50.0), 'pv_unit': 'm3/h', 'op_unit': '%'}}
    """
    found: dict[str, dict[str, Any]] = {}
    for name, nodes in loops.items():
        for key, like in (("pv", "sp"), ("op", "op")):
            for what, known in (("span", spans), ("unit", units)):
                said = [known[nodes[of]] for of in (key, like) if of in nodes and nodes[of] in known]
                if said:
                    found.setdefault(name, {})[f"{key}_{what}"] = said[0]
    return found


def as_settings(
    connection: Connection,
    loops: Mapping[str, Mapping[str, Any]],
    ranges: Mapping[str, Mapping[str, Any]] | None = None,
) -> str:
    """Text of a loops.toml with these loops, reached by this connection, and with their spans and units.

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
    made = [Loop(name=name, opcua=Tags(**nodes), **(ranges or {}).get(name, {})) for name, nodes in loops.items()]
    return f"{block('opcua', connection)}\n{write_settings(made)}"
