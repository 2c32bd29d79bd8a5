"""Warnings for contact models with an unknown effect of shear, or without the shear that they could give."""

from __future__ import annotations

# For [pad.contact] friction with an unknown effect.
SHEAR_UNKNOWN = (
    "[pad.contact] friction = {friction:g} has no effect: the contact model was made without --sheared, so what a "
    "shearing finger does to it is not known, and its deviations do not count it: calibrate with --sheared, or use a "
    "finger that cannot shear and set friction = 0"
)
# For friction = 0 and a model that could give shear.
NO_SHEAR = (
    "[pad.contact] friction = 0 excludes shear, so the answers are the default model's, without shear_x_n and "
    "shear_y_n: set friction to the largest coefficient of what presses, as 0.3"
)
# For slip with a model that has three outputs, or no response.
SLIP_UNKNOWN = (
    "slip = true needs a model that measures shear: with three outputs, the shear of a sticking finger looks like "
    'motion. Set model = "shear" in [pad.contact], or calibrate with --shear'
)
