"""A board's stream through the daemon's own source, from the bytes on a pty to frames: no field is lost or rounded.

The sent bytes: eFlesh's published recordings (notvenky/eFlesh, characterization/datasets), and the boards' library
applied to counts (emulator/anyskin_board.py). The test advances the time, one period a packet.
"""

from __future__ import annotations

import struct
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from emulator.anyskin_board import Settings, binary, steps_ut, text, told_ut
from emulator.pty_port import PtyPort
from fmfts.sensor import Frame
from fmfts.sensor.chips import ANYSKIN
from fmfts.sensor.missing import missing_sensors
from fmfts_skin.board import source as anyskin_source
from fmfts_skin.board.source import Anyskin, PadOnStream
from unit.recorded_files import eflesh_fields_ut

PERIOD_NS = 5_000_000
LEARNING = 150  # packets, more than the half second in which the source learns the period
LARGEST_UT = 13_100.0  # of eFlesh's recordings
SIX_DIGITS = 1e-5  # relative difference of a published figure from the board's
PUBLISHED = [("eflesh_normal_1.csv", 3600), ("eflesh_normal_2.csv", 3600), ("eflesh_spatial_1.csv", 4805),
             ("eflesh_shear_1.csv", 7200)]  # fmt: skip


class Line:
    """A board on a pty, and the source that reads it."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch, is_text: bool = False) -> None:
        self.now_ns = 1_000_000_000_000
        clock = SimpleNamespace(monotonic_ns=lambda: self.now_ns, monotonic=lambda: self.now_ns / 1e9)
        monkeypatch.setattr(anyskin_source, "time", clock)
        self.port = PtyPort(folder / "board")
        self.source = Anyskin(
            PadOnStream(
                name="skin", sensors=5, chip=ANYSKIN, rate_hz=200, range_gauss=52.0, trigger="free",
                port=str(folder / "board"), baud=115200, is_text=is_text,
            )
        )  # fmt: skip
        self.source.poll(self.now_ns)

    def frames(self, packets: Sequence[bytes]) -> list[Frame]:
        found: list[Frame] = []
        for packet in packets:
            self.now_ns += PERIOD_NS
            self.port.write(packet)
            found += self.source.poll(self.now_ns)
        return found


@pytest.fixture
def line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Line]:
    opened = Line(tmp_path, monkeypatch)
    yield opened
    opened.source.close()
    opened.port.unplug()


def packet_of(fields_ut: np.ndarray, temperature_c: float = 25.0) -> bytes:
    """The bytes of 5X_binary_burst_stream, of fields as they are."""
    floats = [number for field in fields_ut for number in (temperature_c, *field)]
    return struct.pack(f"<{len(floats)}f", *floats) + b"\r\n"


def fields_ut_of(frames: Sequence[Frame]) -> np.ndarray:
    return np.array([frame.field_t for frame in frames]) * 1e6


@pytest.mark.parametrize(("name", "rows"), PUBLISHED)
def test_published_recording_is_used_whole_and_never_saturated(name: str, rows: int, line: Line) -> None:
    fields_ut = eflesh_fields_ut(name)
    assert len(fields_ut) == rows
    packets = [packet_of(each) for each in fields_ut]
    frames = line.frames(packets[:LEARNING] + packets + packets[:1])[-rows - 1 : -1]
    assert len(frames) == rows
    assert sum(int(frame.overflow.sum()) for frame in frames) == 0
    assert min(int((frame.usable.all(axis=1) & frame.valid).sum()) for frame in frames) == 5
    away = np.abs(fields_ut_of(frames) - fields_ut)
    assert (away <= 1e-4 + SIX_DIGITS * np.abs(fields_ut)).all()


def noisy_counts(settings: Settings, count: int, seed: int = 1) -> np.ndarray:
    """(K, 5, 3) counts of still fields up to 13.1 mT, or up to the settings' own end, with a noise of two counts."""
    random = np.random.default_rng(seed)
    largest = np.minimum(LARGEST_UT / np.array(steps_ut(settings)), (32000, 32000, 21900, 10900)[settings.res])
    still = np.round(random.uniform(-1.0, 1.0, (5, 3)) * largest)
    still[0, 2] = round(largest[2])
    noisy = np.round(still + random.normal(0.0, 2.0, (count, 5, 3)))
    return np.clip(noisy, -largest.max(), largest.max())


def packets_of(counts: np.ndarray, settings: Settings) -> list[bytes]:
    return [
        packet_of([[told_ut(int(count), axis, settings) for axis, count in enumerate(chip)] for chip in packet])
        for packet in counts
    ]


@pytest.mark.parametrize("settings", [Settings(gain, res) for gain in range(8) for res in range(4)])
def test_every_setting_of_the_library_keeps_each_count(settings: Settings, line: Line) -> None:
    counts = noisy_counts(settings, LEARNING + 100)
    frames = line.frames(packets_of(counts, settings))
    assert len(frames) > 100
    sent_ut = counts[-len(frames) :] * np.array(steps_ut(settings))
    assert np.abs(fields_ut_of(frames) - sent_ut).max() < 0.02 * min(steps_ut(settings))
    assert all(frame.valid.all() and not frame.overflow.any() for frame in frames)
    assert not line.source.state.warnings.keys() - {"rate"}


@pytest.mark.parametrize("settings", [Settings(6, 0), Settings(1, 2), Settings(1, 0)])
def test_text_stream_keeps_each_count(settings: Settings, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    line = Line(tmp_path, monkeypatch, is_text=True)
    sent_ut = noisy_counts(settings, LEARNING + 100) * np.array(steps_ut(settings))
    frames = line.frames([text(each.tolist(), settings=settings) for each in sent_ut])
    assert len(frames) > 100
    assert np.abs(fields_ut_of(frames) - sent_ut[-len(frames) :]).max() < 0.02 * min(steps_ut(settings))
    line.source.close()
    line.port.unplug()


@pytest.mark.parametrize("value", [float("nan"), float("inf"), float("-inf")])
def test_value_that_is_no_number_is_saturated(value: float, line: Line) -> None:
    counts = noisy_counts(Settings(), LEARNING)
    line.frames(packets_of(counts, Settings()))
    fields = counts[-1] * np.array(steps_ut())
    fields[2, 1] = value
    (frame,) = line.frames([packet_of(fields)])
    assert np.argwhere(frame.overflow).tolist() == [[2, 1]]
    assert np.isnan(frame.field_t[2, 1])


@pytest.mark.parametrize(("settings", "end_ut"), [(Settings(1, 2), 52_800.0), (Settings(7, 3), 13_200.0)])
def test_end_of_the_converter_is_saturated(settings: Settings, end_ut: float, line: Line) -> None:
    """RES 2 ends at 22000 counts and RES 3 at 11000 (rev 002, table 4): 2.4 and 1.2 µT a count."""
    counts = noisy_counts(settings, LEARNING)
    line.frames(packets_of(counts, settings))
    fields = counts[-1] * np.array(steps_ut(settings))
    fields[3, 0] = -2.0 * end_ut
    (frame,) = line.frames([binary(fields.tolist(), settings=settings)])
    assert frame.overflow[3, 0] == (settings.res == 2)
    told = missing_sensors(frame)
    assert ("the board's firmware sets this range" in told.get(3, "")) == (settings.res == 2)
    fields[3, 0] = 0.95 * end_ut
    (frame,) = line.frames([binary(fields.tolist(), settings=settings)])
    assert not frame.overflow.any()
    assert frame.field_t[3, 0] * 1e6 == pytest.approx(0.95 * end_ut, abs=1.3)


def test_value_between_two_steps_counts_as_damaged(line: Line) -> None:
    counts = noisy_counts(Settings(), LEARNING)
    line.frames(packets_of(counts, Settings()))
    fields = counts[-1] * np.array(steps_ut())
    damaged = fields.copy()
    damaged[4, 0] += 0.09
    frames = line.frames([packet_of(damaged), packet_of(fields)])
    assert [frame.valid.tolist() for frame in frames] == [[True] * 4 + [False], [True] * 5]


def test_step_that_was_learned_too_coarse_is_learned_anew(line: Line) -> None:
    """While the period was learned, all counts happened to be even."""
    counts = noisy_counts(Settings(), LEARNING)
    line.frames(packets_of(2 * np.round(counts / 2), Settings()))
    sent = counts + 1 - counts % 2
    frames = line.frames(packets_of(sent, Settings()))
    away = np.abs(fields_ut_of(frames) - sent[-len(frames) :] * np.array(steps_ut())).max(axis=2)
    valid = np.array([frame.valid for frame in frames])
    assert away[valid].max() < 0.01
    assert valid[30:].all()


def test_other_firmware_is_named_and_its_fields_are_rounded(line: Line) -> None:
    """Steps of HALLCONF 0 (0.196 and 0.316 µT), which no published sketch sets."""
    counts = noisy_counts(Settings(), LEARNING + 100)
    sent_ut = counts * np.array([0.196, 0.196, 0.316])
    frames = line.frames([packet_of(each) for each in sent_ut])
    (said,) = [text for key, text in line.source.state.warnings.items() if key == "step"]
    assert "multiples of no step" in said
    assert "0.6 µT" in said
    assert np.abs(fields_ut_of(frames) - sent_ut[-len(frames) :]).max() <= 0.485
    assert all(frame.valid.all() and not frame.overflow.any() for frame in frames)


def test_probe_reports_step_and_range_of_the_board(line: Line) -> None:
    line.frames(packets_of(noisy_counts(Settings(1, 2), LEARNING), Settings(1, 2)))
    board = line.source.state.board
    assert (board["step_xy_ut"], board["step_z_ut"], board["range_xy_gauss"]) == (2.4, 3.872, 528.0)


def test_chip_without_a_sample_costs_no_other_at_any_setting(line: Line) -> None:
    settings = Settings(0, 3)  # 0xFFFF becomes the largest field of all settings
    fields = noisy_counts(settings, LEARNING) * np.array(steps_ut(settings))
    fields[:, 1] = np.nan
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        frames = line.frames([binary(each.tolist(), settings=settings) for each in fields])
    assert len(frames) > 40
    assert all(frame.valid.tolist() == [True, False, True, True, True] for frame in frames)


def test_frame_of_an_older_recording_keeps_its_field() -> None:
    """They have gain code 0 only, of 0.161 µT in x and y and 0.294 µT in z."""
    counts = np.tile(np.array([1000, -7, 20000], np.int16), (5, 1))
    yes = np.ones(5, np.bool_)
    frame = Frame(0, 1, 0, 0, 0, counts, np.zeros(5, np.uint16), yes, yes, 25.0, chip=ANYSKIN)
    assert frame.field_t[0] * 1e6 == pytest.approx([161.0, -1.127, 5880.0])
    assert ANYSKIN.gain_code_for_range(52.0) == 0  # the gain code of a configuration that names it
