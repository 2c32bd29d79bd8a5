"""`make page-drills`: what takes minutes or a quiet computer. Each prints its figures: run with -s.

Many pads, many pages, hostile connections, a long run, and the guided baseline to its end.
"""

from __future__ import annotations

import os
import random
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser

from end_to_end.first_use import EARTH_T
from end_to_end.processes import ROOT, UNTOUCHED_CONFIG, RunningDaemon
from fmfts.pad import rotation_from_vector
from fmfts.simulation.mounted import MountedPad
from page.conftest import Bench
from page.rig import CHROMIUM, View, opened, until

pytestmark = pytest.mark.needs(CHROMIUM)

PADS, WATCHED_S = 64, 10.0
LONG_S = float(os.environ.get("FMFTS_PAGE_SECONDS", "3600"))
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
    """In turns, so that whatever else the computer does meets both alike."""
    with ExitStack() as stack:
        daemon = stack.enter_context(RunningDaemon(tmp_path, UNTOUCHED_CONFIG))
        view = stack.enter_context(View(tmp_path, daemon.environment))
        figures: dict[int, list[tuple[float, float]]] = {0: [], 5: []}
        for _ in range(4):
            for pages in figures:
                open_pages = [opened(browser, view.address) for _ in range(pages)]
                time.sleep(2.0)
                figures[pages].append(_cost(daemon, 6.0))
                for page in open_pages:
                    page.context.close()
    for pages, taken in figures.items():
        share, p99 = np.array(taken).T
        print(
            f"\n{pages} pages: the daemon takes {100 * share.mean():.2f} ± {100 * share.std():.2f} % of a core, "
            f"p99 of the latency {1e3 * p99.mean():.2f} ± {1e3 * p99.std():.2f} ms"
        )
    none, five = (np.array(figures[pages])[:, 0] for pages in (0, 5))
    assert five.mean() - none.mean() < 3.0 * max(none.std(), five.std(), 0.002)


def _cost(daemon: RunningDaemon, seconds: float) -> tuple[float, float]:
    """Share of a core, and the median p99 of its latency as it tells it each second."""

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


def test_a_hundred_thousand_fuzzed_requests_and_a_thousand_connections_change_nothing(
    browser: Browser, tmp_path: Path
) -> None:
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
            pass  # hung up on: that is an answer


def test_a_long_run_does_not_grow(browser: Browser, tmp_path: Path) -> None:
    """FMFTS_PAGE_SECONDS: an hour unless told otherwise. The ten minutes that are kept are full after ten."""
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


def test_guided_turn_and_presses_run_to_their_end(browser: Browser, tmp_path_factory: pytest.TempPathFactory) -> None:
    bench = Bench(tmp_path_factory.mktemp("guided"))
    over, began = threading.Event(), time.monotonic()
    try:
        bench.board.field(EARTH_T)
        page = opened(browser, bench.view.address)
        until(page, "document.querySelector('#health').dataset.health === 'no_baseline'")
        page.keyboard.press("g")
        state = "document.querySelectorAll('#cards > li')[{}].dataset.state"
        world = MountedPad.exact(bench.pad)
        hands = {
            3: lambda s: (np.eye(3), (0.0, 0.0, 0.0)),
            4: lambda s: (_turned(s), (0.0, 0.0, 0.0)),
            5: lambda s: (np.eye(3), _press(s)),
        }
        for card in range(6):
            stop = threading.Event()

            def follow(card: int = card, stop: threading.Event = stop) -> None:
                while not (stop.is_set() or over.is_set()):
                    turn, press = hands[card](time.monotonic() - began)
                    field = world.magnet_field(*(np.full(4, value) for value in press)) + turn.T @ EARTH_T[0]
                    bench.board.field(world.sensed(field))
                    time.sleep(0.005)  # a step of the field between two chips would look like a touch

            hand = threading.Thread(target=follow) if card in hands else None
            if hand:
                hand.start()
                time.sleep(0.2)
            page.click(f"#cards > li:nth-child({card + 1}) button")
            until(page, f"{state.format(card)} !== 'running'", 90.0)
            if hand:
                stop.set()
                hand.join()
            told = page.inner_text(f"#cards > li:nth-child({card + 1}) .result")
            print(f"\n{card + 1}: {' '.join(told.split())[:200]}")
            assert page.evaluate(state.format(card)) == "done", told
        assert page.locator("#cards > li:nth-child(6) .gains b").count() == 2
        assert page.complaints == []  # type: ignore[attr-defined]
        page.context.close()
    finally:
        over.set()
        bench.close()


def _turned(time_s: float) -> np.ndarray:
    """A robot that sways about all three axes."""
    angles = np.array([1.5, 1.5, 2.4]) * np.sin(np.array([0.5, 0.37, 0.31]) * time_s)
    return rotation_from_vector(angles)


def _press(time_s: float) -> tuple[float, float, float]:
    """Another place and force every second, all over the pad."""
    number, within = divmod(time_s, 1.0)
    place = np.random.default_rng(int(number)).uniform((-11e-3, -11e-3, 0.3), (11e-3, 11e-3, 1.7))
    return float(place[0]), float(place[1]), float(place[2]) if within > 0.25 else 0.0
