"""Reports of hardware in tests/data/reports, replayed: the frames, and the sensors that must be used."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from data.make_report import replayed
from fmfts_recording.replay import Replay
from fmfts_report.file import facts_of, lines_of

FOLDER = Path(__file__).parents[1] / "data" / "reports"
REPORTS = sorted(FOLDER.glob("*.mcap"))
EMULATED_BYTES, LARGEST_BYTES = 150_000, 1_000_000


def test_each_kept_report_is_small_and_explained() -> None:
    text = (FOLDER / "README.md").read_text()
    assert REPORTS
    for path in REPORTS:
        assert f"`{path.name}`" in text
        assert path.stat().st_size < (EMULATED_BYTES if "emulated" in path.stem else LARGEST_BYTES)


@pytest.mark.parametrize("path", REPORTS, ids=lambda path: path.stem)
def test_kept_report_replays_as_its_expectation_demands(path: Path) -> None:
    models = [str(each) for suffix in (".onnx", ".response") if (each := path.with_suffix(suffix)).exists()]
    assert replayed(path, models) == json.loads(path.with_suffix(".json").read_text())


@pytest.mark.parametrize("path", REPORTS, ids=lambda path: path.stem)
def test_kept_report_shows_its_facts_as_text(path: Path) -> None:
    facts = facts_of(path)
    shown = "\n".join(lines_of(path))
    for bus in facts["buses"]:
        for chip in bus.get("chips", ()):
            assert all(line in shown for line in chip["registers"])
    assert facts["machine"]["kernel"] in shown
    for pad, count in facts["recorded"].get("frames", {}).items():
        assert f"frame/{pad}: {count}" in shown


def test_emulated_report_replays_to_the_contacts_that_it_holds() -> None:
    replay = Replay(FOLDER / "qmc5883l-emulated.mcap")
    assert sum(1 for _ in replay.contacts()) > 150
    assert replay.comparison.is_the_same


def test_emulated_report_has_each_chips_registers() -> None:
    """The values are of the QMC5883L's data sheet: 13-52-04, section 9; 100 Hz and ±2 G in control 1 (0x09)."""
    (bus,) = facts_of(FOLDER / "qmc5883l-emulated.mcap")["buses"]
    assert [(chip["chip"], chip["address"], chip["channel"]) for chip in bus["chips"]] == [
        ("qmc5883l", 0x0D, channel) for channel in range(4)
    ]
    for chip in bus["chips"]:
        registers = dict(line.split(": ") for line in chip["registers"])
        assert list(registers) == ["0x00", "0x06", "0x07", "0x09"]
        assert len(registers["0x00"].split()) == 6
        assert registers["0x09"].split()[0] == "09"  # continuous, rate code 2
        assert registers["0x09"].split()[-1] == "ff"  # identification
