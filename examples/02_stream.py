"""One sample at a time, as a controller or a plant connection would call it."""

import glapp

load = [(150.0 * k, 20.0 * (k % 2)) for k in range(20)]  # the valve must travel for its gap to show
sim = glapp.simulate.closed_loop(
    "P3",
    (0.48, 0.3117, 0, 0),
    d=5.0,
    noise=0.1,
    t_end=600,
    setpoint=[(0, 50.0)],
    load=load,
    seed=1,
    filter_in_loop=True,
)
loop = glapp.Loop(name="FIC101", controller={"k": 0.48, "ti": 0.3117, "setpoint_weight": 0}, process={"kp": 1.0})

estimator = glapp.Estimator(loop, h=0.05)
for t, sp, pv, op in zip(sim.t, sim.sp, sim.pv, sim.op, strict=True):
    half_period = estimator.update(t, sp, pv, op)
    if half_period is not None and half_period.reason == 0:
        print(f"{half_period.t_end:6.1f} s  detection {half_period.d:.2f} %  estimate {half_period.d_hat:.2f} %")

saved = estimator.save()  # survives a restart: the estimate goes on with the same bits
assert glapp.Estimator.load(saved).estimate == estimator.estimate
