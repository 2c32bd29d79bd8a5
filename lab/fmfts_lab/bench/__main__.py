"""python -m fmfts_lab.bench VERB: measures what solver, tracker, baselines and contact model cost, and their errors."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

from fmfts.common.extras import how_to_install
from fmfts_lab.bench import (
    accuracy,
    alternating,
    as_built,
    baselines,
    causes,
    chips,
    contact,
    convergence,
    faults,
    frame_cost,
    imperfect_causes,
    kept_figures,
    latency,
    learned,
    moment,
    neighbours,
    now,
    overload,
    resident,
    several,
    shear,
    slip,
    speed,
    stated_forces,
    tools,
    turning,
)
from fmfts_lab.bench.silicone_verbs import add_verbs_of_silicone


def of_skins(name: str) -> Callable[[argparse.Namespace], None]:
    """A benchmark that reads skins with a package which the others do without: `pip install ./lab` brings no extra."""

    def run(options: argparse.Namespace) -> None:
        try:
            module = import_module(f"fmfts_lab.bench.{name}")
        except ModuleNotFoundError as error:
            if (error.name or "").partition(".")[0] != "fmfts_skin":
                raise
            sys.exit(f"{name} needs fmfts-skin, which {how_to_install('skin')}")
        module.run(options)

    return run


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m fmfts_lab.bench", description="measure the pose solver")
    parser.add_argument("--seed", type=int, default=1)
    verbs = parser.add_subparsers(required=True, metavar="VERB")
    verb = verbs.add_parser("speed", help="time per solve beside other solvers, one run, one table")
    verb.add_argument("--chart", type=Path, metavar="FILE.svg", help="draw the growth (needs matplotlib)")
    verb.add_argument("--beside", type=Path, metavar="FILE", help="another build's _kernel….so: only the ratio of both")
    verb.set_defaults(run=speed.run)
    verb = verbs.add_parser("accuracy", help="errors over the Cramér–Rao bound, and whether the covariance is honest")
    verb.add_argument("--draws", type=int, default=20000)
    verb.set_defaults(run=accuracy.run)
    verb = verbs.add_parser("convergence", help="cold starts, and how many go wrong unnoticed")
    verb.add_argument("--draws", type=int, default=20000, help="for each model and number of sensors")
    verb.add_argument("--sensors", type=int, nargs="+", choices=(4, 3), default=(4, 3))
    verb.add_argument("--unknowns", type=int, nargs="+", choices=(6, 8), default=(6, 8))
    verb.set_defaults(run=convergence.run)
    verb = verbs.add_parser("faults", help="broken sensors and foreign fields: seen when, named right, wrong how often")
    verb.add_argument("--quick", action="store_true", help="a few sensors and axes, half a minute")
    verb.add_argument("--only", nargs="+", metavar="KIND", help='faults that begin so: "offset 100" turning')
    verb.add_argument("--scenes", nargs="+", choices=faults.AMBIENTS, default=faults.AMBIENTS)
    verb.add_argument("--drilled", type=int, default=3, help="on how many pads each fault is tried; 0: none")
    verb.add_argument("--pads", type=int, default=8, help="how many healthy pads are tapped")
    verb.add_argument("--seconds", type=float, default=1350.0, help="for how long each of them is; 0: none")
    verb.add_argument("--out", type=Path, help="write the figures there as JSON")
    verb.set_defaults(run=faults.run)
    verb = verbs.add_parser("turning", help="a pressed pad on a robot that turns, against the bound; and warming")
    verb.add_argument("--seconds", type=float, default=30.0, help="of turning, for each pad")
    verb.add_argument("--draws", type=int, default=8, help="pads of each row whose gains are off")
    verb.add_argument("--warm-minutes", type=float, default=10.0, help="in which a pad warms by 20 K; 0: none")
    verb.add_argument("--warm-pads", type=int, default=1, help="how many pads are warmed")
    verb.set_defaults(run=turning.run)
    verb = verbs.add_parser("several", help="two fingers on four magnets: told apart, how well, and never one as two")
    verb.add_argument("--frames", type=int, default=400, help="of two fingers, for each row")
    verb.add_argument("--one-finger", type=int, default=2000, help="frames of one finger, for each row")
    verb.add_argument(
        "--gains", type=int, default=1000, help="of so many of them the gain of a second finger is computed"
    )
    verb.add_argument("--speed", action="store_true", help="only the time of a frame")
    verb.add_argument("--growth", action="store_true", help="only the same by magnets, sensors and fingers")
    verb.add_argument("--now", action="store_true", help="only how wrong `now` is, as `bench now` of one magnet")
    verb.add_argument("--bound", action="store_true", help="with --now: the best that straight lines could say instead")
    verb.add_argument("--repeats", type=int, default=400, help="frames that are timed")
    verb.add_argument(
        "--running", type=int, nargs="?", const=16, metavar="PADS", help="only a daemon with so many such pads (16)"
    )
    verb.add_argument("--seconds", type=float, default=20.0, help="with --running, --now: how long it is measured")
    verb.add_argument("--drills", action="store_true", help="faults, steel, turning and warming instead")
    verb.add_argument("--merged", action="store_true", help="only two fingers that come nearer to each other")
    verb.add_argument("--chart", type=Path, metavar="FILE", help="with --merged or --growth: draw it")
    verb.add_argument("--above", action="store_true", help="only two fingers that are just far enough apart")
    verb.add_argument("--doubted", action="store_true", help="only one finger: how often two are suspected")
    verb.add_argument("--whole", action="store_true", help="only what is published of one finger, and of solved pairs")
    verb.add_argument("--worst", type=int, default=0, help="with --whole: also the draws of so many worst frames")
    verb.add_argument("--through-poses", action="store_true", help="only fingers by the poses of all magnets")
    verb.add_argument("--free-poses", action="store_true", help="only the poses by the field alone, on other pads, too")
    verb.add_argument("--calibrated", action="store_true", help="only a pad in other silicone, and `calibrate`")
    verb.add_argument("--beside", action="store_true", help="only one finger, beside the pad with one magnet")
    verb.add_argument("--only", nargs="+", metavar="DRILL", help="drills whose names begin so")
    verb.add_argument("--pads", type=int, default=3, help="how many pads are drilled, or calibrated")
    verb.set_defaults(run=several.run)
    verb = verbs.add_parser("real", help="what public recordings of real sensors show, and their charts")
    verb.add_argument("--recordings", type=Path, required=True, metavar="FOLDER", help="see lab/results/real.md")
    verb.add_argument("--charts", type=Path, metavar="FOLDER", help="draw a chart of each there (needs matplotlib)")
    verb.add_argument("--only", nargs="+", metavar="NAME", help="only these: sold-sensor another-day …")
    verb.set_defaults(run=of_skins("real"))
    verb = verbs.add_parser("eflesh", help="a public pad of unknown magnets: what its recordings give")
    verb.add_argument("--recordings", type=Path, required=True, metavar="FOLDER", help="has eflesh_normal_1.csv …")
    verb.set_defaults(run=of_skins("eflesh"))
    verb = verbs.add_parser("moment", help="what following the moment at rest would bring, and what it would hide")
    verb.set_defaults(run=moment.run)
    verb = verbs.add_parser("baselines", help="contact errors that bare, rest, --turn and --refine leave")
    verb.add_argument("--pads", type=int, default=20, help="how many pads are built, for each row")
    verb.set_defaults(run=baselines.run)
    verb = verbs.add_parser("as-built", help="chips turned by hand: health, errors and honesty after each baseline")
    verb.add_argument("--pads", type=int, default=20, help="how many pads are built, for each row")
    verb.add_argument("--seconds", type=float, default=9.1, help="of presses and pauses, for each pad and baseline")
    verb.add_argument("--rotations", type=float, nargs="+", default=as_built.ROTATIONS_DEG, metavar="DEGREES")
    verb.add_argument("--gains", type=float, nargs="+", default=as_built.GAINS)
    verb.add_argument("--robots", nargs="+", choices=as_built.ROBOTS, default=as_built.ROBOTS)
    verb.add_argument("--baselines", nargs="+", choices=as_built.KINDS, default=as_built.KINDS)
    verb.add_argument("--refine", action="store_true", help="with contact.refine")
    verb.add_argument("--untouched", action="store_true", help="nothing presses: are contacts told all the same?")
    verb.add_argument(
        "--counted",
        choices=("stated", "shipped", "drawn", "unnamed"),
        default="shipped",
        help="what deviations count: default tolerances, as pads have; all of them, of pads that have less; "
        "only what these have; no rotation, no cross-axis",
    )
    verb.add_argument("--out", type=Path, help="write the figures there as JSON")
    verb.set_defaults(run=as_built.run)
    verb = verbs.add_parser("stated-forces", help="pads as in `as-built --counted stated`, without noise: wrong forces")
    verb.add_argument("--pads", type=int, default=20000)
    verb.set_defaults(run=stated_forces.run)
    verb = verbs.add_parser("learned", help="sensors that nobody measured: after baseline --learn, beside known ones")
    verb.add_argument("--pads", type=int, default=4, help="how many boards are drawn")
    verb.add_argument("--seconds", type=float, default=9.1, help="of presses and pauses, for each pad and baseline")
    verb.add_argument("--remanence", type=float, default=0.05, help="its tolerance; these magnets differ by 5 %%")
    verb.add_argument("--out", type=Path, help="write the figures there as JSON")
    verb.set_defaults(run=learned.run)
    verb = verbs.add_parser("causes", help="what a running pad says of defects, alone and in pairs")
    verb.add_argument("--together", type=int, nargs="+", default=[1, 2], help="how many defects at once")
    verb.add_argument("--scenes", nargs="+", choices=faults.AMBIENTS)
    verb.add_argument("--verbose", action="store_true", help="also the cases that are named right")
    verb.set_defaults(run=causes.run)
    verb = verbs.add_parser("imperfect-causes", help="what pads with turned chips and imperfections say of defects")
    verb.add_argument("--pads", type=int, default=2, help="how many pads are built, for each row")
    verb.add_argument("--scenes", nargs="+", choices=faults.AMBIENTS)
    verb.add_argument("--baselines", nargs="+", choices=("rest", "turn"), default=("rest", "turn"))
    verb.add_argument("--only", nargs="+", metavar="GROUP", help='rows: "two defects"')
    verb.set_defaults(run=imperfect_causes.run)
    verb = verbs.add_parser("tools", help="a magnetic tool passes, is put down, turns: wrong frames, false contacts")
    verb.add_argument("--pads", type=int, default=1, help="how many pads are built, for each row")
    verb.add_argument("--scenes", nargs="+", choices=tools.SCENES, default=tools.SCENES)
    verb.add_argument("--moments", type=float, nargs="+", default=tools.MOMENTS_A_M2, metavar="A_M2")
    verb.add_argument("--built", choices=tuple(tools.BUILT), default="drawn", help="how chips are turned and gains off")
    verb.add_argument("--touches", nargs="+", choices=tuple(tools.FINGERS), default=tuple(tools.FINGERS))
    verb.add_argument("--model", default="default", help="the contact model: shear, or another")
    verb.add_argument("--verbose", action="store_true", help="a row for each way, too")
    verb.add_argument("--out", type=Path, help="write the figures there as JSON")
    verb.set_defaults(run=tools.run)
    verb = verbs.add_parser("alternating", help="mains and a motor: found, named and counted?")
    verb.add_argument("--seconds", type=float, default=5.0, help="of presses and pauses, for each pad")
    verb.add_argument("--pads", type=int, default=3, help="of successive seeds")
    verb.add_argument("--scenes", nargs="+", choices=faults.AMBIENTS, default=faults.AMBIENTS)
    verb.add_argument("--amplitudes-ut", type=float, nargs="+", default=alternating.AMPLITUDES_UT, metavar="UT")
    verb.set_defaults(run=alternating.run)
    verb = verbs.add_parser("neighbours", help="two pads side by side, both pressed, told of each other and not")
    verb.add_argument("--seconds", type=float, default=24.0, help="of pressing, for each row")
    verb.add_argument("--magnets", nargs="+", choices=("1+1", "4+1", "4+4"), help="of the pads of a pair")
    verb.add_argument("--scenes", nargs="+", choices=neighbours.AMBIENTS, default=neighbours.AMBIENTS)
    verb.set_defaults(run=neighbours.run)
    verb = verbs.add_parser(
        "contact", help="the contact model beside maximum likelihood: errors, honesty, touch, motion"
    )
    verb.add_argument("--frames", type=int, default=3000)
    verb.add_argument("--model", default="default", help="an ONNX file; default: the one that ships")
    verb.add_argument("--hours", type=float, default=1.0, help="of unloaded frames, for false contacts")
    verb.add_argument("--part", choices=contact.PARTS, help="only this part")
    verb.add_argument("--out", type=Path, help="write the figures there as JSON")
    verb.set_defaults(run=contact.run)
    verb = verbs.add_parser("chips", help="the contact's error with each kind of chip, over its bound")
    verb.add_argument("--frames", type=int, default=1000, help="presses for each row")
    verb.set_defaults(run=chips.run)
    verb = verbs.add_parser("latency", help="from a frame's bytes to its message, beside an echo; processor and memory")
    verb.add_argument("--pads", type=int, nargs="+", default=[1, 4, 16, 64], help="how many, one after another")
    verb.add_argument("--seconds", type=float, default=10.0, help="for each row, after a second of warming up")
    verb.add_argument("--rounds", type=int, default=2, help="echo and daemon in turns")
    verb.add_argument("--size", type=int, default=860, help="bytes of the echo's message: a contact's")
    verb.add_argument("--chart", type=Path, metavar="FILE.svg", help="draw the growth with pads (needs matplotlib)")
    verb.set_defaults(run=latency.run)
    verb = verbs.add_parser("overload", help="more work than the computer can do: true ages, losses, recovery")
    verb.add_argument("--seconds", type=float, default=6.0, help="of load, for each row")
    verb.add_argument("--rows", type=int, nargs="*", metavar="N", help="only these rows, from 0")
    verb.add_argument("--no-echo", dest="echo", action="store_false", help="without what an echo can carry beside")
    verb.set_defaults(run=overload.run)
    verb = verbs.add_parser("frame", help="what a frame costs by stage, on hot and on cold caches")
    verb.add_argument(
        "--beside",
        metavar="COMMIT",
        help="only compare time and messages with those of a commit, or of a FOLDER's package",
    )
    verb.add_argument(
        "--states", action="store_true", help="instead: by the state of its pad (faults, models, recorders)"
    )
    verb.add_argument(
        "--first", type=int, metavar="PADS", help="instead: the first frame after a fault, of so many pads"
    )
    verb.set_defaults(run=frame_cost.run)
    verb = verbs.add_parser("resident", help="whether the daemon's memory grows, a row each minute")
    verb.add_argument("--pads", type=int, default=4)
    verb.add_argument("--seconds", type=float, default=3600.0)
    verb.add_argument("--every", type=float, default=60.0, metavar="SECONDS", help="a row")
    verb.set_defaults(run=resident.run)
    verb = verbs.add_parser("now", help="errors when a contact is published and when it is read: today's beside `now`")
    verb.add_argument("--pads", type=int, default=6, help="how many built pads")
    verb.add_argument("--seconds", type=float, default=2.0, help="of each motion on each pad")
    verb.add_argument("--drilled", type=int, default=1, help="on how many pads sensors begin to fail; 0: none")
    verb.add_argument("--ablation", action="store_true", help="instead: without each part of the filter")
    verb.add_argument("--out", type=Path, help="write the figures there as JSON")
    verb.add_argument("--samples", action="store_true", help='samples as they come: publish = "sample"')
    verb.set_defaults(run=now.run)
    verb = verbs.add_parser("slip", help="fingers that slip: noticed how often, how soon; friction; false alarms")
    verb.add_argument("--part", choices=("bound", "table", "drags", "healthy"), help="only this part")
    verb.add_argument("--slides", type=int, default=40, help="by the table, at each speed")
    verb.add_argument("--repeats", type=int, default=2, help="of each drag at each speed")
    verb.add_argument("--minutes", type=float, default=10.0, help="of each healthy finger")
    verb.set_defaults(run=slip.run)
    verb = verbs.add_parser(
        "shear", help="force in three directions over the whole pad, and what it costs without shear"
    )
    verb.add_argument("--part", choices=("solved", "frames", "plain", "speed"), help="only this part")
    verb.add_argument("--frames", type=int, default=400_000)
    verb.set_defaults(run=shear.run)
    add_verbs_of_silicone(verbs)
    verb = verbs.add_parser(
        "tables", help="write tables of pages anew, from the figures that are kept of several seeds"
    )
    verb.add_argument("--results", type=Path, default=kept_figures.RESULTS, metavar="FOLDER", help="of the pages")
    verb.set_defaults(run=kept_figures.run)
    options = parser.parse_args()
    options.run(options)


if __name__ == "__main__":
    main()
