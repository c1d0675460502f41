"""Log-in and `disable` while strangers hold connections half open: `python -m bench.half_open 120 300`.

The service watches a simulated plant, the station shows it, and both are processes of their own, started by the command
line. A third process opens connections to one of them from this computer's own address, without a login, and opens
each again as soon as it is closed. Each connection does one of: half a header and then nothing; a byte of a header
every second; half a body; answers that are asked for and never read. Meanwhile an engineer logs in, by the service and
by the station, and disables the compensation of a loop, every half second or so: each time on a new connection.
"""

from __future__ import annotations

import asyncio
import contextlib
import re
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import httpx

HERE = Path(__file__).parents[1]
LOOP = "FIC101"
KINDS = ("half a header", "a slow header", "half a body", "answers never read")


async def half_open(port: int, kind: str, host: str) -> None:
    """One connection of a stranger, for as long as the other side lets it be."""
    small = socket.socket()
    small.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    small.setblocking(False)
    try:
        await asyncio.get_running_loop().sock_connect(small, ("127.0.0.1", port))
        reader, writer = await asyncio.open_connection(sock=small, limit=1024)
    except OSError:
        small.close()
        return
    try:
        begun = f"POST /login HTTP/1.1\r\nHost: {host}\r\nOrigin: http://{host}\r\n"
        if kind == "half a body":
            form = "Content-Type: application/x-www-form-urlencoded\r\nContent-Length: 1000\r\n\r\nuser="
            writer.write((begun + form).encode())
        elif kind == "answers never read":
            writer.write(f"GET /openapi.json HTTP/1.1\r\nHost: {host}\r\n\r\n".encode() * 500)
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(10.0):
                    await writer.drain()
            while not writer.is_closing():  # the socket says when it is closed only to who reads
                await asyncio.sleep(1.0)
                writer.write(b"G")
        else:
            writer.write(begun.encode())
        while True:
            if kind == "a slow header":
                writer.write(b"X")
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(1.0):
                    if not await reader.read(100):
                        return
    except OSError:
        return
    finally:
        writer.transport.abort()


async def attack(port: int, count: int) -> None:
    """Hold so many connections at once until this process is ended; say each second how many were closed."""
    closed = 0

    async def one(kind: str) -> None:
        nonlocal closed
        while True:
            await half_open(port, kind, f"127.0.0.1:{port}")
            closed += 1
            await asyncio.sleep(0.01)

    tasks = [asyncio.create_task(one(KINDS[i % len(KINDS)])) for i in range(count)]
    while not any(task.done() for task in tasks):
        await asyncio.sleep(1.0)
        print(closed, flush=True)


@contextlib.contextmanager
def running(*words: str) -> Iterator[subprocess.Popen[str]]:
    """A process of this Python, ended at the end."""
    child = subprocess.Popen(
        [sys.executable, *words], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, cwd=HERE
    )
    try:
        yield child
    finally:
        child.terminate()
        child.wait()


COMMAND = ("-c", "from glapp.cli import main; main()")


def measured(seconds: float, count: int, target: str) -> dict[str, list[float]]:
    """Time of each log-in and each `disable` [s]; infinite where it was not answered as it should be."""
    found: dict[str, list[float]] = {"service login": [], "disable": [], "station login": []}
    with tempfile.TemporaryDirectory() as folder, contextlib.ExitStack() as stack:
        data = Path(folder)
        stack.enter_context(running(*COMMAND, "watch", "run", "--demo", "--data", folder, "--port", "0"))
        station = stack.enter_context(running(*COMMAND, "station", "--data", folder, "--port", "0"))
        assert station.stdout is not None
        while not (data / "api-url").exists() or not (data / "first-login.txt").exists():
            time.sleep(0.1)
        window = station.stdout.readline().removeprefix("The window is at ").strip().rstrip(".")
        api_url = (data / "api-url").read_text()
        password = re.findall(r"^password (\S+)$", (data / "first-login.txt").read_text(), re.MULTILINE)[0]
        body = {"user": "engineer", "password": password}

        def asked(what: str, method: str, url: str, good: int, **more: object) -> httpx.Response | None:
            began = time.monotonic()
            try:
                with httpx.Client(timeout=10.0, trust_env=False) as client:
                    reply = client.request(method, url, **more)  # type: ignore[arg-type]
            except httpx.TransportError as error:
                print(f"  {what}: {error!r}", flush=True)
                found[what].append(float("inf"))
                return None
            if reply.status_code != good:
                print(f"  {what}: {reply.status_code} {reply.text[:100]}", flush=True)
            found[what].append(time.monotonic() - began if reply.status_code == good else float("inf"))
            return reply

        token = ""
        while not token:  # until it has begun
            with contextlib.suppress(httpx.TransportError):
                token = httpx.post(f"{api_url}/login", json=body, trust_env=False).json()["token"]
        port = int((api_url if target == "service" else window).rpartition(":")[2])
        attacker = stack.enter_context(running("-m", "bench.half_open", "attack", str(port), str(count)))
        assert attacker.stdout is not None
        attacker.stdout.readline()
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            asked("service login", "POST", f"{api_url}/login", 200, json=body)
            headers = {"Authorization": f"Bearer {token}"}
            asked("disable", "POST", f"{api_url}/loops/{LOOP}/disable", 200, headers=headers, json={})
            form = {"data": body, "headers": {"Origin": window}}
            asked("station login", "POST", f"{window}/login", 303, **form)
            time.sleep(0.5)
        attacker.terminate()
        closed = attacker.stdout.read().split()
        print(f"{target}: {count} connections for {seconds:g} s; {closed[-1] if closed else 0} were closed meanwhile")
    return found


def main() -> None:
    """Measure service and station, one after the other."""
    if sys.argv[1:2] == ["attack"]:
        asyncio.run(attack(int(sys.argv[2]), int(sys.argv[3])))
        return
    seconds, count = float(sys.argv[1]), int(sys.argv[2])
    for target in sys.argv[3:] or ("service", "station"):
        for what, times in measured(seconds, count, target).items():
            lost = sum(time == float("inf") for time in times)
            ordered = sorted(times)
            print(f"  {what}: {len(times)}, not answered {lost}, median {ordered[len(times) // 2]:.3f} s, ", end="")
            print(f"slowest {ordered[-1]:.3f} s")


if __name__ == "__main__":
    main()
