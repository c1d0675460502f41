"""The API, asked anything that its own description allows and much that it does not: it answers, and never fails."""

from pathlib import Path
from typing import Any

import pytest
import service
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from service import BEGIN, Clock, fed, loops, values
from test_service_api import CHEAP, PASSWORDS, ROLES

schemathesis = pytest.importorskip("schemathesis")

from fastapi.testclient import TestClient  # noqa: E402

from glapp.service.api import app_of  # noqa: E402
from glapp.service.users import Users  # noqa: E402

EXAMPLES = 12

METHODS = ("GET", "POST", "PUT", "PATCH", "DELETE", "TRACE")


def undeclared(client: TestClient, description: str, headers: dict[str, str]) -> list[tuple[str, str, int]]:
    """Methods that are not described and are answered all the same, or refused without a word of those that are."""
    found = []
    base = description.removesuffix("/openapi.json")
    for path, methods in client.get(description).json()["paths"].items():
        url = base + path.replace("{name}", "FIC0").replace("{id}", "1").replace("{user}", "eve")
        for method in METHODS:
            if method.lower() not in methods:
                body = {"json": {}} if method in ("POST", "PUT") else {}
                reply = client.request(method, url, headers=headers, **body)
                if reply.status_code != 405 or not reply.headers.get("allow"):
                    found.append((method, url, reply.status_code))
    return found


@pytest.mark.slow
def test_a_method_that_is_not_described_is_not_answered(tmp_path: Path) -> None:
    monitor = service.monitor(tmp_path, loops(1), Clock())
    users = Users(monitor.store, CHEAP)
    users.put("eve", "engineer", PASSWORDS["eve"], BEGIN)
    client = TestClient(app_of(monitor, users, hosts=["testserver"]))
    login = client.post("/login", json={"user": "eve", "password": PASSWORDS["eve"]}).json()
    assert undeclared(client, "/openapi.json", {"Authorization": f"Bearer {login['token']}"}) == []
    monitor.store.close()


def asked(operation: Any, headers: dict[str, str]) -> set[int]:
    """Status codes of an API for requests as described, and for others."""
    statuses = set()
    negative = operation.as_strategy(generation_mode=schemathesis.GenerationMode.NEGATIVE)

    @settings(
        max_examples=EXAMPLES, derandomize=True, database=None, deadline=None, suppress_health_check=[*HealthCheck]
    )
    @given(case=st.one_of(operation.as_strategy(), negative), there=st.booleans())
    def ask(case: Any, there: bool) -> None:
        if there and "name" in case.path_parameters:
            case.path_parameters["name"] = "FIC0"
        reply = case.call(headers=headers)
        statuses.add(reply.status_code)
        assert reply.status_code < 500 and b"Traceback" not in reply.content, (operation.label, reply.content)
        if reply.status_code != 405:
            of = schemathesis.specs.openapi.checks
            checks = [of.status_code_conformance, of.content_type_conformance, of.response_schema_conformance]
            case.validate_response(reply, checks=checks)

    ask()
    return statuses


@pytest.mark.verify
@pytest.mark.parametrize("known", [True, False], ids=["engineer", "nobody"])
def test_any_request_is_answered(tmp_path: Path, known: bool) -> None:
    clock = Clock()
    monitor = service.monitor(tmp_path, loops(2), clock)
    fed(monitor, clock, values("FIC0", 200), pace=20.0)
    users = Users(monitor.store, CHEAP)
    app = app_of(monitor, users, hosts=["testserver"])
    client = TestClient(app)
    statuses = {}
    for found in schemathesis.openapi.from_asgi("/openapi.json", app).get_all_operations():
        operation = found.ok()
        for name, role in ROLES.items():
            users.put(name, role, PASSWORDS[name], BEGIN)
        headers = {}
        if known:
            login = client.post("/login", json={"user": "eve", "password": PASSWORDS["eve"]}).json()
            headers["Authorization"] = f"Bearer {login['token']}"
        statuses[operation.label] = asked(operation, headers)
    monitor.store.close()
    let_in = {label for label, seen in statuses.items() if 200 in seen}
    assert len(statuses) == 29, "every operation that is described"
    if known:
        assert len(let_in) >= 10, f"much of it is not refused: {statuses}"
    else:
        assert not let_in, "nothing without a token, from another computer"
