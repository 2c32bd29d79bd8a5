"""A request that is answered later, when its task has ended. Every such request gets an answer."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from typing import Any

from fmfts.baseline import BaselineError
from fmfts.baseline.files import StateError
from fmfts.bus.control import Request
from fmfts.common.exit_codes import UNAVAILABLE
from fmfts.sensor import SourceError
from fmfts.sensor.tasks import Task

# A client that hears nothing for 5 s thinks that the daemon is dead.
PROGRESS_S = 0.5

log = logging.getLogger(__name__)


class Pending:
    """Before it sends the facts of a finished task, it calls `done`, in which the daemon uses the result.

    done: returns what it adds to the facts.
    """

    def __init__(self, request: Request, pad: str, task: Task, done: Callable[[], dict[str, float]] = dict) -> None:
        self.task = task
        self.pad = pad
        self._request = request
        self._done = done
        self._told_s = time.monotonic()
        self._report()

    def settle(self, now_s: float) -> bool:
        """Answer if the task has ended or failed, else report progress from time to time. True: it was answered."""
        try:
            return self._reply(self.task.facts()) or self._give_up(self.task.problem(now_s)) or self._tell(now_s)
        except (BaselineError, SourceError, StateError) as error:
            log.warning("%s", error)
            self._request.refuse(error)
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # also SystemExit: no task ends the daemon
            log.exception("%s: internal error, worth reporting", self._request.verb)
            fail_internally(self._request, error)
        return True

    def _reply(self, facts: dict[str, Any] | None) -> bool:
        if facts is None:
            return False
        self._request.reply(**facts, **self._done())
        return True

    def _give_up(self, problem: str) -> bool:
        if problem:
            self._request.fail(f"pad '{self.pad}': {problem}", UNAVAILABLE)
        return bool(problem)

    def _tell(self, now_s: float) -> bool:
        if now_s - self._told_s >= PROGRESS_S:
            self._told_s = now_s
            self._report()
        return False

    def _report(self) -> None:
        hint = {"hint": self.task.hint} if self.task.hint else {}
        self._request.progress(share=self.task.share, **hint)


def fail_internally(request: Request, error: BaseException) -> None:
    """Answer a request with an unexpected error; the daemon goes on."""
    if not request.answered:
        request.fail(f"internal error, worth reporting with the daemon's log: {type(error).__name__}: {error}")
