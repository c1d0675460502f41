"""Our own OPC UA server: its values for each loop, their changes, and that nobody can write."""

import asyncio
import socket
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
import service
from asyncua import Client, ua
from asyncua.crypto.cert_gen import setup_self_signed_certificate
from asyncua.crypto.security_policies import SecurityPolicyBasic256Sha256
from cryptography.x509.oid import ExtendedKeyUsageOID
from service import BEGIN, Clock, fed, loops, values

from glapp import Loop
from glapp.errors import InputError
from glapp.fit import Fit, Verdict
from glapp.service.monitor import Monitor
from glapp.service.options import MonitorOptions
from glapp.service.plant import free_port
from glapp.service.security import Security
from glapp.service.server import DI, NAMESPACE, NODES, AnswerServer, node_values
from glapp.service.signal import Event, Signal, Value
from glapp.service.store import Store
from glapp.service.watched import Health

PASSWORD = "long enough"


def answer(verdict: Verdict = "backlash", **changes: Any) -> dict[str, Any]:
    """A row of `answers`, whose document has the one answer of a fit with such fields."""
    known: dict[str, Any] = {"d": 1.5, "low": 1.25, "high": None} | changes
    return service.answered(Fit(verdict, "seen", "%", **known), Loop(name="FIC0"))


@pytest.fixture
def monitor(tmp_path: Path) -> Iterator[Monitor]:
    """Two loops, of which the first was heard of, and may be compensated."""
    clock = Clock()
    monitor = Monitor(
        loops(2), Store(tmp_path, clock()), options=MonitorOptions(), compensable={"FIC0": (1.0, 0.5)}, clock=clock
    )
    fed(monitor, clock, values("FIC0", 200), pace=20.0)
    yield monitor
    monitor.store.close()


@asynccontextmanager
async def served(monitor: Monitor, **settings: Any) -> AsyncIterator[tuple[AnswerServer, Client, Callable[[str], Any]]]:
    """Server and client, and a loop's nodes by their names."""
    async with AnswerServer(monitor.status, 0, **settings) as server, Client(server.url) as client:
        index = await client.get_namespace_index(NAMESPACE)
        yield server, client, lambda name: client.get_node(ua.NodeId(name, index))


async def read(node: Any) -> ua.DataValue:
    return await node.read_data_value(raise_on_bad_status=False)


@pytest.mark.slow
def test_what_it_says(monitor: Monitor) -> None:
    async def go() -> None:
        await monitor.fits.keep_answer("FIC0", "olaf", answer())
        async with served(monitor) as (_, client, node):
            nodes = {name: await read(node(f"FIC0.{name}")) for name in NODES}
            plain = {name: one.Value.Value for name, one in nodes.items() if one.StatusCode.is_good()}
            shown = monitor.status()["loops"]["FIC0"]
            assert {name: plain[name] for name in ("Verdict", "Confidence", "Width", "Low", "NextStep", "Urgency")} == {
                "Verdict": "backlash",
                "Confidence": "found",
                "Width": 1.5,
                "Low": 1.25,
                "NextStep": "Look at the valve.",
                "Urgency": "medium",
            }
            assert nodes["High"].StatusCode.name == "BadNoData", "there is no upper limit"
            assert plain["Detections"] == shown["accepted"] == 4
            assert plain["Standing"] == "not_enabled" and plain["UFf"] == 0.0
            assert plain["LastSeen"].timestamp() == shown["seen"] == BEGIN + 199
            assert plain["DeviceHealth"] == Health.MAINTENANCE_REQUIRED == 4
            assert {nodes[name].SourceTimestamp.timestamp() for name in ("Verdict", "Low", "High")} == {
                monitor._clock()
            }
            assert nodes["LastSeen"].SourceTimestamp.timestamp() == BEGIN + 199

            for name, info in NODES.items():
                is_analog = await node(f"FIC0.{name}").read_type_definition() == ua.NodeId(ua.ObjectIds.AnalogUnitType)
                assert is_analog == info.unit, name
            unit = await node("FIC0.Width.EngineeringUnits").read_value()
            assert (unit.DisplayName.Text, unit.UnitId) == ("%", 20529)

            other = {name: await read(node(f"FIC1.{name}")) for name in NODES}
            statuses = {name: one.StatusCode.name for name, one in other.items() if one.StatusCode.is_bad()}
            waiting = dict.fromkeys(
                ("Verdict", "Confidence", "Width", "Low", "High", "NextStep", "Urgency", "LastSeen")
            )
            assert statuses == {
                **dict.fromkeys(waiting, "BadWaitingForInitialData"),
                "Standing": "BadNotSupported",
                "UFf": "BadNotSupported",
            }
            assert other["DeviceHealth"].Value.Value == Health.CHECK_FUNCTION, "it was never heard of"

            di = await client.get_namespace_index(DI)
            health = node("FIC0.DeviceHealth")
            assert (await health.read_browse_name()) == ua.QualifiedName("DeviceHealth", di)
            kind = client.get_node(await health.read_data_type())
            assert kind.nodeid == ua.NodeId(6244, di)
            [words] = await kind.get_properties()
            names = [word.Text for word in await words.read_value()]
            assert names == ["NORMAL", "FAILURE", "CHECK_FUNCTION", "OFF_SPEC", "MAINTENANCE_REQUIRED"]
            [folder] = [one for one in await client.nodes.objects.get_children() if one.nodeid.NamespaceIndex]
            assert [(await one.read_browse_name()).Name for one in await folder.get_children()] == ["FIC0", "FIC1"]

    asyncio.run(go())


@pytest.mark.slow
def test_nothing_can_be_written(monitor: Monitor) -> None:
    async def refused(asked: Awaitable[Any]) -> bool:
        try:
            await asked
        except (ua.uaerrors.BadUserAccessDenied, ua.uaerrors.BadServiceUnsupported):
            return True
        return False

    async def go() -> None:
        async with served(monitor) as (server, client, node):
            for loop in ("FIC0", "FIC1"):
                for name, info in NODES.items():
                    one, new = node(f"{loop}.{name}"), ua.Variant(ua.get_default_value(info.kind), info.kind)
                    level = await one.get_access_level()
                    assert level == {ua.AccessLevel.CurrentRead} == await one.get_user_access_level(), name
                    assert await refused(one.write_value(ua.DataValue(new))), name
            flag = client.get_node(ua.ObjectIds.Server_ServerDiagnostics_EnabledFlag)
            assert await refused(flag.write_value(True)), "the standard's own, too"
            name = ua.DataValue(ua.Variant(ua.LocalizedText("x"), ua.VariantType.LocalizedText))
            assert await refused(node("FIC0.Width").write_attribute(ua.AttributeIds.DisplayName, name))
            assert await refused(node("FIC0.Width").delete())
            assert await refused(client.nodes.objects.add_folder(ua.NodeId(77, 1), "1:x"))
            monitored = ua.NodeId(ua.ObjectIds.Server_GetMonitoredItems)
            assert await refused(client.nodes.server.call_method(monitored, ua.Variant(1, ua.VariantType.UInt32)))
            assert await node("FIC0.Detections").read_value() == 4
            admin = Client(server.url)
            admin.set_user("admin")
            with pytest.raises(ua.UaStatusCodeError):
                await admin.connect()

    asyncio.run(go())


class Changes:
    """Changes that a subscription hands over."""

    def __init__(self) -> None:
        self.seen: list[tuple[str, Any]] = []

    def datachange_notification(self, node: Any, value: Any, data: Any) -> None:
        self.seen.append((node.nodeid.Identifier, value))

    async def until(self, condition: Callable[[], bool]) -> None:
        async with asyncio.timeout(120):
            while not condition():
                await asyncio.sleep(0.02)


@pytest.mark.slow
def test_a_change_arrives_and_what_stays_is_not_told_again(monitor: Monitor) -> None:
    async def go() -> None:
        async with served(monitor, step=0.02) as (server, client, node):
            running = asyncio.create_task(server.run())
            changes = Changes()
            subscription = await client.create_subscription(20, changes)
            names = ("FIC0.Verdict", "FIC0.Width", "FIC0.DeviceHealth", "FIC0.Detections")
            await subscription.subscribe_data_change([node(name) for name in names])
            await changes.until(lambda: len(changes.seen) == 4)
            before = (await read(node("FIC0.Detections"))).SourceTimestamp
            changes.seen.clear()
            await monitor.fits.keep_answer("FIC0", "olaf", answer(d=2.5))
            await changes.until(lambda: len(changes.seen) >= 3)
            await asyncio.sleep(0.3)
            expected = {("FIC0.Verdict", "backlash"), ("FIC0.Width", 2.5), ("FIC0.DeviceHealth", 4)}
            assert set(changes.seen) == expected and len(changes.seen) == 3
            assert (await read(node("FIC0.Detections"))).SourceTimestamp == before
            running.cancel()
            await asyncio.gather(running, return_exceptions=True)

    asyncio.run(go())


@pytest.mark.slow
def test_a_loop_that_is_lost(monitor: Monitor) -> None:
    async def go() -> None:
        async with served(monitor) as (server, _, node):

            async def now() -> tuple[int, str, str]:
                await server.publish()
                health = (await read(node("FIC0.DeviceHealth"))).Value.Value
                others = [(await read(node(f"FIC0.{name}"))).StatusCode.name for name in ("UFf", "LastSeen")]
                return health, *others

            def pv(second: int, good: bool = True) -> None:
                monitor.ingest.take(
                    [Value("FIC0", Signal.PV, BEGIN + second, 50.0, good, "" if good else "BadSensorFailure")]
                )

            sound = (Health.NORMAL, "Good", "Good")
            assert await now() == sound
            pv(300, good=False)
            assert await now() == (Health.CHECK_FUNCTION, "Good", "Good")
            pv(301)
            assert await now() == sound
            monitor.tell(Event(BEGIN + 310, None, "lost", "nobody answers"))
            assert await now() == (Health.CHECK_FUNCTION, "BadNoCommunication", "Good")
            monitor.tell(Event(BEGIN + 320, None, "connected", "connected"))
            assert await now() == sound, "what has not changed meanwhile is not told again"
            monitor.tell(Event(BEGIN + 330, "FIC1", "lost", "that one alone"))
            assert await now() == sound

    asyncio.run(go())


@pytest.mark.parametrize(
    ("verdict", "low", "high", "span", "limit", "health"),
    [
        ("sound", 0.0, 0.4, (0, 100), None, Health.NORMAL),
        ("cannot_tell", 0.0, None, (0, 100), None, Health.NORMAL),
        ("stiction", 0.2, 2.0, (0, 100), None, Health.MAINTENANCE_REQUIRED),
        ("backlash", 0.2, 0.4, (0, 100), 0.5, Health.NORMAL),
        ("backlash", 0.2, 0.4, (4, 20), 0.5, Health.MAINTENANCE_REQUIRED),
        ("at_least", 0.6, None, (0, 100), 0.5, Health.MAINTENANCE_REQUIRED),
    ],
)
def test_health_is_that_of_the_answer(
    monitor: Monitor,
    verdict: Verdict,
    low: float,
    high: float | None,
    span: tuple[float, float],
    limit: float | None,
    health: Health,
) -> None:
    """Regression: OP's span was 0 to 100 in any unit; 0.2 to 0.4 mA of 16 is more than 0.5 % of span."""
    loop = Loop(name="FIC0", op_span=span, op_unit="mA", acceptable_dead_band=limit)
    fit = Fit(verdict, "seen", "mA", 0.3, low, high)
    asyncio.run(monitor.fits.keep_answer("FIC0", "olaf", service.answered(fit, loop)))
    assert monitor.status()["loops"]["FIC0"]["health"] == health.name
    assert node_values(monitor.status()["loops"]["FIC0"])["DeviceHealth"].value == health


def test_an_answer_is_the_same_after_a_restart(tmp_path: Path) -> None:
    first = Monitor(loops(2), Store(tmp_path), clock=Clock())
    asyncio.run(first.fits.keep_answer("FIC0", "olaf", answer()))
    before = first.status()["loops"]["FIC0"]["answer"]
    first.store.close()
    again = Monitor(loops(2), Store(tmp_path), clock=Clock())
    assert again.status()["loops"]["FIC0"]["answer"] == before and before["urgency"] == "medium"
    assert again.status()["loops"]["FIC0"]["health"] == "CHECK_FUNCTION", "it was not heard of yet"
    again.store.close()


@pytest.fixture(scope="module")
def certificates(tmp_path_factory: pytest.TempPathFactory) -> Path:
    at = tmp_path_factory.mktemp("certificates")
    for name, uri, use in (
        ("ours", "urn:glapp:watch", ExtendedKeyUsageOID.SERVER_AUTH),
        ("client", "urn:somebody", ExtendedKeyUsageOID.CLIENT_AUTH),
    ):
        made = setup_self_signed_certificate(at / f"{name}.pem", at / f"{name}.der", uri, "localhost", [use], {})
        asyncio.run(made)
    return at


@pytest.mark.slow
def test_encrypted_and_with_a_password(monitor: Monitor, certificates: Path) -> None:
    shown = Security(certificates / "ours.der", certificates / "ours.pem", {"dcs": PASSWORD})

    async def attempt(url: str, user: str | None = "dcs", password: str | None = PASSWORD, sealed: bool = True) -> int:
        client = Client(url)
        client.application_uri = "urn:somebody"
        if sealed:
            own = (certificates / "client.der", certificates / "client.pem")
            server = certificates / "ours.der"
            await client.set_security(SecurityPolicyBasic256Sha256, *own, server_certificate=server)
        if user is not None:
            client.set_user(user)
            client.set_password(password)
        async with client:
            index = await client.get_namespace_index(NAMESPACE)
            return int(await client.get_node(ua.NodeId("FIC0.Detections", index)).read_value())

    async def go() -> None:
        async with AnswerServer(monitor.status, 0, security=shown) as server:
            assert await attempt(server.url) == 4
            for wrong in (
                {"password": "long enougH"},
                {"password": ""},
                {"user": "admin"},
                {"user": None},
                {"sealed": False},
                {"sealed": False, "user": None},
            ):
                with pytest.raises((ua.UaError, ConnectionError, TimeoutError)):
                    await attempt(server.url, **wrong)
            assert await attempt(server.url) == 4
            for _ in range(5):
                with pytest.raises(ua.UaStatusCodeError):
                    await attempt(server.url, password="guess")
            with pytest.raises(ua.uaerrors.BadUserAccessDenied):
                await attempt(server.url)

    asyncio.run(go())


@pytest.mark.slow
def test_what_cannot_be_served_is_refused(monitor: Monitor, certificates: Path) -> None:
    own, key = certificates / "ours.der", certificates / "ours.pem"

    async def begin(port: int = 0, host: str = "127.0.0.1", **security: Any) -> None:
        async with AnswerServer(monitor.status, port, host, Security(**security)):
            pass

    for message, settings in (
        ("opcua-host: is 0.0.0.0, which others reach", {"host": "0.0.0.0"}),
        ("opcua-host", {"host": "0.0.0.0", "certificate": own, "private_key": key}),
        ("given together", {"certificate": own}),
        ("readable", {"users": {"dcs": PASSWORD}}),
        ("10 characters", {"users": {"dcs": "short"}, "certificate": own, "private_key": key}),
        ("none.der", {"certificate": certificates / "none.der", "private_key": key}),
        ("cannot be used", {"certificate": key.with_suffix(".pem"), "private_key": key}),
        ("is not the key", {"certificate": own, "private_key": certificates / "client.pem"}),
    ):
        with pytest.raises(InputError, match=message):
            asyncio.run(begin(**settings))
    with socket.create_server(("127.0.0.1", 0)) as taken, pytest.raises(InputError, match="opcua-port"):
        asyncio.run(begin(taken.getsockname()[1]))
    assert free_port()
