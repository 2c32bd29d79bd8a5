"""Recordings that others published, which this repository does not hold: lab/results/real.md says how to get them."""
