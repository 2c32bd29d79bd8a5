"""Replays all frozen worlds and judges them (`make golden`), or freezes the present messages (`make golden-freeze`).

--way recorded: with a snapshot of the state after every 500th frame.
"""

from __future__ import annotations

import argparse
import sys
import time

from golden.replayed import AS_ALWAYS, Way, replay
from golden.said import Verdict, compare, decoded, encoded
from golden.world import FOLDER, load, names

WAYS = {"always": AS_ALWAYS, "recorded": Way(snapshots=500)}


def frozen_file(name: str):  # type: ignore[no-untyped-def]
    return FOLDER / f"{name}.said.xz"


def judged(name: str, messages: int | None = None, way: Way = AS_ALWAYS) -> dict[str, Verdict]:
    """The verdict on each pad of a world."""
    world, digest = load(name)
    if messages is None and world.digest != digest:
        return {pad.settings.name: Verdict(["this machine reads other frames than were frozen"]) for pad in world.pads}
    frozen = decoded(frozen_file(name).read_bytes())
    return {pad: compare(said, frozen[pad]) for pad, said in replay(world, messages, way).items()}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("worlds", nargs="*", help="only these")
    parser.add_argument("--freeze", action="store_true", help="keep what is said now; the commit must explain why")
    parser.add_argument("--way", choices=WAYS, default="always")
    parser.add_argument("--messages", type=int, help="of each pad only so many")
    options = parser.parse_args()
    wrong, frames = 0, 0
    for name in options.worlds or names():
        begun = time.monotonic()
        if options.freeze:
            world, digest = load(name)
            if world.digest != digest:
                raise SystemExit(f"{name}: this machine reads other frames than were frozen")
            content = encoded(replay(world))
            frozen_file(name).write_bytes(content)
            print(
                f"{name:24} {world.frames:6d} frames {len(content):7d} bytes {time.monotonic() - begun:5.1f} s",
                flush=True,
            )
            frames += world.frames
            continue
        for pad, verdict in judged(name, options.messages, WAYS[options.way]).items():
            state = "identical" if verdict.identical else "within the tolerance"
            if verdict.differences:
                wrong += 1
                state = f"{len(verdict.differences)} DIFFERENCES"
            print(f"{name:20} {pad:7} {verdict.compared:7d} numbers, {verdict.shifted:3d} shifted, "
                  f"{time.monotonic() - begun:5.1f} s: {state}", flush=True)  # fmt: skip
            for line in verdict.differences[:5]:
                print(f"    {line}")
    if options.freeze:
        print(f"{frames} frames frozen")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
