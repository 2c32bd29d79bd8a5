"""A pad's baseline as a file: the recordings before loading, and all that is needed to use them again."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from fmfts.baseline.array_mounting import ArrayMounting, estimate_array_mounting
from fmfts.baseline.diagnosis import MisfitError, check_bare, estimate_and_judge
from fmfts.baseline.evenness import STEEL_TURNS
from fmfts.baseline.file_format import StoredGains, StoredGeometry, StoredPresses, StoredRecording, StoredTurn
from fmfts.baseline.mounting import Mounting, nominal_mounting
from fmfts.baseline.origin import Origin, foreign
from fmfts.baseline.posture import StoredPosture
from fmfts.baseline.recording import BaselineError, ForeignError, GeometryError, Recording, solvable
from fmfts.baseline.refine import AtRest, pick, refined
from fmfts.baseline.rest_field import RestField
from fmfts.baseline.sensitivity import Sensitivity
from fmfts.baseline.silicone import StoredSilicone
from fmfts.baseline.turn import Turn, sensitivity_from_turn
from fmfts.baseline.unmoved import require_unmoved
from fmfts.baseline.window_means import Means
from fmfts.common.reading import damage_told, read_regular
from fmfts.pad import Pad, Tolerance

FORMAT = 1
Array = NDArray[np.float64]
Kind = Literal["bare", "rest"]
LARGEST_BYTES = 4_000_000
UNKNOWN_MAGNETS = "this pad's magnets are unknown, so turning and presses cannot measure its chips: record --rest only"
AnyMounting = Mounting | ArrayMounting | RestField


class Baseline(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """Holds the recordings. The mounting is computed from them, the tolerances and the drawing, each time the same.

    `id` is the first twelve hex digits of the SHA-256 of everything else: in a damaged file it does not match. Fields
    without a recording are left out of the file.
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
    # The self-test's gains before the turn; None: there was none, so tolerance.gain holds.
    gains: StoredGains | None = None
    # The sensors of the recording; None: not recorded, or of a file that another program wrote.
    origin: Origin | None = None
    # Learned places of the sensors, for a rough drawing; `refine` then has the presses.
    learned: StoredGeometry | None = None
    silicone: StoredSilicone | None = None  # the stiffness by a known weight; None: nothing was weighed
    posture: StoredPosture | None = None  # the field of the hand's posture; None: not recorded
    # How far rest has drifted from the recorded one, (5,) in m and rad. Never in a file: a restart undoes it.
    drift: tuple[float, ...] | None = None

    @property
    def kind(self) -> Kind:
        """ "rest" if a rest recording is there; only then the mounting is estimated."""
        return "rest" if self.rest is not None else "bare"

    @property
    def gains_from(self) -> Literal["tolerance", "selftest", "turn"]:
        """The source of the chips' gains, before the field at rest."""
        return "turn" if self.turn is not None else "selftest" if self.gains is not None else "tolerance"

    def mounting(self, pad: Pad) -> Mounting:
        """The mounting estimated from the recordings; the drawing's if there is only a bare one.

        BaselineError if they do not fit `pad`.
        """
        nothing_fits = f"pad '{self.pad}': no pad explains what the baseline holds: record it again, --bare and --rest"
        with damage_told(BaselineError, nothing_fits):
            return self._mounting(pad)

    def array_mounting(self, pad: Pad) -> ArrayMounting:
        """As `mounting`, of a pad with several magnets. BaselineError if rest is not recorded, or does not fit."""
        if self.rest is None:
            raise BaselineError(f"pad '{self.pad}': rest is not recorded: `fmfts-daemon baseline --rest`, untouched")
        with damage_told(BaselineError, f"pad '{self.pad}': no pad explains what the baseline holds: record it again"):
            known = self._at_rest(pad, self.rest)
            return estimate_array_mounting(pad, known.tolerance, known.rest, known.bare, known.measured)

    def rest_field(self) -> RestField:
        """As `mounting`, of a pad whose magnets are unknown. BaselineError if rest is not recorded."""
        if self.rest is None:
            raise BaselineError(f"pad '{self.pad}': rest is not recorded: `fmfts-daemon baseline --rest`, untouched")
        return RestField.of(self.rest.recording())

    def any_mounting(self, pad: Pad) -> AnyMounting:
        """The mounting of a pad with one magnet, with several, or with unknown ones."""
        if not pad.are_magnets_known:
            return self.rest_field()
        return self.array_mounting(pad) if pad.other_magnets else self.mounting(pad)

    def require_sensors(self, sensors: int) -> None:
        """BaselineError unless each recording has this many sensors."""
        parts = (self.bare, self.rest, self.turn, self.refine, self.gains, self.learned, self.posture)
        if any(part is not None and part.sensors != sensors for part in parts):
            raise BaselineError(
                f"pad '{self.pad}': its baseline is of another number of sensors than {sensors}: record it again"
            )

    def _mounting(self, pad: Pad) -> Mounting:
        tolerance = Tolerance(**self.tolerance)
        bare = None if self.bare is None else self.bare.recording()
        if self.rest is not None:
            known = self._at_rest(pad, self.rest)
            mounting = estimate_and_judge(known.pad, tolerance, known.rest, bare, known.measured)
            mounting = mounting if self.refine is None else refined(known, mounting, self.refine.presses())
            return mounting if self.drift is None else mounting.drifted(np.array(self.drift))
        if bare is not None:
            return nominal_mounting(pad, tolerance, bare, self._before_turn(pad))
        raise BaselineError(f"pad '{self.pad}': the baseline holds no recording")

    def recorded_on(self, origin: Origin | None) -> Baseline:
        """A copy with the sensors of its recording."""
        return msgspec.structs.replace(self, origin=origin).sealed()

    def is_foreign_to(self, origin: Origin | None) -> bool:
        """Whether it was recorded with other sensors. False where either is not known."""
        return self.origin is not None and origin is not None and not self.origin.agrees_with(origin)

    def drifted(self, moved: Array) -> Baseline:
        """A copy with rest moved by (5,), in m and in rad in the tangent plane of its axis."""
        return msgspec.structs.replace(self, drift=tuple(moved.tolist())).sealed()

    def tested(self, gains: StoredGains | None) -> Baseline:
        """A copy with the gains of a self-test; without one (None) it is the same."""
        return self if gains in (None, self.gains) else msgspec.structs.replace(self, gains=gains).sealed()

    def as_recorded(self) -> Baseline:
        return self if self.drift is None else msgspec.structs.replace(self, drift=None).sealed()

    def _before_turn(self, pad: Pad) -> Sensitivity:
        tolerance = Tolerance(**self.tolerance)
        if self.gains is None:
            return Sensitivity.untested(len(pad.sensors), tolerance)
        return self.gains.sensitivity(tolerance)

    def _at_rest(self, pad: Pad, rest: StoredRecording) -> AtRest:
        tolerance = Tolerance(**self.tolerance)
        measured, learned = self._before_turn(pad), None
        if self.learned is not None and self.refine is not None:  # it would count as exact
            learned = self.learned.geometry()
            pad, measured = learned.turned(pad), learned.from_drawing(measured)
        if self.turn is not None:
            measured = sensitivity_from_turn(pad, measured, self.turn.turn())
        bare = None if self.bare is None else self.bare.recording()
        return AtRest(pad, tolerance, rest.recording(), bare, measured, learned)

    def sealed(self) -> Baseline:
        """A copy with the id that belongs to its content."""
        blank = msgspec.structs.replace(self, id="")
        digest = hashlib.sha256(msgspec.json.encode(blank, order="deterministic")).hexdigest()[:12]
        return msgspec.structs.replace(self, id=digest)


def make_bare(
    pad: Pad,
    tolerance: Tolerance,
    recording: Recording,
    before: Baseline | None = None,
    gains: StoredGains | None = None,
) -> Baseline:
    """A baseline of the field without the pad. It drops the rest recording of `before`, and what was recorded on it.

    It keeps the turn of `before`, and its gains if there are no newer `gains`, because they belong to the sensors.
    """
    check_bare(pad, recording)
    return _baseline(pad, tolerance, StoredRecording.of(recording), None, before).tested(gains)


def make_rest(
    pad: Pad,
    tolerance: Tolerance,
    recording: Recording,
    before: Baseline | None,
    replaced: bool = False,
    gains: StoredGains | None = None,
) -> tuple[Baseline, AnyMounting]:
    """A baseline of the mounted, unloaded pad, with the bare recording of `before`. BaselineError if it does not fit.

    Unless the pad was `replaced`, its magnet must be where it was before: else a load would become the new zero. The
    presses of `before` are kept unless the pad, and so its silicone, was replaced; its turn is always kept.
    """
    bare = None if before is None else before.bare
    baseline = _baseline(pad, tolerance, bare, StoredRecording.of(recording), before).tested(gains)
    if before is not None and before.rest is not None and not replaced:
        baseline = msgspec.structs.replace(baseline, refine=before.refine, learned=before.learned).sealed()
    mounting = baseline.any_mounting(pad)
    if before is not None and before.rest is not None and not replaced:
        require_unmoved(pad, tolerance, before, recording)
    return baseline, mounting


def make_turn(pad: Pad, means: Means, before: Baseline | None) -> tuple[Baseline, AnyMounting]:
    """`before`, which must have a rest recording, with the gains measured by turning the unloaded robot."""
    require_rest(before, "--turn")
    assert before is not None
    if not pad.are_magnets_known:
        raise BaselineError(UNKNOWN_MAGNETS)
    with solvable("the sensors do not see one field turn: leave the pad untouched, keep steel away, and turn again"):
        stored = StoredTurn.of(Turn.of(means))
        baseline = msgspec.structs.replace(before, turn=stored).sealed()
        try:
            return baseline, baseline.array_mounting(pad) if pad.other_magnets else baseline._mounting(pad)
        except MisfitError as error:
            # Bare and rest fitted, so the turn is the cause. Steel that turns with the pad acts on the ambient field
            # alone, so it causes errors of the gains for the magnet's field.
            raise BaselineError(f"the turn contradicts the rest: {error.facts} {STEEL_TURNS}") from error


def make_refined(pad: Pad, means: Means, before: Baseline | None) -> tuple[Baseline, Mounting]:
    """`before`, which must have a rest recording, with sensor places and gains estimated from unlabelled presses."""
    rest = require_rest(before, "--refine")
    assert before is not None
    if not pad.are_magnets_known:
        raise BaselineError(UNKNOWN_MAGNETS)
    if pad.other_magnets:
        raise BaselineError("a pad with several magnets has no --refine: --turn measures its chips' gains and turns")
    if before.learned is not None:
        raise BaselineError("this pad's geometry was learned from presses: add to them with --learn, not with --refine")
    plain = msgspec.structs.replace(before, refine=None)
    with solvable("the presses fit no pad: keep steel and other magnets away, and press again"):
        fields = pick(plain._at_rest(pad, rest), plain.mounting(pad), means)
        baseline = msgspec.structs.replace(before, refine=StoredPresses.of(fields)).sealed()
        return baseline, baseline._mounting(pad)


def require_rest(before: Baseline | None, option: str) -> StoredRecording:
    """The rest recording of `before`. BaselineError, with what to do, if there is none for `option` to add to."""
    if before is None or before.rest is None:
        raise BaselineError(
            f"rest is not recorded: `fmfts-daemon baseline --rest` while nothing touches the pad, then {option}"
        )
    return before.rest


def load(path: Path, pad: Pad, origin: Origin | None = None) -> Baseline | None:
    """The stored baseline, None if there is none.

    BaselineError if the file is damaged or belongs to another pad, GeometryError if to another drawing of this one,
    ForeignError if it was recorded with other sensors than `origin`.
    """
    again = f"record it again: `fmfts-daemon baseline --bare --pad {pad.name}`, then `--rest`"
    try:
        text = read_regular(path, LARGEST_BYTES + 1)
    except FileNotFoundError:
        return None
    except OSError as error:
        raise BaselineError(
            f"pad '{pad.name}': baseline {path} cannot be read: {error.strerror}: mend that, or name another folder "
            "with XDG_STATE_HOME (a service: StateDirectory=)"
        ) from error
    if len(text) > LARGEST_BYTES:
        larger = f"larger than {LARGEST_BYTES / 1e6:g} MB, and no baseline is"
        raise BaselineError(f"pad '{pad.name}': baseline {path} is {larger}: {again}")
    with damage_told(BaselineError, f"pad '{pad.name}': baseline {path} is damaged", again):
        baseline = msgspec.json.decode(text, type=Baseline)
        seal = baseline.sealed().id
    if baseline.format != FORMAT:
        raise BaselineError(f"pad '{pad.name}': baseline {path} has format {baseline.format}, not {FORMAT}: {again}")
    if seal != baseline.id:
        raise BaselineError(f"pad '{pad.name}': baseline {path} is damaged (its id does not match): {again}")
    if baseline.pad != pad.name:
        raise BaselineError(f"pad '{pad.name}': baseline {path} belongs to pad '{baseline.pad}': {again}")
    if baseline.geometry_hash != pad.geometry_hash:
        raise GeometryError(f"pad '{pad.name}': baseline {path} was recorded with another geometry: {again}")
    baseline.require_sensors(len(pad.sensors))
    if baseline.origin is not None and origin is not None and baseline.is_foreign_to(origin):
        raise ForeignError(foreign(pad.name, baseline.origin, origin))
    return baseline


def encode(baseline: Baseline) -> bytes:
    """The file's content."""
    return msgspec.json.format(msgspec.json.encode(baseline), indent=1) + b"\n"


def _baseline(
    pad: Pad, tolerance: Tolerance, bare: StoredRecording | None, rest: StoredRecording | None, before: Baseline | None
) -> Baseline:
    turn, gains, silicone = (None, None, None) if before is None else (before.turn, before.gains, before.silicone)
    tolerances = {name: float(getattr(tolerance, name)) for name in Tolerance.__slots__}
    known = bare, rest, turn, None, gains
    return Baseline(FORMAT, "", pad.name, pad.geometry_hash, tolerances, *known, silicone=silicone).sealed()
