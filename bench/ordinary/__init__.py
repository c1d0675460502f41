"""The corpus of ordinary loops, and the answers of the fit: `python -m bench.ordinary`."""
