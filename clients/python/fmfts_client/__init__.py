"""Clients of fmfts-daemon: `Client` for a controller, `Subscription` for all messages, `request` for commands."""

from fmfts_client.client import ALIVE_S, Client
from fmfts_client.contact import Contact, Event, Finger, Pose, Status
from fmfts_client.control import ControlError, RefusedError, UnreachableError, request
from fmfts_client.endpoints import EndpointError, Endpoints
from fmfts_client.fields import SCHEMA_VERSION, MessageError, SchemaError
from fmfts_client.joints import JointPublisher
from fmfts_client.keys import KEY_VARIABLE, BadKeyError
from fmfts_client.now import Now
from fmfts_client.slip import Slip
from fmfts_client.subscription import Message, Subscription

__all__ = [
    "ALIVE_S",
    "KEY_VARIABLE",
    "SCHEMA_VERSION",
    "BadKeyError",
    "Client",
    "Contact",
    "ControlError",
    "EndpointError",
    "Endpoints",
    "Event",
    "Finger",
    "JointPublisher",
    "Message",
    "MessageError",
    "Now",
    "Pose",
    "RefusedError",
    "SchemaError",
    "Slip",
    "Status",
    "Subscription",
    "UnreachableError",
    "request",
]
