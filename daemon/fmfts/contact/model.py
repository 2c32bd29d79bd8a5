"""The contact model: pose → place and force, with an ONNX graph that is verified when it is loaded."""

from __future__ import annotations

from math import sqrt
from pathlib import Path

import msgspec
import numpy as np

from fmfts.arithmetic.elementary import square
from fmfts.arithmetic.matrix import cholesky, length, root_of_squares, solve_lower
from fmfts.common.record import Numbers, Record
from fmfts.contact import _contact, silicone, structure
from fmfts.contact.beside import told, tried
from fmfts.contact.contract import (
    SHEAR_OUTPUT_ORDER,
    WEIGHTS_KEY,
    Facts,
    ModelError,
    OtherPadError,
    parse_facts,
    parse_response,
)
from fmfts.contact.estimate import ContactEstimate
from fmfts.contact.inference import Inference
from fmfts.contact.refinement import STEPS, Refiner
from fmfts.contact.response import CHANGE, Response
from fmfts.contact.seal import hash_of, unsealed
from fmfts.contact.shipped import path_of
from fmfts.contact.tolerances import StructureTolerance, wider_than_probe_mm2
from fmfts.contact.unknown_shear import SLIP_UNKNOWN
from fmfts.contact.verified import inference_of, read
from fmfts.pad import Array, Pad

REMEDY = "make it again with `fmfts-daemon calibrate`, or set [pad.contact] model to one that fits"

# A pose or force is over range if it is this many deviations outside the envelope.
OUTSIDE_DEVIATIONS = 3.0
POSE_UNIT = np.array([1e3, 1e3, 1e3, 1.0, 1.0, 1.0])  # m → mm; the axis is a number
CONTACT_UNIT = np.array([1e-3, 1e-3, 1.0, 1.0, 1.0])  # mm → m; newtons stay
# Added to a pose's covariance so that it can be inverted even if it is zero: (0.1 µm)², (0.1 mrad)².
TINY = np.diag([1e-8, 1e-8, 1e-8, 1e-8, 1e-8])
CENTRED = np.zeros(2)
CALIBRATED = StructureTolerance()
# Places along each side of the pad at which the detection limit is computed.
UNFELT_PLACES = 15
# An unknown place is still on the pad: the deviation of a uniform distribution over its width.
EVEN_SPREAD = 1.0 / sqrt(12.0)


class ContactModel:
    """A verified model. `hash`: see `hash_of` in seal.py.

    refiner: moves each answer to the most likely press, if not None. friction: of the finger; the shear that it may
    exert widens the deviations of a model of three outputs. smoothing_s: time constant of the `Smoother` of each pad.
    tolerance: of the pad's structure, which widens them, too.
    response: of the pad that the model was trained for, None if the file holds none.
    slip_friction: smallest and largest friction of a finger that may slip; None: slip is off.
    """

    response: Response | None = None
    tolerance = StructureTolerance()
    slip_friction: tuple[float, float] | None = None

    def __init__(
        self,
        inference: Inference,
        facts: Facts,
        digest: str,
        refiner: Refiner | None,
        friction: float,
        smoothing_s: float,
    ) -> None:
        self.inference = inference
        self.facts = facts
        self.hash = digest
        self.refiner = refiner
        self.refines, self.friction, self.smoothing_s = refiner is not None, friction, smoothing_s
        self.shear_share = structure.shear_share(facts, len(inference.contact), friction)
        outputs = len(SHEAR_OUTPUT_ORDER) if self.shear_share > 0.0 else len(inference.contact)
        self.has_shear = outputs == len(SHEAR_OUTPUT_ORDER)
        self._unit = CONTACT_UNIT[:outputs]
        self.rest_pose = np.array(facts.rest_pose)
        # The axis's last component gets no limit: it follows from the others, not linearly.
        self.lowest = np.array([*facts.envelope.pose_min[:5], -np.inf])
        # Nor does height above rest: no press lifts the magnet.
        self.highest = np.array([*facts.envelope.pose_max[:2], np.inf, *facts.envelope.pose_max[3:5], np.inf])
        self.trained_top_mm = facts.envelope.pose_max[2]
        own, fit = facts.own_error, facts.response_error
        of_network = np.stack(own.tables[:outputs], axis=-1) * self._unit
        of_response = 0.0 if fit is None else np.stack(fit.tables[:outputs], axis=-1) * self._unit
        of_finger = np.broadcast_to(structure.friction_deviation(facts, friction, self._unit), of_network.shape)
        # Refining removes the network's own error: the error of the response remains.
        trained = of_response if refiner or self.shear_share > 0.0 else root_of_squares(of_network, of_response)
        self.own_deviation = root_of_squares(trained, of_finger)
        self.trained_force_n = np.broadcast_to(trained, of_network.shape)[..., 2]
        self.slipping_n = of_finger[-1, :, 2]  # error of the largest force through shear, by radius
        self.force_bins_n, self.radius_bins_m = np.array(own.force_n[:-1]), np.array(own.radius_mm[:-1]) * 1e-3
        self.edges_m = np.array([facts.envelope.x_mm, facts.envelope.y_mm]) * 1e-3
        self.spread_m = np.diff(self.edges_m, axis=1)[:, 0] * EVEN_SPREAD
        self._packed: bytes | None = None
        self.parameters = Record(_contact.PARAMETERS)
        self.parameters.fill(self.for_c)

    @property
    def told(self) -> str:
        """The model's description in a few words for the log."""
        return self.inference.by

    @property
    def calibrated_range(self) -> dict[str, object]:
        """The places and forces that it was calibrated for."""
        envelope = self.facts.envelope
        return {
            "calibrated_x_m": [value * 1e-3 for value in envelope.x_mm],
            "calibrated_y_m": [value * 1e-3 for value in envelope.y_mm],
            "calibrated_force_n": envelope.force_max_n,
        }

    @property
    def for_c(self) -> dict[str, Numbers]:
        """The parameters of estimate.c: contact/step.h."""
        return {
            "refine_steps": STEPS if self.refines else 0,
            "shear_share": self.shear_share,
            "least_variance": TINY[0, 0],
            "model_rest": self.rest_pose,
            "lowest": self.lowest,
            "highest": self.highest,
            "outside_deviations": OUTSIDE_DEVIATIONS,
            "trained_top_mm": self.trained_top_mm,
            "force_max_n": self.facts.envelope.force_max_n,
            "edges_m": self.edges_m,
            "spread_m": self.spread_m,
            "force_bins": self.own_deviation.shape[0],
            "force_bin_n": self.force_bins_n,
            "radius_bins": self.own_deviation.shape[1],
            "radius_bin_m": self.radius_bins_m,
            "own_deviation": self.own_deviation,
            "trained_force_n": self.trained_force_n,
            "slipping_n": self.slipping_n,
            "smoothing_s": self.smoothing_s,
        } | self.tolerance.for_c

    @property
    def packed_response(self) -> bytes | None:
        """The pad's response to the model's loads, as C reads it; None if it is not known."""
        if self._packed is None and self.response is not None:
            self._packed = (self.response if self.has_shear else self.response.without_shear()).packed()
        return self._packed

    @property
    def tells_slip(self) -> bool:
        """Whether it can distinguish a slipping finger from one that shears the silicone."""
        return self.has_shear and self.response is not None

    @property
    def shear_is_unknown(self) -> bool:
        """Whether the finger may shear, with an unknown effect on this model's answers."""
        return self.friction > 0.0 and not self.has_shear and self.facts.friction_error is None

    @classmethod
    def load(
        cls,
        path: str,
        pad: Pad,
        *,
        refine: bool = False,
        friction: float = 0.0,
        smoothing_s: float = 0.0,
        tolerance: StructureTolerance = CALIBRATED,
        slip_friction: tuple[float, float] | None = None,
    ) -> ContactModel:
        """Load and verify a model for `pad`. path: or a name in contact/shipped.py. ModelError says what is wrong."""
        file = path_of(path)
        try:
            loaded = cls._load(file, pad, refine, friction, smoothing_s)
            if slip_friction is not None and not loaded.tells_slip:
                raise ValueError(SLIP_UNKNOWN)
            loaded.slip_friction = slip_friction
            return loaded.with_tolerance(tolerance)
        except ValueError as error:
            raise ModelError(f"contact model {file}: {error}; {REMEDY}") from error
        except (ModelError, MemoryError):
            raise
        except Exception as error:  # a damaged file may cause any error of arithmetic
            raise ModelError(f"contact model {file}: damaged ({type(error).__name__}: {error}); {REMEDY}") from error

    @classmethod
    def _load(cls, file: Path, pad: Pad, refine: bool, friction: float, smoothing_s: float) -> ContactModel:
        whole = read(file)
        content = unsealed(whole)
        model = told(content if WEIGHTS_KEY.encode() in content else tried(content))
        weights = model.metadata.get(WEIGHTS_KEY)
        if content == whole and weights is not None:
            raise ValueError("it is damaged, or was edited: `calibrate` wrote it, and its SHA-256 is not at its end")
        if content != whole and weights is None:
            raise ValueError("`calibrate` of another version wrote it, without its weights: calibrate this pad anew")
        facts, response = parse_facts(model.metadata), parse_response(model.metadata)
        inference = inference_of(content, model, facts)
        if refine and response is None:
            raise ValueError("it holds no response of its pad, so its answers cannot be refined: set refine = false")
        told_by_network = len(inference.contact)
        if told_by_network != len(facts.outputs) and not structure.solves_shear(facts, response, told_by_network):
            raise ValueError("it has another number of outputs than its metadata states")
        if other := structure.magnets_differ(facts, pad):
            raise OtherPadError(
                f"contact model {file} was trained for a pad of other dimensions than pad {pad.name!r} has: {other}: "
                "correct [pad.magnet], or calibrate this pad and set [pad.contact] model"
            )
        if friction > 0.0 and facts.friction_error is None and facts.outputs != SHEAR_OUTPUT_ORDER:
            facts = msgspec.structs.replace(facts, friction_error=structure.shipped_friction_error(facts.geometry_hash))
        refiner = Refiner(response) if refine and response is not None else None
        loaded = cls(inference, facts, hash_of(content, weights), refiner, friction, smoothing_s)
        loaded.response = response
        contact, jacobian = loaded._infer(loaded.rest_pose)  # also warms up the session
        if not (np.isfinite(contact).all() and np.isfinite(jacobian).all()):
            raise ValueError("it does not answer with numbers for the rest pose")
        return loaded

    def with_tolerance(self, tolerance: StructureTolerance) -> ContactModel:
        """This model, with deviations that include the pad's structure."""
        self.tolerance = tolerance
        self.parameters.fill(tolerance.for_c)
        return self

    def on_silicone(self, stiffness: float, deviation: float) -> ContactModel:
        """This model for a pad whose stiffness was measured by a weight. stiffness: over that of the model's pad;
        deviation: as a share, with all uncertainty of a press in the middle."""
        facts, inference = silicone.facts_of(self.facts, stiffness), silicone.inference_of(self.inference, stiffness)
        response = None if self.response is None else silicone.response_of(self.response, stiffness)
        refiner = Refiner(response) if self.refiner is not None and response is not None else None
        weighed = type(self)(inference, facts, self.hash, refiner, self.friction, self.smoothing_s)
        weighed.response, weighed.slip_friction = response, self.slip_friction
        return weighed.with_tolerance(self.tolerance.weighed(deviation))

    def reads(self, force_n: float, width_m: float) -> float:
        """The force (N) that it reads of a press in the middle by a disc of another width than the probe's."""
        response, packed_response = self.response, self.packed_response
        if response is None or packed_response is None:
            return force_n
        press, wider = np.array([0.0, 0.0, force_n, 0.0, 0.0]), np.empty(CHANGE)
        _contact.widened(packed_response, press.data, wider_than_probe_mm2(width_m), wider.data)
        position_mm, axis = self.rest_pose[:3].copy(), self.rest_pose[3:].copy()
        change = response.change(press[None, : 2 + response.loads])[0] + wider
        position_mm += change[:3]
        axis[:2] += change[3:]
        return self.estimate(position_mm * 1e-3, axis / length(axis), 1e-12 * np.eye(6)).force_n

    def estimate(
        self, position_m: Array, axis: Array, covariance: Array, magnet_off_m: Array = CENTRED
    ) -> ContactEstimate:
        """Place and force of one pose in the nominal frame: position_m (3,), axis (3,), covariance (6, 6) of both.

        magnet_off_m (2,): how far from its drawn place the magnet is. It counts as a deviation of the place: on a wide
        pad the magnet is the reference, on a narrow pad the rim. ValueError if a number is not finite.
        """
        pose = np.concatenate([position_m, axis]) * POSE_UNIT
        pose_covariance = np.ascontiguousarray(covariance * POSE_UNIT * POSE_UNIT[:, None])
        if not (np.isfinite(pose).all() and np.isfinite(pose_covariance).all()):
            raise ValueError("the pose of a contact is not finite")
        self.parameters.put("magnet_off_m", magnet_off_m)
        values, deviations = np.empty(len(self._unit)), np.empty(len(self._unit))
        over_range, refused, force_min_n = _contact.estimate(
            self.parameters.buffer,
            self.inference.for_c,
            self.packed_response,
            pose.data,
            pose_covariance.ravel().data,
            values.data,
            deviations.data,
        )
        return ContactEstimate(values, deviations, over_range, force_min_n if over_range else None, refused)

    def detection_limit_n(self, covariance: Array, chi2: float) -> float:
        """The largest force (N) that the touch test may miss: where the pad is least sensitive, usually at a corner.

        covariance (6, 6): of one frame's pose at rest. chi2: threshold of the test. Zero if the model has no response.
        """
        if self.response is None:
            return 0.0
        change_covariance = (covariance * POSE_UNIT * POSE_UNIT[:, None])[:CHANGE, :CHANGE] + TINY
        x_mm, y_mm = np.meshgrid(*(np.linspace(*side, UNFELT_PLACES) for side in self._sides_mm), indexing="ij")
        press = np.zeros((x_mm.size, 2 + self.response.loads))
        press[:, 0], press[:, 1] = x_mm.ravel(), y_mm.ravel()
        by_force = self.response.change_and_slope(press)[1][:, :, 2]
        chi2_of_one_newton = square(solve_lower(cholesky(change_covariance), by_force.T)).sum(axis=0)
        return float(np.sqrt(chi2 / chi2_of_one_newton.min()))

    @property
    def _sides_mm(self) -> tuple[tuple[float, float], tuple[float, float]]:
        return self.facts.envelope.x_mm, self.facts.envelope.y_mm

    def _infer(self, pose: Array) -> tuple[Array, Array]:
        self.inference.pose[:] = pose
        self.inference.run()
        return self.inference.contact.astype(np.float64), self.inference.jacobian.astype(np.float64)
