"""`make demo FIRMWARE=1`: the binary that is flashed, on the emulated chip, with a daemon on its line and a finger."""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

from fmfts.cli.demo import end_on_signals

SEED = 1


def main() -> int:
    # Imported here, where Ctrl-C is waited for: it takes half a second.
    sys.path.insert(0, str(Path(__file__).parents[1]))
    from end_to_end.firmware_in_the_loop import EMULATED_CONFIG, EmulatedBoard, PressedPad, SlowedDaemon
    from fmfts.config.file import load
    from fmfts.simulation.finger import ScriptedFinger
    from fmfts.view.listen import listen

    end_on_signals()
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float)
    seconds = parser.parse_args().seconds
    print(
        "finger → magnet → emulated sensors → firmware on an emulated STM32F103 → pty → fmfts-daemon → ZeroMQ → here",
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
        pressed.press(ScriptedFinger(SEED))
        return listen(None, seconds, endpoint=daemon.base)


if __name__ == "__main__":
    raise SystemExit(main())
