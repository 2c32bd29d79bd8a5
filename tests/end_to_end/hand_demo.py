"""`make demo HAND=1`: five boards (the firmware's host build on ptys), a daemon, the page, and a fixed baseline.

Options: --seconds ends it with a summary. The address of the page is printed; BROWSER=none opens no browser.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections import deque
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import msgpack
import zmq

sys.path.insert(0, str(Path(__file__).parents[1]))

from end_to_end.hand_world import CYCLE_S, NAMES, ROOM_C, UNPLUGGED_S, HandWorld, act_at, config_of
from end_to_end.processes import FirmwareHost, RunningDaemon
from fmfts.cli.demo import end_on_signals
from fmfts.cli.page_beside import page_beside
from fmfts.config.file import load

MOVES_A_SECOND = 30
WRONG_N = 0.2
# Only steady moments are judged: a force that changes by 3 N/s is off by 0.03 N after the 10 ms from sample to message.
SETTLED_S, STEADY_N, FEWEST_MOVES = 0.15, 0.02, 4
CAPTION_S = 0.3
UID = "68616e64{:016x}"


class Hand:
    """The five boards, moved as the world says. Boards and daemon are real; only the chips' field is made up."""

    def __init__(self, folder: Path) -> None:
        self._folders = [folder / name for name in NAMES]
        for each in self._folders:
            each.mkdir()
        self._boards: list[FirmwareHost | None] = [self._board(number) for number in range(len(NAMES))]
        self.config = config_of([str(each / "board") for each in self._folders])
        self._captioned_s = -CAPTION_S
        self.world: HandWorld
        self.daemon: RunningDaemon
        self.captions: zmq.Socket[bytes]
        self.address = ""

    def _board(self, number: int) -> FirmwareHost:
        return FirmwareHost(self._folders[number], "--uid", UID.format(number))

    def still(self, mounted: bool) -> None:
        for number, board in enumerate(self._boards):
            assert board is not None
            board.field(self.world.field(number, 0.0, still=True, mounted=mounted))

    def bare(self, number: int) -> None:
        """This pad is taken off; the others stay mounted."""
        board = self._boards[number]
        assert board is not None
        board.field(self.world.field(number, 0.0, still=True, mounted=False))

    def move(self, time_s: float) -> list[float]:
        """Put the world as it is at `time_s` around the boards; pull and put the ring finger's plug. Returns forces."""
        ring, now = NAMES.index("ring"), time_s % CYCLE_S
        pulled = UNPLUGGED_S[0] <= now < UNPLUGGED_S[1]
        board = self._boards[ring]
        if pulled and board is not None:
            board.kill()
            self._boards[ring] = None
        elif not pulled and board is None:
            self._boards[ring] = self._board(ring)
        for number, each in enumerate(self._boards):
            if each is not None:
                each.field(self.world.field(number, time_s))
                each.tell(f"temperature 0 {ROOM_C + self.world.warming_k(number, time_s):.2f}")
        if time_s - self._captioned_s >= CAPTION_S:  # again and again, for pages that open later
            self._captioned_s = time_s
            self.captions.send_multipart((b"caption/", msgpack.packb({"text": act_at(time_s).text})))
        return [self.world.touch(number, time_s)[2] for number in range(len(NAMES))]

    def grips(self, time_s: float) -> bool:
        """Do all five pads press, and have for a while?"""
        return all(
            self.world.touch(number, time_s - ago)[2] > 0.5 for number in range(len(NAMES)) for ago in (0.0, 2.0)
        )

    def close(self) -> None:
        for board in self._boards:
            if board is not None:
                board.kill()


class Score:
    """How often each way is wrong by more than WRONG_N, and how often the daemon says that it does not know."""

    def __init__(self) -> None:
        self._forces: deque[tuple[float, list[float]]] = deque(maxlen=MOVES_A_SECOND * 5)
        self.told = {"daemon": 0, "ghost": 0}
        self.wrong = {"daemon": 0, "ghost": 0}
        self.worst_n = {"daemon": 0.0, "ghost": 0.0}
        self.unknown = self.false_contacts = 0

    def moved(self, forces_n: list[float]) -> None:
        """The boards have these forces from now on."""
        self._forces.append((time.monotonic(), forces_n))

    def take(self, who: str, pad: str, body: dict[str, Any]) -> None:
        sampled_s = body["t_sample_ns"] * 1e-9
        number = NAMES.index(pad)
        around = [forces[number] for moment, forces in self._forces if abs(moment - sampled_s) < SETTLED_S]
        if len(around) < FEWEST_MOVES or max(around) - min(around) > STEADY_N:
            return
        self.false_contacts += who == "daemon" and body["contact"] is True and max(around) == 0.0
        if body.get("over_range"):
            return
        force_n = 0.0 if body.get("contact") is False else body["force_n"]
        if force_n is None or (who == "daemon" and body["contact"] is None):
            self.unknown += who == "daemon"
            return
        off_n = abs(force_n - around[-1])
        self.told[who] += 1
        self.worst_n[who] = max(self.worst_n[who], off_n)
        if off_n > WRONG_N:
            self.wrong[who] += 1

    def lines(self) -> list[str]:
        def of(who: str, name: str) -> str:
            share = 100.0 * self.wrong[who] / max(self.told[who], 1)
            return f"  {name} {share:5.1f} % of {self.told[who]} messages; the worst by {self.worst_n[who]:.2f} N"

        return [
            f"wrong by more than {WRONG_N:g} N:",
            of("ghost", "a fixed baseline"),
            of("daemon", "fmfts-daemon    "),
            f"  fmfts-daemon said {self.unknown} times that the force is not known, with the reason,",
            f"  and {self.false_contacts} times that something touches where nothing does",
        ]


def wait_for_news(daemon: RunningDaemon, pad: str) -> None:
    """Until the pad's frames are of the field that its board has now, and its chips have settled."""
    since_ns = time.monotonic_ns() + int(SETTLED_S * 1e9)
    daemon.wait_for(lambda contact: contact.pad == pad and contact.t_sample_ns > since_ns)


def record_baselines(daemon: RunningDaemon, hand: Hand) -> None:
    print("recording the baselines of five pads: bare, then at rest", flush=True)
    for number, name in enumerate(NAMES):
        hand.bare(number)
        wait_for_news(daemon, name)
        daemon.request("baseline", pad=name, bare=True, duration_s=1.0, timeout_s=30.0)
        hand.still(mounted=True)
    for name in NAMES:
        wait_for_news(daemon, name)
        daemon.request("baseline", pad=name, duration_s=1.0, timeout_s=30.0)


def served_hand(folder: Path, stack: ExitStack) -> Hand:
    """A hand with baselines, read by a daemon and shown by the page at its `address`, with captions and ghosts."""
    hand = Hand(folder)
    stack.callback(hand.close)
    (folder / "bus").mkdir()
    config = folder / "hand.toml"
    config.write_text(hand.config)
    hand.world = HandWorld(load(config)[0])
    hand.still(mounted=True)
    hand.daemon = stack.enter_context(RunningDaemon(folder / "bus", hand.config))
    for name in NAMES:
        hand.daemon.wait_for(lambda contact, name=name: contact.pad == name and contact.sensors_ok == 0b1111)
    record_baselines(hand.daemon, hand)
    hand.captions = zmq.Context.instance().socket(zmq.PUB)
    stack.callback(hand.captions.close, 0)
    hand.captions.bind(f"ipc://{folder}/caption")
    options = ("--fixed-baseline", "--ghost-endpoint", f"ipc://{folder}/ghost", "--beside", f"ipc://{folder}/caption")
    line = stack.enter_context(page_beside(folder, hand.daemon.base, *options))()
    print(line, flush=True)
    hand.address = line.removeprefix("the page: ")
    return hand


def run(seconds: float | None, folder: Path, stack: ExitStack) -> Score:
    hand = served_hand(folder, stack)
    ghosts = zmq.Context.instance().socket(zmq.SUB)
    stack.callback(ghosts.close, 0)
    ghosts.subscribe(b"ghost/")
    ghosts.connect(f"ipc://{folder}/ghost")
    return play(seconds, hand, stack.enter_context(hand.daemon.subscribe()), ghosts)


def play(seconds: float | None, hand: Hand, contacts: Any, ghosts: Any) -> Score:
    score, begun, said = Score(), time.monotonic(), ""
    try:
        while seconds is None or time.monotonic() - begun < seconds:
            now = time.monotonic() - begun
            forces_n = hand.move(now)
            score.moved(forces_n)
            text = act_at(now).text
            if text != said:
                print(text, flush=True)
                said = text
            while (message := contacts.receive(0.0)) is not None:
                score.take("daemon", message.pad, message.body)
            while ghosts.poll(0):
                topic, body = ghosts.recv_multipart()
                score.take("ghost", topic.decode().partition("/")[2], msgpack.unpackb(body))
            time.sleep(max(0.0, 1.0 / MOVES_A_SECOND - (time.monotonic() - begun - now)))
    except KeyboardInterrupt:
        pass  # the usual end
    return score


def main() -> int:
    end_on_signals()
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float)
    seconds = parser.parse_args().seconds
    with tempfile.TemporaryDirectory(prefix="fmfts-hand-") as name, ExitStack() as stack:
        score = run(seconds, Path(name), stack)
    print(*score.lines(), sep="\n", flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
