"""Setup of all tests: hypothesis must not look at the clock, no more than we do; and each fit is made once."""

import gc
import os
import re
import sys
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from typing import Any

if "PYTEST_XDIST_WORKER" in os.environ:
    # Each worker has its processor: threads of its own would only wait for the others, and burn time as they do.
    # NumPy and the fit read this when they are imported, so it stands before them.
    os.environ |= {"OPENBLAS_NUM_THREADS": "1", "RAYON_NUM_THREADS": "1"}

from tempfile import TemporaryDirectory

import fits
import pytest
from hypothesis import settings

pytest_plugins = ["station_window"]

settings.register_profile("without a clock", deadline=None)
settings.load_profile("without a clock")

# The OPC UA servers of the tests are a hundred thousand objects each: half of the time that one took to begin, the
# collector looked through them.
gc.set_threshold(50_000, 10, 10)


BY_THE_CLOCK = ("test_service_", "test_station_", "test_page", "test_plant", "test_fleet")
"""Tests beside real clocks, sockets and browsers. A machine may stand still for seconds, so two more tries are theirs;
the summary tells each."""


def pytest_xdist_auto_num_workers(config: pytest.Config) -> int:
    """Two more than there are processors: a good part of the tests waits, for a clock or for another process.

    The quick tests wait for nothing, and each further worker only collects all tests once more.
    """
    return len(os.sched_getaffinity(0)) + (0 if "not slow" in config.option.markexpr else 2)


def pytest_configure(config: pytest.Config) -> None:
    if fits.FOLDER not in os.environ:  # a worker has the folder of the process that started it
        folder = TemporaryDirectory(prefix="glapp-fits-")
        config.add_cleanup(folder.cleanup)
        os.environ[fits.FOLDER] = folder.name
    fits.remember()
    with suppress(ModuleNotFoundError):  # without the extra [opcua]
        import standard_nodes

        standard_nodes.remember()


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session: pytest.Session) -> None:
    """Keeps what failed without the group that a worker puts behind a name, or `--last-failed` would not find it."""
    kept = session.config.cache
    if kept is not None and "PYTEST_XDIST_WORKER" not in os.environ:
        failed = kept.get("cache/lastfailed", {})
        kept.set("cache/lastfailed", {re.sub(r"@[^]@]*$", "", name): True for name in failed})


@pytest.fixture(scope="session")
def figures() -> dict[str, Callable[[], Any]]:
    """The figures of the thesis; each is computed once, for the command line too."""
    from glapp_thesis import FIGURES

    FIGURES.update({number: cache(function) for number, function in FIGURES.items()})
    return FIGURES


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Long tests begin first, so that at the end no worker waits long for another.

    First what runs by the clock, then groups that one worker must take alone, the largest first.
    """

    def group(item: pytest.Item) -> str | None:
        mark = item.get_closest_marker("xdist_group")
        return None if mark is None else str(mark.args[0])

    def order(item: pytest.Item) -> tuple[bool, bool, int]:
        quick = isinstance(item, pytest.Function) and not any(map(item.get_closest_marker, ("slow", "verify")))
        return item.get_closest_marker("by_the_clock") is None, quick, -sizes[group(item)]

    sizes = Counter(map(group, items))
    sizes[None] = 1
    items.sort(key=order)
    for item in items:
        if item.path.name.startswith(BY_THE_CLOCK):
            item.add_marker(pytest.mark.flaky(reruns=2, reruns_delay=2))


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Connections by OPC UA are tried again at once."""
    from glapp.service import opcua

    monkeypatch.setattr(opcua, "_PAUSES", (0.2, 0.4))
    monkeypatch.setattr(opcua, "_DENIED", 0.4)


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str, str]]:
    """Run a command line of `glapp` in this process; its exit code, standard output and standard error."""
    from glapp.cli import main

    def run(*words: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["glapp", *map(str, words)])
        code = 0
        try:
            main()
        except SystemExit as end:
            code = int(end.code or 0)
        return code, *capsys.readouterr()

    return run
