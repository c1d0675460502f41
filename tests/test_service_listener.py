"""The listener of the API and of the station: connections held open by strangers shut nobody out, and do not last."""

import asyncio
import contextlib
import logging
import math
import re
import socket
import ssl
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import httpx
import pytest
from fastapi import FastAPI
from starlette.middleware.base import BaseHTTPMiddleware
from station_window import Window
from test_station import certificate

from glapp.errors import InputError
from glapp.service.api import ApiServer
from glapp.service.listener import Listener, ListenerLimits, _Connection, logged_in

__all__ = ["certificate"]

QUICK = ListenerLimits(header=1.0, body=1.0, answer=1.0, slowest=100_000, idle=1.0, rest=0.3, address=8, strangers=16)
LONGEST = 60.0
"""Longest wait, on any machine [s]."""

PATIENT = ListenerLimits(
    header=LONGEST, body=LONGEST, answer=LONGEST, idle=LONGEST, address=8, strangers=12, logged_in=6
)


class App:
    """An application that records how each request went."""

    def __init__(self) -> None:
        self.bodies: list[int] = []
        self.go_on = asyncio.Event()

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        if scope["type"] != "http":
            if scope["type"] == "websocket":
                await receive()
                await send({"type": "websocket.accept"})
                with contextlib.suppress(OSError):
                    for _ in range(30):
                        await send({"type": "websocket.send", "text": "x" * 1_000_000})
                await receive()
            return
        if scope["path"] == "/known":
            logged_in(scope)
        if scope["path"].endswith("/wait"):
            if scope["path"] == "/known/wait":
                logged_in(scope)
            await self.go_on.wait()
        body, more = 0, scope["path"] != "/unread"
        while more:
            message = await receive()
            if message["type"] == "http.disconnect":
                return
            body, more = body + len(message["body"]), message.get("more_body", False)
        self.bodies.append(body)
        await send({"type": "http.response.start", "status": 200, "headers": []})
        answer = b"x" * 5_000_000 if scope["path"] == "/large" else b"here"
        await send({"type": "http.response.body", "body": answer})


@contextlib.asynccontextmanager
async def served(app: Any, limits: ListenerLimits, **more: Any) -> AsyncIterator[ApiServer]:
    api = ApiServer(app, "127.0.0.1", 0, limits=limits, **more)
    serving = asyncio.create_task(api.open())
    try:
        yield api
    finally:
        serving.cancel()
        await asyncio.gather(serving, return_exceptions=True)


class Stranger:
    """A connection by which anything is sent."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.reader, self.writer = reader, writer

    @classmethod
    async def to(
        cls, api: ApiServer, sent: bytes = b"", address: str = "127.0.0.1", buffer: int | None = None
    ) -> "Stranger":
        made = socket.socket()
        if buffer is not None:
            made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, buffer)
        made.bind((address, 0))
        made.setblocking(False)
        await asyncio.get_running_loop().sock_connect(made, ("127.0.0.1", api.port))
        one = cls(*await asyncio.open_connection(sock=made, limit=4096))
        one.writer.write(sent)
        await asyncio.sleep(0.01)
        return one

    async def ended(self) -> bytes:
        """Bytes until the connection was closed."""
        found = b""
        async with asyncio.timeout(LONGEST):
            with contextlib.suppress(ConnectionError):
                while some := await self.reader.read(65_536):
                    found += some
        self.writer.transport.abort()
        return found

    @property
    def open(self) -> bool:
        return not self.reader.at_eof() and self.reader.exception() is None


async def asked(api: ApiServer, path: str = "/", method: str = "GET", **more: Any) -> httpx.Response:
    async with httpx.AsyncClient(trust_env=False, timeout=LONGEST) as client:
        return await client.request(method, api.url + path, **more)


HALF = b"POST /login HTTP/1.1\r\nHost: x\r\n"


@pytest.mark.slow
def test_strangers_that_hold_connections_half_open_shut_nobody_out() -> None:
    """200 half-sent requests shut the API and the station for as long as the stranger stayed."""

    async def go() -> None:
        async with served(App(), PATIENT) as api:
            held = [await Stranger.to(api, HALF) for _ in range(30)]
            for _ in range(5):  # from the same address
                assert (await asked(api)).text == "here"
                held += [await Stranger.to(api, HALF) for _ in range(5)]
            await asyncio.sleep(0.1)
            assert sum(one.open for one in held) <= PATIENT.address
            assert [one.open for one in held[-4:]] == [True] * 4, "the oldest go first"

    asyncio.run(go())


@pytest.mark.slow
def test_an_address_has_its_own_bound() -> None:
    """With strangers on every connection, the one with most of them loses one."""

    async def go() -> None:
        async with served(App(), PATIENT) as api:
            quiet = [await Stranger.to(api, HALF, "127.0.0.2") for _ in range(2)]
            held = [await Stranger.to(api, HALF, f"127.0.0.{3 + k % 3}") for k in range(60)]
            await asyncio.sleep(0.1)
            assert all(one.open for one in quiet) and sum(one.open for one in held) <= PATIENT.strangers - 2
            assert (await asked(api)).text == "here"

    asyncio.run(go())


@pytest.mark.slow
def test_who_has_shown_a_login_is_displaced_by_no_stranger() -> None:
    async def go() -> None:
        async with served(App(), PATIENT) as api, httpx.AsyncClient(trust_env=False, timeout=LONGEST) as client:
            assert (await client.get(f"{api.url}/known")).text == "here"
            [connection] = api._server._open
            for _ in range(40):
                await Stranger.to(api, HALF)
            assert not connection.gone and connection in api._server._open
            assert (await client.get(f"{api.url}/known")).text == "here"
            many = [await Stranger.to(api, b"GET /known HTTP/1.1\r\nHost: x\r\n\r\n") for _ in range(20)]
            await asyncio.sleep(0.1)
            assert sum(one.known for one in api._server._open) <= PATIENT.logged_in, "they are bounded, too"
            assert [one.open for one in many[-4:]] == [True] * 4

    asyncio.run(go())


@pytest.mark.slow
@pytest.mark.parametrize(
    "sent",
    [
        b"",
        b"GET /",
        HALF,
        HALF + b"Content-Length: 100\r\n\r\nhalf",
        HALF.replace(b"login", b"unread") + b"Content-Length: 50000000\r\n\r\nhalf",  # answered before it is whole
        b"GET / HTTP/1.1\r\nHost: x\r\n\r\n",  # answered, and then nothing
        b"GET / HTTP/1.1\r\nHost: x\r\n\r\nGET /half",  # answered, and then half of another
        b"\x16\x03\x01\x02\x00\x01\x00",
        b"GET / HTTP/1.1\r\nHost: x\r\nA: " + 40_000 * b"a",
    ],
    ids=["nothing", "a word", "half a header", "half a body", "body unread", "idle", "the next", "no HTTP", "long"],
)
def test_what_is_half_sent_does_not_last(sent: bytes) -> None:
    async def go() -> None:
        async with served(App(), QUICK) as api:
            one = await Stranger.to(api, sent)
            await one.ended()
            async with asyncio.timeout(LONGEST):
                while api._server._open:
                    await asyncio.sleep(0.05)

    asyncio.run(go())


@pytest.mark.slow
@pytest.mark.parametrize("sent", [HALF + b"A: ", HALF + b"Content-Length: 1000\r\n\r\n"], ids=["header", "body"])
def test_a_byte_now_and_then_does_not_make_it_last(sent: bytes) -> None:
    async def go() -> None:
        async with served(App(), QUICK) as api:
            one = await Stranger.to(api, sent)

            async def slowly() -> None:
                while True:
                    await asyncio.sleep(0.1)
                    one.writer.write(b"x")

            writing = asyncio.create_task(slowly())
            await one.ended()
            writing.cancel()
            await asyncio.gather(writing, return_exceptions=True)

    asyncio.run(go())


@pytest.mark.slow
def test_answers_that_nobody_takes_do_not_last() -> None:
    async def go() -> None:
        async with served(App(), QUICK) as api:
            for sent in (
                b"GET /large HTTP/1.1\r\nHost: x\r\n\r\n",
                b"GET /large HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n",
                b"GET / HTTP/1.1\r\nHost: x\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n"
                b"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n",
            ):
                one = await Stranger.to(api, sent, buffer=4096)
                async with asyncio.timeout(LONGEST):
                    while not api._server._open:
                        await asyncio.sleep(0.05)
                    while api._server._open:
                        await asyncio.sleep(0.05)
                one.writer.transport.abort()

    asyncio.run(go())


@pytest.mark.slow
def test_an_answer_that_is_taken_slowly_but_taken_comes_whole() -> None:
    async def go() -> None:
        async with served(App(), ListenerLimits(answer=1.0, slowest=10_000)) as api:
            one = await Stranger.to(api, b"GET /large HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n", buffer=4096)
            found = 0
            while some := await one.reader.read(200_000):
                found += len(some)
                await asyncio.sleep(0.001)
            assert found > 5_000_000

    asyncio.run(go())


def test_what_is_taken_is_measured_from_time_to_time() -> None:
    listener = Listener(App(), ListenerLimits(answer=10.0, slowest=10_000))

    class Transport:
        left = 0

        def get_write_buffer_size(self) -> int:
            return self.left

    one, transport = _Connection(socket.socket(), "x", math.inf), Transport()
    for now, left, stuck in (
        (0.0, 0, False),
        (5.0, 500_000, False),
        (9.0, 495_000, False),
        (10.5, 495_000, True),  # 5000 bytes in ten seconds
        (11.0, 480_000, False),
        (20.0, 600_000, False),  # more was written
        (20.9, 589_000, False),
        (30.0, 589_000, False),
        (31.0, 589_000, True),
        (32.0, 0, False),
    ):
        transport.left = left
        assert listener._stuck(one, transport, now) is stuck, now  # type: ignore[arg-type]
    one.socket.close()


def test_a_stranger_sends_so_many_requests_by_a_connection() -> None:
    async def go() -> None:
        app = App()
        async with served(app, ListenerLimits(each=5)) as api:
            for path, answers in ((b"/", 5), (b"/known", 20)):
                app.bodies.clear()
                one = await Stranger.to(api, 20 * (b"GET " + path + b" HTTP/1.1\r\nHost: x\r\n\r\n"))
                async with asyncio.timeout(LONGEST):
                    found = b""
                    while found.count(b"here") < answers:
                        found += await one.reader.read(65_536)
                assert len(app.bodies) == answers and (b"connection: close" in found) == (answers == 5)

    asyncio.run(go())


@pytest.mark.slow
def test_a_body_in_chunks_passes_no_bound() -> None:
    """Regression: the stated length was believed, and as much read as came."""

    async def go() -> None:
        app = App()
        async with served(app, QUICK) as api:
            headers = HALF + b"Content-Length: 5\r\nTransfer-Encoding: chunked\r\n\r\n"
            one = await Stranger.to(api, headers + 1000 * (b"3e8\r\n" + 1000 * b"x" + b"\r\n"))
            assert (await one.ended()).startswith(b"HTTP/1.1 411 ") and app.bodies == []
            assert (await asked(api, method="POST", content=b"whole")).text == "here" and app.bodies == [5]

    asyncio.run(go())


@pytest.mark.slow
def test_login_and_disable_are_answered_whatever_else_is_asked() -> None:
    async def go() -> None:
        app = App()
        async with served(app, ListenerLimits(requests=3)) as api:
            waiting = [asyncio.create_task(asked(api, "/known/wait")) for _ in range(3)]
            async with asyncio.timeout(LONGEST):
                while api._server._requests < 3:
                    await asyncio.sleep(0.01)
            refused = await asked(api)
            assert refused.status_code == 503 and "3 requests are being answered" in refused.json()["detail"]
            for path in ("/login", "/api/login", "/loops/FIC0/disable"):
                assert (await asked(api, path, "POST", json={})).text == "here"
            assert (await asked(api, "/loops/FIC0/disable")).status_code == 503  # nothing is done by GET
            app.go_on.set()
            assert [(await one).text for one in waiting] == ["here"] * 3
            assert (await asked(api)).text == "here"

    asyncio.run(go())


@pytest.mark.slow
def test_strangers_take_turns_and_login_and_disable_do_not_wait_for_them() -> None:
    async def go() -> None:
        app = App()
        async with served(app, ListenerLimits(turns=2)) as api:
            held = [await Stranger.to(api, HALF + b"Content-Length: 9\r\n\r\n") for _ in range(5)]
            taking = b"GET /large HTTP/1.1\r\nHost: x\r\n\r\n"
            held += [await Stranger.to(api, taking, buffer=4096) for _ in range(5)]
            assert (await asked(api)).text == "here", "neither a body nor an answer holds a turn"
            waiting = [asyncio.create_task(asked(api, "/known/wait")) for _ in range(5)]
            assert (await asked(api)).text == "here", "nor does who has shown a login"
            waiting += [asyncio.create_task(asked(api, "/wait")) for _ in range(5)]
            async with asyncio.timeout(LONGEST):
                while not api._server._turns.locked():
                    await asyncio.sleep(0.01)
            queued = asyncio.create_task(asked(api))
            assert (await asked(api, "/loops/FIC0/disable", "POST", json={})).text == "here"
            assert not queued.done()
            app.go_on.set()
            assert [(await one).text for one in (*waiting, queued)] == ["here"] * 11
            for one in held:
                one.writer.transport.abort()

    asyncio.run(go())


@pytest.mark.slow
def test_log_in_and_disable_while_strangers_hold_connections(window: Window) -> None:
    """The small form: 300 of them for some seconds, at the station and at the service behind it."""
    from bench.half_open import running
    from station_child import PASSWORDS

    api = (window.folder / "api-url").read_text()
    eve = {"user": "eve", "password": PASSWORDS["eve"]}
    with contextlib.ExitStack() as stack:
        for url in (api, window.url):
            child = stack.enter_context(running("-m", "bench.half_open", "attack", url.rpartition(":")[2], "300"))
            assert child.stdout is not None and child.stdout.readline()  # they are there
        for _ in range(4):
            token = httpx.post(f"{api}/login", json=eve, timeout=LONGEST, trust_env=False).json()["token"]
            bearer = {"Authorization": f"Bearer {token}"}
            off = httpx.post(f"{api}/loops/FIC0/disable", headers=bearer, json={}, timeout=LONGEST, trust_env=False)
            assert off.status_code == 200 and off.json()["enabled"] is False
            form = {"data": eve, "headers": {"Origin": window.url}}
            shown = httpx.post(f"{window.url}/login", **form, timeout=LONGEST, trust_env=False)
            assert shown.status_code == 303
            page = httpx.get(window.url, cookies=shown.cookies, timeout=LONGEST, trust_env=False)
            assert page.status_code == 200 and "Overview" in page.text


@pytest.mark.verify
@pytest.mark.by_the_clock
@pytest.mark.parametrize("target", ["service", "station"])
def test_log_in_and_disable_while_strangers_hold_connections_for_two_minutes(target: str) -> None:
    """The large form: every one of them is answered. How fast, `python -m bench.half_open 120 300` prints."""
    from bench.half_open import measured

    for what, times in measured(120.0, 300, target).items():
        assert times and math.inf not in times, what


def test_a_certificate_that_ends_is_told_and_the_url_has_its_name(
    certificate: tuple[Path, Path], tmp_path: Path
) -> None:
    """Regression: an expired certificate was served without a word, at https://0.0.0.0."""
    own, key = certificate  # of one day
    api = ApiServer(FastAPI(), "0.0.0.0", 0, own, key, names=["plant.example", "10.0.0.5"])
    api._socket.close()
    assert api.url == f"https://plant.example:{api.port}"
    assert re.search(r"own\.pem expires on \S+, in 0 d: put a new one there, and start again", api.expiring() or "")
    (tmp_path / "no.pem").write_bytes(own.read_bytes()[:100])
    with pytest.raises(InputError, match=r"no\.pem: cannot be used"):
        ApiServer(FastAPI(), "0.0.0.0", 0, tmp_path / "no.pem", key)


@pytest.mark.slow
def test_tls_that_is_never_agreed_on_shuts_nobody_out(certificate: tuple[Path, Path]) -> None:
    own, key = certificate

    async def go() -> None:
        async with served(App(), QUICK, certificate=own, key=key) as api:
            held = [await Stranger.to(api, b"\x16\x03\x01" * (k % 2)) for k in range(30)]
            context = ssl.create_default_context(cafile=str(own))
            async with httpx.AsyncClient(trust_env=False, timeout=LONGEST, verify=context) as client:
                assert (await client.get(api.url)).text == "here"
            for one in held:
                await one.ended()

    asyncio.run(go())


def test_nothing_a_request_says_is_its_address() -> None:
    async def go() -> None:
        addresses = []

        async def app(scope: Any, receive: Any, send: Any) -> None:
            if scope["type"] == "http":
                addresses.append(scope["client"][0])
                await send({"type": "http.response.start", "status": 200, "headers": []})
                await send({"type": "http.response.body"})

        async with served(app, QUICK) as api:
            await asked(api, headers={"X-Forwarded-For": "10.0.0.7", "Forwarded": "for=10.0.0.7"})
        assert addresses == ["127.0.0.1"]

    asyncio.run(go())


@pytest.mark.slow
def test_no_file_left_is_no_end() -> None:
    """A listener that cannot accept goes on when it can."""

    async def go() -> None:
        async with served(App(), PATIENT) as api:
            await Stranger.to(api, HALF)
            loop, real, failed = asyncio.get_running_loop(), asyncio.get_running_loop().sock_accept, []

            async def failing(listening: socket.socket) -> Any:
                if len(failed) < 3:
                    failed.append(1)
                    raise OSError(24, "Too many open files")
                return await real(listening)

            loop.sock_accept = failing  # type: ignore[method-assign]
            assert (await asked(api)).text == "here"
            assert (await asked(api)).text == "here" and len(failed) == 3

    asyncio.run(go())


class Silent(BaseHTTPMiddleware):
    """Hands on, as NiceGUI's middleware does."""

    async def dispatch(self, request: Any, call_next: Any) -> Any:
        return await call_next(request)


@pytest.mark.parametrize("gone", [True, False])
def test_a_killed_browser_fills_no_log(gone: bool) -> None:
    """Each one left a traceback of "No response returned"; a handler that answers nobody still does."""
    done: list[str] = []

    async def app(scope: Any, receive: Any, send: Any) -> None:
        if scope["type"] != "http":
            return
        while gone and (await receive())["type"] != "http.disconnect":
            pass
        done.append(scope["path"])

    async def run() -> list[str]:
        heard: list[str] = []
        handler = logging.Handler()
        handler.emit = lambda record: heard.append(logging.Formatter().format(record))  # type: ignore[method-assign]
        async with served(Silent(app), PATIENT) as api:
            logging.getLogger("uvicorn.error").addHandler(handler)
            try:
                one = await Stranger.to(api, b"GET /x HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
                if gone:
                    one.writer.transport.abort()
                else:
                    await one.reader.read(10)
                async with asyncio.timeout(LONGEST):
                    while not done:
                        await asyncio.sleep(0.01)
                await asyncio.sleep(0.1)
            finally:
                logging.getLogger("uvicorn.error").removeHandler(handler)
        return heard

    heard = asyncio.run(run())
    assert (heard == []) if gone else any("No response returned." in text for text in heard)
