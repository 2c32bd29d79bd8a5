"""Hypothesis draws the same examples in each run, whatever ran before in the same process."""

from __future__ import annotations

import importlib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st


def drawn() -> list[tuple[int, str, str]]:
    found: list[tuple[int, str, str]] = []

    @given(st.integers(), st.floats(), st.text())
    def draw(whole: int, number: float, text: str) -> None:
        found.append((whole, repr(number), text))

    draw()
    return found


def test_examples_do_not_depend_on_what_is_imported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = drawn()
    assert len(before) > 9
    (tmp_path / "imported_meanwhile.py").write_text("NUMBERS = [12345, 6.789, 'a text of its own', 987654321]\n")
    monkeypatch.syspath_prepend(tmp_path)
    importlib.import_module("imported_meanwhile")
    assert drawn() == before
