"""A contact as a row of numbers, for programs that learn: the same columns in MuJoCo and in a data set of LeRobot."""

from __future__ import annotations

from typing import Any

# A null in a message is 0 here, with a deviation of 0: the `known` columns mark it.
COLUMNS = (
    *("age_s", "ok", "degraded", "contact", "over_range"),
    *("force_n", "force_sd_n", "x_m", "x_sd_m", "y_m", "y_sd_m", "place_known"),
    *("shear_x_n", "shear_x_sd_n", "shear_y_n", "shear_y_sd_n", "shear_known"),
)


def row_of(message: Any, age_s: float = 0.0) -> list[float]:
    """COLUMNS of a Contact, or of what has as much of it. age_s: since it was measured."""
    return [
        age_s,
        message.health == "ok",
        message.health == "degraded",
        bool(message.contact),
        message.over_range,
        message.force_n or 0.0,
        message.force_sd_n or 0.0,
        message.x_m or 0.0,
        message.x_sd_m or 0.0,
        message.y_m or 0.0,
        message.y_sd_m or 0.0,
        message.x_m is not None,
        message.shear_x_n or 0.0,
        message.shear_x_sd_n or 0.0,
        message.shear_y_n or 0.0,
        message.shear_y_sd_n or 0.0,
        message.shear_x_n is not None,
    ]
