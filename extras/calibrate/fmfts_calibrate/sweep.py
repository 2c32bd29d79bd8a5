"""Runs many independent pieces of work in an Executor: processes of this machine, or a Dask cluster.

The result is that of one process, to the last bit: each piece is computed by itself, with one thread, and results are
taken in the order of the pieces.
"""

from __future__ import annotations

import logging
import multiprocessing
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from typing import Any, TypeVar

T = TypeVar("T")
Piece = tuple[Any, ...]  # the arguments of one call; they and the result are pickled
MakeExecutor = Callable[[], Executor]

LOST_AT_MOST = 3  # times that a sweep begins again with new processes, before it fails

log = logging.getLogger("fmfts")


class ClusterError(Exception):
    """A cluster cannot be used; the text says why and what to do."""


class Workers:
    """Where a sweep runs. workers: processes of this machine; cluster: address of a Dask scheduler; neither: here."""

    def __init__(self, workers: int = 1, cluster: str | None = None) -> None:
        self.workers, self.cluster = workers, cluster

    def map(
        self, function: Callable[..., T], pieces: Sequence[Piece], done: Callable[[int, T], None] = lambda *_: None
    ) -> list[T]:
        """Results of `function(*piece)` in the order of `pieces`.

        done: called here with the number of a piece and its result, as soon as it is finished, in any order. What a
        lost process had to do is done again. Raises what `function` raises, and ClusterError.
        """
        if self.cluster is None and self.workers <= 1:
            results = []
            for number, piece in enumerate(pieces):
                results.append(function(*piece))
                done(number, results[-1])
            return results
        with self._executors() as make:
            return _spread(make, function, pieces, done)

    @contextmanager
    def _executors(self) -> Iterator[MakeExecutor]:
        if self.cluster is None:
            # Not fork: libraries' threads do not survive it.
            context = multiprocessing.get_context("spawn")
            yield lambda: ProcessPoolExecutor(self.workers, mp_context=context)
            return
        try:
            from distributed import Client
        except ImportError as error:
            raise ClusterError(f"{error}: a cluster needs the extra `cluster`: pip install 'fmfts[cluster]'") from error
        try:
            client = Client(self.cluster, set_as_default=False)  # type: ignore[no-untyped-call]
        except (OSError, ValueError) as error:
            raise ClusterError(f"no Dask scheduler answers at {self.cluster}: {error}") from error
        with client:
            yield client.get_executor


def _spread(
    make: MakeExecutor, function: Callable[..., T], pieces: Sequence[Piece], done: Callable[[int, T], None]
) -> list[T]:
    found: dict[int, T] = {}
    for attempt in range(LOST_AT_MOST + 1):
        executor = make()
        futures: dict[Future[T], int] = {}
        try:
            for number, piece in enumerate(pieces):
                if number not in found:
                    futures[executor.submit(function, *piece)] = number
            for future in as_completed(futures):
                number = futures[future]
                found[number] = future.result()
                done(number, found[number])
            return [found[number] for number in range(len(pieces))]
        except BrokenExecutor:
            if attempt == LOST_AT_MOST:
                raise
            log.warning("a worker was lost; %d of %d pieces are done, the others begin again", len(found), len(pieces))
        finally:
            for future in futures:
                future.cancel()
            executor.shutdown(wait=False)
    raise AssertionError("unreachable")
