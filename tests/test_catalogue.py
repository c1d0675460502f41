"""Names, numbers and defaults are those of the crates, in Python and in the docs.

`crates/analysis/tests/catalogue.rs` holds the catalogue to the crates.
"""

from __future__ import annotations

import enum
import importlib.util
import json
import re
import typing
from pathlib import Path
from typing import Any

import pytest

import glapp
from glapp import _glapp, modules, recording, result, simulate
from glapp.report import words
from glapp.scenario import Compensation
from glapp_thesis.loops import SWITCHES

ROOT = Path(__file__).parents[1]
CATALOGUE: dict[str, Any] = json.loads((ROOT / "vectors/catalogue.json").read_text(encoding="utf-8"))


def in_order(key: str) -> list[str]:
    """Names by their numbers."""
    numbered: dict[str, int] = CATALOGUE[key]
    return sorted(numbered, key=lambda name: numbered[name])


def default(block: str, name: str) -> Any:
    return next(s["default"] for s in CATALOGUE["settings"][block] if s["name"] == name)


@pytest.mark.parametrize(
    ("enumeration", "key"),
    [
        (modules.Flag, "flags"),
        (modules.Mode, "modes"),
        (modules.Way, "ways"),
        (modules.Source, "sources"),
        (modules.TuneRule, "rules"),
        (modules.Unfit, "unfit"),
    ],
)
def test_enums_have_the_cores_names_and_numbers(enumeration: type[enum.IntEnum], key: str) -> None:
    assert {member.name.lower(): member.value for member in enumeration} == CATALOGUE[key]


def test_flags_of_a_recording_are_the_first_of_the_core() -> None:
    for name in ("NOT_AUTO", "BAD", "AT_LOW", "AT_HIGH"):
        assert getattr(recording, name) == CATALOGUE["flags"][name.lower()]


def test_codes_have_the_cores_names() -> None:
    assert list(result.REASONS) == in_order("reasons")
    assert [*words.REASONS] == in_order("reasons")
    assert list(simulate.COMPENSATION_STATES) == in_order("standings")
    assert sorted(words.VERDICTS) == sorted(CATALOGUE["fit_verdicts"] + CATALOGUE["verdicts"])
    assert _glapp.stops() == in_order("stops")
    assert list(SWITCHES.values()) == CATALOGUE["conditions"]
    assert list(typing.get_args(Compensation.model_fields["way"].annotation)) == in_order("ways")


def test_defaults_are_the_cores() -> None:
    given = CATALOGUE["defaults_for"]
    assert glapp.Loop(name="x").n == _glapp.DETECTIONS == default("detector", "n")
    assert default("detector", "max_h") == _glapp.DATA_GAP_STEPS * given["h"]
    assert default("detector", "tf") == _glapp.filter_time(given["ti"], given["td"])
    loop = {"k": given["k"], "ti": given["ti"], "td": given["td"]}
    assert modules.BacklashDetection(**loop).n == modules.PidAdvanced(**loop).n == default("detector", "n")
    assert (modules.Pid(**loop).b, modules.Pid(**loop).c) == (default("pid", "b"), default("pid", "c"))
    assert modules.Pid(**loop).tf == default("pid", "tf")
    beside = modules.BacklashDetection(**loop)
    assert (beside.ff_delay, beside.ff_tolerance, beside.ff_longest) == tuple(
        default("foreign_detection", name) for name in ("delay", "tolerance", "longest")
    )
    assert Compensation(way="inverse", size=1.0).tf == default("compensation", "tf")


def test_what_is_not_given_to_a_detector_is_the_cores_default() -> None:
    """A filter time or a bound that was worked out elsewhere would make another estimate."""
    given = {name: CATALOGUE["defaults_for"][name] for name in ("k", "ti", "td", "h")}
    usual = {s["name"]: s["default"] for s in CATALOGUE["settings"]["detector"] if s["default"] is not None}
    bare = json.loads(_glapp.Detector(given).save())["settings"]
    assert {name: bare[name] for name in usual} == usual
    assert bare == json.loads(_glapp.Detector({**given, **usual}).save())["settings"]


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"k": 1.0, "ti": 1.0}, "h: is missing"),
        ({"k": 1.0, "ti": 1.0, "h": 1.0, "tI": 2.0}, "tI: there is no such setting of a detector"),
        ({"k": 1.0, "ti": 1.0, "h": 1.0, "off": ["5Ti"]}, "off = 5Ti: there is no such condition"),
        ({"k": 1.0, "ti": 1.0, "h": 1.0, "op_limits": (2.0, 1.0)}, "op_low = 2: must be a number below op_high"),
    ],
)
def test_wrong_settings_are_refused_by_name(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        _glapp.Detector(settings)


def test_a_saved_detector_of_another_layout_is_refused_by_its_name() -> None:
    loop = glapp.Loop(name="x", controller={"k": 1.0, "ti": 10.0})
    saved = glapp.Estimator(loop, h=1.0).save()
    assert glapp.Estimator.load(saved).save() == saved
    with pytest.raises(
        glapp.InputError, match="is 'glapp detector 1', and 'glapp detector 2' is what this release reads"
    ):
        glapp.Estimator.load(saved.replace("glapp detector 2", "glapp detector 1"))


def test_the_page_is_made_of_the_catalogue() -> None:
    spec = importlib.util.spec_from_file_location("catalogue", ROOT / "vectors/catalogue.py")
    assert spec is not None and spec.loader is not None
    made = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(made)
    page = made.page(CATALOGUE)
    for key in made.NUMBERED:
        assert all(f"| `{name}` | {number} |" in page for name, number in CATALOGUE[key].items()), key
    for block, settings in CATALOGUE["settings"].items():
        part = page.partition(f"## settings of {block}\n")[2].partition("\n## ")[0]
        assert settings and all(f"| {s['name']} | {s['unit']} | {s['bound']} |" in part for s in settings), block
    assert all(f"| `{one['code']}` |" in page for one in CATALOGUE["findings"])
    assert all(f"| `{one['name']}` | {one['unit']} |" in page for one in CATALOGUE["variables"])


@pytest.mark.parametrize(
    ("key", "page"), [("reasons", "estimator.md"), ("standings", "compensation.md"), ("stops", "auto_tuner.md")]
)
def test_every_name_is_explained_in_the_docs(key: str, page: str) -> None:
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    assert not [name for name in in_order(key) if name not in text and name.replace("_", " ") not in text]


def test_every_finding_has_its_sentence_and_its_row_in_the_guide() -> None:
    """One list of codes, and in each place the same severities, in the crates' order in Python."""
    findings = {finding["code"]: set(finding["severities"]) for finding in CATALOGUE["findings"]}
    named = [code.split()[0].removeprefix("quality.") for code, _ in _glapp.catalogue() if code.startswith("quality.")]
    assert list(dict.fromkeys(named)) == list(findings)
    guide = (ROOT / "docs/quality.md").read_text(encoding="utf-8")
    listed = {
        code: set(re.findall("info|warning|refuse", severity))
        for codes, severity in re.findall(r"^\| (`.*?) \| (.*?) \|", guide, re.M)
        for code in re.findall(r"`(\w+)`", codes)
    }
    assert listed == findings
