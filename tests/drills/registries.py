"""This computer's way to packages, for a tree of Debian: certificates, and the settings of apt and pip."""

from __future__ import annotations

import os
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path

CERTIFICATES = ("etc/ssl/certs", "usr/share/ca-certificates", "usr/local/share/ca-certificates")
APT = ("etc/apt/apt.conf.d", "usr/share/keyrings", "etc/apt/trusted.gpg.d")
APT_SOURCES = ("etc/apt/sources.list", "etc/apt/sources.list.d")
PIP_OF_ALL, PIP_OF_A_USER = "etc/pip.conf", ".config/pip"
VARIABLES = re.compile(r"PIP_.*|.*_(proxy|PROXY)|SSL_CERT_FILE|REQUESTS_CA_BUNDLE")


def carry_into(tree: Path) -> None:
    """Copy the sources of packages only into the same release, because other releases cannot use them."""
    same = _codename(Path("/")) == _codename(tree)
    for name in (*CERTIFICATES, *APT, *(APT_SOURCES if same else ()), PIP_OF_ALL):
        copy(Path("/", name), tree / name)
    if same and not (Path("/") / APT_SOURCES[0]).exists():
        (tree / APT_SOURCES[0]).unlink(missing_ok=True)
    carry_to_user(tree / "root")


def _codename(tree: Path) -> str:
    found = re.search(r"^VERSION_CODENAME=(\w+)$", (tree / "etc/os-release").read_text(), re.MULTILINE)
    return found[1] if found else ""


def carry_to_user(home: Path) -> None:
    copy(Path.home() / PIP_OF_A_USER, home / PIP_OF_A_USER)


def environment() -> dict[str, str]:
    return {name: value for name, value in os.environ.items() if VARIABLES.fullmatch(name)}


def package_folders() -> list[Path]:
    """Folders of this computer that pip's settings name."""
    return sorted({folder for text in _pip_settings() for folder in _folders_in(text)})


def _pip_settings() -> Iterator[str]:
    for path in (Path("/", PIP_OF_ALL), Path.home() / PIP_OF_A_USER / "pip.conf"):
        if path.is_file():
            yield path.read_text()
    yield from (value for name, value in environment().items() if name.startswith("PIP_"))


def _folders_in(text: str) -> Iterator[Path]:
    for place in re.findall(r"(?:^|(?<=[\s='\"])|(?<=file://))/[\w./-]+", text, re.MULTILINE):
        folder = Path(place)
        folder = folder.parent if folder.name == "simple" else folder  # an index, whose packages lie beside it
        if folder.is_dir() and len(folder.parts) > 2:
            yield folder


def copy(source: Path, to: Path) -> None:
    """Overwrites existing files; does nothing without a source."""
    if source.exists():
        to.parent.mkdir(parents=True, exist_ok=True)
        # -T: into a folder of the same name, and not below it.
        subprocess.run(["cp", "-aT", "--remove-destination", source, to], check=True)
