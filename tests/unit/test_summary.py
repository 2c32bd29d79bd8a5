"""The one line of `systemctl status`."""

from __future__ import annotations

from bus_messages import status_message

from fmfts.runtime.summary import one_line

NOW_NS = 100_000_000_000


def test_true_rates_are_reported() -> None:
    assert one_line([status_message(rate_hz=219.6)], NOW_NS) == "1 of 1 pads ok at 220 Hz"
    slow = [status_message(rate_hz=rate) for rate in (219.6, 181.2, 200.0)]
    assert one_line(slow, NOW_NS) == "3 of 3 pads ok at 181 to 220 Hz"


def test_fault_is_reported_with_reason_and_duration() -> None:
    gone = status_message(
        pad="left", health="disconnected", reason="no such port", rate_hz=0.0, since_ns=NOW_NS - 12_300_000_000
    )
    told = one_line([status_message(rate_hz=220.0), gone], NOW_NS)
    assert told == "1 of 2 pads ok at 220 Hz; left: disconnected for 12 s, 0 Hz: no such port"


def test_sensor_fault_is_reported_on_an_ok_pad() -> None:
    told = one_line([status_message(pad="a", sensor_faults=["sensor 2 does not answer"], since_ns=NOW_NS)], NOW_NS)
    assert told.startswith("0 of 1 pads ok; a: ok for 0 s")
    assert told.endswith("sensor 2 does not answer")


def test_line_stays_short_when_everything_is_wrong() -> None:
    gone = [status_message(pad=f"p{i}", health="disconnected", since_ns=NOW_NS) for i in range(64)]
    assert one_line(gone, NOW_NS).endswith("; and 60 more with faults")
