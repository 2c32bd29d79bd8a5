"""All views of the page, on a phone and on a desk: nothing fails, everything fits, and each explains itself."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterator
from contextlib import closing
from itertools import combinations, count
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, Page

from background import repeating
from fmfts.bus.messages import SlipMessage
from page.made_up_bus import Bus
from page.rig import CHROMIUM, TWO_PICTURES, View, opened, until
from page.views import SIZES, look_at_all_views
from unit.bus_messages import contact_message, event_message, pose_message, status_message, two_fingers

pytestmark = [pytest.mark.needs(CHROMIUM), pytest.mark.slow]

PERIOD_S = 0.02
SIDE_M = 0.042  # end of a pad with a little room: the next one begins there
PLACES_M = [[x * SIDE_M, y * SIDE_M, 0.0] for x, y in ((0, 0), (1, 0), (2, 0), (0, 1), (1, 1))]
PADS = {"demo": {}} | {f"finger{number}": {} for number in range(1, 5)}
EIGHT_M = [[x * 12e-3, y * 12e-3, 0.0] for x in (-1, 0, 1) for y in (-1, 0, 1) if x or y]
NOWHERE: dict[str, Any] = dict.fromkeys(("x_m", "x_sd_m", "y_m", "y_sd_m", "force_n", "force_sd_n"))
OVER = NOWHERE | {"over_range": True, "force_min_n": 2.13}
# Boxes [left, top, right, bottom] of all that is written on the drawing of this id, with its text.
WRITTEN = """(id) => new Promise((done) => {
    const written = [], write = CanvasRenderingContext2D.prototype.fillText;
    CanvasRenderingContext2D.prototype.fillText = function (text, x, y) {
        if (this.canvas.id === id) {
            const at = this.getTransform().transformPoint({ x, y }), scale = this.getTransform().a;
            const canvas = this.canvas.getBoundingClientRect(), half = this.measureText(text).width / 2;
            const [cx, cy] = [canvas.left + at.x / scale, canvas.top + at.y / scale];
            written.push([text, [cx - half, cy - 6, cx + half, cy + 6]]);
        }
        return write.apply(this, arguments);
    };
    requestAnimationFrame(() => { written.length = 0; fmfts.dirty = true; });
    setTimeout(() => {
        CanvasRenderingContext2D.prototype.fillText = write;
        done([...new Map(written.map(([text, box]) => [text, [text, box]])).values()]);
    }, 400);
})"""
CUT_OFF = "(all) => all.filter((each) => each.scrollWidth > each.clientWidth).length"
BOX = "(e) => { const { left, top, right, bottom } = e.getBoundingClientRect(); return [left, top, right, bottom]; }"
RED = """([x, y, size]) => {
    const canvas = document.getElementById("top"), ratio = canvas.width / canvas.clientWidth;
    const side = Math.round(size * ratio), data = canvas.getContext("2d").getImageData(
        Math.round((canvas.clientWidth / 2 + x) * ratio) - side / 2,
        Math.round((canvas.clientHeight / 2 + y) * ratio) - side / 2, side, side).data;
    let count = 0;
    for (let i = 0; i < data.length; i += 4) count += data[i] > 150 && data[i + 1] < 140 && data[i + 2] < 140;
    return count;
}"""


def untouched(**changes: Any) -> Any:
    return contact_message(**({"contact": False} | NOWHERE | {"force_n": 0.0, "force_sd_n": 0.04} | changes))


@pytest.fixture(scope="module")
def bus(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Bus, str]]:
    base = f"ipc://{tmp_path_factory.mktemp('views')}"
    pads = {name: {"placement_m": place} for name, place in zip(PADS, PLACES_M, strict=True)}
    with closing(Bus(base, pads, untouched)) as bus, repeating(bus.turn, PERIOD_S):
        yield bus, base


@pytest.fixture(scope="module")
def one_page(browser: Browser, bus: tuple[Bus, str], tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    with View(tmp_path_factory.mktemp("view"), os.environ | {"FMFTS_BUS": bus[1]}) as view:
        page = opened(browser, view.address)
        until(page, f"fmfts.pads.size === {len(PADS)} && fmfts.pads.get('demo').shape.placement_m !== undefined")
        page.keyboard.press("1")
        yield page
        page.context.close()


@pytest.fixture
def page(one_page: Page) -> Iterator[Page]:
    width, height = SIZES["desk"]
    one_page.set_viewport_size({"width": width, "height": height})
    yield one_page
    assert one_page.complaints == []  # type: ignore[attr-defined]


@pytest.fixture
def shows(page: Page, bus: tuple[Bus, str]) -> Iterator[Callable[..., Page]]:
    """Make the bus send messages of all pads, and wait until the page has drawn them."""

    def show(message: Callable[..., Any] = contact_message, **changes: Any) -> Page:
        said = f"number {next(numbers)}"
        bus[0].make = lambda **own: message(**(own | changes | {"model": said}))
        until(page, f"fmfts.pads.get('demo').contact.model === '{said}'")
        page.evaluate(TWO_PICTURES)
        return page

    numbers = count()
    yield show
    bus[0].make = untouched


@pytest.mark.parametrize("size", SIZES)
def test_all_views_leave_the_console_empty(page: Page, size: str) -> None:
    width, height = SIZES[size]
    page.set_viewport_size({"width": width, "height": height})
    look_at_all_views(page, 0.0)
    assert page.evaluate("document.documentElement.scrollWidth") <= width


def test_tiny_window_raises_no_error(page: Page) -> None:
    page.set_viewport_size({"width": 60, "height": 40})
    page.evaluate(TWO_PICTURES)


def test_whole_page_fits_a_desktop_screen(shows: Callable[..., Page]) -> None:
    for page in (shows(), shows(**OVER), shows(untouched)):
        assert page.evaluate("document.documentElement.scrollHeight") <= SIZES["desk"][1]


def test_over_range_without_a_place_is_drawn_at_no_place(shows: Callable[..., Page]) -> None:
    page = shows(**OVER)
    assert page.inner_text("#force") == "more than 2.13 N"
    assert page.eval_on_selector("#force", "(e) => e.scrollWidth <= e.clientWidth")
    assert page.inner_text("#place") == "place not known"
    middle, *corners = (page.evaluate(RED, [x, y, 60]) for x, y in ((0, 0), (-90, 90), (90, 90), (90, -40)))
    assert min(corners) > 0.5 * middle > 0


def test_slip_leaves_a_trail_and_a_sticking_finger_none(shows: Callable[..., Page]) -> None:
    def dragged(slips: bool) -> int:
        slip = SlipMessage(slipping=slips, sticking_probability=0.0 if slips else 1.0)
        for x_mm in (-8, 8):
            page = shows(x_m=x_mm * 1e-3, y_m=0.0, x_sd_m=1e-4, y_sd_m=1e-4, force_n=0.3, slip=slip)
        return int(page.evaluate(RED, [-40, 0, 12]))

    sticking = dragged(False)
    shows(untouched)
    assert dragged(True) > sticking + 20
    page = shows(untouched)
    assert page.evaluate(RED, [-40, 0, 12]) <= sticking


def test_shear_of_a_finger_that_may_slip_is_put_in_words(shows: Callable[..., Page]) -> None:
    slip = SlipMessage(slipping=False, sticking_probability=1.0, friction=0.6, margin_n=0.24)
    page = shows(x_m=0.0, y_m=0.0, force_n=1.0, shear_x_n=0.3, shear_y_n=0.2, slip=slip)
    assert "sticks until 0.24 N more shear; friction 0.60" in page.inner_text("#place")


def test_recording_that_the_daemon_plays_is_not_called_live(page: Page, bus: tuple[Bus, str]) -> None:
    link = "document.querySelector('#link').textContent"
    until(page, f"{link}.startsWith('live')")
    bus[0].publisher.send_status("demo", status_message(source="recording /data/touch.mcap"))
    until(page, f"{link}.startsWith('replay of touch.mcap by the daemon')")
    bus[0].publisher.send_status("demo", status_message(source="simulated pad, seed 1"))
    until(page, f"{link}.startsWith('live')")


def test_over_range_is_not_called_ok(shows: Callable[..., Page]) -> None:
    page = shows(**OVER)
    until(page, "document.querySelector('#health').dataset.health === 'over'")
    assert "over range" in page.inner_text("#health")
    assert "harder than" in page.inner_text("#reason")
    shows()
    until(page, "document.querySelector('#health').dataset.health === 'ok'")


def test_untouched_pad_shows_the_smallest_force_it_detects(shows: Callable[..., Page]) -> None:
    page = shows(untouched)
    assert page.inner_text("#force") == "no contact"
    assert page.inner_text("#place") == "less than 0.08 N anywhere on the pad"


def test_good_news_has_no_warning_mark(page: Page, bus: tuple[Bus, str]) -> None:
    for kind, detail in (
        ("health", "lost: no pose fits"),
        ("overload", "this computer keeps up again"),
        ("health", "ok"),
        ("rejected", "a frame is rejected: its fields are not finite"),
    ):
        bus[0].tell(event_message(kind=kind, detail=detail))
        shown = f"health {detail}" if kind == "health" else detail
        until(page, f"document.querySelector('#event-list span')?.textContent === 'demo: {shown}'")
    rejected, good, plain, bad = (page.locator(f"#event-list li:nth-child({number}) i") for number in (1, 2, 3, 4))
    assert [each.inner_text() for each in (rejected, good, plain, bad)] == ["▲", "●", "·", "▲"]
    colours = [each.evaluate("(e) => getComputedStyle(e).color") for each in (good, bad)]
    assert colours == ["rgb(0, 112, 79)", "rgb(180, 35, 24)"]


SEVERAL = "(several) => { stage.classList.toggle('several', several); hand.hidden = !several; fmfts.dirty = true; }"


@pytest.fixture
def alone(shows: Callable[..., Page]) -> Iterator[Page]:
    """The page as with one pad, at the width of half a screen."""
    page = shows()
    page.set_viewport_size({"width": 1000, "height": 900})
    page.evaluate(SEVERAL, False)
    page.evaluate(TWO_PICTURES)
    yield page
    page.evaluate(SEVERAL, True)


def test_two_columns_leave_no_empty_quarter(alone: Page) -> None:
    page = alone
    pad, side, readings = (page.eval_on_selector(name, BOX) for name in ("#pad", "#side", "#readings"))
    assert (pad[1], pad[3]) == pytest.approx((readings[1], readings[3]), abs=1.0)
    assert (side[0], side[2]) == pytest.approx((pad[0], readings[2]), abs=1.0)
    section, lens = (page.eval_on_selector(name, BOX) for name in ("#section", "#lens"))
    assert section[2] < lens[0], "side by side"
    assert section[1] == pytest.approx(lens[1], abs=1.0)


@pytest.mark.parametrize("width", [390, 1024, 1440])
def test_guide_covers_nothing_that_is_shown_now(page: Page, width: int) -> None:
    page.set_viewport_size({"width": width, "height": 900})
    page.click("#first-use")
    page.wait_for_timeout(300)  # it has risen
    guide, *others = (page.eval_on_selector(name, BOX) for name in ("#guide", "#words", "#readings", "#pad"))
    page.keyboard.press("Escape")
    assert all(not _overlap(guide, other) for other in others)


def test_every_colour_of_the_drawings_has_a_legend(page: Page) -> None:
    for panel in ("#pad", "#side"):
        assert "two deviations" in page.inner_text(f"{panel} .legend")
        assert "magnet" in page.inner_text(f"{panel} .legend")


def test_page_of_four_magnets_fits_a_desktop_screen(shows: Callable[..., Page]) -> None:
    """With two fingers, and eight sensors of which four are excluded."""
    page = shows(untouched)
    standard = page.evaluate("fmfts.pads.get('demo').shape.sensors_m")
    page.evaluate("(all) => { fmfts.pads.get('demo').shape.sensors_m = all; }", EIGHT_M)
    poses = [pose_message() for _ in range(4)]
    shows(pose=None, poses=poses, contacts=list(two_fingers()), more=False, sensors_ok=0b1111)
    tall = page.evaluate("document.documentElement.scrollHeight")
    cut = page.eval_on_selector_all(
        "#sensors li", "(all) => all.filter((li) => li.scrollWidth > li.clientWidth).length"
    )
    page.evaluate("(all) => { fmfts.pads.get('demo').shape.sensors_m = all; }", standard)
    assert (tall, cut) == (SIZES["desk"][1], 0)


def test_facts_of_four_magnets_are_not_cut_off(shows: Callable[..., Page]) -> None:
    poses = [pose_message(remanence_t=1.2 + 0.01 * number) for number in range(4)]
    page = shows(pose=None, poses=poses, contacts=[], more=False)
    assert page.inner_text("#facts dd:nth-of-type(1)").count("±") == 4
    assert page.eval_on_selector_all("#facts dd:nth-of-type(-n+2)", CUT_OFF) == 0


def test_label_of_a_force_covers_no_sensor(page: Page) -> None:
    """A disc anywhere on the pad, with the standard pad's sensors on the page."""
    boxes = [{"x": x, "y": y, "wide": 23, "tall": 23} for x in (-70, 70) for y in (-70, 70)]
    covered = page.evaluate(
        """async (boxes) => {
            const { freeSpot } = await import("/spots.js");
            let covered = 0;
            for (let x = -140; x <= 140; x += 10) for (let y = -140; y <= 140; y += 10) for (const radius of [5, 40]) {
                const [cx, cy] = freeSpot({ x, y, radius }, { wide: 70, tall: 22 }, boxes, 175);
                const over = (box) => Math.abs(cx - box.x) < 46.4 && Math.abs(cy - box.y) < 22.4;
                covered += boxes.some(over) || Math.abs(cx) > 140 || Math.abs(cy) > 164;
            }
            return covered;
        }""",
        boxes,
    )
    assert covered == 0


@pytest.mark.parametrize("width", [390, 1024, 1440])
def test_labels_of_fingers_and_bad_sensors_lie_apart(shows: Callable[..., Page], width: int) -> None:
    """On a pad with eight sensors, all of them faulty, and two fingers close to each other."""
    page = shows(untouched)
    standard = page.evaluate("fmfts.pads.get('demo').shape.sensors_m")
    page.set_viewport_size({"width": width, "height": 900})
    page.evaluate("(all) => { fmfts.pads.get('demo').shape.sensors_m = all; }", EIGHT_M)
    two = {"contacts": list(two_fingers()), "more": False}
    shows(**two, sensors_ok=0)
    said = [
        (text, box) for text, box in page.evaluate(WRITTEN, "top") if re.fullmatch(r"\d: .* N|[1-8]( left out)?", text)
    ]
    page.evaluate("(all) => { fmfts.pads.get('demo').shape.sensors_m = all; }", standard)
    assert len(said) == 2 + len(EIGHT_M)
    for (one, a), (other, b) in combinations(said, 2):
        assert a[2] <= b[0] or b[2] <= a[0] or a[3] <= b[1] or b[3] <= a[1], f"{one} lies over {other}"


@pytest.mark.parametrize("said", [{"force_n": 1.0}, OVER], ids=["touched", "over range"])
def test_labels_of_pads_lie_over_no_other_pad(shows: Callable[..., Page], said: dict[str, Any]) -> None:
    page = shows(**said)
    pads = dict(zip(PADS, [each.evaluate(BOX) for each in page.locator("#hand-pads button").all()], strict=True))
    labels = {text.split()[0]: box for text, box in page.evaluate(WRITTEN, "hand-drawing") if text.split()[0] in PADS}
    assert labels.keys() == pads.keys()
    over = [(name, pad) for name, box in labels.items() for pad in pads if pad != name and _overlap(box, pads[pad])]
    assert over == []
    assert not any(_overlap(one, other) for one, other in combinations(labels.values(), 2))


def test_page_without_a_daemon_names_the_demo(browser: Browser, tmp_path: Path) -> None:
    with View(tmp_path, os.environ | {"FMFTS_BUS": f"ipc://{tmp_path}"}) as view:
        page = opened(browser, view.address)
        until(page, "document.querySelector('#advice').textContent.includes('fmfts-daemon demo')")
        page.context.close()


def _overlap(one: list[float], other: list[float]) -> bool:
    return min(one[2], other[2]) - max(one[0], other[0]) > 0.5 and min(one[3], other[3]) - max(one[1], other[1]) > 0.5
