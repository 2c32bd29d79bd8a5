"""Learns a pad's geometry from unlabelled presses: places and rotations of its sensors, and its magnet.

It is an offline computation with SciPy, which the running daemon never imports. The baseline stores the result.
"""
