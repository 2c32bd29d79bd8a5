"""A request to record: makes the baseline from its frames, judges it, stores it, and reports the result."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import msgspec

from fmfts.baseline import (
    Baseline,
    BaselineError,
    Mounting,
    accuracy,
    make_bare,
    make_refined,
    make_rest,
    make_turn,
    means,
    summarise,
    turning_means,
)
from fmfts.baseline.alternating import warnings_of
from fmfts.baseline.baseline import AnyMounting, require_rest
from fmfts.baseline.coverage import Coverage, PressCoverage, TurnCoverage
from fmfts.baseline.diagnosis import weak_field
from fmfts.baseline.facts import report, whose
from fmfts.baseline.file_format import StoredGains
from fmfts.baseline.files import path_of, previous, store, stored_gains
from fmfts.baseline.joint_track import JointTrack
from fmfts.baseline.last_pad import LastPad
from fmfts.baseline.learner import Learner
from fmfts.baseline.origin import Origin, foreign
from fmfts.baseline.posture import PostureLearner
from fmfts.baseline.recording import ForeignError
from fmfts.pad import Pad, Tolerance
from fmfts.sensor import Frame
from fmfts.service.recorded_by import foreign as foreign_file

# The mean over 3 s at 220 Hz has 1/25 of the noise of one sample; a longer recording would mostly add drift.
DURATION_S = 3.0
# The time that a person needs for turning about two axes, and for thirty presses.
TURN_S, REFINE_S, LEARN_S = 20.0, 40.0, 60.0
CAST_ALIKE = (
    "the new silicone is assumed to be as stiff as the old one, which was weighed: forces are now known to {}: "
    "`fmfts-daemon weigh` measures the new one"
)
PRESSED = (
    "by the last baseline, {:.2f} N press on this pad: if it is the same pad and something lies on it, take that off "
    "and record `fmfts-daemon baseline --rest --replaced` again"
)
POSTURE_DROPPED = (
    "the recorded posture of the hand is dropped with the old rest: record `fmfts-daemon baseline --rest`, then "
    "teach it again: `fmfts-daemon baseline --posture`"
)
SHORTEST_S, LONGEST_S = 0.5, 60.0


Made = tuple[Baseline, AnyMounting | None, dict[str, Any]]


class OptionError(BaselineError):
    """The options of a request exclude each other or are out of range."""


@dataclass(frozen=True, slots=True)
class Recorded:
    """A baseline that is stored and may be used."""

    baseline: Baseline
    mounting: AnyMounting | None  # None before rest was recorded, and for pads with several or unknown magnets
    path: Path
    gained: dict[str, Any]
    warnings: list[str] = field(default_factory=list)  # warnings about the recording

    def facts(self, pad: Pad) -> dict[str, Any]:
        """The facts for the person who recorded the baseline."""
        is_silicone_alone = "stiffness" in self.gained
        return (
            (whose(self.baseline) if is_silicone_alone else report(self.baseline, self.mounting, pad))
            | self.gained
            | {"warnings": self.warnings, "stored": str(self.path)}
        )


@dataclass(frozen=True, slots=True)
class BaselineRequest:
    """bare: the pad is not mounted; else it is mounted and unloaded. replaced: it is another pad than the last time.

    turn, refine: improve the last baseline by turning the robot, or by presses anywhere. learn: by presses that replace
    a rough drawing. duration_s None: the usual time for this kind of recording. origin: the sensors that it is recorded
    with. gains: of a self-test, None: those of the last baseline. last: what is known of the pad that was replaced.
    BaselineError if the options exclude each other or the duration is out of range.
    """

    pad: Pad
    tolerance: Tolerance
    bare: bool
    replaced: bool
    duration_s: float | None = None
    turn: bool = False
    refine: bool = False
    origin: Origin | None = None
    gains: StoredGains | None = None
    learn: Learner | None = None
    track: JointTrack = field(default_factory=JointTrack)
    last: LastPad | None = None

    def __post_init__(self) -> None:
        if self.bare + self.turn + self.refine + (self.learn is not None) > 1:
            raise OptionError(f"pad '{self.pad.name}': one of bare, turn, refine, learn, posture and weigh at a time")
        if not SHORTEST_S <= self.seconds <= LONGEST_S:
            raise OptionError(
                f"pad '{self.pad.name}': a baseline takes {SHORTEST_S:g} to {LONGEST_S:g} s, not {self.seconds:g} s"
            )

    @property
    def seconds(self) -> float:
        if self.duration_s is not None:
            return self.duration_s
        if self.learn is not None:
            return self.learn.seconds
        return TURN_S if self.turn else REFINE_S if self.refine else DURATION_S

    @property
    def joints(self) -> JointTrack:
        """Joint positions of a hand meanwhile."""
        return self.learn.track if isinstance(self.learn, PostureLearner) else self.track

    @property
    def only_adds(self) -> bool:
        """Whether it adds to an existing baseline, without recording its sensors."""
        return self.turn or self.refine or self.learn is not None

    @property
    def coverage(self) -> Coverage | None:
        """Guides the person, and ends the recording when it has enough. None if nothing needs to be done meanwhile, or
        with a given duration."""
        if self.duration_s is not None:
            return None
        if self.turn:
            return TurnCoverage(self.pad)
        if self.learn is not None:
            return PressCoverage(self.pad, self.learn.presses) if self.learn.presses else None
        return PressCoverage(self.pad) if self.refine else None

    def require_rest(self, before: Baseline | None) -> None:
        """BaselineError before anybody turns or presses in vain, if there is no rest recording to add to.

        ForeignError if it is of other sensors.
        """
        if self.only_adds:
            try:
                option = "--refine" if self.learn is None else self.learn.option
                require_rest(before, "--turn" if self.turn else option)
                if self.learn is not None and before is not None:
                    self.learn.require(self.pad, before)
            except BaselineError as error:
                raise self._refused(error) from error
            self._require_own(before)

    def make(self, frames: Sequence[Frame], before: Baseline | None) -> tuple[Baseline, AnyMounting | None]:
        """Make a baseline from the frames. BaselineError, with the pad's name, if they are not good enough.

        A `before` of other sensors is ignored; a request that only adds to it is refused.
        """
        return self._made(frames, before)[:2]

    def _made(self, frames: Sequence[Frame], before: Baseline | None) -> Made:
        if before is not None and before.is_foreign_to(self.origin):
            if self.only_adds:
                self._require_own(before)
            before = None
        baseline, mounting, facts = self._make(frames, before and before.tested(self.gains))
        # Turning and presses only add to a baseline, so its origin stays.
        origin = baseline.origin if self.only_adds else self.origin
        return (baseline if baseline.origin == origin else baseline.recorded_on(origin)), mounting, facts

    def _require_own(self, before: Baseline | None) -> None:
        if before is None or before.origin is None or self.origin is None:
            return
        if not before.origin.agrees_with(self.origin):
            raise ForeignError(foreign(self.pad.name, before.origin, self.origin))

    def _make(self, frames: Sequence[Frame], before: Baseline | None) -> Made:
        try:
            if self.learn is not None:
                return self.learn.make(self.pad, frames, before)
            if self.turn:
                return *make_turn(self.pad, turning_means(frames), before), {}
            if self.refine:
                return *make_refined(self.pad, means(frames), before), {}
            recording = summarise(frames)
            if self.bare:
                baseline = make_bare(self.pad, self.tolerance, recording, before, self.gains)
                return baseline, None if _needs_rest(self.pad) else baseline.mounting(self.pad), {}
            baseline, mounting = make_rest(self.pad, self.tolerance, recording, before, self.replaced, self.gains)
            if self.replaced and baseline.silicone is not None:
                known = () if self.last is None else (self.last.unweighed,)
                silicone = baseline.silicone.of_another_pad(*known)
                baseline = msgspec.structs.replace(baseline, silicone=silicone).sealed()
            if before is not None and before.posture is not None and before.rest is not None:
                posture = before.posture.after_rest(self.track, frames)
                baseline = msgspec.structs.replace(baseline, posture=posture).sealed()
            return baseline, mounting, {}
        except BaselineError as error:
            raise self._refused(error) from error

    def _refused(self, error: BaselineError) -> BaselineError:
        what = "weight" if self.learn is not None and self.learn.weight_n else "baseline"
        return BaselineError(f"pad '{self.pad.name}': {what} refused: {error}")

    def record(self, frames: Sequence[Frame], before: Baseline | None) -> Recorded:
        """Make a baseline, with the gains of the last self-test of these sensors, and store it.

        BaselineError as from `make`, StateError if it cannot be stored.
        """
        tested = replace(self, gains=stored_gains(self.pad, self.origin))
        baseline, mounting, gained = tested._made(frames, before)
        warnings: list[str] = gained.pop("warnings", [])
        if before is not None and self.only_adds and isinstance(mounting, Mounting):
            was, now = (accuracy(known, self.pad) for known in (before.mounting(self.pad), mounting))
            if was != now:
                gained |= {f"{when}_{key}": facts[key] for key in now for when, facts in (("was", was), ("now", now))}
        warnings += [] if self.only_adds else warnings_of(frames)
        if self.bare and baseline.bare is not None:
            warnings += weak_field(baseline.bare.recording())
        warnings += foreign_file(path_of(self.pad.name), "baseline", "adds to" if self.only_adds else "replaces")
        if self.replaced and not (self.bare or self.only_adds):
            warnings += self._of_replaced(frames, before)
            warnings += [] if baseline.silicone is None else [CAST_ALIKE.format(baseline.silicone.known_to)]
        if before is not None and before.posture is not None and baseline.posture is None:
            warnings.append(POSTURE_DROPPED)
        return Recorded(baseline, mounting, store(baseline, self.pad), gained, warnings)

    def _of_replaced(self, frames: Sequence[Frame], before: Baseline | None) -> list[str]:
        """Another pad's magnet may stand anywhere, so a load cannot be refused as `require_unmoved` does."""
        if self.last is None or before is None or before.rest is None or before.is_foreign_to(self.origin):
            return []
        pressed_n = self.last.pressed_n(frames, before)
        return [] if pressed_n is None else [PRESSED.format(pressed_n)]


def restore(pad: Pad, origin: Origin | None = None) -> Recorded:
    """Bring the previous baseline back; the present one, if it is good, becomes the previous one.

    BaselineError if there is no previous one, ForeignError if it is of other sensors than `origin`, StateError if it
    cannot be stored.
    """
    baseline, signature = previous(pad, origin)
    unmounted = _needs_rest(pad) and baseline.rest is None
    mounting = None if unmounted else baseline.any_mounting(pad)
    return Recorded(baseline, mounting, store(baseline, pad, signature=signature), {})


def _needs_rest(pad: Pad) -> bool:
    """Whether a bare recording alone makes no mounting of such a pad."""
    return bool(pad.other_magnets) or not pad.are_magnets_known
