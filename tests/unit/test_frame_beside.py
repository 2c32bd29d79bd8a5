"""`bench frame --beside` tells which messages of two builds are the same to the last bit, and which fields differ. It
refuses a folder whose modules are not the ones that are loaded."""

from __future__ import annotations

import shutil
from pathlib import Path

import msgspec
import numpy as np
import pytest

import fmfts
from fmfts_lab.bench import frame_beside
from fmfts_lab.bench.frame_beside import Compared

PACKAGE = Path(fmfts.__file__).parent

TOLD = {
    "seq": 1,
    "baseline": "a",
    "utc_ns": 5,
    "t_publish_ns": 6,
    "x_m": 1e-3,
    "force_n": None,
    "pose": {"axis": [0.0, 0.6, 0.8]},
}


def compared(**changes: object) -> Compared:
    found = Compared()
    found.add(msgspec.msgpack.encode(TOLD), msgspec.msgpack.encode(TOLD | changes))
    return found


def test_messages_that_differ_only_in_send_time_are_equal() -> None:
    assert str(compared(baseline="b", utc_ns=7, t_publish_ns=8)) == "1 of 1 messages the same to the last bit"


def test_one_changed_bit_is_reported_with_field_and_size() -> None:
    found = compared(pose={"axis": [0.0, 0.6, float(np.nextafter(0.8, 1.0))]})
    assert (found.same, found.fields) == (0, {"pose.axis": 1})
    assert 0.0 < found.largest["pose.axis"] < 2e-16


def test_missing_or_null_field_counts_as_difference() -> None:
    found = compared(force_n=1.0, more=False)
    assert found.fields == {"force_n": 1, "more": 1}
    assert found.largest == {}


def copied(folder: Path) -> Path:
    """The package as another build would have it, in a folder: what Python compiled of it goes along."""
    return Path(shutil.copytree(PACKAGE, folder / "fmfts"))


def test_other_arithmetic_is_noticed_in_messages(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    parameters = copied(tmp_path) / "pipeline/parameters.py"
    told = parameters.read_text()
    changed = told.replace('"noise_t": mounting.noise_t,', '"noise_t": 1.01 * mounting.noise_t,')
    assert changed != told
    parameters.write_text(changed)
    monkeypatch.setattr(frame_beside, "TURNS", 2)
    frame_beside.run(str(tmp_path))
    same, *differing = capsys.readouterr().out.splitlines()
    assert same.startswith("0 of 200 messages")
    assert any(line.startswith("  pose.chi2 differs in 200") for line in differing)


def test_folder_that_is_only_a_link_to_this_build_is_refused(tmp_path: Path) -> None:
    (tmp_path / "fmfts").symlink_to(PACKAGE)
    with pytest.raises(SystemExit, match=r"nothing was compared, because the other process loaded fmfts.* from "):
        frame_beside.run(str(tmp_path))


def test_folder_with_one_compiled_module_of_this_build_is_refused(tmp_path: Path) -> None:
    (own,) = (copied(tmp_path) / "contact").glob("_contact.*.so")
    own.unlink()
    own.symlink_to(PACKAGE / "contact" / own.name)
    with pytest.raises(SystemExit, match=r"loaded fmfts\.contact\._contact from "):
        frame_beside.run(str(tmp_path))
