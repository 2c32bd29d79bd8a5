"""Defines the verb `view`: the page in a browser, of one robot or of several."""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from fmfts.cli import elsewhere
from fmfts.cli.verb import LISTENERS_CONFIG, AddVerb, VerbError, ended_by, serving_base
from fmfts.common import exit_codes

PORT = 8710


def add_to(verb: AddVerb) -> None:
    """Add the verb. verb: makes a parser from a name, a handler and a line of help."""
    parser = verb("view", _view, "show a running daemon on a page in a browser", LISTENERS_CONFIG)
    parser.add_argument("--port", type=int, help=f"of the page, default {PORT}; 0: any that is free")
    parser.add_argument("--host", default="127.0.0.1", help="where to serve; off this machine only with --certificate")
    parser.add_argument("--certificate", type=Path, metavar="PEM", help="of TLS, with --key")
    parser.add_argument("--key", type=Path, metavar="PEM", help="the certificate's key; nobody else may read it")
    parser.add_argument("--recordings", type=Path, metavar="FOLDER", default=Path(), help="default: this folder")
    parser.add_argument(
        "--fixed-baseline", action="store_true", help="also draw the paper's method: a baseline that is only subtracted"
    )
    parser.add_argument(
        "--ghost-endpoint", metavar="ENDPOINT", help="where --fixed-baseline publishes; default: private"
    )
    parser.add_argument("--beside", metavar="ENDPOINT", action="append", default=[], help="further messages to draw")
    parser.add_argument(
        "--foxglove", action="store_true", help="serve Foxglove instead, on this machine alone, default port 8765"
    )
    parser.add_argument(
        "--robot", metavar="NAME=ENDPOINT", action="append", default=[], help="one of several robots: all on one page"
    )
    parser.add_argument(
        "--robot-keys", type=Path, metavar="FOLDER", help="NAME.key for each --robot; default: $FMFTS_KEY for all"
    )


def _view(options: argparse.Namespace) -> int:
    if options.robot_keys is not None and not options.robot:
        raise VerbError(exit_codes.USAGE, "--robot-keys is for --robot; the key of one robot is named by FMFTS_KEY")
    if options.foxglove and not options.robot:
        code: int = elsewhere.option("view --foxglove")(options)
        return code
    from fmfts_client.endpoints import EndpointError, for_client
    from fmfts_page.browser import shown_in_browser
    from fmfts_page.guard import Guard, RefusedAddressError
    from fmfts_page.serving import Where, serve_page

    port: int = PORT if options.port is None else options.port
    if not 0 <= port <= 65535:
        raise VerbError(exit_codes.USAGE, f"--port {port}: give 0 to 65535")
    with ended_by(EndpointError, RefusedAddressError), ExitStack() as stack:

        def serving(address: str) -> None:
            print(f"the page: {address}", flush=True)
            try:
                stack.enter_context(shown_in_browser(address))
            except OSError as error:
                print(f"no browser is opened ({error}): open the address yourself", file=sys.stderr)

        guard = Guard(options.host, options.certificate, options.key)
        if options.robot:
            elsewhere.option("view --robot")(options, guard, port, serving)
            return 0
        base = serving_base(options)
        where, folder = Where(for_client(base), base), options.recordings.absolute()
        beside: list[str] = options.beside
        if options.fixed_baseline:
            beside = [*beside, stack.enter_context(_fixed_baseline(base, options.ghost_endpoint))]
        serve_page(guard, where, folder, port, serving, beside)
    return 0


@contextmanager
def _fixed_baseline(base: str | None, endpoint: str | None) -> Iterator[str]:
    """Runs fmfts_page.ghost, and yields its endpoint. endpoint: None for one in a folder of its own."""
    with tempfile.TemporaryDirectory(prefix="fmfts-ghost-") as folder:
        endpoint = endpoint or f"ipc://{folder}/ghost"
        where = [] if base is None else ["--endpoint", base]
        command = [sys.executable, "-m", "fmfts_page.ghost", "--bind", endpoint, *where]
        ghost = subprocess.Popen(command, stdin=subprocess.DEVNULL)
        try:
            yield endpoint
        finally:
            ghost.terminate()
            ghost.wait()
