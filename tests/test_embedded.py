"""The library for microcontrollers: its example gives the same bits on a Cortex-M4 in QEMU and on this machine."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
HERE = ROOT / "crates/embedded"
TARGET = "thumbv7em-none-eabihf"
CORE = ("-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16")
FLAGS = ("-Os", "-ffp-contract=off", f"-I{HERE / 'include'}")
BARE = ("-ffreestanding", "-nostdlib", "-nostartfiles", "-Wl,--gc-sections", "-Wl,-z,noexecstack")
LARGEST = 40_000
"""Bytes of code and constants of the example in one precision."""

pytestmark = [pytest.mark.verify, pytest.mark.slow]


def run(*command: object, folder: Path = ROOT) -> str:
    done = subprocess.run([*map(str, command)], cwd=folder, capture_output=True, text=True, timeout=900)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def library(*target: str) -> Path:
    run(
        "cargo",
        "rustc",
        "--quiet",
        "--profile",
        "embedded",
        "-p",
        "glapp-embedded",
        "--crate-type",
        "staticlib",
        *target,
    )
    return ROOT / "target" / (target[1] if target else "") / "embedded" / "libglapp_embedded.a"


@pytest.fixture(scope="module")
def bare() -> Path:
    """The library for the microcontroller."""
    folder = subprocess.run(["rustc", "--print", "target-libdir", "--target", TARGET], capture_output=True, text=True)
    lacks = [name for name in ("arm-none-eabi-gcc", "arm-none-eabi-size", "qemu-system-arm") if not shutil.which(name)]
    if folder.returncode or not Path(folder.stdout.strip()).is_dir():
        lacks.append(f"Rust's library for {TARGET} (rustup target add {TARGET})")
    if lacks:
        pytest.skip(f"the library for microcontrollers: this machine lacks {', '.join(lacks)}")
    return library("--target", TARGET)


def built(source: Path, bare: Path, out: Path) -> Path:
    """The example for the microcontroller."""
    more = (HERE / "example/cortex_m4.c", bare, "-lgcc", "-o", out)
    run("arm-none-eabi-gcc", *CORE, *FLAGS, *BARE, "-T", HERE / "example/mps2.ld", source, *more)
    return out


def emulated(program: Path) -> str:
    """Output of the emulated program."""
    board = ("-M", "mps2-an386", "-display", "none", "-monitor", "none", "-serial", "none", "-chardev", "stdio,id=out")
    semihosting = "enable=on,target=native,chardev=out"
    return run("qemu-system-arm", *board, "-semihosting-config", semihosting, "-kernel", program)


def test_it_gives_the_same_bits_as_on_this_machine(bare, tmp_path):
    here = tmp_path / "loop"
    sources = (HERE / "example/loop.c", HERE / "example/pc.c")
    run("cc", *FLAGS, *sources, library(), "-lm", "-lpthread", "-ldl", "-o", here)
    shown = run(here)
    assert re.findall(r"shown (\d), width in hundredths (\d+)", shown) == [("1", "197"), ("1", "196")], shown
    assert re.findall(r"standing (\d+)", shown) == ["0", "0"] and shown.endswith("done\n")
    assert emulated(built(HERE / "example/loop.c", bare, tmp_path / "loop.elf")) == shown


@pytest.mark.parametrize(("precision", "other"), [("f32", "double, f64"), ("f64", "float, f32")])
def test_it_is_small(bare, tmp_path, precision, other):
    """The size includes detector, compensation and PID in one precision, and the loop around them."""
    text = (HERE / "example/loop.c").read_text()
    gone = other.split(", ")[1]
    for line, instead in ((f"RUN({other})\n", ""), (f"run_{gone}()", "0")):
        assert line in text
        text = text.replace(line, instead)
    (tmp_path / "one.c").write_text(text)
    program = built(tmp_path / "one.c", bare, tmp_path / "one.elf")
    size = int(run("arm-none-eabi-size", program).splitlines()[1].split()[0])
    assert size < LARGEST, size
    assert emulated(program).endswith("done\n")
