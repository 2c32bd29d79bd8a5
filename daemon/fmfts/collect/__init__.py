"""Collecting calibration data: a plan of presses, what presses, what measures, and the table that comes of it."""
