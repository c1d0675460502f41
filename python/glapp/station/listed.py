"""The rows of the overview, and since when each is as it is: a page that has them asks for what has changed alone."""

from __future__ import annotations

import dataclasses
import json
import time
from collections.abc import Mapping, Sequence

from .view import LoopRow

__all__ = ["Listed"]


def _first() -> int:
    return time.time_ns() // 1_000_000  # greater than any version of a window that ran before


@dataclasses.dataclass(frozen=True, slots=True)
class Listed:
    """The overview as of one look; the next look makes a new one.

    - `rows`: in their order.
    - `version`: greater after each look at which something had changed.
    - `first`: its version before the first look: whoever has an older one has nothing of this window.
    - `since`: by loop the version since which its row is as it is.
    - `texts`: by loop its row as JSON.
    - `gone`: by loop that is not watched any more the version since which it is not.
    """

    rows: Sequence[LoopRow] = ()
    version: int = 0
    first: int = dataclasses.field(default_factory=_first)
    since: Mapping[str, int] = dataclasses.field(default_factory=dict)
    texts: Mapping[str, str] = dataclasses.field(default_factory=dict)
    gone: Mapping[str, int] = dataclasses.field(default_factory=dict)

    def after(self, rows: Sequence[LoopRow]) -> Listed:
        """Listing after a look that found these rows.

        Examples
        --------
        >>> row = LoopRow("FIC101", 1, "", None, "", "none", "Not now", "", "Good", "now", "", "")
        >>> one = Listed().after([row])
        >>> two = one.after([row, dataclasses.replace(row, loop="FIC102", rank=2)])
        >>> whole, texts, gone = two.changes(one.version)
        >>> whole, [json.loads(text)["loop"] for text in texts], gone
        (False, ['FIC102'], [])
        >>> two.after([row]).changes(two.version)
        (False, [], ['FIC102'])
        """
        before = {row.loop: row for row in self.rows}
        changed = {row.loop for row in rows if before.get(row.loop) != row}
        there = {row.loop for row in rows}
        lost = before.keys() - there
        if not changed and not lost:
            return self
        version = max(self.version, self.first) + 1
        return Listed(
            rows,
            version,
            self.first,
            {name: version if name in changed else self.since[name] for name in there},
            {row.loop: _text(row) if row.loop in changed else self.texts[row.loop] for row in rows},
            {name: at for name, at in self.gone.items() if name not in there} | dict.fromkeys(lost, version),
        )

    def changes(self, since: int) -> tuple[bool, list[str], list[str]]:
        """Changes since a version: whether that is all there is, rows as JSON, and loops that are gone."""
        if not self.first < since <= self.version:
            return True, [self.texts[row.loop] for row in self.rows], []
        rows = [self.texts[row.loop] for row in self.rows if self.since[row.loop] > since]
        return False, rows, [name for name, at in self.gone.items() if at > since]


def _text(row: LoopRow) -> str:
    return json.dumps({name: getattr(row, name) for name in LoopRow.__slots__})
