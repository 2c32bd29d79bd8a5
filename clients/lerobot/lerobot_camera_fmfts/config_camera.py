"""Configuration of the camera that shows a touch: `--robot.cameras="{touch: {type: fmfts, pad: left}}"`."""

from dataclasses import dataclass

from lerobot.cameras.configs import CameraConfig


@CameraConfig.register_subclass("fmfts")
@dataclass(kw_only=True)
class FmftsCameraConfig(CameraConfig):
    """pad: its name in the daemon's configuration. full_scale_n: the force of full brightness. pad_size_m: its edge."""

    pad: str
    endpoint: str | None = None
    pad_size_m: float = 0.04
    full_scale_n: float = 4.0
    fps: int | None = 30
    width: int | None = 96
    height: int | None = 96

    def __post_init__(self) -> None:
        if not self.fps or not self.width or not self.height:
            raise ValueError(f"fps, width and height are {self.fps}, {self.width}, {self.height}: set all three")
        if not self.pad_size_m > 0 or not self.full_scale_n > 0:
            raise ValueError(f"pad_size_m and full_scale_n are {self.pad_size_m}, {self.full_scale_n}: more than zero")
