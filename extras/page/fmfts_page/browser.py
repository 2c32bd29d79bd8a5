"""Opens the page in a browser, where there is one, without showing its token to other users.

Every user reads every program's arguments in /proc, so the address with its token must not be one of them. The browser
gets a file instead, which its user alone may read and which leads to the address. A code that counts once would not do:
another user could read and use it before the browser has started.
"""

from __future__ import annotations

import html
import os
import sys
import tempfile
import threading
import webbrowser
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

SNAPS = (Path("/snap/bin"), Path("/var/lib/snapd/snap/bin"))
LEADS_ON = '<!doctype html><meta charset="utf-8"><title>fmfts</title><meta http-equiv="refresh" content="0; url={}">\n'


def may_open(environ: Mapping[str, str] = os.environ, platform: str = sys.platform) -> bool:
    """Is there a desktop, and does the user want a browser? BROWSER=none means no."""
    if environ.get("BROWSER", "").lower() == "none":
        return False
    return platform == "darwin" or bool(environ.get("DISPLAY") or environ.get("WAYLAND_DISPLAY"))


def folder_for_browsers(environ: Mapping[str, str] = os.environ, snaps: tuple[Path, ...] = SNAPS) -> Path:
    """Where the file may lie so that the browser finds it.

    A browser from a snap sees a private /tmp, not $XDG_RUNTIME_DIR, and nothing of home whose name begins with a dot.
    """
    if any(each.is_dir() for each in snaps):
        return Path.home()
    return Path(environ.get("XDG_RUNTIME_DIR") or tempfile.gettempdir())


@contextmanager
def shown_in_browser(address: str, folder: Path | None = None) -> Iterator[None]:
    """Open `address` in the user's browser, if there is one, and do not wait for it. Print the address in any case.

    folder: where the file that leads there is kept during the block. Raises OSError if it cannot be written.
    """
    if not may_open():
        yield
        return
    with tempfile.TemporaryDirectory(prefix="fmfts-page-", dir=folder or folder_for_browsers()) as private:
        file = Path(private) / "page.html"
        file.touch(mode=0o600)
        file.write_text(LEADS_ON.format(html.escape(address)))
        # `webbrowser` waits for the end of a program that BROWSER names, so it has a thread of its own.
        threading.Thread(target=_open, args=(file.as_uri(),), daemon=True).start()
        yield


def _open(file: str) -> None:
    if not webbrowser.open(file):
        print("no browser opened: open the address yourself; BROWSER names another program", file=sys.stderr)
