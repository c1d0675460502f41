"""The golden cases of vectors/: current, well-formed, and met by the blocks as Python has them."""

import importlib.util
import json
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from glapp.blocks import Backlash, Noise, Pid

VECTORS = Path(__file__).parents[1] / "vectors"
FILES = sorted(path for path in VECTORS.glob("*.json") if path.name != "schema.json")


def read(path: Path) -> dict[str, Any]:
    return json.loads(path.read_text(encoding="utf-8"))


def test_files_are_what_the_generator_writes() -> None:
    spec = importlib.util.spec_from_file_location("make", VECTORS / "make.py")
    assert spec is not None and spec.loader is not None
    make = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(make)
    documents = make.documents()
    assert sorted(documents) == [path.name for path in FILES]
    for path in FILES:
        assert path.read_text(encoding="utf-8") == documents[path.name], "run: python vectors/make.py"


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_file_follows_the_schema_and_explains_its_flags(path: Path) -> None:
    file = read(path)
    jsonschema.validate(file, read(VECTORS / "schema.json"))
    assert file["block"] == path.stem
    assert {flag for case in file["cases"] for flag in case["flags"]} == set(file["notes"])
    for case in file["cases"]:
        assert len(case["input"]) == len(case["output"])
        assert all(math.isfinite(x) for x in flat(case["input"]) if x is not None)


def flat(values: list[Any]) -> Iterator[float | None]:
    for value in values:
        yield from value if isinstance(value, list) else [value]


def backlash(params: dict[str, float]) -> Callable[..., float]:
    block = Backlash(params["d"], params.get("output"))
    return lambda x, h: block.update(x)


def noise(params: dict[str, float]) -> Callable[..., float]:
    block = Noise(params["amplitude"], int(params["integer"]))
    return lambda x, h: block.update(x)


def pid(params: dict[str, float]) -> Callable[..., float]:
    limits = (params["low"], params["high"]) if "low" in params else None
    block = Pid(params["k"], params["ti"], params["td"], params["b"], limits)
    return lambda ysp, y, u, h: block.update(ysp, y, h) if math.isnan(u) else block.track(ysp, y, u, h)


@pytest.mark.parametrize("make", [backlash, noise, pid], ids=lambda make: make.__name__)
def test_block_meets_its_cases_to_the_last_bit(make: Callable[[dict[str, float]], Callable[..., float]]) -> None:
    for case in read(VECTORS / f"{make.__name__}.json")["cases"]:
        update = make(case["params"])
        for i, (sample, expected) in enumerate(zip(case["input"], case["output"], strict=True)):
            h = case.get("h")
            values = [math.nan if x is None else x for x in (sample if isinstance(sample, list) else [sample])]
            output = update(*values, h[i] if isinstance(h, list) else h)
            # repr tells apart what == does not: −0 and 0, and it lets NaN equal itself.
            assert repr(output) == repr(math.nan if expected is None else expected), (case["id"], i)
