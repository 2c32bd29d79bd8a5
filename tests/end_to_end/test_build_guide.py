"""Who builds a pad by docs/build-a-pad.md reads there what is printed, and ends with a contact."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from end_to_end.build_guide import FORCE_N, PAGE, PLACE_M, Step, first_contact, follow, steps, wired


def test_every_command_of_the_page_is_found() -> None:
    typed = [step.command.split()[1:3] for step in steps(PAGE.read_text())]
    assert typed == [["init", "--i2c"], ["probe"], ["baseline", "--bare"], ["baseline", "--rest"]]


def test_a_line_that_is_not_printed_is_missed_and_another_figure_is_not() -> None:
    step = Step("x", ("position: (0.000, 1.000) mm", "faults: none"))
    assert step.missing("position: (-0.013, 0.980) mm\nfaults: none\n") == []
    assert step.missing("position: (0, 1) mm\nfaults: sensor 1\n") == ["faults: none"]
    assert step.missing("faults: none\nposition: (0, 1) mm\n") == ["faults: none"]  # in this order


# A frame's place is off by so much at this press (docs/chips.md: 1 σ of either axis together), its force by 2 to 10 %.
OFF_MM = {"A": 0.16, "B": 2.9, "D": 0.16}


@pytest.mark.slow
@pytest.mark.needs("arm-none-eabi-gcc", "faketime")
@pytest.mark.parametrize("build", OFF_MM)
def test_the_page_leads_from_an_empty_folder_to_the_first_contact(build: str, tmp_path: Path) -> None:
    with wired(build, tmp_path) as parts:
        assert follow(parts) == []
        said = first_contact(parts)
    onset = re.search(r"onset ([\d.]+) N at \(([-+\d.]+), ([-+\d.]+)\) mm", said)
    assert onset, said
    force_n, x_mm, y_mm = map(float, onset.groups())
    assert abs(force_n - FORCE_N) < 0.5 * FORCE_N, said
    assert np.hypot(x_mm - 1e3 * PLACE_M[0], y_mm - 1e3 * PLACE_M[1]) < 5 * OFF_MM[build], said
    assert "release after" in said, said
