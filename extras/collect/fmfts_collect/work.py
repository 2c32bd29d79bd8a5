"""`fmfts-daemon collect`: opens the pad, the gauge and the machine, works off a plan, and closes them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from fmfts.baseline import Baseline, BaselineError
from fmfts.baseline.files import StateError, stored
from fmfts.baseline.origin import Origin
from fmfts.cli.feed import open_feed
from fmfts.config import PadConfig
from fmfts.pad import Pad
from fmfts.sources import origin_of
from fmfts_collect.average import Unmoved
from fmfts_collect.clock import Clock
from fmfts_collect.errors import RefusedError
from fmfts_collect.frames import Frames
from fmfts_collect.gauge import Gauge, open_gauge
from fmfts_collect.hand import Hand
from fmfts_collect.picture import Picture, shown
from fmfts_collect.plan import Plan, PlanError, Press, read_plan
from fmfts_collect.presser import Presser
from fmfts_collect.session import Identity, Session, Timing
from fmfts_collect.settings import CollectConfig, CollectingConfig
from fmfts_collect.stage import Stage, require_within_reach
from fmfts_collect.table import FORMAT, Header, Table
from fmfts_collect.watch import Limits, Watch

FRAMES_A_ROW = 64  # `average` refuses fewer
# These pads were not turned: a row has the measured force, and a baseline that fits poorly is recorded again.
FORCE_TOLERANCE = 0.05  # largest error of a reached force, relative to the plan's
MOVED_LIMIT_M = 5e-5  # limit for the unloaded magnet, counted from its place in the baseline
AMBIENT_LIMIT_T = 2e-6  # limit for the unloaded pad's field, counted from the baseline's


def collect(
    config: CollectingConfig, pad: PadConfig, plan_name: str, output: Path, by_hand: bool, clock: Clock | None = None
) -> dict[str, Any]:
    """Make the presses of the plan that are not in `output` yet; returns facts of the table. Raises CollectError.

    clock: None for the computer's.
    """
    try:
        plan = read_plan(plan_name)
    except PlanError as error:
        raise RefusedError(str(error)) from error
    settings, drawing = config.collect, pad.pad()
    stage = None if by_hand else settings.stage
    if stage is None and not by_hand:
        raise RefusedError("there is no [collect.stage] in the configuration: describe the machine, or use --by-hand")
    if stage is not None:
        require_within_reach(stage, plan.presses)
    unmoved = unmoved_since_baseline(drawing)
    header = Header(FORMAT, plan.name, plan.fingerprint, pad.name, drawing.geometry_hash)
    with (
        Table(output, len(drawing.sensors), header) as table,
        _opened(config, pad, by_hand, clock) as (watch, board_uid),
    ):
        picture = Picture(plan, table.done, force_n=watch.newest_force_n)
        frames = Frames(output, pad, recorded_rest(drawing), watch.clock)
        with frames, shown(picture) as draw, _pressing(settings, watch, picture, draw, by_hand) as presser:
            watch.begin()
            uid = board_uid()
            require_own_baseline(pad, drawing, uid)
            identity = Identity(unmoved.baseline_id, pad.name, uid, frames.path.name)
            session = Session(watch, presser, table, frames, unmoved, _timing(settings, pad), identity)
            session.run(plan, _drawing(picture, draw))
        return _facts(plan, table)


def require_own_baseline(pad: PadConfig, drawing: Pad, board_uid: str) -> None:
    """Raise RefusedError if the pad's baseline was recorded with other sensors than those that answer now."""
    origin = origin_of(pad)
    recorded_rest(drawing, origin and origin.on({"uid": board_uid} if board_uid else {}))


def recorded_rest(drawing: Pad, origin: Origin | None = None) -> Baseline:
    """The pad's baseline. Raises RefusedError where it has no recording of the pad at rest, or is not of `origin`."""
    try:
        baseline = stored(drawing, origin)
    except (BaselineError, StateError) as error:
        raise RefusedError(str(error)) from error
    if baseline is None or baseline.rest is None:
        raise RefusedError(
            f"pad '{drawing.name}': its rest is not recorded: fmfts-daemon baseline --rest, while nothing touches it"
        )
    return baseline


def unmoved_since_baseline(drawing: Pad) -> Unmoved:
    """The limits of the pad's deviation from its baseline. Raises RefusedError like recorded_rest."""
    baseline = recorded_rest(drawing)
    return Unmoved(
        drawing,
        baseline.array_mounting(drawing) if drawing.other_magnets else baseline.mounting(drawing),
        baseline.id,
        MOVED_LIMIT_M,
        AMBIENT_LIMIT_T,
    )


@contextmanager
def _opened(
    config: CollectingConfig, pad: PadConfig, by_hand: bool, clock: Clock | None
) -> Iterator[tuple[Watch, Any]]:
    """Opens the pad and the gauge; yields their Watch and the board's id function. A hand has no force limit."""
    settings = config.collect
    feed = open_feed(config, pad)
    gauge: Gauge | None = None
    try:
        gauge = None if settings.gauge is None else open_gauge(settings.gauge, feed.counts)
        limit_n = None if by_hand or settings.stage is None else settings.stage.force_limit_n
        yield Watch(feed, gauge, Limits(limit_n, settings.silence_ms * 1e-3), clock), feed.board_uid
    finally:
        feed.close()
        if gauge is not None:
            gauge.close()


@contextmanager
def _pressing(settings: CollectConfig, watch: Watch, picture: Picture, draw: Any, by_hand: bool) -> Iterator[Presser]:
    def say(text: str) -> None:
        picture.said = text
        draw()

    presser: Presser
    if by_hand:
        presser = Hand(watch, FORCE_TOLERANCE, say, gauge=settings.gauge is not None)
    else:
        assert settings.stage is not None
        presser = Stage(settings.stage, watch, FORCE_TOLERANCE)
    try:
        yield presser
    finally:
        presser.close()


def _timing(settings: CollectConfig, pad: PadConfig) -> Timing:
    delay_s = 0.0 if settings.gauge is None else settings.gauge.delay_ms * 1e-3
    return Timing(averaging_s(settings, pad), settings.settle_s, delay_s)


def averaging_s(settings: CollectConfig, pad: PadConfig) -> float:
    """Duration of the means of a row: at least FRAMES_A_ROW frames."""
    return max(settings.average_s, FRAMES_A_ROW / pad.source.rate_hz)


def _drawing(picture: Picture, draw: Any) -> Any:
    def on_press(press: Press, done: bool) -> None:
        picture.now = press
        draw()

    return on_press


def _facts(plan: Plan, table: Table) -> dict[str, Any]:
    return {
        "plan": plan.name,
        "presses": len(plan.presses),
        "collected": len(table.done),
        "table": str(table.path),
        "recordings": [str(path) for path in sorted(table.path.parent.glob(f"{table.path.stem}.*.mcap"))],
    }
