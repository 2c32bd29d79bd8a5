"""The codes of a board as sentences for the person who has to repair it."""

from __future__ import annotations

from typing import TypeVar

from fmfts.sensor.chips import Chip
from fmfts.sensor.chips.recognised import why_not, why_not_among
from fmfts.sensor.wire.codec import VERSION
from fmfts.sensor.wire.packets import NO_MUX, Hello, HelloPad, Reply, Request, Result, SensorState, Verb
from fmfts.sensor.wired_pad import WiredPad

Key = TypeVar("Key")

DEAF = "the board sends but answers no request: check the line from host to board"
_RESET_CAUSES = ("unknown", "power on", "reset pin", "software", "independent watchdog", "window watchdog", "low power")
_CLOCKS = ("host build", "crystal", "RC oscillator")

_STATE_SENTENCES: dict[int, str] = {
    SensorState.CONFIGURATION_LOST: "does not keep its configuration: check its supply and the cable's length",
    SensorState.NO_NEW_DATA: "answers but delivers no new samples: power-cycle it",
    SensorState.SELFTEST_FAILED: "failed its self-test: replace it",
    SensorState.BUS_STUCK: "cannot be reached, SDA or SCL is held low: look for a short, power-cycle the sensors",
    SensorState.MUX_SILENT: "cannot be reached, the mux does not answer: check its supply, address pins and RESET",
    SensorState.NOT_STARTED: "has not been started yet",
}


def note(book: dict[Key, str], subject: Key, sentence: str | None) -> None:
    """Set the sentence about `subject` in `book`; None removes it."""
    if sentence is None:
        book.pop(subject, None)
    else:
        book[subject] = sentence


def sensor_name(pad: HelloPad, sensor: int) -> str:
    """The sensor's name for people, who count from one."""
    mux, channel = pad.way_to(sensor)
    if mux is None:
        return f"sensor {sensor + 1} (at 0x{channel:02x})"
    return f"sensor {sensor + 1} (mux 0x{mux:02x}, channel {channel})"


def sensor_fault(pad: HelloPad, sensor: int, state: int, chip: Chip) -> str | None:
    """The sentence for a sensor's state code, None if the sensor is ok."""
    if state == SensorState.OK:
        return None
    if state == SensorState.WRONG_IDENTIFICATION:
        what = why_not(chip, pad.sensors[sensor].identification) or "did not identify itself when started"
    elif state == SensorState.NO_ANSWER:
        what = (
            "does not answer: check its supply, SDA, SCL and address pins (two chips at one address spoil each other)"
            if pad.mux_address == NO_MUX
            else f"does not answer at 0x{chip.address:02X}: check SDA/SCL of that channel"
        )
    elif state == SensorState.MUX_SILENT and len(pad.muxes) > 1:
        # A silent mux may have a channel open, so the board reads nothing through the others either.
        muxes = " or ".join(f"0x{mux:02x}" for mux in pad.muxes)
        what = f"cannot be reached, mux {muxes} does not answer: check their supply, address pins and RESET"
    else:
        what = _STATE_SENTENCES.get(state, f"reports state {state}, unknown to this version: update the daemon")
    return f"{sensor_name(pad, sensor)} {what}"


def no_measurement(pad: HelloPad, sensor: int, state: int, chip: Chip) -> str | None:
    """Why a sensor has no counts from the self-test; None if it has, even bad ones."""
    return None if state == SensorState.SELFTEST_FAILED else sensor_fault(pad, sensor, state, chip)


def identity(hello: Hello, chip: Chip, *, has_selftest: bool) -> dict[str, object]:
    """Facts about the board from its hello, for `status` and `probe`."""
    ranges = chip.ranges_gauss
    without = {} if has_selftest else {"self_test": False}
    return without | {
        "uid": hello.uid.hex(),
        "firmware": ".".join(map(str, hello.firmware_version)),
        "wire_version": VERSION,
        "reset_cause": _named(_RESET_CAUSES, hello.reset_cause),
        "clock": _named(_CLOCKS, hello.clock),
        "rate_hz": hello.rate_hz,
        "range_gauss": ranges[hello.gain_code] if hello.gain_code < len(ranges) else None,
        "trigger": "simultaneous" if hello.trigger else "free",
        "pads": [
            {"i2c_port": pad.i2c_port}
            | _way_to(pad)
            | {"identification": [sensor.identification.hex(" ") for sensor in pad.sensors]}
            for pad in hello.pads
        ],
    }


def _way_to(pad: HelloPad) -> dict[str, object]:
    ways = [pad.way_to(sensor) for sensor in range(len(pad.sensors))]
    channels = [channel for _, channel in ways]
    if pad.mux_address == NO_MUX:
        return {"addresses": [f"0x{address:02x}" for address in channels]}
    if len(pad.muxes) > 1:
        return {"mux_addresses": [f"0x{mux:02x}" for mux, _ in ways], "channels": channels}
    return {"mux_address": pad.mux_address, "channels": channels}


def bad_clock(hello: Hello) -> str | None:
    if _named(_CLOCKS, hello.clock) != "RC oscillator":
        return None
    return "the board runs on its RC oscillator, its times are ±1 % before correction: check the crystal"


def no_early_bus() -> str:
    return (
        'the I2C bus has no time to read each chip twice a frame, so publish = "sample" is as "frame": '
        "fewer pads on this bus, a faster clock, or a lower rate_hz"
    )


def no_early_firmware(hello: Hello) -> str:
    version = ".".join(map(str, hello.firmware_version))
    return (
        f'firmware {version} sends frames only, so publish = "sample" is as "frame": flash the firmware that came with '
        "this daemon"
    )


def no_early_line(needed: float, carried: float) -> str:
    return (
        f'publish = "sample" needs {needed / 1e3:.1f} kB/s, and the line carries {carried / 1e3:.1f}, so it is as '
        '"frame": set it for fewer pads of this board, lower rate_hz, or use a board of its own'
    )


def pad_mismatch(pad: WiredPad, pad_index: int, hello: Hello) -> str | None:
    """Why the board cannot serve this pad of the config, None if it can."""
    if pad_index >= len(hello.pads):
        wants = f"pad {pad.name!r} wants pad_index = {pad_index} (they count from 0)"
        return f"the board has {_some(len(hello.pads), 'pad')}, {wants}: correct the config"
    described = hello.pads[pad_index]
    if len(described.sensors) != pad.sensors:
        return wrong_sensor_count(pad, len(described.sensors))
    other = why_not_among(pad.chip, [sensor.identification for sensor in described.sensors])
    return None if other is None else f"pad {pad.name!r}: {sensor_name(described, other[0])} {other[1]}"


def wrong_sensor_count(pad: WiredPad, sensors: int) -> str:
    wanted = f"geometry.sensors_mm has {pad.sensors}"
    return f"pad {pad.name!r}: the source has {sensors} sensors, {wanted}: correct the config"


def contradiction(hello: Hello, pad_index: int, sensors: int) -> str | None:
    """How a packet about a pad contradicts the board's hello; None if they agree."""
    if pad_index >= len(hello.pads):
        return f"it is for pad {pad_index}, and the hello has {_some(len(hello.pads), 'pad')}"
    expected = len(hello.pads[pad_index].sensors)
    return None if sensors == expected else f"it has {_some(sensors, 'sensor')}, and the hello has {expected}"


def misfits(count: int, what: str, why: str) -> str:
    """The warning about packets with a correct CRC and an impossible content."""
    return f"{_some(count, 'packet')} left out, the last a {what}: {why}; if this goes on, flash the firmware again"


def _some(count: int, what: str) -> str:
    return f"{count} {what}" if count == 1 else f"{count} {what}s"


def foreign_version(version: int) -> str:
    mend = "update the daemon" if version > VERSION else "flash the firmware that came with this daemon"
    return f"the board speaks wire version {version}, this daemon {VERSION}: {mend}"


def refusal(request: Request, reply: Reply) -> str:
    reason = _named(tuple(result.name.lower().replace("_", " ") for result in Result), reply.result)
    asked = f"{Verb(request.verb).name.lower()} {request.argument} (pad index {request.pad_index})"
    return f"the board refused the request {asked}: {reason}"


def _named(names: tuple[str, ...], code: int) -> str:
    return names[code] if code < len(names) else f"code {code}"
