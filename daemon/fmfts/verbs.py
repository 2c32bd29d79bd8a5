"""What the control socket can be asked to do. Each verb answers with facts or with an error that changes nothing."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor

import msgspec

from fmfts.ambient import BaselineError
from fmfts.baselines import DURATION_S, BaselineJob, BaselineRequest, report, store
from fmfts.bus.control import BadRequestError, Request
from fmfts.bus.messages import StatusMessage
from fmfts.channel import Channel
from fmfts.config import PadConfig
from fmfts.sensor import SourceError

log = logging.getLogger(__name__)


class _Nothing(msgspec.Struct, forbid_unknown_fields=True):
    """A verb without arguments."""


class _OfPad(msgspec.Struct, forbid_unknown_fields=True):
    pad: str | None = None


class _Baseline(_OfPad, forbid_unknown_fields=True):
    bare: bool = False
    replaced: bool = False
    duration_s: float = DURATION_S


class Verbs:
    """Handles requests on the pipeline's thread; what takes long runs as a job and is answered later."""

    def __init__(self, configs: Mapping[str, PadConfig], channels: Sequence[Channel], executor: Executor) -> None:
        self.last_status: dict[str, StatusMessage] = {}
        self._configs = configs
        self._channels = {channel.name: channel for channel in channels}
        self._executor = executor
        self._jobs: list[tuple[Channel, Request]] = []
        self._selftests: list[tuple[Channel, Request]] = []
        self._handlers: dict[str, Callable[[Request], None]] = {
            "status": self._status,
            "pads": self._pads,
            "probe": self._probe,
            "baseline": self._baseline,
            "selftest": self._selftest,
        }

    def handle(self, request: Request) -> None:
        try:
            self._handlers[request.verb](request)
        except (BadRequestError, SourceError, BaselineError) as error:
            request.fail(str(error))

    def finish_jobs(self) -> None:
        """Answer the requests whose work has ended since the last call."""
        for channel, request in list(self._jobs):
            job = channel.job
            if job is not None and not channel.source.state.connected:
                self._end_job(channel, request)
                request.fail(f"pad '{channel.name}': {channel.source.state.reason}: no baseline was recorded")
            elif job is not None and job.result is not None and job.result.done():
                self._end_job(channel, request)
                self._finish_baseline(channel, request, job)
        for channel, request in list(self._selftests):
            result = channel.source.selftest_result(channel.pad_index)
            if result is not None:
                self._selftests.remove((channel, request))
                request.reply(pad=channel.name, **result)
            elif not channel.source.state.connected:
                self._selftests.remove((channel, request))
                request.fail(f"pad '{channel.name}': {channel.source.state.reason}: no self-test")

    def _status(self, request: Request) -> None:
        request.arguments_as(_Nothing)
        request.reply(pads=[msgspec.to_builtins(status) for status in self.last_status.values()])

    def _pads(self, request: Request) -> None:
        request.arguments_as(_Nothing)
        pads = [
            {
                "pad": name,
                "health": channel.health,
                "baseline": channel.pipeline.baseline and channel.pipeline.baseline.id,
                "rate_nominal_hz": float(self._configs[name].source.rate_hz),
                "geometry_hash": channel.pipeline.pad.geometry_hash,
            }
            for name, channel in self._channels.items()
        ]
        request.reply(pads=pads)

    def _probe(self, request: Request) -> None:
        request.arguments_as(_Nothing)
        request.reply(
            pads=[
                {
                    "pad": name,
                    "source": channel.source.state.description,
                    "connected": channel.source.state.connected,
                    "reason": channel.source.state.reason,
                    "board": channel.source.state.board,
                    "faults": channel.faults,
                }
                for name, channel in self._channels.items()
            ]
        )

    def _selftest(self, request: Request) -> None:
        channel = self._named(request.arguments_as(_OfPad).pad)
        channel.source.request_selftest(channel.pad_index)
        self._selftests.append((channel, request))

    def _baseline(self, request: Request) -> None:
        arguments = request.arguments_as(_Baseline)
        channel = self._named(arguments.pad)
        if not 0.5 <= arguments.duration_s <= 60.0:
            raise BadRequestError(f"baseline: duration_s is {arguments.duration_s}, it must be 0.5 to 60")
        if channel.job is not None:
            raise BadRequestError(f"pad '{channel.name}': a baseline is being recorded already")
        if not channel.source.state.connected:
            raise BadRequestError(f"pad '{channel.name}': {channel.source.state.reason}: nothing to record")
        config = self._configs[channel.name]
        work = BaselineRequest(channel.pipeline.pad, config.tolerance.si(), arguments.bare, arguments.replaced)
        channel.job = BaselineJob(
            work,
            channel.pipeline.baseline,
            arguments.duration_s,
            self._executor,
            lambda share: request.progress(share=share),
        )
        self._jobs.append((channel, request))

    def _finish_baseline(self, channel: Channel, request: Request, job: BaselineJob) -> None:
        assert job.result is not None
        try:
            baseline, mounting = job.result.result()
            path = store(baseline)
        except (BaselineError, OSError) as error:
            log.warning("%s", error)
            request.fail(str(error))
            return
        channel.pipeline.use(baseline)
        channel.event("baseline", f"{baseline.kind} {baseline.id}")
        log.info("pad '%s': baseline %s (%s) stored in %s", channel.name, baseline.id, baseline.kind, path)
        request.reply(**report(baseline, mounting, channel.pipeline.pad), stored=str(path))

    def _end_job(self, channel: Channel, request: Request) -> None:
        channel.job = None
        self._jobs.remove((channel, request))

    def _named(self, pad: str | None) -> Channel:
        if pad is None and len(self._channels) == 1:
            return next(iter(self._channels.values()))
        if pad is None or pad not in self._channels:
            known = ", ".join(sorted(self._channels))
            raise BadRequestError(f"no pad '{pad}': say one of {known}" if pad else f"which pad? one of {known}")
        return self._channels[pad]
