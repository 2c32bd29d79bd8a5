"""A report's parts: names that are removed, what sysfs says of a computer, and a file that a stranger made."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import msgspec
import pytest

from fmfts.service.child import ChildDaemon
from fmfts_recording.file import CopyWriter, RecordingError, RecordingWriter, read
from fmfts_report import gather, machine
from fmfts_report.file import LARGEST_FACTS, NAME, facts_of, lines_of, write
from fmfts_report.log import NoLogError, journal
from fmfts_report.scrub import Scrubber, of_this_computer

SCRUBBER = Scrubber({"zaphod", "pi"}, {"heartofgold", "heartofgold.example"}, {"/srv/people/zaphod", "/root"})


@pytest.mark.parametrize(
    ("text", "scrubbed"),
    [
        ("/srv/people/zaphod/pad.toml", "~/pad.toml"),
        ("/home/ford/keys and /Users/ford/x", "~/keys and ~/x"),
        ('"/root/.local/state"', '"~/.local/state"'),
        ("/mnt/root/x", "/mnt/root/x"),
        ("zaphod's pad, zaphod-pad_zaphod.toml", "<user>'s pad, <user>-pad_<user>.toml"),
        ("scipy on a Raspberry Pi of pi", "scipy on a Raspberry Pi of <user>"),
        ("tcp://heartofgold.example:5570", "tcp://<host>:5570"),
        ("tcp://zaphod:towel42@heartofgold:1", "tcp://<user>@<host>:1"),
        ("tcp://192.168.7.9:5570, tcp://127.0.0.1:1", "tcp://<address>:5570, tcp://127.0.0.1:1"),
        ("tcp://[fe80::ba27:ebff:fe01:203%eth0]:5570", "tcp://[<address>%eth0]:5570"),
        ("2001:db8::1: no answer, ::ffff:192.168.7.9/64", "<address>: no answer, <address>/64"),
        ("2001:0db8:0:1:1:1:1:1 on tcp://[::1]:5570, tcp://[::]:1", "<address> on tcp://[::1]:5570, tcp://[::]:1"),
        (
            "eth0 dc:a6:32:01:02:03: up, B8-27-EB-01-02-03, enxb827eb010203",
            "eth0 <address>: up, <address>, enx<address>",
        ),
        ('psk = "towel42"', "psk = <removed>"),
        ("wifi-sec.psk: towel42, WPAPSK=a", "wifi-sec.psk: <removed>"),
        ('# secret = "rq:rM>}U?@Lns47E1%kR.o@n%FcmmsL/@{H8]yf7"', "# secret = <removed>"),
        ("MY_TOKEN=ghp_0123456789", "MY_TOKEN=<removed>"),
        ("Password: towel42\nrate_hz = 220", "Password: <removed>\nrate_hz = 220"),
        ("a\n-----BEGIN PRIVATE KEY-----\nMC4\n-----END PRIVATE KEY-----\nb", "a\n<removed>\nb"),
        ('keys = "/etc/fmfts/keys"', 'keys = "/etc/fmfts/keys"'),
        ('passphrase="a towel"', "passphrase=<removed>"),
    ],
)
def test_scrubber_removes_names_and_secrets(text: str, scrubbed: str) -> None:
    assert SCRUBBER.text(text) == scrubbed


@pytest.mark.parametrize(
    "text",
    [
        "Nov 26 16:59:44.446 host: 2026-11-26T16:59:44+00:00",
        "registers: b0 04 a8 00 11 22 33 44; 0x0c: b0 04 a8",
        "usb 0403:6001 at 1-1:1.0, pci 0000:01:00.0, i2c@7e804000",
        "std::vector, 16:59:44, 1:02:03:04, c0ffee:12",
        "fmfts 1.2.3 of uid 0123456789abcdef01234567",
        "550e8400-e29b-41d4-a716-446655440000",
    ],
)
def test_scrubber_leaves_times_and_register_dumps(text: str) -> None:
    assert SCRUBBER.text(text) == text


def test_scrubber_removes_values_of_secret_keys() -> None:
    facts = {"password": "x", "wifi": [{"PSK": 42, "ssid": "a"}], "API_KEY": {"a": "b"}, "keys": "/etc/fmfts/keys"}
    expected = {"password": "<removed>", "wifi": [{"PSK": "<removed>", "ssid": "a"}], "API_KEY": "<removed>"}
    assert SCRUBBER.facts(facts) == expected | {"keys": "/etc/fmfts/keys"}
    assert SCRUBBER.facts({"/srv/people/zaphod/token": "a"}) == {"~/token": "a"}
    assert SCRUBBER.message({"token": "x", "frames": {"secret": 3}}) == {"token": "<removed>", "frames": {"secret": 3}}


@pytest.mark.parametrize(
    "part",
    ["é", "token", "\n", "://a", "/home/", "-----BEGIN ", "zaphod", "1.2.", "secret = ", "::", "fe:", "a1-", " 1:1::"],
)
def test_scrubber_is_quick_on_any_text(part: str) -> None:
    """200 kB take milliseconds; what goes over all of the text at each of its places takes minutes."""
    began_s = time.process_time()
    SCRUBBER.text(part * (200_000 // len(part)))
    assert time.process_time() - began_s < 5.0


def test_scrubber_leaves_single_words_and_memory_of_messages() -> None:
    """A pad may be named as its user is: its topic must go on to be its own."""
    message = {"pad": "zaphod", "memory": "ab/pi+cd", "config": {"file": "/home/zaphod/a", "all": ["pi", "a pi"]}}
    assert SCRUBBER.message(message) == {
        "pad": "zaphod",
        "memory": "ab/pi+cd",
        "config": {"file": "~/a", "all": ["pi", "a <user>"]},
    }


def test_scrubber_of_this_computer_knows_its_user_and_home(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("socket.gethostname", lambda: "heartofgold.example")
    scrubber = of_this_computer({"USER": "zaphod", "HOME": "/srv/zaphod", "SUDO_USER": "ford"})
    assert scrubber.text("/srv/zaphod/x of zaphod or ford on heartofgold") == "~/x of <user> or <user> on <host>"
    assert scrubber.text("fmfts on /dev/i2c-1") == "fmfts on /dev/i2c-1"


def placed(root: Path, files: dict[str, bytes]) -> None:
    for name, content in files.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_bytes(content)


def test_adapter_is_reported_as_a_raspberry_pi_has_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The tree as Linux makes it: Documentation/ABI/testing/sysfs-bus-i2c-devices, drivers/i2c/i2c-core-base.c."""
    controller = tmp_path / "sys/devices/platform/soc/fe804000.i2c"
    placed(
        controller,
        {
            "i2c-1/name": b"bcm2835 (i2c@7e804000)\n",
            "of_node/clock-frequency": (400_000).to_bytes(4, "big"),
        },
    )
    driver = tmp_path / "sys/bus/platform/drivers/i2c-bcm2835"
    driver.mkdir(parents=True)
    (controller / "driver").symlink_to(driver)
    devices = tmp_path / "sys/bus/i2c/devices"
    devices.mkdir(parents=True)
    (devices / "i2c-1").symlink_to(controller / "i2c-1")
    monkeypatch.setattr("fmfts.sensor.i2c.adapter.DEVICES", devices)
    facts = machine.adapter(1)
    facts.pop("functions")  # asked of the device itself, which is this computer's
    assert facts == {
        "bus": 1,
        "name": "bcm2835 (i2c@7e804000)",
        "driver": "i2c-bcm2835",
        "clock_hz": 400_000,
        "is_usb": False,
    }


def test_adapter_that_is_not_there_is_reported_by_its_error() -> None:
    assert machine.adapter(250) == {"bus": 250, "is_usb": False, "functions": "not known: No such file or directory"}


def test_serial_port_is_reported_with_its_usb_ids_and_timer(tmp_path: Path) -> None:
    """As drivers/usb/serial/ftdi_sio.c has it: the timer on the port, which hangs on the interface of the device."""
    usb = tmp_path / "sys/devices/platform/usb1/1-1"
    placed(
        usb,
        {
            "idVendor": b"0403\n",
            "idProduct": b"6001\n",
            "product": b"FT232R USB UART\n",
            "1-1:1.0/ttyUSB3/latency_timer": b"16\n",
        },
    )
    driver = tmp_path / "sys/bus/usb-serial/drivers/ftdi_sio"
    driver.mkdir(parents=True)
    (usb / "1-1:1.0/ttyUSB3/driver").symlink_to(driver)
    tty = tmp_path / "sys/class/tty/ttyUSB3"
    tty.mkdir(parents=True)
    (tty / "device").symlink_to(usb / "1-1:1.0/ttyUSB3")
    assert machine.serial_port("/dev/ttyUSB3", tmp_path) == {
        "port": "/dev/ttyUSB3",
        "tty": "ttyUSB3",
        "driver": "ftdi_sio",
        "usb": "0403:6001",
        "product": "FT232R USB UART",
        "latency_timer_ms": "16",
    }


def test_machine_reports_the_model_of_the_device_tree(tmp_path: Path) -> None:
    placed(
        tmp_path,
        {
            "proc/device-tree/model": b"Raspberry Pi 4 Model B Rev 1.4\0",
            "etc/os-release": b'PRETTY_NAME="Debian GNU/Linux 12"\nID=debian\nHOME_URL="x"\n',
        },
    )
    facts = machine.machine(tmp_path)
    assert facts["model"] == "Raspberry Pi 4 Model B Rev 1.4"
    assert facts["distribution"] == "Debian GNU/Linux 12, debian"


def test_environment_is_that_of_fmfts_alone() -> None:
    assert machine.environment({"FMFTS_BUS": "x", "HOME": "y", "GITHUB_TOKEN": "z"}) == {"FMFTS_BUS": "x"}


def test_log_keeps_its_end_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    program = tmp_path / "journalctl"
    program.write_text("#!/bin/sh\necho first\nseq 100000\necho last\n")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:/usr/bin:/bin")
    text = journal(200_000)
    assert len(text) == 200_000
    assert text.endswith("last\n")
    assert "first" not in text
    program.write_text("#!/bin/sh\necho 'No journal files were opened' >&2; exit 1\n")
    with pytest.raises(NoLogError, match=r"^No journal files were opened; if there is a service, join the group"):
        journal(200_000)


FACTS: dict[str, Any] = {"configuration": {"file": "/x", "text": "a = 1"}, "state": {}, "missing": []}


def report_of(path: Path, facts: dict[str, Any]) -> Path:
    writer = CopyWriter(path)
    write(writer, None, facts, SCRUBBER)
    writer.close()
    return path


def test_strangers_report_cannot_command_the_terminal(tmp_path: Path) -> None:
    facts = FACTS | {"log_of_service": "\x1b]0;gone\x07\x1b[2Jred", "missing": ["a\x1b[31m"], "bad\x9bkey": "b\u202ec"}
    shown = "\n".join(lines_of(report_of(tmp_path / "a.mcap", facts)))
    assert "red" in shown
    assert not set(shown) & {"\x1b", "\x07", "\x9b", "\u202e"}


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"[1]", "its facts are damaged"),
        (b"{" * 100_000, "its facts are damaged"),
        (b'{"a": "' + b"x" * LARGEST_FACTS + b'"}', "bytes: this program does not write as many"),
        (b'{"format": 1}', "its facts are not of this version"),
        (b'{"configuration": {}, "state": [3]}', "its facts are not of this version"),
    ],
    ids=["list", "nested", "large", "poor", "other"],
)
def test_damaged_facts_are_one_sentence(tmp_path: Path, data: bytes, message: str) -> None:
    writer = CopyWriter(tmp_path / "a.mcap")
    writer.attach(NAME, data)
    writer.finish()
    writer.close()
    with pytest.raises(RecordingError, match=message):
        list(lines_of(tmp_path / "a.mcap"))


def test_report_that_was_cut_off_is_whole_or_refused(tmp_path: Path) -> None:
    whole = report_of(tmp_path / "a.mcap", FACTS).read_bytes()
    cut = tmp_path / "cut.mcap"
    for size in range(0, len(whole), 7):
        cut.write_bytes(whole[:size])
        with suppress(RecordingError):
            assert facts_of(cut) == FACTS


def test_messages_are_scrubbed_and_others_left_out(tmp_path: Path) -> None:
    recording = tmp_path / "frames.mcap"
    writer = RecordingWriter(recording)
    event = {"pad": "zaphod", "boot": "1", "utc_ns": 5, "v": 1, "kind": "health", "t_ns": 1}
    writer.add("event", "zaphod", event | {"detail": "stale: /home/zaphod/x"})
    writer.finish()
    writer.close()
    out = CopyWriter(tmp_path / "r.mcap")
    write(out, recording, FACTS, SCRUBBER)
    out.close()
    (one,) = read(tmp_path / "r.mcap")
    assert one.pad == "zaphod"
    assert json.loads(msgspec.json.encode(one.message))["detail"] == "stale: ~/x"


def test_report_says_why_the_daemon_ended_that_it_had_started(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It ends after it has made its socket: the requests alone would say that there was no answer."""
    config = tmp_path / "pad.toml"
    config.write_text('[[pad]]\nname = "a"\nsource = { type = "simulated", finger = "none" }\n')

    @contextmanager
    def short_lived(_: Path, folder: Path, environment: dict[str, str]) -> Iterator[ChildDaemon]:
        (folder / "daemon.log").write_text("fmfts: it begins\nfmfts-daemon run: the disk is full\n")
        (folder / "bus").touch()
        with subprocess.Popen([sys.executable, "-c", ""]) as process:
            process.wait()
            yield ChildDaemon(process, folder / "bus")

    monkeypatch.setattr(gather, "child_daemon", short_lived)
    monkeypatch.setattr(gather, "named_base", lambda _: f"ipc://{tmp_path}/none")
    (tmp_path / "run").mkdir()
    gathering = gather.Gathering(config, 0.1, False, (), tmp_path / "run", lambda *_: None)
    gathering.facts()
    assert "the rest: a daemon started for the report ended while it was asked: fmfts-daemon run: the disk is full" in (
        gathering.missing
    )
