"""Carries out verbs that need a device for a moment: through the running daemon, or, if none runs, on the device."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any

from fmfts.baseline import BaselineError
from fmfts.baseline.files import StateError, stored
from fmfts.baseline.job import BaselineJob, Collection, GainTest
from fmfts.baseline.learner import Learner
from fmfts.baseline.request import BaselineRequest, restore
from fmfts.bus.lock import BusError, serving_pid
from fmfts.cli import elsewhere
from fmfts.config import Config, I2cSource, PadConfig
from fmfts.pipeline.configured import posture_learner
from fmfts.pipeline.last_pad import ConfiguredPad
from fmfts.sensor import Frame, Source, SourceError
from fmfts.sensor.missing import missing_sensors
from fmfts.sensor.probing import is_sound, once_connected, probe_facts
from fmfts.sensor.source import HandledSource
from fmfts.sensor.tasks import PATIENCE_S, Deadline, Task
from fmfts.sources import open_sources, origin_of, require_device
from fmfts.view.progress import Show, progress_bar
from fmfts_client import BadKeyError, ControlError, EndpointError, RefusedError, request
from fmfts_client.endpoints import for_client, named_base

TURN_S = 0.002


class AbsentError(Exception):
    """Neither a daemon nor the device answers."""


# Errors of the functions here; common/exit_codes.py has their exit codes.
ERRORS = AbsentError, BaselineError, BusError, ControlError, EndpointError, SourceError, StateError


def ask_daemon(verb: str, base: str | None, pad: str | None = None, **arguments: Any) -> dict[str, Any] | None:
    """The answer of the daemon that serves on the endpoint `base`; None where none does. Shows progress on a terminal.

    base: as `[bus] endpoint`; None: the default. pad: None: the only one. Ctrl-C also ends a recording in the daemon.
    Raises ERRORS.
    """
    named: dict[str, Any] = {} if pad is None else {"pad": pad}
    with _plainly(verb):
        endpoints = for_client(named_base(base))
        if serving_pid(endpoints.control) is None:
            return None
        try:
            with progress_bar(verb) as show:
                return request(
                    verb,
                    endpoint=endpoints,
                    progress=lambda facts: show(facts.get("share", 0.0), facts.get("hint", "")),
                    **named,
                    **arguments,
                )
        except KeyboardInterrupt:
            if verb in ("baseline", "weigh") and not {"restore", "undo_drift"} & arguments.keys():
                request("baseline", endpoint=endpoints, stop=True, **named)
                print("stopped: nothing was recorded", file=sys.stderr)
            raise


@contextmanager
def _plainly(verb: str) -> Iterator[None]:
    """Errors of a request, without the verb's name before them."""
    try:
        yield
    except RefusedError as error:
        raise RefusedError(str(error).removeprefix(f"{verb}: "), error.code) from error
    except BadKeyError:
        raise
    except (ControlError, EndpointError, BusError) as error:
        raise AbsentError(str(error).removeprefix(f"{verb}: ")) from error


def record_baseline(
    pad: PadConfig,
    pads: Sequence[PadConfig],
    *,
    bare: bool,
    replaced: bool,
    turn: bool,
    refine: bool,
    duration_s: float | None,
    learn: Learner | None = None,
    posture: bool = False,
    no_joints: bool = False,
) -> dict[str, Any]:
    """Record a baseline on the device itself, judge and store it; returns its facts. pads: all pads of the file."""
    if posture:
        learn = posture_learner(pad, no_joints)
        if not no_joints:
            raise AbsentError(
                f"pad '{pad.name}': joint positions come to a running daemon: start `fmfts-daemon run`, then ask again"
            )
    with ThreadPoolExecutor(max_workers=1) as executor:
        require_device(pad)
        work = BaselineRequest(
            pad.pad(),
            pad.tolerance.si(),
            bare,
            replaced,
            duration_s,
            turn,
            refine,
            origin_of(pad),
            learn=learn,
            last=ConfiguredPad(pad),
        )
        try:
            before = stored(work.pad, work.origin)
        except BaselineError:
            if work.only_adds:
                raise
            # The file is damaged, or another board's, and will be replaced; its bare recording cannot be trusted.
            before = None
        with _opened(pad, pads) as (source, pad_index), progress_bar("baseline") as show:
            if isinstance(source, HandledSource):
                weight_n = 0.0 if learn is None else learn.weight_n
                presses = refine or (learn is not None and learn.presses > 0)
                source.hands(bare=bare, turn=turn, refine=presses, weight_n=weight_n)
            job = BaselineJob(work, before, source, executor, pad_index=pad_index)
            return _finished(pad.name, job, _turns(source, pad_index, job.take), show)


def learn_baseline(pad: PadConfig, pads: Sequence[PadConfig], base: str | None, **options: Any) -> dict[str, Any]:
    """The same for presses that determine a geometry. AbsentError if a daemon serves: such work would take its time for
    frames."""
    learner: Learner = elsewhere.option("baseline --learn")()
    endpoints = for_client(named_base(base))
    if serving_pid(endpoints.control) is not None:
        raise AbsentError("a daemon runs, and --learn computes for a minute: stop it, learn, and start it again")
    return record_baseline(pad, pads, bare=False, turn=False, refine=False, learn=learner, **options)


def restore_baseline(pad: PadConfig) -> dict[str, Any]:
    """Replace the baseline by the one before it; returns its facts."""
    drawing = pad.pad()
    require_device(pad)
    return restore(drawing, origin_of(pad)).facts(drawing)


def nothing_to_undo(pad: PadConfig, pads: Sequence[PadConfig], *, undo_drift: bool) -> dict[str, Any]:
    """Raise AbsentError: only a running daemon follows a drift, and it forgets it when it ends."""
    raise AbsentError(f"pad '{pad.name}': no daemon runs, so no drift is followed and there is nothing to undo")


def run_selftest(pad: PadConfig, pads: Sequence[PadConfig]) -> dict[str, Any]:
    """Run the self-test on the device itself, and store its gains; returns its facts."""
    with (
        ThreadPoolExecutor(max_workers=1) as executor,
        _opened(pad, pads) as (source, pad_index),
        progress_bar("selftest") as show,
    ):
        first_frame = Collection(source, duration_s=0.0, pad_index=pad_index)
        for _ in _turns(source, pad_index, first_frame.take):
            if first_frame.complete:
                break
            _require_no_problem(pad.name, first_frame.problem(time.monotonic()))
        task = GainTest(pad.pad(), source, pad_index, executor, origin_of(pad))
        return _finished(pad.name, task, _turns(source, pad_index, lambda frame: None), show)


def probe_running(base: str | None) -> dict[str, Any] | None:
    """Facts about every device, as the daemon on the endpoint `base` sees them; None where none runs.

    On a busy computer a board may be silent for a moment: it gets as much time as in `probe`.
    """
    return once_connected(lambda: ask_daemon("probe", base))


def probe(config: Config) -> dict[str, Any]:
    """Facts about every device of the configuration, as each reports them."""
    sources = open_sources(config.pad)
    missing: dict[str, dict[int, str]] = {}  # by pad, of its last frame
    whole: set[str] = set()  # pads whose last frame had all sensors, without a reported fault
    deadline = Deadline(*(source for source, _ in sources))
    try:
        while not deadline.passed(time.monotonic()) and len(whole) < len(config.pad):
            for source, names in sources:
                for frame in source.poll(time.monotonic_ns()):
                    if frame.pad_index in names:
                        found = missing[names[frame.pad_index]] = missing_sensors(frame)
                        # A board that was just given other settings has silent sensors for a moment.
                        (whole.add if is_sound(source, frame.pad_index, found) else whole.discard)(
                            names[frame.pad_index]
                        )
            time.sleep(TURN_S)
        silence = f"connected, but no frame within {PATIENCE_S:g} s"
        pads = [
            probe_facts(name, source, index, "" if name in missing else silence, missing.get(name, {}))
            for source, names in sources
            for index, name in names.items()
        ]
    finally:
        for source, _ in sources:
            source.close()
    reasons = {facts["pad"]: facts.get("reason", "") for facts in pads if not facts["sound"]}
    on_buses = _on_the_buses([pad for pad in config.pad if pad.name in reasons], reasons)
    return {"pads": [facts | on_buses.get(facts["pad"], {}) for facts in pads]}


def _on_the_buses(unsound: Sequence[PadConfig], reasons: Mapping[str, str]) -> dict[str, dict[str, Any]]:
    """The chips on the I2C buses of faulty pads, or why a bus cannot be read unless that is the pad's reason already.

    Their devices must be closed.
    """
    from fmfts.sensor.i2c.scan import scanned

    facts = {}
    for pad in unsound:
        if isinstance(pad.source, I2cSource):
            try:
                found = [str(each) for each in scanned(pad.source.bus)]
            except SourceError as error:
                found = [str(error)]
            if found != [reasons[pad.name]]:
                facts[pad.name] = {"found_on_bus": found or ["no chip that this daemon knows"]}
    return facts


def _finished(pad: str, task: Task, turns: Iterator[None], show: Show) -> dict[str, Any]:
    """Runs `turns` until the task has its facts; returns them."""
    for _ in turns:
        facts = task.facts()
        if facts is not None:
            return facts
        _require_no_problem(pad, task.problem(time.monotonic()))
        show(task.share, task.hint)
    raise AssertionError("turns never end")


def _require_no_problem(pad: str, problem: str) -> None:
    if problem:
        raise AbsentError(f"pad '{pad}': {problem}")


def _turns(source: Source, pad_index: int, take: Callable[[Frame], None]) -> Iterator[None]:
    """Passes the pad's frames to `take`, without end."""
    while True:
        time.sleep(TURN_S)
        for frame in source.poll(time.monotonic_ns()):
            if frame.pad_index == pad_index:
                take(frame)
        yield


@contextmanager
def _opened(pad: PadConfig, pads: Sequence[PadConfig]) -> Iterator[tuple[Source, int]]:
    ((source, names),) = open_sources([pad], pads)
    try:
        yield source, next(iter(names))
    finally:
        source.close()
