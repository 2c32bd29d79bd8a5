"""A pad that feels another one's magnet and is not told of it: `check-config` and `run` say so."""

from __future__ import annotations

from pathlib import Path

import pytest

from fmfts.cli.main import main
from fmfts.config import PadConfig, PlacementConfig, SceneConfig, SimulatedSource
from fmfts.config.neighbour_checks import unnamed_neighbours

SCENE = Path(__file__).parents[2] / "docs/scenes/neighbour.toml"


def pads(apart_mm: float, *names: str) -> list[PadConfig]:
    """The first pad names these neighbours."""
    source, scene = SimulatedSource(), SceneConfig(neighbours=names)
    placement = PlacementConfig(position_mm=(apart_mm, 0.0, 0.0))
    return [
        PadConfig(name="one", source=source, scene=scene),
        PadConfig(name="two", source=source, placement=placement),
    ]


# At 0 mm they share no frame: nobody said where they are.
@pytest.mark.parametrize(("apart_mm", "warnings"), [(0.0, 0), (20.0, 1), (99.0, 1), (101.0, 0)])
def test_near_pad_without_a_name_is_warned_of(apart_mm: float, warnings: int) -> None:
    for pad in pads(apart_mm):
        assert len(unnamed_neighbours(pad, pads(apart_mm))) == warnings


def test_named_pad_is_not_warned_of() -> None:
    one, two = pads(20.0, "two")
    assert unnamed_neighbours(one, [one, two]) == []
    assert "pad 'one' is 20 mm away" in unnamed_neighbours(two, [one, two])[0]


def test_check_config_warns_of_neighbours_that_are_not_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = SCENE.read_text().splitlines()
    file = tmp_path / "config.toml"
    for is_kept, warnings in ((True, 0), (False, 2)):
        file.write_text("\n".join(line for line in lines if is_kept or not line.startswith("neighbours")))
        assert main(["check-config", "--config", str(file)]) == 0
        assert capsys.readouterr().err.count("add it to scene.neighbours") == warnings
