"""Ninety days of a valve, as the service saw them: `python -m bench.service_story`, about a quarter of an hour.

`glapp watch --demo --days 90 --scan 60 --loops 2 --repair 42` runs as a process of its own. An engineer asks through
its API, as `glapp watch watchdog-test`, `take-over`, `set` and `enable` do: a watchdog test on day 20; the first fit
after day 30 is taken over; four days later compensation is enabled, and again a day after it was withdrawn. On day 42
the valve is repaired, and nobody tells the compensation. u_FF is looked at in the plant's own node, by a client of its
own. Ended by SIGTERM it tells what was until then.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import itertools
import json
import logging
import math
import signal
import tempfile
import time
from datetime import UTC
from pathlib import Path
from typing import Any

import numpy as np
from asyncua import Client, ua
from bench.service_zero import LOOP, Service, until

from glapp.service.connection import read_connection
from glapp.service.plant import NAMESPACE
from glapp.service.recordings import SignalStore
from glapp.service.store import Reader

DAYS, SCAN, REPAIR = 90.0, 60.0, 42.0
WATCHDOG_TEST, TAKE_OVER, BEFORE = 20.0, 30.0, 4.2
WATCH = 1500 * 6 * SCAN
"""`comp_watch` [s]: 1500 Ti, within which the setpoint moves five times."""

DAY = 86_400.0


def gap(day: float) -> float:
    """True width of the gap on a day [% of OP]."""
    return 0.3 + 0.03 * (day if day < REPAIR else day - REPAIR)


class _Node:
    """u_FF as it stands in the plant's own node: (plant's time, value), every change of it."""

    def __init__(self) -> None:
        self.seen: list[tuple[float, float]] = []

    def datachange_notification(self, node: Any, value: float, data: Any) -> None:
        """A change."""
        at = data.monitored_item.Value.SourceTimestamp
        if value is not None and at is not None:
            self.seen.append((at.replace(tzinfo=UTC).timestamp(), float(value)))


async def _told(told: list[tuple[float, str]], begin: float, service: Service) -> None:
    """Do what the engineer does, until the ninety days are over."""
    done: set[str] = set()
    taken = enabled_at = off_at = math.inf
    tries = 0

    def tell(now: float, text: str) -> None:
        told.append(((now - begin) / DAY, text))
        print(f"day {told[-1][0]:6.2f}: {text}", flush=True)

    while True:
        shown = await service.status()
        now, answer, made = shown["now"], shown["answer"], shown["compensation"]
        day = (now - begin) / DAY
        if day >= DAYS - 0.1:
            return
        if "watchdog test" not in done and day >= WATCHDOG_TEST:
            done.add("watchdog test")
            if not (reply := await service.asked("watchdog-test")).is_success:
                raise SystemExit(reply.text)
            tell(now, "watchdog test asked for")
        usable = answer is not None and answer["verdict"] == "backlash" and answer["compensable"]
        if "taken" not in done and day >= TAKE_OVER and usable and answer["time"] >= begin + TAKE_OVER * DAY:
            done.add("taken")
            await service.asked("parameters", values={"comp_watch": WATCH})
            reply = await service.asked("take_over", answer=answer["id"])
            tell(now, f"taken over: {reply.json()['comp_fitted']:.3g} %, of a fit that said {_interval(answer)}")
            taken = now
        if made["enabled"] is False and enabled_at < math.inf:
            off_at, enabled_at = now, math.inf
            tell(now, f"off: {made['why_off']}; standing {made['standing']}")
            if "over_compensated" in made["why_off"]:
                done.add("over")
                await service.asked("parameters", values={"comp_fitted": None})
                tell(now, "its width is taken out")
        waits = taken + BEFORE * DAY if tries == 0 else off_at + DAY
        if "over" not in done and enabled_at == math.inf and now >= waits:
            reply = await service.asked("enable")
            if not reply.is_success:
                raise SystemExit(reply.text)
            tries, enabled_at = tries + 1, now
            tell(now, f"enabled, δ = {reply.json()['delta']:.3g} %, delay {reply.json()['delay']:.3g} s")
        await asyncio.sleep(0.1)


def _interval(answer: dict[str, Any]) -> str:
    return f"{answer['d']:.3g} ({answer['low']:.3g} to {answer['high']:.3g}) %"


def _table(folder: Path, begin: float, told: list[tuple[float, str]], node: _Node) -> None:
    """What was told, and between the lines how PV was."""
    signals = SignalStore(folder)
    print("\n| day | what | true gap, % | PV − SP since, % (standard deviation) | mean of its magnitude |")
    print("|---|---|---|---|---|")
    for (day, text), (after, _) in itertools.pairwise([*told, (DAYS, "")]):
        table = signals.read(LOOP, begin + day * DAY, begin + after * DAY)
        e = table["PV"].to_numpy() - table["SP"].to_numpy()
        e = e[np.isfinite(e)]
        said = f"{e.std():.3f} | {np.abs(e).mean():.3f}" if len(e) else " | "
        print(f"| {day:.2f} | {text} | {gap(day):.2f} | {said} |")
    with Reader(folder) as reader:
        print("\n| day | true gap in its seven days, % | told | width, % | 95 % interval, % | urgency |")
        print("|---|---|---|---|---|---|")
        for one in reversed(reader.answers(LOOP, 1000)):
            last = (one["t_end"] - begin) / DAY
            true = np.mean([gap(last - back) for back in np.linspace(0.0, min(7.0, last), 200)])
            low, high = (one[name] for name in ("low", "high"))
            within = f"{low:.2f} to {high:.2f}" if low is not None and high is not None else f"{low}, {high}"
            width = "" if one["d"] is None else f"{one['d']:.2f}"
            print(f"| {last:.1f} | {true:.2f} | {one['verdict']} | {width} | {within} | {one['urgency']} |")
        print()
        for event in reversed(reader.events(most=100_000)):
            if event["kind"] not in ("answer", "signals_closed", "signals_forgotten"):
                print(
                    f"day {(event['time'] - begin) / DAY:6.2f} {event['kind']} {event['loop'] or ''}: {event['text']}"
                )
    print(f"\nu_FF at the plant's node changed {len(node.seen)} times; around each time that it was switched off:")
    for off in [begin + day * DAY for day, text in told if text.startswith("off")]:
        for at, value in [one for one in node.seen if abs(one[0] - off) <= 0.02 * DAY]:
            print(f"  day {(at - begin) / DAY:.4f}, {(at - off) / 60.0:+.0f} min: {value:g} %")


async def _run(keep: Path | None) -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = keep or Path(name)
        words = ("--demo", "--days", f"{DAYS:g}", "--scan", f"{SCAN:g}", "--loops", "2", "--repair", f"{REPAIR:g}")
        service, node, told = Service(folder, *words), _Node(), list[tuple[float, str]]()
        begin = time.time() - DAYS * DAY
        began = time.monotonic()
        await service.begin()
        await until(lambda: (folder / "demo.toml").exists(), "it did not begin")
        connection = read_connection(folder / "demo.toml")
        assert connection is not None and service.child is not None
        try:
            async with Client(connection.url) as client:
                index = await client.get_namespace_index(NAMESPACE)
                subscription = await client.create_subscription(20, node)
                tag = client.get_node(ua.NodeId(f"{LOOP}.U_FF", index))
                await subscription.subscribe_data_change(tag, queuesize=1000, sampling_interval=10)
                telling = asyncio.create_task(_told(told, begin, service))
                asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, telling.cancel)
                with contextlib.suppress(asyncio.CancelledError):
                    await telling
        finally:
            service.child.terminate()
            await asyncio.to_thread(service.child.wait)
        print(f"{time.monotonic() - began:.0f} s")
        (folder / "told.json").write_text(json.dumps({"begin": begin, "told": told, "node": node.seen}))
        _table(folder, begin, told, node)


def main() -> None:
    """Read the command line."""
    logging.getLogger("asyncua").setLevel(logging.CRITICAL)
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, help="keep the service's folder here")
    asyncio.run(_run(parser.parse_args().data))


if __name__ == "__main__":
    main()
