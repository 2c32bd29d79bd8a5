"""A Source that simulates a pad: raw counts of chips that run on their own clocks, like a real one's."""

from __future__ import annotations

import time
from collections.abc import Sequence
from math import exp
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fmfts.config import PadConfig, SimulatedSource
from fmfts.pad import Array, Magnet
from fmfts.sensor.chips import TESLA_PER_GAUSS, Axes
from fmfts.sensor.chips.selftest import no_selftest, selftest_facts
from fmfts.sensor.frame import AGE_UNKNOWN_US, Frame
from fmfts.sensor.source import CannotError, SourceError, SourceState
from fmfts_simulation.chip import ChipArray
from fmfts_simulation.finger import Finger, Touch, columns, fingers_of
from fmfts_simulation.finger_shape import SHAPES
from fmfts_simulation.imperfections import Imperfections, PadNow, cast
from fmfts_simulation.mounted import MountedPad, with_chips_turned
from fmfts_simulation.neighbour import NeighbourMagnets, neighbour_of, seeded
from fmfts_simulation.pad_file import mechanics_of

if TYPE_CHECKING:
    from fmfts.sensor.source import Hands

CATCH_UP_FRAMES = 4  # as many as a board's transmit queue holds; after a longer stall the older frames are lost
SECOND_NS = 1_000_000_000
TURNING_AXIS = np.array([0.48, 0.6, 0.64])
TUMBLE_S = 20.0
ROOM_C = 25.0
WARMEST_K = 15.0  # final warming of a board


class Simulated:
    """A Source of one simulated pad; the same seed and start give the same frames.

    `mounted = False` removes the magnet (for a bare baseline). `turning_rad_per_s = 0` lets the robot stand as at the
    start; it turns on from there, as if it had begun at `turning_since_s`. `tumbling` turns it through all directions
    in twenty seconds. `finger` may be replaced at any time; `second_finger` presses besides it where the pad has
    several magnets, None: none does. The time is that given to `poll`, so that a test or a baseline can run faster than
    real time. It starts at the first poll.
    """

    def __init__(
        self,
        config: PadConfig,
        beside: Sequence[PadConfig] = (),
        *,
        noise_t: float | None = None,
        perfect: bool = False,
    ) -> None:
        """beside: pads whose magnets it measures, if they are simulated too. noise_t: of a sample; None: the chip's.
        perfect: without building errors and ambient field. Raises ValueError unless the source is simulated,
        SourceError where its pad model cannot be used."""
        source = config.source
        if not isinstance(source, SimulatedSource):
            raise ValueError(f"pad {config.name!r}: the source is {type(source).__name__}, not a simulated one")
        drawing = config.pad()
        self.state = SourceState(description=f"simulated pad, seed {source.seed}")
        self.finger, self.second_finger = fingers_of(source)
        self.mounted = True
        self.tumbling = False
        self.turning_rad_per_s = float(np.deg2rad(source.turning_deg_per_s))
        self.turning_since_s = 0.0
        random = seeded(source, "pad")
        try:
            self._built = self._build(config, source, random, perfect)
            self.neighbours: list[NeighbourMagnets] = [
                neighbour_of(config, other, other.source)
                for other in beside
                if isinstance(other.source, SimulatedSource)
            ]
        except ValueError as error:
            raise SourceError(str(error)) from error
        self._imperfections: Imperfections | None = None
        if "casting" in source.imperfections:
            self._built = cast(self._built, seeded(source, "casting"))
        if source.imperfections or source.finger_shape != "round":
            self._imperfections = Imperfections(
                source.imperfections,
                SHAPES[source.finger_shape],
                self._built,
                source.rate_hz,
                seeded(source, "imperfections"),
            )
        self._chip = chip = drawing.chip
        noise_t = chip.noise_t if noise_t is None else noise_t
        self._chips = ChipArray(
            len(drawing.sensors), source.rate_hz, source.trigger, chip, noise_t, seeded(source, "chips")
        )
        strap_deviation = 0.0 if chip.bias_strap is None else chip.bias_strap.deviation
        self._straps = seeded(source, "straps").normal(0.0, strap_deviation, self._built.gain.shape)
        self._gain_code = chip.gain_code_for_range(source.range_gauss)
        self._rate_hz = source.rate_hz
        self._warming_k_per_s = source.warming_k_per_minute / 60.0
        self._magnet_per_k = config.magnet.temperature_coefficient_per_k
        self._pressed: tuple[tuple[MountedPad, list[Touch], float] | None, Array] = None, np.empty(0)
        self._start_ns: int | None = None
        self._sequence = 0
        self._delivered = np.full(len(drawing.sensors), np.iinfo(np.int64).min)
        self._counts = np.zeros((len(drawing.sensors), 3), dtype=np.int16)
        self._selftest: dict[str, object] | None = None

    def _build(
        self, config: PadConfig, source: SimulatedSource, random: np.random.Generator, perfect: bool
    ) -> MountedPad:
        """ValueError where the pad model cannot be used."""
        drawing, mechanics = config.pad(), mechanics_of(config, source)
        if perfect:
            return MountedPad.exact(drawing, mechanics)
        tolerance = config.tolerance.si()
        errors = with_chips_turned(tolerance.sensor_rotation_rad, tolerance.cross_axis)
        return MountedPad.built(drawing, random, mechanics, errors)

    @property
    def built(self) -> MountedPad:
        """The pad as it was built, with its errors, for tests; a daemon must not use it."""
        return self._built

    @property
    def fingers(self) -> list[Finger]:
        """Those that press."""
        return [self.finger] if self.second_finger is None else [self.finger, self.second_finger]

    @property
    def time_s(self) -> float:
        """The time of the next frame, as `finger` counts it."""
        return self._sequence / self._rate_hz

    def hands(self, *, bare: bool, turn: bool, refine: bool, weight_n: float = 0.0) -> Hands:
        from fmfts_simulation.hands import Hands as HandsOn  # which imports this module

        return HandsOn(self, bare=bare, turn=turn, refine=refine, weight_n=weight_n)

    def fileno(self) -> None:
        return None

    def deadline_ns(self) -> int:
        return 0 if self._start_ns is None else self._due_ns(self._sequence)

    def poll(self, now_ns: int) -> Sequence[Frame]:
        """The frames that are due; after a stall only the newest few, with a gap in the sequence for the others."""
        if self._start_ns is None:
            self._start_ns = now_ns
            self.state.connect(now_ns)
        frames: list[Frame] = []
        due = (now_ns - self._start_ns) * self._rate_hz // SECOND_NS
        self._sequence = max(self._sequence, due + 1 - CATCH_UP_FRAMES)
        while self._due_ns(self._sequence) <= now_ns:
            frames.append(self._frame())
            self._sequence += 1
        return frames

    def truth(self, host_time_ns: int) -> tuple[float, float, float]:
        """The finger's x and y (m) and its force (N) at a time of this source's clock."""
        return self.finger(self._seconds(host_time_ns))[:3]

    def request_selftest(self, pad_index: int) -> None:
        """Simulate strap currents of both signs, and subtract the unbiased field (data sheet, self-test operation)."""
        if self._chip.bias_strap is None:
            raise CannotError(no_selftest(self._chip))
        strap, saturated_count = self._chip.bias_strap, self._chip.saturated_count
        now_s = self._sequence / self._rate_hz
        warming_k = self._warming_k(now_s)
        strap_t = np.array(strap.field_gauss) * (1.0 + self._straps) * TESLA_PER_GAUSS * self._built.gain
        resting_t = self._field(np.full(len(strap_t), now_s), warming_k)

        def counts(bias_t: Array | float) -> NDArray[np.int16]:
            return self._chips.counts(resting_t + bias_t, strap.gain_code, warming_k)

        unbiased = counts(0.0)
        positive, negative = (_less(counts(bias_t), unbiased, saturated_count) for bias_t in (strap_t, -strap_t))
        self._selftest = selftest_facts(self._chip, strap.gain_code, positive, negative)

    def selftest_result(self, pad_index: int) -> dict[str, object] | None:
        return self._selftest

    def close(self) -> None:
        self.state.disconnect("closed", time.monotonic_ns())

    def _frame(self) -> Frame:
        assert self._start_ns is not None
        now_s = self._sequence / self._rate_hz
        warming_k = self._warming_k(now_s)
        conversion = self._chips.newest_conversion(now_s)
        sampled_s = self._chips.time_of(conversion)
        fresh = conversion != self._delivered
        counts = self._chips.counts(self._field(sampled_s, warming_k), self._gain_code, warming_k)
        if self._imperfections is not None:
            counts = self._imperfections.transferred(counts)
        self._counts = np.where(fresh[:, None], counts, self._counts)
        self._delivered = conversion
        newest_s = float(sampled_s.max())
        age_us = np.minimum(np.rint((newest_s - sampled_s) * 1e6), AGE_UNKNOWN_US).astype(np.uint16)
        return Frame(
            pad_index=0,
            sequence=self._sequence,
            device_time_us=max(round(newest_s * 1e6), 0),
            host_time_ns=self._start_ns + round(newest_s * 1e9),
            gain_code=self._gain_code,
            counts=self._counts,
            age_us=age_us,
            fresh=fresh,
            valid=np.ones(len(fresh), dtype=bool),
            temperature_c=self._told_c(warming_k),
            chip=self._chip,
        )

    def _field(self, sampled_s: Array, warming_k: float) -> Array:
        """(N, 3) field of each sensor at its own time, in its own axes and times its gain."""
        ambient = self._ambient(sampled_s)
        for other in self.neighbours:
            ambient = ambient + other.field(self._built.pad.sensors.position_m, sampled_s, warming_k)
        if self._imperfections is not None:
            field_t: Array = self.imperfect_field(ambient[None], sampled_s[None], warming_k)[0]
            return field_t
        if not self.mounted:
            return self._built.sensed(ambient)
        return self._built.sensed(ambient + self._magnet_field(sampled_s, warming_k))

    def imperfect_field(self, ambient_t: Array, sampled_s: Array, warming_k: float) -> Array:
        """(K, N, 3) as `_field`, of K frames in the order of time. ambient_t (K, N, 3), sampled_s (K, N)."""
        assert self._imperfections is not None
        touches = [self.finger(moment) for moment in sampled_s.ravel().tolist()] if self.mounted else []
        now = PadNow(self._built, self._warm_magnet(warming_k), warming_k)
        return self._imperfections.field(now, touches, ambient_t, sampled_s)

    def _warm_magnet(self, warming_k: float) -> Magnet:
        magnet = self._built.pad.magnet
        return magnet.with_remanence(magnet.remanence_t * (1.0 + self._magnet_per_k * warming_k))

    def _magnet_field(self, sampled_s: Array, warming_k: float) -> Array:
        """(N, 3) field of the magnet; computed again only when the finger, the pad or the temperature changes."""
        touches = [self.finger(moment) for moment in sampled_s.tolist()]
        pressed, field_t = self._pressed
        if pressed is None or pressed[0] is not self._built or pressed[1:] != (touches, warming_k):
            field_t = self._built.magnet_field(*columns(touches), magnet=self._warm_magnet(warming_k))
            self._pressed = (self._built, touches, warming_k), field_t
        return field_t

    def _ambient(self, sampled_s: Array) -> Array:
        """(N, 3) the Earth's field in pad axes, while the robot turns about an axis along no symmetry of the pad."""
        if self.tumbling:
            return tumbled(self._built.ambient_t, sampled_s)
        if self.turning_rad_per_s == 0.0:
            return self._built.ambient_t[None].repeat(len(sampled_s), axis=0)
        return turned(self._built.ambient_t, self.turning_rad_per_s * (sampled_s - self.turning_since_s))

    def _warming_k(self, now_s: float) -> float:
        return WARMEST_K * (1.0 - exp(-self._warming_k_per_s * now_s / WARMEST_K))

    def _told_c(self, warming_k: float) -> float | None:
        """The thermometer's reading, in its own steps; None if there is none."""
        thermometer = self._chip.thermometer
        if thermometer is None:
            return None
        return ROOM_C + round(warming_k / thermometer.c_per_count) * thermometer.c_per_count

    def _seconds(self, host_time_ns: int) -> float:
        return (host_time_ns - (self._start_ns or 0)) * 1e-9

    def _due_ns(self, sequence: int) -> int:
        # Rounded up, so that the frame is due for a caller who wakes at the deadline.
        return (self._start_ns or 0) - (-sequence * SECOND_NS // self._rate_hz)


def turned(ambient_t: Array, angles_rad: Array) -> Array:
    """(N, 3) a field, turned about TURNING_AXIS by each angle (N,); all at once, as each frame of a simulation asks."""
    along = TURNING_AXIS * (TURNING_AXIS @ ambient_t)
    (a, b, c), (x, y, z) = TURNING_AXIS.tolist(), ambient_t.tolist()  # np.cross takes 25 µs
    across, beside = ambient_t - along, np.array([b * z - c * y, c * x - a * z, a * y - b * x])
    field_t: Array = along + np.cos(angles_rad)[:, None] * across + np.sin(angles_rad)[:, None] * beside
    return field_t


def tumbled(ambient_t: Array, moments_s: Array) -> Array:
    """(N, 3) a field, turned once about each axis in turn, so that it spans space whatever its start."""
    shares = np.clip(3.0 * (moments_s[:, None] % TUMBLE_S) / TUMBLE_S - np.arange(3.0), 0.0, 1.0)
    turned = np.tile(ambient_t, (len(moments_s), 1))
    for axis in range(3):
        one, other = (axis + 1) % 3, (axis + 2) % 3
        cosine, sine = np.cos(2.0 * np.pi * shares[:, axis]), np.sin(2.0 * np.pi * shares[:, axis])
        turned[:, one], turned[:, other] = (
            cosine * turned[:, one] - sine * turned[:, other],
            sine * turned[:, one] + cosine * turned[:, other],
        )
    return turned


def _less(counts: NDArray[np.int16], unbiased: NDArray[np.int16], saturated_count: int) -> list[Axes]:
    """Counts minus the unbiased ones; a saturated axis stays marked as saturated."""
    saturated = (counts == saturated_count) | (unbiased == saturated_count)
    return [(x, y, z) for x, y, z in np.where(saturated, saturated_count, counts - unbiased).tolist()]
