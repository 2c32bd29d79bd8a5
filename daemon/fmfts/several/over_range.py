"""Whether a finger is beyond the table of presses, in force or in place."""

from __future__ import annotations

from fmfts.contact.array_response import ArrayResponse
from fmfts.several.fit import Fit

EDGE_MM = 0.5  # a search beyond the table's edge ends this near to it
CERTAIN_DEVIATIONS = 6.0  # of its force: such a finger's place is known to less than the table's width


def is_over_range(response: ArrayResponse, fit: Fit) -> bool:
    """Beyond the table, place and force are not known. The place of a weak finger is so
    uncertain that the search may end at the table's edge."""
    if not len(fit.fingers):
        return False
    first, last, most = response.first_mm + EDGE_MM, response.last_mm - EDGE_MM, response.scale_n
    return any(
        force > most or (force > CERTAIN_DEVIATIONS * force_sd and not first < min(x, y) <= max(x, y) < last)
        for (x, y, force), force_sd in zip(fit.fingers.tolist(), fit.force_deviations_n, strict=True)
    )
