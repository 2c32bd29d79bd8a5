"""Touch for LeRobot: `with_touch` adds a pad's floats to a robot's observation, `FmftsCamera` makes an image of it,
`Samples` gives all samples since the last step."""

from lerobot_camera_fmfts.camera import FmftsCamera
from lerobot_camera_fmfts.config_camera import FmftsCameraConfig
from lerobot_camera_fmfts.robot import with_touch
from lerobot_camera_fmfts.samples import Samples
from lerobot_camera_fmfts.touch import FEATURES, Pads, TouchLostError

__all__ = ["FEATURES", "FmftsCamera", "FmftsCameraConfig", "Pads", "Samples", "TouchLostError", "with_touch"]
