"""`make page-drills`: drills that take minutes or a quiet computer. Each prints its figures: run with -s.

Many pads, many pages, hostile connections, a long run, and the guided first use of a board to its end.
"""

from __future__ import annotations

import json
import os
import random
import socket
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser
from websockets.sync.client import connect
from websockets.typing import Origin

from end_to_end.processes import BRIDGE_CONFIG, ROOT, UNTOUCHED_CONFIG, RunningDaemon
from fmfts.config.file import load
from fmfts_simulation.hands import PressesAllOver
from page.hands import HandledBoard, swaying
from page.rig import CHROMIUM, View, opened, run_card, until

pytestmark = pytest.mark.needs(CHROMIUM)

PADS, WATCHED_S = 64, 10.0
LONG_S = float(os.environ.get("FMFTS_PAGE_SECONDS", "3600"))
COST_S, ROUNDS = min(6.0, LONG_S / 10.0), 4
FUZZED, CONNECTIONS = int(os.environ.get("FMFTS_PAGE_FUZZED", "100000")), 1000


def used(view: View, seconds: float) -> float:
    """Share of a core that the server of the page takes."""
    began, at = view.processor_s, time.monotonic()
    time.sleep(seconds)
    return (view.processor_s - began) / (time.monotonic() - at)


@pytest.fixture
def many(tmp_path: Path) -> Iterator[View]:
    """The page of a bus of 64 pads at 220 Hz."""
    base = f"ipc://{tmp_path}"
    sender = subprocess.Popen([sys.executable, ROOT / "tests/page/load.py", base, str(PADS)])
    try:
        with View(tmp_path, os.environ | {"FMFTS_BUS": base}) as view:
            yield view
    finally:
        sender.kill()
        sender.wait()


def test_64_pads_are_drawn_and_cost_little(browser: Browser, many: View) -> None:
    time.sleep(1.0)
    alone = used(many, WATCHED_S)
    page = opened(browser, many.address)
    until(page, f"fmfts.pads.size === {PADS}")
    time.sleep(3.0)
    watched = used(many, WATCHED_S)
    pictures = page.evaluate("fmfts.picturesPerSecond")
    said = page.inner_text("#link")
    page.context.close()
    print(
        f"\n{PADS} pads × 220 Hz: {pictures} pictures a second ({said}); view takes {100 * watched:.1f} % of a core "
        f"with a page, {100 * alone:.1f} % without"
    )
    assert pictures >= 30 or "shows less often" in said
    assert watched <= 0.25
    assert alone <= 0.03


def test_five_pages_cost_the_daemon_nothing(browser: Browser, tmp_path: Path) -> None:
    """In turns, so that the computer's other work affects all equally. Drawing costs the browser's computer: pages that
    are only received show the cost of serving them."""
    with ExitStack() as stack:
        daemon = stack.enter_context(RunningDaemon(tmp_path, UNTOUCHED_CONFIG))
        view = stack.enter_context(View(tmp_path, daemon.environment))
        ways: dict[str, Callable[[ExitStack], object]] = {
            "no page": lambda now: None,
            "five pages received": lambda now: [now.enter_context(_received(view)) for _ in range(5)],
            "five pages drawn here": lambda now: [
                now.callback(opened(browser, view.address).context.close) for _ in range(5)
            ],
        }
        figures: dict[str, list[tuple[float, float]]] = {way: [] for way in ways}
        for _ in range(ROUNDS):
            for way, begin in ways.items():
                with ExitStack() as now:
                    begin(now)
                    time.sleep(2.0)
                    figures[way].append(_cost(daemon, COST_S))
    print(f"\n{ROUNDS} times {COST_S:.0f} s of each, in turns; load {os.getloadavg()[0]:.1f}")
    for way, taken in figures.items():
        share, p99 = np.array(taken).T
        print(
            f"{way}: the daemon takes {100 * share.mean():.2f} ± {100 * share.std():.2f} % of a core, "
            f"p99 of the latency {1e3 * p99.mean():.2f} ± {1e3 * p99.std():.2f} ms"
        )
    none, five = (np.array(figures[way])[:, 0] for way in ("no page", "five pages drawn here"))
    assert five.mean() - none.mean() < 3.0 * max(none.std(), five.std(), 0.002)


@contextmanager
def _received(view: View) -> Iterator[None]:
    """A page's connection without the page: it watches the pad, and reads everything that comes."""
    origin = f"http://127.0.0.1:{view.port}"
    with connect(f"ws://127.0.0.1:{view.port}/socket", origin=Origin(origin), proxy=None) as socket:
        socket.send(json.dumps({"token": view.token}))
        socket.send(json.dumps({"ask": "watch", "detail": "left"}))
        reader = threading.Thread(target=lambda: deque(socket, maxlen=0))
        reader.start()
        try:
            yield
        finally:
            socket.close()
            reader.join()


def _cost(daemon: RunningDaemon, seconds: float) -> tuple[float, float]:
    """Share of a core, and the median of the p99 latency that the daemon reports each second."""

    def processor_s() -> float:
        fields = Path(f"/proc/{daemon.process.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / 100.0

    began, at, p99 = processor_s(), time.monotonic(), []
    with daemon.subscribe("status") as messages:
        while time.monotonic() - at < seconds:
            message = messages.receive(2.0)
            if message is not None and message.body["latency_p99_s"] is not None:
                p99.append(message.body["latency_p99_s"])
    return (processor_s() - began) / (time.monotonic() - at), float(np.median(p99))


def test_fuzzed_requests_and_many_connections_change_nothing(browser: Browser, tmp_path: Path) -> None:
    with ExitStack() as stack:
        daemon = stack.enter_context(RunningDaemon(tmp_path, UNTOUCHED_CONFIG))
        view = stack.enter_context(View(tmp_path, daemon.environment))
        baseline = daemon.request("pads")["pads"][0]["baseline"]
        page = opened(browser, view.address)
        until(page, "document.querySelector('#health').dataset.health === 'ok'")
        before_kb = view.resident_kb
        idle = [socket.create_connection(("127.0.0.1", view.port)) for _ in range(CONNECTIONS)]
        began = time.monotonic()
        threads = [threading.Thread(target=_fuzz, args=(view.port, seed, FUZZED // 4)) for seed in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        after_kb = view.resident_kb
        until(page, "document.querySelector('#health').dataset.health === 'ok'")
        another = opened(browser, view.address)
        until(another, "document.querySelector('#health').dataset.health === 'ok'")
        for each in idle:
            each.close()
        print(
            f"\n{FUZZED} fuzzed requests in {time.monotonic() - began:.0f} s beside {CONNECTIONS} open connections: "
            f"{before_kb} kB before, {after_kb} kB after"
        )
        assert daemon.request("pads")["pads"][0]["baseline"] == baseline
        assert sorted(path.name for path in tmp_path.glob("*.mcap")) == []
        assert after_kb - before_kb < 50_000
        for each in (page, another):
            each.context.close()


def _fuzz(port: int, seed: int, count: int) -> None:
    chance = random.Random(seed)
    whole = (
        f"GET /socket HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nOrigin: http://127.0.0.1:{port}\r\nUpgrade: websocket\r\n"
        "Connection: Upgrade\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n"
    ).encode()
    for _ in range(count):
        request = bytearray(whole + chance.randbytes(chance.randrange(64)))
        for _ in range(chance.randrange(12)):
            request[chance.randrange(len(request))] = chance.randrange(256)
        try:
            with socket.create_connection(("127.0.0.1", port), timeout=20.0) as peer:
                peer.sendall(bytes(request[: chance.randrange(len(request))] if chance.random() < 0.2 else request))
                if chance.random() < 0.3:
                    peer.settimeout(0.02)
                    peer.recv(4096)
        except OSError:
            pass  # the connection was closed: that counts as an answer


def test_long_run_does_not_grow(browser: Browser, tmp_path: Path) -> None:
    """FMFTS_PAGE_SECONDS: an hour unless told otherwise. The ten minutes of history are full after ten."""
    with ExitStack() as stack:
        config = UNTOUCHED_CONFIG.replace('finger = "none"', 'finger = "script"')
        daemon = stack.enter_context(RunningDaemon(tmp_path, config))
        view = stack.enter_context(View(tmp_path, daemon.environment))
        page = opened(browser, view.address)
        until(page, "document.querySelector('#health').dataset.health === 'ok'")
        tools = page.context.new_cdp_session(page)
        heaps = []
        for _ in range(7):
            page.wait_for_timeout(LONG_S / 7 * 1e3)
            tools.send("HeapProfiler.collectGarbage")
            heaps.append((tools.send("Runtime.getHeapUsage")["usedSize"] / 1e6, view.resident_kb / 1e3))
        print(f"\n{LONG_S:.0f} s: heap of the page and memory of view, MB: {[tuple(np.round(h, 1)) for h in heaps]}")
        kept = [heap for heap, _ in heaps if heap]
        if LONG_S >= 1800:
            assert max(kept[4:]) < 1.15 * max(kept[1:4])
            assert heaps[-1][1] < heaps[1][1] + 10.0
        page.context.close()


def test_guided_turn_and_presses_of_a_board_run_to_their_end(browser: Browser, tmp_path: Path) -> None:
    with ExitStack() as stack:
        hands = stack.enter_context(HandledBoard(tmp_path))
        daemon = stack.enter_context(RunningDaemon(tmp_path, BRIDGE_CONFIG.format(port=hands.board.port)))
        view = stack.enter_context(View(tmp_path, daemon.environment))
        pad = load(daemon.config)[0].pad[0].pad()
        page = opened(browser, view.address)
        until(page, "document.querySelector('#health').dataset.health === 'no_baseline'")
        page.keyboard.press("g")
        for card in range(6):
            if card == 3:
                hands.hold(pad)
            elif card == 4:
                hands.hold(pad, turn=swaying)
            elif card == 5:
                hands.hold(pad, finger=PressesAllOver(begin_s=1.0))
            print(f"\n{card + 1}: {' '.join(run_card(page, card, 'done').split())[:200]}")
        assert page.complaints == []  # type: ignore[attr-defined]
        page.context.close()
