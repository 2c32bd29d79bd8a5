"""The differences between a pad and the table's pad, from frames with unknown contacts.

A frame of N sensors has 3N values, and a contact has at most three unknowns: the residuals of the best contacts in many
frames determine the rest of each sensor, the moment of all magnets and the gain of the change. Each round finds the
contacts, takes away from the residuals what a contact could still explain, and solves the remainder for these unknowns,
with priors (variable projection: Golub and Pereyra, SIAM J. Numer. Anal. 10 (1973) 413).

If the load is a force or shear, the gain is not estimated: a softer pad and a larger force look the same, and a gain
from frames without labels makes forces worse. A table without a place is not changed at all.
"""

from __future__ import annotations

import numpy as np

from fmfts.pad import Array
from fmfts_skin.calibrate.field_set import FieldSet, Mask
from fmfts_skin.field_contact import ContactFinder
from fmfts_skin.field_response import FieldResponse, Instance

MOST_FRAMES = 800
ROUNDS, SETTLED = 12, 1e-3
# Priors of what differs: the rest if none was recorded, the rest if one was, the moment, the gain.
REST_UT, KNOWN_REST_UT = 60.0, 5.0
MOMENT, GAIN = 0.02, 0.15
# A frame that no contact explains counts less; neighbouring frames share their error, so each counts a quarter.
LARGEST_CHI2_OF_A_VALUE, INDEPENDENT = 2.0, 0.25


def is_told(response: FieldResponse) -> bool:
    """Whether frames without labels determine anything about an instance."""
    return response.load > 0


def instance_of(response: FieldResponse, data: FieldSet) -> list[tuple[Mask, Instance]]:
    """For each recording of a set: its rows, and the instance that explains them. No label is used."""
    rests = data.rest_ut()
    out = []
    for number in range(len(data.recordings)):
        rows = (data.recording == number) & ~data.rest
        if not rows.any():
            continue
        known = bool(np.isfinite(rests[rows]).all())
        start = Instance(rests[rows] if known else response.reference_ut)
        if is_told(response):
            start = explained(response, data.field_ut[rows], start, KNOWN_REST_UT if known else REST_UT)
        out.append((rows, start))
    return out


def explained(response: FieldResponse, field_ut: Array, start: Instance, rest_deviation_ut: float) -> Instance:
    """The instance that explains fields (K, P), near `start`."""
    finder = ContactFinder(response)
    chosen = np.unique(np.linspace(0, len(field_ut) - 1, min(MOST_FRAMES, len(field_ut))).astype(int))
    field = field_ut[chosen]
    values = field.shape[1]
    rest = np.broadcast_to(start.rest_ut, field_ut.shape)[chosen]
    learns_gain = response.axes[-1].name == "depth_mm"
    prior = np.concatenate([np.full(values, rest_deviation_ut), [MOMENT, GAIN if learns_gain else 1e-9]]) ** -2.0
    unknown = np.zeros(values + 2)
    for _ in range(ROUNDS):
        step = _step(finder, field, rest, unknown, prior)
        unknown = unknown + step
        if (np.abs(step) * np.sqrt(prior)).max() < SETTLED:
            break
    return Instance(start.rest_ut + unknown[:values], float(unknown[-2]), float(unknown[-1]))


def _step(finder: ContactFinder, field: Array, rest: Array, unknown: Array, prior: Array) -> Array:
    """Gauss–Newton for the unknowns: rest of each value, moment, gain."""
    values = field.shape[1]
    now = Instance(rest + unknown[:values], float(unknown[-2]), float(unknown[-1]))
    change = now.change_ut(field)
    found = finder.find(change)
    felt = finder.response.felt(found.contact)
    # The change by each unknown, relative to the table; each frame's moment may differ from the common one.
    by_unknown = np.concatenate(
        [
            np.broadcast_to(np.eye(values), (len(field), values, values)),
            (felt.change + rest)[:, :, None],
            felt.change[:, :, None],
        ],
        axis=2,
    )
    root = np.linalg.cholesky(finder.covariance_at(found.contact[:, -1]))
    white = np.linalg.solve(root, np.concatenate([(change - felt.change)[:, :, None], by_unknown, felt.slope], axis=2))
    basis, _ = np.linalg.qr(white[:, :, values + 3 :])
    left = white[:, :, : values + 3]
    left = left - basis @ (np.swapaxes(basis, 1, 2) @ left)
    residual, slope = left[:, :, 0], left[:, :, 1:]
    weight = INDEPENDENT / np.maximum(1.0, found.chi2 / (LARGEST_CHI2_OF_A_VALUE * values))
    normal = np.einsum("k,kpi,kpj->ij", weight, slope, slope, optimize=True) + np.diag(prior)
    gradient = np.einsum("k,kpi,kp->i", weight, slope, residual, optimize=True) - prior * unknown
    step: Array = np.linalg.solve(normal, gradient)
    return step
