"""A pad whose frames another program sends: accepted frames, dropped ones, and the reports while none comes."""

from __future__ import annotations

import os
import socket
import stat
from dataclasses import replace
from pathlib import Path

import pytest

from fmfts.bus.encoding import encode
from fmfts.bus.frame_message import frame_message
from fmfts.config import PadConfig, SimulatedSource
from fmfts.config.file import load
from fmfts.sensor import Frame, SourceError
from fmfts.sources import open_sources
from fmfts_simulation.array import simulated_pad
from fmfts_simulation.fed import SILENT_NS, Fed

FRAMES: list[Frame] = []


def fed(folder: Path) -> tuple[Fed, Path]:
    path = folder / "left.sock"
    return Fed(PadConfig(name="left", source=SimulatedSource(frames_from=str(path)))), path


def frame() -> Frame:
    if not FRAMES:
        FRAMES.extend(simulated_pad(PadConfig(name="left", source=SimulatedSource())).poll(1_000_000_000))
    return FRAMES[0]


def send(path: Path, payload: bytes) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
        sender.sendto(payload, str(path))


def message(pad: str = "left", boot: str = "a", sequence: int = 0) -> bytes:
    return encode(frame_message(replace(frame(), sequence=sequence), pad, boot, 0))


def test_frame_comes_unchanged(tmp_path: Path) -> None:
    source, path = fed(tmp_path)
    assert not source.state.connected
    assert str(path) in source.state.reason
    send(path, message(sequence=7))
    (came,) = source.poll(5)
    assert source.state.connected
    assert (came.sequence, came.host_time_ns, came.device_time_us) == (7, frame().host_time_ns, frame().device_time_us)
    assert came.packed == frame().packed
    assert source.poll(6) == []
    source.close()
    assert not path.exists()


def test_another_boot_is_another_run(tmp_path: Path) -> None:
    source, path = fed(tmp_path)
    for boot in ("a", "a", "b"):
        send(path, message(boot=boot))
    assert [each.run for each in source.poll(1)] == [1, 1, 2]
    source.close()


@pytest.mark.parametrize("payload", [b"", b"\xc1", b"\x80", message()[:-9], b"x" * 20000])
def test_invalid_frame_is_counted_and_dropped(tmp_path: Path, payload: bytes) -> None:
    source, path = fed(tmp_path)
    send(path, payload)
    send(path, message())
    assert len(source.poll(1)) == 1
    assert (source.state.garbage_bytes > 0) == bool(payload)
    source.close()


def test_frames_of_another_pad_are_named(tmp_path: Path) -> None:
    source, path = fed(tmp_path)
    send(path, message(pad="right"))
    assert source.poll(1) == []
    assert "right" in source.state.warnings["pad"]
    source.close()


def test_silence_is_reported(tmp_path: Path) -> None:
    source, path = fed(tmp_path)
    send(path, message())
    source.poll(10)
    assert source.deadline_ns() == 10 + SILENT_NS
    source.poll(9 + SILENT_NS)
    assert source.state.connected
    source.poll(10 + SILENT_NS)
    assert not source.state.connected
    assert "does the simulator run" in source.state.reason
    source.close()


def test_only_its_user_may_write(tmp_path: Path) -> None:
    source, path = fed(tmp_path)
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    source.close()


def test_socket_of_earlier_daemon_is_replaced_and_no_other_file(tmp_path: Path) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as left:
        left.bind(str(tmp_path / "left.sock"))
    source, path = fed(tmp_path)
    source.close()
    path.write_text("mine")
    with pytest.raises(SourceError, match="frames_from"):
        fed(tmp_path)
    assert path.read_text() == "mine"


def test_path_too_long_is_reported(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match="less than 100 letters"):
        fed(tmp_path / ("x" * 120))


def test_frames_from_makes_a_fed_source(tmp_path: Path) -> None:
    file = tmp_path / "pads.toml"
    file.write_text('[[pad]]\nname = "left"\n[pad.source]\ntype = "simulated"\nframes_from = "left.sock"\n')
    ((source, names),) = open_sources(load(file)[0].pad)
    assert isinstance(source, Fed)
    assert names == {0: "left"}
    assert os.path.lexists(tmp_path / "left.sock")
    source.close()
