"""Judges what was published under load against what was written to the ptys, frame by frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import msgspec
import numpy as np
from numpy.typing import NDArray

from fmfts_lab.bench import latency_rig as rig
from fmfts_lab.bench.overload_rig import Written

STALE_NS = 100_000_000  # an `ok` message must never describe an older frame
FALSE_NS = 10_000_000  # `t_sample_ns` is wrong if it differs this much from the frame's own time
CALM_NS = 20_000_000  # the daemon has recovered when every pad's frames are this new
PAUSE_NS = 50_000_000  # and no pause is longer than this

Heard = tuple[bytes, int, bytes]  # topic, arrival, payload


@dataclass
class Verdict:
    """About the load's time, ages in ns: frames written and published, by pad (pads,); ages at publishing and arrival.

    stale_ok: messages `ok` that speak of a frame older than STALE_NS when published. false_times: messages `ok` since
    the load began whose t_sample_ns is false. calm_after_s: from the end of the load; None: not within the run.
    """

    written: NDArray[np.int64]
    published: NDArray[np.int64]
    age_ns: NDArray[np.int64]
    arrival_age_ns: NDArray[np.int64]
    stale_ok: int = 0
    false_times: int = 0
    calm_after_s: float | None = None
    healths: dict[str, int] = field(default_factory=dict)

    @property
    def share(self) -> float:
        return float(self.published.sum() / max(self.written.sum(), 1))

    @property
    def unevenness(self) -> float:
        """Largest over smallest share of frames published, over the pads."""
        shares = self.published / np.maximum(self.written, 1)
        return float(shares.max() / shares.min()) if shares.min() > 0.0 else float("inf")


@dataclass
class _Message:
    pad: int
    frame: int
    health: str
    published_ns: int
    arrived_ns: int
    sampled_ns: int


def judge(heard: Sequence[Heard], written: Written) -> Verdict:
    found: list[_Message] = []
    healths: dict[str, int] = {}
    for topic, arrived_ns, payload in heard:
        message = msgspec.msgpack.decode(payload)
        if written.load_ns[0] <= arrived_ns < written.load_ns[1]:
            healths[message["health"]] = healths.get(message["health"], 0) + 1
        if message["temperature_c"] is None:
            continue
        pad = int(topic.removeprefix(b"contact/p"))
        frame = round((message["temperature_c"] - rig.ROOM_C) * rig.RAW_PER_K)
        times = message["t_publish_ns"], arrived_ns, message["t_sample_ns"]
        found.append(_Message(pad, frame, message["health"], *times))
    begin_ns, end_ns = written.load_ns
    at_ns = written.written_ns
    in_load = (at_ns >= begin_ns) & (at_ns < end_ns)
    published = np.zeros(at_ns.shape, dtype=np.bool_)
    for one in found:
        published[one.pad, one.frame] = True
    judged = [one for one in found if in_load[one.pad, one.frame]]
    ages = np.array([one.published_ns - at_ns[one.pad, one.frame] for one in judged], dtype=np.int64)
    arrivals = np.array([one.arrived_ns - at_ns[one.pad, one.frame] for one in judged], dtype=np.int64)
    verdict = Verdict(in_load.sum(axis=1), (published & in_load).sum(axis=1), ages, arrivals, healths=healths)
    ages_of_samples = [written.due_ns[one.pad, one.frame] - one.sampled_ns for one in found]
    usual_ns = int(np.median(ages_of_samples)) if ages_of_samples else 0
    for one in found:
        if one.health == "ok":
            written_ns = int(at_ns[one.pad, one.frame])
            verdict.stale_ok += one.published_ns - written_ns > STALE_NS
            due_ns = int(written.due_ns[one.pad, one.frame])
            is_false = abs(due_ns - usual_ns - one.sampled_ns) > FALSE_NS
            verdict.false_times += is_false and one.published_ns >= begin_ns
    verdict.calm_after_s = _calm_after_s(found, at_ns, end_ns)
    return verdict


def _calm_after_s(found: Sequence[_Message], at_ns: NDArray[np.int64], end_ns: int) -> float | None:
    """The time after the load from which every pad's messages were new and without a pause."""
    last_bad_ns, last_ns = end_ns, int(at_ns.max())
    for pad in range(len(at_ns)):
        own = [one for one in found if one.pad == pad and one.published_ns >= end_ns - PAUSE_NS and one.health == "ok"]
        times = np.array([max(one.published_ns, end_ns) for one in own] + [last_ns])
        for one in own:
            if one.published_ns - at_ns[one.pad, one.frame] > CALM_NS:
                last_bad_ns = max(last_bad_ns, one.published_ns)
        pauses = np.flatnonzero(np.diff(np.concatenate([[end_ns], times])) > PAUSE_NS)
        if pauses.size:
            last_bad_ns = max(last_bad_ns, int(times[pauses[-1]]))
    return None if last_bad_ns >= last_ns - PAUSE_NS else (last_bad_ns - end_ns) * 1e-9


def judge_echo(heard: Sequence[Heard], written: Written) -> float:
    """The share of the frames of the load's time that an echo published in it."""
    begin_ns, end_ns = written.load_ns
    count = sum(begin_ns <= arrived_ns < end_ns and len(payload) > 0 for _, arrived_ns, payload in heard)
    in_load = (written.written_ns >= begin_ns) & (written.written_ns < end_ns)
    return float(count / max(in_load.sum(), 1))
