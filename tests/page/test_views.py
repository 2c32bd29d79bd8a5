"""All views of the page, on a phone and on a desk: nothing fails, and all fits."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import closing

import pytest
from playwright.sync_api import Browser, Page

from background import repeating
from page.known_touches import PERIOD_S, KnownTouches
from page.rig import CHROMIUM, TWO_PICTURES, View, opened, until
from page.views import SIZES, look_at_all_views

pytestmark = [pytest.mark.needs(CHROMIUM), pytest.mark.slow]


@pytest.fixture(scope="module")
def one_page(browser: Browser, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    bus = KnownTouches(tmp_path_factory.mktemp("views"))
    with (
        closing(bus),
        repeating(bus.turn, PERIOD_S),
        View(tmp_path_factory.mktemp("view"), os.environ | bus.environment) as view,
    ):
        page = opened(browser, view.address)
        until(page, "fmfts.pads.get('demo')?.contact && fmfts.nowMs() !== null")
        yield page
        page.context.close()


@pytest.fixture
def page(one_page: Page) -> Iterator[Page]:
    width, height = SIZES["desk"]
    one_page.set_viewport_size({"width": width, "height": height})
    yield one_page
    assert one_page.complaints == []  # type: ignore[attr-defined]


@pytest.mark.parametrize("size", SIZES)
def test_all_views_leave_the_console_empty(page: Page, size: str) -> None:
    width, height = SIZES[size]
    page.set_viewport_size({"width": width, "height": height})
    look_at_all_views(page, 0.0)
    assert page.evaluate("document.documentElement.scrollWidth") <= width


def test_window_without_room_for_the_drawing_fails_nowhere(page: Page) -> None:
    page.set_viewport_size({"width": 60, "height": 40})
    page.evaluate(TWO_PICTURES)
