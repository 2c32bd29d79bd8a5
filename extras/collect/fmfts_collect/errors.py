"""The errors that end collecting before the plan is done."""

from __future__ import annotations

from fmfts.common import exit_codes


class CollectError(Exception):
    """Ends the work; the text says what happened and what to do. The rows stay; the same command continues."""

    code = exit_codes.UNAVAILABLE


class RefusedError(CollectError):
    """The data, the plan or the pad cannot be used."""

    code = exit_codes.DATA


class AbsentError(CollectError):
    """A device does not answer, or stopped answering."""


class NotWrittenError(CollectError):
    """The rows cannot be written."""

    code = exit_codes.UNWRITABLE


class StoppedError(CollectError):
    """Something went wrong while the rod was down, and the rod was lifted. The text is the reason."""
