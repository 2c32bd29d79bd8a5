"""`fmfts-daemon status`: prints the last status of each pad of a running daemon."""

from __future__ import annotations

import json
import logging
import sys
from typing import TextIO

from rich.console import Console
from rich.table import Table
from rich.text import Text

from fmfts.common import exit_codes
from fmfts.view.silence import NoSuchPadError, require_pad
from fmfts_client import ControlError, EndpointError, MessageError, Status, UnreachableError, request
from fmfts_client.endpoints import for_client

TIMEOUT_S = 3.0
STARTING_S = 0.3  # where no daemon holds the lock: one may be starting
HOW_TO_START = (
    "start it with `fmfts-daemon run --config FILE` (as a service: sudo systemctl start fmfts); "
    "if it serves elsewhere, set FMFTS_BUS"
)
log = logging.getLogger(__name__)


def status(
    pad: str | None = None,
    *,
    as_json: bool = False,
    out: TextIO | None = None,
    endpoint: str | None = None,
    is_served: bool = True,
) -> int:
    """Print the last status of `pad` (None: of every pad). is_served: nothing shows that no daemon holds the endpoint.

    Returns the exit code: UNAVAILABLE where no daemon answers, USAGE where it has no such pad.
    """
    out = sys.stdout if out is None else out
    try:
        pads = request("status", endpoint=endpoint, timeout_s=TIMEOUT_S if is_served else STARTING_S).get("pads", [])
        if pad is not None:
            require_pad(for_client(endpoint), pad)
            pads = [one for one in pads if one["pad"] == pad]
        reports = [Status.from_message(one) for one in pads]
    except UnreachableError as error:
        unserved = f"no fmfts-daemon runs on {for_client(endpoint).control}: {HOW_TO_START}"
        log.error("%s", str(error).removeprefix("status: ") if is_served else unserved)
        return exit_codes.UNAVAILABLE
    except (ControlError, EndpointError, MessageError, NoSuchPadError) as error:
        log.error("%s", str(error).removeprefix("status: "))
        return (
            exit_codes.code_of(error) if isinstance(error, EndpointError | NoSuchPadError) else exit_codes.UNAVAILABLE
        )
    if as_json:
        print(json.dumps({"pads": pads}, indent=1), file=out)
    else:
        nothing = "no pad has reported yet" if pad is None else f"pad '{pad}' has not reported yet"
        Console(file=out, markup=False, highlight=False).print(render_status(reports) if reports else nothing)
    return 0


def render_status(reports: list[Status]) -> Table:
    """A table with a column for each pad."""
    table = Table()
    table.add_column("")
    for report in reports:
        table.add_column(report.pad, overflow="fold")
    columns = [_cells(report) for report in reports]
    for name in columns[0]:
        table.add_row(name, *(column[name] for column in columns))
    return table


def _cells(report: Status) -> dict[str, Text | str]:
    latencies = (report.latency_p50_s, report.latency_p99_s, report.latency_max_s)
    since_s = max(0.0, (report.t_publish_ns - report.since_ns) * 1e-9)
    return {
        "health": Text(f"{report.health} for {since_s:.0f} s", "green" if report.health == "ok" else "red"),
        "reason": report.reason,
        "source": f"{report.source}" + ("" if report.connected else ", not connected"),
        "rate": f"{report.rate_hz:.1f} of {report.rate_nominal_hz:g} Hz",
        "frames": str(report.frames),
        "lost": f"{report.gaps} never arrived, {report.dropped} unusable ({report.repeated} came again or too late), "
        f"{report.crc_errors} with a wrong check sum, {report.garbage_bytes} stray bytes, "
        f"{report.reconnects} reconnects",
        "latency": "–"
        if None in latencies
        else "/".join(f"{(each or 0.0) * 1e3:.2f}" for each in latencies) + " ms p50/p99/max",
        "temperature": "–" if report.temperature_c is None else f"{report.temperature_c:.1f} °C",
        "gains from": report.gains_from or "–",
        "remanence": "–" if report.remanence_t is None else f"{report.remanence_t:.3f} T",
        "drift": "not followed" if report.rest_drift_m is None else f"{report.rest_drift_m * 1e6:.1f} µm followed",
        "force scale": _scale(report.force_scale, report.force_scale_sd),
        "faults": "\n".join(report.sensor_faults) or "none",
        "up": f"{report.uptime_s:.0f} s",
    }


def _scale(stiffness: float | None, share: float | None) -> str:
    if share is None:
        return "–"
    if share == 0.0:
        return "as calibrated"
    open_still = f"± {share:.0%} of every force from the silicone"
    if stiffness is None:
        return f"{open_still}: its stiffness is not known; `weigh` or `calibrate` measures it"
    return (
        f"{open_still}, which is {stiffness:.2f} times as stiff as the model's, as a weight showed; "
        "the finger's width adds to it: contact.finger_mm"
    )
