"""The running daemon: one loop that waits for bytes, requests and deadlines."""

from __future__ import annotations

import gc
import logging
import secrets
import signal
import socket
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import cycle
from pathlib import Path
from types import FrameType

from fmfts.bus.control import ControlServer
from fmfts.bus.door import Door
from fmfts.bus.gate import Gate
from fmfts.bus.joints import JointListener
from fmfts.bus.keys import KeyFolder
from fmfts.bus.publisher import Publisher
from fmfts.config import Config, ReplaySource
from fmfts.runtime.channel import Channel
from fmfts.runtime.failure import Contained
from fmfts.runtime.fast_loop import FastLoop
from fmfts.runtime.guarded import GuardedSource
from fmfts.runtime.opening import (
    channel_of,
    introduce_neighbours,
    load_models,
    open_guarded,
    tell_models,
    use_baseline,
)
from fmfts.runtime.peers import Peers, Servers
from fmfts.runtime.requests import Verbs
from fmfts.runtime.schedule import Schedule
from fmfts.runtime.search_turns import turns_of
from fmfts.runtime.summary import one_line
from fmfts.sensor import Frame, Source
from fmfts.sensor.early import EarlySample
from fmfts.sensor.patience import IN_TIME
from fmfts.service import open_files
from fmfts.service.notify import Notifier
from fmfts.service.realtime import (
    ask_for_short_slices,
    default_priority,
    lock_memory,
    take_default_priority,
    take_priority,
)
from fmfts.sources import devices
from fmfts_client.endpoints import for_daemon

log = logging.getLogger(__name__)

TICK_NS = 50_000_000  # interval at which a silent pad's health is published
SILENT_AT_ONCE = 4  # number of silent pads that are published in one turn; frames of the others wait meanwhile
QUIET_TICK_NS = 200_000_000  # interval while all is well: to wake an idle computer costs more than the work of the tick
SECOND_NS = 1_000_000_000


class Daemon:
    """All pads of one configuration. Use as a context manager; `run` returns when asked to stop."""

    def __init__(self, config: Config) -> None:
        """Opens models, baselines and endpoints, and raises their errors. Devices may be plugged in later."""
        self._boot = secrets.token_hex(4)
        endpoints = for_daemon(config.bus.endpoint)
        models = load_models(config)
        tell_models(config, models)
        keys = KeyFolder(Path(config.bus.keys)) if config.bus.keys is not None else None
        if keys is not None:
            keys.check()
        key = None if keys is None else keys.server()
        self._gate = None if keys is None else Gate(keys)
        of_samples = sum(pad.source.publish == "sample" for pad in config.pad)
        self._publisher = Publisher(endpoints, self._boot, key, [pad.name for pad in config.pad], of_samples)
        self._control = ControlServer(endpoints.control, keys)
        on_hands = any(pad.scene.ambient == "posture" for pad in config.pad)
        self._joints = JointListener(endpoints.joints, keys) if on_hands else None
        self._executor = ThreadPoolExecutor(max_workers=1, thread_name_prefix="baseline")
        self._channels: dict[tuple[int, int], Channel] = {}
        self._sources: list[GuardedSource] = []
        self._fast_loop = FastLoop(self._publisher)
        self._pads = config.pad
        self._service = config.service
        self._configs = by_name = {pad.name: pad for pad in config.pad}
        rates_hz = {pad.name: float(pad.source.rate_hz) for pad in config.pad}
        for source, names in open_guarded(devices(config.pad), rates_hz):
            self._sources.append(source)
            for pad_index, name in names.items():
                self._channels[id(source), pad_index] = channel_of(
                    by_name[name], source, pad_index, models[name], self._publisher, self._boot, config.pad
                )
            self._fast_loop.add(source, [self._channels[id(source), pad_index] for pad_index in names])
        priority = config.service.realtime_priority
        self._door = Door(
            [*self._publisher.sockets, *self._control.sockets, *(self._joints.sockets if self._joints else ())],
            open_files.raise_limit(),
            default_priority() if priority is None else priority,
        )
        turns = turns_of(channel.pipeline for channel in self._channels.values())
        for channel in self._channels.values():
            channel.turns = turns
        introduce_neighbours(config.pad, {channel.name: channel.pipeline for channel in self._channels.values()})
        self._schedule = Schedule(self._sources, self._fast_loop)
        self._verbs = Verbs(by_name, list(self._channels.values()), self._executor, self._fast_loop.end)
        self._peers = Peers(
            self._schedule,
            self._fast_loop,
            Servers(self._publisher, self._control, self._gate, self._joints, self._hear_joints),
            self._verbs.handle,
        )
        self._notifier = Notifier()
        self._stopping = False
        self._tick_ns = self._look_ns = self._status_ns = self._silence_ns = time.monotonic_ns()
        self._next_status = cycle(self._channels.values())
        self._silence_order = list(self._channels.values())  # the next pad to report
        self._wake_read, self._wake_write = socket.socketpair()
        log.info("publishing on %s, control on %s", endpoints.bus, endpoints.control)
        if self._joints is not None:
            log.info("joint positions are received on %s", endpoints.joints)

    def __enter__(self) -> Daemon:
        return self

    def __exit__(self, *_: object) -> None:
        self._fast_loop.close()
        for source in self._sources:
            source.close()
        self._executor.shutdown(wait=False, cancel_futures=True)
        self._door.close()
        self._peers.close()
        self._control.close()
        if self._joints is not None:
            self._joints.close()
        self._publisher.close()
        if self._gate is not None:
            self._gate.close()
        self._notifier.close()
        self._wake_read.close()
        self._wake_write.close()

    def run(self) -> None:
        """Runs until SIGTERM or SIGINT. RealtimeError if the config asks for a priority that is refused."""
        self._wake_write.setblocking(False)
        signal.set_wakeup_fd(self._wake_write.fileno())
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, self._stop)
        self._schedule.wake_for(self._wake_read.fileno())
        if self._service.lock_memory:
            lock_memory()
        ask_for_short_slices()
        if self._service.realtime_priority is None:
            take_default_priority()
        elif self._service.realtime_priority:
            take_priority(self._service.realtime_priority)
        # The objects that exist now stay: later garbage collections need not look through them.
        gc.collect()
        gc.freeze()
        self._notifier.ready()
        for channel in self._channels.values():
            self._report(channel, time.monotonic_ns())
        # After a second there is a rate. Then the pads report by turns, so that frames do not wait for all of them.
        self._status_ns = time.monotonic_ns() + SECOND_NS
        while not self._stopping:
            self._turn()
        self._notifier.stopping()

    def _turn(self) -> None:
        """Wait until something needs Python, and handle it."""
        source = self._schedule.wait(min(self._tick_ns, self._status_ns, self._silence_ns, self._peers.due_ns))
        if source is not None:
            now_ns = time.monotonic_ns()
            with self._fast_loop.ended(source, now_ns) as is_to_be_read:
                if is_to_be_read or ((due_ns := source.deadline_ns()) is not None and due_ns <= now_ns):
                    self._serve(source, now_ns)
        now_ns = time.monotonic_ns()
        looks = now_ns >= self._look_ns
        self._verbs.forget_kept()
        self._peers.serve(called=self._schedule.called or looks)
        if looks:
            self._look_ns = now_ns + QUIET_TICK_NS
            self._notifier.watchdog()
        if now_ns >= self._tick_ns:
            self._schedule.review()
            if self._verbs.is_busy:
                self._verbs.finish_jobs()
            self._tick_ns = now_ns + (TICK_NS if self._verbs.is_busy else QUIET_TICK_NS)
        if now_ns >= self._silence_ns:
            self._silence_ns = now_ns + self._tell_silence(now_ns)
        if now_ns >= self._status_ns:
            self._status_ns = now_ns + SECOND_NS // len(self._channels)
            self._report(next(self._next_status), now_ns)

    def _serve(self, source: Source, now_ns: int) -> None:
        assert isinstance(source, GuardedSource)
        frames = source.poll(now_ns)
        if source.changed:
            self._begin_anew(source, now_ns)
        early = source.take_early()
        newest_us = {frame.pad_index: frame.device_time_us for frame in frames}
        for frame in frames:
            channel = self._channels.get((id(source), frame.pad_index))
            if channel is not None:
                age_us = newest_us[frame.pad_index] - frame.device_time_us
                channel.frame(frame, superseded=channel.wants_all and age_us > IN_TIME.longest_us)
        if early:
            self._pass_early(source, frames, early)
        with source.contained("its descriptor"):
            self._schedule.served(source, had_frames=bool(frames))

    def _hear_joints(self, position_rad: Mapping[str, float], time_ns: int) -> None:
        for channel in self._channels.values():
            channel.joints(position_rad, time_ns)

    def _begin_anew(self, source: GuardedSource, now_ns: int) -> None:
        """Restart a source's pads: it failed, or was replaced, perhaps with a new recording."""
        for channel in self._channels.values():
            if channel.source is source:
                channel.source_changed(now_ns)
                if isinstance(self._configs[channel.name].source, ReplaySource) and source.device is not None:
                    use_baseline(channel, self._configs[channel.name], self._pads)

    def _pass_early(self, source: Source, frames: Sequence[Frame], early: Sequence[tuple[int, EarlySample]]) -> None:
        """Only samples whose frame did not come with them: the frame holds them, and a slow Python would be late."""
        last = {frame.pad_index: number for number, frame in enumerate(frames)}
        for before, sample in early:
            channel = self._channels.get((id(source), sample.pad_index))
            if channel is not None and before > last.get(sample.pad_index, -1):
                channel.early(sample)

    def _tell_silence(self, now_ns: int) -> int:
        """Publish the health of the next few silent pads. Returns after how many ns to go on: each has its turn every
        TICK_NS."""
        silent = [channel for channel in self._silence_order if channel.is_silent(now_ns)]
        for channel in silent[:SILENT_AT_ONCE]:
            self._silence_order.remove(channel)
            self._silence_order.append(channel)
            with self._fast_loop.ended(channel.source, now_ns):
                # The frames that C handled are counted now, so the pad may not be silent.
                if channel.is_silent(now_ns):
                    # Its frames may be unread, because a busy computer may stop this loop for a while.
                    self._serve(channel.source, now_ns)
                    channel.tick(now_ns)
        if not silent:
            return QUIET_TICK_NS
        return TICK_NS * min(len(silent), SILENT_AT_ONCE) // len(silent)

    def _report(self, channel: Channel, now_ns: int) -> None:
        """Publish a pad's status. With that of the first pad, systemd gets a line about all."""
        with self._fast_loop.ended(channel.source, now_ns), Contained(channel.break_off):
            status = channel.status(now_ns)
            self._publisher.send_status(channel.name, status)
            self._verbs.last_status[channel.name] = status
        if channel.name == self._pads[0].name:
            self._notifier.status(one_line(list(self._verbs.last_status.values()), now_ns))

    def _stop(self, number: int, frame: FrameType | None) -> None:
        log.info("stopping: %s", signal.Signals(number).name)
        self._stopping = True
