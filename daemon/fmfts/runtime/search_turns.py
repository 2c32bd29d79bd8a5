"""Decides which pad may search fingers: at most one in each round of frames, in turn.

A frame whose fingers follow from those of the frame before takes a pad with several magnets 0.2 to 0.4 ms. If nothing
explains the field, it searches: for 2 to 3 ms, half of the time between two frames. Steel near a hand of sixteen
pads would make all of them search at once. So one pad searches in each round; the others judge their frames without a
search, and search in later rounds.

Rounds are counted in frames, not in time, and each frame records whether it may search. So a replay of one pad alone
gives the same result.
"""

from __future__ import annotations

from collections.abc import Iterable

from fmfts.pipeline.several_pipeline import SeveralPipeline
from fmfts.sensor import Frame
from fmfts.several.count import Search

# The first waiting pad loses its turn if it has no frame in this many rounds: it is absent.
PATIENCE_ROUNDS = 10


class SearchTurns:
    """A round ends with the next frame of the pad that searched or, if it is absent, after as many frames as there are
    pads.

    pads: with several magnets.
    """

    def __init__(self, pads: int) -> None:
        self._pads = pads
        self._searched: str | None = None  # the pad that searched in the present round
        self._waiting: dict[str, None] = {}  # pads whose search is due, in the order of their requests
        self._frames = 0  # frames since the search or, in a new round, since the first waiting pad had a frame

    def allowed(self, pad: str, frame: Frame) -> Frame:
        """The next frame of a pad, as it may search. Then `told` has to be called."""
        return frame if self._may_search(pad) else frame.without_search()

    def told(self, pad: str, search: Search) -> None:
        """The state of the search in this frame."""
        if search == "due":
            self._waiting.setdefault(pad)
            return
        self._waiting.pop(pad, None)
        if search == "made":
            self._searched, self._frames = pad, 0

    def _may_search(self, pad: str) -> bool:
        self._frames += 1
        if self._searched is not None:
            if pad != self._searched and self._frames < self._pads:
                return False
            self._searched, self._frames = None, 0
        if self._waiting and self._frames > PATIENCE_ROUNDS * self._pads:
            del self._waiting[next(iter(self._waiting))]
            self._frames = 0
        if pad != next(iter(self._waiting), pad):
            return False
        self._frames = 0
        return True


def turns_of(pipelines: Iterable[object]) -> SearchTurns:
    """For all pads with several magnets among these pipelines."""
    return SearchTurns(sum(isinstance(pipeline, SeveralPipeline) for pipeline in pipelines))
