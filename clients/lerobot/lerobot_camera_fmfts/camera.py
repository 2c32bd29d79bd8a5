"""A camera of LeRobot that shows where and how hard a pad is touched.

For policies that take images alone. Data sets keep images as video, which is lossy: forces read back from it are not
those that were measured. Record the floats (`with_touch`) where numbers matter.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from fmfts_client import Contact
from lerobot.cameras.camera import Camera
from numpy.typing import NDArray

from lerobot_camera_fmfts.config_camera import FmftsCameraConfig
from lerobot_camera_fmfts.touch import Pads, TouchLostError

FINGER_SD_M = 0.003  # the blob's own deviation, in addition to the place's: about a fingertip
EDGE = 40  # brightness of the pad's edge in the blue channel


class FmftsCamera(Camera):
    """Red: the force, at its place. Green: the same, as wide as the place is uncertain. Blue: the pad's edge.

    The picture is seen from the finger, x to the right and y up.
    """

    def __init__(self, config: FmftsCameraConfig) -> None:
        super().__init__(config)
        self.config = config
        self._pads = Pads([config.pad], config.endpoint, config.pad_size_m)

    def __str__(self) -> str:
        return f"FmftsCamera({self.config.pad})"

    @property
    def is_connected(self) -> bool:
        return self._pads.is_connected

    @staticmethod
    def find_cameras() -> list[dict[str, Any]]:
        """The pads of the daemon on this computer; none if it does not answer."""
        from fmfts_client import ControlError, EndpointError, request

        try:
            pads = request("pads", timeout_s=1.0)["pads"]
        except (ControlError, EndpointError):
            return []
        return [{"type": "fmfts", "id": pad["pad"], "name": f"touch of pad {pad['pad']}"} for pad in pads]

    def connect(self, warmup: bool = True) -> None:
        """Raises ConnectionError if the pad sends nothing."""
        try:
            self._pads.connect()
        except TouchLostError as error:
            raise ConnectionError(str(error)) from error

    def read(self) -> NDArray[np.uint8]:
        """The next touch, as an image (height, width, 3). Raises TouchLostError; an image is never repeated."""
        return self._drawn(self._pads.contact(self.config.pad))

    def async_read(self, timeout_ms: float = 300.0) -> NDArray[np.uint8]:
        """The newest touch, not older than 0.3 s. Raises TouchLostError."""
        return self._drawn(self._pads.contact(self.config.pad, timeout_ms * 1e-3))

    def read_latest(self, max_age_ms: int = 300) -> NDArray[np.uint8]:
        """Like `async_read`: a held-back sample is never given out."""
        return self.async_read(float(max_age_ms))

    def disconnect(self) -> None:
        self._pads.disconnect()

    def _drawn(self, contact: Contact) -> NDArray[np.uint8]:
        height, width = self.config.height or 0, self.config.width or 0
        image = np.zeros((height, width, 3), np.uint8)
        image[[0, -1], :, 2] = image[:, [0, -1], 2] = EDGE
        force_n = contact.force_min_n if contact.over_range else contact.force_n
        if not contact.contact or force_n is None or contact.x_m is None or contact.y_m is None:
            return image
        half_m = self.config.pad_size_m / 2
        x_m = (np.arange(width) + 0.5) / width * 2 * half_m - half_m
        y_m = half_m - (np.arange(height) + 0.5) / height * 2 * half_m
        brightness = 255.0 * min(force_n / self.config.full_scale_n, 1.0)
        for channel, sd_m in ((0, 0.0), (1, max(contact.x_sd_m or 0.0, contact.y_sd_m or 0.0))):
            square = ((x_m[None] - contact.x_m) ** 2 + (y_m[:, None] - contact.y_m) ** 2) / (FINGER_SD_M**2 + sd_m**2)
            image[:, :, channel] = np.rint(brightness * np.exp(-0.5 * square)).astype(np.uint8)
        return image
