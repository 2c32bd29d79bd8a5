"""The printable mould, made by OpenSCAD from its source: closed bodies of the size that the standard pad has."""

from __future__ import annotations

import re
import subprocess
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from fmfts.config.example import EXAMPLE_PATH
from fmfts.config.file import load

MOULD = Path(__file__).parents[2] / "hardware" / "mould.scad"
PAD_MM, WALL_MM, DRAFT_MM = (40.0, 40.0, 4.0), 3.0, 0.3
CLEARANCE_MM, BAR_MM = 0.15, 3.0
pytestmark = pytest.mark.needs("openscad")


def made(folder: Path, *settings: str) -> subprocess.CompletedProcess[str]:
    options = [word for setting in settings for word in ("-D", setting)]
    command = ["openscad", "-q", "-o", str(folder / "part.stl"), *options, str(MOULD)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def triangles(folder: Path, part: str) -> np.ndarray:
    """(K, 3, 3) corners in millimetres, each triangle's in the order that makes it point outward."""
    ended = made(folder, f'part="{part}"')
    assert ended.returncode == 0, ended.stderr
    return read((folder / "part.stl").read_text())


def read(stl: str) -> np.ndarray:
    numbers = re.findall(r"vertex (\S+) (\S+) (\S+)", stl)
    return np.array(numbers, float).reshape(-1, 3, 3)


def volume_mm3(body: np.ndarray) -> float:
    """The volume of a closed body; negative if it is inside out."""
    return float(np.einsum("ki,ki->", body[:, 0], np.cross(body[:, 1], body[:, 2])) / 6.0)


@pytest.mark.parametrize("part", ["tray", "lid"])
def test_file_that_is_printed_is_what_the_source_makes(part: str, tmp_path: Path) -> None:
    """The same triangles in any order, each beginning anywhere: what versions of OpenSCAD may differ in."""
    kept = (MOULD.parent / f"mould-{part}.stl").read_text()
    made_now = triangles(tmp_path, part)
    assert _turned(read(kept)) == _turned(made_now), "run `make mould`, and copy build/mould-*.stl to hardware/"


def _turned(body: np.ndarray) -> list[list[tuple[float, ...]]]:
    corners = [[tuple(corner) for corner in one] for one in (body.round(3) + 0.0).tolist()]
    return sorted(min(one[i:] + one[:i] for i in range(3)) for one in corners)


@pytest.mark.parametrize("part", ["tray", "lid"])
def test_each_part_is_a_closed_body_that_a_slicer_takes(part: str, tmp_path: Path) -> None:
    body = triangles(tmp_path, part)
    corners = [[tuple(corner) for corner in one] for one in body.round(6).tolist()]
    edges = Counter((one[i], one[(i + 1) % 3]) for one in corners for i in range(3))
    assert set(edges.values()) == {1}
    assert all((end, start) in edges for start, end in edges)  # each edge belongs to two triangles, once either way
    assert volume_mm3(body) > 0


def test_tray_holds_the_pad_of_the_shipped_configuration(tmp_path: Path) -> None:
    body = triangles(tmp_path, "tray")
    size = np.ptp(body.reshape(-1, 3), axis=0)
    assert size == pytest.approx([PAD_MM[0] + 2 * WALL_MM, PAD_MM[1] + 2 * WALL_MM, PAD_MM[2] + WALL_MM], abs=1e-4)
    hollow = np.prod(size) - volume_mm3(body)
    # A frustum: wider by the draft at the rim. The notch removes 1.74 × 4 × 1 mm of the wall.
    floor, rim = PAD_MM[0] * PAD_MM[1], (PAD_MM[0] + 2 * DRAFT_MM) * (PAD_MM[1] + 2 * DRAFT_MM)
    frustum = PAD_MM[2] / 3.0 * (floor + rim + np.sqrt(floor * rim))
    assert hollow == pytest.approx(frustum + 6.96, abs=2.0)  # floor and rim are 0.01 mm thick in the source


def lid_on_its_tray(folder: Path) -> np.ndarray:
    """(K, 3) corners of the lid, which is printed lying on its back."""
    printed = triangles(folder, "lid").reshape(-1, 3)
    assert printed[:, 2].min() == pytest.approx(0.0, abs=1e-6)
    return printed * [1.0, -1.0, -1.0] + [0.0, 0.0, PAD_MM[2] + BAR_MM]


def test_lid_is_printed_without_supports(tmp_path: Path) -> None:
    """Each of its faces that looks down lies on the printer's bed."""
    body = triangles(tmp_path, "lid")
    normals = np.cross(body[:, 1] - body[:, 0], body[:, 2] - body[:, 0])
    down = normals[:, 2] < -1e-3 * np.linalg.norm(normals, axis=1)
    assert np.abs(body[down][:, :, 2]).max() < 1e-6


def test_pin_of_the_lid_keeps_the_magnets_place_free(tmp_path: Path) -> None:
    """In the middle, as wide and as deep as the magnet of the configuration, with room to put it in."""
    pad = load(EXAMPLE_PATH)[0].pad[0]
    corners = lid_on_its_tray(tmp_path)
    pin = corners[(np.hypot(corners[:, 0], corners[:, 1]) < 3.0) & (corners[:, 2] < PAD_MM[2])]
    diameter_mm, length_mm = pad.magnet.diameter_mm, pad.magnet.length_mm
    assert np.hypot(pin[:, 0], pin[:, 1]).max() == pytest.approx(diameter_mm / 2 + CLEARANCE_MM, abs=1e-3)
    assert pin[:, 2].min() == pytest.approx(PAD_MM[2] / 2 - length_mm / 2, abs=1e-4)  # the magnet's centre is the pad's


def test_lid_cannot_slide_on_the_tray(tmp_path: Path) -> None:
    """Its tabs hang outside the tray's four walls, nearer to them than the room that pin and magnet have."""
    corners = lid_on_its_tray(tmp_path)
    tabs = corners[(np.hypot(corners[:, 0], corners[:, 1]) > 5.0) & (corners[:, 2] < PAD_MM[2] - 1e-6)]
    for axis in (0, 1):
        outside_mm = PAD_MM[axis] / 2 + WALL_MM
        for side in (-1, 1):
            beyond = side * tabs[:, axis] - outside_mm
            assert beyond[beyond > 0].min() == pytest.approx(CLEARANCE_MM, abs=1e-4)


@pytest.mark.parametrize("height_mm", [1.2, 2.9])
def test_magnet_that_would_lie_bare_is_refused_with_the_reason(height_mm: float, tmp_path: Path) -> None:
    ended = made(tmp_path, f"magnet_height={height_mm}")
    assert ended.returncode != 0
    assert "the magnet would touch the pad's" in ended.stderr
