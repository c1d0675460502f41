"""Loads and recorders that a gap is easily confused with; see `bench/results/truth.md`."""
