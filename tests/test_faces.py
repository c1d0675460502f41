"""One answer, made once: every interface shows the core's decision, field by field."""

import json
from collections.abc import Iterator
from dataclasses import asdict
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import glapp
from glapp import _glapp
from glapp.document import LoopAnswer, to_json
from glapp.fleet import windows as fleet
from glapp.report import view as report
from glapp.report import words
from glapp.result import Result
from glapp.scenario import Friction
from glapp.simulate import closed_loop

service = pytest.importorskip("service")
estimate = import_module("glapp.estimate")  # the package has a function of this name

SPANS: list[dict[str, Any]] = [
    {},
    {"op_span": (0, 100), "acceptable_dead_band": 1.0},
    {"op_span": (0, 100), "acceptable_dead_band": 6.0},
    {"op_span": (4, 20), "op_unit": "mA"},
    {"op_span": (0, 500), "op_unit": "rpm", "acceptable_dead_band": 0.5},
    {"op_unit": "rpm"},
]
"""Knowledge of OP: limits given and not, spans of other units, no span."""


def recordings(count: int) -> Iterator[glapp.Recording]:
    """Short recordings of every kind: gaps, none, friction, reversed action, no SP, no OP, manual, unusable."""
    for i in range(count):
        random = np.random.default_rng(i)
        kind = ("gap", "none", "friction", "steps", "no_sp", "no_op", "constant", "manual", "cascade", "few")[i % 10]
        # The sign of gain and controller: a direct-acting loop is as good.
        sign = -1.0 if i % 7 == 3 else 1.0
        d = 0.0 if kind == "none" else float(random.uniform(0.5, 4.0))
        end = 30.0 if kind == "few" else 500.0 + 60.0 * (i % 5)
        sim = closed_loop(
            ([0.8 * sign], [8.0, 1.0], 0.0),
            (1.2 * sign, 10.0),
            d=d,
            friction=Friction(model="kano", s=2.0, j=1.0) if kind == "friction" else None,
            noise=0.02,
            h=1.0,
            t_end=end,
            seed=i,
            setpoint=[(0, 40.0), (100, 42.0), (220, 39.0), (340, 41.0)],
            load=[(60.0, 1.5), (180.0, -1.0), (300.0, 0.8), (430.0, -1.2)],
            manual=[(300.0, 400.0, 52.0), (400.0, 500.0, 55.0)] if kind == "manual" else (),
        )
        known = SPANS[i % len(SPANS)]
        scale = 0.16 if known.get("op_unit") == "mA" else 1.0
        op = np.full(len(sim.t), 50.0) if kind == "constant" else sim.op * scale + (4.0 if scale < 1.0 else 0.0)
        loop = glapp.Loop(
            name=f"LOOP{i}",
            controller={"k": 1.2 * scale, "ti": 10.0, "action": "reverse" if sign > 0 else "direct"} if i % 3 else None,
            cascade={"role": "primary"} if kind == "cascade" else None,
            **known,
        )
        signals = {"t": sim.t, "PV": sim.pv}
        signals |= {} if kind == "no_sp" else {"SP": sim.sp}
        signals |= {} if kind == "no_op" else {"OP": op}
        signals |= {"MODE": np.where(sim.flags & 1, 0.0, 1.0)} if kind == "manual" else {}
        yield glapp.recording_from(signals, loop)


def decided(recording: glapp.Recording) -> dict[str, Any]:
    """The one answer as the core decides it."""
    beginning = recording.beginning(10**6)
    loop = estimate.with_op_unit(recording.loop, beginning)
    analysis = _glapp.Analysis(json.dumps(estimate._task(loop) | {"trust": False, "fit": True}), beginning)
    analysis.take(beginning)
    answer: dict[str, Any] = analysis.finish(None)["answer"]["answer"]
    return answer


def plain(value: Any) -> Any:
    """A value in JSON's types."""
    return json.loads(json.dumps(value))


def differences(core: Any, face: Any, at: str) -> list[str]:
    """Every field in which an interface differs; added words are no difference."""
    if isinstance(core, dict):
        return [found for key, value in core.items() for found in differences(value, face[key], f"{at}.{key}")]
    if isinstance(core, list):
        pairs = zip(core, face, strict=True)
        return [found for i, (one, other) in enumerate(pairs) for found in differences(one, other, f"{at}[{i}]")]
    return [] if core == face else [f"{at}: the core says {core!r}, the face {face!r}"]


def columns_of(core: dict[str, Any], face: dict[str, Any], names: dict[str, str], at: str) -> list[str]:
    """The column of a flat face for each field of the core."""
    return [found for key, name in names.items() for found in differences(core[key], face[name], f"{at} {name}")]


def of_fleet(result: Result) -> dict[str, Any]:
    """The row of a lake's table."""
    day = dict.fromkeys(("unfit", "unfit_code", "unfit_reason", "usable", "step", "quality"), None)
    day |= {"day": 0, "first": 0, "last": 1, "rows": 1, "op": True}
    heard = {
        **dict.fromkeys(("k", "ti", "td", "tf")),
        "crossings": result.crossings,
        "crossings_code": result.why,
        "crossings_reason": result.reason,
        "d_hat": result.d_hat,
        "detections": result.detections,
        "rejected": json.dumps(result.reasons),
    }
    return fleet._loop_row(result.loop, [day], heard, result.fit, [])


FLEET = {
    **{name: name for name in ("verdict", "valve", "confidence", "cause", "width_kind", "width", "low", "high")},
    **{name: name for name in ("evidence", "acceptable", "urgency", "health")},
    "width_percent_span": "width_percent",
    "low_percent_span": "low_percent",
    "high_percent_span": "high_percent",
}
SERVICE = {"verdict": "verdict", "width": "d", "low": "low", "high": "high", "compensable": "compensable"}
OPC_UA = {
    "verdict": "Verdict",
    "confidence": "Confidence",
    "width": "Width",
    "low": "Low",
    "high": "High",
    "urgency": "Urgency",
}


def faces(recording: glapp.Recording, folder: Path) -> list[str]:
    """Texts of every interface on a recording, where they are not the core's decision."""
    from glapp.service.fits import row_of
    from glapp.service.monitor import Monitor
    from glapp.service.options import MonitorOptions
    from glapp.service.server import node_values
    from glapp.service.store import Store
    from glapp.station.view import View

    core, result = plain(decided(recording)), glapp.analyze(recording)
    found = differences(core, plain(asdict(result.answer)), "notebook")
    document = json.loads(to_json([result]))["loops"][0]
    LoopAnswer.model_validate(document)
    found += differences(core, document["answer"], "JSON")
    # A lake keeps nothing of a step test, nor of one recording's harm: its own windows have that.
    row = plain(of_fleet(result))
    found += columns_of(core, row, FLEET, "fleet")
    found += differences(core["next"]["code"], row["next"], "fleet next")
    limit = None if core["limit"] is None else core["limit"]["percent_span"]
    found += differences(limit, row["acceptable_percent"], "fleet limit")

    store = Store(folder)
    clock = service.Clock()
    try:
        store.know([result.loop])
        kept = row_of(result, 0.0, 1.0)
        found += columns_of(core, kept, SERVICE, "database")
        store.add_answer(result.name, {"time": clock(), "asked_by": "the night", **kept})
        monitor = Monitor([result.loop], store, options=MonitorOptions(), clock=clock)
        status = monitor.status()["loops"][result.name]
        store.show(clock(), json.dumps(monitor.status()))
        nodes = {name: value.value for name, value in node_values(status).items()}
        found += columns_of(core, nodes, OPC_UA, "OPC UA")
        station = View(folder, clock)
        station.refresh()
        one = station.answer(result.name)
        assert one is not None
        found += differences(core, one, "window")
        [shown] = station.rows()
        found += differences(core["width_percent_span"], shown.percent, "window percent")
        verdict = words.named(core["confidence"], core["verdict"])
        found += differences(verdict, shown.verdict, "window verdict")
    finally:
        store.close()
    drawn = report.bar(result)
    if drawn is not None:
        found += differences(limit, drawn.acceptable, "report limit")
        found += differences(core["width_percent_span"], drawn.width, "report width")
    return [f"{recording.name}: {one}" for one in found]


def walked(count: int, folder: Path) -> list[str]:
    return [one for i, recording in enumerate(recordings(count)) for one in faces(recording, folder / str(i))]


@pytest.mark.slow
def test_every_face_shows_what_the_core_decided(tmp_path: Path) -> None:
    assert walked(12, tmp_path) == []


@pytest.mark.verify
def test_two_hundred_recordings_through_every_face(tmp_path: Path) -> None:
    assert walked(200, tmp_path) == []


@pytest.mark.slow
def test_a_face_that_decides_by_itself_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The lake once held loops to a limit of its own, and the service stored a width that the answer had not."""
    from glapp.service import fits

    planted = fits.row_of
    monkeypatch.setattr(fits, "row_of", lambda *given: planted(*given) | {"d": 0.0031})
    faults = walked(3, tmp_path)
    assert faults and all("database d" in one or "OPC UA Width" in one for one in faults), faults
