"""Defines the verb `keys`: its options and what it prints."""

from __future__ import annotations

import argparse
from pathlib import Path

from fmfts.cli.verb import AddVerb, VerbError, configuration, ended_by
from fmfts.common import exit_codes


def add_to(verb: AddVerb) -> None:
    """Add the verb. verb: makes a parser from a name, a handler and a line of help."""
    keys = verb("keys", _keys, "make and list the keys that let clients in over the network")
    keys.add_argument("action", choices=("new", "forget", "list"))
    keys.add_argument("name", nargs="?", metavar="NAME", help="name of the client")
    keys.add_argument("-o", "--output", type=Path, metavar="FILE", help="file for the client's key (NAME.key)")


def _keys(options: argparse.Namespace) -> int:
    from fmfts.bus.keys import KeyFolder
    from fmfts.bus.lock import BusError

    folder = configuration(options).bus.keys
    if folder is None:
        raise VerbError(exit_codes.CONFIG, 'set [bus] keys to a folder for the keys (keys = "/etc/fmfts/keys")')
    if (options.name is None) != (options.action == "list"):
        raise VerbError(exit_codes.USAGE, f"keys {options.action}: {'no' if options.name else 'a'} NAME is needed")
    store = KeyFolder(Path(folder))
    with ended_by(BusError):
        if options.action == "new":
            output = options.output or Path(f"{options.name}.key")
            store.add(options.name, output)
            print(f"{output}: copy this file to the client by a safe way, and set FMFTS_KEY to it there")
        elif options.action == "forget":
            store.forget(options.name)
        else:
            print("\n".join(store.clients()))
    return 0
