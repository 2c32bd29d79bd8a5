"""The verb `pad-model`: its options, and what it prints."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING

from fmfts.cli.verb import AddVerb, VerbError, configured_pad, ended_by, lacking, not_written
from fmfts.common import exit_codes
from fmfts_calibrate.sweep import ClusterError
from fmfts_calibrate.workers import add_workers, workers_of

if TYPE_CHECKING:
    from fmfts.config import PadConfig
    from fmfts_lab.finite_elements.slab import Slab
    from fmfts_simulation.mechanics import Mechanics


def add_to(verb: AddVerb) -> None:
    """Add the verb; `verb` makes a parser from a name, a handler and a line of help."""
    model = verb("pad-model", _pad_model, "make a simulated pad of any size and stiffness, by finite elements")
    model.add_argument("-o", "--output", type=Path, metavar="PAD.npz", required=True)
    model.add_argument("--picture", type=Path, metavar="FILE", help="PNG, SVG or PDF (PAD.png)")
    model.add_argument("--pad", metavar="NAME", help="the pad with this magnet; needed if there are several")
    for name, default, text in (
        ("width-mm", 40.0, "edge of the square slab (40)"),
        ("thickness-mm", 4.0, "of the slab (4)"),
        ("rim-mm", 3.0, "width of the fixed rim of the bottom face (3)"),
        ("magnet-height-mm", None, "height of the magnet's centre above the slab's bottom (half the thickness)"),
        ("patch-mm", 6.0, "diameter of the pressing patch (6)"),
        ("c10-mpa", 0.162416, "Mooney-Rivlin (0.162416)"),
        ("c01-mpa", 0.040604, "Mooney-Rivlin (0.040604)"),
        ("bulk-mpa", 20.30201, "bulk modulus (20.30201)"),
        ("element-mm", 1.0, "edge of the finite elements (1)"),
    ):
        model.add_argument(f"--{name}", type=float, default=default, metavar=name[-3:].strip("-").upper(), help=text)
    add_workers(model, "with --solved")
    model.add_argument(
        "--solved", type=Path, metavar="FILE.csv", help="for large forces: solve each press, kept here (ten minutes)"
    )


def _pad_model(options: argparse.Namespace) -> int:
    config = configured_pad(options)
    try:
        slab = _slab(options, config)
    except ValueError as error:
        raise VerbError(exit_codes.USAGE, str(error)) from error
    try:
        from fmfts_lab.finite_elements.picture import draw

        mechanics = _mechanics(options, slab)
    except ImportError as error:
        raise lacking(error, "fem") from error
    except (ArithmeticError, ValueError) as error:
        raise VerbError(exit_codes.DATA, str(error)) from error
    from fmfts_lab.finite_elements.pad_file import write_pad_file

    picture = options.picture or options.output.with_suffix(".png")
    try:
        write_pad_file(options.output, mechanics, slab)
        draw(mechanics, picture)
    except OSError as error:
        raise not_written(error, options.output) from error
    except ValueError as error:  # matplotlib does not know the suffix
        raise VerbError(exit_codes.USAGE, f"{picture}: {error}") from error
    if options.solved is None:
        print(f"{options.output}: linear, to 2 % up to 0.25 N on the standard slab; --solved tables larger forces")
    else:
        print(f"{options.output}: solved up to {mechanics.largest_force_n:g} N")
    print(f"{options.output}: set [pad.source] mechanics to it; {picture} shows it")
    return 0


def _slab(options: argparse.Namespace, config: PadConfig) -> Slab:
    from fmfts_lab.finite_elements.slab import Slab

    height_mm = options.thickness_mm / 2.0 if options.magnet_height_mm is None else options.magnet_height_mm
    if not 0.2 <= options.element_mm <= 4.0 or not math.isfinite(options.element_mm):
        raise ValueError(f"--element-mm is {options.element_mm:g}: from 0.2 to 4")
    return Slab(
        width_m=options.width_mm * 1e-3,
        thickness_m=options.thickness_mm * 1e-3,
        rim_m=options.rim_mm * 1e-3,
        magnet_height_m=height_mm * 1e-3,
        magnet_diameter_m=config.magnet.diameter_mm * 1e-3,
        magnet_length_m=config.magnet.length_mm * 1e-3,
        patch_diameter_m=options.patch_mm * 1e-3,
        c10_pa=options.c10_mpa * 1e6,
        c01_pa=options.c01_mpa * 1e6,
        bulk_pa=options.bulk_mpa * 1e6,
    )


def _mechanics(options: argparse.Namespace, slab: Slab) -> Mechanics:
    from fmfts.view.progress import progress_bar
    from fmfts_lab.finite_elements.reciprocity import Influence

    with progress_bar("pad-model") as show:
        if options.solved is None:
            return Influence.of(slab, options.element_mm * 1e-3, show).mechanics()
        from fmfts_lab.finite_elements.solved_presses import normal_grid, solve_into
        from fmfts_simulation.solved_table import normal_mechanics, read_solved

        workers = workers_of(options)
        with ended_by(ClusterError):
            solve_into(options.solved, normal_grid(slab.reach_m), slab, options.element_mm * 1e-3, show, workers)
        return normal_mechanics(read_solved(options.solved))
