"""Time that u_FF stands after each kind of loss, by the plant's own node: `python -m bench.service_zero`.

The simulated plant is in this process, with the watchdog and the ramp that `docs/plant.md` asks a control system for.
The service is a process of its own, by the command line. A loop is compensated, then something is lost; the node's
value is looked at every 20 ms until it is 0, and for five seconds after that.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Awaitable, Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import httpx

from glapp.service.plant import SimPlant

LOOP = "FIC101"
SCAN = 0.5
WATCHDOG, RAMP = 10.0, 30.0
LONGEST = 300.0


class Service:
    """The service, by the command line, and its API."""

    def __init__(self, data: Path, *words: str) -> None:
        self.data, self.words = data, words
        self.child: subprocess.Popen[str] | None = None
        self._headers: dict[str, str] = {}
        self._client = httpx.AsyncClient(timeout=30, trust_env=False)

    async def begin(self) -> None:
        """Start it, and log in."""
        (self.data / "api-url").unlink(missing_ok=True)
        words = ["watch", *self.words, "--data", str(self.data), "--port", "0"]
        command = [sys.executable, "-c", "from glapp.cli import main; main()", *words]
        self.child = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        await until(lambda: (self.data / "api-url").exists(), "it did not begin")
        self._api_url = (self.data / "api-url").read_text()
        first = (self.data / "first-login.txt").read_text()
        name, password = re.findall(r"^\w+ (\S+)$", first, re.MULTILINE)
        for _ in range(200):
            with contextlib.suppress(httpx.TransportError):
                body = {"user": name, "password": password}
                reply = await self._client.post(f"{self._api_url}/login", json=body)
                self._headers = {"Authorization": f"Bearer {reply.json()['token']}"}
                return
            await asyncio.sleep(0.1)

    def end(self) -> None:
        """Stop it, however the measurement ended."""
        if self.child is not None and self.child.poll() is None:
            self.child.kill()
            self.child.wait()

    async def asked(self, command: str, loop: str = LOOP, **body: Any) -> httpx.Response:
        """A command for a loop."""
        return await self._client.post(f"{self._api_url}/loops/{loop}/{command}", headers=self._headers, json=body)

    async def seen(self, path: str) -> Any:
        """Value at a path."""
        return (await self._client.get(f"{self._api_url}{path}", headers=self._headers)).json()

    async def status(self, loop: str = LOOP) -> dict[str, Any]:
        """Status of a loop, and `now`."""
        shown = await self.seen("/status")
        return {"now": shown["now"], **shown["loops"][loop]}

    async def compensated(self, plant: SimPlant) -> None:
        """Start it where it does not run; test the watchdog once; enable; and wait until u_FF is there."""
        if self.child is None or self.child.poll() is not None:
            await self.begin()
            await self.asked("parameters", values={"comp_size": 1.5})
        began, moved, sp, tested = time.monotonic(), 0.0, 47.0, False
        while abs(plant.u_ff(LOOP)) < 0.3:
            if not (await self.status())["compensation"]["enabled"]:
                reply = await self.asked("enable")
                if "glapp watch watchdog-test" in reply.text and not tested:
                    tested = (await self.asked("watchdog-test")).is_success
            if time.monotonic() - began > LONGEST:
                raise SystemExit(f"u_FF never came: {await self.status()}")
            if time.monotonic() - moved > 10.0:  # a setpoint that moves makes OP turn
                moved, sp = time.monotonic(), 100.0 - sp
                plant._loops[LOOP].graph["sp.value"] = sp
            await asyncio.sleep(0.1)


async def until(true: Callable[[], bool], why: str) -> None:
    """Wait for something."""
    began = time.monotonic()
    while not true():
        if time.monotonic() - began > LONGEST:
            raise SystemExit(why)
        await asyncio.sleep(0.02)


async def _measured(plant: SimPlant, lose: Callable[[], Awaitable[None]]) -> tuple[float, float, float, float]:
    """u_FF at the loss; seconds until it began to go, until it is 0; the greatest |u_FF| in the five seconds after."""
    await lose()
    began, left = time.monotonic(), abs(plant.u_ff(LOOP))
    fell = None
    seen = left
    while (now := abs(plant.u_ff(LOOP))) != 0.0:
        passed = time.monotonic() - began
        if now < seen - 1e-12 and fell is None:
            fell = passed
        elif now > seen:
            fell = None
        seen = now
        if passed > LONGEST:
            return left, fell or passed, passed, now
        await asyncio.sleep(0.02)
    zero = time.monotonic() - began
    after = 0.0
    while time.monotonic() - began - zero < 5.0:
        after = max(after, abs(plant.u_ff(LOOP)))
        await asyncio.sleep(0.02)
    return left, zero if fell is None else fell, zero, after


async def _all(only: str | None) -> None:
    """Measure every kind of loss, or only one."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        async with SimPlant(1, scan=SCAN, watchdog=WATCHDOG, ramp=RAMP) as plant:
            # A wide gap, so that OP turns, and u_FF with it, every few seconds.
            plant._loops[LOOP].kind = replace(plant._loops[LOOP].kind, d=3.0, wear=1e-9)
            settings = folder / "loops.toml"
            settings.write_text(plant.settings().replace("[opcua]", f"[opcua]\ninterval = {SCAN / 2}", 1))
            service = Service(folder / "data", str(settings))

            def fault(kind: str) -> Callable[[], Awaitable[None]]:
                """A loss by a fault of the plant."""

                async def lose() -> None:
                    plant.fault(kind, LOOP)

                return lose

            def sent(what: int) -> Callable[[], Awaitable[None]]:
                async def lose() -> None:
                    assert service.child is not None
                    os.kill(service.child.pid, what)

                return lose

            async def disabled() -> None:
                await service.asked("disable")

            losses: dict[str, Callable[[], Awaitable[None]]] = {
                "somebody disables it": disabled,
                "manual": fault("manual"),
                "PV has a bad status": fault("bad"),
                "PV comes no more": fault("silent"),
                "somebody else writes u_FF": fault("writer"),
                "the plant's server is gone": plant.close,
                "the service is stopped (SIGTERM)": sent(signal.SIGTERM),
                "the service is killed (-9)": sent(signal.SIGKILL),
                "the service hangs (SIGSTOP)": sent(signal.SIGSTOP),
            }
            heads = "u_FF then, %", "begins to fall after, s", "0 after, s", "greatest in 5 s after", "why, it says"
            print(f"| loss | {' | '.join(heads)} |")
            print("|---|---|---|---|---|---|", flush=True)
            for what, lose in losses.items():
                if only is not None and only not in what:
                    continue
                await service.compensated(plant)
                left, fell, zero, after = await _measured(plant, lose)
                for kind in ("manual", "bad", "silent"):
                    plant.fault(kind, LOOP, 0.0)
                if "server is gone" in what:
                    await plant.open()
                assert service.child is not None
                if "SIGSTOP" in what:
                    service.child.send_signal(signal.SIGCONT)
                if "SIGTERM" in what or "-9" in what:
                    service.child.wait()
                    if "-9" in what:
                        await service.begin()
                await asyncio.sleep(5.0)
                late = abs(plant.u_ff(LOOP))
                made = (await service.status())["compensation"] if service.child.poll() is None else None
                why = "" if made is None else made["why_off"] or f"enabled, and {made['standing']}"
                row = (what, f"{left:.2f}", f"{fell:.1f}", f"{zero:.1f}", f"{max(after, late):.2f}", why)
                print("| " + " | ".join(row) + " |", flush=True)
                if made is not None and made["enabled"]:
                    await service.asked("disable")
            if service.child is not None and service.child.poll() is None:
                service.child.terminate()
                await asyncio.to_thread(service.child.wait)


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", help="losses with this in their name")
    asyncio.run(_all(parser.parse_args().only))


if __name__ == "__main__":
    main()
