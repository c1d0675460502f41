"""Time to u_FF = 0 after each loss [s], settings at the ends of their bounds: `python -m bench.service_bounds`.

Eight flows are compensated by one service, which is a process of its own. Each has another corner of what may be set:
`comp_release`, `comp_rate` and `comp_limit` at their least and their greatest, which the service itself lists. They are
set while u_FF stands at its height: a rate that was always so small would have made none. Then something is lost, for
all of them at once, in real time.

What is measured is what stands at the plant's own nodes, as another maker's OPC UA client reads it every 50 ms
(node-opcua, which `make interop` brings). The simulated plant is in this process, with the watchdog (10 s) and the ramp
(30 s) that `docs/plant.md` asks a control system for.

Ends with 1 where u_FF was not 0 in time, or was greater than `u_ff_limit`.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import itertools
import json
import os
import signal
import sys
import tempfile
import time
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

from glapp.reading.settings import read_settings
from glapp.service import plant as of_plant
from glapp.service.compensation import LATE
from glapp.service.options import MonitorOptions
from glapp.service.plant import NAMESPACE, SimPlant
from glapp.service.store import Store
from glapp.service.watchdog import WATCHDOG_SEEN

from .service_zero import LONGEST, RAMP, SCAN, WATCHDOG, Service, until

ROOT = Path(__file__).parents[1]
HEIGHT = 0.3
CORNERS = list(itertools.product(("least", "greatest"), repeat=3))
SET = ("comp_release", "comp_rate", "comp_limit")
TINY = 1e-6  # of what must be above 0


@dataclass
class Look:
    """State of the nodes as another maker's client sees it."""

    child: asyncio.subprocess.Process
    now: dict[str, float | None] = field(default_factory=dict)
    moved: dict[str, float] = field(default_factory=dict)  # when it was last something other than 0, or not to be read
    greatest: float = 0.0

    @classmethod
    async def begin(cls, plant: SimPlant) -> Look:
        """Start it."""
        command = ["node", str(ROOT / "tests" / "interop" / "look.js"), plant.url, NAMESPACE, *plant.names]
        modules = {"NODE_PATH": str(ROOT / "target" / "interop" / "node_modules")}
        pipe = asyncio.subprocess.PIPE
        return cls(
            await asyncio.create_subprocess_exec(*command, stdin=pipe, stdout=pipe, env={**os.environ, **modules})
        )

    def end(self) -> None:
        """Stop it, however the measurement ended."""
        if self.child.returncode is None:
            self.child.kill()

    async def read(self) -> None:
        """Read the program's output until its end."""
        assert self.child.stdout is not None
        async for line in self.child.stdout:
            if not line.startswith(b"[1"):  # the stack has words of its own
                continue
            t, loop, value = json.loads(line)
            for name in [loop] if loop is not None else list(self.now):
                # The state until now was that.
                if self.now.get(name) != 0.0 or value != 0.0:
                    self.moved[name] = t
                self.now[name] = value
                self.greatest = max(self.greatest, abs(value or 0.0))


async def _asked_all(service: Service, plant: SimPlant, command: str) -> None:
    replies = await asyncio.gather(*(service.asked(command, loop) for loop in plant.names))
    assert all(reply.is_success for reply in replies), [reply.text for reply in replies]


async def _tell_events(service: Service) -> None:
    for event in await service.seen("/events?most=60"):
        print(f"{event['time'] % 1000:.1f} {event['loop']} {event['kind']}: {event['text']}", file=sys.stderr)


async def _at_height(service: Service, plant: SimPlant, look: Look) -> None:
    """State with all loops compensated, u_FF at its height, and each loop's settings in its corner."""
    usual = {"comp_size": 1.5, **dict.fromkeys(SET)}
    corners = dict(zip(plant.names, CORNERS, strict=True))
    replies: dict[str, str] = {}
    left, began, moved, sp = dict[str, tuple[str, ...]](), time.monotonic(), 0.0, 47.0
    while True:
        if not left:  # one may have turned, or have been withdrawn, while the others rose
            left = {loop: corners[loop] for loop in plant.names if abs(look.now.get(loop) or 0.0) < HEIGHT / 2.0}
            if not left:
                return
            for loop in left:
                reply = await service.asked("parameters", loop, values=usual)
                assert reply.is_success, reply.text
        shown = (await service.seen("/status"))["loops"]
        for loop in plant.names:
            if not shown[loop]["compensation"]["enabled"]:
                replies[loop] = (await service.asked("enable", loop)).text
        for loop, corner in list(left.items()):
            if abs(look.now.get(loop) or 0.0) < HEIGHT:
                continue
            bounds = await service.seen(f"/loops/{loop}/bounds")
            least = {name: bounds[name]["low"] if bounds[name]["zero"] else TINY for name in SET}
            ends = {
                name: bounds[name]["high"] if end == "greatest" else least[name]
                for name, end in zip(SET, corner, strict=True)
            }
            reply = await service.asked("parameters", loop, values=ends)
            assert reply.is_success, reply.text
            del left[loop]
        if time.monotonic() - began > LONGEST:
            await _tell_events(service)
            standing = {loop: shown[loop]["compensation"]["standing"] for loop in left}
            raise SystemExit(f"u_FF never came: {left}, {replies}; now {standing}, seen {look.now}")
        if time.monotonic() - moved > 10.0:  # a setpoint that moves makes OP turn
            moved, sp = time.monotonic(), 100.0 - sp
            for loop in plant.names:
                plant._loops[loop].graph["sp.value"] = sp
        await asyncio.sleep(0.1)


async def _lost(look: Look, plant: SimPlant, lose: Callable[[], Awaitable[None]]) -> tuple[list[float], list[float]]:
    """|u_FF| at the loss, and seconds until it is 0 for good, of each loop."""
    then = [abs(look.now.get(loop) or 0.0) for loop in plant.names]
    began, since = time.time(), time.monotonic()
    await lose()
    quiet = time.monotonic()
    while time.monotonic() - quiet < 5.0:
        if any(look.now.get(loop) != 0.0 for loop in plant.names):
            quiet = time.monotonic()
        if time.monotonic() - since > LONGEST:
            raise SystemExit(f"u_FF stands after {LONGEST:g} s: {look.now}")
        await asyncio.sleep(0.05)
    return then, [max(look.moved.get(loop, began) - began, 0.0) for loop in plant.names]


async def _all(only: list[str]) -> int:
    usual = of_plant._kinds
    # Wide gaps, so that OP turns, and u_FF with it, every few seconds.
    of_plant._kinds = lambda h: [replace(usual(h)[0], d=3.0, wear=1e-9)]
    late = 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        async with (
            SimPlant(len(CORNERS), scan=SCAN, watchdog=WATCHDOG, ramp=RAMP) as plant,
            contextlib.AsyncExitStack() as at_end,
        ):
            settings = folder / "loops.toml"
            settings.write_text(plant.settings().replace("[opcua]", f"[opcua]\ninterval = {SCAN / 2}", 1))
            loops = read_settings(settings)
            store = Store(folder / "data")
            store.know(loops)
            for loop in plant.names:  # `bench.service_zero` has the watchdog test itself
                store.command(
                    time.time(), "bench", "engineer", "drilled", loop, None, None, settings={WATCHDOG_SEEN: {}}
                )
            store.close()
            service, look = Service(folder / "data", str(settings)), await Look.begin(plant)
            at_end.callback(service.end)
            at_end.callback(look.end)
            reading = asyncio.create_task(look.read())
            await service.begin()
            ti = loops[0].ideal().ti  # type: ignore[union-attr]
            limit, period = loops[0].opcua.u_ff_limit or 0.0, loops[0].sample_time or MonitorOptions().period
            longest = min(10.0 * ti, 300.0)

            def fault(kind: str) -> Callable[[], Awaitable[None]]:
                async def lose() -> None:
                    """Give every loop of the plant this fault."""
                    for loop in plant.names:
                        plant.fault(kind, loop)

                return lose

            async def disabled() -> None:
                await _asked_all(service, plant, "disable")

            async def killed() -> None:
                assert service.child is not None
                os.kill(service.child.pid, signal.SIGKILL)

            async def server_lost() -> None:
                await plant.close()
                await asyncio.sleep(15.0)
                await plant.open()

            by_plant = WATCHDOG + RAMP
            losses: dict[str, tuple[Callable[[], Awaitable[None]], float]] = {
                "disable": (disabled, longest),
                "PV bad": (fault("bad"), longest),
                "PV silent": (fault("silent"), 30.0 * period + longest),
                "manual": (fault("manual"), 0.0),
                "kill -9": (killed, by_plant),
                "server lost": (server_lost, by_plant),
            }
            print(f"Ti {ti:g} s, so that the longest release is {longest:g} s; u_ff_limit {limit:g} %\n")
            corners = [
                "/".join(end[0].upper() if end == "greatest" else end[0] for end in corner) for corner in CORNERS
            ]
            print("Seconds to 0; release/rate/limit at the least (l) and at the greatest (G)\n")
            print(f"| loss | {' | '.join(corners)} | allowed | u_FF then, % |", flush=True)
            print("|---" * (len(CORNERS) + 3) + "|")
            for what, (lose, within) in losses.items():
                if only and what not in only:
                    continue
                await _at_height(service, plant, look)
                then, took = await _lost(look, plant, lose)
                allowed = within + 3.0 * period + LATE
                if any(one > allowed for one in took):
                    late += 1
                    if service.child is not None and service.child.poll() is None:
                        await _tell_events(service)
                shown = [f"{one:.1f}" for one in took]
                print(
                    f"| {what} | {' | '.join(shown)} | {allowed:.1f} | {min(then):.2f} to {max(then):.2f} |", flush=True
                )
                for kind in ("manual", "bad", "silent"):
                    for loop in plant.names:
                        plant.fault(kind, loop, 0.0)
                if what == "kill -9":
                    assert service.child is not None
                    service.child.wait()
                    await service.begin()
                else:
                    await _asked_all(service, plant, "disable")
                await until(lambda: all(look.now.get(loop) == 0.0 for loop in plant.names), "u_FF came back")
            print(f"\nThe greatest |u_FF| seen: {look.greatest:.3f} % of u_ff_limit {limit:g} %")
            assert service.child is not None
            service.child.terminate()
            await asyncio.to_thread(service.child.wait)
            assert look.child.stdin is not None
            look.child.stdin.close()
            await look.child.wait()
            await reading
            return 1 if late or look.greatest > limit else 0


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="*", default=[], help="these losses")
    raise SystemExit(asyncio.run(_all(parser.parse_args().only)))


if __name__ == "__main__":
    main()
