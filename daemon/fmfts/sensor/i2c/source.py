"""Frames from one Linux I2C bus, through the process that owns it (reader.py). That process may die or get stuck."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress

import msgspec

from fmfts.sensor.frame import Frame
from fmfts.sensor.i2c.adapter import adapter_of, clock_differs, too_fast_for_usb, usb_limit
from fmfts.sensor.i2c.bus import CallRecord
from fmfts.sensor.i2c.reader_config import reader_config
from fmfts.sensor.wire.clock import HostClock
from fmfts.sensor.wire.faults import note
from fmfts.sensor.wire.packet_source import PacketSource
from fmfts.sensor.wire.packets import Verb
from fmfts.sensor.wired_pad import PadOnI2c
from fmfts.service.realtime import memory_is_locked, thread_priority

READ_BYTES = 65536
CHECK_NS = 100_000_000
STUCK_NS = 300_000_000  # a transfer takes less than a millisecond
KILL_NS = 2_000_000_000
SILENCE_NS = 3_000_000_000  # without a packet, although the reader lives and is in no bus call
START_NS = 30_000_000_000  # until its first packet: half a second, but much longer on a busy computer
FIRST_BACKOFF_NS = 200_000_000
LONGEST_BACKOFF_NS = 1_000_000_000
WARNING_NS = 3_000_000_000
CLOSE_S = 1.0


class I2c(PacketSource):
    """A ByteSource: one bus with `pads` by pad index."""

    def __init__(self, pads: Mapping[int, PadOnI2c]) -> None:
        self._config = reader_config(pads)
        super().__init__(pads, f"I2C bus {self._config.bus}", HostClock())
        self._path = f"/dev/i2c-{self._config.bus}"
        self._record = CallRecord()
        self._process: subprocess.Popen[bytes] | None = None
        self._last_words = ""
        self._killed = ""
        self._started_ns = 0
        self._attempt_ns = 0
        self._check_ns = 0
        self._warned_ns = 0
        self._backoff_ns = FIRST_BACKOFF_NS

    def deadline_ns(self) -> int | None:
        if self._process is None:
            return self._attempt_ns
        return min(when for when in (self._check_ns, self._link.due_ns) if when is not None)

    def poll(self, now_ns: int) -> Sequence[Frame]:
        if self._process is None:
            if now_ns >= self._attempt_ns:
                self._start(now_ns)
            return ()
        frames = self._receive(now_ns)
        if now_ns >= self._check_ns:
            self._check_ns = now_ns + CHECK_NS
            self._check(now_ns)
        if self._process is not None and not self._killed:
            self._send(now_ns)
        return frames

    def close(self) -> None:
        self._attempt_ns = 1 << 62
        if self._process is not None:
            self._process.kill()
            # Do not wait longer for a process that is stuck in the kernel: it dies when the call returns.
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(CLOSE_S)
            self._forget_process()
        self.state.disconnect("closed", time.monotonic_ns())

    def _start(self, now_ns: int) -> None:
        # A late poll makes a late contact, so the reader gets the priority of the daemon's loop, and locked memory.
        config = msgspec.structs.replace(
            self._config, realtime_priority=thread_priority(), lock_memory=memory_is_locked()
        )
        command = [sys.executable, "-m", "fmfts.sensor.i2c.reader", str(self._record.descriptor)]
        command.append(msgspec.json.encode(config).decode())
        pipe = subprocess.PIPE
        self._record.end()
        self._process = subprocess.Popen(
            command, stdin=pipe, stdout=pipe, stderr=pipe, bufsize=0, pass_fds=[self._record.descriptor]
        )
        for stream in ("stdin", "stdout", "stderr"):
            os.set_blocking(self._pipe(stream), False)
        self._descriptor = self._pipe("stdout")
        self._started_ns = now_ns
        self._check_ns = now_ns + CHECK_NS
        self._killed = self._last_words = ""
        self._unread = b""
        self._link.restart()
        self._describe_adapter()
        self._link.requests.ask(Verb.HELLO)

    def _describe_adapter(self) -> None:
        """At each start: an adapter on USB may have been plugged in since, as another bus."""
        adapter, config = adapter_of(self._config.bus), self._config
        if adapter.name:  # the bus is there
            self.state.board["adapter"] = f"{adapter}{usb_limit(adapter, config.load)}"
        note(self.state.warnings, "bus clock", clock_differs(adapter, config.clock_hz))
        note(self.state.warnings, "usb", too_fast_for_usb(adapter, config.load, config.rate_hz))

    def _pipe(self, stream: str) -> int:
        file = getattr(self._process, stream)
        return int(file.fileno())

    def _receive(self, now_ns: int) -> Sequence[Frame]:
        if self._killed:
            return ()
        try:
            more = os.read(self._pipe("stdout"), READ_BYTES)  # the size of a pipe's buffer
            if not more:
                self._check_ns = now_ns  # the reader is ending: `_check` finds out why
            self._unread += more
        except BlockingIOError:
            pass
        if not self._unread:
            return ()
        self._keep_newest()
        # Not `now_ns`: bytes may have arrived since, and would get a time before their arrival.
        frames = self._link.feed(self._take_unread(), time.monotonic_ns())
        if not self.state.connected and self._link.hello is not None:
            self._backoff_ns = FIRST_BACKOFF_NS
            self.state.connect(now_ns)
        return frames

    def _check(self, now_ns: int) -> None:
        """Check whether the reader has died, is stuck in a bus call, or is silent."""
        assert self._process is not None
        self._hear_sentences(now_ns)
        if self._process.poll() is not None:
            self._ended(now_ns)
            return
        call = self._record.current()
        patience_ns = SILENCE_NS if self._link.heard_ns else START_NS
        if call is not None and now_ns - call[0] > STUCK_NS:
            stuck_s = (now_ns - call[0]) / 1e9
            reason = f"{self._path} is wedged for {stuck_s:.1f} s in {call[1]}: look for SDA or SCL held low"
            self.state.disconnect(reason, now_ns)
            if now_ns - call[0] > KILL_NS and not self._killed:
                self._kill(reason)
        elif now_ns - max(self._link.heard_ns, self._started_ns) > patience_ns and not self._killed:
            self._kill(f"the reader of {self._path} has sent nothing for {patience_ns / 1e9:.0f} s")
            self.state.disconnect(self._killed, now_ns)

    def _kill(self, reason: str) -> None:
        """Kill the reader. The next one starts when this one has ended: until then it holds the lock of the bus."""
        assert self._process is not None
        self._killed, self._descriptor = reason, None
        self._process.kill()

    def _hear_sentences(self, now_ns: int) -> None:
        try:
            text = os.read(self._pipe("stderr"), READ_BYTES).decode(errors="replace").strip()
        except BlockingIOError:
            text = ""
        if text:
            self._last_words = self.state.warnings["bus"] = text.splitlines()[-1]
            self._warned_ns = now_ns
        elif now_ns - self._warned_ns > WARNING_NS:
            self.state.warnings.pop("bus", None)

    def _ended(self, now_ns: int) -> None:
        assert self._process is not None
        code = self._process.returncode
        last_words = self._last_words if code > 0 else ""  # after a signal its last sentence is unrelated
        reason = self._killed or last_words or f"its reader ended with code {code}"
        self._forget_process()
        self._link.lost(reason)
        self._attempt_ns = now_ns + self._backoff_ns
        self._backoff_ns = min(2 * self._backoff_ns, LONGEST_BACKOFF_NS)
        self.state.disconnect(reason, now_ns)

    def _forget_process(self) -> None:
        assert self._process is not None
        for stream in (self._process.stdin, self._process.stdout, self._process.stderr):
            assert stream is not None
            stream.close()
        self._process = self._descriptor = None

    def _send(self, now_ns: int) -> None:
        # A request is far shorter than PIPE_BUF, so it is written whole or not at all. A lost request is repeated.
        with suppress(BlockingIOError, BrokenPipeError):
            data = self._link.outgoing(now_ns)
            if data:
                os.write(self._pipe("stdin"), data)
