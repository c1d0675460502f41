"""Answers of the public programs on a recording: run by `bench/run.py` in an environment of their own.

`stictionanalyser` is an add-on of a commercial server. As installed it cannot be imported: its screen needs names that
IPython and ipyvuetify no longer have, and its analysis imports the server's module, of which nothing is called between
signals and answer. So the analysis is entered where the add-on's own button enters it, without the screen, and with an
empty module in the server's place.
"""

from __future__ import annotations

import contextlib
import io
import json
import sys
import time
import types
import warnings
from collections.abc import Callable
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pandas as pd


def stictionanalyser(t: pd.Series, sp: pd.Series, pv: pd.Series, op: pd.Series) -> str:
    """Share of cycles that look like stiction, and their magnitude."""
    import seeq

    seeq.spy = sys.modules["seeq.spy"] = types.ModuleType("seeq.spy")
    addon = sys.modules["seeq.addons.stictionanalyser"] = types.ModuleType("seeq.addons.stictionanalyser")
    addon.__path__ = [f"{folder}/addons/stictionanalyser" for folder in seeq.__path__]
    from seeq.addons.stictionanalyser._CreatePVOP import CreatePVOP

    index = pd.DatetimeIndex(t)
    error = pd.Series((sp - pv).to_numpy(), index)
    output = pd.Series(op.to_numpy(), index)
    results, _ = CreatePVOP(error, output, 0, output, error)
    if isinstance(results, str) or not results:
        return "no oscillation found"
    stiction = cycles = 0
    sizes: list[float] = []
    for i, item in enumerate(results):
        if isinstance(item, str) and " / " in item:
            some, one_more_than_all = item.split(" / ")
            stiction += int(some)
            cycles += int(one_more_than_all) - 1
            found = results[i + 1]
            sizes += [found[k + 1] for k, x in enumerate(found) if x == "magnitude"] if found != "none" else []
    return f"stiction in {stiction} of {cycles} cycles" + (f", {np.mean(sizes):.3g} %" if sizes else "")


def xmci(t: pd.Series, sp: pd.Series, pv: pd.Series, op: pd.Series) -> str:
    """Indicators of valve wear by xmci; it has no verdict and no width."""
    from xmci import ControlLoop, MetricFactory, MetricType

    data = {
        "mode": np.ones(len(t)),
        "op": op.to_numpy(),
        "pv": pv.to_numpy(),
        "sp": sp.to_numpy(),
        "timestamp": [x.to_pydatetime() for x in t],
    }
    loop = ControlLoop("loop", data, {})
    for kind in MetricType:
        loop.add_metric(kind, MetricFactory.create(kind))
    found = loop.analyze()["metrics"]
    travel, turns = found[MetricType.VALVE_TRAVEL], found[MetricType.VALVE_REVERSALS]
    return f"travel {3600 * travel:.3g} %/h, {3600 * turns:.3g} reversals/h; no verdict, no width"


def main() -> None:
    """Time each program on each recording; JSON to stdout."""
    warnings.simplefilter("ignore")
    answers = []
    for path in sys.argv[1:]:
        table = pd.read_csv(path)
        t = table["t"]
        if pd.api.types.is_numeric_dtype(t):
            t = pd.Series([datetime(2024, 1, 1) + timedelta(seconds=float(x)) for x in t])
        else:
            t = pd.to_datetime(t)
        programs: list[Callable[..., str]] = [stictionanalyser, xmci]
        for program in programs:
            begun = time.perf_counter()
            try:
                with contextlib.redirect_stdout(io.StringIO()):
                    answer = program(t, table["SP"], table["PV"], table["OP"])
            except Exception as error:
                answer = f"stops with {type(error).__name__}: {error}"
            answers.append((program.__name__, Path(path).stem, time.perf_counter() - begun, answer))
    print(json.dumps(answers))


if __name__ == "__main__":
    main()
