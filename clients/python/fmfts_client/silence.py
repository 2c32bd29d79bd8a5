"""Finds the likely reason why a daemon does not answer, as far as a client can see it."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Optional

from fmfts_client.endpoints import OVERRIDE
from fmfts_client.keys import KEY_VARIABLE

IPC = "ipc://"


def why_silent(endpoint: str, environ: Mapping[str, str] = os.environ, key: Optional[Path] = None) -> str:
    """What to check when nothing arrives from `endpoint`; ZeroMQ tries for ever, and never reports an error.

    key: the client's key file that was shown there; None: the one that FMFTS_KEY names, if any.
    """
    if endpoint.startswith(IPC):
        socket = endpoint[len(IPC) :]
        if _is_closed(socket):
            return (
                f"{socket} is closed to you: join the group of its daemon "
                "(as a service: sudo usermod -aG fmfts $USER, then log in again)"
            )
        return f"is fmfts-daemon running, and on this endpoint ({OVERRIDE})?"
    if shown := key or environ.get(KEY_VARIABLE):
        return f"is fmfts-daemon running, and is {shown} a key of its list (`fmfts-daemon keys list` there)?"
    return f"is fmfts-daemon running? If it serves with keys, set {KEY_VARIABLE} to your key's file"


def _is_closed(socket: str) -> bool:
    try:
        os.stat(socket)
    except PermissionError:
        return True
    except OSError:
        return False
    return not os.access(socket, os.W_OK)
