"""Why collecting ends before the plan does."""

from __future__ import annotations


class CollectError(Exception):
    """Ends the work; the text says what happened and what to do. What was collected stays, and is gone on with."""


class RefusedError(CollectError):
    """The data, the plan or the pad are not what they should be (exit code 65)."""


class AbsentError(CollectError):
    """A device does not answer, or stopped answering (exit code 69)."""


class StoppedError(CollectError):
    """Something happened while the rod was down: it was lifted. The text is the reason (exit code 69)."""
