"""`make install` and `make uninstall` into a folder: the files that the service's user finds there, and the remaining
ones."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from fmfts.common.toml import parse

ROOT = Path(__file__).parents[2]
SOURCES = (
    "Makefile",
    "pyproject.toml",
    "setup.py",
    "README.md",
    "LICENSE",
    "config.toml",
    "daemon",
    "clients",
    "extras",
    "systemd",
)
CONFIG, MINE = "etc/fmfts/config.toml", "# described by its owner\n"
LIBRARY = "usr/local/lib/fmfts"
PATIENCE_S = 300.0


def release(folder: Path) -> Path:
    """The sources with nothing built in them."""
    unbuilt = shutil.ignore_patterns("*.so", "*.egg-info", "__pycache__")
    folder.mkdir()
    for name in SOURCES:
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, folder / name, ignore=unbuilt)
        else:
            shutil.copy(ROOT / name, folder)
    return folder


def make(target: str, sources: Path, tree: Path) -> None:
    """Run make as root on a hardened machine, whose files nobody else may read."""
    words = ["make", target, f"DESTDIR={tree}", "WITHOUT_DEPENDENCIES=1", f"SYSTEM_PYTHON={sys.executable}"]
    made = subprocess.run(words, cwd=sources, umask=0o077, timeout=PATIENCE_S, capture_output=True, text=True)
    assert made.returncode == 0, made.stdout + made.stderr


@pytest.mark.slow
def test_installed_files_are_readable_run_and_are_removed(tmp_path: Path) -> None:
    sources, tree = release(tmp_path / "sources"), tmp_path / "root"
    (tree / CONFIG).parent.mkdir(parents=True)
    (tree / CONFIG).write_text(MINE)
    make("install", sources, tree)
    assert closed_to_others(tree) == []
    assert_starts_from_there(tree)
    assert_runs(tree)
    make("uninstall", sources, tree)
    assert [str(path.relative_to(tree)) for path in tree.rglob("*") if path.is_file()] == [CONFIG]
    assert (tree / CONFIG).read_text() == MINE


def compiled_parts() -> list[str]:
    """The compiled parts by pyproject.toml, where a compiler is optional."""
    modules = parse((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["ext-modules"]
    return [module["name"].replace(".", "/") + ".abi3.so" for module in modules]


def closed_to_others(tree: Path) -> list[Path]:
    modes = [(path, 0o055 if path.is_dir() else 0o044) for path in tree.rglob("*")]
    return [path for path, needed in modes if path.stat().st_mode & needed != needed]


def assert_starts_from_there(tree: Path) -> None:
    unit = (tree / "usr/local/lib/systemd/system/fmfts.service").read_text()
    assert "ExecStart=/usr/local/bin/fmfts-daemon run\n" in unit
    launcher = tree / "usr/local/bin/fmfts-daemon"
    assert os.access(launcher, os.X_OK)
    assert f"PYTHONPATH=/{LIBRARY} exec {sys.executable} -s /{LIBRARY}/bin/fmfts-daemon" in launcher.read_text()
    assert [path.name for path in (tree / LIBRARY / "bin").iterdir()] == ["fmfts-daemon"]


def assert_runs(tree: Path) -> None:
    library = tree / LIBRARY
    code = "import fmfts; from fmfts.cli.main import main; print(fmfts.__file__, flush=True); main(['--version'])"
    environment = os.environ | {"PYTHONPATH": str(library)}
    words = [sys.executable, "-sP", "-c", code]
    said = subprocess.run(words, env=environment, capture_output=True, text=True, check=False)
    assert said.stdout.startswith(f"{library}/fmfts/__init__.py\nfmfts-daemon "), said.stdout + said.stderr
    command = [sys.executable, "-s", str(library / "bin/fmfts-daemon")]
    words = [*command, "init", "--simulated", "--config", str(tree / "written.toml")]
    subprocess.run(words, env=environment, capture_output=True, check=True)
    assert (tree / "written.toml").read_text() == (ROOT / "config.toml").read_text(), "it ships in the package"
    (tree / "written.toml").unlink()
    words = [*command, "check-config", "--config", str(library / "fmfts/config/array.toml")]
    said = subprocess.run(words, env=environment, capture_output=True, text=True, check=False)
    assert said.returncode == 0, f"the second standard pad and its table of presses ship in the package: {said.stderr}"
    assert [part for part in compiled_parts() if not (library / part).exists()] == []
    said = subprocess.run([*command, "collect", "--help"], env=environment, capture_output=True, text=True, check=False)
    assert "--by-hand" in said.stdout, f"extras that every system has are found there: {said.stderr}"
    for verb, option in (("calibrate", "--correct"), ("evaluate", "--plot"), ("pose", "--octupole")):
        said = subprocess.run([*command, verb, "--help"], env=environment, capture_output=True, text=True, timeout=60)
        assert option in said.stdout, said.stderr
    said = subprocess.run([*command, "view", "--robot", "arm"], env=environment, capture_output=True, text=True)
    assert "give NAME=ENDPOINT" in said.stderr
