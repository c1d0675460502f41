"""The bench of truth: simulated loops whose gap is known, and what every method says (`bench/results/truth.md`)."""
