"""Learn the weights of the evidence for a dead band, and judge them: `python -m bench.weigh`.

Records of the four corpora whose truth is known are asked, and the evidence that the fit has for each goes to
out/weigh.jsonl as soon as it is there; what the file has is not asked again. `--answers FILE` takes the evidence from
files of `bench.ordinary` beside them. Then the tables are printed. `--learn` writes the weights into
crates/fit/src/decide/weights.rs; build again afterwards.

Part F of `bench.ordinary` judges, and nothing is chosen on it. All other records are for learning.
"""

from __future__ import annotations

import os

os.environ.setdefault("RAYON_NUM_THREADS", "1")  # many processes, each with its own core
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import json
import sys
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import replace
from pathlib import Path

import numpy as np
from rich.progress import track

from glapp import _glapp

from ..ordinary.design import JUDGE
from ..page import write
from .model import balanced
from .samples import Sample, ask, done, names, of_answers, read, version
from .score import Data, tables
from .table import WEIGHTS, rust

OUT = Path(__file__).parents[2] / "out" / "weigh.jsonl"


def collect(path: Path, rounds: int, jobs: int) -> None:
    """Ask about the records that the file lacks."""
    known = done(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    left = [name for name in names(rounds) if name not in known]
    with ProcessPoolExecutor(jobs) as pool, path.open("a", encoding="utf-8") as file:
        asked = [pool.submit(ask, name) for name in left]
        for future in track(as_completed(asked), "asking", len(asked), disable=not sys.stderr.isatty()):
            sample = future.result()
            if sample is not None:
                print(sample.to_json(), file=file, flush=True)


def columns(samples: list[Sample]) -> Data:
    """The samples that can be weighed, in columns: the record can be read, and noise does not hide its gap.

    Their rung is that of today's ladder.
    """
    kept, quantities, odds, names, rises = [], [], [], [], []
    for sample in samples:
        found = _glapp.fit_weighed(json.dumps(sample.evidence))
        if found["log_bayes_factor"] is None or not sample.resolvable:
            continue
        names = list(found["quantities"])
        rises = [up for _, up, _ in found["quantities"].values()]
        quantities.append([x for x, _, _ in found["quantities"].values()])
        odds.append(found["log_bayes_factor"])
        said = _glapp.fit_judgement(json.dumps(sample.evidence))["confidence"]
        kept.append(replace(sample, confidence=said))
    gap = np.array([sample.gap for sample in kept])
    weight = balanced(gap, np.array([sample.row for sample in kept]))
    return Data(kept, names, np.array(quantities), np.array(rises), np.array(odds), gap, weight)


def main() -> None:
    """Ask, learn, print."""
    parser = argparse.ArgumentParser(prog="python -m bench.weigh", description=__doc__.split("\n\n")[0])
    parser.add_argument("--rounds", type=int, default=10, help="so many rounds, about 100 records each; 0: ask nothing")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="processes")
    parser.add_argument("--out", type=Path, default=OUT)
    parser.add_argument("--answers", type=Path, nargs="+", default=[], help="answers of bench.ordinary")
    parser.add_argument("--learn", action="store_true", help="write the learned weights into the crate")
    parser.add_argument("--docs", action="store_true", help="write the tables into bench/results/weigh.md")
    given = parser.parse_args()
    if given.rounds:
        collect(given.out, given.rounds, given.jobs)
    samples = read(given.out) if given.out.exists() else []
    data = columns(samples + [sample for path in given.answers for sample in of_answers(path)])
    text = tables(data)
    print(text)
    if given.docs:
        write("weigh.md", text, "tables")
    if given.learn:
        learned = data.of(data.group(lambda s: s.half) != JUDGE)
        lines = learned.lines()
        of = f"fit {version()}, {len(learned.samples)} records"
        WEIGHTS.write_text(rust(data.names, lines, of), encoding="utf-8")


if __name__ == "__main__":
    main()
