"""What systemd sees, what survives a power cut, and what the log looks like."""

from __future__ import annotations

import gc
import io
import os
import re
import secrets
import shutil
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from fmfts.config import Config, PadConfig, SimulatedSource
from fmfts.runtime.daemon import Daemon
from fmfts.service import log
from fmfts.service.notify import Notifier
from fmfts.service.state import state_directory, write_atomically
from needed import missing

SYSTEMD = Path(__file__).parents[2] / "systemd"


@pytest.mark.parametrize("abstract", [False, True])
def test_systemd_gets_notifications(tmp_path: Path, abstract: bool) -> None:
    name = f"fmfts-test-{secrets.token_hex(8)}"
    address = f"@{name}" if abstract else str(tmp_path / "notify")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as systemd:
        systemd.bind(f"\0{name}" if abstract else address)
        systemd.settimeout(5)
        notifier = Notifier({"NOTIFY_SOCKET": address, "WATCHDOG_USEC": "5000000", "WATCHDOG_PID": str(os.getpid())})
        notifier.ready("2 pads")
        notifier.status("left: ok\nREADY=0")
        notifier.watchdog()
        notifier.stopping()
        notifier.close()
        received = [systemd.recv(1000).decode() for _ in range(4)]
    assert received == ["READY=1\nSTATUS=2 pads", "STATUS=left: ok READY=0", "WATCHDOG=1", "STOPPING=1"]
    assert notifier.watchdog_interval_s == 2.5


def test_no_notification_without_systemd() -> None:
    notifier = Notifier({})
    notifier.ready()
    assert notifier.watchdog_interval_s is None
    notifier.close()


@pytest.mark.parametrize(
    "environ",
    [{"WATCHDOG_USEC": "0"}, {"WATCHDOG_USEC": "soon"}, {"WATCHDOG_USEC": "5000000", "WATCHDOG_PID": "1"}],
)
def test_watchdog_of_another_process_or_none_is_not_served(environ: dict[str, str]) -> None:
    assert Notifier(environ).watchdog_interval_s is None


def test_systemd_that_does_not_listen_is_logged_once(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    notifier = Notifier({"NOTIFY_SOCKET": str(tmp_path / "nobody")})
    notifier.ready()
    notifier.watchdog()
    notifier.close()
    assert len(caplog.records) == 1
    assert "cannot send READY=1 to systemd" in caplog.text


def test_daemon_that_ended_leaves_no_line_to_systemd_open(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is left open is an error of this test when it is collected: ResourceWarning."""
    monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
    monkeypatch.setenv("FMFTS_BUS", f"ipc://{tmp_path}")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    with Daemon(Config(pad=[PadConfig(name="left", source=SimulatedSource(finger="none"))])):
        pass
    gc.collect()


def test_state_directory_is_systemds_then_xdgs_then_homes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    service, xdg = tmp_path / "service", tmp_path / "xdg"
    assert state_directory({"STATE_DIRECTORY": f"{service}:/other", "XDG_STATE_HOME": str(xdg)}) == service
    assert state_directory({"XDG_STATE_HOME": str(xdg)}) == xdg / "fmfts"
    assert state_directory({"XDG_STATE_HOME": "relative"}) == tmp_path / "home/.local/state/fmfts"
    assert state_directory({}).is_dir()


def test_file_is_replaced_whole(tmp_path: Path) -> None:
    path = tmp_path / "baseline.json"
    write_atomically(path, b"old")
    before = path.stat().st_ino
    write_atomically(path, b"new")
    assert path.read_bytes() == b"new"
    assert path.stat().st_ino != before, "written beside and renamed, not written over"
    assert os.listdir(tmp_path) == ["baseline.json"]


def test_failed_write_keeps_the_old_file_and_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "baseline.json"
    write_atomically(path, b"old")

    def full(descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space left"):
        write_atomically(path, b"new")
    assert path.read_bytes() == b"old"
    assert os.listdir(tmp_path) == ["baseline.json"]


def test_next_write_removes_old_leftovers_of_killed_writers(tmp_path: Path) -> None:
    old, young, foreign = (tmp_path / name for name in (".b.json.0000.tmp", ".b.json.1111.tmp", ".c.json.0000.tmp"))
    for path in (old, young, foreign):
        path.touch()
    for path in (old, foreign):
        os.utime(path, (0, 0))
    write_atomically(tmp_path / "b.json", b"new")
    assert sorted(os.listdir(tmp_path)) == [young.name, foreign.name, "b.json"]


def test_content_is_on_the_disk_before_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    order: list[str] = []
    real_fsync, real_replace = os.fsync, Path.replace
    monkeypatch.setattr(os, "fsync", lambda number: (order.append("fsync"), real_fsync(number))[1])
    monkeypatch.setattr(Path, "replace", lambda self, to: (order.append("rename"), real_replace(self, to))[1])
    write_atomically(tmp_path / "a", b"x")
    assert order == ["fsync", "rename", "fsync"]


LOGGING = """
import logging, sys, os
from fmfts.service import log
if sys.argv[1] == "journal":
    found = os.fstat(2)
    os.environ["JOURNAL_STREAM"] = f"{found.st_dev}:{found.st_ino}"
else:
    os.environ["JOURNAL_STREAM"] = "1:2"
log.configure(logging.DEBUG)
logging.debug("d"); logging.info("i"); logging.warning("w"); logging.error("two\\nlines"); logging.critical("c")
"""


def logged(where: str) -> list[str]:
    run = subprocess.run([sys.executable, "-c", LOGGING, where], capture_output=True, text=True, check=True)
    return run.stderr.splitlines()


def test_journal_gets_a_priority_on_every_line() -> None:
    assert logged("journal") == ["<7>d", "<6>i", "<4>w", "<3>two", "<3>lines", "<2>c"]


def test_people_get_time_and_level_despite_an_inherited_journal() -> None:
    assert re.fullmatch(r"\d\d:\d\d:\d\d\.\d{3} DEBUG d", logged("terminal")[0])


def test_stream_without_a_descriptor_is_no_journal() -> None:
    assert not log.is_journal(io.StringIO(), {"JOURNAL_STREAM": "1:2"})


def require(tool: str) -> None:
    if shutil.which(tool) is None:
        missing(f"{tool} (Debian package systemd)")


@pytest.fixture
def unit(tmp_path: Path) -> Path:
    """The shipped unit, except for the program, which is not installed where the tests run."""
    text = (SYSTEMD / "fmfts.service").read_text()
    assert "ExecStart=/usr/bin/fmfts-daemon run\n" in text
    path = tmp_path / "fmfts.service"
    path.write_text(text.replace("/usr/bin/fmfts-daemon", "/bin/true"))
    return path


def systemd_analyze(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    require("systemd-analyze")
    return subprocess.run(["systemd-analyze", *arguments], capture_output=True, text=True, check=False)


def test_systemd_accepts_the_unit_without_warning(unit: Path) -> None:
    run = systemd_analyze("verify", "--man=no", unit)
    assert (run.stdout + run.stderr, run.returncode) == ("", 0)


DRIVERS = {"ttyUSB": "usbserial", "ttyACM": "cdc_acm", "i2c": "i2c_dev"}
BUILT_IN = {"ttyS", "ttyAMA"}


def test_drivers_of_allowed_devices_are_loaded_before_unit_starts(unit: Path) -> None:
    """systemd resolves DeviceAllow=char-… once; what is not in /proc/devices then is refused for ever."""
    lines = unit.read_text().splitlines()
    allowed = {line.removeprefix("DeviceAllow=char-").split()[0] for line in lines if line.startswith("DeviceAllow=")}
    loaded = {f"modprobe@{DRIVERS[name]}.service" for name in allowed - BUILT_IN}
    for key in ("Wants=", "After="):
        assert {word for line in lines if line.startswith(key) for word in line.removeprefix(key).split()} == loaded


def test_unit_is_exposed_by_no_more_than_one_and_a_half(unit: Path) -> None:
    run = systemd_analyze("security", "--offline=true", "--threshold=15", "--no-pager", unit)
    assert run.returncode == 0, run.stdout[-2000:] + run.stderr


def test_user_and_groups_are_made(tmp_path: Path) -> None:
    require("systemd-sysusers")
    (tmp_path / "etc").mkdir()
    command = ["systemd-sysusers", f"--root={tmp_path}", str(SYSTEMD / "fmfts.sysusers")]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    assert "fmfts:x:" in (tmp_path / "etc/passwd").read_text()
    groups = [line.split(":")[0] for line in (tmp_path / "etc/group").read_text().splitlines()]
    assert {"fmfts", "dialout", "i2c"} <= set(groups)
