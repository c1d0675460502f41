"""The window's own HTTP interface: its answers to programs, and that it only reads."""

import json
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("nicegui")
pytest.importorskip("multipart")

import httpx
from fastapi import FastAPI
from fastapi.testclient import TestClient
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from station_child import PASSWORDS, made

from glapp.service.api import app_of as service_app
from glapp.service.monitor import Monitor
from glapp.service.users import TRIES_OF_ADDRESS
from glapp.station.api import api_of
from glapp.station.client import ApiClient
from glapp.station.pages import Station
from glapp.station.sessions import COOKIE, Guard
from glapp.station.view import View

HERE = "http://127.0.0.1"


@pytest.fixture(scope="module")
def plant(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Monitor, Station, Any]]:
    """A service, the window's interface on it, and the guard before that."""
    monitor, users = made(tmp_path_factory.mktemp("plant"))
    monitor.users = users
    monitor.store.show(time.time(), json.dumps(monitor.status()))
    api = ApiClient(monitor.store.folder, HERE)
    api._http = httpx.AsyncClient(transport=httpx.ASGITransport(app=service_app(monitor, users)))
    station = Station(View(monitor.store.folder), api)
    station._look()
    app = FastAPI()
    app.mount("/api", api_of(station))
    yield monitor, station, Guard(app, station.sessions, ("127.0.0.1",), secure=False)
    monitor.store.close()


@pytest.fixture
def client(plant: tuple[Monitor, Station, Any]) -> TestClient:
    return TestClient(plant[2], base_url=HERE)


def token(client: TestClient, name: str = "vera") -> dict[str, str]:
    reply = client.post("/api/login", json={"user": name, "password": PASSWORDS[name]})
    assert reply.status_code == 200 and "set-cookie" not in reply.headers
    return {"Authorization": f"Bearer {reply.json()['token']}"}


READS = ("/overview", "/loops/FIC0", "/loops/FIC0/detections", "/events")


@pytest.mark.slow
def test_a_program_reads_what_the_pages_show(client: TestClient, plant: tuple[Monitor, Station, Any]) -> None:
    monitor, station, _ = plant
    vera = token(client)
    document = client.get("/api/overview", headers=vera).json()
    assert [row["loop"] for row in document["loops"]] == [row.loop for row in station.listed.rows]
    assert document["whole"] and document["loops"][0]["width"] == "2.40 % (2.15 to 3.11)" and document["behind"] is None
    again = client.get(f"/api/overview?since={document['version']}", headers=vera).json()
    assert not again["whole"] and again["loops"] == [] and again["gone"] == []
    one = client.get("/api/loops/FIC0", headers=vera).json()
    assert one["row"] == document["loops"][0] and one["answer"]["width"] == 2.4
    found = client.get("/api/loops/FIC0/detections", headers=vera).json()
    rows = monitor.reader.half_periods("FIC0")
    assert len(rows) > 3 and found["time"] == pytest.approx([row["t_end"] for row in rows], abs=1e-3)
    assert found["width"] == pytest.approx([row["d"] for row in rows], rel=1e-5)
    assert found["compensated"] == [row["compensated"] for row in rows] and sum(found["compensated"]) == 2
    assert (found["unit"], found["percent"]) == ("%", 1.0)
    newest = client.get("/api/loops/FIC0/detections?most=2", headers=vera).json()
    assert newest["time"] == found["time"][-2:]
    assert any("<b>so</b> late" in row["text"] for row in client.get("/api/events", headers=vera).json())


def test_only_what_has_changed_is_told_again(client: TestClient, plant: tuple[Monitor, Station, Any]) -> None:
    _, station, _ = plant
    vera = token(client)
    before, rows = station.listed, list(station.listed.rows)
    station.listed = before.after(rows[1:])
    document = client.get(f"/api/overview?since={before.version}", headers=vera).json()
    assert (document["whole"], document["loops"], document["gone"]) == (False, [], [rows[0].loop])
    station.listed = station.listed.after(rows)
    document = client.get(f"/api/overview?since={before.version}", headers=vera).json()
    assert [row["loop"] for row in document["loops"]] == [rows[0].loop] and document["gone"] == []
    for since in (1, document["version"] + 1):  # of a window that ran before, or of none
        assert client.get(f"/api/overview?since={since}", headers=vera).json()["whole"]


@pytest.mark.parametrize("shown", [None, "Bearer ", "Bearer guess", "Basic ZXZlOnB3", "Bearer \xe9", "Bearer a\tb"])
@pytest.mark.slow
def test_without_a_token_nothing_is_told(client: TestClient, shown: str | None) -> None:
    for path in READS:
        headers = {} if shown is None else {"Authorization": shown.encode("latin-1")}
        assert client.get(f"/api{path}", headers=headers).status_code == 401, path


@pytest.mark.slow
def test_it_only_reads(client: TestClient) -> None:
    eve = token(client, "eve")
    for path in READS:
        for method in ("POST", "PUT", "PATCH", "DELETE"):
            assert client.request(method, f"/api{path}", headers=eve).status_code == 405, (method, path)
            ours = {**eve, "Origin": HERE}
            assert client.request(method, f"/api{path}", headers=ours).status_code == 405, (method, path)
    document = client.get("/api/openapi.json").json()
    changing = {path for path, methods in document["paths"].items() if methods.keys() - {"get"}}
    assert changing == {"/login"}


def test_a_method_that_is_not_described_is_not_answered(client: TestClient) -> None:
    """TRACE was refused by the guard with 403, and not as what nobody has described."""
    from test_service_anything import undeclared

    assert undeclared(client, "/api/openapi.json", token(client)) == []


def test_a_page_elsewhere_gets_nothing(client: TestClient, plant: tuple[Monitor, Station, Any]) -> None:
    _, station, _ = plant
    evil = {"Origin": "http://evil.example"}
    body = {"user": "eve", "password": PASSWORDS["eve"]}
    assert client.post("/api/login", json=body, headers=evil).status_code == 403
    bearer = token(client, "eve")["Authorization"].removeprefix("Bearer ")
    client.cookies.set(COOKIE, station.sessions.begin(bearer, "eve", "engineer", dark=False).id)
    assert client.get("/api/overview").status_code == 200  # as the pages ask
    assert client.get("/api/overview", headers=evil).status_code == 403
    assert "access-control-allow-origin" not in client.get("/api/overview").headers


def test_logins_count_by_the_address_they_come_from(plant: tuple[Monitor, Station, Any]) -> None:
    """The service counts them: of persons and of programs, and by the address that the station saw."""
    away = TestClient(plant[2], base_url=HERE, client=("10.0.0.7", 1))
    for i in range(TRIES_OF_ADDRESS):
        reply = away.post("/api/login", json={"user": f"u{i}", "password": "no"})
        assert (reply.status_code, reply.json()["detail"]) == (401, "wrong name or password")
    response = away.post("/api/login", json={"user": "eve", "password": PASSWORDS["eve"]})
    assert (
        response.status_code == 401 and "too many wrong passwords: wait " in response.json()["detail"]
    )  # on a slow machine less than 300 s
    for forged in ({"X-Forwarded-For": "10.0.0.8"}, {"Glapp-Address": "10.0.0.8", "Glapp-Station": "guess"}):
        again = away.post("/api/login", json={"user": "vera", "password": PASSWORDS["vera"]}, headers=forged)
        assert again.status_code == 401, forged
    assert (
        TestClient(plant[2], base_url=HERE, client=("10.0.0.9", 1))
        .post("/api/login", json={"user": "eve", "password": PASSWORDS["eve"]})
        .is_success
    )


@pytest.mark.slow
def test_a_token_reads_nothing_when_its_user_is_removed(
    client: TestClient, plant: tuple[Monitor, Station, Any]
) -> None:
    """Regression: the token was believed for ten seconds."""
    users = plant[0].users
    for change in (
        lambda: users.put("rick", "operator", None, time.time()),
        lambda: users.put("rick", "viewer", "another-password", time.time()),
        lambda: users.remove("rick"),
    ):
        users.put("rick", "viewer", "ricks-password", time.time())
        login = client.post("/api/login", json={"user": "rick", "password": "ricks-password"}).json()
        rick = {"Authorization": f"Bearer {login['token']}"}
        assert all(client.get(f"/api{path}", headers=rick).status_code == 200 for path in READS)
        change()
        assert all(client.get(f"/api{path}", headers=rick).status_code == 401 for path in READS)


def test_what_stands_behind_it_may_be_gone(tmp_path: Path) -> None:
    station = Station(View(tmp_path), ApiClient(tmp_path))
    client = TestClient(api_of(station), base_url=HERE)
    reply = client.get("/overview", headers={"Authorization": "Bearer x"})
    assert reply.status_code == 503 and "holds no glapp.db" in reply.json()["detail"]
    reply = client.post("/login", json={"user": "eve", "password": PASSWORDS["eve"]})
    assert reply.status_code == 503 and "api-url is not there" in reply.json()["detail"]
    session = station.sessions.begin("t", "eve", "engineer", dark=False)
    client.cookies.set(COOKIE, session.id)
    station._look()
    document = client.get("/overview").json()
    assert document["loops"] == [] and "holds no glapp.db" in document["why"]
    assert client.get("/events").status_code == 503
    assert client.get("/loops/FIC0").status_code == 404


def asked(operation: Any, headers: dict[str, str], station: Station, schemathesis: Any) -> set[int]:
    """Status codes for requests as described, and for others."""
    seen: set[int] = set()
    negative = operation.as_strategy(generation_mode=schemathesis.GenerationMode.NEGATIVE)
    of = schemathesis.specs.openapi.checks
    checks = [of.status_code_conformance, of.content_type_conformance, of.response_schema_conformance]

    @settings(max_examples=20, derandomize=True, database=None, deadline=None, suppress_health_check=[*HealthCheck])
    @given(case=st.one_of(operation.as_strategy(), negative), there=st.booleans())
    def ask(case: Any, there: bool) -> None:
        if there and "name" in case.path_parameters:
            case.path_parameters["name"] = "FIC0"
        reply = case.call(headers=headers)
        seen.add(reply.status_code)
        assert reply.status_code < 500, (case, reply.content)
        if reply.status_code != 405:
            case.validate_response(reply, checks=checks)

    ask()
    return seen


@pytest.mark.verify
@pytest.mark.parametrize("known", [True, False], ids=["viewer", "nobody"])
def test_any_request_is_answered_as_it_is_described(
    client: TestClient, plant: tuple[Monitor, Station, Any], known: bool
) -> None:
    schemathesis = pytest.importorskip("schemathesis")
    headers = {"Host": "127.0.0.1", **(token(client) if known else {})}
    schema = schemathesis.openapi.from_asgi("/api/openapi.json", plant[2], headers=headers)
    found = [one.ok() for one in schema.get_all_operations()]
    statuses = {one.label: asked(one, headers, plant[1], schemathesis) for one in found}
    assert len(statuses) == 5, "every operation that is described"
    let_in = {label for label, seen in statuses.items() if 200 in seen}
    assert len(let_in) == (4 if known else 0), statuses
