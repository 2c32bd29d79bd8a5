"""The page as a person meets it: the firmware on a pty, the daemon, `fmfts-daemon view`, and Debian's Chromium."""

from __future__ import annotations

import select
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from playwright.sync_api import Browser, Page, sync_playwright

from end_to_end.processes import PATIENCE_S, START_PATIENCE_S, RunningDaemon

CHROMIUM = "chromium"
FLAGS = [
    "--no-sandbox",  # the tests may run as root
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]
# The state of the page that a test may look at: window.fmfts of main.js.
NEWEST = "fmfts.pads.get(fmfts.chosen)?.contact"
# A busy computer draws late: the second picture from now shows the page's present state.
TWO_PICTURES = "new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"


class View:
    """`fmfts-daemon view` for the daemon whose base is given; `address` is what it printed.

    browser: the command that it opens the page with.
    """

    def __init__(self, folder: Path, environment: dict[str, str], *options: str, browser: str = "none") -> None:
        command = [sys.executable, "-m", "fmfts", "view", "--port", "0", "--recordings", str(folder), *options]
        pipe = subprocess.PIPE
        self.process = subprocess.Popen(
            command, stdout=pipe, stderr=pipe, text=True, env=environment | {"BROWSER": browser, "DISPLAY": ":0"}
        )
        assert self.process.stdout is not None
        if not select.select([self.process.stdout], [], [], START_PATIENCE_S)[0]:
            self.process.kill()  # its output is read below
        first = self.process.stdout.readline()
        assert first.startswith("the page: "), first + self.process.communicate(timeout=PATIENCE_S)[1]
        self.address = first.removeprefix("the page: ").strip()

    @property
    def port(self) -> int:
        return int(self.address.split(":")[2].partition("/")[0])

    @property
    def token(self) -> str:
        return self.address.partition("#")[2]

    @property
    def resident_kb(self) -> int:
        status = Path(f"/proc/{self.process.pid}/status").read_text()
        return int(status.partition("VmRSS:")[2].split()[0])

    @property
    def processor_s(self) -> float:
        """Processor time so far."""
        fields = Path(f"/proc/{self.process.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / 100.0

    def __enter__(self) -> View:
        return self

    def __exit__(self, *_: object) -> None:
        self.process.send_signal(signal.SIGTERM)
        try:
            _, said = self.process.communicate(timeout=PATIENCE_S)
        except subprocess.TimeoutExpired as error:
            with self.process:
                self.process.kill()
            raise AssertionError("`view`, or the browser that it started, did not end after SIGTERM") from error
        assert (self.process.returncode, said) == (0, "")


@contextmanager
def chromium() -> Iterator[Browser]:
    """Headless, with a user's folder of its own."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=f"/usr/bin/{CHROMIUM}", args=FLAGS)
        try:
            yield browser
        finally:
            browser.close()


def opened(browser: Browser, address: str, **options: Any) -> Page:
    """The page at `address`. complaints: errors in its console; foreign: its requests to other servers."""
    context = browser.new_context(viewport={"width": 1440, "height": 900}, **options)
    context.grant_permissions(["clipboard-read", "clipboard-write"])
    page = context.new_page()
    complaints: list[str] = []
    page.on("console", lambda message: complaints.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda error: complaints.append(str(error)))
    foreign: list[str] = []
    origin = address.partition("/#")[0]
    page.on("request", lambda request: None if request.url.startswith(origin) else foreign.append(request.url))
    page.complaints, page.foreign = complaints, foreign  # type: ignore[attr-defined]
    page.goto(address)
    return page


def until(page: Page, condition: str, within_s: float = PATIENCE_S) -> None:
    """Wait until the JavaScript `condition` holds on the page.

    The page's policy forbids evaluating text, which Playwright's own waiting does; DevTools may.
    """
    end = time.monotonic() + within_s
    while not page.evaluate(condition):
        assert time.monotonic() < end, f"{condition}: not within {within_s} s; the page: {page.inner_text('main')}"
        page.wait_for_timeout(20)


LOOK = """(ms) => new Promise((done) => {
    const end = performance.now() + ms;
    const look = () => {
        if (CONDITION) done(fmfts.nowMs());
        else if (performance.now() > end) done(null);
        else requestAnimationFrame(look);
    };
    look();
})"""


def seconds_until(page: Page, condition: str, since_ns: int, within_s: float = PATIENCE_S) -> float:
    """Seconds from `since_ns` (CLOCK_MONOTONIC) to the first picture for which `condition` holds, on that clock."""
    told_ms = page.evaluate(LOOK.replace("CONDITION", condition), within_s * 1e3)
    assert told_ms is not None, f"{condition}: not within {within_s} s; the page: {page.inner_text('main')}"
    return float(told_ms) * 1e-3 - since_ns * 1e-9


def run_card(page: Page, number: int, ends: str, within_s: float = 90.0) -> str:
    """Start a card of the guide, 0 to 6, and wait for its end, "done" or "refused"; returns its text."""
    card = f"#cards > li:nth-child({number + 1})"
    page.click(f"{card} > button")
    until(page, f"document.querySelector('{card}').dataset.state !== 'running'", within_s)
    told: str = page.inner_text(f"{card} .result")
    assert page.get_attribute(card, "data-state") == ends, told
    return told


def record_rest(daemon: RunningDaemon) -> None:
    daemon.wait_for(lambda contact: contact.health == "no_baseline" and contact.sensors_ok == 0b1111)
    daemon.request("baseline", duration_s=1.0, timeout_s=PATIENCE_S)
    daemon.wait_for(lambda contact: contact.health == "ok" and contact.contact is False)
    time.sleep(0.2)
