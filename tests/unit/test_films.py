"""Chips with a magnetic film: times of their samples, pulses, and the sixteenth sample.

The emulators that judge here are written from the data sheet and from users' measurements (tests/emulator/memsic.py).
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from emulated_bus import Clock, clock, emulated_pad, run
from sample_times import judged
from test_chip_drivers import FIELD_GAUSS, chip_of

from emulator.magnetometers import Mmc5983ma
from fmfts.sensor.chips import CHIPS

__all__ = ["clock"]
FILMS = [kind for kind, chip in CHIPS.items() if chip.film is not None]
# A transfer of the emulated bus takes 0.2 ms, and the chip begins within the transfer that starts it.
TIME_S = 0.2e-3


@pytest.mark.parametrize(("rate_hz", "trigger"), [(220, 0), (220, 1), (100, 0)])
@pytest.mark.parametrize("kind", FILMS)
def test_sample_has_the_time_of_its_middle_and_comes_once(clock: Clock, kind: str, rate_hz: int, trigger: int) -> None:
    result = judged(clock, kind, rate_hz, trigger, frames=1500)
    assert result.samples > 4000
    assert result.repeated == 0
    assert result.worst_s <= TIME_S
    assert min(result.fresh_share) > 0.99


def test_sixteenth_sample_shows_no_step(clock: Clock) -> None:
    """Users of the command 0x21 see x of every 16th sample off by 10 to 12 µT: 450 counts. The noise is 3 counts."""
    one = Mmc5983ma(clock, FIELD_GAUSS)
    one.has_own_noise = True
    pad, _ = emulated_pad(clock, "mmc5983ma", [one], rate_hz=200)
    run(pad, clock, 0.2, 200)
    counts = np.array([sample.counts[0] for sample in run(pad, clock, 10.0, 200)])
    assert np.abs(counts - counts.mean(axis=0)).max() < 6.0 * 0.8e-3 * 4096 + 1.0  # data sheet, page 2: 0.8 mG


@pytest.mark.parametrize("trigger", [0, 1])
def test_film_is_set_rarely(clock: Clock, trigger: int) -> None:
    """At set-up and every ten minutes: a pulse moves the zero by 1 mG, more than one sample's noise."""
    one = Mmc5983ma(clock, FIELD_GAUSS)
    pulses = []
    film_pulse = one.film.pulse
    one.film.pulse = lambda *arguments: (pulses.append(clock()), film_pulse(*arguments))[1]  # type: ignore[func-returns-value]
    pad, _ = emulated_pad(clock, "mmc5983ma", [one], rate_hz=5, trigger=trigger)
    samples = run(pad, clock, 1900.0, 5)
    assert len(pulses) == 4
    assert np.diff(pulses) == pytest.approx(600.0, abs=1.0)
    assert sum(sample.fresh for sample in samples) > 0.999 * len(samples)
    steps = np.abs(np.diff([sample.counts[0] for sample in samples[5:]], axis=0))
    assert steps.max() <= 5 * 2**0.5 * 1e-3 * 4096  # the zeros of two pulses: no pulse spoilt a measurement


@pytest.mark.parametrize("trigger", [0, 1])
@pytest.mark.parametrize("kind", FILMS)
def test_sample_of_an_upset_film_is_never_used(clock: Clock, kind: str, trigger: int) -> None:
    one = chip_of(clock, kind)
    pad, _ = emulated_pad(clock, kind, [one], rate_hz=100, trigger=trigger)
    good = run(pad, clock, 0.2, 100)[-1].counts[0]
    saturated = CHIPS[kind].saturated_count
    for strong in ([0.95, 0.0, 0.0], [0.6, 0.6, 0.6], [3.0, 0.0, 0.0], [0.0, -1.2, 0.4]):
        one.field_gauss = [share * one.upsetting_gauss for share in strong]
        run(pad, clock, 0.05, 100)
        one.field_gauss = list(FIELD_GAUSS)
        shown = [sample.counts[0] for sample in run(pad, clock, 0.2, 100)[1:]]
        assert all((counts == saturated).all() or np.abs(counts - good).max() <= 1 for counts in shown), strong
        assert np.abs(shown[-1] - good).max() <= 1


@pytest.mark.parametrize("kind", FILMS)
def test_chip_that_was_reset_between_two_triggers_is_set_up_again(clock: Clock, kind: str) -> None:
    """Its bandwidth is then that of the slowest measurement, and its film may be turned over."""
    one = chip_of(clock, kind)
    pad, _ = emulated_pad(clock, kind, [one], rate_hz=20, trigger=1)
    good = run(pad, clock, 0.5, 20)[-1].counts[0]
    one.power_on()
    one.film.pulse(-1, clock(), 0.0)
    clock.sleep(0.03)
    samples = run(pad, clock, 1.0, 20)
    assert pad.config_repairs == 1
    assert all(np.abs(sample.counts[0] - good).max() <= 1 for sample in samples if sample.fresh)
    assert samples[-1].fresh == 1


@pytest.mark.parametrize("trigger", [0, 1])
@pytest.mark.parametrize("kind", FILMS)
def test_old_sample_is_not_new_when_a_command_was_lost(clock: Clock, kind: str, trigger: int) -> None:
    """The chip still says "done" of the sample before, because only a command clears that."""
    one = chip_of(clock, kind)
    pad, bus = emulated_pad(clock, kind, [one], rate_hz=100, trigger=trigger)
    run(pad, clock, 0.3, 100)
    transfer, command = bus._transfer, CHIPS[kind].driver.trigger

    def losing(messages: Any) -> list[bytes]:
        if messages[0][1] == command:
            raise OSError(121, "Remote I/O error")
        return transfer(messages)

    before = one.conversions
    bus._transfer = losing  # type: ignore[method-assign]
    fresh = sum(sample.fresh for sample in run(pad, clock, 0.025, 100))
    bus._transfer = transfer  # type: ignore[method-assign]
    assert fresh <= one.conversions - before + (1 - trigger)  # one sample may have been waiting
    assert run(pad, clock, 0.5, 100)[-1].fresh == 1


@pytest.mark.parametrize("kind", FILMS)
def test_sample_that_waited_for_a_reader_is_not_used(clock: Clock, kind: str) -> None:
    one = chip_of(clock, kind)
    pad, _ = emulated_pad(clock, kind, [one], rate_hz=100)
    run(pad, clock, 0.3, 100)
    clock.sleep(5.0)
    sample = run(pad, clock, 0.005, 100)[0]
    assert sample.fresh == 0
    assert run(pad, clock, 0.1, 100)[-1].fresh == 1


@pytest.mark.parametrize("gap_s", [0.02, 0.06, 3.0])
@pytest.mark.parametrize("rate_hz", [50, 100, 220])
@pytest.mark.parametrize("kind", FILMS)
def test_chip_that_was_reset_in_a_gap_is_set_up_again(clock: Clock, kind: str, rate_hz: int, gap_s: float) -> None:
    """After a wire came off, its film may be turned over, and its measurements may take 8 ms."""
    chips = [chip_of(clock, kind) for _ in range(8)]
    pad, _ = emulated_pad(clock, kind, chips, rate_hz=rate_hz)
    good = run(pad, clock, 0.3, rate_hz)[-1].counts[0]
    for one in chips:
        one.power_on()
        one.film.pulse(-1, clock(), 0.0)
    clock.sleep(gap_s)
    samples = run(pad, clock, 2.0, rate_hz)
    assert samples[-1].valid == 0xFF
    for sample in samples:
        for number, counts in enumerate(sample.counts):
            if sample.fresh >> number & 1:
                assert np.abs(counts - good).max() <= 1
    assert sum(sample.fresh == 0xFF for sample in samples) > 0.6 * len(samples)
