"""The live view: what people see in a terminal, in a log, and what a program reads."""

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
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import msgspec
import pytest
from bus_messages import contact_message, event_message, pose_message, status_message
from rich.console import Console

from fmfts import exit_codes
from fmfts.bus.control import ControlServer
from fmfts.bus.messages import ContactMessage, encode
from fmfts.bus.publisher import Publisher
from fmfts.view.listen import listen
from fmfts.view.picture import as_svg, render_contact, tilt_deg
from fmfts.view.status import status
from fmfts.view.tally import Tally, now_line
from fmfts_client import Contact, Endpoints

LISTEN = "import sys; from fmfts.view.listen import listen; sys.exit(listen(endpoint=sys.argv[1], **eval(sys.argv[2])))"


def contact(**changes: Any) -> Contact:
    return Contact.from_message(msgspec.msgpack.decode(encode(contact_message(**changes))))


def drawn(one: Contact, compact: bool = False) -> list[str]:
    console = Console(file=io.StringIO(), width=80, color_system=None)
    with console.capture() as capture:
        console.print(render_contact(one, compact=compact))
    return capture.get().splitlines()


@contextmanager
def publishing(base: str, messages: Sequence[ContactMessage]) -> Iterator[None]:
    """A daemon's bus at 100 Hz: `messages` over and over, as if they came this moment."""
    done = threading.Event()
    publisher = Publisher(Endpoints.from_base(base), "boot")

    def loop() -> None:
        seq = 0
        while not done.wait(0.01):
            for each in tuple(messages):
                now_ns = time.monotonic_ns()
                stamped = msgspec.structs.replace(each, seq=seq, t_sample_ns=now_ns - 500_000, t_publish_ns=now_ns)
                publisher.send_contact(each.pad, stamped)
            seq += 1
            if seq % 20 == 0:
                publisher.send_status("demo", status_message(rate_nominal_hz=100.0))
                publisher.send_event("demo", event_message())

    thread = threading.Thread(target=loop)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()
        publisher.close()


@pytest.fixture
def base(tmp_path: Path) -> str:
    return f"ipc://{tmp_path}"


def test_contact_is_drawn_where_it_is() -> None:
    """One column a millimetre, one row two, x to the right and y up, inside a frame of one character."""
    rows = drawn(contact(x_m=0.010, y_m=0.008, force_n=1.0, pose=None))
    marked = [
        (column - 21, 11 - row) for row, text in enumerate(rows) for column, cell in enumerate(text) if cell == "●"
    ]
    assert marked
    columns, lines = zip(*marked, strict=True)
    assert sum(columns) / len(columns) == pytest.approx(10)
    assert sum(lines) / len(lines) == pytest.approx(4)


def test_harder_touch_is_drawn_larger_and_none_not_at_all() -> None:
    def size(**changes: Any) -> int:
        return "\n".join(drawn(contact(pose=None, **changes))).count("●")

    assert 0 < size(force_n=0.2) < size(force_n=2.0) < size(force_n=4.5)
    assert size(contact=False) == 0


def test_contact_beyond_the_edge_stays_in_the_picture() -> None:
    assert "●" in "\n".join(drawn(contact(x_m=0.5, y_m=-0.5)))


def test_figures_carry_unit_and_deviation() -> None:
    text = "\n".join(drawn(contact(pose=pose_message(axis=(0.1, 0.0, 0.99499)))))
    for figure in (
        "1.50 ± 0.05 N",
        "5.00 ± 0.20 mm",
        "10.500 ± 0.003 mm",
        "5.74 ± 0.13°",
        "1.230 ± 0.010 T",
        "1 2 3 4",
    ):
        assert figure in text


def test_over_range_is_a_lower_bound_and_never_looks_like_nothing() -> None:
    text = "\n".join(drawn(contact(over_range=True, force_n=None, force_min_n=3.25)))
    assert "more than 3.25 N" in text
    assert "▲" in text


def test_what_is_not_known_is_not_a_number() -> None:
    gone: dict[str, Any] = dict.fromkeys(("contact", "x_m", "y_m", "force_n", "pose", "temperature_c"))
    text = "\n".join(drawn(contact(health="no_baseline", reason="run fmfts-daemon baseline", **gone)))
    assert "not known" in text
    assert "no_baseline" in text
    assert "run fmfts-daemon" in text
    assert "0.00" not in text


@pytest.mark.parametrize("compact", [False, True])
def test_picture_fits_a_terminal_of_80_by_24(compact: bool) -> None:
    rows = drawn(contact(health="degraded", reason="sensor 3 does not answer", shear_x_n=0.1, shear_y_n=0.2), compact)
    assert max(map(len, rows)) <= 80
    assert len(rows) <= 23


def test_tilt_is_the_angle_to_the_normal() -> None:
    assert tilt_deg((0.0, 0.0, 1.0)) == 0.0
    assert tilt_deg((0.0, 0.70711, 0.70711)) == pytest.approx(45.0)
    assert tilt_deg((0.1, 0.0, -0.995)) == pytest.approx(5.739, abs=1e-3)


def test_svg_needs_no_network() -> None:
    svg = as_svg(render_contact(contact()), "listen")
    assert svg.startswith("<svg")
    assert "●" in svg
    assert "url(" not in svg.replace("url(#", "")
    assert re.findall(r"https?://[^\"\s<]+", svg.replace("http://www.w3.org/2000/svg", "")) in (
        [],
        ["https://www.textualize.io"],
    )


def test_summary_counts_what_was_lost_felt_and_missing() -> None:
    tally = Tally("demo")
    start = time.monotonic_ns()
    for seq, touched, force_n, health in (
        (0, False, 0.0, "ok"),
        (1, True, 1.0, "ok"),
        (4, True, 2.5, "ok"),
        (5, False, 0.0, "stale"),
        (6, True, 0.5, "ok"),
    ):
        sent = start + seq * 100_000_000
        latency_ns = (seq + 1) * 1_000_000
        tally.add(
            contact(
                seq=seq,
                contact=touched,
                force_n=force_n,
                health=health,
                t_publish_ns=sent,
                t_sample_ns=sent - latency_ns,
            )
        )
    facts = tally.facts()
    assert (facts["messages"], facts["lost"], facts["touches"], facts["largest_force_n"]) == (5, 2, 2, 2.5)
    assert (facts["latency_p50_s"], facts["latency_max_s"]) == (pytest.approx(0.005), pytest.approx(0.007))
    assert facts["rate_hz"] == pytest.approx(4 / 0.6)
    assert facts["health_s"] == {
        "ok": pytest.approx(0.2),
        "nothing arrived": pytest.approx(0.3),
        "stale": pytest.approx(0.1),
    }
    assert "2 touches, hardest 2.50 N" in tally.sentence()


def test_pad_that_was_never_sampled_has_no_latency() -> None:
    tally = Tally("demo")
    tally.add(contact(t_publish_ns=time.monotonic_ns(), t_sample_ns=0, health="disconnected"))
    assert tally.facts()["latency_max_s"] is None
    assert "sampled" not in now_line(tally)


def test_old_news_are_shown_as_silence() -> None:
    tally = Tally("demo")
    tally.add(contact(t_publish_ns=time.monotonic_ns() - 1_000_000_000))
    assert now_line(tally) == "demo: nothing arrives"


def test_lines_once_a_second_where_there_is_no_terminal(base: str) -> None:
    out = io.StringIO()
    with publishing(base, [contact_message(), contact_message(pad="other", contact=False)]):
        assert listen(None, 2.2, out, endpoint=base) == 0
    lines = out.getvalue().splitlines()
    touched = [line for line in lines if line.startswith("demo: ok  1.50 N at (+5.0, +3.0) mm")]
    assert 1 <= len(touched) <= 3
    assert any(line.startswith("other: ok  no contact") for line in lines)
    assert any(line.startswith("pad demo: ") and "0 lost" in line and "1 touches" in line for line in lines)


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
    assert f"nothing arrived from {base}/bus: is fmfts-daemon running?" in out.getvalue()


def test_endpoint_that_is_none_is_named(caplog: pytest.LogCaptureFixture) -> None:
    assert listen(None, 0.2, io.StringIO(), endpoint="nonsense") == exit_codes.UNAVAILABLE
    assert "'nonsense' is no base of endpoints" in caplog.text


def in_terminal(
    base: str, options: str, signal_after_s: float | None = None, number: int = signal.SIGINT
) -> tuple[str, int]:
    """What a terminal of 100 × 30 shows, and the exit code."""
    master, slave = pty.openpty()
    fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 30, 100, 0, 0))
    environ = os.environ | {"TERM": "xterm-256color"}
    process = subprocess.Popen(
        [sys.executable, "-c", LISTEN, base, options], stdin=slave, stdout=slave, stderr=slave, env=environ
    )
    os.close(slave)
    shown, started = b"", time.monotonic()
    while time.monotonic() - started < 20:
        if signal_after_s is not None and b"pad demo" in shown and time.monotonic() - started > signal_after_s:
            process.send_signal(number)
            signal_after_s = None
        if select.select([master], [], [], 0.1)[0]:
            try:
                shown += os.read(master, 65536)
            except OSError:  # Linux: the other end is closed
                break
    os.close(master)
    return shown.decode(), process.wait(10)


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


def test_reader_that_has_seen_enough_is_no_error(base: str) -> None:
    with publishing(base, [contact_message()]):
        command = [sys.executable, "-c", LISTEN, base, "{'as_json': True}"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
            assert process.stdout is not None
            assert process.stderr is not None
            process.stdout.readline()
            process.stdout.close()
            assert (process.wait(10), process.stderr.read()) == (0, b"")


@contextmanager
def serving_status(base: str, *pads: Any) -> Iterator[None]:
    done = threading.Event()
    server = ControlServer(f"{base}/control")

    def loop() -> None:
        while not done.wait(0.005):
            for request in server.poll():
                request.reply(pads=list(pads))

    thread = threading.Thread(target=loop)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()
        server.close()


def test_pad_that_the_daemon_does_not_have_is_named(base: str) -> None:
    out = io.StringIO()
    with serving_status(base, {"pad": "left"}, {"pad": "right"}):
        assert listen("nobody", 0.1, out, endpoint=base) == exit_codes.UNAVAILABLE
    assert out.getvalue().splitlines() == [
        f"waiting for pad nobody on {base}/bus …",
        f"nothing arrived from {base}/bus: no pad 'nobody'; the daemon there has left, right",
    ]


def test_status_is_a_column_for_each_pad(base: str) -> None:
    out = io.StringIO()
    bad = status_message(pad="left", health="disconnected", reason="no such port [by-id]", connected=False)
    with serving_status(base, status_message(), bad):
        assert status(out=out, endpoint=base) == 0
    for part in ("demo", "left", "219.6 of 220 Hz", "disconnected", "[by-id]", "2 never", "0.50/1.00/2.00 ms"):
        assert part in out.getvalue(), part


def test_status_for_programs_is_the_message_itself(base: str) -> None:
    out = io.StringIO()
    with serving_status(base, status_message()):
        assert status(as_json=True, out=out, endpoint=base) == 0
    assert json.loads(out.getvalue())["pads"][0]["latency_p99_s"] == 0.001


def test_status_without_a_daemon_says_so(
    base: str, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fmfts.view.status.TIMEOUT_S", 0.1)
    assert status(out=io.StringIO(), endpoint=base) == exit_codes.UNAVAILABLE
    assert "is fmfts-daemon running" in caplog.text


GRIPPER = Path(__file__).parents[2] / "clients/python/examples/gripper.py"


def test_gripper_opens_on_force_overload_bad_health_and_silence(base: str) -> None:
    gentle = contact_message(force_n=0.5)
    reasons = {
        "OPEN (1.50 N)": contact_message(force_n=1.5),
        "OPEN (at least 3.0 N, beyond what the pad can measure)": contact_message(
            over_range=True, force_n=None, force_min_n=3.0
        ),
        "OPEN (disturbed: steel)": contact_message(force_n=0.5, health="disturbed", reason="steel"),
        "OPEN (no trustworthy force)": contact_message(contact=None, force_n=None),
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
