"""The examples that distinguish fingers, in C and in Python: both print the same for the same messages."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest

from background import repeating, started
from c_client.built import CLIENT, SANITIZED, build
from fmfts.bus.messages import ContactMessage, without_estimate
from fmfts.bus.publisher import Publisher
from fmfts_client import Endpoints
from unit.bus_messages import contact_message, finger_message, fingers_message, two_fingers

PERIOD_S = 0.02
PATIENCE_S = 120.0
PYTHON_EXAMPLE = CLIENT.parent / "python/examples/fingers.py"


@pytest.fixture(params=["c", "python"])
def command(request: pytest.FixtureRequest, tmp_path: Path) -> list[str]:
    if request.param == "python":
        return [sys.executable, str(PYTHON_EXAMPLE)]
    return [str(build(tmp_path / "fingers", "gcc", [CLIENT / "examples/fingers.c"], f"-I{CLIENT}", *SANITIZED))]


@contextmanager
def sending(base: str, make: Callable[[], ContactMessage]) -> Iterator[None]:
    publisher = Publisher(Endpoints.from_base(base), "b00t", pads=["demo"])
    with closing(publisher), repeating(lambda: publisher.send_contact("demo", make()), PERIOD_S):
        yield


def lost() -> ContactMessage:
    return without_estimate(fingers_message(*two_fingers()), health="lost", reason="no pose fits")


def test_example_says_which_fingers_touch(command: list[str], tmp_path: Path) -> None:
    base = f"ipc://{tmp_path}"
    environment = os.environ | {"FMFTS_BUS": base}
    wanted: dict[str, Callable[[], ContactMessage]] = {
        "finger 3 and finger 4": lambda: fingers_message(*two_fingers()),
        "finger 7": lambda: fingers_message(finger_message(7)),
        "more than two fingers": lambda: fingers_message(*two_fingers(), more=True),
        "cannot tell": lost,
        "no finger": fingers_message,
        "a pad with one magnet takes two fingers for one": contact_message,
    }
    with started([*command, "demo"], stdout=subprocess.PIPE, env=environment) as process:
        too_long = threading.Timer(PATIENCE_S, process.kill)
        too_long.daemon = True  # otherwise the tests would end only with the thread
        too_long.start()
        assert process.stdout is not None
        assert process.stdout.readline() == "nothing arrives\n"
        making: list[Callable[[], ContactMessage]] = [fingers_message]
        with sending(base, lambda: making[0]()):
            for words, make in wanted.items():
                making[0] = make
                lines = iter(process.stdout.readline, "")
                # What was sent before may still arrive, and a busy computer may pause for 0.3 s.
                said = next((line for line in lines if line.startswith(words)), f"not in {PATIENCE_S} s: {words}")
                assert said.strip().removesuffix(": no pose fits") == words
        assert process.stdout.readline() == "nothing arrives\n"
        too_long.cancel()
