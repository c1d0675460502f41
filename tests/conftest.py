"""For all tests: hypothesis must not look at the clock, no more than we do; and each fit is made once."""

import os
from tempfile import TemporaryDirectory

import fits
import pytest
from hypothesis import settings

settings.register_profile("without a clock", deadline=None)
settings.load_profile("without a clock")


def pytest_configure(config: pytest.Config) -> None:
    if fits.FOLDER not in os.environ:  # a worker has the folder of the process that started it
        folder = TemporaryDirectory(prefix="glapp-fits-")
        config.add_cleanup(folder.cleanup)
        os.environ[fits.FOLDER] = folder.name
    fits.remember()
