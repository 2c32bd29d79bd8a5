"""From `init` to contacts: each chip that Linux reads, on the adapters of a Raspberry Pi 4 and of a Pi 5."""

from __future__ import annotations

from pathlib import Path

import pytest

from end_to_end.i2c_first_use import ADAPTERS, ADDRESSES, PRESS, first_use

SELF_TESTED = ("hmc5983", "hmc5883l", "lis3mdl", "mmc5983ma")  # strap, own field, or coil, as their data sheets say
USUAL = [("mmc5983ma", "bcm2835"), ("mlx90393", "designware")]
OTHERS = [(chip, adapter) for chip in ADDRESSES for adapter in ADAPTERS if (chip, adapter) not in USUAL]


def require_first_use(folder: Path, chip: str, adapter: str) -> None:
    used = first_use(folder, chip, adapter)
    assert used.measured_hz == pytest.approx(used.rate_hz, rel=0.05)  # the ends of three seconds, and a busy computer
    assert used.before.contact is False
    assert used.pressed.contact is True
    assert used.after.contact is False
    x_m, y_m, force_n = PRESS
    # Deviations include the noise and the baseline's remaining errors; five of them, of one message.
    assert abs(used.pressed.force_n - force_n) < 5 * used.pressed.force_sd_n
    assert abs(used.pressed.x_m - x_m) < 5 * used.pressed.x_sd_m
    assert abs(used.pressed.y_m - y_m) < 5 * used.pressed.y_sd_m
    # Steel may be near, and the pad was not turned: 0.23 N. Its silicone and the finger are not known: 25 %.
    assert used.usual_sd_n < 0.4 * force_n
    # This pad is as drawn, so only noise remains: of one frame, 0.02 N, and 0.1 N of MLX90393 (docs/chips.md).
    assert abs(used.pressed.force_n - force_n) < (0.4 if chip == "mlx90393" else 0.1)
    assert ("has no self-test" in used.selftest) is (chip not in SELF_TESTED), used.selftest


@pytest.mark.real_time
@pytest.mark.parametrize(("chip", "adapter"), USUAL)
def test_first_use_ends_in_contacts(chip: str, adapter: str, tmp_path: Path) -> None:
    require_first_use(tmp_path, chip, adapter)


@pytest.mark.slow
@pytest.mark.real_time
@pytest.mark.parametrize(("chip", "adapter"), OTHERS)
def test_first_use_of_every_chip_on_both_adapters(chip: str, adapter: str, tmp_path: Path) -> None:
    require_first_use(tmp_path, chip, adapter)
