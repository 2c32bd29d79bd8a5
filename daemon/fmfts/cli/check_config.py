"""`fmfts-daemon check-config`: reads the configuration, and the contact models that it names."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from fmfts.cli import elsewhere
from fmfts.cli.verb import VerbError, configuration_as, ended_by
from fmfts.common import exit_codes
from fmfts.common.extras import how_to_install

if TYPE_CHECKING:
    from fmfts.config import Config


def run(options: argparse.Namespace) -> int:
    from fmfts.config import Config, I2cSource
    from fmfts.config.checks import other_silicone
    from fmfts.config.i2c_checks import rates_carried
    from fmfts.config.neighbour_checks import unnamed_neighbours
    from fmfts.contact import ContactModel, ModelError, NoContactModel
    from fmfts.contact.contract import SHEAR_OUTPUT_ORDER
    from fmfts.contact.unknown_finger import unknown_finger
    from fmfts.contact.unknown_shear import NO_SHEAR, SHEAR_UNKNOWN
    from fmfts.runtime.opening import load_models
    from fmfts.sensor import SourceError

    collecting = elsewhere.configuration_with("collect")
    config, path = configuration_as(collecting or Config, options)
    closed_keys = _why_keys_are_closed(config)
    with ended_by(ModelError, SourceError):
        models = load_models(config)
        _require_sources(config)
    if options.json:
        import msgspec

        print(json.dumps(msgspec.to_builtins(config), indent=1))
    else:
        print(f"good: {len(config.pad)} pad{'s' if len(config.pad) > 1 else ''} in {path}")
        if collecting is None and config.collect:
            print(f"warning: [collect] was not checked: it {how_to_install('collect')}", file=sys.stderr)
        if closed_keys:
            print(f"warning: the keys were not checked: {closed_keys}", file=sys.stderr)
        for pad in config.pad:
            kind = pad.source.__struct_config__.tag
            model = models[pad.name]
            for text in unnamed_neighbours(pad, config.pad):
                print(f"{pad.name}: warning: {text}", file=sys.stderr)
            if isinstance(pad.source, I2cSource):
                print(f"{pad.name}: {rates_carried(config.pad, pad.source)}")
            if isinstance(model, NoContactModel):
                print(f"{pad.name}: {kind}, {pad.source.rate_hz} Hz, {model.tells} only")
                print(f"{pad.name}: warning: no place and no force: {model.reason}", file=sys.stderr)
                continue
            print(f"{pad.name}: {kind}, {pad.source.rate_hz} Hz, contact model {model.hash}…")
            if not isinstance(model, ContactModel):
                continue
            for warning in (other_silicone(pad), unknown_finger(model)):
                if warning is not None:
                    print(f"{pad.name}: warning: {warning}", file=sys.stderr)
            if model.shear_is_unknown:
                print(f"{pad.name}: warning: {SHEAR_UNKNOWN.format(friction=pad.contact.friction)}", file=sys.stderr)
            if model.facts.outputs == SHEAR_OUTPUT_ORDER and not model.has_shear:
                print(f"{pad.name}: warning: {NO_SHEAR}", file=sys.stderr)
    return 0


def _why_keys_are_closed(config: Config) -> str:
    """Why this user cannot read the daemon's keys; "" if they are good. Raises VerbError for other faults."""
    from fmfts.bus.client_list import ClosedKeysError, KeysError
    from fmfts.bus.keys import KeyFolder

    try:
        if config.bus.keys is not None:
            KeyFolder(Path(config.bus.keys)).check()
    except ClosedKeysError as error:
        return str(error)
    except KeysError as error:
        raise VerbError(exit_codes.CONFIG, str(error)) from error
    return ""


def _require_sources(config: Config) -> None:
    """Raise SourceError where a recording is damaged or of another kind of pad; LackingError without its package."""
    from fmfts.config import ReplaySource, SimulatedSource
    from fmfts.sources import open_sources, simulation

    if any(isinstance(pad.source, SimulatedSource) for pad in config.pad):
        simulation("source")
    for source, _ in open_sources([pad for pad in config.pad if isinstance(pad.source, ReplaySource)]):
        source.close()
