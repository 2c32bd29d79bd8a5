"""`fmfts-daemon report` as a process: on an emulated kernel bus, on a board, beside a daemon, and with everything
broken."""

from __future__ import annotations

import os
import shutil
import socket
from pathlib import Path
from typing import Any

import msgspec
import pytest
from mcap.stream_reader import StreamReader

import fmfts.contact
from data.make_report import CONFIG as QMC_CONFIG
from data.make_report import KEPT
from end_to_end.kernel_bus import kernel_bus
from end_to_end.processes import BRIDGE_CONFIG, UNTOUCHED_CONFIG, FirmwareHost, RunningDaemon, run_command
from fmfts.common import exit_codes
from fmfts_recording.file import attachment, read
from fmfts_recording.replay import Replay
from fmfts_report.file import NAME, facts_of

CONTACT = Path(fmfts.contact.__file__).parent
SOME = 30  # frames of some seconds, on a busy computer
HMC_CONFIG = '[[pad]]\nname = "left"\n[pad.source]\ntype = "i2c"\nbus = 7\n'


class Made:
    """A new report, in a folder of its own. words: options of the verb."""

    def __init__(self, folder: Path, config: str | None, *words: str | Path, **environment: str) -> None:
        self.path = folder / "report.mcap"
        named: tuple[str | Path, ...] = ()
        if config is not None:
            (folder / "pad.toml").write_text(config)
            named = ("--config", folder / "pad.toml")
        surroundings = os.environ | {"FMFTS_BUS": f"ipc://{folder}", "XDG_STATE_HOME": str(folder / "state")}
        self.ended = run_command("report", self.path, *named, *words, environment=surroundings | environment)
        assert self.ended.returncode == exit_codes.DONE, self.ended
        assert "Traceback" not in self.ended.stderr
        self.facts: dict[str, Any] = facts_of(self.path)

    def missing(self, beginning: str) -> str:
        """The sentence about a missing part; the same is on stderr."""
        (found,) = [each for each in self.facts["missing"] if each.startswith(beginning)]
        return found

    def frames(self, pad: str = "left") -> int:
        return sum(one.kind == "frame" and one.pad == pad for one in read(self.path))


def made_of_an_emulated_bus(folder: Path, config: str, *words: str) -> Made:
    """A busy computer may stop the emulator for longer than a real bus may take: then another report is made."""
    for attempt in range(5):
        (folder / str(attempt)).mkdir()
        made = Made(folder / str(attempt), config, *words)
        if made.frames() > SOME and not any("is wedged" in each for each in made.facts["missing"]):
            break
    return made


def shape(facts: Any) -> Any:
    """The keys of facts, whatever their values are."""
    if isinstance(facts, dict):
        return {key: shape(each) for key, each in facts.items()}
    return [shape(facts[0])] if isinstance(facts, list) and facts and isinstance(facts[0], dict) else None


def test_report_of_chips_on_a_bus_has_the_kept_reports_facts(tmp_path: Path) -> None:
    with kernel_bus("qmc5883l"):
        made = made_of_an_emulated_bus(tmp_path, QMC_CONFIG, "--seconds", "2")
    kept = facts_of(KEPT)
    for facts in (made.facts, kept):
        facts["versions"].pop("packages")
        for of_the_computer in ("machine", "state", "environment", "ports"):
            facts.pop(of_the_computer)
    assert shape(made.facts) == shape(kept)
    assert [chip["registers"][3] for chip in made.facts["buses"][0]["chips"]] == [
        chip["registers"][3] for chip in kept["buses"][0]["chips"]
    ]
    assert made.frames() == made.facts["recorded"]["frames"]["left"] > SOME
    replay = Replay(made.path)
    assert sum(1 for _ in replay.contacts()) > SOME
    assert replay.comparison.is_the_same
    assert "QMC5883L has no self-test" in made.missing("self-test of pad 'left'")
    assert "a daemon started for the report" in made.ended.stdout


def test_report_holds_selftest_and_registers_of_the_daemon(tmp_path: Path) -> None:
    """Honeywell 900425: 0x9c in register A means compensation and 220 Hz; the chips of mux 0x71 were never set up."""
    with kernel_bus():
        made = made_of_an_emulated_bus(tmp_path, HMC_CONFIG, "--seconds", "1")
    assert [test["passed"] for test in made.facts["selftests"]] == [True]
    first_bytes: dict[int, set[str]] = {}
    for chip in made.facts["buses"][0]["chips"]:
        first_bytes.setdefault(chip["mux_address"], set()).add(chip["registers"][0].split()[1])
    assert first_bytes == {0x70: {"9c"}, 0x71: {"10"}}
    assert not (made.path.parent / "state/fmfts/selftest").exists(), "a report changes no state"


def test_report_of_a_bus_that_hangs_says_in_which_call(tmp_path: Path) -> None:
    with kernel_bus() as kernel:
        kernel.order(block_s=60)
        made = Made(tmp_path, HMC_CONFIG, "--seconds", "2")
        kernel.order(block_s=0)
    assert "is wedged" in made.missing("frames of pad 'left'")
    assert "/dev/i2c-7 hangs in writing 08 to 0x70" in made.missing("chips on /dev/i2c-7")
    assert made.missing("chips on /dev/i2c-7") in made.ended.stderr
    assert "is wedged" in made.facts["log_of_this_run"]


def test_report_where_no_chip_answers_says_so(tmp_path: Path) -> None:
    with kernel_bus() as kernel:
        for mux in (0, 1):
            kernel.order(mux=mux, set={"absent": True})
        made = Made(tmp_path, HMC_CONFIG, "--seconds", "1")
    assert made.missing("chips on /dev/i2c-7") == "chips on /dev/i2c-7: no chip that this daemon knows answers"
    assert made.facts["buses"][0]["chips"] == []
    assert made.facts["pads"][0]["faults"]


def test_report_of_a_bad_configuration_still_looks_at_its_bus(tmp_path: Path) -> None:
    with kernel_bus("qmc5883l"):
        made = Made(tmp_path, QMC_CONFIG.replace("100", '"fast"'))
    assert "rate_hz = 'fast': must be a whole number" in made.missing("frames and self-test")
    assert len(made.facts["buses"][0]["chips"]) == 4
    assert 'rate_hz = "fast"' in made.facts["configuration"]["text"]


@pytest.mark.parametrize("config", ["[[pad\n", "bus = \x00", "é" * 200_000], ids=["cut", "nul", "long"])
def test_report_of_a_file_that_is_no_configuration_is_written(tmp_path: Path, config: str) -> None:
    made = Made(tmp_path, config)
    assert made.missing("frames and self-test")
    assert len(made.facts["configuration"]["text"]) <= 200_000


def test_report_without_configuration_looks_at_a_named_bus(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with kernel_bus("qmc5883l"):
        made = Made(tmp_path, None, "--i2c", "7")
    assert "no configuration found" in made.missing("configuration")
    assert [chip["chip"] for chip in made.facts["buses"][0]["chips"]] == ["qmc5883l"] * 4


def test_report_of_a_board_has_its_hello_and_its_frames(tmp_path: Path) -> None:
    uid = "0123456789abcdef01234567"
    with FirmwareHost(tmp_path, "--uid", uid) as board:
        made = Made(tmp_path, BRIDGE_CONFIG.format(port=board.port), "--seconds", "2")
    (pad,) = made.facts["pads"]
    assert (pad["board"]["uid"], pad["connected"]) == (uid, True)
    assert pad["board"]["firmware"]
    assert [test["passed"] for test in made.facts["selftests"]] == [True]
    assert made.frames() > SOME
    assert "can be read on this computer's I2C buses only" in made.missing("registers of chips on a board")


def test_report_of_a_board_that_is_not_plugged_in_says_so(tmp_path: Path) -> None:
    made = Made(tmp_path, BRIDGE_CONFIG.format(port=tmp_path / "none"), "--seconds", "1", "--no-selftest")
    assert "does not exist (is the board plugged in?)" in made.missing("frames of pad 'left'")
    assert made.missing("self-test") == "self-test: left out with --no-selftest"


def test_report_beside_a_daemon_asks_it_instead_of_the_bus(tmp_path: Path) -> None:
    with kernel_bus(), RunningDaemon(tmp_path, HMC_CONFIG) as daemon:
        daemon.wait_for(lambda contact: contact.sensors_ok == 0b1111)
        ended = daemon.command("report", tmp_path / "r.mcap", "--config", daemon.config, "--seconds", "3")
        assert ended.returncode == exit_codes.DONE, ended
        assert daemon.process.poll() is None
        daemon.wait_for(lambda contact: contact.sensors_ok == 0b1111)
    facts = facts_of(tmp_path / "r.mcap")
    assert facts["through"] == "the running daemon"
    assert facts["recorded"]["frames"]["left"] > SOME
    assert "is in use by process" in facts["buses"][0]["reason"]
    assert "systemctl stop fmfts" in ended.stderr


def test_report_says_why_a_daemon_does_not_start(tmp_path: Path) -> None:
    (tmp_path / "own.onnx").write_text("no model")
    made = Made(tmp_path, UNTOUCHED_CONFIG + '[pad.contact]\nmodel = "own.onnx"\n')
    assert "own.onnx" in made.missing("frames and self-test: a daemon started for the report does not serve: ")
    assert made.missing("pad 'left': its contact model").endswith("send that file, too")


def test_report_brings_baselines_and_leaves_them_as_they_are(tmp_path: Path) -> None:
    """A daemon that is started for the report works on a copy, including a damaged baseline."""
    folder = tmp_path / "state/fmfts/baseline"
    folder.mkdir(parents=True)
    (folder / "left.json").write_text('{"damaged": "baseline"}')
    with FirmwareHost(tmp_path) as board:
        made = Made(tmp_path, BRIDGE_CONFIG.format(port=board.port), "--seconds", "1")
    assert list(made.facts["state"].values()) == ['{"damaged": "baseline"}']
    assert "is damaged" in made.facts["log_of_this_run"]
    assert [path.name for path in (tmp_path / "state/fmfts").rglob("*") if path.is_file()] == ["left.json"]


SECRETS = {
    "user": "zaphodbeeblebrox",
    "token": "ghp_8vJq2WnT5rXk0LmZ",
    "password": "towel-42-mostly",
    "other token": "xoxb-17181920-abcdef",
}


def test_report_holds_no_secret_of_user_or_computer(tmp_path: Path) -> None:
    """Searches every byte of the file, and of its compressed contents."""
    home = tmp_path / "home" / SECRETS["user"]
    tools = home / "bin"
    tools.mkdir(parents=True)
    host = socket.gethostname()
    (tools / "journalctl").write_text(
        f"#!/bin/sh\necho 'fmfts: {home}/x on {host}: {SECRETS['user']} API_TOKEN={SECRETS['other token']}'\n"
    )
    (tools / "journalctl").chmod(0o755)
    shutil.copy(CONTACT / "default.onnx", home / "own.onnx")  # a message with a place
    shutil.copy(CONTACT / "default.json", home / "own.json")
    config = (
        UNTOUCHED_CONFIG
        + f'[pad.contact]\nmodel = "own.onnx"\n# of {SECRETS["user"]}, password = {SECRETS["password"]}\n'
    )
    config += f'[bus]\nkeys = "{home}/keys"\n'
    (home / "pad.toml").write_text(config)
    environment = os.environ | {
        "HOME": str(home),
        "USER": SECRETS["user"],
        "GITHUB_TOKEN": SECRETS["token"],
        "FMFTS_KEY": f"{home}/arm.key",
        "FMFTS_BUS": f"ipc://{tmp_path}",
        "PATH": f"{tools}:{os.environ['PATH']}",
    }
    environment.pop("XDG_STATE_HOME", None)
    made = run_command(
        "keys", "new", "arm", "--config", home / "pad.toml", "-o", home / "arm.key", environment=environment
    )
    assert made.returncode == 0, made
    private = [
        line.split('"')[1]
        for file in (home / "arm.key", home / "keys/server.key")
        for line in file.read_text().splitlines()
        if line.startswith("secret")
    ]
    assert len(private) == 2
    with (home / "pad.toml").open("a") as file:
        file.write(f'# secret = "{private[0]}"\n')
    ended = run_command(
        "report", tmp_path / "r.mcap", "--config", home / "pad.toml", "--seconds", "1", environment=environment
    )
    assert ended.returncode == 0, ended
    assert '"model":"~/own.onnx"' in states_of(tmp_path / "r.mcap")
    content = everything_in(tmp_path / "r.mcap")
    for secret in [*SECRETS.values(), *private, *([host] if len(host) > 3 else [])]:
        assert secret.encode() not in content, secret
    for harmless in (
        b"finger",
        b"frame/left",
        b"~/own.onnx",
        b"~/pad.toml",
        b"API_TOKEN=<removed>",
        b'"FMFTS_KEY":"~/arm.key"',
    ):
        assert harmless in content, harmless


def states_of(path: Path) -> str:
    return "".join(msgspec.json.encode(one.message).decode() for one in read(path) if one.kind == "state")


def everything_in(path: Path) -> bytes:
    """The bytes of a file, and of its unpacked chunks and attachments."""
    with path.open("rb") as file:
        parts = [repr(record).encode() for record in StreamReader(file).records]
    return b"\n".join([path.read_bytes(), attachment(path, NAME) or b"", *parts])
