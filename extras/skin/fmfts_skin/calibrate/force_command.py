"""What `calibrate` and `evaluate` do with sets of forces in three directions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fmfts.common.reading import read_regular
from fmfts.pad import Pad
from fmfts_calibrate.command import report_of, write_model
from fmfts_calibrate.field_table import DataError
from fmfts_calibrate.labelled_poses import Say
from fmfts_calibrate.tracked import Scene
from fmfts_skin.calibrate.force_fit import GAIN, OFFSET, ROTATION_RAD, Presses
from fmfts_skin.calibrate.force_judge import Judged, choose, make_routes
from fmfts_skin.calibrate.force_pose import pose_presses
from fmfts_skin.calibrate.force_set import ForceSet, read_force_set
from fmfts_skin.force_model import LARGEST_BYTES, ForceModel, Route


@dataclass(frozen=True, slots=True)
class KnownMagnet:
    """The pad of the pose route. baseline: a file; None: each session's own rest tells the magnet."""

    pad: Pad
    scene: Scene
    noise_t: float
    baseline: Path | None


def make_force_file(
    sources: Sequence[Path], target: Path, magnet: KnownMagnet | None, only: Route | None, say: Say
) -> dict[str, Any]:
    """Make a force model of the sets; write it and its report (.json); return the report.

    magnet: None: its pose is not known, so there is only the field route. only: the route to take; None: the best.
    Raises DataError, and OSError where the files cannot be written.
    """
    report = report_of(target, "MODEL.force")
    data = read_force_set(sources)
    origin = f"{', '.join(source.name for source in sources)} {data.digest[:12]}"
    routes = make_routes(_presses(data, magnet, only), data.clipped, data.sessions, origin, say)
    chosen = choose(routes, only)
    content = chosen.model.encoded()
    facts = {
        "data": [source.name for source in sources],
        "data_sha256": data.digest,
        "sessions": list(data.sessions),
        "rows": len(data.force_n),
        "another_day": {"gain": GAIN, "rotation_rad": ROTATION_RAD, "rest": OFFSET, "force": chosen.model.day_share},
        "routes": [route.facts() for route in routes],
        "chosen": chosen.model.route,
    }
    return write_model(target, content, report, facts)


def evaluate_force_file(sources: Sequence[Path], model: Path, magnet: KnownMagnet | None) -> Judged:
    """The report of the model at `model` on the sets. DataError, ForceModelError."""
    loaded = ForceModel.of(read_regular(model, LARGEST_BYTES), str(model))
    data = read_force_set(sources)
    if loaded.route != "field" and magnet is None:
        raise DataError(f"{model}: takes the magnet's pose, so it needs the pad's configuration: --config pad.toml")
    parts = _presses(data, magnet, loaded.route)
    has = sum((part.names for part in parts), ())
    if has != loaded.names:
        raise DataError(f"{sources[0]}: has values {', '.join(has)}; the model is of {', '.join(loaded.names)}")
    names = tuple(data.sessions[one] for one in data.session)
    found = loaded.find(np.concatenate([part.values for part in parts], axis=1))
    return Judged(data.force_n, found, data.clipped, names)


def _presses(data: ForceSet, magnet: KnownMagnet | None, only: Route | None) -> list[Presses]:
    out = []
    if only != "pose":
        field = data.change(), data.sensor, data.axis
        out.append(Presses("field", data.names, *field, data.force_n, data.session))
    if magnet is not None and only != "field":
        out.append(pose_presses(data, magnet.pad, magnet.scene, magnet.noise_t, magnet.baseline))
    if magnet is None and only in ("pose", "both"):
        raise DataError("the pose route needs the pad's configuration: --config pad.toml")
    return out
