"""docs/chips.md says what the chips' descriptions say."""

from __future__ import annotations

from fmfts_lab.study import chips_page


def test_page_is_as_it_is_made() -> None:
    assert chips_page.PAGE.read_text(encoding="utf-8") == chips_page.page(), "make chips-page"
