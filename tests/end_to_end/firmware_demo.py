"""`make demo FIRMWARE=1`: the binary that is flashed, on the emulated chip, with a daemon on its line and a finger."""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

from fmfts_simulation.demo import end_on_signals

SEED = 1


def main() -> int:
    # Imported here, where Ctrl-C is waited for: it takes half a second.
    sys.path.insert(0, str(Path(__file__).parents[1]))
    from end_to_end.firmware_in_the_loop import EMULATED_CONFIG, PACE, EmulatedBoard, PressedPad, SlowedDaemon
    from fmfts.config.file import load
    from fmfts_simulation.finger import ScriptedFinger

    end_on_signals()
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float)
    seconds = parser.parse_args().seconds
    print(
        "finger → magnet → emulated sensors → firmware on an emulated STM32F103 → pty → fmfts-daemon → ZeroMQ → here\n"
        f"(a second of the board, and of the daemon, takes {1 / PACE:g})",
        flush=True,
    )
    with (
        tempfile.TemporaryDirectory(prefix="fmfts-firmware-") as name,
        EmulatedBoard(Path(name)) as board,
        SlowedDaemon(Path(name), EMULATED_CONFIG.format(port=board.port)) as daemon,
        PressedPad(board, load(daemon.config)[0].pad[0].pad()) as pressed,
    ):
        daemon.wait_for(lambda contact: contact.sensors_ok == 0b1111)
        print("recording the baseline of the pad at rest", flush=True)
        recorded = daemon.command("baseline", "--rest", "--duration-s", "1", "--config", daemon.config)
        if recorded.returncode:
            sys.stderr.write(recorded.stderr)
            return recorded.returncode
        finger = ScriptedFinger(SEED)
        pressed.press(lambda at_s: finger(PACE * at_s))
        # A process of its own: the time of the messages is the slowed daemon's.
        duration = [] if seconds is None else ["--seconds", str(seconds)]
        command = [sys.executable, "-m", "fmfts", "listen", *duration]
        return subprocess.run(command, env=daemon.with_its_clock(), check=False).returncode


if __name__ == "__main__":
    raise SystemExit(main())
