"""A recording in memory, analysed to the width of the gap.

A loop with a worn valve is simulated, so that the truth is known: the gap is 5 % of OP span.
"""

import glapp

load = [(60.0 * k, 20.0 * (k % 2)) for k in range(10)]  # the valve must travel for its gap to show
sim = glapp.simulate.closed_loop(
    "P3",
    (0.48, 0.3117, 0, 0),
    d=5.0,
    noise=0.1,
    h=0.1,
    t_end=600,
    setpoint=[(0, 50.0)],
    load=load,
    seed=1,
    filter_in_loop=True,
)

loop = glapp.Loop(
    name="FIC101",
    pv_span=(0, 100),
    op_span=(0, 100),
    controller={"k": 0.48, "ti": 0.3117, "setpoint_weight": 0},
    process={"kp": 1.0},
)
result = glapp.analyze(glapp.recording_from(sim.to_arrow(), loop))

print(f"{result.name}: {result.verdict}, a gap of {result.width:.2f} {result.unit}", end=" ")
print(f"({result.answer.low:.2f} to {result.answer.high:.2f})")
print(result.by_position)  # most plants have no position: glapp.analyze(table, position="") leaves it out
print(f"crossings: d = {result.d_hat:.2f} {result.unit} ({result.detections} detections)")
print("rejected:", result.reasons)
