"""How improbable is too improbable: the tail probabilities whose χ² thresholds C gets, by degrees of freedom."""

from __future__ import annotations

# The share of healthy frames that the χ² gate rejects. At 220 Hz, one frame in an hour would be 1.3e-6.
FALSE_ALARM = 1e-6
# The share of healthy mean residuals that raise an alarm: once in ten hours, at 27 judgements a second that share
# frames.
FALSE_MEAN_ALARM = 1e-6
# A mean residual is sound if its χ² is below the one that only this share of healthy means exceeds.
SOUND = 0.01
# The share of frames that misfit by chance although a moved ambient field explains them.
MOVED_MISFIT = 1e-4
# The share of spectra of white noise that show a line, at any of 64 frequencies.
FALSE_LINE = 1e-6 / 64
# Probability that the innovations of a healthy frame, or of a sample that came before its frame, are so unlikely. A
# sensor that begins to fail is seen here first.
FALSE_INNOVATION = 1e-6
# The share of poses that jump from those before by noise alone: [pad.contact] smoothing_ms.
JUMP_PROBABILITY = 1e-3
