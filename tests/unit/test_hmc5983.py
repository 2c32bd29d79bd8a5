"""The magnetometer's bytes, against the data sheet's own numbers and the mistakes of published drivers."""

from __future__ import annotations

import pytest

from fmfts.sensor.chips import HMC5883L, HMC5983, hmc5983
from fmfts.sensor.chips.selftest import limits, selftest_facts, selftest_failures, strap_counts

GOOD_UP, GOOD_DOWN = (452, 452, 421), (-452, -452, -421)


def test_configuration_a_asks_for_the_slowest_rate_that_suffices() -> None:
    assert hmc5983.config_a(HMC5983, 220) == 0x9C  # compensation, code 7
    assert hmc5983.config_a(HMC5983, 76) == 0x9C
    assert hmc5983.config_a(HMC5983, 75) == 0x98
    assert hmc5983.config_a(HMC5883L, 75) == 0x18  # the predecessor has no compensation bit
    assert hmc5983.config_a(HMC5983, 15, hmc5983.BIAS_POSITIVE, hmc5983.AVERAGE_8) == 0xF1
    assert hmc5983.config_a(HMC5883L, 15, hmc5983.BIAS_NEGATIVE, hmc5983.AVERAGE_8) == 0x72
    with pytest.raises(ValueError, match="hmc5883l delivers at most 75 Hz"):
        hmc5983.config_a(HMC5883L, 76)


def test_configuration_b_is_the_gain_code_in_the_upper_bits() -> None:
    assert [hmc5983.config_b(code) for code in range(8)] == [0x00, 0x20, 0x40, 0x60, 0x80, 0xA0, 0xC0, 0xE0]


def test_data_registers_are_big_endian_and_in_the_order_x_z_y() -> None:
    assert hmc5983.axes_from_registers(bytes.fromhex("0102fffef000")) == (0x0102, HMC5983.saturated_count, -2)


def test_all_three_identification_bytes_count() -> None:
    assert HMC5983.why_not_identity(b"H43") is None
    for wrong in (b"H44", b"H53", b"I43", b"\0\0\0", b"\xff\xff\xff"):
        assert wrong.hex(" ") in str(HMC5983.why_not_identity(wrong))


def test_selftest_limits_are_data_sheets_and_scale_with_gain() -> None:
    assert [limits(HMC5983, 5, axis) for axis in range(3)] == 3 * [(243, 575)]
    assert limits(HMC5983, 0, 0) == (854, 2020)  # 1370/390 of them


@pytest.mark.parametrize("edge", [243, 575])
def test_count_at_a_limit_passes_and_one_beyond_fails(edge: int) -> None:
    assert selftest_failures(HMC5983, 5, (edge,) * 3, (-edge,) * 3) == []
    beyond = edge + (1 if edge == 575 else -1)
    assert len(selftest_failures(HMC5983, 5, (edge, beyond, edge), (-edge,) * 3)) == 1
    assert len(selftest_failures(HMC5983, 5, (edge,) * 3, (-edge, -edge, -beyond))) == 1
    assert len(selftest_failures(HMC5983, 5, (-edge,) * 3, (edge,) * 3)) == 3


def test_ambient_field_is_subtracted_once_with_any_chip() -> None:
    outside = (200, -150, 0)
    up, down = strap_counts(HMC5983, outside, GOOD_UP, GOOD_DOWN)
    assert (up, down) == (GOOD_UP, GOOD_DOWN)
    shifted_up = (652, 302, 421)
    shifted_down = (-252, -602, -421)
    assert strap_counts(HMC5983, outside, shifted_up, shifted_down) == (GOOD_UP, GOOD_DOWN)


def test_dead_strap_fails_on_either_kind() -> None:
    """A field outside within the limits must not pass for the strap's."""
    outside = (300, 300, 300)
    for shown in ((0, 0, 0), outside):
        assert len(selftest_failures(HMC5983, 5, *strap_counts(HMC5983, outside, shown, shown))) == 3


def test_saturation_without_bias_spoils_the_axis() -> None:
    up, down = strap_counts(HMC5983, (0, HMC5983.saturated_count, 0), GOOD_UP, GOOD_DOWN)
    assert up == (452, HMC5983.saturated_count, 421)
    assert down == (-452, HMC5983.saturated_count, -421)


def test_selftest_facts_give_each_axis_its_gain() -> None:
    facts = selftest_facts(HMC5983, 5, [(475, 430, 421)], [(-475, -430, -421)])
    (sensor,) = facts["sensors"]
    assert facts["passed"]
    assert sensor["gain_factor"] == pytest.approx([475 / 452.4, 430 / 452.4, 421 / 421.2])


def test_selftest_facts_name_what_failed_and_give_no_gain_for_it() -> None:
    facts = selftest_facts(
        HMC5983,
        5,
        [GOOD_UP, (-4096, 100, 421), (0, 0, 0)],
        [GOOD_DOWN, (-452, -100, -421), (0, 0, 0)],
        [None, None, "no answer"],
    )
    good, bad, absent = facts["sensors"]
    assert (facts["passed"], good["passed"], bad["passed"], absent["passed"]) == (False, True, False, False)
    assert [text.split(":")[0] for text in bad["failures"]] == ["x", "y"]
    assert bad["gain_factor"][:2] == [None, None]
    assert bad["gain_factor"][2] == pytest.approx(1.0, abs=1e-3)
    assert absent["failures"] == ["no answer"]
    assert absent["gain_factor"] == [None, None, None]
