"""Examples and tests of the crates as `make rust` has made them; asked for one package, cargo would make all anew."""

import json
import subprocess
from pathlib import Path

import fits

CRATES = ("core", "fit", "sim", "analysis", "capi", "plc-check", "py")
"""Crates that the Makefile names in TESTED."""


def _made() -> dict[tuple[str, str, str], str]:
    command = ["cargo", "test", "--release", "--no-run", "--quiet", "--message-format=json"]
    command += [f"-pglapp-{crate}" for crate in CRATES]
    done = subprocess.run(command, cwd=Path(__file__).parents[1], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    artifacts = [one for one in map(json.loads, done.stdout.splitlines()) if one.get("executable")]
    return {
        (Path(one["manifest_path"]).parent.name, one["target"]["kind"][0], one["target"]["name"]): one["executable"]
        for one in artifacts
    }


def built(folder: str, kind: str, name: str) -> str:
    """Path of a package's program of a kind ("example", "test") and name, built in such a folder."""
    return fits.kept("programs", _made)[folder, kind, name]
