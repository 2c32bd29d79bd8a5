#!/usr/bin/env python3
"""Closes a gripper until the pad feels LIMIT_N; opens it when the force is larger, too large to measure, or unknown.

It opens at once, and closes after CALM_S without a reason to open, so that a force near the limit does not make it
chatter.
"""

import os
import re
import sys
import time

from fmfts_client import ALIVE_S, Client

LIMIT_N = 1.0
CALM_S = 0.2
LARGEST_FORCE_SD_N = 0.5  # a force with a larger deviation does not close the gripper


def why_open(client: Client) -> str:
    contact = client.latest(timeout_s=ALIVE_S) or client.contact
    if contact is not None and contact.valid and contact.force_n is not None and contact.force_n > LIMIT_N:
        return f"pressed with {contact.force_n:.2f} N"
    return client.why_invalid


def main(pad: str) -> None:
    with Client(pad, largest_force_sd_n=LARGEST_FORCE_SD_N) as client:
        if why := client.why():  # before the loop, because it may take a second
            print(why, file=sys.stderr)
        printed, opened_s = "-", time.monotonic()
        while True:
            reason = why_open(client)
            if reason:
                opened_s = time.monotonic()
            elif time.monotonic() - opened_s < CALM_S:
                continue
            kind = re.sub(r"[\d.]", "", reason)  # the numbers in a reason change with each contact
            if kind != printed:
                printed = kind
                # Your gripper's command goes here.
                print(f"OPEN ({reason})" if reason else "CLOSE", flush=True)


if __name__ == "__main__":
    try:
        main(sys.argv[1] if len(sys.argv) > 1 else "demo")
    except KeyboardInterrupt:
        sys.exit(130)
    except BrokenPipeError:  # nobody reads it any more; Python would write once more at the end
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit("gripper: its output was closed, so it ends")
