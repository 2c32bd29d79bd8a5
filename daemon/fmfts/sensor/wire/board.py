"""Keeps a board's reports in the source's state, and finds the requests that bring it to the configured settings."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

from msgspec.structs import replace

from fmfts.sensor.chips.rates import fastest_on_board_hz
from fmfts.sensor.source import SourceState
from fmfts.sensor.wire import faults
from fmfts.sensor.wire.board_pads import NOT_SAID, BoardPads
from fmfts.sensor.wire.packets import EARLY_BYTES, Hello, Selftest, Status, StatusPad, Verb, frame_bytes
from fmfts.sensor.wired_pad import PadOnBoard, Settings, WiredPad

# The field of the hello that each request changes.
SETTING = {Verb.RANGE: "gain_code", Verb.RATE: "rate_hz", Verb.TRIGGER: "trigger"}

FULL = 0.95  # share of a line that frames and early samples may take; status and replies need some, too


class Board:
    """`hello`: the board's last hello, None before the first. uid: of the configured board, None: any board will do."""

    def __init__(self, pads: Mapping[int, WiredPad], state: SourceState, uid: bytes | None) -> None:
        self.hello: Hello | None = None
        self._pads = pads
        first = next(iter(pads.values()))  # settings that all pads of a board share
        self.chip = first.chip
        self._has_selftest = first.has_selftest
        self._settings = Settings.of(first)
        self._state = state
        self._uid = uid
        self._early = sum(1 << index for index, pad in pads.items() if pad.early)
        self.line_bytes_per_s = math.inf
        self._made = BoardPads(
            dict(first.beside) | {index: pad.sensors for index, pad in pads.items()}
            if isinstance(first, PadOnBoard)
            else {}
        )
        self._has_said_its_pads = not self._made.differ_from_found

    @property
    def is_right(self) -> bool:
        """False while a uid is configured and no hello has confirmed it."""
        return self._uid is None or (self.hello is not None and self.hello.uid == self._uid)

    def forget(self) -> None:
        self.hello = None
        self._made.forget()
        self.was_reset()
        for book in (self._state.board, self._state.pad_faults, self._state.sensor_faults, self._state.warnings):
            book.clear()

    def contradiction(self, pad_index: int, sensors: int) -> str | None:
        """Why a packet about this pad, with `sensors` sensors, contradicts the hello; None if it does not."""
        return None if self.hello is None else faults.contradiction(self.hello, pad_index, sensors)

    def contradiction_of(self, selftest: Selftest) -> str | None:
        """The same for a self-test's result, and its gain code."""
        if selftest.gain_code >= len(self.chip.counts_per_gauss):
            return f"there is no gain code {selftest.gain_code}"
        return self.contradiction(selftest.pad_index, len(selftest.sensors))

    def was_reset(self) -> bool:
        """Its clock restarted. True: it may have other pads now, and must say hello before its samples are used."""
        self._has_said_its_pads = not self._made.differ_from_found
        return not self._has_said_its_pads

    def pads_to_ask_for(self) -> int | None:
        """The argument of the hello request that makes the configured pads; None: they are there, or cannot be."""
        return None if self.hello is None else self._made.request(self.hello)

    def cannot_make_pads(self) -> None:
        """The board has refused that request."""
        if self.hello is not None:
            self._made.refuse(self.hello)
            self.describe()

    def mismatch(self, pad_index: int, sensors: int) -> str | None:
        """Why samples of `sensors` sensors are not of the configured pad; None if they may be."""
        if not self._has_said_its_pads:
            return NOT_SAID
        if self.hello is not None and (fault := self._made.fault(self.hello, pad_index)) is not None:
            return fault
        pad = self._pads[pad_index]
        if sensors != pad.sensors:
            return faults.wrong_sensor_count(pad, sensors)
        return None if self.hello is None else faults.pad_mismatch(pad, pad_index, self.hello)

    def describe(self) -> None:
        """Write the last hello into the state. Call it only for the right board."""
        hello = self.hello
        assert hello is not None
        self._has_said_its_pads = True
        self._state.board.update(self._identity(hello))
        faults.note(self._state.warnings, "clock", faults.bad_clock(hello))
        faults.note(self._state.warnings, "early", self._why_not_early(hello))
        for pad_index, pad in self._pads.items():
            wrong = self._made.fault(hello, pad_index) or faults.pad_mismatch(pad, pad_index, hello)
            faults.note(self._state.pad_faults, pad_index, wrong)
        self._state.sensor_faults.clear()
        for pad_index, described in enumerate(hello.pads):
            self._note_sensors(hello, pad_index, tuple(sensor.state for sensor in described.sensors))

    def _identity(self, hello: Hello) -> dict[str, object]:
        return faults.identity(hello, self.chip, has_selftest=self._has_selftest)

    def wishes(self) -> Iterator[tuple[Verb, int]]:
        """The requests that bring the board to the configured settings."""
        hello, wanted = self.hello, self._settings
        assert hello is not None
        if hello.gain_code != wanted.gain_code:
            yield Verb.RANGE, wanted.gain_code
        # The order matters, because a board refuses a rate that its present trigger cannot reach.
        changes = [(Verb.TRIGGER, hello.trigger, wanted.trigger), (Verb.RATE, hello.rate_hz, wanted.rate_hz)]
        for verb, actual, value in reversed(changes) if wanted.trigger else changes:
            if actual != value:
                yield verb, value
        early = self._early if self._why_not_early(hello) is None else 0
        if not hello.running or early:
            yield Verb.START, early

    def _why_not_early(self, hello: Hello) -> str | None:
        """Why the board does not send samples before their frames, although that is configured."""
        if not self._early:
            return None
        if not hello.can_send_early:
            return faults.no_early_firmware(hello) if any(hello.uid) else faults.no_early_bus()  # a bus has no uid
        needed = sum(self._settings.rate_hz * frame_bytes(len(pad.sensors)) for pad in hello.pads)
        for pad_index, pad in enumerate(hello.pads):
            if self._early >> pad_index & 1:
                needed += round(len(pad.sensors) * fastest_on_board_hz(self.chip, self._settings.rate_hz) * EARLY_BYTES)
        if needed > FULL * self.line_bytes_per_s:
            return faults.no_early_line(needed, self.line_bytes_per_s)
        return None

    def granted(self, verb: Verb, argument: int) -> None:
        """The board has carried out a request of SETTING."""
        if self.hello is not None:
            self.hello = replace(self.hello, **{SETTING[verb]: argument})
            self._state.board.update(self._identity(self.hello))

    def count(self, status: Status) -> None:
        """Note the losses on the line that the board counted."""
        self._state.board["transmit_dropped"] = status.transmit_dropped
        self._state.board["receive_errors"] = status.receive_errors

    def count_of_pad(self, pad_index: int, pad: StatusPad) -> None:
        counters = {"errors": pad.bus_errors, "recoveries": pad.bus_recoveries, "repairs": pad.config_repairs}
        self._state.board[f"bus_{pad_index}"] = counters
        if self.hello is not None:
            self._note_sensors(self.hello, pad_index, pad.states)

    def _note_sensors(self, hello: Hello, pad_index: int, states: tuple[int, ...]) -> None:
        if pad_index in self._pads:
            for sensor, state in enumerate(states):
                sentence = faults.sensor_fault(hello.pads[pad_index], sensor, state, self.chip)
                faults.note(self._state.sensor_faults, (pad_index, sensor), sentence)
