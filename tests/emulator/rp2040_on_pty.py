"""The Pico's firmware on rp2040js, its own USB on a pty: to a daemon, a Pico like any other, only slower.

    python tests/emulator/rp2040_on_pty.py .venv/node_modules/rp2040js firmware/build/fmfts-rp2040.bin --link /tmp/pico

prints the pty's path, then obeys commands on standard input until that closes or SIGTERM comes:

    field MICROTESLA …      twelve numbers: x, y, z of each chip
    fault CHIP unplugged    the chip from 0; `none` puts it back

rp2040js takes a few seconds for one of the board's. --pace says how much slower the board shall run, evenly; give the
daemon the same pace (`faketime -f '+0 x0.1'`), and to it the board runs at its full rate.
"""

from __future__ import annotations

import argparse
import signal
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))

from emulator.board_port import Orders, Pty, WrongCommandError
from emulator.chips import Hmc5983
from emulator.magnetometers import Lis3mdl, Mmc5603nj, Mmc5983ma, Qmc5883l, Qmc5883p
from emulator.mlx90393 import Mlx90393
from emulator.rp2040_board import Rp2040Board

SLICE_S = 0.005
GAUSS_PER_MICROTESLA = 1e-2
NOISE_GAUSS: dict[str, tuple[Any, float]] = {  # as in docs/chips.md, at the rates of a pad with 220 Hz
    "hmc5983": (Hmc5983, 2e-3),
    "qmc5883l": (Qmc5883l, 2e-3),
    "qmc5883p": (Qmc5883p, 2e-3),
    "mmc5983ma": (Mmc5983ma, 8e-4),
    "mmc5603nj": (Mmc5603nj, 3.63e-3),
    "lis3mdl": (Lis3mdl, 4.6e-3),
    "mlx90393": (Mlx90393, 15e-3),
}


def made(chosen: argparse.Namespace, number: int, time_s: Callable[[], float]) -> Any:
    kind, noise_gauss = NOISE_GAUSS[chosen.chips]
    chip = kind(
        time_s,
        clock_error=(number - 1.5) * 0.01,
        phase_s=0.0007 * number,
        address=chosen.addresses[number] if chosen.addresses else None,
        noise_gauss=noise_gauss,
        seed=number + 1,
    )
    chip.absent = number in chosen.without
    return chip


def execute(board: Rp2040Board, line: str) -> None:
    """Execute the line; WrongCommandError if it is not a command."""
    try:
        match line.split():
            case ["field", *words] if len(words) == 3 * len(board.chips):
                values = [float(word) * GAUSS_PER_MICROTESLA for word in words]
                for number, chip in enumerate(board.chips):
                    chip.field_gauss = values[3 * number : 3 * number + 3]
            case ["fault", number, "unplugged"]:
                board.chips[int(number)].absent = True
            case ["fault", number, "none"]:
                board.chips[int(number)].power_on()
                board.chips[int(number)].absent = False
            case _:
                raise WrongCommandError(
                    "there are `field` with twelve numbers, `fault CHIP unplugged` or `none`, and quit"
                )
    except (ValueError, IndexError) as wrong:
        raise WrongCommandError(str(wrong)) from wrong


def stream(board: Rp2040Board, pty: Pty, orders: Orders, pace: float) -> None:
    """Run until the orders end."""
    board.run(0.02)
    board.usb("plug")
    board.run(0.06)
    is_open = False
    due_s = time.monotonic()
    while not orders.ended:
        orders.obey(partial(execute, board))
        if pty.is_open() != is_open:
            is_open = not is_open
            board.usb("open", int(is_open))
        board.run(SLICE_S)
        received = pty.exchange(b"".join(board.over_usb))
        board.over_usb.clear()
        if received:
            board.usb("send", *received)
        due_s = max(due_s + SLICE_S / pace, time.monotonic() - SLICE_S / pace)
        time.sleep(max(0.0, due_s - time.monotonic()))


def numbers(text: str) -> Sequence[int]:
    return [int(word, 0) for word in text.split(",")]


def options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("library", type=Path, help="the folder of rp2040js")
    parser.add_argument("image", type=Path, help="the firmware, a .bin")
    parser.add_argument("--link", type=Path, help="make this a symbolic link to the pty, and remove it at the end")
    parser.add_argument("--chips", choices=NOISE_GAUSS, default="mmc5983ma")
    parser.add_argument("--channels", type=numbers, default=range(4), help="of the switch, for each chip: 0,1,2,3")
    parser.add_argument("--addresses", type=numbers, help="of each chip, which then hangs on the port without a switch")
    parser.add_argument("--without", type=numbers, default=(), help="chips that do not answer, from 0")
    parser.add_argument("--pace", type=float, default=1.0, help="the board's seconds in one of ours, at most")
    return parser.parse_args()


def main() -> int:
    chosen = options()
    orders = Orders()
    signal.signal(signal.SIGTERM, lambda *_: orders.end())
    pty = Pty(chosen.link)
    channels = None if chosen.addresses else chosen.channels
    board = Rp2040Board(chosen.library.resolve() / "dist/cjs/index.js", chosen.image, partial(made, chosen), channels)
    print(f"pty: {pty.path}", flush=True)
    try:
        stream(board, pty, orders, chosen.pace)
        print(*board.complaints, sep="\n", file=sys.stderr)
    except KeyboardInterrupt:
        pass
    finally:
        pty.close()
        board.close()
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
