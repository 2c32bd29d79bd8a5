"""A second method for the page: a fixed baseline, which is only subtracted, on the same frames.

This is the paper's method (Eq. 9 and 10): the ambient field is that of the baseline, and the magnet's six unknowns are
solved for. It never checks whether the field has changed, and accepts every answer. It has the same gains, sensor
places and contact model as the daemon, so that only the method differs.

A process of its own, `python -m fmfts_page.ghost --bind ENDPOINT`, publishes `ghost/<pad>`: {pad, t_sample_ns,
magnet_m, x_m, y_m, force_n, force_sd_n}; null where the solver finds no pose. force_sd_n: from noise and model alone,
because the method has no other cause.
"""

from __future__ import annotations

import argparse
import logging
import signal
import time
from dataclasses import replace

import msgpack  # type: ignore[import-untyped]
import msgspec
import numpy as np
import zmq

from fmfts.baseline import Baseline, BaselineError
from fmfts.bus.frame_message import frame_of
from fmfts.bus.messages import FrameMessage, StateMessage
from fmfts.config import PadConfig
from fmfts.contact import ContactModel, ModelError
from fmfts.pipeline.baselined_pad import BaselinedPad
from fmfts.pipeline.configured import load_contact_model
from fmfts.pose import PAPER, Status, solve
from fmfts.sensor import Frame
from fmfts_client import EndpointError, Subscription
from fmfts_recording.pad_config import recorded_pad

INTERVAL_S = 1.0 / 40.0  # as often as the page draws
LEAST_AXES = 6  # as many as there are unknowns
NOTHING: dict[str, object] = dict.fromkeys(("magnet_m", "x_m", "y_m", "force_n", "force_sd_n"))
log = logging.getLogger(__name__)


class FixedBaseline:
    """The paper's method for one pad. BaselineError or ModelError if the pad cannot be served."""

    def __init__(self, config: PadConfig, baseline: Baseline) -> None:
        drawing = config.pad()
        self._model: ContactModel = load_contact_model(config)
        self._known = BaselinedPad.of(drawing, baseline, PAPER)
        pad = self._known.pad
        self._pad = replace(pad, magnet=replace(pad.magnet, as_cylinder=False))
        self._start = self._known.mounting.rest
        self.chip = drawing.chip

    def answer(self, frame: Frame) -> dict[str, object]:
        """The magnet's place (3,), the contact's place (m), and its force (N); empty where no pose is found."""
        field_t = self._known.mounting.magnet_field(frame.field_t)
        if int(np.isfinite(field_t).sum()) < LEAST_AXES:
            return {}
        estimate = solve(field_t, self._pad, self._start)
        if estimate.status is not Status.CONVERGED:
            return {}
        position_m, axis, covariance = self._known.in_nominal_frame(estimate)
        try:
            told = self._model.estimate(position_m, axis, covariance)
        except ValueError:  # not a finite pose
            return {}
        force = {"force_n": max(told.force_n, 0.0), "force_sd_n": told.force_sd_n}
        return {"magnet_m": position_m.tolist(), "x_m": told.x_m, "y_m": told.y_m, **force}


class Ghosts:
    """The method for all pads, made from the states that a daemon sends before its frames."""

    def __init__(self) -> None:
        self._ways: dict[str, FixedBaseline | None] = {}
        self._said_s: dict[str, float] = {}

    def begin(self, state: StateMessage) -> None:
        """A pad's configuration or baseline is new."""
        self._ways[state.pad] = None
        if state.baseline is None:
            return
        try:
            config = recorded_pad(state.config)
            self._ways[state.pad] = FixedBaseline(config, msgspec.convert(state.baseline, Baseline))
        except (BaselineError, ModelError, msgspec.ValidationError) as error:
            log.warning("pad '%s' has no ghost: %s", state.pad, error)

    def wants(self, pad: str) -> bool:
        """Is another answer about this pad due?"""
        return self._ways.get(pad) is not None and time.monotonic() - self._said_s.get(pad, 0.0) >= INTERVAL_S

    def message(self, frame: FrameMessage) -> dict[str, object]:
        """The message for a requested frame."""
        way = self._ways[frame.pad]
        assert way is not None
        self._said_s[frame.pad] = time.monotonic()
        told = way.answer(frame_of(frame, chip=way.chip))
        return {"pad": frame.pad, "t_sample_ns": frame.host_time_ns, **NOTHING, **told}


def publish(endpoint: str | None, bind: str) -> None:
    """Publish ghosts of all pads of the daemon at `endpoint` on `bind`, until SIGTERM. Raises EndpointError."""
    ghosts = Ghosts()
    out: zmq.Socket[bytes] = zmq.Context.instance().socket(zmq.PUB)
    with out, Subscription(("frame", "state"), None, endpoint) as frames:
        out.setsockopt(zmq.LINGER, 0)
        out.bind(bind)
        while True:
            message = frames.receive()
            if message is None:
                continue
            if message.kind == "state":
                ghosts.begin(msgspec.convert(message.body, StateMessage))
            elif ghosts.wants(message.pad):
                told = ghosts.message(msgspec.convert(message.body, FrameMessage))
                out.send_multipart((f"ghost/{message.pad}".encode(), msgpack.packb(told)))


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m fmfts_page.ghost", description=__doc__)
    parser.add_argument("--bind", required=True, metavar="ENDPOINT", help="where to publish")
    parser.add_argument("--endpoint", help="base of the daemon's endpoints; default: as for every client")
    options = parser.parse_args()
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        publish(options.endpoint, options.bind)
    except KeyboardInterrupt:
        return 0
    except EndpointError as error:
        parser.error(str(error))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
