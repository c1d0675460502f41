"""Commands of persons: settings, compensation, watchdog tests, fits. Each command is logged with who asked."""

from __future__ import annotations

import json
from collections.abc import Awaitable, Callable, Mapping
from contextlib import suppress
from typing import Any

from ..errors import InputError
from ..estimate import Estimator
from ..loop import Loop
from .compensation import Compensator
from .feedforward import PLANT_ANSWERS, FeedForward
from .fit_queue import FitQueue
from .journal import Journal
from .settable import DETECTOR, SETTINGS, Bound, bounds_of, compensation_settings
from .signal import Event, Plant, WriteRefused, answered_within
from .store import Reader, StoreFull
from .watchdog import WATCHDOG_SEEN, Watchdog
from .watched import WatchedLoop, loop_with

__all__ = ["Commands"]


class Commands:
    """The commands of a monitor. What cannot be logged is not done; only ending a compensation always is.

    - `given`: the loops as loops.toml has them.
    - `loops`: the loops as they are watched.
    - `journal`: keeps the log.
    - `reader`: of the journal's store.
    - `feedforward`: writes u_FF.
    - `watchdog`: of the plant.
    - `fits`: fits the loops.
    - `clock`: the time [s since 1970 UTC].
    - `save`: writes the state of all loops, so that what came before a change is not taken in again with other
      settings.
    """

    def __init__(
        self,
        given: Mapping[str, Loop],
        loops: Mapping[str, WatchedLoop],
        journal: Journal,
        reader: Reader,
        feedforward: FeedForward,
        watchdog: Watchdog,
        fits: FitQueue,
        clock: Callable[[], float],
        *,
        save: Callable[[], Awaitable[None]],
    ) -> None:
        self._given, self._loops, self._journal, self._reader = given, loops, journal, reader
        self._feedforward, self._watchdog, self._fits = feedforward, watchdog, fits
        self._clock, self._save = clock, save

    # Settings

    def bounds(self, loop: str) -> dict[str, Bound]:
        """Bounds of all settable parameters of a loop, by its present settings."""
        watched = self._loops[loop]
        limits = None if watched.compensator is None else watched.plant_limits
        return bounds_of(watched.loop, compensation_settings(self._reader.settings(loop)), limits)

    def settings(self, loop: str) -> dict[str, Any]:
        """Settable parameters of a loop, as in force: of its detector, and of its compensation where it has one."""
        watched = self._loops[loop]
        ideal = watched.loop.ideal()
        values: dict[str, Any] = {
            "k": None if ideal is None else ideal.k,
            "ti": None if ideal is None else ideal.ti,
            "td": None if ideal is None else ideal.td,
            "setpoint_weight": None if ideal is None else ideal.b,
            "kp": watched.loop.kp(),
            "tf": watched.loop.tf,
            "n": watched.loop.n,
            "acceptable_dead_band": watched.loop.acceptable_dead_band,
        }
        if watched.compensator is not None:
            values |= {name: watched.compensator.setting(name) for name in SETTINGS}
        return values

    async def change(self, loop: str, values: Mapping[str, float | None], person: str, role: str) -> dict[str, Any]:
        """Set parameters of a loop's detector or compensation, all of them or none; gives the settings in force then.

        A detector with a changed parameter starts again: no estimate comes from detections with two settings.

        Raises InputError for a name that is none, or a value out of its bounds. Raises StoreFull where it cannot be
        logged: then it is not done.
        """
        watched, before = self._loops[loop], self.settings(loop)
        for name in values:
            if name not in before:
                hint = f"there are {', '.join(before)}"
                raise InputError("no such parameter of this loop", loop=loop, parameter=name, hint=hint)
        all_set = self._reader.settings(loop) | dict(values)
        of_detector = any(name in DETECTOR for name in values)
        at_work = watched.compensator is not None and (watched.compensator.enabled or watched.compensator.u_ff != 0.0)
        if of_detector and at_work:
            raise InputError("is compensated: disable that first", loop=loop, parameter=next(iter(values)))
        # A loop and a compensation are made of all settings first, so that either all of them are set or none.
        limits = watched.plant_limits if watched.compensator is not None else None
        changed, compensator = loop_with(self._given[loop], all_set, watched.period, limits, values)
        shown = {name: before[name] for name in values}
        if not of_detector:
            assert watched.compensator is not None  # all other names are a compensation's
            watched.compensator.set_all(values)
            after = {name: self.settings(loop)[name] for name in values}
            try:
                await self._journal.log(person, role, "change", loop, shown, after, settings=values)
            except StoreFull:
                watched.compensator.set_all(shown)
                raise
            return self.settings(loop)
        detector = None if changed.controller is None else Estimator(changed, watched.period)
        await self._save()
        old = watched.loop, watched.detector, watched.compensator
        watched.loop, watched.detector = changed, detector
        if watched.compensator is not None:
            watched.compensator = compensator
        after = {name: self.settings(loop)[name] for name in values}
        states = {watched.id: watched.state()}
        try:
            await self._journal.log(person, role, "change", loop, shown, after, settings=values, states=states)
        except StoreFull:
            watched.loop, watched.detector, watched.compensator = old
            raise
        return self.settings(loop)

    async def take_over(self, loop: str, answer: int, person: str, role: str) -> dict[str, Any]:
        """Put a fit's result in force: the width for compensation, Kp, and K, Ti, Td where the loop has none.

        Raises InputError where there is no such answer, or it holds nothing to take over.
        """
        found = self._reader.answer(loop, answer)
        if found is None:
            raise InputError("no such answer of this loop", loop=loop, parameter="answer", value=answer)
        known = self.settings(loop)
        learnt = json.loads(found["document"])["learnt"]
        values = {name: value for name, value in learnt.items() if known[name] is None}
        if "comp_fitted" in known and found["compensable"] is not None:
            values["comp_fitted"] = found["compensable"]
        if not values:
            text = f"holds nothing to take over: its verdict is {found['verdict']}"
            raise InputError(text, loop=loop, parameter="answer", value=answer)
        return await self.change(loop, values, person, role)

    # Compensation

    async def enable(self, loop: str, person: str, role: str) -> dict[str, Any]:
        """Let a loop be compensated, by the name of the person who answers for it.

        Raises InputError where the loop has no node for u_FF, no width, or is too slow, or its watchdog test was not
        passed. Raises StoreFull where it cannot be logged: then it is not done.
        """
        watched = self._loops[loop]
        compensator, source = self._compensator(watched), self._plant(loop)
        if self._journal.failing is not None:
            raise StoreFull(self._journal.failing)
        if WATCHDOG_SEEN not in self._reader.settings(loop):
            raise InputError(
                "it was never seen that the plant takes u_FF away by itself when nobody counts its watchdog up",
                loop=loop,
                hint=f"Test switching off in the window, or glapp watch watchdog-test {loop}",
            )
        self._require_no_test(loop)
        self._watchdog.require_none_stuck(loop)
        before = compensator.status()
        try:
            await self._feedforward.enable(watched, compensator, source)
            await self._journal.log(person, role, "enable", loop, before, compensator.status())
        except BaseException as error:
            compensator.disable("it could not be enabled")
            self._feedforward.allow_only_zero(loop)
            if isinstance(error, WriteRefused):
                raise InputError(f"cannot be enabled: {error}", loop=loop) from None
            raise
        self._journal.add_event(Event(self._clock(), loop, "enabled", f"{person} enabled compensation"))
        watched.pv_came.set()
        return compensator.status()

    async def disable(self, loop: str, person: str, role: str) -> dict[str, Any]:
        """End the compensation of a loop; that is done even where it cannot be logged.

        Raises InputError where the loop cannot be compensated at all. Raises StoreFull where it could not be logged; it
        is done.
        """
        watched = self._loops[loop]
        compensator = self._compensator(watched)
        before = compensator.status()
        self._feedforward.switch_off(watched, f"{person} disabled it")
        await self._journal.log(person, role, "disable", loop, before, compensator.status())
        return compensator.status()

    async def watchdog_test(self, loop: str, person: str, role: str) -> None:
        """Begin a watchdog test: a small u_FF is written, the heartbeat stops, and the plant must take u_FF away.

        A loop is only enabled after its test was passed. Events report how the test ends.

        Raises InputError where any loop is compensated, or this one cannot be. Raises StoreFull where it cannot be
        logged: then it is not done.
        """
        watched = self._loops[loop]
        self._compensator(watched)
        source = self._plant(loop)
        self._require_no_test(loop)
        if working := ", ".join(other.loop.name for other in self._feedforward.at_work):
            raise InputError(f"the watchdog stands still in a watchdog test, and {working} would lose u_FF", loop=loop)
        self._watchdog.require_none_stuck(loop)
        try:
            await answered_within(PLANT_ANSWERS, source.heartbeat())
            source.enable(loop)
        except WriteRefused as refused:
            raise InputError(f"its watchdog cannot be tested: {refused}", loop=loop) from None
        await self._journal.log(person, role, "drill", loop, None, None)
        self._watchdog.begin_test(watched, source, person, role)

    def _compensator(self, watched: WatchedLoop) -> Compensator:
        """The compensator of a loop; refused where it has none."""
        if watched.compensator is None:
            why = "its controller is not known" if watched.loop.controller is None else "no node for u_FF is named"
            raise InputError(f"cannot be compensated: {why}", loop=watched.loop.name)
        return watched.compensator

    def _plant(self, loop: str) -> Plant:
        """The connected plant; refused without a connection."""
        if self._feedforward.source is None:
            raise InputError("there is no connection", loop=loop)
        return self._feedforward.source

    def _require_no_test(self, loop: str) -> None:
        if self._watchdog.tests:
            raise InputError("a watchdog test is under way: wait until it is over", loop=loop)

    # Fits, and refused commands

    async def fit(self, loop: str, person: str, role: str) -> None:
        """Queue the fit of a loop.

        Raises StoreFull where it cannot be logged: then it is not done.
        """
        await self._journal.log(person, role, "fit", loop, None, None)
        self._fits.ask(loop, person)

    async def refused(self, person: str, role: str, command: str, loop: str | None, asked: Any, why: str) -> None:
        """Log what somebody asked for and did not get."""
        with suppress(StoreFull):
            await self._journal.log(person, role, command, loop, None, asked, refused=why)
