"""Weights of the evidence for a dead band: `python -m bench.weigh`; see `__main__`."""
