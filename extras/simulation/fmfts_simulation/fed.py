"""A Source whose frames another program makes, for example a simulator of the whole robot, and sends to a socket."""

from __future__ import annotations

import os
import socket
import stat
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import msgspec

from fmfts.bus.frame_message import frame_of
from fmfts.bus.messages import FrameMessage
from fmfts.config import PadConfig, SimulatedSource
from fmfts.sensor.chips import CHIPS
from fmfts.sensor.frame import Frame
from fmfts.sensor.source import CannotError, Source, SourceError, SourceState
from fmfts_simulation.array import simulated_pad

SILENT_NS = 1_000_000_000
LARGEST_BYTES = 1 << 14  # bytes of a frame: one of 64 sensors has 6 kB
MOST_FRAMES = 8  # that one poll takes
_decoder = msgspec.msgpack.Decoder(FrameMessage)


class Fed:
    """Frames of one pad: each is a datagram, a `frame/<pad>` message as the bus sends them (docs/messages.md).

    Only the user of the daemon may write to the socket. Frames with another `boot` come from a restarted program.
    """

    def __init__(self, config: PadConfig) -> None:
        """SourceError where there can be no socket."""
        source = config.source
        assert isinstance(source, SimulatedSource)
        assert source.frames_from is not None
        self._path, self._pad, self._chip = Path(source.frames_from), config.name, CHIPS[source.chip]
        self.state = SourceState(description=f"simulator at {self._path}", reason=f"no frame came to {self._path} yet")
        self._boot, self._run, self._heard_ns = "", 0, 0
        self._socket = _bound(self._path)

    def fileno(self) -> int | None:
        return self._socket.fileno()

    def deadline_ns(self) -> int | None:
        return self._heard_ns + SILENT_NS if self.state.connected else None

    def poll(self, now_ns: int) -> Sequence[Frame]:
        frames: list[Frame] = []
        with suppress(BlockingIOError):
            for _ in range(MOST_FRAMES):
                frame = self._frame(self._socket.recv(LARGEST_BYTES))
                if frame is not None:
                    frames.append(frame)
        if frames:
            self._heard_ns = now_ns
            self.state.connect(now_ns)
        elif self.state.connected and now_ns - self._heard_ns >= SILENT_NS:
            self.state.disconnect(f"no frame came to {self._path} for a second: does the simulator run?", now_ns)
        return frames

    def _frame(self, datagram: bytes) -> Frame | None:
        """None, and it is counted, if the datagram is no frame of this pad."""
        try:
            message = _decoder.decode(datagram)
            frame = frame_of(message, 0, self._chip)
        except (ValueError, OverflowError):  # msgspec's errors are ValueErrors
            self.state.garbage_bytes += len(datagram)
            return None
        if message.pad != self._pad:
            self.state.warnings["pad"] = f"frames of pad '{message.pad[:32]}' come to {self._path}: they are left out"
            return None
        if message.boot != self._boot:
            self._boot, self._run = message.boot, self._run + 1
        return replace(frame, run=self._run)

    def request_selftest(self, pad_index: int) -> None:
        raise CannotError(f"{self.state.description}: it has no self-test")

    def selftest_result(self, pad_index: int) -> dict[str, object] | None:
        return None

    def close(self) -> None:
        if self._socket.fileno() >= 0:
            self._socket.close()
            with suppress(OSError):
                self._path.unlink()
        self.state.disconnect("closed", time.monotonic_ns())


def source_of(config: PadConfig, beside: Sequence[PadConfig]) -> Source:
    """What the daemon polls for a simulated pad, as the entry point names it. beside: as for `simulated_pad`."""
    source = config.source
    assert isinstance(source, SimulatedSource)
    return simulated_pad(config, beside) if source.frames_from is None else Fed(config)


def _bound(path: Path) -> socket.socket:
    """A datagram socket at `path`, which replaces that of an earlier daemon."""
    opened = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
    mask = os.umask(0o177)
    try:
        if path.exists() and stat.S_ISSOCK(path.stat().st_mode):
            path.unlink()
        opened.bind(str(path))
    except OSError as error:
        opened.close()
        remedy = "name another file in frames_from, in a folder that exists, of less than 100 letters"
        raise SourceError(f"{path}: no simulator can send frames there: {error.strerror or error}: {remedy}") from error
    finally:
        os.umask(mask)
    return opened
