"""What a client says where a daemon does not answer: what can be seen from here, and what to do."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from fmfts_client.silence import why_silent

AS_A_STRANGER = """
import os, sys
from fmfts_client.silence import why_silent
os.setgroups([])
os.setgid(65534)
os.setuid(65534)
print(why_silent(sys.argv[1]))
"""


def as_a_stranger(endpoint: str) -> str:
    words = [sys.executable, "-c", AS_A_STRANGER, endpoint]
    return subprocess.run(words, capture_output=True, text=True, check=True).stdout


def test_absent_daemon_leads_to_a_question_with_its_endpoint() -> None:
    assert why_silent("ipc:///nowhere/bus", {}) == "is fmfts-daemon running, and on this endpoint (FMFTS_BUS)?"


@pytest.mark.skipif(os.geteuid() != 0, reason="needs root, to be somebody else")
@pytest.mark.parametrize("folder_mode", [0o755, 0o750])
def test_socket_of_others_is_reported_to_be_closed(folder_mode: int) -> None:
    with tempfile.TemporaryDirectory() as folder, socket.socket(socket.AF_UNIX) as bus:  # pytest's folders are closed
        place = f"{folder}/bus"
        bus.bind(place)
        Path(place).chmod(0o660)
        Path(folder).chmod(folder_mode)
        told = as_a_stranger(f"ipc://{place}")
    assert told.startswith(f"{place} is closed to you: join the group of its daemon")


def test_over_tcp_the_key_may_be_what_is_missing() -> None:
    assert "set FMFTS_KEY to your key's file" in why_silent("tcp://127.0.0.1:5570", {})
    told = why_silent("tcp://127.0.0.1:5570", {"FMFTS_KEY": "/home/me/arm.key"})
    assert "/home/me/arm.key a key of its list" in told
