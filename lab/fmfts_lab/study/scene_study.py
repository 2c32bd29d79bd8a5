"""Which model does a config's scene need? Noise and bias of every model, the smallest that suffices, and its limits."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from fmfts.baseline import BaselineError
from fmfts.baseline.files import stored
from fmfts.contact import ContactModel, ModelError
from fmfts.contact.response import Response
from fmfts.pad import Array
from fmfts.sensor.chips import NOISE_T
from fmfts_calibrate.dataset import standard_pad
from fmfts_calibrate.field_table import DataError
from fmfts_lab.scene import Cost, Model, Surroundings, configured, costs, placed_beside, recommended
from fmfts_lab.study import scene_chart, scene_chips, scene_facts
from fmfts_lab.study.harness import Facts, Request, Row, Study, say
from fmfts_lab.study.scene_networks import SIZES, Networks, smallest_network
from fmfts_lab.study.scene_trial import tried, tried_beside

SHIPPED = Model(8, True)  # as in config.toml: a field that drifts, and no neighbours
COLUMNS = ("kind", "model", "unknowns", "cylinder", "neighbours", "noise_mm", "bias_mm", "noise_n", "bias_n", "error",
           "causes", "hidden", "parameters", "noise_in_bounds", "bias_in_bounds", "score",
           "available", "answered", "wrong", "frames")  # fmt: skip
CHIP_COLUMNS = (
    "kind",
    "chip",
    "trigger",
    "rate_hz",
    "noise_ut",
    "range_gauss",
    "noise_mm",
    "noise_n",
    "mean_mm",
    "causes",
)
TRIED = ("recommended", "shipped default")
BESIDE_S, QUICK_BESIDE_S = 14.0, 6.0


@dataclass(frozen=True, slots=True)
class Scene:
    """said: sentences about the study's assumptions."""

    surroundings: Surroundings
    said: list[str]

    @classmethod
    def of(cls, request: Request) -> Scene:
        response, where = _response(request)
        noise_t, whence = _noise(request)
        others = placed_beside(request.pad, request.pads)
        return cls(Surroundings(request.pad, response, noise_t, others), [where, whence])


def run(request: Request) -> Facts:
    """Run the study. DataError if no contact model holds a response."""
    scene = Scene.of(request)
    if request.chips:
        study = Study("scene-chips", request, CHIP_COLUMNS)
        rows = study.measure({"chips": partial(scene_chips.chip_rows, scene.surroundings)})
        return study.conclude({"assumed": scene.said[:1], "chips": rows})
    surroundings, networks = scene.surroundings, Networks.of(scene.surroundings, request.quick)
    study = Study("scene", request, COLUMNS)
    found = costs(surroundings)
    best = recommended(found)
    points: dict[str, Callable[[], Iterator[Row]]] = {"models": partial(_model_rows, found)}
    for hidden in SIZES[: 3 if request.quick else None]:
        points[f"network of {hidden}"] = partial(networks.rows, hidden)
    if best.model.neighbours:
        points["running"] = partial(_running_rows, surroundings, request)
    if (best.model.unknowns, best.model.cylinder) != (SHIPPED.unknowns, SHIPPED.cylinder):
        for name, model in zip(TRIED, (best.model, SHIPPED), strict=True):
            points[name] = partial(_trial_rows, surroundings, name, model, request)
    rows = study.measure(points)
    facts = study.conclude(
        {
            "assumed": scene.said,
            "recommended": str(best.model),
            "configured": str(configured(surroundings)),
            "network": smallest_network(rows),
            "limits": scene_facts.limits(surroundings),
            "would_pay": scene_facts.would_pay(surroundings, best),
            "models": [row for row in rows if row["kind"] == "model"],
            "networks": [row for row in rows if row["kind"] == "network"],
            "trials": [row for row in rows if row["kind"] == "trial"],
            "running": [row for row in rows if row["kind"] == "running"],
        }
    )
    study.draw(scene_chart.models(rows, str(best.model)))
    return facts


HEADER = f"{'model':34} {'place, mm: noise':>17} {'bias':>8} {'force, N: noise':>16} {'bias':>8} {'error, bounds':>14}"


def printed(facts: Facts) -> str:
    if "chips" in facts:
        return "\n".join([*facts["assumed"], *scene_chips.printed(facts["chips"])])
    lines = [*facts["assumed"], "", HEADER]
    for row in facts["models"]:
        mark = "  <- recommended" if row["model"] == facts["recommended"] else ""
        lines.append(
            f"{row['model']:34} {row['noise_mm']:17.3f} {row['bias_mm']:8.3f} {row['noise_n']:16.4f} "
            f"{row['bias_n']:8.4f} {row['error']:14.2f}{mark}"
        )
    lines += ["", f"recommended: {facts['recommended']}; the config has {facts['configured']}"]
    for row in facts["trials"]:
        errors = f"{row['noise_mm']:.3f} mm, {row['noise_n']:.4f} N rms"
        lines.append(f"single frames solved and inverted, {row['model']} ({row['causes']}): {errors}")
    for row in facts["running"]:
        if row["frames"] is None:  # no model or baseline was available to run them with; a sentence in `said` explains
            continue
        lines.append(
            f"both pads running and pressed, {row['model']} ({row['causes']}): {row['available']:.1%} of "
            f"{row['frames']} frames ok, {row['wrong']} wrong; {row['answered']:.1%} of presses answered, those that "
            f"both answer to {row['noise_mm']:.3f} mm, {row['noise_n']:.4f} N rms"
        )
    lines.append("")
    for row in facts["networks"]:
        errors = f"bias {row['bias_in_bounds']:.2f}, error {row['score']:.3f} bounds"
        lines.append(f"network, two layers of {row['hidden']}: {errors}")
    return "\n".join([*lines, facts["network"], "", *facts["limits"], *facts["would_pay"]])


def _model_rows(found: list[Cost]) -> Iterator[Row]:
    for cost in found:
        yield _named("model", cost.model) | {
            "noise_mm": cost.noise_mm,
            "bias_mm": cost.bias_mm,
            "noise_n": cost.noise_n,
            "bias_n": cost.bias_n,
            "error": cost.error,
            "causes": "; ".join(f"{cause} {bias:.2f}" for cause, bias in cost.bias_of.items() if bias >= 0.005),
        }


def _trial_rows(surroundings: Surroundings, name: str, model: Model, request: Request) -> Iterator[Row]:
    errors = tried(surroundings, model, 60 if request.quick else 600, request.seed)
    place, force = _rms(errors)
    yield _named("trial", model) | {"causes": name, "noise_mm": place, "noise_n": force}


def _running_rows(surroundings: Surroundings, request: Request) -> Iterator[Row]:
    seconds = QUICK_BESIDE_S if request.quick else BESIDE_S
    models = replace(SHIPPED, neighbours=(surroundings.others[0].name,)), SHIPPED
    rows = [_named("running", model) | {"causes": name} for name, model in zip(TRIED, models, strict=True)]
    try:
        found = tried_beside(surroundings, seconds, request.seed)
    except (ModelError, BaselineError) as error:
        say(f"the pads were not run: {error}")
        yield from rows
        return
    for row, beside in zip(rows, found, strict=True):
        outcome, (place, force) = beside.outcome, _rms(beside.errors)
        yield row | {
            "noise_mm": place,
            "noise_n": force,
            "available": outcome.health["ok"] / outcome.frames,
            "answered": beside.answered,
            "wrong": outcome.wrong,
            "frames": outcome.frames,
        }


def _rms(errors: Array) -> tuple[float, float]:
    """The rms errors of place and of force."""
    return float(np.sqrt(np.mean(errors[:, :2] ** 2))), float(np.sqrt(np.mean(errors[:, 2] ** 2)))


def _named(kind: str, model: Model) -> Row:
    return {
        "kind": kind,
        "model": str(model),
        "unknowns": model.unknowns,
        "cylinder": model.cylinder,
        "neighbours": " ".join(model.neighbours),
    }


def _response(request: Request) -> tuple[Response, str]:
    """The response of the config's model, else of the shipped one: a pad of other dimensions in the same silicone."""
    contact, pad = request.pad.contact, request.pad.pad()
    where = f"presses as {contact.model!r} answers them"
    try:
        response = ContactModel.load(contact.model, pad).response
    except ModelError as error:
        if contact.model != "default":
            raise DataError(str(error)) from error
        response, where = None, ""
    if response is None:
        response = ContactModel.load("default", standard_pad()).response
        where = "presses as the standard pad's silicone answers them: no model of this pad tells"
    if response is None:
        raise DataError("the shipped contact model holds no response: make it again with `make model`")
    return response, f"{where}, up to {response.scale_n:.3g} N"


def _noise(request: Request) -> tuple[float, str]:
    try:
        baseline = stored(request.pad.pad())
    except BaselineError as error:
        return NOISE_T, f"noise of the data sheet, {NOISE_T * 1e6:g} µT: {error}"
    recorded = None if baseline is None else baseline.rest or baseline.bare
    if baseline is None or recorded is None:
        return NOISE_T, f"noise of the data sheet, {NOISE_T * 1e6:g} µT: no baseline is recorded"
    noise_t = float(np.sqrt(np.mean(np.square(recorded.noise_t))))
    return noise_t, f"noise of baseline {baseline.id}, {noise_t * 1e6:.2g} µT"
