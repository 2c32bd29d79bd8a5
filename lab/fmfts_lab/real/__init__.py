"""Recordings that others published, which this repository does not hold: docs/results/real.md says how to get them."""
