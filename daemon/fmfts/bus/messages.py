"""Defines the messages that the daemon publishes. docs/messages.md explains every field; fmfts_client reads them.

Units are SI and named in the keys. An unknown value is null. NaN and infinity are never encoded.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from operator import attrgetter
from typing import Any, Literal

import msgspec

from fmfts_client.fields import SCHEMA_VERSION

Health = Literal["ok", "degraded", "disturbed", "lost", "stale", "disconnected", "no_baseline"]
Solver = Literal["c", "numpy"]
EventKind = Literal["onset", "release", "over_range", "health", "baseline"]
Vector = tuple[float, float, float]


class NotFiniteError(ValueError):
    """A message contains NaN or infinity; the text names the field."""


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


class ContactMessage(_Message, frozen=True, kw_only=True):
    """`contact/<pad>`: one per frame, and at least ten a second while the source is silent.

    Of a pad with several magnets place, force and shear are the resultant of its `contacts`, and `pose` is null. A pad
    with one magnet leaves `contacts`, `more` and `poses` out, so that its messages are as short as ever, and the same.
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
    pose: PoseMessage | None
    poses: list[PoseMessage] | msgspec.UnsetType | None = msgspec.UNSET
    sensors_ok: int
    solver: Solver
    model: str
    baseline: str | None


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
    solver: Solver
    baseline: dict[str, Any] | None
    memory: bytes


AnyMessage = ContactMessage | EventMessage | StatusMessage | FrameMessage | EarlyMessage | StateMessage


def _plain(value: Any) -> Any:
    """Converts a NumPy scalar to Python's float or int, for msgspec's encoder."""
    if hasattr(value, "item"):
        return value.item()
    raise NotImplementedError(f"a message cannot contain a {type(value).__name__}")


_encoder = msgspec.msgpack.Encoder(enc_hook=_plain)
_contact_decoder = msgspec.msgpack.Decoder(ContactMessage)


def encode(message: AnyMessage) -> bytes:
    """The msgpack map of `message`. Raises NotFiniteError, which names the field, for any NaN or infinity."""
    if not _numbers_are_finite(message):
        field = not_finite_field(message)
        raise NotFiniteError(f"pad {message.pad!r}: {type(message).__name__}.{field} is not a finite number")
    return _encoder.encode(message)


def decode_contact(payload: bytes) -> ContactMessage:
    """The ContactMessage of a msgpack map: the inverse of `encode`."""
    return _contact_decoder.decode(payload)


def encode_facts(facts: dict[str, Any]) -> bytes:
    """The msgpack map of free-form facts (an answer of the control socket). Raises NotFiniteError."""
    field = not_finite_field(facts)
    if field:
        raise NotFiniteError(f"{field} is not a finite number")
    return _encoder.encode(facts)


def without_estimate(message: ContactMessage, **changes: Any) -> ContactMessage:
    """`message` without what was estimated, and with `changes`. It keeps the keys of its kind of pad."""
    nothing: dict[str, Any] = dict(NO_ESTIMATE if message.contacts is msgspec.UNSET else NO_ESTIMATE_OF_SEVERAL)
    return msgspec.structs.replace(message, **(nothing | changes))


def not_finite_field(value: object, path: str = "") -> str:
    """Path of the first NaN or infinity in a message, map or list; "" where there is none."""
    if isinstance(value, float):
        return "" if math.isfinite(value) else path or "value"
    children: Any = ()
    if isinstance(value, msgspec.Struct):
        children = ((name, getattr(value, name)) for name in value.__struct_fields__)
    elif isinstance(value, dict):
        children = value.items()
    elif isinstance(value, list | tuple):
        children = enumerate(value)
    fields = (not_finite_field(child, f"{path}.{name}" if path else str(name)) for name, child in children)
    return next(filter(None, fields), "")


def _getter(kind: type[msgspec.Struct], item: str) -> Callable[[Any], tuple[Any, ...]]:
    """A function that gets, in one call, all fields of `kind` annotated as `item` or `item | None`."""
    names = [name for name, hint in kind.__annotations__.items() if hint in (item, f"{item} | None")]
    getter: Callable[[Any], tuple[Any, ...]] = attrgetter(*names)
    return getter


_contact_numbers = _getter(ContactMessage, "float")
_pose_numbers = _getter(PoseMessage, "float")
_pose_vectors = _getter(PoseMessage, "Vector")
_now_numbers = _getter(NowMessage, "float")
_finger_numbers = _getter(FingerMessage, "float")


def _numbers_are_finite(message: AnyMessage) -> bool:
    """Fast for contacts, which are frequent: one sum of all numbers, which is finite only if all its terms are."""
    if not isinstance(message, ContactMessage):
        return not not_finite_field(message)
    total = sum(filter(None, _contact_numbers(message)))
    if (now := message.now) is not None:
        total += sum(filter(None, _now_numbers(now)))
    if (pose := message.pose) is not None:
        total += _sum_of_pose(pose)
    if message.contacts:  # neither unset nor null nor empty
        total += sum(sum(filter(None, _finger_numbers(finger))) for finger in message.contacts)
    if message.poses:
        total += sum(map(_sum_of_pose, message.poses))
    return math.isfinite(total)


def _sum_of_pose(pose: PoseMessage) -> float:
    total: float = sum(_pose_numbers(pose))
    for vector in filter(None, _pose_vectors(pose)):
        total += sum(vector)
    return total
