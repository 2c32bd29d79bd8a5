"""The live view: what people see in a terminal, in a log, and what a program reads."""

from __future__ import annotations

import io
import time
from typing import Any

import msgspec
import pytest
from bus_messages import contact_message, pose_message, status_message
from rich.console import Console

from fmfts.bus.encoding import encode
from fmfts.view.picture import render_contact, tilt_deg
from fmfts.view.tally import Tally, now_line
from fmfts_client import Contact, Status


def contact(**changes: Any) -> Contact:
    return Contact.from_message(msgspec.msgpack.decode(encode(contact_message(**changes))))


def drawn(one: Contact, compact: bool = False) -> list[str]:
    console = Console(file=io.StringIO(), width=80, color_system=None)
    with console.capture() as capture:
        console.print(render_contact(one, compact=compact))
    return capture.get().splitlines()


def test_contact_is_drawn_at_its_place() -> None:
    """One column a millimetre, one row two, x to the right and y up, inside a frame of one character."""
    rows = drawn(contact(x_m=0.010, y_m=0.008, force_n=1.0, pose=None))[:-1]  # the last one is the legend
    marked = [
        (column - 21, 11 - row) for row, text in enumerate(rows) for column, cell in enumerate(text) if cell == "●"
    ]
    assert marked
    columns, lines = zip(*marked, strict=True)
    assert sum(columns) / len(columns) == pytest.approx(10)
    assert sum(lines) / len(lines) == pytest.approx(4)


def test_harder_touch_is_drawn_larger_and_no_touch_is_not_drawn() -> None:
    def size(**changes: Any) -> int:
        return "\n".join(drawn(contact(pose=None, **changes))[:-1]).count("●")

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


def test_over_range_shows_a_lower_bound() -> None:
    text = "\n".join(drawn(contact(over_range=True, force_n=None, force_min_n=3.25)))
    assert "more than 3.25 N" in text
    assert "▲" in text


def test_unknown_values_are_not_shown_as_numbers() -> None:
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


def test_summary_counts_what_was_lost_detected_and_missing() -> None:
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


def test_summary_of_an_unplugged_pad_says_why_and_tells_no_latency() -> None:
    tally, sent = Tally("demo"), time.monotonic_ns()
    for seq in range(3):
        after = contact(
            seq=seq,
            health="disconnected",
            reason="the port does not exist (is the board plugged in?)",
            t_publish_ns=sent + seq * 50_000_000,
            t_sample_ns=sent - 1_851_000_000,
        )
        tally.add(after)
    assert tally.facts()["latency_max_s"] is None
    assert tally.sentence().endswith("\ndisconnected: the port does not exist (is the board plugged in?)")


def test_pad_that_was_never_sampled_has_no_latency() -> None:
    tally = Tally("demo")
    tally.add(contact(t_publish_ns=time.monotonic_ns(), t_sample_ns=0, health="disconnected"))
    assert tally.facts()["latency_max_s"] is None
    assert "sampled" not in now_line(tally)


@pytest.mark.parametrize(("health", "is_shown"), [("ok", True), ("stale", False), ("disconnected", False)])
def test_messages_without_a_frame_have_no_rate(health: str, is_shown: bool) -> None:
    tally, now_ns = Tally("demo"), time.monotonic_ns()
    for seq in range(5):
        tally.add(contact(seq=seq, t_publish_ns=now_ns - (4 - seq) * 10_000_000, health=health))
    assert ("100.0 Hz" in now_line(tally)) is is_shown


def test_old_messages_are_shown_as_silence() -> None:
    tally = Tally("demo")
    tally.add(contact(t_publish_ns=time.monotonic_ns() - 1_000_000_000))
    assert now_line(tally) == "demo: nothing arrives"


SENSORS_M = [(0.008, 0.008), (0.008, -0.008), (-0.008, 0.008), (-0.008, -0.008)]


def whole(width: int, **changes: Any) -> list[str]:
    """All that `listen` draws of a pad, on a terminal of that width."""
    status = Status.from_message(msgspec.msgpack.decode(encode(status_message(source="simulated pad, seed 1"))))
    console = Console(file=io.StringIO(), width=width, color_system=None)
    with console.capture() as capture:
        console.print(render_contact(contact(**changes), status, 219.9, 0.001, False, width, SENSORS_M))
    return capture.get().splitlines()


def test_picture_has_legend_scale_sensors_and_source() -> None:
    text = "\n".join(whole(100, x_m=0.0, y_m=0.0))
    marks = (
        "● contact",
        "▒ magnet",
        "□ sensor",
        "10 mm",
        "pad demo: simulated pad, seed 1",
    )
    for part in marks:
        assert part in text
    surface = [line[:43] for line in text.splitlines()[:22]]
    places = [(at - 21, 11 - row) for row, line in enumerate(surface) for at, cell in enumerate(line) if cell == "□"]
    assert sorted(places) == [(-8, -4), (-8, 4), (8, -4), (8, 4)]


@pytest.mark.parametrize("width", range(40, 101))
def test_picture_fits_the_terminal_with_a_whole_frame(width: int) -> None:
    lines = whole(width)
    assert max(map(len, lines)) <= width
    assert {len(line) for line in lines} == {len(lines[0])}
    assert lines[0].startswith("╭")
    assert all(line.startswith("│") and line.endswith("│") for line in lines[1:-1])
    assert "1.50 ± 0.05 N" in "\n".join(lines)
