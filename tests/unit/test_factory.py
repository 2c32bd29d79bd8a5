"""Pads grouped into devices."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from fmfts.config import BridgeSource, I2cSource, PadConfig, PlacementConfig, SceneConfig, SimulatedSource
from fmfts.sensor import SourceError
from fmfts.sources import open_sources


def bridge(name: str, port: str = "/dev/a", **options: object) -> PadConfig:
    return PadConfig(name=name, source=BridgeSource(port=port, **options))  # type: ignore[arg-type]


def i2c(name: str, bus: int, mux_address: int = 0x70, **options: object) -> PadConfig:
    return PadConfig(name=name, source=I2cSource(bus=bus, mux_address=mux_address, **options))  # type: ignore[arg-type]


def test_pads_of_one_device_share_one_source() -> None:
    pads = [
        bridge("a0"),
        i2c("x", bus=1),
        PadConfig(name="s", source=SimulatedSource()),
        bridge("a2", pad_index=2),
        bridge("b", "/dev/b"),
        i2c("y", bus=1, mux_address=0x71),
        i2c("z", bus=2),
        PadConfig(name="t", source=SimulatedSource()),
    ]
    sources = open_sources(pads)
    assert [names for _, names in sources] == [
        {0: "a0", 2: "a2"},
        {0: "x", 1: "y"},
        {0: "s"},
        {0: "b"},
        {0: "z"},
        {0: "t"},
    ]
    assert [type(source).__name__ for source, _ in sources] == [
        "Bridge",
        "I2c",
        "Simulated",
        "Bridge",
        "I2c",
        "Simulated",
    ]
    assert not any(source.state.connected for source, _ in sources)
    for source, _ in sources:
        source.close()


@pytest.mark.parametrize(
    ("pads", "words"),
    [
        ([bridge("a"), bridge("b", pad_index=1, rate_hz=100)], "pads 'a' and 'b' share a device but differ in rate_hz"),
        ([bridge("a"), bridge("b", pad_index=1, uid="00" * 12)], "pads 'a' and 'b' share a device but differ in uid"),
        ([bridge("a"), bridge("b")], "pads 'a' and 'b' are both pad_index = 0"),
        ([bridge("a", uid="0a" * 12), bridge("b", "/dev/b", uid="0A" * 12)], "pads 'a' and 'b' are bound to one board"),
        (
            [i2c("a", 1), i2c("b", 1, 0x71, range_gauss=4.0)],
            "pads 'a' and 'b' share a device but differ in range_gauss",
        ),
    ],
)
def test_pads_that_cannot_share_are_named(pads: list[PadConfig], words: str) -> None:
    with pytest.raises(SourceError) as refusal:
        open_sources(pads)
    assert words in str(refusal.value)


def test_drivers_are_imported_only_where_a_pad_needs_them() -> None:
    code = (
        "import sys; import fmfts.sensor; from fmfts.sources import open_sources; "
        "from fmfts.config import *; open_sources([PadConfig(name='s', source=SimulatedSource())]); "
        "print(sorted({'serial', 'smbus2'} & set(sys.modules)))"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"


def test_simulated_pad_measures_neighbours_that_its_scene_names() -> None:
    """Also where it is opened alone, for a baseline."""
    scene, beside = SceneConfig(neighbours=("b",)), PlacementConfig(position_mm=(30.0, 0.0, 0.0))
    first = PadConfig(name="a", source=SimulatedSource(), scene=scene)
    pads = [first, PadConfig(name="b", source=SimulatedSource(seed=2), placement=beside)]
    fields = []
    for opened in (open_sources(pads), open_sources([first], pads), open_sources([first])):
        (frame,) = opened[0][0].poll(0)
        fields.append(frame.field_t)
    np.testing.assert_array_equal(fields[0], fields[1])
    # 30 mm away and at rest, 23 µT across the axis: less and more at the sensors 22 and 38 mm away.
    assert 5e-6 < np.abs(fields[0] - fields[2]).max() < 60e-6
