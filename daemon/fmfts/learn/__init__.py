"""Learns a pad's geometry from presses that nobody labelled: how its sensors lie, where its magnet is.

It is an offline computation with SciPy: the running daemon never imports it. What it finds is stored in the baseline.
"""
