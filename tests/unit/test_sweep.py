"""Many pieces of work in processes and on a cluster: the same results in the same order, also when a worker is lost."""

from __future__ import annotations

import os
import signal
from concurrent.futures import BrokenExecutor
from pathlib import Path

import numpy as np
import pytest

from fmfts_calibrate import sweep
from fmfts_calibrate.sweep import ClusterError, Workers
from ports import tcp_base

PIECES = [(number,) for number in range(8)]
EXPECTED = [float(np.sin(number) * 1e-3) for number in range(8)]
PATIENCE_S = 60.0


def piece(number: int) -> float:
    return float(np.sin(number) * 1e-3)


def piece_that_kills_its_process_once(folder: str, number: int) -> float:
    mark = Path(folder, "killed")
    if number == 3 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return piece(number)


def piece_that_always_kills(number: int) -> float:
    os.kill(os.getpid(), signal.SIGKILL)
    return 0.0


def broken_piece(number: int) -> float:
    raise ArithmeticError(f"piece {number} does not converge")


@pytest.mark.parametrize("workers", [1, 2])
def test_results_come_in_order_and_each_is_reported_once(workers: int) -> None:
    told: dict[int, float] = {}
    assert Workers(workers).map(piece, PIECES, told.__setitem__) == EXPECTED
    assert told == dict(enumerate(EXPECTED))


@pytest.mark.parametrize("workers", [1, 2])
def test_sweep_raises_the_error_of_a_piece(workers: int) -> None:
    with pytest.raises(ArithmeticError, match="does not converge"):
        Workers(workers).map(broken_piece, PIECES)


def test_work_of_a_lost_process_is_done_again(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    pieces = [(str(tmp_path), number) for number in range(8)]
    assert Workers(2).map(piece_that_kills_its_process_once, pieces) == EXPECTED
    assert "a worker was lost" in caplog.text


def test_task_that_kills_every_process_ends_the_sweep(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sweep, "LOST_AT_MOST", 1)
    with pytest.raises(BrokenExecutor):
        Workers(2).map(piece_that_always_kills, PIECES[:1])


def test_scheduler_that_is_not_there_is_error_with_its_address() -> None:
    import dask
    import distributed  # noqa: F401 - sets the defaults that the next line changes

    address = tcp_base()
    with dask.config.set({"distributed.comm.timeouts.connect": "0.5s"}), pytest.raises(ClusterError, match=address):
        Workers(cluster=address).map(piece, PIECES)
