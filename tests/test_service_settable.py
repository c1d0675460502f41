"""All that may be set of a loop, by every way in: allowed up to both bounds, refused beyond, with nothing changed."""

import asyncio
import json
import math
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import service
from argon2 import PasswordHasher
from fastapi.testclient import TestClient
from service import BEGIN, Clock, fed, loops, values

from glapp import Loop, _glapp
from glapp.errors import InputError
from glapp.loop import Tags
from glapp.modules import BacklashDetection, Graph
from glapp.service.api import app_of
from glapp.service.compensation import Compensator, detection_beside
from glapp.service.monitor import Monitor
from glapp.service.settable import DETECTOR, SETTINGS, Bound, bounds_of
from glapp.service.store import backup, restore
from glapp.service.users import Users
from glapp.station.parameters import PARAMETERS

MOST = (5.0, 2.0)
CHEAP = PasswordHasher(time_cost=1, memory_cost=8, parallelism=1)
# All other settings can be made with these, and both widths count in turn.
GIVEN = {"comp_size": 2.0, "comp_fitted": 1.5}
# Settings, and the others that they need to count.
BESIDE: dict[str, dict[str, float]] = {"comp_size": {"comp_source": 1.0}}
CATALOGUE = json.loads((Path(__file__).parents[1] / "vectors" / "catalogue.json").read_text())
NAMES = (*DETECTOR, *SETTINGS)


@pytest.fixture
def monitor(tmp_path: Path) -> Iterator[Monitor]:
    clock = Clock()
    one = service.monitor(tmp_path, loops(2), clock, compensable={"FIC0": MOST})
    fed(one, clock, values("FIC0", 100), pace=20.0)
    yield one
    one.store.close()


@pytest.fixture
def client(monitor: Monitor) -> TestClient:
    users = Users(monitor.store, CHEAP)
    users.put("eve", "engineer", "engineer-password", BEGIN)
    client = TestClient(app_of(monitor, users), base_url="http://127.0.0.1")
    token = client.post("/login", json={"user": "eve", "password": "engineer-password"}).json()["token"]
    client.headers["Authorization"] = f"Bearer {token}"
    assert client.post("/loops/FIC0/parameters", json={"values": GIVEN}).status_code == 200
    return client


def beyond(bound: Bound) -> list[float]:
    """The nearest numbers that are out."""
    step = 1.0 if bound.whole else 0.0
    return [
        bound.high + step if step else math.nextafter(bound.high, math.inf),
        bound.low - step if step else math.nextafter(bound.low, -math.inf),
    ]


def tried(bound: Bound) -> list[float]:
    """0, -1, both bounds, just beyond them, far beyond them."""
    return [0.0, -1.0, bound.low, bound.high, *beyond(bound), 1e9, -1e9, 1e300]


def test_what_is_listed_is_all_there_is(client: TestClient) -> None:
    """A new parameter must be put into the listing, the window, and by that the tests below."""
    shown = client.get("/loops/FIC0/parameters").json()
    listed = client.get("/loops/FIC0/bounds").json()
    assert list(shown) == list(listed) == list(NAMES) == list(PARAMETERS)
    made = {name for name in BacklashDetection.__dataclass_fields__ if name.startswith("comp_")}
    assert made == {name for name in SETTINGS if name.startswith("comp_")}
    for name, bound in listed.items():
        assert bound["low"] < bound["high"] < math.inf and bound["unit"], name
    assert list(client.get("/loops/FIC1/bounds").json()) == list(DETECTOR)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.slow
def test_each_parameter_is_allowed_within_its_bounds_and_refused_beyond(
    client: TestClient, monitor: Monitor, name: str
) -> None:
    path = "/loops/FIC0/parameters"
    if name in BESIDE:
        assert client.post(path, json={"values": BESIDE[name]}).status_code == 200
    bound = Bound(**client.get("/loops/FIC0/bounds").json()[name])
    before = client.get(path).json()
    allowed = refused = 0
    for value in tried(bound):
        reply = client.post(path, json={"values": {name: value}})
        now = client.get(path).json()
        if bound.allows(value) and not (name == "n" and value % 2 == 0):
            allowed += 1
            assert reply.status_code == 200 and now[name] == value, (value, reply.text)
            assert client.post(path, json={"values": {name: before[name]}}).status_code == 200
        else:
            refused += 1
            assert reply.status_code == 409 and now == before, (value, reply.text)
            message = reply.json()["detail"]
            assert message.startswith(f"loop FIC0, {name}: ") and f"{value:.15g}" in message, message
            assert bound.words in message or "odd" in message, message
            assert monitor.reader.commands()[0]["refused"] == message, "it is put down"
    assert allowed >= 1 and refused >= 4
    for word in ("NaN", "Infinity", "-Infinity", "1e999", '"x"', "[]"):
        text = f'{{"values": {{"{name}": {word}}}}}'
        reply = client.post(path, content=text, headers={"Content-Type": "application/json"})
        assert reply.status_code == 422 and client.get(path).json() == before, (word, reply.text)


def test_no_release_is_longer_than_10_ti_and_300_s(client: TestClient) -> None:
    """Regression: such a release was accepted, and left u_FF in the plant."""
    for name, value, words in (
        (
            "comp_release",
            1e9,
            "comp_release: is 1000000000 s, must be > 0 and ≤ 50 s; give a value within these bounds",
        ),
        ("comp_limit", 1e9, "comp_limit: is 1000000000 %, must be from 1.2 to 10 %"),
        ("comp_rate", 1e6, "comp_rate: is 1000000 %/s, must be > 0 and ≤ 2 %/s"),
    ):
        reply = client.post("/loops/FIC0/parameters", json={"values": {name: value}})
        assert reply.status_code == 409 and words in reply.json()["detail"], reply.text
    slow = loops()[0].model_copy(update={"controller": loops()[0].controller.model_copy(update={"ti": 1000.0})})
    assert bounds_of(slow, {}, MOST)["comp_release"].high == 300.0
    assert Compensator(slow, 1.0, GIVEN, *MOST).setting("comp_release") == 300.0


def test_bounds_that_go_by_others_move_with_them(client: TestClient) -> None:
    def post(**given: float | None) -> tuple[int, str]:
        reply = client.post("/loops/FIC0/parameters", json={"values": given})
        return reply.status_code, reply.text

    assert post(comp_source=1.0, comp_size=12.0)[0] == 200  # 0.8 of it is within twice u_ff_limit
    assert "comp_share" in post(comp_share=1.0)[1]
    assert "comp_limit" in post(comp_limit=9.0)[1]
    # Together they fit, in whichever order they are named.
    assert post(comp_limit=4.0, comp_size=5.0)[0] == 200
    assert post(comp_size=12.0, comp_limit=10.0)[0] == 200
    assert post(comp_release=50.0)[0] == 200
    status, response = post(ti=4.0)
    assert status == 409 and "comp_release: is 50 s, must be > 0 and ≤ 40 s" in response
    assert post(ti=4.0, comp_release=None)[0] == 200


def test_what_an_older_version_saved_is_not_used_and_that_is_told(tmp_path: Path) -> None:
    clock = Clock()
    one = service.monitor(tmp_path, loops(), clock, compensable={"FIC0": MOST})
    old = GIVEN | {"comp_release": 1e9, "comp_limit": 1e9, "comp_rate": 1e6, "ti": 1e12, "comp_band": 0.25}
    one.store.command(BEGIN, "eve", "engineer", "change", "FIC0", {}, old, settings=old)
    backup(tmp_path, tmp_path / "old.db")
    one.store.close()
    for step in ("start", "restored"):
        if step == "restored":
            restore(tmp_path, tmp_path / "old.db", clock())
        again = service.monitor(tmp_path, loops(), clock, compensable={"FIC0": MOST})
        asyncio.run(again.step())
        now = again.commands.settings("FIC0")
        assert (now["comp_release"], now["comp_limit"], now["comp_rate"], now["ti"]) == (5.0, 10.0, 1.2, 5.0), step
        assert (now["comp_size"], now["comp_band"]) == (2.0, 0.25), "what is within its bounds is kept"
        text = next(row["text"] for row in again.reader.events() if row["kind"] == "setting_refused")
        for name in ("comp_release", "comp_limit", "comp_rate", "ti"):
            assert f"loop FIC0, {name}: is {old[name]:.15g}" in text, (name, text)
        row = again.reader.commands("FIC0")[0]
        assert row["person"] == "glapp" and row["before"]["comp_release"] == 1e9
        # Other parameters can be set as well.
        asyncio.run(again.commands.change("FIC0", {"comp_share": 0.5}, "eve", "engineer"))
        again.store.close()
        once_more = service.monitor(tmp_path, loops(), clock, compensable={"FIC0": MOST})
        assert once_more.commands.settings("FIC0")["comp_share"] == 0.5
        once_more.store.close()


def test_the_blocks_own_ways_in_refuse_the_same() -> None:
    """Python's modules, a graph that runs, and the core's block: `vectors/catalogue.json` has the words."""
    words = {row["name"]: row["bound"] for row in CATALOGUE["settings"]["compensation"]}
    loop = loops()[0]
    graph = detection_beside(loop, 1.0, comp_size=2.0, comp_limit=3.0)
    for name, value in (
        ("size", 101.0),
        ("share", 1.1),
        ("limit", 100.5),
        ("band", 100.5),
        ("tf", 50.5),
        ("rate", 1e38),
        ("release", 50.5),
        ("watch", 6e5),
        ("travel", 1e38),
        ("reversals", 1.0),
    ):
        for wrong in (value, -1.0, math.nan, math.inf):
            with pytest.raises(InputError, match=re.escape(words[name])):
                detection_beside(loop, 1.0, **{"comp_size": 2.0, f"comp_{name}": wrong})
            before = graph[f"watch.comp_{name}"]
            with pytest.raises(InputError, match=re.escape(words[name])):
                graph[f"watch.comp_{name}"] = wrong
            assert graph[f"watch.comp_{name}"] == before
    for name in ("comp_withdraw", "comp_estimate"):
        with pytest.raises(InputError, match=r"0 \(no\) or 1 \(yes\)"):
            graph[f"watch.{name}"] = 2.0
    with pytest.raises(ValueError, match="at most 10 Ti and at most 300 s"):
        settings: dict[str, Any] = {"k": 1.0, "size": 2.0, "share": 1.0, "limit": 2.0, "band": 0.1, "tf": 0.0}
        settings |= {"rate": 1.0, "watch": 10.0, "travel": 1.0, "reversals": 2.0, "withdraw": True}
        _glapp.Compensation("inverse", **settings, release=51.0, ti=5.0)


def test_nodes_in_a_loops_toml_have_limits_that_are_numbers() -> None:
    nodes = {"pv": "ns=2;s=PV", "sp": "ns=2;s=SP", "u_ff": "ns=2;s=FF"}
    for name in ("u_ff_limit", "u_ff_rate"):
        for wrong in (0.0, -1.0, math.nan, math.inf):
            with pytest.raises(InputError, match=name):
                Tags(**{**nodes, "u_ff_limit": 1.0, "u_ff_rate": 1.0, name: wrong})
    loop = Loop(name="F", controller={"k": 0.5, "ti": 5.0}, op_span=(0, 100))
    with pytest.raises(InputError, match=r"u_ff_limit: is 1000000000 %, must be > 0 and ≤ 100"):
        Compensator(loop, 1.0, {}, 1e9, 1.0)
    with pytest.raises(InputError, match=r"u_ff_rate"):
        Compensator(loop, 1.0, {}, 1.0, 1e9)


@pytest.mark.parametrize("ti", [0.5, 8.0, 1000.0])
@pytest.mark.parametrize("at", ["low", "high"])
def test_u_ff_is_0_in_time_at_each_end_of_every_bound(ti: float, at: str) -> None:
    """Simulated by a clock: each parameter at either end of its bounds, and the time within which u_FF is removed."""
    loop = loops()[0].model_copy(update={"controller": loops()[0].controller.model_copy(update={"ti": ti})})
    h = ti / 50.0
    base = {"comp_size": 4.0, "comp_share": 1.0, "comp_band": 0.2, "comp_withdraw": 0.0, "comp_estimate": 0.0}
    for name in SETTINGS:
        bound = bounds_of(loop, base, MOST)[name]
        least = bound.low if bound.zero else max(bound.low, 1e-6)
        settings = base | {name: bound.high if at == "high" else least}
        if name == "comp_source":
            settings |= {"comp_fitted": 4.0}
        usual = {"comp_limit": 2.0 * MOST[0], "comp_rate": 1.0}
        graph = detection_beside(loop, h, **{**usual, **settings})
        graph["watch.compensate"] = 1.0
        u_ff = greatest = 0.0

        def scan(k: int, graph: Graph = graph) -> float:
            swing = k % 40
            op = 50.0 + (swing if swing < 20 else 40 - swing) * 0.5
            graph.scan(sp=50.0, pv=49.0 if swing < 20 else 51.0, op=op + graph["ff"], u_ff=graph["ff"], flags=0.0)
            return float(graph["ff"])

        for k in range(400):
            u_ff = scan(k)
            greatest = max(greatest, abs(u_ff))
        assert greatest <= MOST[0] + 1e-9, name
        graph["watch.compensate"] = 0.0
        longest = min(10.0 * ti, 300.0)
        last = abs(u_ff)
        for k in range(400, 400 + math.ceil(longest / h) + 2):
            now = abs(scan(k))
            assert now <= last, (name, "it grows")
            last = now
        assert last == 0.0, (name, settings, u_ff, last)


ROOT = Path(__file__).parents[1]


@pytest.mark.verify
@pytest.mark.by_the_clock
@pytest.mark.skipif(
    shutil.which("node") is None or not (ROOT / "target" / "interop" / "node_modules" / "node-opcua-client").is_dir(),
    reason="node-opcua is not installed: make interop",
)
@pytest.mark.parametrize("losses", [("disable", "PV bad", "PV silent"), ("manual", "kill -9", "server lost")])
def test_u_ff_is_0_in_time_at_the_plants_own_node(losses: tuple[str, ...]) -> None:
    """Runs in real time, as another maker's client sees it: eight corners of release, rate and limit, six losses."""
    command = [sys.executable, "-m", "bench.service_bounds", "--only", *losses]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    told = [row.split("|")[1].strip() for row in done.stdout.splitlines() if row.startswith("|")]
    assert told[2:] == list(losses) and "The greatest |u_FF| seen" in done.stdout
