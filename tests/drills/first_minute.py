"""`make first-minute`: what a newcomer sees of `make demo` in its first minute (DEMO="PAD=array": for another pad).

It types `make demo` in this installed checkout, and reports when the first `ok` came, how large the deviations of
forces near 1 N are, and how many frames were lost.
"""

from __future__ import annotations

import os
import re
import statistics
import subprocess
import sys
import time
from pathlib import Path

from fmfts_client import Subscription

ROOT = Path(__file__).parents[2]
WATCHED_S, STARTING_S = 60.0, 60.0
NEAR_1_N = 0.9, 1.1


def main() -> int:
    begun = time.monotonic()
    demo = subprocess.Popen(
        ["make", "demo", f"SECONDS={WATCHED_S + STARTING_S:g}", *sys.argv[1:]],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ | {"BROWSER": "none"},
    )
    assert demo.stdout is not None
    try:
        base = None
        while base is None:
            line = demo.stdout.readline()
            if not line:
                return 1
            print(line, end="", flush=True)
            found = re.match(r"another terminal: FMFTS_BUS=(\S+)", line)
            base = found and found[1]
        watched(begun, base)
    finally:
        demo.terminate()
        demo.wait()
    return 0


def watched(begun: float, base: str) -> None:
    first_ok: float | None = None
    deviations_n: list[float] = []
    health: dict[str, int] = {}
    status: dict[str, object] = {}
    with Subscription(("contact", "status"), None, base) as messages:
        until = time.monotonic() + WATCHED_S
        while (left := until - time.monotonic()) > 0.0:
            message = messages.receive(left)
            if message is None:
                continue
            body = message.body
            if message.kind == "status":
                status = body
                continue
            health[body["health"]] = health.get(body["health"], 0) + 1
            if body["health"] == "ok" and first_ok is None:
                first_ok = time.monotonic() - begun
            if body["contact"] and not body["over_range"] and NEAR_1_N[0] < (body["force_n"] or 0.0) < NEAR_1_N[1]:
                deviations_n.append(body["force_sd_n"])
    print(f"first ok after {first_ok or float('nan'):.1f} s; in the {WATCHED_S:g} s from then on: {health}")
    if deviations_n:
        print(
            f"deviation of {len(deviations_n)} forces of {NEAR_1_N[0]:g} to {NEAR_1_N[1]:g} N: median "
            f"{statistics.median(deviations_n):.3f} N, largest {max(deviations_n):.3f} N"
        )
    print(f"frames lost since the start: {status.get('gaps')}, left out: {status.get('dropped')}")


if __name__ == "__main__":
    raise SystemExit(main())
