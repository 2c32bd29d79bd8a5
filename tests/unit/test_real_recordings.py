"""The figures of public recordings, as far as they need no recording."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from recorded_files import FOLDER, needs

from fmfts_lab.bench.__main__ import main
from fmfts_lab.real.figures import RECORDINGS, allan_deviation


def test_allan_deviation_of_white_noise_falls_with_root_of_count() -> None:
    counts = np.array([1, 4, 16, 64])
    noise = np.random.default_rng(1).normal(0.0, 2.0, 200_000)
    np.testing.assert_allclose(allan_deviation(noise, counts), 2.0 / np.sqrt(counts), rtol=0.05)


def test_allan_deviation_of_a_steady_drift_grows_with_the_count() -> None:
    """σ = rate · time / √2: IEEE 1139."""
    found = allan_deviation(0.01 * np.arange(10_000), np.array([10, 100]))
    np.testing.assert_allclose(found, [0.1 / np.sqrt(2.0), 1.0 / np.sqrt(2.0)], rtol=1e-6)


def test_absent_recordings_are_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.argv", ["bench", "real", "--recordings", str(tmp_path)])
    main()
    lines = capsys.readouterr().out.splitlines()
    assert [line.split(":")[0] for line in lines] == list(RECORDINGS)
    assert all("is absent" in line for line in lines)


@pytest.mark.parametrize(
    ("name", "page"),
    [
        ("waved-boards", "real.md"),
        ("unlabelled", "learned.md"),
        pytest.param("another-day", "real.md", marks=pytest.mark.long),
        pytest.param("rough-sketches", "learned.md", marks=pytest.mark.long),
    ],
)
def test_page_has_the_table_that_the_command_prints(name: str, page: str) -> None:
    shows, file = RECORDINGS[name]
    needs(file)
    text = (Path(__file__).parents[2] / "lab/results" / page).read_text(encoding="utf-8").splitlines()
    lines = shows(FOLDER).lines
    assert lines
    assert [line for line in lines if line not in text] == [], f"bench real --only {name}"


def test_every_recording_has_its_chart_and_its_source() -> None:
    folder = Path(__file__).parents[2] / "lab/results"
    text = (folder / "real.md").read_text() + (folder / "learned.md").read_text()
    for name, (_, file) in RECORDINGS.items():
        assert f"](real-{name}.svg)" in text
        assert (folder / f"real-{name}.svg").stat().st_size < 40_000
        assert file.split("/")[0] in text
