"""A relay experiment on a simulated process: the result of the autotuner."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from .. import _glapp, modules
from ..checked import check_limits, check_number, check_one_of, numbers_of
from ..errors import InputError
from ..plant import Plant
from .assess import Tuning, assess
from .process import Kind, Process, kind_of, sign_of
from .ultimate import ultimate

Rule = Literal["point_placement", "ziegler_nichols", "amigo"]

_SOURCES = {
    "point_placement": "Åström & Hägglund, Automatica 20 (1984); Ti = 6.25Td: thesis 7.5",
    "ziegler_nichols": "Ziegler & Nichols, Trans. ASME 64 (1942)",
    "amigo": "Åström & Hägglund, Advanced PID Control (2006), chapter 7",
}
_DONE = 4


@dataclass(frozen=True, slots=True)
class RelayExperiment:
    """A relay experiment and its result.

    Attributes
    ----------
    plant : Plant
        The process.
    t, pv, op : float64[n]
        Time [s], process value with noise, and output, both from where they rested; up to the sample that ended it.
    phase : int8[n]
        1 waiting, 2 balanced, 3 biased, 4 done, 5 aborted.
    stop : str or None
        Why it was broken off: "bad_quality", "sample_time", "not_auto", "op_limit", "pv_bounds", "wrong_sign",
        "dead_loop", "not_regular", "time_budget" or "off_point"; None where it was not.
    ku, tu : float or None
        Ultimate gain and period [s]; None where it came to an end before they were known.
    kp_process : float or None
        Static gain; None for an integrating process, and where it could not be measured.
    kappa : float or None
        1/(Kp·Ku), 0 for an integrating process; None where it could not be measured: then ku and tu are not corrected.
    """

    plant: Plant
    t: npt.NDArray[np.float64]
    pv: npt.NDArray[np.float64]
    op: npt.NDArray[np.float64]
    phase: npt.NDArray[np.int8]
    stop: str | None
    ku: float | None
    tu: float | None
    kp_process: float | None
    kappa: float | None

    def tuned(self, rule: Rule = "point_placement", kind: Kind = "PID") -> Tuning:
        """Tune a controller by the result, and assess it with the process itself.

        Parameters
        ----------
        rule : {"point_placement", "ziegler_nichols", "amigo"}
            Ti = 6.25Td, PID only; or a rule in closed form from Ku, Tu and κ.
        kind : {"PI", "PID"}

        Raises
        ------
        InputError
            Where the experiment found too little for the rule, and for an unstable closed loop.
        """
        check_one_of(rule, "rule", _SOURCES)
        if self.ku is None or self.tu is None:
            raise InputError(f"found nothing to tune by: {self.stop}", parameter="experiment")
        try:
            k, ti, td = _glapp.tuned_by((self.ku, self.tu, self.kp_process, self.kappa), rule, kind_of(kind))
        except ValueError as error:
            raise InputError(str(error), parameter="rule", value=rule) from None
        title = f"{rule.replace('_', ' ')} {kind} after a relay experiment"
        return assess(self.plant, (k, ti, td), rule=title, source=_SOURCES[rule])


def relay_experiment(
    plant: Process,
    amplitude: float = 1.0,
    *,
    relay_hysteresis: float | None = None,
    noise: float = 0.0,
    load: Sequence[tuple[float, float]] | npt.NDArray[np.float64] = (),
    d: float = 0.0,
    known_d: float = 0.0,
    h: float | None = None,
    wait: float | None = None,
    longest: float | None = None,
    pv_limits: tuple[float, float] = (-1e9, 1e9),
    op_limits: tuple[float, float] = (-1e9, 1e9),
    seed: int = 1,
) -> RelayExperiment:
    """Run the autotuner on a simulated process, from rest at PV = 0 and OP = 0.

    Parameters
    ----------
    plant : process
        Stable, or with one integrator.
    amplitude : float
        The greatest distance of OP from 0, > 0; it is given the sign of the process gain.
    relay_hysteresis : float, optional
        Half width of the relay's hysteresis [unit of PV], ≥ 0; half of PV's range in the waiting phase where not given.
    noise : float
        Amplitude of uniform noise on PV, ≥ 0.
    load : sequence of (time, value), or float64[n]
        Load at the process' input [unit of OP]: its value from each time [s] on, in ascending order, 0 before the
        first; or one a sample.
    d : float
        Total width of a gap before the process [unit of OP], ≥ 0.
    known_d : float
        The width that is given to the autotuner, ≥ 0 and less than 4/3 of the amplitude.
    h : float, optional
        Sample time [s], > 0; a hundredth of the process' ultimate period where not given.
    wait, longest : float, optional
        Length of the waiting phase and of the whole [s], 0 < wait < longest; one and 60 ultimate periods where not
        given.
    pv_limits, op_limits : (low, high)
        Bounds of PV and OP.
    seed : int
        Of the noise, 0..2³² − 1.

    Raises
    ------
    InputError
        For a parameter out of its bounds.

    Examples
    --------
    >>> e = relay_experiment("P2", noise=0.01)
    >>> f"Ku {e.ku:.2f}, Tu {e.tu:.2f} s, Kp {e.kp_process:.2f} (truth: 4, 6.28 s, 1)"
    'Ku 4.05, Tu 6.23 s, Kp 1.00 (truth: 4, 6.28 s, 1)'
    >>> t = e.tuned("amigo", "PI")
    >>> f"K {t.controller.k:.2f}, Ti {t.controller.ti:.2f} s, Ms {t.ms:.2f}"
    'K 0.65, Ti 2.95 s, Ms 1.50'
    >>> relay_experiment("P2", longest=40).stop
    'time_budget'
    """
    process = Plant.of(plant)
    period = ultimate(process).tu
    step, wait, longest = (
        check_number(ours if given is None else given, name, lambda x: x > 0, "greater than 0 s")
        for name, given, ours in (("h", h, period / 100), ("wait", wait, period), ("longest", longest, 60 * period))
    )
    amplitude = check_number(amplitude, "amplitude", lambda x: x > 0, "greater than 0")
    d, known_d, noise = (
        check_number(value, name, lambda x: x >= 0, "0 or greater")
        for name, value in (("d", d), ("known_d", known_d), ("noise", noise))
    )
    tuner = modules.AutoTuner(
        sign_of(process) * amplitude,
        wait,
        longest,
        *_limits("pv_limits", pv_limits),
        *_limits("op_limits", op_limits),
        relay_hysteresis=relay_hysteresis,
        d=known_d,
    )
    graph = modules.Graph(
        step,
        {
            "op": modules.Input(),
            "tuner": tuner,
            "gap": modules.Backlash(d),
            "load": modules.Input(),
            "process": modules.Plant(process),
            "noise": modules.Noise(noise, seed=seed),
        },
        ["op -> tuner.in", "tuner -> gap -> process -> noise -> tuner.pv", "load -> process.load"],
    )
    n = int(longest / step) + 2
    return _experiment(process, graph, (n + 0.5) * step, _load(load, n, step))


def _experiment(process: Plant, graph: modules.Graph, t: float, load: npt.NDArray[np.float64]) -> RelayExperiment:
    """Run the graph for `t` seconds, and read what its autotuner found."""
    graph["tuner.run"] = 1
    recorded = graph.run(t, record=["noise", "tuner", "tuner.phase"], load=load)
    phase = recorded["tuner.phase"].astype(np.int8)
    end = int(np.argmax(phase >= _DONE)) + 1
    found = [graph[f"tuner.{name}"] for name in ("ku", "tu", "kp", "kappa")]
    ku, tu, kp, kappa = (None if np.isnan(number) else number for number in found)
    stop = int(graph["tuner.stop"])
    return RelayExperiment(
        plant=process,
        t=recorded["t"][:end],
        pv=recorded["noise"][:end],
        op=recorded["tuner"][:end],
        phase=phase[:end],
        stop=_glapp.stops()[stop] if stop else None,
        ku=ku,
        tu=tu,
        kp_process=kp,
        kappa=kappa,
    )


def _load(load: Sequence[tuple[float, float]] | npt.NDArray[np.float64], n: int, h: float) -> npt.NDArray[np.float64]:
    """One value a sample."""
    values = np.zeros(n)
    bound = "[(time, value), …], or an array with one number a sample"
    given = numbers_of(load, "load", bound)
    if isinstance(load, np.ndarray) and load.ndim == 1:
        values[: given.size] = given[:n]
        return values
    if given.size and (given.ndim != 2 or given.shape[1] != 2):
        raise InputError(f"is {load!r}, must be {bound}", parameter="load", value=load, bound=bound)
    for t, value in given.reshape(-1, 2):
        values[max(0, round(t / h)) :] = value
    return values


def _limits(name: str, limits: tuple[float, float]) -> tuple[float, float]:
    """Bounds of a signal, refused where they are none."""
    found = numbers_of(limits, name, "(low, high)")
    if found.shape != (2,):
        raise InputError(f"is {limits!r}, must be (low, high)", parameter=name, value=limits, bound="(low, high)")
    check_limits((float(found[0]), float(found[1])), name)
    return float(found[0]), float(found[1])
