"""Hypothesis strategies for every packet that the wire can carry, whatever sense it makes."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st

from fmfts.sensor.wire.packets import (
    Early,
    Hello,
    HelloPad,
    HelloSensor,
    Load,
    Reply,
    Request,
    Sample,
    Selftest,
    SelftestSensor,
    Status,
    StatusPad,
)


def make_sample(counts: list, age_us: list, **fields: int) -> Sample:
    return Sample(counts=np.array(counts, np.int16), age_us=np.array(age_us, np.uint16), **fields)


def unsigned(bits: int) -> st.SearchStrategy[int]:
    return st.integers(0, 2**bits - 1)


def make_early(sensor: int = 0, time_us: int = 4545, **changes: int) -> Early:
    return Early(**({"pad_index": 0, "sensor": sensor, "gain_code": 3, "time_us": time_us} | changes), counts=(1, 2, 3))


signed16 = st.integers(-(2**15), 2**15 - 1)
axes = st.tuples(signed16, signed16, signed16)


@st.composite
def samples(draw: st.DrawFn) -> Sample:
    n = draw(st.integers(1, 16))
    sizes = {"pad_index": 4, "sequence": 32, "time_us": 48, "gain_code": 3, "trigger": 1}
    sizes |= dict.fromkeys(("valid", "fresh"), 8 if n <= 8 else 16)
    fields = {name: draw(unsigned(bits)) for name, bits in sizes.items()}
    counts = draw(st.lists(axes, min_size=n, max_size=n))
    ages = draw(st.lists(unsigned(16), min_size=n, max_size=n))
    return make_sample(counts, ages, temperature_raw=draw(signed16), **fields)


def tuples_of(strategy: st.SearchStrategy, most: int) -> st.SearchStrategy[tuple]:
    return st.lists(strategy, min_size=1, max_size=most).map(tuple)


u8, u16, u32, u48 = (unsigned(bits) for bits in (8, 16, 32, 48))
hello_sensors = st.builds(HelloSensor, u8, u8, st.binary(min_size=3, max_size=3))
hello_pads = st.builds(
    HelloPad, u8, u8, tuples_of(hello_sensors, 14)
)  # at most 16, but a packet does not hold three such pads
hellos = st.builds(
    Hello, st.tuples(u8, u8, u8), u8, u8, st.binary(min_size=12, max_size=12), u16, unsigned(3), unsigned(1),
    unsigned(1), tuples_of(hello_pads, 3), unsigned(1),
)  # fmt: skip
status_pads = st.builds(StatusPad, u32, u32, u32, tuples_of(u8, 16))
selftests = st.builds(Selftest, u8, unsigned(4), u8, tuples_of(st.builds(SelftestSensor, u8, axes, axes), 16))
packets = st.one_of(
    samples(),
    hellos,
    st.builds(Status, u48, u32, u32, tuples_of(status_pads, 3)),
    st.builds(Reply, u8, u8, u8),
    st.builds(Load, u32, u48, st.integers(-(2**31), 2**31 - 1)),
    st.builds(Early, unsigned(4), unsigned(4), unsigned(3), u48, axes),
    selftests,
    st.builds(Request, st.integers(8, 15), u8, u8, u16),
)
