"""What the daemon needs of a contact model of another package: only descriptions."""

from __future__ import annotations

from typing import Protocol


class PluggedModel(Protocol):
    @property
    def hash(self) -> str:
        """Hash of the file's content, as messages and recordings name it."""

    @property
    def told(self) -> str:
        """A short description for the log."""

    @property
    def calibrated_range(self) -> dict[str, object]:
        """The places and forces that it was calibrated for."""
