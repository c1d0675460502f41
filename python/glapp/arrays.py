"""Arrays as the Rust core takes them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike

__all__ = ["column"]


def column(x: ArrayLike | None, kind: DTypeLike = np.float64) -> Any:
    """A signal as an array of one kind without gaps in memory, a masked number as NaN; None where there is none.

    >>> column([1, 2]), column(None)
    (array([1., 2.]), None)
    >>> column(np.ma.masked_array([1, 2], mask=[False, True]))
    array([ 1., nan])
    """
    if isinstance(x, np.ma.MaskedArray) and np.dtype(kind).kind == "f":
        x = np.ma.filled(x.astype(kind), np.nan)
    return None if x is None else np.ascontiguousarray(x, dtype=kind)
