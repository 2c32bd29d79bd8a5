"""From `init --learn` to contacts with an unmeasured board: the firmware's host build, pressed by a finger."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

from end_to_end.processes import FirmwareHost, RunningDaemon
from fmfts.config import PadConfig, SimulatedSource
from fmfts.config.file import load
from fmfts.pad import SensorArray, rotation_from_vector
from fmfts_client import Client, Contact
from fmfts_lab.bench.recorded import pressed_field
from fmfts_simulation.mounted import MountedPad

EARTH_T = np.array([2e-5, 0.0, 4e-5])
PLACE_M, ROTATION_RAD = 2e-3, np.radians(10.0)
REACH_M, WEAKEST_N, STRONGEST_N = 9e-3, 0.3, 1.8
MOVE_S, HOLD_S, ALONE_S = 0.08, 0.25, 1.0
PLACE_PRESSED_M, FORCE_N = (4e-3, -3e-3), 1.0
PATIENCE_S, STANDS_S = 60.0, 0.5


def unmeasured() -> MountedPad:
    """Chips up to 2 mm and 10° from their places in a sketch, and a magnet where the mould puts it."""
    random = np.random.default_rng(5)
    exact = MountedPad.exact(PadConfig(name="standard", source=SimulatedSource()).pad())
    sensors = exact.pad.sensors
    vectors = random.uniform(-ROTATION_RAD, ROTATION_RAD, (4, 3))
    turned = SensorArray(
        sensors.position_m + random.uniform(-PLACE_M, PLACE_M, (4, 3)),
        sensors.axes @ np.array([rotation_from_vector(one) for one in vectors]),
    )
    return replace(exact, pad=replace(exact.pad, sensors=turned), ambient_t=EARTH_T)


@contextmanager
def pressed(board: FirmwareHost, built: MountedPad) -> Iterator[None]:
    """A finger presses one place after another, from ALONE_S on."""
    ended = threading.Event()

    def press() -> None:
        random = np.random.default_rng(1)
        ended.wait(ALONE_S)
        while not ended.is_set():
            x_m, y_m = random.uniform(-REACH_M, REACH_M, 2)
            force_n = random.uniform(WEAKEST_N, STRONGEST_N)
            for newtons in (force_n, 0.0):
                board.glide(pressed_field(built, x_m, y_m, newtons), MOVE_S)
                ended.wait(MOVE_S + HOLD_S)

    finger = threading.Thread(target=press)
    finger.start()
    try:
        yield
    finally:
        ended.set()
        finger.join()
        board.field(pressed_field(built, 0.0, 0.0, 0.0))


def said(folder: Path, *words: str | Path, code: int = 0) -> str:
    environment = os.environ | {"FMFTS_BUS": f"ipc://{folder}", "XDG_STATE_HOME": str(folder / "state")}
    ended = subprocess.run(
        [sys.executable, "-m", "fmfts", *words],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        timeout=240,
        check=False,
    )
    assert ended.returncode == code, ended
    assert "Traceback" not in ended.stderr
    return ended.stdout if code == 0 else ended.stderr


def test_board_with_learned_geometry_reports_presses(tmp_path: Path) -> None:
    built = unmeasured()
    with FirmwareHost(tmp_path) as board:
        told = said(tmp_path, "init", "--learn", "--port", board.port)
        assert "next: sketch your board in [pad.geometry] to 2 mm and 10°" in told
        config = load(tmp_path / "pad.toml")[0].pad[0]
        assert (config.tolerance.sensor_position_mm, config.tolerance.sensor_rotation_deg) == (1.2, 6.0)
        missing = said(tmp_path, "baseline", "--learn", "--config", "pad.toml", code=65)
        assert "rest is not recorded: `fmfts-daemon baseline --rest` while nothing touches the pad" in missing

        board.field(pressed_field(built, 0.0, 0.0, 0.0))
        said(tmp_path, "baseline", "--rest", "--config", "pad.toml")
        unknown_zeros = said(tmp_path, "baseline", "--learn", "--config", "pad.toml", code=65)
        assert "bare is not recorded, and with a rough drawing the chips' zeros look like" in unknown_zeros

        board.field(built.sensed(np.tile(EARTH_T, (4, 1))))
        said(tmp_path, "baseline", "--bare", "--config", "pad.toml")
        board.field(pressed_field(built, 0.0, 0.0, 0.0))
        told = said(tmp_path, "baseline", "--rest", "--config", "pad.toml")
        assert "first `fmfts-daemon baseline --learn --config pad.toml`" in told
        few = said(tmp_path, "baseline", "--learn", "--duration-s", "1", "--config", "pad.toml", code=65)
        assert "different presses were found, of at least 30: press some 60 times" in few
        with pressed(board, built):
            facts = json.loads(said(tmp_path, "baseline", "--learn", "--json", "--config", "pad.toml"))

        places = np.array(facts["sensor_places_m"]).reshape(4, 3)
        off = (places - built.pad.sensors.position_m) / np.array(facts["sensor_places_sd_m"]).reshape(4, 3)
        assert np.abs(off).max() < 4.0
        assert facts["starts_that_agree"] == "6 of 6"
        assert facts["presses"] >= 40
        assert facts["sensor_places_against_each_other_sd_m"] < 2e-4
        assert facts["press_next"].startswith("press next at about (")

        with RunningDaemon(tmp_path, (tmp_path / "pad.toml").read_text()) as daemon:
            refused = said(tmp_path, "baseline", "--learn", "--config", "pad.toml", code=69)
            assert "a daemon runs, and --learn computes for a minute: stop it" in refused
            board.glide(pressed_field(built, *PLACE_PRESSED_M, FORCE_N), MOVE_S)
            contact = settled(daemon)
    assert contact.contact is True
    assert contact.x_m is not None
    assert contact.y_m is not None
    assert contact.force_n is not None
    off = np.array([contact.x_m, contact.y_m, contact.force_n]) - [*PLACE_PRESSED_M, FORCE_N]
    deviations = np.array([contact.x_sd_m, contact.y_sd_m, contact.force_sd_n], dtype=float)
    assert np.abs(off / deviations).max() < 3.0
    assert np.hypot(*off[:2]) < 1e-3
    assert abs(off[2]) < 0.1


def settled(daemon: RunningDaemon) -> Contact:
    """A contact of a finger that has rested for a while."""
    with Client("left", daemon.base) as client:
        until_s, touched_ns = time.monotonic() + PATIENCE_S, 0
        while time.monotonic() < until_s:
            contact = client.latest(1.0)
            if contact is not None and contact.contact:
                touched_ns = touched_ns or contact.t_sample_ns
                if contact.t_sample_ns > touched_ns + STANDS_S * 1e9:
                    return contact
    raise AssertionError("no contact")
