"""Make the page: one folder, no server, nothing to load from anywhere.

Words, names and patterns are those of the Python package, taken from it here; charts and the reading of packed and
other files are npm's, as `package-lock.json` says; analysis, fit and simulator are `crates/page` for WebAssembly.

    python page/build.py OUT
    python page/build.py --reader    only what is npm's, for the tests of the reader
"""

from __future__ import annotations

import base64
import gzip
import hashlib
import html.entities
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

import glapp
from glapp import demo
from glapp.reading import (
    bounds,
    columns,
    csv,
    heads,
    influx,
    kin,
    long,
    meaning,
    names,
    not_tables,
    shape,
    structured,
    times,
    values,
    wide,
)
from glapp.report import figures, words
from glapp.simulate import COMPENSATION_STATES
from glapp.station import lab

HERE = Path(__file__).parent
ROOT = HERE.parent
TARGET = "wasm32-unknown-unknown"
BUILT = ROOT / "target" / "page"

#: The reader of files, in the order in which its scripts use each other.
READER = ("sheets", "names", "cells", "heads", "tables", "structured", "markup", "influx", "shape", "read")

#: Debian's compiler and the source of its standard library, where the first compiler has none for WebAssembly.
DEBIAN = Path("/usr/bin/rustc")


class Missing(Exception):  # noqa: N818 (its text is printed, and the page is left out)
    """A tool that this machine lacks to make the page."""


def toolchain() -> tuple[list[str], dict[str, str]]:
    """Arguments of cargo and its environment: a compiler with WebAssembly's standard library, or with its source."""

    def asked(rustc: str, *what: str) -> Path:
        return Path(
            subprocess.run([rustc, "--print", *what], capture_output=True, text=True, check=True).stdout.strip()
        )

    ours = os.environ.get("RUSTC", "rustc")
    if asked(ours, "target-libdir", "--target", TARGET).is_dir():
        return [], {}
    for rustc in (ours, str(DEBIAN)):
        if shutil.which(rustc) and (asked(rustc, "sysroot") / "lib/rustlib/src/rust/library/Cargo.lock").is_file():
            # The linker of the first compiler, which every toolchain of rustup has.
            linker = next(asked("rustc", "sysroot").glob("lib/rustlib/*/bin/rust-lld"), None) or shutil.which("wasm-ld")
            if linker is None:
                raise Missing("rust-lld or wasm-ld")
            more = {"RUSTC": rustc, "RUSTC_BOOTSTRAP": "1", "CARGO_TARGET_WASM32_UNKNOWN_UNKNOWN_LINKER": str(linker)}
            return ["-Zbuild-std=std,panic_abort"], more
    raise Missing(
        f"a standard library for {TARGET}: rustup target add {TARGET}, or on Debian apt-get install rustc-web "
        f"rust-web-src"
    )


def wasm() -> bytes:
    """`crates/page` for WebAssembly; the same bits as elsewhere: nothing is fused there."""
    more, environment = toolchain()
    # A folder of its own: another compiler would make all in the usual one anew.
    # Beside a crate for Rust, which its tests need, nothing would be optimised across crates.
    command = ["cargo", "rustc", "--quiet", "--release", "--package", "glapp-page", "--lib", "--crate-type", "cdylib"]
    command += ["--target", TARGET, "--target-dir", str(BUILT), *more]
    environment |= {"RUSTFLAGS": "-C target-feature=+simd128 -C panic=abort -C strip=symbols"}
    # make tells cargo by open files how many processors it may use.
    subprocess.run(command, cwd=ROOT, env=os.environ | environment, check=True, close_fds=False)
    return (BUILT / TARGET / "release" / "glapp_page.wasm").read_bytes()


def loaded() -> Path:
    """Scripts from npm."""
    if not shutil.which("npm"):
        raise Missing("npm")
    BUILT.mkdir(parents=True, exist_ok=True)
    lock, done = HERE / "package-lock.json", BUILT / ".npm"
    if not done.is_file() or done.read_bytes() != lock.read_bytes():
        for path in (HERE / "package.json", lock):
            shutil.copy(path, BUILT)
        command = ["npm", "ci", "--no-audit", "--no-fund", "--loglevel=error"]
        subprocess.run(command, cwd=BUILT, stdout=subprocess.DEVNULL, check=True)
        shutil.copy(lock, done)
    for name in ("formats.mjs", "buffer.mjs"):
        shutil.copy(HERE / name, BUILT)
    bundle = ["formats.mjs", "--bundle", "--minify", "--format=iife", "--global-name=Formats", "--inject:buffer.mjs"]
    command = ["node_modules/.bin/esbuild", *bundle, "--outfile=formats.js", "--log-level=warning"]
    subprocess.run(command, cwd=BUILT, check=True)
    return BUILT / "node_modules"


def in_javascript(pattern: str) -> str:
    """A pattern of Python as JavaScript writes it; where case does not count is for the caller to say."""
    return re.sub(r"\(\?P=(\w+)\)", r"\\k<\1>", pattern.replace("(?P<", "(?<").replace("(?i:", "(?:"))


def entities() -> dict[str, str]:
    """The characters that HTML 4 and XML name, and those names that need no semicolon."""
    known = html.entities.name2codepoint.keys() | {"apos"}
    return {name: text for name, text in html.entities.html5.items() if name.rstrip(";") in known or ";" not in name}


def reader_data() -> dict[str, Any]:
    """Data of the reader of text: names of columns, words, layouts of times."""
    return {
        "columns": {
            "labels": columns.LABELS,
            "words": names.SIGNALS,
            "whole": names.WHOLE,
            "weak": names.WEAK,
            "current": sorted(names.CURRENT),
            "limits": sorted(names.LIMITS),
            "separators": meaning._SEPARATORS,
            "joined": meaning._JOINED.pattern,
            "token": meaning._TOKEN.pattern,
            "unit": meaning._UNIT.pattern,
            "field": meaning._FIELD.pattern,
            "host": meaning._HOST.pattern,
            "sure": meaning.SURE,
            "unit_columns": sorted(names.UNIT_COLUMNS),
            "blocks": names.BLOCKS,
            "kinds": {kind: sorted(roles) for kind, roles in kin._OF.items()},
            "block": kin._BLOCK.pattern,
            "instrument": kin._INSTRUMENT.pattern,
        },
        "values": {
            "bad": sorted(names.MISSING),
            "auto": sorted(names.AUTO),
            "not_auto": sorted(names.NOT_AUTO),
            "good": sorted(names.GOOD),
            "poor": sorted(names.POOR),
            "validity": sorted(names.VALIDITY),
            "confidence": sorted(names.CONFIDENCE),
            "system": values._SYSTEM,
            "with_unit": values._WITH_UNIT.pattern,
            "number": values._NUMBER,
            "plain": values._PLAIN.pattern,
            "decimal_comma": values._DECIMAL_COMMA.pattern,
            "spaces": values._SPACES,
            "spaced": values._SPACED,
            "thousands": {group: values._thousands(group, other) for group, other in ((".", ","), (",", "."))},
            "grouped": {group: values._grouped(group) for group in (".", ",")},
        },
        "heads": {
            "number": heads._NUMBER.pattern,
            "lines": heads._LINES,
            "short": heads._SHORT,
            "ahead": heads._AHEAD,
            "units": sorted(names.UNITS),
            "same_units": names.SAME_UNITS,
            "any_unit": sorted(wide._ANY_UNIT),
            "sparse": wide._SPARSE,
            "footer": sorted(names.FOOTER),
            "facts": sorted(names.FACTS),
            "rule": "".join(sorted(heads._RULE)),
            "types": heads._TYPES,
        },
        "bounds": {"columns": bounds.COLUMNS, "cells": bounds.CELLS, "whole": bounds.WHOLE},
        "kinds": {"beginnings": not_tables.BEGINNINGS, "archives": not_tables.ARCHIVES},
        "shown": csv._SHOWN,
        "structured": {
            "lists": structured._LISTS,
            "sample": structured._SAMPLE,
            "hint": structured._HINT,
            "messages": structured._MESSAGES,
            "see": structured._SEE,
            "shown": structured._SHOWN,
        },
        "markup": {
            "login": not_tables.LOGIN.pattern,
            "title": not_tables.TITLE.pattern,
            "entities": entities(),
            "windows": "".join(html.unescape(f"&#{n};") for n in range(0x80, 0xA0)),
        },
        "influx": {
            "own": sorted(influx._OWN),
            "annotations": influx._ANNOTATIONS,
            "point": in_javascript(influx._POINT.pattern),
            "field": influx._FIELD.pattern,
        },
        "shape": {
            "pv_empty": shape._PV_EMPTY,
            "held_empty": shape._HELD_EMPTY,
            "own": shape._OWN,
            "rows": shape._ROWS,
            "groups": shape._GROUPS,
            "widest": shape._WIDEST,
            "midnight": shape._MIDNIGHT,
            "day_zero": shape._DAY_ZERO,
            "milliseconds": sorted(names.MILLISECONDS),
            "half": in_javascript(shape._HALF),
            "second": in_javascript(shape._SECOND.pattern),
            "days": shape._DAYS,
            "day_step": shape._DAY_STEP,
        },
        "long": {"common": long._COMMON, "more": long._MORE},
        "times": {
            "layout": in_javascript(times._LAYOUT.pattern),
            "of_day": times._OF_DAY.pattern,
            "names": times._CALENDARS,
            "months": names.MONTHS,
            "units": times._UNITS,
            "elapsed": times._ELAPSED,
            "calendars": times._TO_1970,
            "years": times._YEARS,
            "dated": sorted(times._DATED),
            "usual": times._USUAL,
        },
    }


#: The loop of 6.5 with friction beside its gap, which the station's has not.
PROJECT = lab.Project(
    lab.THESIS.h,
    (*lab.THESIS.parts, lab.Part("stick", "Friction", "s=0, j=0")),
    ("pid -> gap -> stick -> process -> noise -> filter -> pid.pv", *lab.THESIS.wires[1:]),
    (),
)

#: What is changed at once: label, variables, lowest and highest value, step.
KNOBS = (
    ("Setpoint [%]", ("sp.value",), 20, 80, 0.5),
    ("Load [%]", ("load.value",), -20, 20, 0.5),
    ("Noise [%]", ("noise.amplitude",), 0, 1, 0.01),
    ("Gap [%]", ("gap.d",), 0, 8, 0.1),
    ("Stiction S [%]", ("stick.s",), 0, 4, 0.1),
    ("Slip jump J [%]", ("stick.j",), 0, 4, 0.1),
    ("Gain K", ("pid.k", "watch.k"), 0.2, 6, 0.1),
    ("TI [s]", ("pid.ti", "watch.ti"), 0.5, 20, 0.1),
)


def of_laboratory() -> dict[str, Any]:
    """The loop that runs in the laboratory."""
    modules = [
        (part.name, part.kind, {key: value for key, value in _parameters(part) if value is not None})
        for part in PROJECT.parts
    ]
    return {
        "project": {"h": PROJECT.h, "modules": modules, "wires": PROJECT.wires},
        "knobs": [dict(zip(("label", "paths", "low", "high", "step"), knob, strict=True)) for knob in KNOBS],
        "fastest": lab.FASTEST,
        "most_at_once": 2000,
        "kept": lab.KEPT,
        "standings": [name.replace("_", " ") for name in COMPENSATION_STATES],
    }


def _parameters(part: lab.Part) -> list[tuple[str, float]]:
    given = (one.partition("=") for one in part.settings.split(",") if one.strip())
    return [(key.strip(), float(value)) for key, _, value in given]


def example() -> str:
    """The first hours of a recording of the demonstration."""
    with tempfile.TemporaryDirectory() as folder:
        demo.write_recordings(folder)
        lines = (Path(folder) / "FIC201.csv").read_text(encoding="utf-8").splitlines()
    return "\n".join(lines[:4001])


def in_script(text: str) -> Markup:
    """Text within a script element, which it must not end."""
    return Markup(text.replace("</", "<\\/"))


def in_json(value: Any) -> Markup:
    """JSON within a script element."""
    return Markup(json.dumps(value, ensure_ascii=False, separators=(",", ":")).replace("<", "\\u003c"))


def licence(package: Path) -> str:
    """Licence of a package from npm: its text, else its name."""
    texts = sorted(path for path in package.iterdir() if path.name.upper().startswith("LICEN"))
    if texts:
        return texts[0].read_text(encoding="utf-8")
    package_json = json.loads((package / "package.json").read_text(encoding="utf-8"))
    return f"{package_json['license']} licence, {package_json['author']}\n"


def build(out: Path) -> None:
    """Write the page."""
    npm, module = loaded(), wasm()
    style = [(ROOT / "python/glapp/report/report.css"), npm / "uplot/dist/uPlot.min.css", HERE / "style.css"]
    reasons = zip(words.NAMES, figures.REASON_COLOURS, strict=True)
    colours = "".join(f":root{{--r-{name}:{c}}}.r-{name}{{background:{c}}}" for name, c in reasons)
    kept = {"papaparse": npm / "papaparse/papaparse.min.js", "formats": BUILT / "formats.js"}
    kept |= {name: HERE / f"{name}.js" for name in (*READER, "engine", "worker")}
    run = [
        npm / "uplot/dist/uPlot.iife.min.js",
        ROOT / "python/glapp/station/static/shown.js",
        *(HERE / f"{n}.js" for n in ("engine", "words", "draw", "windows", "page", "lab")),
    ]
    scripts = [in_script(path.read_text(encoding="utf-8")) for path in run]
    # One script of them all: what each declares the next one sees.
    whole = Markup("\n").join(scripts)
    digest = base64.b64encode(hashlib.sha256(whole.encode()).digest()).decode()
    environment = Environment(
        loader=FileSystemLoader(HERE), undefined=StrictUndefined, autoescape=True, trim_blocks=True, lstrip_blocks=True
    )
    laboratory = environment.get_template("laboratory.html").render(
        fastest=f"{lab.FASTEST:g}", blocks=Markup(lab.diagram(PROJECT))
    )
    text = environment.get_template("index.html").render(
        hashes=Markup(f"'sha256-{digest}'"),
        style=Markup("\n".join(path.read_text(encoding="utf-8") for path in style) + colours),
        laboratory=Markup(laboratory),
        version=glapp.__version__,
        data=in_json({"reading": reader_data(), "names": words.NAMES, "laboratory": of_laboratory()}),
        example=in_script(example()),
        wasm=Markup(base64.b64encode(gzip.compress(module, mtime=0)).decode()),
        kept=[(name, in_script(path.read_text(encoding="utf-8"))) for name, path in kept.items()],
        scripts=[whole],
    )
    out.mkdir(parents=True, exist_ok=True)
    (out / "index.html").write_text(text, encoding="utf-8")
    licences = [
        f"{name}\n\n{licence(npm / name)}" for name in json.loads((HERE / "package.json").read_text())["dependencies"]
    ]
    (out / "LICENSES.txt").write_text("\n\n".join(licences), encoding="utf-8")
    print(f"{out}/index.html: {len(text.encode()) / 1e6:.2f} MB, of them {len(module) / 1e6:.2f} MB WebAssembly")


if __name__ == "__main__":
    try:
        if sys.argv[1] == "--reader":
            loaded()
        else:
            build(Path(sys.argv[1]))
    except Missing as lacking:
        print(f"skipped: the page in the browser, which needs {lacking}")
