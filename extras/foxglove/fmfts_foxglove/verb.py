"""`fmfts-daemon view --foxglove`: serves Foxglove instead of the page."""

from __future__ import annotations

import argparse
import sys

from fmfts.cli.verb import VerbError, ended_by, lacking, serving_base
from fmfts.common import exit_codes

PORT = 8765
OPEN_TO_ALL = (
    "Foxglove's protocol has no password: while this runs, every user of this machine, and every web page open in a "
    "browser on it, can read contacts. Nobody can change anything through it"
)


def view_in_foxglove(options: argparse.Namespace) -> int:
    try:
        from fmfts_foxglove.bridge import LOOPBACK, serve
    except ImportError as error:  # installed with --no-deps
        raise lacking(error, "foxglove") from error
    from fmfts_client import SchemaError
    from fmfts_client.endpoints import EndpointError, for_client

    def serving(address: str) -> None:
        print(OPEN_TO_ALL, file=sys.stderr)
        print(f"Foxglove: open the connection {address}", flush=True)

    if options.host != LOOPBACK or options.certificate or options.key:
        raise VerbError(
            exit_codes.USAGE, "--foxglove serves this machine alone: its server takes any Origin, and no key"
        )
    port = PORT if options.port is None else options.port
    try:
        with ended_by(EndpointError, SchemaError):
            serve(for_client(serving_base(options)), port, serving)
    except (OSError, RuntimeError) as error:
        raise VerbError(
            exit_codes.UNAVAILABLE, f"port {port} cannot be served: {error}; give another --port"
        ) from error
    return 0
