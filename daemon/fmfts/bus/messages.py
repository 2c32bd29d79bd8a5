"""Defines the messages that the daemon publishes. docs/messages.md explains every field; fmfts_client reads them.

Units are SI and named in the keys. An unknown value is null. encoding.py never encodes NaN and infinity.
"""

from __future__ import annotations

from typing import Any, Literal

import msgspec

from fmfts_client.fields import SCHEMA_VERSION

Health = Literal["ok", "degraded", "disturbed", "lost", "stale", "disconnected", "no_baseline"]
EventKind = Literal["onset", "release", "over_range", "health", "overload", "rejected", "baseline", "slip", "stick"]
Vector = tuple[float, float, float]


class _Message(msgspec.Struct, frozen=True, kw_only=True):
    """Fields of every message: schema version, pad, and a random word for each start of the daemon (`boot`)."""

    v: int = SCHEMA_VERSION
    pad: str
    boot: str


class PoseMessage(msgspec.Struct, frozen=True, kw_only=True):
    """A magnet's pose in a ContactMessage."""

    position_m: Vector
    position_sd_m: Vector
    axis: Vector
    axis_sd_rad: float
    remanence_t: float
    remanence_sd_t: float
    ambient_t: Vector | None
    ambient_sd_t: Vector | None
    residual_t: float
    chi2: float


class FingerMessage(msgspec.Struct, frozen=True, kw_only=True):
    """One finger on a pad with several magnets, in a ContactMessage. `id` stays the same while the finger stays."""

    id: int
    x_m: float
    x_sd_m: float
    y_m: float
    y_sd_m: float
    force_n: float
    force_sd_n: float
    shear_x_n: float | None
    shear_x_sd_n: float | None
    shear_y_n: float | None
    shear_y_sd_n: float | None


class NowMessage(msgspec.Struct, frozen=True, kw_only=True):
    """The contact at the time of publishing, and how it goes on, in a ContactMessage."""

    t_ns: int
    x_m: float | None
    x_sd_m: float | None
    x_rate_m_per_s: float | None
    x_rate_sd_m_per_s: float | None
    y_m: float | None
    y_sd_m: float | None
    y_rate_m_per_s: float | None
    y_rate_sd_m_per_s: float | None
    force_n: float
    force_sd_n: float
    force_rate_n_per_s: float
    force_rate_sd_n_per_s: float
    shear_x_n: float | None
    shear_x_sd_n: float | None
    shear_x_rate_n_per_s: float | None
    shear_x_rate_sd_n_per_s: float | None
    shear_y_n: float | None
    shear_y_sd_n: float | None
    shear_y_rate_n_per_s: float | None
    shear_y_rate_sd_n_per_s: float | None


class KnownJoints(msgspec.Struct, frozen=True, kw_only=True):
    """The newest positions of a hand's joints and the ones before, in a FrameMessage, in the baseline's order."""

    t_ns: int | None
    position_rad: list[float]
    before_ns: int | None
    before_rad: list[float]


class JointsMessage(msgspec.Struct, frozen=True, kw_only=True):
    """`joints`: a hand's joint positions, from another program. t_ns: on this computer's CLOCK_MONOTONIC; null: as it
    arrives."""

    v: int
    t_ns: int | None
    names: list[str]
    position_rad: list[float]


class SlipMessage(msgspec.Struct, frozen=True, kw_only=True):
    """Whether the finger slips over the silicone, in a ContactMessage. Never null, so that a recording keeps it."""

    slipping: bool | None = None
    sticking_probability: float | None = None
    speed_m_per_s: float | None = None
    speed_sd_m_per_s: float | None = None
    direction_rad: float | None = None
    direction_sd_rad: float | None = None
    friction: float | None = None
    friction_sd: float | None = None
    margin_n: float | None = None
    margin_sd_n: float | None = None


class ContactMessage(_Message, frozen=True, kw_only=True):
    """`contact/<pad>`: one per frame, and at least ten a second while the source is silent.

    Of a pad with several magnets place, force and shear are the resultant of its `contacts`, and `pose` is null. A pad
    with one magnet omits `contacts`, `more` and `poses`, and a pad without `slip` omits that key, so that old messages
    stay the same.
    """

    seq: int
    t_sample_ns: int
    t_publish_ns: int
    utc_ns: int
    temperature_c: float | None
    health: Health
    reason: str
    contact: bool | None
    x_m: float | None
    x_sd_m: float | None
    y_m: float | None
    y_sd_m: float | None
    force_n: float | None
    force_sd_n: float | None
    shear_x_n: float | None
    shear_x_sd_n: float | None
    shear_y_n: float | None
    shear_y_sd_n: float | None
    over_range: bool
    force_min_n: float | None
    displacement_m: float | None = None
    displacement_sd_m: float | None = None
    contacts: list[FingerMessage] | msgspec.UnsetType | None = msgspec.UNSET
    more: bool | msgspec.UnsetType = msgspec.UNSET
    now: NowMessage | None = None
    slip: SlipMessage | msgspec.UnsetType = msgspec.UNSET
    pose: PoseMessage | None
    poses: list[PoseMessage] | msgspec.UnsetType | None = msgspec.UNSET
    sensors_ok: int
    model: str
    baseline: str | None

    @property
    def slipping(self) -> bool:
        """Whether it says that a finger slips."""
        return isinstance(self.slip, SlipMessage) and self.slip.slipping is True

    @property
    def ambient_t(self) -> Vector | None:
        """The field that is not the pad's own, as its pose has it, or the pose of the first magnet."""
        pose = self.poses[0] if isinstance(self.poses, list) and self.poses else self.pose
        return None if pose is None else pose.ambient_t


NO_ESTIMATE: dict[str, None] = dict.fromkeys(
    (
        *("contact", "x_m", "x_sd_m", "y_m", "y_sd_m", "force_n", "force_sd_n"),
        *("shear_x_n", "shear_x_sd_n", "shear_y_n", "shear_y_sd_n", "force_min_n"),
        *("displacement_m", "displacement_sd_m", "now", "pose"),
    )
)
# The same of a pad with several magnets.
NO_ESTIMATE_OF_SEVERAL: dict[str, bool | None] = {
    **NO_ESTIMATE,
    "contacts": None,
    "more": False,
    "poses": None,
}


class EventMessage(_Message, frozen=True, kw_only=True):
    """`event/<pad>`: sent when something changes."""

    t_ns: int
    utc_ns: int
    kind: EventKind
    detail: str


class StatusMessage(_Message, frozen=True, kw_only=True):
    """`status/<pad>`: sent once a second."""

    t_publish_ns: int
    utc_ns: int
    health: Health
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
    latency_p50_s: float | None
    latency_p99_s: float | None
    latency_max_s: float | None
    temperature_c: float | None
    ambient_t: Vector | None
    gains_from: Literal["tolerance", "selftest", "turn"] | None
    remanence_t: float | None
    rest_drift_m: float | None
    force_scale: float | None = None  # reports of old versions lack it, and the next one
    force_scale_sd: float | None = None
    sensor_faults: list[str]
    board: dict[str, Any]
    uptime_s: float


class FrameMessage(_Message, frozen=True, kw_only=True):
    """`frame/<pad>`: one frame in raw counts, with all that a recording needs; sent while a client subscribes."""

    sequence: int
    device_time_us: int
    host_time_ns: int
    utc_ns: int
    gain_code: int
    counts: list[tuple[int, int, int]]
    age_us: list[int]
    fresh: list[bool]
    valid: list[bool]
    temperature_c: float | None
    used: bool
    # Of a pad with several magnets; left out where it is true.
    may_search: bool | msgspec.UnsetType = msgspec.UNSET
    # For a pad on a hand that moves: the joints that its pipeline used. Other pads omit it.
    joints: KnownJoints | msgspec.UnsetType = msgspec.UNSET


class EarlyMessage(_Message, frozen=True, kw_only=True):
    """`early/<pad>`: one sensor's sample that came before its frame; sent while a client subscribes to frames."""

    sensor: int
    device_time_us: int
    utc_ns: int
    gain_code: int
    counts: tuple[int, int, int]


class StateMessage(_Message, frozen=True, kw_only=True):
    """`state/<pad>`: the state from which a replay of the following frames starts.

    Sent on the socket of frames, before the first frame after a subscription and after each change of the baseline.
    """

    utc_ns: int
    config: dict[str, Any]
    model: str
    baseline: dict[str, Any] | None
    memory: bytes


AnyMessage = ContactMessage | EventMessage | StatusMessage | FrameMessage | EarlyMessage | StateMessage


def without_estimate(message: ContactMessage, **changes: Any) -> ContactMessage:
    """`message` without what was estimated, and with `changes`. It keeps the keys of its kind of pad."""
    nothing: dict[str, Any] = dict(NO_ESTIMATE if message.contacts is msgspec.UNSET else NO_ESTIMATE_OF_SEVERAL)
    if message.slip is not msgspec.UNSET:
        nothing["slip"] = SlipMessage()
    return msgspec.structs.replace(message, **(nothing | changes))
