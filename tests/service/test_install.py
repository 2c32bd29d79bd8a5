"""`make install` and `make uninstall` into a folder: what the service's user finds there, and what is left."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SOURCES = ("Makefile", "pyproject.toml", "README.md", "LICENSE", "config.toml", "daemon", "clients", "systemd")
COMPILED = ("pose/_kernel", "healthy/_healthy", "sensor/_wire", "contact/_refine", "contact/_network")
CONFIG, MINE = "etc/fmfts/config.toml", "# described by its owner\n"
PATIENCE_S = 300.0


@dataclass
class Tree:
    """`sources` as a release holds them, installed into `folder`."""

    sources: Path
    folder: Path

    def make(self, target: str) -> None:
        """As root of a hardened machine does it, whose files are nobody else's."""
        words = ["make", target, f"DESTDIR={self.folder}", "WITHOUT_DEPENDENCIES=1", f"SYSTEM_PYTHON={sys.executable}"]
        made = subprocess.run(words, cwd=self.sources, umask=0o077, timeout=PATIENCE_S, capture_output=True, text=True)
        assert made.returncode == 0, made.stdout + made.stderr

    @property
    def library(self) -> Path:
        return self.folder / "usr/local/lib/fmfts"

    def files(self) -> list[Path]:
        return [path for path in self.folder.rglob("*") if path.is_file()]


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Tree]:
    folder = tmp_path_factory.mktemp("install")
    sources = folder / "sources"
    sources.mkdir()
    unbuilt = shutil.ignore_patterns("*.so", "*.egg-info", "__pycache__")
    for name in SOURCES:
        source = ROOT / name
        if source.is_dir():
            shutil.copytree(source, sources / name, ignore=unbuilt)
        else:
            shutil.copy(source, sources)
    installed = Tree(sources, folder / "root")
    (installed.folder / CONFIG).parent.mkdir(parents=True)
    (installed.folder / CONFIG).write_text(MINE)
    installed.make("install")
    yield installed
    installed.make("uninstall")
    assert [str(path.relative_to(installed.folder)) for path in installed.files()] == [CONFIG]


def test_everything_is_there_for_the_services_user_whatever_roots_umask(tree: Tree) -> None:
    closed = [
        path
        for path in tree.folder.rglob("*")
        if path.stat().st_mode & (0o055 if path.is_dir() else 0o044) != (0o055 if path.is_dir() else 0o044)
    ]
    assert closed == []
    assert os.access(tree.folder / "usr/local/bin/fmfts-daemon", os.X_OK)
    unit = (tree.folder / "usr/local/lib/systemd/system/fmfts.service").read_text()
    assert "ExecStart=/usr/local/bin/fmfts-daemon run\n" in unit


def test_what_is_installed_runs_with_its_compiled_parts(tree: Tree) -> None:
    code = "import fmfts, sys; from fmfts.cli import main; print(fmfts.__file__, flush=True); main(['--version'])"
    environment = os.environ | {"PYTHONPATH": str(tree.library)}
    words = [sys.executable, "-sP", "-c", code]
    said = subprocess.run(words, env=environment, capture_output=True, text=True, check=False)
    assert said.stdout.startswith(f"{tree.library}/fmfts/__init__.py\nfmfts-daemon "), said.stdout + said.stderr
    for part in COMPILED:
        assert list((tree.library / "fmfts").glob(f"{part}*.so")), part
    launcher = (tree.folder / "usr/local/bin/fmfts-daemon").read_text()
    assert f"PYTHONPATH=/usr/local/lib/fmfts exec {sys.executable} -sP -m fmfts" in launcher


def test_configuration_that_is_there_stays(tree: Tree) -> None:
    assert (tree.folder / CONFIG).read_text() == MINE
