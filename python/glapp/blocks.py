"""The blocks of the core, one sample a call: what a loop in a PLC is made of.

Each holds its own state. They are the same code as in the simulator and in the detector, and the twins of the blocks in
`vectors/`.

Examples
--------
>>> gap = Backlash(2.0)
>>> [gap.update(x) for x in (0.0, 0.9, 3.0, 2.0, 0.5)]
[0.0, 0.0, 2.0, 2.0, 1.5]
"""

from ._glapp import Backlash, Noise, Pid

__all__ = ["Backlash", "Noise", "Pid"]
