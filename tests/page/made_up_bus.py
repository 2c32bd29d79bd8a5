"""A bus with made-up messages, which stands for the daemon."""

from __future__ import annotations

from collections.abc import Callable
from itertools import count
from typing import Any

from fmfts.bus.control import ControlServer
from fmfts.bus.messages import ContactMessage, EventMessage
from fmfts.bus.publisher import Publisher
from fmfts.config import PadConfig, SimulatedSource
from fmfts.config.pad_facts import pad_facts
from fmfts_client import Endpoints


class Bus:
    """A daemon that publishes what `make` makes for each of its pads.

    pads: name → facts beyond those of the standard pad, as in `pads` of the control socket.
    """

    def __init__(self, base: str, pads: dict[str, dict[str, Any]], make: Callable[..., ContactMessage]) -> None:
        self.publisher, self._control = Publisher(Endpoints.from_base(base), "b00t"), ControlServer(f"{base}/control")
        self._pads = [
            {"pad": name} | pad_facts(PadConfig(name=name, source=SimulatedSource())) | facts
            for name, facts in pads.items()
        ]
        self._numbers = count()
        self._events: list[EventMessage] = []
        self.make = make

    def tell(self, event: EventMessage) -> None:
        """Publish an event with the next messages."""
        self._events.append(event)

    def turn(self) -> None:
        number = next(self._numbers)
        for facts in self._pads:
            self.publisher.send_contact(facts["pad"], self.make(seq=number, pad=facts["pad"]))
        while self._events:
            event = self._events.pop()
            self.publisher.send_event(event.pad, event)
        while self._control.serve_one(lambda request: request.reply(pads=self._pads)):
            pass

    def close(self) -> None:
        self.publisher.close()
        self._control.close()
