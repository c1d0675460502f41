"""Tuning rules, from a table of 1942 to constrained optimisation, each with its effect on the loop.

Every rule gives a `Tuning`: the controller in ideal form, its robustness on the process it is meant for (dead time
exact), and what a load step does. The closed forms are in the core, this module describes the process to them.

| rule | needs | source |
|---|---|---|
| `ziegler_nichols_step` | tangent of the step response | Ziegler & Nichols 1942 |
| `ziegler_nichols_frequency` | ultimate gain and period | Ziegler & Nichols 1942 |
| `lambda_tuning` | FOTD model, the time constant λ wished for | Dahlin 1968 |
| `amigo_step` | FOTD model | APC ch. 7 |
| `amigo_frequency` | ultimate gain and period, static gain | APC ch. 7 |
| `point_placement` | ultimate gain and period | Åström & Hägglund 1984 |
| `simc` | one or two lags and a dead time | Skogestad 2003 |
| `migo` | the process | Åström et al. 1998, 2004 |
| `design` | the process | Garpinger & Hägglund 2008 |

APC: Åström and Hägglund, *Advanced PID Control*, 2006.
"""

from .assess import Tuning, assess, open_loop
from .design import design
from .fotd import Character, Fotd, character, fotd, fotd_from_step
from .half_rule import half_rule
from .integrating import Integrating, integrating
from .migo import migo
from .process import Kind
from .relay import RelayExperiment, relay_experiment
from .rules import (
    amigo_frequency,
    amigo_step,
    lambda_tuning,
    point_placement,
    simc,
    ziegler_nichols_frequency,
    ziegler_nichols_step,
)
from .ultimate import Ultimate, ultimate

__all__ = [
    "Character",
    "Fotd",
    "Integrating",
    "Kind",
    "RelayExperiment",
    "Tuning",
    "Ultimate",
    "amigo_frequency",
    "amigo_step",
    "assess",
    "character",
    "design",
    "fotd",
    "fotd_from_step",
    "half_rule",
    "integrating",
    "lambda_tuning",
    "migo",
    "open_loop",
    "point_placement",
    "relay_experiment",
    "simc",
    "ultimate",
    "ziegler_nichols_frequency",
    "ziegler_nichols_step",
]
