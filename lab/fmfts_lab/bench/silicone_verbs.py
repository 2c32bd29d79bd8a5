"""The benchmarks of pads whose silicone, fingers or offsets are not the model's: their options."""

from __future__ import annotations

import argparse
from pathlib import Path

from fmfts_lab.bench import (
    any_pad,
    few_presses,
    known_modulus,
    long_squeeze,
    second_weight,
    silicone,
    structure,
    warm_presses,
    warming,
    weigh,
)


def add_verbs_of_silicone(verbs: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    verb = verbs.add_parser(
        "silicone", help="what real pads do besides: creep, casting, chips, fingers of other shapes"
    )
    verb.add_argument("--pads", type=int, default=4, help="how many pads are built, for each row")
    verb.add_argument("--seconds", type=float, default=12.0, help="of presses and pauses, for each pad")
    verb.add_argument("--only", nargs="+", metavar="EFFECT", help="effects whose name begins so")
    verb.add_argument("--turn", action="store_true", help="after --turn, not after bare and rest alone")
    verb.add_argument("--out", type=Path, help="write the figures there as JSON")
    verb.set_defaults(run=silicone.run)
    verb = verbs.add_parser("warming", help="offsets of chips drift more than assumed: down how long, false contacts")
    verb.add_argument("--pads", type=int, default=4, help="how many pads are built, for each row")
    verb.add_argument("--seconds", type=float, default=145.0, help="in which a pad warms evenly")
    verb.add_argument("--after", type=float, default=10.0, help="seconds in which it stays warm")
    verb.add_argument("--kelvin", type=float, default=10.0)
    verb.add_argument("--times", type=float, nargs="+", default=[1.0, 3.0], help="of the chip's offset_t_per_k")
    verb.add_argument("--scenes", nargs="+", choices=warming.AMBIENTS, default=warming.AMBIENTS)
    verb.add_argument("--fingers", nargs="+", choices=warming.FINGERS, default=warming.FINGERS)
    verb.add_argument("--turn", action="store_true", help="after --turn, not after bare and rest alone")
    verb.add_argument("--out", type=Path, help="write the figures there as JSON")
    verb.set_defaults(run=warming.run)
    verb = verbs.add_parser("warm-presses", help="light presses on such pads: published as contacts, and how late")
    verb.add_argument("--pads", type=int, default=12, help="how many pads are built, for each row")
    verb.add_argument("--kelvin", type=float, nargs="+", default=[0.0, 10.0, 20.0])
    verb.add_argument("--times", type=float, default=3.0, help="of the chip's offset_t_per_k")
    verb.add_argument("--out", type=Path, help="write the figures there as JSON")
    verb.set_defaults(run=warm_presses.run)
    verb = verbs.add_parser("long-squeeze", help="creeping silicone: false contacts after 4 N, force of a hold")
    verb.add_argument("--pads", type=int, default=1)
    verb.add_argument("--seconds", type=float, default=600.0, help="how long 4 N press")
    verb.add_argument("--creep", type=float, nargs="+", default=[1.0, 2.0], help="as much as is configured")
    verb.set_defaults(run=long_squeeze.run)
    verb = verbs.add_parser(
        "structure", help="other silicone, thickness, tilt and fingers than the model's: how wrong, how honest"
    )
    verb.add_argument("--pads", type=int, default=1, help="how many pads are built, for each row")
    verb.add_argument("--seconds", type=float, default=45.0, help="of presses and pauses, for each pad")
    verb.add_argument("--only", nargs="+", metavar="CELL", help="cells whose name begins so: tilt")
    verb.add_argument("--before", action="store_true", help="beside it, deviations that count none of it")
    verb.add_argument("--frictions", type=float, nargs="+", choices=structure.FRICTIONS, default=structure.FRICTIONS)
    verb.add_argument("--known", action="store_true", help="all but the tilt is known of these pads")
    verb.add_argument("--bare-and-rest", action="store_true", help="pads whose baseline has no --turn")
    verb.add_argument("--out", type=Path, help="write the figures there as JSON")
    verb.set_defaults(run=structure.run)
    verb = verbs.add_parser(
        "weigh", help="other silicone than the model's, before and after one weight; and wrong ones"
    )
    verb.add_argument("--pads", type=int, default=1, help="how many pads are built, for each row")
    verb.add_argument("--seconds", type=float, default=14.0, help="of presses and pauses, for each pad")
    verb.add_argument("--only", nargs="+", metavar="CELL", help="rows whose name begins so: 'modulus × 2'")
    verb.add_argument("--out", type=Path, help="write the figures there as JSON")
    verb.set_defaults(run=weigh.run)
    verb = verbs.add_parser("few-presses", help="other silicone than the model's, after calibrate --correct")
    verb.add_argument("--pads", type=int, default=1, help="how many pads are built, for each row")
    verb.add_argument("--seconds", type=float, default=14.0, help="of presses and pauses, for each pad")
    verb.add_argument("--presses", type=int, help="only so many (5, 9 and 18)")
    verb.add_argument("--against", action="store_true", help="labelled by a weighed pad that presses against it")
    verb.add_argument("--refine", action="store_true", help="after baseline --refine, too")
    verb.add_argument(
        "--without",
        nargs="+",
        choices=("mounting", "labels", "shape", "noise"),
        default=(),
        help="errors to leave out: what limits?",
    )
    verb.set_defaults(run=few_presses.run)
    verb = verbs.add_parser(
        "any-pad", help="pads drawn over all moduli, thicknesses, Poisson's ratios and fingers; a weight; five presses"
    )
    verb.add_argument("--pads", type=int, default=40, help="how many pads are drawn, one for each seed")
    verb.add_argument("--seconds", type=float, default=14.0, help="of presses and pauses, for each pad")
    verb.add_argument("--refine", action="store_true", help="after baseline --refine, too")
    verb.add_argument("--out", type=Path, help="write the figures there as JSON")
    verb.set_defaults(run=any_pad.run)
    verb = verbs.add_parser("second-weight", help="whether a second weight, aside, tells how thick a pad is")
    verb.add_argument("--pads", type=int, default=6, help="how many pads are built, for each thickness")
    verb.set_defaults(run=second_weight.run)
    verb = verbs.add_parser("known-modulus", help="50 g called 100 g on pads whose modulus is known to 5 %%: refused?")
    verb.add_argument("--pads", type=int, default=6, help="how many pads are built, for each kind")
    verb.set_defaults(run=known_modulus.run)
