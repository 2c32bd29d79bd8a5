"""Finds a field that alternates in the recording of an untouched pad: mains of 50 or 60 Hz, a motor, a power supply.

At each frequency the power of all axes is added: of white noise 2|X|²/(nσ²) with X = Σ x·e^{−2πift} is χ² with two
degrees of freedom for each axis (N. R. Lomb, "Least-squares frequency analysis of unequally spaced data", 1976). Each
chip's samples have their own times, so that chips on their own clocks are added, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.elementary import square
from fmfts.arithmetic.matrix import product
from fmfts.common.chi2 import quantile
from fmfts.sensor import Frame
from fmfts.sensor.frame import fields_of

Array = NDArray[np.float64]

# Probability of finding one in white noise.
FALSE_FINDING = 1e-6
SLOWEST_HZ = 1.0  # slower lines shift the mean, and another check refuses the recording
FEWEST_SAMPLES = 25
# A field of less than this share of a sample's noise changes no deviation.
SMALLEST_SHARE = 0.5
# Ratio of a sample's noise to the chip's own, above which it is reported.
MUCH_NOISE = 2.5
# Mains, and what rectifiers make of it.
MAINS_HZ = (50.0, 60.0, 100.0, 120.0, 150.0, 180.0)


def warnings_of(frames: Sequence[Frame]) -> list[str]:
    """Warnings about a usable recording of an untouched pad: sentences."""
    found = alternation(frames)
    return _noisy(frames) if found is None else [found.sentence]


@dataclass(frozen=True, slots=True)
class Alternation:
    """A field that alternates. frequency_hz: as sampled, below half of rate_hz. amplitude_t (N, 3): of each axis.

    resolution_hz: frequencies nearer than this cannot be told apart.
    """

    frequency_hz: float
    amplitude_t: Array
    rate_hz: float
    resolution_hz: float

    @property
    def size_t(self) -> float:
        """The field's amplitude, the mean over the sensors."""
        return float(np.sqrt(square(self.amplitude_t).sum(axis=1)).mean())

    @property
    def together_t(self) -> Array:
        """(N, 3) the noise to add, as all axes alternate together, where noise is counted as independent.

        A covariance e·eᵀ is at most the diagonal one of |eᵢ|·Σ|eⱼ| (S. A. Gershgorin, 1931).
        """
        rms_t = self.amplitude_t / np.sqrt(2.0)
        together: Array = np.sqrt(rms_t * (rms_t.sum() - rms_t))
        return together

    @property
    def sentence(self) -> str:
        """The likely source, and what to do."""
        near = (hz for hz in MAINS_HZ if abs(self._as_sampled(hz) - self.frequency_hz) < self.resolution_hz)
        mains = next(near, None)
        seen = f"seen at {self.frequency_hz:.1f} Hz by samples at {self.rate_hz:.0f} Hz"
        of = f"{self.frequency_hz:.1f} Hz" if mains is None else f"{mains:g} Hz, as of mains ({seen})"
        return (
            f"a field of {self.size_t * 1e6:.2f} µT alternates at {of}: move motors, mains cables and power supplies "
            "away from the pad, and record again; what stays counts as noise; if it comes and goes later, contacts may "
            "be wrong"
        )

    def _as_sampled(self, frequency_hz: float) -> float:
        return abs(frequency_hz - self.rate_hz * round(frequency_hz / self.rate_hz))


def alternation(frames: Sequence[Frame]) -> Alternation | None:
    """The strongest one in the frames of an untouched pad; None if noise explains all."""
    sampled = _samples(frames)
    if not all(len(times) for times, _ in sampled):
        return None  # a board that does not report when it measures
    seconds = min(float(np.ptp(times)) for times, _ in sampled)
    rate_hz = min(len(times) - 1 for times, _ in sampled) / seconds
    if rate_hz <= 2.0 * SLOWEST_HZ:
        return None
    # Frequencies half a resolution apart: no line falls between two.
    frequencies = np.arange(SLOWEST_HZ, rate_hz / 2.0, 0.5 / seconds)
    power = np.array([_power(times, values, frequencies) for times, values in sampled])
    # Rounding to counts sets the lower limit of the noise: a quiet axis may repeat one value.
    rounding_t = frames[0].chip.coarseness_t(frames[0].gain_code) / np.sqrt(12.0)
    deviation = np.array([np.maximum(values.std(axis=0), rounding_t) for _, values in sampled])
    counts = np.array([len(times) for times, _ in sampled])[:, None]
    chi2 = (2.0 * power / (square(deviation) * counts)[:, None]).sum(axis=(0, 2))
    strongest = int(np.argmax(chi2))
    if chi2[strongest] < quantile(FALSE_FINDING / len(frequencies), 2 * deviation.size):
        return None
    amplitude = 2.0 * np.sqrt(power[:, strongest]) / counts
    found = Alternation(float(frequencies[strongest]), amplitude, float(rate_hz), 1.0 / seconds)
    # For a strong line the difference may be negative, as sine and cosine are not quite independent.
    noise = np.maximum(square(deviation) - 0.5 * square(amplitude), square(rounding_t))
    noise_t = float(np.sqrt(np.median(noise)))
    return found if found.size_t > SMALLEST_SHARE * noise_t else None


def _noisy(frames: Sequence[Frame]) -> list[str]:
    """The sensor whose noise is largest, if it is much more than its chip's."""
    chip = frames[0].chip
    usual_t = max(chip.noise_t, chip.single_noise_t or 0.0, *chip.noises_t)
    fields, used = fields_of(frames), np.array([frame.fresh & frame.valid for frame in frames])
    noise_t = [float(fields[of_sensor, number].std(axis=0).max()) for number, of_sensor in enumerate(used.T)]
    sensor = int(np.argmax(noise_t))
    if noise_t[sensor] < MUCH_NOISE * usual_t:
        return []
    return [
        f"sensor {sensor + 1} has {noise_t[sensor] * 1e6:.2f} µT of noise, where {chip.named} has "
        f"{usual_t * 1e6:.2f} µT: look for a motor near, a loose wire, or a supply that is not clean; contacts get "
        "larger deviations"
    ]


def _samples(frames: Sequence[Frame]) -> list[tuple[Array, Array]]:
    """For each sensor the times (K,) in s and fields (K, 3) of its samples, without mean and slope; none if too few."""
    chosen = np.array([frame.fresh & frame.timed for frame in frames])
    times = np.array([frame.sampled_us for frame in frames], dtype=np.float64) * 1e-6
    fields = fields_of(frames)
    return [
        _without_slope(times[of_sensor, sensor], fields[of_sensor, sensor]) for sensor, of_sensor in enumerate(chosen.T)
    ]


def _without_slope(times: Array, fields: Array) -> tuple[Array, Array]:
    if len(times) < FEWEST_SAMPLES or np.ptp(times) == 0.0:
        return np.empty(0), np.empty((0, 3))
    times, fields = times - times.mean(), fields - fields.mean(axis=0)
    slope = (times[:, None] * fields).sum(axis=0) / square(times).sum()
    return times, fields - times[:, None] * slope


def _power(times: Array, values: Array, frequencies: Array) -> Array:
    """(F, 3) |Σ x·e^{−2πift}|². The frequencies are evenly spaced: each is a coarse one plus a fine one."""
    fine = int(np.ceil(np.sqrt(len(frequencies))))
    by_coarse = _circle(frequencies[::fine, None] * times)
    cosine, sine = ((part.T[:, :, None] * values[:, None]).reshape(len(times), -1) for part in by_coarse)
    fine_cosine, fine_sine = _circle((frequencies[:fine] - frequencies[0])[:, None] * times)
    real = product(fine_cosine, cosine) - product(fine_sine, sine)
    imaginary = product(fine_sine, cosine) + product(fine_cosine, sine)
    power: Array = (square(real) + square(imaginary)).reshape(fine, -1, 3)
    return power.swapaxes(0, 1).reshape(-1, 3)[: len(frequencies)]


def _circle(turns: Array) -> tuple[Array, Array]:
    """Cosine and sine of so many turns, to 1e-12, with the same bits on every processor.

    The Taylor series of a sixteenth of the angle, doubled four times: cos 2x = cos²x − sin²x, sin 2x = 2 sin x cos x.
    """
    angle = (turns - np.round(turns)) * (2.0 * np.pi / 16.0)
    z = square(angle)
    sine = angle * (1.0 - z / 6.0 * (1.0 - z / 20.0 * (1.0 - z / 42.0 * (1.0 - z / 72.0))))
    cosine = 1.0 - z / 2.0 * (1.0 - z / 12.0 * (1.0 - z / 30.0 * (1.0 - z / 56.0 * (1.0 - z / 90.0))))
    for _ in range(4):
        cosine, sine = square(cosine) - square(sine), 2.0 * sine * cosine
    return cosine, sine
