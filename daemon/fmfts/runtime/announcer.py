"""Sends a pad's messages, and reports each change of health and touch: as an event, and in the log."""

from __future__ import annotations

import logging
import time

from fmfts.bus.messages import ContactMessage, EventKind, EventMessage, Health, SlipMessage
from fmfts.bus.publisher import Publisher, contact_topic
from fmfts.pipeline.encoded import Answer, EncodedMessage, message_of
from fmfts.runtime.sparing_log import SparingLog
from fmfts.sensor import Source


class Announcer:
    """health_since_ns: when the health became what it is."""

    def __init__(
        self, name: str, source: Source, publisher: Publisher, boot: str, started_ns: int, log: SparingLog
    ) -> None:
        self._name = name
        self._log = log
        self._source = source
        self._publisher = publisher
        self._boot = boot
        self._topic = contact_topic(name)
        self._last: Answer | None = None
        self.is_touched = False
        self._touched_since_ns = started_ns
        self.health_since_ns = started_ns
        self._told_opening = False  # the last reported reason is that the source is being opened

    @property
    def last(self) -> ContactMessage | None:
        return None if self._last is None else message_of(self._last)

    @property
    def health(self) -> Health:
        return "disconnected" if self._last is None else self._last.health

    def send(self, answer: Answer) -> None:
        """Send a message, and the events of what it changes."""
        self._follow(self._send(answer))

    def sent_in_c(self, changes: list[ContactMessage], last: EncodedMessage) -> None:
        """Report the messages that C has sent since `begin`: those that changed something, and the last one."""
        for message in changes:
            self._follow(message)
        self._follow(last)

    def _send(self, answer: Answer) -> Answer:
        """Returns it as it was sent: the publisher may remove an estimate."""
        if not isinstance(answer, EncodedMessage):
            return self._publisher.send_contact(self._name, answer)
        self._publisher.send_encoded(self._topic, answer.payload)
        return answer

    def _follow(self, answer: Answer) -> None:
        """Report the changes in a sent message. Mostly there are none, and then it is not decoded."""
        before = self._last
        if before is None or self._told_opening or _gist(answer) != _gist(before):
            self._tell(message_of(answer))
        self._last = answer

    def event(self, kind: EventKind, detail: str) -> None:
        now = EventMessage(
            pad=self._name, boot=self._boot, t_ns=time.monotonic_ns(), utc_ns=time.time_ns(), kind=kind, detail=detail
        )
        self._publisher.send_event(self._name, now)

    def _tell(self, message: ContactMessage) -> None:
        """Publish an event for each thing that changed with a message that was sent."""
        before = self._last
        is_change = before is None or before.health != message.health
        # A source that opens for the first time needs no warning; a failure to open it does.
        is_opening = not self._source.state.since_ns
        if is_change:
            self.health_since_ns = message.t_publish_ns
        if is_change or (self._told_opening and not is_opening):
            self._told_opening = is_opening
            text = f"{message.health}: {message.reason}" if message.reason else message.health
            is_calm = message.health == "ok" or is_opening
            is_urgent = message.health == "disconnected"
            self._log.tell(logging.INFO if is_calm else logging.WARNING, text, time.monotonic_ns(), is_urgent=is_urgent)
            self.event("health", text)
        if message.contact is not None:
            self._follow_contact(message)
        if message.slipping != (before is not None and before.slipping):
            self._tell_slip(message)
        if message.over_range and not (before is not None and before.over_range):
            self.event("over_range", f"at least {message.force_min_n or 0.0:.2f} N")

    def _tell_slip(self, message: ContactMessage) -> None:
        slip = message.slip
        if not isinstance(slip, SlipMessage) or slip.slipping is None:
            ended = message.contact is False
            self.event("stick", "the touch ended" if ended else "it is no longer known whether the finger slips")
        elif slip.slipping:
            self.event("slip", f"{(slip.speed_m_per_s or 0.0) * 1e3:.0f} mm/s, friction {slip.friction or 0.0:.2f}")
        else:
            self.event("stick", "")

    def _follow_contact(self, message: ContactMessage) -> None:
        """Publish onset and release. Called only if `contact` is known; an unknown contact changes nothing."""
        if message.contact and not self.is_touched:
            self.event("onset", _place(message))
        elif self.is_touched and not message.contact:
            self.event("release", f"after {(message.t_sample_ns - self._touched_since_ns) * 1e-9:.2f} s")
        if message.contact != self.is_touched:
            self.is_touched, self._touched_since_ns = bool(message.contact), message.t_sample_ns


def _gist(answer: Answer) -> tuple[Health, bool | None, bool, bool]:
    return answer.health, answer.contact, answer.over_range, answer.slipping


def _place(message: ContactMessage) -> str:
    if message.displacement_m is not None:
        which = "the magnet that moved most" if isinstance(message.poses, list) else "the magnet"
        return f"{which} moved by {message.displacement_m * 1e3:.3f} mm"
    if message.more is True:
        return "more than two fingers, or something of another shape"
    if message.x_m is None or message.y_m is None or message.force_n is None:
        return "over range"
    return f"{message.force_n:.3f} N at ({message.x_m * 1e3:+.1f}, {message.y_m * 1e3:+.1f}) mm"
