"""Assignment of columns and tags to the signals of loops, by what their names mean (`glapp.reading.meaning`)."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence, Set
from typing import Any, Literal

from ..checked import nearest
from ..errors import InputError
from ..loop import Loop
from ..recording import MEMORY, Recording
from .each import each
from .kin import shared, tag_of
from .meaning import understand, unnumbered
from .names import WEAK
from .values import holds_modes

__all__ = ["LABELS", "SignalColumns", "choose", "described_one", "each_with_columns", "for_one", "naming"]

_DIGITS = re.compile(r"\d+")
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


class SignalColumns:
    """The columns of a wide table, or the tags of a long one, each name understood once for all loops.

    - `names`: in the order in which they appear; they may repeat.
    - `time`: name of the column that holds times, where its name does not say so.
    - `first`: gives the first cells of a column, which tell a mode from a position where their names do not.

    - `names`: the same.
    - `groups`: loops that have SP and PV, in the order in which they appear; where none has, those with PV and OP. ""
      stands for names without a prefix.
    - `passed_over`: those that are not taken for loops, to the signal that they lack: those with PV and OP, where
      others have SP too, and those with SP and OP.

    Examples
    --------
    >>> SignalColumns(["t", "FIC101.SP", "FIC101.PV", "TI7.PV", "FIC102.PV", "FIC102.SP"]).groups
    ['FIC101', 'FIC102']
    """

    def __init__(
        self, names: Iterable[str], time: str | None = None, first: Callable[[str], Iterable[str]] = lambda name: ()
    ) -> None:
        self.names = list(names)
        self._meant: dict[tuple[str, str], list[str]] = {}
        self._times: list[str] = [] if time is None else [name for name in self.names if unnumbered(name) == time]
        self._folded: dict[str, list[str]] = {}
        self._loose: dict[str, dict[str | None, list[str]]] | None = None
        roles: dict[str, set[str]] = {}
        for name, (role, loop) in zip(self.names, _signals(self.names, first), strict=True):
            for written in {name, unnumbered(name)}:
                self._folded.setdefault(written.strip().lower(), []).append(name)
            if role is None:
                continue
            self._meant.setdefault((role, loop), []).append(name)
            if role == "time" and time is None:
                self._times.append(name)
            elif role in ("sp", "pv", "op"):
                roles.setdefault(loop, set()).add(role)
        # A transmitter has an output as well: where there are setpoints, what has none is no loop.
        kinds = ({"sp", "pv"}, {"pv", "op"})
        having = [[loop for loop, have in roles.items() if kind <= have] for kind in kinds]
        with_sp, with_op = having
        self.groups = with_sp or with_op
        self._exact = set(self.groups)
        self.passed_over: dict[str, Literal["sp", "pv"]] = {
            loop: "pv" if "sp" in have else "sp"
            for loop, have in roles.items()
            if "op" in have and len(have) == 2 and loop not in self._exact
        }
        self._group = {group.lower(): group for group in reversed([*self.groups, *self.passed_over])}

    def loops(self, stem: str) -> dict[str, str]:
        """Name of every loop that the names show to its prefix; the one without a prefix has the name `stem`.

        Examples
        --------
        >>> SignalColumns(["t", "SP", "PV", "FIC1.SP", "FIC1.PV"]).loops("FIC1")
        {'FIC1 (no prefix)': '', 'FIC1': 'FIC1'}
        """
        bare = stem if stem not in self._exact else f"{stem} (no prefix)"
        return {group or bare: group for group in self.groups or [""]}

    def own_group(self, loop: Loop) -> str | None:
        """Prefix that is this loop's name, be it one that is taken for a loop only because somebody names it."""
        if loop.name in self._exact or loop.name in self.passed_over:
            return loop.name
        return self._group.get(loop.name.lower())

    def group_of(self, loop: Loop) -> str | None:
        """Prefix within which this loop's columns are guessed: its own name, or the only one there is."""
        if (group := self.own_group(loop)) is not None:
            return group
        if len(self.groups) == 1:
            return self.groups[0]
        return None if self.groups else ""

    def named(self, name: str) -> list[str]:
        """Columns that a person who wrote `name` means."""
        like = self._folded.get(name.strip().lower(), [])
        return [n for n in like if n == name] or like

    def meant(self, role: str, group: str) -> list[str]:
        """Columns that are `role` of the loop `group`, by their names."""
        if role == "time":
            return self._times
        found = self._meant.get((role, group), [])
        if found or len(self.groups) > 1:
            return found
        return self._meant.get((role, ""), [])  # a MODE or OP beside FIC101.PV belongs to the only loop there is

    def of_no_loop(self, role: str, near: str | None) -> list[str]:
        """Columns that are `role` by their names, of which none of the loops there are has the prefix.

        - `near`: only those whose names have no other word, or the number that this name of a loop has.
        """
        if self._loose is None:
            self._loose = {}
            for (one, of), names in self._meant.items():
                if of not in self._exact:
                    self._loose.setdefault(one, {}).setdefault(_number(of) if of else "", []).extend(names)
        loose = self._loose.get(role, {})
        if near is None:
            return [name for names in loose.values() for name in names]
        return [*loose.get("", []), *loose.get(_number(near), [])]


def _number(prefix: str) -> str | None:
    """The last number in a prefix, its block left out: 101 of FIC101/PID1."""
    digits = _DIGITS.findall(tag_of(prefix))
    return digits[-1] if digits else None


def _signals(names: Sequence[str], first: Callable[[str], Iterable[str]]) -> list[tuple[str | None, str]]:
    """Role and loop of each name, by what the others are; `first` as of `SignalColumns`."""
    meanings = [understand(name) for name in names]
    roles: dict[str, set[str]] = {}
    weak: dict[str, dict[str, list[int]]] = {}
    for i, meaning in enumerate(meanings):
        if meaning.weak is not None:
            weak.setdefault(meaning.loop, {}).setdefault(meaning.weak, []).append(i)
        if meaning.role is not None:
            roles.setdefault(meaning.loop, set()).add(meaning.role)
    found = [(meaning.role, meaning.loop) for meaning in meanings]
    for loop, words in weak.items():
        may_be = {word: _kind_of(WEAK[word], (first(names[i]) for i in at)) for word, at in words.items()}
        for role, same in _settled(words, may_be, roles.setdefault(loop, set())):
            for i in same:
                found[i] = role, loop
    others = shared(roles)
    return [(role, others.get((loop, role or ""), loop)) for role, loop in found]


def _kind_of(roles: Sequence[str], cells: Iterable[Iterable[str]]) -> Sequence[str]:
    """The roles that agree with the cells of the columns: a mode has words, and any other signal has numbers."""
    if "mode" not in roles:
        return roles
    words = any(map(holds_modes, cells))
    return [role for role in roles if (role == "mode") == words]


def _settled(
    words: Mapping[str, list[int]], may_be: Mapping[str, Sequence[str]], have: set[str]
) -> list[tuple[str, list[int]]]:
    """Roles of one loop's columns whose words depend on the others; `have` are those that are sure, and gets these.

    A word that only one role is left for goes first; a lone X or CV is no loop. `may_be`: roles of each word.
    """
    settled: list[tuple[str, list[int]]] = []
    open_ = dict(words)
    if not have & {"sp", "pv", "op", "position"} and len(open_) < 3:
        return settled
    while open_:
        left = {word: [role for role in may_be[word] if role not in have] for word in open_}
        sure = [word for word, roles in left.items() if len(roles) == 1]
        first = next((word for word, roles in left.items() if roles), None)
        if first is None:
            break
        for word in sure or [first]:
            settled.append((left[word][0], open_.pop(word)))
            have.add(left[word][0])
    return settled


def choose(
    signals: SignalColumns, loop: Loop, group: str | None, label: str, *, tags: bool = False, kind: str = "column"
) -> dict[str, str]:
    """Column (or tag) for every role of one loop that has one: named by the user, or guessed within `group`.

    - `signals`: columns or tags there are.
    - `loop`: its `columns` win over guesses; an empty string there means "there is none".
    - `group`: prefix of this loop's columns, one of `signals.groups`; None when nothing may be guessed.
    - `label`: file as the user wrote it, for messages.
    - `tags`: whether `signals` are the tags of a long table.
    - `kind`: what a person calls them.

    Raises InputError for a named column that is not there, two columns that fit one role, and where PV is missing, or
    SP and OP are.
    """
    wanted: Mapping[str, str | None] = loop.columns.model_dump()
    roles = [r for r in LABELS if r not in ("tag", "value") and not (tags and r in ("time", "quality"))]
    named = {role: _named(signals, name, role, loop, label, kind) for role in roles if (name := wanted[role])}
    chosen: dict[str, str] = {}
    for role in roles:
        if role in named:
            chosen[role] = named[role]
        elif wanted[role] is None and (guessed := _guess(signals, role, group, label, kind, named.values())):
            chosen[role] = guessed
    if (
        "position" in chosen
        and wanted["position"] is wanted["op"] is None
        and "op" not in chosen
        and not loop.controller
    ):
        raise _position_alone(chosen["position"], label, kind)
    if "pv" not in chosen or not chosen.keys() & {"sp", "op"}:
        raise _missing(signals, chosen, loop, group, label, kind)
    return chosen


def each_with_columns(
    signals: SignalColumns,
    loops: Sequence[Loop] | None,
    defaults: Mapping[str, Any] | None,
    make: Callable[[Loop, dict[str, str]], Recording],
    *,
    only: Collection[str] | None,
    stem: str,
    label: str,
    tags: bool = False,
    kind: str = "column",
) -> list[Recording | InputError]:
    """Recordings that `make` opens for every loop and its columns, or the errors in their place.

    - `loops`: None for those that the names show.
    - `defaults`: settings of these.
    - `only`: the loops that are wanted of these, none for all: what describes one loop is said of the one that is
      wanted. None: all that the settings say is said of each loop.
    - `stem`: name of a loop whose columns have no prefix.
    - `label`, `tags`, `kind`: as of `choose`.

    Raises InputError where settings describe one loop, and several are wanted.
    """
    found: dict[str, str] = {}
    if loops is None:
        found = signals.loops(stem)
        loops = _described(list(found), defaults or {}, only, label)
    named = {name for loop in loops for name in loop.columns.model_dump().values() if name}
    several = len(loops) > 1 or len(signals.groups) > 1

    def left_out(loop: Loop, group: str | None, chosen: Mapping[str, str]) -> list[str]:
        """Say which signals are not read, and may be in columns that no loop names or has by their names."""
        taken, notes = {*named, *chosen.values()}, []
        for role in ("sp", "op", "mode"):
            if role in chosen or getattr(loop.columns, role) is not None:
                continue
            near = (group or loop.name) if several else None
            if names := [name for name in signals.of_no_loop(role, near) if name not in taken]:
                option = f"--{role} '{names[0]}', or " if found and not several else ""
                todo = f'{option}in loops.toml columns = {{ {role} = "{names[0]}" }}'
                where = f"the {kind}{'s' * (len(names) > 1)} {_listed(names)}"
                notes.append(f"{LABELS[role]} is not read, and may be in {where}: if so, write {todo}")
        return notes

    def made(loop: Loop) -> Recording:
        group = found[loop.name] if found else signals.group_of(loop)
        chosen = choose(signals, loop, group, label, tags=tags, kind=kind)
        recording = make(loop, chosen)
        recording.left_out = left_out(loop, group, chosen)
        return recording

    opened = each(loops, made, label)
    first = next((one for one in opened if isinstance(one, Recording)), None)
    if found and first is not None:  # who names the loops knows which others there are
        first.left_out = [*first.left_out, *_passed_over(signals, named)]
    return opened


def described_one(settings: Mapping[str, Any]) -> list[str]:
    """Options with which settings describe one loop, and no other of the same table.

    Examples
    --------
    >>> described_one({"columns": {"time": "t", "pv": "B.PV", "op": ""}, "controller": {"pb": 80.0}, "n": 9})
    ['--pv', '--pb']
    """
    columns = [role for role in _OF_ONE["columns"] if settings.get("columns", {}).get(role)]
    parts = [key for part in ("controller", "process") for key in settings.get(part, {})]
    whole = [key for key in _OF_ONE["loop"] if key in settings]
    return [f"--{key.replace('_', '-')}" for key in (*columns, *parts, *whole)]


_OF_ONE = {"columns": ("sp", "pv", "op", "mode"), "loop": ("pv_span", "op_span", "repaired")}


def _described(
    names: Sequence[str], settings: Mapping[str, Any], only: Collection[str] | None, label: str
) -> list[Loop]:
    """Loops of one table; what describes one loop is said of the only one, or of the one that is wanted.

    Raises InputError where it would be said of several.
    """
    # With several files a loop may be wanted by its file too: north/day/FIC2.
    wanted = [name for name in names if not only or any(f"/{one}".endswith(f"/{name}") for one in only)]
    options = described_one(settings)
    if only is None:
        wanted = list(names)
    elif options and len(wanted) > 1:
        raise for_one(options, f"{'--loop names' if only else 'holds'} {len(wanted)} loops", wanted, label)
    rest = {key: value for key, value in settings.items() if key not in ("controller", "process", *_OF_ONE["loop"])}
    if columns := settings.get("columns"):
        rest["columns"] = {role: name for role, name in columns.items() if not name or role not in _OF_ONE["columns"]}
    return [Loop(**{**(settings if name in wanted else rest), "name": name}) for name in names]


def for_one(options: Sequence[str], holds: str, names: Sequence[str], label: str) -> InputError:
    """Message where settings that describe one loop would be said of several."""
    which = f"{' '.join(options)} describe{'s' * (len(options) == 1)} one of them"
    hint = f"add --loop '{names[0]}' and no other, where it is that one; or write what each has into a loops.toml"
    return InputError(f"{holds}, {_listed(names)}, and {which}", file=label, hint=hint)


def _passed_over(signals: SignalColumns, named: Set[str]) -> Iterator[str]:
    """Say which names with OP are taken for no loop, and what to do; a sentence for each signal that they lack."""
    why = {
        "sp": "PV and OP of {} are not read, because other loops have SP: name what is a loop in loops.toml",
        "pv": "SP and OP of {} cannot be judged without PV: export PV too, or name it in loops.toml: columns.pv",
    }
    for lacking, text in why.items():
        of = [loop for loop, lacks in signals.passed_over.items() if lacks == lacking]
        if of := [loop for loop in of if named.isdisjoint(signals.meant("op", loop))]:
            yield text.format(_listed(of))


def _missing(
    signals: SignalColumns, chosen: Mapping[str, str], loop: Loop, group: str | None, label: str, kind: str
) -> InputError:
    """Message where PV is missing, or SP and OP are: which is, what is left for it, and what to do."""
    taken = ", ".join(f"{LABELS[role]} is {name}" for role, name in chosen.items())
    also = f" ({taken})" if taken else ""
    unused = [name for name in signals.names if name not in chosen.values()]
    place: Mapping[str, Any] = {"file": label, "loop": loop.name if group is None else None}
    missing = ["pv"] if chosen.keys() & {"sp", "op"} else [role for role in ("pv", "op") if role not in chosen]
    if len(unused) < len(missing):
        if missing == ["pv"]:
            what = f"no {kind} for PV: all are taken{also}"
            hint = "export PV as well; where one of these is PV, name it: --pv NAME, or in loops.toml columns.pv"
            return InputError(what, hint=hint, asks="columns", **place)
        signal = chosen.get("pv") or next(iter(unused), None)
        what = f"has only one signal, {signal}{also}" if signal else f"has no signal{also}"
        hint = "it takes OP and PV of a loop to tell of its valve, and SP tells more: export them into one file"
        return InputError(what, hint=hint, **place)
    # Of FIC101.SP and FIC7.PV no loop can be made, and yet it is plain what is what.
    meant: dict[str | None, list[str]] = {}
    for name in () if signals.groups else unused:
        meant.setdefault(understand(name).role, []).append(name)
    shown = [role for role in missing if role not in meant]
    asked = {
        role: names[0] if len(names) == 1 else "NAME"
        for role in ("pv", "op", "sp", "mode")
        if (len(names := meant.get(role, [])) == 1 and role not in chosen) or role in missing
    }
    what = f"no {kind} for {' and '.join(LABELS[role] for role in shown)} among those left: {_listed(unused)}"
    if not shown:
        what = f"the names of the {kind}s show no loop: {_listed(unused)}"
    return InputError(
        f"{what}{also}",
        hint=f"name {'it' if len(asked) == 1 else 'them'}: {naming(asked, label)}",
        asks="columns",
        **place,
    )


def _named(signals: SignalColumns, named: str, role: str, loop: Loop, label: str, kind: str) -> str:
    """The column that a loop names for a role."""
    same = signals.named(named)
    if len(same) == 1:
        return same[0]
    if same:
        raise _several(same, role, label, kind)
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


def _position_alone(position: str, label: str, kind: str) -> InputError:
    """Message where the valve's position is there and OP is not, and nothing else tells of the controller."""
    return InputError(
        f"the {kind} {position!r} is taken for the position that the valve reports, and none is left for OP",
        file=label,
        hint=f"where it is what the controller sends to the valve, name it: --op '{position}', or in loops.toml "
        f'columns = {{ op = "{position}" }}; else export OP as well',
        asks="columns",
    )


def _guess(
    signals: SignalColumns, role: str, group: str | None, label: str, kind: str, taken: Collection[str]
) -> str | None:
    """The column that a role most likely has, none of those that are `taken`; None where none is plain."""
    if group is None and role != "time":
        return None
    fits = [name for name in signals.meant(role, group or "") if name not in taken]
    if len(fits) > 1:
        raise _several(fits, role, label, kind)
    return fits[0] if fits else None


def _several(fits: Sequence[str], role: str, label: str, kind: str) -> InputError:
    """Message where several columns could be one signal."""
    option = f": --{role} '{fits[0]}', or" if role in ("time", "sp", "pv", "op", "mode", "quality") else ""
    hint = f'name the right one{option} in loops.toml: columns = {{ {role} = "{fits[0]}" }}'
    if label == MEMORY:
        hint = f"name the right one: {naming({role: fits[0]}, label)}"
    return InputError(
        f"the {kind}s {' and '.join(map(repr, fits))} could {'both' if len(fits) == 2 else 'all'} be {LABELS[role]}",
        file=label,
        hint=hint,
        asks="columns",
    )


def naming(columns: Mapping[str, str], label: str) -> str:
    """What names columns: options or a loops.toml; of a table in memory its loop.

    Examples
    --------
    >>> naming({"pv": "NAME"}, "plant.csv")
    '--pv NAME, or in loops.toml columns = { pv = "NAME" }'
    >>> naming({"pv": "NAME"}, "memory")
    'loop = glapp.Loop(name="loop", columns={"pv": "NAME"})'
    """
    if label == MEMORY:
        return f'loop = glapp.Loop(name="loop", columns={json.dumps(dict(columns), ensure_ascii=False)})'
    named = " ".join(f"--{role} {name if name == 'NAME' else repr(name)}" for role, name in columns.items())
    keys = ", ".join(f'{role} = "{name}"' for role, name in columns.items())
    return f"{named}, or in loops.toml columns = {{ {keys} }}"


def _listed(names: Sequence[str]) -> str:
    """Names in a list for a message, the first ones where there are many."""
    shown = ", ".join(n if n.strip() else "(no name)" for n in names[:20])
    return f"{shown} and {len(names) - 20} more" if len(names) > 20 else shown
