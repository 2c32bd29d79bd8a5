"""One cause has one exit code, whichever verb detects it. Beside a daemon: end_to_end/test_codes_beside_a_daemon.py."""

from __future__ import annotations

import importlib
import os
import pkgutil
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

import fmfts
from fmfts.cli.main import EPILOG, main
from fmfts.common import exit_codes
from fmfts.common.exit_codes import MEANING, OF_ERROR

ROOT = Path(__file__).parents[2]
FIELDS = ROOT / "tests" / "data" / "calibration_1.23T.csv"
OF_A_PAD = [("baseline", "--rest"), ("baseline", "--bare"), ("baseline", "--restore"), ("selftest",)]
OF_A_FILE = [
    ("pose", str(FIELDS)),
    ("evaluate", str(FIELDS), "--model", "m.onnx"),
    ("calibrate", str(FIELDS), "-o", "m.onnx"),
]
OF_ALL = [("run",), ("probe",), ("check-config",), *OF_A_PAD, *OF_A_FILE]
ABSENT_BOARD = '[[pad]]\nname = "left"\n[pad.source]\ntype = "bridge"\nport = "/dev/no-such-port"\n'
SIMULATED = '[[pad]]\nname = "left"\n[pad.source]\ntype = "simulated"\nfinger = "none"\n'


@pytest.fixture(autouse=True)
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setenv("FMFTS_BUS", f"ipc://{tmp_path}")
    return tmp_path


def ended(words: tuple[str, ...], config: str, place: Path) -> int:
    (place / "config.toml").write_text(config)
    return main([*words, "--config", str(place / "config.toml")])


@pytest.mark.parametrize("verb", [*OF_A_PAD, *OF_A_FILE], ids=" ".join)
def test_pad_that_is_not_there_is_usage(verb: tuple[str, ...], place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert ended((*verb, "--pad", "lef"), SIMULATED, place) == exit_codes.USAGE
    assert "no pad 'lef' here; the configuration has 'left'; did you mean 'left'?" in capsys.readouterr().err


@pytest.mark.parametrize("verb", OF_ALL, ids=" ".join)
def test_absent_key_is_a_bad_configuration(verb: tuple[str, ...], place: Path) -> None:
    assert ended(verb, SIMULATED + "colour = 1\n", place) == exit_codes.CONFIG


@pytest.mark.parametrize("verb", [("run",), ("probe",), ("selftest",)], ids=" ".join)
def test_impossible_source_is_bad_configuration(verb: tuple[str, ...], place: Path) -> None:
    assert ended(verb, ABSENT_BOARD + 'uid = "12"\n', place) == exit_codes.CONFIG


@pytest.mark.parametrize("verb", [("baseline", "--rest"), ("baseline", "--restore")], ids=" ".join)
def test_state_that_cannot_be_written_is_unwritable(
    verb: tuple[str, ...], place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", "/proc/x")
    assert ended(verb, SIMULATED, place) == exit_codes.UNWRITABLE
    assert "name another folder with XDG_STATE_HOME" in capsys.readouterr().err


@pytest.mark.parametrize(
    "verb",
    [
        ("pose", str(FIELDS), "-o", "/proc/x/out"),
        ("record", "/proc/x/out.mcap"),
        ("keys", "new", "me", "-o", "/proc/x/k"),
    ],
    ids=" ".join,
)
def test_output_that_cannot_be_written_is_unwritable(verb: tuple[str, ...], place: Path) -> None:
    config = f'{SIMULATED}[bus]\nendpoint = "tcp://127.0.0.1:5570"\nkeys = "{place / "keys"}"\n'
    assert ended(verb, config, place) == exit_codes.UNWRITABLE


def test_full_disk_is_called_full(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert ended(("pose", str(FIELDS), "-o", "/dev/full"), SIMULATED, place) == exit_codes.UNWRITABLE
    said = capsys.readouterr().err
    assert "/dev/full: No space left on device: the disk is full: make room on it" in said
    assert "writable" not in said


def test_init_on_a_full_disk_leaves_no_part_of_a_file(place: Path) -> None:
    """`init` keeps what is there, so the next one would write nothing."""
    words = [sys.executable, "-m", "fmfts", "init", "--simulated", "--config", place / "pad.toml"]
    limited = f"ulimit -f 1; trap '' XFSZ; exec {shlex.join(map(str, words))}"
    environment = os.environ | {"PYTHONDONTWRITEBYTECODE": "1"}  # Python would keep a part of a module's bytecode
    ended = subprocess.run(["bash", "-c", limited], stderr=subprocess.PIPE, text=True, env=environment, check=False)
    assert ended.returncode == exit_codes.UNWRITABLE, ended
    assert "pad.toml cannot be written: File too large" in ended.stderr
    assert list(place.iterdir()) == []


@pytest.mark.parametrize("is_buffered", [True, False])
@pytest.mark.parametrize("verb", ["check-config", "listen"])
def test_output_on_a_full_disk_is_called_full(verb: str, is_buffered: bool, place: Path) -> None:
    """As in `check-config > facts.txt`: it ended with a traceback, or with 120."""
    (place / "config.toml").write_text(SIMULATED)
    words = [sys.executable, *([] if is_buffered else ["-u"]), "-m", "fmfts", verb, "--config", place / "config.toml"]
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    with open("/dev/full", "w") as full:
        ended = subprocess.run(words, stdout=full, stderr=subprocess.PIPE, text=True, env=environment, check=False)
    assert ended.returncode == exit_codes.UNWRITABLE, ended
    assert ended.stderr.startswith(
        f"fmfts-daemon {verb}: its output, or a file that it writes: No space left on device: the disk is full"
    )


@pytest.mark.parametrize("verb", [("probe",), ("selftest",), ("baseline", "--rest")], ids=" ".join)
def test_board_that_is_not_there_is_absent(verb: tuple[str, ...], place: Path) -> None:
    assert ended(verb, ABSENT_BOARD, place) == exit_codes.UNAVAILABLE


def test_every_code_is_in_help_and_in_manual_in_same_words() -> None:
    manual = (ROOT / "docs" / "troubleshooting.md").read_text()
    codes = {value for name, value in vars(exit_codes).items() if name.isupper() and isinstance(value, int)}
    assert codes == set(MEANING) >= set(OF_ERROR.values())
    rows = dict(re.findall(r"^\| (\d+) \| (.*?) \|", manual, re.MULTILINE))
    assert rows == {str(code): meaning for code, meaning in MEANING.items()}
    for code, meaning in MEANING.items():
        assert f"{code} {meaning}" in EPILOG


def test_systemd_starts_the_service_again_unless_a_person_must_mend_something() -> None:
    """A device that is unplugged comes back, and another daemon ends; a missing package stays missing."""
    service = (ROOT / "systemd" / "fmfts.service").read_text()
    assert f"\nRestartPreventExitStatus={' '.join(map(str, exit_codes.LASTING))}\n" in service
    assert exit_codes.LASTING == (exit_codes.LACKING, exit_codes.UNWRITABLE, exit_codes.CONFIG)
    assert "\nRestart=always\n" in service


def test_every_error_in_the_table_exists() -> None:
    """The table names errors as text, so that it imports nothing."""
    packages = [fmfts, importlib.import_module("fmfts_page")]
    for module in (each for one in packages for each in pkgutil.walk_packages(one.__path__, f"{one.__name__}.")):
        if not module.name.rpartition(".")[2].startswith("__"):
            try:
                importlib.import_module(module.name)
            except ImportError:  # an extra is not installed
                continue
    known, waiting = set[str](), [Exception]
    while waiting:
        kind = waiting.pop()
        known.add(kind.__name__)
        waiting += kind.__subclasses__()
    assert set(OF_ERROR) <= known
