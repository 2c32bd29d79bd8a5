"""docs/build-a-pad.md, "Two pads on one Raspberry Pi": its file and each of its wirings pass `check-config`."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from fmfts.cli.main import main
from fmfts.config.file import load
from fmfts.config.sources import I2cSource

PAGE = (Path(__file__).parents[2] / "docs/build-a-pad.md").read_text(encoding="utf-8")
SECTION = PAGE[PAGE.index("## Two pads on one Raspberry Pi") :]
(TYPED,) = re.findall(r"^```toml\n(.*?)^```$", SECTION, re.MULTILINE | re.DOTALL)
KEY = "mux_address = 0x71"  # of the second pad, in the file that the page shows
# Its other wirings, and their frames a second
WIRINGS = re.findall(r"^\| .* \| `(\w+ = [^`]*)` \| (\d+)(?: each)? \|$", SECTION, re.MULTILINE)


def ways(source: I2cSource) -> set[tuple[int, int, int]]:
    """Bus, mux and channel of each sensor."""
    return {(source.bus, mux, channel) for mux, channel in zip(source.sensor_muxes, source.channels, strict=True)}


@pytest.mark.parametrize(("key", "rate_hz"), WIRINGS, ids=[key for key, _ in WIRINGS])
def test_two_pads_share_no_sensor_and_have_the_rate_of_the_page(
    tmp_path: Path, key: str, rate_hz: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert TYPED.count(KEY) == 1
    config = tmp_path / "pad.toml"
    config.write_text(second_bus(key) if key.startswith("bus") else TYPED.replace(KEY, key))
    assert main(["check-config", "--config", str(config)]) == 0
    said = capsys.readouterr().out
    assert said.startswith("good: 2 pads")
    assert said.count(f"{rate_hz} Hz (400 kHz)") == 2
    left, right = (pad.source for pad in load(config)[0].pad)
    assert isinstance(left, I2cSource)
    assert isinstance(right, I2cSource)
    assert len(ways(left) | ways(right)) == 8
    assert (left.chip, right.chip) == ("mmc5983ma", "mmc5983ma")


def second_bus(key: str) -> str:
    first, second = TYPED.replace(f", {KEY}", "").split("\n\n")
    return "\n\n".join((first, re.sub(r"bus = \d+", key, second)))


def test_page_has_three_wirings() -> None:
    assert [key.split()[0] for key, _ in WIRINGS] == ["channels", "mux_address", "bus"]
