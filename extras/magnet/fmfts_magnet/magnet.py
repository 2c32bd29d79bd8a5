"""Fits the hand's magnet to the readings, for many explanations of the board at once (Gauss–Newton with damping).

Unknown are the magnet's position and moment in each step, and the logarithm of each channel's scale. `pose/dipole.py`
has the field. It is linear in the moment, so three calls with unit moments give the field of all. Errors of gain,
rotation and place are the same in all steps: they enter as covariances of a channel's nine readings.

NumPy moves all explanations at once, which takes 0.3 ms for each of 245. One after the other, as arithmetic/descent.c
would, they take 5 ms each.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fmfts.pose.dipole import dipole_derivatives
from fmfts_magnet.hand import of_hand
from fmfts_magnet.readings import AMBIENT_T, FINITE_MAGNET, Array, Board, Hand, Readings

FIXED_SCALE_SD = 1e-3
FREE_SCALE_SD = 1.0
LOWEST_M = 4e-3
ROUNDS, STEPS_A_ROUND = 4, 6
UNUSED_T2 = 1.0  # variance of a reading that is not used


@dataclass(frozen=True, slots=True)
class Explanations:
    """H explanations.

    place (H, N): channel c is at this place of the drawing. turn (H, N, 3, 3): from the axes of a drawn chip to those
    of the real one. scale (H, N): what it reads of 1 T. free (H, N): the scale is fitted, from there. used (H, N): the
    channel is used.
    """

    place: NDArray[np.intp]
    turn: Array
    scale: Array
    free: NDArray[np.bool_]
    used: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.place)

    def __getitem__(self, which: Any) -> Explanations:
        return Explanations(*(getattr(self, name)[which] for name in self.__slots__))

    @classmethod
    def joined(cls, *parts: Explanations) -> Explanations:
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in cls.__slots__))


@dataclass(frozen=True, slots=True)
class Magnets:
    """position_m, moment (H, K, 3), moment in T·m³ as `Magnet.strength_t_m3`; log_scale (H, N)."""

    position_m: Array
    moment: Array
    log_scale: Array

    def __getitem__(self, which: Any) -> Magnets:
        return Magnets(self.position_m[which], self.moment[which], self.log_scale[which])

    @classmethod
    def joined(cls, *parts: Magnets) -> Magnets:
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in cls.__slots__))


@dataclass(frozen=True, slots=True)
class Fits:
    """magnets: the best. surprise (H,): −2 ln of the evidence, without what all explanations share. chi2 (H,): of the
    readings and of the person's words. by_channel (H, N): its part of the readings."""

    magnets: Magnets
    surprise: Array
    chi2: Array
    by_channel: Array

    def __getitem__(self, which: Any) -> Fits:
        return Fits(self.magnets[which], self.surprise[which], self.chi2[which], self.by_channel[which])

    @classmethod
    def joined(cls, *parts: Fits) -> Fits:
        arrays = (np.concatenate([getattr(part, name) for part in parts]) for name in cls.__slots__[1:])
        return cls(Magnets.joined(*(part.magnets for part in parts)), *arrays)


def fields(board: Board, magnets: Magnets) -> tuple[Array, Array, Array]:
    """The field (H, K, N, 3) at every place, and its derivatives by position and by moment (H, K, N, 3, 3)."""
    r = board.place_m - magnets.position_m[:, :, None, :]
    flat, nowhere = r.reshape(-1, 3), np.zeros(3)
    moment = np.repeat(magnets.moment.reshape(-1, 3), len(board), axis=0)
    by_position = np.zeros((len(flat), 3, 3))
    for axis in range(3):
        _, derivative, by_moment = dipole_derivatives(flat, nowhere, np.eye(3)[axis], 1.0)
        by_position += moment[:, axis, None, None] * derivative
    field = (by_moment * moment[:, None, :]).sum(axis=2)
    return field.reshape(r.shape), by_position.reshape(*r.shape, 3), by_moment.reshape(*r.shape, 3)


class Fitter:
    """Fits explanations of one set of readings."""

    def __init__(self, board: Board, readings: Readings, hand: Hand) -> None:
        self.board, self.readings, self.hand = board, readings, hand
        change = readings.change_t
        self.steps, self.channels = change.shape[:2]
        self.missing = ~np.isfinite(change)
        self.change = np.where(self.missing, 0.0, change)
        size2 = (self.change * self.change).sum(axis=2, keepdims=True)
        variance = readings.noise_t**2 + AMBIENT_T**2 + FINITE_MAGNET**2 * size2
        variance = np.where(self.missing, UNUSED_T2, variance)
        # (N, 3K, 3K): noise, gains of the axes, and rotation of the chip, in proportion to the readings.
        flat = np.moveaxis(self.change, 1, 0)  # (N, K, 3)
        causes = [flat * np.eye(3)[axis] * board.gain_sd for axis in range(3)]
        causes += [np.cross(np.eye(3)[axis], flat) * board.rotation_sd_rad for axis in range(3)]
        effect = np.stack(causes, axis=-1).reshape(self.channels, -1, 6)
        self.known = effect @ effect.transpose(0, 2, 1)
        self.known += np.eye(3 * self.steps) * np.moveaxis(variance, 1, 0).reshape(self.channels, -1)[:, :, None]
        # An unused channel: any reading up to the largest is as probable.
        anything = np.where(self.missing, UNUSED_T2, float(size2.max()))
        self.anything = np.eye(3 * self.steps) * np.moveaxis(anything, 1, 0).reshape(self.channels, -1)[:, :, None]

    def fit(self, explanations: Explanations, start: Magnets, rounds: int = ROUNDS) -> Fits:
        magnets = replace(start, log_scale=np.log(explanations.scale))
        for _ in range(rounds):
            whiten, _ = self._whiten(explanations, magnets)
            damping = np.full(len(explanations), 1e-3)
            residual, jacobian = self._system(explanations, magnets, whiten)
            for _ in range(STEPS_A_ROUND):
                normal = jacobian.transpose(0, 2, 1) @ jacobian
                gradient = (jacobian * residual[:, :, None]).sum(axis=1)
                diagonal = np.einsum("hii->hi", normal)
                damped = normal + np.eye(normal.shape[1]) * (diagonal * damping[:, None])[:, None, :]
                step = -np.linalg.solve(damped, gradient[:, :, None])[:, :, 0]
                tried = self._moved(magnets, step)
                residual_tried, jacobian_tried = self._system(explanations, tried, whiten)
                better = (residual_tried**2).sum(axis=1) < (residual**2).sum(axis=1)
                damping = np.where(better, damping * 0.1, damping * 10.0)
                magnets = Magnets(
                    np.where(better[:, None, None], tried.position_m, magnets.position_m),
                    np.where(better[:, None, None], tried.moment, magnets.moment),
                    np.where(better[:, None], tried.log_scale, magnets.log_scale),
                )
                residual = np.where(better[:, None], residual_tried, residual)
                jacobian = np.where(better[:, None, None], jacobian_tried, jacobian)
        return self._judged(explanations, magnets)

    def _judged(self, explanations: Explanations, magnets: Magnets) -> Fits:
        whiten, log_det = self._whiten(explanations, magnets)
        residual, jacobian = self._system(explanations, magnets, whiten)
        sign, information = np.linalg.slogdet(jacobian.transpose(0, 2, 1) @ jacobian)
        of_readings = (residual[:, : 3 * self.steps * self.channels] ** 2).reshape(len(residual), self.channels, -1)
        scale_sd = np.where(explanations.free, FREE_SCALE_SD, FIXED_SCALE_SD)
        chi2 = (residual**2).sum(axis=1)
        surprise = chi2 + log_det.sum(axis=1) + information + 2.0 * np.log(scale_sd).sum(axis=1)
        # Before any reading a moment of any size is as probable in its logarithm: then no scale is favoured.
        surprise += 3.0 * np.log((magnets.moment**2).sum(axis=2)).sum(axis=1)
        surprise = np.where((sign > 0) & np.isfinite(surprise), surprise, np.inf)
        return Fits(magnets, surprise, chi2, of_readings.sum(axis=2))

    def chips(self, explanations: Explanations, magnets: Magnets) -> Array:
        """The matrices (H, N, 3, 3) from a field in pad axes to each channel's reading."""
        axes = self.board.axes[explanations.place]
        return np.exp(magnets.log_scale)[:, :, None, None] * (explanations.turn @ axes.transpose(0, 1, 3, 2))

    def _whiten(self, explanations: Explanations, magnets: Magnets) -> tuple[Array, Array]:
        """W (H, N, 3K, 3K): Wᵀ·W is the inverse covariance of a channel's readings. (H, N): its determinant's ln."""
        _, by_position, _ = fields(self.board, magnets)
        at = self.picked(by_position, explanations.place)  # (H, N, K, 3, 3)
        chips = self.chips(explanations, magnets)[:, :, None] * self.board.place_sd_m
        moved = (chips @ at).reshape(*explanations.place.shape, -1, 3)
        covariance = self.known + moved @ moved.transpose(0, 1, 3, 2)
        covariance = np.where(explanations.used[:, :, None, None], covariance, self.anything)
        lower = np.linalg.cholesky(covariance)
        log_det = 2.0 * np.log(np.einsum("hcii->hci", lower)).sum(axis=2)
        whiten = np.linalg.inv(lower).astype(np.float64)
        return whiten, log_det

    def picked(self, at_places: Array, place: NDArray[np.intp]) -> Array:
        """(H, K, places, …) → (H, N, K, …): at the place of each channel."""
        each = np.arange(len(place))[:, None]
        return np.moveaxis(at_places, 1, 2)[each, place]

    def _system(self, explanations: Explanations, magnets: Magnets, whiten: Array) -> tuple[Array, Array]:
        """Whitened residuals (H, R) and their derivatives (H, R, unknowns): of readings, then of the person's words."""
        field, by_position, by_moment = fields(self.board, magnets)
        chips = self.chips(explanations, magnets)
        count, steps, channels = len(explanations), self.steps, self.channels
        place = explanations.place
        used = explanations.used[:, :, None, None]
        expected = np.einsum("hcij,hckj->hcki", chips, self.picked(field, place)) * used
        slopes = [chips[:, :, None] @ self.picked(each, place) * used[..., None] for each in (by_position, by_moment)]
        jacobian = np.zeros((count, channels, steps, 3, 6 * steps + channels))
        for step in range(steps):
            jacobian[:, :, step, :, 6 * step : 6 * step + 3] = slopes[0][:, :, step]
            jacobian[:, :, step, :, 6 * step + 3 : 6 * step + 6] = slopes[1][:, :, step]
        for channel in range(channels):
            jacobian[:, channel, :, :, 6 * steps + channel] = expected[:, channel]
        rows = 3 * steps
        difference = (expected - np.moveaxis(self.change, 1, 0)).reshape(count, channels, rows, 1)
        residual = (whiten @ difference).reshape(count, -1)
        whitened = (whiten @ jacobian.reshape(count, channels, rows, -1)).reshape(count, channels * rows, -1)
        words, by_unknowns = self._instructed(explanations, magnets)
        return np.concatenate([residual, words], axis=1), np.concatenate([whitened, by_unknowns], axis=1)

    def _instructed(self, explanations: Explanations, magnets: Magnets) -> tuple[Array, Array]:
        """The prior: of the hand, and of each channel's scale."""
        drawn = np.where(explanations.free, 0.0, np.log(explanations.scale))
        scale_sd = np.where(explanations.free, FREE_SCALE_SD, FIXED_SCALE_SD)
        rows, slopes = of_hand(self.hand, magnets.position_m, magnets.moment)
        slopes = np.concatenate([slopes, np.zeros((*rows.shape, self.channels))], axis=2)
        by_scale = np.zeros((len(rows), self.channels, slopes.shape[2]))
        by_scale[:, :, 6 * self.steps :] = np.eye(self.channels) / scale_sd[:, None, :]
        rows = np.concatenate([rows, (magnets.log_scale - drawn) / scale_sd], axis=1)
        return rows, np.concatenate([slopes, by_scale], axis=1)

    def _moved(self, magnets: Magnets, step: Array) -> Magnets:
        count, steps = len(step), self.steps
        change = step[:, : 6 * steps].reshape(count, steps, 6)
        # No step is longer than the height, in which the field changes by its own size.
        length = np.sqrt((change[..., :3] ** 2).sum(axis=2))
        share = np.minimum(1.0, 0.5 * magnets.position_m[..., 2] / np.maximum(length, 1e-12)).min(axis=1)
        change = change * share[:, None, None]
        position = magnets.position_m + change[..., :3]
        position[..., 2] = np.maximum(position[..., 2], LOWEST_M)
        log_scale = magnets.log_scale + np.clip(step[:, 6 * steps :] * share[:, None], -1.0, 1.0)
        return Magnets(position, magnets.moment + change[..., 3:], log_scale)
