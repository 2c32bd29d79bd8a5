"""The content of messages, in a small form that is compared by the meaning of its digits.

Of every message: everything but numbers, run-length coded. Of every fiftieth: all numbers; and the mean of each number
over the fifty messages, so that every frame counts.

Tolerance. A number may differ by `OF_A_DEVIATION` of its own published deviation, or by `FLOOR` of its unit, whichever
is more. Two thousandths of a deviation are that much less than the noise from frame to frame; no controller depends on
them, and they are 10⁸ times the effect of another order of sums. The floors are below any reader's resolution: 10 nm,
10 µN, 0.1 nT. A deviation itself may differ by `OF_ITSELF`.

Values that are no numbers may change up to `LONGEST_SHIFT` messages sooner or later, at up to `MOST_SHIFTED` of all
changes, because rounding alone may cross a threshold; the numbers are then ignored for the filters' memory. A world of
fewer than twenty changes allows none.
"""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import msgspec
import numpy as np
from msgspec import json
from numpy.typing import NDArray

from fmfts.bus.messages import ContactMessage
from golden.coding import compressed, expanded, packed, unpacked

BLOCK = 50
OF_A_DEVIATION, OF_ITSELF = 0.002, 0.002
# In SI, by the end of a name. chi2 has no unit: its own deviation is at least 1.4.
FLOOR = {
    "m_per_s": 1e-6, "n_per_s": 1e-3, "rad": 1e-7, "ns": 1e3, "chi2": 1e-2, "axis": 1e-6, "residual_t": 1e-10,
    "remanence_t": 1e-6, "ambient_t": 1e-10, "sd_t": 1e-10, "m": 1e-8, "n": 1e-5, "c": 1e-3,
}  # fmt: skip
LONGEST_SHIFT, MOST_SHIFTED, REMEMBERED = 2, 0.05, 200
# Excluded: fields that differ in every run, and fields that name versions.
UNCOMPARED = {"v", "boot", "pad", "seq", "t_publish_ns", "utc_ns", "model", "baseline", "t_sample_ns"}
NOTHING = -(1 << 40)
Numbers = dict[str, float]


def floor_of(name: str) -> float:
    plain = re.sub(r"\[\d+\]$", "", name)
    ends = [end for end in FLOOR if plain == end or plain.endswith(("_" + end, "." + end))]
    return FLOOR[max(ends, key=len)]


def deviation_of(name: str) -> str:
    """The name of the number's published deviation: x_m → x_sd_m. For a deviation, its own name."""
    plain = re.sub(r"\[\d+\]$", "", name)
    if plain.endswith("axis"):
        return plain + "_sd_rad"
    of_rate = re.sub(r"_rate_(m|n)_per_s$", r"_rate_sd_\1_per_s", plain)
    return re.sub(r"(?<!_sd)_(m|n|t)$", r"_sd_\1", of_rate) + name[len(plain) :]


def split(message: ContactMessage, sent_ns: int) -> tuple[str, Numbers]:
    """The values that are no numbers, and the numbers. sent_ns: time of the frame's sample, to which times are
    relative."""
    words: dict[str, Any] = {}
    numbers: Numbers = {"sampled_ns": float(message.t_sample_ns - sent_ns)}
    for name, value in _flat("", msgspec.to_builtins(message)):
        last = name.rpartition(".")[2]
        if last in UNCOMPARED:
            continue
        if last == "t_ns":
            numbers[name] = float(value - sent_ns)
        elif isinstance(value, float):
            numbers[name] = value
        elif name == "reason":
            words[name] = re.sub(r"\d+\.\d+|\d{2,}", "…", value)
        elif value is not None:
            words[name] = value
    words["numbers"] = hashlib.sha256(" ".join(numbers).encode()).hexdigest()[:6]
    return msgspec.json.encode(words).decode(), numbers


def _flat(prefix: str, value: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(value, dict):
        for name, each in value.items():
            yield from _flat(f"{prefix}.{name}" if prefix else name, each)
    elif isinstance(value, list | tuple):
        yield f"{prefix}.length", len(value)
        for place, each in enumerate(value):
            yield from _flat(f"{prefix}[{place}]", each)
    else:
        yield prefix, value


@dataclass(slots=True)
class Block:
    first: Numbers = field(default_factory=dict)
    sums: Numbers = field(default_factory=dict)
    counts: dict[str, int] = field(default_factory=dict)


@dataclass(slots=True)
class Said:
    """All messages of one pad. words: of every message. digest: of every digit, to distinguish "the same" from
    "within"."""

    words: list[str] = field(default_factory=list)
    blocks: list[Block] = field(default_factory=list)
    digest: str = ""
    _digits: Any = field(default_factory=hashlib.sha256)

    def add(self, message: ContactMessage | None, sent_ns: int) -> None:
        """None: a sample that came before its frame, and contained nothing new. It counts, so that all keep their
        indices."""
        words, numbers = ("{}", {}) if message is None else split(message, sent_ns)
        if len(self.words) % BLOCK == 0:
            self.blocks.append(Block(numbers))
        self.words.append(words)
        block = self.blocks[-1]
        for name, value in numbers.items():
            block.sums[name] = block.sums.get(name, 0.0) + value
            block.counts[name] = block.counts.get(name, 0) + 1
        self._digits.update(words.encode())
        self._digits.update(np.array([*numbers.values()]).tobytes())
        self.digest = self._digits.hexdigest()


def encoded(pads: dict[str, Said]) -> bytes:
    return compressed({name: _content(said) for name, said in pads.items()})


def _content(said: Said) -> dict[str, Any]:
    kinds = sorted(set(said.words))
    place = {words: number for number, words in enumerate(kinds)}
    numbers = np.array([place[words] for words in said.words], np.int64)
    starts = np.flatnonzero(np.diff(numbers, prepend=-1))
    names = sorted({name for block in said.blocks for name in block.sums})
    first, mean, count = (np.full((len(said.blocks), len(names)), NOTHING, np.int64) for _ in range(3))
    for row, block in enumerate(said.blocks):
        for column, name in enumerate(names):
            quantum = 0.25 * floor_of(name)
            if name in block.first:
                first[row, column] = round(block.first[name] / quantum)
            if name in block.sums:
                mean[row, column] = round(block.sums[name] / block.counts[name] / quantum)
            count[row, column] = block.counts.get(name, 0)
    return {
        "words": kinds,
        "runs": packed(np.column_stack([starts, numbers[starts]]), 1),
        "length": len(said.words),
        "digest": said.digest,
        "names": names,
        "first": packed(first, 1),
        "mean": packed(mean, 1),
        "count": packed(count, 1),
    }


@dataclass(frozen=True, slots=True)
class Frozen:
    """The messages of one pad when it was frozen. first, mean (B, K) in SI, NaN if absent; count (B, K)."""

    words: list[str]
    digest: str
    names: list[str]
    first: NDArray[np.float64]
    mean: NDArray[np.float64]
    count: NDArray[np.int64]


def decoded(content: bytes) -> dict[str, Frozen]:
    return {name: _frozen(each) for name, each in expanded(content).items()}


def _frozen(content: dict[str, Any]) -> Frozen:
    runs = unpacked(content["runs"])
    lengths = np.diff(runs[:, 0], append=content["length"])
    words = [content["words"][number] for number in np.repeat(runs[:, 1], lengths).tolist()]
    quanta = np.array([0.25 * floor_of(name) for name in content["names"]])
    first, mean = (
        np.where(whole == NOTHING, np.nan, whole * quanta)
        for whole in (unpacked(content[one]) for one in ("first", "mean"))
    )
    return Frozen(words, content["digest"], content["names"], first, mean, unpacked(content["count"]))


@dataclass(slots=True)
class Verdict:
    """differences: beyond the tolerance, each with its message. shifted: messages that differ around a change.
    identical: every digit is the same."""

    differences: list[str] = field(default_factory=list)
    shifted: int = 0
    compared: int = 0
    identical: bool = False


def compare(said: Said, frozen: Frozen) -> Verdict:
    """Of a part of the world, the results of its first messages are compared."""
    count = len(said.words)
    verdict = Verdict(identical=said.digest == frozen.digest)
    if count > len(frozen.words):
        verdict.differences.append(f"{count} messages, {len(frozen.words)} were frozen")
        return verdict
    shifted = _shifted(said.words, frozen.words[:count], verdict)
    for row, block in enumerate(said.blocks[: count // BLOCK]):
        begin = row * BLOCK
        if shifted[max(begin - REMEMBERED, 0) : begin + BLOCK].any():
            continue
        _compare_block(block, row, frozen, verdict)
    return verdict


def _shifted(words: list[str], frozen: list[str], verdict: Verdict) -> NDArray[np.bool_]:
    """Messages whose content changed."""
    other = np.array([one != two for one, two in zip(words, frozen, strict=True)], np.bool_)
    changes = sum(one != two for one, two in pairwise(frozen))
    verdict.shifted = int(other.sum())
    strange = [
        number
        for number in np.flatnonzero(other).tolist()
        if words[number] not in frozen[max(number - LONGEST_SHIFT, 0) : number + LONGEST_SHIFT + 1]
    ]
    if verdict.shifted > int(MOST_SHIFTED * changes) * LONGEST_SHIFT:
        verdict.differences.append(f"{verdict.shifted} messages say something else; there are {changes} changes")
        strange = strange or np.flatnonzero(other).tolist()
    for number in strange[:3]:
        verdict.differences.append(f"message {number}: {_changed(words[number], frozen[number])}")
    return other


def _changed(words: str, frozen: str) -> str:
    """The values that changed."""
    own, before = (json.decode(each) for each in (words, frozen))
    names = [name for name in own | before if own.get(name) != before.get(name)]
    return ", ".join(f"{name} is {own.get(name)!r}, was {before.get(name)!r}" for name in names)


def _compare_block(block: Block, row: int, frozen: Frozen, verdict: Verdict) -> None:
    begin = row * BLOCK
    column = {name: number for number, name in enumerate(frozen.names)}
    strange = set(block.sums) ^ {name for name, number in column.items() if frozen.count[row, number] > 0}
    if strange:
        verdict.differences.append(f"messages {begin}…: {', '.join(sorted(strange))} is not in both")
        return
    for name in block.sums:
        number = column[name]
        deviation = deviation_of(name)
        own = deviation not in column
        for what, value, table in (
            ("", block.first.get(name, math.nan), frozen.first),
            ("mean of ", block.sums[name] / block.counts[name], frozen.mean),
        ):
            wanted = float(table[row, number])
            if math.isnan(value) and math.isnan(wanted):
                continue
            sd = abs(float(table[row, column[deviation]])) if not own else 0.0
            allowed = max(floor_of(name), OF_ITSELF * abs(wanted) if own or deviation == name else OF_A_DEVIATION * sd)
            verdict.compared += 1
            off = abs(value - wanted)
            if not off <= allowed:
                in_sd = f", {off / sd:.3g} deviations" if sd > 0.0 else ""
                verdict.differences.append(
                    f"messages {begin}…: {what}{name} is {value:.9g}, was {wanted:.9g}, off by {off:.3g}{in_sd}"
                )
