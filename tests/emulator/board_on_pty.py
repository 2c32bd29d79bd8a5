"""A firmware ELF on the emulated board, its UART on a pty, in real time: to a daemon, a board like any other.

    python tests/emulator/board_on_pty.py firmware/build/fmfts.elf --link /tmp/board

prints the pty's path, then obeys the commands of fmfts-host on standard input until that closes or SIGTERM comes. At
the end it says on standard error how fast it was and what the firmware did wrong.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import select
import signal
import sys
import time
import tty
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from emulator.stm32_board import DEFAULT_UID, Board
from emulator.stm32_commands import Line, Session, WrongCommandError, execute

SLICE_S = 0.002
GIVE_UP_S = 1.0  # so far behind real time, the time lost is let go
CHIP_NOISE_MICROTESLA = 0.2


class Pty:
    """The host's serial port. Nobody there: what the board sends is lost. Too slow: what does not fit is."""

    def __init__(self, link: Path | None) -> None:
        self.master, slave = os.openpty()
        tty.setraw(slave)
        os.set_blocking(self.master, False)
        self.path = os.ttyname(slave)
        os.close(slave)  # from now on a hang-up tells whether anyone has the port open
        self.link = link
        if link:
            if link.is_symlink():  # only a link is ever replaced: a mistyped path must not cost a file
                link.unlink()
            link.symlink_to(self.path)

    def exchange(self, data: bytes) -> bytes:
        """Hand over what the board sent; what the host sent comes back."""
        poll = select.poll()
        poll.register(self.master, select.POLLIN)
        if any(events & select.POLLHUP for _, events in poll.poll(0)):
            return b""
        if data:
            with contextlib.suppress(BlockingIOError):
                os.write(self.master, data)
        try:
            return os.read(self.master, 4096)
        except (BlockingIOError, OSError):
            return b""

    def close(self) -> None:
        if self.link and self.link.is_symlink() and os.readlink(self.link) == self.path:
            self.link.unlink()
        os.close(self.master)


class Orders:
    """Lines on standard input, without ever waiting for them; closed: `ended`."""

    def __init__(self) -> None:
        self.ended = False
        self._rest = b""

    def end(self) -> None:
        self.ended = True

    def lines(self) -> list[str]:
        if not select.select([sys.stdin], [], [], 0)[0]:
            return []
        data = os.read(sys.stdin.fileno(), 65536)
        self.ended |= not data
        *lines, self._rest = (self._rest + data).split(b"\n")
        return [line.decode(errors="replace") for line in lines]

    def obey(self, session: Session) -> None:
        for line in self.lines():
            if line.strip() == "quit":
                self.end()
                return
            try:
                execute(session, line)
                print("ok", flush=True)
            except WrongCommandError as wrong:
                print(f"error: {wrong}", flush=True)


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


def stream(session: Session, pty: Pty, orders: Orders) -> float:
    """Until the orders end. Returns board seconds per second of CPU time."""
    begun_s = time.process_time()
    due = time.monotonic()
    while not orders.ended:
        orders.obey(session)
        session.board.send(pty.exchange(spoil(session.line, session.board.run(SLICE_S))))
        now = time.monotonic()
        due += SLICE_S
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
    parser.add_argument("--no-crystal", action="store_true", help="the 8 MHz crystal does not start")
    return parser.parse_args()


def main() -> int:
    chosen = options()
    orders = Orders()
    board = Board(chosen.elf, chosen.pads, chosen.uid, hse_ok=not chosen.no_crystal)
    session = Session(board, Line())
    for pad in range(chosen.pads):
        execute(session, f"noise {pad} {CHIP_NOISE_MICROTESLA}")
    signal.signal(signal.SIGTERM, lambda *_: orders.end())
    pty = Pty(chosen.link)
    print(f"pty: {pty.path}", flush=True)
    try:
        factor = stream(session, pty, orders)
        print(f"{factor:.2f} board seconds per second of CPU time", *board.complaints, sep="\n", file=sys.stderr)
    except KeyboardInterrupt:
        pass
    finally:
        pty.close()
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
