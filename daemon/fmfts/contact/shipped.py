"""The contact models for the standard pad. Any other text in `[pad.contact] model` is a path, or "none"."""

from __future__ import annotations

from pathlib import Path

from fmfts.pad import Dimensions

SHIPPED_PATHS = {name: Path(__file__).with_name(f"{name}.onnx") for name in ("default", "shear")}
DEFAULT_PATH = SHIPPED_PATHS["default"]


def path_of(model: str) -> Path:
    return SHIPPED_PATHS.get(model, Path(model))


# The standard pad: these models are older than the field for dimensions (Pad.dimensions).
STANDARD_HASH = "2caf330ca8af"
STANDARD_DIMENSIONS: Dimensions = {
    "geometry.sensors_mm": (8, 8, 0, 8, -8, 0, -8, 8, 0, -8, -8, 0),
    "geometry.sensor_rotations (as matrices)": (1, 0, 0, 0, 1, 0, 0, 0, 1) * 4,
    "magnet.diameter_mm": (2,),
    "magnet.length_mm": (2,),
    "magnet.rest_mm": (0, 0, 12),
    "magnet.rest_axis": (0, 0, 1),
}
