"""Sends frames, samples and the state for a replay to the recorders of a pad, while there are any."""

from __future__ import annotations

import logging
import time

from fmfts.bus.frame_message import early_message, frame_message
from fmfts.bus.publisher import Publisher
from fmfts.config import PadConfig
from fmfts.pipeline.configured import Pipeline
from fmfts.pipeline.snapshot import state_message
from fmfts.sensor import Frame
from fmfts.sensor.early import EarlySample

log = logging.getLogger(__name__)


class Recorders:
    """config: goes to recorders with the state; None: they get no state."""

    def __init__(self, pipeline: Pipeline, publisher: Publisher, boot: str, config: PadConfig | None = None) -> None:
        self.config = config
        self._name = pipeline.pad.name
        self._pipeline = pipeline
        self._publisher = publisher
        self._boot = boot

    def are_there(self, now_ns: int) -> bool:
        return self._publisher.frames_wanted(self._name, now_ns)

    def state_changed(self) -> None:
        """They need the state again: a baseline has come, gone or moved."""
        self._publisher.state_changed(self._name)

    def frame(self, frame: Frame, used: bool) -> None:
        if self.config is not None and self._publisher.state_wanted(self._name):
            self._send_state(self.config)
        joints = None if self._pipeline.hand is None else self._pipeline.hand.joints
        message = frame_message(frame, self._name, self._boot, time.time_ns(), used, joints)
        self._publisher.send_frame(self._name, message)

    def early(self, early: EarlySample) -> bool:
        """False if they have no state yet, without which no replay can use the sample: it comes with the next frame."""
        if self._publisher.state_wanted(self._name):
            return False
        self._publisher.send_early(self._name, early_message(early, self._name, self._boot, time.time_ns()))
        return True

    def _send_state(self, config: PadConfig) -> None:
        """A state that cannot be encoded is logged; contacts go on."""
        try:
            self._publisher.send_state(self._name, state_message(self._pipeline, config, self._boot))
        except TypeError:
            self._publisher.state_told(self._name)
            log.exception("pad '%s': its state cannot be recorded, worth reporting", self._name)
