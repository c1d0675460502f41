"""`glapp watch` on the command line: its output, its refusals, and its end."""

import asyncio
import json
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import service
from service import BEGIN, Clock, fed, loops, values
from typer.testing import CliRunner

from glapp.cli import app, watch_run
from glapp.cli.screen import CommandError
from glapp.cli.watch import _printed
from glapp.errors import InputError
from glapp.folder_lock import FolderLock
from glapp.service.store import Reader, Store, StoreFull

HERE = Path(__file__).parent


def glapp(*words: object) -> str:
    result = CliRunner().invoke(app, ["watch", *map(str, words)])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    assert result.exit_code == 0, result.output
    return result.output


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    clock = Clock()
    monitor = service.monitor(tmp_path / "data", loops(2), clock)
    fed(monitor, clock, values("FIC0", 200), pace=20.0)
    monitor.store.show(clock.now, json.dumps(monitor.status()))
    monitor.store.command(clock.now, "eve", "engineer", "change", "FIC0", {"kp": 2.0}, {"kp": 3.0})
    monitor.store.close()
    return tmp_path / "data"


def test_numbers_of_the_api_are_printed_without_their_rounding() -> None:
    """`enable` said that delta is 0.9000000000000001, and `set` that a limit is 1e+37."""
    values = (0.6 * 1.5, 1e37, 1234567.25, None, 3, "typed")
    assert [_printed(value) for value in values] == ["0.9", "no limit", "1234567.25", "", "3", "typed"]


def test_a_full_disk_at_the_start_is_an_error_with_a_hint(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Regression: it ended with a traceback."""

    async def full(*_: object) -> None:
        raise StoreFull(f"{tmp_path}/glapp.db cannot be written: database or disk is full")

    monkeypatch.setattr(watch_run, "serve", full)
    with pytest.raises(InputError, match="disk is full; make room, then start it again"):
        glapp("run", "--demo", "--data", tmp_path)


@pytest.mark.slow
def test_help_teaches() -> None:
    text = re.sub(r"\s+", " ", glapp("--help"))
    for word in (
        "run",
        "status",
        "enable",
        "disable",
        "backup",
        "restore",
        "users",
        "glapp watch loops.toml --data plant",
    ):
        assert word in text
    for command in ("run", "status", "events", "backup", "restore", "login", "enable", "disable", "fit", "set"):
        assert "glapp watch" in glapp(command, "--help"), command


def test_status(folder: Path) -> None:
    text = glapp("status", "--data", folder)
    assert "nobody writes this folder" in text and re.search(r"FIC0 .* 2\.\d+ % .* of ", text)
    body = json.loads(glapp("status", "--data", folder, "--json"))
    assert body["runs"] is None and body["loops"]["FIC0"]["detections"] == 3
    store = Store(folder)
    assert "process" in glapp("status", "--data", folder)
    store.close()


def test_the_compensation_of_a_service_that_is_gone_is_not_known(folder: Path) -> None:
    """Regression: `status` went on showing it as active, with its last u_FF."""
    store = Store(folder)
    shown = store.shown()
    assert shown is not None
    at, body = shown
    body["loops"]["FIC0"]["compensation"] = {"standing": "active", "enabled": True, "u_ff": 0.5}
    store.show(at, json.dumps(body))
    assert "active, u_FF 0.5" in glapp("status", "--data", folder)
    store.close()
    text = glapp("status", "--data", folder)
    assert "not known" in text and "active" not in text and "u_FF" not in text


def test_events_and_commands(folder: Path) -> None:
    store = Store(folder)
    store.command(BEGIN, "eve", "engineer", "fit", "FIC0", None, None)
    store.command(BEGIN, "eve", "engineer", "remove_user", None, {"user": "anna"}, None)
    shown = glapp("events", "--data", folder, "--commands").splitlines()
    assert [line.split("eve (engineer) ")[1] for line in shown] == [
        "change FIC0: kp 2 → 3",  # regression: it was {'kp': 2.0} → {'kp': 3.0}
        "fit FIC0",
        "remove_user: anna",
    ]
    store.tell([service.Event(BEGIN, "FIC0", "late", "with \x1b[31m colour")])
    store.close()
    assert "\x1b" not in glapp("events", "--data", folder, "--loop", "FIC0")


def test_backup_and_restore(folder: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy.db"
    assert "Copied" in glapp("backup", copy, "--data", folder)
    (folder / "glapp.db").write_bytes(b"damaged")
    assert "Restored" in glapp("restore", copy, "--data", folder)
    with Reader(folder) as reader:
        assert len(reader.half_periods("FIC0")) > 3


def test_what_is_missing_is_said(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"holds no glapp\.db"):
        glapp("status", "--data", tmp_path)
    with pytest.raises(InputError, match=r"none\.toml"):
        glapp(tmp_path / "none.toml", "--data", tmp_path / "data")
    plain = tmp_path / "loops.toml"
    plain.write_text("[loops.FIC1]\n")
    with pytest.raises(InputError, match=r"has no table \[opcua\]"):
        glapp(plain, "--data", tmp_path / "data")
    assert not (tmp_path / "data").exists(), "nothing is begun"


def test_days_that_are_no_days_are_refused(tmp_path: Path) -> None:
    """Regression: `--keep -3` was taken for 1, and all signals but those of a day were deleted."""
    settings = tmp_path / "loops.toml"
    settings.write_text("[opcua]\nurl = 'opc.tcp://p:1'\n[loops.A.opcua]\npv = 'i=1'\nsp = 'i=2'\n")
    with pytest.raises(InputError, match="keep: is -3, must be 1 or more"):
        glapp(settings, "--data", tmp_path / "data", "--keep", "-3")


def test_the_status_names_the_connection_and_missing_tags(folder: Path) -> None:
    with Reader(folder) as reader:
        shown = reader.shown()
    assert shown is not None
    at, body = shown
    body |= {"unconnected": "opc.tcp://p: nobody listens there"}
    body["loops"]["FIC0"]["missing"] = "FIC0 PV: i=1: BadNodeIdUnknown"
    store = Store(folder)
    store.show(at, json.dumps(body))
    store.close()
    text = glapp("status", "--data", folder)
    assert "not connected: opc.tcp://p: nobody listens there" in text and "FIC0 PV: i=1: BadNodeIdUnknown" in text


def test_settings_of_our_own_server_that_do_not_fit_together(tmp_path: Path) -> None:
    for words, message in (
        (["--opcua-user", "dcs"], "--opcua-port: is needed"),
        (["--opcua-port", "0", "--opcua-user", "dcs"], "are given together"),
        (["--opcua-port", "0", "--opcua-user", "dcs", "--opcua-password-file", tmp_path / "none"], "cannot be read"),
    ):
        with pytest.raises((InputError, CommandError), match=message):
            glapp("--demo", "--data", tmp_path / "data", *words)
    assert not (tmp_path / "data").exists(), "nothing is begun"


def test_without_a_service_or_a_login(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    monkeypatch.delenv("GLAPP_TOKEN", raising=False)
    with pytest.raises(InputError, match="nobody is logged in; glapp watch login NAME"):
        glapp("disable", "FIC0")
    monkeypatch.setenv("GLAPP_TOKEN", "x")
    with pytest.raises(InputError, match="does not answer"):
        glapp("disable", "FIC0", "--api-url", "http://127.0.0.1:9")


@pytest.mark.verify
def test_the_demonstration_from_its_first_user_to_its_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A plant and its service, started, asked and stopped by the command line alone."""
    folder = tmp_path / "data"
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    log = tmp_path / "log"
    words = ["watch", "--demo", "--loops", "2", "--scan", "0.5", "--data", str(folder), "--port", "0"]
    words += ["--opcua-port", "0"]
    command = [sys.executable, str(HERE / "command_line.py"), *words]
    with log.open("w") as errors:
        child = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=errors, text=True)
    try:
        deadline = time.monotonic() + 180
        while time.monotonic() < deadline:
            time.sleep(0.2)
            if (folder / "glapp.db").exists() and (folder / "api-url").exists():
                with Reader(folder) as reader:
                    if reader.one("SELECT id FROM entries LIMIT 1"):
                        break
        else:
            raise AssertionError("no value came")
        api_url = (folder / "api-url").read_text()
        user, password = re.findall(r"^\w+ (\S+)$", (folder / "first-login.txt").read_text(), re.MULTILINE)
        logged_in = CliRunner().invoke(app, ["watch", "login", user, "--api-url", api_url], input=f"{password}\n")
        assert "Logged in as engineer" in logged_in.output and password not in logged_in.output
        assert (tmp_path / "glapp" / "token").stat().st_mode & 0o077 == 0
        assert re.search(r"comp_share\s+0\.8", glapp("set", "FIC101", "--api-url", api_url))
        assert re.search(r"comp_size\s+1\.5", glapp("set", "PIC102", "comp_size=1.5", "--api-url", api_url))
        with pytest.raises(InputError, match="must be"):
            glapp("set", "PIC102", "comp_share=1.5", "--api-url", api_url)
        with pytest.raises(InputError, match="glapp watch watchdog-test PIC102"):
            glapp("enable", "PIC102", "--api-url", api_url)
        glapp("watchdog-test", "PIC102", "--api-url", api_url)
        while "drilled" not in (events := glapp("events", "--data", folder)) and time.monotonic() < deadline + 60:
            time.sleep(0.2)
        assert "drilled PIC102: the plant took u_FF of 0.0625 away by itself" in events
        assert re.search(r"enabled\s+True", glapp("enable", "PIC102", "--api-url", api_url))
        assert re.search(r"enabled\s+False", glapp("disable", "PIC102", "--api-url", api_url))
        assert "engineer  engineer" in glapp("users", "list", "--api-url", api_url)
        with pytest.raises(InputError, match="is written by process"):
            FolderLock(folder)
    finally:
        child.send_signal(signal.SIGTERM)
        code = child.wait(90)
    assert code == 0
    assert child.stdout is not None
    printed = child.stdout.read()
    assert "Watching 2 loops" in printed and re.search(
        r"Answers and DeviceHealth at opc\.tcp://127\.0\.0\.1:\d+/", printed
    )
    child.stdout.close()
    logged = log.read_text()
    assert " connected: opc.tcp://" in logged and " drilled PIC102: the plant took" in logged, (
        "every event is there too"
    )
    assert FolderLock.holder(folder) is None
    with Reader(folder) as reader:
        assert reader.one("SELECT id FROM entries LIMIT 1") is None, "all is saved"
        kinds = [row["kind"] for row in reader.events()]
        assert "connected" in kinds and "enabled" in kinds
        assert [row["command"] for row in reader.commands() if row["refused"] is None] == [
            "disable",
            "enable",
            "drilled",
            "drill",
            "change",
        ]


def test_a_service_that_is_stopped_before_it_began(tmp_path: Path) -> None:
    """Cancelled at once, it still ends, and gives the folder back."""
    monitor = service.monitor(tmp_path, loops(), Clock())

    async def go() -> None:
        task = asyncio.create_task(monitor.run(service.Table()))
        await asyncio.sleep(0)
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)

    asyncio.run(go())
    monitor.store.close()
    assert FolderLock.holder(tmp_path) is None
