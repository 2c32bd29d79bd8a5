"""Decides which samples of a line can be trusted: those of a single board, with consistent times."""

from __future__ import annotations

from fmfts.sensor.wire.clock import DeviceClock, HostClock
from fmfts.sensor.wire.packets import Verb
from fmfts.sensor.wire.requests import Requests
from fmfts.sensor.wire.time_gate import TimeGate

# A board that did not answer for this long has left the line. While there are two, each is asked every second.
LEFT_NS = 3_000_000_000
ASK_NS = 1_000_000_000
NOT_YET = "a clock does not begin with a packet that may have waited here"


class LineGuard:
    """requests: those to the board. crowd: the fault while several boards send on the line; None: there is one."""

    def __init__(self, requests: Requests) -> None:
        self.crowd: str | None = None
        self._requests = requests
        self._times = TimeGate()
        self._heard_ns: dict[bytes, int] = {}  # when each uid said hello
        self._asked_ns = 0

    def hello(self, uid: bytes, clock: DeviceClock | HostClock, now_ns: int) -> None:
        if isinstance(clock, DeviceClock) and now_ns - self._asked_ns > ASK_NS:
            self._times.hello(clock)
        self._heard_ns[uid] = now_ns

    def review(self, now_ns: int) -> str | None:
        """`crowd`, found anew."""
        self._heard_ns = {uid: heard_ns for uid, heard_ns in self._heard_ns.items() if now_ns - heard_ns < LEFT_NS}
        self.crowd = None
        if len(self._heard_ns) > 1:
            boards = " and ".join(uid.hex() for uid in sorted(self._heard_ns))
            self.crowd = f"boards {boards} send on one line, and samples do not say whose they are: part them"
        return self.crowd

    def passed(self, counted: object, number: int) -> None:
        """Another reader read samples: see TimeGate."""
        self._times.passed(counted, number)

    def why_not(
        self, clock: DeviceClock | HostClock, time_us: int, arrival_ns: int, counted: object, number: int
    ) -> str | None:
        """Why a sample with this time and number cannot be trusted; None: it can. counted: see TimeGate."""
        if self.crowd is not None:
            return "several boards send on this line"
        if isinstance(clock, DeviceClock) and not self._times.admits(clock, time_us, arrival_ns, counted, number):
            if self._times.waits:
                return NOT_YET
            if arrival_ns - self._asked_ns > ASK_NS:
                self._asked_ns = arrival_ns
                self._requests.ask(Verb.HELLO)  # the packet may be another board's
            return f"no board's clock can show {time_us * 1e-6:.3f} s here: it came twice, or late"
        return None
