"""docs/chips.md says what the chips' descriptions say."""

from __future__ import annotations

from fmfts_lab.study import chips_page


def test_tables_are_as_they_are_made() -> None:
    text = chips_page.PAGE.read_text(encoding="utf-8")
    assert text == chips_page.page(text), "make chips-page"
