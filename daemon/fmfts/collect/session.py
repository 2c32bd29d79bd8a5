"""The work itself: place by place, an untouched moment, then each force; a row for each, on the disk at once."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import groupby

import numpy as np

from fmfts.baseline import Mounting
from fmfts.collect.average import Averaged, RowError, Unmoved, average, require_touched
from fmfts.collect.errors import CollectError, StoppedError
from fmfts.collect.frames import Frames
from fmfts.collect.plan import Plan, Press
from fmfts.collect.presser import Presser
from fmfts.collect.table import UNTOUCHED, Row, Table
from fmfts.collect.watch import Watch

DISK_S = 60.0
ARRIVAL_S = 0.03  # what a frame or a reading of this moment takes to get here


@dataclass(frozen=True, slots=True)
class Timing:
    """average_s: of frames and forces behind a row; settle_s: waited before it; delay_s: of the gauge."""

    average_s: float
    settle_s: float
    delay_s: float


@dataclass(frozen=True, slots=True)
class Identity:
    """What every row names. recording: the file that has its frames."""

    baseline: str
    pad: str
    board: str
    recording: str


Told = Callable[[Press, bool], None]  # before (False) and after (True) each press


class Session:
    """Presses what of the plan is not done. Whatever goes wrong, the rod is lifted before the error comes out."""

    def __init__(
        self,
        watch: Watch,
        presser: Presser,
        table: Table,
        frames: Frames,
        unmoved: Unmoved,
        timing: Timing,
        identity: Identity,
    ) -> None:
        self._watch = watch
        self._presser = presser
        self._table = table
        self._frames = frames
        self._unmoved = unmoved
        self._timing = timing
        self._identity = identity
        self._disk = ThreadPoolExecutor(max_workers=1)

    def run(self, plan: Plan, told: Told) -> None:
        """Until all is done. CollectError where it cannot go on: the reason, and how the lifting ended."""
        with self._disk:  # waited for when the rod is up
            self._run(plan, told)

    def _run(self, plan: Plan, told: Told) -> None:
        try:
            self._presser.begin()
            for presses in _places(plan, self._table.done):
                self._work_on(presses, told)
        except CollectError as error:
            raise type(error)(f"{error}; {self._presser.release()}") from error
        except KeyboardInterrupt as interrupt:
            raise StoppedError(f"interrupted; {self._presser.release()}") from interrupt
        except BaseException:
            self._presser.release()
            raise

    def _work_on(self, presses: Sequence[Press], told: Told) -> None:
        told(presses[0], False)
        unloaded = self._untouched(presses[0])
        self._store(Press(UNTOUCHED, *presses[0].place_m, 0.0), unloaded, 0.0)
        for press in presses:
            told(press, False)
            loaded = self._loaded(press, unloaded)
            self._store(press, loaded, self._force_n(press, loaded))
            told(press, True)
        self._presser.lift()

    def _untouched(self, press: Press) -> Averaged:
        """The pad with nothing on it: where its baseline found it, and the gauge's zero."""

        def let_go() -> None:
            self._presser.stand_over(press)

        def judged(begun_ns: int, ended_ns: int) -> Averaged:
            frames, readings = self._watch.window(begun_ns, ended_ns)
            unloaded = average(frames, readings, 0.0)
            self._unmoved.require(unloaded)
            return unloaded

        unloaded = self._attempt("the untouched pad", let_go, judged)
        if unloaded.force_n is not None:
            self._watch.tare_n = unloaded.force_n
        return unloaded

    def _loaded(self, press: Press, unloaded: Averaged) -> Averaged:
        def held() -> None:
            self._presser.press(press)
            self._watch.wait(self._timing.settle_s)

        def judged(begun_ns: int, ended_ns: int) -> Averaged:
            loaded = average(*self._watch.window(begun_ns, ended_ns), self._watch.tare_n)
            require_touched(loaded, unloaded)
            if loaded.force_n is not None and loaded.force_n < 0.5 * press.force_n:
                raise RowError(f"the gauge reads {loaded.force_n:.3f} N where {press.force_n:.3f} N should press")
            return loaded

        return self._attempt(f"press {press.number}", held, judged)

    def _attempt(self, what: str, get_there: Callable[[], None], judged: Callable[[int, int], Averaged]) -> Averaged:
        """Listen for a row's time, and judge; again where it made none, as often as who presses bears it."""
        get_there()
        times = 0
        while True:
            begun_ns = self._watch.clock.now_ns()
            self._watch.wait(self._timing.average_s + self._timing.delay_s + ARRIVAL_S)
            try:
                return judged(begun_ns, begun_ns + round(self._timing.average_s * 1e9))
            except RowError as error:
                times += 1
                self._presser.refused(f"{what}: {error}", times, get_there)

    def _store(self, press: Press, averaged: Averaged, force_n: float) -> None:
        row = row_of(press, averaged, force_n, self._unmoved.mounting, self._identity)

        def keep() -> None:
            self._frames.add(averaged.frames)
            self._table.add(row)

        # A disk may take seconds, and the rod is down: what is heard must be listened to meanwhile.
        stored = self._disk.submit(keep)
        if not self._watch.until(stored.done, DISK_S):
            raise StoppedError(f"the disk of {self._table.path} did not take press {press.number} in {DISK_S:g} s")
        stored.result()

    def _force_n(self, press: Press, loaded: Averaged) -> float:
        typed_n = getattr(self._presser, "typed_n", None)
        force_n = loaded.force_n if typed_n is None else typed_n
        if force_n is None or not np.isfinite(force_n):
            raise StoppedError(f"press {press.number}: nobody told its force")
        return float(force_n)


def row_of(press: Press, averaged: Averaged, force_n: float, mounting: Mounting, identity: Identity) -> Row:
    """The line of the table: the magnet's share of the mean field, and what it belongs to."""
    return Row(
        press=press.number,
        x_mm=press.x_m * 1e3,
        y_mm=press.y_m * 1e3,
        force_n=force_n,
        field_ut=(mounting.magnet_field(averaged.field.mean_t) * 1e6).ravel().tolist(),
        force_sd_n=averaged.force_sd_n,
        frames=len(averaged.frames),
        temperature_c=averaged.field.temperature_c,
        utc=datetime.now(UTC).isoformat(timespec="milliseconds"),
        baseline=identity.baseline,
        pad=identity.pad,
        board=identity.board,
        recording=identity.recording,
        first_frame_ns=averaged.frames[0].host_time_ns,
        last_frame_ns=averaged.frames[-1].host_time_ns,
    )


def _places(plan: Plan, done: set[int]) -> Iterator[list[Press]]:
    """What is left of the plan, place by place."""
    left = (press for press in plan.presses if press.number not in done)
    for _, presses in groupby(left, key=lambda press: press.place_m):
        yield list(presses)
