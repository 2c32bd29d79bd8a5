"""The contact models for the standard pad. Any other text in `[pad.contact] model` is a path, or "none"."""

from __future__ import annotations

from pathlib import Path

SHIPPED_PATHS = {name: Path(__file__).with_name(f"{name}.onnx") for name in ("default", "shear")}
DEFAULT_PATH = SHIPPED_PATHS["default"]


def path_of(model: str) -> Path:
    return SHIPPED_PATHS.get(model, Path(model))
