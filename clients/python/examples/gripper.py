#!/usr/bin/env python3
"""Closes a gripper until the pad feels LIMIT_N; opens it when the force is larger, too large to measure, or unknown."""

import sys

from fmfts_client import ALIVE_S, Client

LIMIT_N = 1.0
LARGEST_FORCE_SD_N = 0.3  # a force that is less certain does not close the gripper


def why_open(client: Client) -> str:
    contact = client.latest(timeout_s=ALIVE_S)
    if contact is None:
        return "nothing arrives"
    if contact.over_range:
        return f"at least {contact.force_min_n} N, beyond what the pad can measure"
    if contact.health != "ok":
        return f"{contact.health}: {contact.reason}"
    if not client.valid or contact.force_n is None:
        return f"no force that is certain to {LARGEST_FORCE_SD_N} N"
    return f"{contact.force_n:.2f} N" if contact.force_n > LIMIT_N else ""


with Client(sys.argv[1] if len(sys.argv) > 1 else "demo", largest_force_sd_n=LARGEST_FORCE_SD_N) as client:
    print(client.why(), file=sys.stderr)  # before the loop: it may take a second
    is_open = None
    while True:
        reason = why_open(client)
        if bool(reason) != is_open:
            is_open = bool(reason)
            # Your gripper's command goes here.
            print(f"OPEN ({reason})" if is_open else "CLOSE", flush=True)
