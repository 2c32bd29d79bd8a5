"""`make transcript`: types first use on the firmware's host build, and writes the output into docs/first-use.md."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from end_to_end.processes import FirmwareHost, resting_field
from fmfts.config.file import load

PAGE = Path(__file__).parents[2] / "docs/first-use.md"
BEGIN, END = "<!-- made by `make transcript`: begin -->\n", "<!-- end -->\n"
PORT = "/dev/serial/by-id/usb-fmfts"
COMMANDS = (
    f"fmfts-daemon init --port {PORT}",
    "fmfts-daemon check-config --config pad.toml",
    "fmfts-daemon probe --config pad.toml",
    "fmfts-daemon selftest --config pad.toml",
    "fmfts-daemon baseline --bare --config pad.toml",
    "fmfts-daemon baseline --rest --config pad.toml",
)
EARTH_T = np.tile([2e-5, 0.0, 4e-5], (4, 1))
MOST_LINES = 8  # of a command; the last hint says what comes next


def transcript(folder: Path) -> str:
    """What the commands print. The board's pty is called as a board's port would be."""
    environment = os.environ | {"FMFTS_BUS": f"ipc://{folder}", "XDG_STATE_HOME": str(folder / "state")}
    said = []
    with FirmwareHost(folder) as board:
        for command in COMMANDS:
            if "--bare" in command:
                board.field(EARTH_T)
            elif "--rest" in command:
                board.field(resting_field(load(folder / "pad.toml")[0].pad[0].pad()) + EARTH_T)
            words = [sys.executable, "-m", "fmfts", *shlex.split(command.replace(PORT, str(board.port)))[1:]]
            ended = subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True, check=False)
            if ended.returncode != 0:
                raise SystemExit(f"{command}: {ended.stderr}")
            text = ended.stdout.replace(str(board.port), PORT).replace(str(folder), "~")
            said.append(f"$ {command}\n{_shortened(text)}")
    return "".join(said)


def _shortened(text: str) -> str:
    lines = text.splitlines()
    if len(lines) > MOST_LINES:
        lines = [*lines[: MOST_LINES - 2], "…", lines[-1]]
    return "".join(f"{line}\n" for line in lines)


def stable(text: str) -> str:
    """Without parts that differ from run to run: figures, ids, and signs of figures."""
    return re.sub(r"[-+]?\d+(\.\d+)?", "0", re.sub(r"\b[0-9a-f]{12,}\b", "0", text))


def shown(page: str) -> str:
    """The transcript that the page has now."""
    inside = page[page.index(BEGIN) + len(BEGIN) : page.index(END)]
    return inside.strip("\n").removeprefix("```\n").removesuffix("\n```") + "\n"


def main() -> None:
    with tempfile.TemporaryDirectory(prefix="fmfts-first-use-") as name:
        made = transcript(Path(name))
    page = PAGE.read_text()
    before, after = page[: page.index(BEGIN)], page[page.index(END) :]
    PAGE.write_text(f"{before}{BEGIN}\n```\n{made}```\n\n{after}")


if __name__ == "__main__":
    main()
