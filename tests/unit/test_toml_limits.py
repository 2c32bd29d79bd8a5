"""A configuration or a plan that was made to take minutes is refused at once, with one sentence."""

from __future__ import annotations

from pathlib import Path

import pytest

from fmfts.common.toml import LARGEST_BYTES, MOST_PARTS, parse
from fmfts.config.file import MOST_PADS, ConfigError, load
from fmfts_collect.plan import PlanError, read_plan

MANY_PARTS = f"begins a key of more than {MOST_PARTS} parts"
HARMFUL = {
    "long": ("#" * (LARGEST_BYTES + 1), f"longer than {LARGEST_BYTES} bytes"),
    "key of many parts": ("a." * 20_000 + "a = 1", MANY_PARTS),
    "key of one part too many": ("a." * MOST_PARTS + "a = 1", MANY_PARTS),
    "key of quoted parts": ('"". ' * 20_000 + "a = 1", MANY_PARTS),
    "key of literal parts": ("''. " * 20_000 + "a = 1", MANY_PARTS),
    "key of long parts": (f"{'b' * 1000}." * 100 + "a = 1", MANY_PARTS),
    "header of many parts": ("[" + "a . " * 20_000 + "a]", MANY_PARTS),
    "nested lists": ("a = " + "[" * 50_000, "nested too deep"),
    "nested tables": ("a = " + "{a = " * 20_000, "nested too deep"),
    "huge integer": ("a = " + "9" * 100_000, "integer"),
}


@pytest.mark.parametrize(("text", "why"), HARMFUL.values(), ids=HARMFUL)
def test_harmful_toml_is_refused(text: str, why: str, tmp_path: Path) -> None:
    path = tmp_path / "a.toml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=rf"a\.toml: .*{why}") as refusal:
        load(path)
    assert len(str(refusal.value)) < 1000
    with pytest.raises(PlanError, match=rf"a\.toml: .*{why}"):
        read_plan(str(path))


def test_key_of_as_many_parts_as_allowed_is_read() -> None:
    assert list(parse(".".join("a" * MOST_PARTS) + " = 1\nb = '1.2.3'\n[c]\nd = [1.5, 2.5]\n")) == ["a", "b", "c"]


def test_configuration_as_long_as_that_of_64_pads_is_read() -> None:
    assert parse("a = 1\n" + "#" * 100_000) == {"a": 1}


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
