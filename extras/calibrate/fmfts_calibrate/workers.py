"""The options --workers and --cluster of verbs that compute for minutes."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from fmfts.cli.verb import VerbError
from fmfts.common import exit_codes

if TYPE_CHECKING:
    from fmfts_calibrate.sweep import Workers


def add_workers(parser: argparse.ArgumentParser, when: str) -> None:
    """when: in which case the options have an effect, for the help; "" always."""
    note = f" ({when})" if when else ""
    parser.add_argument(
        "--workers", type=int, default=1, metavar="N", help=f"processes of this machine{note}; the same result (1)"
    )
    parser.add_argument("--cluster", metavar="ADDRESS", help=f"a Dask scheduler, such as tcp://10.0.0.5:8786{note}")


def workers_of(options: argparse.Namespace) -> Workers:
    """Raises VerbError for a number that is not positive."""
    if options.workers < 1:
        raise VerbError(exit_codes.USAGE, f"--workers is {options.workers}: at least 1")
    from fmfts_calibrate.sweep import Workers

    return Workers(options.workers, options.cluster)
