"""The baseline that a pad uses: only with the board of its recording, and with its drift followed, if allowed."""

from __future__ import annotations

import logging

from fmfts.baseline import Baseline, Mounting
from fmfts.baseline.origin import Origin, foreign
from fmfts.pipeline.configured import Pipeline
from fmfts.pipeline.encoded import Answer
from fmfts.pipeline.pad_pipeline import PadPipeline
from fmfts.runtime.rebaselining import Rebaselining
from fmfts.runtime.recorders import Recorders
from fmfts.sensor import Source

log = logging.getLogger(__name__)

UNKNOWN_BOARD = "frames come, but the board has not identified itself yet, and the baseline belongs to one board"


class BaselineInUse:
    """origin: the pad's sensors, as the configuration names them; None: no board is compared with it."""

    def __init__(self, source: Source, pipeline: Pipeline, recorders: Recorders) -> None:
        self.origin: Origin | None = None
        self._source = source
        self._pipeline = pipeline
        self._recorders = recorders
        self._last: Baseline | None = None  # the chosen baseline, whose board may be absent
        self._board: object = None  # uid of the board that the baseline was last compared with
        self._rebaselining: Rebaselining | None = None

    @property
    def is_followed(self) -> bool:
        """Follows the drift; this needs all frames."""
        return self._rebaselining is not None

    @property
    def drift_m(self) -> float | None:
        """How far its rest has moved; None if drift is not followed."""
        return None if self._rebaselining is None else self._rebaselining.size_m

    def use(self, baseline: Baseline) -> None:
        """Use another baseline and forget the learned drift. BaselineError if it does not fit the pad."""
        mounting = self._pipeline.use(baseline)
        self._last = baseline
        self._board = self._source.state.board.get("uid")  # the caller has compared its board
        self._rebaselining = None
        wanted = None if self._recorders.config is None else self._recorders.config.rebaseline
        if (
            wanted is not None
            and wanted.enabled
            and baseline.rest is not None
            and isinstance(self._pipeline, PadPipeline)
            and isinstance(mounting, Mounting)
        ):
            self._rebaselining = Rebaselining(self._pipeline, baseline, mounting, wanted.si())
        self._recorders.state_changed()

    def board_is_known(self) -> bool:
        """Compare the baseline with the board whenever the board identifies itself. False until it has done so."""
        baseline, uid = self._last, self._source.state.board.get("uid")
        if baseline is None or baseline.origin is None or baseline.origin.uid is None or self.origin is None:
            return True
        if uid is None:
            self._board = None
            return False
        if uid != self._board:
            self._board = uid
            self._compare(baseline, baseline.origin, self.origin.on(self._source.state.board))
        return True

    def _compare(self, baseline: Baseline, whose: Origin, mine: Origin) -> None:
        """Use the baseline if it is this board's. Else continue without one, until its own board is back."""
        if not whose.agrees_with(mine):
            reason = foreign(self._pipeline.pad.name, whose, mine)
            log.error("%s", reason)
            self._rebaselining = None
            self._pipeline.refuse(reason)
            self._recorders.state_changed()
        elif self._pipeline.baseline is None:
            self.use(baseline)

    def drift_news(self, answer: Answer) -> str | None:
        """Take a frame's message. A sentence if it moved the rest."""
        if self._rebaselining is None or not self._rebaselining.saw(answer):
            return None
        self._recorders.state_changed()
        return f"rest drifted, {self._rebaselining.size_m * 1e6:.1f} µm since it was recorded"
