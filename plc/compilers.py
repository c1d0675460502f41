"""The library under two compilers of other makers, matiec and STruC++: `python3 plc/compilers.py compare`, and `cost`.

Both are built from `../shared/tools` into `target/compilers`, or taken from the folder that GLAPP_COMPILERS names;
neither is part of the project. What they make of the library is compared with what the core showed in the same tests:
`plc/check/foreign/driver.c`.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

import package

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
TOOLS = ROOT.parent / "shared" / "tools"
COMPILERS = ("matiec", "strucpp")
BUILDS = ("LREAL", "REAL")
CASES = (("LREAL", "as they are"), ("REAL", "as they are"), ("REAL", "of 32 bits"))
NEEDED = ("autoreconf", "bison", "flex", "make", "node", "npm", "gcc", "g++")
# Tests that run blocks and the core, and compare each number.
BESIDE = (
    "advanced",
    "bounds",
    "codes",
    "compensate",
    "control",
    "demo",
    "detection",
    "disturbed",
    "open_pins",
    "random",
    "self_check",
    "stiction",
    "vectors",
)
PACKAGE = ("--quiet", "--release", "-p", "glapp-plc-check")
COST = "| block | LREAL mean | most | bytes | REAL mean | most | bytes |"


class Missing(Exception):  # noqa: N818
    """A tool that this machine lacks."""


def run(*command: object, folder: Path = ROOT, given: str = "", **environment: str) -> str:
    """Output of a program; its complaints where it fails."""
    words = [str(word) for word in command]
    setting = os.environ | environment
    done = subprocess.run(words, cwd=folder, env=setting, input=given, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"{' '.join(words[:3])} ended with {done.returncode}:\n{done.stdout}{done.stderr}"[-4000:])
    return done.stdout


def tools() -> Path:
    """The folder with both compilers, built where they are not."""
    if given := os.environ.get("GLAPP_COMPILERS"):
        return Path(given).resolve()
    if not (TOOLS / "build").exists():
        raise Missing(f"the compilers' sources in {TOOLS}")
    missing = [name for name in NEEDED if not shutil.which(name)]
    if missing:
        raise Missing(", ".join(missing))
    out = ROOT / "target" / "compilers"
    run(TOOLS / "build", out)
    return out


def made_of(compiler: str, text: str, driver: Path, folder: Path, flags: list[str]) -> Path:
    """A C program of ours with this text as the compiler understands it."""
    at = tools()
    (folder / "all.st").write_text(text)
    flags = ["-O2", "-ffp-contract=off", "-w", f"-I{folder}", *flags]
    out = folder / driver.stem
    if compiler == "matiec":
        library = at / "matiec/lib"
        run(at / "matiec/iec2c", "-f", "-p", "-I", library, "all.st", folder=folder)
        run("gcc", *flags, f"-I{library / 'C'}", driver, "-lm", "-o", out, folder=folder)
    else:
        run("node", at / "strucpp/dist/node/cli.js", "all.st", "-o", "out.cpp", "--no-line-mapping", folder=folder)
        headers = [f"-I{at / 'strucpp/src/runtime/include'}", "-std=c++17", "-x", "c++"]
        run("g++", *flags, *headers, driver, "-o", out, folder=folder)
    return out


def of_examples(compiler: str, build: str, folder: Path) -> list[list[str]]:
    """What the examples of the pages give: `plc/check/foreign/examples.c`."""
    folder.mkdir(parents=True, exist_ok=True)
    (_, library), *_ = package.structured_text(package.library(build), build)
    text = "\n".join([library, *examples(build)])
    names = re.findall(r"PROGRAM (GlappExample\d+)\nVAR_OUTPUT\n    Wrong : INT;", text)
    (folder / "examples.inc").write_text("".join(f"RUN({name.upper()})\n" for name in names))
    program = made_of(compiler, text, HERE / "check/foreign/examples.c", folder, ["-O1"])
    return [line.split(",") for line in run(program).splitlines()]


def texts(build: str) -> str:
    """The library as it is shipped, in one file, and a block of the tests that has the functions on its pins."""
    tries = (HERE / "check/tests/tries/TryFunctions.st").read_text().replace("LREAL", build)
    (_, text), *_ = package.structured_text(package.library(build), build)
    return f"{text}\n{tries}"


def examples(build: str) -> list[str]:
    """Programs with each example of docs/plc.md and plc/blocks.md, as a reader pastes it and declares its variables."""
    units = {unit.name: unit for unit in package.library(build)}
    found = []
    for page in ("docs/plc.md", "plc/blocks.md"):
        for section in re.split(r"(?m)^##+ ", (ROOT / page).read_text(encoding="utf-8")):
            name = section.split("\n", 1)[0]
            for text in re.findall(r"(?ms)^ *```st\n(.*?)^ *```", section):
                whole = re.match(r"(?:PROGRAM|FUNCTION_BLOCK) (\w+)", text)
                unit = f"GlappExample{len(found)}"
                if whole and whole[1] == "MyLoop":
                    unit = "MyLoop"
                body = text.replace(whole[1], unit) if whole else around(text, unit, units, name)
                found.append(body.replace("LREAL", build))
    return found


def around(text: str, name: str, units: dict[str, package.Unit], section: str) -> str:
    """A program around the lines of an example: its variables, and `Wrong`, the first line that gives other numbers.

    The one block that an example calls is that of the section, or has its name after `Glapp`.
    """
    lines, numbers = [], 0
    block = re.search(r"(?m)^ *(\w+)\(", text)[1]  # type: ignore[index]
    unit = units[section if section in units else f"Glapp{block}"]
    for line in text.splitlines():
        code, _, claims = line.partition("(*") if re.match(r" *\w+\(", line) else (line, "", "")
        lines.append(f"    {code.strip()}")
        for claim in filter(None, claims.strip(" *)").split(", ")):
            pin, value = claim.split(" = ")
            numbers += 1
            what = f"{block}.{pin}"
            same = {"TRUE": what, "FALSE": f"NOT {what}"}.get(value, f"{what} = {value}")
            if "." in value:
                same = f"ABS({what} - ({value})) <= {1e-5 * (1.0 + abs(float(value))):.12f}"
            lines += [f"    Good := {same};", f"    IF NOT Good AND (Wrong = 0) THEN Wrong := {numbers}; END_IF;"]
    pins = {var.name: var.type for var in unit.vars("VAR_INPUT")}
    handed = sorted(set(re.findall(r"\b(\w+) := \1\b", text)))
    held = [f"    {pin} : {pins[pin]};" for pin in handed]
    head = [f"PROGRAM {name}", "VAR_OUTPUT", "    Wrong : INT;", "END_VAR", "VAR", f"    {block} : {unit.name};"]
    return "\n".join([*head, *held, "    Good : BOOL;", "END_VAR", *lines, "END_PROGRAM", ""])


def compiled(compiler: str, build: str, folder: Path, literals: str = "as they are", foreign: str = "") -> Path:
    """The driver with the library as this compiler understands it.

    Both compilers leave a literal in C as a `double`, so that in REAL an expression with one is worked out in 64 bits
    and rounded at its end. With `literals` "of 32 bits" the C compiler takes them as `float`, as IEC 61131-3 means them
    beside a REAL. `foreign` is the program of that name, made by cargo where it is not given.
    """
    folder.mkdir(parents=True, exist_ok=True)
    words = [foreign] if foreign else ["cargo", "run", *PACKAGE, "--example", "foreign", "--"]
    (folder / "table.inc").write_text(run(*words, compiler, build))
    flags = [f'-DBUILD="{build}"']
    if literals == "of 32 bits":
        flags.append("-fsingle-precision-constant")
    return made_of(compiler, texts(build), HERE / "check/foreign/driver.c", folder, flags)


def traces(folder: Path, twins: str = "") -> list[Path]:
    """Traces of the tests that compare blocks with the core: every vector and random sequences."""
    folder.mkdir(parents=True, exist_ok=True)
    if not any(folder.iterdir()):
        words = [twins] if twins else ["cargo", "test", *PACKAGE, "--test", "twins", "--"]
        run(*words, *(f"{name}::" for name in BESIDE), folder=HERE / "check", GLAPP_TRACES=str(folder))
    return sorted(folder.iterdir())


def compared(driver: Path, files: list[Path]) -> list[tuple[str, list[float]]]:
    """Comparison for each block: traces, scans, numbers; other bits, differences beyond 1E-3, the largest one.

    Off by how much is a share of 1 + the number.
    """
    return [(name, [float(cell) for cell in cells]) for name, *cells in rows(driver, "compare", files=files)]


def rows(driver: Path, *words: object, files: Iterable[Path] = ()) -> list[list[str]]:
    """Cells of the driver's output."""
    listed = "".join(f"{path}\n" for path in files)
    return [line.split("\t") for line in run(driver, *words, given=listed).splitlines()]


def project(build: str, folder: Path) -> list[float]:
    """Outputs of the project for OpenPLC and Beremiz after 10 000 ticks under matiec: `plc/check/foreign/project.c`."""
    library = tools() / "matiec/lib"
    folder.mkdir(parents=True, exist_ok=True)
    texts = dict(package.structured_text(package.library(build), build))
    (folder / "project.st").write_text(texts[f"GlappProject_{build}.st"])
    run(tools() / "matiec/iec2c", "-f", "-p", "-I", library, "project.st", folder=folder)
    sources = [HERE / "check/foreign/project.c", "GlappConfiguration.c", "GlappResource.c"]
    flags = ["-O1", "-ffp-contract=off", "-w", f"-I{library / 'C'}", f"-I{folder}"]
    run("gcc", *flags, *sources, "-lm", "-o", "project", folder=folder)
    return [float(cell) for cell in rows(folder / "project")[0]]


def self_test(driver: Path) -> list[float]:
    """Done, Passed, Exact, Block and Off of GlappSelfTest."""
    return [float(cell) for cell in rows(driver, "self-test")[0]]


def compare(work: Path) -> None:
    """Prints what each compiler gives, compared with the core."""
    files = traces(work / "traces")
    for compiler in COMPILERS:
        for build, literals in CASES:
            driver = compiled(compiler, build, work / compiler / build, literals)
            done, passed, exact, block, off = self_test(driver)
            result = f"done {done:.0f}, passed {passed:.0f}, exact {exact:.0f}, block {block:.0f}, off {off:.3g}"
            print(f"\n{compiler}, {build}, literals {literals}: GlappSelfTest {result}")
            heads = ["block", "traces", "scans", "numbers", "other bits", "beyond 1E-3", "largest"]
            print("{:32}{:>8}{:>10}{:>12}{:>12}{:>13}{:>12}".format(*heads))
            for name, (count, scans, numbers, other, beyond, largest) in compared(driver, files):
                print(f"{name:32}{count:8.0f}{scans:10.0f}{numbers:12.0f}{other:12.0f}{beyond:13.0f}{largest:12.3g}")


def few(files: list[Path], most: int) -> list[Path]:
    """A number of traces of each block and build, evenly drawn."""
    lots: dict[bytes, list[Path]] = {}
    for path in files:
        with path.open("rb") as file:
            lots.setdefault(b" ".join(file.readline(200).split()[:2]), []).append(path)
    return [path for lot in lots.values() for path in lot[:: max(1, len(lot) // most)][:most]]


def cost(work: Path) -> None:
    """Put the cost of a scan of each block under matiec, and its memory, into plc/measured.md."""
    files = few(traces(work / "traces"), 20)
    table: dict[str, list[str]] = {}
    for build in BUILDS:
        driver = compiled("matiec", build, work / "matiec" / build)
        for name, _, mean, most, size in rows(driver, "cost", 5, files=files):
            table.setdefault(name, []).extend([f"{float(mean):.2f}", f"{float(most):.2f}", size])
    lines = [f"| `{name}` | {' | '.join(cells)} |" for name, cells in table.items() if not name.startswith("GlappTry")]
    page = ROOT / "plc/measured.md"
    text = page.read_text()
    head = re.escape(f"{COST}\n|---|---|---|---|---|---|---|\n")
    found = re.search(rf"(µs.*?\n\n{head})((?:\|.*\n)*)", text, re.DOTALL)
    if not found:
        raise ValueError(f"{page} has no table of the cost in µs")
    page.write_text(text[: found.start(2)] + "\n".join(lines) + "\n" + text[found.end(2) :])


if __name__ == "__main__":
    commands = {"compare": compare, "cost": cost}
    if len(sys.argv) < 2 or sys.argv[1] not in commands:
        sys.exit(f"usage: python3 {sys.argv[0]} {'|'.join(commands)} [FOLDER]")
    os.nice(19 - os.nice(0))
    command = commands[sys.argv[1]]
    try:
        command(Path(sys.argv[2] if len(sys.argv) > 2 else ROOT / "target/compiled").resolve())
    except Missing as missing:
        sys.exit(f"missing: {missing}")
