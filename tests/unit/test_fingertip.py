"""The printable fingertip: it holds the standard pad, its boards and its cable, and fits the hands' screws."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from fmfts.config.example import EXAMPLE_PATH
from fmfts.config.file import load
from fmfts_lab.finite_elements.slab import Slab
from unit.test_mould import _turned, read, volume_mm3

HARDWARE = Path(__file__).parents[2] / "hardware"
HANDS = ("leap", "allegro")
# By docs/build-a-pad.md: the plate's top above the chips, the silicone, and breakouts side by side.
PLATE_ABOVE_CHIPS_MM, SILICONE_MM, BOARDS_MM, BOARD_MM, CHIP_MM, CABLE_MM = 10.0, (4.0, 40.0, 40.0), 50.8, 1.6, 1.0, 6.0
RIM_MM = 3.0  # width of the held silicone; the slab of the contact model's finite elements has the same
CHIPS_APART_MM, FROM_STEEL_MM = 25.4, 30.0
PLA_KG_PER_MM3 = 1.24e-6
# LEAP's last motor, where its own fingertip leaves 14 mm free, and the fork that DIGIT has for Allegro.
LEAP_HORNS_MM, LEAP_CIRCLE_MM, LEAP_FREE_MM, LEAP_WIDTH_MM = 29.0, 6.0, 14.0, 20.0
ALLEGRO_FREE_MM, ALLEGRO_PITCH_MM, ALLEGRO_ROWS_MM = 15.0, 6.0, 10.0
pytestmark = [pytest.mark.needs("openscad"), pytest.mark.long]


def printed(name: str, file: Path | None = None) -> np.ndarray:
    """(K, 3, 3) corners of a binary STL, which MuJoCo reads: 84 bytes, then 50 for each triangle, the normal first."""
    triangle = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("unused", "<u2")])
    data = (file or HARDWARE / f"fingertip-{name}.stl").read_bytes()
    return np.frombuffer(data, triangle, offset=84)["corners"].astype(float)


def pad_origin_mm(hand: str) -> np.ndarray:
    """The pad's place in the URDF: the middle of the chips' faces."""
    robot = ElementTree.parse(HARDWARE / f"fingertip-{hand}.urdf").getroot()
    origin = robot.find("joint[@name='tip_pad']/origin")
    assert origin is not None
    assert origin.get("rpy") == "0 1.5707963 0", "the pad's z is the finger's x"
    return 1e3 * np.array([float(number) for number in origin.get("xyz", "").split()])


def box(low: tuple[float, ...], high: tuple[float, ...]) -> str:
    size = [float(top - bottom) for bottom, top in zip(low, high, strict=True)]
    return f"translate({list(map(float, low))}) cube({size});"


def contents(hand: str, larger_mm: float = 0.0, reach_mm: float = 0.0) -> str:
    """Silicone, boards with all that stands on them, and a cable from them to the finger's back.

    larger_mm: on each side of the boards and of the cable. reach_mm: how far the silicone sinks into the plate.
    """
    z_mm = pad_origin_mm(hand)[2]
    top, half = PLATE_ABOVE_CHIPS_MM - reach_mm, SILICONE_MM[1] / 2
    board, way = BOARDS_MM / 2 + larger_mm, CABLE_MM / 2 + larger_mm
    below, parts = -CHIP_MM - BOARD_MM, BOARDS_MM / 2 - 4.5  # the lid's posts are in the corners
    back, leaves = below - CABLE_MM / 2 - 0.3, z_mm - BOARDS_MM / 2 - CABLE_MM
    return "".join(
        (
            box((top, -half, z_mm - half), (top + SILICONE_MM[0], half, z_mm + half)),
            box((below, -board, z_mm - board), (-CHIP_MM - 0.01, board, z_mm + board)),
            box((-CHIP_MM - 0.01, -parts, z_mm - parts), (5.0, parts, z_mm + parts)),  # room for chips and plugs above
            f"hull() {{ for (z = [{leaves}, {z_mm}]) translate([{back}, 0, z]) sphere({way}, $fn=32); }}",
            f"hull() {{ for (x = [{back}, -30]) translate([x, 0, {leaves}]) sphere({way}, $fn=32); }}",
        )
    )


def cut_mm3(folder: Path, body: Path, other: str) -> float:
    """The volume that a body of a file shares with others."""
    source, output = folder / "cut.scad", folder / "cut.stl"
    source.write_text(f'intersection() {{ import("{body}"); union() {{ {other} }} }}')
    output.unlink(missing_ok=True)
    ended = subprocess.run(["openscad", "-o", output, source], capture_output=True, text=True, check=False)
    if "Current top level object is empty" in ended.stderr:
        return 0.0
    assert ended.returncode == 0, ended.stderr
    return volume_mm3(read(output.read_text()))


def moments(corners: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Volume, its first (3,) and its second (3, 3) moments, by tetrahedra from the origin to triangles (K, 3, 3)."""
    six = np.linalg.det(corners)
    summed = corners.sum(axis=1)
    second = np.einsum("k,kij,kil->jl", six, corners, corners) + np.einsum("k,kj,kl->jl", six, summed, summed)
    return six.sum() / 6, six @ summed / 24, second / 120


@pytest.mark.parametrize("name", [*HANDS, "lid"])
def test_printed_file_is_what_the_source_makes(name: str, tmp_path: Path) -> None:
    setting = 'part="lid"' if name == "lid" else f'hand="{name}"'
    made = tmp_path / "made.stl"
    command = ["openscad", "-q", "--export-format", "binstl", "-o", made, "-D", setting, HARDWARE / "fingertip.scad"]
    subprocess.run(command, check=True)
    kept = printed(name)
    assert _turned(kept) == _turned(printed(name, made)), "run `make fingertip`, and copy what it made to hardware/"
    assert volume_mm3(kept) > 0


@pytest.mark.parametrize("hand", HANDS)
def test_fingertip_holds_pad_rim_boards_and_cable_and_no_more(hand: str, tmp_path: Path) -> None:
    body = HARDWARE / f"fingertip-{hand}.stl"
    assert cut_mm3(tmp_path, body, contents(hand, larger_mm=0.25)) == pytest.approx(0.0, abs=1e-6)  # faces touch
    assert cut_mm3(tmp_path, body, contents(hand, larger_mm=1.0)) > 100.0, "boards and cable lie close"
    sunk_mm3 = cut_mm3(tmp_path, body, contents(hand, reach_mm=0.1))
    rim_mm2 = SILICONE_MM[1] ** 2 - (SILICONE_MM[1] - 2 * RIM_MM) ** 2
    assert sunk_mm3 == pytest.approx(0.1 * rim_mm2, rel=0.01), "the pad lies on its rim, and is free within it"


def test_build_guide_holds_the_rim_that_the_contact_model_holds() -> None:
    """A slab that is glued all over hardly moves its magnet: 0.005 mm for a newton in place of 1.1 mm."""
    slab = Slab()
    assert slab.rim_m == pytest.approx(1e-3 * RIM_MM)
    window = f"{1e3 * (slab.width_m - 2 * slab.rim_m):.0f}"
    assert f"window of {window} × {window} mm" in " ".join(
        (HARDWARE.parent / "docs/build-a-pad.md").read_text().split()
    )


def test_lid_presses_the_boards_against_their_ledge(tmp_path: Path) -> None:
    """As it is printed its plate lies on z = 0; its posts end where the boards' lower faces are."""
    kept = printed("lid").reshape(-1, 3)
    z_mm = pad_origin_mm("leap")[2]
    in_finger = f"translate([{-CHIP_MM - BOARD_MM - kept[:, 2].max()}, 0, {z_mm}]) rotate([0, 90, 0])"
    lid = f'{in_finger} import("{HARDWARE / "fingertip-lid.stl"}");'
    assert cut_mm3(tmp_path, HARDWARE / "fingertip-leap.stl", lid) == 0.0
    board, edge = BOARDS_MM / 2, BOARDS_MM / 2 - 0.8
    resting = "difference() {" + box((-1.0, -board, z_mm - board), (-0.9, board, z_mm + board))
    resting += box((-2.0, -edge, z_mm - edge), (0.0, edge, z_mm + edge)) + "}"
    rim_mm2 = (BOARDS_MM**2 - (2 * edge) ** 2) * 0.1
    assert cut_mm3(tmp_path, HARDWARE / "fingertip-leap.stl", resting) == pytest.approx(rim_mm2, rel=0.01)


@pytest.mark.parametrize("hand", HANDS)
def test_descriptions_have_the_inertia_of_what_is_printed(hand: str) -> None:
    lid = printed("lid")  # as printed: its plate lies on z = 0, and z points toward the pad
    lid = lid @ np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
    lid += pad_origin_mm(hand) - (CHIP_MM + BOARD_MM + lid[..., 0].max(), 0.0, 0.0)
    volume, first, second = (one + other for one, other in zip(moments(printed(hand)), moments(lid), strict=True))
    centre_mm = first / volume
    spread = (second - volume * np.outer(centre_mm, centre_mm)) * PLA_KG_PER_MM3 * 1e-6
    urdf = ElementTree.parse(HARDWARE / f"fingertip-{hand}.urdf").find("link[@name='fingertip']/inertial")
    mjcf = ElementTree.parse(HARDWARE / f"fingertip-{hand}.xml").find("worldbody/body/inertial")
    assert urdf is not None
    assert mjcf is not None
    parts = {key: value for part in urdf for key, value in part.attrib.items()}
    inertia = [parts[key] for key in ("ixx", "iyy", "izz")]
    assert (mjcf.get("mass"), mjcf.get("pos")) == (parts["value"], parts["xyz"])
    assert str(mjcf.get("diaginertia")).split() == inertia
    assert float(parts["value"]) == pytest.approx(volume * PLA_KG_PER_MM3, rel=0.02)
    np.testing.assert_allclose([float(each) * 1e3 for each in parts["xyz"].split()], centre_mm, atol=0.1)
    np.testing.assert_allclose([float(each) for each in inertia], np.trace(spread) - np.diag(spread), rtol=0.04)


def test_leap_motor_fits_and_its_screws_go_through(tmp_path: Path) -> None:
    motor = box(
        (-LEAP_WIDTH_MM / 2, -LEAP_HORNS_MM / 2 + 0.01, -25.0),
        (LEAP_WIDTH_MM / 2, LEAP_HORNS_MM / 2 - 0.01, LEAP_FREE_MM),
    )
    circle = LEAP_CIRCLE_MM
    screws = "".join(
        f"translate([{x}, 0, {z}]) rotate([90, 0, 0]) cylinder(d=2, h=40, center=true, $fn=16);"
        for x, z in ((circle, 0), (-circle, 0), (0, circle), (0, -circle))
    )
    body = HARDWARE / "fingertip-leap.stl"
    assert cut_mm3(tmp_path, body, motor + screws) == 0.0
    assert cut_mm3(tmp_path, body, screws.replace("d=2,", "d=3,")) > 10.0
    assert pad_origin_mm("leap")[2] - CHIPS_APART_MM / 2 - LEAP_FREE_MM >= FROM_STEEL_MM


def test_allegros_screws_meet_holes_into_which_they_cut_a_thread(tmp_path: Path) -> None:
    corners = printed("allegro").reshape(-1, 3)
    assert corners[:, 2].min() == pytest.approx(ALLEGRO_FREE_MM)
    middle_mm = (corners[:, 0].min() + PLATE_ABOVE_CHIPS_MM) / 2
    places = [
        (middle_mm + row * ALLEGRO_ROWS_MM / 2, column * ALLEGRO_PITCH_MM) for row in (-1, 1) for column in (-1, 0, 1)
    ]

    def screws(diameter_mm: float, length_mm: float) -> str:
        return "".join(
            f"translate([{x}, {y}, {ALLEGRO_FREE_MM}]) cylinder(d={diameter_mm}, h={length_mm}, $fn=16);"
            for x, y in places
        )

    body = HARDWARE / "fingertip-allegro.stl"
    assert cut_mm3(tmp_path, body, screws(1.6, 4.9)) == 0.0
    thread_mm3 = cut_mm3(tmp_path, body, screws(2.0, 4.9)) / len(places)
    assert thread_mm3 == pytest.approx(np.pi / 4 * (2.0**2 - 1.7**2) * 4.9, rel=0.1)
    assert pad_origin_mm("allegro")[2] - CHIPS_APART_MM / 2 - ALLEGRO_FREE_MM >= FROM_STEEL_MM


def test_pad_is_the_shipped_configurations() -> None:
    """Its magnet lies in the middle of the silicone that the fingertip holds."""
    pad = load(EXAMPLE_PATH)[0].pad[0]
    assert pad.magnet.rest_mm[2] == pytest.approx(PLATE_ABOVE_CHIPS_MM + SILICONE_MM[0] / 2)


def test_part_of_another_hand_is_refused() -> None:
    command = [
        "openscad",
        "-o",
        "/dev/null",
        "--export-format",
        "stl",
        "-D",
        'hand="shadow"',
        HARDWARE / "fingertip.scad",
    ]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ended.returncode != 0
    assert re.search("leap.*allegro", ended.stderr)
