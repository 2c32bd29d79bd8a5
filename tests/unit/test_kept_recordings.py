"""The recordings of tests/data/recordings, replayed: what each must say, and how equal to what was said once."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from end_to_end.paper import readings
from fmfts.bus.messages import ContactMessage
from fmfts_recording.file import read
from fmfts_recording.replay import Replay, essence

FOLDER = Path(__file__).parents[1] / "data" / "recordings"
RECORDINGS = sorted(FOLDER.glob("*.mcap"))
# docs: recordings/README.md. The model computes in single precision, everything else in double.
OF_THE_MODEL = re.compile(r"^(x|y|force|shear)_.*")
SINGLE, DOUBLE, NEAR_ZERO = 1e-5, 1e-9, 1e-8
# Each message gives the contact at publishing, too; those of several magnets give the poses of four.
LARGEST_BYTES = {"fingers": 510_000}
LARGEST_OF_OTHERS_BYTES = 320_000
FILTERS_LEARN_S = 0.2


def expected(path: Path) -> list[ContactMessage]:
    return [one.message for one in read(path) if isinstance(one.message, ContactMessage)]


def replayed(path: Path) -> list[ContactMessage]:
    return list(Replay(path).contacts())


def differences(said: Any, wanted: Any, name: str = "") -> list[str]:
    """The fields that differ by more than another machine's arithmetic does."""
    if said is None or wanted is None:
        return [] if said is wanted else [name]
    if isinstance(wanted, dict):
        return [each for key in wanted for each in differences(said.get(key), wanted[key], key)]
    if isinstance(wanted, list) and (not wanted or isinstance(wanted[0], dict)):  # fingers or poses
        if len(said) != len(wanted):
            return [name]
        return [each for own, other in zip(said, wanted, strict=True) for each in differences(own, other, name)]
    if isinstance(wanted, Sequence) and not isinstance(wanted, str):
        size = max(map(abs, wanted))
        close = len(said) == len(wanted) and all(
            math.isclose(a, b, rel_tol=0.0, abs_tol=DOUBLE * size) for a, b in zip(said, wanted, strict=True)
        )
        return [] if close else [name]
    if isinstance(wanted, float) and isinstance(said, float):
        of_the_model = OF_THE_MODEL.match(name) is not None
        tolerance = {"rel_tol": SINGLE, "abs_tol": NEAR_ZERO} if of_the_model else {"rel_tol": DOUBLE}
        return [] if math.isclose(said, wanted, **tolerance) else [name]
    if name == "reason":  # holds rounded numbers
        said, wanted = (re.sub(r"\d{2,}", "…", each) for each in (said, wanted))
    return [] if said == wanted else [name]


def seconds(contact: ContactMessage) -> float:
    return contact.t_sample_ns * 1e-9


def test_there_are_recordings_small_and_each_explained() -> None:
    text = (FOLDER / "README.md").read_text()
    assert len(RECORDINGS) >= 3
    for path in RECORDINGS:
        assert f"`{path.name}`" in text
        assert path.stat().st_size < LARGEST_BYTES.get(path.stem, LARGEST_OF_OTHERS_BYTES)


@pytest.mark.parametrize("path", RECORDINGS, ids=lambda path: path.stem)
def test_replay_is_bit_identical_and_gives_the_recorded_contacts(path: Path) -> None:
    once, again, wanted = replayed(path), replayed(path), expected(path)
    assert [essence(each) for each in once] == [essence(each) for each in again]
    assert len(once) == len(wanted) > 600
    differing = {
        (contact.seq, name)
        for contact, other in zip(once, wanted, strict=True)
        for name in differences(essence(contact), essence(other))
    }
    assert not differing


@pytest.mark.parametrize("name", ["taps", "turning"])
def test_three_taps_are_three_touches(name: str) -> None:
    contacts = expected(FOLDER / f"{name}.mcap")
    assert {contact.health for contact in contacts} == {"ok"}
    onsets = [seconds(after) for before, after in pairwise(contacts) if after.contact and not before.contact]
    assert onsets == pytest.approx([0.3, 1.2, 2.1], abs=0.1)  # a tap begins as sin²: 50 mN after 30 ms
    hardest = [max(each.force_n or 0.0 for each in contacts if t < seconds(each) < t + 0.5) for t in (0.25, 1.15, 2.05)]
    assert hardest == pytest.approx([1.2, 1.2, 1.2], rel=0.15)


def test_passing_fault_is_named_and_then_cleared() -> None:
    contacts = expected(FOLDER / "fault.mcap")
    assert not any(contact.contact for contact in contacts)
    for contact in contacts:
        at_s = seconds(contact)
        if 0.72 < at_s < 1.19:
            assert contact.health == "degraded"
            assert "sensor 3" in contact.reason
        if 1.82 < at_s < 2.29:
            assert not contact.sensors_ok & 1
        if FILTERS_LEARN_S < at_s < 0.69:
            assert contact.health == "ok"
    assert contacts[-1].health == "ok"


def test_two_fingers_come_and_go_and_a_sensor_fails_under_one() -> None:
    """The fingers are told within five of their deviations; a frame at a change of them may be `degraded`."""
    contacts = expected(FOLDER / "fingers.mcap")
    said = {"none": (0.0, 0.39), "one": (0.5, 0.99), "two": (1.11, 1.69), "again": (1.81, 2.09), "end": (2.71, 2.99)}
    for name, (begin_s, end_s) in said.items():
        own = [contact for contact in contacts if begin_s < seconds(contact) < end_s]
        assert {contact.health for contact in own} == {"ok"}
        ids = {tuple(finger.id for finger in contact.contacts or ()) for contact in own}
        assert ids == {"none": {()}, "two": {(1, 2)}, "end": {()}}.get(name, {(1,)})
    for contact in contacts:
        if 1.11 < seconds(contact) < 1.69:
            assert contact.contacts
            left, right = contact.contacts
            true_m = -7e-3 + 1e-3 * seconds(contact)
            assert abs(left.x_m - true_m) < 5.0 * left.x_sd_m
            assert abs(right.x_m - 8e-3) < 5.0 * right.x_sd_m
            assert abs(left.force_n - 0.9) < 5.0 * left.force_sd_n
            assert abs(right.force_n - 0.7) < 5.0 * right.force_sd_n
        if 2.12 < seconds(contact) < 2.29:
            assert (contact.health, contact.contacts is not None) == ("degraded", True)
            assert "sensor 6 contradicts all others" in contact.reason


def test_papers_readings_through_firmware_are_papers_poses() -> None:
    """As in test_paper_through_the_firmware.py, where the limits are explained; the rest pose was not recorded."""
    contacts = expected(FOLDER / "paper.mcap")
    assert all(contact.force_n is None for contact in contacts)
    arrived = [(each.pose.position_m, each.pose.axis, each.pose.remanence_t) for each in contacts if each.pose]
    for reading in readings():
        near = [
            position_m
            for position_m, axis, remanence_t in arrived
            if math.dist(position_m, reading.position_m) < 0.02e-3
            and math.degrees(math.acos(min(1.0, float(np.dot(axis, reading.axis))))) < 0.15
            and remanence_t == pytest.approx(float(reading.remanence_t), rel=0.03)
        ]
        assert len(near) > 40, reading


def test_relevant_change_is_a_difference() -> None:
    contact = essence(expected(FOLDER / "taps.mcap")[100])
    pose = contact["pose"]
    shifted = [pose["position_m"][0] + 1e-10, *pose["position_m"][1:]]
    assert differences(contact | {"pose": pose | {"position_m": shifted}}, contact) == ["position_m"]
    assert differences(contact | {"force_n": contact["force_n"] + 1e-4}, contact) == ["force_n"]
    assert differences(contact | {"health": "lost", "pose": None}, contact) == ["health", "pose"]
    two = next(essence(each) for each in expected(FOLDER / "fingers.mcap") if each.contacts and len(each.contacts) == 2)
    left, right = two["contacts"]
    assert differences(two | {"contacts": [left, right | {"id": 9}]}, two) == ["id"]
    assert differences(two | {"contacts": [left, right | {"force_n": right["force_n"] + 1e-4}]}, two) == ["force_n"]
    assert differences(two | {"contacts": [left], "poses": []}, two) == ["contacts", "poses"]
    assert not differences(two, two)
