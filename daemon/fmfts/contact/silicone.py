"""A contact model on silicone that is stiffer, or softer, than that of its pad: the same model, in other newtons.

Silicone that is stiffer by a factor takes as much more force for the same movement, exactly. So every force grows by
this factor, and nothing else changes.
"""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
from numpy.typing import NDArray

from fmfts.contact.contract import ErrorTables, Facts, Table
from fmfts.contact.inference import CompiledInference, Inference, NetworkInference
from fmfts.contact.response import Response

FORCE = 2  # the first output that is one; the shears follow


class InOtherNewtons(Inference):
    """Runs another inference, and multiplies its forces."""

    def __init__(self, model: Inference, stiffness: float) -> None:
        super().__init__(len(model.contact))
        self.by, self._model, self._stiffness = model.by, model, stiffness

    def run(self) -> None:
        self._model.pose[:] = self.pose
        self._model.run()
        for own, theirs in ((self.contact, self._model.contact), (self.jacobian, self._model.jacobian)):
            own[:] = theirs
            own[FORCE:] *= self._stiffness


def inference_of(model: Inference, stiffness: float) -> Inference:
    if not isinstance(model, NetworkInference):
        return InOtherNewtons(model, stiffness)
    network: NDArray[np.float32] = np.frombuffer(model.network, np.float32).copy()
    hidden, outputs = int(network[0]), int(network[1])
    last_layer = network[-(hidden + 1) * outputs :].reshape(hidden + 1, outputs)  # network.h: w3, then b3
    last_layer[:, FORCE:] *= np.float32(stiffness)
    return CompiledInference(network)


def response_of(response: Response, stiffness: float) -> Response:
    return replace(response, scale_n=response.scale_n * stiffness)


def facts_of(facts: Facts, stiffness: float) -> Facts:
    envelope, friction = facts.envelope, facts.friction_error
    return msgspec.structs.replace(
        facts,
        envelope=msgspec.structs.replace(envelope, force_max_n=envelope.force_max_n * stiffness),
        own_error=errors_of(facts.own_error, 1.0, stiffness, stiffness),
        response_error=facts.response_error and errors_of(facts.response_error, 1.0, stiffness, stiffness),
        # For a newton of shear.
        friction_error=friction and errors_of(friction, 1.0 / stiffness, 1.0, stiffness),
    )


def errors_of(errors: ErrorTables, of_place: float, of_force: float, of_bins: float) -> ErrorTables:
    """The tables, with places, forces and the bins of force times these."""
    shear = errors.shear_error_n
    return ErrorTables(
        force_n=tuple(each * of_bins for each in errors.force_n),
        radius_mm=errors.radius_mm,
        x_mm=_times(errors.x_mm, of_place),
        y_mm=_times(errors.y_mm, of_place),
        force_error_n=_times(errors.force_error_n, of_force),
        shear_error_n=shear and _times(shear, of_force),
    )


def _times(table: Table, factor: float) -> Table:
    return tuple(tuple(each * factor for each in row) for row in table)
