"""What C needs to know of a pad is filled from its configuration, baseline and model (pipeline/parameters.py)."""

from __future__ import annotations

import numpy as np
import pytest
from test_pipeline import config_of

from fmfts.common.record import Record
from fmfts.contact import ContactModel
from fmfts.pipeline._pad import MEMORY, PARAMETERS
from fmfts.pipeline.baselined_pad import BaselinedPad
from fmfts.pipeline.first_memory import KEPT, first_memory
from fmfts.pipeline.lead import Lead
from fmfts.pipeline.parameters import parameters_of, put_neighbours
from fmfts.scene.tracking import tracking_model_for
from fmfts_simulation.baseline import simulated_baseline

CONFIG = config_of(5, ambient="drifting")
SCENE = tracking_model_for(CONFIG.scene, CONFIG.magnet)


def baselined() -> BaselinedPad:
    return BaselinedPad.of(CONFIG.pad(), simulated_baseline(CONFIG), SCENE.tracking)


def test_every_parameter_is_filled(monkeypatch: pytest.MonkeyPatch) -> None:
    """One that nobody fills is zero, and C would compute with that."""
    filled: set[str] = set()
    put = Record.put

    def noting(record: Record, name: str, value: object) -> None:
        filled.add(name)
        put(record, name, value)  # type: ignore[arg-type]

    monkeypatch.setattr(Record, "put", noting)
    model = ContactModel.load("default", CONFIG.pad(), refine=True)
    parameters = parameters_of(CONFIG.pad(), baselined(), model, 220.0, Lead(1e-3, 1e-3))
    put_neighbours(parameters, [])
    assert {name for name, _, _ in PARAMETERS} - filled == set()


def test_parameter_that_does_not_fit_is_refused() -> None:
    record = Record([("gain", "<f8", 3), ("rate", "<f8", 0)])
    with pytest.raises(ValueError, match="gain: 4 values, room for 3"):
        record.put("gain", np.ones(4))
    with pytest.raises(ValueError, match="no field of name"):
        record.put("gian", 1.0)


def test_every_memory_field_has_a_first_value() -> None:
    assert {name for name, _, _ in MEMORY} == set(first_memory(CONFIG.pad(), baselined())) | set(KEPT)
