"""glapp finds, measures and explains backlash (dead band) in control loops from routine data.

>>> import glapp
>>> loop = glapp.Loop(name="FIC101", pv_span=(0, 50), op_span=(0, 100), controller={"pb": 200, "ti": 30})
>>> loop.ideal().ti
30.0
"""

from importlib.metadata import version as _version

from . import blocks, modules, nonlinear, plant, simulate, tuning
from .bump import Bump, bump
from .controller import Controller, Ideal
from .errors import InputError
from .estimate import Estimator, analyze, estimate
from .fit import Fit, fit
from .identify import Identification, identify
from .loop import Loop
from .quality import Finding
from .reading import open_recordings, recording_from
from .recording import Batch, Recording
from .result import Corrected, HalfPeriods, Result, Settings

__version__ = _version("glapp")

__all__ = [
    "Batch",
    "Bump",
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
    "Recording",
    "Result",
    "Settings",
    "__version__",
    "analyze",
    "blocks",
    "bump",
    "estimate",
    "fit",
    "identify",
    "modules",
    "nonlinear",
    "open_recordings",
    "plant",
    "recording_from",
    "simulate",
    "tuning",
]
