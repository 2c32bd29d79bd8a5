"""A recording of a pad that needs a package which is not installed here: whoever reads it says how to install it."""

from __future__ import annotations

import subprocess
import sys

import msgspec
import pytest

from fmfts.config.recorded import recorded_pad

SCRIPT = """
import importlib.metadata
importlib.metadata.entry_points = lambda **_: ()
from fmfts.config.recorded import recorded_pad
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
def test_source_that_no_package_reads_is_damage_and_no_more(kind: object) -> None:
    with pytest.raises(msgspec.ValidationError) as error:
        recorded_pad({"name": "skin", "source": {"type": kind}})
    assert "pip install" not in str(error.value)
