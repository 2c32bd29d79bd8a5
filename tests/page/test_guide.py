"""First use in the browser: cards that say what to do with one's hands, and run the verbs on a real board."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser

from end_to_end.first_use import EARTH_T
from end_to_end.processes import resting_field
from page.conftest import Bench
from page.rig import CHROMIUM, opened, until

pytestmark = [pytest.mark.needs(CHROMIUM), pytest.mark.slow]


@pytest.fixture(scope="module")
def new_bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    """A board of which nothing is recorded."""
    bench = Bench(tmp_path_factory.mktemp("new"))
    yield bench
    bench.close()


def test_guided_first_use_records_both_baselines_and_says_why_one_is_refused(
    browser: Browser, new_bench: Bench
) -> None:
    bench = new_bench
    bench.board.field(EARTH_T)
    page = opened(browser, bench.view.address)
    until(page, "document.querySelector('#health').dataset.health === 'no_baseline'")
    page.keyboard.press("g")
    state = "document.querySelectorAll('#cards > li')[{}].dataset.state === '{}'"

    def run(card: int, ends: str) -> str:
        page.click(f"#cards > li:nth-child({card + 1}) button")
        until(page, state.format(card, ends))
        return page.inner_text(f"#cards > li:nth-child({card + 1}) .result")

    assert "sound" in run(0, "done")
    assert "gains are stored" in run(1, "done")
    assert "Baseline" in run(2, "done")
    assert "baseline refused" in run(3, "refused")  # there is no magnet: the pad is not mounted
    bench.board.field(resting_field(bench.pad) + EARTH_T)
    told = run(3, "done")
    assert "magnet 1.2" in told
    until(page, "document.querySelector('#health').dataset.health === 'ok'")
    assert page.complaints == []  # type: ignore[attr-defined]
    page.context.close()
