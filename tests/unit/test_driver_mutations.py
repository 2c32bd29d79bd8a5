# ruff: noqa: E501  a mutation is easier to read in one line
"""Wrong drivers, each with one mistake: the checks of every chip must catch all of them, and pass the right one.

A mutation replaces a piece of the driver's file. The emulated chips share no code with the drivers, so that a slip in a
driver shows; but both share facts that they took from the same source.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from emulated_bus import Clock, clock, emulated_pad, run
from test_chip_drivers import FIELD_GAUSS, KINDS, PROMISED, RATE_HZ, chip_of

import fmfts.sensor.chips as chips_package
from fmfts.sensor.chips import CHIPS, Chip
from fmfts.sensor.i2c import selftest as i2c_selftest
from fmfts.sensor.wire.packets import SensorState

pytestmark = pytest.mark.mutation

__all__ = ["clock"]
FOLDER = Path(chips_package.__file__).parent

# (chip, the mistake, the correct text, the wrong one)
MUTATIONS = [
    ("qmc5883l", "high byte first", 'Struct("<hhh")', 'Struct(">hhh")'),
    ("qmc5883l", "range bits shifted wrongly", "setup.gain_code << 4", "setup.gain_code << 5"),
    ("qmc5883l", "output rate shifted wrongly", "rate << 2", "rate << 1"),
    ("qmc5883l", "no continuous mode", "MODE_CONTINUOUS = 0x01", "MODE_CONTINUOUS = 0x00"),
    ("qmc5883l", "no roll-over: the status is followed by the temperature", "ROLL_OVER | NO_INTERRUPT", "NO_INTERRUPT"),
    ("qmc5883l", "the status's register is wrong", "STATUS, CONTROL_1, CONTROL_2 = 0x06", "STATUS, CONTROL_1, CONTROL_2 = 0x05"),
    ("qmc5883l", "takes samples that are not ready", "if not status & STATUS_READY:", "if not status | STATUS_READY:"),
    ("qmc5883l", "a saturated axis is no fault", "return overflowing(chip, _AXES.unpack(block[1:]), bool(block[0]))", "return _AXES.unpack(block[1:])"),
    ("qmc5883l", "the last count counts as a field", "largest_count=32766", "largest_count=32768"),
    ("qmc5883l", "scale of the other range", "(12000, 3000)", "(3000, 12000)"),
    ("qmc5883l", "set and reset are not set up", "SET_RESET_PERIOD = 0x01", "SET_RESET_PERIOD = 0x00"),
    ("qmc5883l", "any identification will do", 'identity_mask=b"\\x3e\\xfe\\xff"', 'identity_mask=b"\\x00\\x00\\x00"'),
    ("qmc5883l", "never looks whether its settings are kept", "wires.exchange(bytes((CONTROL_1,)), 3) == _configuration(chip, setup)", "True"),
    ("lis3mdl", "high byte first", 'Struct("<hhh")', 'Struct(">hhh")'),
    ("lis3mdl", "no advance: one register six times", "ADVANCE = 0x80", "ADVANCE = 0x00"),
    ("lis3mdl", "range bits shifted wrongly", "setup.gain_code << 5", "setup.gain_code << 4"),
    ("lis3mdl", "z has another performance", "performance << 2", "performance"),
    ("lis3mdl", "stays off", "MODE_OFF if setup.single else MODE_CONTINUOUS", "MODE_OFF"),
    ("lis3mdl", "not fast: 10 Hz in place of 155", "THERMOMETER_ON, FAST = 0x80, 0x02", "THERMOMETER_ON, FAST = 0x80, 0x10"),
    ("lis3mdl", "thermometer off", "THERMOMETER_ON, FAST = 0x80, 0x02", "THERMOMETER_ON, FAST = 0x00, 0x02"),
    ("lis3mdl", "temperature high byte first", '"little", signed=True', '"big", signed=True'),
    ("lis3mdl", "temperature read on from the axes", "bytes((ADVANCE | TEMPERATURE,)), 2", "bytes((ADVANCE | 0x2C,)), 4"),
    ("lis3mdl", "temperature has no zero at 25", "at_zero_c=25.0", "at_zero_c=0.0"),
    ("lis3mdl", "high and low bytes need not belong together", "BLOCK_UPDATE = 0x40", "BLOCK_UPDATE = 0x00"),
    ("lis3mdl", "x alone makes it ready", "if answer[0] & STATUS_READY else (False, None)", "if True else (False, None)"),
    ("lis3mdl", "beyond its full scale it counts on", "largest_count=27366", "largest_count=32767"),
    ("lis3mdl", "another chip's name", 'identity=b"\\x3d\\x00\\x00"', 'identity=b"\\x3e\\x00\\x00"'),
    ("qmc5883p", "high byte first", 'Struct("<hhh")', 'Struct(">hhh")'),
    ("qmc5883p", "never defines the signs of its axes", "wires.write(bytes((SIGNS, SIGNS_OF_AXES)))", "pass"),
    ("qmc5883p", "range codes count from the finest", "WIDEST_RANGE - setup.gain_code << 2", "setup.gain_code << 2"),
    ("qmc5883p", "range bits where ArduPilot has them", "WIDEST_RANGE - setup.gain_code << 2", "WIDEST_RANGE - setup.gain_code << 4"),
    ("qmc5883p", "stays suspended", "MODE_NORMAL = 0x01", "MODE_NORMAL = 0x00"),
    ("qmc5883p", "output rate shifted wrongly", "rate << 2", "rate << 4"),
    ("qmc5883p", "axes where the QMC5883L has them", "IDENTIFICATION, AXES, STATUS, CONTROL_1, SIGNS = 0x00, 0x01", "IDENTIFICATION, AXES, STATUS, CONTROL_1, SIGNS = 0x00, 0x00"),
    ("qmc5883p", "status where the QMC5883L has it", "0x00, 0x01, 0x09, 0x0A, 0x29", "0x00, 0x01, 0x06, 0x0A, 0x29"),
    ("qmc5883p", "takes samples that are not ready", "if not status & STATUS_READY:", "if False:"),
    ("qmc5883p", "does not look for a sample that ended meanwhile", "for _ in range(2):", "for _ in range(1):"),
    ("qmc5883p", "the last count counts as a field", "largest_count=30000", "largest_count=32768"),
    ("qmc5883p", "scale of another range", "(15000, 3750, 2500, 1000)", "(12000, 3000, 2500, 1000)"),
    ("qmc5883p", "never looks whether its settings are kept", "wires.exchange(bytes((CONTROL_1,)), 2) == _configuration(chip, setup)", "True"),
    ("mmc5983ma", "signed, though zero is in the middle", '"big") - _ZERO', '"big", signed=True)'),
    ("mmc5983ma", "low byte first", '"big") - _ZERO', '"little") - _ZERO'),
    ("mmc5983ma", "as it was believed: automatic set and reset, 2 ms", "MEASURE_FIELD, SET_PULSE, RESET_PULSE = 0x01", "MEASURE_FIELD, SET_PULSE, RESET_PULSE = 0x21"),
    ("mmc5983ma", "no set pulse in set-up", "        wires.write(self.set_pulse)\n", ""),
    ("mmc5603nj", "no pause after a pulse", "PULSE_PAUSE_S = 1e-3", "PULSE_PAUSE_S = 0.0"),
    ("mmc5983ma", "resets in place of the set", "RESET_PULSE = 0x01, 0x08, 0x10", "RESET_PULSE = 0x01, 0x10, 0x08"),
    ("mmc5983ma", "reads what is not done", "if not wires.exchange(self.to_status, 1)[0] & self.done:", "if False:"),
    ("mmc5983ma", "waits for the thermometer", "done=0x01", "done=0x02"),
    ("mmc5983ma", "measures for 8 ms", "BANDWIDTH = 2", "BANDWIDTH = 0"),
    ("mmc5983ma", "does not wait for its reset", "time.sleep(self.reset_s)", "time.sleep(0.0)"),
    ("mmc5983ma", "scale of 18 bits with 16", "(4096, 4096, -4096)", "(16384, 16384, -16384)"),
    ("mmc5983ma", "right-handed, though it is not", "(4096, 4096, -4096)", "(4096, 4096, 4096)"),
    ("mmc5983ma", "triggers the thermometer", "MEASURE_FIELD, SET_PULSE, RESET_PULSE = 0x01", "MEASURE_FIELD, SET_PULSE, RESET_PULSE = 0x02"),
    ("mmc5983ma", "a strong field is forgotten", "upset_gauss=9.0, doubtful_gauss=5.0", "upset_gauss=90.0, doubtful_gauss=90.0"),
    ("mmc5983ma", "self-test: automatic set and reset", "measure=bytes((CONTROL_0, MEASURE_FIELD))", "measure=bytes((CONTROL_0, 0x20 | MEASURE_FIELD))"),
    ("mmc5983ma", "self-test: sets in place of the reset", "reset_pulse=bytes((CONTROL_0, RESET_PULSE))", "reset_pulse=bytes((CONTROL_0, 0x08))"),
    ("mmc5983ma", "self-test: the coil's bits are one lower", "COIL_ONE_WAY, COIL_OTHER_WAY = 0x02, 0x04", "COIL_ONE_WAY, COIL_OTHER_WAY = 0x01, 0x02"),
    ("mmc5983ma", "self-test: the coil's current is never turned over", "bytes((CONTROL_3, COIL_OTHER_WAY))", "bytes((CONTROL_3, COIL_ONE_WAY))"),
    ("mmc5983ma", "self-test: calls a dead axis good", "least_coil_gauss=10e-3", "least_coil_gauss=0.0"),
    ("mmc5983ma", "self-test: the limit of the zero is ten times too large", "largest_zero_gauss=0.5", "largest_zero_gauss=5.0"),
    ("mmc5603nj", "the MMC5983MA's status", "status=0x18", "status=0x08"),
    ("mmc5603nj", "the MMC5983MA's controls", "control_0=0x1B", "control_0=0x09"),
    ("mmc5603nj", "the MMC5983MA's identification", "product=0x39", "product=0x2F"),
    ("mmc5603nj", "waits for the thermometer", "done=0x40", "done=0x80"),
    ("mmc5603nj", "the MMC5983MA's reset of 10 ms", "reset_s=20e-3", "reset_s=10e-3"),
    ("mmc5603nj", "scale of the MMC5983MA", "(1024, 1024, -1024)", "(4096, 4096, -4096)"),
    ("mlx90393", "RES 0, which wraps around", "RESOLUTION = 2", "RESOLUTION = 0"),
    ("mlx90393", "RES 3, its zero is elsewhere", "RESOLUTION = 2", "RESOLUTION = 3"),
    ("mlx90393", "signed, though zero is in the middle", 'Struct(">HHHH")', 'Struct(">hhhh")'),
    ("mlx90393", "temperature read as x", "_, x, y, z = _MEASUREMENT", "x, y, z, _ = _MEASUREMENT"),
    ("mlx90393", "z has the step of x", "_per_gauss(z)) for xy, z", "_per_gauss(xy)) for xy, z"),
    ("mlx90393", "gains in the other order", "FINEST_GAIN_SEL - setup.gain_code", "setup.gain_code"),
    ("mlx90393", "a filter that never ends (erratum of HALLCONF)", "RESOLUTIONS | filtered << 2", "RESOLUTIONS | (filtered & 1) << 2"),
    ("mlx90393", "overwrites what the factory wrote", "_register(wires, 0)[1:], \"big\") & ~ANALOG", "_register(wires, 0)[1:], \"big\") & 0"),
    ("mlx90393", "register's number is not shifted", "value & 0xFF, number << 2", "value & 0xFF, number"),
    ("mlx90393", "the first status after a reset is not read", "status = wires.exchange(bytes(((SINGLE if setup.single else BURST) | ALL,)), 1)", "status = wires.exchange(bytes(((NOTHING if setup.single else BURST) | ALL,)), 1) if not setup.single else b'\\0'"),
    ("mlx90393", "waits as its table says", "single_wait_s=1.3 * ", "single_wait_s=1.08 * "),
    ("mlx90393", "set up in a burst, without leaving it", "wires.exchange(bytes((EXIT,)), 1)", "wires.exchange(bytes((NOTHING,)), 1)"),
    ("mlx90393", "an error counts as a sample", "if answer[0] & STATUS_ERROR else", "if False else"),
    ("mlx90393", "pauses 20 ms between measurements", "BURST_OF_ALL = 0x8000, ALL << 6", "BURST_OF_ALL = 0x8000, ALL << 6 | 1"),
    ("mlx90393", "does not see that a reset ended the burst", "return _is_in_burst(status)\n\n    def sample", "return True\n\n    def sample"),
    ("mlx90393", "beyond the converter's end it counts on", "largest_count=_LARGEST - 1", "largest_count=_LARGEST + 10000"),
    ("mlx90393", "temperature's zero is another", "46244) / 45.2", "46000) / 45.2"),
]  # fmt: skip


def mutated(kind: str, right: str, wrong: str) -> Chip:
    """The chip of a file in which `wrong` replaces `right`."""
    path = FOLDER / f"{kind}.py"
    source = path.read_text(encoding="utf-8")
    if "chips.memsic import" in source:  # this chip's registers have a file of their own
        lines = (line for line in source.splitlines() if "chips.memsic import" not in line and "__future__" not in line)
        source = (FOLDER / "memsic.py").read_text(encoding="utf-8") + "\n".join(lines)
    assert right in source, f"the mutation of {kind} mutates nothing: {right}"
    module = ModuleType(f"mutated_{kind}")
    sys.modules[module.__name__] = module  # where dataclasses look for it
    exec(compile(source.replace(right, wrong), str(path), "exec"), module.__dict__)
    chip: Chip = getattr(module, kind.upper())
    return chip


def made(clock: Clock, kind: str, **options: Any) -> Any:
    return chip_of(clock, kind, **options)


def scale_and_saturation(clock: Clock, kind: str) -> None:
    for promised in (each for each in PROMISED if each.name == kind):
        one = made(clock, kind)
        pad, _ = emulated_pad(clock, kind, [one], gain_code=promised.gain_code, rate_hz=100)
        due = np.array(FIELD_GAUSS) * promised.counts_per_gauss
        counts = run(pad, clock, 0.3, 100)[-1].counts[0]
        assert np.abs(counts - due).max() <= 1.0 + 0.002 * np.abs(due).max()
        step_t = CHIPS[kind].step_t[promised.gain_code]
        assert counts * step_t == pytest.approx(np.array(FIELD_GAUSS) * 1e-4, abs=float(step_t.max()))
        for axis in range(3):
            for times in (1.05, -1.05) if CHIPS[kind].film else (1.7, -3.9):
                beyond = times * promised.range_gauss
                one.field_gauss = [beyond if each == axis else 0.1 for each in range(3)]
                flags = run(pad, clock, 0.1, 100)[-1].counts[0] == CHIPS[kind].saturated_count
                assert flags.tolist() == [each == axis or CHIPS[kind].film is not None for each in range(3)]
        one.field_gauss = list(FIELD_GAUSS)
        # The strong field has no effect any more. Quiet: the chip's state before it was saturated does not matter.
        assert np.abs(run(pad, clock, 0.2, 100)[-1].counts[0] - counts).max() <= 1
    if kind == "qmc5883l":
        assert one.registers[0x0B] == 0x01  # recommended (section 9.2.5)
    if kind == "lis3mdl":
        assert one.registers[0x24] & 0x40  # block data update
        assert one.registers[0x23] >> 2 & 3 == one.registers[0x20] >> 5 & 3  # one performance for all axes


def stream(clock: Clock, kind: str) -> None:
    """Every conversion once, at the requested rate, whatever else happens."""
    rate_hz = RATE_HZ[kind]
    one = made(clock, kind, noise_gauss=0.0)
    pad, _ = emulated_pad(clock, kind, [one], rate_hz=rate_hz)
    run(pad, clock, 0.3, 2 * rate_hz)
    before = one.conversions
    samples = run(pad, clock, 3.0, 4 * rate_hz, watch_s=1e9)
    conversions = one.conversions - before
    assert conversions >= 3.0 * rate_hz * 0.98
    assert abs(sum(sample.fresh & 1 for sample in samples) - conversions) <= 1
    assert pad.config_repairs == 0


def reset_is_noticed(clock: Clock, kind: str) -> None:
    one = made(clock, kind)
    gain_code = len(CHIPS[kind].ranges_gauss) - 1
    pad, _ = emulated_pad(clock, kind, [one], gain_code=gain_code, rate_hz=100)
    good = run(pad, clock, 0.3, 100)[-1].counts[0]
    one.power_on()
    samples = run(pad, clock, 1.5, 100)
    assert samples[-1].valid == 1
    assert all(np.abs(sample.counts[0] - good).max() <= 1 for sample in samples if sample.valid)
    if kind in ("qmc5883l", "qmc5883p", "lis3mdl"):  # a bit of the range is flipped
        register, bit = {"qmc5883l": (0x09, 0x10), "qmc5883p": (0x0B, 0x04), "lis3mdl": (0x21, 0x20)}[kind]
        one.registers[register] ^= bit
        run(pad, clock, 1.0, 100)
        assert pad.config_repairs == 1
        assert np.abs(run(pad, clock, 0.2, 100)[-1].counts[0] - good).max() <= 1
    # The first samples after it are judged, and the check must detect a reset without a silence.
    one.power_on()
    if kind == "mlx90393":
        repairs = pad.config_repairs
        pad.watch()
        assert pad.config_repairs == repairs + 1
    # Set up again while it measures: in a burst an MLX90393 would refuse.
    run(pad, clock, 1.0, 100)
    pad.configure(pad.settings)
    assert pad.sensors[0].state == SensorState.OK


def stream_at_its_own_rate(clock: Clock, kind: str) -> None:
    """Read as often as it converts, a sample may end while it is read: none comes twice."""
    if CHIPS[kind].paced_by_host:
        return
    rate_hz = RATE_HZ[kind]
    one = made(clock, kind, noise_gauss=100e4 * CHIPS[kind].coarseness_t(0).max(), clock_error=0.003)
    pad, _ = emulated_pad(clock, kind, [one], rate_hz=rate_hz)
    run(pad, clock, 0.3, rate_hz)
    before = one.conversions
    counts = [tuple(sample.counts[0]) for sample in run(pad, clock, 20.0, rate_hz, watch_s=1e9) if sample.fresh]
    assert len(set(counts)) == len(counts)
    # 0.2 ms of 5 ms are between the status of a QMC5883P and its axes: a sample that ends then replaces its predecessor.
    assert len(counts) >= 0.95 * (one.conversions - before)


def temperature(clock: Clock, kind: str) -> None:
    if CHIPS[kind].thermometer is None:
        return
    one = made(clock, kind)
    one.temperature_c = 41.0
    pad, _ = emulated_pad(clock, kind, [one], rate_hz=100)
    raw = run(pad, clock, 1.0, 100)[-1].temperature_raw
    assert CHIPS[kind].temperature_c(raw) == pytest.approx(41.0, abs=0.13)


def trigger(clock: Clock, kind: str) -> None:
    if not CHIPS[kind].has_trigger:
        return
    one = made(clock, kind)
    if kind == "mlx90393":
        one.slowness = 1.29  # reported by users of Adafruit's library (issues 17 and 18)
    pad, _ = emulated_pad(clock, kind, [one], rate_hz=50, trigger=1)
    samples = run(pad, clock, 1.0, 50)[3:]
    assert all(sample.fresh == 1 for sample in samples)
    assert pad.bus_errors == 0
    counts = run(pad, clock, 0.2, 50)[-1].counts[0]
    step_t = CHIPS[kind].step_t[0]
    assert counts * step_t == pytest.approx(np.array(FIELD_GAUSS) * 1e-4, abs=float(np.abs(step_t).max()))
    one.field_gauss = [40.0, 0.0, 0.0]
    run(pad, clock, 0.2, 50)
    one.field_gauss = list(FIELD_GAUSS)
    assert np.abs(run(pad, clock, 0.2, 50)[-1].counts[0] - counts).max() <= 1


def selftest(clock: Clock, kind: str) -> None:
    """The self-test of bridges that pulses turn over; the LIS3MDL's has a test of its own (test_own_field.py)."""
    if CHIPS[kind].set_reset is None:
        return
    zeros_gauss, dead, magnetised = (0.3, -0.2, 0.1), made(clock, kind), made(clock, kind)
    good = made(clock, kind)
    good.zero_gauss, dead.coil_gauss, magnetised.zero_gauss = zeros_gauss, (0.125, 0.0, 0.125), (0.0, 0.0, 0.6)
    pad, _ = emulated_pad(clock, kind, [good, dead, magnetised], rate_hz=100)
    run(pad, clock, 0.1, 100)
    sensors = i2c_selftest.measure(pad, 1).sensors
    step_gauss = CHIPS[kind].step_t[0, 0] * 1e4
    assert np.array(sensors[0].positive) * step_gauss == pytest.approx(zeros_gauss, abs=2 * step_gauss)
    assert np.abs(sensors[0].negative) * step_gauss == pytest.approx(2 * np.array(good.coil_gauss), abs=2 * step_gauss)
    failed = SensorState.SELFTEST_FAILED
    assert [sensor.state for sensor in sensors] == [SensorState.OK, failed, failed]


def film(clock: Clock, kind: str) -> None:
    """A field that upsets the film without saturating an axis leaves nothing behind."""
    if CHIPS[kind].film is None:
        return
    one = made(clock, kind)
    pad, _ = emulated_pad(clock, kind, [one], rate_hz=100)
    good = run(pad, clock, 0.2, 100)[-1].counts[0]
    one.field_gauss = [0.65 * one.upsetting_gauss] * 3
    run(pad, clock, 0.1, 100)
    assert one.film.upset
    one.field_gauss = list(FIELD_GAUSS)
    shown = [sample.counts[0] for sample in run(pad, clock, 0.2, 100)]
    assert all(
        (counts == CHIPS[kind].saturated_count).all() or np.abs(counts - good).max() <= 1 for counts in shown[1:]
    )
    assert np.abs(shown[-1] - good).max() <= 1


def identity(clock: Clock, kind: str) -> None:
    one = made(clock, kind)
    pad, _ = emulated_pad(clock, kind, [one], rate_hz=100)
    run(pad, clock, 0.1, 100)
    assert pad.sensors[0].state == SensorState.OK
    assert not CHIPS[kind].is_identity(b"H43")
    assert not CHIPS[kind].is_identity(b"\x00\x00\x00")
    assert not CHIPS[kind].is_identity(b"\xff\xff\xff")  # as on a bus that nobody drives


CHECKS: tuple[Callable[[Clock, str], None], ...] = (
    identity,
    temperature,
    trigger,
    reset_is_noticed,
    film,
    selftest,
    stream,
    stream_at_its_own_rate,
    scale_and_saturation,
)


@pytest.mark.parametrize("kind", KINDS)
def test_right_driver_passes_every_check(clock: Clock, kind: str) -> None:
    for check in CHECKS:
        check(clock, kind)


@pytest.mark.parametrize(("kind", "what", "right", "wrong"), MUTATIONS, ids=[f"{m[0]}: {m[1]}" for m in MUTATIONS])
def test_wrong_driver_is_caught(
    clock: Clock, monkeypatch: pytest.MonkeyPatch, kind: str, what: str, right: str, wrong: str
) -> None:
    monkeypatch.setitem(CHIPS, kind, mutated(kind, right, wrong))
    for check in CHECKS:
        try:
            check(clock, kind)
        except (AssertionError, IndexError, ValueError):
            return
    pytest.fail(f"nothing notices a {kind} driver with this mistake: {what}")
