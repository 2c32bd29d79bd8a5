"""The page in real Chromium: what a finger on an emulated board, a pulled plug or a squeeze look like, and how soon."""

from __future__ import annotations

import json
import time

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Page

from page.conftest import Bench
from page.rig import CHROMIUM, NEWEST, seconds_until, until

pytestmark = [pytest.mark.needs(CHROMIUM), pytest.mark.real_time, pytest.mark.slow]

SOON_S = 0.100  # delay from a touch to the picture that shows it
AT_ONCE_S = 1.0
PLACE_MM = 0.5

# Where the ring of the contact lies on the drawing from above, in mm of the pad, from its pixels: the pad's outline is
# 40 mm wide, and the ring has the colour of contacts alone.
DRAWN_PLACE = """() => {
    const canvas = document.getElementById("top"), {width, height} = canvas;
    const data = canvas.getContext("2d").getImageData(0, 0, width, height).data;
    const style = getComputedStyle(document.documentElement);
    const css = (name) => style.getPropertyValue(name).trim().match(/\\w\\w/g).map((two) => parseInt(two, 16));
    const box = (colour) => {
        const xs = [], ys = [];
        for (let y = 0; y < height; y++) for (let x = 0; x < width; x++) {
            const at = 4 * (y * width + x);
            if (data[at + 3] < 250 || colour.some((value, i) => Math.abs(data[at + i] - value) > 5)) continue;
            xs.push(x);
            ys.push(y);
        }
        return xs.length ? [Math.min(...xs), Math.max(...xs), Math.min(...ys), Math.max(...ys)] : null;
    };
    const edge = box(css("--silicone-edge")), ring = box(css("--contact"));
    if (!edge || !ring) return null;
    const scale = 40 / (edge[1] - edge[0]), middle = [(edge[0] + edge[1]) / 2, (edge[2] + edge[3]) / 2];
    return [((ring[0] + ring[1]) / 2 - middle[0]) * scale, (middle[1] - (ring[2] + ring[3]) / 2) * scale];
}"""
RED_PIXELS = """() => {
    const canvas = document.getElementById("top");
    const data = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
    let count = 0;
    for (let i = 0; i < data.length; i += 4) count += data[i] > 150 && data[i + 1] < 90 && data[i + 2] < 80;
    return count;
}"""


def text(page: Page, selector: str) -> str:
    return " ".join(page.inner_text(selector).split())


def settled(page: Page) -> None:
    """Wait until the drawn contact was sampled after now: the step of a touch is over."""
    now_ns = time.monotonic_ns()
    until(page, f"Number({NEWEST}.t_sample_ns) > {now_ns + 100_000_000}")
    page.wait_for_timeout(100)  # drawn


def test_touch_is_drawn_at_once_at_its_place_with_its_force(bench: Bench, page: Page) -> None:
    for x_mm, y_mm, force_n in ((4.0, -3.0, 1.0), (-6.0, 2.0, 0.8)):
        began_ns = time.monotonic_ns()
        bench.pressed.touch(x_mm * 1e-3, y_mm * 1e-3, force_n)
        took_s = seconds_until(page, "document.querySelector('#force').dataset.kind === 'touch'", began_ns)
        assert took_s < SOON_S
        settled(page)
        drawn = page.evaluate(DRAWN_PLACE)
        assert drawn == pytest.approx([x_mm, y_mm], abs=PLACE_MM)
        assert float(text(page, "#force").split()[0]) == pytest.approx(force_n, abs=0.1)
        page.wait_for_timeout(1100)
        spoken = page.get_attribute("#top", "aria-label") or ""
        assert " N ± " in spoken
        assert f"x {'−' if x_mm < 0 else ''}" in spoken
        bench.pressed.touch(0.0, 0.0, 0.0)
        until(page, "document.querySelector('#force').dataset.kind === 'none'")


def test_over_range_does_not_look_like_a_measurement(bench: Bench, page: Page) -> None:
    bench.pressed.touch(0.0, 0.0, 2.6)
    until(page, "document.querySelector('#force').dataset.kind === 'over'")
    assert text(page, "#force").startswith("more than ")
    assert page.get_attribute("#force-bar", "class") == "over"
    assert page.evaluate(RED_PIXELS) > 200, "a hatched disc in the colour of what is wrong"
    bench.pressed.touch(0.0, 0.0, 0.0)


def test_excluded_sensor_is_marked_and_named(bench: Bench, page: Page) -> None:
    bench.board.tell("fault 0 2 unplugged")
    until(page, "document.querySelector('#health').dataset.health === 'degraded'")
    until(page, "document.querySelectorAll('#sensors li')[2].dataset.state === 'silent'")
    assert "sensor 3" in text(page, "#reason")
    assert "What to do" in text(page, "#advice")
    bench.board.tell("fault 0 2 none")
    until(page, "document.querySelectorAll('#sensors li')[2].dataset.state === 'good'")


def test_unplugged_says_so_within_a_second_and_recovers(bench: Bench, page: Page) -> None:
    began_ns = time.monotonic_ns()
    bench.unplug()
    gone = "document.querySelector('#health').dataset.health === 'disconnected'"
    assert seconds_until(page, gone, began_ns) < AT_ONCE_S
    assert text(page, "#force") == "not known"
    assert "plug it in" in text(page, "#advice")
    bench.plug_in()
    until(page, "document.querySelector('#health').dataset.health === 'ok'")
    assert "health disconnected" in text(page, "#event-list")


def test_page_survives_the_daemons_restart(bench: Bench, page: Page) -> None:
    boot = page.evaluate(f"{NEWEST}.boot")
    bench.daemon.stop()
    until(page, "document.querySelector('#health').dataset.health === 'gone'")
    assert text(page, "#force") == "not known"
    bench.daemon.start()
    bench.daemon.wait_until_serving()
    until(page, f"{NEWEST}.boot !== '{boot}' && document.querySelector('#health').dataset.health === 'ok'")


def test_background_tab_receives_no_contacts_until_it_is_shown(bench: Bench, page: Page) -> None:
    hide = (
        "(hidden) => { Object.defineProperty(document, 'hidden', {value: hidden, configurable: true}); "
        "document.dispatchEvent(new Event('visibilitychange')); }"
    )
    page.evaluate(hide, True)
    page.wait_for_timeout(300)
    before = page.evaluate(f"Number({NEWEST}.seq)")
    page.wait_for_timeout(600)
    assert page.evaluate(f"Number({NEWEST}.seq)") == before
    page.evaluate(hide, False)
    until(page, f"Number({NEWEST}.seq) > {before + 100}")


def test_paused_moment_is_inspected_and_copied_by_keyboard(bench: Bench, page: Page) -> None:
    bench.pressed.touch(3e-3, 3e-3, 1.2)
    until(page, "document.querySelector('#force').dataset.kind === 'touch'")
    settled(page)
    page.keyboard.press("Space")
    bench.pressed.touch(0.0, 0.0, 0.0)
    page.wait_for_timeout(4500)  # longer than what the page keeps beyond ten seconds
    assert text(page, "#link") == "paused"
    assert float(text(page, "#force").split()[0]) == pytest.approx(1.2, abs=0.12)
    page.keyboard.press("ArrowLeft")
    for _ in range(90):
        page.keyboard.press("Shift+ArrowLeft")  # nine seconds back
    assert "s before the pause" in text(page, "#moment")
    for _ in range(90):
        page.keyboard.press("Shift+ArrowRight")
    page.keyboard.press("c")
    until(page, "fmfts.copied !== undefined")
    copied = json.loads(page.evaluate("fmfts.copied"))
    assert copied == json.loads(page.evaluate("navigator.clipboard.readText()"))
    assert copied["pad"] == "left"
    assert copied["contact"] is True
    assert abs(copied["utc_ns"] / 1e9 - time.time()) < 60.0
    assert copied["utc_ns"] % 1000 or copied["utc_ns"] > 2**53  # a whole number beyond what a double holds
    page.keyboard.press("Space")
    until(page, "document.querySelector('#force').dataset.kind === 'none'")


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_axe_finds_no_serious_violation(page: Page, theme: str) -> None:
    if page.evaluate("document.documentElement.dataset.theme") != theme:
        page.keyboard.press("t")
    for dialog in (None, "g", "o", "?"):
        if dialog:
            page.keyboard.press(dialog)
            page.wait_for_timeout(300)  # until the text is opaque: its contrast is judged
        found = Axe().run(page).response["violations"]
        serious = [
            (each["id"], each["nodes"][0]["html"][:120]) for each in found if each["impact"] in ("serious", "critical")
        ]
        assert serious == []
        page.keyboard.press("Escape")
