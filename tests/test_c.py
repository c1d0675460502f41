"""The C library: its header matches the library, its examples give Python's results, wrong input is refused."""

from __future__ import annotations

import ctypes
import json
import math
import os
import re
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

import glapp
from glapp.modules import BacklashDetection, Graph, Input, Output

pytestmark = pytest.mark.slow  # the library is compiled first

ROOT = Path(__file__).parents[1]
HEADER = ROOT / "crates/capi/include/glapp.h"
FFI = ROOT / "crates/capi/src/ffi.rs"
EXAMPLES = ROOT / "examples/c"
EMBEDDED = ROOT / "crates/embedded"
CATALOGUE = json.loads((ROOT / "vectors/catalogue.json").read_text(encoding="utf-8"))
SYSTEM = ["-lm", "-lpthread", "-ldl"]

built = pytest.mark.xdist_group("the C library")


@pytest.fixture(scope="session")
def library() -> Path:
    """The folder of the libraries, made from the sources as they stand."""
    alone = {name: value for name, value in os.environ.items() if not name.startswith("MAKE")}
    subprocess.run(["make", "--silent", "capi"], cwd=ROOT, env=alone, check=True)
    return ROOT / "dist/capi/lib"


@pytest.fixture(scope="session")
def loaded(library: Path) -> ctypes.CDLL:
    shared = next(path for path in (library / f"libglapp.{end}" for end in ("so", "dylib")) if path.exists())
    loaded = ctypes.CDLL(str(shared))
    loaded.glapp_error.restype = ctypes.c_char_p
    loaded.glapp_version.restype = ctypes.c_char_p
    return loaded


# The header -----------------------------------------------------------------------------------------------------------

C_NAMES = {"u32": "uint32_t", "i32": "int32_t", "u8": "uint8_t", "f64": "double", "usize": "size_t", "c_char": "char"}


def snake(name: str) -> str:
    return re.sub(r"(?<!^)(?=[A-Z])", "_", name).lower()


def in_c(rust: str) -> str:
    """A type of the functions as C writes it, without spaces before stars."""
    if pointer := re.fullmatch(r"\*(const|mut) (.+)", rust):
        inner = in_c(pointer[2])
        if pointer[1] == "const":
            return f"{inner}const*" if inner.endswith("*") else f"const {inner}*"
        return f"{inner}*"
    if array := re.fullmatch(r"\[(\w+); (\d+)\]", rust):
        return f"{in_c(array[1])}[{array[2]}]"
    return C_NAMES.get(rust) or snake(rust)


def squeezed(c: str) -> str:
    """C without needless spaces."""
    return re.sub(r"\s*\*\s*", "*", re.sub(r"\s+", " ", c)).strip()


def code() -> str:
    return re.sub(r"/\*.*?\*/", " ", HEADER.read_text(encoding="utf-8"), flags=re.DOTALL)


def declared(parameter: str) -> tuple[str, str]:
    """Name and type of a parameter or member in C."""
    found = re.fullmatch(r"(.*?)(\w+)(\[\d+\])?", squeezed(parameter))
    assert found, parameter
    return found[2], found[1].strip() + (found[3] or "")


def test_every_door_stands_in_the_header_with_its_types() -> None:
    rust = FFI.read_text(encoding="utf-8")
    functions = {}
    for name, parameters, returned in re.findall(r'extern "C" fn (\w+)\(([^)]*)\) -> ([^{]+) \{', rust):
        pairs = [p.strip().split(": ") for p in parameters.split(",") if p.strip()]
        functions[name] = (in_c(returned.strip()), [(of, in_c(kind)) for of, kind in pairs])
    prototypes = {}
    for returned, name, parameters in re.findall(r"^([\w ]+[ *])(glapp_\w+)\(([^)]*)\);", code(), flags=re.MULTILINE):
        pairs = [declared(p) for p in parameters.split(",") if p.strip() != "void"]
        prototypes[name] = (squeezed(returned), pairs)
    assert len(functions) > 10
    assert prototypes == functions


def test_every_structure_has_the_members_of_the_library() -> None:
    rust = FFI.read_text(encoding="utf-8")
    ours = {
        snake(name): [(of, in_c(kind)) for of, kind in re.findall(r"pub (\w+): ([^,]+(?:; \d+\])?),", members)]
        for name, members in re.findall(r"#\[repr\(C\)\]\n[^\n]*\npub struct (\w+) \{(.*?)\n\}", rust, flags=re.DOTALL)
    }
    theirs = {
        name: [declared(member) for member in members.split(";") if member.strip()]
        for members, name in re.findall(r"typedef struct \w+ \{(.*?)\} (\w+);", code(), flags=re.DOTALL)
    }
    assert len(ours) == 6
    assert theirs == ours


def test_numbers_are_those_of_the_core() -> None:
    defined = re.findall(r"#define GLAPP_(\w+?)_(\w+) (-?\d+)", code())
    of = lambda kind: {name.lower(): int(number) for group, name, number in defined if group == kind}  # noqa: E731
    assert of("REASON") == CATALOGUE["reasons"]
    assert of("STANDING") == CATALOGUE["standings"]
    assert of("FLAG") == {name: CATALOGUE["flags"][name] for name in ("not_auto", "bad", "at_low", "at_high")}
    assert of("VERDICT") == {name: number for number, name in enumerate(CATALOGUE["fit_verdicts"], 1)}


def test_codes_are_those_of_the_library() -> None:
    wrong = (ROOT / "crates/capi/src/errors.rs").read_text(encoding="utf-8")
    codes = dict(re.findall(r"pub const (\w+): i32 = (-?\d+);", wrong))
    assert codes == {
        name: number for name, number in re.findall(r"#define GLAPP_(\w+) (-?\d+)", code()) if name in codes
    }
    abi = re.search(r"pub const ABI: u32 = (\d+)", (ROOT / "crates/capi/src/lib.rs").read_text(encoding="utf-8"))
    assert abi and f"#define GLAPP_ABI {abi[1]}\n" in code()
    assert f"-soname$(,)libglapp.so.{abi[1]})" in (ROOT / "Makefile").read_text(encoding="utf-8")


# The examples ---------------------------------------------------------------------------------------------------------


def compiled(name: str, library: Path, folder: Path, *, cpp: bool, shared: bool) -> Path:
    compiler = shutil.which("c++" if cpp else "cc")
    if compiler is None:
        pytest.skip("there is no compiler for C and C++ here")
    program = folder / name
    language = ["-x", "c++", "-std=c++11"] if cpp else ["-x", "c", "-std=c99"]
    linked = [f"-L{library}", "-lglapp", f"-Wl,-rpath,{folder}"] if shared else [str(library / "libglapp.a"), *SYSTEM]
    if shared and sys.platform == "linux" and not (folder / "libglapp.so.1").exists():
        (folder / "libglapp.so.1").symlink_to(library / "libglapp.so")
    strict = ["-Wall", "-Wextra", "-Wpedantic", "-Werror", "-ffp-contract=off"]
    source = ["-I", str(HEADER.parent), str(EXAMPLES / f"{name}.c"), "-x", "none"]
    done = subprocess.run(
        [compiler, *language, *strict, *source, "-o", str(program), *linked, "-lm"], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return program


def output_of(program: Path, *arguments: str, fed: str = "") -> str:
    done = subprocess.run([program, *arguments], input=fed, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    return done.stdout


LANGUAGES = pytest.mark.parametrize(
    "language", [("cc", "c", "-std=c99"), ("c++", "c++", "-std=c++11")], ids=["C", "C++"]
)
STRICT = ("-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wshadow", "-Werror")


def is_taken(language: tuple[str, str, str], source: Path) -> None:
    compiler = shutil.which(language[0])
    if compiler is None:
        pytest.skip("there is no compiler for C and C++ here")
    folders = ["-I", HEADER.parent, "-I", EMBEDDED / "include"]
    command = [compiler, "-fsyntax-only", "-x", *language[1:], *STRICT, *folders, source]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@LANGUAGES
def test_the_programs_of_the_page_compile(tmp_path: Path, language: tuple[str, str, str]) -> None:
    page = (ROOT / "docs/c.md").read_text(encoding="utf-8")
    programs = re.findall(r"```c\n(.*?)```", page, re.DOTALL)
    assert len(programs) == 4 and sum("_f32(" in one for one in programs) == 1
    for number, program in enumerate(programs):
        # The functions for a microcontroller have a header of their own, and numbers of 32 bits.
        header, real = ("glapp_embedded.h", "float") if "_f32(" in program else ("glapp.h", "double")
        given = f"{real} sp, {real} pv, {real} op, uint32_t flags, {real} seconds"
        unused = "(void)sp; (void)pv; (void)op; (void)flags; (void)seconds;"
        if real == "double":
            given += ", glapp_graph *loop, const glapp_columns *columns"
            unused += " (void)loop; (void)columns;"
        head = f"#include <{header}>\n#include <stdio.h>\nvoid report({given});\nvoid report({given}) {{\n{unused}\n"
        source = tmp_path / f"{number}.c"
        source.write_text(head + program + "}\n", encoding="utf-8")
        is_taken(language, source)


def test_the_examples_for_a_microcontroller_compile() -> None:
    """The vector table was no C by the standard."""
    for source in sorted((EMBEDDED / "example").glob("*.c")):
        is_taken(("cc", "c", "-std=c99"), source)


WAYS = pytest.mark.parametrize(("cpp", "shared"), [(False, True), (True, False)], ids=["C, shared", "C++, static"])


@built
@pytest.mark.slow
@WAYS
def test_modules_says_what_its_python_twin_says(library: Path, tmp_path: Path, cpp: bool, shared: bool) -> None:
    program = compiled("modules", library, tmp_path, cpp=cpp, shared=shared)
    assert output_of(program) == output_of(Path(sys.executable), str(ROOT / "examples/03_modules.py"))


@built
@pytest.mark.slow
@WAYS
def test_beside_has_the_bits_of_python(library: Path, tmp_path: Path, cpp: bool, shared: bool) -> None:
    k, ti, h, sp, d = 0.5, 40.0, 1.0, 50.0, 2.0
    names = ("sp", "pv", "flags", "op", "u_ff")
    watch = BacklashDetection(
        k=k, ti=ti, integrating=1, op_low=0.0, op_high=100.0, comp_size=2.0, comp_share=0.8, comp_watch=30000.0
    )
    modules = {**{name: Input() for name in names}, "watch": watch, "ff": Output()}
    beside = Graph(h, modules, [f"{name} -> watch.{name}" for name in names] + ["watch -> ff"])
    pv, valve, integral, u_ff = 49.0, 50.0, 50.0, 0.0
    expected = []
    for scan in range(6000):
        load, e = 0.5 * (scan // 500 % 2), sp - pv
        integral = integral + k * h / ti * e
        op = k * e + integral + u_ff
        valve = op - d / 2.0 if op - valve > d / 2.0 else valve
        valve = op + d / 2.0 if valve - op > d / 2.0 else valve
        beside.scan(sp=sp, pv=pv, flags=0, op=op, u_ff=u_ff)
        u_ff = beside["ff"]
        pv = pv + (valve - 50.0 + load) / 10.0 * h
        if scan == 2999:
            expected.append(f"before: estimate {beside['watch.d_hat']!r}")
            beside["watch.compensate"] = 1
        if scan % 1000 == 999:
            standing = beside["watch.standing"]
            expected.append(f"scan {scan + 1}: PV {pv!r}, u_FF {u_ff!r}, standing {standing:.0f}")
    assert "estimate 1.9" in expected[2] and "standing 0" in expected[4], expected
    printed = output_of(compiled("beside", library, tmp_path, cpp=cpp, shared=shared))
    assert same_numbers(printed) == same_numbers("\n".join(expected))


def rows_of(sim: glapp.Simulation) -> str:
    """A recording as the examples read it, every digit of it."""
    rows = zip(sim.t, sim.sp, sim.pv, sim.op, strict=True)
    return "\n".join(" ".join(repr(float(x)) for x in row) for row in rows)


P3, ACTING = (0.48, 0.3117), {"setpoint": [(1.0, 50.0)], "d": 5.0, "noise": 0.1, "seed": 1}


@built
@pytest.mark.slow
@WAYS
def test_detector_has_the_bits_of_python(library: Path, tmp_path: Path, cpp: bool, shared: bool) -> None:
    load = [(40.0, 20.0), (80.0, 0.0), (120.0, 20.0)]
    sim = glapp.simulate.closed_loop("P3", P3, h=0.1, t_end=160, load=load, **ACTING)
    detector = glapp._glapp.Detector({"k": P3[0], "ti": P3[1], "h": 0.1})
    expected = []
    for sample in zip(sim.t, sim.sp, sim.pv, sim.op, strict=True):
        if (half := detector.update(*sample)) is not None:
            expected.append(f"{half.t_start!r} s to {half.t_end!r} s: d = {half.d!r}, reason {half.reason}")
    assert len(expected) > 20 and detector.estimate is not None
    expected.append(f"estimate {detector.estimate[0]!r} from {detector.estimate[4]} detections")
    program = compiled("detector", library, tmp_path, cpp=cpp, shared=shared)
    printed = output_of(program, *map(str, P3), "0.1", fed=rows_of(sim))
    assert same_numbers(printed) == same_numbers("\n".join(expected))


@built
@pytest.mark.slow
@WAYS
def test_fit_has_the_bits_of_python(library: Path, tmp_path: Path, cpp: bool, shared: bool) -> None:
    load = [(5.0, 20.0), (12.0, 0.0), (20.0, 20.0)]
    sim = glapp.simulate.closed_loop("P3", P3, h=0.2, t_end=30, load=load, **ACTING)
    loop = glapp.Loop(name="FIC101", controller={"k": P3[0], "ti": P3[1]})
    fit = glapp.fit(t=sim.t, sp=sim.sp, pv=sim.pv, op=sim.op, loop=loop)
    assert fit.verdict == "backlash" and fit.process is not None and fit.high is not None
    assert fit.d is not None and fit.low is not None
    verdict = CATALOGUE["fit_verdicts"].index(fit.verdict) + 1
    width = f"width {fit.d!r} ({fit.low!r} to {fit.high!r}), verdict {verdict}, {fit.why}"
    kp, dead_time, lag = (limits[0] for limits in (fit.process.kp, fit.process.dead_time, fit.process.lag))
    expected = f"{width}\nprocess: gain {kp}, dead time {dead_time} s, lag {lag} s"
    program = compiled("fit", library, tmp_path, cpp=cpp, shared=shared)
    assert same_numbers(output_of(program, "1", fed=rows_of(sim))) == same_numbers(expected)


@built
@pytest.mark.slow
@pytest.mark.parametrize(("name", "arguments"), [("detector", ["1", "10", "1"]), ("fit", ["1"])])
def test_a_row_that_cannot_be_read_ends_an_example(
    library: Path, tmp_path: Path, name: str, arguments: list[str]
) -> None:
    """The rows after it were left out without a word."""
    program = compiled(name, library, tmp_path, cpp=False, shared=True)
    for rows in ("0 1 2 3\n1 1 x 3\n2 1 2 3\n", "0 1 2 3\n1 1 2\n"):
        done = subprocess.run([program, *arguments], input=rows, capture_output=True, text=True, timeout=60)
        assert (done.returncode, done.stderr) == (1, "after row 1: four numbers are needed\n")


class Columns(ctypes.Structure):
    _fields_ = (
        ("rows", ctypes.c_size_t),
        *((name, ctypes.c_void_p) for name in ("t", "sp", "pv", "op", "position", "flags")),
    )


class Width(ctypes.Structure):
    _fields_ = (
        *(
            (name, ctypes.c_double)
            for name in ("d", "low", "high", "jump", "lr_no_gap", "lr_needed", "kp", "dead_time", "lag")
        ),
        ("integrating", ctypes.c_uint32),
        ("verdict", ctypes.c_uint32),
        ("why", ctypes.c_char * 32),
    )


@built
@pytest.mark.slow
def test_rows_that_are_bad_are_left_out_as_in_python(loaded: ctypes.CDLL) -> None:
    load = [(5.0, 20.0), (12.0, 0.0), (20.0, 20.0)]
    sim = glapp.simulate.closed_loop("P3", P3, h=0.2, t_end=30, load=load, **ACTING)
    sp, pv, flags = sim.sp.copy(), sim.pv.copy(), np.zeros(len(sim.t), np.uint8)
    sp[40:44], pv[60:63], flags[80:85] = np.nan, 1e6, 2
    flags[60:63] = 2
    loop = glapp.Loop(name="FIC101", controller={"k": P3[0], "ti": P3[1]})
    fit = glapp.fit(t=sim.t, sp=sp, pv=pv, op=sim.op, flags=flags, loop=loop)
    given = Columns(len(sim.t), *(x.ctypes.data for x in (sim.t, sp, pv, sim.op)), None, flags.ctypes.data)
    width = Width()
    done = loaded.glapp_fit(ctypes.byref(given), ctypes.c_double(1.0), ctypes.byref(width))
    assert done == OK, loaded.glapp_error()
    assert (width.d, width.low, width.high) == (fit.d, fit.low, fit.high)
    assert (width.lr_no_gap, width.why.decode()) == (fit.lr_no_gap, fit.why)


def same_numbers(text: str) -> list[str]:
    """Lines, with each number written in the one way that holds all its bits."""
    again = lambda found: float(found[0]).hex()  # noqa: E731
    return [re.sub(r"-?\d+(\.\d+)?(e[+-]?\d+)?", again, line) for line in text.splitlines()]


@built
@pytest.mark.slow
def test_a_step_test_has_the_numbers_and_codes_of_python(loaded: ctypes.CDLL) -> None:
    moves = [(100.0 * i, 100.0 * (i + 1), op) for i, op in enumerate((50.0, 53.0, 56.0, 52.0))]
    process, pi = ([0.8], [5.0, 1.0], 0.0), (0.5, 10.0)
    sim = glapp.simulate.closed_loop(
        process, pi, d=2.0, noise=0.05, h=1.0, t_end=400.0, manual=moves, setpoint=[(0.0, 40.0)]
    )
    flags = sim.flags & 1
    flags[120:125] |= 2
    found = glapp.step_test(t=sim.t, pv=sim.pv, op=sim.op, position=sim.position, flags=flags).to_dict()
    given = Columns(
        len(sim.t), sim.t.ctypes.data, None, *(x.ctypes.data for x in (sim.pv, sim.op, sim.position, flags))
    )
    room, needed = ctypes.create_string_buffer(65536), ctypes.c_size_t()
    span = Setting(b"op_span", 100.0)

    def asked(size: int, setting: Setting = span) -> int:
        return int(
            loaded.glapp_step_test(
                ctypes.byref(given),
                ctypes.byref(setting),
                ctypes.c_size_t(1),
                room,
                ctypes.c_size_t(size),
                ctypes.byref(needed),
            )
        )

    assert asked(65536) == OK, loaded.glapp_error()
    document = json.loads(room.value)
    assert needed.value == len(room.value) + 1 and document["d"] is not None
    for name in ("d", "low", "high", "d_percent_span", "kp", "kp_low", "kp_high", "settle", "integrating"):
        assert document[name] == found[name], name
    assert document["holds"] == list(found["holds"]) and document["travel"]["d"] == found["travel"]["d"]
    assert [one["evidence"] for one in document["readings"]] == [one["evidence_code"] for one in found["readings"]]
    assert asked(needed.value - 1) == BAD_LENGTH and b"must have" in loaded.glapp_error()
    assert asked(65536, Setting(b"op_span", 0.0)) == REFUSED
    assert loaded.glapp_error() == b"op_span = 0: must be a number above 0"
    assert asked(65536, Setting(b"span", 1.0)) == REFUSED


@built
def test_the_answer_document_is_that_of_python(loaded: ctypes.CDLL) -> None:
    acting = {"setpoint": [(1, 1.0)], "load": [(50, 0.3), (100, -0.2)]}
    sim = glapp.simulate.closed_loop("P3", (0.48, 0.3117), d=0.05, noise=0.005, h=0.1, t_end=200, seed=1, **acting)
    task = {"controller": {"k": 0.48, "ti": 0.3117, "td": 0.0, "b": 1.0}, "kp": 1.0, "op_span": [0.0, 10.0]}
    loop = glapp.Loop(name="P3", controller={"k": 0.48, "ti": 0.3117}, process={"kp": 1}, op_span=(0, 10), op_unit="%")
    result = glapp.analyze(t=sim.t, sp=sim.sp, pv=sim.pv, op=sim.op, loop=loop)
    given = Columns(len(sim.t), sim.t.ctypes.data, *(x.ctypes.data for x in (sim.sp, sim.pv, sim.op)), None, None)
    room, needed = ctypes.create_string_buffer(1 << 18), ctypes.c_size_t()

    def asked(text: str, size: int) -> int:
        return int(
            loaded.glapp_analyze(ctypes.byref(given), text.encode(), room, ctypes.c_size_t(size), ctypes.byref(needed))
        )

    assert asked(json.dumps(task), len(room)) == OK, loaded.glapp_error()
    document = json.loads(room.value)["answer"]
    assert document == json.loads(json.dumps(asdict(result.answer))), "every field, number by number"
    assert document["confidence"] == "found" and document["limit"] == {
        "percent_span": 1.0,
        "width": 0.1,
        "origin": "nominal",
    }
    assert asked(json.dumps(task | {"fit": False}), 100) == BAD_LENGTH and b"must have" in loaded.glapp_error()
    assert asked('{"acceptabel": 1}', len(room)) == REFUSED and b"task: unknown field" in loaded.glapp_error()
    assert asked('{"n": 0, "controller": {"k": 1, "ti": 1, "td": 0, "b": 1}}', len(room)) == REFUSED
    # They were taken as they came, and an answer was made of them.
    wrong = {
        "kp": 0,
        "setpoint_weight": 2,
        "pv_span": [9, 9],
        "acceptable": -1,
        "prior": 1,
        "positioner_dead_band": 101,
    }
    for name, value in wrong.items():
        assert asked(json.dumps({name: value}), len(room)) == REFUSED, name
        assert loaded.glapp_error().startswith(f"{name} = ".encode()), loaded.glapp_error()


@built
def test_a_message_is_told_as_in_python(loaded: ctypes.CDLL) -> None:
    room, needed = ctypes.create_string_buffer(500), ctypes.c_size_t()

    def asked(message: str, reader: str | None, size: int = len(room)) -> int:
        who = None if reader is None else reader.encode()
        return int(loaded.glapp_text(message.encode(), who, room, ctypes.c_size_t(size), ctypes.byref(needed)))

    numbers = {"d": 0.123, "floor": 0.5}
    message = json.dumps({"code": "crossings.noise", "numbers": numbers})
    assert asked(message, '{"op_unit": "mA"}') == OK, loaded.glapp_error()
    assert room.value.decode() == glapp._glapp.to_text("crossings.noise", numbers, op_unit="mA")
    assert needed.value == len(room.value) + 1
    assert asked(message, None) == OK and "OP units" in room.value.decode()
    assert asked(message, None, 10) == BAD_LENGTH and b"must have" in loaded.glapp_error()
    assert asked('{"code": "crossings.none"}', None) == REFUSED and b"no message" in loaded.glapp_error()
    assert asked("{", None) == REFUSED and asked(message, "1") == REFUSED


def test_every_key_of_a_task_is_explained() -> None:
    """The header sends its reader to docs/c.md for the keys, which did not have them."""
    rust = (ROOT / "crates/analysis/src/analysis.rs").read_text(encoding="utf-8")
    members = re.search(r"pub struct Task \{(.*?)\n\}", rust, re.DOTALL)
    assert members
    keys = re.findall(r"pub (\w+):", members[1])
    page = (ROOT / "docs/c.md").read_text(encoding="utf-8")
    table = page.split("| key | value |\n|---|---|\n")[1].split("\n\n")[0]
    explained = [key for line in table.splitlines() for key in re.findall(r"`(\w+)`", line.split("|")[1])]
    assert len(keys) > 10 and sorted(explained) == sorted(keys)


# Wrong input ----------------------------------------------------------------------------------------------------------


class Setting(ctypes.Structure):
    _fields_ = (("name", ctypes.c_char_p), ("value", ctypes.c_double))


def made(loaded: ctypes.CDLL, **settings: float) -> tuple[int, ctypes.c_void_p, str]:
    """The code, the handle and the text of a detector with these settings."""
    given = (Setting * max(len(settings), 1))(*(Setting(name.encode(), value) for name, value in settings.items()))
    handle = ctypes.c_void_p()
    done = loaded.glapp_detector_new(given, ctypes.c_size_t(len(settings)), ctypes.byref(handle))
    return done, handle, loaded.glapp_error().decode()


GOOD = {"k": 0.5, "ti": 10.0, "h": 1.0}
OK, BAD_POINTER, BAD_HANDLE, BAD_LENGTH, BAD_TEXT, REFUSED = 0, -1, -2, -3, -4, -5


@built
@pytest.mark.slow
def test_every_setting_of_the_catalogue_is_known(loaded: ctypes.CDLL) -> None:
    usual = {"td": 1.0, "b": 1.0, "kp": 2.0, "pv_span": 50.0, "tf": 1.0, "n": 9.0, "max_h": 3.0}
    usual |= {"op_low": 0.0, "op_high": 100.0, "op_span": 100.0}
    assert {s["name"] for s in CATALOGUE["settings"]["detector"]} == set(usual) | {"k", "ti"}
    done, handle, wrong = made(loaded, **GOOD, **usual, integrating=0.0, **dict.fromkeys(CATALOGUE["conditions"], 0.0))
    assert done == OK, wrong
    assert loaded.glapp_detector_free(handle) == OK
    assert loaded.glapp_abi() == 1
    assert loaded.glapp_version().decode() == glapp.__version__


@built
@pytest.mark.slow
@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"k": 0.5, "ti": 10.0}, "h: is missing"),
        (GOOD | {"ti": 0.0}, "ti = 0: must be greater than 0 s"),
        (GOOD | {"n": 4.0}, "n = 4: must be"),
        (GOOD | {"n": 4.5}, "n = 4.5: must be a whole number"),
        (GOOD | {"op_low": 0.0}, "op_high: is missing beside op_low"),
        (GOOD | {"op_low": 9.0, "op_high": 8.0}, "op_low = 9: must be a number below op_high"),
        (GOOD | {"too_short": 2.0}, "too_short = 2: must be 0 (no) or 1 (yes)"),
        (GOOD | {"h": math.inf}, "h = inf: must be greater than 0 s"),
        (GOOD | {"tI": 1.0}, "tI: there is no such setting of a detector"),
        ({"K": 0.5, "ti": 10.0, "h": 1.0}, "K: there is no such setting of a detector"),
    ],
)
def test_a_setting_that_is_refused_is_named(loaded: ctypes.CDLL, settings: dict[str, float], message: str) -> None:
    done, handle, wrong = made(loaded, **settings)
    assert done == REFUSED and handle.value is None
    assert wrong.startswith(message)


class Module(ctypes.Structure):
    _fields_ = (
        ("name", ctypes.c_char_p),
        ("kind", ctypes.c_char_p),
        ("settings", ctypes.POINTER(Setting)),
        ("count", ctypes.c_size_t),
    )


def graph(loaded: ctypes.CDLL, **settings: float) -> tuple[int, ctypes.c_void_p]:
    """The code and the handle of a graph of one `BacklashDetection` with these settings."""
    given = (Setting * len(settings))(*(Setting(name.encode(), value) for name, value in settings.items()))
    names = (b"sp", b"pv", b"op", b"flags")
    inputs = [Module(name, b"Input", None, 0) for name in names]
    modules = (Module * 5)(*inputs, Module(b"watch", b"BacklashDetection", given, len(settings)))
    wires = (ctypes.c_char_p * 4)(*(name + b" -> watch." + name for name in names))
    handle = ctypes.c_void_p()
    sized = modules, ctypes.c_size_t(5), wires, ctypes.c_size_t(4)
    return loaded.glapp_graph_new(ctypes.c_double(1.0), *sized, ctypes.byref(handle)), handle


def lagging(loaded: ctypes.CDLL) -> ctypes.c_void_p:
    """A graph of a lag of 50 000 s behind an input of 1: each scan moves it by other bits."""
    given = (Setting * 2)(Setting(b"gain", 1.0), Setting(b"t1", 5e4))
    lag = Module(b"lag", b"ProcessSim", given, 2)
    modules = (Module * 3)(Module(b"x", b"Input", None, 0), lag, Module(b"out", b"Output", None, 0))
    wires = (ctypes.c_char_p * 2)(b"x -> lag", b"lag -> out")
    handle = ctypes.c_void_p()
    sized = (modules, ctypes.c_size_t(3), wires, ctypes.c_size_t(2))
    done = loaded.glapp_graph_new(ctypes.c_double(1.0), *sized, ctypes.byref(handle))
    assert done == OK, loaded.glapp_error()
    assert loaded.glapp_graph_set(handle, b"x.value", ctypes.c_double(1.0)) == OK
    return handle


@built
@pytest.mark.slow
def test_calls_of_several_threads_wait_for_each_other(loaded: ctypes.CDLL) -> None:
    """No scan is lost, handles do not disturb each other, and the text is that of the thread's own failure."""
    scans = 4000

    def scan(handle: ctypes.c_void_p, times: int, wrong: str) -> tuple[set[int], str]:
        codes = {loaded.glapp_graph_scan(handle, ctypes.c_double(1.0)) for _ in range(times)}
        assert loaded.glapp_graph_set(handle, wrong.encode(), ctypes.c_double(0.0)) < 0
        return codes, loaded.glapp_error().decode()

    def value(handle: ctypes.c_void_p) -> float:
        shown = ctypes.c_double()
        assert loaded.glapp_graph_get(handle, b"out.value", ctypes.byref(shown)) == OK, loaded.glapp_error()
        return shown.value

    alone, shared, apart = lagging(loaded), lagging(loaded), [lagging(loaded) for _ in range(4)]
    scan(alone, scans, "none.value")
    # ctypes lets the other threads run during a call.
    with ThreadPoolExecutor(4) as pool:
        names = [f"nobody{number}.value" for number in range(8)]
        done = pool.map(scan, [shared] * 4 + apart, [scans // 4] * 4 + [scans] * 4, names)
        for name, (codes, error) in zip(names, done, strict=True):
            assert codes == {OK}
            assert name.split(".")[0] in error
    assert 0.0 < value(alone) < 1.0
    assert [value(one) for one in (shared, *apart)] == [value(alone)] * 5


@built
@pytest.mark.slow
@pytest.mark.parametrize("name", ["size", "share", "limit", "band", "tf", "rate", "release", "watch", "travel"])
def test_no_setting_of_the_compensation_is_taken_beyond_its_bounds(loaded: ctypes.CDLL, name: str) -> None:
    """`comp_release` had no upper bound, so that u_FF stayed for good."""
    words = {row["name"]: row["bound"] for row in CATALOGUE["settings"]["compensation"]}[name]
    usual = {"k": 0.5, "ti": 5.0, "op_low": 0.0, "op_high": 100.0, "comp_size": 2.0, "comp_limit": 3.0}
    done, there = graph(loaded, **usual)
    assert done == OK, loaded.glapp_error()
    path, now, value = f"watch.comp_{name}".encode(), ctypes.c_double(), ctypes.c_double()
    assert loaded.glapp_graph_get(there, path, ctypes.byref(now)) == OK
    for wrong in (1e38, -1.0, math.nan, math.inf):
        assert graph(loaded, **usual | {f"comp_{name}": wrong})[0] == REFUSED
        assert words in loaded.glapp_error().decode()
        assert loaded.glapp_graph_set(there, path, ctypes.c_double(wrong)) == REFUSED
        assert words in loaded.glapp_error().decode()
        assert loaded.glapp_graph_get(there, path, ctypes.byref(value)) == OK
        assert repr(value.value) == repr(now.value)
    assert loaded.glapp_graph_free(there) == OK


@built
@pytest.mark.slow
def test_a_wrong_pointer_is_refused_and_not_followed(loaded: ctypes.CDLL) -> None:
    _, handle, _ = made(loaded, **GOOD)
    number, size = ctypes.c_double, ctypes.c_size_t
    sample = (number(0.0), number(1.0), number(1.0), None, ctypes.c_uint32(0))
    room = ctypes.create_string_buffer(512)
    at = ctypes.addressof(room)
    aligned = at + -at % 8
    update, fit = loaded.glapp_detector_update, loaded.glapp_fit
    assert update(handle, *sample, ctypes.c_void_p(aligned)) == OK
    assert update(handle, *sample, None) == BAD_POINTER
    assert loaded.glapp_error() == b"ended: is NULL"
    assert update(handle, *sample, ctypes.c_void_p(aligned + 1)) == BAD_POINTER
    assert loaded.glapp_error() == b"ended: does not lie as its type asks"
    assert update(handle, *sample[:-1], ctypes.c_uint32(16), ctypes.c_void_p(aligned)) == REFUSED
    assert loaded.glapp_detector_new(None, size(1), ctypes.byref(handle)) == BAD_POINTER
    one = Setting(b"k", 1.0)
    assert loaded.glapp_detector_new(ctypes.byref(one), size(2**64 - 1), ctypes.byref(handle)) == BAD_LENGTH
    assert loaded.glapp_error() == b"settings: no array has 18446744073709551615 elements"
    assert fit(None, number(0.0), ctypes.c_void_p(aligned)) == BAD_POINTER
    for text in (b"\xff", b"k" * 4096):
        long = Setting(text, 1.0)
        assert loaded.glapp_detector_new(ctypes.byref(long), size(1), ctypes.byref(handle)) == BAD_TEXT


@built
@pytest.mark.slow
def test_a_handle_that_is_none_is_refused(loaded: ctypes.CDLL) -> None:
    _, handle, _ = made(loaded, **GOOD)
    assert loaded.glapp_graph_scan(handle, ctypes.c_double(1.0)) == BAD_HANDLE
    assert loaded.glapp_error() == b"graph: the handle was never given, is of another kind, or was freed"
    assert loaded.glapp_detector_free(handle) == OK
    assert loaded.glapp_detector_free(handle) == BAD_HANDLE
    assert loaded.glapp_detector_free(None) == BAD_HANDLE
    assert loaded.glapp_error() == b"detector: the handle is NULL"
    assert loaded.glapp_detector_free(ctypes.c_void_p(0xDEADBEEF)) == BAD_HANDLE
    assert made(loaded, **GOOD)[1].value != handle.value
