"""Looks up every locked package in a data base of advisories: `make audit`.

The data base is OSV, which holds the advisories of RustSec, PyPA and GitHub. It is sent names and versions, no more.

Ends with 0 where no advisory names a package, 1 where one does, and 3 where this could not be found out.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
import tomllib
import urllib.error
import urllib.request
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).resolve().parent.parent
DATABASE = "https://api.osv.dev"
KNOWN, UNKNOWN = 1, 3
"""Exit codes: an advisory names a package; it could not be found out."""

AT_ONCE = 1000
"""Packages of one question at most, as OSV allows."""

PATIENCE = 20.0
"""Time that an answer may take [s]."""

_PINNED = re.compile(r"^([A-Za-z0-9][A-Za-z0-9._-]*)==([^\s;\\]+)", re.MULTILINE)


class Package(NamedTuple):
    """One version of a package, and the lock that names it."""

    ecosystem: str
    name: str
    version: str
    lock: str


def locked(root: Path) -> list[Package]:
    """Every package of every lock of Cargo and Python, each version once."""
    found: dict[tuple[str, str, str], Package] = {}
    for path in (root / "Cargo.lock", root / "fuzz" / "Cargo.lock"):
        for package in tomllib.loads(path.read_text(encoding="utf-8"))["package"]:
            if "source" in package:  # what has none is ours
                one = Package("crates.io", package["name"], package["version"], path.relative_to(root).as_posix())
                found.setdefault(one[:3], one)
    for path in sorted((root / "requirements").glob("*.txt")):
        for name, version in _PINNED.findall(path.read_text(encoding="utf-8")):
            one = Package("PyPI", name, version, path.relative_to(root).as_posix())
            found.setdefault(one[:3], one)
    return list(found.values())


def advisories(packages: Sequence[Package], database: str) -> dict[Package, list[str]]:
    """The advisories that name each package, by their ids; packages that none names are left out.

    Raises
    ------
    OSError
        Where the data base cannot be reached, or answers otherwise than it should.
    """
    found: dict[Package, list[str]] = {}
    for at in range(0, len(packages), AT_ONCE):
        asked = [(package, "") for package in packages[at : at + AT_ONCE]]
        while asked:
            answers = _ask(asked, database)
            more = []
            for (package, _), answer in zip(asked, answers, strict=True):
                if ids := [one["id"] for one in answer.get("vulns", ())]:
                    found.setdefault(package, []).extend(ids)
                if page := answer.get("next_page_token"):
                    more.append((package, page))
            asked = more
    return found


def _ask(asked: Iterable[tuple[Package, str]], database: str) -> list[dict[str, Any]]:
    queries = [
        {
            "package": {"ecosystem": package.ecosystem, "name": package.name},
            "version": package.version,
            **({"page_token": page} if page else {}),
        }
        for package, page in asked
    ]
    body = json.dumps({"queries": queries}).encode()
    request = urllib.request.Request(f"{database}/v1/querybatch", body, {"Content-Type": "application/json"})
    with urllib.request.urlopen(request, timeout=PATIENCE) as answer:
        try:
            results = json.load(answer)["results"]
        except (ValueError, KeyError, TypeError):
            results = None
    if not isinstance(results, list) or len(results) != len(queries):
        raise OSError("its answer is not one of OSV")
    return results


def main(arguments: Sequence[str] | None = None) -> int:
    """Check, print the findings, and give the exit code."""
    parser = argparse.ArgumentParser(description="Looks up every locked package in a data base of advisories.")
    parser.add_argument("--database", default=DATABASE, metavar="URL", help=f"one that speaks as {DATABASE}")
    database = parser.parse_args(arguments).database.rstrip("/")
    packages = locked(ROOT)
    of = {name: sum(one.ecosystem == name for one in packages) for name in ("crates.io", "PyPI")}
    what = f"{of['crates.io']} crates and {of['PyPI']} Python packages of {len({one.lock for one in packages})} locks"
    try:
        found = advisories(packages, database)
    except (OSError, ValueError) as error:
        why = getattr(error, "reason", None) or error
        print(f"{what} could not be checked: {database} is not reachable ({why})", file=sys.stderr)
        return UNKNOWN
    for package, ids in found.items():
        print(f"{package.lock}: {package.name} {package.version}: {', '.join(ids)}")
    if found:
        print(f"{what} checked beside {database}: advisories name {len(found)} of them", file=sys.stderr)
        return KNOWN
    print(f"{what} checked beside {database}: no advisory names one of them")
    return 0


if __name__ == "__main__":
    sys.exit(main())
