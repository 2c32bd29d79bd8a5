from __future__ import annotations

import os
import time
from pathlib import Path

import pytest

from end_to_end.processes import BRIDGE_CONFIG, FirmwareHost, RunningDaemon, resting_field
from fmfts.pad import Pad
from fmfts.runtime.channel import SHORTEST_SILENCE_NS
from fmfts_client import Contact, Status
from standing_still import StandingStill

SECONDS, RATE_HZ = 60.0, 220.0
SILENT_S = SHORTEST_SILENCE_NS * 1e-9 + 0.05  # the daemon checks twenty times a second


def _cpu_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _resident_kb(pid: int) -> int:
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmRSS:"))


@pytest.mark.slow
@pytest.mark.real_time
def test_minute_at_220_hz_loses_no_frame_and_leaks_no_memory(tmp_path: Path, pad: Pad) -> None:
    """Solving and publishing every frame of one pad from the firmware's own bytes, on a pty."""
    with FirmwareHost(tmp_path) as host, RunningDaemon(tmp_path, BRIDGE_CONFIG.format(port=host.port)) as daemon:
        host.field(resting_field(pad))
        daemon.wait_for(lambda contact: contact.health == "no_baseline" and contact.sensors_ok == 0b1111)
        recorded = daemon.command("baseline", "--rest", "--config", daemon.config)
        assert recorded.returncode == 0, recorded.stderr
        daemon.wait_for(lambda contact: contact.health == "ok")
        pid = daemon.process.pid
        sequence: list[int] = []
        healths: dict[str, int] = {}
        silences_s: list[float] = []  # when they were reported
        statuses: list[Status] = []
        counted: list[tuple[int, int]] = []  # number of contacts, and the time, at each status
        with StandingStill(pty=True) as computer, daemon.subscribe("contact", "status") as messages:
            messages.receive(5.0)
            cpu_before, resident_before, start = _cpu_s(pid), _resident_kb(pid), time.monotonic()
            while time.monotonic() - start < SECONDS:
                message = messages.receive(1.0)
                assert message is not None
                if message.kind == "status":
                    statuses.append(Status.from_message(message.body))
                    counted.append((len(sequence), message.body["t_publish_ns"]))
                else:
                    contact = Contact.from_message(message.body)
                    sequence.append(contact.seq)
                    health = f"{contact.health}: {contact.reason}" if contact.health == "degraded" else contact.health
                    healths[health] = healths.get(health, 0) + 1
                    if contact.health == "stale":
                        silences_s.append(message.body["t_publish_ns"] * 1e-9)
            elapsed = time.monotonic() - start
            share = (_cpu_s(pid) - cpu_before) / elapsed
            grown_kb = _resident_kb(pid) - resident_before
    print(f"{len(sequence) / elapsed:.2f} Hz, {share:.1%} of a core, {grown_kb} kB more than {resident_before}")
    assert sequence == list(range(sequence[0], sequence[0] + len(sequence)))
    # While a processor stood still, so did the board's process or the daemon's: there was silence, and frames that came
    # too late were dropped. Otherwise there was neither silence nor a dropped frame.
    said = f"processors stood still at {computer.times}"
    unfounded = [told_s for told_s in silences_s if not computer.within(told_s - SILENT_S, told_s)]
    assert not unfounded, f"silent at {unfounded}; {said}"
    assert healths == {"ok": len(sequence) - len(silences_s)} | ({"stale": len(silences_s)} if silences_s else {})
    excused = 2.0 * RATE_HZ * computer.total_s
    # Frames that waited on the line when the port was opened were dropped, before this minute.
    lost = sum(status.gaps + status.dropped for status in statuses[-1:]) - statuses[0].gaps - statuses[0].dropped
    assert lost <= excused, f"{lost} frames; {said}"
    assert statuses[-1].crc_errors == statuses[-1].reconnects == 0
    # Each status reports the frames of its second, to two frames at its ends, however the second went.
    for status, (before, since_ns), (count, now_ns) in zip(statuses[1:], counted, counted[1:], strict=False):
        came_hz = (count - before) / ((now_ns - since_ns) * 1e-9)
        if not computer.within(since_ns * 1e-9 - SILENT_S, now_ns * 1e-9):
            assert abs(status.rate_hz - came_hz) < 0.01 * RATE_HZ, said
    assert abs(len(sequence) - RATE_HZ * elapsed) < 0.01 * RATE_HZ * elapsed + excused, said
    # 13,200 messages: 1 MB would be 80 bytes that each one leaves behind.
    assert grown_kb < 1024
    assert share < 0.25
