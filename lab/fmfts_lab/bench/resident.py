"""Does the daemon's memory grow? Its resident memory, minute by minute, while pads on ptys are pressed all the time."""

from __future__ import annotations

import argparse
import os
import signal
import tempfile
import time
from collections import Counter
from pathlib import Path

import msgspec
import numpy as np
import zmq

from fmfts_lab.bench import latency_rig as rig
from fmfts_lab.bench.latency import cpu_of, pad_of, rss_of, spawn, start_daemon

SETTLING_S = 60.0  # by then the memory for the first status, touch and events is allocated


def run(options: argparse.Namespace) -> None:
    print(
        f"{options.pads} pad(s) at {rig.RATE_HZ} Hz; resident memory in MB, descriptors, processor time in % of a core"
    )
    with tempfile.TemporaryDirectory(prefix="fmfts-resident-") as name:
        folder = Path(name)
        pipe, boards = spawn(rig.steady_boards, rig.samples(pad_of(0), rig.CYCLE_S), options.pads)
        daemon = start_daemon(folder, pipe.recv())
        try:
            watch(daemon.pid, f"ipc://{folder}/bus", options.seconds, options.every)
        finally:
            pipe.send("stop")
            daemon.send_signal(signal.SIGTERM)
            daemon.wait(20)
            boards.join(20)


def watch(pid: int, endpoint: str, seconds: float, every_s: float) -> None:
    """Print a row every `every_s`, and the growth after SETTLING_S as the slope of a line."""
    socket: zmq.Socket[bytes] = zmq.Context.instance().socket(zmq.SUB)
    socket.connect(endpoint)
    socket.subscribe(b"contact/")
    begun_s, rows = time.monotonic(), list[tuple[float, float]]()
    cpu_ns, before_s = cpu_of(pid), begun_s
    print(f"{'s':>7} {'RSS':>7} {'fds':>4} {'CPU':>5}  messages by health")
    while before_s - begun_s < seconds:
        health = heard(socket, before_s + every_s)
        now_s, now_ns, rss_mb = time.monotonic(), cpu_of(pid), rss_of(pid)
        share = (now_ns - cpu_ns) / (now_s - before_s) * 1e-7
        descriptors = len(os.listdir(f"/proc/{pid}/fd"))
        told = ", ".join(f"{count} {name}" for name, count in sorted(health.items()))
        print(f"{now_s - begun_s:7.0f} {rss_mb:7.2f} {descriptors:4d} {share:5.1f}  {told}", flush=True)
        rows.append((now_s - begun_s, rss_mb))
        cpu_ns, before_s = now_ns, now_s
    settled = np.array([row for row in rows if row[0] >= SETTLING_S])
    if len(settled) > 2:
        slope = np.polyfit(settled[:, 0] / 3600.0, settled[:, 1], 1)[0]
        print(
            f"after {SETTLING_S:.0f} s: {settled[0, 1]:.2f} MB, at the end {settled[-1, 1]:.2f}, "
            f"largest {settled[:, 1].max():.2f}; slope {slope:+.3f} MB an hour"
        )


def heard(socket: zmq.Socket[bytes], until_s: float) -> Counter[str]:
    """Count the contacts until `until_s`, by their health."""
    found: Counter[str] = Counter()
    while (left_s := until_s - time.monotonic()) > 0.0:
        if socket.poll(round(left_s * 1e3)):
            _, payload = socket.recv_multipart()
            found[msgspec.msgpack.decode(payload)["health"]] += 1
    return found
