"""Defines the daemon's messages in SI units; names end in their unit. docs/messages.md explains every field."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field
from typing import Any, Optional

from fmfts_client.fields import MAY_BE_MISSING, NOT_SENT, check_version, parse
from fmfts_client.now import Now
from fmfts_client.slip import Slip

Vector = tuple[float, float, float]
# Most tasks stop at a force of a newton or more; this deviation is half a newton, the largest with which a controller
# can decide.
LARGEST_FORCE_SD_N = 0.5
HEALTHS = ("ok", "degraded", "disturbed", "lost", "stale", "disconnected", "no_baseline")


@dataclass(frozen=True)
class Pose:
    """Pose of a magnet in pad axes (origin in the sensor plane, z toward the finger)."""

    position_m: Vector
    position_sd_m: Vector
    axis: Vector
    axis_sd_rad: float
    remanence_t: float
    remanence_sd_t: float
    ambient_t: Optional[Vector]
    ambient_sd_t: Optional[Vector]
    residual_t: float
    chi2: float


@dataclass(frozen=True)
class Finger:
    """One finger on a pad with several magnets. `id` stays while the finger does. Shear: None if not known."""

    id: int
    x_m: float
    x_sd_m: float
    y_m: float
    y_sd_m: float
    force_n: float
    force_sd_n: float
    shear_x_n: Optional[float]
    shear_x_sd_n: Optional[float]
    shear_y_n: Optional[float]
    shear_y_sd_n: Optional[float]


@dataclass(frozen=True)
class Contact:
    """One contact message of a pad. None means not known; a number is never a guess or NaN."""

    v: int
    pad: str
    boot: str
    seq: int
    t_sample_ns: int
    t_publish_ns: int
    utc_ns: int
    temperature_c: Optional[float]
    health: str
    reason: str
    contact: Optional[bool]
    x_m: Optional[float]
    x_sd_m: Optional[float]
    y_m: Optional[float]
    y_sd_m: Optional[float]
    force_n: Optional[float]
    force_sd_n: Optional[float]
    shear_x_n: Optional[float]
    shear_x_sd_n: Optional[float]
    shear_y_n: Optional[float]
    shear_y_sd_n: Optional[float]
    over_range: bool
    force_min_n: Optional[float]
    displacement_m: Optional[float]
    displacement_sd_m: Optional[float]
    pose: Optional[Pose]
    sensors_ok: int
    model: str
    baseline: Optional[str]
    # The contact when this was published; None if it is not known, or if the daemon does not send it.
    now: Optional[Now] = field(default=None, metadata=MAY_BE_MISSING)
    # Whether the finger slips; None if the pad's configuration does not ask for it.
    slip: Optional[Slip] = field(default=None, metadata=MAY_BE_MISSING)
    # Each finger of a pad with several magnets; (): no contact; None: unknown, or a pad with one magnet. Place,
    # force and shear above are the resultant of all fingers.
    contacts: Optional[tuple[Finger, ...]] = field(default=None, metadata=MAY_BE_MISSING)
    # True if two fingers do not explain the frame. None: a pad with one magnet, which never detects that.
    more: Optional[bool] = field(default=None, metadata=MAY_BE_MISSING)
    # Pose of each magnet of a pad with several; then `pose` is None.
    poses: Optional[tuple[Pose, ...]] = field(default=None, metadata=MAY_BE_MISSING)
    # By how much this machine's monotonic clock is ahead of that of the times above; None: not known.
    clock_ahead_s: Optional[float] = field(default=0.0, metadata=NOT_SENT)

    @classmethod
    def from_message(cls, message: dict[str, Any], clock_ahead_s: Optional[float] = 0.0) -> Contact:
        """The contact of a decoded `contact/<pad>` message. Raises MessageError where anything in it is wrong.

        clock_ahead_s: as in `Message`; 0 for a daemon on this machine.
        """
        check_version(message)
        return parse(cls, message, clock_ahead_s=clock_ahead_s)

    @property
    def valid(self) -> bool:
        """May `contact` and `force_n` (and, in contact, `x_m` and `y_m`) be used as a measurement?

        True when health is "ok", contact is known, the force is estimated and inside the model's range, and a touch has
        a place. `Client.valid` also checks the age, and how certain the force is. A contact that is not valid does not
        mean "no force". A pad without
        a contact model is never valid: it knows `contact` and `displacement_m`, and no force.
        """
        known = self.health == "ok" and self.contact is not None and self.force_n is not None
        placed = not self.contact or (self.x_m is not None and self.y_m is not None)
        return known and placed and not self.over_range

    def why_invalid(self, largest_force_sd_n: Optional[float] = None) -> str:
        """Why no controller may act on it, as a sentence; "" if one may.

        largest_force_sd_n: the largest deviation of the force; None: LARGEST_FORCE_SD_N or a third of the force, the
        larger. An uncalibrated pad knows a force to about a quarter.
        """
        if not self.valid:
            return self._why_no_measurement
        force_n, deviation_n = self.force_n or 0.0, math.inf if self.force_sd_n is None else self.force_sd_n
        limit_n = max(LARGEST_FORCE_SD_N, force_n / 3.0) if largest_force_sd_n is None else largest_force_sd_n
        if deviation_n <= limit_n:
            return ""
        return (
            f"the force is {force_n:.2f} ± {deviation_n:.3f} N, less certain than ± {limit_n:.3f} N: "
            "`fmfts-daemon baseline --turn` and `weigh` make it more certain"
        )

    @property
    def _why_no_measurement(self) -> str:
        if self.health not in HEALTHS:
            return f"its health '{self.health}' is not known to this client: install the client of the daemon's version"
        if self.health != "ok":
            return f"{self.health}: {self.reason}" if self.reason else self.health
        if self.over_range:
            return "the pad is pressed harder than its contact model knows"
        return "the place is not known" if self.force_n is not None and self.contact else "the force is not known"

    @property
    def tells_fingers(self) -> bool:
        """Does this pad have several magnets, so that it tells `contacts` where it can?

        Of any other pad `contacts` is always None, and two fingers look like one. Without a contact model (`model` is
        "none") a pad with several magnets cannot: it tells touch and poses alone.
        """
        return self.more is not None

    def at(self, t_ns: Optional[int] = None) -> Optional[Now]:
        """The contact carried on to `t_ns` of this machine's monotonic clock; None: to this instant.

        None if `now` is, while the other machine's clock is not known, and farther than 20 ms from `now.t_ns`.
        """
        if self.now is None or self.clock_ahead_s is None:
            return None
        t_ns = time.monotonic_ns() if t_ns is None else t_ns
        return self.now.carried((t_ns - self.now.t_ns) * 1e-9 - self.clock_ahead_s)

    @property
    def sample_age_s(self) -> float:
        """Seconds since the sensors were sampled; infinite while the other machine's clock is not known."""
        return self._age_s(self.t_sample_ns)

    @property
    def publish_age_s(self) -> float:
        """Seconds since the daemon sent this; from another machine, without the shortest delay of the network."""
        return self._age_s(self.t_publish_ns)

    def _age_s(self, then_ns: int) -> float:
        if self.clock_ahead_s is None:
            return math.inf
        return (time.monotonic_ns() - then_ns) * 1e-9 - self.clock_ahead_s


@dataclass(frozen=True)
class Event:
    """A change. kind: as docs/messages.md lists them, or a new word of a later daemon."""

    v: int
    pad: str
    boot: str
    t_ns: int
    utc_ns: int
    kind: str
    detail: str

    @classmethod
    def from_message(cls, message: dict[str, Any]) -> Event:
        check_version(message)
        return parse(cls, message)


@dataclass(frozen=True)
class Status:
    """The state of a pad's pipeline, sent once a second."""

    v: int
    pad: str
    boot: str
    t_publish_ns: int
    utc_ns: int
    health: str
    reason: str
    since_ns: int
    source: str
    connected: bool
    rate_hz: float
    rate_nominal_hz: float
    frames: int
    dropped: int
    repeated: int
    gaps: int
    crc_errors: int
    garbage_bytes: int
    reconnects: int
    latency_p50_s: Optional[float]
    latency_p99_s: Optional[float]
    latency_max_s: Optional[float]
    temperature_c: Optional[float]
    ambient_t: Optional[Vector]
    gains_from: Optional[str]
    remanence_t: Optional[float]
    rest_drift_m: Optional[float]
    sensor_faults: tuple[str, ...]
    board: dict[str, Any]
    uptime_s: float
    force_scale: Optional[float] = field(default=None, metadata=MAY_BE_MISSING)  # of old versions, and of the next one
    force_scale_sd: Optional[float] = field(default=None, metadata=MAY_BE_MISSING)

    @classmethod
    def from_message(cls, message: dict[str, Any]) -> Status:
        check_version(message)
        return parse(cls, message)
