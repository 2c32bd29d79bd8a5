"""`clients/python/examples/grip.py` as a process of its own, for a gripper that is simulated elsewhere.

python -m fmfts_mujoco.gripping PAD PAD. A byte on standard input, 1 or 0, says whether the arm stands still in the air.
Each step of the example answers with a line: how fast to close, whether the arm may lift, whether the least force is
known.
"""

from __future__ import annotations

import os
import sys
from typing import Any

from fmfts_mujoco.rivals import example


class Arm:
    """Whether it stands still with the object in the air, by the last byte that arrived."""

    def __init__(self) -> None:
        os.set_blocking(sys.stdin.fileno(), False)
        self._stands = False

    def __call__(self) -> bool:
        try:
            if said := os.read(sys.stdin.fileno(), 4096):
                self._stands = said.endswith(b"1")
        except BlockingIOError:
            pass
        return self._stands


def act(command: Any, found: bool) -> None:
    print(f"{command.close_m_per_s:.9f} {command.may_lift:d} {found:d}", flush=True)


if __name__ == "__main__":
    example().hold(sys.argv[1:], Arm(), act)
