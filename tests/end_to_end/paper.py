"""The paper's forty readings (Table 1) through the real chain: emulated chips → firmware → pty → daemon → ZeroMQ."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from end_to_end.processes import FirmwareHost, RunningDaemon
from fmfts_client import Contact

PAPER = Path(__file__).parents[1] / "data" / "paper"
POSE_COLUMNS = ("a_mm", "b_mm", "c_mm", "m", "n", "p")
TESLA_PER_GAUSS = 1e-4
SAMPLE_NS = 20_000_000  # more than chips need to convert, and than a gap that is interpolated
CONFIG = """
[[pad]]
name = "paper"
[pad.source]
type = "bridge"
port = "{port}"
"""


@dataclass(frozen=True)
class Reading:
    """One column of Table 1, and the pose that Table 2 has for it."""

    pose: str
    remanence_t: str
    field_t: np.ndarray
    position_m: np.ndarray
    axis: np.ndarray


def readings() -> list[Reading]:
    fields: dict[tuple[str, str], np.ndarray] = {}
    with (PAPER / "table1_field_gauss.csv").open() as lines:
        for row in csv.DictReader(lines):
            field = fields.setdefault((row["pose"], row["remanence_t"]), np.zeros((4, 3)))
            field[int(row["probe"]) - 1] = [float(row[f"b{axis}_g"]) * TESLA_PER_GAUSS for axis in "xyz"]
    with (PAPER / "table2_pose.csv").open() as lines:
        poses = {
            (row["pose"], row["remanence_t"]): np.array([float(row[name]) for name in POSE_COLUMNS])
            for row in csv.DictReader(lines)
        }
    return [
        Reading(*key, field, poses[key][:3] * 1e-3, poses[key][3:] / np.linalg.norm(poses[key][3:]))
        for key, field in fields.items()
    ]


@dataclass(frozen=True)
class Arrival:
    """What a subscriber received for a reading, and its distance from Table 2."""

    reading: Reading
    contact: Contact

    @property
    def distance_m(self) -> float:
        assert self.contact.pose is not None
        return float(np.linalg.norm(np.array(self.contact.pose.position_m) - self.reading.position_m))

    @property
    def angle_deg(self) -> float:
        assert self.contact.pose is not None
        return float(np.degrees(np.arccos(np.clip(np.dot(self.contact.pose.axis, self.reading.axis), -1.0, 1.0))))


def arrivals(host: FirmwareHost, daemon: RunningDaemon) -> Iterator[Arrival]:
    """Record an empty field as the baseline, then show the chips each reading until its pose has arrived."""
    host.tell("noise 0 0")
    host.field(np.zeros((4, 3)))
    daemon.wait_for(lambda contact: contact.health == "no_baseline" and contact.sensors_ok == 0b1111)
    recorded = daemon.command("baseline", "--bare", "--config", daemon.config)
    assert recorded.returncode == 0, recorded.stderr
    for reading in readings():
        host.field(reading.field_t)
        since_ns = daemon.now_ns() + SAMPLE_NS
        # On a busy computer frames of the previous reading may still be anywhere in the chain.
        before = daemon.wait_for(
            lambda contact, since_ns=since_ns: contact.pose is not None and contact.t_sample_ns > since_ns
        )
        # After a dozen frames the tracker of the pose has left the previous reading.
        contact = daemon.wait_for(
            lambda contact, first=before.seq: contact.pose is not None and contact.seq > first + 12
        )
        yield Arrival(reading, contact)
