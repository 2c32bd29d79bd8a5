"""Links, anchors and named files of every page exist; every page of the manual is in its index."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
FOLDERS = ("docs", "clients", "extras", "firmware", "lab")
PAGES = sorted([*ROOT.glob("*.md"), *(page for folder in FOLDERS for page in (ROOT / folder).rglob("*.md"))])
# Their files in backticks are exact; a path that begins with a room is inside the robot's package.
NAMED = ("CONTRIBUTING.md", "docs/architecture.md", "docs/glossary.md")
EXACT = sorted([*ROOT.glob("docs/how-to*"), *(ROOT / page for page in NAMED)])
LINK = re.compile(r"!?\[[^\[\]]*\]\(([^()\s]+)\)")
CODE = re.compile(r"`([^`\n]+)`")
PATH = re.compile(r"[\w.+-]+(?:/[\w.+-]+)*/?")
# Words before a slash that are no folder: a topic, a unit or a place on another machine.
NO_FILES = re.compile(r"^(?:contact|event|status|frame|state)/$|^/|^\.venv/|^build/")


def without_code(text: str) -> str:
    """A link inside a block of code or in backticks does not count."""
    return re.sub(r"`[^`\n]*`", "``", re.sub(r"^```.*?^```$|^    .*?$", "", text, flags=re.DOTALL | re.MULTILINE))


def anchors_of(page: Path) -> set[str]:
    """What GitHub makes of headings: lower case, letters, digits, _ and - alone, spaces to -, twins numbered."""
    text = re.sub(r"^```.*?^```$", "", page.read_text(), flags=re.DOTALL | re.MULTILINE)
    found: set[str] = set()
    for heading in re.findall(r"^#{1,6} +(.+?)\s*$", text, flags=re.MULTILINE):
        words = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).lower()
        plain = re.sub(r"[^\w\- ]", "", words).replace(" ", "-")
        twins = [plain, *(f"{plain}-{number}" for number in range(1, 99))]
        found.add(next(name for name in twins if name not in found))
    return found


def fault(page: Path, target: str) -> str | None:
    """Why a link of `page` is broken; None if it is not."""
    if re.match(r"[a-z]+:", target):
        return None
    path, _, anchor = target.partition("#")
    leads_to = (page.parent / path).resolve() if path else page
    if not leads_to.exists():
        return f"{target}: no such file"
    if not leads_to.is_relative_to(ROOT):
        return f"{target}: outside of the repository"
    if anchor and anchor not in anchors_of(leads_to):
        return f"{target}: no such heading; there are {', '.join(sorted(anchors_of(leads_to)))}"
    return None


def files_named_in(text: str) -> set[str]:
    """Texts in backticks that look like a path: a folder before a slash, or a file with a known ending."""
    words = {word for code in CODE.findall(text) for word in code.split() if PATH.fullmatch(word)}
    ending = re.compile(r".*\.(?:py|pyi|c|h|md|toml|csv|ini|onnx|sh|mk|svg|service)$")
    return {word for word in words if ("/" in word or ending.match(word)) and not NO_FILES.match(word)}


def exists(name: str) -> bool:
    return any((folder / name).exists() for folder in (ROOT, ROOT / "daemon/fmfts"))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_link_leads_somewhere(page: Path) -> None:
    faults = [fault(page, target) for target in LINK.findall(without_code(page.read_text()))]
    assert [one for one in faults if one] == []


@pytest.mark.parametrize("page", EXACT, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_file_that_is_named_exists(page: Path) -> None:
    assert [name for name in sorted(files_named_in(page.read_text())) if not exists(name)] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_page_that_is_named_exists(page: Path) -> None:
    named = re.findall(r"(?<![\w/.-])(?:docs|lab/results)/[\w/-]+\.(?:md|svg|png|toml)", page.read_text())
    assert [name for name in named if not (ROOT / name).exists()] == []


def test_every_page_that_the_code_names_exists() -> None:
    folders = [ROOT / name for name in ("daemon", "lab", "extras", "clients", "firmware", "tests", "systemd")]
    files = [path for folder in folders for path in folder.rglob("*") if path.suffix in (".py", ".c", ".h", ".mk")]
    named = {
        (str(path.relative_to(ROOT)), name)
        for path in [*files, ROOT / "config.toml", ROOT / "pyproject.toml", ROOT / "Makefile"]
        for name in re.findall(r"(?<![\w/.-])(?:docs|lab/results)/[\w/-]+\.md", path.read_text())
    }
    assert sorted((path, name) for path, name in named if not (ROOT / name).exists()) == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_target_and_module_that_page_reports_to_run_exists(page: Path) -> None:
    text = page.read_text()
    rules = "".join(
        (ROOT / file).read_text()
        for file in ("Makefile", "systemd/install.mk", "clients/c/client.mk", "tests/fuzz/fuzz.mk")
    )
    targets = set(re.findall(r"[\w-]+", " ".join(re.findall(r"^([a-z][\w -]*):", rules, flags=re.MULTILINE))))
    named = re.findall(r"(?:^    |`|&& |sudo )make\s+([a-z][\w-]*)", text, flags=re.MULTILINE)
    assert [name for name in named if name not in targets] == []
    modules = [name.replace(".", "/") for name in re.findall(r"python -m (fmfts(?:_lab)?(?:\.\w+)+)", text)]
    folders = {"fmfts": "daemon", "fmfts_lab": "lab"}
    places = [ROOT / folders[name.split("/")[0]] / name for name in modules]
    assert [place for place in places if not place.is_dir() and not place.with_suffix(".py").exists()] == []


@pytest.mark.parametrize("index", ["docs/README.md", "lab/results/README.md"])
def test_every_page_is_in_the_index_of_its_folder(index: str) -> None:
    text = (ROOT / index).read_text()
    pages = sorted((ROOT / index).parent.glob("*.md"))
    assert [page.name for page in pages if page.name != "README.md" and f"({page.name})" not in text] == []


def test_faults_are_seen(tmp_path: Path) -> None:
    page = ROOT / "docs/README.md"
    assert fault(page, "nowhere.md") is not None
    assert fault(page, "#use") is None
    assert fault(page, "#use-her") is not None
    assert fault(page, "pose.md#state") is None
    assert fault(page, "pose.md#nowhere") is not None
    assert fault(page, "../../elsewhere.md") is not None
    assert files_named_in("`pose/solver.c`, `a word`, `contact/<pad>`, `x.py`") == {"pose/solver.c", "x.py"}
    assert LINK.findall(without_code("    [a](b)\n`[c](d)` [e](f)\n```\n[g](h)\n```\n")) == ["f"]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_page_that_runs_the_laboratory_says_how_to_install_it(page: Path) -> None:
    text = page.read_text()
    if "python -m fmfts_lab" in text and page.parent.name != "results":
        assert "./lab`" in text


def test_all_pages_state_the_same_duration_of_the_tests() -> None:
    told = [time for page in PAGES for time in re.findall(r"\((\w+) minutes on two idle cores\)", page.read_text())]
    assert len(told) > 1
    assert len(set(told)) == 1


def test_recording_becomes_a_table_with_all_columns(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The example of docs/recording.md, but for its last step, on a recording without a touch."""
    (example,) = re.findall(
        r"^```python\n(.*?)^```", (ROOT / "docs/recording.md").read_text(), re.DOTALL | re.MULTILINE
    )
    (tmp_path / "touch.mcap").write_bytes((ROOT / "tests/data/recordings/fault.mcap").read_bytes())
    monkeypatch.chdir(tmp_path)
    made: dict[str, Any] = {}
    exec(example.partition("import pandas")[0], made)
    assert made["rows"]
    assert any("x_m" not in row for row in made["rows"])
    assert {"x_m", "y_m", "force_n", "health"} <= set(made["columns"])
    assert set().union(*made["rows"]) <= set(made["columns"])
