"""The golden cases of vectors/: current, well-formed, and met by the blocks as Python has them."""

import importlib.util
import json
import math
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import jsonschema_rs
import pytest

from glapp import _glapp, blocks, modules

VECTORS = Path(__file__).parents[1] / "vectors"
FILES = sorted(path for path in VECTORS.glob("*.json") if path.name not in ("schema.json", "catalogue.json"))


def read(path: Path) -> dict[str, Any]:
    return json.loads(path.read_text(encoding="utf-8"))


@pytest.mark.slow
def test_files_are_what_the_generator_writes() -> None:
    spec = importlib.util.spec_from_file_location("make", VECTORS / "make.py")
    assert spec is not None and spec.loader is not None
    make = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(make)
    documents = make.documents()
    assert sorted(documents) == [path.name for path in FILES]
    for path in FILES:
        assert path.read_text(encoding="utf-8") == documents[path.name], "run: python vectors/make.py"


@pytest.mark.slow
@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_file_follows_the_schema_and_explains_its_flags(path: Path) -> None:
    file = read(path)
    jsonschema_rs.validate(read(VECTORS / "schema.json"), file)
    assert file["block"] == path.stem
    assert {flag for case in file["cases"] for flag in case["flags"]} == set(file["notes"])
    nulls = set()
    for case in file["cases"]:
        assert len(case["input"]) == len(case["output"])
        assert all(math.isfinite(x) for x in flat(case["input"]) if x is not None)
        for row in case["input"]:
            row = row if isinstance(row, list) else [row]
            nulls |= {name for name, x in zip(file["inputs"], row, strict=True) if x is None}
    assert nulls == set(file.get("nulls", {}))


def flat(values: list[Any]) -> Iterator[float | None]:
    for value in values:
        yield from value if isinstance(value, list) else [value]


def auto_tuner(params: dict[str, float]) -> Callable[..., list[float | None]]:
    block = blocks.AutoTuner(
        params["amplitude"],
        wait=params["wait"],
        longest=params["longest"],
        max_h=params["max_h"],
        pv_limits=(params["pv_low"], params["pv_high"]),
        op_limits=(params["op_low"], params["op_high"]),
        relay_hysteresis=params.get("relay_hysteresis"),
        d=params.get("d", 0.0),
    )
    phases = ["idle", "waiting", "balanced", "biased", "done", "aborted"]

    def update(pv: float, flags: float, start: float, h: float) -> list[float | None]:
        if not math.isnan(start):
            block.start(start)
        op = block.update(pv, h, int(flags))
        stop = _glapp.stops().index(block.stop or "none")
        return [op, phases.index(block.phase), stop, block.relay_hysteresis, block.bias, *(block.found or [None] * 4)]

    return update


def backlash(params: dict[str, float]) -> Callable[..., float]:
    block = blocks.Backlash(params["d"], params.get("output"))
    return lambda x, h: block.update(x)


def noise(params: dict[str, float]) -> Callable[..., float]:
    block = blocks.Noise(params["amplitude"], int(params["integer"]))
    return lambda x, h: block.update(x)


def noise_level(params: dict[str, float]) -> Callable[..., float]:
    block = blocks.NoiseLevel()

    def update(x: float, h: float) -> float:
        block.update(x)
        return math.nan if block.sigma is None else block.sigma

    return update


def pid(params: dict[str, float]) -> Callable[..., float]:
    limits = (params["low"], params["high"]) if "low" in params else None
    block = blocks.Pid(params["k"], params["ti"], params["td"], params["b"], limits)
    return lambda ysp, y, u, h: block.update(ysp, y, h) if math.isnan(u) else block.track(ysp, y, u, h)


def phase_lead(params: dict[str, float]) -> Callable[..., float]:
    return blocks.PhaseLead(params["lead"], params["lag"]).update


def stiction(params: dict[str, float]) -> Callable[..., tuple[float, int, int]]:
    names = ("k", "ti", "size", "limit", "hold", "period", "band", "far", "rate", "release", "travel", "watch")
    block = blocks.Stiction(
        ("knocker", "reinforcement", "two_moves")[int(params["push"]) - 1],
        **{name: params[name] for name in names if name in params},
        withdraw=params.get("withdraw", 1) == 1,
        limits=(params["low"], params["high"]) if "low" in params else None,
    )
    standings = _glapp.compensation_states()

    def update(e: float, u: float, enable: float, flags: float, h: float) -> tuple[float, int, int]:
        u_ff = block.update(e, u, h, enable=bool(enable), flags=int(flags))
        return u_ff, standings.index(block.standing), block.direction

    return update


def rate_limit(params: dict[str, float]) -> Callable[..., float]:
    return blocks.RateLimit(params["rate"]).update


def saturation(params: dict[str, float]) -> Callable[..., float]:
    block = blocks.Saturation(params["low"], params["high"])
    return lambda x, h: block.update(x)


def given(x: float) -> float | None:
    return None if math.isnan(x) else x


def compensation(params: dict[str, float]) -> Callable[..., tuple[float, float, int]]:
    names = ("k", "size", "share", "band", "tf", "rate", "release", "watch", "travel", "reversals")
    block = blocks.Compensation(
        ("error", "derivative", "inverse")[int(params["way"]) - 1],
        **{name: params[name] for name in names},
        limit=params.get("limit", params["size"]),
        withdraw=params["withdraw"] == 1,
        estimate=params.get("estimate", 1) == 1,
        limits=(params["low"], params["high"]) if "low" in params else None,
        source=("typed", "fitted", "estimate")[int(params.get("source", 1)) - 1],
        ramp_time=params.get("ramp_time", 0.0),
        ti=params.get("ti", 1e6),
    )
    standings = _glapp.compensation_states()

    def update(e: float, u: float, d_hat: float, over: float, enable: float, flags: float, *others: float) -> Any:
        offered, hindered, h = others
        u_ff = block.update(
            e,
            u,
            h,
            enable=bool(enable),
            d_hat=None if math.isnan(d_hat) else d_hat,
            over=bool(over),
            flags=int(flags),
            offered=None if math.isnan(offered) else offered,
            hindered=None if math.isnan(hindered) else standings[int(hindered)],
        )
        return u_ff, block.size / 2, standings.index(block.standing), block.delta

    return update


def over_compensation(params: dict[str, float]) -> Callable[..., list[int]]:
    block = blocks.OverCompensation(params["k"], params["ti"])

    def update(delta_t: float, delta_y: float, delta_sp: float, flags: float, size: float, h: float) -> list[int]:
        return [int(warned) for warned in block.update(delta_t, delta_y, h, size, delta_sp, int(flags))]

    return update


def wrong_sign(params: dict[str, float]) -> Callable[..., float]:
    block = blocks.WrongSign(params["k"], params["ti"], params["low"], params["high"])
    return lambda sp, yf, op, flags, h: float(block.update(sp, yf, op, h, int(flags)))


def filter(params: dict[str, float]) -> Callable[..., float]:
    return blocks.SecondOrderFilter(params["tf"]).update


def zero_crossing(_params: dict[str, float]) -> Callable[..., list[float]]:
    block = blocks.ZeroCrossing()
    return lambda e, h: [int(block.update(e)), block.sign]


def derivative(_params: dict[str, float]) -> Callable[..., float]:
    """The block's update, as the vectors call it."""
    return blocks.Derivative().update


def half_period(_params: dict[str, float]) -> Callable[..., tuple[float, ...] | None]:
    block = blocks.HalfPeriod()
    return lambda e, sp, slope, op, flags, crossed, h: block.update(e, h, sp, slope, op, int(flags), bool(crossed))


def width(params: dict[str, float]) -> Callable[..., tuple[float, ...]]:
    block = blocks.Width(params["k"], params["ti"], params.get("td"), params["b"], params.get("kp"))
    return lambda sign, dt, dy, sp, slope, op, h: block.of(int(sign), dt, dy, sp, slope, given(op))


def safety_net(params: dict[str, float]) -> Callable[..., tuple[int, int]]:
    switches = {name: value != 0 for name, value in params.items() if name not in ("k", "ti", "op_span")}
    block = blocks.SafetyNet(params["k"], params["ti"], params.get("op_span"), **switches)
    return lambda flags, *x: block.check(int(flags), *x[:5], given(x[5]), given(x[6]))


def swing(params: dict[str, float]) -> Callable[..., list[float | None] | None]:
    block = blocks.Swing(params["k"], params["ti"], params.get("td"), params["b"])

    def update(sp: float, yf: float, op: float, ends: float, flags: float, h: float) -> list[float | None] | None:
        ended = list(block.end(int(ends), int(flags))) if ends else None
        block.add(sp, yf, h, given(op))
        return ended

    return update


def correction(params: dict[str, float]) -> Callable[..., list[float | None]]:
    integrating = params.get("integrating", 0.0) != 0.0
    block = blocks.Correction(params["k"], params["ti"], params["b"], params.get("kp"), integrating)

    def update(
        sp: float, yf: float, op: float, ends: float, flags: float, mask: float, delta_y: float, h: float
    ) -> list[float | None]:
        block.conclude()
        if ends:
            block.end(int(ends), delta_y, int(mask), int(flags))
        block.add(sp, yf, h, op)
        width = block.width()
        return [None] * 4 + [1.0 + _glapp.doubts().index(width)] if isinstance(width, str) else [*width, 0.0]

    return update


def median_mean(params: dict[str, float]) -> Callable[..., tuple[float, ...]]:
    block = blocks.MedianMean(int(params["n"]))
    return lambda d, h: block.update(d)


def detector(params: dict[str, float]) -> Callable[..., list[float] | None]:
    limits = (params["op_low"], params["op_high"]) if "op_low" in params else None
    settings = {name: params.get(name) for name in ("k", "ti", "td", "b", "kp", "tf", "max_h", "op_span")}
    block = _glapp.Detector({**settings, "n": int(params["n"]), "h": 0.0, "op_limits": limits})
    columns = read(VECTORS / "detector.json")["outputs"]
    t = 0.0

    def update(sp: float, pv: float, op: float, flags: float, h: float) -> list[float] | None:
        nonlocal t
        t += h
        record = block.update(t, sp, pv, op if params["op_known"] else None, int(flags))
        return None if record is None else [getattr(record, name) for name in columns]

    return update


def tuning(params: dict[str, float]) -> Callable[..., tuple[float, float, float]]:
    rule, pid, original = int(params["rule"]), params["pid"] == 1, params.get("original") == 1

    def update(
        gain: float, t: float, t2: float, dead: float, ku: float, tu: float, kappa: float, wish: float, h: None
    ) -> tuple[float, float, float]:
        ways: list[Callable[[], tuple[float, float, float]]] = [
            lambda: _glapp.ziegler_nichols_step(gain, dead, pid, original),
            lambda: _glapp.ziegler_nichols_frequency(ku, tu, pid, original),
            lambda: _glapp.lambda_tuning(gain, t, dead, wish, pid),
            lambda: _glapp.lambda_integrating(gain, dead, wish),
            lambda: _glapp.amigo_step(gain, t, dead, pid),
            lambda: _glapp.amigo_integrating(gain, dead, pid),
            lambda: _glapp.amigo_frequency(ku, tu, kappa, pid),
            lambda: _glapp.simc(gain, t, t2, dead, wish),
            lambda: _glapp.simc_integrating(gain, t2, dead, wish),
            lambda: _glapp.point_placement(ku, tu),
        ]
        return ways[rule]()

    return update


def process_sim(params: dict[str, float]) -> Callable[..., float]:
    h = params["h"]
    process = modules.ProcessSim(**{name: value for name, value in params.items() if name != "h"})
    named = {"x": modules.Input(), "load": modules.Input(), "process": process, "y": modules.Output()}
    graph = modules.Graph(h, named, ["x -> process -> y", "load -> process.load"])

    def update(x: float, load: float, _h: float) -> float:
        graph.scan(x=x, load=load)
        return graph["process"]

    return update


def pid_module(params: dict[str, float]) -> Callable[..., list[float]]:
    named = {"pv": modules.Input(), "sp": modules.Input(), "ff": modules.Input(), "valve": modules.Output()}
    wires = ["pv -> pid.pv", "sp -> pid.sp", "ff -> pid.ff", "pid -> valve"]
    graph = modules.Graph(0.1, named | {"pid": modules.Pid(**params)}, wires)
    graph["pid.mode"] = modules.Mode.AUTO

    def update(pv: float, sp: float, ff: float, *others: float) -> list[float]:
        *set_before, low, high, flags, tracking, h = others
        for name, value in zip(("mode", "sp", "manual"), set_before, strict=True):
            if not math.isnan(value):
                graph[f"pid.{name}"] = value
        for name, value in {"low": low, "high": high, "flags": flags, "tracking": tracking}.items():
            graph[f"valve.{name}"] = value
        graph.scan(pv=pv, sp=sp, ff=ff, h=h)
        return [graph[f"pid.{name}"] for name in ("out", "ysp", "yf", "error", "flags")]

    return update


SHOWN = ("u_ff", "d_hat", "count", "noise_floor", "whole", "standing", "over", "error")


def _set(graph: modules.Graph, module: str, **values: float) -> None:
    for name, value in values.items():
        if not math.isnan(value):
            graph[f"{module}.{name}"] = value


def backlash_detection(params: dict[str, float]) -> Callable[..., list[float]]:
    own = {name: params[name] for name in ("k", "ti", "td", "b") if name in params}
    more = {name: value for name, value in params.items() if name in ("kp", "n") or name.startswith("comp_")}
    limits = {name: params[name] for name in ("low", "high") if name in params}
    named = {
        "pv": modules.Input(),
        "sp": modules.Input(),
        "pid": modules.Pid(**own, **limits, start=params["start"]),
        "watch": modules.BacklashDetection(
            **own | {"k": params.get("detector_k", params["k"])},
            **more,
            **{f"op_{name}": value for name, value in limits.items()},
            tf=params["detector_tf"],
        ),
        "valve": modules.Output(),
    }
    wires = ["pv -> pid.pv", "sp -> pid.sp", "pv -> watch.pv", "sp -> watch.sp", "watch -> pid.ff", "pid -> valve"]
    graph = modules.Graph(0.25, named, wires)

    def update(pv: float, sp: float, mode: float, manual: float, flags: float, enable: float, h: float) -> list[float]:
        _set(graph, "pid", mode=mode, manual=manual)
        _set(graph, "valve", flags=flags)
        _set(graph, "watch", compensate=enable)
        graph.scan(pv=pv, sp=sp, h=h)
        return [graph["pid"], *(graph[f"watch.{name}"] for name in SHOWN)]

    return update


def foreign_detection(params: dict[str, float]) -> Callable[..., list[float]]:
    inputs = ["pv", "sp", "op", "flags", *(["u_ff"] if params["read_back"] else [])]
    more = {name: value for name, value in params.items() if name in ("k", "ti", "kp", "n") or name.startswith("comp_")}
    watch = modules.BacklashDetection(
        **more,
        **{f"op_{name}": params[name] for name in ("low", "high") if name in params},
        tf=params["detector_tf"],
        max_h=params["ti"] / 2,
        ff_delay=int(params["delay"]),
        ff_tolerance=params.get("tolerance"),
        ff_longest=params["longest"],
    )
    named = {**{name: modules.Input() for name in inputs}, "watch": watch, "ff": modules.Output()}
    graph = modules.Graph(0.25, named, [*(f"{name} -> watch.{name}" for name in inputs), "watch -> ff"])

    def update(pv: float, sp: float, op: float, flags: float, back: float, enable: float, h: float) -> list[float]:
        _set(graph, "watch", compensate=enable)
        graph.scan(pv=pv, sp=sp, op=op, flags=flags, h=h, **({"u_ff": back} if params["read_back"] else {}))
        return [graph["ff"], *(graph[f"watch.{name}"] for name in (*SHOWN[1:], "delta"))]

    return update


def pid_advanced(params: dict[str, float]) -> Callable[..., list[float]]:
    rows = [[params[f"{name}{i}"] for name in ("at", "k", "ti", "td")] for i in range(1, 9) if f"at{i}" in params]
    plain = {name: value for name, value in params.items() if not name[-1].isdigit()}
    named = {
        **{name: modules.Input() for name in ("pv", "sp", "by")},
        "pid": modules.PidAdvanced(**plain, schedule=rows),
        "valve": modules.Output(),
    }
    graph = modules.Graph(0.25, named, ["pv -> pid.pv", "sp -> pid.sp", "by -> pid.by", "pid -> valve"])

    def update(pv: float, sp: float, by: float, *others: float) -> list[float]:
        mode, manual, flags, enable, h = others
        _set(graph, "pid", mode=mode, manual=manual, compensate=enable)
        _set(graph, "valve", flags=flags)
        graph.scan(pv=pv, sp=sp, by=by, h=h)
        # The controller's own flag of a bad value is not reported there.
        wrong_sign = float(int(graph["pid.error"]) & 256)
        return [*(graph[f"pid.{name}"] for name in ("out", "ysp", *SHOWN[:-1])), wrong_sign]

    return update


def pid_settings(params: dict[str, float]) -> Callable[..., list[float]]:
    named = {
        **{name: modules.Input() for name in ("pv", "sp")},
        "pid": modules.PidAdvanced(**params),
        "valve": modules.Output(),
    }
    graph = modules.Graph(0.25, named, ["pv -> pid.pv", "sp -> pid.sp", "pid -> valve"])
    numbers = read(VECTORS / "catalogue.json")["parameters"]
    graph["pid.mode"] = modules.Mode.EXTERNAL

    def update(pv: float, sp: float, sp_rate: float, rate: float, h: float) -> list[float]:
        refused = 0
        try:
            graph["pid.sp_rate"], graph["pid.rate"] = sp_rate, rate
        except ValueError as error:
            refused = next(numbers[name] for name in re.findall(r"(\w+) = ", str(error)))
        graph.scan(pv=pv, sp=sp, h=h)
        return [graph["pid.out"], graph["pid.ysp"], refused, graph["pid.d_hat"], graph["pid.count"]]

    return update


def pid_tuner(params: dict[str, float]) -> Callable[..., list[float]]:
    tuned = ("amplitude", "wait", "longest", "pv_low", "pv_high")
    given = {f"tune_{name}" if name in tuned else name: value for name, value in params.items()}
    named = {
        **{name: modules.Input() for name in ("pv", "sp")},
        "pid": modules.PidAdvanced(**given, tune_rule=modules.TuneRule.AMIGO_PI),
        "valve": modules.Output(),
    }
    graph = modules.Graph(0.2, named, ["pv -> pid.pv", "sp -> pid.sp", "pid -> valve"])
    found = ("tune_phase", "tune_stop", "tune_ku", "tune_tu", "tune_kp", "tune_kappa", "k", "ti", "td")

    def update(pv: float, sp: float, mode: float, flags: float, tune: float, take: float, h: float) -> list[float]:
        if take:
            graph.take_over("pid")
        _set(graph, "pid", mode=mode, tune=tune)
        _set(graph, "valve", flags=flags)
        graph.scan(pv=pv, sp=sp, h=h)
        return [graph[f"pid.{name}"] for name in ("out", "ysp", *found)]

    return update


def auto_tuner_module(params: dict[str, float]) -> Callable[..., list[float]]:
    named = {name: modules.Input() for name in ("x", "pv")} | {"valve": modules.Output()}
    graph = modules.Graph(
        0.2, named | {"tuner": modules.AutoTuner(**params)}, ["x -> tuner -> valve", "pv -> tuner.pv"]
    )
    numbers = read(VECTORS / "catalogue.json")["parameters"]
    wish = 0.0

    def update(
        x: float, pv: float, run: float, flags: float, tracking: float, amplitude: float, h: float
    ) -> list[float]:
        nonlocal wish
        refused = 0
        try:
            graph["tuner.amplitude"] = amplitude
        except ValueError as error:
            refused = next(numbers[name] for name in re.findall(r"(\w+) = ", str(error)))
        if run != wish:
            wish = graph["tuner.run"] = run
        graph["valve.flags"], graph["valve.tracking"] = flags, tracking
        graph.scan(x=x, pv=pv, h=h)
        backward = [graph[f"x.{name}"] for name in ("flags", "tracking")]
        shown = [graph[f"tuner.{name}"] for name in ("phase", "stop", "ku", "tu", "kp", "kappa")]
        return [graph["tuner.out"], *backward, *shown[:2], refused, *shown[2:]]

    return update


# The outputs of these are exact, computed in rational numbers: a double may differ in its last digits.
EXACT = {"tuning"}


@pytest.mark.slow
@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_block_meets_its_cases_to_the_last_bit(path: Path) -> None:
    """A block is made by the function here that has the file's name."""
    maker = globals()[path.stem]
    for case in read(path)["cases"]:
        update = maker(case["params"])
        for i, (sample, expected) in enumerate(zip(case["input"], case["output"], strict=True)):
            h = case.get("h")
            values = [math.nan if x is None else x for x in (sample if isinstance(sample, list) else [sample])]
            output = update(*values, h[i] if isinstance(h, list) else h)
            if path.stem in EXACT:
                assert output == pytest.approx(expected, rel=1e-14, abs=0), (case["id"], i)
            else:
                assert written(output) == written(expected), (case["id"], i)


def written(output: Any) -> list[str] | None:
    """repr tells apart what == does not: −0 and 0, and it lets NaN equal itself. A single null is not a number."""
    if isinstance(output, list | tuple):
        return [repr(math.nan if x is None else float(x)) for x in output]
    return None if output is None or math.isnan(output) else [repr(float(output))]
