"""Compares each published contact with the frame that its watermark names, and with its true age."""

from __future__ import annotations

import re
import threading
import time
from collections import Counter, deque
from typing import Any

import msgspec
import zmq

from drills.chaos.board import ChaosBoard, Taken
from drills.chaos.faults import LYING, OF_ONE_CHIP
from drills.chaos.pressed import MARKS, MIDDLE_C, SETTLED, STEP_C

WRONG_DEVIATIONS = 5.0
OLDEST_OK_NS = 100_000_000
# How far the time that a contact claims may be from the time at which its newest sample was taken.
TIME_ERROR_NS = 30_000_000
WITHOUT_FRAME = ("stale", "disconnected")
KEPT = 40
RECENT_NS = 1_000_000_000


class Judge:
    """Listens to a daemon's contacts in a thread of its own. Read the counters after `close`.

    wrong: (pad, what, seconds since the start, contact). stale: `ok` although its samples were older than 100 ms.
    false_times: `ok` with a `t_sample_ns` that is wrong by more than 30 ms. published: contacts of frames, by pad.
    unheard: contacts that this listener lost. ok_ns: when the frame of the last `ok` contact of each pad was taken.
    """

    def __init__(self, endpoint: str, boards: dict[str, ChaosBoard]) -> None:
        self._boards = boards
        self.wrong: deque[tuple[str, str, float, dict[str, Any]]] = deque(maxlen=KEPT)
        self.kinds: Counter[str] = Counter()
        self.untold_kinds: Counter[str] = Counter()  # see _is_beyond_telling
        self.by_faults: Counter[tuple[str, str]] = Counter()
        self.stale_by_faults: Counter[tuple[str, str]] = Counter()
        self.false_times_by_faults: Counter[tuple[str, str]] = Counter()
        self.health: Counter[str] = Counter()
        self.published: Counter[str] = Counter()
        self._steady: Counter[str] = Counter()  # frames of each pad since the finger stopped
        self.unheard: Counter[str] = Counter()
        self.judged = self.judged_pressed = self.stale = self.false_times = 0
        self.ages_ns: list[int] = []
        self.ok_ns: dict[str, int] = {}
        self.judged_until: dict[str, tuple[int, str]] = {}
        self.last: dict[str, dict[str, Any]] = {}
        self._begun_ns = time.monotonic_ns()
        self._decoder = msgspec.msgpack.Decoder()
        self._endpoint = endpoint
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._listen)
        self._thread.start()

    def close(self) -> None:
        self._ended.set()
        self._thread.join()

    def _listen(self) -> None:
        socket = zmq.Context.instance().socket(zmq.SUB)
        with socket:
            socket.setsockopt(zmq.RCVHWM, 100_000)
            socket.setsockopt(zmq.SUBSCRIBE, b"contact/")
            socket.connect(self._endpoint)
            while not self._ended.is_set():
                if socket.poll(100):
                    while socket.getsockopt(zmq.EVENTS) & zmq.POLLIN:
                        self._judge(self._decoder.decode(socket.recv_multipart()[1]))

    def _judge(self, contact: dict[str, Any]) -> None:
        pad, health = contact["pad"], contact["health"]
        board, before = self._boards[pad], self.last.get(pad)
        self.unheard[pad] += contact["seq"] - (0 if before is None else before["seq"]) - 1
        self.last[pad] = contact
        self.published[pad] += health not in WITHOUT_FRAME
        self.health[health] += 1
        frame = None if health in WITHOUT_FRAME else self._frame_of(board, contact)
        if frame is not None:
            self.judged_until[pad] = frame.taken_ns, health
        if health not in ("ok", "degraded"):
            if contact["force_n"] is not None or contact["contact"] is not None:
                self._note("a number although it is " + health, contact)
            return
        if frame is None:
            self._steady[pad] = 0
            return  # no temperature was accepted, so there is no watermark
        if health == "ok":
            age_ns = contact["t_publish_ns"] - frame.sampled_ns
            self.ages_ns.append(age_ns)
            if age_ns > OLDEST_OK_NS:
                self.stale += 1
                claimed_ns = contact["t_publish_ns"] - contact["t_sample_ns"]
                self.stale_by_faults[f"claims {claimed_ns // 10_000_000}0 ms", self._recent_faults(contact)] += 1
            self.ok_ns[pad] = frame.taken_ns
            off_ns = contact["t_sample_ns"] - frame.sampled_ns
            if abs(off_ns) > TIME_ERROR_NS:
                self.false_times += 1
                self.false_times_by_faults[_in_tens_of_ms(off_ns), self._recent_faults(contact)] += 1
        # Under load frames are dropped, and a release is detected only after a number of frames.
        self._steady[pad] = self._steady[pad] + 1 if frame.touch.standing >= SETTLED else 0
        if self._steady[pad] > SETTLED:
            self._compare(frame, contact)

    def _frame_of(self, board: ChaosBoard, contact: dict[str, Any]) -> Taken | None:
        told_c = contact["temperature_c"]
        if told_c is None:
            return None
        frames = list(board.by_mark[(round((told_c - MIDDLE_C) / STEP_C) + MARKS // 2) % MARKS])
        # If several rounds match, the one nearest to the claimed time: a round takes 9 s.
        return min(frames, key=lambda frame: abs(frame.taken_ns - contact["t_sample_ns"]), default=None)

    def _compare(self, frame: Taken, contact: dict[str, Any]) -> None:
        touch = frame.touch
        self.judged += 1
        self.judged_pressed += touch.force_n > 0.0
        if contact["contact"] is not None and contact["contact"] != (touch.force_n > 0.0):
            self._note(f"contact {contact['contact']} at {touch.force_n:.2f} N", contact)
        elif contact["over_range"]:
            self._note(f"over range at {touch.force_n:.2f} N", contact)
        else:
            told = {"force_n": (touch.force_n, "force_sd_n")}
            if touch.force_n > 0.0:
                told |= {"x_m": (touch.x_m, "x_sd_m"), "y_m": (touch.y_m, "y_sd_m")}
            for name, (truth, deviation) in told.items():
                value = contact[name]
                if value is not None and abs(value - truth) > WRONG_DEVIATIONS * contact[deviation]:
                    self._note(f"{name} {value:.4f} ± {contact[deviation]:.4f}, not {truth:.4f}", contact)

    def _recent_faults(self, contact: dict[str, Any]) -> str:
        """Faults of its pad that are active, or were within the last second."""
        faults, now_ns = self._boards[contact["pad"]].faults, contact["t_publish_ns"]
        on = sorted(name for name, ends_ns in faults.items() if ends_ns > now_ns)
        over = sorted(name for name, ends_ns in faults.items() if now_ns - RECENT_NS < ends_ns <= now_ns)
        return f"on: {', '.join(on) or 'none'}; over: {', '.join(over) or 'none'}"

    def _is_beyond_telling(self, contact: dict[str, Any]) -> bool:
        """A chip of its pad gives false values while another is excluded: nine values, three of them false, for eight
        unknowns."""
        faults, recent_ns = self._boards[contact["pad"]].faults, contact["t_publish_ns"] - RECENT_NS
        recent = {name for name, ends_ns in faults.items() if ends_ns > recent_ns}
        return not recent.isdisjoint(LYING) and len({OF_ONE_CHIP[name] for name in recent & OF_ONE_CHIP.keys()}) > 1

    def _note(self, what: str, contact: dict[str, Any]) -> None:
        if contact["health"] == "degraded":
            what = "degraded: " + what
        is_beyond_telling = self._is_beyond_telling(contact)
        kinds = self.untold_kinds if is_beyond_telling else self.kinds
        kinds[re.sub(r"[-+]?[0-9.]+", "#", what)] += 1
        since_s = (contact["t_publish_ns"] - self._begun_ns) * 1e-9
        self.by_faults[re.sub(r"[-+]?[0-9.]+", "#", what), self._recent_faults(contact)] += 1
        if not is_beyond_telling:
            self.wrong.append((contact["pad"], what, since_s, contact))


def _in_tens_of_ms(off_ns: int) -> str:
    return f"{round(off_ns / 10_000_000) * 10:+d} ms"
