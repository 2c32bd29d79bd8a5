"""Shows a running daemon in Foxglove, live: `fmfts-daemon view --foxglove`, with Foxglove's SDK.

The SDK's server (0.30) knows neither a token nor allowed Origins, and a server of ours before it would leave its own
port open. So every user of this machine, and every page that a browser on it has open, can connect: it listens on the
loopback alone, offers no capability (parameters, services, publishing), and nothing but contacts can be read from it.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import foxglove
import msgspec

from fmfts_client import ControlError, Endpoints, Message, Subscription, request
from fmfts_recording.file import KINDS
from fmfts_recording.plain_schema import plain_schema, without_nulls
from fmfts_recording.scene import PadScene

LOOPBACK = "127.0.0.1"
SHOWN = ("contact", "event", "status")
TURN_S = 0.1
FACTS_S = 1.0  # wait between two requests to a daemon that does not answer


class Bridge:
    """Makes a channel of each topic, as in a recording, and one of each drawing."""

    def __init__(self, endpoints: Endpoints, context: foxglove.Context | None = None) -> None:
        self._endpoints, self._context = endpoints, context
        self._channels: dict[str, foxglove.Channel] = {}
        self._scenes: dict[str, PadScene] = {}
        self._boot = ""
        self._asked_s = -FACTS_S

    def take(self, message: Message) -> None:
        """Pass a message of the daemon on, and draw a contact."""
        body = message.body
        self._log(f"{message.kind}/{message.pad}", f"fmfts.{message.kind}", KINDS[message.kind], body, body["utc_ns"])
        if message.kind == "contact" and (scene := self._scene_of(message)) is not None:
            for drawn in scene.contact(body):
                kind = type(drawn.message)
                self._log(drawn.topic, drawn.schema, kind, msgspec.to_builtins(drawn.message), body["utc_ns"])

    def _log(self, topic: str, name: str, kind: type[msgspec.Struct], body: dict[str, Any], utc_ns: int) -> None:
        channel = self._channels.get(topic)
        if channel is None:
            schema = foxglove.Schema(name=name, encoding="jsonschema", data=msgspec.json.encode(plain_schema(kind)))
            channel = foxglove.Channel(topic, schema=schema, message_encoding="json", context=self._context)
            self._channels[topic] = channel
        if channel.has_sinks():
            channel.log(msgspec.json.encode(without_nulls(body, kind)), log_time=utc_ns)

    def _scene_of(self, message: Message) -> PadScene | None:
        """The pad's drawing; None until the daemon has told its shape. A daemon that is new is asked anew."""
        if message.body["boot"] != self._boot and time.monotonic() - self._asked_s >= FACTS_S:
            self._asked_s = time.monotonic()
            try:
                pads = request("pads", endpoint=self._endpoints, timeout_s=TURN_S)["pads"]
            except ControlError:
                return self._scenes.get(message.pad)
            self._scenes = {facts["pad"]: PadScene(facts["pad"], facts) for facts in pads}
            self._boot = message.body["boot"]
        return self._scenes.get(message.pad)


def serve(endpoints: Endpoints, port: int, told: Callable[[str], None]) -> None:
    """Serve until Ctrl-C. told: called with the address to open. Raises OSError where the port is taken."""
    server = foxglove.start_server(name="fmfts", host=LOOPBACK, port=port, capabilities=[], services=[])
    try:
        told(f"ws://{LOOPBACK}:{server.port}")
        bridge = Bridge(endpoints)
        with Subscription(SHOWN, None, endpoints) as messages:
            while True:
                if (message := messages.receive(TURN_S)) is not None:
                    bridge.take(message)
    finally:
        server.stop()
