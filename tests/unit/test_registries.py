"""This computer's way to packages, as a fresh tree of Debian is given it."""

from __future__ import annotations

from pathlib import Path

import pytest

from drills import registries


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A home with pip's settings."""
    for name in ("index/simple", "wheels", "unnamed"):
        (tmp_path / name).mkdir(parents=True)
    settings = tmp_path / "home" / registries.PIP_OF_A_USER / "pip.conf"
    settings.parent.mkdir(parents=True)
    settings.write_text(
        f"[global]\nindex-url = file://{tmp_path}/index/simple\nextra-index-url=https://x.invalid/wheels\n"
    )
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.setenv("PIP_FIND_LINKS", f"{tmp_path}/wheels {tmp_path}/absent")
    return tmp_path


def test_folders_that_pips_settings_name_are_found(home: Path) -> None:
    found = [folder for folder in registries.package_folders() if folder.is_relative_to(home)]
    assert found == [home / "index", home / "wheels"]


def test_only_settings_and_proxy_routes_are_carried(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("https_proxy", "http://proxy.invalid:3128")
    monkeypatch.setenv("MY_SECRET", "no package")
    carried = registries.environment()
    assert carried["https_proxy"] == "http://proxy.invalid:3128"
    assert "PIP_FIND_LINKS" in carried
    assert "MY_SECRET" not in carried
    registries.carry_to_user(home / "newcomer")
    assert (home / "newcomer" / registries.PIP_OF_A_USER / "pip.conf").read_text().startswith("[global]")


def test_copied_file_replaces_the_old_one(tmp_path: Path) -> None:
    """Certificates are links, and Debian's own are there before."""
    for side in ("from", "to"):
        (tmp_path / side).mkdir()
        (tmp_path / side / "certificate").symlink_to(f"of {side}")
    (tmp_path / "to" / "kept").touch()
    registries.copy(tmp_path / "from", tmp_path / "to")
    registries.copy(tmp_path / "absent", tmp_path / "other")
    assert (tmp_path / "to" / "certificate").readlink() == Path("of from")
    assert (tmp_path / "to" / "kept").exists()
    assert not (tmp_path / "other").exists()
