"""The result of one run of the rig: each frame with its message."""

from __future__ import annotations

from dataclasses import dataclass

import msgspec
import numpy as np
from numpy.typing import NDArray

from fmfts_lab.bench import latency_rig as rig

WARM_UP_S = 1.0
Times = NDArray[np.int64]


@dataclass
class Run:
    """Times (frames,) in ns from each frame to its publication and to the subscriber. age_ns: age of its samples then.

    cpu_ns: processor time of each frame, of the main thread and of all others (ZeroMQ's). boards_late_ns: how much too
    late each frame was handed to the pty (late frames come in bursts). lost: frames of `sent` without room on the pty.
    unheard: frames after the warm-up without a message.
    """

    to_publish_ns: Times
    to_subscriber_ns: Times
    age_ns: Times
    boards_late_ns: Times
    cpu_ns: tuple[float, float]
    cpu_share: float
    rss_mb: float
    rss_growth_mb: float
    sent: int
    lost: int
    unheard: int


def measured_from(written_ns: Times) -> int:
    """The time at which the warm-up ends."""
    return int(written_ns.min()) + round(WARM_UP_S * 1e9)


def lateness(written_ns: Times) -> Times:
    """(frames,) how much too late each frame after the warm-up was handed over, from the times of `boards`."""
    pads, frames = written_ns.shape
    due_ns = (np.arange(frames) + np.arange(pads)[:, None] / pads) * 1e9 / rig.RATE_HZ
    behind_ns = written_ns - due_ns
    late: Times = (behind_ns - behind_ns.min())[written_ns >= measured_from(written_ns)].astype(np.int64)
    return late


def matched(messages: list[tuple[bytes, int, bytes]], written_ns: Times, is_echo: bool) -> tuple[Times, Times, Times]:
    """(frames,) for each frame after the warm-up with a message: times to publication and subscriber, and age."""
    rows: dict[tuple[int, int], tuple[int, int, int]] = {}
    start_ns = measured_from(written_ns)
    for topic, arrived_ns, payload in messages:
        if is_echo:
            if not payload:
                continue
            number, published_ns = np.frombuffer(payload[:16], "<i8").tolist()
            sampled_ns = published_ns
        else:
            message = msgspec.msgpack.decode(payload)
            if message["temperature_c"] is None:
                continue
            number = round((message["temperature_c"] - rig.ROOM_C) * rig.RAW_PER_K)
            published_ns, sampled_ns = message["t_publish_ns"], message["t_sample_ns"]
        pad = int(topic.removeprefix(b"contact/p"))
        written = written_ns[pad]
        # The last frame with this number that existed before the message arrived.
        frame = int(np.searchsorted(written, arrived_ns)) - 1
        frame -= (frame - number) % rig.NUMBERS
        if frame >= 0 and written[frame] >= start_ns:
            rows[pad, frame] = (published_ns - written[frame], arrived_ns - written[frame], written[frame] - sampled_ns)
    if not rows:
        raise SystemExit(f"none of {len(messages)} messages was about a frame; the last: {messages[-1:]}")
    publish, arrive, age = np.array(list(rows.values())).T
    return publish, arrive, age
