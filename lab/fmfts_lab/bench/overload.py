"""More work than the computer can do: the age of published messages, the dropped frames, and the recovery.

Boards on ptys note when they wrote each frame; each message names its frame. So every age is the true one, whatever
the daemon says. Beside each row an echo (latency_rig) shows what the same share of a processor can carry.
"""

from __future__ import annotations

import argparse
import signal
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fmfts_lab.bench import latency_rig as rig
from fmfts_lab.bench.latency import cpu_by_thread, spawn, start_daemon, table_line
from fmfts_lab.bench.overload_judge import Heard, Verdict, judge, judge_echo
from fmfts_lab.bench.overload_rig import (
    AFTER_S,
    WARM_UP_S,
    Load,
    Start,
    Written,
    boards,
    busy,
    hold_to,
    recordings,
    sleep_until,
    subscriber,
)

LOADS = (
    Load(4, busy=4),
    Load(16, duty=0.08),
    Load(16, busy=2),
    Load(32),
    Load(64),
    Load(64, touched=True),
    Load(64, busy=4),
    Load(64, busy=4, realtime=20),
    Load(64, disturbed=True),
)
ECHO_BYTES = 860
COLUMNS = (
    *("load", "published, %", "echo, %", "age p50, ms", "p99", "max", "at subscriber p99", "uneven"),
    *("ok > 100 ms", "false times", "normal after, s", "CPU, %", "health"),
)


def measured(load: Load, recorded: list[list[bytes]], seconds: float, folder: Path, start: Start) -> Any:
    """Run the boards with the load on the process that `start` makes. Returns (heard, Written, share of a core)."""
    board_pipe, board = spawn(boards, recorded, seconds)
    pid = start(board_pipe.recv())
    listener_pipe, listener = spawn(subscriber, f"ipc://{folder}/bus", load.pads)
    if not listener_pipe.poll(60):
        raise SystemExit("not every pad was heard within a minute")
    listener_pipe.recv()
    board_pipe.send("go")
    load_ns = board_pipe.recv()
    sleep_until(load_ns[0])
    before = np.array(cpu_by_thread(pid))
    with busy(load.busy):
        hold_to(load.duty, pid, load_ns[1])
    cpu = float((np.array(cpu_by_thread(pid)) - before).sum()) / (load_ns[1] - load_ns[0])
    written_ns, due_ns, lost = board_pipe.recv()
    sleep_until(int(written_ns.max()) + 500_000_000)
    listener_pipe.send("stop")
    heard: Sequence[Heard] = listener_pipe.recv()
    board_pipe.send("stop")
    for process in (board, listener):
        process.join()
    return heard, Written(written_ns, due_ns, lost, load_ns), cpu


def of_daemon(load: Load, recorded: list[list[bytes]], seconds: float) -> tuple[Verdict, float]:
    process: subprocess.Popen[bytes] | None = None
    with tempfile.TemporaryDirectory(prefix="fmfts-overload-") as name:

        def start(ports: Sequence[str]) -> int:
            nonlocal process
            service = f"[service]\nrealtime_priority = {load.realtime}\n" if load.realtime else ""
            process = start_daemon(Path(name), list(ports), service)
            return process.pid

        try:
            heard, written, cpu = measured(load, recorded, seconds, Path(name), start)
        finally:
            assert process is not None
            process.send_signal(signal.SIGTERM)
            process.wait(20)
    return judge(heard, written), cpu


def of_echo(load: Load, recorded: list[list[bytes]], seconds: float) -> float:
    pipe: Any = None
    process: Any = None
    with tempfile.TemporaryDirectory(prefix="fmfts-overload-") as name:

        def start(ports: Sequence[str]) -> int:
            nonlocal pipe, process
            pipe, process = spawn(rig.echo, f"ipc://{name}/bus", list(ports), ECHO_BYTES)
            return int(process.pid)

        try:
            heard, written, _ = measured(load, recorded, seconds, Path(name), start)
        finally:
            pipe.send("stop")
            process.join()
    return judge_echo(heard, written)


def row(load: Load, verdict: Verdict, echo: float, cpu: float) -> str:
    ages = np.percentile(verdict.age_ns, [50, 99, 100]) / 1e6 if verdict.age_ns.size else [np.nan] * 3
    arrived = np.percentile(verdict.arrival_age_ns, 99) / 1e6 if verdict.arrival_age_ns.size else np.nan
    calm = "never" if verdict.calm_after_s is None else f"{verdict.calm_after_s:.2f}"
    cells = [str(load), f"{100 * verdict.share:.1f}", f"{100 * echo:.1f}", *(f"{age:.1f}" for age in ages)]
    cells += [f"{arrived:.1f}", f"{verdict.unevenness:.2f}", str(verdict.stale_ok), str(verdict.false_times), calm]
    healths = ", ".join(f"{word} {count}" for word, count in sorted(verdict.healths.items()))
    return table_line([*cells, f"{100 * cpu:.0f}", healths])


def run(options: argparse.Namespace) -> None:
    print(f"{table_line(COLUMNS)}\n{table_line(['---'] * len(COLUMNS))}", flush=True)
    for index in options.rows or range(len(LOADS)):
        load = LOADS[index]
        recorded = recordings(load, WARM_UP_S + options.seconds + AFTER_S)
        echo = of_echo(load, recorded, options.seconds) if options.echo else float("nan")
        verdict, cpu = of_daemon(load, recorded, options.seconds)
        print(row(load, verdict, echo, cpu), flush=True)
