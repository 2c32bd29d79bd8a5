"""A configuration or a plan that was made to take minutes is refused at once, with one sentence."""

from __future__ import annotations

from pathlib import Path

import pytest

from fmfts.collect.plan import PlanError, read_plan
from fmfts.common.toml import LARGEST_BYTES, MOST_PARTS, parse
from fmfts.config.file import MOST_PADS, ConfigError, load

HARMFUL = {
    "long": "#" * (LARGEST_BYTES + 1),
    "key of many parts": "a." * 20_000 + "a = 1",
    "key of quoted parts": '"". ' * 20_000 + "a = 1",
    "header of many parts": "[" + "a . " * 20_000 + "a]",
    "nested lists": "a = " + "[" * 50_000,
    "nested tables": "a = " + "{a = " * 20_000,
    "huge integer": "a = " + "9" * 100_000,
}


@pytest.mark.parametrize("text", HARMFUL.values(), ids=HARMFUL)
def test_harmful_toml_is_refused(text: str, tmp_path: Path) -> None:
    path = tmp_path / "a.toml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=r"a\.toml: ") as refusal:
        load(path)
    assert len(str(refusal.value)) < 1000
    with pytest.raises(PlanError, match=r"a\.toml: "):
        read_plan(str(path))


def test_key_of_as_many_parts_as_allowed_is_read() -> None:
    assert list(parse(".".join("a" * MOST_PARTS) + " = 1\nb = '1.2.3'\n[c]\nd = [1.5, 2.5]\n")) == ["a", "b", "c"]


def test_configuration_of_too_many_pads_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text("[[pad]]\n" * (MOST_PADS + 1))
    with pytest.raises(ConfigError, match=f"has {MOST_PADS + 1} pads, and may have {MOST_PADS}"):
        load(tmp_path / "a.toml")


def test_plan_of_too_many_presses_is_refused(tmp_path: Path) -> None:
    forces = ", ".join(f"{number}.5" for number in range(1, 200))
    (tmp_path / "a.toml").write_text(
        f"[lattice]\nfirst_mm = [0, 0]\nspacing_mm = 1\ncount = [1000, 1000]\nforces_n = [{forces}]\n"
    )
    with pytest.raises(PlanError, match="more than 100000 presses"):
        read_plan(str(tmp_path / "a.toml"))
