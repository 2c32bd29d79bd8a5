"""Latency and processor time from the bytes of a frame to its message, compared with an echo that only copies.

A frame counts as *there* when its last byte is handed to the pty. The time before that (the wire, and the age of the
interpolated samples) is reported separately. Echo and daemon are measured by turns with the same boards.
"""

from __future__ import annotations

import argparse
import multiprocessing.connection
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from fmfts import baseline as baselines
from fmfts.config import MagnetConfig, PadConfig, SimulatedSource
from fmfts.sensor.wire.framing import encode
from fmfts_lab.bench import latency_rig as rig
from fmfts_lab.bench.latency_run import WARM_UP_S, Run, lateness, matched, measured_from
from fmfts_simulation.baseline import simulated_baseline

LATEST_S = 1.0  # a message that comes later than this after the last frame counts as lost
COLUMNS = (
    *("pads", "who", "publish p50", "p99", "p99.9", "max", "subscriber p50", "p99", "p99.9", "max"),
    *("CPU", "main µs", "others µs", "boards late p99", "RSS", "grew", "no room", "unheard"),
)


@dataclass
class Rig:
    """The processes around the measured one (boards, subscriber), in their own folder."""

    count: int
    lines: list[bytes]
    folder: Path

    def run(self, start: Callable[[list[str]], int], stop: Callable[[], None], is_echo: bool) -> Run:
        """start: a process that reads these ports, its id."""
        endpoint = f"ipc://{self.folder}/bus"
        board_pipe, board = spawn(rig.boards, self.lines, self.count)
        pid = start(board_pipe.recv())
        listener_pipe, listener = spawn(rig.subscriber, endpoint, self.count)
        if not listener_pipe.poll(60):
            raise SystemExit("not every pad was heard within a minute")
        listener_pipe.recv()
        board_pipe.send("go")
        multiprocessing.connection.wait([board.sentinel], WARM_UP_S)
        cpu_ns, rss_mb, begun_ns = np.array(cpu_by_thread(pid)), rss_of(pid), time.monotonic_ns()
        written_ns, lost = board_pipe.recv()
        # Time per frame times the nominal rate: on a busy computer the boards themselves fall behind that rate.
        frames = max(int((written_ns >= begun_ns).sum()) - lost, 1)
        main_ns, others_ns = ((cpu_by_thread(pid) - cpu_ns) / frames).tolist()
        cpu_share = (main_ns + others_ns) * 1e-9 * rig.RATE_HZ * self.count
        rss = rss_of(pid)
        multiprocessing.connection.wait([board.sentinel], LATEST_S)
        listener_pipe.send("stop")
        messages = listener_pipe.recv()
        board_pipe.send("stop")
        stop()
        for process in (board, listener):
            process.join()
        publish, arrive, age = matched(messages, written_ns, is_echo)
        unheard = int((written_ns >= measured_from(written_ns)).sum()) - publish.size
        cost = lateness(written_ns), (main_ns, others_ns), cpu_share, rss, rss - rss_mb
        return Run(publish, arrive, age, *cost, written_ns.size, lost, unheard)

    def echo(self, size: int) -> Run:
        pipe: Any = None
        process: Any = None

        def start(ports: list[str]) -> int:
            nonlocal pipe, process
            pipe, process = spawn(rig.echo, f"ipc://{self.folder}/bus", ports, size)
            assert process.pid is not None
            return int(process.pid)

        def stop() -> None:
            pipe.send("stop")
            process.join()

        return self.run(start, stop, is_echo=True)

    def daemon(self) -> Run:
        process: subprocess.Popen[bytes] | None = None

        def start(ports: list[str]) -> int:
            nonlocal process
            process = start_daemon(self.folder, ports)
            return process.pid

        def stop() -> None:
            assert process is not None
            process.send_signal(signal.SIGTERM)
            process.wait(20)

        return self.run(start, stop, is_echo=False)


def spawn(target: Callable[..., None], *args: Any) -> tuple[Any, Any]:
    """Start a process with one end of a pipe. Returns the other end, and the process."""
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=target, args=(theirs, *args), daemon=True)
    process.start()
    return ours, process


def start_daemon(folder: Path, ports: list[str], service: str = "") -> subprocess.Popen[bytes]:
    """One pad on each port, with baselines; its socket and its log are in `folder`. service: more of the config."""
    store_baselines(folder, len(ports))
    config = folder / "config.toml"
    config.write_text(config_text(ports) + service)
    environ = os.environ | {"XDG_STATE_HOME": str(folder), "FMFTS_BUS": f"ipc://{folder}"}
    with (folder / "log").open("wb") as output:
        return subprocess.Popen([sys.executable, "-m", "fmfts", "run", "--config", config], env=environ, stderr=output)


def config_text(ports: list[str]) -> str:
    pads = [
        f'[[pad]]\nname = "p{index}"\nsource = {{ type = "bridge", port = "{port}" }}\n'
        "magnet = { temperature_coefficient_per_k = 0.0 }\n"
        for index, port in enumerate(ports)
    ]
    return "\n".join(pads)


def pad_of(index: int) -> PadConfig:
    return PadConfig(
        name=f"p{index}",
        source=SimulatedSource(seed=1),
        magnet=MagnetConfig(temperature_coefficient_per_k=0.0),
    )


def store_baselines(folder: Path, count: int) -> None:
    """The same pad `count` times, each under its own name."""
    target = folder / "fmfts" / "baseline"
    target.mkdir(parents=True)
    baseline = simulated_baseline(pad_of(0))
    for index in range(count):
        own = msgspec.structs.replace(baseline, pad=f"p{index}").sealed()
        (target / f"p{index}.json").write_bytes(baselines.encode(own))


def cpu_of(pid: int) -> int:
    """Processor time (ns) of all threads of a process."""
    return sum(cpu_by_thread(pid))


def cpu_by_thread(pid: int) -> tuple[int, int]:
    """Processor time (ns) of a process: of the main thread, and of all others."""
    ran_ns = {
        int(task.name): int((task / "schedstat").read_text().split()[0]) for task in Path(f"/proc/{pid}/task").iterdir()
    }
    return ran_ns[pid], sum(ran_ns.values()) - ran_ns[pid]


def rss_of(pid: int) -> float:
    for line in Path(f"/proc/{pid}/status").read_text().splitlines():
        if line.startswith("VmRSS:"):
            return int(line.split()[1]) * 1024 / 1e6
    raise SystemExit(f"process {pid} has ended")


def row(name: str, count: int, run: Run) -> str:
    """A line of the Markdown table with the head COLUMNS."""
    times_us = [
        f"{value:.0f}"
        for times_ns in (run.to_publish_ns, run.to_subscriber_ns)
        for value in np.percentile(times_ns, [50, 99, 99.9, 100]) / 1e3
    ]
    cost = [f"{100 * run.cpu_share:.1f}", *(f"{value / 1e3:.1f}" for value in run.cpu_ns)]
    cost += [f"{np.percentile(run.boards_late_ns, 99) / 1e3:.0f}", f"{run.rss_mb:.1f}", f"{run.rss_growth_mb:+.2f}"]
    return table_line([str(count), name, *times_us, *cost, str(run.lost), str(run.unheard)])


def table_line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def run(options: argparse.Namespace) -> None:
    print(
        "µs from a frame's last byte on the pty; CPU in % of one core, and µs of each frame by the main thread and the "
        "others; how late the boards were, µs; RSS in MB, and its growth after the warm-up.\n"
    )
    print(f"{table_line(COLUMNS)}\n{table_line(['---'] * len(COLUMNS))}")
    lines = [encode(sample) for sample in rig.samples(pad_of(0), WARM_UP_S + options.seconds)]
    runs: dict[str, list[tuple[int, Run]]] = {"echo": [], "daemon": []}
    for count in options.pads:
        for _ in range(options.rounds):
            for kind in ("echo", "daemon"):
                with tempfile.TemporaryDirectory(prefix="fmfts-latency-") as name:
                    around = Rig(count, lines, Path(name))
                    one = around.echo(options.size) if kind == "echo" else around.daemon()
                print(row(kind, count, one), flush=True)
                runs[kind].append((count, one))
    age_ms = np.percentile(np.concatenate([one.age_ns for _, one in runs["daemon"]]), [50, 99]) / 1e6
    print(f"\nSamples were {age_ms[0]:.1f} ms old when their frame was there, p99 {age_ms[1]:.1f} ms.")
    if options.chart is not None:
        from fmfts_lab.bench.latency_chart import draw

        draw(runs, options.chart)
