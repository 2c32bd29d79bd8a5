"""How `view` opens the page: at once, and without showing the token to other users of the computer."""

from __future__ import annotations

import os
import signal
import socket
import stat
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from urllib.parse import unquote, urlparse

import pytest
from playwright.sync_api import Browser

from end_to_end.processes import PATIENCE_S, UNTOUCHED_CONFIG, RunningDaemon
from fmfts_page.browser import folder_for_browsers
from page.rig import CHROMIUM, View, opened, until


class BrowserInForeground:
    """A program for BROWSER that writes down its arguments and then runs for a minute. `view` shows no daemon."""

    def __init__(self, folder: Path) -> None:
        self._pid, self._arguments = folder / "pid", folder / "arguments"
        self.command = folder / "browser"
        self.command.write_text(
            f"#!/bin/sh\necho $$ >{self._pid}.new\nmv {self._pid}.new {self._pid}\necho \"$@\" >{self._arguments}.new\n"
            f"mv {self._arguments}.new {self._arguments}\nfor second in $(seq 60); do sleep 1; done\n"
        )  # fmt: skip
        self.command.chmod(0o700)

    def address(self) -> str:
        until_s = time.monotonic() + PATIENCE_S
        while not self._arguments.exists():
            assert time.monotonic() < until_s, "no browser was started"
            time.sleep(0.01)
        return self._arguments.read_text().strip()

    def close(self) -> None:
        with suppress(ProcessLookupError):  # it ends by itself after a minute
            if self._pid.exists():
                os.kill(int(self._pid.read_text()), signal.SIGKILL)


@contextmanager
def opened_by_view(folder: Path, environment: dict[str, str]) -> Iterator[tuple[View, str]]:
    """`view`, and the address that it passed to the browser."""
    browser = BrowserInForeground(folder)
    with View(folder, environment, browser=str(browser.command)) as view:
        try:
            yield view, browser.address()
        finally:
            browser.close()


def programs_that_show(secret: str) -> list[str]:
    """Arguments and environments in which other programs, or their users, could read it."""
    found = []
    for file in (*Path("/proc").glob("[0-9]*/cmdline"), *Path("/proc").glob("[0-9]*/environ")):
        try:
            if secret.encode() in file.read_bytes():
                found.append(str(file))
        except OSError:
            pass  # the process has ended, or is another user's
    return found


def test_no_argument_or_environment_shows_the_token(tmp_path: Path) -> None:
    base = {"FMFTS_BUS": f"ipc://{tmp_path}", "XDG_RUNTIME_DIR": str(tmp_path)}
    with opened_by_view(tmp_path, os.environ | base) as (view, address):
        assert programs_that_show(view.token) == []
        assert programs_that_show(address) != [], "the search finds what is there"
        file = Path(unquote(urlparse(address).path))
        assert view.address in file.read_text()
        assert stat.S_IMODE(file.stat().st_mode) == 0o600
        assert stat.S_IMODE(file.parent.stat().st_mode) == 0o700
    assert not file.parent.exists(), "the file goes when view ends"


def test_page_is_served_while_the_browser_runs_in_foreground(tmp_path: Path) -> None:
    with (
        opened_by_view(tmp_path, os.environ | {"FMFTS_BUS": f"ipc://{tmp_path}"}) as (view, _),
        socket.create_connection(("127.0.0.1", view.port), timeout=PATIENCE_S) as peer,
    ):
        peer.sendall(f"GET / HTTP/1.1\r\nHost: 127.0.0.1:{view.port}\r\n\r\n".encode())
        assert peer.recv(12) == b"HTTP/1.1 200"


def test_browser_from_a_snap_gets_a_file_that_it_may_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", "/home/somebody")
    assert folder_for_browsers({"XDG_RUNTIME_DIR": "/run/user/1"}, (tmp_path,)) == Path("/home/somebody")
    assert folder_for_browsers({"XDG_RUNTIME_DIR": "/run/user/1"}, ()) == Path("/run/user/1")


@pytest.mark.needs(CHROMIUM)
@pytest.mark.slow
def test_chromium_follows_the_file_to_the_page(browser: Browser, tmp_path: Path) -> None:
    with (
        RunningDaemon(tmp_path, UNTOUCHED_CONFIG) as daemon,
        opened_by_view(tmp_path, daemon.environment) as (view, address),
    ):
        page = opened(browser, address)
        until(page, "document.querySelector('#health')?.dataset.health === 'ok'")
        assert page.url == f"http://127.0.0.1:{view.port}/"
        page.context.close()
