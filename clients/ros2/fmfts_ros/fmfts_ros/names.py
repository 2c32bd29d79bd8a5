"""Makes ROS names of pads' names: ROS allows letters, digits and _, and no digit at the beginning."""

from __future__ import annotations

import re
import threading


class RosNames:
    """Gives each pad its own ROS name; the same pad always the same one.

    Two pads whose names differ only in what ROS forbids ("a-b", "a_b") get different names: the second ends in `_2`.
    """

    def __init__(self) -> None:
        self._by_pad: dict[str, str] = {}
        self._lock = threading.Lock()

    def of(self, pad: str) -> str:
        with self._lock:
            if pad not in self._by_pad:
                self._by_pad[pad] = self._unused(legal(pad))
            return self._by_pad[pad]

    def _unused(self, name: str) -> str:
        taken = set(self._by_pad.values())
        candidate, number = name, 1
        while candidate in taken:
            number += 1
            candidate = f"{name}_{number}"
        return candidate


def legal(pad: str) -> str:
    """ "left-finger" → "left_finger", "2" → "pad_2". ROS also refuses two underscores in a row, and one at the end."""
    name = re.sub(r"_+", "_", re.sub(r"[^A-Za-z0-9_]", "_", pad)).strip("_")
    return name if name[:1].isalpha() else f"pad_{name}".rstrip("_")
