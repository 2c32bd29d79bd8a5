"""The contact model of a pad with other silicone: the same network between linear maps.

A correction by factors (array_correction.py: "force", "shape" and "places") says that the pad moves under a press as
another pad does under another press:

    c(r, F) = S T(r', F'),   r' = r e^(−w) − δ,   F' = F / k

with S diagonal. The other pad's network answers r', F' from T. So this pad's network divides its inputs by S, and
answers r = (r' + δ) e^w and F = k F'. Nothing is trained, and no answer is less accurate.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import msgspec
import numpy as np

from fmfts.arithmetic.matrix import root_of_squares
from fmfts.contact import silicone
from fmfts.contact.contract import ErrorTables, Facts
from fmfts.contact.response import CHANGE, Response
from fmfts.pad import Array
from fmfts_calibrate.array_correction import KINDS, SCALARS
from fmfts_calibrate.bounds import answer_by_change
from fmfts_calibrate.evaluation import tables_of_squares
from fmfts_calibrate.network import ContactNetwork
from fmfts_calibrate.samples import Samples, presses_in_bins
from fmfts_calibrate.tracked import FrameSolver

JUDGED_IN_A_BIN = 500


@dataclass(frozen=True, slots=True)
class Reshaped:
    """stiffness: k. kinds (5,): the diagonal of S. wider: e^w. off_mm (2,): δ."""

    stiffness: float
    kinds: Array
    wider: float
    off_mm: Array

    @classmethod
    def of(cls, theta: Array, stiffness: float) -> Reshaped:
        """theta: of a Correction of one magnet. stiffness: of the corrected pad, over the model's."""
        return cls(
            float(stiffness * np.exp(-theta[0])),
            np.exp(theta[1:4])[KINDS],
            float(np.exp(theta[4])),
            theta[SCALARS : SCALARS + 2],
        )

    def network(self, network: ContactNetwork) -> ContactNetwork:
        scale = np.array([self.wider, self.wider, self.stiffness])
        layers = network.layers.scaled(np.append(self.off_mm * self.wider, 0.0), scale)
        return ContactNetwork(network.rest_pose, network.scale * self.kinds, layers)

    def response(self, response: Response) -> Response:
        return replace(
            silicone.response_of(response, self.stiffness),
            first_mm=(response.first_mm + self.off_mm) * self.wider,
            spacing_mm=response.spacing_mm * self.wider,
            coefficient=response.coefficient * self.kinds,
        )

    def facts(self, facts: Facts) -> Facts:
        facts = silicone.facts_of(facts, self.stiffness)
        envelope, friction, fit = facts.envelope, facts.friction_error, facts.response_error
        rest = np.array(facts.rest_pose)
        low, high = (
            (*(rest[:CHANGE] + (np.array(each) - rest)[:CHANGE] * self.kinds).tolist(), each[CHANGE])
            for each in (envelope.pose_min, envelope.pose_max)
        )
        x_mm, y_mm = (
            tuple(((np.array(side) + off) * self.wider).tolist())
            for side, off in zip((envelope.x_mm, envelope.y_mm), self.off_mm.tolist(), strict=True)
        )
        return msgspec.structs.replace(
            facts,
            envelope=msgspec.structs.replace(envelope, pose_min=low, pose_max=high, x_mm=x_mm, y_mm=y_mm),
            own_error=silicone.errors_of(facts.own_error, self.wider, 1.0, 1.0),
            response_error=fit and silicone.errors_of(fit, self.wider, 1.0, 1.0),
            friction_error=friction and silicone.errors_of(friction, self.wider, 1.0, 1.0),
        )


def sizes_of(change: Array) -> Array:
    """(K, 5) sizes of a change of pose (K, 5) without its direction: sideways, down and tilt."""
    size = np.abs(change)
    for pair in ([0, 1], [3, 4]):
        size[:, pair] = np.sqrt(np.mean(np.square(size[:, pair]), axis=1, keepdims=True))
    return size


def error_of(response: Response, facts: Facts, solver: FrameSolver, error: Array, scale: float) -> ErrorTables:
    """The errors of answers through a response's own errors (5,), relative to `sizes_of`, in addition to the facts.
    scale: common relative error of the labels' forces."""
    bins = facts.own_error.force_n
    press = presses_in_bins(response, bins, JUDGED_IN_A_BIN, np.random.default_rng(5))
    change, slope = response.change_and_slope(press)
    gain = answer_by_change(slope, Samples.expected(response, solver, press).covariance)
    square = np.einsum("kmi,ki->km", np.square(gain), np.square(error * sizes_of(change)))
    square[:, 2] += np.square(scale * press[:, 2])
    found = tables_of_squares(bins, press, square)
    if facts.response_error is None:
        return found
    both = [
        tuple(map(tuple, np.asarray(root_of_squares(np.array(one), np.array(other))).tolist()))
        for one, other in zip(facts.response_error.tables, found.tables, strict=True)
    ]
    return ErrorTables(bins, found.radius_mm, *both)
