"""Arguments that only a program error or a damaged file passes to C: it refuses them, or leaves them to Python.

tests/sanitized/odd_calls.py, which found these, tries thousands under the sanitizers: `make sanitize`.
"""

from __future__ import annotations

import numpy as np
import pytest
from several_world import models_of
from test_refine import RESPONSES

from fmfts.arithmetic import _arithmetic
from fmfts.contact import _contact
from fmfts.contact.refinement import Refiner
from fmfts.pose import _kernel
from fmfts.pose.alignment import Alignment
from fmfts.sensor.wire import _wire
from fmfts.sensor.wire.clock import DeviceClock


def misaligned(numbers: np.ndarray) -> memoryview:
    return memoryview(bytearray(b"\0" + numbers.tobytes()))[1:]


def test_sizes_whose_product_overflows_are_refused() -> None:
    with pytest.raises(ValueError, match="array 0"):
        _arithmetic.cholesky(2**62, 2, bytearray())
    with pytest.raises(ValueError, match="array 2"):
        _arithmetic.product(2**62, 2, 1, 2, np.ones(2), np.ones(2), bytearray())
    with pytest.raises(ValueError, match="array 0"):
        _arithmetic.solve_lower(2**62, 2, 2, b"", bytearray())
    with pytest.raises(ValueError, match="at most"):
        _kernel.solve(2**60, 2**60, 1, *[b""] * 4, *[None] * 4, 0.0, 1, False, *[bytearray()] * 4)


def test_more_columns_than_rows_have_no_complement() -> None:
    with pytest.raises(ValueError, match="5 columns of 0 rows"):
        _arithmetic.complement(0, 5, bytearray(), bytearray())
    with pytest.raises(ValueError, match="-1 columns"):
        _arithmetic.complement(0, -1, bytearray(), bytearray())


def test_arrays_at_an_odd_address_are_refused() -> None:
    network = np.ones(3, np.float32)
    with pytest.raises(ValueError, match="odd address"):
        _contact.infer(misaligned(network), network, network.copy(), network.copy())
    with pytest.raises(ValueError, match="odd address"):
        _arithmetic.cholesky(1, 2, misaligned(np.eye(2)))


@pytest.mark.parametrize("response", RESPONSES, ids=["normal", "sheared"])
def test_press_with_nan_stays_on_the_table(response: object) -> None:
    refiner = Refiner(response)  # type: ignore[arg-type]
    press, *_ = refiner.refined(np.full(2 + refiner.response.loads, np.nan), np.zeros(5), 1e-6 * np.eye(5))
    assert np.isfinite(press).all()
    assert (press[:2] >= refiner.response.first_mm).all()


@pytest.mark.parametrize("number", [6, 7, 8], ids=["spacing x", "spacing y", "scale"])
@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf])
def test_response_without_a_spacing_or_a_scale_is_refused(number: int, value: float) -> None:
    table = bytearray(RESPONSES[0].packed())
    np.frombuffer(table, count=9)[number] = value
    with pytest.raises(ValueError, match="response"):
        _contact.refine(table, np.zeros(5), np.eye(5), 2, 0.0, np.zeros(3), np.empty((3, 3)))


@pytest.mark.parametrize(("number", "value"), [(5, np.nan), (6, 0.0), (6, -1.0), (6, np.nan), (6, np.inf)])
def test_table_of_fingers_without_a_spacing_is_refused(number: int, value: float) -> None:
    model = models_of(1)
    model.packed[number] = value
    with pytest.raises(ValueError, match="model"):
        model.predict(np.array([[1.0, 1.0, 0.5]]))


def test_times_that_no_board_counts_are_refused() -> None:
    clock = DeviceClock()
    clock.to_host_ns(1_000_000, 2_000_000_000)
    for device_us, arrival_ns in ((2**63 - 1, 2_000_000_000), (1_000_000, -(2**63))):
        with pytest.raises(ValueError, match="no clock tells that"):
            _wire.host_time(clock.line, device_us, arrival_ns)
    fresh = np.ones(4, bool)
    with pytest.raises(ValueError, match="no board's clock counts so far"):
        Alignment(4, 4545).push(np.zeros((4, 3)), np.full(4, 2**63 - 1), fresh, fresh, None)
