"""A firmware ELF on the emulated board, its UART on a pty, in real time: to a daemon, a board like any other.

    python tests/emulator/board_on_pty.py firmware/build/fmfts.elf --link /tmp/board

prints the pty's path, then obeys the commands of fmfts-host on standard input until that closes or SIGTERM comes. At
the end it reports on standard error how fast it was and the firmware's mistakes.
"""

from __future__ import annotations

import argparse
import signal
import sys
import time
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from emulator.board_port import Orders, Pty
from emulator.magnetometers import Lis3mdl, Mmc5603nj, Mmc5983ma, Qmc5883l, Qmc5883p
from emulator.mlx90393 import Mlx90393
from emulator.stm32_board import DEFAULT_UID, Board
from emulator.stm32_commands import Line, Session, execute

SLICE_S = 0.002
GIVE_UP_S = 1.0  # if the board is this far behind real time, it skips the lost time
CHIP_NOISE_MICROTESLA = 0.2
OTHER_CHIPS = {  # with their noise in µT, of the MEMSIC chips at 2 ms a measurement
    "qmc5883l": (Qmc5883l, 0.2),
    "qmc5883p": (Qmc5883p, 0.2),
    "mmc5983ma": (Mmc5983ma, 0.08),
    "mmc5603nj": (Mmc5603nj, 0.363),
    "lis3mdl": (Lis3mdl, 0.32),
    "mlx90393": (Mlx90393, 1.5),
}


def spoil(line: Line, data: bytes) -> bytes:
    """Cut a packet, closing zero included, and put garbage between two."""
    if line.cut_next and data.count(0) >= 2:
        first, second = data.index(0), data.index(0, data.index(0) + 1)
        data = data[: (first + second) // 2] + data[second + 1 :]
        line.cut_next = False
    if line.garbage and 0 in data:
        end = data.index(0) + 1
        data, line.garbage = data[:end] + line.garbage + data[end:], b""
    return data


def stream(session: Session, pty: Pty, orders: Orders, pace: float) -> float:
    """Run until the orders end. Returns board seconds per second of CPU time."""
    begun_s = time.process_time()
    due = time.monotonic()
    while not orders.ended:
        orders.obey(partial(execute, session))
        session.board.send(pty.exchange(spoil(session.line, session.board.run(SLICE_S))))
        now = time.monotonic()
        due += SLICE_S / pace
        if now < due:
            time.sleep(due - now)
        elif now > due + GIVE_UP_S:
            due = now
    return session.board.now_s / (time.process_time() - begun_s)


def options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("elf", type=Path)
    parser.add_argument("--link", type=Path, help="make this a symbolic link to the pty, and remove it at the end")
    parser.add_argument("--pads", type=int, choices=(1, 2, 3), default=1)
    parser.add_argument("--uid", type=bytes.fromhex, default=DEFAULT_UID, help="96-bit id, 24 hex digits")
    parser.add_argument("--pace", type=float, default=1.0, help="the board's seconds in one of ours, at most")
    parser.add_argument("--chips", choices=OTHER_CHIPS, help="on the first pad, in place of HMC5983")
    parser.add_argument("--no-crystal", action="store_true", help="the 8 MHz crystal does not start")
    return parser.parse_args()


def main() -> int:
    chosen = options()
    orders = Orders()
    board = Board(chosen.elf, chosen.pads, chosen.uid, hse_ok=not chosen.no_crystal)
    session = Session(board, Line())
    noise_microtesla = [CHIP_NOISE_MICROTESLA] * chosen.pads
    if chosen.chips:
        emulated, noise_microtesla[0] = OTHER_CHIPS[chosen.chips]
        board.hang_other_chips(emulated)
    for pad, noise in enumerate(noise_microtesla):
        execute(session, f"noise {pad} {noise}")
    signal.signal(signal.SIGTERM, lambda *_: orders.end())
    pty = Pty(chosen.link)
    print(f"pty: {pty.path}", flush=True)
    try:
        factor = stream(session, pty, orders, chosen.pace)
        print(f"{factor:.2f} board seconds per second of CPU time", *board.complaints, sep="\n", file=sys.stderr)
    except KeyboardInterrupt:
        pass
    finally:
        pty.close()
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
