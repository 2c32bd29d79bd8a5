"""What `listen` and `status` print, to a terminal, to a log, and to programs; and the example of a controller."""

from __future__ import annotations

import fcntl
import io
import json
import os
import pty
import re
import select
import signal
import struct
import subprocess
import sys
import termios
import time
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from itertools import count
from pathlib import Path
from typing import Any

import msgspec
import pytest
from bus_messages import contact_message, event_message, status_message

from background import repeating
from fmfts.bus.control import ControlServer
from fmfts.bus.lock import EndpointLock
from fmfts.bus.messages import ContactMessage
from fmfts.bus.publisher import Publisher
from fmfts.cli.main import main
from fmfts.common import exit_codes
from fmfts.view.listen import _event_line, listen
from fmfts.view.status import status
from fmfts_client import SCHEMA_VERSION, Endpoints, Message

LISTEN = "import sys; from fmfts.view.listen import listen; sys.exit(listen(endpoint=sys.argv[1], **eval(sys.argv[2])))"


@contextmanager
def publishing(base: str, messages: Sequence[ContactMessage]) -> Iterator[None]:
    """A daemon's bus at 100 Hz: `messages` over and over, as if they came this moment."""
    publisher, numbers = Publisher(Endpoints.from_base(base), "boot"), count()

    def publish() -> None:
        seq = next(numbers)
        for each in tuple(messages):
            now_ns = time.monotonic_ns()
            stamped = msgspec.structs.replace(each, seq=seq, t_sample_ns=now_ns - 500_000, t_publish_ns=now_ns)
            publisher.send_contact(each.pad, stamped)
        if seq % 20 == 19:
            publisher.send_status("demo", status_message(rate_nominal_hz=100.0))
            publisher.send_event("demo", event_message())

    with closing(publisher), repeating(publish, 0.01):
        yield


@pytest.fixture
def base(tmp_path: Path) -> str:
    return f"ipc://{tmp_path}"


def test_lines_once_a_second_where_there_is_no_terminal(base: str) -> None:
    out = io.StringIO()
    with publishing(base, [contact_message(), contact_message(pad="other", contact=False)]):
        assert listen(None, 2.2, out, endpoint=base) == 0
    lines = out.getvalue().splitlines()
    touched = [line for line in lines if line.startswith("demo: ok  1.50 ± 0.05 N at (+5.0, +3.0) mm")]
    assert 1 <= len(touched) <= 3
    assert any(line.startswith("other: ok  no contact") for line in lines)
    assert any(line.startswith("pad demo: ") and "0 lost" in line and "1 touches" in line for line in lines)


@pytest.mark.parametrize(
    ("kind", "detail", "line"),
    [
        ("health", "lost: no pose fits", "demo: health lost: no pose fits"),
        ("overload", "this computer is overloaded: 5 %", "demo: this computer is overloaded: 5 %"),
        ("rejected", "a frame is rejected: it is older", "demo: a frame is rejected: it is older"),
        ("of_a_later_daemon", "", "demo: of_a_later_daemon"),
    ],
)
def test_line_of_an_event_names_its_kind(kind: str, detail: str, line: str) -> None:
    body = {**msgspec.to_builtins(event_message(detail=detail)), "v": SCHEMA_VERSION, "kind": kind}
    assert _event_line(Message("event", "demo", body, 0.0)) == line


def test_json_is_one_object_for_each_message(base: str) -> None:
    out = io.StringIO()
    with publishing(base, [contact_message()]):
        assert listen("demo", 1.0, out, endpoint=base, as_json=True) == 0
    objects = [json.loads(line) for line in out.getvalue().splitlines()]
    assert {each["topic"] for each in objects} == {"contact/demo", "status/demo", "event/demo", "summary"}
    assert next(each["force_n"] for each in objects if each["topic"] == "contact/demo") == 1.5
    assert objects[-1]["pads"][0]["messages"] == sum(each["topic"] == "contact/demo" for each in objects)


def test_silence_ends_with_a_hint_and_an_exit_code(base: str) -> None:
    out = io.StringIO()
    before = signal.getsignal(signal.SIGTERM)
    assert listen(None, 0.2, out, endpoint=base) == exit_codes.UNAVAILABLE
    assert signal.getsignal(signal.SIGTERM) is before
    assert f"nothing arrived from {base}/bus: is fmfts-daemon running" in out.getvalue()


def test_invalid_endpoint_is_named(caplog: pytest.LogCaptureFixture) -> None:
    assert listen(None, 0.2, io.StringIO(), endpoint="nonsense") == exit_codes.UNAVAILABLE
    assert "'nonsense' is not a base of endpoints" in caplog.text


def in_terminal(
    base: str, options: str, signal_after_s: float | None = None, number: int = signal.SIGINT
) -> tuple[str, int]:
    """The picture in a terminal of 100 × 30, and the exit code."""
    master, slave = pty.openpty()
    fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 30, 100, 0, 0))
    environ = os.environ | {"TERM": "xterm-256color"}
    process = subprocess.Popen(
        [sys.executable, "-c", LISTEN, base, options],
        stdin=slave,
        stdout=slave,
        stderr=slave,
        env=environ,
        preexec_fn=lambda: signal.signal(number, signal.SIG_DFL),  # a shell's background jobs ignore Ctrl-C
    )
    os.close(slave)
    shown, started = b"", time.monotonic()
    while time.monotonic() - started < 60:
        if signal_after_s is not None and b"pad demo" in shown and time.monotonic() - started > signal_after_s:
            process.send_signal(number)
            signal_after_s = None
        if select.select([master], [], [], 0.1)[0]:
            try:
                shown += os.read(master, 65536)
            except OSError:  # Linux: the other end is closed
                break
    os.close(master)
    return shown.decode(), process.wait(60)


def test_terminal_shows_the_picture_and_then_a_summary(base: str) -> None:
    with publishing(base, [contact_message()]):
        shown, code = in_terminal(base, "{'seconds': 1.5}")
    assert code == 0
    for part in (
        "pad demo",
        "●",
        "▒",
        "1.50 ± 0.05 N",
        "of 100 Hz",
        "0.50 ms to publish",
        "ms to here",
        "demo: onset 1.5 N",
    ):
        assert part in shown, part
    assert re.search(r"pad demo: \d+ messages; [\d.]+ Hz; 0 lost", shown)
    assert shown.rindex("\x1b[?25h") > shown.rindex("\x1b[?25l"), "the cursor is back"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_and_kill_end_cleanly_with_the_summary(base: str, number: int) -> None:
    with publishing(base, [contact_message()]):
        shown, code = in_terminal(base, "{}", signal_after_s=1.0, number=number)
    assert shown.rindex("\x1b[?25h") > shown.rindex("\x1b[?25l"), "the cursor is back"
    assert code == 0
    assert "Traceback" not in shown
    assert re.search(r"pad demo: \d+ messages", shown)


def test_closed_pipe_is_no_error(base: str) -> None:
    with publishing(base, [contact_message()]):
        command = [sys.executable, "-c", LISTEN, base, "{'as_json': True}"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
            assert process.stdout is not None
            assert process.stderr is not None
            process.stdout.readline()
            process.stdout.close()
            assert (process.wait(60), process.stderr.read()) == (0, b"")


@contextmanager
def serving_status(base: str, *pads: Any) -> Iterator[None]:
    server = ControlServer(f"{base}/control")

    def answer() -> None:
        while server.serve_one(lambda request: request.reply(pads=list(pads))):
            pass

    with closing(server), repeating(answer, 0.005):
        yield


def test_mistyped_pad_is_reported_by_a_daemon_that_was_too_busy_at_first(
    base: str, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fmfts.view.listen.ASK_AGAIN_S", 0.1)
    monkeypatch.setattr("fmfts.view.silence.ANSWER_S", 0.2)
    server, asked = ControlServer(f"{base}/control"), count()

    def answer() -> None:
        """The first two requests time out."""
        while server.serve_one(lambda request: next(asked) < 2 or request.reply(pads=[{"pad": "left"}])):
            pass

    with closing(server), repeating(answer, 0.005):
        assert listen("lef", 60.0, io.StringIO(), endpoint=base) == exit_codes.USAGE
    assert "'left'" in caplog.text
    assert next(asked) >= 3


def test_mistyped_pad_is_reported_with_the_intended_one(base: str, caplog: pytest.LogCaptureFixture) -> None:
    out = io.StringIO()
    with serving_status(base, {"pad": "left"}, {"pad": "right"}):
        assert listen("lef", None, out, endpoint=base) == exit_codes.USAGE  # None: otherwise it would listen for ever
    assert out.getvalue() == ""
    assert [record.message for record in caplog.records] == [
        "no pad 'lef' here; this daemon has 'left', 'right'; did you mean 'left'?"
    ]


def test_status_is_a_column_for_each_pad(base: str) -> None:
    out = io.StringIO()
    bad = status_message(pad="left", health="disconnected", reason="no such port [by-id]", connected=False)
    with serving_status(base, status_message(), bad):
        assert status(out=out, endpoint=base) == 0
    for part in ("demo", "left", "219.6 of 220 Hz", "disconnected", "[by-id]", "2 never", "0.50/1.00/2.00 ms"):
        assert part in out.getvalue(), part


def test_status_of_one_pad_leaves_out_the_others(base: str, caplog: pytest.LogCaptureFixture) -> None:
    out = io.StringIO()
    with serving_status(base, status_message(pad="left"), status_message(pad="right")):
        assert status("left", as_json=True, out=out, endpoint=base) == 0
        assert status("lefd", endpoint=base) == exit_codes.USAGE
    assert [one["pad"] for one in json.loads(out.getvalue())["pads"]] == ["left"]
    assert "no pad 'lefd' here; this daemon has 'left', 'right'; did you mean 'left'?" in caplog.text


def test_status_for_programs_is_the_message_itself(base: str) -> None:
    out = io.StringIO()
    with serving_status(base, status_message()):
        assert status(as_json=True, out=out, endpoint=base) == 0
    assert json.loads(out.getvalue())["pads"][0]["latency_p99_s"] == 0.001


def test_status_without_a_daemon_says_how_to_start_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("FMFTS_BUS", f"ipc://{tmp_path}")
    monkeypatch.setattr("fmfts.view.status.TIMEOUT_S", 0.5)
    assert main(["status"]) == exit_codes.UNAVAILABLE
    told = capsys.readouterr().err
    assert f"no fmfts-daemon runs on ipc://{tmp_path}/control: start it with `fmfts-daemon run" in told
    lock = EndpointLock(f"ipc://{tmp_path}/control")
    assert main(["status"]) == exit_codes.UNAVAILABLE
    lock.release()
    assert f"no answer from ipc://{tmp_path}/control for 0.5 s" in capsys.readouterr().err


def test_status_says_that_no_daemon_answers(
    base: str, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fmfts.view.status.TIMEOUT_S", 0.1)
    assert status(out=io.StringIO(), endpoint=base) == exit_codes.UNAVAILABLE
    assert "is fmfts-daemon running" in caplog.text


GRIPPER = Path(__file__).parents[2] / "clients/python/examples/gripper.py"


def test_gripper_opens_on_force_overload_bad_health_and_silence(base: str) -> None:
    gentle = contact_message(force_n=0.5)
    reasons = {
        "OPEN (pressed with 1.50 N)": contact_message(force_n=1.5),
        "OPEN (the pad is pressed harder than its contact model knows)": contact_message(
            over_range=True, force_n=None, force_min_n=3.0
        ),
        "OPEN (disturbed: steel)": contact_message(force_n=0.5, health="disturbed", reason="steel"),
        "OPEN (the force is 0.90 ± 0.800 N, less certain than ± 0.500 N: `fmfts-daemon baseline --turn` and `weigh` "
        "make it more certain)": contact_message(force_n=0.9, force_sd_n=0.8),
    }
    environ = os.environ | {"FMFTS_BUS": base}
    with subprocess.Popen([sys.executable, GRIPPER, "demo"], stdout=subprocess.PIPE, text=True, env=environ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "OPEN (nothing arrives)\n"
        messages = [gentle]
        with publishing(base, messages):
            for reason, message in reasons.items():
                said = "OPEN (nothing arrives)"
                while said == "OPEN (nothing arrives)":  # a busy machine may pause for 0.3 s
                    messages[:] = [gentle]
                    assert process.stdout.readline() == "CLOSE\n"
                    messages[:] = [message]
                    said = process.stdout.readline().strip()
                assert said == reason
            messages[:] = [gentle]
            assert process.stdout.readline() == "CLOSE\n"
        assert process.stdout.readline() == "OPEN (nothing arrives)\n"
        process.terminate()
