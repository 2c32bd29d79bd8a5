"""Works off a plan: at each place it records the untouched pad, then each force, and stores every row at once."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from datetime import datetime, timezone
from itertools import groupby

import numpy as np

from fmfts.baseline import Mounting
from fmfts.baseline.array_mounting import ArrayMounting
from fmfts_collect.average import Averaged, RowError, Unmoved, average, require_touched
from fmfts_collect.errors import CollectError, StoppedError
from fmfts_collect.frames import Frames
from fmfts_collect.plan import Plan, Press
from fmfts_collect.presser import Presser
from fmfts_collect.table import UNTOUCHED, Row, Table
from fmfts_collect.watch import Watch

DISK_S = 60.0
ARRIVAL_S = 0.03  # time in which a frame or a reading arrives


@dataclass(frozen=True, slots=True)
class Timing:
    """average_s: duration of the means of a row. settle_s: wait before them. delay_s: delay of the gauge."""

    average_s: float
    settle_s: float
    delay_s: float


@dataclass(frozen=True, slots=True)
class Identity:
    """Facts that all rows share. recording: the file with their frames."""

    baseline: str
    pad: str
    board: str
    recording: str


OnPress = Callable[[Press, bool], None]  # called before (False) and after (True) each press


class Session:
    """Makes the presses of a plan that are not done yet. On any error it lifts the rod before it raises the error."""

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

    def run(self, plan: Plan, on_press: OnPress) -> None:
        """Make all presses. Raises CollectError, with the reason and the outcome of lifting, where that fails."""
        with self._disk:  # waits for the disk, after the rod is up
            self._run(plan, on_press)

    def _run(self, plan: Plan, on_press: OnPress) -> None:
        try:
            self._presser.begin()
            for presses in _places(plan, self._table.done):
                self._work_on(presses, on_press)
        except CollectError as error:
            raise type(error)(f"{error}; {self._presser.release()}") from error
        except KeyboardInterrupt as interrupt:
            raise StoppedError(f"interrupted; {self._presser.release()}") from interrupt
        except BaseException:
            self._presser.release()
            raise

    def _work_on(self, presses: Sequence[Press], on_press: OnPress) -> None:
        on_press(presses[0], False)
        unloaded = self._untouched(presses[0])
        self._store(Press(UNTOUCHED, *presses[0].place_m, 0.0), unloaded, 0.0)
        for press in presses:
            on_press(press, False)
            loaded = self._loaded(press, unloaded)
            self._store(press, loaded, self._force_n(press, loaded))
            on_press(press, True)
        self._presser.lift()

    def _untouched(self, press: Press) -> Averaged:
        """The means of the untouched pad; checks them against the baseline, and takes the force as the gauge's zero."""

        def let_go() -> None:
            self._presser.stand_over(press)

        def judge(begun_ns: int, ended_ns: int) -> Averaged:
            frames, readings = self._watch.window(begun_ns, ended_ns)
            unloaded = average(frames, readings, 0.0)
            self._unmoved.require(unloaded)
            return unloaded

        unloaded = self._attempt("the untouched pad", let_go, judge)
        if unloaded.force_n is not None:
            self._watch.tare_n = unloaded.force_n
        return unloaded

    def _loaded(self, press: Press, unloaded: Averaged) -> Averaged:
        def press_and_hold() -> None:
            self._presser.press(press)
            self._watch.wait(self._timing.settle_s)

        def judge(begun_ns: int, ended_ns: int) -> Averaged:
            loaded = average(*self._watch.window(begun_ns, ended_ns), self._watch.tare_n)
            require_touched(loaded, unloaded)
            if loaded.force_n is not None and loaded.force_n < 0.5 * press.force_n:
                raise RowError(f"the gauge reads {loaded.force_n:.3f} N where {press.force_n:.3f} N should press")
            return loaded

        return self._attempt(f"press {press.number}", press_and_hold, judge)

    def _attempt(self, what: str, prepare: Callable[[], None], judge: Callable[[int, int], Averaged]) -> Averaged:
        """Records for a row's time, and judges it; repeats a refused row until the presser gives up."""
        prepare()
        times = 0
        while True:
            begun_ns = self._watch.clock.now_ns()
            self._watch.wait(self._timing.average_s + self._timing.delay_s + ARRIVAL_S)
            try:
                return judge(begun_ns, begun_ns + round(self._timing.average_s * 1e9))
            except RowError as error:
                times += 1
                self._presser.refused(f"{what}: {error}", times, prepare)

    def _store(self, press: Press, averaged: Averaged, force_n: float) -> None:
        row = row_of(press, averaged, force_n, self._unmoved.mounting, self._identity)

        def write() -> None:
            self._frames.add(averaged.frames)
            self._table.add(row)

        # A disk may take seconds while the rod is down: the watch must keep running meanwhile.
        stored = self._disk.submit(write)
        if not self._watch.until(stored.done, DISK_S):
            raise StoppedError(f"the disk of {self._table.path} did not take press {press.number} in {DISK_S:g} s")
        stored.result()

    def _force_n(self, press: Press, loaded: Averaged) -> float:
        typed_n = getattr(self._presser, "typed_n", None)
        force_n = loaded.force_n if typed_n is None else typed_n
        if force_n is None or not np.isfinite(force_n):
            raise StoppedError(f"press {press.number}: its force is not known")
        return float(force_n)


def row_of(
    press: Press, averaged: Averaged, force_n: float, mounting: Mounting | ArrayMounting, identity: Identity
) -> Row:
    """The table's row of a press: the magnet's part of the mean field, the force, and where they come from."""
    return Row(
        press=press.number,
        x_mm=press.x_m * 1e3,
        y_mm=press.y_m * 1e3,
        force_n=force_n,
        field_ut=(mounting.magnet_field(averaged.field.mean_t) * 1e6).ravel().tolist(),
        force_sd_n=averaged.force_sd_n,
        frames=len(averaged.frames),
        temperature_c=averaged.field.temperature_c,
        utc=datetime.now(timezone.utc).isoformat(timespec="milliseconds"),
        baseline=identity.baseline,
        pad=identity.pad,
        board=identity.board,
        recording=identity.recording,
        first_frame_ns=averaged.frames[0].host_time_ns,
        last_frame_ns=averaged.frames[-1].host_time_ns,
    )


def _places(plan: Plan, done: set[int]) -> Iterator[list[Press]]:
    """Yields the presses that are not done, place by place."""
    remaining = (press for press in plan.presses if press.number not in done)
    for _, presses in groupby(remaining, key=lambda press: press.place_m):
        yield list(presses)
