"""The bench of `collecting_bench.py`, with a simulated pad of four magnets, in silicone that no shipped table is of."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from end_to_end.collecting_bench import ORIGIN_MM, PressedBench
from fmfts.contact.array_response import ArrayResponse
from fmfts.pad import Array
from fmfts_simulation.array import SimulatedArray
from fmfts_simulation.finger import Touch

SOURCE = """type = "simulated"
seed = 3
range_gauss = 8.1
turning_deg_per_s = 0
[pad.geometry]
sensors_mm = [[12, 0, 0], [-12, 0, 0], [0, 12, 0], [0, -12, 0], [12, 12, 0], [12, -12, 0], [-12, 12, 0], [-12, -12, 0]]
[[pad.magnet]]
rest_mm = [6, 6, 12]
[[pad.magnet]]
rest_mm = [6, -6, 12]
rest_axis = [0, 0, -1]
[[pad.magnet]]
rest_mm = [-6, 6, 12]
rest_axis = [0, 0, -1]
[[pad.magnet]]
rest_mm = [-6, -6, 12]
"""


def stiffer(response: ArrayResponse, factor: float, deeper: float) -> ArrayResponse:
    """Of silicone that needs `factor` times the force, and whose magnets sink `deeper` times as far."""
    powers = (1.0 / factor) ** np.arange(1, response.coefficient.shape[2] + 1)
    unit = np.tile([1.0, 1.0, deeper, 1.0, 1.0], response.magnets)
    return replace(
        response,
        coefficient=response.coefficient * powers[:, None] * unit,
        shear=response.shear / factor,
        scale_n=response.scale_n * factor,
    )


class NoBoard:
    """It takes the firmware's place: the daemon's own source simulates the pad."""

    pid = 0

    def tell(self, command: str) -> None:
        pass

    def __exit__(self, *_: object) -> None:
        pass


class ArrayBench(PressedBench):
    """truth: how presses move this pad's magnets."""

    def __init__(self, folder: Path, **options: Any) -> None:
        super().__init__(folder, **options)
        text = self.config.read_text()
        self.config.write_text(text.replace(f'type = "bridge"\nport = "{folder}/board"\n', SOURCE))
        self.source = SimulatedArray(self._loaded().pad[0])
        inside = self.source.fields.inside
        self.source.fields.inside = replace(inside, response=stiffer(inside.response, 1.25, 0.9))
        self.source.finger, self.source.second_finger = self._touch, None

    def _made_board(self) -> Any:
        return NoBoard()

    def _touch(self, _: float) -> Touch:
        x_mm, y_mm = self._rod_mm[0] - ORIGIN_MM[0], self._rod_mm[1] - ORIGIN_MM[1]
        touches = self.force_n > 0.0
        return Touch(x_mm * 1e-3 * touches, y_mm * 1e-3 * touches, self.force_n, 0.0, 0.0)

    def _tell_field(self) -> None:
        self.source.mounted = self.mounted

    def raw_field_t(self, x_mm: float, y_mm: float, force_n: float, random: np.random.Generator) -> Array:
        """(8, 3) one frame of a press, as the chips report it."""
        source = self.source
        touch = Touch(x_mm * 1e-3, y_mm * 1e-3, force_n, 0.0, 0.0)
        at = source.fields.inside.field(source.built.pad.sensors.position_m, [touch], 1.0)
        return np.asarray(source.built.sensed(at + source.built.ambient_t) + random.normal(0.0, 2e-7, (8, 3)))

    @contextmanager
    def _surroundings(self) -> Iterator[None]:
        pads = [(self.source, {0: "left"})]
        with super()._surroundings(), patch("fmfts.cli.feed.open_sources", lambda _: pads):
            yield
