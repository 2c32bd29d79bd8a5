"""The whole job: frame → field → pose → contact → message."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from fmfts.ambient import Baseline, Mounting
from fmfts.bus.messages import NO_ESTIMATE, ContactMessage, Health, PoseMessage, Vector
from fmfts.contact import ContactEstimate, ContactModel, TouchDetector
from fmfts.pad import Pad
from fmfts.pose import Alignment, PoseEstimate, Track, Tracker, as_drawn, displacement, widened
from fmfts.sensor import Frame

Array = NDArray[np.float64]

NO_BASELINE = "no baseline: record one with `fmfts-daemon baseline` while nothing touches the pad"
BARE_ONLY = "rest not recorded: mount the pad, then `fmfts-daemon baseline --rest` while nothing touches it"


@dataclass(frozen=True, slots=True)
class _Mounted:
    """What a baseline makes of a drawing."""

    baseline: Baseline
    mounting: Mounting
    pad: Pad
    tracker: Tracker
    touch: TouchDetector


class PadPipeline:
    """One pad. `model` serves every pad of the structure; `baseline` belongs to this one."""

    def __init__(self, pad: Pad, model: ContactModel, boot: str, rate_hz: float) -> None:
        self.pad = pad
        self._model = model
        self._boot = boot
        self._rate_hz = rate_hz
        self._alignment = Alignment(len(pad.sensors), period_us=1e6 / rate_hz)
        self._mounted: _Mounted | None = None
        self._published = 0

    @property
    def baseline(self) -> Baseline | None:
        return None if self._mounted is None else self._mounted.baseline

    @property
    def mounting(self) -> Mounting | None:
        return None if self._mounted is None else self._mounted.mounting

    def use(self, baseline: Baseline) -> Mounting:
        """From the next frame on, subtract this baseline. BaselineError where it does not fit the pad."""
        mounting = baseline.mounting(self.pad)
        pad = mounting.mounted(self.pad)
        self._mounted = _Mounted(baseline, mounting, pad, Tracker(pad, mounting.rest), TouchDetector(self._rate_hz))
        return mounting

    def process(self, frame: Frame) -> ContactMessage:
        """One frame in, one message out."""
        aligned = self._alignment.push(frame.field_t, frame.device_time_us - frame.age_us.astype(np.int64), frame.fresh)
        sampled_ns = frame.host_time_ns - (frame.device_time_us - aligned.time_us) * 1000
        mounted = self._mounted
        if mounted is None:
            return self._message(frame, sampled_ns, "no_baseline", NO_BASELINE, _mask(frame.usable))
        field = mounted.mounting.magnet_field(aligned.field_t)
        deviation = np.hypot(mounted.mounting.deviation_t(field, aligned.noise_share), aligned.bend_t)
        track = mounted.tracker.update(field, deviation)
        if mounted.baseline.kind == "bare":
            return self._message(frame, sampled_ns, "no_baseline", BARE_ONLY, _mask(track.used), track)
        if track.estimate is None or track.health == "disturbed":
            return self._message(frame, sampled_ns, track.health, track.reason, _mask(track.used), track)
        rest = mounted.mounting.rest
        change, _ = displacement(track.estimate, rest)
        estimate = widened(track.estimate, rest, mounted.mounting.change_covariance(change))
        touching = mounted.touch.update(*displacement(estimate, rest))
        # The model knows the drawing's pad: it gets the change of pose from this pad's rest, put on the drawing's.
        contact = self._model.estimate(*as_drawn(estimate, rest, self.pad))
        return self._message(frame, sampled_ns, track.health, track.reason, _mask(track.used), track, contact, touching)

    def absent(self, health: Health, reason: str, now_ns: int) -> ContactMessage:
        """What is published while no frame comes: silence is not an answer."""
        return self._message(None, now_ns, health, reason, 0)

    def _message(
        self,
        frame: Frame | None,
        sampled_ns: int,
        health: Health,
        reason: str,
        sensors_ok: int,
        track: Track | None = None,
        contact: ContactEstimate | None = None,
        touching: bool | None = None,
    ) -> ContactMessage:
        """A message with null wherever there is no estimate."""
        mounted = self._mounted
        estimates = NO_ESTIMATE | _contact_fields(contact, touching)
        if mounted is not None and track is not None and track.estimate is not None:
            estimates["pose"] = _pose_message(track.estimate, mounted.mounting)
        self._published += 1
        return ContactMessage(
            pad=self.pad.name,
            boot=self._boot,
            seq=self._published,
            t_sample_ns=sampled_ns,
            t_publish_ns=time.monotonic_ns(),
            utc_ns=time.time_ns(),
            temperature_c=None if frame is None else frame.temperature_c,
            health=health,
            reason=reason,
            **estimates,
            sensors_ok=sensors_ok,
            solver="numpy",
            model=self._model.hash,
            baseline=None if self.baseline is None else self.baseline.id,
        )


def _contact_fields(contact: ContactEstimate | None, touching: bool | None) -> dict[str, Any]:
    """Where nothing touches, there is no place; beyond the model's range there is only a bound of the force."""
    if contact is None:
        return {"over_range": False}
    if touching and contact.over_range:
        return {"contact": True, "over_range": True, "force_min_n": contact.force_min_n}
    force: dict[str, Any] = {"contact": touching, "over_range": False}
    force |= {"force_n": max(contact.force_n, 0.0), "force_sd_n": contact.force_sd_n}
    if not touching:
        return force
    return force | {"x_m": contact.x_m, "x_sd_m": contact.x_sd_m, "y_m": contact.y_m, "y_sd_m": contact.y_sd_m}


def _pose_message(estimate: PoseEstimate, mounting: Mounting) -> PoseMessage:
    """The absolute pose: as uncertain as its change from rest and the rest pose together."""
    deviation = np.sqrt(np.diagonal(estimate.covariance)[:6] + np.diagonal(mounting.rest_covariance))
    return PoseMessage(
        position_m=_vector(estimate.position_m),
        position_sd_m=_vector(deviation[:3]),
        axis=_vector(estimate.axis),
        axis_sd_rad=float(deviation[3:5].max()),
        remanence_t=estimate.remanence_t,
        remanence_sd_t=float(deviation[5]) * estimate.remanence_t,
        ambient_t=_vector(mounting.ambient_t),
        ambient_sd_t=_vector(mounting.ambient_deviation_t),
        residual_t=estimate.residual_t,
        chi2=estimate.chi2,
    )


@overload
def _vector(values: Array) -> Vector: ...
@overload
def _vector(values: None) -> None: ...
def _vector(values: Array | None) -> Vector | None:
    if values is None:
        return None
    x, y, z = values.tolist()
    return x, y, z


def _mask(used: NDArray[np.bool_]) -> int:
    """Bit i: every axis of sensor i is used."""
    return sum(1 << sensor for sensor in np.flatnonzero(used.all(axis=1)).tolist())
