"""`bench frame --beside` tells which messages of two builds are the same to the last bit, and which fields differ."""

from __future__ import annotations

import msgspec
import numpy as np

from fmfts_lab.bench.frame_beside import Compared

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


def test_messages_that_were_only_sent_at_other_times_are_the_same() -> None:
    assert str(compared(baseline="b", utc_ns=7, t_publish_ns=8)) == "1 of 1 messages the same to the last bit"


def test_one_bit_of_one_number_is_told_with_its_field_and_its_size() -> None:
    found = compared(pose={"axis": [0.0, 0.6, float(np.nextafter(0.8, 1.0))]})
    assert (found.same, found.fields) == (0, {"pose.axis": 1})
    assert 0.0 < found.largest["pose.axis"] < 2e-16


def test_a_field_that_only_one_of_them_has_or_that_is_null_differs() -> None:
    found = compared(force_n=1.0, more=False)
    assert found.fields == {"force_n": 1, "more": 1}
    assert found.largest == {}
