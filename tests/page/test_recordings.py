"""Recordings on the page, in Chromium: one is made, shown again and left, and a file that is none is refused."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
from playwright.sync_api import Page

from page.conftest import Bench
from page.rig import CHROMIUM, NEWEST, until

pytestmark = [pytest.mark.needs(CHROMIUM), pytest.mark.real_time, pytest.mark.slow]

TOAST = "document.querySelector('#toast').textContent"
LINK = "document.querySelector('#link').textContent"
FORCE = "document.querySelector('#force').dataset.kind"
PLACE = "document.querySelector('#replay').textContent"
TOUCHED_S = 2.0  # longer than the second after which the page says that it shows a recording


def show(page: Page, name: str) -> None:
    """Choose a row of the list: the buttons come when the server has answered."""
    page.keyboard.press("o")
    page.click(f"#recording-list button[aria-label='{name}']")


def test_recording_is_made_and_shown_on_the_same_page(bench: Bench, page: Page) -> None:
    page.keyboard.press("r")
    until(page, f"{TOAST}.startsWith('recording all pads into')")
    assert page.get_attribute("#record", "aria-pressed") == "true"
    name = page.evaluate(TOAST).split()[-1]
    bench.pressed.touch(-4e-3, -4e-3, 0.9)
    until(page, f"{FORCE} === 'touch'")
    page.wait_for_timeout(TOUCHED_S * 1e3)
    bench.pressed.touch(0.0, 0.0, 0.0)
    until(page, f"{FORCE} === 'none'")
    page.keyboard.press("r")
    until(page, f"{TOAST}.includes('messages in')")
    assert page.get_attribute("#record", "aria-pressed") == "false"
    assert (bench.folder / name).stat().st_size > 0
    ended_ns = time.monotonic_ns()
    show(page, f"Show {name}")
    until(page, f"{LINK}.startsWith('replay of {name}')")
    until(page, f"/Replay of {name} at its own speed, [1-9] s of /.test({PLACE})")
    assert not page.is_visible("#record")
    page.keyboard.press("r")
    until(page, f"{TOAST}.includes('this is a replay')")
    until(page, f"{FORCE} === 'touch' && Math.hypot({NEWEST}.x_m + 4e-3, {NEWEST}.y_m + 4e-3) < 5e-4")
    assert page.evaluate(f"Number({NEWEST}.t_publish_ns)") < ended_ns
    until(page, f"{LINK}.startsWith('paused')")  # at its end, so that a viewer sees its last seconds
    assert "the end of" in page.evaluate(TOAST)
    assert page.locator("#event-list li[data-kind='onset']").count() == 1, "the recording's alone"
    for _ in range(10 * round(TOUCHED_S) + 50):
        page.keyboard.press("Shift+ArrowLeft")
        page.wait_for_timeout(50)
        if page.evaluate(FORCE) == "touch":
            break
    assert page.evaluate(FORCE) == "touch"
    page.keyboard.press("Space")
    until(page, "document.querySelector('#reason').textContent === 'of the recording'")
    page.press("#replay-place", "Home")  # to its beginning
    until(page, f"{LINK}.startsWith('replay of {name}') && {FORCE} === 'touch'")
    lasts_s = float(page.get_attribute("#replay-place", "max") or "0")
    page.press("#replay-place", "End")
    until(page, f"{PLACE}.includes('is over, {lasts_s:.0f} s of {lasts_s:.0f} s')")
    show(page, "Back the daemon, live")
    until(page, f"{LINK}.startsWith('live')")
    until(page, f"Number({NEWEST}.t_publish_ns) > {ended_ns}")
    assert page.is_visible("#record")
    assert not page.is_visible("#replay")


def test_file_that_is_no_recording_leaves_the_daemon_shown(bench: Bench, page: Page) -> None:
    broken: Path = bench.folder / "broken.mcap"
    broken.write_bytes(b"")
    show(page, "Show broken.mcap")
    until(page, f"{TOAST}.includes('broken.mcap is empty')")
    bench.pressed.touch(3e-3, 3e-3, 0.8)
    until(page, f"{FORCE} === 'touch'")
    bench.pressed.touch(0.0, 0.0, 0.0)
    until(page, f"{FORCE} === 'none'")
    until(page, f"{LINK}.startsWith('live')")
