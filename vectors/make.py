"""Write the golden cases of every block: `python vectors/make.py`.

Each block is written here a second time, in plain Python, from its equations and in the order of operations that its
documentation states. Python's floats are IEEE 754 doubles, so the block in every other language must give these outputs
to the last bit (LREAL on a PLC: to a few units in the last place).

A block's function takes the parameters, the time before each sample and the samples, and gives the outputs. To add a
block, write its function and its cases, and name it in `BLOCKS`.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Sequence
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


BLOCKS: dict[
    str, tuple[Reference, Callable[[], Iterator[dict[str, Any]]], list[str], list[str], str, dict[str, str]]
] = {
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
        head = {"block": block, "doc": doc, "inputs": inputs, "outputs": outputs, "notes": notes}
        texts[f"{block}.json"] = _text(head, done)
    return texts


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
    """JSON of a value, with null for what is not a number."""
    if isinstance(value, list):
        return "[" + ", ".join(map(_json, value)) + "]"
    if isinstance(value, float) and math.isnan(value):
        return "null"
    return json.dumps(value, ensure_ascii=False, allow_nan=False)


if __name__ == "__main__":
    for name, text in documents().items():
        (Path(__file__).parent / name).write_text(text, encoding="utf-8")
