"""`fmfts-daemon probe --magnet`: a person moves a magnet over the board, and it says what is wrong with the chips."""

from __future__ import annotations

import argparse
import json
import os
import re
import select
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

import msgspec

from fmfts.cli.verb import VerbError, configuration_and_path, ended_by, not_written, pad_named
from fmfts.common import exit_codes

if TYPE_CHECKING:
    from fmfts.cli.feed import Feed
    from fmfts.config import PadConfig
    from fmfts_magnet import Readings, Verdict
    from fmfts_magnet.holding import Held

PROMPTS = (
    "Step 0 of 3. Lay the board still, chips up. Take every magnet half a metre away (a mounted pad stays on, and "
    "nothing touches it). Then press Enter.",
    "Step 1 of 3. Hold a magnet above the middle of the board, 2 to 5 cm high, one pole down (either one). Keep your "
    "hand still.",
    "Step 2 of 3. Same height, same pole down: move the magnet 2 cm toward +x of the pad, and keep still.",
    "Step 3 of 3. Go back over the middle, then 2 cm toward +y of the pad, and keep still.",
)
NO_FRAME_S = 10.0
PATIENCE_S = 300.0
TURN_S = 0.02
SHOW_S = 0.2
POLES = {"up": 1, "down": -1, None: 0}


def run(options: argparse.Namespace) -> int:
    from fmfts.cli.feed import FeedError, open_feed
    from fmfts_magnet import TooLittleError
    from fmfts_magnet.holding import readings_of

    config, path = configuration_and_path(options)
    pad = pad_named(config, options.pad)
    _require_hand(pad)
    with ended_by(FeedError):
        feed = open_feed(config, pad)
        try:
            before, *steps = _steps(feed)
        finally:
            feed.close()
    try:
        verdict = judged_pad(pad, readings_of(before, steps), POLES[options.pole])
    except TooLittleError as error:
        raise VerbError(exit_codes.DATA, f"pad '{pad.name}': {error}") from error
    _tell(verdict, pad, options)
    offer(verdict, pad, path, options)
    return exit_codes.DONE if verdict.is_as_drawn else exit_codes.FAULTY


def judged_pad(pad: PadConfig, readings: Readings, pole: int) -> Verdict:
    """pole: +1 if the north pole points up, −1 if down, 0 if unknown. Raises TooLittleError."""
    from fmfts.config import GeometryConfig
    from fmfts.config.layouts import BoardName
    from fmfts_magnet import Board, instructed_hand, judged, judged_by_name

    hand, tolerance, name = instructed_hand(pole), pad.tolerance.si(), pad.geometry.board
    if name is None:
        return judged(Board.of(pad.pad(), tolerance), readings, hand)
    boards = {}
    for each in get_args(BoardName):
        geometry = GeometryConfig(board=each, sensors_mirrored=pad.geometry.sensors_mirrored)
        boards[each] = Board.of(msgspec.structs.replace(pad, geometry=geometry).pad(), tolerance)
    return judged_by_name(name, boards, readings, hand)


def _require_hand(pad: PadConfig) -> None:
    from fmfts.config import ReplaySource, SimulatedSource

    if isinstance(pad.source, SimulatedSource | ReplaySource):
        kind = pad.source.__struct_config__.tag
        raise VerbError(
            exit_codes.CONFIG,
            f"pad '{pad.name}' is of type \"{kind}\", and nobody can hold a magnet above it: name a pad of a board or "
            "of an I2C bus with --pad",
        )


class _Terminal:
    """Shows one changing line on a terminal, else each new kind of hint once. Detects Enter."""

    def __init__(self) -> None:
        self._is_terminal = sys.stderr.isatty()
        self._said = ""
        self._next_s = 0.0
        self.is_open = True

    def enter(self) -> bool:
        """Whether Enter was pressed since the last call; at the end of the input always."""
        if not self.is_open:
            return True
        ready, _, _ = select.select([sys.stdin], [], [], 0.0)
        if not ready:
            return False
        typed = os.read(sys.stdin.fileno(), 4096)
        self.is_open = bool(typed)
        return not typed or b"\n" in typed

    def hint(self, text: str) -> None:
        kind = re.sub(r"[\d.]+", "", text)
        if self._is_terminal:
            if time.monotonic() > self._next_s or kind != self._said:
                print(f"\r\033[K  {text}", end="", file=sys.stderr, flush=True)
                self._next_s = time.monotonic() + SHOW_S
        elif kind != self._said:
            print(f"  {text}", file=sys.stderr, flush=True)
        self._said = kind

    def line(self, text: str) -> None:
        print(f"\r\033[K{text}" if self._is_terminal else text, file=sys.stderr, flush=True)
        self._said = ""


def _steps(feed: Feed) -> list[Held]:
    from fmfts_magnet.holding import Hold

    terminal, steps = _Terminal(), list[Any]()
    for number, prompt in enumerate(PROMPTS):
        terminal.line(prompt)
        hold = Hold(steps[0] if steps else None, steps[-1] if number > 1 else None)
        steps.append(_held(feed, hold, terminal, waits_for_enter=number == 0))
        terminal.line("  taken" if number == 0 else f"  taken: {_strongest_ut(steps[0], steps[-1]):.0f} µT")
    return steps


def _held(feed: Feed, hold: Any, terminal: _Terminal, waits_for_enter: bool) -> Held:
    begun_s = heard_s = time.monotonic()
    asked = False
    while True:
        time.sleep(TURN_S)
        now_s = time.monotonic()
        asked = (terminal.enter() and (terminal.is_open or waits_for_enter)) or asked
        for frame in feed.poll(time.monotonic_ns()):
            heard_s = now_s
            hold.take(frame, asked and not waits_for_enter)
        if hold.held is not None and (asked or not waits_for_enter):
            held: Held = hold.held
            return held
        if hold.is_judged and not waits_for_enter:
            asked = False
        terminal.hint("steady: press Enter" if hold.held is not None else hold.hint)
        if now_s - heard_s > NO_FRAME_S:
            raise VerbError(
                exit_codes.UNAVAILABLE,
                f"{feed.description}: no frame came for {NO_FRAME_S:g} s: `fmfts-daemon probe` says why",
            )
        if now_s - begun_s > PATIENCE_S:
            raise VerbError(exit_codes.UNAVAILABLE, f"nothing was held still for {PATIENCE_S:g} s: {hold.hint}")


def _strongest_ut(before: Held, held: Held) -> float:
    import numpy as np

    return 1e6 * float(np.nanmax(np.abs(held.mean_t - before.mean_t)))


def _tell(verdict: Verdict, pad: PadConfig, options: argparse.Namespace) -> None:
    from fmfts_magnet import sentences
    from fmfts_magnet.picture import picture
    from fmfts_magnet.words import magnet

    said = sentences(verdict)
    if options.json:
        facts = {"pad": pad.name, "as_drawn": verdict.is_as_drawn, "decided": verdict.is_decided, "said": said}
        print(json.dumps(facts, indent=1, ensure_ascii=False))
        return
    print(picture(verdict))
    print("\n" + "\n".join(said))
    if verdict.found:
        print(magnet(verdict.found[0]))


def offer(verdict: Verdict, pad: PadConfig, path: Path, options: argparse.Namespace) -> None:
    """Writes the geometry into the file with --write; else says what to write, or why it cannot."""
    from fmfts_magnet.geometry import NotWritableError, keys_of
    from fmfts_magnet.rewriting import RewritingError, rewrite, with_geometry

    if verdict.is_as_drawn:
        return
    try:
        keys = keys_of(verdict)
        text = with_geometry(path.read_text(encoding="utf-8-sig"), pad.name, keys)
    except (NotWritableError, RewritingError) as error:
        print(f"{path} is left as it is: {error}", file=sys.stderr)
        return
    except OSError as error:
        raise not_written(error, path) from error
    if not options.write:
        again = _again(options, "--write")
        mend = "correct the configuration" if verdict.layouts else "mend the wires, or let the configuration say it"
        print(f"next: {mend}: `{again}` writes", file=sys.stderr)
        print("\n".join(f"    {key} = {value}" for key, value in keys.items()), file=sys.stderr)
        return
    try:
        kept = rewrite(path, text)
    except RewritingError as error:
        print(f"{path} is left as it is: {error}", file=sys.stderr)
        return
    except OSError as error:
        raise not_written(error, path) from error
    print(f"{path}: [pad.geometry] of pad '{pad.name}' is written anew; the old file is {kept}", file=sys.stderr)
    print(
        f"next: restart the daemon if one runs, then `{_again(options)}` again, and record the baselines anew",
        file=sys.stderr,
    )


def _again(options: argparse.Namespace, *words: str) -> str:
    named: Sequence[str] = [f"--config {options.config}"] if options.config else []
    named = [*named, f"--pad {options.pad}"] if options.pad else named
    return " ".join(["fmfts-daemon probe --magnet", *words, *named])
