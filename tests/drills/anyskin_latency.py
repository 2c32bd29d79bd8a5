"""Measures how soon a packet of an AnySkin board is read, and the processor time: this daemon beside their own reader.

    pip install --no-deps --target DIR anyskin
    .venv/bin/python tests/drills/anyskin_latency.py --anyskin DIR

Both read the same emulated board on a pty, one after the other. Each packet carries its number in a field. The daemon's
time lasts until a subscriber has its frame, after pose and contact; theirs lasts until `get_sample` returns.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from emulator.anyskin_board import binary, steps_ut
from emulator.pty_port import PtyPort
from end_to_end.processes import RunningDaemon
from end_to_end.test_anyskin import CONFIG, mounted_of, pressed_field
from fmfts_client import Subscription

NUMBERS = 1000
THEIRS = """
import json, sys, time
sys.path.insert(0, sys.argv[1])
from anyskin.sensor import AnySkinBase
sensor, end_s, found = AnySkinBase(num_mags=5, port=sys.argv[2], temp_filtered=False), float(sys.argv[3]), []
begun_s, begun_cpu_s = time.monotonic(), time.process_time()
while time.monotonic() - begun_s < end_s:
    _, sample = sensor.get_sample()
    found.append((round(float(sample[1]) / 0.2), time.monotonic_ns()))
wall_s, cpu_s = time.monotonic() - begun_s, time.process_time() - begun_cpu_s
print(json.dumps({"found": found, "cores": cpu_s / wall_s}))
"""


class NumberedBoard:
    def __init__(self, folder: Path, rate_hz: float) -> None:
        self.link = folder / "skin"
        self.field_t = np.zeros((5, 3))
        self.written_ns = [0] * NUMBERS
        self._port, self._rate_hz, self._ended = PtyPort(self.link), rate_hz, threading.Event()
        self._thread = threading.Thread(target=self._run)

    def _run(self) -> None:
        start_s, sent = time.monotonic(), 0
        while not self._ended.is_set():
            fields_ut = (self.field_t * 1e6).tolist()
            fields_ut[0][0] = (sent % NUMBERS) * steps_ut()[0]
            packet = binary(fields_ut)
            self.written_ns[sent % NUMBERS] = time.monotonic_ns()
            self._port.write(packet)
            sent += 1
            time.sleep(max(0.0, start_s + sent / self._rate_hz - time.monotonic()))

    def __enter__(self) -> NumberedBoard:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()
        self._port.unplug()


def figures(latencies_ns: list[int], cores: float) -> dict[str, float]:
    p50, p99 = np.percentile(latencies_ns, [50, 99]) / 1e6
    return {
        "p50_ms": round(float(p50), 3),
        "p99_ms": round(float(p99), 3),
        "cores": round(cores, 3),
        "n": len(latencies_ns),
    }


def cpu_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def ours(rate_hz: int, seconds: float) -> dict[str, float]:
    with tempfile.TemporaryDirectory() as name, NumberedBoard(Path(name), rate_hz) as board:
        config = CONFIG.format(port=board.link, form="binary", rate_hz=rate_hz, model="none")
        with RunningDaemon(Path(name), config) as daemon, Subscription(("frame",), "skin", daemon.base) as frames:
            board.field_t = pressed_field(mounted_of(daemon), 0.0)
            daemon.wait_for(lambda contact: contact.sensors_ok == 0b11111)
            end_s, begun_s, begun_cpu_s, found = (
                time.monotonic() + seconds,
                time.monotonic(),
                cpu_s(daemon.process.pid),
                [],
            )
            while time.monotonic() < end_s:
                message = frames.receive(0.5)
                if message is not None:
                    number = message.body["counts"][0][0]
                    found.append(time.monotonic_ns() - board.written_ns[number])
            cores = (cpu_s(daemon.process.pid) - begun_cpu_s) / (time.monotonic() - begun_s)
            return figures(found[5:], cores)


def theirs(package: Path, rate_hz: int, seconds: float) -> dict[str, float]:
    with tempfile.TemporaryDirectory() as name, NumberedBoard(Path(name), rate_hz) as board:
        command = [sys.executable, "-c", THEIRS, str(package), str(board.link), str(seconds)]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
            # Packets' times are overwritten after NUMBERS of them: keep a copy of each when it is made.
            assert process.stdout is not None
            text = process.stdout.read()
        said = json.loads(text.splitlines()[-1])
        newest = [(number, at_ns) for number, at_ns in said["found"] if 0 <= number < NUMBERS]
        last = newest[-round(NUMBERS * 0.8) :]
        return figures(
            [at_ns - board.written_ns[number] for number, at_ns in last if at_ns > board.written_ns[number]],
            said["cores"],
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--anyskin", type=Path, required=True, metavar="DIR", help="where their package is")
    parser.add_argument("--seconds", type=float, default=8.0)
    parser.add_argument("--rates", type=int, nargs="+", default=[50, 200, 400])
    options = parser.parse_args()
    for rate_hz in options.rates:
        print(rate_hz, "Hz, ours:  ", ours(rate_hz, options.seconds), flush=True)
        print(rate_hz, "Hz, theirs:", theirs(options.anyskin, rate_hz, options.seconds), flush=True)


if __name__ == "__main__":
    main()
