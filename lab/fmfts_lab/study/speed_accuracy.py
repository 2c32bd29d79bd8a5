"""`study speed-accuracy`: time and error of each pose method and each contact method, on the same frames."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache, partial
from typing import NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from fmfts.config import SceneConfig
from fmfts.contact import ContactModel
from fmfts.pad import Array
from fmfts.pose import STOP_CHI2, Batch, State, parts_of
from fmfts.pose.problem import magnet_rows, measurement_rows
from fmfts.pose.state import turn_between
from fmfts_lab.bench.workspace import MODELS
from fmfts_lab.study import controller, controller_chart, pareto, speed_chart
from fmfts_lab.study.batches import batch_rows
from fmfts_lab.study.contact_bench import LIGHTEST_N, Bench
from fmfts_lab.study.contact_methods import DAEMON, ContactMethod, contact_methods
from fmfts_lab.study.harness import Facts, Request, Row, Study
from fmfts_lab.study.pose_methods import DEFAULT, PoseMethod, pose_methods
from fmfts_lab.study.rates import rate_rows
from fmfts_lab.study.timing import timed
from fmfts_lab.study.world import Path, Sample, World, built_world, drawn_world, frame_times, in_scene, pressed, presses

COLUMNS = (
    *("chart", "scene", "method", "family", "settings", "median_us", "p99_us", "answered", "frames"),
    *("error_over_bound", "position_um", "mae_mm", "mae_n", "batch", "rate_hz", "averaging"),
    *controller.COLUMNS,
)
TURNING_DEG_PER_S = 60.0
SCENES = {"drifting": (TURNING_DEG_PER_S, 8), "constant": (0.0, 6)}
SECONDS, QUICK_SECONDS = 4.0, 1.0
# Methods that take long to train or to run.
NOT_QUICK = (
    *("spline inversion", "network from field (20)", "network from field (16, 16)", "network from field (16, 16) f64"),
    *("BP 20 of pose", "BP 20 of pose, float64", "BP 20 of field"),
    *("BP 12 × 12 of pose", "BP 12 × 12 of pose, float64", "BP 12 × 12 of field"),
    *("network of field", "network of field, line", "today's, smoothed"),
)


class Recorded(NamedTuple):
    world: World
    path: Path
    samples: list[Sample]


def run(request: Request) -> Facts:
    study = Study("speed-accuracy", request, COLUMNS)
    with threadpool_limits(1):
        rows = study.measure(_points(request))
    facts = conclusions(rows)
    for suffix, figure in speed_chart.figures(rows):
        study.draw(figure, suffix)
    table = controller_chart.table(facts["controller"])
    (request.out / f"{study.name}-{controller.CHART}.md").write_text(table)
    return study.conclude(facts)


def printed(facts: Facts) -> str:
    lines = []
    for chart in facts["charts"]:
        verdict = "on" if chart["default_on_front"] else "NOT on"
        lines.append(
            f"{chart['chart']}, {chart['scene']}, {chart['error']}: the daemon's default is {verdict} the front"
        )
        lines += [
            f"    {row['median_us']:9.1f} µs  {row[chart['error']]:8.4f}  {row['method']}" for row in chart["front"]
        ]
    return "\n".join([*lines, "", controller_chart.table(facts["controller"])])


def conclusions(rows: Sequence[Row]) -> Facts:
    """The fronts, and whether the daemon's default is on them; and what a controller acts on."""
    charts = []
    for chart, default, errors in (("pose", DEFAULT, ("error_over_bound",)), ("contact", DAEMON, ("mae_mm", "mae_n"))):
        for scene in dict.fromkeys(row["scene"] for row in rows if row["chart"] == chart):
            shown = [row for row in rows if row["chart"] == chart and row["scene"] == scene]
            for error in errors:
                best = pareto.front([row for row in shown if row[error] is not None], "median_us", error)
                charts.append({
                    "chart": chart,
                    "scene": scene,
                    "error": error,
                    "default_on_front": any(row["method"] == default for row in best),
                    "front": [{name: row[name] for name in ("method", "median_us", "p99_us", error)} for row in best],
                })  # fmt: skip
    return {"charts": charts, "controller": controller_chart.facts(rows)}


def _points(request: Request) -> dict[str, Callable[[], list[Row]]]:
    model = f"contact model {ContactModel.load(request.pad.contact.model, request.pad.pad()).hash}"
    skipped = NOT_QUICK if request.quick else ()
    of_controller: dict[str, Callable[[], list[Row]]] = {
        f"{model}, controller, pad {pad}": partial(controller.controller_rows, request, pad, skipped)
        for pad in controller.points(request)
    }
    if request.controller:
        return of_controller
    points: dict[str, Callable[[], list[Row]]] = {}
    for scene in SCENES:
        for method in pose_methods():
            if not (request.quick and method.name in NOT_QUICK):
                points[f"pose, {scene}, {method.name}"] = partial(_pose_point, request, scene, method)
    for built in (False, True):
        for way in contact_methods():
            if not (request.quick and way.name in NOT_QUICK):
                points[f"{model}, {_pad_name(built)}, {way.name}"] = partial(_contact_point, request, built, way)
    points["batches"] = partial(batch_rows, request)
    points["rates"] = partial(rate_rows, request)
    return points | of_controller


def _pad_name(built: bool) -> str:
    return "as built" if built else "as drawn"


@lru_cache(maxsize=8)
def _recorded(request: Request, scene: str, built: bool = False) -> Recorded:
    turning, _ = SCENES[scene]
    config = in_scene(request.pad, SceneConfig(ambient=scene))  # type: ignore[arg-type]
    world = built_world(config, request.seed, turning) if built else drawn_world(config, turning)
    random = np.random.default_rng([request.seed, 1])
    time_s = frame_times(QUICK_SECONDS if request.quick else SECONDS, world.rate_hz)
    path = pressed(world.built, time_s, presses(time_s, random))
    return Recorded(world, path, world.samples(path, random))


def _pose_point(request: Request, scene: str, entry: PoseMethod) -> list[Row]:
    world, path, samples = _recorded(request, scene)
    method = entry.make(world)
    answers, cost = timed(method.ask, samples, method.told)
    bound = pose_bound(world, path, SCENES[scene][1])
    good = np.array([not answer.flagged for answer in answers])
    errors = np.array([
        np.r_[answer.position_m - position, turn_between(axis, answer.axis)] if not answer.flagged else np.zeros(5)
        for answer, position, axis in zip(answers, path.position_m, path.axis, strict=True)
    ])[good]  # fmt: skip
    row = _row("pose", scene, entry, cost, good)
    if good.any():
        row["error_over_bound"] = round(float(np.sqrt(np.mean((errors / bound[good]) ** 2))), 4)
        row["position_um"] = round(float(np.sqrt(np.mean(np.sum(errors[:, :3] ** 2, axis=1)))) * 1e6, 3)
    return [row | {"settings": entry.settings}]


def _contact_point(request: Request, built: bool, entry: ContactMethod) -> list[Row]:
    _, path, samples = _recorded(request, "drifting", built)
    finder = entry.make(_bench(request, built))
    found, cost = timed(finder.ask, samples, finder.told)
    pressing = path.press[:, 2] >= LIGHTEST_N
    good = np.array([press is not None for press in found])
    row = _row("contact", _pad_name(built), entry, cost, good[pressing])
    errors = np.abs([press - true for press, true in zip(found, path.press, strict=True) if press is not None])
    errors = errors[pressing[good]]
    row["mae_mm"], row["mae_n"] = round(float(errors[:, :2].mean()), 4), round(float(errors[:, 2].mean()), 5)
    return [row]


@lru_cache(maxsize=2)
def _bench(request: Request, built: bool) -> Bench:
    return Bench.of(_recorded(request, "drifting", built).world)


def _row(chart: str, scene: str, entry: PoseMethod | ContactMethod, cost: tuple[float, float], good: Array) -> Row:
    median_us, p99_us = cost
    return {
        "chart": chart,
        "scene": scene,
        "method": entry.name,
        "family": entry.family,
        "median_us": median_us,
        "p99_us": p99_us,
        "answered": round(float(np.mean(good)), 5),
        "frames": len(good),
    }


def pose_bound(world: World, path: Path, unknowns: int) -> Array:
    """(K, 5) the Cramér–Rao bound of single frames: the kernel's covariance at the true pose, without a step."""
    pad = world.drawing
    states = [State(*pose, 0.0, np.zeros(3)).vector() for pose in zip(path.position_m, path.axis, strict=True)]
    rows = measurement_rows(np.zeros((len(pad.sensors), 3)), pad.sensors, world.noise_t)
    batch = Batch.of(
        np.repeat(rows[None], len(states), axis=0),
        magnet_rows(pad.magnet, octupole=True),
        parts_of(free=MODELS[unknowns]),
        np.array(states),
    )
    batch.solve(STOP_CHI2, 0)
    bound: Array = np.sqrt(np.einsum("kii->ki", batch.covariance)[:, :5])
    return bound
