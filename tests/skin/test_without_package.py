"""The daemon when the package of a pad's source or model is not installed, or does not fit."""

from __future__ import annotations

import subprocess
import sys
from importlib.metadata import EntryPoint, entry_points

import msgspec
import pytest

from fmfts.config import sources
from fmfts_recording.pad_config import recorded_pad
from fmfts_skin.settings import AnyskinSource


def test_package_that_cannot_be_loaded_is_reported_and_skipped(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    whole, *_ = entry_points(group="fmfts.sources", name="anyskin")
    points = [EntryPoint("gone", "fmfts_gone.settings:Source", ""), whole, EntryPoint("old", "fmfts_skin:Gone", "")]
    monkeypatch.setattr(sources, "entry_points_of", lambda _: points)
    assert sources._plugged() == {"anyskin": AnyskinSource}
    assert "type 'gone' is left out: its package does not fit this version: No module named 'fmfts_gone'" in caplog.text
    assert "type 'old' is left out" in caplog.text


SCRIPT = """
import importlib.metadata
importlib.metadata.entry_points = lambda **_: ()
from fmfts_recording.pad_config import recorded_pad
recorded_pad({"name": "skin", "source": {"type": "anyskin", "port": "/dev/null"}})
"""


def test_source_of_a_recorded_pad() -> None:
    ended = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=False)
    assert "ValidationError: its source 'anyskin' belongs to a package of its own" in ended.stderr
    assert "pip install 'fmfts[skin]'" in ended.stderr


def test_contact_model_of_a_recorded_pad(monkeypatch: pytest.MonkeyPatch) -> None:
    config = {"name": "skin", "source": {"type": "simulated"}, "contact": {"model": "/gone/skin.response"}}
    assert not recorded_pad(config).are_magnets_known
    monkeypatch.setattr("fmfts.config.model_kinds._added", lambda _: None)
    with pytest.raises(
        msgspec.ValidationError, match=r"(?s)skin\.response belongs to a package of its own.*'fmfts\[skin\]'"
    ):
        recorded_pad(config)


@pytest.mark.parametrize("kind", [[], {}, None, 5, "usb"])
def test_recorded_source_without_a_package_counts_as_damage(kind: object) -> None:
    with pytest.raises(msgspec.ValidationError) as error:
        recorded_pad({"name": "skin", "source": {"type": kind}})
    assert "pip install" not in str(error.value)
