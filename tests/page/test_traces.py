"""The page draws what was sent: its traces, read back from the plots, are the messages of the bus."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import closing

import pytest
from playwright.sync_api import Browser, Page

from background import repeating
from fmfts.bus.messages import ContactMessage
from page.drawn_traces import drawn
from page.fit_to_show import why_unfit
from page.known_touches import PERIOD_S, KnownTouches
from page.rig import CHROMIUM, TWO_PICTURES, View, opened, until

pytestmark = [pytest.mark.needs(CHROMIUM), pytest.mark.slow]

WATCHED_MS = 3000


@pytest.fixture(scope="module")
def bus(tmp_path_factory: pytest.TempPathFactory) -> Iterator[KnownTouches]:
    with closing(KnownTouches(tmp_path_factory.mktemp("touches"))) as bus, repeating(bus.turn, PERIOD_S):
        yield bus


@pytest.fixture(scope="module")
def one_page(browser: Browser, bus: KnownTouches, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    folder = tmp_path_factory.mktemp("view")
    with View(folder, os.environ | bus.environment, "--beside", bus.beside) as view:
        page = opened(browser, view.address)
        until(page, "fmfts.pads.get('demo')?.ghost && fmfts.nowMs() !== null")
        page.wait_for_timeout(WATCHED_MS)
        yield page
        page.context.close()


@pytest.fixture
def page(one_page: Page) -> Iterator[Page]:
    yield one_page
    if one_page.get_attribute("#pause", "aria-pressed") == "true":
        one_page.click("#pause")
    one_page.click("#short")
    assert one_page.complaints == []  # type: ignore[attr-defined]


def test_live_traces_are_the_messages_that_were_sent(bus: KnownTouches, page: Page) -> None:
    traces = drawn(page, bus)
    assert traces.wrong == []
    assert traces.points > 1000


def test_live_traces_leave_no_message_out(bus: KnownTouches, page: Page) -> None:
    times = drawn(page, bus).times
    assert page.evaluate("fmfts.leftOut ?? 0") == 0
    since_s = times[0] + 1.0  # the page requests every message after the first one of the pad
    assert [t for t in times if t >= since_s] == [t for t in list(bus.sent) if since_s <= t <= times[-1]]


def test_ten_minutes_view_shows_the_hardest_message_of_each_bin(bus: KnownTouches, page: Page) -> None:
    page.click("#long")
    page.wait_for_timeout(300)
    traces = drawn(page, bus)
    assert traces.wrong == []
    forces = [bus.sent[t] for t in traces.times]
    assert sum(bool(one.contact) for one in forces) > 0.8 * len(forces), "0.2 s hold two touches"


@pytest.mark.parametrize("view", ["#short", "#long"])
def test_paused_page_copies_the_shown_message(bus: KnownTouches, page: Page, view: str) -> None:
    page.click("#pause")
    page.click(view)
    page.wait_for_timeout(500)  # messages go on arriving
    for _ in range(5):
        page.keyboard.press("Shift+ArrowLeft")
        page.keyboard.press("c")
        page.evaluate(TWO_PICTURES)
        copied = page.evaluate("JSON.parse(fmfts.copied)")
        sent = bus.sent[copied["t_publish_ns"] / 1e9]
        assert copied["force_n"] == sent.force_n
        assert page.inner_text("#force") == in_words(sent)


def test_page_of_a_stalled_pad_is_not_fit_for_a_picture(bus: KnownTouches, page: Page) -> None:
    """This bus sends fewer messages than its pad's 220 a second."""
    assert " of 220 Hz" in why_unfit(page)
    assert "health ok" in why_unfit(page, health=["degraded"])


def in_words(sent: ContactMessage) -> str:
    if sent.over_range:
        return f"more than {sent.force_min_n:.2f} N"
    return f"{sent.force_n:.2f} N ± {sent.force_sd_n:.2f}" if sent.contact else "no contact"
