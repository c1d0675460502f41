"""Wheels for every desk: `make wheels`, or `python wheels/build.py FOLDER [PLATFORM] [--under COMMAND]`.

One wheel a platform, for Python 3.11 and every later one (abi3), and the source package. A wheel that this machine can
run is installed into an empty environment. There it analyses the demonstration, and its answers are compared with those
of the package beside this file. What cannot be built or run here is named, with what a machine needs that can. Another
platform's wheel can be tried by an emulator: `--under "wine python.exe"` names it and a Python of that platform. An
emulated processor is slow: it analyses the beginning of each recording.

Zig is the linker, mingw for Windows. The standard library is that of rustup, or is built from its source, which Debian
has (`rust-web-src`).
"""

from __future__ import annotations

import argparse
import json
import math
import os
import platform
import shlex
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).parent
ROOT = HERE.parent
BUILT = ROOT / "target" / "wheels"
#: Debian's compiler, whose standard library can be built for any platform.
DEBIAN = Path("/usr/bin/rustc")
#: Rows of each recording that an emulated processor analyses.
FIRST = 800
#: What the tests of a wheel need beside it.
TESTED_BY = ("pytest<9.2", "jsonschema-rs")


@dataclass(frozen=True)
class Platform:
    """A platform for which there is a wheel."""

    triple: str
    """Name of the platform in Rust."""
    rules: str
    """The rules that its wheel keeps, as the name of the file tells them."""
    runs_on: tuple[str, str] | None = None
    """System and processor, as Python names them, that run it."""
    linker: str | None = None
    """Linker of the platform; None: Zig."""


PLATFORMS = {
    "linux-x86_64": Platform("x86_64-unknown-linux-gnu", "manylinux_2_17", ("Linux", "x86_64")),
    "linux-aarch64": Platform("aarch64-unknown-linux-gnu", "manylinux_2_17", ("Linux", "aarch64")),
    "musl-x86_64": Platform("x86_64-unknown-linux-musl", "musllinux_1_2"),
    "musl-aarch64": Platform("aarch64-unknown-linux-musl", "musllinux_1_2"),
    "windows-x86_64": Platform("x86_64-pc-windows-gnu", "pypi", ("Windows", "AMD64"), "x86_64-w64-mingw32-gcc"),
    "macos-arm64": Platform("aarch64-apple-darwin", "pypi", ("Darwin", "arm64")),
    "macos-x86_64": Platform("x86_64-apple-darwin", "pypi", ("Darwin", "x86_64")),
}


class Missing(Exception):  # noqa: N818 (it is told, and the platform is skipped)
    """A tool that this machine lacks."""


def asked(rustc: str, *what: str) -> Path:
    """A folder of a compiler."""
    done = subprocess.run([rustc, "--print", *what], capture_output=True, text=True, check=True)
    return Path(done.stdout.strip())


def standard_library(triple: str) -> dict[str, str]:
    """Options for cargo on the standard library of a platform."""
    ours = os.environ.get("RUSTC", "rustc")
    if asked(ours, "target-libdir", "--target", triple).is_dir():
        return {}
    for rustc in (ours, str(DEBIAN)):
        if shutil.which(rustc) and (asked(rustc, "sysroot") / "lib/rustlib/src/rust/library/Cargo.lock").is_file():
            return {"RUSTC": rustc, "RUSTC_BOOTSTRAP": "1", "CARGO_UNSTABLE_BUILD_STD": "std,panic_unwind"}
    raise Missing(
        f"the standard library: rustup target add {triple}, or on Debian apt-get install rustc-web rust-web-src"
    )


def built(of: Platform, folder: Path) -> Path:
    """The wheel of a platform.

    Raises
    ------
    Missing
        Where this machine lacks what it takes.
    """
    environment = os.environ | standard_library(of.triple) | {"CARGO_TARGET_DIR": str(BUILT)}
    # Zig is looked for as a module of the first Python: that of this environment has it.
    environment["PATH"] = f"{Path(sys.executable).parent}{os.pathsep}{environment['PATH']}"
    if of.triple.endswith("darwin") and platform.system() != "Darwin":
        # Zig has what every program needs of macOS. Its time zone is asked of a framework: the names of that are here.
        environment["RUSTFLAGS"] = f"-L framework={HERE}"
        # Tool that strips a library of macOS: every toolchain of rustup has it, and Debian's compiler looks for it.
        tools = next(asked("rustc", "sysroot").glob("lib/rustlib/*/bin/rust-objcopy"), None) or shutil.which(
            "rust-objcopy"
        )
        if tools is None:
            raise Missing("rust-objcopy, which comes with rustup")
        environment["PATH"] = f"{Path(tools).parent}{os.pathsep}{environment['PATH']}"
    command = [sys.executable, "-m", "maturin", "build", "--release", "--quiet", "--target", of.triple]
    command += ["--compatibility", of.rules, "--interpreter", "python3.11", "--out", str(folder)]
    if of.linker is not None and shutil.which(of.linker) is None:
        raise Missing(f"the linker {of.linker}: apt-get install gcc-mingw-w64-x86-64")
    subprocess.run([*command, *([] if of.linker else ["--zig"])], cwd=ROOT, env=environment, check=True)
    return max(folder.glob("*.whl"), key=lambda path: path.stat().st_mtime)


def run(command: list[str], folder: Path, environment: dict[str, str]) -> str:
    """Output of a command.

    Raises
    ------
    AssertionError
        Where it fails, with all that it says.
    """
    # An emulator may not start without an input.
    pipes = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    done = subprocess.run(command, cwd=folder, env=environment, encoding="utf-8", errors="replace", **pipes)
    assert done.returncode == 0, f"{shlex.join(command)} ended with {done.returncode}\n{done.stdout}{done.stderr}"
    return done.stdout


def answers(
    python: list[str], folder: Path, environment: dict[str, str], rows: int | None = None
) -> list[tuple[str, str, float | None]]:
    """Loop, verdict and width of the demonstration, or of its first rows, as this Python's glapp has them."""
    glapp = [*python, "-m", "glapp"]
    run([*glapp, "demo", "demo", "--force"], folder, environment)
    for path in (folder / "demo").glob("*.csv") if rows else ():
        lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
        path.write_text("".join(lines[: rows + 1]), encoding="utf-8")
    document = json.loads(run([*glapp, "analyze", "demo/loops.toml", "--json"], folder, environment))
    return [(one["loop"], one["answer"]["verdict"], one["answer"]["width"]) for one in document["loops"]]


def installed(wheel: Path, folder: Path) -> tuple[list[str], dict[str, str]]:
    """An empty environment with the wheel and what tests it, and its variables."""
    subprocess.run([sys.executable, "-m", "venv", folder / "empty"], check=True)
    python = next(path for path in (folder / "empty/bin/python", folder / "empty/Scripts/python.exe") if path.exists())
    subprocess.run([python, "-m", "pip", "install", "--quiet", wheel, *TESTED_BY], check=True)
    # No file beside this one may be imported in place of the wheel.
    return [str(python)], {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}


def installed_under(command: list[str], wheel: Path, folder: Path) -> tuple[list[str], dict[str, str]]:
    """An installed wheel for another platform's Python, which an emulator runs: a folder in which it looks."""
    asked = "import sys; print('%d.%d' % sys.version_info[:2])"
    version = run([*command, "-c", asked], folder, dict(os.environ)).strip()
    rules = wheel.stem.rsplit("-", 1)[1].split(".")
    # A package it needs may ask for a newer system than glapp does.
    rules += [rule.replace("_2_17_", "_2_28_") for rule in rules if "_2_17_" in rule]
    of = [f"--platform={rule}" for rule in rules] + ["--python-version", version, "--only-binary=:all:"]
    install = [sys.executable, "-m", "pip", "install", "--quiet", *of, "--target", folder / "site", wheel, *TESTED_BY]
    subprocess.run(install, check=True)
    return command, os.environ | {"PYTHONPATH": str(folder / "site")}


def alike(theirs: tuple[str, str, float | None], ours: tuple[str, str, float | None]) -> bool:
    """Equal names; a width to 1 in 1000, since a search ends where the last digits of a system's logarithms send it."""
    (*names, width), (*own_names, own) = theirs, ours
    return names == own_names and (
        width == own or (None not in (width, own) and math.isclose(width, own, rel_tol=1e-3))
    )


def tried(wheel: Path, under: list[str], rows: int | None = None) -> str:
    """Test of a wheel in an empty environment, on the first rows of each recording or on all.

    Raises
    ------
    AssertionError
        Where it answers otherwise than the package beside this file.
    """
    with tempfile.TemporaryDirectory() as room:
        folder = Path(room)
        python, alone = installed_under(under, wheel, folder) if under else installed(wheel, folder)
        theirs, ours = answers(python, folder, alone, rows), answers([sys.executable], folder, dict(os.environ), rows)
        assert len(theirs) == len(ours) and all(map(alike, theirs, ours)), (theirs, ours)
        test = [
            "-m",
            "pytest",
            "--quiet",
            "--noconftest",
            "-p",
            "no:cacheprovider",
            str(ROOT / "tests/test_vectors.py"),
        ]
        vectors = run([*python, *test], folder, alone).splitlines()[-1]
    part = "" if rows is None else f", their first {rows} rows"
    return f"{len(theirs)} loops of the demonstration{part}; vectors: {vectors}"


def source(folder: Path) -> Path:
    """The source package, which every platform with Rust can build."""
    command = [sys.executable, "-m", "maturin", "sdist", "--out", str(folder)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    return max(folder.glob("*.tar.gz"), key=lambda path: path.stat().st_mtime)


def main() -> int:
    """Build, try and report; 1 where a wheel fails."""
    parser = argparse.ArgumentParser(description="Wheels for every platform.")
    parser.add_argument("folder", type=Path)
    parser.add_argument("platforms", nargs="*", choices=[[], *PLATFORMS], metavar="PLATFORM", help=", ".join(PLATFORMS))
    parser.add_argument("--under", metavar="COMMAND", default="", help="an emulator and a Python of the one platform")
    given = parser.parse_args()
    under = shlex.split(given.under)
    if under and len(given.platforms) != 1:
        parser.error("--under goes with one platform")
    folder = given.folder.absolute()
    folder.mkdir(parents=True, exist_ok=True)
    here = (platform.system(), platform.machine())
    processor = {"AMD64": "x86_64", "arm64": "aarch64"}.get(here[1], here[1])
    wrong = 0
    for name in given.platforms or PLATFORMS:
        of = PLATFORMS[name]
        try:
            wheel = built(of, folder)
        except Missing as lacks:
            print(f"{name}: skipped, this machine lacks {lacks}")
            continue
        except subprocess.CalledProcessError as error:
            wrong = 1
            print(f"{name}: could not be built, maturin ended with {error.returncode}")
            continue
        outcome = "not tried: it runs on another machine"
        if under or (of.runs_on == here and not on_musl()):
            try:
                outcome = tried(wheel, under, None if of.triple.startswith(processor) else FIRST)
            except (AssertionError, subprocess.CalledProcessError) as error:
                wrong, outcome = 1, f"WRONG: {error}"
        print(f"{name}: {wheel.name}, {wheel.stat().st_size / 1e6:.1f} MB; {outcome}", flush=True)
    if not given.platforms:
        package = source(folder)
        print(f"source: {package.name}, {package.stat().st_size / 1e6:.1f} MB")
    return wrong


def on_musl() -> bool:
    """Whether this Python runs on musl, which manylinux wheels do not."""
    return "musl" in (sysconfig.get_config_var("HOST_GNU_TYPE") or "")


if __name__ == "__main__":
    sys.exit(main())
