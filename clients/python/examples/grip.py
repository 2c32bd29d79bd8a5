#!/usr/bin/env python3
"""Holds an object between two pads with little more than the least force with which it does not slip.

    grip.py left right             closes until both touch, and holds
    grip.py left right --loosen    then also looks for the least force

It loosens the object, once, until it slips a millimetre or two; the force at which that began is the least one. It then
holds with RESERVE more, and with as much more as the shear grows: a glass that is filled. Each further slip teaches
anew. While no pad knows its force the gripper never opens; while both do not, it holds still. docs/slip.md says what it
needs.
"""

import math
import os
import sys
import time
from collections.abc import Callable, Sequence
from typing import NamedTuple, Optional

from fmfts_client import Client, Contact

FIRST_N = 0.6  # of a new grip, and the least of any: the pads report no slip below it
LARGEST_N = 2.0  # the pads measure no more, and the object may not bear more
RESERVE = 0.15  # more than the force at which it slipped
FIRST_RESERVE = 0.5  # while the least force is not known
STILL_SLIPS_PER_S = 0.6  # if it still slips: this share more force
LOOSENS_PER_S = 0.15  # as a share
APPROACH_M_PER_S, FASTEST_M_PER_S = 0.015, 0.04
STIFFNESS_N_PER_M = 200.0  # of a finger of your gripper
CLOSE_M_PER_S_PER_N = 30.0 / STIFFNESS_N_PER_M  # how fast to close for a newton too little
SETTLED_S, SMOOTH_S = 0.3, 0.15
LEAST_SHEAR_N = 0.1  # of a pad, where its growth is told from
SAME_S = 0.05  # a slip that begins again within this time is the same one
MOVED_M = 2e-3  # a contact that moved this far slipped, too: slow slips are reported late or never
VAGUE = 0.4  # a force with a deviation of a larger share is not known: the contact is near the pad's rim
LEAST_SHARE = 0.5  # a pad that reads less of the force, or more than 2 - LEAST_SHARE of it, is wrong
LATE_S = 0.1  # an older sample does not describe the present
PERIOD_S = 0.01


class Command(NamedTuple):
    """For the gripper and the arm. close_m_per_s: speed of each finger; negative opens. why: a reason for people to
    read."""

    close_m_per_s: float
    may_lift: bool
    why: str = ""


def usable(contact: Optional[Contact], age_s: float) -> bool:
    """Is the pad's force known now? Slip and place may be unknown: a light touch."""
    if contact is None or age_s > LATE_S or contact.health != "ok" or contact.over_range:
        return False
    return contact.contact is not None and contact.force_n is not None


def is_vague(contact: Contact) -> bool:
    """Is its force hardly known?"""
    if not contact.contact or contact.force_n is None or contact.force_sd_n is None:
        return False
    return contact.force_sd_n > VAGUE * max(contact.force_n, FIRST_N)


class Grip:
    """found: the least force is known, and the arm may hurry."""

    def __init__(self) -> None:
        self.found = False
        self._touched = self._slips = self._hangs = False  # hangs: in the air
        self._slipped_n = FIRST_N / (1.0 + FIRST_RESERVE)  # the force at which it slipped last
        self._sticks_s = 1.0
        self._shear_n: dict[str, float] = {}  # by pad: the present shear, smoothed
        self._shear_then_n: dict[str, float] = {}  # and just after the last slip
        self._growth = 1.0  # of the shear since then
        self._force_n = self._closing = 0.0  # as of the last step; how fast it closed then
        self._share: dict[str, float] = {}  # by pad: its reading over the mean of both, while both were known
        self._place_m: dict[str, tuple[float, float]] = {}  # by pad: the place where it sticks

    def step(self, pads: Sequence[Optional[Contact]], loosen: bool, period_s: float = PERIOD_S) -> Command:
        """pads: the newest contact of each; None if it cannot be used. loosen: find the least force; the arm stands
        still and the object hangs in the air."""
        seen = [contact for contact in pads if contact is not None]
        self._hangs = self._hangs or loosen
        closing, self._closing = self._closing, 0.0
        if not seen:
            return Command(0.0, False, "no pad knows its force")
        if not self._touched and not all(contact.contact for contact in seen):
            return Command(APPROACH_M_PER_S if len(seen) == len(pads) else 0.0, False)
        self._touched = True
        known = [contact for contact in seen if not is_vague(contact)]
        self._force_n += STIFFNESS_N_PER_M * closing * period_s  # all that is known if both pads say nothing
        force_n = self._force_n = self._pressed_n(known, len(known) == len(pads), period_s)
        wanted_n = self._wanted_n(seen, force_n, loosen and len(known) == len(pads), period_s)
        speed = CLOSE_M_PER_S_PER_N * (wanted_n - force_n)
        self._closing = min(max(speed, -FASTEST_M_PER_S), FASTEST_M_PER_S)
        if len(known) < len(pads):  # the other pad alone may tighten, but only while it touches the object
            self._closing = max(self._closing, 0.0) if any(contact.contact for contact in seen) else 0.0
            return Command(self._closing, False, "a pad does not know its force")
        return Command(self._closing, not self._slips and force_n > 0.9 * wanted_n)

    def _pressed_n(self, known: Sequence[Contact], all_know: bool, period_s: float) -> float:
        """The mean of both: fingers press equally, and each pad errs by a factor of its own. If one falls silent,
        the other still tells the mean, by its share."""
        if not known:
            return self._force_n
        read_n = {contact.pad: contact.force_n or 0.0 for contact in known}
        if not all_know:
            return sum(each / self._share.get(pad, 1.0) for pad, each in read_n.items()) / len(read_n)
        mean_n = sum(read_n.values()) / len(read_n)
        for pad, each in read_n.items():
            now = min(max(each / mean_n, LEAST_SHARE), 2.0 - LEAST_SHARE) if mean_n > FIRST_N / 2.0 else 1.0
            before = self._share.get(pad, now)
            self._share[pad] = before + min(period_s / SMOOTH_S, 1.0) * (now - before)
        return mean_n

    def _wanted_n(self, seen: Sequence[Contact], force_n: float, loosen: bool, period_s: float) -> float:
        slips = [self._is_slipping(contact) for contact in seen]
        begins, self._slips = self._sticks_s > SAME_S, any(slips)
        if self._slips:
            if loosen and not self.found:
                self.found, begins = True, True
            self._slipped_n = force_n if begins else self._slipped_n * (1.0 + STILL_SLIPS_PER_S * period_s)
            self._sticks_s = 0.0
            self._place_m, self._shear_n, self._shear_then_n = {}, {}, {}
            self._growth = 1.0
        elif loosen and not self.found and None not in slips:
            self._slipped_n *= 1.0 - LOOSENS_PER_S * period_s
            if (1.0 + FIRST_RESERVE) * self._slipped_n < FIRST_N:  # the pads cannot measure a force this small
                self.found, self._slipped_n = True, FIRST_N / (1.0 + RESERVE)
        self._sticks_s += period_s
        grown = self._grown(seen, period_s) if self.found else 1.0
        reserve = RESERVE if self.found else FIRST_RESERVE
        largest_n = LARGEST_N
        if not self._hangs:  # the arm does not lift while a pad is beyond its range
            largest_n /= max([1.0, *self._share.values()])
            self._slipped_n = min(self._slipped_n, largest_n / (1.0 + reserve))
        return min(max((1.0 + reserve) * self._slipped_n * grown, FIRST_N), largest_n)

    def _is_slipping(self, contact: Contact) -> Optional[bool]:
        """None: nobody knows."""
        slip = contact.slip
        if slip is None or slip.slipping is None or contact.x_m is None or contact.y_m is None:
            return None
        x_m, y_m = self._place_m.setdefault(contact.pad, (contact.x_m, contact.y_m))
        has_moved = math.hypot(contact.x_m - x_m, contact.y_m - y_m) > MOVED_M
        return slip.slipping or has_moved

    def _grown(self, seen: Sequence[Contact], period_s: float) -> float:
        """By what factor the shear of both pads grew since the last slip: they carry the object together, and what one
        reads too much the other may read too little. Shear is what the margin leaves of the friction.

        A pad that joins later counts from there on. While one says nothing, the load has not become smaller."""
        joined, told = [], set(self._shear_then_n)
        for contact in seen:
            slip, pad = contact.slip, contact.pad
            if slip is None or slip.friction is None or slip.margin_n is None or contact.force_n is None:
                continue
            told.add(pad)
            shear_n = slip.friction * contact.force_n - slip.margin_n
            before_n = self._shear_n.get(pad, shear_n)
            self._shear_n[pad] = before_n + min(period_s / SMOOTH_S, 1.0) * (shear_n - before_n)
            if self._sticks_s >= SETTLED_S:
                joined.append(pad)
        self._shear_n = {pad: shear_n for pad, shear_n in self._shear_n.items() if pad in told}  # the rest is too old
        counted = [pad for pad in joined if pad in self._shear_then_n]
        least = 1.0 if len(counted) == len(self._shear_then_n) else self._growth
        if counted:
            now_n, then_n = (sum(of[pad] for pad in counted) for of in (self._shear_n, self._shear_then_n))
            self._growth = max(now_n / max(then_n, LEAST_SHEAR_N * len(counted)), least)
        for pad in joined:
            self._shear_then_n.setdefault(pad, self._shear_n[pad] / self._growth)
        return self._growth


def newest(client: Client) -> Optional[Contact]:
    client.latest()
    contact = client.contact
    return contact if contact is not None and client.alive and usable(contact, contact.sample_age_s) else None


def hold(names: Sequence[str], loosen: Callable[[], bool], act: Callable[[Command, bool], None]) -> None:
    """Until it is interrupted. loosen: as for `Grip.step`. act: your gripper's and arm's commands go there; also told
    whether the least force is known."""
    clients = [Client(name) for name in names]
    for client in clients:
        if why := client.why():  # before the loop, because it may take a second
            print(why, file=sys.stderr)
    grip, before_s = Grip(), time.monotonic()
    try:
        while True:
            now_s = time.monotonic()
            command = grip.step([newest(client) for client in clients], loosen(), min(now_s - before_s, LATE_S))
            act(command, grip.found)
            before_s = now_s
            time.sleep(PERIOD_S)
    finally:
        act(Command(0.0, False, "it ends"), grip.found)  # otherwise the gripper keeps the last speed


class Printed:
    """Says each command that differs from the one before."""

    def __init__(self) -> None:
        self._said = ""

    def __call__(self, command: Command, found: bool) -> None:
        what = "close" if command.close_m_per_s > 1e-3 else "open" if command.close_m_per_s < -1e-3 else "hold"
        saying = f"{what}{', lift' if command.may_lift else ''}{f' ({command.why})' if command.why else ''}"
        if saying != self._said:
            self._said = saying
            print(saying, flush=True)


if __name__ == "__main__":
    words = [word for word in sys.argv[1:] if word != "--loosen"]
    if len(words) not in (0, 2):
        sys.exit(f"grip: It needs two pads, and got {len(words)}. Name both: grip.py left right [--loosen]")
    try:
        hold(words or ["left", "right"], lambda: "--loosen" in sys.argv, Printed())
    except KeyboardInterrupt:
        sys.exit(130)
    except BrokenPipeError:  # nobody reads it any more; Python would write once more at the end
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit("grip: its output was closed, so it ends")
