"""The metadata for a package index: versions that agree, the licence, dependencies; and a release's requirements."""

from __future__ import annotations

import re
import sys
from importlib.metadata import Distribution, distributions
from pathlib import Path
from typing import Any

import pytest

from fmfts.common.toml import parse

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "release"))

pytest.importorskip("tomllib", reason="releases are made by Python 3.11 or later")
from release import EXTRAS, NotReadyError, notes, the_version, versions  # noqa: E402

# The packages that the project promises to whoever installs it.
PROMISED = {"pyserial", "smbus2", "numpy", "scipy", "pyzmq", "msgpack", "onnxruntime"}
COPYLEFT = re.compile(r"\b[AL]?GPL|\bMPL|\bEPL|\bEUPL|GNU|Mozilla|Eclipse")
SOURCES = {".py", ".pyi", ".c", ".h", ".so"}
PROJECTS = [ROOT, ROOT / "clients/python", ROOT / "lab", *EXTRAS]


def project(folder: Path) -> dict[str, Any]:
    found: dict[str, Any] = parse((folder / "pyproject.toml").read_text())["project"]
    return found


def test_all_distributions_require_the_same_version() -> None:
    found = versions()
    assert {"pyproject.toml: fmfts-client", "daemon/fmfts/__init__.py"} <= found.keys()
    assert {str(folder.relative_to(ROOT) / "pyproject.toml") for folder in PROJECTS} <= found.keys()
    for folder in EXTRAS:
        assert f"pyproject.toml: fmfts-{folder.name}" in found
        assert f"extras/{folder.name}/pyproject.toml: fmfts" in found
    assert set(found.values()) == {the_version()}


def test_versions_that_differ_are_named(tmp_path: Path) -> None:
    for name in versions():
        path = Path(name.partition(":")[0])
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_text((ROOT / path).read_text())
    changed = tmp_path / "clients/python/pyproject.toml"
    changed.write_text(changed.read_text().replace('version = "', 'version = "9.', 1))
    with pytest.raises(NotReadyError, match=r"clients/python/pyproject\.toml says 9\."):
        the_version(tmp_path)


@pytest.mark.parametrize("folder", PROJECTS, ids=lambda folder: folder.name)
def test_licence_is_an_spdx_expression(folder: Path) -> None:
    assert project(folder)["license"] == "MIT"


@pytest.mark.parametrize("folder", [ROOT / "clients/python", *EXTRAS], ids=lambda folder: folder.name)
def test_published_files_carry_the_licence(folder: Path) -> None:
    assert (folder / "LICENSE").read_text() == (ROOT / "LICENSE").read_text()
    assert project(folder)["readme"] == "README.md"


def test_promised_packages_come_with_the_daemon() -> None:
    needed = {re.split(r"[<>=\[ ]", word)[0] for word in project(ROOT)["dependencies"]}
    assert needed >= PROMISED


def test_gpl_comes_with_no_extra_but_its_own() -> None:
    extras = project(ROOT)["optional-dependencies"]
    words = [
        *project(ROOT)["dependencies"],
        *(word for folder in (ROOT / "lab", *EXTRAS) for word in project(folder)["dependencies"]),
        *(word for extra in extras.values() for word in extra),
    ]
    assert [word for word in words if word.startswith("felupe")] == extras["fem"]
    assert not [word for word in words if re.search(r"\[.*\bfem\b.*\]", word)]


def test_every_copyleft_package_here_is_named_in_the_manual() -> None:
    chapter = (ROOT / "docs/dependencies.md").read_text().partition("## Copyleft")[2].partition("\n## ")[0]
    found = {each.name.lower() for each in distributions() if COPYLEFT.search(licence_of(each))}
    assert found >= {"hypothesis"}
    assert sorted(name for name in found if f"| {name}" not in chapter) == []


def licence_of(package: Distribution) -> str:
    about = package.metadata
    words = [about.get("License-Expression", ""), about.get("License", "")[:100]]
    return " ".join([*words, *(word for word in about.get_all("Classifier") or [] if word.startswith("License"))])


def test_only_the_client_distribution_has_the_clients_files() -> None:
    packages = parse((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["packages"]["find"]
    assert packages["where"] == ["daemon"]
    assert not (ROOT / "daemon/fmfts_client").exists()


@pytest.mark.parametrize("folder", PROJECTS, ids=lambda folder: folder.name)
def test_every_file_that_a_program_reads_is_packed(folder: Path) -> None:
    """An installation without the sources contains only the files of `package-data`."""
    built_in = parse((folder / "pyproject.toml").read_text())["tool"]["setuptools"]
    where = folder / ("daemon" if folder == ROOT else ".")
    for package, patterns in built_in["package-data"].items():
        packed = {path for pattern in patterns for path in (where / package).glob(pattern)}
        there = {path for path in (where / package).rglob("*.*") if "__pycache__" not in path.parts}
        assert {str(path) for path in there - packed if path.is_file() and path.suffix not in SOURCES} == set()


def test_notes_are_only_those_of_this_version() -> None:
    changelog = "# Changelog\n\n## 0.2.0 (2027-01-02)\n\n- New.\n\n## 0.1.0 (2026-12-01)\n\n- Old.\n"
    assert notes("0.2.0", changelog) == "- New."
    assert notes("0.1.0", changelog) == "- Old."
    with pytest.raises(NotReadyError, match="rename `## Unreleased`"):
        notes("0.3.0", changelog)
    with pytest.raises(NotReadyError, match="says nothing"):
        notes("0.3.0", "## 0.3.0 (2027-01-02)\n\n## 0.2.0 (2027-01-02)\n")
