"""The command line as a person types it: its output, its end, and that one wrong loop stops no other."""

import csv
import html
import inspect
import io
import json
import os
import re
import shlex
import subprocess
import sys
from datetime import UTC, datetime
from pathlib import Path
from zoneinfo import ZoneInfo

import jsonschema_rs
import numpy as np
import pytest
import typer
from rich.cells import cell_len

import glapp.cli.work
from glapp.cli import app, screen
from glapp.cli.explain import _seconds
from glapp.cli.screen import CommandError
from glapp.document import to_schema
from glapp.reading import open_each, open_recordings
from glapp.reading.settings import read_settings
from glapp.recording import NOT_AUTO, Recording
from glapp.report.words import clock

ROOT = Path(__file__).parents[1]
REFINERY = ROOT.parent / "shared/data/refinery"
GLAPP = (sys.executable, Path(__file__).parent / "command_line.py")


@pytest.fixture
def run(run, monkeypatch, tmp_path):
    """Run a command line in an empty folder."""
    monkeypatch.chdir(tmp_path)
    return run


def answering(monkeypatch, *lines):
    """Somebody sits at the terminal and types these lines."""
    monkeypatch.setattr(sys.modules["glapp.cli.analyze"], "can_ask", lambda: True)
    monkeypatch.setattr("sys.stdin", io.StringIO("".join(f"{line}\n" for line in lines)))


@pytest.mark.slow
def test_a_person_chooses_the_columns_and_they_are_written(run, monkeypatch):
    write("plant.csv", rows(header="a,b,c,d"))
    code, _, printed = run("analyze", "plant.csv", "--no-fit")
    assert code == 1 and "name them: --pv NAME --op NAME, or in loops.toml columns = { pv =" in printed
    answering(monkeypatch, "1", "7", "3", "4", "2")
    code, shown, printed = run("analyze", "plant.csv", "--no-fit")
    assert code == 0 and "plant" in shown
    assert "Which column is PV?" in printed and "a number from 1 to 4" in printed and "Wrote loops.toml" in printed
    [loop] = read_settings("loops.toml")
    assert (loop.columns.time, loop.columns.pv, loop.columns.op, loop.columns.sp) == ("a", "c", "d", "b")
    assert run("analyze", "loops.toml", "--no-fit")[0] == 0


@pytest.mark.slow
def test_a_person_says_which_number_is_the_day(run, monkeypatch):
    write("plant.csv", rows(time=lambda k: f"03/04/2026 10:{k // 60:02d}:{k % 60:02d}"))
    code, _, printed = run("analyze", "plant.csv", "--no-fit")
    assert code == 1 and "--time-format 'day first'" in printed and 'time_format = "day first"' in printed
    answering(monkeypatch, "2")
    assert run("analyze", "plant.csv", "--no-fit")[0] == 0
    assert read_settings("loops.toml")[0].time_format == "month first"


@pytest.mark.slow
def test_a_person_says_what_a_number_of_days_counts_from(run, monkeypatch):
    write("plant.csv", rows(time=lambda k: f"{60000 + k / 86400:.7f}"))
    code, _, printed = run("analyze", "plant.csv", "--no-fit")
    assert code == 1 and "looks like a day number, but of which calendar?" in printed
    answering(monkeypatch, "6")
    assert run("analyze", "plant.csv", "--no-fit")[0] == 0
    assert read_settings("loops.toml")[0].time_format == "excel"


@pytest.mark.slow
def test_signals_that_are_not_read_are_listed_with_the_option_to_add(run):
    """Regression: SP and MODE whose names show another loop were lost without a word."""
    write("plant.csv", rows(header="t,[A]F1.SP,F1.PV,F1.OP"))
    code, _, printed = run("analyze", "plant.csv", "--report", "r.html")
    said = "SP is not read, and may be in the column [A]F1.SP: if so, write --sp '[A]F1.SP', or in loops.toml"
    assert code == 0 and f"note: F1: {said}" in printed
    page = html.unescape(Path("r.html").read_text(encoding="utf-8"))
    assert said in page and "time = t, PV = F1.PV, OP = F1.OP" in page
    _, shown, _ = run("analyze", "plant.csv", "--no-fit", "--json")
    [loop] = json.loads(shown)["loops"]
    assert [text.startswith(said) for text in loop["left_out"]] == [True], "the document did not say so"
    _, _, printed = run("analyze", "plant.csv", "--no-fit", "--sp", "[A]F1.SP")
    assert "not read" not in printed
    names = [f"{one}{n}.{role}" for n in range(5) for one, role in (("F", "PV"), ("F", "OP"), ("[A]F", "SP"))]
    lines = [",".join([str(k), *["50", "40", "60"] * 5]) for k in range(20)]
    write("many.csv", "\n".join([",".join(["t", *names]), *lines]))
    _, _, printed = run("analyze", "many.csv", "--no-fit")
    assert printed.count("SP is not read") == 3 and "note: 2 more signals are not read" in printed


def test_without_an_answer_to_the_question_the_error_names_the_options(run, monkeypatch):
    write("plant.csv", rows(header="a,b,c,d"))
    answering(monkeypatch)
    code, _, printed = run("analyze", "plant.csv", "--no-fit")
    assert code == 1 and "name them: --pv NAME --op NAME" in printed and not Path("loops.toml").exists()


def test_init_takes_the_column_options_of_analyze(run):
    write("plant.csv", rows(header="a,b,c,d"))
    code, text, printed = run("init", "plant.csv", "--pv", "c", "--op", "d", "--sp", "b", "--sample-time", 2)
    assert code == 0, printed
    write("loops.toml", text)
    [loop] = read_settings("loops.toml")
    assert (loop.columns.pv, loop.sample_time) == ("c", 2.0)


def rows(n=600, header="t,SP,PV,OP", time=str, pv=lambda k, value: value):
    """A PI loop (K = 0.8, Ti = 25 s) around 50, one row a second."""
    lines, integral = [header], 0.0
    for k in range(n):
        y = 50 + np.sin(k / 17) + 0.3 * np.sin(k / 5)
        integral += 0.8 / 25 * (50 - y)
        lines.append(f"{time(k)},50,{pv(k, f'{y:.4f}')},{55 + 0.8 * (50 - y) + integral:.4f}")
    return "\n".join(lines) + "\n"


def write(name, text):
    Path(name).write_text(text)


@pytest.fixture(scope="module")
def demo(tmp_path_factory):
    from glapp.demo import write_recordings

    return write_recordings(tmp_path_factory.mktemp("demo"))[-1]


def documented_commands(run):
    """Every command line in the help, in docs/cli.md, docs/start.md and docs/score.md."""
    helps = "".join(
        run(*command, "--help")[1]
        for command in ([], ["analyze"], ["init"], ["identify"], ["explain"], ["step-test"], ["demo"], ["thesis"])
    )
    pages = "".join((ROOT / page).read_text() for page in ("docs/cli.md", "docs/start.md", "docs/score.md"))
    fences = re.findall(r"^```(\w*)\n(.*?)^```", pages, re.DOTALL | re.MULTILINE)
    blocks = "".join(text for language, text in fences if not language)
    return list(dict.fromkeys(line.strip() for line in re.findall(r"^ ?(glapp .*)$", helps + blocks, re.MULTILINE)))


@pytest.mark.verify
@pytest.mark.xdist_group("demonstration")
def test_every_documented_command_does_what_it_says(run, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    commands = documented_commands(run)
    assert len(commands) > 15
    begin = np.datetime64("2026-03-01T12:00:00")
    plant = rows(1800, "t,SP,PV,CO", time=lambda k: str(begin + 4 * k).replace("T", " "))
    settings = '[loops.FIC101]\nfile = "plant.csv"\n[loops.FIC102]\nfile = "plant.csv"\n'
    for line in commands:
        for old in Path().glob("*.*"):
            old.unlink()
        write("plant.csv", plant)
        for day in ("monday", "tuesday", "wednesday"):
            write(f"{day}.csv", plant)
        if " -o loops.toml" not in line:
            write("loops.toml", settings)
        if "labels.csv" in line:
            write("labels.csv", "file,loop,found,width,unit,date\nplant.csv,,other,,,2026-04-02\n")
        words = [
            w
            for word in shlex.split(line.split(" >")[0])[1:]
            for w in (sorted(Path().glob(word)) if "*" in word else [word])
        ]
        code, out, err = run(*words)
        assert code == 0, (line, err)
        assert out or err, line
        for file in ("report.html", "demo.html", "test.html", "loops.csv"):
            assert file not in line or Path(file).stat().st_size > 0, line


@pytest.fixture
def by_hand():
    """A step test of a valve with a gap of 2 %OP on a process of Kp = 0.8, as text with a mode column."""
    moves = [(0, 100, 50.0), (100, 200, 53.0), (200, 300, 56.0), (300, 400, 52.0)]
    s = glapp.simulate.closed_loop(
        ([0.8], [5, 1], 0),
        (0.5, 10, 0, 0),
        d=2.0,
        h=1.0,
        t_end=400,
        manual=moves,
        setpoint=[(0, 40.0)],
        filter_in_loop=True,
    )
    return "t,SP,PV,OP,MODE\n" + "".join(f"{k},40,{s.pv[k]:.3f},{s.op[k]:g},MAN\n" for k in range(400))


@pytest.mark.slow
def test_step_test_shows_the_gap_each_reading_and_a_picture(run, by_hand):
    write("test.csv", by_hand)
    code, out, err = run("step-test", "test.csv", "--plot", "test.html")
    assert (code, err) == (0, "")
    gap, low, high = map(float, re.search(r"Gap d +([\d.]+)\s%OP +\(95 %: ([\d.]+) to ([\d.]+)\s%OP", out).groups())
    assert low <= gap <= high and 1.97 < low <= 2.0 <= high < 2.03
    assert re.search(r"53 → 56 +.* Kp 0\.\d+ .* ΔPV/ΔOP", out)
    assert re.search(r"56 → 52 +.* d [12]\.\d+ ", out)
    assert "first move" in out
    assert "PV after a reversal" in Path("test.html").read_text()
    code, out, _ = run("step-test", "test.csv", "--json")
    answer = json.loads(out)
    assert code == 0
    assert answer["low"] < 2.0 < answer["high"]
    assert [reading["kind"] for reading in answer["readings"]] == ["none", "gain", "gap"]


@pytest.mark.slow
def test_step_test_refuses_with_the_reason_and_what_to_do(run, by_hand):
    lines = by_hand.splitlines()
    write("short.csv", "\n".join(lines[:301]) + "\n")
    code, out, err = run("step-test", "short.csv")
    assert code == 1
    assert "error: short.csv, loop short: OP never reverses after a move that PV answered; step it back" in err
    assert "Kp" in out
    without = "\n".join(line.rsplit(",", 1)[0] for line in lines) + "\n"
    write("plain.csv", without)
    assert "say --manual" in run("step-test", "plain.csv")[2]
    assert run("step-test", "plain.csv", "--manual")[0] == 0
    write("test.csv", by_hand)
    code, _, err = run("step-test", "test.csv", "--manual")
    assert (code, "column MODE, manual: is for recordings without a mode column" in err) == (1, True)
    assert run("step-test", "test.csv", "--plot", "none/x.html")[0] == 2


def test_no_help_is_torn():
    """Line breaks of a second paragraph are kept: at another width they stand in the middle of a line."""

    def torn(command, path):
        paragraphs = inspect.cleandoc(command.help or "").split("\n\n")[1:]
        found = [path for text in paragraphs if "\n" in text and not text.startswith("[cyan]")]
        below = getattr(command, "commands", {})
        return found + [one for name, sub in below.items() for one in torn(sub, f"{path} {name}")]

    assert torn(typer.main.get_command(app), "glapp") == []


def test_help_tells_the_exit_codes(run):
    text = run("--help")[1]
    assert all(part in text for part in ("Exit codes", "0 every", "1 at least", "2 the command"))


@pytest.mark.slow
def test_step_test_takes_many_files(run, by_hand):
    for name in ("north.csv", "south.csv"):
        write(name, by_hand)
    write("short.csv", "\n".join(by_hand.splitlines()[:301]) + "\n")
    code, out, err = run("step-test", "north.csv", "south.csv", "short.csv", "none.csv", "--plot", "tests.html")
    assert code == 1
    assert [line for line in out.splitlines() if line.endswith(".csv)")] == [
        f"{name}  ({name}.csv)" for name in ("north", "south", "short")
    ]
    assert err.splitlines()[0] == "error: none.csv: no such file" and "short.csv, loop short: OP never" in err
    assert Path("tests.html").read_text().count("PV after a reversal") == 2
    code, out, _ = run("step-test", "north.csv", "south.csv", "--json")
    assert code == 0 and [test["name"] for test in json.loads(out)["tests"]] == ["north", "south"]


@pytest.mark.parametrize("columns", [60, 80, 120])
@pytest.mark.slow
def test_no_header_is_left_out_on_any_screen(run, monkeypatch, columns, by_hand):
    """Regression: a narrow table had only some of the headers."""
    write("FIC101.csv", rows())
    write("a_recording_with_a_name_that_is_long.csv", rows())
    write("test.csv", by_hand)
    monkeypatch.setattr(screen.out, "width", columns)
    tables = {
        ("analyze", "FIC101.csv", "a_recording_with_a_name_that_is_long.csv"): ("do|why"),
        ("explain", "FIC101.csv"): "From|Δt [s]|Δy [PV unit]|d [%]|d̂ after [%]|Verdict",
        ("step-test", "test.csv"): "Held until|OP [%OP]|PV [PV unit]|reads|95 %|from",
    }
    for command, headers in tables.items():
        _, out, _ = run(*command)
        words = " ".join(out.split())
        assert [header for header in headers.split("|") if header not in words] == [], command
        assert "…" not in out
        assert max(cell_len(line) for line in out.split("\n\n")[0].splitlines()) <= columns


@pytest.mark.parametrize("columns", [80, 120])
@pytest.mark.slow
def test_many_loops_are_one_table_that_is_not_torn(run, monkeypatch, columns):
    names = [f"FIC10{i}.csv" for i in range(5)] + ["a_recording_with_a_name_that_is_long.csv"]
    for name in names:
        write(name, rows())
    monkeypatch.setattr(screen.out, "width", columns)
    _, out, _ = run("analyze", "--no-fit", *names)
    table, _, short = out.rstrip().rpartition("\n\n")
    assert table.count("verdict") == 1 and "\n\n" not in table
    assert max(cell_len(line) for line in table.splitlines()) <= columns
    assert all(header in table for header in ("loop", "d̂", "verdict", "to do", "how soon"))
    assert "6 loops: cannot tell yet." in " ".join(short.split())
    assert ("rejected as" in table) == (columns == 120)
    # One loop less, and each has its block.
    _, out, _ = run("analyze", "--no-fit", *names[:5])
    assert out.count("  do ") == 5 and "verdict" not in out


@pytest.mark.slow
def test_python_m_glapp_is_the_command():
    done = subprocess.run([sys.executable, "-m", "glapp", "--version"], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, f"glapp {glapp.__version__}\n")


@pytest.mark.verify
def test_mypy_finds_the_types_from_outside(tmp_path):
    """Regression: mypy found no types, since a package without `py.typed` has the type Any for everything."""
    (tmp_path / "mine.py").write_text(
        "import glapp\n"
        "loop = glapp.Loop(name='FIC101')\n"
        "reveal_type(glapp.simulate.closed_loop('P2', (0.4, 2.4)).pv)\n"
        "x: int = loop.name\n"
    )
    path = {"MYPYPATH": "", "PYTHONPATH": str(Path(glapp.__file__).parents[1])}
    done = subprocess.run(
        [sys.executable, "-m", "mypy", "--config-file=", f"--cache-dir={tmp_path / 'cache'}", "mine.py"],
        cwd=tmp_path,
        env=os.environ | path,
        capture_output=True,
        text=True,
    )
    assert "ndarray" in done.stdout and 'expression has type "str", variable has type "int"' in done.stdout, done.stdout
    assert "py.typed" not in done.stdout


def test_version_is_printed(run):
    assert run("--version") == (0, f"glapp {glapp.__version__}\n", "")


@pytest.mark.slow
@pytest.mark.xdist_group("demonstration")
@pytest.mark.parametrize("columns", [60, 150])
def test_the_table_fits_the_terminal(demo, columns):
    env = os.environ | {"COLUMNS": str(columns)}
    done = subprocess.run([*GLAPP, "analyze", demo], capture_output=True, text=True, env=env)
    out = done.stdout
    lines = out.splitlines()
    assert max(map(cell_len, lines)) <= columns
    heads = {line.split()[0]: line for line in lines if line[:1].isalpha()}  # a block a loop begins with it
    assert list(heads)[:3] == ["PIC305", "FIC201", "TIC118"] and set(heads) >= {"LIC110", "FIC402"}
    assert re.search(r"%OP \(\S+ to \S+\) ", heads["FIC201"]), "no number is cut"
    assert "backlash" in heads["FIC201"] and "…" not in out
    parts = {part: sum(line.split()[:1] == [part] for line in lines) for part in ("do", "why")}
    assert parts == {"do": 5, "why": 0}, "why is told to those who ask"
    printed = subprocess.run([*GLAPP, "analyze", demo, "--why"], capture_output=True, text=True, env=env).stdout
    assert max(map(cell_len, printed.splitlines())) <= columns
    assert sum(line.split()[:1] == ["why"] for line in printed.splitlines()) == 5
    said = " ".join(out.split())
    assert "LIC110 oscillates as a sine wave" in said
    assert "\x1b" not in out
    for page in ("README.md", "docs/index.md"):
        [quoted] = re.findall(r"^```\n(PIC305 .*?)^```", (ROOT / page).read_text("utf-8"), re.DOTALL | re.MULTILINE)
        assert " ".join(quoted.split()) in said, f"{page} quotes another answer than the one that is given"


@pytest.mark.slow
def test_a_report_says_that_the_fit_was_left_out(run, demo, tmp_path):
    """It said of LIC110 that only a step test can judge the valve; the fit tells that a disturbance swings it."""
    left_out = (
        "The fit of OP and PV was left out (--no-fit, fit=False), and may judge the valve: analyse again with it."
    )
    _, shown, _ = run("analyze", demo, "--no-fit", "--report", "left_out.html")
    report = (tmp_path / "left_out.html").read_text(encoding="utf-8")
    assert report.count(left_out) >= 4 and " ".join(shown.split()).count(left_out) == 4
    assert "Only a step test" not in report and "Use the step test in this recording" in report  # of FIC402
    without = json.loads(run("analyze", demo, "--json")[1])["loops"]
    assert not any(left_out in loop["answer"]["do"] for loop in without)


@pytest.mark.slow
def test_the_demonstration_gets_the_answers_of_its_known_valves(run, demo):
    code, out, err = run("analyze", demo, "--json", "--no-fit")
    loops = {loop["loop"]: loop for loop in json.loads(out)["loops"]}
    assert err == ""
    for name, true in (("FIC201", 2.4), ("PIC305", 3.0), ("TIC118", 1.6)):
        assert loops[name]["crossings"] == "estimate" and abs(loops[name]["d_hat"] / true - 1) < 0.15, name
    for name in ("LIC110", "FIC402"):
        assert loops[name]["crossings"] in ("no_estimate", "refused") and loops[name]["d_hat"] is None
    assert code == any(loop["answer"]["valve"] == "refused" for loop in loops.values())


WRONG = {
    "empty": ("", "empty.csv: is empty"),
    "header": ("t,SP,PV,OP\n", "header.csv: has a header but no rows"),
    "onerow": ("t,SP,PV,OP\n0,1,2,3\n", "onerow.csv: has only one row"),
    "columns": (
        "a,b\n1,2\n3,4\n",
        "columns.csv: no column for PV and OP among those left: a, b; name them: --pv NAME --op NAME",
    ),
    "text": (rows(pv=lambda k, y: "abc" if k == 18 else y), "text.csv, row 20, column PV: 'abc' is not a number"),
    "nan": (rows(pv=lambda k, y: "NaN"), "nan.csv, column PV: has no value in any of"),
    "zones": (
        rows(time=lambda k: f"2026-03-01T12:{k // 60:02d}:{k % 60:02d}" + ("+01:00" if k < 300 else "")),
        "zones.csv, row 302, column t: '2026-03-01T12:05:00' has no zone",
    ),
}


@pytest.mark.slow
def test_a_wrong_recording_is_one_line_and_the_others_are_done(run):
    for name, (text, _) in WRONG.items():
        write(f"{name}.csv", text)
    write("good.csv", rows())
    Path("folder").mkdir()
    names = [*WRONG, "missing"]
    code, out, err = run("analyze", "folder", *(f"{name}.csv" for name in names), "good.csv")
    assert code == 1
    lines = err.splitlines()
    assert lines[0].startswith("error: folder: is a directory")
    assert len(lines) == 1 + len(names)
    for line, (_, expected) in zip(lines[1:], [*WRONG.values(), ("", "missing.csv: no such file")], strict=True):
        assert line.startswith(f"error: {expected}")
    assert re.search(r"good .* (sound|cannot tell)", out)
    assert sum("refused" in line for line in out.splitlines()) == len(names) + 1

    code, out, err_of_json = run("analyze", "folder", *(f"{name}.csv" for name in names), "good.csv", "--json")
    loops = json.loads(out)["loops"]
    assert code == 1 and err_of_json == err
    assert [loop["loop"] for loop in loops] == ["folder", *names, "good"]
    assert [loop["crossings"] for loop in loops] == ["refused"] * (len(names) + 1) + ["no_estimate"]
    assert loops[-2]["reason"] == "missing.csv: no such file"
    assert loops[-2]["controller"] is None and loops[-2]["reasons"] == {} and loops[-2]["half_periods"] == 0


def test_what_the_columns_were_taken_for_is_shown(run):
    write("plant.csv", rows(header="Zeit,Sollwert,Istwert,Stellgröße"))
    _, shown, _ = run("analyze", "plant.csv", "--no-fit")
    assert "SP = Sollwert, PV = Istwert, OP = Stellgröße" in " ".join(shown.split()) and "time = Zeit" in shown
    # A loops.toml shows them, and they can be changed there.
    run("init", "plant.csv", "-o", "loops.toml")
    assert "SP = Sollwert" not in run("analyze", "loops.toml", "--no-fit")[1]


def test_a_table_of_loops_says_why_some_were_not_analysed(run):
    lines = rows().splitlines()
    tags = [f"F{k}.{signal}" for k in range(7) for signal in ("SP", "PV", "OP")]
    sound, still = lines[1].split(",")[1:], ["5", "5", "50"]
    body = [
        ",".join([cells[0], *cells[1:], *cells[1:], *5 * still]) for cells in (line.split(",") for line in lines[1:])
    ]
    write("wide.csv", "\n".join([",".join(["t", *tags]), *body]) + "\n")
    assert len(sound) == 3
    code, shown, _ = run("analyze", "wide.csv", "--no-fit")
    shown = " ".join(shown.split())
    assert code == 1
    assert "F2 was not analysed: OP stays at 50 % over the whole recording" in shown
    assert "F4 was not analysed" in shown and "F5 was not analysed" not in shown and "Reasons: add --why" in shown


def test_the_zone_of_a_recording_over_the_end_of_summer_time(run):
    zone, began = ZoneInfo("Europe/Stockholm"), datetime(2026, 10, 25, 0, 55, tzinfo=UTC).timestamp()
    write(
        "october.csv",
        rows(time=lambda k: datetime.fromtimestamp(began + int(k), zone).strftime("%Y-%m-%d %H:%M:%S")),
    )
    code, shown, _ = run("analyze", "october.csv", "--no-fit")
    assert code == 1 and "name the time zone (--time-zone, time_zone)" in " ".join(shown.split())
    code, shown, printed = run("analyze", "october.csv", "--no-fit", "--time-zone", "Europe/Stockholm")
    assert "runs backwards" not in shown + printed
    code, _, printed = run("analyze", "october.csv", "--time-zone", "Europe/Stokholm")
    assert code == 2 and printed.startswith("error: --time-zone: is 'Europe/Stokholm', must be an IANA time zone")


def test_time_that_runs_backwards_is_refused_with_its_row(run):
    write("back.csv", rows(time=lambda k: "100" if k == 300 else str(k)))
    code, out, err = run("analyze", "back.csv", "--json")
    [loop] = json.loads(out)["loops"]
    assert (code, loop["crossings"], err) == (1, "refused", "")
    assert "row 302" in loop["reason"] and loop["quality"][0]["code"] == "time_reversed"


@pytest.mark.slow
def test_rows_from_the_newest_to_the_oldest_are_reversed_with_a_finding(run):
    write("up.csv", rows(200, time=lambda k: datetime.fromtimestamp(1.7e9 + 60 * k, UTC).strftime("%Y-%m-%d %H:%M")))
    [upward] = json.loads(run("analyze", "up.csv", "--json", "--no-fit")[1])["loops"]
    for form, step in (("%Y-%m-%d %H:%M", 60), ("%d.%m.%Y %H:%M:%S", 3600)):  # an hour back each row, not summer time
        stamp = [datetime.fromtimestamp(1.7e9 + step * k, UTC).strftime(form) for k in range(200)]
        head, *body = rows(200, time=lambda k, stamp=stamp: stamp[k]).splitlines()
        write("down.csv", "\n".join([head, *reversed(body)]) + "\n")
        code, out, _ = run("analyze", "down.csv", "--json", "--no-fit")
        [loop] = json.loads(out)["loops"]
        assert [one["code"] for one in loop["quality"]].count("newest_first") == 1
        assert "time_reversed" not in {one["code"] for one in loop["quality"]}
        if step == 60:
            assert (loop["crossings"], loop["half_periods"]) == (upward["crossings"], upward["half_periods"])
        one, other = body[3], body[100]
        body[3], body[100] = other, one
        write("mixed.csv", "\n".join([head, *reversed(body)]) + "\n")
        code, out, _ = run("analyze", "mixed.csv", "--json", "--no-fit")
        [loop] = json.loads(out)["loops"]
        assert code == 1 and "the newest row comes first, but not throughout; sort the rows" in loop["reason"]


SETTINGS = {
    "TI": ("controller = { k = 1, ti = 0 }", "loops.toml, loop TI, controller.ti: is 0, must be > 0"),
    "K": ("controller = { k = 0, ti = 9 }", "loops.toml, loop K, controller.k: is 0, must be > 0"),
    "SPAN": ("pv_span = [100, 0]", "loops.toml, loop SPAN, pv_span: goes from 100 to 0, must be low < high"),
    "EVEN": ("n = 8", "loops.toml, loop EVEN, n: is 8, must be odd"),
    "TYPO": ("pvspan = [0, 1]", "loops.toml, loop TYPO, pvspan: no such key; did you mean pv_span?"),
    "COLUMN": (
        'columns = { pv = "PW" }',
        "good.csv, loop COLUMN, columns.pv: no column 'PW' for PV. There are: t, SP, PV, OP",
    ),
    "UNIT": (
        "pv_span = [0, 50]\nop_span = [0, 100]\ncontroller = { k = 1, ti = 9 }",
        "good.csv, loop UNIT, gain_unit: is required, since the spans of PV and OP differ in width",
    ),
    "GOOD": ("", None),
}


@pytest.mark.slow
def test_wrong_settings_of_one_loop_stop_no_other(run):
    write("good.csv", rows())
    write("loops.toml", "".join(f'[loops.{name}]\nfile = "good.csv"\n{text}\n' for name, (text, _) in SETTINGS.items()))
    with Path("loops.toml").open("a") as file:
        file.write('[loops.GONE]\nfile = "gone.csv"\n[loops.NOFILE]\n')
    code, out, err = run("analyze", "loops.toml", "--json")
    loops = {loop["loop"]: loop for loop in json.loads(out)["loops"]}
    assert code == 1 and list(loops) == [*SETTINGS, "GONE", "NOFILE"]
    for name, (_, expected) in SETTINGS.items():
        if expected is not None:
            assert loops[name]["crossings"] == "refused" and loops[name]["reason"].startswith(expected), name
            assert f"error: {expected}" in err
    assert loops["GOOD"]["crossings"] == "no_estimate"
    assert loops["GONE"]["reason"] == "gone.csv: no such file"
    assert loops["NOFILE"]["reason"] == "loops.toml, loop NOFILE, file: is required"


def test_a_loops_toml_that_cannot_be_read(run):
    write("loops.toml", "[loops\n")
    code, out, err = run("analyze", "loops.toml")
    assert (code, out) == (1, "") and err.startswith("error: loops.toml: is not valid TOML") and err.count("\n") == 1


LINES = {
    "analyze good.csv --k 1 --ti 0": "--ti: is 0.0, must be > 0",
    "analyze good.csv --k 0 --ti 9": "--k: is 0.0, must be > 0",
    "analyze good.csv --k nan --ti 9": "--k: is nan, must be a finite number",
    "analyze good.csv --ti 9": "--k: give either the gain k or the proportional band pb",
    "analyze good.csv --pb 100 --ti 9": "--pv-span: is required to convert a gain in %/% (or a proportional "
    "band); give the ranges of PV and OP: --pv-span 0 50 --op-span 0 100, or in a loops.toml",
    "analyze good.csv --pv-span 100 0": "--pv-span: goes from 100 to 0, must be low < high",
    "analyze good.csv --n 8": "--n: is 8, must be odd",
    "analyze good.csv --kp 0": "--kp: is 0, must not be 0",
    "analyze good.csv --k 1 --ti 9 --ti-unit h": "--ti-unit: is 'h', must be one of",
    "analyze good.csv --form parallel --k 1": "--form: the parallel form has settings of its own",
    "analyze good.csv good.csv --n 9": "settings on the command line are for one recording",
    "analyze loops.toml --n 9": "settings on the command line do not go with a loops.toml",
    "analyze good.csv --json --csv -": "--json and --csv - both write to standard output",
    "analyze good.csv --report nowhere/report.html": "--report: there is no folder 'nowhere'",
    "analyze good.csv --csv nowhere/loops.csv": "--csv: there is no folder 'nowhere'",
    "analyze good.csv --loop X": "--loop: no loop 'X'; there are: good",
    "explain loops.toml": "loops.toml holds 2 loops; add --loop NAME with one of: A, B",
    "explain good.csv --at yesterday": "--at: cannot read 'yesterday' as a time; write seconds",
    "explain good.csv --at 2026-03-01": "--at: '2026-03-01' is a date, but the recording has plain seconds",
}


@pytest.mark.parametrize("line", LINES)
def test_a_wrong_command_line_is_one_line_and_2(run, line):
    write("good.csv", rows())
    write("loops.toml", '[loops.A]\nfile = "good.csv"\n[loops.B]\nfile = "good.csv"\n')
    code, out, err = run(*line.split())
    assert (code, out) == (2, "")
    assert err.startswith(f"error: {LINES[line]}") and err.count("\n") == 1


@pytest.mark.parametrize("line", ["", "analyze", "analyze good.csv --bogus", "analyze good.csv --k abc", "frob"])
def test_usage_errors_end_with_2(run, line):
    code, out, err = run(*line.split())
    assert code == 2 and "Usage: glapp" in out + err and "Traceback" not in err


@pytest.mark.slow
def test_what_cannot_be_written_is_one_line(run):
    write("good.csv", rows())
    Path("folder").mkdir()
    for line, ends, place in (
        ("analyze good.csv --report folder", 2, "--report: 'folder' is a folder"),
        ("analyze good.csv --csv folder", 2, "--csv: 'folder' is a folder"),
        ("init good.csv -o folder --force", 2, "--output: 'folder' is a folder"),
        ("demo good.csv", 1, "good.csv: cannot be written"),
    ):
        code, _, err = run(*line.split())
        assert code == ends and err.startswith(f"error: {place}") and err.count("\n") == 1, line


def no_constants(name):
    raise AssertionError(f"{name} is not JSON")


@pytest.mark.slow
@pytest.mark.xdist_group("demonstration")
def test_json_follows_its_schema(run, demo):
    schema = json.loads((ROOT / "docs/analyze.schema.json").read_text())
    jsonschema_rs.meta.validate(schema)
    validator = jsonschema_rs.Draft202012Validator(schema)
    files = [demo, "missing.csv", *sorted(REFINERY.glob("*.csv"))]
    _, out, _ = run("analyze", *files, "--json")
    document = json.loads(out, parse_constant=no_constants)
    validator.validate(document)
    assert document["glapp"] == glapp.__version__ and len(document["loops"]) >= 6
    with pytest.raises(jsonschema_rs.ValidationError):
        validator.validate({"glapp": "0"})


def test_the_schema_in_docs_is_current():
    assert (ROOT / "docs/analyze.schema.json").read_text() == to_schema() + "\n", (
        "run: python -m glapp.document > docs/analyze.schema.json"
    )


@pytest.mark.slow
def test_csv_has_a_row_per_loop(run, demo):
    code, out, err = run("analyze", demo, "missing.csv", "--csv", "-", "--no-fit")
    table = list(csv.DictReader(io.StringIO(out)))
    assert code == 1 and len(err.splitlines()) == 1
    assert [row["loop"] for row in table] == ["FIC201", "PIC305", "LIC110", "FIC402", "TIC118", "missing"]
    assert float(table[0]["d_hat"]) > 0 and table[-1]["d_hat"] == ""
    low, high = (float(table[0][f"repeatability_{end}"]) for end in ("low", "high"))
    assert low <= float(table[0]["d_hat"]) <= high and float(table[0]["noise_floor"]) < low
    assert float(table[0]["corrected_d"]) > 0 and table[-1]["corrected_d"] == ""
    half_periods = sum(int(table[0][f"rejected_{name}"]) for name in glapp.result.REASONS[1:]) + int(
        table[0]["detections"]
    )
    assert half_periods == int(table[0]["half_periods"])
    _, shown, _ = run("analyze", demo, "missing.csv", "--csv", "loops.csv", "--no-fit")
    assert Path("loops.csv").read_text() == out and "FIC201" in shown


@pytest.mark.slow
def test_settings_of_the_command_line_are_those_of_a_loops_toml(run):
    write("plant.csv", rows(header="t,SP,PV,CO"))
    write(
        "loops.toml",
        '[loops.plant]\nfile = "plant.csv"\npv_span = [0, 50]\nop_span = [0, 100]\nn = 5\n'
        'controller = { form = "series", pb = 250, ti = 0.5, ti_unit = "min", td = 1 }\n'
        'process = { kp = 1, kp_unit = "%/%" }\n',
    )
    _, by_file, _ = run("analyze", "loops.toml", "--json")
    line = (
        "--form series --pb 250 --ti 0.5 --ti-unit min --td 1 --kp 1 --kp-unit %/% --pv-span 0 50 --op-span 0 100 --n 5"
    )
    _, by_line, _ = run("analyze", "plant.csv", *line.split(), "--json")
    assert by_file == by_line
    assert json.loads(by_line)["loops"][0]["controller"]["ti"] == 31


def test_the_words_that_mean_automatic_are_an_option_and_are_written(run):
    """An unknown word of MODE needed a loops.toml by hand."""
    words = ["1", "2", "3"]
    rows = "".join(f"{k},50,{50 + k % 3},{40 + k % 4},{words[k % 3]}\n" for k in range(30))
    Path("plant.csv").write_text("t,SP,PV,OP,MODE\n" + rows)
    code, _, err = run("init", "plant.csv")
    assert code == 1
    assert "'2' is not a mode that glapp knows; say which words mean automatic, as --auto-values" in err
    assert run("init", "plant.csv", "--auto-values", "1", "--auto-values", "3", "-o", "loops.toml")[0] == 0
    assert 'auto_values = ["1", "3"]' in Path("loops.toml").read_text()
    [loop] = read_settings("loops.toml")
    [recording] = open_recordings("plant.csv", [loop])
    [batch] = recording.batches()
    assert batch.flags.tolist() == [NOT_AUTO if words[k % 3] == "2" else 0 for k in range(30)]


def test_init_writes_the_controller_in_the_form_and_units_that_were_given(run):
    """It knew no option of the controller, and left out the time zone that it was given."""
    write("plant.csv", rows(header="t,SP,PV,CO", time=lambda k: f"2026-03-01 10:{k // 60:02d}:{k % 60:02d}"))
    line = (
        "init plant.csv --form series --pb 250 --ti 2 --ti-unit repeats/min --td 0.1 --td-unit min --action direct "
        "--kp -1 --kp-unit PV/OP --pv-span 0 50 --op-span 0 100 --n 5 --tf 2 --time-zone Europe/Stockholm"
    )
    code, _, err = run(*line.split(), "--repaired", "2026-03-01 10:05", "-o", "loops.toml")
    assert code == 0 and "FILL IN" not in Path("loops.toml").read_text()
    assert err == "Wrote loops.toml. Next:\n  glapp analyze loops.toml --report report.html\n"
    [loop] = read_settings("loops.toml")
    controller = {"form": "series", "pb": 250, "ti": 2, "ti_unit": "repeats/min", "td": 0.1, "td_unit": "min"}
    assert loop.controller == glapp.Controller(**controller, action="direct")
    assert (loop.process.kp, loop.process.kp_unit, loop.pv_span, loop.op_span) == (-1, "PV/OP", (0, 50), (0, 100))
    assert (loop.n, loop.tf, loop.time_zone, loop.repaired.minute) == (5, 2, "Europe/Stockholm", 5)
    assert "Fill in spans, then:" in run("init", "plant.csv", "--k", 1, "--ti", 9, "-o", "some.toml")[2]
    assert run("init", "plant.csv", "--pb", 250, "--ti", 2)[0] == 2
    assert "--ti: is required" in run("init", "plant.csv", "--k", 1)[2]
    write("other.csv", rows())
    code, _, err = run("init", "plant.csv", "other.csv", "--k", 1, "--ti", 9)
    assert code == 2 and "glapp init FILES -o loops.toml begins one" in err  # it sent whoever typed init to init FILE


@pytest.mark.slow
def test_columns_can_be_named_for_many_recordings(run):
    for name in ("a.csv", "b.csv"):
        write(name, rows(header="when,goal,is,valve"))
    names = ["--time", "when", "--sp", "goal", "--pv", "is", "--op", "valve"]
    code, out, _ = run("analyze", "a.csv", "b.csv", *names, "--json")
    assert code == 0 and [loop["controller"]["k"] for loop in json.loads(out)["loops"]] == pytest.approx(
        [0.8, 0.8], rel=0.02
    )


@pytest.mark.slow
def test_trust_goes_on_with_a_poor_identification(run):
    header, *lines = rows(2000).splitlines()
    noise = np.random.default_rng(7).standard_normal(2000)
    noisy = [
        f"{cells},{float(op) + 4 * e:.4f}"
        for (cells, op), e in zip((x.rsplit(",", 1) for x in lines), noise, strict=True)
    ]
    write("poor.csv", "\n".join([header, *noisy]))
    code, out, err = run("identify", "poor.csv")
    assert code == 1 and "R²" in out and "loops.toml" not in out and "--trust" in err
    assert run("analyze", "poor.csv", "--no-fit")[0] == 1
    assert run("analyze", "poor.csv", "--trust")[0] == 0


@pytest.mark.slow
def test_identify_prints_what_a_loops_toml_takes(run):
    write("good.csv", rows().replace("t,SP,PV,OP", "t,SP,PV (bar),OP"))
    code, out, err = run("identify", "good.csv")
    assert (code, err) == (0, "")
    assert "95 %" in out and "%/bar" in out
    write("loops.toml", out.split("For a loops.toml:")[1])
    [loop] = read_settings("loops.toml")
    assert loop.ideal().k == pytest.approx(0.8, rel=0.02) and loop.ideal().ti == pytest.approx(25, rel=0.05)
    assert run("analyze", "loops.toml")[0] == 0


def test_identify_takes_no_fraction_for_a_percentage(run):
    lines = rows().splitlines()
    parts = [line.split(",") for line in lines[1:]]
    write("fraction.csv", "\n".join([lines[0], *(",".join([*p[:3], str(float(p[3]) / 100)]) for p in parts)]) + "\n")
    assert "OP unit/PV unit" in run("identify", "fraction.csv")[1]


def test_identify_tells_a_direct_acting_controller(run):
    lines = rows().splitlines()
    flipped = [f"{r.rsplit(',', 1)[0]},{100 - float(r.rsplit(',', 1)[1]):.4f}" for r in lines[1:]]
    write("direct.csv", "\n".join([lines[0], *flipped]))
    _, out, _ = run("identify", "direct.csv")
    write("loops.toml", out.split("For a loops.toml:")[1])
    assert read_settings("loops.toml")[0].ideal().k == pytest.approx(-0.8, rel=0.02)


def test_identify_takes_many_files(run):
    write("north.csv", rows())
    write("south.csv", rows())
    write("no_op.csv", "\n".join(line.rsplit(",", 1)[0] for line in rows().splitlines()))
    code, out, err = run("identify", "north.csv", "no_op.csv", "south.csv")
    assert code == 1 and err.count("\n") == 1
    assert "no_op.csv" in err and "no OP" in err
    write("loops.toml", out.split("For a loops.toml:")[1])
    assert [loop.name for loop in read_settings("loops.toml")] == ["north", "south"]


def test_init_takes_many_files(run):
    write("north.csv", rows())
    write("south.csv", rows())
    code, text, err = run("init", "north.csv", "none.csv", "south.csv")
    assert (code, err) == (1, "error: none.csv: no such file\n")
    write("loops.toml", text)
    assert [(loop.name, loop.file.name) for loop in read_settings("loops.toml")] == [
        ("north", "north.csv"),
        ("south", "south.csv"),
    ]
    assert run("init", "loops.toml")[0] == 2


def test_init_refuses_a_signal_without_a_number(run):
    write("dead.csv", rows(pv=lambda k, y: "NaN"))
    write("good.csv", rows())
    wrong = "error: dead.csv, column PV: has no value in any of 600 rows; is it the right column?\n"
    assert run("init", "dead.csv", "-o", "loops.toml") == (1, "", wrong) and not Path("loops.toml").exists()
    code, text, err = run("init", "dead.csv", "good.csv")
    assert (code, err) == (1, wrong) and "[loops.good]" in text and "dead" not in text
    for cells, column in (((0, "", 2, 3), "SP"), ((0, 1, 2, "NaN"), "OP")):
        write("dead.csv", "\n".join(["t,SP,PV,OP", *(",".join(map(str, (k, *cells[1:]))) for k in range(40))]) + "\n")
        said = f"error: dead.csv, column {column}: has no value in any of 40 rows; is it the right column?\n"
        assert run("init", "dead.csv") == (1, "", said)
    write("dead.csv", "\n".join(line.rsplit(",", 1)[0] for line in rows().splitlines()))
    assert run("init", "dead.csv")[0] == 0  # no OP is recorded


def test_identify_names_the_file_and_prints_no_empty_table(run):
    write("short.csv", rows(n=20))
    code, out, err = run("identify", "short.csv")
    assert (code, out) == (1, "") and err.startswith("error: short.csv, loop short: not usable: only 19 steps")


def test_a_step_test_that_nothing_is_read_from_prints_the_error_alone(run):
    write("plain.csv", rows())
    code, out, err = run("step-test", "plain.csv")
    assert (code, out) == (1, "") and err.startswith("error: plain.csv, loop plain: ") and err.count("\n") == 1


def test_a_header_in_the_middle_is_called_one(run):
    """Days that were joined with their headers: it said that 'PV' is not a time, and to write 2024-01-31."""
    text = rows(n=40)
    for name, second in (("days.csv", text), ("spaced.csv", " t ,SP,PV,OP\n" + text.partition("\n")[2])):
        write(name, text + second)
        code, _, err = run("analyze", name, "--no-fit")
        assert code == 1 and err.startswith(f"error: {name}, row 42, column t: the header is there once more")


def test_what_a_column_hinders_the_command_line_can_leave_out(run):
    """Modes, qualities and times that cannot be read named keys of a loops.toml, which init refused to write."""
    lines = rows().splitlines()
    for name, cell, option in (("MODE", "Turbo", "--mode ''"), ("Quality", "Meh", "--quality ''")):
        write("plant.csv", "\n".join([f"{lines[0]},{name}", *(f"{line},{cell}" for line in lines[1:])]))
        assert option in run("analyze", "plant.csv", "--no-fit")[2]
        assert run("analyze", "plant.csv", "--no-fit", option.split()[0], "")[0] == 0
        assert f'{name.lower()} = ""' in run("init", "plant.csv", option.split()[0], "")[1]
    write("plant.csv", rows(time=lambda k: f"10:{k // 60:02d}:{k % 60:02d}"))
    assert "--time '' --sample-time SECONDS" in run("analyze", "plant.csv", "--no-fit")[2]
    assert run("analyze", "plant.csv", "--no-fit", "--time", "", "--sample-time", 1)[0] == 0


def test_an_op_without_a_value_is_called_that(run):
    """It was called a recording in which 0 steps between samples can be used."""
    head, *lines = rows().splitlines()
    write("dead.csv", "\n".join([head, *(line.rsplit(",", 1)[0] + ",NaN" for line in lines)]))
    code, _, err = run("identify", "dead.csv")
    assert code == 1 and "OP has no value in any row, so K and Ti must be given: check the column or tag" in err
    said = "".join(run("analyze", "dead.csv", "--why")[1].split("\n")).replace(" ", "")
    assert "OPhasnovalue" in said and "0steps" not in said


def test_identify_without_op(run):
    write("no_op.csv", "\n".join(line.rsplit(",", 1)[0] for line in rows().splitlines()))
    code, _, err = run("identify", "no_op.csv")
    assert code == 1 and "no OP" in err and err.count("\n") == 1


@pytest.mark.slow
def test_init_writes_settings_that_work_where_they_lie(run):
    Path("data").mkdir()
    Path("settings").mkdir()
    write("data/plant.csv", rows())
    code, text, _ = run("init", "data/plant.csv")
    assert code == 0 and 'file = "data/plant.csv"' in text
    code, out, err = run("init", "data/plant.csv", "-o", "settings/loops.toml")
    assert (code, out) == (0, "") and "glapp analyze settings/loops.toml" in err
    assert 'file = "../data/plant.csv"' in Path("settings/loops.toml").read_text()
    assert run("analyze", "settings/loops.toml")[0] == 0


def test_init_overwrites_only_with_the_option(run):
    write("plant.csv", rows())
    write("loops.toml", "mine")
    code, _, err = run("init", "plant.csv", "-o", "loops.toml")
    assert code == 1 and err == "error: loops.toml: exists already; choose another name, or add --force\n"
    assert Path("loops.toml").read_text() == "mine"
    assert run("init", "plant.csv", "-o", "loops.toml", "--force")[0] == 0
    assert "[loops.plant]" in Path("loops.toml").read_text()


@pytest.mark.slow
def test_explain_shows_one_half_period_and_its_tests(run, demo):
    code, listed, _ = run("explain", demo, "--loop", "FIC201")
    assert code == 0 and re.match(r"FIC201: \d+ half-periods, .*\d+\s+too\s+short", listed)  # it begins with a summary
    accepted = next(line for line in listed.splitlines() if line.rstrip().endswith("accepted"))
    code, out, _ = run("explain", demo, "--loop", "FIC201", "--at", accepted[:19])
    assert code == 0 and f"{accepted[:19]} to " in out.splitlines()[0] and out.splitlines()[1].startswith("accepted")
    assert "✗" not in out and out.count("✓") >= 4
    rejected = next(line for line in listed.splitlines() if line.rstrip().endswith("uneven"))
    _, out, _ = run("explain", demo, "--loop", "FIC201", "--at", rejected[:19])
    assert "rejected: uneven" in out and re.search(r"✗ .*Δy before / Δy = .*needs 0.5 to 1.5", out)


@pytest.mark.slow
def test_explain_outside_the_recording(run):
    write("good.csv", rows())
    code, _, err = run("explain", "good.csv", "--at", "9999")
    assert code == 1
    assert err == "error: good.csv: '9999' is outside the recording, which goes from 0 s to 599 s\n"
    code, _, err = run("explain", "good.csv", "--at", "598")
    assert code == 1 and "had not ended when the recording stopped" in err
    write("still.csv", "t,SP,PV,OP\n" + "".join(f"{k},50,50,50\n" for k in range(100)))
    code, _, err = run("explain", "still.csv", "--at", "5")
    assert code == 1 and "has no half-periods" in err


def test_times_are_those_of_the_recording():
    stockholm = ZoneInfo("Europe/Stockholm")
    t0 = datetime(2026, 3, 29, 1, 0, tzinfo=stockholm)  # an hour before the clocks go forward
    assert _seconds("2026-03-29 03:30", t0) == 1800 + 3600
    assert _seconds("2026-03-29T01:30:00Z", t0) == 1800 + 3600
    assert clock(t0, 1800 + 3600) == "2026-03-29 03:30:00"
    assert clock(t0, 0.25) == "2026-03-29 01:00:00.250"
    assert _seconds("90", t0) == 90
    assert _seconds("2026-03-29T01:00:05", t0.replace(tzinfo=None)) == 5
    with pytest.raises(CommandError, match="has a zone"):
        _seconds("2026-03-29T01:00:05Z", t0.replace(tzinfo=None))
    # Any form that the reader knows.
    for at in ("29.03.2026 03:30", "29-Mar-26 03:30:00", "29/03/2026 3:30", "Mar 29, 2026 3:30 AM", "20260329T033000"):
        assert _seconds(at, t0) == 1800 + 3600, at
    assert _seconds("05/04/2026 01:00", t0, "day first") == 7 * 86400 - 3600
    with pytest.raises(CommandError, match="day first or month first; write '2026-03-29 01:00:00'"):
        _seconds("05/04/2026 01:00", t0)
    with pytest.raises(CommandError, match="cannot read 'noon'"):
        _seconds("noon", t0)


def test_a_name_is_shown_as_it_is(run):
    write("good.csv", rows())
    write("loops.toml", '[loops."[red]x[/] :smile:"]\nfile = "good.csv"\n')
    _, out, _ = run("analyze", "loops.toml", "--no-fit")
    assert out.count("[red]x[/] :smile:") == 2  # above its block, and in the sentence


@pytest.mark.slow
def test_loops_of_a_long_table_one_of_them_wrong(run):
    lines = ["time,tag,value"]
    for k, row in enumerate(rows(300).splitlines()[1:]):
        for signal, value in zip(("SP", "PV", "OP"), row.split(",")[1:], strict=True):
            lines += [f"{k},FIC{i}.{signal},{value}" for i in (1, 2, 3)]
    write("long.csv", "\n".join(lines))
    code, out, _ = run("analyze", "long.csv", "--json")
    assert code == 0 and [loop["loop"] for loop in json.loads(out)["loops"]] == ["FIC1", "FIC2", "FIC3"]
    wrong = {"FIC1": "", "FIC2": 'columns = { pv = "NOPE" }', "FIC3": ""}
    write("loops.toml", "".join(f'[loops.{name}]\nfile = "long.csv"\n{text}\n' for name, text in wrong.items()))
    code, out, err = run("analyze", "loops.toml", "--json")
    assert [loop["crossings"] for loop in json.loads(out)["loops"]] == ["no_estimate", "refused", "no_estimate"]
    assert code == 1 and "NOPE" in err


@pytest.mark.slow
def test_loops_of_a_wide_table_one_of_them_wrong(run):
    lines = ["t,FIC1.SP,FIC1.PV,FIC1.OP,FIC1.OUT,FIC2.SP,FIC2.PV,FIC2.OP"]
    for k, row in enumerate(rows().splitlines()[1:]):
        sp, pv, op = row.split(",")[1:]
        lines.append(f"{k},{sp},{pv},{op},{op},{sp},{pv},{op}")
    write("wide.csv", "\n".join(lines))
    code, out, err = run("analyze", "wide.csv", "--json", "--report", "report.html")
    assert code == 1 and err.startswith(
        "error: wide.csv, loop FIC1: the columns 'FIC1.OP' and 'FIC1.OUT' could both be OP"
    )
    loops = {loop["loop"]: loop["crossings"] for loop in json.loads(out)["loops"]}
    assert loops == {"FIC1": "refused", "FIC2": "no_estimate"}
    assert "could both be OP" in Path("report.html").read_text()
    assert run("identify", "wide.csv", "--loop", "FIC2")[0] == 0
    assert run("identify", "wide.csv", "--loop", "FIC1")[0] == 1


def of_two_loops(kind):
    """Rows of FIC1 and FIC2, which differ in nothing, and of a signal X of no loop that is their PV, moved by 1."""
    own = [row.split(",") for row in rows(300).splitlines()[1:]]
    signals = [("SP", 1), ("PV", 2), ("OP", 3)]
    if kind == "wide":
        lines = ["t," + ",".join(f"{loop}.{signal}" for loop in ("FIC1", "FIC2") for signal, _ in signals) + ",X"]
        return lines + [f"{','.join([*row, *row[1:]])},{float(row[2]) + 1:.4f}" for row in own]
    lines = ["time,tag,value"]
    for row in own:
        lines += [f"{row[0]},{loop}.{signal},{row[at]}" for loop in ("FIC1", "FIC2") for signal, at in signals]
        lines.append(f"{row[0]},X,{float(row[2]) + 1:.4f}")
    return lines


@pytest.mark.parametrize("kind", ["wide", "long"])
def test_what_describes_one_loop_is_said_of_one(run, kind):
    """`--pv X` gave X to each loop of the table, and so did a gain that only one of them has."""
    write("plant.csv", "\n".join(of_two_loops(kind)))
    line = ["analyze", "plant.csv", "--no-fit"]
    for options in (["--pv", "X"], ["--kp", "2"], ["--k", "1", "--ti", "9"], ["--repaired", "2026-03-01"]):
        code, _, err = run(*line, *options)
        named = " ".join(option for option in options if option.startswith("--"))
        assert code == 1 and err.startswith(f"error: plant.csv: holds 2 loops, FIC1, FIC2, and {named} describe")
        assert "add --loop 'FIC1' and no other, where it is that one; or write what each has into a loops.toml" in err
        assert run(*line, *options, "--loop", "FIC2", "--loop", "FIC1")[0] == 1
    _, out, _ = run(*line, "--pv", "X", "--loop", "FIC2")
    assert "PV = X, OP = FIC2.OP" in out and "FIC1" not in out
    _, out, _ = run(*line, "--n", "5", "--mode", "")  # each may have it
    assert "PV = FIC1.PV," in out and "PV = FIC2.PV," in out
    described = {"columns": {"pv": "X"}, "controller": {"k": 0.8, "ti": 25.0}, "n": 5}
    [first, second] = open_each("plant.csv", None, described, ["FIC2"])
    assert (first.columns["PV"], first.loop.controller, first.loop.n) == ("FIC1.PV", None, 5)
    assert (second.columns["PV"], second.loop.controller.ti, second.loop.n) == ("X", 25.0, 5)


def test_of_a_file_that_cannot_be_read_a_loop_is_asked_for(run):
    """It was said that the file had no such loop."""
    code, _, err = run("analyze", "missing.csv", "--loop", "FIC1")
    assert code == 1 and err == "error: missing.csv: no such file\n"


def test_an_interruption_is_quiet_and_stops_the_work(run, monkeypatch):
    write("good.csv", rows())
    stopped = []

    def endless(recording, *, trust, fit, progress):
        try:
            while True:
                progress(0.5)
        except InterruptedError:
            stopped.append(recording.name)
            raise

    def interrupted(futures, timeout):
        raise KeyboardInterrupt

    monkeypatch.setattr(glapp.cli.work, "analyze", endless)
    monkeypatch.setattr(glapp.cli.work, "wait", interrupted)
    assert run("analyze", "good.csv") == (130, "", "")
    assert stopped == ["good"]


@pytest.mark.verify
def test_a_closed_pipe_is_quiet(tmp_path):
    good = tmp_path / "good.csv"
    write(good, rows())
    for line in (
        ("analyze", good, "--csv", "-", "--no-fit"),
        ("analyze", good, "--no-fit"),
        ("analyze", good, "--json", "--no-fit"),
        ("explain", good),
    ):
        with subprocess.Popen([*GLAPP, *line], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
            process.stdout.close()
            assert process.stderr.read() == b"", line


@pytest.mark.slow
def test_a_terminal_without_unicode(tmp_path):
    warm = tmp_path / "FIC201.csv"
    warm.write_text(rows(header="t,SP,PV (°C),OP"), "utf-8")
    env = os.environ | {"PYTHONIOENCODING": "ascii"}
    done = subprocess.run([*GLAPP, "analyze", warm, "--no-fit"], capture_output=True, env=env)
    assert b"Traceback" not in done.stderr and b"FIC201" in done.stdout
    done = subprocess.run([*GLAPP, "analyze", warm, "--json", "--no-fit"], capture_output=True, env=env)
    assert json.loads(done.stdout)["loops"][0]["loop"] == "FIC201"
    assert not done.stdout.isascii(), "JSON is UTF-8 whatever the terminal takes"


def test_a_file_name_that_is_not_text(run):
    name = os.fsdecode(b"a\xff.csv")
    write(name, rows())
    code, out, err = run("analyze", name, "--json")
    assert code == 1 and json.loads(out)["loops"][0]["loop"] == "a?" and "rename it" in err


@pytest.mark.slow
@pytest.mark.xdist_group("demonstration")
def test_slow_packages_are_not_imported(demo):
    code = (
        "import sys\nfrom fits import remember\nfrom glapp.cli import main\nremember()\n"
        "sys.argv = ['glapp', 'analyze', sys.argv[1]]\n"
        "try: main()\nexcept SystemExit: pass\nprint([m for m in ('plotly', 'scipy') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code, demo], capture_output=True, text=True, cwd=Path(__file__).parent)
    assert done.stdout.splitlines()[-1] == "[]"


@pytest.mark.slow
@pytest.mark.skipif(not REFINERY.is_dir(), reason="the refinery recordings are not beside this checkout")
def test_real_loops_with_nothing_but_their_files(run):
    _, out, _ = run("analyze", *sorted(REFINERY.glob("*.csv")), "--json", "--no-fit")
    loops = {loop["loop"]: loop for loop in json.loads(out)["loops"]}
    cycle = loops["FIC46005_0902"]
    assert cycle["crossings"] == "provisional" and 0.40 < cycle["d_hat"] < 0.60 and cycle["detections"] < 9
    # 0.012 and 35 s if it ran once a sample, 0.014 and 40 s if much faster: K/Ti is the same.
    k, ti = cycle["controller"]["k"], cycle["controller"]["ti"]
    assert k / ti == pytest.approx(0.012 / 34, rel=0.05) and 0.012 < k < 0.015 and 34 < ti < 43
    for name in ("LIC31102B_0824", "LIC31102B_0904", "LIC31102B_1127"):
        assert loops[name]["crossings"] == "no_estimate" and "sine wave" in loops[name]["reason"]
    assert loops["FIC10104_0224"]["crossings"] == "refused" and loops["FIC10104_0224"]["reason"]
    assert loops["LIC30102_0825"]["controller"]["k"] < 0
    assert "cascade_slave" in [finding["code"] for finding in loops["FIC40102B_0825"]["quality"]]


@pytest.mark.slow
def test_thesis_writes_a_page_and_names_what_is_wrong(run):
    code, out, _ = run("thesis", "1.2", "figure 4.1", "--out", "pages")
    assert code == 0
    assert "Figures: 2" in out and "width between the flanks" in out
    assert {path.name for path in Path("pages").iterdir()} == {
        "index.html",
        "numbers.json",
        "figure-1.2.png",
        "figure-4.1.png",
    }
    code, _, err = run("thesis", "3.3")
    assert code == 2 and "'3.3', must be one of 1.1" in err
    write("file", "")
    code, _, err = run("thesis", "1.2", "--out", "file")
    assert code == 1 and "file: cannot be written" in err and "--out" in err


@pytest.mark.slow
@pytest.mark.parametrize("missing", ["matplotlib", "glapp_thesis"])
def test_thesis_without_what_it_needs(tmp_path, missing):
    line = f"import sys; sys.modules['{missing}'] = None; from glapp.cli import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", line, "thesis", "1.2"], capture_output=True, text=True, cwd=tmp_path, check=False
    )
    assert done.returncode == 1 and "pip install 'glapp[thesis]'" in done.stderr


@pytest.mark.slow
def test_a_loop_that_the_fit_answers_is_no_refusal(run):
    """A valve ranked first was once badged "refused", with exit code 1, because SP was not recorded."""
    acting = {"setpoint": [(1, 1.0)], "load": [(50, 0.3), (120, -0.2), (180, 0.1)]}
    s = glapp.simulate.closed_loop(
        "P3", (0.48, 0.3117, 0, 0), d=0.05, noise=0.005, h=0.1, t_end=250, seed=1, **acting, filter_in_loop=True
    )
    lines = [f"{t},{pv},{op}" for t, pv, op in zip(s.t, s.pv, s.op, strict=True)]
    write("plant.csv", "\n".join(["t,PV,OP", *lines]) + "\n")
    code, out, _ = run("analyze", "plant.csv", "--json")
    [loop] = json.loads(out)["loops"]
    assert (code, loop["crossings"], loop["answer"]["verdict"]) == (0, "refused", "backlash")
    assert loop["answer"]["low"] < 0.05 < loop["answer"]["high"] and loop["answer"]["urgency"] == "medium"
    code, out, _ = run("analyze", "plant.csv", "--json", "--no-fit")
    [loop] = json.loads(out)["loops"]
    assert (code, loop["answer"]["verdict"], loop["answer"]["next"]["code"]) == (1, "refused", "correct")


def test_identify_reads_the_beginning_once(run, monkeypatch):
    """OP's unit was sought in rows that were read once more."""
    write("plain.csv", rows(200))
    passes, beginning = [], Recording.beginning
    monkeypatch.setattr(Recording, "beginning", lambda self, n: passes.append(n) or beginning(self, n))
    run("identify", "plain.csv")
    assert len(passes) == 1
