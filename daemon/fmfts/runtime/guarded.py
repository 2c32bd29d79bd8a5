"""Guards the daemon against its sources: a source that raises anything is closed, and opened anew after a pause."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from functools import partial

from fmfts.runtime.failure import Contained, sentence_of, text_of, trace_of
from fmfts.runtime.renewal import Renewal, close
from fmfts.sensor import ByteSource, Frame, Source, SourceError, SourceState
from fmfts.sensor.early import EarlySample
from fmfts.sensor.patience import RECORDED, Patience
from fmfts.sensor.source import CannotError
from fmfts.sources import Device

log = logging.getLogger(__name__)

FIRST_PAUSE_S, LONGEST_PAUSE_S = 0.1, 5.0
LOOK_NS = 20_000_000  # so often the loop looks whether a source is open again
SHORTEST_WAIT_NS = 500_000  # a source whose deadline is always now must not take the whole processor
# Of one pad in one poll: more than a recording needs after a stall of this computer; and what is judged in 5 ms.
MOST_RECORDED, MOST_JUDGED = 256, 32
# No poll may wait. This computer may be to blame for one slow poll, hardly for three in a row.
SLOW_S, MOST_SLOW_POLLS = 0.1, 3
LOG_AGAIN_NS = 3_600_000_000_000  # after so long, the log shows the traceback of the same kind of error again


class GuardedSource:
    """A ByteSource that raises nothing. `device` is the source behind it, None while that is closed after an error.

    changed: the last `poll` gave the device up or got a new one, whose clock and numbers begin anew.
    """

    def __init__(self, open_device: Callable[[], Source], pads: Collection[int], description: str) -> None:
        """open_device: makes the source, later in another thread. pads: their indices on the source."""
        self.state = SourceState(description)
        self.device: Source | None = None
        self.changed = False
        self._open_device = open_device
        self._pads = frozenset(pads)
        self._bytes: ByteSource | None = None  # the device, if it is one
        self._patience: Patience | None = None
        self._failure = ""  # why the next poll gives the device up
        self._renewal: Renewal | None = None
        self._pause_s = FIRST_PAUSE_S
        self._opened_ns = self._look_ns = self._polled_ns = 0
        self._slow_polls = 0
        self._logged_ns: dict[str, int] = {}  # kind of an error → when its traceback was logged

    def open(self) -> None:
        """Open the device for the first time. Raises the SourceError of its constructor, if there is one."""
        with self._contained("its constructor", SourceError):
            self._adopt(self._open_device())

    def fail(self, where: str, error: BaseException) -> None:
        """Give the device up at the next poll. where: which of its methods raised the error."""
        if self._failure:
            return
        now_ns, kind = time.monotonic_ns(), f"{where}: {type(error).__name__}"
        if isinstance(error, SourceError):
            self._failure = text_of(error)
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
            with self._contained("fileno"):
                return _whole(self.device.fileno())
        return None

    def deadline_ns(self) -> int | None:
        if self.device is not None and not self._failure:
            with self._contained("deadline_ns"):
                due_ns = _whole(self.device.deadline_ns())
                return None if due_ns is None else max(due_ns, self._polled_ns + SHORTEST_WAIT_NS)
        return 0 if self._failure else self._look_ns

    def poll(self, now_ns: int) -> Sequence[Frame]:
        self.changed = False
        if self._renewal is not None:
            self._look(self._renewal, now_ns)
        elif self.device is not None and not self._failure:
            with self._contained("poll"):
                begun_ns = time.monotonic_ns()
                frames = self._checked(self.device.poll(now_ns))
                self._polled_ns = time.monotonic_ns()
                self._judge_pace((self._polled_ns - begun_ns) * 1e-9)
                return frames
        if self._failure:
            self._give_up()
        return ()

    def request_selftest(self, pad_index: int) -> None:
        if self.device is not None:
            with self._contained("request_selftest", SourceError):
                return self.device.request_selftest(pad_index)
        raise CannotError(f"{self.state.description}: {self.state.reason}")

    def selftest_result(self, pad_index: int) -> dict[str, object] | None:
        if self.device is not None:
            with self._contained("selftest_result", SourceError):
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
        if self._bytes is not None:
            self._bytes.patience = patience

    @property
    def clock_line(self) -> bytearray | None:
        return None if self._bytes is None else self._bytes.clock_line

    def take_early(self) -> Sequence[tuple[int, EarlySample]]:
        if self._bytes is not None and not self._failure:
            with self._contained("take_early"):
                return _early(self._bytes.take_early())
        return ()

    def lendable(self) -> frozenset[int]:
        if self._bytes is not None and not self._failure:
            with self._contained("lendable"):
                return self._bytes.lendable()
        return frozenset()

    def lend(self) -> tuple[int, bytes]:
        """SourceError where the device cannot lend its descriptor after all."""
        if self._bytes is not None and not self._failure:
            with self._contained("lend"):
                return self._bytes.lend()
        raise CannotError(f"{self.state.description}: {self.state.reason}")

    def give_back(self, unread: bytes, heard_ns: int, left_out: Sequence[int]) -> None:
        if self._bytes is not None:
            with self._contained("give_back"):
                self._bytes.give_back(unread, heard_ns, left_out)

    def passed(self, pad_index: int, sequence: int) -> None:
        if self._bytes is not None:
            with self._contained("passed"):
                self._bytes.passed(pad_index, sequence)

    def _contained(self, where: str, *passes: type[BaseException]) -> Contained:
        return Contained(partial(self.fail, where), *passes)

    def _adopt(self, device: Source) -> None:
        if not isinstance(device.state, SourceState):
            raise TypeError(f"its state is a {type(device.state).__name__}, and not a SourceState")
        device.state.follow(self.state)
        self.state, self.device = device.state, device
        self._bytes = device if isinstance(device, ByteSource) else None
        self._opened_ns, self._slow_polls = time.monotonic_ns(), 0

    def _checked(self, frames: Sequence[Frame]) -> Sequence[Frame]:
        """The frames of a poll; TypeError if they are anything else. The oldest are left out if there are too many."""
        if not isinstance(frames, list | tuple):
            raise TypeError(f"a {type(frames).__name__} came instead of a sequence of frames")
        for frame in frames:
            if not isinstance(frame, Frame):
                raise TypeError(f"a {type(frame).__name__} came instead of a frame")
            if type(frame.pad_index) is not int or frame.pad_index not in self._pads:
                raise ValueError(f"a frame of pad_index {frame.pad_index!r} came, and no such pad is configured")
            if type(frame.device_time_us) is not int:
                raise TypeError(f"a frame's device_time_us is {frame.device_time_us!r}")
        each = MOST_RECORDED if self._patience in (None, RECORDED) else MOST_JUDGED
        most = each * len(self._pads)
        for frame in frames[:-most]:
            self.state.left_out[frame.pad_index] = self.state.left_out.get(frame.pad_index, 0) + 1
        return frames[-most:]

    def _judge_pace(self, poll_s: float) -> None:
        """Nothing can interrupt a poll. A source that makes all others wait again and again is given up for a while."""
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
        # What is known only by the device that failed holds no longer.
        self.state = SourceState(self.state.description).follow(self.state)
        self._failure = ""

    def _look(self, renewal: Renewal, now_ns: int) -> None:
        """Take the new device, if it is there."""
        self._look_ns = now_ns + LOOK_NS
        if renewal.is_over:
            self._renewal = None
            with self._contained("its constructor"):
                self._adopt(renewal.result())
                self.changed = True


def open_guarded(devices: Sequence[Device]) -> list[tuple[GuardedSource, Mapping[int, str]]]:
    """A guarded source for each device. A recording that cannot be read is tried again later.

    SourceError if a device cannot do what is configured, or if nothing at all can be read.
    """
    opened: list[tuple[GuardedSource, Mapping[int, str]]] = []
    for device in devices:
        source = GuardedSource(device.open, device.names, device.description)
        try:
            source.open()
        except SourceError as error:
            if not device.is_file:
                raise
            source.fail("its constructor", error)
            log.error("%s: %s; it is tried again every %g s", ", ".join(device.names.values()), error, LONGEST_PAUSE_S)
        opened.append((source, device.names))
    if all(source.device is None for source, _ in opened):
        raise SourceError("\n".join(source.state.reason for source, _ in opened))
    return opened


def device_of(source: Source) -> Source | None:
    """The source itself, or that behind a guard; None while there is none."""
    return source.device if isinstance(source, GuardedSource) else source


def _whole(number: int | None) -> int | None:
    if number is not None and type(number) is not int:
        raise TypeError(f"{number!r} is no whole number")
    return number


def _early(samples: Sequence[tuple[int, EarlySample]]) -> Sequence[tuple[int, EarlySample]]:
    if not isinstance(samples, list | tuple):
        raise TypeError(f"a {type(samples).__name__} came instead of a sequence of samples")
    for before, sample in samples:
        if type(before) is not int or not isinstance(sample, EarlySample) or type(sample.pad_index) is not int:
            raise TypeError(f"{before!r}, {sample!r} came instead of a sample")
    return samples
