"""Verbs that want a device for a moment: through the running daemon, or, when none runs, on the device itself."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from fmfts import ambient
from fmfts.ambient import BaselineError
from fmfts.baselines import BaselineRequest, path_of, report, store
from fmfts.bus.lock import serving_pid
from fmfts.config import Config, PadConfig
from fmfts.sensor import Frame, Source, SourceError
from fmfts.sensor.factory import open_sources
from fmfts.sensor.simulated import Simulated
from fmfts_client.control import RefusedError as RefusedByDaemon
from fmfts_client.control import UnreachableError, request
from fmfts_client.endpoints import for_client

# A board says hello within a second of being opened, a reader process starts in half of one.
PATIENCE_S = 3.0
SELFTEST_S = 5.0


class AbsentError(Exception):
    """Neither a daemon nor the device answers."""


class RefusedError(Exception):
    """It was tried, and the answer is no."""


def ask_daemon(verb: str, **arguments: Any) -> dict[str, Any] | None:
    """The running daemon's answer, None where none runs. Shows progress on a terminal."""
    from fmfts.view.progress import progress_bar

    endpoints = for_client()
    if serving_pid(endpoints.control) is None:
        return None
    try:
        with progress_bar(verb) as told:
            return request(verb, endpoint=endpoints, progress=lambda facts: told(facts.get("share", 0.0)), **arguments)
    except RefusedByDaemon as error:
        raise RefusedError(str(error)) from error
    except UnreachableError as error:
        raise AbsentError(str(error)) from error


def record_baseline(pad: PadConfig, *, bare: bool, replaced: bool, duration_s: float) -> dict[str, Any]:
    """Record on the device itself, judge, store."""
    work = BaselineRequest(pad.pad(), pad.tolerance.si(), bare, replaced)
    try:
        before = ambient.load(path_of(pad.name), work.pad)
    except BaselineError:
        # A damaged file is about to be replaced; a bare recording inside it cannot be trusted.
        before = None
    with _opened(pad) as (source, pad_index):
        if isinstance(source, Simulated):
            source.mounted = not bare
        frames = _collect(pad, source, pad_index, duration_s)
    try:
        baseline, mounting = work.make(frames, before)
    except BaselineError as error:
        raise RefusedError(str(error)) from error
    return report(baseline, mounting, work.pad) | {"stored": str(store(baseline))}


def run_selftest(pad: PadConfig) -> dict[str, Any]:
    """The self-test on the device itself."""
    with _opened(pad) as (source, pad_index):
        _collect(pad, source, pad_index, 0.0)
        try:
            source.request_selftest(pad_index)
        except SourceError as error:
            raise RefusedError(str(error)) from error
        until = time.monotonic() + SELFTEST_S
        while (result := source.selftest_result(pad_index)) is None:
            if time.monotonic() > until or not source.state.connected:
                raise AbsentError(f"pad '{pad.name}': no self-test within {SELFTEST_S:g} s: {source.state.reason}")
            _turn(source)
    return {"pad": pad.name, **result}


def probe(config: Config) -> dict[str, Any]:
    """What every device of the configuration says of itself."""
    try:
        sources = open_sources(config.pad)
    except SourceError as error:
        raise AbsentError(str(error)) from error
    seen: set[str] = set()
    until = time.monotonic() + PATIENCE_S
    try:
        while time.monotonic() < until and len(seen) < len(config.pad):
            for source, names in sources:
                seen |= {
                    names[frame.pad_index] for frame in source.poll(time.monotonic_ns()) if frame.pad_index in names
                }
            time.sleep(0.002)
        return {
            "pads": [
                _found(source, index, name, name in seen) for source, names in sources for index, name in names.items()
            ]
        }
    finally:
        for source, _ in sources:
            source.close()


def _found(source: Source, pad_index: int, name: str, streaming: bool) -> dict[str, Any]:
    state = source.state
    faults = [text for (pad, _), text in sorted(state.sensor_faults.items()) if pad == pad_index]
    return {
        "pad": name,
        "source": state.description,
        "connected": state.connected and streaming,
        "reason": state.reason or ("" if streaming else f"connected, but no frame within {PATIENCE_S:g} s"),
        "board": state.board,
        "faults": faults + sorted(state.warnings.values()),
    }


@contextmanager
def _opened(pad: PadConfig) -> Iterator[tuple[Source, int]]:
    try:
        ((source, names),) = open_sources([pad])
    except SourceError as error:
        raise AbsentError(str(error)) from error
    try:
        yield source, next(iter(names))
    finally:
        source.close()


def _collect(pad: PadConfig, source: Source, pad_index: int, duration_s: float) -> list[Frame]:
    """The frames of `duration_s`, counted from the first; AbsentError where none comes or they stop."""
    frames: list[Frame] = []
    heard = time.monotonic()
    while not frames or (frames[-1].device_time_us - frames[0].device_time_us) * 1e-6 < duration_s:
        new = [frame for frame in _turn(source) if frame.pad_index == pad_index]
        frames += new
        heard = time.monotonic() if new else heard
        if time.monotonic() - heard > PATIENCE_S:
            reason = source.state.reason or "connected, but it sends no frames"
            raise AbsentError(f"pad '{pad.name}': {source.state.description}: {reason}")
    return frames


def _turn(source: Source) -> list[Frame]:
    time.sleep(0.002)
    return list(source.poll(time.monotonic_ns()))
