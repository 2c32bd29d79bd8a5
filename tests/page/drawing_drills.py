"""`make page-drills`: minutes of drawing. Every point of 1,000 touches equals the sent one; no view fails in ten
minutes.

Each prints its figures: run with -s. FMFTS_PAGE_TOUCHES and FMFTS_PAGE_SECONDS (at most 600 count here) shorten them.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
from playwright.sync_api import Browser

from background import repeating
from page.drawn_traces import drawn
from page.known_touches import PERIOD_S, KnownTouches
from page.rig import CHROMIUM, View, opened, until
from page.views import SIZES, look_at_all_views

pytestmark = pytest.mark.needs(CHROMIUM)

TOUCHES = int(os.environ.get("FMFTS_PAGE_TOUCHES", "1000"))
VIEWS_S = min(float(os.environ.get("FMFTS_PAGE_SECONDS", "3600")), 600.0)
LOOK_MS = 4000  # the traces hold ten seconds


@pytest.fixture
def bus(tmp_path: Path) -> Iterator[KnownTouches]:
    with closing(KnownTouches(tmp_path)) as bus, repeating(bus.turn, PERIOD_S):
        yield bus


def test_touches_are_drawn_as_they_were_sent(browser: Browser, bus: KnownTouches, tmp_path: Path) -> None:
    """A touch every 0.1 s, so that a thousand take two minutes."""
    with View(tmp_path, os.environ | bus.environment, "--beside", bus.beside) as view:
        page = opened(browser, view.address)
        until(page, "fmfts.pads.get('demo')?.ghost && fmfts.nowMs() !== null")
        begun, points, looks, wrong = bus.touches, 0, 0, list[str]()
        while bus.touches - begun < TOUCHES:
            page.wait_for_timeout(LOOK_MS)
            for window in ("#long", "#short"):
                page.click(window)
                page.wait_for_timeout(300)
                traces = drawn(page, bus)
                points, looks, wrong = points + traces.points, looks + 1, wrong + traces.wrong
        print(
            f"\n{bus.touches - begun} touches, looked at {looks} times: {len(wrong)} of {points} drawn points are not "
            f"what was sent; {page.evaluate('fmfts.leftOut ?? 0')} messages left out"
        )
        page.context.close()
    assert wrong == []


@pytest.mark.parametrize("size", SIZES)
def test_all_views_for_minutes_leave_the_console_empty(
    browser: Browser, bus: KnownTouches, tmp_path: Path, size: str
) -> None:
    width, height = SIZES[size]
    with View(tmp_path, os.environ | bus.environment) as view:
        page = opened(browser, view.address)
        page.set_viewport_size({"width": width, "height": height})
        until(page, "fmfts.pads.get('demo')?.contact && fmfts.nowMs() !== null")
        rounds = look_at_all_views(page, VIEWS_S / len(SIZES))
        print(f"\n{width} × {height}: all views {rounds} times; errors in the console: {page.complaints}")  # type: ignore[attr-defined]
        assert page.complaints == []  # type: ignore[attr-defined]
        page.context.close()
