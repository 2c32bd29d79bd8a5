"""Judges whether a page is fit to be photographed: a picture of the manual shows a healthy pad."""

from __future__ import annotations

import time
from collections.abc import Sequence

from playwright.sync_api import FloatRect, Page

from page.rig import until

FULL_RATE, OLDEST_MS, FEWEST_PICTURES = 0.97, 60.0, 30
WAIT_MS, PATIENCE_S = 500, 60.0
# Each pad that is shown in figures: name, health, messages a second, nominal rate, age in ms when drawn.
LOOK = """() => [...fmfts.pads.values()].map((pad) => {
    const ages = pad.ages.rows.slice(-100).map((row) => row.age_ms).sort((a, b) => a - b);
    const since = (pad.fine.rows.at(-1)?.t ?? 0) - 10;
    return {
        name: pad.name, chosen: pad.name === fmfts.chosen, health: pad.shown()?.health ?? "nothing arrives",
        reason: pad.shown()?.reason ?? "", rate: pad.rate() ?? 0, nominal: pad.shape.rate_nominal_hz ?? 0,
        age: ages[Math.floor(ages.length / 2)] ?? null,
        overloaded: pad.events.some((event) => event.t > since && event.detail.includes("overloaded")),
    };
})"""


class UnfitError(Exception):
    """The page shows something that should not be in a picture; the text says what."""


def why_unfit(page: Page, health: Sequence[str] = ("ok",), fewest_pictures: int = FEWEST_PICTURES) -> str:
    """The page's faults: health, rate and age of the pads, pictures a second, or the width; "" if nothing is.

    health: expected health of the pads in the picture. fewest_pictures: the least number a second that the page draws.
    """
    found = []
    for pad in page.evaluate(LOOK):
        if pad["health"] not in health:
            found.append(f"pad {pad['name']}: health {pad['health']}")
        elif pad["health"] == "ok" and pad["reason"]:
            found.append(f"pad {pad['name']}: {pad['reason']}")
        if pad["overloaded"]:
            found.append(f"pad {pad['name']}: frames were left out in the ten seconds that are shown")
        if pad["rate"] < FULL_RATE * pad["nominal"]:
            found.append(f"pad {pad['name']}: {pad['rate']:.0f} of {pad['nominal']:.0f} Hz")
        if pad["chosen"] and (pad["age"] is None or pad["age"] > OLDEST_MS):
            found.append(f"pad {pad['name']}: a message is {pad['age']} ms old when it is drawn")
    if (pictures := page.evaluate("fmfts.picturesPerSecond ?? 0")) < fewest_pictures:
        found.append(f"{pictures} pictures a second")
    if page.evaluate("fmfts.leftOut ?? 0"):
        found.append("messages were left out")
    if page.evaluate("document.documentElement.scrollWidth > innerWidth"):
        found.append("the page is wider than the window")
    return "; ".join(found)


def photographed(
    page: Page, shows: str = "true", health: Sequence[str] = ("ok",), clip: FloatRect | None = None
) -> bytes:
    """A picture of the whole page, or of the clip, which is fit before and after.

    shows: condition in JavaScript for the picture's subject. UnfitError says what stayed wrong for a minute.
    """
    end = time.monotonic() + PATIENCE_S
    while True:
        until(page, shows)
        why = why_unfit(page, health)
        shot = page.screenshot(full_page=clip is None, clip=clip)
        why = why or why_unfit(page, health) or ("" if page.evaluate(shows) else "it was over too soon")
        if not why:
            return shot
        if time.monotonic() > end:
            raise UnfitError(f"no picture is taken: {why}: take pictures on a computer that does nothing else")
        page.wait_for_timeout(WAIT_MS)
