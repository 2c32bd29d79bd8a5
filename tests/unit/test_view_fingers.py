"""What a terminal shows of a pad with several magnets: every finger, and no finger where there is none."""

from __future__ import annotations

import io
from typing import Any

import msgspec
import pytest
from bus_messages import contact_message, finger_message, fingers_message, two_fingers
from rich.console import Console

from fmfts.bus.encoding import encode
from fmfts.bus.messages import ContactMessage
from fmfts.view.picture import render_contact
from fmfts.view.tally import Tally, now_line
from fmfts_client import Contact

FAR = finger_message(13, x_m=-0.010, y_m=0.008, force_n=0.5), finger_message(14, x_m=0.010, y_m=-0.008, force_n=1.0)


def received(message: ContactMessage) -> Contact:
    return Contact.from_message(msgspec.msgpack.decode(encode(message)))


def drawn(message: ContactMessage) -> list[str]:
    console = Console(file=io.StringIO(), width=80, color_system=None)
    with console.capture() as capture:
        console.print(render_contact(received(message)))
    return capture.get().splitlines()


def places(rows: list[str], marks: str) -> list[tuple[int, int]]:
    """Column and row of the marks on the surface, which is 41 columns wide; the last line is the legend."""
    return [
        (column - 21, 11 - row)
        for row, text in enumerate(rows[:-1])
        for column, cell in enumerate(text[:42])
        if cell in marks
    ]


def middle(found: list[tuple[int, int]]) -> tuple[float, float]:
    return sum(column for column, _ in found) / len(found), sum(row for _, row in found) / len(found)


def test_two_fingers_draw_two_numbered_spots() -> None:
    rows = drawn(fingers_message(*FAR, poses=None))
    assert places(rows, "3") == [(-10, 4)], "the last digit stands in the middle of the spot"
    assert places(rows, "4") == [(10, -4)]
    spots = places(rows, "●34")
    left, right = [each for each in spots if each[0] < 0], [each for each in spots if each[0] > 0]
    assert middle(left) == pytest.approx((-10, 4))
    assert middle(right) == pytest.approx((10, -4))
    assert all(abs(column) > 7 for column, _ in spots), "the resultant, at (3, -3) mm, is nowhere"
    assert len(left) < len(right), "the harder finger is larger"


def test_each_magnet_is_drawn() -> None:
    rows = drawn(fingers_message())
    magnets = places(rows, "▒")
    assert middle([each for each in magnets if each[0] < 0]) == pytest.approx((-6, 0))
    assert middle([each for each in magnets if each[0] > 0]) == pytest.approx((6, 0))
    assert places(rows, "●") == []


def test_unknown_fingers_show_the_resultant_as_one_spot() -> None:
    spots = places(drawn(fingers_message(*FAR, contacts=None, poses=None)), "●")
    assert middle(spots) == pytest.approx((3, -1), abs=0.5)


def test_figures_say_force_place_and_shear_of_each_finger() -> None:
    text = "\n".join(drawn(fingers_message(*two_fingers())))
    for figure in ("finger 3", "0.60 ± 0.04 N", "x -4.0, y +2.0 mm", "finger 4", "0.90 ± 0.04 N", "+0.10 +0.00 N"):
        assert figure in text
    assert "magnet 2 6.00 0.00 10.40 mm" in text
    assert "do not explain" not in text
    more = "\n".join(drawn(fingers_message(*two_fingers(), more=True)))
    assert "two fingers do not" in more


def test_picture_of_two_fingers_fits_a_terminal_of_80_by_24() -> None:
    fingers = [msgspec.structs.replace(two_fingers()[1], id=number) for number in (1, 2)]
    rows = drawn(fingers_message(*fingers, more=True))
    assert max(map(len, rows)) <= 80
    assert len(rows) <= 23


def line(message: ContactMessage) -> str:
    tally = Tally("demo")
    tally.add(received(message))
    return now_line(tally)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({}, "finger 3: 0.60 N at (-4.0, +2.0) mm and finger 4: 0.90 N at (+6.0, -1.0) mm"),
        ({"contacts": list(two_fingers()[:1])}, "1.50 ± 0.05 N at (+2.0, +0.2) mm"),
        ({"contacts": None}, "1.50 ± 0.05 N at (+2.0, +0.2) mm"),
        ({"more": True}, "two fingers do not explain this"),
    ],
)
def test_log_line_names_every_finger(changes: dict[str, Any], words: str) -> None:
    said = line(fingers_message(*two_fingers(), **changes))
    assert words in said
    assert said.count(" N at ") == (1 if "contacts" in changes else 2)


def test_pad_with_one_magnet_says_nothing_of_fingers() -> None:
    assert "finger" not in line(contact_message())
    assert "finger" not in "\n".join(drawn(contact_message()))
