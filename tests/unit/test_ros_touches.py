"""What the ROS 2 node tells in fmfts_msgs and tactile_msgs, with stand-ins for their types."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from bus_messages import contact_message

import unit.test_ros_fingers as stand_ins
from fmfts.bus.messages import SlipMessage
from unit.test_ros_fingers import FakeNode, Header, Vector3, Wrench, message, received

HEIGHT_M = 0.012
MESSAGES = Path(__file__).parents[2] / "clients/ros2/fmfts_msgs/msg"
DEFAULTS: dict[str, Any] = {
    "std_msgs/Header": Header, "geometry_msgs/Wrench": Wrench, "string": "", "int8": 0, "bool": False, "float64": 0.0,
    "float64[36]": list,
}  # fmt: skip
# Fields as in tactile_toolbox.
TactileContact = message(
    "TactileContact", header=Header, name="", position=Vector3, normal=Vector3, wrench=Wrench
)  # fmt: skip
TactileContacts = message("TactileContacts", contacts=list)


def of_definition(name: str) -> type:
    """A type with the fields of its definition. Like rosidl's types of Humble, it asserts that an int8 gets an
    integer.
    """
    lines = (MESSAGES / f"{name}.msg").read_text().splitlines()
    fields = [line.split() for line in lines if not line.startswith("#") and "=" not in line]
    integers = {field for kind, field in fields if kind == "int8"}
    plain = message(name, **{field: DEFAULTS[kind] for kind, field in fields})

    class Checked(plain):  # type: ignore[misc, valid-type]
        def __setattr__(self, field: str, value: Any) -> None:
            assert field not in integers or isinstance(value, int), f"the '{field}' field must be of type 'int'"
            super().__setattr__(field, value)

    return Checked


@pytest.fixture
def touches(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    types = {
        "fmfts_msgs.msg": {name: of_definition(name) for name in ("Contact", "Slip")},
        "tactile_msgs.msg": {"TactileContact": TactileContact, "TactileContacts": TactileContacts},
    }
    monkeypatch.setattr(stand_ins, "TYPES", stand_ins.TYPES | types)
    yield from stand_ins.ros.__wrapped__(monkeypatch)


def test_contact_has_all_numbers_and_covariance_of_its_wrench(touches: Any) -> None:
    contact = received(contact_message())
    told = touches("touches").contact_message(contact, "left", HEIGHT_M)
    assert (told.health, told.contact, told.over_range) == ("ok", 1, False)
    assert (told.force_n, told.x_sd_m) == (contact.force_n, contact.x_sd_m)
    assert math.isnan(told.shear_x_n)
    covariance = np.array(told.wrench_covariance).reshape(6, 6)
    assert covariance[2, 2] == pytest.approx((contact.force_sd_n or 0.0) ** 2)
    assert told.wrench.force.z == -(contact.force_n or 0.0)


def test_touches_become_tactile_contacts(touches: Any) -> None:
    contact = received(contact_message())
    (touch,) = touches("touches").tactile_contacts(contact, "left", HEIGHT_M).contacts
    assert (touch.name, touch.header.frame_id) == ("left", "left")
    assert (touch.position.x, touch.position.y, touch.position.z) == (contact.x_m, contact.y_m, HEIGHT_M)
    assert (touch.normal.x, touch.normal.y, touch.normal.z) == (0.0, 0.0, 1.0)
    untouched = received(contact_message(contact=False, x_m=None, y_m=None))
    assert touches("touches").tactile_contacts(untouched, "left", HEIGHT_M).contacts == []


def test_pad_publishes_touches_beside_its_wrench(touches: Any) -> None:
    node = FakeNode()
    pad = touches("pads").RosPad(node, "left", "left", "left", math.nan)
    pad.height_m = HEIGHT_M
    pad.take(received(contact_message()))
    for topic in ("wrench", "contact", "tactile_contacts"):
        assert len(node.published[f"~/left/{topic}"]) == 1, topic


SLIPPING = SlipMessage(
    slipping=True, sticking_probability=0.02, speed_m_per_s=0.05, speed_sd_m_per_s=0.004, direction_rad=1.2,
    direction_sd_rad=0.1, friction=0.6, friction_sd=0.1, margin_n=0.0, margin_sd_n=0.1,
)  # fmt: skip


@pytest.mark.parametrize(
    ("slip", "state"), [(SLIPPING, 1), (msgspec.structs.replace(SLIPPING, slipping=False), 0), (SlipMessage(), -1)]
)
def test_slip_has_its_state_and_all_numbers(touches: Any, slip: SlipMessage, state: int) -> None:
    told = touches("touches").slip_message(received(contact_message(slip=slip)), "left")
    assert (told.slipping, told.header.frame_id) == (state, "left")
    for name in set(SlipMessage.__struct_fields__) - {"slipping"}:
        value = getattr(slip, name)
        assert getattr(told, name) == value if value is not None else math.isnan(getattr(told, name)), name


def test_pad_without_slip_setting_publishes_no_slip(touches: Any) -> None:
    assert touches("touches").slip_message(received(contact_message()), "left") is None


def test_node_without_tactile_packages_publishes_only_its_own_topics(monkeypatch: pytest.MonkeyPatch) -> None:
    ros = stand_ins.ros.__wrapped__(monkeypatch)
    assert next(ros)("touches").kinds() == {}
    for _ in ros:
        pass
