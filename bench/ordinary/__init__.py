"""The corpus of ordinary loops, and what the fit says of it: `python -m bench.ordinary`."""
