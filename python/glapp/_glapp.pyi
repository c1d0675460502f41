"""The Rust extension."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

class Backlash:
    """Backlash of total width d ≥ 0 (thesis 6.3); begins at output, or at the first input."""

    def __init__(self, d: float, output: float | None = None) -> None: ...
    def update(self, x: float) -> float: ...

class Noise:
    """Uniform noise of ± amplitude (thesis 6.2); begins at integer, 1..2³¹ − 2."""

    def __init__(self, amplitude: float, integer: int = 1) -> None: ...
    def update(self, x: float) -> float: ...

class Pid:
    """PI or PID controller (thesis (4.1)) with anti-windup; update in auto, track in manual."""

    def __init__(
        self, k: float, ti: float, td: float = 0.0, b: float = 0.0, limits: tuple[float, float] | None = None
    ) -> None: ...
    def update(self, ysp: float, yf: float, h: float) -> float: ...
    def track(self, ysp: float, yf: float, u: float, h: float) -> float: ...

def batch() -> list[tuple[str, list[float], list[float], float]]: ...
def closed_loop(
    *,
    plant: tuple[Sequence[float], Sequence[float], float],
    k: float,
    ti: float,
    td: float,
    b: float,
    tf: float,
    limits: tuple[float, float] | None,
    d: float,
    noise: float,
    h: float,
    t_end: float,
    setpoint: Sequence[tuple[float, float]] | npt.NDArray[np.float64],
    load: Sequence[tuple[float, float]] | npt.NDArray[np.float64],
    manual: Sequence[tuple[float, float, float | None]],
    seed: int,
) -> tuple[
    npt.NDArray[np.float64],
    npt.NDArray[np.float64],
    npt.NDArray[np.float64],
    npt.NDArray[np.float64],
    npt.NDArray[np.float64],
    npt.NDArray[np.float64],
    npt.NDArray[np.uint8],
]: ...
def random_walk(n: int, h: float, rate: float, seed: int) -> npt.NDArray[np.float64]: ...
