"""Write the golden cases of every block: `python vectors/make.py`.

Each block is written here a second time, in plain Python, from its equations and in the order of operations that its
documentation states. Python's floats are IEEE 754 doubles, so the block in every other language must give these outputs
to the last bit (LREAL on a PLC: to a few units in the last place).

A block's function takes the parameters, the time before each sample and the samples, and gives the outputs. To add a
block, write its function and its cases, and name it in `BLOCKS`.
"""

from __future__ import annotations

import itertools
import json
import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from fractions import Fraction
from pathlib import Path
from random import Random
from typing import Any

Params = dict[str, float]
Reference = Callable[[Params, Sequence[float], Sequence[Any]], list[Any]]
NAN = math.nan


def backlash(params: Params, _h: Sequence[float], xs: Sequence[float]) -> list[float]:
    """Output rests until the input has taken up half of d on either side."""
    half = params["d"] / 2.0
    output = params.get("output")
    outputs = []
    for x in xs:
        if output is None:
            outputs.append(x)
            output = None if math.isnan(x) else x
            continue
        if x - half > output:
            output = x - half
        if x + half < output:
            output = x + half
        outputs.append(output)
    return outputs


def backlash_cases() -> Iterator[dict[str, Any]]:
    """Follow, rest, turn; start; edges and rounding."""
    wander = list(_walk(1, 80))
    yield case("down and up through the gap", [], {"d": 2.0}, [0.0, 0.9, 3.0, 2.0, 1.5, 0.5, -3.0, -2.5, 0.0, 1.0])
    yield case("no gap at all", ["ZeroWidth"], {"d": 0.0}, wander[:20])
    yield case("begins at a given position", ["Start"], {"d": 0.5, "output": 0.4}, [0.0, 0.1, 0.2, 0.65, 0.7, 0.1])
    yield case("begins outside its reach", ["Start"], {"d": 0.5, "output": 7.0}, [0.0, 0.1, -0.2, 0.3])
    yield case("wandering", [], {"d": 0.05}, wander)
    yield case("wandering the other way", ["Sign"], {"d": 0.05}, [-x for x in wander])
    yield case("exactly at the edge", ["Edge"], {"d": 0.1}, [0.3, 0.3 + 0.05, 0.35, 0.3 - 0.05, 0.25, 0.3, 0.4, 0.35])
    yield case("not a number in between", ["NotANumber"], {"d": 0.5}, [1.0, NAN, 2.0, NAN, 1.9, 1.0])
    yield case("not a number at the start", ["NotANumber", "Start"], {"d": 0.5}, [NAN, NAN, 1.0, 2.0])
    yield case("large and small together", ["Rounding"], {"d": 1e-3}, [1e9 + x for x in wander[:30]])


def noise(params: Params, _h: Sequence[float], xs: Sequence[float]) -> list[float]:
    """Uniform noise of ± amplitude; Python's integers have no limit, so no need for Schrage's way."""
    modulus = 2**31 - 1
    s = int(params["integer"])
    if not 1 <= s < modulus:
        s = 1
    outputs = []
    for x in xs:
        s = 48271 * s % modulus
        outputs.append(x + params["amplitude"] * ((s / 2147483647.0 - 0.5) * 2.0))
    return outputs


def noise_cases() -> Iterator[dict[str, Any]]:
    """Streams from good and bad integers."""
    wander = list(_walk(2, 40))
    yield case("from 1", [], {"amplitude": 1.0, "integer": 1}, [0.0] * 40)
    yield case("on a signal", [], {"amplitude": 0.005, "integer": 123456789}, wander)
    yield case("no noise", ["ZeroAmplitude"], {"amplitude": 0.0, "integer": 5}, wander[:10])
    yield case("greatest integer", ["Overflow"], {"amplitude": 1.0, "integer": 2147483646}, [0.0] * 10)
    yield case("products near the limit", ["Overflow"], {"amplitude": 1.0, "integer": 2147439487}, [0.0] * 10)
    for integer in (0, -1, 2147483647, -2147483648):
        yield case("not an integer of the generator", ["BadState"], {"amplitude": 1.0, "integer": integer}, [0.0] * 5)
    yield case("not a number passes", ["NotANumber"], {"amplitude": 1.0, "integer": 7}, [1.0, NAN, 1.0])


def pid(params: Params, h: Sequence[float], samples: Sequence[Sequence[float]]) -> list[float]:
    """Compute the ideal form (4.1) within limits, with tracking; a third input is the output in manual."""
    k, ti, td, b = params["k"], params["ti"], params["td"], params["b"]
    low, high = params.get("low", -math.inf), params.get("high", math.inf)
    integral = output = 0.0
    y_old = None
    outputs = []
    for step, (ysp, y, manual) in zip(h, samples, strict=True):
        good = step > 0.0 and math.isfinite(ysp) and math.isfinite(y)
        if good:
            proportional = k * (b * ysp - y)
            derivative = 0.0 if y_old is None or td == 0.0 else k * td / step * (y - y_old)
        if not math.isnan(manual):
            u = min(max(manual, low), high)
            integral = u - (proportional - derivative) if good else integral + (u - output)
            output = u
        elif good:
            i = integral + k * step / ti * (ysp - y)
            v = (proportional - derivative) + i
            output = min(max(v, low), high)
            integral = i + (output - v) * (step / (ti + step))
        if good:
            y_old = y
        outputs.append(output)
    return outputs


def pid_cases() -> Iterator[dict[str, Any]]:
    """Auto and manual, limits, steps of any length, bad samples."""
    pi = {"k": 0.775, "ti": 2.05, "td": 0.0, "b": 0.0}
    full = {"k": 1.12, "ti": 2.4, "td": 0.619, "b": 0.5}
    tight = {"low": -0.2, "high": 0.3}
    ys = list(_walk(3, 60))
    auto = [[1.0 if i >= 10 else 0.0, y, NAN] for i, y in enumerate(ys)]
    yield case("PI", [], pi, auto, h=0.05)
    yield case("PI, direct-acting", ["Sign"], pi | {"k": -0.775}, auto, h=0.05)
    yield case("PI with setpoint weight", [], pi | {"b": 1.0}, auto, h=0.05)
    yield case("PID", [], full, auto, h=0.05)
    yield case("PID, steps of any length", ["IrregularStep"], full, auto, h=list(_walk(4, 60, low=0.01, high=0.2)))
    yield case("PI at its limits", ["Limits"], pi | tight, auto, h=0.05)
    yield case("PID at its limits", ["Limits"], full | tight, auto, h=0.05)
    half = [[ysp, y, 0.25 if 20 <= i < 30 else NAN] for i, (ysp, y, _) in enumerate(auto)]
    yield case("PI to manual and back", ["Manual"], pi, half, h=0.05)
    yield case("PID to manual and back", ["Manual"], full, half, h=0.05)
    yield case("begins in manual", ["Manual", "Start"], full, [[0.5, 0.4, 0.1], *auto[:9]], h=0.05)
    far = [[ysp, y, 9.0 if 20 <= i < 30 else NAN] for i, (ysp, y, _) in enumerate(auto)]
    yield case("manual beyond the limits", ["Manual", "Limits"], full | tight, far, h=0.05)
    bad = [list(sample) for sample in auto[:20]]
    bad[5][1] = bad[6][1] = bad[12][0] = bad[15][1] = NAN
    bad[15][2] = bad[16][2] = 0.4
    yield case("not a number in auto and in manual", ["NotANumber"], full, bad, h=0.05)
    still = [0.0 if i in (4, 5, 11) else 0.05 for i in range(20)]
    yield case("time that stands still", ["ZeroStep"], full, auto[:20], h=still)


def saturation(params: Params, _h: Sequence[float], xs: Sequence[float]) -> list[float]:
    """Keep a value within low and high; a value that is no number passes."""
    outputs = []
    for x in xs:
        if x < params["low"]:
            x = params["low"]
        if x > params["high"]:
            x = params["high"]
        outputs.append(x)
    return outputs


def saturation_cases() -> Iterator[dict[str, Any]]:
    """Within, at and beyond the limits."""
    yield case("within and beyond", [], {"low": -0.3, "high": 0.4}, list(_walk(7, 40)))
    yield case("exactly at the limits", ["Edge"], {"low": 0.1, "high": 0.3}, [0.1, 0.3, 0.1 + 0.2, 0.30000000000000004])
    yield case("not a number passes", ["NotANumber"], {"low": 0.0, "high": 1.0}, [0.5, NAN, 2.0])


def stiction(params: Params, h: Sequence[float], samples: Sequence[Sequence[float]]) -> list[list[float]]:
    """Pushes for a valve that sticks: pulses, a constant towards where u goes, or two moves."""
    push, size, ti = int(params["push"]), params["size"], params["ti"]
    two_moves = push == 3
    hold = params.get("hold", ti if two_moves else ti / 10.0)
    period = params.get("period", 10.0 * ti if two_moves else ti / 5.0)
    band, far = params.get("band", size / 10.0), params.get("far", 0.0)
    rate, release = params.get("rate", 1e37), params.get("release", min(ti, 300.0))
    budget = params.get("travel", 1e37)
    low, high = params.get("low", -math.inf), params.get("high", math.inf)
    judge = _Judge(params.get("watch", 300.0 * ti), size / 10.0)
    last: float | None = None
    lowest = highest = time = u_ff = whole = travel = 0.0
    direction = withdrawn = 0
    in_force = False
    rows = []
    for step, (e, u, enable, flags) in zip(h, samples, strict=True):
        bad = int(flags) & 2 != 0 or not (math.isfinite(e) and math.isfinite(u))
        timed, begins = 0.0 < step <= 1e9, False
        if timed:
            travel = max(travel - budget * (step / 7200.0), 0.0)
        if timed and not bad and last is None:
            last = lowest = highest = u
        elif timed and not bad:
            time += step
            if push == 1 and time >= period:
                direction = 1 if u - last > band else -1 if last - u > band else direction
                begins, last = True, u
            elif two_moves and time >= period and abs(e) > far:
                begins, direction = True, 1 if (e > 0.0) == (params["k"] > 0.0) else -1
            elif push == 2:
                lowest, highest = min(lowest, u), max(highest, u)
                turned = 1 if direction <= 0 and u - lowest > band else 0
                turned = -1 if not turned and direction >= 0 and highest - u > band else turned
                if turned:
                    begins, direction, lowest, highest = True, turned, u, u
            if begins:
                time, begins = 0.0, direction != 0
        if not enable:
            withdrawn, standing = 0, 1
        elif int(flags) & 1:
            standing = 2
        elif bad:
            standing = 3
        elif withdrawn:
            standing = withdrawn
        elif int(flags) & 12 or u - size < low or u + size > high:
            standing = 8
        elif size <= 0.0:
            standing = 9
        elif begins:
            standing = 0
            if (travel + abs(u_ff) + (4.0 if two_moves else 2.0) * size) * 2.0 > budget:
                withdrawn = standing = 6
        else:
            standing = 0 if in_force else 10
        in_force = standing == 0
        if standing == 2:
            u_ff = whole = 0.0
        elif timed:
            before, goal = u_ff, 0.0
            if in_force:
                whole, most = 0.0, rate * step
                if push == 2 or time < hold:
                    goal = size
                elif two_moves and time < 2.0 * hold:
                    goal = -size
                goal = -goal if direction < 0 and goal else goal
            else:
                whole = max(whole, abs(u_ff))
                most = whole / release * step
            u_ff = u_ff + most if goal > u_ff + most else u_ff - most if goal < u_ff - most else goal
            travel += abs(u_ff - before)
            known = in_force or (standing == 1 and not bad and flags == 0.0)
            worse = known and judge.worse(e, u, step, in_force)
            if not known:
                judge.broken_off(anew=standing == 1)
            if worse and params.get("withdraw", 1.0) == 1.0 and not withdrawn:
                withdrawn = 11
        rows.append([u_ff, float(standing), float(direction)])
    return rows


def stiction_cases() -> Iterator[dict[str, Any]]:
    """Each push in a loop that swings: enabled, near a limit, where something is lost, poor, uneven and worse."""
    usual = {"k": 1.5, "ti": 4.0, "size": 2.0}

    def swings(seed: int, n: int, period: int = 40) -> list[list[float]]:
        noise = Random(seed)
        wave = [math.sin(2.0 * math.pi * i / period) for i in range(n)]
        return [[x + 0.05 * noise.random(), 50.0 - 3.0 * x + 0.1 * noise.random(), 1.0, 0.0] for x in wave]

    for push, name in ((1, "knocker"), (2, "reinforcement"), (3, "two moves")):
        own = {"period": 10.0, "hold": 2.0} if push == 3 else {}
        params = usual | {"push": push, "far": 0.5} | own
        one = swings(push, 160)
        yield {"comment": f"{name}: a loop that swings", "flags": [], "params": params, "input": one, "h": 0.5}
        late = [[e, u, float(i > 30), flags] for i, (e, u, _, flags) in enumerate(swings(10 + push, 120))]
        off = params | {"rate": 1.5, "low": 45.2, "high": 55.1}
        yield {
            "comment": f"{name}: enabled later, by a rate, near a limit",
            "flags": ["Edge"],
            "params": off,
            "input": late,
        }
        lost = swings(20 + push, 160)
        for i, flag in ((60, 2.0), (61, 2.0), (80, 1.0), (100, 4.0), (101, 4.0), (120, 8.0)):
            lost[i][3] = flag
        lost[140][0] = lost[150][1] = NAN
        yield {"comment": f"{name}: what is lost", "flags": ["Loss"], "params": params, "input": lost, "h": 0.5}
        poor = params | {"travel": 60.0, "k": -1.5}
        yield {"comment": f"{name}: a budget; direct action", "flags": ["Budget", "Sign"], "params": poor, "input": one}
        steps = [0.5, 0.5, 0.3, 0.0, 1.2, -1.0, 0.5, 2e9]
        uneven = [steps[i % len(steps)] for i in range(160)]
        yield {
            "comment": f"{name}: steps of any length",
            "flags": ["IrregularStep"],
            "params": params,
            "input": one,
            "h": uneven,
        }
        worse = [
            [(1.0 + 2.0 * (i > 700)) * e, u, float(i > 700), 0.0] for i, (e, u, *_) in enumerate(swings(push, 2000))
        ]
        watched = params | {"watch": 150.0}
        yield {"comment": f"{name}: worse than before", "flags": ["Harm"], "params": watched, "input": worse, "h": 0.5}


def rate_limit(params: Params, h: Sequence[float], xs: Sequence[float]) -> list[float]:
    """Follow the input by at most rate·h a sample."""
    output = None
    outputs = []
    for step, x in zip(h, xs, strict=True):
        if output is None:
            outputs.append(x)
            output = None if math.isnan(x) else x
            continue
        if step > 0.0 and math.isfinite(x):
            most = params["rate"] * step
            output = max(min(x, output + most), output - most)
        outputs.append(output)
    return outputs


def rate_limit_cases() -> Iterator[dict[str, Any]]:
    """Follow, lag, turn; start; steps of any length."""
    wander = list(_walk(8, 60))
    yield case("steps followed at the limit", [], {"rate": 2.0}, [5.0, 9.0, 9.0, 8.5, 0.0, 0.0, 7.0], h=1.0)
    yield case("wandering", [], {"rate": 1.5}, wander, h=0.05)
    yield case("wandering the other way", ["Sign"], {"rate": 1.5}, [-x for x in wander], h=0.05)
    yield case("steps of any length", ["IrregularStep"], {"rate": 1.5}, wander, h=list(_walk(9, 60, 0.01, 0.2)))
    still = [0.0 if i in (4, 5) else -0.05 if i == 11 else 0.05 for i in range(20)]
    yield case("time that stands still or runs backwards", ["ZeroStep"], {"rate": 1.5}, wander[:20], h=still)
    yield case("not a number in between", ["NotANumber"], {"rate": 0.5}, [1.0, NAN, 2.0, NAN, 1.9], h=1.0)
    yield case("not a number at the start", ["NotANumber", "Start"], {"rate": 0.5}, [NAN, NAN, 1.0, 2.0], h=1.0)


def phase_lead(params: Params, h: Sequence[float], xs: Sequence[float]) -> list[float]:
    """The signal and the part of it that its lagged image has not followed yet (2.2)."""
    lead, lag = params["lead"], params["lag"]
    lagged = output = None
    outputs = []
    for step, x in zip(h, xs, strict=True):
        if lagged is None:
            outputs.append(x)
            lagged = output = None if math.isnan(x) else x
            continue
        if step > 0.0 and not math.isnan(x):
            away = x - lagged
            output = x + away * ((lead - lag) / (lag + step))
            lagged += away * (step / (lag + step))
        outputs.append(output)
    return outputs


def phase_lead_cases() -> Iterator[dict[str, Any]]:
    """A step, a wandering signal, and inputs that move nothing."""
    yield case("a step", [], {"lead": 3.0, "lag": 0.5}, [1.0, 1.0] + [2.0] * 12, h=0.25)
    wander = list(_walk(71, 60, low=-3.0, high=5.0))
    yield case("a signal that wanders", [], {"lead": 2.2, "lag": 0.3}, wander, h=0.1)
    yield case("lead = lag", ["Nothing"], {"lead": 0.7, "lag": 0.7}, wander, h=0.1)
    steps = list(_walk(72, 60, low=0.01, high=2.0))
    yield case("steps of any length", ["IrregularStep"], {"lead": 2.2, "lag": 0.3}, wander, h=steps)
    broken = [1.0, 2.0, NAN, 2.5, NAN, 3.0, 4.0, 4.0, 3.0]
    stops = [0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.0, -0.5, 0.5]
    yield case("what is no number, and time that stands still", ["NotANumber", "ZeroStep"], _LEAD, broken, h=stops)
    yield case("bad from the beginning", ["NotANumber"], _LEAD, [NAN, 5.0, 6.0, 6.0], h=0.5)


_LEAD = {"lead": 4.0, "lag": 1.0}


def compensation(params: Params, h: Sequence[float], samples: Sequence[Sequence[float]]) -> list[list[float]]:
    """Carry the valve through its gap (2.2): half the width, to the side that the signals say, with limits on all."""
    return list(_compensation(params, zip(h, samples, strict=True)))


def _compensation(params: Params, samples: Iterable[tuple[float, Sequence[float]]]) -> Iterator[list[float]]:
    """Give the same for each sample as it comes; a ninth number of one is the u_FF from which it goes on."""
    way, share, size, release = int(params["way"]), params["share"], params["size"], params["release"]
    by_estimate, most = params.get("source", 1.0) == 3.0, params.get("limit", size)
    low, high = params.get("low", -math.inf), params.get("high", math.inf)
    smooth = _smoother(params["tf"])
    lowest = highest = half = whole = u_ff = travel = reversals = pressed = 0.0
    direction = side = withdrawn = 0
    standing = 1
    in_force = unfit = False
    least: float | None = None
    judge = _Judge(params["watch"], size / 10.0)
    for step, (e, u, d_hat, over, enable, flags, offered, hindered, *begin) in samples:
        if begin and math.isfinite(begin[0]):
            u_ff, half, whole = begin[0], abs(begin[0]), abs(begin[0])
            side, in_force = -1 if u_ff < 0.0 else 1, False
        if enable and standing == 1:
            unfit = not math.isfinite(offered)
            pressed = pressed if unfit else offered
        band = (max(params["band"], pressed / 5.0) if by_estimate else params["band"]) if way == 3 else 0.0
        bad = int(flags) & 2 != 0 or not (math.isfinite(e) and math.isfinite(u))
        was = direction
        if step > 0.0:
            travel = max(travel - params["travel"] * (step / 7200.0), 0.0)
            reversals = max(reversals - params["reversals"] * (step / 7200.0), 0.0)
        if step > 0.0 and not bad and way == 1:
            if e != 0.0:
                direction = 1 if (e > 0.0) == (params["k"] > 0.0) else -1
        elif step > 0.0 and not bad:
            u_f, first = smooth(u, step)
            lowest, highest = (u_f, u_f) if first else (min(lowest, u_f), max(highest, u_f))
            turned = 0
            if direction <= 0 and u_f - lowest > band:
                turned = 1
            elif direction >= 0 and highest - u_f > band:
                turned = -1
            if turned:
                direction, lowest, highest = turned, u_f, u_f
        if not enable:
            least, withdrawn = None, 0
            if u_ff == 0.0:
                pressed = offered if math.isfinite(offered) else 0.0
                band = max(params["band"], pressed / 5.0) if by_estimate and way == 3 else band
        else:
            if math.isfinite(d_hat) and params.get("estimate", 1.0):
                least = d_hat if least is None else min(least, d_hat)
            if over and params["withdraw"] and not withdrawn:
                withdrawn = 4
            elif hindered == 13.0 and not withdrawn:
                withdrawn = 13
        width = pressed if by_estimate else size
        wide = width if least is None else min(width, least)
        delta = max(min(share * wide, most) - band, 0.0)
        goal = delta / 2.0
        rate = params["rate"]
        if by_estimate and params.get("ramp_time", 0.0) > 0.0 and share * pressed > 0.0:
            rate = min(rate, share * pressed / params["ramp_time"])
        causes = [
            (not enable, 1),
            (int(flags) & 1 != 0, 2),
            (bad, 3),
            (withdrawn != 0, withdrawn),
            (math.isfinite(hindered), 0 if math.isnan(hindered) else int(hindered)),
            (by_estimate and unfit, 14),
            (least is not None and not math.isfinite(d_hat), 7),
            (int(flags) & 12 != 0 or u - goal < low or u + goal > high, 8),
            (goal == 0.0, 9),
        ]
        standing = next((number for holds, number in causes if holds), 0)
        if standing == 0 and direction == -was != 0:
            moves = 1.0 if u_ff != 0.0 and side == -direction else 0.0
            if (reversals + moves) * 2.0 > params["reversals"]:
                standing = withdrawn = 5
            elif (travel + (abs(u_ff) + 2.0 * goal)) * 2.0 > params["travel"]:
                standing = withdrawn = 6
            else:
                reversals = reversals + moves
                side = direction
        elif standing == 0 and not in_force:
            standing = 10
        in_force = standing == 0
        if standing == 2:
            half, whole, u_ff, side = 0.0, 0.0, 0.0, 0
        elif step > 0.0:
            wish = goal if in_force else 0.0
            if not in_force:
                whole = max(whole, abs(u_ff))
                rate = max(rate, whole / min(10.0 * params.get("ti", 1e6), 300.0))
                half = min(half, max(-u_ff if side < 0 else u_ff, 0.0))
            half = max(wish, half - whole / release * step)
            whole = wish if in_force and half <= wish else whole
            old, u_ff = u_ff, _towards(-half if side < 0 else half, u_ff, rate * step)
            travel = travel + abs(u_ff - old)
            judge.band = pressed / 10.0 if by_estimate else judge.band
            known = pressed > 0.0 or not by_estimate
            if in_force or (standing == 1 and int(flags) == 0 and math.isfinite(e) and known):
                if judge.worse(e, u + u_ff, step, in_force) and params["withdraw"] and not withdrawn:
                    withdrawn = 11
            else:
                judge.broken_off(not enable)
        yield [u_ff, half, standing, delta]


class _Judge:
    """Blocks of |e| and of OP's reversals since it is in force, beside those of before."""

    def __init__(self, watch: float, band: float) -> None:
        self.watch, self.band = watch, band
        self.blocks = {False: _Blocks(), True: _Blocks()}
        self.farthest, self.back, self.direction = 0.0, 0.0, 0
        self.time = self.area = self.turns = 0.0
        self.in_force = False
        self.burst = 0

    def broken_off(self, anew: bool) -> None:
        """Forget the block under way; `anew`: all that is since it is in force."""
        self.time = self.area = self.turns = 0.0
        self.direction = 0
        if anew:
            self.blocks[True], self.in_force, self.burst = _Blocks(), False, 0

    def worse(self, e: float, op: float, step: float, in_force: bool) -> bool:
        if in_force != self.in_force:
            self.broken_off(anew=True)
            self.in_force = in_force
        self.turns += self.turned(op)
        self.time, self.area = self.time + step, self.area + abs(e) * step
        if self.time * 150.0 < self.watch:
            return False
        x, n = self.area / self.time, self.turns
        self.time = self.area = self.turns = 0.0
        was, now = self.blocks[False], self.blocks[in_force]
        step_like = was.count >= 5 and x > 4.0 * was.e[0]
        self.burst = self.burst + 1 if step_like else 0
        if 0 < self.burst <= 10:
            return False
        if not in_force and step_like:
            now = self.blocks[False] = _Blocks()
            self.burst = 0
        elif step_like:
            x = 4.0 * was.e[0]
        now.learn(x, n)
        if not in_force or was.count < 10 or now.count < 10:
            return False
        scatter = 1.0 / now.count + 1.0 / was.count
        sure = [60.0 / now.count] * 2 if now.count < 60 else [0.0, -0.8] if now.count < 100 else [1.0, 1.0]
        more = (now.e[0] - 1.1 * was.e[0], now.n[0] - 1.5 * was.n[0])
        least = (was.e[1], max(was.n[1], was.n[0]))
        return any(self.beyond(*each, scatter) for each in zip(more, sure, least, strict=True))

    @staticmethod
    def beyond(more: float, z: float, variance: float, scatter: float) -> bool:
        """Whether `more` exceeds z standard errors."""
        square = z * z * (variance * scatter)
        if z < 0.0:
            return more > 0.0 or more * more < square
        return more > 0.0 and more * more > square

    def turned(self, op: float) -> bool:
        """Whether OP has gone back from its farthest by more than the band."""
        if self.direction == 0:
            self.farthest, self.direction = op, 1
        further = max if self.direction > 0 else min
        self.farthest = further(self.farthest, op)
        back = self.farthest - op if self.direction > 0 else op - self.farthest
        if back > self.band:
            self.farthest, self.direction = op, -self.direction
            return True
        return False


class _Blocks:
    """Mean and variance of both, over the last 150 blocks or thereabouts."""

    def __init__(self) -> None:
        self.count = 0
        self.e, self.n = [0.0, 0.0], [0.0, 0.0]

    def learn(self, x: float, n: float) -> None:
        self.count = min(self.count + 1, 150)
        for mean, value in ((self.e, x), (self.n, n)):
            off = value - mean[0]
            mean[0] = mean[0] + off / self.count
            mean[1] = mean[1] + (off * (value - mean[0]) - mean[1]) / self.count


def _towards(wish: float, now: float, most: float) -> float:
    """Go there, by at most so much."""
    return max(min(wish, now + most), now - most)


def _smoother(tf: float) -> Callable[[float, float], tuple[float, bool]]:
    """Filter of second order (2.1), and whether it begins."""
    sections: list[float] = []

    def smooth(x: float, step: float) -> tuple[float, bool]:
        first = not sections
        if first:
            sections.extend((x, x))
        else:
            share = step / (tf + step)
            for i in (0, 1):
                sections[i] = sections[i] + (x - sections[i]) * share
                x = sections[i]
        return sections[1], first

    return smooth


def compensation_cases() -> Iterator[dict[str, Any]]:
    """Cases of a size that is known, to which nothing is offered and which nothing hinders; cases of an estimate."""
    for one in _compensation_cases():
        yield one | {"input": [[*row, *[NAN] * (8 - len(row))] for row in one["input"]]}


def _compensation_cases() -> Iterator[dict[str, Any]]:
    """Each way in noise; rates, bands, budgets; every cause to stop, and back."""
    free = {"k": 0.8, "size": 0.4, "share": 1.0, "band": 0.1, "tf": 0.0, "rate": 50.0, "release": 0.5}
    free |= {"watch": 1e4, "travel": 1e6, "reversals": 1e6, "withdraw": 1}
    es, us = [x + 0.6 * (-1.0) ** (i // 7) for i, x in enumerate(_walk(31, 80))], list(_walk(32, 80))
    on = [[e, u, NAN, 0, 1, 0] for e, u in zip(es, us, strict=True)]
    for way in (1, 2, 3):
        yield case("enabled from the first sample", ["Start"], free | {"way": way}, on, h=0.1)
        yield case("K below 0", ["Sign"], free | {"way": way, "k": -0.8}, on[:40], h=0.1)
        mirrored = [[-e, -u, *rest] for e, u, *rest in on[:40]]
        yield case("all mirrored", ["Sign"], free | {"way": way}, mirrored, h=0.1)
        slow = {"way": way, "rate": 0.3, "tf": 0.2, "share": 0.7}
        yield case("a share, slowly, filtered", ["Rate"], free | slow, on, h=list(_walk(33, 80, 0.01, 0.3)))
    inverse, error = free | {"way": 3}, free | {"way": 1}
    away = [[e, u, d_hat, over, float(i < 50), flags] for i, (e, u, d_hat, over, _, flags) in enumerate(on)]
    crawls = {"rate": 0.02, "ti": 0.1, "watch": 1e3}
    for way in (1, 3):
        yield case("too slow for its rate: away in 10 Ti", ["Rate"], free | {"way": way} | crawls, away, h=0.1)
    yield case("no wider than the band", ["Band"], inverse | {"size": 0.1}, on[:20], h=0.1)
    edge = [[0.0, u, NAN, 0, 1, 0] for u in (0.0, 0.25, 0.5, 0.25, 0.0, 0.125, 0.25, 0.375)]
    yield case("back by exactly the band", ["Band", "Edge"], inverse | {"band": 0.25, "size": 1.0}, edge, h=0.1)

    def changed(column: int, values: dict[int, float], rows: list[list[float]] = on[:40]) -> list[list[float]]:
        return [[values.get(i, x) if j == column else x for j, x in enumerate(row)] for i, row in enumerate(rows)]

    stretch = range(12, 24)
    for comment, column, value in (
        ("disabled and enabled", 4, 0.0),
        ("manual", 5, 1.0),
        ("a bad value", 5, 2.0),
        ("at the lower limit", 5, 4.0),
        ("at the upper limit", 5, 8.0),
        ("error not a number", 0, NAN),
        ("output not a number", 1, NAN),
    ):
        for params in (error, inverse):
            yield case(
                f"{comment} for a while", ["Loss"], params, changed(column, dict.fromkeys(stretch, value)), h=0.1
            )
    yield case("no room to the limits", ["Loss", "Edge"], error | {"low": -0.3, "high": 0.2}, on[:40], h=0.1)
    estimate = {i: (0.5, 0.3, 0.2, 0.35)[i // 6] for i in range(6, 24)} | {30: 0.6, 31: -0.2}
    yield case("an estimate smaller, lost, back, below 0", ["Estimate"], error, changed(2, estimate), h=0.1)
    alone = error | {"estimate": 0.0}
    yield case("an estimate that is not to count", ["Estimate"], alone, changed(2, estimate), h=0.1)
    over = changed(3, {15: 1.0})
    yield case("over-compensated: withdrawn", ["Withdrawn"], error, over, h=0.1)
    yield case("over-compensated: only a warning", ["Withdrawn"], error | {"withdraw": 0}, over, h=0.1)
    again = changed(5, {20: 1.0, 21: 2.0}, changed(4, {30: 0.0}, over))
    yield case("withdrawn through manual, enabled anew", ["Withdrawn"], error, again, h=0.1)
    noise = [[(-1.0) ** i, 0.3 * (-1.0) ** i, NAN, 0, 1, 0] for i in range(40)]
    yield case("more reversals than the budget", ["Budget"], error | {"reversals": 20.0}, noise, h=0.1)
    yield case("more travel than the budget", ["Budget"], error | {"travel": 10.0}, noise, h=0.1)
    yield case("a budget that fills up again", ["Budget"], error | {"reversals": 20.0}, noise, h=400.0)
    yield case("a budget that allows nothing", ["Budget"], error | {"travel": 0.1}, noise[:5], h=0.1)
    judged = inverse | {"watch": 37.5, "band": 0.05}  # two samples a block
    drawn = Random(61)
    es, us = [drawn.uniform(-0.02, 0.02) for _ in range(240)], [0.1 * x for x in _walk(62, 240)]
    quiet = [[e, u, NAN, 0, float(i >= 60), 0] for i, (e, u) in enumerate(zip(es, us, strict=True))]

    def from_(begin: int, e: float = 1.0, u: float = 0.0) -> list[list[float]]:
        """Farther from SP, turning more often."""
        return [
            [(e if i >= begin else 1.0) * row[0], row[1] + u * (-1.0) ** (i // 3) * (i >= begin), *row[2:]]
            for i, row in enumerate(quiet)
        ]

    for comment, rows in (("PV farther from SP", from_(70, e=3.0)), ("OP turns more often", from_(70, u=0.1))):
        yield case(f"{comment} than before: withdrawn", ["Worse"], judged, rows, h=0.125)
        yield case(f"{comment} than before: no withdrawal", ["Worse"], judged | {"withdraw": 0}, rows, h=0.125)
        late = [[*row[:4], float(i >= 19), 0] for i, row in enumerate(rows)]
        yield case(f"{comment} than before: too short to know", ["Worse"], judged, late, h=0.125)
        anew = changed(4, dict.fromkeys(range(150, 160), 0.0), rows)
        yield case(f"{comment} than before: enabled anew", ["Worse"], judged, anew, h=0.125)
        holes = changed(5, {i: float(1 + i // 100) for i in (20, 21, 75, 100, 101, 130)}, rows)
        yield case(f"{comment} than before: in between manual, bad", ["Worse"], judged, holes, h=0.125)
    # OP hardly turns once it is in force.
    calm = [[e, u if i < 90 else 0.1 * u, *rest] for i, (e, u, *rest) in enumerate(from_(70, e=0.6))]
    yield case("no worse than before", ["Worse"], judged, calm, h=0.125)

    def burst(begin: int, end: int, rows: list[list[float]]) -> list[list[float]]:
        return [[40.0 * e if begin <= i < end else e, *rest] for i, (e, *rest) in enumerate(rows)]

    yield case("a step when it is enabled is left out", ["Worse"], judged, burst(62, 82, calm), h=0.125)
    yield case("eleven blocks are no step", ["Worse"], judged, burst(62, 130, calm), h=0.125)
    yield case("a step before is left out", ["Worse"], judged, burst(30, 34, from_(70, e=1.8)), h=0.125)
    for factor, what in ((1.8, "seems worse"), (1.5, "stands it")):
        rows = [[factor * e if i >= 70 else e, *rest] for i, (e, *rest) in enumerate(calm)]
        yield case(f"the trial: {what}", ["Worse"], judged, rows, h=0.125)
    long = [[e if i < 280 else 5.0 * e, *rest] for i, (e, *rest) in enumerate(calm + calm[60:])]
    yield case("worse long after the trial", ["Worse"], judged, long, h=0.125)
    for count, what in ((44, "twenty blocks, and before begins anew"), (20, "ten blocks")):
        rows = [[*row[:4], float(i >= 60 + count), 0] for i, row in enumerate(burst(60, 240, quiet))]
        yield case(f"a loop that was quiet up to {what}", ["Worse"], judged, rows, h=0.125)
    yield case(
        "blocks beyond the watch are forgotten",
        ["Worse"],
        judged | {"watch": 7.5},
        from_(200, e=4.0),
        h=list(_walk(63, 240, 0.05, 0.2)),
    )
    gone = [[e, u, 0.0 if i >= 20 else NAN, 0, 1, 0] for i, (e, u, *_) in enumerate(on[:40])]
    yield case("no width left while in force", ["Estimate", "Loss"], error, gone, h=0.1)
    still = [0.0 if i in (4, 5, 13) else -0.1 if i == 8 else 0.1 for i in range(20)]
    yield case("time that stands still or turns back", ["ZeroStep"], error, changed(4, {5: 0.0}, on[:20]), h=still)

    def pressed(offered: dict[int, float], begin: int, d_hat: float = NAN, rows: Any = on) -> list[list[float]]:
        """Enabled at `begin`, with an estimate that is offered from each of the samples on."""
        made, now = [], NAN
        for i, (e, u, *_) in enumerate(rows):
            now = offered.get(i, now)
            made.append([e, u, d_hat if i > begin + 20 else NAN, 0, float(i >= begin), 0, now, NAN])
        return made

    for way in (1, 2, 3):
        typed_nothing = {"way": way, "source": 3.0, "size": 0.0, "limit": 9.0, "band": 0.05, "ramp_time": 0.4}
        free_estimate = free | typed_nothing
        yield case(
            "the estimate as it was enabled", ["Source"], free_estimate, pressed({3: 0.7, 20: 0.4, 40: 2.0}, 10), h=0.1
        )
        yield case("an estimate that falls later", ["Source"], free_estimate, pressed({3: 0.7}, 10, d_hat=0.3), h=0.1)
        yield case("no estimate yet when enabled", ["Source"], free_estimate, pressed({12: 0.7}, 10)[:30], h=0.1)
        anew = pressed({3: 0.7, 25: 0.5, 40: NAN}, 10)
        for i in (*range(30, 33), *range(50, 53)):
            anew[i][4] = 0.0
        yield case("enabled anew by a smaller one, then by none", ["Source"], free_estimate, anew, h=0.1)
        yield case(
            "an estimate beyond the limit", ["Source"], free_estimate | {"limit": 0.3}, pressed({3: 0.7}, 10), h=0.1
        )
    by_estimate = judged | {"source": 3.0, "size": 0.0, "limit": 9.0, "ramp_time": 0.0, "band": 0.0}
    worse = pressed({0: 0.4}, 60, rows=from_(70, u=0.1))
    yield case("by the estimate, OP turns more often: withdrawn", ["Source", "Worse"], by_estimate, worse, h=0.125)
    unknown = pressed({40: 0.4}, 60, rows=from_(70, u=0.1))
    yield case("by an estimate that came late: too short to know", ["Source", "Worse"], by_estimate, unknown, h=0.125)
    for number, what in ((12.0, "too late"), (13.0, "not followed")):
        hindered = [[*row, NAN, number if i in (15, 16, 17) else NAN] for i, row in enumerate(changed(4, {32: 0.0}))]
        yield case(f"{what} for a while", ["Hindered"], error, hindered, h=0.1)


def over_compensation(params: Params, h: Sequence[float], halves: Sequence[Sequence[float]]) -> list[list[int]]:
    """Warn of equal half-periods (code block 7.1), and of a relay: alike, new or faster, OP itself hardly moving."""
    kept: list[tuple[float, float]] = []
    before: float | None = None
    was_on = False
    outputs = []
    for step, (delta_t, delta_y, delta_sp, flags, size) in zip(h, halves, strict=True):
        on = size > 0.0
        if on != was_on:
            if on and len(kept) == 8:
                before = _sum(t for t, _ in reversed(kept)) / 8.0 if _alike(kept, step) else 0.0
            was_on, kept = on, []
        if flags or not delta_y > 0.0 or delta_sp >= delta_y:
            kept = []
            outputs.append([0, 0])
            continue
        kept = [*kept[-7:], (delta_t, delta_y)]
        last = [t for t, _ in kept[-4:]]
        equal = on and len(last) == 4 and max(last) - min(last) < step + step
        travels = [abs(params["k"]) / params["ti"] * dy * dt for dt, dy in kept]
        most = 5.0 if before is None else 1.0
        little = sum(travel * most <= size and travel * 100.0 >= size for travel in travels) > 4
        faster = not before or _sum(t for t, _ in reversed(kept)) <= 0.75 * 8.0 * before
        outputs.append([int(equal), int(on and len(kept) == 8 and _alike(kept, step) and little and faster)])
    return outputs


def _alike(halves: Sequence[tuple[float, float]], step: float) -> bool:
    """Nearly as long, and nearly as high."""
    times, heights = [t for t, _ in halves], [y for _, y in halves]
    return max(times) <= 1.5 * min(times) + step and max(heights) <= min(heights) + min(heights)


def over_compensation_cases() -> Iterator[dict[str, Any]]:
    """Relays, gaps, noise, what was before, and what breaks the row."""
    params = {"k": 0.5, "ti": 10.0}
    relay, gap = [6.0, 0.4, 0.0, 0, 2.0], [30.0, 1.0, 0.0, 0, 2.0]

    def off(rows: list[list[float]]) -> list[list[float]]:
        return [[*row[:4], 0.0] for row in rows]

    yield case("a relay", [], params, [relay] * 10, h=0.1)
    yield case("a gap", ["Gap"], params, [gap] * 10, h=0.1)
    yield case("nothing compensated", ["Off"], params, off([relay] * 10), h=0.1)
    yield case("K below 0", ["Sign"], params | {"k": -0.5}, [relay] * 10, h=0.1)
    jitter = [[6.0 + x, 0.4 - 0.1 * x, 0.0, 0, 2.0] for x in _walk(34, 30)]
    yield case("a relay in noise", [], params, jitter, h=0.1)
    yield case("a gap, then a relay", ["Window"], params, [gap] * 9 + [relay] * 12, h=0.1)
    uneven = [[abs(x) * 9 + 0.1, 0.1, 0.0, 0, 2.0] for x in _walk(35, 30)]
    yield case("half-periods of all lengths", ["Uneven"], params, uneven, h=0.1)
    slow = [15.0, 1.2, 0.0, 0, 2.0]
    for comment, rows in (
        ("as fast before", [slow] * 8),
        ("slower before", [gap] * 8),
        ("slower before, then as fast", [gap] * 8 + [slow] * 8),
        ("slower before, too short to know", [gap] * 7),
        ("no cycle before", uneven[:12]),
        ("a ringing before", [[15.0, 1.2 * 0.6**i, 0.0, 0, 2.0] for i in range(8)]),
    ):
        yield case(f"a relay, {comment}", ["Before"], params, off(rows) + [slow] * 9, h=0.1)
    again = off([gap] * 8) + [slow] * 8 + off([slow] * 3) + [slow] * 9
    yield case("off and on again, too short to learn anew", ["Before"], params, again, h=0.1)
    edge = [20.0, 0.5, 0.0, 0, 4.0]
    yield case(
        "three quarters as long, to the bit",
        ["Edge", "Before"],
        params,
        off([edge] * 8) + [[15.0, *edge[1:]]] * 9,
        h=0.5,
    )
    lengths = [6.0, 4.0, 6.0, 6.0, 6.0, 6.0, 6.0, 6.0, 6.0, 6.125, 6.125, 6.0625, 4.0625]
    yield case(
        "half as long again and a sample, to the bit",
        ["Edge"],
        params,
        [[t, 0.5, 0.0, 0, 2.0] for t in lengths],
        h=0.0625,
    )
    heights = [0.5, 0.5, 1.0, 1.0, 0.5, 1.0, 1.0, 1.0, 0.5000001, 1.0000001, 1.0]
    yield case("twice as high, to the bit", ["Edge"], params, [[6.0, y, 0.0, 0, 2.0] for y in heights], h=0.0625)
    whole = {"k": 1.0, "ti": 8.0}
    yield case("a fifth, to the bit", ["Edge"], whole, [[4.0, 0.5, 0.0, 0, 1.25]] * 9, h=0.0625)
    yield case("a hundredth, to the bit", ["Edge"], whole, [[4.0, 0.5, 0.0, 0, 25.0]] * 9, h=0.0625)
    yield case("less than a hundredth", ["Uneven"], whole, [[4.0, 0.5, 0.0, 0, 25.5]] * 9, h=0.0625)
    for comment, other in (
        ("a flag", [6.0, 0.4, 0.0, 8, 2.0]),
        ("a setpoint that moves", [6.0, 0.4, 0.4, 0, 2.0]),
        ("no error at all", [6.0, 0.0, 0.0, 0, 2.0]),
        ("not compensated once", [6.0, 0.4, 0.0, 0, 0.0]),
    ):
        yield case(f"{comment} breaks the row", ["Break"], params, [relay] * 8 + [other] + [relay] * 9, h=0.1)


def wrong_sign(params: Params, h: Sequence[float], samples: Sequence[Sequence[float]]) -> list[int]:
    """OP at its limit and PV running away, judged anew at every sample from all since the error changed its sign."""
    return list(_wrong_sign(params, zip(h, samples, strict=True)))


def _wrong_sign(params: Params, samples: Iterable[tuple[float, Sequence[float]]]) -> Iterator[int]:
    """Give the same for each sample as it comes."""
    kept: list[tuple[float, float, float, float, bool]] = []
    sign, begin, last, found = 0, NAN, 0.0, False
    for step, (sp, yf, op, flags) in samples:
        e = sp - yf
        if int(flags) & (FLAG_BAD | FLAG_GAP) or not all(map(math.isfinite, (e, op))):
            sign, kept, last = (sign, kept, last) if found else (0, [], 0.0)
        elif step > 0.0:
            side = sign if e == 0.0 else int(math.copysign(1.0, e))
            if int(flags) & FLAG_NOT_AUTO:
                sign, kept, found = 0, [], False
            else:
                if side != sign:
                    sign, begin, kept, found = side, last if sign else op, [], False
                towards = 8 if (side > 0) == (params["k"] > 0.0) else 4
                on = op - last if towards == 8 else last - op
                still = on <= 1e-5 * (0.2 * (params["high"] - params["low"]))
                kept.append((step, abs(e), yf, op, int(flags) & towards != 0 and still))
                found = found or _runs_away(params, sign, begin, kept)
            last = op
        yield int(found)


def _runs_away(
    params: Params, sign: int, begin: float, kept: Sequence[tuple[float, float, float, float, bool]]
) -> bool:
    stretch: list[tuple[float, float, float]] = []
    early = farthest = 0.0
    far = False
    way = 0.2 * (params["high"] - params["low"])
    for step, e, yf, op, limit in kept:
        if not limit:
            stretch, farthest = [], max(farthest, e)
            early = farthest if abs(op - begin) <= way / 2.0 else early
            continue
        if not stretch:
            farthest, far = max(farthest, e), abs(op - begin) >= way and e >= 1.5 * early
        stretch.append((step, e, yf))
    if not stretch:
        return False
    _, e_1, y_1 = stretch[0]
    time = _sum(step for step, _, _ in stretch)
    aways = [(step, y_1 - yf if sign > 0 else yf - y_1) for step, _, yf in stretch]
    least = 1.1 * farthest - e_1
    beyond = aways[-1][1] >= least and _sum(away * step for step, away in aways) >= least * time
    return far and time >= 5.0 * params["ti"] and beyond


def wrong_sign_cases() -> Iterator[dict[str, Any]]:
    """Cases that run away, at either limit, and cases that only look like it."""
    up = {"k": 2.0, "ti": 2.4, "low": 0.0, "high": 100.0}

    def rows(*changes: tuple[int, list[float]], turn: int = 1, way: float = 1.0) -> list[list[float]]:
        """PV falls below SP ever faster, OP opens; from the tenth sample on at 100 %, where PV goes on falling."""
        made = []
        for i in range(40):
            e = 0.2 * 1.6 ** min(i, 10) + 1.5 * max(i - 10, 0)
            op = min(50.0 + way * 2.0 * e, 100.0) if i < 10 else 100.0
            flags = 8.0 if i >= 10 else 0.0
            made.append([50.0, 50.0 - turn * e, op if turn > 0 else 100.0 - op, flags if turn > 0 else flags / 2.0])
        for i, row in changes:
            made[i] = row
        return made

    yield case("a process of the wrong sign", [], up, rows(), h=1.0)
    yield case("down to the lower limit", ["Sign"], up, rows(turn=-1), h=1.0)
    yield case(
        "K below 0", ["Sign"], up | {"k": -2.0}, [[sp, yf, 100.0 - u, f / 2.0] for sp, yf, u, f in rows()], h=1.0
    )
    yield case("the other limit is none of its", ["Sign"], up, [[*row, f / 2.0] for *row, f in rows()], h=1.0)
    yield case("steps of any length", ["IrregularStep"], up, rows(), h=list(_walk(71, 40, low=0.2, high=3.0)))
    yield case("too short a time", ["Edge"], up, rows()[:22], h=1.0)
    yield case("just long enough", ["Edge"], up, rows()[:23], h=1.0)
    ramped = [[sp, yf, min(51.0 + 2.0 * i, 100.0), 8.0] for i, (sp, yf, *_) in enumerate(rows())]
    yield case("a rate on the way, told as a limit", ["Edge"], up | {"ti": 1.0}, ramped, h=1.0)
    yield case("PV comes back", ["Recovery"], up, rows((30, [50.0, 50.1, 90.0, 0.0])), h=1.0)
    yield case("manual", ["Recovery"], up, rows((30, [50.0, 20.0, 100.0, 1.0])), h=1.0)
    for comment, row in (
        ("no number", [50.0, NAN, 60.0, 0.0]),
        ("bad", [50.0, 90.0, 9.0, 2.0]),
        ("a gap", [50.0, 90.0, 9.0, 17.0]),
    ):
        for when, at in (("on the way", 5), ("at the limit", 15), ("when it is found", 30)):
            yield case(f"{comment} {when}", ["Break"], up, rows((at, row)), h=1.0)
    still = [0.0 if i in (3, 12, 13) else -1.0 if i == 16 else 1.0 for i in range(40)]
    yield case("time that stands still or turns back", ["PassedOver"], up, rows(), h=still)
    late = rows((14, [50.0, 25.0, 99.0, 0.0]))
    back = [[50.0, min(yf + 6.0 * max(i - 16, 0), 49.0), *others] for i, (_, yf, *others) in enumerate(rows())]
    yield case("PV on its way back", ["Healthy"], up, back, h=1.0)
    yield case("off the limit for a sample", ["Edge"], up, late, h=1.0)
    near = [[sp, yf, max(u, 81.0), f] for sp, yf, u, f in rows()]
    yield case("it began near its limit", ["Healthy"], up, near, h=1.0)
    ramp = [
        [50.0, 48.0 if i < 15 else 48.0 - 0.5 * (i - 15), min(50.0 + 4.0 * i, 100.0), 8.0 if i > 12 else 0.0]
        for i in range(40)
    ]
    yield case("a load that grows steadily", ["Healthy"], up, ramp, h=1.0)
    step = [[50.0, 30.0 - 0.2 * min(i, 10), min(50.0 + 4.0 * i, 100.0), 8.0 if i > 12 else 0.0] for i in range(40)]
    yield case("a load that comes at once", ["Healthy"], up, step, h=1.0)
    asked = [[70.0, 50.0 + 0.3 * i, 100.0 if i else 90.0, 8.0 if i else 0.0] for i in range(40)]
    yield case("a step of SP, and PV on its way", ["Healthy"], up, [[50.0, 50.0, 50.0, 0.0], *asked], h=1.0)
    wrong = [[70.0, 50.0 - 0.3 * i, 100.0 if i else 90.0, 8.0 if i else 0.0] for i in range(40)]
    yield case("a step of SP, and PV the other way", [], up, [[50.0, 50.1, 50.0, 0.0], *wrong], h=1.0)


def filter_(params: Params, h: Sequence[float], xs: Sequence[float]) -> list[float]:
    """Two first-order sections by backward differences (2.1); a start without transient, no step back in time."""
    tf = params["tf"]
    sections: list[float] = []
    outputs = []
    for step, x in zip(h, xs, strict=True):
        if not sections:
            sections = [x, x]
        elif step > 0.0:
            share = step / (tf + step)
            value = x
            for i in (0, 1):
                sections[i] = sections[i] + (value - sections[i]) * share
                value = sections[i]
        outputs.append(sections[1])
    return outputs


def filter_cases() -> Iterator[dict[str, Any]]:
    """Steps, walks, any sampling."""
    wander = list(_walk(11, 60))
    yield case("step", ["Start"], {"tf": 1.0}, [2.0] + [3.0] * 19, h=0.25)
    yield case("wandering", [], {"tf": 0.31}, wander, h=0.05)
    yield case("no filter", ["ZeroTf"], {"tf": 0.0}, wander[:10], h=0.05)
    yield case("steps of any length", ["IrregularStep"], {"tf": 0.5}, wander, h=list(_walk(12, 60, low=0.01, high=3.0)))
    still = [-0.1 if i == 9 else 0.0 if i in (3, 4) else 0.2 for i in range(20)]
    yield case("time that stands still or turns back", ["ZeroStep"], {"tf": 0.5}, wander[:20], h=still)
    yield case("much longer than a step", ["Rounding"], {"tf": 1e6}, [1e3 + x for x in wander[:20]], h=1e-3)


def zero_crossing(_params: Params, _h: Sequence[float], es: Sequence[float]) -> list[Any]:
    """A crossing (2.1) is where the last error other than zero had the other sign."""
    outputs = []
    signs: list[int] = []
    for e in es:
        sign = (e > 0.0) - (e < 0.0)
        crossed = bool(signs) and sign == -signs[-1]
        if sign:
            signs.append(sign)
        outputs.append([int(crossed), signs[-1] if signs else 0])
    return outputs


def zero_crossing_cases() -> Iterator[dict[str, Any]]:
    """Through zero, onto zero and back."""
    wander = list(_walk(13, 60))
    yield case("to and fro", [], {}, [0.5, 0.1, -0.1, -2.0, 1.0, -1.0])
    yield case("begins at zero", ["Start", "Zero"], {}, [0.0, 0.0, -0.0, 1.0, -1.0])
    yield case("zero keeps the sign", ["Zero"], {}, [1.0, 0.0, 0.0, 1.0, 0.0, -1.0, 0.0, -0.0, -1.0, 0.0, 1.0])
    yield case("flat at zero", ["Zero"], {}, [0.0] * 10)
    yield case("the smallest errors there are", ["Zero"], {}, [5e-324, -5e-324, 0.0, 5e-324])
    yield case("wandering", [], {}, wander)
    yield case("wandering the other way", ["Sign"], {}, [-x for x in wander])
    yield case("not a number keeps the sign", ["NotANumber"], {}, [1.0, NAN, 1.0, NAN, -1.0, NAN, -1.0])


def derivative(_params: Params, h: Sequence[float], xs: Sequence[float]) -> list[float]:
    """Difference to the value before over the time between; 0 where there is neither."""
    outputs: list[float] = []
    last: float | None = None
    for step, x in zip(h, xs, strict=True):
        outputs.append((x - last) / step if last is not None and step > 0.0 else 0.0)
        if last is None or step > 0.0:
            last = x
    return outputs


def derivative_cases() -> Iterator[dict[str, Any]]:
    """Slopes, the first sample, no time."""
    wander = list(_walk(14, 40))
    yield case("begins without a kick", ["Start"], {}, [7.0, 7.0, 8.0, 6.0], h=0.5)
    yield case("wandering", [], {}, wander, h=0.05)
    yield case("steps of any length", ["IrregularStep"], {}, wander, h=list(_walk(15, 40, low=0.01, high=2.0)))
    still = [-1.0 if i == 8 else 0.0 if i in (3, 4) else 0.1 for i in range(12)]
    yield case("time that stands still or turns back", ["ZeroStep"], {}, wander[:12], h=still)


def half_period(_params: Params, h: Sequence[float], samples: Sequence[Sequence[float]]) -> list[Any]:
    """Measure a half-period between two crossings: its samples are kept, and evaluated at its end."""
    outputs: list[Any] = []
    kept: list[tuple[float, Sequence[float]]] = []
    for step, sample in zip(h, samples, strict=True):
        if sample[5]:
            outputs.append(_measured(kept, sample))
            kept = []
        else:
            outputs.append(None)
        kept.append((step, sample))
    return outputs


def _measured(kept: Sequence[tuple[float, Sequence[float]]], closing: Sequence[float]) -> list[float]:
    """Numbers of one half-period, and the sample of the crossing that closes it; e, sp, slope, op, flags each."""
    opening = kept[0][1]
    delta_t = _sum(step for step, _ in kept)
    area = _sum(abs(sample[0]) * step for step, sample in kept)
    setpoints = [sample[1] for _, sample in kept] + [closing[1]]
    flags = 0
    for _, sample in kept:
        flags |= int(sample[4])
    return [
        flags,
        len(kept),
        delta_t,
        area / delta_t if delta_t > 0.0 else 0.0,
        max(abs(sample[0]) for _, sample in kept),
        max(setpoints) - min(setpoints),
        closing[1] - opening[1],
        closing[2] - opening[2],
        closing[3] - opening[3],
    ]


def half_period_cases() -> Iterator[dict[str, Any]]:
    """Errors, setpoints, flags between crossings."""
    e, sp, slope, op = (list(_walk(seed, 40, low, high)) for seed, low, high in _HALF_PERIOD_WALKS)

    def rows(crossings: set[int], flags: dict[int, int] | None = None, moving: bool = True) -> list[list[float]]:
        return [
            [e[i], sp[i] if moving else 2.0, slope[i], op[i], (flags or {}).get(i, 0), int(i in crossings)]
            for i in range(40)
        ]

    yield case("setpoint at rest", [], {}, rows({9, 20, 33}, moving=False), h=0.1)
    yield case("setpoint that moves", ["Setpoint"], {}, rows({9, 20, 33}), h=0.1)
    yield case("steps of any length", ["IrregularStep"], {}, rows({9, 33}), h=list(_walk(20, 40, low=0.01, high=2.0)))
    yield case("one sample long", ["Short"], {}, rows({4, 5, 6, 7}), h=0.1)
    yield case("without any time", ["Short"], {}, rows({4}, moving=False)[:8], h=0.0)
    yield case("flags on the way", ["Flags"], {}, rows({9, 20, 33}, {3: 1, 5: 8, 9: 4, 21: 2, 22: 16}), h=0.1)
    turned = [[-row[0], *row[1:]] for row in rows({9, 20, 33})]
    yield case("errors of the other sign", ["Sign"], {}, turned, h=0.1)


_HALF_PERIOD_WALKS = ((16, -1.0, 1.0), (17, 0.0, 5.0), (18, -0.5, 0.5), (19, 0.0, 100.0))


def width(params: Params, _h: Sequence[float], samples: Sequence[Sequence[float]]) -> list[list[float]]:
    """Compute (2.4) with (7.5) or (7.6) or OP's own travel."""
    return [_width(params, *sample) for sample in samples]


def _width(
    params: Params, sign: float, delta_t: float, delta_y: float, sp: float, slope: float, op: float
) -> list[float]:
    """Parts of one width; op NaN where OP is not known. Counted along the way that the integral part moves u."""
    k, ti, td, b, kp = (params.get(name) for name in ("k", "ti", "td", "b", "kp"))
    assert k is not None and ti is not None and b is not None
    size, along = abs(k), -1.0 if sign < 0 else 1.0
    integral = size * delta_y * delta_t / ti
    setpoint = (b - 1.0) * size * sp * along
    derivative_part = 0.0 if td is None else -(size * td * slope * along)
    travel = 0.0 if math.isnan(op) else op * math.copysign(along, along * k)
    free = travel if td != 0.0 and not math.isnan(op) else integral + derivative_part + setpoint
    process = 0.0 if kp is None else delta_y / abs(kp)
    return [integral, derivative_part, setpoint, travel, free, process, free - process]


def width_cases() -> Iterator[dict[str, Any]]:
    """PI, PID, OP known or not, both directions, setpoint weights."""
    columns = [list(_walk(seed, 20, low, high)) for seed, low, high in _WIDTH_WALKS]
    rows = [[1 if i % 2 else -1, *(column[i] for column in columns)] for i in range(20)]
    blind = [[*row[:5], NAN] for row in rows]
    pi = {"k": 0.48, "ti": 0.3117, "td": 0.0, "b": 1.0, "kp": 1.0}
    unknown = {name: value for name, value in pi.items() if name != "td"}
    yield case("PI (7.5)", [], pi, rows)
    yield case("PI without OP", ["NoOp"], pi, blind)
    yield case("PID (7.6)", ["Derivative"], pi | {"k": 1.12, "ti": 2.4, "td": 0.619}, rows)
    yield case("PID without OP", ["Derivative", "NoOp"], pi | {"k": 1.12, "ti": 2.4, "td": 0.619}, blind)
    yield case("Td not known: OP's travel", ["Op"], unknown, rows)
    yield case("Td not known, without OP", ["NoOp"], unknown, blind)
    yield case("direct-acting", ["Sign"], pi | {"k": -0.48}, rows)
    yield case("direct-acting, OP's travel", ["Sign", "Op"], unknown | {"k": -0.48}, rows)
    yield case("process gain below zero", ["Sign"], pi | {"kp": -2.0}, rows)
    yield case("process gain not known", ["NoKp"], {name: value for name, value in pi.items() if name != "kp"}, rows)
    yield case("setpoint weight 0", ["Setpoint"], pi | {"b": 0.0}, rows)
    yield case("setpoint weight in between", ["Setpoint"], pi | {"b": 0.3, "td": 0.1}, rows)
    yield case("no error, no time", ["Zero"], pi, [[0, 0.0, 0.0, 0.0, 0.0, 0.0], [1, 0.0, 0.0, 0.0, 0.0, NAN]])


_WIDTH_WALKS = ((21, 0.0, 60.0), (22, 0.0, 0.2), (23, -0.1, 0.1), (24, -0.05, 0.05), (25, -1.0, 1.0))


def swing(params: Params, h: Sequence[float], samples: Sequence[Sequence[float]]) -> list[Any]:
    """Keep OP and errors of a half-period, and look at them when it ends; OP by (4.1) where it is NaN."""
    outputs: list[Any] = []
    by_hand = _ByHand(params)
    kept: list[tuple[float, float, float]] = []
    before: tuple[float, float] | None = None
    switched = recorded = False
    for step, (sp, yf, op, ends, flags) in zip(h, samples, strict=True):
        if ends:
            sign, whole = int(ends), bool(kept) and not switched and not int(flags) & (1 | 2 | 16)
            outputs.append(_swung(params, kept, sign, before if whole else None, recorded))
            turn = _turn(params, kept, sign, recorded)
            before = (turn, ends) if whole else None
            if not recorded:
                by_hand.u = by_hand.u - turn if whole else 0.0
                before = (0.0, ends) if whole else None
            kept, switched = [], False
        else:
            outputs.append(None)
        if not step > 0.0 or not math.isfinite(sp - yf):
            continue
        value = by_hand.moved(step, sp, yf, op)
        switched |= recorded == math.isnan(op) and (bool(kept) or before is not None)
        recorded = not math.isnan(op)
        kept.append((step, sp - yf, value))
    return outputs


class _ByHand:
    """u/K of (4.1), or the OP that was recorded."""

    def __init__(self, params: Params) -> None:
        self.params = params
        self.u = self.sp = self.yf = self.slope = 0.0
        self.started = False

    def moved(self, h: float, sp: float, yf: float, op: float) -> float:
        slope = 0.0
        td = self.params.get("td", 0.0)
        if td > 0.0 and self.started:
            slope = (yf - self.yf) / h
        if math.isnan(op):
            proportional = self.params["b"] * (sp - self.sp) - (yf - self.yf)
            self.u += proportional + (sp - yf) * (h / self.params["ti"]) - td * (slope - self.slope)
        else:
            self.u = op
        self.sp, self.yf, self.slope, self.started = sp, yf, slope, True
        return self.u


def _turn(params: Params, kept: Sequence[tuple[float, float, float]], sign: int, recorded: bool) -> float:
    """Furthest value of OP on the side to which the integral action drives it."""
    rises = (sign > 0) == (not recorded or params["k"] > 0.0)
    values = [value for _, _, value in kept]
    return (max(values) if rises else min(values)) if values else 0.0


def _swung(
    params: Params,
    kept: Sequence[tuple[float, float, float]],
    sign: int,
    before: tuple[float, float] | None,
    recorded: bool,
) -> list[float]:
    """Travel from the turn before, NaN without one, and the height of PV's plateau."""
    travel = NAN
    if before is not None and before[1] == -sign:
        travel = abs(_turn(params, kept, sign, recorded) - before[0])
        travel = travel if recorded else abs(params["k"]) * travel
    area = _sum(abs(e) * h for h, e, _ in kept)
    square = _sum(abs(e) * abs(e) * h for h, e, _ in kept)
    plateau = 2.0 * (square / area) - area / _sum(h for h, _, _ in kept) if area > 0.0 else 0.0
    return [travel, plateau]


def swing_cases() -> Iterator[dict[str, Any]]:
    """OP recorded or by (4.1), both actions, breaks, half-periods on one side, a setpoint that moves."""
    e, sp, op = (list(_walk(seed, 60, low, high)) for seed, low, high in ((60, 0.0, 2.0), (61, 4.0, 6.0), (62, 0, 9)))

    def rows(
        ends: dict[int, int], flags: dict[int, int] | None = None, known: bool = True, moving: bool = False
    ) -> list[list[float]]:
        out = []
        for i in range(60):
            # The sign of the half-period under way is that of the next end.
            under_way = next((sign for at, sign in sorted(ends.items()) if at > i), 1)
            setpoint = sp[i] if moving else 5.0
            known_op = op[i] if known else NAN
            out.append([setpoint, setpoint - under_way * e[i], known_op, ends.get(i, 0), (flags or {}).get(i, 0)])
        return out

    to_and_fro = {9: 1, 20: -1, 33: 1, 45: -1, 57: 1}
    pi = {"k": 0.775, "ti": 2.05, "b": 0.0}
    pid_ = {"k": 1.12, "ti": 2.4, "td": 0.619, "b": 0.0}
    yield case("OP recorded", [], pi, rows(to_and_fro), h=0.1)
    yield case("OP recorded, direct-acting", ["Sign"], pi | {"k": -0.775}, rows(to_and_fro), h=0.1)
    yield case("OP of a PI by (4.1)", ["ByHand"], pi, rows(to_and_fro, known=False), h=0.1)
    yield case("OP of a PID by (4.1)", ["ByHand"], pid_, rows(to_and_fro, known=False), h=0.1)
    yield case("by (4.1), direct-acting", ["ByHand", "Sign"], pid_ | {"k": -2.0}, rows(to_and_fro, known=False), h=0.1)
    moving = rows(to_and_fro, known=False, moving=True)
    yield case("setpoint that moves, weight 0", ["Setpoint"], pi, moving, h=0.1)
    yield case("setpoint that moves, weight 0.7", ["Setpoint"], pi | {"b": 0.7}, moving, h=0.1)
    yield case("a break on the way", ["Break"], pi, rows(to_and_fro, {33: 16}), h=0.1)
    yield case("a bad value, by (4.1)", ["Break", "ByHand"], pi, rows(to_and_fro, {20: 2}, known=False), h=0.1)
    yield case("at a limit is no break", ["Break"], pi, rows(to_and_fro, {20: 8, 33: 4}), h=0.1)
    yield case("twice on one side", ["OneSide"], pi, rows({9: 1, 20: 1, 33: -1, 45: 0, 57: 1}), h=0.1)
    lost = [[*row[:2], NAN if 25 <= i < 40 else row[2], *row[3:]] for i, row in enumerate(rows(to_and_fro))]
    yield case("OP missing for a while", ["Switch"], pi, lost, h=0.1)
    steps = [0.0 if i in (0, 14, 15) else h for i, h in enumerate(_walk(63, 60, low=0.01, high=1.0))]
    yield case("steps of any length", ["ZeroStep"], pid_, rows(to_and_fro, known=False), h=steps)
    yield case("no time at all", ["ZeroStep"], pi, rows({4: 1, 5: -1})[:8], h=0.0)


def correction(params: Params, h: Sequence[float], samples: Sequence[Sequence[float]]) -> list[list[float]]:
    """All pairs of all half-periods so far, of which the last nine count; worked off with the sample after."""
    swings = swing(params, h, [row[:5] for row in samples])
    halves: list[tuple[int, int, float, list[float]]] = []
    pairs: list[tuple[float, float]] = []
    outputs = []
    shown, due = [NAN, NAN, NAN, NAN, 1.0], False
    for i, (row, swung) in enumerate(zip(samples, swings, strict=True)):
        if due:
            noise = noise_level({}, [], [row[2] for row in samples[:i]])[-1]
            shown, due = _corrected(pairs[-9:], params.get("kp"), 0.0 if math.isnan(noise) else 6.0 * noise), False
        if swung is not None:
            halves.append((int(row[3]), int(row[5]), row[6], swung))
            pair = _pair(halves[-3:])
            pairs += [pair] if pair is not None else []
            due = pair is not None
        outputs.append([NAN, NAN, NAN, NAN, 7.0] if params.get("integrating") else shown)
    return outputs


def _pair(halves: Sequence[tuple[int, int, float, list[float]]]) -> tuple[float, float] | None:
    """Travel of OP and way of PV of the half-period in the middle, if it was accepted between whole ones."""
    if len(halves) < 3:
        return None
    (_, mask_before, _, _), (sign, mask, delta_y, (travel, plateau)), (sign_after, mask_after, delta_y_after, after) = (
        halves
    )
    broken = sum(1 << REASON_ORDER.index(name) for name in ("gap", "bad_quality", "not_auto", "saturated", "sp_moved"))
    whole = (
        mask == 0 and not (mask_before | mask_after) & broken and not mask_after & 1 << REASON_ORDER.index("too_short")
    )
    way = plateau + after[1]
    reached = way <= 1.4 * (delta_y + delta_y_after)
    return (travel, way) if whole and reached and sign_after == -sign and not math.isnan(travel) else None


def _corrected(pairs: Sequence[tuple[float, float]], kp: float | None, noise: float) -> list[float]:
    """Width, smallest, largest and Kp, and 0, or the number of the doubt."""
    if len(pairs) < (3 if kp is not None else 4):
        return [NAN, NAN, NAN, NAN, 1.0]
    found = _line(pairs) if kp is None else _known(pairs, abs(kp))
    if isinstance(found, float):
        return [NAN, NAN, NAN, NAN, found]
    return [NAN, NAN, NAN, NAN, 6.0] if found[0] < noise else [*found, 0.0]


def _middle(values: Iterable[float]) -> float:
    ordered = sorted(values)
    half = len(ordered) // 2
    return ordered[half] if len(ordered) % 2 else (ordered[half - 1] + ordered[half]) / 2.0


def _known(pairs: Sequence[tuple[float, float]], kp: float) -> list[float] | float:
    middle = _middle(travel - way / kp for travel, way in pairs)
    if middle <= 0.0 or middle < _middle(way / kp for _, way in pairs):
        return 5.0
    by_way = sorted(pairs, key=lambda pair: pair[1] / kp)
    agree = [d for d in (travel - way / kp for travel, way in by_way) if abs(d - middle) <= 0.1 * middle]
    return 4.0 if 3 * len(agree) < 2 * len(pairs) else [_sum(agree) / len(agree), min(agree), max(agree), kp]


def _line(pairs: Sequence[tuple[float, float]]) -> list[float] | float:
    ordered = sorted(pairs, key=lambda pair: pair[1])
    if ordered[-1][1] < 1.5 * ordered[0][1]:
        return 2.0
    origin = ordered[len(ordered) // 2]
    off = [(travel - origin[0], way - origin[1]) for travel, way in ordered]
    products = [[1.0, t, w, t * t, w * w, t * w] for t, w in off]
    sums = [_sum(column) for column in zip(*products, strict=True)]
    all_of = _through(origin, sums)
    if isinstance(all_of, float):
        return all_of
    d, per_way = all_of
    if d <= 0.0 or d < per_way * _middle(way for _, way in pairs):
        return 5.0
    without = [_through(origin, [a - b for a, b in zip(sums, one, strict=True)]) for one in products]
    if any(isinstance(one, float) for one in without):
        return 4.0
    widths = [d, *(one[0] for one in without if not isinstance(one, float))]
    return 4.0 if min(widths) < 0.8 * d or max(widths) > 1.2 * d else [d, min(widths), max(widths), 1.0 / per_way]


def _through(origin: tuple[float, float], sums: Sequence[float]) -> tuple[float, float] | float:
    """Travel where the way is 0, and travel per way: the way is regressed on the travel."""
    n, t, w, tt, ww, tw = sums
    tt, ww, tw = tt - t * t / n, ww - w * w / n, tw - t * w / n
    if tw <= 0.0:
        return 3.0
    if tw * tw < 0.9 * tt * ww:
        return 4.0
    per_way = tt / tw
    return origin[0] + t / n - per_way * (origin[1] + w / n), per_way


def correction_cases() -> Iterator[dict[str, Any]]:
    """Half-periods whose OP goes d and the way over Kp, with and without Kp; what is refused, and why."""
    random = Random(64)

    def rows(
        turns: Sequence[float], plateaus: Sequence[float], masks: dict[int, int] | None = None, noise: float = 0.0
    ) -> list[list[float]]:
        """Twelve samples from turn to turn; a half-period ends with the first of the next."""
        out, before = [], 0.0
        for i, (turn, plateau) in enumerate(zip(turns, plateaus, strict=True)):
            sign = -1 if i % 2 else 1
            for j in range(12):
                op = before + (turn - before) * min(j + 3, 12) / 12 + noise * (random.random() - 0.5)
                ends = -sign if i and j == 0 else 0
                mask = (masks or {}).get(i - 1, 0) if ends else 0
                flags = 16 if mask & 1 else 0
                out.append([50.0, 50.0 - sign * plateau, op, ends, flags, mask, plateaus[i - 1] if ends else 0.0])
            before = turn
        return out

    def gap(plateaus: Sequence[float], d: float = 2.0, kp: float = 1.6, scatter: float = 0.0) -> list[float]:
        turn, turns = 0.0, []
        for i, (here, after) in enumerate(itertools.pairwise([*plateaus, plateaus[-1]])):
            travel = d + (here + after) / kp + scatter * (random.random() - 0.5)
            turn += -travel if i % 2 else travel
            turns.append(turn)
        return turns

    swings = [0.4 + 0.9 * random.random() for _ in range(16)]
    alike = [0.5 + 0.01 * random.random() for _ in range(16)]
    loop = {"k": 1.2, "ti": 5.0, "b": 1.0}
    known = loop | {"kp": -1.6}
    yield case("Kp known", [], known, rows(gap(swings), swings), h=0.5)
    yield case("Kp known, widths that scatter a little", [], known, rows(gap(swings, scatter=0.2), swings), h=0.5)
    yield case("Kp not known", ["Line"], loop, rows(gap(swings, scatter=0.05), swings), h=0.5)
    yield case("Kp not known, ways alike", ["Line"], loop, rows(gap(alike), alike), h=0.5)
    yield case(
        "Kp not known, OP travels less where PV swings further",
        ["Line"],
        loop,
        rows(gap(swings, 6.0, -1.0), swings),
        h=0.5,
    )
    yield case("widths that do not agree", ["Doubt"], known, rows(gap(swings, scatter=1.6), swings), h=0.5)
    yield case("Kp not known, no line", ["Doubt", "Line"], loop, rows(gap(swings, scatter=1.6), swings), h=0.5)
    yield case("the way is longer than the gap", ["Doubt"], known, rows(gap(swings, d=0.2), swings), h=0.5)
    yield case("the same without Kp", ["Doubt", "Line"], loop, rows(gap(swings, d=0.2), swings), h=0.5)
    yield case("noise moves OP by as much", ["Noise"], known, rows(gap(swings), swings, noise=3.0), h=0.5)
    yield case("the process integrates", ["Doubt"], known | {"integrating": 1.0}, rows(gap(swings), swings)[:60], h=0.5)
    broken = {3: 1, 11: 128}
    yield case("half-periods that are not whole", ["Whole"], known, rows(gap(swings), swings, broken), h=0.5)
    refused = {4: 32, 8: 64, 12: 256}
    few = {3: 2, 6: 4, 9: 8, 12: 16}
    yield case("hardly one that is", ["Whole"], known, rows(gap(swings), swings, few), h=0.5)
    yield case(
        "half-periods that are whole and not accepted", ["Whole"], known, rows(gap(swings), swings, refused), h=0.5
    )


REASON_ORDER = (
    "gap",
    "bad_quality",
    "not_auto",
    "saturated",
    "too_short",
    "not_square",
    "uneven",
    "sp_moved",
    "too_small",
)
SWITCHES = ("limits", "too_short", "not_square", "decaying", "growing", "sp_moved", "too_small")
FLAG_NOT_AUTO, FLAG_BAD, FLAG_LIMIT, FLAG_GAP = 1, 2, 4 | 8, 16


def safety_net(params: Params, _h: Sequence[float], samples: Sequence[Sequence[float]]) -> list[list[int]]:
    """All conditions that a half-period fails, and the first of them."""
    return [list(_verdict(params, *sample)) for sample in samples]


def _verdict(
    params: Params,
    flags: float,
    delta_t: float,
    delta_y: float,
    e_max: float,
    delta_sp: float,
    free: float,
    previous: float,
    d_hat: float,
) -> tuple[int, int]:
    """Mask and reason; previous and d_hat NaN where there are none."""
    on = {switch: params.get(switch, 1) != 0 for switch in SWITCHES}
    known = not math.isnan(previous)
    met = int(flags)
    failed = {
        "gap": bool(met & FLAG_GAP),
        "bad_quality": bool(met & FLAG_BAD),
        "not_auto": bool(met & FLAG_NOT_AUTO),
        "saturated": (on["limits"] and bool(met & FLAG_LIMIT)) or not free < params.get("op_span", math.inf),
        "too_short": on["too_short"] and not delta_t > 5.0 * params["ti"],
        "not_square": on["not_square"] and not e_max < 2.0 * delta_y,
        "uneven": (on["decaying"] and not (known and previous < 1.5 * delta_y))
        or (on["growing"] and not (known and previous > 0.5 * delta_y)),
        "sp_moved": on["sp_moved"] and not delta_sp < delta_y,
        # (5.1) multiplied out; NaN compares false, which is what "not asked" means.
        "too_small": on["too_small"] and delta_t * 2.0 * abs(params["k"]) * delta_y <= params["ti"] * d_hat,
    }
    mask = sum(1 << i for i, reason in enumerate(REASON_ORDER) if failed[reason])
    return mask, next((i for i, reason in enumerate(REASON_ORDER, 1) if failed[reason]), 0)


def safety_net_cases() -> Iterator[dict[str, Any]]:
    """Each condition on its edge, alone and with others, and switched off."""
    good = [0, 60.0, 1.0, 1.2, 0.0, 4.0, 1.0, NAN]
    k = {"k": 0.5, "ti": 10.0}

    def but(**changes: float) -> list[float]:
        names = ("flags", "delta_t", "delta_y", "e_max", "delta_sp", "free", "previous", "d_hat")
        return [changes.get(name, value) for name, value in zip(names, good, strict=True)]

    span = k | {"op_span": 100.0}
    flags = [but(flags=flag) for flag in range(32)]
    edges = [
        but(),
        *(but(delta_t=x) for x in (49.999999999999, 50.0, 50.00000000000001)),
        *(but(e_max=x) for x in (1.9999999999999998, 2.0, 2.0000000000000004)),
        *(but(previous=x) for x in (0.5, 0.5000000000000001, 1.4999999999999998, 1.5, NAN)),
        *(but(delta_sp=x) for x in (0.9999999999999999, 1.0)),
        *(but(free=x) for x in (99.99999999999999, 100.0, -100.0)),
        *(but(d_hat=x) for x in (5.999999999999999, 6.0, 6.000000000000001, 0.0, -1.0)),
    ]
    everything = but(flags=31, delta_t=1.0, delta_y=0.1, e_max=9.0, delta_sp=9.0, free=200.0, d_hat=9.0)
    several = [but(delta_t=20.0, e_max=3.0), but(delta_sp=2.0, previous=9.0), but(flags=1, d_hat=90.0), everything]
    yield case("flags, each alone and together", ["Flags"], k, flags)
    yield case("on the edge of each condition", ["Edge"], span, edges)
    yield case("several at once: the first names the reason", ["Order"], span, several)
    yield case("span of OP not known", ["Span"], k, [but(free=1e9), but(free=-1e9)])
    yield case("nothing happened", ["Zero"], k, [but(delta_t=0.0, delta_y=0.0, e_max=0.0, previous=0.0, d_hat=0.0)])
    yield case("direct-acting", ["Sign"], k | {"k": -0.5}, edges)
    for switch in SWITCHES:
        rows = [*edges, *several, but(flags=4), but(flags=8), but(previous=9.0), but(previous=0.1), but(d_hat=90.0)]
        yield case(f"without {switch}", ["Switch"], span | {switch: 0}, rows)


def median_mean(params: Params, _h: Sequence[float], xs: Sequence[float]) -> list[list[float]]:
    """Median of the last n, mean of those within 80–120 % of it (7.3)."""
    return [_shown(xs[max(0, i + 1 - int(params["n"])) : i + 1]) for i in range(len(xs))]


def _shown(window: Sequence[float]) -> list[float]:
    """Value, smallest and largest kept, how many were kept, how many there are."""
    ranked = sorted(window)
    middle = len(ranked) // 2
    median = ranked[middle] if len(ranked) % 2 else (ranked[middle - 1] + ranked[middle]) / 2.0
    kept = [x for x in ranked if abs(x - median) <= 0.2 * abs(median)]
    if not kept:
        return [median, median, median, 0, len(ranked)]
    return [_sum(kept) / len(kept), kept[0], kept[-1], len(kept), len(ranked)]


def median_mean_cases() -> Iterator[dict[str, Any]]:
    """Few and many detections, outliers, signs, ties."""
    wander = list(_walk(26, 60, low=2.0, high=8.0))
    yield case("an outlier in a window of three", [], {"n": 3}, [5.0, 40.0, 5.5, 5.2, 0.1])
    yield case("two that disagree", ["Even"], {"n": 9}, [1.0, 9.0, 2.0, 8.0])
    yield case("the window moves", ["Window"], {"n": 5}, wander)
    yield case("nine", ["Window"], {"n": 9}, wander)
    yield case("the longest window", ["Window"], {"n": 31}, wander)
    yield case("one", ["Window"], {"n": 1}, wander[:8])
    yield case("below zero", ["Sign"], {"n": 5}, [-x for x in wander[:30]])
    yield case("a step from one width to another", ["Step"], {"n": 9}, [5.0] * 12 + [2.0] * 12)
    yield case(
        "on the edge of the band", ["Edge"], {"n": 3}, [10.0, 12.0, 8.0, 10.0, 12.000000000000002, 7.999999999999999]
    )
    yield case("nothing but zero", ["Zero"], {"n": 3}, [0.0, 0.0, 0.0, 0.0, 1.0])


DETECTION_FIELDS = (
    "sign",
    "samples",
    "delta_t",
    "delta_y",
    "e_max",
    "delta_sp",
    "delta_u",
    "delta_u_d",
    "delta_u_sp",
    "op_travel",
    "free",
    "kp_part",
    "d",
    "previous_delta_y",
    "d_hat_before",
    "mask",
    "reason",
    "d_hat",
    "detections",
    "median_mean",
    "noise_floor",
)


# 1/(0.6745·√70) and 1/√12, to the nearest double.
OF_MEDIAN, OF_GRID = 0.17720216595024368, 0.28867513459481287


def noise_level(_params: Params, _h: Sequence[float], xs: Sequence[float]) -> list[float]:
    """Noise by the median size of the fourth difference, and by the grid that the values lie on."""
    outputs: list[float] = []
    values: list[float] = []  # since the last break, without those that are held
    last, repeats = NAN, 0
    sizes, median, gain, grid = 0, 0.0, 0.25, math.inf
    for x in xs:
        repeats = repeats + 1 if x == last else 0
        last = x
        if not math.isfinite(x):
            values = []
        elif repeats < 5:
            values.append(x)
            steps = _differences(values[-2:], 1)
            grid = min([grid, *(abs(step) for step in steps if step != 0.0)])
            for size in map(abs, _differences(values[-5:], 4)):
                if sizes >= 8:
                    median = max(median + gain * median if size > median else median - gain * median, grid)
                    gain = max(gain - gain * gain / 2.0, 1.0 / 512.0)
                    sizes += 1
                elif size > 0.0:
                    median = size if sizes == 0 else min(median, size)
                    sizes += 1
        known = sizes >= 20
        outputs.append(max(median * OF_MEDIAN, grid * OF_GRID) if known else NAN)
    return outputs


def _differences(values: Sequence[float], order: int) -> list[float]:
    for _ in range(order):
        values = [b - a for a, b in itertools.pairwise(values)]
    return list(values)


def noise_level_cases() -> Iterator[dict[str, Any]]:
    """Noise on a moving signal, on one at rest, and none."""
    random = Random(71)

    def noise(n: int, size: float = 0.1) -> list[float]:
        return [size * (random.random() - 0.5) for _ in range(n)]

    plain = noise(120)
    yield case("noise", [], {}, plain)
    yield case("the other sign", ["Sign"], {}, [-x for x in plain])
    yield case("on a ramp", ["Offset"], {}, [101325.0 + 0.3 * i + x for i, x in enumerate(noise(120))])
    yield case("on steps", [], {}, [float(i // 20 % 2) + x for i, x in enumerate(noise(120))])
    yield case("much less, and much more", [], {}, [*noise(60, 1.0), *noise(60, 0.001), *noise(60, 10.0)])
    yield case("an outlier first", ["Start"], {}, [1e6, *noise(60)])
    yield case("rounded", ["Grid"], {}, [round(4.0 * math.sin(i / 9.0)) / 4.0 for i in range(150)])
    yield case("held", ["Held"], {}, [x for x in noise(30) for _ in range(8)])
    yield case("held for less", ["Held"], {}, [x for x in noise(30) for _ in range(3)])
    yield case("nothing moves", ["Held", "Zero"], {}, [5.0] * 40)
    yield case("a ramp without noise", ["Zero"], {}, [0.25 * i for i in range(60)] + noise(30, 2.0))
    broken = [NAN if i in (0, 13, 14, 40, 43, 47, 80) else x for i, x in enumerate(noise(120))]
    yield case("values that are missing", ["NotANumber"], {}, broken)
    alike = [5.0 if i % 7 else NAN for i in range(50)]
    yield case("missing among those that rest", ["NotANumber", "Zero"], {}, alike + noise(40))


def detector(
    params: Params, h: Sequence[float], samples: Sequence[Sequence[float]], raw: Sequence[float] | None = None
) -> list[Any]:
    """Cut the recording into stretches, these into half-periods, and judge one after the other.

    The noise is that of `raw`, PV as measured, where PV itself comes filtered.
    """
    outputs: list[Any] = [None] * len(samples)
    memory = _Memory(params)
    stretches = _stretches(params, h, samples)
    heard: list[float] = []
    at = {}
    for stretch in stretches:
        heard.append(NAN)
        for row in stretch["good"]:
            at[row[0]] = len(heard)
            heard.append(row[3] if raw is None else raw[row[0]])
    levels = noise_level({}, [], heard)
    for index, sign, measured, op_known in _ended(params, stretches):
        outputs[index] = memory.judge(sign, measured, op_known, levels[at[index]] if index in at else NAN)
    return outputs


def _stretches(params: Params, h: Sequence[float], samples: Sequence[Sequence[float]]) -> list[dict[str, Any]]:
    """Cut where time or value breaks the signal: samples that cannot be used come first, then those that can."""
    op_known = params["op_known"] != 0
    stretches: list[dict[str, Any]] = []
    for i, (step, (sp, pv, op, flag)) in enumerate(zip(h, samples, strict=True)):
        flags = int(flag)
        good = flags & FLAG_BAD == 0 and all(math.isfinite(x) for x in ((sp, pv, op) if op_known else (sp, pv)))
        if stretches and step == 0.0:
            stretches[-1]["flags" if not stretches[-1]["good"] else "last"] |= flags
            if stretches[-1]["good"]:
                stretches[-1]["good"][-1][-1] |= flags
            continue
        late = not 0.0 < step <= params["max_h"]
        if not stretches or late or (not good and stretches[-1]["good"]):
            cause = (FLAG_GAP if late or not stretches else 0) | (0 if good else FLAG_BAD)
            stretches.append({"at": i, "cause": cause, "flags": cause, "unusable": 0, "last": 0, "good": []})
        here = stretches[-1]
        if not good:
            here["flags"] |= flags | FLAG_BAD
            here["unusable"] += 1
            continue
        if op_known and "op_low" in params:
            flags |= (4 if op <= params["op_low"] else 0) | (8 if op >= params["op_high"] else 0)
        here["good"].append([i, step, sp, pv, op if op_known else 0.0, flags])
    return stretches


def _ended(params: Params, stretches: Sequence[dict[str, Any]]) -> Iterator[tuple[int, int, list[float], bool]]:
    """Half-periods of stretches that follow each other."""
    for stretch, ending in itertools.zip_longest(stretches, stretches[1:]):
        yield from _half_periods(params, stretch, ending)


def _half_periods(
    params: Params, stretch: dict[str, Any], ending: dict[str, Any] | None
) -> Iterator[tuple[int, int, list[float], bool]]:
    """Half-periods of one stretch with the index of the sample that ends each, its sign and its numbers."""
    good, op_known = stretch["good"], params["op_known"] != 0
    steps = [0.0 if i == 0 else row[1] for i, row in enumerate(good)]
    yf = filter_({"tf": params["tf"]}, steps, [row[3] for row in good])
    opf = filter_({"tf": params["tf"]}, steps, [row[4] for row in good])
    slopes = derivative({}, steps, yf)
    errors = [row[2] - y for row, y in zip(good, yf, strict=True)]
    crossings = zero_crossing({}, steps, errors)
    rows = [
        (steps[i], [errors[i], good[i][2], slopes[i], opf[i], good[i][5], crossings[i][0]]) for i in range(len(good))
    ]
    begin = 0
    for i in [i for i, (crossed, _) in enumerate(crossings) if crossed]:
        measured = _measured(rows[begin:i], rows[i][1])
        if begin == 0:
            measured[0] = int(measured[0]) | stretch["flags"]
            measured[1] += stretch["unusable"]
        yield good[i][0], crossings[i - 1][1], measured, op_known
        begin = i
    if ending is not None:
        if rows:
            # Values at the closing crossing are not known: they are those at the opening one.
            measured = _measured(rows[begin:], rows[begin][1])
            sign = crossings[-1][1]
        else:
            measured, sign = [0, 0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], 0
        if begin == 0:
            measured[0] = int(measured[0]) | stretch["flags"]
            measured[1] += stretch["unusable"]
        measured[0] = int(measured[0]) | ending["cause"]
        yield ending["at"], sign, measured, op_known


class _Memory:
    """Memory from one half-period to the next."""

    def __init__(self, params: Params) -> None:
        self.params = params
        self.n = int(params["n"])
        self.detections: list[float] = []  # all behind the estimate, since it was last replaced
        self.row: list[tuple[float, float]] = []  # (d, Δt) of those that only (5.1) rejected, since a detection
        self.row_others: list[float] = []  # Δt of the others since then
        self.previous = NAN
        self.noise_floor = NAN

    def shown(self) -> list[float] | None:
        """Value, smallest and largest kept, kept, count."""
        return _shown(self.detections[-self.n :]) if self.detections else None

    def judge(self, sign: int, measured: list[float], op_known: bool, sigma: float) -> list[float]:
        """Half-period in, everything concluded from it out, as `DETECTION_FIELDS`."""
        flags, samples, delta_t, delta_y, e_max, delta_sp, sp_change, slope_change, op_change = measured
        op_change = op_change if op_known else NAN
        parts = _width(self.params, sign, delta_t, delta_y, sp_change, slope_change, op_change)
        before = self.shown()
        d_hat_before = before[0] if before is not None and before[4] == self.n else NAN
        previous = self.previous
        mask, reason = _verdict(self.params, flags, delta_t, delta_y, e_max, delta_sp, parts[4], previous, d_hat_before)
        broken = int(flags) & (FLAG_GAP | FLAG_BAD | FLAG_NOT_AUTO) != 0
        if mask == 0:
            self.detections.append(parts[6])
            self._hear(sigma)
            self.row, self.row_others = [], []
        elif reason == REASON_ORDER.index("too_small") + 1:
            self.row.append((parts[6], delta_t))
            self._reconsider(sigma)
        elif not broken and self.row:
            self.row_others.append(delta_t)
        self.previous = NAN if broken else delta_y
        after = self.shown()
        found, count = (NAN, 0) if after is None else (after[0], after[4])
        shown = [NAN if found < self.noise_floor else found, count, found, self.noise_floor]
        head = [sign, samples, delta_t, delta_y, e_max, delta_sp]
        return [*head, *parts, previous, d_hat_before, mask, reason, *shown]

    def _hear(self, sigma: float) -> None:
        """The noise limit, 3σ/Kp; Kp not known: 1/2K."""
        kp = self.params.get("kp")
        self.noise_floor = 3.0 * sigma * (2.0 * abs(self.params["k"])) if kp is None else 3.0 * sigma / abs(kp)

    def _reconsider(self, sigma: float) -> None:
        """A row of detections that only (5.1) rejected replaces the others when it is believed."""
        candidates = [d for d, _ in self.row]
        _, _, _, kept, count = _shown(candidates[-self.n :])
        agree = count == self.n and kept >= 2 * self.n / 3
        mostly = math.fsum(t for _, t in self.row) >= math.fsum(self.row_others)
        if (agree and mostly) or len(candidates) >= 10 * self.n:
            self.detections = candidates
            self._hear(sigma)
            self.row, self.row_others = [], []


def detector_cases() -> Iterator[dict[str, Any]]:
    """Limit cycles in noise, with everything that breaks, moves or misleads."""
    pi = {"k": 0.5, "ti": 1.0, "td": 0.0, "b": 1.0, "kp": 2.0, "tf": 0.125, "n": 3, "max_h": 1.0, "op_known": 0}
    loose = {name: value for name, value in pi.items() if name not in ("td", "kp")} | {"op_known": 1}
    h = 0.25
    cycle = _cycle([8.0] * 10)

    def with_(changes: dict[int, dict[str, float]], rows: list[list[float]] = cycle) -> list[list[float]]:
        names = ("sp", "pv", "op", "flags")
        return [
            [changes.get(i, {}).get(name, value) for name, value in zip(names, row, strict=True)]
            for i, row in enumerate(rows)
        ]

    yield case("limit cycle", [], pi, cycle, h=h)
    yield case("limit cycle, other sign", ["Sign"], pi, [[-sp, -pv, op, flags] for sp, pv, op, flags in cycle], h=h)
    direct = [[sp, pv, -op, flags] for sp, pv, op, flags in cycle]
    yield case("direct-acting, OP's travel", ["Sign", "Op"], loose | {"k": -0.5}, direct, h=h)
    yield case("Td not known, OP's travel", ["Op"], loose, cycle, h=h)
    yield case("PID", ["Derivative"], pi | {"td": 0.25, "b": 0.0}, cycle, h=h)
    steps = [h * (1 + i * i % 3) for i in range(len(cycle))]
    yield case("steps of any length", ["IrregularStep"], pi, cycle, h=steps)
    at = {75: {"sp": 0.3}, 76: {"sp": 0.3}, 77: {"sp": 0.3}}
    yield case("setpoint that moves", ["Setpoint"], pi | {"b": 0.0}, with_(at), h=h)
    yield case("in manual for a while", ["Flags"], pi, with_({i: {"flags": 1} for i in range(150, 155)}), h=h)
    yield case("limit flags", ["Flags"], pi, with_({100: {"flags": 4}, 166: {"flags": 8}}), h=h)
    yield case("OP at its limits", ["Flags"], loose | {"op_low": -1.27, "op_high": 1.5}, cycle, h=h)
    yield case("span of OP", ["Flags"], pi | {"op_span": 0.761}, cycle, h=h)
    bad = {50: {"pv": NAN}, 51: {"sp": NAN}, 52: {"flags": 2}, 130: {"pv": NAN}, 132: {"flags": 3}}
    yield case("bad values", ["Bad"], pi, with_(bad), h=h)
    yield case("bad values of OP", ["Bad", "Op"], loose, with_({50: {"op": NAN}, 200: {"op": NAN}}), h=h)
    yield case("OP not known: its values are nothing", ["Op"], pi, with_({50: {"op": NAN}}), h=h)
    yield case("begins with bad values", ["Bad", "Start"], pi, with_({0: {"pv": NAN}, 1: {"pv": NAN}}), h=h)
    late = [30.0 if i in (60, 61) else -5.0 if i == 150 else h for i in range(len(cycle))]
    yield case("gaps and time that turns back", ["Gap"], pi, cycle, h=late)
    both = with_({60: {"pv": NAN}, 149: {"pv": NAN}, 150: {"pv": NAN}})
    yield case("a gap that ends in a bad value", ["Gap", "Bad"], pi, both, h=late)
    again = [0.0 if i in (0, 49, 50, 125) else h for i in range(len(cycle))]
    yield case("time that stands still", ["ZeroStep"], pi, with_({49: {"flags": 1}, 125: {"pv": NAN}}), h=again)
    yield case("exactly at the setpoint", ["Zero"], pi, [[1.0, 1.0, 0.0, 0]] * 30, h=h)
    smaller = _cycle([16.0] * 5 + [5.5] * 8)
    yield case("a gap that has become smaller", ["LockOut"], pi, smaller, h=h)
    rarely = _cycle([16.0] * 5 + [5.5, 3.5, 3.5, 3.5] * 31)
    noisy = _cycle([8.0] * 8, noise=0.2)
    yield case("below the noise limit", ["Noise"], pi | {"k": 1.0, "kp": 0.14}, noisy, h=h)
    yield case("below the noise limit, Kp not known", ["Noise", "Op"], loose | {"k": 6.0}, noisy, h=h)
    yield case("smaller ones now and then: believed after ten times N", ["LockOut"], pi, rarely, h=h)


def _cycle(half_periods: Sequence[float], noise: float = 0.02) -> list[list[float]]:
    """PV nearly square around 0, OP a triangle, in noise; lengths in s at a step of 0.25 s."""
    random = Random(27)
    rows = []
    op, side = 0.0, 1.0
    for length in half_periods:
        for _ in range(round(length / 0.25)):
            op -= side * 0.04
            rows.append([0.0, side * 0.2 + noise * (random.random() - 0.5), op, 0])
        side = -side
    return rows


RULES = (
    "ziegler_nichols_step",
    "ziegler_nichols_frequency",
    "lambda",
    "lambda_integrating",
    "amigo_step",
    "amigo_integrating",
    "amigo_frequency",
    "simc",
    "simc_integrating",
    "point_placement",
)


def tuning(params: Params, _h: Sequence[float], rows: Sequence[Sequence[float]]) -> list[list[float]]:
    """K, Ti, Td of a rule in exact rational arithmetic, rounded once at the end."""
    return [[float(number) for number in _tuned(params, row)] for row in rows]


def _tuned(params: Params, row: Sequence[float]) -> tuple[Fraction, Fraction, Fraction]:
    gain, t, t2, l, ku, tu, kappa, wish = (Fraction(0) if math.isnan(x) else Fraction(x) for x in row)  # noqa: E741
    rule, pid, original = RULES[int(params["rule"])], params["pid"] == 1, params.get("original") == 1
    c = Fraction  # the coefficients are decimal fractions: c("0.35") is 7/20
    if rule == "ziegler_nichols_step":
        if pid:
            return c("1.2") / gain, 2 * l, l / 2
        return c("0.9") / gain, l / c("0.3") if original else 3 * l, c(0)
    if rule == "ziegler_nichols_frequency":
        if pid:
            return c("0.6") * ku, tu / 2, tu / 8
        return (c("0.45") * ku, tu / c("1.2"), c(0)) if original else (c("0.4") * ku, c("0.8") * tu, c(0))
    if rule == "lambda":
        if pid:
            return (t + l / 2) / (gain * (wish + l / 2)), t + l / 2, t * l / (2 * t + l)
        return t / (gain * (wish + l)), t, c(0)
    if rule == "lambda_integrating":
        return (2 * wish + l) / (gain * (wish + l) ** 2), 2 * wish + l, c(0)
    if rule == "amigo_step":
        if pid:
            ti, td = l * (c("0.4") * l + c("0.8") * t) / (l + t / 10), l * t / 2 / (c("0.3") * l + t)
            return (c("0.2") + c("0.45") * t / l) / gain, ti, td
        k = (c("0.15") + (c("0.35") - l * t / (l + t) ** 2) * t / l) / gain
        return k, c("0.35") * l + 13 * l * t**2 / (t**2 + 12 * l * t + 7 * l**2), c(0)
    if rule == "amigo_integrating":
        return (c("0.45") / (gain * l), 8 * l, l / 2) if pid else (c("0.35") / (gain * l), c("13.4") * l, c(0))
    if rule == "amigo_frequency":
        if pid:
            td = c("0.15") * (1 - kappa) * tu / (1 - c("0.95") * kappa)
            return (c("0.3") - c("0.1") * kappa**4) * ku, c("0.6") * tu / (1 + 2 * kappa), td
        return c("0.16") * ku, tu / (1 + c("4.5") * kappa), c(0)
    if rule == "point_placement":
        td = c("0.18148635890784376") * tu
        return c("0.3535533905932738") * ku, c("6.25") * td, td
    # SIMC: series form K'(1 + 1/sTi')(1 + sTd') multiplied out.
    reach = wish + l
    k, ti = (1 / (gain * reach), 4 * reach) if rule == "simc_integrating" else (t / (gain * reach), min(t, 4 * reach))
    return k * (ti + t2) / ti, ti + t2, ti * t2 / (ti + t2)


def tuning_cases() -> Iterator[dict[str, Any]]:
    """Each rule over processes of every kind, gains of both signs."""
    delays = [0.01, 0.2, 1.0, 1.42, 3.7, 40.0]

    def row(**given: float) -> list[float]:
        return [given.get(name, NAN) for name in TUNING_INPUTS]

    a = [row(gain=gain, l=l) for gain in (0.5, -1.7) for l in delays]  # noqa: E741
    u = [row(ku=ku, tu=tu) for ku in (4.0, -0.3) for tu in (6.28, 0.07, 300.0)]
    first = [row(gain=gain, t=t, l=l) for gain in (1.0, -2.3) for t in (0.05, 2.9, 17.0) for l in delays]  # noqa: E741
    wished = [[*x[:7], wish] for x in first for wish in (0.7, 9.0)]
    slow = [[*x[:7], wish] for x in a for wish in (0.7, 9.0)]
    kappas = [[*x[:6], kappa, NAN] for x in u for kappa in (0.0, 0.1, 0.25, 0.6, 0.95)]
    table = [row(gain=1.0, t=2.9, l=1.42)]
    for pid in (0, 1):
        name = "PID" if pid else "PI"
        yield case(f"Ziegler-Nichols step, {name}", [], {"rule": 0, "pid": pid}, a)
        yield case(f"Ziegler-Nichols frequency, {name}", [], {"rule": 1, "pid": pid}, u)
        yield case(f"Ziegler-Nichols step of 1942, {name}", ["Table"], {"rule": 0, "pid": pid, "original": 1}, a)
        yield case(f"Ziegler-Nichols frequency of 1942, {name}", ["Table"], {"rule": 1, "pid": pid, "original": 1}, u)
        yield case(f"Lambda, {name}", [], {"rule": 2, "pid": pid}, wished)
        yield case(f"AMIGO step, {name}", ["Coefficients"], {"rule": 4, "pid": pid}, first)
        yield case(f"AMIGO step of 1/(s + 1)^4, {name}", ["Coefficients"], {"rule": 4, "pid": pid}, table)
        yield case(f"AMIGO integrating, {name}", ["Coefficients"], {"rule": 5, "pid": pid}, a)
        yield case(f"AMIGO frequency, {name}", ["Coefficients"], {"rule": 6, "pid": pid}, kappas)
        lags = 0.03 if pid else 0.0
        yield case(f"SIMC, {name}", ["Series"], {"rule": 7, "pid": pid}, [[*x[:2], lags, *x[3:]] for x in wished])
        yield case(
            f"SIMC integrating, {name}", ["Series"], {"rule": 8, "pid": pid}, [[*x[:2], lags, *x[3:]] for x in slow]
        )
    yield case("Lambda integrating", [], {"rule": 3, "pid": 0}, slow)
    yield case("Ti = 6.25Td", ["Coefficients"], {"rule": 9, "pid": 1}, u)


def auto_tuner(params: Params, h: Sequence[float], samples: Sequence[Sequence[float]]) -> list[list[float]]:
    """Relay experiment; a third input is the output at which one is to begin."""
    tuner = _Relay(params)
    outputs = []
    for step, (pv, flags, start) in zip(h, samples, strict=True):
        if not math.isnan(start):
            tuner.start(start)
        op = tuner.update(pv, step, int(flags))
        outputs.append([op, tuner.phase, tuner.stop, tuner.relay_hysteresis, tuner.bias, *tuner.found])
    return outputs


class _Relay:
    """The experiment, with every sample of the cycle under way kept until the cycle is complete."""

    WAITING, BALANCED, BIASED, DONE, ABORTED = 1, 2, 3, 4, 5

    def __init__(self, params: Params) -> None:
        self.params = params
        self.most = abs(params["amplitude"])
        self.sign = 1.0 if params["amplitude"] > 0.0 else -1.0
        self.reach = self.most / 3.0
        self.step = 2.0 * self.reach
        self.phase = self.op = self.begin = 0
        self.start_anew(0.0, 0)

    def start_anew(self, op: float, phase: int) -> None:
        self.op = self.begin = op
        self.phase, self.stop = phase, 0
        self.relay_hysteresis = self.bias = self.t = self.half = self.period = self.centre = self.x = 0.0
        self.found = [NAN] * 4
        self.at_rest: list[tuple[float, float]] = []
        self.samples: list[tuple[float, float, float, float, bool]] = []
        self.alike: list[dict[str, float]] = []
        self.cycles = 0
        self.up, self.answered = True, False
        self.balance = (0.0, 0.0, 0.0)

    def start(self, op: float) -> None:
        self.start_anew(op, self.WAITING)
        if op - self.most < self.params["op_low"] or op + self.most > self.params["op_high"]:
            self.abort(4)

    def abort(self, stop: int) -> None:
        self.phase, self.stop, self.op = self.ABORTED, stop, self.begin

    def update(self, pv: float, h: float, flags: int) -> float:
        if self.phase in (self.WAITING, self.BALANCED, self.BIASED):
            stop = self.fault(pv, h, flags)
            if stop:
                self.abort(stop)
            elif self.phase == self.WAITING:
                self.rest(pv, h)
            else:
                self.swing(pv, h)
        return self.op

    def fault(self, pv: float, h: float, flags: int) -> int:
        p = self.params
        if flags & 2 or math.isnan(pv):
            return 1
        if flags & 16 or not 0.0 < h <= p["max_h"]:
            return 2
        if flags & 1:
            return 3
        if flags & (4 | 8):
            return 4
        if not p["pv_low"] <= pv <= p["pv_high"]:
            return 6 if self.went_wrong(self.sign * (pv - self.centre)) else 5
        return 9 if self.t + h > p["longest"] else 0

    def went_wrong(self, x: float) -> bool:
        return self.phase != self.WAITING and not self.answered and x < -self.relay_hysteresis

    def rest(self, pv: float, h: float) -> None:
        self.at_rest.append((h, pv))
        self.t += h
        if self.t < self.params["wait"]:
            return
        first = self.at_rest[0][1]
        away = [pv - first for _, pv in self.at_rest]
        self.centre = first + _sum(step * a for (step, _), a in zip(self.at_rest, away, strict=True)) / self.t
        self.relay_hysteresis = self.params.get("relay_hysteresis", 0.5 * (max(away) - min(away)))
        self.phase, self.x = self.BALANCED, self.sign * (pv - self.centre)
        self.push()

    def push(self) -> None:
        op = self.begin + (self.bias + self.step if self.up else self.bias - self.step)
        self.op = min(max(op, self.params["op_low"]), self.params["op_high"])

    def swing(self, pv: float, h: float) -> None:
        x = self.sign * (pv - self.centre)
        lost = 0.5 * self.params.get("d", 0.0)
        level = self.op - self.begin - lost if self.up else self.op - self.begin + lost
        self.samples.append((h, level, self.x, x, self.up))
        self.t += h
        self.half += h
        self.x = x
        if self.up and x > self.relay_hysteresis:
            self.up, self.answered, self.half = False, True, 0.0
        elif not self.up and x < -self.relay_hysteresis:
            self.up, self.half = True, 0.0
            self.complete()
        elif self.half > 0.25 * self.params["longest"]:
            self.abort(6 if self.went_wrong(x) else 7)
        if self.phase in (self.BALANCED, self.BIASED):
            self.push()

    def complete(self) -> None:
        """Look at the cycle that has just ended."""
        cycle = self.integrals()
        enough, known = cycle["samples"] >= 8, self.period > 0.0
        alike, self.alike, self.samples = self.alike, [], []
        self.period = cycle["t"]
        self.cycles += 1
        if self.cycles > 30:
            self.abort(8)
            return
        if not known or not enough or not _power(cycle) > 0.0:
            return
        if self.phase == self.BALANCED:
            bias = min(max(cycle["u"] / cycle["t"], -self.reach), self.reach)
            uneven = abs(cycle["up"] - (cycle["t"] - cycle["up"])) > 0.2 * cycle["t"]
            if uneven and abs(bias - self.bias) > 0.01 * self.most:
                self.bias = bias
                return
        if alike and self.agree(alike[0], cycle):
            self.alike = [*alike, cycle]
            self.period = _sum(one["t"] for one in self.alike[1:]) / len(alike)
        else:
            self.alike = [cycle]
        if len(self.alike) == 5:
            total = {key: _sum(one[key] for one in self.alike[1:]) for key in cycle}
            if self.phase == self.BALANCED:
                self.read_point(total)
            else:
                self.read_gain(total)

    def integrals(self) -> dict[str, float]:
        """Integrals of OP and PV, plain and with cos and sin at the middle of each step."""
        t = 0.0
        turns = []
        for h, *_ in self.samples:
            turns.append(min((t + 0.5 * h) / self.period, 2.0) - 0.5 if self.period > 0.0 else None)
            t += h
        circle = [(0.0, 0.0) if turn is None else _circle(turn) for turn in turns]
        u = [level * h for h, level, *_ in self.samples]
        y = [0.5 * (before + x) * h for h, _, before, x, _ in self.samples]
        return {
            "t": t,
            "samples": len(self.samples),
            "up": _sum(h for h, *_, up in self.samples if up),
            "u": _sum(u),
            "y": _sum(y),
            "u_cos": _sum(one * cos for one, (cos, _) in zip(u, circle, strict=True)),
            "u_sin": _sum(one * sin for one, (_, sin) in zip(u, circle, strict=True)),
            "y_cos": _sum(one * cos for one, (cos, _) in zip(y, circle, strict=True)),
            "y_sin": _sum(one * sin for one, (_, sin) in zip(y, circle, strict=True)),
        }

    def agree(self, a: dict[str, float], b: dict[str, float]) -> bool:
        power, moved = _power(a), b["y"] / b["t"] - a["y"] / a["t"]
        share = 0.15 + 3.0 / a["samples"]
        return (
            abs(b["t"] - a["t"]) <= share * a["t"]
            and (1.0 - share) * (1.0 - share) * power <= _power(b) <= (1.0 + share) * (1.0 + share) * power
            and moved * moved <= share * share * power
            and abs(b["u"] / b["t"] - a["u"] / a["t"]) <= 0.1 * self.most
        )

    def read_point(self, total: dict[str, float]) -> None:
        """P(iω) = Y/U with Y = y_cos − i·y_sin and U likewise."""
        u_cos, u_sin, y_cos, y_sin = (total[key] for key in ("u_cos", "u_sin", "y_cos", "y_sin"))
        re, im = y_cos * u_cos + y_sin * u_sin, y_cos * u_sin - y_sin * u_cos
        if not (re < 0.0 and abs(im / re) <= 0.5):
            self.abort(10)
            return
        ratio = (u_cos * u_cos + u_sin * u_sin) / (y_cos * y_cos + y_sin * y_sin)
        self.balance = (im / re, total["u"] / total["t"], total["y"] / total["t"])
        self.found = [self.sign * _root(ratio), self.period, NAN, NAN]
        self.bias = self.bias + (-self.reach if self.bias > 0.0 else self.reach)
        self.phase, self.cycles, self.alike, self.period = self.BIASED, 0, [], 0.0

    def read_gain(self, total: dict[str, float]) -> None:
        tangent, mean_u, mean_y = self.balance
        du, dy = total["u"] / total["t"] - mean_u, total["y"] / total["t"] - mean_y
        towards = 1.0 if self.bias > mean_u else -1.0
        if dy * towards > 0.1 * _root(4.0 * _power(total)):
            gain = abs(self.found[0])
            integrating = du / dy / gain < 0.05
            least = 0.0 if integrating else min(du / dy / gain, 1.0)
            c = tangent / (0.9 + 3.0 * least)
            ku = gain * (1.0 + 2.0 * (1.0 - least * least) * c)
            kp, kappa = (NAN, 0.0) if integrating else (self.sign * (dy / du), du / dy / ku)
            self.found = [self.sign * ku, self.found[1] * (1.0 - c), kp, kappa]
        self.phase, self.op = self.DONE, self.begin


def _power(cycle: dict[str, float]) -> float:
    """|Y|²/T²."""
    return (cycle["y_cos"] * cycle["y_cos"] + cycle["y_sin"] * cycle["y_sin"]) / (cycle["t"] * cycle["t"])


def _circle(turns: float) -> tuple[float, float]:
    """Give cos and sin of so many turns: Taylor's series of a quarter of the angle, doubled twice."""
    b = turns * (math.pi / 2.0)
    z = b * b
    cos = sin = 0.0
    for n in (10, 8, 6, 4, 2):
        cos = (-1.0) ** (n // 2) / math.factorial(n) + z * cos if cos else -1.0 / math.factorial(10)
    for n in (9, 7, 5, 3):
        sin = (-1.0) ** (n // 2) / math.factorial(n) + z * sin if sin else 1.0 / math.factorial(9)
    cos, sin = 1.0 + z * cos, b * (1.0 + z * sin)
    for _ in (1, 2):
        cos, sin = 1.0 - 2.0 * sin * sin, 2.0 * sin * cos
    return cos, sin


def _root(x: float) -> float:
    """Newton's root from above."""
    root = max(x, 1.0)
    while (following := 0.5 * (root + x / root)) < root:
        root = following
    return root


def auto_tuner_cases() -> Iterator[dict[str, Any]]:
    """Whole experiments on small processes, and every way in which one ends early."""
    usual = {"amplitude": 3.0, "wait": 4.0, "longest": 120.0, "max_h": 1.0}
    usual |= {"pv_low": -9.0, "pv_high": 9.0, "op_low": 0.0, "op_high": 10.0}
    lags = _Lags(1.0, 3)
    yield _experiment("three lags", [], usual, lags)
    yield _experiment("three lags with noise", ["Noise"], usual, lags, noise=0.04)
    yield _experiment("a gap of known width", ["Gap"], usual | {"d": 0.8}, lags)
    yield _experiment("given hysteresis", ["Hysteresis"], usual | {"relay_hysteresis": 0.1}, lags)
    yield _experiment("PV falls when OP rises", ["Sign"], usual | {"amplitude": -3.0}, _Lags(-1.0, 3))
    yield _experiment("a load that makes up shorter", ["Bias"], usual, lags, load=0.6)
    yield _experiment("a load beyond the bias' reach", ["Bias"], usual, lags, load=-1.5)
    yield _experiment(
        "integrating process", ["Integrating"], usual | {"longest": 250.0}, _Lags(0.3, 3, integrating=True)
    )
    steps = list(_walk(40, 700, low=0.1, high=0.3))
    yield _experiment("steps of any length", ["IrregularStep"], usual, lags, h=steps)
    yield _experiment("amplitude of the wrong sign", ["WrongSign"], usual | {"amplitude": -3.0}, lags)
    run_away = _Lags(0.3, 2, integrating=True)
    yield _experiment("wrong sign, out of bounds", ["WrongSign"], usual | {"amplitude": -3.0, "pv_low": -1.0}, run_away)
    yield _experiment("nothing answers", ["DeadLoop"], usual, _Lags(0.0, 3))
    yield _experiment("load beyond the relay's power", ["DeadLoop"], usual, lags, load=2.5)
    yield _experiment("sample time makes the cycle", ["NotRegular"], usual, _Lags(1.0, 1))
    yield _experiment("hysteresis makes the cycle", ["OffPoint"], usual | {"relay_hysteresis": 0.6}, _Lags(1.0, 1))
    yield _experiment("no time left", ["TimeBudget"], usual | {"longest": 20.0}, lags)
    yield _experiment("no time left for the gain", ["TimeBudget"], usual | {"longest": 42.0}, lags)
    yield _experiment("PV out of bounds", ["PvBounds"], usual | {"pv_high": 0.05}, lags)
    early = [[0.0, 0, 5.0], *[[0.1 * (i % 2), 0, NAN] for i in range(25)]]
    for comment, at in _FAULTS.items():
        ended = [list(row) for row in early]
        ended[23][:2] = [at.get("pv", 0.0), at.get("flags", 0)]
        h = [at.get("h", 0.2) if i == 23 else 0.2 for i in range(26)]
        yield case(comment, ["Fault"], usual, [*ended, [0.0, 0, 6.0], [0.0, 0, NAN]], [*h, 0.2, 0.2])
    near = [[0.0, 0, op] for op in (2.9, 7.1, 3.0)]
    yield case("begins near a limit", ["OpLimit"], usual, near, 0.2)
    yield case("before any start", ["Start"], usual, [[0.0, 0, NAN], [1.0, 0, NAN]], 0.2)


_FAULTS: dict[str, dict[str, Any]] = {
    "PV not a number": {"pv": NAN},
    "PV bad": {"flags": 2},
    "a gap": {"flags": 16},
    "time stands still": {"h": 0.0},
    "time runs backwards": {"h": -0.2},
    "a long step": {"h": 1.1},
    "manual": {"flags": 1},
    "OP at its lower limit": {"flags": 4},
    "OP at its upper limit": {"flags": 8},
    "PV too low": {"pv": -9.5},
    "everything at once": {"pv": 9.5, "flags": 31, "h": 0.0},
}


class _Lags:
    """Lags of 1 s in a row, or one less and an integrator, in steps of 10 ms."""

    def __init__(self, gain: float, order: int, integrating: bool = False) -> None:
        self.gain, self.order, self.integrating = gain, order, integrating

    def respond(self, x: list[float], v: float, h: float) -> None:
        for _ in range(round(h / 0.01)):
            for i in range(self.order):
                before = x[i - 1] if i else self.gain * v
                x[i] += 0.01 * (before if self.integrating and i == self.order - 1 else before - x[i])


def _experiment(
    comment: str, flags: list[str], params: Params, process: _Lags, h: Any = 0.2, noise: float = 0.0, load: float = 0.0
) -> dict[str, Any]:
    """Let the reference experiment on a process from OP = 5 on, a load from 5 s on; PV to five decimals."""
    tuner, random, x, t = _Relay(params), Random(41), [0.0] * process.order, 0.0
    rows: list[list[float]] = []
    steps = iter(h) if isinstance(h, list) else iter(lambda: h, None)
    op = valve = 5.0
    half_gap = 0.5 * params.get("d", 0.0)
    while tuner.phase < tuner.DONE:
        step = next(steps)
        pv = round(x[-1] + noise * (2.0 * random.random() - 1.0), 5)
        rows.append([pv, 0, NAN if rows else op])
        if len(rows) == 1:
            tuner.start(op)
        op = tuner.update(pv, step, 0)
        t += step
        valve = min(max(valve, op - half_gap), op + half_gap)
        process.respond(x, valve - 5.0 + (load if t > 5.0 else 0.0), step)
    rows.append([round(x[-1], 5), 0, NAN])
    return case(comment, flags, params, rows, h[: len(rows)] if isinstance(h, list) else h)


def auto_tuner_module(params: Params, h: Sequence[float], samples: Sequence[Sequence[float]]) -> list[list[float]]:
    """The relay in a loop: it stands between a controller and the parts after it, and gets backward signals."""
    module = _TunerModule(params)
    return [module.scan(step, *row) for step, row in zip(h, samples, strict=True)]


class _TunerModule:
    """A relay that has the output for the time of an experiment, and hands it on else."""

    def __init__(self, params: Params) -> None:
        self.relay = _Relay(dict(params))
        self.run, self.wish, self.back_flags = False, 0.0, 0

    def scan(
        self, h: float, x: float, pv: float, run: float, flags: float, tracking: float, amplitude: float
    ) -> list[float]:
        relay, refused = self.relay, 0
        if amplitude == 0.0 or abs(amplitude) > 1e30:
            refused = 26
        elif relay.params.get("d", 0.0) >= 4.0 * (abs(amplitude) / 3.0):
            refused = 28
        else:
            relay.most, relay.sign = abs(amplitude), math.copysign(1.0, amplitude)
            relay.reach = relay.most / 3.0
            relay.step = 2.0 * relay.reach
        if run != self.wish:
            self.wish, self.run = run, run == 1.0
        running = relay.phase in (relay.WAITING, relay.BALANCED, relay.BIASED)
        active, y = running or self.run, x
        if active:
            if not running and math.isnan(x):
                relay.start_anew(relay.op, relay.WAITING)
                relay.abort(1)
            elif not running:
                relay.start(x)
            bad = 2 if math.isnan(pv) else 0
            op = relay.update(pv, h, self.back_flags | (0 if self.run else 1) | bad)
            self.run = relay.phase in (relay.WAITING, relay.BALANCED, relay.BIASED)
            y = op if running or not math.isnan(x) else x
        self.back_flags = int(flags)
        if active and not self.back_flags & FLAG_NOT_AUTO:
            flags, tracking = flags + FLAG_NOT_AUTO, relay.op
        return [y, flags, tracking, relay.phase, relay.stop, refused, *relay.found]


def auto_tuner_module_cases() -> Iterator[dict[str, Any]]:
    """An experiment in a loop, its connections, settings that change on the way or are refused."""
    usual = {"amplitude": 3.0, "wait": 4.0, "longest": 120.0, "max_h": 1.0}
    usual |= {"pv_low": -9.0, "pv_high": 9.0, "op_low": 0.0, "op_high": 10.0}
    yield _tuner_loop(
        "an experiment, and the controller goes on", ["End"], usual, 400, end={i: {"x": 4.0} for i in range(360, 400)}
    )
    handed = {i: {"flags": 4.0 if i < 5 else 9.0, "tracking": 0.5 * i, "run": 0.0} for i in range(3, 9)}
    yield _tuner_loop("nothing runs", ["Handed"], usual, 12, end=handed | {i: {"run": 0.0} for i in (9, 10, 11)})
    yield _tuner_loop("ended by command", ["End"], usual, 60, end={i: {"run": 0.0} for i in range(50, 60)})
    yield _tuner_loop("begun again", ["End"], usual, 90, end={i: {"run": 0.0} for i in range(50, 60)})
    yield _tuner_loop("a limit reached further on", ["Told"], usual, 60, end={50: {"flags": 8.0}})
    yield _tuner_loop("somebody else at the output", ["Told"], usual, 60, end={50: {"flags": 1.0, "tracking": 7.0}})
    yield _tuner_loop("a limit further on before it begins", ["Told"], usual, 20, end={4: {"flags": 4.0}})
    yield _tuner_loop("PV bad for a scan", ["NotANumber"], usual, 60, end={50: {"pv": NAN}})
    yield _tuner_loop("no place to begin", ["NotANumber"], usual, 20, end={5: {"x": NAN}, 6: {"x": NAN}})
    yield _tuner_loop("the controller's output lost meanwhile", ["NotANumber"], usual, 40, end={20: {"x": NAN}})
    smaller = {i: {"amplitude": 2.0} for i in range(60, 420)}
    yield _tuner_loop("a smaller amplitude on the way", ["Changed"], usual, 420, end=smaller)
    turned = {i: {"amplitude": -3.0} for i in range(60, 120)}
    yield _tuner_loop("an amplitude of the other sign on the way", ["Changed"], usual, 120, end=turned)
    gap = usual | {"d": 0.8}
    values = {40: 0.0, 41: 1e31, 42: -1e31, 43: 0.5, 44: -0.6, 45: 2.5}
    refused = {i: {"amplitude": value} for i, value in values.items()}
    yield _tuner_loop("settings refused on the way", ["Refused", "Overflow"], gap, 90, end=refused)


def _tuner_loop(
    comment: str, flags: list[str], params: Params, n: int, end: dict[int, dict[str, float]]
) -> dict[str, Any]:
    """Let the reference experiment on three lags from scan 5 on; PV to five decimals."""
    module, process, x = _TunerModule(params), _Lags(1.0, 3), [0.0] * 3
    random = Random(79)
    rows = []
    for i in range(n):
        row = {"x": 5.0, "pv": round(x[-1] + 0.02 * (random.random() - 0.5), 5), "run": 1.0 if i >= 5 else 0.0}
        row |= {"flags": 0.0, "tracking": 0.0, "amplitude": params["amplitude"]} | end.get(i, {})
        rows.append(list(row.values()))
        y = module.scan(0.2, *rows[-1])[0]
        process.respond(x, 0.0 if math.isnan(y) else y - 5.0, 0.2)
    return case(comment, flags, params, rows, h=0.2)


TUNING_INPUTS = ("gain", "t", "t2", "l", "ku", "tu", "kappa", "wish")


def process_sim(params: Params, _h: Sequence[float], samples: Sequence[Sequence[float]]) -> list[float]:
    """Two lags and a dead time; a bad input or load leaves the last one in effect."""
    h = params["h"]
    delay = params.get("dead_time", 0.0) / h
    whole = int(delay + 1e-9)
    part = delay - whole if delay - whole > 1e-9 else 0.0
    share1, share2 = h / (params["t1"] + h), h / (params.get("t2", 0.0) + h)
    y1 = y2 = params.get("start", 0.0) / params["gain"]
    inputs = [y1] * (whole + 2)
    outputs = []
    for x, load in samples:
        outputs.append(params["gain"] * y2)
        inputs.append(x + load if math.isfinite(x) and math.isfinite(load) else inputs[-1])
        late = inputs[-1 - whole]
        w = late + (inputs[-2 - whole] - late) * part if part > 0.0 else late
        y1 += (w - y1) * share1
        y2 += (y1 - y2) * share2
    return outputs


def process_sim_cases() -> Iterator[dict[str, Any]]:
    """Lags, dead times in whole scans and parts of them, what is bad."""
    one = {"gain": 2.0, "t1": 3.0, "t2": 1.0, "h": 0.1}
    wander = [[x, 0.0] for x in _walk(41, 60)]
    yield case("two lags", [], one, wander)
    yield case("one lag, and no gain but the sign", ["ZeroTf"], {"gain": -1.0, "t1": 3.0, "h": 0.1}, wander)
    yield case("no lag at all", ["ZeroTf"], {"gain": 1.0, "t1": 0.0, "h": 0.1}, wander[:10])
    yield case("dead time of whole scans", ["DeadTime"], one | {"dead_time": 0.7}, wander)
    yield case("dead time between two scans", ["DeadTime"], one | {"dead_time": 0.25}, wander)
    yield case("dead time meant as a whole scan", ["DeadTime", "Rounding"], one | {"h": 0.3, "dead_time": 0.9}, wander)
    yield case("dead time of less than a scan", ["DeadTime"], one | {"dead_time": 0.03}, wander)
    yield case("begins at rest", ["Start"], one | {"start": 4.0, "dead_time": 0.5}, [[2.0, 0.0]] * 5 + wander[:20])
    yield case("load", ["Load"], one, [[x, 0.5 if i >= 10 else 0.0] for i, (x, _) in enumerate(wander)])
    bad = [list(row) for row in wander[:30]]
    bad[5][0] = bad[6][0] = bad[20][1] = NAN
    yield case("not a number", ["NotANumber"], one | {"dead_time": 0.2}, bad)


MOST = 1.7976931348623157e308
"""The largest double: no limit."""

BACK = [-MOST, MOST, 0.0, 0.0]
"""Lowest and highest value that is followed, flags, value in effect: every value is followed."""

MANUAL, AUTO, EXTERNAL = 0.0, 1.0, 2.0


def pid_module(params: Params, h: Sequence[float], samples: Sequence[Sequence[float]]) -> list[list[float]]:
    """The controller with modes, limits that move and bad values; the integral matters in automatic only."""
    gains = params["k"], params["ti"], params.get("td", 0.0)
    state = _Controller(params)
    return [state.scan(gains, MOST, step, *row) for step, row in zip(h, samples, strict=True)]


class _Controller:
    """State of the controller from scan to scan."""

    def __init__(self, params: Params) -> None:
        self.b, self.c, self.tf = params.get("b", 1.0), params.get("c", 0.0), params.get("tf", 0.0)
        self.own = params.get("low", -MOST), params.get("high", MOST)
        self.rate, self.max_h = params.get("rate", MOST), params.get("max_h", params["ti"] / 2.0)
        self.sign = math.copysign(1.0, params["k"])
        self.mode, self.sp = AUTO, 0.0
        self.output = self.manual = params.get("start", 0.0)
        self.ysp = self.yf = self.ff = self.integral = self.y_old = 0.0
        self.filter: tuple[float, float] | None = None
        self.back: Sequence[float] = BACK
        self.last: Any = None
        self.gains: tuple[float, ...] = ()

    def scan(
        self,
        gains: tuple[float, float, float],
        sp_rate: float,
        h: float,
        pv: float,
        sp: float,
        ff: float,
        mode: float,
        own_sp: float,
        manual: float,
        *back: float,
    ) -> list[float]:
        """Take one scan; a mode, own setpoint or manual value that is no number is left as it is."""
        self.mode = self.mode if math.isnan(mode) else mode
        self.sp = self.sp if math.isnan(own_sp) else own_sp
        self.manual = self.manual if math.isnan(manual) else manual
        error = self._take(h, pv, sp)
        ff_before, ysp_before = self.ff, self.ysp
        if math.isfinite(ff):
            self.ff = ff
        else:
            error |= 64
        low, high, flags, tracking = self.back
        limits = max(self.own[0], low), min(self.own[1], high)
        if not (low < high and limits[0] < limits[1]):
            limits, error = self.own, error | 128
        tracked = int(flags) & FLAG_NOT_AUTO != 0 and math.isfinite(tracking)
        by_hand, blind = tracked or self.mode == MANUAL, error & (FLAG_BAD | FLAG_GAP) != 0
        decided = self.mode, tracked, error & (FLAG_BAD | FLAG_GAP | 32 | 64)
        if by_hand:
            self.ysp = self.ysp if error & FLAG_BAD else self.yf
        elif not blind and error & 32 == 0:
            begin = self.yf if self.last is None else self.ysp
            self.ysp = max(min(self.sp, begin + sp_rate * h), begin - sp_rate * h)

        self.held_back = 0
        if tracked:
            self.output = tracking
        elif by_hand:
            self.output = _within(self.manual, *self._band(limits, 0, h))
        elif blind:
            self.output = _within(self.output, *limits)
        else:
            self.output = self._law(gains, limits, int(flags), h, ysp_before, ff_before, decided != self.last)
        self.last, self.gains = decided, (*gains, self.b)
        self.manual = self.manual if self.mode == MANUAL and not tracked else self.output
        self.back = back
        self.flags = FLAG_NOT_AUTO if by_hand or blind else 0
        self.flags |= (4 if self.output <= limits[0] else 0) | (8 if self.output >= limits[1] else 0) | self.held_back
        self.flags |= int(back[2]) & (FLAG_NOT_AUTO | 4 | 8)
        self.error = error
        return [self.output, self.ysp, self.yf, error, self.flags]

    def _take(self, h: float, pv: float, sp: float) -> int:
        """Setpoint and filtered process value; gives their errors."""
        error = 0 if 0.0 < h <= self.max_h else FLAG_GAP
        if self.mode == EXTERNAL:
            if math.isfinite(sp):
                self.sp = sp
            else:
                error |= 32
        if not math.isfinite(pv):
            self.filter = None
            return error | FLAG_BAD
        if self.filter is None or not h <= self.max_h:
            self.filter = pv, pv
        elif h > 0.0:
            share = h / (self.tf + h)
            first = self.filter[0] + (pv - self.filter[0]) * share
            self.filter = first, self.filter[1] + (first - self.filter[1]) * share
        self.yf = self.filter[1]
        return error

    def _band(self, limits: tuple[float, float], reported: int, h: float) -> tuple[float, float]:
        step = self.rate * h if h > 0.0 else 0.0
        down, up = 0.0 if reported & 4 else step, 0.0 if reported & 8 else step
        return _within(self.output - down, *limits), _within(self.output + up, *limits)

    def _law(
        self,
        gains: tuple[float, float, float],
        limits: tuple[float, float],
        reported: int,
        h: float,
        ysp_before: float,
        ff_before: float,
        changed: bool,
    ) -> float:
        k, ti, td = gains
        weighted = 0.0
        if changed:
            self.integral = self.output - self.ff - k * (self.b * self.ysp - self.yf)
            self.y_old = self.yf
        else:
            if self.gains != (*gains, self.b):
                self.integral = self.output - ff_before - k * (self.b * ysp_before - self.y_old)
            if self.c > 0.0 and td > 0.0:
                weighted = k * td / h * (self.c * (self.ysp - ysp_before))
        beyond = self.ff + weighted
        low, high = self._band(limits, reported, h)
        slope = k * td / h * (self.yf - self.y_old) if td > 0.0 else 0.0
        i = self.integral + k * h / ti * (self.ysp - self.yf)
        v = k * (self.b * self.ysp - self.yf) - slope + i
        u = _within(v, low - beyond, high - beyond)
        self.held_back = ((4 if u <= low - beyond else 0) | (8 if u >= high - beyond else 0)) & ~reported
        self.integral = i + (u - v) * (h / (ti + h))
        self.y_old = self.yf
        return _within(u + beyond, low, high)


def _within(x: float, low: float, high: float) -> float:
    return min(max(x, low), high)


def pid_module_cases() -> Iterator[dict[str, Any]]:
    """Modes, errors, backward limits, rate, feed-forward and weights."""
    pi = {"k": 0.8, "ti": 5.0, "start": 0.3}
    full = {"k": 1.1, "ti": 2.4, "td": 0.6, "b": 0.5, "c": 0.7, "tf": 0.2, "low": -0.8, "high": 1.2, "start": 0.3}
    ys = list(_walk(51, 60))
    keep = [NAN, NAN, NAN]

    def rows(**changes: dict[int, float]) -> list[list[float]]:
        names = ["pv", "sp", "ff", "mode", "own_sp", "manual", "low", "high", "flags", "tracking"]
        made = [[y, 1.0 if i >= 30 else 0.2, 0.0, *keep, *BACK] for i, y in enumerate(ys)]
        made[0][3] = EXTERNAL
        for name, values in changes.items():
            for i, value in values.items():
                made[i][names.index(name)] = value
        return made

    yield case("PI", [], pi, rows(), h=0.1)
    yield case("PI, direct-acting", ["Sign"], pi | {"k": -0.8}, rows(), h=0.1)
    yield case("PID with everything", [], full, rows(), h=0.1)
    yield case("steps of any length", ["IrregularStep"], full, rows(), h=list(_walk(52, 60, low=0.01, high=0.5)))
    own = rows(mode={0: AUTO}, own_sp={0: 0.5, 20: -0.5})
    yield case("own setpoint", ["Mode"], full, own, h=0.1)
    modes = rows(mode={0: EXTERNAL, 10: MANUAL, 20: AUTO, 30: EXTERNAL, 40: MANUAL, 50: EXTERNAL}, manual={12: 0.9})
    yield case("through all modes", ["Mode", "Bump"], full, modes, h=0.1)
    yield case("begins in manual", ["Mode", "Start"], full, rows(mode={0: MANUAL, 5: EXTERNAL}, manual={0: 0.7}), h=0.1)
    beyond = rows(mode={10: MANUAL, 20: EXTERNAL}, manual={10: 9.0})
    yield case("manual beyond the limits", ["Mode", "Limits"], full, beyond, h=0.1)
    bad = rows(pv={5: NAN, 6: NAN, 33: NAN}, sp={15: NAN, 16: NAN}, ff={25: NAN, 26: 0.4, 27: 0.4})
    yield case("what is not a number", ["NotANumber", "Bump"], full, bad, h=0.1)
    yield case("not a number at the start", ["NotANumber", "Start"], full, rows(pv={0: NAN, 1: NAN}), h=0.1)
    jumps = [0.0 if i in (7, 8) else 9.0 if i == 20 else 0.1 for i in range(60)]
    yield case("time that jumps and stands still", ["Gap", "Bump"], full, rows(), h=jumps)
    yield case("a rate", ["Rate"], full | {"rate": 0.5}, modes, h=0.1)
    fed = rows(ff={i: 0.3 if i % 20 < 10 else -0.3 for i in range(60)}, flags={i: 8.0 for i in range(10, 16)})
    yield case(
        "a rate, with feed-forward, and a limit further on", ["Rate", "Limits"], full | {"rate": 2.0}, fed, h=0.1
    )
    feed = rows(ff={i: 0.3 if i % 20 < 10 else -0.3 for i in range(60)})
    yield case("feed-forward", ["FeedForward"], full, feed, h=0.1)
    reported = rows(flags={i: 8.0 if i < 20 else 4.0 for i in range(5, 40)})
    yield case("limits reported further on", ["Limits"], full, reported, h=0.1)
    narrow = rows(low={i: 0.0 for i in range(5, 30)}, high={i: 0.5 for i in range(5, 30)})
    yield case("narrower limits told backward", ["Limits"], full, narrow, h=0.1)
    cross = rows(low={i: 0.7 for i in range(5, 30)}, high={i: 0.1 for i in range(5, 20)})
    yield case("limits that cross", ["Limits"], full, cross, h=0.1)
    not_followed = rows(flags={i: 1.0 for i in range(5, 25)}, tracking={i: 2.0 for i in range(5, 15)} | {20: NAN})
    yield case("not followed", ["Tracking", "Bump"], full, not_followed, h=0.1)
    by_hand = rows(
        mode={0: EXTERNAL, 8: MANUAL}, flags={i: 1.0 for i in range(5, 25)}, tracking={i: 0.1 * i for i in range(5, 25)}
    )
    yield case("not followed, and put into manual meanwhile", ["Tracking", "Bump", "Mode"], full, by_hand, h=0.1)


def _on_line(
    block: Callable[[Params, Iterable[tuple[float, Sequence[float]]]], Iterator[Any]], params: Params
) -> Callable[[float, Sequence[float]], Any]:
    """A block that takes one sample after the other."""
    given: deque[tuple[float, Sequence[float]]] = deque()
    outputs = block(params, iter(given.popleft, None))

    def scan(step: float, sample: Sequence[float]) -> Any:
        given.append((step, sample))
        return next(outputs)

    return scan


class _Detection:
    """Detector, compensation and warnings on line: what ends a half-period is found anew from all samples so far."""

    def __init__(self, params: Params, k: float, ti: float, td: float | None, tf: float) -> None:
        given = {name: params[name] for name in ("kp",) if name in params}
        limits = {}
        if "low" in params and "high" in params:
            low, high = params["low"], params["high"]
            limits = {"op_low": low, "op_high": high, "op_span": high - low}
        known = {} if td is None else {"td": td}
        own = {"k": k, "ti": ti, "b": params.get("b", 1.0), "tf": tf, "n": params.get("n", 9.0), "op_known": 1.0}
        limits |= {"op_span": params["op_span"]} if "op_span" in params else {}
        spanned = "pv_span" in params and "op_span" in params
        if spanned and "kp" not in params:
            given = {"kp": math.copysign(1.5 * (params["pv_span"] / params["op_span"]), k)}
        self.unfit = (spanned and "kp" not in params) or max(tf, params.get("tf", 0.0)) > 0.5 * ti
        self.params = own | given | known | limits | {"max_h": params["ti"] / 2.0}
        self.size = params.get("comp_size", 0.0)
        self.by_estimate = params.get("comp_source", 1.0) == 3.0
        self.compensates = self.size > 0.0 or self.by_estimate
        renamed = {name.removeprefix("comp_"): value for name, value in params.items() if name.startswith("comp_")}
        usual = {"way": 3.0, "share": 1.0, "band": self.size / 5.0, "tf": 0.0, "release": ti, "withdraw": 1.0}
        usual |= {"watch": 300.0 * ti}
        usual |= {"rate": self.size / (ti / 10.0) if self.size > 0.0 else MOST, "travel": MOST, "reversals": MOST}
        usual |= {"size": 0.0, "limit": MOST, "ramp_time": ti / 10.0} if self.by_estimate else {"size": self.size}
        room = {"low": params["low"], "high": params["high"]} if limits else {}
        self.compensation = usual | renamed | room | {"k": k}
        self.h: list[float] = []
        self.samples: list[list[float]] = []
        self.raw: list[float] = []
        self.halves: list[list[float]] = []
        self.widths: list[float] = []
        self.shown, self.noise_floor, self.over, self.due = [NAN, 0.0], NAN, [0, 0], False
        self.limits = {"low": params["low"], "high": params["high"]} if limits else {}
        self.compensate = _on_line(_compensation, self.compensation)
        self.runs_away = _on_line(_wrong_sign, self.params | self.limits)
        self.against, self.error = 0, 0
        self.u_ff = self.half = self.delta = self.yf = 0.0
        self.smooth = _smoother(self.params["tf"])
        self.standing = 1

    def learn(
        self,
        h: float,
        sp: float,
        pv: float,
        raw: float,
        sent: float,
        op: float,
        flags: int,
        enable: bool,
        beside: float = NAN,
        hindered: float = NAN,
        begin: float = NAN,
    ) -> None:
        """One sample, with the output as it is sent and the controller's own; `beside`: PV for all but the detector.

        What the last half-period means for the compensation comes in the scan after it.
        """
        if self.due:
            delta_t, delta_y, delta_sp, mask, d, size, against = self.last
            if delta_t > 3.0 * self.params["ti"] and mask & 0b10001111 == 0:
                self.against = self.against + 1 if against else 0
            if self.compensates:
                self.halves.append([delta_t, delta_y, delta_sp, mask & 15, size])
                self.over = over_compensation(self.params, [h] * len(self.halves), self.halves)[-1]
                self.widths += [d + size] if mask == 0 else []
        flags |= 0 if math.isfinite(sp) and math.isfinite(pv) else FLAG_BAD
        self.h.append(h)
        self.samples.append([sp, pv, op, flags])
        self.raw.append(raw)
        ends = any(
            index == len(self.h) - 1
            for index, *_ in _ended(self.params, _stretches(self.params, self.h, self.samples)[-2:])
        )
        record = detector(self.params, self.h, self.samples, self.raw)[-1] if ends else None
        self.due = record is not None
        if record is not None:
            found = dict(zip(DETECTION_FIELDS, record, strict=True))
            self.noise_floor = found["noise_floor"]
            hidden = math.isnan(found["d_hat"])
            self.shown = [found["d_hat"], 0.0 if hidden else found["detections"]]
            parts = [found[name] for name in ("delta_t", "delta_y", "delta_sp")]
            against = found["op_travel"] + found["delta_u"] / 2.0 < 0.0
            self.last = (*parts, int(found["mask"]), found["d"], self.half + self.half, against)
        yf = self.filtered(h, [sp, pv, op], flags)
        yf = yf if math.isnan(beside) else beside
        wrong = self.limits and self.runs_away(h, [sp, yf, sent, flags])
        self.error = 256 if wrong or self.against >= 3 else 0
        if self.compensates:
            flags |= FLAG_LIMIT if self.error else 0
            fit = NAN if self.unfit else self.whole()
            full = len(self.widths) >= int(self.params["n"]) and not self.whole() < self.noise_floor
            offered = fit if self.by_estimate and full else NAN
            row = [sp - yf, op, fit, self.over[1], enable, flags, offered, hindered, begin]
            self.u_ff, self.half, self.standing, self.delta = self.compensate(h, row)

    def filtered(self, h: float, values: list[float], flags: int) -> float:
        """PV as the detector filters it: anew after what cannot be used, and after a gap in time."""
        known = all(map(math.isfinite, values)) and flags & FLAG_BAD == 0
        late = len(self.h) > 1 and h != 0.0 and not 0.0 < h <= self.params["max_h"]
        if late or not known:
            self.smooth = _smoother(self.params["tf"])
        if known and (h > 0.0 or len(self.h) == 1):
            self.yf = self.smooth(values[1], h)[0]
        return self.yf

    def whole(self) -> float:
        """The whole gap."""
        return _shown(self.widths[-int(self.params["n"]) :])[0] if self.widths else NAN

    def all(self) -> list[float]:
        """All outputs."""
        whole = NAN if self.whole() < self.noise_floor else self.whole()
        over = self.over[0] + 2 * self.over[1]
        return [self.u_ff, *self.shown, self.noise_floor, whole, self.standing, over, self.error]


def backlash_detection(params: Params, h: Sequence[float], samples: Sequence[Sequence[float]]) -> list[list[float]]:
    """The detection beside a controller, which reports the value in effect."""
    gains = params["k"], params["ti"], params.get("td", 0.0)
    controller = _Controller(params)
    detector_k = {"k": params.get("detector_k", params["k"])}
    detection = _Detection(params | detector_k, detector_k["k"], *gains[1:], tf=params["detector_tf"])
    outputs = []
    for step, (pv, sp, mode, manual, flags, enable) in zip(h, samples, strict=True):
        u_ff = detection.u_ff
        u = controller.scan(gains, MOST, step, pv, sp, u_ff, mode, NAN, manual, -MOST, MOST, flags, 0.0)[0]
        flags = controller.flags | (0 if controller.mode == EXTERNAL else FLAG_NOT_AUTO)
        detection.learn(step, sp, pv, pv, u, u - u_ff, flags, enable != 0)
        outputs.append([u, *detection.all()])
    return outputs


class _Foreign:
    """The detection beside a controller that is not ours: everything is read, and u_FF comes late."""

    def __init__(self, params: Params) -> None:
        self.params = params
        self.detection = _Detection(params, params["k"], params["ti"], 0.0, tf=params["detector_tf"])
        self.detection.compensates = True
        self.delay = int(params["delay"])
        self.tolerance = params.get("tolerance", params.get("comp_size", 0.0) / 10.0)
        self.most = params["longest"] * params["ti"]
        self.handed, self.known, self.off = [0.0] * 32, False, 0

    def scan(
        self, step: float, pv: float, sp: float, op: float, flags: float, back: float, enable: float
    ) -> list[float]:
        params, delay = self.params, self.delay
        lost = not math.isfinite(op) or (params["read_back"] == 1.0 and not math.isfinite(back))
        flags = int(flags) | (2 if lost else 0)
        if "low" in params:
            flags |= (4 if op <= params["low"] else 0) | (8 if op >= params["high"] else 0)
        self.known = self.known and step <= self.detection.params["max_h"]
        begin, asked = NAN, self.handed[-delay]
        wrong = abs(back - asked) > self.tolerance
        if not math.isfinite(back):
            self.known, self.off = False, 0
        elif wrong and not self.known:
            begin, self.handed, self.known, self.off = back, [back] * 32, True, 0
        else:
            self.known, self.off = True, self.off + 1 if wrong and flags & 3 == 0 else 0
        hindered = 13.0 if self.off > delay else 12.0 if delay > 1 and step * delay > self.most else NAN
        effect = back if math.isfinite(back) else asked
        self.detection.learn(step, sp, pv, pv, op, op - effect, flags, enable != 0, hindered=hindered, begin=begin)
        self.handed.append(self.detection.u_ff)
        return [*self.detection.all(), self.detection.delta]


def foreign_detection(params: Params, h: Sequence[float], samples: Sequence[Sequence[float]]) -> list[list[float]]:
    """Everything that it shows, scan by scan."""
    beside = _Foreign(params)
    return [beside.scan(step, *row) for step, row in zip(h, samples, strict=True)]


def pid_advanced(params: Params, h: Sequence[float], samples: Sequence[Sequence[float]]) -> list[list[float]]:
    """The controller with the detection inside, a ramp of the setpoint, and gains by a schedule."""
    rows = [[params[f"{name}{i}"] for name in ("at", "k", "ti", "td")] for i in range(1, 9) if f"at{i}" in params]
    k, ti, td = params["k"], params["ti"], params.get("td", 0.0)
    controller = _Controller(params)
    widest = max((row[1] for row in rows), key=abs, default=k)
    slowest = max((row[2] for row in rows), default=ti)
    damping = max((row[3] for row in rows), default=td)
    usual = damping / 5.0 if damping > 0.0 else slowest / 10.0
    tf = params.get("detector_tf", 0.0 if controller.tf > 0.0 else usual)
    detection = _Detection(params, widest, slowest, None if rows else td, tf)
    pvs: list[float] = []
    detection.compensation["rate"] = min(detection.compensation["rate"], controller.rate / 2.0)
    by, outputs = 0.0, []
    for step, (pv, sp, given, mode, manual, flags, enable) in zip(h, samples, strict=True):
        by = given if math.isfinite(given) else by
        gains = _scheduled(rows, by) if rows else (k, ti, td)
        back = -MOST, MOST, flags, 0.0
        rate = params.get("sp_rate", MOST)
        u = controller.scan(gains, rate, step, pv, sp, 0.0 + detection.u_ff, mode, NAN, manual, *back)[0]
        sent = (u - controller.ff) + detection.u_ff
        pvs.append(pv)
        seen, beside = controller.yf if controller.tf > 0.0 else pv, NAN
        if "detector_tf" in params:
            steps = [0.0, *h[1 : len(pvs)]]
            beside, seen = seen if controller.tf > 0.0 else filter_({"tf": usual}, steps, pvs)[-1], pv
        op = sent - detection.u_ff
        detection.learn(step, controller.ysp, seen, pv, sent, op, controller.flags, enable != 0, beside)
        outputs.append([u, controller.ysp, *detection.all()])
    return outputs


def pid_settings(params: Params, h: Sequence[float], samples: Sequence[Sequence[float]]) -> list[list[float]]:
    """Outputs of a controller whose settings change on the way; those out of bounds do not act."""
    controller = _Controller(params)
    gains = params["k"], params["ti"], 0.0
    detection = _Detection(params, *gains, tf=0.0)
    at_most, outputs = MOST, []
    for step, (pv, sp, sp_rate, rate) in zip(h, samples, strict=True):
        refused = 0 if sp_rate > 0.0 else 36
        if not refused:
            refused = 0 if rate > 0.0 else 18
        if not refused:
            at_most, controller.rate = sp_rate, rate
        mode = NAN if outputs else EXTERNAL
        u = controller.scan(gains, at_most, step, pv, sp, 0.0, mode, NAN, NAN, *BACK)[0]
        detection.learn(step, controller.ysp, controller.yf, pv, u, u, controller.flags, False)
        outputs.append([u, controller.ysp, refused, *detection.shown])
    return outputs


def pid_tuner(params: Params, h: Sequence[float], samples: Sequence[Sequence[float]]) -> list[list[float]]:
    """The controller with the autotuner inside."""
    loop = _TunedPid(params)
    return [loop.scan(step, *row) for step, row in zip(h, samples, strict=True)]


class _TunedPid:
    """A controller, and between it and its output a relay that has it for the time of an experiment."""

    def __init__(self, params: Params) -> None:
        self.params, self.controller = params, _Controller(params)
        self.gains = params["k"], params["ti"], params.get("td", 0.0)
        limits = {"op_low": params["low"], "op_high": params["high"], "max_h": params["ti"] / 2.0}
        self.relay = _Relay(params | limits)
        self.run, self.back_flags = False, 0

    def scan(self, h: float, pv: float, sp: float, mode: float, flags: float, tune: float, take: float) -> list[float]:
        """Take one scan; a mode or a command that is no number is none."""
        relay, controller = self.relay, self.controller
        if take == 1.0:
            ku, tu, _, kappa = relay.found
            self.gains = 0.16 * ku, tu / (1.0 + 4.5 * kappa), 0.0
        self.run = self.run if math.isnan(tune) else tune == 1.0
        u = controller.scan(self.gains, MOST, h, pv, sp, 0.0, mode, NAN, NAN, *BACK)[0]
        running = relay.phase in (relay.WAITING, relay.BALANCED, relay.BIASED)
        active = running or self.run
        if active:
            if not running:
                relay.start(u)
            swing = 4.0 * (relay.most / 3.0)
            slow = 12 if controller.rate * h < swing else 0
            by_hand = 1 if controller.mode == MANUAL or not self.run else 0
            bad = 2 if math.isnan(pv) else 0
            u = relay.update(pv, h, self.back_flags | slow | by_hand | bad)
            self.run = relay.phase in (relay.WAITING, relay.BALANCED, relay.BIASED)
        self.back_flags = int(flags)
        followed = not active or self.back_flags & FLAG_NOT_AUTO
        controller.back = (
            (-MOST, MOST, flags, 0.0) if followed else (-MOST, MOST, self.back_flags | FLAG_NOT_AUTO, relay.op)
        )
        return [u, controller.ysp, relay.phase, relay.stop, *relay.found, *self.gains]


def pid_tuner_cases() -> Iterator[dict[str, Any]]:
    """An experiment to its end and its offer taken over, and every way in which the controller ends one."""
    inside = {"k": 1.2, "ti": 4.0, "low": 0.0, "high": 10.0, "start": 5.0, "amplitude": 3.0, "wait": 4.0}
    inside |= {"longest": 120.0, "pv_low": -9.0, "pv_high": 9.0}
    yield _tuned_loop("an experiment, taken over, and a step of the setpoint", ["Taken", "Bump"], inside, 640, take=520)
    yield _tuned_loop("ended by command", ["End", "Bump"], inside, 90, end={60: {"tune": 0.0}})
    manual = {60: {"mode": MANUAL}, 75: {"mode": EXTERNAL}}
    yield _tuned_loop("put into manual meanwhile", ["End", "Bump"], inside, 90, end=manual)
    yield _tuned_loop("PV bad for a scan", ["End", "Bump"], inside, 90, end={60: {"pv": NAN}})
    yield _tuned_loop("a limit reached further on", ["End", "Bump"], inside, 90, end={60: {"flags": 8.0}})
    yield _tuned_loop("somebody else at the output", ["End", "Bump"], inside, 90, end={60: {"flags": 1.0}})
    yield _tuned_loop("a rate too low for the relay", ["End"], inside | {"rate": 19.0}, 40)
    yield _tuned_loop("begun in manual", ["End"], inside, 40, end={0: {"mode": MANUAL}})


def _tuned_loop(
    comment: str,
    flags: list[str],
    params: Params,
    n: int,
    take: int = -1,
    end: dict[int, dict[str, float]] | None = None,
) -> dict[str, Any]:
    """Let the reference control three lags; PV to five decimals, begun in scan 10."""
    loop, process, x = _TunedPid(params), _Lags(1.0, 3), [0.0] * 3
    random = Random(73)
    rows = []
    for i in range(n):
        row = {"pv": round(x[-1] + 0.02 * (random.random() - 0.5), 5), "sp": 0.5 if i > take > 0 else 0.0}
        row |= {"mode": NAN if i else EXTERNAL, "flags": 0.0, "tune": 1.0 if i == 10 else NAN}
        row |= {"take": 1.0 if i == take else 0.0} | (end or {}).get(i, {})
        rows.append(list(row.values()))
        process.respond(x, loop.scan(0.2, *rows[-1])[0] - 5.0, 0.2)
    return case(comment, flags, params, rows, h=0.2)


def _scheduled(rows: list[list[float]], by: float) -> tuple[float, float, float]:
    above = sum(row[0] <= by for row in rows)
    low, high = rows[max(above - 1, 0)], rows[min(above, len(rows) - 1)]
    share = (by - low[0]) / (high[0] - low[0]) if high[0] > low[0] else 0.0
    k, ti, td = (a + (b - a) * share for a, b in zip(low[1:], high[1:], strict=True))
    return k, ti, td


def _swinging(n: int, half: int) -> list[float]:
    """PV nearly square around 50, in noise."""
    random = Random(61)
    return [50.0 + (1.0 if i // half % 2 else -1.0) + 0.3 * (random.random() - 0.5) for i in range(n)]


def backlash_detection_cases() -> Iterator[dict[str, Any]]:
    """Detections, flags that reject them, and compensation by them."""
    beside = {"k": 0.5, "ti": 1.0, "detector_tf": 0.1, "kp": 2.0, "n": 3.0, "start": 50.0}
    limited = beside | {"low": 0.0, "high": 100.0}
    compensating = limited | {"comp_size": 1.5, "comp_band": 0.1, "comp_rate": 3.0}
    pvs = _swinging(220, 24)

    def rows(**changes: dict[int, float]) -> list[list[float]]:
        names = ["pv", "sp", "mode", "manual", "flags", "enable"]
        made = [[pv, 50.0, NAN, NAN, 0.0, 0.0] for pv in pvs]
        made[0][2] = EXTERNAL
        for name, values in changes.items():
            for i, value in values.items():
                made[i][names.index(name)] = value
        return made

    yield case("detections", [], beside, rows(), h=0.25)
    yield case("K below 0", ["Sign"], beside | {"k": -0.5}, rows(), h=0.25)
    limits = rows(flags={60: 8.0, 110: 4.0}, mode={0: EXTERNAL, 150: AUTO, 155: EXTERNAL})
    yield case("flags of the scan in which they are told", ["Flags"], limited, limits, h=0.25)
    on = {i: 1.0 for i in range(30, 220)}
    yield case("compensation", ["Compensation"], compensating, rows(enable=on), h=0.25)
    yield case("compensation by the error", ["Compensation"], compensating | {"comp_way": 1.0}, rows(enable=on), h=0.25)
    by_hand = rows(enable=on, mode={0: EXTERNAL, 120: MANUAL, 130: EXTERNAL}, manual={122: 60.0})
    yield case("compensation, manual in between", ["Compensation", "Flags"], compensating, by_hand, h=0.25)
    yield case("compensation beside a PID", ["Compensation"], compensating | {"td": 0.2}, rows(enable=on), h=0.25)
    other = compensating | {"comp_way": 1.0, "detector_k": -0.5}
    yield case("told a gain of the other sign", ["Sign", "WrongSign"], other, rows(enable=on), h=0.25)


def foreign_detection_cases() -> Iterator[dict[str, Any]]:
    """A delay, a value that is read back, and everything that can be lost."""
    beside = {
        "k": 0.5,
        "ti": 1.0,
        "detector_tf": 0.1,
        "kp": 2.0,
        "n": 3.0,
        "delay": 1.0,
        "longest": 9.0,
        "read_back": 0.0,
    }
    sized = beside | {"comp_size": 1.5, "comp_band": 0.1, "comp_rate": 3.0}
    pvs = _swinging(200, 24)

    def theirs(
        params: Params, truly: int, enable: Callable[[int], float], h: Sequence[float] = (), **changes: dict[int, float]
    ) -> list[list[float]]:
        """Signals read of a PI controller that truly has u_FF `truly` scans after it was made."""
        made: list[list[float]] = []
        names = ["pv", "sp", "op", "flags", "back", "enable"]
        integral, handed, beside = 50.0, [0.0] * truly, _Foreign(params)
        for i, pv in enumerate(pvs):
            e = 50.0 - pv
            integral += 0.25 * params["k"] / params["ti"] * e
            u_ff = handed[-truly]
            row = [pv, 50.0, params["k"] * e + integral + u_ff, 0.0, u_ff if params["read_back"] else NAN, enable(i)]
            for name, values in changes.items():
                row[names.index(name)] = values.get(i, row[names.index(name)])
            made.append(row)
            handed.append(beside.scan(h[i] if h else 0.25, *row)[0])
        return made

    def from_30(i: int) -> float:
        return float(i >= 30)

    def one(comment: str, marks: list[str], params: Params, truly: int, **changes: dict[int, float]) -> dict[str, Any]:
        return case(comment, marks, params, theirs(params, truly, from_30, **changes), h=0.25)

    yield one("a scan late", [], sized, 1)
    yield one("three scans late", ["Delay"], sized | {"delay": 3.0}, 3)
    back = sized | {"delay": 3.0, "read_back": 1.0}
    yield one("three scans late, and read back", ["Delay"], back, 3)
    yield one("too late", ["Delay", "Edge"], sized | {"delay": 3.0, "longest": 0.7}, 3)
    yield one("just in time", ["Delay", "Edge"], sized | {"delay": 3.0, "longest": 0.75}, 3)
    yield one("a scan is never too late", ["Delay"], sized | {"longest": 0.1}, 1)
    lost = {i: NAN for i in range(100, 110)}
    yield one("OP is lost for a while", ["Loss"], sized, 1, op=lost)
    yield one("what is read back is lost for a while", ["Loss"], back, 3, back=lost)
    yield one("PV is lost for a while", ["Loss"], back, 3, pv=lost)
    yield one("communication is lost for a while", ["Loss"], back, 3, flags={i: 2.0 for i in range(100, 110)})
    yield one("manual for a while", ["Loss"], back, 3, flags={i: 1.0 for i in range(100, 110)})
    yield one("at a limit that is told", ["Loss"], sized, 1, flags={i: 8.0 for i in range(100, 104)})
    yield one("at a limit that is seen", ["Loss"], sized | {"low": 0.0, "high": 51.5}, 1)
    held = {i: 0.6 for i in range(4)}
    yield one("u_FF is held from before", ["Start"], back, 3, back=held)
    yield one(
        "u_FF is held from before, and nothing is to be compensated",
        ["Start"],
        beside | {"read_back": 1.0},
        1,
        back=held,
    )
    after = lost | {i: -0.5 for i in range(110, 113)}
    yield one("u_FF is another after it was lost", ["Start", "Loss"], back, 3, back=after)
    other = {i: 0.1 for i in range(100, 140)}
    yield one("somebody else sets u_FF", ["NotFollowed"], back, 3, back=other)
    yield one(
        "somebody else sets u_FF, within the tolerance", ["NotFollowed"], back | {"tolerance": 2.0}, 3, back=other
    )
    yield one("later than it says, but for moments", ["NotFollowed"], back, 4)
    yield one("much later than it says", ["NotFollowed", "Delay"], back | {"delay": 1.0, "comp_way": 1.0}, 9)
    again = theirs(back, 3, lambda i: float(i >= 30 and i != 150), back=other)
    yield case("enabled anew when it is followed again", ["NotFollowed"], back, again, h=0.25)
    estimate = beside | {"comp_source": 3.0, "comp_band": 0.0, "delay": 2.0, "tolerance": 0.01, "read_back": 1.0}
    yield case("the estimate", ["Source"], estimate, theirs(estimate, 2, lambda i: float(i >= 140)), h=0.25)
    early = theirs(estimate, 2, lambda i: float(i >= 70))
    yield case("an estimate of too few detections", ["Source"], estimate, early, h=0.25)
    low = estimate | {"kp": 0.3}
    yield case("an estimate below the noise limit", ["Source"], low, theirs(low, 2, lambda i: float(i >= 140)), h=0.25)
    gap = [9.0 if i == 120 else 0.0 if i == 130 else 0.25 for i in range(200)]
    rows = theirs(back, 3, from_30, gap, back={i: 0.3 for i in range(120, 124)})
    yield case("a gap in time, and u_FF is another", ["Start"], back, rows, h=gap)


def pid_advanced_cases() -> Iterator[dict[str, Any]]:
    """Cases of the controller with detection and compensation inside, with ramp and schedule."""
    inside = {"k": 0.5, "ti": 1.0, "kp": 2.0, "n": 3.0, "start": 50.0}
    limited = inside | {"low": 0.0, "high": 100.0, "tf": 0.1}
    compensating = limited | {"comp_size": 1.5, "comp_band": 0.1, "comp_rate": 3.0}
    pvs = _swinging(220, 24)
    on = [0.0] * 30 + [1.0] * 190
    plain = [[pv, 50.0, 0.0, EXTERNAL if i == 0 else NAN, NAN, 0.0, on[i]] for i, pv in enumerate(pvs)]
    yield case("detections; the detector filters", [], inside, plain, h=0.25)
    yield case("detections in a PID; the detector filters", ["FilterTime"], inside | {"td": 0.2}, plain, h=0.25)
    yield case("detections; the controller filters", [], limited, plain, h=0.25)
    yield case("PID", [], limited | {"td": 0.2, "b": 0.3}, plain, h=0.25)
    yield case("compensation", ["Compensation"], compensating, plain, h=0.25)
    yield case("compensation in a PID", ["Compensation"], compensating | {"td": 0.2}, plain, h=0.25)
    yield case("compensation within a rate", ["Compensation", "Rate"], compensating | {"rate": 5.0}, plain, h=0.25)
    steps = [[pv, 52.0 if i >= 100 else 50.0, *rest] for i, (pv, _, *rest) in enumerate(plain)]
    yield case("a ramp of the setpoint", ["Ramp"], limited | {"sp_rate": 0.05}, steps, h=0.25)
    schedule = {"at1": 0.0, "k1": 0.5, "ti1": 1.0, "td1": 0.0, "at2": 10.0, "k2": 0.9, "ti2": 0.8, "td2": 0.1}
    wander = list(_walk(62, 220, low=-2.0, high=12.0))
    scheduled = [[pv, sp, wander[i], *rest] for i, (pv, sp, _, *rest) in enumerate(plain)]
    scheduled[50][2] = NAN
    yield case("a schedule", ["Schedule"], limited | schedule, scheduled, h=0.25)
    low = limited | {"tf": 0.5, "kp": 0.37}
    yield case("below the noise limit, which the filtered PV does not show", ["Noise"], low, plain, h=0.25)
    # The gap's cycle, then PV runs away downward as OP opens.
    away = [[pv - 0.01 * 1.4 ** max(min(i - 165, 24), 0), *rest] for i, (pv, *rest) in enumerate(plain)]
    strong = compensating | {"k": 2.0}
    yield case("PV that runs away", ["WrongSign", "Compensation"], strong, away, h=0.25)
    by_error = compensating | {"comp_way": 1.0, "detector_tf": 0.3}
    yield case("a filter of the detector's own", ["OwnFilter", "Compensation"], by_error, plain, h=0.25)
    unfiltered = {name: value for name, value in by_error.items() if name != "tf"}
    yield case("the same where the controller does not filter", ["OwnFilter"], unfiltered, plain, h=0.25)
    # Only an estimate that may be used makes a size of 4 smaller.
    late = [[*row[:-1], 1.0 if i >= 150 else 0.0] for i, row in enumerate(plain)]
    for tf in (0.4, 0.6):
        long = by_error | {"detector_tf": tf, "comp_size": 4.0}
        yield case(f"a filter of {tf} Ti", ["OwnFilter", "Compensation"], long, late, h=0.25)
    spanned = {name: value for name, value in compensating.items() if name != "kp"} | {"pv_span": 80.0, "op_span": 60.0}
    yield case("Kp by default", ["KpDefault", "Compensation"], spanned | {"comp_size": 4.0}, late, h=0.25)
    yield case("Kp by default, K below 0", ["KpDefault", "Sign"], spanned | {"k": -0.5}, plain, h=0.25)
    backward = {range(60, 70): 8.0, range(90, 95): 4.0, range(120, 126): 1.0}
    limits = [
        [*row[:5], sum((flag for at, flag in backward.items() if i in at), 0.0), row[6]] for i, row in enumerate(plain)
    ]
    yield case(
        "limits further on, and somebody else at the output", ["Told", "Compensation"], compensating, limits, h=0.25
    )
    hand = {80: (MANUAL, 47.0), 90: (NAN, 53.0), 110: (EXTERNAL, NAN)}
    by_hand = [[*row[:3], *(hand.get(i) or row[3:5]), *row[5:]] for i, row in enumerate(plain)]
    yield case("by hand and back", ["Hand", "Compensation"], compensating, by_hand, h=0.25)
    missing = [
        [NAN if i in (40, 130) else row[0], NAN if i in (70, 71) else row[1], *row[2:]] for i, row in enumerate(plain)
    ]
    yield case("PV and SP missing for a scan or two", ["NotANumber"], compensating, missing, h=0.25)


def pid_settings_cases() -> Iterator[dict[str, Any]]:
    """Settings that change on the way, and some that are refused."""
    inside = {"k": 0.5, "ti": 1.0, "kp": 2.0, "n": 3.0, "start": 50.0, "low": 0.0, "high": 100.0, "tf": 0.1}
    pvs = _swinging(160, 24)

    def rows(set_to: dict[int, tuple[float, float]]) -> list[list[float]]:
        now, out = (0.5, 20.0), []
        for i, pv in enumerate(pvs):
            now = set_to.get(i, now)
            out.append([pv, 50.0 if i < 60 else 53.0, *now])
        return out

    yield case(
        "other rates on the way", ["Changed"], inside, rows({62: (0.2, 20.0), 70: (2.0, 1.0), 90: (9.0, 50.0)}), h=0.25
    )
    wrong = {2: (0.5, 0.0), 4: (0.5, 20.0), 63: (-1.0, 20.0), 66: (0.5, NAN), 68: (NAN, 20.0), 80: (0.5, 20.0)}
    yield case("settings refused on the way", ["Refused"], inside, rows(wrong), h=0.25)


BLOCKS: dict[
    str, tuple[Reference, Callable[[], Iterator[dict[str, Any]]], list[str], list[str], str, dict[str, str]]
] = {
    "wrong_sign": (
        wrong_sign,
        wrong_sign_cases,
        ["sp", "yf", "op", "flags"],
        ["found"],
        "K has the wrong sign for its process: OP has gone to its limit, PV runs away from SP. k, ti: of the "
        "controller; low, high: limits of its output; flags: 1 not in automatic, 2 bad, 4 and 8 at the lower and upper "
        "limit, 16 after a gap.",
        {
            "Sign": "a direction that K or the limit does not turn",
            "IrregularStep": "samples counted instead of their time",
            "Edge": "a time or a stretch at the limit that is counted otherwise",
            "Recovery": "a finding that stays when PV or a person is back",
            "Break": "a sample that was not observed, and is used, or a finding that does not survive it",
            "PassedOver": "a time that is repeated, and counts",
            "Healthy": "a load or a setpoint that is taken for a wrong sign",
        },
    ),
    "process_sim": (
        process_sim,
        process_sim_cases,
        ["x", "load"],
        ["y"],
        "Process gain/((1 + s·t1)(1 + s·t2))·e^(−dead_time·s) at the scan time h; y is there before x is taken. It "
        "begins at rest at start.",
        {
            "ZeroTf": "a division by 0, or a lag where none is asked for",
            "DeadTime": "a dead time a scan too long or too short",
            "Rounding": "a whole number of scans that becomes one less and a sliver",
            "Start": "a transient at the beginning",
            "Load": "a load at another place than the input",
            "NotANumber": "a bad input that poisons the process",
        },
    ),
    "pid_module": (
        pid_module,
        pid_module_cases,
        ["pv", "sp", "ff", "mode", "own_sp", "manual", "low", "high", "flags", "tracking"],
        ["u", "ysp", "yf", "error", "flags"],
        "The controller as a module: mode 0 manual, 1 auto, 2 external, where null leaves mode, own_sp and manual as "
        "they are; low, high, flags and tracking are passed backward after the scan. It begins in auto with the output "
        "at start.",
        {
            "Sign": "a limit, or an error, of the wrong sign",
            "IrregularStep": "a step length taken once and kept",
            "Mode": "a mode that takes the wrong setpoint or output",
            "Start": "a first scan that uses what is not there",
            "Bump": "an output that jumps where a mode or an error changes",
            "Limits": "windup, or the wrong one of two limits",
            "NotANumber": "a bad value that poisons the state",
            "Gap": "an integral over time that was not observed",
            "Rate": "a rate that winds up, or that counts in automatic only",
            "FeedForward": "a feed-forward that escapes the limits",
            "Tracking": "a value in effect that is not taken over",
        },
    ),
    "backlash_detection": (
        backlash_detection,
        backlash_detection_cases,
        ["pv", "sp", "mode", "manual", "flags", "enable"],
        ["u", "u_ff", "d_hat", "count", "noise_floor", "whole", "standing", "over", "error"],
        "Detection and compensation beside a controller: pv and sp enter both, u_FF enters the controller, flags are "
        "those that the controller receives backward. mode and manual as in pid_module; detector_tf is the "
        "detector's filter; count: detections behind the estimate since it was last replaced; over: 1 equal, 2 relay; "
        "error: 256 where K has the wrong sign. detector_k is the gain that the detector gets, where it is another.",
        {
            "Sign": "a direction that K does not turn",
            "Flags": "a flag that belongs to another scan than its sample",
            "WrongSign": "a sign that is not noticed, or compensation that goes on with it",
            "Compensation": "u_FF taken for the controller's own output, or a half-period worked off twice or never",
        },
    ),
    "auto_tuner_module": (
        auto_tuner_module,
        auto_tuner_module_cases,
        ["x", "pv", "run", "flags", "tracking", "amplitude"],
        ["y", "flags", "tracking", "phase", "stop", "refused", "ku", "tu", "kp", "kappa"],
        "The autotuner as a module: x from the controller, y to the valve. run begins an experiment where it becomes "
        "1 and ends it where it becomes 0. flags and tracking are passed backward after the scan, and, as outputs, "
        "passed on to the controller. amplitude is set before the scan; refused: number of the parameter that is out "
        "of bounds then, the last good set stays. phase, stop, ku, tu, kp, kappa as in auto_tuner.",
        {
            "End": "an output that is not where it was, or not handed on afterwards",
            "Handed": "a value, a flag or a value in effect that is not handed on",
            "Told": "a limit, or somebody else at the output, that is not seen, or of which nothing is told",
            "NotANumber": "a bad value that is a place to begin, or that poisons the experiment",
            "Changed": "a setting that acts with the next experiment only",
            "Refused": "a setting out of bounds that acts, or that is not named",
            "Overflow": "a setting beyond what is a measurement",
        },
    ),
    "pid_tuner": (
        pid_tuner,
        pid_tuner_cases,
        ["pv", "sp", "mode", "flags", "tune", "take"],
        ["u", "ysp", "phase", "stop", "ku", "tu", "kp", "kappa", "k", "ti", "td"],
        "The autotuner inside the controller: tune 1 begins an experiment, 0 ends it, null leaves it; take 1 takes "
        "AMIGO's PI over before the scan. mode and flags as in pid_advanced; amplitude, wait, longest, pv_low, pv_high "
        "as in auto_tuner. k, ti, td: in force.",
        {
            "Bump": "an output that jumps when the controller goes on",
            "Taken": "an offer that is not taken over, or other gains",
            "End": "an experiment that goes on, or another reason",
        },
    ),
    "pid_advanced": (
        pid_advanced,
        pid_advanced_cases,
        ["pv", "sp", "by", "mode", "manual", "flags", "enable"],
        ["u", "ysp", "u_ff", "d_hat", "count", "noise_floor", "whole", "standing", "over", "error"],
        "The controller with the detection inside, as in backlash_detection; by: the scheduling variable of the rows "
        "at, k, ti, td.",
        {
            "Compensation": "u_FF taken for the controller's own output",
            "WrongSign": "a process of the wrong sign that is not noticed, or compensation that goes on",
            "FilterTime": "a filter of the detector that does not follow the derivative time",
            "Ramp": "a setpoint that the detector sees before it is in effect",
            "Rate": "a rate that limits and is not told, or that u_FF takes up alone",
            "Noise": "a width shown below the noise limit, or noise heard in PV that comes filtered",
            "Schedule": "a row taken too early or too late, or a bump between two",
            "OwnFilter": "PV filtered twice by the detector, or otherwise for u_FF; compensation by too long a filter",
            "KpDefault": "another Kp than 1.5 %/% with the sign of K, or compensation by it",
            "Sign": "a direction or a size that K does not turn",
            "Told": "a limit, or somebody else at the output, that the detector is not told of",
            "Hand": "a manual output that is not taken, or that a half-period is read across",
            "NotANumber": "a bad value that poisons controller or detector",
        },
    ),
    "pid_settings": (
        pid_settings,
        pid_settings_cases,
        ["pv", "sp", "sp_rate", "rate"],
        ["u", "ysp", "refused", "d_hat", "count"],
        "The controller with the detection inside as in pid_advanced; sp_rate and rate are set before each scan; "
        "refused: number of the parameter that is out of bounds then, the last good set stays.",
        {
            "Changed": "a setting that acts later, or a bump where it changes",
            "Refused": "a setting out of bounds that acts, or that is not named",
        },
    ),
    "saturation": (
        saturation,
        saturation_cases,
        ["x"],
        ["y"],
        "Saturation: x kept within low and high. What is no number passes.",
        {
            "Edge": "a comparison that rounds",
            "NotANumber": "a limit where there is no number",
        },
    ),
    "rate_limit": (
        rate_limit,
        rate_limit_cases,
        ["x"],
        ["y"],
        "Rate limit: y follows x by at most rate·h a sample. It begins at the first input.",
        {
            "Sign": "an up and a down that differ",
            "IrregularStep": "a step length taken once and kept",
            "ZeroStep": "a step of 0 or less that moves the output",
            "NotANumber": "a bad sample that poisons the output",
            "Start": "a ramp from 0 to the first sample",
        },
    ),
    "phase_lead": (
        phase_lead,
        phase_lead_cases,
        ["x"],
        ["y"],
        "Phase lead (1 + s·lead)/(1 + s·lag), static gain 1. It begins at rest at the first input.",
        {
            "Nothing": "a lead equal to the lag that changes the signal",
            "IrregularStep": "a step length taken once and kept",
            "ZeroStep": "a step of 0 or less that moves the output",
            "NotANumber": "a bad sample that poisons the output, or is taken for the beginning",
        },
    ),
    "stiction": (
        stiction,
        lambda: ({"h": 0.5} | one for one in stiction_cases()),
        ["e", "u", "enable", "flags"],
        ["u_ff", "standing", "direction"],
        "Pushes for a valve that sticks; push 1 knocker, 2 constant reinforcement, 3 two moves. Not given: limit size, "
        "hold Ti/10 (two moves Ti), period Ti/5 (two moves 10 Ti), band size/10, release Ti, watch 300 Ti, no rate, no "
        "budget. standing as of compensation.",
        {
            "Edge": "a push before it is enabled, beyond its rate, or through a limit of OP",
            "Loss": "a push that stays where a value is bad, a limit is reached, or the controller is in manual",
            "Budget": "a push that the account does not allow",
            "Sign": "a sign of K not heeded, or heeded where OP carries it",
            "IrregularStep": "a time counted in samples",
            "Harm": "a loop that is worse than before and is pushed on",
        },
    ),
    "compensation": (
        compensation,
        compensation_cases,
        ["e", "u", "d_hat", "over", "enable", "flags", "offered", "hindered"],
        ["u_ff", "half", "standing", "delta"],
        "Compensation of a gap (2.2); way 1 error, 2 derivative, 3 inverse; d_hat null: no estimate. source 1 typed, "
        "where not given, 3 the estimate: as it is offered in the sample in which it is enabled. Its limit is its size "
        "where not given. standing: 0 active, 1 not enabled, 2 not auto, 3 bad quality, 4 over-compensated, 5 too many "
        "reversals, 6 too much travel, 7 estimate lost, 8 at limit, 9 too small, 10 "
        "waiting for a reversal, 11 worse, 12 "
        "too late, 13 not followed, 14 no estimate; hindered is one of them that stands in the way.",
        {
            "Start": "a push before the first reversal, or a first reversal that is none",
            "Sign": "a sign of K not heeded, or heeded where OP carries it",
            "Rate": "a rate or a share not kept, or a step length taken once and kept",
            "Band": "a reversal within the noise band, or a size that the band is not taken off",
            "Edge": "≥ where > is meant",
            "Loss": "a bump, a way to the other side while it is taken away, or a state that a bad value poisons",
            "Estimate": "a size that an estimate makes larger, or that survives its loss",
            "Source": "an estimate taken at another time than when it is enabled, or a band and a rate "
            "of another width",
            "Hindered": "what only the outside sees not heeded, or forgiven where it is not to be",
            "Withdrawn": "a withdrawal that a change of mode forgives",
            "Worse": "a comparison with too little, or with another time than before it was enabled",
            "Budget": "a budget exceeded, or one that never fills up again",
            "ZeroStep": "a step of 0 or less that moves the output, or that hides a cause",
        },
    ),
    "over_compensation": (
        over_compensation,
        over_compensation_cases,
        ["delta_t", "delta_y", "delta_sp", "flags", "size"],
        ["equal", "relay"],
        "Warnings of over-compensation after each half-period: equal as in code block 7.1, relay ours.",
        {
            "Gap": "the equal cycle of a gap taken for a relay",
            "Off": "a warning where nothing is compensated",
            "Before": "a cycle that was there before taken for a new one, or forgotten",
            "Sign": "a K below 0 that makes every travel small",
            "Window": "a half-period kept too long or dropped too early",
            "Uneven": "noise taken for a relay",
            "Edge": "< where ≤ is meant, or the other way",
            "Break": "a row that goes on over a break",
        },
    ),
    "foreign_detection": (
        foreign_detection,
        foreign_detection_cases,
        ["pv", "sp", "op", "flags", "back", "enable"],
        ["u_ff", "d_hat", "count", "noise_floor", "whole", "standing", "over", "error", "delta"],
        "Detection and compensation beside a controller that is not ours. flags: 1 not in "
        "automatic, 2 bad, 4 at the lower, 8 "
        "at the upper limit. back: u_FF as it is read back, where read_back is 1. OP "
        "holds the u_FF made delay scans ago; "
        "longest: the longest delay as a share of ti. comp_source 3: the width is the "
        "estimate as it was when enabled. The "
        "rest is as in backlash_detection; in what is read u_FF may be later than delay says.",
        {
            "Delay": "u_FF taken off OP in another scan than that in which it is in it, or a bound that is another",
            "Edge": "≥ where > is meant",
            "Loss": "a jump of u_FF where a ramp is meant, or a ramp in manual, or a loss that is "
            "not heeded or forgiven",
            "Start": "a jump from what their controller holds",
            "NotFollowed": "compensation that goes on where nobody follows, or is taken away for a moment's difference",
            "Source": "an estimate that is not one to compensate by",
        },
    ),
    "filter": (
        filter_,
        filter_cases,
        ["x"],
        ["y"],
        "Second-order low-pass filter 1/(1 + s·tf)² (2.1) by backward differences. It begins at the first input.",
        {
            "Start": "a transient at the first sample",
            "ZeroTf": "a division by 0, or a filter where none is asked for",
            "IrregularStep": "a step length taken once and kept",
            "ZeroStep": "a step of 0 or less that moves the state",
            "Rounding": "operations in another order",
        },
    ),
    "zero_crossing": (
        zero_crossing,
        zero_crossing_cases,
        ["e"],
        ["crossed", "sign"],
        "Zero crossings of the error (2.1): crossed 1 or 0; sign −1 or 1, 0 before the first error other than zero.",
        {
            "Start": "a crossing where there was no sign before",
            "Zero": "an error of exactly zero taken for a sign",
            "Sign": "one direction found more readily than the other",
            "NotANumber": "a bad error taken for a sign",
        },
    ),
    "noise_level": (
        noise_level,
        noise_level_cases,
        ["x"],
        ["sigma"],
        "Standard deviation of a signal's fast noise, by the median size of its fourth difference; null before twenty "
        "of them. x null: a value is missing.",
        {
            "Sign": "one direction that counts more than the other",
            "Offset": "a movement of the signal taken for noise",
            "Start": "an outlier at the beginning that lasts",
            "Grid": "a rounded signal taken for one without noise",
            "Held": "values that a transmitter or a historian holds, taken for ones without noise",
            "Zero": "a level of zero that never leaves it",
            "NotANumber": "a difference over values that are missing",
        },
    ),
    "derivative": (
        derivative,
        derivative_cases,
        ["x"],
        ["slope"],
        "Backward difference over the step; 0 at the first input and where no time has passed.",
        {
            "Start": "a kick at the first sample",
            "IrregularStep": "a step length taken once and kept",
            "ZeroStep": "a division by a step of 0, or a value before that it replaces",
        },
    ),
    "half_period": (
        half_period,
        half_period_cases,
        ["e", "sp", "slope", "op", "flags", "crossed"],
        [
            "flags",
            "samples",
            "delta_t",
            "delta_y",
            "e_max",
            "delta_sp",
            "sp_change",
            "slope_change",
            "op_change",
        ],
        "What the signals did between two crossings (2.2). It begins at the first sample; crossed 1: the sample closes "
        "one half-period and is the first of the next. Output null where none was closed.",
        {
            "Setpoint": "a range without the closing sample, or a change that is a range",
            "IrregularStep": "a mean over samples instead of time",
            "Short": "a division by a duration of 0, or a sample counted twice",
            "Flags": "a flag lost, or carried into the next half-period",
            "Sign": "an error that counts with its sign",
        },
    ),
    "width": (
        width,
        width_cases,
        ["sign", "delta_t", "delta_y", "sp_change", "slope_change", "op_change"],
        ["delta_u", "delta_u_d", "delta_u_sp", "op_travel", "free", "kp_part", "d"],
        "Width of the gap (2.4) by (7.5), (7.6) or OP's own travel, of one half-period; op_change null: OP not known; "
        "td or kp left out: not known.",
        {
            "NoOp": "a travel of OP where it is not known",
            "Derivative": "a derivative part left out, or with the wrong sign",
            "Op": "OP's travel not used where Td is not known",
            "Sign": "a sign of K or Kp that changes the width, or one of K that OP's travel does not follow",
            "NoKp": "a process-gain part where Kp is not known",
            "Setpoint": "a setpoint's part with the wrong sign or weight",
            "Zero": "a division by 0",
        },
    ),
    "swing": (
        swing,
        swing_cases,
        ["sp", "yf", "op", "ends", "flags"],
        ["travel", "plateau"],
        "OP's travel between its furthest points in two half-periods, null without a turn to count from, and height "
        "of PV's plateau. ends: sign of the half-period that ends before this sample, which begins the next; flags: of "
        "the one that ends; op null: by (4.1). td left out: 0.",
        {
            "ByHand": "OP by (4.1) with a wrong sign, order or part",
            "Sign": "a turn on the wrong side where K is negative",
            "Setpoint": "a setpoint's part with the wrong weight",
            "Break": "a travel over a break, or none where there was no break",
            "OneSide": "a travel between two turns on the same side",
            "Switch": "a travel from a recorded turn to one by (4.1)",
            "ZeroStep": "a division by a step of 0, or a sample without time that counts",
        },
    ),
    "correction": (
        correction,
        correction_cases,
        ["sp", "yf", "op", "ends", "flags", "mask", "delta_y"],
        ["d", "low", "high", "kp", "doubt"],
        "The width with the bias of (2.4) taken out, by the last nine pairs of half-periods, worked off with the "
        "sample after the one that ended a half-period; doubt: 0, or why there is no width. ends, flags: as in swing; "
        "mask, delta_y: of the half-period that ends. kp left out: not known.",
        {
            "Line": "another line than that of known errors, or one that a single pair makes",
            "Doubt": "a width where the pairs do not tell",
            "Noise": "a width that noise makes",
            "Whole": "a pair with a half-period that is not whole, or none with one that is",
        },
    ),
    "safety_net": (
        safety_net,
        safety_net_cases,
        ["flags", "delta_t", "delta_y", "e_max", "delta_sp", "free", "previous", "d_hat"],
        ["mask", "reason"],
        "Conditions that a half-period fails (chapter 5, 7.1), a bit each, and the first of them; previous or d_hat "
        "null: there is none. A switch is on unless its parameter is 0.",
        {
            "Flags": "a flag not heeded, or heeded by the wrong reason",
            "Edge": "≤ where < is meant, or the other way",
            "Order": "a first reason that is not the first, or a condition not looked at after one that failed",
            "Span": "a span where none is known",
            "Zero": "a division by a Δy of 0",
            "Sign": "a K below 0 that changes (5.1)",
            "Switch": "a switch that does nothing, or more than it says",
        },
    ),
    "median_mean": (
        median_mean,
        median_mean_cases,
        ["d"],
        ["value", "low", "high", "kept", "count"],
        "Median/mean filter of the last n detections (7.3).",
        {
            "Even": "an even number of which none lies in the band",
            "Window": "a detection kept too long or dropped too early",
            "Sign": "a band turned inside out by a median below 0",
            "Step": "a mean of two widths",
            "Edge": "a band that is open where it is closed",
            "Zero": "a band of no width that drops its own median",
        },
    ),
    "detector": (
        detector,
        detector_cases,
        ["sp", "pv", "op", "flags"],
        list(DETECTION_FIELDS),
        "The whole detector: every sample in, each half-period out at the sample that ends it, null at the others. h "
        "adds up to times that a double holds exactly. op_known 0: OP is not recorded. The first h is not used.",
        {
            "Sign": "a width that depends on direction",
            "Op": "OP heeded where it is not known, or not where it is",
            "Derivative": "the derivative part left out",
            "IrregularStep": "a step length taken once and kept",
            "Setpoint": "a setpoint that moves taken for a gap",
            "Noise": "a width shown below the noise limit",
            "Flags": "a flag lost on the way from sample to reason",
            "Bad": "a bad value that reaches the filter, or a break that is not one",
            "Start": "a first half-period that is not called a gap",
            "Gap": "time that was not observed counted as time",
            "ZeroStep": "a repeated time that counts as a sample",
            "Zero": "a crossing where the error rests at zero",
            "LockOut": "(5.1) that rejects for ever, or that yields to noise",
        },
    ),
    "auto_tuner": (
        auto_tuner,
        auto_tuner_cases,
        ["pv", "flags", "start"],
        ["op", "phase", "stop", "relay_hysteresis", "bias", "ku", "tu", "kp", "kappa"],
        "Relay experiment. start: the output at which one begins, null: none begins. phase 0 idle, 1 waiting, "
        "2 balanced, 3 biased, 4 done, 5 aborted; stop 1 bad_quality, 2 sample_time, 3 not_auto, 4 op_limit, "
        "5 pv_bounds, 6 wrong_sign, 7 dead_loop, 8 not_regular, 9 time_budget, 10 off_point; ku, tu, kp, kappa null: "
        "not found. Where no hysteresis is given it is half of PV's range at rest.",
        {
            "Noise": "a hysteresis that does not come from PV at rest, harmonics that noise shifts",
            "Gap": "a known gap that is not counted in",
            "Hysteresis": "a given hysteresis that is not taken",
            "Sign": "a process with a gain below 0 treated unlike its mirror image",
            "Bias": "up and down that do not last alike though they could, or a bias beyond its reach",
            "Integrating": "a static gain where there is none",
            "IrregularStep": "integrals that take every step for the same length",
            "WrongSign": "a process driven away from its centre for long, or not for the stated reason",
            "DeadLoop": "an experiment that waits for an answer for ever",
            "NotRegular": "numbers from a cycle that the sampling makes",
            "OffPoint": "numbers from a cycle that the hysteresis makes",
            "TimeBudget": "an experiment longer than it may be, or one that forgets what it had found",
            "PvBounds": "PV out of bounds that is not noticed",
            "Fault": "a fault that leaves the relay running, another order of reasons, no fresh start after it",
            "OpLimit": "a relay that would reach a limit of OP",
            "Start": "an output moved before any start",
        },
    ),
    "tuning": (
        tuning,
        tuning_cases,
        list(TUNING_INPUTS),
        ["k", "ti", "td"],
        "Tuning rules in closed form; a row is a process, null what the rule does not take, wish: λ or τc. rule "
        + ", ".join(f"{number} {name}" for number, name in enumerate(RULES))
        + "; pid 1 or 0; original 1: the table of 1942. The outputs are exact, rounded once: f64 within 1e-14 of them.",
        {
            "Table": "the other of the two tables",
            "Coefficients": "a coefficient or a power that is not the source's; several public codes have a wrong Ti",
            "Series": "a series form taken for the ideal one",
        },
    ),
    "backlash": (
        backlash,
        backlash_cases,
        ["x"],
        ["y"],
        "Backlash of total width d (thesis 6.3). It begins at output where that is given, else at the first input.",
        {
            "ZeroWidth": "a gap of 0 that does not pass its input",
            "Start": "a first output that is not where it should be",
            "Sign": "one side of the gap wider than the other",
            "Edge": "a comparison that moves the output, or does not, where rounding decides",
            "NotANumber": "a bad input that moves or poisons the output",
            "Rounding": "operations in another order",
        },
    ),
    "noise": (
        noise,
        noise_cases,
        ["x"],
        ["y"],
        "Uniform noise of ± amplitude (thesis 6.2) from a generator in 32-bit integers that begins at integer.",
        {
            "ZeroAmplitude": "noise where none is asked for",
            "Overflow": "a product that leaves 32 bits",
            "BadState": "an integer outside 1..2147483646, which must count as 1",
            "NotANumber": "a bad input that stops the generator",
        },
    ),
    "pid": (
        pid,
        pid_cases,
        ["ysp", "yf", "u_manual"],
        ["u"],
        "PI or PID controller (4.1) in ideal form; u_manual null: auto. It begins with no integral part.",
        {
            "Sign": "a gain below 0 that is not followed",
            "IrregularStep": "a step length taken once and kept",
            "Limits": "an output beyond its limits, or an integral part that winds up",
            "Manual": "a bump on the way back to auto",
            "Start": "a derivative of the first sample",
            "NotANumber": "a bad sample that changes the output or the state",
            "ZeroStep": "a division by a step of 0",
        },
    ),
}


NULLS: dict[str, dict[str, str]] = {
    "auto_tuner": {"pv": "no number", "start": "not given"},
    "auto_tuner_module": {"x": "no number", "pv": "no number"},
    "backlash": {"x": "no number"},
    "backlash_detection": {"mode": "unchanged", "manual": "unchanged"},
    "compensation": {
        "e": "no number",
        "u": "no number",
        "d_hat": "not given",
        "offered": "not given",
        "hindered": "not given",
    },
    "detector": {"sp": "no number", "pv": "no number", "op": "no number"},
    "foreign_detection": {"pv": "no number", "op": "no number", "back": "no number"},
    "noise": {"x": "no number"},
    "noise_level": {"x": "not given"},
    "phase_lead": {"x": "no number"},
    "stiction": {"e": "no number", "u": "no number"},
    "pid": {"ysp": "no number", "yf": "no number", "u_manual": "not given"},
    "pid_advanced": {
        "pv": "no number",
        "sp": "no number",
        "by": "no number",
        "mode": "unchanged",
        "manual": "unchanged",
    },
    "pid_module": {
        "pv": "no number",
        "sp": "no number",
        "ff": "no number",
        "mode": "unchanged",
        "own_sp": "unchanged",
        "manual": "unchanged",
        "tracking": "no number",
    },
    "pid_settings": {"sp_rate": "no number", "rate": "no number"},
    "pid_tuner": {"pv": "no number", "mode": "unchanged", "tune": "unchanged"},
    "process_sim": {"x": "no number", "load": "no number"},
    "rate_limit": {"x": "no number"},
    "safety_net": {"previous": "not given", "d_hat": "not given"},
    "saturation": {"x": "no number"},
    "swing": {"op": "not given"},
    "tuning": dict.fromkeys(("gain", "t", "t2", "l", "ku", "tu", "kappa", "wish"), "not given"),
    "width": {"op_change": "not given"},
    "wrong_sign": {"yf": "no number"},
    "zero_crossing": {"e": "no number"},
}
"""Meaning of null, input by input, where a case has one."""


def case(comment: str, flags: list[str], params: Params, samples: list[Any], h: Any = None) -> dict[str, Any]:
    """Describe a case, without its outputs yet; h one number, one a sample, or None where the block has no time."""
    return {"comment": comment, "flags": flags, "params": params, "h": h, "input": samples}


def documents() -> dict[str, str]:
    """Text of each file by its name."""
    texts = {}
    for block, (reference, cases, inputs, outputs, doc, notes) in BLOCKS.items():
        done = []
        for number, one in enumerate(cases(), 1):
            h = one.pop("h")
            steps = h if isinstance(h, list) else [h] * len(one["input"])
            timed = {} if h is None else {"h": h}
            output = reference(one["params"], steps, one["input"])
            done.append({"id": number} | one | timed | {"output": output})
        nulls = {"nulls": NULLS[block]} if block in NULLS else {}
        head = {"block": block, "doc": doc, "inputs": inputs, "outputs": outputs} | nulls | {"notes": notes}
        texts[f"{block}.json"] = _text(head, done)
    return texts


def _sum(values: Iterable[float]) -> float:
    """Sum in the order given; Python's own may carry more digits on the way."""
    total = 0.0
    for value in values:
        total += value
    return total


def _walk(seed: int, n: int, low: float = -1.0, high: float = 1.0) -> Iterator[float]:
    """Numbers with all their digits, wandering between two bounds."""
    random = Random(seed)
    x = 0.5 * (low + high)
    for _ in range(n):
        x = min(max(x + (random.random() - 0.5) * 0.3 * (high - low), low), high)
        yield x


def _text(head: dict[str, Any], cases: list[dict[str, Any]]) -> str:
    """JSON with one line for each field, so that a change shows as a change of that field."""

    def fields(mapping: dict[str, Any], indent: str) -> str:
        return ",\n".join(f"{indent}{json.dumps(key)}: {_json(value)}" for key, value in mapping.items())

    rows = ",\n".join("    {\n" + fields(one, "      ") + "\n    }" for one in cases)
    return "{\n" + fields(head, "  ") + ',\n  "cases": [\n' + rows + "\n  ]\n}\n"


def _json(value: Any) -> str:
    """JSON of a value, with null for a value that is no number."""
    return json.dumps(_plain(value), ensure_ascii=False, allow_nan=False)


def _plain(value: Any) -> Any:
    """A value with None for a value that is no number."""
    if isinstance(value, list):
        return [_plain(x) for x in value]
    return None if isinstance(value, float) and math.isnan(value) else value


if __name__ == "__main__":
    for name, text in documents().items():
        (Path(__file__).parent / name).write_text(text, encoding="utf-8")
