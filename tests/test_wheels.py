"""The programs that build and try the wheels report errors, and go on."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest


@pytest.fixture(scope="module")
def build() -> ModuleType:
    spec = importlib.util.spec_from_file_location("wheels_build", Path(__file__).parents[1] / "wheels/build.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # its classes ask for it by its name
    spec.loader.exec_module(module)
    return module


def test_a_command_that_fails_is_told_with_all_that_it_said(build: ModuleType, tmp_path: Path) -> None:
    script = "import sys; print(sys.stdin.read(), 'begun'); sys.exit('a DLL lacks')"
    with pytest.raises(AssertionError, match=r"ended with 1\s+begun\s+a DLL lacks"):
        build.run([sys.executable, "-c", script], tmp_path, {})
    assert build.run([sys.executable, "-c", "print('here')"], tmp_path, {}) == "here\n"


def test_widths_may_differ_in_their_last_digits_and_nothing_else_may(build: ModuleType) -> None:
    one = ("FIC201", "backlash", 2.4)
    assert build.alike(one, ("FIC201", "backlash", 2.4 * (1 + 5e-4)))
    assert not build.alike(one, ("FIC201", "backlash", 2.41))
    assert not build.alike(one, ("FIC201", "both", 2.4))
    assert not build.alike(one, ("FIC201", "backlash", None))
    assert build.alike(("TIC118", "cannot_tell", None), ("TIC118", "cannot_tell", None))


def test_what_is_lacking_skips_a_platform_and_a_wrong_answer_fails(
    build: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = []

    def built(of: object, folder: Path) -> Path:
        if of is build.PLATFORMS["macos-arm64"]:
            raise build.Missing("the linker")
        (folder / "one.whl").touch()
        return folder / "one.whl"

    def tried(wheel: Path, under: list[str], rows: int | None) -> str:
        asked.append((wheel.name, under, rows))
        raise AssertionError("another width")

    monkeypatch.setattr(build, "built", built)
    monkeypatch.setattr(build, "tried", tried)
    monkeypatch.setattr(build.platform, "machine", lambda: "x86_64")
    monkeypatch.setattr(build.platform, "system", lambda: "Linux")

    def ended(*words: str) -> tuple[int, str]:
        monkeypatch.setattr(sys, "argv", ["build.py", str(tmp_path), *words])
        return build.main(), capsys.readouterr().out

    assert ended("macos-arm64") == (0, "macos-arm64: skipped, this machine lacks the linker\n")
    assert ended("musl-aarch64") == (0, "musl-aarch64: one.whl, 0.0 MB; not tried: it runs on another machine\n")
    # An emulated processor analyses the beginning of each recording, an emulated system all of it.
    for name, rows in (("windows-x86_64", None), ("linux-aarch64", build.FIRST)):
        code, printed = ended(name, "--under", "emulator 'a python'")
        assert code == 1 and printed.endswith("WRONG: another width\n")
        assert asked.pop() == ("one.whl", ["emulator", "a python"], rows)
