"""A sweep on a Dask cluster: a real scheduler and two workers, one of which is killed meanwhile."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from fmfts_calibrate.sweep import Workers
from ports import tcp_base

PATIENCE_S = 60.0


def slow_square(number: int) -> float:
    time.sleep(0.2)
    return number**2 / 7


class Cluster:
    """A Dask scheduler and two workers, as processes."""

    def __init__(self, folder: Path) -> None:
        self.address = tcp_base()
        words = ["--host", self.address, "--no-dashboard", "--no-show"]
        environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
        self._environment, self._log = environment, (folder / "dask.log").open("w")
        self.scheduler = self._start("distributed.cli.dask_scheduler", *words)
        self.workers = [
            self._start("distributed.cli.dask_worker", self.address, "--nthreads", "1", "--no-nanny", "--no-dashboard")
            for _ in range(2)
        ]

    def _start(self, module: str, *words: str) -> subprocess.Popen[Any]:
        command = [sys.executable, "-m", module, *words]
        return subprocess.Popen(command, stdout=self._log, stderr=self._log, env=self._environment)

    def close(self) -> None:
        for process in (*self.workers, self.scheduler):
            process.kill()
            process.wait()
        self._log.close()


@pytest.fixture
def cluster(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Cluster]:
    monkeypatch.chdir(tmp_path)
    cluster = Cluster(tmp_path)
    yield cluster
    cluster.close()


@pytest.mark.filterwarnings("default")  # of Dask's own
def test_cluster_finishes_when_one_of_its_two_workers_is_killed(cluster: Cluster) -> None:
    told: dict[int, float] = {}

    def done(number: int, value: float) -> None:
        told[number] = value
        if len(told) == 2:  # both are at work
            cluster.workers[0].kill()

    pieces = [(number,) for number in range(20)]
    found = Workers(cluster=cluster.address).map(slow_square, pieces, done)
    assert cluster.workers[0].wait(PATIENCE_S) != 0
    assert found == [number**2 / 7 for number in range(20)]
    assert told == dict(enumerate(found))
