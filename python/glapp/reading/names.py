"""The words of control systems and historians, from `names.json`, which the page in the browser reads too.

Case, accents and the spaces between the parts of a name do not count: `folded("Ärvärde")` is ``arvarde``.
"""

from __future__ import annotations

import json
import unicodedata
from collections.abc import Iterable
from functools import lru_cache
from importlib.resources import files
from typing import Any

__all__ = [
    "AUTO",
    "BLOCKS",
    "CONFIDENCE",
    "CURRENT",
    "FACTS",
    "FOOTER",
    "GOOD",
    "LIMITS",
    "MILLISECONDS",
    "MISSING",
    "MONTHS",
    "NOT_AUTO",
    "POOR",
    "SAME_UNITS",
    "SIGNALS",
    "UNITS",
    "UNIT_COLUMNS",
    "VALIDITY",
    "WEAK",
    "WHOLE",
    "folded",
]


@lru_cache(maxsize=1 << 16)
def folded(text: str) -> str:
    """The text without case, accents and spaces.

    Examples
    --------
    >>> folded("Börvärde"), folded("Set Point"), folded("Führungsgröße")
    ('borvarde', 'setpoint', 'fuhrungsgrosse')
    """
    parts = unicodedata.normalize("NFKD", text.casefold())
    return "".join(c for c in parts if not unicodedata.combining(c) and not c.isspace())


_DATA: dict[str, Any] = json.loads((files(__package__) / "names.json").read_text(encoding="utf-8"))


def _roles(table: dict[str, dict[str, list[str]]]) -> dict[str, str]:
    return {folded(word): role for role, tongues in table.items() for words in tongues.values() for word in words}


def _folded(words: Iterable[str]) -> frozenset[str]:
    return frozenset(map(folded, words))


def _lower(words: Iterable[str]) -> frozenset[str]:
    """Words that are compared cell by cell, where the case alone does not count."""
    return frozenset(word.lower() for word in words)


SIGNALS = _roles(_DATA["signals"])
"""Word to the role of the signal, with the loop's tag before or after it."""
WHOLE = _roles(_DATA["whole"])
"""Word to the role of a column that has no other word."""
WEAK: dict[str, list[str]] = {folded(word): roles for word, roles in _DATA["weak"]["words"].items()}
"""Word to the roles it may have, which depends on the loop's other columns."""
BLOCKS = {word: kind for kind in ("controller", "input", "output") for word in _DATA["blocks"][kind]}
"""Function block, without its number, to its kind."""
CURRENT = _folded(_DATA["current"]["words"])
"""Last words that say nothing more."""
LIMITS = _folded(_DATA["limits"]["words"])
"""Words of a signal's limits."""
AUTO = _lower(_DATA["modes"]["auto"])
NOT_AUTO = _lower(_DATA["modes"]["not_auto"])
"""Words of a mode column."""
GOOD = _lower(_DATA["quality"]["good"])
POOR = _lower(_DATA["quality"]["poor"])
"""Words of a quality column."""
VALIDITY = _folded(_DATA["quality"]["validity"])
"""Names of columns in which 1 is good."""
CONFIDENCE = _folded(_DATA["quality"]["confidence"])
"""Names of columns in which 100 is good."""
MILLISECONDS = _folded(_DATA["milliseconds"]["words"])
"""Names of columns that go with a column of times of whole seconds."""
FACTS = _folded(_DATA["facts"]["words"])
"""First words of lines below the names that hold no samples."""
MISSING = _lower(["", *_DATA["missing"]])
"""Words that stand for a missing value."""
FOOTER = _folded(_DATA["footer"]["words"])
"""First words of the lines below the last row."""
MONTHS = {name: month for month, names in enumerate(_DATA["months"]["names"], start=1) for name in names}
"""First three letters of a month to its number."""
UNITS = _folded(_DATA["units"])
"""Units of a row below the header."""
UNIT_COLUMNS = _folded(_DATA["unit_columns"]["words"])
"""Names of a column of units beside tags and values."""
SAME_UNITS = {folded(word): folded(words[0]) for words in _DATA["same_units"] for word in words}
"""Ways to write a unit to the first of them: a pressure is a gauge pressure where nothing is said."""
