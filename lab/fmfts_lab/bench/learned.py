"""Pads with unmeasured sensors after `baseline --learn`, beside pads whose geometry is known."""

from __future__ import annotations

import time
from argparse import Namespace
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np

from fmfts.baseline import BaselineError
from fmfts.baseline.learner import LEARN_PRESSES
from fmfts.baseline.mounting import Mounting
from fmfts.baseline.request import LEARN_S, BaselineRequest
from fmfts.config import ContactConfig, GeometryConfig, PadConfig, SceneConfig, SimulatedSource, ToleranceConfig
from fmfts.contact import ContactModel
from fmfts.pad import rotation_from_vector
from fmfts.pipeline.configured import load_contact_model
from fmfts.pipeline.encoded import message_of
from fmfts_calibrate.learn.make import FromPresses
from fmfts_lab.bench.as_built import Cell, Made
from fmfts_lab.bench.built_world import BuiltSource, Defects, Presses
from fmfts_lab.bench.tapped import without_baseline
from fmfts_lab.bench.truth import Truth
from fmfts_simulation.finger import no_finger

PLACES_MM, ROTATIONS_DEG = 2.0, 10.0  # each within ± this of the drawing, anywhere
# Remaining errors of a known geometry: as_built's chips, turned by half a degree.
KNOWN = Defects(rotation_deg=0.5, gain=0.05, turning=False)
KINDS = ("known", "known + refine", "sketch", "sketch + learn")
EVEN = 3.0**0.5  # a number anywhere within ±1 has the standard deviation 1/√3


@dataclass(frozen=True, slots=True)
class Rough:
    """One pad: the true board, and the configurations with measured and with unmeasured geometry."""

    source: BuiltSource
    known: PadConfig
    sketch: PadConfig

    @classmethod
    def of(cls, seed: int, remanence: float) -> Rough:
        """remanence: its tolerance, of both configurations. The magnets differ by 5 % (built_world.py)."""
        random = np.random.default_rng([seed, 44])
        standard = _config(
            GeometryConfig(), ToleranceConfig(sensor_rotation_deg=KNOWN.rotation_deg, remanence=remanence)
        )
        drawn = standard.pad().sensors
        places_mm = drawn.position_m * 1e3 + random.uniform(-PLACES_MM, PLACES_MM, drawn.position_m.shape)
        vectors_deg = random.uniform(-ROTATIONS_DEG, ROTATIONS_DEG, drawn.position_m.shape)
        known = _config(
            GeometryConfig(sensors_mm=_vectors(places_mm), sensor_rotations_deg=_vectors(vectors_deg)),
            standard.tolerance,
        )
        turned = np.array([rotation_from_vector(one) for one in np.deg2rad(vectors_deg)])
        if not np.allclose(known.pad().sensors.axes, drawn.axes @ turned):
            raise AssertionError("the configuration's rotations are others")
        sketch = _config(
            GeometryConfig(),
            ToleranceConfig(
                sensor_position_mm=PLACES_MM / EVEN, sensor_rotation_deg=ROTATIONS_DEG / EVEN, remanence=remanence
            ),
        )
        return cls(BuiltSource(known, KNOWN, random), known, sketch)


def _config(geometry: GeometryConfig, tolerance: ToleranceConfig) -> PadConfig:
    return PadConfig(
        name="built",
        source=SimulatedSource(finger="none", turning_deg_per_s=0.0),
        geometry=geometry,
        tolerance=tolerance,
        scene=SceneConfig(ambient="constant"),
        contact=ContactConfig(friction=0.0),  # the fingers of this world do not shear
    )


def _vectors(rows: np.ndarray) -> tuple[tuple[float, float, float], ...]:
    return tuple((float(x), float(y), float(z)) for x, y, z in rows)


def baselines_of(rough: Rough, random: np.random.Generator) -> dict[str, Made | str]:
    """Each kind of baseline, or why it was refused, of frames as a daemon records them."""

    def made(
        config: PadConfig, earlier: Made | str | None, *, bare: bool = False, refine: bool = False, learn: bool = False
    ) -> Made | str:
        if isinstance(earlier, str):
            return earlier
        before = None if earlier is None else earlier[0]
        request = BaselineRequest(
            config.pad(),
            config.tolerance.si(),
            bare,
            False,
            refine=refine,
            duration_s=LEARN_S if refine else None,
            learn=FromPresses() if learn else None,
        )
        source = rough.source
        source.mounted, source.attitude = not bare, "still"
        source.finger = Presses(random, LEARN_S / LEARN_PRESSES / 2.0) if refine or learn else no_finger
        try:
            baseline, mounting = request.make(source.recorded(request.seconds), before)
            return baseline, mounting if isinstance(mounting, Mounting) else None
        except BaselineError as error:
            return str(error)

    known = made(rough.known, made(rough.known, None, bare=True))
    sketch = made(rough.sketch, made(rough.sketch, None, bare=True))
    return {
        "known": known,
        "known + refine": made(rough.known, known, refine=True),
        "sketch": sketch,
        "sketch + learn": made(rough.sketch, sketch, learn=True),
    }


def trial(rough: Rough, seed: int, seconds: float, cells: dict[str, Cell], model: ContactModel) -> None:
    random = np.random.default_rng(seed)
    for kind, made in baselines_of(rough, random).items():
        cell = cells[kind]
        cell.pads += 1
        if isinstance(made, str):
            cell.refused[made.split("refused: ", 1)[-1]] += 1
            continue
        pipeline = without_baseline(rough.known if kind.startswith("known") else rough.sketch, model)
        pipeline.use(*made)
        source, finger = rough.source, Presses(np.random.default_rng(seed))
        source.mounted, source.finger, source.attitude = True, finger, "still"
        messages = [message_of(pipeline.answer(frame)) for frame in source.recorded(seconds)]
        cell.saw(messages, Truth(source.built, finger), finger)


def run(options: Namespace) -> None:
    found: list[dict[str, object]] = []
    model = load_contact_model(_config(GeometryConfig(), ToleranceConfig()))
    cells = {kind: Cell() for kind in KINDS}
    begun_s = time.monotonic()
    for seed in range(options.seed, options.seed + options.pads):
        trial(Rough.of(seed, options.remanence), seed, options.seconds, cells, model)
    for kind, cell in cells.items():
        print(f"{kind:15} {cell.line}", flush=True)
        found.append({"kind": kind, "seed": options.seed} | cell.facts)
    known, learned = cells["known"], cells["sketch + learn"]
    if known.off_m and learned.off_m:
        place, force = (
            np.mean(b) / np.mean(a) for a, b in ((known.off_m, learned.off_m), (known.off_n, learned.off_n))
        )
        print(f"learned over known: place {place:.2f}, force {force:.2f} ({time.monotonic() - begun_s:.0f} s)")
    if options.out:
        Path(options.out).write_bytes(msgspec.json.format(msgspec.json.encode(found)) + b"\n")
