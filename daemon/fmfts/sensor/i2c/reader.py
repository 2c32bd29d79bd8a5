"""The process that owns one I2C bus: `python -m fmfts.sensor.i2c.reader CALL_RECORD_FD CONFIG_JSON`.

A wedged bus blocks each call for seconds, so a process of its own makes the calls. It behaves like a board: it writes
packets of firmware/wire.md to stdout, reads requests from stdin and ends with it. Sentences for people go to stderr.
"""

from __future__ import annotations

import os
import select
import signal
import sys
import time
from collections.abc import Callable

import msgspec

from fmfts import __version__
from fmfts.sensor.chips import CHIPS
from fmfts.sensor.chips.tca9548a import Switches
from fmfts.sensor.i2c import selftest as i2c_selftest
from fmfts.sensor.i2c.bus import CallRecord, I2cBus
from fmfts.sensor.i2c.pad import I2cPad
from fmfts.sensor.i2c.reader_config import ReaderConfig
from fmfts.sensor.source import SourceError
from fmfts.sensor.wire.framing import Decoder, encode
from fmfts.sensor.wire.packets import ALL_PADS, UID_BYTES, Hello, Packet, Reply, Request, Result, Status, Verb
from fmfts.sensor.wired_pad import Settings
from fmfts.service.realtime import RealtimeError, lock_memory, take_thread_priority

STATUS_NS = 1_000_000_000
WATCH_NS = 250_000_000
COMFORTABLE_LOAD = 0.8
SMOOTHING = 0.05  # averages the duration of a poll over about twenty polls
PIPE_BUFFER = 4096  # PIPE_BUF: up to this, a write is whole or not at all


class Reader:
    """The loop: polls all sensors once or twice a frame, and then sends the frames."""

    def __init__(self, config: ReaderConfig, bus: I2cBus) -> None:
        self._config = config
        self._chip = CHIPS[config.chip]
        self._settings = Settings(config.gain_code, config.rate_hz, config.trigger)
        muxes = {mux for pad in config.pads for mux in pad.mux_addresses}
        self._switches = Switches(bus, muxes)
        for address in muxes.union(*(pad.addresses for pad in config.pads)):
            bus.require_unbound(address)
        self._pads = [
            I2cPad(bus, self._switches, wiring, index, self._settings, self._chip)
            for index, wiring in enumerate(config.pads)
        ]
        self._running = True
        self._early = 0  # bit i: pad i also sends samples before their frames
        self._decoder = Decoder()
        self._dropped = 0
        self._poll_s = config.cycle_s  # starts with the time on the wires; `_poll` learns the real duration
        self._next_watch_ns = 0
        self._next_status_ns = 0
        self._states: list[tuple[int, ...]] = []

    def run(self) -> None:
        """Returns when stdin ends."""
        os.set_blocking(sys.stdout.fileno(), False)
        for pad in self._pads:
            pad.configure(self._settings)
        self._send(self._hello())
        tick_ns = time.monotonic_ns()
        while self._requests_until(tick_ns):
            polls = self._polls_per_frame()
            period_ns = 1_000_000_000 // self._settings.rate_hz
            for poll in range(polls):
                if not self._requests_until(tick_ns + poll * period_ns // polls):
                    return
                self._poll()
                if poll < polls - 1 and not self._settings.trigger:  # after the last one the frame follows at once
                    self._send_early()
            if self._running:
                for pad in self._pads:
                    complain(pad.mux_misuse())
                self._send(*(pad.sample() for pad in self._pads))
            self._watch(time.monotonic_ns())
            tick_ns = max(tick_ns + period_ns, time.monotonic_ns() - period_ns)

    def _send_early(self) -> None:
        for pad in self._pads:
            if self._running and self._early >> pad.index & 1:
                complain(pad.mux_misuse())
                self._send(*pad.early())

    def _polls_per_frame(self) -> int:
        """Two polls a frame halve the uncertainty of a free-running chip's sample time; only if the bus has time.

        A chip that is paced by this program must have ended its measurement by the next poll.
        """
        if self._settings.trigger or 2 * self._poll_s * self._settings.rate_hz >= COMFORTABLE_LOAD:
            return 1
        needed_s = self._chip.single_wait_s if self._chip.paced_by_host else 0.0
        return 2 if 2 * (needed_s + self._poll_s) * self._settings.rate_hz < 1.0 else 1

    def _watch(self, now_ns: int) -> None:
        if now_ns >= self._next_watch_ns:
            self._next_watch_ns = now_ns + WATCH_NS
            for pad in self._pads:
                pad.watch()
        status = self._status()
        states = [pad.states for pad in status.pads]
        if now_ns >= self._next_status_ns or states != self._states:
            self._next_status_ns = now_ns + STATUS_NS
            # Only a hello carries the identification of a sensor that answers for the first time.
            self._send(*([self._hello()] if states != self._states else []), status)
            self._states = states

    def _poll(self) -> None:
        start_s = time.monotonic()
        if self._running:
            self._poll_sensors()
        self._poll_s += SMOOTHING * (time.monotonic() - start_s - self._poll_s)

    def _poll_sensors(self) -> None:
        if not self._settings.trigger:
            for pad in self._pads:
                pad.poll()
            return
        measured = [pad.trigger() for pad in self._pads]
        time.sleep(self._chip.single_wait_s)
        for pad, measured_us in zip(self._pads, measured, strict=True):
            pad.poll(measured_us)

    def _requests_until(self, tick_ns: int) -> bool:
        """Answer the host until the next tick is due; False when stdin has ended."""
        while True:
            wait_s = max(0.0, (tick_ns - time.monotonic_ns()) / 1e9)
            if not select.select([sys.stdin], [], [], wait_s)[0]:
                return True
            data = os.read(sys.stdin.fileno(), PIPE_BUFFER)
            if not data:
                return False
            for packet in self._decoder.feed(data):
                if isinstance(packet, Request):
                    self._answer(packet)

    def _answer(self, request: Request) -> None:
        known = request.pad_index == ALL_PADS or request.pad_index < len(self._pads)
        result = self._change(request) if known else Result.NO_SUCH_PAD
        self._send(Reply(request.request_id, request.verb, result))
        if result != Result.DONE:
            return
        if request.verb == Verb.HELLO:
            self._early = 0  # as firmware/wire.md has it
            self._send(self._hello())
        elif request.verb == Verb.STATUS:
            self._send(self._status())
        elif request.verb == Verb.SELFTEST:
            for pad in self._pads if request.pad_index == ALL_PADS else [self._pads[request.pad_index]]:
                self._send(i2c_selftest.measure(pad, request.request_id, lambda: self._send(self._status())))

    def _change(self, request: Request) -> Result:
        now, value = self._settings, request.argument
        changes: dict[int, Callable[[], Settings]] = {
            Verb.RANGE: lambda: Settings(value, now.rate_hz, now.trigger),
            Verb.RATE: lambda: Settings(now.gain_code, value, now.trigger),
            Verb.TRIGGER: lambda: Settings(now.gain_code, now.rate_hz, value),
        }
        if request.verb in changes:
            return self._apply(changes[request.verb]())
        if request.verb in (Verb.START, Verb.STOP):
            self._running = request.verb == Verb.START
            self._early = request.argument if self._running else 0
        return Result.DONE

    def _apply(self, settings: Settings) -> Result:
        config = msgspec.structs.replace(self._config, rate_hz=settings.rate_hz, trigger=settings.trigger)
        if (
            settings.gain_code >= len(self._chip.counts_per_gauss)
            or settings.trigger not in (0, 1)
            or not 1 <= settings.rate_hz <= config.highest_rate_hz
        ):
            return Result.OUT_OF_RANGE
        self._config, self._settings = config, settings
        for pad in self._pads:
            pad.configure(settings)
        return Result.DONE

    def _hello(self) -> Hello:
        version = [int(part) for part in __version__.split(".")[:3]]
        pads = tuple(pad.describe(self._config.bus) for pad in self._pads)
        settings = (self._settings.rate_hz, self._settings.gain_code, self._settings.trigger, int(self._running))
        return Hello(
            (version[0], version[1], version[2]),
            0,
            0,
            bytes(UID_BYTES),
            *settings,
            pads,
            can_send_early=int(self._polls_per_frame() > 1),
        )

    def _status(self) -> Status:
        pads = tuple(pad.status() for pad in self._pads)
        errors = self._decoder.crc_errors + self._decoder.garbage_packets
        return Status(time.monotonic_ns() // 1000, self._dropped, errors, pads)

    def _send(self, *packets: Packet) -> None:
        """Drop and count packets that do not fit into the pipe: waiting for the host would delay every later frame."""
        for packet in packets:
            try:
                os.write(sys.stdout.fileno(), encode(packet))
            except BlockingIOError:
                self._dropped += 1


def complain(sentence: str | None) -> None:
    if sentence:
        print(sentence, file=sys.stderr, flush=True)


def _come_first(config: ReaderConfig) -> None:
    """Called after all imports, which take half a second. The reader also works without what is refused."""
    try:
        if config.lock_memory:
            lock_memory()
        if config.realtime_priority:
            take_thread_priority(config.realtime_priority)
    except RealtimeError as error:
        complain(f"the reader of I2C bus {config.bus} may be late on a busy computer: {error}")


def main(arguments: list[str]) -> int:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C ends the daemon, which then closes this process's stdin
    config = msgspec.json.decode(arguments[1], type=ReaderConfig)
    try:
        reader = Reader(config, I2cBus(config.bus, CallRecord(int(arguments[0]))))
        _come_first(config)
        reader.run()
    except SourceError as error:
        complain(str(error))
        return 1
    except BrokenPipeError:
        return 0
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
