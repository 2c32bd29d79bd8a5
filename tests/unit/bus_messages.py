"""Messages for the tests of bus, client and view: plausible ones, made with few words."""

from __future__ import annotations

import time
from typing import Any

import zmq

from fmfts.bus.messages import (
    ContactMessage,
    EventMessage,
    FingerMessage,
    FrameMessage,
    NowMessage,
    PoseMessage,
    StatusMessage,
)

BOOT = "b00t"


def settle(endpoint: str) -> None:
    """Wait until the sent messages have arrived: ZeroMQ's single thread needs more steps for there and back than for
    one way."""
    context = zmq.Context.instance()
    with context.socket(zmq.PAIR) as here, context.socket(zmq.PAIR) as there:
        here.bind(endpoint)
        there.connect(endpoint)
        for one, other in 5 * [(here, there), (there, here)]:
            one.send(b"")
            other.recv()


def pose_message(**changes: Any) -> PoseMessage:
    values: dict[str, Any] = {
        "position_m": (0.0005, 0.0003, 0.0105),
        "position_sd_m": (9.7e-6, 9.5e-6, 3.2e-6),
        "axis": (0.1, 0.05, 0.99372),
        "axis_sd_rad": 0.0022,
        "remanence_t": 1.23,
        "remanence_sd_t": 0.01,
        "ambient_t": (1e-6, 0.0, 0.0),
        "ambient_sd_t": (1e-7, 1e-7, 1e-7),
        "residual_t": 2e-7,
        "chi2": 3.9,
    }
    return PoseMessage(**(values | changes))


def contact_message(**changes: Any) -> ContactMessage:
    """A touch of 1.5 N at (5, 3) mm, sampled 1 ms before now."""
    now_ns = time.monotonic_ns()
    values: dict[str, Any] = {
        "pad": "demo",
        "boot": BOOT,
        "seq": 1,
        "t_sample_ns": now_ns - 1_000_000,
        "t_publish_ns": now_ns,
        "utc_ns": time.time_ns(),
        "temperature_c": 25.5,
        "health": "ok",
        "reason": "",
        "contact": True,
        "x_m": 0.005,
        "x_sd_m": 0.0002,
        "y_m": 0.003,
        "y_sd_m": 0.0002,
        "force_n": 1.5,
        "force_sd_n": 0.05,
        "shear_x_n": None,
        "shear_x_sd_n": None,
        "shear_y_n": None,
        "shear_y_sd_n": None,
        "over_range": False,
        "force_min_n": None,
        "displacement_m": None,
        "displacement_sd_m": None,
        "now": now_message(1_000_000_000),
        "pose": pose_message(),
        "sensors_ok": 0b1111,
        "model": "0123456789ab",
        "baseline": "2025-01-01T00:00:00Z-abcd",
    }
    return ContactMessage(**(values | changes))


def finger_message(number: int, **changes: Any) -> FingerMessage:
    """A finger of 0.6 N at (−4, 2) mm, without shear."""
    values: dict[str, Any] = dict.fromkeys(FingerMessage.__struct_fields__) | {
        "id": number,
        "x_m": -0.004,
        "x_sd_m": 0.0003,
        "y_m": 0.002,
        "y_sd_m": 0.0004,
        "force_n": 0.6,
        "force_sd_n": 0.04,
    }
    return FingerMessage(**(values | changes))


def fingers_message(*fingers: FingerMessage, **changes: Any) -> ContactMessage:
    """A message of a pad with two magnets, with these fingers and their resultant."""
    poses = [pose_message(position_m=(x_m, 0.0, 0.0104)) for x_m in (-0.006, 0.006)]
    values: dict[str, Any] = {"contacts": list(fingers), "more": False, "pose": None, "poses": poses, "model": "none"}
    return contact_message(**(values | _resultant(fingers) | changes))


def two_fingers() -> tuple[FingerMessage, FingerMessage]:
    """0.6 N at (−4, 2) mm, and 0.9 N at (6, −1) mm with shear along x."""
    shear = {"shear_x_n": 0.1, "shear_x_sd_n": 0.02, "shear_y_n": 0.0, "shear_y_sd_n": 0.03}
    return finger_message(3), finger_message(4, x_m=0.006, y_m=-0.001, force_n=0.9, **shear)


def _resultant(fingers: tuple[FingerMessage, ...]) -> dict[str, Any]:
    if not fingers:
        nowhere = dict.fromkeys(("x_m", "x_sd_m", "y_m", "y_sd_m"))
        return {"contact": False, "force_n": 0.0, "now": None} | nowhere
    force_n = sum(finger.force_n for finger in fingers)
    x_m = sum(finger.force_n * finger.x_m for finger in fingers) / force_n
    y_m = sum(finger.force_n * finger.y_m for finger in fingers) / force_n
    return {"contact": True, "force_n": force_n, "x_m": x_m, "y_m": y_m, "now": None}


def now_message(t_ns: int, **changes: Any) -> NowMessage:
    """A touch of 1.5 N that grows by 2 N/s and moves along x by 10 mm/s."""
    values: dict[str, Any] = dict.fromkeys(NowMessage.__struct_fields__) | {
        "t_ns": t_ns,
        "x_m": 0.005,
        "x_sd_m": 0.0002,
        "x_rate_m_per_s": 0.01,
        "x_rate_sd_m_per_s": 0.02,
        "y_m": 0.003,
        "y_sd_m": 0.0002,
        "y_rate_m_per_s": 0.0,
        "y_rate_sd_m_per_s": 0.02,
        "force_n": 1.51,
        "force_sd_n": 0.05,
        "force_rate_n_per_s": 2.0,
        "force_rate_sd_n_per_s": 5.0,
    }
    return NowMessage(**(values | changes))


def status_message(**changes: Any) -> StatusMessage:
    values: dict[str, Any] = {
        "pad": "demo",
        "boot": BOOT,
        "t_publish_ns": time.monotonic_ns(),
        "utc_ns": time.time_ns(),
        "health": "ok",
        "reason": "",
        "since_ns": 1,
        "source": "simulated pad",
        "connected": True,
        "rate_hz": 219.6,
        "rate_nominal_hz": 220.0,
        "frames": 1000,
        "dropped": 1,
        "repeated": 0,
        "gaps": 2,
        "crc_errors": 3,
        "garbage_bytes": 17,
        "reconnects": 4,
        "latency_p50_s": 0.0005,
        "latency_p99_s": 0.001,
        "latency_max_s": 0.002,
        "temperature_c": 25.5,
        "ambient_t": (1e-5, 0.0, 4e-5),
        "gains_from": "selftest",
        "remanence_t": 1.23,
        "rest_drift_m": None,
        "force_scale_sd": 0.23,
        "sensor_faults": [],
        "board": {"firmware": "0.1.0"},
        "uptime_s": 4.5,
    }
    return StatusMessage(**(values | changes))


def event_message(**changes: Any) -> EventMessage:
    values: dict[str, Any] = {
        "pad": "demo",
        "boot": BOOT,
        "t_ns": time.monotonic_ns(),
        "utc_ns": time.time_ns(),
        "kind": "onset",
        "detail": "1.5 N",
    }
    return EventMessage(**(values | changes))


def frame_message(sequence: int = 0) -> FrameMessage:
    return FrameMessage(
        pad="demo",
        boot=BOOT,
        sequence=sequence,
        device_time_us=4545 * sequence,
        host_time_ns=time.monotonic_ns(),
        utc_ns=time.time_ns(),
        gain_code=3,
        counts=[(1, -2, 3), (4, 5, -4096), (7, 8, 9), (-10, 11, 12)],
        age_us=[0, 10, 20, 65535],
        fresh=[True, True, False, True],
        valid=[True, True, True, False],
        temperature_c=None,
        used=True,
    )
