"""One pad in the daemon: runs its pipeline and publishes its contacts, events, status and frames."""

from __future__ import annotations

import logging
import time
from collections.abc import Mapping

from fmfts.baseline import Baseline
from fmfts.baseline.job import BaselineJob
from fmfts.bus.encoding import decode_contact
from fmfts.bus.messages import Health, StatusMessage
from fmfts.bus.publisher import Publisher, contact_topic
from fmfts.pipeline._pad import Pad
from fmfts.pipeline.configured import Pipeline
from fmfts.pipeline.several_pipeline import SeveralPipeline
from fmfts.runtime.announcer import Announcer
from fmfts.runtime.baseline_in_use import UNKNOWN_BOARD, BaselineInUse
from fmfts.runtime.failure import Contained, sentence_of, trace_of
from fmfts.runtime.impossible_frames import ImpossibleFrames
from fmfts.runtime.lateness import Lateness
from fmfts.runtime.recorders import Recorders
from fmfts.runtime.search_turns import SearchTurns
from fmfts.runtime.sparing_log import SparingLog
from fmfts.runtime.statistics import PadStatistics
from fmfts.sensor import ByteSource, Frame, Source
from fmfts.sensor.early import EarlySample
from fmfts.sensor.flaw import flaw_of
from fmfts.sensor.probing import faults_of

log = logging.getLogger(__name__)

SHORTEST_SILENCE_NS = 150_000_000
ANEW_NS = 1_000_000_000  # shortest time between two errors that make a pipeline forget all frames: forgetting is slow


class Channel:
    """Passes one pad's frames through its pipeline, and publishes the results. is_recorded: all frames are wanted."""

    def __init__(
        self, source: Source, pad_index: int, pipeline: Pipeline, publisher: Publisher, boot: str, rate_hz: float
    ) -> None:
        self.name = pipeline.pad.name
        self.source = source
        self.pad_index = pad_index
        self.pipeline = pipeline
        self.job: BaselineJob | None = None
        self.turns = SearchTurns(1)  # shared by all pads with several magnets
        self._boot = boot
        self._rate_hz = rate_hz
        self._lines = source if isinstance(source, ByteSource) else None
        self._statistics = PadStatistics()
        self._lateness = Lateness(source, pad_index, rate_hz, self._statistics)
        self._started_ns = time.monotonic_ns()
        # A pad is silent when no usable frame came for this long; it allows for two missing frames at every rate.
        self._silent_ns = max(SHORTEST_SILENCE_NS, int(3e9 / rate_hz))
        self._last_frame_ns: int | None = None
        self._last_used_ns: int | None = None
        self._anew_ns = 0  # when an error last made the pipeline forget all frames
        self._contained = Contained(self.break_off)
        self._logged: set[str] = set()  # kinds of errors whose traceback is in the log
        self.is_recorded, self.recorders = False, Recorders(pipeline, publisher, boot)
        self.baseline = BaselineInUse(source, pipeline, self.recorders)
        self._log, self._other_log = SparingLog(self.name, self._lateness), SparingLog(self.name, self._lateness)
        self.announcer = Announcer(self.name, source, publisher, boot, self._started_ns, self._log)
        self._impossible = ImpossibleFrames(self._statistics, self._other_log, self.announcer)
        self._lent: Pad | None = None  # set while C handles the frames

    @property
    def wants_all(self) -> bool:
        """Superseded frames are wanted, too: by a recorder, or for a baseline."""
        return self.is_recorded or self.job is not None or self.baseline.is_followed

    @property
    def health(self) -> Health:
        return self.announcer.health

    @property
    def faults(self) -> list[str]:
        """A sentence for each thing that is wrong with the source now."""
        faults = faults_of(self.source, self.pad_index, self.pipeline.missing)
        return [*faults, *self._impossible.recent(time.monotonic_ns())]

    def frame(self, frame: Frame, superseded: bool = False) -> None:
        """Process one frame: publish its contact message, and an event for each change. superseded: only record it.
        An error in this makes the pad "lost" until the next frame, and no more: the other pads go on.
        """
        with self._contained:
            self._take(frame, superseded)

    def _take(self, frame: Frame, superseded: bool) -> None:
        arrived_ns = time.monotonic_ns()
        self._lateness.count_left_out()
        if flaw := flaw_of(frame, len(self.pipeline.pad.sensors), arrived_ns):
            self._impossible.leave_out(flaw, arrived_ns)
            return
        self._last_frame_ns = arrived_ns
        if not self._statistics.frame(frame):
            return
        if self.job is not None:
            with Contained(self.job.break_off):
                self.job.take(frame)
        unusable = self._lateness.is_to_be_left_out(frame.host_time_ns, arrived_ns, superseded)
        if not unusable and not self.baseline.board_is_known():
            self._statistics.dropped += 1
            unusable = True
        if isinstance(self.pipeline, SeveralPipeline) and not unusable:
            frame = self.turns.allowed(self.name, frame)
        self.is_recorded = self.recorders.are_there(arrived_ns)
        if self.is_recorded:
            self.recorders.frame(frame, used=not unusable)
        if unusable:
            return
        answer = self.pipeline.answer(frame)
        if isinstance(self.pipeline, SeveralPipeline):
            self.turns.told(self.name, self.pipeline.search)
        if self._lateness.is_to_be_left_out(frame.host_time_ns, answer.t_publish_ns):  # by now
            return
        self.announcer.send(answer)
        self._statistics.published(answer.t_sample_ns, answer.t_publish_ns)
        self._last_used_ns = arrived_ns
        if news := self.baseline.drift_news(answer):
            self.announcer.event("baseline", news)

    def break_off(self, error: BaseException) -> None:
        """Publish an error in this pad's work as "lost", and forget all frames: one of them may have caused it."""
        now_ns, sentence = time.monotonic_ns(), sentence_of(error)
        if type(error).__name__ not in self._logged:
            self._logged.add(type(error).__name__)
            text = "pad '%s': internal error, worth reporting; its contacts are published as lost\n%s"
            log.error(text, self.name, trace_of(error))
        self._statistics.dropped += 1
        self._last_used_ns = now_ns  # silence is not the fault
        with Contained(lambda again: log.error("pad '%s': internal error\n%s", self.name, trace_of(again))):
            if now_ns - self._anew_ns >= ANEW_NS:
                self._anew_ns = now_ns
                self.pipeline.start_anew()
            self.announcer.send(self.pipeline.absent("lost", f"internal error: {sentence}"))

    def joints(self, position_rad: Mapping[str, float], time_ns: int) -> None:
        """Take positions of a hand's joints, and their time on the host's clock. C may be judging frames meanwhile."""
        if self.pipeline.hand is not None:
            with self._contained:
                self.pipeline.hand.take(position_rad, time_ns)
        if self.job is not None:
            with Contained(self.job.break_off):
                self.job.joints(position_rad, time_ns)

    def source_changed(self, now_ns: int) -> None:
        """Restart: the source was closed after an error, or replaced."""
        with self._contained:
            self._statistics.start_anew()
            self._last_frame_ns = None
            self.pipeline.start_anew()
            self.announcer.send(self.pipeline.absent(*self._absence(now_ns)))

    def early(self, early: EarlySample) -> None:
        """Process a sample that came before its frame: publish the last message with another `now`.

        A sample that changes nothing is not published, because its frame follows soon.
        """
        with self._contained:
            self._take_early(early)

    def _take_early(self, early: EarlySample) -> None:
        now_ns = time.monotonic_ns()
        if self.job is not None or not self.baseline.board_is_known():
            return
        if self._lateness.is_late(self.pipeline.host_time_ns(early.device_time_us), now_ns):
            return
        if self.recorders.are_there(now_ns) and not self.recorders.early(early):
            return
        answer = self.pipeline.early(early)
        if answer is not None:
            self.announcer.send(answer)

    def begin(self, now_ns: int) -> Pad | None:
        """Let C handle the frames from now on; None if Python must see them."""
        self.is_recorded = self.recorders.are_there(now_ns)
        clock = None if self._lines is None else self._lines.clock_line
        if self.wants_all or clock is None:
            return None
        with self._contained:
            if self.baseline.board_is_known():
                topic, overdue_ns = contact_topic(self.name), self._lateness.overdue_ns
                self._lent = self.pipeline.begin(clock, topic, self.pad_index, overdue_ns)
                return self._lent
        return None

    def end(self) -> int | None:
        """If C handles the frames: take them back and account for those that C handled. `frame` gets the next ones.

        Returns the number of the last frame that C handled; None if there is none.
        """
        lent, self._lent = self._lent, None
        number = None
        if lent is not None:
            with self._contained:
                number = self._take_back(lent)
        return number

    def _take_back(self, lent: Pad) -> int | None:
        ended = self.pipeline.end(lent)
        if self._lateness.count_left_out():
            self._last_frame_ns = time.monotonic_ns()
        if ended is not None:
            passed, last = ended
            self.announcer.sent_in_c([decode_contact(change) for change in passed.changes], last)
            self._statistics.passed(passed)
            if passed.frames:
                self._last_frame_ns = self._last_used_ns = passed.arrival_ns
                return passed.sequence
        return None

    def use(self, baseline: Baseline) -> None:
        """Use another baseline and forget the learned drift. BaselineError if it does not fit the pad."""
        self.baseline.use(baseline)

    def is_silent(self, now_ns: int) -> bool:
        last_ns = self._last_used_ns
        if last_ns is not None and self._lent is not None:
            last_ns = max(last_ns, self._lent.last_ns())
        return last_ns is None or now_ns - last_ns >= self._silent_ns

    def tick(self, now_ns: int) -> None:
        """Publish the health of a silent pad. The daemon calls this twenty times a second while a pad is silent."""
        with self._contained:
            if self.is_silent(now_ns):
                self.announcer.send(self.pipeline.absent(*self._absence(now_ns)))

    def _absence(self, now_ns: int) -> tuple[Health, str]:
        """The health of a pad of which no frame is used, and why none is, with the name of its source."""
        health, why = self._silence(now_ns)
        return health, f"{self.source.state.description}: {why}"

    def _silence(self, now_ns: int) -> tuple[Health, str]:
        """The health of a pad of which no frame is used, and why none is."""
        state, last = self.source.state, self._last_frame_ns
        if not state.connected:
            return "disconnected", state.reason
        if self._impossible.last_ns > (last or 0):
            return "stale", f"no frame can be used: {self._impossible.last}"
        if last is None:
            return "stale", "; ".join(self.faults) or "no frame came yet"
        if not self.baseline.board_is_known():
            return "stale", UNKNOWN_BOARD
        if now_ns - last < self._silent_ns:
            return "stale", self._lateness.reason
        return "stale", f"silent for {(now_ns - last) * 1e-9:.1f} s"

    def told(self) -> tuple[Health, str]:
        """Health and reason as they were published last. Where it is not "ok", there is a reason."""
        if (last := self.announcer.last) is None:
            return self._absence(time.monotonic_ns())
        return last.health, last.reason or self._lateness.sentence or self.pipeline.further_drift

    def status(self, now_ns: int) -> StatusMessage:
        """The status message about the interval since the last call."""
        self._lateness.count_left_out()
        latency = self._statistics.interval(now_ns)
        if news := self._lateness.judge(self.health):
            self._other_log.tell(logging.WARNING if self._lateness.sentence else logging.INFO, news, now_ns)
            self.announcer.event("overload", news)
        for each in (self._log, self._other_log):
            each.catch_up(now_ns)
        state, last, mounting = self.source.state, self.announcer.last, self.pipeline.mounting
        health, reason = self.told()
        return StatusMessage(
            pad=self.name,
            boot=self._boot,
            t_publish_ns=now_ns,
            utc_ns=time.time_ns(),
            health=health,
            reason=reason,
            since_ns=self.announcer.health_since_ns,
            source=state.description,
            connected=state.connected,
            rate_hz=self._statistics.rate_hz,
            rate_nominal_hz=self._rate_hz,
            frames=self._statistics.frames,
            dropped=self._statistics.dropped,
            repeated=self._statistics.repeated,
            gaps=self._statistics.gaps,
            crc_errors=state.crc_errors,
            garbage_bytes=state.garbage_bytes,
            reconnects=state.reconnects,
            latency_p50_s=latency and latency[0],
            latency_p99_s=latency and latency[1],
            latency_max_s=latency and latency[2],
            temperature_c=None if last is None else last.temperature_c,
            ambient_t=None if last is None else last.ambient_t,
            gains_from=None if self.pipeline.baseline is None else self.pipeline.baseline.gains_from,
            remanence_t=None if mounting is None else mounting.remanence_t(self.pipeline.pad),
            force_scale=self.pipeline.force_scale,
            force_scale_sd=self.pipeline.force_scale_sd,
            rest_drift_m=self.baseline.drift_m,
            sensor_faults=self.faults,
            board=state.board,
            uptime_s=(now_ns - self._started_ns) * 1e-9,
        )
