"""Facts as a person reads them after `probe`, `baseline` and `selftest`."""

from __future__ import annotations

import json

import pytest

from fmfts.view.facts import print_facts


@pytest.mark.parametrize(
    ("facts", "line"),
    [
        ({"rest_position_m": [-5.4e-8, 1.234e-4, 0.012]}, "rest position: (0.000, 0.123, 12.000) mm"),
        ({"remanence_t": 1.23}, "remanence: 1.2300 T"),
        ({"remanence_sd_t": 0.0123}, "remanence sd: 0.0123 T"),
        ({"ambient_t": [2e-5, -4.3e-5, 0.0]}, "ambient: (20.000, -43.000, 0.000) µT"),
        ({"rest_axis_sd_rad": 0.01}, "rest axis sd: 0.57 °"),
        ({"mux_address": 112}, "mux address: 0x70"),
        ({"channels": [0, 1]}, "channels: (0, 1)"),
        ({"faults": []}, "faults: none"),
        ({"temperature_c": None}, "temperature: – °C"),
        ({"chi2": 3.25}, "χ² of the fit: 3.2500"),
    ],
)
def test_figures_have_the_units_and_digits_of_a_workshop(
    capsys: pytest.CaptureFixture[str], facts: dict[str, object], line: str
) -> None:
    print_facts(facts, as_json=False)
    assert capsys.readouterr().out == line + "\n"


def test_empty_facts_are_omitted_and_pads_separated(capsys: pytest.CaptureFixture[str]) -> None:
    pads = [{"pad": name, "reason": "", "board": {}, "faults": []} for name in ("left", "right")]
    print_facts({"pads": pads, "could_gain": []}, as_json=False)
    assert capsys.readouterr().out.splitlines() == ["pad: left", "faults: none", "", "pad: right", "faults: none"]


def test_programs_get_si_units(capsys: pytest.CaptureFixture[str]) -> None:
    facts = {"rest_position_m": [-5.4e-8], "reason": "", "mux_address": 112}
    print_facts(facts, as_json=True)
    assert json.loads(capsys.readouterr().out) == facts
