"""The page in real Chromium, of a pad with several magnets: a bus with made-up messages stands for the daemon."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import closing
from itertools import count
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser, Page

from background import repeating
from fmfts.bus.messages import ContactMessage, without_estimate
from page.made_up_bus import Bus
from page.rig import CHROMIUM, TWO_PICTURES, View, opened, until
from unit.bus_messages import contact_message, finger_message, fingers_message, two_fingers

pytestmark = [pytest.mark.needs(CHROMIUM), pytest.mark.slow]

PERIOD_S = 0.02
PLACE_MM = 0.5
REST_M = [[-0.006, 0.0, 0.0105], [0.006, 0.0, 0.0105]]
# The pixels of a colour of the theme on a drawing, as [x, y] in mm of the pad; its outline gives the scale.
PIXELS = """([id, name]) => {
    const canvas = document.getElementById(id), {width, height} = canvas;
    const data = canvas.getContext("2d").getImageData(0, 0, width, height).data;
    const style = getComputedStyle(document.documentElement);
    const css = (name) => style.getPropertyValue(name).trim().match(/\\w\\w/g).map((two) => parseInt(two, 16));
    const found = (colour) => {
        const places = [];
        for (let y = 0; y < height; y++) for (let x = 0; x < width; x++) {
            const at = 4 * (y * width + x);
            const like = colour.every((value, i) => Math.abs(data[at + i] - value) <= 5);
            if (like && data[at + 3] > 250) places.push([x, y]);
        }
        return places;
    };
    const edge = found(css("--silicone-edge")), xs = edge.map(([x]) => x), ys = edge.map(([, y]) => y);
    const ends = (values) => [values.reduce((a, b) => Math.min(a, b)), values.reduce((a, b) => Math.max(a, b))];
    const [left, right] = ends(xs), [top, bottom] = ends(ys), scale = 40 / (right - left);
    return found(css(name)).map(([x, y]) => [(x - (left + right) / 2) * scale, ((top + bottom) / 2 - y) * scale]);
}"""

# The colour of the drawing from above at [x, y] in mm of the pad, in the middle of the canvas.
COLOUR_AT = """([x, y]) => {
    const canvas = document.getElementById("top");
    const perMm = Math.min(canvas.clientWidth / 2 - 34, canvas.clientHeight / 2 - 20) / 20;
    const ratio = canvas.width / canvas.clientWidth;
    const at = [canvas.clientWidth / 2 + x * perMm, canvas.clientHeight / 2 - y * perMm].map((each) => each * ratio);
    return [...canvas.getContext("2d").getImageData(...at, 1, 1).data].slice(0, 3);
}"""


@pytest.fixture(scope="module")
def bus(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Bus, str, Path]]:
    folder = tmp_path_factory.mktemp("fingers")
    base = f"ipc://{folder}"
    with (
        closing(Bus(base, {"demo": {"rest_positions_m": REST_M}}, fingers_message)) as bus,
        repeating(bus.turn, PERIOD_S),
    ):
        yield bus, base, folder


@pytest.fixture(scope="module")
def one_page(browser: Browser, bus: tuple[Bus, str, Path]) -> Iterator[Page]:
    _, base, folder = bus
    with View(folder, os.environ | {"FMFTS_BUS": base}) as view:
        page = opened(browser, view.address)
        until(page, "fmfts.pads.get('demo')?.shape.rest_positions_m !== undefined")
        yield page
        page.context.close()


@pytest.fixture
def shows(one_page: Page, bus: tuple[Bus, str, Path]) -> Iterator[Callable[..., Page]]:
    """Make the bus send something, and wait until the page has drawn it."""

    def show(*fingers: object, **changes: object) -> Page:
        word = f"drawn {next(numbers)}"
        bus[0].make = lambda **times: make(*fingers, **(times | changes | {"model": word}))
        until(one_page, f"fmfts.pads.get('demo').contact?.model === '{word}'")
        one_page.evaluate(TWO_PICTURES)
        one_page.wait_for_timeout(150)
        return one_page

    def make(*fingers: object, **changes: object) -> ContactMessage:
        return contact_message(**changes) if fingers == ("one magnet",) else fingers_message(*fingers, **changes)  # type: ignore[arg-type]

    numbers = count()
    yield show
    assert one_page.complaints == []  # type: ignore[attr-defined]


def middles(page: Page) -> list[tuple[float, float]]:
    """Centres of the shapes in the colour of contacts left and right of the pad's centre, in mm of the pad."""
    pixels = np.array(page.evaluate(PIXELS, ["top", "--contact"])).reshape(-1, 2)
    halves = [pixels[pixels[:, 0] < 0.0], pixels[pixels[:, 0] > 0.0]]
    return [tuple((half.min(axis=0) + half.max(axis=0)) / 2) for half in halves if len(half)]


def text(page: Page, selector: str) -> str:
    return " ".join(page.inner_text(selector).split())


def test_two_fingers_are_drawn_where_they_are_and_nothing_between_them(shows: Callable[..., Page]) -> None:
    page = shows(finger_message(3, x_m=-0.009, y_m=0.004), finger_message(4, x_m=0.009, y_m=-0.003, force_n=0.9))
    drawn = middles(page)
    assert drawn[0] == pytest.approx((-9.0, 4.0), abs=PLACE_MM)
    assert drawn[1] == pytest.approx((9.0, -3.0), abs=PLACE_MM)
    assert text(page, "#place") == (
        "finger 3: 0.60 ± 0.04 N at x −9.0 mm, y 4.0 mm; finger 4: 0.90 ± 0.04 N at x 9.0 mm, y −3.0 mm"
    )
    assert text(page, "#force") == "1.50 N ± 0.05", "of both"
    page.wait_for_timeout(1100)
    assert "finger 4: 0.90" in (page.get_attribute("#top", "aria-label") or "")


def test_one_finger_draws_one_spot_and_no_contact_draws_none(shows: Callable[..., Page]) -> None:
    page = shows(finger_message(5, x_m=0.007, y_m=0.002))
    page.wait_for_timeout(1000)  # the trails of the fingers before are gone
    assert middles(page) == [pytest.approx((7.0, 2.0), abs=PLACE_MM)]
    assert text(page, "#place").startswith("x 7.0 ± 0.2 mm")
    page = shows()
    assert middles(page) == []
    assert text(page, "#force") == "no contact"


def test_resultant_is_drawn_when_fingers_are_unknown(shows: Callable[..., Page]) -> None:
    page = shows(*two_fingers(), contacts=None, x_m=0.008, y_m=0.001)
    page.wait_for_timeout(1000)
    assert middles(page) == [pytest.approx((8.0, 1.0), abs=PLACE_MM)]


def test_page_reports_more_than_two_fingers(shows: Callable[..., Page]) -> None:
    page = shows(*two_fingers(), more=True)
    until(page, "document.querySelector('#reason').textContent.includes('two fingers do not explain')")
    assert "two fingers" not in text(shows(*two_fingers()), "#reason")


def test_every_magnet_is_drawn_from_above_and_enlarged_with_its_own_rest(shows: Callable[..., Page]) -> None:
    page = shows()
    left, right, between = (page.evaluate(COLOUR_AT, [x_mm, 0.0]) for x_mm in (-6.6, 5.4, 2.0))
    assert left == right != between
    assert "not known" not in text(page, "#facts dd:nth-of-type(1)")
    assert text(page, "#facts dd:nth-of-type(1)").count("±") == 2
    assert page.evaluate("document.querySelector('#lens-scale').textContent").endswith("± 0.25 mm"), "0.1 mm of each"


def test_finger_keeps_its_lines_when_the_other_one_goes(shows: Callable[..., Page]) -> None:
    left, right = finger_message(11, x_m=-0.005), finger_message(12, x_m=0.005)
    page = shows(left, right)
    columns = "fmfts.pads.get('demo').fine.rows.at(-1).places.map((each) => each && Number(each.id))"
    assert page.evaluate(columns) == [11, 12]
    assert shows(right).evaluate(columns) == [None, 12]
    assert shows(right, finger_message(13)).evaluate(columns) == [13, 12]
    assert shows().evaluate(columns) == [None, None]


def test_pad_without_estimate_shows_no_number(shows: Callable[..., Page], bus: tuple[Bus, str, Path]) -> None:
    page = shows()
    magnet = page.evaluate(COLOUR_AT, [-6.6, 0.0])
    bus[0].make = lambda **times: without_estimate(
        fingers_message(*two_fingers(), **times), health="lost", reason="no pose fits", model="gone"
    )
    until(page, "fmfts.pads.get('demo').contact?.model === 'gone'")
    page.wait_for_timeout(1000)
    assert middles(page) == []
    assert page.evaluate(COLOUR_AT, [-6.6, 0.0]) != magnet
    assert text(page, "#force") == "not known"


def test_pad_with_one_magnet_is_drawn_unchanged(shows: Callable[..., Page]) -> None:
    page = shows("one magnet", x_m=0.006, y_m=-0.002)
    page.wait_for_timeout(1000)
    assert middles(page) == [pytest.approx((6.0, -2.0), abs=PLACE_MM)]
    assert "finger" not in text(page, "#place")
