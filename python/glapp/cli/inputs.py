"""From the files on the command line to recordings, each loop on its own: a wrong one stops no other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ..errors import InputError, unforeseen
from ..loop import Loop
from ..reading import open_each
from ..reading.files import name_of
from ..reading.settings import read_each
from ..recording import Recording
from ..result import Result
from .options import Options
from .screen import CommandError, say_note

_NOTES = 3
"""Number of notes that are printed of many loops."""

__all__ = ["Refused", "Valve", "open_files", "open_one", "opened_with", "read_by", "recording_of"]


@dataclass(frozen=True, slots=True)
class Refused:
    """A loop, or a whole file, that cannot be used."""

    name: str
    source: str
    error: InputError
    loop: Loop | None = None

    def result(self) -> Result:
        """The answer of a loop that cannot be used."""
        return Result.of_error(self.error, self.name, self.source, self.loop)


@dataclass(frozen=True, slots=True)
class Valve:
    """A loop with several recordings, which get one answer."""

    name: str
    loop: Loop
    recordings: list[Recording]

    @property
    def source(self) -> str:
        """All files."""
        return ", ".join(recording.source for recording in self.recordings)


def open_files(
    files: Sequence[Path], options: Options, as_loop: str | None = None
) -> list[Recording | Valve | Refused]:
    """Open recordings and the recordings of loops.toml files, in their order; no two have the same name.

    With `as_loop` all of them are recordings of one loop of that name.

    Raises CommandError where settings do not go with the files, or a loop that was asked for is in none of them.
    """
    if as_loop is not None:
        return _as_loop(files, options, as_loop)
    settings = options.settings()
    if settings and any(_is_toml(file) for file in files):
        raise CommandError("settings on the command line do not go with a loops.toml; write them into it")
    if settings.keys() - {"columns"} and len(files) > 1:
        raise CommandError(
            "settings on the command line are for one recording; for several, write them into a loops.toml: "
            "glapp init FILES -o loops.toml begins one"
        )
    opened: list[Recording | Valve | Refused] = []
    for file in files:
        opened += _from_settings(file) if _is_toml(file) else opened_with(file, settings, options.loop)
    asked = [entry.name for entry in opened]
    opened = _only(_named_apart(opened), asked, options.loop)
    _say_left_out(opened)
    return opened


def _say_left_out(opened: Sequence[Recording | Valve | Refused]) -> None:
    """Say which signals of the first loops are not read, and what to write."""
    notes = [
        f"{entry.name}: {text}"
        for entry in opened
        if not isinstance(entry, Refused)
        for text in (entry.recordings[0] if isinstance(entry, Valve) else entry).left_out
    ]
    for text in notes[:_NOTES]:
        say_note(text)
    if len(notes) > _NOTES:
        say_note(f"{len(notes) - _NOTES} more signals are not read; the report has them")


def open_one(file: Path, options: Options) -> Recording:
    """The one loop that a command is about.

    Raises InputError where it cannot be used. Raises CommandError where the file holds several and none was named.
    """
    opened = open_files([file], options)
    if len(opened) > 1:
        names = ", ".join(entry.name for entry in opened)
        raise CommandError(f"{file} holds {len(opened)} loops; add --loop NAME with one of: {names}")
    [entry] = opened
    if isinstance(entry, Valve):
        raise CommandError(f"{entry.name} has {len(entry.recordings)} recordings; give one of them: {entry.source}")
    return recording_of(entry)


def recording_of(entry: Recording | Refused) -> Recording:
    """The recording.

    Raises InputError where it was refused.
    """
    if isinstance(entry, Refused):
        raise entry.error
    return entry


def _as_loop(files: Sequence[Path], options: Options, name: str) -> list[Recording | Valve | Refused]:
    """All files as recordings of one loop; what cannot be opened is refused by itself."""
    if toml := next((file for file in files if _is_toml(file)), None):
        raise CommandError(f"--as-loop takes recordings; in {toml} write several files = [...] of a loop")
    opened: list[Recording | Valve | Refused] = []
    for file in files:
        found = opened_with(file, options.settings(), options.loop)
        kept = _only(found, [entry.name for entry in found], options.loop)
        if len(kept) > 1:
            names = ", ".join(entry.name for entry in kept)
            raise CommandError(f"{file} holds {len(kept)} loops; add --loop NAME with one of: {names}")
        opened += kept
    return _gathered(opened, name)


def _gathered(opened: Sequence[Recording | Valve | Refused], name: str) -> list[Recording | Valve | Refused]:
    """Recordings of one loop as one entry, and the refused ones."""
    recordings = [_called(entry, name) for entry in opened if isinstance(entry, Recording)]
    rest = [entry for entry in opened if not isinstance(entry, Recording)]
    if len(recordings) > 1:
        return [Valve(name, recordings[0].loop, recordings), *rest]
    return [*recordings, *rest]


def opened_with(file: Path, settings: dict[str, Any], only: Sequence[str] | None) -> list[Recording | Valve | Refused]:
    """The loops of one recording with these settings, which describe the one that is asked for by `only`."""
    found = _open_each(file, None, settings, only or ())
    return [_refused(entry, file) if isinstance(entry, InputError) else entry for entry in found]


def read_by(files: Sequence[Path]) -> list[Path]:
    """These files, and those that are named in a loops.toml among them."""
    found = list(files)
    for file in files:
        if _is_toml(file):
            try:
                loops = read_each(file)
            except InputError:  # reported where its loops are opened
                continue
            found += [file for loop in loops if isinstance(loop, Loop) for file in _files(loop)]
    return found


def _files(loop: Loop) -> tuple[Path, ...]:
    return loop.files if loop.file is None else (loop.file,)


def _from_settings(file: Path) -> list[Recording | Valve | Refused]:
    """Recordings of the loops of a settings file."""
    try:
        loops = read_each(file)
    except InputError as error:
        return [_refused(error, file)]
    opened: list[list[Recording | Valve | Refused]] = [[] for _ in loops]
    recorded: dict[Path, list[tuple[int, Loop]]] = {}
    for i, loop in enumerate(loops):
        if isinstance(loop, InputError):
            opened[i].append(_refused(loop, file))
            continue
        if not _files(loop):
            missing = InputError("is required", file=str(file), loop=loop.name, parameter="file")
            opened[i].append(_refused(missing, file, loop))
        for recording in _files(loop):
            recorded.setdefault(recording, []).append((i, loop))
    for recording, wanted in recorded.items():
        found = _open_each(recording, [loop for _, loop in wanted])
        for (i, loop), entry in zip(wanted, found, strict=True):
            opened[i].append(_refused(entry, recording, loop) if isinstance(entry, InputError) else entry)
    return [entry for entries in opened for entry in _gathered(entries, entries[0].name)]


def _open_each(
    file: Path,
    loops: Sequence[Loop] | None,
    defaults: dict[str, Any] | None = None,
    only: Sequence[str] | None = None,
) -> Sequence[Recording | InputError]:
    """The recordings of a file, one for each loop; where the file cannot be used, the same error for each loop."""
    try:
        return open_each(file, loops, defaults, only)
    except InputError as error:
        fault = error
    except Exception as error:
        fault = unforeseen(error, str(file))
    return [fault] * (1 if loops is None else len(loops))


def _refused(error: InputError, file: Path, loop: Loop | None = None) -> Refused:
    name = (loop and loop.name) or error.loop or name_of(file)
    # A file name need not be text; an answer must be.
    name, source = (text.encode(errors="replace").decode() for text in (name, str(file)))
    return Refused(name, source, error, loop)


def _named_apart(opened: list[Recording | Valve | Refused]) -> list[Recording | Valve | Refused]:
    """Put as much of the file path before loops of the same name as makes their names differ."""
    same: dict[str, list[int]] = {}
    for i, entry in enumerate(opened):
        same.setdefault(entry.name, []).append(i)
    taken = {name for name, places in same.items() if len(places) == 1}
    named = list(opened)
    clashes = {name: places for name, places in same.items() if len(places) > 1}
    for name, places in clashes.items():
        for i, apart in zip(places, _with_paths(name, [opened[i].source for i in places]), strict=True):
            free, number = apart, 1
            while free in taken:  # the same file twice, or a loop that is called like this by itself
                number += 1
                free = f"{apart} ({number})"
            taken.add(free)
            named[i] = _renamed(opened[i], free)
    if clashes:
        name, places = next(iter(clashes.items()))
        shown = ", ".join(named[i].name for i in places[:3]) + (" ..." if len(places) > 3 else "")
        others = f", and {len(clashes) - 1} more names likewise" if len(clashes) > 1 else ""
        say_note(f"{len(places)} loops are named {name}; they are shown as {shown}{others}")
    return named


def _with_paths(name: str, sources: Sequence[str]) -> list[str]:
    """The name after as many of the last parts of its file's path as distinguish these; else after the whole path."""
    for stem in (name_of, lambda source: Path(source).name):  # FIC101.csv beside FIC101.parquet: with the endings
        parts = [
            (*Path(source).parent.parts, stem(source), *([] if name_of(source) == name else [name]))
            for source in sources
        ]
        tails = [["/".join(part[-depth:]) for part in parts] for depth in range(1, max(map(len, parts)) + 1)]
        if (found := next((tail for tail in tails if len(set(tail)) == len(set(sources))), None)) is not None:
            return found
    return tails[-1]


def _renamed(entry: Recording | Valve | Refused, name: str) -> Recording | Valve | Refused:
    """The entry under another name."""
    if isinstance(entry, Refused):
        return replace(entry, name=name)
    if isinstance(entry, Valve):
        return replace(entry, name=name, recordings=[_called(recording, name) for recording in entry.recordings])
    return _called(entry, name)


def _called(recording: Recording, name: str) -> Recording:
    """The recording under another name."""
    recording.name, recording.loop = name, recording.loop.model_copy(update={"name": name})
    return recording


def _only(
    opened: list[Recording | Valve | Refused], asked: Sequence[str], names: Sequence[str] | None
) -> list[Recording | Valve | Refused]:
    """The requested recordings, by their name here or by the one in their file, and files that may have held them."""
    if not names:
        return opened
    known = {entry.name for entry in opened}
    missing = [name for name in names if name not in known and name not in asked]
    unread = [entry for entry in opened if isinstance(entry, Refused) and entry.error.loop is None] if missing else []
    if missing and not unread:
        raise CommandError(f"--loop: no loop '{missing[0]}'; there are: {', '.join(sorted(known))}")
    pairs = zip(opened, asked, strict=True)
    return [entry for entry, own in pairs if entry.name in names or own in names or entry in unread]


def _is_toml(file: Path) -> bool:
    return file.suffix.lower() == ".toml"
