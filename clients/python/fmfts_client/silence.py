"""Why a daemon may not answer, as far as that can be seen from here."""

from __future__ import annotations

import os
from collections.abc import Mapping

from fmfts_client.endpoints import OVERRIDE
from fmfts_client.keys import KEY_VARIABLE

IPC = "ipc://"


def why_silent(endpoint: str, environ: Mapping[str, str] = os.environ) -> str:
    """What to look at where nothing comes from `endpoint`: ZeroMQ goes on trying, and never says what failed."""
    if endpoint.startswith(IPC):
        socket = endpoint[len(IPC) :]
        if _is_closed(socket):
            return (
                f"{socket} is closed to you: join the group of its daemon "
                "(as a service: sudo usermod -aG fmfts $USER, then log in again)"
            )
        return f"is fmfts-daemon running, and on this endpoint ({OVERRIDE})?"
    if environ.get(KEY_VARIABLE):
        return (
            f"is fmfts-daemon running, and {environ[KEY_VARIABLE]} a key of its list (`fmfts-daemon keys list` there)?"
        )
    return f"is fmfts-daemon running? If it serves with keys, {KEY_VARIABLE} has to name the file of yours"


def _is_closed(socket: str) -> bool:
    try:
        os.stat(socket)
    except PermissionError:
        return True
    except OSError:
        return False
    return not os.access(socket, os.W_OK)
