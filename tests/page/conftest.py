"""One daemon, one server of the page and one Chromium for all tests of a file, because they take seconds to start."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page

from end_to_end.firmware_in_the_loop import PressedPad
from end_to_end.processes import BRIDGE_CONFIG, FirmwareHost, RunningDaemon
from fmfts.config.file import load
from page.rig import View, chromium, opened, record_rest, until


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as browser:
        yield browser


class Bench:
    """A board on a pty, the daemon that reads it, and the page's server. `board` may be unplugged."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.board = FirmwareHost(folder)
        self.daemon = RunningDaemon(folder, BRIDGE_CONFIG.format(port=self.board.port))
        self.pad = load(self.daemon.config)[0].pad[0].pad()
        self.pressed = PressedPad(self.board, self.pad)
        self.view = View(folder, self.daemon.environment)

    def unplug(self) -> None:
        self.board.kill()

    def plug_in(self) -> None:
        self.board = FirmwareHost(self.folder)
        self.pressed = PressedPad(self.board, self.pad)

    def close(self) -> None:
        self.view.__exit__()
        self.daemon.__exit__()
        self.board.kill()


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    bench = Bench(tmp_path_factory.mktemp("page"))
    try:
        record_rest(bench.daemon)
        yield bench
    finally:
        bench.close()


@pytest.fixture(scope="module")
def one_page(browser: Browser, bench: Bench) -> Iterator[Page]:
    page = opened(browser, bench.view.address)
    yield page
    page.context.close()


@pytest.fixture
def page(one_page: Page, bench: Bench) -> Iterator[Page]:
    """The page, showing the untouched pad. Its console must stay empty, and it must load nothing from elsewhere."""
    bench.pressed.touch(0.0, 0.0, 0.0)
    until(one_page, "document.querySelector('#health').dataset.health === 'ok' && fmfts.nowMs() !== null")
    until(one_page, "document.querySelector('#force').dataset.kind === 'none'")
    yield one_page
    assert one_page.complaints == []  # type: ignore[attr-defined]
    assert one_page.foreign == []  # type: ignore[attr-defined]


def pytest_configure(config: pytest.Config) -> None:
    os.environ.setdefault("BROWSER", "none")
