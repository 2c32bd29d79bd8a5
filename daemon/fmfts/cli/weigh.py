"""`fmfts-daemon weigh`: a known weight on the pad measures the stiffness of its silicone."""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from fmfts.cli.on_device import through_daemon
from fmfts.cli.verb import AddVerb, with_json

if TYPE_CHECKING:
    from fmfts.config import PadConfig

STANDARD_GRAVITY_M_PER_S2 = 9.80665
NEWTONS = {"g": 1e-3 * STANDARD_GRAVITY_M_PER_S2, "kg": STANDARD_GRAVITY_M_PER_S2, "N": 1.0}
HOW = (
    "learn how stiff this pad's silicone is from a known weight: the pad level, put 50 to 150 g (no iron) on a coin or "
    "a ball in its middle, let go, and wait ten seconds"
)


def add_to(verb: AddVerb) -> None:
    weigh = verb("weigh", _weigh, HOW)
    weigh.add_argument("weight_n", metavar="WEIGHT", type=_weight, help="with its unit: 100g, 0.1kg or 0.98N")
    weigh.add_argument(
        "--by",
        dest="width_m",
        metavar="WIDTH",
        type=_width,
        help="of what touches the silicone: 10mm",
    )
    weigh.add_argument("--anew", action="store_true", help="also if an earlier weight says otherwise")
    weigh.add_argument("--pad", metavar="NAME", help="needed if there are several")
    with_json(weigh)


def _weigh(options: argparse.Namespace) -> int:
    arguments = {name: getattr(options, name) for name in ("weight_n", "width_m", "anew")}
    return through_daemon(options, "weigh", arguments, _directly)


def _directly(pad: PadConfig, pads: Sequence[PadConfig], **arguments: Any) -> dict[str, Any]:
    from fmfts.cli.direct import record_baseline
    from fmfts.pipeline.weighing import Weighing

    learn = Weighing(pad, **arguments)
    return record_baseline(
        pad, pads, bare=False, replaced=False, turn=False, refine=False, duration_s=None, learn=learn
    )


def _weight(text: str) -> float:
    """In newtons."""
    number, unit = _quantity(text)
    if unit not in NEWTONS:
        raise argparse.ArgumentTypeError(f"{text} has no unit: write {number:g}g for grams, {number:g}N for newtons")
    return number * NEWTONS[unit]


def _width(text: str) -> float:
    """In metres."""
    number, unit = _quantity(text)
    if unit != "mm":
        raise argparse.ArgumentTypeError(f"{text}: in millimetres, like 10mm")
    return number * 1e-3


def _quantity(text: str) -> tuple[float, str]:
    found = re.fullmatch(r"([0-9.]+) ?([a-zA-Z]*)", text)
    try:
        number = float(found[1]) if found else math.nan
    except ValueError:
        number = math.nan
    if found is None or not 0.0 < number < math.inf:
        raise argparse.ArgumentTypeError(f"{text}: give a number above 0 and its unit: write 100g, not 1e2g")
    return number, found[2]
