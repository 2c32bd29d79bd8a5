"""Computes the noise and the bias of every model at the contact, to first order.

Unknowns cause noise: with the Jacobian J of the field by the unknowns, the pose has the covariance P = σ²(JᵀJ)⁻¹, and a
press that changes the pose by S per unit has the covariance C = (SᵀP⁻¹S)⁻¹. Effects that the model neglects cause bias:
a change δ of the field that no unknown explains causes the bias C SᵀP⁻¹ (JᵀJ)⁻¹Jᵀδ.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from fmfts.config import PadConfig
from fmfts.contact.response import CHANGE
from fmfts.pad import Array, Magnet, Pad
from fmfts.pose import State, tangent_basis
from fmfts.pose._alignment import REACH_M, REACH_RAD
from fmfts.pose.change import shortest_rotation
from fmfts.pose.dipole import dipole_field, octupole_m2
from fmfts.pose.kernel import predict
from fmfts.pose.problem import DIRECTION, measurement_rows
from fmfts.pose.state import Neighbour
from fmfts_lab.scene.candidate import AMBIENT_CHANGE_T, RUNNING, UNKNOWNS, Cost, Model, Surroundings

PLACES_MM, LOAD_SHARES = (-8.0, -4.0, 0.0, 4.0, 8.0), (0.15, 0.5, 1.0)


def costs(surroundings: Surroundings, thorough: bool = True) -> list[Cost]:
    """The costs of all models, the smallest model first.

    thorough: False takes only models that can run, and every fifth press.
    """
    names = [other.name for other in surroundings.others]
    neighbours = [tuple(names[:count]) for count in range(len(names) + 1)]
    models = [Model(*each) for each in product(UNKNOWNS if thorough else RUNNING, (False, True), neighbours)]
    pad, poses = surroundings.config.pad(), list(_pressed(surroundings))[:: 1 if thorough else 5]
    reference = [_Frame.of(pad, pose, surroundings.noise_t, Model(5, True)).noise for pose in poses]
    all_costs = [_cost(surroundings, pad, poses, model, np.array(reference)) for model in models]
    return sorted(all_costs, key=lambda cost: cost.model.size)


@dataclass(frozen=True, slots=True)
class _Pressed:
    """state: of the magnet. slope (5, 3): derivative of its pose by the press. turn (3, 3): from axes with z along the
    rest axis to the drawing's axes."""

    state: State
    slope: Array
    turn: Array


def _pressed(surroundings: Surroundings) -> Iterator[_Pressed]:
    """Yields the poses of presses all over the pad, from light to full force."""
    pad = surroundings.config.pad()
    loads = np.array(LOAD_SHARES) * surroundings.response.scale_n
    press = np.array(list(product(PLACES_MM, PLACES_MM, loads)))
    if surroundings.response.loads > 1:
        press = np.hstack([press, np.zeros((len(press), surroundings.response.loads - 1))])
    change, slope = surroundings.response.change_and_slope(press)
    turn = shortest_rotation(np.array([0.0, 0.0, 1.0]), pad.rest_axis)
    for one, by_press in zip(change, slope[:, :, :3], strict=True):
        axis = turn @ np.append(one[3:], np.sqrt(1.0 - one[3:] @ one[3:]))
        yield _Pressed(State(pad.rest_position_m + one[:3] * 1e-3, axis, 0.0, np.zeros(3)), by_press, turn)


@dataclass(frozen=True, slots=True)
class _Frame:
    """noise (3,): standard deviations of the press. to_press (3, 3N): its error per unmodelled field."""

    noise: Array
    to_press: Array

    @classmethod
    def of(cls, pad: Pad, pressed: _Pressed, noise_t: float, model: Model) -> _Frame:
        rows = measurement_rows(np.zeros((len(pad.sensors), 3)), pad.sensors, noise_t)
        _, jacobian = predict(rows, _magnets(pad.magnet, model), pressed.state)
        jacobian = jacobian[:, UNKNOWNS[model.unknowns]]
        # Columns differ by ten powers of ten: scale them to one length before inverting.
        length = np.linalg.norm(jacobian, axis=0)
        inverse = np.linalg.pinv(jacobian / length, rcond=1e-12) / length[:, None]
        to_pose = np.zeros((CHANGE, CHANGE))
        to_pose[:3, :3] = np.eye(3) * 1e3
        to_pose[3:, 3:] = (pressed.turn.T @ tangent_basis(pressed.state.axis))[:2]
        pose = to_pose @ inverse[:CHANGE]
        weight = np.linalg.inv(noise_t**2 * pose @ pose.T)
        covariance = np.linalg.inv(pressed.slope.T @ weight @ pressed.slope)
        return cls(np.sqrt(np.diagonal(covariance)), covariance @ pressed.slope.T @ weight @ pose)


def _cost(surroundings: Surroundings, pad: Pad, poses: Sequence[_Pressed], model: Model, reference: Array) -> Cost:
    rest = _causes(surroundings, pad, State.at_rest(pad), model)
    noise, bias = [], []
    for pressed in poses:
        frame = _Frame.of(pad, pressed, surroundings.noise_t, model)
        causes = _causes(surroundings, pad, pressed.state, model)
        # The baseline has removed the cylinder's term at rest.
        causes["cylinder"] = causes["cylinder"] - rest["cylinder"]
        noise.append(frame.noise)
        bias.append([np.sqrt(np.sum((frame.to_press @ field) ** 2, axis=1)) for field in causes.values()])
    noises, biases = np.array(noise), np.array(bias)
    total_bias = np.sqrt(np.sum(biases**2, axis=1))
    avoidable = [not (surroundings.drifts and cause == "moment") for cause in rest]
    errors = np.sqrt(noises**2 + np.sum(biases[:, avoidable] ** 2, axis=1))
    by_cause = np.sqrt(np.mean((biases / reference[:, None]) ** 2, axis=(0, 2)))
    return Cost(
        model,
        rms(noises[:, :2]),
        rms(total_bias[:, :2]),
        rms(noises[:, 2]),
        rms(total_bias[:, 2]),
        rms(errors / reference),
        dict(zip(rest, by_cause.tolist(), strict=True)),
    )


def _causes(surroundings: Surroundings, pad: Pad, state: State, model: Model) -> dict[str, Array]:
    """Cause → (3N, n) changes of the field by one standard deviation, which no unknown of `model` explains."""
    rows = measurement_rows(np.zeros((len(pad.sensors), 3)), pad.sensors, surroundings.noise_t)
    field, _ = predict(rows, _magnets(pad.magnet, replace(model, cylinder=True)), state)
    modelled, _ = predict(rows, _magnets(pad.magnet, model), state)
    absent = np.zeros((len(rows), 1))
    knows_moment, knows_field = model.unknowns in (5, 8), model.unknowns in (5, 6)
    causes = {
        "cylinder": (field - modelled)[:, None],
        "moment": field[:, None] * surroundings.moment_deviation if knows_moment else absent,
        "ambient": rows[:, DIRECTION] * AMBIENT_CHANGE_T if knows_field and surroundings.drifts else absent,
    }
    for other in surroundings.others:
        felt = other.name not in model.neighbours
        causes[f"pad '{other.name}'"] = _of_neighbour(surroundings.config, other, rows) if felt else absent
    return causes


def _of_neighbour(config: PadConfig, other: PadConfig, rows: Array) -> Array:
    """(3N, 5M) changes of the field by the neighbour's hardest press, along each direction of its magnets' poses."""
    placement = other.placement.si().seen_from(config.placement.si())
    size = np.array([REACH_M / np.sqrt(3.0)] * 3 + [REACH_RAD / np.sqrt(2.0)] * 2)
    columns = []
    for one, direction in product(other.pad().magnets, np.eye(CHANGE) * size):
        rest = Neighbour(placement.point(one.rest_position_m), placement.rotation @ one.rest_axis, 0.0)
        moved = rest.stepped(np.append(direction, 0.0))
        ends = [
            dipole_field(rows[:, :3], place.position_m, place.axis, one.magnet.strength_t_m3) for place in (rest, moved)
        ]
        columns.append(np.sum(rows[:, DIRECTION] * (ends[1] - ends[0]), axis=1))
    return np.stack(columns, axis=1)


def _magnets(magnet: Magnet, model: Model) -> Array:
    return np.array([[magnet.strength_t_m3, octupole_m2(magnet) if model.cylinder else 0.0]])


def rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
