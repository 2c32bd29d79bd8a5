"""`fmfts-daemon init`: finds the board and writes a commented configuration for it."""

from __future__ import annotations

import argparse
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fmfts.cli import elsewhere
from fmfts.cli.verb import AddVerb, VerbError
from fmfts.common import exit_codes
from fmfts.common.writing import why_not_written
from fmfts.service.state import write_atomically

if TYPE_CHECKING:
    from fmfts.config.example import FoundPad
    from fmfts.sensor.chips import Chip
    from fmfts.sensor.chips.rates import BusLoad
    from fmfts.sensor.i2c.scan import Found

DEFAULT_FILE = Path("pad.toml")
TURN_S = 0.01
PAD_CHANNELS = 4  # a mux carries two pads


def add_to(verb: AddVerb) -> None:
    added = verb(
        "init", _init, "find the board and write a commented configuration for it", f"to write: {DEFAULT_FILE}"
    )
    added.add_argument(
        "--learn",
        action="store_true",
        help="unknown geometry: write a sketch with wide tolerances, for `baseline --learn`",
    )
    where = added.add_mutually_exclusive_group()
    where.add_argument("--port", metavar="PORT", help="the board's serial port; without it, all ports are tried")
    where.add_argument("--i2c", type=int, metavar="BUS", help="a pad on this I2C bus of the computer: 1 for /dev/i2c-1")
    where.add_argument("--simulated", action="store_true", help="no hardware: the configuration of the demo")


def _init(options: argparse.Namespace) -> int:
    from fmfts.config.example import EXAMPLE_PATH, unusual, written_for

    file = options.config or DEFAULT_FILE
    if file.exists():
        raise VerbError(
            exit_codes.UNWRITABLE, f"{file} exists and is left as it is: remove it, or name another with --config"
        )
    pads: list[FoundPad] = []
    if options.simulated and options.learn:
        raise VerbError(exit_codes.USAGE, "--learn is for a board: the simulated pad is as its drawing says")
    if options.learn:  # before the work of sketching a board that could not be learned
        elsewhere.require("init --learn")
    if options.simulated:
        text, where = EXAMPLE_PATH.read_text(encoding="utf-8"), "a simulated pad"
    else:
        pads, where = _on_i2c(options.i2c) if options.i2c is not None else _on_ports(options.port)
        text = written_for(pads, where, options.learn)
    try:
        write_atomically(file, text.encode())  # a part of it would keep the next `init` from writing one
    except OSError as error:
        why = why_not_written(error, "name another with --config")
        raise VerbError(exit_codes.UNWRITABLE, f"{file} cannot be written: {why}") from error
    print(f"{file}: written for {where}")
    for remark in filter(None, map(unusual, pads)):
        print(remark)
    check = f"`fmfts-daemon check-config --config {file}`"
    compare = "compare its [pad.geometry] with your pad"
    if options.learn:
        compare = "sketch your board in [pad.geometry] to 2 mm and 10° (a ruler will do)"
    print(f"next: {check}" if options.simulated else f"next: {compare}, then {check}")
    return 0


def _on_ports(port: str | None) -> tuple[list[FoundPad], str]:
    """The pads of the first board that answers, and where it is. Raises VerbError if there is none."""
    from fmfts.config import BridgeSource
    from fmfts.sensor.bridge.serial_port import PORTS, candidates

    ports = [port] if port is not None else candidates()
    reasons = []
    for one in ports:
        board, reason = _asked(BridgeSource(port=one))
        if board.get("uid"):
            return _pads_of(board, one), f"board {board['uid']} on {one}"
        reasons.append(f"{one}: {reason}")
    if port is not None:
        raise VerbError(exit_codes.UNAVAILABLE, f"no board on {reasons[0]}")
    tried = "; ".join(reasons) if reasons else f"there is no {' or '.join(PORTS)}"
    raise VerbError(
        exit_codes.UNAVAILABLE,
        f"no board found ({tried}): plug it in, or say where it is with --port or --i2c; --simulated needs none",
    )


def _on_i2c(bus: int) -> tuple[list[FoundPad], str]:
    """The pads on a bus of this computer: chips of one kind behind a mux, or straight on the bus."""
    from fmfts.sensor import SourceError
    from fmfts.sensor.i2c.scan import scanned

    try:
        found = scanned(bus)
    except SourceError as error:
        raise VerbError(exit_codes.UNAVAILABLE, f"no pad found: {error}") from error
    if not found:
        raise VerbError(
            exit_codes.UNAVAILABLE,
            f"no pad found: /dev/i2c-{bus}: no chip that this daemon knows answers, with or without a mux: check "
            "supply, SDA and SCL",
        )
    groups: dict[tuple[int, int, str], list[Found]] = {}
    for one in found:
        half = 0 if one.channel is None else one.channel // PAD_CHANNELS
        groups.setdefault((one.mux_address or 0, half, one.chip), []).append(one)
    names = ["left"] if len(groups) == 1 else [f"pad{number + 1}" for number in range(len(groups))]
    from fmfts.config.example import FoundPad
    from fmfts.sensor.chips.rates import BusLoad

    load = BusLoad.of(
        (len(members), [one.mux_address for one in members if one.mux_address is not None])
        for members in groups.values()
    )
    pads = [
        FoundPad(name, _i2c_lines(bus, members, load), len(members), "; ".join(map(str, members)))
        for name, members in zip(names, groups.values(), strict=True)
    ]
    return pads, f"the {'pad' if len(pads) == 1 else 'pads'} on /dev/i2c-{bus}"


def _i2c_lines(bus: int, members: Sequence[Found], load: BusLoad) -> list[str]:
    """The lines of [pad.source] for chips of one kind, at a rate and a range that suit them and the bus."""
    from fmfts.config import I2cSource
    from fmfts.sensor.chips import CHIPS
    from fmfts.sensor.chips.rates import i2c_rate_hz
    from fmfts.sensor.i2c.adapter import adapter_of

    chip, first = CHIPS[members[0].chip], members[0]
    lines = ['type = "i2c"', f"bus = {bus}                        # /dev/i2c-{bus}"]
    if first.mux_address is None:
        addresses = ", ".join(f"{each.address:#04x}" for each in members)
        lines += [
            "channels = []                  # no mux",
            f"addresses = [{addresses}]    # of each sensor's chip, in the order of sensors_mm",
        ]
    else:
        channels = [each.channel for each in members]
        lines += [
            f"mux_address = {first.mux_address:#x}             # of the TCA9548A, 0x70 to 0x77",
            f"channels = {channels}        # the mux's channel of each sensor, in the order of sensors_mm",
        ]
        if any(each.address != chip.address for each in members):
            lines.append(f"addresses = [{', '.join(f'{each.address:#04x}' for each in members)}]")
    adapter, usual_hz = adapter_of(bus), I2cSource(bus=bus).clock_hz
    clock_hz = min(adapter.clock_hz or usual_hz, usual_hz)
    if clock_hz != usual_hz:
        lines.append(
            f"clock_hz = {clock_hz}              # of the bus, as the device tree has it; {usual_hz} is faster"
        )
    most_hz = min(i2c_rate_hz(chip, "free", clock_hz, load), adapter.highest_rate_hz(load) or 1000)
    return [*lines, *_lines_for(chip, over_bridge=False, most_hz=max(1, most_hz))]


def _lines_for(chip: Chip, *, over_bridge: bool, most_hz: int = 1000) -> list[str]:
    """The keys that every device has, with the rate and the range that suit this chip. most_hz: what a bus carries."""
    from fmfts.config.example import shared_lines
    from fmfts.sensor.chips.rates import usual_rate_hz

    suited = {
        "rate_hz": str(min(usual_rate_hz(chip, "free", over_bridge=over_bridge), most_hz)),
        "range_gauss": f"{chip.usual_range_gauss:g}",
        "chip": f'"{chip.name}"',
    }
    return [_with_value(line, suited) for line in shared_lines()]


def _chip_of(identifications: Sequence[str]) -> Chip:
    """The most frequent kind of a board's sensors; the usual one if none identifies itself. identifications: as in
    `status`."""
    from fmfts.sensor.chips import DEFAULT_CHIP
    from fmfts.sensor.chips.recognised import kind_of

    kinds = Counter(kind for each in identifications if (kind := kind_of(bytes.fromhex(each))) is not None)
    return max(kinds, key=kinds.__getitem__, default=DEFAULT_CHIP)


def _with_value(line: str, values: Mapping[str, str]) -> str:
    """A line of the example, with another value where `values` has its key."""
    key, _, rest = line.partition(" = ")
    if key not in values:
        return line
    comment = rest[rest.index("#") :] if "#" in rest else ""
    return f"{key} = {values[key]}".ljust(31) + comment


def _asked(source: Any) -> tuple[dict[str, Any], str]:
    """The source's own facts, and why there are none, or its fault."""
    from fmfts.config import PadConfig
    from fmfts.sensor import SourceError
    from fmfts.sensor.tasks import Deadline
    from fmfts.sources import open_sources

    try:
        ((device, _),) = open_sources([PadConfig(name="found", source=source)])
    except SourceError as error:
        return {}, str(error)
    try:
        deadline = Deadline(device)
        # A board that runs already may send its counters before it says who it is.
        while not deadline.passed(time.monotonic()) and not (device.state.board.get("uid") and device.state.connected):
            device.poll(time.monotonic_ns())
            time.sleep(TURN_S)
        return device.state.board, device.state.reason or "no board answers"
    finally:
        device.close()


def _pads_of(board: dict[str, Any], port: str) -> list[FoundPad]:
    from fmfts.config.example import FoundPad

    pads: Sequence[dict[str, Any]] = board["pads"]
    names = ["left"] if len(pads) == 1 else [f"pad{number + 1}" for number in range(len(pads))]
    return [
        FoundPad(
            name,
            [
                'type = "bridge"',
                f'port = "{port}"',
                f'uid = "{board["uid"]}"     # only this board is used, on whatever port it is',
                f"pad_index = {index}                  # which of the board's pads, from 0",
                "baud = 460800                  # of the serial line, bits a second",
                *_lines_for(_chip_of(pad["identification"]), over_bridge=True),
            ],
            len(pad["identification"]),
            _places_of(pad),
            names[index - 1] if index and _share_a_mux(pads[index - 1], pad) else "",
        )
        for index, (name, pad) in enumerate(zip(names, pads, strict=True))
    ]


def _share_a_mux(one: dict[str, Any], other: dict[str, Any]) -> bool:
    return "mux_address" in one and all(one[key] == other.get(key) for key in ("i2c_port", "mux_address"))


def _places_of(pad: dict[str, Any]) -> str:
    if "addresses" in pad:
        return "at " + ", ".join(pad["addresses"])
    return f"mux {pad['mux_address']:#04x}, channels " + ", ".join(map(str, pad["channels"]))
