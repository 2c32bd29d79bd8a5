"""What both kinds of contact models do with a frame of a pad that has a rest recording, and what they remember."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.matrix import SingularError
from fmfts.baseline.rest_field import RestField
from fmfts.bus.messages import Health
from fmfts.common.chi2 import quantile
from fmfts.pad import Pad
from fmfts.pose import Aligned

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

# The rest of each value drifts with the silicone's temperature and with earlier presses.
REST_UT = 5.0
FALSE_CONTACTS_PER_HOUR = 1.0
# A contact is kept while it lowers χ² by more than this share of the decrease that started it.
KEEPS = 0.5
FREE_FIELD = 3  # values that the ambient field takes
LONGEST_GAP_S = 0.05


@dataclass(slots=True)
class SkinMemory:
    """contact (D,): of the last frame, meaningful while `touching`. last_us: the board's time of that frame. last_c:
    the last temperature that was told."""

    contact: Array
    touching: bool = False
    last_us: int | None = None
    last_c: float | None = None

    def see(self, aligned: Aligned, temperature_c: float | None, rate_hz: float) -> None:
        """Note a frame's time and temperature. After a long gap a touch needs an onset again."""
        elapsed_s = aligned.elapsed_s(self.last_us)
        self.last_us = aligned.time_us
        self.last_c = self.last_c if temperature_c is None else temperature_c
        if elapsed_s > max(LONGEST_GAP_S, 2.5 / rate_hz) or aligned.began_anew:
            self.touching = False

    def stronger(self, first_c: float | None, magnet_per_k: float) -> float:
        """How much stronger the magnets are than at the temperature `first_c`, as a factor."""
        return 1.0 if first_c is None or self.last_c is None else 1.0 + magnet_per_k * (self.last_c - first_c)


class SkinReading(NamedTuple):
    """The result of one frame. used (N, 3): the axes that it was made from. contact, deviation (D,): of a contact.

    touching: None where it is not known. beyond: the contact lies at the table's end, or beyond it.
    """

    health: Health
    reason: str
    used: Mask
    touching: bool | None = None
    contact: Array | None = None
    deviation: Array | None = None
    beyond: bool = False


@dataclass
class RestedPad(ABC):
    """Judges the frames of a pad that has a rest recording; each kind of model says what a contact is.

    ambient_t: by how much the ambient field may differ from the recording's, along each axis. repeats_allowed (N, 3):
    of an axis that is not stuck. magnet_per_k: temperature coefficient of the remanence.
    """

    pad: Pad
    mounting: RestField
    ambient_t: float
    rate_hz: float
    repeats_allowed: Array
    magnet_per_k: float
    memory: SkinMemory = field(init=False)
    _onset_chi2: float = field(init=False)
    _foreign_t2: Array | None = field(init=False, default=None)  # for this frame: see Aligned
    untold: ClassVar[str]  # why there is no contact if too few values are left

    def watch(self, unknowns: int, places: int = 1) -> None:
        """Expect contacts of so many unknowns, which may begin at so many places that can be told apart."""
        self.memory = SkinMemory(np.zeros(unknowns), last_c=self.mounting.temperature_c)
        per_frame = FALSE_CONTACTS_PER_HOUR / (3600.0 * self.rate_hz)
        self._onset_chi2 = quantile(min(per_frame / places, 0.01), unknowns)

    def forget_touch(self) -> None:
        self.memory.touching = False

    def read(self, aligned: Aligned, temperature_c: float | None, missing: Mapping[int, str]) -> SkinReading:
        """Judge one aligned frame. missing: what is wrong with sensors that cannot be used."""
        self.memory.see(aligned, temperature_c, self.rate_hz)
        used = np.isfinite(aligned.field_t) & (aligned.repeats <= self.repeats_allowed)
        told = [f"sensor {sensor + 1} is {why}" for sensor, why in missing.items()]
        self._foreign_t2 = aligned.foreign_t2
        try:
            return self._judged(aligned.field_t, used, told)
        except SingularError:
            return self._none("lost", self.untold, used)

    @abstractmethod
    def _judged(self, field_t: Array, used: Mask, told: list[str]) -> SkinReading:
        """The result of the `used` ones of fields (N, 3). told: the missing sensors. May raise SingularError."""

    @property
    def _needed_chi2(self) -> float:
        """The amount by which a contact has to lower χ²."""
        return self._onset_chi2 * (KEEPS if self.memory.touching else 1.0)

    def _by_ambient(self) -> Array:
        """(3N, 3): each value by the ambient field, along the pad's axes: the sensors' own axes."""
        return self.pad.sensors.axes.transpose(0, 2, 1).reshape(-1, FREE_FIELD)

    def _as_at_rest(self, field_t: Array) -> Array:
        """Fields as they would be at the rest recording's temperature."""
        return field_t / self.memory.stronger(self.mounting.temperature_c, self.magnet_per_k)

    def _none(self, health: Health, reason: str, used: Mask) -> SkinReading:
        """It is not known whether anything touches."""
        self.memory.touching = False
        return SkinReading(health, reason, used)


def health_of(whole: bool, told: list[str]) -> tuple[Health, str]:
    """The health of a frame with or without a contact, and the reason. whole: from all its values."""
    reason = "; ".join(told) or ("" if whole else "axes are saturated or stuck, and are left out")
    return "ok" if whole else "degraded", reason
