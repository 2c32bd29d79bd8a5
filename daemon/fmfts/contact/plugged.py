"""What the daemon asks of a contact model of another package: only what it tells of it to people."""

from __future__ import annotations

from typing import Protocol


class PluggedModel(Protocol):
    @property
    def hash(self) -> str:
        """Hash of the file's content, as messages and recordings name it."""

    @property
    def told(self) -> str:
        """What it is, in a few words for the log."""

    @property
    def calibrated_range(self) -> dict[str, object]:
        """The places and forces that it was calibrated for."""
