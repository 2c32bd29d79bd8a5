"""A bus on which a finger taps one pad again and again; it keeps the sent messages, to compare them with the page's
drawing."""

from __future__ import annotations

import random
from pathlib import Path

import msgpack
import zmq

from fmfts.bus.control import ControlServer
from fmfts.bus.messages import ContactMessage
from fmfts.bus.publisher import Publisher
from fmfts.config import PadConfig, SimulatedSource
from fmfts.config.pad_facts import pad_facts
from fmfts_client import Endpoints
from unit.bus_messages import contact_message, pose_message

PAD = "demo"
PERIOD_S = 0.005
TOUCHED, FREE = 10, 10  # messages
NOWHERE = dict.fromkeys(("x_m", "x_sd_m", "y_m", "y_sd_m", "force_n"))


class KnownTouches:
    """A daemon with one pad, and a fixed baseline beside it. Every message has a force of its own.

    sent: the contacts by their time of publishing in s. ghosts: the forces (N) of the fixed baseline by time of sample.
    """

    def __init__(self, folder: Path) -> None:
        base = f"ipc://{folder}"
        self.environment, self.beside = {"FMFTS_BUS": base}, f"ipc://{folder}/beside"
        self.sent: dict[float, ContactMessage] = {}
        self.ghosts: dict[float, float] = {}
        self._publisher, self._control = Publisher(Endpoints.from_base(base), "b00t"), ControlServer(f"{base}/control")
        self._beside: zmq.Socket[bytes] = zmq.Context.instance().socket(zmq.PUB)
        self._beside.bind(self.beside)
        self._facts = {"pad": PAD} | pad_facts(PadConfig(name=PAD, source=SimulatedSource()))
        self._chance = random.Random(41)
        self._seq = 0

    @property
    def touches(self) -> int:
        """How many have begun."""
        return (self._seq + TOUCHED) // (TOUCHED + FREE)

    def turn(self) -> None:
        message = self._message()
        self.sent[message.t_publish_ns / 1e9] = message
        self._publisher.send_contact(PAD, message)
        if self._seq % 6 == 0:
            self._send_ghost(message.t_sample_ns)
        while self._control.serve_one(lambda request: request.reply(pads=[self._facts])):
            pass
        self._seq += 1

    def _message(self) -> ContactMessage:
        pose = pose_message(chi2=self._chance.uniform(1.0, 9.0))
        number, within = divmod(self._seq, TOUCHED + FREE)
        if within < FREE:
            return contact_message(seq=self._seq, contact=False, pose=pose, **NOWHERE)
        x_m, y_m = self._chance.uniform(-8e-3, 8e-3), self._chance.uniform(-8e-3, 8e-3)
        force_n = self._chance.uniform(0.3, 2.0)
        if number % 10 == 9:
            beyond = NOWHERE | {"over_range": True, "force_min_n": 2.0 + force_n, "force_sd_n": None}
            return contact_message(seq=self._seq, pose=pose, **beyond)
        return contact_message(seq=self._seq, pose=pose, x_m=x_m, y_m=y_m, force_n=force_n)

    def _send_ghost(self, t_sample_ns: int) -> None:
        force_n = self.ghosts[t_sample_ns / 1e9] = self._chance.uniform(0.0, 1.0)
        ghost = {"pad": PAD, "t_sample_ns": t_sample_ns, "magnet_m": None, "x_m": 0.0, "y_m": 0.0, "force_n": force_n}
        self._beside.send_multipart((f"ghost/{PAD}".encode(), msgpack.packb(ghost)))

    def close(self) -> None:
        self._publisher.close()
        self._control.close()
        self._beside.close(linger=0)
