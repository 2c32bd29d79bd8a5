"""Floods of requests against a daemon whose pads are boards on ptys: the effect on its contacts, and on the requests.

Flooders run with nice 19, so that they cost the daemon only its answers, and no processor time (`--nice`: another
value, if other programs would leave them none). Boards and subscriber have priority over the daemon (overload_rig), and
the daemon over every ordinary process, like its service.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import msgpack
import numpy as np
from numpy.typing import NDArray

from fmfts_client import Endpoints
from fmfts_lab.bench.latency import config_text, rss_of, spawn, store_baselines, table_line
from fmfts_lab.bench.latency_rig import RATE_HZ
from fmfts_lab.bench.overload_rig import WARM_UP_S, Load, boards, recordings, sleep_until, subscriber
from ports import tcp_base

DAEMON_PRIORITY = "10"  # of systemd/fmfts.service
REST_S = 2.5  # for a flood to begin, and for its last answers
COLUMNS = (
    *("pads", "over", "flood", "contacts, % of idle", "age p99, ms", "of idle", "at subscriber p99, ms", "of idle"),
    *("asked per s", "answered", "refused", "unanswered", "RSS, MB"),
)
LEAST_SHARE, MOST_OF_IDLE = 0.99, 2.0
HELD = 0.5  # share of its turns in which a flood had to wait for answers, or for its socket
LEAST_OF_RATE = 0.9  # share of the boards' frames without requests, and of a flood's requests


@dataclass(frozen=True)
class Flood:
    name: str
    options: tuple[str, ...] = ()

    @property
    def per_s(self) -> float:
        """Named requests per second; 0: as many as the daemon answers."""
        return float(self.options[self.options.index("--per-s") + 1]) if "--per-s" in self.options else 0.0


IDLE = Flood("idle")
# Each is compared with its own idle time, because the boards' frames are numbered for 37 s (latency_rig.NUMBERS).
RUNS = (
    (
        IDLE,
        Flood("one client, 20,000/s", ("--per-s", "20000", "--waiting", "1000")),
        Flood("64 polite: each waits for its answer", ("--peers", "64", "--waiting", "1")),
        Flood("64 polite, status", ("--peers", "64", "--waiting", "1", "--verb", "status")),
    ),
    (
        IDLE,
        Flood("one, status without pause", ("--waiting", "1", "--verb", "status")),
        Flood("64 that do not wait", ("--peers", "64", "--waiting", "16")),
        Flood("64 that do not read, status", ("--peers", "64", "--per-s", "20000", "--deaf", "--verb", "status")),
    ),
)


@dataclass(frozen=True)
class Window:
    """The contacts that were received and sampled within a time."""

    contacts: int
    age_s: float
    arrival_s: float


Times = NDArray[np.int64]


def heard(messages: list[tuple[bytes, int, bytes]]) -> Times:
    """(M, 3): when each contact with an estimate was sampled, published and received, in ns."""
    rows = []
    for _, arrived_ns, payload in messages:
        message = msgpack.unpackb(payload)
        if message["health"] == "ok":
            rows.append((message["t_sample_ns"], message["t_publish_ns"], arrived_ns))
    return np.array(rows, dtype=np.int64).reshape(-1, 3)


def window(times_ns: Times, begin_ns: int, end_ns: int) -> Window:
    sampled_ns, published_ns, arrived_ns = times_ns[(times_ns[:, 0] >= begin_ns) & (times_ns[:, 0] < end_ns)].T
    if not len(sampled_ns):
        raise SystemExit("no contact came: the floods took longer than the boards send")
    ages = [np.percentile(later - sampled_ns, 99) * 1e-9 for later in (published_ns, arrived_ns)]
    return Window(len(sampled_ns), *ages)


def start_daemon(folder: Path, base: str, ports: list[str]) -> subprocess.Popen[bytes]:
    store_baselines(folder, len(ports))
    config = folder / "config.toml"
    config.write_text(config_text(ports))
    environ = os.environ | {
        "XDG_STATE_HOME": str(folder),
        "FMFTS_BUS": base,
        "FMFTS_REALTIME_PRIORITY": DAEMON_PRIORITY,
    }
    with (folder / "log").open("wb") as output:
        return subprocess.Popen([sys.executable, "-m", "fmfts", "run", "--config", config], env=environ, stderr=output)


def measured(pads: int, base: str, floods: Sequence[Flood], seconds: float, folder: Path, nice: int) -> list[list[str]]:
    endpoints = Endpoints.from_base(base)
    total_s = len(floods) * (seconds + REST_S)
    recorded = recordings(Load(pads), WARM_UP_S + total_s + REST_S)
    board_pipe, board = spawn(boards, recorded, total_s)
    daemon = start_daemon(folder, base, board_pipe.recv())
    try:
        listener_pipe, listener = spawn(subscriber, endpoints.bus, pads)
        if not listener_pipe.poll(120):
            raise SystemExit(f"not every pad was heard\n{(folder / 'log').read_text()}")
        listener_pipe.recv()
        board_pipe.send("go")
        begin_ns, _ = board_pipe.recv()
        done = []
        for number, flood in enumerate(floods):
            begun_ns = begin_ns + round(number * (seconds + REST_S) * 1e9)
            sleep_until(begun_ns)
            counts = flooded(endpoints.control, flood, seconds, nice)
            begun_ns = counts.pop("begun_ns", begun_ns)
            if daemon.poll() is not None:
                raise SystemExit(f"the daemon has ended\n{(folder / 'log').read_text()}")
            done.append((flood, begun_ns, counts, rss_of(daemon.pid)))
        board_pipe.recv()
        time.sleep(1.0)
        listener_pipe.send("stop")
        times_ns = heard(listener_pipe.recv())
        board_pipe.send("stop")
        for process in (board, listener):
            process.join()
    finally:
        daemon.send_signal(signal.SIGTERM)
        daemon.wait(20)
    idle = window(times_ns, done[0][1], done[0][1] + round(seconds * 1e9))
    rows = []
    for flood, begun_ns, counts, rss_mb in done:
        now = window(times_ns, begun_ns, begun_ns + round(seconds * 1e9))
        rows.append(row(pads, base, flood, now, idle, counts, seconds, rss_mb))
    return rows


def flooded(address: str, flood: Flood, seconds: float, nice: int) -> dict[str, int]:
    if not flood.options:
        time.sleep(seconds)
        return {}
    command = [sys.executable, "-m", "drills.flooders", address, "--seconds", str(seconds), "--nice", str(nice)]
    run = subprocess.run(
        [*command, *flood.options],
        capture_output=True,
        text=True,
        check=True,
        env=os.environ | {"PYTHONPATH": str(Path(__file__).parents[1])},
    )
    counts: dict[str, int] = json.loads(run.stdout)
    return counts


def row(
    pads: int, base: str, flood: Flood, now: Window, idle: Window, counts: dict[str, int], seconds: float, rss_mb: float
) -> list[str]:
    share, ages = now.contacts / idle.contacts, (now.age_s / idle.age_s, now.arrival_s / idle.arrival_s)
    cells = [str(pads), base.partition(":")[0], flood.name, f"{100 * share:.2f}"]
    cells += [f"{now.age_s * 1e3:.2f}", f"{ages[0]:.2f}", f"{now.arrival_s * 1e3:.2f}", f"{ages[1]:.2f}"]
    cells += [
        f"{counts.get('asked', 0) / seconds:.0f}",
        *(str(counts.get(k, "")) for k in ("answered", "refused", "unanswered")),
    ]
    cells += [f"{rss_mb:.0f}"]
    of_boards = now.contacts / (pads * RATE_HZ * seconds)
    if share < LEAST_SHARE or of_boards < LEAST_OF_RATE or max(ages) > MOST_OF_IDLE or counts.get("unanswered"):
        cells[2] += f" **missed** ({of_boards:.0%} of the boards' frames)"
    asked = counts.get("asked", 0) / seconds
    if counts and asked < LEAST_OF_RATE * flood.per_s:
        # The peer stopped asking because it got no answers: the daemon accepted no more. Otherwise the flooder had no
        # processor.
        held = counts["held"] / counts["turns"]
        cells[2] += f" (held by the daemon at {asked:.0f}/s)" if held > HELD else f" **NOT REACHED**: {asked:.0f}/s"
    return cells


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pads", type=int, nargs="+", default=[1, 8, 32, 64])
    parser.add_argument("--over", nargs="+", default=["ipc", "tcp"])
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--nice", type=int, default=19)
    parser.add_argument("--loaded", action="store_true", help="other programs run: a flood may be slower than named")
    options = parser.parse_args()
    print(
        f"load average {os.getloadavg()[0]:.2f} before, {os.cpu_count()} processors; {options.seconds:g} s a row, "
        f"flooders with nice {options.nice}\n"
    )
    print(f"{table_line(COLUMNS)}\n{table_line(['---'] * len(COLUMNS))}", flush=True)
    missed = not_reached = False
    for pads in options.pads:
        for over in options.over:
            for floods in RUNS:
                with tempfile.TemporaryDirectory(prefix="fmfts-flood-") as name:
                    base = f"ipc://{name}" if over == "ipc" else tcp_base()
                    rows = measured(pads, base, floods, options.seconds, Path(name), options.nice)
                for cells in rows:
                    missed |= "**missed**" in cells[2]
                    not_reached |= "**NOT REACHED**" in cells[2]
                    print(table_line(cells), flush=True)
    print(f"\nload average {os.getloadavg()[0]:.2f} after")
    if missed:
        raise SystemExit("a bar was missed")
    if not_reached and not options.loaded:
        raise SystemExit("a flood was slower than its name says, and not for the daemon's sake: end other programs")


if __name__ == "__main__":
    main()
