"""Frames from an STM32 on a serial port. `poll` does all the work and never waits."""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

import serial

from fmfts.sensor.bridge import serial_port
from fmfts.sensor.frame import Frame
from fmfts.sensor.wire.clock import DeviceClock
from fmfts.sensor.wire.faults import note
from fmfts.sensor.wire.packet_source import PacketSource
from fmfts.sensor.wire.packets import Verb, frame_bytes
from fmfts.sensor.wired_pad import PadOnBoard

log = logging.getLogger(__name__)

READ_BYTES = 4096  # the size of Linux's buffer for a serial line
FIRST_BACKOFF_NS = 50_000_000
LONGEST_BACKOFF_NS = 1_000_000_000
LOOK_NS = 50_000_000  # interval of checks whether a device was plugged in or pulled out; a check opens no port
SILENCE_NS = 1_500_000_000  # a board sends its status every second, whatever else it does
REOPEN_NS = 5_000_000_000  # reopen the port after this silence: some adapters recover only then
IDENTIFY_NS = 1_500_000_000  # within this time the board on a port must send its hello


class Bridge(PacketSource):
    """A ByteSource: one board on one port, with `pads` by pad index."""

    _clock: DeviceClock
    clock_ns = staticmethod(time.monotonic_ns)  # the clock of the frames' arrival; a benchmark replaces it

    def __init__(self, pads: Mapping[int, PadOnBoard], by_id: Path = Path("/dev/serial/by-id")) -> None:
        any_pad = next(iter(pads.values()))
        self._uid = None if any_pad.uid is None else bytes.fromhex(any_pad.uid)
        super().__init__(pads, f"bridge on {any_pad.port}", DeviceClock(), self._uid)
        self._configured_port = any_pad.port
        self._baud = any_pad.baud
        self._by_id = by_id
        self._candidates: list[str] = []
        self._found: dict[str, str] = {}  # port → what answered there, in the present round of `_candidates`
        self._serial: serial.Serial | None = None
        self._port = any_pad.port
        self._opened_ns = 0
        self._attempt_ns = 0
        self._backoff_ns = FIRST_BACKOFF_NS
        self._look_ns = 0
        self._there: frozenset[object] = frozenset()
        self._strange_is_logged = False
        self._is_drained = False  # the last read emptied the line
        self._read_ns = 0  # and all bytes before this time were read

    def deadline_ns(self) -> int | None:
        if self._serial is None:
            return min(self._attempt_ns, self._look_ns)
        patience_ns = SILENCE_NS if self.state.connected else REOPEN_NS
        times = [self._quiet_since_ns + patience_ns, self._link.due_ns]
        if not self.state.connected:
            times.append(self._look_ns)
        if not self._link.is_right_board:
            times.append(self._opened_ns + IDENTIFY_NS)
        return min(when for when in times if when is not None)

    def poll(self, now_ns: int) -> Sequence[Frame]:
        if self._serial is None and now_ns >= self._look_ns:
            self._look(now_ns)
        if self._serial is None and (now_ns < self._attempt_ns or not self._open(now_ns)):
            return ()
        frames = self._receive(now_ns)
        if frames and self.state.connected and not self._outbox and self._link.is_quiet:
            return frames  # the line works, and there is nothing to send
        if self._serial is not None:
            self._judge(now_ns)
        if self._serial is not None:
            self._send(now_ns)
        return frames

    def load_counts(self) -> list[tuple[int, int]]:
        """(CLOCK_MONOTONIC ns, counts) of the load cell on the board's spare pins since the last call."""
        loads = list(self._link.loads)
        self._link.loads.clear()
        return loads

    def close(self) -> None:
        self._release()
        self._attempt_ns = self._look_ns = 1 << 62
        self.state.disconnect("closed", time.monotonic_ns())

    @property
    def _quiet_since_ns(self) -> int:
        return max(self._link.heard_ns, self._opened_ns)

    @property
    def _is_configured_port(self) -> bool:
        """Sends nothing to another port before a packet came from it: any device may be there."""
        return self._port == self._configured_port

    def _look(self, now_ns: int) -> None:
        """Try the ports at once if a device was just plugged in."""
        self._look_ns = now_ns + LOOK_NS
        before, self._there = self._there, serial_port.presence(self._ports_to_try())
        if self._there - before:
            self._candidates.clear()
            self._attempt_ns = now_ns
            self._backoff_ns = FIRST_BACKOFF_NS

    def _open(self, now_ns: int) -> bool:
        if not self._candidates:
            self._candidates = self._ports_to_try()
            self._found.clear()
        self._port = self._candidates.pop(0)
        try:
            self._serial = serial_port.open_raw(self._port, self._baud)
        except OSError as error:
            self._found[self._port] = serial_port.why_not_open(self._port, error)
            self._next_attempt(now_ns)
            return False
        self._descriptor = self._serial.fileno()  # kept, because asking pyserial takes longer than reading
        self._opened_ns = now_ns
        self._outbox = b""
        sensors = max(pad.sensors for pad in self._pads.values())
        self._clock.fixed_delay_ns = serial_port.transfer_ns(self._port, self._baud, frame_bytes(sensors))
        self._link.line_carries(serial_port.bytes_per_s(self._port, self._baud))
        self._link.restart()
        note(self.state.warnings, "latency timer", serial_port.latency_warning(self._port))
        if self._is_configured_port:
            self._link.requests.ask(Verb.HELLO)
        return True

    def _ports_to_try(self) -> list[str]:
        """The configured port. With a configured uid also every other port of udev: the board may have moved."""
        if self._uid is None:
            return [self._configured_port]
        others = {os.path.realpath(path): str(path) for path in sorted(self._by_id.glob("*"))}
        others.pop(os.path.realpath(self._configured_port), None)
        return [self._configured_port, *others.values()]

    def _receive(self, now_ns: int) -> Sequence[Frame]:
        gone = self._drain()
        if gone and b"\0" not in self._unread:
            self._disconnect(gone, now_ns)
            return ()
        if not self._unread:
            return ()
        data = self._take_unread()
        unheard = self._link.heard_ns == 0
        # Not `now_ns`: bytes may have arrived since, and would get a time before their arrival.
        arrival_ns = self.clock_ns()
        frames = self._link.feed(data, arrival_ns)
        if self._is_drained:
            self._clock.found_empty(self._read_ns)
        if unheard and self._link.heard_ns and not self._is_configured_port:
            self._link.requests.ask(Verb.HELLO)
        return frames

    def _drain(self) -> str:
        """Read all waiting bytes into `_unread`, without superseded frames. Returns why the port is gone, if it is."""
        assert self._descriptor is not None
        self._is_drained, size = True, READ_BYTES
        try:
            # A short read empties the line. After a long one the kernel may not have handed over the rest yet.
            while size > READ_BYTES // 2 and len(self._unread) <= 2 * READ_BYTES:
                read_ns = self.clock_ns()  # before the read: another program may delay this one after it
                more = os.read(self._descriptor, READ_BYTES)
                self._read_ns = read_ns
                if not more:
                    return "the port hung up, so plug the board in again"
                size = len(more)
                self._is_drained &= size <= READ_BYTES // 2
                self._unread += more
                self._keep_newest()
        except BlockingIOError:
            pass
        except OSError as error:  # EIO: hung up. ENXIO, ENODEV: unplugged
            return f"the port is gone ({error.strerror}), so plug the board in again"
        return ""

    def _judge(self, now_ns: int) -> None:
        """Decide whether the port is connected, silent, has the wrong board, or is no board at all."""
        link = self._link
        if not self.state.connected and self._has_lost_its_name(now_ns):
            self._disconnect(
                f"{self._port} is no longer the device that was opened, so plug the board in again", now_ns
            )
        elif not link.is_right_board:
            if link.hello is not None:
                self._found[self._port] = f"holds board {link.hello.uid.hex()}"
                self._give_port_up(now_ns)
            elif now_ns - self._opened_ns >= IDENTIFY_NS:
                strange = link.strange.sentence((now_ns - self._opened_ns) / 1e9, self._baud)
                self._log_strange(strange)
                silence = "answers, but sends no uid" if link.heard_ns else strange or "holds no board that answers"
                self._found[self._port] = self.state.warnings.get("wire version", silence)
                self._give_port_up(now_ns)
        elif now_ns - self._quiet_since_ns >= SILENCE_NS:
            self._silent(now_ns)
        elif link.heard_ns and not self.state.connected:
            self._backoff_ns = FIRST_BACKOFF_NS
            self._candidates.clear()
            self.state.description = f"bridge on {self._port}"
            self.state.connect(now_ns)
            self._strange_is_logged = False

    def _has_lost_its_name(self, now_ns: int) -> bool:
        """True if the port's name now belongs to a device that was plugged in later: then do not wait for this one."""
        if now_ns < self._look_ns:
            return False
        self._look_ns = now_ns + LOOK_NS
        return self._serial is not None and not serial_port.is_named(self._port, self._serial)

    def _silent(self, now_ns: int) -> None:
        quiet_s = (now_ns - self._quiet_since_ns) / 1e9
        silent = f"the port is open but silent for {quiet_s:.1f} s: is the board powered and running?"
        strange = self._link.strange.sentence(quiet_s, self._baud)
        reason = self.state.warnings.get("wire version", strange or silent)
        self._log_strange(strange)
        if now_ns - self._quiet_since_ns >= REOPEN_NS:
            self._disconnect(reason, now_ns)
            return
        if self.state.connected:
            self._link.requests.ask(Verb.HELLO)
        self.state.disconnect(reason, now_ns)

    def _log_strange(self, strange: str | None) -> None:
        """Log it once until a board is there: the reason in the status keeps counting."""
        if strange is not None and not self._strange_is_logged:
            self._strange_is_logged = True
            log.warning("%s: %s", self._port, strange)

    def _send(self, now_ns: int) -> None:
        assert self._descriptor is not None
        self._outbox = self._outbox or self._link.outgoing(now_ns)
        if not self._outbox:
            return
        try:
            self._outbox = self._outbox[os.write(self._descriptor, self._outbox) :]
        except BlockingIOError:
            return  # the next poll sends the rest; it comes after 250 ms at the latest, when the request is repeated
        except OSError as error:
            self._disconnect(f"the port takes no requests ({error.strerror}), so plug the board in again", now_ns)

    def _give_port_up(self, now_ns: int) -> None:
        self._release()
        self._next_attempt(now_ns)

    def _next_attempt(self, now_ns: int) -> None:
        """Try the next candidate at once; after the last one, report what was found and wait."""
        if self._candidates:
            self._attempt_ns = now_ns
            return
        self._attempt_ns = now_ns + self._backoff_ns
        self._backoff_ns = min(2 * self._backoff_ns, LONGEST_BACKOFF_NS)
        if self._uid is None:
            reason = f"the port {self._found[self._port]}"
        else:
            found = ", and ".join(f"{port} {what}" for port, what in self._found.items())
            reason = f"board {self._uid.hex()} was not found, because {found}"
        self.state.disconnect(reason, now_ns)

    def _disconnect(self, reason: str, now_ns: int) -> None:
        """Close the port first: while it is open, an adapter that is plugged in again gets another name."""
        self._release()
        self._link.lost(reason)
        self._candidates.clear()
        self._attempt_ns = now_ns + self._backoff_ns
        self._backoff_ns = min(2 * self._backoff_ns, LONGEST_BACKOFF_NS)
        self.state.disconnect(reason, now_ns)

    def _release(self) -> None:
        if self._serial is not None:
            serial_port.close(self._serial)
            self._unread = b""
            self._serial = self._descriptor = None
