"""Gathers calibration data, with a machine that presses or by hand: `fmfts-daemon collect`. A package of its own."""
