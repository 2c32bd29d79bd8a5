"""Answers what `status`, `pads` and `probe` ask: they read all pads, and change none."""

from __future__ import annotations

from collections.abc import Mapping

import msgspec

from fmfts.bus.messages import StatusMessage
from fmfts.config import PadConfig
from fmfts.config.pad_facts import pad_facts
from fmfts.contact import NoContactModel
from fmfts.contact.array_model import ArrayModel
from fmfts.contact.skin_model import SkinForceModel, SkinModel
from fmfts.pipeline.configured import AnyModel
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
        return now | self._facts[name] | _range_of(self._channels[name].pipeline.model)

    def _now_of(self, name: str) -> tuple[str, str | None]:
        """What changes of a pad: its health and its baseline."""
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
    """Why no frame of a pad is used whose source is open, "" where frames are used."""
    health, reason = channel.told()
    if health not in ("stale", "disconnected"):
        return ""
    return f"it is open, but no frame of it is used: {reason.removeprefix(f'{channel.source.state.description}: ')}"


def _range_of(model: AnyModel) -> dict[str, object]:
    """The places and forces that the contact model was calibrated for."""
    if isinstance(model, NoContactModel):
        return {}
    if isinstance(model, ArrayModel):
        along_m = [model.response.first_mm * 1e-3, model.response.last_mm * 1e-3]
        return {
            "calibrated_x_m": along_m,
            "calibrated_y_m": along_m,
            "calibrated_force_n": model.response.scale_n,
        }
    if isinstance(model, SkinForceModel):
        return {"calibrated_force_n": model.largest_load}
    if isinstance(model, SkinModel):
        return _range_of_skin(model)
    envelope = model.facts.envelope
    return {
        "calibrated_x_m": [value * 1e-3 for value in envelope.x_mm],
        "calibrated_y_m": [value * 1e-3 for value in envelope.y_mm],
        "calibrated_force_n": envelope.force_max_n,
    }


def _range_of_skin(model: SkinModel) -> dict[str, object]:
    facts: dict[str, object] = {}
    for axis in model.response.axes:
        if axis.name == "force_n":
            facts["calibrated_force_n"] = axis.last
        elif axis.name != "depth_mm":
            facts[f"calibrated_{axis.name[0]}_m"] = [axis.first * 1e-3, axis.last * 1e-3]
    return facts
