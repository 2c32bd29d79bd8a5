"""A press that the change since the baseline hides, on a robot that turns after bare and rest alone."""

from __future__ import annotations

import numpy as np

from fmfts.pipeline.configured import load_contact_model
from fmfts_lab.bench.as_built import Cell, Defects, Kind, pad_config, trial
from fmfts_lab.bench.tool_ways import WAYS, Tool
from fmfts_lab.bench.tools import baseline_of, messages_beside
from fmfts_lab.bench.tools import pad_config as config_beside
from fmfts_simulation.finger import no_finger

SEED, PRESSES = 5101, 12


def test_light_press_is_found_while_the_robot_turns() -> None:
    """The change since the baseline is within its deviations for two of them, of 0.22 and 0.31 N on the rim."""
    defects = Defects(1.0, 0.05, True, stated=True)
    cells: dict[Kind, Cell] = {"bare + rest": Cell()}
    trial(defects, SEED, 20.0, cells, load_contact_model(pad_config(defects, False, "stated")), False, "stated")
    cell = cells["bare + rest"]
    assert (cell.presses, cell.missed, cell.wrong, cell.false_contacts) == (PRESSES, 0, 0, 0)


def test_tool_that_passes_slowly_is_no_press() -> None:
    """A press explains up to 0.96 of what it does to the pose."""
    (way,) = [way for way in WAYS if way.label == "passes 45 mm 0.05 m/s"]
    config = config_beside("turning", 2, "hand")
    tool = Tool(way, 0.02, np.random.default_rng([2, WAYS.index(way), 20000]))
    model = load_contact_model(config)
    messages, _ = messages_beside(config, baseline_of(config, "turning"), tool, no_finger, way.seconds, model)
    assert not any(message.contact for message in messages)
