"""The circumstances of a wrong contact, to explain it: other contacts of its pad, the finger, and the faults."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from drills.pressed_board import NEVER_NS, PressedBoard
from drills.pressed_pad import Wrong
from fmfts_client import Contact

KEPT, APART_NS = 8, 1_000_000_000  # accounts, in all and of one pad: wrong contacts in a row have one cause
BEFORE, AFTER = 12, 6
FAULTS = 6


@dataclass
class Injected:
    pad: str
    kind: str
    begun_ns: int
    mended_ns: int = NEVER_NS


class Witness:
    """Tell it of every fault when it begins, and of all judged contacts in the order of publishing."""

    def __init__(self) -> None:
        self.faults: deque[Injected] = deque(maxlen=FAULTS)
        self.accounts: list[dict[str, object]] = []
        self._heard: dict[str, deque[Contact]] = {}
        self._last_wrong_ns: dict[str, int] = {}

    def saw(self, board: PressedBoard, contacts: Sequence[Contact], wrong: Sequence[Wrong]) -> None:
        for one in wrong:
            pad, time_ns = one.contact.pad, one.contact.t_sample_ns
            apart_ns = time_ns - self._last_wrong_ns.get(pad, -APART_NS)
            self._last_wrong_ns[pad] = time_ns
            if len(self.accounts) < KEPT and apart_ns >= APART_NS:
                self.accounts.append(self._account(board, contacts, one))
        for contact in contacts[-BEFORE:]:
            self._heard.setdefault(contact.pad, deque(maxlen=BEFORE)).append(contact)

    def _account(self, board: PressedBoard, contacts: Sequence[Contact], wrong: Wrong) -> dict[str, object]:
        """Times in ms from the wrong contact's sample."""
        since_ns = wrong.contact.t_sample_ns
        around = [*self._heard.get(wrong.contact.pad, ()), *contacts]
        index = around.index(wrong.contact)
        return {
            "wrong": f"{wrong.contact.pad} {wrong.contact.seq}: {wrong}",
            "finger": board.moves_around(since_ns),
            "faults": [
                f"{fault.pad} {fault.kind} from {_ms(fault.begun_ns - since_ns)}"
                + (f" to {_ms(fault.mended_ns - since_ns)}" if fault.mended_ns < NEVER_NS else " on")
                for fault in self.faults
            ],
            "contacts": [_line(each, since_ns) for each in around[max(index - BEFORE, 0) : index + AFTER + 1]],
        }


def _line(contact: Contact, since_ns: int) -> str:
    late_ns = contact.t_publish_ns - contact.t_sample_ns
    words = [f"{_ms(contact.t_sample_ns - since_ns)}, published {_ms(late_ns)} later: {contact.health}"]
    if contact.sensors_ok != 0b1111:
        words.append(f"sensors {contact.sensors_ok:04b}")
    words.append({True: "touched", False: "not touched", None: "touched or not"}[contact.contact])
    if contact.force_n is not None and contact.force_sd_n is not None:
        words.append(f"{contact.force_n:.3f} ± {contact.force_sd_n:.3f} N")
    if contact.pose is not None:
        words.append(f"χ² {contact.pose.chi2:.1f}, z {contact.pose.position_m[2] * 1e6:.0f} µm")
    return ", ".join(words)


def _ms(time_ns: int) -> str:
    return f"{time_ns * 1e-6:+.1f} ms"
