"""Tail probabilities of the χ² thresholds, by degrees of freedom, that C gets."""

from __future__ import annotations

# The share of healthy frames that the χ² gate rejects. At 220 Hz, 1.3e-6 would be one frame an hour.
FALSE_ALARM = 1e-6
# The share of healthy mean residuals that raise an alarm: once in ten hours, at 27 judgements a second of overlapping
# frames.
FALSE_MEAN_ALARM = 1e-6
# A mean residual is sound if its χ² is below the one that only this share of healthy means exceeds.
SOUND = 0.01
# The share of frames that exceed the threshold by chance although a moved ambient field explains them.
MOVED_MISFIT = 1e-4
# The share of spectra of white noise that show a line, at any of 64 frequencies.
FALSE_LINE = 1e-6 / 64
# Probability that the innovations of a healthy frame, or of a sample that came before its frame, exceed the threshold.
# This threshold notices a sensor that begins to fail before the others do.
FALSE_INNOVATION = 1e-6
# The share of poses that jump from those before by noise alone: [pad.contact] smoothing_ms.
JUMP_PROBABILITY = 1e-3
