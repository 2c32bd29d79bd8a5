"""The firmware's ELF with eight sensors behind one mux, which a host makes one pad."""

from __future__ import annotations

import pytest
from emulated_stream import EmulatedStream

from emulator.chips import Hmc5983
from emulator.magnetometers import Lis3mdl, Mmc5983ma, Qmc5883l
from emulator.mlx90393 import Mlx90393
from emulator.stm32_board import Place
from fmfts.sensor.wire.packets import Hello, Result, Sample, Selftest, Verb

pytestmark = pytest.mark.needs("arm-none-eabi-gcc")

HALVES, OTHER = (Place(1, 0x70, 0), Place(1, 0x70, 4)), Place(2, 0x70, 0)
EIGHT, ALL = 0x8, 0xFF


def counts(hello: Hello) -> list[int]:
    return [len(pad.sensors) for pad in hello.pads]


def made(*places: Place) -> EmulatedStream:
    stream = EmulatedStream(places=places)
    stream.run(0.3)
    assert counts(stream.hello) == [4] * len(places)
    assert stream.hello.can_make_pads
    assert stream.request(Verb.HELLO, EIGHT).result == Result.DONE
    stream.wait(lambda packet: isinstance(packet, Hello) and len(packet.pads[0].sensors) == 8, 0.3)
    stream.wait(lambda packet: isinstance(packet, Sample) and packet.valid == ALL, 0.3)
    return stream


def test_eight_sensors_become_one_pad_whose_frames_are_whole() -> None:
    stream = made(*HALVES, OTHER)
    assert counts(stream.hello) == [8, 4]
    assert [sensor.channel for sensor in stream.hello.pads[0].sensors] == list(range(8))
    for number, chip in enumerate(stream.board.sensors[0] + stream.board.sensors[1]):
        chip.feel([0.1 * number, -0.1 * number, 0.5])
    stream.run(0.05)
    samples = stream.samples(1.0)
    assert len(samples) >= 219
    assert all(sample.valid == ALL for sample in samples)
    assert [round(x / 660, 2) for x in samples[-1].counts[:, 0]] == [round(0.1 * number, 2) for number in range(8)]
    assert all(sample.valid == 0b1111 for sample in stream.packets if isinstance(sample, Sample) and sample.pad_index)
    assert stream.is_clean()


def test_eight_sensors_take_one_trigger_and_a_selftest() -> None:
    stream = made(*HALVES)
    assert stream.request(Verb.TRIGGER, 1).result == Result.DONE
    assert stream.request(Verb.RATE, 152).result == Result.DONE
    stream.run(0.1)
    samples = stream.samples(0.5)
    assert len(samples) >= 75
    assert all(sample.fresh == ALL for sample in samples)
    stream.request(Verb.SELFTEST, pad=0)
    stream.wait(lambda packet: isinstance(packet, Selftest), 0.6)
    assert [sensor.state for sensor in stream.latest(Selftest).sensors] == [0] * 8


# From lab/results/chips.md: gain code, and the frames a second that eight of a kind sustain, running free and with one
# trigger (0: they take none).
RATES_HZ = {
    "hmc5983": (Hmc5983, 3, 220, 152),
    "qmc5883l": (Qmc5883l, 1, 200, 0),
    "mmc5983ma": (Mmc5983ma, 0, 220, 130),
    "mlx90393": (Mlx90393, 0, 220, 109),
    "lis3mdl": (Lis3mdl, 3, 155, 79),
}


@pytest.mark.long
@pytest.mark.parametrize("kind", RATES_HZ)
def test_eight_of_each_kind_keep_their_frames(kind: str) -> None:
    emulated, gain_code, free_hz, triggered_hz = RATES_HZ[kind]
    stream = EmulatedStream(places=HALVES)
    mux = next(iter(stream.board.muxes.values()))
    for channel in range(8 if emulated is not Hmc5983 else 0):
        error = (channel - 3.5) * 0.008  # of its clock
        mux.channels[channel] = emulated(lambda: stream.board.machine.now_s, [0.1, -0.2, 0.3], clock_error=error)
    stream.run(0.3)
    stream.request(Verb.HELLO, EIGHT)
    stream.wait(lambda packet: isinstance(packet, Hello) and len(packet.pads[0].sensors) == 8, 0.3)
    assert stream.request(Verb.RANGE, gain_code).result == Result.DONE
    for trigger, rate_hz in ((0, free_hz), (1, triggered_hz))[: 2 if triggered_hz else 1]:
        assert stream.request(Verb.TRIGGER, trigger).result == Result.DONE
        assert stream.request(Verb.RATE, rate_hz).result == Result.DONE
        if trigger:
            assert stream.request(Verb.RATE, rate_hz + 1).result == Result.OUT_OF_RANGE
        stream.run(0.3)
        samples = stream.samples(1.0)
        assert rate_hz - 1 <= len(samples) <= rate_hz + 1
        assert all(sample.valid == ALL and (sample.fresh == ALL or not trigger) for sample in samples)
    assert stream.is_clean()


def test_pad_of_eight_outlives_watchdog_reset_and_not_power_off() -> None:
    stream = made(*HALVES, OTHER)
    stream.packets.clear()
    stream.board.machine.reset("watchdog")
    stream.wait(lambda packet: isinstance(packet, Hello), 0.5)
    assert counts(stream.hello) == [8, 4]
    assert {len(packet.counts) for packet in stream.packets if isinstance(packet, Sample) and not packet.pad_index} <= {
        8
    }
    stream.board.machine.reset("power")
    stream.packets.clear()
    stream.wait(lambda packet: isinstance(packet, Hello), 0.5)
    assert counts(stream.hello) == [4, 4, 4]
