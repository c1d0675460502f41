"""The locks of Python's packages: they agree with pyproject.toml and with each other, and can be audited."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import threading
import tomllib
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path
from typing import Any, ClassVar

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from requirements.audit import KNOWN, UNKNOWN, locked, main
from requirements.lock import BASE, LOCKS

ROOT = Path(__file__).resolve().parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def entries(name: str) -> dict[str, list[tuple[Requirement, int]]]:
    """The packages of a lock by name: each with its marker, and how many checksums it has."""
    found: dict[str, list[tuple[Requirement, int]]] = {}
    text = (ROOT / "requirements" / f"{name}.txt").read_text(encoding="utf-8").replace("\\\n", " ")
    for line in text.splitlines():
        if line and not line.startswith("#"):
            parts, *hashes = line.split("--hash=sha256:")
            assert all(re.fullmatch(r"[0-9a-f]{64}", digest.strip()) for digest in hashes), line
            one = Requirement(parts.strip())
            found.setdefault(canonicalize_name(one.name), []).append((one, len(hashes)))
    return found


def named(name: str) -> list[Requirement]:
    """Requirements of a lock in pyproject.toml."""
    groups = PROJECT["dependency-groups"]
    return [
        Requirement(one)
        for group in LOCKS[name]
        for one in (PROJECT["project"]["dependencies"] if group == BASE else groups[group])
    ]


def test_every_group_has_a_lock() -> None:
    assert sorted(group for groups in LOCKS.values() for group in groups if group != BASE) == sorted(
        PROJECT["dependency-groups"]
    )
    assert sorted(path.stem for path in (ROOT / "requirements").glob("*.txt")) == sorted(LOCKS)
    [maturin] = [one for one in named("run") if one.name == "maturin"]
    assert [maturin] == [Requirement(one) for one in PROJECT["build-system"]["requires"]]


@pytest.mark.parametrize("name", LOCKS)
def test_a_lock_has_what_is_asked_in_its_range_with_checksums_and_no_place(name: str) -> None:
    there = entries(name)
    for one in named(name):
        versions = [entry for entry, _ in there[canonicalize_name(one.name)]]
        for entry in versions:
            [pin] = entry.specifier
            assert pin.operator == "==" and pin.version in one.specifier, f"{entry}, and {one} is asked: make lock"
    assert all(count for entries in there.values() for _, count in entries)
    text = (ROOT / "requirements" / f"{name}.txt").read_text(encoding="utf-8")
    assert not re.search(r"^-|://|index|find-links|trusted-host|(^|\s)/", text.replace("\\\n    --hash", " hash"), re.M)


def test_a_package_has_the_same_versions_in_every_lock() -> None:
    seen: dict[str, set[str]] = {}
    for name in LOCKS:
        for package, several in entries(name).items():
            versions = {str(entry.specifier) for entry, _ in several}
            assert seen.setdefault(package, versions) == versions, f"{package} in {name}"


def test_make_installs_by_the_locks_and_in_no_other_way() -> None:
    lines = (ROOT / "Makefile").read_text(encoding="utf-8").splitlines()
    installing = [line.strip() for line in lines if "pip install" in line]
    assert installing and all(
        "--no-deps" in line and ("--require-hashes" in line or "--no-build-isolation" in line) for line in installing
    ), installing


class _Osv(BaseHTTPRequestHandler):
    """Answers as OSV does: an advisory for one package, on a second page."""

    asked: ClassVar[list[dict[str, Any]]] = []
    named = "numpy"

    def do_POST(self) -> None:
        queries = json.loads(self.rfile.read(int(self.headers["Content-Length"])))["queries"]
        self.asked.extend(queries)
        results: list[dict[str, Any]] = []
        for query in queries:
            mine = query["package"] == {"ecosystem": "PyPI", "name": self.named}
            first = {"vulns": [{"id": "GHSA-one"}], "next_page_token": "2"}
            results.append({} if not mine else {"vulns": [{"id": "GHSA-two"}]} if "page_token" in query else first)
        body = json.dumps({"results": results}).encode()
        self.send_response(200)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *arguments: object) -> None:
        pass


@pytest.fixture
def osv() -> Iterator[str]:
    with HTTPServer(("127.0.0.1", 0), _Osv) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        _Osv.asked, _Osv.named = [], "numpy"
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()


def test_an_advisory_is_printed_with_its_lock_and_an_error(osv: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--database", osv]) == KNOWN
    printed = capsys.readouterr().out.splitlines()
    assert printed and all(
        re.fullmatch(r"requirements/\w+\.txt: numpy [\d.]+: GHSA-one, GHSA-two", line) for line in printed
    )
    first = [query for query in _Osv.asked if "page_token" not in query]
    assert len(first) == len(locked(ROOT)) and {"crates.io", "PyPI"} == {q["package"]["ecosystem"] for q in first}
    assert all(set(query) <= {"package", "version", "page_token"} for query in _Osv.asked)
    _Osv.named = "none of them"
    assert main(["--database", osv]) == 0 and "no advisory names" in capsys.readouterr().out


def test_an_unreachable_data_base_has_an_exit_code_of_its_own() -> None:
    with HTTPServer(("127.0.0.1", 0), _Osv) as server:
        closed = server.server_port
    command = [sys.executable, str(ROOT / "requirements" / "audit.py"), "--database", f"http://127.0.0.1:{closed}"]
    run = subprocess.run(command, capture_output=True, text=True)
    assert (run.returncode, run.stdout) == (UNKNOWN, "")
    assert f"could not be checked: http://127.0.0.1:{closed} is not reachable" in run.stderr
    assert UNKNOWN not in (0, KNOWN) and run.stderr.count("\n") == 1
