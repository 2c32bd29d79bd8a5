"""ROS 2 messages of a recording: their bytes in CDR, and the definition that ROS has. `make viewers` has them read."""

from __future__ import annotations

import math
import struct
from contextlib import closing
from pathlib import Path
from typing import Any

import msgspec
from mcap.reader import make_reader

from fmfts.config.pad_facts import pad_facts
from fmfts_client import Message
from fmfts_recording.file import RecordingWriter, read
from fmfts_recording.recorder import Recorder
from fmfts_recording.ros2 import CONTACT, RosMessage, RosPad
from unit.test_foxglove import CONFIG, contact

ROS = Path(__file__).parents[2] / "clients" / "ros2"


def told(**changed: Any) -> dict[str, RosMessage]:
    return {each.topic: each for each in RosPad("left", pad_facts(CONFIG)).contact(contact(0, **changed))}


def test_wrench_has_the_bytes_that_ros_writes() -> None:
    """Header: two numbers of 4 bytes, a length, four letters and a zero; the doubles begin at a multiple of 8."""
    data = told(shear_x_n=0.5, shear_x_sd_n=0.1, shear_y_n=-0.25, shear_y_sd_n=0.1)["ros/left/wrench"].data
    assert data[:4] == b"\x00\x01\x00\x00"
    assert data[4:28] == struct.pack("<iII", 1_800_000_000, 0, 5) + b"left\x00" + bytes(7)
    force, place = (0.5, -0.25, -1.5), (2e-3, -1e-3, 12e-3)
    torque = (
        place[1] * force[2] - place[2] * force[1],
        place[2] * force[0] - place[0] * force[2],
        place[0] * force[1] - place[1] * force[0],
    )
    assert struct.unpack("<6d", data[28:]) == (*force, *torque)


def test_unknown_is_nan_and_over_range_has_no_wrench() -> None:
    messages = told(over_range=True, force_min_n=3.0, contact=None)
    assert messages.keys() == {"tf", "ros/left/contact"}
    data = messages["ros/left/contact"].data
    begins = 4 + 24 + 8  # header; "ok" and its length, and the length of ""
    assert struct.unpack_from("<I3s", data, 4 + 20) == (3, b"ok\x00")
    touched, over_range = struct.unpack_from("<b?", data, begins + 1)
    assert (touched, over_range) == (-1, True)
    numbers = struct.unpack(f"<{(len(data) - 4 - 40) // 8}d", data[44:])
    assert len(numbers) == 11 + 6 + 36
    assert (numbers[0], numbers[6]) == (2e-3, 3.0)
    assert all(map(math.isnan, numbers[7:]))


def test_ros_has_the_same_definition() -> None:
    assert (ROS / "fmfts_msgs/msg/Contact.msg").read_text() == CONTACT + "\n"


def test_replay_ignores_drawings(tmp_path: Path) -> None:
    writer = RecordingWriter(tmp_path / "touch.mcap")
    writer.add("contact", "left", contact(0))
    for message in told().values():
        writer.tell_ros(message, contact(0)["utc_ns"])
    writer.finish()
    writer.close()
    assert [each.kind for each in read(tmp_path / "touch.mcap")] == ["contact"]
    with (tmp_path / "touch.mcap").open("rb") as file:
        found = {channel.topic: (schema, channel) for schema, channel, _ in make_reader(file).iter_messages()}
    for topic in ("tf", "ros/left/contact", "ros/left/wrench"):
        schema, channel = found[topic]
        assert schema is not None
        assert (schema.encoding, channel.message_encoding) == ("ros2msg", "cdr")


def test_contacts_before_the_state_are_recorded_later(tmp_path: Path) -> None:
    """A busy computer hears contacts before the state that says where the pad is: each has its ROS 2 message."""
    path = tmp_path / "touch.mcap"
    with closing(Recorder(path, None, f"ipc://{tmp_path}/bus", for_ros=True)) as recorder:
        for number in (0, 1):
            recorder._take(Message("contact", "left", contact(number)))
        recorder._draw_from_now_on(Message("state", "left", {"config": msgspec.to_builtins(CONFIG)}))
        recorder._take(Message("contact", "left", contact(2)))
        recorder._writer.finish()
    with path.open("rb") as file:
        topics = [channel.topic for _, channel, _ in make_reader(file).iter_messages()]
    assert topics.count("contact/left") == topics.count("ros/left/contact") == topics.count("ros/left/wrench") == 3
