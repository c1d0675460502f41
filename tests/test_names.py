"""Names from outside: unique in a run, harmless on a terminal, in a spreadsheet, in a report; and no file hangs."""

import csv
import io
import json
import os
import re
import socket
import subprocess
import sys
import unicodedata
from pathlib import Path
from urllib.parse import quote

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from test_cli import GLAPP, rows, run, write

from glapp.errors import InputError
from glapp.escape import for_spreadsheet
from glapp.loop import Loop
from glapp.reading import open_recordings
from glapp.reading.files import name_of
from glapp.reading.init import settings_of
from glapp.reading.settings import parse_settings, read_settings

__all__ = ["run"]  # the fixture


def names(out):
    return [loop["loop"] for loop in json.loads(out)["loops"]]


@pytest.mark.parametrize(
    ("path", "name"),
    [
        ("2026.03.01 FIC101.csv", "2026.03.01 FIC101"),  # was 2026
        ("a/FIC101.PV.CSV.GZ", "FIC101.PV"),
        ("v1.2/FIC101.parquet", "FIC101"),
        ("FIC101.A", "FIC101.A"),
        ("FIC101", "FIC101"),
        ("FIC101.zst", "FIC101"),
        ("FIC101.arrow", "FIC101"),
        (".csv", ".csv"),
        (".", "loop"),
    ],
)
def test_only_a_known_ending_is_cut(path, name):
    assert name_of(path) == name


def test_files_named_by_their_day_keep_their_names(run):
    for day in ("2026.03.01", "2026.03.02"):
        write(f"{day} FIC101.csv", rows(300))
    code, out, err = run("analyze", "2026.03.01 FIC101.csv", "2026.03.02 FIC101.csv", "--json", "--no-fit")
    assert (code, err, names(out)) == (0, "", ["2026.03.01 FIC101", "2026.03.02 FIC101"])


WIDE = "t,FIC1.SP,FIC1.PV,FIC1.OP,FIC2.SP,FIC2.PV,FIC2.OP\n" + "".join(
    f"{k},50,{50 + np.sin(k / 9):.3f},{40 + np.cos(k / 9):.3f},50,{50 + np.sin(k / 7):.3f},{40 + np.cos(k / 7):.3f}\n"
    for k in range(300)
)


@pytest.mark.slow
def test_one_name_in_two_folders_gets_the_folders_prefix(run):
    """Regression: the rows of two loops of one name looked the same."""
    for folder in ("north", "south"):
        Path(folder).mkdir()
        write(f"{folder}/FIC101.csv", rows(300))
        write(f"{folder}/day.csv", WIDE)
    write("FIC101.csv", rows(300))
    files = ["FIC101.csv", "north/FIC101.csv", "south/FIC101.csv"]
    code, out, err = run("analyze", *files, "--json", "--no-fit", "--csv", "t.csv", "--report", "r.html")
    assert (code, names(out)) == (0, ["FIC101", "north/FIC101", "south/FIC101"])
    assert err == "note: 3 loops are named FIC101; they are shown as FIC101, north/FIC101, south/FIC101\n"
    assert [row["loop"] for row in csv.DictReader(io.StringIO(Path("t.csv").read_text()))] == names(out)
    page = re.sub("<wbr>", "", Path("r.html").read_text())
    assert all(f">{name}<" in page for name in names(out))
    code, out, err = run("analyze", "north/day.csv", "south/day.csv", "--json", "--no-fit")
    assert names(out) == ["north/day/FIC1", "north/day/FIC2", "south/day/FIC1", "south/day/FIC2"]
    assert "2 loops are named FIC1; they are shown as north/day/FIC1, south/day/FIC1, and 1 more names likewise" in err
    # A loop is asked for by the name it has here, or by the one in its file.
    assert names(run("analyze", "north/day.csv", "south/day.csv", "--json", "--loop", "south/day/FIC2")[1]) == [
        "south/day/FIC2"
    ]
    assert len(names(run("analyze", "north/day.csv", "south/day.csv", "--json", "--loop", "FIC2")[1])) == 2


@pytest.mark.slow
def test_the_same_name_with_other_endings_or_twice(run):
    write("a.csv", rows(300))
    pq.write_table(pa.table({"t": [0.0, 1.0], "SP": [1.0, 1.0], "PV": [1.0, 2.0]}), "a.parquet")
    assert names(run("analyze", "a.csv", "a.parquet", "--json", "--no-fit")[1]) == ["a.csv", "a.parquet"]
    assert names(run("analyze", "a.csv", "a.csv", "--json", "--no-fit")[1]) == ["a", "a (2)"]
    write("FIC1.csv", WIDE)
    write("FIC12.csv", WIDE)
    listed = names(run("analyze", "FIC1.csv", "FIC12.csv", "--json", "--no-fit")[1])
    assert listed == ["FIC1", "FIC1/FIC2", "FIC12/FIC1", "FIC12/FIC2"]
    assert names(run("analyze", "no.csv", "x/no.csv", "--json", "--no-fit")[1]) == ["no", "x/no"]


EVIL = "=FIC\x1b]0;owned\x07\x1b[2J\x9b31m\u202e1\r<script>alert(1)</script>[red]"
"""Text that a terminal would obey, a spreadsheet compute, a browser run, and Rich take for its own."""


@pytest.fixture
def evil():
    """A Parquet file: its columns are named as nobody should."""
    k = np.arange(600.0)
    pv = 50 + np.sin(k / 17) + 0.3 * np.sin(k / 5)
    op = 55 + 0.8 * (50 - pv) + np.cumsum(0.8 / 25 * (50 - pv))
    columns = {"t": k, f"{EVIL}.SP": np.full(600, 50.0), f"{EVIL}.PV": pv, f"{EVIL}.OP": op}

    def write(path):
        pq.write_table(pa.table(columns), path)
        return path

    return write


def harmless(text):
    return not [c for c in text if c != "\n" and unicodedata.category(c) in ("Cc", "Cf")]


@pytest.mark.slow
@pytest.mark.parametrize(
    "words",
    [
        ["analyze", "plant.parquet"],
        ["analyze", "plant.parquet", "no\x1b[31m.csv", "--no-fit"],
        ["analyze", "plant.parquet", "--no-fit", "--csv", "-"],
        ["analyze", "plant.parquet", "--no-fit", "--json"],
        ["analyze", "plant.parquet", "--loop", "\x1b[31m"],
        ["identify", "plant.parquet"],
        ["init", "plant.parquet"],
        ["explain", "plant.parquet"],
        ["explain", "plant.parquet", "--at", "300"],
        ["step-test", "plant.parquet", "--manual"],
        ["step-test", "plant.parquet", "--manual", "--json"],
        ["analyze", "plant.parquet", "--report", "no\x1b[31m/x.html"],
        ["init", "plant.parquet", "-o", "a\x1b[31m.toml"],
    ],
)
def test_no_control_character_gets_out(run, evil, words):
    evil("plant.parquet")
    _, out, err = run(*words)
    assert out or err
    assert harmless(out + err), repr(out + err)
    if words in (["analyze", "plant.parquet"], ["identify", "plant.parquet"]):
        assert "\\x1b[2J\\x9b31m" in out + err  # shown, not left out


@pytest.mark.slow
def test_a_terminal_obeys_nothing_but_our_own_styles(evil, tmp_path):
    """On a terminal Rich writes escapes of its own; those of names are shown, and their brackets are no markup."""
    evil(tmp_path / "plant.parquet")
    pty = pytest.importorskip("pty")
    main, other = pty.openpty()
    env = os.environ | {"TERM": "xterm-256color", "COLUMNS": "200"}
    done = subprocess.Popen(
        [*GLAPP, "analyze", "plant.parquet", "--no-fit"], cwd=tmp_path, env=env, stdout=other, stderr=other
    )
    os.close(other)
    shown = b""
    while True:
        try:
            part = os.read(main, 65536)
        except OSError:
            break
        if not part:
            break
        shown += part
    done.wait(60)
    os.close(main)
    text = re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", shown.decode()).replace("\r\n", "\n").replace("\r", "")
    assert "\x1b[2J" not in shown.decode() and "owned\x07" not in shown.decode()
    assert harmless(text), repr(text)
    assert "[red]" in text.replace("\n", "")


@pytest.mark.slow
def test_a_table_computes_nothing(run, evil):
    evil("plant.parquet")
    write("-2+3.csv", rows(300))
    write("+1.csv", rows(300))
    write("@x.csv", rows(300))
    write("FIC-1.csv", rows(300))
    _, out, _ = run("analyze", "plant.parquet", "./-2+3.csv", "+1.csv", "@x.csv", "FIC-1.csv", "--no-fit", "--csv", "-")
    table = list(csv.reader(io.StringIO(out)))
    for row in table:
        for cell in row:
            assert not cell.startswith(("=", "@", "\t", "\r"))
            if cell.startswith(("+", "-")):
                float(cell)  # a number is a number
    loops = [row[0] for row in table[1:]]
    assert loops[0].startswith("'=FIC\\x1b")
    assert loops[1:] == ["'-2+3", "'+1", "'@x", "FIC-1"]


@pytest.mark.slow
def test_a_report_runs_nothing(run, evil):
    evil("plant.parquet")
    write("<img src=x onerror=alert(1)>.csv", rows(300))
    run("analyze", "plant.parquet", "<img src=x onerror=alert(1)>.csv", "--report", "r.html")
    page = Path("r.html").read_text()
    assert "<script>alert(1)" not in page
    assert "<img src=x" not in page
    assert page.count("alert(1)") > 2  # told, as text
    page = re.sub(r"<script>.*?</script>", "", page, flags=re.DOTALL)  # the figures are JSON, in scripts with a type
    assert harmless(page) and page.count("\\u202e1") > 3, "the turn of direction is shown in text and figures"


@pytest.mark.slow
def test_a_fleet_shows_names_as_the_rest_does(run, evil, tmp_path):
    """The name of a loop, of an area and of a file that cannot be read, on the terminal and in the report."""
    lake = tmp_path / "lake"
    (lake / f"loop={quote(EVIL, safe='')}").mkdir(parents=True)
    evil(tmp_path / "plant.parquet")
    table = pq.read_table(tmp_path / "plant.parquet")
    time = pa.array(np.arange(600) * 1_000_000 + 1_790_000_000_000_000).cast(pa.timestamp("us", tz="UTC"))
    names = ["t", *(f"FIC1.{name}" for name in ("SP", "PV", "OP"))]
    pq.write_table(table.set_column(0, "t", time).rename_columns(names), lake / "good.parquet")
    (lake / f"loop={quote(EVIL, safe='')}" / "x.parquet").write_bytes(b"no Parquet")
    code, out, err = run("fleet", "analyze", str(lake), "--out", "results", "--fits", "1")
    assert code == 1 and "(1 of them refused)" in out and harmless(out + err), repr(out + err)
    page = Path("results/report.html").read_text(encoding="utf-8").replace("<wbr>", "")
    assert harmless(page) and "<script>alert(1)" not in page and "\\u202e1" in page


def test_what_a_spreadsheet_computes_in_any_width_is_text():
    for begin in ("=", "+", "-", "@", "\t=", "\uff1d", "\uff0b", "\uff0d", "\uff20"):
        assert for_spreadsheet(f"{begin}1+1").startswith("'")
    assert harmless(for_spreadsheet(f"\u200b{EVIL}"))


@pytest.mark.slow
def test_a_first_loops_toml_of_such_names_can_be_parsed(evil, tmp_path):
    path = evil(tmp_path / "a\nb\x1b.parquet")
    text = settings_of(open_recordings(path))
    assert harmless(text)
    [loop] = parse_settings(text, "loops.toml", tmp_path)
    assert loop.name == EVIL and loop.columns.pv == f"{EVIL}.PV"


@pytest.fixture
def strange(tmp_path):
    """Paths that open and never end, with what each of them is."""
    paths = {"/dev/zero": "a device", "/dev/null": "a device"}
    for name in ("pipe.csv", "pipe.toml", "pipe"):
        os.mkfifo(tmp_path / name)
        paths[str(tmp_path / name)] = "a pipe"
    (tmp_path / "link.csv").symlink_to(tmp_path / "pipe.csv")
    paths[str(tmp_path / "link.csv")] = "a pipe"
    made = socket.socket(socket.AF_UNIX)
    here = Path.cwd()
    os.chdir(tmp_path)  # a socket's name is short
    made.bind("s.csv")
    os.chdir(here)
    paths[str(tmp_path / "s.csv")] = "a socket"
    yield paths
    made.close()


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="no pipes and devices in its folders")
def test_pipes_sockets_and_devices_are_refused_by_name(strange):
    """A pipe hung until somebody wrote into it, and /dev/zero was 'empty'."""
    done = subprocess.run([*GLAPP, "analyze", *strange], capture_output=True, text=True, timeout=120)
    assert done.returncode == 1
    for path, what in strange.items():
        assert f"error: {path}: is {what}, not a file; a recording is read more than once" in done.stderr
    done = subprocess.run([*GLAPP, "init", next(p for p in strange if "pipe" in p)], capture_output=True, timeout=120)
    assert done.returncode == 1


def test_standard_input_is_not_taken_for_a_file(run):
    code, _, err = run("analyze", "-")
    assert (code, err) == (1, "error: -: no such file; standard input is not read: write it to a file, and name that\n")


def test_a_folder_is_refused(tmp_path):
    with pytest.raises(InputError, match="is a directory; name the files in it"):
        open_recordings(tmp_path)
    (tmp_path / "x.toml").mkdir()
    with pytest.raises(InputError, match="is a directory"):
        read_settings(tmp_path / "x.toml")


@pytest.mark.slow
def test_a_time_read_as_a_day_number_is_noted_beside_the_answer(run):
    write("plant.csv", rows(600, time=lambda k: f"{45000.5 + k / 86400:.8f}"))
    _, out, _ = run("analyze", "plant.csv", "--json", "--no-fit")
    [loop] = json.loads(out)["loops"]
    [found] = [f for f in loop["quality"] if f["code"] == "time_assumed"]
    assert found["severity"] == "info" and "column 't' begins at 45000.50000000 and steps by 1.157" in found["text"]
    assert "read as a spreadsheet's day numbers, 2023-03-15 12:00:00" in found["text"]
    write("plant.csv", rows(600, time=lambda k: f"{45000.5 + k * 0.04:.2f}"))
    _, out, _ = run("analyze", "plant.csv", "--no-fit")
    assert "read as seconds; if these are a spreadsheet's day numbers, 2023-03-15" in " ".join(out.split())
    assert run("analyze", "plant.csv", "--no-fit", "--time-format", "seconds")[1].count("spreadsheet") == 0


def test_settings_say_what_the_times_count(tmp_path):
    path = tmp_path / "plant.csv"
    path.write_text(rows(600))
    [recording] = open_recordings(path, [Loop(name="plant", time_format="minutes")])
    assert next(recording.batches()).t[:3].tolist() == [0, 60, 120]
