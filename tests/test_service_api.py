"""The API: rights of the roles, refused requests, and the log of all commands."""

import asyncio
import json
import os
import re
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

import httpx
import pytest
import service
from argon2 import PasswordHasher
from fastapi.testclient import TestClient
from service import BEGIN, Clock, fed, loops, values

from glapp.errors import InputError
from glapp.service import api as of_api
from glapp.service.api import ApiServer, _Api, app_of, hosts_of
from glapp.service.monitor import Monitor
from glapp.service.signal import Signal, Value
from glapp.service.store import Reader, Store, backup, restore
from glapp.service.users import (
    PACE,
    PLACES,
    SHORTEST,
    Person,
    Refused,
    RefusedLogins,
    Role,
    Users,
    first_user,
    station_key,
)

PASSWORDS = {"vera": "viewer-password", "olaf": "operator-password", "eve": "engineer-password"}
ROLES = {"vera": "viewer", "olaf": "operator", "eve": "engineer"}
CHEAP = PasswordHasher(time_cost=1, memory_cost=8, parallelism=1)


@pytest.fixture
def monitor(tmp_path: Path) -> Iterator[Monitor]:
    clock = Clock()
    one = service.monitor(tmp_path, loops(2), clock)
    fed(one, clock, values("FIC0", 200), pace=20.0)
    yield one
    one.store.close()


@pytest.fixture
def client(monitor: Monitor) -> TestClient:
    users = Users(monitor.store, CHEAP)
    for name, role in ROLES.items():
        users.put(name, role, PASSWORDS[name], BEGIN)
    return TestClient(app_of(monitor, users), base_url="http://127.0.0.1")


def header(client: TestClient, name: str) -> dict[str, str]:
    reply = client.post("/login", json={"user": name, "password": PASSWORDS[name]})
    assert reply.status_code == 200
    return {"Authorization": f"Bearer {reply.json()['token']}"}


COMMANDS = [
    ("POST", "/loops/FIC0/parameters", {"values": {"kp": 3.0}}, "engineer"),
    ("POST", "/loops/FIC0/enable", {}, "engineer"),
    ("POST", "/loops/FIC0/watchdog-test", {}, "engineer"),
    ("POST", "/loops/FIC0/disable", {}, "operator"),
    ("POST", "/loops/FIC0/fit", {}, "operator"),
    ("POST", "/loops/FIC0/take_over", {"answer": 1}, "engineer"),
    ("PUT", "/users/mallory", {"role": "engineer", "password": "mallory-password"}, "engineer"),
    ("DELETE", "/users/eve", None, "engineer"),
    ("GET", "/users", None, "engineer"),
]
LOOKS = [
    "/status",
    "/live",
    "/loops/FIC0/half_periods",
    f"/loops/FIC0/signals?begin={BEGIN}&end={BEGIN + 100}",
    "/loops/FIC0/parameters",
    "/loops/FIC0/answers",
    "/events",
    "/commands",
]


@pytest.mark.parametrize(("method", "path", "body", "needed"), COMMANDS)
def test_a_role_that_is_too_low_is_refused_and_put_down(
    client: TestClient, monitor: Monitor, method: str, path: str, body: object, needed: str
) -> None:
    before = monitor.commands.settings("FIC0")
    for name in ("vera",) if needed == "operator" else ("vera", "olaf"):
        reply = client.request(method, path, json=body, headers=header(client, name))
        assert reply.status_code == 403 and needed in reply.json()["detail"]
        last = monitor.reader.commands()[0]
        assert (last["person"], last["role"]) == (name, ROLES[name]) and needed in last["refused"]
    assert monitor.commands.settings("FIC0") == before
    assert {row["name"] for row in monitor.reader.rows("SELECT name FROM users")} == set(ROLES)


@pytest.mark.parametrize("shown", [None, "", "Bearer ", "Bearer x", "Basic ZXZlOnB3", "Bearer ' OR 1=1 --"])
@pytest.mark.slow
def test_without_a_token_nothing_is_shown(client: TestClient, shown: str | None) -> None:
    for path in LOOKS + [path for method, path, _, _ in COMMANDS if method == "GET"]:
        reply = client.get(path, headers={} if shown is None else {"Authorization": shown})
        assert reply.status_code == 401 and reply.json() == {"detail": "log in first"}


def test_a_viewer_sees_everything(client: TestClient) -> None:
    vera = header(client, "vera")
    for path in LOOKS:
        reply = client.get(path, headers=vera)
        assert reply.status_code == 200 and reply.headers["cache-control"] == "no-store", path


def test_a_loop_may_have_any_name(tmp_path: Path) -> None:
    """A slash in a name was part of the path, and nothing was found."""
    clock = Clock()
    [plain] = loops(1)
    one = service.monitor(tmp_path, [plain.model_copy(update={"name": "Area 1/FIC0"})], clock)
    fed(one, clock, values("Area 1/FIC0", 100), pace=20.0)
    users = Users(one.store, CHEAP)
    users.put("eve", "engineer", PASSWORDS["eve"], BEGIN)
    client = TestClient(app_of(one, users), base_url="http://127.0.0.1")
    eve = header(client, "eve")
    assert client.get("/loops/Area%201%2FFIC0/parameters", headers=eve).json()["kp"] == 2.0
    assert client.post("/loops/Area%201%2FFIC0/fit", headers=eve).json() == {"asked": "Area 1/FIC0"}
    one.store.close()


def test_live_values_may_be_waited_for(client: TestClient, monitor: Monitor, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("glapp.service.api.LONGEST", 0.1)
    vera = header(client, "vera")
    pv = client.get("/live?loop=FIC0", headers=vera).json()["FIC0"]["pv"]["time"]
    assert (
        monitor.ingest.newer("FIC0", pv - 1.0)
        and not monitor.ingest.newer("FIC0", pv)
        and not monitor.ingest.newer("FIC1", 0.0)
    )
    began = time.monotonic()
    assert client.get(f"/live?loop=FIC0&after={pv}", headers=vera).json()["FIC0"]["pv"]["time"] == pv
    assert time.monotonic() - began >= 0.1  # nothing newer came
    assert client.get(f"/live?after={pv}", headers=vera).status_code == 200  # who names no loop does not wait

    monkeypatch.setattr("glapp.service.api.LONGEST", 60.0)

    async def comes() -> float:
        transport = httpx.ASGITransport(app=client.app)
        async with httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1", headers=vera) as asking:
            waiting = asyncio.ensure_future(asking.get(f"/live?loop=FIC0&loop=FIC1&after={pv}"))
            await asyncio.sleep(0)
            monitor.ingest.take([Value("FIC0", Signal.PV, pv + 1.0, 51.0, True)])
            return (await waiting).json()["FIC0"]["pv"]["time"]

    assert asyncio.run(comes()) == pv + 1.0


def test_signals_are_there_whether_they_are_saved_or_not(client: TestClient, monitor: Monitor) -> None:
    vera = header(client, "vera")
    path = f"/loops/FIC0/signals?begin={BEGIN + 5}&end={BEGIN + 100}"
    before = client.get(path, headers=vera).json()
    asyncio.run(monitor.save())
    assert client.get(path, headers=vera).json() == before
    assert before["time"] == [BEGIN + k for k in range(5, 101)] and before["every"] == 1
    fewer = client.get(f"{path}&most=10", headers=vera).json()
    assert fewer["every"] == 10 and fewer["PV"] == before["PV"][::10]


def test_a_command_of_a_page_that_is_no_longer_true_is_refused(client: TestClient, monitor: Monitor) -> None:
    eve = header(client, "eve")
    for path, body in (("enable", {}), ("take_over", {"answer": 1})):
        reply = client.post(f"/loops/FIC0/{path}", json={**body, "seen": {"kp": 3.0}}, headers=eve)
        assert reply.status_code == 409 and "somebody else has changed it" in reply.json()["detail"]
        assert "changed it" in monitor.reader.commands()[0]["refused"]
        as_it_is = client.post(f"/loops/FIC0/{path}", json={**body, "seen": {"kp": 2.0}}, headers=eve)
        assert as_it_is.status_code == 409 and "changed it" not in as_it_is.json()["detail"]


def test_a_change_is_put_down_with_person_when_before_and_after(client: TestClient, monitor: Monitor) -> None:
    eve = header(client, "eve")
    reply = client.post("/loops/FIC0/parameters", json={"values": {"kp": 3.0}, "seen": {"kp": 2.0}}, headers=eve)
    assert reply.status_code == 200 and reply.json()["kp"] == 3.0
    stale = client.post("/loops/FIC0/parameters", json={"values": {"kp": 4.0}, "seen": {"kp": 2.0}}, headers=eve)
    assert stale.status_code == 409 and "somebody else has changed it" in stale.json()["detail"]
    wrong = client.post("/loops/FIC0/parameters", json={"values": {"n": 4}}, headers=eve)
    assert wrong.status_code == 409 and "must be odd" in wrong.json()["detail"]
    none = client.post("/loops/FIC0/enable", json={}, headers=eve)
    assert none.status_code == 409 and "no node for u_FF" in none.json()["detail"]
    found = client.get("/commands", headers=eve).json()
    assert [(row["command"], row["refused"] is None) for row in found] == [
        ("enable", False),
        ("change", False),
        ("change", False),
        ("change", True),
    ]
    done = found[-1]
    assert (done["person"], done["before"], done["after"]) == ("eve", {"kp": 2.0}, {"kp": 3.0})
    assert monitor.commands.settings("FIC0")["kp"] == 3.0


def test_what_is_asked_wrongly_is_refused(client: TestClient) -> None:
    eve = header(client, "eve")
    post = [
        ("/loops/NONE/parameters", {"values": {"kp": 1.0}}, 404),
        ("/loops/FIC0/parameters", {}, 422),
        ("/loops/FIC0/parameters", {"values": {}}, 422),
        ("/loops/FIC0/parameters", {"values": {"kp": "many"}}, 422),
        ("/loops/FIC0/parameters", {"values": {"kp": 1.0}, "more": 1}, 422),
        ("/loops/FIC0/take_over", {"answer": 99}, 409),
        ("/loops/FIC0/take_over", {"answer": -1}, 422),
    ]
    for path, body, code in post:
        assert client.post(path, json=body, headers=eve).status_code == code, path
    infinite = client.post(
        "/loops/FIC0/parameters",
        content='{"values": {"kp": Infinity}}',
        headers={**eve, "Content-Type": "application/json"},
    )
    assert infinite.status_code == 422
    large = client.post("/loops/FIC0/parameters", content=b" " * 70_000, headers=eve)
    assert large.status_code == 413
    for path in ("/loops/..%2F..%2Fetc/answers", "/loops/NONE/signals?begin=0&end=1", "/answers/1"):
        assert client.get(path, headers=eve).status_code == 404, path
    assert client.get("/loops/FIC0/signals?begin=0&end=1e12", headers=eve).status_code == 422


@pytest.mark.slow
def test_a_request_to_another_name_is_refused(client: TestClient) -> None:
    """A page elsewhere may have its own name stand for this computer."""
    assert client.get("/status", headers={**header(client, "eve"), "Host": "evil.example"}).status_code == 400


def test_a_name_that_others_ask_by_is_taken(monitor: Monitor) -> None:
    """Regression: at 0.0.0.0 the API answered nobody but this computer, since no other name could be given."""
    app = app_of(monitor, Users(monitor.store, CHEAP), hosts=hosts_of("0.0.0.0", ["plant.example"]))
    with TestClient(app, base_url="https://plant.example:8107") as client:
        assert client.get("/status").status_code == 401
        assert client.get("/status", headers={"Host": "evil.example"}).status_code == 400


def test_login(client: TestClient, monitor: Monitor) -> None:
    for user, password in (("eve", "wrong"), ("nobody", "wrong"), ("eve", ""), ("' OR 1=1 --", "x")):
        reply = client.post("/login", json={"user": user, "password": password})
        assert (reply.status_code, reply.json()["detail"]) == (401, "wrong name or password")
    eve = header(client, "eve")
    assert client.get("/status", headers=eve).status_code == 200
    assert client.post("/logout", json={}, headers=eve).status_code == 200
    assert client.get("/status", headers=eve).status_code == 401
    kept = json.dumps([dict(row) for row in monitor.store._db.execute("SELECT * FROM users")])
    assert not any(password in kept for password in PASSWORDS.values()) and "$argon2id$" in kept
    assert monitor.reader.rows("SELECT * FROM tokens") == []
    assert not [row for row in monitor.reader.commands() if row["command"] == "login"], "they are counted"


def log_in(users: Users, name: str, password: str, now: float, address: str = "10.0.0.7") -> tuple[str, Person]:
    return users.log_in(users.attempt(name, address, now), password, now)


def test_passwords_cannot_be_tried_without_end(monitor: Monitor) -> None:
    users = Users(monitor.store, CHEAP)
    users.put("eve", "engineer", PASSWORDS["eve"], BEGIN)
    for k in range(5):
        with pytest.raises(Refused, match="wrong name or password"):
            log_in(users, "eve", f"guess {k}", BEGIN + k)
    for address in ("10.0.0.7", "10.0.0.8"):
        with pytest.raises(Refused, match=r"too many wrong passwords: wait 29\d s"):
            log_in(users, "eve", PASSWORDS["eve"], BEGIN + 5, address)
    assert log_in(users, "eve", PASSWORDS["eve"], BEGIN + 301)[1].name == "eve"


def test_a_password_counts_as_tried_before_it_is_checked(monitor: Monitor) -> None:
    """Regression: of 120 passwords in parallel 30 were checked, and not 5."""
    users = Users(monitor.store, CHEAP)
    users.put("eve", "engineer", PASSWORDS["eve"], BEGIN)
    looked_at = 0

    def guess(k: int) -> None:
        nonlocal looked_at
        with suppress(Refused):
            attempt = users.attempt("eve", f"10.0.{k}.7", BEGIN)
            looked_at += 1
            users.log_in(attempt, f"guess {k}", BEGIN)

    with ThreadPoolExecutor(30) as many:
        list(many.map(guess, range(120)))
    assert looked_at == 5


def test_no_number_of_names_and_addresses_takes_a_count_away(monitor: Monitor) -> None:
    """More than a thousand names cleared the table."""
    users = Users(monitor.store, CHEAP)
    users.put("eve", "engineer", PASSWORDS["eve"], BEGIN)
    for k in range(5):
        users.attempt("eve", f"10.1.0.{k}", BEGIN)
    for k in range(20_000):
        with suppress(Refused):
            users.attempt(f"name {k}", f"10.2.{k // 250}.{k % 250}", BEGIN)
    with pytest.raises(Refused, match="too many"):
        users.attempt("eve", "10.3.0.1", BEGIN)
    tries = users._tries
    assert len(tries._names) <= PLACES and len(tries._addresses) <= PLACES
    assert all(len(one) <= 10 for counts in (tries._names, tries._addresses) for one in counts.values())


def test_an_address_tries_ten_passwords_whatever_the_names(monitor: Monitor) -> None:
    users = Users(monitor.store, CHEAP)
    for k in range(10):
        users.attempt(f"name {k}", "10.0.0.7", BEGIN)
    with pytest.raises(Refused, match="too many"):
        users.attempt("somebody else", "10.0.0.7", BEGIN)
    assert users.attempt("somebody else", "10.0.0.8", BEGIN).wait == 0.0


def test_who_logged_in_from_an_address_is_slowed_there_and_not_shut_out(monitor: Monitor) -> None:
    """Five wrong tries of a stranger locked the engineer out."""
    users = Users(monitor.store, CHEAP)
    users.put("eve", "engineer", PASSWORDS["eve"], BEGIN)
    users.put("vera", "viewer", PASSWORDS["vera"], BEGIN)
    log_in(users, "eve", PASSWORDS["eve"], BEGIN, "10.0.0.7")
    for again in (users, Users(monitor.store, CHEAP)):  # and after a start of the service
        for k in range(100):
            with suppress(Refused):
                again.attempt("eve", f"10.1.0.{k}", BEGIN)  # strangers
        with pytest.raises(Refused, match="too many"):
            again.attempt("eve", "10.9.0.1", BEGIN)
        waits = [again.attempt("eve", "10.0.0.7", BEGIN) for _ in range(120)]  # her own, or of who shares her address
        assert [one.wait for one in waits] == [0.0] * 5 + [PACE] * 115
        assert sum(not one.displaced for one in waits) == 6, "of those that wait the newest alone is looked at"
        last = again.attempt("eve", "10.0.0.7", BEGIN + 1.0)
        assert last.wait == PACE - 1.0 and waits[-1].displaced
        assert again.log_in(last, PASSWORDS["eve"], BEGIN + 2.0)[1].name == "eve"
    log_in(users, "vera", PASSWORDS["vera"], BEGIN, "10.0.0.9")
    for k in range(40):  # who may log in somewhere tries another's password there: as a stranger of that name
        with suppress(Refused):
            users.attempt("olaf", "10.0.0.9", BEGIN + k)
    with pytest.raises(Refused, match="too many"):
        users.attempt("olaf", "10.0.0.9", BEGIN + 40)


def test_a_right_password_takes_no_wrong_ones_away(monitor: Monitor) -> None:
    """Whoever may log in would else have guesses without end between two logins of his own."""
    users = Users(monitor.store, CHEAP)
    users.put("vera", "viewer", PASSWORDS["vera"], BEGIN)
    for k in range(4):
        users.attempt("eve", "10.0.0.7", BEGIN + k)
    for k in range(20):
        log_in(users, "vera", PASSWORDS["vera"], BEGIN + 4 + k)
    users.attempt("eve", "10.0.0.7", BEGIN + 30)
    with pytest.raises(Refused, match="too many"):
        users.attempt("eve", "10.0.0.7", BEGIN + 31)


def test_a_password_that_is_changed_while_it_is_looked_at_is_wrong(monitor: Monitor) -> None:
    users = Users(monitor.store, CHEAP)
    users.put("eve", "engineer", PASSWORDS["eve"], BEGIN)

    class Slow:
        def verify(self, digest: str, password: str) -> bool:
            users.put("eve", "engineer", "another password", BEGIN)
            return CHEAP.verify(digest, password)

        hash = CHEAP.hash

    users._hasher = Slow()  # type: ignore[assignment]
    with pytest.raises(Refused, match="wrong name or password"):
        log_in(users, "eve", PASSWORDS["eve"], BEGIN)
    assert monitor.store.rows("SELECT * FROM tokens") == []


def test_refused_logins_are_counted_and_told_together(monitor: Monitor) -> None:
    users = Users(monitor.store, CHEAP)
    users.put("eve", "engineer", PASSWORDS["eve"], BEGIN)
    app = app_of(monitor, users)
    refused: RefusedLogins = app.state.refused_logins
    refused.every = 0.05

    async def go() -> None:
        transport = httpx.ASGITransport(app=app, client=("10.0.0.7", 1))
        async with httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1") as stranger:
            for k in range(40):
                body = {"user": "eve" if k % 2 else f"secret {k}", "password": f"guess {k}"}
                assert (await stranger.post("/login", json=body)).status_code == 401
        await asyncio.sleep(0.1)
        monitor.journal._repeated.clear()
        await monitor.step()

    asyncio.run(go())
    events = [row["text"] for row in monitor.reader.events() if row["kind"] == "logins_refused"]
    assert "a login was refused: as a name that is no user's, from 10.0.0.7" in events[-1]
    assert len(events) <= 2 and not any("guess" in text or "secret" in text for text in events)
    assert refused.total == 40 and not monitor.reader.commands()
    here = TestClient(app, base_url="http://127.0.0.1", client=("127.0.0.1", 1))
    assert "glapp_logins_refused_total 40.0" in here.get("/metrics").text
    monitor.store.forget(BEGIN * 10.0)
    assert not [row for row in monitor.reader.events() if row["kind"] == "logins_refused"]


def test_refused_logins_are_summed_up() -> None:
    refused = RefusedLogins()
    assert refused.add("eve", "10.0.0.7") == "a login was refused: as eve, from 10.0.0.7" and refused.since() is None
    for k in range(100):
        refused.add("eve" if k % 3 else None, f"10.0.0.{k % 7}")
    text = refused.since()
    assert text is not None and text.startswith("99 logins more were refused in 300 s: 2 names, of all 100 most (66)")
    assert refused.since() is None and refused.total == 101


def test_a_token_ends(monitor: Monitor) -> None:
    users = Users(monitor.store, CHEAP)
    users.put("eve", "engineer", PASSWORDS["eve"], BEGIN)
    users.put("olaf", "operator", PASSWORDS["olaf"], BEGIN)
    token, _ = log_in(users, "olaf", PASSWORDS["olaf"], BEGIN)
    assert users.of(token, BEGIN + 12 * 3600 - 1) is not None
    assert users.of(token, BEGIN + 12 * 3600 + 1) is None
    assert Users(monitor.store, CHEAP).of(token, BEGIN) is not None, "a service that is started again knows it"
    for change, password in (
        (lambda: users.put("olaf", "viewer", None, BEGIN), PASSWORDS["olaf"]),
        (lambda: users.put("olaf", "viewer", "another password", BEGIN), PASSWORDS["olaf"]),
        (lambda: users.remove("olaf"), "another password"),
    ):
        token, _ = log_in(users, "olaf", password, BEGIN)
        change()
        assert users.of(token, BEGIN) is None and monitor.store.rows("SELECT * FROM tokens") == []


def test_users_that_cannot_be(monitor: Monitor) -> None:
    users = Users(monitor.store, CHEAP)
    users.put("eve", "engineer", PASSWORDS["eve"], BEGIN)
    wrong = [
        ("", "viewer", "long enough to be", "1 to 64"),
        ("a\nb", "viewer", "long enough to be", "printable"),
        ("adam", "admin", "long enough to be", "viewer, operator or engineer"),
        ("adam", "viewer", "short", f"{SHORTEST} characters"),
        ("adam", "viewer", None, "is required"),
        ("eve", "viewer", None, "last engineer"),
    ]
    for name, role, password, text in wrong:
        with pytest.raises(InputError, match=text):
            users.put(name, role, password, BEGIN)
    with pytest.raises(InputError, match="last engineer"):
        users.remove("eve")
    with pytest.raises(InputError, match="no such user"):
        users.remove("adam")


@pytest.mark.skipif(sys.platform == "win32", reason="there rights are those of the folder")
def test_the_database_and_its_copies_are_their_owners_alone(tmp_path: Path) -> None:
    folder, copy = tmp_path / "data", tmp_path / "copy.db"
    mask = os.umask(0o000)
    try:
        with Store(folder) as store:
            store.know(loops(1))
            station_key(folder)
            backup(folder, copy)
            assert {path.name for path in folder.iterdir()} >= {"glapp.db", "glapp.db-wal", "glapp.db-shm"}
            for path in (copy, *(one for one in folder.iterdir() if one.name != "lock")):
                assert path.stat().st_mode & 0o077 == 0, path
        aside = restore(folder, copy)
        (folder / "glapp.db").chmod(0o644)  # as an older version left it
        with Store(folder):
            assert aside is not None
            for path in (aside, *folder.glob("glapp.db*")):
                assert path.stat().st_mode & 0o077 == 0, path
        (folder / "glapp.db").write_bytes(b"no database" * 100)
        with Store(folder) as store:
            assert store.found is not None
            for path in folder.glob("glapp.db*"):
                assert path.stat().st_mode & 0o077 == 0, path
    finally:
        os.umask(mask)


@pytest.mark.slow
def test_the_first_user(tmp_path: Path) -> None:
    store = Store(tmp_path)
    first_user(store, BEGIN)
    path = tmp_path / "first-login.txt"
    user, password = re.findall(r"^\w+ (\S+)$", path.read_text(), re.MULTILINE)
    assert log_in(Users(store), user, password, BEGIN)[1].role.name == "ENGINEER"
    assert path.stat().st_mode & 0o077 == 0
    path.unlink()
    first_user(store, BEGIN)
    assert not path.exists(), "there is one already"


def test_a_login_that_cannot_be_stored_says_why_and_what_to_do(client: TestClient, monitor: Monitor) -> None:
    """It said "not done", as if the name or the password were the matter."""
    eve = header(client, "eve")
    monitor.store._db.execute("PRAGMA query_only = ON")  # as a disk that takes no more
    reply = client.post("/login", json={"user": "eve", "password": PASSWORDS["eve"]})
    assert reply.status_code == 503
    assert "nobody can log in until the service can write: " in reply.json()["detail"]
    assert "make room on its disk, then log in again. Who is logged in stays so" in reply.json()["detail"]
    assert client.post("/login", json={"user": "eve", "password": "another"}).status_code == 401
    assert client.get("/status", headers=eve).status_code == 200
    monitor.store._db.execute("PRAGMA query_only = OFF")


@pytest.mark.slow
def test_a_command_that_cannot_be_put_down_is_not_done(client: TestClient, monitor: Monitor) -> None:
    eve = header(client, "eve")
    monitor.store._db.execute("PRAGMA query_only = ON")  # as a disk that takes no more
    reply = client.post("/loops/FIC0/parameters", json={"values": {"kp": 3.0}}, headers=eve)
    assert reply.status_code == 503 and "cannot be stored" in reply.json()["detail"]
    assert monitor.commands.settings("FIC0")["kp"] == 2.0
    monitor.store._db.execute("PRAGMA query_only = OFF")


def test_metrics(monitor: Monitor) -> None:
    users = Users(monitor.store, CHEAP)
    here = TestClient(app_of(monitor, users), base_url="http://127.0.0.1", client=("127.0.0.1", 1))
    text = here.get("/metrics").text
    numbers = dict(re.findall(r"^(\w+(?:\{[^}]*\})?) (\S+)$", text, re.MULTILINE))
    shown = monitor.status()["loops"]["FIC0"]
    assert float(numbers['glapp_half_periods_total{loop="FIC0"}']) == shown["half_periods"] > 0
    assert float(numbers['glapp_dead_band_estimate{loop="FIC0"}']) == shown["estimate"]
    away = TestClient(app_of(monitor, users), base_url="http://127.0.0.1", client=("10.1.2.3", 1))
    assert away.get("/metrics").status_code == 401


def test_the_api_is_on_this_computer_unless_there_is_tls(monitor: Monitor) -> None:
    app = app_of(monitor, Users(monitor.store, CHEAP))
    for host in ("0.0.0.0", "::", "192.168.1.5", "plant.example"):
        with pytest.raises(InputError, match="passwords would be readable"):
            ApiServer(app, host, 0)
    with pytest.raises(InputError, match="given together"):
        ApiServer(app, "127.0.0.1", 0, certificate=Path("x.pem"))
    with pytest.raises(InputError, match=r"x.pem: cannot be used"):
        ApiServer(app, "127.0.0.1", 0, certificate=Path("x.pem"), key=Path("x.key"))
    inner = ApiServer(app, "::1", 0)
    assert inner.url == f"http://[::1]:{inner.port}"  # regression: it was no URL
    inner._socket.close()
    api = ApiServer(app, "127.0.0.1", 0)
    with pytest.raises(InputError, match="cannot be listened at"):
        ApiServer(app, "127.0.0.1", api.port)
    api._socket.close()


@pytest.mark.slow
def test_served_and_closed(monitor: Monitor) -> None:
    import httpx

    async def go() -> None:
        api = ApiServer(app_of(monitor, Users(monitor.store, CHEAP)), "127.0.0.1", 0)
        serving = asyncio.create_task(api.open())
        async with httpx.AsyncClient(trust_env=False) as client:
            reply = await client.get(f"{api.url}/status")
            assert reply.status_code == 401
        serving.cancel()
        assert isinstance((await asyncio.gather(serving, return_exceptions=True))[0], asyncio.CancelledError)

    asyncio.run(go())


@pytest.mark.slow
def test_what_it_says_of_itself_is_whole(client: TestClient) -> None:
    paths = client.get("/openapi.json").json()["paths"]
    assert len(paths) > 15 and all(one.get("description") for path in paths.values() for one in path.values())


def test_a_reader_sees_what_the_writer_put_down(monitor: Monitor) -> None:
    with Reader(monitor.store.folder) as reader:
        assert reader.loops() == {"FIC0": 1, "FIC1": 2}


def test_what_a_command_has_checked_holds_until_it_is_done(monitor: Monitor, monkeypatch: pytest.MonkeyPatch) -> None:
    """Regression: of two that came together both found that none was under way, and both were done."""
    api, eve = _Api(monitor, Users(monitor.store, CHEAP)), Person("eve", Role.ENGINEER)
    under_way, most, done = 0, 0, []

    async def command(name: str, seconds: float) -> str:
        nonlocal under_way, most
        under_way += 1
        most = max(most, under_way)
        await asyncio.sleep(seconds)
        under_way -= 1
        done.append(name)
        return name

    async def both() -> None:
        nonlocal most
        asked = [api.done(eve, "enable", "FIC0", None, command(name, 0.05)) for name in ("first", "second")]
        assert await asyncio.gather(*asked) == ["first", "second"] and most == 1
        monkeypatch.setattr(of_api, "PATIENCE", 0.1)
        slow = asyncio.ensure_future(api.done(eve, "enable", "FIC0", None, command("slow", 1.0)))
        await asyncio.sleep(0.01)
        assert await api.done(eve, "disable", "FIC0", None, command("off", 0.0)) == "off"
        with pytest.raises(InputError, match=r"another command has not been done in 0\.1 s; try again"):
            await api.done(eve, "change", "FIC0", None, command("given up", 0.0))
        await slow

    asyncio.run(both())
    assert done == ["first", "second", "off", "slow"]
    assert "another command" in monitor.reader.commands("FIC0")[0]["refused"]
