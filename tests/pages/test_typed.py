"""Every command of the pages that needs no hardware is typed as it stands there; `make docs-test`."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from end_to_end.build_guide import Step
from pages.commands import ROOT, Command, Known, every_command
from pages.typed import reader

KNOWN = Known.read()
TYPED: dict[str, list[Command]] = {}
for one in every_command():
    if KNOWN.reason(one) is None:
        TYPED.setdefault(one.page, []).append(one)
# Pages whose reader starts with nothing, and needs no daemon.
FROM_NOTHING = {"README.md", "docs/installing.md", "lab/README.md", "docs/fleet.md", "docs/security.md"}
FROM_NOTHING |= {"CONTRIBUTING.md", "docs/build-a-pad.md", "docs/firmware.md", "clients/c/README.md"}
FROM_NOTHING |= {"extras/simulation/README.md"}
FROM_NOTHING |= {page for page in TYPED if page.startswith("lab/results/")}


def demanded_bus(page: Path, folder: Path) -> str:
    """The [bus] that a comment of the page asks for in the reader's file, with the keys' folder in `folder`."""
    found = re.search(r'^ +# .*\[bus\] (endpoint = "[^"]*"), keys = "/etc/fmfts/(\w+)"', page.read_text(), re.MULTILINE)
    return f'[bus]\n{found[1]}\nkeys = "{folder}/etc-{found[2]}"\n' if found else ""


@pytest.fixture(scope="module")
def prepared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A pad that is set up as the README says."""
    folder = tmp_path_factory.mktemp("prepared")
    with reader(folder) as typing:
        typing.type("fmfts-daemon init --simulated")
        pad = folder / "pad.toml"
        pad.write_text(pad.read_text().replace('name = "demo"', 'name = "left"', 1))
        assert 'name = "left"' in pad.read_text()
        for option in ("--bare", "--rest"):
            typing.type(f"fmfts-daemon baseline {option}")
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("page", TYPED)
def test_every_command_of_page_does_what_it_says(page: str, tmp_path: Path, request: pytest.FixtureRequest) -> None:
    beside = None if page in FROM_NOTHING else request.getfixturevalue("prepared")
    demanded = demanded_bus(ROOT / page, tmp_path)
    if demanded:
        (tmp_path / "config.toml").write_text(f'{demanded}[[pad]]\nname = "left"\n[pad.source]\ntype = "simulated"\n')
    with reader(tmp_path, beside) as typing:
        for command in TYPED[page]:
            said = typing.type(KNOWN.typed(command))
            assert Step(command.words, command.shown).missing(said) == []
