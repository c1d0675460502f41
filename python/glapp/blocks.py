"""The blocks of the core, one sample a call: the parts of a loop in a PLC.

Each holds its own state. They are the same code as in the simulator and in the detector, and the twins of the blocks in
`vectors/`.

Examples
--------
>>> gap = Backlash(2.0)
>>> [gap.update(x) for x in (0.0, 0.9, 3.0, 2.0, 0.5)]
[0.0, 0.0, 2.0, 2.0, 1.5]
>>> shown = MedianMean(n=3)
>>> [shown.update(d)[0] for d in (5.0, 40.0, 5.5)]
[5.0, 22.5, 5.25]
"""

from ._glapp import (
    AutoTuner,
    Backlash,
    Compensation,
    Correction,
    Derivative,
    MedianMean,
    Noise,
    NoiseLevel,
    OverCompensation,
    PhaseLead,
    Pid,
    RateLimit,
    SafetyNet,
    Saturation,
    SecondOrderFilter,
    Stiction,
    Swing,
    Width,
    WrongSign,
    ZeroCrossing,
)
from ._glapp import HalfPeriodBlock as HalfPeriod

__all__ = [
    "AutoTuner",
    "Backlash",
    "Compensation",
    "Correction",
    "Derivative",
    "HalfPeriod",
    "MedianMean",
    "Noise",
    "NoiseLevel",
    "OverCompensation",
    "PhaseLead",
    "Pid",
    "RateLimit",
    "SafetyNet",
    "Saturation",
    "SecondOrderFilter",
    "Stiction",
    "Swing",
    "Width",
    "WrongSign",
    "ZeroCrossing",
]
