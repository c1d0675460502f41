"""A fit takes seconds, and many tests ask for the same one: within a run of the tests each is made once.

What is kept is the answer of the Rust core to given samples, bit for bit. It lies in a folder that all workers share,
and with them the processes that they start.
"""

import hashlib
import os
import pickle
from collections.abc import Callable, Sequence
from pathlib import Path
from threading import get_native_id
from typing import Any

from glapp import _glapp
from glapp.recording import Batch

FOLDER = "GLAPP_TEST_FITS"
"""Variable of the environment that names the folder of this run."""

made_anew = _glapp.fit
analysis_made_anew = _glapp.Analysis


def kept(asked: str, answer: Callable[[], Any]) -> Any:
    """An answer, which stays there for the next who asks the same."""
    path = Path(os.environ[FOLDER]) / asked
    if not path.exists():
        part = path.with_suffix(f".{get_native_id()}")  # two threads may ask the same at once
        part.write_bytes(pickle.dumps(answer()))
        part.replace(path)  # whole or not there, whoever else makes the same
    return pickle.loads(path.read_bytes())


def fit(batches: Sequence[Batch], sign: float, progress: Callable[[float], None] | None = None) -> Any:
    """`_glapp.fit`, each answer made once; `progress` is told while it is made."""
    question = pickle.dumps((batches, sign), protocol=5)
    return kept(hashlib.sha256(question).hexdigest(), lambda: made_anew(batches, sign, progress))


class Analysis:
    """`_glapp.Analysis`, each answer made once."""

    def __init__(self, task: str, beginning: Batch) -> None:
        self._made = analysis_made_anew(task, beginning)
        self._asked = hashlib.sha256(pickle.dumps((task, beginning), protocol=5))

    def take(self, batch: Batch) -> Any:
        self._asked.update(pickle.dumps(batch, protocol=5))
        return self._made.take(batch)

    def finish(self, progress: Callable[[float], None] | None) -> Any:
        return kept(self._asked.hexdigest(), lambda: self._made.finish(progress))


def remember() -> None:
    """Keep the fits of this process from here on."""
    _glapp.fit = fit
    _glapp.Analysis = Analysis  # type: ignore[assignment, misc]
