"""Handles the requests on the control socket. Each verb answers with facts, or with an error and no change."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor

import msgspec

from fmfts.baseline import Baseline, BaselineError
from fmfts.baseline.files import StateError
from fmfts.baseline.job import BaselineJob, GainTest, Restoration
from fmfts.baseline.origin import Origin
from fmfts.baseline.request import BaselineRequest, Recorded
from fmfts.bus.control import AbsentError, BadRequestError, NoSuchPadError, Request
from fmfts.common.names import no_such_pad
from fmfts.config import PadConfig
from fmfts.pipeline.configured import posture_learner
from fmfts.pipeline.last_pad import ConfiguredPad
from fmfts.pipeline.press_of_one_newton import gained, press_of_one_newton
from fmfts.pipeline.weighing import Weighing
from fmfts.runtime.channel import Channel
from fmfts.runtime.guarded import device_of
from fmfts.runtime.overview import Overview
from fmfts.runtime.pending import Pending, fail_internally
from fmfts.sensor import Source, SourceError
from fmfts.sensor.source import UNSETTLED_FRAMES, HandledSource, Hands
from fmfts.sensor.tasks import Task
from fmfts.sources import require_device

log = logging.getLogger(__name__)


class _Nothing(msgspec.Struct, forbid_unknown_fields=True):
    """A verb without arguments."""


class _OfPad(msgspec.Struct, forbid_unknown_fields=True):
    pad: str | None = None


class _Baseline(_OfPad, forbid_unknown_fields=True):
    rest: bool = False  # the kind without any of these
    bare: bool = False
    replaced: bool = False
    restore: bool = False
    turn: bool = False
    refine: bool = False
    posture: bool = False
    no_joints: bool = False  # for a posture: no joints are published
    undo_drift: bool = False
    stop: bool = False  # ends a recording without a result
    duration_s: float | None = None


class _Weigh(_OfPad, kw_only=True, forbid_unknown_fields=True):
    weight_n: float
    width_m: float | None = None
    anew: bool = False


class Verbs:
    """Handles requests on the pipeline's thread. Long work is a task, and its request is answered when it ends."""

    def __init__(
        self,
        configs: Mapping[str, PadConfig],
        channels: Sequence[Channel],
        executor: Executor,
        take_back: Callable[[Source], object] = lambda source: None,
    ) -> None:
        """take_back: lets Python use a source that C may be reading. Requests that only read do not need it."""
        self._configs = configs
        self._channels = {channel.name: channel for channel in channels}
        self._overview = Overview(configs, self._channels)
        self.last_status = self._overview.last_status
        self._executor = executor
        self._take_back = take_back
        self._pending: list[Pending] = []
        self._hands: dict[str, Hands] = {}  # by pad: of simulated pads whose baseline is being recorded
        self._handlers: dict[str, Callable[[Request], None]] = {
            **dict.fromkeys(self._overview.verbs, self._about_all_pads),
            "baseline": self._baseline,
            "selftest": self._selftest,
            "weigh": self._weigh,
        }

    def handle(self, request: Request) -> None:
        if request.verb not in self._overview.verbs:
            self._overview.forget()
        try:
            self._handlers[request.verb](request)
        except (BadRequestError, SourceError, BaselineError, StateError) as error:
            request.refuse(error)
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # also SystemExit: no request ends the daemon
            log.exception("%s: internal error, worth reporting", request.verb)
            fail_internally(request, error)

    def forget_kept(self) -> None:
        """See Overview.forget. Call it in each turn of the loop."""
        self._overview.forget()

    @property
    def is_busy(self) -> bool:
        """Some request is not answered yet."""
        return bool(self._pending)

    def finish_jobs(self) -> None:
        """Answer the requests whose task has ended since the last call. Call it a few times a second."""
        for pending in self._pending:
            self._take_back(self._channels[pending.pad].source)
        now_s = time.monotonic()
        self._pending = [pending for pending in self._pending if not pending.settle(now_s)]
        under_way = {id(pending.task) for pending in self._pending}
        for channel in self._channels.values():
            if id(channel.job) not in under_way:
                channel.job = None
                if channel.name in self._hands:
                    self._hands.pop(channel.name).let_go()

    def _about_all_pads(self, request: Request) -> None:
        request.arguments_as(_Nothing)
        request.reply(pads=self._overview.of_all_pads(request.verb))

    def _selftest(self, request: Request) -> None:
        channel = self._named(request.arguments_as(_OfPad).pad)
        self._require_idle(channel, GainTest, "a self-test is running")
        self._take_back(channel.source)
        task = GainTest(
            channel.pipeline.pad, channel.source, channel.pad_index, self._executor, channel.baseline.origin
        )
        self._pending.append(Pending(request, channel.name, task))

    def _baseline(self, request: Request) -> None:
        arguments = request.arguments_as(_Baseline)
        others = (arguments.bare, arguments.turn, arguments.refine, arguments.restore, arguments.undo_drift)
        if (arguments.rest and any((*others, arguments.posture))) or (arguments.posture and any(others)):
            raise BadRequestError("one of rest, bare, turn, refine, posture, restore and undo_drift at a time")
        channel = self._named(arguments.pad)
        if arguments.stop:
            facts = _stopped(channel)
            self.finish_jobs()  # so that the next recording may begin at once
            request.reply(**facts)
            return
        self._require_no_recording(channel)
        self._take_back(channel.source)
        pad = channel.pipeline.pad
        if arguments.undo_drift:
            request.reply(**_without_drift(channel))
            return
        require_device(self._configs[channel.name])
        if arguments.restore:
            restoration = Restoration(pad, self._executor, _origin(channel))
            self._await_baseline(request, channel, restoration)
            return
        tolerance = self._configs[channel.name].tolerance.si()
        work = BaselineRequest(
            pad,
            tolerance,
            arguments.bare,
            arguments.replaced,
            arguments.duration_s,
            arguments.turn,
            arguments.refine,
            _origin(channel),
            learn=posture_learner(self._configs[channel.name], arguments.no_joints) if arguments.posture else None,
            last=ConfiguredPad(self._configs[channel.name]),
        )
        self._record(request, channel, work)

    def _weigh(self, request: Request) -> None:
        arguments = request.arguments_as(_Weigh)
        channel = self._named(arguments.pad)
        self._require_no_recording(channel)
        self._take_back(channel.source)
        config = self._configs[channel.name]
        require_device(config)
        weighing = Weighing(config, arguments.weight_n, arguments.width_m, arguments.anew)
        pad, tolerance = channel.pipeline.pad, config.tolerance.si()
        work = BaselineRequest(pad, tolerance, False, False, origin=_origin(channel), learn=weighing)
        self._record(request, channel, work)

    def _record(self, request: Request, channel: Channel, work: BaselineRequest) -> None:
        if not channel.source.state.connected:
            state = channel.source.state
            raise AbsentError(f"pad '{channel.name}': no baseline was recorded: {state.description}: {state.reason}")
        device = device_of(channel.source)
        unsettled = UNSETTLED_FRAMES if isinstance(device, HandledSource) else 0
        channel.job = BaselineJob(
            work, _recorded(channel), channel.source, self._executor, unsettled, channel.pad_index
        )
        if isinstance(device, HandledSource):
            weight_n = 0.0 if work.learn is None else work.learn.weight_n
            self._hands[channel.name] = device.hands(
                bare=work.bare, turn=work.turn, refine=work.refine, weight_n=weight_n
            )
        self._await_baseline(request, channel, channel.job)

    def _await_baseline(self, request: Request, channel: Channel, task: BaselineJob | Restoration) -> None:
        def adopt() -> dict[str, float]:
            assert task.recorded is not None
            was = press_of_one_newton(channel.pipeline) if task.recorded.gained else {}
            _use(channel, task.recorded)
            return gained(was, press_of_one_newton(channel.pipeline))

        self._pending.append(Pending(request, channel.name, task, adopt))

    def _require_no_recording(self, channel: Channel) -> None:
        if channel.job is not None:
            raise BadRequestError(f"pad '{channel.name}': a baseline is being recorded already")
        self._require_idle(channel, Restoration, "a baseline is being restored")

    def _require_idle(self, channel: Channel, kind: type[Task], doing: str) -> None:
        """A pad has at most one task of a kind."""
        if any(pending.pad == channel.name and isinstance(pending.task, kind) for pending in self._pending):
            raise BadRequestError(f"pad '{channel.name}': {doing} already: ask again when it has ended")

    def _named(self, pad: str | None) -> Channel:
        if pad is None and len(self._channels) == 1:
            return next(iter(self._channels.values()))
        if pad is None or pad not in self._channels:
            raise NoSuchPadError(no_such_pad(pad, sorted(self._channels), "the running daemon"))
        return self._channels[pad]


def _origin(channel: Channel) -> Origin | None:
    """The present sensors, as far as they are known."""
    return None if channel.baseline.origin is None else channel.baseline.origin.on(channel.source.state.board)


def _recorded(channel: Channel) -> Baseline | None:
    baseline = channel.pipeline.baseline
    return None if baseline is None else baseline.as_recorded()


def _stopped(channel: Channel) -> dict[str, object]:
    if channel.job is None or not channel.job.stop():
        raise BadRequestError(
            f"pad '{channel.name}': no baseline is being recorded; if one was stored just now, "
            f"`fmfts-daemon baseline --restore --pad {channel.name}` brings the one before it back"
        )
    return {"pad": channel.name, "stopped": True}


def _without_drift(channel: Channel) -> dict[str, object]:
    recorded = _recorded(channel)
    if recorded is None:
        raise BadRequestError(f"pad '{channel.name}': it has no baseline, so none has drifted")
    channel.use(recorded)
    channel.announcer.event("baseline", f"{recorded.kind} {recorded.id}, its drift undone")
    return {"pad": channel.name, "baseline": recorded.id, "kind": recorded.kind}


def _use(channel: Channel, recorded: Recorded) -> None:
    baseline = recorded.baseline
    channel.use(baseline)
    channel.announcer.event("baseline", f"{baseline.kind} {baseline.id}")
    log.info("pad '%s': baseline %s (%s) stored in %s", channel.name, baseline.id, baseline.kind, recorded.path)
