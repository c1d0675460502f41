"""A loop put together from modules, and changed while it runs: the system of the thesis' section 6.5."""

from glapp.modules import Backlash, Graph, Input, Mode, Noise, PidAdvanced, ProcessSim

loop = Graph(
    0.1,
    {
        "sp": Input(50.0),
        "load": Input(5.0),
        "pid": PidAdvanced(k=2.0, ti=2.0, tf=0.2, low=0.0, high=100.0, kp=1.0, start=50.0),
        "gap": Backlash(2.0),
        "process": ProcessSim(gain=1.0, t1=3.0, t2=1.0, start=50.0),
        "noise": Noise(0.1, seed=1),
    },
    ["sp -> pid.sp", "load -> process.load", "pid -> gap -> process -> noise -> pid.pv"],
)


def show(what: str) -> None:
    """Print what the controller has detected so far."""
    print(f"{what}: {loop['pid.detections']:.0f} detections, estimate {loop['pid.d_hat']:.2f} %")


loop.run(1000)
show("a gap of 2 %")

loop["gap.d"] = 4.0  # the valve wears
loop.run(1000)
show("a gap of 4 %")

loop["pid.mode"] = Mode.MANUAL
before = loop["pid.out"]
loop["load.value"] = 10.0
loop.run(100)
loop["pid.mode"] = Mode.EXTERNAL
loop.scan()
print(f"back from manual: the output moved by {abs(loop['pid.out'] - before):.1f} %")
show("and nothing was learnt meanwhile")
