"""A reader who builds a pad by docs/build-a-pad.md sees the printed output there, and ends with a contact."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from end_to_end.build_guide import FORCE_N, PAGE, PLACE_M, Step, first_contact, follow, steps, wired


def test_every_command_of_the_page_is_found() -> None:
    typed = [step.command.split()[1:3] for step in steps(PAGE.read_text())]
    assert typed == [["init", "--i2c"], ["probe"], ["baseline", "--bare"], ["baseline", "--rest"]]


def test_guide_reports_absent_lines_but_ignores_other_figures() -> None:
    step = Step("x", ("position: (0.000, 1.000) mm", "faults: none"))
    assert step.missing("position: (-0.013, 0.980) mm\nfaults: none\n") == []
    assert step.missing("position: (0, 1) mm\nfaults: sensor 1\n") == ["faults: none"]
    assert step.missing("faults: none\nposition: (0, 1) mm\n") == ["faults: none"]  # in this order


# Errors of one frame's place and force (docs/chips.md: rms), and the error that bare and rest leave for a press of 1 N.
CHIPS_LEAVE = {"A": (0.16, 0.010), "B": (2.94, 0.181), "D": (0.16, 0.010)}
BASELINE_LEAVES = 0.031, 0.008


@pytest.mark.slow
@pytest.mark.needs("arm-none-eabi-gcc", "faketime")
@pytest.mark.parametrize("build", CHIPS_LEAVE)
def test_page_leads_from_an_empty_folder_to_the_first_contact(build: str, tmp_path: Path) -> None:
    with wired(build, tmp_path) as parts:
        assert follow(parts) == []
        said = first_contact(parts)
    # Once a second, while the press is held; at its onset the chips' fields change one after another.
    told = re.findall(r"ok  ([\d.]+) N at \(([-+\d.]+), ([-+\d.]+)\) mm", said)
    assert told, said
    force_n, x_mm, y_mm = np.median(np.array(told, float), axis=0)
    off_mm, off_n = np.hypot(CHIPS_LEAVE[build], BASELINE_LEAVES)
    assert abs(force_n - FORCE_N) < 3 * off_n, said
    assert np.hypot(x_mm - 1e3 * PLACE_M[0], y_mm - 1e3 * PLACE_M[1]) < 3 * off_mm, said
    assert "release after" in said, said
