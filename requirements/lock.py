"""Renews the locks of the Python packages that make installs: `make lock`.

Each lock names every package with its version and the checksum of each of its files, for Linux, Windows and macOS and
Python 3.11 and newer. All locks are made of one resolution, so that a package has the same version in each of them.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
PROJECT = HERE.parent / "pyproject.toml"
PYTHON = "3.11"
"""The oldest Python that the locks hold for."""

BASE = "dependencies"
"""Name for the dependencies of the package itself."""

LOCKS = {
    "run": (BASE, "build"),
    "test": ("test", "lint", "build-here"),
    "spark": ("spark",),
    "docs": ("docs",),
    "wheels": ("wheels",),
    "bench": ("bench",),
    "fuzz": ("fuzz",),
    "lock": ("lock",),
}
"""Each lock and the groups of pyproject.toml that it holds."""

_FORBIDDEN = re.compile(r"^-|://|--(index|extra-index|find-links|trusted-host)|^/|file:", re.MULTILINE)
_HEAD = "# {groups} of pyproject.toml. Made by `make lock`; not edited by hand.\n"


def main() -> int:
    """Write all locks."""
    every = [group for groups in LOCKS.values() for group in groups]
    with tempfile.TemporaryDirectory() as folder:
        whole = Path(folder) / "all.txt"
        _compile(every, whole)
        for name, groups in LOCKS.items():
            made = Path(folder) / f"{name}.txt"
            _compile(groups, made, "--generate-hashes", "--constraint", str(whole))
            text = made.read_text(encoding="utf-8")
            if found := _FORBIDDEN.search(text):
                raise SystemExit(f"{name}: the lock would hold {found.group()!r}, a place of this machine: not written")
            head = _HEAD.format(groups=", ".join(groups))
            (HERE / f"{name}.txt").write_text(head + text, encoding="utf-8", newline="\n")
    return 0


def _compile(groups: tuple[str, ...] | list[str], out: Path, *more: str) -> None:
    named = [str(PROJECT)] if BASE in groups else []
    named += [part for group in groups if group != BASE for part in ("--group", f"{PROJECT}:{group}")]
    how = ("--universal", "--python-version", PYTHON, "--no-annotate", "--no-header", "--quiet", "--upgrade")
    command = [sys.executable, "-m", "uv", "pip", "compile", *how, *more, *named, "--output-file", str(out)]
    subprocess.run(command, check=True, env={**os.environ, "UV_NO_CONFIG": "1"})


if __name__ == "__main__":
    sys.exit(main())
