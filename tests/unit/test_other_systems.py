"""The Python client and `replay` without what only POSIX has, as far as that can be tried on Linux."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from fmfts.bus.keys import KeyFolder

RECORDING = Path(__file__).parents[1] / "data" / "recordings" / "paper.mcap"
WITHOUT = """
import os, sys
for name in ("pwd", "grp", "fcntl", "termios", "resource", "tty", "pty"):
    sys.modules[name] = None
for name in ("getuid", "geteuid", "getgid", "fork", "O_NONBLOCK", "O_CLOEXEC"):
    delattr(os, name)
"""


def said(program: str, *words: object) -> str:
    command = [sys.executable, "-c", WITHOUT + program, *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


def test_client_needs_nothing_of_posix(tmp_path: Path) -> None:
    KeyFolder(tmp_path / "keys").add("arm", tmp_path / "arm.key")
    (tmp_path / "arm.key").chmod(0o666)  # as Windows shows every file
    told = said(
        """
from pathlib import Path
from fmfts_client import Client, EndpointError, Endpoints
with Client("left", Endpoints.from_base("tcp://127.0.0.1:5570", Path(sys.argv[1]))) as pad:
    print(pad.latest(timeout_s=0.01))
os.environ.pop("FMFTS_BUS", None)
try:
    Client("left")
except EndpointError as error:
    print(error)
""",
        tmp_path / "arm.key",
    )
    assert told.startswith("None\non Windows name the daemon's machine: FMFTS_BUS=tcp://")


def test_replay_needs_nothing_of_posix() -> None:
    told = said("from fmfts.cli.main import main; main(['replay', sys.argv[1]])", RECORDING)
    assert "recording: " in told
    assert "different: 0\n" in told
