"""Loads and recorders that a gap is easily confused with; see `docs/truth.md`."""
