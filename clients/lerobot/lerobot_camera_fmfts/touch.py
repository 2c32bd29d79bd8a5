"""Reads pads as floats with stable names, for data sets that hold no gaps and no NaN."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import replace

from fmfts_client import Client, Contact

USABLE = {"ok": 0.0, "degraded": 1.0}  # health as a feature; any health that is not listed raises
WAIT_S = 0.3  # three messages of a daemon whose pad is silent

# Suffix after the pad's name: where the contact has the value. "health", "contact" and "over_range" are 0 or 1.
FEATURES = ("health", "contact", "over_range", "force_n", "force_sd_n", "x_m", "x_sd_m", "y_m", "y_sd_m")


def anywhere_sd_m(pad_size_m: float) -> float:
    return pad_size_m / math.sqrt(12.0)  # of a uniform distribution


class TouchLostError(RuntimeError):
    """A pad gives nothing that may be recorded; the text names the pad and says why."""


class Pads:
    """Several pads of one daemon. pad_size_m: edge of the square pads, for the deviation of an unknown place.
    patience_s: how long a step may wait for a new value, which is never an old one.

    A data set has a number everywhere, so another feature marks what is not known: where `contact` is 0, the place is 0
    with the deviation of anywhere on the pad; where `over_range` is 1, `force_n` is the lower bound.
    """

    def __init__(
        self,
        names: Sequence[str],
        endpoint: str | None = None,
        pad_size_m: float = 0.04,
        patience_s: float = WAIT_S,
    ) -> None:
        self.names = tuple(names)
        self.patience_s = patience_s
        self._endpoint = endpoint
        self._anywhere_sd_m = anywhere_sd_m(pad_size_m)
        self._clients: dict[str, Client] = {}

    @property
    def features(self) -> dict[str, type]:
        """Names and types, as `Robot.observation_features` has them."""
        return {f"{name}.{feature}": float for name in self.names for feature in FEATURES}

    @property
    def is_connected(self) -> bool:
        return bool(self._clients)

    def connect(self) -> None:
        """Raises TouchLostError if a pad sends nothing."""
        self._clients = {name: Client(name, self._endpoint) for name in self.names}
        try:
            self.read()
        except TouchLostError:
            self.disconnect()
            raise

    def disconnect(self) -> None:
        for client in self._clients.values():
            client.close()
        self._clients = {}

    def contact(self, name: str, wait_s: float | None = None) -> Contact:
        """A usable contact of this pad that was not returned before. Raises TouchLostError if none comes in `wait_s`;
        None: in `patience_s`."""
        client = self._clients.get(name)
        if client is None:
            raise TouchLostError(f"pad {name}: not connected")
        wait_s = self.patience_s if wait_s is None else wait_s
        until = time.monotonic() + wait_s
        last: Contact | None = None
        while (contact := client.latest(timeout_s=max(0.0, until - time.monotonic()))) is not None:
            if client.fresh and is_usable(contact):
                return contact
            last = contact
        raise TouchLostError(why_lost(client, last, wait_s))

    def read(self) -> dict[str, float]:
        """One observation of all pads. Raises TouchLostError; a value is never repeated."""
        return {
            f"{name}.{feature}": value
            for name in self.names
            for feature, value in zip(FEATURES, _values(self.contact(name), self._anywhere_sd_m), strict=True)
        }


def is_usable(contact: Contact) -> bool:
    return contact.health in USABLE and contact.contact is not None


def why_lost(client: Client, last: Contact | None, wait_s: float) -> str:
    """last: the newest contact that came in `wait_s`, of which none was usable."""
    if last is not None:
        return f"pad {client.pad}: {last.health}: {last.reason or 'its last sample is old'}"
    why = client.why() or "its contacts come late"
    return f"pad {client.pad}: nothing new for {wait_s:g} s: {why}"


def filled(contact: Contact, anywhere_sd_m: float) -> Contact:
    """The contact with numbers instead of unknown values: a force over range is its lower bound, a place is the pad's
    middle with the deviation of anywhere. Raises TouchLostError if its force is not known, or if it is a touch without
    a place."""
    force_n = contact.force_min_n if contact.over_range else contact.force_n
    if force_n is None:
        raise TouchLostError(f"pad {contact.pad}: its force is not known: {contact.reason or 'no contact model'}")
    placed = contact.x_m is not None and contact.y_m is not None
    if contact.contact and not placed and not contact.over_range:
        raise TouchLostError(f"pad {contact.pad}: it is touched, and the place is not known: {contact.reason}")
    return replace(
        contact,
        force_n=force_n,
        force_sd_n=contact.force_sd_n or 0.0,
        x_m=contact.x_m if placed else 0.0,
        x_sd_m=anywhere_sd_m if contact.x_sd_m is None else contact.x_sd_m,
        y_m=contact.y_m if placed else 0.0,
        y_sd_m=anywhere_sd_m if contact.y_sd_m is None else contact.y_sd_m,
    )


def _values(contact: Contact, anywhere_sd_m: float) -> tuple[float, ...]:
    """The values in the order of FEATURES."""
    known = filled(contact, anywhere_sd_m)
    numbers = (getattr(known, name) for name in FEATURES[3:])
    return (USABLE[known.health], float(bool(known.contact)), float(known.over_range), *numbers)
