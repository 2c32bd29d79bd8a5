"""The named boards in `[pad.geometry]`: a dipole over chips at their published places is found at its true place.

The boards are those of published_boards.py, not the daemon's.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from published_boards import chips
from recorded_files import needs

from fmfts.baseline.request import BaselineRequest
from fmfts.config import ContactConfig, GeometryConfig, PadConfig
from fmfts.config.layouts import BoardName
from fmfts.pipeline.configured import contact_model_of, pipeline_of
from fmfts.sensor import Frame
from fmfts.sensor.chips import ANYSKIN
from fmfts_skin.settings import AnyskinSource

REST_MM, MOMENT_T_M3 = np.array([0.0, 0.0, 12.0]), 1.23 * 1e-3**2 * 2e-3 / 4.0  # Br r² L/4 of the magnet of config.toml
AMBIENT_T = np.array([18e-6, -5e-6, -43e-6])
NOISE_T, STEP_CODE = 0.6e-6, ANYSKIN.ranges_gauss.index(65.5)  # 0.2 µT, as the library begins


def dipole_t(places_mm: np.ndarray, magnet_mm: np.ndarray, axis: np.ndarray) -> np.ndarray:
    way = (places_mm - magnet_mm) * 1e-3
    far = np.linalg.norm(way, axis=1, keepdims=True)
    field: np.ndarray = MOMENT_T_M3 * (3.0 * way * (way @ axis)[:, None] / far**5 - axis / far**3)
    return field


def frames(board: str, magnet: tuple[np.ndarray, np.ndarray] | None, first: int, count: int) -> Iterator[Frame]:
    places, axes = chips(board)
    field = np.tile(AMBIENT_T, (5, 1)) + (0.0 if magnet is None else dipole_t(places, *magnet))
    in_chip = np.einsum("nij,ni->nj", axes, field)
    random = np.random.default_rng(first)
    for number in range(first, first + count):
        counts = np.rint((in_chip + random.normal(0.0, NOISE_T, (5, 3))) / ANYSKIN.step_t[STEP_CODE]).astype(np.int16)
        yield Frame(
            *(0, number, number * 5000, number * 5_000_000, STEP_CODE, counts, np.zeros(5, np.uint16)),
            *(np.ones(5, np.bool_), np.ones(5, np.bool_), 25.0),
            chip=ANYSKIN,
        )


@pytest.mark.parametrize("board", ["reskin5", "reskin5_back", "anyskin5", "anyskin5_back"])
def test_dipole_over_a_public_layout_is_found_where_it_is(board: BoardName) -> None:
    config = PadConfig(
        name="skin",
        source=AnyskinSource(port="/dev/null", rate_hz=200),
        geometry=GeometryConfig(board=board),
        contact=ContactConfig(model="none"),
    )
    assert np.abs(np.array(config.geometry.sensors_mm) - chips(board)[0]).max() < 0.01
    pipeline, up = pipeline_of(config, contact_model_of(config), "boot"), np.array([0.0, 0.0, 1.0])
    baseline = None
    for bare, magnet, first in ((True, None, 0), (False, (REST_MM, up), 1000)):
        request = BaselineRequest(config.pad(), config.tolerance.si(), bare=bare, replaced=False, duration_s=3.0)
        baseline, _ = request.make(list(frames(board, magnet, first, 600)), baseline)
    pipeline.use(baseline)
    for number, moved_mm in enumerate(([0.8, 0.0, -0.6], [0.0, 0.7, -0.5], [-0.5, -0.9, -0.8])):
        tilted = np.array([0.1, -0.05, 1.0]) / np.linalg.norm([0.1, -0.05, 1.0])
        magnet = (REST_MM + moved_mm, tilted)
        messages = [pipeline.process(frame) for frame in frames(board, magnet, 2000 + 100 * number, 60)][-20:]
        assert {message.health for message in messages} == {"ok"}
        position = np.mean([message.pose.position_m for message in messages], axis=0) * 1e3
        axis = np.mean([message.pose.axis for message in messages], axis=0)
        assert np.linalg.norm(position - magnet[0]) < 0.05
        assert np.linalg.norm(axis - tilted) < 0.01


@pytest.mark.parametrize("number", [1, 2])
def test_anyskin_turns_come_from_a_real_moving_hand(number: int) -> None:
    """The ambient field changes alike at all chips of a pad: each chip reports it in its own axes.

    sissihrx/anyskin-leaphand: four pads on a LEAP hand that touches nothing; the first one hardly moves.
    """
    rows = np.loadtxt(needs(f"leaphand_nocontact_{number}.txt"))[12:, :60].reshape(-1, 4, 5, 3)
    change = rows - rows.mean(axis=0)
    plane = change[..., 0] + 1j * change[..., 1]
    _, rotations = layout_of("anyskin5")
    for pad in (1, 2, 3):
        turns = np.angle((plane[:, pad, :1] * plane[:, pad, 1:].conj()).sum(axis=0), deg=True)
        due = [turn - rotations[0][2] for *_, turn in rotations[1:]]
        away = (turns - due + 180.0) % 360.0 - 180.0
        assert np.abs(away).max() < 20.0  # the change is not quite even; a wrong chip is wrong by 90°


def layout_of(board: BoardName) -> tuple[tuple[tuple[float, float, float], ...], ...]:
    geometry = GeometryConfig(board=board)
    return geometry.sensors_mm, geometry.sensor_rotations_deg
