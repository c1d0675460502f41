"""The connection beside a stack that is not ours, node-opcua: our client and its server, its client and our server.

`npm install` in tests/interop brings it; elsewhere name its folder by GLAPP_NODE_MODULES.
"""

import asyncio
import contextlib
import json
import math
import os
import shutil
import subprocess
from pathlib import Path

import pytest

pytest.importorskip("asyncua", reason="the extra [opcua] is not installed")

import itertools

from asyncua.crypto.cert_gen import setup_self_signed_certificate
from cryptography.x509.oid import ExtendedKeyUsageOID
from test_service_opcua import Watch, ascending, gaps

from glapp.loop import Loop
from glapp.service import opcua
from glapp.service.connection import Connection
from glapp.service.opcua import browse
from glapp.service.plant import NAMESPACE, SimPlant, free_port
from glapp.service.signal import Signal
from glapp.service.tags import loops_of

HERE = Path(__file__).parent / "interop"
MODULES = Path(os.environ.get("GLAPP_NODE_MODULES", HERE / "node_modules"))
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        shutil.which("node") is None or not (MODULES / "node-opcua-server").is_dir(),
        reason="node-opcua is not installed: npm install in tests/interop",
    ),
]


@pytest.fixture(autouse=True)
def impatient(monkeypatch):
    monkeypatch.setattr(opcua, "_PAUSES", (0.2, 0.4))
    monkeypatch.setattr(opcua, "_DENIED", 0.4)


def node(script, *words):
    command = ["node", str(HERE / script), *map(str, words)]
    return subprocess.Popen(
        command, env={**os.environ, "NODE_PATH": str(MODULES)}, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    )


@contextlib.contextmanager
def their_server(*folder):
    """Where it listens, and what it says of itself."""
    port = free_port()
    with node("server.js", port, *folder) as served:
        try:
            for line in served.stdout:
                if line.startswith(b"{"):
                    break
            else:
                raise AssertionError("it did not start")
            yield f"opc.tcp://127.0.0.1:{port}/plant", json.loads(line)
        finally:
            served.kill()


def watched(url, uri, **connection):
    tags = {key: f"nsu={uri};s=FIC101.{key.upper()}" for key in ("pv", "sp", "op", "mode", "u_ff")}
    loop = Loop(name="FIC101", opcua={**tags, "u_ff_limit": 1.0, "u_ff_rate": 10.0})

    class Plant:
        pass

    plant = Plant()
    plant.url = url
    return Watch(plant, loops=[loop], watchdog=f"nsu={uri};s=FIC101.Watchdog", **connection)


def test_our_client_and_their_server():
    """Values with their statuses, a break filled from the history, u_FF and watchdog."""

    async def run(url, uri):
        found = await browse(Connection(url=url))
        loops, _ = loops_of((one.path, one.node) for one in found)
        async with watched(url, uri) as watch:
            await watch.until(lambda: any(v.note == "BadSensorFailure" for v in watch.of("FIC101")))
            await watch.heard("FIC101", 5)
            for _ in range(3):
                await watch.source.beat()
            watch.source.enable("FIC101")
            await asyncio.sleep(0.1)
            await watch.source.write("FIC101", 0.1)
            back = await watch.source.read_back("FIC101")
            watch.source._link.end("ended on purpose")
            await asyncio.sleep(0.5)
            await watch.until(lambda: watch.told("backfilled"))
            await watch.heard("FIC101", 10)
        return loops, watch, back

    with their_server() as (url, told):
        loops, watch, back = asyncio.run(run(url, told["uri"]))
    assert set(loops["FIC101"]) == {"sp", "pv", "op", "mode"}
    values = watch.of("FIC101")
    bad = [v for v in values if not v.good]
    assert ascending(values) and not gaps(values, 0.2) and len(values) > 40
    assert bad and all(math.isnan(v.value) and v.note == "BadSensorFailure" for v in bad)
    assert [v.value for v in watch.of("FIC101", Signal.SP)] == [50.0]
    assert [v.value for v in watch.of("FIC101", Signal.MODE)] == [1.0]
    assert back.good and back.value == pytest.approx(0.1) and back.value != 0.1, "the node holds a Float"
    assert watch.told("withdrawn") and {e.kind for e in watch.events} <= {
        "connected",
        "lost",
        "withdrawn",
        "backfilled",
    }


def test_our_client_and_their_server_encrypted(tmp_path):
    """With its certificate, carried here, and the right password; not with another password."""
    key, certificate = tmp_path / "ours.pem", tmp_path / "ours.der"
    usage = [ExtendedKeyUsageOID.CLIENT_AUTH]
    asyncio.run(setup_self_signed_certificate(key, certificate, "urn:glapp:watch", "localhost", usage, {}))
    (tmp_path / "right").write_text("secret\n")
    (tmp_path / "wrong").write_text("guess\n")

    async def run(url, uri, password, **more):
        given = {"certificate": certificate, "private_key": key, "server_certificate": server, "user": "glapp"}
        given |= {"security": "Basic256Sha256", "password_file": tmp_path / password}
        async with watched(url, uri, **given, **more) as watch:
            await watch.until(lambda: watch.told("lost") or len(watch.of("FIC101")) > 5)
        return watch

    with their_server(tmp_path) as (url, told):
        server = Path(told["certificate"])
        if server.suffix == ".pem":
            lines = server.read_text().split("-----END CERTIFICATE-----")[0] + "-----END CERTIFICATE-----\n"
            server = tmp_path / "their.pem"
            server.write_text(lines)
        right = asyncio.run(run(url, told["uri"], "right"))
        wrong = asyncio.run(run(url, told["uri"], "wrong"))
    assert len(right.of("FIC101")) > 5 and not right.told("lost")
    assert not wrong.values and "BadUserAccessDenied" in wrong.told("lost")[0]


def test_their_client_and_our_server():
    """Values, history and u_FF; a setpoint is not to be written."""

    async def run():
        async with SimPlant(1, scan=0.1) as plant:
            client = await asyncio.to_thread(lambda: node("client.js", plant.url, NAMESPACE))
            out, _ = await asyncio.to_thread(client.communicate, timeout=60)
            return json.loads(next(line for line in out.splitlines() if line.startswith(b"{")))

    said = asyncio.run(run())
    good = [(t, value) for t, value, status in said["seen"] if status == "Good"]
    steps = [b - a for (a, _), (b, _) in itertools.pairwise(good)]
    assert len(good) > 20 and all(0.09 < step < 0.11 for step in steps)
    assert 18 <= said["history"] <= 21
    assert (said["refused"], said["written"], said["back"]) == ("BadUserAccessDenied", "Good", 0.5)
