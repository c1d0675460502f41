"""The laboratory: simulated modules in real time and faster, every variable live."""

import asyncio
import math
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from types import SimpleNamespace

import pytest

from glapp.errors import InputError
from glapp.station.lab import AT_ONCE, FASTEST, KEPT, KINDS, THESIS, Lab, Part, Project, diagram


def test_the_loop_of_the_thesis_shows_its_gap() -> None:
    lab = Lab(THESIS)
    lab.speed = FASTEST
    lab.advance(1.1)
    assert lab.t == pytest.approx(1100.0)
    d_hat = lab["watch.d_hat"]
    assert d_hat is not None and 1.7 < d_hat < 2.2 and lab["gap.d"] == 2.0


def test_time_goes_by_the_wall_whatever_the_steps() -> None:
    """No scan is lost to rounding, and none is early."""
    lab = Lab(THESIS)
    wall = 0.0
    for k in range(500):
        step = 0.013 + 0.001 * (k % 17)
        wall += step
        lab.advance(step)
        assert -1e-9 <= wall - lab.t < 0.1 + 1e-9
    lab.running = False
    lab.advance(10.0)
    assert wall - lab.t < 0.1 + 1e-9


def test_it_keeps_real_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """The speed does not depend on the ticks: here of a clock that goes on by uneven steps."""
    pytest.importorskip("nicegui")
    from glapp.station import lab_page

    bench, now, off = lab_page.Bench(), 1000.0, []
    lab = bench.of("one")

    async def sleep(seconds: float) -> None:
        nonlocal now
        if len(off) == 500:
            raise StopAsyncIteration
        off.append(now - 1000.0 - (lab.t - lab_page.BEGUN))
        now += seconds + 0.003 * (len(off) * 7 % 11)
        bench.put("one", lab)

    monkeypatch.setattr(lab_page, "time", SimpleNamespace(monotonic=lambda: now))
    monkeypatch.setattr(lab_page, "asyncio", SimpleNamespace(sleep=sleep))
    with pytest.raises(StopAsyncIteration):
        asyncio.run(bench.go_on())
    assert lab.t > lab_page.BEGUN + 15.0 and all(-1e-9 <= one < lab.project.h + 1e-9 for one in off)


@pytest.mark.slow
def test_everybody_has_one_and_the_one_left_longest_ago_goes_first() -> None:
    pytest.importorskip("nicegui")
    from glapp.station.lab_page import MOST, Bench

    bench = Bench()
    first = bench.of("one")
    assert bench.of("one") is first and bench.of("two") is not first
    for i in range(MOST):
        bench.of(f"more{i}")
    assert bench.of("one") is not first


def test_every_variable_that_may_be_set_is_set_while_it_runs() -> None:
    lab = Lab(THESIS)
    lab.speed = 100.0
    lab.advance(0.1)
    assert len(lab.editable) > 40 and len(lab.paths) > 100
    for path in sorted(lab.editable):
        value = lab[path]
        lab[path] = value
        lab.advance(0.01)
    lab["gap.d"] = 3.0
    lab["noise.amplitude"] = 0.0
    lab["watch.comp_share"] = 0.5
    lab.advance(0.1)
    assert (lab["gap.d"], lab["noise.amplitude"], lab["watch.comp_share"]) == (3.0, 0.0, 0.5)


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [("gap.d", -1.0, "gap"), ("gap.out", 1.0, "only shown"), ("watch.n", 4.0, "odd"), ("nothing.d", 1.0, "only shown")],
)
def test_what_cannot_be_is_refused_and_all_is_as_it_was(path: str, value: float, message: str) -> None:
    lab = Lab(THESIS)
    before = {one: lab[one] for one in lab.paths}
    with pytest.raises(InputError, match=message):
        lab[path] = value
    assert {one: lab[one] for one in lab.paths} == before


def test_what_is_drawn_is_bounded() -> None:
    lab = Lab(THESIS)
    lab.speed = FASTEST
    for _ in range(10):
        lab.advance(1.0)
    points = lab.curves(600.0)
    assert set(points) == set(THESIS.shown) and all(1000 < len(one) <= 1200 for one in points.values())
    assert points["noise"][-1][0] == pytest.approx(lab.t, abs=1.0) and len(lab._times) == KEPT
    lab.shown = ("gap",)
    lab.advance(0.1)
    assert list(lab.curves(600.0)) == ["gap"]
    lab.advance(60.0)  # the window stood still for a minute
    assert lab.late == pytest.approx(60_000.0 - AT_ONCE * 0.1, abs=1.0)


def test_a_loop_from_a_form() -> None:
    parts = (Part("step", "Input", "value=1"), Part("lag", "Filter2P", "tf=2"), Part("end", "Output"))
    lab = Lab(Project(0.5, parts, ("step -> lag -> end",), ("lag", "no such thing")))
    lab.advance(60.0)
    assert lab["lag.out"] == pytest.approx(1.0, abs=1e-3) and lab.shown == ("lag",)


@pytest.mark.parametrize(
    ("project", "message"),
    [
        (replace(THESIS, parts=(*THESIS.parts, Part("sp", "Input"))), "sp: is there twice"),
        (replace(THESIS, parts=(*THESIS.parts, Part("new", "Nothing"))), "no 'Nothing'"),
        (replace(THESIS, parts=(*THESIS.parts, Part("new", "Pid", "k=two"))), "k of new: is 'two'"),
        (replace(THESIS, parts=(*THESIS.parts, Part("new", "Pid"))), "new: Pid"),
        (replace(THESIS, parts=(*THESIS.parts, Part("new", "Filter2P", "tf=1"))), "new"),
        (replace(THESIS, wires=THESIS.wires[1:]), "connect it"),
        (replace(THESIS, h=0.0), "scan time|h"),
    ],
)
def test_what_is_no_loop_is_refused_with_its_place(project: Project, message: str) -> None:
    with pytest.raises(InputError, match=message):
        Lab(project)


def test_every_kind_can_be_made_by_a_form() -> None:
    """The form is filled with nothing but numbers."""
    needed = {
        "Noise": "amplitude=1",
        "Resolution": "step=1",
        "Delay": "scans=2",
        "Backlash": "d=1",
        "Saturation": "low=0, high=1",
        "RateLimit": "rate=1",
        "Filter2P": "tf=1",
        "PhaseLead": "lead=2, lag=1",
        "ProcessSim": "gain=1, t1=1",
        "Pid": "k=1, ti=1",
        "PidAdvanced": "k=1, ti=1",
        "BacklashDetection": "k=1, ti=1, n=9",
    }
    for kind in KINDS:
        try:
            made = Part("one", kind, needed.get(kind, "")).module()
        except InputError as error:  # what must be given, is named
            assert "required" in str(error), kind
        else:
            assert type(made) is KINDS[kind]


def test_blocks_are_drawn_and_names_are_no_markup() -> None:
    odd = replace(THESIS, parts=(Part("<b>&", "Input"), *THESIS.parts), wires=("<b>& -> gap.x", *THESIS.wires))
    root = ElementTree.fromstring(diagram(odd))
    texts = [one.text for one in root.iter() if one.tag == "text"]
    assert "<b>&" in texts and texts.count("Pid") == 1 and len(list(root.iter("rect"))) == 9
    boxes = [(float(one.get("x", "0")), float(one.get("y", "0"))) for one in root.iter("rect")]
    assert len(set(boxes)) == len(boxes)


@pytest.mark.slow
def test_it_has_no_way_to_the_service() -> None:
    """The laboratory imports nothing of the service, the API or the network."""
    import subprocess
    import sys

    code = (
        "import sys, glapp.station.lab; "
        "print([name for name in sys.modules if name.startswith('glapp.service') or name in ('httpx', 'asyncua')])"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"


@pytest.mark.parametrize(("size", "calmer", "standing"), [(1.0, True, 0.0), (4.0, False, 11.0)])
def test_compensation_calms_and_too_much_is_withdrawn(size: float, calmer: bool, standing: float) -> None:
    """Half of the gap is compensated, or twice of it: 0 is active, 11 worse."""
    lab = Lab(THESIS)
    lab.speed = FASTEST

    def spread(seconds: float) -> float:
        for k in range(round(seconds / 200.0)):
            lab["load.value"] = 5.0 * (k % 2)
            lab.advance(0.2)
        pv = [x - 50.0 for _, x in lab.curves(1000.0, KEPT)["noise"]]
        return math.sqrt(sum(x * x for x in pv) / len(pv))

    before = spread(1400.0)
    for path, value in (("watch.comp_limit", size), ("watch.comp_size", size), ("watch.compensate", 1.0)):
        lab[path] = value
    since = spread(2000.0)
    assert lab["watch.standing"] == standing
    assert (since < 0.9 * before) is calmer and (lab["watch.u_ff"] == 0.0) is not calmer
