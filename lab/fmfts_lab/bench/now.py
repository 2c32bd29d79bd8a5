"""How wrong a contact is when it is published, and when a controller reads it: today's fields beside `now`.

Six built pads with real baselines, robots that turn, chips that run free, and motions drawn by a seed. A controller
reads a thousand times a second what was published last.
"""

from __future__ import annotations

import json
from argparse import Namespace
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from fmfts.bus.messages import ContactMessage
from fmfts.pad import Array
from fmfts.pipeline.encoded import message_of
from fmfts.sensor.early import EarlySample
from fmfts_lab.bench import now_faults
from fmfts_lab.bench.motions import DRAWN, Draw, Motion
from fmfts_lab.bench.now_ablation import VARIANTS, changed
from fmfts_lab.bench.now_pads import BEFORE_S, EARLY_S, TRANSPORT_S, BuiltPad, drawn, published_s, read_s

WRONG_DEVIATIONS = 5.0
VALUES = ("x_m", "y_m", "force_n")
DEVIATIONS = ("x_sd_m", "y_sd_m", "force_sd_n")
RATES = ("x_rate_m_per_s", "y_rate_m_per_s", "force_rate_n_per_s")


@dataclass(slots=True)
class Run:
    """One pad under one motion: K messages. published_s (K,). sampled_s (K,): of today's fields. now_s (K,): of `now`.

    today, now, now_sd, rate (K, 3): x, y (m), force (N), and per second; NaN where they are null.
    """

    motion: Motion
    published_s: Array
    sampled_s: Array
    now_s: Array
    today: Array
    now: Array
    now_sd: Array
    rate: Array

    @classmethod
    def of(cls, motion: Motion, published: Array, messages: Sequence[ContactMessage]) -> Run:
        sampled = np.array([message.t_sample_ns for message in messages]) * 1e-9 - BEFORE_S
        of_now = [message.now for message in messages]
        times = [np.nan if now is None else now.t_ns * 1e-9 - BEFORE_S for now in of_now]
        return cls(
            *(motion, published, sampled, np.array(times)),
            today=_columns(messages, VALUES),
            now=_columns(of_now, VALUES),
            now_sd=_columns(of_now, DEVIATIONS),
            rate=_columns(of_now, RATES),
        )


def _columns(messages: Sequence[object], names: Sequence[str]) -> Array:
    rows = [[getattr(message, name, None) for name in names] for message in messages]
    return np.array([[np.nan if value is None else value for value in row] for row in rows])


@dataclass(slots=True)
class Errors:
    """The errors of one motion, over all pads. Force in N, place in mm; each list holds arrays."""

    own: list[Array] = field(default_factory=list)
    today: list[Array] = field(default_factory=list)
    now: list[Array] = field(default_factory=list)
    read_today: list[Array] = field(default_factory=list)
    read_held: list[Array] = field(default_factory=list)
    read_carried: list[Array] = field(default_factory=list)
    place_today: list[Array] = field(default_factory=list)
    place_now: list[Array] = field(default_factory=list)
    deviations: list[Array] = field(default_factory=list)
    overshoot: list[float] = field(default_factory=list)
    ratios: list[float] = field(default_factory=list)
    frames: int = 0
    withheld: int = 0
    negative: int = 0

    def add(self, run: Run) -> None:
        at_publishing, counted = run.motion.truth(run.published_s), run.motion.counts(run.published_s)
        known = counted & np.isfinite(run.now_s)
        self.frames += int(counted.sum())
        self.withheld += int((counted & ~known).sum())
        self.negative += int((run.now[known, 2] < 0.0).sum())
        self.own.append((run.today - run.motion.truth(run.sampled_s))[run.motion.counts(run.sampled_s), 2])
        today, now = (run.today - at_publishing)[counted], (run.now - at_publishing)[known]
        self.today.append(today[:, 2])
        # Where `now` is null a controller has only today's fields.
        instead = np.where(np.isfinite(run.now[:, 2]), run.now[:, 2], run.today[:, 2])
        self.now.append((instead - at_publishing[:, 2])[counted])
        self.ratios.append(ratio([self.now[-1]], [today[:, 2]]))
        self.place_today.append(1e3 * np.hypot(today[:, 0], today[:, 1]))
        self.place_now.append(1e3 * np.hypot(now[:, 0], now[:, 1]))
        off = np.abs(run.now - run.motion.truth(np.nan_to_num(run.now_s))) / run.now_sd
        self.deviations.append(np.nanmax(np.where(np.isfinite(off), off, 0.0), axis=1)[known])
        self._read(run)
        for begin, end in run.motion.windows:
            own = (run.published_s >= begin) & (run.published_s <= end) & known
            if own.any():
                peak = run.motion.truth(np.arange(begin, end, 1e-3))[:, 2].max()
                self.overshoot.append(float((run.now[own, 2] - peak).max()))

    def _read(self, run: Run) -> None:
        moments, last = read_s(run.motion, run.published_s)
        truth = run.motion.truth(moments)[:, 2]
        today, now = run.today[last, 2], run.now[last, 2]
        ahead = np.maximum(now + run.rate[last, 2] * (moments - run.now_s[last]), 0.0)
        self.read_today.append(today - truth)
        self.read_held.append(np.where(np.isfinite(now), now, today) - truth)
        self.read_carried.append(np.where(np.isfinite(ahead), ahead, today) - truth)

    def facts(self) -> dict[str, Any]:
        places = {"place_today_mm": rms(self.place_today), "place_now_mm": rms(self.place_now)}
        off = np.concatenate(self.deviations)
        return {
            "own_n": rms(self.own),
            "today_n": rms(self.today),
            "now_n": rms(self.now),
            "ratio": ratio(self.now, self.today),
            "ratio_least": min(self.ratios),
            "ratio_most": max(self.ratios),
            "read_today_n": rms(self.read_today),
            "read_held_n": rms(self.read_held),
            "read_carried_n": rms(self.read_carried),
            **places,
            "overshoot_p95_n": float(np.percentile(self.overshoot, 95)) if self.overshoot else None,
            "wrong": int((off > WRONG_DEVIATIONS).sum()),
            "wrong_share": float(np.mean(off > WRONG_DEVIATIONS)),
            "rms_deviations": rms(self.deviations),
            "negative": self.negative,
            "withheld_share": self.withheld / self.frames,
            "frames": self.frames,
        }


def rms(parts: Sequence[Array]) -> float:
    """The root mean square of all finite numbers; NaN without any."""
    values = np.concatenate(parts)
    values = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(values * values))) if values.size else float("nan")


def ratio(now: Sequence[Array], today: Sequence[Array]) -> float:
    """The ratio of two errors; 1 if both are 0: an untouched pad publishes 0 N."""
    now_n, today_n = rms(now), rms(today)
    return 1.0 if now_n == today_n else now_n / today_n if today_n > 0.0 else float("inf")


def measure(
    seed: int, pads: int, seconds: float, draws: Sequence[Draw] = DRAWN, early: bool = False
) -> dict[str, Errors]:
    """Every motion on every pad. The same seed draws the same pads and motions. early: samples as they come."""
    errors = dict[str, Errors]()
    for config, motions in drawn(seed, pads, seconds, draws):
        pad = BuiltPad.of(config)
        for motion in motions:
            run = Run.of(motion, *(_early_messages if early else _messages)(pad, motion, seconds))
            errors.setdefault(motion.name, Errors()).add(run)
    return errors


def _messages(pad: BuiltPad, motion: Motion, seconds: float) -> tuple[Array, list[ContactMessage]]:
    """The times at which messages are published, and the messages."""
    pipeline = pad.pipeline()
    messages = [message_of(pipeline.answer(frame)) for frame in pad.frames(motion, seconds)]
    return published_s(len(messages)), messages


def _early_messages(pad: BuiltPad, motion: Motion, seconds: float) -> tuple[Array, list[ContactMessage]]:
    pipeline, published, messages = pad.pipeline(), list[float](), list[ContactMessage]()
    for at_s, packet in pad.packets(motion, seconds):
        answer = pipeline.early(packet) if isinstance(packet, EarlySample) else pipeline.answer(packet)
        if answer is not None:
            published.append(at_s - BEFORE_S)
            messages.append(message_of(answer))
    return np.array(published), messages


HEADER = """\
                  ----- force, rms N -----   over today's    - read at 1 kHz, N -   place, mm    over- >5sd errors null
motion             own   today   now  ratio  least–most  today  held  carried  today   now   shoot    %  in sd    %"""


def run_ablation(options: Namespace) -> None:
    """Error at publishing over today's, for each variant and motion."""
    for variant in VARIANTS:
        with changed(variant):
            found = {name: one.facts() for name, one in measure(options.seed, options.pads, options.seconds).items()}
        if variant == next(iter(VARIANTS)):
            print("error of force over today's; place: of slide 100 mm/s; p95 of overshoot in N")
            print(" " * 24 + " ".join(f"{name.replace(' mm/s', '').replace(' in', ''):>9.9}" for name in found))
        slid, tapped = found["slide 100 mm/s"], found["tap in 50 ms"]
        ratios = " ".join(f"{fact['ratio']:9.2f}" for fact in found.values())
        place = slid["place_now_mm"] / slid["place_today_mm"]
        print(f"{variant:23} {ratios}  place {place:.2f}  over {tapped['overshoot_p95_n']:.3f}", flush=True)


def run(options: Namespace) -> None:
    if options.ablation:
        run_ablation(options)
        return
    facts = {name: errors.facts() for name, errors in _measured(options).items()}
    of_samples = f", and {EARLY_S * 1e3:.2f} ms after a sample is taken" if options.samples else ""
    print(
        f"{options.pads} built pads, seed {options.seed}; "
        f"published {TRANSPORT_S * 1e3:.2f} ms after a frame is made{of_samples}"
    )
    print(HEADER)
    for name, fact in facts.items():
        print(told_line(name, fact))
    told = now_faults.drilled(range(1, 1 + options.drilled), options.samples)
    if told:
        print(f"a sensor begins to fail, {options.drilled} pads\n{now_faults.HEADER}")
    for one in told:
        print(one.line)
    if options.out is not None:
        options.out.write_text(json.dumps(facts, indent=1) + "\n")


def _measured(options: Namespace) -> dict[str, Errors]:
    return measure(options.seed, options.pads, options.seconds, early=options.samples)


def told_line(name: str, fact: dict[str, Any]) -> str:
    force = f"{fact['own_n']:6.4f} {fact['today_n']:6.4f} {fact['now_n']:6.4f}"
    ratio = f"{fact['ratio']:5.2f}   {fact['ratio_least']:.2f}–{fact['ratio_most']:.2f}"
    read = f"{fact['read_today_n']:6.4f} {fact['read_held_n']:6.4f} {fact['read_carried_n']:6.4f}"
    place = f"{fact['place_today_mm']:6.3f} {fact['place_now_mm']:6.3f}"
    rest = f"{fact['overshoot_p95_n']:6.3f} {100 * fact['wrong_share']:5.2f} {fact['rms_deviations']:5.2f}"
    return f"{name:16}  {force}  {ratio}  {read} {place} {rest} {100 * fact['withheld_share']:6.2f}"
