"""Contact methods that go from the field to the contact without a pose."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np

from fmfts.config import PadConfig
from fmfts.pad import Array
from fmfts.pose import State, tangent_basis
from fmfts.pose.kernel import predict
from fmfts.pose.problem import VALUE, magnet_rows, measurement_rows
from fmfts.scene.tracking import AMBIENT_WALK_T2_PER_S
from fmfts.sensor.chips import NOISE_T
from fmfts_lab.calibration.regressors import BackPropagation, RadialBasis
from fmfts_lab.calibration.simulated import rest_field_of
from fmfts_lab.study.contact_bench import Bench, ContactFinder, regressor_of
from fmfts_lab.study.learned import SEED, Nearest, Network
from fmfts_lab.study.pose_methods import TRAINED_ON, known_of, seen
from fmfts_lab.study.world import Sample


class FromField:
    """A learned function from field to press. The field is first corrected with the baseline's field at rest."""

    def __init__(self, bench: Bench, function: Callable[[Array], Array]) -> None:
        self._bench, self._function = bench, function
        drawn = rest_field_of(bench.world.drawing)
        # A magnet of another strength changes all fields in proportion, to first order.
        self._ratio = bench.world.drawing.magnet.remanence_t / bench.mounting.remanence_t(bench.world.drawing)
        self._shift = drawn - self._ratio * bench.mounting.rest_field_t

    def ask(self, sample: Sample) -> Array:
        return self._function(seen(self._bench.world, self._ratio * self._bench.field(sample) + self._shift))

    def told(self, raw: Array) -> Array | None:
        return np.asarray(raw, dtype=float)


def nearest(count: int, bench: Bench) -> ContactFinder:
    known = known_of(bench.world.config)
    return FromField(bench, Nearest(known.inputs, known.press, count))


def network(kind: str, size: tuple[int, ...], bench: Bench) -> ContactFinder:
    return FromField(bench, Network(_trained_on_fields(kind, size, bench.world.config)))


@lru_cache(maxsize=64)
def _trained_on_fields(kind: str, size: tuple[int, ...], config: PadConfig) -> BackPropagation | RadialBasis:
    """A regressor trained like those on poses: with noise, and each press weighted by the information of a frame."""
    known, random = known_of(config), np.random.default_rng(SEED)
    some = slice(None, None, len(known.press) // TRAINED_ON)
    inputs = (known.inputs + random.normal(0.0, NOISE_T, known.inputs.shape))[some]
    light = np.maximum(known.press[some, 2], 0.02)
    return regressor_of(kind, size).fit(inputs, known.press[some], 1.0 / ((0.3 / light) ** 2 + 0.2**2))


class OneStep:
    """Place and force directly from the field: a look-up, then one Gauss–Newton step. Ambient field (a random walk) and
    moment (known to half a per cent) are nuisance unknowns."""

    MOMENT = 5e-3

    def __init__(self, bench: Bench) -> None:
        world = bench.mounted
        self._bench, self._response, self._pad = bench, bench.response, world.drawing
        self._from_pad = bench.mounting.pad_turn.T  # turns the axes in which presses move the magnet into the sensors'
        self._rows = measurement_rows(np.zeros((len(self._pad.sensors), 3)), self._pad.sensors, world.noise_t)
        self._magnets, self._noise_t = magnet_rows(self._pad.magnet), world.noise_t
        self._ambient, self._variance = np.zeros(3), np.full(3, 1e-6**2)
        self._table = nearest(1, bench)

    def ask(self, sample: Sample) -> Array:
        press = np.maximum(self._table.ask(sample), [-np.inf, -np.inf, 0.02])
        change, by_press = (values[0] for values in self._response.change_and_slope(press[None]))
        axis = self._pad.rest_axis + tangent_basis(self._pad.rest_axis) @ change[3:]
        axis = axis / np.sqrt(axis @ axis)
        state = State(self._pad.rest_position_m + self._from_pad @ change[:3] * 1e-3, axis, 0.0, self._ambient)
        self._rows[:, VALUE] = self._bench.field(sample).ravel()
        predicted, jacobian = predict(self._rows, self._magnets, state)
        to_step = np.zeros((5, 5))
        to_step[:3, :3] = 1e-3 * self._from_pad
        to_step[3:, 3:] = tangent_basis(axis).T @ tangent_basis(self._pad.rest_axis)
        slope = np.concatenate([jacobian[:, :5] @ to_step @ by_press[:, :3], jacobian[:, 5:9]], axis=1)
        self._variance = self._variance + AMBIENT_WALK_T2_PER_S * sample.elapsed_s
        # A weak prior for place and force: half the pad, and the whole range of force.
        prior = np.r_[[1.0 / 20.0**2] * 2, 1.0 / 2.0**2, self.MOMENT**-2, 1.0 / self._variance]
        normal = slope.T @ slope / self._noise_t**2 + np.diag(prior)
        covariance = np.linalg.inv(normal)
        step = covariance @ (slope.T @ (self._rows[:, VALUE] - predicted) / self._noise_t**2)
        self._ambient, self._variance = self._ambient + step[4:], np.diagonal(covariance)[4:]
        return np.asarray(press + step[:3])

    def told(self, raw: Array) -> Array | None:
        return raw
