"""For all tests: hypothesis must not look at the clock, no more than we do; and each fit is made once."""

import os

if "PYTEST_XDIST_WORKER" in os.environ:
    # Each worker has its processor: threads of its own would only wait for the others, and burn time as they do.
    # NumPy and the fit read this when they are imported, so it stands before them.
    os.environ |= {"OPENBLAS_NUM_THREADS": "1", "RAYON_NUM_THREADS": "1"}

from tempfile import TemporaryDirectory

import fits
import pytest
from hypothesis import settings

settings.register_profile("without a clock", deadline=None)
settings.load_profile("without a clock")


def pytest_xdist_auto_num_workers() -> int:
    """One more than there are processors: a good part of the tests waits, for a clock or for another process."""
    return len(os.sched_getaffinity(0)) + 1


def pytest_configure(config: pytest.Config) -> None:
    if fits.FOLDER not in os.environ:  # a worker has the folder of the process that started it
        folder = TemporaryDirectory(prefix="glapp-fits-")
        config.add_cleanup(folder.cleanup)
        os.environ[fits.FOLDER] = folder.name
    fits.remember()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """What takes long begins first, so that at the end no worker waits long for another."""
    items.sort(key=lambda item: isinstance(item, pytest.Function) and item.get_closest_marker("slow") is None)
