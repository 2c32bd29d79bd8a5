"""Decides which pads a board makes of its sensors: it cannot know which of them belong to one pad."""

from __future__ import annotations

from collections.abc import Mapping

from fmfts.sensor.wire.packets import ALL_BOARD_SENSORS, COUNT_BITS, FOUND_SENSORS, NO_MUX, Hello

ASKED = "the board makes its pads anew"
NOT_SAID = "the board has not listed its pads yet"


class BoardPads:
    """sensors: how many each configured pad of the board has, by its index; pads that are not configured have
    FOUND_SENSORS."""

    def __init__(self, sensors: Mapping[int, int]) -> None:
        self._sensors = dict(sensors)
        self._refused: tuple[int, ...] | None = None  # sensors of each pad of the board that refused

    @property
    def differ_from_found(self) -> bool:
        """Request these pads from the board, and again after each reset."""
        return any(sensors != FOUND_SENSORS for sensors in self._sensors.values())

    def forget(self) -> None:
        """Forget the board: it may be another one, or have other wiring."""
        self._refused = None

    def refuse(self, hello: Hello) -> None:
        """The board, whose pads are those of `hello`, cannot make the configured ones."""
        self._refused = _counts(hello)

    def request(self, hello: Hello) -> int | None:
        """The argument of the hello request that asks for the configured pads; None: they are there, or cannot be."""
        if not hello.can_make_pads or _counts(hello) == self._refused or self._wrong(hello) is None:
            return None
        return sum(sensors << COUNT_BITS * index for index, sensors in self._sensors.items())

    def fault(self, hello: Hello, pad_index: int) -> str | None:
        """Why this pad of `hello` is not the configured one; None: as far as the numbers of sensors tell, it is."""
        wrong = self._wrong(hello)
        if wrong is None:
            return None
        if self.request(hello) is not None:
            return ASKED
        if pad_index < wrong or (wanted := self._sensors.get(wrong, FOUND_SENSORS)) <= FOUND_SENSORS:
            return None  # the pads before it are the configured ones
        if not hello.can_make_pads:
            version = ".".join(map(str, hello.firmware_version))
            return (
                f"pad_index = {wrong} has {wanted} sensors, and firmware {version} makes pads of {FOUND_SENSORS}: "
                "flash the firmware that came with this daemon"
            )
        return (
            f"the board cannot make pad_index = {wrong} of {wanted} sensors: it has {_found(hello)}. A pad of more "
            f"than {FOUND_SENSORS} is all that is behind one mux, and a board reads {ALL_BOARD_SENSORS} sensors: "
            "correct pad_index, or the wiring"
        )

    def _wrong(self, hello: Hello) -> int | None:
        """The first pad that has another number of sensors; after it, a pad's index may be another pad's."""
        for index, sensors in enumerate(_counts(hello)):
            # Firmware that makes no pads does not have the sensors of unconfigured pads either.
            wanted = self._sensors.get(index, FOUND_SENSORS if hello.can_make_pads else sensors)
            if sensors != wanted:
                return index
        return None


def _counts(hello: Hello) -> tuple[int, ...]:
    return tuple(len(pad.sensors) for pad in hello.pads)


def _found(hello: Hello) -> str:
    ways = []
    for index, pad in enumerate(hello.pads):
        first, last = pad.sensors[0].channel, pad.sensors[-1].channel
        where = f"at 0x{first:02x} to 0x{last:02x}" if pad.mux_address == NO_MUX else None
        ways.append(f"pad {index} {where or f'on channels {first} to {last} of mux 0x{pad.mux_address:02x}'}")
    return ", ".join(ways)
