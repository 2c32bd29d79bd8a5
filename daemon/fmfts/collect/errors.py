"""The errors that end collecting before the plan is done."""

from __future__ import annotations


class CollectError(Exception):
    """Ends the work; the text says what happened and what to do. The rows stay; the same command continues."""


class RefusedError(CollectError):
    """The data, the plan or the pad cannot be used (exit code 65)."""


class AbsentError(CollectError):
    """A device does not answer, or stopped answering (exit code 69)."""


class NotWrittenError(CollectError):
    """The rows cannot be written (exit code 73)."""


class StoppedError(CollectError):
    """Something went wrong while the rod was down, and the rod was lifted. The text is the reason (exit code 69)."""
