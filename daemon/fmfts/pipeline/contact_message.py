"""From a reading to its message. Fields are null where there is no estimate that a controller could act on."""

from __future__ import annotations

import time
from functools import lru_cache
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.elementary import square
from fmfts.baseline import Baseline, Mounting
from fmfts.bus.encoding import decode_contact
from fmfts.bus.messages import NO_ESTIMATE, ContactMessage, NowMessage, PoseMessage, Vector
from fmfts.contact import ContactEstimate
from fmfts.contact.now import ContactNow
from fmfts.pipeline.fast import FastPath, Judged, Kind, Lane, Passed, Template, Verdict
from fmfts.pipeline.reading import Reading
from fmfts.pose import AMBIENT, PoseEstimate, Status
from fmfts.pose.state import SIZE
from fmfts.sensor import Frame

Array = NDArray[np.float64]


class PackedMessage(msgspec.Struct, frozen=True, gc=False):
    """The encoded message of a frame that C judged: of a healthy one, or one that lacks what the ones before lacked."""

    payload: bytes
    kind: Kind
    t_sample_ns: int
    t_publish_ns: int

    @property
    def message(self) -> ContactMessage:
        return decode_contact(self.payload)


class MessageWriter:
    """Makes the messages of one pad, and numbers them."""

    def __init__(self, pad: str, boot: str, model: str) -> None:
        self._pad = pad
        self._boot = boot
        self._model = model
        self.number = 0
        self.sampled_ns = 0
        self._templates: tuple[Template, ...] = ()  # one for each Kind
        self._templates_of: tuple[bool, str, Verdict] | None = None  # (temperature unknown, baseline id, verdict)
        self._last: ContactMessage | None = None  # of the last frame that Python judged
        self._last_kind: Kind | None = None  # kind of the last message; None unless it was a packed one

    def packed(
        self, path: FastPath, judged: Judged, frame: Frame, mounting: Mounting, baseline: Baseline
    ) -> PackedMessage:
        """The message of the frame that `path` judged last."""
        templates_of = frame.temperature_c is None, baseline.id, path.verdict
        if self._templates_of != templates_of:
            self._templates = tuple(self._template(kind, frame, mounting, baseline, path.verdict) for kind in Kind)
            self._templates_of = templates_of
        self._last_kind = judged.kind
        self.sampled_ns = frame.host_time_ns - (frame.device_time_us - judged.instant_us) * 1000
        return self._packed(path, judged.kind, judged.now_us, frame.device_time_us, frame.host_time_ns)

    def packed_early(
        self, path: FastPath, now_us: float, device_time_us: int, host_time_ns: int
    ) -> PackedMessage | None:
        """The last message that `packed` made again, with the `now` that `path` told last. The times: as in `early`."""
        if self._last_kind is None:
            return None
        return self._packed(path, self._last_kind, now_us, device_time_us, host_time_ns)

    def _packed(
        self, path: FastPath, kind: Kind, now_us: float, device_time_us: int, host_time_ns: int
    ) -> PackedMessage:
        self.number += 1
        publish_ns = time.monotonic_ns()
        now_ns = host_time_ns + int((now_us - device_time_us) * 1000.0)
        times = self.sampled_ns, publish_ns, time.time_ns(), now_ns
        payload = path.message(self._templates[kind], self.number, *times)
        return PackedMessage(payload, kind, self.sampled_ns, publish_ns)

    def begin(self, lane: Lane, sequence: int, frame_times: tuple[int, int]) -> bool:
        """Let `lane` send the messages after frame `sequence`. False, and it does nothing, if none was packed.

        frame_times: of that frame, on the board's clock (µs), and on the host's (ns).
        """
        if self._last_kind is not None:
            lane.begin(self._templates, self._last_kind, self.number, sequence, self.sampled_ns, frame_times)
        return self._last_kind is not None

    def passed(self, passed: Passed) -> PackedMessage:
        """Continue the numbering after a lane. Returns the last message that it sent."""
        self.number, self.sampled_ns, self._last_kind = passed.number, passed.t_sample_ns, passed.kind
        return PackedMessage(passed.payload, passed.kind, passed.t_sample_ns, passed.t_publish_ns)

    def _template(self, kind: Kind, frame: Frame, mounting: Mounting, baseline: Baseline, verdict: Verdict) -> Template:
        """The message of a reading of this kind, with room for any numbers."""
        over_range = kind == Kind.OVER_RANGE
        outputs, shear = (5, np.zeros(2)) if verdict.tells_shear else (3, None)
        covariance, force_min_n = np.zeros((outputs, outputs)), 0.0 if over_range else None
        contact, distance_m = None, None
        if verdict.tells_force:
            contact = ContactEstimate(0.0, 0.0, 0.0, covariance, over_range, force_min_n, 0.0, 0.0, 0.0, shear)
        else:
            distance_m = 0.0, 0.0
        state = mounting.rest
        estimate = PoseEstimate(
            state, np.zeros((SIZE, SIZE)), 0.0, 0, 0, 0.0, 0, Status.CONVERGED, np.zeros(SIZE), remanence_t=0.0
        )
        now = None
        if verdict.tells_now and not over_range:
            none = np.zeros(outputs)
            now = ContactNow(0.0, none, none, none, none, kind != Kind.QUIET)
        used = np.repeat(np.array(verdict.whole)[:, None], 3, axis=1)
        reading = Reading(
            *(verdict.health, verdict.reason, used, estimate, contact, kind != Kind.QUIET),
            now=now,
            distance_m=distance_m,
        )
        number, sampled_ns = self.number, self.sampled_ns
        message = self.message(reading, 0, frame.temperature_c, mounting, baseline, frame)
        self.number, self.sampled_ns = number, sampled_ns
        return Template.of(message)

    def message(
        self,
        reading: Reading,
        sampled_ns: int | None,
        temperature_c: float | None,
        mounting: Mounting | None,
        baseline: Baseline | None,
        frame: Frame | None = None,
    ) -> ContactMessage:
        """The message of a reading. sampled_ns: host time of the sample; None, without a frame, repeats the last.

        frame: that the reading was made of.
        """
        self.sampled_ns = self.sampled_ns if sampled_ns is None else sampled_ns
        self._last_kind = None
        self.number += 1
        estimates: dict[str, Any] = NO_ESTIMATE | {"over_range": False}
        if reading.contact is not None and reading.touching is not None:
            estimates |= _contact_fields(reading.contact, reading.touching, reading.force_sd_n)
        if reading.distance_m is not None and reading.touching is not None:
            distance_m, deviation_m = reading.distance_m
            estimates |= {
                "contact": reading.touching,
                "displacement_m": distance_m,
                "displacement_sd_m": deviation_m,
            }
        if reading.estimate is not None and mounting is not None:
            estimates["pose"] = _pose_message(reading.estimate, mounting)
        if reading.now is not None and frame is not None:
            estimates["now"] = now_message(reading.now, frame.device_time_us, frame.host_time_ns)
        self._last = ContactMessage(
            pad=self._pad,
            boot=self._boot,
            seq=self.number,
            t_sample_ns=self.sampled_ns,
            t_publish_ns=time.monotonic_ns(),
            utc_ns=time.time_ns(),
            temperature_c=temperature_c,
            health=reading.health,
            reason=reading.reason,
            **estimates,
            sensors_ok=mask_of(reading.used),
            model=self._model,
            baseline=None if baseline is None else baseline.id,
        )
        return self._last

    def early(self, now: ContactNow, device_time_us: int, host_time_ns: int) -> ContactMessage:
        """The last message again, with another `now`. The times are those of the frame that it was made of."""
        assert self._last is not None
        self.number += 1
        return msgspec.structs.replace(
            self._last,
            seq=self.number,
            t_publish_ns=time.monotonic_ns(),
            utc_ns=time.time_ns(),
            now=now_message(now, device_time_us, host_time_ns),
        )


def _contact_fields(contact: ContactEstimate, touching: bool, force_sd_n: float) -> dict[str, Any]:
    """Without a contact the force is 0, without a place. Beyond the model's range there is only a lower bound."""
    if touching and contact.over_range:
        return {"contact": True, "over_range": True, "force_min_n": 0.0 if contact.refused else contact.force_min_n}
    if touching and contact.refused:  # here shear cannot be told from place and force
        return {"contact": True}
    if not touching:
        return {"contact": False, "force_n": 0.0, "force_sd_n": force_sd_n}
    force = {"contact": True, "force_n": contact.force_n, "force_sd_n": force_sd_n} | _shear_fields(contact)
    return force | {"x_m": contact.x_m, "x_sd_m": contact.x_sd_m, "y_m": contact.y_m, "y_sd_m": contact.y_sd_m}


def _shear_fields(contact: ContactEstimate) -> dict[str, float]:
    if contact.shear_n is None:
        return {}
    (x_n, y_n), deviation_n = contact.shear_n.tolist(), np.sqrt(np.diagonal(contact.covariance)[3:])
    x_sd_n, y_sd_n = deviation_n.tolist()
    return {"shear_x_n": x_n, "shear_x_sd_n": x_sd_n, "shear_y_n": y_n, "shear_y_sd_n": y_sd_n}


def now_message(now: ContactNow, device_time_us: int, host_time_ns: int) -> NowMessage:
    """In the host's time. device_time_us, host_time_ns: one instant on the board's clock and the host's."""
    names = ("x", "y", "force", "shear_x", "shear_y")
    numbers: dict[str, float | None] = dict.fromkeys(NowMessage.__struct_fields__[1:])
    columns = (now.values, now.deviations, now.rates, now.rate_deviations)
    for name, values in zip(names, zip(*(column.tolist() for column in columns), strict=True), strict=False):
        unit = "m" if name in ("x", "y") else "n"
        if now.touching or name == "force":
            forms = (f"{name}_{unit}", f"{name}_sd_{unit}", f"{name}_rate_{unit}_per_s", f"{name}_rate_sd_{unit}_per_s")
            numbers |= dict(zip(forms, values, strict=True))
    t_ns = host_time_ns + int((now.time_us - device_time_us) * 1000.0)
    return NowMessage(t_ns=t_ns, **numbers)  # type: ignore[arg-type]


def _pose_message(estimate: PoseEstimate, mounting: Mounting) -> PoseMessage:
    """The absolute pose. Its variance is that of the change from rest plus that of the rest pose."""
    variance = np.diagonal(estimate.covariance)
    deviation = np.sqrt(variance[:6] + np.diagonal(mounting.rest_covariance))
    ambient, ambient_deviation = None, None
    if mounting.ambient_t is not None and mounting.ambient_deviation_t is not None:
        ambient = _vector(mounting.ambient_t + estimate.state.ambient_t)
        ambient_deviation = _vector(np.sqrt(square(mounting.ambient_deviation_t) + variance[AMBIENT]))
    return PoseMessage(
        position_m=_vector(estimate.position_m),
        position_sd_m=_vector(deviation[:3]),
        axis=_vector(estimate.axis),
        axis_sd_rad=float(deviation[3:5].max()),
        remanence_t=estimate.remanence_t,
        remanence_sd_t=float(deviation[5]) * estimate.remanence_t,
        ambient_t=ambient,
        ambient_sd_t=ambient_deviation,
        residual_t=estimate.residual_t,
        chi2=estimate.chi2,
    )


def _vector(values: Array) -> Vector:
    x, y, z = values.tolist()
    return x, y, z


def mask_of(used: NDArray[np.bool_]) -> int:
    """Bit i is set if every axis of sensor i is used."""
    return _mask_of(used.tobytes(), used.shape)


@lru_cache(maxsize=256)
def _mask_of(used: bytes, shape: tuple[int, ...]) -> int:
    """Of the bytes of `used`: mostly they are those of the frame before."""
    whole = np.frombuffer(used, dtype=np.bool_).reshape(shape).all(axis=1)
    return sum(1 << sensor for sensor in np.flatnonzero(whole).tolist())
