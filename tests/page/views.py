"""Goes through all views of a page, as a person who tries every key does."""

from __future__ import annotations

import time

from playwright.sync_api import Page

SIZES = {"phone": (390, 844), "desk": (1440, 900)}
# Pause and continue, ten minutes and ten seconds, both themes, and the three dialogs; a key for each step.
KEYS = (
    *("Space", "ArrowLeft", "Shift+ArrowLeft", "c", "m", "ArrowRight", "Space", "m"),
    *("t", "g", "Escape", "o", "Escape", "?", "Escape", "t", "1"),
)
NEXT_KEY_MS = 120


def look_at_all_views(page: Page, seconds: float) -> int:
    """Press all keys in turn, at least once, until `seconds` are over. Returns the number of rounds."""
    end, rounds = time.monotonic() + seconds, 0
    page.evaluate("document.activeElement.blur()")  # because Space would press a button
    while not rounds or time.monotonic() < end:
        for key in KEYS:
            page.keyboard.press(key)
            if key == "Escape":
                page.evaluate("document.activeElement.blur()")
            page.wait_for_timeout(NEXT_KEY_MS)
        rounds += 1
    return rounds
