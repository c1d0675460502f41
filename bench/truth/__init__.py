"""The bench of truth: simulated loops whose gap is known, and what every method says of them. See `bench/results/truth.md`."""
