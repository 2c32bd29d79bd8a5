"""The baseline of a pad as a file: what was recorded before loading, and all that is needed to use it again."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.matrix import length
from fmfts.baseline.diagnosis import check_bare, estimate_and_judge
from fmfts.baseline.file_format import StoredPresses, StoredRecording, StoredTurn
from fmfts.baseline.gains import Gains
from fmfts.baseline.mounting import Mounting, nominal_mounting
from fmfts.baseline.recording import BaselineError, Recording, solvable
from fmfts.baseline.refine import AtRest, pick, refined
from fmfts.baseline.turn import Turn, gains_from_turn
from fmfts.baseline.window_means import Means
from fmfts.pad import Pad, Tolerance
from fmfts.pose import FREE_FIELD, solve

FORMAT = 1
Array = NDArray[np.float64]
Kind = Literal["bare", "rest"]
LARGEST_BYTES = 4_000_000


class Baseline(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """The recordings are the facts; the mounting follows from them, the tolerances and the drawing, the same each time.

    `id` is the first twelve hex digits of the SHA-256 of everything else: a damaged file does not have its own id.
    What was not recorded is not in the file, so that the ids of older files still hold.
    """

    format: int
    id: str
    pad: str
    geometry_hash: str
    tolerance: dict[str, float]
    bare: StoredRecording | None
    rest: StoredRecording | None
    turn: StoredTurn | None = None
    refine: StoredPresses | None = None
    # How far rest has drifted from the recorded one (5,), m and rad: never in a file, for it is undone by a restart.
    drift: tuple[float, ...] | None = None

    @property
    def kind(self) -> Kind:
        """What was recorded last: only a rest baseline has a mounting."""
        return "rest" if self.rest is not None else "bare"

    def mounting(self, pad: Pad) -> Mounting:
        """The mounting that the recordings show, the drawing's where only a bare one is there.

        BaselineError where they do not fit `pad`.
        """
        with solvable(f"pad '{self.pad}': no pad explains what the baseline holds: record it again, --bare and --rest"):
            return self._mounting(pad)

    def _mounting(self, pad: Pad) -> Mounting:
        tolerance = Tolerance(**self.tolerance)
        bare = None if self.bare is None else self.bare.recording()
        if self.rest is not None:
            known = self._at_rest(pad, self.rest)
            mounting = estimate_and_judge(pad, tolerance, known.rest, bare, known.gains)
            mounting = mounting if self.refine is None else refined(known, mounting, self.refine.presses())
            return mounting if self.drift is None else mounting.drifted(np.array(self.drift))
        if bare is not None:
            return nominal_mounting(pad, tolerance, bare)
        raise BaselineError(f"pad '{self.pad}': the baseline holds no recording")

    def drifted(self, moved: Array) -> Baseline:
        """The same with its rest moved by (5,), m and rad in the tangent plane of its axis."""
        return msgspec.structs.replace(self, drift=tuple(moved.tolist())).sealed()

    def as_recorded(self) -> Baseline:
        return self if self.drift is None else msgspec.structs.replace(self, drift=None).sealed()

    def _at_rest(self, pad: Pad, rest: StoredRecording) -> AtRest:
        tolerance = Tolerance(**self.tolerance)
        gains: Gains | None = None if self.turn is None else gains_from_turn(pad, tolerance, self.turn.turn())
        return AtRest(pad, tolerance, rest.recording(), None if self.bare is None else self.bare.recording(), gains)

    def sealed(self) -> Baseline:
        """The same with its own id."""
        blank = msgspec.structs.replace(self, id="")
        digest = hashlib.sha256(msgspec.json.encode(blank, order="deterministic")).hexdigest()[:12]
        return msgspec.structs.replace(self, id=digest)


def make_bare(pad: Pad, tolerance: Tolerance, recording: Recording, before: Baseline | None = None) -> Baseline:
    """A baseline of the field alone, the pad not mounted; it ends what any rest recording of before said.

    Gains are the sensors' own, so that `before` lends its turn.
    """
    check_bare(pad, recording)
    return _baseline(pad, tolerance, StoredRecording.of(recording), None, before)


def make_rest(
    pad: Pad, tolerance: Tolerance, recording: Recording, before: Baseline | None, replaced: bool = False
) -> tuple[Baseline, Mounting]:
    """A baseline of the mounted, unloaded pad; `before` lends its bare recording. Refused where it does not fit.

    Unless the pad was `replaced`, its magnet must be where it was before: a load would become the new zero. What
    presses told holds until then; the sensors' gains, which a turn told, hold beyond.
    """
    bare = None if before is None else before.bare
    baseline = _baseline(pad, tolerance, bare, StoredRecording.of(recording), before)
    if before is not None and before.rest is not None and not replaced:
        baseline = msgspec.structs.replace(baseline, refine=before.refine).sealed()
    mounting = baseline.mounting(pad)
    if before is not None and before.rest is not None and not replaced:
        _require_unmoved(pad, tolerance, before, recording)
    return baseline, mounting


def make_turn(pad: Pad, means: Means, before: Baseline | None) -> tuple[Baseline, Mounting]:
    """`before`, which must have a rest recording, with the gains that turning the unloaded robot told."""
    _require_rest(before, "--turn")
    assert before is not None
    stored = StoredTurn.of(Turn.of(means))
    baseline = msgspec.structs.replace(before, turn=stored).sealed()
    with solvable("the sensors do not see one field turn: leave the pad untouched, keep steel away, and turn again"):
        return baseline, baseline._mounting(pad)


def make_refined(pad: Pad, means: Means, before: Baseline | None) -> tuple[Baseline, Mounting]:
    """`before`, which must have a rest recording, with what unlabelled presses told of sensor places and gains."""
    rest = _require_rest(before, "--refine")
    assert before is not None
    plain = msgspec.structs.replace(before, refine=None)
    with solvable("the presses fit no pad: keep steel and other magnets away, and press again"):
        fields = pick(plain._at_rest(pad, rest), plain.mounting(pad), means)
        baseline = msgspec.structs.replace(before, refine=StoredPresses.of(fields)).sealed()
        return baseline, baseline._mounting(pad)


def _require_rest(before: Baseline | None, option: str) -> StoredRecording:
    if before is None or before.rest is None:
        raise BaselineError(
            f"rest is not recorded: `fmfts-daemon baseline --rest` while nothing touches the pad, then {option}"
        )
    return before.rest


def _require_unmoved(pad: Pad, tolerance: Tolerance, before: Baseline, recording: Recording) -> None:
    """Seen through the last baseline, the magnet must rest where it did; the ambient field may have turned since."""
    last = before.mounting(pad)
    estimate = solve(
        last.magnet_field(recording.mean_t),
        last.mounted(pad),
        last.rest,
        deviation_t=recording.mean_deviation_t,
        free=FREE_FIELD,
    )
    moved = estimate.position_m - last.rest.position_m
    if not length(moved) < tolerance.magnet_position_m:
        x, y, z = moved * 1e3
        raise BaselineError(
            f"the pad looks loaded: its magnet is ({x:+.2f}, {y:+.2f}, {z:+.2f}) mm away from where baseline "
            f"{before.id} found it (limit {tolerance.magnet_position_m * 1e3:.2f} mm): unload it, or say --replaced if "
            "this is another pad"
        )


def load(path: Path, pad: Pad) -> Baseline | None:
    """The stored baseline, None where there is none; BaselineError where the file is damaged or another pad's."""
    again = "record it again (fmfts-daemon baseline)"
    try:
        with path.open("rb") as file:
            text = file.read(LARGEST_BYTES + 1)
    except FileNotFoundError:
        return None
    except OSError as error:
        raise BaselineError(f"pad '{pad.name}': baseline {path} cannot be read: {error.strerror}") from error
    if len(text) > LARGEST_BYTES:
        larger = f"larger than {LARGEST_BYTES / 1e6:g} MB, and no baseline is"
        raise BaselineError(f"pad '{pad.name}': baseline {path} is {larger}: {again}")
    try:
        baseline = msgspec.json.decode(text, type=Baseline)
    except msgspec.DecodeError as error:
        raise BaselineError(f"pad '{pad.name}': baseline {path} is damaged ({error}): {again}") from error
    if baseline.format != FORMAT:
        raise BaselineError(f"pad '{pad.name}': baseline {path} has format {baseline.format}, not {FORMAT}: {again}")
    if baseline.sealed().id != baseline.id:
        raise BaselineError(f"pad '{pad.name}': baseline {path} is damaged (its id does not match): {again}")
    if baseline.pad != pad.name:
        raise BaselineError(f"pad '{pad.name}': baseline {path} belongs to pad '{baseline.pad}': {again}")
    if baseline.geometry_hash != pad.geometry_hash:
        raise BaselineError(f"pad '{pad.name}': baseline {path} was recorded with another geometry: {again}")
    return baseline


def encode(baseline: Baseline) -> bytes:
    """The file's content."""
    return msgspec.json.format(msgspec.json.encode(baseline), indent=1) + b"\n"


def _baseline(
    pad: Pad,
    tolerance: Tolerance,
    bare: StoredRecording | None,
    rest: StoredRecording | None,
    before: Baseline | None,
) -> Baseline:
    turn = None if before is None else before.turn
    tolerances = {name: float(getattr(tolerance, name)) for name in Tolerance.__slots__}
    return Baseline(FORMAT, "", pad.name, pad.geometry_hash, tolerances, bare, rest, turn).sealed()
