"""The contact model: pose → location and force, an ONNX graph that has to prove what it is before it is believed."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from math import sqrt
from typing import Self

import numpy as np

from fmfts.arithmetic.elementary import square
from fmfts.arithmetic.matrix import cholesky, product, root_of_squares, solve_lower
from fmfts.contact.contract import SHEAR_OUTPUT_ORDER, Facts, ModelError, parse_facts, parse_response
from fmfts.contact.inference import Inference
from fmfts.contact.onnx_file import parse
from fmfts.contact.refinement import Refiner
from fmfts.contact.response import CHANGE, Response
from fmfts.contact.shipped import path_of
from fmfts.contact.verified import check_versions, compared, inference_of, read
from fmfts.pad import Array, Pad

REMEDY = "make it again with `fmfts-daemon calibrate`, or set [pad.contact] model to one that fits"

# A pose or force must be this many deviations outside the envelope to be called over range, …
OUTSIDE_DEVIATIONS = 3.0
# … and the force it certainly reached is the model's, less this many.
CERTAIN_DEVIATIONS = 3.0
# A magnet is called lifted when it is this far, and this many deviations, above all that training saw.
LIFTED_DEVIATIONS = 6.0
HYSTERESIS_MM = 0.02
POSE_UNIT = np.array([1e3, 1e3, 1e3, 1.0, 1.0, 1.0])  # m → mm; the axis is a number
CONTACT_UNIT = np.array([1e-3, 1e-3, 1.0, 1.0, 1.0])  # mm → m; newtons stay
# Keeps the covariance of a pose that somebody calls certain one that can be inverted: 0.1 µm and 0.1 mrad, in square.
TINY = np.diag([1e-8, 1e-8, 1e-8, 1e-8, 1e-8])
# Places along each side of the pad where the weakest touch is looked for.
UNFELT_PLACES = 15
# A force that is this many deviations from none certainly is one.
CERTAIN_FORCE_DEVIATIONS = 2.0
# Where nothing is known of the place, it is still on the pad: deviation of an even spread over its width.
EVEN_SPREAD = 1.0 / sqrt(12.0)


@dataclass(frozen=True, slots=True)
class ContactEstimate:
    """x_m, y_m, force_n, their covariance (3, 3) in SI, all finite; (5, 5) where there is shear as well.

    over_range: the pose or the force is beyond what the model was trained on; then the three are those of the nearest
    pose that it knows, and only force_min_n, a lower bound of the force, is to be believed. None otherwise.
    lifted_m: how far the magnet certainly is above where any trained press, or none, has it; zero if it is not.
    central_force_sd_n: the deviation of the same force, were it felt in the middle of the pad: where nothing is felt,
    there is no place whose errors could count. shear_n: (2,) tangential force along x and y, None from a model of three
    outputs. refused: a model of five outputs found the press outside of where shear can be told from place; none of its
    numbers is to be believed.
    """

    x_m: float
    y_m: float
    force_n: float
    covariance: Array
    over_range: bool
    force_min_n: float | None
    lifted_m: float
    central_force_sd_n: float
    shear_n: Array | None = None
    refused: bool = False

    @property
    def x_sd_m(self) -> float:
        return float(np.sqrt(self.covariance[0, 0]))

    @property
    def y_sd_m(self) -> float:
        return float(np.sqrt(self.covariance[1, 1]))

    @property
    def force_sd_n(self) -> float:
        return float(np.sqrt(self.covariance[2, 2]))


class ContactModel:
    """A verified model. `hash`: first 12 hex digits of the file's SHA-256.

    refiner: moves each answer to the most likely press, None to leave it. friction: of the finger; the shear that it
    may exert, and a model of three outputs does not know, widens the deviations. smoothing_s: memory of the
    filter that every pad's poses pass first. response: of the pad that it was trained for, None where it holds none.
    """

    response: Response | None = None

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
        self.smoothing_s = smoothing_s
        self.has_shear = facts.outputs == SHEAR_OUTPUT_ORDER
        self._unit = CONTACT_UNIT[: len(facts.outputs)]
        self.rest_pose = np.array(facts.rest_pose)
        # The axis's last component follows from the others, and not in proportion: it takes no part.
        self.lowest = np.array([*facts.envelope.pose_min[:5], -np.inf])
        # A magnet above its rest height is not a squeeze, however it came there.
        self.highest = np.array([*facts.envelope.pose_max[:2], np.inf, *facts.envelope.pose_max[3:5], np.inf])
        self.trained_top_mm = facts.envelope.pose_max[2]
        own, fit = facts.own_error, facts.response_error
        of_network = np.stack(own.tables, axis=-1) * self._unit
        of_response = 0.0 if fit is None else np.stack(fit.tables, axis=-1) * self._unit
        of_friction = np.broadcast_to(self._friction_deviation(friction), of_network.shape)
        # To refine takes the network's own error away: what remains is that of the response.
        trained = of_response if refiner else root_of_squares(of_network, of_response)
        self.own_deviation = root_of_squares(trained, of_friction)
        self.trained_force_n = np.broadcast_to(trained, of_network.shape)[..., 2]
        self.slipping_n = of_friction[-1, :, 2]  # what shear does to the largest force, by radius
        self.force_bins_n, self.radius_bins_m = np.array(own.force_n[:-1]), np.array(own.radius_mm[:-1]) * 1e-3
        self.edges_m = np.array([facts.envelope.x_mm, facts.envelope.y_mm]) * 1e-3
        self.spread_m = np.diff(self.edges_m, axis=1)[:, 0] * EVEN_SPREAD

    @property
    def plain(self) -> bool:
        """Three outputs of single frames: what the compiled path of a frame can do by itself."""
        return not self.has_shear and self.smoothing_s == 0.0 and (self.refiner is None or self.refiner.compiled)

    def _friction_deviation(self, friction: float) -> Array | float:
        """In the bins of the own error: of shear anywhere within the cone of friction, the force at the bin's end."""
        tables = self.facts.friction_error
        if tables is None or self.has_shear:
            return 0.0
        force_max_n = self.facts.envelope.force_max_n
        # The last bin has no end: forces in it reach to the largest.
        force_n = np.append(np.minimum(tables.force_n[:-1], force_max_n), force_max_n)
        shear_n = friction * force_n / np.sqrt(2.0)  # rms over the disc of radius µF
        deviation: Array = np.stack(tables.tables, axis=-1) * self._unit * shear_n[:, None, None]
        return deviation

    @classmethod
    def load(
        cls, path: str, pad: Pad, *, refine: bool = False, friction: float = 0.0, smoothing_s: float = 0.0
    ) -> Self:
        """The model at `path`, or one of contact/shipped.py, for `pad`; ModelError names what is wrong with it."""
        file = path_of(path)
        try:
            content = read(file)
            parsed = parse(content)
            check_versions(parsed)
            inference = inference_of(content, parsed.graph)
            facts, response = parse_facts(parsed.metadata), parse_response(parsed.metadata)
            if refine and response is None:
                raise ValueError("it holds no response of its pad, so that it cannot be refined: set refine = false")
            if len(inference.contact) != len(facts.outputs):
                raise ValueError("it has another number of outputs than its metadata says")
            inference = compared(inference, content, facts)
        except ValueError as error:
            raise ModelError(f"contact model {file}: {error}; {REMEDY}") from error
        if facts.geometry_hash != pad.geometry_hash:
            raise ModelError(
                f"contact model {file} was trained for a pad of other dimensions ({facts.geometry_hash}) than "
                f"pad {pad.name!r} has ({pad.geometry_hash}): correct [pad.geometry] and [pad.magnet], or calibrate "
                "this pad and set [pad.contact] model"
            )
        refiner = Refiner(response) if refine and response is not None else None
        model = cls(inference, facts, hashlib.sha256(content).hexdigest()[:12], refiner, friction, smoothing_s)
        model.response = response
        contact, jacobian = model._infer(model.rest_pose)  # also warms the session up
        if not (np.isfinite(contact).all() and np.isfinite(jacobian).all()):
            raise ModelError(f"contact model {file}: it does not answer with numbers for the rest pose; {REMEDY}")
        return model

    def estimate(self, position_m: Array, axis: Array, covariance: Array) -> ContactEstimate:
        """Location and force of one pose, relative to the nominal rest pose.

        position_m (3,), unit axis (3,), covariance (6, 6) of both. ValueError if any is not finite: no number goes out
        that none went in for.
        """
        pose = np.concatenate([position_m, axis]) * POSE_UNIT
        pose_covariance = covariance * POSE_UNIT * POSE_UNIT[:, None]
        if not (np.isfinite(pose).all() and np.isfinite(pose_covariance).all()):
            raise ValueError("a contact was asked for of a pose that is not finite")
        slack = OUTSIDE_DEVIATIONS * np.sqrt(np.maximum(np.diagonal(pose_covariance), 0.0))
        lifted_mm = pose[2] - self.trained_top_mm - LIFTED_DEVIATIONS * slack[2] / OUTSIDE_DEVIATIONS
        share = self._share_inside(pose, slack)
        # Above its rest no press has the magnet, and a network that was never shown one there reads any force from it.
        pose[2] = min(pose[2], self.trained_top_mm)
        if share < 1.0:
            pose = self.rest_pose + share * (pose - self.rest_pose)
            # What is uncertain of a displacement grows with it: a bound must not fall because the squeeze rose.
            pose_covariance = pose_covariance * square(share)
        contact, spread, central_variance = self._contact(pose, pose_covariance)
        limit_n = self.facts.envelope.force_max_n
        force_sd = float(np.sqrt(spread[2, 2]))
        over_range = share < 1.0 or self._too_hard(contact, spread)
        certain_n = max(min(float(contact[2]), limit_n) - CERTAIN_DEVIATIONS * force_sd, 0.0)
        x_m, y_m, force_n = contact[:3].tolist()
        lifted_m = max(float(lifted_mm) - HYSTERESIS_MM, 0.0) * 1e-3
        return ContactEstimate(
            x_m,
            y_m,
            force_n,
            spread,
            over_range,
            certain_n if over_range else None,
            lifted_m,
            float(np.sqrt(central_variance)),
            contact[3:] if self.has_shear else None,
            self.has_shear and self._outside(contact),
        )

    def detection_limit_n(self, covariance: Array, chi2: float) -> float:
        """The largest force on the pad that changes a resting pose by less than `chi2`: at a corner, usually.

        covariance (6, 6): of position in m and axis, of one frame at rest. Zero for a model that holds no response.
        """
        if self.response is None:
            return 0.0
        whole = (covariance * POSE_UNIT * POSE_UNIT[:, None])[:CHANGE, :CHANGE] + TINY
        x_mm, y_mm = np.meshgrid(*(np.linspace(*side, UNFELT_PLACES) for side in self._sides_mm), indexing="ij")
        press = np.zeros((x_mm.size, 2 + self.response.loads))
        press[:, 0], press[:, 1] = x_mm.ravel(), y_mm.ravel()
        by_force = self.response.change_and_slope(press)[1][:, :, 2]
        chi2_of_one_newton = square(solve_lower(cholesky(whole), by_force.T)).sum(axis=0)
        return float(np.sqrt(chi2 / chi2_of_one_newton.min()))

    @property
    def _sides_mm(self) -> tuple[tuple[float, float], tuple[float, float]]:
        return self.facts.envelope.x_mm, self.facts.envelope.y_mm

    def _outside(self, contact: Array) -> bool:
        """Is the place beyond where the model was asked to answer?"""
        return bool((contact[:2] < self.edges_m[:, 0]).any() or (contact[:2] > self.edges_m[:, 1]).any())

    def _too_hard(self, contact: Array, spread: Array) -> bool:
        """Is the force of the pose, whatever shear may have a part in it, beyond the calibrated?"""
        beyond_n = contact[2] - self.facts.envelope.force_max_n
        slipping_n = self.slipping_n[np.searchsorted(self.radius_bins_m, root_of_squares(contact[0], contact[1]))]
        return bool(
            beyond_n > 0.0 and square(beyond_n) > square(OUTSIDE_DEVIATIONS) * (spread[2, 2] - square(slipping_n))
        )

    def _share_inside(self, pose: Array, slack: Array) -> float:
        """The largest share, at most 1, of the displacement from rest that stays in the envelope widened by `slack`.

        Displacement grows with force at every place, so a share of it belongs to no larger force.
        """
        displacement = pose - self.rest_pose
        room = np.where(displacement > 0.0, self.highest + slack, self.lowest - slack) - self.rest_pose
        moved = np.abs(displacement) > 1e-9
        return float(min(np.min(room[moved] / displacement[moved], initial=1.0), 1.0))

    def _contact(self, pose: Array, pose_covariance: Array) -> tuple[Array, Array, float]:
        """Contact (m,) and covariance (m, m) in SI: the pose's, carried over by the Jacobian, and the model's own.

        Last the variance of the same force in the middle of the pad.
        """
        contact, jacobian = self._infer(pose)
        carried = product(jacobian, pose_covariance, jacobian.T)
        if self.refiner is not None:
            change = (pose - self.rest_pose)[:CHANGE]
            contact, carried = self.refiner.refined(contact, change, pose_covariance[:CHANGE, :CHANGE] + TINY)
        contact = contact * self._unit
        force_bin = np.searchsorted(self.force_bins_n, contact[2])
        radius_bin = np.searchsorted(self.radius_bins_m, root_of_squares(contact[0], contact[1]))
        carried = carried * self._unit * self._unit[:, None]
        spread = carried + np.diag(square(self.own_deviation[force_bin, radius_bin]))
        central_variance = float(carried[2, 2] + square(self.own_deviation[force_bin, 0, 2]))
        certain, even = 1.0 - doubt(float(contact[2]), float(carried[2, 2])), square(self.spread_m)
        # A light touch in the middle may read as a harder one at the rim, which no Jacobian tells.
        variance = float(carried[2, 2] + square(self.trained_force_n[force_bin, radius_bin]))
        spread[[0, 1], [0, 1]] += certain * astray_share(doubt(float(contact[2]), variance)) * even
        wider = np.ones(len(contact))
        wider[:2] = np.sqrt(even / np.maximum(np.diagonal(spread)[:2], certain * even))
        spread = spread * wider * wider[:, None]
        # Beyond the pad's edge the model was never trained, and its Jacobian means nothing.
        for axis in np.flatnonzero((contact[:2] < self.edges_m[:, 0]) | (contact[:2] > self.edges_m[:, 1])):
            spread[axis], spread[:, axis] = 0.0, 0.0
            spread[axis, axis] = square(self.spread_m[axis])
        return contact, spread, central_variance

    def _infer(self, pose: Array) -> tuple[Array, Array]:
        self.inference.pose[:] = pose
        self.inference.run()
        return self.inference.contact.astype(np.float64), self.inference.jacobian.astype(np.float64)


def doubt(force_n: float, variance: float) -> float:
    """How far a force may be none for its noise, from 0 to 1: g of Fieller's theorem. A place is a ratio, of how the
    magnet tilts and shifts over how far it sinks, and such a ratio's deviation grows by 1/√(1 − g)."""
    least = square(CERTAIN_FORCE_DEVIATIONS) * variance
    return least / square(force_n) if force_n > 0.0 and least < square(force_n) else 1.0


def astray_share(doubt: float) -> float:
    """The chance that a place is quite another one: it falls with the doubt of its force, to the power of 2.5."""
    return doubt * doubt * sqrt(doubt)
