"""Finds why a listener receives nothing: asks the daemon or, if it does not answer, examines the endpoint."""

from __future__ import annotations

from fmfts.common.names import no_such_pad
from fmfts_client import ControlError, Endpoints, request
from fmfts_client.silence import why_silent

ANSWER_S = 0.5


class NoSuchPadError(Exception):
    """The daemon that answers does not have the pad; the text says which ones it has."""


def require_pad(endpoints: Endpoints, pad: str | None) -> None:
    """Raise NoSuchPadError if a daemon answers that does not have `pad`. None, or no daemon yet: no error."""
    if pad is None:
        return
    try:
        known = _pads(endpoints)
    except ControlError:
        return
    if pad not in known:
        raise NoSuchPadError(no_such_pad(pad, known, "this daemon"))


def why_nothing_came(endpoints: Endpoints, pad: str | None) -> str:
    """The reason, as a sentence, why no message of `pad` (None: of any pad) arrived."""
    try:
        known = _pads(endpoints)
    except ControlError:
        return why_silent(endpoints.bus, key=endpoints.key)
    return "no frame yet" if pad is None or pad in known else no_such_pad(pad, known, "this daemon")


def _pads(endpoints: Endpoints) -> list[str]:
    return [each["pad"] for each in request("pads", endpoint=endpoints, timeout_s=ANSWER_S)["pads"]]
