"""Contacts as messages of two optional packages: fmfts_msgs (beside this one) and tactile_msgs."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import fields
from typing import Any

from fmfts_client import Contact
from fmfts_client.wrench import Wrench, wrench_of

from fmfts_ros.messages import sample_time

try:
    from fmfts_msgs.msg import Contact as FmftsContact
except ImportError:
    FmftsContact = None
try:
    from fmfts_msgs.msg import Slip as FmftsSlip
except ImportError:
    FmftsSlip = None
try:
    from tactile_msgs.msg import TactileContact, TactileContacts
except ImportError:
    TactileContact = TactileContacts = None

NAN = math.nan
NUMBERS = ("x_m", "x_sd_m", "y_m", "y_sd_m", "force_n", "force_sd_n", "force_min_n")
NUMBERS += ("shear_x_n", "shear_x_sd_n", "shear_y_n", "shear_y_sd_n")


def kinds() -> dict[str, tuple[type, Callable[[Contact, str, float], Any]]]:
    """Type and maker of messages whose package is installed, by the end of the topic."""
    made: dict[str, tuple[Any, Callable[[Contact, str, float], Any]]] = {
        "contact": (FmftsContact, contact_message),
        "tactile_contacts": (TactileContacts, tactile_contacts),
    }
    return {end: (kind, maker) for end, (kind, maker) in made.items() if kind is not None}


def contact_message(contact: Contact, frame: str, height_m: float) -> Any:
    """All numbers of a contact with their deviations, and the wrench with its covariance; NaN: not known."""
    told = wrench_of(contact, height_m)
    message = FmftsContact()
    message.header.stamp, message.header.frame_id = sample_time(contact), frame
    message.health, message.reason = contact.health, contact.reason
    message.contact = -1 if contact.contact is None else int(contact.contact)
    message.over_range = contact.over_range
    for name in NUMBERS:
        value = getattr(contact, name)
        setattr(message, name, NAN if value is None else value)
    _put(told, message.wrench)
    message.wrench_covariance = [part for row in told.covariance for part in row]
    return message


def slip_message(contact: Contact, frame: str) -> Any:
    """The daemon's message about a finger that may slip; None if it sends none, or the type is missing."""
    slip = contact.slip
    if slip is None or FmftsSlip is None:
        return None
    message = FmftsSlip()
    message.header.stamp, message.header.frame_id = sample_time(contact), frame
    message.slipping = -1 if slip.slipping is None else int(slip.slipping)
    for name in (part.name for part in fields(slip) if part.name != "slipping"):
        value = getattr(slip, name)
        setattr(message, name, NAN if value is None else value)
    return message


def tactile_contacts(contact: Contact, frame: str, height_m: float) -> Any:
    """The contacts; none if nothing touches. The name is that of the pad's sensor in the URDF: its frame's."""
    message = TactileContacts()
    if not contact.contact or contact.x_m is None or contact.y_m is None:
        return message
    touch = TactileContact()
    touch.header.stamp, touch.header.frame_id = sample_time(contact), frame
    touch.name = frame
    touch.position.x, touch.position.y, touch.position.z = contact.x_m, contact.y_m, height_m
    touch.normal.z = 1.0  # outwards from the pad
    _put(wrench_of(contact, height_m), touch.wrench)
    message.contacts = [touch]
    return message


def _put(told: Wrench, wrench: Any) -> None:
    wrench.force.x, wrench.force.y, wrench.force.z = told.force_n
    wrench.torque.x, wrench.torque.y, wrench.torque.z = told.torque_nm
