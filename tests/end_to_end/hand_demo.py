"""`make demo HAND=1`: five boards (the firmware's host build on ptys), a daemon, the page, and two other methods beside
it.

The others are a fixed baseline, and the same daemon with a hand that was never turned. Options: --seconds ends it with
a summary; --runs N plays N whole cycles, each of another world, and judges them together. The address of the page is
printed; BROWSER=none opens no browser.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import ExitStack, contextmanager
from pathlib import Path
from shutil import copytree
from typing import Any

import msgpack
import zmq

sys.path.insert(0, str(Path(__file__).parents[1]))

from end_to_end.hand_score import GHOST, SETTLED_S, TITLES, TURNED, UNTURNED, Score, Verdict, is_better, table
from end_to_end.hand_world import CYCLE_S, NAMES, ROOM_C, SEED, UNPLUGGED_S, HandWorld, act_at, config_of
from end_to_end.processes import FirmwareHost, RunningDaemon
from fmfts.config.file import load
from fmfts_client import RefusedError
from fmfts_simulation.demo import end_on_signals
from fmfts_simulation.page_beside import page_beside

MOVES_A_SECOND = 30
LONGEST_STEP_S = 2.0 / MOVES_A_SECOND
CAPTION_S, SAID_EVERY_S = 0.3, 1.0
UID = "68616e64{:016x}"
AT_REST_S, TRIES = 1.0, 3


class HandClock:
    """The hand's time. If a busy computer delays it, it does not catch up at once: a turning field would cut a
    corner."""

    def __init__(self) -> None:
        self.time_s, self._at_s = 0.0, time.monotonic()

    def go_on(self) -> float:
        """The hand's time now, at most LONGEST_STEP_S later than at the last call."""
        before_s, self._at_s = self._at_s, time.monotonic()
        self.time_s += min(self._at_s - before_s, LONGEST_STEP_S)
        return self.time_s


class Hand:
    """The five boards, moved as the world says. Boards and daemon are real; only the chips' field is computed."""

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
        self.beside = ""  # reports of the three methods, for the page

    def _board(self, number: int) -> FirmwareHost:
        return FirmwareHost(self._folders[number], "--uid", UID.format(number))

    def still(self, bare: int | None = None) -> None:
        """The hand stands still, and nothing touches it. bare: the number of a pad that is taken off."""
        for number, board in enumerate(self._boards):
            assert board is not None
            board.field(self.world.untouched(number, self.world.earth_t(0.0), mounted=number != bare))

    def tumble(self, time_s: float) -> None:
        """The untouched hand turns."""
        earth_t = self.world.tumbling_t(time_s + 1.0 / MOVES_A_SECOND)
        for number, board in enumerate(self._boards):
            assert board is not None
            board.glide(self.world.untouched(number, earth_t), 1.0 / MOVES_A_SECOND)

    def move(self, time_s: float) -> list[float]:
        """Lead the world around the boards to its state after the next of MOVES_A_SECOND; pull and put back the ring
        finger's plug. Returns the forces at `time_s`."""
        ring, now = NAMES.index("ring"), time_s % CYCLE_S
        pulled = UNPLUGGED_S[0] <= now < UNPLUGGED_S[1]
        board = self._boards[ring]
        if pulled and board is not None:
            board.kill()
            self._boards[ring] = None
        elif not pulled and board is None:
            self._boards[ring] = board = self._board(ring)
            board.field(self.world.field(ring, time_s))
        for number, each in enumerate(self._boards):
            if each is not None:
                each.glide(self.world.field(number, time_s + 1.0 / MOVES_A_SECOND), 1.0 / MOVES_A_SECOND)
                each.tell(f"temperature 0 {ROOM_C + self.world.warming_k(number, time_s):.2f}")
        if time_s - self._captioned_s >= CAPTION_S:  # repeated for pages that open later
            self._captioned_s = time_s
            text = f"{act_at(time_s).text} {self.beside}".strip()
            self.captions.send_multipart((b"caption/", msgpack.packb({"text": text})))
        return [self.world.touch(number, time_s)[2] for number in range(len(NAMES))]

    def grips(self, time_s: float) -> bool:
        """True if all five pads are pressed, and have been for a while."""
        return all(
            self.world.touch(number, time_s - ago)[2] > 0.5 for number in range(len(NAMES)) for ago in (0.0, 2.0)
        )

    def close(self) -> None:
        for board in self._boards:
            if board is not None:
                board.kill()


def wait_for_news(daemon: RunningDaemon, pad: str) -> None:
    """Wait until the pad's frames show the board's present field, and its chips have settled."""
    since_ns = time.monotonic_ns() + int(SETTLED_S * 1e9)
    daemon.wait_for(lambda contact: contact.pad == pad and contact.t_sample_ns > since_ns)


def asked(daemon: RunningDaemon, verb: str, pad: str, **arguments: Any) -> None:
    """Ask for a step of the set-up; repeat it, as a person would, if a busy computer lost frames of it."""
    for left in reversed(range(TRIES)):
        try:
            daemon.request(verb, pad=pad, timeout_s=60.0, **arguments)
            return
        except RefusedError as error:
            if not left:
                raise
            print(f"({error}: once more)", end=" ", flush=True)


def set_up(daemon: RunningDaemon, hand: Hand, unturned: Path) -> None:
    """Self-test, bare, rest and turn of the five pads. unturned: where to copy the baselines to before the turn."""

    def together(verb: str, meanwhile: Callable[[float], None] = lambda time_s: None, **arguments: Any) -> None:
        """Send the request to all pads at once; `meanwhile` moves the hand."""
        with ThreadPoolExecutor(len(NAMES)) as threads:
            steps = [threads.submit(asked, daemon, verb, name, **arguments) for name in NAMES]
            clock = HandClock()
            while wait(steps, 1.0 / MOVES_A_SECOND).not_done:
                meanwhile(clock.go_on())
        for each in steps:
            each.result()

    print("setting up five pads: self-test,", end=" ", flush=True)
    together("selftest")
    print("bare,", end=" ", flush=True)
    for number, name in enumerate(NAMES):
        hand.still(bare=number)
        wait_for_news(daemon, name)
        asked(daemon, "baseline", name, bare=True, duration_s=AT_REST_S)
    hand.still()
    wait_for_news(daemon, NAMES[-1])
    print("rest,", end=" ", flush=True)
    together("baseline", duration_s=AT_REST_S)
    copytree(daemon.folder / "state" / "fmfts" / "baseline", unturned)
    print("turn", flush=True)
    together("baseline", hand.tumble, turn=True)
    hand.still()
    wait_for_news(daemon, NAMES[-1])


def served_hand(folder: Path, stack: ExitStack, seed: int = SEED) -> Hand:
    """A hand with baselines, read by a daemon and shown by the page at its `address`, with captions and ghosts."""
    hand = Hand(folder)
    stack.callback(hand.close)
    (folder / "bus").mkdir()
    config = folder / "hand.toml"
    config.write_text(hand.config)
    hand.world = HandWorld(load(config)[0], seed)
    hand.still()
    hand.daemon = stack.enter_context(RunningDaemon(folder / "bus", hand.config))
    for name in NAMES:
        hand.daemon.wait_for(lambda contact, name=name: contact.pad == name and contact.sensors_ok == 0b1111)
    set_up(hand.daemon, hand, folder / "unturned")
    hand.captions = zmq.Context.instance().socket(zmq.PUB)
    stack.callback(hand.captions.close, 0)
    hand.captions.bind(f"ipc://{folder}/caption")
    options = ("--fixed-baseline", "--ghost-endpoint", f"ipc://{folder}/ghost", "--beside", f"ipc://{folder}/caption")
    line = stack.enter_context(page_beside(folder, hand.daemon.base, *options))()
    print(line, flush=True)
    hand.address = line.removeprefix("the page: ")
    return hand


@contextmanager
def never_turned(folder: Path, hand: Hand) -> Iterator[str]:
    """Run the pipelines of a daemon whose hand was never turned; yields when they publish."""
    bind = f"ipc://{folder}/never-turned"
    program = Path(__file__).with_name("hand_unturned.py")
    command = [sys.executable, program, folder / "hand.toml", folder / "unturned", hand.daemon.base, bind]
    process = subprocess.Popen(command)
    try:
        yield bind
    finally:
        process.terminate()
        process.wait()


def run(seconds: float | None, folder: Path, stack: ExitStack, seed: int = SEED) -> Score:
    hand = served_hand(folder, stack, seed)
    others: zmq.Socket[bytes] = zmq.Context.instance().socket(zmq.SUB)
    stack.callback(others.close, 0)
    others.subscribe(b"")
    others.connect(f"ipc://{folder}/ghost")
    others.connect(stack.enter_context(never_turned(folder, hand)))
    return play(seconds, hand, stack.enter_context(hand.daemon.subscribe()), others)


def play(seconds: float | None, hand: Hand, contacts: Any, others: Any) -> Score:
    score, clock, said, said_s = Score(NAMES, MOVES_A_SECOND), HandClock(), "", 0.0
    try:
        while seconds is None or clock.time_s < seconds:
            now, began_s = clock.go_on(), time.monotonic()
            score.moved(began_s, hand.move(now))
            text = act_at(now).text
            if text != said:
                print(text, flush=True)
                said = text
            while (message := contacts.receive(0.0)) is not None:
                score.take(TURNED, message.pad, message.body)
            while others.poll(0):
                topic, body = others.recv_multipart()
                kind, _, pad = topic.decode().partition("/")
                score.take(GHOST if kind == "ghost" else UNTURNED, pad, msgpack.unpackb(body))
            if now - said_s > SAID_EVERY_S and (beside := score.beside()) != hand.beside:
                hand.beside, said_s = beside, now
                print(f"  {beside}", flush=True)
            time.sleep(max(0.0, began_s + 1.0 / MOVES_A_SECOND - time.monotonic()))
    except KeyboardInterrupt:
        if seconds is not None:
            raise
    return score


def played(seconds: float | None, seed: int) -> Score:
    with tempfile.TemporaryDirectory(prefix="fmfts-hand-") as name, ExitStack() as stack:
        return run(seconds, Path(name), stack, seed)


def played_often(runs: int) -> int:
    """Play whole cycles of `runs` worlds in sequence; 0 if the turned daemon is better in all of them together."""
    total, failed, worse = {way: Verdict() for way in TITLES}, 0, 0
    for seed in range(1, runs + 1):
        print(f"--- world {seed} of {runs}", flush=True)
        try:
            score = played(CYCLE_S, seed)
        except Exception:  # noqa: BLE001 - the other worlds must still run
            failed += 1
            traceback.print_exc()
            continue
        worse += not is_better(score.ways)
        print(*table(score.ways), *score.doubtful[:20], sep="\n", flush=True)
        for way, verdict in score.ways.items():
            total[way].add(verdict)
    print(f"--- all {runs} worlds: {failed} did not start, in {worse} the turned daemon was not better")
    print(*table(total), sep="\n", flush=True)
    return 0 if is_better(total) and not failed and not worse else 1


def main() -> int:
    end_on_signals()
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float)
    parser.add_argument("--runs", type=int, help="whole cycles, each of another world")
    parser.add_argument("--seed", type=int, default=SEED, help="of the world")
    options = parser.parse_args()
    if options.runs is not None:
        return played_often(options.runs)
    print(*table(played(options.seconds, options.seed).ways), sep="\n", flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
