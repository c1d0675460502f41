"""Many loops of one file in few passes over it.

A pass over a wide file costs nearly as much for one loop as for all. So the loop that is asked for is read together
with those that come after it, and what is read of them waits in memory until they are asked for, at most `HELD` bytes
for all of them. A loop that needs more by itself, and one that is alone in its file, is streamed from the file each
time, and nothing of it is held.
"""

from __future__ import annotations

import copy
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass
from itertools import count
from threading import Lock
from weakref import WeakSet

import pyarrow as pa

from ..errors import InputError
from .source import Source
from .times import Clock

__all__ = ["HELD", "Passes", "Share"]

HELD = 1 << 29
"""Bytes that all loops of a file may hold together."""

_ROWS = 65536


@dataclass(frozen=True, slots=True)
class _Held:
    """Columns of one loop, block by block, and the error in which the pass ended."""

    blocks: list[list[pa.Array]]
    error: InputError | None

    @property
    def size(self) -> int:
        return sum(column.nbytes for block in self.blocks for column in block)


class Share:
    """Request of one loop to a file: made by `Passes.share`."""

    def __init__(self, passes: Passes, types: Mapping[int, pa.DataType], bad_words: frozenset[str], place: int) -> None:
        self.types, self.bad_words, self.place = dict(types), bad_words, place
        self.held: _Held | None = None
        self.used = 0
        self.alone = False
        self._passes = passes

    def stream(self) -> Iterator[tuple[list[pa.Array], float]]:
        """The rows of this loop's columns (`Source.stream`): those that a pass has read already, else a pass."""
        held = self._passes.held(self)
        if held is None:
            yield from self._passes.source.stream(self.types, self.bad_words)
            return
        blocks = held.blocks
        first = 0
        while first < len(blocks):
            last, rows = first + 1, len(blocks[first][0])
            kinds = [column.type for column in blocks[first]]
            while last < len(blocks) and (rows := rows + len(blocks[last][0])) <= _ROWS:
                if [column.type for column in blocks[last]] != kinds:
                    break
                last += 1
            for columns in _joined(blocks[first:last]):
                yield columns, last / len(blocks)
            first = last
        if held.error is not None:
            raise copy.copy(held.error)

    def release(self) -> None:
        """Free the held data; they are read again if they are asked for again."""
        self.held = None


class Passes:
    """The passes over one file for all loops in it that still exist."""

    def __init__(self, source: Source) -> None:
        self.source = source
        self._shares: WeakSet[Share] = WeakSet()
        self._reading = Lock()
        self._clock = count(1)
        self._most: int | None = None  # loops in the next pass
        self._from_last: dict[object, Clock | None] = {}

    def share(self, types: Mapping[int, pa.DataType], bad_words: frozenset[str]) -> Share:
        """Announce a loop's columns; passes take the loops in the order in which they were announced."""
        share = Share(self, types, bad_words, next(self._clock))
        self._shares.add(share)
        return share

    def clock_from_last(self, times: object, find: Callable[[], Clock | None]) -> Clock | None:
        """What `find` finds of a column of times, which a file's loops mostly share: it is sought once.

        - `times`: column, and how it is read.
        """
        if times not in self._from_last:
            self._from_last[times] = find()
        return self._from_last[times]

    def held(self, share: Share) -> _Held | None:
        """Data held for this loop, after a pass where it has to be read; None where it is to be streamed."""
        held = share.held
        if held is None:
            with self._reading:  # where several ask at once, one reads and the others wait
                while (held := share.held) is None and not share.alone and len(self._shares) > 1:
                    self._pass(share)
        share.used = next(self._clock)
        return held

    def _pass(self, share: Share) -> None:
        """Read `share` and others after it, or find that it is to be streamed, or that fewer must be read at once."""
        room = HELD - self._make_room()
        group, types = self._group(share, room)
        if not group:
            share.alone = True
            return
        blocks: list[dict[int, pa.Array]] = []
        users = Counter(column for member in group for column in member.types)
        sizes = dict.fromkeys(types, 0)
        error: InputError | None = None
        asked = len(group)
        try:
            with closing(self.source.stream(types, share.bad_words)) as stream:  # type: ignore[type-var]
                for columns, _ in stream:
                    if not len(columns[0]):
                        continue
                    block = {i: column for i, column in zip(types, columns, strict=True) if users[i]}
                    for i, column in block.items():
                        sizes[i] += column.nbytes
                    blocks.append(block)
                    while sum(sizes.values()) > room and len(group) > 1:
                        self._drop(group.pop(), users, sizes, blocks)
                    if sum(sizes.values()) > room:
                        share.alone = True
                        return
        except (InputError, pa.ArrowException) as fault:
            if len(group) > 1 and not self.source.one_fault:  # it may be another loop's column that is damaged
                self._most = len(group) // 2
                return
            if not isinstance(fault, InputError):
                raise
            error = fault
        # A part that fitted now will fit again; one that was halved for a fault may grow again.
        self._most = len(group) if len(group) < asked else 2 * asked
        for member in group:
            member.held = _Held([[block[i] for i in member.types] for block in blocks], error)

    def _make_room(self) -> int:
        """Release the shares that were used longest ago, until half of `HELD` is free; the bytes still held."""
        left = 0
        holding = [share for share in self._shares if share.held is not None]
        for share in sorted(
            holding, key=lambda share: (share.used > 0, -share.used)
        ):  # first what still waits for its use
            if (held := share.held) is None:  # another thread has released it meanwhile
                continue
            if left + held.size > HELD // 2:
                share.release()
            else:
                left += held.size
        return left

    def _group(self, share: Share, room: int) -> tuple[list[Share], dict[int, pa.DataType]]:
        """The loops of the next pass and the types of their columns; none where `share` alone is too large."""
        rows = self.source.rows
        group: list[Share] = []
        types: dict[int, pa.DataType] = {}
        after = [candidate for candidate in self._shares if candidate.place >= share.place]
        for candidate in sorted(after, key=lambda candidate: candidate.place):
            if candidate.held is not None or candidate.alone or candidate.bad_words != share.bad_words:
                continue
            if any(types.get(i, kind) != kind for i, kind in candidate.types.items()):
                continue
            if rows is not None and 8 * rows * len(types.keys() | candidate.types.keys()) > room:
                break
            group.append(candidate)
            types.update(candidate.types)
            if len(group) == self._most:
                break
        return group, types

    @staticmethod
    def _drop(share: Share, users: Counter[int], sizes: dict[int, int], blocks: list[dict[int, pa.Array]]) -> None:
        """Go on without a loop: forget its columns, but for those that others use too."""
        for i in share.types:
            users[i] -= 1
            if not users[i]:
                sizes[i] = 0
                for block in blocks:
                    block.pop(i, None)


def _joined(blocks: list[list[pa.Array]]) -> list[list[pa.Array]]:
    """Small blocks as one; as they are where Arrow cannot join them, as dictionaries that hold a null."""
    if len(blocks) == 1:
        return blocks
    try:
        return [[pa.concat_arrays(parts) for parts in zip(*blocks, strict=True)]]
    except pa.ArrowException:
        return blocks
