"""Files of the command line are written whole or not at all, and never over a recording."""

import errno
import os
import re
import stat
import subprocess
import sys
from pathlib import Path
from zoneinfo import ZoneInfo

import numpy as np
import pytest

import glapp.cli
import glapp.cli.work
from glapp import blocks
from glapp.errors import InputError
from glapp.loop import Loop
from glapp.reading import open_recordings
from glapp.writing import write_file

GLAPP = (sys.executable, "-c", "from glapp.cli import main; main()")
SETTINGS = ("--no-fit", "--k", 0.8, "--ti", 25)


@pytest.fixture
def run(run, monkeypatch, tmp_path):
    """Run a command line in a folder with two recordings."""
    monkeypatch.chdir(tmp_path)
    t = np.arange(300)
    pv = 50 + np.sin(t / 17)
    text = "t,SP,PV,OP\n" + "".join(f"{k},50,{y:.4f},{55 + 0.8 * (50 - y):.4f}\n" for k, y in zip(t, pv, strict=True))
    for name in ("a.csv", "b.csv"):
        Path(name).write_text(text)
    return run


def contents():
    return {path: path.read_bytes() for path in sorted(Path().iterdir())}


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("analyze", "--no-fit", "--csv", "a.csv", "b.csv"), "--csv: 'a.csv' exists, is not a table that glapp wrote"),
        (("analyze", "--no-fit", "--report", "a.csv", "b.csv"), "--report: 'a.csv' exists, is not a page"),
        (("analyze", "a.csv", "--csv", "a.csv"), "--csv: 'a.csv' is read by this command"),
        (("analyze", "a.csv", "--csv", "hard.csv"), "--csv: 'hard.csv' is read by this command"),
        (("analyze", "a.csv", "--report", "soft.html"), "--report: 'soft.html' is read by this command"),
        (("analyze", "a.csv", "--report", "../{here}/a.csv"), "is read by this command"),
        (("analyze", "loops.toml", "--csv", "a.csv"), "--csv: 'a.csv' is read by this command"),
        (("analyze", "loops.toml", "--loop", "B", "--csv", "a.csv"), "--csv: 'a.csv' is read by this command"),
        (("analyze", "loops.toml", "--report", "loops.toml"), "--report: 'loops.toml' is read by this command"),
        (("analyze", "b.csv", "--report", "x", "--csv", "x"), "--report: 'x' is read by this command"),
        (("step-test", "a.csv", "--plot", "a.csv"), "--plot: 'a.csv' is read by this command"),
        (("step-test", "a.csv", "--plot", "b.csv"), "--plot: 'b.csv' exists, is not a page"),
        (("init", "a.csv", "-o", "a.csv", "--force"), "--output: 'a.csv' is read by this command"),
        (("thesis", "1.2", "--out", ".", "--markdown"), "--out: 'README.md' exists, is not a page"),
        (("analyze", "a.csv", "--csv", "."), "--csv: '.' is a folder"),
    ],
)
def test_no_input_and_nothing_foreign_is_overwritten(run, words, message):
    """The shell writes all names in place of *: `--csv *.csv` put the table over the first recording."""
    os.link("a.csv", "hard.csv")
    Path("soft.html").symlink_to("a.csv")
    Path("loops.toml").write_text('[loops.A]\nfile = "a.csv"\n[loops.B]\nfile = "b.csv"\n')
    Path("README.md").write_text("# Mine\n")
    before = contents()
    code, out, err = run(*(word.format(here=Path.cwd().name) for word in words))
    assert (code, out) == (2, "")
    assert message in err
    assert contents() == before


@pytest.mark.slow
def test_what_glapp_wrote_is_overwritten(run):
    for _ in range(2):
        code, _, err = run("analyze", *SETTINGS, "a.csv", "--csv", "t.csv", "--report", "r.html")
        assert (code, err) == (0, "")
    assert Path("t.csv").read_text().startswith("loop,file,answer_verdict,")
    assert sorted(p.name for p in Path().iterdir()) == ["a.csv", "b.csv", "r.html", "t.csv"]


@pytest.mark.slow
def test_demo_spares_a_loops_toml_that_is_not_its_own(run):
    Path("loops.toml").write_text("# mine\n")
    before = contents()
    code, _, err = run("demo", ".")
    assert (code, "loops.toml: exists already and holds something else" in err) == (1, True)
    assert contents() == before
    for words in (("demo", ".", "--force"), ("demo", ".")):
        assert run(*words)[0] == 0
    assert "[loops.FIC201]" in Path("loops.toml").read_text()


@pytest.mark.slow
def test_a_report_that_cannot_be_written_leaves_the_old_one_and_the_answers(run, monkeypatch):
    """A full disk left half a report in place of the old one."""
    assert run("analyze", *SETTINGS, "a.csv", "--report", "r.html")[0] == 0
    before = contents()

    def full(_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("glapp.writing.os.fsync", full)
    code, out, err = run("analyze", *SETTINGS, "a.csv", "--report", "r.html", "--csv", "t.csv")
    assert code == 1
    assert out.startswith("a  no estimate")
    assert "error: r.html: cannot be written: No space left on device" in err
    assert "error: t.csv: cannot be written: No space left on device" in err
    assert contents() == before


@pytest.mark.skipif(sys.platform == "win32", reason="limits of a process are POSIX")
@pytest.mark.slow
def test_a_file_is_whole_or_as_it_was(tmp_path):
    path = tmp_path / "report.html"
    path.write_text("old")
    code = (
        "import resource, signal, sys; from pathlib import Path; from glapp.writing import write_file\n"
        "signal.signal(signal.SIGXFSZ, signal.SIG_IGN); resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))\n"
        "try:\n    write_file(Path(sys.argv[1]), 'x' * 5000)\nexcept OSError as error:\n    print(error.strerror)"
    )
    done = subprocess.run([sys.executable, "-c", code, path], capture_output=True, text=True)
    assert (done.stdout, done.stderr) == ("File too large\n", "")
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.skipif(sys.platform == "win32", reason="permissions and links are POSIX")
def test_permissions_links_and_devices_stay(tmp_path):
    real, link = tmp_path / "real.html", tmp_path / "link.html"
    real.write_text("old")
    real.chmod(0o640)
    link.symlink_to(real)
    write_file(link, "new")
    assert link.is_symlink() and real.read_text() == "new"
    assert stat.S_IMODE(real.stat().st_mode) == 0o640
    write_file(tmp_path / "fresh.html", b"new")
    plain = tmp_path / "plain"
    plain.touch()
    assert (tmp_path / "fresh.html").stat().st_mode == plain.stat().st_mode
    write_file(Path(os.devnull), "nothing")
    assert not Path(os.devnull).is_file()


@pytest.mark.verify
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full")
@pytest.mark.parametrize("words", [("--version",), ("--help",), ("analyze", "--json"), ("analyze",), ("init",)])
def test_a_full_standard_output_is_one_line(run, words):
    command = [*GLAPP, *words]
    if words[0] == "analyze":
        command += [*map(str, SETTINGS), "a.csv", "--report", "r.html"]
    elif words[0] == "init":
        command += ["a.csv"]
    with Path("/dev/full").open("w") as full:
        ended = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True)
    assert ended.returncode == 1
    assert ended.stderr == "error: standard output cannot be written: No space left on device\n"
    assert words[0] != "analyze" or Path("r.html").stat().st_size > 0


def test_an_unforeseen_fault_refuses_one_loop(run, monkeypatch):
    """Any other exception took the answers of all loops with it."""
    real = glapp.cli.work.analyze

    def broken(recording, **how):
        """An analysis that fails for loop a."""
        if recording.name == "a":
            raise KeyError("x")
        return real(recording, **how)

    monkeypatch.setattr("glapp.cli.work.analyze", broken)
    Path("loops.toml").write_text(
        '[defaults.controller]\nk = 0.8\nti = 25\n[loops.a]\nfile = "a.csv"\n[loops.b]\nfile = "b.csv"\n'
    )
    code, out, err = run("analyze", "--no-fit", "loops.toml", "--csv", "-")
    assert code == 1
    rows = [line.split(",")[:3] for line in out.splitlines()]
    assert rows[1] == ["a", "a.csv", "refused"]
    assert rows[2][0] == "b" and rows[2][2] != "refused"
    assert "a.csv, loop a: KeyError: 'x' (in test_cli_files.py, line" in err
    assert "a fault in glapp, please report it" in err


def test_numbers_that_no_machine_holds(run):
    """n = 9223372036854775807 was a traceback."""
    Path("loops.toml").write_text('[loops.a]\nfile = "a.csv"\nn = 9223372036854775807\n')
    code, _, err = run("analyze", "--no-fit", "loops.toml")
    assert (code, err) == (1, "error: loops.toml, loop a, n: is 9223372036854775807, must be ≤ 31\n")
    assert run("analyze", "--no-fit", "a.csv", "--n", 9223372036854775807)[0] == 2
    with pytest.raises(InputError, match="sample_time: is 1e\\+308, must be ≤ 1e\\+07"):
        Loop(name="a", sample_time=1e308)


def test_the_bound_of_n_is_that_of_the_core():
    assert Loop(name="a", n=31).n == 31
    blocks.MedianMean(31)
    for made in (lambda n: Loop(name="a", n=n), blocks.MedianMean):
        with pytest.raises(ValueError, match="31"):
            made(33)


@pytest.mark.slow
def test_zones_need_no_database_of_the_system(tmp_path):
    """Windows and bare containers have none; Arrow looked for one and said that 10:00 does not exist."""
    path = tmp_path / "a.csv"
    path.write_text("t,SP,PV\n2026-10-25 02:30:00,1,1\n2026-10-25 02:00:00,1,2\n2026-10-25 03:30:00,1,2\n")
    code = (
        "import sys, zoneinfo; zoneinfo.reset_tzpath(to=[]); zoneinfo.ZoneInfo.clear_cache()\n"
        "import pyarrow.compute; pyarrow.compute.assume_timezone = None\n"
        "from glapp.loop import Loop; from glapp.reading import open_recordings\n"
        "[r] = open_recordings(sys.argv[1], [Loop(name='a', time_zone='Europe/Stockholm')])\n"
        "print([b.t.tolist() for b in r.batches()])"
    )
    done = subprocess.run([sys.executable, "-c", code, path], capture_output=True, text=True)
    assert (done.stdout, done.stderr) == ("[[0.0, 1800.0, 7200.0]]\n", "")


def test_a_zone_that_is_unknown(monkeypatch):
    with pytest.raises(InputError, match=r"time_zone: is 'Mars/Base', must be an IANA time zone"):
        Loop(name="a", time_zone="Mars/Base")
    monkeypatch.setattr("glapp.loop.available_timezones", set)
    with pytest.raises(InputError, match="no time zones at all: pip install tzdata"):
        Loop(name="a", time_zone="Mars/Base")


def test_summer_time_beyond_2037(tmp_path):
    """Arrow's own zones end there, and an hour was missing in every summer after it."""
    path = tmp_path / "a.csv"
    path.write_text("t,SP,PV\n2038-01-01 12:00:00,1,1\n2040-07-01 12:00:00,1,2\n")
    [recording] = open_recordings(path, [Loop(name="a", time_zone="Europe/Stockholm")])
    [batch] = recording.batches()
    zone = ZoneInfo("Europe/Stockholm")
    begin, end = (np.datetime64(x).item().replace(tzinfo=zone) for x in ("2038-01-01T12:00:00", "2040-07-01T12:00:00"))
    assert batch.t[1] == end.timestamp() - begin.timestamp()


def test_a_file_that_cannot_be_written_is_named_and_not_standard_output(tmp_path: Path) -> None:
    """Regression: `glapp watch login` on a home that is not ours said that standard output cannot be written."""
    (tmp_path / "state").write_text("no folder")
    code = (
        "import sys, glapp.cli; sys.modules['glapp.cli.watch']._token_of = lambda *_: 'token'; "
        "sys.argv = ['glapp', 'watch', 'login', 'eve']; sys.modules['glapp.cli'].main()"
    )
    ended = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        env={**os.environ, "XDG_STATE_HOME": str(tmp_path / "state")},
        timeout=120,
    )
    assert ended.returncode == 1 and "Traceback" not in ended.stderr
    assert re.match(r"error: .*state.*: cannot be read or written: ", ended.stderr), ended.stderr
