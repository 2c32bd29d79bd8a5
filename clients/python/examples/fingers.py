#!/usr/bin/env python3
"""Says which fingers touch a pad with several magnets, each time that another one comes or goes."""

import os
import sys

from fmfts_client import ALIVE_S, Client


def who_touches(client: Client) -> str:
    contact = client.latest(timeout_s=ALIVE_S)
    if contact is None:
        return "nothing arrives"
    if not contact.tells_fingers:
        return "a pad with one magnet takes two fingers for one"
    if not client.valid or contact.contacts is None:
        return f"cannot tell: {contact.reason or contact.health}"
    if contact.more:
        return "more than two fingers"
    return " and ".join(f"finger {finger.id}" for finger in contact.contacts) or "no finger"


def main(pad: str) -> None:
    with Client(pad) as client:
        said = ""
        while True:
            touching = who_touches(client)
            if touching != said:
                said = touching
                # client.contact.contacts has the place, force and shear of each.
                print(said, flush=True)


if __name__ == "__main__":
    try:
        main(sys.argv[1] if len(sys.argv) > 1 else "demo")
    except KeyboardInterrupt:
        sys.exit(130)
    except BrokenPipeError:  # nobody reads it any more; Python would write once more at the end
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit("fingers: its output was closed, so it ends")
