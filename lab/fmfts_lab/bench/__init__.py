"""Measures speed and quality of solver, tracker, contact model and daemon: `python -m fmfts_lab.bench --help`."""
