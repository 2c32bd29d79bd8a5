"""The example controllers, built as users build them, on a pad that the running daemon simulates."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import pytest

from c_client.built import CLIENT, HERE, NEW, SANITIZED, STRICT, Talker, build, ended, need, pkg_config, run
from end_to_end.processes import RunningDaemon
from fmfts.bus.publisher import Publisher
from fmfts_client import Endpoints
from unit.bus_messages import BOOT, contact_message

PRESSED_CONFIG = """
[[pad]]
name = "left"
[pad.source]
type = "simulated"
turning_deg_per_s = 0.0
"""
PATIENCE_S = 60.0
TRIES = 5
PYTHON = {".py": [sys.executable], "": []}
LONG_AFTER_S = 0.5  # a gripper notices that the daemon stopped


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The client under a prefix of its own, as `make install-c-client` puts it."""
    folder = tmp_path_factory.mktemp("installed")
    need("cmake")
    pkg_config("--exists", "libzmq")
    run(
        [
            "cmake",
            "-S",
            CLIENT,
            "-B",
            folder / "build",
            f"-DCMAKE_INSTALL_PREFIX={folder}/usr",
            "-DCMAKE_INSTALL_LIBDIR=lib",
        ]
    )
    run(["cmake", "--build", folder / "build"])
    run(["cmake", "--install", folder / "build"])
    return folder / "usr"


@pytest.fixture(scope="module")
def with_cmake(installed: Path) -> Path:
    """Where the examples are, built by find_package."""
    folder = installed.parent / "examples"
    run(["cmake", "-S", CLIENT / "examples", "-B", folder, f"-DCMAKE_PREFIX_PATH={installed}"])
    run(["cmake", "--build", folder])
    return folder


@pytest.fixture(scope="module")
def daemon(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningDaemon]:
    """The simulated pad records its baselines at once, and the script presses it."""
    with RunningDaemon(tmp_path_factory.mktemp("daemon"), PRESSED_CONFIG) as daemon:
        yield daemon


class Gripper:
    """A running example; `lines` has its output so far."""

    def __init__(self, program: Path, environment: dict[str, str]) -> None:
        self.lines: list[str] = []
        self._said = b""
        self._process = subprocess.Popen(
            [*PYTHON[program.suffix], program, "left"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=environment
        )
        assert self._process.stdout is not None
        os.set_blocking(self._process.stdout.fileno(), False)

    def says(self, *wanted: str) -> None:
        """Wait for new lines that contain these, in any order."""
        since, until = len(self.lines), time.monotonic() + PATIENCE_S
        while not all(any(words in line for line in self.lines[since:]) for words in wanted):
            assert self._process.poll() is None, self.lines
            assert time.monotonic() < until, self.lines
            time.sleep(0.02)
            self.listen()

    def ends_with(self, word: str) -> None:
        """Wait until its last line begins with this."""
        until = time.monotonic() + PATIENCE_S
        while not self.lines[-1].startswith(word):
            assert time.monotonic() < until, self.lines
            time.sleep(0.02)
            self.listen()

    def listen(self) -> None:
        """Take the lines that it has printed."""
        assert self._process.stdout is not None
        self._said += self._process.stdout.read() or b""
        self.lines = self._said.decode().splitlines()

    def __enter__(self) -> Gripper:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.terminate()
        _, said = ended(self._process)
        assert b"ERROR" not in said, said.decode()


@pytest.mark.parametrize(
    ("name", "pressed"), [("gripper", "OPEN (pressed with "), ("gripper-cpp", "OPEN (pressed with ")]
)
def test_gripper_opens_when_pad_is_pressed_and_when_daemon_hangs(
    with_cmake: Path, daemon: RunningDaemon, name: str, pressed: str
) -> None:
    with Gripper(with_cmake / name, daemon.environment) as gripper:
        gripper.says(pressed)
        for _ in range(TRIES):
            gripper.says("CLOSE")
            daemon.process.send_signal(signal.SIGSTOP)
            try:
                # If the pad was pressed just before, the gripper is already open and prints nothing more: then try once
                # again.
                gripper.ends_with("OPEN")
                time.sleep(LONG_AFTER_S)
                gripper.listen()
                assert gripper.lines[-1].startswith("OPEN"), gripper.lines
            finally:
                daemon.process.send_signal(signal.SIGCONT)
            if gripper.lines[-1] == "OPEN (nothing arrives)":
                break
        else:
            pytest.fail(f"it never says that nothing arrives: {gripper.lines}")
        gripper.says("CLOSE")


def test_gripper_says_why_it_stays_open_without_a_baseline(with_cmake: Path, tmp_path: Path) -> None:
    publisher = Publisher(Endpoints.from_base(f"ipc://{tmp_path}"), BOOT)
    unknown = {"health": "no_baseline", "reason": "no baseline: record --rest", "contact": None, "force_n": None}
    try:
        with Gripper(with_cmake / "gripper", os.environ | {"FMFTS_BUS": f"ipc://{tmp_path}"}) as gripper:
            gripper.says("OPEN (nothing arrives)")
            until = time.monotonic() + PATIENCE_S
            while not any("no_baseline: no baseline: record --rest" in line for line in gripper.lines):
                publisher.send_contact("left", contact_message(pad="left", **unknown))
                assert time.monotonic() < until, gripper.lines
                time.sleep(0.02)
                gripper.listen()
    finally:
        publisher.close()


@pytest.mark.parametrize("name", ["gripper", "gripper-cpp", "gripper.py"])
def test_gripper_prints_each_reason_once_whatever_its_numbers(with_cmake: Path, tmp_path: Path, name: str) -> None:
    program = CLIENT.parent / "python/examples" / name if name.endswith(".py") else with_cmake / name
    publisher = Publisher(Endpoints.from_base(f"ipc://{tmp_path}"), BOOT)
    reasons: dict[str, list[dict[str, object]]] = {
        "the pad is pressed harder": [{"over_range": True}],
        "the force is not known": [{"force_n": None}],
        "pressed with ": [{"force_n": 2.0}, {"force_n": 12.34}],
    }
    try:
        with Gripper(program, os.environ | {"FMFTS_BUS": f"ipc://{tmp_path}"}) as gripper:
            gripper.says("OPEN (nothing arrives)")
            for reason, contacts in reasons.items():
                until = time.monotonic() + PATIENCE_S
                while f"OPEN ({reason}" not in gripper.lines[-1]:
                    publisher.send_contact("left", contact_message(pad="left", **contacts[0]))
                    assert time.monotonic() < until, gripper.lines
                    time.sleep(0.02)
                    gripper.listen()
                lines = len(gripper.lines) - 1  # the last of which says it
                for number in range(10):
                    publisher.send_contact("left", contact_message(pad="left", **contacts[number % len(contacts)]))
                    time.sleep(0.02)
                gripper.listen()
                # Again only after another line, which it prints if this computer stood still.
                said = [reason in line for line in gripper.lines[lines:]]
                assert not any(map(all, pairwise(said)))
    finally:
        publisher.close()


@pytest.mark.parametrize(
    ("compiler", "standard", "source"), [("gcc", "-std=c11", "gripper.c"), ("g++", "-std=c++17", "gripper.cpp")]
)
def test_gripper_built_by_pkg_config_opens_when_nothing_arrives(
    installed: Path, tmp_path: Path, compiler: str, standard: str, source: str
) -> None:
    surroundings = os.environ | {"PKG_CONFIG_PATH": str(installed / "lib/pkgconfig")}
    flags = pkg_config("--cflags", "--libs", "fmfts", environment=surroundings)
    warnings = [flag for flag in STRICT if not flag.startswith("-std")]
    gripper = tmp_path / "gripper"
    run([need(compiler), standard, *warnings, *SANITIZED, CLIENT / "examples" / source, *flags, "-o", gripper])
    silent = os.environ | {"FMFTS_BUS": f"ipc://{tmp_path}"}
    with Gripper(gripper, silent) as running:
        running.says("OPEN (nothing arrives)")


def test_example_of_readme_compiles_against_installed_client(installed: Path, tmp_path: Path) -> None:
    (code,) = re.findall(r"^```c\n(.*?)^```", (CLIENT / "README.md").read_text(), re.DOTALL | re.MULTILINE)
    (tmp_path / "example.c").write_text(code)
    surroundings = os.environ | {"PKG_CONFIG_PATH": str(installed / "lib/pkgconfig")}
    flags = pkg_config("--cflags", "--libs", "fmfts", environment=surroundings)
    run([need("clang"), *STRICT, tmp_path / "example.c", *flags, "-o", tmp_path / "example"])


def test_c_client_receives_the_daemon_as_the_python_client_does(daemon: RunningDaemon, tmp_path: Path) -> None:
    program = build(tmp_path / "listen", "gcc", [HERE / "listen.c", HERE / "shown.c"], *SANITIZED)
    in_c, in_python, both = {}, {}, set[int]()
    with daemon.subscribe("contact") as messages, Talker(program, "left", daemon.base) as client:
        until = time.monotonic() + PATIENCE_S
        while len(both) < 50 and time.monotonic() < until:  # on a busy computer each hears other messages
            answer = client.latest(1000)
            if answer["result"] == NEW:
                in_c[answer["seq"]] = answer
            while (message := messages.receive(0.0)) is not None:
                in_python[message.body["seq"]] = message.body
            both = in_c.keys() & in_python.keys()
    for seq in both:
        wanted = {name: value for name, value in in_python[seq].items() if name != "v"}
        assert {name: in_c[seq][name] for name in wanted} == wanted
    assert len(both) >= 50
    assert answer["refused"] == 0
