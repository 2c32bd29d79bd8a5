"""Gives a controller the newest contact of one pad, and whether it is valid."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterator
from types import TracebackType
from typing import Optional, Union

from fmfts_client.contact import Contact, Status
from fmfts_client.diagnosis import why_nothing
from fmfts_client.endpoints import Endpoints
from fmfts_client.fields import MessageError
from fmfts_client.subscription import Subscription

ALIVE_S = 0.3  # three messages: the daemon sends at 10 Hz or more, even while the hardware is silent
RATE_WINDOW_S = 1.0
RATE_TOLERANCE = 0.1
WHY_S = 1.0  # ten messages of each pad, and the time to connect


class Client:
    """Contacts of `pad`.

    largest_force_sd_n: `valid` is False while the deviation of the force is larger. Name a third of what you can bear;
    None: 0.5 N, or a third of the force where that is more.
    endpoint: a base as in FMFTS_BUS, or Endpoints; None: the default. The client connects in the background, and again
    after the daemon restarts. While no daemon runs, there is no error, and `alive` is False. Only `latest()` and
    iteration receive messages; the properties describe the messages received so far.

    Raises EndpointError at once, and SchemaError when the daemon uses another schema version. Other messages that must
    not be used are skipped and counted in `refused`; `refusal` says why.
    """

    def __init__(
        self,
        pad: str,
        endpoint: Optional[Union[str, Endpoints]] = None,
        largest_force_sd_n: Optional[float] = None,
    ) -> None:
        self.pad = pad
        self.largest_force_sd_n = largest_force_sd_n
        self.contact: Optional[Contact] = None
        self.status: Optional[Status] = None
        self.restarts = 0
        self._refused_before = 0  # the last contact
        self._subscription = Subscription(("contact", "status"), pad, endpoint)
        self._published_ns: deque[int] = deque()
        self._frames_ns: deque[int] = deque()  # the same for messages of frames, not of the samples between them

    @property
    def refused(self) -> int:
        return self._subscription.refused

    @property
    def refusal(self) -> str:
        return self._subscription.refusal

    def latest(self, timeout_s: float = 0.0) -> Optional[Contact]:
        """The newest contact that was not returned before; older ones are dropped. None: nothing new in `timeout_s`.

        A contact that was sent more than ALIVE_S ago (it waited in a queue while the caller was busy) is not new.
        With a `timeout_s` below ALIVE_S, None does not yet mean silence: `valid` says whether `contact` still holds.
        """
        deadline = time.monotonic() + timeout_s
        while True:
            newest = None
            while (contact := self._next(0.0)) is not None:
                newest = contact
            if newest is not None and self.alive:
                return newest
            left_s = deadline - time.monotonic()
            if left_s <= 0 or not self._subscription.wait(left_s):
                return None

    def contacts(self, timeout_s: Optional[float] = None) -> Iterator[Contact]:
        """Yields every contact in order; ends after `timeout_s` seconds of silence (None: waits for ever)."""
        while True:
            contact = self._next(timeout_s)
            if contact is None:
                return
            yield contact

    def __iter__(self) -> Iterator[Contact]:
        return self.contacts()

    @property
    def alive(self) -> bool:
        """Did the daemon send something about this pad in the last 0.3 s?"""
        return self.contact is not None and 0 <= self.contact.publish_age_s < ALIVE_S

    @property
    def fresh(self) -> bool:
        """Was the pad sampled in the last 0.3 s? (While the hardware is silent the daemon still sends health.)"""
        return self.contact is not None and 0 <= self.contact.sample_age_s < ALIVE_S

    @property
    def rate_hz(self) -> float:
        """Rate of the received contacts that were sent in the last second."""
        return _rate_hz(self._published_ns)

    @property
    def freq_ok(self) -> bool:
        """Is the rate of frames in the last second within 10 % (and one) of the configured rate that `status` tells?"""
        if self.status is None:
            return False
        nominal_hz = self.status.rate_nominal_hz
        return abs(_rate_hz(self._frames_ns) - nominal_hz) <= RATE_TOLERANCE * nominal_hz + 1 / RATE_WINDOW_S

    @property
    def valid(self) -> bool:
        """May a controller act on the last contact now: is it alive, fresh, `Contact.valid`, and certain enough?"""
        return not self.why_invalid

    @property
    def why_invalid(self) -> str:
        """Why `valid` is False, as a sentence, without waiting; "" if it is True. If nothing arrives, `why()` explains
        more. The sentence stays the same while its cause does, except for numbers of a force."""
        if self.contact is None or not self.alive:
            refused = self.refused - self._refused_before
            if refused == 0:
                return "nothing arrives"
            return f"nothing usable arrives (messages refused: {refused}): {self.refusal}"
        if self.contact.health == "ok" and not self.fresh:
            return f"the pad was not sampled for {ALIVE_S} s or more"
        return self.contact.why_invalid(self.largest_force_sd_n)

    def why(self, timeout_s: float = WHY_S) -> str:
        """Why nothing arrives, as a sentence with what to do; "" if contacts of the pad do arrive and can be read.

        Listens to all pads of the daemon for up to `timeout_s`, on a connection of its own: not for a control loop.
        It finds out that no daemon is there, that it has no such pad (and which it has), another version, or a refused
        key.
        """
        return why_nothing(self.pad, self._subscription.endpoints, timeout_s)

    def _next(self, timeout_s: Optional[float]) -> Optional[Contact]:
        deadline = None if timeout_s is None else time.monotonic() + timeout_s
        while True:
            left_s = None if deadline is None else max(0.0, deadline - time.monotonic())
            message = self._subscription.receive(left_s)
            if message is None:
                return None
            try:
                if message.kind == "status":
                    self.status = Status.from_message(message.body)
                else:
                    return self._take(Contact.from_message(message.body, message.clock_ahead_s))
            except MessageError as error:
                self._subscription.refuse(error)

    def _take(self, contact: Contact) -> Contact:
        if self.contact is not None and contact.boot != self.contact.boot:
            self.restarts += 1
            self.status = None
            self._published_ns.clear()
            self._frames_ns.clear()
        is_of_a_frame = self.contact is None or contact.t_sample_ns != self.contact.t_sample_ns
        self.contact = contact
        self._refused_before = self.refused
        for times in (self._published_ns, self._frames_ns) if is_of_a_frame else (self._published_ns,):
            times.append(contact.t_publish_ns)
            if len(times) > 1 and contact.t_publish_ns - times[0] > RATE_WINDOW_S * 1e9:
                times.popleft()
        return contact

    def close(self) -> None:
        self._subscription.close()

    def __enter__(self) -> Client:
        return self

    def __exit__(
        self, kind: Optional[type[BaseException]], error: Optional[BaseException], trace: Optional[TracebackType]
    ) -> None:
        self.close()


def _rate_hz(times_ns: deque[int]) -> float:
    """Of those of the last second."""
    oldest_ns = time.monotonic_ns() - int(RATE_WINDOW_S * 1e9)
    while times_ns and times_ns[0] < oldest_ns:
        times_ns.popleft()
    return len(times_ns) / RATE_WINDOW_S
