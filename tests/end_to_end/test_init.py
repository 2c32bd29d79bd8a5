"""`fmfts-daemon init` and `demo` in an empty folder, with the firmware's host build as the board."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from end_to_end.processes import FirmwareHost
from fmfts.cli import init_config
from fmfts.cli.verb import VerbError
from fmfts.config import BridgeSource, SimulatedSource
from fmfts.config.example import FoundPad, unusual, written_for
from fmfts.config.file import load
from fmfts.sensor.bridge import serial_port
from fmfts.sensor.bridge.serial_port import candidates
from fmfts.sensor.i2c import scan
from fmfts.sensor.i2c.scan import Found

UID = "0123456789abcdef01234567"


def said(folder: Path, *words: str | Path, code: int = 0) -> str:
    ended = subprocess.run(
        [sys.executable, "-m", "fmfts", *words], cwd=folder, capture_output=True, text=True, timeout=300, check=False
    )
    assert ended.returncode == code, ended
    assert "Traceback" not in ended.stderr
    return ended.stdout + ended.stderr


def test_init_writes_commented_configuration_for_board_that_it_finds(tmp_path: Path) -> None:
    with FirmwareHost(tmp_path, "--uid", UID, "--pads", "2") as board:
        told = said(tmp_path, "init", "--port", board.port)
        assert f"pad.toml: written for board {UID}" in told
        assert "`fmfts-daemon check-config --config pad.toml`" in told
        assert said(tmp_path, "check-config", "--config", "pad.toml").startswith("good: 2 pads")
        probed = said(tmp_path, "probe", "--config", "pad.toml")
    assert probed.count("connected: yes") == 2
    config, file = load(tmp_path / "pad.toml")
    for index, pad in enumerate(config.pad):
        assert isinstance(pad.source, BridgeSource)
        assert (pad.source.uid, pad.source.pad_index) == (UID, index)
    text = file.read_text()
    assert "tesla; N35 is about 1.2" in text
    assert text.count('publish = "frame"') == text.count("second more, with a newer `now`") == 2
    assert "[collect.gauge]" in text


@pytest.mark.parametrize(
    ("identification", "where", "written"),
    [
        ("30 00 00", {"mux_address": 0x70, "channels": [0, 1, 2, 3]}, ("mmc5983ma", 220, 8.0)),
        ("00 00 ff", {"mux_address": 0x70, "channels": [0, 1, 2, 3]}, ("qmc5883l", 200, 8.0)),
        ("00 06 7c", {"addresses": ["0x0c", "0x0d", "0x0e", "0x0f"]}, ("mlx90393", 220, 132.0)),
    ],
)
def test_init_writes_the_chips_that_the_board_has(
    tmp_path: Path, identification: str, where: dict, written: tuple[str, int, float]
) -> None:
    answers = [identification, "00 00 00", identification, identification]  # the second one is not there yet
    board = {"uid": UID, "pads": [{"i2c_port": 1, "identification": answers} | where]}
    (tmp_path / "pad.toml").write_text(written_for(init_config._pads_of(board, "/dev/ttyACM0"), "a board"))
    source = load(tmp_path / "pad.toml")[0].pad[0].source
    assert isinstance(source, BridgeSource)
    assert (source.chip, source.rate_hz, source.range_gauss) == written


def test_init_names_the_places_of_chips_unless_there_are_four() -> None:
    three = {"identification": ["00 06 7c"] * 3, "addresses": ["0x0c", "0x0d", "0x0e"]}
    one = {"identification": ["30 00 00"], "mux_address": 0x70, "channels": [4]}
    pads = init_config._pads_of({"uid": UID, "pads": [three, one]}, "/dev/ttyACM0")
    of_three, of_one = map(unusual, pads)
    assert of_three is not None
    assert of_three.startswith("pad1: 3 chips found (at 0x0c, 0x0d, 0x0e), and a standard pad has 4")
    assert "the same address as another chip" in of_three
    assert of_one is not None
    assert of_one.startswith("pad2: 1 chip found (mux 0x70, channels 4)")


def test_init_reports_pads_that_may_be_halves_of_one() -> None:
    halves = [
        {"i2c_port": 1, "mux_address": mux, "channels": channels, "identification": ["48 34 33"] * 4}
        for mux, channels in ((0x70, [0, 1, 2, 3]), (0x70, [4, 5, 6, 7]), (0x71, [0, 1, 2, 3]))
    ]
    lower, upper, other = map(unusual, init_config._pads_of({"uid": UID, "pads": halves}, "/dev/ttyACM0"))
    assert (lower, other) == (None, None)
    assert upper is not None
    assert upper.startswith("pad1 and pad2 are behind one mux. Where their eight sensors are one pad")
    eight = {"i2c_port": 1, "mux_address": 0x70, "channels": list(range(8)), "identification": ["48 34 33"] * 8}
    (found,) = map(unusual, init_config._pads_of({"uid": UID, "pads": [eight]}, "/dev/ttyACM0"))
    assert found is not None
    assert found.startswith(
        "left: 8 chips found (mux 0x70, channels 0, 1, 2, 3, 4, 5, 6, 7), as the second standard pad"
    )


def test_init_writes_a_pad_for_each_kind_of_chip_behind_a_mux(monkeypatch: pytest.MonkeyPatch) -> None:
    """Boards sold under one name carry different chips, and a pad's chips must be of one kind."""
    older = [Found("qmc5883l", 0x0D, 0x70, channel) for channel in (0, 2, 3)]
    monkeypatch.setattr(scan, "scanned", lambda bus: [older[0], Found("qmc5883p", 0x2C, 0x70, 1), *older[1:]])
    pads, _ = init_config._on_i2c(1)
    sources = ["\n".join(pad.source) for pad in pads]
    assert ['chip = "qmc5883l"' in source for source in sources] == [True, False]
    assert ['chip = "qmc5883p"' in source for source in sources] == [False, True]
    assert "channels = [0, 2, 3]" in sources[0]
    assert "channels = [1]" in sources[1]


def test_every_verb_finds_the_file_that_init_wrote_here(tmp_path: Path) -> None:
    said(tmp_path, "init", "--simulated")
    assert said(tmp_path, "check-config").startswith("good: 1 pad in pad.toml")


def test_configuration_in_use_is_named_where_two_are_found(tmp_path: Path) -> None:
    (tmp_path / "config.toml").write_text("not = [a configuration")
    said(tmp_path, "init", "--simulated")
    assert said(tmp_path, "check-config").endswith(
        "fmfts-daemon check-config: pad.toml is used, not config.toml: to use another file, add --config config.toml\n"
    )


def test_surplus_argument_is_refused_with_usage(tmp_path: Path) -> None:
    told = said(tmp_path, "check-config", "pad.toml", code=2)
    assert told.startswith("usage: fmfts-daemon check-config [-h]")
    assert "unexpected: pad.toml; did you mean --config pad.toml?" in told
    assert said(tmp_path, "check-config", "left", code=2).endswith("unexpected: left\n")
    assert said(tmp_path, "selftest", "left", code=2).endswith("unexpected: left; did you mean --pad left?\n")


def test_init_says_what_to_do_where_it_cannot_write(tmp_path: Path) -> None:
    told = said(tmp_path, "init", "--simulated", "--config", "absent/pad.toml", code=73)
    assert (
        "absent/pad.toml cannot be written: No such file or directory: make its folder first, or name another" in told
    )


def test_init_leaves_a_file_that_exists_as_it_is(tmp_path: Path) -> None:
    (tmp_path / "pad.toml").write_text("mine")
    assert "pad.toml exists and is left as it is" in said(tmp_path, "init", "--simulated", code=73)
    assert (tmp_path / "pad.toml").read_text() == "mine"


def test_init_without_a_board_says_what_was_tried(tmp_path: Path) -> None:
    told = said(tmp_path, "init", "--port", tmp_path / "none", code=69)
    assert f"no board on {tmp_path}/none: " in told
    assert "--simulated" not in told
    assert "no pad found: /dev/i2c-99" in said(tmp_path, "init", "--i2c", "99", code=69)
    assert not (tmp_path / "pad.toml").exists()


def test_init_without_ports_suggests_the_simulated_pad(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(serial_port, "candidates", list)
    with pytest.raises(VerbError, match=r"there is no .*--simulated needs none"):
        init_config._on_ports(None)


def test_simulated_configuration_is_the_one_that_ships(tmp_path: Path) -> None:
    said(tmp_path, "init", "--simulated", "--config", "sim.toml")
    assert load(tmp_path / "sim.toml")[0].pad[0].source == SimulatedSource()


def test_demo_is_a_verb_and_needs_no_configuration(tmp_path: Path) -> None:
    assert "pad demo: " in said(tmp_path, "demo", "--seconds", "10")


def test_each_port_is_tried_once_and_by_its_lasting_name(tmp_path: Path) -> None:
    (tmp_path / "dev/serial/by-id").mkdir(parents=True)
    (tmp_path / "dev/ttyUSB0").touch()
    (tmp_path / "dev/ttyUSB1").touch()
    (tmp_path / "dev/serial/by-id/usb-board").symlink_to("../../ttyUSB1")
    assert candidates(tmp_path) == [f"{tmp_path}/dev/serial/by-id/usb-board", f"{tmp_path}/dev/ttyUSB0"]


@pytest.mark.parametrize("sensors", [3, 4, 6])
def test_init_asks_for_sensor_places_when_count_differs(sensors: int, tmp_path: Path) -> None:
    text = written_for([FoundPad("left", ['type = "simulated"'], sensors)], "a test")
    assert ("FILL IN" in text) == (sensors != 4)
