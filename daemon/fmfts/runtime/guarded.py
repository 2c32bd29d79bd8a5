"""Guards the daemon against its sources: a source that raises anything is closed, and opened anew after a pause."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Collection, Sequence
from functools import partial

from fmfts.common.reading import shortened
from fmfts.runtime import checked
from fmfts.runtime.budget import Budget
from fmfts.runtime.failure import Contained, sentence_of, text_of, trace_of
from fmfts.runtime.renewal import Renewal, close
from fmfts.sensor import ByteSource, Frame, Source, SourceError, SourceState
from fmfts.sensor.early import EarlySample
from fmfts.sensor.patience import Patience
from fmfts.sensor.source import CannotError

log = logging.getLogger(__name__)

FIRST_PAUSE_S, LONGEST_PAUSE_S = 0.1, 5.0
LOOK_NS = 20_000_000  # interval of checks whether a source is open again
# After a poll that computes for longer, the source rests for REST times as long, so that others have nine tenths of the
# time. A driver needs far less, and a board's queue holds more.
GREEDY_NS, REST = 10_000_000, 9
SHORTEST_WAIT_NS = 500_000  # a source whose deadline is always now must not take the whole processor
# No poll may wait. A busy computer may cause one slow poll, hardly three in a row.
SLOW_S, MOST_SLOW_POLLS = 0.1, 3
LOG_AGAIN_NS = 3_600_000_000_000  # after this time, the log shows the traceback of the same kind of error again


class GuardedSource:
    """A ByteSource that raises nothing. `device` is the source behind it, None while that is closed after an error.
    changed: the last `poll` closed the device or got a new one, whose clock and numbers restart.


    """

    def __init__(
        self,
        open_device: Callable[[], Source],
        pads: Collection[int],
        description: str,
        rate_hz: float | None = None,
    ) -> None:
        """open_device: makes the source, later in another thread. pads: their indices on it. rate_hz: see Budget."""
        self.state = SourceState(description)
        self.device: Source | None = None
        self.changed = False
        self._open_device = open_device
        self._pads = frozenset(pads)
        self._budget = Budget(rate_hz, len(self._pads))
        self._bytes: ByteSource | None = None  # the device, if it is a ByteSource
        self._patience: Patience | None = None
        self._failure = ""  # why the next poll closes the device
        self._contexts: dict[tuple[str, tuple[type[BaseException], ...]], Contained] = {}
        self._renewal: Renewal | None = None
        self._pause_s = FIRST_PAUSE_S
        self._opened_ns = self._look_ns = self._polled_ns = 0
        self._rest_ns = SHORTEST_WAIT_NS
        self._slow_polls = 0
        self._logged_ns: dict[str, int] = {}  # kind of an error → when its traceback was logged

    def open(self) -> None:
        """Open the device for the first time. Raises the SourceError of its constructor, if there is one."""
        with self.contained("its constructor", SourceError):
            self._adopt(self._open_device())

    def fail(self, where: str, error: BaseException) -> None:
        """Close the device at the next poll. where: which of its methods raised the error."""
        if self._failure:
            return
        now_ns, kind = time.monotonic_ns(), f"{where}: {type(error).__name__}"
        if isinstance(error, SourceError):
            self._failure = shortened(text_of(error))
        else:
            self._failure = (
                f"internal error in {where}: {sentence_of(error)}. It is started again, after at most "
                f"{LONGEST_PAUSE_S:g} s; the daemon's log shows where it failed, and is worth reporting"
            )
            if now_ns - self._logged_ns.get(kind, -LOG_AGAIN_NS) >= LOG_AGAIN_NS:
                self._logged_ns[kind] = now_ns
                log.error("%s: %s\n%s", self.state.description, self._failure, trace_of(error))
        self.state.disconnect(self._failure, now_ns)

    def fileno(self) -> int | None:
        if self.device is not None and not self._failure:
            with self.contained("fileno"):
                return checked.whole(self.device.fileno())
        return None

    def deadline_ns(self) -> int | None:
        if self.device is not None and not self._failure:
            with self.contained("deadline_ns"):
                due_ns = checked.whole(self.device.deadline_ns())
                return None if due_ns is None else max(due_ns, self._polled_ns + self._rest_ns)
        return 0 if self._failure else self._look_ns

    def poll(self, now_ns: int) -> Sequence[Frame]:
        self.changed = False
        if self._renewal is not None:
            self._look(self._renewal, now_ns)
        elif self.device is not None and not self._failure:
            with self.contained("poll"):
                begun_ns, computed_ns = time.monotonic_ns(), time.thread_time_ns()
                frames = checked.frames_of(self._pads, self.device.poll(now_ns))
                self._polled_ns = time.monotonic_ns()
                self._judge_pace((self._polled_ns - begun_ns) * 1e-9)
                newest = self._budget.newest(frames, now_ns, self._patience, self.state)
                computed_ns = time.thread_time_ns() - computed_ns
                self._rest_ns = REST * computed_ns if computed_ns > GREEDY_NS else SHORTEST_WAIT_NS
                return newest
        if self._failure:
            self._give_up()
        return ()

    def request_selftest(self, pad_index: int) -> None:
        if self.device is not None:
            with self.contained("request_selftest", SourceError):
                return self.device.request_selftest(pad_index)
        raise CannotError(f"{self.state.description}: {self.state.reason}")

    def selftest_result(self, pad_index: int) -> dict[str, object] | None:
        if self.device is not None:
            with self.contained("selftest_result", SourceError):
                return self.device.selftest_result(pad_index)
        raise CannotError(f"{self.state.description}: {self.state.reason}")

    def close(self) -> None:
        if self._renewal is not None:
            self._renewal.cancel()
        if self.device is not None:
            close(self.device)

    @property
    def patience(self) -> Patience | None:
        return self._patience

    @patience.setter
    def patience(self, patience: Patience | None) -> None:
        self._patience = patience
        if self._bytes is not None and not self._failure:
            with self.contained("patience"):
                self._bytes.patience = patience

    @property
    def clock_line(self) -> memoryview | None:
        if self._bytes is not None and not self._failure:
            with self.contained("clock_line"):
                return checked.clock_line(self._bytes.clock_line)
        return None

    def take_early(self) -> Sequence[tuple[int, EarlySample]]:
        if self._bytes is not None and not self._failure:
            with self.contained("take_early"):
                return checked.early(self._bytes.take_early())
        return ()

    def lendable(self) -> frozenset[int]:
        if self._bytes is not None and not self._failure:
            with self.contained("lendable"):
                return checked.lendable(self._pads, self._bytes.lendable())
        return frozenset()

    def lend(self) -> tuple[int, bytes]:
        """SourceError if the device fails to lend its descriptor."""
        if self._bytes is not None and not self._failure:
            with self.contained("lend"):
                return checked.lent(self._bytes.fileno(), self._bytes.lend())
        raise CannotError(f"{self.state.description}: {self.state.reason}")

    def give_back(self, unread: bytes, heard_ns: int, left_out: Sequence[int]) -> None:
        if self._bytes is not None:
            with self.contained("give_back"):
                self._bytes.give_back(unread, heard_ns, left_out)

    def passed(self, pad_index: int, sequence: int) -> None:
        if self._bytes is not None:
            with self.contained("passed"):
                self._bytes.passed(pad_index, sequence)

    def contained(self, where: str, *passes: type[BaseException]) -> Contained:
        """A context in which an error closes the device, unless `passes` names its type."""
        # Contexts are kept, because each frame enters several.
        key = where, passes
        if key not in self._contexts:
            self._contexts[key] = Contained(partial(self.fail, where), *passes)
        return self._contexts[key]

    def _adopt(self, device: Source) -> None:
        self.device = device  # first, so that it is closed whatever else fails
        self._bytes = device if isinstance(device, ByteSource) else None
        state = device.state
        if not isinstance(state, SourceState):
            raise TypeError(f"its state is a {type(state).__name__}, and not a SourceState")
        self.state = state.follow(self.state)
        self._opened_ns, self._slow_polls = time.monotonic_ns(), 0

    def _judge_pace(self, poll_s: float) -> None:
        """A poll cannot be interrupted. A source that repeatedly makes all others wait is closed for a while."""
        self._slow_polls = self._slow_polls + 1 if poll_s > SLOW_S else 0
        if self._slow_polls >= MOST_SLOW_POLLS:
            raise TimeoutError(f"{MOST_SLOW_POLLS} polls took {poll_s:.2f} s each, and all other pads wait meanwhile")

    def _give_up(self) -> None:
        """Close the device and open another one, after a pause that grows while devices fail soon."""
        if (time.monotonic_ns() - self._opened_ns) * 1e-9 > LONGEST_PAUSE_S:
            self._pause_s = FIRST_PAUSE_S
        self._renewal = Renewal(self.device, self._pause_s, self._open_device)
        self._pause_s = min(2.0 * self._pause_s, LONGEST_PAUSE_S)
        self.device, self._bytes, self.changed = None, None, True
        # The failed device's own facts are no longer valid.
        self.state = SourceState(self.state.description).follow(self.state)
        self._failure = ""

    def _look(self, renewal: Renewal, now_ns: int) -> None:
        """Take the new device, if it is there."""
        self._look_ns = now_ns + LOOK_NS
        if renewal.is_over:
            self._renewal = None
            with self.contained("its constructor"):
                self._adopt(renewal.result())
                self.changed = True


def device_of(source: Source) -> Source | None:
    """The source itself, or the one behind a guard; None while there is none."""
    return source.device if isinstance(source, GuardedSource) else source
