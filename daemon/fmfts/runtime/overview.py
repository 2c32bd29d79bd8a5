"""Answers `status`, `pads` and `probe`, which read all pads, and change none."""

from __future__ import annotations

from collections.abc import Mapping

import msgspec

from fmfts.bus.messages import StatusMessage
from fmfts.config import PadConfig
from fmfts.config.pad_facts import pad_facts
from fmfts.runtime.channel import Channel
from fmfts.runtime.kept import KeptAnswer
from fmfts.sensor.probing import probe_facts


class Overview:
    """The facts of all pads, by verb. last_status: by pad; the daemon adds each one that it publishes."""

    def __init__(self, configs: Mapping[str, PadConfig], channels: Mapping[str, Channel]) -> None:
        self.last_status: dict[str, StatusMessage] = {}
        self._channels = channels
        self._facts = {name: pad_facts(config) for name, config in configs.items()}
        self._kept = {
            "status": KeptAnswer(lambda: self.last_status, self._status_of),
            "pads": KeptAnswer(lambda: self._channels, self._pad_of, self._now_of),
            "probe": KeptAnswer(lambda: self._channels, self._probe_of),
        }
        self.verbs = frozenset(self._kept)

    def of_all_pads(self, verb: str) -> msgspec.Raw:
        """The encoded facts, the same until `forget`. Raises NotFiniteError."""
        return self._kept[verb].whole()

    def forget(self) -> None:
        """A frame, or another request, may have changed the facts."""
        for kept in self._kept.values():
            kept.forget()

    def _status_of(self, name: str) -> StatusMessage:
        return _renewed(self._channels[name], self.last_status[name])

    def _pad_of(self, name: str) -> dict[str, object]:
        health, baseline = self._now_of(name)
        now = {"pad": name, "health": health, "baseline": baseline}
        return now | self._facts[name] | self._channels[name].pipeline.model.calibrated_range

    def _now_of(self, name: str) -> tuple[str, str | None]:
        """The changing facts of a pad: its health and its baseline."""
        channel = self._channels[name]
        baseline = channel.pipeline.baseline
        return channel.health, None if baseline is None else baseline.id

    def _probe_of(self, name: str) -> dict[str, object]:
        channel = self._channels[name]
        return probe_facts(name, channel.source, channel.pad_index, _silence(channel), channel.pipeline.missing)


def _renewed(channel: Channel, status: StatusMessage) -> StatusMessage:
    """The status of the last interval, with the health of now."""
    health, reason = channel.told()
    return msgspec.structs.replace(
        status,
        health=health,
        reason=reason,
        since_ns=channel.announcer.health_since_ns,
        connected=channel.source.state.connected,
        sensor_faults=channel.faults,
        board=dict(channel.source.state.board),
    )


def _silence(channel: Channel) -> str:
    """Why no frame of a pad with an open source is used; "" if frames are used."""
    health, reason = channel.told()
    if health not in ("stale", "disconnected"):
        return ""
    return f"it is open, but none of its frames is used: {reason.removeprefix(f'{channel.source.state.description}: ')}"
