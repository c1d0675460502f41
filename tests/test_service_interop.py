"""The connection beside two stacks that are not ours, node-opcua and Eclipse Milo: our client and their servers, their
clients and our servers.

`make interop` brings them, into target/interop.
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
import service

pytest.importorskip("asyncua", reason="the extra [opcua] is not installed")

import itertools

from asyncua.crypto.cert_gen import setup_self_signed_certificate
from cryptography import x509
from cryptography.hazmat.primitives import serialization
from cryptography.x509.oid import ExtendedKeyUsageOID
from test_service_opcua import Watch, ascending, gaps

from glapp.loop import Loop
from glapp.service.connection import Connection
from glapp.service.opcua import browse
from glapp.service.plant import NAMESPACE, SimPlant, free_port
from glapp.service.security import Security
from glapp.service.server import NAMESPACE as OURS
from glapp.service.server import AnswerServer
from glapp.service.signal import Signal, Value
from glapp.service.tags import loops_of

HERE = Path(__file__).parent / "interop"
THEIRS = Path(__file__).parents[1] / "target" / "interop"
pytestmark = [pytest.mark.verify, pytest.mark.usefixtures("impatient")]
NODE = pytest.mark.skipif(
    shutil.which("node") is None or not (THEIRS / "node_modules" / "node-opcua-server").is_dir(),
    reason="node-opcua is not installed: make interop",
)
MILO = pytest.mark.skipif(
    shutil.which("java") is None or not (THEIRS / "milo" / "classes").is_dir(),
    reason="Eclipse Milo is not installed: make interop",
)
STACKS = [pytest.param("node", marks=NODE, id="node-opcua"), pytest.param("milo", marks=MILO, id="milo")]


def theirs(stack, script, *words, pki=None):
    """A program of theirs: a script of node's, or a class of Milo's by the same name."""
    if stack == "node":
        command, more = ["node", str(HERE / f"{script}.js")], {"NODE_PATH": str(THEIRS / "node_modules")}
    else:
        of = {"server": "TheirServer", "answers": "TheirClient"}[script]
        path = os.pathsep.join((str(THEIRS / "milo" / "classes"), str(THEIRS / "milo" / "lib" / "*")))
        command, more = ["java", "-XX:TieredStopAtLevel=1", "-cp", path, of], {}
    command += map(str, words)
    if pki is not None:
        more["PKI"] = str(pki)
    return subprocess.Popen(command, env={**os.environ, **more}, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)


async def said(stack, script, *words, pki=None):
    """Last output of another maker's program."""
    child = await asyncio.to_thread(lambda: theirs(stack, script, *words, pki=pki))
    out, _ = await asyncio.to_thread(child.communicate, timeout=180)
    return json.loads(next(line for line in out.splitlines() if line.startswith(b"{")))


@contextlib.contextmanager
def their_server(stack, *folder):
    """Address of their server, and its description."""
    port = free_port()
    with theirs(stack, "server", port, *folder) as served:
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


@pytest.mark.parametrize("stack", STACKS)
def test_our_client_and_their_server(stack):
    """Values with their statuses, u_FF and watchdog; a break filled from the history, and a gap where there is none."""

    async def run(url, uri):
        found = await browse(Connection(url=url))
        loops, _ = loops_of((one.path, one.node) for one in found)
        async with watched(url, uri) as watch:
            await watch.until(lambda: any(v.note == "BadSensorFailure" for v in watch.of("FIC101")))
            await watch.heard("FIC101", 5)
            for _ in range(3):
                await watch.source.heartbeat()
            watch.source.enable("FIC101")
            await asyncio.sleep(0.1)
            await watch.source.write("FIC101", 0.1)
            back = await watch.source.read_back("FIC101")
            watch.source._link.end("ended on purpose")
            await asyncio.sleep(0.5)
            await watch.until(lambda: watch.texts("backfilled" if stack == "node" else "no_history"))
            await watch.heard("FIC101", 10)
        return loops, watch, back

    with their_server(stack) as (url, answers):
        loops, watch, back = asyncio.run(run(url, answers["uri"]))
    assert set(loops["FIC101"]) == {"sp", "pv", "op", "mode"}
    values = watch.of("FIC101")
    bad = [v for v in values if not v.good]
    assert ascending(values) and len(values) > 40 and (stack == "milo" or not gaps(values, 0.2))
    assert bad and all(math.isnan(v.value) and v.note == "BadSensorFailure" for v in bad)
    assert [v.value for v in watch.of("FIC101", Signal.SP)] == [50.0]
    assert [v.value for v in watch.of("FIC101", Signal.MODE)] == [1.0]
    assert back.good and back.value == pytest.approx(0.1) and back.value != 0.1, "the node holds a Float"
    kinds = {e.kind for e in watch.events}
    assert kinds == {"connected", "lost", "backfilled" if stack == "node" else "no_history"}


@pytest.fixture(scope="module")
def pki(tmp_path_factory):
    """Certificates of the programs, and of a stranger whom nobody trusts: NAME.der, NAME.crt (the same as text) and
    NAME.pem, the key.
    """
    folder = tmp_path_factory.mktemp("pki")

    async def make(name, uri, *uses):
        key, certificate = folder / f"{name}.pem", folder / f"{name}.der"
        usage = [getattr(ExtendedKeyUsageOID, f"{use}_AUTH") for use in uses]
        await setup_self_signed_certificate(key, certificate, uri, "127.0.0.1", usage, {})
        made = x509.load_der_x509_certificate(certificate.read_bytes())
        (folder / f"{name}.crt").write_bytes(made.public_bytes(serialization.Encoding.PEM))

    asyncio.run(make("ours", "urn:glapp:watch", "CLIENT"))
    asyncio.run(make("theirs", "urn:glapp:theirs", "SERVER"))
    asyncio.run(make("client", "urn:glapp:client", "CLIENT"))
    asyncio.run(make("server", "urn:glapp:answers", "SERVER"))
    asyncio.run(make("stranger", "urn:glapp:stranger", "CLIENT", "SERVER"))
    (folder / "right").write_text("secret\n")
    (folder / "wrong").write_text("guess\n")
    return folder


@pytest.mark.parametrize("stack", STACKS)
def test_our_client_and_their_server_encrypted(stack, pki):
    """Each knows the other's certificate, and the password is right: then, and only then, values come."""

    async def attempt(url, uri, own="ours", server="theirs", password="right"):
        given = {"certificate": pki / f"{own}.der", "private_key": pki / f"{own}.pem", "user": "glapp"}
        given |= {"security": "Basic256Sha256", "password_file": pki / password}
        async with watched(url, uri, server_certificate=pki / f"{server}.der", **given) as watch:
            await watch.until(lambda: watch.texts("lost") or len(watch.of("FIC101")) > 5)
        return watch

    async def run(url, uri):
        wrong = {"own": "stranger"}, {"server": "stranger"}, {"password": "wrong"}
        return await attempt(url, uri), [await attempt(url, uri, **one) for one in wrong]

    with their_server(stack, pki) as (url, answers):
        right, refused = asyncio.run(run(url, answers["uri"]))
    assert len(right.of("FIC101")) > 5 and not right.texts("lost")
    assert not any(one.values for one in refused)
    strange, other, guessed = (one.texts("lost")[0] for one in refused)
    assert "may not trust our certificate" in strange, strange
    assert "the server shows another certificate than" in other, other
    assert "BadUserAccessDenied" in guessed, guessed


@NODE
def test_their_client_and_our_plant():
    """Values, history and u_FF; a setpoint is not to be written."""

    async def run():
        async with SimPlant(1, scan=0.1) as plant:
            return await said("node", "client", plant.url, NAMESPACE)

    report = asyncio.run(run())
    good = [(t, value) for t, value, status in report["seen"] if status == "Good"]
    steps = [b - a for (a, _), (b, _) in itertools.pairwise(good)]
    assert len(good) > 20 and all(0.09 < step < 0.11 for step in steps)
    assert report["history"] == report["seen"][2:23]
    assert (report["refused"], report["written"], report["back"]) == ("BadUserAccessDenied", "Good", 0.5)


@pytest.mark.parametrize("sealed", [False, True], ids=["open", "encrypted"])
@pytest.mark.parametrize("stack", STACKS)
def test_their_client_and_our_answers(stack, sealed, pki, tmp_path):
    """Their client reads our values of a loop, as they are and as they change; none of them can be written.

    Encrypted it is said to who knows the password, and they speak to nobody whose certificate they do not know.
    """
    clock = service.Clock()
    monitor = service.monitor(tmp_path, service.loops(2), clock)
    service.fed(monitor, clock, service.values("FIC0", 200), pace=20.0)
    security = Security(pki / "server.der", pki / "server.pem", {"dcs": "long enough"}) if sealed else None

    async def run():
        async with AnswerServer(monitor.status, 0, security=security, step=0.1) as server:
            serving = asyncio.create_task(server.run())
            names = ("FIC0.Detections", "FIC0.DeviceHealth", "FIC1.DeviceHealth", "FIC0.Width", "FIC0.Standing")
            words = (server.url, OURS, "FIC0.LastSeen", "FIC0.Width", *names)
            asked = asyncio.create_task(said(stack, "answers", *words, pki=pki if sealed else None))
            second = 300
            while not asked.done():  # the monitor goes on meanwhile
                monitor.ingest.take([Value("FIC0", Signal.PV, service.BEGIN + second, 50.0, True)])
                second += 1
                await asyncio.sleep(0.1)
            serving.cancel()
            await asyncio.gather(serving, return_exceptions=True)
            return asked.result()

    report = asyncio.run(run())
    monitor.store.close()
    times = [time for time, _, status in report["seen"] if status == "Good"]
    assert len(set(times)) > 10, "on a slow machine Milo's client asks for some once more"
    assert min(times) >= service.BEGIN + 199
    assert report["written"] in ("BadUserAccessDenied", "BadNotWritable")
    read = {name: (value, status) for name, (_, value, status) in report["read"].items()}
    assert read == {
        "FIC0.Detections": (4, "Good"),
        "FIC0.DeviceHealth": (0, "Good"),
        "FIC1.DeviceHealth": (2, "Good"),
        "FIC0.Width": (None, "BadWaitingForInitialData"),
        "FIC0.Standing": (None, "BadNotSupported"),
    }
    if sealed:
        assert "BadUserAccessDenied" in report["refused"]["password"]
        assert report["refused"]["certificate"] != "Good"
