"""The Debian package's script after removal, in a folder that stands for `/`; `make drill-service` runs the package."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

POSTRM = Path(__file__).parents[2] / "systemd" / "debian" / "postrm"
KEPT = [
    "etc/fmfts/config.toml",
    "etc/fmfts/keys/clients",
    "etc/fmfts/keys/server.key",
    "var/lib/fmfts/baseline/left.json",
]


@pytest.mark.parametrize(
    ("action", "left"),
    [("remove", KEPT), ("upgrade", KEPT), ("abort-install", KEPT), ("purge", KEPT[:1])],  # dpkg removes config.toml
)
def test_keys_and_baselines_are_deleted_by_purge_alone(tmp_path: Path, action: str, left: list[str]) -> None:
    for name in KEPT:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    script = POSTRM.read_text().replace(" /", f" {tmp_path}/")
    assert str(tmp_path) in script
    subprocess.run(["sh", "-c", script, "postrm", action], check=True)
    assert sorted(str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*") if path.is_file()) == left
