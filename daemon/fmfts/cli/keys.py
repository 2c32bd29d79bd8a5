"""Defines the verb `keys`: its options and what it prints."""

from __future__ import annotations

import argparse
from pathlib import Path

from fmfts.cli.verb import AddVerb, VerbError, configuration, ended_by
from fmfts.common import exit_codes


def add_to(verb: AddVerb) -> None:
    """Add the verb. verb: makes a parser from a name, a handler and a line of help."""
    keys = verb("keys", _keys, "make and list the keys that let clients in over the network")
    keys.add_argument("action", choices=("new", "set", "forget", "list"))
    keys.add_argument("name", nargs="?", metavar="NAME", help="name of the client")
    keys.add_argument("-o", "--output", type=Path, metavar="FILE", help="file for the client's key (NAME.key)")
    rights = keys.add_mutually_exclusive_group()
    rights.add_argument(
        "--read-only",
        dest="may_change",
        action="store_false",
        default=None,
        help="new, set: the client receives and asks, and changes nothing (a new key is so without an option)",
    )
    rights.add_argument(
        "--may-change", action="store_true", default=None, help="new, set: it may record baselines and run self-tests"
    )


def _keys(options: argparse.Namespace) -> int:
    from fmfts.bus.keys import KeyFolder
    from fmfts.bus.lock import BusError

    folder = configuration(options).bus.keys
    if folder is None:
        raise VerbError(exit_codes.CONFIG, 'set [bus] keys to a folder for the keys (keys = "/etc/fmfts/keys")')
    if (options.name is None) != (options.action == "list"):
        raise VerbError(exit_codes.USAGE, f"keys {options.action}: {'no' if options.name else 'a'} NAME is needed")
    if options.may_change is not None and options.action in ("forget", "list"):
        raise VerbError(exit_codes.USAGE, f"keys {options.action}: --read-only and --may-change belong to new and set")
    if options.may_change is None and options.action == "set":
        raise VerbError(exit_codes.USAGE, "keys set: say --read-only or --may-change")
    store = KeyFolder(Path(folder))
    with ended_by(BusError):
        if options.action == "new":
            output = options.output or Path(f"{options.name}.key")
            store.add(options.name, output, may_change=bool(options.may_change))
            print(f"{output}: copy this file to the client by a safe way, and set FMFTS_KEY to it there")
            if not options.may_change:
                print(f"it is read-only; `fmfts-daemon keys set {options.name} --may-change` lets it record baselines")
        elif options.action == "set":
            store.grant(options.name, may_change=options.may_change)
        elif options.action == "forget":
            store.forget(options.name)
        else:
            for client in store.clients().values():
                print(f"{client.name}  {client.right}")
    return 0
