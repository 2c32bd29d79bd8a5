"""A board with AnySkin's own firmware on a pty, with a pad of ours above it: the daemon makes contacts from its
stream."""

from __future__ import annotations

import itertools
import struct
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from emulator.anyskin_board import Settings, binary, text
from emulator.anyskin_on_pty import Board
from end_to_end.processes import PATIENCE_S, RunningDaemon
from fmfts.config.file import load
from fmfts_client import Contact
from fmfts_simulation.mounted import MountedPad
from unit.recorded_files import eflesh_fields_ut

# Their stream has no numbers, so a late computer measures a wrong rate.
pytestmark = pytest.mark.real_time

CONFIG = """
[[pad]]
name = "skin"
[pad.source]
type = "anyskin"
port = "{port}"
form = "{form}"
rate_hz = {rate_hz}
[pad.geometry]
board = "anyskin5"
[pad.contact]
model = "{model}"
"""
FORCE_N = 1.0


def mounted_of(daemon: RunningDaemon) -> MountedPad:
    return MountedPad.exact(load(daemon.config)[0].pad[0].pad())


def pressed_field(mounted: MountedPad, force_n: float) -> np.ndarray:
    """As the chips report it, each in its own axes."""
    return mounted.sensed(mounted.magnet_field(*(np.full(5, value) for value in (0.0, 0.0, force_n, 0.0, 0.0))))


@pytest.mark.parametrize(("form", "sent"), [("binary", binary), ("text", text)])
def test_press_on_a_pad_above_their_board_becomes_a_touch(
    form: str, sent: Callable[..., bytes], tmp_path: Path
) -> None:
    """Five magnetometers do not fit the shipped model: pose, touch and displacement are published."""
    with Board(tmp_path, 100.0, sent) as board:
        config = CONFIG.format(port=board.link, form=form, rate_hz=100, model="none")
        with RunningDaemon(tmp_path, config) as daemon:
            mounted = mounted_of(daemon)
            board.field_t = pressed_field(mounted, 0.0)
            daemon.wait_for(lambda contact: contact.health == "no_baseline" and contact.sensors_ok == 0b11111)
            assert daemon.request("baseline", pad="skin", rest=True, timeout_s=60.0)["kind"] == "rest"
            quiet = daemon.wait_for(lambda contact: contact.health == "ok")
            assert quiet.contact is False
            assert quiet.temperature_c == pytest.approx(25.0)
            board.field_t = pressed_field(mounted, FORCE_N)
            settled_ns = time.monotonic_ns() + 300_000_000
            felt = daemon.wait_for(lambda contact: contact.t_sample_ns > settled_ns and contact.health == "ok")
            assert felt.contact
            places = [np.array([value]) for value in (0.0, 0.0, FORCE_N, 0.0, 0.0)]
            moved_m = float(np.linalg.norm(mounted.mechanics.displacement(*places)[0]))
            assert felt.displacement_m is not None
            assert abs(felt.displacement_m - moved_m) < 5 * felt.displacement_sd_m


def test_unplugging_and_garbage_are_reported_and_recovered(tmp_path: Path) -> None:
    def status(daemon: RunningDaemon) -> dict:
        return daemon.request("probe")["pads"][0]

    with Board(tmp_path, 200.0, binary) as board:
        config = CONFIG.format(port=board.link, form="binary", rate_hz=200, model="none")
        with RunningDaemon(tmp_path, config) as daemon:
            field_t = pressed_field(mounted_of(daemon), 0.0)
            board.field_t = field_t
            daemon.wait_for(lambda contact: contact.health == "no_baseline" and contact.sensors_ok == 0b11111)
            for damage in (lambda packet: bytes(500) + packet, lambda packet: packet[:31], lambda packet: packet[5:]):
                board.damage = damage
                after_ns = time.monotonic_ns() + 50_000_000
                healthy = daemon.wait_for(lambda contact, after_ns=after_ns: contact.t_sample_ns > after_ns)
                assert healthy.sensors_ok == 0b11111
            board.field_t = np.full((5, 3), np.nan)
            board.field_t[1:] = field_t[1:]
            daemon.wait_for(lambda contact: contact.sensors_ok == 0b11110)
            until = time.monotonic() + PATIENCE_S
            while "sensor 1 (of the stream) gives no measurement" not in " ".join(status(daemon)["faults"]):
                assert time.monotonic() < until, status(daemon)
            board.field_t = field_t
            daemon.wait_for(lambda contact: contact.sensors_ok == 0b11111)
            board.pull()
            gone = daemon.wait_for(lambda contact: contact.health == "disconnected")
            assert "plug the board in again" in gone.reason or "does not exist" in gone.reason
            with Board(tmp_path, 200.0, binary) as again:
                again.field_t = field_t
                daemon.wait_for(lambda contact: contact.health == "no_baseline" and contact.sensors_ok == 0b11111)


def test_stream_of_another_form_or_rate_is_named_with_what_to_set(tmp_path: Path) -> None:
    with Board(tmp_path, 50.0, text) as board:
        board.field_t = np.ones((5, 3)) * 1e-5
        config = CONFIG.format(port=board.link, form="binary", rate_hz=50, model="none")
        with RunningDaemon(tmp_path, config) as daemon:
            strange = daemon.wait_for(lambda contact: "bytes and no packet" in contact.reason)
            assert strange.health == "disconnected"
            assert "5 magnetometers, form is binary packets" in strange.reason
    (tmp_path / "other").mkdir()
    with Board(tmp_path / "other", 100.0, binary) as board:
        board.field_t = np.ones((5, 3)) * 1e-5
        config = CONFIG.format(port=board.link, form="binary", rate_hz=200, model="none")
        with RunningDaemon(tmp_path / "other", config) as daemon:
            daemon.wait_for(lambda contact: contact.sensors_ok == 0b11111)
            (pad,) = daemon.request("probe")["pads"]
            assert any("packets a second: set rate_hz = " in sentence for sentence in pad["faults"])


def strong_fields_ut() -> np.ndarray:
    """(K, 5, 3): four N52 magnets near a board, as eFlesh's recordings have them: up to 13.1 mT, stronger than 5.3."""
    phase = np.linspace(0.0, 2.0 * np.pi, 400)[:, None, None]
    still = np.array(
        [[600, 150, 9440], [1530, -360, 13000], [-270, 1020, 10990], [770, 210, 9910], [-140, 2000, 11830]]
    )
    return still + np.sin(phase) * np.array([300.0, 200.0, 100.0])


@pytest.mark.parametrize("name", ["", "eflesh_normal_1.csv", "eflesh_spatial_1.csv", "eflesh_shear_1.csv"])
def test_strong_fields_of_an_eflesh_pad_use_all_its_sensors(name: str, tmp_path: Path) -> None:
    """The rows of a recording go to a running daemon as its board would send them; "": fields made for this test."""

    def recorded(fields_ut: np.ndarray) -> bytes:
        floats = [number for field in fields_ut for number in (25.0, *field)]
        return struct.pack(f"<{len(floats)}f", *floats) + b"\r\n"

    if name:
        packets = [recorded(fields_ut) for fields_ut in eflesh_fields_ut(name)[::8]]
    else:
        packets = [binary(fields.tolist(), settings=Settings(gain_sel=1, res=2)) for fields in strong_fields_ut()]
    endless = itertools.cycle(packets)
    with Board(tmp_path, 200.0, binary) as board:
        board.line = lambda _: next(endless)
        config = CONFIG.format(port=board.link, form="binary", rate_hz=200, model="none")
        with RunningDaemon(tmp_path, config) as daemon:
            daemon.wait_for(lambda contact: contact.health == "no_baseline" and contact.sensors_ok == 0b11111)
            begun, used = board.sent, list[int]()
            with daemon.subscribe("contact") as told:
                while board.sent < begun + len(packets) or len(used) < len(packets):
                    message = told.receive(PATIENCE_S)
                    assert message is not None
                    contact = Contact.from_message(message.body)
                    if contact.health != "stale":  # as on a busy computer
                        used.append(contact.sensors_ok)
            assert set(used) == {0b11111}
            (pad,) = daemon.request("probe")["pads"]
            assert pad["faults"] == []
