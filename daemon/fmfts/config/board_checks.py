"""Errors in the configuration of pads on a board: more sensors than its firmware reads."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from fmfts.config import BridgeSource, PadConfig
from fmfts.config.section import Problem
from fmfts.sensor.chips import CHIPS
from fmfts.sensor.chips.rates import single_on_board_hz
from fmfts.sensor.wire.packets import ALL_BOARD_SENSORS, BOARD_SENSORS, FOUND_SENSORS


def of_pad(sensors: int) -> Iterator[Problem]:
    """A pad with this many sensors."""
    if sensors > BOARD_SENSORS:
        yield (
            ("geometry", "sensors_mm"),
            f'a board makes pads of at most {BOARD_SENSORS} sensors: type = "i2c" reads more on a bus of this computer',
        )


def of_boards(pads: Sequence[PadConfig]) -> Iterator[Problem]:
    """The total load of the pads of one board, including unconfigured pads before them."""
    on: dict[str, dict[int, int]] = {}  # board → sensors of each pad by its index
    for number, pad in enumerate(pads):
        source = pad.source
        if not isinstance(source, BridgeSource):
            continue
        there = on.setdefault(source.uid.lower() if source.uid else source.port, {})
        there[source.pad_index] = len(pad.geometry.sensors_mm)
        sensors = sum(there.get(index, FOUND_SENSORS) for index in range(max(there) + 1))
        if sensors > ALL_BOARD_SENSORS:
            told = ", ".join(str(there.get(index, FOUND_SENSORS)) for index in range(max(there) + 1))
            yield (
                ("pad", number, "source", "pad_index"),
                f"with it, the pads of its board have {told} sensors by their pad_index (one that is not configured "
                f"has {FOUND_SENSORS}): at most {ALL_BOARD_SENSORS} on a board",
            )
        most_hz = single_on_board_hz(CHIPS[source.chip], sensors)
        if source.trigger == "simultaneous" and source.rate_hz > most_hz:
            yield (
                ("pad", number, "source", "rate_hz"),
                f'at most {most_hz} with trigger = "simultaneous" and {sensors} sensors on the board',
            )
