"""Loops whose controller sees PV through its filter, as the thesis has them."""

from functools import partial

from glapp.simulate import Scenario, closed_loop

filtered = partial(closed_loop, filter_in_loop=True)
filtered_scenario = partial(Scenario, filter_in_loop=True)
