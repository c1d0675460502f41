"""glapp finds, measures and explains backlash (dead band) in control loops from routine data.

Examples
--------
>>> import glapp
>>> loop = glapp.Loop(name="FIC101", pv_span=(0, 50), op_span=(0, 100), controller={"pb": 200, "ti": 30})
>>> loop.ideal().ti
30.0
"""

from importlib import import_module as _import_module
from importlib.metadata import version as _version
from typing import TYPE_CHECKING, Any

from .controller import Controller, Ideal
from .errors import InputError
from .estimate import Estimator, analyze, estimate, identify
from .fit import Fit, fit
from .identify import Identification
from .loop import Loop
from .quality import Finding
from .recording import Batch, Recording
from .result import Answer, Corrected, HalfPeriods, Result, Settings
from .step_test import StepTest, step_test

if TYPE_CHECKING:
    from . import blocks, fleet, modules, nonlinear, plant, simulate, tuning
    from .plan import Plan, plan_test
    from .reading import open_recordings, recording_from
    from .report.figures import plot
    from .row import to_arrow

__version__ = _version("glapp")

__all__ = [
    "Answer",
    "Batch",
    "Controller",
    "Corrected",
    "Estimator",
    "Finding",
    "Fit",
    "HalfPeriods",
    "Ideal",
    "Identification",
    "InputError",
    "Loop",
    "Plan",
    "Recording",
    "Result",
    "Settings",
    "StepTest",
    "__version__",
    "analyze",
    "blocks",
    "estimate",
    "fit",
    "fleet",
    "identify",
    "modules",
    "nonlinear",
    "open_recordings",
    "plan_test",
    "plant",
    "plot",
    "recording_from",
    "simulate",
    "step_test",
    "to_arrow",
    "tuning",
]

_LABORATORY = ("blocks", "fleet", "modules", "nonlinear", "plant", "simulate", "tuning")
_READING = ("open_recordings", "recording_from")
_PLAN = ("Plan", "plan_test")


def __getattr__(name: str) -> Any:
    """Load the laboratory, the fleet, plans, and what reads tables when first asked for: all need large libraries."""
    if name in _LABORATORY:
        return _import_module(f".{name}", __name__)
    if name in _READING:
        return getattr(_import_module(".reading", __name__), name)
    if name in _PLAN:
        return getattr(_import_module(".plan", __name__), name)
    if name == "plot":
        return _import_module(".report.figures", __name__).plot
    if name == "to_arrow":
        return _import_module(".row", __name__).to_arrow
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
