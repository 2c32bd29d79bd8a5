"""The pages about chips agree with the chips' descriptions."""

from __future__ import annotations

from pathlib import Path

import pytest

from fmfts_lab.study import chips_page


@pytest.mark.parametrize("page", chips_page.PAGES, ids=lambda page: page.name)
def test_kept_tables_match_their_command(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert text == chips_page.page(text, chips_page.PAGES[page]), "make chips-page"
