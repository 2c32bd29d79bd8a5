"""What a reviewer looks for: how to report a weakness, whom the daemon trusts, and that it is no safety function."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
READ_BY_A_CONTROLLERS_AUTHOR = ["README.md", "docs/messages.md", "docs/threat-model.md"]


@pytest.mark.parametrize("page", [*READ_BY_A_CONTROLLERS_AUTHOR, "clients/python/README.md", "clients/c/README.md"])
def test_page_says_that_fmfts_is_no_safety_function(page: str) -> None:
    text = (ROOT / page).read_text()
    assert "fmfts is no safety function" in text
    assert "hat a controller must do itself" in text


def test_controllers_duties_name_fields_that_exist() -> None:
    text = (ROOT / "docs/messages.md").read_text()
    duties = text.partition("## What a controller must do itself")[2].partition("\n## ")[0]
    for word in ("silence", "t_publish_ns", "t_sample_ns", "health", "force_sd_n", "over_range", "hardware"):
        assert word in duties
    rest = text.replace(duties, "")
    assert [
        name for name in re.findall(r"`([a-z]+_[a-z_]+)`", duties) if f"`{name}`" not in rest + "`fmfts_valid`"
    ] == []


@pytest.mark.parametrize("page", ["README.md", "docs/README.md", "docs/security.md", "docs/threat-model.md"])
def test_page_leads_to_the_way_to_report_a_weakness(page: str) -> None:
    assert re.search(r"\]\((?:\.\./)?SECURITY\.md\)", (ROOT / page).read_text())


def test_reports_say_how_when_and_for_what() -> None:
    text = (ROOT / "SECURITY.md").read_text()
    assert re.findall(r"^## (.+)$", text, flags=re.MULTILINE) == [
        "Report a weakness",
        "Which versions are supported",
        "What is in scope",
    ]
    assert re.findall(r"within (\d+) days", text) == ["7", "14", "90"], "an answer, an opinion, a fix"
    assert re.findall(r"\S+@\S+|https?://\S+", text) == [], "an address must be known to work before it stands here"


@pytest.mark.parametrize("who", ["ordinary account", "network", "file from elsewhere", "USB", "browser"])
def test_threat_model_says_what_each_stranger_can_do(who: str) -> None:
    chapter = (ROOT / "docs/threat-model.md").read_text().partition("## Who is not")[2].partition("\n## ")[0]
    (row,) = [line for line in chapter.splitlines() if line.startswith("|") and who in line.split("|")[1]]
    assert all(cell.strip() for cell in row.strip("|").split("|"))


def test_each_way_in_names_existing_tests() -> None:
    doors = (ROOT / "lab/results/doors.md").read_text().partition("\n## ")[0]
    rows = [line.split("|") for line in doors.splitlines() if line.startswith("| ") and not line.startswith("| door")]
    targets = re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE)
    assert len(rows) >= 20
    for row in rows:
        named = re.findall(r"`([^`]+)`", row[4])
        assert named, row[1]
        for name in named:
            assert name.removeprefix("make ") in targets or (ROOT / "tests" / name).is_file(), name
