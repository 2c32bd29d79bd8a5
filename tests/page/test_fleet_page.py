"""The page of the fleet in real Chromium: three daemons with keys, one of which is killed."""

from __future__ import annotations

import time
from collections.abc import Iterator

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, Page

from end_to_end.processes import START_PATIENCE_S
from end_to_end.robots import Robots
from page.rig import CHROMIUM, View, opened, until

pytestmark = [pytest.mark.needs(CHROMIUM), pytest.mark.real_time, pytest.mark.slow]

SOON_S = 0.5
STATES = "[...document.querySelectorAll('#robots li')].map((card) => card.dataset.state).join(' ')"
# Milliseconds from now until the card of a robot has another state, in the page's own time.
UNTIL_STATE = """([name, state]) => new Promise((done) => {
    const card = document.querySelector(`#state-${name}`).closest("li"), began = performance.now();
    const look = () => (card.dataset.state === state ? done(performance.now() - began) : requestAnimationFrame(look));
    look();
})"""


@pytest.fixture(scope="module")
def robots(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Robots]:
    robots = Robots(tmp_path_factory.mktemp("fleet"))
    yield robots
    robots.close()


@pytest.fixture(scope="module")
def view(robots: Robots) -> Iterator[View]:
    with robots.view(robots.keys) as view:
        yield view


@pytest.fixture
def page(browser: Browser, robots: Robots, view: View) -> Iterator[Page]:
    """The page with all three robots. Its console must stay empty, and it must load nothing from elsewhere."""
    for daemon in robots.daemons.values():
        if daemon.process.poll() is not None:
            daemon.start()
    page = opened(browser, view.address)
    until(page, f"{STATES} === 'there there there'", START_PATIENCE_S)
    yield page
    assert page.complaints == []  # type: ignore[attr-defined]
    assert page.foreign == []  # type: ignore[attr-defined]
    page.context.close()


def card(page: Page, name: str) -> str:
    """The text of a robot's card, as a person reads it."""
    return " ".join(page.locator("#robots li", has=page.locator(f"#state-{name}")).inner_text().split())


def test_killed_robot_is_shown_as_lost_within_half_a_second(page: Page, robots: Robots) -> None:
    assert page.inner_text("#summary") == "3 of 3 robots there"
    assert "of 220 Hz" in card(page, "leg")
    began_s = time.monotonic()
    robots.daemons["leg"].process.kill()
    page.evaluate(UNTIL_STATE, ["leg", "lost"])
    took_s = time.monotonic() - began_s
    print(f"drawn as lost after {took_s:.3f} s")
    assert took_s < SOON_S
    said = card(page, "leg")
    assert "lost since " in said
    assert "is fmfts-daemon running on it" in said
    assert "of 220 Hz" not in said, "what was is not shown as what is"
    assert page.inner_text("#summary") == "2 of 3 robots there; lost: leg"
    assert page.title() == "lost: leg: fmfts"
    assert "there since" in card(page, "arm")


def test_robots_own_view_is_opened_and_left_with_keyboard_alone(page: Page, view: View) -> None:
    page.keyboard.press("Tab")
    while page.evaluate("document.activeElement.textContent") != "leg":
        page.keyboard.press("Tab")
    page.keyboard.press("Enter")
    page.wait_for_url("**/robot/leg/")
    until(page, "fmfts.pads.size === 1 && !fmfts.pads.get('left').silent()")
    assert " ".join(page.inner_text("#robot").split()) == "All robots › leg"
    assert page.title() == "leg: fmfts"
    page.focus("#robot a")
    page.keyboard.press("Enter")
    page.wait_for_url(f"http://127.0.0.1:{view.port}/")
    until(page, f"{STATES} === 'there there there'")
    page.keyboard.press("3")
    page.wait_for_url("**/robot/head/")
    until(page, "fmfts.pads.size === 2")


def test_worst_pad_is_named_with_its_reason_and_what_to_do(page: Page) -> None:
    until(page, "document.querySelectorAll('#robots li')[2].querySelector('.worst').dataset.sound === 'false'")
    said = card(page, "head")
    assert "1 disconnected, 1 ok" in said
    assert "0 of 220 Hz: too slow" in said
    assert "right (disconnected): " in said
    assert "/dev/no-such-board" in said
    assert "What to do: plug it in" in said
    assert "none: all are well" in card(page, "arm")


def test_click_anywhere_on_a_card_opens_its_robot(page: Page) -> None:
    page.locator("#robots li").nth(1).locator(".rate").click(force=True)
    page.wait_for_url("**/robot/leg/")


def test_no_state_is_shown_as_current_after_the_server_ended(
    browser: Browser, robots: Robots, view: View, page: Page
) -> None:
    with robots.view(robots.keys) as brief:
        other = opened(browser, brief.address)
        until(other, f"{STATES} === 'there there there'")
    until(other, f"{STATES} === 'unknown unknown unknown'")
    assert "of 220 Hz" not in card(other, "arm")
    assert other.inner_text("#summary") == "no connection: nothing is known of the robots"
    assert "fmfts-daemon view" in other.inner_text("#banner")
    other.context.close()


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_axe_finds_no_serious_violation(page: Page, robots: Robots, theme: str) -> None:
    robots.daemons["head"].process.kill()
    until(page, f"{STATES} === 'there there lost'")
    if page.evaluate("document.documentElement.dataset.theme") != theme:
        page.keyboard.press("t")
    found = Axe().run(page).response["violations"]
    assert [
        (each["id"], each["nodes"][0]["html"][:120]) for each in found if each["impact"] in ("serious", "critical")
    ] == []
