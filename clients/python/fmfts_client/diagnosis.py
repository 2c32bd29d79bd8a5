"""Finds out why a client hears nothing of its pad: by listening to all pads of the same daemon for a moment."""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Optional

import zmq

from fmfts_client.contact import Contact
from fmfts_client.endpoints import Endpoints
from fmfts_client.fields import MessageError, SchemaError
from fmfts_client.keys import KEY_VARIABLE, key_in_use
from fmfts_client.silence import why_silent
from fmfts_client.subscription import Subscription

REFUSED = zmq.EVENT_HANDSHAKE_FAILED_AUTH
OTHER_PROTOCOL = zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL | zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL


@dataclass
class _Heard:
    """events: of the connection, as libzmq reports them. wrong: what is wrong with the pad's own messages."""

    events: int = 0
    pads: set[str] = field(default_factory=set)
    wrong: str = ""
    sound: bool = False


def why_nothing(pad: str, endpoints: Endpoints, timeout_s: float) -> str:
    """The reason, as a sentence with what to do, why no contact of `pad` is received; "" if its contacts do arrive."""
    heard = _listen(pad, endpoints, timeout_s)
    if heard.sound:
        return ""
    if heard.wrong:
        return heard.wrong
    if heard.pads:
        nearest = nearest_name(pad, heard.pads)
        names = ", ".join(f"'{name}'" for name in sorted(heard.pads))
        it_has = f"did you mean '{nearest}'? It has {names}" if nearest else f"it has {names}"
        return f"no pad '{pad}' at {endpoints.bus}; {it_has}"
    return why_not_connected(endpoints, heard.events)


def why_not_connected(endpoints: Endpoints, events: int) -> str:
    """The same of the connection alone. events: of libzmq's monitor, while the connection was tried."""
    bus, key = endpoints.bus, endpoints.key or key_in_use()
    if events & REFUSED:
        return f"the daemon at {bus} refuses the key in {key}: `fmfts-daemon keys list` there shows those it knows"
    if events & OTHER_PROTOCOL and key is None:
        return f"the daemon at {bus} accepts only clients with a key: set {KEY_VARIABLE} to the file of yours"
    if events & OTHER_PROTOCOL or (key is not None and events & zmq.EVENT_DISCONNECTED):
        return f"the daemon at {bus} has other keys than {key} says, or none: get a new key from its machine"
    if events & zmq.EVENT_HANDSHAKE_SUCCEEDED:
        return (
            f"a program serves {bus} and sends no contacts: a daemon that starts needs five seconds; "
            "is it fmfts-daemon, and does `fmfts-daemon status` answer?"
        )
    return f"no daemon at {bus}: {why_silent(bus, key=endpoints.key)}"


def _listen(pad: str, endpoints: Endpoints, timeout_s: float) -> _Heard:
    """Hear all pads. Ends early when the pad's own contact arrives, or when its message is wrong."""
    from zmq.utils.monitor import recv_monitor_message  # it imports asyncio, which nothing else here needs

    heard = _Heard()
    deadline = time.monotonic() + timeout_s
    with Subscription(("contact",), None, endpoints, watch=True) as subscription:
        monitor = subscription.monitor
        while time.monotonic() < deadline and not (heard.sound or heard.wrong):
            try:
                message = subscription.receive(min(0.05, max(0.0, deadline - time.monotonic())))
                if message is not None:
                    heard.pads.add(message.pad)
                    if message.pad == pad:
                        Contact.from_message(message.body)
                        heard.sound = True
            except SchemaError as error:
                heard.wrong = str(error)
            except MessageError as error:
                heard.wrong = f"a message of pad '{pad}' must not be used: {error}"
            while monitor is not None and monitor.poll(0):
                heard.events |= recv_monitor_message(monitor)["event"]
        if not heard.pads and subscription.refused:
            heard.wrong = subscription.refusal
    return heard


def nearest_name(wanted: str, names: Iterable[str]) -> Optional[str]:
    """The name that differs from `wanted` by the fewest letters; None where half or more of them differ."""
    distance, name = min(((_edits(wanted, name), name) for name in names), default=(len(wanted), ""))
    return name if 2 * distance < max(len(wanted), len(name)) else None


def _edits(one: str, other: str) -> int:
    """How many letters must be added, taken away or changed to make one word of the other."""
    row = list(range(len(other) + 1))
    for i, letter in enumerate(one, 1):
        before, row[0] = row[0], i
        for j, same in enumerate(other, 1):
            before, row[j] = row[j], min(row[j] + 1, row[j - 1] + 1, before + (letter != same))
    return row[-1]
