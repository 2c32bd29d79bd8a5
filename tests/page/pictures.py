"""`make pictures`: takes the pictures of the manual from the real page, in Chromium, of the firmware on a pty.

They are: a touch (light, dark, on a phone), a sensor that is left out, the guided baseline, a hand beside a fixed
baseline, a moving touch, three robots of which one is lost. No picture is taken while rate, age or health is wrong.
"""

from __future__ import annotations

import io
import math
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path

from PIL import Image
from playwright.sync_api import Browser, FloatRect, Page

sys.path.insert(0, str(Path(__file__).parents[1]))

from end_to_end.firmware_in_the_loop import PressedPad
from end_to_end.first_use import EARTH_T
from end_to_end.hand_demo import Hand, served_hand
from end_to_end.processes import BRIDGE_CONFIG, ROOT, FirmwareHost, RunningDaemon, resting_field
from end_to_end.robots import Robots
from fmfts.config.file import load
from fmfts_simulation.finger import Touch
from page.fit_to_show import UnfitError, photographed, why_unfit
from page.rig import View, chromium, opened, until

DOCS = ROOT / "docs"
COLOURS = 160
MOVING_S, MOVING_HZ, MOVING_COLOURS = 6.0, 5, 96
LARGEST_BYTES = 200_000  # bytes of one picture: each is loaded with the README or a page of the manual
TRIES = 5
HEALTH = "document.querySelector('#health').dataset.health"
FORCE = "document.querySelector('#force').dataset.kind"


ALL_TOUCHED = """(() => {
    const pads = [...fmfts.pads.values()];
    return pads.length === 5 && pads.every((pad) => !pad.silent() && pad.contact.contact && pad.contact.force_n > 0.5
        && pad.contact.health === "ok" && pad.ghost);
})()"""


def keep(shot: bytes, name: str) -> None:
    """A picture with few colours takes a third of the bytes, and looks the same. Rare colours, as red, are kept."""
    picture = (
        Image.open(io.BytesIO(shot))
        .convert("RGB")
        .quantize(COLOURS, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
    )
    picture.save(DOCS / name, optimize=True)
    weigh(DOCS / name)


def weigh(path: Path) -> None:
    """Print the size of a picture; UnfitError if it is too large."""
    size = path.stat().st_size
    print(f"{path}: {size // 1000} kB", flush=True)
    if size > LARGEST_BYTES:
        raise UnfitError(f"{path} has {size // 1000} kB: take fewer colours, or a smaller part of the page")


def slide(time_s: float) -> Touch:
    """A finger that comes, slides in an eight, and goes, every six seconds."""
    now = time_s % MOVING_S
    rise = min(max(min(now - 0.4, MOVING_S - 0.8 - now) / 0.6, 0.0), 1.0)
    turn = 2.0 * math.pi * now / MOVING_S
    return Touch(7e-3 * math.sin(turn), 5e-3 * math.sin(2.0 * turn), 1.3 * rise * (0.8 + 0.2 * math.cos(turn)))


def one_pad(browser: Browser, folder: Path) -> None:
    with ExitStack() as stack:
        board = stack.enter_context(FirmwareHost(folder))
        daemon = stack.enter_context(RunningDaemon(folder, BRIDGE_CONFIG.format(port=board.port)))
        pad = load(daemon.config)[0].pad[0].pad()
        view = stack.enter_context(View(folder, daemon.environment))
        page = opened(browser, view.address)
        guided(page, board, resting_field(pad))
        pressed = stack.enter_context(PressedPad(board, pad, EARTH_T[0]))
        pressed.press(slide)
        until(page, f"{HEALTH} === 'ok'")
        page.wait_for_timeout(10_000)
        touched(page, "page.png")
        page.keyboard.press("t")
        touched(page, "page-dark.png")
        page.keyboard.press("t")
        page.set_viewport_size({"width": 390, "height": 844})
        touched(page, "page-phone.png")
        page.set_viewport_size({"width": 1440, "height": 900})
        photographed(page)
        moving(page)
        board.tell("fault 0 2 unplugged")
        until(page, f"{HEALTH} === 'degraded'")
        upper = FloatRect(x=0, y=0, width=1440, height=600)
        keep(photographed(page, f"{FORCE} === 'touch'", ("degraded",), upper), "page-fault.png")
        page.context.close()


def touched(page: Page, name: str) -> None:
    """The whole page while the finger presses with more than a newton."""
    pressed = f"{FORCE} === 'touch' && parseFloat(document.querySelector('#force').textContent) > 1.0"
    keep(photographed(page, pressed), name)


def guided(page: Page, board: FirmwareHost, at_rest: object) -> None:
    """The cards, when the baseline at rest was recorded."""
    board.field(EARTH_T)
    until(page, f"{HEALTH} === 'no_baseline'", 60.0)
    page.keyboard.press("g")
    for card in range(4):
        if card == 3:
            board.field(at_rest + EARTH_T)  # type: ignore[operator]
        state = f"document.querySelectorAll('#cards > li')[{card}].dataset.state"
        for _ in range(TRIES):  # a busy computer loses frames, and the baseline is refused
            page.click(f"#cards > li:nth-child({card + 1}) button")
            until(page, f"{state} !== 'running'", 60.0)
            if page.evaluate(state) == "done":
                break
    keep(photographed(page, clip=FloatRect(x=0, y=0, width=1440, height=900)), "page-guide.png")
    page.keyboard.press("Escape")


DRAWINGS = """() => {
    const [pad, side] = ["pad", "side"].map((id) => document.getElementById(id).getBoundingClientRect());
    const x = pad.left - 6, y = pad.top - 6;
    return { x, y, width: side.right + 6 - x, height: pad.bottom + 6 - y };
}"""


def moving(page: Page) -> None:
    """An animation of one round of the finger, of the pad and its section."""
    clip = page.evaluate(DRAWINGS)
    size = (700, round(700 * clip["height"] / clip["width"]))
    pictures, began = [], time.monotonic()
    for number in range(int(MOVING_S * MOVING_HZ)):
        page.wait_for_timeout(max(0.0, (began + number / MOVING_HZ - time.monotonic()) * 1e3))
        shot = page.screenshot(clip=clip)
        pictures.append(Image.open(io.BytesIO(shot)).convert("RGB").resize(size, Image.Resampling.LANCZOS))
    if why := why_unfit(page, fewest_pictures=0):  # the page draws fewer while pictures of it are taken
        raise UnfitError(f"page-touch.png is not taken: {why}: take pictures on a computer that does nothing else")
    every = Image.new("RGB", (size[0], size[1] * len(pictures)))
    for number, picture in enumerate(pictures):
        every.paste(picture, (0, size[1] * number))
    palette = every.quantize(MOVING_COLOURS, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
    few = [each.quantize(palette=palette, dither=Image.Dither.NONE) for each in pictures]
    path = DOCS / "page-touch.png"
    few[0].save(path, save_all=True, append_images=few[1:], duration=round(1000 / MOVING_HZ), loop=0, optimize=True)
    weigh(path)


def hand(browser: Browser, folder: Path) -> None:
    with ExitStack() as stack:
        served: Hand = served_hand(folder, stack)
        page = opened(browser, served.address)
        began = time.monotonic()
        while not (served.grips(time.monotonic() - began) and page.evaluate(ALL_TOUCHED)):
            served.move(time.monotonic() - began)
            page.wait_for_timeout(20)
        if why := why_unfit(page):
            raise UnfitError(f"page-hand.png is not taken: {why}: take pictures on a computer that does nothing else")
        keep(page.screenshot(full_page=True), "page-hand.png")
        page.context.close()


def fleet(browser: Browser, folder: Path) -> None:
    with ExitStack() as stack:
        robots = Robots(folder)
        stack.callback(robots.close)
        view = stack.enter_context(robots.view(robots.keys))
        page = opened(browser, view.address)
        until(page, "fmfts.robots.length === 3 && fmfts.robots.every((robot) => robot.state === 'there')", 60.0)
        page.wait_for_timeout(3_000)
        robots.daemons["leg"].process.kill()
        page.wait_for_timeout(12_000)
        bottom = page.evaluate("document.querySelector('#robots').getBoundingClientRect().bottom")
        keep(page.screenshot(clip={"x": 0, "y": 0, "width": 1440, "height": bottom + 12}), "fleet.png")
        page.context.close()


def main() -> None:
    takes = [take for take in (one_pad, hand, fleet) if len(sys.argv) < 2 or take.__name__ in sys.argv]
    with tempfile.TemporaryDirectory(prefix="fmfts-pictures-") as name, chromium() as browser:
        for take in takes:
            folder = Path(name) / take.__name__
            folder.mkdir()
            take(browser, folder)


if __name__ == "__main__":
    main()
