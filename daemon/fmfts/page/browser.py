"""Opens the page in a browser, where there is one."""

from __future__ import annotations

import os
import sys
import webbrowser
from collections.abc import Mapping


def may_open(environ: Mapping[str, str] = os.environ, platform: str = sys.platform) -> bool:
    """Is there a desktop, and does the user want a browser? BROWSER=none means no."""
    if environ.get("BROWSER", "").lower() == "none":
        return False
    return platform == "darwin" or bool(environ.get("DISPLAY") or environ.get("WAYLAND_DISPLAY"))


def open_page(address: str) -> None:
    """Open `address` in the user's browser, if there is one; the address is printed in any case."""
    if may_open():
        webbrowser.open(address)
